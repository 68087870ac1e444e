"""Figures of trajectories: data in, `matplotlib.figure.Figure` out, no global state.

Needs the extra `plot`. Angles are in degrees here, and only here and at the command line.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike, NDArray

from redundancy._core import Chain, SrsArm, Trajectory

__all__ = ["joints", "swivel", "swivel_band", "track"]

_LINE = "#1b5e8c"
_OUTSIDE = "#e8b4a8"
_INSIDE = "#cfe3d4"
_EVENT = "#b03a2e"
_GRID = "#dddddd"
_HALF_TURN = 180.0


def joints(trajectory: Trajectory, chain: Chain, figure: FigureBase | None = None) -> FigureBase:
    """Every joint over time, with the ranges that its limits forbid shaded.

    Args:
        trajectory: What the arm does; all joints turn.
        chain: The arm, for its limits.
        figure: Where to draw; a new figure when left out.
    """
    count = len(trajectory.joint_names)
    columns = 2 if count > 1 else 1
    rows = -(-count // columns)
    figure = Figure(figsize=(9, 1.5 * rows + 0.6), layout="constrained") if figure is None else figure
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, squeeze=False)).ravel()
    t, q = trajectory.t, np.rad2deg(trajectory.q)
    lower, upper = np.rad2deg(chain.lower), np.rad2deg(chain.upper)
    for j, (axis, name) in enumerate(zip(axes, trajectory.joint_names, strict=False)):
        low = lower[j] if np.isfinite(lower[j]) else min(-_HALF_TURN, q[:, j].min())
        high = upper[j] if np.isfinite(upper[j]) else max(_HALF_TURN, q[:, j].max())
        room = 0.12 * (high - low)
        axis.set_ylim(low - room, high + room)
        if np.isfinite(lower[j]):
            axis.axhspan(low - room, low, color=_OUTSIDE, lw=0)
        if np.isfinite(upper[j]):
            axis.axhspan(high, high + room, color=_OUTSIDE, lw=0)
        axis.plot(t, q[:, j], color=_LINE, lw=1.6)
        axis.yaxis.set_major_locator(
            MultipleLocator(_HALF_TURN / 2 if high - low < 4 * _HALF_TURN else 2 * _HALF_TURN)
        )
        axis.set_title(f"{name} (deg)", fontsize=9, loc="left", pad=3)
        _plain(axis)
    for axis in axes[count:]:
        axis.set_axis_off()
        axis.text(0.0, 0.5, "shaded: outside the joint limits", fontsize=9, color="#555555", va="center")
    for axis in axes[max(0, count - columns) : count]:
        axis.xaxis.set_tick_params(labelbottom=True)
    axes[count - 1].set_xlabel("time (s)", fontsize=9)
    axes[0].set_xlim(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0)
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
    poses = np.asarray(poses, dtype=float)
    index = sum(weight for weight, sign in zip((4, 2, 1), branch, strict=True) if sign < 0)
    grid = np.linspace(-np.pi, np.pi, resolution, endpoint=False)
    band = np.zeros((len(poses), resolution), dtype=bool)
    owners, intervals = arm.intervals_batch(poses)
    for (pose, owner), (lo, hi) in zip(owners, intervals, strict=True):
        if owner == index:
            band[pose] |= (grid - lo) % (2 * np.pi) <= hi - lo
    return band


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
        figure: Where to draw; a new figure when left out.
    """
    figure = Figure(figsize=(9, 3.2), layout="constrained") if figure is None else figure
    axis = figure.subplots()
    s, band = np.asarray(s, dtype=float), np.asarray(band, dtype=bool)
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
        axis.annotate(text, (at, 0.97 * _HALF_TURN), fontsize=8, color=_EVENT, va="top", rotation=90)
    axis.set_ylim(-_HALF_TURN, _HALF_TURN)
    axis.set_yticks(range(-180, 181, 90))
    axis.set_xlabel("along the path (m)", fontsize=9)
    axis.set_title(
        "swivel of the elbow (deg) on the band where all joint limits hold", fontsize=9, loc="left", pad=3
    )
    _plain(axis)
    axis.grid(visible=False)
    return figure


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
        trajectory: What the arm does.
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


def _colour(text: str) -> NDArray[np.float64]:
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def _plain(axis: Axes) -> None:
    axis.tick_params(labelsize=8)
    axis.grid(color=_GRID, lw=0.6)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
