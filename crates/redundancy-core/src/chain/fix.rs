//! Chains with a joint taken out: what is left when a spare joint is held.

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::builder::ChainBuilder;
use super::chain::Chain;
use super::joint::{Joint, JointKind};
use crate::error::{Error, Result, check_finite};
use crate::pose::Pose;

/// Pose of the frame that a joint moves, in its own.
fn motion(joint: &Joint, q: f64) -> Pose {
    match joint.kind {
        JointKind::Prismatic => {
            Pose::from_parts(Translation3::from(*joint.axis * q), nalgebra::Rotation3::identity())
        }
        _ => {
            let turn = UnitQuaternion::from_axis_angle(&joint.axis, q).to_rotation_matrix();
            Pose::from_parts(Translation3::from(Vector3::zeros()), turn)
        }
    }
}

impl Chain {
    /// The same arm with one of its joints held at `q` (rad or m): one joint less, the same links and the same tool.
    ///
    /// # Errors
    /// A joint that does not exist, the only joint, a position that is not finite.
    ///
    /// ```
    /// use redundancy_core::chain::catalog;
    /// let arm = catalog::load("iiwa14")?;
    /// let held = arm.with_joint_held(2, 0.3)?;
    /// let (whole, rest) = ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7], [0.1, 0.2, 0.4, 0.5, 0.6, 0.7]);
    /// let (a, b) = (arm.forward(&whole)?, held.forward(&rest)?);
    /// assert!((a.to_homogeneous() - b.to_homogeneous()).amax() < 1e-14);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn with_joint_held(&self, joint: usize, q: f64) -> Result<Self> {
        check_finite("position of the held joint", &[q])?;
        let Some(held) = self.joints().get(joint).filter(|_| self.dof() > 1) else {
            let bound = format!("below {}, the number of joints, of which one must be left", self.dof());
            return Err(Error::OutOfRange { what: "held joint".into(), value: joint as f64, bound });
        };
        let fixed = held.placement * motion(held, q);
        let first = self.links().first().map_or("base", |link| link.name.as_str());
        let mut builder = ChainBuilder::new(self.name(), first);
        let mut links = self.links().iter().skip(1).peekable();
        for after in 0..=self.dof() {
            while let Some(link) = links.next_if(|link| link.joints_before == after) {
                let carried = after == joint + 1;
                builder =
                    builder.link(link.name.as_str(), if carried { fixed * link.offset } else { link.offset });
            }
            if let Some(next) = self.joints().get(after).filter(|_| after != joint) {
                let placement = if after == joint + 1 { fixed * next.placement } else { next.placement };
                let axis = next.axis.into_inner();
                builder = builder.joint(next.name.as_str(), next.kind, placement, axis, next.limits);
            }
        }
        if let Some(inertias) = self.inertias() {
            let mut bodies = inertias.to_vec();
            let body = bodies.remove(joint);
            if let Some(before) = joint.checked_sub(1) {
                bodies[before] = bodies[before].combined(&body.moved(&fixed));
            }
            builder = builder.inertias(bodies);
        }
        builder.base(*self.base()).tool(*self.tool()).build()
    }
}
