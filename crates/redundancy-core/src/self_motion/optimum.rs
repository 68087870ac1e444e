//! The best member of a circle of solutions, over all branches and feasible arcs.
//!
//! # Why it cannot be missed
//! With `x(s) = cos(middle angle)`, a sinusoid, the rates of a spherical joint that turns about the constant `t` are
//! `a' = (t_z - r x)/(1 - x^2)`, `c' = (r - t_z x)/(1 - x^2)`, `b' = -x'/sqrt(1 - x^2)`, with the constant
//! `r = t . e3`. Their zeros and extrema are roots of quadratics in x or in cos(s - s1). Cut at the zeros of the rates
//! every joint is monotone on each piece, so its range is known from the ends; cut also at the extrema of the rates,
//! so are its rate's. For a criterion `sum w_i/2 (q_i - c_i)^2` that gives on each piece
//!
//! - a lower bound from the joint ranges, windings within the limits included;
//! - the range of the derivative; where it has no zero the minimum is at an end;
//! - the bound from lines of least and greatest slope;
//! - the range of the second derivative; where it is positive the minimum is the one zero of the slope.
//!
//! Pieces that could still hold something better than the best point found are divided, best bound first, until none
//! is left: the result is the global minimum up to [`OPTIMUM_GAP`] (on a convex piece, up to rounding). A typical search looks at some 50 pieces.
//!
//! Other criteria have no such bounds. There each piece is halved until the cubic through values and slopes at its
//! ends predicts the value in the middle, and every sign change of the slope is refined.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::circle::SelfMotion;
use super::geometry::wrapped;
use super::spherical::{Range, Spherical, sphericals};
use super::srs::{Circle, signs, within};
use crate::criterion::{Criterion, JointSpring, Sense, check_dof};
use crate::error::Result;
use crate::tolerance::{GIMBAL_PASSAGE, OPTIMUM_GAP, POLISH_STEP, SLOPE_ROUNDING, UNWIND_ROUNDING};

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

/// A stretch of one branch on which all joints are monotone.
#[derive(Debug, Clone, Copy)]
struct Piece {
    branch: usize,
    a: Sample,
    b: Sample,
    /// No configuration of the piece is better.
    bound: f64,
    /// Whether the rates are monotone as well.
    rates: bool,
}

/// A piece that waits for its turn.
#[derive(Debug)]
struct Pending {
    bound: f64,
    piece: Box<Piece>,
}

impl PartialEq for Pending {
    fn eq(&self, other: &Self) -> bool {
        self.bound == other.bound
    }
}
impl Eq for Pending {}
impl PartialOrd for Pending {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Pending {
    /// The least bound is the greatest piece: it leaves the heap first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound)
    }
}

