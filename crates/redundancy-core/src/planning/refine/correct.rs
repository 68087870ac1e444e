//! Back onto the task, row by row.

use super::super::demand::Demand;
use super::super::tool::MOST_ROWS;
use super::linear::Linear;
use super::row::{CHUNK, LONGEST};
use crate::kinematics::{NullSpace, Scratch};
use crate::parallel::prelude::*;

impl Linear<'_> {
    /// Brings every row back onto the task; its cost without motion.
    pub(super) fn retracted(&self, from: &[f64]) -> Option<(Vec<f64>, f64)> {
        let demand = self.demand;
        let n = demand.dof();
        let mut q = from.to_vec();
        let costs: Vec<Option<f64>> = q
            .par_chunks_mut(n * CHUNK)
            .enumerate()
            .map_init(
                || RowCorrector::new(demand),
                |corrector, (chunk, block)| {
                    let mut sum = 0.0;
                    for (k, q) in block.chunks_exact_mut(n).enumerate() {
                        let row = chunk * CHUNK + k;
                        let good = demand.given(row).is_some()
                            || (self.rows[row].factored && corrector.chord(&self.rows[row].null, q, row))
                            || corrector.correct(q, row, RETRACTED);
                        if !good {
                            return None;
                        }
                        sum += demand.row_cost(row, q);
                    }
                    Some(sum)
                },
            )
            .collect();
        costs.into_iter().sum::<Option<f64>>().map(|sum| (q, sum))
    }

    /// The line with every row on the task to the last digit.
    pub fn exact(&self) -> Option<Vec<f64>> {
        let demand = self.demand;
        let n = demand.dof();
        let mut q = self.q.clone();
        let good = q.par_chunks_mut(n * CHUNK).enumerate().map_init(
            || RowCorrector::new(demand),
            |corrector, (chunk, block)| {
                block.chunks_exact_mut(n).enumerate().all(|(k, q)| {
                    let row = chunk * CHUNK + k;
                    demand.given(row).is_some() || corrector.correct(q, row, EXACT)
                })
            },
        );
        good.all(|good| good).then_some(q)
    }
}

/// Newton's method back onto the task of a row.
struct RowCorrector<'a> {
    demand: &'a Demand,
    scratch: Scratch,
    null: NullSpace,
    c: [f64; MOST_ROWS],
    jacobian: Vec<f64>,
    step: Vec<f64>,
}

impl<'a> RowCorrector<'a> {
    fn new(demand: &'a Demand) -> Self {
        let (n, m) = (demand.dof(), demand.tool.rows());
        Self {
            demand,
            scratch: Scratch::new(&demand.chain),
            null: NullSpace::new(m, n),
            c: [0.0; MOST_ROWS],
            jacobian: vec![0.0; m * n],
            step: vec![0.0; n],
        }
    }

    /// With the factors of a point nearby: linear convergence at the rate of the distance, but without Jacobians.
    fn chord(&mut self, factors: &NullSpace, q: &mut [f64], row: usize) -> bool {
        const STEPS: usize = 5;
        let c = &mut self.c[..self.demand.tool.rows()];
        let mut last = NEAR_MISS;
        for _ in 0..STEPS {
            let pose = self.demand.chain.forward_unchecked(q);
            self.demand.tool.write_values(&pose, &self.demand.targets[row], c);
            let miss = c.iter().fold(0.0, |miss: f64, c| miss.max(c.abs()));
            if miss <= RETRACTED || (miss < ROUNDING_MISS && miss >= 0.5 * last) {
                return true;
            }
            if miss.is_nan() || miss > CHORD_FALL * last {
                return false;
            }
            last = miss;
            factors.shortest(c, &mut self.step);
            for (q, d) in q.iter_mut().zip(&self.step) {
                *q -= d;
            }
        }
        false
    }

    fn correct(&mut self, q: &mut [f64], row: usize, tolerance: f64) -> bool {
        const STEPS: usize = 10;
        let m = self.demand.tool.rows();
        let mut last = f64::INFINITY;
        for _ in 0..STEPS {
            let kinematics = self.demand.chain.kinematics_unchecked(q, &mut self.scratch);
            let c = &mut self.c[..m];
            self.demand.tool.linearise(&kinematics, &self.demand.targets[row], c, &mut self.jacobian);
            let miss = c.iter().fold(0.0, |miss: f64, c| miss.max(c.abs()));
            // Rounding: where it falls no more, it is as small as it gets.
            if miss <= tolerance || (miss < ROUNDING_MISS && miss >= 0.5 * last) {
                return true;
            }
            if miss.is_nan() || miss > FAR_MISS {
                return false;
            }
            last = miss;
            self.null.factor(&self.jacobian);
            self.null.shortest(c, &mut self.step);
            for (q, d) in q.iter_mut().zip(&self.step) {
                *q -= d.clamp(-LONGEST, LONGEST);
            }
        }
        false
    }
}

/// Miss of the equations (m, rad) that is left to the next iteration, and in the end.
const RETRACTED: f64 = 1e-12;
const EXACT: f64 = 1e-14;
/// Miss up to which the factors of the iterate are used, and by how much it has to fall in a step.
const NEAR_MISS: f64 = 1e-2;
const CHORD_FALL: f64 = 0.3;
/// Miss that rounding explains where it falls no more.
const ROUNDING_MISS: f64 = 1e-12;
/// Miss at which a row counts as lost, m or rad.
const FAR_MISS: f64 = 2.0;
