//! Scalar-first bridge to nalgebra's unit quaternions, Euler angles, swing and twist, shortest arc, error.
//!
//! A rotation by `phi` about the unit vector `n` is `Q = (cos phi/2, sin(phi/2) n)` [FromGravdahl2009, eq. (2)];
//! `Q` and `-Q` are the same rotation. The border speaks `(w, x, y, z)`, nalgebra stores `(x, y, z, w)`: the
//! conversion happens here and nowhere else in the core.
//!
//! # Angles and their degenerate cases
//! | sequence | rotation | middle angle | degenerate where | then |
//! |---|---|---|---|---|
//! | ZYZ | `Rz(alpha) Ry(beta) Rz(gamma)` | `beta` in [0, pi] | beta = 0 or pi | alpha = 0 |
//! | XYZ | `Rx(alpha) Ry(beta) Rz(gamma)` | `beta` in [-pi/2, pi/2] | beta = +-pi/2 | alpha = 0 |
//! | RPY | `Rz(phi) Ry(theta) Rx(psi)` | `theta` in [-pi/2, pi/2] | theta = +-pi/2 | psi = 0 |
//!
//! The single arctangents of [FromGravdahl2009, eqs. (9), (12), (13)] lose a quadrant and `2 arcsin` in eq. (10)
//! loses half the digits near pi; here every angle is a two-argument arctangent of sums of quaternion entries:
//! `beta = 2 atan2(hypot(q1, q2), hypot(q0, q3))`, `alpha = atan2(q3, q0) - atan2(q1, q2)`,
//! `gamma = atan2(q3, q0) + atan2(q1, q2)`.
//!
//! Cost: two or three arctangents. References: [FromGravdahl2007], [FromGravdahl2009].

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::error::{Error, Result, check_finite};
use crate::tolerance::{ANGLE_PART, DIRECTION_NORM, QUATERNION_NORM, QUATERNION_UNIT, SAME_AXIS};

/// Unit quaternion from its entries `(w, x, y, z)`; it is normalised.
///
/// # Errors
/// An entry that is not finite, or a norm further than [`QUATERNION_UNIT`] from 1.
///
/// ```
/// use redundancy_core::rotation::{from_wxyz, to_wxyz};
/// assert_eq!(to_wxyz(&from_wxyz([0.0, 0.0, 1.0, 0.0])?), [0.0, 0.0, 1.0, 0.0]);
/// assert!(from_wxyz([1.0, 0.1, 0.0, 0.0]).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn from_wxyz(wxyz: [f64; 4]) -> Result<UnitQuaternion<f64>> {
    check_finite("quaternion (w, x, y, z)", &wxyz)?;
    let quaternion = Quaternion::new(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() > QUATERNION_UNIT {
        return Err(Error::NotUnit { what: "orientation".into(), norm, tolerance: QUATERNION_UNIT });
    }
    // What was normalised before keeps its bits.
    let exact = (norm - 1.0).abs() <= f64::EPSILON;
    Ok(if exact { Unit::new_unchecked(quaternion) } else { Unit::new_normalize(quaternion) })
}

/// The entries `(w, x, y, z)`; the inverse of [`from_wxyz`].
pub fn to_wxyz(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

/// Unit vector from three numbers of any length.
///
/// # Errors
/// An entry that is not finite, or a length below [`DIRECTION_NORM`]; `what` names the argument.
///
/// ```
/// use redundancy_core::rotation::unit_direction;
/// assert_eq!(unit_direction("normal", [0.0, 0.0, -2.0])?.z, -1.0);
/// assert!(unit_direction("normal", [0.0; 3]).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn unit_direction(what: &str, vector: [f64; 3]) -> Result<Unit<Vector3<f64>>> {
    check_finite(what, &vector)?;
    let given = Vector3::from(vector);
    if (given.norm() - 1.0).abs() <= f64::EPSILON {
        // What was normalised before keeps its bits.
        return Ok(Unit::new_unchecked(given));
    }
    // The scale keeps the squares of very long vectors finite.
    let scale = vector.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let scaled = if scale > 0.0 { given / scale } else { Vector3::zeros() };
    let norm = scaled.norm() * scale;
    if norm < DIRECTION_NORM {
        return Err(Error::ZeroDirection { what: what.into(), norm, minimum: DIRECTION_NORM });
    }
    Ok(Unit::new_normalize(scaled))
}

