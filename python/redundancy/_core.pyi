"""Types of the compiled module."""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

# A (4, 4) array, or an object with `homogeneous`, `as_matrix()` or `A`.
_Pose: TypeAlias = Any

__version__: str

class RedundancyError(ValueError): ...
class DescriptionError(RedundancyError): ...
class NotSrsError(RedundancyError): ...
class FileFormatError(RedundancyError): ...

# chain, kinematics

@final
class Chain:
    """An arm: joints from base to tip, limits, base and tool.

    Immutable: every `with_...` returns a new chain. Units are m, rad, s, kg, N, N m; 'no limit' is infinite.
    `q` is `(n,)`, or `(N, n)` for many configurations, and then the result has the leading axis too.
    Poses are `(4, 4)` arrays or objects of pinocchio, scipy, mink, viser or spatialmath.

    Example:
        >>> import numpy as np
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("pa10")
        >>> round(float(arm.forward(np.zeros(7))[2, 3]), 6)
        1.345
    """

    @staticmethod
    def from_urdf(
        path: str | PathLike[str],
        base: str | None = None,
        tip: str | None = None,
        missing_limits: Literal["error", "unbounded"] = "error",
    ) -> Chain:
        """Read the way from a base link to a tip link out of a URDF file.

        Fixed joints are folded, numbers are used as they are, a velocity or effort of 0 means none.

        Args:
            path: The file.
            base: Base link; may be left out when there is one root (or one above `tip`).
            tip: Tip link; may be left out when there is one leaf (below `base`).
            missing_limits: What to do with a revolute or prismatic joint without `<limit>`.

        Raises:
            OSError: The file cannot be opened.
            DescriptionError: Malformed XML, no way from base to tip, joints that mimic, float or move in a plane,
                names used twice, missing or inverted limits.
            RedundancyError: An unknown link (the names are listed), numbers that are not finite, a zero axis.
        """

    @staticmethod
    def from_urdf_string(
        xml: str,
        base: str | None = None,
        tip: str | None = None,
        missing_limits: Literal["error", "unbounded"] = "error",
    ) -> Chain:
        """Read a chain out of the text of a URDF; see `from_urdf`."""

    @staticmethod
    def from_dh(
        rows: ArrayLike,
        convention: Literal["standard", "modified"] = "standard",
        base: _Pose | None = None,
        tool: _Pose | None = None,
        names: Sequence[str] | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        inertia: Sequence[tuple[float, ArrayLike, ArrayLike]] | None = None,
        rotor_inertia: ArrayLike | None = None,
        *,
        name: str = "arm",
    ) -> Chain:
        """Build a chain of revolute joints from Denavit-Hartenberg rows.

        Standard (distal): `T_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`.
        Modified (Craig): `T_i = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`.

        Args:
            rows: `(n, 4)`: a (m), d (m), alpha (rad), offset theta (rad).
            convention: Which frame the rows describe.
            base: _Pose of frame 0 in the world.
            tool: _Pose of the tool in the last frame.
            names: Joint names; `joint1`, `joint2`, ... when left out.
            lower: `(n,)` lower position limits, rad; `-inf` for none. A single number counts for all joints.
            upper: `(n,)` upper position limits, rad; `inf` for none.
            velocity: `(n,)` velocity limits, rad/s.
            effort: `(n,)` torque limits, N m.
            inertia: Per link its mass (kg), centre of mass `(3,)` (m) and inertia at it `(3, 3)`, or its diagonal
                `(3,)` (kg m^2), in the frame of the row.
            rotor_inertia: `(n,)` inertia of the rotors seen at the joints, kg m^2.
            name: Name of the robot.

        Raises:
            RedundancyError: Wrong shapes, numbers that are not finite, inverted limits, names used twice.
        """

    @property
    def name(self) -> str:
        """Name of the robot."""
    @property
    def dof(self) -> int:
        """Number of moving joints."""
    @property
    def joint_names(self) -> list[str]:
        """Names of the moving joints, base to tip."""
    @property
    def link_names(self) -> list[str]:
        """Names of the frames, base to tip; `forward` knows them."""
    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower position limits `(n,)`, rad or m, `-inf` for none. A copy."""
    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper position limits `(n,)`, rad or m, `inf` for none. A copy."""
    @property
    def velocity_limit(self) -> NDArray[np.float64]:
        """Velocity limits `(n,)`, rad/s or m/s, `inf` for none. A copy."""
    @property
    def acceleration_limit(self) -> NDArray[np.float64]:
        """Acceleration limits `(n,)`, rad/s^2 or m/s^2, `inf` for none. A copy."""
    @property
    def effort_limit(self) -> NDArray[np.float64]:
        """Torque or force limits `(n,)`, N m or N, `inf` for none. A copy."""
    @property
    def base(self) -> NDArray[np.float64]:
        """Pose `(4, 4)` of the first link in the world. A copy."""
    @property
    def tool(self) -> NDArray[np.float64]:
        """Pose `(4, 4)` of the tool in the frame of the last link. A copy."""
    def with_tool(self, pose: _Pose) -> Chain:
        """The same arm with another tool after its last link; replaces an earlier tool."""
    def with_base(self, pose: _Pose) -> Chain:
        """The same arm mounted elsewhere; replaces an earlier base."""
    def with_limits(
        self,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
    ) -> Chain:
        """The same arm with other limits `(n,)`; what is not given stays. A single number counts for all joints."""
    def forward(
        self, q: ArrayLike, link: str | None = None, *, threads: int | None = None
    ) -> NDArray[np.float64]:
        """Pose of the tool, or of a link without the tool.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            link: One of `link_names`; the tool when left out.
            threads: Threads for a batch; all cores when left out. The bits do not depend on it.

        Returns:
            `(4, 4)` or `(N, 4, 4)`.

        Raises:
            RedundancyError: Wrong shape, an entry that is not finite, an unknown link (the names are listed).
        """
    def jacobian(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Geometric Jacobian of the tool: linear rows first, world axes, reference point at the tool.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            threads: Threads for a batch; all cores when left out.

        Returns:
            `(6, n)` or `(N, 6, n)`.
        """
    def kinematics(
        self, q: ArrayLike, *, threads: int | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pose and Jacobian of the tool at the cost of one pass.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            threads: Threads for a batch; all cores when left out.

        Returns:
            `(4, 4)` and `(6, n)`, or `(N, 4, 4)` and `(N, 6, n)`.
        """
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

def catalog_load(name: str) -> Chain: ...
def catalog_names() -> list[str]: ...
