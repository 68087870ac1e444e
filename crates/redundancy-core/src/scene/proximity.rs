//! Distances of an arm from all that it must not touch, with gradients: obstacles, itself, or both.
//!
//! [`Proximity`] is what planners, criteria and velocity schemes ask. Its pairs are links against obstacles, links against
//! links, and what a link carries against both. Bounding volumes come first: pairs whose capsules are further apart than is
//! asked for are not checked. With its memory at hand nothing allocates.
//!
//! The distance d of two things changes with joint k by `n . (v_first - v_second)`, the velocities of both at the nearest
//! point per unit of joint k, n the unit vector between them: where the nearest points are on their surfaces does not count.
//! Joints that move both change nothing.

use nalgebra::Vector3;

use super::body::Body;
use super::convex::Memory;
use super::narrow::Gap;
use super::solid::{Rod, Solid};
use crate::chain::Chain;
use crate::kinematics::{Kinematics, Scratch};
use crate::tolerance::SWEEP_DEPTH;

/// One side of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Thing {
    /// A link, by its index in [`LinkGeometry::names`](super::LinkGeometry::names).
    Link(usize),
    /// An obstacle, by its index in the scene.
    Obstacle(usize),
}

/// Two things and how near they are.
#[derive(Debug, Clone, Copy)]
pub struct Contact<'a> {
    /// The one that moves with the arm: a link, or an obstacle that a link carries.
    pub first: Thing,
    /// The other one.
    pub second: Thing,
    /// How near they are; `on_first` is on the surface of `first`.
    pub gap: Gap,
    bodies: (&'a Body, Option<&'a Body>),
    velocity: Vector3<f64>,
}

impl<'a> Contact<'a> {
    pub(super) fn new(
        first: Thing,
        second: Thing,
        gap: Gap,
        bodies: (&'a Body, Option<&'a Body>),
        velocity: Vector3<f64>,
    ) -> Self {
        Self { first, second, gap, bodies, velocity }
    }

    /// Adds `factor d distance / d q` to `out` (n).
    #[inline]
    pub fn add_gradient(&self, kinematics: &Kinematics<'_>, factor: f64, out: &mut [f64]) {
        let (first, second) = self.bodies;
        let shared = second.map_or(0, |second| first.joints_before.min(second.joints_before));
        first.add_gradient(kinematics, &self.gap, shared, factor, out);
        if let Some(second) = second {
            second.add_gradient(kinematics, &self.gap, shared, -factor, out);
        }
    }

    /// Change of the distance per second from the obstacle's own motion, m/s.
    pub fn by_time(&self) -> f64 {
        -self.gap.gradient.dot(&self.velocity)
    }

    /// The joints that change it: from the first number on, before the second.
    pub fn joints(&self) -> (usize, usize) {
        let (first, second) = self.bodies;
        let other = second.map_or(0, |second| second.joints_before);
        (first.joints_before.min(other), first.joints_before.max(other))
    }
}

/// Memory for [`Proximity`]; grows on first use, then nothing allocates.
#[derive(Debug)]
pub struct ProximityMemory {
    pub(super) convex: Memory,
    pub(super) rods: Vec<Rod>,
    /// Bodies that their joint draws out, in the world.
    pub(super) drawn: Vec<Option<Solid>>,
    /// For each pair the direction in which it was last apart, see [`Memory::direction`]. A direction of another arm or
    /// scene is no less valid, it only succeeds less often.
    pub(super) directions: Vec<Vector3<f64>>,
}

impl ProximityMemory {
    /// Memory for any arm and scene.
    pub fn new() -> Self {
        Self { convex: Memory::new(), rods: Vec::new(), drawn: Vec::new(), directions: Vec::new() }
    }
}

impl Default for ProximityMemory {
    fn default() -> Self {
        Self::new()
    }
}

/// What a scan asks for.
pub trait Visitor {
    /// Pairs at least as far apart as this are left out.
    fn limit(&self, first: Thing, second: Thing) -> f64;

    /// A pair that is nearer; `false` ends the scan.
    fn found(&mut self, contact: &Contact<'_>) -> bool;

    /// Whether of pairs in contact nothing but that counts: their distance is then some number <= 0, at most the true one.
    fn contact_only(&self) -> bool {
        false
    }
}

/// Everything that an arm keeps a distance from.
pub trait Proximity: Send + Sync + std::fmt::Debug {
    /// The arm.
    fn chain(&self) -> &Chain;

    /// Name of a link, or of an obstacle (its number and type where it has none).
    fn name(&self, thing: Thing) -> String;

    /// Number of links: `Thing::Link(i)` has `i` below it.
    fn links(&self) -> usize;

    /// True where some obstacle moves by itself.
    fn moves(&self) -> bool;

    /// Shows every pair that is nearer than the visitor's limit, at time `t` (s). Returns `false` where it was ended.
    fn scan(
        &self,
        kinematics: &Kinematics<'_>,
        t: f64,
        memory: &mut ProximityMemory,
        visitor: &mut dyn Visitor,
    ) -> bool;

