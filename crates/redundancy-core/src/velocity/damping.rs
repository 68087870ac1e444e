//! Damped least squares with a separate factor for each singular value [Bettini2000, section 4.3].
//!
//! ```text
//! 1/sigma -> sigma / (sigma^2 + lambda(sigma)^2)
//! lambda^2 = maximum^2                                     for sigma <= rho threshold
//!          = maximum^2 (1 - (x - sin x) / (2 pi))          between, x = 2 pi (sigma - rho threshold) / ((1 - rho) threshold)
//!          = 0                                             for sigma >= threshold
//! ```
//!
//! The formula is right as printed and twice continuously differentiable at both ends. It depends on units: metres.

use std::f64::consts::TAU;

use crate::error::{Error, Result};

/// When and how strongly small singular values are damped.
///
/// ```
/// use redundancy_core::velocity::Damping;
/// let paper = Damping { maximum: 0.1, threshold: 0.2, rho: 0.25 };
/// assert_eq!(paper.square(0.05), 0.1 * 0.1);
/// assert!((paper.square(0.1) - 0.008044988905).abs() < 1e-12);
/// assert_eq!(paper.square(0.2), 0.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// Largest damping factor lambda, units of a singular value.
    pub maximum: f64,
    /// Singular values from here on are not damped.
    pub threshold: f64,
    /// Share of the threshold below which the damping is full, in [0, 1).
    pub rho: f64,
}

impl Default for Damping {
    /// For arms measured in metres: exact wherever the least singular value is 0.04 or more; below, no singular value
    /// is inverted to more than about 30.
    fn default() -> Self {
        Self { maximum: 0.02, threshold: 0.04, rho: 0.25 }
    }
}

impl Damping {
    /// Checks the constants.
    ///
    /// # Errors
    /// A maximum or threshold that is not positive and finite, rho outside [0, 1).
    pub fn validate(&self) -> Result<()> {
        for (what, value) in [("damping maximum", self.maximum), ("damping threshold", self.threshold)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::OutOfRange { what: what.into(), value, bound: "finite and > 0".into() });
            }
        }
        if !(0.0..1.0).contains(&self.rho) {
            let bound = "in [0, 1)".into();
            return Err(Error::OutOfRange { what: "damping rho".into(), value: self.rho, bound });
        }
        Ok(())
    }

    /// The squared damping factor of a singular value.
    pub fn square(&self, sigma: f64) -> f64 {
        let full = self.maximum * self.maximum;
        if sigma >= self.threshold {
            return 0.0;
        }
        let x = TAU * (sigma - self.rho * self.threshold) / ((1.0 - self.rho) * self.threshold);
        if x <= 0.0 { full } else { full * (1.0 - (x - x.sin()) / TAU) }
    }

    /// What replaces `1 / sigma`.
    pub fn inverse(&self, sigma: f64) -> f64 {
        sigma / (sigma * sigma + self.square(sigma))
    }
}
