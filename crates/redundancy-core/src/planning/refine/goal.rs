//! What is minimised.

use super::super::demand::{Demand, Objective};

/// What is minimised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum Goal {
    /// The cost.
    Cost,
    /// The cost, with the weighted joint speeds below a cap.
    Capped(f64),
    /// The cost and the largest weighted joint speed: this many times as important, relative to where it starts.
    Peak(f64),
}

/// Whether the length of the steps is minimised.
pub(super) fn is_length(demand: &Demand) -> bool {
    demand.objective == Objective::Length
}
