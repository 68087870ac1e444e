//! The swivel as a dynamical system: one step at a time, for poses that are not known in advance.
//!
//! # The paper's form
//! `tau s' = lambda tanh(s_des - s) + (1 - lambda) F_obst` [Moore2010, eqs (30)-(32)]. `F_obst` has the sign of
//! `d(s + eps) - d(s - eps)` and the size `k / |d|`, with d the distance from the obstacles. It is kept as printed for
//! comparison: the force is weak deep inside an obstacle, its sign chatters, tanh does not take into account that s is an angle,
//! joint limits and the obstacle's own motion are not considered, and the swivel can get trapped.
//!
//! # The robust form
//! ```text
//! tau s' = l1 sin(s_des - s) + l2 F_obst + l3 F_singl + l4 F_limits,     |s'| <= max_rate
//! F_obst = (dd/ds / |dd/ds|) ((d_act - d) / (d_act - d_safe))^2  for d < d_act, smooth at dd/ds = 0
//! ```
//! and the two other forces push along the slope of the sines of the gimbals and of the distance from the joint limits.
//! `dd/ds = grad d . mu rho w'(s)` is analytic (mu: position of the nearest point along the link). If the previous rate is
//! given, the new one is smoothed, and the swivel does not reverse for a negligible gain, nor, beside an obstacle, for a sum that
//! is small against `l2 F_obst`: the balance of desired swivel and obstacle oscillates along the path, and following all of
//! that gains nothing. A barrier then requires `dd/ds s' + dd/dt >= -gamma (d - d_safe)`, where dd/dt is the obstacle's own motion.
//! The configuration after the step is checked: if it is too near to an obstacle, the nearest swivel within the rate limit that
//! keeps the distance is taken, or the one that keeps most of it; if it violates a joint limit, the step ends before it.
//!
//! It still decides locally: it can reach a dead end that can be avoided only by passing the obstacle on the other side.
//! [`plan_swivel`](super::plan_swivel) considers the whole path.

use std::f64::consts::PI;

use crate::error::{Error, Result, check_finite};
use crate::joint_space::nearest;
use crate::path::{Event, EventKind, Path, Plan, Trajectory};
use crate::planning::layers::srs::clearance::{ArmClearance, Around, Now, Rates};
use crate::planning::layers::srs::explain::swivel_plan;
use crate::pose::Pose;
use crate::scene::{LinkGeometry, Proximity, Scene};
use crate::solutions::{SelfMotion, SrsArm};
use crate::status::Status;
use crate::tolerance::{
    BARRIER_SLOPE, FLOW_FRICTION, FLOW_SLOPE, FLOW_SMOOTHING, FLOW_TURN, JOINT_JUMP, SPEED_ROUNDING,
};
use crate::watch::{Interrupted, Watch};

/// Which dynamical system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FlowForm {
    /// The paper's, on the angle s.
    Paper,
    /// The paper's, on the swivel quaternion u: differences by rotation, the error is the angle between two vectors.
    PaperU,
    /// With limits, barrier and rate limit.
    #[default]
    Robust,
}

impl FlowForm {
    /// Every form.
    pub const ALL: [Self; 3] = [Self::Paper, Self::PaperU, Self::Robust];

    /// The form as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::PaperU => "paper_u",
            Self::Robust => "robust",
        }
    }

    /// The form with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|form| form.as_str() == name).ok_or_else(|| {
            let valid = Self::ALL.iter().map(|form| form.as_str().to_owned()).collect();
            Error::UnknownName { kind: "form", name: name.into(), valid }
        })
    }
}

/// Settings of [`SwivelFlow`].
#[derive(Debug, Clone, PartialEq)]
pub struct SwivelFlowSettings {
    /// Which dynamical system.
    pub form: FlowForm,
    /// Radius of the links, m, where no shapes are given.
    pub link_radius: f64,
    /// Shapes of the links; `None`: capsules from joint to joint.
    pub links: Option<LinkGeometry>,
    /// Links must not touch each other: the pairs of `links`, of capsules those that are found.
    pub self_collision: bool,
    /// Time constant, s.
    pub tau: f64,
    /// Share of the desired swivel in the paper's form; the obstacle has the rest.
    pub lambda: f64,
    /// The paper's k: force at one metre.
    pub gain: f64,
    /// The paper's epsilon: half the difference step, rad.
    pub epsilon: f64,
    /// Robust form: shares of desired swivel, obstacle, singularity and limits; they add up to one.
    pub weights: [f64; 4],
    /// Robust form: largest rate, rad/s.
    pub max_rate: f64,
    /// Robust form: distance that is kept, m.
    pub safe_distance: f64,
    /// Robust form: distance at which the obstacle's force begins, m.
    pub active_distance: f64,
    /// Robust form: how fast the barrier lets the distance shrink, 1/s.
    pub barrier_rate: f64,
    /// Branch, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub branch: usize,
}

