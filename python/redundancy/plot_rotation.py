"""Figures of sets of orientations. Needs the extra `plot`."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure, FigureBase
from numpy.typing import NDArray

from redundancy._core import QuaternionVolume

__all__ = ["quaternion_volume"]

_DOTS = "#1b5e8c"
_BALL = "#bbbbbb"


def quaternion_volume(
    volume: QuaternionVolume, n: int = 2000, seed: int = 0, figure: FigureBase | None = None
) -> FigureBase:
    """A volume and its visualising volume in the ball, as figure 1 of [FromGravdahl2007].

    Left: the vector parts of members. Right: those of their visualising quaternions, whose direction is that of the
    rotated last axis and whose length tells the rotation about it. Of `Q` and `-Q` the one with the scalar part
    >= 0 is drawn.

    Args:
        volume: The set.
        n: How many members are drawn.
        seed: Of the sample.
        figure: Figure to draw into; a new one by default.
    """
    figure = Figure(figsize=(9, 4.5), layout="constrained") if figure is None else figure
    members = volume.sample(n, seed=seed)
    for place, title, q in (
        (121, "quaternion volume", members),
        (122, "visualising quaternion volume", volume.visualising(members)),
    ):
        axes: Any = figure.add_subplot(place, projection="3d")  # matplotlib has no types for its 3d axes
        _ball(axes)
        x, y, z = _vectors(q).T
        axes.scatter(x, y, z, s=2, color=_DOTS, alpha=0.5, linewidths=0)
        axes.set(title=title, xlabel="x", ylabel="y", zlabel="z")
    return figure


def _vectors(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vector parts on the side of the double cover whose scalar part is not negative."""
    return q[:, 1:] * np.where(q[:, :1] < 0, -1.0, 1.0)


def _ball(axes: Any) -> None:
    """Outline of the unit ball: three great circles."""
    t = np.linspace(0, 2 * np.pi, 121)
    zero = np.zeros_like(t)
    for x, y, z in ((np.cos(t), np.sin(t), zero), (np.cos(t), zero, np.sin(t)), (zero, np.cos(t), np.sin(t))):
        axes.plot(x, y, z, color=_BALL, linewidth=0.7)
    axes.set_box_aspect((1, 1, 1))
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
