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
//! found are divided, best bound first, until none is left: the result is the global minimum up to [`OPTIMUM_GAP`](crate::tolerance::OPTIMUM_GAP) (on
//! a convex piece, up to rounding). A typical search weighs 60 stretches and evaluates the arm at some 30 swivels.
//!
//! Other criteria have no such bounds. There each piece is halved until the cubic through values and slopes at its
//! ends predicts the value in the middle, and every sign change of the slope is refined.

use super::choice::Choice;
use super::circle::SelfMotion;
use super::spring_search::{Part, Pending, SpringSearch};
use super::stretches::{joints, sorted};
use crate::criterion::{Criterion, JointSpring, Sense};
use crate::error::Result;
use crate::joint_space::{turned, wrap};
use crate::solutions::ClosedForm;

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
        criterion.check_arm(self.arm().chain())?;
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
        let mut search = SpringSearch::new(self, &springs);
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
