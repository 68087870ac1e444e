//! From poses to configurations.
//!
//! [`IkSolver`] answers for any chain: through the closed form where the arm has one, otherwise numerically from ranked
//! starts. [`SphericalWristArm`] is the closed form of six-joint arms with a spherical wrist; that of seven-joint arms is
//! [`SrsArm`](crate::self_motion::SrsArm).

mod batch;
mod complex;
mod goal;
mod newton;
mod solver;
mod spherical_wrist;
mod starts;
mod wrist_geometry;

pub use batch::IkBatch;
pub use goal::{OrientationSet, task_target};
pub use solver::{IkMemory, IkMethod, IkResult, IkSettings, IkSolver};
pub use spherical_wrist::{Configurations, SphericalWristArm};
