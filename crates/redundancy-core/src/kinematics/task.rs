//! Which coordinates of the tool's motion count.
//!
//! | task | coordinates | what is free |
//! |---|---|---|
//! | `pose` | velocity, angular velocity (world axes) | nothing |
//! | `pose_rpy` | velocity, rates of roll-pitch-yaw, `R = Rz(phi) Ry(theta) Rx(psi)` [Bettini2000] | nothing |
//! | `position` | velocity | the orientation |
//! | `pointing` | velocity, angular velocity across the tool axis | the spin about the tool axis |
//! | `planar` | x', y' | the rest |
//! | `planar_pose` | x', y', angular velocity about z | the rest |
//!
//! The two angular coordinates of `pointing` are taken along two directions `u`, `w` that complete the tool axis to a
//! right-handed frame; they follow from the pose alone, so Jacobian, velocity and error of one pose fit together.
//! The rates of `pose_rpy` are singular where `cos theta = 0`; there they are bounded by [`RPY_COSINE`], not exact.

use std::fmt;

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3, Vector6};

use super::pose_error::PoseError;
use super::scratch::Kinematics;
use crate::chain::axis_onto_z;
use crate::error::{Error, Result, check_rates};
use crate::joint_space::difference;
use crate::pose::Pose;
use crate::rotation::to_rpy;
use crate::tolerance::RPY_COSINE;

/// The kind of a task, see the table of the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TaskKind {
    /// Position and orientation, angular velocity.
    Pose,
    /// Position and orientation, rates of roll-pitch-yaw.
    PoseRpy,
    /// Position.
    Position,
    /// Position and tool axis.
    Pointing,
    /// x and y.
    Planar,
    /// x, y and the rotation about z.
    PlanarPose,
}

impl TaskKind {
    /// Every kind, in declaration order.
    pub const ALL: [Self; 6] =
        [Self::Pose, Self::PoseRpy, Self::Position, Self::Pointing, Self::Planar, Self::PlanarPose];

    /// The kind as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Pose => "pose",
            Self::PoseRpy => "pose_rpy",
            Self::Position => "position",
            Self::Pointing => "pointing",
            Self::Planar => "planar",
            Self::PlanarPose => "planar_pose",
        }
    }

    /// How many coordinates count.
    pub fn dim(self) -> usize {
        match self {
            Self::Pose | Self::PoseRpy => 6,
            Self::Pointing => 5,
            Self::Position | Self::PlanarPose => 3,
            Self::Planar => 2,
        }
    }
}

impl fmt::Display for TaskKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Which coordinates of the tool's motion count.
///
/// ```
/// use redundancy_core::kinematics::Task;
/// assert_eq!(Task::from_name("pointing")?.dim(), 5);
/// assert!(Task::from_name("pos").is_err_and(|e| e.to_string().contains("position")));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task {
    kind: TaskKind,
    axis: Unit<Vector3<f64>>,
}

/// How far a pose is from its target in the coordinates of a task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaskError {
    /// Target minus pose: the velocity, in task coordinates, that arrives after one second. Zero from `dim` on.
    pub coordinates: Vector6<f64>,
    /// Distance of the position, m, of those coordinates that count.
    pub position: f64,
    /// Angle of the orientation, rad, of what counts of it.
    pub orientation: f64,
}

impl Task {
    /// The full pose, angular velocity.
    pub const POSE: Self = Self::of(TaskKind::Pose);
    /// The full pose, rates of roll-pitch-yaw.
    pub const POSE_RPY: Self = Self::of(TaskKind::PoseRpy);
    /// The position.
    pub const POSITION: Self = Self::of(TaskKind::Position);
    /// Position and tool z axis, spin free.
    pub const POINTING: Self = Self::of(TaskKind::Pointing);
    /// x and y.
    pub const PLANAR: Self = Self::of(TaskKind::Planar);
    /// x, y and the rotation about z.
    pub const PLANAR_POSE: Self = Self::of(TaskKind::PlanarPose);

    const fn of(kind: TaskKind) -> Self {
        Self { kind, axis: Unit::new_unchecked(Vector3::new(0.0, 0.0, 1.0)) }
    }

    /// Position and the direction of `axis`, a direction in the tool frame; the spin about it is free.
    ///
    /// # Errors
    /// An axis that is not finite or has no length.
    pub fn pointing(axis: [f64; 3]) -> Result<Self> {
        Ok(Self { axis: crate::rotation::unit_direction("tool axis", axis)?, ..Self::POINTING })
    }

