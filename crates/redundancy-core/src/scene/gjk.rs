//! GJK and EPA of parry: with `decompose` the only file that calls the library.
//!
//! It works in millimetres: its tolerances are absolute (areas of 5e-8), and in millimetres far below what matters here.

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::shape::SupportMap;

use super::core_shape::Core;
use super::support::{Convex, Sides, Verdict};

const SCALE: f64 = 1e3;

/// Memory of the library, kept from one pair to the next.
#[derive(Default)]
pub(crate) struct SearchMemory {
    epa: EPA,
}

impl SearchMemory {
    /// Memory that has seen a hard case: later ones need no more.
    pub fn new() -> Self {
        let mut memory = Self::default();
        let core = Core::Cylinder { radius: 1.0, half: 1.0 };
        let turned = nalgebra::Rotation3::from_euler_angles(0.4, 0.7, 0.1).into_inner();
        let second = Convex { core: &core, rotation: turned, origin: Vector3::new(0.3, 0.2, 0.1) };
        let first = Convex { core: &core, rotation: Matrix3::identity(), origin: Vector3::zeros() };
        search(&Sides::new(&first, &second), f64::INFINITY, Some(&mut memory));
        memory
    }
}

impl std::fmt::Debug for SearchMemory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SearchMemory")
    }
}

#[inline(always)]
fn to_library(v: &Vector3<f64>) -> Vector {
    Vector::new(SCALE * v.x, SCALE * v.y, SCALE * v.z)
}

#[inline(always)]
fn from_library(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x / SCALE, v.y / SCALE, v.z / SCALE)
}

/// One side; the pose that the library hands over is the identity.
struct First<'a>(&'a Sides<'a>);
struct Second<'a>(&'a Sides<'a>);

impl SupportMap for First<'_> {
    #[inline]
    fn local_support_point(&self, d: Vector) -> Vector {
        to_library(&self.0.furthest_of_first(&Vector3::new(d.x, d.y, d.z)))
    }
}

impl SupportMap for Second<'_> {
    #[inline]
    fn local_support_point(&self, d: Vector) -> Vector {
        to_library(&self.0.furthest_of_second(&Vector3::new(d.x, d.y, d.z)))
    }

    #[inline]
    fn support_point(&self, _: &Pose, d: Vector) -> Vector {
        self.local_support_point(d)
    }
}

/// Looks for the nearest points, or with memory for the deepest ones.
pub(crate) fn search(sides: &Sides<'_>, upto: f64, memory: Option<&mut SearchMemory>) -> Verdict {
    let (first, second) = (First(sides), Second(sides));
    let begin = if sides.middle.norm_squared() > 0.0 { sides.middle } else { Vector3::x() };
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(&Pose::IDENTITY, &first, &second, to_library(&begin)));
    let most = if upto.is_finite() { SCALE * upto } else { f64::MAX };
    match closest_points(&Pose::IDENTITY, &first, &second, most, true, &mut simplex) {
        GJKResult::ClosestPoints(p, q, n) => {
            Verdict::Apart(from_library(p), from_library(q), Vector3::new(n.x, n.y, n.z))
        }
        // Also what it says after its last iteration.
        GJKResult::NoIntersection(n) | GJKResult::Proximity(n) => {
            Verdict::Beyond(Vector3::new(n.x, n.y, n.z))
        }
        GJKResult::Intersection => match memory {
            Some(memory) => deepest(sides, &simplex, memory),
            None => Verdict::Inside(None),
        },
    }
}

fn deepest(sides: &Sides<'_>, simplex: &VoronoiSimplex, memory: &mut SearchMemory) -> Verdict {
    let found = memory.epa.closest_points(&Pose::IDENTITY, &First(sides), &Second(sides), simplex);
    Verdict::Inside(found.map(|(p, q, n)| (from_library(p), from_library(q), Vector3::new(n.x, n.y, n.z))))
}
