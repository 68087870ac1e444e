//! Nearest and best over any set of solutions: isolated points are compared, curves are scanned and refined.
//!
//! A feasible arc is cut into parts, and each part halved until the cubic through values and slopes at its ends predicts the
//! value in the middle; every sign change of the slope is then refined. That resolves every minimum that is wider than a
//! part, and proves nothing. Closed forms that can prove their optimum do not come here.

use std::f64::consts::PI;

use super::solutions::{Solution, Solutions};
use crate::chain::Chain;
use crate::criterion::{Criterion, JointSpring, Sense};
use crate::error::Result;
use crate::joint_space::{TURN, nearest_within, within, wrap};
use crate::status::Status;
use crate::tolerance::{LIMIT_SLACK, SCAN_RESOLVED, SLOPE_ROUNDING};

/// Parts into which a scan cuts the range of a curve at first.
const PARTS: f64 = 48.0;
/// Most halvings of a part.
const DEPTH: usize = 24;
/// Most steps to a zero of the slope.
const ROOT_STEPS: usize = 60;
/// Most rounds in which another winding of a joint is tried.
const WINDING_ROUNDS: usize = 8;
/// Points of a curve at which a path may begin.
const CURVE_STARTS: usize = 12;

/// [`Solutions::nearest`] by enumeration or scan.
pub(crate) fn nearest(solutions: &dyn Solutions, q: &[f64]) -> Result<Option<Solution>> {
    solutions.chain().check_q(q)?;
    let springs = q.iter().map(|q| JointSpring { weight: 1.0, center: *q }).collect();
    let objective = Objective { criterion: None, sign: 1.0, springs: Some(springs) };
    let found = PieceSearch::new(solutions, &objective).run()?;
    Ok(found.map(|found| Solution { value: (2.0 * found.value).max(0.0).sqrt(), ..found }))
}

/// [`Solutions::best`] by enumeration or scan.
pub(crate) fn best(solutions: &dyn Solutions, criterion: &dyn Criterion) -> Result<Option<Solution>> {
    criterion.check_arm(solutions.chain())?;
    let objective = Objective::new(criterion);
    let found = PieceSearch::new(solutions, &objective).run()?;
    Ok(found.map(|found| Solution { value: criterion.value(&found.q), ..found }))
}

/// What [`ClosedForm::select`](super::closed_form::ClosedForm::select) asks for, from the whole set.
pub(crate) fn select(
    solutions: &dyn Solutions,
    q0: Option<&[f64]>,
    criterion: Option<&dyn Criterion>,
    q: &mut [f64],
) -> Status {
    let found = match (q0, criterion) {
        (Some(q0), _) if solutions.dimension() == 0 => solutions.nearest(q0),
        (_, Some(criterion)) => solutions.best(criterion),
        (Some(q0), None) => solutions.nearest(q0),
        (None, None) => roomiest(solutions),
    };
    match found {
        Ok(Some(found)) => {
            q.copy_from_slice(&found.q);
            Status::Converged
        }
        // The set has members within the limits, only none was found: a finite search may still succeed.
        _ => match solutions.status() {
            Status::Converged => Status::IterationLimit,
            status => status,
        },
    }
}

/// What [`ClosedForm::starts`](super::closed_form::ClosedForm::starts) asks for, from the whole set.
pub(crate) fn starts(solutions: &dyn Solutions) -> Vec<Vec<f64>> {
    let points = if solutions.dimension() == 0 { 1 } else { CURVE_STARTS };
    let mut rows = Vec::new();
    for k in 0..points {
        for piece in 0..solutions.pieces() {
            let Ok([lo, hi]) = solutions.range(piece) else { continue };
            let mut q = vec![0.0; solutions.chain().dof()];
            if solutions.q(piece, lo + (hi - lo) * k as f64 / points as f64, &mut q).is_ok() {
                rows.push(q);
            }
        }
    }
    rows
}

/// The point, or the middle of a feasible arc, that keeps farthest away from the limits.
fn roomiest(solutions: &dyn Solutions) -> Result<Option<Solution>> {
    let chain = solutions.chain();
    let mut best: Option<Solution> = None;
    let mut q = vec![0.0; chain.dof()];
    for piece in 0..solutions.pieces() {
        for [lo, hi] in solutions.intervals(piece, 0.0)? {
            let u = 0.5 * (lo + hi);
            solutions.q(piece, u, &mut q)?;
            if !hold_limits(chain, None, &mut q) {
                continue;
            }
            let value = room(chain, &q);
            if best.as_ref().is_none_or(|best| value > best.value) {
                best = Some(Solution { q: q.clone(), piece, u, value, proven: false });
            }
        }
    }
    Ok(best)
}

