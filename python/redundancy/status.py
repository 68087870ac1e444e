"""Outcomes, events and kinds of critical points, as words."""

from enum import StrEnum

__all__ = ["EventKind", "Kind", "Status"]


class Status(StrEnum):
    """Outcome of a computation on valid input; `str(x)` is the word.

    A status is never an error: errors are exceptions and mean that the caller's input is wrong.
    """

    CONVERGED = "converged"
    UNREACHABLE = "unreachable"
    INFEASIBLE = "infeasible"
    LIMITS = "limits"
    COLLISION = "collision"
    OFF_PATH = "off_path"
    SINGULAR = "singular"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    CANCELLED = "cancelled"
    TRACKING = "tracking"
    NO_TARGET = "no_target"


class EventKind(StrEnum):
    """Kind of an event along a path or trajectory; `str(x)` is the word."""

    BASIS_CHANGE = "basis_change"
    DAMPING = "damping"
    LIMIT = "limit"
    SCALED = "scaled"
    KINEMATIC_SINGULARITY = "kinematic_singularity"
    ALGORITHMIC_SINGULARITY = "algorithmic_singularity"
    RECONFIGURATION = "reconfiguration"
    JOINT_LIMIT = "joint_limit"
    LIMIT_ACTIVE = "limit_active"
    LIMIT_RELEASED = "limit_released"
    CONTACT = "contact"
    SPEED_BOUNDED = "speed_bounded"


class Kind(StrEnum):
    """Kind of a configuration for a criterion on its self-motion; `str(x)` is the word."""

    MAXIMUM = "maximum"
    MINIMUM = "minimum"
    SADDLE = "saddle"
    DEGENERATE = "degenerate"
    NOT_CRITICAL = "not_critical"
    KINEMATIC_SINGULARITY = "kinematic_singularity"
