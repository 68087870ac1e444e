"""What to do with a robot arm's spare freedom."""

from redundancy import catalog
from redundancy._core import (
    Branch,
    Chain,
    Choice,
    ChoiceBatch,
    Criterion,
    DescriptionError,
    FileFormatError,
    JointRange,
    NotSrsError,
    Posture,
    RedundancyError,
    SelfMotion,
    SolveBatch,
    SrsArm,
    __version__,
)
from redundancy.status import Status

__all__ = [
    "Branch",
    "Chain",
    "Choice",
    "ChoiceBatch",
    "Criterion",
    "DescriptionError",
    "FileFormatError",
    "JointRange",
    "NotSrsError",
    "Posture",
    "RedundancyError",
    "SelfMotion",
    "SolveBatch",
    "SrsArm",
    "Status",
    "__version__",
    "catalog",
]
