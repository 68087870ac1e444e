//! The configuration that keeps farthest away from the joint limits, over all circles, with proof.
//!
//! A joint is within its limits by `half - |d|` in its best winding, d its distance from the middle of the range. The margin of
//! a configuration is the least of that over its joints, and wanted is its maximum over all swivels and branches. A few
//! samples give a value m. The arcs on which the limits hold when each is moved inwards by a little more than m (outwards
//! where m is negative) are exact, for all branches at once (`intervals.rs`); where there are none, m is the maximum, and that is
//! the proof. Otherwise every point of them is better than m: the best of their middles is improved within its arc, and the
//! arcs of the new m are asked for. Two or three rounds are usual, some 10 us in all.
//!
//! Within an arc the margin rises at one end and falls at the other. The next point is where the tangents of the joints that limit it
//! at both ends meet, or where the slope of the joint vanishes that limits it at both.

use super::choice::Choice;
use super::circle::SelfMotion;
use super::elbow_circle::{ElbowCircle, signs};
use super::intervals::{Arcs, bounds};
use crate::joint_space::{TURN, margin, wrap};
use crate::tolerance::{EDGE_FOUND, OPTIMUM_GAP};

/// Swivels at which all branches are looked at first.
const SAMPLES: usize = 8;
/// Most rounds; some three are usual.
const MOST_ROUNDS: usize = 200;
/// Most points of one arc.
const MOST_STEPS: usize = 60;
/// Every so many steps an arc is halved, whatever its ends say.
const HALVE: usize = 4;

/// A point of a branch and how the margin changes there.
#[derive(Debug, Clone, Copy)]
struct Probe {
    s: f64,
    value: f64,
    /// The joint that limits it.
    joint: usize,
    slope: f64,
}

/// The best point so far.
#[derive(Debug, Clone, Copy)]
struct Widest {
    value: f64,
    branch: usize,
    s: f64,
}

