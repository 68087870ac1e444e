//! The fastest motion over given joint positions when the speed may change: two passes [PhamPham2018].

use super::settings::SpeedSettings;
use super::terms::SpeedTerms;
use crate::chain::Chain;
use crate::error::{Error, Result};

/// A motion over a path whose speed may change.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedProfile {
    /// Arc length of each point, m.
    pub s: Vec<f64>,
    /// Tool speed at each point, m/s.
    pub speed: Vec<f64>,
    /// Acceleration along the path from each point to the next, m/s^2 (the last one repeated).
    pub acceleration: Vec<f64>,
    /// Time at each point, s.
    pub t: Vec<f64>,
}

/// The fastest motion over given joint positions when the tool speed may change, from `start_speed` to `end_speed` (m/s).
///
/// # Errors
/// As [`max_speed`](super::max_speed); speeds that are negative or cannot be held: the message names the point.
pub fn fastest_profile(
    chain: &Chain,
    s: &[f64],
    q: &[f64],
    settings: &SpeedSettings,
    start_speed: f64,
    end_speed: f64,
) -> Result<SpeedProfile> {
    settings.validate(chain.dof())?;
    for (what, value) in [("start_speed", start_speed), ("end_speed", end_speed)] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Error::OutOfRange { what: what.into(), value, bound: "finite and >= 0".into() });
        }
    }
    if let Some(k) = (1..s.len()).find(|k| s[*k] <= s[k - 1]) {
        return Err(Error::Invalid(format!("the path stops at point {k}: a profile needs s that increases")));
    }
    let terms = SpeedTerms::new(chain, s, q, settings, true)?;
    terms.check_gravity(chain, settings)?;
    terms.profile(settings, start_speed, end_speed)
}

impl SpeedTerms {
    /// Rows `a u + b x <= c` of point `k`, with u the acceleration and x the squared speed.
    fn rows(&self, k: usize, settings: &SpeedSettings, rows: &mut Vec<[f64; 3]>) {
        rows.clear();
        for j in 0..self.n {
            let i = k * self.n + j;
            if let Some(limits) = &settings.torque_limits
                && limits[j].is_finite()
            {
                let (m, d, g) = (self.inertial[i], self.dynamic[i], self.weights[i]);
                rows.push([m, d, limits[j] - g]);
                rows.push([-m, -d, limits[j] + g]);
            }
            if let Some(limits) = &settings.velocity_limits
                && limits[j].is_finite()
            {
                rows.push([0.0, self.d[i] * self.d[i], limits[j] * limits[j]]);
            }
        }
    }

    fn profile(&self, settings: &SpeedSettings, start_speed: f64, end_speed: f64) -> Result<SpeedProfile> {
        let last = self.s.len() - 1;
        let (start, end) = (start_speed * start_speed, end_speed * end_speed);
        let mut rows = Vec::new();
        // [low, high] of the squared speed at each point from which the end can be reached.
        let mut reach = vec![[0.0, 0.0]; last + 1];
        reach[last] = [end, end];
        let held = |k: usize, what: &str| {
            Error::Invalid(format!("{what} at point {k}: no speed there is within the limits"))
        };
        for k in (0..last).rev() {
            let gap = 2.0 * (self.s[k + 1] - self.s[k]);
            self.rows(k, settings, &mut rows);
            let [low, high] = reach[k + 1];
            rows.push([gap, 1.0, high]);
            rows.push([-gap, -1.0, -low]);
            let most = extreme_speed(&rows, true).ok_or_else(|| held(k, "the path cannot be followed"))?;
            let least = extreme_speed(&rows, false).ok_or_else(|| held(k, "the path cannot be followed"))?;
            reach[k] = [least, most];
        }
        // The end's own rows, at rest or at its speed.
        let [low, high] = reach[0];
        if start < low - PROFILE_SLACK * (1.0 + low) || start > high + PROFILE_SLACK * (1.0 + high) {
            return Err(Error::OutOfRange {
                what: "start_speed".into(),
                value: start_speed,
                bound: format!(
                    "between {} and {} m/s on this path",
                    low.max(0.0).sqrt(),
                    high.max(0.0).sqrt()
                ),
            });
        }
        let mut x = vec![start.clamp(low, high); last + 1];
        let mut acceleration = vec![0.0; last + 1];
        for k in 0..last {
            let gap = 2.0 * (self.s[k + 1] - self.s[k]);
            self.rows(k, settings, &mut rows);
            let [low, high] = reach[k + 1];
            rows.push([gap, 1.0, high]);
            rows.push([-gap, -1.0, -low]);
            let u = rows
                .iter()
                .filter(|r| r[0] > 0.0)
                .map(|[a, b, c]| (c - b * x[k]) / a)
                .fold(f64::INFINITY, f64::min);
            acceleration[k] = u;
            x[k + 1] = (x[k] + gap * u).clamp(low.max(0.0), high.max(0.0));
        }
        acceleration[last] = acceleration[last - 1];
        let speed: Vec<f64> = x.iter().map(|x| x.max(0.0).sqrt()).collect();
        let mut t = vec![0.0; last + 1];
        for k in 0..last {
            let mean = 0.5 * (speed[k] + speed[k + 1]);
            if mean <= 0.0 {
                return Err(held(k, "the arm would stand still"));
            }
            t[k + 1] = t[k] + (self.s[k + 1] - self.s[k]) / mean;
        }
        Ok(SpeedProfile { s: self.s.clone(), speed, acceleration, t })
    }
}

