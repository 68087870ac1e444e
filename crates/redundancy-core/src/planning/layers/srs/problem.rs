//! What a plan of the swivel is about: the circles over the points, limits, windings, obstacles, and what all that costs.

use std::f64::consts::PI;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::clearance::{ArmClearance, OverPose};
use super::settings::{SwivelChoice, SwivelPlanSettings};
use crate::criterion::{Manipulability, Measure};
use crate::error::Result;
use crate::joint_space::{TURN, holds, turned, turns_over, turns_within};
use crate::kinematics::{Scratch, Task};
use crate::parallel::prelude::*;
use crate::path::Path;
use crate::scene::Scene;
use crate::solutions::{SelfMotion, SrsArm};
use crate::tolerance::JOINT_JUMP;

/// Configurations from which the largest manipulability of an arm is estimated: within some percent.
const MANIPULABILITY_SAMPLES: usize = 2_000;
/// What is missing from the wanted clearance costs the weight when it is a tenth of it: enough that a fraction of a
/// millimetre is given away for everything else.
const CLEARANCE_STEEP: f64 = 100.0;
/// Largest value of the limit term of one joint: at the limit itself it would be infinite.
const LIMIT_CAP: f64 = 1e3;
/// Distance (m) from obstacles beyond which distances need not be told apart, at least.
const CLEARANCE_BEYOND: f64 = 0.05;
/// Halvings of a step between points until it is known whether it touches an obstacle; what is still open then touches.
const EDGE_HALVINGS: usize = 12;
/// Most windings of all joints together. Beyond, the later joints count as free, and the line is checked at its end.
const MAX_WINDINGS: usize = 243;

/// Windings as one number: digit i is the turns added to joint i, less the least that its limits admit.
pub(in crate::planning) struct Windings {
    least: [i32; 7],
    count: [usize; 7],
    stride: [usize; 7],
    pub total: usize,
    /// Turns of each joint by code.
    pub turns: Vec<[f64; 7]>,
    /// Whether principal values that wrap are the same position, or another winding of it; else the joint cannot turn so
    /// far.
    pub wraps: [bool; 7],
}

impl Windings {
    fn new(lower: &[f64; 7], upper: &[f64; 7]) -> Self {
        let (mut least, mut count, mut stride, mut total) = ([0; 7], [1; 7], [0; 7], 1usize);
        let mut wraps = [false; 7];
        for i in 0..7 {
            if lower[i] == f64::NEG_INFINITY || upper[i] == f64::INFINITY {
                wraps[i] = true;
                continue;
            }
            // Principal values are in (-pi, pi]: turns k for which (-pi, pi] + k turns meets the range.
            let (a, b) = (lower[i].max(-2.0 * TURN), upper[i].min(2.0 * TURN));
            let [first, last] = turns_within([-PI, PI], a, b);
            least[i] = first as i32;
            count[i] = (last as i32 - least[i] + 1).clamp(1, 5) as usize;
            if total * count[i] > MAX_WINDINGS {
                (count[i], least[i]) = (1, 0);
                wraps[i] = true;
                continue;
            }
            wraps[i] = count[i] > 1;
            stride[i] = total;
            total *= count[i];
        }
        let mut windings = Self { least, count, stride, total, turns: Vec::new(), wraps };
        windings.turns = (0..total).map(|code| windings.turns_of(code)).collect();
        windings
    }

    fn turns_of(&self, code: usize) -> [f64; 7] {
        std::array::from_fn(|i| {
            let digit = if self.count[i] > 1 { code / self.stride[i] % self.count[i] } else { 0 };
            f64::from(self.least[i] + digit as i32)
        })
    }

    /// Whether the windings of a joint are states of their own.
    #[inline(always)]
    pub fn counts(&self, joint: usize) -> bool {
        self.count[joint] > 1
    }

    /// Whether a joint has no limits, so that all of its windings are alike.
    #[inline(always)]
    pub fn free(&self, joint: usize) -> bool {
        self.wraps[joint] && self.count[joint] == 1
    }

    /// The joints whose windings count.
    pub fn several(&self) -> impl Iterator<Item = usize> {
        (0..7).filter(|i| self.counts(*i))
    }

    /// Positions of a node with the windings of a code.
    pub fn wound(&self, q: &[f64; 7], code: usize) -> [f64; 7] {
        std::array::from_fn(|i| if self.counts(i) { turned(q[i], self.turns[code][i]) } else { q[i] })
    }

    /// The code from which one comes to `code` by `turns` full turns less; `None` where a joint has no such winding.
    pub fn shifted(&self, code: usize, turns: &[i32; 7]) -> Option<usize> {
        let mut out = code;
        for i in self.several() {
            let digit = (code / self.stride[i] % self.count[i]) as i32 + turns[i];
            if digit < 0 || digit >= self.count[i] as i32 {
                return None;
            }
            out = out.wrapping_add_signed(self.stride[i] as isize * turns[i] as isize);
        }
        Some(out)
    }
}

