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

use super::contact::ContactWatch;
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{Scratch, Task, TaskKind};
use crate::path::{
    Event, EventKind, Path, Plan, PlanBuilder, TimedPath, TimingSettings, Trajectory, broken_limits,
    times_within_limits,
};
use crate::pose::Pose;
use crate::scene::{Proximity, Surroundings};
use crate::status::Status;
use crate::tolerance::{FREE_SPEED, LIMIT_SLACK, TRACK_ORIENTATION, TRACK_POSITION};
use crate::velocity::{ActiveLimit, Damping, Gain, ProjectedGradient, Resolver, StepInput};
use crate::watch::{Interrupted, Watch};

/// Share of the velocity limits that a path without times may use: the rest is left to the freedom.
const TIMING_SHARE: f64 = 0.5;

/// How a path is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackSettings {
    /// Length of a step, s.
    pub dt: f64,
    /// Gain of the task error, 1/s.
    pub feedback: f64,
    /// Largest distance (m) from the path that is still on it.
    pub position_tolerance: f64,
    /// Largest angle (rad) from the path that is still on it.
    pub orientation_tolerance: f64,
}

impl TrackSettings {
    /// Steps of `dt` seconds with a feedback in 1/s, and the usual tolerances.
    pub fn new(dt: f64, feedback: f64) -> Self {
        Self { dt, feedback, position_tolerance: TRACK_POSITION, orientation_tolerance: TRACK_ORIENTATION }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// dt that is not positive, a negative feedback, or one for which `feedback dt` is 2 or more, tolerances that are
    /// not positive.
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
        let tolerances = [
            ("position_tolerance", self.position_tolerance),
            ("orientation_tolerance", self.orientation_tolerance),
        ];
        match tolerances.into_iter().find(|(_, tolerance)| tolerance.is_nan() || *tolerance <= 0.0) {
            Some((what, tolerance)) => error(what, tolerance, "> 0".into()),
            None => Ok(()),
        }
    }
}

/// Most steps of one run: ten million rows are a gigabyte.
const MOST_STEPS: f64 = 1e7;

/// Steps between two reports of the progress: some milliseconds.
const REPORT_ROWS: usize = 4_096;

/// What became of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// One row every dt, from the first to the last time of the path. `Converged`; `OffPath` where it is farther from the
    /// path than the tolerances; `Limits` where a joint breaks a position or speed limit; `Cancelled` or `TimeLimit` with
    /// the rows so far.
    pub plan: Plan,
    /// Largest distance between the tool and the path, m, of the coordinates that count.
    pub position_error: f64,
    /// Largest angle between them, rad.
    pub orientation_error: f64,
}

impl From<Track> for Plan {
    fn from(track: Track) -> Self {
        track.plan
    }
}

/// Follows `path` from `q0` with a copy of `resolver`.
///
/// A path without times is timed first: the least joint motion along it may use half of the velocity limits.
///
/// # Errors
/// Invalid settings; a dt that is longer than the path lasts; a wrong q0; a path of positions for a task that needs an
/// orientation; more than 10 million steps; what the resolver refuses; positions that overflow.
pub fn track(
    resolver: &dyn Resolver,
    path: &Path,
    q0: &[f64],
    settings: &TrackSettings,
    watch: &Watch,
) -> Result<Track> {
    track_beside(resolver, path, q0, settings, resolver.surroundings(), watch)
}

