//! Orientations and sets of them; no robot in here.
//!
//! Pointing, spraying, welding and polishing leave the tool partly free. This room makes that freedom a set with a
//! margin and finds the best orientation in it.
//!
//! | file | what |
//! |---|---|
//! | `quaternion` | scalar-first bridge, Euler angles, swing and twist, shortest arc, error |
//!
//! Tangent vectors are rotation vectors (rad) in body axes: `q` moves to `q * exp(delta)`.

mod quaternion;

pub use quaternion::{
    from_axis_angle, from_rpy, from_wxyz, from_xyz, from_zyz, quaternion_error, rotation_angle, shortest_arc,
    swing_twist, to_rpy, to_wxyz, to_xyz, to_zyz, unit_direction,
};