impl Default for SwivelFlowSettings {
    fn default() -> Self {
        Self {
            form: FlowForm::Robust,
            link_radius: 0.05,
            links: None,
            self_collision: false,
            tau: 0.1,
            lambda: 0.5,
            gain: 0.02,
            epsilon: 0.001,
            weights: [0.4, 0.4, 0.05, 0.15],
            max_rate: 3.0,
            safe_distance: 0.02,
            active_distance: 0.1,
            barrier_rate: 5.0,
            branch: 0,
        }
    }
}

impl SwivelFlowSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// A number out of its range; the message names it and the bound.
    pub fn validate(&self) -> Result<()> {
        let out = |what: &str, value: f64, bound: &str| {
            Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() })
        };
        for (what, value) in [
            ("tau", self.tau),
            ("epsilon", self.epsilon),
            ("max_rate", self.max_rate),
            ("barrier_rate", self.barrier_rate),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return out(what, value, "> 0 and finite");
            }
        }
        for (what, value) in
            [("link_radius", self.link_radius), ("gain", self.gain), ("safe_distance", self.safe_distance)]
        {
            if !(value >= 0.0 && value.is_finite()) {
                return out(what, value, ">= 0 and finite");
            }
        }
        if !(0.0..=1.0).contains(&self.lambda) {
            return out("lambda", self.lambda, "between 0 and 1");
        }
        if !(self.active_distance > self.safe_distance && self.active_distance.is_finite()) {
            return out("active_distance", self.active_distance, "above safe_distance");
        }
        check_finite("weights", &self.weights)?;
        let sum: f64 = self.weights.iter().sum();
        if self.weights.iter().any(|w| *w < 0.0) || (sum - 1.0).abs() > 1e-9 {
            return out("sum of the weights", sum, "1, each weight >= 0");
        }
        if self.branch > 7 {
            return out("branch index", self.branch as f64, "<= 7");
        }
        Ok(())
    }
}

/// The swivel as a dynamical system beside obstacles.
///
/// ```
/// use redundancy_core::{Pose, chain::catalog, nalgebra::Vector3, scene::{Scene, Sphere}, solutions::SrsArm};
/// use redundancy_core::planning::{FlowState, SwivelFlow, SwivelFlowSettings};
/// let arm = SrsArm::new(&catalog::load("pa10")?)?;
/// let ball = Sphere { center: Vector3::new(0.28, -0.35, 0.48), radius: 0.06 };
/// let flow = SwivelFlow::new(&arm, &Scene::new(&[ball.into()])?, SwivelFlowSettings::default())?;
/// let step = flow.step(&Pose::translation(0.45, 0.0, 0.5), 0.0, -1.0, 0.01, 0.0, &FlowState::default())?;
/// assert!(step.swivel < 0.0 && step.swivel > -0.031); // towards the desired swivel, at most 3 rad/s
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SwivelFlow {
    arm: SrsArm,
    scene: Scene,
    near: ArmClearance,
    settings: SwivelFlowSettings,
}

/// What is known of the step before. Both may be left out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FlowState {
    /// The joints: the robust form then holds their speed limits too where it can, and windings go on.
    pub q: Option<[f64; 7]>,
    /// The rate of the swivel, rad/s ([`FlowStep::rate`]): the robust form then continues smoothly.
    pub rate: Option<f64>,
}

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowStep {
    /// The new swivel, rad, not wrapped.
    pub swivel: f64,
    /// Its rate, rad/s. Standing still it is half the one before: so the sense in which it turned last is not forgotten.
    pub rate: f64,
    /// Distance from the obstacles at the new swivel, m.
    pub distance: f64,
    /// The configuration, with windings that hold the limits where there are such.
    pub q: [f64; 7],
    /// Whether it holds the joint limits.
    pub within_limits: bool,
    /// Whether the barrier or a limit changed the step.
    pub corrected: bool,
}

