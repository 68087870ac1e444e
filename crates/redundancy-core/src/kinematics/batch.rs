//! Many configurations at once, over the current pool, into memory of the caller.
//!
//! Rows are independent and each is computed by the same code as a single call, so the bits depend neither on the
//! number of threads nor on how the rows are cut into blocks.

use super::scratch::Scratch;
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};
use crate::parallel::prelude::*;
use crate::pose::pose_to_row_major;

/// Rows that one task of the pool takes at least: below it, handing work over costs more than the work.
const ROWS_PER_TASK: usize = 128;

impl Chain {
    /// Poses of the tool, or of a link (see [`Chain::link_index`]), at `N` configurations.
    ///
    /// `q` holds `N * dof` numbers, `poses` gets `N * 16`: homogeneous matrices, row by row.
    ///
    /// # Errors
    /// Lengths that do not fit, an entry of `q` that is not finite, an index that is no link.
    ///
    /// ```
    /// use redundancy_core::chain::catalog;
    /// let arm = catalog::load("planar3r")?;
    /// let mut poses = [0.0; 2 * 16];
    /// arm.forward_batch(&[0.0, 0.0, 0.0, 0.0, 1.0, 0.0], None, &mut poses)?;
    /// assert_eq!(poses[3], 7.5); // x of the first tip
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn forward_batch(&self, q: &[f64], link: Option<usize>, poses: &mut [f64]) -> Result<()> {
        let rows = self.check_batch(q)?;
        check_length("poses", poses, rows * 16)?;
        let link = link.map(|index| self.link(index)).transpose()?;
        let rows = q.par_chunks_exact(self.dof()).zip(poses.as_chunks_mut::<16>().0.par_iter_mut());
        rows.with_min_len(ROWS_PER_TASK).for_each(|(q, out)| {
            *out = pose_to_row_major(&match link {
                None => self.forward_unchecked(q),
                Some(link) => self.forward_link_unchecked(q, link),
            });
        });
        Ok(())
    }

    /// Jacobians at `N` configurations: `jacobians` gets `N * 6 * dof` numbers, each matrix row by row.
    ///
    /// # Errors
    /// Lengths that do not fit, or an entry of `q` that is not finite.
    pub fn jacobian_batch(&self, q: &[f64], jacobians: &mut [f64]) -> Result<()> {
        let rows = self.check_batch(q)?;
        check_length("jacobians", jacobians, rows * 6 * self.dof())?;
        let rows = q.par_chunks_exact(self.dof()).zip(jacobians.par_chunks_exact_mut(6 * self.dof()));
        rows.with_min_len(ROWS_PER_TASK).for_each_init(
            || Scratch::new(self),
            |scratch, (q, jacobian)| {
                self.kinematics_unchecked(q, scratch).write_jacobian(jacobian);
            },
        );
        Ok(())
    }

    /// Poses and Jacobians at `N` configurations, laid out as in [`Chain::forward_batch`] and
    /// [`Chain::jacobian_batch`].
    ///
    /// # Errors
    /// Lengths that do not fit, or an entry of `q` that is not finite.
    pub fn kinematics_batch(&self, q: &[f64], poses: &mut [f64], jacobians: &mut [f64]) -> Result<()> {
        let rows = self.check_batch(q)?;
        check_length("poses", poses, rows * 16)?;
        check_length("jacobians", jacobians, rows * 6 * self.dof())?;
        let out =
            poses.as_chunks_mut::<16>().0.par_iter_mut().zip(jacobians.par_chunks_exact_mut(6 * self.dof()));
        q.par_chunks_exact(self.dof()).zip(out).with_min_len(ROWS_PER_TASK).for_each_init(
            || Scratch::new(self),
            |scratch, (q, (pose, jacobian))| {
                let kinematics = self.kinematics_unchecked(q, scratch);
                *pose = pose_to_row_major(kinematics.pose());
                kinematics.write_jacobian(jacobian);
            },
        );
        Ok(())
    }

    /// Kinematic Hessians at `N` configurations: `hessians` gets `N * 6 * dof * dof` numbers, laid out as in
    /// [`Kinematics::write_hessian`](super::Kinematics::write_hessian).
    ///
    /// # Errors
    /// Lengths that do not fit, or an entry of `q` that is not finite.
    pub fn hessian_batch(&self, q: &[f64], hessians: &mut [f64]) -> Result<()> {
        let rows = self.check_batch(q)?;
        let size = 6 * self.dof() * self.dof();
        check_length("hessians", hessians, rows * size)?;
        let rows = q.par_chunks_exact(self.dof()).zip(hessians.par_chunks_exact_mut(size));
        rows.with_min_len(ROWS_PER_TASK).for_each_init(
            || Scratch::new(self),
            |scratch, (q, hessian)| self.kinematics_unchecked(q, scratch).write_hessian(hessian),
        );
        Ok(())
    }

    /// Checks the rows of a batch and counts them.
    pub(crate) fn check_batch(&self, q: &[f64]) -> Result<usize> {
        if !q.len().is_multiple_of(self.dof()) {
            let expected = q.len().div_ceil(self.dof()) * self.dof();
            return Err(Error::Length { what: "batch of q".into(), expected, actual: q.len() });
        }
        check_finite("batch of q", q)?;
        Ok(q.len() / self.dof())
    }
}
