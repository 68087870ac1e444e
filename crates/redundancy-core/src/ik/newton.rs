//! Levenberg-Marquardt with joint limits, in the coordinates of the task.
//!
//! One step solves `(J W J^T + mu I) y = e`, `dq = W J^T y`, a system of six unknowns whatever the number of joints, where
//! W leaves out joints that stand at a limit and would go beyond it. Joints that a step takes to a limit stop there, and
//! what they do not do is asked of the others, at most [`ROUNDS`] times. The damping `mu` is proportional to the cost
//! `|e|^2 / 2` [Sugihara2011]: far away it is the gradient that decides, near the target convergence is quadratic.
//!
//! A second solve with the same factors makes the step one of third order: `dq` is corrected by
//! `-J^+ a(dq) / 2` with the acceleration `a = (d^2/dt^2) x(q + t dq)`, which costs one pass over the joints
//! (geodesic acceleration, [TranstrumSethna2012]).

use super::goal::Goal;
use crate::chain::Chain;
use crate::kinematics::{Kinematics, Scratch, factor, normal_matrix, solve};
use crate::tolerance::{IK_DAMPING, IK_DAMPING_FLOOR, IK_STALL, IK_STATIONARY, IK_STEP};
use nalgebra::Vector3;

/// How often the joints that a step takes to their limits are stopped and the others asked again.
const ROUNDS: usize = 3;
/// Steps that are taken back in a row before a point counts as stationary: each is damped ten times as much.
const REFUSED: usize = 12;
/// Steps over which progress is judged.
const WINDOW: usize = 4;

/// What one run needs, allocated once.
#[derive(Debug, Clone)]
pub(super) struct Workspace {
    pub scratch: Scratch,
    /// Columns of the weighted task Jacobian.
    pub columns: Vec<[f64; 6]>,
    /// The Jacobian of tasks with fewer coordinates, before it is spread over columns.
    pub rows: Vec<f64>,
    step: Vec<f64>,
    held: Vec<bool>,
    previous: Vec<f64>,
}

impl Workspace {
    pub fn new(chain: &Chain) -> Self {
        let n = chain.dof();
        Self {
            scratch: Scratch::new(chain),
            columns: vec![[0.0; 6]; n],
            rows: vec![0.0; 6 * n],
            step: vec![0.0; n],
            held: vec![false; n],
            previous: vec![0.0; n],
        }
    }
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RunEnd {
    /// Within the tolerances.
    Converged,
    /// No further progress.
    Stalled,
    /// Out of iterations.
    Capped,
}

/// Result of one run; the errors belong to the `q` that it leaves behind.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewtonRun {
    pub end: RunEnd,
    pub iterations: usize,
    pub position: f64,
    pub orientation: f64,
    /// Half the squared weighted error.
    pub cost: f64,
}

/// The arm and how well it is to be solved.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewtonProblem<'a> {
    pub chain: &'a Chain,
    pub lower: &'a [f64],
    pub upper: &'a [f64],
    pub tol_position: f64,
    pub tol_orientation: f64,
}