/// Swivels that are checked within the rate limit when the step comes too near to an obstacle or breaks a limit.
const LOOK_AROUND: usize = 32;

/// Halvings of the way from there back to the desired step.
const BISECTIONS: usize = 8;

impl SwivelFlow {
    /// For an arm beside a scene.
    ///
    /// # Errors
    /// Invalid settings.
    pub fn new(arm: &SrsArm, scene: &Scene, settings: SwivelFlowSettings) -> Result<Self> {
        settings.validate()?;
        let around = Around {
            links: settings.links.as_ref(),
            link_radius: settings.link_radius,
            scene: Some(scene),
            self_collision: settings.self_collision,
        };
        let near = ArmClearance::new(arm, &around)?;
        Ok(Self { arm: arm.clone(), scene: scene.clone(), near, settings })
    }

    /// The arm.
    pub fn arm(&self) -> &SrsArm {
        &self.arm
    }

    /// The scene at time 0.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Its settings.
    pub fn settings(&self) -> &SwivelFlowSettings {
        &self.settings
    }

    /// The swivel at `pose` after `dt`, from the swivel `s` before. `t` is the time at `pose`: obstacles that move are
    /// where they are then; `before` is what is known of the step before.
    ///
    /// # Errors
    /// A pose that is not rigid or out of reach, numbers that are not finite, `dt <= 0`.
    pub fn step(
        &self,
        pose: &Pose,
        s: f64,
        desired: f64,
        dt: f64,
        t: f64,
        before: &FlowState,
    ) -> Result<FlowStep> {
        check_finite("s, desired, dt, t", &[s, desired, dt, t])?;
        check_finite("joints before", before.q.as_ref().map_or(&[], |q| q))?;
        check_finite("rate before", before.rate.as_slice())?;
        if dt <= 0.0 {
            return Err(Error::OutOfRange { what: "dt".into(), value: dt, bound: "> 0 s".into() });
        }
        let motion = self.arm.self_motion(pose)?;
        if !motion.in_reach() {
            let question = self.question(pose);
            return Err(Error::Invalid(format!("no swivel for this pose: {}{question}", motion.reason())));
        }
        let here = FlowPose::new(self, &motion, pose, t, before.q.map(|q| (q, dt)), before.rate);
        Ok(match self.settings.form {
            FlowForm::Robust => here.robust(s, desired, dt),
            form => here.paper(s, desired, dt, form),
        })
    }

    /// Along a path with times, one row every `dt` and one at its end, from the swivel `s0`. `desired` has one angle, or
    /// one for every row ([`SwivelFlow::times`]).
    ///
    /// `Converged`; `Limits` where a row breaks a joint position limit; `Infeasible` where it touches an obstacle or a
    /// joint exceeds its speed limit (an event names the row); `Collision` where the path itself forces contact; `Cancelled` or
    /// `TimeLimit` with the rows so far.
    ///
    /// # Errors
    /// A path without times or orientations, or of one point; `dt <= 0`; a point out of reach; a wrong number of angles.
    pub fn follow(&self, path: &Path, s0: f64, dt: f64, desired: &[f64], watch: &Watch) -> Result<Plan> {
        check_finite("s0", &[s0])?;
        let times = Self::times(path, dt)?;
        if desired.len() != 1 {
            crate::error::check_length("desired", desired, times.len())?;
        }
        check_finite("desired", desired)?;
        let mut run = FlowRows::default();
        let mut interrupted = None;
        for (k, t) in times.iter().enumerate() {
            let wish = desired.get(k).or(desired.first()).copied().unwrap_or(0.0);
            let before = (k > 0).then(|| times[k - 1]);
            self.follow_row(path, (*t, before), s0, wish, &mut run)?;
            if k % REPORT_ROWS == 0
                && let Err(why) = watch.report(k as f64 / times.len() as f64)
            {
                interrupted = Some(why);
                break;
            }
        }
        self.plan_of(run, times, interrupted)
    }

