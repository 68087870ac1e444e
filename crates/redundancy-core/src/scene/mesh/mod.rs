//! Triangle meshes from STL, OBJ and DAE files.
//!
//! Files are untrusted: every count is checked against the bytes that are there, vertices must be finite and within
//! [`SCENE_SIZE`], and sizes are bounded ([`MESH_BYTES`], [`MESH_VERTICES`], [`MESH_FACES`]). Only vertices that a face uses
//! are kept; those at the same place become one.
//!
//! | format | what is read |
//! |---|---|
//! | STL, binary and text | the triangles |
//! | OBJ | `v` and `f`; polygons become fans |
//! | DAE (COLLADA 1.4, 1.5) | triangles, polygons, strips and fans of all instances, with the transforms of their nodes and the unit; the up axis is ignored, as ROS tools and coal do |

#[cfg(feature = "urdf")]
mod dae;
mod locate;
mod obj;
mod stl;
mod text;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use nalgebra::Vector3;

pub use locate::locate;

use self::text::{check_count, welded};
use crate::error::{Error, Result};
use crate::tolerance::{MESH_BYTES, MESH_FACES, MESH_VERTICES, SCENE_SIZE};

/// Triangles. Immutable and cheap to clone.
///
/// ```
/// use redundancy_core::scene::TriangleMesh;
/// let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let mesh = TriangleMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
/// assert!(mesh.is_closed());
/// assert!(TriangleMesh::new(vec![[0.0; 3]], vec![[0, 0, 1]]).is_err()); // there is no vertex 1
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TriangleMesh {
    inner: Arc<Inner>,
}

#[derive(Debug, PartialEq)]
struct Inner {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// From vertices (m) and faces, three indices each.
    ///
    /// # Errors
    /// No face, an index that is no vertex, a coordinate that is not finite or beyond [`SCENE_SIZE`], too many of either.
    pub fn new(vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> Result<Self> {
        check_count("vertices", vertices.len(), MESH_VERTICES)?;
        check_count("faces", faces.len(), MESH_FACES)?;
        if faces.is_empty() {
            return Err(Error::Invalid("the mesh has no faces".into()));
        }
        for (i, vertex) in vertices.iter().enumerate() {
            if let Some(value) = vertex.iter().find(|x| x.is_nan() || x.abs() > SCENE_SIZE) {
                let bound = format!("finite and within +-{SCENE_SIZE:e} m");
                return Err(Error::OutOfRange { what: format!("vertex {i}"), value: *value, bound });
            }
        }
        let (vertices, faces) = welded(&vertices, &faces)?;
        let mut mesh = Inner { vertices, faces };
        // A face whose corners fell together has no area of its own; its edges belong to others.
        let degenerate = |f: &[u32; 3]| f[0] == f[1] || f[1] == f[2] || f[2] == f[0];
        if mesh.faces.iter().any(|f| !degenerate(f)) {
            mesh.faces.retain(|f| !degenerate(f));
        }
        Ok(Self { inner: Arc::new(mesh) })
    }

    /// From a file; the format by its extension: `.stl`, `.obj`, `.dae`.
    ///
    /// # Errors
    /// A file that cannot be read, is too large or broken; the message names the file and, in text formats, the line.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let broken = |message: String| Error::File { file: path.display().to_string(), message };
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let io = |error: std::io::Error| broken(error.to_string());
        let file = std::fs::File::open(path).map_err(io)?;
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut std::io::Read::take(file, MESH_BYTES + 1), &mut bytes).map_err(io)?;
        Self::from_bytes(&extension, &bytes).map_err(|error| match error {
            Error::File { message, .. } => broken(message),
            other => broken(other.to_string()),
        })
    }

    /// From the bytes of a file of the format `stl`, `obj` or `dae`.
    ///
    /// # Errors
    /// As [`TriangleMesh::from_file`].
    pub fn from_bytes(format: &str, bytes: &[u8]) -> Result<Self> {
        if bytes.len() as u64 > MESH_BYTES {
            return Err(Error::Invalid(format!("is larger than {MESH_BYTES} bytes")));
        }
        let (vertices, faces) = match format {
            "stl" => stl::read(bytes)?,
            "obj" => obj::read(bytes)?,
            #[cfg(feature = "urdf")]
            "dae" => dae::read(bytes)?,
            other => {
                let valid = ["stl", "obj", "dae"].map(String::from).to_vec();
                return Err(Error::UnknownName { kind: "mesh format", name: other.into(), valid });
            }
        };
        Self::new(vertices, faces)
    }

    /// Vertices, m.
    pub fn vertices(&self) -> &[[f64; 3]] {
        &self.inner.vertices
    }

    /// Vertex indices of the triangles.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.inner.faces
    }

    /// The mesh with every vertex mapped; the order of the corners turns where the map mirrors.
    ///
    /// # Errors
    /// Vertices that are not finite or too large after it.
    pub fn mapped(&self, map: impl Fn(Vector3<f64>) -> Vector3<f64>, mirrors: bool) -> Result<Self> {
        let vertices = self.vertices().iter().map(|v| map(Vector3::from(*v)).into()).collect();
        let turn = |f: &[u32; 3]| if mirrors { [f[0], f[2], f[1]] } else { *f };
        Self::new(vertices, self.faces().iter().map(turn).collect())
    }

    /// True where every edge belongs to two triangles that run through it in opposite directions: the mesh has an inside.
    pub fn is_closed(&self) -> bool {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::with_capacity(self.faces().len() * 3);
        for face in self.faces() {
            for i in 0..3 {
                let edge = (face[i], face[(i + 1) % 3]);
                if edges.insert(edge, 1).is_some() {
                    return false;
                }
            }
        }
        edges.keys().all(|(a, b)| edges.contains_key(&(*b, *a)))
    }

    /// Volume inside of a closed mesh, m^3; positive where the corners run counter-clockwise seen from outside.
    pub fn volume(&self) -> f64 {
        let origin = self.vertices().first().map_or_else(Vector3::zeros, |v| Vector3::from(*v));
        let corner = |i: u32| Vector3::from(self.vertices()[i as usize]) - origin;
        let tetrahedra = self.faces().iter().map(|f| corner(f[0]).dot(&corner(f[1]).cross(&corner(f[2]))));
        tetrahedra.sum::<f64>() / 6.0
    }
}
