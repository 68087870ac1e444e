//! One tick of the servo.

use std::fmt;
use std::sync::Arc;

use nalgebra::{Vector3, Vector6};

use super::elbow::{ELBOW_JOINTS, SwivelChart};
use super::filter::{Filtered, TargetFilter, TargetNoise};
use super::foresight::Foresight;
use super::joint::{JointLimits, JointState, ServoLimitKind, allowed, approach, stop, viable};
use super::reference::{Reference, Wish};
use super::thresholds::{
    SERVO_ACCELERATION, SERVO_ACCELERATION_PER_VELOCITY, SERVO_CATCH_UP, SERVO_CATCH_UP_JERK, SERVO_REACHED,
};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_length, check_vector};
use crate::kinematics::{PoseError, Scratch};
use crate::pose::{Pose, rigid_pose};
use crate::solutions::SrsArm;
use crate::status::Status;

/// Settings of a servo.
#[derive(Debug, Clone)]
pub struct ServoSettings {
    /// Largest joint speeds, rad/s or m/s; `None` takes the chain's.
    pub velocity_limits: Option<Vec<f64>>,
    /// Largest joint accelerations, rad/s^2 or m/s^2; `None` takes the chain's. A joint without one gets ten times its velocity
    /// limit per second, so that it is at full speed after 0.1 s, or 10 rad/s^2 (m/s^2) where it has no velocity limit either.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Largest joint jerks, rad/s^3 or m/s^3; `None` is off.
    pub jerk_limits: Option<Vec<f64>>,
    /// What to do with the freedom; `None` keeps joints in the middle of their ranges.
    pub criterion: Option<Arc<dyn Criterion>>,
    /// Desired swivel until a tick gives another one.
    pub desired_swivel: Option<f64>,
    /// Direction from which the swivel counts on arms without a chart.
    pub swivel_reference: Option<Vector3<f64>>,
    /// Weight of 1 m of position error where the target cannot be reached.
    pub position_weight: f64,
    /// Weight of 1 rad of orientation error, m.
    pub orientation_weight: f64,
    /// How exact the target is.
    pub target_noise: TargetNoise,
    /// Time without a target after which the arm brakes to rest, s.
    pub timeout: f64,
    /// The S-R-S arm in whose chart a swivel counts; without it the chart of the chain's own, where it has one.
    pub srs: Option<SrsArm>,
}

impl Default for ServoSettings {
    fn default() -> Self {
        Self {
            velocity_limits: None,
            acceleration_limits: None,
            jerk_limits: None,
            criterion: None,
            desired_swivel: None,
            swivel_reference: None,
            position_weight: 1.0,
            orientation_weight: 0.3,
            target_noise: TargetNoise::Auto,
            timeout: 0.1,
            srs: None,
        }
    }
}

/// What a tick asks for.
#[derive(Debug, Clone, Copy, Default)]
pub struct ServoTarget {
    /// Pose of the tool in the world; `None`, or one that is not finite or not rigid, is no new target.
    pub pose: Option<Pose>,
    /// True where a target came that could not be read as a pose; the report then says so.
    pub broken: bool,
    /// Its velocity where the caller knows it: linear and angular, base axes.
    pub velocity: Option<Vector6<f64>>,
    /// Desired swivel, rad.
    pub swivel: Option<f64>,
    /// Desired place of the elbow, m, base frame.
    pub elbow: Option<Vector3<f64>>,
}

/// A limit that acted on a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ServoLimit {
    /// Index of the joint, from 0.
    pub joint: usize,
    /// Which limit.
    pub kind: ServoLimitKind,
    /// True for the upper, false for the lower one.
    pub upper: bool,
}

/// Why a tick has the status it has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ServoReason {
    /// Nothing to explain.
    None,
    /// The target is this far (m) out of reach.
    OutOfReach(f64),
    /// A joint is at its position limit, which leaves this error (m, rad).
    JointLimit {
        /// Index of the joint, from 0.
        joint: usize,
        /// Which limit.
        upper: bool,
        /// Error left, m and rad.
        left: [f64; 2],
    },
    /// No configuration nearer to the target was found; this error is left, m and rad.
    NotReached([f64; 2]),
    /// No target for this time, s; the arm brakes.
    Silent(f64),
    /// The target of this tick is not finite or not rigid; the motion goes on as before.
    InvalidTarget,
}

