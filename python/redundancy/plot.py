"""Figures of trajectories and self-motions: functions from data to `matplotlib.figure.Figure`, without global state.

Needs the extra `plot`. Angles in figures are in degrees.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MaxNLocator, MultipleLocator
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

# Blue against orange, which colour-blind readers tell apart; lines and words have a contrast of 4.5 or more with white.
_LINE = "#0b4f85"
_OUTSIDE = "#f3d3ad"
_INSIDE = "#cfe3f4"
_EVENT = "#a84300"
_BLOCKED = "#7d3200"
_GRID = "#dddddd"
PALETTE = ("#0072b2", "#a84300", "#007d5c", "#8a4f7d", "#8c6d00", "#24292f", "#3d8fc4", "#6b7280")
"""Colours of lines in one panel [Okabe, Ito], darkened for thin lines."""
_STYLES = ("-", "-", "-", "-", "--", "--", "--", "--")
_ROOM = 0.12
"""Room above and below the data, as a share of its range."""
_LEAST_RANGE = 4.0
"""Least height of a panel, degrees."""
_NEAR = 0.35
"""A limit within this share of the data's range is brought into view."""
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
            "blue: all joint limits hold",
            "orange: outside the limits of this joint",
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
    centre = None
    if plan is not None and len(rows):
        centre = float(np.mean(_turn(unwrapped(plan.swivel), None)))
    for index, axis in enumerate(axes.ravel()):
        signs = tuple(-1 if index & bit else 1 for bit in (4, 2, 1))
        angles = None
        if plan is not None and len(rows):
            here = (plan.branch[rows] == signs).all(axis=1)
            angles = np.where(here, plan.swivel[rows], np.nan) if here.any() else None
        _swivel(axis, s, angles, bands[index], marks, centre)
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
    line = unwrapped(plan.swivel)
    bottom, top = _turn(line, None)
    marks = [(float(path.s[k]), "") for k in plan.reconfigurations]
    _swivel(above, s, None, band, marks, centre=0.5 * (bottom + top))
    above.set_ylim(bottom, top)
    if blocked.any():
        height = np.linspace(-_HALF_TURN, _HALF_TURN, resolution)
        for turn in (-360.0, 0.0, 360.0):
            above.contourf(s, height + turn, blocked.T.astype(float), levels=(0.5, 1.5), colors=_BLOCKED)
    above.plot(path.s[: len(line)], line, color=_LINE, lw=1.8)
    above.set_title(
        "swivel (deg): limits hold on the band, obstacles block the brown regions",
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
    t: ArrayLike | None = None,
) -> Figure:
    """Joints with their limits, their speeds as shares of the limits, and the swivel on its band, all over time.

    Args:
        trajectory: The motion.
        chain: The arm.
        s: `(N,)` arc length of the samples of the swivel, m.
        angles: `(N,)` swivel, rad.
        band: `(N, M)` from `swivel_band`.
        title: Heading.
        t: `(N,)` times of the samples, s; those of the rows, or of as many evenly chosen ones, when left out.
    """
    rows, samples = -(-len(trajectory.joint_names) // 2), len(np.asarray(s))
    figure = Figure(figsize=(9, 1.5 * rows + 5.6), layout="constrained")
    parts = figure.subfigures(3, 1, height_ratios=(1.5 * rows, 1.9, 2.6), squeeze=False)
    joints(trajectory, chain, parts[0, 0])
    _speeds(parts[1, 0].subplots(), trajectory, chain)
    if t is None:
        t = trajectory.t[np.linspace(0, len(trajectory.t) - 1, samples).round().astype(int)]
    axis = parts[2, 0].subplots()
    _swivel(axis, np.asarray(t, dtype=float), angles, np.asarray(band, dtype=bool), ())
    axis.set_xlabel("time (s)", fontsize=9)
    axis.set_title(
        "swivel of the elbow (deg) on the band where all joint limits hold", fontsize=9, loc="left", pad=3
    )
    if title:
        figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    return figure


def _speeds(axis: Axes, trajectory: Trajectory, chain: Chain) -> None:
    """The speed of every joint as a share of its limit."""
    limits = chain.velocity_limit
    shares = np.abs(trajectory.qd) / np.where(np.isfinite(limits), limits, 1.0)
    for j, name in enumerate(trajectory.joint_names):
        label = name if np.isfinite(limits[j]) else f"{name} (rad/s)"
        colour, style = PALETTE[j % len(PALETTE)], _STYLES[j % len(_STYLES)]
        axis.plot(trajectory.t, shares[:, j], color=colour, ls=style, lw=1.3, label=label)
    top = float(shares.max()) if shares.size else 1.0
    axis.set_ylim(0.0, 1.1 * max(top, 1e-3))
    if top > 1.0 - _NEAR:
        axis.set_ylim(0.0, 1.1 * max(top, 1.0))
        axis.axhline(1.0, color=_EVENT, lw=1, ls="--")
    if len(trajectory.t) and trajectory.t[-1] > trajectory.t[0]:
        axis.set_xlim(trajectory.t[0], trajectory.t[-1])
    axis.set_title("joint speed / limit", fontsize=9, loc="left", pad=3)
    axis.legend(fontsize=7, ncols=8, loc="lower right", bbox_to_anchor=(1.0, 0.98), frameon=False)
    _plain(axis)


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
    """One joint; its limits, and what they forbid, where they are in view."""
    lower, upper = limits
    bottom, top = _view(y, limits)
    axis.set_ylim(bottom, top)
    for edge, end in ((lower, bottom), (upper, top)):
        if bottom <= edge <= top:
            axis.axhspan(min(edge, end), max(edge, end), color=_OUTSIDE, lw=0)
            axis.axhline(edge, color=_EVENT, lw=1, ls="--")
    if np.nanmin(y) < lower and lower > top:
        axis.axhspan(bottom, top, color=_OUTSIDE, lw=0)
    if np.nanmax(y) > upper and upper < bottom:
        axis.axhspan(bottom, top, color=_OUTSIDE, lw=0)
    axis.plot(x, y, color=_LINE, lw=1.6)
    axis.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 1.5, 2, 3, 5, 10]))
    axis.set_title(f"{name} (deg)", fontsize=9, loc="left", pad=3)
    _plain(axis)


