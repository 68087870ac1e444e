//! Signed distance of a segment from a shape, with the points that are closest.
//!
//! The distance is that of the segment's nearest (or deepest) point from the surface of the shape, negative inside:
//! `min over x on the segment of sd(x)`. For a convex shape `sd` is convex, so the minimum is unique in value; a capsule
//! around the segment is nearer by its radius. `n = grad sd` at that point turns any motion of the point into
//! the change of the distance, as the place on the segment is stationary or an end. Where the deepest point in a box is
//! equally deep below two faces, `n = a n_1 + (1 - a) n_2` with the share that makes it perpendicular to the segment.
//!
//! Closed forms for sphere and capsule [Ericson2005, section 5.1.9]; for the box a
//! piecewise linear (inside) or quadratic (outside) convex function of one variable is minimised exactly, by steps from one
//! piece to the next. A general library of shapes (parry3d-f64) was not taken: it gives the depth of the whole capsule,
//! not of its axis, in a box, and nothing here is larger than a page.

use nalgebra::Vector3;

use super::obstacle::{Capsule, Cuboid, Sphere};
use crate::tolerance::SEGMENT_PARALLEL;

/// The nearest or deepest point of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Signed distance from the surface of the shape, m.
    pub distance: f64,
    /// Where on the segment, 0 at its start and 1 at its end.
    pub share: f64,
    /// The point on the segment.
    pub point: Vector3<f64>,
    /// Unit vector from the shape to the point.
    pub normal: Vector3<f64>,
    /// How the distance changes when the segment is moved: `normal`, but deep in a box, between two faces, a mean of
    /// their normals.
    pub gradient: Vector3<f64>,
}

/// A direction across `along`, any of them.
fn across(along: &Vector3<f64>) -> Vector3<f64> {
    let mut helper = Vector3::zeros();
    helper[along.iamin()] = 1.0;
    let v = along.cross(&helper);
    let norm = v.norm();
    if norm > 0.0 { v / norm } else { Vector3::z() }
}

#[inline(always)]
pub(super) fn to_sphere(start: &Vector3<f64>, end: &Vector3<f64>, sphere: &Sphere) -> Nearest {
    let d = end - start;
    let square = d.norm_squared();
    let along = (sphere.center - start).dot(&d);
    let share = if along <= 0.0 {
        0.0
    } else if along >= square {
        1.0
    } else {
        along / square
    };
    let point = start + d * share;
    from_center(point, share, &(point - sphere.center), sphere.radius, &d)
}

#[inline(always)]
fn from_center(
    point: Vector3<f64>,
    share: f64,
    away: &Vector3<f64>,
    radius: f64,
    along: &Vector3<f64>,
) -> Nearest {
    let norm = away.norm();
    // At the centre every direction leads out; one across the segment moves it out soonest.
    let normal = if norm > 0.0 { away / norm } else { across(along) };
    Nearest { distance: norm - radius, share, point, normal, gradient: normal }
}

#[inline(always)]
pub(super) fn to_capsule(start: &Vector3<f64>, end: &Vector3<f64>, capsule: &Capsule) -> Nearest {
    let (d1, d2, r) = (end - start, capsule.end - capsule.start, start - capsule.start);
    let (a, e, b) = (d1.norm_squared(), d2.norm_squared(), d1.dot(&d2));
    let (c, f) = (d1.dot(&r), d2.dot(&r));
    let denominator = a * e - b * b;
    let clamp = |numerator: f64, size: f64| {
        if numerator <= 0.0 {
            0.0
        } else if numerator >= size {
            1.0
        } else {
            numerator / size
        }
    };
    // The lines' nearest points; parallel lines are alike everywhere: the middle of what they share comes below.
    let mut s = if denominator > SEGMENT_PARALLEL * a * e { clamp(b * f - c * e, denominator) } else { 0.5 };
    let mut t = b * s + f;
    if t <= 0.0 {
        t = 0.0;
        s = clamp(-c, a);
    } else if t >= e {
        t = 1.0;
        s = clamp(b - c, a);
    } else {
        t /= e;
        // Where the lines are nearly parallel the first guess is not stationary in s.
        s = clamp(b * t - c, a);
    }
    let point = start + d1 * s;
    let away = point - (capsule.start + d2 * t);
    let norm = away.norm();
    let normal = if norm > 0.0 {
        away / norm
    } else {
        let common = d1.cross(&d2);
        let size = common.norm();
        if size > 0.0 { common / size } else { across(if a >= e { &d1 } else { &d2 }) }
    };
    Nearest { distance: norm - capsule.radius, share: s, point, normal, gradient: normal }
}

