//! The body of an arm: the shapes of its links, and which links must not touch each other.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::body::Body;
use super::core_shape::Core;
use super::decompose::decompose;
use super::hull::Hull;
use super::mesh::{TriangleMesh, locate};
use super::obstacle::Shape;
use super::pairs::{self, Found, Links, Reason, Srdf};
use super::solid::Solid;
use crate::chain::{Chain, CollisionBody, CollisionModel, CollisionShape, JointKind};
use crate::error::{Error, Result, check_finite};
use crate::pose::{Pose, check_pose, pose};
use crate::tolerance::{LINK_LENGTH, SCENE_SIZE};

/// What the meshes of a URDF become.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LinkMeshes {
    /// Their convex hulls.
    #[default]
    Hull,
    /// Convex pieces that contain their surface together.
    Decompose,
    /// An error that names the link.
    Refuse,
}

impl LinkMeshes {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Hull, Self::Decompose, Self::Refuse];

    /// The kind as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Hull => "hull",
            Self::Decompose => "decompose",
            Self::Refuse => "refuse",
        }
    }

    /// The kind with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == name).ok_or_else(|| {
            let valid = Self::ALL.iter().map(|kind| kind.as_str().to_owned()).collect();
            Error::UnknownName { kind: "meshes", name: name.into(), valid }
        })
    }
}

