//! From joint positions to poses, Jacobians and torques, for any number of joints.

mod batch;
mod forward;
mod inverse_dynamics;
mod jacobian;
mod scratch;
mod trigonometry;

pub use inverse_dynamics::{DynamicsScratch, TorqueDerivatives};
pub use scratch::{Kinematics, Scratch};
