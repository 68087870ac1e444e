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
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use nalgebra::{Const, SVector, Vector3};

use super::curve::Curve;
use super::motion::{Arm, Size, Workspace};
use super::search::{self, Bounds, Grid, Kind, State, rows_of};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::joint_space::{TURN, nearest, wrap};
use crate::parallel::prelude::*;
use crate::path::{BlockedPoint, Path, Plan, PlanBuilder, QuinticBasis, Trajectory};
use crate::pose::Pose;
use crate::solutions::{ClosedForm, closed_form, lines};
use crate::status::Status;
use crate::timing::SpeedSettings;
use crate::tolerance::JOINT_JUMP;
use crate::watch::{Deadline, Watch};

/// Largest step (m) of the grid on which a plan is verified and returned.
const VERIFIED_STEP: f64 = 4e-4;
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
/// Fewest intervals, for short paths.
const LEAST_INTERVALS: usize = 10;
/// Most intervals: beyond, a path is too long for one program.
const MOST_INTERVALS: usize = 400;
/// How far the tool may turn about its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpinRange {
    /// As far as it likes.
    Free,
    /// Up to this angle (rad) from the path's orientation; 0 is not at all.
    Within(f64),
}

/// Settings of [`plan_orientation`].
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationPlanSettings {
    /// Largest tilt, rad.
    pub half_angle: f64,
    /// Range of the spin.
    pub spin: SpinRange,
    /// Torque and velocity limits, gravity, and whether joint position limits hold.
    pub speed: SpeedSettings,
    /// Share of the torque limits that is kept free.
    pub torque_margin: f64,
    /// Largest rate of the tool's orientation at the plan's speed, rad/s; `None` is off.
    pub max_rate: Option<f64>,
    /// Seconds after which the best plan so far is returned.
    pub time_limit: f64,
}

impl OrientationPlanSettings {
    /// A cone of `half_angle` (rad), free spin, the torque and position limits of the chain, a minute.
    pub fn new(chain: &Chain, half_angle: f64) -> Self {
        Self {
            half_angle,
            spin: SpinRange::Free,
            speed: SpeedSettings::of(chain),
            torque_margin: 0.0,
            max_rate: None,
            time_limit: 60.0,
        }
    }

    /// Checks the settings against a chain of `n` joints.
    ///
    /// # Errors
    /// A number out of its range; the message names it and the bound.
    pub fn validate(&self, n: usize) -> Result<()> {
        let out = |what: &str, value: f64, bound: &str| {
            Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() })
        };
        self.speed.validate(n)?;
        if !(0.0..FRAC_PI_2).contains(&self.half_angle) {
            return out("half_angle", self.half_angle, "in [0, pi/2) rad");
        }
        if let SpinRange::Within(angle) = self.spin
            && !(angle >= 0.0 && angle.is_finite())
        {
            return out("spin", angle, "free, or a finite angle >= 0 rad");
        }
        if !(0.0..1.0).contains(&self.torque_margin) {
            return out("torque_margin", self.torque_margin, "in [0, 1)");
        }
        if let Some(rate) = self.max_rate
            && !(rate > 0.0 && rate.is_finite())
        {
            return out("max_rate", rate, "positive and finite, rad/s");
        }
        if !(self.time_limit > 0.0 && self.time_limit <= LONGEST) {
            return out("time_limit", self.time_limit, "in (0, 1e6] s");
        }
        Ok(())
    }
}

/// Longest time limit, s.
const LONGEST: f64 = 1e6;

/// What allows no higher speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeedBound {
    /// The torque limit of a joint.
    Torque(usize),
    /// The speed limit of a joint.
    Velocity(usize),
    /// The largest rate of the tool's orientation.
    Rate,
}

impl SpeedBound {
    /// The joint whose limit it is.
    pub fn joint(self) -> Option<usize> {
        match self {
            Self::Torque(joint) | Self::Velocity(joint) => Some(joint),
            Self::Rate => None,
        }
    }
}

/// Where the speed is bounded, and by what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bottleneck {
    /// The row.
    pub row: usize,
    /// What allows no more there.
    pub bound: SpeedBound,
}

