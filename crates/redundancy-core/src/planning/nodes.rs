//! States over some points of a path, sampled evenly in joint space.
//!
//! Random postures are pulled onto the task at a few points and carried along the path by shortest steps, in both
//! directions, until they leave their limits. A grid over the spare coordinates would miss the best lines where a
//! coordinate is a poor one (a spin where the wrist is nearly straight); joint space is what the cost is made of.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::demand::Demand;
use super::pull::{Pull, Puller, wind_into};
use super::push::Pusher;
use super::tool::MOST_BOUNDS;
use crate::joint_space::{TURN, windings};
use crate::kinematics::rotation_vector;
use crate::parallel::prelude::*;
use crate::solutions::{Solutions, SolutionsSettings, solutions};
use crate::tolerance::EDGE_ROUNDING;
use crate::watch::Watch;

/// States over some rows of a problem.
#[derive(Debug, Clone)]
pub(super) struct Nodes {
    /// The rows.
    pub rows: Vec<usize>,
    /// States of each, one after the other.
    pub q: Vec<Vec<f64>>,
    /// Joints whose windings are states of their own.
    pub wound: Vec<usize>,
    /// Rows between neighbouring layers at which carried states stop.
    stops: Vec<Vec<usize>>,
}

impl Nodes {
    /// About `count` states over each of `rows`. With at most one spare coordinate all but the first `look` take them from the
    /// solutions themselves, so that no arc is too narrow to be seen.
    pub fn over(demand: &Demand, rows: Vec<usize>, count: usize, look: usize, watch: &Watch) -> Self {
        if look > 0
            && let Some(q) = exact(demand, &rows, NODE_SPACING / look as f64, watch)
        {
            return Self { wound: Vec::new(), stops: Vec::new(), rows, q }.that_fit(demand.dof(), 1.0);
        }
        let most = (MOST_STEPS / rows.len() as f64).sqrt() as usize;
        Self::sample(demand, rows, count.min(most), look, watch).that_fit(demand.dof(), 1.0)
    }

    /// As many of the states, evenly over each layer, as the graph has memory for when each of them becomes `growth` ones.
    fn that_fit(mut self, n: usize, growth: f64) -> Self {
        let width = |layer: &Vec<f64>| growth * (layer.len() / n) as f64;
        let steps: f64 = self.q.windows(2).map(|pair| width(&pair[0]) * width(&pair[1])).sum();
        if steps <= MOST_STEPS {
            return self;
        }
        let share = (MOST_STEPS / steps).sqrt();
        for layer in &mut self.q {
            let count = layer.len() / n;
            let kept = ((share * count as f64) as usize).clamp(1, count.max(1)).min(count);
            *layer = (0..kept)
                .flat_map(|k| {
                    let state = (2 * k + 1) * count / (2 * kept);
                    layer[state * n..(state + 1) * n].to_vec()
                })
                .collect();
        }
        self
    }

    fn sample(demand: &Demand, rows: Vec<usize>, count: usize, look: usize, watch: &Watch) -> Self {
        let layers = rows.len();
        let mut nodes =
            Self { wound: Vec::new(), stops: stops(demand, &rows), q: vec![Vec::new(); layers], rows };
        let seeds = SEED_LAYERS.min(layers);
        let each = count.div_ceil(seeds);
        let work: Vec<(usize, usize)> = (0..seeds)
            .flat_map(|s| {
                let layer = if seeds > 1 { s * (layers - 1) / (seeds - 1) } else { 0 };
                (0..each).map(move |i| (layer, look * LOOK_NUMBERS + i))
            })
            .collect();
        nodes.grow(demand, &work, watch);
        // Layers that lines do not reach get states of their own.
        for round in 1..=REFILLS {
            let work: Vec<(usize, usize)> = (0..layers)
                .filter(|layer| nodes.q[*layer].len() < demand.dof() * count / 2)
                .flat_map(|layer| (0..each).map(move |i| (layer, look * LOOK_NUMBERS + round * each + i)))
                .collect();
            if work.is_empty() {
                break;
            }
            nodes.grow(demand, &work, watch);
        }
        nodes.keep_given(demand);
        nodes.merge_equal(demand);
        nodes
    }

    /// The same with the windings of a joint within its limits as states of their own.
    pub fn with_windings(self, demand: &Demand, joint: usize) -> Self {
        let n = demand.dof();
        let turns = ((demand.upper[joint] - demand.lower[joint]) / TURN).ceil();
        let mut out = self.that_fit(n, turns);
        for (layer, q) in out.q.iter_mut().enumerate() {
            if demand.given(out.rows[layer]).is_some() {
                continue;
            }
            let mut all = Vec::with_capacity(2 * q.len());
            for state in q.chunks_exact(n) {
                for winding in windings(state[joint], demand.lower[joint], demand.upper[joint]) {
                    let first = all.len();
                    all.extend_from_slice(state);
                    all[first + joint] = winding;
                }
            }
            *q = all;
        }
        out.wound.push(joint);
        out
    }

