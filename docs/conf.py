"""Sphinx settings: the pages of this folder as a site, their Python blocks executed, the reference from the docstrings.

Pages are plain Markdown that also reads well without the site. When a page is read, its ```python blocks become cells
that run in one kernel, and links to files outside of this folder become links to the pages that include these files.
`reference/` is written from the module that is installed, see `_ext/reference.py`.
"""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_ext"))

import redundancy  # noqa: E402

project = "redundancy"
author = "The redundancy authors"
project_copyright = author
version = release = redundancy.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton", "reference"]
root_doc = "index"
exclude_patterns = ["_build", "_ext"]
nitpicky = False

myst_enable_extensions = ["colon_fence", "fieldlist"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 120
nb_merge_streams = True

autodoc_member_order = "groupwise"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "furo"
html_title = f"redundancy {release}"
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"source_edit_link": "", "source_view_link": ""}
html_static_path = ["_static"]
html_css_files = ["site.css"]

KERNEL = """---
kernelspec:
  display_name: Python 3
  language: python
  name: python3
jupytext:
  text_representation:
    extension: .md
    format_name: myst
---
"""
FIGURES = """
```{code-cell} python
:tags: [remove-cell]
%matplotlib inline
```
"""
"""A hidden first cell, without which a figure would be shown as text."""
OUTSIDE = {
    "README.md": "start/install.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
"""Files of the repository that pages link to, and the pages of the site that stand for them."""


def prepare(app: Sphinx, docname: str, content: list[str]) -> None:
    """Turn a page into a notebook and its outside links into links of the site."""
    text = content[0]
    up = "../" * docname.count("/")
    for name, page in OUTSIDE.items():
        text = re.sub(rf"\]\((?:\.\./)+{re.escape(name)}", f"]({up}{page}", text)
    if re.search(r"^```python$", text, re.MULTILINE) and not text.startswith("---"):
        if "plot" in text:
            text = text.replace("\n```python\n", FIGURES + "\n```python\n", 1)
        text = KERNEL + re.sub(r"^```python$", "```{code-cell} python", text, flags=re.MULTILINE)
    content[0] = with_every_page(text) if docname == root_doc else text


def with_every_page(text: str) -> str:
    """The text of the front page, whose list of subjects gets the pages of this folder that it does not name yet."""
    known = set(re.findall(r"^([\w/]+)$", text, re.MULTILINE))
    missing = sorted(page.stem for page in DOCS.glob("*.md") if page.stem not in known | {root_doc})
    return text.replace("\ncli\n```", "\n" + "".join(f"{page}\n" for page in missing) + "cli\n```")


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", prepare)
