//! The line, its slacks and multipliers, and what is linear about them at one iterate.

use super::super::demand::Demand;
use super::banded::Banded;
use super::bounds::{LEAST_SLACK, NEAR_SLACK, Sets, barrier, infeasibility, violation};
use super::goal::{Goal, is_length};
use super::row::{LONGEST, Row, dot};

/// What is linear about one step: `diag(stiffness) - rank rank^T`, and the gradient along the step.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub stiffness: Vec<f64>,
    pub rank: Vec<f64>,
    pub gradient: Vec<f64>,
    pub stationary: Vec<f64>,
    /// Coupling to the peak speed.
    pub peak: Vec<f64>,
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
    pub(super) demand: &'a Demand,
    pub(super) goal: Goal,
    pub(super) sets: Sets,
    pub(super) q: Vec<f64>,
    pub(super) peak: f64,
    /// Weights of the peak and of the cost in the objective.
    pub(super) peak_weight: f64,
    pub(super) cost_weight: f64,
    pub(super) h: Vec<f64>,
    pub(super) s: Vec<f64>,
    pub(super) z: Vec<f64>,
    /// `mu/s - (z/s)(h - s)`.
    pub(super) y: Vec<f64>,
    pub(super) rows: Vec<Row>,
    pub(super) steps: Vec<Step>,
    pub(super) objective: f64,
    /// Multiplier of the peak: gradient of the objective along it, for the step and with the present multipliers.
    pub(super) peak_gradient: [f64; 2],
    pub(super) force: f64,
    pub(super) stiffness: f64,
}

impl<'a> Linear<'a> {
    pub fn new(demand: &'a Demand, goal: Goal, sets: Sets, q: Vec<f64>) -> Option<Self> {
        let n = demand.dof();
        let row = Row::new(demand);
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

    /// The steps that a row takes part in, with the sign with which it does.
    pub(super) fn neighbours(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + use<> {
        let steps = self.demand.steps();
        let before = if row > 0 { Some(row - 1) } else { self.demand.cyclic.then(|| steps - 1) };
        let after = (row < steps).then_some(row);
        before.map(|step| (step, 1.0)).into_iter().chain(after.map(|step| (step, -1.0)))
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
    pub fn violation(&self, q: &[f64]) -> (f64, usize) {
        let goal = if matches!(self.goal, Goal::Peak(_)) { Goal::Cost } else { self.goal };
        violation(self.demand, q, goal)
    }
}

/// Square below which a step of the length is smooth: a small part of what a step is on average.
fn smoothing(demand: &Demand, step: usize) -> f64 {
    (LENGTH_SMOOTHING * demand.step_share[step]).powi(2)
}

/// Share of the way to the boundary that a step may go.
const BOUNDARY: f64 = 0.995;
/// Largest factor between a multiplier and the central path.
const SPREAD: f64 = 1e10;
/// Smoothing of a length, rad for the whole path.
const LENGTH_SMOOTHING: f64 = 1e-2;
/// Room of the first peak above the largest speed.
const PEAK_ROOM: f64 = 1.1;
