//! A piece of a path's curve: some samples, and what lies between them.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3, Vector4};

use super::shapes::{Circle, Raster};
use super::spline::CubicSpline;
use crate::pose::Pose;
use crate::tolerance::QUATERNION_CHORD;

/// What the positions between samples come from.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// A spline through the samples.
    Spline,
    /// An analytic circle.
    Circle(Circle),
    /// An analytic raster.
    Raster(Raster),
    /// Several pieces, each with a curve of its own; only whole paths have this shape.
    Joined,
}

impl Shape {
    /// Position and its first two derivatives at the shape's own arc length; `None` where there is no shape of its own.
    pub(super) fn at(&self, s: f64) -> Option<[Vector3<f64>; 3]> {
        match self {
            Self::Circle(circle) => Some(circle.at(s)),
            Self::Raster(raster) => Some(raster.at(s)),
            Self::Spline | Self::Joined => None,
        }
    }

    /// The shape moved by a rigid transform.
    pub(super) fn transformed(&self, by: &Pose) -> Self {
        match self {
            Self::Circle(circle) => Self::Circle(circle.transformed(by)),
            Self::Raster(raster) => Self::Raster(raster.transformed(by)),
            Self::Spline | Self::Joined => self.clone(),
        }
    }

    /// The shape run through from its end, and its length (0 for a spline, which has no arc length of its own).
    pub(super) fn reversed(&self) -> (Self, f64) {
        match self {
            Self::Circle(circle) => (Self::Circle(circle.reversed()), circle.length()),
            Self::Raster(raster) => (Self::Raster(raster.reversed()), raster.arc_length()),
            Self::Spline | Self::Joined => (self.clone(), 0.0),
        }
    }
}

/// Which samples a piece of a path holds, and its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct PathPiece {
    /// What the positions between its samples come from.
    pub shape: Shape,
    /// What is added to the arc length of the path to get that of the shape, m.
    pub shift: f64,
    /// Its first sample.
    pub first: usize,
    /// Its last sample, which is the first one of the next piece.
    pub last: usize,
}

/// A piece with the splines of its samples.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub outline: PathPiece,
    positions: Option<CubicSpline<3>>,
    orientations: Option<CubicSpline<4>>,
}

impl Piece {
    /// The piece of the path through `poses` at `s`.
    pub fn new(outline: PathPiece, poses: &[Pose], s: &[f64], oriented: bool) -> Self {
        let PathPiece { first, last, .. } = outline;
        // A stop has several samples and one knot.
        let knots: Vec<usize> = (first..=last).filter(|i| *i == first || s[*i] > s[*i - 1]).collect();
        let at_knots: Vec<f64> = knots.iter().map(|i| s[*i]).collect();
        let positions = matches!(outline.shape, Shape::Spline | Shape::Joined).then(|| {
            let values = knots.iter().map(|i| poses[*i].translation.vector).collect();
            CubicSpline::new(at_knots.clone(), values)
        });
        let orientations = oriented.then(|| {
            let mut previous = Vector4::zeros();
            let values = knots.iter().map(|i| {
                let q = UnitQuaternion::from_rotation_matrix(&poses[*i].rotation);
                let q = Vector4::new(q.w, q.i, q.j, q.k);
                previous = if q.dot(&previous) < 0.0 { -q } else { q };
                previous
            });
            CubicSpline::new(at_knots, values.collect())
        });
        Self { outline, positions, orientations }
    }

    /// Position and its first two derivatives at the arc length of the path.
    #[inline]
    pub fn position_at(&self, s: f64) -> [Vector3<f64>; 3] {
        match &self.positions {
            Some(spline) => spline.at(s),
            None => self.outline.shape.at(s + self.outline.shift).unwrap_or([Vector3::zeros(); 3]),
        }
    }

    /// Rotation, `omega` and `omega'`; `None` where the quaternions of neighbouring samples cancel or there are none.
    #[inline]
    pub fn orientation_at(&self, s: f64) -> Option<(Rotation3<f64>, Vector3<f64>, Vector3<f64>)> {
        let [v, dv, ddv] = self.orientations.as_ref()?.at(s);
        let norm = v.norm();
        if norm < QUATERNION_CHORD {
            return None;
        }
        // With Q = v / |v|: Q' conj(Q) and its derivative have the vector parts of v' conj(Q) / |v| and
        // (v'' - 2 |v|'/|v| v') conj(Q) / |v|, since what is along Q only adds to the scalar part.
        let q = Quaternion::from(v_to_nalgebra(&v)) / norm;
        let along = v.dot(&dv) / (norm * norm);
        let turn =
            |d: &Vector4<f64>| 2.0 * (Quaternion::from(v_to_nalgebra(d)) * q.conjugate()).imag() / norm;
        let rotation = UnitQuaternion::new_unchecked(q).to_rotation_matrix();
        Some((rotation, turn(&dv), turn(&(ddv - dv * (2.0 * along)))))
    }
}

/// Scalar first to nalgebra's order.
fn v_to_nalgebra(v: &Vector4<f64>) -> Vector4<f64> {
    Vector4::new(v[1], v[2], v[3], v[0])
}
