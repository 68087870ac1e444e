//! Which links of an arm must not touch each other: from an SRDF, or found by sampling.
//!
//! Links that stand still against each other are never a pair. Of the others those are left out that a joint connects, that
//! touch in more than [`PAIRS_ALWAYS`] of the samples, and that come no nearer than [`PAIRS_NEVER`] in any: the rule of
//! MoveIt's setup assistant, with a distance in place of no contact. Samples are seeded, uniform within the limits.

use std::f64::consts::PI;
use std::fmt::Write as _;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::body::Body;
use super::convex::Memory;
use super::narrow::{gap, rods_apart};
use super::solid::Rod;
use crate::chain::Chain;
use crate::joint_space::TURN;
use crate::kinematics::Scratch;
use crate::tolerance::{PAIRS_ALWAYS, PAIRS_NEVER};

/// Configurations that are checked to find pairs, and for capsules.
const SAMPLES: usize = 10_000;
const CAPSULE_SAMPLES: usize = 1_000;
/// Most pairs times configurations, beyond the least number of these.
const MAX_WORK: usize = 50_000_000;
/// Between two calls of the monitor.
const BLOCK: usize = 256;

/// Why a pair is not checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A joint connects them.
    Adjacent,
    /// They touch in nearly all configurations.
    Always,
    /// They come near each other in none of those that were checked.
    Never,
    /// They touch in the middle of the joints' ranges (capsules only).
    Default,
    /// The SRDF, or the caller, allows it.
    User,
}

impl Reason {
    /// Every reason.
    pub const ALL: [Self; 5] = [Self::Adjacent, Self::Always, Self::Never, Self::Default, Self::User];

    /// The reason as SRDF files spell it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Adjacent => "Adjacent",
            Self::Always => "Always",
            Self::Never => "Never",
            Self::Default => "Default",
            Self::User => "User",
        }
    }
}

/// Links with their shapes, to find pairs among.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Links<'a> {
    pub names: &'a [String],
    /// How many joints move each.
    pub groups: &'a [usize],
    pub bodies: &'a [Body],
    /// Sorted.
    pub neighbours: &'a [[usize; 2]],
}

/// Pairs to look at, and those left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Found {
    pub kept: Vec<[usize; 2]>,
    pub left_out: Vec<([usize; 2], Reason)>,
}

impl Links<'_> {
    /// Pairs of links that move against each other, ascending.
    pub fn moving(&self) -> impl Iterator<Item = [usize; 2]> {
        let n = self.names.len();
        (0..n)
            .flat_map(move |a| (a + 1..n).map(move |b| [a, b]))
            .filter(|[a, b]| self.groups[*a] != self.groups[*b])
    }

    /// A joint connects them, or joints over links without shapes. Where that is not known: nothing moves between them.
    fn adjacent(&self, [a, b]: [usize; 2]) -> bool {
        if !self.neighbours.is_empty() {
            return self.neighbours.binary_search(&[a, b]).is_ok();
        }
        let (low, high) = (self.groups[a].min(self.groups[b]), self.groups[a].max(self.groups[b]));
        !self.groups.iter().any(|group| *group > low && *group < high)
    }
}

/// How near the links of some pairs came.
struct Sampler<'a> {
    chain: &'a Chain,
    links: Links<'a>,
    scratch: Scratch,
    memory: Memory,
    rods: Vec<Rod>,
    /// For each pair: links, least distance so far, how often they touched.
    pairs: Vec<([usize; 2], f64, usize)>,
}

impl<'a> Sampler<'a> {
    fn new(chain: &'a Chain, links: &Links<'a>, pairs: impl Iterator<Item = [usize; 2]>) -> Self {
        let pairs = pairs.map(|pair| (pair, f64::INFINITY, 0)).collect();
        let (scratch, memory) = (Scratch::new(chain), Memory::new());
        Self { chain, links: *links, scratch, memory, rods: Vec::new(), pairs }
    }

    /// Looks at one configuration.
    fn look(&mut self, q: &[f64]) {
        let kinematics = self.chain.kinematics_unchecked(q, &mut self.scratch);
        let bodies = self.links.bodies;
        self.rods.clear();
        self.rods.extend(bodies.iter().map(|body| body.rod(&kinematics)));
        for ([a, b], least, touched) in &mut self.pairs {
            // Nearer than 0 nothing has to be known.
            let mut here = least.max(0.0);
            let of = |owner: usize| (0..bodies.len()).filter(move |i| bodies[*i].owner == owner);
            for i in of(*a) {
                for j in of(*b) {
                    if here < 0.0 || rods_apart(&self.rods[i], &self.rods[j]) >= here {
                        continue;
                    }
                    let drawn = [i, j].map(|k| bodies[k].drawn_out(&kinematics));
                    let at = |k: usize, body: &Body| match drawn[k] {
                        Some(_) => super::narrow::Placement::world(),
                        None => body.placement(&kinematics),
                    };
                    let first = (drawn[0].as_ref().unwrap_or(&bodies[i].solid), &at(0, &bodies[i]));
                    let second = (drawn[1].as_ref().unwrap_or(&bodies[j].solid), &at(1, &bodies[j]));
                    // Touching counts as well: contact at 0 is contact.
                    if let Some(gap) = gap(first, second, here.max(f64::MIN_POSITIVE), &mut self.memory) {
                        here = here.min(gap.distance);
                    }
                }
            }
            if here < 0.0 {
                *touched += 1;
            }
            *least = least.min(here);
        }
    }

