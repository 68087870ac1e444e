//! The limits that bound the speed of a tool.

use nalgebra::Vector3;

use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};

/// What bounds the speed.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedSettings {
    /// Largest torques, N m, one per joint; `None` is off, infinite entries are none.
    pub torque_limits: Option<Vec<f64>>,
    /// Largest joint speeds, rad/s, one per joint; `None` is off.
    pub velocity_limits: Option<Vec<f64>>,
    /// m/s^2, world axes.
    pub gravity: Vector3<f64>,
    /// Whether the arm must keep its position limits where [`max_speed_of_poses`](super::max_speed_of_poses) chooses the branch.
    pub joint_limits: bool,
}

impl SpeedSettings {
    /// The torque limits of the chain, no velocity limits, gravity of 9.81 m/s^2 along -z.
    pub fn of(chain: &Chain) -> Self {
        Self {
            torque_limits: Some(chain.joints().iter().map(|j| j.limits.effort).collect()),
            velocity_limits: None,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            joint_limits: true,
        }
    }

    /// Checks the settings against a chain of `n` joints.
    ///
    /// # Errors
    /// Wrong lengths, limits that are not positive, no limit at all.
    pub fn validate(&self, n: usize) -> Result<()> {
        check_finite("gravity", self.gravity.as_slice())?;
        let mut any = false;
        for (what, limits) in
            [("torque limit", &self.torque_limits), ("velocity limit", &self.velocity_limits)]
        {
            let Some(limits) = limits else { continue };
            check_length(&format!("{what}s"), limits, n)?;
            if let Some(j) = limits.iter().position(|v| v.is_nan() || *v <= 0.0) {
                let what = format!("{what} of joint {j}");
                return Err(Error::OutOfRange { what, value: limits[j], bound: "> 0 (inf for none)".into() });
            }
            any |= limits.iter().any(|v| v.is_finite());
        }
        if any {
            return Ok(());
        }
        Err(Error::Invalid("no torque or velocity limit is given: nothing bounds the speed".into()))
    }

    /// Torque limits need inertias.
    pub(crate) fn check_masses(&self, chain: &Chain) -> Result<()> {
        match &self.torque_limits {
            Some(limits) if limits.iter().any(|l| l.is_finite()) => chain.masses().map(|_| ()),
            _ => Ok(()),
        }
    }
}

/// What stops a faster motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SpeedLimit {
    /// The torque of a joint.
    Torque,
    /// The speed of a joint.
    Velocity,
}

impl SpeedLimit {
    /// The limit as a word in lower case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Velocity => "velocity",
        }
    }
}