/// Tilt and spin along a path with the constant speed that they allow.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationPlan {
    /// Rows at most 0.4 mm apart, at constant speed, with tilt, a rotation vector in the path's frame, and spin.
    /// `Converged`: every search came to its end. `TimeLimit`, `Cancelled`: the best so far. `Unreachable`, `Infeasible`:
    /// no rows.
    pub plan: Plan,
    /// Constant tool speed, m/s, verified at the rows; 0 without a plan.
    pub speed: f64,
    /// The same for the path's own orientation on the best branch, where it can be followed.
    pub constant_speed: Option<f64>,
    /// Joint torques at that speed, row by row, N m.
    pub torques: Vec<f64>,
    /// What allows no more; `None` without a plan.
    pub bottleneck: Option<Bottleneck>,
    /// Starts that could be followed.
    pub starts: usize,
    /// Convex programs solved.
    pub steps: usize,
}

impl From<OrientationPlan> for Plan {
    fn from(plan: OrientationPlan) -> Self {
        plan.plan
    }
}

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
        6 => Planner::<6, 3>::new(chain, path, settings, watch)?.run(),
        7 => Planner::<7, 4>::new(chain, path, settings, watch)?.run(),
        n => {
            Err(Error::Invalid(format!("'{}' has {n} joints: plans are made for six or seven", chain.name())))
        }
    }
}

/// A start or what became of it.
struct Candidate<const N: usize, const M: usize> {
    spare: Vec<SVector<f64, N>>,
    state: State<N, M>,
}

/// A plan evaluated on the finest grid.
struct Verified {
    /// One over the square of the speed.
    t: f64,
    s: Vec<f64>,
    q: Vec<f64>,
    qd: Vec<f64>,
    poses: Vec<Pose>,
    tilt: Vec<[f64; 2]>,
    spin: Vec<f64>,
    torques: Vec<f64>,
    bottleneck: Bottleneck,
}

struct Planner<'a, const N: usize, const M: usize> {
    chain: &'a Chain,
    form: Option<Arc<dyn ClosedForm>>,
    path: &'a Path,
    curve: Curve,
    settings: &'a OrientationPlanSettings,
    bounds: Bounds,
    watch: &'a Watch,
    deadline: Deadline,
    steps: AtomicUsize,
    /// Starts were left out for want of time.
    skipped: AtomicBool,
}

