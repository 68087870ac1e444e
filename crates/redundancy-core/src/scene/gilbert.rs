//! The nearest points of two convex shapes without the library: Gilbert's method [Gilbert1966].
//!
//! Each round goes from the nearest point so far of the difference of both towards its support point against it, as far as
//! that brings it nearer. It converges slowly and knows no depth: what is returned is a direction whose gap is a lower bound.

use nalgebra::Vector3;

use super::support::{Sides, Verdict};

const ROUNDS: usize = 200;

/// Nothing is kept.
#[derive(Debug, Default)]
pub(crate) struct SearchMemory;

impl SearchMemory {
    pub fn new() -> Self {
        Self
    }
}

/// Looks for a direction in which the two are apart.
pub(crate) fn search(sides: &Sides<'_>, upto: f64, _: Option<&mut SearchMemory>) -> Verdict {
    let mut between = sides.middle;
    let mut best = (f64::NEG_INFINITY, Vector3::x());
    for _ in 0..ROUNDS {
        let Some(n) = between.try_normalize(0.0) else { break };
        let (gap, a, b) = sides.gap(&n);
        if gap > best.0 {
            best = (gap, n);
        }
        if gap >= upto {
            return Verdict::Beyond(n);
        }
        // The point of the segment from here to the support point that is nearest to the origin.
        let step = (b - a) - between;
        let square = step.norm_squared();
        let share = if square > 0.0 { (-between.dot(&step) / square).clamp(0.0, 1.0) } else { 0.0 };
        if share == 0.0 {
            break;
        }
        between += step * share;
    }
    if best.0 > 0.0 { Verdict::Beyond(best.1) } else { Verdict::Inside(None) }
}
