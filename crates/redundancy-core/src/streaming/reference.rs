//! The configuration to move to: a pose target and a wish for the freedom become joint positions.
//!
//! Newton's method with damping in proportion to the error [Sugihara2011], started from the configuration of the tick before.
//! Joints at a limit are held there while the rest goes on. The freedom moves at a bounded speed and
//! acceleration: towards a desired elbow, or along the gradient of a criterion.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector3, Vector6};

use super::elbow::{ElbowPlace, Reach, SwivelChart};
use super::joint::{JointLimits, JointState, approach};
use super::thresholds::{
    SERVO_BEND, SERVO_CRITERION_GAIN, SERVO_DAMPING, SERVO_FREEDOM_SHARE, SERVO_FREEDOM_SLOPE,
    SERVO_FREEDOM_TICKS, SERVO_LEAD, SERVO_LEAST_DAMPING, SERVO_LIMIT_MARGIN, SERVO_NEWTON_STEP,
    SERVO_OUT_OF_REACH, SERVO_REFERENCE_REACHED, SERVO_SWIVEL_JUMP,
};
use crate::chain::Chain;
use crate::criterion::{Criterion, Sense};
use crate::kinematics::{PoseError, Scratch};
use crate::pose::Pose;

/// Newton steps of a tick, and after a jump of the target.
const STEPS: usize = 4;
const STEPS_AFTER_JUMP: usize = 24;
const STEPS_TO_SHORTEN: usize = 2;
/// Rounds in which joints at their limits are taken out of one step.
const HOLDS: usize = 4;

/// What the freedom should do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Wish {
    /// The criterion, or the middle of the joint ranges.
    Criterion,
    /// A swivel angle.
    Swivel(f64),
    /// The elbow nearest to a point.
    Elbow(Vector3<f64>),
}

/// Joint positions to move to, with two backward differences per tick.
#[derive(Debug, Clone)]
pub(super) struct Reference {
    chain: Chain,
    pub q: Vec<f64>,
    pub u: Vec<f64>,
    pub c: Vec<f64>,
    /// `c` of the tick before.
    pub before: Vec<f64>,
    pub converged: bool,
    /// Error that is left, m and rad.
    pub left: [f64; 2],
    /// The joint limit that keeps it from the target: joint, upper.
    pub at_limit: Option<(usize, bool)>,
    /// Whether the target was moved into reach.
    pub out_of_reach: f64,
    weights: [f64; 2],
    dt: f64,
    criterion: Option<Arc<dyn Criterion>>,
    pub chart: SwivelChart,
    reach: Option<Reach>,
    bounds: Vec<(f64, f64)>,
    middles: Vec<(f64, f64)>,
    scratch: Scratch,
    /// Columns of the Jacobian at `trial`.
    columns: Vec<[f64; 6]>,
    free: Vec<bool>,
    trial: Vec<f64>,
    step: Vec<f64>,
    gradient: Vec<f64>,
    freedom: Vec<f64>,
    /// Joint motion of the freedom per tick, before projection.
    drift: Vec<f64>,
    /// The elbow's angle relative to the desired one.
    swivel: Option<JointState>,
    jumping: bool,
    /// How far the target moves in [`SERVO_LEAD`], m.
    ahead: Vector3<f64>,
    /// The target is not reached yet; the freedom waits.
    behind: bool,
}

