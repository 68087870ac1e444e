//! The fastest motion along a stretch when accelerations may jump.
//!
//! Between nodes the acceleration `u` of the parameter is constant, so `x_{k+1} = x_k + 2 u h`. Backwards along the path
//! follows the largest `x_k` from which the end can be reached, forwards the largest acceleration that stays below it
//! [PhamPham2018]. The limits are asked for at both ends of each interval, which bounds what happens between them to
//! second order in `h`.

use super::node_limits::NodeLimits;
use super::settings::RetimeSettings;
use super::stretch::Stretch;
use crate::timing::speed::{PROFILE_SLACK, SPEED_CAP, VERTEX_STEPS};

/// Squared speeds at the nodes, and which node cannot be passed if one cannot.
pub(super) fn fastest(
    stretch: &Stretch,
    limits: &NodeLimits,
    settings: &RetimeSettings,
    rest: [bool; 2],
    share: &[f64],
) -> std::result::Result<Vec<f64>, usize> {
    let last = stretch.nodes() - 1;
    let bounds = Bounds::new(stretch, limits, settings, share);
    let mut reach = vec![f64::INFINITY; last + 1];
    reach[last] = if rest[1] { 0.0 } else { limits.most[last] * share[last] };
    for k in (0..last).rev() {
        // Where the next node can be reached from: not below rest there, not above what it allows.
        let over = 0.5 / (stretch.s[k + 1] - stretch.s[k]);
        let next = Bound { slope: -over, low: 0.0, high: reach[k + 1] * over };
        reach[k] = highest(bounds.of(k), next, bounds.most[k]).ok_or(k)?;
    }
    let mut x = vec![0.0; last + 1];
    x[0] = if rest[0] { 0.0 } else { reach[0] };
    for k in 0..last {
        let gap = 2.0 * (stretch.s[k + 1] - stretch.s[k]);
        let most = bounds.of(k).iter().map(|bound| bound.high + bound.slope * x[k]);
        let u = most.fold(f64::INFINITY, f64::min);
        x[k + 1] = (x[k] + gap * u).clamp(0.0, reach[k + 1]);
        if x[k + 1] <= 0.0 && k + 1 < last {
            return Err(k + 1);
        }
    }
    Ok(x)
}

/// `low + slope x <= u <= high + slope x`.
#[derive(Debug, Clone, Copy)]
struct Bound {
    slope: f64,
    low: f64,
    high: f64,
}

/// What the limits at both ends of each interval say.
struct Bounds {
    all: Vec<Bound>,
    /// Where those of each interval begin.
    first: Vec<usize>,
    /// The largest x at its beginning.
    most: Vec<f64>,
}

impl Bounds {
    fn new(stretch: &Stretch, limits: &NodeLimits, settings: &RetimeSettings, share: &[f64]) -> Self {
        let (n, last) = (stretch.n, stretch.nodes() - 1);
        let per_node = if settings.torque_limits.is_some() { 2 * n } else { n };
        let mut out = Self {
            all: Vec::with_capacity(2 * per_node * last),
            first: Vec::with_capacity(last + 1),
            most: Vec::with_capacity(last),
        };
        for k in 0..last {
            out.first.push(out.all.len());
            out.most.push((limits.most[k] * share[k]).min(SPEED_CAP));
            for (node, ahead) in [(k, 0.0), (k + 1, 2.0 * (stretch.s[k + 1] - stretch.s[k]))] {
                let share = share[node];
                for j in 0..n {
                    let i = node * n + j;
                    let most = settings.acceleration_limits[j] * share;
                    if most.is_finite() {
                        out.add([stretch.d[i], stretch.dd[i]], ahead, [-most, most]);
                    }
                    if let Some(torque) = &settings.torque_limits
                        && limits.matters[i]
                    {
                        // The share is one of the motion: gravity is there in any case.
                        let gravity = limits.gravity[i];
                        let room = [-torque[j] - gravity, torque[j] - gravity].map(|room| room * share);
                        out.add([limits.inertial[i], limits.dynamic[i]], ahead, room);
                    }
                }
            }
        }
        out.first.push(out.all.len());
        out
    }

    /// `low <= a u + b (x + ahead u) <= high`, with `low < 0 < high`.
    fn add(&mut self, [a, b]: [f64; 2], ahead: f64, [low, high]: [f64; 2]) {
        let a = a + b * ahead;
        if a == 0.0 {
            if b != 0.0
                && let Some(most) = self.most.last_mut()
            {
                *most = most.min(if b > 0.0 { high / b } else { low / b });
            }
            return;
        }
        let over = 1.0 / a;
        let [low, high] = if a > 0.0 { [low * over, high * over] } else { [high * over, low * over] };
        self.all.push(Bound { slope: -b * over, low, high });
    }

    fn of(&self, k: usize) -> &[Bound] {
        &self.all[self.first[k]..self.first[k + 1]]
    }
}

/// The largest `0 <= x <= most` for which some `u` is within all bounds.
///
/// What they leave to `u` is concave and piecewise linear in x: Newton's method goes from vertex to vertex and does not
/// step over the end of the feasible part.
fn highest(bounds: &[Bound], next: Bound, most: f64) -> Option<f64> {
    let mut x = most;
    for _ in 0..VERTEX_STEPS {
        let at = |bound: &Bound| [bound.low + bound.slope * x, bound.high + bound.slope * x];
        let (mut lowest, mut uppermost) = (&next, &next);
        let [mut low, mut high] = at(&next);
        for bound in bounds {
            let [from, to] = at(bound);
            if to < high {
                (high, uppermost) = (to, bound);
            }
            if from > low {
                (low, lowest) = (from, bound);
            }
        }
        let offset = uppermost.high - lowest.low;
        if high - low >= -PROFILE_SLACK * (1.0 + offset.abs()) {
            return Some(x);
        }
        // The tangent lies above the concave gap: its zero is on the way to the feasible part.
        let zero = offset / (lowest.slope - uppermost.slope);
        if !(zero.is_finite() && zero < x && zero >= 0.0) {
            return None;
        }
        x = zero;
    }
    None
}
