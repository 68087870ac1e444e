//! Whole paths: which configuration and which tool orientation, point by point and all at once.

mod layers;
mod local;
mod painting;
mod swivel_plan;

pub use layers::srs::settings::{SwivelChoice, SwivelPlanSettings};
pub use local::{FlowForm, FlowState, FlowStep, SwivelFlow, SwivelFlowSettings, Track, TrackSettings, track};
pub use painting::{
    BarrierRule, Bottleneck, OrientationPlan, OrientationPlanSettings, OrientationRule, RuleKind, RuleSpin,
    SpeedBound, SpinRange, Surface, plan_orientation, tool_down,
};
pub use swivel_plan::plan_swivel;
