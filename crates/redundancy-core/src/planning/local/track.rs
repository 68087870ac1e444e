//! Following a path in closed loop with a velocity scheme.
//!
//! Every dt the scheme gets the velocity of the path plus the error of the tool, so that what linearisation loses is
//! won back [Bettini2000, section 4.2]:
//!
//! ```text
//! v = v_path(t) + feedback * error(path(t), f(q))          q <- q + dt qd
//! ```
//!
//! Orientation errors are taken along the shortest arc; in `pose_rpy` they are differences of the angles, as in the
//! paper. With `feedback * dt` at most 1 the error decays; from 2 on it grows, which is refused.

use crate::error::{Error, Result};
use crate::kinematics::{Scratch, Task, TaskKind};
use crate::path::{Event, EventKind, Path, TimedPath, TimingSettings, Trajectory, times_within_limits};
use crate::status::Status;
use crate::tolerance::{FREE_SPEED, LIMIT_SLACK};
use crate::velocity::{ActiveLimit, Damping, Gain, ProjectedGradient, Resolver, StepInput};

/// Share of the velocity limits that a path without times may use: the rest is left to the freedom.
const TIMING_SHARE: f64 = 0.5;

/// How a path is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackSettings {
    /// Length of a step, s.
    pub dt: f64,
    /// Gain of the task error, 1/s.
    pub feedback: f64,
    /// Steps after which the monitor is asked whether to go on.
    pub block: usize,
}

impl TrackSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// dt that is not positive, a negative feedback, or one for which `feedback dt` is 2 or more.
    pub fn validate(&self) -> Result<()> {
        let error =
            |what: &str, value, bound: String| Err(Error::OutOfRange { what: what.into(), value, bound });
        if !(self.dt.is_finite() && self.dt > 0.0) {
            return error("dt", self.dt, "finite and > 0".into());
        }
        if !(self.feedback >= 0.0 && self.feedback * self.dt < 2.0) {
            let bound =
                format!(">= 0 and < 2 / dt = {} (else the error grows from step to step)", 2.0 / self.dt);
            return error("feedback", self.feedback, bound);
        }
        Ok(())
    }
}

/// Most steps of one run: ten million rows are a gigabyte.
const MOST_STEPS: f64 = 1e7;

/// What became of a run.
#[derive(Debug, Clone)]
pub struct Track {
    /// One row every dt, from the first to the last time of the path.
    pub trajectory: Trajectory,
    /// Largest distance between the tool and the path, m, of the coordinates that count.
    pub position_error: f64,
    /// Largest angle between them, rad.
    pub orientation_error: f64,
    /// `converged`, or `cancelled`.
    pub status: Status,
}

