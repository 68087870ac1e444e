//! Whole paths: which configuration and which tool orientation, point by point and all at once.

mod layers;
mod local;
mod painting;
mod swivel_plan;

pub use local::{FlowForm, FlowState, FlowStep, SwivelFlow, SwivelFlowSettings, Track, TrackSettings, track};
pub use painting::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface, tool_down};
#[cfg(feature = "plan")]
pub use painting::{OrientationPlan, OrientationPlanSettings, PlanWatch, SpinRange, plan_orientation};
pub use swivel_plan::{SwivelChoice, SwivelPlan, SwivelPlanSettings, plan_swivel};
