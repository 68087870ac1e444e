"""What to do with a robot arm's spare freedom."""

from redundancy import quaternion
from redundancy._core import (
    Cone,
    CrossSection,
    DescriptionError,
    FileFormatError,
    NotSrsError,
    OrientationOptimizer,
    OrientationSolution,
    QuaternionVolume,
    RedundancyError,
    Spin,
    __version__,
    optimal_directions,
)
from redundancy.status import Status

__all__ = [
    "Cone",
    "CrossSection",
    "DescriptionError",
    "FileFormatError",
    "NotSrsError",
    "OrientationOptimizer",
    "OrientationSolution",
    "QuaternionVolume",
    "RedundancyError",
    "Spin",
    "Status",
    "__version__",
    "optimal_directions",
    "quaternion",
]
