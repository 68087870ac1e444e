//! What distances at one swivel prove about other swivels of the same branch over the same pose.
//!
//! The swivel turns the links on both sides of the elbow about the line from shoulder to wrist; what is before them turns about
//! the shoulder, what is behind them about the wrist, and the hand stays. So links of group g (as many joints move them) move by at
//! most
//!
//! ```text
//! e_1 |dq_1|,  e_2 (|dq_1| + |dq_2|),  e_3 |ds|,  e_4 |ds|,  e_5 (|dq_6| + |dq_7|),  e_6 |dq_7|,  0
//! ```
//!
//! with e_g how far they reach from the shoulder, that line, or the wrist. Pairs whose distance at the anchor is larger than what
//! both move by, and what is asked for, need not be computed.

use nalgebra::Vector3;

use super::near::Near;
use crate::joint_space::wrap;
use crate::kinematics::Kinematics;
use crate::scene::{Contact, Surroundings, Thing, Visitor};

/// Links by how many joints move them, 0 to 7.
pub(super) const GROUPS: usize = 8;
/// Distances are known at an anchor up to this much (m) more than what is asked for.
const ANCHOR_REACH: f64 = 0.15;
/// Most links whose clearances are kept apart; those beyond share the last place.
const MOST_LINKS: usize = 64;

/// How many joints move each link and obstacle.
#[derive(Debug, Clone, Default)]
pub(in crate::planning) struct Groups {
    links: Vec<usize>,
    obstacles: Vec<usize>,
}

impl Groups {
    pub fn new(around: &Surroundings) -> Self {
        let group = |thing: Thing| around.joints_before(thing).min(GROUPS - 1);
        let obstacles = around.scene().map_or(0, |scene| scene.obstacles().len());
        Self {
            links: (0..around.link_names().len()).map(|i| group(Thing::Link(i))).collect(),
            obstacles: (0..obstacles).map(|i| group(Thing::Obstacle(i))).collect(),
        }
    }

    #[inline(always)]
    fn of(&self, thing: Thing) -> usize {
        let known = match thing {
            Thing::Link(i) => self.links.get(i),
            Thing::Obstacle(i) => self.obstacles.get(i),
        };
        known.copied().unwrap_or(0)
    }
}

/// Pairs of groups: bit `b` of number `a`, both ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::planning) struct Open([u8; GROUPS]);

impl Open {
    pub const ALL: Self = Self([u8::MAX; GROUPS]);

    #[inline(always)]
    fn contains(self, a: usize, b: usize) -> bool {
        self.0[a] & (1 << b) != 0
    }

    fn is_empty(self) -> bool {
        self.0 == [0; GROUPS]
    }

