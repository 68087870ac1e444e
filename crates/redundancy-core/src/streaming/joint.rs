//! One joint under limits of position, velocity, acceleration and jerk.
//!
//! Everything is counted in ticks: a motion is the sequence `q' = q + u'`, `u' = u + c'`, `c' = c + b'` of backward
//! differences, so that `u / dt`, `c / dt^2` and `b / dt^3` are exactly the velocity, acceleration and jerk that anyone computes
//! from the joint positions sent to the arm. The limits are `|u| <= V`, `|c| <= A`, `|b| <= J` and `lower <= q <= upper`.
//!
//! # Viability
//! A state is *viable* if its stopping motion holds every limit until the joint is at rest. The stopping motion takes at every tick
//! the strongest deceleration that can still be taken back in time,
//!
//! ```text
//! c' = -sign(u) min(A, brake(|u|, J))  within [c - J, c + J],   brake(d, s) = s (k/2 + D/(k+1)),
//! D = d/s,  k = floor((sqrt(1 + 8 D) - 1) / 2)
//! ```
//!
//! where `brake(d, s)` is the largest first step of a sequence that falls by s per tick and sums up to d. After one tick of it the
//! rest of the same motion remains. So a viable state has a viable successor, and a servo that only takes steps
//! to viable states never breaks a limit, whatever it is asked to do.

use super::thresholds::{SERVO_AT_REST, SERVO_STEP_BISECTIONS, SERVO_STOP_TICKS};

/// Limits of one joint, in ticks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JointLimits {
    pub lower: f64,
    pub upper: f64,
    /// Largest step of the position.
    pub velocity: f64,
    /// Largest second difference; finite.
    pub acceleration: f64,
    /// Largest third difference; infinite without a limit of the jerk.
    pub jerk: f64,
}

/// Position and its first two backward differences.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct JointState {
    pub q: f64,
    pub u: f64,
    pub c: f64,
}

/// Which limit keeps a joint from the step that was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ServoLimitKind {
    /// Its position, with the distance that braking takes.
    Position,
    /// Its speed.
    Velocity,
    /// Its acceleration.
    Acceleration,
    /// Its jerk.
    Jerk,
    /// The arm would come too close to an obstacle or to itself before it could stop.
    Contact,
}

impl ServoLimitKind {
    /// The kind as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::Contact => "contact",
        }
    }
}

/// The largest first step of a sequence that falls by `step` per tick and sums up to `distance`.
#[inline(always)]
pub(super) fn brake(distance: f64, step: f64) -> f64 {
    if step == f64::INFINITY {
        return distance;
    }
    let d = distance / step;
    let k = (((1.0 + 8.0 * d).sqrt() - 1.0) * 0.5).floor();
    step * (0.5 * k + d / (k + 1.0))
}

impl JointState {
    /// The state after a tick with the second difference `c`.
    #[inline(always)]
    pub fn after(self, c: f64) -> Self {
        let u = self.u + c;
        Self { q: self.q + u, u, c }
    }

    /// Second difference of the stopping motion's next tick.
    #[inline(always)]
    pub fn stop_step(self, limits: &JointLimits) -> f64 {
        let wanted = -brake(self.u.abs(), limits.jerk).min(limits.acceleration).copysign(self.u);
        wanted.clamp(self.c - limits.jerk, self.c + limits.jerk)
    }

    /// True at rest, up to rounding.
    #[inline(always)]
    pub fn at_rest(self) -> bool {
        self.u.abs() < SERVO_AT_REST && self.c.abs() < SERVO_AT_REST
    }
}

/// What the stopping motion passes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stop {
    /// Signed distance from the present to the final position.
    pub distance: f64,
    /// Farthest positions on the way, relative to the present one.
    pub least: f64,
    pub most: f64,
    /// Largest speed on the way.
    pub speed: f64,
}

/// The stopping motion from `(u, c)`; `None` where it takes longer than anything that counts as braking.
pub(super) fn stop(u: f64, c: f64, limits: &JointLimits) -> Option<Stop> {
    let mut state = JointState { q: 0.0, u, c };
    let mut out = Stop { distance: 0.0, least: 0.0, most: 0.0, speed: u.abs() };
    let ramp = if limits.jerk.is_finite() { limits.acceleration / limits.jerk } else { 0.0 };
    // Below this speed the deceleration may have to fall.
    let slow = limits.acceleration * (0.5 * ramp + 2.0);
    for _ in 0..SERVO_STOP_TICKS {
        if state.at_rest() {
            out.distance = state.q;
            return Some(out);
        }
        let speed = state.u.abs();
        let full = -limits.acceleration.copysign(state.u);
        if state.c == full && speed > slow {
            // Ticks of full deceleration at once.
            let n = ((speed - slow) / limits.acceleration).ceil();
            state.q += n * state.u + full * 0.5 * n * (n + 1.0);
            state.u += n * full;
        } else {
            state = state.after(state.stop_step(limits));
        }
        out.least = out.least.min(state.q);
        out.most = out.most.max(state.q);
        out.speed = out.speed.max(state.u.abs());
    }
    None
}

