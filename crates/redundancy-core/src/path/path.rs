//! A path: samples and the curve through them.

use nalgebra::{
    IsometryMatrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3, Vector4, Vector6,
};

use super::shapes::{Circle, Raster, check_samples, even, intervals};
use super::spline::CubicSpline;
use crate::error::{Error, Result, check_finite, check_length};
use crate::pose::{Pose, check_pose};
use crate::tolerance::{
    PATH_END_ROUNDING, PATH_SAME_ORIENTATION, PATH_STANDSTILL, QUATERNION_CHORD, TURN_LENGTH,
};

/// Tool poses (or positions) in the order of arc length, with a C2 curve between the samples.
///
/// ```
/// use redundancy_core::{nalgebra::Vector3, path::Path};
/// let corner = [Vector3::new(0.3, 0.0, 0.5), Vector3::new(0.4, 0.0, 0.5), Vector3::new(0.4, 0.2, 0.5)];
/// let path = Path::from_positions(&corner, None, None)?;
/// assert_eq!(path.len(), 3);
/// assert!((path.length() - 0.3).abs() < 1e-15);
/// assert!(!path.has_orientation());
/// assert!((path.at(0.1)?.pose.translation.vector - corner[1]).norm() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Path {
    s: Vec<f64>,
    t: Option<Vec<f64>>,
    poses: Vec<Pose>,
    shape: Shape,
    positions: Option<CubicSpline<3>>,
    orientations: Option<CubicSpline<4>>,
}

/// The same samples, arc lengths, times and shape: the same curve. Whether it carries orientations counts.
impl PartialEq for Path {
    fn eq(&self, other: &Self) -> bool {
        self.s == other.s
            && self.t == other.t
            && self.poses == other.poses
            && self.shape == other.shape
            && self.has_orientation() == other.has_orientation()
    }
}

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
}

/// A point of the curve. Six-vectors are linear first, angular second, in base axes.
#[derive(Debug, Clone, PartialEq)]
pub struct PathPoint {
    /// Pose; the rotation is the identity on a path of positions.
    pub pose: Pose,
    /// `(p', omega)`: 1 and rad/m.
    pub derivative: Vector6<f64>,
    /// `(p'', omega')`: 1/m and rad/m^2.
    pub second_derivative: Vector6<f64>,
}

impl Path {
    /// A path through poses. Without `s` the arc length is the sum of the distances between samples.
    ///
    /// # Errors
    /// Fewer than two poses, an invalid pose, lengths that differ, numbers that are not finite, `s` that decreases or
    /// repeats while the pose changes, `t` that does not increase.
    pub fn new(poses: &[Pose], s: Option<&[f64]>, t: Option<&[f64]>) -> Result<Self> {
        for (i, pose) in poses.iter().enumerate() {
            check_pose(&format!("pose {i}"), pose)?;
        }
        Self::build(Shape::Spline, poses.to_vec(), true, s, t)
    }

