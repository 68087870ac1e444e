//! Newton's method onto the configurations over one task value, for any chain and any task.
//!
//! One step is the shortest joint motion that removes the linearised error, `dq = J^+ (x - f(q))` [AllgowerGeorg1990, ch. 6]. Where J is
//! far from singular it comes from the normal equations, `dq = J^T (J J^T)^-1 (x - f(q))`, which cost half as much as the Householder
//! factors of J in [`NullSpace`]; those are made near singular configurations, and where tangents of the self-motion are asked for.
//! The damped step `dq = J^T (J J^T + damping^2 I)^-1 (x - f(q))` stays short near singular configurations and serves far from
//! the target.
//!
//! Beside the task, up to [`MOST_COORDINATES`] linear coordinates of the joints may be held, `c_k . q = w_k`: a joint that is
//! fixed (c a unit vector) or a spare coordinate that describes a self-motion. Their rows stand below those of the task, and the
//! null space is then that of both together.
//!
//! `pose_rpy` is corrected as `pose`: the same configurations, in coordinates without a singularity of their own. All angles of an
//! error are taken along the shortest arc. Joints are never wound: `q` changes continuously.
//!
//! Cost: one pass of kinematics and one small linear system per step. Nothing is allocated after [`Corrector::new`].

use nalgebra::DMatrix;

use super::normal_equations::{factor, normal_matrix, solve};
use super::{Kinematics, NullSpace, Scratch, Task, TaskError, TaskKind};
use crate::chain::Chain;
use crate::error::{Error, Result, check_vector};
use crate::pose::Pose;
use crate::tolerance::{NORMAL_EQUATIONS, TRACE_ONE_STEP};

/// Most linear coordinates that a [`Corrector`] holds beside its task.
pub const MOST_COORDINATES: usize = 6;

/// Rows of the padded normal equations with coordinates.
const PADDED: usize = 6 + MOST_COORDINATES;

/// The longest step of Newton's method. Longer ones are shortened, their direction is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepBound {
    /// On the Euclidean norm of the step, rad or m.
    Length(f64),
    /// On the largest motion of a single joint, rad or m.
    Joint(f64),
}

/// When a correction is done and when it is given up. It is done as soon as one of the two conditions of success holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrectorSettings {
    /// Most steps.
    pub steps: usize,
    /// The longest step.
    pub bound: StepBound,
    /// Whether a step beyond the bound ends the correction as failed.
    pub strict: bool,
    /// Done after a step of at most this size, in the measure of the bound: convergence is quadratic, so what is left is of the
    /// order of its square.
    pub last_step: f64,
    /// Done after the step from a point whose error had no coordinate above this, for the same reason.
    pub last_error: f64,
    /// Rooted ratio of the pivots of `J J^T` below which a point is singular and the correction fails; 0 for none.
    pub singular: f64,
    /// Farthest that a joint may go from where it started; infinity for no bound.
    pub travel: f64,
    /// Whether tangents are asked for afterwards: then the steps come from the factors that these need too.
    pub tangents: bool,
}

impl CorrectorSettings {
    /// For a `q` that is near: six steps, none longer than `reach`.
    pub const fn near(reach: f64) -> Self {
        Self {
            steps: 6,
            bound: StepBound::Length(reach),
            strict: true,
            last_step: TRACE_ONE_STEP,
            last_error: 0.0,
            singular: 0.0,
            travel: f64::INFINITY,
            tangents: false,
        }
    }

    /// For any `q`: 80 steps, shortened to half a radian.
    pub const FAR: Self = Self { steps: 80, bound: StepBound::Length(0.5), strict: false, ..Self::near(0.5) };
}

/// What [`NullSpace`] knows of the last Jacobian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Factors {
    None,
    Reduced,
    Basis,
}

