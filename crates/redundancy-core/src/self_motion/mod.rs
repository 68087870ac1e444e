//! The set of configurations over one pose, as an object.
//!
//! A seven-joint arm whose shoulder and wrist are spherical meets a pose on up to eight circles. [`SrsArm`]
//! recognises such arms from their geometry; [`SelfMotion`] is the set over one pose and [`Branch`] one circle of
//! it, with the exact arcs on which the joint limits hold.

mod batch;
mod chart;
mod circle;
mod continuation;
mod geometry;
mod intervals;
mod optimum;
mod spherical;
mod srs;

pub use batch::{BatchChoice, BranchInterval};
pub use chart::Chart;
pub use circle::{Branch, SelfMotion};
pub(crate) use continuation::{Fibre, geometric, random_configurations, short_way, wind};
pub use continuation::{
    SelfMotionCurve, TraceSettings, self_motion_curves, self_motion_patch, trace_self_motion,
};
pub use geometry::Defect;
pub use optimum::Choice;
pub use srs::{SrsArm, Swivel};

// What the closed form of arms with a spherical wrist shares with this one.
pub(crate) use batch::at;
pub(crate) use circle::outside;
pub(crate) use geometry::{Line, distance_to_line, orthonormal, rotation_y, spherical, wrapped};
pub(crate) use optimum::nearest_winding;
pub(crate) use srs::{opposite, principal, signs, within};
