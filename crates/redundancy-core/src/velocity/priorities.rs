//! Several tasks with strict priorities within hard limits.
//!
//! Level by level: the largest scale s in [0, 1] for which some joint velocity within the limits has `J qd = s v` and keeps what
//! the levels above have; what it has is then kept by the levels below. Last, the joint velocity nearest to the wish is taken.
//! All problems are solved exactly, see the module `hierarchy`; the limits are those of the module `bounds`.
//!
//! - Where the levels above leave a task less freedom than it has coordinates, `J qd = s v` is met as nearly as they allow, in
//!   the sense of least squares: the position of the elbow below a full pose moves the elbow along its circle. Where it is limits
//!   that take the freedom, and one scale still meets the task exactly, that scale is taken.
//! - Where no s is possible, because joints have to brake or because of what the levels above do, the scale is 0 and the task
//!   error `|J qd - v|` the least within the limits.
//! - Half-spaces and cones are inequalities `g . qd >= b`. For a distance d from the bound, in m or rad,
//!   `b = -min(alpha d, sqrt(2 a_d d))` with the barrier rate alpha, at most `1 / dt`, and the deceleration
//!   `a_d = sum |g_i| a_i` that the acceleration limits allow; beyond the bound `b = alpha |d|` leads back. An inequality that
//!   cannot be held is violated as little as the levels above allow.

use std::sync::Arc;

use nalgebra::{Unit, Vector3, Vector6};

use super::bounds::Bounds;
use super::hierarchy::Hierarchy;
use super::{ActiveLimit, StepInput};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_finite, check_length, check_rates};
use crate::kinematics::{Kinematics, Scratch, Task};
use crate::pose::Pose;
use crate::rotation::unit_direction;
use crate::status::Status;
use crate::tolerance::{CONE_AXIS_SINE, PRIORITY_RESIDUAL};

/// One level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PriorityTask {
    /// A velocity of the coordinates of a task, for the frame of a link (`None` is the tool).
    Motion {
        /// Which coordinates count.
        task: Task,
        /// The link, see [`Chain::link_index`].
        link: Option<usize>,
    },
    /// The origin of a link's frame stays where `normal . (x - point) >= 0`, world axes.
    HalfSpace {
        /// The link.
        link: Option<usize>,
        /// A point of the plane, m.
        point: Vector3<f64>,
        /// Direction of the allowed side.
        normal: Unit<Vector3<f64>>,
    },
    /// A direction that the link carries stays within an angle of a direction of the world.
    Cone {
        /// The link.
        link: Option<usize>,
        /// In the link's frame.
        axis: Unit<Vector3<f64>>,
        /// In world axes.
        direction: Unit<Vector3<f64>>,
        /// The angle, rad.
        half_angle: f64,
    },
}

impl PriorityTask {
    /// A half-space from any normal but zero.
    ///
    /// # Errors
    /// Numbers that are not finite, a normal without length.
    pub fn half_space(link: Option<usize>, point: [f64; 3], normal: [f64; 3]) -> Result<Self> {
        check_finite("point", &point)?;
        Ok(Self::HalfSpace { link, point: point.into(), normal: unit_direction("normal", normal)? })
    }

    /// A cone from any directions but zero.
    ///
    /// # Errors
    /// Numbers that are not finite, directions without length, an angle outside (0, pi].
    pub fn cone(link: Option<usize>, axis: [f64; 3], direction: [f64; 3], half_angle: f64) -> Result<Self> {
        if !(half_angle > 0.0 && half_angle <= std::f64::consts::PI) {
            let bound = "in (0, pi] rad".into();
            return Err(Error::OutOfRange { what: "half_angle".into(), value: half_angle, bound });
        }
        let (axis, direction) = (unit_direction("axis", axis)?, unit_direction("direction", direction)?);
        Ok(Self::Cone { link, axis, direction, half_angle })
    }

    /// The link that it is about.
    pub fn link(&self) -> Option<usize> {
        match self {
            Self::Motion { link, .. } | Self::HalfSpace { link, .. } | Self::Cone { link, .. } => *link,
        }
    }

    /// How many numbers its velocity has: none for an inequality.
    pub fn velocity_len(&self) -> usize {
        if let Self::Motion { task, .. } = self { task.velocity_len() } else { 0 }
    }
}