impl<'a, const N: usize, const M: usize> Planner<'a, N, M>
where
    Const<N>: Size,
{
    fn new(
        chain: &'a Chain,
        path: &'a Path,
        settings: &'a OrientationPlanSettings,
        watch: &'a Watch,
    ) -> Result<Self> {
        let none = vec![f64::INFINITY; N];
        let limits = settings.speed.torque_limits.clone().unwrap_or_else(|| none.clone());
        settings.speed.check_masses(chain)?;
        let (lower, upper) = if settings.speed.joint_limits {
            (chain.lower().to_vec(), chain.upper().to_vec())
        } else {
            (vec![f64::NEG_INFINITY; N], none.clone())
        };
        let bounds = Bounds {
            torque: limits.iter().map(|l| l * (1.0 - settings.torque_margin)).collect(),
            velocity: settings.speed.velocity_limits.clone().unwrap_or(none),
            lower,
            upper,
            tilt: settings.half_angle,
            spin: match settings.spin {
                SpinRange::Free => f64::INFINITY,
                SpinRange::Within(angle) => angle,
            },
            rate: settings.max_rate.unwrap_or(f64::INFINITY),
        };
        let curve = Curve::new(path);
        Ok(Self {
            chain,
            form: closed_form(chain),
            path,
            curve,
            settings,
            bounds,
            watch,
            deadline: Deadline::after(settings.time_limit),
            steps: AtomicUsize::new(0),
            skipped: AtomicBool::new(false),
        })
    }

    fn arm(&self, spare: &[SVector<f64, N>]) -> Arm<'a, N> {
        let bodies = self.chain.masses().ok();
        Arm { chain: self.chain, bodies, gravity: self.settings.speed.gravity, spare: spare.to_vec() }
    }

    /// True when the work up to `share` of the time must end.
    fn over(&self, share: f64) -> bool {
        self.watch.interrupted().is_some() || self.deadline.passed(share)
    }

    fn frozen(&self) -> [bool; 2] {
        [self.bounds.tilt == 0.0, self.bounds.spin == 0.0]
    }

    fn intervals(&self, per_metre: f64) -> usize {
        let wanted = (per_metre * self.path.length()).ceil() as usize;
        wanted.clamp(LEAST_INTERVALS, MOST_INTERVALS)
    }

    fn run(self) -> Result<OrientationPlan> {
        let mut grid = Grid::new(&self.curve, self.intervals(LEVELS[0].per_metre), LEVELS[0].samples);
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
                let finer = Grid::new(&self.curve, self.intervals(level.per_metre), level.samples);
                candidates.truncate(level.rounds.first().map_or(1, |round| round.0));
                let refined: Vec<Candidate<N, M>> =
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
            plan: plan.reason(reason).blocked(blocked).build()?,
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
        let error = crate::timing::fastest_line(self.chain, self.path.s(), poses, None, &speed).err()?;
        Some(error.to_string())
    }

    fn pose_at(&self, s: f64, u: [f64; 3]) -> Pose {
        let point = self.curve.at(s);
        let turned = point.turned([u, [0.0; 3], [0.0; 3]]);
        crate::pose::pose(*turned.rotation.matrix(), point.position[0])
    }

    fn plain_poses(&self, s: &[f64]) -> Vec<Pose> {
        s.iter().map(|s| self.pose_at(*s, [0.0; 3])).collect()
    }

    /// Speed of the path's own orientation on the fastest branch, under the same limits.
    fn constant_speed(&self) -> Option<f64> {
        let mut speed = self.settings.speed.clone();
        speed.torque_limits = speed.torque_limits.map(|_| self.bounds.torque.clone());
        let (low, high) = self.curve.ends();
        let count = self.path.len().max(200);
        let s: Vec<f64> = (0..count).map(|k| low + (high - low) * k as f64 / (count - 1) as f64).collect();
        crate::timing::fastest_line(self.chain, &s, &self.plain_poses(&s), None, &speed)
            .ok()
            .map(|found| found.speed)
    }

    /// Everything that can be followed, best first.
    fn starts(&self, grid: &Grid) -> Vec<Candidate<N, M>> {
        let (low, high) = self.curve.ends();
        let length = high - low;
        let sites = grid.basis.greville();
        let center =
            super::rule::Surface::around(&grid.points.iter().map(|p| p.position[0]).collect::<Vec<_>>());
        let mut shapes: Vec<(f64, Spin)> = Vec::new();
        let leans: &[f64] = if self.bounds.tilt == 0.0 { &[0.0] } else { &[0.0, 0.35, 0.75] };
        for lean in leans {
            match self.settings.spin {
                SpinRange::Within(_) => shapes.push((*lean, Spin::Turns { from: 0.0, turns: 0.0 })),
                SpinRange::Free => {
                    for turns in [0.0, 1.0, -1.0] {
                        let parts = if N == 6 { 8 } else { 4 };
                        for k in 0..parts {
                            let from = TURN * f64::from(k) / f64::from(parts);
                            shapes.push((*lean, Spin::Turns { from, turns }));
                        }
                        shapes.push((*lean, Spin::Pointing { turns }));
                    }
                }
            }
        }
        let shape = |lean: f64, spin: Spin, places: &[f64]| -> Vec<[f64; 3]> {
            let mut last = f64::NAN;
            places
                .iter()
                .map(|s| {
                    let point = self.curve.at(*s);
                    let p = point.position[0];
                    let z = point.rotation.column(2).into_owned();
                    let offset = Vector3::new(p.x - center.center[0], p.y - center.center[1], 0.0);
                    let most = center.radius.max(f64::MIN_POSITIVE);
                    let e = point.rotation.tr_mul(&z.cross(&offset)) * (lean * self.bounds.tilt / most);
                    let share = (s - low) / length;
                    let psi = match spin {
                        Spin::Turns { from, turns } => from + TURN * turns * share,
                        Spin::Pointing { turns } => {
                            let radial = point.rotation.tr_mul(&Vector3::new(-p.x, -p.y, 0.0));
                            let mut angle = radial.y.atan2(radial.x);
                            if last.is_finite() {
                                angle = nearest(angle, last);
                            }
                            last = angle;
                            angle + TURN * turns * share
                        }
                    };
                    [e.x, e.y, psi]
                })
                .collect()
        };
        let mut found: Vec<Candidate<N, M>> = shapes
            .par_iter()
            .enumerate()
            .flat_map_iter(|(i, (lean, spin))| {
                // The first one is the path's own orientation: it is always tried.
                if i > 0 && self.over(START_SHARE) {
                    self.skipped.store(true, Ordering::Relaxed);
                    return Vec::new();
                }
                let at_sites = shape(*lean, *spin, &sites);
                let values: Vec<Vector3<f64>> = at_sites.iter().map(|u| Vector3::from(*u)).collect();
                let three = grid.basis.interpolate(&sites, &values);
                let poses: Vec<Pose> = (0..grid.s.len())
                    .map(|k| {
                        let u = search::at(&grid.locals[k], &three);
                        let turned = grid.points[k].turned(u.map(|row| [row[0], row[1], row[2]]));
                        crate::pose::pose(*turned.rotation.matrix(), grid.points[k].position[0])
                    })
                    .collect();
                let mut work = Workspace::new(self.chain);
                lines::starts(self.chain, self.form.as_deref(), &poses[0])
                    .iter()
                    .filter_map(|start| self.start(grid, &three, &poses, start, &mut work))
                    .collect()
            })
            .collect();
        found.sort_by(|a, b| a.state.t.total_cmp(&b.state.t));
        found
    }

    fn start(
        &self,
        grid: &Grid,
        three: &[Vector3<f64>],
        poses: &[Pose],
        start: &[f64],
        work: &mut Workspace<N>,
    ) -> Option<Candidate<N, M>> {
        let mut line = lines::follow(self.chain, poses, start).ok()?;
        if self.settings.speed.joint_limits {
            lines::wind(self.chain, &mut line).ok()?;
        }
        let q: Vec<SVector<f64, N>> = line.chunks_exact(N).map(SVector::from_column_slice).collect();
        let spare = self.spare(&q);
        let extra: Vec<Vec<f64>> = spare.iter().map(|row| q.iter().map(|q| row.dot(q)).collect()).collect();
        let sites = grid.basis.greville();
        let extra: Vec<SVector<f64, M>> = sites
            .iter()
            .map(|s| {
                let mut value = SVector::<f64, M>::zeros();
                for (i, samples) in extra.iter().enumerate() {
                    value[3 + i] = interpolated(&grid.s, samples, *s);
                }
                value
            })
            .collect();
        let mut coefficients = grid.basis.interpolate(&sites, &extra);
        for (c, u) in coefficients.iter_mut().zip(three) {
            for i in 0..3 {
                c[i] = u[i];
            }
        }
        let state = State::new(&self.arm(&spare), grid, &self.bounds, coefficients, &q, work).ok()?;
        Some(Candidate { spare, state })
    }

    /// The null-space direction, averaged along the line, for an arm with a spare joint.
    fn spare(&self, q: &[SVector<f64, N>]) -> Vec<SVector<f64, N>> {
        if N <= 6 {
            return Vec::new();
        }
        let mut sum = SVector::<f64, N>::zeros();
        let mut last = SVector::<f64, N>::zeros();
        for q in q {
            let Ok(jacobian) = self.chain.jacobian(q.as_slice()) else { continue };
            let gram = jacobian.tr_mul(&jacobian);
            let eigen = gram.symmetric_eigen();
            let least = eigen.eigenvalues.imin();
            let mut direction = SVector::<f64, N>::from_fn(|i, _| eigen.eigenvectors[(i, least)]);
            if direction.dot(&last) < 0.0 {
                direction = -direction;
            }
            last = direction;
            sum += direction;
        }
        vec![sum.try_normalize(f64::MIN_POSITIVE).unwrap_or(last)]
    }

    /// Up to `steps` convex steps for each candidate, best first afterwards; true when every one came to its end.
    fn improve(&self, grid: &Grid, candidates: &mut [Candidate<N, M>], steps: usize, share: f64) -> bool {
        candidates.par_iter_mut().with_max_len(1).for_each(|candidate| {
            let arm = self.arm(&candidate.spare);
            let mut work = Workspace::new(self.chain);
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
    fn refine(&self, from: &Grid, to: &Grid, candidate: &Candidate<N, M>) -> Option<Candidate<N, M>> {
        let sites = to.basis.greville();
        let values: Vec<SVector<f64, M>> = sites
            .iter()
            .map(|s| SVector::from(search::at(&from.basis.at(*s), &candidate.state.coefficients)[0]))
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
        let mut work = Workspace::new(self.chain);
        let arm = self.arm(&spare);
        let mut state = State::new(&arm, to, &self.bounds, coefficients, &near, &mut work).ok()?;
        state.radius = candidate.state.radius.max(REFINED_RADIUS);
        Some(Candidate { spare, state })
    }

    fn keep_best(&self, basis: &QuinticBasis, candidates: &[Candidate<N, M>], best: &mut Option<Verified>) {
        for candidate in candidates {
            if let Some(found) = self.verify(basis, candidate)
                && best.as_ref().is_none_or(|b| found.t < b.t)
            {
                *best = Some(found);
            }
        }
    }

    /// Evaluates a candidate on the finest grid. A tilt that leaves the cone between samples is scaled back.
    fn verify(&self, basis: &QuinticBasis, candidate: &Candidate<N, M>) -> Option<Verified> {
        let mut coefficients = candidate.state.coefficients.clone();
        let (low, high) = self.curve.ends();
        let sampled = candidate.state.q.len() - 1;
        let count = (((high - low) / VERIFIED_STEP).ceil() as usize).max(FINER * sampled).min(MOST_ROWS);
        let s: Vec<f64> = (0..=count).map(|k| low + (high - low) * k as f64 / count as f64).collect();
        let locals: Vec<_> = s.iter().map(|s| basis.at(*s)).collect();
        let largest_tilt = |c: &[SVector<f64, M>]| {
            locals.iter().map(|l| search::at(l, c)[0]).map(|u| u[0].hypot(u[1])).fold(0.0, f64::max)
        };
        let most = largest_tilt(&coefficients);
        if most > self.bounds.tilt {
            let factor = self.bounds.tilt * (1.0 - CONE_ROUNDING) / most;
            for c in &mut coefficients {
                c[0] *= factor;
                c[1] *= factor;
            }
        }
        let arm = self.arm(&candidate.spare);
        let mut work = Workspace::new(self.chain);
        let mut q: Vec<f64> = Vec::with_capacity(s.len() * N);
        let (mut poses, mut tilt, mut spin) = (Vec::new(), Vec::new(), Vec::new());
        let (mut gravity, mut dynamic, mut rates) = (Vec::new(), Vec::new(), Vec::new());
        let mut near = candidate.state.q[0];
        let (mut t, mut limiting) = (0.0, (Kind::Rate, 0));
        for (k, local) in locals.iter().enumerate() {
            let u = search::at(local, &coefficients);
            let motion = arm.motion(&self.curve.at(s[k]), &u, &near, &mut work, None)?;
            let jumps = k > 0 && (0..N).any(|j| (motion.q[j] - q[(k - 1) * N + j]).abs() > JOINT_JUMP);
            let outside =
                (0..N).any(|j| motion.q[j] < self.bounds.lower[j] || motion.q[j] > self.bounds.upper[j]);
            if jumps || outside || u[0][2].abs() > self.bounds.spin {
                return None;
            }
            rows_of(&self.bounds, &motion, |kind, value| {
                if value > t {
                    (t, limiting) = (value, (kind, k));
                }
            })
            .ok()?;
            let step = if k < count { s[k + 1] - s[k] } else { 0.0 };
            near = motion.q + motion.d * step + motion.dd * (0.5 * step * step);
            q.extend_from_slice(motion.q.as_slice());
            rates.extend_from_slice(motion.d.as_slice());
            gravity.extend_from_slice(motion.gravity.as_slice());
            dynamic.extend_from_slice(motion.dynamic.as_slice());
            poses.push(motion.pose);
            tilt.push([u[0][0], u[0][1]]);
            spin.push(u[0][2]);
        }
        if !(t > 0.0 && t.is_finite()) {
            return None;
        }
        let speed = 1.0 / t.sqrt();
        let qd = rates.iter().map(|d: &f64| d * speed).collect();
        let torques = gravity.iter().zip(&dynamic).map(|(g, d): (&f64, &f64)| g + d / t).collect();
        let bound = match limiting.0 {
            Kind::Up(j) | Kind::Down(j) => SpeedBound::Torque(j),
            Kind::Velocity(j) => SpeedBound::Velocity(j),
            Kind::Rate => SpeedBound::Rate,
        };
        let bottleneck = Bottleneck { row: limiting.1, bound };
        Some(Verified { t, s, q, qd, poses, tilt, spin, torques, bottleneck })
    }
}

/// How a start spins.
#[derive(Debug, Clone, Copy)]
enum Spin {
    Turns { from: f64, turns: f64 },
    Pointing { turns: f64 },
}

/// Candidates of a level that are verified.
const KEPT: usize = 3;
/// Part of the time limit that the starts may take.
const START_SHARE: f64 = 0.2;
/// Radius with which a refined candidate goes on at least.
const REFINED_RADIUS: f64 = 0.05;
/// How many times finer than the samples the grid of the verification is at least.
const FINER: usize = 5;
/// Most rows of a plan.
const MOST_ROWS: usize = 1_000_000;
/// What rounding may add to a tilt at the rim of the cone, relative.
const CONE_ROUNDING: f64 = 1e-12;

/// Piecewise linear interpolation; `x` increases.
fn interpolated(x: &[f64], y: &[f64], at: f64) -> f64 {
    let i = x.partition_point(|x| *x <= at).clamp(1, x.len() - 1);
    let u = (at - x[i - 1]) / (x[i] - x[i - 1]);
    y[i - 1] * (1.0 - u) + y[i] * u
}
