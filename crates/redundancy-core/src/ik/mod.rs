//! From poses to configurations.
//!
//! [`SphericalWristArm`] is the closed form of six-joint arms with a spherical wrist; that of seven-joint arms is
//! [`SrsArm`](crate::self_motion::SrsArm).

mod complex;
mod spherical_wrist;
mod wrist_geometry;

pub use spherical_wrist::{Configurations, SphericalWristArm};