    /// The task with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        TaskKind::ALL.into_iter().find(|kind| kind.as_str() == name).map(Self::of).ok_or_else(|| {
            let valid = TaskKind::ALL.iter().map(|kind| kind.as_str().to_owned()).collect();
            Error::UnknownName { kind: "task", name: name.into(), valid }
        })
    }

    /// Its kind.
    pub fn kind(&self) -> TaskKind {
        self.kind
    }

    /// The tool axis of `pointing`, in the tool frame; z for the other tasks.
    pub fn axis(&self) -> Unit<Vector3<f64>> {
        self.axis
    }

    /// How many coordinates count.
    pub fn dim(&self) -> usize {
        self.kind.dim()
    }

    /// How many numbers a velocity given by a caller has: those of the task, but six for `pointing`.
    pub fn velocity_len(&self) -> usize {
        if self.kind == TaskKind::Pointing { 6 } else { self.dim() }
    }

    /// Writes the Jacobian `(dim, n)` of the task, column by column.
    ///
    /// # Panics
    /// Never; columns beyond the end of `out` are left out.
    #[inline]
    pub fn write_jacobian(&self, kinematics: &Kinematics<'_>, out: &mut [f64]) {
        let columns = kinematics.jacobian().as_slice().as_chunks::<6>().0;
        match self.kind {
            TaskKind::Pose => {
                for (out, c) in out.as_chunks_mut::<6>().0.iter_mut().zip(columns) {
                    *out = *c;
                }
            }
            TaskKind::PoseRpy => {
                let rates = rpy_rates(kinematics.pose());
                for (out, c) in out.as_chunks_mut::<6>().0.iter_mut().zip(columns) {
                    let r = rates * Vector3::new(c[3], c[4], c[5]);
                    *out = [c[0], c[1], c[2], r.x, r.y, r.z];
                }
            }
            TaskKind::Position => {
                for (out, c) in out.as_chunks_mut::<3>().0.iter_mut().zip(columns) {
                    *out = [c[0], c[1], c[2]];
                }
            }
            TaskKind::Pointing => {
                let [u, w] = self.across(kinematics.pose());
                for (out, c) in out.as_chunks_mut::<5>().0.iter_mut().zip(columns) {
                    let angular = Vector3::new(c[3], c[4], c[5]);
                    *out = [c[0], c[1], c[2], u.dot(&angular), w.dot(&angular)];
                }
            }
            TaskKind::Planar => {
                for (out, c) in out.as_chunks_mut::<2>().0.iter_mut().zip(columns) {
                    *out = [c[0], c[1]];
                }
            }
            TaskKind::PlanarPose => {
                for (out, c) in out.as_chunks_mut::<3>().0.iter_mut().zip(columns) {
                    *out = [c[0], c[1], c[5]];
                }
            }
        }
    }

    /// A velocity of the tool at `pose` (linear and angular, world axes) in task coordinates; zero from `dim` on.
    pub fn from_twist(&self, pose: &Pose, twist: &Vector6<f64>) -> Vector6<f64> {
        let [x, y, z, a, b, c] = (*twist).into();
        let angular = Vector3::new(a, b, c);
        match self.kind {
            TaskKind::Pose => *twist,
            TaskKind::PoseRpy => {
                let r = rpy_rates(pose) * angular;
                Vector6::new(x, y, z, r.x, r.y, r.z)
            }
            TaskKind::Position => Vector6::new(x, y, z, 0.0, 0.0, 0.0),
            TaskKind::Pointing => {
                let [u, w] = self.across(pose);
                Vector6::new(x, y, z, u.dot(&angular), w.dot(&angular), 0.0)
            }
            TaskKind::Planar => Vector6::new(x, y, 0.0, 0.0, 0.0, 0.0),
            TaskKind::PlanarPose => Vector6::new(x, y, c, 0.0, 0.0, 0.0),
        }
    }

    /// The velocity of the tool (linear and angular, world axes) that has these coordinates; of what the task leaves free,
    /// nothing. The inverse of [`from_twist`](Self::from_twist) for `pose` and `pose_rpy`.
    pub fn twist(&self, pose: &Pose, coordinates: &Vector6<f64>) -> Vector6<f64> {
        let [x, y, z, a, b, c] = (*coordinates).into();
        match self.kind {
            TaskKind::Pose => *coordinates,
            TaskKind::PoseRpy => {
                // [ez, Rz(phi) ey, Rz(phi) Ry(theta) ex] [Bettini2000, section 4.1].
                let (sin, cos) = heading(pose).sin_cos();
                let first = pose.rotation.matrix().column(0);
                let w = Vector3::z() * a + Vector3::new(-sin, cos, 0.0) * b + first * c;
                Vector6::new(x, y, z, w.x, w.y, w.z)
            }
            TaskKind::Position => Vector6::new(x, y, z, 0.0, 0.0, 0.0),
            TaskKind::Pointing => {
                let [u, w] = self.across(pose);
                let w = u * a + w * b;
                Vector6::new(x, y, z, w.x, w.y, w.z)
            }
            TaskKind::Planar => Vector6::new(x, y, 0.0, 0.0, 0.0, 0.0),
            TaskKind::PlanarPose => Vector6::new(x, y, 0.0, 0.0, 0.0, z),
        }
    }

    /// A velocity given by a caller in task coordinates: as it is, but for `pointing`, where the six numbers are a
    /// linear and an angular velocity whose spin about the tool axis does not count.
    ///
    /// # Errors
    /// Other than [`Task::velocity_len`] numbers, one that is not finite, or one above `tolerance::LARGEST_RATE`, whose square
    /// would overflow.
    pub fn velocity(&self, pose: &Pose, given: &[f64]) -> Result<Vector6<f64>> {
        check_rates("task_velocity", given, self.velocity_len())?;
        let mut out = Vector6::zeros();
        out.as_mut_slice()[..given.len()].copy_from_slice(given);
        Ok(if self.kind == TaskKind::Pointing { self.from_twist(pose, &out) } else { out })
    }

    /// How far `pose` is from `target`. Orientations are compared along the shortest arc; half a turn away, where
    /// there are two, one of them is taken.
    #[inline]
    pub fn error(&self, target: &Pose, pose: &Pose) -> TaskError {
        let d = target.translation.vector - pose.translation.vector;
        let make = |coordinates: Vector6<f64>, position: f64, orientation: f64| TaskError {
            coordinates,
            position,
            orientation,
        };
        match self.kind {
            TaskKind::Pose => {
                let error = PoseError::between(target, pose);
                make(error.twist(), d.norm(), error.angle)
            }
            TaskKind::PoseRpy => {
                let (to, from) = (rpy(target), rpy(pose));
                let [a, b, c] = [0, 1, 2].map(|i| difference(from[i], to[i]));
                let angle = PoseError::between(target, pose).angle;
                make(Vector6::new(d.x, d.y, d.z, a, b, c), d.norm(), angle)
            }
            TaskKind::Position => make(Vector6::new(d.x, d.y, d.z, 0.0, 0.0, 0.0), d.norm(), 0.0),
            TaskKind::Pointing => {
                let (to, from) = (target.rotation * *self.axis, pose.rotation * *self.axis);
                let [u, w] = self.across(pose);
                let cross = from.cross(&to);
                let angle = cross.norm().atan2(from.dot(&to));
                // Half a turn away rounding decides the direction; where even that is zero, it is u.
                let (a, b) = (cross.dot(&u), cross.dot(&w));
                let sin = a.hypot(b);
                let (a, b) = if sin > 0.0 { (a / sin * angle, b / sin * angle) } else { (angle, 0.0) };
                make(Vector6::new(d.x, d.y, d.z, a, b, 0.0), d.norm(), angle)
            }
            TaskKind::Planar => make(Vector6::new(d.x, d.y, 0.0, 0.0, 0.0, 0.0), d.x.hypot(d.y), 0.0),
            TaskKind::PlanarPose => {
                let turn = difference(heading(pose), heading(target));
                make(Vector6::new(d.x, d.y, turn, 0.0, 0.0, 0.0), d.x.hypot(d.y), turn.abs())
            }
        }
    }

    /// Two world directions across the tool axis of `pose`: with it they form a right-handed frame.
    pub fn across(&self, pose: &Pose) -> [Vector3<f64>; 2] {
        let frame = axis_onto_z(&(pose.rotation * *self.axis));
        [frame.column(0).into(), frame.column(1).into()]
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind)
    }
}

