"""Types of the compiled module."""

from collections.abc import Iterable, Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundancy.status import Status

__version__: str

class RedundancyError(ValueError): ...
class DescriptionError(RedundancyError): ...
class NotSrsError(RedundancyError): ...
class FileFormatError(RedundancyError): ...

# rotation

@final
class Cone:
    """All orientations whose body axis lies within a half-angle of a direction; the spin about the axis is free.

    The margin is `(direction . R(q) body_axis - cos half_angle) / 2`, the paper's `eta^2 - q1^2 - q2^2`
    [FromGravdahl2009, eqs. (15), (23), (33)]. `q` is a unit quaternion `(w, x, y, z)`, `(4,)` or `(N, 4)`.

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
        """Cone of the body z axis around `direction`."""
    @staticmethod
    def x(direction: ArrayLike, half_angle: float) -> Cone:
        """Cone of the body x axis around `direction` [FromGravdahl2009, eq. (23)]."""
    @staticmethod
    def downward(half_angle: float) -> Cone:
        """The body z axis within `half_angle` (rad) of -z [FromGravdahl2009, eq. (33)]."""
    @staticmethod
    def of_frame(frame: ArrayLike, axis: ArrayLike, half_angle: float) -> Cone:
        """The body axis `axis` around the same axis of `frame` `(w, x, y, z)` [FromGravdahl2009, eq. (24)]."""
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
        """Angle, rad in [0, pi], between the rotated body axis and the direction: a float, or `(N,)`."""
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Smooth margin, positive inside: a float, or `(N,)` for a batch."""
    def gradient(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Gradient of the margin along rotation vectors in body axes, 1/rad: `(3,)` or `(N, 3)`.

        It is the derivative of `margin(q * exp(delta))` at `delta = 0`.
        """
    def hessian(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Hessian of the margin along rotation vectors in body axes, 1/rad^2: `(3, 3)` or `(N, 3, 3)`."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __getnewargs__(self) -> tuple[list[float], list[float], float]: ...

@final
class Spin:
    """All orientations turned about a body axis by at most an angle from a reference; its direction is free.

    With `r = conj(reference) * q` and `r3` its part along the axis the margin is `kappa^2 - (r3 / r0)^2`,
    `kappa = tan(max_angle / 2)` [FromGravdahl2009, eqs. (20), (46)]. Where the axis is turned by half a turn
    the spin is undefined and counts as far outside: for a tool that points down the reference must too.

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
        """The same about an axis given in the frame that `reference` is measured in."""
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
        """Twist against the reference, rad in [-pi, pi], 0 where undefined: a float, or `(N,)`."""
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Smooth margin, positive inside: a float, or `(N,)` for a batch."""
    def gradient(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Gradient of the margin along rotation vectors in body axes, 1/rad: `(3,)` or `(N, 3)`.

        It is the derivative of `margin(q * exp(delta))` at `delta = 0`.
        """
    def hessian(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Hessian of the margin along rotation vectors in body axes, 1/rad^2: `(3, 3)` or `(N, 3, 3)`."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __getnewargs__(self) -> tuple[list[float], float, list[float]]: ...

@final
class QuaternionVolume:
    """A set of orientations: one to three rotations about fixed axes within bounds, or a cone.

    `q` is in the set when it is `P * Q(phi_1, n_1) * ... * Q(phi_k, n_k) * S` with every angle in its range
    [FromGravdahl2007, eqs. (6), (7), (12)]. Ranges are pairs (low, high) in rad; one of a full turn or more is
    free. Quaternions are `(w, x, y, z)`, `(4,)` or `(N, 4)`.

    Raises:
        RedundancyError: no or more than three axes, parallel consecutive axes, an axis without length, a bound that
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
        """Rotations about one axis by an angle in `range`, rad."""
    @staticmethod
    def pyramid(half_x: float, half_y: float) -> QuaternionVolume:
        """Tilts about x and y within half-angles (rad, below pi/2), the spin about z free."""
    @staticmethod
    def cone(axis: ArrayLike, half_angle: float, direction: ArrayLike | None = None) -> QuaternionVolume:
        """Orientations whose body axis `axis` is within `half_angle` (rad) of `direction`.

        Without `direction` it is `axis` itself, where the identity puts it. The cone around -z is then the one
        around z: for a tool z axis that points down give `cone([0, 0, 1], half_angle, [0, 0, -1])`.
        """
    @staticmethod
    def from_axes(axes: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> QuaternionVolume:
        """One to three rotations about the rows of `axes`, `(k, 3)`, with bounds `(k,)` in rad."""
    @property
    def dimension(self) -> int:
        """Number of rotations; 3 for a cone."""
    def contains(self, q: ArrayLike, tol: float = 1e-9, *, threads: int | None = None) -> Any:
        """Whether `q` is a member to `tol` (rad; for a cone in its margin's unit): a bool, or `(N,)`."""
    def margin(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """Signed margin, >= 0 inside: a float, or `(N,)`.

        For sequences the smallest angle (rad) to a bound, for cones the margin of `Cone`; pi without any bound,
        and minus the angle (rad) from a set of fewer than three rotations when `q` is off it.
        """
    def angles(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Angles of `q` in the sequence, rad, `(k,)` or `(N, k)`; for a cone the ZYZ angles seen from its axis."""
    def at(self, angles: ArrayLike) -> NDArray[np.float64]:
        """The orientation `(w, x, y, z)` at the angles `(k,)`, rad; bounds are not applied."""
    def visualising(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """Visualising quaternion `(cos psi/2, sin(psi/2) z)` [FromGravdahl2007, eq. (8)]: `(4,)` or `(N, 4)`.

        `z` is the rotated last axis (of a cone its axis), `psi` the rotation about it: with `q` it makes the pair
        (Q, V) of the paper.
        """
    def nearest(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """The member nearest to `q`, on its side of the double cover: `(4,)` or `(N, 4)`."""
    def reoriented(self, p: ArrayLike, side: Literal["left", "right"] = "left") -> QuaternionVolume:
        """`P * V` (left: the set moves in the reference frame) or `V * P` (right: another body frame)."""
    def sample(self, n: int, seed: int = 0) -> NDArray[np.float64]:
        """`n` members `(n, 4)`, uniform with respect to the invariant measure; the same seed, the same bits."""
    def cross_section(self, distance: float, along: Literal["tool", "normal"] = "tool") -> CrossSection:
        """Where the tool axis z meets the plane at `distance` across its undisturbed direction.

        Extents are `distance * sin(tilt)` for a distance along the tool, `distance * tan(tilt)` for one along the
        plane's normal [FromGravdahl2007, section 8, with the ground truth's correction].

        Raises:
            RedundancyError: a tilt of 90 degrees or more, or a volume whose section has no name.
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
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, Any]: ...

@final
class CrossSection:
    """Where the tool axis of a volume can meet a plane."""

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

    Where the minimiser is not unique (the spin about a common axis of cones) the one that the least rotation
    reaches from `q0` is returned, so that a path whose solutions are passed on as `q0` is continuous; without `q0`
    it is `swing(u -> z) * [0, 0, 1, 0]` for a first cone around `u`, down.

    Args:
        constraints: pairs (weight, constraint), weight > 0, constraint a `Cone`, a `Spin` or a cone
            `QuaternionVolume`.
        method: `auto` takes the closed form where it applies (one or two cones on one body axis below 90 degrees,
            with or without a spin about it; a spin alone), else Newton. `closed_form` leaves cones of 90 degrees and
            more to Newton and refuses other problems. `newton` is Riemannian Newton on S^3, `gradient` the paper's
            method, normalised in every iteration.
        tolerance: Estimated remaining angle, rad, at which the iteration stops. None: 1e-13, gradient 1e-10.
        max_iterations: None: 100, gradient 10 000.
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
        """The minimiser, by iterations from `q0` `(w, x, y, z)` or, where it is outside, from a start that is searched.

        Constraints that exclude each other give the status `infeasible` and the angle by which they miss, never an
        exception.
        """
    def value(self, q: ArrayLike, *, threads: int | None = None) -> Any:
        """The sum at `q`, infinite outside: a float, or `(N,)`."""
    def margins(self, q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
        """The margins at `q` in the order of the constraints: `(k,)` or `(N, k)`."""
    def gradient(self, q: ArrayLike) -> NDArray[np.float64]:
        """Gradient of the sum along rotation vectors in body axes, 1/rad, `(3,)`. Raises outside."""
    def hessian(self, q: ArrayLike) -> NDArray[np.float64]:
        """Hessian of the sum along rotation vectors in body axes, 1/rad^2, `(3, 3)`. Raises outside."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class OrientationSolution:
    """Result of `OrientationOptimizer.solve`."""

    @property
    def q(self) -> NDArray[np.float64]:
        """Orientation `(w, x, y, z)`; when infeasible the one that exceeds the constraints least."""
    @property
    def value(self) -> float:
        """Sum of weight x barrier; infinite when infeasible."""
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
    """The best tool directions between cones around many pairs of directions.

    Row i minimises `-k_err log((z . n - cos beta)/2) - k_tcp log((z . d - cos alpha)/2)` over unit vectors z
    [FromGravdahl2009, eq. (34)]; where the cones miss each other it is the middle of the gap. Runs on all cores
    without the GIL; the result does not depend on their number.

    Args:
        normals: `(N, 3)` or `(3,)` for all rows, of any length: directions that the tool axis should follow. For a
            tool that looks at a surface they point into it.
        directions: `(N, 3)` or `(3,)`: the wanted directions.
        beta: Half-angle around the normals, rad, in (0, pi).
        alpha: Half-angle around the wanted directions, rad, in (0, pi). From pi/2 on rows are solved by Newton.
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

def quaternion_from_zyz(angles: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`Rz(a) Ry(b) Rz(c)` of angles `(3,)` or `(N, 3)`, rad, as `(w, x, y, z)`."""

def quaternion_to_zyz(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Angles of `Rz(a) Ry(b) Rz(c)`, rad, b in [0, pi]; where b is 0 or pi, a = 0."""

def quaternion_from_xyz(angles: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`Rx(a) Ry(b) Rz(c)` of angles `(3,)` or `(N, 3)`, rad, as `(w, x, y, z)`."""

def quaternion_to_xyz(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Angles of `Rx(a) Ry(b) Rz(c)`, rad, b in [-pi/2, pi/2]; where b is +-pi/2, a = 0."""

def quaternion_from_rpy(angles: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """`Rz(phi) Ry(theta) Rx(psi)` of angles (phi, theta, psi), rad, as `(w, x, y, z)`."""

def quaternion_to_rpy(q: ArrayLike, *, threads: int | None = None) -> NDArray[np.float64]:
    """Angles (phi, theta, psi) of `Rz(phi) Ry(theta) Rx(psi)`, rad; where theta is +-pi/2, psi = 0."""

def quaternion_swing_twist(q: ArrayLike, axis: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """`(swing, twist)` with `q = swing * twist`, the twist about `axis`; at half a turn of swing the identity."""

def quaternion_shortest_arc(start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
    """The least rotation from one direction to another; between antipodes half a turn, for z about y."""

def quaternion_error(start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
    """`conj(start) * end` with a scalar part >= 0 [FromGravdahl2009, eq. (8), on the shorter side of the cover]."""

def quaternion_angle(a: ArrayLike, b: ArrayLike) -> float:
    """Angle, rad in [0, pi], of the rotation between two orientations."""
