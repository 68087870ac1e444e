//! Newton's method onto the task of a path point, with inequalities and joint limits as an active set.
//!
//! The step is the shortest joint motion that meets the equations. Where the tool leans or spins too far, rows that bring
//! it back are added; a joint beyond its limit is put onto it and held there.

use super::demand::Demand;
use super::tool::{MOST_BOUNDS, MOST_JOINTS, MOST_ROWS, Target};
use crate::joint_space::nearest;
use crate::kinematics::{NullSpace, Scratch};

/// Memory to pull configurations of one chain onto the task; one per thread.
pub(super) struct Puller<'a> {
    demand: &'a Demand,
    scratch: Scratch,
    /// Factors by number of rows.
    factors: Vec<NullSpace>,
    c: Vec<f64>,
    jacobian: Vec<f64>,
    step: Vec<f64>,
    held: Vec<(usize, f64)>,
}

/// How far a configuration is pulled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pull {
    /// Share of the cone at which the tool axis arrives when it comes from outside, and of the spin range.
    pub tilt: f64,
    pub spin: f64,
    /// Newton step at which it is there, rad or m: what is left is of the order of its square.
    pub done: f64,
    /// Most steps.
    pub steps: usize,
    /// Longest step.
    pub longest: f64,
}

impl Pull {
    /// From anywhere.
    pub const FAR: Self = Self { tilt: 0.9, spin: 0.9, done: 1e-4, steps: 30, longest: 0.5 };
    /// From the point before.
    pub const NEAR: Self = Self { tilt: 0.98, spin: 0.98, done: 1e-3, steps: 8, longest: 0.5 };
    /// Onto the task and no farther: what leaves the cone or the range of the spin is put on its edge.
    pub const ONTO: Self = Self { tilt: 1.0, spin: 1.0, ..Self::NEAR };
}

impl<'a> Puller<'a> {
    pub fn new(demand: &'a Demand) -> Self {
        let n = demand.dof();
        let most = (MOST_ROWS + MOST_BOUNDS).min(n) + n;
        Self {
            demand,
            scratch: Scratch::new(&demand.chain),
            factors: (0..=n).map(|m| NullSpace::new(m, n)).collect(),
            c: vec![0.0; most],
            jacobian: vec![0.0; most * n],
            step: vec![0.0; n],
            held: Vec::new(),
        }
    }

    /// Pulls `q` onto `target`, within the limits; false where that fails.
    pub fn pull(&mut self, q: &mut [f64], target: &Target, pull: &Pull) -> bool {
        self.held.clear();
        let most = self.demand.spare();
        loop {
            if !self.newton(q, target, pull) {
                return false;
            }
            let before = self.held.len();
            self.hold_beyond(q);
            if self.held.len() == before {
                return true;
            }
            if self.held.len() > most {
                return false;
            }
        }
    }

    /// The same from anywhere: windings that fit the limits are taken.
    pub fn pull_far(&mut self, q: &mut [f64], target: &Target, pull: &Pull) -> bool {
        self.held.clear();
        if !self.newton(q, target, pull) {
            return false;
        }
        wind_into(q, self.demand);
        self.pull(q, target, pull)
    }

    /// The same without joint limits.
    pub fn pull_free(&mut self, q: &mut [f64], target: &Target, pull: &Pull) -> bool {
        self.held.clear();
        self.newton(q, target, pull)
    }

    fn hold_beyond(&mut self, q: &mut [f64]) {
        for i in 0..q.len() {
            let (lower, upper) = (self.demand.lower[i], self.demand.upper[i]);
            if q[i] >= lower - HELD_ROUNDING && q[i] <= upper + HELD_ROUNDING {
                continue;
            }
            if self.held.iter().any(|held| held.0 == i) {
                continue;
            }
            let limit = if q[i] < lower { lower } else { upper };
            self.held.push((i, limit));
        }
    }

    fn newton(&mut self, q: &mut [f64], target: &Target, pull: &Pull) -> bool {
        let (n, base) = (q.len(), self.demand.tool.rows());
        let tool = &self.demand.tool;
        for _ in 0..pull.steps {
            let kinematics = self.demand.chain.kinematics_unchecked(q, &mut self.scratch);
            let inside = tool.inside(kinematics.pose(), target, pull.tilt, pull.spin);
            let rows = base + inside.rows() + self.held.len();
            if rows > n {
                return false;
            }
            let (c, jacobian) = (&mut self.c[..rows], &mut self.jacobian[..rows * n]);
            if rows == base {
                tool.linearise(&kinematics, target, c, jacobian);
            } else {
                let mut plain = [0.0; MOST_ROWS * MOST_JOINTS];
                if base * n > plain.len() {
                    return false;
                }
                tool.linearise(&kinematics, target, c, &mut plain[..base * n]);
                jacobian.fill(0.0);
                for (column, plain) in jacobian.chunks_exact_mut(rows).zip(plain.chunks_exact(base)) {
                    column[..base].copy_from_slice(plain);
                }
                tool.linearise_inside(&kinematics, target, &inside, base, rows, c, jacobian);
                for (k, (i, limit)) in self.held.iter().enumerate() {
                    let row = base + inside.rows() + k;
                    c[row] = q[*i] - limit;
                    jacobian[i * rows + row] = 1.0;
                }
            }
            let factor = &mut self.factors[rows];
            factor.factor(jacobian);
            factor.shortest(c, &mut self.step);
            let length = self.step.iter().map(|x| x * x).sum::<f64>().sqrt();
            if !length.is_finite() {
                return false;
            }
            let scale = if length > pull.longest { pull.longest / length } else { 1.0 };
            for (q, d) in q.iter_mut().zip(&self.step) {
                *q -= scale * d;
            }
            if length <= pull.done {
                // Directions that the rows have lost do not show in the step.
                return c.iter().all(|c| c.abs() <= LOST * pull.done);
            }
        }
        false
    }
}

/// Turns rotational joints by whole turns into their limits, where one fits: the one next to the middle of the range.
pub(super) fn wind_into(q: &mut [f64], demand: &Demand) {
    for (i, q) in q.iter_mut().enumerate() {
        if !demand.chain.steps()[i].rotational {
            continue;
        }
        let [middle, _] = demand.range[i];
        *q = nearest(*q, middle);
    }
}

/// Residual, per unit of the last step, above which equations contradict each other: joints move the tool by no more than
/// the arm's length.
const LOST: f64 = 20.0;
/// A joint this little outside its limit is on it, rad or m.
const HELD_ROUNDING: f64 = 1e-12;
