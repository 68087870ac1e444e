//! Windings within limits.

use std::f64::consts::PI;

use super::wrap::{TURN, nearest, turned, turns, wrap};
use crate::tolerance::LIMIT_SLACK;

/// The winding of `q` within the limits that is nearest to `q` itself; clamped by at most
/// [`LIMIT_SLACK`](crate::tolerance::LIMIT_SLACK). `None` where no winding is within them.
///
/// ```
/// use redundancy_core::joint_space::within;
/// assert_eq!(within(-3.0, 0.0, 4.0), Some(-3.0 + std::f64::consts::TAU));
/// assert_eq!(within(-3.0, 0.0, 3.0), None);
/// ```
#[inline(always)]
pub fn within(q: f64, lower: f64, upper: f64) -> Option<f64> {
    if q >= lower && q <= upper {
        return Some(q);
    }
    let turns = if q < lower {
        ((lower - LIMIT_SLACK - q) / TURN).ceil()
    } else {
        ((upper + LIMIT_SLACK - q) / TURN).floor()
    };
    let wound = turned(q, turns);
    (wound >= lower - LIMIT_SLACK && wound <= upper + LIMIT_SLACK).then(|| wound.clamp(lower, upper))
}

/// The winding of `q` within the limits that is nearest to `reference`; `None` where no winding is within them. With the slack of
/// [`within`].
///
/// ```
/// use redundancy_core::joint_space::nearest_within;
/// assert_eq!(nearest_within(0.5, 6.0, -3.0, 3.0), Some(0.5));
/// ```
#[inline(always)]
pub fn nearest_within(q: f64, reference: f64, lower: f64, upper: f64) -> Option<f64> {
    within(nearest(q, reference), lower, upper)
}

/// The winding of `q` within the limits that is nearest to `q` itself, or `q` where there is none. Without slack.
#[inline(always)]
pub fn wind_into(q: f64, lower: f64, upper: f64) -> f64 {
    let turns = if q < lower {
        ((lower - q) / TURN).ceil()
    } else if q > upper {
        ((upper - q) / TURN).floor()
    } else {
        return q;
    };
    let wound = turned(q, turns);
    if wound >= lower && wound <= upper { wound } else { q }
}

/// The windings of an angle between limits, ascending, without slack. An infinite limit stands for one that is just far enough to leave
/// a principal value, or one winding, inside: windings of a joint without limits are alike.
///
/// ```
/// use redundancy_core::joint_space::windings;
/// use std::f64::consts::TAU;
/// assert_eq!(windings(0.5, -7.0, 7.0).collect::<Vec<_>>(), [0.5 - TAU, 0.5, 0.5 + TAU]);
/// assert_eq!(windings(7.0, f64::NEG_INFINITY, f64::INFINITY).collect::<Vec<_>>(), [7.0 - TAU]);
/// ```
pub fn windings(q: f64, lower: f64, upper: f64) -> impl Iterator<Item = f64> {
    // Where a limit stands in for an infinite one, its end belongs to the next turn.
    let [least, most] = match (lower.is_finite(), upper.is_finite()) {
        (true, true) => turns_within([q, q], lower, upper),
        (true, false) => [((lower - q) / TURN).ceil(); 2],
        (false, true) => [((upper - q) / TURN).floor(); 2],
        (false, false) => [turns(wrap(q) - q); 2],
    };
    // Rounding may put the ends outside by a bit; counts that are not finite give none.
    let count = most - least + 1.0;
    let count = if count.is_finite() && count > 0.0 { count as usize } else { 0 };
    (0..count)
        .map(move |k| turned(q, least + k as f64))
        .filter(move |wound| *wound >= lower && *wound <= upper)
}

/// Whether some winding of `q` is within the limits. Without slack.
#[inline(always)]
pub fn holds(q: f64, lower: f64, upper: f64) -> bool {
    least_above(q, lower) <= upper
}

/// How far the best winding of `q` is outside of the limits; 0 within them.
///
/// ```
/// use redundancy_core::joint_space::outside;
/// assert!((outside(3.0, -1.0, 1.0) - 2.0).abs() < 1e-15);
/// assert!((outside(-3.0, 0.0, 3.0) - (std::f64::consts::TAU - 6.0)).abs() < 1e-15);
/// ```
#[inline]
pub fn outside(q: f64, lower: f64, upper: f64) -> f64 {
    if !(lower.is_finite() && upper.is_finite()) {
        // Some winding is always far enough on the side without a limit.
        return 0.0;
    }
    let above = least_above(q, lower);
    let below = above - TURN;
    (above - upper).max(0.0).min(lower - below)
}

