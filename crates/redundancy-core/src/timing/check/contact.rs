//! Whether the arm touches something on the way: at the rows, and between them wherever a joint moves far.

use super::finding::FindingKind;
use super::settings::{CheckAgainst, CheckSettings};
use super::spots::{Owner, Spot};
use crate::chain::Chain;
use crate::error::Result;
use crate::path::Trajectory;
use crate::scene::{LinkGeometry, NearestPair, Scene, Surroundings};
use crate::tolerance::{CHECK_CONTACT_STEP, CHECK_LINK_RADIUS};

/// Most places of one interval.
const MOST_PLACES: usize = 1_000;

/// Contact with the obstacles of the scene.
pub(super) fn collisions(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    against: CheckAgainst<'_>,
) -> Result<Vec<Spot>> {
    let mut out = self_collisions(chain, trajectory, against)?;
    let Some(scene) = against.scene else { return Ok(out) };
    let capsules;
    let links = match against.links {
        Some(links) => links,
        None => {
            capsules = LinkGeometry::joint_to_joint(chain, CHECK_LINK_RADIUS)?;
            &capsules
        }
    };
    let places = places(trajectory);
    let q = configurations(trajectory, &places)?;
    let mut look = |scene: &Scene, range: std::ops::Range<usize>| -> Result<()> {
        let block = &q[range.start * chain.dof()..range.end * chain.dof()];
        let around = Surroundings::new(chain, links, Some(scene), false)?;
        let nearest = Scene::clearance_batch(chain, block, &around)?;
        let by_distance = |a: &NearestPair, b: &NearestPair| a.distance.total_cmp(&b.distance);
        for (by_link, (cell, t)) in nearest.into_iter().zip(&places[range]) {
            let near = by_link.into_iter().flatten().min_by(by_distance);
            let Some(near) = near.filter(|near| near.distance < settings.clearance) else { continue };
            let name = around.link_names().get(near.link).map_or("", String::as_str);
            let row = nearest_row(trajectory, *cell, *t);
            let (value, bound) = (near.distance, settings.clearance);
            // Shapes of links outside of the chain (fingers) are named in the message alone.
            let link = chain.links().iter().position(|link| link.name == name);
            let kind = FindingKind::Collision;
            let owner = Owner { kind, joint: None, link, part: near.obstacle };
            let message = format!(
                "link '{name}' is {value:.6} m from obstacle {} ({}), at least {bound:.6} m is wanted, at {t:.6} s",
                near.obstacle,
                scene.obstacles()[near.obstacle].shape.as_str()
            );
            let (cell, t, weight, message) = (*cell, *t, -value, Some(message));
            out.push(Spot { owner, cell, row, t, value, bound, weight, message });
        }
        Ok(())
    };
    if scene.moves() {
        for (k, (_, t)) in places.iter().enumerate() {
            look(&scene.at(*t), k..k + 1)?;
        }
    } else {
        look(scene, 0..places.len())?;
    }
    Ok(out)
}

/// Contact of links with each other: the pairs of the links that are given.
fn self_collisions(chain: &Chain, trajectory: &Trajectory, against: CheckAgainst<'_>) -> Result<Vec<Spot>> {
    let Some(links) = against.links.filter(|links| !links.pairs().is_empty()) else { return Ok(Vec::new()) };
    let places = places(trajectory);
    let nearest = links.self_clearance(chain, &configurations(trajectory, &places)?, 0.0)?;
    let mut out = Vec::new();
    for (near, (cell, t)) in nearest.into_iter().zip(&places) {
        let Some([first, second]) = near.links else { continue };
        let [a, b] = [first, second].map(|link| links.names()[link].as_str());
        let (value, cell, t) = (near.distance, *cell, *t);
        let message = format!("links '{a}' and '{b}' overlap by {:.6} m, at {t:.6} s", -value);
        let link = chain.links().iter().position(|link| link.name == a);
        let part = first * links.names().len() + second;
        let owner = Owner { kind: FindingKind::SelfCollision, joint: None, link, part };
        let (row, weight, message) = (nearest_row(trajectory, cell, t), -value, Some(message));
        out.push(Spot { owner, cell, row, t, value, bound: 0.0, weight, message });
    }
    Ok(out)
}

/// Positions at these places, one after the other.
fn configurations(trajectory: &Trajectory, places: &[(usize, f64)]) -> Result<Vec<f64>> {
    let mut q = Vec::with_capacity(places.len() * trajectory.dof());
    let mut state: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; trajectory.dof()]);
    for (interval, t) in places {
        trajectory.sample_interval(*interval, *t, state.each_mut().map(Vec::as_mut_slice))?;
        q.extend_from_slice(&state[0]);
    }
    Ok(q)
}

/// The row nearest to a time in interval `cell`.
fn nearest_row(trajectory: &Trajectory, cell: usize, t: f64) -> usize {
    let end = trajectory.t()[(cell + 1).min(trajectory.rows() - 1)];
    if t - trajectory.t()[cell] > end - t { cell + 1 } else { cell }
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
