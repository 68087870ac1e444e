//! Projected gradient: the pseudoinverse for the task, the projected gradient for the freedom.
//!
//! `qd = J^+ v + (I - J^+ J) eta` [Bettini2000, eq. (2)], the joint velocity nearest to `eta` among those that move the
//! tool by v. `J^+` is damped near singularities, the projector is exact, see the module `pseudo_inverse`.

use std::sync::Arc;

use super::damping::Damping;
use super::linear::{distance, times};
use super::local::{
    Local, at_acceleration_level, at_velocity_level, by_dimension, check_velocity_gain, required_dt,
};
use super::metric::{Factored, Metric};
use super::pseudo_inverse::{Loss, PseudoInverse};
use super::step_size::{Gain, OptimalStep};
use super::{AccelerationInput, Resolver, Step, StepInput};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
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
/// let still = StepInput { q: &q, velocity: &[0.0; 6], dt: None, qd: None, wish: None };
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
    /// Lengths of joint velocities, where they are not measured by the identity.
    metric: Option<Factored>,
    velocity_gain: Option<f64>,
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
            metric: None,
            velocity_gain: None,
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

    /// The scheme with another measure of joint velocities, see [`Metric`]; damping then acts on the singular values of
    /// `J L^-T`.
    ///
    /// # Errors
    /// Weights that are not positive or of a wrong number, an arm without inertias, the optimal gain.
    pub fn with_metric(mut self, metric: Metric) -> Result<Self> {
        if metric == Metric::Identity {
            self.metric = None;
            return Ok(self);
        }
        if self.gain == Gain::Optimal {
            let message = "the optimal gain is only for joint velocities that are measured alike";
            return Err(Error::Invalid(message.into()));
        }
        self.metric = Some(Factored::new(metric, &self.local.chain, self.local.task.dim())?);
        Ok(self)
    }

    /// The scheme at acceleration level: `qdd = J^+ (a - Jdot qd) + (1 - J^+ J) velocity_gain (eta - qd)`. The joint velocity
    /// approaches the one of the velocity level at the rate `velocity_gain`, 1/s, and has no jumps.
    ///
    /// # Errors
    /// A rate that is not positive or not finite, the optimal gain.
    pub fn at_acceleration_level(mut self, velocity_gain: f64) -> Result<Self> {
        check_velocity_gain(velocity_gain, self.gain)?;
        self.velocity_gain = Some(velocity_gain);
        Ok(self)
    }

    /// `out = J_W b + (1 - J_W J) eta`, of which `eta` is overwritten; what was lost.
    fn solve_measured<const M: usize>(&mut self, b: &[f64; M], out: &mut [f64]) -> Loss {
        let Self { local, inverse, eta, metric, .. } = self;
        let columns = match metric {
            Some(metric) => {
                metric.enter(eta);
                metric.jacobian.as_chunks::<M>().0
            }
            None => local.columns::<M>(),
        };
        let factor = inverse.factor(columns);
        inverse.solve(&factor, columns, eta, b, out);
        if let Some(metric) = metric {
            metric.leave(out);
        }
        inverse.loss(&factor)
    }

    fn resolve_measured<const M: usize>(&mut self, wish: Option<&[f64]>, qd: &mut [f64]) -> Result<Step> {
        let Gain::Constant(gain) = self.gain else {
            return Err(Error::Invalid("the optimal gain is not for this scheme".into()));
        };
        self.local.write_desired(gain, wish, &mut self.eta);
        let v = self.local.velocity::<M>();
        let loss = self.solve_measured(&v, qd);
        Ok(self.report::<M>(loss, qd))
    }

    fn resolve_acceleration<const M: usize>(
        &mut self,
        input: &AccelerationInput<'_>,
        rate: f64,
        qdd: &mut [f64],
    ) -> Result<Step> {
        let Gain::Constant(gain) = self.gain else {
            return Err(Error::Invalid("the optimal gain has no acceleration level".into()));
        };
        self.local.write_desired(gain, input.wish, &mut self.eta);
        self.eta.iter_mut().zip(input.qd).for_each(|(eta, qd)| *eta = rate * (*eta - qd));
        let b = self.local.velocity::<M>();
        let loss = self.solve_measured(&b, qdd);
        Ok(self.report::<M>(loss, qdd))
    }

    fn report<const M: usize>(&self, loss: Loss, out: &[f64]) -> Step {
        let v = self.local.velocity::<M>();
        Step {
            status: if loss.any() { Status::Singular } else { Status::Converged },
            scale: 1.0,
            damping: loss.damping,
            basis_changed: false,
            algorithmic: false,
            residual: if loss.any() { distance(&times(self.local.columns::<M>(), out), &v) } else { 0.0 },
        }
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        let Self { local, gain, inverse, optimal, eta, .. } = self;
        let columns = local.columns::<M>();
        let v = local.velocity::<M>();
        let factor = inverse.factor(columns);
        let loss = inverse.loss(&factor);
        let mut status = if loss.any() { Status::Singular } else { Status::Converged };
        // A wish takes the place of gain and criterion.
        let criterion = local.criterion.as_ref().filter(|_| input.wish.is_none());
        match (&*gain, criterion) {
            (Gain::Constant(gain), _) => {
                local.write_desired(*gain, input.wish, eta);
                inverse.solve(&factor, columns, eta, &v, qd);
            }
            (Gain::Optimal, None) => {
                local.write_desired(0.0, input.wish, eta);
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
        if self.velocity_gain.is_some() {
            return Err(at_acceleration_level(self.name()));
        }
        self.local.update(input, qd)?;
        if let Some(metric) = &mut self.metric {
            metric.update(&self.local.chain, input.q, &self.local.jacobian)?;
            return by_dimension!(self.resolve_measured(input.wish, qd) for self.local.task.dim());
        }
        by_dimension!(self.resolve(input, qd) for self.local.task.dim())
    }

    fn step_acceleration(&mut self, input: &AccelerationInput<'_>, qdd: &mut [f64]) -> Result<Step> {
        let rate = self.velocity_gain.ok_or_else(|| at_velocity_level(self.name()))?;
        self.local.update_acceleration(input, qdd)?;
        if let Some(metric) = &mut self.metric {
            metric.update(&self.local.chain, input.q, &self.local.jacobian)?;
        }
        by_dimension!(self.resolve_acceleration(input, rate, qdd) for self.local.task.dim())
    }

    fn velocity_gain(&self) -> Option<f64> {
        self.velocity_gain
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
