//! From joint positions to poses, Jacobians, Hessians and torques, for any number of joints, and tasks: the coordinates that count.

mod batch;
mod corrector;
mod forward;
mod freedom;
mod hessian;
mod inverse_dynamics;
mod jacobian;
mod link_jacobian;
mod middle_frame;
mod normal_equations;
mod null_space;
mod pose_error;
mod scratch;
mod task;
mod task_acceleration;
mod trigonometry;

pub use corrector::{Corrector, CorrectorSettings, MOST_COORDINATES, StepBound};
pub use freedom::{SpinFreedom, ToolFreedom};
pub use inverse_dynamics::{DynamicsScratch, TorqueDerivatives};
pub(crate) use inverse_dynamics::{Mass, Six, SplitDerivatives};
pub use link_jacobian::{JacobianFrame, JacobianOf};
pub use middle_frame::MiddleFrame;
pub(crate) use normal_equations::{factor, normal_matrix, solve};
pub use null_space::NullSpace;
pub use pose_error::{PoseError, rotation_vector};
pub use scratch::{Kinematics, Scratch};
pub use task::{Task, TaskError, TaskKind};
