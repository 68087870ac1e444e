//! Settings of a plan of tilt and spin.

use std::f64::consts::FRAC_PI_2;

use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::timing::SpeedSettings;

/// How far the tool may turn about its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpinRange {
    /// As far as it likes.
    Free,
    /// Up to this angle (rad) from the path's orientation; 0 is not at all.
    Within(f64),
}

/// Settings of [`plan_orientation`](super::plan_orientation).
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationPlanSettings {
    /// Largest tilt, rad.
    pub half_angle: f64,
    /// Range of the spin.
    pub spin: SpinRange,
    /// Torque and velocity limits, gravity, and whether joint position limits hold.
    pub speed: SpeedSettings,
    /// Share of the torque limits that is kept free.
    pub torque_margin: f64,
    /// Largest rate of the tool's orientation at the plan's speed, rad/s; `None` is off.
    pub max_rate: Option<f64>,
    /// Seconds after which the best plan so far is returned.
    pub time_limit: f64,
}

impl OrientationPlanSettings {
    /// A cone of `half_angle` (rad), free spin, the torque and position limits of the chain, a minute.
    pub fn new(chain: &Chain, half_angle: f64) -> Self {
        Self {
            half_angle,
            spin: SpinRange::Free,
            speed: SpeedSettings::of(chain),
            torque_margin: 0.0,
            max_rate: None,
            time_limit: 60.0,
        }
    }

    /// Checks the settings against a chain of `n` joints.
    ///
    /// # Errors
    /// A number out of its range; the message names it and the bound.
    pub fn validate(&self, n: usize) -> Result<()> {
        let out = |what: &str, value: f64, bound: &str| {
            Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() })
        };
        self.speed.validate(n)?;
        if !(0.0..FRAC_PI_2).contains(&self.half_angle) {
            return out("half_angle", self.half_angle, "in [0, pi/2) rad");
        }
        if let SpinRange::Within(angle) = self.spin
            && !(angle >= 0.0 && angle.is_finite())
        {
            return out("spin", angle, "free, or a finite angle >= 0 rad");
        }
        if !(0.0..1.0).contains(&self.torque_margin) {
            return out("torque_margin", self.torque_margin, "in [0, 1)");
        }
        if let Some(rate) = self.max_rate
            && !(rate > 0.0 && rate.is_finite())
        {
            return out("max_rate", rate, "positive and finite, rad/s");
        }
        if !(self.time_limit > 0.0 && self.time_limit <= LONGEST) {
            return out("time_limit", self.time_limit, "in (0, 1e6] s");
        }
        Ok(())
    }
}

/// Longest time limit, s.
const LONGEST: f64 = 1e6;
