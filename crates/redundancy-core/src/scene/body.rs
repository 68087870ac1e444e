//! A solid that a chain carries: where it is, and how its distance from others changes with the joints.

use nalgebra::Vector3;

use super::core_shape::Core;
use super::narrow::{Gap, Placement};
use super::solid::{Form, Rod, Solid};
use crate::chain::{Chain, JointKind, axis_onto_z};
use crate::error::Result;
use crate::kinematics::Kinematics;
use crate::pose::pose;
use crate::tolerance::SCENE_SIZE;

/// A solid on a chain.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Body {
    /// Whose it is: an index in a list of names.
    pub owner: usize,
    /// How many joints move it; 0 for what stands with the base.
    pub joints_before: usize,
    /// In the frame that the last of these joints moves, with z along its axis; in the world without any.
    pub solid: Solid,
    /// The last joint slides and the body is drawn out by it: its near end stays.
    pub telescope: bool,
    /// How far a point of it moves at most per unit of each of these joints, m.
    pub reach: Vec<f64>,
}

impl Body {
    /// A solid fixed to a link of a chain, given in the frame of that link.
    pub fn on_link(chain: &Chain, link: usize, owner: usize, solid: Solid) -> Result<Self> {
        let frame = chain.link(link)?;
        let to_world = match frame.joints_before.checked_sub(1) {
            None => *chain.base() * frame.offset,
            Some(last) => {
                pose(axis_onto_z(&chain.joints()[last].axis).transpose(), Vector3::zeros()) * frame.offset
            }
        };
        Ok(Self::in_frame(chain, frame.joints_before, owner, solid.placed(&to_world), false))
    }

    /// The capsule from the origin of a joint to that of the next one, or to the tool.
    pub fn behind_joint(chain: &Chain, joint: usize, owner: usize, radius: f64) -> Self {
        let end = chain.steps().get(joint + 1).map_or(*chain.end().1, |next| next.translation);
        let telescope = chain.joints()[joint].kind == JointKind::Prismatic;
        Self::in_frame(chain, joint + 1, owner, Solid::capsule(&Vector3::zeros(), &end, radius), telescope)
    }

    /// A solid in the frame that joint `joints_before - 1` moves.
    pub fn in_frame(
        chain: &Chain,
        joints_before: usize,
        owner: usize,
        solid: Solid,
        telescope: bool,
    ) -> Self {
        let mut body = Self { owner, joints_before, solid, telescope, reach: Vec::new() };
        body.reach = body.reach_of(chain);
        body
    }

    /// How far from each joint's axis a point of it can be, over all configurations.
    fn reach_of(&self, chain: &Chain) -> Vec<f64> {
        let slide = |joint: usize| {
            let limits = &chain.joints()[joint].limits;
            match chain.joints()[joint].kind {
                JointKind::Prismatic => limits.lower.abs().max(limits.upper.abs()).min(SCENE_SIZE),
                _ => 0.0,
            }
        };
        let rod = &self.solid.rod;
        let ends = [rod.start, rod.end];
        let mut reach = vec![0.0; self.joints_before];
        // From the origin of the frame to the furthest point.
        let mut beyond = ends.iter().map(Vector3::norm).fold(0.0, f64::max) + rod.radius;
        for joint in (0..self.joints_before).rev() {
            let last = joint + 1 == self.joints_before;
            reach[joint] = match chain.joints()[joint].kind {
                JointKind::Prismatic => 1.0,
                _ if last => ends.iter().map(|p| p.x.hypot(p.y)).fold(0.0, f64::max) + rod.radius,
                _ => beyond,
            };
            beyond += slide(joint) + chain.steps()[joint].translation.norm();
        }
        reach
    }

    /// Where its frame is.
    #[inline(always)]
    pub fn placement(&self, kinematics: &Kinematics<'_>) -> Placement {
        match self.joints_before.checked_sub(1) {
            None => Placement::world(),
            Some(last) => {
                let (rotation, origin) = kinematics.frame(last);
                Placement { rotation, origin }
            }
        }
    }

    /// Itself in the world, where it is drawn out by its joint.
    pub fn drawn_out(&self, kinematics: &Kinematics<'_>) -> Option<Solid> {
        let last = self.joints_before.checked_sub(1).filter(|_| self.telescope)?;
        let origins = kinematics.origins();
        let end = origins.get(last + 1).unwrap_or(&kinematics.pose().translation.vector);
        Some(Solid::capsule(&origins[last], end, self.solid.radius))
    }

    /// The capsule around it in the world.
    #[inline(always)]
    pub fn rod(&self, kinematics: &Kinematics<'_>) -> Rod {
        if self.telescope
            && let Some(solid) = self.drawn_out(kinematics)
        {
            return solid.rod;
        }
        match self.joints_before.checked_sub(1) {
            None => self.solid.rod,
            Some(last) => {
                let (rotation, origin) = kinematics.frame(last);
                Placement { rotation, origin }.rod(&self.solid.rod)
            }
        }
    }

    /// Adds `factor` times the change of the distance per joint to `out`: of this body's joints from `from` on, where it is the
    /// first of the gap. For the second `factor` is negative.
    #[inline(always)]
    pub fn add_gradient(
        &self,
        kinematics: &Kinematics<'_>,
        gap: &Gap,
        from: usize,
        factor: f64,
        out: &mut [f64],
    ) {
        let (origins, axes, columns) = (kinematics.origins(), kinematics.axes(), kinematics.jacobian());
        let force = gap.gradient * factor;
        for j in from..self.joints_before.min(out.len()) {
            // A sliding joint has no angular part.
            let turns = columns[(3, j)] != 0.0 || columns[(4, j)] != 0.0 || columns[(5, j)] != 0.0;
            out[j] += if turns {
                axes[j].cross(&(gap.at - origins[j])).dot(&force)
            } else if self.telescope && j + 1 == self.joints_before {
                let end = origins.get(j + 1).unwrap_or(&kinematics.pose().translation.vector);
                let axis = end - origins[j];
                let square = axis.norm_squared();
                let share = if square > 0.0 { (gap.at - origins[j]).dot(&axis) / square } else { 0.0 };
                share.clamp(0.0, 1.0) * axes[j].dot(&force)
            } else {
                axes[j].dot(&force)
            };
        }
    }

    /// Whether it is round about its axis, so that nothing but the place of the axis counts.
    pub fn is_capsule(&self) -> bool {
        matches!(self.solid.form, Form::Convex(Core::Point | Core::Segment(_)))
    }
}
