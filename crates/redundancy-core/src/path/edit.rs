//! Paths made from paths: moved, reversed, joined, resampled.

use super::path::{Path, arc_length, placed};
use super::piece::{PathPiece, Shape};
use super::shapes::{check_samples, even, intervals};
use crate::error::{Error, Result};
use crate::pose::{Pose, checked_pose};

impl Path {
    /// The path moved by a rigid transform: every pose `T` becomes `by * T`. Circle and raster stay what they are; arc
    /// lengths and times are kept.
    ///
    /// # Errors
    /// An invalid transform.
    ///
    /// ```
    /// use redundancy_core::{Pose, nalgebra::Vector3, path::{Circle, Shape}};
    /// let circle = Circle::new(Vector3::zeros(), 0.1, 0.0, 1.0, Vector3::z())?.path(50)?;
    /// let table = Pose::new(Vector3::new(0.5, 0.0, 0.3), Vector3::x() * 0.4);
    /// let moved = circle.transformed(&table)?;
    /// assert!(matches!(moved.shape(), Shape::Circle(_)));
    /// let (a, b) = (circle.at(0.123)?.pose.translation, moved.at(0.123)?.pose.translation);
    /// assert!((table.rotation * a.vector + table.translation.vector - b.vector).norm() < 1e-15);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn transformed(&self, by: &Pose) -> Result<Self> {
        let by = checked_pose("transform", by)?;
        let moved = |pose: &Pose| match self.has_orientation() {
            true => by * pose,
            false => placed(by.rotation * pose.translation.vector + by.translation.vector),
        };
        let poses = self.poses().iter().map(moved).collect();
        let pieces = self.pieces().map(|p| PathPiece { shape: p.shape.transformed(&by), ..p.clone() });
        Self::build(pieces.collect(), poses, self.has_orientation(), Some(self.s()), self.t())
    }

    /// The path from its end to its start: the same curve and orientations; arc lengths and times start where they started,
    /// and each section takes as long as before.
    ///
    /// # Errors
    /// None for a valid path; the signature leaves room for validation.
    pub fn reversed(&self) -> Result<Self> {
        let n = self.len();
        let mirrored = |values: &[f64]| -> Vec<f64> {
            let (first, last) = (values[0], values[n - 1]);
            // Written so that the ends are met to the last bit.
            values.iter().rev().map(|x| first + (last - x)).collect()
        };
        let (first, last) = (self.s()[0], self.s()[n - 1]);
        let pieces = self.pieces().map(|p| {
            let (shape, length) = p.shape.reversed();
            PathPiece {
                shape,
                shift: length - p.shift - last - first,
                first: n - 1 - p.last,
                last: n - 1 - p.first,
            }
        });
        let mut pieces: Vec<PathPiece> = pieces.collect();
        pieces.reverse();
        let poses = self.poses().iter().rev().copied().collect();
        let t = self.t().map(mirrored);
        Self::build(pieces, poses, self.has_orientation(), Some(&mirrored(self.s())), t.as_deref())
    }

    /// This path and then `other`. Each keeps its own curve, so that where they meet the path has a corner unless they meet
    /// smoothly. Where `other` starts at the pose at which this path ends, they share the sample; where it starts
    /// elsewhere, a straight line with a steady turn leads there.
    ///
    /// Times of `other` are shifted so that it starts when this path ends. Across a gap they are kept, since nobody says
    /// how long the line takes; they must then begin later than this path ends.
    ///
    /// # Errors
    /// Only one of the paths has orientations, or times; a gap and times that do not leave room for it.
    pub fn joined(&self, other: &Self) -> Result<Self> {
        let differs = |what: &str| {
            Error::Invalid(format!("only one of the two paths has {what}: give {what} to both or to none"))
        };
        if self.has_orientation() != other.has_orientation() {
            return Err(differs("orientations"));
        }
        let n = self.len();
        let (end, start) = (self.poses()[n - 1], other.poses()[0]);
        let gap = arc_length(&[end, start])[1];
        // A shared sample is taken from this path.
        let skip = usize::from(gap == 0.0);
        let t = match (self.t(), other.t()) {
            (None, None) => None,
            (Some(before), Some(after)) => {
                let (end, start) = (before[n - 1], after[0]);
                if skip == 0 && start <= end {
                    return Err(Error::Invalid(format!(
                        "the paths are {gap} m apart and the second starts at t = {start}, before the first ends at t = \
                         {end}: give it times that leave room for the way between them (with_times)"
                    )));
                }
                let shift = if skip == 1 { end - start } else { 0.0 };
                Some([before, &after[skip..].iter().map(|t| t + shift).collect::<Vec<_>>()].concat())
            }
            _ => return Err(differs("times")),
        };
        let shift = self.s()[n - 1] + gap - other.s()[0];
        let s = [self.s(), &other.s()[skip..].iter().map(|s| s + shift).collect::<Vec<_>>()].concat();
        let poses = [self.poses(), &other.poses()[skip..]].concat();
        let mut pieces: Vec<PathPiece> = self.pieces().cloned().collect();
        if skip == 0 {
            pieces.push(PathPiece { shape: Shape::Spline, shift: 0.0, first: n - 1, last: n });
        }
        let moved = n - skip;
        pieces.extend(other.pieces().map(|p| PathPiece {
            shape: p.shape.clone(),
            shift: p.shift - shift,
            first: p.first + moved,
            last: p.last + moved,
        }));
        Self::build(pieces, poses, self.has_orientation(), Some(&s), t.as_deref())
    }

    /// The same curve sampled about every `step` metres; times are interpolated linearly. Where pieces of a joined path meet,
    /// there is a sample.
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
        let (mut s, mut pieces) = (vec![self.s()[0]], Vec::new());
        for piece in self.pieces() {
            let (first, from) = (s.len() - 1, self.s()[piece.first]);
            let length = self.s()[piece.last] - from;
            s.extend(even(length, intervals(length, step)).iter().skip(1).map(|u| from + u));
            pieces.push(PathPiece { first, last: s.len() - 1, ..piece.clone() });
        }
        let t = match self.t() {
            None => None,
            Some(t) => {
                if let Some(i) = (1..self.len()).find(|i| self.s()[*i] <= self.s()[*i - 1]) {
                    let message = format!(
                        "the path stops at sample {i} (t = {}): resampling by arc length would lose the stop",
                        t[i]
                    );
                    return Err(Error::Invalid(message));
                }
                Some(s.iter().map(|s| linear(self.s(), t, *s)).collect::<Vec<_>>())
            }
        };
        let points = s.iter().map(|s| self.at(*s)).collect::<Result<Vec<_>>>()?;
        let poses = points.into_iter().map(|point| point.pose).collect();
        Self::build(pieces, poses, self.has_orientation(), Some(&s), t.as_deref())
    }
}

/// Piecewise linear interpolation; `x` increases strictly.
fn linear(x: &[f64], y: &[f64], at: f64) -> f64 {
    let i = x.partition_point(|x| *x <= at).clamp(1, x.len() - 1);
    let u = ((at - x[i - 1]) / (x[i] - x[i - 1])).clamp(0.0, 1.0);
    if u == 1.0 { y[i] } else { y[i - 1] + u * (y[i] - y[i - 1]) }
}