/// What one step did; scales and residuals are read from the scheme.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorityStep {
    /// `converged` where all levels have the scale 1; `singular` where one of them is met only as nearly as those above allow;
    /// `limits` where limits reduced one.
    pub status: Status,
}

/// Tasks with strict priorities within hard position, velocity and acceleration limits.
///
/// ```
/// use redundancy_core::{chain::catalog, kinematics::Task};
/// use redundancy_core::velocity::{PrioritizedNullspace, PriorityTask, StepInput};
/// let arm = catalog::load("iiwa14")?;
/// let tool = PriorityTask::Motion { task: Task::POSITION, link: None };
/// let elbow = PriorityTask::Motion { task: Task::POSITION, link: Some(arm.link_index("link_4")?) };
/// let mut scheme = PrioritizedNullspace::new(&arm, &[tool, elbow], None, 1.0)?;
/// let q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
/// let mut qd = [0.0; 7];
/// let input = StepInput { q: &q, velocity: &[], dt: Some(0.01), qd: None, wish: None };
/// scheme.step(&input, &[&[0.1, 0.0, 0.0], &[0.0, 0.0, 0.05]], &mut qd)?;
/// assert_eq!(scheme.scales(), [1.0, 1.0]);
/// assert!((arm.tool_velocity(&q, &qd)?[0] - 0.1).abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct PrioritizedNullspace {
    chain: Chain,
    tasks: Vec<PriorityTask>,
    criterion: Option<Arc<dyn Criterion>>,
    gain: f64,
    barrier_rate: f64,
    scratch: Scratch,
    bounds: Bounds,
    hierarchy: Hierarchy,
    wish: Vec<f64>,
    columns: Vec<f64>,
    /// Jacobians `(m, n)` column by column, and velocities, of all levels; of an inequality its row and bound.
    jacobians: Vec<f64>,
    velocities: Vec<[f64; 6]>,
    scales: Vec<f64>,
    residuals: Vec<f64>,
    active: Vec<ActiveLimit>,
}

impl PrioritizedNullspace {
    /// The first task has the highest priority. `gain` times the criterion's gradient is the wish.
    ///
    /// # Errors
    /// No task, a link that does not exist, a criterion of another arm, a gain that is negative or not finite.
    pub fn new(
        chain: &Chain,
        tasks: &[PriorityTask],
        criterion: Option<Arc<dyn Criterion>>,
        gain: f64,
    ) -> Result<Self> {
        if tasks.is_empty() {
            return Err(Error::Invalid("tasks: at least one is needed".into()));
        }
        for task in tasks {
            task.link().map_or(Ok(()), |link| chain.link(link).map(drop))?;
        }
        if !(gain.is_finite() && gain >= 0.0) {
            let bound = "finite and >= 0".into();
            return Err(Error::OutOfRange { what: "gain".into(), value: gain, bound });
        }
        if let Some(h) = &criterion {
            h.check_arm(chain)?;
        }
        let (n, count) = (chain.dof(), tasks.len());
        let further = tasks.iter().filter(|task| task.velocity_len() == 0).count();
        Ok(Self {
            chain: chain.clone(),
            tasks: tasks.to_vec(),
            criterion,
            gain,
            barrier_rate: super::ContactSettings::default().barrier_rate,
            scratch: Scratch::new(chain),
            bounds: Bounds::new(n),
            hierarchy: Hierarchy::new(n, further),
            wish: vec![0.0; n],
            columns: vec![0.0; 6 * n],
            jacobians: vec![0.0; 6 * n * count],
            velocities: vec![[0.0; 6]; count],
            scales: vec![1.0; count],
            residuals: vec![0.0; count],
            active: Vec::with_capacity(2 * n),
        })
    }

    /// How fast the distance from the bound of an inequality may shrink, 1/s.
    ///
    /// # Errors
    /// A rate that is not positive or not finite.
    pub fn with_barrier_rate(mut self, rate: f64) -> Result<Self> {
        if !(rate.is_finite() && rate > 0.0) {
            let bound = "finite and > 0 per s".into();
            return Err(Error::OutOfRange { what: "barrier_rate".into(), value: rate, bound });
        }
        self.barrier_rate = rate;
        Ok(self)
    }

    /// The arm.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The levels.
    pub fn tasks(&self) -> &[PriorityTask] {
        &self.tasks
    }

    /// Of the last step, one for each level: of a motion s; of an inequality 1 where it holds, else the share of the way back
    /// that is made, 0 where there is none.
    pub fn scales(&self) -> &[f64] {
        &self.scales
    }

