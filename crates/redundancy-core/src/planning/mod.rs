//! Whole paths: which configuration and which tool orientation, point by point and all at once.

mod layers;
mod local;
mod painting;
mod swivel_plan;

pub use local::{FlowForm, FlowState, FlowStep, SwivelFlow, SwivelFlowSettings, Track, TrackSettings, track};
pub use painting::{
    BarrierRule, OrientationPlan, OrientationPlanSettings, OrientationRule, PlanWatch, RuleKind, RuleSpin,
    SpinRange, Surface, plan_orientation, tool_down,
};
pub use swivel_plan::{SwivelChoice, SwivelPlan, SwivelPlanSettings, plan_swivel};