/// What a tick did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoReport {
    /// `converged` on the target; `tracking` behind it; `unreachable` or `limits` at the nearest pose; `no_target`.
    pub status: Status,
    /// Why.
    pub reason: ServoReason,
    /// Distance of the tool from the target, m; 0 without a target so far.
    pub position_error: f64,
    /// Angle of the tool to the target, rad.
    pub orientation_error: f64,
    /// Share of the target's velocity with which the tool follows it, in [0, 1].
    pub scale: f64,
    /// Time until the arm would have to stop, s; infinite if no stop is seen.
    pub time_to_stop: f64,
}

/// A servo for pose targets.
///
/// ```
/// use redundancy_core::{chain::catalog, streaming::{Servo, ServoSettings, ServoTarget}};
/// let arm = catalog::load("iiwa14")?;
/// let q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
/// let mut servo = Servo::new(&arm, 0.004, &ServoSettings::default())?;
/// servo.reset(&q, None)?;
/// let mut pose = arm.forward(&q)?;
/// pose.translation.x += 0.05;
/// for _ in 0..200 {
///     servo.update(&ServoTarget { pose: Some(pose), ..ServoTarget::default() })?;
/// }
/// assert!((arm.forward(servo.q())?.translation.vector - pose.translation.vector).norm() < 1e-9);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Servo {
    chain: Chain,
    dt: f64,
    timeout: f64,
    limits: Vec<JointLimits>,
    joints: Vec<JointState>,
    filter: TargetFilter,
    reference: Reference,
    foresight: Foresight,
    swivel: Option<f64>,
    target: Option<Pose>,
    /// Time since the last target.
    silent: f64,
    braking: bool,
    ready: bool,
    active: Vec<ServoLimit>,
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
    scratch: Scratch,
}

impl Servo {
    /// A servo with `dt` seconds per tick; [`Servo::reset`] comes before the first tick.
    ///
    /// # Errors
    /// A tick, timeout, weight, noise or limit that is not positive or not finite where it has to be, wrong lengths, a criterion
    /// of another arm, a desired swivel for an arm that has none.
    pub fn new(chain: &Chain, dt: f64, settings: &ServoSettings) -> Result<Self> {
        positive("dt", dt)?;
        positive("timeout", settings.timeout)?;
        positive("position_weight", settings.position_weight)?;
        positive("orientation_weight", settings.orientation_weight)?;
        if let TargetNoise::Given(position, angle) = settings.target_noise {
            for (what, value) in
                [("target_noise of the position", position), ("target_noise of the angle", angle)]
            {
                if !(value.is_finite() && value >= 0.0) {
                    return Err(Error::OutOfRange {
                        what: what.into(),
                        value,
                        bound: "at least 0 and finite".into(),
                    });
                }
            }
        }
        if let Some(criterion) = &settings.criterion {
            criterion.check_arm(chain)?;
        }
        let chart = chart_of(chain, settings)?;
        let n = chain.dof();
        let weights = [settings.position_weight, settings.orientation_weight];
        let reference = Reference::new(chain, settings.criterion.clone(), chart, weights, dt);
        Ok(Self {
            chain: chain.clone(),
            dt,
            timeout: settings.timeout,
            limits: limits_of(chain, dt, settings)?,
            joints: vec![JointState::default(); n],
            filter: TargetFilter::new(dt, settings.target_noise),
            foresight: Foresight::new(&reference, dt),
            reference,
            swivel: settings.desired_swivel,
            target: None,
            silent: 0.0,
            braking: false,
            ready: false,
            active: Vec::with_capacity(2 * n),
            q: vec![0.0; n],
            qd: vec![0.0; n],
            qdd: vec![0.0; n],
            scratch: Scratch::new(chain),
        })
    }