    /// Of the last step: of a motion `|J qd - s v|` (`|J qd - v|` where no s was possible), of an inequality what is missing.
    pub fn residuals(&self) -> &[f64] {
        &self.residuals
    }

    /// The limits that the last step is at.
    pub fn active_limits(&self) -> &[ActiveLimit] {
        &self.active
    }

    /// One step: writes the joint velocity (n). `velocities` has one entry for each level, empty for inequalities; the
    /// `velocity` of the input is not used.
    ///
    /// # Errors
    /// Wrong lengths, numbers that are not finite, a missing `dt` or one that is not positive.
    pub fn step(
        &mut self,
        input: &StepInput<'_>,
        velocities: &[&[f64]],
        qd: &mut [f64],
    ) -> Result<PriorityStep> {
        let dt = self.check(input, velocities, qd)?;
        self.bounds.update(&self.chain, input.q, input.qd, dt);
        self.prepare(input, velocities, dt)?;
        let Self { hierarchy, bounds, tasks, .. } = self;
        hierarchy.begin(&bounds.low, &bounds.high, &self.wish);
        let n = self.chain.dof();
        for (level, task) in tasks.iter().enumerate() {
            let jacobian = &self.jacobians[6 * n * level..];
            self.scales[level] = match task {
                PriorityTask::Motion { task, .. } => {
                    let m = task.dim();
                    let v = &self.velocities[level][..m];
                    match hierarchy.meet(&jacobian[..m * n], v) {
                        Some(s) => s,
                        None => {
                            hierarchy.settle();
                            hierarchy.approach();
                            0.0
                        }
                    }
                }
                _ => {
                    let bound = self.velocities[level][0];
                    let row = hierarchy.add_row(&jacobian[..n], f64::NEG_INFINITY);
                    match hierarchy.hold(row, bound) {
                        Some(value) if value >= bound => 1.0,
                        Some(value) if bound > 0.0 => (value / bound).clamp(0.0, 1.0),
                        _ => 0.0,
                    }
                }
            };
        }
        hierarchy.finish(qd);
        for (i, qd) in qd.iter_mut().enumerate() {
            *qd = qd.clamp(bounds.low[i], bounds.high[i]);
        }
        self.active.clear();
        self.active.extend_from_slice(&self.bounds.outside);
        self.bounds.report(qd, &mut self.active);
        Ok(PriorityStep { status: self.judge(qd) })
    }

    fn check(&self, input: &StepInput<'_>, velocities: &[&[f64]], qd: &[f64]) -> Result<f64> {
        let n = self.chain.dof();
        self.chain.check_q(input.q)?;
        check_length("joint velocity", qd, n)?;
        for (what, given) in [("qd", input.qd), ("wish", input.wish)] {
            given.map_or(Ok(()), |given| check_rates(what, given, n))?;
        }
        if velocities.len() != self.tasks.len() {
            let (expected, actual) = (self.tasks.len(), velocities.len());
            return Err(Error::Length { what: "task velocities".into(), expected, actual });
        }
        match input.dt {
            Some(dt) if dt.is_finite() && dt > 0.0 => Ok(dt),
            Some(dt) => {
                Err(Error::OutOfRange { what: "dt".into(), value: dt, bound: "finite and > 0".into() })
            }
            None => Err(Error::Invalid("dt is missing: limits need the length of the step".into())),
        }
    }

    /// Jacobians, velocities and bounds of all levels, and the wish.
    fn prepare(&mut self, input: &StepInput<'_>, velocities: &[&[f64]], dt: f64) -> Result<()> {
        let n = self.chain.dof();
        let kinematics = self.chain.kinematics_unchecked(input.q, &mut self.scratch);
        for (level, task) in self.tasks.iter().enumerate() {
            let pose = kinematics.write_link_columns(&self.chain, task.link(), &mut self.columns);
            let columns = self.columns.as_chunks::<6>().0;
            let out = &mut self.jacobians[6 * n * level..6 * n * (level + 1)];
            if let PriorityTask::Motion { task, .. } = task {
                let given = task.velocity(&pose, velocities[level])?;
                self.velocities[level].copy_from_slice(given.as_slice());
                for (column, out) in columns.iter().zip(out.chunks_exact_mut(task.dim())) {
                    let coordinates = task.from_twist(&pose, &Vector6::from(*column));
                    out.copy_from_slice(&coordinates.as_slice()[..task.dim()]);
                }
                continue;
            }
            check_length("task velocity of an inequality", velocities[level], 0)?;
            let room = write_inequality(task, &pose, columns, &mut out[..n]);
            let rate = self.barrier_rate.min(1.0 / dt);
            let mut speed = rate * room;
            if room > 0.0 {
                let brake: f64 =
                    out[..n].iter().zip(self.chain.joints()).map(|(g, joint)| braking(*g, joint)).sum();
                speed = speed.min((2.0 * brake * room).sqrt());
            }
            self.velocities[level][0] = -speed;
        }
        write_wish(&self.criterion, &self.chain, self.gain, input, &kinematics, &mut self.wish);
        Ok(())
    }

