"""Types of the compiled module."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

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

# path

@final
class Path:
    """Tool poses, or positions with the orientation left open, in the order of arc length.

    Between the samples the path is a C2 curve: a cubic spline with not-a-knot ends through positions and through unit
    quaternions; circle and raster of `redundancy.paths` keep their analytic curve. Immutable.

    Args:
        poses: `(N, 4, 4)`, a list of SE3-like objects, or `(N, 3)` positions, m.
        s: `(N,)` arc length, m; summed from the distances when left out.
        t: `(N,)` times, s, increasing; a path without times is timed by the arm's velocity limits.

    Raises:
        RedundancyError: Fewer than two samples, invalid poses, lengths that differ, `s` or `t` that do not increase.

    Example:
        >>> import redundancy as rd
        >>> path = rd.Path([[0.3, 0.0, 0.5], [0.4, 0.0, 0.5], [0.4, 0.2, 0.5]])
        >>> path.has_orientation, round(path.length, 12)
        (False, 0.3)
    """

    def __new__(
        cls, poses: ArrayLike | Any, s: ArrayLike | None = None, t: ArrayLike | None = None
    ) -> Path: ...
    @staticmethod
    def from_csv(path: str | PathLike[str]) -> Path:
        """Read a CSV file with a header line and the columns `x,y,z`, `qw,qx,qy,qz` and, where wanted, `s` and `t`.

        The columns stand in any order; metres, seconds. The four quaternion columns may be absent together: a path
        of positions. Quaternions within 1e-3 of unit norm are normalised.

        Raises:
            FileFormatError: What is wrong, with the file's name and line.
        """
    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the samples as `from_csv` reads them."""
    @property
    def s(self) -> NDArray[np.float64]:
        """Arc length of each sample `(N,)`, m. A copy."""
    @property
    def t(self) -> NDArray[np.float64] | None:
        """Time of each sample `(N,)`, s, where the path has times. A copy."""
    @property
    def poses(self) -> NDArray[np.float64]:
        """The samples `(N, 4, 4)`; the rotation is the identity on a path of positions. A copy."""
    @property
    def positions(self) -> NDArray[np.float64]:
        """The samples' positions `(N, 3)`, m. A copy."""
    @property
    def length(self) -> float:
        """Arc length from the first to the last sample, m."""
    @property
    def has_orientation(self) -> bool:
        """False for a path of positions, whose orientation is open."""
    def pose(self, s: ArrayLike) -> NDArray[np.float64]:
        """Pose on the curve.

        Args:
            s: Arc length, m: a number or `(N,)`.

        Returns:
            `(4, 4)` or `(N, 4, 4)`.

        Raises:
            RedundancyError: `s` is not on the path.
        """
    def derivatives(self, s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        r"""First and second derivative with respect to arc length, linear first, angular second, in base axes.

        $(p', \omega)$ in 1 and rad/m, $(p'', \omega')$ in 1/m and rad/m^2, with $\dot Q = \tfrac12 (0, \omega) Q$.

        Args:
            s: Arc length, m: a number or `(N,)`.

        Returns:
            Two arrays `(6,)` or `(N, 6)`.
        """
    def resampled(self, step: float) -> Path:
        """The same curve sampled about every `step` metres; times are interpolated linearly."""
    def with_orientation(
        self, orientation: ArrayLike | Callable[[NDArray[np.float64]], ArrayLike] | Any
    ) -> Path:
        """The same positions with other orientations.

        Args:
            orientation: `(3, 3)` or a pose: everywhere the same; `(N, 3, 3)`: one per sample; a callable from
                positions `(N, 3)` to rotations `(N, 3, 3)`.
        """
    def with_times(self, t: ArrayLike | None) -> Path:
        """The same path with other times `(N,)`, s, or none."""
    def __len__(self) -> int: ...

@final
class Event:
    """Something that happened on the way.

    Args:
        kind: `basis_change`, `damping`, `limit`, `scaled`, `kinematic_singularity`, `algorithmic_singularity`,
            `reconfiguration` or `joint_limit`.
        index: Row of the trajectory; where a plan ends early, the path point that was not reached.
        t: Time, s.
        s: Arc length on the path, m; on a self-motion its parameter.
        message: What happened, for a person.
    """

    def __new__(cls, kind: str, index: int, t: float, s: float, message: str) -> Event: ...
    @property
    def kind(self) -> str:
        """What kind of thing happened."""
    @property
    def index(self) -> int:
        """Row of the trajectory, from 0."""
    @property
    def t(self) -> float:
        """Time, s."""
    @property
    def s(self) -> float:
        """Arc length on the path, m."""
    @property
    def message(self) -> str:
        """What happened, for a person."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@disjoint_base
class Trajectory:
    """Joint positions and velocities over time, one row per instant, with what happened on the way.

    Args:
        joint_names: The joints, base to tip.
        t: `(N,)` times, s, increasing.
        q: `(N, n)` joint positions, rad or m.
        qd: `(N, n)` joint velocities, rad/s or m/s; differences of `q` when left out.
        events: What happened on the way.

    Example:
        >>> import redundancy as rd
        >>> rd.Trajectory(["shoulder", "elbow"], [0.0, 0.5], [[0.0, 1.0], [0.5, 1.0]]).qd.tolist()
        [[1.0, 0.0], [1.0, 0.0]]
    """

    def __new__(
        cls,
        joint_names: Sequence[str],
        t: ArrayLike,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        events: Sequence[Event] | None = None,
    ) -> Self: ...
    @staticmethod
    def from_csv(path: str | PathLike[str]) -> Trajectory:
        """Read what `to_csv` writes."""
    @staticmethod
    def from_json(path: str | PathLike[str]) -> Trajectory:
        """Read what `to_json` writes, or a ROS `JointTrajectory` as JSON; times to the nanosecond."""
    @staticmethod
    def from_npz(path: str | PathLike[str]) -> Trajectory:
        """Read what `to_npz` writes."""
    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write `t,<joint>...,<joint>_velocity...`, one line per instant, without the events."""
    def to_json(self, path: str | PathLike[str]) -> None:
        """Write the fields of ROS `JointTrajectory`, and `events` beside them."""
    def to_npz(self, path: str | PathLike[str]) -> None:
        """Write the arrays `joint_names, t, q, qd` and `event_kind, event_index, event_t, event_s, event_message`."""
    @property
    def joint_names(self) -> list[str]:
        """The joints, base to tip."""
    @property
    def t(self) -> NDArray[np.float64]:
        """Times `(N,)`, s. A copy."""
    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions `(N, n)`, rad or m. A copy."""
    @property
    def qd(self) -> NDArray[np.float64]:
        """Joint velocities `(N, n)`, rad/s or m/s. A copy."""
    @property
    def events(self) -> list[Event]:
        """What happened on the way, in order."""
    def __len__(self) -> int: ...

def times_within_limits(
    q: ArrayLike, velocity_limits: ArrayLike, *, velocity_fraction: float = 0.9, smoothing: int = 10
) -> NDArray[np.float64]:
    """Times for joint rows, from 0, so that no joint is faster than a share of its velocity limit.

    The rate of rows is the largest that the limits allow, smoothed from below over a window of rows.

    Args:
        q: `(N, n)` joint positions, rad or m.
        velocity_limits: `(n,)`, rad/s or m/s, `inf` for none.
        velocity_fraction: Share of each limit that may be used, in (0, 1].
        smoothing: Half-width of the smoothing window in rows; 0 is off.

    Returns:
        `(N,)`, s.

    Raises:
        RedundancyError: Invalid numbers, or a step in which only joints without a limit move.
    """

def paths_circle(
    center: ArrayLike, radius: float, start: float, turns: float, normal: ArrayLike, orientation: Any, n: int
) -> Path: ...
def paths_raster(
    origin: ArrayLike,
    length: float,
    spacing: float,
    strokes: int,
    corner: float | None,
    orientation: Any,
    step: float,
    along: ArrayLike,
    across: ArrayLike,
) -> Path: ...
