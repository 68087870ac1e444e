//! Signed distance of two solids: which method for which pair.
//!
//! | pair | method | depth in a collision |
//! |---|---|---|
//! | spheres and capsules | closed form | of the axes' nearest points |
//! | sphere or capsule and box | closed form | of the deepest point of the axis |
//! | anything and half-space | the furthest point | exact |
//! | other convex pairs | GJK, EPA, certified | least way out, of the forms without their rounding |
//! | convex and mesh that is not convex | triangle by triangle | a lower bound |

use nalgebra::{Matrix3, Vector3};

use super::convex::{Answer, Memory, distance};
use super::core_shape::Core;
use super::distance::{Nearest, to_box, to_capsule};
use super::obstacle::{Capsule, Cuboid};
use super::solid::{Form, Rod, Solid};
use super::support::Convex;
use crate::pose::pose;

/// Where a frame is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

impl Placement {
    /// The world.
    pub fn world() -> Self {
        Self { rotation: Matrix3::identity(), origin: Vector3::zeros() }
    }

    #[inline(always)]
    pub fn point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p + self.origin
    }

    #[inline(always)]
    pub fn rod(&self, rod: &Rod) -> Rod {
        Rod { start: self.point(&rod.start), end: self.point(&rod.end), radius: rod.radius }
    }

    /// A solid's own frame in the world.
    #[inline(always)]
    fn of(&self, solid: &Solid) -> Self {
        Self { rotation: self.rotation * solid.rotation, origin: self.point(&solid.origin) }
    }
}

/// How near two solids are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Signed distance of the surfaces, m: negative in a collision.
    pub distance: f64,
    /// The nearest point of the first one's surface.
    pub on_first: Vector3<f64>,
    /// The nearest point of the second one's surface.
    pub on_second: Vector3<f64>,
    /// Unit vector from the second to the first.
    pub normal: Vector3<f64>,
    /// The point at which motions count: `d distance = gradient . (v_first(at) - v_second(at))`.
    pub(crate) at: Vector3<f64>,
    /// [`Gap::normal`]; deep in a box, between two faces, a mean of their normals.
    pub(crate) gradient: Vector3<f64>,
}

impl Gap {
    /// The same pair, the other way round.
    #[must_use]
    fn flipped(self) -> Self {
        Self {
            on_first: self.on_second,
            on_second: self.on_first,
            normal: -self.normal,
            gradient: -self.gradient,
            ..self
        }
    }
}

/// A lower bound of the distance from two capsules around the solids, which may be negative though the solids are apart.
#[inline(always)]
pub(crate) fn rods_apart(a: &Rod, b: &Rod) -> f64 {
    axis_distance(&a.start, &a.end, &b.start, &b.end) - a.radius - b.radius
}

/// Distance of two segments.
#[inline(always)]
fn axis_distance(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>) -> f64 {
    let (d1, d2, r) = (b - a, d - c, a - c);
    let (aa, ee, bb) = (d1.norm_squared(), d2.norm_squared(), d1.dot(&d2));
    let (cc, ff) = (d1.dot(&r), d2.dot(&r));
    let denominator = aa * ee - bb * bb;
    let unit = |numerator: f64, size: f64| if size > 0.0 { (numerator / size).clamp(0.0, 1.0) } else { 0.0 };
    let mut s = unit(bb * ff - cc * ee, denominator);
    let t = bb * s + ff;
    let t = if t <= 0.0 {
        s = unit(-cc, aa);
        0.0
    } else if t >= ee {
        s = unit(bb - cc, aa);
        1.0
    } else {
        // Where the axes are nearly parallel the first guess is not stationary in s.
        let t = t / ee;
        s = unit(bb * t - cc, aa);
        t
    };
    (a + d1 * s - c - d2 * t).norm()
}