    /// Starts from joint positions, and velocities (0 unless given).
    ///
    /// # Errors
    /// Wrong lengths, numbers that are not finite, a position or velocity outside of its limit, a velocity from which the joint
    /// cannot brake before its position limit.
    pub fn reset(&mut self, q: &[f64], qd: Option<&[f64]>) -> Result<()> {
        self.chain.check_q(q)?;
        if let Some(qd) = qd {
            check_vector("qd", qd, self.chain.dof())?;
        }
        for (i, (q, limits)) in q.iter().zip(&self.limits).enumerate() {
            let state = JointState { q: *q, u: qd.map_or(0.0, |qd| qd[i] * self.dt), c: 0.0 };
            if !viable(&state, limits) {
                return Err(self.refusal(i, &state));
            }
        }
        for (i, joint) in self.joints.iter_mut().enumerate() {
            *joint = JointState { q: q[i], u: qd.map_or(0.0, |qd| qd[i] * self.dt), c: 0.0 };
        }
        self.reference.restart(&self.joints);
        self.filter.restart();
        self.foresight.restart();
        self.target = None;
        self.silent = 0.0;
        self.braking = false;
        self.ready = true;
        self.active.clear();
        self.write_out();
        Ok(())
    }

    fn refusal(&self, i: usize, state: &JointState) -> Error {
        let name = &self.chain.joints()[i].name;
        let limits = &self.limits[i];
        if state.q < limits.lower || state.q > limits.upper {
            let bound = format!("within [{}, {}]", limits.lower, limits.upper);
            return Error::OutOfRange { what: format!("q of joint '{name}'"), value: state.q, bound };
        }
        let value = state.u / self.dt;
        let most = limits.velocity / self.dt;
        if state.u.abs() > limits.velocity {
            let bound = format!("within [{}, {most}]", -most);
            return Error::OutOfRange { what: format!("qd of joint '{name}'"), value, bound };
        }
        let way = stop(state.u, state.c, limits).map_or(f64::INFINITY, |stop| stop.distance.abs());
        let room = if value > 0.0 { limits.upper - state.q } else { state.q - limits.lower };
        Error::OutOfRange {
            what: format!("qd of joint '{name}'"),
            value,
            bound: format!(
                "small enough to brake within {room} before its position limit, braking takes {way}"
            ),
        }
    }

    /// One tick; afterwards [`Servo::q`], [`Servo::qd`] and [`Servo::qdd`] are what to send to the arm. Allocates nothing.
    ///
    /// # Errors
    /// No [`Servo::reset`] before. The target itself is never an error.
    pub fn update(&mut self, target: &ServoTarget) -> Result<ServoReport> {
        if !self.ready {
            return Err(Error::Invalid("the servo has no joint positions yet: call reset(q) first".into()));
        }
        let pose = target.pose.as_ref().and_then(rigid_pose);
        let invalid = target.broken || (target.pose.is_some() && pose.is_none());
        if let Some(swivel) = target.swivel.filter(|swivel| swivel.is_finite()) {
            self.swivel = Some(swivel);
        }
        let elbow = target.elbow.filter(|elbow| elbow.iter().all(|x| x.is_finite()));
        let wish = match (elbow, self.swivel) {
            (Some(elbow), _) => Wish::Elbow(elbow),
            (None, Some(swivel)) => Wish::Swivel(swivel),
            (None, None) => Wish::Criterion,
        };
        let velocity = target.velocity.filter(|v| v.iter().all(|x| x.is_finite()));
        let filtered = self.filter_target(pose, velocity);
        self.active.clear();
        match &filtered {
            Some(filtered) => self.follow(filtered, wish),
            None => self.brake(),
        }
        self.write_out();
        Ok(self.report(filtered.as_ref(), invalid))
    }

    /// The target of this tick; `None` where the arm has to brake.
    fn filter_target(&mut self, pose: Option<Pose>, velocity: Option<Vector6<f64>>) -> Option<Filtered> {
        let Some(pose) = pose else {
            self.silent += self.dt;
            if self.target.is_none() || self.silent > self.timeout || self.braking {
                self.braking = true;
                return None;
            }
            return Some(self.filter.coast());
        };
        if self.braking {
            self.filter.restart();
            self.braking = false;
        }
        self.silent = 0.0;
        self.target = Some(pose);
        let velocity = velocity.map(|v| [Vector3::new(v[0], v[1], v[2]), Vector3::new(v[3], v[4], v[5])]);
        Some(self.filter.update(&pose, velocity))
    }

