//! Extended Jacobian: the freedom is used to keep the criterion stationary [Park1996, eq. (5)].
//!
//! With N an orthonormal basis of ker J and `mu = N^T grad h`, whose derivative for a basis that is carried along is
//! `N^T L dq` (see the module `stationarity`):
//!
//! ```text
//! [   J   ]        [    v      ]                 qd = J^+ v + N z
//! [ N^T L ] qd  =  [ -gain mu  ]      that is    W z = -gain mu - N^T L J^+ v,   W = N^T L N
//! ```
//!
//! The task comes first whatever happens to W. Started at a stationary point the scheme stays on its branch, minimum,
//! maximum or saddle, so closed paths are cyclic; started elsewhere it is drawn to one at the rate `gain`.
//!
//! # Algorithmic singularities
//! Where W is singular while J is not, the stationary point vanishes or meets another one, and the formula above asks for
//! an unbounded velocity. With damping the scheme then leaves the point: until W is definite again in the sense of the
//! criterion, it improves the criterion along each eigenvector of W, with eigenvalue w,
//!
//! ```text
//! z = -sense gain mu / max(|w|, threshold)               sense: 1 to minimise, -1 to maximise
//! ```
//!
//! and so arrives at the next minimum or maximum. A point that is no such optimum is also left where the task alone takes
//! a joint beyond its speed limit: minima of the manipulability lead to singularities of J. Everywhere the motion of the
//! freedom is scaled down until no joint is faster than the larger of its limit and [`LIMITED_SPEED_RATIO`] times the fastest
//! joint of `J^+ v` ([`Resolver::speed_bound`]); of a joint without a limit [`FREEDOM_SPEED_RATIO`] times the fastest joint.
//!
//! The optimum of a criterion may lead into a singularity of J, where the task alone asks for fast joints. Where the least
//! singular value is below [`KEEP_OFF_RATIO`] times the damping's threshold, a motion of the freedom that lowers it further
//! is reduced by the square of its share of that bound.

use std::sync::Arc;

use super::damping::Damping;
use super::linear::{distance, dot, times};
use super::local::{Local, by_dimension};
use super::pseudo_inverse::PseudoInverse;
use super::singular_values::Svd;
use super::{Resolver, SpeedBound, Step, StepInput};
use crate::chain::Chain;
use crate::criterion::{Criterion, Stationarity};
use crate::error::{Error, Result};
use crate::kinematics::{Scratch, Task};
use crate::status::Status;
use crate::tolerance::{
    ALGORITHMIC_THRESHOLD, FREE_SPEED, FREEDOM_SPEED_RATIO, JOINT_JUMP, KEEP_OFF_RATIO, LIMITED_SPEED_RATIO,
    SINGULAR_RANK, SINGULARITY_STEP,
};

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
/// scheme.step(&StepInput { q: &q, velocity: &velocity, dt: Some(0.01), qd: None, wish: None }, &mut qd)?;
/// assert!((arm.tool_velocity(&q, &qd)?[0] - 0.1).abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ExtendedJacobian {
    local: Local,
    gain: f64,
    damping: Option<Damping>,
    stationarity: Stationarity<'static>,
    inverse: PseudoInverse,
    svd: Svd,
    zero: Vec<f64>,
    right: Vec<f64>,
    free: Vec<f64>,
    /// Joint velocity of the freedom (n).
    freedom: Vec<f64>,
    /// Largest speed of each joint that the freedom may use.
    limits: Vec<f64>,
    last: LastStep,
    bound: Option<SpeedBound>,
    probe: Probe,
}

/// The Jacobian a little way along the freedom.
#[derive(Debug, Clone)]
struct Probe {
    scratch: Scratch,
    q: Vec<f64>,
    jacobian: Vec<f64>,
    svd: Svd,
}

