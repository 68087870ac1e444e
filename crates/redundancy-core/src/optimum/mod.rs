//! Critical points of a criterion: their kinds, and how far they can be followed.
//!
//! Over one pose a criterion h has critical points, where its derivative along the self-motion vanishes. Schemes that
//! keep the arm at one, as the extended Jacobian does, follow it along a path until it meets another one and both
//! vanish (an algorithmic singularity), or until the arm itself becomes singular. [`classify`] says what kind of point
//! a configuration is, [`constrained_optima`] finds all of them over a pose, [`algorithmic_singularities`] and
//! [`singularity_curves`] find where they vanish, and [`follow_optimum`] follows one along a path and says where it ends and why.
//!
//! With N an orthonormal basis of the kernel of the Jacobian of the task f, a point is critical where mu vanishes, and the
//! eigenvalues of W decide its kind [Park1996, eq. (8) and (10)]:
//!
//! $$ \mu = N^T \nabla h, \qquad W = N^T \Big( \nabla^2 h - \sum_k \lambda_k \nabla^2 f_k \Big) N, \qquad \lambda = (J J^T)^{-1} J \nabla h $$
//!
//! Source: [Park1996, sections 2 to 4], with corrections: definiteness is sufficient, and only semidefiniteness necessary (their theorem
//! 3.1 says 'if and only if'); a maximum needs leading minors of alternating sign, not negative ones; their null-space
//! basis (eq. 11) vanishes at configurations that are not singular when r > 1, so an orthonormal basis is used here;
//! the four singular configurations of their arm satisfy `mu = A = 0` with a vanishing null vector and are excluded.

mod classify;
mod critical_points;
mod follow;
mod singularity;
mod singularity_curve;

pub use classify::{Classification, Classifier, CofactorCondition, Kind, classify, cofactor_condition};
pub use critical_points::{CriticalPoint, OptimaSettings, constrained_optima};
pub use follow::{
    FollowSettings, FollowedOptimum, RankedStart, Stop, distance_to_nearest, follow_optimum, follow_starts,
    rank_starts, sort_starts,
};
pub use singularity::{SingularPoint, SingularitySearch, SingularitySettings, algorithmic_singularities};
pub use singularity_curve::{SingularityCurve, SingularityTracer, singularity_curves};