/// Rotation by `angle` (rad) about `axis`, without a branch.
#[inline]
pub(crate) fn about(axis: &Unit<Vector3<f64>>, angle: f64) -> UnitQuaternion<f64> {
    let (s, c) = (0.5 * angle).sin_cos();
    Unit::new_unchecked(Quaternion::new(c, s * axis.x, s * axis.y, s * axis.z))
}

/// Rotation by `angle` (rad) about `axis`, as a quaternion.
///
/// ```
/// use redundancy_core::rotation::{from_axis_angle, to_wxyz};
/// let q = from_axis_angle([0.0, 0.0, 2.0], std::f64::consts::PI)?;
/// assert!((to_wxyz(&q)[3] - 1.0).abs() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// An axis without length, or a number that is not finite.
pub fn from_axis_angle(axis: [f64; 3], angle: f64) -> Result<UnitQuaternion<f64>> {
    check_finite("angle", &[angle])?;
    Ok(about(&unit_direction("axis", axis)?, angle))
}

/// Unit quaternion from entries `(w, x, y, z)` that may be rounded: a norm within [`QUATERNION_NORM`] of 1 is normalised.
/// `what` names them in messages.
///
/// # Errors
/// An entry that is not finite, or a norm further from 1.
///
/// ```
/// use redundancy_core::rotation::from_rounded_wxyz;
/// assert!((from_rounded_wxyz("q", [0.707, 0.707, 0.0, 0.0])?.norm() - 1.0).abs() < 1e-15);
/// assert!(from_rounded_wxyz("q", [0.7, 0.7, 0.0, 0.0]).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn from_rounded_wxyz(what: &str, wxyz: [f64; 4]) -> Result<UnitQuaternion<f64>> {
    check_finite(what, &wxyz)?;
    let norm = Quaternion::new(wxyz[0], wxyz[1], wxyz[2], wxyz[3]).norm();
    if (norm - 1.0).abs() > QUATERNION_NORM {
        return Err(Error::NotUnit { what: what.into(), norm, tolerance: QUATERNION_NORM });
    }
    let exact = (norm - 1.0).abs() <= f64::EPSILON;
    from_wxyz(if exact { wxyz } else { wxyz.map(|entry| entry / norm) })
}

/// Unit vector and angle, rad in [0, pi], of a rotation. The vector of no rotation is z.
///
/// `angle = 2 atan2(|v|, |w|)` keeps its digits at both ends; of `Q` and `-Q` the one with a scalar part >= 0 is read.
///
/// ```
/// use redundancy_core::rotation::{from_axis_angle, to_axis_angle};
/// let (axis, angle) = to_axis_angle(&from_axis_angle([0.0, 2.0, 0.0], -0.5)?);
/// assert!((axis.y + 1.0).abs() < 1e-15 && (angle - 0.5).abs() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn to_axis_angle(q: &UnitQuaternion<f64>) -> (Unit<Vector3<f64>>, f64) {
    let v = if q.w < 0.0 { -q.imag() } else { q.imag() };
    // The scale keeps the squares of very short vectors.
    let scale = v.amax();
    if scale == 0.0 {
        return (Vector3::z_axis(), 0.0);
    }
    let (axis, norm) = Unit::new_and_get(v / scale);
    (axis, 2.0 * (norm * scale).atan2(q.w.abs()))
}

/// Unit quaternion of a rotation, with a scalar part >= 0.
///
/// ```
/// use redundancy_core::rotation::{from_axis_angle, from_rotation};
/// let q = from_axis_angle([0.3, -0.2, 0.9], 3.0)?;
/// assert!((from_rotation(&q.to_rotation_matrix()).coords - q.coords).norm() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn from_rotation(rotation: &Rotation3<f64>) -> UnitQuaternion<f64> {
    let q = UnitQuaternion::from_rotation_matrix(rotation);
    if q.w < 0.0 { Unit::new_unchecked(-q.into_inner()) } else { q }
}