/// [`track`], with distances from what is around: each row has its clearance, contact in the rows or between them is an event,
/// and the status is `collision`. [`track`] takes the surroundings of a scheme that has some.
///
/// # Errors
/// As of [`track`], and surroundings of another arm.
pub fn track_beside(
    resolver: &dyn Resolver,
    path: &Path,
    q0: &[f64],
    settings: &TrackSettings,
    around: Option<&Surroundings>,
    watch: &Watch,
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
    let (first, rows) = (timed.span().0, row_count(&timed, settings)?);
    if let Some(other) = around.filter(|around| around.chain() != &chain) {
        let (other, own) = (other.chain().name(), chain.name());
        return Err(Error::Invalid(format!("the surroundings are those of '{other}', not of '{own}'")));
    }
    let mut contact = around.map(ContactWatch::new);
    let mut run = TrackRows::new(&chain, rows);
    let mut now = q0.to_vec();
    let (mut speed, mut before) = (vec![0.0; chain.dof()], vec![0.0; chain.dof()]);
    let mut scratch = Scratch::new(&chain);
    let mut given = [0.0; 6];
    let mut interrupted = None;
    for row in 0..rows {
        if row % REPORT_ROWS == 0
            && let Err(why) = watch.report(row as f64 / rows as f64)
        {
            interrupted = Some(why);
            break;
        }
        let time = first + row as f64 * settings.dt;
        let reference = timed.at(time)?;
        let kinematics = chain.kinematics(&now, &mut scratch)?;
        let error = task.error(&reference.pose, kinematics.pose());
        let wanted =
            task.from_twist(kinematics.pose(), &reference.twist) + error.coordinates * settings.feedback;
        let velocity = caller_coordinates(&task, kinematics.pose(), &wanted, &mut given);
        let input = StepInput { q: &now, velocity, dt: Some(settings.dt), qd: Some(&before), wish: None };
        resolver.set_time(time);
        let report = resolver.step(&input, &mut speed)?;
        run.log.at(row, time, reference.s);
        if let Some(message) = contact.as_mut().and_then(|contact| contact.see(&now, time)) {
            run.log.push(EventKind::Contact, message);
        }
        run.log.step(&report, &*resolver);
        run.log.position_limits(&chain, &now);
        run.position.see(error.position, row);
        run.orientation.see(error.orientation, row);
        run.push(time, &now, &speed, kinematics.pose());
        now.iter_mut().zip(&speed).for_each(|(q, qd)| *q += settings.dt * qd);
        before.copy_from_slice(&speed);
    }
    run.finish(&chain, path, settings, interrupted, contact)
}

/// Number of rows along a path with times.
fn row_count(timed: &TimedPath, settings: &TrackSettings) -> Result<usize> {
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
    Ok(steps as usize + 1)
}

/// A largest value and its row.
#[derive(Debug, Clone, Copy, Default)]
struct Largest {
    value: f64,
    row: usize,
}

impl Largest {
    fn see(&mut self, value: f64, row: usize) {
        if value > self.value {
            *self = Self { value, row };
        }
    }
}

/// The rows of a run so far.
struct TrackRows {
    t: Vec<f64>,
    s: Vec<f64>,
    q: Vec<f64>,
    qd: Vec<f64>,
    poses: Vec<Pose>,
    log: EventLog,
    position: Largest,
    orientation: Largest,
}

impl TrackRows {
    fn new(chain: &Chain, rows: usize) -> Self {
        let n = chain.dof();
        Self {
            t: Vec::with_capacity(rows),
            s: Vec::with_capacity(rows),
            q: Vec::with_capacity(rows * n),
            qd: Vec::with_capacity(rows * n),
            poses: Vec::with_capacity(rows),
            log: EventLog::new(chain.joints().iter().map(|j| j.name.clone()).collect()),
            position: Largest::default(),
            orientation: Largest::default(),
        }
    }

    fn push(&mut self, time: f64, q: &[f64], qd: &[f64], pose: &Pose) {
        self.t.push(time);
        self.s.push(self.log.s);
        self.q.extend_from_slice(q);
        self.qd.extend_from_slice(qd);
        self.poses.push(*pose);
    }

