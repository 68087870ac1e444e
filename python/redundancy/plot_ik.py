"""Figures of inverse kinematics: how fast algorithms converge. Part of `redundancy.plot`."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure, FigureBase
from numpy.typing import ArrayLike, NDArray

from redundancy._core import Chain, IkSolver, IkTrace

__all__ = ["convergence", "convergence_traces"]

METHODS = (
    "coordinate_descent",
    "gauss_southwell",
    "gauss_southwell_rate",
    "weighted_descent",
    "gradient_estimate",
    "newton",
)
"""The five descent algorithms and a Jacobian method."""
_FLOOR = 1e-12
"""Least error drawn: below it there is rounding."""


def convergence_traces(
    chain: Chain,
    poses: ArrayLike,
    starts: ArrayLike,
    methods: Sequence[str] = METHODS,
    iterations: int = 200,
    tol: float = 1e-6,
) -> dict[str, list[IkTrace]]:
    """Runs every method from the same starts to the same poses, one iteration at a time.

    Args:
        chain: The arm.
        poses: `(N, 4, 4)` targets.
        starts: `(N, n)` configurations to begin at.
        methods: Names of `IkSolver` methods.
        iterations: Most iterations of a run.
        tol: Tolerance in m and rad at which a run ends.
    """
    solvers = {
        name: IkSolver(chain, name, tol_position=tol, tol_orientation=tol, max_iterations=iterations)
        for name in methods
    }
    pairs = list(zip(np.asarray(poses, float), np.asarray(starts, float), strict=True))
    return {name: [solver.trace(pose, q0) for pose, q0 in pairs] for name, solver in solvers.items()}


def convergence(
    traces: Mapping[str, Sequence[IkTrace]], tol: float = 1e-6, figure: FigureBase | None = None
) -> FigureBase:
    """Error over iterations, and the share of runs that have arrived.

    The error is the larger of metres and radians; lines are medians, bands hold half of the runs.

    Args:
        traces: Runs by name of the method, see `convergence_traces`.
        tol: Error at which a run counts as arrived.
        figure: Figure to draw into; a new one by default.

    Raises:
        ValueError: No runs.
    """
    if not traces or not all(traces.values()):
        raise ValueError("there is nothing to draw: a method has no runs")
    figure = Figure(figsize=(9, 3.8), layout="constrained") if figure is None else figure
    left, right = figure.subplots(1, 2)
    length = max(len(trace) for runs in traces.values() for trace in runs)
    iteration = np.arange(length)
    for name, runs in traces.items():
        errors = np.array([_errors(trace, length) for trace in runs])
        low, middle, high = np.percentile(errors, [25, 50, 75], axis=0)
        (line,) = left.plot(iteration, middle, label=name.replace("_", " "))
        left.fill_between(iteration, low, high, color=line.get_color(), alpha=0.12, linewidth=0)
        right.plot(iteration, 100 * (errors <= tol).mean(axis=0), color=line.get_color())
    left.set(xscale="symlog", yscale="log", ylim=(_FLOOR, 10), xlabel="iteration", ylabel="error (m, rad)")
    left.axhline(tol, color="#888888", linewidth=0.8, linestyle="--")
    left.legend(fontsize="small")
    right.set(xscale="symlog", ylim=(0, 100), xlabel="iteration", ylabel=f"runs within {tol:g} (%)")
    for axes in (left, right):
        axes.grid(color="#dddddd")
        axes.set_xlim(0, length - 1 if length > 1 else 1)
    return figure


def _errors(trace: IkTrace, length: int) -> NDArray[np.float64]:
    """Error before each iteration; after the end it stays."""
    errors = np.maximum(np.maximum(trace.position_error, trace.orientation_error), _FLOOR)
    return np.concatenate([errors, np.full(length - len(errors), errors[-1])])
