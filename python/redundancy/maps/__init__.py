"""Maps of what an arm can do: where the tool may go, with how much margin, and where the base should stand.

`best_margin` and `metrics` answer poses in the core. `capability` fills a store over a grid of positions and
directions, in this process or through Dask, `open` reads it, `place` finds placements of the base for a path. Stores
need the extra `maps` (`pip install 'redundancy[maps]'`); nothing of it is imported before it is used.
"""

import os

from redundancy.maps._job import CapabilityJob, capability
from redundancy.maps._map import CapabilityMap, Query
from redundancy.maps._metrics import METRICS, best_margin, metrics
from redundancy.maps._place import Placement, PlacementJob, place

__all__ = [
    "METRICS",
    "CapabilityJob",
    "CapabilityMap",
    "Placement",
    "PlacementJob",
    "Query",
    "best_margin",
    "capability",
    "metrics",
    "open",
    "place",
]


def open(path: str | os.PathLike[str]) -> CapabilityMap:  # noqa: A001 - the name of the operation
    """A map that `capability` made.

    Args:
        path: Folder of the store.

    Raises:
        RedundancyError: No store of a map, or one of another format.
        ModuleNotFoundError: The extra `maps` is missing.

    Example:
        >>> import redundancy as rd
        >>> rd.maps.open("map.zarr").query(pose).margin  # doctest: +SKIP
    """
    return CapabilityMap(path)
