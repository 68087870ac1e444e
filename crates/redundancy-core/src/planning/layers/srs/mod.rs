//! The layers of S-R-S arms: circles of the swivel, eight lanes at a time.

pub(in crate::planning) mod clearance;
pub(in crate::planning) mod explain;
pub(in crate::planning) mod problem;
mod refine;
pub(in crate::planning) mod search;
pub(in crate::planning) mod settings;
