//! Two convex cores, one seen from the other, by their support functions.

use std::cell::Cell;

use nalgebra::{Matrix3, Vector3};

use super::core_shape::Core;

/// A convex core somewhere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Convex<'a> {
    pub core: &'a Core,
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

/// Two cores in the coordinates of the first one.
#[derive(Debug)]
pub(crate) struct Sides<'a> {
    first: &'a Core,
    second: &'a Core,
    pub rotation: Matrix3<f64>,
    origin: Vector3<f64>,
    /// Where the last search on each side ended.
    hints: [Cell<u32>; 2],
    /// From a point inside of the first one to one inside of the second.
    pub middle: Vector3<f64>,
}

/// What a search for the nearest points says; nothing of it is certain before it is checked.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Verdict {
    /// The nearest points, and the direction from the first to the second.
    Apart(Vector3<f64>, Vector3<f64>, Vector3<f64>),
    /// Farther apart than was asked for, along this direction.
    Beyond(Vector3<f64>),
    /// They overlap: the deepest points and the shortest way out, if they were found.
    Inside(Option<(Vector3<f64>, Vector3<f64>, Vector3<f64>)>),
}

impl<'a> Sides<'a> {
    pub fn new(a: &Convex<'a>, b: &Convex<'a>) -> Self {
        let rotation = a.rotation.tr_mul(&b.rotation);
        let origin = a.rotation.tr_mul(&(b.origin - a.origin));
        let middle = rotation * b.core.middle() + origin - a.core.middle();
        let hints = [a.core.start(&middle), b.core.start(&-rotation.tr_mul(&middle))].map(Cell::new);
        Self { first: a.core, second: b.core, rotation, origin, hints, middle }
    }

    /// The point of the first one that is furthest in a direction.
    #[inline(always)]
    pub fn furthest_of_first(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.first.furthest(d, &self.hints[0])
    }

    /// The point of the second one that is furthest in a direction.
    #[inline(always)]
    pub fn furthest_of_second(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * self.second.furthest(&self.rotation.tr_mul(d), &self.hints[1]) + self.origin
    }

    /// `min over the second of n.x - max over the first of n.x`, a lower bound of the distance for every unit vector n, and the
    /// points where it is reached.
    #[inline]
    pub fn gap(&self, n: &Vector3<f64>) -> (f64, Vector3<f64>, Vector3<f64>) {
        let (a, b) = (self.furthest_of_first(n), self.furthest_of_second(&-n));
        ((b - a).dot(n), a, b)
    }
}
