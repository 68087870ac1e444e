//! Branch and bound for sums of joint springs over the stretches of the circles, see `optimum.rs`.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use super::choice::Choice;
use super::circle::SelfMotion;
use super::elbow_circle::{Node, signs};
use super::spherical::{Range, Spherical, greater, lesser};
use super::stretches::{Elbow, Row, Sample, Stretch, follow, joints, row};
use crate::criterion::JointSpring;
use crate::joint_space::{monotone, nearest, nearest_span, shift, turned, within, wrap};
use crate::tolerance::{OPTIMUM_GAP, POLISH_STEP, SLOPE_ROUNDING};

/// What the ranges of the joints say about a stretch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ranges {
    /// No configuration is better.
    pub(super) bound: f64,
    /// The windings that attain the bound, as angles to add.
    pub(super) shifts: Row,
    /// No other windings come into question.
    pub(super) unique: bool,
}

/// A stretch of one branch on which all joints are monotone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub(super) branch: usize,
    pub(super) a: Sample,
    pub(super) b: Sample,
    pub(super) ranges: Ranges,
    /// No configuration of the piece is better.
    pub(super) bound: f64,
    /// Whether the rates are monotone as well.
    pub(super) rates: bool,
}

/// What waits for its turn.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    Stretch(Stretch),
    /// Index into [`SpringSearch::pieces`].
    Piece(usize),
}

/// A part of a branch that waits for its turn.
#[derive(Debug)]
pub(super) struct Pending {
    pub(super) bound: f64,
    pub(super) part: Part,
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
pub(super) struct Springs {
    pub(super) weight: Row,
    pub(super) center: Row,
    lower: Row,
    upper: Row,
}

pub(super) struct SpringSearch<'a> {
    pub(super) motion: &'a SelfMotion,
    pub(super) springs: Springs,
    pub(super) best: Option<Choice>,
    pub(super) heap: BinaryHeap<Pending>,
    /// Pieces in the heap, and free places among them.
    pub(super) pieces: Vec<Piece>,
    pub(super) free: Vec<usize>,
}

impl<'a> SpringSearch<'a> {
    pub(super) fn new(motion: &'a SelfMotion, springs: &[JointSpring; 7]) -> Self {
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
    pub(super) fn is_settled(&self, bound: f64) -> bool {
        let better = |best: Choice| bound < best.value - OPTIMUM_GAP * (1.0 + best.value.abs());
        // Where the values overflow nothing compares as better.
        self.best.is_some_and(|best| !better(best))
    }

    /// Weighs all stretches by the ranges of the joints between the cuts.
    pub(super) fn push_stretches(&mut self, elbows: &[Elbow]) {
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
    pub(super) fn costs(&self, a: &Node, b: &Node) -> [Row; 2] {
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
    pub(super) fn evaluated(&mut self, stretch: &Stretch, elbows: &[Elbow]) -> Option<Piece> {
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
    pub(super) fn push(&mut self, piece: Piece) {
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
    pub(super) fn take(&mut self, index: usize) -> Piece {
        self.free.push(index);
        self.pieces[index]
    }

    /// Replaces a piece by its two parts at `s`; `rates` tells on which of them the rates are monotone.
    pub(super) fn divide(&mut self, piece: &Piece, s: f64, rates: [bool; 2]) {
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
    pub(super) fn offer(&mut self, branch: usize, sample: &Sample) {
        self.offer_q(branch, sample.s, &sample.q);
    }

    /// Takes `q` over swivel `s`, each joint in its best winding, when it is better than the best so far; returns its
    /// value (infinite when no winding holds the limits).
    pub(super) fn offer_q(&mut self, branch: usize, s: f64, q: &Row) -> f64 {
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

    /// True when the criterion is strictly convex on the piece, by the ranges of
    /// `sum w (q'^2 + (q - c) q'')`: its minimum there is where the slope vanishes, or at an end.
    pub(super) fn is_convex(&self, piece: &Piece, joints: &[Spherical; 2]) -> bool {
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
    pub(super) fn descend(&mut self, piece: &Piece) {
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
    pub(super) fn polish(&mut self) {
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
    pub(super) fn between(&self, piece: &Piece, s: f64) -> Sample {
        let mut sample = self.motion.sample(piece.branch, &self.motion.node(piece.branch, s));
        for i in 0..8 {
            // The joint is monotone on the piece: its value lies between those at the ends.
            sample.q[i] = nearest(sample.q[i], 0.5 * (piece.a.q[i] + piece.b.q[i]));
        }
        sample
    }

    /// The slope of the criterion at a sample in the windings `shifts`.
    pub(super) fn slope(&self, sample: &Sample, shifts: &Row) -> f64 {
        let Springs { weight, center, .. } = &self.springs;
        let mut sum = 0.0;
        for i in 0..8 {
            sum += weight[i] * (sample.q[i] + shifts[i] - center[i]) * sample.rate[i];
        }
        sum
    }

    /// Where to divide a piece: at the zero of the slope by the secant, kept away from the ends.
    pub(super) fn split(&self, piece: &Piece) -> f64 {
        let shifts = &piece.ranges.shifts;
        let (a, b) = (self.slope(&piece.a, shifts), self.slope(&piece.b, shifts));
        let fraction = if a < 0.0 && b > 0.0 { (a / (a - b)).clamp(0.1, 0.9) } else { 0.5 };
        piece.a.s + fraction * (piece.b.s - piece.a.s)
    }

    /// What the ranges of the joints between two samples of a piece say; `None` where a joint has no winding within its
    /// limits (next to the end of an arc, by rounding).
    pub(super) fn ranges(&self, a: &Sample, b: &Sample) -> Option<Ranges> {
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
    pub(super) fn bound(&self, a: &Sample, b: &Sample, ranges: &Ranges) -> f64 {
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