/// Least distance of a joint from its limits as a share of its range; 1/2 where there are none.
pub(crate) fn room(chain: &Chain, q: &[f64]) -> f64 {
    let limits = chain.lower().iter().zip(chain.upper());
    let share = q.iter().zip(limits).map(|(q, (lo, hi))| {
        let range = hi - lo;
        if range.is_finite() { (q - lo).min(hi - q) / range } else { 0.5 }
    });
    share.fold(0.5, f64::min)
}

/// Winds every revolute joint into its limits: nearest to the spring's centre where there is one, else to the principal
/// value. False where a joint has no such winding.
pub(crate) fn hold_limits(chain: &Chain, springs: Option<&[JointSpring]>, q: &mut [f64]) -> bool {
    for (i, q) in q.iter_mut().enumerate() {
        let (lower, upper) = (chain.lower()[i], chain.upper()[i]);
        let held = if !chain.steps()[i].rotational {
            let near = *q >= lower - LIMIT_SLACK && *q <= upper + LIMIT_SLACK;
            near.then(|| q.clamp(lower, upper))
        } else {
            match springs.map(|springs| springs[i]).filter(|spring| spring.weight > 0.0) {
                Some(spring) => nearest_within(*q, spring.center, lower, upper),
                None => within(*q, lower, upper),
            }
        };
        match held {
            Some(held) => *q = held,
            None => return false,
        }
    }
    true
}

/// A function of the configuration that is to be small.
struct Objective<'a> {
    /// `None` for the springs alone.
    criterion: Option<&'a dyn Criterion>,
    sign: f64,
    /// Its springs, where it is a sum of them that is to be small: then every joint has its own best winding.
    springs: Option<Vec<JointSpring>>,
}

impl<'a> Objective<'a> {
    fn new(criterion: &'a dyn Criterion) -> Self {
        let sense = criterion.sense();
        let springs = criterion.springs().filter(|springs| {
            sense == Sense::Minimize && springs.iter().all(|s| s.weight >= 0.0 && s.weight.is_finite())
        });
        Self { criterion: Some(criterion), sign: sense.sign(), springs }
    }

    fn value(&self, q: &[f64]) -> f64 {
        match self.criterion {
            Some(criterion) => self.sign * criterion.value(q),
            None => self.pairs(q).map(|(q, s)| 0.5 * s.weight * (q - s.center).powi(2)).sum(),
        }
    }

    /// Value and slope along `tangent`.
    fn probe(&self, q: &[f64], tangent: &[f64], gradient: &mut [f64]) -> [f64; 2] {
        match self.criterion {
            Some(criterion) => criterion.gradient(q, gradient),
            None => {
                for (g, (q, s)) in gradient.iter_mut().zip(self.pairs(q)) {
                    *g = s.weight * (q - s.center);
                }
            }
        }
        let sign = if self.criterion.is_some() { self.sign } else { 1.0 };
        [self.value(q), sign * gradient.iter().zip(tangent).map(|(g, t)| g * t).sum::<f64>()]
    }

    fn pairs<'b>(&'b self, q: &'b [f64]) -> impl Iterator<Item = (f64, JointSpring)> + use<'b> {
        q.iter().copied().zip(self.springs.iter().flatten().copied())
    }
}

/// The parameter of a closed piece in `[-pi, pi)`.
pub(crate) fn in_period(u: f64) -> f64 {
    let wrapped = wrap(u);
    if wrapped >= PI { -PI } else { wrapped }
}

struct PieceSearch<'a> {
    solutions: &'a dyn Solutions,
    objective: &'a Objective<'a>,
    q: Vec<f64>,
    tangent: Vec<f64>,
    gradient: Vec<f64>,
    best: Option<Solution>,
}

impl<'a> PieceSearch<'a> {
    fn new(solutions: &'a dyn Solutions, objective: &'a Objective<'a>) -> Self {
        let n = solutions.chain().dof();
        let [q, tangent, gradient] = [0, 1, 2].map(|_| vec![0.0; n]);
        Self { solutions, objective, q, tangent, gradient, best: None }
    }

    fn run(mut self) -> Result<Option<Solution>> {
        for piece in 0..self.solutions.pieces() {
            let [lo, hi] = self.solutions.range(piece)?;
            let width = (hi - lo) / PARTS;
            for [lo, hi] in self.solutions.intervals(piece, 0.0)? {
                if hi <= lo {
                    self.point(piece, lo)?;
                    continue;
                }
                let parts = ((hi - lo) / width).ceil().clamp(1.0, PARTS);
                let at = |k: f64| lo + (hi - lo) * k / parts;
                let mut from = (lo, self.end(piece, lo, hi)?);
                for k in 1..=parts as usize {
                    let to = if k as f64 == parts {
                        (hi, self.end(piece, hi, lo)?)
                    } else {
                        (at(k as f64), self.probe(piece, at(k as f64))?)
                    };
                    self.part(piece, from, to)?;
                    from = to;
                }
            }
        }
        let chosen_by_springs = self.objective.springs.is_some();
        let several = !chosen_by_springs && self.other_windings();
        let proven = self.solutions.dimension() == 0 && self.solutions.proven() && !several;
        let Some(best) = self.best else { return Ok(None) };
        let u = if self.solutions.closed(best.piece)? { in_period(best.u) } else { best.u };
        Ok(Some(Solution { proven, u, ..best }))
    }