#[inline]
pub(super) fn to_box(start: &Vector3<f64>, end: &Vector3<f64>, cuboid: &Cuboid) -> Nearest {
    let rotation = cuboid.pose.rotation.matrix();
    let a = rotation.tr_mul(&(start - cuboid.pose.translation.vector));
    let d = rotation.tr_mul(&(end - start));
    let h = &cuboid.half_extents;
    // Which part of the segment lies inside of all three slabs.
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for i in 0..3 {
        if d[i] == 0.0 {
            if a[i].abs() > h[i] {
                leave = -1.0;
            }
        } else {
            let inverse = 1.0 / d[i];
            let (one, two) = ((-h[i] - a[i]) * inverse, (h[i] - a[i]) * inverse);
            enter = enter.max(one.min(two));
            leave = leave.min(one.max(two));
        }
    }
    let (share, distance, normal, gradient) = if enter <= leave {
        deepest(&a, &d, h, enter, leave)
    } else {
        let (share, distance, normal) = nearest(&a, &d, h);
        (share, distance, normal, normal)
    };
    Nearest {
        distance,
        share,
        point: start + (end - start) * share,
        normal: rotation * normal,
        gradient: rotation * gradient,
    }
}

/// Least of the six functions `+-x_i - h_i` 's maximum between `enter` and `leave`, where all are negative.
fn deepest(
    a: &Vector3<f64>,
    d: &Vector3<f64>,
    h: &Vector3<f64>,
    enter: f64,
    leave: f64,
) -> (f64, f64, Vector3<f64>, Vector3<f64>) {
    // The largest function at t: its value, slope, axis and sign.
    let top = |t: f64| {
        let mut best = (f64::NEG_INFINITY, 0.0, 0, 1.0);
        for i in 0..3 {
            for sign in [1.0, -1.0] {
                let (value, slope) = (sign * (a[i] + d[i] * t) - h[i], sign * d[i]);
                if value > best.0 {
                    best = (value, slope, i, sign);
                }
            }
        }
        best
    };
    let face = |line: (f64, f64, usize, f64)| {
        let mut normal = Vector3::zeros();
        normal[line.2] = line.3;
        normal
    };
    let (mut left, mut right) = ((enter, top(enter)), (leave, top(leave)));
    if left.1.1 >= 0.0 || right.1.1 <= 0.0 {
        let (t, line) = if left.1.1 >= 0.0 { left } else { right };
        return (t, line.0, face(line), face(line));
    }
    // Two lines meet below the function; a third one there replaces one of them. Six lines: at most five times.
    let mut t = left.0;
    for _ in 0..6 {
        let ((t0, (v0, s0, ..)), (t1, (v1, s1, ..))) = (left, right);
        t = ((v1 - s1 * t1 - v0 + s0 * t0) / (s0 - s1)).clamp(t0, t1);
        let line = top(t);
        let below = v0 + s0 * (t - t0);
        if line.0 <= below + 4.0 * f64::EPSILON * (below.abs() + h.amax()) {
            break;
        }
        if line.1 == 0.0 {
            return (t, line.0, face(line), face(line));
        }
        if line.1 < 0.0 {
            left = (t, line);
        } else {
            right = (t, line);
        }
    }
    let (s0, s1) = (left.1.1, right.1.1);
    let gradient = (face(left.1) * s1 - face(right.1) * s0) / (s1 - s0);
    (t, top(t).0, face(left.1), gradient)
}

/// Least distance from a box of a segment that does not meet it: the squared distance is quadratic between the
/// planes of the faces, so one piece has to be found.
fn nearest(a: &Vector3<f64>, d: &Vector3<f64>, h: &Vector3<f64>) -> (f64, f64, Vector3<f64>) {
    let excess = |t: f64| {
        Vector3::from_fn(|i, _| {
            let x = a[i] + d[i] * t;
            x - x.clamp(-h[i], h[i])
        })
    };
    let slope = |e: &Vector3<f64>| e.dot(d);
    let t = if slope(&excess(0.0)) >= 0.0 {
        0.0
    } else if slope(&excess(1.0)) <= 0.0 {
        1.0
    } else {
        // The planes of the faces narrow the bracket to one piece, in which the slope is linear.
        let (mut lo, mut hi) = (0.0, 1.0);
        for i in 0..3 {
            if d[i] == 0.0 {
                continue;
            }
            let inverse = 1.0 / d[i];
            for plane in [-h[i], h[i]] {
                let t = (plane - a[i]) * inverse;
                if t > lo && t < hi {
                    if slope(&excess(t)) > 0.0 {
                        hi = t;
                    } else {
                        lo = t;
                    }
                }
            }
        }
        let middle = 0.5 * (lo + hi);
        let e = excess(middle);
        let second: f64 = (0..3).map(|i| if e[i] != 0.0 { d[i] * d[i] } else { 0.0 }).sum();
        if second > 0.0 { (middle - slope(&e) / second).clamp(lo, hi) } else { middle }
    };
    let e = excess(t);
    let norm = e.norm();
    if norm > 0.0 {
        return (t, norm, e / norm);
    }
    // Touching by rounding: the face that is nearest.
    let x = a + d * t;
    let axis = (0..3).max_by(|i, j| (x[*i].abs() - h[*i]).total_cmp(&(x[*j].abs() - h[*j]))).unwrap_or(0);
    let mut normal = Vector3::zeros();
    normal[axis] = 1.0f64.copysign(x[axis]);
    (t, x[axis].abs() - h[axis], normal)
}
