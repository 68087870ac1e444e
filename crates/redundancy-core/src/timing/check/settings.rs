//! Settings of a check.

use nalgebra::Vector3;

use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};
use crate::path::Path;
use crate::scene::{LinkGeometry, Scene};
use crate::tolerance::{
    CHECK_ORIENTATION, CHECK_POSITION, CHECK_RELATIVE, CHECK_SINGULARITY, CHECK_TIME_ROUNDING, JOINT_JUMP,
};

/// Settings of [`check`](super::check).
#[derive(Debug, Clone, PartialEq)]
pub struct CheckSettings {
    /// Largest joint speeds, rad/s or m/s, `inf` for none; `None` is off.
    pub velocity_limits: Option<Vec<f64>>,
    /// Largest joint accelerations, rad/s^2 or m/s^2; `None` is off.
    pub acceleration_limits: Option<Vec<f64>>,
    /// Largest joint jerks, rad/s^3 or m/s^3; `None` is off.
    pub jerk_limits: Option<Vec<f64>>,
    /// Largest joint torques, N m or N; `None` is off.
    pub torque_limits: Option<Vec<f64>>,
    /// Whether the first and the last row must be at rest.
    pub at_rest: bool,
    /// Share of a limit by which it may be exceeded: files carry rounded numbers.
    pub tolerance: f64,
    /// Times are rounded to this, s; what that adds to velocities, accelerations and jerks is no fault.
    pub time_rounding: f64,
    /// Largest distance of the tool from the path, m.
    pub position_tolerance: f64,
    /// Largest angle of the tool from the path's orientation, rad; `None` is off.
    pub orientation_tolerance: Option<f64>,
    /// Ratio of the least to the largest singular value of the Jacobian below which a row is near a singularity; 0 is off.
    pub singularity: f64,
    /// Largest step of a turning joint from row to row where a path is given, rad.
    pub max_step: f64,
    /// Least distance from obstacles, m.
    pub clearance: f64,
    /// m/s^2, world axes.
    pub gravity: Vector3<f64>,
}

/// What the motion is compared with beside the limits of the arm.
#[derive(Debug, Clone, Copy, Default)]
pub struct CheckAgainst<'a> {
    /// The path that the tool should follow.
    pub path: Option<&'a Path>,
    /// What is in the way.
    pub scene: Option<&'a Scene>,
    /// The shapes of the links; capsules from joint to joint without.
    pub links: Option<&'a LinkGeometry>,
}

impl CheckSettings {
    /// Velocity and acceleration limits of the chain, at rest at both ends; jerk and torque are not checked.
    pub fn of(chain: &Chain) -> Self {
        let of = |pick: fn(&crate::chain::Limits) -> f64| {
            Some(chain.joints().iter().map(|joint| pick(&joint.limits)).collect())
        };
        Self {
            velocity_limits: of(|limits| limits.velocity),
            acceleration_limits: of(|limits| limits.acceleration),
            jerk_limits: None,
            torque_limits: None,
            at_rest: true,
            tolerance: CHECK_RELATIVE,
            time_rounding: CHECK_TIME_ROUNDING,
            position_tolerance: CHECK_POSITION,
            orientation_tolerance: Some(CHECK_ORIENTATION),
            singularity: CHECK_SINGULARITY,
            max_step: JOINT_JUMP,
            clearance: 0.0,
            gravity: Vector3::new(0.0, 0.0, -9.81),
        }
    }

    /// Checks the settings against a chain.
    ///
    /// # Errors
    /// A number out of its range, torque limits for a chain without inertias.
    pub fn validate(&self, chain: &Chain) -> Result<()> {
        let limits = [
            ("velocity_limits", &self.velocity_limits),
            ("acceleration_limits", &self.acceleration_limits),
            ("jerk_limits", &self.jerk_limits),
            ("torque_limits", &self.torque_limits),
        ];
        for (what, values) in limits.into_iter().filter_map(|(what, values)| Some((what, values.as_ref()?))) {
            check_length(what, values, chain.dof())?;
            if let Some(j) = values.iter().position(|v| v.is_nan() || *v <= 0.0) {
                let what = format!("{what} of joint '{}'", chain.joints()[j].name);
                return Err(Error::OutOfRange { what, value: values[j], bound: "> 0 (inf for none)".into() });
            }
        }
        let ranges = [
            ("tolerance", self.tolerance, 1.0),
            ("time_rounding", self.time_rounding, 1.0),
            ("singularity", self.singularity, 1.0),
            ("position_tolerance", self.position_tolerance, f64::MAX),
            ("orientation_tolerance", self.orientation_tolerance.unwrap_or(0.0), f64::MAX),
            ("clearance", self.clearance, f64::MAX),
            ("max_step", self.max_step, f64::INFINITY),
        ];
        for (what, value, most) in ranges {
            if !(0.0..=most).contains(&value) {
                let bound = if most == 1.0 { ">= 0 and <= 1" } else { ">= 0" };
                return Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() });
            }
        }
        check_finite("gravity", self.gravity.as_slice())?;
        if self.torque_limits.is_some() {
            chain.masses()?;
        }
        Ok(())
    }
}
