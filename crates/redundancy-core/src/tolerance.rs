//! Every numeric threshold of the crate, named, with the reason for its size.

/// Largest deviation of `R^T R` from the identity (max norm) in a pose given by the caller.
/// Single-precision matrices (6e-8 per entry) pass, matrices with a typing error do not.
pub const ROTATION_ORTHONORMAL: f64 = 1e-6;

/// Least norm of a vector that is meant as a direction: below it the rounding of the entries decides.
pub const DIRECTION_NORM: f64 = 1e-9;

/// Largest deviation from 1 of the norm of a quaternion that is silently normalised (file input).
pub const QUATERNION_NORM: f64 = 1e-3;

/// Largest deviation from 1 of the norm of a quaternion given by the caller; accepted ones are normalised.
/// Single-precision quaternions (1e-7) and four printed decimals do not mix: the first pass, the second do not.
pub const QUATERNION_UNIT: f64 = 1e-6;

/// Least norm of the part of a quaternion that an Euler angle, a twist or an antipodal arc is read from. Below it
/// fewer than four of its digits are left, so the degenerate rule decides.
pub const ANGLE_PART: f64 = 1e-12;

/// Largest distance, rad, of an orientation from a volume of fewer than three rotations at which it still counts
/// as lying in it: the margin then speaks of the bounds. Equal to the default tolerance of membership.
pub const VOLUME_OFF_SET: f64 = 1e-9;

/// Angle, rad, from the gimbal position of a sequence below which its first and last rotation count as one:
/// to ignore it moves the orientation by no more than this, which is the default tolerance of membership.
pub const VOLUME_GIMBAL: f64 = 1e-9;

/// Near-gimbal range, rad: here rounding of 1e-16 moves the outer angles by more than 1e-12 rad, so that a miss
/// of a bound is confirmed by the distance to the nearest member before membership is denied.
pub const VOLUME_NEAR_GIMBAL: f64 = 1e-4;

/// Least sine of the angle between consecutive axes of a volume: below it the two rotations are one.
pub const VOLUME_AXES_PARALLEL: f64 = 1e-6;

/// Stationarity of the search for the nearest member of a volume, rad.
pub const VOLUME_NEAREST: f64 = 1e-14;

/// Least magnitude of the scalar part of the twist of a spin margin: below it (a swing by almost half a turn) the
/// twist is undefined and the orientation counts as outside. Its square stays far from overflow.
pub const SPIN_SCALAR: f64 = 1e-9;

/// Largest distance between two unit axes, as vectors, that count as the same axis: a few roundings.
pub const SAME_AXIS: f64 = 1e-14;

/// Step of the one-dimensional closed form, relative to the distance to the ends of its interval, after which it
/// stops. What remains is of the order of its cube, (1e-5)^3, below rounding.
pub const ARC_STEP: f64 = 1e-5;

/// Newton's default estimate of the remaining error, rad. One order above the rounding of the barrier's gradient.
pub const ORIENTATION_STEP: f64 = 1e-13;

/// Share of the largest eigenvalue below which an eigenvalue of the barrier's Hessian is raised: steps along
/// directions in which the barrier is flat or concave stay bounded, those along well-determined ones unchanged.
pub const HESSIAN_FLOOR: f64 = 1e-6;

/// Share of the largest diagonal entry below which a pivot of the barrier's Hessian counts as zero: four digits above
/// rounding. Lens-shaped sets of 1e-9 rad have curvatures in the ratio 1e-9 and are still factored.
pub const HESSIAN_PIVOT: f64 = 1e-12;

/// Squared Newton decrement, per unit of the least weight, below which full steps are taken without measuring the
/// decrease: a self-concordant function decreases by them for decrements up to 0.68, here 0.5.
pub const NEWTON_DECREMENT: f64 = 0.25;

/// Squared Newton decrement, per unit of the least weight, from which a full step is tried at twice its length. Next
/// to the boundary of one set it is 1 or more and the step ends half-way to where it should.
pub const STEP_DOUBLING: f64 = 0.7;

/// Margin on a cone's axis (0.1 degrees of half-angle), and share of a perpendicular part, above which differences of
/// numbers near 1 keep ten digits and are taken as they are.
pub const PLAIN_MARGIN: f64 = 1e-6;

/// Armijo's constant: the share of the predicted decrease that a step must realise.
pub const SUFFICIENT_DECREASE: f64 = 1e-4;

/// Gradient norm, relative to that of a constraint at half its margin, at which the gradient methods stop. Linear
/// convergence: the remaining angle is of the same relative size.
pub const GRADIENT_STATIONARY: f64 = 1e-10;

/// Normalised margin (1 at a cone's axis) at which the search for a feasible start is content.
pub const START_MARGIN: f64 = 0.2;

/// Share of an interval that a start keeps from its ends: next to a rim the barrier's steps only double the distance.
pub const START_RIM: f64 = 0.02;

/// Last smoothing of the search for a feasible start; twice it bounds, in rad, what smoothing adds to a miss angle.
pub const START_SMOOTHING: f64 = 1e-9;

/// Difference, rad, within which a measured miss angle is replaced by the exact one of the worst pair of cones.
pub const MISS_AGREES: f64 = 1e-6;

/// Width, rad, of a volume's middle range below which its angle is drawn uniformly: the weight sin or cos changes by
/// less than this across it, and the inverse of its integral would lose more than that.
pub const VOLUME_NARROW: f64 = 1e-6;

/// Relative difference below which two local minima of the barrier count as equally good: rounding of the sums of
/// logarithms. The first one found is kept, so that the choice does not depend on noise.
pub const SAME_VALUE: f64 = 1e-12;

/// Rounding of a sum of weighted logarithms, relative to the larger of the sum and its weights: a few additions.
pub const VALUE_ROUNDING: f64 = 4e-16;

/// Square of a step's length below which `1 / sqrt(1 + s)` is its series up to the third power: the fourth is 3e-17.
pub const ROOT_SERIES: f64 = 1e-4;
