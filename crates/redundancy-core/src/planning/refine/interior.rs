//! The iteration: linearise, solve, search along the line, lower the barrier.

use super::super::demand::Demand;
use super::banded::Banded;
use super::bounds::{Sets, screened};
use super::goal::Goal;
use super::linear::{Linear, Residual};
use crate::watch::Watch;

/// How far a refinement goes.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Refinement<'a> {
    pub goal: Goal,
    /// First barrier, as a share of the cost of a row.
    pub barrier: f64,
    /// Last barrier, as a share of the cost of a row.
    pub last_barrier: f64,
    /// Slope, relative to the force of the motion, at which it is done.
    pub slope: f64,
    /// Most iterations.
    pub iterations: usize,
    /// What may interrupt it.
    pub watch: Option<&'a Watch>,
}

impl Refinement<'_> {
    /// On some of the rows, to compare lines.
    pub const COARSE: Self = Self {
        goal: Goal::Cost,
        barrier: 1e-1,
        last_barrier: 1e-5,
        slope: 1e-4,
        iterations: 60,
        watch: None,
    };
    /// To a local optimum.
    pub const FINE: Self = Self {
        goal: Goal::Cost,
        barrier: 1e-3,
        last_barrier: 1e-7,
        slope: 1e-7,
        iterations: 100,
        watch: None,
    };
}

/// A refined line.
#[derive(Debug, Clone)]
pub(in super::super) struct Refined {
    pub q: Vec<f64>,
    /// The cost, without the peak speed.
    pub cost: f64,
    /// Slope that is left, relative to the force of the motion.
    pub slope: f64,
    /// Largest violation of a bound.
    pub violation: f64,
    /// The row at which it is.
    pub worst_row: usize,
    pub iterations: usize,
    /// True where slope and barrier are as small as asked for.
    pub converged: bool,
}

impl Refined {
    /// Whether no bound is broken by more than rounding explains.
    pub fn is_legal(&self) -> bool {
        self.violation <= LEGAL
    }
}

/// Refines a line that meets the equations; `None` where a row is lost.
pub(in super::super) fn refine(demand: &Demand, q: Vec<f64>, how: &Refinement<'_>) -> Option<Refined> {
    let mut sets = screened(demand, &q, how.goal);
    if demand.spare() == 0 {
        return pinned(demand, q, how, sets);
    }
    let mut start = q;
    let mut iterations = 0;
    for _ in 0..SCREENINGS {
        let out = Interior::new(demand, start, how, sets.clone())?.run(iterations)?;
        // A bound that was left out and is met now comes in.
        if !sets.widen(demand, &out.q, how.goal) || out.iterations >= how.iterations {
            return Some(out);
        }
        iterations = out.iterations;
        start = out.q;
    }
    None
}

/// A line without freedom: its rows to the last digit.
fn pinned(demand: &Demand, q: Vec<f64>, how: &Refinement<'_>, sets: Sets) -> Option<Refined> {
    let linear = Linear::new(demand, how.goal, sets, q)?;
    let q = linear.exact()?;
    let (cost, (violation, worst_row)) = (demand.cost(&q), linear.violation(&q));
    Some(Refined { q, cost, slope: 0.0, violation, worst_row, iterations: 0, converged: true })
}

struct Interior<'a> {
    demand: &'a Demand,
    how: &'a Refinement<'a>,
    linear: Linear<'a>,
    /// Barrier per unit of the cost of a row.
    unit: f64,
    mu: f64,
    /// Pairs of merit and infeasibility that later points have to beat in one of them.
    filter: Vec<[f64; 2]>,
    /// Infeasibility at the start.
    first_infeasibility: f64,
    /// Last damping that was needed.
    shift: f64,
}

impl<'a> Interior<'a> {
    fn new(demand: &'a Demand, q: Vec<f64>, how: &'a Refinement<'a>, sets: Sets) -> Option<Self> {
        let mut linear = Linear::new(demand, how.goal, sets, q)?;
        let cost = linear.objective();
        let unit = cost.abs().max(f64::MIN_POSITIVE) / demand.rows() as f64;
        let mu = (how.barrier * unit).max(how.last_barrier * unit);
        linear.start(mu);
        let first_infeasibility = linear.merit(mu)[1];
        Some(Self { demand, how, linear, unit, mu, filter: Vec::new(), first_infeasibility, shift: 0.0 })
    }