def _view(y: NDArray[np.float64], limits: tuple[float, float]) -> tuple[float, float]:
    """The range of the data with room, extended to limits that are near."""
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    extent = max(high - low, _LEAST_RANGE)
    middle = 0.5 * (low + high)
    low, high = min(low, middle - 0.5 * extent), max(high, middle + 0.5 * extent)
    near = [edge for edge in limits if low - _NEAR * extent <= edge <= high + _NEAR * extent]
    return min([low, *near]) - _ROOM * extent, max([high, *near]) + _ROOM * extent


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
    centre: float | None = None,
) -> None:
    """The swivel, unwrapped, on its band: at least a turn, with the line in the middle."""
    width = s[-1] - s[0] if s[-1] > s[0] else 1.0
    # Samples need not be evenly spaced: the nearest one colours each column.
    columns = np.linspace(s[0], s[0] + width, min(4 * len(s), 2000))
    nearest = np.clip(np.searchsorted(0.5 * (s[1:] + s[:-1]), columns), 0, len(s) - 1)
    line = None if angles is None else unwrapped(angles)
    bottom, top = _turn(line, centre)
    picture = np.where(band[nearest].T[..., None], _colour(_INSIDE), _colour(_OUTSIDE))
    for turn in range(int(np.floor((bottom + _HALF_TURN) / 360.0)), int(np.ceil((top + _HALF_TURN) / 360.0))):
        axis.imshow(
            picture,
            extent=(s[0], s[0] + width, 360.0 * turn - _HALF_TURN, 360.0 * turn + _HALF_TURN),
            origin="lower",
            aspect="auto",
            interpolation="nearest",
        )
    if line is not None:
        axis.plot(s[: len(line)], line, color=_LINE, lw=1.8)
    for at, text in marks:
        axis.axvline(at, color=_EVENT, lw=1, ls="--")
        if text:
            axis.annotate(
                text, (at, top - 0.03 * (top - bottom)), fontsize=8, color=_EVENT, va="top", rotation=90
            )
    axis.set_xlim(s[0], s[0] + width)
    axis.set_ylim(bottom, top)
    axis.yaxis.set_major_locator(
        MultipleLocator(_HALF_TURN / 2 if top - bottom < 4 * _HALF_TURN else 2 * _HALF_TURN)
    )
    _plain(axis)
    axis.grid(visible=False)


def unwrapped(angles: ArrayLike) -> NDArray[np.float64]:
    """Angles (rad) in degrees without jumps of a turn; values that are not finite stay gaps."""
    out: NDArray[np.float64] = np.rad2deg(np.asarray(angles, dtype=float))
    good = np.isfinite(out)
    out[good] = np.unwrap(out[good], period=2 * _HALF_TURN)
    return out


def _turn(line: NDArray[np.float64] | None, centre: float | None) -> tuple[float, float]:
    """A turn around the middle of the line (or `centre`); more where the line needs it."""
    if line is None or not np.isfinite(line).any():
        middle = 0.0 if centre is None else centre
        return middle - _HALF_TURN, middle + _HALF_TURN
    low, high = float(np.nanmin(line)), float(np.nanmax(line))
    middle = 0.5 * (low + high) if centre is None else centre
    half = max(_HALF_TURN, 1.05 * max(high - middle, middle - low))
    return middle - half, middle + half


def _colour(text: str) -> NDArray[np.float64]:
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def _plain(axis: Axes) -> None:
    axis.tick_params(labelsize=8)
    axis.grid(color=_GRID, lw=0.6)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
