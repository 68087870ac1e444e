"""Figures of a painting motion: torques against their limits, tilt and spin, the path from above."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from redundancy._core import Chain, MaxSpeed

__all__ = ["orientation", "path_from_above", "speeds", "torques", "torques_at_speed", "torques_of_rules"]

_LINE = "#1b5e8c"
_SECOND = "#c8792a"
_LIMIT = "#b03a2e"
_QUIET = "#9aa5ad"
_GRID = "#dddddd"
_ARROWS = 60
"""Tool axes that the view from above shows."""


def torques(
    s: ArrayLike,
    used: ArrayLike,
    limits: ArrayLike,
    names: Sequence[str],
    before: tuple[ArrayLike, ArrayLike] | None = None,
) -> Figure:
    """The torque of every joint over arc length, with its limits.

    Args:
        s: Arc length `(N,)`, m.
        used: Torques `(N, n)`, N m.
        limits: Their limits `(n,)`; infinite for none.
        names: The joints.
        before: Arc length and torques to compare with, drawn quietly.
    """
    s, used, limits = np.asarray(s), np.asarray(used), np.asarray(limits)
    count = len(names)
    rows = -(-count // 2)
    figure = Figure(figsize=(9, 1.6 * rows + 0.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, 2, sharex=True, squeeze=False)).ravel()
    for j, axis in enumerate(axes):
        if j >= count:
            axis.set_visible(False)
            continue
        if before is not None:
            axis.plot(np.asarray(before[0]), np.asarray(before[1])[:, j], color=_QUIET, lw=0.9)
        axis.plot(s, used[:, j], color=_LINE, lw=1.2)
        if np.isfinite(limits[j]):
            axis.axhline(limits[j], color=_LIMIT, lw=0.9, ls="--")
            axis.axhline(-limits[j], color=_LIMIT, lw=0.9, ls="--")
        axis.set_title(names[j], fontsize=9, loc="left")
        axis.set_ylabel("N m", fontsize=8)
        _plain(axis)
    for axis in axes[max(0, count - 2) : count]:
        axis.set_xlabel("arc length (m)", fontsize=8)
    return figure


def torques_at_speed(chain: Chain, found: MaxSpeed, speed: float) -> NDArray[np.float64]:
    """Joint torques over the path of `found` at another constant speed: `G + v^2 D`, without friction.

    Args:
        chain: The arm, as given to `max_speed`.
        found: What `max_speed` gave.
        speed: Constant tool speed, m/s, >= 0.

    Returns:
        `(N, n)`, N m.

    Raises:
        ValueError: A speed that is negative or not finite.
    """
    if not (np.isfinite(speed) and speed >= 0.0):
        raise ValueError(f"speed is {speed}, it must be finite and at least 0 m/s")
    still = np.zeros_like(found.q)
    gravity = np.asarray(chain.inverse_dynamics(found.q, still, still))
    return np.asarray(gravity + (speed / found.speed) ** 2 * (found.torques - gravity))


def torques_of_rules(
    chain: Chain,
    s: ArrayLike,
    results: Mapping[str, MaxSpeed],
    speed: float,
    joints: Sequence[int] = (0, 1),
) -> Figure:
    """Torques of some joints at one constant speed for several rules, as figure 3 of [FromGravdahl2009].

    Args:
        chain: The arm, as given to `max_speed`.
        s: Arc length of the path's points `(N,)`, m.
        results: What `max_speed` gave, by the name of the rule.
        speed: Constant tool speed, m/s.
        joints: Which joints, from 0; one row each, limits dashed.
    """
    figure = Figure(figsize=(9, 2.6 * len(joints) + 0.4), layout="constrained")
    rows = np.atleast_1d(figure.subplots(len(joints), 1, sharex=True))
    used = {name: torques_at_speed(chain, found, speed) for name, found in results.items()}
    for axis, joint in zip(rows, joints, strict=True):
        for name, values in used.items():
            axis.plot(np.asarray(s), values[:, joint], lw=1.1, label=name)
        limit = chain.effort_limit[joint]
        if np.isfinite(limit):
            for side in (-limit, limit):
                axis.axhline(side, color=_LIMIT, lw=0.9, ls="--")
        axis.set_title(f"{chain.joint_names[joint]} at {speed:g} m/s", fontsize=9, loc="left")
        axis.set_ylabel("N m", fontsize=8)
        _plain(axis)
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside upper center", ncols=4)
    rows[-1].set_xlabel("arc length (m)", fontsize=8)
    return figure


def orientation(s: ArrayLike, tilt: ArrayLike, spin: ArrayLike, half_angle: float | None = None) -> Figure:
    """Tilt and spin over arc length.

    Args:
        s: Arc length `(N,)`, m.
        tilt: Angle between the tool axis and that of the path `(N,)`, rad.
        spin: Angle about the tool axis `(N,)`, rad.
        half_angle: The cone, rad.
    """
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(s, np.rad2deg(tilt), color=_LINE, lw=1.2)
    if half_angle is not None:
        above.axhline(np.rad2deg(half_angle), color=_LIMIT, lw=0.9, ls="--")
    above.set_ylabel("tilt (deg)", fontsize=8)
    below.plot(s, np.rad2deg(spin), color=_SECOND, lw=1.2)
    below.set_ylabel("spin (deg)", fontsize=8)
    below.set_xlabel("arc length (m)", fontsize=8)
    for axis in (above, below):
        _plain(axis)
    return figure


def path_from_above(positions: ArrayLike, axes: ArrayLike) -> Figure:
    """The path seen along -z, with the horizontal part of the tool axis.

    Args:
        positions: `(N, 3)`, m.
        axes: Unit vectors of the tool axis `(N, 3)`.
    """
    p, z = np.asarray(positions), np.asarray(axes)
    figure = Figure(figsize=(7, 5.2), layout="constrained")
    axis = figure.subplots()
    axis.plot(p[:, 1], p[:, 0], color=_LINE, lw=1.4)
    shown = np.unique(np.linspace(0, len(p) - 1, min(len(p), _ARROWS)).round().astype(int))
    axis.quiver(
        p[shown, 1],
        p[shown, 0],
        z[shown, 1],
        z[shown, 0],
        color=_SECOND,
        angles="xy",
        scale=6.0,
        width=0.003,
    )
    axis.plot(p[0, 1], p[0, 0], "o", color=_LINE, ms=5)
    axis.set_xlabel("y (m)", fontsize=8)
    axis.set_ylabel("x (m)", fontsize=8)
    axis.set_aspect("equal")
    axis.set_title("path from above; arrows: horizontal part of the tool axis", fontsize=9, loc="left")
    _plain(axis)
    return figure


def speeds(names: Sequence[str], values: NDArray[np.float64]) -> Figure:
    """Highest constant speed of every choice, m/s."""
    figure = Figure(figsize=(7, 0.34 * len(names) + 0.9), layout="constrained")
    axis = figure.subplots()
    where = np.arange(len(names))[::-1]
    axis.barh(where, values, color=_LINE, height=0.65)
    axis.set_yticks(where, names)
    for y, value in zip(where, values, strict=True):
        axis.text(value, y, f" {value:.3f}", va="center", fontsize=8)
    axis.set_xlabel("constant tool speed (m/s)", fontsize=8)
    axis.margins(x=0.12)
    _plain(axis)
    return figure


def _plain(axis: Axes) -> None:
    axis.tick_params(labelsize=8)
    axis.grid(color=_GRID, lw=0.6)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
