"""The pages of `reference/`: every public name, grouped by subject, with the docstring that `help()` shows.

The groups are listed here. A public name in no group appears on the page 'Further names', so none is ever left out;
`tests/python/test_site.py` checks that. Docstrings are Google style with Markdown in them; `prose` turns that into what
Sphinx reads.
"""

import importlib
import inspect
import re
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

GROUPS: dict[str, tuple[str, str]] = {
    "arms": (
        "Arms",
        "Chain Task pose catalog quaternion RedundancyError DescriptionError FileFormatError "
        "CannotFollowError Status Kind EventKind",
    ),
    "solutions": (
        "Configurations for a pose",
        "solutions Solutions Piece Solution closed_form SrsArm SelfMotion Branch Choice "
        "ChoiceBatch PandaClassArm ParallelAxesArm SphericalWristArm Configurations SolveBatch "
        "NotSrsError NotPandaClassError NotParallelAxesError NotSphericalWristError "
        "trace_self_motion self_motion_curves self_motion_patch SelfMotionCurve",
    ),
    "ik": (
        "Inverse kinematics",
        "IkSolver IkResult IkBatch IkTrace sinusoid_minimum half_angle_minimum joint_cost",
    ),
    "paths": (
        "Paths and trajectories",
        "Path paths Trajectory Event times_within_limits",
    ),
    "planning": (
        "Plans for whole paths",
        "plan Plan ToolFreedom plan_swivel SwivelPlan SwivelFlow",
    ),
    "motion": (
        "Times and checks",
        "retime RetimedTrajectory joint_move check CheckReport Finding ros",
    ),
    "velocity": (
        "Velocities, accelerations and streams",
        "Resolver ProjectedGradient ReducedGradient ExtendedJacobian SaturatedNullspace "
        "PrioritizedNullspace Damping Step track Track Servo ServoOutput",
    ),
    "criteria": (
        "Criteria",
        "Criterion JointRange Manipulability Posture Clearance Elbow GravityTorque KineticEnergy "
        "Swivel SelfClearance CustomCriterion",
    ),
    "scene": (
        "Obstacles and bodies",
        "Scene Sphere Box Capsule Cylinder HalfSpace Mesh ClearanceResult LinkGeometry "
        "SelfClearanceResult PairClearances",
    ),
    "optimum": (
        "Kinds of optima",
        "classify Classification constrained_optima CriticalPoint cofactor_condition "
        "CofactorCondition follow_optimum FollowedOptimum rank_starts RankedStart "
        "algorithmic_singularities SingularPoint singularity_curves SingularityCurve "
        "singularity_distance",
    ),
    "rotation": (
        "Orientations",
        "QuaternionVolume CrossSection Cone Spin OrientationSet OrientationOptimizer "
        "OrientationSolution optimal_directions",
    ),
    "painting": (
        "Painting speed",
        "orientation_rules OrientationRule max_speed MaxSpeed plan_orientation OrientationPlan "
        "fastest_profile SpeedProfile",
    ),
    "seeing": (
        "Figures, maps, explorer",
        "plot plot_plan plot_optimum plot_painting plot_ik plot_rotation maps explore Explorer",
    ),
}
FURTHER = "further"
MODULES = {
    *("catalog", "quaternion", "paths", "ros", "orientation_rules", "maps"),
    *("plot", "plot_plan", "plot_optimum", "plot_painting", "plot_ik", "plot_rotation"),
}
"""Modules that are documented whether or not `__all__` names them, if they can be imported."""


def public(package: Any) -> list[str]:
    """Names of the package that the reference has to describe."""
    return [name for name in package.__all__ if name != "__version__"]


def target(package: Any, name: str) -> Any:
    """What a name stands for, modules included; `None` where this version or environment does not have it."""
    found = getattr(package, name, None)
    if found is None and name in MODULES:
        try:
            found = importlib.import_module(f"{package.__name__}.{name}")
        except ImportError:
            return None
    return found


def entry(package: Any, name: str) -> list[str]:
    """The lines of reStructuredText that document one name."""
    what = target(package, name)
    full = f"{package.__name__}.{name}"
    if isinstance(what, ModuleType):
        lines = [f".. automodule:: {full}", ""]
        members = getattr(what, "__all__", None) or [
            n
            for n, member in vars(what).items()
            if not n.startswith("_")
            and getattr(member, "__module__", None) == full
            and (inspect.isclass(member) or inspect.isfunction(member))
        ]
        for member in members:
            documented = getattr(what, member)
            kind = "class" if inspect.isclass(documented) else "function" if callable(documented) else "data"
            lines += [
                f".. auto{kind}:: {full}.{member}",
                *([""] if kind != "class" else ["   :members:", ""]),
                "",
            ]
        return lines
    if inspect.isclass(what):
        kind = "exception" if issubclass(what, BaseException) else "class"
        return [f".. auto{kind}:: {full}", "   :members:", "   :undoc-members:", "   :show-inheritance:", ""]
    if callable(what):
        return [f".. autofunction:: {full}", ""]
    return [f".. autodata:: {full}", ""]


