"""Types of the compiled module."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, Self, TypeAlias, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

from redundancy._ranked import RankedStarts
from redundancy.status import EventKind, Kind, Status

# A (4, 4) array, or an object with `homogeneous`, `as_matrix()` or `A`.
_Pose: TypeAlias = Any
_Vector: TypeAlias = np.ndarray[tuple[int], np.dtype[np.float64]]
_ClosedForm: TypeAlias = "SrsArm | PandaClassArm | SphericalWristArm | ParallelAxesArm"

__version__: str

class RedundancyError(ValueError):
    """Invalid input; the message names the quantity, its value and the bound."""

class DescriptionError(RedundancyError):
    """A robot description (URDF, D-H rows, builder) cannot become a chain."""

class NotSrsError(RedundancyError):
    """Not a spherical-revolute-spherical arm; the message says which axes miss each other and by how much."""

class NotSphericalWristError(RedundancyError):
    """Not a six-joint arm with a spherical wrist; the message says which axes are wrong and by how much."""

class NotParallelAxesError(RedundancyError):
    """Not a six-joint arm with three parallel axes; the message says which axes are wrong and by how much."""

class NotPandaClassError(RedundancyError):
    """The chain is not an arm of the Panda class; the message says which axes are wrong and by how much."""

class FileFormatError(RedundancyError):
    """A file is malformed; the message gives its name and line."""

class CannotFollowError(RedundancyError):
    """The input is valid, but the arm cannot do it; the message says where and why."""

# chain, kinematics

@final
class Chain:
    """An arm: joints from base to tip, limits, base and tool.

    Immutable: every `with_...` returns a new chain. Units are m, rad, s, kg, N, N m; 'no limit' is infinite. `q` is
    `(n,)`, or `(N, n)` for many configurations, and then the result has the leading axis too. Poses are `(4, 4)`
    arrays or objects of pinocchio, scipy, mink, viser or spatialmath. A rotation that is off by up to 1e-3 (largest
    deviation of a singular value from 1) is replaced by the nearest one; a pose that is farther off is refused.

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
        """Read the chain from a base link to a tip link from a URDF file.

        The base need not be an ancestor of the tip: the chain runs up to their common ancestor and down again (from
        the top of a turntable to a tool, from one hand to the other). Joints keep their names, signs and limits; they
        are ordered from the base, and each body belongs to the joint before it. Fixed joints are folded, numbers are
        used as they are, and a velocity or effort of 0 means no limit.

        Args:
            path: The file.
            base: Base link; may be left out when there is one root (or one above `tip`).
            tip: Tip link; may be left out when there is one leaf (below `base`).
            missing_limits: What to do with a revolute or prismatic joint without `<limit>`.

        Raises:
            OSError: The file cannot be opened.
            DescriptionError: Malformed XML, no common ancestor of base and tip (both roots are named), joints that
                mimic, float or move in a plane, names used twice, missing or inverted limits.
            RedundancyError: An unknown link (the names are listed), numbers that are not finite, a zero axis.
        """

    @staticmethod
    def from_urdf_string(
        xml: str,
        base: str | None = None,
        tip: str | None = None,
        missing_limits: Literal["error", "unbounded"] = "error",
    ) -> Chain:
        """Read a chain from the text of a URDF; see `from_urdf`.

        Args:
            xml: Text of the URDF.
            base: Base link, as in `from_urdf`.
            tip: Tip link, as in `from_urdf`.
            missing_limits: What to do with a revolute or prismatic joint without `<limit>`.
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
            rows: `(n, 4)`: a (m), d (m), alpha (rad), offset theta (rad); one joint is `[[a, d, alpha, theta]]`.
            convention: Which frame the rows describe.
            base: Pose of frame 0 in the world.
            tool: Pose of the tool in the last frame.
            names: Joint names; `joint1`, `joint2`, ... when left out.
            lower: `(n,)` lower position limits, rad; `-inf` for none. A single number applies to all joints.
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
        """The same arm with another tool after its last link; replaces an earlier tool.

        Args:
            pose: Pose `(4, 4)` of the tool in the frame of the last link, m.
        """
    def with_base(self, pose: _Pose) -> Chain:
        """The same arm mounted elsewhere; replaces an earlier base.

        Args:
            pose: Pose `(4, 4)` of the first link in the world, m.
        """
    def with_limits(
        self,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
    ) -> Chain:
        """The same arm with other limits `(n,)`; what is not given stays. A single number applies to all joints.

        Args:
            lower: Lower position limits `(n,)`, rad or m; `-inf` for none.
            upper: Upper position limits `(n,)`, rad or m; `inf` for none.
            velocity: Velocity limits `(n,)`, rad/s or m/s; `inf` for none.
            acceleration: Acceleration limits `(n,)`, rad/s^2 or m/s^2; `inf` for none.
            effort: Torque or force limits `(n,)`, N m or N; `inf` for none.
        """
    def with_rail(
        self,
        axis: ArrayLike,
        lower: float,
        upper: float,
        velocity: float | None = None,
        name: str = "rail",
    ) -> Chain:
        """The same arm on a rail: one prismatic joint before the base.

        At 0 on the rail the arm is where it was before. The rail is the first joint; the new first link `<name>_base`
        stands still, and the former first link moves. Another call puts a rail below the first one. For torques, the
        rail carries the bodies that the arm's joints move; the mass of the former first link is not known.

        Args:
            axis: `(3,)` direction of the rail, world axes, of any length.
            lower: Lowest position, m; `-inf` for none.
            upper: Highest position, m; `inf` for none.
            velocity: Largest speed, m/s; none when left out.
            name: Name of the joint.

        Raises:
            RedundancyError: An axis without length, inverted limits, a name that is already used.

        Example:
            >>> import redundancy as rd
            >>> chain = rd.catalog.load("iiwa14").with_rail((0, 1, 0), 0.0, 2.0)
            >>> chain.dof, chain.joint_names[0]
            (8, 'rail')
        """
    def with_payload(self, mass: float, center_of_mass: ArrayLike, inertia: ArrayLike | None = None) -> Chain:
        """The same arm with a body fixed to its tip, in addition to those already there.

        It counts in torques and what depends on them (`inverse_dynamics`, `max_speed`, `plan_orientation`).

        Args:
            mass: kg.
            center_of_mass: `(3,)`, m, in the frame of the last link (the tip), whatever the tool is.
            inertia: `(3, 3)` or its diagonal `(3,)` at the centre of mass, axes of the last link, kg m^2; a point mass
                when left out.

        Raises:
            RedundancyError: A chain without inertias, a mass that is not positive, an inertia that is not symmetric or
                not positive semidefinite, numbers that are not finite.

        Example:
            >>> import redundancy as rd
            >>> zero, arm = [0.0] * 7, rd.catalog.load("iiwa14")
            >>> loaded = arm.with_payload(2.0, (0.1, 0.0, 0.05))
            >>> change = loaded.inverse_dynamics(zero, zero, zero) - arm.inverse_dynamics(zero, zero, zero)
            >>> bool(abs(change[1]) > 1.0)
            True
        """
    def forward(
        self, q: ArrayLike, link: str | None = None, *, threads: int | None = None
    ) -> NDArray[np.float64]:
        """Pose of the tool, or of a link without the tool.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            link: One of `link_names`; the tool when left out.
            threads: Threads for a batch; all cores by default. The result does not depend on it.

        Returns:
            `(4, 4)` or `(N, 4, 4)`.

        Raises:
            RedundancyError: Wrong shape, an entry that is not finite, an unknown link (the names are listed).
        """
    def jacobian(
        self,
        q: ArrayLike,
        link: str | None = None,
        frame: str = "base",
        point: ArrayLike | None = None,
        *,
        threads: int | None = None,
    ) -> NDArray[np.float64]:
        """Geometric Jacobian of the tool or of a link: linear rows first.

        The velocity is relative to the base; `frame` only chooses the axes in which it is expressed.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            link: One of `link_names`; the tool when left out. Joints after it have columns of zeros.
            frame: Axes of both halves: `"base"` (world axes, those in which the base is placed), `"tool"`, or one of
                `link_names` (a link called `base` or `tool` cannot be chosen by its name).
            point: `(3,)` reference point, m, in the frame of the link (or of the tool); its origin when left out.
            threads: Threads for a batch; all cores by default.

        Returns:
            `(6, n)` or `(N, 6, n)`: m or 1, and 1 or 0.

        Raises:
            RedundancyError: Wrong shape, an entry that is not finite, an unknown link or frame (the names are listed).

        Example:
            >>> import numpy as np
            >>> import redundancy as rd
            >>> arm = rd.catalog.load("planar3r")
            >>> body = arm.jacobian(np.zeros(3), link="link2", frame="link2", point=(0.5, 0.0, 0.0))
            >>> body[1].tolist()
            [6.0, 3.0, 0.0]
        """
    def kinematics(
        self, q: ArrayLike, *, threads: int | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pose and Jacobian of the tool at the cost of one pass.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            threads: Threads for a batch; all cores by default.

        Returns:
            `(4, 4)` and `(6, n)`, or `(N, 4, 4)` and `(N, 6, n)`.
        """
    def hessian(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Kinematic Hessian: how the columns of the Jacobian change, `H[:, j, k] = d J[:, j] / d q_k`.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            threads: Threads for a batch; all cores by default.

        Returns:
            `(6, n, n)` or `(N, 6, n, n)`. The linear part is symmetric in j and k, the angular part is not.
        """
    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        gravity: Sequence[float] = (0.0, 0.0, -9.81),
        *,
        threads: int | None = None,
    ) -> NDArray[np.float64]:
        """Joint torques `M(q) qdd + c(q, qd) + g(q)`, rotors included, without friction.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
            qd: Velocities; a single row is used for the whole batch.
            qdd: Accelerations; likewise.
            gravity: m/s^2, world axes.
            threads: Threads for a batch; all cores by default.

        Returns:
            `(n,)` or `(N, n)`, N m (N for sliding joints).

        Raises:
            RedundancyError: No inertias in the description, wrong shapes, entries that are not finite.
        """
    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        gravity: Sequence[float] = (0.0, 0.0, -9.81),
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Derivatives of `inverse_dynamics` by q, qd and qdd, in closed form.

        Args:
            q: Joint positions `(n,)`, rad or m.
            qd: Velocities `(n,)`, rad/s or m/s.
            qdd: Accelerations `(n,)`, rad/s^2 or m/s^2.
            gravity: `(3,)`, m/s^2, world axes.

        Returns:
            Three `(n, n)`: row i is the torque of joint i. The last is the mass matrix, rotors included.
        """
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

def catalog_load(name: str) -> Chain:
    """An arm of the catalogue by name.

    Args:
        name: One of `catalog_names()`.
    """

def catalog_names() -> list[str]:
    """Names of the arms of the catalogue, in alphabetical order."""

# path

@final
class Path:
    """Tool poses, or positions with the orientation left open, in the order of arc length.

    Between the samples the path is a C2 curve: a cubic spline with not-a-knot ends through positions and through unit
    quaternions; circle and raster of `redundancy.paths` keep their analytic curve. Immutable.

    A rotation that is off by up to 1e-3 (largest deviation of a singular value from 1), and a quaternion whose norm is
    within 1e-3 of 1, is replaced by the nearest one; beyond that it is refused with the measured value.

    Args:
        poses: `(N, 4, 4)`, a list of SE3-like objects, or `(N, 3)` positions, m.
        s: `(N,)` arc length, m; summed from the distances when left out.
        t: `(N,)` times, s, increasing; a path without times gets them from the arm's velocity limits.
        positions: `(N, 3)`, m, instead of `poses`.
        quaternions_wxyz: `(N, 4)`, scalar first, beside `positions`, or `(4,)` for all; a path of positions when left
            out.

    Raises:
        RedundancyError: Fewer than two samples, invalid poses, lengths that differ, `s` or `t` that do not increase.

    Example:
        >>> import redundancy as rd
        >>> path = rd.Path([[0.3, 0.0, 0.5], [0.4, 0.0, 0.5], [0.4, 0.2, 0.5]])
        >>> path.has_orientation, round(path.length, 12)
        (False, 0.3)
        >>> down = rd.Path(positions=[[0.3, 0.0, 0.5], [0.4, 0.0, 0.5]], quaternions_wxyz=[0, 1, 0, 0])
        >>> down.poses[1, :3, 2].tolist()
        [0.0, 0.0, -1.0]
    """

    def __new__(
        cls,
        poses: ArrayLike | Any | None = None,
        s: ArrayLike | None = None,
        t: ArrayLike | None = None,
        *,
        positions: ArrayLike | None = None,
        quaternions_wxyz: ArrayLike | None = None,
    ) -> Path: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    @staticmethod
    def from_csv(path: str | PathLike[str]) -> Path:
        """Read a CSV file with a header line and the columns `x,y,z`, `qw,qx,qy,qz` and, where wanted, `s` and `t`.

        The order of the columns is arbitrary; metres, seconds. The four quaternion columns may be absent together: a
        path of positions. Quaternions within 1e-3 of unit norm are normalised.

        Raises:
            FileFormatError: What is wrong, with the file's name and line.
        """
    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the samples as `from_csv` reads them.

        Args:
            path: The file to write.
        """
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
        """The same curve sampled about every `step` metres; times are interpolated linearly.

        Where pieces of a joined path meet, there is a sample.
        """
    def transformed(self, pose: _Pose) -> Path:
        """The path moved by a rigid transform: every pose `T` becomes `pose @ T`.

        Circle and raster stay analytic; arc lengths and times are kept.
        """
    def reversed(self) -> Path:
        """The path from its end to its start, with the same orientations.

        Circle and raster stay analytic. Arc lengths and times start where they started, and each section takes as long
        as before.
        """
    def joined(self, other: Path) -> Path:
        """This path and then `other`, each with its own curve, so with a corner where they do not meet smoothly.

        If `other` starts at the pose at which this path ends, they share the sample. If it starts elsewhere, a
        straight line with the shorter rotation leads there. Times of `other` are shifted so that it starts when this
        path ends; across a gap they are kept and must leave time for it.

        Raises:
            RedundancyError: Only one of the two paths has orientations, or times; a gap without time for it.

        Example:
            >>> import redundancy as rd
            >>> stroke = rd.Path([[0.3, 0.0, 0.5], [0.5, 0.0, 0.5]])
            >>> there_and_back = stroke.joined(stroke.reversed())
            >>> len(there_and_back), round(there_and_back.length, 12)
            (3, 0.4)
        """
    def with_orientation(
        self, orientation: ArrayLike | Callable[[NDArray[np.float64]], ArrayLike] | Any
    ) -> Path:
        """The same positions with other orientations.

        Args:
            orientation: `(3, 3)` or a pose: everywhere the same; `(N, 3, 3)`: one per sample; a callable from
                positions `(N, 3)` to rotations `(N, 3, 3)`.
        """
    def with_times(self, t: ArrayLike | None) -> Path:
        """The same path with other times `(N,)`, s, or none.

        Args:
            t: `(N,)`, s, increasing; None removes the times.
        """
    def __len__(self) -> int: ...

@final
class Event:
    """An event along a path or trajectory.

    Args:
        kind: `basis_change`, `damping`, `limit`, `scaled`, `kinematic_singularity`, `algorithmic_singularity`,
            `reconfiguration` or `joint_limit`.
        index: Row of the trajectory; where a plan ends early, the path point that was not reached.
        t: Time, s.
        s: Arc length on the path, m; on a self-motion its parameter.
        message: What happened, as a sentence.
    """

    def __new__(cls, kind: str, index: int, t: float, s: float, message: str) -> Event: ...
    @property
    def kind(self) -> EventKind:
        """Kind of the event."""
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
        """What happened, as a sentence."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@disjoint_base
class Trajectory:
    """Joint positions and velocities over time, one row per instant, with events.

    Between its rows it is a curve, given by `sample`, on which limits are checked: the cubic polynomial through
    positions and velocities of both rows (C1: the acceleration may jump at a row), or, where the rows carry
    accelerations, the quintic one through all three (C2).

    Args:
        joint_names: The joints, base to tip.
        t: `(N,)` times, s, increasing.
        q: `(N, n)` joint positions, rad or m.
        qd: `(N, n)` joint velocities, rad/s or m/s; differences of `q` when left out.
        events: Events, in order.
        qdd: `(N, n)` joint accelerations, rad/s^2 or m/s^2.
        section: Per row `lead_in`, `path`, `blend` or `lead_out`.

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
        qdd: ArrayLike | None = None,
        section: Sequence[str] | None = None,
    ) -> Self: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    @staticmethod
    def from_csv(path: str | PathLike[str]) -> Trajectory:
        """Read what `to_csv` writes.

        Args:
            path: The file.
        """
    @staticmethod
    def from_json(path: str | PathLike[str]) -> Trajectory:
        """Read what `to_json` writes, or a ROS `JointTrajectory` as JSON; times to the nanosecond.

        Args:
            path: The file.
        """
    @staticmethod
    def from_npz(path: str | PathLike[str]) -> Trajectory:
        """Read what `to_npz` writes.

        Args:
            path: The file.
        """
    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write `t,<joint>...,<joint>_velocity...`, one line per instant, without the events.

        `<joint>_acceleration...` and `section` follow where the trajectory has them.

        Args:
            path: The file to write.
        """
    def to_json(self, path: str | PathLike[str]) -> None:
        """Write the fields of ROS `JointTrajectory`, and `events` and `section` beside them.

        `accelerations` are written where the trajectory has them.

        Args:
            path: The file to write.
        """
    def to_npz(self, path: str | PathLike[str]) -> None:
        """Write the arrays `joint_names, t, q, qd` and `event_kind, event_index, event_t, event_s, event_message`.

        Args:
            path: The file to write.
        """
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
    def qdd(self) -> NDArray[np.float64] | None:
        """Joint accelerations `(N, n)`, rad/s^2 or m/s^2, where the rows carry them. A copy."""
    @property
    def section(self) -> NDArray[np.str_] | None:
        """Per row `lead_in`, `path`, `blend` or `lead_out` `(N,)`, where that is known. A copy."""
    def joined(self, other: Trajectory) -> Trajectory:
        """This motion and then another that begins where it ends.

        The last row of this one is the first of the other, whose times follow. Accelerations are kept where both
        motions have them.

        Args:
            other: A motion of the same joints; its first row has the positions (within 1e-6 rad or m) and the
                velocities of the last row of this one.

        Returns:
            A trajectory with the rows of both, N + M - 1.

        Raises:
            RedundancyError: Other joints, positions or velocities that differ where the two meet.

        Example:
            >>> import redundancy as rd
            >>> arm = rd.catalog.load("panda")
            >>> a, b = [0, 0.3, 0, -1, 0.2, 1, 0], [0.5, 0.3, 0, -1, 0.2, 1, 0]
            >>> move = rd.joint_move(arm, a, b).joined(rd.joint_move(arm, b, a))
            >>> rd.check(arm, move).ok
            True
        """
    def sample(
        self, t: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Position, velocity, acceleration and jerk of the trajectory's own interpolation.

        Between two rows it is the quintic polynomial through position, velocity and acceleration of both where the
        rows carry accelerations, else the cubic one through position and velocity of both: what ROS's
        `joint_trajectory_controller` makes of the same numbers. The curve passes through the rows exactly. At a row,
        acceleration (of the cubic) and jerk are those of the interval that begins there.

        Args:
            t: Times, s: a number or `(N,)`, from the first row's to the last row's.

        Returns:
            q, qd, qdd, qddd, each `(n,)` or `(N, n)`: rad or m, and per s, s^2, s^3.

        Raises:
            RedundancyError: A time outside of the trajectory or not finite, a trajectory without rows.

        Example:
            >>> import redundancy as rd
            >>> rest = [[0.0], [0.0]]
            >>> move = rd.Trajectory(["a"], [0.0, 2.0], [[0.0], [1.0]], rest, qdd=rest)
            >>> q, qd, qdd, qddd = move.sample(1.0)
            >>> q.tolist(), qd.tolist(), qdd.tolist(), qddd.tolist()
            ([0.5], [0.9375], [0.0], [-3.75])
        """
    @property
    def events(self) -> list[Event]:
        """The events, in order."""
    def __len__(self) -> int: ...

def times_within_limits(
    q: ArrayLike, velocity_limits: ArrayLike, *, velocity_fraction: float = 0.9, smoothing: int = 10
) -> NDArray[np.float64]:
    """Times for joint rows, from 0, such that no joint exceeds a share of its velocity limit.

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
) -> Path:
    """`redundancy.paths.circle` without its defaults."""

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
) -> Path:
    """`redundancy.paths.raster` without its defaults."""

# task

