//! The configuration that keeps farthest away from the joint limits, and how much of joint 7 holds them.
//!
//! The margin of a configuration is the least of `half - |d|` over its joints, d the distance from the middle of the range modulo
//! turns. Parts of the curves wait in a heap. The cubics that bound the joints on a part (see `arcs.rs`) bound its margin; the part with
//! the largest bound is divided where the tangents at its ends meet, until no part can be better than the best point found.
//!
//! The bounds rest on the estimate of what the cubics miss. A proof is made by itself, and only where it is asked for: by intervals
//! (`proof.rs`), that no configuration holds limits which are moved inwards by the margin that was found.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, PI};

use smallvec::SmallVec;
use wide::f64x4;

use super::arcs::{Cubic, End, Steps};
use super::motion::PandaMotion;
use super::proof::Proof;
use super::ring::Sheet;
use super::walk::Node;
use crate::joint_space::{TURN, nearest, wrap, wrap_four};
use crate::solutions::Solution;
use crate::solutions::closed_form::lanes::all;
use crate::tolerance::{EDGE_FOUND, EDGE_ROUNDING, OPTIMUM_GAP};

/// Parts of a curve at first.
const PARTS: usize = 16;
/// Most parts that one search divides; usually it is some tens.
const MOST_DIVISIONS: usize = 20_000;
/// Every so many divisions a part is halved, whatever its ends say.
const HALVE: u32 = 3;
/// Least share of a part on either side of a division.
const LEAST_SHARE: f64 = 1e-3;

/// Margin and slope at a point of a curve.
#[derive(Debug, Clone, Copy)]
struct Probe {
    end: End,
    value: f64,
    /// The joint that limits it.
    joint: usize,
    slope: f64,
}

/// A part that waits for its turn.
#[derive(Debug, Clone, Copy)]
struct Pending {
    bound: f64,
    piece: usize,
    a: Probe,
    b: Probe,
    depth: u32,
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
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

/// The search over all curves of one pose.
struct Widest<'a> {
    motion: &'a PandaMotion,
    center: [f64; 7],
    /// Infinite for joints without limits.
    half: [f64; 7],
    best: Option<(f64, usize, End)>,
    heap: BinaryHeap<Pending>,
}

impl PandaMotion {
    /// The configuration with the largest margin: the least distance of a joint from a limit, negative by how much the worst joint
    /// is outside of its limits where no configuration holds them. Its `value` is the margin; whether nothing is better is
    /// proven by [`Solutions::proves_margin`](crate::solutions::Solutions::proves_margin). `None` where the pose is out of reach.
    pub fn widest(&self) -> Option<Solution> {
        let inner = &self.arm.inner;
        let range = |i: usize| inner.upper[i] - inner.lower[i];
        let limited = |i: usize| range(i) < f64::INFINITY;
        let mut search = Widest {
            motion: self,
            center: std::array::from_fn(|i| if limited(i) { inner.lower[i] + 0.5 * range(i) } else { 0.0 }),
            half: std::array::from_fn(|i| 0.5 * range(i)),
            best: None,
            heap: BinaryHeap::new(),
        };
        for k in 0..self.sheets.len() {
            search.begin(k);
        }
        for _ in 0..MOST_DIVISIONS {
            match search.heap.pop() {
                Some(pending) if search.may_be_better(pending.bound) => search.divide(&pending),
                _ => break,
            }
        }
        let (value, piece, end) = search.best?;
        let q = self.arm.wind(&end.q.map(wrap)).to_vec();
        Some(Solution { q, piece, u: wrap(end.u), value, proven: false })
    }

    /// Whether no configuration has a margin above `value` by more than the rounding of the ends of arcs. Next to the end of a lens
    /// joints move with the root of the parameter of the ring, so that parts have to become as short as its rounding allows.
    pub(super) fn has_no_margin_above(&self, value: f64) -> bool {
        if value == f64::INFINITY {
            return true;
        }
        Proof::new(&self.arm.inner, &self.target).nothing_with_margin(value + EDGE_ROUNDING, EDGE_FOUND)
    }

    /// Radians of joint 7 at which some configuration holds the limits.
    pub fn feasible_q7(&self) -> f64 {
        let mut ranges: Vec<[f64; 2]> = Vec::new();
        for (sheet, arcs) in self.sheets.iter().zip(self.arcs()) {
            for shoulder in [0, 1] {
                ranges.extend(arcs.of(shoulder).into_iter().map(|arc| self.q7_over(sheet, arc)));
            }
        }
        united(ranges)
    }

    /// Least and largest joint 7 over an arc: it turns back at the ends of a lens and at quarter turns of its ring alone.
    fn q7_over(&self, sheet: &Sheet, [lo, hi]: [f64; 2]) -> [f64; 2] {
        let mut at: SmallVec<[f64; 32]> = SmallVec::from_slice(&[lo, hi]);
        let mut add = |u: f64| {
            let after = nearest(u, lo + PI);
            if after < hi {
                at.push(after);
            }
        };
        for quarter in 0..4 {
            let w = FRAC_PI_2 * f64::from(quarter);
            match sheet {
                Sheet::Whole { .. } => add(w),
                Sheet::Lens { center, half, .. } => {
                    add(w);
                    // w = center - half cos u; the centre lies in [-pi, 2 pi].
                    for turn in [-1.0, 0.0, 1.0] {
                        let cosine = (center - w - turn * TURN) / half;
                        if cosine.abs() <= 1.0 {
                            add(cosine.acos());
                            add(-cosine.acos());
                        }
                    }
                }
            }
        }
        at.sort_unstable_by(f64::total_cmp);
        // Between two of them joint 7 turns by at most half a turn: halves tell which way.
        let halves: SmallVec<[f64; 32]> = at.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
        at.extend(halves);
        at.sort_unstable_by(f64::total_cmp);
        let q7 =
            |u: [f64; 4]| wrap_four(sheet.at(f64x4::new(u)).x.angles() - all(self.target.zero7)).to_array();
        let mut last = q7([at[0]; 4])[0];
        let mut range = [last; 2];
        for four in at[1..].chunks(4) {
            let u = std::array::from_fn(|i| four[i.min(four.len() - 1)]);
            for angle in q7(u) {
                last = nearest(angle, last);
                range = [range[0].min(last), range[1].max(last)];
            }
        }
        range
    }
}

