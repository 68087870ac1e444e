//! The swivel along a whole path.
//!
//! # SwivelProblem
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
//! 2. The chosen line is refined in a shrinking tube around itself, which removes the staircase left by the grid.
//!
//! Between its points the line is clear of obstacles too, when the joints go straight: see `SwivelProblem::edge_is_clear`.
//!
//! Cost: linear in points and swivels; the circle of each point is computed once, for all branches.

use super::layers::srs::explain::SwivelOutcome;
use super::layers::srs::grid::SwivelGrid;
use super::layers::srs::problem::SwivelProblem;
use super::layers::srs::settings::{SwivelChoice, SwivelPlanSettings};
use crate::error::{Error, Result};
use crate::joint_space::TURN;
use crate::kinematics::rotation_vector;
use crate::parallel::prelude::*;
use crate::path::{Path, Plan};
use crate::pose::Pose;
use crate::solutions::{SelfMotion, SrsArm};
use crate::tolerance::{CYCLE_ANGLE, CYCLE_POSITION};
use crate::watch::{Interrupted, Watch};

/// Plans the swivel along a path. When the path has times the joint velocity limits of the settings hold between
/// neighbouring points; otherwise a joint step of more than [`JOINT_JUMP`](crate::tolerance::JOINT_JUMP) counts as a jump.
///
/// The plan has one row per point, with the spare coordinate `swivel` (rad, unwound) and the branch as its piece,
/// `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`. `Converged`; `Infeasible` when it takes reconfigurations; `Unreachable`,
/// `Limits` or `Collision` when some points have no configuration (no rows), or none at the fixed swivel or branch (rows
/// up to there); `Cancelled` or `TimeLimit` without rows.
///
/// ```
/// use redundancy_core::{Pose, Status, Watch, chain::catalog, path::Path, solutions::SrsArm};
/// use redundancy_core::planning::{SwivelPlanSettings, plan_swivel};
/// let arm = SrsArm::new(&catalog::load("pa10")?)?;
/// let poses: Vec<Pose> = (0..50).map(|k| Pose::translation(0.4, 0.01 * f64::from(k), 0.7)).collect();
/// let path = Path::new(&poses, None, None)?;
/// let plan = plan_swivel(&arm, &path, &SwivelPlanSettings::default(), &Watch::default())?;
/// assert_eq!((plan.status(), plan.legal(), plan.rows()), (Status::Converged, Some(true), 50));
/// assert_eq!(plan.spare_named("swivel").map(<[_]>::len), Some(50));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A path of positions without orientations, invalid settings.
pub fn plan_swivel(arm: &SrsArm, path: &Path, settings: &SwivelPlanSettings, watch: &Watch) -> Result<Plan> {
    let poses = path.poses();
    settings.validate(poses.len())?;
    if !path.has_orientation() {
        return Err(Error::Invalid(
            "the path has positions only; the arm needs an orientation for each point".into(),
        ));
    }
    if settings.cyclic {
        check_closed(poses)?;
    }
    let circles: Vec<SelfMotion> =
        poses.par_iter().map(|pose| arm.self_motion(pose)).collect::<Result<_>>()?;
    let problem = SwivelProblem::new(arm, path, settings, circles)?;
    let outcome = match problem.blocked() {
        Some(blocked) => blocked,
        None => search(&problem, watch).unwrap_or_else(SwivelOutcome::interrupted),
    };
    outcome.into_plan(arm.chain(), path)
}

/// The line of least cost that is found, with its verdict.
fn search(problem: &SwivelProblem<'_>, watch: &Watch) -> std::result::Result<SwivelOutcome, Interrupted> {
    let (settings, points) = (problem.settings, problem.circles.len());
    let fixed = matches!(settings.choice, SwivelChoice::Fixed(_));
    let cells = if fixed { 1 } else { settings.swivels };
    let reach = |n: usize| STEP_REACH + PATH_REACH / n.max(10) as f64;
    // On thinned points first: where neighbours are too near together, the grid's cells hide how cheap it is to move.
    let stride = points.div_ceil(THIN_POINTS);
    if stride > 1 && !fixed {
        let thin = problem.thinned(stride);
        let grid = SwivelGrid::new(&thin, cells, reach(thin.circles.len()));
        let line = grid.line(false, false, watch.part(0.0, 0.5))?;
        let line = line.map(|line| thin.smooth(line, false)).and_then(|line| problem.spread(&line, stride));
        if let Some(line) = line {
            let line = problem.polish(line);
            // It is done, whatever the caller says now.
            let _ = watch.report(1.0);
            return Ok(problem.finish(line));
        }
    }
    let whole = watch.part(0.0, 1.0);
    let mut line = SwivelGrid::new(problem, cells, reach(points)).line(false, true, whole)?;
    if line.is_none() {
        // Nothing continuous: look closer, and count the reconfigurations.
        let cells = if fixed { 1 } else { cells.max(LAST_SWIVELS) };
        let grid = SwivelGrid::new(problem, cells, LAST_REACH);
        line = match grid.line(false, true, whole)? {
            None => grid.line(true, true, whole)?,
            found => found,
        };
    }
    let Some(line) = line else { return Ok(SwivelOutcome::never_closed()) };
    if line.q.len() < points || fixed {
        return Ok(problem.finish(line));
    }
    let line = problem.polish(problem.smooth(line, true));
    let _ = watch.report(1.0);
    Ok(problem.finish(line))
}

/// Checks that a path ends where it begins.
fn check_closed(poses: &[Pose]) -> Result<()> {
    let (first, last) = (&poses[0], &poses[poses.len() - 1]);
    let distance = (last.translation.vector - first.translation.vector).norm();
    let angle = rotation_vector(&(last.rotation * first.rotation.inverse())).norm();
    if poses.len() < 3 || distance > CYCLE_POSITION || angle > CYCLE_ANGLE {
        return Err(Error::Invalid(format!(
            "cyclic asks for a path that ends where it begins; its ends are {distance:.3e} m and {angle:.3e} rad apart"
        )));
    }
    Ok(())
}

/// Points from which the grid is searched on every second, third ... point first.
const THIN_POINTS: usize = 240;
/// Cells of the circle at least when no continuous line was found on fewer, and how far a step may turn then, rad.
const LAST_SWIVELS: usize = 720;
const LAST_REACH: f64 = 1.3;
/// How far the swivel may turn in a step: this much (rad), and this much of the path's share.
const STEP_REACH: f64 = TURN / 45.0;
const PATH_REACH: f64 = 14.0;