@final
class Task:
    """Which coordinates of the tool's motion count.

    `pose` (6, angular velocity in world axes), `pose_rpy` (6, rates of roll-pitch-yaw, R = Rz(phi) Ry(theta)
    Rx(psi)), `position` (3), `pointing` (5: position and the tool axis, the spin about it is free), `planar` (x, y),
    `planar_pose` (x, y, rotation about z). An argument `task` also accepts a name.

    Args:
        name: One of the names above.

    Raises:
        RedundancyError: An unknown name; the message lists the known ones.

    Example:
        >>> import redundancy as rd
        >>> rd.Task.pointing([0, 1, 0]).dim
        5
    """

    def __new__(cls, name: str) -> Self: ...
    @staticmethod
    def pointing(axis: ArrayLike | None = None) -> Task:
        """Position and the direction of `axis` `(3,)`, given in the tool frame; z by default."""
    @property
    def name(self) -> str:
        """The name of its kind."""
    @property
    def dim(self) -> int:
        """Number of coordinates."""
    @property
    def axis(self) -> list[float]:
        """Tool axis of `pointing`, unit length, tool frame; z for the other tasks."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

# scene

@final
class Sphere:
    """A ball.

    Args:
        center: `(3,)`, m, world axes.
        radius: m, not negative.
        velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
        name: Any text.
        attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
    """

    def __new__(
        cls,
        center: ArrayLike,
        radius: float,
        *,
        velocity: ArrayLike | None = None,
        name: str | None = None,
        attached_to: str | None = None,
    ) -> Self: ...
    @property
    def center(self) -> NDArray[np.float64]:
        """Centre `(3,)`, m."""
    @property
    def radius(self) -> float:
        """Radius, m."""
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity `(3,)`, m/s."""
    @property
    def name(self) -> str | None:
        """Its name."""
    @property
    def attached_to(self) -> str | None:
        """The link that carries it."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Box:
    """A box with any orientation.

    Args:
        pose: Its centre and its axes.
        half_extents: `(3,)`, half of its edge lengths, m.
        velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
        name: Any text.
        attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
    """

    def __new__(
        cls,
        pose: _Pose,
        half_extents: ArrayLike,
        *,
        velocity: ArrayLike | None = None,
        name: str | None = None,
        attached_to: str | None = None,
    ) -> Self: ...
    @property
    def pose(self) -> NDArray[np.float64]:
        """Centre and axes `(4, 4)`."""
    @property
    def half_extents(self) -> NDArray[np.float64]:
        """Half of its edge lengths `(3,)`, m."""
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity `(3,)`, m/s."""
    @property
    def name(self) -> str | None:
        """Its name."""
    @property
    def attached_to(self) -> str | None:
        """The link that carries it."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Capsule:
    """All points within `radius` of a segment.

    Args:
        start: `(3,)`, m, world axes.
        end: `(3,)`, m.
        radius: m, not negative.
        velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
        name: Any text.
        attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
    """

    def __new__(
        cls,
        start: ArrayLike,
        end: ArrayLike,
        radius: float,
        *,
        velocity: ArrayLike | None = None,
        name: str | None = None,
        attached_to: str | None = None,
    ) -> Self: ...
    @property
    def start(self) -> NDArray[np.float64]:
        """One end of the segment `(3,)`, m."""
    @property
    def end(self) -> NDArray[np.float64]:
        """The other end `(3,)`, m."""
    @property
    def radius(self) -> float:
        """Radius, m."""
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity `(3,)`, m/s."""
    @property
    def name(self) -> str | None:
        """Its name."""
    @property
    def attached_to(self) -> str | None:
        """The link that carries it."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Cylinder:
    """A cylinder with any orientation.

    Args:
        pose: Its centre and its axes; z is the axis of the cylinder.
        radius: m, not negative.
        half_length: Half of its length, m, not negative.
        velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
        name: Any text.
        attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
    """

    def __new__(
        cls,
        pose: _Pose,
        radius: float,
        half_length: float,
        *,
        velocity: ArrayLike | None = None,
        name: str | None = None,
        attached_to: str | None = None,
    ) -> Self: ...
    @property
    def pose(self) -> NDArray[np.float64]:
        """Centre and axes `(4, 4)`; z is the axis of the cylinder."""
    @property
    def radius(self) -> float:
        """Radius, m."""
    @property
    def half_length(self) -> float:
        """Half of its length, m."""
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity `(3,)`, m/s."""
    @property
    def name(self) -> str | None:
        """Its name."""
    @property
    def attached_to(self) -> str | None:
        """The link that carries it."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class HalfSpace:
    """Everything on one side of a plane: a floor, a wall.

    Args:
        point: `(3,)`, a point of the plane, m, world axes.
        normal: `(3,)`, away from the solid side; its length does not matter.
        velocity: `(3,)`, m/s, of a moving one.
        name: Any text.
    """

    def __new__(
        cls,
        point: ArrayLike,
        normal: ArrayLike,
        *,
        velocity: ArrayLike | None = None,
        name: str | None = None,
    ) -> Self: ...
    @property
    def point(self) -> NDArray[np.float64]:
        """A point of the plane `(3,)`, m."""
    @property
    def normal(self) -> NDArray[np.float64]:
        """Unit vector `(3,)` away from the solid side."""
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity `(3,)`, m/s."""
    @property
    def name(self) -> str | None:
        """Its name."""
    @property
    def attached_to(self) -> str | None:
        """The link that carries it."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Mesh:
    """Triangles.

    A closed convex mesh is its own hull. For any other mesh, `solid` chooses: `"exact"` (its triangles and, if it is
    closed, the volume inside), `"hull"` (its convex hull), or `"decompose"` (convex pieces that together contain its
    surface; this takes seconds the first time).

    Args:
        vertices: `(V, 3)`, m.
        faces: `(F, 3)`, vertex indices from 0.
        pose: Pose of the frame in which the vertices are given.
        solid: `exact`, `hull` or `decompose`.
        velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
        name: Any text.
        attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.

    Raises:
        RedundancyError: No face, an index that is no vertex, a vertex that is not finite.

    Example:
        >>> import redundancy as rd
        >>> wedge = rd.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> wedge.pieces
        1
    """

    def __new__(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        pose: _Pose | None = None,
        solid: Literal["exact", "hull", "decompose"] = "exact",
        velocity: ArrayLike | None = None,
        name: str | None = None,
        attached_to: str | None = None,
    ) -> Self: ...
    @staticmethod
    def from_file(
        path: str | PathLike[str],
        *,
        scale: float = 1.0,
        pose: _Pose | None = None,
        solid: Literal["exact", "hull", "decompose"] = "exact",
        velocity: ArrayLike | None = None,
        name: str | None = None,
        attached_to: str | None = None,
    ) -> Mesh:
        """From an STL, OBJ or DAE file.

        Args:
            path: The file.
            scale: Factor that converts its coordinates to m.
            pose: Pose of the frame of its coordinates.
            solid: As for the class.
            velocity: `(3,)`, m/s, of a moving obstacle.
            name: For reports and `allowed`.
            attached_to: Link that carries it.

        Raises:
            RedundancyError: A file that cannot be read or is broken, numbers that are not finite.
        """
    @property
    def vertices(self) -> NDArray[np.float64]:
        """Vertices `(V, 3)` in its own coordinates, m."""
    @property
    def faces(self) -> NDArray[np.uint32]:
        """Vertex indices of its triangles `(F, 3)`."""
    @property
    def pose(self) -> NDArray[np.float64]:
        """Pose `(4, 4)` of the frame of its coordinates."""
    @property
    def solid(self) -> Literal["exact", "hull", "decompose"]:
        """How it counts: `"exact"`, `"hull"` or `"decompose"`."""
    @property
    def pieces(self) -> int:
        """Number of convex pieces; 0 for `"exact"`."""
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity `(3,)`, m/s."""
    @property
    def name(self) -> str | None:
        """Its name."""
    @property
    def attached_to(self) -> str | None:
        """The link that carries it."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

_Obstacle: TypeAlias = Sphere | Box | Capsule | Cylinder | HalfSpace | Mesh

@final
class Scene:
    """Obstacles in the world, and pairs of names that may touch. Immutable.

    Args:
        obstacles: Any number of `Sphere`, `Box`, `Capsule`, `Cylinder`, `HalfSpace` and `Mesh`.
        allowed: Pairs of names that may touch: an obstacle, and a link or an obstacle that a link carries. Contact
            between them is ignored.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("pa10")  # stretched upwards at q = 0, elbow at z = .765
        >>> scene = rd.Scene([rd.Sphere((0.0, 0.3, 0.9), radius=0.1)])
        >>> near = scene.clearance(arm, [0.0] * 7, link_radius=0.05)
        >>> round(near.distance, 12), near.link, near.obstacle
        (0.15, 'link5', 0)
    """

    def __new__(
        cls,
        obstacles: Iterable[_Obstacle] | None = None,
        *,
        allowed: Iterable[tuple[str, str]] | None = None,
    ) -> Self: ...
    @staticmethod
    def from_json(path: str | PathLike[str]) -> Scene:
        """From a file: `{"obstacles": [{"type": "sphere", "center": [..], "radius": ..}, ...], "allowed": [[.., ..]]}`.

        | type | numbers |
        |---|---|
        | `sphere` | `center`, `radius` |
        | `box` | `center`, `half_extents`, `quaternion_wxyz` |
        | `capsule` | `start`, `end`, `radius` |
        | `cylinder` | `center`, `radius`, `half_length`, `quaternion_wxyz` |
        | `half_space` | `point`, `normal` |
        | `mesh` | `vertices` and `faces`, or `file` (from the scene's folder); `solid`, `center`, `quaternion_wxyz` |

        Any may have a `name`, and a `velocity` or `attached_to`. Quaternions, `allowed`, and `solid` and `center` of a
        mesh may be left out.

        Args:
            path: The file.

        Raises:
            RedundancyError: An unknown type or key, a missing or wrong number; it names the obstacle.
        """
    @staticmethod
    def from_json_string(text: str) -> Scene:
        """From JSON text; mesh files are relative to the current folder."""
    def to_json(self) -> str:
        """The scene as JSON text that `from_json` reads; meshes are written with their triangles."""
    @property
    def obstacles(self) -> list[_Obstacle]:
        """The obstacles."""
    @property
    def allowed(self) -> list[tuple[str, str]]:
        """Pairs of names that may touch."""
    def at(self, t: float) -> Scene:
        """The scene at time `t` (s), with moving obstacles at their positions at that time."""
    def clearance(
        self,
        chain: Chain,
        q: ArrayLike,
        link_radius: float | LinkGeometry | None = 0.05,
        *,
        links: LinkGeometry | float | None = None,
        threads: int | None = None,
    ) -> ClearanceResult:
        """The nearest pair of a link and an obstacle, and the nearest obstacle of each link.

        Links are capsules from joint to joint and from the last joint to the tool, or what `links` says. Links that
        do not move count if `links` has shapes for them. Obstacles that a link carries count as part of it against
        other obstacles, and as obstacles for the other links.

        Args:
            chain: The arm.
            q: `(n,)` or `(N, n)`.
            link_radius: Of the capsules from joint to joint, m; or a `LinkGeometry` of this chain.
            links: Another name of `link_radius`.
            threads: Threads for a batch; all cores by default.

        Raises:
            RedundancyError: A name in `allowed` that is neither a link nor an obstacle, an `attached_to` that is no
                link.
        """
    def __len__(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class LinkGeometry:
    """The body of an arm: the shapes of its links, and the pairs of links that must not touch. Immutable.

    Capsules of one radius from joint to joint and from the last joint to the tool, or the collision geometry of a
    URDF; more shapes can be added (a tool, a hose, a camera). It is accepted by every argument `links` or
    `link_radius`.

    The pairs of capsules are those that are apart in the middle of the joints' ranges and do not overlap in more than
    95 % of 1 000 seeded configurations.

    Args:
        chain: The arm.
        radius: Of the capsules, m, >= 0.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("pa10")
        >>> gripper = rd.LinkGeometry(arm, 0.05).with_capsule("link7", [0, 0, 0], [0, 0, 0.2], 0.04)
        >>> scene = rd.Scene([rd.Sphere([0.0, 0.3, 0.765], 0.1)])
        >>> round(scene.clearance(arm, [0.0] * 7, gripper).distance, 12)
        0.15
    """

    def __new__(cls, chain: Chain, radius: float = 0.05) -> Self: ...
    @staticmethod
    def from_urdf(
        chain: Chain,
        path: str | PathLike[str],
        meshes: Literal["hull", "decompose", "refuse"] = "hull",
        package_dirs: Sequence[str | PathLike[str]] = (),
        srdf: str | PathLike[str] | None = None,
        padding: float = 0.0,
        posture: Mapping[str, float] | None = None,
    ) -> LinkGeometry:
        """The collision geometry of a URDF file: spheres, capsules, cylinders, boxes and meshes (STL, OBJ, DAE).

        Includes links that move with the chain, links that stand still (a torso, a pedestal), links beyond the tip,
        and links on joints outside of the chain (fingers, a head).

        Args:
            chain: The chain that was read from it, or one with links of the same names.
            path: The file.
            meshes: How meshes are read: `"hull"` as their convex hull, `"decompose"` as convex pieces, `"refuse"` as
                an error.
            package_dirs: Folders in which packages are searched for mesh files named `package://<package>/...` (a
                folder may also be the package itself), and for relative names. After them `ROS_PACKAGE_PATH`,
                `AMENT_PREFIX_PATH` and the folders above the file are searched.
            srdf: A file whose `disable_collisions` name the links that may touch. Without it the pairs are found by
                sampling: pairs of links are left out if a joint connects them, if they touch in more than 95 % of 10
                000 seeded configurations, or if they never come nearer than 20 mm in them.
            padding: Distance by which every shape is enlarged, m.
            posture: Positions of joints outside of the chain (rad or m); joints that are not named take the position
                nearest to 0 within their limits, or follow the joint that they mimic.

        Raises:
            RedundancyError: A file that is no URDF or SRDF, none of its links in the chain, no collision geometry, an
                unknown shape, a size that is not positive, an unknown joint; a mesh that is broken, or missing:
                the message names it and the places searched.
        """
    @staticmethod
    def from_urdf_string(
        chain: Chain,
        xml: str,
        meshes: Literal["hull", "decompose", "refuse"] = "hull",
        package_dirs: Sequence[str | PathLike[str]] = (),
        srdf: str | PathLike[str] | None = None,
        padding: float = 0.0,
        posture: Mapping[str, float] | None = None,
    ) -> LinkGeometry:
        """The same from the text of a URDF; see `from_urdf`.

        Args:
            chain: The chain that was read from it, or one with links of the same names.
            xml: The text.
            meshes: As for `from_urdf`, like all arguments that follow.
            package_dirs: As for `from_urdf`.
            srdf: As for `from_urdf`.
            padding: As for `from_urdf`, m.
            posture: As for `from_urdf`, rad or m.
        """
    def with_capsule(self, link: str, start: ArrayLike, end: ArrayLike, radius: float) -> LinkGeometry:
        """With one more capsule.

        Args:
            link: Name of a moving link.
            start: `(3,)` one end in the frame of that link, m.
            end: `(3,)` the other end, m.
            radius: m, >= 0.
        """
    def with_shape(self, link: str, shape: _Obstacle, pose: _Pose | None = None) -> LinkGeometry:
        """With one more shape: a tool, a hose, a camera.

        For a link that had no shape before, the pairs are found by sampling. A mesh counts as its hull or its convex
        pieces.

        Args:
            link: Name of a link of the chain.
            shape: A shape, in the coordinates of the frame `pose`.
            pose: Pose of the shape's coordinates in the frame of the link; the link's frame by default.
        """
    def allow(self, first: str, second: str) -> LinkGeometry:
        """Without this pair of links: they may touch.

        Args:
            first: Name of a link.
            second: Name of the other one.
        """
    @property
    def names(self) -> list[str]:
        """Names of the links that have shapes."""
    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Pairs of links that must not touch."""
    @property
    def left_out(self) -> list[tuple[str, str, str]]:
        """Pairs of links that are not checked, and why: Adjacent, Always, Never, Default, User."""
    def to_srdf(self) -> str:
        """The pairs that are not checked, as the text of an SRDF file."""
    def self_clearance(
        self, q: ArrayLike, cutoff: float | None = None, *, threads: int | None = None
    ) -> SelfClearanceResult:
        """Least distance between links.

        Args:
            q: `(n,)` or `(N, n)`.
            cutoff: Distances above this one are not computed, which is faster, m. No cutoff by default.
            threads: Threads for a batch; all cores by default.
        """
    def pair_clearances(
        self, q: ArrayLike, cutoff: float | None = None, *, threads: int | None = None
    ) -> PairClearances:
        """All pairs of links that are nearer than the cutoff, with gradients.

        Args:
            q: `(n,)` or `(N, n)`.
            cutoff: m; all pairs when left out.
            threads: Threads for a batch; all cores by default.
        """
    @property
    def capsules(self) -> list[tuple[str, float]]:
        """Name of the link and radius (m) of each capsule and sphere."""
    def __len__(self) -> int: ...
    @staticmethod
    def _from_parts(chain: Chain, text: str) -> LinkGeometry: ...

@final
class PairClearances:
    """All pairs of links within the cutoff, as arrays."""

    @property
    def row(self) -> NDArray[np.int64]:
        """The configuration of each pair `(k,)`, from 0."""
    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Names of the two links."""
    @property
    def distance(self) -> NDArray[np.float64]:
        """Signed distances `(k,)`, m, of the nearest shapes of the two links."""
    @property
    def gradient(self) -> NDArray[np.float64]:
        """Their derivatives by the joints `(k, n)`."""
    def __len__(self) -> int: ...
    @staticmethod
    def _from_parts(
        row: list[int],
        pairs: list[tuple[str, str]],
        distance: list[float],
        gradient: list[float],
        n: int,
    ) -> PairClearances: ...

@final
class SelfClearanceResult:
    """Least distance between links of an arm: for one configuration, or arrays for N of them."""

    @property
    def distance(self) -> Any:
        """The least signed distance, m: negative if links overlap; the cutoff if all are farther apart."""
    @property
    def first(self) -> Any:
        """Name of one of the two links (a list for a batch); `None` beyond the cutoff."""
    @property
    def second(self) -> Any:
        """Name of the other one."""
    @property
    def gradient(self) -> NDArray[np.float64]:
        """Derivative of the distance by the joints, `(n,)` or `(N, n)`; zero beyond the cutoff."""
    @staticmethod
    def _from_parts(
        rows: list[tuple[float, tuple[int, int] | None, list[float]]], names: list[str], batch: bool
    ) -> SelfClearanceResult: ...

@final
class ClearanceResult:
    """Distances of an arm from a scene: for one configuration, or arrays for N of them."""

    @property
    def distance(self) -> Any:
        """Signed distance, m: negative in a collision; `(N,)` for a batch. Infinite for an empty scene."""
    @property
    def link(self) -> Any:
        """Name of the nearest link (a list for a batch); `None` for an empty scene."""
    @property
    def obstacle(self) -> Any:
        """Index of the nearest obstacle in the scene (a list for a batch); `None` for an empty scene."""
    @property
    def on_link(self) -> Any:
        """The nearest point of the link's surface, `(3,)` or `(N, 3)`, m; `None` for an empty scene."""
    @property
    def on_obstacle(self) -> Any:
        """The nearest point of the obstacle's surface."""
    @property
    def normal(self) -> Any:
        """Unit vector from the obstacle to the link."""
    @property
    def by_link(self) -> dict[str, ClearanceResult]:
        """The nearest obstacle of each link, by its name."""
    def __float__(self) -> float: ...

# criterion

@disjoint_base
class Criterion:
    """A scalar function of the configuration, with gradient and Hessian.

    Sums (`a + b`, of equal senses) and multiples (`2.0 * a`; `-a` has the opposite sense) are criteria.
    """

    @property
    def dof(self) -> int | None:
        """Number of joints n; None where it fits any number."""
    @property
    def sense(self) -> Literal["minimize", "maximize"]:
        """`"minimize"` or `"maximize"`."""
    @overload
    def value(self, q: _Vector) -> float: ...
    @overload
    def value(self, q: ArrayLike) -> Any:
        """h(q) for `(n,)`, or `(N,)` values for `(N, n)`."""
    def gradient(self, q: ArrayLike) -> NDArray[np.float64]:
        """dh/dq, `(n,)` or `(N, n)`; per rad or m.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
        """
    def hessian(self, q: ArrayLike) -> NDArray[np.float64]:
        """d2h/dq2, `(n, n)` or `(N, n, n)`.

        Args:
            q: Joint positions `(n,)` or `(N, n)`, rad or m.
        """
    def __add__(self, other: Criterion, /) -> Criterion: ...
    def __radd__(self, other: Criterion, /) -> Criterion: ...
    def __mul__(self, factor: float, /) -> Criterion: ...
    def __rmul__(self, factor: float, /) -> Criterion: ...
    def __neg__(self) -> Criterion: ...

@final
class JointRange(Criterion):
    """Distance from the middle of the joint ranges, to be minimised.

    `1/(2n) sum ((q_i - c_i) / (upper_i - lower_i))^2` (Bettini, De Luca, Oriolo 2000, eq. 6). Joints without limits
    do not count; n is the number of all joints.

    Args:
        chain: The arm; joints without two finite limits do not count.

    Example:
        >>> import redundancy as rd
        >>> rd.JointRange(rd.catalog.load("iiwa14")).value([0.0] * 7)
        0.0
    """

    def __new__(cls, chain: Chain) -> Self: ...

@final
class Manipulability(Criterion):
    """Distance from singularities, to be maximised: `det(J J^T)` of a task, or its square root.

    Gradient and Hessian of the determinant are exact everywhere, at singular configurations too. Where the root is
    zero, it has no derivatives, and zeros are returned.

    Args:
        chain: The arm.
        task: Which coordinates count, by name or as a `Task`: `"pose"`, `"pose_rpy"`, `"position"`, `"pointing"`,
            `"planar"`, `"planar_pose"`. Metres and radians are not weighted.
        measure: `"det"` or `"sqrt"`.

    Example:
        >>> import redundancy as rd
        >>> h = rd.Manipulability(rd.catalog.load("planar3r"), task="planar")
        >>> h.sense, abs(h.value([0.0, 0.0, 0.0])) < 1e-9, h.value([0.0, 1.0, 1.0]) > 1.0
        ('maximize', True, True)
    """

    def __new__(cls, chain: Chain, task: str | Task | None = None, measure: str = "det") -> Self: ...

@final
class Posture(Criterion):
    """Distance from a reference configuration, to be minimised: `1/2 sum w_i (q_i - q_ref_i)^2`.

    Args:
        chain: The arm.
        q_ref: `(n,)`, rad or m. Joint values are compared as they are, so a whole turn counts as a large distance.
        weights: `(n,)`, not negative; 1 by default.
    """

    def __new__(cls, chain: Chain, q_ref: ArrayLike, weights: ArrayLike | None = None) -> Self: ...

# velocity

_Damping: TypeAlias = Damping | Literal["auto"] | None
_Task: TypeAlias = Task | str

@final
class Damping:
    """Damped least squares with a separate factor for each singular value (Bettini et al. 2000, section 4.3).

    `1/sigma` becomes `sigma / (sigma^2 + lambda^2)`, lambda rising smoothly from 0 at `threshold` to `maximum` at
    `rho * threshold`. The paper's constants are `Damping(0.1, 0.2, 0.25)`; `"auto"` is `Damping(0.02, 0.04, 0.25)`:
    the task is met exactly where the least singular value (units of metres and radians) is 0.04 or more.

    Args:
        maximum: Largest damping factor, > 0.
        threshold: Singular values from here on are not damped, > 0.
        rho: Share of the threshold below which the damping is full, in [0, 1).
    """

    def __new__(cls, maximum: float, threshold: float, rho: float) -> Self: ...
    @property
    def maximum(self) -> float:
        """Largest damping factor, in the unit of the singular values."""
    @property
    def threshold(self) -> float:
        """Singular values from here on, in the unit of the task Jacobian, are not damped."""
    @property
    def rho(self) -> float:
        """Share of the threshold below which the damping is full."""
    def square(self, sigma: float) -> float:
        """Squared damping factor of the singular value `sigma`."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class Step:
    """Result of one step of a velocity scheme."""

    @property
    def qd(self) -> NDArray[np.float64]:
        """Joint velocity `(n,)`, rad/s or m/s."""
    @property
    def status(self) -> Status:
        """`converged`; `singular` or `limits` if damping (or a lost rank), or limits, kept the task from being met."""
    @property
    def scale(self) -> float:
        """Share of the task velocity that is realised, 1 or less."""
    @property
    def damping(self) -> float:
        """Largest damping factor that acted, in the unit of the singular values; 0 for none."""
    @property
    def residual(self) -> float:
        """`|J qd - scale v|` in m/s and rad/s, 0 up to rounding unless the status says otherwise."""
    @property
    def basis_changed(self) -> bool:
        """Whether a change of the reduced gradient's basis began."""
    @property
    def algorithmic(self) -> bool:
        """Whether the condition of the extended Jacobian, not the task Jacobian, lost rank."""
    @property
    def active_limits(
        self,
    ) -> list[tuple[str, Literal["position", "velocity", "acceleration"], Literal["lower", "upper"]]]:
        """Active limits: name of the joint, which limit, which side."""
    @property
    def limiting_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs that limited the step: names of a link and of an obstacle or link, and their distance, m."""
    @property
    def sigma_min(self) -> float:
        """Least singular value of the task Jacobian (unit: m or 1 by its rows), exact; computed when asked for."""

@final
class AccelerationStep:
    """Result of one step at acceleration level."""
    @property
    def qdd(self) -> NDArray[np.float64]:
        """Joint acceleration `(n,)`, rad/s^2 or m/s^2."""
    @property
    def status(self) -> Status:
        """`converged`; `singular` if damping (or a lost rank) kept the task from being met."""
    @property
    def damping(self) -> float:
        """Largest damping factor that acted, in the unit of the singular values; 0 for none."""
    @property
    def residual(self) -> float:
        """`|J qdd + Jdot qd - a|` in m/s^2 and rad/s^2, 0 up to rounding unless the status says otherwise."""
    @property
    def basis_changed(self) -> bool:
        """Whether the reduced gradient changed its basis."""
    @staticmethod
    def _make(
        qdd: Sequence[float], status: str, damping: float, residual: float, basis_changed: bool
    ) -> AccelerationStep: ...

@disjoint_base
class Resolver:
    """A scheme that computes a joint velocity from a task velocity, step by step.

    A step allocates nothing in the core. A resolver may be shared by threads; the reduced gradient keeps its basis
    from step to step.
    """

    def step(
        self,
        q: ArrayLike,
        task_velocity: ArrayLike,
        dt: float | None = None,
        qd: ArrayLike | None = None,
        wish: ArrayLike | None = None,
        *,
        t: float = 0.0,
    ) -> Step:
        """One step.

        Args:
            q: Joint positions `(n,)`, rad or m.
            task_velocity: As many numbers as the task has coordinates, m/s and rad/s; six for `pointing`, whose
                spin about the tool axis does not count.
            dt: Length of the step, s; needed for limits and for the optimal gain.
            qd: Joint velocity before the step `(n,)`; without it acceleration is not limited.
            wish: Joint velocity `(n,)`, rad/s or m/s, that the freedom is used for in place of the criterion's
                gradient; neither criterion nor gain counts then.
            t: Time, s, for obstacles that move.

        Raises:
            RedundancyError: Wrong sizes, numbers that are not finite, `dt` that is not positive or is missing. An
                exception of a `CustomCriterion` is raised as it is.
        """
    def step_acceleration(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        task_acceleration: ArrayLike,
        dt: float | None = None,
        wish: ArrayLike | None = None,
    ) -> AccelerationStep:
        """One step of a scheme with `level="acceleration"`: `J qdd + Jdot qd = task_acceleration`.

        Args:
            q: Joint positions `(n,)`, rad or m.
            qd: Joint velocity `(n,)`.
            task_acceleration: As many numbers as a task velocity, m/s^2 and rad/s^2 (base axes): of the tool's origin
                and of its angular velocity; for `pose_rpy` the second derivatives of the angles.
            dt: Length of the step, s; only a `schedule` needs it.
            wish: Joint velocity `(n,)` that the null-space motion approaches in place of the criterion's gradient.

        Raises:
            RedundancyError: A scheme of the velocity level, wrong sizes, numbers that are not finite.
        """
    @property
    def level(self) -> Literal["velocity", "acceleration"]:
        """`"velocity"` or `"acceleration"`."""
    @property
    def chain(self) -> Chain:
        """The chain that it was made for."""
    @property
    def task(self) -> Task:
        """Which coordinates count."""
    @property
    def basis(self) -> list[int]:
        """Dependent joints of the last step, from 0; empty for schemes that have none."""
    def jacobian(self, q: ArrayLike) -> NDArray[np.float64]:
        """The Jacobian in whose coordinates the scheme solves.

        Args:
            q: Joint positions `(n,)`, rad or m.

        Returns:
            `(m, n)`: that of the task; with `frame=` the one about the origin and in the axes of that link (Bettini,
            De Luca, Oriolo 2000, eq. 7). Its singular values determine the damping and the choice of a basis.

        Raises:
            RedundancyError: A wrong size, or numbers that are not finite.
        """
    @property
    def frame(self) -> str | None:
        """The link in whose frame the scheme works; None for the coordinates of the task."""

@final
class ProjectedGradient(Resolver):
    """Projected gradient (Bettini, De Luca, Oriolo 2000, eq. 2): `qd = J^+ v + (I - J^+ J) eta`.

    `eta` is the gain times the gradient of the criterion, with minus for one to be minimised and plus for one to be
    maximised. Near singularities J^+ is damped; the projector stays exact, so the null-space motion never moves the
    tool.

    Args:
        chain: The arm.
        criterion: Objective for the freedom; None for the least joint velocity.
        gain: Joint velocity per unit of the gradient, >= 0, or `"optimal"`: the step with the best value of the
            criterion after `dt` within position and velocity limits (section 4.4).
        task: Which coordinates count; `pose` by default.
        damping: `"auto"`, a `Damping`, or None for off.
        frame: Name of a link. The six coordinates of `pose` or `pose_rpy` are then transformed internally to its axes
            and origin (eq. 7), so that damping acts on the singular values of that Jacobian. Velocities and task
            errors are given as before.
        level: `"velocity"`, or `"acceleration"`: then `step_acceleration` gives
            `qdd = J^+ (a - Jdot qd) + (I - J^+ J) velocity_gain (eta - qd)`, and joint velocities have no jumps.
        velocity_gain: Rate, 1/s, at which the acceleration level approaches the joint velocity of the velocity level.
        inverse: `"pseudo"`: the least joint velocity (or acceleration). `"inertia"`: the least kinetic energy, with the
            mass matrix M in `M^-1 J^T (J M^-1 J^T)^-1`; at acceleration level this is Khatib's dynamically consistent
            inverse, whose null-space motion exerts no force on the tool. The projector changes with it.
        weights: `(n,)`, positive: the least `sum w_i qd_i^2`, for `inverse="pseudo"`.

    Raises:
        RedundancyError: A task with more coordinates than joints, a criterion of another arm, a gain that is negative
            or not finite, an unknown link, a `frame` for another task.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("iiwa14")
        >>> scheme = rd.ProjectedGradient(arm, rd.JointRange(arm), 10.0)
        >>> q = [0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4]
        >>> bool(abs(arm.jacobian(q) @ scheme.step(q, [0.0] * 6).qd).max() < 1e-12)
        True
    """

    def __new__(
        cls,
        chain: Chain,
        criterion: Criterion | None,
        gain: float | Literal["optimal"],
        task: _Task | None = None,
        damping: _Damping = "auto",
        *,
        frame: str | None = None,
        level: Literal["velocity", "acceleration"] = "velocity",
        velocity_gain: float = 10.0,
        inverse: Literal["pseudo", "inertia"] = "pseudo",
        weights: ArrayLike | None = None,
    ) -> Self: ...

@final
class ReducedGradient(Resolver):
    """Reduced gradient (Bettini, De Luca, Oriolo 2000, eq. 4).

    The dependent joints follow the task, the others the reduced gradient; at equal gain this converges faster than
    the projected gradient. Without `basis` the dependent joints are chosen automatically, and exchanged before their
    Jacobian becomes singular (with hysteresis, blended over three steps, and reported).

    Args:
        chain: The arm.
        criterion: As for `ProjectedGradient`.
        gain: As for `ProjectedGradient`.
        task: Which coordinates count; `pose` by default.
        damping: As for `ProjectedGradient`; acts only where no basis is well conditioned.
        basis: Dependent joints, from 0, as many as the task has coordinates; they are then kept. The paper's DEXTER
            with "columns 2 and 7 deleted" is `(0, 2, 3, 4, 5, 7)`.
        frame: As for `ProjectedGradient`: the paper's DEXTER works in `"link4"`.
        form: `"robust"`: the null-space motion never moves the tool. `"paper"`: eq. 4 as printed, with the damped
            inverse also in `J_R`, so that under damping it does.
        schedule: `[(time, basis), ...]`: other bases from these times on, s, counted from the first step, each blended
            over three steps and reported. Needs `basis` for the start, and `dt` in every step.
        level: `"velocity"`, or `"acceleration"`: then `step_acceleration` gives joint accelerations; the independent
            joints accelerate by `velocity_gain` times what they lack of the reduced gradient. A change of basis changes
            the acceleration, and joint velocities have no jumps.
        velocity_gain: That rate, 1/s.

    Raises:
        RedundancyError: As for `ProjectedGradient`; a basis of another size, with a repeated joint or one that does
            not exist; a schedule without `basis`, or whose times do not ascend; an unknown form.
    """

    def __new__(
        cls,
        chain: Chain,
        criterion: Criterion | None,
        gain: float | Literal["optimal"],
        task: _Task | None = None,
        damping: _Damping = "auto",
        basis: Sequence[int] | None = None,
        *,
        frame: str | None = None,
        form: Literal["robust", "paper"] = "robust",
        schedule: Sequence[tuple[float, Sequence[int]]] | None = None,
        level: Literal["velocity", "acceleration"] = "velocity",
        velocity_gain: float = 10.0,
    ) -> Self: ...

@final
class ExtendedJacobian(Resolver):
    """Extended Jacobian (Park, Chung, Youm 1996, eq. 5): the freedom is used to keep the criterion stationary.

    Started at a stationary point it follows that point, so closed paths are cyclic. The task has priority: where the
    condition loses rank (an algorithmic singularity), only the null-space motion is damped, and this is reported.

    Args:
        chain: The arm.
        criterion: A criterion with a Hessian.
        task: Which coordinates count; `pose` by default.
        gain: Rate, 1/s, at which the arm approaches the stationary point.
        damping: As for `ProjectedGradient`.
    """

    def __new__(
        cls,
        chain: Chain,
        criterion: Criterion,
        task: _Task | None = None,
        *,
        gain: float = 10.0,
        damping: _Damping = "auto",
    ) -> Self: ...

@final
class SaturatedNullspace(Resolver):
    """Hard limits: the largest scale of the task velocity within the limits, then the best null-space motion.

    Saturation in the null space in its optimal form (Flacco, De Luca, Khatib 2015). Position limits (with the
    distance that braking takes), velocity limits and, when `step` gets `qd`, acceleration limits of the chain hold at
    every step of length `dt`; if they contradict each other, position has priority over velocity, and velocity over
    acceleration. A joint outside its limits is brought back. If no scale is feasible, because joints have to brake,
    the scale is 0 and the tool moves as closely to the task velocity as the bounds allow. Among the joint velocities
    with the largest scale, the one nearest to the gain times the gradient of the criterion is taken.

    With `scene` or `links` distances are hard bounds too: for a pair at distance d with gradient g `g . qd >=
    -min(alpha (d - safe_distance), sqrt(2 a_d (d - safe_distance))) - dd/dt`, alpha the barrier rate (at most
    `1 / dt`), a_d the deceleration along g that the acceleration limits allow, dd/dt the change due to the obstacle's
    own motion. Below the safe distance only the first term counts, which moves the pair apart. If bounds contradict
    each other, position has priority, then distances, velocity, acceleration. `Step.limiting_pairs` says which pairs
    limited a step.

    Args:
        chain: The arm with its limits.
        criterion: Objective for the freedom; None for the least joint velocity.
        gain: Joint velocity per unit of the gradient, >= 0.
        task: Which coordinates count; `pose` by default.
        damping: As for `ProjectedGradient`; off by default, because near singularities the task is scaled.
        when_blocked: What becomes of a task that no scale above zero realises within the limits. `"stop"`: the tool
            stops (unless a joint has to brake). `"closest"`: it moves with the least task error `|J qd - v|` that the
            limits allow, among those joint velocities with the one nearest to the null-space wish; `scale` is 0 and
            `residual` that error.
        scene: Obstacles to keep a distance from.
        links: Shapes of the links; capsules of 0.05 m from joint to joint when left out.
        safe_distance: Distance that is kept, m.
        barrier_rate: Largest rate at which the remaining distance to it may shrink, 1/s.
        self_collision: Whether links keep a distance from each other; `"auto"`: if `links` has pairs.
    """

    def __new__(
        cls,
        chain: Chain,
        criterion: Criterion | None = None,
        gain: float = 1.0,
        task: _Task | None = None,
        damping: _Damping = None,
        *,
        when_blocked: Literal["stop", "closest"] = "stop",
        scene: Scene | None = None,
        links: LinkGeometry | None = None,
        safe_distance: float = 0.02,
        barrier_rate: float = 5.0,
        self_collision: bool | Literal["auto"] = "auto",
    ) -> Self: ...

_Level: TypeAlias = tuple[Any, ...] | Sequence[Any]

@final
class PrioritizedNullspace:
    """Several tasks with strict priorities within hard limits.

    Level by level: the largest scale in [0, 1] of that task's velocity that the limits and the tasks above allow, then
    the next; last the joint velocity nearest to the wish. All problems are solved exactly; a step allocates nothing in
    the core. Limits are those of `SaturatedNullspace`: position (with the distance that braking takes), velocity and,
    when `step` gets `qd`, acceleration.

    - Where the tasks above leave a task less freedom than it has coordinates, it is met as nearly as they allow (least
      squares): the elbow's position below a full pose moves the elbow along its circle. `residuals` says what is
      missing.
    - Where no scale is possible (joints have to brake), the scale is 0 and the task error the least within the limits.
    - Half-spaces and cones are inequalities. For a distance d from the bound (m or rad) it shrinks at most by
      `min(barrier_rate d, sqrt(2 a_d d))` per s, a_d the deceleration that the acceleration limits allow; beyond the
      bound it shrinks at the barrier rate. They have no velocity.

    Args:
        chain: The arm with its limits, or an arm object.
        tasks: The first has the highest priority. `(task, link)` with the name of a task or a `Task`, and the name of a
            link or None for the tool: velocities are those of that frame, base axes.
            `("half_space", link, point, normal)`: the origin of the link stays on the side of the plane through `point`
            (m) to which `normal` points, base axes. `("cone", link, axis, direction, half_angle)`: `axis`, a direction
            in the link's frame, stays within `half_angle` (rad) of `direction`, base axes.
        criterion: The wish is the gain times its gradient; None for the least joint velocity.
        gain: Joint velocity per unit of the gradient, >= 0.
        barrier_rate: How fast the distance from the bound of an inequality may shrink, 1/s; at most `1 / dt` counts.

    Raises:
        RedundancyError: No task, an unknown task or link, a cone or plane without direction, a criterion of another
            arm.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("iiwa14")
        >>> scheme = rd.PrioritizedNullspace(arm, [("position", None), ("position", "link_4")])
        >>> q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4]
        >>> scheme.step(q, [[0.1, 0, 0], [0, 0, 0.05]], 0.01).scales
        array([1., 1.])
    """
    def __new__(
        cls,
        chain: Chain | SrsArm,
        tasks: Sequence[_Level],
        *,
        criterion: Criterion | None = None,
        gain: float = 1.0,
        barrier_rate: float = 5.0,
    ) -> Self: ...
    def step(
        self,
        q: ArrayLike,
        velocities: Sequence[ArrayLike | None],
        dt: float,
        qd: ArrayLike | None = None,
        wish: ArrayLike | None = None,
    ) -> PriorityStep:
        """One step.

        Args:
            q: Joint positions `(n,)`, rad or m.
            velocities: One entry for each task: its velocity, m/s and rad/s, with as many numbers as it has coordinates
                (six for `pointing`); None for inequalities. Inequalities may also be left out altogether.
            dt: Length of the step, s.
            qd: Joint velocity before the step `(n,)`; without it acceleration is not limited.
            wish: Joint velocity `(n,)` in place of the criterion's gradient.

        Raises:
            RedundancyError: Wrong sizes, numbers that are not finite, `dt` that is not positive.
        """
    @property
    def chain(self) -> Chain:
        """The chain that it was made for."""

@final
class PriorityStep:
    """Result of one step of `PrioritizedNullspace`."""
    @property
    def qd(self) -> NDArray[np.float64]:
        """Joint velocity `(n,)`, rad/s or m/s."""
    @property
    def status(self) -> Status:
        """`converged`: all scales 1; `singular`: tasks above leave an error of one; `limits`: limits reduced one."""
    @property
    def scales(self) -> NDArray[np.float64]:
        """`(tasks,)`: one for each task, in [0, 1].

        Of an inequality 1 where it holds, else the share of the way back that is made.
        """
    @property
    def residuals(self) -> NDArray[np.float64]:
        """`(tasks,)`, m/s and rad/s: `|J qd - scale v|` of each task, or `|J qd - v|` where no scale was possible.

        Of an inequality what is missing.
        """
    @property
    def active_limits(
        self,
    ) -> list[tuple[str, Literal["position", "velocity", "acceleration"], Literal["lower", "upper"]]]:
        """Limits that the step is at: name of the joint, which limit, which side."""
    @staticmethod
    def _make(chain: Chain, status: str, numbers: Any, active: Any) -> PriorityStep: ...

@final
class Servo:
    """A servo for pose targets: one target pose per tick in, joint position, velocity and acceleration out.

    Limits of position, velocity, acceleration and (where given) jerk hold at every tick, whatever the input:
    noise, jumps, targets out of reach, late, repeated, NaN or none. Every tick leads to a state from which
    braking to rest holds them too. Velocity, acceleration and jerk are the differences of the joint
    positions over `dt`.

    Args:
        chain: The arm, or an arm object made from it.
        dt: Length of a tick, s.
        velocity_limits: Largest joint speeds `(n,)`, rad/s or m/s; `"chain"` takes the chain's, None is off.
        acceleration_limits: Largest joint accelerations `(n,)`, rad/s^2 or m/s^2; `"chain"` or None takes
            the chain's. A joint without one gets ten times its velocity limit per second (full speed after
            0.1 s), or 10 where it has no velocity limit either: without any limit there is no braking to
            foresee.
        jerk_limits: Largest joint jerks `(n,)`, rad/s^3 or m/s^3; None is off.
        criterion: What to do with the freedom; None keeps joints away from their limits.
        desired_swivel: Swivel angle to follow, rad, until `update` gets another one.
        position_weight: Weight of 1 m of position error where the target is out of reach.
        orientation_weight: Weight of 1 rad of orientation error, m.
        target_noise: `(m, rad)`, the root mean square of the input's noise; `"auto"` measures it; None takes
            the target as exact.
        swivel_reference: Direction `(3,)`, base frame, from which the swivel of an arm without a chart
            counts. It is the angle of the elbow about the line from shoulder to wrist, the origins of
            joints 4, 2 and 6.
        timeout: Time without a target after which the arm brakes to rest, s.

    Raises:
        RedundancyError: A tick, limit, weight, noise or timeout out of range, a criterion of another arm, a
            desired swivel on an arm that needs `swivel_reference`.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("iiwa14")
        >>> servo = rd.Servo(arm, 0.004)
        >>> servo.reset([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])
        >>> str(servo.update(arm.forward([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])).status)
        'converged'
    """

    def __new__(
        cls,
        chain: Chain | _ClosedForm,
        dt: float,
        *,
        velocity_limits: Literal["chain"] | ArrayLike | None = "chain",
        acceleration_limits: Literal["chain"] | ArrayLike | None = "chain",
        jerk_limits: ArrayLike | None = None,
        criterion: Criterion | None = None,
        desired_swivel: float | None = None,
        position_weight: float = 1.0,
        orientation_weight: float = 0.3,
        target_noise: Literal["auto"] | tuple[float, float] | None = "auto",
        swivel_reference: ArrayLike | None = None,
        timeout: float = 0.1,
    ) -> Self: ...
    def reset(self, q: ArrayLike, qd: ArrayLike | None = None) -> None:
        """Starts from joint positions and velocities; comes before the first `update`.

        Args:
            q: Joint positions `(n,)`, rad or m.
            qd: Joint velocities `(n,)`, rad/s or m/s; None is rest.

        Raises:
            RedundancyError: Wrong sizes, numbers that are not finite, a position or velocity outside of its
                limit, a velocity from which the joint cannot brake before its position limit.
        """
    def update(
        self,
        target_pose: _Pose | None,
        target_velocity: ArrayLike | None = None,
        desired_swivel: float | None = None,
        desired_elbow: ArrayLike | None = None,
    ) -> ServoTick:
        """One tick.

        Args:
            target_pose: Pose of the tool `(4, 4)`, base frame; None for no new target. One that is not finite or
                not rigid is ignored, and the reason says so.
            target_velocity: Its velocity `(6,)` where it is known: linear and angular, base axes, m/s and rad/s.
            desired_swivel: Swivel angle to follow from now on, rad.
            desired_elbow: Point `(3,)`, base frame, m: of the solutions for the pose the one whose elbow is
                nearest to it.

        Raises:
            RedundancyError: No `reset` before, wrong shapes.
        """
    @property
    def chain(self) -> Chain:
        """The arm."""
    @property
    def dt(self) -> float:
        """Length of a tick, s."""

@final
class ServoTick:
    """What one tick of a servo did."""

    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions to send `(n,)`, rad or m."""
    @property
    def qd(self) -> NDArray[np.float64]:
        """Joint velocities `(n,)`: `q` minus the one before, by `dt`."""
    @property
    def qdd(self) -> NDArray[np.float64]:
        """Joint accelerations `(n,)`: `qd` minus the one before, by `dt`."""
    @property
    def status(self) -> Status:
        """`converged` (0.1 mm, 1 mrad), `tracking` (behind the target), `unreachable`, `limits`, `no_target`."""
    @property
    def reason(self) -> str | None:
        """Why, in words; None where there is nothing to explain."""
    @property
    def position_error(self) -> float:
        """Distance of the tool from the target, m; 0 where there has been no target."""
    @property
    def orientation_error(self) -> float:
        """Angle of the tool to the target, rad."""
    @property
    def scale(self) -> float:
        """Share of the target's velocity with which the tool follows it, in [0, 1]; 1 for a target at rest."""
    @property
    def time_to_stop(self) -> float:
        """Time until the arm would have to stop or flip at the present tool velocity, s; inf if none is seen."""
    @property
    def active_limits(self) -> list[tuple[str, str, str]]:
        """Limits that acted: name of the joint, which limit, which side."""

