//! Distance from the middle of the joint ranges [Bettini2000, eq. (6)], to be minimised:
//! `H(q) = 1/(2n) sum_i ((q_i - c_i) / (max_i - min_i))^2`.

use super::{JointSpring, Springs};
use crate::chain::Chain;

/// Available joint range [Bettini2000, eq. (6)]. Joints without limits, or fixed by limits of zero width, do not count;
/// n is the number of all joints.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::{Criterion, JointRange}};
/// let h = JointRange::new(&catalog::load("iiwa14")?);
/// assert_eq!(h.value(&[0.0; 7]), 0.0);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointRange {
    springs: Vec<JointSpring>,
    arm: Chain,
}

impl JointRange {
    /// From the limits of `chain`.
    pub fn new(chain: &Chain) -> Self {
        let n = chain.dof() as f64;
        let springs = chain
            .lower()
            .iter()
            .zip(chain.upper())
            .map(|(lower, upper)| {
                let range = upper - lower;
                if range.is_finite() && range > 0.0 {
                    JointSpring { weight: 1.0 / (n * range * range), center: lower + 0.5 * range }
                } else {
                    JointSpring { weight: 0.0, center: 0.0 }
                }
            })
            .collect();
        Self { springs, arm: chain.clone() }
    }
}

impl Springs for JointRange {
    fn row(&self) -> &[JointSpring] {
        &self.springs
    }

    fn arm(&self) -> Option<&Chain> {
        Some(&self.arm)
    }
}