/// `[phi, theta, psi]` of `Rz(phi) Ry(theta) Rx(psi)`.
fn rpy(pose: &Pose) -> [f64; 3] {
    let r = pose.rotation.matrix();
    let cos = r[(0, 0)].hypot(r[(1, 0)]);
    if cos < RPY_COSINE {
        return to_rpy(&UnitQuaternion::from_rotation_matrix(&pose.rotation));
    }
    [heading(pose), (-r[(2, 0)]).atan2(cos), r[(2, 1)].atan2(r[(2, 2)])]
}

/// Angle of the tool's x axis about the world's z.
fn heading(pose: &Pose) -> f64 {
    let r = pose.rotation.matrix();
    r[(1, 0)].atan2(r[(0, 0)])
}

/// The matrix that turns an angular velocity into the rates of phi, theta, psi, `R = Rz(phi) Ry(theta) Rx(psi)`:
/// the inverse of `[ez, Rz(phi) ey, Rz(phi) Ry(theta) ex]`.
fn rpy_rates(pose: &Pose) -> Matrix3<f64> {
    // The first column of R is Rz(phi) Ry(theta) ex = (c c, s c, -sin theta) with c = cos theta.
    let r = pose.rotation.matrix();
    let (x, y, sin) = (r[(0, 0)], r[(1, 0)], -r[(2, 0)]);
    let cos = x.hypot(y);
    // At cos theta = 0 the angle phi is undefined.
    let (c, s) = if cos > 0.0 { (x / cos, y / cos) } else { (1.0, 0.0) };
    let cos = cos.max(RPY_COSINE);
    Matrix3::new(c * sin / cos, s * sin / cos, 1.0, -s, c, 0.0, c / cos, s / cos, 0.0)
}
