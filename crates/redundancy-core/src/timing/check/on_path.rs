//! Whether the tool follows its path.
//!
//! With one row per point of the path each row is compared with its point. Other motions are followed along the path: each
//! row belongs to the nearest place of the path that the tool can have reached since the row before. Behind a curve that
//! replaces a corner it belongs to the first place ahead at which it is on the path: the curve is shorter than the path.

use super::finding::FindingKind;
use super::settings::CheckSettings;
use super::spots::{Owner, Spot};
use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::rotation_vector;
use crate::path::{Path, Section, Trajectory};
use crate::pose::Pose;

/// How much further along the path than the tool moved a row may be: corners are cut, samples are apart.
const REACH: f64 = 2.0;
/// Golden section steps between two samples of the path.
const STEPS: usize = 40;

/// Deviations from the path.
pub(super) fn deviations(
    chain: &Chain,
    trajectory: &Trajectory,
    path: &Path,
    settings: &CheckSettings,
) -> Result<Vec<Spot>> {
    let on_path = |row: usize| trajectory.sections().is_none_or(|sections| sections[row] == Section::Path);
    let rows: Vec<usize> = (0..trajectory.rows()).filter(|row| on_path(*row)).collect();
    let poses =
        rows.iter().map(|row| chain.forward(trajectory.q_row(*row))).collect::<Result<Vec<Pose>>>()?;
    let mut out = Vec::new();
    let one_each = rows.len() == path.len();
    let mut along = Along::new(path);
    for (i, (row, pose)) in rows.iter().zip(&poses).enumerate() {
        let target = if one_each {
            path.poses()[i]
        } else {
            match i.checked_sub(1) {
                Some(last) if rows[last] + 1 < *row => along.resumed(pose, settings.position_tolerance)?,
                last => along.nearest(pose, last.map(|last| &poses[last]))?,
            }
        };
        compare(trajectory, path, settings, *row, pose, &target, &mut out);
    }
    if let (false, Some(row)) = (one_each, rows.last()) {
        let (end, value) = (path.s()[path.len() - 1], path.s()[path.len() - 1] - along.s);
        let tip = (poses[poses.len() - 1].translation.vector
            - path.poses()[path.len() - 1].translation.vector)
            .norm();
        if value > settings.position_tolerance && tip > settings.position_tolerance {
            let message = format!(
                "the motion ends at {:.6} m of the path's {end:.6} m, {tip:.6} m from its end",
                along.s
            );
            let owner = Owner { part: 2, ..Owner::arm(FindingKind::PathDeviation) };
            let (bound, t) = (settings.position_tolerance, trajectory.t()[*row]);
            let (row, weight, value) = (*row, tip, tip);
            out.push(Spot { owner, cell: row, row, t, value, bound, weight, message: Some(message) });
        }
    }
    Ok(out)
}

fn compare(
    trajectory: &Trajectory,
    path: &Path,
    settings: &CheckSettings,
    row: usize,
    pose: &Pose,
    target: &Pose,
    out: &mut Vec<Spot>,
) {
    let t = trajectory.t()[row];
    let mut add = |value: f64, bound: f64, part: usize, unit: &str| {
        let message = format!(
            "the tool is {value:.6} {unit} from the path at row {row}, at most {bound:.6} is allowed, at {t:.6} s"
        );
        let owner = Owner { part, ..Owner::arm(FindingKind::PathDeviation) };
        let weight = value;
        out.push(Spot { owner, cell: row, row, t, value, bound, weight, message: Some(message) });
    };
    let distance = (pose.translation.vector - target.translation.vector).norm();
    if distance > settings.position_tolerance {
        add(distance, settings.position_tolerance, 0, "m");
    }
    if let (true, Some(bound)) = (path.has_orientation(), settings.orientation_tolerance) {
        let angle = rotation_vector(&(pose.rotation * target.rotation.inverse())).norm();
        if angle > bound {
            add(angle, bound, 1, "rad");
        }
    }
}

/// A place that moves along a path.
struct Along<'a> {
    path: &'a Path,
    s: f64,
    spacing: f64,
}

impl<'a> Along<'a> {
    fn new(path: &'a Path) -> Self {
        let s = path.s();
        let spacing = s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        Self { path, s: s.first().copied().unwrap_or(0.0), spacing }
    }

    /// The pose of the path nearest to `pose`, within reach of the place before.
    fn nearest(&mut self, pose: &Pose, before: Option<&Pose>) -> Result<Pose> {
        let moved = before.map_or(0.0, |b| (pose.translation.vector - b.translation.vector).norm());
        let s = self.path.s();
        let last = s.len() - 1;
        let window = self.s + REACH * (moved + self.spacing);
        let first = s.partition_point(|at| *at <= self.s).saturating_sub(1);
        let end = s.partition_point(|at| *at < window).min(last);
        let away =
            |i: usize| (self.path.poses()[i].translation.vector - pose.translation.vector).norm_squared();
        let best = (first..=end).min_by(|a, b| away(*a).total_cmp(&away(*b))).unwrap_or(first);
        self.refined(best, pose)
    }

    /// The pose of the first place ahead that is within `tolerance` (m) of `pose`, or the nearest one ahead.
    fn resumed(&mut self, pose: &Pose, tolerance: f64) -> Result<Pose> {
        let (poses, last) = (self.path.poses(), self.path.len() - 1);
        let away = |i: usize| (poses[i].translation.vector - pose.translation.vector).norm_squared();
        let first = self.path.s().partition_point(|at| *at <= self.s).saturating_sub(1);
        let (from, mut nearest) = (self.s, None::<(f64, f64)>);
        for i in first..=last {
            let falls = i > first && away(i - 1) < away(i);
            if falls || (i < last && away(i + 1) < away(i)) {
                continue;
            }
            self.s = from;
            let place = self.refined(i, pose)?;
            let distance = (place.translation.vector - pose.translation.vector).norm();
            if distance <= tolerance {
                return Ok(place);
            }
            if nearest.is_none_or(|(least, _)| distance < least) {
                nearest = Some((distance, self.s));
            }
        }
        self.s = nearest.map_or(from, |(_, s)| s);
        Ok(self.path.at(self.s)?.pose)
    }

    /// The pose of the place nearest to `pose` within a sample's neighbours, not behind the place before.
    fn refined(&mut self, best: usize, pose: &Pose) -> Result<Pose> {
        let s = self.path.s();
        let last = s.len() - 1;
        let (mut low, mut high) =
            (s[best.saturating_sub(1)].max(self.s), s[(best + 1).min(last)].max(self.s));
        let square = |s: f64| -> Result<f64> {
            Ok((self.path.at(s)?.pose.translation.vector - pose.translation.vector).norm_squared())
        };
        let inner = 0.5 * (5.0_f64.sqrt() - 1.0);
        let mut at = [high - inner * (high - low), low + inner * (high - low)];
        let mut values = [square(at[0])?, square(at[1])?];
        for _ in 0..STEPS {
            if values[0] < values[1] {
                high = at[1];
                at = [high - inner * (high - low), at[0]];
                values = [square(at[0])?, values[0]];
            } else {
                low = at[0];
                at = [at[1], low + inner * (high - low)];
                values = [values[1], square(at[1])?];
            }
        }
        self.s = 0.5 * (low + high);
        Ok(self.path.at(self.s)?.pose)
    }
}
