//! Where a criterion is stationary on the configurations over one pose: `mu = N^T grad h` and its derivative.
//!
//! With N an orthonormal basis of ker J and the multipliers `lambda = (J J^T)^-1 J grad h` of the task f,
//!
//! ```text
//! mu = N^T grad h                            r numbers, zero at a critical point   [Park1996, eq. (8)]
//! L  = Hess h - sum_k lambda_k Hess f_k      (n, n), Hessian of the Lagrangian
//! W  = N^T L N                               (r, r), second derivative of h along the self-motion
//! ```
//!
//! From `J N = 0` follows `dN^T grad h = -N^T (dJ)^T lambda + (dN^T N) mu`: with a basis that is carried along without
//! turning in itself (`N^T dN = 0`) `d mu = N^T L dq` exactly, on and off the critical points. At these W is the
//! matrix of [Park1996, eq. (10)] in an orthonormal basis; its signature does not depend on the basis, its values do.
//! The paper's own basis (eq. 11) is never needed and null vectors are never differenced.
//!
//! Angular rows of J are no gradients: `(Hess f_k)_jl` means `d J_kj / d q_l` there. What is not symmetric in it is
//! `lambda . (omega_l x omega_j)`, which vanishes in W, because motions in ker J turn the tool about at most one axis.

use std::sync::Arc;

use nalgebra::{DMatrix, Vector3, Vector6};

use super::Criterion;
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{NullSpace, Scratch, Task, TaskKind};
use crate::pose::Pose;

/// A criterion that is borrowed or shared.
#[derive(Debug, Clone)]
enum Handle<'a> {
    Borrowed(&'a dyn Criterion),
    Shared(Arc<dyn Criterion>),
}

impl Handle<'_> {
    fn get(&self) -> &dyn Criterion {
        match self {
            Self::Borrowed(criterion) => *criterion,
            Self::Shared(criterion) => &**criterion,
        }
    }
}

impl Stationarity<'static> {
    /// As [`new`](Stationarity::new), for owners that outlive the criterion's borrow: the schemes of the room `velocity`.
    ///
    /// # Errors
    /// As [`new`](Stationarity::new).
    pub fn shared(chain: &Chain, criterion: Arc<dyn Criterion>, task: Task) -> Result<Self> {
        Self::with(chain, Handle::Shared(criterion), task)
    }
}

/// Memory for one chain, criterion and task; nothing is allocated from call to call.
#[derive(Debug, Clone)]
pub struct Stationarity<'a> {
    chain: Chain,
    criterion: Handle<'a>,
    task: Task,
    own_kinematics: bool,
    scratch: Scratch,
    jacobian: Vec<f64>,
    null: NullSpace,
    gradient: Vec<f64>,
    multipliers: Vec<f64>,
    mu: Vec<f64>,
    lagrangian: DMatrix<f64>,
    mu_jacobian: DMatrix<f64>,
    reduced: DMatrix<f64>,
    scale: f64,
}

impl<'a> Stationarity<'a> {
    /// For `criterion` on the configurations over one value of `task`.
    ///
    /// # Errors
    /// A criterion for another number of joints; a task with as many coordinates as the chain has joints, or more: no
    /// freedom is left.
    pub fn new(chain: &Chain, criterion: &'a dyn Criterion, task: Task) -> Result<Self> {
        Self::with(chain, Handle::Borrowed(criterion), task)
    }

    fn with(chain: &Chain, criterion: Handle<'a>, task: Task) -> Result<Self> {
        let (n, m) = (chain.dof(), task.dim());
        criterion.get().check_arm(chain)?;
        check_redundant(chain, &task)?;
        let r = n - m;
        Ok(Self {
            chain: chain.clone(),
            own_kinematics: criterion.get().chain() == Some(chain),
            criterion,
            task,
            scratch: Scratch::new(chain),
            jacobian: vec![0.0; m * n],
            null: NullSpace::new(m, n),
            gradient: vec![0.0; n],
            multipliers: vec![0.0; m],
            mu: vec![0.0; r],
            lagrangian: DMatrix::zeros(n, n),
            mu_jacobian: DMatrix::zeros(r, n),
            reduced: DMatrix::zeros(r, r),
            scale: 0.0,
        })
    }

