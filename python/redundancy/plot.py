"""Figures of trajectories and self-motions: functions from data to `matplotlib.figure.Figure`, without global state.

Needs the extra `plot`. Angles in figures are in degrees.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike, NDArray

from redundancy._core import Chain, LinkGeometry, Path, Scene, SelfMotion, SrsArm, SwivelPlan, Trajectory
from redundancy.plot_ik import convergence, convergence_traces
from redundancy.plot_rotation import quaternion_volume

__all__ = [
    "convergence",
    "convergence_traces",
    "joints",
    "obstacle_map",
    "quaternion_volume",
    "self_motion",
    "swivel",
    "swivel_band",
    "swivel_map",
    "track",
]

_LINE = "#1b5e8c"
_OUTSIDE = "#e8b4a8"
_INSIDE = "#cfe3d4"
_EVENT = "#b03a2e"
_BLOCKED = "#8c2d19"
_GRID = "#dddddd"
_HALF_TURN = 180.0
_SHOWN = 600
"""Most points of a path that a map draws."""


def joints(trajectory: Trajectory, chain: Chain, figure: FigureBase | None = None) -> FigureBase:
    """Every joint over time, with the ranges that its limits forbid shaded.

    Args:
        trajectory: The motion; all joints are revolute.
        chain: The arm, for its limits.
        figure: Figure to draw into; a new one by default.
    """
    count = len(trajectory.joint_names)
    columns = 2 if count > 1 else 1
    rows = -(-count // columns)
    figure = Figure(figsize=(9, 1.5 * rows + 0.6), layout="constrained") if figure is None else figure
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, squeeze=False)).ravel()
    t, q = trajectory.t, np.rad2deg(trajectory.q)
    lower, upper = np.rad2deg(chain.lower), np.rad2deg(chain.upper)
    for j, (axis, name) in enumerate(zip(axes, trajectory.joint_names, strict=False)):
        _joint(axis, name, t, q[:, j], (lower[j], upper[j]))
    _finish_joints(axes, count, columns, "time (s)", "shaded: outside the joint limits")
    axes[0].set_xlim(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0)
    return figure


def self_motion(
    motion: SelfMotion,
    chain: Chain,
    branch: Sequence[int] | None = None,
    samples: int = 721,
    figure: FigureBase | None = None,
) -> FigureBase:
    """The joints of one branch over the swivel: limits shaded, swivels at which all limits hold marked.

    Args:
        motion: The configurations for a pose that is in reach.
        chain: The arm, for its limits.
        branch: Signs (shoulder, elbow, wrist); the branch with the longest feasible arcs when left out.
        samples: Number of swivels from -pi to pi.
        figure: Figure to draw into; a new one by default.

    Raises:
        ValueError: The pose is out of reach, or there is no such branch.
    """
    branches = motion.branches
    if not branches:
        raise ValueError(f"there is nothing to draw: {motion.reason}")
    if branch is not None:
        branches = [b for b in branches if b.index == _index(branch)]
        if not branches:
            expected = ", ".join(str(b.signs) for b in motion.branches)
            raise ValueError(f"branch is {branch}, expected one of: {expected}")
    chosen = max(branches, key=lambda b: float(np.diff(b.intervals()).sum()))
    s = np.linspace(-np.pi, np.pi, samples)
    q, degrees = np.rad2deg(chosen.q(s)), np.rad2deg(s)
    arcs = [np.rad2deg(arc) for arc in _within_turn(chosen.intervals())]
    count, columns = q.shape[1], 2
    rows = -(-count // columns)
    figure = Figure(figsize=(9, 1.5 * rows + 0.6), layout="constrained") if figure is None else figure
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, squeeze=False)).ravel()
    lower, upper = np.rad2deg(chain.lower), np.rad2deg(chain.upper)
    for j, (axis, name) in enumerate(zip(axes, chain.joint_names, strict=False)):
        for low, high in arcs:
            axis.axvspan(low, high, color=_INSIDE, lw=1 if low == high else 0, zorder=0)
        # Another winding begins: no line across the picture.
        breaks = np.flatnonzero(np.abs(np.diff(q[:, j])) > _HALF_TURN) + 1
        _joint(
            axis,
            name,
            np.insert(degrees, breaks, np.nan),
            np.insert(q[:, j], breaks, np.nan),
            (lower[j], upper[j]),
        )
    text = "\n".join(
        (
            f"branch {_signs(chosen.signs)}",
            "green: all joint limits hold",
            "red: outside the limits of this joint",
            "white: another joint is outside",
        )
    )
    _finish_joints(axes, count, columns, "swivel (deg)", text)
    axes[0].set_xlim(-_HALF_TURN, _HALF_TURN)
    axes[0].set_xticks(range(-180, 181, 90))
    return figure


def swivel_band(
    arm: SrsArm, poses: ArrayLike, branch: Sequence[int], resolution: int = 720
) -> NDArray[np.bool_]:
    """Where the joint limits of one branch hold: `(N, resolution)` over swivels from -pi, from the exact intervals.

    Args:
        arm: The arm.
        poses: `(N, 4, 4)`.
        branch: Signs (shoulder, elbow, wrist).
        resolution: Number of swivels.
    """
    return _bands(arm, poses, [_index(branch)], resolution)[0, :, :]


def swivel(
    s: ArrayLike,
    angles: ArrayLike | None,
    band: ArrayLike,
    marks: Sequence[tuple[float, str]] = (),
    figure: FigureBase | None = None,
) -> FigureBase:
    """The swivel along the path on the band where the joint limits hold.

    Args:
        s: `(N,)` arc length, m.
        angles: `(N,)` swivel, rad; None where there is no plan.
        band: `(N, M)` from `swivel_band`.
        marks: Arc lengths (m) to mark, and what happens there.
        figure: Figure to draw into; a new one by default.
    """
    figure = Figure(figsize=(9, 3.2), layout="constrained") if figure is None else figure
    axis = figure.subplots()
    _swivel(axis, np.asarray(s, dtype=float), angles, np.asarray(band, dtype=bool), marks)
    axis.set_xlabel("along the path (m)", fontsize=9)
    axis.set_title(
        "swivel of the elbow (deg) on the band where all joint limits hold", fontsize=9, loc="left", pad=3
    )
    return figure


def swivel_map(
    arm: SrsArm,
    path: Path,
    plan: SwivelPlan | None = None,
    resolution: int = 360,
    figure: FigureBase | None = None,
) -> FigureBase:
    """Where the joint limits of each branch hold along a path, and the swivel that was chosen.

    Eight panels in branch order; on each the band against arc length, and the part of the plan that is on that branch.

    Args:
        arm: The arm; its chart defines the swivel.
        path: With orientations. For long paths about 600 points are drawn.
        plan: From `plan_swivel` with the same arm.
        resolution: Number of swivels of the band.
        figure: Figure to draw into; a new one by default.
    """
    shown = np.unique(np.linspace(0, len(path) - 1, min(len(path), _SHOWN)).round().astype(int))
    s = path.s[shown]
    bands = _bands(arm, path.poses[shown], range(8), resolution)
    figure = Figure(figsize=(9, 8), layout="constrained") if figure is None else figure
    axes = figure.subplots(4, 2, sharex=True, sharey=True)
    # A plan that ends early has fewer rows than the path has points.
    rows = shown[:0] if plan is None else shown[shown < len(plan)]
    marks = [] if plan is None else [(float(path.s[k]), "") for k in plan.reconfigurations]
    for index, axis in enumerate(axes.ravel()):
        signs = tuple(-1 if index & bit else 1 for bit in (4, 2, 1))
        angles = None
        if plan is not None and len(rows):
            here = (plan.branch[rows] == signs).all(axis=1)
            angles = np.where(here, plan.swivel[rows], np.nan) if here.any() else None
        _swivel(axis, s, angles, bands[index], marks)
        axis.set_title(f"branch {_signs(signs)}", fontsize=9, loc="left", pad=3)
    for axis in axes[-1]:
        axis.set_xlabel("along the path (m)", fontsize=9)
    for axis in axes[:, 0]:
        axis.set_ylabel("swivel (deg)", fontsize=9)
    return figure


def obstacle_map(
    arm: SrsArm,
    path: Path,
    plan: SwivelPlan,
    scene: Scene,
    link_radius: float | LinkGeometry = 0.05,
    resolution: int = 180,
    figure: FigureBase | None = None,
) -> FigureBase:
    """The plan on a map of path points and swivels, with what limits and obstacles forbid; below it the clearance.

    Args:
        arm: The arm.
        path: The path of the plan; for long paths about 300 points are drawn.
        plan: Has a row per path point, and a `clearance`.
        scene: The obstacles; moving ones are at their positions at the times of the path.
        link_radius: As for the plan, m; or the shapes of its links.
        resolution: Number of swivels.
        figure: Figure to draw into; a new one by default.
    """
    shown = np.unique(np.linspace(0, len(plan) - 1, min(len(plan), 300)).round().astype(int))
    band = _bands(arm, path.poses[shown], [_index(plan.branch[0])], resolution)[0]
    blocked = _blocked(arm, path, shown, _index(plan.branch[0]), scene, link_radius, resolution)
    figure = Figure(figsize=(9, 5.2), layout="constrained") if figure is None else figure
    above, below = figure.subplots(2, 1, height_ratios=(3, 1.4), sharex=True)
    s = path.s[shown]
    _swivel(above, s, None, band, [(float(path.s[k]), "") for k in plan.reconfigurations])
    if blocked.any():
        height = np.linspace(-_HALF_TURN, _HALF_TURN, resolution)
        above.contourf(s, height, blocked.T.astype(float), levels=(0.5, 1.5), colors=_BLOCKED)
    wrapped = (np.rad2deg(plan.swivel) + _HALF_TURN) % (2 * _HALF_TURN) - _HALF_TURN
    breaks = np.flatnonzero(np.abs(np.diff(wrapped)) > _HALF_TURN) + 1
    along = path.s[: len(wrapped)]
    above.plot(np.insert(along, breaks, np.nan), np.insert(wrapped, breaks, np.nan), color=_LINE, lw=1.8)
    above.set_title(
        "swivel (deg): limits hold on the band, obstacles block the red regions",
        fontsize=9,
        loc="left",
        pad=3,
    )
    clearance = np.zeros(0) if plan.clearance is None else plan.clearance
    below.plot(path.s[: len(clearance)], 1e3 * clearance, color=_LINE, lw=1.4)
    below.axhline(0.0, color=_BLOCKED, lw=1)
    below.set_title("distance from the obstacles (mm)", fontsize=9, loc="left", pad=3)
    below.set_xlabel("along the path (m)", fontsize=9)
    _plain(below)
    return figure


def _blocked(
    arm: SrsArm,
    path: Path,
    shown: NDArray[np.int64],
    branch: int,
    scene: Scene,
    link_radius: float | LinkGeometry,
    resolution: int,
) -> NDArray[np.bool_]:
    """Where a branch touches an obstacle, `(N, resolution)` over swivels from -pi."""
    swivels = np.linspace(-np.pi, np.pi, resolution)
    moves = path.t is not None and any(obstacle.velocity.any() for obstacle in scene.obstacles)
    rows = []
    for k in shown:
        poses = np.broadcast_to(path.poses[k], (resolution, 4, 4))
        q = arm.solve_batch(poses, swivels, limits=False).q[:, branch]
        here = scene.at(float(path.t[k])) if moves and path.t is not None else scene
        rows.append(here.clearance(arm.chain, q, link_radius).distance < 0.0)
    return np.array(rows)


def track(
    trajectory: Trajectory,
    chain: Chain,
    s: ArrayLike,
    angles: ArrayLike,
    band: ArrayLike,
    title: str = "",
) -> Figure:
    """Joints with their limits, and below them the swivel on its band.

    Args:
        trajectory: The motion.
        chain: The arm.
        s: `(N,)` arc length, m.
        angles: `(N,)` swivel, rad.
        band: `(N, M)` from `swivel_band`.
        title: Heading.
    """
    rows = -(-len(trajectory.joint_names) // 2)
    figure = Figure(figsize=(9, 1.5 * rows + 3.8), layout="constrained")
    parts = figure.subfigures(2, 1, height_ratios=(1.5 * rows, 3.0), squeeze=False)
    joints(trajectory, chain, parts[0, 0])
    swivel(s, angles, band, figure=parts[1, 0])
    if title:
        figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    return figure


def _index(branch: Sequence[int]) -> int:
    """Branch order from signs (shoulder, elbow, wrist)."""
    return sum(weight for weight, sign in zip((4, 2, 1), branch, strict=True) if sign < 0)


def _signs(branch: Sequence[int]) -> str:
    return "".join("+" if sign > 0 else "-" for sign in branch)


def _within_turn(intervals: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Intervals on the circle as pieces of [-pi, pi]."""
    pieces = []
    for lo, hi in intervals:
        pieces.append((float(lo), min(float(hi), np.pi)))
        if hi > np.pi:
            pieces.append((-np.pi, float(hi) - 2 * np.pi))
    return pieces