struct Search<'a> {
    motion: &'a SelfMotion,
    springs: [JointSpring; 7],
    best: Option<Choice>,
    heap: BinaryHeap<Pending>,
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
        let mut search = Search { motion: self, springs, best: None, heap: BinaryHeap::with_capacity(128) };
        self.for_each_piece(|branch, a, b| {
            let bound = search.range_bound(&a, &b).0;
            if !search.is_settled(bound) {
                search.offer(branch, &a);
                search.push(Piece { branch, a, b, bound, rates: false });
            }
        });
        search.offer_gimbals();
        let mut sphericals_of: [Option<[Spherical; 2]>; 2] = [None, None];
        // The cuts at extrema of the rates, computed when the first piece asks for them.
        let mut rate_cuts: [Option<Vec<f64>>; 2] = [None, None];
        while let Some(Pending { piece, .. }) = search.heap.pop() {
            if search.is_settled(piece.bound) {
                break;
            }
            search.offer(piece.branch, &piece.b);
            let elbow = usize::from(signs(piece.branch)[1] < 0 && !self.arm.inner.geometry.aligned);
            let joints = *sphericals_of[elbow].get_or_insert_with(|| {
                sphericals(&self.arm.inner.geometry, &self.circle, [1.0, -1.0][elbow])
            });
            if search.is_convex(&piece, &joints) {
                search.descend(&piece);
                continue;
            }
            let at = search.split(&piece);
            if piece.rates {
                search.divide(&piece, at, [true, true]);
                continue;
            }
            let cuts = rate_cuts[elbow].get_or_insert_with(|| {
                let mut cuts = Vec::with_capacity(32);
                joints.iter().for_each(|joint| joint.push_rate_cuts(&mut cuts));
                sorted_twice(cuts)
            });
            let first = cuts.partition_point(|s| *s <= piece.a.s);
            let last = cuts.partition_point(|s| *s < piece.b.s).max(first);
            // The cut nearest to where the minimum seems to be; both sides may have further ones.
            let inside = &cuts[first..last];
            let nearest =
                (0..inside.len()).min_by(|i, j| (inside[*i] - at).abs().total_cmp(&(inside[*j] - at).abs()));
            match nearest {
                None => search.divide(&piece, at, [true, true]),
                Some(i) => search.divide(&piece, inside[i], [i == 0, i + 1 == inside.len()]),
            }
        }
        search.polish();
        search.best
    }

    /// Calls `visit` for the pieces of every branch inside its feasible arcs on which all joints are monotone, and for
    /// touching points (with equal ends).
    fn for_each_piece(&self, mut visit: impl FnMut(usize, Sample, Sample)) {
        let aligned = self.arm.inner.geometry.aligned;
        let nodes = [1.0, -1.0].map(|elbow| {
            if elbow < 0.0 && aligned {
                return Vec::new();
            }
            let mut cuts = Vec::with_capacity(32);
            for joint in sphericals(&self.arm.inner.geometry, &self.circle, elbow) {
                joint.push_monotone_cuts(&mut cuts);
            }
            if cuts.len() < 2 {
                // Nothing but steady turns: keep the pieces below half a turn.
                cuts.extend([-PI, -FRAC_PI_2, 0.0, FRAC_PI_2]);
            }
            let cuts = sorted_twice(cuts);
            let mut nodes: Vec<Node> =
                cuts[..cuts.len() / 2].iter().map(|s| self.elbow_node(elbow, *s)).collect();
            nodes.extend_from_within(..);
            let half = nodes.len() / 2;
            nodes[half..].iter_mut().for_each(|n| n.s += TAU);
            nodes
        });
        for branch in self.branch_indices() {
            let nodes = &nodes[usize::from(signs(branch)[1] < 0 && !aligned)];
            for [lo, hi] in self.arcs().of(branch) {
                let mut a = self.sample(branch, &self.node(branch, lo));
                let first = nodes.partition_point(|n| n.s <= lo);
                for node in nodes[first..].iter().take_while(|n| n.s < hi) {
                    let b = follow(&a, self.sample(branch, node));
                    visit(branch, a, b);
                    a = b;
                }
                let b = follow(&a, self.sample(branch, &self.node(branch, hi)));
                visit(branch, a, b);
            }
        }
    }

    fn node(&self, branch: usize, s: f64) -> Node {
        let aligned = self.arm.inner.geometry.aligned;
        self.elbow_node(if aligned || signs(branch)[1] > 0 { 1.0 } else { -1.0 }, s)
    }

    fn elbow_node(&self, elbow: f64, s: f64) -> Node {
        let (sin, cos) = s.sin_cos();
        let (angles, rates) = self.circle.angles_and_rates(&self.arm.inner.geometry, [cos, sin], elbow);
        Node { s, angles, rates }
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
            if a == b {
                continue;
            }
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
        best
    }
}