    fn finish(
        self,
        chain: &Chain,
        path: &Path,
        settings: &TrackSettings,
        interrupted: Option<Interrupted>,
        contact: Option<ContactWatch<'_>>,
    ) -> Result<Track> {
        let astray = self.astray(settings);
        let cut = interrupted.map(|why| format!("{why} after {} rows", self.t.len()));
        let names = self.log.names;
        let trajectory = Trajectory::new(names, self.t, self.q, Some(self.qd), self.log.events)?;
        let broken = broken_limits(chain, &trajectory);
        let (position_error, orientation_error) = (self.position.value, self.orientation.value);
        let touched = contact.as_ref().and_then(|contact| contact.first.clone());
        let legal = astray.is_none() && broken.is_none() && touched.is_none();
        let status = match interrupted {
            Some(why) => why.status(),
            None if astray.is_some() => Status::OffPath,
            None if broken.is_some() => Status::Limits,
            None if touched.is_some() => Status::Collision,
            None => Status::Converged,
        };
        let reasons: Vec<String> = [cut, astray, broken, touched].into_iter().flatten().collect();
        let mut builder = PlanBuilder::new(trajectory, status);
        if let Some(contact) = contact {
            let column = |i: usize| contact.rows.iter().map(|row| row[i]).collect::<Vec<f64>>();
            // A kind of pair that is not checked is infinitely far away everywhere.
            for (i, values) in [column(0), column(1)].into_iter().enumerate() {
                if values.iter().any(|d| d.is_finite()) {
                    builder = if i == 0 { builder.clearance(values) } else { builder.self_clearance(values) };
                }
            }
        }
        let plan = builder
            .reason(reasons.join("; "))
            .asking_about_units(chain, path)
            .legal(legal)
            .proven(status == Status::Converged)
            .s(self.s)
            .poses(self.poses)
            .margin_of(chain)?
            .build()?;
        Ok(Track { plan, position_error, orientation_error })
    }

    /// How far and where the tool strays from the path by more than the tolerances.
    fn astray(&self, settings: &TrackSettings) -> Option<String> {
        let of = |what: &str, largest: Largest, tolerance: f64, unit: &str| {
            let Largest { value, row } = largest;
            let (t, far) = (self.t.get(row)?, value > tolerance);
            far.then(|| {
                format!(
                    "the largest {what} error is {value:.3e} {unit} at row {row} (t = {t:.3} s), at most {tolerance} \
                     {unit} is on the path"
                )
            })
        };
        let position = of("position", self.position, settings.position_tolerance, "m");
        let orientation = of("orientation", self.orientation, settings.orientation_tolerance, "rad");
        let both: Vec<String> = position.into_iter().chain(orientation).collect();
        (!both.is_empty()).then(|| both.join("; "))
    }
}

/// A velocity in task coordinates as [`Task::velocity`] takes it.
fn caller_coordinates<'a>(
    task: &Task,
    pose: &Pose,
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
            least.step(&StepInput { q: &now, velocity, dt: None, qd: None, wish: None }, &mut qd)?;
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
struct EventLog {
    names: Vec<String>,
    events: Vec<Event>,
    row: usize,
    t: f64,
    s: f64,
    damped: bool,
    singular: bool,
    algorithmic: bool,
    scaled: bool,
    bounded: bool,
    active: Vec<ActiveLimit>,
    beyond: Vec<bool>,
}

impl EventLog {
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
            bounded: false,
            active: Vec::new(),
        }
    }

    fn at(&mut self, row: usize, t: f64, s: f64) {
        (self.row, self.t, self.s) = (row, t, s);
    }

    fn push(&mut self, kind: EventKind, message: String) {
        self.events.push(Event { kind, index: self.row, t: self.t, s: self.s, message });
    }

    fn step(&mut self, report: &crate::velocity::Step, resolver: &dyn Resolver) {
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
            let message = "the condition for the optimum has lost rank".into();
            self.push(EventKind::AlgorithmicSingularity, message);
        }
        let scaled = report.scale < 1.0;
        if scaled && !self.scaled {
            self.push(EventKind::Scaled, format!("the task velocity is scaled by {:.4}", report.scale));
        }
        let bound = resolver.speed_bound();
        if let Some(bound) = bound.filter(|_| !self.bounded) {
            let message = format!(
                "the null-space motion is scaled by {:.3}: joint '{}' would exceed {:.3} per s{}",
                bound.scale,
                self.names[bound.joint],
                bound.speed,
                if report.algorithmic { " at an algorithmic singularity" } else { "" }
            );
            self.push(EventKind::SpeedBounded, message);
        }
        self.bounded = bound.is_some();
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

    fn position_limits(&mut self, chain: &Chain, q: &[f64]) {
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
