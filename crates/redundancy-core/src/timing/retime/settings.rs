//! Settings of `retime`.

use nalgebra::Vector3;

use crate::chain::Chain;
use crate::error::{Error, Result, check_length};

/// Settings of [`retime`](super::retime).
#[derive(Debug, Clone, PartialEq)]
pub struct RetimeSettings {
    /// Largest joint speeds, rad/s or m/s, one per joint; `inf` for none.
    pub velocity_limits: Vec<f64>,
    /// Largest joint accelerations, rad/s^2 or m/s^2, one per joint; `inf` for none.
    pub acceleration_limits: Vec<f64>,
    /// Largest joint jerks, rad/s^3 or m/s^3, one per joint; `None` lets accelerations jump.
    pub jerk_limits: Option<Vec<f64>>,
    /// Largest joint torques, N m or N, one per joint; `None` is off.
    pub torque_limits: Option<Vec<f64>>,
    /// Largest speed of the tip, m/s; it is held wherever the joints allow it. `None` is off.
    pub tool_speed: Option<f64>,
    /// Whether the motion starts and ends at rest; otherwise it enters and leaves as fast as the limits allow.
    pub at_rest: bool,
    /// Changes of direction in joint space above this angle are corners, rad.
    pub corner_angle: f64,
    /// How far (m) the tool may pass from a corner, in place of a stop there; a turn of the tool counts
    /// [`TURN_LENGTH`](crate::tolerance::TURN_LENGTH) per radian. 0 stops at every corner.
    pub blend: f64,
    /// Rows at these intervals in place of the rows of the path, s.
    pub dt: Option<f64>,
    /// Whether rows may appear between those of the path: where straight lines change their phase, and where rows are
    /// sparse. Without them the motion has one row per row of the path, and may be slower.
    pub rows_between: bool,
    /// m/s^2, world axes.
    pub gravity: Vector3<f64>,
}

impl RetimeSettings {
    /// Velocity and acceleration limits of the chain, at rest at both ends, a stop at each corner.
    pub fn of(chain: &Chain) -> Self {
        let of = |pick: fn(&crate::chain::Limits) -> f64| {
            chain.joints().iter().map(|joint| pick(&joint.limits)).collect()
        };
        Self {
            velocity_limits: of(|limits| limits.velocity),
            acceleration_limits: of(|limits| limits.acceleration),
            jerk_limits: None,
            torque_limits: None,
            tool_speed: None,
            at_rest: true,
            corner_angle: 0.02,
            blend: 0.0,
            dt: None,
            rows_between: true,
            gravity: Vector3::new(0.0, 0.0, -9.81),
        }
    }

    /// Checks the settings against a chain.
    ///
    /// # Errors
    /// A number out of its range; a joint with neither an acceleration nor a torque limit: its speed could jump.
    pub fn validate(&self, chain: &Chain) -> Result<()> {
        let n = chain.dof();
        let mut limits = vec![("velocity_limits", &self.velocity_limits)];
        limits.push(("acceleration_limits", &self.acceleration_limits));
        limits.extend(self.jerk_limits.as_ref().map(|l| ("jerk_limits", l)));
        limits.extend(self.torque_limits.as_ref().map(|l| ("torque_limits", l)));
        for (what, values) in limits {
            check_length(what, values, n)?;
            if let Some(j) = values.iter().position(|v| v.is_nan() || *v <= 0.0) {
                let what = format!("{what} of joint '{}'", chain.joints()[j].name);
                return Err(Error::OutOfRange { what, value: values[j], bound: "> 0 (inf for none)".into() });
            }
        }
        let torque = |j: usize| self.torque_limits.as_ref().is_some_and(|l| l[j].is_finite());
        if let Some(j) = (0..n).find(|j| !self.acceleration_limits[*j].is_finite() && !torque(*j)) {
            return Err(Error::Invalid(format!(
                "joint '{}' has no acceleration limit: give acceleration_limits, or torque_limits",
                chain.joints()[j].name
            )));
        }
        let positive = [("tool_speed", self.tool_speed), ("dt", self.dt)];
        for (what, value) in positive.into_iter().filter_map(|(what, value)| Some((what, value?))) {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange { what: what.into(), value, bound: "finite and > 0".into() });
            }
        }
        if !(0.0..=std::f64::consts::PI).contains(&self.corner_angle) {
            let (what, value) = ("corner_angle".into(), self.corner_angle);
            return Err(Error::OutOfRange { what, value, bound: ">= 0 and <= pi".into() });
        }
        if !(self.blend >= 0.0 && self.blend.is_finite()) {
            let (what, value) = ("blend".into(), self.blend);
            return Err(Error::OutOfRange { what, value, bound: "finite and >= 0 (m)".into() });
        }
        Ok(())
    }
}
