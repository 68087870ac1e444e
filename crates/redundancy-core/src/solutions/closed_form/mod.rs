//! Arms whose configurations over a pose are known in closed form.

mod lanes;
mod lines;
pub mod parallel_axes;
pub mod spherical_wrist;
pub mod srs;