@final
class Track(Plan):
    """The result of following a path in closed loop, one row every `dt`.

    `converged`; `off_path`: farther from the path than the tolerance (the reason gives the largest error and its
    row); `limits`: a joint violates a position or speed limit; `collision`: contact; `time_limit`: the rows so far.
    """

    @property
    def position_error(self) -> float:
        """Largest distance from the path, m, in the coordinates of the task."""
    @property
    def orientation_error(self) -> float:
        """Largest angle from the path, rad."""
    @staticmethod
    def _make(arrays: Any, position_error: float, orientation_error: float) -> Track: ...

def track(
    chain: Chain,
    resolver: Resolver,
    path: Path,
    q0: ArrayLike,
    dt: float,
    feedback: float = 5.0,
    *,
    tolerance: tuple[float, float] | None = None,
    scene: Scene | None = None,
    links: LinkGeometry | None = None,
    self_collision: bool | Literal["auto"] = "auto",
    progress: Callable[[float], object] | None = None,
    time_limit: float | None = None,
) -> Track:
    """Follows a path in closed loop: `v = v_path(t) + feedback * error`, `q += dt * qd`.

    The resolver is copied, so a run does not disturb its state. A path without times gets them first, such that the
    least joint motion along it uses at most half of the velocity limits.

    Args:
        chain: The arm, the one that the resolver was made for.
        resolver: The scheme.
        path: Poses, or positions for the tasks `position` and `planar`.
        q0: Joint positions at the start `(n,)`.
        dt: Length of a step, s.
        feedback: Gain of the task error, 1/s; below `2 / dt`.
        tolerance: Largest allowed distance (m) and angle (rad) from the path (1e-3, 1e-2).
        scene: Obstacles. With them (or links) each row has its clearance, and contact in the rows or between them is
            an event and the status `collision`. By default those of a resolver that keeps distances.
        links: Shapes of the links; capsules of 0.05 m from joint to joint when left out.
        self_collision: Whether links must not touch each other; `"auto"`: if `links` has pairs.
        progress: Called with the share of the work done.
        time_limit: Seconds after which the rows so far are returned; `None` is off.

    Returns:
        A trajectory with the events `basis_change`, `damping`, `limit` (which joint, which limit), `scaled`,
        `kinematic_singularity`, `algorithmic_singularity`, `joint_limit` (a joint beyond its limits), `contact`.

    Raises:
        RedundancyError: Wrong sizes, invalid settings, another chain, a path without orientations for a task that
            needs them.
    """

@final
class Clearance(Criterion):
    """Distance from obstacles, to be maximised.

    A soft minimum of the signed distances of all pairs of link and obstacle: it is smooth where the nearest pair
    changes. It is at most the least distance, and below it by at most `smoothing` times the logarithm of the number
    of pairs that are equally near. The Hessian is the difference quotient of the analytic gradient.

    Args:
        chain: The arm.
        scene: The obstacles.
        link_radius: Links are capsules of this radius (m) from joint to joint and to the tool; or a `LinkGeometry`.
        links: Another name of `link_radius`.
        self_collision: Whether the pairs of links count too.
        smoothing: Width of the transition between nearest pairs, m; 0 gives the least distance itself.
    """

    def __new__(
        cls,
        chain: Chain,
        scene: Scene,
        link_radius: float | LinkGeometry | None = 0.05,
        *,
        links: LinkGeometry | float | None = None,
        self_collision: bool = False,
        smoothing: float = 0.002,
    ) -> Self: ...

@final
class SelfClearance(Criterion):
    """Distance of links from each other, to be maximised: a soft minimum over the pairs of a `LinkGeometry`.

    Args:
        chain: The arm.
        links: Its shapes and pairs.
        smoothing: Width of the transition between nearest pairs, m; 0 gives the least distance itself.
    """

    def __new__(cls, chain: Chain, links: LinkGeometry, *, smoothing: float = 0.002) -> Self: ...

@final
class Elbow(Criterion):
    """Squared distance (m^2) of the elbow from a point, to be minimised.

    Args:
        chain: The arm.
        point: `(3,)`, m, world axes.
        link: The origin of this link's frame instead of the elbow, which is the origin of joint 4 of seven, in general
            of joint `(n + 1) // 2`.
    """

    def __new__(cls, chain: Chain, point: ArrayLike, *, link: str | None = None) -> Self: ...

@final
class GravityTorque(Criterion):
    """Size of the torques that hold the arm against gravity, to be minimised; N m (N for sliding joints).

    `"norm"` is the root of the sum of squares of all joints, `"peak"` the largest magnitude; derivatives are exact.
    Where two joints share the peak, its gradient is that of the first one and jumps there.

    Args:
        chain: The arm, with inertias; or an arm object.
        measure: `"norm"` or `"peak"`.
        gravity: `(3,)`, m/s^2, world axes.
        weights: `(n,)`, not negative: torques are multiplied by them first. With `1 / chain.effort_limit` the peak is
            the largest share of an effort limit.

    Raises:
        RedundancyError: A chain without inertias, an unknown measure, weights that are negative.

    Example:
        >>> import redundancy as rd
        >>> round(float(rd.GravityTorque(rd.catalog.load("puma560"), "peak").value([0.0] * 6)), 4)
        37.4837
    """
    def __new__(
        cls,
        chain: Chain | SrsArm,
        measure: Literal["norm", "peak"] = "norm",
        *,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        weights: ArrayLike | None = None,
    ) -> Self: ...

@final
class KineticEnergy(Criterion):
    """Kinetic energy of the arm at fixed joint velocities, to be minimised, J: how heavy the arm is to move.

    `qd^T M(q) qd / 2` with the mass matrix M, rotors included. Without `qd`, `trace(M) / 2`: the sum of the energies
    with which each joint alone moves at 1 rad/s or 1 m/s. The gradient is exact, the Hessian its difference quotient.

    Args:
        chain: The arm, with inertias; or an arm object.
        qd: Joint velocity `(n,)`, rad/s or m/s.

    Raises:
        RedundancyError: A chain without inertias, a wrong size.
    """
    def __new__(cls, chain: Chain | SrsArm, *, qd: ArrayLike | None = None) -> Self: ...

@final
class Swivel(Criterion):
    """Distance of the swivel of an S-R-S arm from a desired one, to be minimised: `1 - cos(swivel - desired)`.

    About half of the squared difference, smooth everywhere but at the singular direction of the arm's chart, and with
    the period of the swivel.

    Args:
        arm: The `SrsArm`, whose chart gives the angle its meaning; or a chain of this class, with the default chart.
        desired: Angle, rad.

    Raises:
        NotSrsError: A chain of another class.
        RedundancyError: An angle that is not finite.
    """
    def __new__(cls, arm: SrsArm | Chain, desired: float) -> Self: ...

@final
class CustomCriterion(Criterion):
    """A function of yours as a criterion, usable wherever one is: in resolvers, `plan`, `best`, sums and multiples.

    An exception of the function ends the call that evaluated it and is raised by that call. The function may be called
    from several threads, one at a time (the GIL is taken for each evaluation), thousands of times by a search; a
    control step calls `gradient` once, or `value` twice per joint without it.

    Args:
        value: Called with q `(n,)`, a fresh array; returns a finite number.
        gradient: Called with q `(n,)`; returns dh/dq `(n,)`, per rad or m. Without it central differences of `value`
            (1e-9 of its size off). The Hessian is always one of differences.
        sense: `"minimize"` or `"maximize"`.
        chain: The arm; without it any number of joints is accepted.

    Raises:
        RedundancyError: `value` or `gradient` that cannot be called, an unknown sense. When evaluated: numbers that are
            not finite, a gradient of another length.

    Example:
        >>> import redundancy as rd
        >>> h = rd.CustomCriterion(lambda q: float(q[0] ** 2), lambda q: [2 * q[0]] + [0.0] * 6)
        >>> h.value([3.0] + [0.0] * 6)
        9.0
    """
    def __new__(
        cls,
        value: Callable[[NDArray[np.float64]], Any],
        gradient: Callable[[NDArray[np.float64]], Any] | None = None,
        *,
        sense: Literal["minimize", "maximize"] = "minimize",
        chain: Chain | SrsArm | None = None,
    ) -> Self: ...

# self-motion