    /// One more row of [`SwivelFlow::follow`] at time `t`; `before` is the time of the last one.
    fn follow_row(
        &self,
        path: &Path,
        (t, before): (f64, Option<f64>),
        s0: f64,
        wish: f64,
        run: &mut FlowRows,
    ) -> Result<()> {
        let at = arc_length_at(path, t);
        let pose = path.at(at)?.pose;
        let motion = self.arm.self_motion(&pose)?;
        if !motion.in_reach() {
            let question = self.question(&pose);
            return Err(Error::Invalid(format!("t = {t} s: {}{question}", motion.reason())));
        }
        let gap = before.map(|before| t - before);
        let here = FlowPose::new(self, &motion, &pose, t, run.q.last().copied().zip(gap), run.rate);
        let step = match (gap, run.swivel.last(), self.settings.form) {
            (Some(dt), Some(s), FlowForm::Robust) => here.robust(*s, wish, dt),
            (Some(dt), Some(s), form) => here.paper(*s, wish, dt, form),
            _ => here.result(s0, 0.0, false),
        };
        let row = run.q.len();
        run.rate = gap.map(|_| step.rate);
        if let Some((before, gap)) = here.before {
            let (used, joint) = self.speed(&step.q, &before, gap);
            if used > 1.0 + SPEED_ROUNDING && run.fastest.is_none_or(|fastest| used > fastest.used) {
                run.fastest = Some(FastStep { used, joint, row });
            }
        }
        if !step.within_limits && run.outside.is_none() {
            run.outside = Some(row);
            let message = format!(
                "no swivel that can be reached in one step is within the joint limits at t = {t:.3} s"
            );
            run.events.push(Event { kind: EventKind::JointLimit, index: row, t, s: at, message });
        }
        run.q.push(step.q);
        run.swivel.push(step.swivel);
        run.clearance.push(step.distance);
        run.s.push(at);
        run.poses.push(pose);
        Ok(())
    }

    /// The rows with their verdict.
    fn plan_of(
        &self,
        mut run: FlowRows,
        mut times: Vec<f64>,
        interrupted: Option<Interrupted>,
    ) -> Result<Plan> {
        let rows = run.q.len();
        times.truncate(rows);
        let mut faults = self.faults(&run, &times);
        let moved = faults.is_empty();
        faults.extend(self.forced_contact(&run.q, &times));
        let legal = faults.is_empty();
        if let Some(FastStep { used, joint, row }) = run.fastest {
            let name = &self.arm.chain().joints()[joint].name;
            let message = format!("joint '{name}' moves at {used:.2} times its speed limit");
            let (t, s) = (times[row], run.s[row]);
            run.events.push(Event { kind: EventKind::Limit, index: row, t, s, message });
            run.events.sort_by_key(|event| event.index);
        }
        let status = match interrupted {
            Some(why) => {
                faults.insert(0, format!("{why} after {rows} rows"));
                why.status()
            }
            None if legal => Status::Converged,
            None if moved => Status::Collision,
            None if run.outside.is_some() && run.clearance.iter().all(|d| *d >= 0.0) => Status::Limits,
            None => Status::Infeasible,
        };
        let names = self.arm.chain().joints().iter().map(|j| j.name.clone()).collect();
        let near: Vec<[f64; 2]> = run.q.iter().zip(&times).map(|(q, t)| self.near.row(q, *t)).collect();
        let [scene, own] = self.near.looks_at();
        let trajectory = Trajectory::new(names, times, run.q.into_flattened(), None, run.events)?;
        let mut builder = swivel_plan(trajectory, status, run.swivel, vec![self.settings.branch; rows])
            .reason(faults.join("; "))
            .legal(legal)
            .proven(status == Status::Converged)
            .s(run.s)
            .poses(run.poses);
        if scene {
            builder = builder.clearance(near.iter().map(|near| near[0]).collect());
        }
        if own {
            builder = builder.self_clearance(near.iter().map(|near| near[1]).collect());
        }
        builder.margin_of(self.arm.chain())?.build()
    }

    /// Times of the rows of [`SwivelFlow::follow`].
    ///
    /// # Errors
    /// As there.
    pub fn times(path: &Path, dt: f64) -> Result<Vec<f64>> {
        let bad = |message: &str| Err(Error::Invalid(message.into()));
        if !(dt > 0.0 && dt.is_finite()) {
            return Err(Error::OutOfRange { what: "dt".into(), value: dt, bound: "> 0 s and finite".into() });
        }
        if !path.has_orientation() {
            return bad("the path has positions only; the arm needs an orientation for each point");
        }
        let Some(t) = path.t() else {
            return bad("the path has no times; a flow needs them (Path.with_times)");
        };
        if t.len() < 2 {
            return bad("the path has one point; a flow needs at least two");
        }
        let (first, last) = (t[0], t[t.len() - 1]);
        let steps = ((last - first) / dt - 1e-9).ceil();
        if steps > MAX_ROWS {
            return Err(Error::OutOfRange {
                what: "number of steps".into(),
                value: steps,
                bound: format!("<= {MAX_ROWS}"),
            });
        }
        Ok((0..=steps as usize).map(|k| (first + k as f64 * dt).min(last)).collect())
    }

