//! The fastest motion along a stretch when accelerations may jump.
//!
//! Between nodes the acceleration `u` of the parameter is constant, so `x_{k+1} = x_k + 2 u h`. Backwards along the path
//! follows the largest `x_k` from which the end can be reached, forwards the largest acceleration that stays below it
//! [PhamPham2018]. The limits are asked for at both ends of each interval, which bounds what happens between them to
//! second order in `h`.

use super::settings::RetimeSettings;
use super::stretch::{NodeLimits, Stretch};
use crate::timing::speed::extreme_speed;

/// Squared speeds at the nodes, and which node cannot be passed if one cannot.
pub(super) fn fastest(
    stretch: &Stretch,
    limits: &NodeLimits,
    settings: &RetimeSettings,
    rest: [bool; 2],
    share: &[f64],
) -> std::result::Result<Vec<f64>, usize> {
    let last = stretch.nodes() - 1;
    let mut rows = Vec::new();
    let mut reach = vec![f64::INFINITY; last + 1];
    reach[last] = if rest[1] { 0.0 } else { limits.most[last] * share[last] };
    for k in (0..last).rev() {
        interval(stretch, limits, settings, share, k, &mut rows);
        let gap = 2.0 * (stretch.s[k + 1] - stretch.s[k]);
        rows.push([gap, 1.0, reach[k + 1]]);
        rows.push([-gap, -1.0, 0.0]);
        reach[k] = extreme_speed(&rows, true).ok_or(k)?;
    }
    let mut x = vec![0.0; last + 1];
    x[0] = if rest[0] { 0.0 } else { reach[0] };
    for k in 0..last {
        interval(stretch, limits, settings, share, k, &mut rows);
        let gap = 2.0 * (stretch.s[k + 1] - stretch.s[k]);
        rows.push([gap, 1.0, reach[k + 1]]);
        let most = rows.iter().filter(|row| row[0] > 0.0);
        let u = most.map(|[a, b, c]| (c - b * x[k]) / a).fold(f64::INFINITY, f64::min);
        x[k + 1] = (x[k] + gap * u).clamp(0.0, reach[k + 1]);
        if x[k + 1] <= 0.0 && k + 1 < last {
            return Err(k + 1);
        }
    }
    Ok(x)
}

/// Rows `a u + b x_k <= c` of the interval that begins at node `k`.
fn interval(
    stretch: &Stretch,
    limits: &NodeLimits,
    settings: &RetimeSettings,
    share: &[f64],
    k: usize,
    rows: &mut Vec<[f64; 3]>,
) {
    rows.clear();
    let (n, gap) = (stretch.n, 2.0 * (stretch.s[k + 1] - stretch.s[k]));
    for (node, ahead) in [(k, 0.0), (k + 1, gap)] {
        let share = share[node];
        let mut both = |a: f64, b: f64, low: f64, high: f64| {
            rows.push([a + b * ahead, b, high]);
            rows.push([-a - b * ahead, -b, -low]);
        };
        for j in 0..n {
            let i = node * n + j;
            let most = settings.acceleration_limits[j] * share;
            if most.is_finite() {
                both(stretch.d[i], stretch.dd[i], -most, most);
            }
            if let Some(torque) = &settings.torque_limits
                && torque[j].is_finite()
            {
                // The share is one of the motion: gravity is there in any case.
                let (gravity, torque) = (limits.gravity[i], torque[j]);
                let [low, high] = [-torque - gravity, torque - gravity].map(|room| room * share);
                both(limits.inertial[i], limits.dynamic[i], low, high);
            }
        }
    }
    rows.push([0.0, 1.0, limits.most[k] * share[k]]);
    rows.push([gap, 1.0, limits.most[k + 1] * share[k + 1]]);
}
