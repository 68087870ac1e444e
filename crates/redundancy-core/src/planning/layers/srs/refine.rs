//! The line of the grid as a smooth one: dynamic programming in a tube around it, then Newton's method on all points.

use super::problem::{Line, Problem};
use crate::joint_space::{TURN, nearest, nearest_all};
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;

/// Most Newton steps of the refinement, and the relative decrease of the cost at which it stops.
const POLISH_STEPS: usize = 40;
const POLISH_GAIN: f64 = 1e-7;
/// Step (rad) below which it stops as well.
const POLISH_STEP: f64 = 5e-8;
/// Difference step (rad) of the cost of a point along the swivel.
const POLISH_DIFFERENCE: f64 = 1e-4;
/// Most passes in the tube around the chosen line while it still travels, and in all.
const TUBE_TRAVELS: usize = 40;
const TUBE_PASSES: usize = 60;
/// Spacing of the swivels in the tube (rad) from which Newton's method goes on.
const TUBE_SPACING: f64 = 1e-3;
/// Swivels across the tube, odd.
const TUBE_WIDTH: usize = 9;

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

/// Least pivot of the refinement's system: its entries are of the order of the points' share of the costs.
const PIVOT_FLOOR: f64 = 1e-12;

impl Problem<'_> {
    /// A line on thinned points as one on all points, with the swivel linear in between; `None` where that breaks a limit
    /// or touches an obstacle.
    pub fn spread(&self, thin: &Line, stride: usize) -> Option<Line> {
        let n = self.circles.len();
        let (mut swivel, mut branch) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for k in 0..n {
            let (at, last) = (k / stride, (k / stride + 1).min(thin.swivel.len() - 1));
            let length = if (at + 1) * stride < n { stride } else { (n - 1 - at * stride).max(1) };
            let share = (k - at * stride) as f64 / length as f64;
            swivel.push(thin.swivel[at] + share * (thin.swivel[last] - thin.swivel[at]));
            branch.push(thin.branch[at]);
        }
        let (q, _) = self.along(&swivel, &branch, &thin.q[0])?;
        Some(Line { branch, swivel, q, reconfigurations: Vec::new(), cost: thin.cost })
    }

    /// The joint positions along swivels, unwound from `first` on, and the distances from the obstacles; `None` where they
    /// break a limit, step too far or touch an obstacle, at a point or between two.
    fn along(&self, swivel: &[f64], branch: &[usize], first: &[f64; 7]) -> Option<(Vec<[f64; 7]>, Vec<f64>)> {
        let init = || Scratch::new(self.arm.chain());
        let (mut rows, near): (Vec<[f64; 7]>, Vec<f64>) = swivel
            .par_iter()
            .enumerate()
            .map_init(init, |scratch, (k, s)| {
                let q = self.circles[k].branch_of(*s, branch[k]);
                (q, self.distance(k, *s, &q, scratch))
            })
            .unzip();
        let mut before = *first;
        for (k, q) in rows.iter_mut().enumerate() {
            for i in 0..7 {
                q[i] = nearest(q[i], before[i]);
                let step = k == 0 || (q[i] - before[i]).abs() <= self.steps[k - 1][i];
                if !(step && q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
                    return None;
                }
            }
            if near[k] <= 0.0 {
                return None;
            }
            before = *q;
        }
        let clear = self.obstacles.is_none()
            || (1..rows.len())
                .into_par_iter()
                .map_init(init, |scratch, k| {
                    self.edge_is_clear(k - 1, [&rows[k - 1], &rows[k]], [near[k - 1], near[k]], scratch)
                })
                .all(|clear| clear);
        clear.then_some((rows, near))
    }

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
        let place = self.place_cost(&q, self.distance(k, s, &q, scratch), scratch)?;
        Some(self.node_cost(k, &q, s, place))
    }

    /// Total cost of a line whose distances from the obstacles are known.
    pub fn cost_of(&self, swivel: &[f64], q: &[[f64; 7]], near: &[f64]) -> f64 {
        let init = || Scratch::new(self.arm.chain());
        let points: Vec<f64> = (0..q.len())
            .into_par_iter()
            .map_init(init, |scratch, k| {
                let place = self.place_cost(&q[k], near[k], scratch);
                place.map_or(f64::INFINITY, |place| self.node_cost(k, &q[k], swivel[k], place))
            })
            .collect();
        // In order, so that the sum does not depend on the threads.
        let mut total: f64 = points.iter().sum();
        for k in 1..q.len() {
            total += self.step_cost(k - 1, &q[k - 1], &q[k]).unwrap_or(f64::INFINITY);
        }
        if self.settings.acceleration_weight > 0.0 {
            for k in 1..q.len() - 1 {
                let (a, b) = (1.0 / self.parts[k - 1], 1.0 / self.parts[k]);
                let share = 0.5 * (self.parts[k - 1] + self.parts[k]);
                let square: f64 =
                    (0..7).map(|i| ((q[k + 1][i] - q[k][i]) * b - (q[k][i] - q[k - 1][i]) * a).powi(2)).sum();
                total += self.settings.acceleration_weight * square / share;
            }
        }
        total
    }

    /// Newton's method on all swivels at once: exact in the motion terms to first order of the curves, differences in
    /// the cost of points. Neighbours couple only, so a step is one banded system. The ends of a closed line stay.
    pub fn polish(&self, mut line: Line) -> Line {
        let n = line.q.len();
        if n < 2 || !line.reconfigurations.is_empty() {
            return line;
        }
        let ring = self.settings.cyclic;
        let trust = TURN / self.settings.swivels as f64;
        let (w, wa) = (self.settings.motion_weight, self.settings.acceleration_weight);
        let Some((q, near)) = self.along(&line.swivel, &line.branch, &line.q[0]) else { return line };
        let mut cost = self.cost_of(&line.swivel, &q, &near);
        for _ in 0..POLISH_STEPS {
            let h = POLISH_DIFFERENCE;
            let init = || Scratch::new(self.arm.chain());
            let local: Vec<([f64; 7], f64, f64)> = (0..n)
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
                    (rates, slope, bend)
                })
                .collect();
            // Lower half of the matrix by diagonals, and the right side.
            let mut band = vec![[0.0; 3]; n];
            let mut step = vec![0.0; n];
            for (k, (_, slope, bend)) in local.iter().enumerate() {
                band[k][0] += bend;
                step[k] -= slope;
            }
            let dot = |a: &[f64; 7], b: &[f64; 7]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            for k in 1..n {
                let c = 2.0 * w / self.parts[k - 1];
                let (a, b) = (&local[k - 1].0, &local[k].0);
                let d: [f64; 7] = std::array::from_fn(|i| line.q[k][i] - line.q[k - 1][i]);
                band[k - 1][0] += c * dot(a, a);
                band[k][0] += c * dot(b, b);
                band[k][1] -= c * dot(a, b);
                step[k] -= c * dot(b, &d);
                step[k - 1] += c * dot(a, &d);
            }
            if wa > 0.0 {
                for k in 1..n - 1 {
                    let (a, b) = (1.0 / self.parts[k - 1], 1.0 / self.parts[k]);
                    let c = 2.0 * wa / (0.5 * (self.parts[k - 1] + self.parts[k]));
                    let d: [f64; 7] = std::array::from_fn(|i| {
                        (line.q[k + 1][i] - line.q[k][i]) * b - (line.q[k][i] - line.q[k - 1][i]) * a
                    });
                    let factors = [a, -(a + b), b];
                    for i in 0..3 {
                        let left = &local[k - 1 + i].0;
                        step[k - 1 + i] -= c * factors[i] * dot(left, &d);
                        for j in 0..=i {
                            band[k - 1 + i][i - j] +=
                                c * factors[i] * factors[j] * dot(left, &local[k - 1 + j].0);
                        }
                    }
                }
            }
            if ring {
                for k in [0, n - 1] {
                    band[k] = [1.0, 0.0, 0.0];
                    step[k] = 0.0;
                }
                for (k, diagonal) in [(1, 1), (2, 2)] {
                    if k < n {
                        band[k][diagonal] = 0.0;
                    }
                }
            }
            solve_banded(&mut band, &mut step);
            let largest = step.iter().fold(0.0f64, |m, d| m.max(d.abs()));
            if largest.is_nan() || largest < POLISH_STEP {
                break;
            }
            let mut share = (trust / largest).min(1.0);
            let mut found = false;
            for _ in 0..8 {
                let swivel: Vec<f64> = line.swivel.iter().zip(&step).map(|(s, d)| s + share * d).collect();
                if let Some((q, near)) = self.along(&swivel, &line.branch, &line.q[0]) {
                    let next = self.cost_of(&swivel, &q, &near);
                    if next < cost {
                        found = cost - next > POLISH_GAIN * cost.abs();
                        (line.swivel, line.q, cost) = (swivel, q, next);
                        break;
                    }
                }
                share *= 0.35;
            }
            if !found {
                break;
            }
        }
        if ring {
            line.q[n - 1] = line.q[0];
        }
        line
    }

    /// Dynamic programming in a tube around the line, which shrinks. The ends of a closed line stay where they are; it is
    /// cut open elsewhere in every other pass. `whole`: between its points it must be clear of obstacles too.
    pub fn smooth(&self, mut line: Line, whole: bool) -> Line {
        let n = line.q.len();
        let ring = self.settings.cyclic && line.reconfigurations.is_empty();
        // A closed line has its first point again as its last.
        let points = if ring { n - 1 } else { n };
        let mut spacing = TURN / self.settings.swivels as f64 / 2.0;
        let fix = TUBE_WIDTH / 2;
        for pass in 0..TUBE_PASSES {
            let offset = |j: usize| spacing * (j as f64 - fix as f64);
            // Joint positions across the tube, unwound along the line; none where a limit is broken.
            let rows: Vec<[Option<([f64; 7], f64)>; TUBE_WIDTH]> = (0..points)
                .into_par_iter()
                .map_init(
                    || Scratch::new(self.arm.chain()),
                    |scratch, k| {
                        std::array::from_fn(|j| {
                            let s = line.swivel[k] + offset(j);
                            let q = self.circles[k].branch_of(s, line.branch[k]);
                            let q = nearest_all(&q, &line.q[k]);
                            if !(0..7).all(|i| q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
                                return None;
                            }
                            let distance = self.distance(k, s, &q, scratch);
                            let place = self.place_cost(&q, distance, scratch)?;
                            Some((q, self.node_cost(k, &q, s, place)))
                        })
                    },
                )
                .collect();
            let cut = if ring && pass % 2 == 1 { points / 2 } else { 0 };
            let order: Vec<usize> =
                if ring { (cut..=cut + points).map(|k| k % points).collect() } else { (0..n).collect() };
            let mut cost = [f64::INFINITY; TUBE_WIDTH];
            let mut came: Vec<[usize; TUBE_WIDTH]> = Vec::with_capacity(order.len());
            for (at, &k) in order.iter().enumerate() {
                let mut next = [f64::INFINITY; TUBE_WIDTH];
                let mut from = [0; TUBE_WIDTH];
                let cheapest = (0..TUBE_WIDTH).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0);
                let fresh = at == 0 || line.reconfigurations.binary_search(&k).is_ok();
                let tied = ring && (at == 0 || at + 1 == order.len());
                for j in 0..TUBE_WIDTH {
                    if tied && j != fix {
                        continue;
                    }
                    let Some((q, place)) = &rows[k][j] else { continue };
                    if fresh {
                        (next[j], from[j]) = (if at == 0 { 0.0 } else { cost[cheapest] }, cheapest);
                    } else {
                        let before = order[at - 1];
                        for i in 0..TUBE_WIDTH {
                            if let Some(step) =
                                rows[before][i].as_ref().and_then(|(p, _)| self.step_cost(before, p, q))
                            {
                                let total = cost[i] + step;
                                if total < next[j] {
                                    (next[j], from[j]) = (total, i);
                                }
                            }
                        }
                    }
                    next[j] += place;
                }
                came.push(from);
                cost = next;
            }
            let mut j = (0..TUBE_WIDTH).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0);
            if !cost[j].is_finite() {
                return line;
            }
            let mut edge = false;
            let kept = if whole && self.obstacles.is_some() { Some(line.clone()) } else { None };
            for (at, &k) in order.iter().enumerate().rev() {
                if let Some((q, _)) = rows[k][j] {
                    line.q[k] = q;
                    // The point at the cut comes twice, both times in the middle of the tube.
                    if !(ring && at + 1 == order.len()) {
                        line.swivel[k] += offset(j);
                    }
                    edge |= j == 0 || j == TUBE_WIDTH - 1;
                }
                j = came[at][j];
            }
            if ring {
                line.swivel[points] = nearest(line.swivel[0], line.swivel[points]);
                line.q[points] = line.q[0];
            }
            if let Some(kept) = kept.filter(|_| !self.touching(&line).is_empty()) {
                (line, edge) = (kept, false);
            }
            // The line wants to leave the tube: follow it before narrowing.
            spacing *= if edge && pass < TUBE_TRAVELS { 1.0 } else { 0.5 };
            if spacing < TUBE_SPACING {
                break;
            }
        }
        line
    }
}
