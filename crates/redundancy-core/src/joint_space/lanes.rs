//! Eight angles at a time, single precision.

use wide::f32x8;

use super::TURN;

/// Every lane in `[-pi, pi]`, up to rounding.
#[inline(always)]
pub(crate) fn wrap_lanes(angles: f32x8) -> f32x8 {
    let (turn, turns) = (f32x8::splat(TURN as f32), f32x8::splat((1.0 / TURN) as f32));
    angles - (angles * turns).round_ties_even() * turn
}