impl Reference {
    pub fn new(
        chain: &Chain,
        criterion: Option<Arc<dyn Criterion>>,
        chart: SwivelChart,
        weights: [f64; 2],
        dt: f64,
    ) -> Self {
        let n = chain.dof();
        let bounds = chain
            .lower()
            .iter()
            .zip(chain.upper())
            .map(|(lower, upper)| {
                let margin = SERVO_LIMIT_MARGIN.min(0.25 * (upper - lower));
                (lower + margin, upper - margin)
            })
            .collect();
        let middles = chain
            .lower()
            .iter()
            .zip(chain.upper())
            .map(|(lower, upper)| {
                let half = 0.5 * (upper - lower);
                if half.is_finite() && half > 0.0 { (0.5 * (lower + upper), 1.0 / half) } else { (0.0, 0.0) }
            })
            .collect();
        Self {
            chain: chain.clone(),
            q: vec![0.0; n],
            u: vec![0.0; n],
            c: vec![0.0; n],
            before: vec![0.0; n],
            converged: true,
            left: [0.0; 2],
            at_limit: None,
            out_of_reach: 0.0,
            weights,
            dt,
            criterion,
            chart,
            reach: Reach::of(chain),
            bounds,
            middles,
            scratch: Scratch::new(chain),
            columns: vec![[0.0; 6]; n],
            free: vec![true; n],
            trial: vec![0.0; n],
            step: vec![0.0; n],
            gradient: vec![0.0; n],
            freedom: vec![0.0; n],
            drift: vec![0.0; n],
            swivel: None,
            jumping: false,
            ahead: Vector3::zeros(),
            behind: false,
        }
    }

    /// Starts again from a motion of the arm.
    pub fn restart(&mut self, joints: &[JointState]) {
        for (i, joint) in joints.iter().enumerate() {
            (self.q[i], self.u[i], self.c[i]) = (joint.q, joint.u, joint.c);
        }
        self.drift.fill(0.0);
        self.swivel = None;
        self.converged = true;
        self.jumping = false;
        self.behind = false;
    }

    /// One tick.
    pub fn update(
        &mut self,
        target: &Pose,
        velocity: &Vector6<f64>,
        jumped: bool,
        wish: Wish,
        limits: &[JointLimits],
    ) {
        self.before.copy_from_slice(&self.c);
        self.ahead = Vector3::new(velocity[0], velocity[1], velocity[2]) * (SERVO_LEAD / self.dt);
        self.behind = jumped || !self.converged;
        self.jumping = jumped || (self.jumping && !self.converged);
        for i in 0..self.q.len() {
            let ahead = if self.jumping { self.q[i] } else { self.q[i] + self.u[i] };
            self.trial[i] = ahead.clamp(self.bounds[i].0, self.bounds[i].1);
        }
        self.converged = false;
        self.at_limit = None;
        let steps = if self.jumping { STEPS_AFTER_JUMP } else { STEPS };
        for k in 0..steps {
            if self.newton(target, wish, limits, k == 0) && k > 0 {
                self.converged = true;
                break;
            }
        }
        if !self.jumping {
            self.shorten(target, wish, limits);
        }
        self.take(velocity);
    }

