//! One binary for the public behaviour of the core: properties, agreement, paper tables.

// clippy.toml covers `#[test]` functions only; here every function is part of a test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod allocations;
mod architecture;
mod beside_a_pin;
mod bodies;
mod bodies_hostile;
mod capability;
mod chain;
mod chain_catalog;
mod chain_urdf;
mod contacts;
mod corrector;
mod criterion;
mod ik_descent;
mod ik_parallel_axes;
mod ik_solver;
mod ik_spherical_wrist;
mod inverse_dynamics;
mod joint_space;
mod kinematics;
mod optimum;
mod painting;
mod panda_class;
mod parallel;
mod path;
mod path_edit;
mod plan;
mod plan_path;
mod planning;
mod planning_brute;
mod planning_scene;
mod retime;
mod rotation;
mod scene;
mod self_motion;
mod solutions;
mod streaming;
mod support;
mod task;
mod trajectory_sample;
mod velocity;