/// Newton's method onto the configurations of one chain over one task value. Memory is allocated once.
///
/// ```
/// use redundancy_core::{chain::catalog, kinematics::{Corrector, Task}};
/// let arm = catalog::load("panda")?;
/// let target = arm.forward(&[0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5])?;
/// let mut corrector = Corrector::new(&arm, Task::POINTING, &target)?;
/// let mut q = [0.1, 0.5, -0.2, -1.8, 0.3, 1.6, 0.7];
/// assert!(corrector.reach(&mut q));
/// assert!(corrector.error(&q).position < 1e-10);
/// assert_eq!(corrector.basis().ncols(), 2); // seven joints, five coordinates
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Corrector {
    chain: Chain,
    task: Task,
    target: Pose,
    /// Held linear coordinates: rows of n numbers, and their values.
    rows: Vec<f64>,
    values: Vec<f64>,
    scratch: Scratch,
    /// `(m, n)` column by column, m counting the coordinates too.
    jacobian: Vec<f64>,
    /// Target minus value, m numbers.
    residual: Vec<f64>,
    null: NullSpace,
    factors: Factors,
    step: Vec<f64>,
    start: Vec<f64>,
}

impl Corrector {
    /// Towards the configurations of `chain` with the value of `task` at `target`.
    ///
    /// # Errors
    /// A chain with fewer joints than the task has coordinates.
    pub fn new(chain: &Chain, task: Task, target: &Pose) -> Result<Self> {
        Self::with_coordinates(chain, task, target, &[])
    }

    /// As [`new`](Self::new), and with `rows`, n numbers each, of linear coordinates held at 0 until
    /// [`set_coordinates`](Self::set_coordinates) says otherwise.
    ///
    /// # Errors
    /// As [`new`](Self::new), the coordinates counted with those of the task; rows that are not complete or not finite; more than
    /// [`MOST_COORDINATES`].
    pub fn with_coordinates(chain: &Chain, task: Task, target: &Pose, rows: &[f64]) -> Result<Self> {
        let task = if task.kind() == TaskKind::PoseRpy { Task::POSE } else { task };
        let n = chain.dof();
        let held = rows.len() / n.max(1);
        check_vector("rows", rows, held * n)?;
        if held > MOST_COORDINATES {
            let bound = format!("<= {MOST_COORDINATES}");
            return Err(Error::OutOfRange {
                what: "number of held coordinates".into(),
                value: held as f64,
                bound,
            });
        }
        let m = task.dim() + held;
        if m > n {
            let name = chain.name();
            let message =
                format!("'{name}' has {n} joints, the task '{task}' with {held} held coordinates needs {m}");
            return Err(Error::Invalid(message));
        }
        Ok(Self {
            chain: chain.clone(),
            task,
            target: *target,
            rows: rows.to_vec(),
            values: vec![0.0; held],
            scratch: Scratch::new(chain),
            jacobian: vec![0.0; m * n],
            residual: vec![0.0; m],
            null: NullSpace::new(m, n),
            factors: Factors::None,
            step: vec![0.0; n],
            start: vec![0.0; n],
        })
    }

    /// The chain.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The task; `pose` where `pose_rpy` was given.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// The pose whose task value is aimed at.
    pub fn target(&self) -> &Pose {
        &self.target
    }

    /// Aims at another pose.
    pub fn set_target(&mut self, target: &Pose) {
        self.target = *target;
    }

    /// Values of the held coordinates; entries beyond their number are ignored.
    pub fn set_coordinates(&mut self, values: &[f64]) {
        for (value, new) in self.values.iter_mut().zip(values) {
            *value = *new;
        }
    }

    /// Holds linear coordinate `k`, `row . q`, at `value`. Rows are counted from 0; one beyond their number is ignored, as are entries
    /// beyond a row's length.
    pub fn hold(&mut self, k: usize, row: &[f64], value: f64) {
        let n = self.step.len();
        if let (Some(own), Some(at)) = (self.rows.chunks_exact_mut(n).nth(k), self.values.get_mut(k)) {
            own.iter_mut().zip(row).for_each(|(own, c)| *own = *c);
            *at = value;
        }
    }

    /// The Jacobian `(m, n)` of task and held coordinates, column by column, at the last `q` that was evaluated.
    pub fn jacobian(&self) -> &[f64] {
        &self.jacobian
    }

