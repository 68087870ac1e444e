//! Seven-joint arms with a spherical shoulder and wrist: the circles of the swivel.

mod arm;
mod batch;
mod chart;
mod choice;
mod circle;
mod elbow_circle;
mod geometry;
mod gimbal;
mod intervals;
mod optimum;
mod paper;
mod solutions;
mod spherical;
mod spring_search;
mod stretches;
mod widest;

pub use arm::{SrsArm, Swivel};
pub use batch::{BatchChoice, BranchInterval};
pub use chart::Chart;
pub use choice::Choice;
pub use circle::{Branch, SelfMotion};
pub use paper::PaperQuaternions;

pub(crate) use batch::at;
pub(crate) use elbow_circle::signs;
pub(crate) use geometry::{AxisLine, distance_to_line, orthonormal, rotation_y, spherical};
