"""The documentation site: its reference describes every public name, its pages are linked, faults are found."""

import importlib.util
import inspect
import re
from pathlib import Path
from types import ModuleType

import pytest

import redundancy

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def loaded(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem + "_of_site", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    return loaded(DOCS / "_ext/reference.py")


def test_every_public_name_is_on_one_page_of_the_reference(reference):
    pages = reference.pages(redundancy)
    text = "\n".join(pages.values())
    for name in redundancy.__all__:
        if name != "__version__":
            entries = re.findall(rf"^\.\. auto\w+:: redundancy\.{name}$", text, re.MULTILINE)
            assert len(entries) == 1, f"{name} occurs {len(entries)} times in the reference"


def test_a_name_without_a_group_is_not_left_out(reference):
    package = ModuleType("redundancy")
    package.__all__ = ["brand_new"]
    package.brand_new = lambda: None
    pages = reference.pages(package)
    assert ".. autofunction:: redundancy.brand_new" in pages["further"]
    assert "further" in pages["index"]


def test_docstrings_become_clean_markup(reference):
    docutils = pytest.importorskip("docutils.core")
    napoleon = pytest.importorskip("sphinx.ext.napoleon")
    for name in redundancy.__all__:
        what = getattr(redundancy, name)
        documented = [what, *(m for n, m in inspect.getmembers(what) if not n.startswith("_"))]
        for member in documented if inspect.isclass(what) else [what]:
            lines = reference.prose((inspect.getdoc(member) or "").splitlines())
            text = str(napoleon.GoogleDocstring(lines))
            document = docutils.publish_doctree(text, settings_overrides={"report_level": 5, "halt_level": 5})
            messages = [m.astext() for m in document.findall() if m.tagname == "system_message"]
            assert not messages, f"{name}, {getattr(member, '__name__', member)}: {messages}\n{text}"


@pytest.mark.parametrize(
    ("markdown", "expected"),
    [
        ("`a_` and *x* | y", r"``a_`` and \*x\* \| y"),
        ("the `Chain`s of b", r"the ``Chain``\ s of b"),
        ("see [scene](scene.md)", "see scene"),
    ],
)
def test_prose_is_escaped(reference, markdown, expected):
    assert reference.inline(markdown) == expected


def test_every_page_is_linked_from_the_front_page():
    index = (DOCS / "index.md").read_text()
    for folder in ("start", "howto", "concepts", "papers"):
        for page in (DOCS / folder).glob("*.md"):
            assert f"({folder}/{page.name})" in index, f"docs/index.md does not link {folder}/{page.name}"
    for page in DOCS.glob("*.md"):
        if page.stem not in {"index", "changelog", "contributing"}:
            assert f"({page.name})" in index, f"docs/index.md does not link {page.name}"


def test_the_checker_finds_broken_links(tmp_path):
    checker = loaded(ROOT / "tools/check_site.py")
    (tmp_path / "b.html").write_text('<p id="here">')
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here">fine</a> <a href="b.html#there">no anchor</a> <a href="c.html">no page</a>'
        '<img src="_images/none.png"> <a href="https:///x">no host</a>'
    )
    found = checker.broken_links(tmp_path)
    assert [line.split("'")[1] for line in found] == [
        "b.html#there",
        "c.html",
        "_images/none.png",
        "https:///x",
    ]