/// Full turns by which `b` is further than the short way from `a`, of the joints that may wrap.
#[inline(always)]
pub(in crate::planning) fn turns_between(windings: &Windings, a: &[f64; 7], b: &[f64; 7]) -> [i32; 7] {
    std::array::from_fn(|i| if windings.wraps[i] { turns_over(b[i] - a[i]) } else { 0 })
}

/// The obstacles along the path.
pub(in crate::planning) struct Obstacles {
    pub arm: ArmClearance,
    /// The scene at time 0, and the times of the points where something moves.
    base: Scene,
    times: Option<Vec<f64>>,
    /// The scene at each point; one for all where nothing moves.
    scenes: Vec<Scene>,
    over: Vec<Option<OverPose>>,
    /// Speed of the fastest obstacle times the time between points, m.
    moved: Vec<f64>,
    /// How far the arm reaches beyond each joint: what a point of it moves per rad, m.
    reach: [f64; 7],
}

impl Obstacles {
    fn new(arm: &SrsArm, path: &Path, scene: &Scene, settings: &SwivelPlanSettings) -> Result<Self> {
        let near = ArmClearance::new(arm, settings.link_radius)?;
        let times = path.t().filter(|_| scene.moves()).map(<[f64]>::to_vec);
        let scenes: Vec<Scene> = match &times {
            Some(t) => t.iter().map(|t| scene.at(*t)).collect(),
            None => vec![scene.clone()],
        };
        let fastest = scene.obstacles().iter().map(|o| o.velocity.norm()).fold(0.0, f64::max);
        let moved = match &times {
            Some(t) => t.windows(2).map(|w| fastest * (w[1] - w[0])).collect(),
            None => vec![0.0; path.len().saturating_sub(1)],
        };
        let beyond = settings.wanted_clearance.max(CLEARANCE_BEYOND);
        let over = path
            .poses()
            .par_iter()
            .enumerate()
            .map(|(k, pose)| near.over(pose, &scenes[k.min(scenes.len() - 1)], beyond))
            .collect();
        let reach = reach(arm);
        Ok(Self { arm: near, base: scene.clone(), times, scenes, over, moved, reach })
    }

    pub fn scene(&self, k: usize) -> &Scene {
        &self.scenes[k.min(self.scenes.len() - 1)]
    }

    /// How far any point of the arm moves at most against any obstacle between point `k` and the next.
    fn travel(&self, k: usize, [a, b]: [&[f64; 7]; 2]) -> f64 {
        let turned: f64 = (0..7).map(|i| self.reach[i] * (b[i] - a[i]).abs()).sum();
        turned + self.moved[k]
    }
}

/// A choice for every point.
#[derive(Debug, Clone, Default)]
pub(in crate::planning) struct Line {
    pub branch: Vec<usize>,
    pub swivel: Vec<f64>,
    pub q: Vec<[f64; 7]>,
    pub reconfigurations: Vec<usize>,
    pub cost: f64,
}

pub(in crate::planning) struct Problem<'a> {
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
    pub windings: Windings,
    pub branches: Vec<usize>,
    pub obstacles: Option<Obstacles>,
    /// Where the manipulability counts: its measure, and the largest value seen.
    dexterity: Option<(Manipulability, f64)>,
    /// Numbers of the points on the path.
    points: Vec<usize>,
    /// Dearer than any path: the fewest reconfigurations come first.
    pub reconfiguration: f64,
}

