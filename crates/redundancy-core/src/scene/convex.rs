//! Signed distance of two convex shapes by their support functions: parry's GJK outside, its EPA inside.
//!
//! What the library returns is not believed but certified. A direction n alone proves
//! `gap(n) = min over B of n.x - max over A of n.x <= distance`, and equality holds for the best one. So
//! - apart, the distance between the two points found is an upper bound and `gap(n)` a lower one; where they differ by more than
//!   [`CONVEX_GAP`] the lower one is returned, which is conservative;
//! - inside, `-gap(n)` bounds the depth from above: that is returned, exact where EPA has found the best n.
//!
//! Where neither returns a direction a few are tried, and the best gap of these is returned: conservative again, never 0. The
//! library's tolerances are absolute (areas of 5e-8); in millimetres they are far below what matters here.
//!
//! This is the only file that calls the library for distances.

use std::cell::Cell;

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::shape::SupportMap;

use super::core_shape::Core;
use crate::tolerance::{CONVEX_GAP, CONVEX_TOUCH};

/// The library works in millimetres.
const SCALE: f64 = 1e3;

/// Memory of the library, kept from one pair to the next.
#[derive(Default)]
pub(crate) struct Memory {
    epa: EPA,
}

impl Memory {
    /// Memory that has seen a hard case: later ones need no more.
    pub fn new() -> Self {
        let mut memory = Self::default();
        let core = Core::Cylinder { radius: 1.0, half: 1.0 };
        let turned = nalgebra::Rotation3::from_euler_angles(0.4, 0.7, 0.1);
        let second =
            Convex { core: &core, rotation: turned.into_inner(), origin: Vector3::new(0.3, 0.2, 0.1) };
        let first = Convex { core: &core, rotation: Matrix3::identity(), origin: Vector3::zeros() };
        distance(&first, &second, f64::INFINITY, &mut memory);
        memory
    }
}

impl std::fmt::Debug for Memory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Memory")
    }
}

/// A convex core somewhere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Convex<'a> {
    pub core: &'a Core,
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

/// Signed distance of two cores.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Separation {
    /// m, negative inside.
    pub distance: f64,
    /// The nearest points (inside: the deepest).
    pub on_first: Vector3<f64>,
    pub on_second: Vector3<f64>,
    /// Unit vector from the first to the second: moving the second along it adds to the distance.
    pub normal: Vector3<f64>,
}

/// Distances, or proof that they are beyond.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Answer {
    Found(Separation),
    /// At least what was asked for.
    Beyond,
}

struct First<'a> {
    core: &'a Core,
    hint: Cell<u32>,
}

struct Second<'a> {
    core: &'a Core,
    rotation: Matrix3<f64>,
    origin: Vector3<f64>,
    hint: Cell<u32>,
}

#[inline(always)]
fn to_library(v: &Vector3<f64>) -> Vector {
    Vector::new(SCALE * v.x, SCALE * v.y, SCALE * v.z)
}

#[inline(always)]
fn from_library(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x / SCALE, v.y / SCALE, v.z / SCALE)
}

impl First<'_> {
    #[inline(always)]
    fn furthest(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.core.furthest(d, &self.hint)
    }
}

impl Second<'_> {
    #[inline(always)]
    fn furthest(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * self.core.furthest(&self.rotation.tr_mul(d), &self.hint) + self.origin
    }
}

impl SupportMap for First<'_> {
    #[inline]
    fn local_support_point(&self, d: Vector) -> Vector {
        to_library(&self.furthest(&Vector3::new(d.x, d.y, d.z)))
    }
}

impl SupportMap for Second<'_> {
    #[inline]
    fn local_support_point(&self, d: Vector) -> Vector {
        to_library(&self.furthest(&Vector3::new(d.x, d.y, d.z)))
    }

    /// It knows where it is: the pose that the library hands over is the identity.
    #[inline]
    fn support_point(&self, _: &Pose, d: Vector) -> Vector {
        self.local_support_point(d)
    }
}

/// `min over B of n.x - max over A of n.x`: a lower bound of the distance, and where it is reached.
fn gap(first: &First<'_>, second: &Second<'_>, n: &Vector3<f64>) -> (f64, Vector3<f64>, Vector3<f64>) {
    let (a, b) = (first.furthest(n), second.furthest(&-n));
    ((b - a).dot(n), a, b)
}

