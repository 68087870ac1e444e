//! The best member of a circle of solutions, over all branches and feasible arcs.
//!
//! # Why it cannot be missed
//! With `x(s) = cos(middle angle)`, a sinusoid, the rates of a spherical joint that turns about the constant `t` are
//! `a' = (t_z - r x)/(1 - x^2)`, `c' = (r - t_z x)/(1 - x^2)`, `b' = -x'/sqrt(1 - x^2)`, with the constant
//! `r = t . e3`. Their zeros and extrema are roots of quadratics in x or in cos(s - s1): at most 2 x 10 swivels for
//! both spherical joints. Cut there, every joint and every joint rate is monotone on each piece, so its range is known
//! from the ends. For a criterion `sum w_i/2 (q_i - c_i)^2` that gives on each piece
//!
//! - a lower bound from the joint ranges, windings within the limits included;
//! - the range of the derivative; where it has no zero the minimum is at an end;
//! - the mean-value bound, which closes quadratically around a minimum.
//!
//! Pieces that could still hold something better than the best point found are halved, best bound first, until none
//! is left: the result is the global minimum up to [`OPTIMUM_GAP`].
//!
//! Other criteria have no such bounds. There each piece is halved until the cubic through values and slopes at its
//! ends predicts the value in the middle, and every sign change of the slope is refined.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::circle::SelfMotion;
use super::geometry::wrapped;
use super::spherical::sphericals;
use super::srs::{Circle, signs, within};
use crate::criterion::{Criterion, JointSpring, Sense, check_dof};
use crate::error::Result;
use crate::tolerance::{OPTIMUM_GAP, UNWIND_ROUNDING};

/// A configuration chosen from a circle of solutions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Joint positions within the limits.
    pub q: [f64; 7],
    /// Its swivel, rad in `(-pi, pi]`.
    pub swivel: f64,
    /// Its branch, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub branch: usize,
    /// The criterion there.
    pub value: f64,
}

/// A swivel with the paper's angles (unwound arm, branch +++ of one elbow) and their rates.
#[derive(Debug, Clone, Copy)]
struct Node {
    s: f64,
    angles: [f64; 7],
    rates: [f64; 7],
}

/// Joint values and rates of one branch at a node; values are unwound by the caller.
#[derive(Debug, Clone, Copy)]
struct Sample {
    s: f64,
    q: [f64; 7],
    rate: [f64; 7],
}

/// A stretch of one branch on which all joints and all joint rates are monotone.
#[derive(Debug, Clone, Copy)]
struct Piece {
    branch: usize,
    a: Sample,
    b: Sample,
    bound: f64,
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.bound == other.bound
    }
}
impl Eq for Piece {}
impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Piece {
    /// The least bound is the greatest piece: it leaves the heap first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound)
    }
}

struct Search<'a> {
    motion: &'a SelfMotion,
    springs: [JointSpring; 7],
    best: Option<Choice>,
}

impl SelfMotion {
    /// The best configuration over the pose: all branches, all feasible arcs, all windings within the limits. `None`
    /// when there is no configuration within the limits ([`SelfMotion::reason`] says why).
    ///
    /// For criteria that are sums of joint springs ([`Criterion::springs`]: joint range, posture, their sums) the
    /// optimum is proven by bounds; for others every stationary point that a cubic resolves is compared.
    ///
    /// # Errors
    /// A criterion for another number of joints.
    pub fn best(&self, criterion: &dyn Criterion) -> Result<Option<Choice>> {
        check_dof(criterion, 7)?;
        let springs = criterion.springs().filter(|s| {
            criterion.sense() == Sense::Minimize && s.iter().all(|s| s.weight >= 0.0 && s.weight.is_finite())
        });
        let choice = match springs {
            Some(springs) => self.softest(std::array::from_fn(|i| springs[i])),
            None => self.scan(criterion),
        };
        Ok(choice.map(|c| Choice { value: criterion.value(&c.q), ..c }))
    }

