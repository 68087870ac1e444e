//! Geometric Jacobian, in the same pass as the pose.
//!
//! Column of a turning joint: `[z x (p - o); z]`; of a sliding joint: `[z; 0]`, with the axis `z`, a point `o` on it
//! and the tool at `p`, all in the world. cost for seven joints: about 0.23 us.

use nalgebra::{Matrix6xX, Vector6};

use super::forward::Frame;
use super::scratch::{Kinematics, Scratch};
use crate::chain::Chain;
use crate::error::{Error, Result};

impl Chain {
    /// Pose and Jacobian at `q` at the cost of one pass; allocates nothing.
    ///
    /// # Errors
    /// Wrong length of `q`, an entry that is not finite, a scratch made for another number of joints.
    ///
    /// ```
    /// use redundancy_core::{chain::catalog, kinematics::Scratch};
    /// let arm = catalog::load("planar3r")?;
    /// let mut scratch = Scratch::new(&arm); // once, outside of the control loop
    /// let kinematics = arm.kinematics(&[0.0; 3], &mut scratch)?;
    /// assert_eq!(kinematics.pose().translation.x, 7.5);
    /// assert_eq!(kinematics.jacobian()[(1, 0)], 7.5); // turning joint 1 moves the tip along y
    /// assert_eq!(kinematics.jacobian()[(5, 2)], 1.0); // and every joint turns it about z
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn kinematics<'a>(&self, q: &[f64], scratch: &'a mut Scratch) -> Result<Kinematics<'a>> {
        self.check_q(q)?;
        if scratch.dof() != self.dof() {
            let (expected, actual) = (self.dof(), scratch.dof());
            return Err(Error::Length { what: "scratch".into(), expected, actual });
        }
        Ok(self.kinematics_unchecked(q, scratch))
    }

    /// [`Chain::kinematics`] for arguments that were checked before.
    pub(crate) fn kinematics_unchecked<'a>(&self, q: &[f64], scratch: &'a mut Scratch) -> Kinematics<'a> {
        let mut frame = Frame::world();
        let memory = scratch.origins.iter_mut().zip(scratch.axes.iter_mut()).zip(scratch.frames.iter_mut());
        for ((step, q), ((origin, axis), moved)) in self.steps().iter().zip(q).zip(memory) {
            let at = frame.at_joint(step);
            *origin = at.origin;
            *axis = at.z;
            frame = at.moved(step, *q);
            *moved = frame;
        }
        let (r, t) = self.end();
        let tool = frame.placed(r, t);
        let columns = scratch.jacobian.as_mut_slice().as_chunks_mut::<6>().0.iter_mut();
        for (((step, origin), axis), column) in
            self.steps().iter().zip(&scratch.origins).zip(&scratch.axes).zip(columns)
        {
            *column = if step.rotational {
                let v = axis.cross(&(tool.origin - origin));
                [v.x, v.y, v.z, axis.x, axis.y, axis.z]
            } else {
                [axis.x, axis.y, axis.z, 0.0, 0.0, 0.0]
            };
        }
        scratch.pose = tool.pose();
        Kinematics::new(scratch)
    }

    /// Geometric Jacobian `(6, n)` at `q`, linear rows first, world axes at the tool. Allocates its result.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn jacobian(&self, q: &[f64]) -> Result<Matrix6xX<f64>> {
        let mut scratch = Scratch::new(self);
        Ok(self.kinematics(q, &mut scratch)?.jacobian().clone())
    }

    /// Velocity of the tool (linear, angular) for joint velocities `qd` at `q`.
    ///
    /// # Errors
    /// Wrong length of `q` or `qd`, or an entry that is not finite.
    ///
    /// ```
    /// let arm = redundancy_core::chain::catalog::load("planar3r")?;
    /// let v = arm.tool_velocity(&[0.0; 3], &[1.0, 0.0, 0.0])?;
    /// assert_eq!(v.as_slice(), [0.0, 7.5, 0.0, 0.0, 0.0, 1.0]);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn tool_velocity(&self, q: &[f64], qd: &[f64]) -> Result<Vector6<f64>> {
        crate::error::check_vector("qd", qd, self.dof())?;
        let jacobian = self.jacobian(q)?;
        Ok(jacobian.column_iter().zip(qd).fold(Vector6::zeros(), |sum, (column, qd)| sum + column * *qd))
    }
}
