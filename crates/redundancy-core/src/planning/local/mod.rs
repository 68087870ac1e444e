//! Schemes that consider one step of the path at a time.

mod contact;
mod swivel_flow;
mod track;

pub use swivel_flow::{FlowForm, FlowState, FlowStep, SwivelFlow, SwivelFlowSettings};
pub use track::{Track, TrackSettings, track, track_beside};
