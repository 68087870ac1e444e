//! The nearest and the softest configuration over a pose: the least sum of joint springs over all feasible parts.
//!
//! The cubics that bound the joints on a part (see `arcs.rs`) bound the sum, windings included. Parts wait in a heap, best
//! bound first; a part whose bound cannot beat the best point found ends the search. Otherwise its middle is evaluated, and it
//! is divided until the cubic through values and slopes predicts the value in the middle; then every sign change of the slope is
//! refined on the curve. The bounds rest on the estimate of what the cubics miss, so the result is not called proven.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use super::arcs::{Cubic, End, Part, Steps};
use super::arm::PandaClassArm;
use super::motion::PandaMotion;
use super::ring::Sheet;
use crate::criterion::JointSpring;
use crate::error::{Result, check_length};
use crate::joint_space::{TURN, nearest_within, wrap};
use crate::parallel::prelude::*;
use crate::pose::{Pose, pose_from_row_major};
use crate::solutions::{Solution, at};
use crate::tolerance::{EDGE_ROUNDING, OPTIMUM_GAP, SCAN_RESOLVED, SLOPE_ROUNDING};

/// Poses that one task of the pool takes at least.
const TASK: usize = 64;
/// Most steps to a zero of the slope.
const ROOT_STEPS: usize = 60;
/// Least halvings of a part.
const DEPTH: u32 = 1;
/// Most halvings of a part.
const DEEPEST: u32 = 24;
/// Most parts that one search divides; usually it is some hundreds.
const MOST_DIVISIONS: usize = 20_000;

/// Value and slope of the sum at a point of a curve.
#[derive(Debug, Clone, Copy)]
struct Probe {
    end: End,
    value: f64,
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
    /// The least bound is the greatest part: it leaves the heap first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound)
    }
}

struct ArcSearch<'a> {
    motion: &'a PandaMotion,
    springs: [JointSpring; 7],
    best: Option<(f64, usize, f64, [f64; 7])>,
    heap: BinaryHeap<Pending>,
}

impl PandaClassArm {
    /// The configuration over `pose` within the limits with the least Euclidean distance to `q`, windings included;
    /// `None` when there is none.
    ///
    /// # Errors
    /// A pose that is not rigid or finite, a wrong length of `q`, or an entry that is not finite.
    pub fn nearest(&self, pose: &Pose, q: &[f64]) -> Result<Option<Solution>> {
        self.chain().check_q(q)?;
        Ok(self.self_motion(pose)?.nearest_choice(q))
    }

    /// [`PandaClassArm::nearest`] for many poses, to one `q` for all (7 numbers) or one for each (`N * 7`).
    ///
    /// # Errors
    /// Wrong lengths, a pose that is not rigid or finite, an entry of `q` that is not finite.
    pub fn nearest_batch(&self, poses: &[f64], q: &[f64]) -> Result<Vec<Option<[f64; 7]>>> {
        let n = poses.len() / 16;
        check_length("poses", poses, n * 16)?;
        check_length("q", q, if q.len() == 7 { 7 } else { n * 7 })?;
        let wish = |i: usize| if q.len() == 7 { q } else { &q[7 * i..7 * i + 7] };
        let one = |(i, pose): (usize, &[f64; 16])| {
            let pose = pose_from_row_major(pose).map_err(at(i))?;
            let near = self.nearest(&pose, wish(i)).map_err(at(i))?;
            Ok(near.and_then(|near| near.q.try_into().ok()))
        };
        poses.as_chunks::<16>().0.par_iter().enumerate().with_min_len(TASK).map(one).collect()
    }
}

impl PandaMotion {
    /// The configuration nearest to `q`; its value is the distance.
    pub(super) fn nearest_choice(&self, q: &[f64]) -> Option<Solution> {
        let springs = std::array::from_fn(|i| JointSpring { weight: 1.0, center: q[i] });
        let mut found = self.softest(springs)?;
        found.value = (2.0 * found.value).max(0.0).sqrt();
        Some(found)
    }

    /// The configuration with the least sum of springs.
    pub(super) fn softest(&self, springs: [JointSpring; 7]) -> Option<Solution> {
        let mut search = ArcSearch { motion: self, springs, best: None, heap: BinaryHeap::new() };
        for (k, arcs) in self.arcs().iter().enumerate() {
            for (shoulder, parts) in arcs.parts.iter().enumerate() {
                for part in parts {
                    search.push(2 * k + shoulder, part);
                }
            }
        }
        // Along a curve that is all but a point rounding hides which part is better: the search ends there too.
        for _ in 0..MOST_DIVISIONS {
            match search.heap.pop() {
                Some(pending) if !search.is_settled(pending.bound) => search.divide(&pending),
                _ => break,
            }
        }
        let (value, piece, u, q) = search.best?;
        Some(Solution { q: q.to_vec(), piece, u: wrap(u), value, proven: false })
    }
}