    /// The configuration over the pose with the least Euclidean distance to `q` within the limits, windings included.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn nearest(&self, q: &[f64]) -> Result<Option<Choice>> {
        self.arm.chain().check_q(q)?;
        let choice = self.softest(std::array::from_fn(|i| JointSpring { weight: 1.0, center: q[i] }));
        Ok(choice.map(|c| {
            let distance = c.q.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            Choice { value: distance, ..c }
        }))
    }

    /// Global minimum of a sum of springs.
    fn softest(&self, springs: [JointSpring; 7]) -> Option<Choice> {
        let arcs = self.arcs();
        if arcs.is_empty() {
            return None;
        }
        let mut search = Search { motion: self, springs, best: None };
        let mut heap = BinaryHeap::with_capacity(64);
        self.for_each_piece(|branch, a, b| {
            search.offer(branch, &a);
            search.offer(branch, &b);
            let bound = search.bound(&a, &b);
            heap.push(Piece { branch, a, b, bound });
        });
        // Touching points.
        for branch in self.branch_indices() {
            for [lo, hi] in arcs.of(branch) {
                if lo == hi {
                    let sample = self.sample(branch, &self.node(branch, lo));
                    search.offer(branch, &sample);
                }
            }
        }
        while let Some(piece) = heap.pop() {
            let best = search.best.map_or(f64::INFINITY, |b| b.value);
            let gap = OPTIMUM_GAP * (1.0 + best.abs());
            if piece.bound >= best - gap {
                break;
            }
            let middle = search.split(&piece);
            if middle <= piece.a.s || middle >= piece.b.s {
                continue;
            }
            let mut sample = self.sample(piece.branch, &self.node(piece.branch, middle));
            for i in 0..7 {
                // The joint is monotone on the piece: its value lies between those at the ends.
                let centre = 0.5 * (piece.a.q[i] + piece.b.q[i]);
                sample.q[i] += TAU * ((centre - sample.q[i]) / TAU).round();
            }
            search.offer(piece.branch, &sample);
            for (a, b) in [(piece.a, sample), (sample, piece.b)] {
                let bound = search.bound(&a, &b).max(piece.bound);
                heap.push(Piece { branch: piece.branch, a, b, bound });
            }
        }
        search.polish();
        search.best
    }

    /// Calls `visit` for the monotone pieces of every branch inside its feasible arcs.
    fn for_each_piece(&self, mut visit: impl FnMut(usize, Sample, Sample)) {
        let aligned = self.arm.inner.geometry.aligned;
        let mut nodes: [Vec<Node>; 2] = [Vec::new(), Vec::new()];
        for (e, elbow) in [1.0, -1.0].into_iter().enumerate() {
            if e == 0 || !aligned {
                let mut cuts: Vec<f64> = self.arcs().cuts().to_vec();
                for joint in sphericals(&self.arm.inner.geometry, &self.circle, elbow) {
                    joint.push_monotone_cuts(&mut cuts);
                }
                // No joint turns by more than pi on a piece.
                cuts.extend([-PI, -FRAC_PI_2, 0.0, FRAC_PI_2]);
                cuts.sort_unstable_by(f64::total_cmp);
                cuts.dedup();
                nodes[e] = cuts.into_iter().map(|s| self.elbow_node(elbow, s)).collect();
                let Some(first) = nodes[e].first().copied() else { continue };
                nodes[e].push(Node { s: first.s + TAU, ..first });
            }
        }
        for branch in self.branch_indices() {
            let row = &nodes[if aligned { 0 } else { usize::from(signs(branch)[1] < 0) }];
            for pair in row.windows(2) {
                let (a, b) = (&pair[0], &pair[1]);
                if b.s - a.s > 0.0 && self.arcs().holds(branch, 0.5 * (a.s + b.s)) {
                    let (start, mut end) = (self.sample(branch, a), self.sample(branch, b));
                    for i in 0..7 {
                        end.q[i] = unwound(start.q[i], end.q[i], start.rate[i] + end.rate[i]);
                    }
                    visit(branch, start, end);
                }
            }
        }
    }

    fn node(&self, branch: usize, s: f64) -> Node {
        let aligned = self.arm.inner.geometry.aligned;
        self.elbow_node(if aligned || signs(branch)[1] > 0 { 1.0 } else { -1.0 }, s)
    }

    fn elbow_node(&self, elbow: f64, s: f64) -> Node {
        let geometry = &self.arm.inner.geometry;
        let (sin, cos) = s.sin_cos();
        let angles = self.circle.angles(geometry, [cos, sin], elbow);
        Node { s, angles, rates: self.circle.rates(geometry, &angles, elbow) }
    }

    /// One branch at a node, principal values.
    fn sample(&self, branch: usize, node: &Node) -> Sample {
        let geometry = &self.arm.inner.geometry;
        let q = Circle::branch_of(geometry, &node.angles, branch);
        let [s2, _, s6] = signs(branch).map(f64::from);
        let mut rate = node.rates;
        rate[1] *= s2;
        rate[5] *= s6;
        for i in 0..7 {
            rate[i] *= geometry.sign[i];
        }
        Sample { s: node.s, q, rate }
    }

    /// Optimum of a criterion without bounds, see the module.
    fn scan(&self, criterion: &dyn Criterion) -> Option<Choice> {
        let sign = criterion.sense().sign();
        let mut gradient = vec![0.0; 7];
        let mut best: Option<Choice> = None;
        // Value and slope of sign * h at a swivel of a branch; remembers the best.
        let mut probe = |branch: usize, s: f64| -> [f64; 2] {
            let sample = self.sample(branch, &self.node(branch, s));
            let Some(q) = self.arm.hold_limits(&sample.q) else { return [f64::INFINITY, 0.0] };
            let value = sign * criterion.value(&q);
            criterion.gradient(&q, &mut gradient);
            let slope = sign * gradient.iter().zip(&sample.rate).map(|(g, r)| g * r).sum::<f64>();
            if best.is_none_or(|b| value < b.value) {
                best = Some(Choice { q, swivel: wrapped(s), branch, value });
            }
            [value, slope]
        };
        let mut pieces = Vec::new();
        self.for_each_piece(|branch, a, b| pieces.push((branch, a.s, b.s)));
        for (branch, a, b) in pieces {
            let (fa, fb) = (probe(branch, a), probe(branch, b));
            let mut stack = vec![(a, fa, b, fb, 0)];
            while let Some((a, fa, b, fb, depth)) = stack.pop() {
                let (m, h) = (0.5 * (a + b), b - a);
                let fm = probe(branch, m);
                let predicted = 0.5 * (fa[0] + fb[0]) + h * (fa[1] - fb[1]) / 8.0;
                let resolved = (fm[0] - predicted).abs() <= 1e-6 * (1.0 + fm[0].abs()) && depth >= 2;
                if !resolved && depth < 24 {
                    stack.push((a, fa, m, fm, depth + 1));
                    stack.push((m, fm, b, fb, depth + 1));
                    continue;
                }
                for (a, fa, b, fb) in [(a, fa, m, fm), (m, fm, b, fb)] {
                    if fa[1] < 0.0 && fb[1] > 0.0 {
                        let (mut a, mut b) = (a, b);
                        for _ in 0..60 {
                            let m = 0.5 * (a + b);
                            if m <= a || m >= b {
                                break;
                            }
                            if probe(branch, m)[1] < 0.0 { a = m } else { b = m }
                        }
                    }
                }
            }
        }
        for branch in self.branch_indices() {
            for s in self.arcs().of(branch).into_iter().filter(|[lo, hi]| lo == hi).map(|[lo, _]| lo) {
                probe(branch, s);
            }
        }
        best
    }
}

