//! From poses to configurations.
//!
//! [`SphericalWristArm`] is the closed form of six-joint arms with a spherical wrist; that of seven-joint arms is
//! [`SrsArm`](crate::self_motion::SrsArm).

mod complex;
mod goal;
mod newton;
mod solver;
mod spherical_wrist;
mod starts;
mod wrist_geometry;

pub use goal::OrientationSet;
pub use solver::{IkMemory, IkMethod, IkResult, IkSettings, IkSolver};
pub use spherical_wrist::{Configurations, SphericalWristArm};
