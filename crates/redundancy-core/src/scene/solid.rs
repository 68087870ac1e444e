//! A convex shape that moves with a frame, and volumes around it that are cheap to ask.
//!
//! A solid is everything within `radius` of its form: a point (sphere), a segment (capsule), a box, a cylinder or a hull.
//! Obstacles may also be a half-space, or the triangles of a mesh that is not convex.

use std::sync::Arc;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::core_shape::Core;
use super::surface::Surface;
use crate::pose::Pose;

/// What a solid is without its rounding.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Form {
    Convex(Core),
    /// Everything below z = 0.
    HalfSpace,
    /// Triangles, and what they enclose where they are closed.
    Surface(Arc<Surface>),
}

/// A ball or a capsule that contains a solid: ends of its axis and radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rod {
    pub start: Vector3<f64>,
    pub end: Vector3<f64>,
    pub radius: f64,
}

/// A rounded form in a frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solid {
    pub form: Form,
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
    /// Everything within this distance of the form counts, m.
    pub radius: f64,
    /// Centre and radius of a ball around it, in the frame; infinite for a half-space.
    pub ball: (Vector3<f64>, f64),
    /// A capsule around it, in the frame.
    pub rod: Rod,
}

impl Solid {
    /// A convex core, rounded.
    pub fn convex(core: Core, pose: &Pose, radius: f64) -> Self {
        let (mut corners, around) = core.corners();
        place(&mut corners, pose);
        // The ends of a cylinder are discs: the ball goes through their rims, the capsule has half a ball on each. Around a
        // sphere or a capsule the capsule is itself, see `Body::is_capsule`.
        let (ball, rod) = if around > 0.0 || matches!(core, Core::Point | Core::Segment(_)) {
            let (start, end) = (corners[0], corners[corners.len() - 1]);
            let rod = Rod { start, end, radius: around };
            ((pose.translation.vector, (0.5 * (end - start).norm()).hypot(around)), rod)
        } else {
            (ball(&corners), rod(&corners))
        };
        Self::with_bounds(Form::Convex(core), pose, radius, ball, rod)
    }

    /// A capsule between two points of the frame; allocates nothing.
    #[inline]
    pub fn capsule(start: &Vector3<f64>, end: &Vector3<f64>, radius: f64) -> Self {
        let half = 0.5 * (end - start);
        let length = half.norm();
        let core = if length == 0.0 { Core::Point } else { Core::Segment(half) };
        let origin = start + half;
        Self {
            form: Form::Convex(core),
            rotation: Matrix3::identity(),
            origin,
            radius,
            ball: (origin, length + radius),
            rod: Rod { start: *start, end: *end, radius },
        }
    }

    /// Triangles, placed.
    pub fn surface(surface: Arc<Surface>, pose: &Pose) -> Self {
        let mut corners = surface.corners();
        place(&mut corners, pose);
        Self::with_bounds(Form::Surface(surface), pose, 0.0, ball(&corners), rod(&corners))
    }

    /// The same solid where its frame is at `pose` of another one.
    pub fn placed(mut self, pose: &Pose) -> Self {
        let point = |p: &Vector3<f64>| pose.rotation * p + pose.translation.vector;
        self.rotation = pose.rotation.matrix() * self.rotation;
        self.origin = point(&self.origin);
        self.ball.0 = point(&self.ball.0);
        self.rod.start = point(&self.rod.start);
        self.rod.end = point(&self.rod.end);
        self
    }

    /// Everything below the x-y plane of a pose.
    pub fn half_space(pose: &Pose) -> Self {
        let origin = pose.translation.vector;
        let rod = Rod { start: origin, end: origin, radius: f64::INFINITY };
        Self::with_bounds(Form::HalfSpace, pose, 0.0, (origin, f64::INFINITY), rod)
    }

