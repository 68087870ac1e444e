"""Docstrings of `_core.pyi` from the built module: the `///` comments of the bindings are their one source.

`make stubs` builds the module and writes them; annotations, defaults, overloads and order of the stub stay as they are.
`python tools/stubs.py --check` writes nothing and fails where a docstring differs.
"""

import argparse
import ast
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

STUB = Path(__file__).parents[1] / "python/redundancy/_core.pyi"

_Documented = ast.ClassDef | ast.FunctionDef


def members(tree: ast.Module) -> Iterator[tuple[str, _Documented]]:
    """Names and nodes of everything in a stub that carries a docstring; of overloads the last one.

    Private and magic methods are left out: the docstrings of the latter come from the interpreter.
    """
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield node.name, node
            methods = {sub.name: sub for sub in node.body if isinstance(sub, ast.FunctionDef)}
            for name, method in methods.items():
                if not name.startswith("_"):
                    yield f"{node.name}.{name}", method


def member(module: ModuleType, name: str) -> Any:
    """What a dotted name means in the module; of a class its own or inherited attribute, not bound."""
    owner, _, attribute = name.partition(".")
    try:
        found = getattr(module, owner)
        return inspect.getattr_static(found, attribute) if attribute else found
    except AttributeError:
        raise AttributeError(f"the stub has '{name}', the module that was built has not") from None


def docstring(module: ModuleType, name: str) -> str:
    """The module's docstring of a dotted name; empty where there is none."""
    found = member(module, name)
    if isinstance(found, (staticmethod, classmethod)):
        found = found.__func__
    return inspect.cleandoc(found.__doc__ or "")


def _quoted(text: str, indent: int) -> list[str]:
    """A docstring as lines of a stub."""
    space = " " * indent
    start = 'r"""' if "\\" in text else '"""'
    lines = [space + line if line else "" for line in text.splitlines()]
    lines[0] = space + start + text.splitlines()[0]
    if len(lines) == 1:
        return [lines[0] + '"""']
    return [*lines, space + '"""']


def with_docstrings(stub: str, module: ModuleType) -> str:
    """The text of a stub with the docstrings of the module."""
    lines = stub.splitlines()
    for name, node in sorted(members(ast.parse(stub)), key=lambda pair: -pair[1].lineno):
        text = docstring(module, name)
        old = ast.get_docstring(node) or ""
        if text == old:
            continue
        first = node.body[0]
        indent = node.col_offset + 4
        start, end = first.lineno - 1, first.end_lineno or first.lineno
        if not text:
            kept = ["..."] if len(node.body) == 1 else []
            lines[start:end] = [" " * indent + line for line in kept]
        elif old:
            lines[start:end] = _quoted(text, indent)
        elif (
            isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and first.value.value is ...
        ):
            before = lines[start][: first.col_offset].rstrip()
            lines[start:end] = [*([before] if before else []), *_quoted(text, indent)]
        else:
            lines[start:start] = _quoted(text, indent)
    return "\n".join(lines) + "\n"


def differences(stub: str, module: ModuleType) -> list[str]:
    """Names whose docstrings in the stub and in the module differ."""
    pairs = members(ast.parse(stub))
    return [name for name, node in pairs if (ast.get_docstring(node) or "") != docstring(module, name)]


def main() -> int:
    """Write the stub, or compare it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing, fail where a docstring differs")
    check = parser.parse_args().check
    from redundancy import _core  # noqa: PLC0415 - so that `--help` needs no built module

    stub = STUB.read_text()
    names = differences(stub, _core)
    if check:
        if names:
            sys.stderr.write(f"make stubs: docstrings differ of {', '.join(names)}\n")
        return bool(names)
    STUB.write_text(with_docstrings(stub, _core))
    sys.stdout.write(f"{len(names)} docstrings written to {STUB.name}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
