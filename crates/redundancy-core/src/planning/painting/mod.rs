//! The spray gun: rules for the tool's orientation, and the orientation that allows the highest speed.

#[cfg(feature = "plan")]
mod convex;
#[cfg(feature = "plan")]
mod curve;
#[cfg(feature = "plan")]
mod motion;
#[cfg(feature = "plan")]
mod plan;
#[cfg(feature = "plan")]
mod planner;
#[cfg(feature = "plan")]
mod program;
#[cfg(feature = "plan")]
mod result;
mod rule;
#[cfg(feature = "plan")]
mod settings;
#[cfg(feature = "plan")]
mod starts;
#[cfg(feature = "plan")]
mod verify;

#[cfg(feature = "plan")]
pub use plan::plan_orientation;
#[cfg(feature = "plan")]
pub use result::{Bottleneck, OrientationPlan, SpeedBound};
pub use rule::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface, tool_down};
#[cfg(feature = "plan")]
pub use settings::{OrientationPlanSettings, SpinRange};
