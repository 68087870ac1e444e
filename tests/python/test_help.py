"""Help: the stub says what the module says, and both say what a caller needs."""

import ast
import importlib.util
import inspect
import re
import types
from pathlib import Path

import numpy as np
import pytest

import redundancy as rd
from redundancy import _core

ROOT = Path(__file__).parents[2]


def _tool() -> types.ModuleType:
    spec = importlib.util.spec_from_file_location("stubs", ROOT / "tools/stubs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


stubs = _tool()
STUB = stubs.STUB.read_text()
TREE = ast.parse(STUB)

# Python's own modules that make up the public names beside `redundancy` itself.
MODULES = (rd, rd.catalog, rd.paths, rd.quaternion, rd.orientation_rules)

# Classes that other functions make: their arguments are options of those, or what a pickle holds.
MADE_ELSEWHERE = {"OrientationRule"}

# A shape in backticks, or words that stand for one.
SHAPE = re.compile(r"`\([^`]*[,)]`|`\([\w, ]+\)|SE3-like|[Aa]s (in|of|for)|number|[Ss]ee `|likewise|row")

UNIT = re.compile(
    r"\b(m|mm|rad|s|kg|N|N m|deg)\b|/s\b|1/|unit|[Ss]hare|of any length|quaternion|index|[Ss]ame|as of|[Rr]atio"
)


def _documents() -> list[tuple[str, str]]:
    """Public names with their docstrings at run time: modules, classes, their members, functions."""
    found: dict[str, str] = {}
    for module in MODULES:
        found[module.__name__] = module.__doc__ or ""
        for name in module.__all__:
            thing = getattr(module, name)
            if isinstance(thing, types.ModuleType) or name == "__version__":
                continue
            found[f"{module.__name__}.{name}"] = inspect.cleandoc(thing.__doc__ or "")
    return list(found.items())


def _members() -> list[tuple[str, ast.ClassDef | ast.FunctionDef]]:
    """Members of the stub that a caller sees: no private names, none of the functions that Python code wraps."""
    wrapped = {"paths_circle", "paths_raster", "catalog_load", "catalog_names"}
    return [
        (name, node)
        for name, node in stubs.members(TREE)
        if not any(part.startswith("_") for part in name.split(".")) and name not in wrapped
    ]


MEMBERS = dict(_members())


def _arguments(node: ast.FunctionDef) -> list[ast.arg]:
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return [a for a in arguments if a.arg not in {"self", "cls"}]


def _constructors() -> dict[str, ast.FunctionDef]:
    classes = [node for node in TREE.body if isinstance(node, ast.ClassDef)]
    methods = {c.name: {m.name: m for m in c.body if isinstance(m, ast.FunctionDef)} for c in classes}
    return {name: m["__new__"] for name, m in methods.items() if "__new__" in m}


CONSTRUCTORS = _constructors()


def _callables() -> list[tuple[str, ast.FunctionDef]]:
    """Functions, methods and constructors, which are documented with their class."""
    functions = [
        (name, node)
        for name, node in MEMBERS.items()
        if isinstance(node, ast.FunctionDef) and not _is_property(node)
    ]
    return functions + [(name, node) for name, node in CONSTRUCTORS.items() if name not in MADE_ELSEWHERE]


def _is_property(node: ast.FunctionDef) -> bool:
    return any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list)


def _text(name: str, argument: str) -> str:
    """What the docstring of `name` says about an argument: its entry under Args, else all of its prose.

    An argument of a constructor may be documented as the property that it becomes.
    """
    text = stubs.docstring(_core, name)
    entry = re.search(rf"^( *){argument}: .*(?:\n\1 +.*)*", text, re.M)
    if entry:
        return entry[0]
    if re.search(rf"\b{argument}\b", text.split("Example:")[0]):
        return text
    owner = MEMBERS.get(f"{name}.{argument}")
    if name in CONSTRUCTORS and owner is not None and _is_property(owner):
        return f"{argument}: " + stubs.docstring(_core, f"{name}.{argument}")
    return ""


def test_stub_and_module_have_the_same_docstrings():
    names = stubs.differences(STUB, _core)
    assert not names, f"make stubs: {names}"


def test_the_tool_finds_and_mends_a_difference():
    changed = STUB.replace("Number of moving joints.", "Number of joints.", 1)
    assert changed != STUB and stubs.differences(changed, _core) == ["Chain.dof"]
    mended = stubs.with_docstrings(changed, _core)
    assert mended == STUB and stubs.differences(mended, _core) == []
    bare = re.sub(r'\n +"""Number of moving joints."""', " ...", STUB, count=1)
    assert bare != STUB and stubs.differences(bare, _core) == ["Chain.dof"]
    assert stubs.with_docstrings(bare, _core) == STUB


@pytest.mark.parametrize("name", sorted({*MEMBERS, *CONSTRUCTORS}))
def test_signatures_are_those_of_the_stub(name: str):
    node = CONSTRUCTORS.get(name) or MEMBERS[name]
    if isinstance(node, ast.ClassDef) or _is_property(node):
        return
    found = stubs.member(_core, name)
    found = found.__func__ if isinstance(found, (staticmethod, classmethod)) else found
    parameters = [
        p
        for p in inspect.signature(found).parameters.values()
        if p.name not in {"self", "cls"} and p.kind is not p.VAR_KEYWORD
    ]
    assert [p.name for p in parameters] == [a.arg for a in _arguments(node)], "names"
    positional = [*node.args.posonlyargs, *node.args.args]
    defaults = [*[None] * (len(positional) - len(node.args.defaults)), *node.args.defaults]
    defaults = dict(zip((a.arg for a in positional), defaults, strict=True))
    defaults |= dict(zip((a.arg for a in node.args.kwonlyargs), node.args.kw_defaults, strict=True))
    keywords = {a.arg for a in node.args.kwonlyargs}
    for parameter in parameters:
        default = defaults[parameter.name]
        assert (parameter.kind is parameter.KEYWORD_ONLY) == (parameter.name in keywords), parameter
        assert parameter.default is not ..., parameter
        assert (parameter.default is parameter.empty) == (default is None), parameter
        if default is not None:
            assert ast.literal_eval(default) == parameter.default, parameter


