//! Cones and spins: sets of orientations with a smooth margin that is positive inside.
//!
//! # Equations
//! With the rotation `R` of the orientation `q`, a body axis `b` and a direction `d`, the **cone** of half-angle
//! `theta` has the margin `m = (d . R b - cos theta) / 2`. For `b = d = z` it is the paper's
//! `eta^2 - q1^2 - q2^2` with `eta = sin(theta/2)` [FromGravdahl2009, eq. (15), printed with gamma^2 for eta^2];
//! for `d = -z` it is the downward form `q1^2 + q2^2 - eta^2` with `eta = sin((pi - theta)/2)` (eq. (33)), and for
//! `b = x` eq. (23). It is evaluated as `sin^2(theta/2) - |R b - d|^2 / 4`, which keeps its digits in cones of a
//! hundredth of a degree.
//!
//! The **spin** about the body axis `n` against a reference orientation has, with `r = conj(reference) * q` and
//! `t = r3 / r0 = tan(twist / 2)`, the margin `m = kappa^2 - t^2`, `kappa = tan(max_angle / 2)`
//! [FromGravdahl2009, eqs. (20) and (46)]. For a downward tool the reference must contain the flip, otherwise `r0`
//! vanishes.
//!
//! # Derivatives
//! Gradients and Hessians are those of `delta -> m(q * exp(delta))` at 0, `delta` a rotation vector (rad) in body
//! axes: with `c = R^T d`, `grad = b x c / 2`, `Hess = (sym(c b^T) - (b . c) I) / 2`; for the spin
//! `r0' = -r_v / 2`, `r3' = (r0 n + n x r_v) / 2`, `t' = (r3' - t r0') / r0`, `t'' = -(r0' t'^T + t' r0'^T) / r0`,
//! `grad = -2 t t'`, `Hess = -2 t' t'^T - 2 t t''`.
//!
//! # Degenerate cases
//! A cone is smooth everywhere. A spin has no twist where the swing is half a turn: within
//! [`SPIN_SCALAR`] of it the margin is `-1 / SPIN_SCALAR^2` (far outside) and the derivatives are zero.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};

use crate::error::{Error, Result};
use crate::rotation::quaternion::{angle_between, compose, unit_direction};
use crate::tolerance::SPIN_SCALAR;

/// Checks an angle of a cone or spin.
fn check_angle(what: &str, angle: f64) -> Result<()> {
    if angle > 0.0 && angle < PI {
        return Ok(());
    }
    Err(Error::OutOfRange { what: what.into(), value: angle, bound: "in (0, pi) rad".into() })
}

/// Value, gradient and Hessian of a margin in the body tangent space.
#[derive(Clone, Copy)]
pub(crate) struct Local {
    pub margin: f64,
    pub gradient: Vector3<f64>,
    /// Upper triangle: xx, xy, xz, yy, yz, zz.
    pub hessian: [f64; 6],
}

/// All orientations whose body axis lies within a half-angle of a direction; the spin about the axis is free.
///
/// ```
/// use redundancy_core::rotation::{Cone, from_zyz};
/// let cone = Cone::new([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 20_f64.to_radians())?;
/// let q = from_zyz([0.5, 15_f64.to_radians(), -0.3]);
/// assert!((cone.margin(&q) - 0.0131166028).abs() < 1e-10);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    body_axis: Unit<Vector3<f64>>,
    direction: Unit<Vector3<f64>>,
    half_angle: f64,
    /// sin^2 and cos^2 of half the half-angle.
    sin2: f64,
    cos2: f64,
}

impl Cone {
    /// Cone of `body_axis` (body frame) around `direction` (reference frame), `half_angle` in rad.
    ///
    /// # Errors
    /// An axis without length or with an entry that is not finite, a half-angle outside (0, pi).
    pub fn new(body_axis: [f64; 3], direction: [f64; 3], half_angle: f64) -> Result<Self> {
        let body_axis = unit_direction("body axis", body_axis)?;
        let direction = unit_direction("direction", direction)?;
        check_angle("half-angle", half_angle)?;
        Ok(Self::from_units(body_axis, direction, half_angle))
    }

    pub(crate) fn from_units(
        body_axis: Unit<Vector3<f64>>,
        direction: Unit<Vector3<f64>>,
        half_angle: f64,
    ) -> Self {
        let (s, c) = (0.5 * half_angle).sin_cos();
        Self { body_axis, direction, half_angle, sin2: s * s, cos2: c * c }
    }

