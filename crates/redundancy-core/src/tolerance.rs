//! Every numeric threshold of the crate, named, with the reason for its size.

/// Largest deviation of `R^T R` from the identity (max norm) in a pose given by the caller.
/// Single-precision matrices (6e-8 per entry) pass, matrices with a typing error do not.
pub const ROTATION_ORTHONORMAL: f64 = 1e-6;

/// Least norm of a vector that is meant as a direction: below it the rounding of the entries decides.
pub const DIRECTION_NORM: f64 = 1e-9;

/// Largest deviation from 1 of the norm of an axis that is taken as unit already: four units in the last place,
/// what normalising and computing the norm can leave.
pub const UNIT_AXIS: f64 = 4.0 * f64::EPSILON;

/// Largest deviation from 1 of the norm of a quaternion that is silently normalised (file input).
pub const QUATERNION_NORM: f64 = 1e-3;