    /// Whether distances at both ends of a motion prove that every pair stays at least `by` apart on the way: the joints move by at
    /// most `steps` (n), each monotonously, and the time goes from that of the first end to that of the second.
    fn prove(
        &self,
        ends: [(&Kinematics<'_>, f64); 2],
        steps: &[f64],
        by: f64,
        memory: &mut ProximityMemory,
    ) -> Proof;

    /// Whether every pair is at least `by` apart.
    fn is_clear(&self, kinematics: &Kinematics<'_>, t: f64, by: f64, memory: &mut ProximityMemory) -> bool {
        struct Any(f64);
        impl Visitor for Any {
            fn limit(&self, _: Thing, _: Thing) -> f64 {
                self.0
            }
            fn found(&mut self, _: &Contact<'_>) -> bool {
                false
            }
            fn contact_only(&self) -> bool {
                self.0 >= 0.0
            }
        }
        self.scan(kinematics, t, memory, &mut Any(by))
    }

    /// The nearest pair below `upto`.
    fn nearest(
        &self,
        kinematics: &Kinematics<'_>,
        t: f64,
        upto: f64,
        memory: &mut ProximityMemory,
    ) -> Option<Nearby> {
        let mut least = Least { upto, best: None };
        self.scan(kinematics, t, memory, &mut least);
        least.best
    }
}

/// The nearest pair of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearby {
    /// The one that moves with the arm.
    pub first: Thing,
    /// The other one.
    pub second: Thing,
    /// How near they are.
    pub gap: Gap,
}

struct Least {
    upto: f64,
    best: Option<Nearby>,
}

impl Visitor for Least {
    fn limit(&self, _: Thing, _: Thing) -> f64 {
        self.upto
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        if contact.gap.distance < self.upto {
            self.upto = contact.gap.distance;
            self.best = Some(Nearby { first: contact.first, second: contact.second, gap: contact.gap });
        }
        true
    }
}

/// What the ends of a motion prove, see [`Proximity::prove`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Proof {
    /// All pairs stay apart.
    Clear,
    /// This pair may come too near in between.
    Open {
        /// One of the two.
        first: Thing,
        /// The other one.
        second: Thing,
    },
    /// This pair is too near at an end, 0 or 1.
    Hit {
        /// One of the two.
        first: Thing,
        /// The other one.
        second: Thing,
        /// At which end.
        end: usize,
    },
}

/// Where a straight motion in joint space comes too near to something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepHit {
    /// Share of the way, 0 to 1.
    pub at: f64,
    /// The pair.
    pub first: Thing,
    /// See [`SweepHit::first`].
    pub second: Thing,
}

/// Whether every pair stays at least `by` apart while the joints go straight from one configuration to another, and time
/// from one to the other: `None`, or where it does not.
///
/// A pair that moves by at most m against each other on the way stays `(d_0 + d_1 - m) / 2` apart, with d its distances at
/// the ends. Where that is not enough for some pair the way is halved, at most [`SWEEP_DEPTH`] times: what is then still open counts
/// as too near.
pub fn sweep(
    proximity: &dyn Proximity,
    [from, to]: [&[f64]; 2],
    [start, end]: [f64; 2],
    by: f64,
    memory: &mut SweepMemory,
) -> Option<SweepHit> {
    let n = from.len();
    let chain = proximity.chain();
    // Parts of the way still to be proven: first and last share, the first part on top.
    let mut open = [(0.0, 0.0); SWEEP_DEPTH + 2];
    open[0] = (0.0, 1.0);
    let mut height = 1;
    while height > 0 {
        height -= 1;
        let (a, b) = open[height];
        for (share, q) in [a, b].into_iter().zip(&mut memory.ends) {
            q.clear();
            q.extend((0..n).map(|i| from[i] + share * (to[i] - from[i])));
        }
        memory.steps.clear();
        memory.steps.extend((0..n).map(|i| (b - a) * (to[i] - from[i]).abs()));
        let [first, second] = &mut memory.scratch;
        let first = chain.kinematics_unchecked(&memory.ends[0], first);
        let second = chain.kinematics_unchecked(&memory.ends[1], second);
        let times = [a, b].map(|share| start + share * (end - start));
        let ends = [(&first, times[0]), (&second, times[1])];
        match proximity.prove(ends, &memory.steps, by, &mut memory.proximity) {
            Proof::Clear => continue,
            Proof::Hit { first, second, end } => return Some(SweepHit { at: [a, b][end], first, second }),
            // Too short to be told apart from contact.
            Proof::Open { first, second } if b - a <= 0.5f64.powi(SWEEP_DEPTH as i32) => {
                return Some(SweepHit { at: a, first, second });
            }
            Proof::Open { .. } => {}
        }
        let middle = 0.5 * (a + b);
        open[height] = (middle, b);
        open[height + 1] = (a, middle);
        height += 2;
    }
    None
}

/// Memory for [`sweep`].
#[derive(Debug)]
pub struct SweepMemory {
    scratch: [Scratch; 2],
    ends: [Vec<f64>; 2],
    steps: Vec<f64>,
    proximity: ProximityMemory,
}

impl SweepMemory {
    /// For one chain.
    pub fn new(chain: &Chain) -> Self {
        Self {
            scratch: [Scratch::new(chain), Scratch::new(chain)],
            ends: [Vec::new(), Vec::new()],
            steps: Vec::new(),
            proximity: ProximityMemory::new(),
        }
    }
}

thread_local! {
    static MEMORY: std::cell::RefCell<ProximityMemory> = std::cell::RefCell::new(ProximityMemory::new());
}

/// Calls `work` with memory that this thread keeps.
pub(crate) fn with_memory<T>(work: impl FnOnce(&mut ProximityMemory) -> T) -> T {
    MEMORY.with(|memory| match memory.try_borrow_mut() {
        Ok(mut memory) => work(&mut memory),
        // Within another call of this function.
        Err(_) => work(&mut ProximityMemory::new()),
    })
}