    /// Looks at seeded configurations; returns how many.
    fn sample(&mut self, count: usize, go_on: &mut dyn FnMut(f64) -> bool) -> usize {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let chain = self.chain;
        let mut q = vec![0.0; chain.dof()];
        for k in 0..count {
            if k % BLOCK == 0 && !go_on(k as f64 / count as f64) {
                return k;
            }
            for ((q, lower), upper) in q.iter_mut().zip(chain.lower()).zip(chain.upper()) {
                let (low, high) = range(*lower, *upper);
                *q = low + (high - low) * rng.random::<f64>();
            }
            self.look(&q);
        }
        count
    }
}

/// The part of a joint's range that is sampled: half a turn (or a metre for want of another number) to either side of 0 or of
/// the one limit that there is.
fn range(lower: f64, upper: f64) -> (f64, f64) {
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => (lower, upper),
        (true, false) => (lower, lower + TURN),
        (false, true) => (upper - TURN, upper),
        (false, false) => (-PI, PI),
    }
}

/// Pairs of the links of a URDF.
pub(crate) fn find(chain: &Chain, links: &Links<'_>, go_on: &mut dyn FnMut(f64) -> bool) -> Found {
    let mut found = Found::default();
    let (adjacent, others): (Vec<_>, Vec<_>) = links.moving().partition(|pair| links.adjacent(*pair));
    found.left_out.extend(adjacent.into_iter().map(|pair| (pair, Reason::Adjacent)));
    let mut sampler = Sampler::new(chain, links, others.into_iter());
    let wanted = SAMPLES.min(MAX_WORK / sampler.pairs.len().max(1)).max(CAPSULE_SAMPLES);
    let count = sampler.sample(wanted, go_on);
    for (pair, least, touched) in sampler.pairs {
        if count > 0 && touched as f64 > PAIRS_ALWAYS * count as f64 {
            found.left_out.push((pair, Reason::Always));
        } else if count == wanted && least > PAIRS_NEVER {
            found.left_out.push((pair, Reason::Never));
        } else {
            found.kept.push(pair);
        }
    }
    found
}

/// Pairs of joint-to-joint capsules.
pub(crate) fn find_of_capsules(chain: &Chain, links: &Links<'_>) -> Found {
    let mut found = Found::default();
    let (adjacent, others): (Vec<_>, Vec<_>) = links.moving().partition(|pair| links.adjacent(*pair));
    found.left_out.extend(adjacent.into_iter().map(|pair| (pair, Reason::Adjacent)));
    let mut sampler = Sampler::new(chain, links, others.into_iter());
    let middle: Vec<f64> = chain
        .lower()
        .iter()
        .zip(chain.upper())
        .map(|(lower, upper)| {
            let (low, high) = range(*lower, *upper);
            0.5 * (low + high)
        })
        .collect();
    sampler.look(&middle);
    let touching: Vec<_> = sampler.pairs.extract_if(.., |(_, least, _)| *least <= 0.0).collect();
    found.left_out.extend(touching.into_iter().map(|(pair, ..)| (pair, Reason::Default)));
    sampler.sample(CAPSULE_SAMPLES, &mut |_| true);
    for (pair, _, touched) in sampler.pairs {
        if touched as f64 > PAIRS_ALWAYS * CAPSULE_SAMPLES as f64 {
            found.left_out.push((pair, Reason::Always));
        } else {
            found.kept.push(pair);
        }
    }
    found
}

/// An SRDF file that disables what is left out, and all pairs of links that stand still against each other.
pub(crate) fn to_srdf(robot: &str, links: &Links<'_>, left_out: &[([usize; 2], Reason)]) -> String {
    let quoted = |text: &str| {
        text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
    };
    let mut out = format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<robot name=\"{}\">\n", quoted(robot));
    let mut line = |[a, b]: [usize; 2], reason: Reason| {
        let [a, b] = [a, b].map(|i| quoted(&links.names[i]));
        let reason = reason.as_str();
        let _ = writeln!(out, "  <disable_collisions link1=\"{a}\" link2=\"{b}\" reason=\"{reason}\"/>");
    };
    let n = links.names.len();
    for a in 0..n {
        for b in a + 1..n {
            if links.groups[a] == links.groups[b] {
                let adjacent = links.neighbours.binary_search(&[a, b]).is_ok();
                line([a, b], if adjacent { Reason::Adjacent } else { Reason::Never });
            }
        }
    }
    left_out.iter().for_each(|(pair, reason)| line(*pair, *reason));
    out.push_str("</robot>\n");
    out
}
