"""Slices of a capability map: which cells are shown, and with which values; no browser."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundancy as rd
from redundancy.explorer.arm import Array
from redundancy.explorer.model import RefusedError, finite

AXES = ("x", "y", "z")
SHARES = ("reachable", "proven")
"""Metrics that are verdicts: their share of all directions is shown."""
UNITS = {"margin": "rad", "swivel_measure": "rad", "manipulability": "", "spin_share": "", "clearance": "m"}
SAME_ARM = 1e-9
"""Largest difference of two arms' tools at the same joints, and of their limits, m and rad."""
MOST_POINTS = 200_000
"""Points of a slice at most: a browser cannot draw any number of them."""


@dataclass(frozen=True)
class Layer:
    """One value per cell."""

    name: str
    unit: str
    values: Array
    """`(nx, ny, nz)`; NaN in cells that are not shown."""
    low: float
    high: float
    """Least and largest value of the cells that are shown, over all slices."""


class MapModel:
    """A capability map, a layer of it, and a slice.

    A cell is reached when a direction of the tool is reached within the joint limits there. Cells that are not are left
    out, and so are those of chunks that are not done.

    Args:
        chain: The arm of the page.
        found: A map of the same arm, or None.

    Raises:
        RefusedError: The map is of another arm.
    """

    def __init__(self, chain: rd.Chain, found: Any = None) -> None:
        self.found = found
        self.layers: dict[str, Layer] = {}
        self.layer, self.axis, self.index = "", 1, 0
        if found is None:
            return
        check_arm(chain, found.chain)
        self.shape: tuple[int, int, int] = found.shape
        self.places: Array = found.positions.reshape(*self.shape, 3)
        self.reached: NDArray[np.bool_] = np.zeros(self.shape, dtype=bool)
        self._read()
        if not self.layers:
            raise RefusedError(f"the map has none of the metrics that are shown: {', '.join(found.metrics)}")
        self.layer = next(iter(self.layers))
        self.cut("y", self.middle(1))

    # --- what a user does ---------------------------------------------------------------------------------

    def choose(self, layer: str) -> None:
        """What is shown."""
        if layer not in self.layers:
            raise RefusedError(f"the map has no layer '{layer[:40]}': {', '.join(self.layers)}")
        self.layer = layer

    def cut(self, axis: str, at: float) -> None:
        """The slice across an axis that is nearest to a coordinate, m."""
        if axis not in AXES:
            raise RefusedError(f"there is no axis '{axis}': x, y or z")
        value, k = float(finite(at, (), "the place of the slice")), AXES.index(axis)
        self.axis, self.index = k, int(np.argmin(np.abs(self.levels(k) - value)))

    # --- what follows -------------------------------------------------------------------------------------

    def levels(self, axis: int) -> Array:
        """Coordinates of the slices across an axis, m."""
        cell: list[Any] = [0, 0, 0]
        cell[axis] = slice(None)
        out: Array = self.places[(*cell, axis)]
        return out

    def middle(self, axis: int) -> float:
        """The coordinate of the middle slice, m."""
        levels = self.levels(axis)
        return float(levels[len(levels) // 2])

    @property
    def at(self) -> float:
        """The coordinate of the slice, m."""
        return float(self.levels(self.axis)[self.index])

    @property
    def spacing(self) -> float:
        """Distance of neighbouring cells, m."""
        return float(self.found.settings["spacing"])

    def cells(self) -> tuple[Array, Array]:
        """The reached cells of the slice: positions `(N, 3)`, m, and values `(N,)`."""
        here: list[Any] = [slice(None)] * 3
        here[self.axis] = self.index
        values, places = self.layers[self.layer].values[tuple(here)], self.places[tuple(here)]
        shown = np.isfinite(values)
        if int(shown.sum()) > MOST_POINTS:
            raise RefusedError(
                f"the slice has {int(shown.sum())} reached cells, at most {MOST_POINTS} are drawn"
            )
        return places[shown], values[shown]

    def words(self) -> str:
        """What the slice is, in a sentence."""
        if self.found is None:
            return "no map: make one with `redundancy map`, and start with --map, or capability= in Python"
        total = int(np.prod(self.shape)) // self.shape[self.axis]
        done, chunks = int(self.found.done.sum()), len(self.found.done)
        words = f"{len(self.cells()[0])} of {total} cells of this slice are reached within the joint limits"
        return (
            words
            if done == chunks
            else f"{words}; {chunks - done} of {chunks} chunks of the map are not done"
        )

    # --- inside -------------------------------------------------------------------------------------------

    def _read(self) -> None:
        """All layers in one pass over the chunks, so that a large map is never in memory as a whole."""
        found = self.found
        cells = int(np.prod(self.shape))
        kept: dict[str, Array] = {}
        reached = np.zeros(cells, dtype=bool)
        for chunk in np.flatnonzero(found.done):
            rows = found.rows(int(chunk))
            values = found.chunk(int(chunk))
            good = self._good(values)
            reached[rows] = good.any(axis=1)
            for name, row in reduced(values, good).items():
                kept.setdefault(name, np.full(cells, np.nan))[rows] = row
        self.reached = reached.reshape(self.shape)
        for name, layer in kept.items():
            layer[~reached] = np.nan
            seen = layer[np.isfinite(layer)]
            low, high = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 0.0)
            unit = UNITS.get(name.split(":")[0], "")
            self.layers[name] = Layer(name, unit, layer.reshape(self.shape), low, high)

    def _good(self, values: dict[str, Any]) -> NDArray[np.bool_]:
        """Which directions are reached within the limits."""
        if "reachable" in values:
            return np.asarray(values["reachable"], dtype=bool)
        if "margin" in values:
            return np.asarray(values["margin"]) >= 0.0
        raise RefusedError(
            "the map has neither 'reachable' nor 'margin': which cells are reached is not known"
        )


def reduced(values: dict[str, Any], good: NDArray[np.bool_]) -> dict[str, Array]:
    """One value per cell of each layer `(cells,)`: shares of all directions, best and mean of those in reach."""
    out: dict[str, Array] = {}
    count = np.maximum(good.sum(axis=1), 1)
    for name, stored in values.items():
        rows = np.asarray(stored, dtype=float)
        if name in SHARES:
            out[f"{name}: share of the directions"] = rows.mean(axis=1)
            continue
        out[f"{name}: best direction"] = np.where(good, rows, -np.inf).max(axis=1)
        out[f"{name}: mean of the reached directions"] = np.where(good, rows, 0.0).sum(axis=1) / count
    return out


def check_arm(chain: rd.Chain, other: rd.Chain) -> None:
    """That a map is of the arm of the page, at the same place and with the same tool.

    Raises:
        RefusedError: It is not; the message says what differs.
    """
    if other.dof != chain.dof:
        raise RefusedError(
            f"the map is of '{other.name}' with {other.dof} joints, this arm '{chain.name}' has {chain.dof}"
        )
    limits = np.allclose(other.lower, chain.lower, rtol=0.0, atol=SAME_ARM) and np.allclose(
        other.upper, chain.upper, rtol=0.0, atol=SAME_ARM
    )
    if not limits:
        raise RefusedError(f"the map is of '{other.name}' with other joint limits than this arm's")
    rows = np.random.default_rng(0).uniform(-1.0, 1.0, (5, chain.dof))
    apart = float(np.abs(other.forward(rows) - chain.forward(rows)).max())
    if apart > SAME_ARM:
        raise RefusedError(
            f"the map is of '{other.name}' whose tool is elsewhere at the same joints (by {apart:.3g}): "
            "another arm, base or tool"
        )
