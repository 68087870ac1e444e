//! The problem of a swivel plan: the circles of the points, limits, windings, obstacles, and what all that costs.

use std::f64::consts::PI;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::anchor::Anchor;
use super::near::Near;
use super::obstacles::SceneAlongPath;
use super::settings::{SwivelChoice, SwivelPlanSettings};
use super::windings::Windings;
use crate::criterion::{Manipulability, Measure};
use crate::error::Result;
use crate::joint_space::{TURN, holds, nearest};
use crate::kinematics::{Scratch, Task};
use crate::parallel::prelude::*;
use crate::path::Path;
use crate::scene::SweepMemory;
use crate::solutions::{SelfMotion, SrsArm};
use crate::tolerance::JOINT_JUMP;

/// Configurations from which the largest manipulability of an arm is estimated: within some percent.
const MANIPULABILITY_SAMPLES: usize = 2_000;
/// What is missing from the wanted clearance costs the weight when it is a tenth of it: enough that a fraction of a
/// millimetre is given away for everything else.
const CLEARANCE_STEEP: f64 = 100.0;
/// Largest value of the limit term of one joint: at the limit itself it would be infinite.
const LIMIT_CAP: f64 = 1e3;

/// A choice for every point, and what it costs by the search that found it.
#[derive(Debug, Clone, Default)]
pub(in crate::planning) struct SwivelLine {
    pub branch: Vec<usize>,
    pub swivel: Vec<f64>,
    pub q: Vec<[f64; 7]>,
    pub reconfigurations: Vec<usize>,
    pub cost: f64,
}

/// See the module.
pub(in crate::planning) struct SwivelProblem<'a> {
    pub arm: &'a SrsArm,
    pub settings: &'a SwivelPlanSettings,
    pub circles: Vec<SelfMotion>,
    pub lower: [f64; 7],
    pub upper: [f64; 7],
    /// Middle of each joint's range, and one over half of it; 0 for joints without limits.
    middle: [f64; 7],
    inverse: [f64; 7],
    /// Part of the path between point k and k + 1.
    pub parts: Vec<f64>,
    /// Largest joint steps between point k and k + 1.
    pub steps: Vec<[f64; 7]>,
    pub(super) windings: Windings,
    pub branches: Vec<usize>,
    pub(super) obstacles: Option<SceneAlongPath>,
    /// Where the manipulability counts: its measure, and the largest value seen.
    dexterity: Option<(Manipulability, f64)>,
    /// Numbers of the points on the path.
    points: Vec<usize>,
    /// Dearer than any path: the fewest reconfigurations come first.
    pub reconfiguration: f64,
}

/// More than any path without reconfigurations costs.
fn dearest(settings: &SwivelPlanSettings, parts: &[f64], steps: &[[f64; 7]]) -> f64 {
    let points = 7.0 * settings.limit_weight * LIMIT_CAP * LIMIT_CAP
        + 2.0 * settings.swivel_weight
        + CLEARANCE_STEEP * settings.clearance_weight
        + settings.manipulability_weight;
    let squares = steps.iter().map(|step| step.iter().map(|x| x * x).sum::<f64>());
    let motion: f64 = squares.zip(parts).map(|(square, part)| settings.motion_weight * square / part).sum();
    1.0 + points + motion
}

/// The largest manipulability of an arm among seeded configurations within its limits.
fn best_manipulability(arm: &SrsArm, measure: &Manipulability) -> f64 {
    let chain = arm.chain();
    let mut scratch = Scratch::new(chain);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut best = f64::MIN_POSITIVE;
    for _ in 0..MANIPULABILITY_SAMPLES {
        let q: [f64; 7] = std::array::from_fn(|i| {
            let (lower, upper) = (chain.lower()[i].max(-PI), chain.upper()[i].min(PI));
            lower + (upper - lower) * rng.random::<f64>()
        });
        best = best.max(measure.value_at(&chain.kinematics_unchecked(&q, &mut scratch)));
    }
    best
}