    fn is_within(self, other: Self) -> bool {
        self.0.iter().zip(other.0).all(|(a, b)| a & !b == 0)
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(in crate::planning) struct Anchor {
    branch: usize,
    s: f64,
    q: [f64; 7],
    /// e_g, m.
    extents: [f64; GROUPS],
    /// Least distance of each pair of groups, the smaller one first.
    least: [[f64; GROUPS]; GROUPS],
    /// The pairs that are nearer at the anchor itself than what is asked for.
    near: Open,
}

/// What an anchor says about another swivel.
pub(in crate::planning) enum Known {
    /// Nothing is nearer than what was asked for.
    Far,
    /// Only these pairs may be.
    Some(Open),
    /// Too little: a new anchor is of more use.
    Little,
}

impl Anchor {
    /// From a scan at `q`.
    pub fn new(
        (branch, s, q): (usize, f64, &[f64; 7]),
        scan: &NearScan<'_>,
        kinematics: &Kinematics<'_>,
        around: &Surroundings,
        [shoulder, wrist]: [&Vector3<f64>; 2],
    ) -> Self {
        let line = wrist - shoulder;
        let along = line / line.norm().max(f64::MIN_POSITIVE);
        let mut extents = [0.0; GROUPS];
        around.furthest(kinematics, &mut extents, |group, p| match group {
            0..3 => (p - shoulder).norm(),
            3 | 4 => (p - shoulder).cross(&along).norm(),
            _ => (p - wrist).norm(),
        });
        let mut near = Open::default();
        for a in 0..GROUPS {
            for b in a..GROUPS {
                if scan.least[a][b] < scan.beyond {
                    near.0[a] |= 1 << b;
                    near.0[b] |= 1 << a;
                }
            }
        }
        Self { branch, s, q: *q, extents, least: scan.least, near }
    }

    /// What it says about the branch's configuration `q` at swivel `s`, up to distances of `beyond`.
    pub fn says(&self, (branch, s, q): (usize, f64, &[f64; 7]), beyond: f64) -> Known {
        if branch != self.branch {
            return Known::Little;
        }
        let turned = |i: usize| wrap(q[i] - self.q[i]).abs();
        let (swivel, e) = (wrap(s - self.s).abs(), &self.extents);
        let moved = [
            0.0,
            e[1] * turned(0),
            e[2] * (turned(0) + turned(1)),
            e[3] * swivel,
            e[4] * swivel,
            e[5] * (turned(5) + turned(6)),
            e[6] * turned(6),
            0.0,
        ];
        let mut open = Open::default();
        for a in 0..GROUPS {
            for b in a + 1..GROUPS {
                if self.least[a][b] < beyond + moved[a] + moved[b] {
                    open.0[a] |= 1 << b;
                    open.0[b] |= 1 << a;
                }
            }
        }
        if open.is_empty() {
            Known::Far
        } else if open.is_within(self.near) {
            Known::Some(open)
        } else {
            Known::Little
        }
    }
}

/// The nearest of each link of a scan, and with a reach the least distances of pairs of groups.
pub(in crate::planning) struct NearScan<'a> {
    groups: &'a Groups,
    open: Open,
    beyond: f64,
    /// Distances are exact up to here.
    far: f64,
    distance: [f64; MOST_LINKS],
    least: [[f64; GROUPS]; GROUPS],
    touches: bool,
}

impl<'a> NearScan<'a> {
    /// Of some pairs, up to `beyond`.
    pub fn of(groups: &'a Groups, open: Open, beyond: f64) -> Self {
        let distance = [beyond; MOST_LINKS];
        let least = [[f64::INFINITY; GROUPS]; GROUPS];
        Self { groups, open, beyond, far: beyond, distance, least, touches: false }
    }

    /// Of all pairs, for an anchor.
    pub fn for_anchor(groups: &'a Groups, beyond: f64) -> Self {
        let far = beyond + ANCHOR_REACH;
        Self { far, least: [[far; GROUPS]; GROUPS], ..Self::of(groups, Open::ALL, beyond) }
    }

    /// What was found, where it is worth an anchor: the scan of an arm in contact ends early.
    pub fn is_whole(&self) -> bool {
        !self.touches
    }

    /// The least distance, and by how much the links miss `wanted`.
    pub fn near(&self, wanted: f64) -> Near {
        if self.touches {
            return Near { least: self.distance.iter().copied().fold(0.0, f64::min), missing: 0.0 };
        }
        let mut near = Near::of(self.distance, wanted);
        near.least = near.least.min(self.beyond);
        near
    }

    /// The link that a pair belongs to.
    #[inline(always)]
    fn place(&self, first: Thing, second: Thing) -> usize {
        let link = match (first, second) {
            (Thing::Link(link), _) | (_, Thing::Link(link)) => link,
            // What a link carries beside an obstacle.
            _ => self.groups.links.len(),
        };
        link.min(MOST_LINKS - 1)
    }
}

impl Visitor for NearScan<'_> {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        if self.far > self.beyond {
            return self.far;
        }
        if self.open != Open::ALL && !self.open.contains(self.groups.of(first), self.groups.of(second)) {
            return f64::NEG_INFINITY;
        }
        self.distance[self.place(first, second)]
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let (place, distance) = (self.place(contact.first, contact.second), contact.gap.distance);
        self.distance[place] = self.distance[place].min(distance);
        if self.far > self.beyond {
            let (a, b) = (self.groups.of(contact.first), self.groups.of(contact.second));
            let least = &mut self.least[a.min(b)][a.max(b)];
            *least = least.min(distance);
        }
        self.touches = distance <= 0.0;
        !self.touches
    }

    fn contact_only(&self) -> bool {
        true
    }
}
