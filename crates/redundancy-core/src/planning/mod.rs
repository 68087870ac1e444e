//! Whole paths: which configuration and which tool orientation, point by point and all at once.

mod around;
mod demand;
mod explain;
mod fill;
mod layers;
mod local;
mod nodes;
mod painting;
mod planner;
mod pull;
mod push;
mod reach;
mod refine;
mod report;
mod search;
mod sections;
mod swivel_plan;
mod tool;
mod verify;

pub use demand::{Objective, PlanSettings};
pub use layers::srs::settings::{SwivelChoice, SwivelPlanSettings};
pub use local::{
    FlowForm, FlowState, FlowStep, SwivelFlow, SwivelFlowSettings, Track, TrackSettings, track, track_beside,
};
pub use painting::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface, tool_down};
#[cfg(feature = "plan")]
pub use painting::{
    Bottleneck, OrientationPlan, OrientationPlanSettings, SpeedBound, SpinRange, plan_orientation,
};
pub use planner::plan;
pub use swivel_plan::plan_swivel;