def _bands(arm: SrsArm, poses: ArrayLike, branches: Sequence[int], resolution: int) -> NDArray[np.bool_]:
    """`(len(branches), N, resolution)`: where the joint limits hold, over swivels from -pi."""
    poses = np.asarray(poses, dtype=float)
    grid = np.linspace(-np.pi, np.pi, resolution, endpoint=False)
    bands = np.zeros((len(branches), len(poses), resolution), dtype=bool)
    rows = {branch: row for row, branch in enumerate(branches)}
    owners, intervals = arm.intervals_batch(poses)
    for (pose, owner), (lo, hi) in zip(owners.tolist(), intervals, strict=True):
        if owner in rows:
            bands[rows[owner], pose] |= (grid - lo) % (2 * np.pi) <= hi - lo
    return bands


def _joint(
    axis: Axes, name: str, x: NDArray[np.float64], y: NDArray[np.float64], limits: tuple[float, float]
) -> None:
    """One joint, with the ranges that its limits forbid shaded."""
    lower, upper = limits
    low = lower if np.isfinite(lower) else min(-_HALF_TURN, np.nanmin(y))
    high = upper if np.isfinite(upper) else max(_HALF_TURN, np.nanmax(y))
    room = 0.12 * (high - low)
    bottom, top = min(low, np.nanmin(y)) - room, max(high, np.nanmax(y)) + room
    axis.set_ylim(bottom, top)
    if np.isfinite(lower):
        axis.axhspan(bottom, low, color=_OUTSIDE, lw=0)
    if np.isfinite(upper):
        axis.axhspan(high, top, color=_OUTSIDE, lw=0)
    axis.plot(x, y, color=_LINE, lw=1.6)
    axis.yaxis.set_major_locator(
        MultipleLocator(_HALF_TURN / 2 if top - bottom < 4 * _HALF_TURN else 2 * _HALF_TURN)
    )
    axis.set_title(f"{name} (deg)", fontsize=9, loc="left", pad=3)
    _plain(axis)


