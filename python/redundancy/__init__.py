"""What to do with a robot arm's spare freedom."""

from redundancy import catalog, paths
from redundancy._core import (
    Chain,
    DescriptionError,
    Event,
    FileFormatError,
    NotSrsError,
    Path,
    RedundancyError,
    Trajectory,
    __version__,
    times_within_limits,
)

__all__ = [
    "Chain",
    "DescriptionError",
    "Event",
    "FileFormatError",
    "NotSrsError",
    "Path",
    "RedundancyError",
    "Trajectory",
    "__version__",
    "catalog",
    "paths",
    "times_within_limits",
]
