//! A mesh as several convex hulls, by approximate convex decomposition [Mamou2016] of parry.
//!
//! The pieces together contain the surface: each is the hull of the triangles in its cells. Results are kept for the life
//! of the process (the last [`KEPT`]), as one takes seconds.
//!
//! The library is called in a frame of unit size, with bounded work, and what it panics with is an error here.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, OnceLock};

use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};
use parry3d_f64::transformation::voxelization::FillMode;

use super::hull::Hull;
use super::mesh::TriangleMesh;
use crate::error::{Error, Result};

/// Cells along the longest side.
const RESOLUTION: u32 = 64;
/// Volume between a piece and its hull, as a share of the hull of all, from which it is cut further.
const CONCAVITY: f64 = 0.005;
/// Most pieces.
const MAX_PIECES: u32 = 64;
/// Most pairs of a triangle and a cell in its box: bounds time and memory.
const MAX_WORK: f64 = 2e7;
/// Results that are kept.
const KEPT: usize = 64;

type Pieces = Arc<Vec<Arc<Hull>>>;

fn kept() -> &'static Mutex<Vec<(u64, TriangleMesh, Pieces)>> {
    static KEPT: OnceLock<Mutex<Vec<(u64, TriangleMesh, Pieces)>>> = OnceLock::new();
    KEPT.get_or_init(|| Mutex::new(Vec::new()))
}

/// Hulls that contain the surface of a mesh together.
///
/// # Errors
/// A mesh that is too large for it, or that the library fails on.
pub(crate) fn decompose(mesh: &TriangleMesh) -> Result<Pieces> {
    let mut hasher = DefaultHasher::new();
    mesh.faces().hash(&mut hasher);
    mesh.vertices().iter().flatten().for_each(|x| x.to_bits().hash(&mut hasher));
    let key = hasher.finish();
    if let Ok(kept) = kept().lock()
        && let Some((.., pieces)) = kept.iter().find(|(k, m, _)| *k == key && m == mesh)
    {
        return Ok(pieces.clone());
    }
    let pieces = Arc::new(compute(mesh)?);
    if let Ok(mut kept) = kept().lock() {
        if kept.len() >= KEPT {
            kept.remove(0);
        }
        kept.push((key, mesh.clone(), pieces.clone()));
    }
    Ok(pieces)
}

fn compute(mesh: &TriangleMesh) -> Result<Vec<Arc<Hull>>> {
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let fold = |(low, high): (Vector3<f64>, Vector3<f64>), p: &[f64; 3]| {
        (low.inf(&Vector3::from(*p)), high.sup(&Vector3::from(*p)))
    };
    let (low, high) = mesh.vertices().iter().fold(start, fold);
    let size = (high - low).amax();
    if !(size > 0.0 && size.is_finite()) {
        return Err(Error::Invalid("the mesh has no extent, it cannot be decomposed".into()));
    }
    let points: Vec<Vector> = mesh
        .vertices()
        .iter()
        .map(|p| Vector::new((p[0] - low.x) / size, (p[1] - low.y) / size, (p[2] - low.z) / size))
        .collect();
    let cells = |face: &[u32; 3]| -> f64 {
        let corner = face.map(|i| points[i as usize]);
        let (low, high) = (corner[0].min(corner[1]).min(corner[2]), corner[0].max(corner[1]).max(corner[2]));
        let side = (high - low) * f64::from(RESOLUTION);
        (side.x + 3.0) * (side.y + 3.0) * (side.z + 3.0)
    };
    let work: f64 = mesh.faces().iter().map(cells).sum();
    if work > MAX_WORK {
        return Err(Error::OutOfRange {
            what: format!("work of decomposing a mesh of {} triangles", mesh.faces().len()),
            value: work,
            bound: format!("<= {MAX_WORK:e} cells; take its hull, or a simpler mesh"),
        });
    }
    let parameters = VHACDParameters {
        concavity: CONCAVITY,
        resolution: RESOLUTION,
        max_convex_hulls: MAX_PIECES,
        fill_mode: if mesh.is_closed() {
            FillMode::FloodFill { detect_cavities: false }
        } else {
            FillMode::SurfaceOnly
        },
        ..VHACDParameters::default()
    };
    let clouds = catch_unwind(AssertUnwindSafe(|| {
        let parts = VHACD::decompose(&parameters, &points, mesh.faces(), true);
        parts.compute_primitive_intersections(&points, mesh.faces())
    }));
    let clouds = clouds.map_err(|_| Error::Invalid("the mesh cannot be decomposed; take its hull".into()))?;
    let back = |p: &Vector| [p.x * size + low.x, p.y * size + low.y, p.z * size + low.z];
    let hull = |cloud: &Vec<Vector>| Hull::new(&cloud.iter().map(back).collect::<Vec<_>>());
    let pieces: Vec<Arc<Hull>> = clouds.iter().filter_map(hull).map(Arc::new).collect();
    if pieces.is_empty() {
        return Err(Error::Invalid("the mesh has no convex pieces; take its hull".into()));
    }
    Ok(pieces)
}
