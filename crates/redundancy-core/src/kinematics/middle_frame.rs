//! A task in a middle frame: the six coordinates of the tool's motion in the axes and about the origin of a link.
//!
//! With `r` from the origin of the link to the tool's, `R` the link's axes in the world and `T` the matrix that makes an
//! angular velocity of the rates of roll-pitch-yaw [Bettini2000, eq. (7)]:
//!
//! ```text
//! [v_k]   [R^T  R^T S T]                       [R^T  R^T S]
//! [w_k] = [ 0     R^T T] (x', rates)     J_k = [ 0     R^T] J        S = skew(r)
//! ```
//!
//! In print S has the opposite sign, and "R from the fourth to the base frame" is the matrix that maps base to fourth.
//! The velocity is that of the point of the *tool* that is at the link's origin now; all joints move it.
//!
//! The joint velocities that meet a task do not depend on the coordinates. Singular values do: a rotation keeps them, a
//! change of the reference point does not, since it adds metres of an angular velocity to a linear one. Whatever depends on
//! them (damping, its threshold, the choice of a basis) therefore acts differently in a middle frame.

use nalgebra::{Matrix3, Vector3, Vector6};

use super::scratch::Kinematics;
use super::task::{Task, TaskKind};
use crate::chain::Chain;
use crate::error::{Error, Result};

/// Coordinates of a full task in the axes and about the origin of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MiddleFrame {
    link: usize,
}

impl MiddleFrame {
    /// The frame of the link with this index, see [`Chain::link_index`], for `task`.
    ///
    /// # Errors
    /// A task other than `pose` and `pose_rpy`, an index that is no link.
    ///
    /// ```
    /// use redundancy_core::{chain::catalog, kinematics::{MiddleFrame, Task}};
    /// let arm = catalog::load("dexter")?;
    /// let fourth = MiddleFrame::new(&arm, &Task::POSE_RPY, arm.link_index("link4")?)?;
    /// let q = [40f64, 0.0, 90.0, 180.0, -90.0, 180.0, -90.0, 0.0].map(f64::to_radians);
    /// let j = fourth.jacobian(&arm, &q)?;
    /// assert!((j[(1, 2)] + 0.1 * q[3].cos()).abs() < 1e-15); // -a3 c3 of the printed matrix
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn new(chain: &Chain, task: &Task, link: usize) -> Result<Self> {
        if !matches!(task.kind(), TaskKind::Pose | TaskKind::PoseRpy) {
            let message = format!(
                "a middle frame needs all six coordinates, the tasks 'pose' and 'pose_rpy', not '{task}'"
            );
            return Err(Error::Invalid(message));
        }
        let links = chain.links().len();
        if link >= links {
            let bound = format!("< {links}");
            return Err(Error::OutOfRange { what: "link index".into(), value: link as f64, bound });
        }
        Ok(Self { link })
    }

    /// The index of the link.
    pub fn link(&self) -> usize {
        self.link
    }

    /// The Jacobian `(6, n)` at `q`. Allocates its result.
    ///
    /// # Errors
    /// Wrong length of `q`, a number that is not finite.
    pub fn jacobian(&self, chain: &Chain, q: &[f64]) -> Result<nalgebra::Matrix6xX<f64>> {
        let mut scratch = super::Scratch::new(chain);
        let kinematics = chain.kinematics(q, &mut scratch)?;
        let mut out = nalgebra::Matrix6xX::zeros_generic(nalgebra::Const::<6>, nalgebra::Dyn(chain.dof()));
        self.write_jacobian(chain, &kinematics, out.as_mut_slice());
        Ok(out)
    }

    /// Writes the Jacobian column by column.
    pub(crate) fn write_jacobian(&self, chain: &Chain, kinematics: &Kinematics<'_>, out: &mut [f64]) {
        let (axes, r) = self.place(chain, kinematics);
        let columns = kinematics.jacobian().as_slice().as_chunks::<6>().0;
        for (out, column) in out.as_chunks_mut::<6>().0.iter_mut().zip(columns) {
            *out = seen(&axes, &r, &Vector6::from(*column)).into();
        }
    }

    /// A velocity in the coordinates of `task` in those of this frame.
    pub(crate) fn velocity(
        &self,
        chain: &Chain,
        kinematics: &Kinematics<'_>,
        task: &Task,
        coordinates: &Vector6<f64>,
    ) -> Vector6<f64> {
        let (axes, r) = self.place(chain, kinematics);
        seen(&axes, &r, &task.twist(kinematics.pose(), coordinates))
    }

    /// Axes of the link in the world, and the way from its origin to the tool's.
    fn place(&self, chain: &Chain, kinematics: &Kinematics<'_>) -> (Matrix3<f64>, Vector3<f64>) {
        let tool = kinematics.pose();
        let link = kinematics.link_pose(chain, self.link).unwrap_or(*tool);
        (*link.rotation.matrix(), tool.translation.vector - link.translation.vector)
    }
}

/// A velocity of the tool, seen from a frame with these axes whose origin is at `-r` from the tool.
fn seen(axes: &Matrix3<f64>, r: &Vector3<f64>, twist: &Vector6<f64>) -> Vector6<f64> {
    let (linear, angular) = (twist.fixed_rows::<3>(0), twist.fixed_rows::<3>(3));
    let moved = axes.tr_mul(&(linear + r.cross(&angular)));
    let turned = axes.tr_mul(&angular);
    Vector6::new(moved.x, moved.y, moved.z, turned.x, turned.y, turned.z)
}
