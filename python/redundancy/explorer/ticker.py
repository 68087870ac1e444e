"""A thread that calls something at a steady rate."""

import threading
import time
from collections.abc import Callable

STOP_SECONDS = 5.0
"""How long `stop` waits for the tick in progress."""
LATEST = 0.1
"""Delay after which missed ticks are dropped instead of made up for, s."""


class Ticker:
    """Calls `action` every `dt` seconds until `stop`, on a thread of its own.

    Deadlines are multiples of `dt` from the start, so that a late tick does not delay the following ones. After a
    delay of more than `LATEST` the ticks that were missed are dropped and counted.

    Args:
        dt: Time between ticks, s.
        action: What a tick does.
        failed: Called with an exception of `action`, which ends the ticks.
    """

    def __init__(self, dt: float, action: Callable[[], None], failed: Callable[[Exception], None]) -> None:
        self.dt, self._action, self._failed = dt, action, failed
        self.ticks, self.dropped, self.late = 0, 0, 0.0
        """How many ticks there were, how many were dropped, and the largest delay of one, s."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="explorer-servo", daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it ticks."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """End after the tick in progress."""
        self._stop.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(STOP_SECONDS)

    def _run(self) -> None:
        due = time.perf_counter()
        while not self._stop.is_set():
            try:
                self._action()
            except Exception as error:  # shown in the page
                self._failed(error)
                return
            self.ticks += 1
            due += self.dt
            wait = due - time.perf_counter()
            if wait > 0.0:
                self._stop.wait(wait)
            # How late the next tick begins; a system that is busy wakes a thread late.
            delay = time.perf_counter() - due
            self.late = max(self.late, delay)
            if delay > LATEST:
                missed = int(delay / self.dt)
                self.dropped += missed
                due += missed * self.dt
