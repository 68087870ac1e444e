//! What is linear about one row: gradients, the curvature of cost, bounds and task, and the joint motions that keep the task.

use nalgebra::DMatrix;

use super::super::around::NearDerivatives;
use super::super::demand::Demand;
use super::bounds::{MOST_ROW_BOUNDS, ROOM_SCALE, room_bound};
use super::linear::Linear;
use super::row::{CHUNK, Row};
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;

impl Linear<'_> {
    pub(super) fn linearise_rows(&mut self) {
        let mut rows = std::mem::take(&mut self.rows);
        let this = &*self;
        rows.par_iter_mut()
            .enumerate()
            .with_min_len(CHUNK)
            .for_each_init(|| RowWork::new(this.demand), |work, (k, row)| this.linearise_row(work, k, row));
        self.rows = rows;
    }

    fn linearise_row(&self, work: &mut RowWork, k: usize, row: &mut Row) {
        let (demand, sets) = (self.demand, &self.sets);
        let (n, r, bounds) = (demand.dof(), demand.spare(), demand.bounds());
        let [first_tool, ..] = self.offsets();
        let q = &self.q[k * n..(k + 1) * n];
        row.hessian.fill(0.0);
        row.gradient.fill(0.0);
        if demand.given(k).is_some() {
            row.basis.fill(0.0);
            row.back.fill(0.0);
            row.stationary.fill(0.0);
            return;
        }
        let kinematics = demand.chain.kinematics_unchecked(q, &mut work.scratch);
        let target = &demand.targets[k];
        demand.tool.linearise(&kinematics, target, &mut work.c, &mut work.jacobian);
        row.null.factor(&work.jacobian);
        row.factored = true;
        row.null.shortest(&work.c, &mut row.back);
        row.back.iter_mut().for_each(|d| *d = -*d);
        row.basis.copy_from_slice(&row.null.basis().as_slice()[..n * r]);
        if let Some(around) = &demand.around {
            around.derivatives(&kinematics, demand.time[k], &mut work.near);
        }
        self.row_cost((&mut work.gradient, &mut work.hessian), &work.near, k, q, row);
        row.stationary.copy_from_slice(&row.gradient);
        for (j, i) in sets.bounds.iter().enumerate() {
            let at = 2 * (k * sets.bounds.len() + j);
            let (low, high) = (at, at + 1);
            row.hessian[i * n + i] += self.z[low] / self.s[low] + self.z[high] / self.s[high];
            row.gradient[*i] -= self.y[low] - self.y[high];
            row.stationary[*i] -= self.z[low] - self.z[high];
        }
        if bounds > 0 {
            let of_tool = demand.tool.bounds();
            if of_tool > 0 {
                demand.tool.write_bounds(&kinematics, target, &mut row.tool_values, &mut row.tool);
            }
            if demand.around.is_some() {
                row.tool_values[of_tool] = room_bound(demand, work.near.near.room);
                let gradient = row.tool[of_tool * n..].iter_mut().zip(&work.near.room_gradient);
                gradient.for_each(|(out, g)| *out = g / ROOM_SCALE);
            }
            let at = first_tool + k * bounds;
            let mut weights = [0.0; MOST_ROW_BOUNDS];
            for (b, gradient) in row.tool.chunks_exact(n).enumerate() {
                let (z, y, w) = (self.z[at + b], self.y[at + b], self.z[at + b] / self.s[at + b]);
                weights[b] = -z;
                for i in 0..n {
                    row.gradient[i] -= y * gradient[i];
                    row.stationary[i] -= z * gradient[i];
                    for j in 0..n {
                        row.hessian[i * n + j] += w * gradient[i] * gradient[j];
                    }
                }
            }
            demand.tool.add_bound_curvature(&kinematics, target, &weights[..of_tool], &mut row.hessian);
            if demand.around.is_some() {
                let weight = weights[of_tool] / ROOM_SCALE;
                let curvature = row.hessian.iter_mut().zip(&work.near.room_hessian);
                curvature.for_each(|(out, h)| *out += weight * h);
            }
        }
        for (step, sign) in self.neighbours(k) {
            let step = &self.steps[step];
            for i in 0..n {
                row.gradient[i] += sign * step.gradient[i];
                row.stationary[i] += sign * step.stationary[i];
                row.hessian[i * n + i] += step.stiffness[i];
                if step.rank[i] != 0.0 {
                    for j in 0..n {
                        row.hessian[i * n + j] -= step.rank[i] * step.rank[j];
                    }
                }
            }
        }
        row.null.multipliers(&row.stationary, &mut work.multipliers);
        work.multipliers.iter_mut().for_each(|x| *x = -*x);
        demand.tool.add_curvature(&kinematics, target, &work.multipliers, &mut row.hessian);
    }

    /// Adds gradient and Hessian of a row's cost.
    fn row_cost(
        &self,
        (gradient, hessian): (&mut [f64], &mut DMatrix<f64>),
        near: &NearDerivatives,
        k: usize,
        q: &[f64],
        row: &mut Row,
    ) {
        let demand = self.demand;
        let weight = self.cost_weight * demand.row_share[k];
        if demand.limit_weight > 0.0 {
            demand.limit_term(q, weight * demand.limit_weight, &mut row.gradient, &mut row.hessian);
        }
        if let Some((factor, criterion)) = &demand.criterion
            && *factor != 0.0
        {
            criterion.gradient(q, gradient);
            criterion.hessian(q, hessian);
            let weight = weight * factor;
            row.gradient.iter_mut().zip(&*gradient).for_each(|(out, g)| *out += weight * g);
            row.hessian.iter_mut().zip(hessian.as_slice()).for_each(|(out, h)| *out += weight * h);
        }
        if let Some(around) = demand.around.as_ref().filter(|around| around.weight > 0.0) {
            let weight = weight * around.weight;
            row.gradient.iter_mut().zip(&near.missing_gradient).for_each(|(out, g)| *out += weight * g);
            row.hessian.iter_mut().zip(&near.missing_hessian).for_each(|(out, h)| *out += weight * h);
        }
    }
}

/// Memory of a row's linearisation, one per thread.
struct RowWork {
    scratch: Scratch,
    c: Vec<f64>,
    jacobian: Vec<f64>,
    multipliers: Vec<f64>,
    gradient: Vec<f64>,
    hessian: DMatrix<f64>,
    near: NearDerivatives,
}

impl RowWork {
    fn new(demand: &Demand) -> Self {
        let (n, m) = (demand.dof(), demand.tool.rows());
        Self {
            scratch: Scratch::new(&demand.chain),
            c: vec![0.0; m],
            jacobian: vec![0.0; m * n],
            multipliers: vec![0.0; m],
            gradient: vec![0.0; n],
            hessian: DMatrix::zeros(n, n),
            near: NearDerivatives::new(n),
        }
    }
}