    /// The largest joint speed from one row to the next as a share of its limit, and the joint.
    fn speed(&self, q: &[f64; 7], before: &[f64; 7], gap: f64) -> (f64, usize) {
        let mut most = (0.0, 0);
        for (i, joint) in self.arm.chain().joints().iter().enumerate() {
            let step = (q[i] - before[i]).abs();
            // No limit: what counts as a jump.
            let used = step / (joint.limits.velocity * gap).min(JOINT_JUMP);
            if used > most.0 {
                most = (used, i);
            }
        }
        most
    }

    /// The first contact that the path forces: no swivel changes it.
    fn forced_contact(&self, q: &[[f64; 7]], times: &[f64]) -> Option<String> {
        if self.near.held.is_empty() {
            return None;
        }
        let touching = |(q, t): (&[f64; 7], &f64)| {
            self.near.nearest(q, *t)[1].filter(|near| near.gap.distance < 0.0).map(|near| (*t, near))
        };
        let (t, near) = q.iter().zip(times).find_map(touching)?;
        let (link, other) = (self.near.held.name(near.first), self.near.held.name(near.second));
        let depth = -1e3 * near.gap.distance;
        Some(format!(
            "the path itself brings link '{link}' {depth:.3} mm deep into '{other}' at t = {t:.3} s; no swivel changes that"
        ))
    }

    /// Asks about the unit of a pose that is far away.
    fn question(&self, pose: &Pose) -> String {
        let question = self.arm.chain().ask_about_millimetres([pose.translation.vector]);
        question.map_or_else(String::new, |question| format!("; {question}"))
    }

    /// What went wrong.
    fn faults(&self, run: &FlowRows, times: &[f64]) -> Vec<String> {
        let mut faults = Vec::new();
        if let Some(d) = run.clearance.first().filter(|d| **d < 0.0) {
            faults.push(format!("starts {:.3} mm inside an obstacle", -1e3 * d));
        }
        let worst = run.clearance.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        if let Some((k, d)) = worst.filter(|(_, d)| **d < 0.0) {
            faults.push(format!("is {:.3} mm inside an obstacle at t = {:.3} s", -1e3 * d, times[k]));
        }
        if let Some(k) = run.outside {
            faults.push(format!("leaves the joint limits at t = {:.3} s", times[k]));
        }
        if let Some(FastStep { used, joint, row }) = run.fastest {
            let name = &self.arm.chain().joints()[joint].name;
            let t = times[row];
            faults.push(format!("joint '{name}' moves at {used:.2} times its speed limit at t = {t:.3} s"));
        }
        faults
    }
}

/// A step with a joint above its speed limit: the share of the limit, the joint, the row at its end.
#[derive(Debug, Clone, Copy)]
struct FastStep {
    used: f64,
    joint: usize,
    row: usize,
}

/// The rows of [`SwivelFlow::follow`] so far.
#[derive(Debug, Default)]
struct FlowRows {
    q: Vec<[f64; 7]>,
    swivel: Vec<f64>,
    /// Distance of what the swivel moves.
    clearance: Vec<f64>,
    s: Vec<f64>,
    poses: Vec<Pose>,
    events: Vec<Event>,
    /// The rate of the last step, rad/s.
    rate: Option<f64>,
    /// The first row that breaks a joint limit.
    outside: Option<usize>,
    /// The step that exceeds a speed limit most.
    fastest: Option<FastStep>,
}

/// Rows between two reports of the progress.
const REPORT_ROWS: usize = 256;
/// Most rows of a flow: half a gigabyte.
const MAX_ROWS: f64 = 5e6;

/// A step over one pose.
struct FlowPose<'a> {
    flow: &'a SwivelFlow,
    motion: &'a SelfMotion,
    now: Now<'a>,
    /// The configuration before, and the time since then.
    before: Option<([f64; 7], f64)>,
    /// The rate before, rad/s.
    rate: Option<f64>,
}