@final
class SrsArm:
    """A spherical-revolute-spherical arm with its closed-form inverse kinematics (Moore & Oztop 2010).

    The arm is recognised from its geometry alone: any base, tool, axis signs, joint zeros, elbow offset. With n from
    shoulder to wrist, the elbow is on a circle about n, and the swivel s is its angle on the circle. Zero and sense
    of s follow the paper in the frame whose z is +axis 1 and whose x is the base x projected.

    Args:
        chain: Seven revolute joints.
        chart: `"shortest_arc"` (the paper's; singular if n is opposite to the reference) or `"stereographic"`
            (singular only if n is along the reference).
        reference: `(3,)` direction in world axes: for `shortest_arc` the one used in place of +axis 1, for
            `stereographic` the singular half-line (default: opposite to axis 1).

    Raises:
        NotSrsError: Which axes miss each other and by how much.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.SrsArm(rd.catalog.load("iiwa14"))
        >>> pose = arm.chain.forward([0.1, 0.5, 0.2, -1.2, 0.3, 0.8, 0.0])
        >>> arm.solve(pose, swivel=0.4).shape[1]
        7
    """

    def __new__(
        cls, chain: Chain, chart: str = "shortest_arc", reference: ArrayLike | None = None
    ) -> Self: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    @property
    def chain(self) -> Chain:
        """The chain that was recognised."""
    @property
    def name(self) -> str:
        """`"srs"`."""
    @property
    def parameter(self) -> str:
        """`"swivel"`."""
    @property
    def chart(self) -> str:
        """Name of the chart."""
    @property
    def defect(self) -> tuple[float, float]:
        """How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect."""
    @property
    def lengths(self) -> tuple[float, float]:
        """Upper arm and forearm, m: shoulder and wrist centre to the elbow axis."""
    @property
    def shoulder(self) -> NDArray[np.float64]:
        """Centre of the shoulder in the world, `(3,)`, m."""
    def solve(self, pose: Any, swivel: float | ArrayLike, limits: bool = True) -> NDArray[np.float64]:
        """Configurations for a pose at a swivel.

        Args:
            pose: `(4, 4)` or SE3-like.
            swivel: The angle s, rad, or u = (cos s, sin s), `(2,)`.
            limits: Only those within the joint limits. If False: all 8 rows in branch order (index
                `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`), repeats at a gimbal included.

        Returns:
            `(k, 7)`; `(0, 7)` if the pose is out of reach or no branch is within the limits at this swivel:
            `self_motion(pose).reason` says which.
        """
    def solve_batch(
        self,
        poses: Any,
        swivels: float | ArrayLike,
        limits: bool = True,
        out: SolveBatch | tuple[NDArray[np.float64], NDArray[np.bool_]] | None = None,
        *,
        threads: int | None = None,
    ) -> SolveBatch:
        """All branches for many poses.

        Args:
            poses: `(N, 4, 4)`.
            swivels: One angle, `(N,)` angles, or `(N, 2)` vectors (cos s, sin s).
            limits: Whether `valid` says that the joint limits hold, or only that the pose is in reach.
            out: An earlier result, or `(q, valid)` of shapes `(N, 8, 7)` and `(N, 8)`, to be overwritten.
            threads: Size of the pool; all cores by default. The result does not depend on it.
        """
    def intervals_batch(
        self, poses: Any, margin: float = 0.0, *, threads: int | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Feasible intervals of all branches for many poses: `(M, 2)` (pose, branch) and `(M, 2)` (lo, hi).

        Args:
            poses: `(N, 4, 4)`, or a list of SE3-like objects.
            margin: Distance kept from every joint limit, rad.
            threads: Threads for a batch; all cores by default.
        """
    def best_batch(self, poses: Any, criterion: Criterion, *, threads: int | None = None) -> ChoiceBatch:
        """`SelfMotion.best` for many poses.

        Args:
            poses: `(N, 4, 4)`, or a list of SE3-like objects.
            criterion: Decides which configuration is best.
            threads: Threads for a batch; all cores by default.
        """
    @overload
    def nearest(self, pose: Any, q: _Vector, *, threads: int | None = None) -> NDArray[np.float64] | None: ...
    @overload
    def nearest(self, pose: Any, q: ArrayLike, *, threads: int | None = None) -> Any:
        """The configuration `(7,)` for the pose within the limits with the least distance to `q`, windings included.

        `None` when there is none: `self_motion(pose).reason` says why. A batch of poses gives a `ChoiceBatch`.

        Args:
            pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
            q: `(7,)`, or `(N, 7)` for many poses, rad.
            threads: Threads for a batch; all cores by default.
        """
    def nearest_batch(self, poses: Any, q: ArrayLike, *, threads: int | None = None) -> ChoiceBatch:
        """`nearest` for many poses, to one `q` `(7,)` or one each `(N, 7)`.

        Args:
            poses: `(N, 4, 4)`, or a list of SE3-like objects.
            q: `(7,)` or `(N, 7)`, rad.
            threads: Threads for a batch; all cores by default.
        """
    def swivel(self, q: ArrayLike) -> Any:
        """Swivel angle of a configuration, rad in (-pi, pi]; `(N,)` for `(N, 7)`.

        Args:
            q: Joint positions `(7,)` or `(N, 7)`, rad.
        """
    def branch(self, q: ArrayLike) -> Any:
        """Signs (shoulder, elbow, wrist) of a configuration; `(N, 3)` for `(N, 7)`.

        Args:
            q: Joint positions `(7,)` or `(N, 7)`, rad.
        """
    def self_motion(self, pose: Any) -> SelfMotion:
        """Every configuration for a pose, as an object."""
    def chart_change(self, other: SrsArm, pose: Any) -> float:
        """The difference between a swivel in `other`'s chart and in this chart at the same pose, rad."""

@final
class SelfMotion:
    """Every configuration for one pose: up to eight circles.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.SrsArm(rd.catalog.load("pa10"))
        >>> motion = arm.self_motion(arm.chain.forward([0.1, 0.5, 0.2, 1.2, 0.3, 0.8, 0.0]))
        >>> print(motion.status, len(motion.branches))
        converged 8
        >>> motion.best(rd.JointRange(arm.chain)).q.shape
        (7,)
    """

    @property
    def status(self) -> Status:
        """`converged`, `unreachable` (no configuration) or `limits` (none within the joint limits)."""
    @property
    def reason(self) -> str:
        """Why there is none: too far or too near by how many mm, or which joint is outside by how much even at best.

        If the status is not `proven`, also why. Empty otherwise.
        """
    @property
    def proven(self) -> bool:
        """Whether status and branches are exact.

        False for an arm with a defect above 1e-9, and if shoulder or wrist reach a gimbal for this pose: there only
        the sum of the outer joints is determined, so there are configurations besides the branches.
        """
    @property
    def center(self) -> NDArray[np.float64]:
        """Centre of the elbow's circle in the world, `(3,)`, m (Moore & Oztop 2010, fig. 3)."""
    @property
    def axis(self) -> NDArray[np.float64]:
        """Unit vector from shoulder to wrist in the world, `(3,)`: the paper's n, the axis of the elbow's circle."""
    @property
    def radius(self) -> float:
        """Radius of the elbow's circle, m: the paper's rho; 0 for the stretched and the folded arm."""
    @property
    def frame(self) -> NDArray[np.float64]:
        """Axes `[x, y, k]` in the world, `(3, 3)`, of the frame in which the paper's quaternions are written.

        k is the axis of joint 1 (or the chart's reference), x the base's x projected: for a PA10 that stands at the
        origin the identity.
        """
    @property
    def q_a(self) -> NDArray[np.float64]:
        """The paper's q_A (eq. 14), `(w, x, y, z)`: turns x, y, k into the directions of s = 0, s = pi/2 and n.

        Its angle is `acos(k . n)`; the vector part is along k x n.
        """
    def elbow(self, s: float | ArrayLike) -> NDArray[np.float64]:
        """The elbow in the world at a swivel: the paper's p_E (eq. 15).

        It lies on the sphere of the upper arm around the shoulder. For an arm with elbow offset it is the point of
        the elbow's axis nearest to shoulder and wrist.

        Args:
            s: Swivel, rad, or `(N,)`.

        Returns:
            `(3,)` or `(N, 3)`, m.

        Raises:
            RedundancyError: A swivel that is not finite.
        """
    @property
    def branches(self) -> list[Branch]:
        """The distinct circles: 8; 4 for the stretched and the folded arm; none if the pose is out of reach."""
    def best(self, criterion: Criterion) -> Choice:
        """The best configuration over all branches, feasible arcs and windings.

        For joint range, posture and their sums the optimum is proven by bounds; for other criteria every stationary
        point that a piecewise cubic resolves is compared.

        Args:
            criterion: A criterion of the same arm.
        """
    def nearest(self, q: ArrayLike) -> Choice:
        """The configuration with the least Euclidean distance to `q`, which is the `value`.

        Args:
            q: Joint positions `(7,)`, rad.
        """

@final
class Branch:
    """One circle of configurations with fixed signs, parametrised by the swivel."""

    @property
    def signs(self) -> tuple[int, int, int]:
        """Signs of theta2, theta4, theta6 (shoulder, elbow, wrist)."""
    @property
    def index(self) -> int:
        """`4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`."""
    def q(self, s: float | ArrayLike) -> NDArray[np.float64]:
        """Configuration at swivel `s` (rad): `(7,)`, or `(N, 7)` for `(N,)`.

        Principal values, unless these violate a limit and another winding does not.
        """
    def tangent(self, s: float | ArrayLike) -> NDArray[np.float64]:
        """dq/ds, `(7,)` or `(N, 7)`: in the kernel of the Jacobian.

        Args:
            s: Swivel, rad: a number or `(N,)`.
        """
    def windings(self, s: float) -> NDArray[np.float64]:
        """Every configuration within the limits at a swivel: all windings of all joints.

        Args:
            s: Swivel, rad.

        Returns:
            `(k, 7)`, ascending by the first joint that differs; joints without limits keep their principal value.
            `(0, 7)` if the branch is outside the limits at this swivel.

        Raises:
            RedundancyError: A swivel that is not finite.
        """
    def quaternions(
        self, s: float | ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The paper's quaternions at a swivel (Moore & Oztop 2010, eqs 22 to 27), in `SelfMotion.frame`.

        Args:
            s: Swivel, rad, or `(N,)`.

        Returns:
            `(q_3, q_4, conj(q_4) q)`, each `(4,)` or `(N, 4)`, `(w, x, y, z)`: the orientations of upper arm and
            forearm, z along the link and y along the axis of joint 4, and the rotation of joints 5 to 7.

        Raises:
            RedundancyError: A swivel that is not finite.
        """
    def intervals(self, margin: float = 0.0) -> NDArray[np.float64]:
        """Intervals of the swivel in which all joints keep `margin` (rad) from their limits: `(k, 2)`, exact.

        `[lo, hi]` contains s when `(s - lo) mod 2 pi <= hi - lo`.
        """

@final
class Choice:
    """A configuration chosen for a pose; its parts are `None` if no configuration is within the limits."""

    @property
    def q(self) -> NDArray[np.float64] | None:
        """Joint positions `(7,)`, rad."""
    @property
    def swivel(self) -> float | None:
        """Its swivel, rad in (-pi, pi]."""
    @property
    def branch(self) -> tuple[int, int, int] | None:
        """Its signs (shoulder, elbow, wrist)."""
    @property
    def value(self) -> float | None:
        """The criterion there, in its own unit."""
    @property
    def status(self) -> Status:
        """`converged`, `limits` or `unreachable`."""
    @property
    def reason(self) -> str:
        """Why there is none, or why it is not proven to be the best; empty otherwise."""
    @property
    def proven(self) -> bool:
        """Whether it is certain that no configuration for the pose is better, or that there is none.

        False for criteria without bounds, and at gimbals that leave joints free.
        """

@final
class ChoiceBatch:
    """Choices for many poses."""

    @property
    def q(self) -> NDArray[np.float64]:
        """`(N, 7)`; rows that are not valid are 0."""
    @property
    def swivel(self) -> NDArray[np.float64]:
        """`(N,)`, rad."""
    @property
    def branch(self) -> NDArray[np.int8]:
        """`(N, 3)` signs."""
    @property
    def value(self) -> NDArray[np.float64]:
        """`(N,)`."""
    @property
    def valid(self) -> NDArray[np.bool_]:
        """`(N,)`: there is a configuration within the limits."""
    @property
    def proven(self) -> NDArray[np.bool_]:
        """`(N,)`: there is one, and no other for the pose is better."""

@final
class SolveBatch:
    """Result of `solve_batch` of an arm with a closed form, and of `nearest` for many poses."""

    @property
    def q(self) -> NDArray[np.float64]:
        """`(N, 8, n)` in branch order, `(N, n)` for `nearest`; rows that are not valid are unspecified but finite."""
    @property
    def valid(self) -> NDArray[np.bool_]:
        """`(N, 8)`, `(N,)` for `nearest`."""

# ik

@final
class IkSolver:
    """Inverse kinematics of any chain, within its joint limits and to a given tolerance.

    `hybrid` uses the closed form if the arm has one (`rd.closed_form`), otherwise ranked starts and
    Levenberg-Marquardt. Construction computes a table of configurations (about a millisecond), so construct a solver
    once and use it for many poses.

    Args:
        chain: The arm.
        method: `"hybrid"`; `"newton"`: Levenberg-Marquardt from `q0`, then from random starts; or a descent algorithm
            of the paper from `q0`, then from random starts: `"coordinate_descent"`, `"gauss_southwell"`,
            `"gauss_southwell_rate"`, `"weighted_descent"`, `"gradient_estimate"`.
        task: Which coordinates count: a name or a `Task`; `"pose"` when left out.
        tol_position: Largest distance from the target that counts as reached, m.
        tol_orientation: Largest angle from the target that counts as reached, rad.
        max_iterations: Most iterations over all starts.
        restarts: Most starts after the first.
        criterion: Objective for the spare freedom: the result is stationary in the null space of the task; with a
            closed form it is the best of all configurations.
        orientation_set: `Cone`, `QuaternionVolume` or `OrientationSet` of orientations that count as reached, instead
            of the target's.
        closed_form: Whether the closed form is used if the arm has one.
        time_limit: Seconds after which the best configuration so far is returned.
        position_weight: Weight of the squared distance (1/m^2) in the cost of the descent algorithms and of `trace`.
        orientation_weight: Weight of the orientation in that cost.
        order: Order of a sweep of coordinate descent: `"tip_to_base"`, `"base_to_tip"`, `"double"`.
        measure: Cost of an orientation: squared distances of the three `"axes"`, or of `"quaternions"`.
        joint_weights: `(n,)` share of its best step that each joint takes in weighted descent (eq. 46) and in the
            estimate.
        gradient: `"true"` with a line search, or the paper's `"estimate"` as printed.
        attractions: Secondary terms (eq. 43): link, point `(3,)`, weight; a negative weight repels the link.

    Raises:
        RedundancyError: A setting out of its range, by name.

    Example:
        >>> import redundancy as rd
        >>> chain = rd.catalog.load("panda")
        >>> ik = rd.IkSolver(chain)
        >>> result = ik.solve(chain.forward([0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9]))
        >>> str(result.status), result.position_error <= 1e-6
        ('converged', True)
    """

    def __new__(
        cls,
        chain: Chain,
        method: str = "hybrid",
        task: str | Task | None = None,
        tol_position: float = 1e-6,
        tol_orientation: float = 1e-6,
        max_iterations: int | None = None,
        restarts: int | None = None,
        criterion: Criterion | None = None,
        orientation_set: Cone | QuaternionVolume | OrientationSet | None = None,
        closed_form: bool = True,
        *,
        time_limit: float | None = None,
        position_weight: float = 10.0,
        orientation_weight: float = 1.0,
        order: str = "tip_to_base",
        measure: str = "axes",
        joint_weights: ArrayLike | None = None,
        gradient: str = "true",
        attractions: Sequence[tuple[str, Sequence[float], float]] | None = None,
    ) -> Self: ...
    @property
    def chain(self) -> Chain:
        """The chain."""
    @property
    def method(self) -> str:
        """Name of the method."""
    @property
    def task(self) -> Task:
        """Which coordinates count."""
    @property
    def closed_form(self) -> str | None:
        """Name of the closed form in use, such as `"srs"` or `"panda_class"`; `None` without one."""
    def solve(self, pose: Any, q0: ArrayLike | None = None, seed: int = 0) -> IkResult:
        """A configuration for a pose.

        Args:
            pose: `(4, 4)` or SE3-like; `(2,)` or `(3,)` for `planar`, `(3,)` for `position`, `(x, y, angle)` for
                `planar_pose`.
            q0: `(n,)` start of the search; a closed form returns the configuration nearest to it.
            seed: Seed of the random starts. The same seed gives the same bits.

        Raises:
            RedundancyError: A pose that is not rigid (with the measured error), wrong shapes, numbers that are not
                finite.
        """
    def solve_batch(
        self, poses: Any, q0: ArrayLike | None = None, seed: int = 0, *, threads: int | None = None
    ) -> IkBatch:
        """`solve` for many poses `(N, 4, 4)`, from one `q0` `(n,)` or one each `(N, n)`.

        Row i is exactly what `solve` gives for pose i, whatever the number of threads.

        Args:
            poses: `(N, 4, 4)`, or the short forms of `solve` with a leading axis.
            q0: Start of the search, `(n,)` or `(N, n)`, rad or m.
            seed: Seed of the random starts, the same for every pose.
            threads: Threads for a batch; all cores by default.
        """
    def trace(self, pose: Any, q0: ArrayLike) -> IkTrace:
        """One run of the method from `q0`, without restarts or closed form, iteration by iteration.

        `hybrid` runs as `newton`. There are at most `max_iterations` iterations.

        Args:
            pose: `(4, 4)` or SE3-like.
            q0: Start, `(n,)`, rad or m.
        """
    @staticmethod
    def _restore(chain: Chain, options: dict[str, Any]) -> IkSolver: ...

@final
class IkTrace:
    """History of one run: entry k is the state before iteration k, the last entry is the final state."""

    def __new__(
        cls,
        q: Sequence[float],
        cost: Sequence[float],
        position_error: Sequence[float],
        orientation_error: Sequence[float],
    ) -> Self: ...
    @property
    def q(self) -> NDArray[np.float64]:
        """Final configuration, `(n,)`."""
    @property
    def cost(self) -> NDArray[np.float64]:
        """Weighted cost `(k,)` of the descent algorithms, whatever the method."""
    @property
    def position_error(self) -> NDArray[np.float64]:
        """Distances from the target `(k,)`, m."""
    @property
    def orientation_error(self) -> NDArray[np.float64]:
        """Angles from the target `(k,)`, rad."""
    def __len__(self) -> int: ...

def sinusoid_minimum(K: float, a: float, b: float) -> tuple[float, float]:
    """Where `K + a cos(psi) + b sin(psi)` is least, in (-pi, pi], and its value there: `atan2(-b, -a)`.

    Example:
        >>> import redundancy as rd
        >>> psi, value = rd.sinusoid_minimum(2.0, 3.0, -4.0)
        >>> round(psi, 6), value
        (2.214297, -3.0)
    """

def half_angle_minimum(K: float, a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Where `K + a cos(psi) + b sin(psi) + c cos(psi/2) + d sin(psi/2)` is least over two turns, and its value."""

def joint_cost(
    axis: ArrayLike,
    origin: ArrayLike,
    pose: Any,
    target: Any,
    position_weight: float = 10.0,
    orientation_weight: float = 1.0,
    measure: str = "axes",
) -> tuple[float, ...]:
    """Coefficients of the cost of a pose as a function of the angle psi of a joint about `axis` through `origin`.

    `(K, a, b)` for the measure `"axes"` (squared distances of the point and of the three unit axes),
    `(K, a, b, c, d)` for `"quaternions"`; for `sinusoid_minimum` and `half_angle_minimum`.

    Args:
        axis: Direction `(3,)` of the joint's axis, world axes.
        origin: A point `(3,)` on the axis, m.
        pose: Pose `(4, 4)` of the tool at psi = 0.
        target: Desired pose `(4, 4)`.
        position_weight: Weight of the squared distance, 1/m^2.
        orientation_weight: Weight of the orientation.
        measure: `"axes"` or `"quaternions"`.
    """

@final
class IkResult:
    """Result of inverse kinematics for one pose."""

    def __new__(
        cls,
        q: ArrayLike,
        status: str,
        iterations: int,
        position_error: float,
        orientation_error: float,
        proven: bool = False,
        starts: int = 0,
    ) -> Self: ...
    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions `(n,)` within the limits; the best found if the status is not `converged`. A copy."""
    @property
    def status(self) -> Status:
        """Outcome of the search.

        `converged`, `unreachable` (every start ended stationary above the tolerance; exact from a closed form),
        `limits` (reachable only outside of the joint limits), `iteration_limit`, `time_limit`.
        """
    @property
    def reason(self) -> str:
        """Explanation of the status, with numbers; empty when converged."""
    @property
    def iterations(self) -> int:
        """Iterations over all starts; 0 from a closed form."""
    @property
    def position_error(self) -> float:
        """Distance from the target, m, in the coordinates of the task: by forward kinematics of `q`."""
    @property
    def orientation_error(self) -> float:
        """Angle from the target, rad, in the coordinates of the task: by forward kinematics of `q`."""
    @property
    def proven(self) -> bool:
        """Whether the status is exact: `converged` always is, others from a closed form without defect.

        False if it is the outcome of a finite search; `reason` then says how many starts were made.
        """
    @property
    def starts(self) -> int:
        """Starts of the numeric search; 0 from a closed form alone."""

@final
class IkBatch:
    """Results of inverse kinematics for many poses; row i is that of pose i."""

    def __new__(
        cls,
        q: NDArray[np.float64],
        status: NDArray[Any],
        iterations: NDArray[np.uint32],
        position_error: NDArray[np.float64],
        orientation_error: NDArray[np.float64],
        proven: NDArray[np.bool_],
    ) -> Self: ...
    @property
    def q(self) -> NDArray[np.float64]:
        """`(N, n)`, within the limits."""
    @property
    def status(self) -> NDArray[Any]:
        """`(N,)`, an object array of `Status`."""
    @property
    def iterations(self) -> NDArray[np.uint32]:
        """`(N,)`."""
    @property
    def position_error(self) -> NDArray[np.float64]:
        """`(N,)`, m."""
    @property
    def orientation_error(self) -> NDArray[np.float64]:
        """`(N,)`, rad."""
    @property
    def proven(self) -> NDArray[np.bool_]:
        """`(N,)`: whether each status is exact, as `IkResult.proven`."""
    def __len__(self) -> int: ...

@final
class SphericalWristArm:
    """A six-joint arm with a spherical wrist and its closed-form inverse kinematics: PUMA, ABB, KUKA, Fanuc, Staubli.

    The arm is recognised from its geometry alone: axes 4, 5, 6 meet at right angles, axes 2 and 3 are parallel, axis 1
    is perpendicular to them. Base, tool, axis signs, joint zeros, shoulder, elbow and lateral offsets do not matter.

    Args:
        chain: Six revolute joints.

    Raises:
        NotSphericalWristError: Which axes are wrong and by how many mm or mrad.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.SphericalWristArm(rd.catalog.load("puma560"))
        >>> pose = arm.chain.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7])
        >>> arm.solve(pose, limits=False).shape
        (8, 6)
    """

    def __new__(cls, chain: Chain) -> Self: ...
    @property
    def chain(self) -> Chain:
        """The chain that was recognised."""
    @property
    def name(self) -> str:
        """`"spherical_wrist"`."""
    @property
    def parameter(self) -> None:
        """`None`: the configurations for a pose are isolated."""
    @property
    def defect(self) -> tuple[float, float]:
        """How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect."""
    @property
    def lengths(self) -> tuple[float, float]:
        """Upper arm and forearm, m: axis 2 to axis 3, axis 3 to the wrist centre."""
    @property
    def shoulder_offset(self) -> float:
        """Distance of axis 2 from axis 1, m."""
    @property
    def lateral_offset(self) -> float:
        """Distance of the wrist centre from the plane through axis 1 perpendicular to axis 2, m."""
    def solve(self, pose: Any, limits: bool = True) -> NDArray[np.float64]:
        """Configurations for a pose, `(k, 6)`, in branch order.

        Args:
            pose: `(4, 4)` or SE3-like.
            limits: Only those within the joint limits, shifted by whole turns where necessary. If False: all distinct
                ones in principal values, 8, or 4 where one shoulder is out of reach or the arm is stretched.

        Returns:
            `(0, 6)` when there is none: `configurations(pose).reason` says why. With the wrist at its gimbal, only
            the sum of joints 4 and 6 is determined, and joint 4 is as near to 0 as the limits allow; so is joint 1
            where it is free.
        """
    def solve_batch(self, poses: Any, limits: bool = True, *, threads: int | None = None) -> SolveBatch:
        """All branches for many poses `(N, 4, 4)`: `q` `(N, 8, 6)` in branch order, `valid` `(N, 8)`.

        Args:
            poses: `(N, 4, 4)`, or a list of SE3-like objects.
            limits: Whether only those within the joint limits are valid.
            threads: Threads for a batch; all cores by default.
        """
    @overload
    def nearest(self, pose: Any, q: _Vector, *, threads: int | None = None) -> NDArray[np.float64] | None: ...
    @overload
    def nearest(self, pose: Any, q: ArrayLike, *, threads: int | None = None) -> Any:
        """The configuration for the pose within limits with the least distance to `q`, windings included.

        `(6,)`, or `None` when there is none. For poses `(N, 4, 4)`, with one `q` or `(N, 6)`, a `SolveBatch` with `q`
        `(N, 6)` and `valid` `(N,)`. Where the pose leaves joints free (gimbal of the wrist, wrist centre on axis 1)
        they stay near `q`.

        Args:
            pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
            q: `(6,)`, or `(N, 6)` for many poses, rad.
            threads: Threads for a batch; all cores by default.
        """
    def configurations(self, pose: Any) -> Configurations:
        """Every configuration for a pose within the limits; if there is none, the reason."""
    def branch(self, q: ArrayLike) -> Any:
        """Signs (shoulder, elbow, wrist) of a configuration `(6,)`, or `(N, 3)` of many `(N, 6)`.

        Branch order is `4 [shoulder < 0] + 2 [elbow < 0] + [wrist < 0]`. The shoulder is + when the wrist centre is on
        the side of axis 1 on which axis 2 passes.

        Args:
            q: Joint positions `(6,)` or `(N, 6)`, rad.
        """

@final
class Configurations:
    """Every configuration of a `SphericalWristArm` for one pose."""

    @property
    def status(self) -> Status:
        """`converged`, `unreachable` (no configuration) or `limits` (none within the joint limits)."""
    @property
    def reason(self) -> str:
        """Why there is none: out of reach by how many mm, or which joint is outside by how much.

        Empty otherwise.
        """
    @property
    def proven(self) -> bool:
        """Whether status and branches are exact.

        False for an arm with a defect above 1e-9, and where the pose leaves a joint free (wrist centre on axis 1, wrist
        at its gimbal).
        """
    @property
    def distance(self) -> float:
        """Distance of the wrist centre from the nearest point that it can reach, m; 0 in reach."""
    @property
    def q(self) -> NDArray[np.float64]:
        """Within the limits, `(k, 6)`, in branch order."""
    @property
    def branches(self) -> NDArray[np.int8]:
        """Their signs (shoulder, elbow, wrist), `(k, 3)`."""

@final
class ParallelAxesArm:
    """A six-joint arm whose axes 2, 3 and 4 are parallel, and its closed-form inverse kinematics: UR3 to UR30, Z1.

    The arm is recognised from its geometry alone: axes 2, 3, 4 are parallel, axes 5 and 6 meet. Base, tool, axis signs,
    joint zeros, offsets and the other angles between the axes do not matter.

    Args:
        chain: Six revolute joints.

    Raises:
        NotParallelAxesError: Which axes are wrong and by how many mm or mrad.

    Example:
        >>> import numpy as np
        >>> import redundancy as rd
        >>> rows = [[0, .16, np.pi / 2, 0], [-.6, 0, 0, 0], [-.57, 0, 0, 0],
        ...         [0, .17, np.pi / 2, 0], [0, .12, -np.pi / 2, 0], [0, .11, 0, 0]]
        >>> arm = rd.ParallelAxesArm(rd.Chain.from_dh(rows))
        >>> arm.solve(arm.chain.forward([0.3, -1.5, 1.2, 1.1, 0.4, 0.7])).shape
        (8, 6)
    """

    def __new__(cls, chain: Chain) -> Self: ...
    @property
    def chain(self) -> Chain:
        """The chain that was recognised."""
    @property
    def name(self) -> str:
        """`"parallel_axes"`."""
    @property
    def parameter(self) -> None:
        """`None`: the configurations for a pose are isolated."""
    @property
    def defect(self) -> tuple[float, float]:
        """How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect."""
    @property
    def lengths(self) -> tuple[float, float]:
        """Upper arm and forearm, m: axis 2 to axis 3, axis 3 to axis 4."""
    def solve(self, pose: Any, limits: bool = True) -> NDArray[np.float64]:
        """Configurations for a pose, `(k, 6)`, in branch order.

        Args:
            pose: `(4, 4)` or SE3-like.
            limits: Only those within the joint limits, shifted by whole turns where necessary. If False: all distinct
                ones, at most 8, in principal values.

        Returns:
            `(0, 6)` when there is none: `rd.solutions(arm, pose).reason` says why. If the last axis is parallel to
            axes 2, 3 and 4, joint 6 is as near to 0 as reach and limits allow; so is joint 1 where it is free. The
            configurations of an arm with a defect are polished by Newton's method.
        """
    def solve_batch(self, poses: Any, limits: bool = True, *, threads: int | None = None) -> SolveBatch:
        """All branches for many poses `(N, 4, 4)`: `q` `(N, 8, 6)` in branch order, `valid` `(N, 8)`. Not polished.

        Args:
            poses: `(N, 4, 4)`, or a list of SE3-like objects.
            limits: Whether only those within the joint limits are valid.
            threads: Threads for a batch; all cores by default.
        """
    @overload
    def nearest(self, pose: Any, q: _Vector, *, threads: int | None = None) -> NDArray[np.float64] | None: ...
    @overload
    def nearest(self, pose: Any, q: ArrayLike, *, threads: int | None = None) -> Any:
        """The configuration for the pose within limits with the least distance to `q`, windings included.

        `(6,)`, or `None` when there is none. For poses `(N, 4, 4)`, with one `q` or `(N, 6)`, a `SolveBatch` with `q`
        `(N, 6)` and `valid` `(N,)`. Where the pose leaves joint 1 or joint 6 free it stays near `q`.

        Args:
            pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
            q: `(6,)`, or `(N, 6)` for many poses, rad.
            threads: Threads for a batch; all cores by default.
        """
    def branch(self, q: ArrayLike) -> Any:
        """Signs (shoulder, elbow, wrist) of a configuration `(6,)`, or `(N, 3)` of many `(N, 6)`.

        Branch order is `4 [shoulder < 0] + 2 [elbow < 0] + [wrist < 0]`. The shoulder is + when the point where axes 5
        and 6 meet is in front of axis 1, looking along the parallel axes from its side of axis 1.

        Args:
            q: Joint positions `(6,)` or `(N, 6)`, rad.
        """

@final
class PandaClassArm:
    """A seven-joint arm with a spherical shoulder whose axis 7 does not meet axes 5 and 6: Panda, FR3, xArm7, GEN72.

    The arm is recognised from its geometry alone: axes 1, 2, 3 meet at right angles, axes 5 and 6 meet, axis 7 does
    not pass through that point. Base, tool, axis signs, joint zeros, elbow offsets and the other angles do not
    matter. The set of configurations for a pose, curves of joint 7 with their arcs within the joint limits, is
    `rd.solutions(arm, pose)`.

    Args:
        chain: Seven revolute joints.

    Raises:
        NotPandaClassError: Which axes are wrong and by how many mm or mrad.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.PandaClassArm(rd.catalog.load("panda"))
        >>> pose = arm.chain.forward([0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9])
        >>> arm.solve(pose, q7=-0.9).shape
        (3, 7)
    """

    def __new__(cls, chain: Chain) -> Self: ...
    @property
    def chain(self) -> Chain:
        """The chain that was recognised."""
    @property
    def name(self) -> str:
        """`"panda_class"`."""
    @property
    def parameter(self) -> str:
        """`"q7"`."""
    @property
    def defect(self) -> tuple[float, float]:
        """How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect."""
    @property
    def lengths(self) -> tuple[float, float, float]:
        """Distances of the shoulder's and the wrist's centre from axis 4, and of the latter from axis 7, m."""
    def solve(self, pose: Any, q7: float, limits: bool = True) -> NDArray[np.float64]:
        """Configurations for a pose with joint 7 at `q7` (modulo turns), `(k, 7)`, k at most 8.

        Args:
            pose: `(4, 4)` or SE3-like.
            q7: rad.
            limits: Only those within the joint limits, shifted by whole turns where necessary. If False: all distinct
                ones in principal values.

        Returns:
            In the order `4 [shoulder < 0] + 2 [elbow < 0] + [normal < 0]`; `(0, 7)` when there is none with this
            joint 7. The configurations of an arm with a defect are polished by Newton's method.
        """
    def solve_batch(
        self, poses: Any, q7: ArrayLike, limits: bool = True, *, threads: int | None = None
    ) -> SolveBatch:
        """All configurations for many poses `(N, 4, 4)` with one `q7` or `(N,)`: `q` `(N, 8, 7)`, `valid` `(N, 8)`.

        Args:
            poses: `(N, 4, 4)`, or a list of SE3-like objects.
            q7: Joint 7: a number or `(N,)`, rad.
            limits: Whether only those within the joint limits are valid.
            threads: Threads for a batch; all cores by default.
        """
    @overload
    def nearest(self, pose: Any, q: _Vector, *, threads: int | None = None) -> NDArray[np.float64] | None: ...
    @overload
    def nearest(self, pose: Any, q: ArrayLike, *, threads: int | None = None) -> Any:
        """The configuration for the pose within limits with the least distance to `q`, windings included.

        `(7,)`, or `None` when there is none. For poses `(N, 4, 4)`, with one `q` or `(N, 7)`, a `SolveBatch` with `q`
        `(N, 7)` and `valid` `(N,)`.

        Args:
            pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
            q: `(7,)`, or `(N, 7)` for many poses, rad.
            threads: Threads for a batch; all cores by default.
        """

# closed forms and solutions over a pose

def closed_form(chain: Chain | _ClosedForm) -> _ClosedForm | None:
    """The closed form of an arm, recognised from its geometry.

    Every arm object has `.name`, `.chain`, `.defect` (metres, radians) and `.parameter`, the name of the parameter
    that describes its spare freedom (`"swivel"`), `None` if the configurations for a pose are isolated.

    Args:
        chain: The arm; an arm object is returned as it is.

    Returns:
        The arm object, or `None` if no closed form is known.

    Example:
        >>> import redundancy as rd
        >>> rd.closed_form(rd.catalog.load("iiwa14")).parameter
        'swivel'
        >>> rd.closed_form(rd.catalog.load("puma560")).name
        'spherical_wrist'
    """

def pose_metrics(
    chain: Chain | _ClosedForm,
    poses: Any,
    metrics: list[str],
    freedom: ToolFreedom | None = None,
    *,
    scene: Scene | None = None,
    links: LinkGeometry | None = None,
    self_collision: str | bool = "auto",
    out: dict[str, NDArray[Any]] | None = None,
    threads: int | None = None,
) -> dict[str, NDArray[Any]]:
    """What an arm can do at many poses; `redundancy.maps.metrics` and `maps.best_margin` call it.

    Args:
        chain: The arm, a `Chain` or an arm with a closed form.
        poses: Poses `(N, 4, 4)` or `(4, 4)` in the world.
        metrics: Names: `"reachable"` (a configuration within the joint limits exists), `"margin"` (the largest
            possible least distance from a joint limit, rad or m; negative by how much the worst joint misses its limits
            at best, `-inf` where no configuration exists), `"proven"` (that margin is proven to be the largest),
            `"swivel_measure"` (how much of the self-motion holds the limits in the union of all branches: radians of
            the swivel or of q7, else the length in joint space), `"manipulability"` (`det(J J^T)` at the margin's
            configuration, 0 where there is none), `"spin_share"` (the feasible share of the allowed spins),
            `"clearance"` (least distance from the scene and between links at the margin's configuration, m; `-inf`
            where there is none).
        freedom: How far the tool may tilt and spin away from each pose. The margin is then the best that a search
            finds and not proven.
        scene: Obstacles, for the clearance.
        links: Shapes of the links, for the clearance; without it capsules of radius 0.05 m from joint to joint.
        self_collision: Whether links count among each other; `"auto"`: if `links` has pairs.
        out: Arrays `(N,)` by the name of the metric (bool for `reachable` and `proven`, else float64) that are filled
            instead of new ones.
        threads: Threads to use; all cores by default. The bits do not depend on it.

    Returns:
        The arrays `(N,)` by the name of the metric.

    Raises:
        RedundancyError: An unknown metric, a pose that is not rigid or finite, an array of another kind or length, a
            clearance without scene or links with pairs.

    Example:
        >>> import redundancy as rd
        >>> chain = rd.catalog.load("iiwa14")
        >>> pose = chain.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])
        >>> float(rd.maps.metrics(chain, pose, ["margin"])["margin"][0]) > 0.5
        True
    """

def solutions(
    chain: Chain | _ClosedForm,
    pose: Any,
    freedom: None = None,
    *,
    task: str | Task | None = None,
    closed_form: bool = True,
    seed: int | None = None,
    starts: int | None = None,
    step: float | None = None,
    max_rows: int | None = None,
) -> Solutions:
    """Every configuration of an arm for a pose, through one interface for all arms.

    From the closed form if the arm has one. Otherwise Newton's method is started from seeded random configurations
    within the limits, and curves are traced through the configurations found; then `proven` is False, because there
    may be others.

    Args:
        chain: The arm, or an arm object (whose chart then holds for the swivel).
        pose: `(4, 4)` or SE3-like, base frame, m; `(2,)` for the task `planar`.
        freedom: Must be `None`.
        task: Which coordinates of the pose count; all of them by default. The task must leave no more than one
            freedom.
        closed_form: Whether to use the closed form if there is one.
        seed: Seed of the random starts; default 0.
        starts: Number of random starts; default 100.
        step: Largest joint step between rows of traced curves; default 0.01.
        max_rows: Rows after which following a curve is stopped; default 200 000.

    Raises:
        RedundancyError: a pose that is not rigid or finite, invalid settings, an arm with fewer joints than the task
            has coordinates, or with at least two more.

    Example:
        >>> import redundancy as rd
        >>> chain = rd.catalog.load("iiwa14")
        >>> s = rd.solutions(chain, chain.forward([0.1, 0.5, 0.2, -1.2, 0.3, 0.8, 0.0]))
        >>> s.dimension, str(s.status), s.proven, len(s.pieces)
        (1, 'converged', True, 8)
        >>> piece = s.pieces[0]
        >>> piece.label, piece.closed, piece.q([0.0, 0.5]).shape
        ('+++', True, (2, 7))
        >>> s.best(rd.JointRange(chain)).proven
        True
    """

@final
class Solutions:
    """Every configuration for one pose: points (dimension 0) or curves (dimension 1). Made by `solutions`."""

    @property
    def chain(self) -> Chain:
        """The arm."""
    @property
    def dimension(self) -> int:
        """0 for isolated configurations, 1 for curves."""
    @property
    def status(self) -> Status:
        """`converged` (some configuration is within limits), `limits` (none is) or `unreachable` (there is none)."""
    @property
    def reason(self) -> str:
        """Why none is within the limits, by how much, and why the status is not `proven`; else empty."""
    @property
    def proven(self) -> bool:
        """Whether status and pieces are exact; False after a finite search, whose starts `reason` counts."""
    @property
    def pieces(self) -> list[Piece]:
        """The points or curves, whether within the joint limits or not."""
    def nearest(self, q: ArrayLike) -> Solution:
        """The configuration within the limits nearest to `q`, windings included; its `value` is the distance.

        Args:
            q: `(n,)`.
        """
    def best(self, criterion: Criterion) -> Solution:
        """The best configuration within the limits.

        Proven for isolated configurations, and on circles of the swivel for joint range, posture and their sums;
        otherwise found by a dense scan of all pieces with refinement.

        Args:
            criterion: A criterion of the same arm.
        """

@final
class Piece:
    """One point or curve of `Solutions`.

    The parameter `u` of a closed curve has period 2 pi; for an S-R-S arm it is the swivel, for a traced curve it is
    proportional to the length in joint space.
    """

    @property
    def index(self) -> int:
        """Its index in `Solutions.pieces`."""
    @property
    def label(self) -> str:
        """Its name: the signs of the branch (shoulder, elbow, wrist), or a number."""
    @property
    def closed(self) -> bool:
        """Whether it is a closed curve."""
    @property
    def range(self) -> tuple[float, float]:
        """Ends of `u`: (-pi, pi) for a closed curve, (0, 0) for a point."""
    def q(self, u: float | ArrayLike | None = None) -> NDArray[np.float64]:
        """Configuration at `u`: `(n,)`, or `(N, n)` for `(N,)`. A point needs no `u`.

        Principal values, unless these violate a limit and another winding does not.

        Raises:
            RedundancyError: `u` is not finite, is beyond the ends of an open curve, or is missing for a curve.
        """
    def tangent(self, u: float | ArrayLike) -> NDArray[np.float64]:
        """dq/du at `u`: `(n,)`, or `(N, n)` for `(N,)`; finite and not zero.

        Raises:
            RedundancyError: as `q`; a point has no tangent.
        """
    def intervals(self, margin: float = 0.0) -> NDArray[np.float64]:
        """Intervals of `u` in which all joint limits hold in some winding, `(k, 2)`, ascending.

        On a closed curve `u` is inside `[lo, hi]` when `(u - lo) mod 2 pi <= hi - lo`. For a point, `[[0, 0]]` or an
        empty array.

        Args:
            margin: Distance from each limit, rad or m.
        """
    def parameter(self, u: float | ArrayLike | None = None) -> float | NDArray[np.float64] | None:
        """Value of the parameter named by the closed form (swivel: rad in [-pi, pi]) at `u`.

        `None` where there is none.

        Args:
            u: Parameter on the piece: a number or `(N,)`; not needed for a point.
        """

@final
class Solution:
    """A configuration chosen from `Solutions`; its parts are `None` if no configuration is within the limits."""

    @property
    def q(self) -> NDArray[np.float64] | None:
        """Joint positions `(n,)` within the limits."""
    @property
    def piece(self) -> Piece | None:
        """Its piece."""
    @property
    def u(self) -> float | None:
        """Its parameter on the piece, in the unit of `Piece.parameter`."""
    @property
    def value(self) -> float | None:
        """The criterion there in its own unit, or the distance in joint space, rad or m."""
    @property
    def status(self) -> Status:
        """`converged`, `limits` or `unreachable`."""
    @property
    def reason(self) -> str:
        """Why there is none, or why it is not proven to be the best; empty otherwise."""
    @property
    def proven(self) -> bool:
        """Whether it is certain that no configuration for the pose is better, or that there is none."""

# planning

@final
class SwivelPlan(Plan):
    """A plan of an S-R-S arm with the swivel of each row; `plan_swivel` has one row per path point.

    `converged`; `infeasible`: reconfigurations are needed; `unreachable`, `limits` or `collision`: some points have
    no configuration (no rows), or none at the fixed swivel or branch (rows up to there); `time_limit`: no rows.
    """

    @property
    def swivel(self) -> NDArray[np.float64]:
        """Swivel of each row `(N,)`, rad, unwound."""
    @property
    def branch(self) -> NDArray[np.int8]:
        """Signs (shoulder, elbow, wrist) of each row, `(N, 3)`."""
    @staticmethod
    def _from_arrays(arrays: Any) -> SwivelPlan: ...

def plan_swivel(
    arm: SrsArm,
    path: Path,
    scene: Scene | None = None,
    cyclic: bool = False,
    desired: float | ArrayLike | None = None,
    wanted_clearance: float | None = None,
    link_radius: float | None = None,
    velocity_limits: Literal["chain"] | ArrayLike | None = "chain",
    *,
    fixed: float | ArrayLike | None = None,
    branch: str | Sequence[int] | None = None,
    margin: float = 0.0,
    swivels: int | None = None,
    limit_weight: float | None = None,
    motion_weight: float | None = None,
    swivel_weight: float | None = None,
    clearance_weight: float | None = None,
    manipulability_weight: float | None = None,
    acceleration_weight: float | None = None,
    links: LinkGeometry | None = None,
    self_collision: bool | Literal["auto"] = "auto",
    progress: Callable[[float], object] | None = None,
    time_limit: float | None = None,
) -> SwivelPlan:
    """Plan the swivel along a whole path: on one branch, without jumps, away from the limits.

    Dynamic programming over points x swivels, all branches and windings, then refinement in a shrinking tube. Minimises
    `w_l sum L + w_s sum (1 - cos(s - desired)) + w_m sum |dq|^2` per share of the path, with
    `L = sum (x^2 / (1 - x^2))^2` for joints at x in (-1, 1) of their range. As few reconfigurations as possible.

    Args:
        arm: The arm.
        path: With orientations. With times, the joint velocity limits hold between points.
        scene: Obstacles; contact is forbidden. Moving obstacles are at their positions at the times of the path.
        cyclic: The arm ends in the configuration in which it began; the path must be closed.
        desired: Desired swivel, rad: one, or `(N,)`.
        wanted_clearance: Wanted distance from the obstacles, m (0.03).
        link_radius: Links are capsules of this radius, m (0.05), if no `links` are given.
        links: Shapes of the links, and the pairs that must not touch.
        self_collision: Whether links must not touch each other. `"auto"`: if `links` has pairs. `True` without
            `links`: the pairs of joint-to-joint capsules that are found by sampling.
        fixed: Swivel that is kept exactly: one, or `(N,)`; only branch and windings are chosen.
        branch: Keep to these signs (shoulder, elbow, wrist), (1, -1, 1) or "+-+".
        margin: Distance kept from every joint limit, rad.
        velocity_limits: `"chain"` (default), `(7,)` rad/s, or `None` for off.
        swivels: Grid cells of the circle (180).
        limit_weight: w_l (1).
        motion_weight: w_m (0.5).
        swivel_weight: w_s (10 000).
        clearance_weight: Weight of the shortfall from the wanted distance, as a share of that distance (10 000).
        manipulability_weight: Weight of `(1 - m/m_max)^2` with m the root of det(J J^T) (0).
        acceleration_weight: Weight of the second differences of the joints, in the refinement (0).
        progress: Called with the share of the work done.
        time_limit: Seconds after which the search ends without a plan; `None` is off.

    Raises:
        RedundancyError: A setting out of its range, a path without orientations, with `cyclic` one that is not closed.
    """

@final
class SwivelFlow:
    """The swivel from a dynamical system, one step at a time, beside obstacles.

    `"paper"` and `"paper_u"` are Moore & Oztop's eqs (30) to (32) as printed, on s and on u. `"robust"` takes the
    sine of the error, the analytic gradient of the distance, forces away from singularities and limits, a rate limit
    and a barrier that takes the obstacles' own motion into account. All of them decide locally and can be trapped;
    `plan_swivel` considers the whole path.

    Args:
        arm: The arm.
        desired: Desired swivel, rad: a number, `(N,)` with one per path point, or a callable of the time.
        scene: Obstacles.
        form: `"robust"`, `"paper"`, `"paper_u"`.
        link_radius: Links are capsules of this radius, m (0.05), if no `links` are given.
        links: Shapes of the links, and the pairs that must not touch.
        self_collision: Whether links must not touch each other; `"auto"`: if `links` has pairs.
        branch: Signs (shoulder, elbow, wrist), (1, -1, 1) or "+-+"; default "+++".
        tau: Time constant, s (0.1).
        lambda_: Paper: share of the desired swivel (0.5).
        gain: Paper: k of the force k/|d| (0.02).
        epsilon: Paper: half the difference step, rad (0.001).
        weights: Robust: shares of desired swivel, obstacles, singularities, limits (0.4, 0.4, 0.05, 0.15).
        max_rate: Robust: rad/s (3).
        safe_distance: Robust: distance that is kept, m (0.02).
        active_distance: Robust: where the obstacle's force begins, m (0.1).
        barrier_rate: Robust: bound of the rate at which the distance may shrink, 1/s (5).
    """

    def __new__(
        cls,
        arm: SrsArm,
        desired: float | ArrayLike | Callable[[float], float],
        scene: Scene | None = None,
        form: str = "robust",
        link_radius: float | None = None,
        *,
        branch: str | Sequence[int] | None = None,
        tau: float | None = None,
        lambda_: float | None = None,
        gain: float | None = None,
        epsilon: float | None = None,
        weights: Sequence[float] | None = None,
        max_rate: float | None = None,
        safe_distance: float | None = None,
        active_distance: float | None = None,
        barrier_rate: float | None = None,
        links: LinkGeometry | None = None,
        self_collision: bool | Literal["auto"] = "auto",
    ) -> Self: ...
    def step(
        self,
        pose: _Pose,
        s: float,
        dt: float,
        t: float = 0.0,
        q: ArrayLike | None = None,
        rate: float | None = None,
    ) -> float:
        """The swivel (rad) at `pose` and time `t`, from the swivel `s` a time `dt` before.

        Args:
            pose: The tool pose at `t`.
            s: The swivel before, rad.
            dt: Time since then, s.
            t: Time, for the positions of moving obstacles, s.
            q: `(7,)` joints before. With them the robust form keeps the joint speed limits if some swivel within
                `max_rate` allows that, as `follow` does.
            rate: Rate of the swivel before, rad/s. With it the robust form smooths the new one, and beside an
                obstacle reverses only for more than a small force, as `follow` does.

        Raises:
            RedundancyError: A pose out of reach, `dt <= 0`, numbers that are not finite.
        """
    def follow(
        self,
        path: Path,
        s0: float,
        dt: float,
        *,
        progress: Callable[[float], object] | None = None,
        time_limit: float | None = None,
    ) -> SwivelPlan:
        """Follow a path with times, one row every `dt` s.

        Args:
            path: Tool poses with times.
            s0: Swivel at the first pose, rad.
            dt: Time between rows, s.
            progress: Called with the share of the work done, 0 to 1.
            time_limit: Seconds after which it ends with the rows so far.

        Returns:
            Rows with `swivel` and `clearance`; `status` is `limits` if the arm left the joint limits, `infeasible` if
            it ran into an obstacle or a joint was too fast, and `reason` says when and by how much. `time_limit`: the
            rows so far.

        Raises:
            RedundancyError: A path without times or orientations, a point out of reach.
        """
    @property
    def form(self) -> str:
        """Which dynamical system."""
    @property
    def arm(self) -> SrsArm:
        """The arm."""
    @property
    def scene(self) -> Scene:
        """The obstacles."""

# painting

@final
class OrientationRule:
    """A rule from positions to tool orientations; made by the functions of `redundancy.orientation_rules`.

    Calling it with positions `(N, 3)` or `(3,)`, m, gives rotations `(N, 3, 3)` or `(3, 3)`. Its arguments are
    described in those functions.
    """

    def __new__(
        cls,
        kind: str,
        *,
        angle: float | None = None,
        spin: str = "pointing",
        beta: float | None = None,
        alpha: float | None = None,
        k_err: float | None = None,
        k_tcp: float | None = None,
        distance: float | None = None,
        gamma: float | None = None,
        k_x: float | None = None,
        orientation: ArrayLike | None = None,
        center: Sequence[float] | None = None,
        half_extents: Sequence[float] | None = None,
        radius: float | None = None,
    ) -> Self: ...
    def __call__(self, positions: ArrayLike) -> NDArray[np.float64]:
        """Orientations of positions.

        Raises:
            RedundancyError: A position that is not finite, cones that miss each other (row and angle are named).
        """
    @property
    def kind(self) -> str:
        """Name of the rule."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class MaxSpeed:
    """The largest constant tool speed along a path, and what limits it."""

    @property
    def speed(self) -> float:
        """m/s."""
    @property
    def limiting_joint(self) -> int:
        """Index of the limiting joint."""
    @property
    def limiting_joint_name(self) -> str:
        """Its name."""
    @property
    def limit(self) -> str:
        """`"torque"` or `"velocity"`."""
    @property
    def at(self) -> int:
        """The path point at which the limit is reached, from 0."""
    @property
    def proven(self) -> bool:
        """Whether no other joint motion over the path is faster.

        True with `q` given, and where all branches of a six-joint arm were compared; `False` where lines from a few
        starts, or the one from `q0`, were followed.
        """
    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions `(N, n)`, rad."""
    @property
    def torques(self) -> NDArray[np.float64]:
        """Joint torques `(N, n)` at `speed`, N m; zeros for a chain without inertias."""
    @property
    def point_speeds(self) -> NDArray[np.float64]:
        """Largest constant speed `(N,)` that each point would allow on its own, m/s."""
    @staticmethod
    def _from_parts(
        at: tuple[float, int, bool, int],
        q: list[float],
        torques: list[float],
        point_speeds: list[float],
        joint_name: str,
        proven: bool,
    ) -> MaxSpeed: ...

@final
class Finding:
    """One error or warning about a trajectory: an entry of `CheckReport.findings`."""

    def __new__(
        cls,
        kind: str,
        row: int,
        rows: tuple[int, int],
        t: float,
        joint: str | None,
        link: str | None,
        value: float,
        bound: float,
        message: str,
    ) -> Self: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    @property
    def kind(self) -> str:
        """What is wrong, as one word.

        `position`, `velocity`, `acceleration`, `jerk`, `torque`, `step`, `not_at_rest`, `winding`, `singularity`,
        `self_collision`, `collision`, `path_deviation` or `time`.
        """
    @property
    def severity(self) -> Literal["error", "warning"]:
        """`winding` and `singularity` are warnings, the others errors."""
    @property
    def row(self) -> int:
        """The row nearest to the worst violation, from 0."""
    @property
    def rows(self) -> tuple[int, int]:
        """First and last row of the part of the motion with this error."""
    @property
    def t(self) -> float:
        """Time of the worst violation, s."""
    @property
    def joint(self) -> str | None:
        """The joint, if a single joint is the cause."""
    @property
    def link(self) -> str | None:
        """The link, if a single link is the cause."""
    @property
    def value(self) -> float:
        """What was measured, in the unit of `bound`."""
    @property
    def bound(self) -> float:
        """What is allowed, in the unit of `value`."""
    @property
    def message(self) -> str:
        """The finding as a sentence."""

@final
class CheckReport:
    """What `check` found. It is true when there is no error; its length is the number of rows."""

    def __new__(cls, findings: Sequence[Finding], rows: int, judged: bool) -> Self: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __len__(self) -> int: ...
    def __bool__(self) -> bool: ...
    @property
    def findings(self) -> list[Finding]:
        """By row, then by kind."""
    @property
    def ok(self) -> bool:
        """No error; there may be warnings."""
    @property
    def judged(self) -> bool:
        """Whether the motion was checked; False if times do not increase, which is then the only finding."""
    @property
    def errors(self) -> int:
        """Number of findings that are errors."""
    @property
    def warnings(self) -> int:
        """Number of findings that are warnings."""

def joint_move(
    chain: Chain | Any,
    q_from: ArrayLike,
    q_to: ArrayLike,
    *,
    scene: Scene | None = None,
    links: LinkGeometry | float | None = None,
    velocity_limits: ArrayLike | Literal["chain"] | None = "chain",
    acceleration_limits: ArrayLike | Literal["chain"] | None = "chain",
    jerk_limits: ArrayLike | None = None,
    clearance: float = 0.0,
) -> Trajectory:
    """A straight move in joint space from rest to rest, as fast as the limits allow, checked before it is returned.

    Args:
        chain: The arm, or an arm object.
        q_from: `(n,)` where the arm is, rad or m.
        q_to: `(n,)` where it should be.
        scene: Obstacles.
        links: Shapes of the links, or a radius (m) of capsules from joint to joint; 0.05 by default.
        velocity_limits: `(n,)` rad/s or m/s, `"chain"`, or None.
        acceleration_limits: `(n,)` rad/s^2 or m/s^2, `"chain"`, or None; each joint needs one.
        jerk_limits: `(n,)` or one number for all, rad/s^3 or m/s^3; None lets accelerations jump.
        clearance: Least distance from obstacles, m.

    Raises:
        CannotFollowError: The move makes contact or leaves the joint limits; the message says which link and
            obstacle, or which joint, and when.
        RedundancyError: Wrong lengths, invalid limits, a joint without an acceleration limit.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("panda")
        >>> move = rd.joint_move(arm, [0, 0.3, 0, -1, 0.2, 1, 0], [0.5, 0.3, 0, -1, 0.2, 1, 0])
        >>> rd.check(arm, move).ok
        True
    """

def check(
    chain: Chain | Any,
    trajectory: Trajectory | str | PathLike[str],
    path: Path | None = None,
    *,
    scene: Scene | None = None,
    links: LinkGeometry | float | None = None,
    velocity_limits: ArrayLike | Literal["chain"] | None = "chain",
    acceleration_limits: ArrayLike | Literal["chain"] | None = "chain",
    jerk_limits: ArrayLike | None = None,
    torque_limits: ArrayLike | Literal["chain"] | None = None,
    at_rest: bool = True,
    tolerance: float | None = None,
    position_tolerance: float | None = None,
    orientation_tolerance: float | None = 0.01,
    singularity: float | None = None,
    clearance: float = 0.0,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    threads: int | None = None,
) -> CheckReport:
    """Check a joint trajectory before an arm runs it: limits, jumps, rest, contact, deviation from a path.

    Checked is the curve that `Trajectory.sample` gives, so also the motion between the rows. Consecutive intervals
    with the same error of the same joint are one finding.

    Args:
        chain: The arm, or an arm object.
        trajectory: A trajectory or plan, or a file of any origin: JSON (ROS `JointTrajectory`), CSV or npz. The joints
            may be in any order.
        path: The path that the tool should follow, except in rows of the sections `lead_in`, `blend` and `lead_out`.
        scene: Obstacles.
        links: Shapes of the links, or a radius (m) of capsules from joint to joint; 0.05 by default. Pairs of a
            `LinkGeometry` must not touch each other: `self_collision`.
        velocity_limits: `(n,)` rad/s or m/s, `"chain"`, or None for off.
        acceleration_limits: `(n,)` rad/s^2 or m/s^2, `"chain"`, or None for off.
        jerk_limits: `(n,)` or one number for all, rad/s^3 or m/s^3.
        torque_limits: `(n,)` N m or N, `"chain"`, or None for off (default); needs a chain with inertias.
        at_rest: Whether the first and the last row must be at rest.
        tolerance: Share of a limit by which it may be exceeded, 0.001 by default. The effect of rounding times to
            nanoseconds is allowed in addition.
        position_tolerance: Largest distance from the path, m; 0.001 by default.
        orientation_tolerance: Largest angle from the path's orientation, rad, 0.01 by default; None for off, as for a
            plan with a free tool.
        singularity: Ratio of the least to the largest singular value of the Jacobian below which a row is near a
            singularity, 0.001 by default; 0 is off.
        clearance: Least distance from obstacles, m.
        gravity: `(3,)` m/s^2, world axes.
        threads: Threads; all cores by default.

    Raises:
        RedundancyError: Joints that are missing or not the chain's, positions that seem to be in degrees, no rows,
            settings out of range.
        FileFormatError: A file that cannot be read.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("panda")
        >>> move = rd.retime(arm, [[0, 0.3, 0, -1, 0.2, 1, 0], [0.5, 0.3, 0, -1, 0.2, 1, 0]])
        >>> rd.check(arm, move).ok
        True
        >>> fast = rd.Trajectory(move.joint_names, move.t / 2, move.q, 2 * move.qd)
        >>> sorted({finding.kind for finding in rd.check(arm, fast).findings})
        ['acceleration', 'velocity']
    """

@final
class RetimedTrajectory(Trajectory):
    """A joint path with its times: what `retime` returns, the trajectory with what was done to it."""

    def __new__(
        cls,
        trajectory: Trajectory,
        limiting: Sequence[str | None],
        path_rows: Sequence[int],
        stops: Sequence[int],
        stretched: float,
        blends: Sequence[int] = (),
    ) -> Self: ...
    @property
    def limiting(self) -> list[str | None]:
        """Per row (N): the limit that is used most.

        `"velocity:<joint>"`, `"acceleration:<joint>"`, `"jerk:<joint>"`, `"torque:<joint>"` or `"tool_speed"`; None
        if nothing moves.
        """
    @property
    def path_rows(self) -> list[int]:
        """Rows of the trajectory that are rows of the path, one for each, in order.

        With `dt=` the rows nearest to them.
        """
    @property
    def stops(self) -> list[int]:
        """Rows of the path at which the arm stops on the way: corners, and rows that repeat."""
    @property
    def blends(self) -> list[int]:
        """Rows of the path whose corners the arm passes without a stop, see `blend`."""
    @property
    def stretched(self) -> float:
        """Largest ratio by which a section between two stops was slowed down after it was solved; 1.0 for none."""

def retime(
    chain: Chain | Any,
    trajectory: Trajectory | ArrayLike,
    *,
    tool_speed: float | None = None,
    velocity_limits: ArrayLike | Literal["chain"] | None = "chain",
    acceleration_limits: ArrayLike | Literal["chain"] | None = "chain",
    jerk_limits: ArrayLike | None = None,
    torque_limits: ArrayLike | Literal["chain"] | None = None,
    at_rest: bool = True,
    corner_angle: float = 0.02,
    blend: float = 0.0,
    dt: float | None = None,
    rows_between: bool = True,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
) -> RetimedTrajectory:
    """Times for a joint path: as fast as every limit allows, from rest to rest.

    The joint path is the cubic spline through the rows, parametrised by chord length. The returned trajectory keeps
    the limits as `Trajectory.sample` interpolates it: cubic between the rows, quintic with jerk limits. Without jerk
    limits the time law is that of [PhamPham2018]; with them a barrier method finds a local optimum. Rows of the path
    stay rows, in order; rows are added where the phases of a straight motion change and between the rows of coarse
    paths (`path_rows` gives those of the path).

    Args:
        chain: the arm, `n` joints.
        trajectory: a trajectory or plan whose times are replaced, or joint rows `(N, n)`, rad or m.
        tool_speed: largest speed of the tool, m/s; reached wherever the joints allow it.
        velocity_limits: `(n,)`, rad/s or m/s, "chain" for those of the chain, None for none.
        acceleration_limits: `(n,)`, rad/s^2 or m/s^2, "chain" or None; each joint needs one, or a torque limit.
        jerk_limits: `(n,)` or one number for all, rad/s^3 or m/s^3; None lets accelerations jump.
        torque_limits: `(n,)`, N m or N, "chain" or None; needs a chain with inertias.
        at_rest: whether the motion starts and ends at rest; otherwise as fast as the limits allow.
        corner_angle: changes of direction in joint space above this angle (rad) are corners, where the arm stops. The
            turning of a smooth curve from row to row does not count.
        blend: distance (m) from a corner within which the tool may pass it without a stop, on a curve in place of the
            corner; a turn of the tool counts 0.1 m per radian. The curve takes at most half of the path to the next
            corner or end and stays within the position limits; where none does, where the path turns back, and where a
            stop takes less time (short curves with limited jerk), the arm stops. Rows on a curve have the section
            `blend`; rows of the path that it replaces are moved onto it.
        dt: interval (s) of the rows of the result, which then replace those of the path.
        rows_between: whether rows may be added between those of the path: where the phases of a straight motion
            change, and where rows are sparse. If False, there is one row per row of the path, and the motion may be
            slower.
        gravity: `(3,)`, m/s^2, world axes.

    Returns:
        The trajectory with `.t`, `.q`, `.qd`, `.section`, with jerk limits `.qdd`, and `.limiting`. Its events name the
        corners at which the arm stops and those that it passes, and how far from them.

    Raises:
        RedundancyError: fewer than two rows, numbers that are not finite, limits that are not positive, a joint with
            neither an acceleration nor a torque limit.
        CannotFollowError: a torque limit that is too small to hold the arm at rest.

    Example:
        >>> import numpy as np
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("panda")
        >>> move = rd.retime(arm, np.linspace(arm.lower * 0.5, arm.upper * 0.5, 50), jerk_limits=500.0)
    """

def max_speed(
    chain: Chain,
    path: Path,
    orientation_rule: Callable[[NDArray[np.float64]], ArrayLike] | None = None,
    q: ArrayLike | None = None,
    q0: ArrayLike | None = None,
    tool: _Pose | None = None,
    torque_limits: Literal["chain"] | ArrayLike | None = "chain",
    velocity_limits: Literal["chain"] | ArrayLike | None = "chain",
    *,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    joint_limits: bool = True,
) -> MaxSpeed:
    """The largest constant tool speed along a path, computed exactly: without friction `tau = G + v^2 D`.

    Args:
        chain: The arm.
        path: Positions with `orientation_rule`, poses without.
        orientation_rule: From `redundancy.orientation_rules`, or any callable from positions `(N, 3)` to rotations
            `(N, 3, 3)`.
        q: Joint positions `(N, n)`, one row per path point, instead of solving inverse kinematics.
        q0: Configuration `(n,)` near the start that fixes the branch; without it the fastest branch that can follow
            the path is taken.
        tool: Pose of the tool in the last link, instead of the chain's.
        torque_limits: `"chain"` (default), `(n,)` N m, or `None` for off.
        velocity_limits: `"chain"` (default), `(n,)` rad/s, or `None` for off.
        gravity: m/s^2, world axes.
        joint_limits: Whether the chosen branch must keep the position limits; not used with `q` or `q0`.

    Raises:
        RedundancyError: A path that cannot be reached or followed (the points are named), torque limits that do not
            compensate gravity (joint and point), no inertias, no limit, no length.
    """

@final
class SpeedProfile:
    """A motion along a path with variable tool speed."""

    @property
    def s(self) -> NDArray[np.float64]:
        """Arc length `(N,)`, m."""
    @property
    def speed(self) -> NDArray[np.float64]:
        """Tool speed `(N,)`, m/s."""
    @property
    def acceleration(self) -> NDArray[np.float64]:
        """Acceleration of the tool along the path from each point to the next `(N,)`, m/s^2."""
    @property
    def t(self) -> NDArray[np.float64]:
        """Time `(N,)`, s."""
    @property
    def duration(self) -> float:
        """Time of the whole path, s."""
    @staticmethod
    def _from_parts(
        s: list[float], speed: list[float], acceleration: list[float], t: list[float]
    ) -> SpeedProfile: ...

def fastest_profile(
    chain: Chain,
    path: Path,
    q: ArrayLike,
    *,
    start_speed: float = 0.0,
    end_speed: float = 0.0,
    tool: _Pose | None = None,
    torque_limits: Literal["chain"] | ArrayLike | None = "chain",
    velocity_limits: Literal["chain"] | ArrayLike | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
) -> SpeedProfile:
    """The fastest motion along given joint positions with variable tool speed, by two passes [PhamPham2018].

    Args:
        chain: The arm.
        path: The path; only its arc lengths count.
        q: Joint positions `(N, n)`, one row per path point.
        start_speed: Tool speed at the start, m/s.
        end_speed: Tool speed at the end, m/s.
        tool: Pose of the tool in the last link, instead of the chain's.
        torque_limits: `"chain"` (default), `(n,)` N m, or `None` for off.
        velocity_limits: `"chain"`, `(n,)` rad/s, or `None` for off (default).
        gravity: m/s^2, world axes.

    Raises:
        RedundancyError: As for `max_speed`; a speed at an end that is not possible.
    """

@final
class OrientationPlan(Plan):
    """A plan at constant tool speed with tilt and spin of the tool, one row per entry of `s`.

    The entries of `s` are at most 0.4 mm apart. `tilt` is the rotation vector in the path's frame, `spin` is about the
    tool axis from the path's orientation. `status` is `converged`; `time_limit` or `cancelled` (the best so far);
    `unreachable` or `infeasible` (no rows). With `unreachable`, `blocked` lists the path points that no configuration
    reaches.
    """

    @property
    def speed(self) -> float:
        """Constant tool speed, m/s, verified at every row; 0 without a plan."""
    @property
    def constant_speed(self) -> float | None:
        """The same for the path's own orientation on the fastest branch, where it can be followed."""
    @property
    def s(self) -> NDArray[np.float64]:
        """Arc length `(N,)` of each row, m."""
    @property
    def poses(self) -> NDArray[np.float64]:
        """Tool poses `(N, 4, 4)`."""
    @property
    def torques(self) -> NDArray[np.float64]:
        """Joint torques `(N, n)` at `speed`, N m."""
    @property
    def tilt(self) -> NDArray[np.float64]:
        """Rotation vector `(N, 2)` of the swing across the tool axis, rad."""
    @property
    def spin(self) -> NDArray[np.float64]:
        """Twist `(N,)` about the tool axis against the path's orientation, rad, continuous."""
    @property
    def status(self) -> Status:
        """Outcome: `converged` (continuous, legal, a local optimum), or why not."""
    @property
    def reason(self) -> str:
        """Why it is not `converged`; empty when it is."""
    @property
    def limiting_joint(self) -> int | None:
        """Index of the limiting joint; `None` if the rate of the orientation is the limit."""
    @property
    def limiting_joint_name(self) -> str | None:
        """Its name."""
    @property
    def limit(self) -> str:
        """`"torque"` or `"velocity"`."""
    @property
    def at(self) -> int:
        """The row at which the limit is reached."""
    @property
    def blocked(self) -> list[int]:
        """Points of the path without any configuration."""
    @property
    def starts(self) -> int:
        """Starts that could be followed."""
    @property
    def steps(self) -> int:
        """Convex programs solved."""
    @staticmethod
    def _from_parts(
        arrays: Any,
        speeds: tuple[float, float | None, Sequence[float]],
        counts: tuple[tuple[int, int | None, bool] | None, int, int],
    ) -> OrientationPlan: ...

