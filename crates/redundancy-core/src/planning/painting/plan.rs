//! The tool's orientation along a whole path, for the highest constant speed.
//!
//! # Problem
//! The tool may lean within a cone around the path's own axis and spin about itself. Wanted are tilt and spin as functions of arc
//! length for which the largest constant speed under the limits of all joints is highest: minimise `t = 1/v^2` subject to
//! `t >= +-D / ((1 - m) L -+ G)`, `t >= (q' / qd_max)^2`, `t >= |omega|^2 / rate^2` at every point ([`speed`](super::max_speed) has the
//! derivation), the cone, the spin's and the joints' ranges. The rules of [FromGravdahl2007] and [FromGravdahl2009] see one point at a
//! time; torque depends on curvature in joint space, so what pays is to bend the wrist's path around corners, which no rule
//! of position can know.
//!
//! # Method
//! 1. Tilt and spin are quintic splines; joint positions and their two derivatives follow exactly (`motion.rs`).
//! 2. From each of many starts (branches of the arm x spin angles and turns x leans) a sequence of convex programs within a trust
//!    region (`program.rs`), coarse first. The better half goes on at each round; the last ones get a finer spline and more samples.
//! 3. What is returned was evaluated anew on a grid at least five times finer; its speed is the one of that grid.
//!
//! The problem is not convex: the plan is a local optimum, and a lower bound of what is possible. Starts decide.
//!
//! References: [FromGravdahl2007], [FromGravdahl2009].

use std::f64::consts::FRAC_PI_2;
use std::sync::atomic::Ordering;

use nalgebra::{Const, SVector};

use super::convex::{SplinePlan, SplineSamples, spline_at};
use super::motion::Size;
use super::planner::{OrientationPlanner, PlanCandidate, Verified};
use super::result::OrientationPlan;
use super::settings::OrientationPlanSettings;
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::joint_space::{TURN, wrap};
use crate::parallel::prelude::*;
use crate::path::{BlockedPoint, Path, PlanBuilder, Trajectory};
use crate::pose::Pose;
use crate::solutions::lines;
use crate::status::Status;
use crate::watch::Watch;

/// One resolution of the search: spline intervals per metre, samples per interval, and rounds of so many candidates that get
/// so many convex steps.
struct Level {
    per_metre: f64,
    samples: usize,
    rounds: &'static [(usize, usize)],
    /// Part of the time limit after which it ends.
    share: f64,
}

/// From many starts on a coarse spline to a few plans on a fine one.
const LEVELS: [Level; 4] = [
    Level { per_metre: 12.0, samples: 4, rounds: &[(240, 2), (100, 4), (48, 8), (24, 12)], share: 0.3 },
    Level { per_metre: 22.0, samples: 5, rounds: &[(12, 10), (6, 20)], share: 0.6 },
    Level { per_metre: 36.0, samples: 8, rounds: &[(3, 12), (2, 150)], share: 0.85 },
    Level { per_metre: 52.0, samples: 8, rounds: &[(2, 400)], share: 0.97 },
];
/// Candidates of a level that are verified.
const KEPT: usize = 3;
/// Radius with which a refined candidate goes on at least.
const REFINED_RADIUS: f64 = 0.05;
/// Fewest intervals, for short paths.
const LEAST_INTERVALS: usize = 10;
/// Most intervals: beyond, a path is too long for one program.
const MOST_INTERVALS: usize = 400;
/// Plans tilt and spin along a path for the highest constant tool speed.
///
/// The cone stands on the orientations of the path; a path of positions has the tool down ([`tool_down`](super::tool_down)). Between its
/// samples the path is a quintic spline, or its analytic shape. Runs on the current pool. The result depends on the number of
/// threads and the machine only through what the time limit cuts off.
///
/// ```
/// use redundancy_core::{Pose, Watch, chain::catalog, nalgebra::Vector3, path::Path};
/// use redundancy_core::planning::{OrientationPlanSettings, plan_orientation};
/// let arm = catalog::load("puma560")?.with_tool(Pose::translation(0.0, 0.0, 0.4))?;
/// let arc: Vec<_> = (0..40).map(|k| 0.05 * f64::from(k)).map(|a| Vector3::new(0.5 + 0.1 * a.cos(), 0.1 * a.sin(), -0.3)).collect();
/// let path = Path::from_positions(&arc, None, None)?;
/// let settings = OrientationPlanSettings { time_limit: 0.5, ..OrientationPlanSettings::new(&arm, 0.2) };
/// let plan = plan_orientation(&arm, &path, &settings, &Watch::default())?;
/// assert!(plan.speed >= plan.constant_speed.unwrap_or(0.0));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Invalid settings, an arm of fewer than six or more than seven joints, torque limits without inertias, a path without length.
pub fn plan_orientation(
    chain: &Chain,
    path: &Path,
    settings: &OrientationPlanSettings,
    watch: &Watch,
) -> Result<OrientationPlan> {
    settings.validate(chain.dof())?;
    if path.length() <= 0.0 {
        return Err(Error::Invalid("the path has no length".into()));
    }
    match chain.dof() {
        6 => OrientationPlanner::<6, 3>::new(chain, path, settings, watch)?.run(),
        7 => OrientationPlanner::<7, 4>::new(chain, path, settings, watch)?.run(),
        n => {
            Err(Error::Invalid(format!("'{}' has {n} joints: plans are made for six or seven", chain.name())))
        }
    }
}

