//! Settings of a swivel plan.

use crate::error::{Error, Result, check_finite, check_length};
use crate::scene::{LinkGeometry, Scene};

/// Largest weight: what a path costs stays well above the rounding of what its reconfigurations cost.
const MAX_WEIGHT: f64 = 1e6;

/// Which swivel is wanted.
#[derive(Debug, Clone, PartialEq)]
pub enum SwivelChoice {
    /// The planner chooses.
    Free,
    /// The planner chooses, near to one angle for all points or one for each, rad.
    Near(Vec<f64>),
    /// Exactly one angle for all points or one for each, rad; only branch and windings are chosen.
    Fixed(Vec<f64>),
}

/// Settings of [`plan_swivel`](crate::planning::plan_swivel).
#[derive(Debug, Clone, PartialEq)]
pub struct SwivelPlanSettings {
    /// Grid cells of the circle.
    pub swivels: usize,
    /// Which swivel is wanted.
    pub choice: SwivelChoice,
    /// Only this branch, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub branch: Option<usize>,
    /// Distance that is kept from every joint limit, rad.
    pub margin: f64,
    /// Weight of the distance from the limits.
    pub limit_weight: f64,
    /// Weight of the joint motion.
    pub motion_weight: f64,
    /// Weight of the distance from the desired swivel.
    pub swivel_weight: f64,
    /// Largest joint speeds, rad/s; used when the path has times. `None` is off.
    pub velocity_limits: Option<Vec<f64>>,
    /// What is in the way. Obstacles that move are where the times of the path have them, at 0 without times.
    pub scene: Option<Scene>,
    /// Radius of the links, m, where no shapes are given.
    pub link_radius: f64,
    /// Shapes of the links; `None`: capsules from joint to joint.
    pub links: Option<LinkGeometry>,
    /// Links must not touch each other: the pairs of `links`, of capsules those that are found.
    pub self_collision: bool,
    /// Distance from obstacles that is wanted, m; contact is forbidden.
    pub wanted_clearance: f64,
    /// Weight of what is missing from the wanted distance.
    pub clearance_weight: f64,
    /// Weight of the distance from singularities.
    pub manipulability_weight: f64,
    /// Weight of the joint acceleration, in the refinement.
    pub acceleration_weight: f64,
    /// The arm ends as it began; the path must be closed.
    pub cyclic: bool,
}

impl Default for SwivelPlanSettings {
    fn default() -> Self {
        Self {
            swivels: 180,
            choice: SwivelChoice::Free,
            branch: None,
            margin: 0.0,
            limit_weight: 1.0,
            motion_weight: 0.5,
            swivel_weight: 1e4,
            velocity_limits: None,
            scene: None,
            link_radius: 0.05,
            links: None,
            self_collision: false,
            wanted_clearance: 0.03,
            clearance_weight: 1e4,
            manipulability_weight: 0.0,
            acceleration_weight: 0.0,
            cyclic: false,
        }
    }
}

impl SwivelPlanSettings {
    /// Checks the settings against a path of `points` points.
    ///
    /// # Errors
    /// A number out of its range; the message names it and the bound.
    pub fn validate(&self, points: usize) -> Result<()> {
        let out = |what: &str, value: f64, bound: &str| {
            Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() })
        };
        if !(8..=7_200).contains(&self.swivels) {
            return out("swivels", self.swivels as f64, "between 8 and 7200");
        }
        if let Some(branch) = self.branch
            && branch > 7
        {
            return out("branch index", branch as f64, "<= 7");
        }
        for (what, value, most) in [
            ("margin", self.margin, f64::MAX),
            ("limit_weight", self.limit_weight, MAX_WEIGHT),
            ("motion_weight", self.motion_weight, MAX_WEIGHT),
            ("swivel_weight", self.swivel_weight, MAX_WEIGHT),
            ("clearance_weight", self.clearance_weight, MAX_WEIGHT),
            ("manipulability_weight", self.manipulability_weight, MAX_WEIGHT),
            ("acceleration_weight", self.acceleration_weight, MAX_WEIGHT),
            ("wanted_clearance", self.wanted_clearance, f64::MAX),
            ("link_radius", self.link_radius, f64::MAX),
        ] {
            if !(0.0..=most).contains(&value) {
                let bound = if most == MAX_WEIGHT { "between 0 and 1e6" } else { "finite and >= 0" };
                return out(what, value, bound);
            }
        }
        if let SwivelChoice::Near(s) | SwivelChoice::Fixed(s) = &self.choice {
            check_finite("swivel", s)?;
            if s.len() != 1 && s.len() != points {
                return Err(Error::Length { what: "swivel".into(), expected: points, actual: s.len() });
            }
        }
        if let Some(limits) = &self.velocity_limits {
            check_length("velocity_limits", limits, 7)?;
            if let Some(i) = limits.iter().position(|v| v.is_nan() || *v <= 0.0) {
                return out(&format!("velocity limit {i}"), limits[i], "> 0");
            }
        }
        Ok(())
    }
}
