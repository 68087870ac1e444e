//! The reduced system of a line.

use super::banded::Banded;
use super::goal::Goal;
use super::linear::Linear;
use super::row::{CHUNK, dot, reduce};
use crate::parallel::prelude::*;

impl Linear<'_> {
    /// Reduced blocks; the last row of a closed path and the peak speed are the border.
    pub(super) fn assemble(&self) -> Banded {
        let demand = self.demand;
        let (n, r) = (demand.dof(), demand.spare());
        let (with_peak, cyclic) = (usize::from(matches!(self.goal, Goal::Peak(_))), demand.cyclic);
        let inner = if cyclic { demand.rows() - 1 } else { demand.rows() };
        let edge = if cyclic { r } else { 0 };
        let b = edge + with_peak;
        let mut out = Banded::new(inner, r, b);
        let given = |k: usize| demand.given(k).is_some();
        out.diagonal.par_chunks_exact_mut((r * r).max(1)).enumerate().with_min_len(CHUNK).for_each(
            |(k, block)| {
                reduce(&self.rows[k], n, r, given(k), self.stiffness, block);
            },
        );
        out.below.par_chunks_exact_mut((r * r).max(1)).enumerate().with_min_len(CHUNK).for_each(
            |(k, block)| {
                self.couple(k, k, k + 1, block, r);
            },
        );
        if cyclic {
            let last = inner;
            let mut block = vec![0.0; r * r];
            reduce(&self.rows[last], n, r, given(last), self.stiffness, &mut block);
            for i in 0..r {
                for j in 0..r {
                    out.corner[i * b + j] = block[i * r + j];
                }
            }
            for (step, row) in [(last - 1, last - 1), (last, 0)] {
                // Rows of the block belong to the last row of the path.
                self.couple(step, row, last, &mut block, r);
                for i in 0..r {
                    for j in 0..r {
                        out.border[(row * r + j) * b + i] += block[i * r + j];
                    }
                }
            }
        }
        if with_peak == 1 {
            self.assemble_peak(&mut out, edge);
        }
        out
    }

    /// Block of a step between two rows: rows of the block belong to `to`.
    fn couple(&self, step: usize, from: usize, to: usize, block: &mut [f64], r: usize) {
        let n = self.demand.dof();
        let (a, b, step) = (&self.rows[from].basis, &self.rows[to].basis, &self.steps[step]);
        for i in 0..r {
            let left = &b[i * n..(i + 1) * n];
            for j in 0..r {
                let right = &a[j * n..(j + 1) * n];
                let mut sum = 0.0;
                for m in 0..n {
                    sum -= left[m] * step.stiffness[m] * right[m];
                }
                let (x, y) = (dot(left, &step.rank), dot(right, &step.rank));
                block[i * r + j] = sum + x * y;
            }
        }
    }

    fn assemble_peak(&self, out: &mut Banded, at: usize) {
        let demand = self.demand;
        let (n, r, b) = (demand.dof(), demand.spare(), out.b);
        let [_, _, first] = self.offsets();
        let Some(times) = &demand.step_time else { return };
        let mut corner = 0.0;
        for step in 0..demand.steps() {
            for (j, i) in self.sets.peak.iter().enumerate() {
                let entry = first + 2 * (step * self.sets.peak.len() + j);
                let c = times[step] / demand.speed_weight[*i];
                corner += c * c * (self.z[entry] / self.s[entry] + self.z[entry + 1] / self.s[entry + 1]);
            }
        }
        out.corner[at * b + at] = corner;
        for k in 0..demand.rows() {
            for c in 0..r {
                let basis = &self.rows[k].basis[c * n..(c + 1) * n];
                let value: f64 =
                    self.neighbours(k).map(|(step, sign)| sign * dot(basis, &self.steps[step].peak)).sum();
                if k < out.rows {
                    out.border[(k * r + c) * b + at] += value;
                } else {
                    out.corner[at * b + c] += value;
                    out.corner[c * b + at] += value;
                }
            }
        }
    }
}