impl Search<'_> {
    /// Takes the point when it is better than the best so far.
    fn offer(&mut self, branch: usize, sample: &Sample) {
        let inner = &self.motion.arm.inner;
        let mut q = [0.0; 7];
        let mut value = 0.0;
        for i in 0..7 {
            let spring = &self.springs[i];
            let Some(at) = nearest_winding(sample.q[i], spring.center, inner.lower[i], inner.upper[i]) else {
                return;
            };
            q[i] = at;
            value += 0.5 * spring.weight * (at - spring.center).powi(2);
        }
        if self.best.is_none_or(|b| value < b.value) {
            self.best = Some(Choice { q, swivel: wrapped(sample.s), branch, value });
        }
    }

    /// Secant steps on the slope from the best point: the bounds leave it within the gap, this leaves it at rounding.
    fn polish(&mut self) {
        let Some(start) = self.best else { return };
        let at = |s: f64| self.motion.sample(start.branch, &self.motion.node(start.branch, s));
        let (mut s0, mut s1) = (start.swivel, start.swivel + 1e-6);
        let mut d0 = self.slope(&at(s0));
        for _ in 0..4 {
            let sample = at(s1);
            let d1 = self.slope(&sample);
            if (s1 - start.swivel).abs() > 1e-2 || d1 == d0 {
                return;
            }
            if self.motion.arcs().holds(start.branch, s1) {
                self.offer(start.branch, &sample);
            }
            (s0, s1, d0) = (s1, s1 - d1 * (s1 - s0) / (d1 - d0), d1);
        }
    }

    /// The slope of the criterion at a sample, windings as in the sample.
    fn slope(&self, sample: &Sample) -> f64 {
        (0..7)
            .map(|i| {
                let JointSpring { weight, center } = self.springs[i];
                let off = sample.q[i] - center;
                weight * (off - TAU * (off / TAU).round()) * sample.rate[i]
            })
            .sum()
    }

    /// Where to divide a piece: at the zero of the slope by the secant, kept away from the ends.
    fn split(&self, piece: &Piece) -> f64 {
        let (a, b) = (self.slope(&piece.a), self.slope(&piece.b));
        let fraction = if a < 0.0 && b > 0.0 { (a / (a - b)).clamp(0.1, 0.9) } else { 0.5 };
        piece.a.s + fraction * (piece.b.s - piece.a.s)
    }

    /// A lower bound of the criterion between two samples of one piece.
    fn bound(&self, a: &Sample, b: &Sample) -> f64 {
        let inner = &self.motion.arm.inner;
        let mut by_range = 0.0;
        let mut slope = [0.0, 0.0];
        let mut at_ends = [0.0, 0.0];
        let mut one_winding = true;
        for i in 0..7 {
            let JointSpring { weight, center } = self.springs[i];
            if weight == 0.0 {
                continue;
            }
            let (low, high) = if a.q[i] <= b.q[i] { (a.q[i], b.q[i]) } else { (b.q[i], a.q[i]) };
            let (lower, upper) = (inner.lower[i], inner.upper[i]);
            let span = nearest_span(low, high, center, lower, upper);
            let distance = span.distance;
            by_range += 0.5 * weight * distance * distance;
            one_winding &= span.unique;
            // With the winding fixed: the derivative w (q - c) q' as a product of two intervals.
            let (q0, q1) = (low + span.shift - center, high + span.shift - center);
            let (r0, r1) = (a.rate[i].min(b.rate[i]), a.rate[i].max(b.rate[i]));
            let products = [q0 * r0, q0 * r1, q1 * r0, q1 * r1];
            slope[0] += weight * products.iter().copied().fold(f64::INFINITY, f64::min);
            slope[1] += weight * products.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            at_ends[0] += 0.5 * weight * (a.q[i] + span.shift - center).powi(2);
            at_ends[1] += 0.5 * weight * (b.q[i] + span.shift - center).powi(2);
        }
        if !one_winding {
            return by_range;
        }
        if slope[0] >= 0.0 || slope[1] <= 0.0 {
            // Monotone: the minimum is at an end, which has been offered.
            return at_ends[0].min(at_ends[1]).max(by_range);
        }
        // Lines of least and greatest slope from both ends meet below the function.
        let h = b.s - a.s;
        let ([fa, fb], [d0, d1]) = (at_ends, slope);
        let x = ((fa - fb + d1 * h) / (d1 - d0)).clamp(0.0, h);
        by_range.max((fa + d0 * x).min(fb - d1 * (h - x)).min(fa).min(fb))
    }
}