impl SelfMotion {
    /// The configuration with the largest margin: the least distance of a joint from a limit, negative by how much the worst joint
    /// is outside of its limits where no configuration holds them. Its `value` is the margin, which is proven where
    /// [`SelfMotion::proven`] says so of the branches. `None` where the pose is out of reach.
    ///
    /// ```
    /// use redundancy_core::{chain::catalog, solutions::SrsArm};
    /// let chain = catalog::load("iiwa14")?;
    /// let motion = SrsArm::new(&chain)?.self_motion(&chain.forward(&[0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])?)?;
    /// let widest = motion.best_margin().map(|best| best.value);
    /// assert!(widest.is_some_and(|margin| margin > 0.5));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn best_margin(&self) -> Option<Choice> {
        if !self.in_reach() {
            return None;
        }
        let mut best = Widest { value: f64::NEG_INFINITY, branch: 0, s: 0.0 };
        for k in 0..SAMPLES {
            let s = wrap(TURN * k as f64 / SAMPLES as f64);
            for (branch, q) in self.all_branches(s).iter().enumerate() {
                let value = self.margin_of(q).0;
                if value > best.value {
                    best = Widest { value, branch, s };
                }
            }
        }
        let mut met = best.value == f64::INFINITY;
        for _ in 0..MOST_ROUNDS {
            if met {
                break;
            }
            let arcs = self.arcs_above(best.value);
            met = arcs.is_empty();
            if !met && !self.improve(&arcs, &mut best) {
                break;
            }
        }
        let q = self.arm.wind(&self.branch_of(best.s, best.branch));
        let proven = met && self.proven();
        Some(Choice { q, swivel: wrap(best.s), branch: best.branch, value: best.value, proven })
    }

    /// Whether no configuration on the branches has a margin above `value`, up to rounding.
    pub(super) fn has_no_margin_above(&self, value: f64) -> bool {
        !self.in_reach() || value == f64::INFINITY || self.arcs_above(value).is_empty()
    }

    /// Radians of swivel at which some branch holds its limits.
    pub fn feasible_swivel(&self) -> f64 {
        if self.in_reach() { self.arcs().covered() } else { 0.0 }
    }

    /// Where the margin is above `value`.
    fn arcs_above(&self, value: f64) -> Arcs {
        let inner = &self.arm.inner;
        let level = value + OPTIMUM_GAP * (1.0 + value.abs());
        let bounds = bounds(&inner.geometry, &inner.lower, &inner.upper, level);
        Arcs::new(&inner.geometry, &self.circle, &bounds)
    }

    /// The margin of a configuration and the joint that limits it.
    fn margin_of(&self, q: &[f64; 7]) -> (f64, usize) {
        let inner = &self.arm.inner;
        let mut least = (f64::INFINITY, 0);
        for i in 0..7 {
            let own = margin(q[i], inner.lower[i], inner.upper[i]);
            if own < least.0 {
                least = (own, i);
            }
        }
        least
    }

    fn probe(&self, branch: usize, s: f64) -> Probe {
        let inner = &self.arm.inner;
        let geometry = &inner.geometry;
        let [s2, s4, s6] = signs(branch).map(f64::from);
        let (sin, cos) = s.sin_cos();
        // Without an elbow offset the other elbow turns joints 3 and 5 by half a turn: the rates are the same.
        let node = self.circle.node(geometry, s, [cos, sin], if geometry.aligned { 1.0 } else { s4 });
        let q = ElbowCircle::branch_of(geometry, &node.angles, branch);
        let (value, joint) = self.margin_of(&q);
        let rate = geometry.sign[joint] * node.rates[joint] * [1.0, s2, 1.0, 1.0, 1.0, s6, 1.0][joint];
        let middle = inner.lower[joint] + 0.5 * (inner.upper[joint] - inner.lower[joint]);
        Probe { s, value, joint, slope: -rate * wrap(q[joint] - middle).signum() }
    }

    /// Improves the best of the middles of all arcs; false where nothing is better than before.
    fn improve(&self, arcs: &Arcs, best: &mut Widest) -> bool {
        let before = best.value;
        let mut start: Option<(Probe, usize, [f64; 2])> = None;
        for branch in self.branch_indices() {
            for [lo, hi] in arcs.of(branch) {
                let middle = self.probe(branch, 0.5 * (lo + hi));
                if start.as_ref().is_none_or(|(other, ..)| middle.value > other.value) {
                    start = Some((middle, branch, [lo, hi]));
                }
            }
        }
        let Some((middle, branch, [lo, hi])) = start else { return false };
        let mut offer = |probe: &Probe| {
            if probe.value > best.value {
                *best = Widest { value: probe.value, branch, s: probe.s };
            }
        };
        let (mut a, mut b) = (self.probe(branch, lo), self.probe(branch, hi));
        let mut at = middle;
        for step in 0..MOST_STEPS {
            offer(&at);
            if at.slope > 0.0 {
                a = at
            } else {
                b = at
            }
            let width = b.s - a.s;
            if at.slope == 0.0 || width <= EDGE_FOUND {
                break;
            }
            let halved = 0.5 * (a.s + b.s);
            let next = if step % HALVE == HALVE - 1 { halved } else { meeting(&a, &b) };
            let next = if next > a.s && next < b.s { next } else { halved };
            let moved = (next - at.s).abs();
            at = self.probe(branch, next);
            if moved <= EDGE_FOUND {
                offer(&at);
                break;
            }
        }
        best.value > before
    }
}

/// Where the margin is expected to be largest between two points between which it rises and falls.
fn meeting(a: &Probe, b: &Probe) -> f64 {
    let (width, fall) = (b.s - a.s, a.slope - b.slope);
    if a.joint == b.joint {
        return a.s + a.slope / fall * width;
    }
    a.s + (b.value - a.value - b.slope * width) / fall
}
