//! One binary for the public behaviour of the core.

mod rotation;
mod smoke;
