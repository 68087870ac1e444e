//! Six-joint arms with a spherical wrist.

mod arm;
mod complex;
mod geometry;

pub use arm::{Configurations, SphericalWristArm};