    /// The same cone around another direction.
    pub(crate) fn towards(mut self, direction: Unit<Vector3<f64>>) -> Self {
        self.direction = direction;
        self
    }

    /// Cone of the body z axis around `direction`.
    ///
    /// # Errors
    /// As [`Cone::new`].
    pub fn z(direction: [f64; 3], half_angle: f64) -> Result<Self> {
        Self::new([0.0, 0.0, 1.0], direction, half_angle)
    }

    /// Cone of the body x axis around `direction` [FromGravdahl2009, eq. (23)].
    ///
    /// # Errors
    /// As [`Cone::new`].
    pub fn x(direction: [f64; 3], half_angle: f64) -> Result<Self> {
        Self::new([1.0, 0.0, 0.0], direction, half_angle)
    }

    /// The downward form [FromGravdahl2009, eq. (33)]: the body z axis within `half_angle` of -z.
    ///
    /// # Errors
    /// A half-angle outside (0, pi).
    pub fn downward(half_angle: f64) -> Result<Self> {
        Self::new([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], half_angle)
    }

    /// Cone of the body axis `axis` around the same axis of `frame`: the paper's tests on `conj(frame) * q`
    /// [FromGravdahl2009, eqs. (24), (30), (42)].
    ///
    /// # Errors
    /// As [`Cone::new`].
    pub fn of_frame(frame: &UnitQuaternion<f64>, axis: [f64; 3], half_angle: f64) -> Result<Self> {
        let body_axis = unit_direction("body axis", axis)?;
        check_angle("half-angle", half_angle)?;
        Ok(Self::from_units(body_axis, frame * body_axis, half_angle))
    }

    /// The axis in the body frame, unit.
    pub fn body_axis(&self) -> Unit<Vector3<f64>> {
        self.body_axis
    }

    /// The direction in the reference frame, unit.
    pub fn direction(&self) -> Unit<Vector3<f64>> {
        self.direction
    }

    /// Half-angle, rad.
    pub fn half_angle(&self) -> f64 {
        self.half_angle
    }

    /// sin^2 of half the half-angle: the margin on the axis.
    pub(crate) fn scale(&self) -> f64 {
        self.sin2
    }

    /// Angle, rad in [0, pi], between the rotated body axis and the direction.
    ///
    /// ```
    /// use redundancy_core::rotation::{Cone, from_zyz};
    /// let cone = Cone::downward(0.3)?;
    /// assert!((cone.angle(&from_zyz([0.1, 0.2, 0.3])) - (std::f64::consts::PI - 0.2)).abs() < 1e-14);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn angle(&self, q: &UnitQuaternion<f64>) -> f64 {
        angle_between(&(q * self.body_axis), &self.direction)
    }

    /// `(direction . R(q) body_axis - cos half_angle) / 2`, positive inside [FromGravdahl2009, eq. (15)].
    pub fn margin(&self, q: &UnitQuaternion<f64>) -> f64 {
        self.margin_at(&(q.inverse() * self.direction))
    }

    /// The margin from `c = R^T d`.
    #[inline]
    fn margin_at(&self, c: &Vector3<f64>) -> f64 {
        self.margin_between(&self.body_axis, c)
    }

    /// The margin from the axis and the direction in the same frame.
    #[inline]
    pub(crate) fn margin_between(&self, b: &Vector3<f64>, c: &Vector3<f64>) -> f64 {
        // Of the two forms the one whose squared distance is small at the rim keeps its digits there.
        if self.sin2 <= self.cos2 {
            self.sin2 - 0.25 * (b - c).norm_squared()
        } else {
            0.25 * (b + c).norm_squared() - self.cos2
        }
    }

    /// Gradient of the margin at `q` in the body tangent space, 1/rad. Zero on the axis and at its antipode.
    pub fn gradient(&self, q: &UnitQuaternion<f64>) -> Vector3<f64> {
        0.5 * self.body_axis.cross(&(q.inverse() * self.direction))
    }

    /// Hessian of the margin at `q` in the body tangent space, 1/rad^2.
    pub fn hessian(&self, q: &UnitQuaternion<f64>) -> Matrix3<f64> {
        unpack(&self.local(&q.to_rotation_matrix().into_inner()).hessian)
    }

    /// Margin and gradient, with the rotation matrix of `q`.
    #[inline]
    pub(crate) fn slope(&self, rotation: &Matrix3<f64>) -> (f64, Vector3<f64>) {
        let c = rotation.tr_mul(&self.direction);
        (self.margin_at(&c), 0.5 * self.body_axis.cross(&c))
    }

    #[inline]
    pub(crate) fn local(&self, rotation: &Matrix3<f64>) -> Local {
        let c = rotation.tr_mul(&self.direction);
        let b = self.body_axis.into_inner();
        let (xx, yy, zz) = (0.5 * b.x * c.x, 0.5 * b.y * c.y, 0.5 * b.z * c.z);
        let hessian = [
            -yy - zz,
            0.25 * (b.x * c.y + b.y * c.x),
            0.25 * (b.x * c.z + b.z * c.x),
            -xx - zz,
            0.25 * (b.y * c.z + b.z * c.y),
            -xx - yy,
        ];
        Local { margin: self.margin_at(&c), gradient: 0.5 * b.cross(&c), hessian }
    }
}

