//! Kinetic energy of the arm for given joint velocities, to be minimised.
//!
//! `h = qd^T M(q) qd / 2` for fixed joint velocities qd, or `trace(M(q)) / 2`, the sum of the energies with which each joint
//! alone moves at 1 rad/s (or 1 m/s). With the axes `S_k` as motions about the world's origin, the velocity `V_k` of the
//! body before joint k and the momentum `P_k` of everything from joint k on,
//!
//! ```text
//! d h / d q_k = -P_k . (S_k x V_k)
//! ```
//!
//! Turning joint k leaves all that it carries as it is, seen from there, and turns the velocity `V_k` of the arm before it the
//! other way round. Rotors add a constant. The Hessian is the difference quotient of this gradient.

use nalgebra::{DMatrix, Vector3};

use super::differences::hessian_of_gradient;
use super::{Criterion, STACK_JOINTS};
use crate::chain::{Body, Chain};
use crate::error::{Result, check_vector};
use crate::kinematics::{Kinematics, Mass, Scratch, Six};

/// Kinetic energy at given joint velocities, J.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::{Criterion, KineticEnergy}};
/// let arm = catalog::load("puma560")?;
/// let h = KineticEnergy::of_velocity(&arm, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0])?;
/// // Stretched out, the arm is heavier to turn about its first axis than folded.
/// assert!(h.value(&[0.0; 6]) > h.value(&[0.0, 1.5, 0.0, 0.0, 0.0, 0.0]));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct KineticEnergy {
    chain: Chain,
    /// Joint velocities; `None`: each joint alone at unit speed.
    qd: Option<Vec<f64>>,
}

/// One joint and what it carries.
#[derive(Debug, Clone, Copy, Default)]
struct Carried {
    axis: Six,
    own: Mass,
    /// Of everything from this joint on.
    whole: Mass,
    rotor: f64,
}

impl KineticEnergy {
    /// `trace(M) / 2`: the sum of the energies of each joint alone at unit speed.
    ///
    /// # Errors
    /// A chain without inertias.
    pub fn new(chain: &Chain) -> Result<Self> {
        chain.masses()?;
        Ok(Self { chain: chain.clone(), qd: None })
    }

    /// `qd^T M qd / 2`.
    ///
    /// # Errors
    /// A chain without inertias, a wrong number of velocities, numbers that are not finite.
    pub fn of_velocity(chain: &Chain, qd: &[f64]) -> Result<Self> {
        chain.masses()?;
        check_vector("qd", qd, chain.dof())?;
        Ok(Self { chain: chain.clone(), qd: Some(qd.to_vec()) })
    }

    fn with_carried<T>(&self, kinematics: &Kinematics<'_>, work: impl FnOnce(&[Carried]) -> T) -> T {
        let n = self.chain.dof();
        let (mut stack, mut heap) = ([Carried::default(); STACK_JOINTS], Vec::new());
        let carried = match stack.get_mut(..n) {
            Some(carried) => carried,
            None => {
                heap.resize(n, Carried::default());
                &mut heap[..]
            }
        };
        let bodies: &[Body] = self.chain.bodies().unwrap_or_default();
        let mut whole = Mass::default();
        for (k, body) in bodies.iter().enumerate().rev() {
            let (rotation, origin) = kinematics.frame(k);
            let (axis, own) = (kinematics.axes()[k], Mass::placed(body, &rotation, &origin));
            whole.add(&own);
            let axis = match self.chain.steps()[k].rotational {
                true => Six::new(origin.cross(&axis), axis),
                false => Six::new(axis, Vector3::zeros()),
            };
            carried[k] = Carried { axis, own, whole, rotor: body.rotor };
        }
        work(carried)
    }
}

/// Twice the energy.
fn twice_energy(carried: &[Carried], qd: Option<&[f64]>) -> f64 {
    match qd {
        None => carried.iter().map(|c| c.axis.dot(&c.whole.times(&c.axis)) + c.rotor).sum(),
        Some(qd) => {
            let mut velocity = Six::default();
            let mut sum = 0.0;
            for (c, qd) in carried.iter().zip(qd) {
                velocity = velocity + c.axis * *qd;
                sum += velocity.dot(&c.own.times(&velocity)) + c.rotor * qd * qd;
            }
            sum
        }
    }
}

fn write_gradient(carried: &[Carried], qd: Option<&[f64]>, out: &mut [f64]) {
    match qd {
        None => {
            for (k, out) in out.iter_mut().enumerate() {
                let (axis, whole) = (&carried[k].axis, &carried[k].whole);
                // Joint i alone moves everything from joint k on as one body.
                let part = |i: &Carried| whole.times(&i.axis).dot(&axis.cross(&i.axis));
                *out = -carried[..k].iter().map(part).sum::<f64>();
            }
        }
        Some(qd) => {
            let mut before = Six::default();
            for k in 0..carried.len() {
                let (mut velocity, mut momentum) = (before, Six::default());
                for (c, qd) in carried[k..].iter().zip(&qd[k..]) {
                    velocity = velocity + c.axis * *qd;
                    momentum = momentum + c.own.times(&velocity);
                }
                out[k] = -momentum.dot(&carried[k].axis.cross(&before));
                before = before + carried[k].axis * qd[k];
            }
        }
    }
}

impl Criterion for KineticEnergy {
    fn dof(&self) -> usize {
        self.chain.dof()
    }

    fn chain(&self) -> Option<&Chain> {
        Some(&self.chain)
    }

    fn value(&self, q: &[f64]) -> f64 {
        let mut scratch = Scratch::new(&self.chain);
        let kinematics = self.chain.kinematics_unchecked(q, &mut scratch);
        self.with_carried(&kinematics, |carried| 0.5 * twice_energy(carried, self.qd.as_deref()))
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let mut scratch = Scratch::new(&self.chain);
        self.gradient_at(q, &self.chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, _q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        self.with_carried(kinematics, |carried| write_gradient(carried, self.qd.as_deref(), out));
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let mut scratch = Scratch::new(&self.chain);
        hessian_of_gradient(
            |at, out| self.gradient_at(at, &self.chain.kinematics_unchecked(at, &mut scratch), out),
            q,
            out,
        );
    }
}
