//! Six-joint arms whose axes 2, 3 and 4 are parallel.

mod arm;
mod geometry;
mod solutions;

pub use arm::ParallelAxesArm;
pub use solutions::ParallelAxesConfigurations;