/// Product of unit quaternions with the drift of the norm removed.
pub fn compose(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    Unit::new_normalize(a.as_ref() * b.as_ref())
}

/// An angle of rotation modulo 2 pi, in [-pi, pi]. The angles of joints are the matter of `joint_space`.
pub(super) fn wrap(angle: f64) -> f64 {
    let wrapped = angle - TAU * (angle / TAU).round();
    wrapped.clamp(-PI, PI)
}

/// `angle` in (-pi, pi], for the Euler angles.
fn wrap_half_open(angle: f64) -> f64 {
    let wrapped = wrap(angle);
    if wrapped == -PI { PI } else { wrapped }
}

/// `Rz(alpha) Ry(beta) Rz(gamma)`, rad.
///
/// ```
/// use redundancy_core::rotation::{from_zyz, to_zyz};
/// let angles = to_zyz(&from_zyz([0.5, 0.2, -0.3]));
/// assert!((angles[0] - 0.5).abs() < 1e-15 && (angles[1] - 0.2).abs() < 1e-15);
/// ```
pub fn from_zyz(angles: [f64; 3]) -> UnitQuaternion<f64> {
    let [a, b, c] = angles;
    compose(
        &compose(&about(&Vector3::z_axis(), a), &about(&Vector3::y_axis(), b)),
        &about(&Vector3::z_axis(), c),
    )
}

/// Angles `[alpha, beta, gamma]`, rad, of `Rz(alpha) Ry(beta) Rz(gamma)`, `beta` in [0, pi], the others in
/// (-pi, pi]. Where `beta` is 0 or pi only one of the outer angles is determined: `alpha` is set to 0.
///
/// [FromGravdahl2009, eqs. (9) to (13)] with the quadrants kept.
///
/// ```
/// use redundancy_core::rotation::{from_wxyz, to_zyz};
/// let down = to_zyz(&from_wxyz([0.0, 0.0, 1.0, 0.0])?);
/// assert_eq!(down, [0.0, std::f64::consts::PI, 0.0]);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn to_zyz(q: &UnitQuaternion<f64>) -> [f64; 3] {
    let [q0, q1, q2, q3] = to_wxyz(q);
    let (tilt, upright) = (q1.hypot(q2), q0.hypot(q3));
    let beta = 2.0 * tilt.atan2(upright);
    if tilt < ANGLE_PART {
        return [0.0, beta, wrap_half_open(2.0 * q3.atan2(q0))];
    }
    if upright < ANGLE_PART {
        return [0.0, beta, wrap_half_open(2.0 * q1.atan2(q2))];
    }
    let (sum, difference) = (q3.atan2(q0), q1.atan2(q2));
    [wrap_half_open(sum - difference), beta, wrap_half_open(sum + difference)]
}

/// `Rx(alpha) Ry(beta) Rz(gamma)`, rad.
///
/// ```
/// use redundancy_core::rotation::{from_xyz, to_xyz};
/// let angles = to_xyz(&from_xyz([0.5, 0.2, -0.3]));
/// assert!((angles[2] + 0.3).abs() < 1e-15);
/// ```
pub fn from_xyz(angles: [f64; 3]) -> UnitQuaternion<f64> {
    let [a, b, c] = angles;
    compose(
        &compose(&about(&Vector3::x_axis(), a), &about(&Vector3::y_axis(), b)),
        &about(&Vector3::z_axis(), c),
    )
}

/// Angles `[alpha, beta, gamma]`, rad, of `Rx(alpha) Ry(beta) Rz(gamma)`, `beta` in [-pi/2, pi/2], the others in
/// (-pi, pi]. At `beta = +-pi/2` only one of the outer angles is determined: `alpha` is set to 0.
///
/// From `w + y = (cos b/2 + sin b/2) cos((a+c)/2)`, `x + z = (cos b/2 + sin b/2) sin((a+c)/2)` and the like with
/// minus, so `beta` keeps all its digits up to the degenerate case.
///
/// ```
/// use redundancy_core::rotation::{from_xyz, to_xyz};
/// let angles = to_xyz(&from_xyz([0.25, std::f64::consts::FRAC_PI_2, 0.5]));
/// assert!(angles[0] == 0.0 && (angles[2] - 0.75).abs() < 1e-12);
/// ```
pub fn to_xyz(q: &UnitQuaternion<f64>) -> [f64; 3] {
    let [w, x, y, z] = to_wxyz(q);
    let (plus, minus) = ((w + y).hypot(x + z), (w - y).hypot(x - z));
    let beta = 2.0 * plus.atan2(minus) - FRAC_PI_2;
    if minus < ANGLE_PART {
        return [0.0, beta, wrap_half_open(2.0 * (x + z).atan2(w + y))];
    }
    if plus < ANGLE_PART {
        return [0.0, beta, wrap_half_open(-2.0 * (x - z).atan2(w - y))];
    }
    let (sum, difference) = ((x + z).atan2(w + y), (x - z).atan2(w - y));
    [wrap_half_open(sum + difference), beta, wrap_half_open(sum - difference)]
}