/// Relative excess of a squared speed over its bound that rounding explains.
pub(in crate::timing) const PROFILE_SLACK: f64 = 1e-9;
/// Halvings of the search for the largest squared speed; each bound is linear, so the gap of the accelerations is concave
/// and the steps of the search below end exactly on a vertex.
pub(in crate::timing) const VERTEX_STEPS: usize = 64;

/// Largest (or least) `x >= 0` for which some `u` holds all rows `a u + b x <= c`.
///
/// For fixed x the rows leave `u` an interval `[lo(x), hi(x)]`; `hi - lo` is concave and piecewise linear. Newton's method
/// on it goes from vertex to vertex: from outside it never steps over the end of the feasible part.
fn extreme_speed(rows: &[[f64; 3]], most: bool) -> Option<f64> {
    // Bounds without u.
    let (mut low, mut high) = (0.0_f64, f64::INFINITY);
    for [a, b, c] in rows {
        if *a == 0.0 {
            if *b > 0.0 {
                high = high.min(c / b);
            } else if *b < 0.0 {
                low = low.max(c / b);
            } else if *c < 0.0 {
                return None;
            }
        }
    }
    // Slope and offset of the tightest upper and lower bound of u at x: gap(x) = offset + slope x.
    let line_at = |x: f64| {
        let (mut hi, mut lo) = ((f64::INFINITY, 0.0, 0.0), (f64::NEG_INFINITY, 0.0, 0.0));
        for [a, b, c] in rows {
            if *a != 0.0 {
                let (offset, slope) = (c / a, -b / a);
                let value = offset + slope * x;
                if *a > 0.0 && value < hi.0 {
                    hi = (value, offset, slope);
                } else if *a < 0.0 && value > lo.0 {
                    lo = (value, offset, slope);
                }
            }
        }
        (hi.0 - lo.0, hi.1 - lo.1, hi.2 - lo.2)
    };
    let cap = if high.is_finite() { high } else { SPEED_CAP };
    if low > cap {
        return None;
    }
    let mut x = if most { cap } else { low };
    for _ in 0..VERTEX_STEPS {
        let (gap, offset, slope) = line_at(x);
        if gap >= -PROFILE_SLACK * (1.0 + offset.abs()) {
            return Some(x);
        }
        // The tangent lies above the concave gap: its zero is on the way to the feasible part.
        let next = -offset / slope;
        let inwards = if most { next < x && next >= low } else { next > x && next <= cap };
        if !(next.is_finite() && inwards) {
            return None;
        }
        x = next;
    }
    None
}

/// Squared speed (m/s)^2 that counts as no limit: no arm comes near 1 km/s.
pub(in crate::timing) const SPEED_CAP: f64 = 1e6;
