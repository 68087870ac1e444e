//! The spray gun: rules for the tool's orientation, and the orientation that lets it go fastest.

mod curve;
mod motion;
mod plan;
mod program;
mod rule;
mod search;

pub use plan::{
    Bottleneck, OrientationPlan, OrientationPlanSettings, SpeedBound, SpinRange, plan_orientation,
};
pub use rule::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface, tool_down};