@final
class ToolFreedom:
    """How far the tool may tilt and spin away from the path's orientation at each point.

    The tool axis stays within `half_angle` of the path's tool axis. The spin is the twist about the tool axis in the
    swing-twist decomposition of `R_path^T R`, continuous along the path. If both are 0, the full pose is kept.

    Args:
        half_angle: Largest angle between the tool axis and the path's, rad, in `[0, pi/2)`.
        spin: Largest spin to either side of the path's orientation, rad, or `"free"`.
        axis: Tool axis `(3,)` in the tool frame, of any length; z when left out.

    Raises:
        RedundancyError: An angle out of its range, an axis without length.

    Example:
        >>> import numpy as np
        >>> import redundancy as rd
        >>> rd.ToolFreedom(half_angle=np.deg2rad(20), spin="free").spin
        'free'
    """

    def __new__(
        cls,
        half_angle: float = 0.0,
        spin: Literal["free"] | float = 0.0,
        axis: ArrayLike | None = None,
    ) -> ToolFreedom: ...
    @property
    def half_angle(self) -> float:
        """Largest angle between the tool axis and the path's, rad."""
    @property
    def spin(self) -> Literal["free"] | float:
        """Largest spin to either side, rad, or `"free"`."""
    @property
    def axis(self) -> list[float]:
        """The tool axis in the tool frame, a unit vector."""