/// Follows `path` from `q0` with a copy of `resolver`. `go_on` is asked now and then with the share that is done.
///
/// A path without times is timed first: the least joint motion along it may use half of the velocity limits.
///
/// # Errors
/// Invalid settings; a dt that is longer than the path lasts; a wrong q0; a path of positions for a task that needs an orientation; more than 10 million steps;
/// what the resolver refuses; positions that overflow.
pub fn track(
    resolver: &dyn Resolver,
    path: &Path,
    q0: &[f64],
    settings: &TrackSettings,
    go_on: &mut dyn FnMut(f64) -> bool,
) -> Result<Track> {
    settings.validate()?;
    let mut resolver = resolver.boxed();
    let (chain, task) = (resolver.chain().clone(), *resolver.task());
    chain.check_q(q0)?;
    let needs_orientation = !matches!(task.kind(), TaskKind::Position | TaskKind::Planar);
    if needs_orientation && !path.has_orientation() {
        let message = format!("the path has positions only, task '{task}' needs orientations too");
        return Err(Error::Invalid(message));
    }
    let timed = match path.t() {
        Some(_) => TimedPath::new(path)?,
        None => TimedPath::new(&path.with_times(Some(&times_for(&*resolver, path, q0)?))?)?,
    };
    let (first, last) = timed.span();
    if last > first && settings.dt > last - first {
        let bound = format!("<= {} s, the duration of the path", last - first);
        return Err(Error::OutOfRange { what: "dt".into(), value: settings.dt, bound });
    }
    let steps = ((last - first) / settings.dt + 1e-9).floor();
    if steps > MOST_STEPS {
        let bound = format!(">= {} (at most 10 million steps)", (last - first) / MOST_STEPS);
        return Err(Error::OutOfRange { what: "dt".into(), value: settings.dt, bound });
    }
    let rows = steps as usize + 1;
    let n = chain.dof();
    let (mut t, mut q, mut qd) = (Vec::with_capacity(rows), Vec::new(), Vec::new());
    q.reserve(rows * n);
    qd.reserve(rows * n);
    let mut now = q0.to_vec();
    let (mut speed, mut before) = (vec![0.0; n], vec![0.0; n]);
    let mut scratch = Scratch::new(&chain);
    let mut log = Log::new(chain.joints().iter().map(|j| j.name.clone()).collect());
    let (mut position_error, mut orientation_error) = (0.0_f64, 0.0_f64);
    let mut status = Status::Converged;
    let mut given = [0.0; 6];
    for row in 0..rows {
        if row % settings.block.max(1) == 0 && !go_on(row as f64 / rows as f64) {
            status = Status::Cancelled;
            break;
        }
        let time = first + row as f64 * settings.dt;
        let reference = timed.at(time)?;
        let kinematics = chain.kinematics(&now, &mut scratch)?;
        let error = task.error(&reference.pose, kinematics.pose());
        position_error = position_error.max(error.position);
        orientation_error = orientation_error.max(error.orientation);
        let wanted =
            task.from_twist(kinematics.pose(), &reference.twist) + error.coordinates * settings.feedback;
        let velocity = caller_coordinates(&task, kinematics.pose(), &wanted, &mut given);
        let input = StepInput { q: &now, velocity, dt: Some(settings.dt), qd: Some(&before) };
        let report = resolver.step(&input, &mut speed)?;
        log.at(row, time, reference.s);
        log.step(&report, &*resolver);
        log.position_limits(&chain, &now);
        t.push(time);
        q.extend_from_slice(&now);
        qd.extend_from_slice(&speed);
        now.iter_mut().zip(&speed).for_each(|(q, qd)| *q += settings.dt * qd);
        before.copy_from_slice(&speed);
    }
    let names = chain.joints().iter().map(|j| j.name.clone()).collect();
    let trajectory = Trajectory::new(names, t, q, Some(qd), log.events)?;
    Ok(Track { trajectory, position_error, orientation_error, status })
}

/// A velocity in task coordinates as [`Task::velocity`] takes it.
fn caller_coordinates<'a>(
    task: &Task,
    pose: &crate::Pose,
    wanted: &nalgebra::Vector6<f64>,
    out: &'a mut [f64; 6],
) -> &'a [f64] {
    out.copy_from_slice(wanted.as_slice());
    if task.kind() == TaskKind::Pointing {
        let [u, w] = task.across(pose);
        let angular = u * wanted[3] + w * wanted[4];
        out[3..].copy_from_slice(angular.as_slice());
    }
    &out[..task.velocity_len()]
}

/// Times for a path that has none: along the least joint motion from `q0`.
fn times_for(resolver: &dyn Resolver, path: &Path, q0: &[f64]) -> Result<Vec<f64>> {
    let (chain, task) = (resolver.chain(), *resolver.task());
    let mut least = ProjectedGradient::new(chain, None, Gain::Constant(0.0), task, Some(Damping::default()))?;
    let mut scratch = Scratch::new(chain);
    let (mut now, mut qd, mut given) = (q0.to_vec(), vec![0.0; chain.dof()], [0.0; 6]);
    let mut rows = Vec::with_capacity(path.len() * chain.dof());
    for (i, pose) in path.poses().iter().enumerate() {
        // The first pose may be some way off; from one sample to the next one step is nearly enough.
        for _ in 0..if i == 0 { 20 } else { 3 } {
            let kinematics = chain.kinematics(&now, &mut scratch)?;
            let error = task.error(pose, kinematics.pose());
            let velocity = caller_coordinates(&task, kinematics.pose(), &error.coordinates, &mut given);
            least.step(&StepInput { q: &now, velocity, dt: None, qd: None }, &mut qd)?;
            now.iter_mut().zip(&qd).for_each(|(q, qd)| *q += qd);
        }
        rows.extend_from_slice(&now);
    }
    let limits: Vec<f64> = chain
        .joints()
        .iter()
        .map(|j| if j.limits.velocity.is_finite() { j.limits.velocity } else { FREE_SPEED })
        .collect();
    times_within_limits(
        &rows,
        &limits,
        TimingSettings { velocity_fraction: TIMING_SHARE, ..Default::default() },
    )
}

