"""Figures of critical points: loci, self-motions, followed paths. Needs the extra `plot`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from redundancy._core import (
    Chain,
    Criterion,
    CriticalPoint,
    FollowedOptimum,
    RankedStart,
    SelfMotionCurve,
    SingularPoint,
    Task,
    cofactor_condition,
)

__all__ = ["along_path", "loci", "resolved_paths", "self_motion_values", "values_along_path"]

_KINDS = {
    "maximum": ("#1b5e8c", "^"),
    "minimum": ("#c0392b", "v"),
    "saddle": ("#8e44ad", "D"),
    "degenerate": ("#222222", "x"),
}
_LINES = ("#1b5e8c", "#c0392b", "#2e8b57", "#8e44ad", "#d68910", "#555555")
_NECESSARY, _SUFFICIENT, _FAINT = "#222222", "#d68910", "#bbbbbb"


def loci(
    chain: Chain,
    criterion: Criterion,
    task: str | Task = "planar",
    singularities: Sequence[SingularPoint] = (),
    n: int = 181,
    figure: Figure | None = None,
) -> Figure:
    """Where mu and A vanish in the plane of joints 2 and 3, as figure 1 of [Park1996].

    For arms of three joints whose criterion does not depend on the first one.

    Args:
        chain: The arm.
        criterion: The criterion.
        task: Two coordinates.
        singularities: Marked where the loci cross.
        n: Grid points along each joint.
        figure: Figure to draw into; a new one by default.
    """
    figure = Figure(figsize=(11, 5.5), layout="constrained") if figure is None else figure
    angles = np.linspace(-np.pi, np.pi, n)
    mu, condition = np.empty((n, n)), np.empty((n, n))
    for i, q3 in enumerate(angles):
        for j, q2 in enumerate(angles):
            at = cofactor_condition(chain, [0.0, q2, q3], criterion, task)
            mu[i, j], condition[i, j] = at.mu, at.condition
    degrees = np.degrees(angles)
    for place, title in ((121, "mu = 0"), (122, "mu = 0 and A = 0")):
        axes = figure.add_subplot(place)
        axes.contour(degrees, degrees, mu, levels=[0.0], colors=_NECESSARY, linewidths=1.2)
        if place == 122:
            axes.contour(degrees, degrees, condition, levels=[0.0], colors=_SUFFICIENT, linewidths=1.0)
            q = np.degrees([point.q[1:3] for point in singularities]).reshape(-1, 2)
            axes.plot(*q.T, "o", color="#c0392b", markersize=5)
        _joint_plane(axes)
        axes.set_title(title)
    return figure


def resolved_paths(
    chain: Chain,
    criterion: Criterion,
    task: str | Task,
    curves: Sequence[SelfMotionCurve],
    ranked: Sequence[RankedStart],
    n: int = 181,
    figure: Figure | None = None,
) -> Figure:
    """The self-motion at the start and the paths from its critical points, over joints 2 and 3, as figure 2.

    A star marks where a path stops at an algorithmic singularity, a square a kinematic one.

    Args:
        chain: The arm, with three joints.
        criterion: The criterion.
        task: Two coordinates.
        curves: The self-motion at the start of the path.
        ranked: Result of `rank_starts`.
        n: Grid points along each joint for the locus of mu.
        figure: Figure to draw into; a new one by default.
    """
    figure = Figure(figsize=(7, 7), layout="constrained") if figure is None else figure
    axes = figure.add_subplot()
    angles = np.linspace(-np.pi, np.pi, n)
    mu = [[cofactor_condition(chain, [0.0, q2, q3], criterion, task).mu for q2 in angles] for q3 in angles]
    degrees = np.degrees(angles)
    axes.contour(degrees, degrees, np.array(mu), levels=[0.0], colors=_FAINT, linewidths=1.0)
    for curve in curves:
        _wrapped(axes, curve.q[:, 1:3], color=_NECESSARY, linestyle=":", linewidth=1.0)
    colors, _ = _colors(ranked)
    for start, color in zip(ranked, colors, strict=True):
        q = start.trajectory.q
        stop = start.trajectory.stop_q
        rows = q if stop is None else np.vstack([q, stop])
        _wrapped(axes, rows[:, 1:3], color=color, linewidth=2.0)
        marker = _KINDS[str(start.kind)][1]
        axes.plot(*_principal(start.q[1:3]), marker, color=color, markersize=6)
        if stop is not None:
            singular = str(start.trajectory.events[-1].kind) == "kinematic_singularity"
            axes.plot(*_principal(stop[1:3]), "s" if singular else "*", color=color, markersize=9)
    _joint_plane(axes)
    axes.set_title(f"{chain.name}: self-motion at the start, paths from its critical points")
    return figure


def self_motion_values(
    criterion: Criterion,
    curves: Sequence[SelfMotionCurve],
    points: Sequence[CriticalPoint],
    figure: Figure | None = None,
) -> Figure:
    """The criterion along every self-motion curve, with the critical points; grey where a joint limit is violated.

    Args:
        criterion: The criterion.
        curves: The self-motion for a pose.
        points: Result of `constrained_optima` for the same pose.
        figure: Figure to draw into; a new one by default.
    """
    rows = max(1, len(curves))
    columns = 1 if rows <= 3 else 2
    lines = -(-rows // columns)
    size = (6.5 * columns, 2.0 + 1.8 * lines)
    figure = Figure(figsize=size, layout="constrained") if figure is None else figure
    left = list(points)
    for k, curve in enumerate(curves):
        axes = figure.add_subplot(lines, columns, k + 1)
        s = np.linspace(0.0, curve.length, 1200)
        at = curve.at(s)
        q = _in_limits(at, curve)
        axes.plot(s, criterion.value(q), color=_FAINT, linewidth=1.2)
        legal = np.zeros(len(s), bool)
        for low, high in curve.intervals():
            legal |= (s - low) % max(curve.length, 1e-300) <= high - low
        values = np.where(legal, criterion.value(q), np.nan)
        axes.plot(s, values, color=_LINES[0], linewidth=1.8)
        for point in left[:]:
            away = np.abs((at - point.q + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
            nearest = int(np.argmin(away))
            if away[nearest] < 2 * curve.length / len(s):
                color, marker = _KINDS[str(point.kind)]
                axes.plot(s[nearest], point.value, marker, color=color, markersize=7)
                left.remove(point)
        axes.set(xlabel="length along the self-motion (rad)", ylabel="h")
    return figure


def along_path(
    chain: Chain, criterion: Criterion, task: str | Task, followed: FollowedOptimum
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Times, h and A along a followed critical point, up to the event itself, for arms with one spare freedom.

    Args:
        chain: The arm.
        criterion: The criterion.
        task: Which coordinates are kept.
        followed: Result of `follow_optimum`.

    Returns:
        `t` (s), `h` and `A` [Park1996, eq. (9)], `(N,)` each: one entry per row, and one for the place where it
        stopped, which lies between two rows.
    """
    t, q = followed.t, followed.q
    if followed.stop_q is not None and followed.events[-1].t > t[-1]:
        t, q = np.r_[t, followed.events[-1].t], np.vstack([q, followed.stop_q])
    condition = [cofactor_condition(chain, row, criterion, task).condition for row in q]
    return t, np.atleast_1d(criterion.value(q)), np.array(condition)


