//! The body of an arm: the shapes of its links, and which links must not touch each other.

use std::sync::Arc;

use super::body::Body;
use super::obstacle::Shape;
use super::pairs::{self, Found, Links, Reason};
use super::solid::Solid;
use crate::chain::{Chain, JointKind};
use crate::error::{Error, Result, check_finite};
use crate::pose::{Pose, check_pose};
use crate::tolerance::{LINK_LENGTH, SCENE_SIZE};

/// The shapes of the links of an arm, and the pairs of links that must not touch. Immutable and cheap to clone.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LinkGeometry {
    inner: Arc<Inner>,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Inner {
    pub names: Vec<String>,
    /// How many joints move each link: links with the same number stand still against each other.
    pub groups: Vec<usize>,
    pub bodies: Vec<Body>,
    /// Links that a joint connects, sorted.
    pub neighbours: Vec<[usize; 2]>,
    /// Pairs of links that must not touch; `None` if they were never computed.
    pub pairs: Option<Vec<[usize; 2]>>,
    /// Pairs that are not checked, and why.
    pub left_out: Vec<([usize; 2], Reason)>,
}

impl LinkGeometry {
    /// Capsules of one radius from joint to joint and from the last joint to the tool; none from the base to the first
    /// joint, which nothing moves. Neighbouring joints at the same place have no link between them that could touch
    /// something before they do. No pairs: see [`LinkGeometry::with_capsule_pairs`].
    ///
    /// # Errors
    /// A radius that is negative or not finite.
    pub fn joint_to_joint(chain: &Chain, radius: f64) -> Result<Self> {
        check_radius("link_radius", radius)?;
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
        let mut inner = Inner::default();
        for joint in joints {
            // A chain names a link after its last joint at least; others may go by that.
            let own = chain.links().iter().find(|link| link.joints_before == joint + 1);
            let name = own.or(chain.links().last()).map_or("", |link| link.name.as_str());
            let owner = inner.owner(name, joint + 1);
            inner.bodies.push(Body::behind_joint(chain, joint, owner, radius));
        }
        Ok(Self { inner: Arc::new(inner) })
    }

    /// With one more shape, in the frame `at` of a link: a tool, a hose, a camera. The link is one of the geometry or of the
    /// chain. Where pairs are checked, those of a link that had no shape are found.
    ///
    /// # Errors
    /// An unknown link, numbers that are not finite; a half-space or a mesh that counts triangle by triangle.
    pub fn with_shape(&self, chain: &Chain, link: &str, shape: &Shape, at: &Pose) -> Result<Self> {
        shape.validate()?;
        check_pose("pose", at)?;
        if !shape.is_convex() {
            return Err(Error::Invalid(format!(
                "a link cannot be a {}; a mesh that is not convex can be its hull or convex pieces",
                shape.as_str()
            )));
        }
        let mut inner = (*self.inner).clone();
        let known = inner.names.iter().position(|name| name == link);
        let carrier = match known.and_then(|owner| inner.bodies.iter().find(|body| body.owner == owner)) {
            Some(_) if chain.links().iter().all(|frame| frame.name != link) => {
                return Err(Error::Invalid(format!(
                    "link '{link}' is not one of the chain's; give the shape in the frame of one that is"
                )));
            }
            _ => chain.link_index(link)?,
        };
        let owner = inner.owner(link, chain.link(carrier)?.joints_before);
        for solid in shape.solids() {
            inner.bodies.push(Body::on_link(chain, carrier, owner, solid.placed(at))?);
        }
        let fresh = known.is_none() && inner.pairs.is_some();
        let geometry = Self { inner: Arc::new(inner) };
        if !fresh {
            return Ok(geometry);
        }
        let found = pairs::find(chain, &geometry.to_find(), &mut |_| true);
        let mut inner = (*geometry.inner).clone();
        let mine = |pair: &[usize; 2]| pair.contains(&owner);
        let pairs = inner.pairs.get_or_insert_with(Vec::new);
        pairs.extend(found.kept.into_iter().filter(mine));
        pairs.sort_unstable();
        inner.left_out.extend(found.left_out.into_iter().filter(|(pair, _)| mine(pair)));
        Ok(Self { inner: Arc::new(inner) })
    }