/// Signed distance of two solids in their frames; `None` where it is certainly at least `upto`.
#[inline]
pub(crate) fn gap(
    a: (&Solid, &Placement),
    b: (&Solid, &Placement),
    upto: f64,
    memory: &mut Memory,
) -> Option<Gap> {
    use Form::{Convex as Is, HalfSpace};
    match (&a.0.form, &b.0.form) {
        (Is(Core::Point | Core::Segment(_)), Is(Core::Point | Core::Segment(_) | Core::Box(_))) => {
            Some(rounded(a, b))
        }
        (Is(Core::Box(_)), Is(Core::Point | Core::Segment(_))) => Some(rounded(b, a).flipped()),
        (Is(core), HalfSpace) => Some(above(core, a, b)),
        (HalfSpace, Is(core)) => Some(above(core, b, a).flipped()),
        (Is(first), Is(second)) => {
            let rounding = a.0.radius + b.0.radius;
            let (first, second) = (placed(first, a), placed(second, b));
            from_answer(distance(&first, &second, upto + rounding, memory), a.0.radius, b.0.radius)
        }
        (Is(first), Form::Surface(surface)) => {
            let at = b.1.of(b.0);
            let rounding = a.0.radius + b.0.radius;
            let answer =
                surface.distance(&placed(first, a), (&at.rotation, &at.origin), upto + rounding, memory);
            from_answer(answer, a.0.radius, b.0.radius)
        }
        (Form::Surface(_), Is(_)) => gap(b, a, upto, memory).map(Gap::flipped),
        // Only obstacles of the world have such forms, and these do not meet each other.
        (HalfSpace | Form::Surface(_), HalfSpace | Form::Surface(_)) => None,
    }
}

#[inline(always)]
fn placed<'a>(core: &'a Core, (solid, frame): (&Solid, &Placement)) -> Convex<'a> {
    let at = frame.of(solid);
    Convex { core, rotation: at.rotation, origin: at.origin }
}

fn from_answer(answer: Answer, first_radius: f64, second_radius: f64) -> Option<Gap> {
    let Answer::Found(s) = answer else { return None };
    let normal = -s.normal;
    Some(Gap {
        distance: s.distance - first_radius - second_radius,
        on_first: s.on_first - normal * first_radius,
        on_second: s.on_second + normal * second_radius,
        normal,
        at: s.on_first,
        gradient: normal,
    })
}

/// The axis of a sphere or capsule.
#[inline(always)]
fn axis(solid: &Solid, frame: &Placement) -> (Vector3<f64>, Vector3<f64>) {
    let middle = frame.point(&solid.origin);
    match &solid.form {
        Form::Convex(Core::Segment(half)) => {
            let half = frame.rotation * (solid.rotation * half);
            (middle - half, middle + half)
        }
        _ => (middle, middle),
    }
}

/// Sphere or capsule against sphere, capsule or box.
#[inline(always)]
fn rounded(a: (&Solid, &Placement), b: (&Solid, &Placement)) -> Gap {
    let (start, end) = axis(a.0, a.1);
    let near = match &b.0.form {
        Form::Convex(Core::Box(half)) => {
            let at = b.1.of(b.0);
            let cuboid = Cuboid { pose: pose(at.rotation, at.origin), half_extents: *half };
            let mut near = to_box(&start, &end, &cuboid);
            near.distance -= b.0.radius;
            near
        }
        _ => {
            let (from, to) = axis(b.0, b.1);
            to_capsule(&start, &end, &Capsule { start: from, end: to, radius: b.0.radius })
        }
    };
    from_nearest(&near, a.0.radius)
}

/// What is known of the axis of a capsule with this radius.
#[inline(always)]
pub(crate) fn from_nearest(near: &Nearest, radius: f64) -> Gap {
    Gap {
        distance: near.distance - radius,
        on_first: near.point - near.normal * radius,
        on_second: near.point - near.normal * near.distance,
        normal: near.normal,
        at: near.point,
        gradient: near.gradient,
    }
}

/// A convex solid over a half-space.
fn above(core: &Core, a: (&Solid, &Placement), b: (&Solid, &Placement)) -> Gap {
    let plane = b.1.of(b.0);
    let normal: Vector3<f64> = plane.rotation.column(2).into_owned();
    let at = a.1.of(a.0);
    let down = -at.rotation.tr_mul(&normal);
    let hint = std::cell::Cell::new(core.start(&down));
    let lowest = at.point(&core.furthest(&down, &hint));
    let height = (lowest - plane.origin).dot(&normal);
    Gap {
        distance: height - a.0.radius - b.0.radius,
        on_first: lowest - normal * a.0.radius,
        on_second: lowest - normal * (height - b.0.radius),
        normal,
        at: lowest,
        gradient: normal,
    }
}