def values_along_path(
    ranked: Sequence[RankedStart],
    figure: Figure | None = None,
    *,
    chain: Chain | None = None,
    criterion: Criterion | None = None,
    task: str | Task = "planar",
) -> Figure:
    """The criterion and the quantity that decides its kind, along the path from every start: figure 3 of [Park1996].

    With `chain` and `criterion` that is the paper's A, and the curves end at the event: a star where critical points
    meet, a square at a kinematic singularity. Without them it is the eigenvalues of the reduced Hessian, row by row.

    Args:
        ranked: Result of `rank_starts`.
        figure: Figure to draw into; a new one by default.
        chain: The arm, with one spare freedom.
        criterion: The criterion.
        task: Which coordinates are kept.
    """
    figure = Figure(figsize=(7, 7), layout="constrained") if figure is None else figure
    above, below = figure.add_subplot(211), figure.add_subplot(212)
    for start, color, first in zip(ranked, *_colors(ranked), strict=True):
        followed = start.trajectory
        label = f"{start.kind}, {'completes' if followed.completed else 'stops'}"
        if chain is not None and criterion is not None:
            t, values, condition = along_path(chain, criterion, task, followed)
            curves = condition[:, None]
        else:
            t, values, curves = followed.t, followed.values, followed.eigenvalues
        above.plot(t, values, color=color, label=label if first else None)
        for curve in curves.T:
            below.plot(t, curve, color=color)
        if len(t) > len(followed.t):
            singular = str(followed.events[-1].kind) == "kinematic_singularity"
            for axes, value in ((above, values[-1]), (below, curves[-1, 0])):
                axes.plot(t[-1], value, "s" if singular else "*", color=color, markersize=8)
    below.axhline(0.0, color=_FAINT, linewidth=0.8)
    above.set(ylabel="h")
    exact = chain is not None and criterion is not None
    below.set(xlabel="t (s)", ylabel="A" if exact else "eigenvalues of the reduced Hessian")
    if ranked:
        above.legend(fontsize="small")
    return figure


def _colors(ranked: Sequence[RankedStart]) -> tuple[list[str], list[bool]]:
    """One colour for starts of one kind and value (mirror images), and which is the first of its colour."""
    groups: list[tuple[str, float]] = []
    colors, first = [], []
    for start in ranked:
        key = (str(start.kind), round(start.value, 6))
        first.append(key not in groups)
        if first[-1]:
            groups.append(key)
        colors.append(_LINES[groups.index(key) % len(_LINES)])
    return colors, first


def _principal(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees in [-180, 180)."""
    return np.asarray((np.degrees(q) + 180.0) % 360.0 - 180.0)


def _wrapped(axes: Any, q: NDArray[np.float64], **style: Any) -> None:
    """A line on the torus: broken where it leaves the square."""
    angles = _principal(q)
    jumps = np.flatnonzero((np.abs(np.diff(angles, axis=0)) > 180.0).any(axis=1))
    for part in np.split(angles, jumps + 1):
        axes.plot(*part.T, **style)


def _joint_plane(axes: Any) -> None:
    ticks = np.arange(-180, 181, 60)
    axes.set(xlim=(-180, 180), ylim=(-180, 180), xticks=ticks, yticks=ticks, aspect="equal")
    axes.set(xlabel="q2 (deg)", ylabel="q3 (deg)")


def _in_limits(q: NDArray[np.float64], curve: SelfMotionCurve) -> NDArray[np.float64]:
    """Revolute joints as critical points give them: principal values, wound into the limits where that is possible."""
    lower, upper = curve.chain.lower, curve.chain.upper
    principal = q - 2 * np.pi * np.round(q / (2 * np.pi))
    up = principal + 2 * np.pi * np.ceil(
        (np.where(np.isfinite(lower), lower, -np.pi) - principal) / (2 * np.pi)
    )
    down = up - 2 * np.pi
    legal = (principal >= lower) & (principal <= upper)
    return np.asarray(
        np.where(
            legal,
            principal,
            np.where((up >= lower) & (up <= upper), up, np.where(down >= lower, down, principal)),
        )
    )
