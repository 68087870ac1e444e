"""List the public API of the Rust crate, and compare it with the stored listing.

Usage: public_api.py DIRECTORY [--store], where DIRECTORY is what `cargo doc` wrote for the crate. The listing has one
line for each item and method with its signature, read from the pages of rustdoc without a nightly compiler. It is
stored in `crates/redundancy-core/public-api.txt`. What was removed or changed since breaks users: exit status 1. What
was added does not.
"""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

STORED = Path(__file__).resolve().parents[1] / "crates/redundancy-core/public-api.txt"
KINDS = ("struct", "enum", "trait", "fn", "constant", "static", "type", "macro")
HIDDEN = {"implementors", "trait.impl", "type.impl", "src"}


class Signatures(HTMLParser):
    """The declaration on a page of rustdoc, and the headings of its own methods, fields and variants."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self._depth = 0
        self._text: list[str] = []
        self._foreign = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Called by the parser."""
        values = dict(attrs)
        classes = (values.get("class") or "").split()
        name = values.get("id") or ""
        if name in {
            "trait-implementations",
            "synthetic-implementations",
            "blanket-implementations",
            "implementors",
        }:
            self._foreign = True
        if name in {"implementations", "required-methods", "provided-methods"}:
            self._foreign = False
        if self._depth:
            self._depth += tag in {"pre", "h3", "h4", "section"}
        elif (tag == "pre" and "item-decl" in classes) or (
            tag in {"h3", "h4"} and "code-header" in classes and not self._foreign
        ):
            self._depth, self._text = 1, []

    def handle_endtag(self, tag: str) -> None:
        """Called by the parser."""
        if self._depth and tag in {"pre", "h3", "h4", "section"}:
            self._depth -= 1
            if not self._depth:
                line = re.sub(r"\s+", " ", "".join(self._text)).strip()
                self.found.append(re.sub(r"\s*([(),])\s*", r"\1 ", line).replace("( ", "(").strip())

    def handle_data(self, data: str) -> None:
        """Called by the parser."""
        if self._depth:
            self._text.append(data)


def listing(folder: Path) -> list[str]:
    """The lines of the API that is documented in `folder`."""
    lines = []
    for page in sorted(folder.rglob("*.html")):
        kind, _, name = page.stem.partition(".")
        if kind not in KINDS or not name or HIDDEN & set(page.parts):
            continue
        module = "::".join(page.relative_to(folder.parent).parts[:-1])
        lines += [f"{module}::{name}: {signature}" for signature in Signatures(page.read_text()).found]
    return sorted(set(lines))


def main(arguments: list[str]) -> int:
    """Store or compare; the exit status."""
    found = listing(Path(arguments[0]))
    if not found:
        print(f"{arguments[0]} holds no documentation; run `make rustdoc`")
        return 2
    if "--store" in arguments:
        STORED.write_text("\n".join(found) + "\n")
        print(f"{len(found)} lines stored in {STORED.name}")
        return 0
    before = STORED.read_text().splitlines()
    removed, added = sorted(set(before) - set(found)), sorted(set(found) - set(before))
    for sign, lines in (("-", removed), ("+", added)):
        for line in lines:
            print(sign, line)
    print(
        f"{len(removed)} removed or changed, {len(added)} added since the stored listing of {len(before)} lines"
    )
    return 1 if removed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
