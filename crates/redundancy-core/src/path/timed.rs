//! A path as a motion: where the tool should be at a time, and how fast it should move.
//!
//! Arc length over time goes through the samples with a continuous rate. Its rates at the samples are those of a
//! cubic spline, limited so that the tool neither overshoots a sample nor turns back [FritschCarlson1980]: a stop stays a stop.

use nalgebra::{SVector, Vector6};

use super::Path;
use super::spline::CubicSpline;
use crate::error::{Error, Result};
use crate::pose::Pose;

/// A path with times, ready to be asked for any time.
#[derive(Debug, Clone)]
pub struct TimedPath {
    path: Path,
    t: Vec<f64>,
    rates: Vec<f64>,
}

/// What the tool should do at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Where it should be.
    pub pose: Pose,
    /// Linear and angular velocity, base axes.
    pub twist: Vector6<f64>,
    /// Arc length, m.
    pub s: f64,
}

impl TimedPath {
    /// From a path with times.
    ///
    /// # Errors
    /// A path without times.
    pub fn new(path: &Path) -> Result<Self> {
        let Some(t) = path.t() else {
            return Err(Error::Invalid("the path has no times".into()));
        };
        Ok(Self { t: t.to_vec(), rates: monotone_rates(t, path.s()), path: path.clone() })
    }

    /// First and last time, s.
    pub fn span(&self) -> (f64, f64) {
        (self.t[0], self.t[self.t.len() - 1])
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the tool should do at time `t`; before the first and after the last sample it stands.
    ///
    /// # Errors
    /// A time that is not finite.
    pub fn at(&self, t: f64) -> Result<Reference> {
        crate::error::check_finite("t", &[t])?;
        let (first, last) = self.span();
        let s = self.path.s();
        let (s, rate) = if t < first {
            (s[0], 0.0)
        } else if t > last {
            (s[s.len() - 1], 0.0)
        } else {
            let i = self.t.partition_point(|x| *x <= t).clamp(1, self.t.len() - 1) - 1;
            let h = self.t[i + 1] - self.t[i];
            let u = ((t - self.t[i]) / h).clamp(0.0, 1.0);
            let (rise, a, b) = (s[i + 1] - s[i], self.rates[i] * h, self.rates[i + 1] * h);
            let (c, d) = (3.0 * rise - 2.0 * a - b, a + b - 2.0 * rise);
            let along = (s[i] + (a + (c + d * u) * u) * u).clamp(s[i], s[i + 1]);
            (if u == 1.0 { s[i + 1] } else { along }, (a + (2.0 * c + 3.0 * d * u) * u) / h)
        };
        let point = self.path.at(s)?;
        Ok(Reference { pose: point.pose, twist: point.derivative * rate.max(0.0), s })
    }
}

/// Rates at the samples for which the piecewise cubic is monotone: at most three times the lesser neighbouring secant.
fn monotone_rates(t: &[f64], s: &[f64]) -> Vec<f64> {
    let values = s.iter().map(|s| SVector::from([*s])).collect();
    let spline = CubicSpline::<1>::new(t.to_vec(), values);
    let n = t.len();
    let secant = |i: usize| (s[i + 1] - s[i]) / (t[i + 1] - t[i]);
    (0..n)
        .map(|i| {
            let before = if i > 0 { secant(i - 1) } else { f64::INFINITY };
            let after = if i + 1 < n { secant(i) } else { f64::INFINITY };
            spline.at(t[i])[1][0].clamp(0.0, 3.0 * before.min(after))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_stop_stays_a_stop_and_smooth_motion_keeps_its_speed() {
        let n = 201;
        let t: Vec<f64> = (0..2 * n).map(|i| 0.025 * f64::from(i)).collect();
        // A quintic of 5 s, then 5 s at rest.
        let s = |t: f64| {
            let u = (t / 5.0).min(1.0);
            0.3 * u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
        };
        let positions: Vec<Vector3<f64>> = t.iter().map(|t| Vector3::new(s(*t), 0.0, 0.5)).collect();
        let path = Path::from_positions(&positions, None, Some(&t)).expect("a path");
        let timed = TimedPath::new(&path).expect("times");
        for i in 0..1000 {
            let t = 0.01003 * f64::from(i);
            let at = timed.at(t).expect("a time");
            let u = (t / 5.0).min(1.0);
            let rate = 0.3 * 30.0 * u * u * (1.0 - u) * (1.0 - u) / 5.0;
            assert!((at.pose.translation.x - s(t)).abs() < 1e-7, "{t}");
            assert!((at.twist[0] - rate).abs() < 2e-5, "{t} {} {rate}", at.twist[0]);
            assert!(t < 5.0 || at.twist[0] == 0.0);
        }
        assert!(TimedPath::new(&path.with_times(None).expect("valid")).is_err());
    }
}