/// Events: what begins, not what lasts.
#[derive(Debug)]
struct Log {
    names: Vec<String>,
    events: Vec<Event>,
    row: usize,
    t: f64,
    s: f64,
    damped: bool,
    singular: bool,
    algorithmic: bool,
    scaled: bool,
    active: Vec<ActiveLimit>,
    beyond: Vec<bool>,
}

impl Log {
    fn new(names: Vec<String>) -> Self {
        Self {
            beyond: vec![false; names.len()],
            names,
            events: Vec::new(),
            row: 0,
            t: 0.0,
            s: 0.0,
            damped: false,
            singular: false,
            algorithmic: false,
            scaled: false,
            active: Vec::new(),
        }
    }

    fn at(&mut self, row: usize, t: f64, s: f64) {
        (self.row, self.t, self.s) = (row, t, s);
    }

    fn push(&mut self, kind: EventKind, message: String) {
        self.events.push(Event { kind, index: self.row, t: self.t, s: self.s, message });
    }

    fn step(&mut self, report: &crate::velocity::StepReport, resolver: &dyn Resolver) {
        if report.basis_changed {
            self.push(EventKind::BasisChange, format!("dependent joints are now {:?}", resolver.basis()));
        }
        let damped = report.damping > 0.0;
        if damped && !self.damped {
            let message = format!(
                "damping begins, lambda {:.3e}, the task is missed by {:.3e}",
                report.damping, report.residual
            );
            self.push(EventKind::Damping, message);
        }
        let singular = report.status == Status::Singular && !report.algorithmic && !damped;
        if singular && !self.singular {
            self.push(EventKind::KinematicSingularity, "the Jacobian has lost rank".into());
        }
        if report.algorithmic && !self.algorithmic {
            let message = "the condition of the optimum has lost rank".into();
            self.push(EventKind::AlgorithmicSingularity, message);
        }
        let scaled = report.scale < 1.0;
        if scaled && !self.scaled {
            self.push(EventKind::Scaled, format!("the task is slowed down to {:.4}", report.scale));
        }
        for limit in resolver.active_limits() {
            if !self.active.contains(limit) {
                let side = if limit.upper { "upper" } else { "lower" };
                let name = &self.names[limit.joint];
                let message =
                    format!("joint '{name}' is held back by its {side} {} limit", limit.kind.as_str());
                self.push(EventKind::Limit, message);
            }
        }
        self.active.clear();
        self.active.extend_from_slice(resolver.active_limits());
        (self.damped, self.singular) = (damped, singular);
        (self.algorithmic, self.scaled) = (report.algorithmic, scaled);
    }

    fn position_limits(&mut self, chain: &crate::chain::Chain, q: &[f64]) {
        for (i, (lower, upper)) in chain.lower().iter().zip(chain.upper()).enumerate() {
            let excess = (q[i] - upper).max(lower - q[i]);
            let beyond = excess > LIMIT_SLACK;
            if beyond && !self.beyond[i] {
                let message =
                    format!("joint '{}' is at {}, beyond its limits [{lower}, {upper}]", self.names[i], q[i]);
                self.push(EventKind::JointLimit, message);
            }
            self.beyond[i] = beyond;
        }
    }
}
