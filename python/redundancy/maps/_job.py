"""Filling a store: in this process, or through Dask."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundancy import _core
from redundancy._core import RedundancyError
from redundancy.maps._grid import Grid
from redundancy.maps._map import CapabilityMap
from redundancy.maps._metrics import METRICS, metrics
from redundancy.maps._progress import Progress, Report
from redundancy.maps._store import (
    FORMAT,
    Store,
    chain_to_text,
    differences,
    digest,
    import_zarr,
    links_to_text,
)
from redundancy.status import Status

__all__ = ["CapabilityJob", "capability"]

CHUNK_POSES = 100_000
"""Poses of a chunk: about a second of work, some 15 MB of memory while it is computed."""


@dataclass(frozen=True)
class CapabilityJob:
    """What a call of `capability` did."""

    path: Path
    status: Status
    """`converged` when every chunk is done, else `cancelled` (Ctrl-C) or `time_limit`."""
    chunks: int
    computed: int
    """Chunks that this call computed."""
    kept: int
    """Chunks that were done before."""
    poses: int
    """Poses that this call computed."""
    seconds: float

    @property
    def rate(self) -> float:
        """Poses per second of this call."""
        return self.poses / self.seconds if self.seconds > 0 else 0.0

    def open(self) -> CapabilityMap:
        """The map."""
        return CapabilityMap(self.path)


@dataclass(frozen=True)
class _Work:
    """What is needed to compute a chunk, on any machine that sees the store."""

    path: str
    chain: _core.Chain
    metrics: tuple[str, ...]
    freedom: _core.ToolFreedom | None
    scene: _core.Scene | None
    links: _core.LinkGeometry | None
    threads: int | None

    def compute(self, grid: Grid, chunk: int) -> dict[str, NDArray[Any]]:
        rows = grid.rows(chunk)
        found = metrics(
            self.chain,
            grid.poses(rows),
            self.metrics,
            self.freedom,
            scene=self.scene,
            links=self.links,
            threads=self.threads,
        )
        shape = (rows.stop - rows.start, grid.orientations)
        with np.errstate(over="ignore"):
            return {
                name: values.reshape(shape).astype(np.float32 if values.dtype == np.float64 else values.dtype)
                for name, values in found.items()
            }


def fill_chunk(work: _Work, chunk: int) -> bool:
    """Computes and stores one chunk; False where it was done already. Runs on a worker."""
    store = Store(work.path, write=True)
    if store.is_done(chunk):
        return False
    store.write(chunk, work.compute(store.grid, chunk))
    return True


def capability(
    chain: Any,
    out: str | os.PathLike[str] = "map.zarr",
    spacing: float = 0.05,
    directions: int = 50,
    freedom: _core.ToolFreedom | None = None,
    metrics: Sequence[str] = ("reachable", "margin", "swivel_measure", "manipulability"),
    client: Any = None,
    *,
    spins: int = 1,
    region: Any = None,
    scene: _core.Scene | None = None,
    links: _core.LinkGeometry | None = None,
    threads: int | None = None,
    progress: Callable[[float], None] | str | None = None,
    time_limit: float | None = None,
    verify: bool = False,
    chunk_poses: int = CHUNK_POSES,
) -> CapabilityJob:
    """Fill a store with what an arm can do over a grid of positions and directions.

    The store has an array `(positions, directions * spins)` per metric, cut into chunks with fixed numbers. Each chunk
    is written once, with its checksum, and then marked as done: a call that was interrupted in any way, also by
    `kill -9` of a worker, the scheduler or the client, goes on where it was when it is made again. The bits of a
    store do not depend on interruptions, threads, or whether Dask was used.

    Args:
        chain: The arm, a `Chain` or an arm with a closed form.
        out: Folder of the store. One of the same arm and settings is completed, another one is refused.
        spacing: Distance of neighbouring positions, m.
        directions: Directions of the tool's z axis at each position, each standing for the same area.
        freedom: How far the tool may tilt and spin away from each pose.
        metrics: Names out of `maps.METRICS`.
        client: A `distributed.Client`: chunks go to its workers, which must see the folder under the same path. `None`:
            this process computes, on the threads of the core.
        spins: Spins about each direction, over a whole turn.
        region: `((x0, x1), (y0, y1), (z0, z1))`, m, instead of all that the arm may reach.
        scene: Obstacles, for the metric `clearance`.
        links: Shapes of the links, for the metric `clearance`.
        threads: Threads without Dask; with Dask each thread of a worker computes one chunk at a time.
        progress: `"bar"` for a bar with rate and time left (needs `rich`), or a function of the share that is done.
        time_limit: Seconds after which what is done is kept and the call returns.
        verify: Whether chunks that are done are read and compared with their checksums first; those that differ are
            computed again.
        chunk_poses: Poses of a chunk; a store keeps its own.

    Returns:
        The job, with `status`, `computed`, `kept`, `rate`, and `open()` for the map.

    Raises:
        RedundancyError: A store of another arm or with other settings (the message lists the differences), or one that
            another process is filling; a full disk; a scheduler that no longer answers; workers that die again and
            again. What was done is kept.
        ModuleNotFoundError: The extra `maps` is missing.

    Example:
        >>> import redundancy as rd
        >>> job = rd.maps.capability(rd.catalog.load("iiwa14"), "map.zarr", spacing=0.2)  # doctest: +SKIP
        >>> job.open().reach_share  # doctest: +SKIP
    """
    import_zarr()
    plain = chain if isinstance(chain, _core.Chain) else chain.chain
    _check_settings(spacing, directions, spins, metrics, chunk_poses)
    path = Path(out)
    # What the core refuses is refused before there is a store.
    pose = np.eye(4)[None]
    _core.pose_metrics(plain, pose, list(metrics), freedom, scene=scene, links=links)
    settings = {
        "spacing": float(spacing),
        "directions": int(directions),
        "spins": int(spins),
        "region": None if region is None else np.asarray(region, dtype=float).tolist(),
        "metrics": list(metrics),
        "freedom": None if freedom is None else repr(freedom),
        "scene": None if scene is None else digest(scene.to_json()),
        "links": None if links is None else digest(links_to_text(links)),
    }
    question = {
        "freedom": None if freedom is None else list(freedom.__reduce__()[1]),
        "scene": None if scene is None else scene.to_json(),
        "links": None if links is None else links_to_text(links),
    }
    store = _open_or_create(path, plain, settings, question, region, chunk_poses)
    alone = client is None
    work = _Work(str(path.resolve()), plain, tuple(metrics), freedom, scene, links, threads if alone else 1)
    begin = time.perf_counter()
    with store.locked():
        if verify:
            for chunk in np.flatnonzero(store.done()):
                if not store.is_intact(int(chunk)):
                    store.forget(int(chunk))
        done = store.done()
        todo = [int(chunk) for chunk in np.flatnonzero(~done)]
        per_chunk = store.grid.chunk * store.grid.orientations
        with Progress(progress, int(done.sum()), len(done), per_chunk, time_limit) as report:
            if alone:
                status = _fill_here(store, work, todo, report)
            else:
                from redundancy.maps._dask import fill_through  # noqa: PLC0415 - an extra

                status = fill_through(client, work, todo, report)
        computed = int(store.done().sum()) - int(done.sum())
    sizes = [store.grid.rows(chunk) for chunk in todo]
    poses = sum(rows.stop - rows.start for rows in sizes[:computed]) * store.grid.orientations
    return CapabilityJob(
        path, status, len(done), computed, int(done.sum()), poses, time.perf_counter() - begin
    )


def _check_settings(
    spacing: float, directions: int, spins: int, metrics: Sequence[str], chunk_poses: int
) -> None:
    if not (np.isfinite(spacing) and spacing > 0):
        raise RedundancyError(f"spacing is {spacing}, it must be above 0 m and finite")
    for name, value in (("directions", directions), ("spins", spins), ("chunk_poses", chunk_poses)):
        if value < 1:
            raise RedundancyError(f"{name} is {value}, it must be at least 1")
    unknown = [name for name in metrics if name not in METRICS]
    if unknown or not metrics or len(set(metrics)) != len(metrics):
        wrong = unknown or list(metrics)
        raise RedundancyError(f"metrics has {wrong}, it must list some of {', '.join(METRICS)}, each once")


def _open_or_create(
    path: Path,
    chain: _core.Chain,
    settings: dict[str, Any],
    question: dict[str, Any],
    region: Any,
    chunk_poses: int,
) -> Store:
    text = chain_to_text(chain)
    if path.exists():
        store = Store(path, write=True)
        wanted = {"chain": text, "version": _core.__version__, "settings": settings}
        stored = {key: store.provenance.get(key) for key in wanted}
        stored["settings"] = {k: v for k, v in store.provenance["settings"].items() if k != "grid"}
        lines = differences(stored, wanted)
        if lines:
            message = (
                f"'{path}' is a store of another arm or setting: {'; '.join(lines)}. Choose another folder"
            )
            raise RedundancyError(message)
        return store
    grid = Grid.around(
        chain, settings["spacing"], settings["directions"], settings["spins"], region, chunk_poses
    )
    provenance = {
        "format": FORMAT,
        "arm": chain.name,
        "chain": text,
        "chain_sha256": digest(text),
        "version": _core.__version__,
        "question": question,
        "settings": {
            **settings,
            "grid": {**vars(grid), "origin": list(grid.origin), "shape": list(grid.shape)},
        },
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    return Store.create(path, provenance)


def _fill_here(store: Store, work: _Work, todo: list[int], report: Report) -> Status:
    try:
        for chunk in todo:
            store.write(chunk, work.compute(store.grid, chunk))
            if not report(1):
                return Status.TIME_LIMIT
    except KeyboardInterrupt:
        return Status.CANCELLED
    return Status.CONVERGED