@disjoint_base
class Plan(Trajectory):
    """A motion along a path with status and reason: the result of every planner and every step-by-step scheme.

    A `Trajectory` that also holds, for each row, how the freedom is used. A column that the scheme does not compute
    is `None`.

    Example:
        >>> import numpy as np, redundancy as rd
        >>> arm = rd.SrsArm(rd.catalog.load("pa10"))
        >>> plan = rd.plan_swivel(arm, rd.paths.circle([0.45, 0, 0.5], 0.12, orientation=np.diag([1, -1, -1]), n=50))
        >>> str(plan.status), plan.legal, len(plan.spare["swivel"])
        ('converged', True, 50)
    """

    def retime(self, chain: Chain | Any | None = None, **options: Any) -> RetimedTrajectory:
        """Times for the rows of the plan: as fast as every limit allows, from rest to rest.

        Args:
            chain: the arm; a plan that comes straight from `rd.plan` knows it, one from a file or another planner does
                not.
            **options: the keyword arguments of `rd.retime`.

        Returns:
            What `rd.retime(chain, plan, **options)` returns.

        Raises:
            ValueError: an unknown arm, a plan with fewer than two rows, and what `rd.retime` raises.

        Example:
            >>> move = plan.retime(jerk_limits=500.0)  # doctest: +SKIP
        """
    @property
    def status(self) -> Status:
        """Outcome: `converged` (continuous, legal, a local optimum), or why not."""
    @property
    def reason(self) -> str:
        """Why it is not `converged`; empty when it is."""
    @property
    def legal(self) -> bool | None:
        """Whether limits, task, clearance and continuity hold on the verification grid, independent of the status."""
    @property
    def proven(self) -> bool:
        """True if the status is exact, False if it is the outcome of a finite search.

        `converged` means that the motion was verified, not that there is no cheaper one.
        """
    @property
    def cost(self) -> float | None:
        """The minimised cost, summed over the path, without a unit."""
    @property
    def reconfigurations(self) -> list[int]:
        """Rows before which the arm must change its configuration; none when `converged`."""
    @property
    def reconfiguration_reasons(self) -> list[str]:
        """Why each of them is needed."""
    @property
    def blocked(self) -> list[int]:
        """Points of the path without any configuration."""
    @property
    def blocked_reasons(self) -> list[str]:
        """Why each of them is blocked."""
    @property
    def s(self) -> NDArray[np.float64] | None:
        """Arc length `(N,)` of each row, m."""
    @property
    def poses(self) -> NDArray[np.float64] | None:
        """Tool poses `(N, 4, 4)`."""
    @property
    def tilt(self) -> NDArray[np.float64] | None:
        """Rotation vector `(N, 2)` of the swing across the tool axis, rad."""
    @property
    def spin(self) -> NDArray[np.float64] | None:
        """Twist `(N,)` about the tool axis against the path's orientation, rad, continuous."""
    @property
    def margin(self) -> NDArray[np.float64] | None:
        """Smallest distance `(N,)` to a joint position limit, rad or m; `inf` where no joint has one."""
    @property
    def clearance(self) -> NDArray[np.float64] | None:
        """Distance `(N,)` from the obstacles, m."""
    @property
    def self_clearance(self) -> NDArray[np.float64] | None:
        """Distance `(N,)` between links of the arm, m."""
    @property
    def row_cost(self) -> NDArray[np.float64] | None:
        """Part of the cost `(N,)` of each row."""
    @property
    def piece(self) -> NDArray[np.int64] | None:
        """The piece `(N,)` of the solutions of each row, an index of `piece_labels`."""
    @property
    def piece_labels(self) -> list[str]:
        """Names of the pieces."""
    @property
    def spare(self) -> dict[str, NDArray[np.float64]]:
        """The spare coordinates that have names: values `(N,)`, rad or m."""
    @staticmethod
    def from_npz(path: str | PathLike[str]) -> Plan:
        """Read what `to_npz` wrote.

        Args:
            path: The file.

        Raises:
            RedundancyError: A file that cannot be read or holds no plan.
        """
    @staticmethod
    def _from_arrays(arrays: Any) -> Plan: ...

