//! When to be where: the largest constant speed and the fastest profile along a path.

mod retime;
mod speed;

pub use retime::{LimitKind, Limiting, RetimeSettings, Retimed, retime};
pub use speed::{
    MaxSpeed, SpeedLimit, SpeedProfile, SpeedSettings, fastest_profile, max_speed, max_speed_of_poses,
};
