//! The bounds of a line: which take part, their values, and how they change along a direction.

use super::super::demand::Demand;
use super::super::tool::MOST_BOUNDS;
use super::interior::Goal;
use super::linear::{CHUNK, Linear, dot};
use crate::parallel::prelude::*;

/// Which bounds take part: those that a line comes near to.
#[derive(Debug, Clone)]
pub(super) struct Sets {
    pub bounds: Vec<usize>,
    pub steps: Vec<usize>,
    pub peak: Vec<usize>,
}

/// The bounds that a line comes near to.
pub(super) fn screened(demand: &Demand, q: &[f64], goal: Goal) -> Sets {
    let n = demand.dof();
    let near = |i: usize| {
        let near = NEAR_LIMIT.max(NEAR_RANGE * demand.range[i][1]);
        room(demand, q, i) < near
    };
    let peak = if matches!(goal, Goal::Peak(_)) {
        (0..n).filter(|i| demand.speed_weight[*i] > 0.0).collect()
    } else {
        Vec::new()
    };
    Sets {
        bounds: (0..n).filter(|i| near(*i)).collect(),
        steps: (0..n).filter(|i| load(demand, q, *i, goal) > NEAR_STEP).collect(),
        peak,
    }
}

impl Sets {
    /// Takes in the bounds that a line breaks; false where there are none.
    pub fn widen(&mut self, demand: &Demand, q: &[f64], goal: Goal) -> bool {
        let n = demand.dof();
        let before = self.bounds.len() + self.steps.len();
        for i in 0..n {
            if !self.bounds.contains(&i) && room(demand, q, i) < 0.0 {
                self.bounds.push(i);
            }
            if !self.steps.contains(&i) && load(demand, q, i, goal) > 1.0 {
                self.steps.push(i);
            }
        }
        self.bounds.len() + self.steps.len() > before
    }
}

/// Least distance of a joint from its limits.
fn room(demand: &Demand, q: &[f64], i: usize) -> f64 {
    let column = q.iter().skip(i).step_by(demand.dof());
    column.fold(f64::INFINITY, |room, q| room.min(q - demand.lower[i]).min(demand.upper[i] - q))
}

/// Largest step of a joint, as a share of its bound.
fn load(demand: &Demand, q: &[f64], i: usize, goal: Goal) -> f64 {
    let n = demand.dof();
    (0..demand.steps())
        .map(|k| (q[demand.after(k) * n + i] - q[k * n + i]).abs() / step_bound(demand, goal, k, i))
        .fold(0.0, f64::max)
}

pub(super) fn step_bound(demand: &Demand, goal: Goal, step: usize, i: usize) -> f64 {
    let bound = demand.step_bound[step * demand.dof() + i];
    match (goal, &demand.step_time) {
        (Goal::Capped(cap), Some(times)) if demand.speed_weight[i] > 0.0 => {
            bound.min(cap * times[step] / demand.speed_weight[i])
        }
        _ => bound,
    }
}