def plan(
    chain: Chain | SrsArm,
    path: Path,
    freedom: ToolFreedom | None = None,
    *,
    task: str | Task | None = None,
    scene: Scene | None = None,
    links: LinkGeometry | None = None,
    self_collision: bool | Literal["auto"] = "auto",
    cyclic: bool = False,
    q_start: ArrayLike | None = None,
    q_end: ArrayLike | None = None,
    objective: str = "motion",
    motion_weight: float | None = 0.5,
    limit_weight: float | None = 1.0,
    clearance_weight: float | None = 10000.0,
    wanted_clearance: float | None = 0.03,
    link_radius: float | None = 0.05,
    criterion: Criterion | None = None,
    criterion_weight: float = 1.0,
    joint_weights: ArrayLike | None = None,
    tool_speed: float | None = None,
    velocity_limits: Literal["chain"] | ArrayLike | None = "chain",
    speed_weights: ArrayLike | None = None,
    margin: float = 0.0,
    time_limit: float = 10.0,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Plan:
    """Plan a whole path: which configuration to use at every point, for any arm and any freedom of the tool.

    Minimises `sum_k D_k (limit_weight L(q_k) + clearance_weight C(q_k) + criterion) + motion_weight sum_k |W dq_k|^2
    / D_k` over all rows at once, with `D` the share of the path (of its time, if it has times), and with the terms
    `L` of the joint limits and `C` of the clearance as in docs/planning.md.

        plan = rd.plan(rd.catalog.load("panda"), path)
        plan = rd.plan(gun, path, rd.ToolFreedom(np.deg2rad(20), "free"), tool_speed=0.2)

    Args:
        chain: The arm, of `n` joints.
        path: Poses or positions to follow, one row of the plan for each.
        freedom: How far the tool may tilt and spin; `None` for the full pose (for the position, on a path of
            positions).
        task: Which coordinates count, by name or as a `Task`, instead of a freedom. `"pose"` is the default on a path
            with orientations and may be given with a freedom, which then says how far the tool may leave that pose.
        scene: Obstacles; contact is forbidden, between the rows too. Moving obstacles are at their positions at the
            times of the path.
        links: Shapes of the links, and the pairs that must not touch; without it links are capsules from joint to
            joint.
        self_collision: Whether links must not touch each other. `"auto"`: if `links` has pairs. `True` without
            `links`: the pairs of joint-to-joint capsules that are found by sampling.
        cyclic: The arm ends in the configuration in which it began, windings included; the path must be closed.
        q_start: Configuration `(n,)` at the first point.
        q_end: Configuration `(n,)` at the last point.
        objective: `"motion"`, `"length"` (of the joint motion), or `"peak_speed"` (the largest joint speed times
            `speed_weights`, then the motion; needs times).
        motion_weight: Weight of the joint motion. Default 0.5.
        limit_weight: Weight of the distance from the joint limits. Default 1.
        clearance_weight: Weight of the shortfall from the wanted distance, `sum max(0, 1 - d / wanted)^2` over links
            and obstacles. Default 10 000.
        wanted_clearance: Wanted distance from the obstacles, m; distances that the freedom cannot change do not
            count.
        link_radius: Radius of the capsules if no `links` are given, m. Default 0.05.
        criterion: Minimised or maximised along the path, according to its sense.
        criterion_weight: Its weight.
        joint_weights: Weight `(n,)` of each joint in the motion. Default 1 (1 m counts as 1 rad).
        tool_speed: Constant speed of the tool, m/s, instead of the path's times.
        velocity_limits: Largest joint speeds `(n,)`, rad/s or m/s; they bound the steps if there are times. `"chain"`
            for those of the chain, `None` for off. No joint turns by more than an eighth of a turn between rows.
        speed_weights: Weight `(n,)` of each joint in the peak speed. Default one over its limit.
        margin: Distance kept from every joint position limit, rad or m.
        time_limit: Seconds after which the best plan so far is returned, with status `time_limit`.
        seed: Seed of the random postures; the same seed gives the same plan.
        threads: Threads to use; all cores by default.
        progress: Called with the share of the work that is done. Ctrl-C returns the best so far.

    Returns:
        The plan, with `status` and `reason`.

    Raises:
        RedundancyError: Values out of their range, a freedom that does not apply, ends that are not on the path or
            break
            limits, a closed plan of an open path.
    """

def plan_orientation(
    chain: Chain,
    path: Path,
    half_angle: float,
    spin: Literal["free"] | float = "free",
    tool: _Pose | None = None,
    torque_limits: Literal["chain"] | ArrayLike | None = "chain",
    torque_margin: float = 0.0,
    velocity_limits: Literal["chain"] | ArrayLike | None = "chain",
    joint_limits: bool = True,
    max_rate: float | None = None,
    time_limit: float = 60.0,
    threads: int | None = None,
    *,
    orientation: ArrayLike | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    progress: Callable[[float, float], object] | None = None,
) -> OrientationPlan:
    """Plan tilt and spin of the tool along a whole path for the highest constant tool speed.

    Quintic splines of tilt and spin, sequential convex programming from many starts, verified on a grid at least five
    times finer. A local optimum: a lower bound of what is possible.

    Args:
        chain: The arm, six or seven joints, with inertias.
        path: Poses, whose tool axes are the axes of the cone; on a path of positions the tool points down, or has
            `orientation`.
        half_angle: Largest tilt, rad, in [0, pi/2).
        spin: `"free"`, or the largest angle about the tool axis from the path's orientation, rad.
        tool: Pose of the tool in the last link, instead of the chain's.
        torque_limits: `"chain"` (default), `(n,)` N m, or `None` for off.
        torque_margin: Share of the torque limits that is kept in reserve.
        velocity_limits: `"chain"` (default), `(n,)` rad/s, or `None` for off.
        joint_limits: Whether the position limits are imposed.
        max_rate: Largest rate of the tool's orientation, rad/s.
        time_limit: Seconds after which the best plan so far is returned.
        threads: Threads; all cores when left out.
        orientation: `(3, 3)` for the whole path, instead of the path's own.
        gravity: m/s^2, world axes.
        progress: Called about 20 times a second with the share of the time and the highest speed so far (m/s).

    Ctrl-C ends the search: the best plan so far is returned with status `cancelled`.

    Raises:
        RedundancyError: A setting out of its range, no inertias, no length, another number of joints.
    """

# rotation

@final
class Cone:
    """All orientations whose body axis lies within a half-angle of a direction; the spin about the axis is free.

    The margin is `(direction . R(q) body_axis - cos half_angle) / 2`, the paper's `eta^2 - q1^2 - q2^2`
    [FromGravdahl2009, eqs. (15), (23), (33)]. `q` is a unit quaternion `(w, x, y, z)`, `(4,)` or `(N, 4)`. For
    samples and nearest members take `QuaternionVolume.cone(body_axis, half_angle, direction)`, the same set.

    Args:
        body_axis: `(3,)`, in the body frame, of any length.
        direction: `(3,)`, in the reference frame, of any length.
        half_angle: rad, in (0, pi).

    Raises:
        RedundancyError: an axis without length, a half-angle outside (0, pi), a number that is not finite.

    Example:
        >>> import redundancy as rd
        >>> cone = rd.Cone([0, 0, 1], [0, 0, -1], 0.3)
        >>> round(cone.margin([0, 0, 1, 0]), 6)  # straight down: sin^2(0.15)
        0.022332
    """

    def __new__(cls, body_axis: ArrayLike, direction: ArrayLike, half_angle: float) -> Cone: ...
    @staticmethod
    def z(direction: ArrayLike, half_angle: float) -> Cone:
        """Cone of the body z axis around `direction`.

        Args:
            direction: `(3,)`, world axes, of any length.
            half_angle: rad, in (0, pi).
        """
    @staticmethod
    def x(direction: ArrayLike, half_angle: float) -> Cone:
        """Cone of the body x axis around `direction` [FromGravdahl2009, eq. (23)].

        Args:
            direction: `(3,)`, world axes, of any length.
            half_angle: rad, in (0, pi).
        """
    @staticmethod
    def downward(half_angle: float) -> Cone:
        """The body z axis within `half_angle` (rad) of -z [FromGravdahl2009, eq. (33)]."""
    @staticmethod
    def of_frame(frame: ArrayLike, axis: ArrayLike, half_angle: float) -> Cone:
        """The body axis `axis` around the same axis of `frame` `(w, x, y, z)` [FromGravdahl2009, eq. (24)].

        Args:
            frame: Unit quaternion `(4,)`.
            axis: `(3,)`, body axes, of any length.
            half_angle: rad, in (0, pi).
        """
    @property
    def body_axis(self) -> NDArray[np.float64]:
        """Unit axis in the body frame, `(3,)`."""
    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit direction in the reference frame, `(3,)`."""
    @property
    def half_angle(self) -> float:
        """Half-angle, rad."""
    def angle(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Angle, rad in [0, pi], between the rotated body axis and the direction: a float, or `(N,)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Smooth margin, positive inside: a float, or `(N,)` for a batch.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def gradient(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Gradient of the margin along rotation vectors in body axes, 1/rad: `(3,)` or `(N, 3)`.

        It is the derivative of `margin(q * exp(delta))` at `delta = 0`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def hessian(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Hessian of the margin along rotation vectors in body axes, 1/rad^2: `(3, 3)` or `(N, 3, 3)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def __and__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet:
        """The intersection with another set, an `OrientationSet`."""
    def __or__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet:
        """The union with another set, an `OrientationSet`."""
    def __rand__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __ror__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __getnewargs__(self) -> tuple[list[float], list[float], float]: ...

@final
class Spin:
    """All orientations with at most a given twist about a body axis from a reference; the axis may point anywhere.

    With `r = conj(reference) * q` and `r3` its part along the axis the margin is `kappa^2 - (r3 / r0)^2`,
    `kappa = tan(max_angle / 2)` [FromGravdahl2009, eqs. (20), (46)]. If the axis is turned over by half a turn, the
    spin is undefined and counts as far outside; so for a tool that points down, the reference must point down too.

    Args:
        reference: `(4,)`, unit quaternion `(w, x, y, z)`.
        max_angle: rad, in (0, pi).
        axis: `(3,)`, in the body frame.

    Raises:
        RedundancyError: a reference that is not of unit norm, an axis without length, an angle outside (0, pi).

    Example:
        >>> import redundancy as rd
        >>> spin = rd.Spin([1, 0, 0, 0], 0.5)
        >>> round(spin.twist(rd.quaternion.from_zyz([0.3, 0.2, 0.1])), 6)
        0.4
    """

    def __new__(cls, reference: ArrayLike, max_angle: float, axis: ArrayLike | None = None) -> Spin: ...
    @staticmethod
    def about_world_axis(reference: ArrayLike, max_angle: float, axis: ArrayLike) -> Spin:
        """The same with the axis given in the frame in which `reference` is given.

        Args:
            reference: Unit quaternion `(4,)` from which the twist is measured.
            max_angle: Largest twist to either side, rad.
            axis: `(3,)`, of any length.
        """
    @property
    def reference(self) -> NDArray[np.float64]:
        """Reference orientation `(w, x, y, z)`."""
    @property
    def max_angle(self) -> float:
        """Largest twist, rad."""
    @property
    def axis(self) -> NDArray[np.float64]:
        """Unit axis in the body frame, `(3,)`."""
    def twist(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Twist relative to the reference, rad in [-pi, pi], 0 where undefined: a float, or `(N,)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Smooth margin, positive inside: a float, or `(N,)` for a batch.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def gradient(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Gradient of the margin along rotation vectors in body axes, 1/rad: `(3,)` or `(N, 3)`.

        It is the derivative of `margin(q * exp(delta))` at `delta = 0`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def hessian(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Hessian of the margin along rotation vectors in body axes, 1/rad^2: `(3, 3)` or `(N, 3, 3)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __getnewargs__(self) -> tuple[list[float], float, list[float]]: ...

@final
class QuaternionVolume:
    """A set of orientations: rotations about fixed axes within bounds, or a cone.

    `q` is in the set when it is `P * Q(phi_1, n_1) * ... * Q(phi_k, n_k) * S` with every angle in its range
    [FromGravdahl2007, eqs. (6), (7), (12)]. Ranges are pairs (low, high) in rad; one of a full turn or more is
    free. Quaternions are `(w, x, y, z)`, `(4,)` or `(N, 4)`.

    Raises:
        RedundancyError: no axes, parallel consecutive axes, an axis without length, a bound that
            is not finite, a lower above its upper bound, a quaternion that is not of unit norm.

    Example:
        >>> import math
        >>> import redundancy as rd
        >>> volume = rd.QuaternionVolume.zyz((-math.pi, math.pi), (0, 0.3), (-0.5, 0.5))
        >>> volume.contains(rd.quaternion.from_zyz([1.0, 0.2, 0.4]))
        True
        >>> round(volume.margin(rd.quaternion.from_zyz([1.0, 0.2, 0.6])), 6)
        -0.1
    """

    @staticmethod
    def zyz(alpha: Sequence[float], beta: Sequence[float], gamma: Sequence[float]) -> QuaternionVolume:
        """`Rz(alpha) Ry(beta) Rz(gamma)` with a range (low, high), rad, for each."""
    @staticmethod
    def xyz(alpha: Sequence[float], beta: Sequence[float], gamma: Sequence[float]) -> QuaternionVolume:
        """`Rx(alpha) Ry(beta) Rz(gamma)` with a range (low, high), rad, for each."""
    @staticmethod
    def single_axis(axis: ArrayLike, range: Sequence[float]) -> QuaternionVolume:
        """Rotations about one axis by an angle in `range`, rad.

        Args:
            axis: `(3,)`, of any length.
            range: Least and largest angle, rad.
        """
    @staticmethod
    def pyramid(half_x: float, half_y: float) -> QuaternionVolume:
        """Tilts about x and y within half-angles (rad, below pi/2), the spin about z free.

        Args:
            half_x: Half-angle of the tilt about x, rad.
            half_y: Half-angle of the tilt about y, rad.
        """
    @staticmethod
    def cone(axis: ArrayLike, half_angle: float, direction: ArrayLike | None = None) -> QuaternionVolume:
        """Orientations whose body axis `axis` is within `half_angle` (rad) of `direction`.

        `direction` is `axis` by default, so the cone is around the identity, and the cone of -z is that of z. For a
        tool z axis that points down give `cone([0, 0, 1], half_angle, [0, 0, -1])`.

        Args:
            axis: `(3,)`, body axes, of any length.
            half_angle: rad.
            direction: `(3,)`, of any length; `axis` when left out.
        """
    @staticmethod
    def from_axes(axes: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> QuaternionVolume:
        """Rotations about the rows of `axes`, `(k, 3)`, with bounds `(k,)` in rad; the first is the outermost.

        Args:
            axes: `(k, 3)`, k at least 1.
            lower: `(k,)`, rad.
            upper: `(k,)`, rad.
        """
    @property
    def dimension(self) -> int:
        """Number of rotations; 3 for a cone."""
    def contains(self, q: ArrayLike, tol: float = 1e-9, *, threads: int | None = None) -> Any:
        """Whether `q` is a member to `tol` (rad; for a cone in its margin's unit): a bool, or `(N,)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            tol: How far outside still counts as a member, rad (for a cone in the unit of its margin).
            threads: Threads for a batch; all cores by default.
        """
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Signed margin, >= 0 inside: a float, or `(N,)`.

        For sequences the smallest angle (rad) to a bound, for cones the margin of `Cone`. It is pi without any bound,
        and minus the angle (rad) to the set if there are fewer than three rotations and `q` is outside. With more
        than three rotations there are many ways to write `q`; the margin is that of the way farthest from the
        bounds that a search from several starts finds; rarely another one is better, by some mrad.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def angles(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Angles of `q` in the sequence, rad, `(k,)` or `(N, k)`; for a cone the ZYZ angles seen from its axis.

        If there are several ways to write `q`, the one that stays farthest from the bounds.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def at(self, angles: ArrayLike) -> NDArray[np.float64]:
        """The orientation `(w, x, y, z)` at the angles `(k,)`, rad; bounds are not applied."""
    def visualising(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Visualising quaternion `(cos psi/2, sin(psi/2) z)` [FromGravdahl2007, eq. (8)]: `(4,)` or `(N, 4)`.

        `z` is the rotated last axis (of a cone its axis), `psi` the rotation about it. Together with `q` it is the
        pair (Q, V) of the paper.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def nearest(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """The member nearest to `q`, on its side of the double cover: `(4,)` or `(N, 4)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def reoriented(self, p: ArrayLike, side: Literal["left", "right"] = "left") -> QuaternionVolume:
        """`P * V` (left: the set moves in the reference frame) or `V * P` (right: another body frame).

        Args:
            p: Unit quaternion `(4,)`.
            side: `"left"` or `"right"`.
        """
    def sample(self, n: int, seed: int = 0) -> NDArray[np.float64]:
        """`n` members `(n, 4)`, uniform with respect to the invariant measure; the same seed gives the same bits."""
    def cross_section(self, distance: float, along: Literal["tool", "normal"] = "tool") -> CrossSection:
        """Region in which the tool axis z meets the plane at `distance`, perpendicular to the axis at zero tilt.

        Extents are `distance * sin(tilt)` for a distance along the tool, `distance * tan(tilt)` for one along the
        plane's normal [FromGravdahl2007, section 8, corrected].

        Raises:
            RedundancyError: a tilt of 90 degrees or more, or a volume whose section has another shape.
        """
    @staticmethod
    def _restore(
        axes: Sequence[Sequence[float]],
        lower: Sequence[float],
        upper: Sequence[float],
        half_angle: float | None,
        before: Sequence[float],
        after: Sequence[float],
    ) -> QuaternionVolume: ...
    def __and__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet:
        """The intersection with another set, an `OrientationSet`."""
    def __or__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet:
        """The union with another set, an `OrientationSet`."""
    def __rand__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __ror__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, Any]: ...

@final
class OrientationSet:
    """Intersections and unions of cones and quaternion volumes: `A & B`, `A | B`.

    Membership, margin, nearest member and uniform samples of the intersection or the union. Made by `&` and `|` of
    `Cone`, `QuaternionVolume` and `OrientationSet`; `IkSolver` takes it as `orientation_set`. The papers define the
    parts (From and Gravdahl 2007, section 3; 2009, section III). Quaternions are `(w, x, y, z)`, `(4,)` or `(N, 4)`.

    Example:
        >>> import redundancy as rd
        >>> tool = rd.Cone.z([0, 0, 1], 0.5) & rd.Cone.x([1, 0, 0], 0.8)
        >>> tool.contains([1, 0, 0, 0]), len(tool.parts), tool.operation
        (True, 2, 'and')
        >>> either = tool | rd.Cone.downward(0.3)
        >>> either.contains([0, 0, 1, 0])
        True
    """

    @property
    def operation(self) -> Literal["and", "or"]:
        """`"and"` (an intersection) or `"or"` (a union)."""
    @property
    def parts(self) -> list[Cone | QuaternionVolume | OrientationSet]:
        """The parts: cones, volumes and sets of the other operation."""
    def contains(self, q: ArrayLike, tol: float = 1e-9, *, threads: int | None = None) -> Any:
        """Whether `q` is a member: of all parts of an intersection, of one part of a union.

        Args:
            q: `(w, x, y, z)`, `(4,)` or `(N, 4)`, unit norm.
            tol: Tolerance of each part, rad (of a cone in its margin's unit), >= 0.
            threads: Size of the pool; all cores by default.

        Returns:
            A bool, or `(N,)`.

        Raises:
            RedundancyError: A quaternion that is not of unit norm, a tolerance that is negative or no number.
        """
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Signed margin, >= 0 inside: the least of an intersection's parts, the largest of a union's.

        The sign is exact. Each part has its own unit: rad for sequences of rotations, that of `Cone` for cones.

        Args:
            q: `(w, x, y, z)`, `(4,)` or `(N, 4)`, unit norm.
            threads: Size of the pool; all cores by default.

        Returns:
            A float, or `(N,)`.

        Raises:
            RedundancyError: A quaternion that is not of unit norm.
        """
    def nearest(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """The member nearest to `q`, on its side of the double cover; `q` itself when it is a member.

        For a union of volumes and cones it is the nearest of the parts' nearest members. For an intersection it is
        the result of a local search: the nearest member of one part if that lies in the others, otherwise a point on
        an edge between parts, found by alternating projections. Since the set need not be convex, a nearer member may
        exist elsewhere.

        Args:
            q: `(w, x, y, z)`, `(4,)` or `(N, 4)`, unit norm.
            threads: Size of the pool; all cores by default.

        Returns:
            `(4,)` or `(N, 4)`.

        Raises:
            RedundancyError: A quaternion that is not of unit norm; an intersection in which no member is found.
        """
    def sample(self, n: int, seed: int = 0) -> NDArray[np.float64]:
        """Members, uniform with respect to the invariant measure of rotations.

        Args:
            n: How many.
            seed: The same seed gives the same bits.

        Returns:
            `(n, 4)`, `(w, x, y, z)`.

        Raises:
            RedundancyError: No member among 200 000 draws: the set is empty, or much smaller than its parts.
        """
    def reoriented(self, p: ArrayLike, side: Literal["left", "right"] = "left") -> OrientationSet:
        """`P * A` (left: the set moves in the reference frame) or `A * P` (right: another body frame).

        Args:
            p: `(w, x, y, z)`, `(4,)`, unit norm.
            side: `"left"` or `"right"`.

        Raises:
            RedundancyError: A quaternion that is not of unit norm, an unknown side.
        """
    def __and__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __or__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __rand__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    def __ror__(self, other: Cone | QuaternionVolume | OrientationSet, /) -> OrientationSet: ...
    @staticmethod
    def _restore(
        operation: str, parts: Sequence[Cone | QuaternionVolume | OrientationSet]
    ) -> OrientationSet: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, Any]: ...

@final
class CrossSection:
    """Region in which the tool axis of a volume can meet a plane."""

    def __new__(cls, shape: str, x: Sequence[float], y: Sequence[float]) -> CrossSection: ...
    @property
    def shape(self) -> str:
        """`point`, `line`, `square` or `disc`."""
    @property
    def x(self) -> tuple[float, float]:
        """Range along x, in the unit of the distance."""
    @property
    def y(self) -> tuple[float, float]:
        """Range along y, in the unit of the distance."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __getnewargs__(self) -> tuple[str, tuple[float, float], tuple[float, float]]: ...

@final
class OrientationOptimizer:
    """Finds the orientation that minimises a weighted sum of logarithmic barriers.

    Minimises `sum_i weight_i * -log(margin_i(q))` [FromGravdahl2009, eqs. (27), (34), (43), (46)].

    If the minimiser is not unique (the spin about a common axis of cones), the one that the smallest rotation reaches
    from `q0` is returned, so that orientations along a path are continuous if each solution is the next `q0`. Without
    `q0` and with a first cone around `u` that points down it is `swing(u -> z) * [0, 0, 1, 0]`.

    Args:
        constraints: pairs (weight, constraint), weight > 0, constraint a `Cone`, a `Spin` or a cone
            `QuaternionVolume`.
        method: `auto` takes the closed form if it applies (one or two cones on one body axis below 90 degrees, with
            or without a spin about it; a spin alone), otherwise Newton's method. `closed_form` uses Newton's method
            for cones of 90 degrees and more and refuses other problems. `newton` is Riemannian Newton on S^3,
            `gradient` the paper's method, normalised in every iteration.
        tolerance: Estimated remaining angle, rad, at which the iteration stops. None: 1e-13, gradient 1e-10.
        max_iterations: None: 200, gradient 10 000.
        step: Step of `gradient` in the paper's quaternion units. None: from the cones' sizes.
        backtracking: Whether `gradient` measures the decrease of every step; False is the paper's fixed step.

    Raises:
        RedundancyError: an empty list, a weight that is not positive, a constraint of another kind, an unknown
            method, or one that does not apply.

    Example:
        >>> import redundancy as rd
        >>> down, aside = rd.Cone.downward(0.35), rd.Cone.z([0.5, 0, -1], 1.0)
        >>> best = rd.OrientationOptimizer([(1.0, down), (1.0, aside)]).solve()
        >>> str(best.status), best.method, bool((best.margins > 0).all())
        ('converged', 'closed_form', True)
    """

    def __new__(
        cls,
        constraints: Iterable[tuple[float, Cone | Spin | QuaternionVolume]],
        method: str = "auto",
        *,
        tolerance: float | None = None,
        max_iterations: int | None = None,
        step: float | None = None,
        backtracking: bool = True,
    ) -> OrientationOptimizer: ...
    @property
    def method(self) -> str:
        """The method that `solve` uses; never `auto`."""
    @property
    def constraints(self) -> list[tuple[float, Cone | Spin]]:
        """The pairs (weight, constraint)."""
    def solve(self, q0: ArrayLike | None = None) -> OrientationSolution:
        """The minimiser, iterated from `q0` `(w, x, y, z)` or, if it is outside, from a feasible start.

        Constraints that exclude each other give the status `infeasible` and the angle by which they miss each other,
        not an exception.
        """
    def value(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """The sum at `q`, infinite outside: a float, or `(N,)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def margins(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """The margins at `q` in the order of the constraints: `(k,)` or `(N, k)`.

        Args:
            q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
            threads: Threads for a batch; all cores by default.
        """
    def gradient(self, q: ArrayLike) -> NDArray[np.float64]:
        """Gradient of the sum along rotation vectors in body axes, 1/rad, `(3,)`. Raises outside.

        Args:
            q: Unit quaternion `(4,)`.
        """
    def hessian(self, q: ArrayLike) -> NDArray[np.float64]:
        """Hessian of the sum along rotation vectors in body axes, 1/rad^2, `(3, 3)`. Raises outside.

        Args:
            q: Unit quaternion `(4,)`.
        """
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class OrientationSolution:
    """Result of `OrientationOptimizer.solve`."""

    @property
    def q(self) -> NDArray[np.float64]:
        """Orientation `(w, x, y, z)`; when infeasible the one with the smallest violation."""
    @property
    def value(self) -> float:
        """Sum of weight x barrier, without a unit; infinite when infeasible."""
    @property
    def status(self) -> Status:
        """`converged`, `infeasible`, `iteration_limit` or `singular` (the spin is undefined at the minimum)."""
    @property
    def iterations(self) -> int:
        """Iterations; of the closed form the steps of its scalar root."""
    @property
    def margins(self) -> NDArray[np.float64]:
        """Margins in the order of the constraints, `(k,)`."""
    @property
    def gradient_norm(self) -> float:
        """Norm of the gradient at `q`, 1/rad; infinite when infeasible."""
    @property
    def miss_angle(self) -> float:
        """Angle, rad, by which the constraints miss each other; 0 when they meet.

        For two cones on one axis the angle between their rims, in general twice the least angle by which all of
        them have to grow. Exact for pairs of cones, an upper bound for more.
        """
    @property
    def method(self) -> str:
        """The method that was used."""
    @staticmethod
    def _restore(
        q: Sequence[float],
        value: float,
        status: str,
        iterations: int,
        margins: Sequence[float],
        gradient_norm: float,
        miss_angle: float,
        method: str,
    ) -> OrientationSolution: ...
    def __reduce__(self) -> tuple[Any, Any]: ...

def optimal_directions(
    normals: ArrayLike,
    directions: ArrayLike,
    beta: float,
    alpha: float,
    k_err: float = 1.0,
    k_tcp: float = 1.0,
    *,
    threads: int | None = None,
) -> tuple[NDArray[np.float64], Any]:
    """The best tool axes for many pairs of directions, each with a cone around it.

    Row i minimises `-k_err log((z . n - cos beta)/2) - k_tcp log((z . d - cos alpha)/2)` over unit vectors z
    [FromGravdahl2009, eq. (34)]; if the cones miss each other, z is the middle of the gap. Runs on all cores without
    the GIL; the result does not depend on their number.

    Args:
        normals: `(N, 3)` or `(3,)` for all rows, of any length: directions that the tool axis should follow. For a
            tool that looks at a surface they point into it.
        directions: `(N, 3)` or `(3,)`: the desired directions.
        beta: Half-angle around the normals, rad, in (0, pi).
        alpha: Half-angle around the desired directions, rad, in (0, pi). From pi/2 on, rows are solved by Newton's
            method.
        k_err: Weight of the first barrier, > 0.
        k_tcp: Weight of the second barrier, > 0.
        threads: Number of threads; None: all cores.

    Returns:
        Unit tool axes `(N, 3)` and statuses `(N,)`, an object array of `Status`: `converged` or `infeasible`. Two
        single directions give `(3,)` and one `Status`.

    Raises:
        RedundancyError: a row without a direction, angles or weights out of range, different lengths.

    Example:
        >>> import redundancy as rd
        >>> axes, status = rd.optimal_directions([[0, 0, -1]], [[0.5, 0, -1]], 0.4, 1.0)
        >>> axes.shape, str(status[0])
        ((1, 3), 'converged')
    """

def pose(
    position: ArrayLike,
    quaternion_wxyz: ArrayLike | None = None,
    rpy: ArrayLike | None = None,
    matrix: ArrayLike | Any | None = None,
) -> NDArray[np.float64]:
    """A pose from a position and at most one form of orientation.

    Args:
        position: `(3,)` or `(N, 3)`, m.
        quaternion_wxyz: `(4,)` or `(N, 4)`, scalar first; a norm within 1e-3 of 1 is normalised, others are refused.
        rpy: `(3,)` or `(N, 3)` roll, pitch, yaw, rad, in the order of a URDF: `R = Rz(yaw) Ry(pitch) Rx(roll)`.
            (`quaternion.from_rpy` takes the angles in the order of the product, z first.)
        matrix: `(3, 3)` or `(N, 3, 3)` rotation, or an object with `as_matrix()`. A matrix that is off by up to 1e-3
            (largest deviation of a singular value from 1) is replaced by the nearest rotation.

    Returns:
        `(4, 4)`, or `(N, 4, 4)` where an argument has a leading axis.

    Raises:
        RedundancyError: More than one orientation, wrong shapes, numbers that are not finite; a quaternion or matrix
            that is farther off, or a reflection (the message gives the deviation).

    Example:
        >>> import redundancy as rd
        >>> rd.pose((0.4, 0.0, 0.3), quaternion_wxyz=(0, 1, 0, 0))[:3, 2].tolist()
        [0.0, 0.0, -1.0]
    """

def quaternion_product(a: ArrayLike, b: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`a * b`: the rotation b and then, about fixed axes, a.

    Arguments are `(4,)` or `(N, 4)`; a single quaternion is used for all rows.

    Args:
        a: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
        b: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_conjugate(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`(w, -x, -y, -z)`, the inverse rotation, of `(4,)` or `(N, 4)`.

    Args:
        q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_rotate(q: ArrayLike, v: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Vectors `(3,)` or `(N, 3)` rotated by `(4,)` or `(N, 4)`; a single one is used for all rows.

    Args:
        q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
        v: `(3,)` or `(N, 3)`, any unit.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_from_axis_angle(
    axis: ArrayLike, angle: ArrayLike, *, threads: int | None = None
) -> NDArray[np.float64]:
    """Rotation by `angle`, rad, a number or `(N,)`, about `axis` `(3,)` or `(N, 3)` of any length.

    Args:
        axis: `(3,)` or `(N, 3)`, of any length.
        angle: A number or `(N,)`, rad.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_to_axis_angle(q: ArrayLike, *, threads: int | None = None) -> tuple[NDArray[np.float64], Any]:
    """Unit axis `(3,)` and angle, rad in [0, pi], or `(N, 3)` and `(N,)`. The axis of the identity is z.

    Args:
        q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_from_matrix(matrix: ArrayLike | Any, *, threads: int | None = None) -> NDArray[np.float64]:
    """Quaternion with a scalar part >= 0 of a rotation `(3, 3)` or `(N, 3, 3)`, or of an object with `as_matrix()`.

    A matrix that is off by up to 1e-3 (largest deviation of a singular value from 1) is replaced by the nearest
    rotation.

    Args:
        matrix: Rotations `(3, 3)` or `(N, 3, 3)`.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_to_matrix(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Rotation matrix `(3, 3)` of `(4,)`, or `(N, 3, 3)` of `(N, 4)`.

    Args:
        q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
        threads: Threads for a batch; all cores by default.
    """

def quaternion_from_zyz(angles: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`Rz(a) Ry(b) Rz(c)` as a quaternion `(w, x, y, z)`.

    Args:
        angles: `(3,)` or `(N, 3)` angles (a, b, c), rad.
        threads: Threads for a batch; all cores by default.

    Returns:
        `(4,)` or `(N, 4)`.
    """

def quaternion_to_zyz(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Angles of `Rz(a) Ry(b) Rz(c)`, rad, b in [0, pi]; where b is 0 or pi, a = 0.

    Args:
        q: Unit quaternions `(4,)` or `(N, 4)`.
        threads: Threads for a batch; all cores by default.

    Returns:
        `(3,)` or `(N, 3)`, rad.
    """

def quaternion_from_xyz(angles: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`Rx(a) Ry(b) Rz(c)` as a quaternion `(w, x, y, z)`.

    Args:
        angles: `(3,)` or `(N, 3)` angles (a, b, c), rad.
        threads: Threads for a batch; all cores by default.

    Returns:
        `(4,)` or `(N, 4)`.
    """

def quaternion_to_xyz(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Angles of `Rx(a) Ry(b) Rz(c)`, rad, b in [-pi/2, pi/2]; where b is +-pi/2, a = 0.

    Args:
        q: Unit quaternions `(4,)` or `(N, 4)`.
        threads: Threads for a batch; all cores by default.

    Returns:
        `(3,)` or `(N, 3)`, rad.
    """

def quaternion_from_rpy(angles: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`Rz(phi) Ry(theta) Rx(psi)` as a quaternion `(w, x, y, z)`.

    Args:
        angles: `(3,)` or `(N, 3)` angles (phi, theta, psi), rad.
        threads: Threads for a batch; all cores by default.

    Returns:
        `(4,)` or `(N, 4)`.
    """

def quaternion_to_rpy(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Angles (phi, theta, psi) of `Rz(phi) Ry(theta) Rx(psi)`, rad; where theta is +-pi/2, psi = 0.

    Args:
        q: Unit quaternions `(4,)` or `(N, 4)`.
        threads: Threads for a batch; all cores by default.

    Returns:
        `(3,)` or `(N, 3)`, rad.
    """

def quaternion_swing_twist(q: ArrayLike, axis: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """`(swing, twist)` with `q = swing * twist`, the twist about `axis`; at half a turn of swing the identity.

    Args:
        q: Unit quaternion `(4,)`.
        axis: `(3,)`, of any length.
    """

def quaternion_shortest_arc(start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
    """The smallest rotation from one direction to another; between opposite directions half a turn, for z about y.

    Args:
        start: `(3,)`, of any length.
        end: `(3,)`, of any length.
    """

def quaternion_error(start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
    """`conj(start) * end` with a scalar part >= 0 [FromGravdahl2009, eq. (8), on the shorter side of the cover].

    Args:
        start: Unit quaternion `(4,)`.
        end: Unit quaternion `(4,)`.
    """

def quaternion_angle(a: ArrayLike, b: ArrayLike) -> float:
    """Angle, rad in [0, pi], of the rotation between two orientations.

    Args:
        a: Unit quaternion `(4,)`.
        b: Unit quaternion `(4,)`.
    """

# Optimum: what kind it is, and where it breaks -------------------------------------------------------------------

@final
class Classification:
    """What kind of point a configuration is for a criterion, among the configurations with the same task value.

    Can be pickled.
    """

    @property
    def kind(self) -> Kind:
        """`maximum`, `minimum`, `saddle`, `degenerate`, `not_critical` or `kinematic_singularity`."""

    @property
    def eigenvalues(self) -> NDArray[np.float64]:
        """`(r,)`: eigenvalues of the reduced Hessian on an orthonormal null-space basis, ascending.

        All negative: a maximum; all positive: a minimum; both signs: a saddle; one zero: degenerate, an algorithmic
        singularity. At a point that is not critical they are the second derivatives of h along the self-motion.
        """

    @property
    def multipliers(self) -> NDArray[np.float64]:
        """`(m,)`: Lagrange multipliers `(J J^T)^-1 J grad h`."""

    @property
    def residual(self) -> float:
        """`|N^T grad h|` with an orthonormal null-space basis N: the slope of h along the self-motion."""

    @property
    def sigma_min(self) -> float:
        """Smallest singular value of the task Jacobian (unit: m or 1 by its rows)."""

    @classmethod
    def _from_parts(
        cls, kind: str, eigenvalues: list[float], multipliers: list[float], residual: float, sigma_min: float
    ) -> Classification: ...

@overload
def classify(
    chain: Chain, q: list[float] | tuple[float, ...], criterion: Criterion, task: str | Task | None = None
) -> Classification:
    """What kind of point `q` is for `criterion`, among the configurations with the same task value.

    With the multipliers `lambda = (J J^T)^-1 J grad h` the reduced Hessian is
    `W = N^T (Hess h - sum_k lambda_k Hess f_k) N`, N an orthonormal basis of the null space of J [Park1996, eq. (10)
    at critical points]. Any chain, task and degree of redundancy.

    Args:
        chain: The arm.
        q: `(n,)`, or `(N, n)` for a list of results.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.

    Raises:
        RedundancyError: a wrong length, entries that are not finite, a task that leaves no spare freedom.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> near = rd.Posture(arm, [0.3, 0.5, 0.7])
        >>> str(rd.classify(arm, [0.3, 0.5, 0.7], near, task="planar").kind)
        'minimum'
    """

@overload
def classify(chain: Chain, q: ArrayLike, criterion: Criterion, task: str | Task | None = None) -> Any:
    """What kind of point `q` is for `criterion`, among the configurations with the same task value.

    With the multipliers `lambda = (J J^T)^-1 J grad h` the reduced Hessian is
    `W = N^T (Hess h - sum_k lambda_k Hess f_k) N`, N an orthonormal basis of the null space of J [Park1996, eq. (10)
    at critical points]. Any chain, task and degree of redundancy.

    Args:
        chain: The arm.
        q: `(n,)`, or `(N, n)` for a list of results.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.

    Raises:
        RedundancyError: a wrong length, entries that are not finite, a task that leaves no spare freedom.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> near = rd.Posture(arm, [0.3, 0.5, 0.7])
        >>> str(rd.classify(arm, [0.3, 0.5, 0.7], near, task="planar").kind)
        'minimum'
    """

@final
class CriticalPoint:
    """A critical point of a criterion for a pose. Can be pickled."""

    @property
    def q(self) -> NDArray[np.float64]:
        """`(n,)`: revolute joints in principal values, unless these violate a limit and another winding does not."""

    @property
    def value(self) -> float:
        """h(q), in the criterion's own unit."""

    @property
    def within_limits(self) -> bool:
        """Whether all joint limits hold."""

    @property
    def kind(self) -> Kind:
        """`maximum`, `minimum`, `saddle` or `degenerate`."""

    @property
    def eigenvalues(self) -> NDArray[np.float64]:
        """`(r,)`, as for `Classification`."""

    @property
    def multipliers(self) -> NDArray[np.float64]:
        """`(m,)`, as for `Classification`."""

    @property
    def residual(self) -> float:
        """The same as `Classification.residual`."""

    @property
    def sigma_min(self) -> float:
        """The same as `Classification.sigma_min`."""

    @classmethod
    def _from_parts(
        cls,
        q: list[float],
        value: float,
        within_limits: bool,
        classification: tuple[str, list[float], list[float], float, float],
    ) -> CriticalPoint: ...

def constrained_optima(
    chain: Chain,
    pose: Any,
    criterion: Criterion,
    task: str | Task | None = None,
    *,
    seed: int = 0,
    starts: int | None = None,
    step: float | None = None,
) -> list[CriticalPoint]:
    """Every critical point of `criterion` found over `pose`, the best value first.

    With one spare freedom the self-motion curves are followed and every zero of the slope is polished by Newton; on
    S-R-S arms the curves are the circles of the closed form, so that none is missed, on other arms they are found
    from random starts. With more spare freedoms Newton's method runs from random starts. Points outside joint limits
    are reported with `within_limits` False; kinematic singularities are not critical points.

    Args:
        chain: The arm.
        pose: A pose; for `planar` also `(2,)`, for `position` also `(3,)`.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.
        seed: Seed of the random starts.
        starts: Number of random starts; default 100.
        step: Largest joint step between the points of a curve at which the slope is computed; default 0.1.

    Raises:
        RedundancyError: an invalid pose, a task that leaves no spare freedom, settings out of range.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> points = rd.constrained_optima(arm, [2, 0], rd.Manipulability(arm, task="planar"), task="planar")
        >>> len(points), str(points[0].kind), round(points[0].value, 4)
        (12, 'maximum', 75.0395)
    """

@final
class CofactorCondition:
    """Sufficient condition of [Park1996, eqs (8), (9), (11)] by cofactors, for one spare freedom. Can be pickled."""

    def __new__(cls, n: ArrayLike, mu: float, condition: float) -> CofactorCondition: ...
    @property
    def n(self) -> NDArray[np.float64]:
        """`(n,)`: null vector of cofactors, `|n|^2 = det J J^T`."""

    @property
    def mu(self) -> float:
        """`n . grad h`, in the criterion's unit per rad: zero at critical points."""

    @property
    def condition(self) -> float:
        """The paper's A, `det(J J^T)` times the eigenvalue of `classify`: negative at a maximum."""

def cofactor_condition(
    chain: Chain, q: ArrayLike, criterion: Criterion, task: str | Task | None = None
) -> CofactorCondition:
    """The paper's own n, mu and A at `q`, for tasks that leave one spare freedom.

    Args:
        chain: The arm.
        q: Joint positions `(n,)`, rad or m.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.

    Raises:
        RedundancyError: a task that leaves another number of freedoms, a wrong length, entries that are not finite.

    Example:
        >>> import math, redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> p1 = [math.radians(x) for x in (-87.1742, 111.7847, 77.5352)]
        >>> round(rd.cofactor_condition(arm, p1, rd.Manipulability(arm, task="planar"), task="planar").condition)
        -4861
    """

@final
class SelfMotionCurve:
    """A curve of configurations with one task value, by continuation. Can be pickled.

    The parameter s is the length of the curve in joint space from the first row.
    """

    @property
    def chain(self) -> Chain:
        """The arm."""

    @property
    def q(self) -> NDArray[np.float64]:
        """`(N, n)`: joint configurations that change continuously; they are not shifted back into the limits.

        On a closed curve the last row is the first one plus whole turns.
        """

    @property
    def tangents(self) -> NDArray[np.float64]:
        """`(N, n)`: unit tangents, in the kernel of the task Jacobian."""

    @property
    def s(self) -> NDArray[np.float64]:
        """`(N,)`: parameter of the rows, rad (m for sliding joints)."""

    @property
    def length(self) -> float:
        """Length of the curve in joint space, rad or m."""

    @property
    def closed(self) -> bool:
        """Whether it returns to its start, modulo whole turns of revolute joints."""

    @property
    def status(self) -> Status:
        """`converged` (closed), `singular` (ends at kinematic singularities) or `iteration_limit` (`max_rows`)."""

    @property
    def events(self) -> list[Event]:
        """Joint limits that are met and ends at kinematic singularities, in the order of s; `t` is s here."""

    def at(self, s: float | ArrayLike) -> Any:
        """The configuration `(n,)` or `(N, n)` at `s`, exactly on the curve; a closed curve goes on from its start.

        Raises:
            RedundancyError: a parameter that is not finite, or beyond the ends of an open curve.
        """

    def intervals(self, margin: float = 0.0) -> NDArray[np.float64]:
        """Arcs `(k, 2)` of s on which all joint limits hold in some winding, with a distance of `margin` from each.

        An arc through the start of a closed curve ends above its length: s is inside an arc `[lo, hi]` when
        `(s - lo) mod length <= hi - lo`.

        Raises:
            RedundancyError: a margin that is negative or not finite.
        """

    def __len__(self) -> int: ...
    @classmethod
    def _from_parts(
        cls,
        chain: Chain,
        task: Task,
        target: _Pose,
        s: ArrayLike,
        q: ArrayLike,
        tangents: ArrayLike,
        status: str,
        ends: list[Event],
    ) -> SelfMotionCurve: ...

def trace_self_motion(
    chain: Chain,
    q: ArrayLike,
    task: str | Task | None = None,
    *,
    step: float | None = None,
    max_rows: int | None = None,
) -> SelfMotionCurve:
    """The self-motion through `q`: all configurations with the same task value that are connected with it.

    By prediction and correction, for any chain with one spare freedom under the task. Passes points where a joint
    turns back; ends where the curve closes or at kinematic singularities (then both directions are followed).

    Args:
        chain: The arm.
        q: `(n,)`.
        task: Which coordinates are kept; the pose by default.
        step: Largest joint step between rows; default 0.01.
        max_rows: Rows after which following the curve is stopped; default 200 000.

    Raises:
        RedundancyError: a wrong length, entries that are not finite, not exactly one spare freedom, invalid settings.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("panda")
        >>> curve = rd.trace_self_motion(arm, [0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5])
        >>> curve.closed, curve.q.shape[1]
        (True, 7)
    """

def self_motion_curves(
    chain: Chain,
    pose: Any,
    task: str | Task | None = None,
    *,
    seed: int = 0,
    starts: int = 100,
    step: float | None = None,
    max_rows: int | None = None,
) -> list[SelfMotionCurve]:
    """Every self-motion curve found over `pose`.

    For S-R-S arms these are the circles of the closed form, which are complete. For other arms they are the curves
    through the configurations that Newton's method finds from random starts. Arguments are as for `trace_self_motion`
    and `constrained_optima`.

    Args:
        chain: The arm.
        pose: `(4, 4)` or SE3-like, or what the task holds of it.
        task: Which coordinates are kept; the pose by default.
        seed: Seed of the random starts.
        starts: Their number.
        step: Distance of rows in joint space, as for `trace_self_motion`.
        max_rows: Most rows of a curve.

    Raises:
        RedundancyError: an invalid pose, not exactly one spare freedom, invalid settings.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> [curve.closed for curve in rd.self_motion_curves(arm, [2, 0], task="planar")]
        [True]
    """

def self_motion_patch(
    chain: Chain, q: ArrayLike, task: str | Task | None = None, *, spacing: float = 0.05, steps: int = 10
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A sampled patch of a self-motion of two dimensions around `q`.

    Args:
        chain: The arm; the task leaves two freedoms.
        q: `(n,)`, the middle of the patch.
        task: Which coordinates are kept; the pose by default.
        spacing: Distance of neighbours along the two null directions of `q`, in (0, 0.5].
        steps: Points on each side of the middle, at most 500.

    Returns:
        Configurations `(2 steps + 1, 2 steps + 1, n)` and whether each was found; where not, the entry is `q`.

    Raises:
        RedundancyError: a wrong length, entries that are not finite, not exactly two spare freedoms, invalid settings.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar4r")
        >>> q, valid = rd.self_motion_patch(arm, [0.2, 0.5, 0.7, 0.9], task="planar", steps=2)
        >>> q.shape, bool(valid.all())
        ((5, 5, 4), True)
    """

@final
class FollowedOptimum(Plan):
    """A critical point followed along a path: a plan with one row per path point up to its stop. Can be pickled.

    If it stopped early, the last event is an `algorithmic_singularity` or a `kinematic_singularity`; its `index` is
    the path point that was not reached, its `s` and `t` are exact. `joint_limit` events mark rows at which joints
    leave their limits or return. `status` is `converged` if the path was completed within the limits, `singular` if
    it stopped early, `limits` if a joint violates a position limit, or a speed limit at the path's times.
    """

    @property
    def kind(self) -> Kind:
        """Kind of the critical point; the same along the whole path."""

    @property
    def completed(self) -> bool:
        """Whether the path was completed."""

    @property
    def values(self) -> NDArray[np.float64]:
        """`(N,)`: the criterion at each row."""

    @property
    def sigma_min(self) -> NDArray[np.float64]:
        """`(N,)`: smallest singular value of the task Jacobian at each row."""

    @property
    def eigenvalues(self) -> NDArray[np.float64]:
        """`(N, r)`: eigenvalues of the reduced Hessian at each row, ascending."""

    @property
    def stop_q(self) -> NDArray[np.float64] | None:
        """`(n,)`: configuration at which it stopped."""

    @property
    def stop_s(self) -> float | None:
        """Arc length at which it stopped, m."""

    @staticmethod
    def _from_parts(
        arrays: Any,
        parts: tuple[
            str, Sequence[float], Sequence[float], Sequence[float], tuple[float, Sequence[float]] | None
        ],
    ) -> FollowedOptimum: ...

def follow_optimum(
    chain: Chain,
    path: Path,
    q0: ArrayLike,
    criterion: Criterion,
    task: str | Task | None = None,
    *,
    step: float | None = None,
) -> FollowedOptimum:
    """Follows the critical point of `criterion` next to `q0` along `path`: the extended Jacobian, exactly.

    Every row is on the path and critical to rounding, so closed paths are closed in the joints. It stops where the
    critical point meets another one and both vanish (algorithmic singularity) or where the Jacobian loses rank
    (kinematic singularity), and never jumps across such a point.

    Args:
        chain: The arm.
        path: Path of the tool; for `position` and `planar` it needs no orientations.
        q0: `(n,)`: a critical point for the start of the path, to about 0.02 rad; see `constrained_optima`.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.
        step: Largest step in the joints, from 1e-4 to 0.5; default 0.05.

    Raises:
        RedundancyError: a `q0` that is not a critical point for the start, a path without the orientations that the
            task needs, a task that leaves no spare freedom, invalid settings.

    Example:
        >>> import math, redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> h = rd.Manipulability(arm, task="planar")
        >>> circle = rd.paths.circle((3.5, 0, 0), 1.5, start=math.pi, n=51)
        >>> q0 = rd.constrained_optima(arm, [2, 0], h, task="planar")[0].q
        >>> rd.follow_optimum(arm, circle, q0, h, task="planar").completed
        True
    """

@final
class RankedStart:
    """A critical point at a path's start, and how far it can be followed. Can be pickled."""

    def __new__(cls, point: CriticalPoint, trajectory: FollowedOptimum) -> RankedStart: ...
    @property
    def point(self) -> CriticalPoint:
        """The critical point."""

    @property
    def q(self) -> NDArray[np.float64]:
        """`(n,)`: its configuration."""

    @property
    def value(self) -> float:
        """h(q), in the criterion's own unit."""

    @property
    def kind(self) -> Kind:
        """What it is."""

    @property
    def completed(self) -> bool:
        """Whether the path is completed from here.

        Also False if a joint leaves its limits: `status` and `reason` say so.
        """

    @property
    def status(self) -> Status:
        """`converged`, `singular` if the critical point vanishes, `limits` if a joint violates a limit."""

    @property
    def reason(self) -> str:
        """Why the path is not completed; empty if it is."""

    @property
    def trajectory(self) -> FollowedOptimum:
        """The critical point followed along the path."""

def rank_starts(
    chain: Chain,
    path: Path,
    criterion: Criterion,
    task: str | Task | None = None,
    *,
    seed: int = 0,
    starts: int | None = None,
    step: float | None = None,
    threads: int | None = None,
) -> RankedStarts:
    """Follows every critical point for the start of `path`, and sorts them.

    First come those that complete the path, ordered by whether they are of the kind that the criterion asks for, then
    by value; next those that stop, the one that gets farthest first; last those that leave the joint limits. The
    result is a list with `status` and `reason`: why it is empty, or why no start completes the path.

    Args:
        chain: The arm.
        path: Path of the tool.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.
        seed: As for `constrained_optima`.
        starts: As for `constrained_optima`.
        step: As for `follow_optimum`.
        threads: Number of threads; None: all cores.

    Raises:
        RedundancyError: as `constrained_optima` and `follow_optimum`.

    Example:
        >>> import math, redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> circle = rd.paths.circle((3.5, 0, 0), 1.5, start=math.pi, n=51)
        >>> ranked = rd.rank_starts(arm, circle, rd.Manipulability(arm, task="planar"), task="planar")
        >>> [start.completed for start in ranked[:3]]
        [True, True, False]
    """

@final
class SingularPoint:
    """A configuration at which a critical point vanishes: an algorithmic singularity. Can be pickled."""

    def __new__(
        cls,
        q: Sequence[float],
        position: Sequence[float],
        residual: float,
        first_joint_free: bool,
        dimension: int,
    ) -> SingularPoint: ...
    @property
    def q(self) -> NDArray[np.float64]:
        """`(n,)`: configuration; the first joint is zero where it is free."""

    @property
    def position(self) -> NDArray[np.float64]:
        """`(3,)`: where the tool is, m."""

    @property
    def residual(self) -> float:
        """What is left of `mu = 0` and of the least eigenvalue: ratio to gradient and curvature of the criterion."""

    @property
    def first_joint_free(self) -> bool:
        """Whether every value of the first joint gives a singular point."""

    @property
    def dimension(self) -> int:
        """Dimension of the set it belongs to (without a free first joint): 0 for isolated points, else a sample."""

def algorithmic_singularities(
    chain: Chain,
    criterion: Criterion,
    task: str | Task | None = None,
    *,
    seed: int = 0,
    starts: int | None = None,
    threads: int | None = None,
) -> list[SingularPoint]:
    """Where critical points of `criterion` vanish, for any value of the task.

    Solves `mu = 0`, `det W = 0` by Newton's method from random starts. For planar positions and criteria that do not
    depend on the first joint, the points are isolated, and each stands for a circle about the base; otherwise they
    are samples of a set.

    Args:
        chain: The arm.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.
        seed: Seed of the random starts.
        starts: Most random starts; default 2000. The search for isolated points ends when three quarters of the
            starts, and at least 256, have found nothing new.
        threads: Number of threads; None: all cores. The result does not depend on it.

    Raises:
        RedundancyError: a task that leaves no spare freedom, settings out of range.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> len(rd.algorithmic_singularities(arm, rd.Manipulability(arm, task="planar"), task="planar"))
        10
    """

@final
class SingularityCurve:
    """Configurations at which critical points vanish, in order. Can be pickled; `len()` is the number of rows."""

    def __new__(cls, q: NDArray[np.float64], closed: bool, first_joint_free: bool) -> SingularityCurve: ...
    @property
    def q(self) -> NDArray[np.float64]:
        """`(N, n)`: configurations.

        Joints change continuously, beyond half a turn where whole turns make no difference to the criterion.

        The first joint is zero where it is free. The last row of a closed curve is the first one, up to whole turns.
        """

    @property
    def closed(self) -> bool:
        """Whether the curve is closed.

        An open curve ends where the arm is singular, where it crosses another one, or, for criteria of joint values,
        where a joint changes its winding.
        """

    @property
    def first_joint_free(self) -> bool:
        """Whether every value of the first joint gives such a curve."""

    def __len__(self) -> int: ...

def singularity_curves(
    chain: Chain,
    criterion: Criterion,
    task: str | Task | None = None,
    *,
    step: float = 0.05,
    seed: int = 0,
    starts: int | None = None,
    threads: int | None = None,
) -> list[SingularityCurve]:
    """The curves on which critical points of `criterion` vanish, longest first.

    They are curves where `mu = 0`, `det W = 0` leave one freedom. The points of `algorithmic_singularities` are
    followed in both directions; curves without one of them are missed.

    Args:
        chain: The arm.
        criterion: The criterion.
        task: Which coordinates are kept; the pose by default.
        step: Largest step between rows, rad or m.
        seed: Seed of the random starts.
        starts: Number of random starts; default 2000.
        threads: Number of threads; None: all cores. The result does not depend on it.

    Raises:
        RedundancyError: a set of singularities of another dimension than one, settings out of range.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> posture = rd.Posture(arm, [0.3, 0.5, 0.7])
        >>> len(rd.singularity_curves(arm, posture, task="planar", starts=300))
        8
    """

def singularity_distance(chain: Chain, q: ArrayLike, points: list[SingularPoint]) -> Any:
    """Distance in joint space of `q` `(n,)` or `(N, n)` from the nearest of `points`, revolute joints the short way.

    The first joint is left out where it is free for all points.

    Args:
        chain: The arm.
        q: Joint positions `(n,)` or `(N, n)`, rad or m.
        points: What `algorithmic_singularities` returns.

    Raises:
        RedundancyError: no points, a wrong length, entries that are not finite.

    Example:
        >>> import redundancy as rd
        >>> arm = rd.catalog.load("planar3r")
        >>> points = rd.algorithmic_singularities(arm, rd.Manipulability(arm, task="planar"), task="planar")
        >>> round(rd.singularity_distance(arm, points[0].q + [1.0, 0.01, 0.0], points), 12)
        0.01
    """
