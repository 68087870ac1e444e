//! From joint positions to poses, Jacobians and Hessians, for any number of joints, and the tasks that count them.

mod batch;
mod forward;
mod hessian;
mod jacobian;
mod scratch;
mod task;
mod trigonometry;

pub use scratch::{Kinematics, Scratch};
pub use task::{Task, TaskError, TaskKind, rotation_vector};