def pages(package: Any) -> dict[str, str]:
    """The text of each page by its name, `index` included."""
    grouped = {name for _, names in GROUPS.values() for name in names.split()}
    rest = [name for name in public(package) if name not in grouped]
    groups = dict(GROUPS)
    if rest:
        groups[FURTHER] = ("Further names", " ".join(rest))
    found, rows = {}, []
    for page, (title, names) in groups.items():
        present = [name for name in names.split() if target(package, name) is not None]
        if not present:
            continue
        lines = [title, "=" * len(title), ""]
        for name in present:
            if isinstance(target(package, name), ModuleType):
                heading = f"Module ``{package.__name__}.{name}``"
                lines += [heading, "-" * len(heading), ""]
            else:
                lines += [f"``{name}``", "-" * (len(name) + 4), ""]
            lines += entry(package, name)
        found[page] = "\n".join(lines) + "\n"
        rows.append(f"* :doc:`{title} <{page}>`: " + ", ".join(f"``{n}``" for n in present))
    title = "Reference"
    head = [
        title,
        "=" * len(title),
        "",
        "Every public name of the package, with the docstring that ``help()`` and editors show. Shapes",
        "are those of numpy, lengths are metres, angles radians.",
        "",
    ]
    tree = ["", ".. toctree::", "   :hidden:", "", *(f"   {page}" for page in found)]
    found["index"] = "\n".join([*head, *rows, *tree]) + "\n"
    return found


def write(app: "Sphinx") -> None:
    """Write the pages that have changed, and delete those that are no longer there."""
    folder = Path(app.srcdir) / "reference"
    folder.mkdir(exist_ok=True)
    wanted = {f"{page}.rst": text for page, text in pages(importlib.import_module("redundancy")).items()}
    for old in folder.glob("*.rst"):
        if old.name not in wanted:
            old.unlink()
    for name, text in wanted.items():
        file = folder / name
        if not file.is_file() or file.read_text() != text:
            file.write_text(text)


def inline(text: str) -> str:
    """A line of Markdown prose as reStructuredText: code spans doubled, what would be markup escaped, links named."""
    parts = re.split(r"(``?[^`]+``?)", text)
    glue = ["\\ " if i and re.match(r"\w", part) else "" for i, part in enumerate(parts)]
    for i, part in enumerate(parts):
        if i % 2:
            parts[i] = f"``{part.strip('`')}``"
        else:
            named = re.sub(r"\[([^\]]+)\]\((?!http)[^)]*\)", r"\1", part)
            parts[i] = glue[i] + re.sub(r"([*|]|(?<=\w)_(?!\w)|\\)", r"\\\1", named)
    return "".join(parts)


def prose(lines: list[str]) -> list[str]:
    """A Google-style docstring with Markdown in it, as Sphinx and napoleon read it."""
    found: list[str] = []
    kind = ""
    for line, now in classified(_joined_spans(lines)):
        if now in {"table", "code"} and now != kind:
            indent = " " * (len(line) - len(line.lstrip())) if now == "table" else ""
            found += [f"{indent}::", ""]
        elif kind == "table" and now != "table" and line.strip():
            found.append("")
        kind = now
        if now == "table":
            found.append("    " + line)
        else:
            found.append(inline(line) if now == "prose" else line)
    return found


def classified(lines: list[str]) -> list[tuple[str, str]]:
    """Each line with what it is: prose, code, doctest or table. Blank lines belong to what they are in."""
    found: list[tuple[str, str]] = []
    kind, section = "prose", False
    for line in lines:
        indent, text = len(line) - len(line.lstrip()), line.strip()
        after_blank = bool(found) and not found[-1][0].strip()
        if re.match(r"^[A-Z][A-Za-z ]+:$", line):
            section = True
        elif text and indent == 0:
            section = False
        if text.startswith(">>>") or (kind == "doctest" and text):
            kind = "doctest"
        elif text.startswith("|"):
            kind = "table"
        elif text and indent >= 4 and not section and (kind == "code" or after_blank):
            kind = "code"
        elif text or kind != "code":
            kind = "prose"
        found.append((line, kind))
    return found


def _joined_spans(lines: list[str]) -> list[str]:
    """Lines in which no code span goes on in the next line."""
    found: list[str] = []
    for line in lines:
        if found and found[-1].count("`") % 2 and line.strip() and not line.lstrip().startswith(">>>"):
            found[-1] += " " + line.strip()
        else:
            found.append(line)
    return found


def mend(app: "Sphinx", what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Before napoleon: Markdown in docstrings to reStructuredText."""
    lines[:] = prose(lines)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", write)
    app.connect("autodoc-process-docstring", mend, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
