//! Configurations that no branch holds: at a gimbal the outer joints of a spherical joint may share their sum in any way.

use std::f64::consts::PI;

use super::spherical::Spherical;
use super::spring_search::{SpringSearch, Springs};
use super::stretches::Elbow;
use crate::joint_space::{TURN, turned};
use crate::tolerance::{GIMBAL_PASSAGE, SLOPE_ROUNDING};

impl SpringSearch<'_> {
    /// Offers what the branches cannot hold: at a gimbal the outer joints of a spherical joint may share their sum in any
    /// way, a line of configurations over one swivel. Where the swivel does not leave the gimbal (shoulder or wrist
    /// stretched out along its neighbours) the best swivel is sampled and refined, not proven.
    pub(super) fn offer_gimbals(&mut self, elbows: &[Elbow]) {
        const SAMPLES: usize = 72;
        let motion = self.motion;
        for (e, Elbow { joints, .. }) in elbows.iter().enumerate() {
            let locked = joints.iter().any(|j| j.locked);
            let passages: Vec<f64> = joints.iter().flat_map(Spherical::gimbals).collect();
            if !locked && passages.is_empty() {
                continue;
            }
            for branch in motion.branch_indices().filter(|b| motion.elbow_of(*b) == e) {
                for s in &passages {
                    self.offer_family(branch, *s);
                }
                if !locked {
                    continue;
                }
                let step = TURN / SAMPLES as f64;
                let mut best = (f64::INFINITY, 0.0);
                for k in 0..SAMPLES {
                    let s = step * k as f64 - PI;
                    let value = self.offer_family(branch, s);
                    best = if value < best.0 { (value, s) } else { best };
                }
                let mut width = step;
                while best.0.is_finite() && width > SLOPE_ROUNDING {
                    for s in [best.1 - width, best.1 + width] {
                        let value = self.offer_family(branch, s);
                        best = if value < best.0 { (value, s) } else { best };
                    }
                    width *= 0.7;
                }
            }
        }
    }

    /// Offers the best way to share the sum of the outer joints at swivel `s`, for joints at their gimbal there, and
    /// returns its value (infinite when no way holds the limits).
    pub(super) fn offer_family(&mut self, branch: usize, s: f64) -> f64 {
        let inner = &self.motion.arm.inner;
        let sample = self.motion.sample(branch, &self.motion.node(branch, s));
        let mut q = sample.q;
        let Springs { weight, center, .. } = &self.springs;
        let cost = |i: usize, q: f64| 0.5 * weight[i] * (q - center[i]).powi(2);
        for first in [0, 4] {
            let (middle, third) = (first + 1, first + 2);
            let (sin, cos) =
                (inner.geometry.sign[middle] * (sample.q[middle] - inner.geometry.zero[middle])).sin_cos();
            if sin.abs() > GIMBAL_PASSAGE {
                continue;
            }
            // What the first joint gains the third one loses, or gains as well when the middle angle is pi.
            let ratio =
                inner.geometry.sign[first] * inner.geometry.sign[third] * if cos > 0.0 { 1.0 } else { -1.0 };
            let (w, v) = (weight[first], weight[third]);
            let mut best = f64::INFINITY;
            for turns in -2..=2 {
                let (x, y) = (sample.q[first], turned(sample.q[third], f64::from(turns)));
                let (a, b) = ((y - inner.lower[third]) * ratio, (y - inner.upper[third]) * ratio);
                let low = (inner.lower[first] - x).max(a.min(b));
                let high = (inner.upper[first] - x).min(a.max(b));
                if low > high {
                    continue;
                }
                let wish = w * (center[first] - x) + v * ratio * (y - center[third]);
                let t = if w + v > 0.0 { wish / (w + v) } else { 0.0 }.clamp(low, high);
                let total = cost(first, x + t) + cost(third, y - ratio * t);
                if total < best {
                    best = total;
                    (q[first], q[third]) = (x + t, y - ratio * t);
                }
            }
        }
        self.offer_q(branch, s, &q)
    }
}
