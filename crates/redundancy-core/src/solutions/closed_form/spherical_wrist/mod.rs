//! Six-joint arms with a spherical wrist.

mod arm;
mod complex;
mod geometry;
mod solutions;

pub use arm::{Configurations, SphericalWristArm};