/// The least winding of `q` at or above a limit.
#[inline(always)]
fn least_above(q: f64, lower: f64) -> f64 {
    turned(q, ((lower - q) / TURN).ceil())
}

/// How far inside of its limits the best winding of `q` is: the distance from the nearer limit, negative outside; infinite where a
/// limit is.
///
/// ```
/// use redundancy_core::joint_space::margin;
/// assert_eq!(margin(0.5 + std::f64::consts::TAU, -1.0, 1.0), 0.5);
/// ```
#[inline]
pub fn margin(q: f64, lower: f64, upper: f64) -> f64 {
    let half = 0.5 * (upper - lower);
    if half == f64::INFINITY { half } else { half - wrap(q - (lower + half)).abs() }
}

/// The whole turns, from the first to the last, by which some angle of a range comes between the limits; infinite without limits,
/// the first above the last where there are none.
#[inline(always)]
pub fn turns_within([low, high]: [f64; 2], lower: f64, upper: f64) -> [f64; 2] {
    [((lower - high) / TURN).ceil(), ((upper - low) / TURN).floor()]
}

/// The winding of a range of angles that comes nearest to a centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Least distance from the centre to any winding of the range within the limits.
    pub distance: f64,
    /// The winding that attains it, as an angle to add.
    pub shift: f64,
    /// True when no other winding can be the nearest one within the limits anywhere on the range.
    pub unique: bool,
}

/// Windings of the angles from `low` to `high` against the limits: which is nearest to `center`, and is it the only
/// candidate. `None` when there is none. The range is less than a turn wide; with the slack of [`within`].
pub fn nearest_span([low, high]: [f64; 2], center: f64, lower: f64, upper: f64) -> Option<Span> {
    // Windings of which some part is within the limits, with the slack of `within`: what is offered there is taken. More
    // slack would be a range in which the bound promises what no point can hold.
    let first = ((lower - high - LIMIT_SLACK) / TURN).ceil();
    let last = ((upper - low + LIMIT_SLACK) / TURN).floor();
    if first > last {
        return None;
    }
    let nearest = turns(center - 0.5 * (low + high)).max(first).min(last);
    let distance = |k: f64| {
        let (a, b) = (turned(low, k).max(lower), turned(high, k).min(upper));
        (a - center).max(center - b).max(0.0)
    };
    let mut best = Span { distance: distance(nearest), shift: TURN * nearest, unique: true };
    let (a, b) = (low + best.shift, high + best.shift);
    // A neighbour is a candidate where it is the nearer one, or where this one breaks a limit.
    let everywhere = a >= lower && b <= upper;
    for (k, farther) in [(nearest - 1.0, b <= center + PI), (nearest + 1.0, a >= center - PI)] {
        if k >= first && k <= last && !(farther && everywhere) {
            best.unique = false;
            best.distance = best.distance.min(distance(k));
        }
    }
    Some(best)
}

/// The turns, as an angle, that bring the values of a joint from `least` to `most` within its limits, as near to the middle of the
/// range as they go, and true; without slack. Where no turns do, those that come nearest to the middle, and false.
///
/// ```
/// use redundancy_core::joint_space::shift_within;
/// assert_eq!(shift_within([6.0, 7.0], -2.0, 2.0), (-std::f64::consts::TAU, true));
/// assert_eq!(shift_within([-2.0, 3.0], -2.0, 2.0), (0.0, false));
/// ```
pub fn shift_within([least, most]: [f64; 2], lower: f64, upper: f64) -> (f64, bool) {
    const FAR: f64 = 1e3;
    if lower == f64::NEG_INFINITY && upper == f64::INFINITY {
        return (0.0, true);
    }
    let middle = 0.5 * (lower.max(-FAR) + upper.min(FAR));
    let shift = TURN * turns(middle - 0.5 * (least + most));
    let fits = |s: &f64| least + s >= lower && most + s <= upper;
    [shift, shift + TURN, shift - TURN].into_iter().find(fits).map_or((shift, false), |shift| (shift, true))
}