    /// Computes pose, J, N, grad h, lambda and mu at `q` (n finite numbers).
    pub fn first_order(&mut self, q: &[f64]) {
        let kinematics = self.chain.kinematics_unchecked(q, &mut self.scratch);
        self.task.write_jacobian(&kinematics, &mut self.jacobian);
        if self.own_kinematics {
            self.criterion.get().gradient_at(q, &kinematics, &mut self.gradient);
        } else {
            self.criterion.get().gradient(q, &mut self.gradient);
        }
        self.factor();
    }

    /// Computes N, lambda and mu from J and grad h.
    fn factor(&mut self) {
        self.null.factor(&self.jacobian);
        self.null.multipliers(&self.gradient, &mut self.multipliers);
        for (mu, n) in self.mu.iter_mut().zip(self.null.basis().column_iter()) {
            *mu = n.iter().zip(&self.gradient).map(|(n, g)| n * g).sum();
        }
    }

    /// Computes all of [`first_order`](Self::first_order), and L and W.
    pub fn second_order(&mut self, q: &[f64]) {
        let kinematics = self.chain.kinematics_unchecked(q, &mut self.scratch);
        self.task.write_jacobian(&kinematics, &mut self.jacobian);
        let criterion = self.criterion.get();
        if self.own_kinematics {
            criterion.second_order_at(q, &kinematics, &mut self.gradient, &mut self.lagrangian);
        } else {
            criterion.gradient(q, &mut self.gradient);
            criterion.hessian(q, &mut self.lagrangian);
        }
        self.factor();
        let of_criterion = self.lagrangian.norm();
        let squared = match self.chain.dof() {
            // The commonest size once more, where the compiler knows it.
            7 => self.bend(7),
            n => self.bend(n),
        };
        self.scale = of_criterion + squared.sqrt();
        let (n, basis) = (self.chain.dof(), self.null.basis());
        for (a, column) in basis.column_iter().enumerate() {
            for j in 0..n {
                let of_lagrangian = &self.lagrangian.as_slice()[j * n..(j + 1) * n];
                self.mu_jacobian[(a, j)] = column.iter().zip(of_lagrangian).map(|(n, l)| n * l).sum();
            }
        }
        // Symmetric up to rounding.
        for (a, left) in basis.column_iter().enumerate() {
            for (b, right) in basis.column_iter().enumerate().take(a + 1) {
                let rows = (self.mu_jacobian.row(a), self.mu_jacobian.row(b));
                let one: f64 = rows.0.iter().zip(right.iter()).map(|(l, n)| l * n).sum();
                let other: f64 = rows.1.iter().zip(left.iter()).map(|(l, n)| l * n).sum();
                let mean = 0.5 * (one + other);
                (self.reduced[(a, b)], self.reduced[(b, a)]) = (mean, mean);
            }
        }
    }

