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
//! Between its points the line is clear of obstacles too, when the joints go straight: see [`Problem::edge_is_clear`].
//!
//! Cost: linear in points and swivels; the circle of each point is computed once, for all branches.

use super::layers::srs::problem::Problem;
use super::layers::srs::search::Grid;
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::joint_space::TURN;
use crate::kinematics::rotation_vector;
use crate::parallel::prelude::*;
use crate::path::{Event, EventKind, Path, TimingSettings, Trajectory, times_within_limits};
use crate::pose::Pose;
use crate::scene::Scene;
use crate::solutions::{SelfMotion, SrsArm};
use crate::status::Status;
use crate::tolerance::{CYCLE_ANGLE, CYCLE_POSITION, FREE_SPEED};

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
            motion_weight: 0.5,
            swivel_weight: 1e4,
            velocity_limits: None,
            scene: None,
            link_radius: 0.05,
            wanted_clearance: 0.03,
            clearance_weight: 1e4,
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
/// neighbouring points; otherwise a joint step of more than [`JOINT_JUMP`](crate::tolerance::JOINT_JUMP) counts as a jump.
///
/// `progress` is called with the share of the work done, in `[0, 1]`; returning `false` stops with `Cancelled`.
///
/// ```
/// use redundancy_core::{Pose, Status, chain::catalog, path::Path, solutions::SrsArm};
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
    let circles: Vec<SelfMotion> =
        poses.par_iter().map(|pose| arm.self_motion(pose)).collect::<Result<_>>()?;
    let problem = Problem::new(arm, path, settings, circles)?;
    if let Some(plan) = problem.blocked() {
        return Ok(plan);
    }
    // What is done again is not reported again.
    let mut most = 0.0;
    let mut progress = |share: f64| {
        most = share.max(most);
        progress(most)
    };
    let cancelled =
        || SwivelPlan { status: Status::Cancelled, reason: "stopped by the caller".into(), ..empty() };
    let fixed = matches!(settings.choice, SwivelChoice::Fixed(_));
    let cells = if fixed { 1 } else { settings.swivels };
    let reach = |n: usize| STEP_REACH + PATH_REACH / n.max(10) as f64;
    // On thinned points first: where neighbours are too near together, the grid's cells hide how cheap it is to move.
    let stride = poses.len().div_ceil(THIN_POINTS);
    if stride > 1 && !fixed {
        let thin = problem.thinned(stride);
        let grid = Grid::new(&thin, cells, reach(thin.circles.len()));
        let Some(line) = grid.line(false, false, &mut |share| progress(0.5 * share)) else {
            return Ok(cancelled());
        };
        let line = line.map(|line| thin.smooth(line, false)).and_then(|line| problem.spread(&line, stride));
        if let Some(line) = line {
            let line = problem.polish(line);
            progress(1.0);
            return Ok(problem.finish(line));
        }
    }
    let grid = Grid::new(&problem, cells, reach(poses.len()));
    let Some(mut line) = grid.line(false, true, &mut progress) else { return Ok(cancelled()) };
    if line.is_none() {
        // Nothing continuous: look closer, and count the reconfigurations.
        let cells = if fixed { 1 } else { cells.max(LAST_SWIVELS) };
        let grid = Grid::new(&problem, cells, LAST_REACH);
        line = match grid.line(false, true, &mut progress) {
            None => return Ok(cancelled()),
            Some(None) => match grid.line(true, true, &mut progress) {
                None => return Ok(cancelled()),
                Some(line) => line,
            },
            Some(line) => line,
        };
    }
    let Some(line) = line else { return Ok(problem.never_closed()) };
    if line.q.len() < poses.len() || fixed {
        return Ok(problem.finish(line));
    }
    let line = problem.polish(problem.smooth(line, true));
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

pub(super) fn empty() -> SwivelPlan {
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

/// Points from which the grid is searched on every second, third ... point first.
const THIN_POINTS: usize = 240;
/// Largest weight: what a path costs stays well above the rounding of what its reconfigurations cost.
const MAX_WEIGHT: f64 = 1e6;
/// Cells of the circle at least when no continuous line was found on fewer, and how far a step may turn then, rad.
const LAST_SWIVELS: usize = 720;
const LAST_REACH: f64 = 1.3;
/// How far the swivel may turn in a step: this much (rad), and this much of the path's share.
const STEP_REACH: f64 = TURN / 45.0;
const PATH_REACH: f64 = 14.0;
