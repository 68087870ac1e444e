//! Times for joint rows that have none, from the joints' velocity limits.
//!
//! Row `i + 1` may follow row `i` no sooner than `dt_i = max_j |q_{i+1,j} - q_{i,j}| / (f v_j)`. Taking just that
//! keeps one joint at its limit all the time, but which joint it is changes from row to row and the rate of rows
//! `r_i = 1 / dt_i` jumps with it. So the rate is smoothed from below: first the least rate within `w` rows on both
//! sides, then the mean of those over the same window. Every number that is averaged at `i` is a minimum over rows
//! that include `i`, so the result never exceeds `r_i`: smoothing keeps every limit.

use crate::error::{Error, Result, check_finite, check_length};
use crate::tolerance::SHORTEST_STEP;

/// How rows are timed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimingSettings {
    /// Share of each velocity limit that may be used, in (0, 1]. Some room is left for what a controller's
    /// interpolation adds between the rows. Default 0.9.
    pub velocity_fraction: f64,
    /// Half-width `w` of the smoothing window in rows; 0 is off. Default 10.
    pub smoothing: usize,
}

impl Default for TimingSettings {
    fn default() -> Self {
        Self { velocity_fraction: 0.9, smoothing: 10 }
    }
}

impl TimingSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// A fraction outside (0, 1].
    pub fn validate(&self) -> Result<()> {
        if self.velocity_fraction > 0.0 && self.velocity_fraction <= 1.0 {
            return Ok(());
        }
        let (value, bound) = (self.velocity_fraction, "> 0 and at most 1".into());
        Err(Error::OutOfRange { what: "velocity_fraction".into(), value, bound })
    }
}

/// Times in seconds, from 0, so that between rows no joint is faster than the given share of its limit.
///
/// `q` holds the rows one after the other, `velocity_limits` one entry per joint (rad/s or m/s, `inf` for none).
///
/// ```
/// use redundancy_core::path::{TimingSettings, times_within_limits};
/// let settings = TimingSettings { velocity_fraction: 1.0, smoothing: 0 };
/// let t = times_within_limits(&[0.0, 0.0, 0.5, 0.0, 0.5, 2.0], &[1.0, 2.0], settings)?;
/// assert_eq!(t, [0.0, 0.5, 1.5]);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Rows that are not whole or not finite, limits that are not positive, invalid settings, and a step in which only
/// joints without a velocity limit move: the times would be arbitrary.
pub fn times_within_limits(q: &[f64], velocity_limits: &[f64], settings: TimingSettings) -> Result<Vec<f64>> {
    settings.validate()?;
    let n = velocity_limits.len();
    if n == 0 {
        return Err(Error::Length { what: "velocity limits".into(), expected: 1, actual: 0 });
    }
    check_length("q", q, q.len() / n * n)?;
    check_finite("q", q)?;
    if let Some(j) = velocity_limits.iter().position(|v| v.is_nan() || *v <= 0.0) {
        let (what, bound) = (format!("velocity limit of joint {j}"), "> 0 (inf for none)".into());
        return Err(Error::OutOfRange { what, value: velocity_limits[j], bound });
    }
    let rows: Vec<&[f64]> = q.chunks_exact(n).collect();
    let mut rates = Vec::with_capacity(rows.len());
    for (i, pair) in rows.windows(2).enumerate() {
        let moves = pair[0].iter().zip(pair[1]).map(|(a, b)| (b - a).abs());
        let needed = moves.clone().zip(velocity_limits).map(|(d, v)| d / v).fold(0.0, f64::max);
        if needed == 0.0
            && let Some(j) = moves.into_iter().position(|d| d > 0.0)
        {
            let message = format!(
                "from row {i} to row {} only joints without a velocity limit move (joint {j}): give times or limits",
                i + 1
            );
            return Err(Error::Invalid(message));
        }
        rates.push(1.0 / (needed / settings.velocity_fraction).max(SHORTEST_STEP));
    }
    let smooth = windowed(&rates, settings.smoothing, |w| w.iter().copied().fold(f64::INFINITY, f64::min));
    let smooth = windowed(&smooth, settings.smoothing, |w| w.iter().sum::<f64>() / w.len() as f64);
    let mut t = Vec::with_capacity(rows.len());
    let mut now = 0.0;
    t.extend(rows.first().map(|_| now));
    // A mean of equal numbers may round above them.
    t.extend(rates.iter().zip(smooth).map(|(rate, smooth)| {
        now += 1.0 / smooth.min(*rate);
        now
    }));
    Ok(t)
}

/// Applies `f` to the window of each entry, cut off at the ends.
fn windowed(values: &[f64], half_width: usize, f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let n = values.len();
    (0..n)
        .map(|i| f(&values[i.saturating_sub(half_width)..n.min(i.saturating_add(half_width + 1))]))
        .collect()
}

/// Velocities of rows over increasing times: the derivative of the parabola through a row and its neighbours, the
/// difference quotient at both ends. Each is a mean of difference quotients, so it keeps what limits they keep.
pub(crate) fn differences(t: &[f64], q: &[f64], n: usize) -> Vec<f64> {
    let rows = t.len();
    let mut qd = vec![0.0; q.len()];
    let quotient = |i: usize, j: usize| (q[(i + 1) * n + j] - q[i * n + j]) / (t[i + 1] - t[i]);
    for i in 0..if rows < 2 { 0 } else { rows } {
        for j in 0..n {
            qd[i * n + j] = if i == 0 {
                quotient(0, j)
            } else if i == rows - 1 {
                quotient(rows - 2, j)
            } else {
                let (before, after) = (t[i] - t[i - 1], t[i + 1] - t[i]);
                (quotient(i - 1, j) * after + quotient(i, j) * before) / (before + after)
            };
        }
    }
    qd
}
