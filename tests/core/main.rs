//! One binary for the public behaviour of the core.

// clippy.toml covers `#[test]` functions only; here every function is part of a test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
// Numbers as they stand in URDFs.
#![allow(clippy::approx_constant)]
// The helpers of tests may fail as loudly as the tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod allocations;
mod chain;
mod chain_catalog;
mod chain_urdf;
mod kinematics;
mod path;
mod planning;
mod self_motion;
mod support;
