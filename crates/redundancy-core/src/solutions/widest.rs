//! The largest margin from the joint limits over any set of solutions: isolated configurations are compared, curves are scanned and
//! the best part refined. Closed forms that know more do not come here.

use super::solutions::{Solution, Solutions};
use crate::error::Result;
use crate::joint_space::margin;
use crate::tolerance::SLOPE_ROUNDING;

/// Parts into which a curve is cut.
const PARTS: usize = 128;
/// Shares of a bracket at which golden section looks.
const GOLDEN: f64 = 0.381_966_011_250_105;

/// The least distance of a joint from a limit in its best winding, rad or m.
pub(crate) fn margin_of(solutions: &dyn Solutions, q: &[f64]) -> f64 {
    let chain = solutions.chain();
    let own = |i: usize| {
        let (lower, upper) = (chain.lower()[i], chain.upper()[i]);
        if chain.steps()[i].rotational {
            margin(q[i], lower, upper)
        } else {
            (q[i] - lower).min(upper - q[i])
        }
    };
    (0..q.len()).map(own).fold(f64::INFINITY, f64::min)
}

/// [`Solutions::best_margin`] by enumeration or scan.
pub(crate) fn best_margin(solutions: &dyn Solutions) -> Result<Option<Solution>> {
    let mut q = vec![0.0; solutions.chain().dof()];
    let mut best: Option<Solution> = None;
    let mut probe = |piece: usize, u: f64, best: &mut Option<Solution>| -> Result<f64> {
        solutions.q(piece, u, &mut q)?;
        let value = margin_of(solutions, &q);
        if best.as_ref().is_none_or(|best| value > best.value) {
            *best = Some(Solution { q: q.clone(), piece, u, value, proven: false });
        }
        Ok(value)
    };
    if solutions.dimension() == 0 {
        for piece in 0..solutions.pieces() {
            probe(piece, 0.0, &mut best)?;
        }
        let proven = solutions.proven();
        return Ok(best.map(|best| Solution { proven, ..best }));
    }
    for piece in 0..solutions.pieces() {
        let [lo, hi] = solutions.range(piece)?;
        let step = (hi - lo) / PARTS as f64;
        for k in 0..=PARTS {
            probe(piece, (lo + step * k as f64).min(hi), &mut best)?;
        }
        let Some(found) = best.as_ref().filter(|best| best.piece == piece) else { continue };
        // Golden section around the best sample of this piece.
        let (mut a, mut b) = ((found.u - step).max(lo), (found.u + step).min(hi));
        while b - a > SLOPE_ROUNDING {
            let [left, right] = [a + GOLDEN * (b - a), b - GOLDEN * (b - a)];
            if probe(piece, left, &mut best)? >= probe(piece, right, &mut best)? {
                b = right
            } else {
                a = left
            }
        }
    }
    Ok(best)
}
