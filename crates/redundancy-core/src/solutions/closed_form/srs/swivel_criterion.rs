//! Distance of the swivel from a desired one, to be minimised: `h = 1 - cos(s(q) - desired)`.
//!
//! With n from shoulder to wrist, W the wrist, and `z_k`, `o_k` the joint axes, the elbow turns about n and the chart of the
//! swivel is carried along with n:
//!
//! ```text
//! ds/dq_k = n . z_k [k <= 3]  -  (y x_k - x y_k) / (1 + z)           (x, y, z) = n and (x_k, y_k, z_k) = dn/dq_k in the chart's frame
//! dn/dq_k = (1 - n n^T) z_k x (W - o_k) / |W - S|  for the first four joints, else 0
//! ```
//!
//! The last term is the turn of the chart's zero direction; it is unbounded at the chart's singular direction `z = -1`.

use nalgebra::{DMatrix, Vector3};

use super::arm::SrsArm;
use crate::chain::Chain;
use crate::criterion::{Criterion, hessian_of_gradient};
use crate::error::{Result, check_finite};
use crate::kinematics::{Kinematics, Scratch};

/// Distance of the swivel from a desired angle: `1 - cos(s - desired)`, about half the squared difference, rad^2.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::Criterion, solutions::{SrsArm, SwivelCriterion}};
/// let arm = SrsArm::new(&catalog::load("iiwa14")?)?;
/// let q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4];
/// let h = SwivelCriterion::new(&arm, arm.swivel(&q)? + 0.1)?;
/// assert!((h.value(&q) - (1.0 - 0.1f64.cos())).abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SwivelCriterion {
    arm: SrsArm,
    desired: f64,
}

impl SwivelCriterion {
    /// `desired` in the arm's chart, rad.
    ///
    /// # Errors
    /// An angle that is not finite.
    pub fn new(arm: &SrsArm, desired: f64) -> Result<Self> {
        check_finite("desired swivel", &[desired])?;
        Ok(Self { arm: arm.clone(), desired })
    }

    /// Difference of the swivel from the desired one; 0 where `q` is not finite.
    fn difference(&self, q: &[f64]) -> f64 {
        self.arm.swivel(q).map_or(0.0, |s| s - self.desired)
    }

    /// Writes `ds/dq`.
    fn write_rates(&self, kinematics: &Kinematics<'_>, out: &mut [f64]) {
        let inner = &*self.arm.inner;
        let pose = kinematics.pose();
        let wrist = pose.rotation * inner.geometry.wrist_in_tool + pose.translation.vector;
        let across = wrist - inner.geometry.shoulder;
        let d = across.norm();
        out.fill(0.0);
        // Folded onto the shoulder the arm has no swivel.
        if d <= f64::MIN_POSITIVE {
            return;
        }
        let n = across / d;
        let at = inner.chart_frame.tr_mul(&n);
        // 1 + z without cancellation; at the singular direction itself the chart does not turn with n.
        let square = at.x * at.x + at.y * at.y;
        let above = if at.z > 0.0 { 1.0 + at.z } else { square / (1.0 - at.z) };
        for (k, out) in out.iter_mut().enumerate().take(4) {
            let axis: Vector3<f64> = kinematics.axes()[k];
            let moved = axis.cross(&(wrist - kinematics.origins()[k])) / d;
            let rate = inner.chart_frame.tr_mul(&(moved - n * n.dot(&moved)));
            let carried = if above > 0.0 { (at.y * rate.x - at.x * rate.y) / above } else { 0.0 };
            let turned = if k < 3 { n.dot(&axis) } else { 0.0 };
            *out = turned - carried;
        }
    }
}

impl Criterion for SwivelCriterion {
    fn dof(&self) -> usize {
        self.arm.chain().dof()
    }

    fn chain(&self) -> Option<&Chain> {
        Some(self.arm.chain())
    }

    fn value(&self, q: &[f64]) -> f64 {
        // 1 - cos x = 2 sin^2(x / 2), without cancellation.
        2.0 * (0.5 * self.difference(q)).sin().powi(2)
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let chain = self.arm.chain();
        let mut scratch = Scratch::new(chain);
        self.gradient_at(q, &chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        self.write_rates(kinematics, out);
        let sin = self.difference(q).sin();
        out.iter_mut().for_each(|rate| *rate *= sin);
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let chain = self.arm.chain();
        let mut scratch = Scratch::new(chain);
        hessian_of_gradient(
            |at, out| self.gradient_at(at, &chain.kinematics_unchecked(at, &mut scratch), out),
            q,
            out,
        );
    }
}