/// The winding of `q` within the limits that is nearest to `center`.
fn nearest_winding(q: f64, center: f64, lower: f64, upper: f64) -> Option<f64> {
    within(q + TAU * ((center - q) / TAU).round(), lower, upper)
}

struct Span {
    /// Least distance from the centre to any winding of the span within the limits.
    distance: f64,
    /// The winding that attains it, as an angle to add.
    shift: f64,
    /// True when no other winding can be chosen anywhere on the span.
    unique: bool,
}

/// Windings of `[low, high]` against the limits: which is nearest to `center`, and is it the only candidate.
fn nearest_span(low: f64, high: f64, center: f64, lower: f64, upper: f64) -> Span {
    const SLACK: f64 = 1e-9;
    let middle = 0.5 * (low + high);
    let main = ((center - middle) / TAU).round();
    let mut best = Span { distance: f64::INFINITY, shift: main * TAU, unique: true };
    let mut candidates = 0;
    for k in [main - 1.0, main, main + 1.0] {
        let shift = k * TAU;
        let (a, b) = ((low + shift).max(lower), (high + shift).min(upper));
        if a > b + SLACK {
            continue;
        }
        candidates += 1;
        let distance = (a - center).max(center - b).max(0.0);
        if distance < best.distance {
            best = Span { distance, shift, unique: true };
        }
    }
    if candidates == 0 {
        // The limits lie further away: the winding that holds them, whatever its distance.
        let k = if middle < lower { ((lower - high) / TAU).ceil() } else { ((upper - low) / TAU).floor() };
        let shift = k * TAU;
        let (a, b) = ((low + shift).max(lower), (high + shift).min(upper));
        return Span { distance: (a - center).max(center - b).max(0.0), shift, unique: true };
    }
    best.unique = candidates == 1;
    best
}

/// `end` with the winding that a monotone joint reaches from `start` when its rate has the sign of `direction`.
fn unwound(start: f64, end: f64, direction: f64) -> f64 {
    let step = wrapped(end - start);
    // A step against the direction is rounding, or more than half a turn.
    if step * direction < 0.0 && step.abs() > UNWIND_ROUNDING {
        start + step + TAU * direction.signum()
    } else {
        start + step
    }
}