    fn run(mut self, before: usize) -> Option<Refined> {
        let last = self.how.last_barrier * self.unit;
        let mut iterations = before;
        let mut converged = false;
        let mut stalled = 0;
        while iterations < self.how.iterations {
            if self.how.watch.is_some_and(|watch| watch.interrupted().is_some()) {
                break;
            }
            let mut system = self.linear.linearise(self.mu);
            let residual = self.linear.residual(self.mu);
            let force = self.linear.force();
            converged = self.is_done(&residual, last);
            if converged {
                break;
            }
            let loose = residual.slope <= LOOSE * force && residual.gap <= LOOSE_GAP * self.mu;
            if self.mu > last && loose {
                self.lower(last);
                system = self.linear.linearise(self.mu);
            }
            iterations += 1;
            let (system, damped) = self.factored(system)?;
            let (improved, size) = self.step(&system)?;
            // Where Newton's step is lost in rounding so is what is left of the slope.
            if self.mu <= last && !damped && size <= STANDSTILL {
                let residual = self.linear.residual(self.mu);
                converged = residual.slope <= SLOPE_ROUNDING * force && self.is_feasible(&residual);
                if converged {
                    break;
                }
            }
            stalled = if improved { 0 } else { stalled + 1 };
            if stalled >= STALLS {
                if self.mu <= last {
                    break;
                }
                self.lower(last);
            }
        }
        if !converged {
            self.linear.linearise(self.mu);
            converged = self.is_done(&self.linear.residual(self.mu), last);
        }
        let (slope, force) = (self.linear.residual(self.mu).slope, self.linear.force());
        let q = self.linear.exact()?;
        let (violation, worst_row) = self.linear.violation(&q);
        Some(Refined {
            cost: self.demand.cost(&q),
            q,
            slope: slope / force,
            violation,
            worst_row,
            iterations,
            converged,
        })
    }

    /// Whether the conditions of an optimum hold closely enough, with the last barrier.
    fn is_done(&self, residual: &Residual, last: f64) -> bool {
        self.mu <= last
            && residual.slope <= self.how.slope * self.linear.force()
            && self.is_feasible(residual)
    }

    fn is_feasible(&self, residual: &Residual) -> bool {
        residual.infeasibility <= INFEASIBILITY && residual.gap <= GAP * self.mu
    }

    /// The factored system, with as much damping as makes it positive definite, and whether there is any.
    fn factored(&mut self, system: Banded) -> Option<(Banded, bool)> {
        let stiffness = self.linear.stiffness();
        let (least, flat) = (LEAST_SHIFT * stiffness, FLAT * stiffness);
        let mut shift = 0.0;
        for _ in 0..SHIFTS {
            let mut factors = system.clone();
            if factors.factor(shift, flat) {
                if shift > 0.0 {
                    self.shift = shift;
                }
                return Some((factors, shift > 0.0));
            }
            shift = if shift == 0.0 { (self.shift / SHIFT_FALL).max(least) } else { shift * SHIFT_RISE };
        }
        None
    }

    fn lowered(&self, last: f64) -> f64 {
        let relative = self.mu / self.unit;
        (self.unit * (FALL * relative).min(relative.powf(SUPERLINEAR))).max(last)
    }