    /// Subtracts `sum_k lambda_k Hess f_k` from the Hessian of the criterion for a chain of `n` joints; the sum of
    /// the squares of what was subtracted.
    #[inline(always)]
    fn bend(&mut self, n: usize) -> f64 {
        // lambda . M = (force, moment) with M the map from velocities of the tool to those of the task.
        let (force, moment) = twist_of(&self.task, self.scratch.pose(), &self.multipliers);
        let pointing = self.task.kind() == TaskKind::Pointing;
        let columns = &self.scratch.columns()[..n];
        let lagrangian = &mut self.lagrangian.as_mut_slice()[..n * n];
        let mut squared = [0.0; 2];
        for (l, column) in columns.iter().enumerate() {
            let [linear, angular] = split(column);
            let (across, turn) = (linear.cross(&force), angular.cross(&moment));
            for (j, axis) in columns[..=l].iter().enumerate() {
                // force . (w_j x v_l), symmetric; moment . (w_j x w_l) in the row of the later joint, for a tool that
                // spins freely (its directions u, w are carried along) in that of the earlier one.
                let axis = split(axis)[1];
                let (linear, angular) = (axis.dot(&across), axis.dot(&turn));
                let (upper, lower) =
                    if pointing { (linear + angular, linear) } else { (linear, linear + angular) };
                lagrangian[l * n + j] -= upper;
                squared[0] += upper * upper;
                if j < l {
                    lagrangian[j * n + l] -= lower;
                    squared[1] += lower * lower;
                }
            }
        }
        squared[0] + squared[1]
    }

    /// The chain, cheaply cloned: what is read from it does not hold on to this memory.
    pub fn chain(&self) -> Chain {
        self.chain.clone()
    }

    /// The criterion.
    pub fn criterion(&self) -> &dyn Criterion {
        self.criterion.get()
    }

    /// The task.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// Pose of the tool.
    pub fn pose(&self) -> &Pose {
        self.scratch.pose()
    }

    /// J `(m, n)` column by column.
    pub fn jacobian(&self) -> &[f64] {
        &self.jacobian
    }

    /// Factors of J.
    pub fn null_space(&self) -> &NullSpace {
        &self.null
    }

    /// Smallest and largest singular value of J.
    pub fn singular_values(&mut self) -> [f64; 2] {
        self.null.singular_values()
    }

    /// grad h.
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// lambda, one for each coordinate of the task.
    pub fn multipliers(&self) -> &[f64] {
        &self.multipliers
    }

    /// mu, one for each spare freedom.
    pub fn mu(&self) -> &[f64] {
        &self.mu
    }

    /// `N^T L` `(r, n)`: the derivative of mu for a basis that is carried along.
    pub fn mu_jacobian(&self) -> &DMatrix<f64> {
        &self.mu_jacobian
    }

    /// W `(r, r)`.
    pub fn reduced_hessian(&self) -> &DMatrix<f64> {
        &self.reduced
    }

    /// Size of the terms of L: `|Hess h| + |sum_k lambda_k Hess f_k|` (Frobenius).
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

/// Linear and angular part of a column of the Jacobian.
#[inline(always)]
fn split(column: &[f64; 6]) -> [Vector3<f64>; 2] {
    let [x, y, z, a, b, c] = *column;
    [Vector3::new(x, y, z), Vector3::new(a, b, c)]
}

/// Checks that `task` leaves the chain a freedom.
pub(crate) fn check_redundant(chain: &Chain, task: &Task) -> Result<()> {
    let (n, m) = (chain.dof(), task.dim());
    if n > m {
        return Ok(());
    }
    let name = chain.name();
    Err(Error::Invalid(format!(
        "no spare freedom: '{name}' has {n} joints and the task '{task}' {m} coordinates, it must have fewer"
    )))
}

/// Force and moment that do the same work as `multipliers` do on the coordinates of the task.
fn twist_of(task: &Task, pose: &Pose, multipliers: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
    let work = |axis: usize| -> f64 {
        let mut unit = Vector6::zeros();
        unit[axis] = 1.0;
        multipliers.iter().zip(task.from_twist(pose, &unit).iter()).map(|(l, v)| l * v).sum()
    };
    match task.kind() {
        TaskKind::Pose | TaskKind::Position | TaskKind::Planar => {
            let get = |i: usize| multipliers.get(i).copied().unwrap_or(0.0);
            (Vector3::new(get(0), get(1), get(2)), Vector3::new(get(3), get(4), get(5)))
        }
        _ => (Vector3::new(work(0), work(1), work(2)), Vector3::new(work(3), work(4), work(5))),
    }
}