    /// Moves every joint towards the reference.
    fn follow(&mut self, filtered: &Filtered, wish: Wish) {
        let [v, w] = filtered.velocity;
        let twist = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z) * self.dt;
        self.reference.update(&filtered.pose, &twist, filtered.jumped, wish, &self.limits);
        for (i, (joint, limits)) in self.joints.iter_mut().zip(&self.limits).enumerate() {
            let (q, u, c) = (self.reference.q[i], self.reference.u[i], self.reference.c[i]);
            let relative = JointState {
                q: joint.q - (q - u),
                u: joint.u - (u - c),
                c: joint.c - self.reference.before[i],
            };
            let left = JointLimits {
                acceleration: (limits.acceleration - c.abs()).max(SERVO_CATCH_UP * limits.acceleration),
                jerk: SERVO_CATCH_UP_JERK * limits.jerk,
                ..*limits
            };
            let wanted = c + approach(&relative, &left);
            let (step, held) = allowed(joint, wanted, limits);
            *joint = joint.after(step);
            if let Some((kind, upper)) = held {
                self.active.push(ServoLimit { joint: i, kind, upper });
            }
        }
    }

    /// A tick of the stopping motion.
    fn brake(&mut self) {
        for (joint, limits) in self.joints.iter_mut().zip(&self.limits) {
            *joint = joint.after(joint.stop_step(limits));
        }
        self.reference.restart(&self.joints);
    }

    fn write_out(&mut self) {
        for (i, joint) in self.joints.iter().enumerate() {
            self.q[i] = joint.q;
            self.qd[i] = joint.u / self.dt;
            self.qdd[i] = joint.c / (self.dt * self.dt);
        }
    }

    fn report(&mut self, filtered: Option<&Filtered>, invalid: bool) -> ServoReport {
        let kinematics = self.chain.kinematics_unchecked(&self.q, &mut self.scratch);
        let error = self.target.map(|target| PoseError::between(&target, kinematics.pose()));
        let [position, orientation] = error.map_or([0.0; 2], |error| [error.linear.norm(), error.angle]);
        let mut scale = 1.0;
        if let Some(filtered) = filtered {
            let moved = kinematics
                .jacobian()
                .column_iter()
                .zip(&self.qd)
                .fold(Vector6::zeros(), |sum: Vector6<f64>, (column, qd)| sum + column * *qd);
            let [v, w] = filtered.velocity;
            let wanted = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z);
            let square = wanted.norm_squared();
            if square > SERVO_REACHED[0] * SERVO_REACHED[0] {
                scale = (moved.dot(&wanted) / square).clamp(0.0, 1.0);
            }
        }
        let time_to_stop = match filtered {
            Some(filtered) => {
                self.foresight.look(&self.q, kinematics.pose(), filtered.velocity, &self.limits)
            }
            None => f64::INFINITY,
        };
        let near = position <= SERVO_REACHED[0] && orientation <= SERVO_REACHED[1];
        let (status, reason) = self.verdict(filtered.is_some(), near);
        ServoReport {
            status,
            reason: if invalid { ServoReason::InvalidTarget } else { reason },
            position_error: position,
            orientation_error: orientation,
            scale,
            time_to_stop,
        }
    }

    fn verdict(&self, following: bool, near: bool) -> (Status, ServoReason) {
        let reference = &self.reference;
        if !following {
            return (Status::NoTarget, ServoReason::Silent(self.silent));
        }
        if near {
            return (Status::Converged, ServoReason::None);
        }
        if reference.converged && reference.out_of_reach > SERVO_REACHED[0] {
            return (Status::Unreachable, ServoReason::OutOfReach(reference.out_of_reach));
        }
        if reference.converged {
            return (Status::Tracking, ServoReason::None);
        }
        match reference.at_limit {
            Some((joint, upper)) => {
                (Status::Limits, ServoReason::JointLimit { joint, upper, left: reference.left })
            }
            None => (Status::Tracking, ServoReason::NotReached(reference.left)),
        }
    }

    /// Joint positions of the last tick, rad or m.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Joint velocities of the last tick: `q` minus the `q` before, by dt.
    pub fn qd(&self) -> &[f64] {
        &self.qd
    }

    /// Joint accelerations of the last tick: `qd` minus the `qd` before, by dt.
    pub fn qdd(&self) -> &[f64] {
        &self.qdd
    }

    /// Limits that acted on the last tick.
    pub fn active_limits(&self) -> &[ServoLimit] {
        &self.active
    }

    /// The arm.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Length of a tick, s.
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// A reason in words.
    pub fn explain(&self, reason: &ServoReason) -> Option<String> {
        let name = |joint: &usize| &self.chain.joints()[*joint].name;
        Some(match reason {
            ServoReason::None => return None,
            ServoReason::OutOfReach(by) => format!("the target is {:.1} mm out of reach", by * 1e3),
            ServoReason::JointLimit { joint, upper, left } => format!(
                "joint '{}' is at its {} limit; {:.1} mm and {:.2} degrees are left to the target",
                name(joint),
                if *upper { "upper" } else { "lower" },
                left[0] * 1e3,
                left[1].to_degrees()
            ),
            ServoReason::NotReached(left) => format!(
                "no configuration nearer to the target was found yet: {:.1} mm and {:.2} degrees are left",
                left[0] * 1e3,
                left[1].to_degrees()
            ),
            ServoReason::Silent(time) => format!("no target for {time:.3} s, the arm brakes to rest"),
            ServoReason::InvalidTarget => {
                "the target of this tick is not finite or not a rigid transform; it was ignored".into()
            }
        })
    }
}

