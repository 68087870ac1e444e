//! How near an arm is to the obstacles of a scene: the nearest pair, and the nearest of each link.

use nalgebra::Vector3;

use super::geometry::LinkGeometry;
use super::proximity::{Contact, Proximity, ProximityMemory, Thing, Visitor};
use super::scene::Scene;
use super::surroundings::Surroundings;
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::kinematics::{Kinematics, Scratch};
use crate::parallel::prelude::*;

/// Configurations that one task of the pool takes at least.
const ROWS_PER_TASK: usize = 32;

/// The nearest pair of a link, with what it carries, and an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestPair {
    /// Signed distance, m: negative in a collision.
    pub distance: f64,
    /// Index of the link in [`Surroundings::link_names`].
    pub link: usize,
    /// Index of the obstacle in the scene.
    pub obstacle: usize,
    /// The nearest point of the link's surface.
    pub on_link: Vector3<f64>,
    /// The nearest point of the obstacle's surface.
    pub on_obstacle: Vector3<f64>,
    /// Unit vector from the obstacle to the link.
    pub normal: Vector3<f64>,
}

/// The nearest pair of each link, in the order of [`Surroundings::link_names`]; none for links without shape.
pub type ByLink = Vec<Option<NearestPair>>;

impl Surroundings {
    /// The nearest obstacle of each link where the kinematics are known, at time `t`. Links against links do not count.
    pub fn by_link(&self, kinematics: &Kinematics<'_>, t: f64, memory: &mut ProximityMemory) -> ByLink {
        let mut nearest = NearestOfLinks { around: self, best: vec![None; self.link_names().len()] };
        self.scan(kinematics, t, memory, &mut nearest);
        nearest.best
    }

    /// Link and obstacle of a pair; `None` for two links.
    fn link_and_obstacle(&self, first: Thing, second: Thing) -> Option<(usize, usize)> {
        match (first, second) {
            (Thing::Link(link), Thing::Obstacle(obstacle))
            | (Thing::Obstacle(obstacle), Thing::Link(link)) => Some((link, obstacle)),
            (Thing::Obstacle(carried), Thing::Obstacle(obstacle)) => Some((self.carrier(carried)?, obstacle)),
            (Thing::Link(_), Thing::Link(_)) => None,
        }
    }
}

/// How near the links of an arm are to each other.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfClearance {
    /// The least signed distance, m; the cutoff where all pairs are at least so far apart.
    pub distance: f64,
    /// The two links, as indices in [`LinkGeometry::names`]; none beyond the cutoff.
    pub links: Option<[usize; 2]>,
    /// Its derivative by the joints (n); zero beyond the cutoff.
    pub gradient: Vec<f64>,
}

struct NearestSelf<'a, 'k> {
    kinematics: &'a Kinematics<'k>,
    nearest: SelfClearance,
}

impl Visitor for NearestSelf<'_, '_> {
    fn limit(&self, _: Thing, _: Thing) -> f64 {
        self.nearest.distance
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let (Thing::Link(a), Thing::Link(b)) = (contact.first, contact.second) else { return true };
        self.nearest.distance = contact.gap.distance;
        self.nearest.links = Some([a, b]);
        self.nearest.gradient.fill(0.0);
        contact.add_gradient(self.kinematics, 1.0, &mut self.nearest.gradient);
        true
    }
}

impl LinkGeometry {
    /// How near links come to each other in each of `N` configurations (`N * dof` numbers): the pairs of the geometry, up to
    /// `cutoff` (m; infinite for all).
    ///
    /// # Errors
    /// A length of `q` that does not fit, an entry that is not finite, a cutoff that is NaN.
    pub fn self_clearance(&self, chain: &Chain, q: &[f64], cutoff: f64) -> Result<Vec<SelfClearance>> {
        if cutoff.is_nan() {
            return Err(Error::NotFinite { what: "cutoff".into(), index: 0, value: cutoff });
        }
        let around = Surroundings::new(chain, self, None, true)?;
        let n = rows_of(chain, q)?;
        let one = |(scratch, memory): &mut (Scratch, ProximityMemory), q: &[f64]| {
            let kinematics = chain.kinematics_unchecked(q, scratch);
            let nearest = SelfClearance { distance: cutoff, links: None, gradient: vec![0.0; n] };
            let mut least = NearestSelf { kinematics: &kinematics, nearest };
            around.scan(&kinematics, 0.0, memory, &mut least);
            least.nearest
        };
        let rows = q.par_chunks_exact(n).with_min_len(ROWS_PER_TASK);
        Ok(rows.map_init(|| (Scratch::new(chain), ProximityMemory::new()), one).collect())
    }
}

/// A pair of links and how near they are.
#[derive(Debug, Clone, PartialEq)]
pub struct PairClearance {
    /// The two links, as indices in [`LinkGeometry::names`].
    pub links: [usize; 2],
    /// Signed distance of the nearest of their shapes, m.
    pub distance: f64,
    /// Its derivative by the joints (n).
    pub gradient: Vec<f64>,
}

struct NearPairs<'a, 'k> {
    kinematics: &'a Kinematics<'k>,
    cutoff: f64,
    pairs: Vec<PairClearance>,
}

