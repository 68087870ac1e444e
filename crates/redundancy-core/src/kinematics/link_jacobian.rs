//! The Jacobian of a point of any link, written in the axes of any frame.
//!
//! For a point `p` that moves with a link, column i of a joint before it is `[z_i x (p - o_i); z_i]` where it turns and
//! `[z_i; 0]` where it slides; joints after the link do not move it. Both halves are then written in the axes of the frame
//! that is asked for. The motion is always the one relative to the base: the frame chooses the axes, not the observer.
//!
//! | link | frame | pinocchio's reference frame |
//! |---|---|---|
//! | any | base | `LOCAL_WORLD_ALIGNED` |
//! | tool | tool | `LOCAL` of the tool |
//! | a link | the same link | `LOCAL` of the link |
//!
//! Cost for seven joints: that of [`Chain::kinematics`] and about 0.1 us. Nothing allocates but [`Chain::jacobian_of`].

use crate::parallel::prelude::*;
use nalgebra::{Dyn, Matrix3, Matrix6xX, Vector3};

use super::scratch::{Kinematics, Scratch};
use crate::chain::{Chain, axis_onto_z};
use crate::error::{Error, Result, check_finite, check_length};
use crate::pose::{Pose, pose};

/// Rows that one task of the pool takes at least: below it, handing work over costs more than the work.
const ROWS_PER_TASK: usize = 128;

/// Axes in which a Jacobian is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JacobianFrame {
    /// World axes: those in which the chain's base is placed.
    #[default]
    Base,
    /// Axes of the tool.
    Tool,
    /// Axes of the link with this index, see [`Chain::link_index`].
    Link(usize),
}

/// Whose motion a Jacobian describes, and in which axes. The default is the tool's origin in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JacobianOf {
    /// The link that carries the point, see [`Chain::link_index`]; `None` is the tool.
    pub link: Option<usize>,
    /// The point in the frame of that link (or of the tool), m.
    pub point: Vector3<f64>,
    /// The axes of both halves.
    pub frame: JacobianFrame,
}

impl Default for JacobianOf {
    fn default() -> Self {
        Self { link: None, point: Vector3::zeros(), frame: JacobianFrame::Base }
    }
}

impl Kinematics<'_> {
    /// Pose of a link of `chain`, to which these kinematics belong.
    pub(super) fn link_pose(&self, chain: &Chain, index: usize) -> Option<Pose> {
        let link = chain.links().get(index)?;
        let moved = match link.joints_before.checked_sub(1) {
            None => *chain.base(),
            Some(last) => {
                let (rotation, origin) = self.frame(last);
                let to_z = axis_onto_z(&chain.joints().get(last)?.axis);
                pose(rotation * to_z.transpose(), origin)
            }
        };
        Some(moved * link.offset)
    }

    /// Pose of a link of `chain` (`None` is the tool), and the Jacobian `(6, n)` of its origin column by column, world axes.
    /// An unknown link is taken for the tool.
    pub(crate) fn write_link_columns(&self, chain: &Chain, link: Option<usize>, out: &mut [f64]) -> Pose {
        let found = link.and_then(|index| self.link_pose(chain, index).zip(chain.links().get(index)));
        let Some((pose, link)) = found else {
            out.copy_from_slice(self.jacobian().as_slice());
            return *self.pose();
        };
        out.fill(0.0);
        let point = pose.translation.vector;
        let columns = chain.steps().iter().zip(self.origins()).zip(self.axes()).take(link.joints_before);
        for (((step, origin), axis), out) in columns.zip(out.as_chunks_mut::<6>().0) {
            let (linear, angular) = match step.rotational {
                true => (axis.cross(&(point - origin)), *axis),
                false => (*axis, Vector3::zeros()),
            };
            *out = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
        }
        pose
    }

    /// Writes the Jacobian row by row, as numpy lays it out. An unknown link leaves `out` as it is.
    fn write_jacobian_of(&self, chain: &Chain, of: &JacobianOf, out: &mut [f64]) {
        let n = chain.dof();
        let (carrier, joints) = match of.link {
            None => (*self.pose(), n),
            Some(index) => match (self.link_pose(chain, index), chain.links().get(index)) {
                (Some(pose), Some(link)) => (pose, link.joints_before),
                _ => return,
            },
        };
        let point = carrier.rotation * of.point + carrier.translation.vector;
        let axes: Matrix3<f64> = match of.frame {
            JacobianFrame::Base => Matrix3::identity(),
            JacobianFrame::Tool => *self.pose().rotation.matrix(),
            JacobianFrame::Link(index) => match self.link_pose(chain, index) {
                Some(pose) => *pose.rotation.matrix(),
                None => return,
            },
        };
        out.fill(0.0);
        let columns = chain.steps().iter().zip(self.origins()).zip(self.axes()).take(joints);
        for (j, ((step, origin), axis)) in columns.enumerate() {
            let (linear, angular) = match step.rotational {
                true => (axis.cross(&(point - origin)), *axis),
                false => (*axis, Vector3::zeros()),
            };
            let halves = [axes.tr_mul(&linear), axes.tr_mul(&angular)];
            for (half, values) in halves.iter().enumerate() {
                for (row, value) in values.iter().enumerate() {
                    out[(3 * half + row) * n + j] = *value;
                }
            }
        }
    }
}

