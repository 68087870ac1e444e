"""Chunks through Dask: a few per thread at a time, each again when its worker dies."""

import asyncio
import concurrent.futures
import contextlib
import time
from collections.abc import Iterator, Sequence
from typing import Any

from redundancy._core import RedundancyError
from redundancy.maps._progress import Report
from redundancy.status import Status

__all__ = ["connect", "fill_through"]

AHEAD = 4
"""Chunks per thread of the workers that wait at the scheduler."""
MOST_DEATHS = 20
"""Workers that may die under one chunk before the job gives up."""
LOST = (OSError, RuntimeError, asyncio.CancelledError, concurrent.futures.CancelledError)
"""What calls of a client raise whose scheduler is gone; some of it is no `Exception`."""
SILENCE = 60.0
"""Seconds without workers or scheduler after which the job gives up."""


def connect(address: str, timeout: float = 10.0) -> Any:
    """A client of the scheduler at an address.

    Raises:
        RedundancyError: Nothing answers there within `timeout` seconds.
        ModuleNotFoundError: The extra `maps` is missing.
    """
    try:
        import distributed  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        message = f"a scheduler needs '{error.name}': pip install 'redundancy[maps]'"
        raise ModuleNotFoundError(message, name=error.name) from error
    try:
        make: Any = distributed.Client
        return make(address, timeout=timeout)
    except (OSError, TimeoutError, ValueError) as error:
        message = (
            f"no Dask scheduler answers at '{address}' within {timeout:g} s: is it running there? ({error})"
        )
        raise RedundancyError(message) from error


def fill_through(client: Any, work: Any, todo: list[int], report: Report) -> Status:
    """Computes chunks on the workers of a client; returns when all are done."""
    from redundancy.maps._job import fill_chunk  # noqa: PLC0415 - the other way round at import

    state = _Waiting(client, fill_chunk, work, todo)
    try:
        for _ in state.results():
            if not report(1):
                return Status.TIME_LIMIT
    except KeyboardInterrupt:
        return Status.CANCELLED
    finally:
        state.cancel()
    return Status.CONVERGED


class _Waiting:
    """Tasks that were handed to the scheduler and are not done."""

    def __init__(self, client: Any, function: Any, work: Any, todo: Sequence[int]) -> None:
        self.client, self.function, self.work = client, function, work
        self.left = list(reversed(todo))
        self.total = len(todo)
        self.deaths: dict[int, int] = {}
        self.futures: dict[Any, int] = {}
        self.heard = time.monotonic()

    def _submit(self) -> None:
        threads = max(1, sum(self.client.nthreads().values()))
        count = AHEAD * threads - len(self.futures)
        chunks = [self.left.pop() for _ in range(min(count, len(self.left)))]
        if chunks:
            futures = self.client.map(
                self.function,
                [self.work] * len(chunks),
                chunks,
                pure=False,
                retries=0,
                batch_size=len(chunks),
            )
            self.futures.update(zip(futures, chunks, strict=True))

    def results(self) -> Iterator[int]:
        """Numbers of chunks as they are done."""
        import distributed  # noqa: PLC0415 - an extra

        wait: Any = distributed.wait

        while self.left or self.futures:
            try:
                self._submit()
                if self.futures:
                    wait(list(self.futures), timeout=1.0, return_when="FIRST_COMPLETED")
            except TimeoutError:
                pass
            except LOST as error:
                self._silent(error)
            ready = [future for future in self.futures if future.status != "pending"]
            if ready or self._alive():
                self.heard = time.monotonic()
            elif time.monotonic() - self.heard > SILENCE:
                self._silent(None)
            for future in ready:
                chunk = self.futures.pop(future)
                if future.status == "finished":
                    yield chunk
                else:
                    self._again(future, chunk)

    def _alive(self) -> bool:
        try:
            return bool(self.client.nthreads())
        except LOST:
            return False

    def _silent(self, error: BaseException | None) -> None:
        if error is not None and self.client.status == "running" and time.monotonic() - self.heard < SILENCE:
            time.sleep(0.5)
            return
        left = len(self.left) + len(self.futures)
        what = (
            "no longer answers"
            if self.client.status != "running"
            else f"has had no workers for {SILENCE:g} s"
        )
        message = (
            f"the Dask scheduler {what}; {self.total - left} chunks of this call are done and kept, {left} are left: "
            f"make the same call again with a client of a running scheduler ({error or 'silence'})"
        )
        raise RedundancyError(message) from error

    def _again(self, future: Any, chunk: int) -> None:
        """Hands a chunk out again when its worker died; other errors are the caller's."""
        from distributed import KilledWorker  # noqa: PLC0415 - an extra

        if future.status in ("cancelled", "lost"):
            self.left.append(chunk)
            if self.client.status != "running":
                self._silent(OSError("the connection is closed"))
            return
        error = future.exception()
        if not isinstance(error, KilledWorker):
            raise error
        self.deaths[chunk] = self.deaths.get(chunk, 0) + 1
        if self.deaths[chunk] > MOST_DEATHS:
            message = (
                f"chunk {chunk} was lost with its worker {self.deaths[chunk]} times: see the logs of the workers "
                "(memory?). What is done is kept"
            )
            raise RedundancyError(message) from error
        self.left.append(chunk)

    def cancel(self) -> None:
        """Takes back what is not done."""
        if self.futures and self.client.status == "running":
            with contextlib.suppress(*LOST):
                self.client.cancel(list(self.futures))