impl Visitor for NearPairs<'_, '_> {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        // Shapes of the same pair follow each other.
        let last = self.pairs.last().filter(|last| same(last, first, second));
        last.map_or(self.cutoff, |last| last.distance)
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let (Thing::Link(a), Thing::Link(b)) = (contact.first, contact.second) else { return true };
        if !self.pairs.last().is_some_and(|last| same(last, contact.first, contact.second)) {
            let gradient = vec![0.0; self.kinematics.origins().len()];
            self.pairs.push(PairClearance { links: [a, b], distance: self.cutoff, gradient });
        }
        if let Some(pair) = self.pairs.last_mut() {
            pair.links = [a, b];
            pair.distance = contact.gap.distance;
            pair.gradient.fill(0.0);
            contact.add_gradient(self.kinematics, 1.0, &mut pair.gradient);
        }
        true
    }
}

fn same(pair: &PairClearance, first: Thing, second: Thing) -> bool {
    let [a, b] = pair.links.map(Thing::Link);
    (a, b) == (first, second) || (b, a) == (first, second)
}

impl LinkGeometry {
    /// All pairs of links that are nearer than `cutoff` (m), in each of `N` configurations (`N * dof` numbers).
    ///
    /// # Errors
    /// As of [`LinkGeometry::self_clearance`].
    pub fn pair_clearances(&self, chain: &Chain, q: &[f64], cutoff: f64) -> Result<Vec<Vec<PairClearance>>> {
        if cutoff.is_nan() {
            return Err(Error::NotFinite { what: "cutoff".into(), index: 0, value: cutoff });
        }
        let around = Surroundings::new(chain, self, None, true)?;
        let n = rows_of(chain, q)?;
        let one = |(scratch, memory): &mut (Scratch, ProximityMemory), q: &[f64]| {
            let kinematics = chain.kinematics_unchecked(q, scratch);
            let mut near = NearPairs { kinematics: &kinematics, cutoff, pairs: Vec::new() };
            around.scan(&kinematics, 0.0, memory, &mut near);
            near.pairs
        };
        let rows = q.par_chunks_exact(n).with_min_len(ROWS_PER_TASK);
        Ok(rows.map_init(|| (Scratch::new(chain), ProximityMemory::new()), one).collect())
    }
}

/// Checks rows of joint positions; how long each is.
fn rows_of(chain: &Chain, q: &[f64]) -> Result<usize> {
    let n = chain.dof();
    if n == 0 || !q.len().is_multiple_of(n) {
        let expected = q.len().next_multiple_of(n.max(1));
        return Err(Error::Length { what: "q".into(), expected, actual: q.len() });
    }
    check_finite("q", q)?;
    Ok(n)
}

struct NearestOfLinks<'a> {
    around: &'a Surroundings,
    best: ByLink,
}

impl Visitor for NearestOfLinks<'_> {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        let pair = self.around.link_and_obstacle(first, second);
        let best = |link: usize| self.best[link].as_ref().map_or(f64::INFINITY, |pair| pair.distance);
        pair.map_or(f64::NEG_INFINITY, |(link, _)| best(link))
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        if let Some((link, obstacle)) = self.around.link_and_obstacle(contact.first, contact.second) {
            let gap = &contact.gap;
            // The link comes first, unless it is beside what another link carries.
            let turned = matches!(contact.second, Thing::Link(_));
            let (on_link, on_obstacle, normal) = if turned {
                (gap.on_second, gap.on_first, -gap.normal)
            } else {
                (gap.on_first, gap.on_second, gap.normal)
            };
            self.best[link] =
                Some(NearestPair { distance: gap.distance, link, obstacle, on_link, on_obstacle, normal });
        }
        true
    }
}

/// The least of each link's.
fn least(by_link: &[Option<NearestPair>]) -> Option<NearestPair> {
    by_link.iter().flatten().min_by(|a, b| a.distance.total_cmp(&b.distance)).copied()
}

impl Scene {
    /// The nearest pair at `q` with links as capsules from joint to joint; `None` for a scene without obstacles.
    ///
    /// # Errors
    /// Wrong length of `q`, an entry that is not finite, a radius that is negative; a name in the scene that is not known.
    pub fn clearance(&self, chain: &Chain, q: &[f64], link_radius: f64) -> Result<Option<NearestPair>> {
        let geometry = LinkGeometry::joint_to_joint(chain, link_radius)?;
        let around = Surroundings::new(chain, &geometry, Some(self), false)?;
        let mut scratch = Scratch::new(chain);
        let kinematics = chain.kinematics(q, &mut scratch)?;
        Ok(least(&around.by_link(&kinematics, 0.0, &mut ProximityMemory::new())))
    }

    /// The nearest pair of each link, of each of `N` configurations (`N * dof` numbers).
    ///
    /// # Errors
    /// A length of `q` that does not fit, an entry that is not finite.
    pub fn clearance_batch(chain: &Chain, q: &[f64], around: &Surroundings) -> Result<Vec<ByLink>> {
        let n = rows_of(chain, q)?;
        let rows = q.par_chunks_exact(n).with_min_len(ROWS_PER_TASK);
        let one = |(scratch, memory): &mut (Scratch, ProximityMemory), q: &[f64]| {
            around.by_link(&chain.kinematics_unchecked(q, scratch), 0.0, memory)
        };
        Ok(rows.map_init(|| (Scratch::new(chain), ProximityMemory::new()), one).collect())
    }
}
