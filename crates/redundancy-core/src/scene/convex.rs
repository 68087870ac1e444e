//! Signed distance of two convex shapes by their support functions.
//!
//! What a search for the nearest points returns is not believed but certified. A direction n alone proves
//! `gap(n) = min over B of n.x - max over A of n.x <= distance`, and equality holds for the best one. So
//! - apart, the distance between the two points found is an upper bound and `gap(n)` a lower one; where they differ by more than
//!   [`CONVEX_GAP`] the lower one is returned, which is conservative;
//! - inside, `-gap(n)` bounds the depth from above: that is returned, exact where the best n was found.
//!
//! Where no direction is found a few are tried, and the best gap of these is returned: conservative again, never 0.
//!
//! The search is parry's (`gjk`); without the feature `mesh` it is a slow one that knows no depth (`gilbert`), so that distances
//! are lower bounds.

use nalgebra::Vector3;

#[cfg(not(feature = "mesh"))]
use super::gilbert::{SearchMemory, search};
#[cfg(feature = "mesh")]
use super::gjk::{SearchMemory, search};
use super::support::{Convex, Sides, Verdict};
use crate::tolerance::{CONVEX_GAP, CONVEX_TOUCH};

/// Memory for [`distance`], and what is asked for.
#[derive(Debug)]
pub(crate) struct Memory {
    search: SearchMemory,
    /// The direction in which the last pair was apart, in coordinates of its first core; zero without any. Where a caller puts
    /// back what it was for the same pair, it often proves at once that they are far from each other again.
    pub direction: Vector3<f64>,
    /// Depths need not be known: contact alone counts, and any distance <= 0 stands for it.
    pub contact_only: bool,
}

impl Memory {
    pub fn new() -> Self {
        Self { search: SearchMemory::new(), direction: Vector3::zeros(), contact_only: false }
    }
}

/// Signed distance of two cores.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Separation {
    /// m, negative inside.
    pub distance: f64,
    /// The nearest points (inside: the deepest).
    pub on_first: Vector3<f64>,
    pub on_second: Vector3<f64>,
    /// Unit vector from the first to the second: moving the second along it adds to the distance.
    pub normal: Vector3<f64>,
}

/// Distances, or proof that they are beyond.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Answer {
    Found(Separation),
    /// At least what was asked for.
    Beyond,
}

/// Distance of two cores, exactly where it is below `upto`.
pub(crate) fn distance(a: &Convex<'_>, b: &Convex<'_>, upto: f64, memory: &mut Memory) -> Answer {
    let sides = Sides::new(a, b);
    if upto.is_finite() && memory.direction != Vector3::zeros() && sides.gap(&memory.direction).0 >= upto {
        return Answer::Beyond;
    }
    let depths = (!memory.contact_only).then_some(&mut memory.search);
    let found = match search(&sides, upto, depths) {
        Verdict::Apart(p, q, n) => apart(&sides, [p, q], &n),
        Verdict::Beyond(n) => {
            let (least, on_first, on_second) = sides.gap(&n);
            memory.direction = n;
            if least >= upto {
                return Answer::Beyond;
            }
            if least > 0.0 {
                Separation { distance: least, on_first, on_second, normal: n }
            } else {
                inside(&sides, None)
            }
        }
        Verdict::Inside(None) if memory.contact_only => along_middle(&sides),
        Verdict::Inside(found) => inside(&sides, found),
    };
    memory.direction = found.normal;
    Answer::Found(Separation {
        distance: found.distance,
        on_first: a.rotation * found.on_first + a.origin,
        on_second: a.rotation * found.on_second + a.origin,
        normal: a.rotation * found.normal,
    })
}

/// Checks two points that are said to be the nearest, and the direction between them.
fn apart(sides: &Sides<'_>, [p, q]: [Vector3<f64>; 2], n: &Vector3<f64>) -> Separation {
    let between = q - p;
    let length = between.norm();
    // Next to contact the direction between the points is rounding, that of the search is not.
    let normal = if length > CONVEX_TOUCH { between / length } else { *n };
    let (least, on_first, on_second) = sides.gap(&normal);
    if length > CONVEX_TOUCH && length - least <= CONVEX_GAP * (1.0 + length) {
        Separation { distance: length, on_first: p, on_second: q, normal }
    } else if least > 0.0 {
        Separation { distance: least, on_first, on_second, normal }
    } else {
        inside(sides, Some((p, q, normal)))
    }
}

/// What the direction between two points inside proves: at most the distance.
fn along_middle(sides: &Sides<'_>) -> Separation {
    let n = sides.middle.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let (distance, on_first, on_second) = sides.gap(&n);
    Separation { distance, on_first, on_second, normal: n }
}

/// Distance of cores that overlap, touch, or that could not be told: the direction with the largest gap.
fn inside(sides: &Sides<'_>, found: Option<(Vector3<f64>, Vector3<f64>, Vector3<f64>)>) -> Separation {
    let at = |n: Vector3<f64>| {
        let n = n.try_normalize(0.0).filter(|n| n.iter().all(|x| x.is_finite()))?;
        let (distance, on_first, on_second) = sides.gap(&n);
        Some(Separation { distance, on_first, on_second, normal: n })
    };
    if let Some((p, q, n)) = found
        && let Some(best) = at(n)
    {
        return Separation { on_first: p, on_second: q, ..best };
    }
    let unit = |i: usize| Vector3::from_fn(|k, _| if k == i % 3 { 1.0 } else { 0.0 });
    let directions = (0..12).map(|i| {
        let n = if i % 2 == 0 { unit(i / 2) } else { -unit(i / 2) };
        if i < 6 { n } else { sides.rotation * n }
    });
    let mut best = Separation {
        distance: f64::NEG_INFINITY,
        on_first: Vector3::zeros(),
        on_second: Vector3::zeros(),
        normal: Vector3::x(),
    };
    for candidate in directions.chain([sides.middle]).filter_map(at) {
        if candidate.distance > best.distance {
            best = candidate;
        }
    }
    best
}
