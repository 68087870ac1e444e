//! Windings of joint angles: the one place where whole turns are added or removed.
//!
//! A turning joint takes the same position at `q` and at `q + 2 pi k`. The number k is its winding; limits, cables and the
//! way from one configuration to the next depend on it, the pose of the tool does not. Everything here works on plain
//! numbers: whether a joint turns or slides, and what its limits are, the caller knows.
//!
//! | question | answer |
//! |---|---|
//! | which angle in `(-pi, pi]`? | [`wrap`], and [`wrap_sum`] for sums of two such angles |
//! | how far from one angle to another, the short way? | [`difference`] |
//! | which winding is nearest to a reference? | [`nearest`], [`nearest_within`] limits |
//! | is there a winding within limits, and which? | [`within`], [`wind_into`], all of them: [`windings`] |
//! | how far outside or inside of limits is the best winding? | [`outside`], [`margin`] |
//! | which windings of a range of angles meet limits? | [`turns_within`], [`nearest_span`] |
//! | how does an angle go on along a line? | [`nearest`] to the one before, [`monotone`] where its direction is known |
//!
//! **Half turns.** `(-pi, pi]` includes pi. Where two windings are equally near, [`turns`] takes the even number of turns, so an angle
//! exactly half a turn away keeps its winding.
//!
//! **Limits.** `lower <= upper`; infinite ones are none. The range may have no width. [`LIMIT_SLACK`](crate::tolerance::LIMIT_SLACK) is
//! allowed where a function says so. NaN is answered by NaN, `None` or false.

mod lanes;
mod limits;
mod wrap;

pub(crate) use lanes::{wrap_four, wrap_lanes};
pub use limits::{
    Span, holds, margin, nearest_span, nearest_within, outside, shift_within, turns_within, wind_into,
    windings, within,
};
pub use wrap::{
    TURN, around, difference, monotone, most_apart, nearest, nearest_all, nearest_row, opposite, other_way,
    shift, turned, turns, turns_over, wrap, wrap_over, wrap_sum,
};
