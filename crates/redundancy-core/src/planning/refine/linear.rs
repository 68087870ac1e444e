//! The line, its slacks and multipliers, and what is linear about them at one iterate.

use nalgebra::DMatrix;

use super::super::demand::Demand;
use super::super::pull::MOST_JOINTS;
use super::super::tool::{MOST_BOUNDS, MOST_ROWS};
use super::banded::Banded;
use super::interior::{Goal, is_length};
use crate::kinematics::{NullSpace, Scratch};
use crate::parallel::prelude::*;

/// Which bounds take part: those that a line comes near to.
#[derive(Debug, Clone)]
pub(super) struct Sets {
    bounds: Vec<usize>,
    steps: Vec<usize>,
    peak: Vec<usize>,
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

fn step_bound(demand: &Demand, goal: Goal, step: usize, i: usize) -> f64 {
    let bound = demand.step_bound[step * demand.dof() + i];
    match (goal, &demand.step_time) {
        (Goal::Capped(cap), Some(times)) if demand.speed_weight[i] > 0.0 => {
            bound.min(cap * times[step] / demand.speed_weight[i])
        }
        _ => bound,
    }
}

/// What is linear about one row.
#[derive(Debug, Clone)]
struct Row {
    /// Orthonormal basis of the joint motions that keep the task, vector by vector.
    basis: Vec<f64>,
    hessian: Vec<f64>,
    /// Gradient for the step, and with the present multipliers.
    gradient: Vec<f64>,
    stationary: Vec<f64>,
    /// Back onto the task.
    back: Vec<f64>,
    /// Gradients of the tool's bounds.
    tool: Vec<f64>,
    /// Their values.
    tool_values: [f64; MOST_BOUNDS],
}

/// What is linear about one step: `diag(stiffness) - rank rank^T`, and the gradient along the step.
#[derive(Debug, Clone)]
struct Step {
    stiffness: Vec<f64>,
    rank: Vec<f64>,
    gradient: Vec<f64>,
    stationary: Vec<f64>,
    /// Coupling to the peak speed.
    peak: Vec<f64>,
}

/// A direction of the line, slacks and multipliers.
pub(super) struct Direction {
    d: Vec<f64>,
    peak: f64,
    ds: Vec<f64>,
    dz: Vec<f64>,
    /// Longest step that keeps the slacks positive, and the multipliers.
    pub longest: f64,
    longest_z: f64,
    /// Slope of objective and barrier along it.
    pub slope: f64,
    /// Largest joint step.
    pub size: f64,
}

/// A point along a direction.
pub(super) struct Trial {
    q: Vec<f64>,
    peak: f64,
    h: Vec<f64>,
    s: Vec<f64>,
    objective: f64,
    /// Objective with barrier.
    pub merit: f64,
    pub infeasibility: f64,
}

/// What is left of the optimality conditions.
pub(super) struct Residual {
    pub slope: f64,
    pub gap: f64,
    pub infeasibility: f64,
}

/// The line and its linearisation.
pub(super) struct Linear<'a> {
    demand: &'a Demand,
    goal: Goal,
    sets: Sets,
    pub q: Vec<f64>,
    peak: f64,
    /// Weights of the peak and of the cost in the objective.
    peak_weight: f64,
    cost_weight: f64,
    h: Vec<f64>,
    s: Vec<f64>,
    z: Vec<f64>,
    /// `mu/s - (z/s)(h - s)`.
    y: Vec<f64>,
    rows: Vec<Row>,
    steps: Vec<Step>,
    objective: f64,
    /// Multiplier of the peak: gradient of the objective along it, for the step and with the present multipliers.
    peak_gradient: [f64; 2],
    force: f64,
    stiffness: f64,
}

