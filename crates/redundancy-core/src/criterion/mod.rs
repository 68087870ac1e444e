//! Criteria, the objectives for the freedom: h(q), its gradient and its Hessian.

mod clearance;
mod differences;
mod elbow;
mod gravity_torque;
mod joint_range;
mod kinetic_energy;
mod manipulability;
mod posture;
mod stationarity;
mod weighted;

pub use clearance::{CLEARANCE_SMOOTHING, Clearance};
pub(crate) use differences::hessian_of_gradient;
pub use differences::{gradient_by_differences, hessian_by_differences};
pub use elbow::Elbow;
pub use gravity_torque::{GravityTorque, TorqueMeasure};
pub use joint_range::JointRange;
pub use kinetic_energy::KineticEnergy;
pub use manipulability::{Manipulability, Measure};
pub use posture::Posture;
pub use stationarity::Stationarity;
pub(crate) use stationarity::check_redundant;
pub use weighted::Weighted;

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{Kinematics, Task};

/// Joints up to which what a criterion computes for each of them lies on the stack: more than any arm has.
pub(crate) const STACK_JOINTS: usize = 16;

/// Whether a criterion is to be small or large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sense {
    /// Small is good.
    Minimize,
    /// Large is good.
    Maximize,
}

impl Sense {
    /// The sense as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Minimize => "minimize",
            Self::Maximize => "maximize",
        }
    }

    /// The other sense.
    #[must_use]
    pub fn flipped(self) -> Self {
        match self {
            Self::Minimize => Self::Maximize,
            Self::Maximize => Self::Minimize,
        }
    }

    /// +1 where small is good, -1 where large is.
    pub fn sign(self) -> f64 {
        match self {
            Self::Minimize => 1.0,
            Self::Maximize => -1.0,
        }
    }
}

/// `weight / 2 (q - center)^2` for one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSpring {
    /// Weight; 0 for joints that do not count.
    pub weight: f64,
    /// Where the term vanishes, rad or m.
    pub center: f64,
}

/// A scalar function of the configuration.
///
/// `value`, `gradient` and `hessian` take a `q` of the right length; a wrong length is the caller's mistake and is
/// checked by [`Criterion::check`], which every entry point of the crate calls first.
pub trait Criterion: Send + Sync + std::fmt::Debug {
    /// Number of joints; see [`any_dof`](Self::any_dof).
    fn dof(&self) -> usize;

    /// True for a function of any number of joints: then [`dof`](Self::dof) has no meaning.
    fn any_dof(&self) -> bool {
        false
    }

    /// Whether it is to be small or large.
    fn sense(&self) -> Sense {
        Sense::Minimize
    }

    /// h(q).
    fn value(&self, q: &[f64]) -> f64;

    /// Writes dh/dq to `out` (n).
    fn gradient(&self, q: &[f64], out: &mut [f64]);

    /// The chain whose kinematics it is a function of; `None` for functions of the joints alone.
    fn chain(&self) -> Option<&Chain> {
        None
    }

    /// The arm that it was made for; `None` where it fits every arm with as many joints.
    fn arm(&self) -> Option<&Chain> {
        self.chain()
    }

    /// Checks that it was made for `chain`: the same joints in the same places. Limits, base and tool may differ.
    ///
    /// # Errors
    /// Another number of joints, another arm.
    fn check_arm(&self, chain: &Chain) -> Result<()> {
        if self.any_dof() {
            return Ok(());
        }
        check_joints(self.dof(), self.arm(), chain)
    }

    /// Writes dh/dq to `out` (n) in a control step: `kinematics` are those of [`Criterion::chain`] at `q`, so that
    /// nothing is computed twice and nothing allocated. Callers whose chain is another one call `gradient`.
    fn gradient_at(&self, q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        let _ = kinematics;
        self.gradient(q, out);
    }

    /// Writes d2h/dq2 to `out` (n, n).
    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>);

    /// Writes dh/dq (n) and d2h/dq2 (n, n) with `kinematics` as for [`Criterion::gradient_at`]: what both are made from is
    /// computed once.
    fn second_order_at(
        &self,
        q: &[f64],
        kinematics: &Kinematics<'_>,
        gradient: &mut [f64],
        hessian: &mut DMatrix<f64>,
    ) {
        self.gradient_at(q, kinematics, gradient);
        self.hessian(q, hessian);
    }

    /// The criterion for a scheme that keeps a task, where it is another one: without what the freedom of the task cannot change
    /// but which would outweigh the rest.
    fn for_task(&self, task: &Task) -> Option<Arc<dyn Criterion>> {
        let _ = task;
        None
    }

    /// `h = sum_i weight_i / 2 (q_i - center_i)^2 + constant`, where it has this form: then its optimum over a circle
    /// of solutions is found with bounds that prove it.
    fn springs(&self) -> Option<Vec<JointSpring>> {
        None
    }

    /// Checks `q`: one finite entry per joint.
    ///
    /// # Errors
    /// Wrong length, or an entry that is not finite.
    fn check(&self, q: &[f64]) -> Result<()> {
        let dof = if self.any_dof() { q.len() } else { self.dof() };
        crate::error::check_vector("q", q, dof)
    }
}

/// Checks that a criterion is made for as many joints as the arm has.
pub(crate) fn check_dof(criterion: &dyn Criterion, dof: usize) -> Result<()> {
    if criterion.any_dof() || criterion.dof() == dof {
        return Ok(());
    }
    Err(Error::Length { what: "joints of the criterion".into(), expected: dof, actual: criterion.dof() })
}

/// Checks that something for `dof` joints, made for `arm`, fits `chain`.
fn check_joints(dof: usize, arm: Option<&Chain>, chain: &Chain) -> Result<()> {
    if dof != chain.dof() {
        let (expected, actual) = (chain.dof(), dof);
        return Err(Error::Length { what: "joints of the criterion".into(), expected, actual });
    }
    match arm.filter(|arm| !arm.has_joints_of(chain)) {
        None => Ok(()),
        Some(arm) => Err(Error::Invalid(format!(
            "the criterion was made for '{}' (joints {}), here the arm is '{}' (joints {})",
            arm.name(),
            names_of(arm),
            chain.name(),
            names_of(chain)
        ))),
    }
}

fn names_of(chain: &Chain) -> String {
    let names: Vec<&str> = chain.joints().iter().map(|joint| joint.name.as_str()).collect();
    names.join(", ")
}

/// Criteria that are nothing but a row of springs.
trait Springs: Send + Sync + std::fmt::Debug {
    fn row(&self) -> &[JointSpring];

    /// As [`Criterion::arm`].
    fn arm(&self) -> Option<&Chain>;
}

impl<T: Springs> Criterion for T {
    fn dof(&self) -> usize {
        self.row().len()
    }

    fn arm(&self) -> Option<&Chain> {
        Springs::arm(self)
    }

    fn value(&self, q: &[f64]) -> f64 {
        self.row().iter().zip(q).map(|(s, q)| 0.5 * s.weight * (q - s.center).powi(2)).sum()
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        for ((out, s), q) in out.iter_mut().zip(self.row()).zip(q) {
            *out = s.weight * (q - s.center);
        }
    }

    fn hessian(&self, _q: &[f64], out: &mut DMatrix<f64>) {
        out.fill(0.0);
        for (i, s) in self.row().iter().enumerate() {
            out[(i, i)] = s.weight;
        }
    }

    fn springs(&self) -> Option<Vec<JointSpring>> {
        Some(self.row().to_vec())
    }
}