impl Search<'_> {
    /// True when nothing better than the best point by more than the gap can have this bound.
    fn is_settled(&self, bound: f64) -> bool {
        self.best.is_some_and(|best| bound >= best.value - OPTIMUM_GAP * (1.0 + best.value.abs()))
    }

    /// Keeps the piece when it may hold something better.
    fn push(&mut self, piece: Piece) {
        if !self.is_settled(piece.bound) {
            self.heap.push(Pending { bound: piece.bound, piece: Box::new(piece) });
        }
    }

    /// Replaces a piece by its two parts at `s`; `rates` tells on which of them the rates are monotone.
    fn divide(&mut self, piece: &Piece, s: f64, rates: [bool; 2]) {
        if s <= piece.a.s || s >= piece.b.s {
            return;
        }
        let middle = self.between(piece, s);
        self.offer(piece.branch, &middle);
        for ((a, b), rates) in [(piece.a, middle), (middle, piece.b)].into_iter().zip(rates) {
            let bound = if rates { self.bound(&a, &b) } else { self.range_bound(&a, &b).0 };
            self.push(Piece { branch: piece.branch, a, b, bound: bound.max(piece.bound), rates });
        }
    }

    /// Takes the point when it is better than the best so far.
    fn offer(&mut self, branch: usize, sample: &Sample) {
        self.offer_q(branch, sample.s, &sample.q);
    }

    /// Takes `q` over swivel `s`, each joint in its best winding, when it is better than the best so far; returns its
    /// value (infinite when no winding holds the limits).
    fn offer_q(&mut self, branch: usize, s: f64, q: &[f64; 7]) -> f64 {
        let inner = &self.motion.arm.inner;
        let (mut wound, mut value) = ([0.0; 7], 0.0);
        for i in 0..7 {
            let JointSpring { weight, center } = self.springs[i];
            let Some(at) = nearest_winding(q[i], center, inner.lower[i], inner.upper[i]) else {
                return f64::INFINITY;
            };
            wound[i] = at;
            value += 0.5 * weight * (at - center).powi(2);
        }
        if self.best.is_none_or(|b| value < b.value) {
            self.best = Some(Choice { q: wound, swivel: wrapped(s), branch, value });
        }
        value
    }

    /// Offers what the branches cannot hold: at a gimbal the outer joints of a spherical joint may share their sum in any
    /// way, a line of configurations over one swivel. Where the swivel does not leave the gimbal (shoulder or wrist
    /// stretched out along its neighbours) the best swivel is sampled and refined, not proven.
    fn offer_gimbals(&mut self) {
        const SAMPLES: usize = 72;
        let motion = self.motion;
        let aligned = motion.arm.inner.geometry.aligned;
        for (e, elbow) in [1.0, -1.0].into_iter().take(if aligned { 1 } else { 2 }).enumerate() {
            let joints = sphericals(&motion.arm.inner.geometry, &motion.circle, elbow);
            let locked = joints.iter().any(|j| j.locked);
            let passages: Vec<f64> = joints.iter().flat_map(Spherical::gimbals).collect();
            if !locked && passages.is_empty() {
                continue;
            }
            for branch in motion.branch_indices().filter(|b| aligned || usize::from(signs(*b)[1] < 0) == e) {
                for s in &passages {
                    self.offer_family(branch, *s);
                }
                if !locked {
                    continue;
                }
                let step = TAU / SAMPLES as f64;
                let mut best = (f64::INFINITY, 0.0);
                for k in 0..SAMPLES {
                    let s = step * k as f64 - PI;
                    let value = self.offer_family(branch, s);
                    best = if value < best.0 { (value, s) } else { best };
                }
                let mut width = step;
                while best.0.is_finite() && width > SLOPE_ROUNDING {
                    for s in [best.1 - width, best.1 + width] {
                        let value = self.offer_family(branch, s);
                        best = if value < best.0 { (value, s) } else { best };
                    }
                    width *= 0.7;
                }
            }
        }
    }

    /// Offers the best way to share the sum of the outer joints at swivel `s`, for joints at their gimbal there, and
    /// returns its value (infinite when no way holds the limits).
    fn offer_family(&mut self, branch: usize, s: f64) -> f64 {
        let inner = &self.motion.arm.inner;
        let sample = self.motion.sample(branch, &self.motion.node(branch, s));
        let mut q = sample.q;
        let cost = |i: usize, q: f64| 0.5 * self.springs[i].weight * (q - self.springs[i].center).powi(2);
        for first in [0, 4] {
            let (middle, third) = (first + 1, first + 2);
            let (sin, cos) =
                (inner.geometry.sign[middle] * (sample.q[middle] - inner.geometry.zero[middle])).sin_cos();
            if sin.abs() > GIMBAL_PASSAGE {
                continue;
            }
            // What the first joint gains the third one loses, or gains as well when the middle angle is pi.
            let ratio =
                inner.geometry.sign[first] * inner.geometry.sign[third] * if cos > 0.0 { 1.0 } else { -1.0 };
            let (w, v) = (self.springs[first].weight, self.springs[third].weight);
            let mut best = f64::INFINITY;
            for turns in -2..=2 {
                let (x, y) = (sample.q[first], sample.q[third] + TAU * f64::from(turns));
                let (a, b) = ((y - inner.lower[third]) * ratio, (y - inner.upper[third]) * ratio);
                let low = (inner.lower[first] - x).max(a.min(b));
                let high = (inner.upper[first] - x).min(a.max(b));
                if low > high {
                    continue;
                }
                let wish =
                    w * (self.springs[first].center - x) + v * ratio * (y - self.springs[third].center);
                let t = if w + v > 0.0 { wish / (w + v) } else { 0.0 }.clamp(low, high);
                let total = cost(first, x + t) + cost(third, y - ratio * t);
                if total < best {
                    best = total;
                    (q[first], q[third]) = (x + t, y - ratio * t);
                }
            }
        }
        self.offer_q(branch, s, &q)
    }

    /// True when the criterion is strictly convex on the piece, by the ranges of
    /// `sum w (q'^2 + (q - c) q'')`: its minimum there is where the slope vanishes, or at an end.
    fn is_convex(&self, piece: &Piece, joints: &[Spherical; 2]) -> bool {
        let (_, shifts, unique) = self.range_bound(&piece.a, &piece.b);
        if !unique {
            return false;
        }
        let geometry = &self.motion.arm.inner.geometry;
        let [s2, _, s6] = signs(piece.branch).map(f64::from);
        let mut least = 0.0;
        for (joint, (first, turned)) in joints.iter().zip([(0, s2), (4, s6)]) {
            // cos of the middle angle and its rate at both ends.
            let middle = first + 1;
            let sign = geometry.sign[middle];
            let ends = [&piece.a, &piece.b].map(|s| {
                let (sin, cos) = (sign * (s.q[middle] - geometry.zero[middle])).sin_cos();
                (cos, -sin * sign * s.rate[middle])
            });
            let Some(curvatures) = joint.curvatures([ends[0].0, ends[1].0], [ends[0].1, ends[1].1]) else {
                return false;
            };
            for (k, curvature) in curvatures.into_iter().enumerate() {
                let i = first + k;
                let JointSpring { weight, center } = self.springs[i];
                let sign = geometry.sign[i] * if k == 1 { turned } else { 1.0 };
                let off = Range::of(piece.a.q[i] + shifts[i] - center, piece.b.q[i] + shifts[i] - center);
                // Without monotone rates zero is the safe least square.
                let square =
                    if piece.rates { Range::of(piece.a.rate[i], piece.b.rate[i]).squared().0 } else { 0.0 };
                least += weight * (square + off.times(curvature).times(Range(sign, sign)).0);
            }
        }
        least > 0.0
    }

    /// Offers the minimum of a convex piece, whose ends have been offered (Illinois' rule on the slope).
    fn descend(&mut self, piece: &Piece) {
        let shifts = self.range_bound(&piece.a, &piece.b).1;
        let (mut a, mut b) = (piece.a.s, piece.b.s);
        let (mut da, mut db) = (self.slope(&piece.a, &shifts), self.slope(&piece.b, &shifts));
        let mut last = 0.0;
        for _ in 0..60 {
            if da >= 0.0 || db <= 0.0 {
                return;
            }
            let s = a + da / (da - db) * (b - a);
            if s <= a || s >= b {
                return;
            }
            let middle = self.between(piece, s);
            self.offer(piece.branch, &middle);
            let slope = self.slope(&middle, &shifts);
            if slope.abs() <= SLOPE_ROUNDING || b - a <= SLOPE_ROUNDING {
                return;
            }
            if slope < 0.0 {
                (a, da) = (s, slope);
                db *= if last < 0.0 { 0.5 } else { 1.0 };
            } else {
                (b, db) = (s, slope);
                da *= if last > 0.0 { 0.5 } else { 1.0 };
            }
            last = slope;
        }
    }

    /// Secant steps on the slope from the best point, for when the gap was reached before a convex piece was.
    fn polish(&mut self) {
        let Some(start) = self.best else { return };
        let at = |s: f64| self.motion.sample(start.branch, &self.motion.node(start.branch, s));
        let first = at(start.swivel);
        let shifts = std::array::from_fn(|i| TAU * turns(start.q[i] - first.q[i]));
        let (mut s0, mut d0) = (start.swivel, self.slope(&first, &shifts));
        let mut s1 = s0 + POLISH_STEP;
        for _ in 0..4 {
            let sample = at(s1);
            let d1 = self.slope(&sample, &shifts);
            if d0.abs() <= SLOPE_ROUNDING || d1 == d0 || !self.motion.arcs().holds(start.branch, s1) {
                return;
            }
            self.offer(start.branch, &sample);
            (s0, s1, d0) = (s1, s1 - d1 * (s1 - s0) / (d1 - d0), d1);
        }
    }

    /// The sample of the piece's branch at `s` between its ends, unwound like them.
    fn between(&self, piece: &Piece, s: f64) -> Sample {
        let mut sample = self.motion.sample(piece.branch, &self.motion.node(piece.branch, s));
        for i in 0..7 {
            // The joint is monotone on the piece: its value lies between those at the ends.
            sample.q[i] += TAU * turns(0.5 * (piece.a.q[i] + piece.b.q[i]) - sample.q[i]);
        }
        sample
    }

    /// The slope of the criterion at a sample in the windings `shifts`.
    fn slope(&self, sample: &Sample, shifts: &[f64; 7]) -> f64 {
        let term = |i: usize| self.springs[i].weight * (sample.q[i] + shifts[i] - self.springs[i].center);
        (0..7).map(|i| term(i) * sample.rate[i]).sum()
    }

    /// Where to divide a piece: at the zero of the slope by the secant, kept away from the ends.
    fn split(&self, piece: &Piece) -> f64 {
        let shifts = self.range_bound(&piece.a, &piece.b).1;
        let (a, b) = (self.slope(&piece.a, &shifts), self.slope(&piece.b, &shifts));
        let fraction = if a < 0.0 && b > 0.0 { (a / (a - b)).clamp(0.1, 0.9) } else { 0.5 };
        piece.a.s + fraction * (piece.b.s - piece.a.s)
    }

    /// A lower bound between two samples of a piece from the ranges of the joints, the windings (as angles to add) that
    /// attain it, and whether no other windings come into question.
    fn range_bound(&self, a: &Sample, b: &Sample) -> (f64, [f64; 7], bool) {
        let inner = &self.motion.arm.inner;
        let (mut bound, mut shifts, mut unique) = (0.0, [0.0; 7], true);
        for i in 0..7 {
            let JointSpring { weight, center } = self.springs[i];
            let (low, high) = if a.q[i] <= b.q[i] { (a.q[i], b.q[i]) } else { (b.q[i], a.q[i]) };
            let span = nearest_span(low, high, center, inner.lower[i], inner.upper[i]);
            bound += 0.5 * weight * span.distance * span.distance;
            shifts[i] = span.shift;
            unique &= span.unique || weight == 0.0;
        }
        (bound, shifts, unique)
    }

    /// A lower bound between two samples of a piece whose rates are monotone.
    fn bound(&self, a: &Sample, b: &Sample) -> f64 {
        let (by_range, shifts, unique) = self.range_bound(a, b);
        if !unique {
            return by_range;
        }
        // With the windings fixed: the derivative is a sum of products of two intervals, w (q - c) and q'.
        let (mut slope, mut ends) = ([0.0, 0.0], [0.0, 0.0]);
        for i in 0..7 {
            let JointSpring { weight, center } = self.springs[i];
            let (qa, qb) = (a.q[i] + shifts[i] - center, b.q[i] + shifts[i] - center);
            let products = [qa * a.rate[i], qa * b.rate[i], qb * a.rate[i], qb * b.rate[i]];
            slope[0] += weight * products[0].min(products[1]).min(products[2].min(products[3]));
            slope[1] += weight * products[0].max(products[1]).max(products[2].max(products[3]));
            ends[0] += 0.5 * weight * qa * qa;
            ends[1] += 0.5 * weight * qb * qb;
        }
        let ([fa, fb], [d0, d1]) = (ends, slope);
        if d0 >= 0.0 || d1 <= 0.0 {
            // Monotone: the minimum is at an end, which has been offered.
            return fa.min(fb).max(by_range);
        }
        // The line of least slope from a and that of greatest slope to b meet below the function.
        let h = b.s - a.s;
        let x = ((fa - fb + d1 * h) / (d1 - d0)).clamp(0.0, h);
        by_range.max((fa + d0 * x).min(fb - d1 * (h - x)))
    }
}

