//! Seven-joint arms with a spherical shoulder and wrist: the circles of the swivel.

mod arm;
mod batch;
mod chart;
mod circle;
mod geometry;
mod intervals;
mod optimum;
mod solutions;
mod spherical;

pub use arm::{SrsArm, Swivel};
pub use batch::{BatchChoice, BranchInterval};
pub use chart::Chart;
pub use circle::{Branch, SelfMotion};
pub use optimum::Choice;

pub(crate) use arm::signs;
pub(crate) use batch::at;
pub(crate) use geometry::{Line, distance_to_line, orthonormal, rotation_y, spherical};
