//! Orientations and sets of orientations, without a robot.
//!
//! Pointing, spraying, welding and polishing leave the tool partly free. This room makes that freedom a set with a
//! margin and finds the best orientation in it.
//!
//! | file | what |
//! |---|---|
//! | `quaternion` | scalar-first bridge, Euler angles, swing and twist, shortest arc, error |
//! | `volume` | [`QuaternionVolume`]: sets of orientations [FromGravdahl2007, sections 2, 3] |
//! | `orientation_set` | [`OrientationSet`]: intersections and unions of volumes and cones |
//! | `long_sequence` | sequences of more than three rotations: margin, the nearest member |
//! | `sequence` | their sequences of bounded rotations: angles, margins, the nearest member |
//! | `cone` | [`Cone`], [`Spin`]: smooth margins with gradient and Hessian [FromGravdahl2009, section III] |
//! | `barrier` | logarithmic barriers of those margins |
//! | `arc` | [`TwoCones`]: two cones on one axis in closed form |
//! | `start` | a feasible start, or the angle by which the sets miss |
//! | `fixed_step` | the paper's iteration with a fixed step |
//! | `on_axis` | fixed steps and Newton for cones on one body axis, on that axis alone |
//! | `newton` | Newton's method on S^3 |
//! | `gradient` | the paper's gradient method |
//! | `structure` | what the constraints of a problem have in common |
//! | `optimize` | [`OrientationOptimizer`] |
//! | `directions` | [`optimal_directions`] |
//!
//! Tangent vectors are rotation vectors (rad) in body axes: `q` moves to `q * exp(delta)`.

mod arc;
mod barrier;
mod cone;
mod directions;
mod fixed_step;
mod gradient;
mod long_sequence;
mod newton;
mod on_axis;
mod optimize;
mod orientation_set;
mod quaternion;
mod sequence;
mod start;
mod structure;
mod volume;

pub use arc::{DirectionMinimum, TwoCones};
pub use barrier::Barrier;
pub use cone::{Cone, Constraint, Spin};
pub use directions::{DirectionCones, optimal_directions};
pub use optimize::{OrientationMethod, OrientationOptimizer, OrientationSettings, OrientationSolution};
pub use orientation_set::{OrientationSet, SET_DRAWS};
pub use quaternion::{
    compose, from_axis_angle, from_rotation, from_rounded_wxyz, from_rpy, from_wxyz, from_xyz, from_zyz,
    quaternion_error, rotation_angle, shortest_arc, swing_twist, to_axis_angle, to_rpy, to_wxyz, to_xyz,
    to_zyz, unit_direction,
};
pub use volume::{CrossSection, QuaternionVolume, SectionDistance, SectionShape};