impl<'a> SwivelProblem<'a> {
    pub fn new(
        arm: &'a SrsArm,
        path: &Path,
        settings: &'a SwivelPlanSettings,
        circles: Vec<SelfMotion>,
    ) -> Result<Self> {
        let n = circles.len();
        let t = path.t();
        let obstacles = SceneAlongPath::new(arm, path, settings)?;
        let dexterity = (settings.manipulability_weight > 0.0).then(|| {
            let measure = Manipulability::with_measure(arm.chain(), Task::POSE, Measure::Sqrt);
            let best = best_manipulability(arm, &measure);
            (measure, best)
        });
        let (mut lower, mut upper) = ([0.0; 7], [0.0; 7]);
        for i in 0..7 {
            lower[i] = arm.chain().lower()[i] + settings.margin;
            upper[i] = arm.chain().upper()[i] - settings.margin;
        }
        let ranged = |i: usize| (upper[i] - lower[i]).is_finite() && upper[i] > lower[i];
        let middle = std::array::from_fn(|i| if ranged(i) { 0.5 * (lower[i] + upper[i]) } else { 0.0 });
        let inverse = std::array::from_fn(|i| if ranged(i) { 2.0 / (upper[i] - lower[i]) } else { 0.0 });
        let total = t.map_or((n - 1).max(1) as f64, |t| t[n - 1] - t[0]);
        let gaps = (1..n).map(|k| t.map_or(1.0, |t| t[k] - t[k - 1]));
        let parts: Vec<f64> = gaps.clone().map(|gap| gap / total).collect();
        let steps: Vec<[f64; 7]> = gaps
            .map(|gap| match (&settings.velocity_limits, t) {
                (Some(v), Some(_)) => std::array::from_fn(|i| (v[i] * gap).min(JOINT_JUMP)),
                _ => [JOINT_JUMP; 7],
            })
            .collect();
        let reconfiguration = dearest(settings, &parts, &steps);
        let windings = Windings::new(&lower, &upper);
        let branches = settings.branch.map_or((0..8).collect(), |b| vec![b]);
        let points = (0..n).collect();
        Ok(Self {
            arm,
            settings,
            circles,
            lower,
            upper,
            middle,
            inverse,
            parts,
            steps,
            windings,
            branches,
            obstacles,
            dexterity,
            points,
            reconfiguration,
        })
    }

    /// The points for which something holds, ascending.
    pub fn where_all(&self, holds: impl Fn(usize) -> bool + Sync) -> Vec<usize> {
        (0..self.circles.len()).into_par_iter().filter(|k| holds(*k)).collect()
    }

    /// The swivel of point `k` where it is given.
    #[inline(always)]
    pub fn fixed(&self, k: usize) -> Option<f64> {
        match &self.settings.choice {
            SwivelChoice::Fixed(s) => Some(if s.len() == 1 { s[0] } else { s[self.points[k]] }),
            _ => None,
        }
    }

    /// Swivels of the grid at point `k`.
    pub fn grid(&self, k: usize) -> Vec<f64> {
        let m = self.settings.swivels;
        match self.fixed(k) {
            Some(s) => vec![s],
            None => (0..m).map(|i| TURN * (i as f64 / m as f64 - 0.5)).collect(),
        }
    }

    /// How near the arm is at point `k` at swivel `s`, of the branches in `mask`.
    /// The anchors are of the same point.
    pub fn distances(
        &self,
        k: usize,
        s: f64,
        q: &[[f64; 7]; 8],
        mask: u8,
        anchors: &mut [Option<Anchor>; 8],
    ) -> [Near; 8] {
        let circle = &self.circles[k];
        self.obstacles.as_ref().map_or([Near::FAR; 8], |o| o.of_branches(circle, k, s, q, mask, anchors))
    }

    /// How near one branch is at point `k` at swivel `s`.
    pub fn distance(&self, k: usize, branch: usize, s: f64, q: &[f64; 7]) -> Near {
        self.obstacles.as_ref().map_or(Near::FAR, |o| o.of_one(&self.circles[k], k, (branch, s, q)))
    }

    /// Whether some winding of each joint holds the limits.
    pub fn holds(&self, q: &[f64; 7]) -> bool {
        (0..7).all(|i| holds(q[i], self.lower[i], self.upper[i]) || self.windings.free(i))
    }

    /// Cost of being at a distance from the obstacles and at a manipulability; `None` in a collision.
    #[inline(always)]
    pub fn place_cost(&self, q: &[f64; 7], near: Near, scratch: &mut Scratch) -> Option<f64> {
        if near.least <= 0.0 {
            return None;
        }
        let mut cost = self.settings.clearance_weight * CLEARANCE_STEEP * near.missing;
        if let Some((measure, best)) = &self.dexterity {
            let here = measure.value_at(&self.arm.chain().kinematics_unchecked(q, scratch));
            let missing = (1.0 - here / best).max(0.0);
            cost += self.settings.manipulability_weight * missing * missing;
        }
        Some(cost)
    }

    /// Cost of the joints' places in their ranges.
    #[inline(always)]
    pub fn limit_costs(&self, q: &[f64; 7]) -> [f64; 7] {
        let mut costs = [0.0; 7];
        for i in 0..7 {
            costs[i] = self.limit_cost(i, q[i]);
        }
        costs
    }