    /// One step of Newton's method on `trial`; true where nothing was left to do.
    fn newton(&mut self, target: &Pose, wish: Wish, limits: &[JointLimits], first: bool) -> bool {
        let kinematics = self.chain.kinematics_unchecked(&self.trial, &mut self.scratch);
        for (kept, column) in self.columns.iter_mut().zip(kinematics.jacobian().column_iter()) {
            (0..6).for_each(|i| kept[i] = column[i]);
        }
        let mut goal = *target;
        let shift = self
            .reach
            .as_mut()
            .map_or(Vector3::zeros(), |reach| reach.shift(&kinematics, target, &self.ahead, SERVO_BEND));
        goal.translation.vector += shift;
        self.out_of_reach = shift.norm();
        let error = PoseError::between(&goal, kinematics.pose());
        self.left = [error.linear.norm(), error.angle];
        let place = ElbowPlace::of(&kinematics);
        let turn = match place {
            Some(place) if wish != Wish::Criterion => {
                place.gradient(&kinematics, &self.chain, &mut self.gradient);
                swivel_error(&self.chart, &place, wish, &self.trial)
            }
            _ => None,
        };
        if turn.is_none() && first {
            criterion_gradient(
                self.criterion.as_deref(),
                &self.middles,
                &self.trial,
                &kinematics,
                &mut self.gradient,
            );
        }
        let [wp, wo] = self.weights;
        let e = error.twist();
        let e = Vector6::new(e[0] * wp, e[1] * wp, e[2] * wp, e[3] * wo, e[4] * wo, e[5] * wo);
        let damping = SERVO_DAMPING * e.norm_squared() + SERVO_LEAST_DAMPING;
        if turn.is_none() && first {
            self.descend(limits);
        }
        let lag = self.swivel;
        self.free.fill(true);
        for _ in 0..HOLDS {
            self.swivel = lag;
            let columns = &self.columns;
            let step = DampedStep::new(columns, &self.free, [wp, wo], damping);
            step.solve(columns, &self.free, &e, &mut self.step);
            match turn {
                Some(error) => {
                    step.project(columns, &self.free, &self.gradient, &mut self.freedom);
                    let by = self.follow_swivel(error, limits, first);
                    self.step.iter_mut().zip(&self.freedom).for_each(|(step, free)| *step += by * free);
                }
                None if self.jumping => {
                    // Of all configurations for the new pose the one nearest to the present one takes the least time.
                    for ((gradient, q), trial) in self.gradient.iter_mut().zip(&self.q).zip(&self.trial) {
                        *gradient = q - trial;
                    }
                    step.project(columns, &self.free, &self.gradient, &mut self.freedom);
                    self.step.iter_mut().zip(&self.freedom).for_each(|(step, free)| *step += free);
                }
                None if first => {
                    step.project(columns, &self.free, &self.drift, &mut self.freedom);
                    let calm = self.freedom.iter().zip(limits).fold(1.0_f64, |share, (free, limit)| {
                        share.min(SERVO_FREEDOM_SHARE * limit.velocity / free.abs())
                    });
                    self.freedom.iter_mut().for_each(|free| *free *= calm);
                    self.step.iter_mut().zip(&self.freedom).for_each(|(step, free)| *step += free);
                }
                None => {}
            }
            if !self.hold() {
                break;
            }
        }
        let longest = self.step.iter().fold(0.0_f64, |most, step| most.max(step.abs()));
        let share = (SERVO_NEWTON_STEP / longest).min(1.0);
        for (i, q) in self.trial.iter_mut().enumerate() {
            *q = (*q + share * self.step[i]).clamp(self.bounds[i].0, self.bounds[i].1);
        }
        e.norm() < SERVO_REFERENCE_REACHED
    }

    /// Takes joints out of the step that would leave their limits; true where one was taken out.
    fn hold(&mut self) -> bool {
        let mut held = false;
        for (i, (lower, upper)) in self.bounds.iter().enumerate() {
            let out = (self.trial[i] <= *lower && self.step[i] < 0.0)
                || (self.trial[i] >= *upper && self.step[i] > 0.0);
            if self.free[i] && out {
                self.free[i] = false;
                self.at_limit = Some((i, self.step[i] > 0.0));
                held = true;
            }
        }
        held
    }

    /// Share of `freedom` that turns the elbow as far as this tick may; `freedom` is the projection of the elbow's gradient.
    fn follow_swivel(&mut self, error: f64, limits: &[JointLimits], first: bool) -> f64 {
        let rate: f64 = self.gradient.iter().zip(&self.freedom).map(|(g, f)| g * f).sum();
        if rate < SERVO_FREEDOM_SLOPE {
            return 0.0;
        }
        let least = |limit: fn(&JointLimits) -> f64| {
            SERVO_FREEDOM_SHARE
                * self
                    .freedom
                    .iter()
                    .zip(limits)
                    .fold(f64::INFINITY, |least, (f, l)| least.min(limit(l) * rate / f.abs()))
        };
        if first {
            let bounds = JointLimits {
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                velocity: least(|l| l.velocity),
                acceleration: least(|l| l.acceleration),
                jerk: least(|l| l.jerk),
            };
            // The elbow relative to where it should be: `error` is what it lacks if it goes on as in the tick before.
            let lag = self.swivel.unwrap_or(JointState { q: -error, u: 0.0, c: 0.0 });
            let mut relative = JointState { u: -error - lag.q, ..lag };
            if relative.u.abs() > SERVO_SWIVEL_JUMP * bounds.velocity {
                relative = JointState { q: -error - lag.u, ..lag };
            }
            let c = approach(&relative, &bounds);
            let most = bounds.velocity.max(relative.u.abs());
            self.swivel = Some(relative.after((relative.u + c).clamp(-most, most) - relative.u));
        }
        let left = self.swivel.map_or(0.0, |lag| lag.q);
        let turned: f64 = self.gradient.iter().zip(&self.step).map(|(g, s)| g * s).sum();
        (error + left - turned) / rate
    }

