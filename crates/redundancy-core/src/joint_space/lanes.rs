//! Several angles at a time.

use wide::{f32x8, f64x4};

use super::TURN;

/// Eight angles, each in `[-pi, pi]` up to the rounding of single precision.
#[inline(always)]
pub(crate) fn wrap_lanes(angles: f32x8) -> f32x8 {
    let (turn, turns) = (f32x8::splat(TURN as f32), f32x8::splat((1.0 / TURN) as f32));
    angles - (angles * turns).round_ties_even() * turn
}

/// Four angles, each in `[-pi, pi]`.
#[inline(always)]
pub(crate) fn wrap_four(angles: f64x4) -> f64x4 {
    angles - (angles * f64x4::splat(1.0 / TURN)).round() * f64x4::splat(TURN)
}
