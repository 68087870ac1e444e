//! The body of an arm from the collision geometry of a URDF.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::body::Body;
use super::core_shape::Core;
use super::decompose::decompose;
use super::geometry::{Inner, LinkGeometry, check_radius, sorted};
use super::hull::Hull;
use super::mesh::{TriangleMesh, locate};
use super::solid::Solid;
use super::srdf::Srdf;
use crate::chain::{Chain, CollisionBody, CollisionModel, CollisionShape};
use crate::error::{Error, Result};
use crate::pose::{Pose, pose};

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

impl LinkGeometry {
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
        let geometry = Self::of_inner(inner);
        match &options.srdf {
            Some(path) => geometry.with_srdf(&Srdf::from_file(path)?),
            None => geometry.find_pairs(chain, &mut |_| true),
        }
    }

    /// With the pairs that an SRDF leaves: all of links that move against each other but those it disables.
    ///
    /// # Errors
    /// None for an SRDF that was read; links that it does not know are not in its way.
    pub fn with_srdf(&self, srdf: &Srdf) -> Result<Self> {
        Ok(self.with_found(srdf.apply(&self.to_find())))
    }
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
