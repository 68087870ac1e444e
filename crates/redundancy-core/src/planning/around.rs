//! What a plan keeps away from: obstacles, and the arm's own links.
//!
//! At every row the plan keeps all pairs that its freedom can move apart (`room >= 0`, an inequality), and pays for what they
//! miss of the wanted distance from obstacles:
//!
//! `room = -e log sum_i exp(-d_i / e)`, `missing = sum_i max(0, 1 - d_i / wanted)^2`
//!
//! over the distances `d_i` of the pairs. `room` is below the least of them, by nothing where one pair is nearer than all
//! others, and smooth where the nearest one changes. What the freedom cannot move (a tool whose pose is given, against its
//! workpiece) is kept apart and only reported.

use std::cell::RefCell;

use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::{Kinematics, Scratch, Task};
use crate::scene::{
    Contact, LinkGeometry, Nearby, Proximity, ProximityMemory, Scene, Surroundings, Thing, Visitor,
    split_by_freedom, with_memory,
};
use crate::tolerance::{PLAN_ROOM_SEEN, PLAN_ROOM_SMOOTHING};

/// What an arm keeps away from along a plan.
#[derive(Debug, Clone)]
pub(super) struct Around {
    /// Pairs that the freedom changes, and those that it cannot.
    pub moved: Surroundings,
    pub held: Surroundings,
    /// Distance from obstacles that is wanted, m, and what it costs to miss it.
    wanted: f64,
    pub weight: f64,
}

/// How near everything is at one configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Near {
    /// A lower bound of all distances, smooth, m.
    pub room: f64,
    /// See the module's head.
    pub missing: f64,
}

/// The same with derivatives: gradients `(n)` and Hessians `(n, n)`, without the curvature of single distances.
pub(super) struct NearDerivatives {
    pub near: Near,
    pub room_gradient: Vec<f64>,
    pub room_hessian: Vec<f64>,
    pub missing_gradient: Vec<f64>,
    pub missing_hessian: Vec<f64>,
    work: Vec<f64>,
}

impl NearDerivatives {
    pub fn new(n: usize) -> Self {
        Self {
            near: Near { room: 0.0, missing: 0.0 },
            room_gradient: vec![0.0; n],
            room_hessian: vec![0.0; n * n],
            missing_gradient: vec![0.0; n],
            missing_hessian: vec![0.0; n * n],
            work: vec![0.0; n],
        }
    }

    fn clear(&mut self) {
        for values in [
            &mut self.room_gradient,
            &mut self.room_hessian,
            &mut self.missing_gradient,
            &mut self.missing_hessian,
        ] {
            values.fill(0.0);
        }
    }
}

/// A sum of exponentials relative to the least distance so far.
struct Soft {
    least: f64,
    sum: f64,
}

impl Soft {
    /// Weight of a distance, and the factor of what was added before.
    fn add(&mut self, distance: f64) -> (f64, f64) {
        let (least, e) = (self.least.min(distance), PLAN_ROOM_SMOOTHING);
        let (weight, shrink) = ((-(distance - least) / e).exp(), (-(self.least - least) / e).exp());
        self.least = least;
        self.sum = self.sum * shrink + weight;
        (weight, shrink)
    }

    fn room(&self) -> f64 {
        if self.sum > 0.0 { self.least - PLAN_ROOM_SMOOTHING * self.sum.ln() } else { self.least }
    }

    /// Beyond this a distance does not count.
    fn limit(&self) -> f64 {
        self.least + PLAN_ROOM_SEEN * PLAN_ROOM_SMOOTHING
    }
}

fn is_own(first: Thing, second: Thing) -> bool {
    matches!((first, second), (Thing::Link(_), Thing::Link(_)))
}

/// Distances alone.
struct Values {
    soft: Soft,
    wanted: f64,
    missing: f64,
}

impl Visitor for Values {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        if is_own(first, second) { self.soft.limit() } else { self.soft.limit().max(self.wanted) }
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let distance = contact.gap.distance;
        self.soft.add(distance);
        if distance < self.wanted && !is_own(contact.first, contact.second) {
            self.missing += (1.0 - distance / self.wanted).powi(2);
        }
        true
    }
}

/// Distances with derivatives.
struct Slopes<'a, 'k> {
    soft: Soft,
    wanted: f64,
    kinematics: &'a Kinematics<'k>,
    out: &'a mut NearDerivatives,
}

impl Visitor for Slopes<'_, '_> {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        if is_own(first, second) { self.soft.limit() } else { self.soft.limit().max(self.wanted) }
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let out = &mut *self.out;
        let n = out.work.len();
        out.work.fill(0.0);
        contact.add_gradient(self.kinematics, 1.0, &mut out.work);
        let (weight, shrink) = self.soft.add(contact.gap.distance);
        for (sum, g) in out.room_gradient.iter_mut().zip(&out.work) {
            *sum = *sum * shrink + weight * g;
        }
        for i in 0..n {
            for j in 0..n {
                let sum = &mut out.room_hessian[i * n + j];
                *sum = *sum * shrink + weight * out.work[i] * out.work[j];
            }
        }
        let short = 1.0 - contact.gap.distance / self.wanted;
        if short > 0.0 && self.wanted > 0.0 && !is_own(contact.first, contact.second) {
            let (slope, curvature) = (-2.0 * short / self.wanted, 2.0 / (self.wanted * self.wanted));
            out.near.missing += short * short;
            for i in 0..n {
                out.missing_gradient[i] += slope * out.work[i];
                for j in 0..n {
                    out.missing_hessian[i * n + j] += curvature * out.work[i] * out.work[j];
                }
            }
        }
        true
    }
}