/// All orientations whose rotation about a body axis, measured from a reference, is within an angle; where the axis
/// points is free.
///
/// ```
/// use redundancy_core::rotation::{Spin, from_zyz};
/// let spin = Spin::new(from_zyz([0.0; 3]), 0.5, [0.0, 0.0, 1.0])?;
/// assert!((spin.twist(&from_zyz([0.3, 0.2, 0.1])) - 0.4).abs() < 1e-15);
/// assert!(spin.margin(&from_zyz([0.3, 0.2, 0.1])) > 0.0);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    reference: UnitQuaternion<f64>,
    max_angle: f64,
    axis: Unit<Vector3<f64>>,
    /// tan^2(max_angle / 2).
    kappa2: f64,
}

impl Spin {
    /// Spin about `axis` of the body (and of the reference) by at most `max_angle` (rad) from `reference`.
    ///
    /// # Errors
    /// An axis without length or with an entry that is not finite, an angle outside (0, pi).
    pub fn new(reference: UnitQuaternion<f64>, max_angle: f64, axis: [f64; 3]) -> Result<Self> {
        let axis = unit_direction("spin axis", axis)?;
        check_angle("max angle", max_angle)?;
        let kappa = (0.5 * max_angle).tan();
        Ok(Self { reference, max_angle, axis, kappa2: kappa * kappa })
    }

