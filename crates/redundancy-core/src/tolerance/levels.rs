//! Thresholds of wishes, blocked tasks, priorities, the acceleration level and the criteria that they use.

/// Share of the largest row of a task's Jacobian below which what tasks above it leave of a row is zero: the task has lost
/// that direction.
pub const LEVEL_RANK: f64 = 1e-9;

/// Multiplier of a bound in the proof that a scale is the largest, above which the bound holds with equality in every
/// solution; below it may be rounding.
pub const FROZEN_MULTIPLIER: f64 = 1e-9;

/// Distance (rad/s, relative to 1 + the bound) from its bound, and length of a row in what is left free, up to which the
/// row counts as being there, and as decided.
pub const FROZEN_ROW: f64 = 1e-9;

/// Weight of the joint velocity beside the task, not squared, in one round of the proximal point method.
pub const PROXIMAL_WEIGHT: f64 = 0.01;

/// Change of the joint velocity (rad/s) in one round below which the proximal point method has arrived.
pub const PROXIMAL_CHANGE: f64 = 1e-10;

/// Task velocity (m/s, rad/s) that is missing from a level below which it is met.
pub const PRIORITY_RESIDUAL: f64 = 1e-9;

/// Sine of the angle between two directions below which the plane that they span is rounding.
pub const CONE_AXIS_SINE: f64 = 1e-9;

/// Scale of the task below which it is blocked: the tool would stand still to every user's eye.
pub const BLOCKED_SCALE: f64 = 1e-6;

/// Weight of the joint velocity beside the task, squared, where no scale is allowed and the task is only approached.
pub const YIELD_WEIGHT: f64 = 1e-6;

/// Velocity, relative to 1 + that of the task, by which the task may be missed where the arm has lost a direction that it
/// does not need.
pub const UNREACHABLE_VELOCITY: f64 = 1e-9;

/// Step (rad or m) of the central differences of a criterion's values: truncation and rounding balance at the cube root of
/// the precision.
pub const VALUE_DIFFERENCE: f64 = 6e-6;

/// Step (rad or m) of the central differences of a gradient that is known in closed form.
pub const GRADIENT_DIFFERENCE: f64 = 6e-6;

/// Step (rad or m) of the differences of a gradient that is itself one of values: the fourth root of the precision.
pub const SECOND_DIFFERENCE: f64 = 2e-4;

/// Norm of the gravity torques (N m, N) below which they are zero: their direction is then rounding.
pub const TORQUE_ZERO: f64 = 1e-12;