def _finish_joints(axes: NDArray[Any], count: int, columns: int, label: str, text: str) -> None:
    """The legend in the panel that is left over, the label of the common axis."""
    for axis in axes[count:]:
        axis.set_axis_off()
        axis.text(0.0, 0.5, text, fontsize=9, color="#555555", va="center", transform=axis.transAxes)
    for axis in axes[max(0, count - columns) : count]:
        axis.xaxis.set_tick_params(labelbottom=True)
    axes[count - 1].set_xlabel(label, fontsize=9)


def _swivel(
    axis: Axes,
    s: NDArray[np.float64],
    angles: ArrayLike | None,
    band: NDArray[np.bool_],
    marks: Sequence[tuple[float, str]],
) -> None:
    """The swivel on its band."""
    width = s[-1] - s[0] if s[-1] > s[0] else 1.0
    # Samples need not be evenly spaced: the nearest one colours each column.
    columns = np.linspace(s[0], s[0] + width, min(4 * len(s), 2000))
    nearest = np.clip(np.searchsorted(0.5 * (s[1:] + s[:-1]), columns), 0, len(s) - 1)
    axis.imshow(
        np.where(band[nearest].T[..., None], _colour(_INSIDE), _colour(_OUTSIDE)),
        extent=(s[0], s[0] + width, -_HALF_TURN, _HALF_TURN),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
    )
    if angles is not None:
        wrapped = (np.rad2deg(np.asarray(angles, dtype=float)) + _HALF_TURN) % (2 * _HALF_TURN) - _HALF_TURN
        # No line across the picture where the angle wraps.
        breaks = np.flatnonzero(np.abs(np.diff(wrapped)) > _HALF_TURN) + 1
        x, y = s[: len(wrapped)], wrapped
        axis.plot(np.insert(x, breaks, np.nan), np.insert(y, breaks, np.nan), color=_LINE, lw=1.8)
    for at, text in marks:
        axis.axvline(at, color=_EVENT, lw=1, ls="--")
        if text:
            axis.annotate(text, (at, 0.97 * _HALF_TURN), fontsize=8, color=_EVENT, va="top", rotation=90)
    axis.set_ylim(-_HALF_TURN, _HALF_TURN)
    axis.set_yticks(range(-180, 181, 90))
    _plain(axis)
    axis.grid(visible=False)


def _colour(text: str) -> NDArray[np.float64]:
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def _plain(axis: Axes) -> None:
    axis.tick_params(labelsize=8)
    axis.grid(color=_GRID, lw=0.6)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
