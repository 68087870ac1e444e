//! Redundancy resolution for robot arms: configurations, tool orientations and motions along whole paths.
//!
//! An arm is redundant if it has more joints than its task needs, or if the task leaves the tool partly free. The crate finds
//! the configurations for a pose and chooses among them along a whole path.
//!
//! # Notation
//! | symbol | meaning | unit |
//! |---|---|---|
//! | `q`, `qd`, `qdd` | joint positions, velocities, accelerations, base to tip | rad or m, per s, per s^2 |
//! | `R`, `p` | rotation and position of the tip in the base frame | -, m |
//! | `J` | geometric Jacobian, linear rows first, base axes at the tip | m, 1 |
//! | `s` | swivel: the angle of the elbow on its circle | rad |
//! | `n` | unit vector from shoulder to wrist | - |
//!
//! # Rooms
//! The modules are called rooms. A room uses only rooms to its left:
//! `rotation -> joint_space -> chain -> kinematics -> path, scene -> criterion -> solutions -> { ik | velocity | optimum | timing } -> { planning | streaming }`;
//! the files status, error, tolerance, watch and parallel at the root may be used everywhere.
//!
//! `Err` means invalid input; [`Status`] is the outcome of a computation on valid input.
//!
//! # Features
//! All are on by default; without them the crate needs nalgebra, thiserror, wide and a random generator.
//!
//! | feature | what it adds | packages |
//! |---|---|---|
//! | `urdf` | chains and collision geometry from URDF | roxmltree, urdf-rs |
//! | `io` | paths, trajectories and scenes as CSV and JSON | csv, serde, serde_json |
//! | `parallel` | batches and searches on all cores, with the same results | rayon |
//! | `plan` | `planning::plan_orientation` | clarabel |
//! | `mesh` | triangle meshes | parry3d-f64, mesh-loader |

// Helpers of a feature stay in without it; the build with all features finds what nothing needs.
#![cfg_attr(
    not(all(feature = "urdf", feature = "io", feature = "parallel", feature = "plan", feature = "mesh")),
    allow(dead_code, unused_imports)
)]

pub mod chain;
pub mod criterion;
pub mod ik;
pub mod joint_space;
pub mod kinematics;
pub mod optimum;
pub mod parallel;
pub mod path;
pub mod planning;
pub mod rotation;
pub mod scene;
pub mod solutions;
pub mod streaming;
pub mod timing;
pub mod tolerance;
pub mod velocity;

mod error;
mod pose;
mod status;
mod watch;

pub use error::{Error, Result};
pub use nalgebra;
pub use pose::{Pose, pose_from_row_major, pose_to_row_major, rotation_from_matrix};
pub use status::Status;
pub use watch::{Deadline, Interrupted, Watch, WatchPart};