/// `Rz(phi) Ry(theta) Rx(psi)` from `[phi, theta, psi]`, rad.
///
/// ```
/// use redundancy_core::rotation::{from_rpy, to_rpy};
/// assert!((to_rpy(&from_rpy([0.5, 0.2, -0.3]))[1] - 0.2).abs() < 1e-15);
/// ```
pub fn from_rpy(angles: [f64; 3]) -> UnitQuaternion<f64> {
    from_xyz([-angles[2], -angles[1], -angles[0]]).inverse()
}

/// Angles `[phi, theta, psi]`, rad, of `Rz(phi) Ry(theta) Rx(psi)`, `theta` in [-pi/2, pi/2]. At `theta = +-pi/2`
/// only one of the outer angles is determined: `psi` is set to 0.
///
/// ```
/// use redundancy_core::rotation::{from_rpy, to_rpy};
/// let angles = to_rpy(&from_rpy([0.5, -std::f64::consts::FRAC_PI_2, 0.25]));
/// assert!((angles[0] - 0.75).abs() < 1e-12 && angles[2] == 0.0);
/// ```
pub fn to_rpy(q: &UnitQuaternion<f64>) -> [f64; 3] {
    let [a, b, c] = to_xyz(&q.inverse());
    [wrap_half_open(-c), -b, if a == 0.0 { 0.0 } else { wrap_half_open(-a) }]
}

/// `(swing, twist)` with `q = swing * twist`, `twist` about `axis` with a scalar part >= 0 and `swing` about an
/// axis perpendicular to it: `twist` is the rotation about `axis` nearest to `q`. `axis` is meant in the body and,
/// as the twist leaves it where it is, in the frame the body is measured from.
///
/// Where the swing is half a turn the twist is undefined: it is set to the identity.
///
/// ```
/// use redundancy_core::rotation::{from_zyz, swing_twist};
/// use redundancy_core::nalgebra::Vector3;
/// let (swing, twist) = swing_twist(&from_zyz([0.3, 0.2, 0.4]), &Vector3::z_axis());
/// assert!((twist.angle() - 0.7).abs() < 1e-12 && (swing.angle() - 0.2).abs() < 1e-12);
/// ```
pub fn swing_twist(
    q: &UnitQuaternion<f64>,
    axis: &Unit<Vector3<f64>>,
) -> (UnitQuaternion<f64>, UnitQuaternion<f64>) {
    let along = q.imag().dot(axis);
    let norm = q.w.hypot(along);
    if norm < ANGLE_PART {
        return (*q, UnitQuaternion::identity());
    }
    let scale = if q.w < 0.0 { -1.0 / norm } else { 1.0 / norm };
    let v = axis.into_inner() * (along * scale);
    let twist = Unit::new_unchecked(Quaternion::new(q.w * scale, v.x, v.y, v.z));
    (compose(q, &twist.inverse()), twist)
}

/// Half a turn about an axis perpendicular to `axis`: `axis x e`, where `e` is the coordinate axis least aligned with
/// it (the first of equals). For z it is about y, the paper's downward orientation `[0, 0, 1, 0]`.
pub(crate) fn half_turn(axis: &Unit<Vector3<f64>>) -> UnitQuaternion<f64> {
    let e = axis.cross(&least_aligned(axis));
    let n = Unit::new_normalize(e);
    Unit::new_unchecked(Quaternion::new(0.0, n.x, n.y, n.z))
}

