//! Starts of the search: branches of the arm x spin angles and turns x tilts, as far as they can be followed.

use std::sync::atomic::Ordering;

use nalgebra::{Const, SVector, Vector3};

use super::convex::{SplinePlan, SplineSamples, spline_at};
use super::motion::{Size, Workspace};
use super::planner::{OrientationPlanner, PlanCandidate};
use super::rule::Surface;
use super::settings::SpinRange;
use crate::joint_space::{TURN, nearest};
use crate::parallel::prelude::*;
use crate::pose::Pose;
use crate::solutions::lines;

/// Part of the time limit that the starts may take.
const START_SHARE: f64 = 0.2;

/// How a start spins.
#[derive(Debug, Clone, Copy)]
enum SpinShape {
    Turns { from: f64, turns: f64 },
    Pointing { turns: f64 },
}

/// How the tool leans and spins in a start.
#[derive(Debug, Clone, Copy)]
struct StartShape {
    /// Lean away from the middle of the path, as a share of the largest tilt.
    lean: f64,
    spin: SpinShape,
}

impl<'a, const N: usize, const M: usize> OrientationPlanner<'a, N, M>
where
    Const<N>: Size,
{
    /// Everything that can be followed, best first.
    pub(super) fn starts(&self, grid: &SplineSamples) -> Vec<PlanCandidate<N, M>> {
        let sites = grid.basis.greville();
        let center = Surface::around(&grid.points.iter().map(|p| p.position[0]).collect::<Vec<_>>());
        let mut found: Vec<PlanCandidate<N, M>> = self
            .shapes()
            .par_iter()
            .enumerate()
            .flat_map_iter(|(i, shape)| {
                // The first one is the path's own orientation: it is always tried.
                if i > 0 && self.over(START_SHARE) {
                    self.skipped.store(true, Ordering::Relaxed);
                    return Vec::new();
                }
                let values = self.tilt_and_spin(*shape, &sites, &center);
                let three = grid.basis.interpolate(&sites, &values);
                let poses: Vec<Pose> = (0..grid.s.len())
                    .map(|k| {
                        let u = spline_at(&grid.locals[k], &three);
                        let turned = grid.points[k].turned(u.map(|row| [row[0], row[1], row[2]]));
                        crate::pose::pose(*turned.rotation.matrix(), grid.points[k].position[0])
                    })
                    .collect();
                let mut work = self.workspace.clone();
                lines::starts(self.chain, self.form.as_deref(), &poses[0])
                    .iter()
                    .filter_map(|start| self.start(grid, &three, &poses, start, &mut work))
                    .collect()
            })
            .collect();
        found.sort_by(|a, b| a.state.t.total_cmp(&b.state.t));
        found
    }

    /// The shapes that are tried, the path's own orientation first.
    fn shapes(&self) -> Vec<StartShape> {
        let mut shapes = Vec::new();
        let leans: &[f64] = if self.bounds.tilt == 0.0 { &[0.0] } else { &[0.0, 0.35, 0.75] };
        for lean in leans.iter().copied() {
            let mut add = |spin| shapes.push(StartShape { lean, spin });
            match self.settings.spin {
                SpinRange::Within(_) => add(SpinShape::Turns { from: 0.0, turns: 0.0 }),
                SpinRange::Free => {
                    for turns in [0.0, 1.0, -1.0] {
                        let parts = if N == 6 { 8 } else { 4 };
                        for k in 0..parts {
                            let from = TURN * f64::from(k) / f64::from(parts);
                            add(SpinShape::Turns { from, turns });
                        }
                        add(SpinShape::Pointing { turns });
                    }
                }
            }
        }
        shapes
    }

    /// Tilt and spin of a shape at arc lengths.
    fn tilt_and_spin(&self, shape: StartShape, places: &[f64], center: &Surface) -> Vec<Vector3<f64>> {
        let (low, high) = self.curve.ends();
        let most = center.radius.max(f64::MIN_POSITIVE);
        let mut last = None;
        let mut at = |s: &f64| {
            let point = self.curve.at(*s);
            let p = point.position[0];
            let z = point.rotation.column(2).into_owned();
            let offset = Vector3::new(p.x - center.center[0], p.y - center.center[1], 0.0);
            let e = point.rotation.tr_mul(&z.cross(&offset)) * (shape.lean * self.bounds.tilt / most);
            let share = (s - low) / (high - low);
            let psi = match shape.spin {
                SpinShape::Turns { from, turns } => from + TURN * turns * share,
                SpinShape::Pointing { turns } => {
                    let radial = point.rotation.tr_mul(&Vector3::new(-p.x, -p.y, 0.0));
                    let angle = radial.y.atan2(radial.x);
                    let angle = last.map_or(angle, |last| nearest(angle, last));
                    last = Some(angle);
                    angle + TURN * turns * share
                }
            };
            Vector3::new(e.x, e.y, psi)
        };
        places.iter().map(&mut at).collect()
    }

    fn start(
        &self,
        grid: &SplineSamples,
        three: &[Vector3<f64>],
        poses: &[Pose],
        start: &[f64],
        work: &mut Workspace<N>,
    ) -> Option<PlanCandidate<N, M>> {
        let mut line = lines::follow(self.chain, poses, start).ok()?;
        if self.settings.speed.joint_limits {
            lines::wind(self.chain, &mut line).ok()?;
        }
        let q: Vec<SVector<f64, N>> = line.chunks_exact(N).map(SVector::from_column_slice).collect();
        let spare = self.spare(&q);
        let extra: Vec<Vec<f64>> = spare.iter().map(|row| q.iter().map(|q| row.dot(q)).collect()).collect();
        let sites = grid.basis.greville();
        let extra: Vec<SVector<f64, M>> = sites
            .iter()
            .map(|s| {
                let mut value = SVector::<f64, M>::zeros();
                for (i, samples) in extra.iter().enumerate() {
                    value[3 + i] = interpolated(&grid.s, samples, *s);
                }
                value
            })
            .collect();
        let mut coefficients = grid.basis.interpolate(&sites, &extra);
        for (c, u) in coefficients.iter_mut().zip(three) {
            for i in 0..3 {
                c[i] = u[i];
            }
        }
        let state = SplinePlan::new(&self.arm(&spare), grid, &self.bounds, coefficients, &q, work).ok()?;
        Some(PlanCandidate { spare, state })
    }

    /// The null-space direction, averaged along the line, for an arm with a spare joint.
    fn spare(&self, q: &[SVector<f64, N>]) -> Vec<SVector<f64, N>> {
        if N <= 6 {
            return Vec::new();
        }
        let mut sum = SVector::<f64, N>::zeros();
        let mut last = SVector::<f64, N>::zeros();
        for q in q {
            let Ok(jacobian) = self.chain.jacobian(q.as_slice()) else { continue };
            let gram = jacobian.tr_mul(&jacobian);
            let eigen = gram.symmetric_eigen();
            let least = eigen.eigenvalues.imin();
            let mut direction = SVector::<f64, N>::from_fn(|i, _| eigen.eigenvectors[(i, least)]);
            if direction.dot(&last) < 0.0 {
                direction = -direction;
            }
            last = direction;
            sum += direction;
        }
        vec![sum.try_normalize(f64::MIN_POSITIVE).unwrap_or(last)]
    }
}

/// Piecewise linear interpolation; `x` increases.
fn interpolated(x: &[f64], y: &[f64], at: f64) -> f64 {
    let i = x.partition_point(|x| *x <= at).clamp(1, x.len() - 1);
    let u = (at - x[i - 1]) / (x[i] - x[i - 1]);
    y[i - 1] * (1.0 - u) + y[i] * u
}
