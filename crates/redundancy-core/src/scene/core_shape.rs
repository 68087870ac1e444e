//! Convex shapes without rounding, by their support functions.

use std::cell::Cell;
use std::sync::Arc;

use nalgebra::Vector3;

use super::hull::Hull;

/// A convex shape in coordinates of its own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Core {
    Point,
    /// From minus to plus this vector.
    Segment(Vector3<f64>),
    /// Half of its edges.
    Box(Vector3<f64>),
    /// Around z, half of its length to either side.
    Cylinder {
        radius: f64,
        half: f64,
    },
    Hull(Arc<Hull>),
    /// Corners.
    Triangle([Vector3<f64>; 3]),
}

impl Core {
    /// A point of it that is furthest in the direction `d`.
    #[inline(always)]
    pub fn furthest(&self, d: &Vector3<f64>, hint: &Cell<u32>) -> Vector3<f64> {
        match self {
            Self::Hull(hull) => {
                let found = hull.furthest(d.as_ref(), hint.get());
                hint.set(found);
                Vector3::from(hull.points()[found as usize])
            }
            Self::Box(half) => Vector3::from_fn(|i, _| half[i].copysign(d[i])),
            Self::Segment(half) => {
                if half.dot(d) >= 0.0 {
                    *half
                } else {
                    -half
                }
            }
            Self::Cylinder { radius, half } => {
                let across = d.x.hypot(d.y);
                let share = if across > 0.0 { radius / across } else { 0.0 };
                Vector3::new(d.x * share, d.y * share, half.copysign(d.z))
            }
            Self::Triangle(corners) => {
                let [x, y, z] = [0, 1, 2].map(|i| corners[i].dot(d));
                corners[if x >= y && x >= z {
                    0
                } else if y >= z {
                    1
                } else {
                    2
                }]
            }
            Self::Point => Vector3::zeros(),
        }
    }

    /// A first guess for [`Core::furthest`].
    #[inline(always)]
    pub fn start(&self, d: &Vector3<f64>) -> u32 {
        match self {
            Self::Hull(hull) => hull.start(d.as_ref()),
            _ => 0,
        }
    }

    /// A point inside.
    #[inline(always)]
    pub fn middle(&self) -> Vector3<f64> {
        match self {
            Self::Hull(hull) => hull.middle(),
            Self::Triangle([a, b, c]) => (a + b + c) / 3.0,
            _ => Vector3::zeros(),
        }
    }

    /// Corners that span it; a cylinder by its two ends and a radius.
    pub fn corners(&self) -> (Vec<Vector3<f64>>, f64) {
        match self {
            Self::Point => (vec![Vector3::zeros()], 0.0),
            Self::Segment(half) => (vec![-half, *half], 0.0),
            Self::Box(half) => {
                let corner =
                    |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 0 { -half[k] } else { half[k] });
                ((0..8).map(corner).collect(), 0.0)
            }
            Self::Cylinder { radius, half } => {
                (vec![Vector3::new(0.0, 0.0, -half), Vector3::new(0.0, 0.0, *half)], *radius)
            }
            Self::Hull(hull) => (hull.points().iter().map(|p| Vector3::from(*p)).collect(), 0.0),
            Self::Triangle(corners) => (corners.to_vec(), 0.0),
        }
    }
}