/// Distance of two cores, exactly where it is below `upto`.
pub(crate) fn distance(a: &Convex<'_>, b: &Convex<'_>, upto: f64, memory: &mut Memory) -> Answer {
    let rotation = a.rotation.tr_mul(&b.rotation);
    let origin = a.rotation.tr_mul(&(b.origin - a.origin));
    let middle = rotation * b.core.middle() + origin - a.core.middle();
    let first = First { core: a.core, hint: Cell::new(a.core.start(&middle)) };
    let second =
        Second { core: b.core, rotation, origin, hint: Cell::new(b.core.start(&-rotation.tr_mul(&middle))) };
    let back = |found: Separation| Separation {
        distance: found.distance,
        on_first: a.rotation * found.on_first + a.origin,
        on_second: a.rotation * found.on_second + a.origin,
        normal: a.rotation * found.normal,
    };
    let mut simplex = VoronoiSimplex::new();
    let begin = if middle.norm_squared() > 0.0 { middle } else { Vector3::x() };
    simplex.reset(CsoPoint::from_shapes(&Pose::IDENTITY, &first, &second, to_library(&begin)));
    let most = if upto.is_finite() { SCALE * upto } else { f64::MAX };
    match closest_points(&Pose::IDENTITY, &first, &second, most, true, &mut simplex) {
        GJKResult::ClosestPoints(p, q, n) => {
            let (p, q, n) = (from_library(p), from_library(q), Vector3::new(n.x, n.y, n.z));
            let apart = q - p;
            let length = apart.norm();
            // Next to contact the direction between the points is rounding, that of the library is not.
            let normal = if length > CONVEX_TOUCH { apart / length } else { n };
            let (least, on_first, on_second) = gap(&first, &second, &normal);
            let found = if length > CONVEX_TOUCH && length - least <= CONVEX_GAP * (1.0 + length) {
                Separation { distance: length, on_first: p, on_second: q, normal }
            } else if least > 0.0 {
                Separation { distance: least, on_first, on_second, normal }
            } else {
                inside(&first, &second, &simplex, &middle, memory)
            };
            Answer::Found(back(found))
        }
        GJKResult::NoIntersection(n) | GJKResult::Proximity(n) => {
            // Also what it says after its last iteration: only the gap counts.
            let n = Vector3::new(n.x, n.y, n.z);
            let (least, ..) = gap(&first, &second, &n);
            if least >= upto {
                return Answer::Beyond;
            }
            Answer::Found(back(inside(&first, &second, &simplex, &middle, memory)))
        }
        GJKResult::Intersection => Answer::Found(back(inside(&first, &second, &simplex, &middle, memory))),
    }
}

/// Distance of cores that overlap, touch, or that GJK could not tell: the direction with the largest gap.
fn inside(
    first: &First<'_>,
    second: &Second<'_>,
    simplex: &VoronoiSimplex,
    middle: &Vector3<f64>,
    memory: &mut Memory,
) -> Separation {
    let mut best: Option<Separation> = None;
    let mut consider = |n: Vector3<f64>, points: Option<(Vector3<f64>, Vector3<f64>)>| {
        let size = n.norm();
        if !(size.is_finite() && size > 0.0) {
            return;
        }
        let n = n / size;
        let (distance, a, b) = gap(first, second, &n);
        if best.as_ref().is_none_or(|best| distance > best.distance) {
            let (on_first, on_second) = points.unwrap_or((a, b));
            best = Some(Separation { distance, on_first, on_second, normal: n });
        }
    };
    if let Some((p, q, n)) = memory.epa.closest_points(&Pose::IDENTITY, first, second, simplex) {
        // EPA's normal leads out of the difference of the two: from the second to the first as here from the first on.
        consider(Vector3::new(n.x, n.y, n.z), Some((from_library(p), from_library(q))));
    } else {
        consider(*middle, None);
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut n = Vector3::zeros();
                n[axis] = sign;
                consider(n, None);
                consider(second.rotation * n, None);
            }
        }
    }
    let nowhere = || {
        let (distance, on_first, on_second) = gap(first, second, &Vector3::x());
        Separation { distance, on_first, on_second, normal: Vector3::x() }
    };
    best.unwrap_or_else(nowhere)
}