impl fmt::Display for ServoLimitKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

fn positive(what: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::OutOfRange { what: what.into(), value, bound: "> 0 and finite".into() })
}

/// How the swivel of this arm is counted.
fn chart_of(chain: &Chain, settings: &ServoSettings) -> Result<SwivelChart> {
    if let Some(reference) = settings.swivel_reference {
        if reference.iter().any(|x| !x.is_finite()) || reference.norm() == 0.0 {
            return Err(Error::Invalid(
                "swivel_reference must be a finite direction that is not zero".into(),
            ));
        }
        return Ok(SwivelChart::Reference(reference));
    }
    if let Some(arm) = settings.srs.clone().or_else(|| SrsArm::new(chain).ok()) {
        return Ok(SwivelChart::Srs(Box::new(arm)));
    }
    if settings.desired_swivel.is_some() {
        let name = chain.name();
        let need = if chain.dof() < ELBOW_JOINTS { "an arm with seven joints" } else { "swivel_reference=" };
        return Err(Error::Invalid(format!(
            "desired_swivel: '{name}' has no chart of the swivel, {need} is needed"
        )));
    }
    Ok(SwivelChart::None)
}

fn limits_of(chain: &Chain, dt: f64, settings: &ServoSettings) -> Result<Vec<JointLimits>> {
    let n = chain.dof();
    for (what, given) in [
        ("velocity_limits", &settings.velocity_limits),
        ("acceleration_limits", &settings.acceleration_limits),
        ("jerk_limits", &settings.jerk_limits),
    ] {
        let Some(given) = given else { continue };
        check_length(what, given, n)?;
        if let Some(i) = given.iter().position(|x| x.is_nan() || *x <= 0.0) {
            let what = format!("{what} of joint '{}'", chain.joints()[i].name);
            return Err(Error::OutOfRange { what, value: given[i], bound: "> 0 (inf for none)".into() });
        }
    }
    let of = |given: &Option<Vec<f64>>, i: usize, own: f64| given.as_ref().map_or(own, |given| given[i]);
    Ok((0..n)
        .map(|i| {
            let own = chain.joints()[i].limits;
            let velocity = of(&settings.velocity_limits, i, own.velocity);
            let mut acceleration = of(&settings.acceleration_limits, i, own.acceleration);
            if acceleration == f64::INFINITY {
                acceleration = if velocity.is_finite() {
                    SERVO_ACCELERATION_PER_VELOCITY * velocity
                } else {
                    SERVO_ACCELERATION
                };
            }
            JointLimits {
                lower: own.lower,
                upper: own.upper,
                velocity: velocity * dt,
                acceleration: acceleration * dt * dt,
                jerk: of(&settings.jerk_limits, i, f64::INFINITY) * dt.powi(3),
            }
        })
        .collect())
}
