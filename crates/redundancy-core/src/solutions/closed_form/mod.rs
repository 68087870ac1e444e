//! Arms whose configurations over a pose are known in closed form.

pub mod spherical_wrist;
pub mod srs;
