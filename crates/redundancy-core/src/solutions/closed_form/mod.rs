//! Arms whose configurations over a pose are known in closed form.
//!
//! A form is a folder with a type that recognises its arms and implements [`ClosedForm`], and one row in `registry.rs`.
//! [`closed_form`] asks the rows; every caller (inverse kinematics, lines over a path, self-motion, planners) goes
//! through it and sees a new form at once.

mod form;
mod gimbal;
mod interval;
mod lanes;
mod lines;
pub mod panda_class;
pub mod parallel_axes;
mod polish;
mod registry;
mod slope;
pub mod spherical_wrist;
pub mod srs;

pub(crate) use form::sign_label;
pub use form::{ClosedForm, Defect};
pub use registry::closed_form;
