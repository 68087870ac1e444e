"""Work for one thread, at most one item per name: a newer one replaces an older one that has not begun.

However fast a browser sends, the queue holds one item per control and never grows.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable

STOP_SECONDS = 5.0
"""How long `close` waits for the item in progress."""


class Mailbox:
    """A worker thread with a queue of named items.

    Args:
        failed: Called with the exception of an item that raises one.
    """

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._failed = failed
        self._items: OrderedDict[str, Callable[[], None]] = OrderedDict()
        self._changed = threading.Condition()
        self._busy = False
        self._open = True
        self._thread = threading.Thread(target=self._work, name="explorer", daemon=True)
        self._thread.start()

    def post(self, name: str, item: Callable[[], None]) -> None:
        """Do `item` soon; it replaces a waiting one of the same name, in its place."""
        with self._changed:
            if self._open:
                self._items[name] = item
                self._changed.notify_all()

    def __len__(self) -> int:
        return len(self._items)

    @property
    def own_thread(self) -> bool:
        """Whether this is the thread that does the work."""
        return threading.current_thread() is self._thread

    def settle(self, timeout: float) -> bool:
        """Wait until nothing is left to do; False after `timeout` seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._items and not self._busy, timeout)

    def close(self) -> None:
        """End after the item in progress."""
        with self._changed:
            self._open = False
            self._items.clear()
            self._changed.notify_all()
        if not self.own_thread:
            self._thread.join(STOP_SECONDS)

    def _work(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._items or not self._open)
                if not self._open:
                    return
                _, item = self._items.popitem(last=False)
                self._busy = True
            try:
                item()
            except Exception as error:  # shown in the page: one bad item must not end the explorer
                self._failed(error)
