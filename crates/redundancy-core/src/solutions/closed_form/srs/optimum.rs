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
//! The search begins with the stretches between neighbouring cuts. The two signs of a middle angle turn or negate its
//! joint's angles, so two rows of joint ranges per stretch bound all eight branches; the ends of feasible arcs are
//! evaluated only where a stretch's turn comes. Pieces that could still hold something better than the best point
//! found are divided, best bound first, until none is left: the result is the global minimum up to [`OPTIMUM_GAP`] (on
//! a convex piece, up to rounding). A typical search weighs 60 stretches and evaluates the arm at some 30 swivels.
//!
//! Other criteria have no such bounds. There each piece is halved until the cubic through values and slopes at its
//! ends predicts the value in the middle, and every sign change of the slope is refined.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, PI};

use super::arm::{Circle, Node, signs};
use super::circle::SelfMotion;
use super::spherical::{Range, Spherical, greater, lesser, sphericals};
use crate::criterion::{Criterion, JointSpring, Sense, check_dof};
use crate::error::Result;
use crate::joint_space::{TURN, monotone, nearest, nearest_span, shift, turned, within, wrap};
use crate::solutions::ClosedForm;
use crate::tolerance::{GIMBAL_PASSAGE, OPTIMUM_GAP, POLISH_STEP, SLOPE_ROUNDING};

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
    /// Whether no configuration over the pose is better: false for the best of a finite search.
    pub proven: bool,
}

/// Seven joints and a lane of padding: loops over it become whole vectors.
type Row = [f64; 8];

/// A [`Row`] that ends with `padding`.
fn row(joints: &[f64; 7], padding: f64) -> Row {
    let mut out = [padding; 8];
    out[..7].copy_from_slice(joints);
    out
}

/// One branch at a swivel; joint values are unwound by the caller.
#[derive(Debug, Clone, Copy)]
struct Sample {
    s: f64,
    q: Row,
    rate: Row,
    /// As in [`Node`].
    cosine: [f64; 2],
    /// As in [`Node`].
    cosine_rate: [f64; 2],
}

/// What the ranges of the joints say about a stretch.
#[derive(Debug, Clone, Copy)]
struct Ranges {
    /// No configuration is better.
    bound: f64,
    /// The windings that attain the bound, as angles to add.
    shifts: Row,
    /// No other windings come into question.
    unique: bool,
}

/// A stretch of one branch on which all joints are monotone.
#[derive(Debug, Clone, Copy)]
struct Piece {
    branch: usize,
    a: Sample,
    b: Sample,
    ranges: Ranges,
    /// No configuration of the piece is better.
    bound: f64,
    /// Whether the rates are monotone as well.
    rates: bool,
}

/// A stretch of a feasible arc between neighbouring cuts, or a touching point (equal ends), before it is evaluated.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    branch: usize,
    lo: f64,
    hi: f64,
    /// The cut before `lo`, counted over one turn.
    cut: usize,
}

/// What waits for its turn.
#[derive(Debug, Clone, Copy)]
enum Part {
    Stretch(Stretch),
    /// Index into [`Search::pieces`].
    Piece(usize),
}

/// A part of a branch that waits for its turn.
#[derive(Debug)]
struct Pending {
    bound: f64,
    part: Part,
}

