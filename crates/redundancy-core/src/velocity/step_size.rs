//! How far to go along the gradient.
//!
//! A step leads to `a + alpha b` with `a = q + dt J^+ v` and `b` the change that the freedom makes for `alpha = 1`
//! [Bettini2000, eq. (8)]. For a quadratic criterion the best `alpha` is a quotient; for another one the quotient of its
//! local model. Joint limits confine `alpha` to an interval [Bettini2000, eq. (9)]; it can be empty (the text speaks
//! of a maximum only).

use nalgebra::DMatrix;

use super::linear::dot;
use crate::chain::Chain;
use crate::criterion::{Criterion, JointSpring};
use crate::error::{Error, Result};
use crate::tolerance::STEP_DIRECTION;

/// How strongly the gradient of the criterion drives the freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gain {
    /// Constant: joint velocity per unit of the gradient.
    Constant(f64),
    /// The step that makes the criterion best after dt, within position and velocity limits; needs dt.
    Optimal,
}

impl Gain {
    pub(super) fn validate(self) -> Result<Self> {
        match self {
            Self::Constant(gain) if !(gain.is_finite() && gain >= 0.0) => {
                Err(Error::OutOfRange { what: "gain".into(), value: gain, bound: "finite and >= 0".into() })
            }
            _ => Ok(self),
        }
    }
}

/// Memory for the optimal step.
#[derive(Debug, Clone)]
pub(super) struct OptimalStep {
    springs: Option<Vec<JointSpring>>,
    gradient: Vec<f64>,
    hessian: DMatrix<f64>,
    /// `q + dt J^+ v`.
    base: Vec<f64>,
    /// `dt` times the joint velocity of the freedom for gain 1.
    direction: Vec<f64>,
}

/// What became of a step along the gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Chosen {
    alpha: f64,
    /// False where the interval is empty: no `alpha` keeps the limits.
    feasible: bool,
}

impl OptimalStep {
    pub fn new(criterion: Option<&dyn Criterion>, n: usize) -> Self {
        Self {
            springs: criterion.and_then(Criterion::springs),
            gradient: vec![0.0; n],
            hessian: DMatrix::zeros(n, n),
            base: vec![0.0; n],
            direction: vec![0.0; n],
        }
    }

    /// Adds the best step to `qd = J^+ v`; `freedom` is the joint velocity of the freedom for gain 1. False where limits
    /// leave no step.
    pub fn apply(
        &mut self,
        criterion: &dyn Criterion,
        chain: &Chain,
        q: &[f64],
        dt: f64,
        freedom: &[f64],
        qd: &mut [f64],
    ) -> bool {
        for i in 0..q.len() {
            self.base[i] = q[i] + dt * qd[i];
            self.direction[i] = dt * freedom[i];
        }
        let chosen = self.choose(criterion, chain, q, dt);
        qd.iter_mut().zip(freedom).for_each(|(qd, freedom)| *qd += chosen.alpha * freedom);
        chosen.feasible
    }

    /// The best `alpha` within limits; 0 where the direction vanishes. Where the interval is empty, the `alpha` whose
    /// worst excess is least is not looked for: the freedom stays unused.
    fn choose(&mut self, criterion: &dyn Criterion, chain: &Chain, q: &[f64], dt: f64) -> Chosen {
        let Some((low, high)) = self.interval(chain, q, dt) else {
            return Chosen { alpha: 0.0, feasible: false };
        };
        let b = &self.direction;
        if dot(b, b).sqrt() <= STEP_DIRECTION {
            return Chosen { alpha: 0.0_f64.clamp(low, high), feasible: true };
        }
        let sign = criterion.sense().sign();
        let (slope, curvature) = match &self.springs {
            Some(springs) => {
                springs.iter().zip(&self.base).zip(b).fold((0.0, 0.0), |(slope, curvature), ((s, a), b)| {
                    (slope + s.weight * b * (a - s.center), curvature + s.weight * b * b)
                })
            }
            None => {
                criterion.gradient(&self.base, &mut self.gradient);
                criterion.hessian(&self.base, &mut self.hessian);
                let along: f64 = (0..b.len())
                    .map(|i| b[i] * (0..b.len()).map(|j| self.hessian[(i, j)] * b[j]).sum::<f64>())
                    .sum();
                (dot(&self.gradient, b), along)
            }
        };
        // Of a model without a minimum the farthest allowed point is the best; without limits it stays where it is.
        let (slope, curvature) = (sign * slope, sign * curvature);
        let best = if curvature > 0.0 {
            -slope / curvature
        } else if slope < 0.0 && high.is_finite() {
            high
        } else {
            0.0
        };
        Chosen { alpha: best.clamp(low, high), feasible: true }
    }

    /// `[low, high]` of `alpha` by position and velocity limits [Bettini2000, eq. (9)]; `None` where empty.
    fn interval(&self, chain: &Chain, q: &[f64], dt: f64) -> Option<(f64, f64)> {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for (i, joint) in chain.joints().iter().enumerate() {
            let reach = joint.limits.velocity * dt;
            let (bottom, top) = (joint.limits.lower.max(q[i] - reach), joint.limits.upper.min(q[i] + reach));
            let (a, b) = (self.base[i], self.direction[i]);
            if b.abs() <= STEP_DIRECTION {
                // The step does not move this joint, so only the task does.
                if a > top || a < bottom {
                    return None;
                }
                continue;
            }
            let (x, y) = ((bottom - a) / b, (top - a) / b);
            low = low.max(x.min(y));
            high = high.min(x.max(y));
        }
        (low <= high).then_some((low, high))
    }
}