    /// A path of positions, metres: orientations are left open.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_positions(positions: &[Vector3<f64>], s: Option<&[f64]>, t: Option<&[f64]>) -> Result<Self> {
        for (i, position) in positions.iter().enumerate() {
            check_finite(&format!("position {i}"), position.as_slice())?;
        }
        Self::build(Shape::Spline, positions.iter().map(|p| placed(*p)).collect(), false, s, t)
    }

    /// A path of positions that samples an analytic shape at `s`.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`Shape::Spline`], which has no positions of its own.
    pub fn from_shape(shape: Shape, s: Vec<f64>) -> Result<Self> {
        check_finite("s", &s)?;
        let position = |s: &f64| match &shape {
            Shape::Circle(circle) => Ok(placed(circle.at(*s)[0])),
            Shape::Raster(raster) => Ok(placed(raster.at(*s)[0])),
            Shape::Spline => Err(Error::Invalid("a spline has no positions without samples".into())),
        };
        let poses = s.iter().map(position).collect::<Result<Vec<_>>>()?;
        Self::build(shape, poses, false, Some(&s), None)
    }

    pub(super) fn build(
        shape: Shape,
        poses: Vec<Pose>,
        oriented: bool,
        s: Option<&[f64]>,
        t: Option<&[f64]>,
    ) -> Result<Self> {
        let n = poses.len();
        if n < 2 {
            return Err(Error::Length { what: "path (at least two samples)".into(), expected: 2, actual: n });
        }
        let s = match s {
            None => {
                let s = arc_length(&poses);
                check_finite("arc length", &s)?;
                s
            }
            Some(s) => {
                check_length("s", s, n)?;
                check_finite("s", s)?;
                check_arc_length(&poses, s).map_err(Error::Invalid)?;
                s.to_vec()
            }
        };
        if let Some(t) = t {
            check_times(t, n)?;
        }
        // A stop has several samples and one knot.
        let knots: Vec<usize> = (0..n).filter(|i| *i == 0 || s[*i] > s[*i - 1]).collect();
        let at_knots: Vec<f64> = knots.iter().map(|i| s[*i]).collect();
        let positions = match shape {
            Shape::Spline => {
                let values = knots.iter().map(|i| poses[*i].translation.vector).collect();
                Some(CubicSpline::new(at_knots.clone(), values))
            }
            _ => None,
        };
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
        Ok(Self { s, t: t.map(<[f64]>::to_vec), poses, shape, positions, orientations })
    }

    /// The same path with one orientation everywhere.
    ///
    /// # Errors
    /// A rotation with entries that are not finite or not orthonormal.
    pub fn with_orientation(&self, rotation: &Rotation3<f64>) -> Result<Self> {
        self.with_orientations(&vec![*rotation; self.len()])
    }

    /// The same path with an orientation per sample.
    ///
    /// # Errors
    /// Not one rotation per sample, or an invalid one.
    pub fn with_orientations(&self, rotations: &[Rotation3<f64>]) -> Result<Self> {
        if rotations.len() != self.len() {
            let (expected, actual) = (self.len(), rotations.len());
            return Err(Error::Length { what: "orientations".into(), expected, actual });
        }
        let mut poses = self.poses.clone();
        for (i, (pose, rotation)) in poses.iter_mut().zip(rotations).enumerate() {
            pose.rotation = *rotation;
            check_pose(&format!("orientation {i}"), pose)?;
        }
        Self::build(self.shape.clone(), poses, true, Some(&self.s), self.t.as_deref())
    }

    /// The same path with other times, or none.
    ///
    /// # Errors
    /// Not one finite number per sample, or times that do not increase.
    pub fn with_times(&self, t: Option<&[f64]>) -> Result<Self> {
        if let Some(t) = t {
            check_times(t, self.len())?;
        }
        Ok(Self { t: t.map(<[f64]>::to_vec), ..self.clone() })
    }

    /// Number of samples, at least 2.
    #[allow(clippy::len_without_is_empty)] // never empty
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// Arc length from the first to the last sample, m.
    pub fn length(&self) -> f64 {
        self.s[self.len() - 1] - self.s[0]
    }

    /// Arc length of each sample, m.
    pub fn s(&self) -> &[f64] {
        &self.s
    }

    /// Time of each sample in seconds, where the path has times.
    pub fn t(&self) -> Option<&[f64]> {
        self.t.as_deref()
    }

    /// The samples; the rotation is the identity on a path of positions.
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// False for a path of positions, whose orientation is open.
    pub fn has_orientation(&self) -> bool {
        self.orientations.is_some()
    }

    /// What the positions between samples come from.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Pose and derivatives at arc length `s`.
    ///
    /// # Errors
    /// `s` that is not finite or not on the path.
    pub fn at(&self, s: f64) -> Result<PathPoint> {
        let (first, last) = (self.s[0], self.s[self.len() - 1]);
        let slack = PATH_END_ROUNDING * self.length();
        if !(s >= first - slack && s <= last + slack) {
            let bound = format!("on the path, from {first} to {last}");
            return Err(Error::OutOfRange { what: "s".into(), value: s, bound });
        }
        let s = s.clamp(first, last);
        let [p, d, dd] = match (&self.shape, &self.positions) {
            (Shape::Circle(circle), _) => circle.at(s),
            (Shape::Raster(raster), _) => raster.at(s),
            (Shape::Spline, Some(spline)) => spline.at(s),
            (Shape::Spline, None) => [self.poses[0].translation.vector, Vector3::zeros(), Vector3::zeros()],
        };
        let (rotation, turn, turn_change) = self.orientation_at(s);
        Ok(PathPoint {
            pose: Pose::from_parts(Translation3::from(p), rotation),
            derivative: stacked(&d, &turn),
            second_derivative: stacked(&dd, &turn_change),
        })
    }

    /// Rotation, `omega` and `omega'`.
    fn orientation_at(&self, s: f64) -> (Rotation3<f64>, Vector3<f64>, Vector3<f64>) {
        let still = (Rotation3::identity(), Vector3::zeros(), Vector3::zeros());
        let Some(spline) = &self.orientations else { return still };
        let [v, dv, ddv] = spline.at(s);
        let norm = v.norm();
        if norm < QUATERNION_CHORD {
            let i = self.s.partition_point(|x| *x <= s).clamp(1, self.len()) - 1;
            return (self.poses[i].rotation, still.1, still.2);
        }
        // With Q = v / |v|: Q' conj(Q) and its derivative have the vector parts of v' conj(Q) / |v| and
        // (v'' - 2 |v|'/|v| v') conj(Q) / |v|, since what is along Q only adds to the scalar part.
        let q = Quaternion::from(v_to_nalgebra(&v)) / norm;
        let along = v.dot(&dv) / (norm * norm);
        let turn =
            |d: &Vector4<f64>| 2.0 * (Quaternion::from(v_to_nalgebra(d)) * q.conjugate()).imag() / norm;
        let rotation = UnitQuaternion::new_unchecked(q).to_rotation_matrix();
        (rotation, turn(&dv), turn(&(ddv - dv * (2.0 * along))))
    }

    /// The same curve sampled about every `step` metres; times are interpolated linearly.
    ///
    /// # Errors
    /// A step that is not positive or gives more than ten million samples; a path with times that stops on the way,
    /// since the stop would be lost.
    pub fn resampled(&self, step: f64) -> Result<Self> {
        if !(step.is_finite() && step > 0.0) {
            let bound = "finite and > 0".into();
            return Err(Error::OutOfRange { what: "step".into(), value: step, bound });
        }
        check_samples("step", step, self.length())?;
        let first = self.s[0];
        let s: Vec<f64> =
            even(self.length(), intervals(self.length(), step)).iter().map(|s| first + s).collect();
        let t = match &self.t {
            None => None,
            Some(t) => {
                if let Some(i) = (1..self.len()).find(|i| self.s[*i] <= self.s[*i - 1]) {
                    let message = format!(
                        "the path stops at sample {i} (t = {}): resampling by arc length would lose the stop",
                        t[i]
                    );
                    return Err(Error::Invalid(message));
                }
                Some(s.iter().map(|s| linear(&self.s, t, *s)).collect::<Vec<_>>())
            }
        };
        let points = s.iter().map(|s| self.at(*s)).collect::<Result<Vec<_>>>()?;
        let poses = points.into_iter().map(|point| point.pose).collect();
        Self::build(self.shape.clone(), poses, self.has_orientation(), Some(&s), t.as_deref())
    }
}

