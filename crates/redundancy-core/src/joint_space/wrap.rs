//! Angles modulo whole turns, without limits.

use std::f64::consts::{PI, TAU};

use crate::tolerance::UNWIND_ROUNDING;

/// A whole turn, rad.
pub const TURN: f64 = TAU;

/// The number of whole turns nearest to an angle, up to 2^31 of them; the even one where two are equally near.
///
/// ```
/// use redundancy_core::joint_space::turns;
/// assert_eq!([turns(7.0), turns(-7.0), turns(3.0)], [1.0, -1.0, 0.0]);
/// ```
#[inline(always)]
pub fn turns(angle: f64) -> f64 {
    const PER_RADIAN: f64 = 1.0 / TURN;
    const MOST: f64 = 2_147_483_648.0;
    // Numbers of this size, 1.5 * 2^52, have no fraction: to add and subtract it rounds, in two instructions that work on whole
    // vectors, where `f64::round` is a call.
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    let x = angle * PER_RADIAN;
    let x = if x > MOST { MOST } else { x };
    let x = if x < -MOST { -MOST } else { x };
    (x + WHOLE) - WHOLE
}

/// The whole turns nearest to an angle, as an angle: what [`wrap`] removes.
#[inline(always)]
pub fn shift(angle: f64) -> f64 {
    TURN * turns(angle)
}

/// `angle` and a number of whole turns.
#[inline(always)]
pub fn turned(angle: f64, turns: f64) -> f64 {
    angle + TURN * turns
}

/// The angle in `(-pi, pi]` that differs by whole turns.
///
/// ```
/// use redundancy_core::joint_space::wrap;
/// use std::f64::consts::PI;
/// assert_eq!([wrap(PI), wrap(-PI), wrap(3.0 * PI), wrap(0.5)], [PI, PI, PI, 0.5]);
/// ```
#[inline(always)]
pub fn wrap(angle: f64) -> f64 {
    let r = angle - shift(angle);
    let r = if r <= -PI { r + TURN } else { r };
    // By rounding.
    if r > PI { PI } else { r }
}

/// [`wrap`] for an angle in `(-3 pi, 3 pi]`, such as the sum of two wrapped ones.
#[inline(always)]
pub fn wrap_sum(angle: f64) -> f64 {
    if angle > PI {
        angle - TURN
    } else if angle <= -PI {
        angle + TURN
    } else {
        angle
    }
}

/// `angle`, in `(-pi, pi]`, moved by pi into `(-pi, pi]`.
#[inline(always)]
pub fn opposite(angle: f64) -> f64 {
    if angle > 0.0 { angle - PI } else { angle + PI }
}

/// The way from one angle to another, the short way round: in `(-pi, pi]`.
///
/// ```
/// use redundancy_core::joint_space::difference;
/// assert!((difference(3.0, -3.0) - (std::f64::consts::TAU - 6.0)).abs() < 1e-15);
/// ```
#[inline(always)]
pub fn difference(from: f64, to: f64) -> f64 {
    wrap(to - from)
}

/// The winding of `q` that is nearest to `reference`.
///
/// ```
/// use redundancy_core::joint_space::nearest;
/// assert_eq!(nearest(0.25, 6.0), 0.25 + std::f64::consts::TAU);
/// ```
#[inline(always)]
pub fn nearest(q: f64, reference: f64) -> f64 {
    q + shift(reference - q)
}

/// [`nearest`] for every entry.
#[inline(always)]
pub fn nearest_all<const N: usize>(q: &[f64; N], reference: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| nearest(q[i], reference[i]))
}

/// [`nearest`] for every entry, in place; entries beyond the shorter row stay.
#[inline(always)]
pub fn nearest_row(q: &mut [f64], reference: &[f64]) {
    for (q, reference) in q.iter_mut().zip(reference) {
        *q = nearest(*q, *reference);
    }
}

/// Largest difference of two entries of rows of angles, the short way round.
#[inline]
pub fn most_apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| difference(*a, *b).abs()).fold(0.0, f64::max)
}

/// Whole turns by which a step is longer than the short way, for the step between two angles in `(-pi, pi]`: -1, 0 or 1.
#[inline(always)]
pub fn turns_over(step: f64) -> i32 {
    i32::from(step > PI) - i32::from(step < -PI)
}

/// The value in `(-period / 2, period / 2]` that differs by whole periods: [`wrap`] where something repeats after other than a
/// turn, as functions of half an angle do.
#[inline]
pub fn wrap_over(value: f64, period: f64) -> f64 {
    let r = value - period * (value / period).round();
    if r <= -0.5 * period { r + period } else { r }
}

/// The other way round to an angle: a period less in size, on the other side of zero.
#[inline(always)]
pub fn other_way(angle: f64, period: f64) -> f64 {
    angle - period.copysign(angle)
}

/// `end` with the winding that a monotone joint reaches from `start` when it turns in the sense of `direction`, by less than a turn.
/// Steps of at most [`UNWIND_ROUNDING`] against it are rounding.
#[inline(always)]
pub fn monotone(start: f64, end: f64, direction: f64) -> f64 {
    let step = (end - start) - shift(end - start);
    // A step against the direction is rounding, or more than half a turn.
    let against = (step * direction < 0.0) & (step.abs() > UNWIND_ROUNDING);
    start + step + if against { TURN.copysign(direction) } else { 0.0 }
}

/// Entry `i` of a list of angles that goes on around the circle: after the last one comes the first one, a turn further.
///
/// ```
/// use redundancy_core::joint_space::around;
/// assert_eq!(around(&[0.5, 1.5, 2.5], 4), 1.5 + std::f64::consts::TAU);
/// ```
///
/// # Panics
/// Never; of an empty list it is NaN.
#[inline(always)]
pub fn around(angles: &[f64], i: usize) -> f64 {
    // A division costs more than all the rest.
    if let Some(angle) = angles.get(i) {
        return *angle;
    }
    let n = angles.len().max(1);
    angles.get(i % n).map_or(f64::NAN, |angle| turned(*angle, (i / n) as f64))
}
