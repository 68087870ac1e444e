//! Squared distance from a reference configuration, to be minimised: `h(q) = 1/2 sum_i w_i (q_i - r_i)^2`.

use super::{JointSpring, Springs};
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};

/// Nearness to a reference configuration; joint values count as they are, a winding away is far away.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    springs: Vec<JointSpring>,
    arm: Option<Chain>,
}

impl Posture {
    /// With weight 1 for every joint.
    ///
    /// # Errors
    /// An entry of `reference` that is not finite.
    pub fn new(reference: &[f64]) -> Result<Self> {
        Self::weighted(reference, &vec![1.0; reference.len()])
    }

    /// With a weight for each joint.
    ///
    /// # Errors
    /// Lengths that differ, entries that are not finite, a negative weight.
    pub fn weighted(reference: &[f64], weights: &[f64]) -> Result<Self> {
        check_finite("q_ref", reference)?;
        check_length("weights", weights, reference.len())?;
        check_finite("weights", weights)?;
        if let Some(i) = weights.iter().position(|w| *w < 0.0) {
            let what = format!("weight {i}");
            return Err(Error::OutOfRange { what, value: weights[i], bound: ">= 0".into() });
        }
        let springs = reference
            .iter()
            .zip(weights)
            .map(|(center, weight)| JointSpring { weight: *weight, center: *center });
        Ok(Self { springs: springs.collect(), arm: None })
    }

    /// The same for `chain` alone: another arm with as many joints is refused.
    ///
    /// # Errors
    /// A chain with another number of joints.
    pub fn of(self, chain: &Chain) -> Result<Self> {
        check_length("q_ref", &vec![0.0; self.springs.len()], chain.dof())?;
        Ok(Self { arm: Some(chain.clone()), ..self })
    }
}

impl Springs for Posture {
    fn row(&self) -> &[JointSpring] {
        &self.springs
    }

    fn arm(&self) -> Option<&Chain> {
        self.arm.as_ref()
    }
}