    /// Cost of a joint's place in its range.
    #[inline(always)]
    pub fn limit_cost(&self, i: usize, q: f64) -> f64 {
        let x = (q - self.middle[i]) * self.inverse[i];
        let square = x * x;
        let room = if 1.0 - square > 1e-9 { 1.0 - square } else { 1e-9 };
        let nearness = square / room;
        let nearness = if nearness < LIMIT_CAP { nearness } else { LIMIT_CAP };
        self.settings.limit_weight * nearness * nearness
    }

    /// Cost of the distance from the desired swivel.
    #[inline(always)]
    pub fn wish_cost(&self, k: usize, s: f64) -> f64 {
        let SwivelChoice::Near(wish) = &self.settings.choice else { return 0.0 };
        let wish = if wish.len() == 1 { wish[0] } else { wish[self.points[k]] };
        self.settings.swivel_weight * (1.0 - (s - wish).cos())
    }

    /// The part of the path that belongs to a point.
    #[inline(always)]
    pub fn share(&self, k: usize) -> f64 {
        let before = if k > 0 { self.parts[k - 1] } else { 0.0 };
        let after = self.parts.get(k).copied().unwrap_or(0.0);
        (0.5 * (before + after)).max(f64::MIN_POSITIVE)
    }

    /// Cost of being at `q` with swivel `s` at point `k`, times the part of the path that belongs to the point; `place`
    /// is [`SwivelProblem::place_cost`].
    pub fn node_cost(&self, k: usize, q: &[f64; 7], s: f64, place: f64) -> f64 {
        let limits: f64 = self.limit_costs(q).iter().sum();
        (place + self.wish_cost(k, s) + limits) * self.share(k)
    }

    /// Weight of the square of the joint step between point `k` and the next.
    #[inline(always)]
    pub fn step_weight(&self, k: usize) -> f64 {
        self.settings.motion_weight / self.parts[k]
    }

    /// Cost of the joint step between points `k` and `k + 1`; `None` when it is too large.
    #[inline(always)]
    pub fn step_cost(&self, k: usize, a: &[f64; 7], b: &[f64; 7]) -> Option<f64> {
        let limits = &self.steps[k];
        let mut sum = 0.0;
        for i in 0..7 {
            let step = b[i] - a[i];
            if step.abs() > limits[i] {
                return None;
            }
            sum += step * step;
        }
        Some(self.step_weight(k) * sum)
    }

    /// Total cost of a line whose distances from the obstacles are known.
    pub fn cost_of(&self, swivel: &[f64], q: &[[f64; 7]], near: &[Near]) -> f64 {
        let init = || Scratch::new(self.arm.chain());
        let points: Vec<f64> = (0..q.len())
            .into_par_iter()
            .map_init(init, |scratch, k| {
                let place = self.place_cost(&q[k], near[k], scratch);
                place.map_or(f64::INFINITY, |place| self.node_cost(k, &q[k], swivel[k], place))
            })
            .collect();
        // In order, so that the sum does not depend on the threads.
        let mut total: f64 = points.iter().sum();
        for k in 1..q.len() {
            total += self.step_cost(k - 1, &q[k - 1], &q[k]).unwrap_or(f64::INFINITY);
        }
        if self.settings.acceleration_weight > 0.0 {
            for k in 1..q.len() - 1 {
                let (a, b) = (1.0 / self.parts[k - 1], 1.0 / self.parts[k]);
                let share = 0.5 * (self.parts[k - 1] + self.parts[k]);
                let square: f64 =
                    (0..7).map(|i| ((q[k + 1][i] - q[k][i]) * b - (q[k][i] - q[k - 1][i]) * a).powi(2)).sum();
                total += self.settings.acceleration_weight * square / share;
            }
        }
        total
    }

    /// How near the arm is at point `k` of a line.
    pub fn distance_of(&self, line: &SwivelLine, k: usize) -> Near {
        self.distance(k, line.branch[k], line.swivel[k], &line.q[k])
    }

    /// Whether what the swivel moves is clear all the way between point `k` and the next, when the joints go straight;
    /// `near` are the distances at both.
    pub fn edge_is_clear(
        &self,
        k: usize,
        ends: [&[f64; 7]; 2],
        near: [f64; 2],
        memory: &mut Option<SweepMemory>,
    ) -> bool {
        self.obstacles.as_ref().is_none_or(|obstacles| obstacles.edge_is_clear(k, ends, near, memory))
    }

