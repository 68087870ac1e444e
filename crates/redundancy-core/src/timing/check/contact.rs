//! Whether the arm touches an obstacle or itself on the way: at the rows, and between them wherever a joint moves far.

use super::finding::FindingKind;
use super::settings::{CheckAgainst, CheckSettings};
use super::spots::{Owner, Spot};
use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::Scratch;
use crate::path::Trajectory;
use crate::scene::{LinkGeometry, NearestPair, Proximity, ProximityMemory, Scene, Surroundings, Thing};
use crate::tolerance::{CHECK_CONTACT_STEP, CHECK_LINK_RADIUS};

/// Most places of one interval.
const MOST_PLACES: usize = 1_000;

/// Contact with the obstacles of the scene, and of links that must not touch each other.
pub(super) fn collisions(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    against: CheckAgainst<'_>,
) -> Result<Vec<Spot>> {
    let paired = against.links.is_some_and(|links| !links.pairs().is_empty());
    if against.scene.is_none() && !paired {
        return Ok(Vec::new());
    }
    let capsules;
    let links = match against.links {
        Some(links) => links,
        None => {
            capsules = LinkGeometry::joint_to_joint(chain, CHECK_LINK_RADIUS)?;
            &capsules
        }
    };
    let places = places(trajectory);
    let mut q = Vec::with_capacity(places.len() * chain.dof());
    let mut state: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; chain.dof()]);
    for (interval, t) in &places {
        trajectory.sample_interval(*interval, *t, state.each_mut().map(Vec::as_mut_slice))?;
        q.extend_from_slice(&state[0]);
    }
    let arm = Places { chain, trajectory, links, places: &places, q: &q };
    let mut out = match against.scene {
        Some(scene) => arm.with_obstacles(scene, settings)?,
        None => Vec::new(),
    };
    if paired {
        arm.with_itself(against.scene, &mut out)?;
    }
    Ok(out)
}

/// The arm at the places that are checked.
struct Places<'a> {
    chain: &'a Chain,
    trajectory: &'a Trajectory,
    links: &'a LinkGeometry,
    /// Interval and time.
    places: &'a [(usize, f64)],
    /// Joint positions, row by row.
    q: &'a [f64],
}

impl Places<'_> {
    /// The row nearest to a place.
    fn row(&self, (cell, t): (usize, f64)) -> usize {
        let times = self.trajectory.t();
        let end = times[(cell + 1).min(times.len() - 1)];
        if t - times[cell] > end - t { cell + 1 } else { cell }
    }

    /// The index of a link in the chain. Links outside of the chain (fingers) are named in the message alone.
    fn link(&self, name: &str) -> Option<usize> {
        self.chain.links().iter().position(|link| link.name == name)
    }

    fn with_obstacles(&self, scene: &Scene, settings: &CheckSettings) -> Result<Vec<Spot>> {
        let mut out = Vec::new();
        let mut look = |scene: &Scene, range: std::ops::Range<usize>| -> Result<()> {
            let block = &self.q[range.start * self.chain.dof()..range.end * self.chain.dof()];
            let around = Surroundings::new(self.chain, self.links, Some(scene), false)?;
            let nearest = Scene::clearance_batch(self.chain, block, &around)?;
            let by_distance = |a: &NearestPair, b: &NearestPair| a.distance.total_cmp(&b.distance);
            for (by_link, place) in nearest.into_iter().zip(&self.places[range]) {
                let near = by_link.into_iter().flatten().min_by(by_distance);
                let Some(near) = near.filter(|near| near.distance < settings.clearance) else { continue };
                let name = around.link_names().get(near.link).map_or("", String::as_str);
                let (value, bound) = (near.distance, settings.clearance);
                let kind = FindingKind::Collision;
                let owner = Owner { kind, joint: None, link: self.link(name), part: near.obstacle };
                let (row, (cell, t)) = (self.row(*place), *place);
                let message = format!(
                    "link '{name}' is {value:.6} m from obstacle {} ({}), at least {bound:.6} m is wanted, at {t:.6} s",
                    near.obstacle,
                    scene.obstacles()[near.obstacle].shape.as_str()
                );
                let message = Some(message);
                out.push(Spot { owner, cell, row, t, value, bound, weight: -value, message });
            }
            Ok(())
        };
        if scene.moves() {
            for (k, (_, t)) in self.places.iter().enumerate() {
                look(&scene.at(*t), k..k + 1)?;
            }
        } else {
            look(scene, 0..self.places.len())?;
        }
        Ok(out)
    }

    /// Contact of links that must not touch each other; a scene may allow it.
    fn with_itself(&self, scene: Option<&Scene>, out: &mut Vec<Spot>) -> Result<()> {
        let links_only = |a: Thing, b: Thing| matches!((a, b), (Thing::Link(_), Thing::Link(_)));
        let around = Surroundings::new(self.chain, self.links, scene, true)?.filtered(links_only);
        let (mut scratch, mut memory) = (Scratch::new(self.chain), ProximityMemory::new());
        for (q, place) in self.q.chunks_exact(self.chain.dof()).zip(self.places) {
            let kinematics = self.chain.kinematics_unchecked(q, &mut scratch);
            let Some(near) = around.nearest(&kinematics, 0.0, 0.0, &mut memory) else { continue };
            let names = [near.first, near.second].map(|thing| around.name(thing));
            let (Thing::Link(first), Thing::Link(second)) = (near.first, near.second) else { continue };
            let value = near.gap.distance;
            let kind = FindingKind::SelfCollision;
            let part = first * around.links() + second;
            let owner = Owner { kind, joint: None, link: self.link(&names[0]), part };
            let (row, (cell, t)) = (self.row(*place), *place);
            let message =
                format!("links '{}' and '{}' overlap by {:.6} m at {t:.6} s", names[0], names[1], -value);
            let message = Some(message);
            out.push(Spot { owner, cell, row, t, value, bound: 0.0, weight: -value, message });
        }
        Ok(())
    }
}

/// Intervals and times at which the arm is checked: every row, and between rows so that no joint moves by more than
/// [`CHECK_CONTACT_STEP`] in between.
fn places(trajectory: &Trajectory) -> Vec<(usize, f64)> {
    let (n, t, q) = (trajectory.dof(), trajectory.t(), trajectory.q());
    let rows = trajectory.rows();
    let mut out = Vec::with_capacity(rows);
    for k in 0..rows.saturating_sub(1) {
        let step = (0..n).map(|j| (q[(k + 1) * n + j] - q[k * n + j]).abs()).fold(0.0, f64::max);
        let parts = ((step / CHECK_CONTACT_STEP).ceil() as usize).clamp(1, MOST_PLACES);
        out.extend((0..parts).map(|i| (k, t[k] + (t[k + 1] - t[k]) * i as f64 / parts as f64)));
    }
    if rows > 0 {
        out.push((rows.saturating_sub(2), t[rows - 1]));
    }
    out
}
