//! Torques that hold the arm against gravity, to be minimised.
//!
//! With the mass `m_k` and the sum `s_k` of mass times centre of everything from joint k on, the joint moves it by
//! `b_k = z_k x (s_k - m_k o_k)` per rad (`m_k z_k` per m), and with the gravity g
//!
//! ```text
//! tau_k = -g . b_k       d tau_i / d q_j = -g . (w_i x b_j)       d2 tau_i / d q_j d q_l = -g . (w_i x (w_j x b_l))
//! ```
//!
//! for `i <= j <= l`; both derivatives do not depend on the order of the indices, because the torques are the gradient of
//! the potential energy. Here `w` is the axis of a turning joint and zero for a sliding one. Value, gradient and Hessian are
//! exact, and nothing is allocated for up to 16 joints.

use nalgebra::{DMatrix, Vector3};

use super::{Criterion, STACK_JOINTS};
use crate::chain::{Body, Chain};
use crate::error::{Error, Result, check_finite, check_vector};
use crate::kinematics::{Kinematics, Scratch};
use crate::tolerance::TORQUE_ZERO;

/// What is made of the torques of all joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TorqueMeasure {
    /// The root of the sum of squares.
    Norm,
    /// The largest magnitude. Where two joints share it, the derivatives are those of the first.
    Peak,
}

impl TorqueMeasure {
    /// The measure as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Norm => "norm",
            Self::Peak => "peak",
        }
    }

    /// The measure with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        [Self::Norm, Self::Peak].into_iter().find(|measure| measure.as_str() == name).ok_or_else(|| {
            let valid = vec!["norm".into(), "peak".into()];
            Error::UnknownName { kind: "measure", name: name.into(), valid }
        })
    }
}

/// Size of the torques that hold the arm: `sqrt(sum (w_k tau_k)^2)` or `max |w_k tau_k|`.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::{Criterion, GravityTorque, TorqueMeasure}};
/// let arm = catalog::load("puma560")?;
/// let h = GravityTorque::new(&arm, TorqueMeasure::Peak)?;
/// assert!((h.value(&[0.0; 6]) - 37.4837).abs() < 1e-4); // what the shoulder holds with the arm stretched out
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct GravityTorque {
    chain: Chain,
    measure: TorqueMeasure,
    gravity: Vector3<f64>,
    weights: Vec<f64>,
}

impl GravityTorque {
    /// Under 9.81 m/s^2 against the world's z, all joints alike: N m, and N for sliding joints.
    ///
    /// # Errors
    /// A chain without inertias.
    pub fn new(chain: &Chain, measure: TorqueMeasure) -> Result<Self> {
        chain.masses()?;
        let gravity = Vector3::new(0.0, 0.0, -9.81);
        Ok(Self { chain: chain.clone(), measure, gravity, weights: vec![1.0; chain.dof()] })
    }

    /// Under another gravity, m/s^2, world axes.
    ///
    /// # Errors
    /// Numbers that are not finite.
    pub fn under(mut self, gravity: [f64; 3]) -> Result<Self> {
        check_finite("gravity", &gravity)?;
        self.gravity = gravity.into();
        Ok(self)
    }

    /// With a weight for each joint, such as the reciprocal of its effort limit.
    ///
    /// # Errors
    /// Another number of weights than joints, weights that are negative or not finite.
    pub fn weighted(mut self, weights: &[f64]) -> Result<Self> {
        check_vector("weights", weights, self.chain.dof())?;
        if let Some(weight) = weights.iter().find(|weight| **weight < 0.0) {
            return Err(Error::OutOfRange { what: "weight".into(), value: *weight, bound: ">= 0".into() });
        }
        self.weights.copy_from_slice(weights);
        Ok(self)
    }

    /// Calls `work` with `b_k` of all joints.
    fn with_motions<T>(&self, kinematics: &Kinematics<'_>, work: impl FnOnce(&Torques<'_>) -> T) -> T {
        let n = self.chain.dof();
        let (mut stack, mut heap) = ([Vector3::zeros(); STACK_JOINTS], Vec::new());
        let motions = match stack.get_mut(..n) {
            Some(motions) => motions,
            None => {
                heap.resize(n, Vector3::zeros());
                &mut heap[..]
            }
        };
        let bodies: &[Body] = self.chain.bodies().unwrap_or_default();
        let (mut mass, mut moment) = (0.0, Vector3::zeros());
        for (k, body) in bodies.iter().enumerate().rev() {
            let (rotation, origin) = kinematics.frame(k);
            mass += body.mass;
            moment += rotation * body.moment + origin * body.mass;
            let axis = kinematics.axes()[k];
            motions[k] = match self.chain.steps()[k].rotational {
                true => axis.cross(&(moment - origin * mass)),
                false => axis * mass,
            };
        }
        work(&Torques { of: self, kinematics, motions })
    }
}