/// What is kept of a step for the next one.
#[derive(Debug, Clone, Default)]
struct LastStep {
    q: Vec<f64>,
    /// Number of eigenvalues of W with the sign that an optimum of the criterion has.
    wanted: usize,
    leaving: bool,
    known: bool,
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
        let limit = |v: f64| if v.is_finite() { v } else { FREE_SPEED };
        Ok(Self {
            local: Local::new(chain, None, task)?,
            gain,
            damping,
            stationarity,
            inverse: PseudoInverse::new(damping, m, n),
            svd: Svd::new(r, r),
            zero: vec![0.0; n],
            right: vec![0.0; r],
            free: vec![0.0; r],
            freedom: vec![0.0; n],
            limits: chain.joints().iter().map(|joint| limit(joint.limits.velocity)).collect(),
            last: LastStep { q: vec![0.0; n], ..LastStep::default() },
            bound: None,
            probe: Probe {
                scratch: Scratch::new(chain),
                q: vec![0.0; n],
                jacobian: vec![0.0; m * n],
                svd: Svd::new(m, n),
            },
        })
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        let v = self.local.velocity::<M>();
        let columns = self.local.columns::<M>();
        let factor = self.inverse.factor(columns);
        let loss = self.inverse.loss(&factor);
        self.inverse.solve(&factor, columns, &self.zero, &v, qd);
        let algorithmic = match input.wish {
            None => self.follow_criterion(input, qd),
            Some(wish) => {
                // Of the wish that part which does not move the tool; the stationary point is left.
                self.inverse.solve(&factor, columns, wish, &[0.0; M], &mut self.freedom);
                self.last.known = false;
                false
            }
        };
        if let Some(damping) = self.damping {
            let near = KEEP_OFF_RATIO * damping.threshold;
            if self.inverse.may_be_below(&factor, near) {
                self.keep_off(input.q, near);
            }
        }
        self.bound = if self.damping.is_some() { self.slow_down(qd) } else { None };
        qd.iter_mut().zip(&self.freedom).for_each(|(qd, free)| *qd += free);
        let singular = loss.any() || (algorithmic && self.damping.is_some());
        Ok(Step {
            status: if singular { Status::Singular } else { Status::Converged },
            scale: 1.0,
            damping: loss.damping,
            basis_changed: false,
            algorithmic,
            residual: if loss.any() { distance(&times(self.local.columns::<M>(), qd), &v) } else { 0.0 },
        })
    }

    /// The motion of the freedom that keeps the criterion stationary, in `freedom`; whether it is near an algorithmic
    /// singularity. `qd` is `J^+ v`.
    fn follow_criterion(&mut self, input: &StepInput<'_>, qd: &[f64]) -> bool {
        self.stationarity.second_order(input.q);
        let r = self.right.len();
        self.svd.decompose(self.stationarity.reduced_hessian().as_slice(), r);
        // Sizes of W are those of the criterion: its thresholds are shares of the terms that it is made of.
        let scale = self.stationarity.scale();
        let threshold = ALGORITHMIC_THRESHOLD * scale;
        let algorithmic = self.svd.smallest() < threshold || scale == 0.0;
        let gain = input.dt.map_or(self.gain, |dt| self.gain.min(1.0 / dt));
        if self.damping.is_some() && self.leaves(input.q, qd, algorithmic) {
            self.improve(gain, threshold);
        } else {
            self.stay(gain, scale, qd);
        }
        self.freedom.fill(0.0);
        let basis = self.stationarity.null_space().basis();
        for (z, column) in self.free.iter().zip(basis.column_iter()) {
            self.freedom.iter_mut().zip(column.iter()).for_each(|(qd, n)| *qd += z * n);
        }
        algorithmic
    }

    /// Whether the stationary point is lost, or was lost and the criterion's optimum is not reached yet. `least` is `J^+ v`.
    fn leaves(&mut self, q: &[f64], least: &[f64], algorithmic: bool) -> bool {
        let sense = self.stationarity.criterion().sense().sign();
        // Of a definite matrix left and right singular vectors agree up to the sign of the eigenvalue.
        let wanted = self.svd.triples().filter(|(_, left, right)| sense * dot(left, right) > 0.5).count();
        let optimum = wanted == self.right.len() && !algorithmic;
        let last = &mut self.last;
        // Farther away than one step another run begins.
        let goes_on = last.known && last.q.iter().zip(q).all(|(a, b)| (a - b).abs() <= JOINT_JUMP);
        let lost = algorithmic || (goes_on && (last.leaving || last.wanted != wanted));
        let fast = least.iter().zip(&self.limits).any(|(v, limit)| v.abs() > *limit);
        let leaving = !optimum && (lost || fast);
        last.q.copy_from_slice(q);
        (last.wanted, last.leaving, last.known) = (wanted, leaving, true);
        leaving
    }

    /// Draws the arm to the stationary point: `W z = -gain mu - N^T L J^+ v`.
    fn stay(&mut self, gain: f64, scale: f64, least: &[f64]) {
        for (i, right) in self.right.iter_mut().enumerate() {
            let row = self.stationarity.mu_jacobian().row(i);
            let drift: f64 = row.iter().zip(least).map(|(a, b)| a * b).sum();
            *right = -gain * self.stationarity.mu()[i] - drift;
        }
        self.free.fill(0.0);
        for (sigma, left, right) in self.svd.triples().filter(|t| t.0 > SINGULAR_RANK * scale) {
            let factor = dot(left, &self.right) / sigma;
            self.free.iter_mut().zip(right).for_each(|(z, v)| *z += factor * v);
        }
    }

    /// Improves the criterion by a Newton step on the magnitudes of the eigenvalues.
    fn improve(&mut self, gain: f64, threshold: f64) {
        let sense = self.stationarity.criterion().sense().sign();
        self.free.fill(0.0);
        for (sigma, _, right) in self.svd.triples() {
            let size = sigma.max(threshold);
            if size > 0.0 {
                let factor = -sense * gain * dot(right, self.stationarity.mu()) / size;
                self.free.iter_mut().zip(right).for_each(|(z, v)| *z += factor * v);
            }
        }
    }

    /// Reduces a motion of the freedom that leads deeper into a singularity of J.
    fn keep_off(&mut self, q: &[f64], threshold: f64) {
        let size = dot(&self.freedom, &self.freedom).sqrt();
        if size == 0.0 {
            return;
        }
        let Probe { scratch, q: ahead, jacobian, svd } = &mut self.probe;
        let (chain, task) = (&self.local.chain, &self.local.task);
        svd.decompose(&self.local.jacobian, task.dim());
        let here = svd.smallest();
        for ((ahead, q), free) in ahead.iter_mut().zip(q).zip(&self.freedom) {
            *ahead = q + SINGULARITY_STEP / size * free;
        }
        task.write_jacobian(&chain.kinematics_unchecked(ahead, scratch), jacobian);
        svd.decompose(jacobian, task.dim());
        if here < threshold && svd.smallest() < here {
            let share = (here / threshold).powi(2);
            self.freedom.iter_mut().for_each(|v| *v *= share);
        }
    }

    /// Scales the motion of the freedom down until no joint is faster than its bound. `least` is `J^+ v`.
    fn slow_down(&mut self, least: &[f64]) -> Option<SpeedBound> {
        let fastest = least.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let mut bound: Option<SpeedBound> = None;
        for (joint, (free, v)) in self.freedom.iter().zip(least).enumerate() {
            let limited = self.local.chain.joints()[joint].limits.velocity.is_finite();
            let ratio = if limited { LIMITED_SPEED_RATIO } else { FREEDOM_SPEED_RATIO };
            let speed = self.limits[joint].max(ratio * fastest);
            if (v + free).abs() <= speed {
                continue;
            }
            let scale = (free.signum() * speed - v) / free;
            if bound.is_none_or(|bound| scale < bound.scale) {
                bound = Some(SpeedBound { joint, speed, scale });
            }
        }
        if let Some(SpeedBound { scale, .. }) = bound {
            self.freedom.iter_mut().for_each(|v| *v *= scale);
        }
        bound
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

    fn speed_bound(&self) -> Option<SpeedBound> {
        self.bound
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