/// The winding of `q` within the limits that is nearest to `center`.
pub(crate) fn nearest_winding(q: f64, center: f64, lower: f64, upper: f64) -> Option<f64> {
    within(q + TAU * turns(center - q), lower, upper)
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
    let distance = |shift: f64, a: f64, b: f64| (a + shift - center).max(center - b - shift).max(0.0);
    let main = turns(center - 0.5 * (low + high));
    let shift = TAU * main;
    let (a, b) = (low + shift, high + shift);
    // Nearer to the centre than any other winding, everywhere, and within the limits: the common case.
    if a >= lower && b <= upper && a >= center - PI && b <= center + PI {
        return Span { distance: distance(shift, low, high), shift, unique: true };
    }
    // Windings of which some part is within the limits.
    let first = ((lower - high - UNWIND_ROUNDING) / TAU).ceil();
    let last = ((upper - low + UNWIND_ROUNDING) / TAU).floor();
    let nearest = main.max(first).min(last);
    let clipped = |k: f64| distance(0.0, (low + TAU * k).max(lower), (high + TAU * k).min(upper));
    let mut best = Span { distance: clipped(nearest), shift: TAU * nearest, unique: true };
    for k in [nearest - 1.0, nearest + 1.0] {
        if k >= first && k <= last {
            best.unique = false;
            best.distance = best.distance.min(clipped(k));
        }
    }
    best
}

