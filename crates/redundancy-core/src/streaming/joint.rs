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

use super::thresholds::{SERVO_AT_REST, SERVO_STEP_BISECTIONS, SERVO_STOP_LEGS};

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

/// Ticks but one of a sequence that falls by `step` per tick and sums up to `distance`.
#[inline(always)]
fn falling(distance: f64, step: f64) -> f64 {
    (((1.0 + 8.0 * (distance / step)).sqrt() - 1.0) * 0.5).floor()
}

/// The largest whole number up to `most` for which `holds`, which holds up to some number and not beyond it.
fn most_ticks(most: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(most) {
        return most;
    }
    let (mut good, mut bad) = (0.0, most);
    while bad - good > 1.0 {
        let middle = (0.5 * (good + bad)).floor();
        if holds(middle) { good = middle } else { bad = middle }
    }
    good
}

/// The largest first step of a sequence that falls by `step` per tick and sums up to `distance`.
#[inline(always)]
pub(super) fn brake(distance: f64, step: f64) -> f64 {
    if step == f64::INFINITY {
        return distance;
    }
    let k = falling(distance, step);
    step * 0.5 * k + distance / (k + 1.0)
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

    /// The state after `n` ticks with the third difference `b`.
    #[inline(always)]
    fn after_ticks(self, n: f64, b: f64) -> Self {
        let pairs = 0.5 * n * (n + 1.0);
        Self {
            q: self.q + n * self.u + pairs * (self.c + b * (n + 2.0) / 3.0),
            u: self.u + n * self.c + pairs * b,
            c: self.c + n * b,
        }
    }

    /// Way of the rest of the stopping motion where nothing but its deceleration falls from here on.
    fn last_leg(self, limits: &JointLimits) -> Option<f64> {
        let (speed, c) = (self.u.abs(), if self.u < 0.0 { -self.c } else { self.c });
        let first = brake(speed, limits.jerk);
        if first > limits.acceleration || (first + c).abs() > limits.jerk {
            return None;
        }
        if limits.jerk == f64::INFINITY {
            return Some(0.0);
        }
        // `speed` minus `first`, `first - jerk`, ... after each of `k + 1` ticks, summed up.
        let n = falling(speed, limits.jerk) + 1.0;
        let way = n * speed - 0.5 * n * (n + 1.0) * (first - limits.jerk * (n - 1.0) / 3.0);
        Some(way.copysign(self.u))
    }

    /// The next ticks of the stopping motion that can be taken at once: those with the same jerk, or of full deceleration. Speed and
    /// position have no turning point between.
    fn leg(self, limits: &JointLimits) -> Self {
        let JointLimits { acceleration, jerk, .. } = *limits;
        let down = if self.u != 0.0 { self.u < 0.0 } else { self.c < 0.0 };
        let side = if down { -1.0 } else { 1.0 };
        let (speed, c) = (side * self.u, side * self.c);
        let ramp = acceleration / jerk;
        // Below this speed the deceleration may have to fall.
        let slow = acceleration * (0.5 * ramp + 2.0);
        if c == -acceleration && speed > slow {
            let n = ((speed - slow) / acceleration).ceil();
            return self.after_ticks(n, 0.0);
        }
        if jerk == f64::INFINITY {
            return self.after(self.stop_step(limits));
        }
        let ahead = Self { q: 0.0, u: speed, c };
        let moves = |n: f64, b: f64| ahead.after_ticks(n, b).u > 0.0;
        let wanted = |speed: f64| -brake(speed, jerk).min(acceleration);
        let (n, b) = if c > 0.0 {
            // It still accelerates.
            ((c / jerk).floor(), -jerk)
        } else if c - jerk > wanted(speed) {
            // The deceleration grows.
            let grows = |n: f64| {
                let next = ahead.after_ticks(n, -jerk);
                next.u > 0.0 && next.c - jerk >= wanted(next.u)
            };
            (most_ticks(((acceleration + c) / jerk).floor(), grows), -jerk)
        } else if c + jerk < -acceleration {
            // More deceleration than is allowed, in a motion relative to another one.
            (most_ticks(((-acceleration - c) / jerk).floor(), |n| moves(n, jerk)), jerk)
        } else if c + jerk < wanted(speed) {
            // Too much deceleration to be taken back in time: the joint turns round.
            (most_ticks((-c / jerk).floor(), |n| moves(n, jerk)), jerk)
        } else {
            (0.0, 0.0)
        };
        if n >= 1.0 { self.after_ticks(n, side * b) } else { self.after(self.stop_step(limits)) }
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

/// The stopping motion from `(u, c)`; `None` where it does not end, which rounding alone could cause.
///
/// It is a few legs of constant jerk, however many ticks each of them takes, so that its cost is bounded.
pub(super) fn stop(u: f64, c: f64, limits: &JointLimits) -> Option<Stop> {
    let mut state = JointState { q: 0.0, u, c };
    let mut out = Stop { distance: 0.0, least: 0.0, most: 0.0, speed: u.abs() };
    for _ in 0..SERVO_STOP_LEGS {
        let rest = state.at_rest();
        let last = if rest { Some(0.0) } else { state.last_leg(limits) };
        if let Some(way) = last {
            out.distance = state.q + way;
            out.least = out.least.min(out.distance);
            out.most = out.most.max(out.distance);
            return Some(out);
        }
        state = state.leg(limits);
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

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// The stopping motion tick by tick.
    fn stop_by_ticks(mut state: JointState, limits: &JointLimits) -> Stop {
        let mut out = Stop { distance: 0.0, least: 0.0, most: 0.0, speed: state.u.abs() };
        while !state.at_rest() {
            state = state.after(state.stop_step(limits));
            out.least = out.least.min(state.q);
            out.most = out.most.max(state.q);
            out.speed = out.speed.max(state.u.abs());
        }
        Stop { distance: state.q, ..out }
    }

    #[test]
    fn legs_are_what_the_ticks_of_the_stopping_motion_add_up_to() {
        let rng = &mut ChaCha8Rng::seed_from_u64(3);
        for k in 0..3000 {
            let dt: f64 = rng.random_range(1e-3..1e-2);
            let acceleration = rng.random_range(-1.0_f64..4.0).exp();
            let jerk =
                if k % 10 == 0 { f64::INFINITY } else { acceleration * rng.random_range(0.0_f64..6.0).exp() };
            let limits = JointLimits {
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
                velocity: f64::INFINITY,
                acceleration: acceleration * dt * dt,
                jerk: jerk * dt.powi(3),
            };
            // States of a joint, and every third one that a joint may have relative to its reference.
            let excess = if k % 3 == 0 { 4.0 } else { 1.0 };
            let u = dt * rng.random_range(-1.0..1.0) * rng.random_range(-15.0_f64..1.5).exp();
            let c =
                if k % 20 == 0 { 0.0 } else { excess * limits.acceleration * rng.random_range(-1.0..1.0) };
            let ticks = stop_by_ticks(JointState { q: 0.0, u, c }, &limits);
            let legs = stop(u, c, &limits).unwrap();
            let near = |a: f64, b: f64, size: f64| (a - b).abs() <= 1e-12 * (1e-2 + size);
            let size = ticks.most - ticks.least;
            assert!(near(legs.distance, ticks.distance, size), "{legs:?} {ticks:?} {limits:?} {u} {c}");
            assert!(near(legs.least, ticks.least, size) && near(legs.most, ticks.most, size));
            assert!(near(legs.speed, ticks.speed, ticks.speed));
        }
    }
}
