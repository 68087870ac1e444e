//! Timing: the largest constant speed, the fastest profile along a path, times for joint paths, and whether a
//! trajectory can be run.

mod check;
mod joint_move;
mod retime;
mod speed;

pub use check::{
    CheckAgainst, CheckReport, CheckSettings, Finding, FindingKind, Severity, check, check_rows,
};
pub use joint_move::joint_move;
pub use retime::{LimitKind, Limiting, RetimeSettings, Retimed, retime};
pub use speed::{
    MaxSpeed, SpeedLimit, SpeedProfile, SpeedSettings, fastest_profile, max_speed, max_speed_of_poses,
};