    /// Offers `self.q` (held within the limits) over `u`.
    fn offer(&mut self, piece: usize, u: f64, value: f64) {
        if self.best.as_ref().is_none_or(|best| value < best.value) {
            self.best = Some(Solution { q: self.q.clone(), piece, u, value, proven: false });
        }
    }

    fn point(&mut self, piece: usize, u: f64) -> Result<f64> {
        self.solutions.q(piece, u, &mut self.q)?;
        if !hold_limits(self.solutions.chain(), self.objective.springs.as_deref(), &mut self.q) {
            return Ok(f64::INFINITY);
        }
        let value = self.objective.value(&self.q);
        self.offer(piece, u, value);
        Ok(value)
    }

    /// Value and slope at `u`; infinite where no winding holds the limits.
    fn probe(&mut self, piece: usize, u: f64) -> Result<[f64; 2]> {
        self.solutions.q(piece, u, &mut self.q)?;
        if !hold_limits(self.solutions.chain(), self.objective.springs.as_deref(), &mut self.q) {
            return Ok([f64::INFINITY, 0.0]);
        }
        self.solutions.tangent(piece, u, &mut self.tangent)?;
        let probed = self.objective.probe(&self.q, &self.tangent, &mut self.gradient);
        self.offer(piece, u, probed[0]);
        Ok(probed)
    }

    /// [`PieceSearch::probe`] at the end `u` of an arc, or just within it where rounding puts it outside.
    fn end(&mut self, piece: usize, u: f64, other: f64) -> Result<[f64; 2]> {
        const INWARDS: [f64; 4] = [0.0, 1e-12, 1e-10, 1e-8];
        let mut probed = [f64::INFINITY, 0.0];
        for share in INWARDS {
            probed = self.probe(piece, u + share * (other - u))?;
            if probed[0].is_finite() {
                break;
            }
        }
        Ok(probed)
    }

    /// Resolves the part between two probed parameters.
    fn part(&mut self, piece: usize, from: (f64, [f64; 2]), to: (f64, [f64; 2])) -> Result<()> {
        let mut stack = vec![(from, to, 0)];
        while let Some(((a, fa), (b, fb), depth)) = stack.pop() {
            let (m, h) = (0.5 * (a + b), b - a);
            let fm = self.probe(piece, m)?;
            let predicted = 0.5 * (fa[0] + fb[0]) + h * (fa[1] - fb[1]) / 8.0;
            let resolved = (fm[0] - predicted).abs() <= SCAN_RESOLVED * (1.0 + fm[0].abs()) && depth >= 1;
            if !resolved && depth < DEPTH {
                stack.push(((m, fm), (b, fb), depth + 1));
                stack.push(((a, fa), (m, fm), depth + 1));
                continue;
            }
            for ((a, fa), (b, fb)) in [((a, fa), (m, fm)), ((m, fm), (b, fb))] {
                if fa[1] < 0.0 && fb[1] > 0.0 {
                    self.descend(piece, (a, fa[1]), (b, fb[1]))?;
                }
            }
        }
        Ok(())
    }

    /// Offers the point where the slope changes its sign (Illinois' rule).
    fn descend(&mut self, piece: usize, a: (f64, f64), b: (f64, f64)) -> Result<()> {
        let ((mut a, mut da), (mut b, mut db)) = (a, b);
        let mut last = 0.0;
        for _ in 0..ROOT_STEPS {
            let u = a + da / (da - db) * (b - a);
            if u <= a || u >= b {
                break;
            }
            let slope = self.probe(piece, u)?[1];
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
        Ok(())
    }

    /// Tries the other windings of the best configuration, joint by joint; whether there are any.
    fn other_windings(&mut self) -> bool {
        let Some(best) = &mut self.best else { return false };
        let chain = self.solutions.chain();
        let mut several = false;
        for _ in 0..WINDING_ROUNDS {
            let mut moved = false;
            for i in (0..best.q.len()).filter(|i| chain.steps()[*i].rotational) {
                for turn in [TURN, -TURN] {
                    let wound = best.q[i] + turn;
                    if wound < chain.lower()[i] || wound > chain.upper()[i] {
                        continue;
                    }
                    several = true;
                    self.q.copy_from_slice(&best.q);
                    self.q[i] = wound;
                    let value = self.objective.value(&self.q);
                    if value < best.value {
                        (best.q[i], best.value, moved) = (wound, value, true);
                    }
                }
            }
            if !moved {
                break;
            }
        }
        several
    }
}