/// What a swivel would be like.
#[derive(Clone, Copy)]
struct FlowCandidate {
    s: f64,
    distance: f64,
    q: [f64; 7],
    within_limits: bool,
    /// What must not be, the worst first: touching, leaving the limits, joints too fast.
    fault: u8,
    /// The largest joint speed as a share of its limit.
    used: f64,
}

impl<'a> FlowPose<'a> {
    fn new(
        flow: &'a SwivelFlow,
        motion: &'a SelfMotion,
        pose: &Pose,
        t: f64,
        before: Option<([f64; 7], f64)>,
        rate: Option<f64>,
    ) -> Self {
        Self { flow, motion, now: flow.near.now(pose, t), before, rate }
    }

    fn rates(&self, s: f64) -> Rates {
        let (sin, cos) = s.sin_cos();
        self.rates_at([cos, sin])
    }

    fn rates_at(&self, u: [f64; 2]) -> Rates {
        self.now.rates(self.motion, u, self.flow.settings.branch)
    }

    /// A configuration with the windings that go on from the one before, or are within the limits where there are such.
    fn wound(&self, q: &[f64; 7]) -> ([f64; 7], bool) {
        let arm = &self.flow.arm;
        let (q, within) = arm.within_limits_or_wound(q);
        match &self.before {
            Some((before, _)) => (unwound(&q, before, arm.chain().lower(), arm.chain().upper()), within),
            None => (q, within),
        }
    }

    /// `held`: the limits hold before the step; where they are broken already they are left to the force, so that it does
    /// not chatter.
    fn candidate(&self, s: f64, held: bool) -> FlowCandidate {
        let (sin, cos) = s.sin_cos();
        let distance = self.rates_at([cos, sin]).distance;
        let (q, within_limits) = self.wound(&self.motion.branch_at([cos, sin], self.flow.settings.branch));
        let used = self.before.map_or(0.0, |(before, gap)| self.flow.speed(&q, &before, gap).0);
        let fault = u8::from(distance < self.flow.settings.safe_distance) * 4
            + u8::from(held && !within_limits) * 2
            + u8::from(used > 1.0);
        FlowCandidate { s, distance, q, within_limits, fault, used }
    }

    fn result(&self, s: f64, rate: f64, corrected: bool) -> FlowStep {
        self.candidate(s, false).step(rate, corrected)
    }

    fn paper(&self, s: f64, desired: f64, dt: f64, form: FlowForm) -> FlowStep {
        let settings = &self.flow.settings;
        let (e, (sin, cos)) = (settings.epsilon, s.sin_cos());
        let (error, ahead, behind) = if form == FlowForm::PaperU {
            let (se, ce) = e.sin_cos();
            let (sd, cd) = desired.sin_cos();
            let error = (cos * sd - sin * cd).atan2(cos * cd + sin * sd);
            (
                error,
                self.rates_at([cos * ce - sin * se, sin * ce + cos * se]),
                self.rates_at([cos * ce + sin * se, sin * ce - cos * se]),
            )
        } else {
            (desired - s, self.rates(s + e), self.rates(s - e))
        };
        let here = self.rates_at([cos, sin]).distance;
        let slope = ahead.distance - behind.distance;
        let sign = if slope > 0.0 {
            1.0
        } else if slope < 0.0 {
            -1.0
        } else {
            0.0
        };
        // 1/|d| has no bound; at contact itself the force is that at a hair's breadth.
        let force = if here.is_finite() { sign * settings.gain / here.abs().max(f64::EPSILON) } else { 0.0 };
        let rate = (settings.lambda * error.tanh() + (1.0 - settings.lambda) * force) / settings.tau;
        // Explicit Euler as in the paper, but a step of more than half a turn is none.
        self.result(s + (rate * dt).clamp(-PI, PI), rate, false)
    }

