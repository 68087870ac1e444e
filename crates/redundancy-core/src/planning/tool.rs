//! What the tool must do at a point of a path: equations and inequalities of its pose, with two derivatives.
//!
//! With `w_i` the axis of joint i and `v_i` the linear part of its Jacobian column, and for `i <= j`:
//!
//! ```text
//! position       p     dp = v_i                    d2p = w_i x v_j
//! tool axis      a     da = w_i x a                d2a = w_i x (w_j x a)
//! orientation    e     de = w_i                    d2e = (w_i x w_j) / 2 at e = 0, i < j
//! ```
//!
//! with `e` the rotation vector from the target to the tool: a product of exponentials has half of the commutator as its
//! second-order term. The spin is `2 atan2(x, w)` of the quaternion `(w, v)` of `R_path^T R`, with `x` the part of `v`
//! along the tool axis; its derivatives follow from those of the quaternion, `q_i = w_i q / 2` and `q_ij = w_i w_j q / 4`.
//!
//! Inequalities are scaled to be of order 1 in the middle of what they allow.

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::chain::axis_onto_z;
use crate::error::{Error, Result};
use crate::joint_space::wrap;
use crate::kinematics::{Kinematics, SpinFreedom, Task, TaskKind, ToolFreedom, rotation_vector};
use crate::pose::Pose;

/// Which coordinates of the position count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PositionRows {
    Space,
    Plane,
}

/// Which coordinates of the orientation are equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OrientationRows {
    /// None.
    Open,
    /// All three.
    Full,
    /// The tool axis.
    Axis,
    /// The twist about the tool axis.
    Twist,
    /// The rotation about z of planar arms.
    Heading,
}

/// Equations and inequalities of the tool at every point of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ToolTask {
    position: PositionRows,
    orientation: OrientationRows,
    axis: Unit<Vector3<f64>>,
    /// Largest angle of the tool axis, where that is an inequality.
    cone: Option<f64>,
    /// Largest twist, where that is an inequality.
    spin: Option<f64>,
}

/// A point of the path, prepared for [`ToolTask`].
#[derive(Debug, Clone)]
pub(super) struct Target {
    pub pose: Pose,
    /// The wanted tool axis in the world, and two directions across it.
    frame: Matrix3<f64>,
    quaternion: UnitQuaternion<f64>,
}

/// Most equations.
pub(super) const MOST_ROWS: usize = 6;
/// Most inequalities.
pub(super) const MOST_BOUNDS: usize = 3;

impl ToolTask {
    /// The task of a plan: the path's poses with some freedom, or a task by name.
    pub fn new(task: Option<Task>, freedom: &ToolFreedom, oriented: bool) -> Result<Self> {
        let base = Self {
            position: PositionRows::Space,
            orientation: OrientationRows::Open,
            axis: freedom.axis(),
            cone: None,
            spin: None,
        };
        let kind =
            task.map_or(if oriented { TaskKind::Pose } else { TaskKind::Position }, |task| task.kind());
        if !freedom.is_none() && kind != TaskKind::Pose {
            let why = if oriented {
                format!("the task '{kind}' already leaves the orientation free")
            } else {
                "the path has positions only, so there is no tool axis to tilt or spin about".to_owned()
            };
            return Err(Error::Invalid(format!("freedom does not apply: {why}")));
        }
        if !oriented && !matches!(kind, TaskKind::Position | TaskKind::Planar) {
            return Err(Error::Invalid(format!(
                "the task '{kind}' needs orientations, and the path has positions only"
            )));
        }
        Ok(match kind {
            TaskKind::Position => base,
            TaskKind::Planar => Self { position: PositionRows::Plane, ..base },
            TaskKind::PlanarPose => {
                Self { position: PositionRows::Plane, orientation: OrientationRows::Heading, ..base }
            }
            TaskKind::Pointing => {
                let axis = task.map_or(base.axis, |task| task.axis());
                Self { orientation: OrientationRows::Axis, axis, ..base }
            }
            TaskKind::Pose | TaskKind::PoseRpy => base.with_freedom(freedom),
        })
    }

