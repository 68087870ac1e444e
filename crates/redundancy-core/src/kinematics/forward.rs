//! Forward kinematics: the product of placements and joint motions.

use super::trigonometry::sin_cos;
use crate::chain::{Chain, Link, Step};
use crate::error::{Error, Result};
use crate::pose::{Pose, pose};
use nalgebra::{Matrix3, Vector3};

/// Running frame of the forward pass, kept as columns: a joint turns only x and y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub x: Vector3<f64>,
    pub y: Vector3<f64>,
    pub z: Vector3<f64>,
    pub origin: Vector3<f64>,
}

impl Frame {
    /// The world frame.
    pub fn world() -> Self {
        Self { x: Vector3::x(), y: Vector3::y(), z: Vector3::z(), origin: Vector3::zeros() }
    }

    /// Moves by a constant transform.
    #[inline(always)]
    pub fn placed(&self, r: &Matrix3<f64>, t: &Vector3<f64>) -> Self {
        let along = |v: [f64; 3]| self.x * v[0] + self.y * v[1] + self.z * v[2];
        Self {
            x: along([r[(0, 0)], r[(1, 0)], r[(2, 0)]]),
            y: along([r[(0, 1)], r[(1, 1)], r[(2, 1)]]),
            z: along([r[(0, 2)], r[(1, 2)], r[(2, 2)]]),
            origin: self.origin + along([t.x, t.y, t.z]),
        }
    }

    /// Moves to the joint of `step`: its z is the joint axis, its origin a point on it.
    #[inline(always)]
    pub fn at_joint(&self, step: &Step) -> Self {
        self.placed(&step.rotation, &step.translation)
    }

    /// Moves by the joint itself.
    #[inline(always)]
    pub fn moved(mut self, step: &Step, q: f64) -> Self {
        if step.rotational {
            let (sin, cos) = sin_cos(q);
            let x = self.x * cos + self.y * sin;
            self.y = self.y * cos - self.x * sin;
            self.x = x;
        } else {
            self.origin += self.z * q;
        }
        self
    }

    /// The frame as a pose.
    #[inline(always)]
    pub fn pose(&self) -> Pose {
        pose(Matrix3::from_columns(&[self.x, self.y, self.z]), self.origin)
    }
}

impl Chain {
    /// Pose of the tool in the world at `q`.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    ///
    /// ```
    /// let arm = redundancy_core::chain::catalog::load("planar3r")?;
    /// let tip = arm.forward(&[0.0, std::f64::consts::FRAC_PI_2, 0.0])?;
    /// assert!((tip.translation.x - 3.0).abs() < 1e-15 && (tip.translation.y - 4.5).abs() < 1e-15);
    /// assert!(arm.forward(&[0.0, f64::NAN, 0.0]).is_err());
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn forward(&self, q: &[f64]) -> Result<Pose> {
        self.check_q(q)?;
        Ok(self.forward_unchecked(q))
    }

    /// Pose of the frame of a link (see [`Chain::link_index`]) in the world at `q`, without the tool.
    ///
    /// # Errors
    /// Wrong length of `q`, an entry that is not finite, an index that is no link.
    ///
    /// ```
    /// let arm = redundancy_core::chain::catalog::load("pa10")?;
    /// let elbow = arm.forward_link(&[0.0; 7], arm.link_index("link4")?)?;
    /// assert_eq!(elbow.translation.z, 0.315 + 0.45);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn forward_link(&self, q: &[f64], link: usize) -> Result<Pose> {
        self.check_q(q)?;
        let link = self.link(link)?;
        Ok(self.forward_link_unchecked(q, link))
    }

    /// The link with this index.
    pub(crate) fn link(&self, index: usize) -> Result<&Link> {
        self.links().get(index).ok_or_else(|| Error::OutOfRange {
            what: "link index".into(),
            value: index as f64,
            bound: format!("< {}", self.links().len()),
        })
    }

    /// [`Chain::forward_link`] for a `q` that was checked before.
    pub(crate) fn forward_link_unchecked(&self, q: &[f64], link: &Link) -> Pose {
        let mut frame = Frame::world();
        for (step, q) in self.steps().iter().zip(q).take(link.joints_before) {
            frame = frame.at_joint(step).moved(step, *q);
        }
        let out = match link.joints_before.checked_sub(1) {
            None => *self.base(),
            // Back from the z-aligned frame of the step to the frame that the joint moves.
            Some(i) => {
                let to_z = crate::chain::axis_onto_z(&self.joints()[i].axis);
                frame.placed(&to_z.transpose(), &Vector3::zeros()).pose()
            }
        };
        out * link.offset
    }

    /// [`Chain::forward`] for a `q` that was checked before.
    pub(crate) fn forward_unchecked(&self, q: &[f64]) -> Pose {
        let mut frame = Frame::world();
        for (step, q) in self.steps().iter().zip(q) {
            frame = frame.at_joint(step).moved(step, *q);
        }
        let (r, t) = self.end();
        frame.placed(r, t).pose()
    }
}
