//! Whole paths.

mod swivel_plan;

pub use swivel_plan::{SwivelChoice, SwivelPlan, SwivelPlanSettings, plan_swivel};