    /// Lets the motion of the freedom follow the criterion, at a bounded speed and acceleration.
    fn descend(&mut self, limits: &[JointLimits]) {
        for ((drift, gradient), limit) in self.drift.iter_mut().zip(&self.gradient).zip(limits) {
            let fastest = SERVO_FREEDOM_SHARE * limit.velocity.min(limit.acceleration * SERVO_FREEDOM_TICKS);
            let gain = if self.criterion.is_some() { SERVO_CRITERION_GAIN * self.dt } else { fastest };
            let wanted = if self.behind { 0.0 } else { (-gain * gradient).clamp(-fastest, fastest) };
            let change = SERVO_FREEDOM_SHARE * limit.acceleration;
            *drift += (wanted - *drift).clamp(-change, change);
        }
    }

    /// Moves to a pose that is `ticks` ticks away, for a look ahead; false where the arm cannot be there in time.
    pub fn look(&mut self, target: &Pose, ticks: f64, limits: &[JointLimits]) -> bool {
        self.trial.copy_from_slice(&self.q);
        let mut reached = false;
        for _ in 0..STEPS {
            reached = self.newton(target, Wish::Criterion, limits, false);
            if reached {
                break;
            }
        }
        let fast = self
            .trial
            .iter()
            .zip(&self.q)
            .zip(limits)
            .any(|((to, from), limit)| (to - from).abs() > ticks * limit.velocity);
        self.q.copy_from_slice(&self.trial);
        reached && !fast && self.out_of_reach < SERVO_OUT_OF_REACH
    }

    /// Makes `trial` the reference, with its differences.
    fn take(&mut self, velocity: &Vector6<f64>) {
        if self.jumping {
            let columns = &self.columns;
            self.free.fill(true);
            let step = DampedStep::new(columns, &self.free, [1.0; 2], SERVO_LEAST_DAMPING);
            step.solve(columns, &self.free, velocity, &mut self.step);
            for i in 0..self.q.len() {
                self.q[i] = self.trial[i];
                self.u[i] = if self.converged { self.step[i] } else { 0.0 };
                (self.c[i], self.before[i]) = (0.0, 0.0);
            }
            return;
        }
        for i in 0..self.q.len() {
            let u = self.trial[i] - self.q[i];
            self.q[i] = self.trial[i];
            self.c[i] = u - self.u[i];
            self.u[i] = u;
        }
    }

    /// Share of the way to `trial` that the velocity limits allow within a tick.
    fn share(&self, limits: &[JointLimits]) -> f64 {
        self.trial
            .iter()
            .zip(&self.q)
            .zip(limits)
            .fold(1.0_f64, |share, ((to, from), limit)| share.min(limit.velocity / (to - from).abs()))
    }

    /// Where the way to `trial` is too long for the arm: as far along the tool's way as it can go, so that position and
    /// orientation lag together and no error across the way arises.
    fn shorten(&mut self, target: &Pose, wish: Wish, limits: &[JointLimits]) {
        let mut share = self.share(limits);
        if share >= 1.0 {
            return;
        }
        for (trial, q) in self.trial.iter_mut().zip(&self.q) {
            *trial = q + share * (*trial - q);
        }
        let from = *self.chain.kinematics_unchecked(&self.q, &mut self.scratch).pose();
        let way = PoseError::between(target, &from);
        let turn = nalgebra::Rotation3::new(way.angular * share);
        let nearer = Pose::from_parts(
            nalgebra::Translation3::from(from.translation.vector + way.linear * share),
            turn * from.rotation,
        );
        for _ in 0..STEPS_TO_SHORTEN {
            self.newton(&nearer, wish, limits, false);
        }
        share = self.share(limits);
        for (trial, q) in self.trial.iter_mut().zip(&self.q) {
            *trial = q + share * (*trial - q);
        }
        self.converged = false;
    }
}