impl PartialEq for Pending {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Pending {}
impl PartialOrd for Pending {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Pending {
    /// The least bound is the greatest part: it leaves the heap first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound)
    }
}

/// The criterion and the limits, joint by joint; the padding weighs nothing and is not limited.
struct Springs {
    weight: Row,
    center: Row,
    lower: Row,
    upper: Row,
}

/// The cuts of one elbow sign.
struct Elbow {
    joints: [Spherical; 2],
    /// The swivels at which a joint stops being monotone, in `(-pi, pi]`.
    nodes: Vec<Node>,
    /// The cuts at extrema of the rates, twice around, computed when the first piece asks for them.
    rate_cuts: Option<Vec<f64>>,
}

struct Search<'a> {
    motion: &'a SelfMotion,
    springs: Springs,
    best: Option<Choice>,
    heap: BinaryHeap<Pending>,
    /// Pieces in the heap, and free places among them.
    pieces: Vec<Piece>,
    free: Vec<usize>,
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
        let mut elbows = self.elbows();
        let mut search = Search::new(self, &springs);
        search.push_stretches(&elbows);
        search.offer_gimbals(&elbows);
        while let Some(Pending { bound, part }) = search.heap.pop() {
            if search.is_settled(bound) {
                break;
            }
            let piece = match part {
                Part::Piece(index) => search.take(index),
                Part::Stretch(stretch) => match search.evaluated(&stretch, &elbows) {
                    // Others may be more promising than it has turned out to be.
                    Some(piece) if search.heap.peek().is_some_and(|next| next.bound < piece.bound) => {
                        search.push(piece);
                        continue;
                    }
                    Some(piece) => piece,
                    None => continue,
                },
            };
            let elbow = &mut elbows[self.elbow_of(piece.branch)];
            if search.is_convex(&piece, &elbow.joints) {
                search.descend(&piece);
                continue;
            }
            let at = search.split(&piece);
            if piece.rates {
                search.divide(&piece, at, [true, true]);
                continue;
            }
            let joints = &elbow.joints;
            let cuts = elbow.rate_cuts.get_or_insert_with(|| {
                let mut cuts = Vec::with_capacity(32);
                joints.iter().for_each(|joint| joint.push_rate_cuts(&mut cuts));
                sorted(&mut cuts);
                cuts.extend_from_within(..);
                let half = cuts.len() / 2;
                cuts[half..].iter_mut().for_each(|s| *s = turned(*s, 1.0));
                cuts
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
        // Where the swivel stays in a gimbal, how the outer joints share their sum is sampled.
        let proven =
            self.arm.exact() && !elbows.iter().flat_map(|elbow| &elbow.joints).any(|joint| joint.locked);
        search.best.map(|best| Choice { proven, ..best })
    }

    /// Which of [`SelfMotion::elbows`] a branch belongs to.
    fn elbow_of(&self, branch: usize) -> usize {
        usize::from(signs(branch)[1] < 0 && !self.arm.inner.geometry.aligned)
    }

    /// The elbow signs that have their own cuts: without an elbow offset the other elbow turns joints 3 and 5 by pi.
    fn elbows(&self) -> Vec<Elbow> {
        let geometry = &self.arm.inner.geometry;
        let signs: &[f64] = if geometry.aligned { &[1.0] } else { &[1.0, -1.0] };
        let elbow = |sign: &f64| {
            let joints = sphericals(geometry, &self.circle, *sign);
            let mut cuts = Vec::with_capacity(16);
            joints.iter().for_each(|joint| joint.push_monotone_cuts(&mut cuts));
            if cuts.len() < 2 {
                // Nothing but steady turns: keep the pieces below half a turn.
                cuts.extend([-PI, -FRAC_PI_2, 0.0, FRAC_PI_2]);
            }
            sorted(&mut cuts);
            let nodes = cuts.into_iter().map(|s| self.elbow_node(*sign, s)).collect();
            Elbow { joints, nodes, rate_cuts: None }
        };
        signs.iter().map(elbow).collect()
    }

    /// Calls `visit` for the stretches of every feasible arc on which all joints are monotone, and for touching points.
    fn for_each_stretch(&self, elbows: &[Elbow], mut visit: impl FnMut(Stretch)) {
        for branch in self.branch_indices() {
            let nodes = &elbows[self.elbow_of(branch)].nodes;
            let n = nodes.len();
            let at = |i: usize| turned(nodes[i % n].s, (i / n) as f64);
            for [mut lo, mut hi] in self.arcs().of(branch) {
                if hi - lo >= TURN {
                    // A full circle begins anywhere.
                    (lo, hi) = (at(0), at(n));
                }
                let mut i = nodes.partition_point(|n| n.s <= lo);
                loop {
                    let end = at(i);
                    let stretch = Stretch { branch, lo, hi: end.min(hi), cut: (i + n - 1) % n };
                    visit(stretch);
                    if end >= hi {
                        break;
                    }
                    (lo, i) = (end, i + 1);
                }
            }
        }
    }

    fn node(&self, branch: usize, s: f64) -> Node {
        let aligned = self.arm.inner.geometry.aligned;
        self.elbow_node(if aligned || signs(branch)[1] > 0 { 1.0 } else { -1.0 }, s)
    }

    fn elbow_node(&self, elbow: f64, s: f64) -> Node {
        let (sin, cos) = s.sin_cos();
        self.circle.node(&self.arm.inner.geometry, s, [cos, sin], elbow)
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
        let Node { s, cosine, cosine_rate, .. } = *node;
        Sample { s, q: row(&q, 0.0), rate: row(&rate, 0.0), cosine, cosine_rate }
    }

    /// Optimum of a criterion without bounds, see the module.
    fn scan(&self, criterion: &dyn Criterion) -> Option<Choice> {
        let sign = criterion.sense().sign();
        let mut gradient = vec![0.0; 7];
        let mut best: Option<Choice> = None;
        // Value and slope of sign * h at a swivel of a branch; remembers the best.
        let mut probe = |branch: usize, s: f64| -> [f64; 2] {
            let sample = self.sample(branch, &self.node(branch, s));
            let Some(q) = self.arm.hold_limits(&joints(&sample.q)) else { return [f64::INFINITY, 0.0] };
            let value = sign * criterion.value(&q);
            criterion.gradient(&q, &mut gradient);
            let slope = sign * gradient.iter().zip(&sample.rate).map(|(g, r)| g * r).sum::<f64>();
            if best.is_none_or(|b| value < b.value) {
                best = Some(Choice { q, swivel: wrap(s), branch, value, proven: false });
            }
            [value, slope]
        };
        let mut pieces = Vec::new();
        self.for_each_stretch(&self.elbows(), |s| pieces.push((s.branch, s.lo, s.hi)));
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

impl<'a> Search<'a> {
    fn new(motion: &'a SelfMotion, springs: &[JointSpring; 7]) -> Self {
        let inner = &motion.arm.inner;
        let springs = Springs {
            weight: row(&springs.map(|s| s.weight), 0.0),
            center: row(&springs.map(|s| s.center), 0.0),
            lower: row(&inner.lower, f64::NEG_INFINITY),
            upper: row(&inner.upper, f64::INFINITY),
        };
        Self { motion, springs, best: None, heap: BinaryHeap::new(), pieces: Vec::new(), free: Vec::new() }
    }

    /// True when nothing better than the best point by more than the gap can have this bound.
    fn is_settled(&self, bound: f64) -> bool {
        let better = |best: Choice| bound < best.value - OPTIMUM_GAP * (1.0 + best.value.abs());
        // Where the values overflow nothing compares as better.
        self.best.is_some_and(|best| !better(best))
    }

    /// Weighs all stretches by the ranges of the joints between the cuts.
    fn push_stretches(&mut self, elbows: &[Elbow]) {
        let aligned = self.motion.arm.inner.geometry.aligned;
        let costs: Vec<Vec<[Row; 2]>> = elbows
            .iter()
            .map(|Elbow { nodes, .. }| {
                (0..nodes.len()).map(|i| self.costs(&nodes[i], &nodes[(i + 1) % nodes.len()])).collect()
            })
            .collect();
        let turned = std::array::from_fn::<_, 8, _>(|branch| turned_joints(aligned, branch));
        let mut list = Vec::with_capacity(80);
        self.motion.for_each_stretch(elbows, |stretch| {
            let costs = &costs[self.motion.elbow_of(stretch.branch)][stretch.cut];
            let bound = (0..7).map(|i| costs[turned[stretch.branch][i]][i]).sum();
            list.push(Pending { bound, part: Part::Stretch(stretch) });
        });
        self.heap = BinaryHeap::from(list);
    }

    /// Least cost of every joint between neighbouring cuts, in any winding: as it is in branch +++, and turned by pi (a
    /// middle joint, and the elbow: negated).
    fn costs(&self, a: &Node, b: &Node) -> [Row; 2] {
        let geometry = &self.motion.arm.inner.geometry;
        let (sign, zero) = (row(&geometry.sign, 1.0), row(&geometry.zero, 0.0));
        let (a, b, ra, rb) =
            (row(&a.angles, 0.0), row(&b.angles, 0.0), row(&a.rates, 0.0), row(&b.rates, 0.0));
        let Springs { weight, center, .. } = &self.springs;
        [(&[1.0; 8], &[0.0; 8]), (&NEGATED, &TURNED)].map(|(factor, turn)| {
            let mut cost = [0.0; 8];
            for i in 0..8 {
                let factor = sign[i] * factor[i];
                let zero = zero[i] + turn[i];
                let (qa, qb) = (factor * a[i] + zero, factor * b[i] + zero);
                let qb = monotone(qa, qb, factor * (ra[i] + rb[i]));
                let (low, high) = (lesser(qa, qb), greater(qa, qb));
                // Whatever the limits: the nearest winding may be outside of them, which makes the bound no better.
                let turns = shift(center[i] - 0.5 * (low + high));
                let off = greater(greater(low + turns - center[i], center[i] - high - turns), 0.0);
                cost[i] = 0.5 * weight[i] * off * off;
            }
            cost
        })
    }

    /// The piece of a stretch; its ends are offered. `None` when nothing better is left in it.
    fn evaluated(&mut self, stretch: &Stretch, elbows: &[Elbow]) -> Option<Piece> {
        let Stretch { branch, lo, hi, cut } = *stretch;
        let nodes = &elbows[self.motion.elbow_of(branch)].nodes;
        // An end is a cut, in this turn or the next, or the end of an arc.
        let at = |s: f64, i: usize| {
            let node = &nodes[i % nodes.len()];
            let known = s == node.s || s == turned(node.s, 1.0);
            let mut sample = if known {
                self.motion.sample(branch, node)
            } else {
                self.motion.sample(branch, &self.motion.node(branch, s))
            };
            sample.s = s;
            sample
        };
        let a = at(lo, cut);
        if lo == hi {
            self.offer(branch, &a);
            return None;
        }
        let b = follow(&a, at(hi, cut + 1));
        self.offer(branch, &a);
        self.offer(branch, &b);
        let ranges = self.ranges(&a, &b)?;
        let piece = Piece { branch, a, b, ranges, bound: ranges.bound, rates: false };
        (!self.is_settled(piece.bound)).then_some(piece)
    }

    /// Keeps the piece when it may hold something better.
    fn push(&mut self, piece: Piece) {
        if self.is_settled(piece.bound) {
            return;
        }
        let bound = piece.bound;
        let index = match self.free.pop() {
            Some(index) => {
                self.pieces[index] = piece;
                index
            }
            None => {
                self.pieces.push(piece);
                self.pieces.len() - 1
            }
        };
        self.heap.push(Pending { bound, part: Part::Piece(index) });
    }

    /// The piece of that index, whose place becomes free.
    fn take(&mut self, index: usize) -> Piece {
        self.free.push(index);
        self.pieces[index]
    }

    /// Replaces a piece by its two parts at `s`; `rates` tells on which of them the rates are monotone.
    fn divide(&mut self, piece: &Piece, s: f64, rates: [bool; 2]) {
        if s <= piece.a.s || s >= piece.b.s {
            return;
        }
        let middle = self.between(piece, s);
        self.offer(piece.branch, &middle);
        for ((a, b), rates) in [(&piece.a, &middle), (&middle, &piece.b)].into_iter().zip(rates) {
            let Some(ranges) = self.ranges(a, b) else { continue };
            let bound = if rates { self.bound(a, b, &ranges) } else { ranges.bound };
            let bound = greater(bound, piece.bound);
            if !self.is_settled(bound) {
                self.push(Piece { branch: piece.branch, a: *a, b: *b, ranges, bound, rates });
            }
        }
    }

    /// Takes the point when it is better than the best so far.
    fn offer(&mut self, branch: usize, sample: &Sample) {
        self.offer_q(branch, sample.s, &sample.q);
    }

    /// Takes `q` over swivel `s`, each joint in its best winding, when it is better than the best so far; returns its
    /// value (infinite when no winding holds the limits).
    fn offer_q(&mut self, branch: usize, s: f64, q: &Row) -> f64 {
        let Springs { weight, center, lower, upper } = &self.springs;
        let (mut wound, mut value, mut inside) = ([0.0; 8], 0.0, true);
        for i in 0..8 {
            wound[i] = nearest(q[i], center[i]);
            inside &= (wound[i] >= lower[i]) & (wound[i] <= upper[i]);
        }
        if !inside {
            for i in 0..7 {
                match within(wound[i], lower[i], upper[i]) {
                    Some(held) => wound[i] = held,
                    None => return f64::INFINITY,
                }
            }
        }
        for i in 0..8 {
            value += 0.5 * weight[i] * (wound[i] - center[i]) * (wound[i] - center[i]);
        }
        if self.best.is_none_or(|b| value < b.value) {
            self.best = Some(Choice { q: joints(&wound), swivel: wrap(s), branch, value, proven: false });
        }
        value
    }

    /// Offers what the branches cannot hold: at a gimbal the outer joints of a spherical joint may share their sum in any
    /// way, a line of configurations over one swivel. Where the swivel does not leave the gimbal (shoulder or wrist
    /// stretched out along its neighbours) the best swivel is sampled and refined, not proven.
    fn offer_gimbals(&mut self, elbows: &[Elbow]) {
        const SAMPLES: usize = 72;
        let motion = self.motion;
        for (e, Elbow { joints, .. }) in elbows.iter().enumerate() {
            let locked = joints.iter().any(|j| j.locked);
            let passages: Vec<f64> = joints.iter().flat_map(Spherical::gimbals).collect();
            if !locked && passages.is_empty() {
                continue;
            }
            for branch in motion.branch_indices().filter(|b| motion.elbow_of(*b) == e) {
                for s in &passages {
                    self.offer_family(branch, *s);
                }
                if !locked {
                    continue;
                }
                let step = TURN / SAMPLES as f64;
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
        let Springs { weight, center, .. } = &self.springs;
        let cost = |i: usize, q: f64| 0.5 * weight[i] * (q - center[i]).powi(2);
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
            let (w, v) = (weight[first], weight[third]);
            let mut best = f64::INFINITY;
            for turns in -2..=2 {
                let (x, y) = (sample.q[first], turned(sample.q[third], f64::from(turns)));
                let (a, b) = ((y - inner.lower[third]) * ratio, (y - inner.upper[third]) * ratio);
                let low = (inner.lower[first] - x).max(a.min(b));
                let high = (inner.upper[first] - x).min(a.max(b));
                if low > high {
                    continue;
                }
                let wish = w * (center[first] - x) + v * ratio * (y - center[third]);
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
        let Piece { a, b, ranges, .. } = piece;
        if !ranges.unique {
            return false;
        }
        let geometry = &self.motion.arm.inner.geometry;
        let [s2, _, s6] = signs(piece.branch).map(f64::from);
        let mut least = 0.0;
        for (k, (joint, (first, turned))) in joints.iter().zip([(0, s2), (4, s6)]).enumerate() {
            let (x, dx) = ([a.cosine[k], b.cosine[k]], [a.cosine_rate[k], b.cosine_rate[k]]);
            let Some(curvatures) = joint.curvatures(x, dx) else {
                return false;
            };
            for (k, curvature) in curvatures.into_iter().enumerate() {
                let i = first + k;
                let sign = geometry.sign[i] * if k == 1 { turned } else { 1.0 };
                let pull = ranges.shifts[i] - self.springs.center[i];
                let off = Range::of(sign * (a.q[i] + pull), sign * (b.q[i] + pull));
                // Without monotone rates zero is the safe least square.
                let square = if piece.rates { Range::of(a.rate[i], b.rate[i]).squared().0 } else { 0.0 };
                least += self.springs.weight[i] * (square + off.times(curvature).0);
            }
        }
        least > 0.0
    }

    /// Offers the minimum of a convex piece, whose ends have been offered (Illinois' rule on the slope).
    fn descend(&mut self, piece: &Piece) {
        let shifts = &piece.ranges.shifts;
        let (mut a, mut b) = (piece.a.s, piece.b.s);
        let (mut da, mut db) = (self.slope(&piece.a, shifts), self.slope(&piece.b, shifts));
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
            let slope = self.slope(&middle, shifts);
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
        let mut shifts = [0.0; 8];
        for i in 0..7 {
            shifts[i] = shift(start.q[i] - first.q[i]);
        }
        let (mut s0, mut d0) = (start.swivel, self.slope(&first, &shifts));
        let mut s1 = s0 + POLISH_STEP;
        for _ in 0..4 {
            if d0.abs() <= SLOPE_ROUNDING || !self.motion.arcs().holds(start.branch, s1) {
                return;
            }
            let sample = at(s1);
            let d1 = self.slope(&sample, &shifts);
            if d1 == d0 {
                return;
            }
            self.offer(start.branch, &sample);
            (s0, s1, d0) = (s1, s1 - d1 * (s1 - s0) / (d1 - d0), d1);
        }
    }

    /// The sample of the piece's branch at `s` between its ends, unwound like them.
    fn between(&self, piece: &Piece, s: f64) -> Sample {
        let mut sample = self.motion.sample(piece.branch, &self.motion.node(piece.branch, s));
        for i in 0..8 {
            // The joint is monotone on the piece: its value lies between those at the ends.
            sample.q[i] = nearest(sample.q[i], 0.5 * (piece.a.q[i] + piece.b.q[i]));
        }
        sample
    }

    /// The slope of the criterion at a sample in the windings `shifts`.
    fn slope(&self, sample: &Sample, shifts: &Row) -> f64 {
        let Springs { weight, center, .. } = &self.springs;
        let mut sum = 0.0;
        for i in 0..8 {
            sum += weight[i] * (sample.q[i] + shifts[i] - center[i]) * sample.rate[i];
        }
        sum
    }

    /// Where to divide a piece: at the zero of the slope by the secant, kept away from the ends.
    fn split(&self, piece: &Piece) -> f64 {
        let shifts = &piece.ranges.shifts;
        let (a, b) = (self.slope(&piece.a, shifts), self.slope(&piece.b, shifts));
        let fraction = if a < 0.0 && b > 0.0 { (a / (a - b)).clamp(0.1, 0.9) } else { 0.5 };
        piece.a.s + fraction * (piece.b.s - piece.a.s)
    }

    /// What the ranges of the joints between two samples of a piece say; `None` where a joint has no winding within its
    /// limits (next to the end of an arc, by rounding).
    fn ranges(&self, a: &Sample, b: &Sample) -> Option<Ranges> {
        let Springs { weight, center, lower, upper } = &self.springs;
        let (mut shifts, mut off, mut plain) = ([0.0; 8], [0.0; 8], [false; 8]);
        for i in 0..8 {
            let (low, high) = (lesser(a.q[i], b.q[i]), greater(a.q[i], b.q[i]));
            shifts[i] = shift(center[i] - 0.5 * (low + high));
            let (low, high) = (low + shifts[i], high + shifts[i]);
            off[i] = greater(greater(low - center[i], center[i] - high), 0.0);
            // Nearer to the centre than any other winding, everywhere, and within the limits: the common case.
            plain[i] =
                (low >= lower[i]) & (high <= upper[i]) & (low >= center[i] - PI) & (high <= center[i] + PI);
        }
        let (mut bound, mut unique) = (0.0, true);
        if plain != [true; 8] {
            for i in (0..7).filter(|i| !plain[*i]) {
                let range = [lesser(a.q[i], b.q[i]), greater(a.q[i], b.q[i])];
                let span = nearest_span(range, center[i], lower[i], upper[i])?;
                (off[i], shifts[i]) = (span.distance, span.shift);
                unique &= span.unique || weight[i] == 0.0;
            }
        }
        for i in 0..8 {
            bound += 0.5 * weight[i] * off[i] * off[i];
        }
        Some(Ranges { bound, shifts, unique })
    }

    /// A lower bound between two samples of a piece whose rates are monotone.
    fn bound(&self, a: &Sample, b: &Sample, ranges: &Ranges) -> f64 {
        if !ranges.unique {
            return ranges.bound;
        }
        let Springs { weight, center, .. } = &self.springs;
        // With the windings fixed: the derivative is a sum of products of two intervals, w (q - c) and q'.
        let (mut d0, mut d1, mut fa, mut fb) = (0.0, 0.0, 0.0, 0.0);
        for i in 0..8 {
            let (qa, qb) = (a.q[i] + ranges.shifts[i] - center[i], b.q[i] + ranges.shifts[i] - center[i]);
            let p = [qa * a.rate[i], qa * b.rate[i], qb * a.rate[i], qb * b.rate[i]];
            d0 += weight[i] * lesser(lesser(p[0], p[1]), lesser(p[2], p[3]));
            d1 += weight[i] * greater(greater(p[0], p[1]), greater(p[2], p[3]));
            fa += 0.5 * weight[i] * qa * qa;
            fb += 0.5 * weight[i] * qb * qb;
        }
        if d0 >= 0.0 || d1 <= 0.0 {
            // Monotone: the minimum is at an end, which has been offered.
            return greater(lesser(fa, fb), ranges.bound);
        }
        // The line of least slope from a and that of greatest slope to b meet below the function.
        let h = b.s - a.s;
        let x = ((fa - fb + d1 * h) / (d1 - d0)).clamp(0.0, h);
        greater(ranges.bound, lesser(fa + d0 * x, fb - d1 * (h - x)))
    }
}

/// Factors and turns of the paper's angles from one sign of the middle angles to the other.
const NEGATED: Row = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0];
const TURNED: Row = [PI, 0.0, PI, 0.0, PI, 0.0, PI, 0.0];

/// For every joint 1 where a branch turns (or negates) it against branch +++ of its elbow.
fn turned_joints(aligned: bool, branch: usize) -> [usize; 7] {
    let [s2, s4, s6] = signs(branch).map(|s| usize::from(s < 0));
    // Without an elbow offset all branches share one elbow, and the other one turns joints 3 and 5.
    let along = if aligned { s4 } else { 0 };
    [s2, s2, s2 ^ along, s4, s6 ^ along, s6, s6]
}

/// The joints of a row.
fn joints(row: &Row) -> [f64; 7] {
    std::array::from_fn(|i| row[i])
}

/// Sorted and without repeats.
fn sorted(cuts: &mut Vec<f64>) {
    cuts.sort_unstable_by(f64::total_cmp);
    cuts.dedup();
}

/// `b` with the windings that monotone joints reach from `a`.
fn follow(a: &Sample, mut b: Sample) -> Sample {
    for i in 0..8 {
        b.q[i] = monotone(a.q[i], b.q[i], a.rate[i] + b.rate[i]);
    }
    b
}
