//! What every scheme computes first: the task's Jacobian and velocity and the gradient step of the criterion, at one q.

use std::sync::Arc;

use nalgebra::Vector6;

use super::step_size::Gain;
use super::{AccelerationInput, StepInput};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result, check_rates};
use crate::kinematics::{Kinematics, MiddleFrame, Scratch, Task};

/// An arm, a task, a criterion, and the memory for one step.
#[derive(Debug, Clone)]
pub(super) struct Local {
    pub chain: Chain,
    pub task: Task,
    /// Where the coordinates are those of a middle frame.
    pub frame: Option<MiddleFrame>,
    pub criterion: Option<Arc<dyn Criterion>>,
    /// The criterion is one of the kinematics of this very chain.
    shared: bool,
    scratch: Scratch,
    /// `(m, n)`, column by column.
    pub jacobian: Vec<f64>,
    /// Gradient of the criterion times the sign that makes it better; zero without a criterion.
    pub ascent: Vec<f64>,
    /// Velocity of the task in its coordinates.
    pub velocity: Vector6<f64>,
}

impl Local {
    pub fn new(chain: &Chain, criterion: Option<Arc<dyn Criterion>>, task: Task) -> Result<Self> {
        let (m, n) = (task.dim(), chain.dof());
        if m > n {
            let message =
                format!("task '{task}' has {m} coordinates, '{}' has only {n} joints", chain.name());
            return Err(Error::Invalid(message));
        }
        if let Some(h) = &criterion {
            h.check_arm(chain)?;
        }
        let criterion = criterion.map(|h| h.for_task(&task).unwrap_or(h));
        let shared = criterion.as_ref().is_some_and(|h| h.chain() == Some(chain));
        Ok(Self {
            chain: chain.clone(),
            task,
            frame: None,
            criterion,
            shared,
            scratch: Scratch::new(chain),
            jacobian: vec![0.0; m * n],
            ascent: vec![0.0; n],
            velocity: Vector6::zeros(),
        })
    }

    /// The coordinates are those of the frame of a link.
    pub fn set_frame(&mut self, link: usize) -> Result<()> {
        self.frame = Some(MiddleFrame::new(&self.chain, &self.task, link)?);
        Ok(())
    }

    /// Checks the input and computes everything at its q.
    #[inline]
    pub fn update(&mut self, input: &StepInput<'_>, out: &[f64]) -> Result<()> {
        let n = self.chain.dof();
        self.chain.check_q(input.q)?;
        crate::error::check_length("joint velocity", out, n)?;
        if let Some(qd) = input.qd {
            check_rates("qd", qd, n)?;
        }
        if let Some(wish) = input.wish {
            check_rates("wish", wish, n)?;
        }
        if let Some(dt) = input.dt
            && !(dt.is_finite() && dt > 0.0)
        {
            return Err(Error::OutOfRange { what: "dt".into(), value: dt, bound: "finite and > 0".into() });
        }
        let kinematics = self.chain.kinematics_unchecked(input.q, &mut self.scratch);
        self.velocity = self.task.velocity(kinematics.pose(), input.velocity)?;
        match &self.frame {
            None => self.task.write_jacobian(&kinematics, &mut self.jacobian),
            Some(frame) => {
                self.velocity = frame.velocity(&self.chain, &kinematics, &self.task, &self.velocity);
                frame.write_jacobian(&self.chain, &kinematics, &mut self.jacobian);
            }
        }
        if let Some(h) = self.criterion.as_ref().filter(|_| input.wish.is_none()) {
            if self.shared {
                h.gradient_at(input.q, &kinematics, &mut self.ascent);
            } else {
                h.gradient(input.q, &mut self.ascent);
            }
            let sign = -h.sense().sign();
            self.ascent.iter_mut().for_each(|x| *x *= sign);
        }
        Ok(())
    }

    /// As [`update`](Self::update) for the acceleration level: `velocity` is then `a - Jdot qd`.
    pub fn update_acceleration(&mut self, input: &AccelerationInput<'_>, out: &[f64]) -> Result<()> {
        let AccelerationInput { q, qd, acceleration, dt, wish } = *input;
        self.update(&StepInput { q, velocity: acceleration, dt, qd: Some(qd), wish }, out)?;
        let kinematics = self.scratch.last();
        let mut product = self.task.velocity_product(&kinematics, qd);
        if let Some(frame) = &self.frame {
            product = frame.velocity(&self.chain, &kinematics, &self.task, &product);
        }
        self.velocity -= product;
        Ok(())
    }

    /// Writes the joint velocity that the freedom is used for: the caller's wish, else the gain times the ascent.
    #[inline(always)]
    pub fn write_desired(&self, gain: f64, wish: Option<&[f64]>, eta: &mut [f64]) {
        match wish {
            Some(wish) => eta.copy_from_slice(wish),
            None => eta.iter_mut().zip(&self.ascent).for_each(|(eta, ascent)| *eta = gain * ascent),
        }
    }

    /// The kinematics at the last q.
    pub fn kinematics(&self) -> Kinematics<'_> {
        self.scratch.last()
    }

    /// The columns of the Jacobian.
    #[inline(always)]
    pub fn columns<const M: usize>(&self) -> &[[f64; M]] {
        self.jacobian.as_chunks::<M>().0
    }

    /// The first M numbers of the velocity.
    #[inline(always)]
    pub fn velocity<const M: usize>(&self) -> [f64; M] {
        let mut out = [0.0; M];
        out.copy_from_slice(&self.velocity.as_slice()[..M]);
        out
    }
}

/// The length of a step, where a scheme needs it.
pub(super) fn required_dt(input: &StepInput<'_>, why: &str) -> Result<f64> {
    input.dt.ok_or_else(|| Error::Invalid(format!("dt is missing: {why} needs the length of the step")))
}

/// Checks the rate at which the acceleration level approaches the joint velocity of the velocity level.
pub(super) fn check_velocity_gain(rate: f64, gain: Gain) -> Result<()> {
    if gain == Gain::Optimal {
        return Err(Error::Invalid("the optimal gain has no acceleration level".into()));
    }
    if rate.is_finite() && rate > 0.0 {
        return Ok(());
    }
    let bound = "finite and > 0 per s".into();
    Err(Error::OutOfRange { what: "velocity_gain".into(), value: rate, bound })
}

/// A scheme at acceleration level that is asked for a velocity.
pub(super) fn at_acceleration_level(name: &str) -> Error {
    Error::Invalid(format!("{name} was made for the acceleration level: call step_acceleration"))
}

/// The other way round.
pub(super) fn at_velocity_level(name: &str) -> Error {
    Error::Invalid(format!("{name} was made for the velocity level: it has no step_acceleration"))
}

/// Calls a method that is generic over the number of task coordinates.
macro_rules! by_dimension {
    ($self:ident . $method:ident ( $($argument:expr),* ) for $dim:expr) => {
        match $dim {
            2 => $self.$method::<2>($($argument),*),
            3 => $self.$method::<3>($($argument),*),
            5 => $self.$method::<5>($($argument),*),
            _ => $self.$method::<6>($($argument),*),
        }
    };
}
pub(super) use by_dimension;
