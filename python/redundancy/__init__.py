"""What to do with a robot arm's spare freedom."""

from redundancy._core import (
    DescriptionError,
    FileFormatError,
    NotSrsError,
    RedundancyError,
    __version__,
)

__all__ = [
    "DescriptionError",
    "FileFormatError",
    "NotSrsError",
    "RedundancyError",
    "__version__",
]
