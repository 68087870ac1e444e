//! Out of contact, on the task.
//!
//! Steps along the gradient of the room within the motions that keep the task, each followed by Newton's method back onto
//! it: narrow passages between obstacles hold few random states, and many states are just inside one of them.

use super::around::NearDerivatives;
use super::demand::Demand;
use super::pull::{Pull, Puller};
use crate::kinematics::{NullSpace, Scratch};

/// Memory to push configurations of one chain out of contact; one per thread.
pub(super) struct Pusher<'a> {
    demand: &'a Demand,
    puller: Puller<'a>,
    scratch: Scratch,
    null: NullSpace,
    c: Vec<f64>,
    jacobian: Vec<f64>,
    near: NearDerivatives,
}

impl<'a> Pusher<'a> {
    pub fn new(demand: &'a Demand) -> Self {
        let (n, m) = (demand.dof(), demand.tool.rows());
        Self {
            demand,
            puller: Puller::new(demand),
            scratch: Scratch::new(&demand.chain),
            null: NullSpace::new(m, n),
            c: vec![0.0; m],
            jacobian: vec![0.0; m * n],
            near: NearDerivatives::new(n),
        }
    }

    /// Pushes `q`, on the task of `row` and within limits, until nothing touches; false where that fails.
    pub fn push(&mut self, row: usize, q: &mut [f64]) -> bool {
        let demand = self.demand;
        let Some(around) = &demand.around else { return true };
        let (n, r) = (demand.dof(), demand.spare());
        let (target, t) = (&demand.targets[row], demand.time[row]);
        let mut trial = vec![0.0; n];
        for _ in 0..STEPS {
            let kinematics = demand.chain.kinematics_unchecked(q, &mut self.scratch);
            around.derivatives(&kinematics, t, &mut self.near);
            let room = self.near.near.room;
            if room >= demand.safe {
                return demand.is_clear(row, q);
            }
            if room < -DEEPEST {
                return false;
            }
            demand.tool.linearise(&kinematics, target, &mut self.c, &mut self.jacobian);
            self.null.factor(&self.jacobian);
            let basis = &self.null.basis().as_slice()[..n * r];
            let mut step = vec![0.0; n];
            for column in basis.chunks_exact(n) {
                let slope: f64 = column.iter().zip(&self.near.room_gradient).map(|(b, g)| b * g).sum();
                step.iter_mut().zip(column).for_each(|(s, b)| *s += slope * b);
            }
            let square: f64 = step.iter().map(|s| s * s).sum();
            if square <= f64::MIN_POSITIVE {
                return false;
            }
            let mut length = (BEYOND * (demand.safe - room) / square).min(LONGEST / square.sqrt());
            let mut gained = false;
            for _ in 0..HALVINGS {
                for i in 0..n {
                    trial[i] = q[i] + length * step[i];
                }
                if self.puller.pull(&mut trial, target, &Pull::ONTO) && around.near(&trial, t).room > room {
                    q.copy_from_slice(&trial);
                    gained = true;
                    break;
                }
                length *= 0.5;
            }
            if !gained {
                return false;
            }
        }
        demand.is_clear(row, q)
    }
}

/// Most steps, and halvings of each.
const STEPS: usize = 20;
const HALVINGS: usize = 4;
/// Part of the missing room that a step is to gain.
const BEYOND: f64 = 1.5;
/// Longest step, rad or m.
const LONGEST: f64 = 0.3;
/// Depth, m, from which nothing is tried.
const DEEPEST: f64 = 0.1;
