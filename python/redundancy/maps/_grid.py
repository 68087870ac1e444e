"""The poses of a map: a grid of positions, directions of equal area, spins about them."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundancy import _core

__all__ = ["Grid", "directions_of_equal_area", "reach_of"]

_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
_SAME_PLACE = 1e-9
"""Distance (m) by which a joint may move in a few random configurations and still stand still."""


def directions_of_equal_area(count: int) -> NDArray[np.float64]:
    """Unit vectors `(count, 3)` on a spiral, each in the middle of a band of the same area (Fibonacci lattice)."""
    k = np.arange(count)
    z = 1.0 - (2.0 * k + 1.0) / count
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(_GOLDEN_ANGLE * k), radius * np.sin(_GOLDEN_ANGLE * k), z], axis=1)


def rotations_to(directions: NDArray[np.float64], spins: int) -> NDArray[np.float64]:
    """Rotations `(N * spins, 3, 3)` whose z axis is each direction, by the shortest turn, then spun about it."""
    x, y, z = directions.T
    c = np.where(z > -0.5, 1.0 / np.maximum(1.0 + z, 1e-3), 0.0)
    turned = np.zeros((len(directions), 3, 3))
    turned[:, 0, 0], turned[:, 1, 1] = 1.0 - x * x * c, 1.0 - y * y * c
    turned[:, 0, 1] = turned[:, 1, 0] = -x * y * c
    turned[:, 0, 2], turned[:, 1, 2], turned[:, 2, 2] = x, y, z
    turned[:, 2, 0], turned[:, 2, 1] = -x, -y
    # Downwards the shortest turn is not defined: half a turn about x first, then the shortest turn from -z.
    c = 1.0 / np.maximum(1.0 - z, 1e-3)
    flipped = np.zeros_like(turned)
    flipped[:, 0, 0], flipped[:, 1, 0], flipped[:, 2, 0] = 1.0 - x * x * c, -x * y * c, x
    flipped[:, 0, 1], flipped[:, 1, 1], flipped[:, 2, 1] = x * y * c, -1.0 + y * y * c, -y
    flipped[:, 0, 2], flipped[:, 1, 2], flipped[:, 2, 2] = x, y, z
    base = np.where((z > -0.5)[:, None, None], turned, flipped)
    angle = 2.0 * math.pi * np.arange(spins) / spins
    spin = np.zeros((spins, 3, 3))
    spin[:, 0, 0] = spin[:, 1, 1] = np.cos(angle)
    spin[:, 1, 0], spin[:, 0, 1], spin[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    turned = np.asarray(np.einsum("dij,sjk->dsik", base, spin), dtype=np.float64)
    rotations: NDArray[np.float64] = turned.reshape(-1, 3, 3)
    return rotations


def reach_of(chain: _core.Chain) -> tuple[NDArray[np.float64], float]:
    """A point `(3,)` of the arm that stands still, and a distance (m) from it that the tip never exceeds."""
    rng = np.random.default_rng(0)
    lower, upper = np.maximum(chain.lower, -math.pi), np.minimum(chain.upper, math.pi)
    drawn = [lower + (upper - lower) * share for share in rng.random((5, chain.dof))]

    def origins(q: NDArray[np.float64]) -> NDArray[np.float64]:
        frames = [chain.forward(q, link=name) for name in chain.link_names]
        return np.array([frame[:3, 3] for frame in [*frames, chain.forward(q)]])

    places = np.array([origins(q) for q in drawn])
    # A sliding joint makes lengths vary: the longest that was seen, and all its range beside it.
    lengths = np.linalg.norm(np.diff(places, axis=1), axis=2)
    varies = bool(np.any(np.ptp(lengths, axis=0) > _SAME_PLACE))
    still = np.ptp(places, axis=0).max(axis=1) <= _SAME_PLACE
    first = int(np.flatnonzero(still)[-1]) if still.any() else 0
    reach = float(lengths.max(axis=0)[first:].sum())
    if varies:
        wide = upper - lower
        reach += float(np.sum(wide[np.isfinite(wide)]))
    return places[0, first], reach


@dataclasses.dataclass(frozen=True)
class Grid:
    """Positions `(P, 3)` in C order over `shape`, times orientations `(D * spins)`, cut into chunks of positions."""

    origin: tuple[float, float, float]
    spacing: float
    shape: tuple[int, int, int]
    directions: int
    spins: int
    chunk: int

    @classmethod
    def around(
        cls,
        chain: _core.Chain,
        spacing: float,
        directions: int,
        spins: int,
        region: Any,
        chunk_poses: int,
    ) -> "Grid":
        """The grid over a region, or over all that the arm may reach."""
        if region is None:
            center, reach = reach_of(chain)
            steps = math.ceil(reach / spacing)
            origin = center - spacing * steps
            shape = (2 * steps + 1,) * 3
        else:
            bounds = np.asarray(region, dtype=float)
            if (
                bounds.shape != (3, 2)
                or not np.all(np.isfinite(bounds))
                or np.any(bounds[:, 1] < bounds[:, 0])
            ):
                message = f"region is {region!r}, expected ((x0, x1), (y0, y1), (z0, z1)) in m, ascending"
                raise _core.RedundancyError(message)
            origin = bounds[:, 0]
            x, y, z = (int(n) for n in np.floor(np.ptp(bounds, axis=1) / spacing + 1e-9) + 1)
            shape = (x, y, z)
        positions = shape[0] * shape[1] * shape[2]
        per_position = directions * spins
        chunk = max(1, min(chunk_poses // per_position, math.ceil(positions / 16)))
        x0, y0, z0 = (float(v) for v in origin)
        return cls((x0, y0, z0), spacing, shape, directions, spins, chunk)

    @property
    def positions(self) -> int:
        """Number of positions."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    @property
    def orientations(self) -> int:
        """Number of orientations at each position."""
        return self.directions * self.spins

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return math.ceil(self.positions / self.chunk)

    def rows(self, chunk: int) -> slice:
        """The positions of a chunk."""
        return slice(chunk * self.chunk, min(self.positions, (chunk + 1) * self.chunk))

    def places(self, rows: slice) -> NDArray[np.float64]:
        """Positions `(P, 3)` of some rows, m."""
        index = np.stack(np.unravel_index(np.arange(rows.start, rows.stop), self.shape), axis=1)
        places: NDArray[np.float64] = np.asarray(self.origin) + self.spacing * index
        return places

    def poses(self, rows: slice) -> NDArray[np.float64]:
        """Poses `(P * orientations, 4, 4)` of some rows."""
        places = self.places(rows)
        rotations = rotations_to(directions_of_equal_area(self.directions), self.spins)
        poses = np.zeros((len(places), self.orientations, 4, 4))
        poses[:, :, :3, :3] = rotations
        poses[:, :, :3, 3] = places[:, None]
        poses[:, :, 3, 3] = 1.0
        return poses.reshape(-1, 4, 4)