/// Sorted, without repeats, and once more a turn further on: arcs that cross pi find their cuts in one run.
fn sorted_twice(mut cuts: Vec<f64>) -> Vec<f64> {
    cuts.sort_unstable_by(f64::total_cmp);
    cuts.dedup();
    let n = cuts.len();
    cuts.extend_from_within(..);
    cuts[n..].iter_mut().for_each(|s| *s += TAU);
    cuts
}

/// The number of whole turns nearest to an angle (of moderate size).
#[inline(always)]
fn turns(angle: f64) -> f64 {
    const PER_RADIAN: f64 = 1.0 / TAU;
    let x = angle * PER_RADIAN;
    f64::from((x + 0.5_f64.copysign(x)) as i32)
}

/// `b` with the windings that monotone joints reach from `a`.
fn follow(a: &Sample, mut b: Sample) -> Sample {
    for i in 0..7 {
        b.q[i] = unwound(a.q[i], b.q[i], a.rate[i] + b.rate[i]);
    }
    b
}

/// `end` with the winding that a monotone joint reaches from `start` when its rate has the sign of `direction`.
fn unwound(start: f64, end: f64, direction: f64) -> f64 {
    let step = (end - start) - TAU * turns(end - start);
    // A step against the direction is rounding, or more than half a turn.
    if step * direction < 0.0 && step.abs() > UNWIND_ROUNDING {
        start + step + TAU * direction.signum()
    } else {
        start + step
    }
}