/// What the elbow lacks to where it should be, rad.
fn swivel_error(chart: &SwivelChart, place: &ElbowPlace, wish: Wish, q: &[f64]) -> Option<f64> {
    match (wish, chart) {
        (Wish::Elbow(point), _) => place.angle_to(&point),
        (Wish::Swivel(angle), SwivelChart::Srs(arm)) => {
            arm.swivel(q).ok().map(|now| crate::joint_space::wrap(angle - now))
        }
        (Wish::Swivel(angle), SwivelChart::Reference(reference)) => {
            // From the present elbow to the zero, and on by the angle.
            place.angle_to_direction(reference).map(|zero| crate::joint_space::wrap(zero + angle))
        }
        _ => None,
    }
}

/// The descent direction's opposite: gradient of what is to be small.
fn criterion_gradient(
    criterion: Option<&dyn Criterion>,
    middles: &[(f64, f64)],
    q: &[f64],
    kinematics: &crate::kinematics::Kinematics<'_>,
    out: &mut [f64],
) {
    match criterion {
        Some(criterion) => {
            criterion.gradient_at(q, kinematics, out);
            if criterion.sense() == Sense::Maximize {
                out.iter_mut().for_each(|x| *x = -*x);
            }
        }
        None => {
            for ((out, (middle, scale)), q) in out.iter_mut().zip(middles).zip(q) {
                let x = (q - middle) * scale;
                *out = x * x * x;
            }
        }
    }
}

/// The damped inverse of a weighted Jacobian without the joints that are held.
struct DampedStep {
    factor: Option<nalgebra::Cholesky<f64, nalgebra::U6>>,
    weights: [f64; 2],
}

impl DampedStep {
    fn new(columns: &[[f64; 6]], free: &[bool], weights: [f64; 2], damping: f64) -> Self {
        let mut a = Matrix6::zeros();
        for (column, _) in columns.iter().zip(free).filter(|(_, free)| **free) {
            let c = weighted(column, weights);
            for j in 0..6 {
                for i in j..6 {
                    a[(i, j)] += c[i] * c[j];
                }
            }
        }
        (0..6).for_each(|i| a[(i, i)] += damping);
        Self { factor: nalgebra::Cholesky::new(a), weights }
    }

    /// `J^T (J J^T + damping)^-1 e`, 0 for joints that are held.
    fn solve(&self, columns: &[[f64; 6]], free: &[bool], e: &Vector6<f64>, out: &mut [f64]) {
        let Some(factor) = &self.factor else {
            out.fill(0.0);
            return;
        };
        let y = factor.solve(e);
        for ((out, column), free) in out.iter_mut().zip(columns).zip(free) {
            *out = if *free { weighted(column, self.weights).dot(&y) } else { 0.0 };
        }
    }

    /// `g` without what moves the tool.
    fn project(&self, columns: &[[f64; 6]], free: &[bool], g: &[f64], out: &mut [f64]) {
        let mut moved = Vector6::zeros();
        for ((column, g), _) in columns.iter().zip(g).zip(free).filter(|(_, free)| **free) {
            moved += weighted(column, self.weights) * *g;
        }
        self.solve(columns, free, &moved, out);
        for ((out, g), free) in out.iter_mut().zip(g).zip(free) {
            *out = if *free { g - *out } else { 0.0 };
        }
    }
}

#[inline(always)]
fn weighted(column: &[f64; 6], [p, o]: [f64; 2]) -> Vector6<f64> {
    let c = column;
    Vector6::new(c[0] * p, c[1] * p, c[2] * p, c[3] * o, c[4] * o, c[5] * o)
}
