//! The set of configurations over one pose, as an object.
//!
//! A seven-joint arm whose shoulder and wrist are spherical meets a pose on up to eight circles. [`SrsArm`]
//! recognises such arms from their geometry; [`SelfMotion`] is the set over one pose and [`Branch`] one circle of
//! it, with the exact arcs on which the joint limits hold.

mod capability;
pub mod closed_form;
mod continuation;
mod curve;
mod found;
pub(crate) mod lines;
mod over_pose;
mod patch;
pub(crate) mod search;
#[allow(clippy::module_inception)] // the trait's file has the name of the trait
mod solutions;
mod widest;

pub use capability::{Capability, CapabilitySettings, Measures, Metric};
pub use closed_form::panda_class::{PandaClassArm, PandaMotion};
pub use closed_form::parallel_axes::{ParallelAxesArm, ParallelAxesConfigurations};
pub use closed_form::spherical_wrist::{Configurations, SphericalWristArm};
pub use closed_form::srs::{
    BatchChoice, Branch, BranchInterval, Chart, Choice, PaperQuaternions, SelfMotion, SrsArm, Swivel,
};
pub use closed_form::{ClosedForm, Defect, closed_form};
pub(crate) use continuation::random_configurations;
pub use continuation::{TraceSettings, self_motion_curves, trace_self_motion};
pub use curve::SelfMotionCurve;
pub(crate) use curve::geometric;
pub use found::{FoundPoints, TracedCurves};
pub use over_pose::{SolutionsSettings, solutions};
pub use patch::self_motion_patch;
pub(crate) use search::room;
pub use solutions::{Solution, Solutions};
pub(crate) use solutions::{check_margin, check_piece};
pub(crate) use widest::best_margin;

// What the closed forms share.
pub(crate) use closed_form::srs::{
    AxisLine, at, distance_to_line, orthonormal, rotation_y, signs, spherical,
};
