//! The last refinement of a line: Newton's method on the swivels of all points.

use std::f64::consts::PI;

use super::problem::{SwivelLine, SwivelProblem};
use crate::joint_space::{TURN, nearest_all};
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;

/// Most Newton steps of the refinement, and the relative decrease of the cost at which it stops.
const POLISH_STEPS: usize = 40;
const POLISH_GAIN: f64 = 1e-7;
/// Step (rad) below which it stops as well.
const POLISH_STEP: f64 = 5e-8;
/// Difference step (rad) of the cost of a point along the swivel.
const POLISH_DIFFERENCE: f64 = 1e-4;
/// Most lengths of a step that are tried, and the factor from one to the next.
const POLISH_TRIALS: usize = 8;
const POLISH_SHRINK: f64 = 0.35;
/// Least pivot of the refinement's system: its entries are of the order of the points' share of the costs.
const PIVOT_FLOOR: f64 = 1e-12;

/// Slope and curvature of a point's cost along its swivel, and the rates of the joints.
struct LocalModel {
    rates: [f64; 7],
    slope: f64,
    bend: f64,
}

/// The system of a Newton step: the lower half of the matrix by diagonals, and the right side.
struct NewtonSystem {
    band: Vec<[f64; 3]>,
    right: Vec<f64>,
}

fn dot(a: &[f64; 7], b: &[f64; 7]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
}

impl SwivelProblem<'_> {
    /// Cost of a point at a swivel; `None` where it breaks a limit or touches an obstacle.
    fn point_cost(
        &self,
        k: usize,
        s: f64,
        branch: usize,
        near: &[f64; 7],
        scratch: &mut Scratch,
    ) -> Option<f64> {
        let q = self.circles[k].branch_of(s, branch);
        let q = nearest_all(&q, near);
        if !(0..7).all(|i| q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
            return None;
        }
        let place = self.place_cost(&q, self.distance(k, branch, s, &q), scratch)?;
        Some(self.node_cost(k, &q, s, place))
    }

    /// Newton's method on all swivels at once: exact in the motion terms to first order of the curves, differences in
    /// the cost of points. Neighbours couple only, so a step is one banded system. The ends of a closed line are one point.
    pub fn polish(&self, mut line: SwivelLine) -> SwivelLine {
        let n = line.q.len();
        if n < 2 || !line.reconfigurations.is_empty() {
            return line;
        }
        let Some((q, near)) = self.along(&line.swivel, &line.branch, &line.q[0]) else { return line };
        let mut cost = self.cost_of(&line.swivel, &q, &near);
        for _ in 0..POLISH_STEPS {
            let local = self.local_models(&line);
            let mut system = self.motion_system(&line, &local);
            if self.settings.acceleration_weight > 0.0 {
                self.add_acceleration(&mut system, &line, &local);
            }
            let step = if self.settings.cyclic { system.solve_closed() } else { system.solve() };
            let largest = step.iter().fold(0.0f64, |m, d| m.max(d.abs()));
            if largest.is_nan() || largest < POLISH_STEP {
                break;
            }
            let before = cost;
            let moved = self.shortened(&mut line, &step, largest, &mut cost);
            if !(moved && before - cost > POLISH_GAIN * before.abs()) {
                break;
            }
        }
        if self.settings.cyclic {
            line.q[n - 1] = line.q[0];
        }
        line
    }

    fn local_models(&self, line: &SwivelLine) -> Vec<LocalModel> {
        let h = POLISH_DIFFERENCE;
        let init = || Scratch::new(self.arm.chain());
        (0..line.q.len())
            .into_par_iter()
            .map_init(init, |scratch, k| {
                let (s, b, q) = (line.swivel[k], line.branch[k], &line.q[k]);
                let rates = self.circles[k].tangent_of(s, b);
                let [m, o, p] = [s - h, s, s + h].map(|s| self.point_cost(k, s, b, q, scratch));
                let (slope, bend) = match (m, o, p) {
                    (Some(m), Some(o), Some(p)) => {
                        ((p - m) / (2.0 * h), ((p - 2.0 * o + m) / (h * h)).max(0.0))
                    }
                    (Some(m), Some(o), None) => ((o - m) / h, 0.0),
                    (None, Some(o), Some(p)) => ((p - o) / h, 0.0),
                    _ => (0.0, 0.0),
                };
                LocalModel { rates, slope, bend }
            })
            .collect()
    }

    /// The costs of the points and of the steps between them.
    fn motion_system(&self, line: &SwivelLine, local: &[LocalModel]) -> NewtonSystem {
        let n = line.q.len();
        let (mut band, mut right) = (vec![[0.0; 3]; n], vec![0.0; n]);
        for (k, LocalModel { slope, bend, .. }) in local.iter().enumerate() {
            band[k][0] += bend;
            right[k] -= slope;
        }
        for k in 1..n {
            let c = 2.0 * self.settings.motion_weight / self.parts[k - 1];
            let (a, b) = (&local[k - 1].rates, &local[k].rates);
            let d: [f64; 7] = std::array::from_fn(|i| line.q[k][i] - line.q[k - 1][i]);
            band[k - 1][0] += c * dot(a, a);
            band[k][0] += c * dot(b, b);
            band[k][1] -= c * dot(a, b);
            right[k] -= c * dot(b, &d);
            right[k - 1] += c * dot(a, &d);
        }
        NewtonSystem { band, right }
    }

    /// The costs of the second differences.
    fn add_acceleration(&self, system: &mut NewtonSystem, line: &SwivelLine, local: &[LocalModel]) {
        let NewtonSystem { band, right } = system;
        for k in 1..line.q.len() - 1 {
            let (a, b) = (1.0 / self.parts[k - 1], 1.0 / self.parts[k]);
            let c = 2.0 * self.settings.acceleration_weight / (0.5 * (self.parts[k - 1] + self.parts[k]));
            let d: [f64; 7] = std::array::from_fn(|i| {
                (line.q[k + 1][i] - line.q[k][i]) * b - (line.q[k][i] - line.q[k - 1][i]) * a
            });
            let factors = [a, -(a + b), b];
            for i in 0..3 {
                let left = &local[k - 1 + i].rates;
                right[k - 1 + i] -= c * factors[i] * dot(left, &d);
                for j in 0..=i {
                    band[k - 1 + i][i - j] +=
                        c * factors[i] * factors[j] * dot(left, &local[k - 1 + j].rates);
                }
            }
        }
    }

    /// The longest part of a step that is found to lower the cost, if any.
    fn shortened(&self, line: &mut SwivelLine, step: &[f64], largest: f64, cost: &mut f64) -> bool {
        let trust = TURN / self.settings.swivels as f64;
        let mut share = (trust / largest).min(1.0);
        for _ in 0..POLISH_TRIALS {
            let swivel: Vec<f64> = line.swivel.iter().zip(step).map(|(s, d)| s + share * d).collect();
            if let Some((q, near)) = self.along(&swivel, &line.branch, &line.q[0]) {
                let next = self.cost_of(&swivel, &q, &near);
                let closes = !self.settings.cyclic || closes(&q);
                if closes && next < *cost {
                    (line.swivel, line.q, *cost) = (swivel, q, next);
                    return true;
                }
            }
            share *= POLISH_SHRINK;
        }
        false
    }
}

