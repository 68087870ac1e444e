//! From joint positions to poses and Jacobians, for any number of joints.

mod batch;
mod forward;
mod jacobian;
mod scratch;
mod trigonometry;

pub use scratch::{Kinematics, Scratch};