/// True where the stopping motion of `state` holds every limit.
pub(super) fn viable(state: &JointState, limits: &JointLimits) -> bool {
    if state.q < limits.lower
        || state.q > limits.upper
        || state.u.abs() > limits.velocity
        || state.c.abs() > limits.acceleration
    {
        return false;
    }
    // Far from every limit no simulation is needed: speed never exceeds `peak`, and braking is over after `ticks`.
    let ramp = limits.acceleration / limits.jerk;
    let rise = 0.5 * state.c.abs() * (state.c.abs() / limits.jerk + 1.0);
    let peak = state.u.abs() + rise;
    let ticks = peak / limits.acceleration + 2.0 * ramp + 4.0;
    let reach = peak * ticks;
    if peak <= limits.velocity && state.q - reach >= limits.lower && state.q + reach <= limits.upper {
        return true;
    }
    stop(state.u, state.c, limits).is_some_and(|stop| {
        stop.speed <= limits.velocity
            && state.q + stop.least >= limits.lower
            && state.q + stop.most <= limits.upper
    })
}

/// The step nearest to the second difference `wanted` that leads to a viable state, and the limit that held it back.
///
/// From a viable state the result is viable: the stopping motion is always among the steps.
pub(super) fn allowed(
    state: &JointState,
    wanted: f64,
    limits: &JointLimits,
) -> (f64, Option<(ServoLimitKind, bool)>) {
    let mut held = None;
    let mut c = wanted;
    let (low, high) = (state.c - limits.jerk, state.c + limits.jerk);
    if !(low..=high).contains(&c) {
        held = Some((ServoLimitKind::Jerk, c > high));
        c = c.clamp(low, high);
    }
    if c.abs() > limits.acceleration {
        held = Some((ServoLimitKind::Acceleration, c > 0.0));
        c = c.clamp(-limits.acceleration, limits.acceleration);
    }
    if viable(&state.after(c), limits) {
        return (c, held);
    }
    let upper = c > state.stop_step(limits);
    let (mut good, mut bad) = (state.stop_step(limits), c);
    for _ in 0..SERVO_STEP_BISECTIONS {
        let middle = 0.5 * (good + bad);
        if viable(&state.after(middle), limits) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    let room = if upper { limits.upper - state.q } else { state.q - limits.lower };
    // Stopping from the speed limit takes this long a way; nearer than that the position is what counts.
    let way =
        limits.velocity * (limits.velocity / limits.acceleration + limits.acceleration / limits.jerk + 2.0);
    let fast = state.u.abs() > 0.9 * limits.velocity;
    let kind = if fast && room > 0.5 * way { ServoLimitKind::Velocity } else { ServoLimitKind::Position };
    (good, Some((kind, upper)))
}

/// Second difference that brings a joint onto a reference as soon as `limits` of the relative motion allow, without
/// passing it: the one whose stopping motion, relative to the reference, ends on it.
///
/// `relative` is the joint minus the reference before the tick.
pub(super) fn approach(relative: &JointState, limits: &JointLimits) -> f64 {
    // Where the joint would come to rest, relative to the reference, after a tick with c.
    let end = |c: f64| {
        let next = relative.after(c);
        next.q + stop(next.u, next.c, limits).map_or(0.0, |stop| stop.distance)
    };
    let least = (relative.c - limits.jerk).max(-limits.acceleration).min(limits.acceleration);
    let most = (relative.c + limits.jerk).min(limits.acceleration).max(-limits.acceleration);
    let (mut a, mut b) = (least, most);
    // The step that lands on the reference at once is the answer whenever it is possible at all.
    let direct = -(relative.q + relative.u);
    if (least..=most).contains(&direct) && relative.u + direct == 0.0 && direct.abs() <= limits.jerk {
        return direct;
    }
    let (mut end_a, mut end_b) = (end(a), end(b));
    if end_b <= 0.0 {
        return b;
    }
    if end_a >= 0.0 {
        return a;
    }
    // False position with halved weights (Illinois).
    let mut side = 0;
    for _ in 0..SERVO_STEP_BISECTIONS {
        let c = (a * end_b - b * end_a) / (end_b - end_a);
        let value = end(c);
        if value.abs() < SERVO_AT_REST {
            return c;
        }
        if value < 0.0 {
            (a, end_a) = (c, value);
            if side == -1 {
                end_b *= 0.5;
            }
            side = -1;
        } else {
            (b, end_b) = (c, value);
            if side == 1 {
                end_a *= 0.5;
            }
            side = 1;
        }
    }
    0.5 * (a + b)
}