    fn with_freedom(self, freedom: &ToolFreedom) -> Self {
        let cone = (freedom.half_angle() > 0.0).then_some(freedom.half_angle());
        let (fixed, spin) = match freedom.spin() {
            SpinFreedom::Free => (false, None),
            SpinFreedom::Within(0.0) => (true, None),
            SpinFreedom::Within(angle) => (false, Some(angle)),
        };
        let orientation = match (cone.is_some(), fixed) {
            (false, true) => OrientationRows::Full,
            (false, false) => OrientationRows::Axis,
            (true, true) => OrientationRows::Twist,
            (true, false) => OrientationRows::Open,
        };
        Self { orientation, cone, spin, ..self }
    }

    /// The task by name that asks for the same equations; `None` where the tool may lean.
    pub fn named(&self) -> Option<Task> {
        match (self.position, self.orientation) {
            _ if self.cone.is_some() => None,
            (PositionRows::Space, OrientationRows::Open) => Some(Task::POSITION),
            (PositionRows::Space, OrientationRows::Full) => Some(Task::POSE),
            (PositionRows::Space, OrientationRows::Axis) => Task::pointing((*self.axis).into()).ok(),
            (PositionRows::Plane, OrientationRows::Open) => Some(Task::PLANAR),
            (PositionRows::Plane, OrientationRows::Heading) => Some(Task::PLANAR_POSE),
            _ => None,
        }
    }

    /// Number of equations.
    pub fn rows(&self) -> usize {
        let position = if self.position == PositionRows::Space { 3 } else { 2 };
        position
            + match self.orientation {
                OrientationRows::Open => 0,
                OrientationRows::Full => 3,
                OrientationRows::Axis => 2,
                OrientationRows::Twist | OrientationRows::Heading => 1,
            }
    }

    /// Number of inequalities.
    pub fn bounds(&self) -> usize {
        usize::from(self.cone.is_some()) + if self.spin.is_some() { 2 } else { 0 }
    }

    /// True where the orientation counts, as equations or inequalities.
    pub fn oriented(&self) -> bool {
        self.orientation != OrientationRows::Open || self.bounds() > 0
    }

    /// A point of the path, prepared.
    pub fn target(&self, pose: &Pose) -> Target {
        Target {
            pose: *pose,
            frame: axis_onto_z(&(pose.rotation * *self.axis)),
            quaternion: UnitQuaternion::from_rotation_matrix(&pose.rotation),
        }
    }

    /// The equations `c` (tool minus target) alone.
    #[inline]
    pub fn write_values(&self, pose: &Pose, target: &Target, c: &mut [f64]) {
        let d = pose.translation.vector - target.pose.translation.vector;
        let p = if self.position == PositionRows::Space { 3 } else { 2 };
        c[..p].copy_from_slice(&d.as_slice()[..p]);
        match self.orientation {
            OrientationRows::Open => {}
            OrientationRows::Full => {
                let e = rotation_vector(&(pose.rotation * target.pose.rotation.inverse()));
                c[p..p + 3].copy_from_slice(e.as_slice());
            }
            OrientationRows::Axis => {
                let a = pose.rotation * *self.axis;
                let [u, w, d] = columns(&target.frame);
                (c[p], c[p + 1]) = (u.dot(&a), w.dot(&a));
                if a.dot(&d) < 0.0 {
                    // Beyond a right angle the sines fall again: there the angle and its direction count.
                    let along = across(&d, &a, &u).cross(&d);
                    let angle = a.angle(&d);
                    (c[p], c[p + 1]) = (along.dot(&u) * angle, along.dot(&w) * angle);
                }
            }
            OrientationRows::Twist => c[p] = self.spin_of(pose, target),
            OrientationRows::Heading => c[p] = wrap(heading(pose) - heading(&target.pose)),
        }
    }