    /// States over a layer, on average.
    pub fn width(&self, n: usize) -> usize {
        self.q.iter().map(|q| q.len() / n).sum::<usize>().div_ceil(self.q.len().max(1))
    }

    /// Where a configuration is given there is no other one, and lines start from it.
    fn keep_given(&mut self, demand: &Demand) {
        for (layer, row) in self.rows.clone().into_iter().enumerate() {
            let Some(given) = demand.given(row) else { continue };
            let lines = self.carried(demand, &mut Puller::new(demand), layer, given.to_vec());
            for (layer, q) in lines {
                self.q[layer].extend(q);
            }
            self.q[layer] = given.to_vec();
        }
    }

    /// Isolated solutions are found many times; one state each is enough.
    fn merge_equal(&mut self, demand: &Demand) {
        if demand.spare() > 0 {
            return;
        }
        let n = demand.dof();
        for q in &mut self.q {
            let mut kept: Vec<f64> = Vec::new();
            for q in q.chunks_exact(n) {
                let near = |other: &[f64]| q.iter().zip(other).all(|(a, b)| (a - b).abs() < EQUAL_STATES);
                if !kept.chunks_exact(n).any(near) {
                    kept.extend_from_slice(q);
                }
            }
            *q = kept;
        }
    }

    /// Random postures at (layer, number), carried both ways.
    fn grow(&mut self, demand: &Demand, work: &[(usize, usize)], watch: &Watch) {
        let lines: Vec<Vec<(usize, Vec<f64>)>> = work
            .par_iter()
            .map_init(
                || Puller::new(demand),
                |puller, (layer, number)| match watch.interrupted() {
                    Some(_) => Vec::new(),
                    None => self.line(demand, puller, *layer, *number),
                },
            )
            .collect();
        for (layer, q) in lines.into_iter().flatten() {
            self.q[layer].extend(q);
        }
    }

    fn line(
        &self,
        demand: &Demand,
        puller: &mut Puller<'_>,
        layer: usize,
        number: usize,
    ) -> Vec<(usize, Vec<f64>)> {
        let seed = demand.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ ((layer as u64) << 32) ^ number as u64;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let target = &demand.targets[self.rows[layer]];
        let found = (0..ATTEMPTS).find_map(|_| {
            let mut q = posture(demand, &mut rng);
            let pull =
                Pull { tilt: rng.random::<f64>().sqrt(), spin: 2.0 * rng.random::<f64>() - 1.0, ..Pull::FAR };
            puller.pull_far(&mut q, target, &pull).then_some(q)
        });
        let mut line = found.map_or_else(Vec::new, |q| self.carried(demand, puller, layer, q));
        let mut pusher = None;
        line.retain_mut(|(layer, q)| {
            clear_or_pushed(demand, self.rows[*layer], q, number >= LOOK_NUMBERS, &mut pusher)
        });
        line
    }

    /// A state and what it becomes over the other layers, as far as it can be carried.
    fn carried(
        &self,
        demand: &Demand,
        puller: &mut Puller<'_>,
        layer: usize,
        q: Vec<f64>,
    ) -> Vec<(usize, Vec<f64>)> {
        let mut out = Vec::new();
        let carry = |puller: &mut Puller<'_>, q: &mut Vec<f64>, from: usize, to: usize| -> bool {
            let stops = &self.stops[from.min(to)];
            let count = stops.len();
            (1..=count).all(|i| {
                let row = if to > from {
                    if i == count { self.rows[to] } else { stops[i] }
                } else {
                    stops[count - i]
                };
                puller.pull(q, &demand.targets[row], &Pull::NEAR)
            })
        };
        let (mut forward, mut backward) = (q.clone(), q.clone());
        out.push((layer, q));
        for next in layer + 1..self.rows.len() {
            if !carry(puller, &mut forward, next - 1, next) {
                break;
            }
            out.push((next, forward.clone()));
        }
        for next in (0..layer).rev() {
            if !carry(puller, &mut backward, next + 1, next) {
                break;
            }
            out.push((next, backward.clone()));
        }
        out
    }
}

/// Whether a state touches nothing, after it was pushed out of contact where `push` asks for it.
fn clear_or_pushed<'a>(
    demand: &'a Demand,
    row: usize,
    q: &mut [f64],
    push: bool,
    pusher: &mut Option<Pusher<'a>>,
) -> bool {
    demand.is_clear(row, q) || (push && pusher.get_or_insert_with(|| Pusher::new(demand)).push(row, q))
}

