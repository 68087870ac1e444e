//! Bounds of the joint velocities of one step, from the limits of position, velocity and acceleration.
//!
//! Over a step of length dt every joint keeps
//!
//! ```text
//! upper = min(v_max, qd + a dt, brake(q_max - q))            lower mirrored
//! brake(d) = a dt (k/2 + D/(k+1)),  D = d / (a dt^2),  k = floor((sqrt(1 + 8 D) - 1) / 2)
//! ```
//!
//! `brake` is the largest speed from which steps of deceleration a stop within d: after `k + 1` steps with
//! `v, v - a dt, ...` the joint has gone d. Without an acceleration limit it is `d / dt`. Where the bounds exclude each other,
//! position comes before velocity before acceleration. A joint outside its limits is brought back, at once or as fast as
//! its velocity limit allows.

use super::linear::{dot, times};
use super::{ActiveLimit, LimitKind};
use crate::chain::{Chain, Limits};
use crate::tolerance::{BOX_VIOLATION, LIMIT_SLACK, YIELD_WEIGHT};

/// Rounds over the joints in which a task that no scale allows is approached.
const YIELD_ROUNDS: usize = 100;

/// Bounds of the joint velocities of one step.
#[derive(Debug, Clone)]
pub(super) struct Bounds {
    pub low: Vec<f64>,
    pub high: Vec<f64>,
    pub kinds: Vec<[LimitKind; 2]>,
    /// By position alone, and by position and velocity.
    pub wider: [Vec<(f64, f64)>; 2],
    /// A joint is outside its position limits.
    pub outside: Vec<ActiveLimit>,
}

/// An interval within another one; where they exclude each other, the end of the outer one that is nearer.
fn confined((a, b): (f64, f64), (low, high): (f64, f64)) -> (f64, f64) {
    (if low > a { low.min(b) } else { a }, if high < b { high.max(a) } else { b })
}

impl Bounds {
    pub fn new(n: usize) -> Self {
        Self {
            low: vec![0.0; n],
            high: vec![0.0; n],
            kinds: vec![[LimitKind::Position; 2]; n],
            wider: [vec![(0.0, 0.0); n], vec![(0.0, 0.0); n]],
            outside: Vec::with_capacity(n),
        }
    }

    /// The bounds at `q` for a step of `dt` after the joint velocity `qd`.
    pub fn update(&mut self, chain: &Chain, q: &[f64], qd: Option<&[f64]>, dt: f64) {
        self.outside.clear();
        for (i, joint) in chain.joints().iter().enumerate() {
            let limits = &joint.limits;
            let (above, below) = (limits.upper - q[i], q[i] - limits.lower);
            let position = (-braking(below, limits, dt), braking(above, limits, dt));
            for (distance, upper) in [(above, true), (below, false)] {
                if distance < -LIMIT_SLACK {
                    self.outside.push(ActiveLimit { joint: i, kind: LimitKind::Position, upper });
                }
            }
            self.wider[0][i] = position;
            self.wider[1][i] = confined(position, (-limits.velocity, limits.velocity));
            let mut interval = position;
            self.kinds[i] = [LimitKind::Position; 2];
            let mut confine = |low: f64, high: f64, kind: LimitKind| {
                // Where they exclude each other, the end of the more important one that is nearer.
                let (a, b) = interval;
                if low > a {
                    interval.0 = low.min(b);
                    self.kinds[i][0] = kind;
                }
                if high < b {
                    interval.1 = high.max(a);
                    self.kinds[i][1] = kind;
                }
            };
            confine(-limits.velocity, limits.velocity, LimitKind::Velocity);
            if let Some(qd) = qd {
                let change = limits.acceleration * dt;
                confine(qd[i] - change, qd[i] + change, LimitKind::Acceleration);
            }
            (self.low[i], self.high[i]) = interval;
        }
    }

    pub fn contain(&self, qd: &[f64]) -> bool {
        qd.iter().zip(&self.low).zip(&self.high).all(|((x, low), high)| x >= low && x <= high)
    }

    /// The joint velocity within the bounds that moves the tool most nearly by `v`, by descent over the joints.
    pub fn approach<const M: usize>(&self, columns: &[[f64; M]], v: &[f64; M], qd: &mut [f64]) {
        for (i, qd) in qd.iter_mut().enumerate() {
            *qd = qd.clamp(self.low[i], self.high[i]);
        }
        let mut missing = times(columns, qd);
        for i in 0..M {
            missing[i] = v[i] - missing[i];
        }
        for _ in 0..YIELD_ROUNDS {
            for (j, column) in columns.iter().enumerate() {
                let slope = dot(column, &missing) - YIELD_WEIGHT * qd[j];
                let next =
                    (qd[j] + slope / (dot(column, column) + YIELD_WEIGHT)).clamp(self.low[j], self.high[j]);
                let change = next - qd[j];
                qd[j] = next;
                for i in 0..M {
                    missing[i] -= change * column[i];
                }
            }
        }
    }

    /// Adds the bounds that `qd` is at.
    pub fn report(&self, qd: &[f64], active: &mut Vec<ActiveLimit>) {
        for (joint, x) in qd.iter().enumerate() {
            for (upper, bound) in [(false, self.low[joint]), (true, self.high[joint])] {
                let limit = ActiveLimit { joint, kind: self.kinds[joint][usize::from(upper)], upper };
                if (x - bound).abs() <= BOX_VIOLATION * (1.0 + bound.abs()) && !active.contains(&limit) {
                    active.push(limit);
                }
            }
        }
    }
}

/// The largest velocity towards a position limit at distance `d`.
fn braking(d: f64, limits: &Limits, dt: f64) -> f64 {
    if d == f64::INFINITY {
        return f64::INFINITY;
    }
    if d < 0.0 {
        // Outside: back at once, or as fast as the joint can.
        return (d / dt).max(-limits.velocity);
    }
    let a = limits.acceleration;
    let steps = d / (a * dt * dt);
    if a == f64::INFINITY || !steps.is_finite() {
        return d / dt;
    }
    let k = (((1.0 + 8.0 * steps).sqrt() - 1.0) / 2.0).floor();
    a * dt * (0.5 * k + steps / (k + 1.0))
}