    /// The equations `c` (tool minus target) and their Jacobian, column by column.
    #[inline]
    pub fn linearise(&self, at: &Kinematics<'_>, target: &Target, c: &mut [f64], jacobian: &mut [f64]) {
        let rows = self.rows();
        let p = if self.position == PositionRows::Space { 3 } else { 2 };
        self.write_values(at.pose(), target, c);
        for (j, column) in jacobian.chunks_exact_mut(rows).enumerate() {
            column[..p].copy_from_slice(&at.linear(j).as_slice()[..p]);
        }
        match self.orientation {
            OrientationRows::Open => {}
            OrientationRows::Full => {
                for (j, column) in jacobian.chunks_exact_mut(rows).enumerate() {
                    column[p..p + 3].copy_from_slice(at.angular(j).as_slice());
                }
            }
            OrientationRows::Axis => {
                let a = at.pose().rotation * *self.axis;
                let [u, w, d] = columns(&target.frame);
                let far = a.dot(&d) < 0.0;
                let across = if far { across(&d, &a, &u) } else { d };
                let along = across.cross(&d);
                let (s, t) = (along.dot(&u), along.dot(&w));
                for (j, column) in jacobian.chunks_exact_mut(rows).enumerate() {
                    let w_j = at.angular(j);
                    (column[p], column[p + 1]) = if far {
                        let (turn, side) = (across.dot(&w_j), d.dot(&w_j));
                        (s * turn - t * side, t * turn + s * side)
                    } else {
                        let da = w_j.cross(&a);
                        (u.dot(&da), w.dot(&da))
                    };
                }
            }
            OrientationRows::Twist => {
                let twist = self.twist(at, target);
                for (j, column) in jacobian.chunks_exact_mut(rows).enumerate() {
                    column[p] = twist.gradient.dot(&at.angular(j));
                }
            }
            OrientationRows::Heading => {
                for (j, column) in jacobian.chunks_exact_mut(rows).enumerate() {
                    column[p] = at.angular(j).z;
                }
            }
        }
    }

    /// Adds `sum_r multipliers_r d2 c_r / dq2`, symmetric `(n, n)`, at a configuration that meets the equations.
    #[inline]
    pub fn add_curvature(&self, at: &Kinematics<'_>, target: &Target, multipliers: &[f64], out: &mut [f64]) {
        let n = at.jacobian().ncols();
        let p = if self.position == PositionRows::Space { 3 } else { 2 };
        let force = Vector3::new(multipliers[0], multipliers[1], if p == 3 { multipliers[2] } else { 0.0 });
        let kind = self.orientation;
        let moment = match kind {
            OrientationRows::Open | OrientationRows::Heading | OrientationRows::Twist => Vector3::zeros(),
            OrientationRows::Full => {
                Vector3::new(multipliers[p], multipliers[p + 1], multipliers[p + 2]) * 0.5
            }
            OrientationRows::Axis => {
                let [u, w, _] = columns(&target.frame);
                u * multipliers[p] + w * multipliers[p + 1]
            }
        };
        let a = at.pose().rotation * *self.axis;
        let pointing = kind == OrientationRows::Axis;
        // (w_i x v_j) . f = v_j . (f x w_i): the products with i alone come first.
        let mut before = [(Vector3::zeros(), Vector3::zeros()); MOST_JOINTS];
        for (i, before) in before.iter_mut().enumerate().take(n) {
            let w = at.angular(i);
            *before = (force.cross(&w), moment.cross(&w));
        }
        for j in 0..n {
            let (v, w) = (at.linear(j), at.angular(j));
            let turned = if pointing { w.cross(&a) } else { w };
            for (i, (force, moment)) in before.iter().enumerate().take(j + 1) {
                // A rotation vector has no second derivative along one joint.
                let turn = if i < j || pointing { turned.dot(moment) } else { 0.0 };
                add_pair(n, out, i, j, v.dot(force) + turn);
            }
        }
        if kind == OrientationRows::Twist {
            let twist = self.twist(at, target);
            let multiplier = multipliers[p];
            add_symmetric(n, out, |i, j| multiplier * twist.second(&at.angular(i), &at.angular(j)));
        }
    }

    /// The inequalities `h >= 0` and their gradients, `n` numbers each.
    #[inline]
    pub fn write_bounds(&self, at: &Kinematics<'_>, target: &Target, h: &mut [f64], gradients: &mut [f64]) {
        let n = at.jacobian().ncols();
        let mut next = 0;
        if let Some(cone) = self.cone {
            let a = at.pose().rotation * *self.axis;
            let d: Vector3<f64> = target.frame.column(2).into();
            let (scale, moment) = (1.0 / (1.0 - cone.cos()), a.cross(&d));
            h[0] = 1.0 - (a - d).norm_squared() * 0.5 * scale;
            for (j, g) in gradients[..n].iter_mut().enumerate() {
                *g = at.angular(j).dot(&moment) * scale;
            }
            next = 1;
        }
        if let Some(spin) = self.spin {
            let twist = self.twist(at, target);
            let angle = wrap(twist.angle) / spin;
            (h[next], h[next + 1]) = (1.0 - angle, 1.0 + angle);
            for j in 0..n {
                let g = twist.gradient.dot(&at.angular(j)) / spin;
                (gradients[next * n + j], gradients[(next + 1) * n + j]) = (-g, g);
            }
        }
    }