    /// One step: whether something was gained, and its size, rad or m.
    fn step(&mut self, system: &Banded) -> Option<(bool, f64)> {
        let mut x = self.linear.right_hand_side();
        system.solve(&mut x);
        if x.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let direction = self.linear.direction(&x, self.mu);
        let [merit, infeasibility] = self.linear.merit(self.mu);
        let scale = self.first_infeasibility.max(1.0);
        let noise = ROUNDING * merit.abs().max(self.unit);
        let mut alpha = direction.longest;
        for _ in 0..HALVINGS {
            if let Some(trial) = self.linear.trial(&direction, alpha, self.mu) {
                let fall = -alpha * direction.slope;
                // Where bounds hold well enough, the objective decides.
                let descent = fall > 0.0
                    && infeasibility <= SMALL_INFEASIBILITY * scale
                    && alpha * (-direction.slope / self.unit).powf(FALL_POWER)
                        > (infeasibility / scale).powf(INFEASIBILITY_POWER);
                let better = |[m, t]: [f64; 2]| {
                    trial.infeasibility <= (1.0 - FILTER_SHARE) * t
                        || trial.merit <= m - FILTER_SHARE * t + noise
                };
                let good = if descent {
                    trial.merit <= merit - ARMIJO * fall + noise
                } else {
                    better([merit, infeasibility])
                };
                let large = trial.infeasibility > LARGE_INFEASIBILITY * scale;
                // What rounding leaves of a step goes through for the sake of the multipliers.
                let tiny = direction.size <= STANDSTILL && trial.infeasibility <= INFEASIBILITY * scale;
                if tiny || (good && !large && self.filter.iter().all(|entry| better(*entry))) {
                    if !descent && !tiny {
                        self.filter.push([
                            merit - FILTER_SHARE * infeasibility,
                            (1.0 - FILTER_SHARE) * infeasibility,
                        ]);
                    }
                    let gained = trial.merit < merit - noise
                        || trial.infeasibility < 0.9 * infeasibility
                        || alpha * direction.size > STANDSTILL;
                    self.linear.accept(trial, &direction, alpha, self.mu);
                    return Some((gained, direction.size));
                }
            }
            alpha *= 0.5;
        }
        Some((false, direction.size))
    }

    fn lower(&mut self, last: f64) {
        self.mu = self.lowered(last);
        self.filter.clear();
    }
}

/// Violation (rad or m) that rounding explains.
pub(in super::super) const LEGAL: f64 = 1e-9;
/// Least damping as a share of the stiffness of the motion, how it rises and falls, and how often.
const LEAST_SHIFT: f64 = 1e-5;
const SHIFT_RISE: f64 = 8.0;
const SHIFT_FALL: f64 = 4.0;
const SHIFTS: usize = 16;
/// Pivot of a direction that costs nothing, as a share of the stiffness.
const FLAT: f64 = 1e-6;
/// Slope, relative to the force of the motion, that rounding may leave.
const SLOPE_ROUNDING: f64 = 1e-3;
/// Times that left-out bounds are brought in.
const SCREENINGS: usize = 4;
/// Share of the violation (rad, scaled) of the slacks that may be left.
const INFEASIBILITY: f64 = 1e-9;
/// Complementarity that is left at the end, relative to the barrier.
const GAP: f64 = 1.0;
/// Slope and complementarity at which the barrier is lowered.
const LOOSE: f64 = 1e-2;
const LOOSE_GAP: f64 = 10.0;
/// Factor and power by which the barrier is lowered.
const FALL: f64 = 0.15;
const SUPERLINEAR: f64 = 1.5;
/// Most halvings of a step.
const HALVINGS: usize = 25;
/// Steps without a gain after which it ends.
const STALLS: usize = 3;
const ARMIJO: f64 = 1e-4;
/// Share of the infeasibility by which a point must be better than those of the filter.
const FILTER_SHARE: f64 = 1e-5;
/// Infeasibility, relative to that of the start, below which the objective may decide, and above which a point is refused.
const SMALL_INFEASIBILITY: f64 = 1e-2;
const LARGE_INFEASIBILITY: f64 = 1e2;
/// Powers of fall and infeasibility in that decision [WaechterBiegler2006, eq. (19)].
const FALL_POWER: f64 = 2.3;
const INFEASIBILITY_POWER: f64 = 1.1;
/// Rounding of the merit, relative.
const ROUNDING: f64 = 1e-13;
/// Joint step (rad or m) that counts as a gain whatever the merit says.
const STANDSTILL: f64 = 1e-9;
