//! Values of the bounds of a line, and how they change along a direction.

use super::bounds::{MOST_ROW_BOUNDS, row_bounds, step_bound};
use super::linear::Linear;
use super::row::{CHUNK, dot};
use crate::parallel::prelude::*;

impl Linear<'_> {
    /// Values of all bounds; infinite where one does not take part.
    pub(super) fn inequalities(&self, q: &[f64], peak: f64) -> Vec<f64> {
        let (demand, sets) = (self.demand, &self.sets);
        let (n, bounds) = (demand.dof(), demand.bounds());
        let mut h = Vec::with_capacity(self.count());
        for (row, q) in q.chunks_exact(n).enumerate() {
            let given = demand.given(row).is_some();
            for i in &sets.bounds {
                let pair = [q[*i] - demand.lower[*i], demand.upper[*i] - q[*i]];
                h.extend(pair.map(|h| if given { f64::INFINITY } else { h }));
            }
        }
        if bounds > 0 {
            let values: Vec<[f64; MOST_ROW_BOUNDS]> = q
                .par_chunks_exact(n)
                .enumerate()
                .with_min_len(CHUNK)
                .map(|(row, q)| {
                    if demand.given(row).is_some() {
                        [f64::INFINITY; MOST_ROW_BOUNDS]
                    } else {
                        row_bounds(demand, row, q)
                    }
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
        rows * (2 * self.sets.bounds.len() + self.demand.bounds())
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
        let step = tool + rows * self.demand.bounds();
        [tool, step, step + steps * 2 * self.sets.steps.len()]
    }

    /// Change of the bounds along a direction.
    pub(super) fn along(&self, d: &[f64], peak: f64) -> Vec<f64> {
        let (demand, sets) = (self.demand, &self.sets);
        let (n, bounds) = (demand.dof(), demand.bounds());
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
