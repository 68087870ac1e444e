//! Evaluation of a candidate on a grid at least five times finer than its samples.

use nalgebra::{Const, SVector};

use super::convex::{BoundKind, rows_of, spline_at};
use super::motion::Size;
use super::planner::{OrientationPlanner, PlanCandidate, Verified};
use super::result::{Bottleneck, SpeedBound};
use crate::path::QuinticBasis;
use crate::tolerance::JOINT_JUMP;

/// Largest step (m) of the grid on which a plan is verified and returned.
const VERIFIED_STEP: f64 = 4e-4;
/// How many times finer than the samples the grid of the verification is at least.
const FINER: usize = 5;
/// Most rows of a plan.
const MOST_ROWS: usize = 1_000_000;
/// What rounding may add to a tilt at the rim of the cone, relative.
const CONE_ROUNDING: f64 = 1e-12;

impl<'a, const N: usize, const M: usize> OrientationPlanner<'a, N, M>
where
    Const<N>: Size,
{
    pub(super) fn keep_best(
        &self,
        basis: &QuinticBasis,
        candidates: &[PlanCandidate<N, M>],
        best: &mut Option<Verified>,
    ) {
        for candidate in candidates {
            if let Some(found) = self.verify(basis, candidate)
                && best.as_ref().is_none_or(|b| found.t < b.t)
            {
                *best = Some(found);
            }
        }
    }

    /// Evaluates a candidate on the finest grid. A tilt that leaves the cone between samples is scaled back.
    fn verify(&self, basis: &QuinticBasis, candidate: &PlanCandidate<N, M>) -> Option<Verified> {
        let mut coefficients = candidate.state.coefficients.clone();
        let (low, high) = self.curve.ends();
        let sampled = candidate.state.q.len() - 1;
        let count = (((high - low) / VERIFIED_STEP).ceil() as usize).max(FINER * sampled).min(MOST_ROWS);
        let s: Vec<f64> = (0..=count).map(|k| low + (high - low) * k as f64 / count as f64).collect();
        let locals: Vec<_> = s.iter().map(|s| basis.at(*s)).collect();
        let largest_tilt = |c: &[SVector<f64, M>]| {
            locals.iter().map(|l| spline_at(l, c)[0]).map(|u| u[0].hypot(u[1])).fold(0.0, f64::max)
        };
        let most = largest_tilt(&coefficients);
        if most > self.bounds.tilt {
            let factor = self.bounds.tilt * (1.0 - CONE_ROUNDING) / most;
            for c in &mut coefficients {
                c[0] *= factor;
                c[1] *= factor;
            }
        }
        let arm = self.arm(&candidate.spare);
        let mut work = self.workspace.clone();
        let mut q: Vec<f64> = Vec::with_capacity(s.len() * N);
        let (mut poses, mut tilt, mut spin) = (Vec::new(), Vec::new(), Vec::new());
        let (mut gravity, mut dynamic, mut rates) = (Vec::new(), Vec::new(), Vec::new());
        let mut near = candidate.state.q[0];
        let (mut t, mut limiting) = (0.0, (BoundKind::Rate, 0));
        for (k, local) in locals.iter().enumerate() {
            let u = spline_at(local, &coefficients);
            let motion = arm.motion(&self.curve.at(s[k]), &u, &near, &mut work, None)?;
            let jumps = k > 0 && (0..N).any(|j| (motion.q[j] - q[(k - 1) * N + j]).abs() > JOINT_JUMP);
            let outside =
                (0..N).any(|j| motion.q[j] < self.bounds.lower[j] || motion.q[j] > self.bounds.upper[j]);
            if jumps || outside || u[0][2].abs() > self.bounds.spin {
                return None;
            }
            rows_of(&self.bounds, &motion, |kind, value| {
                if value > t {
                    (t, limiting) = (value, (kind, k));
                }
            })
            .ok()?;
            let step = if k < count { s[k + 1] - s[k] } else { 0.0 };
            near = motion.q + motion.d * step + motion.dd * (0.5 * step * step);
            q.extend_from_slice(motion.q.as_slice());
            rates.extend_from_slice(motion.d.as_slice());
            gravity.extend_from_slice(motion.gravity.as_slice());
            dynamic.extend_from_slice(motion.dynamic.as_slice());
            poses.push(motion.pose);
            tilt.push([u[0][0], u[0][1]]);
            spin.push(u[0][2]);
        }
        if !(t > 0.0 && t.is_finite()) {
            return None;
        }
        let speed = 1.0 / t.sqrt();
        let qd = rates.iter().map(|d: &f64| d * speed).collect();
        let torques = gravity.iter().zip(&dynamic).map(|(g, d): (&f64, &f64)| g + d / t).collect();
        let bound = match limiting.0 {
            BoundKind::Up(j) | BoundKind::Down(j) => SpeedBound::Torque(j),
            BoundKind::Velocity(j) => SpeedBound::Velocity(j),
            BoundKind::Rate => SpeedBound::Rate,
        };
        let bottleneck = Bottleneck { row: limiting.1, bound };
        Some(Verified { t, s, q, qd, poses, tilt, spin, torques, bottleneck })
    }
}
