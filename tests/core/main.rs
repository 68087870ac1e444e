//! Public behaviour of the core: properties, agreement, paper tables.

// The helpers of tests may fail as loudly as the tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod allocations;
mod chain;
mod chain_catalog;
mod chain_urdf;
mod kinematics;
