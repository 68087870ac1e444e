//! The swivel along a whole path.
//!
//! # Problem
//! Over each point of a path an S-R-S arm has up to eight circles of configurations, cut by the joint limits into arcs.
//! Wanted is one swivel per point, on one branch and with continuous windings, that keeps away from the limits and
//! moves little:
//!
//! `sum_k D_k (w_l L(q_k) + w_s S(s_k)) + w_m sum_k |q_{k+1} - q_k|^2 / D_k`, `L = sum_i (x_i^2 / (1 - x_i^2))^2`
//!
//! with `x` the position in the joint range (-1 and 1 at the limits), `S = 1 - cos(s - desired)` and `D` the part of
//! the path (or of the time) between neighbours. The second sum is the rate term that the paper's functional
//! [Moore2010, eq. (29)] lacks: without it the problem is pointwise and the swivel may jump.
//!
//! # Method
//! 1. Dynamic programming over the periodic grid points x swivels, all branches and windings. A step that is faster than
//!    the joints may be does not exist. A reconfiguration costs more than any path, so there are as few as possible.
//! 2. The chosen line is refined in a tube around itself, whose width shrinks: no staircase of grid cells remains.
//!
//! Cost: linear in points and swivels; the circle of each point is computed once, for all branches.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::arm_clearance::{ArmClearance, OverPose};
use crate::chain::Chain;
use crate::criterion::{Manipulability, Measure};
use crate::error::{Error, Result, check_finite};
use crate::kinematics::{Scratch, Task, rotation_vector};
use crate::path::{Event, EventKind, Path, TimingSettings, Trajectory, times_within_limits};
use crate::pose::Pose;
use crate::scene::Scene;
use crate::self_motion::{SelfMotion, SrsArm};
use crate::status::Status;
use crate::tolerance::{CYCLE_ANGLE, CYCLE_POSITION, FREE_SPEED, JOINT_JUMP};

/// Which swivel is wanted.
#[derive(Debug, Clone, PartialEq)]
pub enum SwivelChoice {
    /// The planner chooses.
    Free,
    /// The planner chooses, near to one angle for all points or one for each, rad.
    Near(Vec<f64>),
    /// Exactly one angle for all points or one for each, rad; only branch and windings are chosen.
    Fixed(Vec<f64>),
}

/// Settings of [`plan_swivel`].
#[derive(Debug, Clone, PartialEq)]
pub struct SwivelPlanSettings {
    /// Grid cells of the circle.
    pub swivels: usize,
    /// Which swivel is wanted.
    pub choice: SwivelChoice,
    /// Only this branch, `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    pub branch: Option<usize>,
    /// Distance that is kept from every joint limit, rad.
    pub margin: f64,
    /// Weight of the distance from the limits.
    pub limit_weight: f64,
    /// Weight of the joint motion.
    pub motion_weight: f64,
    /// Weight of the distance from a wished swivel.
    pub swivel_weight: f64,
    /// Largest joint speeds, rad/s; used when the path has times. `None` is off.
    pub velocity_limits: Option<Vec<f64>>,
    /// What is in the way. Obstacles that move are where the times of the path have them, at 0 without times.
    pub scene: Option<Scene>,
    /// Radius of the links, m.
    pub link_radius: f64,
    /// Distance from obstacles that is wanted, m; contact is forbidden.
    pub wanted_clearance: f64,
    /// Weight of what is missing from the wanted distance.
    pub clearance_weight: f64,
    /// Weight of the distance from singularities.
    pub manipulability_weight: f64,
    /// Weight of the joint acceleration, in the refinement.
    pub acceleration_weight: f64,
    /// The arm ends as it began; the path must be closed.
    pub cyclic: bool,
}

impl Default for SwivelPlanSettings {
    fn default() -> Self {
        Self {
            swivels: 180,
            choice: SwivelChoice::Free,
            branch: None,
            margin: 0.0,
            limit_weight: 1.0,
            motion_weight: 0.05,
            swivel_weight: 10.0,
            velocity_limits: None,
            scene: None,
            link_radius: 0.05,
            wanted_clearance: 0.03,
            clearance_weight: 100.0,
            manipulability_weight: 0.0,
            acceleration_weight: 0.0,
            cyclic: false,
        }
    }
}

impl SwivelPlanSettings {
    /// Checks the settings against a path of `points` points.
    ///
    /// # Errors
    /// A number out of its range; the message names it and the bound.
    pub fn validate(&self, points: usize) -> Result<()> {
        let out = |what: &str, value: f64, bound: &str| {
            Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() })
        };
        if !(8..=7_200).contains(&self.swivels) {
            return out("swivels", self.swivels as f64, "between 8 and 7200");
        }
        if let Some(branch) = self.branch
            && branch > 7
        {
            return out("branch index", branch as f64, "<= 7");
        }
        for (what, value, most) in [
            ("margin", self.margin, f64::MAX),
            ("limit_weight", self.limit_weight, MAX_WEIGHT),
            ("motion_weight", self.motion_weight, MAX_WEIGHT),
            ("swivel_weight", self.swivel_weight, MAX_WEIGHT),
            ("clearance_weight", self.clearance_weight, MAX_WEIGHT),
            ("manipulability_weight", self.manipulability_weight, MAX_WEIGHT),
            ("acceleration_weight", self.acceleration_weight, MAX_WEIGHT),
            ("wanted_clearance", self.wanted_clearance, f64::MAX),
            ("link_radius", self.link_radius, f64::MAX),
        ] {
            if !(0.0..=most).contains(&value) {
                let bound = if most == MAX_WEIGHT { "between 0 and 1e6" } else { "finite and >= 0" };
                return out(what, value, bound);
            }
        }
        if let SwivelChoice::Near(s) | SwivelChoice::Fixed(s) = &self.choice {
            check_finite("swivel", s)?;
            if s.len() != 1 && s.len() != points {
                return Err(Error::Length { what: "swivel".into(), expected: points, actual: s.len() });
            }
        }
        if let Some(limits) = &self.velocity_limits {
            crate::error::check_length("velocity_limits", limits, 7)?;
            if let Some(i) = limits.iter().position(|v| v.is_nan() || *v <= 0.0) {
                return out(&format!("velocity limit {i}"), limits[i], "> 0");
            }
        }
        Ok(())
    }
}

/// A swivel for every point of a path.
#[derive(Debug, Clone, PartialEq)]
pub struct SwivelPlan {
    /// `Converged`; `Infeasible` when it takes reconfigurations; `Unreachable` or `Limits` when some points have no
    /// configuration at all (then there are no rows).
    pub status: Status,
    /// Why it is not `Converged`: which points and what is in the way.
    pub reason: String,
    /// Joint positions, one row per point.
    pub q: Vec<[f64; 7]>,
    /// Swivel of each point, rad, continuous (unwound).
    pub swivel: Vec<f64>,
    /// Branch of each point.
    pub branch: Vec<usize>,
    /// Points before which the arm must change its configuration.
    pub reconfigurations: Vec<usize>,
    /// Why, for each of them.
    pub obstructions: Vec<String>,
    /// Points without any configuration within the limits and off the obstacles.
    pub blocked: Vec<usize>,
    /// Distance from the obstacles at each point, m; empty without a scene.
    pub clearance: Vec<f64>,
}

