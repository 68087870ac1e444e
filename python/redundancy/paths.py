"""Paths with an analytic curve between their samples."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundancy._core import Path, paths_circle, paths_raster

__all__ = ["circle", "raster"]


def circle(
    center: ArrayLike,
    radius: float,
    start: float = 0.0,
    turns: float = 1.0,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    orientation: ArrayLike | Callable[[NDArray[np.float64]], ArrayLike] | Any | None = None,
    n: int = 1000,
) -> Path:
    """A circle, an arc or several turns.

    The point at angle `phi` is `center + radius (cos phi e1 + sin phi e2)`; `(e1, e2)` is `(x, y)` rotated by the
    shortest rotation from z to the normal. The first point is at angle `start`, the last at `start + 2 pi turns`.

    Args:
        center: `(3,)`, m.
        radius: m.
        start: Angle of the first point, rad.
        turns: Number of turns; a negative number is clockwise, seen from the tip of the normal.
        normal: `(3,)`, of any length.
        orientation: `(3, 3)` or a pose: the same everywhere; `(n, 3, 3)`: one per sample; a callable from positions
            `(n, 3)` to rotations `(n, 3, 3)`; None: a path of positions.
        n: Number of samples, both ends included.

    Raises:
        RedundancyError: A radius that is not positive, no turns, a normal without length, fewer than two samples.

    Example:
        >>> import numpy as np
        >>> import redundancy as rd
        >>> path = rd.paths.circle((0.45, 0.0, 0.5), 0.12, orientation=np.diag([-1.0, 1.0, -1.0]))
        >>> len(path), round(path.length, 6)
        (1000, 0.753982)
    """
    return paths_circle(center, radius, start, turns, normal, orientation, n)


def raster(
    origin: ArrayLike,
    length: float,
    spacing: float,
    strokes: int,
    corner: float | None = None,
    orientation: ArrayLike | Callable[[NDArray[np.float64]], ArrayLike] | Any | None = None,
    step: float = 0.002,
    *,
    along: ArrayLike = (0.0, 1.0, 0.0),
    across: ArrayLike = (1.0, 0.0, 0.0),
) -> Path:
    """Parallel strokes, there and back, joined by U-turns that do not extend beyond their ends.

    A U-turn consists of two corners of 90 degrees with a straight line between them. A corner of arc length `Lc` has
    the curvature `pi/(2 Lc) (1 - cos(2 pi u / Lc))` and takes up `0.58440898690 Lc` of both lines that it joins.

    Args:
        origin: `(3,)` start of the first stroke, m.
        length: Length of a stroke with its corners, m.
        spacing: Distance of neighbouring strokes, m.
        strokes: Their number.
        corner: Arc length `Lc` of a corner, m; None for sharp corners, which are then samples.
        orientation: As in `circle`.
        step: Distance of samples along the path, m; the length is divided evenly.
        along: `(3,)` direction of the first stroke.
        across: `(3,)` direction from one stroke to the next, at a right angle to `along`.

    Raises:
        RedundancyError: Numbers that are not positive, corners that do not fit, directions not at a right angle.

    Example:
        >>> import redundancy as rd
        >>> path = rd.paths.raster((0.35, -0.25, -0.3), 0.5, 0.2, 3, corner=0.16752193)
        >>> len(path), round(path.length, 9)
        (894, 1.786877149)
    """
    return paths_raster(origin, length, spacing, strokes, corner, orientation, step, along, across)
