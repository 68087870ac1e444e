//! From joint positions to poses, Jacobians, Hessians and torques, for any number of joints, and the tasks that count them.

mod batch;
mod forward;
mod hessian;
mod inverse_dynamics;
mod jacobian;
mod link_jacobian;
mod null_space;
mod scratch;
mod task;
mod trigonometry;

pub(crate) use inverse_dynamics::SplitDerivatives;
pub use inverse_dynamics::{DynamicsScratch, TorqueDerivatives};
pub use link_jacobian::{JacobianFrame, JacobianOf};
pub use null_space::NullSpace;
pub use scratch::{Kinematics, Scratch};
pub use task::{Task, TaskError, TaskKind, rotation_vector};
