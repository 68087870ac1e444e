//! Extended Jacobian: the freedom is bound by the condition that the criterion stays stationary [Park1996, eq. (5)].
//!
//! With N an orthonormal basis of ker J and `mu = N^T grad h`, whose derivative for a basis that is carried along is
//! `N^T L dq` (see the module `stationarity`):
//!
//! ```text
//! [   J   ]        [    v      ]                 qd = J^+ v + N z
//! [ N^T L ] qd  =  [ -gain mu  ]      that is    W z = -gain mu - N^T L J^+ v,   W = N^T L N
//! ```
//!
//! The task comes first whatever happens to W: where W is singular while J is not (an algorithmic singularity) only the
//! motion of the freedom is damped, and reported. Started at a stationary point the scheme stays on its branch, minimum,
//! maximum or saddle, so closed paths are cyclic; started elsewhere it is drawn to one at the rate `gain`.

use std::sync::Arc;

use super::damping::Damping;
use super::linear::{distance, dot, times};
use super::local::{Local, by_dimension};
use super::pseudo_inverse::PseudoInverse;
use super::singular_values::Svd;
use super::{Resolver, Step, StepInput};
use crate::chain::Chain;
use crate::criterion::{Criterion, Stationarity};
use crate::error::{Error, Result};
use crate::kinematics::Task;
use crate::status::Status;
use crate::tolerance::{ALGORITHMIC_DAMPING, ALGORITHMIC_THRESHOLD, SINGULAR_RANK};

/// Extended Jacobian scheme [Park1996, eq. (5)].
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::JointRange, kinematics::Task};
/// use redundancy_core::velocity::{Damping, ExtendedJacobian, Resolver, StepInput};
/// use std::sync::Arc;
/// let arm = catalog::load("iiwa14")?;
/// let h = Arc::new(JointRange::new(&arm));
/// let mut scheme = ExtendedJacobian::new(&arm, h, 10.0, Task::POSE, Some(Damping::default()))?;
/// let q = [0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4];
/// let mut qd = [0.0; 7];
/// let velocity = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0];
/// scheme.step(&StepInput { q: &q, velocity: &velocity, dt: Some(0.01), qd: None }, &mut qd)?;
/// assert!((arm.tool_velocity(&q, &qd)?[0] - 0.1).abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ExtendedJacobian {
    local: Local,
    gain: f64,
    damped: bool,
    stationarity: Stationarity<'static>,
    inverse: PseudoInverse,
    svd: Svd,
    zero: Vec<f64>,
    right: Vec<f64>,
    free: Vec<f64>,
}

impl ExtendedJacobian {
    /// `gain` (1/s) draws the arm to the stationary point; of a step of length dt at most `1 / dt` counts.
    ///
    /// # Errors
    /// As of [`ProjectedGradient::new`](super::ProjectedGradient::new), and a task that leaves no freedom.
    pub fn new(
        chain: &Chain,
        criterion: Arc<dyn Criterion>,
        gain: f64,
        task: Task,
        damping: Option<Damping>,
    ) -> Result<Self> {
        if let Some(damping) = &damping {
            damping.validate()?;
        }
        if !(gain.is_finite() && gain >= 0.0) {
            return Err(Error::OutOfRange {
                what: "gain".into(),
                value: gain,
                bound: "finite and >= 0".into(),
            });
        }
        let (m, n) = (task.dim(), chain.dof());
        let stationarity = Stationarity::shared(chain, criterion, task)?;
        let r = n - m;
        Ok(Self {
            local: Local::new(chain, None, task)?,
            gain,
            damped: damping.is_some(),
            stationarity,
            inverse: PseudoInverse::new(damping, m, n),
            svd: Svd::new(r, r),
            zero: vec![0.0; n],
            right: vec![0.0; r],
            free: vec![0.0; r],
        })
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        let columns = self.local.columns::<M>();
        let v = self.local.velocity::<M>();
        let factor = self.inverse.factor(columns);
        let loss = self.inverse.loss(&factor);
        self.inverse.solve(&factor, columns, &self.zero, &v, qd);

        self.stationarity.second_order(input.q);
        let gain = input.dt.map_or(self.gain, |dt| self.gain.min(1.0 / dt));
        for (i, right) in self.right.iter_mut().enumerate() {
            let row = self.stationarity.mu_jacobian().row(i);
            let drift: f64 = row.iter().zip(&*qd).map(|(a, b)| a * b).sum();
            *right = -gain * self.stationarity.mu()[i] - drift;
        }
        let r = self.right.len();
        self.svd.decompose(self.stationarity.reduced_hessian().as_slice(), r);
        // Sizes of W are those of the criterion: its thresholds are shares of the terms that it is made of.
        let scale = self.stationarity.scale();
        let damping = Damping {
            maximum: ALGORITHMIC_DAMPING * scale,
            threshold: ALGORITHMIC_THRESHOLD * scale,
            rho: 0.25,
        };
        let algorithmic = self.svd.smallest() < damping.threshold || scale == 0.0;
        self.free.fill(0.0);
        for (sigma, left, right) in self.svd.triples().filter(|t| t.0 > SINGULAR_RANK * scale) {
            let inverse = if self.damped { damping.inverse(sigma) } else { sigma.recip() };
            let factor = inverse * dot(left, &self.right);
            self.free.iter_mut().zip(right).for_each(|(z, v)| *z += factor * v);
        }
        let basis = self.stationarity.null_space().basis();
        for (z, column) in self.free.iter().zip(basis.column_iter()) {
            qd.iter_mut().zip(column.iter()).for_each(|(qd, n)| *qd += z * n);
        }
        let singular = loss.any() || (algorithmic && self.damped);
        Ok(Step {
            status: if singular { Status::Singular } else { Status::Converged },
            scale: 1.0,
            damping: loss.damping,
            basis_changed: false,
            algorithmic,
            residual: if loss.any() { distance(&times(columns, qd), &v) } else { 0.0 },
        })
    }
}

impl Resolver for ExtendedJacobian {
    fn name(&self) -> &'static str {
        "extended_jacobian"
    }

    fn chain(&self) -> &Chain {
        &self.local.chain
    }

    fn task(&self) -> &Task {
        &self.local.task
    }

    fn step(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        self.local.update(input, qd)?;
        by_dimension!(self.resolve(input, qd) for self.local.task.dim())
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