    fn robust(&self, s: f64, desired: f64, dt: f64) -> FlowStep {
        let settings = &self.flow.settings;
        let (sin, cos) = s.sin_cos();
        let here = self.rates_at([cos, sin]);
        let (q, slopes) = self.motion.branch_with_rates([cos, sin], settings.branch);
        let (_, held) = self.wound(&q);
        let [wish, away, singular, limits] = settings.weights;
        let mut force = wish * (desired - s).sin();
        let mut stick = 0.0;
        if here.distance < settings.active_distance {
            let depth = (settings.active_distance - here.distance)
                / (settings.active_distance - settings.safe_distance);
            // Smooth where the slope changes sign.
            let direction =
                here.by_swivel / (here.by_swivel * here.by_swivel + FLOW_SLOPE * FLOW_SLOPE).sqrt();
            let push = away * direction * (depth * depth).min(4.0);
            force += push;
            stick = FLOW_FRICTION * push.abs();
        }
        let (gimbal, room) = self.flow.arm.gimbal_and_limit_slopes(&q, &slopes);
        force += singular * gimbal.tanh() - limits * room.tanh();
        let bounded = |rate: f64| rate.clamp(-settings.max_rate, settings.max_rate);
        let mut rate = bounded(force / settings.tau);
        if let Some(before) = self.rate {
            // Beside an obstacle it takes more than a small force to turn round.
            if force * before < 0.0 && force.abs() < stick {
                rate = 0.0;
            }
            rate = bounded(before + (rate - before) * dt / (dt + FLOW_SMOOTHING * settings.tau));
        }
        let mut corrected = false;
        // The barrier: how fast the distance may shrink.
        let floor = -settings.barrier_rate * (here.distance - settings.safe_distance) - here.by_time;
        if here.distance.is_finite() && here.by_swivel * rate < floor {
            // What is missing, along the slope; bounded where the slope changes sign.
            let slope = here.by_swivel;
            let missing = floor - slope * rate;
            rate = bounded(rate + missing * slope / (slope * slope + BARRIER_SLOPE * BARRIER_SLOPE));
            corrected = true;
        }
        let next = self.candidate(s + rate * dt, held);
        if next.fault == 0 {
            return self.unless_turning(next, s, dt, held, corrected);
        }
        // The nearest swivel within the rate limit with less to blame; too near to an obstacle, the one that is furthest;
        // too fast, the slowest.
        let reach = settings.max_rate * dt;
        let mut best = next;
        for i in 0..=LOOK_AROUND {
            let other = self.candidate(s + reach * (2.0 * i as f64 / LOOK_AROUND as f64 - 1.0), held);
            let better = match other.fault {
                fault if fault != best.fault => fault < best.fault,
                4.. => other.distance > best.distance,
                1 => other.used < best.used,
                _ => (other.s - next.s).abs() < (best.s - next.s).abs(),
            };
            if better {
                best = other;
            }
        }
        // Back towards the wish as far as nothing speaks against it.
        let mut wish = next.s;
        for _ in 0..BISECTIONS {
            if best.fault >= 4 || best.fault == 1 {
                break;
            }
            let middle = self.candidate(0.5 * (best.s + wish), held);
            if middle.fault <= best.fault {
                best = middle;
            } else {
                wish = middle.s;
            }
        }
        self.unless_turning(best, s, dt, held, true)
    }

    /// The same, or standing still where it would reverse for a negligible gain and standing is no worse.
    fn unless_turning(&self, step: FlowCandidate, s: f64, dt: f64, held: bool, corrected: bool) -> FlowStep {
        let rate = (step.s - s) / dt;
        let (before, mut out) = (self.rate.unwrap_or(0.0), step);
        if before * rate < 0.0 && rate.abs() < FLOW_TURN {
            let still = self.candidate(s, held);
            if still.fault <= step.fault {
                out = still;
            }
        }
        out.step(if out.s == s { 0.5 * before } else { rate }, corrected)
    }
}

impl FlowCandidate {
    fn step(self, rate: f64, corrected: bool) -> FlowStep {
        let Self { s, distance, q, within_limits, .. } = self;
        FlowStep { swivel: s, rate, distance, q, within_limits, corrected }
    }
}

/// Arc length of a path at a time.
fn arc_length_at(path: &Path, t: f64) -> f64 {
    let (Some(times), s) = (path.t(), path.s()) else { return 0.0 };
    let k = times.partition_point(|x| *x <= t).clamp(1, times.len() - 1);
    let share = ((t - times[k - 1]) / (times[k] - times[k - 1])).clamp(0.0, 1.0);
    s[k - 1] + share * (s[k] - s[k - 1])
}

/// The windings of `q` that are nearest to `before` and within the limits.
fn unwound(q: &[f64; 7], before: &[f64; 7], lower: &[f64], upper: &[f64]) -> [f64; 7] {
    std::array::from_fn(|i| {
        let wound = nearest(q[i], before[i]);
        if wound >= lower[i] && wound <= upper[i] { wound } else { q[i] }
    })
}