    /// Pose, Jacobian and axes at the last `q` that was evaluated.
    pub fn kinematics(&self) -> Kinematics<'_> {
        Kinematics::new(&self.scratch)
    }

    /// The error of the task at `q`, held coordinates aside. One forward pass; the factors stay what they are.
    #[inline]
    pub fn error(&self, q: &[f64]) -> TaskError {
        self.task.error(&self.target, &self.chain.forward_unchecked(q))
    }

    /// Kinematics and Jacobian at `q`, without factors; the error there, in task coordinates, then that of the held coordinates.
    #[inline]
    pub fn evaluate(&mut self, q: &[f64]) -> &[f64] {
        let kinematics = self.chain.kinematics_unchecked(q, &mut self.scratch);
        self.task.write_jacobian(&kinematics, &mut self.jacobian);
        let error = self.task.error(&self.target, kinematics.pose()).coordinates;
        for (out, e) in self.residual.iter_mut().zip(error.as_slice()) {
            *out = *e;
        }
        if !self.values.is_empty() {
            self.append_rows(q);
        }
        self.factors = Factors::None;
        &self.residual
    }

    /// Spreads the columns of the task Jacobian and puts the rows of the held coordinates below.
    fn append_rows(&mut self, q: &[f64]) {
        let (n, m) = (self.step.len(), self.residual.len());
        let dim = m - self.values.len();
        for j in (0..n).rev() {
            self.jacobian.copy_within(j * dim..(j + 1) * dim, j * m);
            for (k, row) in self.rows.chunks_exact(n).enumerate() {
                self.jacobian[j * m + dim + k] = row[j];
            }
        }
        let wanted = self.values.iter().zip(self.rows.chunks_exact(n));
        for (out, (value, row)) in self.residual[dim..].iter_mut().zip(wanted) {
            *out = value - row.iter().zip(q).map(|(c, q)| c * q).sum::<f64>();
        }
    }

    /// One Newton step from `q`; its size before the bound, in the measure of the bound.
    #[inline]
    pub fn step(&mut self, q: &mut [f64], bound: StepBound) -> f64 {
        self.least_norm(q, false);
        self.advance(q, bound)
    }

    /// Evaluates `q` and prepares the step; how regular J is there, see [`CorrectorSettings::singular`].
    #[inline]
    fn least_norm(&mut self, q: &[f64], tangents: bool) -> f64 {
        self.evaluate(q);
        if tangents {
            self.reduce();
            self.null.shortest(&self.residual, &mut self.step);
            return self.null.pivot_ratio();
        }
        let regular = self.by_normal_equations(0.0);
        if regular < NORMAL_EQUATIONS {
            self.reduce();
            self.null.shortest(&self.residual, &mut self.step);
        }
        regular
    }

    /// One damped step from the `q` that was evaluated last, `damping > 0` in the units of the singular values of J; its size
    /// before the bound, in the measure of the bound.
    pub fn damped_step(&mut self, q: &mut [f64], damping: f64, bound: StepBound) -> f64 {
        self.by_normal_equations(damping * damping);
        self.advance(q, bound)
    }

    #[inline]
    fn by_normal_equations(&mut self, mu: f64) -> f64 {
        match self.residual.len() {
            6 => self.normal_step::<6>(mu),
            5 => self.normal_step::<5>(mu),
            2 | 3 => self.normal_step::<3>(mu),
            7 => self.normal_step::<7>(mu),
            _ => self.normal_step::<PADDED>(mu),
        }
    }

    /// The step by `(J J^T + mu I) y = e`, with rows of zeros up to M; the rooted ratio of the least pivot to the largest.
    #[inline(always)]
    fn normal_step<const M: usize>(&mut self, mu: f64) -> f64 {
        let m = self.residual.len();
        let padded = |column: &[f64]| -> [f64; M] {
            // Whole columns are copied as such.
            column
                .try_into()
                .unwrap_or_else(|_| std::array::from_fn(|i| column.get(i).copied().unwrap_or(0.0)))
        };
        let mut a = normal_matrix(self.jacobian.chunks_exact(m).map(padded), mu);
        for i in m..M {
            a[i][i] = 1.0;
        }
        factor(&mut a);
        let y = solve(&a, &padded(&self.residual));
        for (out, column) in self.step.iter_mut().zip(self.jacobian.chunks_exact(m)) {
            *out = column.iter().zip(&y).map(|(c, y)| c * y).sum();
        }
        // The diagonal holds the inverse pivots.
        let (mut least, mut most) = (f64::INFINITY, 0.0);
        for (i, row) in a.iter().enumerate().take(m) {
            least = if row[i] < least { row[i] } else { least };
            most = if row[i] > most || row[i].is_nan() { row[i] } else { most };
        }
        let ratio = (least / most).sqrt();
        if ratio.is_nan() { 0.0 } else { ratio }
    }

    /// Adds the step, shortened to the bound; its size before that.
    #[inline(always)]
    fn advance(&self, q: &mut [f64], bound: StepBound) -> f64 {
        let (size, most) = match bound {
            StepBound::Length(most) => (norm(&self.step), most),
            StepBound::Joint(most) => (largest(&self.step), most),
        };
        let factor = if size > most { most / size } else { 1.0 };
        for (q, d) in q.iter_mut().zip(&self.step) {
            *q += factor * d;
        }
        size
    }

    /// Moves `q` onto the task value (and the held coordinates): whether it got there. Otherwise `q` is where it was given up.
    ///
    /// Afterwards tangents are those at the point before the last step.
    #[inline]
    pub fn solve(&mut self, q: &mut [f64], settings: &CorrectorSettings) -> bool {
        let bounded = settings.travel < f64::INFINITY;
        if bounded {
            self.start.iter_mut().zip(&*q).for_each(|(start, q)| *start = *q);
        }
        let (StepBound::Length(most) | StepBound::Joint(most)) = settings.bound;
        for _ in 0..settings.steps {
            let regular = self.least_norm(q, settings.tangents);
            if regular < settings.singular {
                return false;
            }
            let size = self.advance(q, settings.bound);
            if bounded && self.start.iter().zip(&*q).any(|(a, b)| (b - a).abs() > settings.travel) {
                return false;
            }
            if size <= settings.last_step {
                return true;
            }
            if size.is_nan() || settings.strict && size > most {
                return false;
            }
            if settings.last_error > 0.0 && largest(&self.residual) < settings.last_error {
                return true;
            }
        }
        false
    }

    /// Corrects `q`, which is near already, see [`CorrectorSettings::near`]: false when a step exceeds `reach` or there is no
    /// convergence.
    #[inline]
    pub fn correct(&mut self, q: &mut [f64], reach: f64) -> bool {
        self.solve(q, &CorrectorSettings::near(reach))
    }

    /// Brings any `q` to the task value, see [`CorrectorSettings::FAR`]: false where that fails.
    pub fn reach(&mut self, q: &mut [f64]) -> bool {
        self.solve(q, &CorrectorSettings::FAR) && self.pivot_ratio() > 0.0
    }

    /// Factors the last Jacobian, if that has not been done.
    #[inline]
    fn reduce(&mut self) {
        if self.factors == Factors::None {
            self.null.reduce(&self.jacobian);
            self.factors = Factors::Reduced;
        }
    }

    /// Smallest over largest pivot of the Jacobian at the last `q` that was evaluated: between the ratio of its singular values and
    /// a small multiple of it.
    pub fn pivot_ratio(&mut self) -> f64 {
        self.reduce();
        self.null.pivot_ratio()
    }

    /// Factors of the Jacobian at the last `q` that was evaluated: null space, multipliers, singular values.
    #[inline]
    pub fn null_space(&mut self) -> &mut NullSpace {
        self.reduce();
        if self.factors != Factors::Basis {
            self.null.form_basis();
            self.factors = Factors::Basis;
        }
        &mut self.null
    }

    /// Orthonormal basis `(n, n - m)` of the motions that leave the task as it is, at the last `q` that was evaluated. For one
    /// freedom its sign is that of `det [J; t] > 0`.
    #[inline]
    pub fn basis(&mut self) -> &DMatrix<f64> {
        self.null_space().basis()
    }

    /// The columns of [`basis`](Self::basis) one after the other; for one freedom the unit tangent.
    #[inline]
    pub fn tangent(&mut self) -> &[f64] {
        self.basis().as_slice()
    }

    /// [`tangent`](Self::tangent) at exactly `q`.
    pub fn tangent_at(&mut self, q: &[f64]) -> &[f64] {
        self.evaluate(q);
        self.tangent()
    }

    /// The shortest joint motion (n) with the velocity `v` (m) of task and held coordinates, at the last `q` that was evaluated.
    #[inline]
    pub fn shortest(&mut self, v: &[f64], out: &mut [f64]) {
        self.reduce();
        self.null.shortest(v, out);
    }
}

#[inline(always)]
fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Largest absolute entry; NaN where there is one.
#[inline(always)]
fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |most: f64, x| if x.abs() > most || x.is_nan() { x.abs() } else { most })
}
