"""Progress of a job that counts chunks."""

import time
from collections.abc import Callable
from typing import Any

from redundancy._core import RedundancyError

__all__ = ["Progress", "Report"]

Report = Callable[[int], bool]
"""Notes that some chunks are done; False when the time is over."""


class Progress:
    """Counts what is done, shows it, and says when the time is over."""

    def __init__(
        self,
        show: Callable[[float], None] | str | None,
        done: int,
        total: int,
        per_chunk: int,
        time_limit: float | None,
    ) -> None:
        if isinstance(show, str) and show != "bar":
            raise RedundancyError(f"progress is {show!r}, it must be 'bar', a function or None")
        if time_limit is not None and not time_limit >= 0:
            raise RedundancyError(f"time_limit is {time_limit}, it must be at least 0 s")
        self.done, self.total, self.per_chunk = done, max(total, 1), per_chunk
        self.call = show if callable(show) else None
        self.wants_bar = show == "bar"
        self.end = None if time_limit is None else time.monotonic() + time_limit
        self.bar: Any = None
        self.task: Any = None
        self.begin = time.monotonic()
        self.before = done

    def __enter__(self) -> Report:
        if self.wants_bar:
            try:
                from rich.progress import (  # noqa: PLC0415 - an extra
                    BarColumn,
                    TextColumn,
                    TimeElapsedColumn,
                    TimeRemainingColumn,
                )
                from rich.progress import Progress as Bar  # noqa: PLC0415
            except ModuleNotFoundError as error:
                message = f"progress='bar' needs '{error.name}': pip install 'redundancy[maps]'"
                raise ModuleNotFoundError(message, name=error.name) from error
            self.bar = Bar(
                TextColumn("{task.completed}/{task.total} chunks"),
                BarColumn(),
                TextColumn("{task.fields[rate]}"),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
            )
            self.bar.start()
            self.task = self.bar.add_task("map", total=self.total, completed=self.done, rate="")
        return self._report

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()

    def _report(self, chunks: int) -> bool:
        self.done += chunks
        seconds = time.monotonic() - self.begin
        rate = (self.done - self.before) * self.per_chunk / seconds if seconds > 0 else 0.0
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done, rate=f"{rate:,.0f} poses/s")
        if self.call is not None:
            self.call(self.done / self.total)
        return self.end is None or time.monotonic() < self.end