/// How a URDF becomes a [`LinkGeometry`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct UrdfOptions {
    /// What its meshes become.
    pub meshes: LinkMeshes,
    /// Folders in which packages and relative names are looked for.
    pub package_dirs: Vec<PathBuf>,
    /// A file that says which links may touch; without it the pairs are found, see [`LinkGeometry::find_pairs`].
    pub srdf: Option<PathBuf>,
    /// Every shape counts with everything within this distance, m.
    pub padding: f64,
    /// Positions of joints that are not the chain's, rad or m.
    pub posture: Vec<(String, f64)>,
}

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
    /// Pairs of links that must not touch; `None` where they were never asked for.
    pub pairs: Option<Vec<[usize; 2]>>,
    /// Pairs that are not looked at, and why.
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

    /// The collision geometry of a URDF file: the links of the chain, and all that stands with it, is beyond its tip or hangs on
    /// joints that are not its own.
    ///
    /// # Errors
    /// As of [`Chain::collision_from_urdf`]; a mesh that is missing or broken, or refused; no collision geometry at all; an SRDF
    /// that cannot be read.
    pub fn from_urdf(chain: &Chain, path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Self> {
        let path = path.as_ref();
        let model = chain.collision_from_urdf(path, &options.posture)?;
        let home = std::path::absolute(path).ok().and_then(|path| path.parent().map(Path::to_path_buf));
        Self::of_model(chain, &model, home.as_deref(), options)
    }

    /// The same from the text of a URDF; its files are looked for from the folder `home` on.
    ///
    /// # Errors
    /// As of [`LinkGeometry::from_urdf`].
    ///
    /// ```
    /// use redundancy_core::chain::{Chain, MissingLimits};
    /// use redundancy_core::scene::{LinkGeometry, UrdfOptions};
    /// let xml = r#"<robot name="r"> <link name="a"/>
    ///   <link name="b"><collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
    ///   <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
    /// </robot>"#;
    /// let chain = Chain::from_urdf_string(xml, None, None, MissingLimits::Refuse)?;
    /// let arm = LinkGeometry::from_urdf_string(&chain, xml, None, &UrdfOptions::default())?;
    /// assert_eq!(arm.names(), ["b"]);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn from_urdf_string(
        chain: &Chain,
        xml: &str,
        home: Option<&Path>,
        options: &UrdfOptions,
    ) -> Result<Self> {
        let model = chain.collision_from_urdf_string(xml, &options.posture)?;
        Self::of_model(chain, &model, home, options)
    }

    fn of_model(
        chain: &Chain,
        model: &CollisionModel,
        home: Option<&Path>,
        options: &UrdfOptions,
    ) -> Result<Self> {
        check_radius("padding", options.padding)?;
        if model.bodies.is_empty() {
            return Err(Error::Description(format!(
                "the links of '{}' have no collision geometry; give them a radius instead",
                chain.name()
            )));
        }
        let mut inner = Inner::default();
        let mut files: Vec<(String, TriangleMesh)> = Vec::new();
        for body in &model.bodies {
            let owner = inner.owner(&body.name, chain.link(body.link)?.joints_before);
            for solid in solids_of(body, home, options, &mut files)? {
                inner.bodies.push(Body::on_link(chain, body.link, owner, solid)?);
            }
        }
        let index: HashMap<&str, usize> =
            inner.names.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
        let known = |[a, b]: &[String; 2]| Some(sorted([*index.get(a.as_str())?, *index.get(b.as_str())?]));
        let mut neighbours: Vec<[usize; 2]> = model.neighbours.iter().filter_map(known).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        inner.neighbours = neighbours;
        let geometry = Self { inner: Arc::new(inner) };
        match &options.srdf {
            Some(path) => geometry.with_srdf(&Srdf::from_file(path)?),
            None => geometry.find_pairs(chain, &mut |_| true),
        }
    }

    /// With one more shape, in the frame `at` of a link: a tool, a hose, a camera. The link is one of the geometry or of the
    /// chain. Where pairs are looked at, those of a link that had no shape are found.
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
                "link '{}' is part of the base, nothing moves it",
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

    /// Pairs of links that are not looked at, and why; of links that stand still against each other none is listed.
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

    /// With the pairs that an SRDF leaves: all of links that move against each other but those it disables.
    ///
    /// # Errors
    /// None for an SRDF that was read; links that it does not know are not in its way.
    pub fn with_srdf(&self, srdf: &Srdf) -> Result<Self> {
        Ok(self.with_found(srdf.apply(&self.to_find())))
    }

    /// With pairs that are found: links that a joint connects, links that touch in nearly all of a number of seeded
    /// configurations, and links that never come near each other are left out. `go_on` is asked now and then with the share that
    /// is done; where it ends the search, what was not seen to touch is looked at.
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

    /// The pairs that are not looked at as an SRDF file has them.
    pub fn to_srdf(&self, robot: &str) -> String {
        pairs::to_srdf(robot, &self.to_find(), self.left_out())
    }

    fn to_find(&self) -> Links<'_> {
        let Inner { names, groups, bodies, neighbours, .. } = &*self.inner;
        Links { names, groups, bodies, neighbours }
    }

    fn with_found(&self, found: Found) -> Self {
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
    fn owner(&mut self, name: &str, group: usize) -> usize {
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

fn sorted(mut pair: [usize; 2]) -> [usize; 2] {
    pair.sort_unstable();
    pair
}

fn check_radius(what: &str, radius: f64) -> Result<()> {
    check_finite(what, &[radius])?;
    if !(0.0..=SCENE_SIZE).contains(&radius) {
        let bound = format!("between 0 and {SCENE_SIZE:e} m");
        return Err(Error::OutOfRange { what: what.into(), value: radius, bound });
    }
    Ok(())
}

/// A collision body in the frame of its link.
fn solids_of(
    body: &CollisionBody,
    home: Option<&Path>,
    options: &UrdfOptions,
    files: &mut Vec<(String, TriangleMesh)>,
) -> Result<Vec<Solid>> {
    let (at, padding) = (&body.pose, options.padding);
    let along_z = |half: f64| {
        let end = |side: f64| (at * nalgebra::Point3::new(0.0, 0.0, side)).coords;
        (end(-half), end(half))
    };
    Ok(vec![match &body.shape {
        CollisionShape::Sphere { radius } => {
            let center = at.translation.vector;
            Solid::capsule(&center, &center, radius + padding)
        }
        CollisionShape::Capsule { radius, length } => {
            let (start, end) = along_z(0.5 * length);
            Solid::capsule(&start, &end, radius + padding)
        }
        CollisionShape::Cylinder { radius, length } => {
            Solid::convex(Core::Cylinder { radius: *radius, half: 0.5 * length }, at, padding)
        }
        CollisionShape::Box { half_extents } => {
            Solid::convex(Core::Box(Vector3::from(*half_extents)), at, padding)
        }
        CollisionShape::Mesh { file, scale } => {
            let named = |error: Error| match error {
                Error::File { file, message } => {
                    Error::File { file, message: format!("mesh of link '{}': {message}", body.name) }
                }
                other => Error::Description(format!("mesh of link '{}': {other}", body.name)),
            };
            return mesh_solids(file, scale, at, home, options, files).map_err(named);
        }
    }])
}

fn mesh_solids(
    file: &str,
    scale: &[f64; 3],
    at: &Pose,
    home: Option<&Path>,
    options: &UrdfOptions,
    files: &mut Vec<(String, TriangleMesh)>,
) -> Result<Vec<Solid>> {
    if options.meshes == LinkMeshes::Refuse {
        return Err(Error::Description(
            "meshes are refused; ask for meshes=\"hull\" or \"decompose\"".into(),
        ));
    }
    let mesh = match files.iter().find(|(name, _)| name == file) {
        Some((_, mesh)) => mesh.clone(),
        None => {
            let mesh = TriangleMesh::from_file(locate(file, home, &options.package_dirs)?)?;
            files.push((file.into(), mesh.clone()));
            mesh
        }
    };
    let scale = Vector3::from(*scale);
    let mirrors = scale.product() < 0.0;
    let scaled =
        if scale == Vector3::repeat(1.0) { mesh } else { mesh.mapped(|v| v.component_mul(&scale), mirrors)? };
    // The hull in the frame of the link.
    let place = |p: &[f64; 3]| -> [f64; 3] { (at * nalgebra::Point3::from(*p)).coords.into() };
    let hull = |points: &[[f64; 3]]| {
        let placed: Vec<[f64; 3]> = points.iter().map(place).collect();
        Hull::new(&placed).map(|hull| {
            Solid::convex(
                Core::Hull(Arc::new(hull)),
                &pose(Matrix3::identity(), Vector3::zeros()),
                options.padding,
            )
        })
    };
    Ok(match options.meshes {
        LinkMeshes::Decompose => {
            decompose(&scaled)?.iter().filter_map(|piece| hull(piece.points())).collect()
        }
        _ => hull(scaled.vertices()).into_iter().collect(),
    })
}
