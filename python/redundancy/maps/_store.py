"""The store of a map: arrays in chunks with fixed numbers, a checksum of each, and which are done.

A chunk counts from the moment its entry of `done` is written, which is after its data and its checksum; files are
replaced as a whole. So whatever is killed, a chunk is either done or computed again, with the same bits.
"""

import errno
import hashlib
import json
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundancy import _core
from redundancy._core import RedundancyError
from redundancy.maps._grid import Grid

__all__ = ["Store", "chain_from_text", "chain_to_text", "differences", "import_zarr"]

FORMAT = 2
_LOCK = "lock"
FLAGS = ("reachable", "proven")


def import_zarr() -> Any:
    """The package zarr, or an error that names the extra."""
    try:
        import zarr  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        message = f"maps need '{error.name}': pip install 'redundancy[maps]'"
        raise ModuleNotFoundError(message, name=error.name) from error
    return zarr


def chain_to_text(chain: _core.Chain) -> str:
    """Everything that a chain is made of, as JSON; numbers keep all digits."""
    return json.dumps(chain.__reduce__()[1])


def _tuples(value: Any) -> Any:
    return tuple(_tuples(entry) for entry in value) if isinstance(value, list) else value


def chain_from_text(text: str) -> _core.Chain:
    """The chain of `chain_to_text`."""
    make: Callable[..., _core.Chain] = _core.Chain._from_parts  # type: ignore[attr-defined]
    return make(*_tuples(json.loads(text)))


def links_to_text(links: _core.LinkGeometry) -> str:
    """The shapes and pairs of the links as JSON; numbers keep all digits."""
    return str(links.__reduce__()[1][1])


def links_from_text(chain: _core.Chain, text: str) -> _core.LinkGeometry:
    """The links of `links_to_text`."""
    make: Callable[..., _core.LinkGeometry] = _core.LinkGeometry._from_parts
    return make(chain, text)


def digest(text: str | bytes) -> str:
    """SHA-256 as hexadecimal digits."""
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()