/// The torques at one configuration.
struct Torques<'a> {
    of: &'a GravityTorque,
    kinematics: &'a Kinematics<'a>,
    motions: &'a [Vector3<f64>],
}

impl Torques<'_> {
    /// Axis of a turning joint, zero of a sliding one.
    fn turn(&self, k: usize) -> Vector3<f64> {
        self.kinematics.angular(k)
    }

    fn torque(&self, k: usize) -> f64 {
        -self.of.gravity.dot(&self.motions[k])
    }

    fn first(&self, i: usize, j: usize) -> f64 {
        -self.of.gravity.dot(&self.turn(i.min(j)).cross(&self.motions[i.max(j)]))
    }

    fn second(&self, i: usize, j: usize, l: usize) -> f64 {
        let mut sorted = [i, j, l];
        sorted.sort_unstable();
        let [a, b, c] = sorted;
        -self.of.gravity.dot(&self.turn(a).cross(&self.turn(b).cross(&self.motions[c])))
    }

    /// The joint with the largest weighted torque, and the weight with the torque's sign.
    fn peak(&self) -> (usize, f64) {
        let size = |k: usize| self.of.weights[k] * self.torque(k).abs();
        let joint = (1..self.motions.len()).fold(0, |best, k| if size(k) > size(best) { k } else { best });
        (joint, self.of.weights[joint] * self.torque(joint).signum())
    }

    fn value(&self) -> f64 {
        match self.of.measure {
            TorqueMeasure::Norm => {
                let square = |k: usize| (self.of.weights[k] * self.torque(k)).powi(2);
                (0..self.motions.len()).map(square).sum::<f64>().sqrt()
            }
            TorqueMeasure::Peak => {
                let (joint, factor) = self.peak();
                factor * self.torque(joint)
            }
        }
    }

    fn write_gradient(&self, out: &mut [f64]) {
        match self.of.measure {
            TorqueMeasure::Norm => {
                let norm = self.value();
                // At zero the norm has no derivative; its least subgradient is zero.
                let inverse = if norm > TORQUE_ZERO { norm.recip() } else { 0.0 };
                for (j, out) in out.iter_mut().enumerate() {
                    let part = |k: usize| self.of.weights[k].powi(2) * self.torque(k) * self.first(k, j);
                    *out = inverse * (0..self.motions.len()).map(part).sum::<f64>();
                }
            }
            TorqueMeasure::Peak => {
                let (joint, factor) = self.peak();
                out.iter_mut().enumerate().for_each(|(j, out)| *out = factor * self.first(joint, j));
            }
        }
    }

    fn write_hessian(&self, out: &mut DMatrix<f64>) {
        let n = self.motions.len();
        let (joint, factor) = self.peak();
        let norm = self.value();
        let inverse = if norm > TORQUE_ZERO { norm.recip() } else { 0.0 };
        let slope = |j: usize| {
            let part = |k: usize| self.of.weights[k].powi(2) * self.torque(k) * self.first(k, j);
            inverse * (0..n).map(part).sum::<f64>()
        };
        for j in 0..n {
            for l in 0..=j {
                out[(j, l)] = match self.of.measure {
                    TorqueMeasure::Peak => factor * self.second(joint, j, l),
                    TorqueMeasure::Norm => {
                        let part = |k: usize| {
                            let bent = self.torque(k) * self.second(k, j, l);
                            self.of.weights[k].powi(2) * (self.first(k, j) * self.first(k, l) + bent)
                        };
                        inverse * ((0..n).map(part).sum::<f64>() - slope(j) * slope(l))
                    }
                };
                out[(l, j)] = out[(j, l)];
            }
        }
    }
}

impl Criterion for GravityTorque {
    fn dof(&self) -> usize {
        self.chain.dof()
    }

    fn chain(&self) -> Option<&Chain> {
        Some(&self.chain)
    }

    fn value(&self, q: &[f64]) -> f64 {
        let mut scratch = Scratch::new(&self.chain);
        let kinematics = self.chain.kinematics_unchecked(q, &mut scratch);
        self.with_motions(&kinematics, |torques| torques.value())
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let mut scratch = Scratch::new(&self.chain);
        self.gradient_at(q, &self.chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, _q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        self.with_motions(kinematics, |torques| torques.write_gradient(out));
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let mut scratch = Scratch::new(&self.chain);
        let kinematics = self.chain.kinematics_unchecked(q, &mut scratch);
        self.with_motions(&kinematics, |torques| torques.write_hessian(out));
    }

    fn second_order_at(
        &self,
        _q: &[f64],
        kinematics: &Kinematics<'_>,
        gradient: &mut [f64],
        hessian: &mut DMatrix<f64>,
    ) {
        self.with_motions(kinematics, |torques| {
            torques.write_gradient(gradient);
            torques.write_hessian(hessian);
        });
    }
}
