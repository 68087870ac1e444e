"""What to do with a robot arm's spare freedom."""

from redundancy import catalog
from redundancy._core import (
    Chain,
    DescriptionError,
    FileFormatError,
    NotSrsError,
    RedundancyError,
    __version__,
)

__all__ = [
    "Chain",
    "DescriptionError",
    "FileFormatError",
    "NotSrsError",
    "RedundancyError",
    "__version__",
    "catalog",
]