/// The coordinate axis least aligned with `axis`, the first of equals.
fn least_aligned(axis: &Unit<Vector3<f64>>) -> Vector3<f64> {
    let mut least = 0;
    for i in 1..3 {
        if axis[i].abs() < axis[least].abs() {
            least = i;
        }
    }
    let mut e = Vector3::zeros();
    e[least] = 1.0;
    e
}

/// The rotation by the least angle that takes the direction `from` to the direction `to`; its scalar part is >= 0.
///
/// Antipodal directions have no shortest arc: then it is half a turn about `from x e`, where `e` is the coordinate
/// axis least aligned with `from` (the first of equals); from z to -z that is `[0, 0, 1, 0]`.
///
/// ```
/// use redundancy_core::rotation::{shortest_arc, to_wxyz};
/// use redundancy_core::nalgebra::Vector3;
/// let z = Vector3::z_axis();
/// assert_eq!(to_wxyz(&shortest_arc(&z, &-z)), [0.0, 0.0, 1.0, 0.0]);
/// assert!((shortest_arc(&z, &Vector3::x_axis()) * z).x > 1.0 - 1e-15);
/// ```
#[inline]
pub fn shortest_arc(from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>) -> UnitQuaternion<f64> {
    let dot = from.dot(to);
    if dot > -0.5 {
        let v = from.cross(to);
        return Unit::new_normalize(Quaternion::new(1.0 + dot, v.x, v.y, v.z));
    }
    // Near the antipode 1 + dot and the cross product cancel; |from + to| = 2 cos(angle/2) keeps its digits, and of its
    // direction only the part perpendicular to `from` is needed, where rounding does not count.
    let sum = from.into_inner() + to.into_inner();
    let across = sum - from.into_inner() * from.dot(&sum);
    let norm = across.norm();
    if norm < SAME_AXIS {
        return half_turn(from);
    }
    let cosine = 0.5 * sum.norm();
    let v = from.cross(&across) * ((1.0 - cosine * cosine).sqrt() / norm);
    Unit::new_normalize(Quaternion::new(cosine, v.x, v.y, v.z))
}

/// The rotation that takes the frame `from` to the frame `to`, in axes of `from`, by the shorter way:
/// `E = conj(from) * to`, or `-E` when its scalar part is negative.
///
/// [FromGravdahl2009, eq. (8)], which is the shortest rotation only with this choice of the cover. Of the two
/// half turns the one whose first non-zero vector entry is positive is returned.
///
/// ```
/// use redundancy_core::rotation::{from_zyz, quaternion_error};
/// let (a, b) = (from_zyz([0.1, 0.2, 0.3]), from_zyz([0.4, 0.1, 3.0]));
/// assert!(quaternion_error(&a, &b).w >= 0.0);
/// ```
pub fn quaternion_error(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let e = compose(&from.inverse(), to);
    let leading = [e.w, e.i, e.j, e.k].into_iter().find(|x| *x != 0.0).unwrap_or(1.0);
    if leading < 0.0 { Unit::new_unchecked(-e.into_inner()) } else { e }
}

/// Angle, rad in [0, pi], of the rotation between two orientations; accurate at both ends.
///
/// ```
/// use redundancy_core::rotation::{from_zyz, rotation_angle};
/// let (a, b) = (from_zyz([0.0, 0.0, 0.0]), from_zyz([0.0, 0.0, 1e-9]));
/// assert!((rotation_angle(&a, &b) - 1e-9).abs() < 1e-20);
/// ```
pub fn rotation_angle(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    let e = a.inverse().into_inner() * b.into_inner();
    2.0 * e.imag().norm().atan2(e.w.abs())
}

/// Angle, rad in [0, pi], between two unit vectors; accurate at both ends.
pub(crate) fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    2.0 * (a - b).norm().atan2((a + b).norm())
}

/// `q` or `-q`, whichever is nearer to `reference` on the sphere of unit quaternions.
pub(crate) fn nearest_sign(q: UnitQuaternion<f64>, reference: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if q.coords.dot(&reference.coords) < 0.0 { Unit::new_unchecked(-q.into_inner()) } else { q }
}