/// The length of the union of ranges of an angle.
fn united(ranges: Vec<[f64; 2]>) -> f64 {
    let mut parts: Vec<[f64; 2]> = Vec::with_capacity(ranges.len() + 1);
    for [lo, hi] in ranges {
        if hi - lo >= TURN {
            return TURN;
        }
        let begin = wrap(lo);
        let end = begin + (hi - lo);
        parts.push([begin, end.min(PI)]);
        if end > PI {
            parts.push([-PI, end - TURN]);
        }
    }
    parts.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let (mut sum, mut upto) = (0.0, f64::NEG_INFINITY);
    for [lo, hi] in parts {
        sum += (hi - lo.max(upto)).max(0.0);
        upto = upto.max(hi);
    }
    sum
}

impl Widest<'_> {
    /// True when a part with this bound may hold something better than the best point.
    fn may_be_better(&self, bound: f64) -> bool {
        self.best.is_none_or(|(best, ..)| bound > best + OPTIMUM_GAP * (1.0 + best.abs()))
    }

    /// The parts of one curve, for both shoulders.
    fn begin(&mut self, sheet: usize) {
        let at = |k: usize| TURN * k as f64 / PARTS as f64 - PI;
        let walk = self.motion.walk();
        let curve = &self.motion.sheets[sheet];
        let mut nodes: SmallVec<[Node; 20]> = SmallVec::new();
        for k in (0..PARTS).step_by(4) {
            nodes.extend(walk.nodes(curve, [0, 1, 2, 3].map(|i| at(k + i))));
        }
        nodes.push(Node { u: PI, ..nodes[0] });
        for shoulder in [0, 1] {
            let piece = 2 * sheet + shoulder;
            let probes: SmallVec<[Probe; 20]> =
                nodes.iter().map(|node| self.offer(piece, node, shoulder)).collect();
            for pair in probes.windows(2) {
                self.wait(Pending { bound: f64::INFINITY, piece, a: pair[0], b: pair[1], depth: 0 });
            }
        }
    }

    /// Margin and slope at a node; takes it when it is better than the best so far.
    fn offer(&mut self, piece: usize, node: &Node, shoulder: usize) -> Probe {
        let end = End { u: node.u, q: node.q[shoulder], rate: node.rate[shoulder] };
        let mut least = (f64::INFINITY, 0, 0.0);
        for i in 0..7 {
            let d = wrap(end.q[i] - self.center[i]);
            let own = self.half[i] - d.abs();
            if own < least.0 {
                least = (own, i, -end.rate[i] * d.signum());
            }
        }
        let (value, joint, slope) = least;
        if self.best.is_none_or(|(best, ..)| value > best) {
            self.best = Some((value, piece, end));
        }
        Probe { end, value, joint, slope }
    }

    /// Keeps a part when it may hold something better.
    fn wait(&mut self, pending: Pending) {
        let bound = self.bound(&pending.a.end, &pending.b.end).min(pending.bound);
        if self.may_be_better(bound) {
            self.heap.push(Pending { bound, ..pending });
        }
    }

    /// What no point of a part is above.
    fn bound(&self, a: &End, b: &End) -> f64 {
        let steps = Steps::new(a, b);
        let mut bound = f64::INFINITY;
        for i in 0..7 {
            let [low, high] = Cubic::new(wrap(a.q[i] - self.center[i]), &steps, i, a, b).range();
            let off = |center: f64| (low - center).max(center - high).max(0.0);
            bound = bound.min(self.half[i] - off(0.0).min(off(TURN)).min(off(-TURN)));
        }
        bound
    }

    fn divide(&mut self, pending: &Pending) {
        let Pending { bound, piece, a, b, depth } = *pending;
        let width = b.end.u - a.end.u;
        if width <= EDGE_FOUND {
            return;
        }
        let meets = depth % HALVE != HALVE - 1 && a.slope > 0.0 && b.slope < 0.0;
        let share = if meets { meeting(&a, &b) } else { 0.5 };
        let share = if share.is_finite() { share.clamp(LEAST_SHARE, 1.0 - LEAST_SHARE) } else { 0.5 };
        let sheet = &self.motion.sheets[piece / 2];
        let node = self.motion.walk().node(sheet, a.end.u + share * width);
        let middle = self.offer(piece, &node, piece % 2);
        for (a, b) in [(a, middle), (middle, b)] {
            self.wait(Pending { bound, piece, a, b, depth: depth + 1 });
        }
    }
}

/// Share of a part at which the margin, which rises at one end and falls at the other, is expected to be largest.
fn meeting(a: &Probe, b: &Probe) -> f64 {
    let (width, fall) = (b.end.u - a.end.u, a.slope - b.slope);
    if a.joint == b.joint {
        return a.slope / fall;
    }
    (b.value - a.value - b.slope * width) / (fall * width)
}