    /// The same about an axis given in the world frame, the frame that `reference` is measured in: the part of
    /// `q * conj(reference)` along it.
    ///
    /// # Errors
    /// As [`Spin::new`].
    ///
    /// ```
    /// use redundancy_core::rotation::{Spin, from_zyz};
    /// use redundancy_core::nalgebra::{UnitQuaternion, Vector3};
    /// let reference = from_zyz([0.4, 1.0, 0.2]);
    /// let spin = Spin::about_world_axis(reference, 0.5, [1.0, 0.0, 0.0])?;
    /// let q = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.3) * reference;
    /// assert!((spin.twist(&q) - 0.3).abs() < 1e-14);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn about_world_axis(reference: UnitQuaternion<f64>, max_angle: f64, axis: [f64; 3]) -> Result<Self> {
        let axis = reference.inverse() * unit_direction("spin axis", axis)?;
        Self::new(reference, max_angle, [axis.x, axis.y, axis.z])
    }

    /// The reference orientation.
    pub fn reference(&self) -> UnitQuaternion<f64> {
        self.reference
    }

    /// Largest twist, rad.
    pub fn max_angle(&self) -> f64 {
        self.max_angle
    }

    /// The axis in the body frame, unit.
    pub fn axis(&self) -> Unit<Vector3<f64>> {
        self.axis
    }

    pub(crate) fn kappa2(&self) -> f64 {
        self.kappa2
    }

    /// Twist about the axis against the reference, rad in [-pi, pi]; 0 where it is undefined.
    pub fn twist(&self, q: &UnitQuaternion<f64>) -> f64 {
        let r = compose(&self.reference.inverse(), q);
        let along = r.imag().dot(&self.axis);
        if r.w < 0.0 { 2.0 * (-along).atan2(-r.w) } else { 2.0 * along.atan2(r.w) }
    }

    /// `kappa^2 - (r3 / r0)^2`, positive inside [FromGravdahl2009, eqs. (20), (46)].
    pub fn margin(&self, q: &UnitQuaternion<f64>) -> f64 {
        let r = self.reference.as_ref().conjugate() * q.as_ref();
        if r.w.abs() < SPIN_SCALAR {
            return Self::undefined();
        }
        let t = r.imag().dot(&self.axis) * (1.0 / r.w);
        self.kappa2 - t * t
    }

    /// Gradient of the margin at `q` in the body tangent space, 1/rad.
    pub fn gradient(&self, q: &UnitQuaternion<f64>) -> Vector3<f64> {
        self.slope(q).1
    }

    /// Hessian of the margin at `q` in the body tangent space, 1/rad^2.
    pub fn hessian(&self, q: &UnitQuaternion<f64>) -> Matrix3<f64> {
        unpack(&self.local(q).hessian)
    }

    /// `(t, t', r0', r0)`, or `None` where the twist is undefined.
    #[inline]
    fn tangent(&self, q: &UnitQuaternion<f64>) -> Option<(f64, Vector3<f64>, Vector3<f64>, f64)> {
        let r = self.reference.as_ref().conjugate() * q.as_ref();
        if r.w.abs() < SPIN_SCALAR {
            return None;
        }
        let (v, n) = (r.imag(), self.axis.into_inner());
        let inverse = 1.0 / r.w;
        let t = v.dot(&n) * inverse;
        let scalar = -0.5 * v;
        let along = 0.5 * (n * r.w + n.cross(&v));
        Some((t, (along - scalar * t) * inverse, scalar, inverse))
    }

    #[inline]
    pub(crate) fn slope(&self, q: &UnitQuaternion<f64>) -> (f64, Vector3<f64>) {
        match self.tangent(q) {
            None => (Self::undefined(), Vector3::zeros()),
            Some((t, slope, _, _)) => (self.kappa2 - t * t, slope * (-2.0 * t)),
        }
    }

    /// The margin where there is no twist.
    fn undefined() -> f64 {
        -1.0 / (SPIN_SCALAR * SPIN_SCALAR)
    }

    #[inline]
    pub(crate) fn local(&self, q: &UnitQuaternion<f64>) -> Local {
        self.local_with(q, 1.0)
    }

    /// As [`local`](Self::local) without the twist's own second derivative: minus this Hessian is semidefinite.
    pub(crate) fn convex_local(&self, q: &UnitQuaternion<f64>) -> Local {
        self.local_with(q, 0.0)
    }

    #[inline]
    fn local_with(&self, q: &UnitQuaternion<f64>, bend: f64) -> Local {
        match self.tangent(q) {
            None => Local { margin: Self::undefined(), gradient: Vector3::zeros(), hessian: [0.0; 6] },
            Some((t, u, s, inverse)) => {
                let w = 2.0 * t * inverse * bend;
                let entry = |i: usize, j: usize| -2.0 * u[i] * u[j] + w * (s[i] * u[j] + s[j] * u[i]);
                Local {
                    margin: self.kappa2 - t * t,
                    gradient: u * (-2.0 * t),
                    hessian: [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)],
                }
            }
        }
    }
}

/// Symmetric matrix from its upper triangle.
pub(crate) fn unpack(h: &[f64; 6]) -> Matrix3<f64> {
    Matrix3::new(h[0], h[1], h[2], h[1], h[3], h[4], h[2], h[4], h[5])
}

/// A set of orientations with a smooth margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constraint {
    /// See [`Cone`].
    Cone(Cone),
    /// See [`Spin`].
    Spin(Spin),
}

impl Constraint {
    /// The margin, positive inside.
    pub fn margin(&self, q: &UnitQuaternion<f64>) -> f64 {
        match self {
            Self::Cone(cone) => cone.margin(q),
            Self::Spin(spin) => spin.margin(q),
        }
    }

    /// Gradient of the margin in the body tangent space, 1/rad.
    pub fn gradient(&self, q: &UnitQuaternion<f64>) -> Vector3<f64> {
        match self {
            Self::Cone(cone) => cone.gradient(q),
            Self::Spin(spin) => spin.gradient(q),
        }
    }

    /// Hessian of the margin in the body tangent space, 1/rad^2.
    pub fn hessian(&self, q: &UnitQuaternion<f64>) -> Matrix3<f64> {
        match self {
            Self::Cone(cone) => cone.hessian(q),
            Self::Spin(spin) => spin.hessian(q),
        }
    }

    /// Signed angle, rad, by which the orientation is outside (negative inside).
    pub fn excess(&self, q: &UnitQuaternion<f64>) -> f64 {
        match self {
            Self::Cone(cone) => cone.angle(q) - cone.half_angle(),
            Self::Spin(spin) => spin.twist(q).abs() - spin.max_angle(),
        }
    }
}

impl From<Cone> for Constraint {
    fn from(cone: Cone) -> Self {
        Self::Cone(cone)
    }
}

impl From<Spin> for Constraint {
    fn from(spin: Spin) -> Self {
        Self::Spin(spin)
    }
}