    /// With one more capsule, given in the frame of a link (see [`Chain::link_index`]).
    ///
    /// # Errors
    /// An index that is no link, a link that no joint moves, numbers that are not finite, a negative radius.
    pub fn with_capsule(
        self,
        chain: &Chain,
        link: usize,
        start: [f64; 3],
        end: [f64; 3],
        radius: f64,
    ) -> Result<Self> {
        check_radius("link_radius", radius)?;
        check_finite("start", &start)?;
        check_finite("end", &end)?;
        let frame = chain.link(link)?;
        if frame.joints_before == 0 {
            return Err(Error::Invalid(format!(
                "link '{}' is part of the base and does not move",
                frame.name
            )));
        }
        let mut inner = (*self.inner).clone();
        let owner = inner.owner(&frame.name, frame.joints_before);
        let solid = Solid::capsule(&start.into(), &end.into(), radius);
        inner.bodies.push(Body::on_link(chain, link, owner, solid)?);
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Names of the links that have shapes.
    pub fn names(&self) -> &[String] {
        &self.inner.names
    }

    /// Number of shapes.
    pub fn len(&self) -> usize {
        self.inner.bodies.len()
    }

    /// True without any shape.
    pub fn is_empty(&self) -> bool {
        self.inner.bodies.is_empty()
    }

    /// Index of the link and radius (m) of each capsule and sphere.
    pub fn capsules(&self) -> Vec<(usize, f64)> {
        let round = self.inner.bodies.iter().filter(|body| body.is_capsule());
        round.map(|body| (body.owner, body.solid.radius)).collect()
    }

    /// Pairs of links that must not touch, as indices of names.
    pub fn pairs(&self) -> &[[usize; 2]] {
        self.inner.pairs.as_deref().unwrap_or_default()
    }

    /// Pairs of links that are not checked, and why; of links that stand still against each other none is listed.
    pub fn left_out(&self) -> &[([usize; 2], Reason)] {
        &self.inner.left_out
    }

    /// Without the pair of these two links: they may touch.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn allow(&self, first: &str, second: &str) -> Result<Self> {
        let pair = sorted([self.index(first)?, self.index(second)?]);
        let mut inner = (*self.inner).clone();
        let pairs = inner.pairs.get_or_insert_with(Vec::new);
        if pairs.contains(&pair) {
            pairs.retain(|known| *known != pair);
            inner.left_out.push((pair, Reason::User));
        }
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Index of a link by its name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn index(&self, name: &str) -> Result<usize> {
        self.names().iter().position(|known| known == name).ok_or_else(|| Error::UnknownName {
            kind: "link",
            name: name.into(),
            valid: self.names().to_vec(),
        })
    }

    /// With pairs that are found: links that a joint connects, links that touch in nearly all of a number of seeded
    /// configurations, and links that never come near each other are left out. `go_on` is asked now and then with the share that
    /// is done; where it ends the search, what was not seen to touch is checked.
    ///
    /// # Errors
    /// None for a geometry of this chain.
    pub fn find_pairs(&self, chain: &Chain, go_on: &mut dyn FnMut(f64) -> bool) -> Result<Self> {
        Ok(self.with_found(pairs::find(chain, &self.to_find(), go_on)))
    }

    /// With the pairs of joint-to-joint capsules that say something: apart in the middle of the joints' ranges, and not
    /// overlapping in nearly all of a number of seeded configurations. [`LinkGeometry::left_out`] tells the others.
    ///
    /// # Errors
    /// None for a geometry of this chain.
    pub fn with_capsule_pairs(&self, chain: &Chain) -> Result<Self> {
        Ok(self.with_found(pairs::find_of_capsules(chain, &self.to_find())))
    }

    /// The pairs that are not checked as an SRDF file has them.
    pub fn to_srdf(&self, robot: &str) -> String {
        pairs::to_srdf(robot, &self.to_find(), self.left_out())
    }

    pub(super) fn to_find(&self) -> Links<'_> {
        let Inner { names, groups, bodies, neighbours, .. } = &*self.inner;
        Links { names, groups, bodies, neighbours }
    }

    pub(super) fn with_found(&self, found: Found) -> Self {
        let mut inner = (*self.inner).clone();
        inner.pairs = Some(found.kept);
        inner.left_out = found.left_out;
        Self { inner: Arc::new(inner) }
    }

    pub(super) fn inner(&self) -> &Inner {
        &self.inner
    }

    pub(super) fn of_inner(inner: Inner) -> Self {
        Self { inner: Arc::new(inner) }
    }

    pub(crate) fn bodies(&self) -> &[Body] {
        &self.inner.bodies
    }

    /// How many joints move a link.
    pub(crate) fn group(&self, link: usize) -> usize {
        self.inner.groups[link]
    }
}

impl Inner {
    /// The index of a name, which is new maybe.
    pub fn owner(&mut self, name: &str, group: usize) -> usize {
        match self.names.iter().position(|known| known == name) {
            Some(owner) => owner,
            None => {
                self.names.push(name.into());
                self.groups.push(group);
                self.names.len() - 1
            }
        }
    }
}

pub(super) fn sorted(mut pair: [usize; 2]) -> [usize; 2] {
    pair.sort_unstable();
    pair
}

pub(super) fn check_radius(what: &str, radius: f64) -> Result<()> {
    check_finite(what, &[radius])?;
    if !(0.0..=SCENE_SIZE).contains(&radius) {
        let bound = format!("between 0 and {SCENE_SIZE:e} m");
        return Err(Error::OutOfRange { what: what.into(), value: radius, bound });
    }
    Ok(())
}