    /// The inequalities alone.
    pub fn bound_values(&self, pose: &Pose, target: &Target, h: &mut [f64]) {
        let mut next = 0;
        if let Some(cone) = self.cone {
            let a = pose.rotation * *self.axis;
            let d: Vector3<f64> = target.frame.column(2).into();
            h[0] = 1.0 - (a - d).norm_squared() * 0.5 / (1.0 - cone.cos());
            next = 1;
        }
        if let Some(spin) = self.spin {
            let angle = self.spin_of(pose, target) / spin;
            (h[next], h[next + 1]) = (1.0 - angle, 1.0 + angle);
        }
    }

    /// Adds `sum_r weights_r d2 h_r / dq2`.
    #[inline]
    pub fn add_bound_curvature(
        &self,
        at: &Kinematics<'_>,
        target: &Target,
        weights: &[f64],
        out: &mut [f64],
    ) {
        let n = at.jacobian().ncols();
        let mut next = 0;
        if let Some(cone) = self.cone {
            let a = at.pose().rotation * *self.axis;
            let d: Vector3<f64> = target.frame.column(2).into();
            let weight = weights[0] / (1.0 - cone.cos());
            for j in 0..n {
                let turned = at.angular(j).cross(&a) * weight;
                for i in 0..=j {
                    add_pair(n, out, i, j, d.cross(&at.angular(i)).dot(&turned));
                }
            }
            next = 1;
        }
        if let Some(spin) = self.spin {
            let weight = (weights[next + 1] - weights[next]) / spin;
            let twist = self.twist(at, target);
            add_symmetric(n, out, |i, j| weight * twist.second(&at.angular(i), &at.angular(j)));
        }
    }

    /// Rotation vector of the swing: its two parts across the tool axis, rad.
    pub fn tilt_of(&self, pose: &Pose, target: &Target) -> [f64; 2] {
        let q = relative(pose, target);
        let x = q.imag().dot(&self.axis);
        let twist = UnitQuaternion::new_normalize(nalgebra::Quaternion::from_parts(q.w, *self.axis * x));
        let swing = q * twist.inverse();
        let v = rotation_vector(&swing.to_rotation_matrix());
        let frame = axis_onto_z(&self.axis);
        [frame.column(0).dot(&v), frame.column(1).dot(&v)]
    }

    /// The spin, in (-pi, pi].
    pub fn spin_of(&self, pose: &Pose, target: &Target) -> f64 {
        let q = relative(pose, target);
        wrap(2.0 * q.imag().dot(&self.axis).atan2(q.w))
    }

    /// Errors of position (m) and of what counts of the orientation (rad), inequalities included.
    pub fn error_of(&self, pose: &Pose, target: &Target) -> [f64; 2] {
        let d = pose.translation.vector - target.pose.translation.vector;
        let position = if self.position == PositionRows::Space { d.norm() } else { d.x.hypot(d.y) };
        let a = pose.rotation * *self.axis;
        let axis: Vector3<f64> = target.frame.column(2).into();
        let tilt = a.cross(&axis).norm().atan2(a.dot(&axis));
        let mut orientation = match self.orientation {
            OrientationRows::Open => 0.0,
            OrientationRows::Full => {
                rotation_vector(&(pose.rotation * target.pose.rotation.inverse())).norm()
            }
            OrientationRows::Axis => tilt,
            OrientationRows::Twist => self.spin_of(pose, target).abs(),
            OrientationRows::Heading => wrap(heading(pose) - heading(&target.pose)).abs(),
        };
        if let Some(cone) = self.cone {
            orientation = orientation.max(tilt - cone);
        }
        if let Some(spin) = self.spin {
            orientation = orientation.max(self.spin_of(pose, target).abs() - spin);
        }
        [position, orientation]
    }

