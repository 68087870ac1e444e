"""What `rank_starts` returns."""

from collections.abc import Iterable
from typing import Any

from redundancy._core import RankedStart
from redundancy.status import Status


class RankedStarts(list[RankedStart]):
    """The starts, best first: a list that says why it is empty, or why none of them completes the path.

    Attributes:
        status: `converged` when a start completes the path within the limits; else the status of the best start, or why
            there is none: `unreachable`, or `iteration_limit` where the search found no critical point.
        reason: The same in words; empty when `converged`.

    Example:
        >>> from redundancy._ranked import RankedStarts
        >>> from redundancy.status import Status
        >>> RankedStarts([], Status("unreachable"), "out of reach").status == "unreachable"
        True
    """

    def __init__(self, starts: Iterable[RankedStart], status: Status, reason: str) -> None:
        super().__init__(starts)
        self.status = status
        self.reason = reason

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (list(self), self.status, self.reason)