    fn with_bounds(form: Form, pose: &Pose, radius: f64, ball: (Vector3<f64>, f64), rod: Rod) -> Self {
        Self {
            form,
            rotation: *pose.rotation.matrix(),
            origin: pose.translation.vector,
            radius,
            ball: (ball.0, ball.1 + radius),
            rod: Rod { radius: rod.radius + radius, ..rod },
        }
    }
}

fn place(points: &mut [Vector3<f64>], pose: &Pose) {
    points.iter_mut().for_each(|x| *x = pose.rotation * *x + pose.translation.vector);
}

/// Steps towards the furthest point from which the centre of a ball comes.
const CENTER_STEPS: usize = 200;

/// A ball around points, nearly the least one [Badoiu2003].
fn ball(points: &[Vector3<f64>]) -> (Vector3<f64>, f64) {
    let Some(first) = points.first() else { return (Vector3::zeros(), 0.0) };
    let furthest = |from: &Vector3<f64>| {
        points.iter().fold((0.0, *first), |best, p| {
            let square = (p - from).norm_squared();
            if square > best.0 { (square, *p) } else { best }
        })
    };
    let (low, high) = points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    let mut center = 0.5 * (low + high);
    let mut best = (center, furthest(&center).0);
    for i in 0..CENTER_STEPS {
        let (square, p) = furthest(&center);
        if square < best.1 {
            best = (center, square);
        }
        center += (p - center) / (i as f64 + 2.0);
    }
    (best.0, best.1.sqrt() * ROUNDING)
}

/// Covers the rounding of the bounds.
const ROUNDING: f64 = 1.0 + 1e-12;

/// A slim capsule around points: along one of their principal axes or of the coordinates.
fn rod(points: &[Vector3<f64>]) -> Rod {
    let (center, radius) = ball(points);
    let mean = points.iter().sum::<Vector3<f64>>() / (points.len().max(1)) as f64;
    let spread = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>();
    let principal = SymmetricEigen::new(spread).eigenvectors;
    let mut best = Rod { start: center, end: center, radius };
    for axis in
        principal.column_iter().map(|c| c.into_owned()).chain([Vector3::x(), Vector3::y(), Vector3::z()])
    {
        let candidate = along(points, &axis);
        // What matters is how far it reaches: half of its length counts as much as its radius.
        let size =
            |rod: &Rod| rod.radius * rod.radius * ((rod.end - rod.start).norm() + 4.0 / 3.0 * rod.radius);
        if candidate.radius.is_finite() && size(&candidate) < size(&best) {
            best = candidate;
        }
    }
    best
}

/// The capsule with this direction of its axis.
fn along(points: &[Vector3<f64>], axis: &Vector3<f64>) -> Rod {
    let flat: Vec<Vector3<f64>> = points.iter().map(|p| p - axis * p.dot(axis)).collect();
    let (center, radius) = ball(&flat);
    let (mut start, mut end) = (f64::INFINITY, f64::NEG_INFINITY);
    for (p, q) in points.iter().zip(&flat) {
        let reach = (radius * radius - (q - center).norm_squared()).max(0.0).sqrt();
        start = start.min(p.dot(axis) + reach);
        end = end.max(p.dot(axis) - reach);
    }
    if start > end {
        (start, end) = (0.5 * (start + end), 0.5 * (start + end));
    }
    let [start, end] = [start, end].map(|x| center + axis * x);
    let rod = Rod { start, end, radius };
    // The half balls at the ends may have come too near to each other.
    let furthest = points.iter().map(|p| rod.distance_from_axis(p)).fold(radius, f64::max);
    Rod { radius: furthest * ROUNDING, ..rod }
}

impl Rod {
    /// Distance of a point from the axis.
    fn distance_from_axis(&self, p: &Vector3<f64>) -> f64 {
        let d = self.end - self.start;
        let square = d.norm_squared();
        let share = if square > 0.0 { ((p - self.start).dot(&d) / square).clamp(0.0, 1.0) } else { 0.0 };
        (p - self.start - d * share).norm()
    }
}
