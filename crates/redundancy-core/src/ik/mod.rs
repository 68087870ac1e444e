//! Inverse kinematics: from poses to configurations.
//!
//! [`IkSolver`] answers for any chain: through the closed form where the arm has one, otherwise numerically from ranked
//! starts. [`SphericalWristArm`](crate::solutions::SphericalWristArm) is the closed form of six-joint arms with a spherical wrist; that of seven-joint arms is
//! [`SrsArm`](crate::solutions::SrsArm).

mod batch;
mod descent;
mod goal;
mod newton;
mod sinusoid;
mod solver;
mod starts;

pub use crate::rotation::OrientationSet;
pub use batch::IkBatch;
pub use descent::{
    Attraction, CostMeasure, DescentMethod, DescentSettings, GradientKind, SweepOrder, default_joint_weights,
};
pub use goal::task_target;
pub use sinusoid::{CostWeights, HalfAngle, Sinusoid, pose_cost, quaternion_cost, slide_within};
pub use solver::{IkMemory, IkMethod, IkResult, IkSettings, IkSolver, IkTrace};
