"""Rules that give a tool orientation from the position on the surface alone.

Each function returns a callable from positions `(N, 3)` (m, world frame, z normal to the surface) to rotations
`(N, 3, 3)`; `max_speed` takes it as `orientation_rule`. The surface (`center` and `half_extents` or `radius`, m) is by
default the one that encloses the positions of the call; if it is given, positions may be passed one at a time.
`orientation` `(3, 3)` is the nominal orientation of the tool; by default the tool axis (z) points down, `Ry(pi)`.
docs/painting.md has the formulas and what is assumed where the papers leave something open.
"""

from collections.abc import Sequence
from math import radians
from typing import Any, Literal

from numpy.typing import ArrayLike

from redundancy._core import OrientationRule

__all__ = [
    "barrier_cone",
    "barrier_spin",
    "barrier_two_cones",
    "constant",
    "pointing",
    "tilt_disc",
    "tilt_square",
]

Spin = Literal["pointing", "constant"]


def constant(*, orientation: ArrayLike | None = None) -> OrientationRule:
    """One orientation everywhere.

    Args:
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
    """
    return OrientationRule("constant", orientation=orientation)


def pointing(*, orientation: ArrayLike | None = None) -> OrientationRule:
    """The tool is rotated about its axis by `atan2(y, x)` [FromGravdahl2007, section 6].

    Args:
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
    """
    return OrientationRule("pointing", orientation=orientation)


def tilt_square(
    angle: float,
    spin: Spin = "pointing",
    *,
    orientation: ArrayLike | None = None,
    center: Sequence[float] | None = None,
    half_extents: Sequence[float] | None = None,
) -> OrientationRule:
    """The tool tilts by up to `angle` (rad) along x and along y, so that the wrist stays near the centre.

    [FromGravdahl2007, sections 7 and 8]: `Rx(e_y) Ry(-e_x)` with tilts proportional to the offset from the centre.

    Args:
        angle: Largest tilt, rad.
        spin: `"pointing"`: the tool is rotated about its axis as by `pointing`; `"constant"`: it is not.
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
        center: Centre of the surface (x, y), m; by default that of the positions.
        half_extents: Half the sides of the surface (x, y), m; by default those of the positions.
    """
    return OrientationRule(
        "tilt_square",
        angle=angle,
        spin=spin,
        orientation=orientation,
        center=center,
        half_extents=half_extents,
    )


def tilt_disc(
    angle: float,
    spin: Spin = "pointing",
    *,
    orientation: ArrayLike | None = None,
    center: Sequence[float] | None = None,
    radius: float | None = None,
) -> OrientationRule:
    """The tool tilts by up to `angle` (rad) towards its offset from the centre [FromGravdahl2007, section 8].

    Args:
        angle: Largest tilt, rad.
        spin: `"pointing"`: the tool is rotated about its axis as by `pointing`; `"constant"`: it is not.
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
        center: Centre of the surface (x, y), m; by default that of the positions.
        radius: Radius of the surface, m; by default that of the positions.
    """
    return OrientationRule(
        "tilt_disc", angle=angle, spin=spin, orientation=orientation, center=center, radius=radius
    )


def barrier_cone(
    beta: float = radians(20.0),
    alpha: float = radians(20.0),
    *,
    k_err: float = 1.0,
    k_tcp: float = 1.0,
    distance: float = 0.4,
    orientation: ArrayLike | None = None,
    center: Sequence[float] | None = None,
    half_extents: Sequence[float] | None = None,
) -> OrientationRule:
    """The best tool axis under two cone constraints, with unchanged spin: V1 of [FromGravdahl2009].

    Args:
        beta: Half-angle (rad) of the cone around the nominal tool axis.
        alpha: Half-angle (rad) of the cone around the direction from a point above the centre to the position.
        k_err: Weight of the first barrier.
        k_tcp: Weight of the second barrier.
        distance: Height (m) of that point above the centre.
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
        center: Centre of the surface (x, y), m; by default that of the positions.
        half_extents: Half the sides of the surface (x, y), m; by default those of the positions.
    """
    return _barrier("barrier_cone", beta, alpha, k_err, k_tcp, distance, orientation, center, half_extents)


def barrier_two_cones(
    beta: float = radians(20.0),
    alpha: float = radians(20.0),
    gamma: float = radians(60.0),
    *,
    k_err: float = 1.0,
    k_tcp: float = 1.0,
    k_x: float = 1.0,
    distance: float = 0.4,
    orientation: ArrayLike | None = None,
    center: Sequence[float] | None = None,
    half_extents: Sequence[float] | None = None,
) -> OrientationRule:
    """As `barrier_cone`, with another cone (`gamma`, `k_x`) for the tool's x axis: V2 of [FromGravdahl2009].

    Args:
        beta: Half-angle (rad) of the cone around the nominal tool axis.
        alpha: Half-angle (rad) of the cone around the direction from a point above the centre to the position.
        gamma: Half-angle (rad) of the cone for the tool's x axis.
        k_err: Weight of the first barrier.
        k_tcp: Weight of the second barrier.
        k_x: Weight of the barrier of the tool's x axis.
        distance: Height (m) of that point above the centre.
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
        center: Centre of the surface (x, y), m; by default that of the positions.
        half_extents: Half the sides of the surface (x, y), m; by default those of the positions.
    """
    return _barrier(
        "barrier_two_cones",
        beta,
        alpha,
        k_err,
        k_tcp,
        distance,
        orientation,
        center,
        half_extents,
        gamma=gamma,
        k_x=k_x,
    )


def barrier_spin(
    beta: float = radians(20.0),
    alpha: float = radians(20.0),
    *,
    k_err: float = 1.0,
    k_tcp: float = 1.0,
    distance: float = 0.4,
    orientation: ArrayLike | None = None,
    center: Sequence[float] | None = None,
    half_extents: Sequence[float] | None = None,
) -> OrientationRule:
    """The axis of `barrier_cone`, without twist relative to the orientation of `pointing`: V3 of [FromGravdahl2009].

    Args:
        beta: Half-angle (rad) of the cone around the nominal tool axis.
        alpha: Half-angle (rad) of the cone around the direction from a point above the centre to the position.
        k_err: Weight of the first barrier.
        k_tcp: Weight of the second barrier.
        distance: Height (m) of that point above the centre.
        orientation: Nominal orientation `(3, 3)` of the tool; by default `Ry(pi)`, the tool axis down.
        center: Centre of the surface (x, y), m; by default that of the positions.
        half_extents: Half the sides of the surface (x, y), m; by default those of the positions.
    """
    return _barrier("barrier_spin", beta, alpha, k_err, k_tcp, distance, orientation, center, half_extents)


def _barrier(
    kind: str,
    beta: float,
    alpha: float,
    k_err: float,
    k_tcp: float,
    distance: float,
    orientation: ArrayLike | None,
    center: Sequence[float] | None,
    half_extents: Sequence[float] | None,
    gamma: float | None = None,
    k_x: float | None = None,
) -> OrientationRule:
    return OrientationRule(
        kind,
        beta=beta,
        alpha=alpha,
        k_err=k_err,
        k_tcp=k_tcp,
        distance=distance,
        orientation=orientation,
        center=center,
        half_extents=half_extents,
        gamma=gamma,
        k_x=k_x,
    )


def _make(kind: str, given: dict[str, Any]) -> OrientationRule:
    """Inverse of pickling."""
    return OrientationRule(kind, **given)