    /// The points after which a line touches an obstacle before the next one.
    pub fn touching(&self, line: &SwivelLine) -> Vec<usize> {
        if self.obstacles.is_none() {
            return Vec::new();
        }
        let n = line.q.len();
        let near: Vec<f64> = (0..n).into_par_iter().map(|k| self.distance_of(line, k).least).collect();
        let edge = |memory: &mut Option<SweepMemory>, k: usize| {
            let ends = [&line.q[k - 1], &line.q[k]];
            let jump = line.reconfigurations.binary_search(&k).is_ok();
            (!jump && !self.edge_is_clear(k - 1, ends, [near[k - 1], near[k]], memory)).then_some(k - 1)
        };
        (1..n).into_par_iter().map_init(|| None, edge).flatten().collect()
    }

    /// The same problem on every `stride`-th point and the last one.
    pub fn thinned(&self, stride: usize) -> Self {
        let n = self.circles.len();
        let mut kept: Vec<usize> = (0..n).step_by(stride).collect();
        if kept.last() != Some(&(n - 1)) {
            kept.push(n - 1);
        }
        let sum = |w: &[usize], of: &dyn Fn(usize) -> f64| -> f64 { (w[0]..w[1]).map(of).sum() };
        let parts: Vec<f64> = kept.windows(2).map(|w| sum(w, &|k| self.parts[k])).collect();
        let steps: Vec<[f64; 7]> = kept
            .windows(2)
            .map(|w| std::array::from_fn(|i| sum(w, &|k| self.steps[k][i]).min(JOINT_JUMP)))
            .collect();
        let obstacles = self.obstacles.as_ref().map(|obstacles| obstacles.at_points(&kept));
        let reconfiguration = dearest(self.settings, &parts, &steps);
        Self {
            arm: self.arm,
            settings: self.settings,
            circles: kept.iter().map(|k| self.circles[*k].clone()).collect(),
            lower: self.lower,
            upper: self.upper,
            middle: self.middle,
            inverse: self.inverse,
            parts,
            steps,
            windings: Windings::new(&self.lower, &self.upper),
            branches: self.branches.clone(),
            obstacles,
            dexterity: self.dexterity.clone(),
            points: kept.iter().map(|k| self.points[*k]).collect(),
            reconfiguration,
        }
    }

    /// A line on thinned points as one on all points, with the swivel linear in between; `None` where that breaks a limit
    /// or touches an obstacle.
    pub fn spread(&self, thin: &SwivelLine, stride: usize) -> Option<SwivelLine> {
        let n = self.circles.len();
        let (mut swivel, mut branch) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for k in 0..n {
            let (at, last) = (k / stride, (k / stride + 1).min(thin.swivel.len() - 1));
            let length = if (at + 1) * stride < n { stride } else { (n - 1 - at * stride).max(1) };
            let share = (k - at * stride) as f64 / length as f64;
            swivel.push(thin.swivel[at] + share * (thin.swivel[last] - thin.swivel[at]));
            branch.push(thin.branch[at]);
        }
        let (q, _) = self.along(&swivel, &branch, &thin.q[0])?;
        Some(SwivelLine { branch, swivel, q, reconfigurations: Vec::new(), cost: thin.cost })
    }

    /// The joint positions along swivels, unwound from `first` on, and the distances from the obstacles; `None` where they
    /// break a limit, step too far or touch an obstacle, at a point or between two.
    pub fn along(
        &self,
        swivel: &[f64],
        branch: &[usize],
        first: &[f64; 7],
    ) -> Option<(Vec<[f64; 7]>, Vec<Near>)> {
        let (mut rows, near): (Vec<[f64; 7]>, Vec<Near>) = swivel
            .par_iter()
            .enumerate()
            .map(|(k, s)| {
                let q = self.circles[k].branch_of(*s, branch[k]);
                (q, self.distance(k, branch[k], *s, &q))
            })
            .unzip();
        let mut before = *first;
        for (k, q) in rows.iter_mut().enumerate() {
            for i in 0..7 {
                q[i] = nearest(q[i], before[i]);
                let step = k == 0 || (q[i] - before[i]).abs() <= self.steps[k - 1][i];
                if !(step && q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
                    return None;
                }
            }
            if near[k].least <= 0.0 {
                return None;
            }
            before = *q;
        }
        let edge = |memory: &mut Option<SweepMemory>, k: usize| {
            let ends = [near[k - 1].least, near[k].least];
            self.edge_is_clear(k - 1, [&rows[k - 1], &rows[k]], ends, memory)
        };
        let clear = self.obstacles.is_none()
            || (1..rows.len()).into_par_iter().map_init(|| None, edge).all(|clear| clear);
        clear.then_some((rows, near))
    }
}