def differences(stored: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """What differs between two provenances, one line each."""
    lines = []
    for key in sorted(stored.keys() | wanted.keys()):
        a, b = stored.get(key), wanted.get(key)
        if a == b:
            continue
        if isinstance(a, dict) and isinstance(b, dict):
            lines += [f"{key}.{line}" for line in differences(a, b)]
        elif key == "chain":
            lines += _chain_differences(str(a), str(b))
        else:
            lines.append(f"{key}: {a!r} in the store, {b!r} now")
    return lines


def _chain_differences(a: str, b: str) -> list[str]:
    """In which of its public numbers an arm differs."""
    first, second = chain_from_text(a), chain_from_text(b)
    lines = []
    for name in ("name", "joint_names", "lower", "upper", "velocity_limit", "effort_limit"):
        x, y = getattr(first, name), getattr(second, name)
        if not np.array_equal(np.asarray(x), np.asarray(y)):
            lines.append(f"arm.{name}: {_shown(x)!r} in the store, {_shown(y)!r} now")
    return lines or ["arm: other frames, tool or base in the store than now"]


def _shown(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


class Store:
    """One store on a disk that every process that fills it can see."""

    def __init__(self, path: str | os.PathLike[str], *, write: bool = False) -> None:
        zarr = import_zarr()
        self.path = Path(path)
        if self.path.exists() and not self.path.is_dir():
            raise RedundancyError(f"'{self.path}' is a file, expected the folder of a map")
        try:
            self.group = zarr.open_group(str(self.path), mode="r+" if write else "r")
        except (FileNotFoundError, ValueError) as error:
            raise RedundancyError(f"'{self.path}' is not a store of a map: {error}") from error
        self.provenance: dict[str, Any] = dict(self.group.attrs).get("redundancy", {})
        if self.provenance.get("format") != FORMAT:
            found = self.provenance.get("format")
            raise RedundancyError(f"'{self.path}' has the format {found!r}, this version reads {FORMAT}")
        settings = self.provenance["settings"]
        self.metrics: tuple[str, ...] = tuple(settings["metrics"])
        grid = settings["grid"]
        self.grid = Grid(**{**grid, "origin": tuple(grid["origin"]), "shape": tuple(grid["shape"])})

    @classmethod
    def create(cls, path: Path, provenance: dict[str, Any]) -> "Store":
        """A new empty store; it appears under its name when it is whole."""
        zarr = import_zarr()
        settings = provenance["settings"]
        grid = Grid(**settings["grid"])
        building = path.with_name(f"{path.name}.{os.getpid()}.new")
        group = zarr.open_group(str(building), mode="w")
        for metric in settings["metrics"]:
            group.create_array(
                metric,
                shape=(grid.positions, grid.orientations),
                chunks=(grid.chunk, grid.orientations),
                dtype="bool" if metric in FLAGS else "float32",
                fill_value=False if metric in FLAGS else 0.0,
            )
        group.create_array("done", shape=(grid.chunks,), chunks=(1,), dtype="uint8", fill_value=0)
        group.create_array("checksum", shape=(grid.chunks, 32), chunks=(1, 32), dtype="uint8", fill_value=0)
        group.attrs["redundancy"] = provenance
        building.rename(path)
        return cls(path, write=True)

    def chain(self) -> _core.Chain:
        """The arm."""
        return chain_from_text(self.provenance["chain"])

    def question(self) -> dict[str, Any]:
        """The arguments of `maps.metrics` besides arm and metrics that the values were made with."""
        held = self.provenance["question"]
        freedom, scene, links = held["freedom"], held["scene"], held["links"]
        return {
            "freedom": None if freedom is None else _core.ToolFreedom(*freedom),
            "scene": None if scene is None else _core.Scene.from_json_string(scene),
            "links": None if links is None else links_from_text(self.chain(), links),
        }

    def done(self) -> NDArray[np.bool_]:
        """Which chunks are done."""
        done: NDArray[np.bool_] = np.asarray(self.group["done"][:]) == 1
        return done

    def is_done(self, chunk: int) -> bool:
        """Whether one chunk is done."""
        return int(self.group["done"][chunk]) == 1

    def data(self, chunk: int) -> dict[str, NDArray[Any]]:
        """What is stored for a chunk."""
        rows = self.grid.rows(chunk)
        return {metric: np.asarray(self.group[metric][rows]) for metric in self.metrics}

    def write(self, chunk: int, data: dict[str, NDArray[Any]]) -> None:
        """Stores a chunk: data, checksum, then the mark that it is done."""
        rows = self.grid.rows(chunk)
        try:
            for metric in self.metrics:
                self.group[metric][rows] = data[metric]
            self.group["checksum"][chunk] = self.checksum(data)
            self.group["done"][chunk] = 1
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                message = (
                    f"the disk of '{self.path}' is full: chunk {chunk} was not stored. What is done is kept; free "
                    "some space and make the same call again, it goes on from there"
                )
                raise RedundancyError(message) from error
            raise

    def checksum(self, data: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
        """SHA-256 of the values of a chunk."""
        total = hashlib.sha256()
        for metric in self.metrics:
            total.update(metric.encode())
            total.update(np.ascontiguousarray(data[metric]).tobytes())
        return np.frombuffer(total.digest(), dtype=np.uint8)

    def is_intact(self, chunk: int) -> bool:
        """Whether a chunk can be read and has the values that were stored."""
        try:
            return bool(np.array_equal(self.checksum(self.data(chunk)), self.group["checksum"][chunk]))
        except Exception:  # whatever a decoder raises about bytes that are not its own
            return False

    def forget(self, chunk: int) -> None:
        """Marks a chunk as not done."""
        self.group["done"][chunk] = 0

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other processes from filling the store; ends with the process, however that ends."""
        with locked(self.path):
            yield


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """A lock of the folder `path` that the system lets go when the process ends."""
    handle = os.open(path / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            _lock_file(handle)
        except OSError as error:
            holder = os.pread(handle, 200, 0).decode(errors="replace").strip() if hasattr(os, "pread") else ""
            message = (
                f"'{path}' is being filled by another process ({holder or 'unknown'}): wait for it or stop it"
            )
            raise RedundancyError(message) from error
        try:
            os.ftruncate(handle, 0)
            os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
        except OSError:  # a full disk must not hide behind the lock: who holds it is only for messages
            pass
        yield
    finally:
        os.close(handle)


def _lock_file(handle: int) -> None:
    try:
        import fcntl  # noqa: PLC0415 - not on Windows
    except ModuleNotFoundError:
        import msvcrt  # noqa: PLC0415 - only on Windows

        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        return
    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