impl<'a> Linear<'a> {
    pub fn new(demand: &'a Demand, goal: Goal, sets: Sets, q: Vec<f64>) -> Option<Self> {
        let (n, r) = (demand.dof(), demand.spare());
        let row = Row {
            basis: vec![0.0; n * r],
            hessian: vec![0.0; n * n],
            gradient: vec![0.0; n],
            stationary: vec![0.0; n],
            back: vec![0.0; n],
            tool: vec![0.0; demand.tool.bounds() * n],
            tool_values: [0.0; MOST_BOUNDS],
        };
        let step = Step {
            stiffness: vec![0.0; n],
            rank: vec![0.0; n],
            gradient: vec![0.0; n],
            stationary: vec![0.0; n],
            peak: vec![0.0; n],
        };
        let peak = PEAK_ROOM * demand.peak_speed(&q);
        let cost = demand.cost(&q);
        let peak_weight = match goal {
            Goal::Peak(weight) => weight * cost / peak.max(f64::MIN_POSITIVE),
            _ => 0.0,
        };
        let mut out = Self {
            rows: vec![row; demand.rows()],
            steps: vec![step; demand.steps()],
            demand,
            goal,
            sets,
            peak,
            peak_weight,
            cost_weight: 1.0,
            h: Vec::new(),
            s: Vec::new(),
            z: Vec::new(),
            y: Vec::new(),
            objective: 0.0,
            peak_gradient: [0.0; 2],
            force: 0.0,
            stiffness: 0.0,
            q,
        };
        let (q, costs) = out.retracted(&out.q)?;
        out.q = q;
        out.h = out.inequalities(&out.q, out.peak);
        out.objective = out.objective_of(&out.q, out.peak, costs);
        Some(out)
    }

    /// Puts the slacks inside and the multipliers on the central path.
    pub fn start(&mut self, mu: f64) {
        self.s = (self.h.iter().zip(self.scales()))
            .map(|(h, scale)| {
                if !h.is_finite() {
                    f64::INFINITY
                } else if *h > NEAR_SLACK * scale {
                    *h
                } else {
                    LEAST_SLACK * scale
                }
            })
            .collect();
        self.z = self.s.iter().map(|s| mu / s).collect();
        self.y = self.z.clone();
        #[allow(clippy::print_stderr)]
        if std::env::var_os("TRACE").is_some() {
            let worst = self.h.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
            eprintln!("worst {worst:?} of {:?} sets {:?}", self.offsets(), self.sets);
        }
    }

    /// The objective at the iterate.
    pub fn objective(&self) -> f64 {
        self.objective
    }

    fn objective_of(&self, q: &[f64], peak: f64, row_costs: f64) -> f64 {
        let demand = self.demand;
        let n = demand.dof();
        let motion: f64 = (0..demand.steps())
            .map(|step| {
                let (a, b) = (step * n, demand.after(step) * n);
                let square: f64 =
                    (0..n).map(|i| demand.joint_weight[i] * (q[b + i] - q[a + i]).powi(2)).sum();
                if is_length(demand) {
                    (square + smoothing(demand, step)).sqrt()
                } else {
                    square / demand.step_share[step]
                }
            })
            .sum();
        self.peak_weight * peak + self.cost_weight * (row_costs + demand.motion_weight * motion)
    }

