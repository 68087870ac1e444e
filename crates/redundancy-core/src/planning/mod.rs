//! Whole paths: which configuration and which tool orientation, point by point and all at once.

mod arm_clearance;
mod lines;
mod orientation_plan;
mod orientation_rule;
mod speed;
mod swivel_flow;
mod swivel_plan;
mod swivel_problem;
mod swivel_refine;
mod swivel_search;
mod tracker;

pub use orientation_plan::{
    OrientationPlan, OrientationPlanSettings, PlanWatch, SpinRange, plan_orientation,
};
pub use orientation_rule::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface, tool_down};
pub use speed::{
    MaxSpeed, SpeedLimit, SpeedProfile, SpeedSettings, fastest_line, fastest_profile, max_speed,
};
pub use swivel_flow::{FlowForm, FlowState, FlowStep, SwivelFlow, SwivelFlowSettings};
pub use swivel_plan::{SwivelChoice, SwivelPlan, SwivelPlanSettings, plan_swivel};
pub use tracker::{Track, TrackSettings, track};