    /// A stricter target inside the cone and the spin range for states that are pulled onto the task: the tool axis at the
    /// share `tilt` of the cone in the direction in which `pose` leans, and the spin at the share `spin` of its range.
    /// `None` where `pose` is inside already.
    pub fn inside(&self, pose: &Pose, target: &Target, tilt: f64, spin: f64) -> Inside {
        let mut inside = Inside { axis: None, twist: None };
        if let Some(cone) = self.cone {
            let a = pose.rotation * *self.axis;
            let d: Vector3<f64> = target.frame.column(2).into();
            let angle = a.cross(&d).norm().atan2(a.dot(&d));
            if angle > cone {
                let across = d.cross(&a);
                let across = if across.norm() > 1e-9 { across } else { target.frame.column(0).into_owned() };
                inside.axis = Some(Rotation3::from_scaled_axis(across.normalize() * (cone * tilt)) * d);
            }
        }
        if let Some(range) = self.spin
            && self.spin_of(pose, target).abs() > range
        {
            inside.twist = Some(range * spin);
        }
        inside
    }

    /// Spin and its derivatives.
    fn twist(&self, at: &Kinematics<'_>, target: &Target) -> Twist {
        let q = relative(at.pose(), target);
        let (w, v, a) = (q.w, q.imag(), *self.axis);
        let x = v.dot(&a);
        let square = (w * w + x * x).max(TWIST_FLOOR);
        let local = (a * (w * w) + v.cross(&a) * w + v * x) / square;
        Twist {
            angle: 2.0 * x.atan2(w),
            gradient: target.pose.rotation * local,
            path: target.pose.rotation,
            w,
            v,
            a,
            square,
        }
    }

    /// Rows of a stricter target: two for the axis, one for the twist, appended below `rows` of `height`.
    pub fn linearise_inside(
        &self,
        at: &Kinematics<'_>,
        target: &Target,
        inside: &Inside,
        first: usize,
        height: usize,
        c: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let mut next = first;
        if let Some(d) = inside.axis {
            let a = at.pose().rotation * *self.axis;
            let cross = d.cross(&a);
            let angle = cross.norm().atan2(a.dot(&d));
            let [u, w, _] = columns(&axis_onto_z(&Unit::new_normalize(a)));
            let e = if cross.norm() > 1e-12 { cross * (angle / cross.norm()) } else { cross };
            (c[next], c[next + 1]) = (e.dot(&u), e.dot(&w));
            for (j, column) in jacobian.chunks_exact_mut(height).enumerate() {
                let w_j = at.angular(j);
                (column[next], column[next + 1]) = (u.dot(&w_j), w.dot(&w_j));
            }
            next += 2;
        }
        if let Some(goal) = inside.twist {
            let twist = self.twist(at, target);
            c[next] = wrap(twist.angle - goal);
            for (j, column) in jacobian.chunks_exact_mut(height).enumerate() {
                column[next] = twist.gradient.dot(&at.angular(j));
            }
        }
    }
}

/// What [`ToolTask::inside`] asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Inside {
    axis: Option<Vector3<f64>>,
    twist: Option<f64>,
}

impl Inside {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        2 * usize::from(self.axis.is_some()) + usize::from(self.twist.is_some())
    }
}

struct Twist {
    angle: f64,
    /// With respect to an angular velocity in the world.
    gradient: Vector3<f64>,
    path: Rotation3<f64>,
    w: f64,
    v: Vector3<f64>,
    a: Vector3<f64>,
    square: f64,
}

impl Twist {
    /// Second derivative along two joints, the first of them nearer to the base.
    #[inline]
    fn second(&self, w_i: &Vector3<f64>, w_j: &Vector3<f64>) -> f64 {
        let (b, c) = (self.path.inverse_transform_vector(w_i), self.path.inverse_transform_vector(w_j));
        let (w, v, a) = (self.w, &self.v, &self.a);
        let x = v.dot(a);
        let first = |b: &Vector3<f64>| (-0.5 * b.dot(v), 0.5 * (b * w + b.cross(v)).dot(a));
        let ((w1, x1), (w2, x2)) = (first(&b), first(&c));
        let (scalar, vector) = (-b.dot(&c), b.cross(&c));
        let w12 = 0.25 * (scalar * w - vector.dot(v));
        let x12 = 0.25 * (v * scalar + vector * w + vector.cross(v)).dot(a);
        let square = self.square;
        let turn = w2 * x1 + w * x12 - x2 * w1 - x * w12;
        2.0 * (turn / square - (w * x1 - x * w1) * 2.0 * (w * w2 + x * x2) / (square * square))
    }
}

fn relative(pose: &Pose, target: &Target) -> UnitQuaternion<f64> {
    target.quaternion.inverse() * UnitQuaternion::from_rotation_matrix(&pose.rotation)
}

