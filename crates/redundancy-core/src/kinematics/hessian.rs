//! Kinematic Hessian: how the columns of the Jacobian change with the joints.
//!
//! With `w_k` the axis of a turning joint (zero for a sliding one) and `v_k` the linear part of column k, joint k
//! carries everything after it. For `k < j` it turns column j as a whole; for `k >= j` it only moves the tool:
//!
//! ```text
//! d v_j / d q_k = w_min(j,k) x v_max(j,k)          d w_j / d q_k = w_k x w_j  for k < j, else 0
//! ```
//!
//! The linear part is symmetric in j and k, the angular part is not: angular velocity is no gradient. Cost for seven
//! joints: about 0.15 us beyond the Jacobian.

use nalgebra::Vector3;

use super::scratch::{Kinematics, Scratch};
use crate::chain::Chain;
use crate::error::Result;

impl Kinematics<'_> {
    /// `d J[:, j] / d q_k`: the linear and the angular part.
    #[inline(always)]
    pub fn jacobian_derivative(&self, j: usize, k: usize) -> (Vector3<f64>, Vector3<f64>) {
        let (first, last) = (j.min(k), j.max(k));
        let linear = self.angular(first).cross(&self.linear(last));
        let angular = if k < j { self.angular(k).cross(&self.angular(j)) } else { Vector3::zeros() };
        (linear, angular)
    }

    /// `d2 J[:, j] / d q_k d q_l`: the linear and the angular part. The linear part is the third derivative of the
    /// tool's position and does not see the order of the three indices; sorted `a <= b <= c`, it is
    /// `w_a x (w_b x v_c)`. The angular part is `w_a x (w_b x w_j)` for `a <= b < j`, else zero.
    #[inline(always)]
    pub fn jacobian_second_derivative(&self, j: usize, k: usize, l: usize) -> (Vector3<f64>, Vector3<f64>) {
        let mut sorted = [j, k, l];
        sorted.sort_unstable();
        let [a, b, c] = sorted;
        let linear = self.angular(a).cross(&self.angular(b).cross(&self.linear(c)));
        let (first, second) = (k.min(l), k.max(l));
        let angular = if second < j {
            self.angular(first).cross(&self.angular(second).cross(&self.angular(j)))
        } else {
            Vector3::zeros()
        };
        (linear, angular)
    }

    /// Linear part of column `j` of the Jacobian.
    #[inline(always)]
    pub fn linear(&self, j: usize) -> Vector3<f64> {
        self.jacobian().fixed_view::<3, 1>(0, j).into_owned()
    }

    /// Angular part of column `j` of the Jacobian: the axis of a turning joint, zero for a sliding one.
    #[inline(always)]
    pub fn angular(&self, j: usize) -> Vector3<f64> {
        self.jacobian().fixed_view::<3, 1>(3, j).into_owned()
    }

    /// Writes the Hessian `(6, n, n)` as numpy lays it out: `out[(row n + j) n + k] = d J[row, j] / d q_k`.
    ///
    /// # Panics
    /// Never; entries beyond the end of `out` are left out.
    pub fn write_hessian(&self, out: &mut [f64]) {
        let n = self.jacobian().ncols();
        for j in 0..n {
            for k in 0..n {
                let (linear, angular) = self.jacobian_derivative(j, k);
                for row in 0..3 {
                    for (part, row) in [(linear[row], row), (angular[row], row + 3)] {
                        if let Some(entry) = out.get_mut((row * n + j) * n + k) {
                            *entry = part;
                        }
                    }
                }
            }
        }
    }
}

impl Chain {
    /// Kinematic Hessian at `q` as `6 n^2` numbers, see [`Kinematics::write_hessian`]. Allocates its result.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    ///
    /// ```
    /// let arm = redundancy_core::chain::catalog::load("planar3r")?;
    /// let h = arm.hessian(&[0.0; 3])?;
    /// assert_eq!(h[0], -7.5); // turning joint 1 bends the velocity that it gives the tip, towards the axis
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn hessian(&self, q: &[f64]) -> Result<Vec<f64>> {
        let mut scratch = Scratch::new(self);
        let mut out = vec![0.0; 6 * self.dof() * self.dof()];
        self.kinematics(q, &mut scratch)?.write_hessian(&mut out);
        Ok(out)
    }
}