impl Chain {
    /// Geometric Jacobian `(6, n)` of a point of a link at `q`, linear rows first. Allocates its result.
    ///
    /// # Errors
    /// Wrong length of `q`, a number that is not finite, an index that is no link.
    ///
    /// ```
    /// use redundancy_core::kinematics::{JacobianFrame, JacobianOf};
    /// let arm = redundancy_core::chain::catalog::load("planar3r")?;
    /// let of = JacobianOf { link: Some(arm.link_index("link2")?), ..JacobianOf::default() };
    /// let q = [0.3, 0.0, 0.2];
    /// assert_eq!(arm.jacobian_of(&q, &of)?.column(2).norm(), 0.0); // joint 3 does not move link 2
    /// let body = arm.jacobian_of(&q, &JacobianOf { frame: JacobianFrame::Link(2), ..of })?;
    /// assert!((body[(1, 0)] - 5.5).abs() < 1e-15 && body[(0, 0)].abs() < 1e-15); // across its own x
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn jacobian_of(&self, q: &[f64], of: &JacobianOf) -> Result<Matrix6xX<f64>> {
        let mut rows = vec![0.0; 6 * self.dof()];
        self.write_jacobian_of(q, of, &mut Scratch::new(self), &mut rows)?;
        Ok(Matrix6xX::from_row_slice_generic(nalgebra::Const::<6>, Dyn(self.dof()), &rows))
    }

    /// [`jacobian_of`](Self::jacobian_of) into memory of the caller, `6 * n` numbers row by row; allocates nothing.
    ///
    /// # Errors
    /// As [`jacobian_of`](Self::jacobian_of); lengths that do not fit.
    pub fn write_jacobian_of(
        &self,
        q: &[f64],
        of: &JacobianOf,
        scratch: &mut Scratch,
        jacobian: &mut [f64],
    ) -> Result<()> {
        self.check_jacobian_of(of)?;
        check_length("jacobian", jacobian, 6 * self.dof())?;
        self.kinematics(q, scratch)?.write_jacobian_of(self, of, jacobian);
        Ok(())
    }

    /// [`jacobian_of`](Self::jacobian_of) at `N` configurations: `jacobians` gets `N * 6 * dof` numbers, each matrix row by
    /// row. Runs on the current rayon pool.
    ///
    /// # Errors
    /// As [`jacobian_of`](Self::jacobian_of); lengths that do not fit.
    pub fn jacobian_of_batch(&self, q: &[f64], of: &JacobianOf, jacobians: &mut [f64]) -> Result<()> {
        self.check_jacobian_of(of)?;
        let (rows, size) = (self.check_batch(q)?, 6 * self.dof());
        check_length("jacobians", jacobians, rows * size)?;
        let rows = q.par_chunks_exact(self.dof()).zip(jacobians.par_chunks_exact_mut(size));
        rows.with_min_len(ROWS_PER_TASK).for_each_init(
            || Scratch::new(self),
            |scratch, (q, out)| self.kinematics_unchecked(q, scratch).write_jacobian_of(self, of, out),
        );
        Ok(())
    }

    fn check_jacobian_of(&self, of: &JacobianOf) -> Result<()> {
        check_finite("point", of.point.as_slice())?;
        let frame = match of.frame {
            JacobianFrame::Link(index) => Some(index),
            JacobianFrame::Base | JacobianFrame::Tool => None,
        };
        match [of.link, frame].into_iter().flatten().find(|index| *index >= self.links().len()) {
            None => Ok(()),
            Some(index) => Err(Error::OutOfRange {
                what: "link index".into(),
                value: index as f64,
                bound: format!("< {}", self.links().len()),
            }),
        }
    }
}
