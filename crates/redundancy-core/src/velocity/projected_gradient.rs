//! Projected gradient: the pseudoinverse for the task, the projected gradient for the freedom.
//!
//! `qd = J^+ v + (I - J^+ J) eta` [Bettini2000, eq. (2)], the joint velocity nearest to `eta` among those that move the
//! tool by v. `J^+` is damped near singularities, the projector is exact, see the module `pseudo_inverse`.

use std::sync::Arc;

use super::damping::Damping;
use super::linear::{distance, times};
use super::local::{Local, by_dimension, required_dt};
use super::pseudo_inverse::PseudoInverse;
use super::step_size::{Gain, OptimalStep};
use super::{Resolver, Step, StepInput};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::Result;
use crate::kinematics::Task;
use crate::status::Status;

/// Projected gradient scheme [Bettini2000, eq. (2)].
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::JointRange, kinematics::Task};
/// use redundancy_core::velocity::{Damping, Gain, ProjectedGradient, Resolver, StepInput};
/// use std::sync::Arc;
/// let arm = catalog::load("iiwa14")?;
/// let h = Arc::new(JointRange::new(&arm));
/// let mut scheme = ProjectedGradient::new(&arm, Some(h), Gain::Constant(10.0), Task::POSE, Some(Damping::default()))?;
/// let q = [0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4];
/// let mut qd = [0.0; 7];
/// let still = StepInput { q: &q, velocity: &[0.0; 6], dt: None, qd: None };
/// assert!(scheme.step(&still, &mut qd)?.residual < 1e-12);
/// assert!(arm.tool_velocity(&q, &qd)?.norm() < 1e-12 && qd[0] != 0.0); // the arm moves, the tool does not
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ProjectedGradient {
    local: Local,
    gain: Gain,
    inverse: PseudoInverse,
    optimal: OptimalStep,
    eta: Vec<f64>,
}

impl ProjectedGradient {
    /// Without a criterion the joint velocity is the least one; without damping it grows without bound towards a
    /// singularity.
    ///
    /// # Errors
    /// A task with more coordinates than the arm has joints, a criterion for another number of joints, a gain that is
    /// negative or not finite, invalid damping.
    pub fn new(
        chain: &Chain,
        criterion: Option<Arc<dyn Criterion>>,
        gain: Gain,
        task: Task,
        damping: Option<Damping>,
    ) -> Result<Self> {
        if let Some(damping) = &damping {
            damping.validate()?;
        }
        let optimal = OptimalStep::new(criterion.as_deref(), chain.dof());
        Ok(Self {
            gain: gain.validate()?,
            inverse: PseudoInverse::new(damping, task.dim(), chain.dof()),
            optimal,
            eta: vec![0.0; chain.dof()],
            local: Local::new(chain, criterion, task)?,
        })
    }

    /// The scheme in the coordinates of a link's frame, see [`MiddleFrame`](crate::kinematics::MiddleFrame): damping acts on
    /// the singular values of that Jacobian. Velocities are given as before.
    ///
    /// # Errors
    /// As [`MiddleFrame::new`](crate::kinematics::MiddleFrame::new).
    pub fn in_frame(mut self, link: usize) -> Result<Self> {
        self.local.set_frame(link)?;
        Ok(self)
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        let Self { local, gain, inverse, optimal, eta } = self;
        let columns = local.columns::<M>();
        let v = local.velocity::<M>();
        let factor = inverse.factor(columns);
        let loss = inverse.loss(&factor);
        let mut status = if loss.any() { Status::Singular } else { Status::Converged };
        match (&*gain, &local.criterion) {
            (Gain::Constant(gain), _) => {
                eta.iter_mut().zip(&local.ascent).for_each(|(eta, ascent)| *eta = gain * ascent);
                inverse.solve(&factor, columns, eta, &v, qd);
            }
            (Gain::Optimal, None) => {
                eta.fill(0.0);
                inverse.solve(&factor, columns, eta, &v, qd);
            }
            (Gain::Optimal, Some(criterion)) => {
                let dt = required_dt(input, "the optimal gain")?;
                eta.fill(0.0);
                inverse.solve(&factor, columns, eta, &v, qd);
                inverse.solve(&factor, columns, &local.ascent, &[0.0; M], eta);
                let feasible = optimal.apply(&**criterion, &local.chain, input.q, dt, eta, qd);
                if !feasible {
                    status = Status::Limits;
                }
            }
        }
        let residual = if loss.any() { distance(&times(columns, qd), &v) } else { 0.0 };
        Ok(Step {
            status,
            scale: 1.0,
            damping: loss.damping,
            basis_changed: false,
            algorithmic: false,
            residual,
        })
    }
}

impl Resolver for ProjectedGradient {
    fn name(&self) -> &'static str {
        "projected_gradient"
    }

    fn chain(&self) -> &Chain {
        &self.local.chain
    }

    fn task(&self) -> &Task {
        &self.local.task
    }

    fn frame(&self) -> Option<usize> {
        self.local.frame.map(|frame| frame.link())
    }

    fn step(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        self.local.update(input, qd)?;
        by_dimension!(self.resolve(input, qd) for self.local.task.dim())
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
