//! A plan of tilt and spin, and what limits its speed.

use crate::path::Plan;

/// What allows no higher speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeedBound {
    /// The torque limit of a joint.
    Torque(usize),
    /// The speed limit of a joint.
    Velocity(usize),
    /// The largest rate of the tool's orientation.
    Rate,
}

impl SpeedBound {
    /// The joint whose limit it is.
    pub fn joint(self) -> Option<usize> {
        match self {
            Self::Torque(joint) | Self::Velocity(joint) => Some(joint),
            Self::Rate => None,
        }
    }
}

/// Where the speed is bounded, and by what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bottleneck {
    /// The row.
    pub row: usize,
    /// What allows no more there.
    pub bound: SpeedBound,
}

/// Tilt and spin along a path with the constant speed that they allow.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationPlan {
    /// Rows at most 0.4 mm apart, at constant speed, with tilt, a rotation vector in the path's frame, and spin.
    /// `Converged`: every search came to its end. `TimeLimit`, `Cancelled`: the best so far. `Unreachable`, `Infeasible`:
    /// no rows.
    pub plan: Plan,
    /// Constant tool speed, m/s, verified at the rows; 0 without a plan.
    pub speed: f64,
    /// The same for the path's own orientation on the best branch, where it can be followed.
    pub constant_speed: Option<f64>,
    /// Joint torques at that speed, row by row, N m.
    pub torques: Vec<f64>,
    /// What allows no more; `None` without a plan.
    pub bottleneck: Option<Bottleneck>,
    /// Starts that could be followed.
    pub starts: usize,
    /// Convex programs solved.
    pub steps: usize,
}

impl From<OrientationPlan> for Plan {
    fn from(plan: OrientationPlan) -> Self {
        plan.plan
    }
}
