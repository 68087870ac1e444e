"""What the mathematics did, as words."""

from enum import StrEnum

__all__ = ["Status"]


class Status(StrEnum):
    """Outcome of a computation on valid input; `str(x)` is the word.

    A status is never an error: errors are exceptions and mean that the caller's input is wrong.
    """

    CONVERGED = "converged"
    UNREACHABLE = "unreachable"
    INFEASIBLE = "infeasible"
    LIMITS = "limits"
    SINGULAR = "singular"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    CANCELLED = "cancelled"
