//! The servo: a target pose per tick in, joint positions out, under limits that hold whatever the input.
//!
//! | file | what it does |
//! |---|---|
//! | `filter` | the target without its noise, and what of it was a jump |
//! | `reference` | the configuration to move to: pose, elbow, freedom, reach |
//! | `elbow` | the elbow's angle about the line from shoulder to wrist |
//! | `joint` | one joint's step towards it, such that braking stays possible |
//! | `foresight` | how long the tool can go on before the arm has to stop |
//! | `thresholds` | the constants and their reasons |
//! | `servo` | the tick that puts them together |

mod elbow;
mod filter;
mod foresight;
mod joint;
mod reference;
mod servo;
mod thresholds;

pub use filter::TargetNoise;
pub use joint::ServoLimitKind;
pub use servo::{Servo, ServoLimit, ServoReason, ServoReport, ServoSettings, ServoTarget};
