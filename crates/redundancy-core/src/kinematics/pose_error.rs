//! The error between two poses, the one that every solver and every report uses.
//!
//! The orientation error is the rotation vector, in base axes, of the shortest arc from the pose to its target: with
//! `R = R_target R_pose^T`, `2 sin(angle) axis` is the antisymmetric part of R and `1 + 2 cos(angle)` its trace. Both are sums over the
//! columns of the two matrices, so R itself is not formed. Near half a turn the antisymmetric part vanishes and the axis
//! is taken from the quaternion of R instead; at exactly half a turn, where there are two shortest arcs, one of them is taken.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3, Vector6};

use crate::pose::Pose;
use crate::tolerance::SMALL_SINE;

/// How far a pose is from its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// Target minus pose, m, base axes.
    pub linear: Vector3<f64>,
    /// Rotation vector of the shortest arc to the target, rad, base axes.
    pub angular: Vector3<f64>,
    /// Norm of the angular part, rad, at most pi.
    pub angle: f64,
}

impl PoseError {
    /// The error of `pose`, measured towards `target`.
    ///
    /// ```
    /// use redundancy_core::{Pose, kinematics::PoseError};
    /// use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
    /// let turn = Vector3::new(0.0, 0.0, 0.25);
    /// let turned = Pose::from_parts(Translation3::identity(), Rotation3::new(turn));
    /// let error = PoseError::between(&turned, &Pose::identity());
    /// assert!((error.angular - turn).norm() < 1e-15);
    /// ```
    #[inline(always)]
    pub fn between(target: &Pose, pose: &Pose) -> Self {
        let linear = target.translation.vector - pose.translation.vector;
        let (angular, angle) = shortest_turn(pose.rotation.matrix(), target.rotation.matrix());
        Self { linear, angular, angle }
    }

    /// The velocity that arrives at the target after one second: linear, angular.
    #[inline(always)]
    pub fn twist(&self) -> Vector6<f64> {
        let (p, r) = (&self.linear, &self.angular);
        Vector6::new(p.x, p.y, p.z, r.x, r.y, r.z)
    }
}

/// Rotation vector (base axes) of the shortest arc from one rotation to another, and its angle.
#[inline(always)]
fn shortest_turn(from: &Matrix3<f64>, to: &Matrix3<f64>) -> (Vector3<f64>, f64) {
    let (mut sin_axis, mut trace) = (Vector3::zeros(), -1.0);
    for j in 0..3 {
        let (a, b): (Vector3<f64>, Vector3<f64>) = (from.column(j).into(), to.column(j).into());
        sin_axis += a.cross(&b);
        trace += a.dot(&b);
    }
    // 2 sin(angle) axis and 2 cos(angle)
    let sin = sin_axis.norm();
    if sin < 2.0 * SMALL_SINE {
        if trace > 0.0 {
            // asin(x) = x + x^3 / 6
            let half = 0.5 * sin;
            let scale = 0.5 * (1.0 + half * half / 6.0);
            return (sin_axis * scale, sin * scale);
        }
        let r = rotation_vector(&(Rotation3::from_matrix_unchecked(*to * from.transpose())));
        return (r, r.norm());
    }
    let angle = sin.atan2(trace);
    (sin_axis * (angle / sin), angle)
}

/// Rotation vector (base axes) of the shortest arc; its norm is the angle, at most pi.
pub fn rotation_vector(rotation: &Rotation3<f64>) -> Vector3<f64> {
    let q = UnitQuaternion::from_rotation_matrix(rotation);
    let (v, sin) = (q.imag(), q.imag().norm());
    // Small angles: the angle is 2 asin |v|, so v / |v| * angle -> 2 v.
    let angle = 2.0 * sin.atan2(q.w.abs());
    let scale = if sin > 0.0 { angle / sin } else { 2.0 };
    v * if q.w < 0.0 { -scale } else { scale }
}