/// How far the arm reaches beyond each joint at most, m.
fn reach(arm: &SrsArm) -> [f64; 7] {
    let mut scratch = Scratch::new(arm.chain());
    let kinematics = arm.chain().kinematics_unchecked(&[0.0; 7], &mut scratch);
    let origins = kinematics.origins();
    let mut reach = [0.0; 7];
    let mut beyond = 0.0;
    for i in (0..7).rev() {
        // The origins of neighbouring joints keep their distance.
        let next = origins.get(i + 1).unwrap_or(&kinematics.pose().translation.vector);
        beyond += (next - origins[i]).norm();
        reach[i] = beyond;
    }
    reach
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

impl<'a> Problem<'a> {
    pub fn new(
        arm: &'a SrsArm,
        path: &Path,
        settings: &'a SwivelPlanSettings,
        circles: Vec<SelfMotion>,
    ) -> Result<Self> {
        let n = circles.len();
        let t = path.t();
        let obstacles = match settings.scene.as_ref().filter(|scene| !scene.obstacles().is_empty()) {
            None => None,
            Some(scene) => Some(Obstacles::new(arm, path, scene, settings)?),
        };
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

    /// Distance from the obstacles at point `k` of every branch at swivel `s`; infinite without a scene.
    pub fn distances(&self, k: usize, s: f64, q: &[[f64; 7]; 8], scratch: &mut Scratch) -> [f64; 8] {
        match &self.obstacles {
            None => [f64::INFINITY; 8],
            Some(o) => o.arm.of_branches(&self.circles[k], o.over[k].as_ref(), o.scene(k), s, q, scratch),
        }
    }

    /// Distance from the obstacles of one branch.
    pub fn distance(&self, k: usize, s: f64, q: &[f64; 7], scratch: &mut Scratch) -> f64 {
        match &self.obstacles {
            None => f64::INFINITY,
            Some(o) => o.arm.of_one(&self.circles[k], o.over[k].as_ref(), o.scene(k), s, q, scratch),
        }
    }

    /// Whether some winding of each joint holds the limits.
    pub fn holds(&self, q: &[f64; 7]) -> bool {
        (0..7).all(|i| holds(q[i], self.lower[i], self.upper[i]) || self.windings.free(i))
    }

    /// Cost of being at a distance from the obstacles and at a manipulability; `None` in a collision.
    #[inline(always)]
    pub fn place_cost(&self, q: &[f64; 7], distance: f64, scratch: &mut Scratch) -> Option<f64> {
        if distance <= 0.0 {
            return None;
        }
        let mut cost = 0.0;
        let wanted = self.settings.wanted_clearance;
        if distance < wanted {
            let missing = 1.0 - distance / wanted;
            cost += self.settings.clearance_weight * CLEARANCE_STEEP * missing * missing;
        }
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

    /// Cost of the distance from a wished swivel.
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
    /// is [`Problem::place_cost`].
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

    /// Whether the arm is clear of the obstacles all the way between point `k` and the next, when its joints go straight
    /// from `a` to `b`: as far as it moves at most, the distance cannot fall. `near`: the distances at both.
    pub fn edge_is_clear(
        &self,
        k: usize,
        [a, b]: [&[f64; 7]; 2],
        near: [f64; 2],
        scratch: &mut Scratch,
    ) -> bool {
        let Some(o) = &self.obstacles else { return true };
        let travel = o.travel(k, [a, b]);
        let mut open = vec![([0.0, 1.0], near, 0)];
        while let Some(([from, to], [d0, d1], depth)) = open.pop() {
            if d0 <= 0.0 || d1 <= 0.0 {
                return false;
            }
            if d0 + d1 > travel * (to - from) {
                continue;
            }
            if depth == EDGE_HALVINGS {
                return false;
            }
            let middle = 0.5 * (from + to);
            let q: [f64; 7] = std::array::from_fn(|i| a[i] + middle * (b[i] - a[i]));
            let distance = match &o.times {
                Some(t) => o.arm.at_q(&q, &o.base.at(t[k] + middle * (t[k + 1] - t[k])), scratch),
                None => o.arm.at_q(&q, &o.base, scratch),
            };
            open.push(([from, middle], [d0, distance], depth + 1));
            open.push(([middle, to], [distance, d1], depth + 1));
        }
        true
    }

    /// The points after which a line touches an obstacle before the next one.
    pub fn touching(&self, line: &Line) -> Vec<usize> {
        if self.obstacles.is_none() {
            return Vec::new();
        }
        let init = || Scratch::new(self.arm.chain());
        let n = line.q.len();
        let near: Vec<f64> = (0..n)
            .into_par_iter()
            .map_init(init, |scratch, k| self.distance(k, line.swivel[k], &line.q[k], scratch))
            .collect();
        (1..n)
            .into_par_iter()
            .map_init(init, |scratch, k| {
                let ends = [&line.q[k - 1], &line.q[k]];
                let jump = line.reconfigurations.binary_search(&k).is_ok();
                (!jump && !self.edge_is_clear(k - 1, ends, [near[k - 1], near[k]], scratch)).then_some(k - 1)
            })
            .flatten()
            .collect()
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
        let obstacles = self.obstacles.as_ref().map(|o| Obstacles {
            arm: o.arm.clone(),
            base: o.base.clone(),
            times: o.times.as_ref().map(|t| kept.iter().map(|k| t[*k]).collect()),
            scenes: if o.scenes.len() > 1 {
                kept.iter().map(|k| o.scenes[*k].clone()).collect()
            } else {
                o.scenes.clone()
            },
            over: kept.iter().map(|k| o.over[*k].clone()).collect(),
            moved: kept.windows(2).map(|w| sum(w, &|k| o.moved[k])).collect(),
            reach: o.reach,
        });
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
}