impl ArcSearch<'_> {
    /// True when nothing better than the best point by more than the gap can have this bound.
    fn is_settled(&self, bound: f64) -> bool {
        self.best.is_some_and(|(best, ..)| bound >= best - OPTIMUM_GAP * (1.0 + best.abs()))
    }

    fn push(&mut self, piece: usize, part: &Part) {
        let a = self.offer(piece, &part.a);
        if part.b.u > part.a.u {
            let b = self.offer(piece, &part.b);
            self.wait(Pending { bound: 0.0, piece, a, b, depth: 0 });
        }
    }

    /// Keeps a part when it may hold something better.
    fn wait(&mut self, pending: Pending) {
        let bound = self.bound(&pending.a.end, &pending.b.end).max(pending.bound);
        if !self.is_settled(bound) {
            self.heap.push(Pending { bound, ..pending });
        }
    }

    /// What no point of a part is below.
    fn bound(&self, a: &End, b: &End) -> f64 {
        let steps = Steps::new(a, b);
        let mut sum = 0.0;
        for i in 0..7 {
            let JointSpring { weight, center } = self.springs[i];
            let [low, high] = Cubic::new(wrap(a.q[i] - center), &steps, i, a, b).range();
            // Whatever the limits: the nearest winding may be outside of them, which makes the bound no better.
            let off = if high - low < TURN { low.max(-high).max(0.0) } else { 0.0 };
            let off = if high > PI { off.min((TURN - high).max(0.0)) } else { off };
            let off = if low < -PI { off.min((TURN + low).max(0.0)) } else { off };
            sum += 0.5 * weight * off * off;
        }
        sum
    }

    /// Value and slope at a point, each joint in its best winding; takes the point when it is better than the best so far.
    fn offer(&mut self, piece: usize, end: &End) -> Probe {
        let inner = &self.motion.arm.inner;
        let (mut q, mut value, mut slope) = ([0.0; 7], 0.0, 0.0);
        let mut inside = true;
        for i in 0..7 {
            let JointSpring { weight, center } = self.springs[i];
            let wound = nearest_within(end.q[i], center, inner.lower[i], inner.upper[i]);
            inside &= wound.is_some();
            q[i] = wound.unwrap_or(end.q[i]);
            let off = q[i] - center;
            value += 0.5 * weight * off * off;
            slope += weight * off * end.rate[i];
        }
        if !inside {
            // The end of an arc, where a limit is met up to rounding.
            let wound = self.motion.arm.wind(&end.q);
            q = std::array::from_fn(|i| wound[i].clamp(inner.lower[i], inner.upper[i]));
            inside = q.iter().zip(&wound).all(|(a, b)| (a - b).abs() <= EDGE_ROUNDING);
            let springs = self.springs.iter().zip(&q);
            value = springs.map(|(s, q)| 0.5 * s.weight * (q - s.center).powi(2)).sum();
        }
        if inside && self.best.is_none_or(|(best, ..)| value < best) {
            self.best = Some((value, piece, end.u, q));
        }
        Probe { end: *end, value, slope }
    }

    fn probe(&mut self, piece: usize, sheet: &Sheet, u: f64) -> Probe {
        let node = self.motion.walk().node(sheet, u);
        let shoulder = piece % 2;
        self.offer(piece, &End { u, q: node.q[shoulder], rate: node.rate[shoulder] })
    }

    fn divide(&mut self, pending: &Pending) {
        let Pending { bound, piece, a, b, depth } = *pending;
        let motion = self.motion;
        let sheet = &motion.sheets[piece / 2];
        let h = b.end.u - a.end.u;
        let m = self.probe(piece, sheet, a.end.u + 0.5 * h);
        let predicted = 0.5 * (a.value + b.value) + h * (a.slope - b.slope) / 8.0;
        let resolved = (m.value - predicted).abs() <= SCAN_RESOLVED * (1.0 + m.value.abs());
        for (a, b) in [(a, m), (m, b)] {
            if resolved && depth >= DEPTH || depth >= DEEPEST {
                if a.slope < 0.0 && b.slope > 0.0 {
                    self.descend(piece, sheet, &a, &b);
                }
            } else {
                self.wait(Pending { bound, piece, a, b, depth: depth + 1 });
            }
        }
    }

    /// Offers the point where the slope changes its sign (Illinois' rule).
    fn descend(&mut self, piece: usize, sheet: &Sheet, a: &Probe, b: &Probe) {
        let ((mut a, mut da), (mut b, mut db)) = ((a.end.u, a.slope), (b.end.u, b.slope));
        let mut last = 0.0;
        for _ in 0..ROOT_STEPS {
            let u = a + da / (da - db) * (b - a);
            if u <= a || u >= b {
                break;
            }
            let slope = self.probe(piece, sheet, u).slope;
            if slope.abs() <= SLOPE_ROUNDING || b - a <= SLOPE_ROUNDING {
                break;
            }
            if slope < 0.0 {
                (a, da) = (u, slope);
                db *= if last < 0.0 { 0.5 } else { 1.0 };
            } else {
                (b, db) = (u, slope);
                da *= if last > 0.0 { 0.5 } else { 1.0 };
            }
            last = slope;
        }
    }
}
