//! The arm as rounded segments: what of it can touch an obstacle.

use std::path::Path;

use nalgebra::Vector3;

use super::distance::Nearest;
use crate::chain::{Chain, CollisionBody, CollisionShape, JointKind, axis_onto_z};
use crate::error::{Error, Result, check_finite};
use crate::kinematics::Kinematics;
use crate::pose::Pose;
use crate::tolerance::LINK_LENGTH;

/// A segment with a radius that moves with the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkCapsule {
    /// Index of its link in [`Chain::links`].
    pub link: usize,
    /// How many joints move it.
    pub joints_before: usize,
    /// Radius, m.
    pub radius: f64,
    pub(super) ends: Ends,
}

/// Where the ends of a segment are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Ends {
    /// From the origin of the last joint that moves it to that of the next one, or to the tool.
    Joints,
    /// As Joints, where the last joint slides: the link is a telescope whose near end does not move with it.
    Telescope,
    /// Points of the frame that the last joint moves.
    Carried(Vector3<f64>, Vector3<f64>),
}

/// The segments of an arm; none by default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LinkGeometry {
    capsules: Vec<LinkCapsule>,
}

impl LinkGeometry {
    /// Capsules of one radius from joint to joint and from the last joint to the tool; none from the base to the first
    /// joint, which nothing moves. Neighbouring joints at the same place have no link between them that could touch
    /// something before they do.
    ///
    /// # Errors
    /// A radius that is negative or not finite.
    pub fn joint_to_joint(chain: &Chain, radius: f64) -> Result<Self> {
        check_radius(radius)?;
        let n = chain.dof();
        let length = |joint: usize| match chain.joints().get(joint + 1) {
            Some(next) => next.placement.translation.vector.norm(),
            None => {
                let tip = chain.links().last().map_or_else(Pose::identity, |link| link.offset);
                (tip * chain.tool()).translation.vector.norm()
            }
        };
        let slides = |joint: usize| chain.joints()[joint].kind == JointKind::Prismatic;
        let mut joints: Vec<usize> = (0..n).filter(|j| slides(*j) || length(*j) > LINK_LENGTH).collect();
        if joints.is_empty() {
            joints = (0..n).collect();
        }
        Ok(Self { capsules: joints.into_iter().map(|joint| capsule(chain, joint, radius)).collect() })
    }

    /// The primitive collision geometry of a URDF file, each body as the capsule around it: see
    /// [`LinkGeometry::of_bodies`].
    ///
    /// # Errors
    /// As of [`Chain::collision_from_urdf`], and a URDF without any collision geometry on the moving links.
    #[cfg(feature = "urdf")]
    pub fn from_urdf(chain: &Chain, path: impl AsRef<Path>) -> Result<Self> {
        Self::of_bodies(chain, &chain.collision_from_urdf(path)?)
    }

