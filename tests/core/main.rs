//! One binary for the public behaviour of the core.

mod self_motion;
mod support;
