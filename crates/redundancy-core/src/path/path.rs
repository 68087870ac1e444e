//! A path: samples and the curve through them.

use nalgebra::{IsometryMatrix3, Rotation3, Translation3, Vector3, Vector6};

use super::piece::{PathPiece, Piece, Shape};
use super::shapes::{Circle, Raster, even, out_of_range};
use crate::error::{Error, Result, check_finite, check_length};
use crate::pose::{Pose, checked_pose};
use crate::tolerance::{PATH_END_ROUNDING, PATH_SAME_ORIENTATION, PATH_STANDSTILL, TURN_LENGTH};

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
    oriented: bool,
    /// At least one; each starts at the sample at which the one before ends.
    pieces: Vec<Piece>,
}

/// The same samples, arc lengths, times and shapes: the same curve. Whether it carries orientations counts.
impl PartialEq for Path {
    fn eq(&self, other: &Self) -> bool {
        self.s == other.s
            && self.t == other.t
            && self.poses == other.poses
            && self.oriented == other.oriented
            && self.pieces().eq(other.pieces())
    }
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
        // Only what is refused needs its name.
        let named = |(i, pose): (usize, &Pose)| {
            checked_pose("pose", pose).or_else(|_| checked_pose(&format!("pose {i}"), pose))
        };
        let poses = poses.iter().enumerate().map(named);
        let poses = poses.collect::<Result<Vec<_>>>()?;
        Self::build(whole(Shape::Spline, poses.len()), poses, true, s, t)
    }

    /// A path of positions, metres: orientations are left open.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_positions(positions: &[Vector3<f64>], s: Option<&[f64]>, t: Option<&[f64]>) -> Result<Self> {
        for (i, position) in positions.iter().enumerate() {
            check_finite(&format!("position {i}"), position.as_slice())?;
        }
        let poses = positions.iter().map(|p| placed(*p)).collect();
        Self::build(whole(Shape::Spline, positions.len()), poses, false, s, t)
    }

    /// A path of positions that samples an analytic shape at `s`.
    ///
    /// # Errors
    /// As [`new`](Self::new); a shape that has no positions of its own.
    pub fn from_shape(shape: Shape, s: Vec<f64>) -> Result<Self> {
        check_finite("s", &s)?;
        let position = |s: &f64| {
            let none = || Error::Invalid("this shape has no positions without samples".into());
            shape.at(*s).map(|point| placed(point[0])).ok_or_else(none)
        };
        let poses = s.iter().map(position).collect::<Result<Vec<_>>>()?;
        Self::build(whole(shape, s.len()), poses, false, Some(&s), None)
    }

    /// A path from all that it is made of, see [`pieces`](Self::pieces). Without `oriented` the rotations are ignored.
    ///
    /// # Errors
    /// As [`new`](Self::new); pieces that do not follow each other over all samples, samples that are not on their shape.
    pub fn from_pieces(
        poses: &[Pose],
        oriented: bool,
        s: &[f64],
        t: Option<&[f64]>,
        pieces: Vec<PathPiece>,
    ) -> Result<Self> {
        check_length("s", s, poses.len())?;
        let mut next = 0;
        for PathPiece { shape, shift, first, last } in &pieces {
            if *first != next || last <= first || *last >= poses.len() || !shift.is_finite() {
                return Err(Error::Invalid(format!(
                    "a piece of the path holds samples {first} to {last}, expected {next} and a later one of {}",
                    poses.len()
                )));
            }
            next = *last;
            for i in *first..=*last {
                let Some([expected, ..]) = shape.at(s[i] + shift) else { break };
                let miss = (expected - poses[i].translation.vector).norm();
                if miss.is_nan() || miss > PATH_STANDSTILL * (1.0 + expected.norm()) {
                    return Err(Error::Invalid(format!(
                        "sample {i} is {miss} m away from the shape of its piece"
                    )));
                }
            }
        }
        if next + 1 != poses.len() {
            return Err(Error::Invalid(format!(
                "the pieces of the path end at sample {next}, the path has {} samples",
                poses.len()
            )));
        }
        let poses = poses.iter().enumerate().map(|(i, pose)| match oriented {
            true => checked_pose(&format!("pose {i}"), pose),
            false => Ok(placed(pose.translation.vector)),
        });
        Self::build(pieces, poses.collect::<Result<_>>()?, oriented, Some(s), t)
    }

    /// The caller has made sure that the poses are valid and that the pieces follow each other over all samples.
    pub(super) fn build(
        pieces: Vec<PathPiece>,
        poses: Vec<Pose>,
        oriented: bool,
        s: Option<&[f64]>,
        t: Option<&[f64]>,
    ) -> Result<Self> {
        let n = poses.len();
        if n < 2 {
            return Err(Error::Invalid(format!("a path needs at least two samples, got {n}")));
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
        let pieces = pieces.into_iter().map(|piece| Piece::new(piece, &poses, &s, oriented)).collect();
        Ok(Self { s, t: t.map(<[f64]>::to_vec), poses, oriented, pieces })
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
            *pose = checked_pose(&format!("orientation {i}"), pose)?;
        }
        Self::build(self.pieces().cloned().collect(), poses, true, Some(&self.s), self.t.as_deref())
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
        self.oriented
    }

    /// What the positions between samples come from; [`Shape::Joined`] for a path of several pieces.
    pub fn shape(&self) -> &Shape {
        match &self.pieces[..] {
            [only] => &only.outline.shape,
            _ => &Shape::Joined,
        }
    }

    /// The pieces of the curve, in order; one unless paths were joined.
    pub fn pieces(&self) -> impl Iterator<Item = &PathPiece> {
        self.pieces.iter().map(|piece| &piece.outline)
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
        // Where two pieces meet, the derivatives are those of the one that follows.
        let piece = match &self.pieces[..] {
            [only] => only,
            pieces => {
                let next = pieces.partition_point(|piece| self.s[piece.outline.first] <= s);
                &pieces[next.clamp(1, pieces.len()) - 1]
            }
        };
        let [p, d, dd] = piece.position_at(s);
        let (rotation, turn, turn_change) = piece.orientation_at(s).unwrap_or_else(|| {
            let i = self.s.partition_point(|x| *x <= s).clamp(1, self.len()) - 1;
            (self.poses[i].rotation, Vector3::zeros(), Vector3::zeros())
        });
        Ok(PathPoint {
            pose: Pose::from_parts(Translation3::from(p), rotation),
            derivative: stacked(&d, &turn),
            second_derivative: stacked(&dd, &turn_change),
        })
    }
}

impl Circle {
    /// The path of positions with `n` samples, both ends included.
    ///
    /// # Errors
    /// `n < 2`.
    pub fn path(&self, n: usize) -> Result<Path> {
        if n < 2 {
            return Err(out_of_range("n", n as f64, "at least 2"));
        }
        Path::from_shape(Shape::Circle(self.clone()), even(self.length(), n - 1))
    }
}

impl Raster {
    /// The path of positions, sampled about every `step` metres (the length divided evenly).
    ///
    /// # Errors
    /// A step that is not positive, or so small that there would be more than ten million samples.
    pub fn path(&self, step: f64) -> Result<Path> {
        Path::from_shape(Shape::Raster(self.clone()), self.samples(step)?)
    }
}

/// One piece of `n` samples.
pub(super) fn whole(shape: Shape, n: usize) -> Vec<PathPiece> {
    vec![PathPiece { shape, shift: 0.0, first: 0, last: n.saturating_sub(1) }]
}

pub(super) fn placed(position: Vector3<f64>) -> Pose {
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

pub(super) fn arc_length(poses: &[Pose]) -> Vec<f64> {
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