impl<'a, const N: usize, const M: usize> OrientationPlanner<'a, N, M>
where
    Const<N>: Size,
{
    fn intervals(&self, per_metre: f64) -> usize {
        let wanted = (per_metre * self.path.length()).ceil() as usize;
        wanted.clamp(LEAST_INTERVALS, MOST_INTERVALS)
    }

    fn run(self) -> Result<OrientationPlan> {
        let mut grid =
            SplineSamples::new(&self.curve, self.intervals(LEVELS[0].per_metre), LEVELS[0].samples);
        let mut candidates = self.starts(&grid);
        let starts = candidates.len();
        if candidates.is_empty() {
            return self.nothing();
        }
        let mut best: Option<Verified> = None;
        self.keep_best(&grid.basis, &candidates[..1], &mut best);
        let mut finished = true;
        for (i, level) in LEVELS.iter().enumerate() {
            if i > 0 {
                let finer = SplineSamples::new(&self.curve, self.intervals(level.per_metre), level.samples);
                candidates.truncate(level.rounds.first().map_or(1, |round| round.0));
                let refined: Vec<PlanCandidate<N, M>> =
                    candidates.par_iter().filter_map(|c| self.refine(&grid, &finer, c)).collect();
                // A plan that is none on the finer grid was none before.
                if refined.is_empty() {
                    break;
                }
                (grid, candidates) = (finer, refined);
            }
            for (count, steps) in level.rounds {
                candidates.truncate(*count);
                finished = self.improve(&grid, &mut candidates, *steps, level.share);
            }
            let kept = candidates.len().min(KEPT);
            self.keep_best(&grid.basis, &candidates[..kept], &mut best);
        }
        let constant_speed = self.constant_speed();
        // Whatever the caller says now, it is done.
        let interrupted = self.watch.report(1.0).err();
        let Some(best) = best else { return self.nothing() };
        let (status, reason) = match interrupted {
            Some(why) => (why.status(), format!("{why}; this is the best plan so far")),
            None if finished => (Status::Converged, String::new()),
            None => {
                let limit = self.settings.time_limit;
                let reason =
                    format!("the time limit of {limit} s ended the search; this is the best plan so far");
                (Status::TimeLimit, reason)
            }
        };
        let speed = 1.0 / best.t.sqrt();
        let first = best.s.first().copied().unwrap_or(0.0);
        let t = best.s.iter().map(|s| (s - first) / speed).collect();
        let trajectory = Trajectory::new(self.joint_names(), t, best.q, Some(best.qd), Vec::new())?;
        let plan = PlanBuilder::new(trajectory, status)
            .reason(reason)
            .legal(true)
            .proven(status == Status::Converged)
            .s(best.s)
            .poses(best.poses)
            .tilt(best.tilt)
            .spin(best.spin)
            .margin_of(self.chain)?
            .build()?;
        let (torques, bottleneck) = (best.torques, Some(best.bottleneck));
        let steps = self.steps.load(Ordering::Relaxed);
        Ok(OrientationPlan { plan, speed, constant_speed, torques, bottleneck, starts, steps })
    }

    fn joint_names(&self) -> Vec<String> {
        self.chain.joints().iter().map(|joint| joint.name.clone()).collect()
    }

    fn none(&self, status: Status, reason: String, blocked: Vec<BlockedPoint>) -> Result<OrientationPlan> {
        let (plan, none) = (PlanBuilder::without_rows(self.joint_names(), status)?, Vec::new);
        let plan = plan.s(none()).poses(Vec::new()).tilt(Vec::new()).spin(none()).margin(none());
        Ok(OrientationPlan {
            plan: plan.reason(reason).asking_about_units(self.chain, self.path).blocked(blocked).build()?,
            speed: 0.0,
            constant_speed: None,
            torques: Vec::new(),
            bottleneck: None,
            starts: 0,
            steps: 0,
        })
    }

    /// Why there is no plan at all.
    fn nothing(&self) -> Result<OrientationPlan> {
        if let Some(why) = self.watch.interrupted() {
            return self.none(why.status(), format!("{why} before the first plan"), Vec::new());
        }
        if self.skipped.load(Ordering::Relaxed) {
            let limit = self.settings.time_limit;
            let reason =
                format!("the time limit of {limit} s was over before a start was found that can be followed");
            return self.none(Status::TimeLimit, reason, Vec::new());
        }
        // Points that are out of reach with every orientation of a sparse set in the cone.
        let poses = self.plain_poses(self.path.s());
        let mut blocked = lines::unreachable(self.chain, self.form.as_deref(), &poses);
        for tilt in [0.5, 1.0] {
            for k in 0..8 {
                if blocked.is_empty() {
                    break;
                }
                let a = TURN * f64::from(k) / 8.0;
                let e = [self.bounds.tilt * tilt * a.cos(), self.bounds.tilt * tilt * a.sin()];
                for spin in 0..4 {
                    let psi = FRAC_PI_2 * f64::from(spin);
                    if wrap(psi).abs() > self.bounds.spin {
                        continue;
                    }
                    let left: Vec<Pose> =
                        blocked.iter().map(|k| self.pose_at(self.path.s()[*k], [e[0], e[1], psi])).collect();
                    let still = lines::unreachable(self.chain, self.form.as_deref(), &left);
                    blocked = still.into_iter().map(|i| blocked[i]).collect();
                }
            }
        }
        if let (Some(first), Some(last)) = (blocked.first(), blocked.last()) {
            let (count, total) = (blocked.len(), self.path.len());
            let reason = format!(
                "{count} of {total} points are out of the workspace, the first is {first}, the last {last}"
            );
            let why = "out of the workspace with every orientation that was tried";
            let point = |row| BlockedPoint { row, status: Status::Unreachable, reason: why.into() };
            return self.none(Status::Unreachable, reason, blocked.into_iter().map(point).collect());
        }
        if let Some(reason) = self.too_heavy(&poses) {
            return self.none(Status::Infeasible, reason, Vec::new());
        }
        let what =
            if self.settings.speed.joint_limits { "the joint limits along the path" } else { "the path" };
        let reason = format!(
            "no start holds {what} within {:.4} rad of the path's tool axis: every branch jumps, meets a singular configuration or \
             leaves a limit",
            self.bounds.tilt
        );
        self.none(Status::Infeasible, reason, Vec::new())
    }

    /// Names joint and point where gravity alone takes the torque away on every branch.
    fn too_heavy(&self, poses: &[Pose]) -> Option<String> {
        let mut speed = self.settings.speed.clone();
        speed.torque_limits = Some(self.bounds.torque.clone());
        speed.joint_limits = false;
        let error =
            crate::timing::max_speed_of_poses(self.chain, self.path.s(), poses, None, &speed).err()?;
        Some(error.to_string())
    }

    /// Speed of the path's own orientation on the fastest branch, under the same limits.
    fn constant_speed(&self) -> Option<f64> {
        let mut speed = self.settings.speed.clone();
        speed.torque_limits = speed.torque_limits.map(|_| self.bounds.torque.clone());
        let (low, high) = self.curve.ends();
        let count = self.path.len().max(200);
        let s: Vec<f64> = (0..count).map(|k| low + (high - low) * k as f64 / (count - 1) as f64).collect();
        crate::timing::max_speed_of_poses(self.chain, &s, &self.plain_poses(&s), None, &speed)
            .ok()
            .map(|found| found.speed)
    }

    /// Up to `steps` convex steps for each candidate, best first afterwards; true when every one came to its end.
    fn improve(
        &self,
        grid: &SplineSamples,
        candidates: &mut [PlanCandidate<N, M>],
        steps: usize,
        share: f64,
    ) -> bool {
        candidates.par_iter_mut().with_max_len(1).for_each(|candidate| {
            let arm = self.arm(&candidate.spare);
            let mut work = self.workspace.clone();
            for _ in 0..steps {
                if self.over(share) {
                    break;
                }
                self.steps.fetch_add(1, Ordering::Relaxed);
                let more = candidate.state.step(&arm, grid, &self.bounds, self.frozen(), &mut work);
                self.watch.report_speed(1.0 / candidate.state.t.sqrt());
                // Whether to go on is asked before the next step.
                let _ = self.watch.report(self.deadline.share());
                if !more {
                    break;
                }
            }
        });
        candidates.sort_by(|a, b| a.state.t.total_cmp(&b.state.t));
        candidates.iter().all(|c| c.state.done)
    }

    /// The same functions on another basis.
    fn refine(
        &self,
        from: &SplineSamples,
        to: &SplineSamples,
        candidate: &PlanCandidate<N, M>,
    ) -> Option<PlanCandidate<N, M>> {
        let sites = to.basis.greville();
        let values: Vec<SVector<f64, M>> = sites
            .iter()
            .map(|s| SVector::from(spline_at(&from.basis.at(*s), &candidate.state.coefficients)[0]))
            .collect();
        let coefficients = to.basis.interpolate(&sites, &values);
        let near: Vec<SVector<f64, N>> =
            to.s.iter()
                .map(|s| {
                    let i = from.s.partition_point(|x| x <= s).clamp(1, from.s.len() - 1);
                    let u = (s - from.s[i - 1]) / (from.s[i] - from.s[i - 1]);
                    candidate.state.q[i - 1] * (1.0 - u) + candidate.state.q[i] * u
                })
                .collect();
        let spare = candidate.spare.clone();
        let mut work = self.workspace.clone();
        let arm = self.arm(&spare);
        let mut state = SplinePlan::new(&arm, to, &self.bounds, coefficients, &near, &mut work).ok()?;
        state.radius = candidate.state.radius.max(REFINED_RADIUS);
        Some(PlanCandidate { spare, state })
    }
}