    /// Residuals and status of a joint velocity.
    fn judge(&mut self, qd: &[f64]) -> Status {
        let n = self.chain.dof();
        let mut status = Status::Converged;
        for (level, task) in self.tasks.iter().enumerate() {
            let jacobian = &self.jacobians[6 * n * level..];
            let (scale, v) = (self.scales[level], &self.velocities[level]);
            self.residuals[level] = match task {
                PriorityTask::Motion { task, .. } => {
                    let m = task.dim();
                    let kept = if scale > 0.0 { scale } else { 1.0 };
                    let mut error = [0.0; 6];
                    for i in 0..m {
                        error[i] = (0..n).map(|j| jacobian[j * m + i] * qd[j]).sum::<f64>() - kept * v[i];
                    }
                    let whole = error.iter().map(|x| x * x).sum::<f64>().sqrt();
                    // A scale of zero that is possible: the task stands still.
                    let still = (0..m).all(|i| (error[i] + v[i]).abs() <= PRIORITY_RESIDUAL);
                    if scale == 0.0 && still { 0.0 } else { whole }
                }
                _ => (v[0] - (0..n).map(|j| jacobian[j] * qd[j]).sum::<f64>()).max(0.0),
            };
            if scale < 1.0 {
                status = Status::Limits;
            } else if status == Status::Converged && self.residuals[level] > PRIORITY_RESIDUAL {
                status = Status::Singular;
            }
        }
        status
    }
}

/// Deceleration that a joint adds along a row.
fn braking(g: f64, joint: &crate::chain::Joint) -> f64 {
    if g == 0.0 { 0.0 } else { g.abs() * joint.limits.acceleration }
}

/// Writes the joint velocity that is wished for.
fn write_wish(
    criterion: &Option<Arc<dyn Criterion>>,
    chain: &Chain,
    gain: f64,
    input: &StepInput<'_>,
    kinematics: &Kinematics<'_>,
    out: &mut [f64],
) {
    match (input.wish, criterion) {
        (Some(wish), _) => out.copy_from_slice(wish),
        (None, None) => out.fill(0.0),
        (None, Some(h)) => {
            if h.chain() == Some(chain) {
                h.gradient_at(input.q, kinematics, out);
            } else {
                h.gradient(input.q, out);
            }
            let factor = -gain * h.sense().sign();
            out.iter_mut().for_each(|x| *x *= factor);
        }
    }
}

/// Writes the gradient of the distance from the bound, which is returned, m or rad.
fn write_inequality(task: &PriorityTask, pose: &Pose, columns: &[[f64; 6]], out: &mut [f64]) -> f64 {
    match task {
        PriorityTask::Motion { .. } => 0.0,
        PriorityTask::HalfSpace { point, normal, .. } => {
            for (out, c) in out.iter_mut().zip(columns) {
                *out = normal.dot(&Vector3::new(c[0], c[1], c[2]));
            }
            normal.dot(&(pose.translation.vector - point))
        }
        PriorityTask::Cone { axis, direction, half_angle, .. } => {
            let carried = pose.rotation * axis.into_inner();
            let cross = carried.cross(direction.as_ref());
            let sine = cross.norm();
            let angle = sine.atan2(carried.dot(direction.as_ref()));
            // On the axis every turn leads away; opposite to it any turn leads back, one is taken.
            let towards = match sine > CONE_AXIS_SINE {
                true => cross / sine,
                false => crate::chain::axis_onto_z(&Unit::new_normalize(carried)).column(0).into(),
            };
            for (out, c) in out.iter_mut().zip(columns) {
                *out = towards.dot(&Vector3::new(c[3], c[4], c[5]));
            }
            half_angle - angle
        }
    }
}