    /// Brings every row back onto the task; its cost without motion.
    fn retracted(&self, from: &[f64]) -> Option<(Vec<f64>, f64)> {
        let demand = self.demand;
        let n = demand.dof();
        let mut q = from.to_vec();
        let costs: Vec<Option<f64>> = q
            .par_chunks_mut(n * CHUNK)
            .enumerate()
            .map_init(
                || Corrector::new(demand),
                |corrector, (chunk, block)| {
                    let mut sum = 0.0;
                    for (k, q) in block.chunks_exact_mut(n).enumerate() {
                        let row = chunk * CHUNK + k;
                        if demand.given(row).is_none() && !corrector.correct(q, row, RETRACTED) {
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
            || Corrector::new(demand),
            |corrector, (chunk, block)| {
                block.chunks_exact_mut(n).enumerate().all(|(k, q)| {
                    let row = chunk * CHUNK + k;
                    demand.given(row).is_some() || corrector.correct(q, row, EXACT)
                })
            },
        );
        good.all(|good| good).then_some(q)
    }

    /// Values of all bounds; infinite where one does not take part.
    fn inequalities(&self, q: &[f64], peak: f64) -> Vec<f64> {
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

    fn count(&self) -> usize {
        let (rows, steps) = (self.demand.rows(), self.demand.steps());
        rows * (2 * self.sets.bounds.len() + self.demand.tool.bounds())
            + 2 * steps * (self.sets.steps.len() + self.sets.peak.len())
    }

    /// What is large for each bound.
    fn scales(&self) -> Vec<f64> {
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
    fn offsets(&self) -> [usize; 3] {
        let (rows, steps) = (self.demand.rows(), self.demand.steps());
        let tool = rows * 2 * self.sets.bounds.len();
        let step = tool + rows * self.demand.tool.bounds();
        [tool, step, step + steps * 2 * self.sets.steps.len()]
    }

    /// The Newton system at the iterate.
    pub fn linearise(&mut self, mu: f64) -> Banded {
        for ((y, h), (s, z)) in self.y.iter_mut().zip(&self.h).zip(self.s.iter().zip(&self.z)) {
            *y = if s.is_finite() { mu / s - z / s * (h - s) } else { 0.0 };
        }
        self.linearise_steps();
        self.linearise_rows();
        self.assemble()
    }

    fn linearise_steps(&mut self) {
        let (demand, sets) = (self.demand, &self.sets);
        let n = demand.dof();
        let [_, first, first_peak] = self.offsets();
        let length = is_length(demand);
        let weight = self.cost_weight * demand.motion_weight;
        let mut peak_gradient = [self.peak_weight; 2];
        let (mut force, mut stiffness): (f64, f64) = (0.0, 0.0);
        for (k, step) in self.steps.iter_mut().enumerate() {
            let (a, b) = (k * n, demand.after(k) * n);
            let share = demand.step_share[k];
            let d = |i: usize| self.q[b + i] - self.q[a + i];
            let norm = if length {
                let square: f64 = (0..n).map(|i| demand.joint_weight[i] * d(i).powi(2)).sum();
                (square + smoothing(demand, k)).sqrt()
            } else {
                0.0
            };
            for i in 0..n {
                let w = demand.joint_weight[i];
                (step.stiffness[i], step.rank[i]) = if length {
                    (weight * w / norm, weight.sqrt() * w * d(i) / norm.powf(1.5))
                } else {
                    (2.0 * weight * w / share, 0.0)
                };
                step.gradient[i] = step.stiffness[i] * d(i);
                step.stationary[i] = step.gradient[i];
                step.peak[i] = 0.0;
                force = force.max(step.gradient[i].abs());
                stiffness += step.stiffness[i];
            }
            for (j, i) in sets.steps.iter().enumerate() {
                let at = first + 2 * (k * sets.steps.len() + j);
                let (up, down) = (self.z[at] / self.s[at], self.z[at + 1] / self.s[at + 1]);
                step.stiffness[*i] += up + down;
                step.gradient[*i] += self.y[at] - self.y[at + 1];
                step.stationary[*i] += self.z[at] - self.z[at + 1];
            }
            let time = demand.step_time.as_ref().map_or(0.0, |times| times[k]);
            for (j, i) in sets.peak.iter().enumerate() {
                let at = first_peak + 2 * (k * sets.peak.len() + j);
                let (up, down) = (self.z[at] / self.s[at], self.z[at + 1] / self.s[at + 1]);
                let c = time / demand.speed_weight[*i];
                step.stiffness[*i] += up + down;
                step.gradient[*i] += self.y[at] - self.y[at + 1];
                step.stationary[*i] += self.z[at] - self.z[at + 1];
                step.peak[*i] = c * (down - up);
                peak_gradient[0] -= c * (self.y[at] + self.y[at + 1]);
                peak_gradient[1] -= c * (self.z[at] + self.z[at + 1]);
            }
        }
        self.force = force.max(f64::MIN_POSITIVE);
        self.stiffness = stiffness / (demand.steps() * n) as f64;
        self.peak_gradient = peak_gradient;
    }

    fn linearise_rows(&mut self) {
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
        let (n, r, bounds) = (demand.dof(), demand.spare(), demand.tool.bounds());
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
        work.null.factor(&work.jacobian);
        work.null.shortest(&work.c, &mut row.back);
        row.back.iter_mut().for_each(|d| *d = -*d);
        row.basis.copy_from_slice(&work.null.basis().as_slice()[..n * r]);
        self.row_cost(&mut work.gradient, &mut work.hessian, k, q, row);
        row.stationary.copy_from_slice(&row.gradient);
        for (j, i) in sets.bounds.iter().enumerate() {
            let at = 2 * (k * sets.bounds.len() + j);
            let (low, high) = (at, at + 1);
            row.hessian[i * n + i] += self.z[low] / self.s[low] + self.z[high] / self.s[high];
            row.gradient[*i] -= self.y[low] - self.y[high];
            row.stationary[*i] -= self.z[low] - self.z[high];
        }
        if bounds > 0 {
            demand.tool.write_bounds(&kinematics, target, &mut row.tool_values, &mut row.tool);
            let at = first_tool + k * bounds;
            let mut weights = [0.0; MOST_BOUNDS];
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
            demand.tool.add_bound_curvature(&kinematics, target, &weights[..bounds], &mut row.hessian);
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
        work.null.multipliers(&row.stationary, &mut work.multipliers);
        work.multipliers.iter_mut().for_each(|x| *x = -*x);
        demand.tool.add_curvature(&kinematics, target, &work.multipliers, &mut row.hessian);
    }

    /// Adds gradient and Hessian of a row's cost.
    fn row_cost(&self, gradient: &mut [f64], hessian: &mut DMatrix<f64>, k: usize, q: &[f64], row: &mut Row) {
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
    }

    /// The steps that a row takes part in, with the sign with which it does.
    fn neighbours(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + use<> {
        let steps = self.demand.steps();
        let before = if row > 0 { Some(row - 1) } else { self.demand.cyclic.then(|| steps - 1) };
        let after = (row < steps).then_some(row);
        before.map(|step| (step, 1.0)).into_iter().chain(after.map(|step| (step, -1.0)))
    }

    /// Reduced blocks; the last row of a closed path and the peak speed are the border.
    fn assemble(&self) -> Banded {
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

    /// Minus the reduced gradient; the border's behind.
    pub fn right_hand_side(&self) -> Vec<f64> {
        let (n, r) = (self.demand.dof(), self.demand.spare());
        let mut out = Vec::with_capacity(self.rows.len() * r + 1);
        for row in &self.rows {
            out.extend((0..r).map(|c| -dot(&row.basis[c * n..(c + 1) * n], &row.gradient)));
        }
        if matches!(self.goal, Goal::Peak(_)) {
            out.push(-self.peak_gradient[0]);
        }
        out
    }

    /// What is left of the optimality conditions.
    pub fn residual(&self, mu: f64) -> Residual {
        let (n, r) = (self.demand.dof(), self.demand.spare());
        let mut slope: f64 = 0.0;
        for row in &self.rows {
            for c in 0..r {
                slope = slope.max(dot(&row.basis[c * n..(c + 1) * n], &row.stationary).abs());
            }
        }
        if matches!(self.goal, Goal::Peak(_)) {
            slope = slope.max(self.peak_gradient[1].abs());
        }
        let (mut gap, mut infeasibility): (f64, f64) = (0.0, 0.0);
        for ((h, s), z) in self.h.iter().zip(&self.s).zip(&self.z) {
            if s.is_finite() {
                gap = gap.max((s * z - mu).abs());
                infeasibility = infeasibility.max((h - s).abs());
            }
        }
        Residual { slope, gap, infeasibility }
    }

    /// Largest force of the motion along a joint.
    pub fn force(&self) -> f64 {
        self.z.iter().fold(self.force.max(self.peak_weight), |force, z| force.max(*z))
    }

    /// Mean stiffness of the motion.
    pub fn stiffness(&self) -> f64 {
        self.stiffness.max(f64::MIN_POSITIVE)
    }

    /// The direction of a solution of the system.
    pub fn direction(&self, x: &[f64], mu: f64) -> Direction {
        let demand = self.demand;
        let (n, r) = (demand.dof(), demand.spare());
        let rows = demand.rows();
        let mut d = vec![0.0; rows * n];
        let mut size: f64 = 0.0;
        let mut slope = 0.0;
        for ((k, d), x) in d.chunks_exact_mut(n).enumerate().zip(x.chunks_exact(r.max(1))) {
            let row = &self.rows[k];
            d.copy_from_slice(&row.back);
            for (c, x) in x.iter().enumerate().take(r) {
                for i in 0..n {
                    d[i] += x * row.basis[c * n + i];
                }
                slope += x * dot(&row.basis[c * n..(c + 1) * n], &row.gradient);
            }
            size = d.iter().fold(size, |size, d| size.max(d.abs()));
        }
        let peak = if matches!(self.goal, Goal::Peak(_)) { x[rows * r] } else { 0.0 };
        slope += peak * self.peak_gradient[0];
        let dh = self.along(&d, peak);
        let (mut longest, mut longest_z) = ((LONGEST / size).min(1.0), 1.0f64);
        let (mut ds, mut dz) = (vec![0.0; dh.len()], vec![0.0; dh.len()]);
        for j in 0..dh.len() {
            let (h, s, z) = (self.h[j], self.s[j], self.z[j]);
            if !s.is_finite() {
                continue;
            }
            ds[j] = dh[j] + h - s;
            dz[j] = self.y[j] - z - z / s * dh[j];
            if ds[j] < 0.0 {
                longest = longest.min(-BOUNDARY * s / ds[j]);
            }
            if dz[j] < 0.0 {
                longest_z = longest_z.min(-BOUNDARY * z / dz[j]);
            }
        }
        // Slope of the merit's smooth part: df - sum mu/s ds, while the system's gradient has y for it.
        let mut smooth = slope;
        for j in 0..dh.len() {
            if self.s[j].is_finite() {
                smooth += self.y[j] * dh[j] - mu / self.s[j] * ds[j];
            }
        }
        Direction { d, peak, ds, dz, longest, longest_z, slope: smooth, size }
    }

    /// Change of the bounds along a direction.
    fn along(&self, d: &[f64], peak: f64) -> Vec<f64> {
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

    /// Objective with barrier, and infeasibility, at the iterate.
    pub fn merit(&self, mu: f64) -> [f64; 2] {
        [self.objective + barrier(&self.s, mu), infeasibility(&self.h, &self.s)]
    }

    /// A point along the direction, back on the task; `None` where a row is lost.
    pub fn trial(&self, direction: &Direction, alpha: f64, mu: f64) -> Option<Trial> {
        let q: Vec<f64> = self.q.iter().zip(&direction.d).map(|(q, d)| q + alpha * d).collect();
        let (q, costs) = self.retracted(&q)?;
        let peak = self.peak + alpha * direction.peak;
        let h = self.inequalities(&q, peak);
        // A slack below its bound is raised to it: that lowers barrier and infeasibility.
        let s: Vec<f64> = (self.s.iter().zip(&direction.ds).zip(&h))
            .map(|((s, ds), h)| if s.is_finite() { (s + alpha * ds).max(*h) } else { *s })
            .collect();
        let objective = self.objective_of(&q, peak, costs);
        let (merit, infeasibility) = (objective + barrier(&s, mu), infeasibility(&h, &s));
        (merit.is_finite() && infeasibility.is_finite()).then_some(Trial {
            q,
            peak,
            h,
            s,
            objective,
            merit,
            infeasibility,
        })
    }

    /// Takes a trial.
    pub fn accept(&mut self, trial: Trial, direction: &Direction, alpha: f64, mu: f64) {
        let step = direction.longest_z * (alpha / direction.longest.max(f64::MIN_POSITIVE)).min(1.0);
        for ((z, dz), s) in self.z.iter_mut().zip(&direction.dz).zip(&trial.s) {
            if s.is_finite() {
                *z = (*z + step * dz).clamp(mu / (SPREAD * s), SPREAD * mu / s);
            }
        }
        (self.q, self.peak, self.h, self.s) = (trial.q, trial.peak, trial.h, trial.s);
        self.objective = trial.objective;
    }

    /// Largest violation of a bound of the demand, rad or m (cone and spin in their own scale).
    pub fn violation(&self, q: &[f64]) -> f64 {
        let goal = if matches!(self.goal, Goal::Peak(_)) { Goal::Cost } else { self.goal };
        violation(self.demand, q, goal)
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
fn barrier(s: &[f64], mu: f64) -> f64 {
    // Products of eight slacks at a time: one logarithm for all of them.
    let sum: f64 = (s.chunks(8)).map(|s| s.iter().filter(|s| s.is_finite()).product::<f64>().ln()).sum();
    -mu * sum
}

/// `sum |h - s|`.
fn infeasibility(h: &[f64], s: &[f64]) -> f64 {
    h.iter().zip(s).filter(|(_, s)| s.is_finite()).map(|(h, s)| (h - s).abs()).sum()
}

/// `Z^T H Z` of a row.
fn reduce(row: &Row, n: usize, r: usize, given: bool, stiffness: f64, block: &mut [f64]) {
    if given {
        block.fill(0.0);
        (0..r).for_each(|i| block[i * r + i] = stiffness);
        return;
    }
    let mut product = [0.0; MOST_JOINTS];
    for j in 0..r {
        let basis = &row.basis[j * n..(j + 1) * n];
        for (p, h) in product.iter_mut().zip(row.hessian.chunks_exact(n)) {
            *p = dot(h, basis);
        }
        for i in j..r {
            let value = dot(&row.basis[i * n..(i + 1) * n], &product[..n]);
            block[i * r + j] = value;
            block[j * r + i] = value;
        }
    }
}

/// Newton's method back onto the task of a row.
struct Corrector<'a> {
    demand: &'a Demand,
    scratch: Scratch,
    null: NullSpace,
    c: [f64; MOST_ROWS],
    jacobian: Vec<f64>,
    step: Vec<f64>,
}

impl<'a> Corrector<'a> {
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

/// Memory of a row's linearisation, one per thread.
struct RowWork {
    scratch: Scratch,
    null: NullSpace,
    c: Vec<f64>,
    jacobian: Vec<f64>,
    multipliers: Vec<f64>,
    gradient: Vec<f64>,
    hessian: DMatrix<f64>,
}

impl RowWork {
    fn new(demand: &Demand) -> Self {
        let (n, m) = (demand.dof(), demand.tool.rows());
        Self {
            scratch: Scratch::new(&demand.chain),
            null: NullSpace::new(m, n),
            c: vec![0.0; m],
            jacobian: vec![0.0; m * n],
            multipliers: vec![0.0; m],
            gradient: vec![0.0; n],
            hessian: DMatrix::zeros(n, n),
        }
    }
}

/// Square below which a step of the length is smooth: a small part of what a step is on average.
fn smoothing(demand: &Demand, step: usize) -> f64 {
    (LENGTH_SMOOTHING * demand.step_share[step]).powi(2)
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Distance from a limit (rad or m, or share of half the range) within which it takes part.
const NEAR_LIMIT: f64 = 0.3;
const NEAR_RANGE: f64 = 0.2;
/// Share of the largest step from which its bound takes part.
const NEAR_STEP: f64 = 0.6;
/// Rows of one task of the pool.
const CHUNK: usize = 32;
/// Least slack of a start: rad or m, for cone and spin in their own scale, for steps as a share of the largest.
const LEAST_SLACK: f64 = 1e-2;
/// Share of the scale up to which a bound counts as met: then its slack starts further inside.
const NEAR_SLACK: f64 = 1e-3;
/// Miss of the equations (m, rad) that is left to the next iteration, and in the end.
const RETRACTED: f64 = 1e-12;
const EXACT: f64 = 1e-14;
/// Miss that rounding explains where it falls no more.
const ROUNDING_MISS: f64 = 1e-12;
/// Miss at which a row counts as lost, m or rad.
const FAR_MISS: f64 = 2.0;
/// Largest joint step of an iteration, rad or m.
const LONGEST: f64 = 0.4;
/// Share of the way to the boundary that a step may go.
const BOUNDARY: f64 = 0.995;
/// Largest factor between a multiplier and the central path.
const SPREAD: f64 = 1e10;
/// Smoothing of a length, rad for the whole path.
const LENGTH_SMOOTHING: f64 = 1e-2;
/// Room of the first peak above the largest speed.
const PEAK_ROOM: f64 = 1.1;
