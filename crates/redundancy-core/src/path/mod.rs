//! Paths of poses and trajectories of joints, with their files.
//!
//! A [`Path`] is a row of tool poses (or positions) ordered by arc length, with a curve through them; a
//! [`Trajectory`] is a row of joint positions and velocities over time, with what happened on the way as events.
//!
//! # The curve between samples
//! Positions `p(s)` and orientations `Q(s)` are C2 in the arc length `s` (metres):
//!
//! - A path made from samples carries a cubic spline with not-a-knot ends. Its error is `O(h^4)`, and on its first
//!   and last two intervals it is one cubic, so no end condition is invented.
//! - Orientations are the same spline through the unit quaternions, signs chosen so that neighbours are less than
//!   half a turn apart, projected back on the sphere: `Q(s) = P(s) / |P(s)|`. The projection is smooth where
//!   `P != 0`, and since products with a fixed unit quaternion are rotations of the 4-space, the curve does not
//!   depend on the base frame or on the tool frame in which the poses are written (a spline of rotation vectors or
//!   of Euler angles does). Samples should be less than a right angle apart; the chord then stays clear of 0.
//! - [`Circle`] and [`Raster`] keep their analytic position between samples.
//!
//! Derivatives with respect to `s`: `p'` and `p''` in 1 and 1/m, the rate of turning `omega` with
//! `Q' = (0, omega) * Q / 2` in rad/m and base axes, and `omega'` in rad/m^2.
//!
//! # Degenerate input
//! Samples at the same place and with the same orientation (a stop) share their `s`. A step that turns the tool on
//! the spot has no length; without given `s` it counts [`TURN_LENGTH`](crate::tolerance::TURN_LENGTH) per radian, so
//! that every pose has its own `s`.
//!
//! Cost: building `O(N)`, evaluating `O(log N)`.

mod bspline;
mod edit;
#[cfg(feature = "io")]
mod files;
mod joint_rows;
#[cfg(feature = "io")]
mod joint_rows_files;
#[allow(clippy::module_inception)]
mod path;
mod piece;
mod plan;
mod sample;
mod section;
mod shapes;
mod spline;
#[cfg(feature = "io")]
mod table;
mod timed;
mod timing;
mod trajectory;

pub(crate) use bspline::{Local as LocalBasis, QuinticBasis, QuinticSpline, WIDTH as QUINTIC_SAMPLES};
pub use joint_rows::JointRows;
pub use path::{Path, PathPoint};
pub use piece::{PathPiece, Shape};
pub(crate) use plan::broken_limits;
pub use plan::{BlockedPoint, Pieces, Plan, PlanBuilder, Reconfiguration, SpareCoordinate};
pub use sample::TrajectorySample;
pub use section::Section;
pub use shapes::{Circle, Raster};
pub(crate) use spline::knot_derivatives;
pub use timed::{Reference, TimedPath};
pub(crate) use timing::differences;
pub use timing::{TimingSettings, times_within_limits};
pub use trajectory::{Event, EventKind, Trajectory};