/// The states of the solutions themselves: points, or curves cut by the limits at even distances. `None` where they have
/// more dimensions.
fn exact(demand: &Demand, rows: &[usize], spacing: f64, watch: &Watch) -> Option<Vec<Vec<f64>>> {
    let task = demand.tool.named().filter(|_| demand.spare() <= 1)?;
    rows.par_iter()
        .map(|row| {
            let settings = SolutionsSettings { task, seed: demand.seed, ..SolutionsSettings::default() };
            let all = solutions(&demand.chain, &demand.targets[*row].pose, &settings).ok()?;
            let states = states_of(demand, *row, all.as_ref(), spacing)?;
            let (mut out, mut pusher) = (Vec::with_capacity(states.len()), None);
            for q in states.chunks_exact(demand.dof()) {
                if watch.interrupted().is_some() {
                    return Some(Vec::new());
                }
                let mut q = q.to_vec();
                let given = demand.given(*row).is_some();
                if given || clear_or_pushed(demand, *row, &mut q, true, &mut pusher) {
                    out.extend(q);
                }
            }
            Some(out)
        })
        .collect()
}

/// States on all pieces over a row.
pub(super) fn states_of(demand: &Demand, row: usize, all: &dyn Solutions, spacing: f64) -> Option<Vec<f64>> {
    arcs_of(demand, row, all, spacing).map(|arcs| arcs.concat())
}

/// The same, arc by arc: those that the limits leave of each piece.
pub(super) fn arcs_of(
    demand: &Demand,
    row: usize,
    all: &dyn Solutions,
    spacing: f64,
) -> Option<Vec<Vec<f64>>> {
    let n = demand.dof();
    if let Some(given) = demand.given(row) {
        return Some(vec![given.to_vec()]);
    }
    let margin = demand.margin;
    let (mut arcs, mut q, mut tangent) = (Vec::new(), vec![0.0; n], vec![0.0; n]);
    let mut h = [0.0; MOST_BOUNDS];
    for piece in 0..all.pieces() {
        for [low, high] in all.intervals(piece, margin).ok()? {
            let (mut u, mut out) = (low, Vec::new());
            loop {
                all.q(piece, u, &mut q).ok()?;
                wind_into(&mut q, demand);
                let bounds = demand.tool.bounds();
                let inside = bounds == 0 || {
                    let pose = demand.chain.forward_unchecked(&q);
                    demand.tool.bound_values(&pose, &demand.targets[row], &mut h);
                    h[..bounds].iter().all(|h| *h >= 0.0)
                };
                if inside && demand.chain.within_limits(&q, EDGE_ROUNDING) {
                    out.extend_from_slice(&q);
                }
                if u >= high {
                    break;
                }
                all.tangent(piece, u, &mut tangent).ok()?;
                let speed = tangent.iter().map(|t| t * t).sum::<f64>().sqrt();
                u = (u + spacing / speed.max(f64::MIN_POSITIVE)).min(high);
            }
            arcs.push(out);
        }
    }
    Some(arcs)
}

/// A random posture within limits; within half a turn or a metre of the middle where there are none.
pub(super) fn posture(demand: &Demand, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let n = demand.dof();
    (0..n)
        .map(|i| {
            let [middle, half] = demand.range[i];
            let free = if demand.chain.steps()[i].rotational { std::f64::consts::PI } else { 1.0 };
            let half = if half > 0.0 { half.min(free) } else { free };
            middle + half * (2.0 * rng.random::<f64>() - 1.0)
        })
        .collect()
}

/// Rows between neighbouring layers, the first one included, so that the tool moves little from one to the next.
fn stops(demand: &Demand, rows: &[usize]) -> Vec<Vec<usize>> {
    rows.windows(2)
        .map(|pair| {
            let mut out = vec![pair[0]];
            let mut last = pair[0];
            for row in pair[0] + 1..pair[1] {
                let (a, b) = (&demand.targets[last].pose, &demand.targets[row + 1].pose);
                let far = (b.translation.vector - a.translation.vector).norm() > STOP_DISTANCE;
                let turned = demand.tool.oriented()
                    && rotation_vector(&(b.rotation * a.rotation.inverse())).norm() > STOP_ANGLE;
                if far || turned {
                    out.push(row);
                    last = row;
                }
            }
            out
        })
        .collect()
}

/// Distance of states on a curve, rad or m.
pub(super) const NODE_SPACING: f64 = 0.1;
/// Difference (rad or m) below which two isolated solutions are one.
const EQUAL_STATES: f64 = 1e-3;
/// Numbers of postures that one look may use.
const LOOK_NUMBERS: usize = 1 << 20;
/// Steps between states that the graph of a search may have: four bytes each.
const MOST_STEPS: f64 = 5e7;
/// Layers at which random postures are pulled onto the task.
const SEED_LAYERS: usize = 6;
/// Times that sparse layers are filled up.
const REFILLS: usize = 2;
/// Random postures that are tried for one state.
const ATTEMPTS: usize = 3;
/// Distance (m) and angle (rad) of the tool from one stop of a carried state to the next.
const STOP_DISTANCE: f64 = 0.08;
const STOP_ANGLE: f64 = 0.3;
