//! How far the tool may tilt and spin away from the orientation of a path.

use nalgebra::{Unit, Vector3};

use crate::error::{Error, Result};

/// How far the tool may turn about its own axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpinFreedom {
    /// This much to either side of the path's orientation, rad; 0 keeps it.
    Within(f64),
    /// As far as it likes.
    Free,
}

/// How far the tool may lean and spin away from the path's orientation at each point.
///
/// The tool axis stays within `half_angle` of the path's tool axis. The spin is the twist about the tool axis in the
/// swing-twist split of `R_path^T R`. With both zero the full pose counts.
///
/// ```
/// use redundancy_core::kinematics::{SpinFreedom, ToolFreedom};
/// let gun = ToolFreedom::new(20f64.to_radians(), SpinFreedom::Free, [0.0, 0.0, 1.0])?;
/// assert!(!gun.is_none());
/// assert!(ToolFreedom::new(2.0, SpinFreedom::Free, [0.0, 0.0, 1.0]).is_err());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolFreedom {
    half_angle: f64,
    spin: SpinFreedom,
    axis: Unit<Vector3<f64>>,
}

impl ToolFreedom {
    /// No freedom: the full pose.
    pub const NONE: Self = Self {
        half_angle: 0.0,
        spin: SpinFreedom::Within(0.0),
        axis: Unit::new_unchecked(Vector3::new(0.0, 0.0, 1.0)),
    };

    /// A cone of `half_angle` (rad) about the path's tool axis, and a spin about `axis`, a direction in the tool frame.
    ///
    /// # Errors
    /// A half-angle outside `[0, pi/2)`, a negative spin, numbers that are not finite, an axis without length.
    pub fn new(half_angle: f64, spin: SpinFreedom, axis: [f64; 3]) -> Result<Self> {
        if !(0.0..std::f64::consts::FRAC_PI_2).contains(&half_angle) {
            let bound = "at least 0 and below pi/2 (radians)".into();
            return Err(Error::OutOfRange { what: "half_angle".into(), value: half_angle, bound });
        }
        if let SpinFreedom::Within(angle) = spin
            && !(angle.is_finite() && angle >= 0.0)
        {
            let bound = "finite and at least 0 (radians), or \"free\"".into();
            return Err(Error::OutOfRange { what: "spin".into(), value: angle, bound });
        }
        Ok(Self { half_angle, spin, axis: crate::rotation::unit_direction("tool axis", axis)? })
    }

    /// Largest angle between the tool axis and the path's, rad.
    pub fn half_angle(&self) -> f64 {
        self.half_angle
    }

    /// How far the tool may spin.
    pub fn spin(&self) -> SpinFreedom {
        self.spin
    }

    /// The tool axis, in the tool frame.
    pub fn axis(&self) -> Unit<Vector3<f64>> {
        self.axis
    }

    /// True when the full pose counts.
    pub fn is_none(&self) -> bool {
        self.half_angle == 0.0 && self.spin == SpinFreedom::Within(0.0)
    }
}

impl Default for ToolFreedom {
    fn default() -> Self {
        Self::NONE
    }
}
