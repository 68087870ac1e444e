//! One binary for the public behaviour of the core.

// clippy.toml covers `#[test]` functions only; here every function is part of a test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod allocations;
mod rotation;
mod smoke;