thread_local! {
    static SCRATCH: RefCell<Option<Scratch>> = const { RefCell::new(None) };
}

/// Calls `work` with kinematic memory that this thread keeps.
fn with_scratch<T>(chain: &Chain, work: impl FnOnce(&mut Scratch) -> T) -> T {
    SCRATCH.with(|scratch| match scratch.try_borrow_mut() {
        Ok(mut scratch) => {
            let scratch = scratch.get_or_insert_with(|| Scratch::new(chain));
            if scratch.dof() != chain.dof() {
                *scratch = Scratch::new(chain);
            }
            work(scratch)
        }
        Err(_) => work(&mut Scratch::new(chain)),
    })
}

impl Around {
    /// `None` where there is nothing to keep away from.
    pub fn new(
        chain: &Chain,
        task: &Task,
        (links, scene, self_collision): (&LinkGeometry, Option<&Scene>, bool),
        (wanted, weight): (f64, f64),
    ) -> Result<Option<Self>> {
        let all = Surroundings::new(chain, links, scene, self_collision)?;
        if all.is_empty() {
            return Ok(None);
        }
        let (moved, held) = split_by_freedom(&all, task);
        Ok(Some(Self { moved, held, wanted, weight }))
    }

    /// Whether obstacles move by themselves.
    pub fn moves(&self) -> bool {
        self.moved.moves() || self.held.moves()
    }

    /// How near everything is that the freedom moves.
    pub fn near(&self, q: &[f64], t: f64) -> Near {
        with_scratch(self.moved.chain(), |scratch| {
            let kinematics = self.moved.chain().kinematics_unchecked(q, scratch);
            let soft = Soft { least: self.seen(), sum: 0.0 };
            let mut values = Values { soft, wanted: self.wanted, missing: 0.0 };
            with_memory(|memory| self.moved.scan(&kinematics, t, memory, &mut values));
            Near { room: values.soft.room(), missing: values.missing }
        })
    }

    /// The same with derivatives.
    pub fn derivatives(&self, kinematics: &Kinematics<'_>, t: f64, out: &mut NearDerivatives) {
        out.clear();
        out.near.missing = 0.0;
        let soft = Soft { least: self.seen(), sum: 0.0 };
        let mut slopes = Slopes { soft, wanted: self.wanted, kinematics, out };
        with_memory(|memory| self.moved.scan(kinematics, t, memory, &mut slopes));
        let (room, sum) = (slopes.soft.room(), slopes.soft.sum);
        out.near.room = room;
        if sum == 0.0 {
            return;
        }
        let n = out.work.len();
        out.room_gradient.iter_mut().for_each(|g| *g /= sum);
        for i in 0..n {
            for j in 0..n {
                let spread = out.room_hessian[i * n + j] / sum - out.room_gradient[i] * out.room_gradient[j];
                out.room_hessian[i * n + j] = -spread / PLAN_ROOM_SMOOTHING;
            }
        }
    }

    /// Distances up to which pairs are checked, m.
    fn seen(&self) -> f64 {
        PLAN_ROOM_SEEN * PLAN_ROOM_SMOOTHING + self.wanted
    }

    /// Whether everything that the freedom moves is at least `by` apart.
    pub fn is_clear(&self, q: &[f64], t: f64, by: f64) -> bool {
        with_scratch(self.moved.chain(), |scratch| {
            let kinematics = self.moved.chain().kinematics_unchecked(q, scratch);
            with_memory(|memory| self.moved.is_clear(&kinematics, t, by, memory))
        })
    }

    /// The nearest pair of what the freedom moves, and of what it cannot.
    pub fn nearest(&self, q: &[f64], t: f64) -> [Option<Nearby>; 2] {
        with_scratch(self.moved.chain(), |scratch| {
            let kinematics = self.moved.chain().kinematics_unchecked(q, scratch);
            let of = |part: &Surroundings| {
                with_memory(|memory| part.nearest(&kinematics, t, f64::INFINITY, memory))
            };
            [of(&self.moved), of(&self.held)]
        })
    }

    /// Distances from obstacles and of links from each other at a configuration, of all pairs.
    pub fn row(&self, q: &[f64], t: f64) -> [f64; 2] {
        struct Two([f64; 2]);
        impl Visitor for Two {
            fn limit(&self, first: Thing, second: Thing) -> f64 {
                self.0[usize::from(is_own(first, second))]
            }
            fn found(&mut self, contact: &Contact<'_>) -> bool {
                self.0[usize::from(is_own(contact.first, contact.second))] = contact.gap.distance;
                true
            }
        }
        with_scratch(self.moved.chain(), |scratch| {
            let kinematics = self.moved.chain().kinematics_unchecked(q, scratch);
            let mut two = Two([f64::INFINITY; 2]);
            for part in [&self.moved, &self.held] {
                with_memory(|memory: &mut ProximityMemory| part.scan(&kinematics, t, memory, &mut two));
            }
            two.0
        })
    }

    /// Whether obstacles, and links against each other, are checked.
    pub fn looks_at(&self) -> [bool; 2] {
        let pairs: Vec<(Thing, Thing)> = self.moved.pairs().into_iter().chain(self.held.pairs()).collect();
        [pairs.iter().any(|pair| !is_own(pair.0, pair.1)), pairs.iter().any(|pair| is_own(pair.0, pair.1))]
    }

    /// "link 'a' and obstacle 'b'".
    pub fn names(&self, first: Thing, second: Thing) -> String {
        let one = |thing: Thing| match thing {
            Thing::Link(_) => format!("link '{}'", self.moved.name(thing)),
            Thing::Obstacle(_) => format!("obstacle '{}'", self.moved.name(thing)),
        };
        format!("{} and {}", one(first), one(second))
    }
}