    /// Collision bodies of the moving links, each as the capsule around it. Spheres and capsules are exact; a cylinder gets
    /// half a ball on each end, a box the least capsule along its longest edge that holds it: never too small, so what
    /// is clear is clear.
    ///
    /// # Errors
    /// No body, sizes that are not finite.
    ///
    /// ```
    /// use redundancy_core::chain::{Chain, MissingLimits};
    /// use redundancy_core::scene::LinkGeometry;
    /// let xml = r#"<robot name="r"> <link name="a"/>
    ///   <link name="b"><collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
    ///   <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
    /// </robot>"#;
    /// let chain = Chain::from_urdf_string(xml, None, None, MissingLimits::Refuse)?;
    /// let arm = LinkGeometry::of_bodies(&chain, &chain.collision_from_urdf_string(xml)?)?;
    /// assert_eq!((arm.capsules().len(), arm.capsules()[0].radius), (1, 0.05));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn of_bodies(chain: &Chain, bodies: &[CollisionBody]) -> Result<Self> {
        if bodies.is_empty() {
            return Err(Error::Description(format!(
                "the moving links of '{}' have no collision geometry; give them a radius instead",
                chain.name()
            )));
        }
        bodies.iter().try_fold(Self::default(), |all, body| {
            let (start, end, radius) = Self::capsule_around(body);
            all.with_capsule(chain, body.link, start, end, radius)
        })
    }

    /// Ends, in the frame of its link, and radius (m) of the capsule around a body: see [`LinkGeometry::of_bodies`].
    pub fn capsule_around(body: &CollisionBody) -> ([f64; 3], [f64; 3], f64) {
        let (axis, half, radius) = match body.shape {
            CollisionShape::Sphere { radius } => (Vector3::z(), 0.0, radius),
            CollisionShape::Cylinder { radius, length } | CollisionShape::Capsule { radius, length } => {
                (Vector3::z(), 0.5 * length, radius)
            }
            CollisionShape::Box { half_extents } => {
                let longest = Vector3::from(half_extents).imax();
                let mut axis = Vector3::zeros();
                axis[longest] = 1.0;
                let [b, c] = [1, 2].map(|i| half_extents[(longest + i) % 3]);
                (axis, half_extents[longest], b.hypot(c))
            }
        };
        let end = |side: f64| (body.pose * nalgebra::Point3::from(axis * side)).coords.into();
        (end(-half), end(half), radius)
    }

    /// With one more capsule, given in the frame of a link (see [`Chain::link_index`]): a tool, a hose, a camera.
    ///
    /// # Errors
    /// An index that is no link, a link that no joint moves, numbers that are not finite, a negative radius.
    pub fn with_capsule(
        mut self,
        chain: &Chain,
        link: usize,
        start: [f64; 3],
        end: [f64; 3],
        radius: f64,
    ) -> Result<Self> {
        check_radius(radius)?;
        check_finite("start", &start)?;
        check_finite("end", &end)?;
        let frame = chain.link(link)?;
        let Some(last) = frame.joints_before.checked_sub(1) else {
            return Err(Error::Invalid(format!(
                "link '{}' is part of the base, nothing moves it",
                frame.name
            )));
        };
        let to_z = axis_onto_z(&chain.joints()[last].axis);
        let [start, end] =
            [start, end].map(|p| to_z.tr_mul(&frame.offset.transform_point(&Vector3::from(p).into()).coords));
        let ends = Ends::Carried(start, end);
        self.capsules.push(LinkCapsule { link, joints_before: last + 1, radius, ends });
        Ok(self)
    }

    /// The segments.
    pub fn capsules(&self) -> &[LinkCapsule] {
        &self.capsules
    }
}

fn check_radius(radius: f64) -> Result<()> {
    check_finite("link_radius", &[radius])?;
    if radius < 0.0 {
        return Err(Error::OutOfRange { what: "link_radius".into(), value: radius, bound: ">= 0 m".into() });
    }
    Ok(())
}

/// The link after `joint` as a capsule.
fn capsule(chain: &Chain, joint: usize, radius: f64) -> LinkCapsule {
    let link = chain.links().iter().position(|link| link.joints_before == joint + 1);
    let slides = chain.joints()[joint].kind == JointKind::Prismatic;
    LinkCapsule {
        // A chain names a link after its last joint at least; others may go by that.
        link: link.unwrap_or(chain.links().len().saturating_sub(1)),
        joints_before: joint + 1,
        radius,
        ends: if slides { Ends::Telescope } else { Ends::Joints },
    }
}

impl LinkCapsule {
    /// Its ends in the world.
    #[inline(always)]
    pub fn segment(&self, kinematics: &Kinematics<'_>) -> (Vector3<f64>, Vector3<f64>) {
        let origins = kinematics.origins();
        let last = self.joints_before - 1;
        match &self.ends {
            Ends::Joints | Ends::Telescope => {
                let end = origins.get(last + 1).unwrap_or(&kinematics.pose().translation.vector);
                (origins[last], *end)
            }
            Ends::Carried(start, end) => {
                let (rotation, origin) = kinematics.frame(last);
                (rotation * start + origin, rotation * end + origin)
            }
        }
    }

    /// Adds `factor d distance / d q` to `out`; in it only the motion of the link counts.
    #[inline(always)]
    pub(crate) fn add_gradient(
        &self,
        kinematics: &Kinematics<'_>,
        near: &Nearest,
        factor: f64,
        out: &mut [f64],
    ) {
        let (origins, axes, columns) = (kinematics.origins(), kinematics.axes(), kinematics.jacobian());
        let (point, force) = (near.point, near.gradient * factor);
        for j in 0..self.joints_before.min(out.len()) {
            // A sliding joint has no angular part.
            let turns = columns[(3, j)] != 0.0 || columns[(4, j)] != 0.0 || columns[(5, j)] != 0.0;
            out[j] += if turns {
                axes[j].cross(&(point - origins[j])).dot(&force)
            } else if j + 1 == self.joints_before && self.ends == Ends::Telescope {
                near.share * axes[j].dot(&force)
            } else {
                axes[j].dot(&force)
            };
        }
    }
}