impl Linear<'_> {
    /// Values of all bounds; infinite where one does not take part.
    pub(super) fn inequalities(&self, q: &[f64], peak: f64) -> Vec<f64> {
        let (demand, sets) = (self.demand, &self.sets);
        let (n, bounds) = (demand.dof(), demand.tool.bounds());
        let mut h = Vec::with_capacity(self.count());
        for (row, q) in q.chunks_exact(n).enumerate() {
            let given = demand.given(row).is_some();
            for i in &sets.bounds {
                let pair = [q[*i] - demand.lower[*i], demand.upper[*i] - q[*i]];
                h.extend(pair.map(|h| if given { f64::INFINITY } else { h }));
            }
        }
        if bounds > 0 {
            let values: Vec<[f64; MOST_BOUNDS]> = q
                .par_chunks_exact(n)
                .enumerate()
                .with_min_len(CHUNK)
                .map(|(row, q)| {
                    let mut h = [f64::INFINITY; MOST_BOUNDS];
                    if demand.given(row).is_none() {
                        demand.tool.bound_values(
                            &demand.chain.forward_unchecked(q),
                            &demand.targets[row],
                            &mut h,
                        );
                    }
                    h
                })
                .collect();
            h.extend(values.iter().flat_map(|h| &h[..bounds]));
        }
        for step in 0..demand.steps() {
            let (a, b) = (step * n, demand.after(step) * n);
            for i in &sets.steps {
                let (d, bound) = (q[b + i] - q[a + i], step_bound(demand, self.goal, step, *i));
                h.extend([bound - d, bound + d]);
            }
        }
        if let Some(times) = &demand.step_time {
            for step in 0..demand.steps() {
                let (a, b) = (step * n, demand.after(step) * n);
                for i in &sets.peak {
                    let (d, bound) = (q[b + i] - q[a + i], peak * times[step] / demand.speed_weight[*i]);
                    h.extend([bound - d, bound + d]);
                }
            }
        }
        h
    }

    pub(super) fn count(&self) -> usize {
        let (rows, steps) = (self.demand.rows(), self.demand.steps());
        rows * (2 * self.sets.bounds.len() + self.demand.tool.bounds())
            + 2 * steps * (self.sets.steps.len() + self.sets.peak.len())
    }

    /// What is large for each bound.
    pub(super) fn scales(&self) -> Vec<f64> {
        let demand = self.demand;
        let [_, first, _] = self.offsets();
        let mut out = vec![1.0; first];
        for step in 0..demand.steps() {
            for i in &self.sets.steps {
                out.extend([step_bound(demand, self.goal, step, *i); 2]);
            }
        }
        if let Some(times) = &demand.step_time {
            for time in times {
                for i in &self.sets.peak {
                    out.extend([self.peak * time / demand.speed_weight[*i]; 2]);
                }
            }
        }
        out
    }

    /// First entry of the tool's bounds, of the steps and of the peak.
    pub(super) fn offsets(&self) -> [usize; 3] {
        let (rows, steps) = (self.demand.rows(), self.demand.steps());
        let tool = rows * 2 * self.sets.bounds.len();
        let step = tool + rows * self.demand.tool.bounds();
        [tool, step, step + steps * 2 * self.sets.steps.len()]
    }

    /// Change of the bounds along a direction.
    pub(super) fn along(&self, d: &[f64], peak: f64) -> Vec<f64> {
        let (demand, sets) = (self.demand, &self.sets);
        let (n, bounds) = (demand.dof(), demand.tool.bounds());
        let mut out = Vec::with_capacity(self.count());
        for d in d.chunks_exact(n) {
            out.extend(sets.bounds.iter().flat_map(|i| [d[*i], -d[*i]]));
        }
        if bounds > 0 {
            for (row, d) in self.rows.iter().zip(d.chunks_exact(n)) {
                out.extend(row.tool.chunks_exact(n).map(|g| dot(g, d)));
            }
        }
        for step in 0..demand.steps() {
            let (a, b) = (step * n, demand.after(step) * n);
            out.extend(sets.steps.iter().flat_map(|i| {
                let d = d[b + i] - d[a + i];
                [-d, d]
            }));
        }
        if let Some(times) = &demand.step_time {
            for step in 0..demand.steps() {
                let (a, b) = (step * n, demand.after(step) * n);
                out.extend(sets.peak.iter().flat_map(|i| {
                    let (d, c) = (d[b + i] - d[a + i], peak * times[step] / demand.speed_weight[*i]);
                    [c - d, c + d]
                }));
            }
        }
        out
    }
}

/// Largest violation of a bound along a line.
pub(super) fn violation(demand: &Demand, q: &[f64], goal: Goal) -> f64 {
    let (n, bounds) = (demand.dof(), demand.tool.bounds());
    let mut worst: f64 = 0.0;
    for (row, q) in q.chunks_exact(n).enumerate() {
        if demand.given(row).is_some() {
            continue;
        }
        for i in 0..n {
            worst = worst.max(demand.lower[i] - q[i]).max(q[i] - demand.upper[i]);
        }
        if bounds > 0 {
            let mut h = [0.0; MOST_BOUNDS];
            demand.tool.bound_values(&demand.chain.forward_unchecked(q), &demand.targets[row], &mut h);
            worst = h[..bounds].iter().fold(worst, |worst, h| worst.max(-h));
        }
    }
    for step in 0..demand.steps() {
        let (a, b) = (step * n, demand.after(step) * n);
        for i in 0..n {
            worst = worst.max((q[b + i] - q[a + i]).abs() - step_bound(demand, goal, step, i));
        }
    }
    worst
}

/// `- mu sum log s`.
pub(super) fn barrier(s: &[f64], mu: f64) -> f64 {
    // Products of eight slacks at a time: one logarithm for all of them.
    let sum: f64 = (s.chunks(8)).map(|s| s.iter().filter(|s| s.is_finite()).product::<f64>().ln()).sum();
    -mu * sum
}

/// `sum |h - s|`.
pub(super) fn infeasibility(h: &[f64], s: &[f64]) -> f64 {
    h.iter().zip(s).filter(|(_, s)| s.is_finite()).map(|(h, s)| (h - s).abs()).sum()
}

/// Distance from a limit (rad or m, or share of half the range) within which it takes part.
const NEAR_LIMIT: f64 = 0.3;
const NEAR_RANGE: f64 = 0.2;
/// Share of the largest step from which its bound takes part.
const NEAR_STEP: f64 = 0.6;
