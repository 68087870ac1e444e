//! Which distances a freedom can change.
//!
//! An arm that keeps its task moves in the null space of the task's Jacobian. Pairs whose distance does not change in it, at none
//! of a few seeded configurations, are held by the task: a hand whose pose is given, a link that is round about an axis
//! through the base. They neither hide nor shift what the freedom can do for the others.

use std::f64::consts::PI;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::proximity::{Contact, Proximity, ProximityMemory, Thing, Visitor};
use super::surroundings::Surroundings;
use crate::kinematics::{Kinematics, NullSpace, Scratch, Task};
use crate::tolerance::HELD_SLOPE;

/// Configurations that are checked.
const SAMPLES: usize = 16;

/// The pairs that the freedom of a task can move, and those that it cannot. Without any freedom, and where obstacles move, all
/// pairs of obstacles with what the freedom moves at all are in the first part.
pub fn split_by_freedom(around: &Surroundings, task: &Task) -> (Surroundings, Surroundings) {
    let chain = around.chain();
    let (m, n) = (task.dim(), chain.dof());
    let moved: std::collections::HashSet<(Thing, Thing)> = if m >= n {
        around.pairs().into_iter().collect()
    } else {
        let mut scratch = Scratch::new(chain);
        let mut memory = ProximityMemory::new();
        let mut space = NullSpace::new(m, n);
        let mut jacobian = vec![0.0; m * n];
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut moved = std::collections::HashSet::new();
        for _ in 0..SAMPLES {
            let q: Vec<f64> = chain
                .lower()
                .iter()
                .zip(chain.upper())
                .map(|(lower, upper)| {
                    let (low, high) = (lower.max(-PI), upper.min(PI));
                    low + (high - low).max(0.0) * rng.random_range(0.1..0.9)
                })
                .collect();
            let kinematics = chain.kinematics_unchecked(&q, &mut scratch);
            task.write_jacobian(&kinematics, &mut jacobian);
            space.factor(&jacobian);
            let mut look = Look { kinematics, space: &space, moved: &mut moved, gradient: vec![0.0; n] };
            around.scan(&kinematics, 0.0, &mut memory, &mut look);
        }
        moved
    };
    let first = around.filtered(|a, b| moved.contains(&(a, b)));
    let second = around.filtered(|a, b| !moved.contains(&(a, b)));
    (first, second)
}

struct Look<'a, 'k> {
    kinematics: Kinematics<'k>,
    space: &'a NullSpace,
    moved: &'a mut std::collections::HashSet<(Thing, Thing)>,
    gradient: Vec<f64>,
}

impl Visitor for Look<'_, '_> {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        // What is known to move need not be looked at again.
        if self.moved.contains(&(first, second)) { f64::NEG_INFINITY } else { f64::INFINITY }
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        self.gradient.fill(0.0);
        contact.add_gradient(&self.kinematics, 1.0, &mut self.gradient);
        let basis = self.space.basis();
        let slopes = basis
            .column_iter()
            .map(|column| column.iter().zip(&self.gradient).map(|(n, g)| n * g).sum::<f64>().abs());
        if slopes.fold(0.0, f64::max) > HELD_SLOPE {
            self.moved.insert((contact.first, contact.second));
        }
        true
    }
}