/// Direction about which the tool axis `a` is turned away from `d`; `u` where that is undefined.
fn across(d: &Vector3<f64>, a: &Vector3<f64>, u: &Vector3<f64>) -> Vector3<f64> {
    let across = d.cross(a);
    let norm = across.norm();
    if norm > 1e-9 { across / norm } else { *u }
}

/// Angle of the tool's x axis about the world's z.
fn heading(pose: &Pose) -> f64 {
    let r = pose.rotation.matrix();
    r[(1, 0)].atan2(r[(0, 0)])
}

fn columns(m: &Matrix3<f64>) -> [Vector3<f64>; 3] {
    [m.column(0).into(), m.column(1).into(), m.column(2).into()]
}

/// Adds `f(i, j)` with `i <= j` to both triangles.
#[inline(always)]
fn add_symmetric(n: usize, out: &mut [f64], f: impl Fn(usize, usize) -> f64) {
    for i in 0..n {
        for j in i..n {
            add_pair(n, out, i, j, f(i, j));
        }
    }
}

/// Adds a value to an entry and to its mirror image.
#[inline(always)]
fn add_pair(n: usize, out: &mut [f64], i: usize, j: usize, value: f64) {
    out[i * n + j] += value;
    if i != j {
        out[j * n + i] += value;
    }
}