@pytest.mark.parametrize(("name", "text"), _documents(), ids=lambda x: x if "\n" not in x else "")
def test_every_public_name_has_a_docstring(name: str, text: str):
    first = text.splitlines()[0] if text else ""
    assert first.endswith((".", "!", "?", ",", ":")) or len(first) > 60, f"{name}: {first!r}"


@pytest.mark.parametrize("name", sorted(MEMBERS))
def test_every_member_has_a_docstring(name: str):
    assert stubs.docstring(_core, name)


@pytest.mark.parametrize(("name", "node"), _callables(), ids=[name for name, _ in _callables()])
def test_every_parameter_is_described(name: str, node: ast.FunctionDef):
    for argument in _arguments(node):
        text = _text(name, argument.arg)
        assert text, f"{name} says nothing about {argument.arg}"
        if "ArrayLike" in ast.unparse(argument.annotation or ast.Constant("")):
            assert SHAPE.search(text), f"{name} gives no shape of {argument.arg}: {text!r}"


@pytest.mark.parametrize("module", [rd.catalog, rd.paths, rd.orientation_rules], ids=lambda m: m.__name__)
def test_functions_in_python_describe_their_parameters(module: types.ModuleType):
    for name in module.__all__:
        function = getattr(module, name)
        entries = re.findall(r"^    (\w+): ", inspect.getdoc(function), re.M)
        parameters = list(inspect.signature(function).parameters)
        assert entries[: len(parameters)] == parameters, name


@pytest.mark.parametrize("name", [n for n, node in MEMBERS.items() if isinstance(node, ast.FunctionDef)])
def test_arrays_have_a_shape_and_numbers_a_unit(name: str):
    node = MEMBERS[name]
    text = stubs.docstring(_core, name)
    if not _is_property(node) or node.returns is None:
        return
    kind = ast.unparse(node.returns)
    if "NDArray" in kind:
        assert SHAPE.search(text), f"{name} gives no shape: {text!r}"
    if kind in {"float", "float | None"}:
        assert UNIT.search(text) or name in WITHOUT_UNIT, f"{name} gives no unit: {text!r}"


# Numbers whose unit is that of something that the caller chose, and pure numbers that say so by their definition.
WITHOUT_UNIT: set[str] = set()


def test_reprs_say_what_one_wants_to_know():
    arm = rd.SrsArm(rd.catalog.load("pa10"))
    chain = arm.chain
    q = np.array([0.1, 0.5, 0.2, 1.2, 0.3, 0.8, 0.0])
    far = chain.forward(q)
    far[0, 3] += 5.0
    poses = np.stack([chain.forward(q), far])
    assert repr(rd.IkSolver(chain).solve_batch(poses)) == "IkBatch(2 poses, 1 converged)"
    batch = arm.solve_batch(poses, float(arm.swivel(q)))
    assert repr(batch) == "SolveBatch(2 poses, 1 with a configuration)"
    assert repr(arm.best_batch(poses, rd.JointRange(chain))) == "ChoiceBatch(2 poses, 1 with a configuration)"
    criterion = rd.JointRange(chain)
    scheme = rd.ProjectedGradient(chain, criterion, 1.0)
    assert repr(criterion) in repr(scheme) and "task='pose'" in repr(scheme)
    assert repr(rd.SaturatedNullspace(chain)).count("JointRange") == 0
    path = rd.paths.circle([0.45, 0, 0.5], 0.1, orientation=np.diag([1.0, -1, -1]), n=20)
    plan = rd.plan_swivel(arm, path)
    assert "converged" in repr(plan) and f"cost {plan.cost:.6f}" in repr(plan)


def test_notebooks_get_tables():
    arm = rd.SrsArm(rd.catalog.load("pa10"))
    chain = arm.chain
    path = rd.paths.circle([0.45, 0, 0.5], 0.1, orientation=np.diag([1.0, -1, -1]), n=20)
    plan = rd.plan_swivel(arm, path)
    motion = arm.self_motion(path.poses[0])
    table = chain.with_limits(upper=np.inf)._repr_html_()
    assert all(f"<td>{name}</td>" in table for name in chain.joint_names) and "<td>none</td>" in table
    assert f"<td>{chain.lower[0]:.4f}</td>" in table
    table = plan._repr_html_()
    assert f"<td>{plan.cost:.6f}</td>" in table and "<td>converged</td>" in table
    assert f"<td>{plan.q[:, 2].max():.4f}</td>" in table
    arcs = next(arcs for branch in motion.branches if len(arcs := branch.intervals()))
    table = motion._repr_html_()
    assert table.count("<tr>") == 1 + len(motion.branches)
    assert f"[{arcs[0, 0]:.4f}, {arcs[0, 1]:.4f}]" in table
    trajectory = rd.Trajectory(["<a>", "b"], [0.0, 1.0], [[0.0, 1.0], [0.5, -1.0]])
    table = trajectory._repr_html_()
    assert "<td>&lt;a&gt;</td>" in table and "<td>-1.0000</td>" in table and "<td>2.0000</td>" in table
    empty = rd.Trajectory(["a"], [], np.zeros((0, 1)), np.zeros((0, 1)))
    assert "<td>a</td><td></td>" in empty._repr_html_()
