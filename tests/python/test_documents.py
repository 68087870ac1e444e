"""What is printed is true: Python blocks of README and docs, examples in docstrings, cited keys."""

import ast
import doctest
import re
import subprocess
import sys
from pathlib import Path

import pytest

import redundancy

ROOT = Path(__file__).resolve().parents[2]
MARKDOWN = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in MARKDOWN if "```python" in page.read_text()]
SOURCES = sorted(p for p in (ROOT / "python/redundancy").rglob("*") if p.suffix in {".py", ".pyi"})


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_python_blocks_run(page: Path, tmp_path: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.S | re.M)
    script = tmp_path / "blocks.py"
    script.write_text("\n".join(blocks))
    command = [sys.executable, "-W", "error", script]
    run = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("source", SOURCES, ids=lambda p: p.name)
def test_examples_in_docstrings(source: Path) -> None:
    nodes = ast.walk(ast.parse(source.read_text()))
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner()
    for node in nodes:
        if isinstance(node, documented) and (text := ast.get_docstring(node)):
            name = f"{source.name}:{getattr(node, 'name', '')}"
            runner.run(parser.get_doctest(text, {}, name, str(source), getattr(node, "lineno", 0)))
    assert runner.summarize(verbose=False).failed == 0


def test_every_cited_key_is_in_the_bibliography() -> None:
    known = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "docs/references.bib").read_text(), re.M))
    files = [p for d in ("crates", "python", "tests", "docs", "benches") for p in (ROOT / d).rglob("*")]
    cited = {
        (key, str(file.relative_to(ROOT)))
        for file in files
        if file.suffix in {".rs", ".py", ".pyi", ".md"}
        for key in re.findall(r"\[([A-Z][A-Za-z]+(?:19|20)\d\d)\b", file.read_text())
    }
    assert not {(key, file) for key, file in cited if key not in known}


def test_the_changelog_knows_the_version() -> None:
    assert redundancy.__version__ in (ROOT / "Cargo.toml").read_text()