/// Whether a line ends with the windings with which it began.
fn closes(q: &[[f64; 7]]) -> bool {
    let ends = q.first().zip(q.last());
    ends.is_none_or(|(first, last)| first.iter().zip(last).all(|(a, b)| (a - b).abs() < PI))
}

impl NewtonSystem {
    /// Keeps the first and the last point where they are.
    fn hold_ends(&mut self) {
        let n = self.band.len();
        for k in [0, n - 1] {
            self.band[k] = [1.0, 0.0, 0.0];
            self.right[k] = 0.0;
        }
        for (k, diagonal) in [(1, 1), (2, 2)] {
            if k < n {
                self.band[k][diagonal] = 0.0;
            }
        }
    }

    fn solve(mut self) -> Vec<f64> {
        solve_banded(&mut self.band, &mut self.right);
        self.right
    }

    /// The step of a closed line, whose first and last point are one: with x their common step, the others are `u - x w`,
    /// where `u` solves the system with the ends held and `w` that of their couplings to the ends.
    fn solve_closed(mut self) -> Vec<f64> {
        let n = self.band.len();
        let mut coupling = vec![0.0; n];
        let mut diagonal = self.band[0][0] + self.band[n - 1][0];
        for (k, value) in [
            (1, self.band[1][1]),
            (2, self.band[2][2]),
            (n - 2, self.band[n - 1][1]),
            (n - 3, self.band[n - 1][2]),
        ] {
            // A path of three points couples its ends to each other.
            if k == 0 || k == n - 1 { diagonal += value } else { coupling[k] += value }
        }
        let right = self.right[0] + self.right[n - 1];
        self.hold_ends();
        let mut w = coupling.clone();
        solve_banded(&mut self.band.clone(), &mut w);
        let mut step = self.solve();
        let along = |x: &[f64]| coupling.iter().zip(x).map(|(c, x)| c * x).sum::<f64>();
        let pivot = (diagonal - along(&w)).max(PIVOT_FLOOR);
        let ends = (right - along(&step)) / pivot;
        step.iter_mut().zip(&w).for_each(|(u, w)| *u -= ends * w);
        (step[0], step[n - 1]) = (ends, ends);
        step
    }
}

/// Solves a symmetric positive definite system with two lower diagonals, in place; pivots that vanish count as 1e-12.
fn solve_banded(band: &mut [[f64; 3]], x: &mut [f64]) {
    let n = x.len();
    // L D L^T, row by row.
    for k in 0..n {
        if k >= 2 {
            let l = band[k][2] / band[k - 2][0];
            band[k][1] -= l * band[k - 1][1] * band[k - 2][0];
            band[k][0] -= l * band[k][2];
            band[k][2] = l;
        }
        if k >= 1 {
            let l = band[k][1] / band[k - 1][0];
            band[k][0] -= l * band[k][1];
            band[k][1] = l;
        }
        band[k][0] = band[k][0].max(PIVOT_FLOOR);
    }
    for k in 0..n {
        if k >= 1 {
            x[k] -= band[k][1] * x[k - 1];
        }
        if k >= 2 {
            x[k] -= band[k][2] * x[k - 2];
        }
    }
    for k in (0..n).rev() {
        x[k] /= band[k][0];
        if k + 1 < n {
            x[k] -= band[k + 1][1] * x[k + 1];
        }
        if k + 2 < n {
            x[k] -= band[k + 2][2] * x[k + 2];
        }
    }
}