/// Most joints of a chain that is planned for.
pub(super) const MOST_JOINTS: usize = 16;
/// Least `w^2 + x^2` that a twist is divided by: half a turn of swing, where the twist is undefined.
const TWIST_FLOOR: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::catalog;
    use crate::kinematics::Scratch;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const STEP: f64 = 1e-4;

    fn tasks() -> Vec<ToolTask> {
        let axis = [0.3, -0.2, 0.9];
        let freedom = |half_angle, spin| ToolFreedom::new(half_angle, spin, axis);
        let free = SpinFreedom::Free;
        let mut out = Vec::new();
        for (half_angle, spin) in [
            (0.0, SpinFreedom::Within(0.0)),
            (0.0, free),
            (0.0, SpinFreedom::Within(0.7)),
            (0.4, SpinFreedom::Within(0.0)),
            (0.4, SpinFreedom::Within(0.7)),
            (0.4, free),
        ] {
            out.extend(freedom(half_angle, spin).and_then(|f| ToolTask::new(None, &f, true)));
        }
        out.extend(ToolTask::new(None, &ToolFreedom::NONE, false));
        assert_eq!(out.len(), 7);
        out
    }

    /// A configuration on the task of a target, and a direction in joint space.
    fn drawn(rng: &mut ChaCha8Rng, task: &ToolTask) -> (Vec<f64>, Vec<f64>, Target) {
        let chain = arm();
        let q: Vec<f64> = (0..7).map(|_| rng.random_range(-2.0..2.0)).collect();
        let d: Vec<f64> = (0..7).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut pose = chain.forward_unchecked(&q);
        let turn = |rng: &mut ChaCha8Rng, size: f64| {
            Rotation3::from_scaled_axis(Vector3::from_fn(|_, _| rng.random_range(-size..size)))
        };
        // What is free is away from the target, what is not is on it.
        let spin = Rotation3::from_axis_angle(&task.axis, rng.random_range(-0.6..0.6));
        pose.rotation = match task.orientation {
            OrientationRows::Open => pose.rotation * turn(rng, 0.2),
            OrientationRows::Axis => pose.rotation * spin,
            OrientationRows::Twist => {
                let across = axis_onto_z(&task.axis) * Vector3::new(0.2, -0.15, 0.0);
                pose.rotation * Rotation3::from_scaled_axis(across)
            }
            OrientationRows::Full | OrientationRows::Heading => pose.rotation,
        };
        (q, d, task.target(&pose))
    }

    fn arm() -> crate::chain::Chain {
        match catalog::load("panda") {
            Ok(chain) => chain,
            Err(error) => unreachable!("{error}"),
        }
    }

    fn moved(q: &[f64], d: &[f64], t: f64) -> Vec<f64> {
        q.iter().zip(d).map(|(q, d)| q + t * d).collect()
    }

    #[test]
    fn equations_and_bounds_have_the_derivatives_that_they_claim() {
        let chain = arm();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut scratch = Scratch::new(&chain);
        for task in tasks() {
            let (rows, bounds) = (task.rows(), task.bounds());
            for _ in 0..100 {
                let (q, d, target) = drawn(&mut rng, &task);
                let mut c = vec![0.0; rows];
                let mut jacobian = vec![0.0; rows * 7];
                let mut at =
                    |q: &[f64], c: &mut [f64], jacobian: &mut [f64], h: &mut [f64], g: &mut [f64]| {
                        let kinematics = chain.kinematics_unchecked(q, &mut scratch);
                        task.linearise(&kinematics, &target, c, jacobian);
                        task.write_bounds(&kinematics, &target, h, g);
                    };
                let (mut h, mut g) = ([0.0; MOST_BOUNDS], vec![0.0; 7 * MOST_BOUNDS]);
                at(&q, &mut c, &mut jacobian, &mut h, &mut g);
                assert!(c.iter().all(|c| c.abs() < 1e-12), "{task:?} {c:?}");
                let (mut c1, mut c2) = (c.clone(), c.clone());
                let (mut h1, mut h2) = (h, h);
                let (mut rest, mut rest_g) = (jacobian.clone(), g.clone());
                at(&moved(&q, &d, STEP), &mut c1, &mut rest, &mut h1, &mut rest_g);
                at(&moved(&q, &d, -STEP), &mut c2, &mut rest, &mut h2, &mut rest_g);
                let kinematics = chain.kinematics_unchecked(&q, &mut scratch);
                for r in 0..rows {
                    let slope: f64 = (0..7).map(|i| jacobian[i * rows + r] * d[i]).sum();
                    assert!((slope - (c1[r] - c2[r]) / (2.0 * STEP)).abs() < 1e-6, "{task:?} row {r}");
                    let mut multipliers = [0.0; MOST_ROWS];
                    multipliers[r] = 1.0;
                    let mut hessian = vec![0.0; 49];
                    task.add_curvature(&kinematics, &target, &multipliers, &mut hessian);
                    let second = (c1[r] - 2.0 * c[r] + c2[r]) / (STEP * STEP);
                    assert!((quadratic(&hessian, &d) - second).abs() < 2e-5, "{task:?} row {r}");
                }
                for b in 0..bounds {
                    let slope: f64 = (0..7).map(|i| g[b * 7 + i] * d[i]).sum();
                    assert!((slope - (h1[b] - h2[b]) / (2.0 * STEP)).abs() < 1e-5, "{task:?} bound {b}");
                    let mut weights = [0.0; MOST_BOUNDS];
                    weights[b] = 1.0;
                    let mut hessian = vec![0.0; 49];
                    task.add_bound_curvature(&kinematics, &target, &weights, &mut hessian);
                    let second = (h1[b] - 2.0 * h[b] + h2[b]) / (STEP * STEP);
                    assert!((quadratic(&hessian, &d) - second).abs() < 1e-4, "{task:?} bound {b}");
                }
            }
        }
    }

    fn quadratic(hessian: &[f64], d: &[f64]) -> f64 {
        (0..7).map(|i| (0..7).map(|j| d[i] * hessian[i * 7 + j] * d[j]).sum::<f64>()).sum()
    }

    #[test]
    fn tilt_and_spin_are_the_two_parts_of_the_rotation() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let Ok(freedom) = ToolFreedom::new(0.3, SpinFreedom::Free, [0.0, 0.0, 1.0]) else { return };
        let Ok(task) = ToolTask::new(None, &freedom, true) else { return };
        for _ in 0..200 {
            let (tilt, spin) =
                ([rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)], rng.random_range(-3.0..3.0));
            let path = Rotation3::from_scaled_axis(Vector3::from_fn(|_, _| rng.random_range(-2.0..2.0)));
            let swing = Rotation3::from_scaled_axis(Vector3::new(tilt[0], tilt[1], 0.0));
            let turned = path * swing * Rotation3::from_axis_angle(&Vector3::z_axis(), spin);
            let at = |r: Rotation3<f64>| Pose::from_parts(nalgebra::Translation3::identity(), r);
            let target = task.target(&at(path));
            assert!((task.spin_of(&at(turned), &target) - spin).abs() < 1e-12);
            let found = task.tilt_of(&at(turned), &target);
            assert!((found[0] - tilt[0]).abs() < 1e-12 && (found[1] - tilt[1]).abs() < 1e-12);
        }
    }
}
