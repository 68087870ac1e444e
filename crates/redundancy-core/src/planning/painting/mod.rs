//! The spray gun: rules for the tool's orientation, and the orientation that lets it go fastest.

#[cfg(feature = "plan")]
mod curve;
#[cfg(feature = "plan")]
mod motion;
#[cfg(feature = "plan")]
mod plan;
#[cfg(feature = "plan")]
mod program;
mod rule;
#[cfg(feature = "plan")]
mod search;

#[cfg(feature = "plan")]
pub use plan::{
    Bottleneck, OrientationPlan, OrientationPlanSettings, SpeedBound, SpinRange, plan_orientation,
};
pub use rule::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface, tool_down};
