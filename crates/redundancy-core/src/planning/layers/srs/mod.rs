//! The layers of S-R-S arms: circles of the swivel, eight lanes at a time.

pub(in crate::planning) mod clearance;
pub(in crate::planning) mod problem;
mod refine;
mod report;
pub(in crate::planning) mod search;