/// Only [`Path::orientation_at`] needs this: scalar first to nalgebra's order.
fn v_to_nalgebra(v: &Vector4<f64>) -> Vector4<f64> {
    Vector4::new(v[1], v[2], v[3], v[0])
}

fn placed(position: Vector3<f64>) -> Pose {
    IsometryMatrix3::from_parts(Translation3::from(position), Rotation3::identity())
}

fn stacked(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

fn check_times(t: &[f64], n: usize) -> Result<()> {
    check_length("t", t, n)?;
    check_finite("t", t)?;
    match (1..n).find(|i| t[*i] <= t[*i - 1]) {
        None => Ok(()),
        Some(i) => Err(Error::Invalid(format!("t[{i}] is {} after {}, times must increase", t[i], t[i - 1]))),
    }
}

/// Distance and angle between neighbouring samples.
fn step(poses: &[Pose], i: usize) -> (f64, f64) {
    let (a, b) = (&poses[i - 1], &poses[i]);
    let distance = (b.translation.vector - a.translation.vector).norm();
    // |B - A| = 2 sqrt(2) sin(angle / 2), well conditioned for small angles.
    let chord = (b.rotation.matrix() - a.rotation.matrix()).norm() / 8f64.sqrt();
    (distance, 2.0 * chord.min(1.0).asin())
}

fn arc_length(poses: &[Pose]) -> Vec<f64> {
    let mut s = vec![0.0; poses.len()];
    for i in 1..poses.len() {
        let (distance, angle) = step(poses, i);
        s[i] = s[i - 1]
            + match (distance <= PATH_STANDSTILL, angle <= PATH_SAME_ORIENTATION) {
                (true, true) => 0.0,
                (true, false) => TURN_LENGTH * angle,
                _ => distance,
            };
    }
    s
}

pub(super) fn arc_length_grows(poses: &[Pose], s: &[f64], i: usize) -> bool {
    if s[i] == s[i - 1] {
        let (distance, angle) = step(poses, i);
        return distance <= PATH_STANDSTILL && angle <= PATH_SAME_ORIENTATION;
    }
    s[i] > s[i - 1]
}

fn check_arc_length(poses: &[Pose], s: &[f64]) -> std::result::Result<(), String> {
    match (1..s.len()).find(|i| !arc_length_grows(poses, s, *i)) {
        None => Ok(()),
        Some(i) => {
            Err(format!("s[{i}] is {} after {}, arc length must increase with the pose", s[i], s[i - 1]))
        }
    }
}

/// Piecewise linear interpolation; `x` increases strictly.
fn linear(x: &[f64], y: &[f64], at: f64) -> f64 {
    let i = x.partition_point(|x| *x <= at).clamp(1, x.len() - 1);
    let u = ((at - x[i - 1]) / (x[i] - x[i - 1])).clamp(0.0, 1.0);
    if u == 1.0 { y[i] } else { y[i - 1] + u * (y[i] - y[i - 1]) }
}