/// Plans the swivel along a path. When the path has times the joint velocity limits of the settings hold between
/// neighbouring points; otherwise a joint step of more than [`JOINT_JUMP`] counts as a jump.
///
/// `progress` is called with the share of the work done, in `[0, 1]`; returning `false` stops with `Cancelled`.
///
/// ```
/// use redundancy_core::{Pose, Status, chain::catalog, path::Path, self_motion::SrsArm};
/// use redundancy_core::planning::{SwivelPlanSettings, plan_swivel};
/// let arm = SrsArm::new(&catalog::load("pa10")?)?;
/// let poses: Vec<Pose> = (0..50).map(|k| Pose::translation(0.4, 0.01 * f64::from(k), 0.7)).collect();
/// let path = Path::new(&poses, None, None)?;
/// let plan = plan_swivel(&arm, &path, &SwivelPlanSettings::default(), &mut |_| true)?;
/// assert_eq!(plan.status, Status::Converged);
/// assert_eq!(plan.trajectory(arm.chain(), &path)?.rows(), 50);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A path of positions without orientations, invalid settings.
pub fn plan_swivel(
    arm: &SrsArm,
    path: &Path,
    settings: &SwivelPlanSettings,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<SwivelPlan> {
    let poses = path.poses();
    settings.validate(poses.len())?;
    if !path.has_orientation() {
        return Err(Error::Invalid(
            "the path has positions only; the arm needs an orientation for each point".into(),
        ));
    }
    let poses = if settings.cyclic { closed(poses)? } else { poses };
    let circles: Vec<SelfMotion> = poses.iter().map(|pose| arm.self_motion(pose)).collect::<Result<_>>()?;
    let problem = Problem::new(arm, path, settings, circles)?;
    if let Some(plan) = problem.blocked() {
        return Ok(plan);
    }
    let cancelled =
        || SwivelPlan { status: Status::Cancelled, reason: "stopped by the caller".into(), ..empty() };
    // On thinned points first: where neighbours are too near together, the grid's cells hide how cheap it is to move.
    let stride = poses.len().div_ceil(THIN_POINTS);
    if stride > 1 && !matches!(settings.choice, SwivelChoice::Fixed(_)) {
        let thin = problem.thinned(stride);
        let line = match thin.searched(&mut |share| progress(0.5 * share)) {
            None => return Ok(cancelled()),
            Some(line) => {
                line.filter(|line| line.q.len() == thin.circles.len() && line.reconfigurations.is_empty())
            }
        };
        let line = line.map(|line| thin.smooth(line)).and_then(|line| problem.spread(&line, stride));
        if let Some(line) = line {
            let line = problem.polish(line);
            progress(1.0);
            return Ok(problem.finish(line));
        }
    }
    let Some(line) = problem.searched(progress) else { return Ok(cancelled()) };
    let Some(line) = line else { return Ok(problem.never_closed()) };
    if line.q.len() < poses.len() || matches!(settings.choice, SwivelChoice::Fixed(_)) {
        return Ok(problem.finish(line));
    }
    let line = problem.polish(problem.smooth(line));
    progress(1.0);
    Ok(problem.finish(line))
}

impl SwivelPlan {
    /// The plan as a trajectory: with the times of the path, or timed by the velocity limits of `chain` ([`FREE_SPEED`]
    /// for joints without) where it has none. Reconfigurations are events.
    ///
    /// # Errors
    /// None for a plan of this path.
    pub fn trajectory(&self, chain: &Chain, path: &Path) -> Result<Trajectory> {
        let rows = self.q.len();
        let q = self.q.as_flattened().to_vec();
        let t = match path.t() {
            Some(t) => t[..rows].to_vec(),
            None => {
                let speed = |v: f64| if v.is_finite() { v } else { FREE_SPEED };
                let limits: Vec<f64> = chain.joints().iter().map(|j| speed(j.limits.velocity)).collect();
                times_within_limits(&q, &limits, TimingSettings::default())?
            }
        };
        let event = |(k, why): (&usize, &String)| Event {
            kind: EventKind::Reconfiguration,
            index: *k,
            t: t[*k],
            s: path.s()[*k],
            message: format!("the arm changes its configuration before point {k}{why}"),
        };
        let events = self.reconfigurations.iter().zip(&self.obstructions).map(event).collect();
        let names = chain.joints().iter().map(|j| j.name.clone()).collect();
        Trajectory::new(names, t, q, None, events)
    }
}

/// The poses of a closed path.
fn closed(poses: &[Pose]) -> Result<&[Pose]> {
    let (first, last) = (&poses[0], &poses[poses.len() - 1]);
    let distance = (last.translation.vector - first.translation.vector).norm();
    let angle = rotation_vector(&(last.rotation * first.rotation.inverse())).norm();
    if poses.len() < 3 || distance > CYCLE_POSITION || angle > CYCLE_ANGLE {
        return Err(Error::Invalid(format!(
            "cyclic asks for a path that ends where it begins; its ends are {distance:.3e} m and {angle:.3e} rad apart"
        )));
    }
    Ok(poses)
}

fn empty() -> SwivelPlan {
    SwivelPlan {
        status: Status::Converged,
        reason: String::new(),
        q: Vec::new(),
        swivel: Vec::new(),
        branch: Vec::new(),
        reconfigurations: Vec::new(),
        obstructions: Vec::new(),
        blocked: Vec::new(),
        clearance: Vec::new(),
    }
}

/// Solves a symmetric positive definite system with two lower diagonals, in place; pivots that vanish count as 1e-12.
fn solve_banded(band: &mut [[f64; 3]], x: &mut [f64]) {
    let n = x.len();
    // L D L^T, row by row.
    for k in 0..n {
        if k >= 2 {
            let l = band[k][2] / band[k - 2][0];
            band[k][1] -= l * band[k - 1][1] * band[k - 2][0];
            band[k][0] -= l * band[k][2];
            band[k][2] = l;
        }
        if k >= 1 {
            let l = band[k][1] / band[k - 1][0];
            band[k][0] -= l * band[k][1];
            band[k][1] = l;
        }
        band[k][0] = band[k][0].max(PIVOT_FLOOR);
    }
    for k in 0..n {
        if k >= 1 {
            x[k] -= band[k][1] * x[k - 1];
        }
        if k >= 2 {
            x[k] -= band[k][2] * x[k - 2];
        }
    }
    for k in (0..n).rev() {
        x[k] /= band[k][0];
        if k + 1 < n {
            x[k] -= band[k + 1][1] * x[k + 1];
        }
        if k + 2 < n {
            x[k] -= band[k + 2][2] * x[k + 2];
        }
    }
}

/// Least pivot of the refinement's system: its entries are of the order of the points' share of the costs.
const PIVOT_FLOOR: f64 = 1e-12;
/// The largest manipulability of an arm among seeded configurations within its limits.
fn best_manipulability(arm: &SrsArm, measure: &Manipulability) -> f64 {
    let chain = arm.chain();
    let mut scratch = Scratch::new(chain);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut best = f64::MIN_POSITIVE;
    for _ in 0..MANIPULABILITY_SAMPLES {
        let q: [f64; 7] = std::array::from_fn(|i| {
            let (lower, upper) = (chain.lower()[i].max(-TAU / 2.0), chain.upper()[i].min(TAU / 2.0));
            lower + (upper - lower) * rng.random::<f64>()
        });
        best = best.max(measure.value_at(&chain.kinematics_unchecked(&q, &mut scratch)));
    }
    best
}

/// Configurations from which the largest manipulability of an arm is estimated: within some percent.
const MANIPULABILITY_SAMPLES: usize = 2_000;
/// What is missing from the wanted clearance costs the weight when it is a tenth of it: enough that a fraction of a
/// millimetre is given away for everything else.
const CLEARANCE_STEEP: f64 = 100.0;
/// Points from which the grid is searched on every second, third ... point first.
const THIN_POINTS: usize = 240;
/// Most Newton steps of the refinement, and the relative decrease of the cost at which it stops.
const POLISH_STEPS: usize = 40;
const POLISH_GAIN: f64 = 1e-7;
/// Difference step (rad) of the cost of a point along the swivel.
const POLISH_DIFFERENCE: f64 = 1e-4;
/// Most states of the first point from which a closed line is tried.
const CLOSED_STARTS: usize = 12;
/// Dearer than any path: the fewest reconfigurations come first.
const RECONFIGURATION: f64 = 1e18;
/// Largest weight: a path then costs less than a reconfiguration (limit terms are capped at 1e6 each).
const MAX_WEIGHT: f64 = 1e6;
/// Largest value of the limit term of one joint: at the limit itself it would be infinite.
const LIMIT_CAP: f64 = 1e3;
/// Most passes in the tube around the chosen line while it still travels, and in all.
const TUBE_TRAVELS: usize = 40;
const TUBE_PASSES: usize = 60;
/// Spacing of the swivels in the tube (rad) at which the line is smooth enough.
const TUBE_SPACING: f64 = 5e-5;
/// Swivels across the tube, odd.
const TUBE_WIDTH: usize = 9;

/// One grid node: the principal values of a branch at a swivel, and which windings hold the limits.
#[derive(Debug, Clone, Copy)]
struct Node {
    q: [f64; 7],
    windings: u64,
    /// Cost of what the windings do not change.
    cost: f64,
}

/// Windings as one number: digit i is the turns added to joint i, less the least that its limits admit.
struct Windings {
    least: [i32; 7],
    count: [usize; 7],
    stride: [usize; 7],
    total: usize,
}

struct Problem<'a> {
    arm: &'a SrsArm,
    settings: &'a SwivelPlanSettings,
    circles: Vec<SelfMotion>,
    lower: [f64; 7],
    upper: [f64; 7],
    /// Part of the path between point k and k + 1.
    parts: Vec<f64>,
    /// Largest joint steps between point k and k + 1.
    steps: Vec<[f64; 7]>,
    windings: Windings,
    branches: Vec<usize>,
    obstacles: Option<Obstacles>,
    /// Where the manipulability counts: its measure, and the largest value seen.
    dexterity: Option<(Manipulability, f64)>,
    /// Numbers of the points on the path.
    points: Vec<usize>,
}

