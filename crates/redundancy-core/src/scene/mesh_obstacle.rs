//! A mesh as an obstacle.

use std::sync::Arc;

use nalgebra::Vector3;

use super::core_shape::Core;
use super::decompose::decompose;
use super::hull::Hull;
use super::mesh::TriangleMesh;
use super::solid::Solid;
use super::surface::Surface;
use crate::error::{Error, Result};
use crate::pose::{Pose, check_pose};
use crate::tolerance::MESH_CONVEX;

/// What a mesh stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeshSolid {
    /// Its triangles, and what they enclose where they are closed.
    #[default]
    Exact,
    /// Its convex hull.
    Hull,
    /// Convex pieces that contain its surface together.
    Decompose,
}

impl MeshSolid {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Exact, Self::Hull, Self::Decompose];

    /// The kind as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Hull => "hull",
            Self::Decompose => "decompose",
        }
    }

    /// The kind with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == name).ok_or_else(|| {
            let valid = Self::ALL.iter().map(|kind| kind.as_str().to_owned()).collect();
            Error::UnknownName { kind: "solid", name: name.into(), valid }
        })
    }
}

/// A mesh somewhere. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Where its coordinates are.
    pub pose: Pose,
    body: Arc<Body>,
}

#[derive(Debug, PartialEq)]
struct Body {
    mesh: TriangleMesh,
    solid: MeshSolid,
    parts: Parts,
}

#[derive(Debug, PartialEq)]
enum Parts {
    Hulls(Vec<Arc<Hull>>),
    Surface(Arc<Surface>),
}

impl Mesh {
    /// A mesh in the coordinates of `pose`. A closed convex mesh is its hull whatever `solid` asks for.
    ///
    /// # Errors
    /// A pose that is not rigid; a mesh that cannot be decomposed where that is asked for.
    pub fn new(mesh: &TriangleMesh, solid: MeshSolid, pose: Pose) -> Result<Self> {
        check_pose("pose", &pose)?;
        let hull = || {
            let hull = Hull::new(mesh.vertices()).map(Arc::new);
            hull.ok_or_else(|| Error::Invalid("the mesh has no vertices".into()))
        };
        let parts = match solid {
            MeshSolid::Hull => Parts::Hulls(vec![hull()?]),
            MeshSolid::Exact | MeshSolid::Decompose if mesh.is_closed() && is_convex(mesh) => {
                Parts::Hulls(vec![hull()?])
            }
            MeshSolid::Decompose => Parts::Hulls(decompose(mesh)?.to_vec()),
            MeshSolid::Exact => Parts::Surface(Arc::new(Surface::new(mesh))),
        };
        Ok(Self { pose, body: Arc::new(Body { mesh: mesh.clone(), solid, parts }) })
    }

    /// Its triangles, in its own coordinates.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.body.mesh
    }

    /// What it stands for.
    pub fn solid(&self) -> MeshSolid {
        self.body.solid
    }

    /// Number of convex pieces; 0 where its triangles count one by one.
    pub fn pieces(&self) -> usize {
        match &self.body.parts {
            Parts::Hulls(hulls) => hulls.len(),
            Parts::Surface(_) => 0,
        }
    }

    pub(crate) fn solids(&self) -> Vec<Solid> {
        match &self.body.parts {
            Parts::Hulls(hulls) => {
                hulls.iter().map(|hull| Solid::convex(Core::Hull(hull.clone()), &self.pose, 0.0)).collect()
            }
            Parts::Surface(surface) => vec![Solid::surface(surface.clone(), &self.pose)],
        }
    }
}

/// Whether no vertex of a closed mesh is above any of its faces.
fn is_convex(mesh: &TriangleMesh) -> bool {
    let Some(hull) = Hull::new(mesh.vertices()) else { return false };
    let corner = |i: u32| Vector3::from(mesh.vertices()[i as usize]);
    let extent =
        mesh.vertices().iter().map(|v| (Vector3::from(*v) - hull.middle()).norm()).fold(0.0, f64::max);
    mesh.faces().iter().all(|f| {
        let [a, b, c] = f.map(corner);
        let normal = (b - a).cross(&(c - a));
        let size = normal.norm();
        if size == 0.0 {
            return true;
        }
        let normal = normal / size;
        let furthest = hull.furthest(normal.as_ref(), hull.start(normal.as_ref()));
        (Vector3::from(hull.points()[furthest as usize]) - a).dot(&normal) <= MESH_CONVEX * extent
    })
}