impl NewtonProblem<'_> {
    /// Improves `q`, which must be within the limits, until it meets the goal, stops improving, or `cap` steps are done.
    ///
    /// With `patient` it gives up only where no step improves the cost by a relative [`IK_STATIONARY`], otherwise already where the
    /// cost has not fallen by half in four steps: other starts are cheaper than slow convergence.
    pub fn run(
        &self,
        goal: &Goal,
        q: &mut [f64],
        memory: &mut Workspace,
        cap: usize,
        patient: bool,
    ) -> NewtonRun {
        let Workspace { scratch, columns, rows, step, held, previous } = memory;
        let mut history = [f64::INFINITY; WINDOW];
        let (mut boost, mut last, mut refused) = (1.0, f64::INFINITY, 0);
        let stall = if patient { 1.0 - IK_STATIONARY } else { IK_STALL };
        let (mut iterations, mut accepted) = (0, 0);
        loop {
            let kinematics = self.chain.kinematics_unchecked(q, scratch);
            let error = goal.error(&kinematics, columns, rows);
            let cost = 0.5 * dot(&error.e, &error.e);
            let converged = error.position <= self.tol_position && error.orientation <= self.tol_orientation;
            // Where a residual remains, undamped steps overshoot: the patient take back those that make it worse.
            if patient && !converged && (cost > last || cost.is_nan()) {
                q.copy_from_slice(previous);
                boost *= 10.0;
                refused += 1;
                let kinematics = self.chain.kinematics_unchecked(q, scratch);
                let error = goal.error(&kinematics, columns, rows);
                if refused == REFUSED || iterations >= cap {
                    let end = if refused == REFUSED { RunEnd::Stalled } else { RunEnd::Capped };
                    let (position, orientation) = (error.position, error.orientation);
                    return NewtonRun { end, iterations, position, orientation, cost: last };
                }
                self.step(&kinematics, columns, &error.e, boost * last, q, step, held, goal);
                iterations += 1;
                continue;
            }
            let end = if converged {
                Some(RunEnd::Converged)
            } else if cost.is_nan() || cost > stall * history[accepted % WINDOW] {
                Some(RunEnd::Stalled)
            } else if iterations >= cap {
                Some(RunEnd::Capped)
            } else {
                None
            };
            if let Some(end) = end {
                let (position, orientation) = (error.position, error.orientation);
                return NewtonRun { end, iterations, position, orientation, cost };
            }
            history[accepted % WINDOW] = cost;
            accepted += 1;
            if patient {
                previous.copy_from_slice(q);
                (last, refused) = (cost, 0);
                boost = (boost * 0.25_f64).max(1.0);
            }
            self.step(&kinematics, columns, &error.e, boost * cost, q, step, held, goal);
            iterations += 1;
        }
    }

    /// Writes the part of `direction` that leaves the task as it is and goes into no limit.
    pub fn project(
        &self,
        goal: &Goal<'_>,
        q: &[f64],
        memory: &mut Workspace,
        direction: &[f64],
        out: &mut [f64],
    ) {
        let Workspace { scratch, columns, rows, held, .. } = memory;
        let kinematics = self.chain.kinematics_unchecked(q, scratch);
        goal.error(&kinematics, columns, rows);
        let at_limit =
            |i: usize, d: f64| (d > 0.0 && q[i] >= self.upper[i]) || (d < 0.0 && q[i] <= self.lower[i]);
        for i in 0..q.len() {
            held[i] = at_limit(i, direction[i]);
        }
        for _ in 0..q.len() {
            let mut a = normal(columns, held, true, IK_DAMPING_FLOOR);
            factor(&mut a);
            let mut wish = [0.0; 6];
            for ((column, d), _) in columns.iter().zip(direction).zip(&*held).filter(|(_, held)| !**held) {
                for k in 0..6 {
                    wish[k] += column[k] * d;
                }
            }
            let y = solve(&a, &wish);
            let mut stopped = false;
            for i in 0..q.len() {
                out[i] = if held[i] { 0.0 } else { direction[i] - dot(&columns[i], &y) };
                if !held[i] && at_limit(i, out[i]) {
                    held[i] = true;
                    stopped = true;
                }
            }
            if !stopped {
                return;
            }
        }
        out.fill(0.0);
    }

    /// One step.
    #[inline(always)]
    fn step(
        &self,
        kinematics: &Kinematics<'_>,
        columns: &[[f64; 6]],
        e: &[f64; 6],
        cost: f64,
        q: &mut [f64],
        step: &mut [f64],
        held: &mut [bool],
        goal: &Goal,
    ) {
        let n = q.len();
        let mu = IK_DAMPING * cost + IK_DAMPING_FLOOR;
        let mut rest = *e;
        let mut some_held = false;
        for i in 0..n {
            // A joint at a limit that the gradient would take beyond it.
            let slope = dot(&columns[i], e);
            held[i] = (slope > 0.0 && q[i] >= self.upper[i]) || (slope < 0.0 && q[i] <= self.lower[i]);
            some_held |= held[i];
            step[i] = 0.0;
        }
        for round in 0..ROUNDS {
            let mut a = normal(columns, held, some_held, mu);
            factor(&mut a);
            let y = solve(&a, &rest);
            let mut largest = 0.0_f64;
            for i in 0..n {
                if !held[i] {
                    step[i] = dot(&columns[i], &y);
                    largest = largest.max(step[i].abs());
                }
            }
            if largest <= IK_STEP && round == 0 {
                // Third order.
                let mut correction = [0.0; 6];
                acceleration(kinematics, goal, self.chain, step, &mut correction);
                let y = solve(&a, &correction);
                for i in 0..n {
                    if !held[i] {
                        step[i] -= 0.5 * dot(&columns[i], &y);
                    }
                }
            } else if largest > IK_STEP {
                let scale = IK_STEP / largest;
                for i in 0..n {
                    if !held[i] {
                        step[i] *= scale;
                    }
                }
            }
            let mut stopped = false;
            for i in 0..n {
                if held[i] {
                    continue;
                }
                let goes = q[i] + step[i];
                if goes > self.upper[i] || goes < self.lower[i] {
                    step[i] = goes.clamp(self.lower[i], self.upper[i]) - q[i];
                    held[i] = true;
                    for k in 0..6 {
                        rest[k] -= columns[i][k] * step[i];
                    }
                    stopped = true;
                }
            }
            some_held |= stopped;
            if !stopped {
                break;
            }
        }
        for i in 0..n {
            q[i] = (q[i] + step[i]).clamp(self.lower[i], self.upper[i]);
        }
    }
}

#[inline(always)]
fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) + (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])
}

/// Lower triangle of `J W J^T + mu I`.
#[inline(always)]
fn normal(columns: &[[f64; 6]], held: &[bool], some_held: bool, mu: f64) -> [[f64; 6]; 6] {
    let free = columns.iter().zip(held).filter(|(_, held)| !(some_held && **held));
    normal_matrix(free.map(|(column, _)| column), mu)
}

/// Weighted acceleration of the task along the step: linear `sum_i (2 w_i + z_i dq_i) x v_i dq_i`, angular
/// `sum_i w_i x z_i dq_i`, with `w_i` the angular velocity of the joints before i and `v_i` the linear part of column i.
#[inline(always)]
fn acceleration(kinematics: &Kinematics<'_>, goal: &Goal, chain: &Chain, step: &[f64], out: &mut [f64; 6]) {
    let mut turning = Vector3::zeros();
    let mut linear = Vector3::zeros();
    let mut angular = Vector3::zeros();
    let raw = kinematics.jacobian().as_slice().as_chunks::<6>().0;
    for ((axis, joint), (column, dq)) in kinematics.axes().iter().zip(chain.steps()).zip(raw.iter().zip(step))
    {
        let v = Vector3::new(column[0], column[1], column[2]) * *dq;
        if joint.rotational {
            let own = axis * *dq;
            linear += (turning * 2.0 + own).cross(&v);
            angular += turning.cross(&own);
            turning += own;
        } else {
            linear += (turning * 2.0).cross(&v);
        }
    }
    goal.spread(kinematics, &linear, &angular, out);
}
