"""Check a built documentation site without network: links and pictures, and that the reference has every public name.

Usage: check_site.py DIRECTORY
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import redundancy

GENERATED = {"genindex.html", "py-modindex.html", "search.html"}


class Page(HTMLParser):
    """The anchors of a page and what it refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = {"", "top"}
        self.references: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Called by the parser."""
        for key, value in attrs:
            if value and key in {"id", "name"}:
                self.anchors.add(value)
            if value and ((tag == "a" and key == "href") or (tag == "img" and key == "src")):
                self.references.append(value)


def broken_links(site: Path) -> list[str]:
    """One line for each reference inside the site that leads nowhere, and for each external one without a host."""
    pages = {file: Page(file.read_text()) for file in site.rglob("*.html") if "_static" not in file.parts}
    found = []
    for file, page in pages.items():
        for reference in page.references:
            parts = urlsplit(reference)
            if parts.scheme in {"http", "https"}:
                if not parts.netloc or " " in reference:
                    found.append(f"{file.relative_to(site)}: {reference!r} is not an address")
                continue
            if parts.scheme in {"mailto", "data"}:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not target.is_file():
                found.append(f"{file.relative_to(site)}: {reference!r} does not exist")
            elif parts.fragment and target in pages and target.name not in GENERATED:
                if unquote(parts.fragment) in pages[target].anchors:
                    continue
                found.append(f"{file.relative_to(site)}: {reference!r} has no such anchor")
    return found


def figures_as_text(site: Path) -> list[str]:
    """Pages on which a figure is only named, because the kernel did not draw it."""
    pages = (file for file in site.rglob("*.html") if "&lt;Figure size" in file.read_text())
    return [f"{file.relative_to(site)}: a figure is shown as text" for file in pages]


def missing_names(site: Path) -> list[str]:
    """Public names of the package that the site's inventory does not have."""
    from sphinx.util.inventory import InventoryFile  # noqa: PLC0415 -- the rest does without Sphinx

    with (site / "objects.inv").open("rb") as stream:
        inventory = InventoryFile.load(stream, "", lambda base, path: path)
    documented = {name for kind, names in inventory.items() if kind.startswith("py:") for name in names}
    names = [name for name in redundancy.__all__ if name != "__version__"]
    return [name for name in names if f"redundancy.{name}" not in documented]


def main(site: Path) -> int:
    """Print what is wrong; the exit status."""
    site = site.resolve()
    faults = broken_links(site) + figures_as_text(site)
    faults += [f"the reference lacks redundancy.{name}" for name in missing_names(site)]
    print("\n".join(faults) or f"{site}: links and names are complete")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
