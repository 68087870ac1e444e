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

/// Largest URDF that is read, in bytes. The largest public ones (humanoids) have about 1 MB; the limit bounds the
/// memory and time that a hostile file can take.
pub const URDF_BYTES: usize = 16 << 20;

/// Most XML nodes of a URDF: thirty times those of a humanoid, some 100 MB once parsed.
pub const URDF_NODES: u32 = 1_000_000;

/// Most attributes of one element of a URDF. The format has elements with six; looking for duplicates costs the
/// square of their number.
pub const URDF_ATTRIBUTES: usize = 256;

/// Most namespace declarations in a URDF. Expanded xacro files have a handful; each nested one copies its parents'.
pub const URDF_NAMESPACES: usize = 256;

/// Largest angle, rad, that the crate's own sine and cosine reduce: its count of quarter turns stays below 2^20, so
/// that the products of the reduction are exact. No joint turns that far; the C library takes the rest.
pub const REDUCTION_LIMIT: f64 = 1e6;
