//! The target of a search, and the error of a configuration in weighted task coordinates.

use nalgebra::{Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::error::{Error, Result, check_vector};
use crate::kinematics::{Kinematics, PoseError, Task, TaskKind, rotation_vector};
use crate::pose::Pose;
use crate::rotation::OrientationSet;

/// Rotation vector (world axes) from `rotation` to the nearest member of `set`; zero inside, and where an intersection
/// has no member that could be found.
pub(super) fn way_in(set: &OrientationSet, rotation: &Rotation3<f64>) -> Vector3<f64> {
    match set {
        OrientationSet::Cone(cone) => {
            let axis = rotation * *cone.body_axis();
            let across = axis.cross(&cone.direction());
            let (sin, cos) = (across.norm(), axis.dot(&cone.direction()));
            let excess = sin.atan2(cos) - cone.half_angle();
            if excess <= 0.0 {
                Vector3::zeros()
            } else if sin > 0.0 {
                across * (excess / sin)
            } else {
                // Against the direction: any axis across it serves.
                crate::chain::axis_onto_z(&axis).column(0) * excess
            }
        }
        set => {
            let q = UnitQuaternion::from_rotation_matrix(rotation);
            if set.margin(&q) >= 0.0 {
                return Vector3::zeros();
            }
            let near = set.nearest(&q).unwrap_or(q);
            rotation_vector(&(near * q.inverse()).to_rotation_matrix())
        }
    }
}

/// A target.
#[derive(Debug, Clone)]
pub(super) struct Goal<'a> {
    pub target: Pose,
    pub task: Task,
    /// Orientations that count as reached, instead of the target's.
    pub set: Option<&'a OrientationSet>,
    /// Radians that a metre counts.
    pub scale: f64,
}

/// Distance from a goal.
#[derive(Debug, Clone, Copy)]
pub(super) struct GoalError {
    /// Weighted task coordinates, zero beyond the task's dimension.
    pub e: [f64; 6],
    /// Metres.
    pub position: f64,
    /// Radians.
    pub orientation: f64,
}

impl Goal<'_> {
    /// The error at `kinematics`; writes the columns of its Jacobian.
    #[inline(always)]
    pub fn error(
        &self,
        kinematics: &Kinematics<'_>,
        columns: &mut [[f64; 6]],
        rows: &mut [f64],
    ) -> GoalError {
        let kind = self.task.kind();
        if self.set.is_none() && matches!(kind, TaskKind::Pose | TaskKind::PoseRpy) {
            self.pose_error(kinematics, columns)
        } else {
            self.other_error(kinematics, columns, rows)
        }
    }

    #[inline(always)]
    fn pose_error(&self, kinematics: &Kinematics<'_>, columns: &mut [[f64; 6]]) -> GoalError {
        let s = self.scale;
        for (out, c) in columns.iter_mut().zip(kinematics.jacobian().as_slice().as_chunks::<6>().0) {
            *out = [c[0] * s, c[1] * s, c[2] * s, c[3], c[4], c[5]];
        }
        let error = PoseError::between(&self.target, kinematics.pose());
        let (d, r) = (&error.linear, &error.angular);
        let e = [d.x * s, d.y * s, d.z * s, r.x, r.y, r.z];
        GoalError { e, position: d.norm(), orientation: error.angle }
    }

    fn other_error(
        &self,
        kinematics: &Kinematics<'_>,
        columns: &mut [[f64; 6]],
        rows: &mut [f64],
    ) -> GoalError {
        let pose = kinematics.pose();
        if let Some(set) = self.set {
            // The position, and one row along the shortest way into the set: the gradient of the distance from it.
            let way = way_in(set, &pose.rotation);
            let distance = way.norm();
            let along = if distance > 0.0 { way / distance } else { Vector3::zeros() };
            let d = self.target.translation.vector - pose.translation.vector;
            for (out, c) in columns.iter_mut().zip(kinematics.jacobian().as_slice().as_chunks::<6>().0) {
                let turn = along.x * c[3] + along.y * c[4] + along.z * c[5];
                *out = [c[0] * self.scale, c[1] * self.scale, c[2] * self.scale, turn, 0.0, 0.0];
            }
            let e = [d.x * self.scale, d.y * self.scale, d.z * self.scale, distance, 0.0, 0.0];
            return GoalError { e, position: d.norm(), orientation: distance };
        }
        let dim = self.task.dim();
        self.task.write_jacobian(kinematics, rows);
        let error = self.task.error(&self.target, pose);
        let mut e: [f64; 6] = error.coordinates.into();
        let linear = self.linear();
        for k in 0..linear {
            e[k] *= self.scale;
        }
        for (out, row) in columns.iter_mut().zip(rows.chunks_exact(dim)) {
            *out = [0.0; 6];
            for k in 0..dim {
                out[k] = if k < linear { row[k] * self.scale } else { row[k] };
            }
        }
        GoalError { e, position: error.position, orientation: error.orientation }
    }

    /// How many coordinates are lengths.
    fn linear(&self) -> usize {
        match self.task.kind() {
            TaskKind::Planar | TaskKind::PlanarPose => 2,
            _ => 3,
        }
    }

    /// An acceleration of the tool in weighted task coordinates.
    #[inline(always)]
    pub fn spread(
        &self,
        kinematics: &Kinematics<'_>,
        linear: &Vector3<f64>,
        angular: &Vector3<f64>,
        out: &mut [f64; 6],
    ) {
        let s = self.scale;
        if self.set.is_none() && matches!(self.task.kind(), TaskKind::Pose | TaskKind::PoseRpy) {
            *out = [linear.x * s, linear.y * s, linear.z * s, angular.x, angular.y, angular.z];
        } else {
            self.spread_other(kinematics, linear, angular, out);
        }
    }

    fn spread_other(
        &self,
        kinematics: &Kinematics<'_>,
        linear: &Vector3<f64>,
        angular: &Vector3<f64>,
        out: &mut [f64; 6],
    ) {
        let s = self.scale;
        if self.set.is_some() {
            *out = [linear.x * s, linear.y * s, linear.z * s, 0.0, 0.0, 0.0];
            return;
        }
        let twist = nalgebra::Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
        *out = self.task.from_twist(kinematics.pose(), &twist).into();
        for x in out.iter_mut().take(self.linear()) {
            *x *= s;
        }
    }
}

/// The pose that stands for the target of a task given by its coordinates alone: `(x, y)` for `planar`, `(x, y, angle)` for
/// `planar_pose`, `(x, y, z)` for `position`; what does not count is zero.
///
/// # Errors
/// Another number of coordinates, one that is not finite, a task whose target is a pose.
pub fn task_target(task: &Task, coordinates: &[f64]) -> Result<Pose> {
    if task.dim() > 3 {
        return Err(Error::Invalid(format!("a target of the task {task} is a pose")));
    }
    check_vector("target", coordinates, task.dim())?;
    let (x, y) = (coordinates[0], coordinates[1]);
    let (z, angle) = match task.kind() {
        TaskKind::Position => (coordinates[2], 0.0),
        TaskKind::PlanarPose => (0.0, coordinates[2]),
        _ => (0.0, 0.0),
    };
    Ok(Pose::from_parts(Translation3::new(x, y, z), Rotation3::from_axis_angle(&Vector3::z_axis(), angle)))
}