/// The obstacles along the path.
struct Obstacles {
    arm: ArmClearance,
    /// The scene at each point; one for all where nothing moves.
    scenes: Vec<Scene>,
    over: Vec<Option<OverPose>>,
}

impl Obstacles {
    fn scene(&self, k: usize) -> &Scene {
        &self.scenes[k.min(self.scenes.len() - 1)]
    }
}

/// A choice for every point.
struct Line {
    branch: Vec<usize>,
    swivel: Vec<f64>,
    q: Vec<[f64; 7]>,
    reconfigurations: Vec<usize>,
    cost: f64,
}

impl<'a> Problem<'a> {
    fn new(
        arm: &'a SrsArm,
        path: &Path,
        settings: &'a SwivelPlanSettings,
        circles: Vec<SelfMotion>,
    ) -> Result<Self> {
        let n = circles.len();
        let t = path.t();
        let obstacles = match settings.scene.as_ref().filter(|scene| !scene.obstacles().is_empty()) {
            None => None,
            Some(scene) => {
                let near = ArmClearance::new(arm, settings.link_radius)?;
                let scenes = match t.filter(|_| scene.moves()) {
                    Some(t) => t.iter().map(|t| scene.at(*t)).collect(),
                    None => vec![scene.clone()],
                };
                let mut obstacles = Obstacles { arm: near, scenes, over: Vec::new() };
                let over = |(k, pose): (usize, &Pose)| {
                    obstacles.arm.over(pose, obstacles.scene(k), settings.wanted_clearance)
                };
                obstacles.over = path.poses().iter().enumerate().map(over).collect();
                Some(obstacles)
            }
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
        let total = t.map_or((n - 1).max(1) as f64, |t| t[n - 1] - t[0]);
        let gaps = (1..n).map(|k| t.map_or(1.0, |t| t[k] - t[k - 1]));
        let parts = gaps.clone().map(|gap| gap / total).collect();
        let steps = gaps
            .map(|gap| match (&settings.velocity_limits, t) {
                (Some(v), Some(_)) => std::array::from_fn(|i| (v[i] * gap).min(JOINT_JUMP)),
                _ => [JOINT_JUMP; 7],
            })
            .collect();
        let windings = Windings::new(&lower, &upper);
        let branches = settings.branch.map_or((0..8).collect(), |b| vec![b]);
        Ok(Self {
            arm,
            settings,
            circles,
            lower,
            upper,
            parts,
            steps,
            windings,
            branches,
            obstacles,
            dexterity,
            points: (0..n).collect(),
        })
    }

    /// The plan that says so, when points have no configuration within the limits.
    fn blocked(&self) -> Option<SwivelPlan> {
        let blocked: Vec<usize> =
            (0..self.circles.len()).filter(|k| self.circles[*k].status() != Status::Converged).collect();
        let k = *blocked.first()?;
        let (count, n, motion) = (blocked.len(), self.circles.len(), &self.circles[k]);
        let verb = if count == 1 { "has" } else { "have" };
        let reason = motion.reason();
        let reason =
            format!("{count} of {n} points {verb} no configuration; the first is point {k}: {reason}");
        Some(SwivelPlan { status: motion.status(), reason, blocked, ..empty() })
    }

    /// Swivels of the grid at point `k`.
    fn grid(&self, k: usize) -> Vec<f64> {
        match &self.settings.choice {
            SwivelChoice::Fixed(s) => vec![if s.len() == 1 { s[0] } else { s[k] }],
            _ => {
                let m = self.settings.swivels;
                (0..m).map(|i| TAU * (i as f64 / m as f64 - 0.5)).collect()
            }
        }
    }

    /// Distance from the obstacles at point `k` of every branch at swivel `s`; infinite without a scene.
    fn distances(&self, k: usize, s: f64, q: &[[f64; 7]; 8], scratch: &mut Scratch) -> [f64; 8] {
        match &self.obstacles {
            None => [f64::INFINITY; 8],
            Some(o) => o.arm.of_branches(&self.circles[k], o.over[k].as_ref(), o.scene(k), s, q, scratch),
        }
    }

    /// Cost of being at a distance from the obstacles and at a manipulability; `None` in a collision.
    fn place_cost(&self, q: &[f64; 7], distance: f64, scratch: &mut Scratch) -> Option<f64> {
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

    fn node(&self, q: &[f64; 7], distance: f64, scratch: &mut Scratch) -> Node {
        let Some(cost) = self.place_cost(q, distance, scratch) else {
            return Node { q: *q, windings: 0, cost: 0.0 };
        };
        let mut windings = 0;
        for code in 0..self.windings.total {
            let turns = self.windings.turns(code);
            let holds = (0..7).all(|i| {
                let at = q[i] + TAU * turns[i];
                at >= self.lower[i] && at <= self.upper[i]
            });
            windings |= u64::from(holds) << code;
        }
        Node { q: *q, windings, cost }
    }

    /// All nodes of a point, branch after branch.
    fn nodes(&self, k: usize) -> Vec<Node> {
        let grid = self.grid(k);
        let dead = Node { q: [0.0; 7], windings: 0, cost: 0.0 };
        let mut nodes = vec![dead; self.branches.len() * grid.len()];
        let mut scratch = Scratch::new(self.arm.chain());
        for (j, s) in grid.iter().enumerate() {
            let all = self.circles[k].all_branches(*s);
            let distances = self.distances(k, *s, &all, &mut scratch);
            for (b, branch) in self.branches.iter().enumerate() {
                nodes[b * grid.len() + j] = self.node(&all[*branch], distances[*branch], &mut scratch);
            }
        }
        nodes
    }

    /// Cost of being at `q` with swivel `s` at point `k`, times the part of the path that belongs to the point; `place`
    /// is [`Problem::place_cost`].
    fn node_cost(&self, k: usize, q: &[f64; 7], s: f64, place: f64) -> f64 {
        let mut cost = place;
        for i in 0..7 {
            let half = 0.5 * (self.upper[i] - self.lower[i]);
            if half.is_finite() && half > 0.0 {
                let x = (q[i] - self.lower[i]) / half - 1.0;
                let nearness = (x * x / (1.0 - x * x).max(1e-9)).min(LIMIT_CAP);
                cost += self.settings.limit_weight * nearness * nearness;
            }
        }
        if let SwivelChoice::Near(wish) = &self.settings.choice {
            let wish = if wish.len() == 1 { wish[0] } else { wish[self.points[k]] };
            cost += self.settings.swivel_weight * (1.0 - (s - wish).cos());
        }
        let before = if k > 0 { self.parts[k - 1] } else { 0.0 };
        let after = self.parts.get(k).copied().unwrap_or(0.0);
        cost * (0.5 * (before + after)).max(f64::MIN_POSITIVE)
    }

    /// Cost of the joint step between points `k` and `k + 1`; `None` when it is too large.
    #[inline(always)]
    fn step_cost(&self, k: usize, a: &[f64; 7], b: &[f64; 7]) -> Option<f64> {
        let limits = &self.steps[k];
        let mut sum = 0.0;
        for i in 0..7 {
            let step = b[i] - a[i];
            if step.abs() > limits[i] {
                return None;
            }
            sum += step * step;
        }
        Some(self.settings.motion_weight * sum / self.parts[k])
    }

    /// Dynamic programming over the grid; with `tied`, from this state and back to it. `None` when the caller stops it.
    fn search(&self, tied: Option<usize>, progress: &mut dyn FnMut(f64) -> bool) -> Option<Line> {
        const BLOCK: usize = 64;
        let n = self.circles.len();
        let cells = self.grid(0).len();
        let (states, codes) = (self.branches.len() * cells, self.windings.total);
        // Cells that one step may cross: all of them would be exact, but a step has only so much time.
        let reach = if cells == 1 { 0 } else { (cells / 45 + 400 / n.max(10)).min(cells / 2) as isize };
        let mut previous: Vec<Node> = Vec::new();
        let mut cost = vec![f64::INFINITY; states * codes];
        // Where a state came from: source state * codes + code, or none at the start; and jumps.
        let mut came: Vec<Vec<u32>> = Vec::with_capacity(n);
        for start in (0..n).step_by(BLOCK) {
            let end = n.min(start + BLOCK);
            let block: Vec<Vec<Node>> = (start..end).into_par_iter().map(|k| self.nodes(k)).collect();
            for (k, nodes) in (start..end).zip(block) {
                let grid = self.grid(k);
                let mut next = vec![f64::INFINITY; states * codes];
                let mut from = vec![NONE; states * codes];
                // The cheapest end so far, for reconfigurations.
                let cheapest = (0..cost.len()).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0);
                let update = |(state, (next, from)): (usize, (&mut [f64], &mut [u32]))| {
                    let node = &nodes[state];
                    if node.windings == 0 {
                        return;
                    }
                    let (branch, cell) = (state / cells, state % cells);
                    if k > 0 {
                        for offset in -reach..=reach {
                            let other =
                                branch * cells + (cell as isize + offset).rem_euclid(cells as isize) as usize;
                            let source = &previous[other];
                            if source.windings != 0 {
                                self.relax(k - 1, (other, source), node, &cost, next, from);
                            }
                        }
                    }
                    for code in 0..codes {
                        if node.windings & (1 << code) == 0 {
                            continue;
                        }
                        let barred = |only: usize| state * codes + code != only;
                        if tied.is_some_and(|only| (k == 0 || k + 1 == n) && barred(only)) {
                            (next[code], from[code]) = (f64::INFINITY, NONE);
                            continue;
                        }
                        let jump = if k == 0 { 0.0 } else { cost[cheapest] + RECONFIGURATION };
                        if k == 0 || jump < next[code] {
                            (next[code], from[code]) =
                                (jump, if k == 0 { NONE } else { JUMP | cheapest as u32 });
                        }
                        let turns = self.windings.turns(code);
                        let q = std::array::from_fn(|i| node.q[i] + TAU * turns[i]);
                        next[code] += self.node_cost(k, &q, grid[cell], node.cost);
                    }
                };
                let rows = next.par_chunks_mut(codes).zip(from.par_chunks_mut(codes)).enumerate();
                rows.with_min_len(64).for_each(update);
                if next.iter().all(|c| !c.is_finite()) {
                    // No node at all at this point (a fixed swivel or branch): stop here, the rest cannot be reached.
                    return Some(self.backtrack(&came, &cost, k));
                }
                came.push(from);
                cost = next;
                previous = nodes;
            }
            if !progress(0.9 * end as f64 / n as f64) {
                return None;
            }
        }
        Some(self.backtrack(&came, &cost, n))
    }

    /// The cheapest of the closed lines from several states of the first point: from where the open line ends, and from
    /// the cheapest state of each connected piece. `None` inside when none of them closes.
    fn search_closed(&self, progress: &mut dyn FnMut(f64) -> bool) -> Option<Option<Line>> {
        let open = self.search(None, progress)?;
        if open.q.len() < self.circles.len() {
            return Some(Some(open));
        }
        let mut starts: Vec<usize> =
            [open.q.len() - 1, 0].iter().filter_map(|k| self.state_of(0, &open, *k)).collect();
        starts.extend(self.pieces());
        starts.dedup();
        let mut best: Option<Line> = None;
        for start in starts.into_iter().take(CLOSED_STARTS) {
            let line = self.search(Some(start), progress)?;
            let worse =
                |b: &Line| (line.reconfigurations.len(), line.cost) < (b.reconfigurations.len(), b.cost);
            let whole = line.q.len() == self.circles.len();
            if whole && best.as_ref().is_none_or(worse) {
                best = Some(line);
            }
            if best.as_ref().is_some_and(|line| line.reconfigurations.is_empty()) {
                break;
            }
        }
        Some(best)
    }

    /// The grid state of point `k` that is nearest to row `row` of a line.
    fn state_of(&self, k: usize, line: &Line, row: usize) -> Option<usize> {
        let cells = self.grid(k).len();
        let branch = self.branches.iter().position(|b| *b == line.branch[row])?;
        let nodes = self.nodes(k);
        let near = |(state, code): &(usize, usize)| -> f64 {
            let turns = self.windings.turns(*code);
            (0..7).map(|i| (nodes[*state].q[i] + TAU * turns[i] - line.q[row][i]).powi(2)).sum()
        };
        let alive = (branch * cells..(branch + 1) * cells).flat_map(|state| {
            let windings = nodes[state].windings;
            (0..self.windings.total)
                .filter(move |code| windings & (1 << code) != 0)
                .map(move |code| (state, code))
        });
        let (state, code) = alive.min_by(|a, b| near(a).total_cmp(&near(b)))?;
        Some(state * self.windings.total + code)
    }

    /// The cheapest state of each connected piece of the first point, cheapest first.
    fn pieces(&self) -> Vec<usize> {
        let (nodes, grid, codes) = (self.nodes(0), self.grid(0), self.windings.total);
        let cells = grid.len();
        let mut out: Vec<(f64, usize)> = Vec::new();
        for b in 0..self.branches.len() {
            for code in 0..codes {
                let alive = |cell: usize| nodes[b * cells + cell % cells].windings & (1 << code) != 0;
                let begin = (0..cells).find(|cell| !alive(*cell)).unwrap_or(0);
                let mut piece: Option<(f64, usize)> = None;
                for cell in begin..=begin + cells {
                    if cell < begin + cells && alive(cell) {
                        let (state, turns) = (b * cells + cell % cells, self.windings.turns(code));
                        let q = std::array::from_fn(|i| nodes[state].q[i] + TAU * turns[i]);
                        let cost = self.node_cost(0, &q, grid[cell % cells], nodes[state].cost);
                        if piece.is_none_or(|p| cost < p.0) {
                            piece = Some((cost, state * codes + code));
                        }
                    } else {
                        out.extend(piece.take());
                    }
                }
            }
        }
        out.sort_by(|a, b| a.0.total_cmp(&b.0));
        out.into_iter().map(|(_, state)| state).collect()
    }

    /// What to say when no line closes.
    fn never_closed(&self) -> SwivelPlan {
        SwivelPlan {
            status: Status::Infeasible,
            reason: "no line along the path ends in the configuration in which it began".into(),
            ..empty()
        }
    }

    /// The line on the grid, closed where it has to be. `None` when the caller stops it, `None` inside when no line closes.
    fn searched(&self, progress: &mut dyn FnMut(f64) -> bool) -> Option<Option<Line>> {
        if self.settings.cyclic {
            self.search_closed(progress)
        } else {
            self.search(None, progress).map(Some)
        }
    }

    /// The same problem on every `stride`-th point and the last one.
    fn thinned(&self, stride: usize) -> Self {
        let n = self.circles.len();
        let mut kept: Vec<usize> = (0..n).step_by(stride).collect();
        if kept.last() != Some(&(n - 1)) {
            kept.push(n - 1);
        }
        let parts = kept.windows(2).map(|w| self.parts[w[0]..w[1]].iter().sum()).collect();
        let steps = kept.windows(2).map(|w| {
            let sum = |i: usize| self.steps[w[0]..w[1]].iter().map(|step| step[i]).sum::<f64>();
            std::array::from_fn(|i| sum(i).min(JOINT_JUMP))
        });
        let obstacles = self.obstacles.as_ref().map(|o| Obstacles {
            arm: o.arm.clone(),
            scenes: if o.scenes.len() > 1 {
                kept.iter().map(|k| o.scenes[*k].clone()).collect()
            } else {
                o.scenes.clone()
            },
            over: kept.iter().map(|k| o.over[*k].clone()).collect(),
        });
        Self {
            arm: self.arm,
            settings: self.settings,
            circles: kept.iter().map(|k| self.circles[*k].clone()).collect(),
            lower: self.lower,
            upper: self.upper,
            parts,
            steps: steps.collect(),
            windings: Windings::new(&self.lower, &self.upper),
            branches: self.branches.clone(),
            obstacles,
            dexterity: self.dexterity.clone(),
            points: kept.iter().map(|k| self.points[*k]).collect(),
        }
    }

    /// A line on thinned points as one on all points, with the swivel linear in between; `None` where that breaks a limit
    /// or touches an obstacle.
    fn spread(&self, thin: &Line, stride: usize) -> Option<Line> {
        let n = self.circles.len();
        let (mut swivel, mut branch) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for k in 0..n {
            let (at, last) = (k / stride, (k / stride + 1).min(thin.swivel.len() - 1));
            let length = if (at + 1) * stride < n { stride } else { (n - 1 - at * stride).max(1) };
            let share = (k - at * stride) as f64 / length as f64;
            swivel.push(thin.swivel[at] + share * (thin.swivel[last] - thin.swivel[at]));
            branch.push(thin.branch[at]);
        }
        let q = self.along(&swivel, &branch, &thin.q[0])?;
        Some(Line { branch, swivel, q, reconfigurations: Vec::new(), cost: thin.cost })
    }

    /// The joint positions along swivels, unwound from `first` on; `None` where they break a limit, step too far or
    /// touch an obstacle.
    fn along(&self, swivel: &[f64], branch: &[usize], first: &[f64; 7]) -> Option<Vec<[f64; 7]>> {
        let all: Vec<Option<[f64; 7]>> = swivel
            .par_iter()
            .enumerate()
            .map_init(
                || Scratch::new(self.arm.chain()),
                |scratch, (k, s)| {
                    let q = self.circles[k].branch_of(*s, branch[k]);
                    (self.distance(k, *s, branch[k], &q, scratch) > 0.0).then_some(q)
                },
            )
            .collect();
        let mut before = *first;
        let mut rows = Vec::with_capacity(all.len());
        for (k, q) in all.into_iter().enumerate() {
            let q = q?;
            let q: [f64; 7] = std::array::from_fn(|i| q[i] + TAU * ((before[i] - q[i]) / TAU).round());
            let fits = (0..7).all(|i| {
                let step = k == 0 || (q[i] - before[i]).abs() <= self.steps[k - 1][i];
                step && q[i] >= self.lower[i] && q[i] <= self.upper[i]
            });
            if !fits {
                return None;
            }
            rows.push(q);
            before = q;
        }
        Some(rows)
    }

    /// Distance from the obstacles of one branch.
    fn distance(&self, k: usize, s: f64, branch: usize, q: &[f64; 7], scratch: &mut Scratch) -> f64 {
        let _ = branch;
        match &self.obstacles {
            None => f64::INFINITY,
            Some(o) => o.arm.of_one(&self.circles[k], o.over[k].as_ref(), o.scene(k), s, q, scratch),
        }
    }

    /// Cost of a point at a swivel; `None` where it breaks a limit or touches an obstacle.
    fn point_cost(
        &self,
        k: usize,
        s: f64,
        branch: usize,
        near: &[f64; 7],
        scratch: &mut Scratch,
    ) -> Option<f64> {
        let q = self.circles[k].branch_of(s, branch);
        let q: [f64; 7] = std::array::from_fn(|i| q[i] + TAU * ((near[i] - q[i]) / TAU).round());
        if !(0..7).all(|i| q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
            return None;
        }
        let place = self.place_cost(&q, self.distance(k, s, branch, &q, scratch), scratch)?;
        Some(self.node_cost(k, &q, s, place))
    }

    /// Total cost of a line.
    fn cost_of(&self, swivel: &[f64], branch: &[usize], q: &[[f64; 7]]) -> f64 {
        let init = || Scratch::new(self.arm.chain());
        let points: Vec<f64> = (0..q.len())
            .into_par_iter()
            .map_init(init, |scratch, k| {
                let place =
                    self.place_cost(&q[k], self.distance(k, swivel[k], branch[k], &q[k], scratch), scratch);
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

    /// Newton's method on all swivels at once: exact in the motion terms to first order of the curves, differences in
    /// the cost of points. Neighbours couple only, so a step is one banded system. The ends of a closed line stay.
    fn polish(&self, mut line: Line) -> Line {
        let n = line.q.len();
        if n < 2 || !line.reconfigurations.is_empty() {
            return line;
        }
        let ring = self.settings.cyclic;
        let trust = TAU / self.settings.swivels as f64;
        let (w, wa) = (self.settings.motion_weight, self.settings.acceleration_weight);
        let mut cost = self.cost_of(&line.swivel, &line.branch, &line.q);
        for _ in 0..POLISH_STEPS {
            let h = POLISH_DIFFERENCE;
            let init = || Scratch::new(self.arm.chain());
            let local: Vec<([f64; 7], f64, f64)> = (0..n)
                .into_par_iter()
                .map_init(init, |scratch, k| {
                    let (s, b, q) = (line.swivel[k], line.branch[k], &line.q[k]);
                    let rates = self.circles[k].tangent_of(s, b);
                    let [m, o, p] = [s - h, s, s + h].map(|s| self.point_cost(k, s, b, q, scratch));
                    let (slope, bend) = match (m, o, p) {
                        (Some(m), Some(o), Some(p)) => {
                            ((p - m) / (2.0 * h), ((p - 2.0 * o + m) / (h * h)).max(0.0))
                        }
                        (Some(m), Some(o), None) => ((o - m) / h, 0.0),
                        (None, Some(o), Some(p)) => ((p - o) / h, 0.0),
                        _ => (0.0, 0.0),
                    };
                    (rates, slope, bend)
                })
                .collect();
            // Lower half of the matrix by diagonals, and the right side.
            let mut band = vec![[0.0; 3]; n];
            let mut step = vec![0.0; n];
            for (k, (_, slope, bend)) in local.iter().enumerate() {
                band[k][0] += bend;
                step[k] -= slope;
            }
            let dot = |a: &[f64; 7], b: &[f64; 7]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            for k in 1..n {
                let c = 2.0 * w / self.parts[k - 1];
                let (a, b) = (&local[k - 1].0, &local[k].0);
                let d: [f64; 7] = std::array::from_fn(|i| line.q[k][i] - line.q[k - 1][i]);
                band[k - 1][0] += c * dot(a, a);
                band[k][0] += c * dot(b, b);
                band[k][1] -= c * dot(a, b);
                step[k] -= c * dot(b, &d);
                step[k - 1] += c * dot(a, &d);
            }
            if wa > 0.0 {
                for k in 1..n - 1 {
                    let (a, b) = (1.0 / self.parts[k - 1], 1.0 / self.parts[k]);
                    let c = 2.0 * wa / (0.5 * (self.parts[k - 1] + self.parts[k]));
                    let d: [f64; 7] = std::array::from_fn(|i| {
                        (line.q[k + 1][i] - line.q[k][i]) * b - (line.q[k][i] - line.q[k - 1][i]) * a
                    });
                    let factors = [a, -(a + b), b];
                    for i in 0..3 {
                        let left = &local[k - 1 + i].0;
                        step[k - 1 + i] -= c * factors[i] * dot(left, &d);
                        for j in 0..=i {
                            band[k - 1 + i][i - j] +=
                                c * factors[i] * factors[j] * dot(left, &local[k - 1 + j].0);
                        }
                    }
                }
            }
            if ring {
                for k in [0, n - 1] {
                    band[k] = [1.0, 0.0, 0.0];
                    step[k] = 0.0;
                }
                for (k, diagonal) in [(1, 1), (2, 2)] {
                    if k < n {
                        band[k][diagonal] = 0.0;
                    }
                }
            }
            solve_banded(&mut band, &mut step);
            let largest = step.iter().fold(0.0f64, |m, d| m.max(d.abs()));
            if largest.is_nan() || largest < TUBE_SPACING * 1e-3 {
                break;
            }
            let mut share = (trust / largest).min(1.0);
            let mut found = false;
            for _ in 0..8 {
                let swivel: Vec<f64> = line.swivel.iter().zip(&step).map(|(s, d)| s + share * d).collect();
                if let Some(q) = self.along(&swivel, &line.branch, &line.q[0]) {
                    let next = self.cost_of(&swivel, &line.branch, &q);
                    if next < cost {
                        found = cost - next > POLISH_GAIN * cost.abs();
                        (line.swivel, line.q, cost) = (swivel, q, next);
                        break;
                    }
                }
                share *= 0.35;
            }
            if !found {
                break;
            }
        }
        if ring {
            line.q[n - 1] = line.q[0];
        }
        line
    }

    /// Offers `node` at point `k + 1` all windings of `source` at point `k`.
    #[inline(always)]
    fn relax(
        &self,
        k: usize,
        (index, source): (usize, &Node),
        node: &Node,
        cost: &[f64],
        next: &mut [f64],
        from: &mut [u32],
    ) {
        let codes = self.windings.total;
        // The joints take the short way; principal values that wrap change the winding.
        let (mut target, mut shift) = (node.q, [0i32; 7]);
        let mut shifted = false;
        for i in 0..7 {
            let step = node.q[i] - source.q[i];
            if step.abs() > TAU / 2.0 {
                // node.q + TAU k = target + TAU (k + shift).
                shift[i] = if step > 0.0 { 1 } else { -1 };
                target[i] -= TAU * f64::from(shift[i]);
                shifted = true;
            }
        }
        let Some(step) = self.step_cost(k, &source.q, &target) else { return };
        let mut left = node.windings;
        while left != 0 {
            let code = left.trailing_zeros() as usize;
            left &= left - 1;
            let before = if shifted { self.windings.shifted(code, &shift) } else { Some(code) };
            let Some(before) = before.filter(|c| source.windings & (1 << c) != 0) else { continue };
            let total = cost[index * codes + before] + step;
            if total < next[code] {
                (next[code], from[code]) = (total, (index * codes + before) as u32);
            }
        }
    }

    /// The cheapest line through points `0..end`.
    fn backtrack(&self, came: &[Vec<u32>], cost: &[f64], end: usize) -> Line {
        let codes = self.windings.total;
        let mut line = Line {
            branch: Vec::new(),
            swivel: Vec::new(),
            q: Vec::new(),
            reconfigurations: Vec::new(),
            cost: f64::INFINITY,
        };
        if end == 0 {
            return line;
        }
        let mut at = (0..cost.len()).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0);
        line.cost = cost[at];
        if !line.cost.is_finite() {
            return line;
        }
        for k in (0..end).rev() {
            let grid = self.grid(k);
            let (state, code) = (at / codes, at % codes);
            let (branch, s) = (self.branches[state / grid.len()], grid[state % grid.len()]);
            let turns = self.windings.turns(code);
            let q = self.circles[k].all_branches(s)[branch];
            line.branch.push(branch);
            line.swivel.push(s);
            line.q.push(std::array::from_fn(|i| q[i] + TAU * turns[i]));
            let from = came[k][at];
            if from != NONE && from & JUMP != 0 {
                line.reconfigurations.push(k);
            }
            at = (from & !JUMP) as usize;
        }
        line.branch.reverse();
        line.swivel.reverse();
        line.q.reverse();
        line.reconfigurations.reverse();
        for k in 1..end {
            let step = line.swivel[k] - line.swivel[k - 1];
            line.swivel[k] -= TAU * (step / TAU).round();
        }
        line
    }

    /// Dynamic programming in a tube around the line, which shrinks. The ends of a closed line stay where they are; it is
    /// cut open elsewhere in every other pass.
    fn smooth(&self, mut line: Line) -> Line {
        let n = line.q.len();
        let ring = self.settings.cyclic && line.reconfigurations.is_empty();
        // A closed line has its first point again as its last.
        let points = if ring { n - 1 } else { n };
        let mut spacing = TAU / self.settings.swivels as f64 / 2.0;
        let fix = TUBE_WIDTH / 2;
        for pass in 0..TUBE_PASSES {
            let offset = |j: usize| spacing * (j as f64 - fix as f64);
            // Joint positions across the tube, unwound along the line; none where a limit is broken.
            let rows: Vec<[Option<([f64; 7], f64)>; TUBE_WIDTH]> = (0..points)
                .into_par_iter()
                .map_init(
                    || Scratch::new(self.arm.chain()),
                    |scratch, k| {
                        std::array::from_fn(|j| {
                            let s = line.swivel[k] + offset(j);
                            let all = self.circles[k].all_branches(s);
                            let branch = line.branch[k];
                            let q: [f64; 7] = std::array::from_fn(|i| {
                                let q = all[branch][i];
                                q + TAU * ((line.q[k][i] - q) / TAU).round()
                            });
                            if !(0..7).all(|i| q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
                                return None;
                            }
                            let distance = self.distances(k, s, &all, scratch)[branch];
                            let place = self.place_cost(&q, distance, scratch)?;
                            Some((q, self.node_cost(k, &q, s, place)))
                        })
                    },
                )
                .collect();
            let cut = if ring && pass % 2 == 1 { points / 2 } else { 0 };
            let order: Vec<usize> =
                if ring { (cut..=cut + points).map(|k| k % points).collect() } else { (0..n).collect() };
            let mut cost = [f64::INFINITY; TUBE_WIDTH];
            let mut came: Vec<[usize; TUBE_WIDTH]> = Vec::with_capacity(order.len());
            for (at, &k) in order.iter().enumerate() {
                let mut next = [f64::INFINITY; TUBE_WIDTH];
                let mut from = [0; TUBE_WIDTH];
                let cheapest = (0..TUBE_WIDTH).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0);
                let fresh = at == 0 || line.reconfigurations.binary_search(&k).is_ok();
                let tied = ring && (at == 0 || at + 1 == order.len());
                for j in 0..TUBE_WIDTH {
                    if tied && j != fix {
                        continue;
                    }
                    let Some((q, place)) = &rows[k][j] else { continue };
                    if fresh {
                        (next[j], from[j]) = (if at == 0 { 0.0 } else { cost[cheapest] }, cheapest);
                    } else {
                        let before = order[at - 1];
                        for i in 0..TUBE_WIDTH {
                            if let Some(step) =
                                rows[before][i].as_ref().and_then(|(p, _)| self.step_cost(before, p, q))
                            {
                                let total = cost[i] + step;
                                if total < next[j] {
                                    (next[j], from[j]) = (total, i);
                                }
                            }
                        }
                    }
                    next[j] += place;
                }
                came.push(from);
                cost = next;
            }
            let mut j = (0..TUBE_WIDTH).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0);
            if !cost[j].is_finite() {
                return line;
            }
            let mut edge = false;
            for (at, &k) in order.iter().enumerate().rev() {
                if let Some((q, _)) = rows[k][j] {
                    line.q[k] = q;
                    // The point at the cut comes twice, both times in the middle of the tube.
                    if !(ring && at + 1 == order.len()) {
                        line.swivel[k] += offset(j);
                    }
                    edge |= j == 0 || j == TUBE_WIDTH - 1;
                }
                j = came[at][j];
            }
            if ring {
                let turns = ((line.swivel[points] - line.swivel[0]) / TAU).round();
                line.swivel[points] = line.swivel[0] + TAU * turns;
                line.q[points] = line.q[0];
            }
            // The line wants to leave the tube: follow it before narrowing.
            spacing *= if edge && pass < TUBE_TRAVELS { 1.0 } else { 0.5 };
            if spacing < TUBE_SPACING {
                break;
            }
        }
        line
    }

    /// The line as a plan, with the reason where it is not whole.
    fn finish(&self, line: Line) -> SwivelPlan {
        let n = self.circles.len();
        if let Some(plan) = (line.q.len() < n).then(|| self.behind_obstacles()).flatten() {
            return plan;
        }
        let (status, reason) = if line.q.len() < n {
            let k = line.q.len();
            let what = match &self.settings.choice {
                SwivelChoice::Fixed(_) => "the given swivel",
                _ => "the given branch",
            };
            (
                Status::Limits,
                format!(
                    "{what} holds the joint limits only up to point {k} of {n}: {}",
                    self.nearest_miss(k)
                ),
            )
        } else if let Some(k) = line.reconfigurations.first() {
            let count = line.reconfigurations.len();
            let times =
                if count == 1 { "one reconfiguration".into() } else { format!("{count} reconfigurations") };
            let miss = self.step_reason(*k, &line);
            (
                Status::Infeasible,
                format!("no continuous solution: it takes {times}, the first before point {k}{miss}"),
            )
        } else {
            (Status::Converged, String::new())
        };
        let blocked = if line.q.len() < n { vec![line.q.len()] } else { Vec::new() };
        let clearance = self.clearance(&line);
        let obstructions = line.reconfigurations.iter().map(|k| self.step_reason(*k, &line)).collect();
        let Line { branch, swivel, q, reconfigurations, .. } = line;
        SwivelPlan { status, reason, q, swivel, branch, reconfigurations, obstructions, blocked, clearance }
    }

    /// Distance from the obstacles along a line.
    fn clearance(&self, line: &Line) -> Vec<f64> {
        let Some(o) = &self.obstacles else { return Vec::new() };
        let mut scratch = Scratch::new(self.arm.chain());
        line.q.iter().enumerate().map(|(k, q)| o.arm.at_q(q, o.scene(k), &mut scratch)).collect()
    }

    /// The plan that says so, when obstacles cover every configuration within the limits of some points.
    fn behind_obstacles(&self) -> Option<SwivelPlan> {
        let o = self.obstacles.as_ref()?;
        let n = self.circles.len();
        // The best configuration of each point within the limits.
        let best = |k: usize| -> Option<(f64, [f64; 7])> {
            let mut scratch = Scratch::new(self.arm.chain());
            let mut best: Option<(f64, [f64; 7])> = None;
            for s in self.grid(k) {
                let all = self.circles[k].all_branches(s);
                let distances = self.distances(k, s, &all, &mut scratch);
                for b in &self.branches {
                    let within = (0..self.windings.total).any(|code| {
                        let turns = self.windings.turns(code);
                        (0..7).all(|i| {
                            let at = all[*b][i] + TAU * turns[i];
                            at >= self.lower[i] && at <= self.upper[i]
                        })
                    });
                    if within && best.as_ref().is_none_or(|best| distances[*b] > best.0) {
                        best = Some((distances[*b], all[*b]));
                    }
                }
            }
            best
        };
        let blocked: Vec<(usize, [f64; 7])> = (0..n)
            .into_par_iter()
            .filter_map(|k| best(k).filter(|best| best.0 <= 0.0).map(|best| (k, best.1)))
            .collect();
        let (k, q) = blocked.first()?;
        let mut scratch = Scratch::new(self.arm.chain());
        let kinematics = self.arm.chain().kinematics_unchecked(q, &mut scratch);
        let pair = o.scene(*k).clearance_at(&o.arm.geometry, &kinematics)?;
        let (count, link) = (blocked.len(), &self.arm.chain().links()[pair.link].name);
        let verb = if count == 1 { "is" } else { "are" };
        let (depth, which) = (-1e3 * pair.distance, pair.obstacle);
        let word = o.scene(*k).obstacles()[which].shape.as_str();
        let reason = format!(
            "{count} of {n} points {verb} blocked by obstacles at every swivel; the first is point {k}: at best link \
             '{link}' is {depth:.3} mm deep in obstacle {which} ({word})"
        );
        let blocked = blocked.iter().map(|(k, _)| *k).collect();
        Some(SwivelPlan { status: Status::Unreachable, reason, blocked, ..empty() })
    }

    /// Which limits the branches break at the fixed swivel of point `k`, the least bad first.
    fn nearest_miss(&self, k: usize) -> String {
        let mut best = (f64::INFINITY, String::new());
        for s in self.grid(k) {
            let all = self.circles[k].all_branches(s);
            for b in &self.branches {
                let misses = (0..7).map(|i| {
                    let above = all[*b][i] + TAU * ((self.lower[i] - all[*b][i]) / TAU).ceil();
                    (above - self.upper[i]).max(0.0).min(self.lower[i] - above + TAU)
                });
                if let Some((i, miss)) = misses.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
                    && miss < best.0
                {
                    let name = &self.arm.chain().joints()[i].name;
                    best = (miss, format!("at best joint '{name}' is {miss:.6} rad outside its limits"));
                }
            }
        }
        best.1
    }

    /// What stands in the way of going on as before at a reconfiguration.
    fn step_reason(&self, k: usize, line: &Line) -> String {
        let all = self.circles[k].all_branches(line.swivel[k - 1]);
        let q = &all[line.branch[k - 1]];
        for i in 0..7 {
            let at = q[i] + TAU * ((line.q[k - 1][i] - q[i]) / TAU).round();
            let name = &self.arm.chain().joints()[i].name;
            if at < self.lower[i] || at > self.upper[i] {
                let (lower, upper) = (self.lower[i], self.upper[i]);
                return format!(" (joint '{name}' would leave [{lower:.6}, {upper:.6}] rad)");
            }
            let step = (at - line.q[k - 1][i]).abs();
            if step > self.steps[k - 1][i] {
                return format!(
                    " (joint '{name}' would have to step by {step:.6} rad, {:.6} may be)",
                    self.steps[k - 1][i]
                );
            }
        }
        let mut scratch = Scratch::new(self.arm.chain());
        let distance = self.distances(k, line.swivel[k - 1], &all, &mut scratch)[line.branch[k - 1]];
        if distance <= 0.0 {
            return format!(" (the arm would be {:.3} mm deep in an obstacle)", -1e3 * distance);
        }
        if self.obstacles.is_some() {
            return " (every way on ends at a joint limit or at an obstacle)".into();
        }
        " (every way on ends at a joint limit)".into()
    }
}

/// No predecessor.
const NONE: u32 = u32::MAX;
/// Flag of a predecessor that is left by a reconfiguration.
const JUMP: u32 = 1 << 31;

impl Windings {
    fn new(lower: &[f64; 7], upper: &[f64; 7]) -> Self {
        let (mut least, mut count, mut stride, mut total) = ([0; 7], [1; 7], [0; 7], 1usize);
        for i in 0..7 {
            // Principal values are in (-pi, pi]: turns k for which (-pi, pi] + k turns meets the range.
            let (a, b) = (lower[i].max(-2.0 * TAU), upper[i].min(2.0 * TAU));
            least[i] = ((a - TAU / 2.0) / TAU).ceil() as i32;
            let most = ((b + TAU / 2.0) / TAU).floor() as i32;
            count[i] = (most - least[i] + 1).clamp(1, 5) as usize;
            // A code must fit the bits of a node; further windings are not used then.
            if total * count[i] > 64 {
                count[i] = 1;
                least[i] = least[i].max(0).min(most);
            }
            stride[i] = total;
            total *= count[i];
        }
        Self { least, count, stride, total }
    }

    fn turns(&self, code: usize) -> [f64; 7] {
        std::array::from_fn(|i| f64::from(self.least[i] + (code / self.stride[i] % self.count[i]) as i32))
    }

    /// The code with `shift` more turns; `None` where a joint has no such winding.
    fn shifted(&self, code: usize, shift: &[i32; 7]) -> Option<usize> {
        let mut out = code;
        for i in 0..7 {
            let digit = (code / self.stride[i] % self.count[i]) as i32 + shift[i];
            if digit < 0 || digit >= self.count[i] as i32 {
                return None;
            }
            out = out.wrapping_add_signed(self.stride[i] as isize * shift[i] as isize);
        }
        Some(out)
    }
}
