"""Reading a map."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundancy import _core
from redundancy._core import RedundancyError
from redundancy.maps._metrics import metrics
from redundancy.maps._store import Store

__all__ = ["CapabilityMap", "Query"]


@dataclass(frozen=True)
class Query:
    """What the core found for some poses; arrays `(N,)`, those that were not asked for are `None`."""

    reachable: NDArray[np.bool_] | None = None
    margin: NDArray[np.float64] | None = None
    proven: NDArray[np.bool_] | None = None
    swivel_measure: NDArray[np.float64] | None = None
    manipulability: NDArray[np.float64] | None = None
    spin_share: NDArray[np.float64] | None = None
    clearance: NDArray[np.float64] | None = None


class CapabilityMap:
    """A store of `capability`: its settings, its statistics, its slices, and exact answers for any pose."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._store = Store(path)
        self.path = self._store.path
        self.chain: _core.Chain = self._store.chain()
        """The arm that the map is of."""
        self.metrics = self._store.metrics
        self.settings: dict[str, Any] = self._store.provenance["settings"]

    def __repr__(self) -> str:
        """Arm, grid and how much is done."""
        grid = self._store.grid
        poses = grid.positions * grid.orientations
        return (
            f"CapabilityMap('{self.path}', {self.chain.name}, {poses} poses, "
            f"{int(self.done.sum())} of {grid.chunks} chunks done)"
        )

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which chunks `(chunks,)` are done."""
        return self._store.done()

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions `(P, 3)` in the world, m."""
        return self._store.grid.places(slice(0, self._store.grid.positions))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of positions along x, y, z; positions are in C order."""
        return self._store.grid.shape

    def poses(self, chunk: int) -> NDArray[np.float64]:
        """Poses `(positions * orientations, 4, 4)` of a chunk, in the order of its values."""
        return self._store.grid.poses(self._store.grid.rows(chunk))

    def rows(self, chunk: int) -> slice:
        """The positions of a chunk."""
        return self._store.grid.rows(chunk)

    def chunk(self, chunk: int) -> dict[str, NDArray[Any]]:
        """Stored values `(positions, orientations)` of a chunk by metric."""
        return self._store.data(chunk)

    def damaged(self) -> list[int]:
        """Chunks that are done and differ from their checksum; `capability(..., verify=True)` repairs them."""
        return [int(k) for k in np.flatnonzero(self.done) if not self._store.is_intact(int(k))]

    def share(self, metric: str = "reachable") -> NDArray[np.float64]:
        """Mean `(nx, ny, nz)` of a metric over the orientations at each position."""
        if metric not in self.metrics:
            raise RedundancyError(f"the map has no '{metric}', it has {', '.join(self.metrics)}")
        grid = self._store.grid
        mean = np.zeros(grid.positions)
        for k in range(grid.chunks):
            rows = grid.rows(k)
            values = np.asarray(self._store.group[metric][rows], dtype=float)
            mean[rows] = np.where(np.isfinite(values), values, 0.0).mean(axis=1)
        return mean.reshape(grid.shape)

    def best(self, metric: str = "margin") -> NDArray[np.float64]:
        """Largest value `(nx, ny, nz)` of a metric over the orientations at each position."""
        if metric not in self.metrics:
            raise RedundancyError(f"the map has no '{metric}', it has {', '.join(self.metrics)}")
        values: NDArray[np.float64] = np.asarray(self._store.group[metric][:], dtype=float)
        most: NDArray[np.float64] = values.max(axis=1)
        return most.reshape(self._store.grid.shape)

    @property
    def reach_share(self) -> float:
        """The share of all poses that the arm reaches within its limits."""
        return float(self.share("reachable").mean())

    def query(self, poses: ArrayLike, *, threads: int | None = None) -> Query:
        """What the map holds, for any poses: evaluated by the core, exact, not looked up.

        Freedom of the tool, scene and links are those that the map was made with.

        Args:
            poses: Poses `(N, 4, 4)` or `(4, 4)` in the world, m.
            threads: Threads to use; all cores by default.

        Returns:
            Arrays `(N,)`, one for each metric of the map.

        Raises:
            RedundancyError: A pose that is not rigid or finite.
        """
        return Query(**metrics(self.chain, poses, self.metrics, threads=threads, **self._store.question()))
