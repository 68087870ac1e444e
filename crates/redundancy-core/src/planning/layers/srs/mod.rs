//! The layers of S-R-S arms: circles of the swivel, eight lanes at a time.
//!
//! | file | what |
//! |---|---|
//! | `settings` | what a plan is asked for |
//! | `windings` | the windings of seven joints as one number |
//! | `clearance` | distance of an arm from obstacles over one pose |
//! | `anchor` | what distances at one swivel prove about others |
//! | `obstacles` | the obstacles along a path |
//! | `problem` | circles, limits, windings, obstacles, and what all that costs |
//! | `grid` | the nodes over each point |
//! | `search` | dynamic programming over them |
//! | `backtrack` | the way back through a search |
//! | `tube`, `polish` | refinement of a line |
//! | `explain` | the verdict |

mod anchor;
mod backtrack;
pub(in crate::planning) mod clearance;
pub(in crate::planning) mod explain;
pub(in crate::planning) mod grid;
pub(in crate::planning) mod near;
mod obstacles;
mod polish;
pub(in crate::planning) mod problem;
mod search;
pub(in crate::planning) mod settings;
mod tube;
mod windings;
