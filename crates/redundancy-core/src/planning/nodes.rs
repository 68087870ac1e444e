//! States over some points of a path, sampled evenly in joint space.
//!
//! Random postures are pulled onto the task at a few points and carried along the path by shortest steps, in both
//! directions, until they leave their limits. A grid over the spare coordinates would miss the best lines where a
//! coordinate is a poor one (a spin where the wrist is nearly straight); joint space is what the cost is made of.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::demand::Demand;
use super::pull::{MOST_JOINTS, Pull, Puller};
use crate::kinematics::rotation_vector;
use crate::parallel::prelude::*;

/// States over some rows of a problem.
#[derive(Debug, Clone)]
pub(super) struct Nodes {
    /// The rows.
    pub rows: Vec<usize>,
    /// States of each, one after the other.
    pub q: Vec<Vec<f64>>,
    /// Rows between neighbouring layers at which carried states stop.
    stops: Vec<Vec<usize>>,
}

impl Nodes {
    /// About `count` states over each of `rows`.
    pub fn sample(demand: &Demand, rows: Vec<usize>, count: usize) -> Self {
        let layers = rows.len();
        let mut nodes = Self { stops: stops(demand, &rows), q: vec![Vec::new(); layers], rows };
        let seeds = SEED_LAYERS.min(layers);
        let each = count.div_ceil(seeds);
        let work: Vec<(usize, usize)> = (0..seeds)
            .flat_map(|s| {
                let layer = if seeds > 1 { s * (layers - 1) / (seeds - 1) } else { 0 };
                (0..each).map(move |i| (layer, i))
            })
            .collect();
        nodes.grow(demand, &work);
        // Layers that lines do not reach get states of their own.
        for round in 1..=REFILLS {
            let work: Vec<(usize, usize)> = (0..layers)
                .filter(|layer| nodes.q[*layer].len() < demand.dof() * count / 2)
                .flat_map(|layer| (0..each).map(move |i| (layer, round * each + i)))
                .collect();
            if work.is_empty() {
                break;
            }
            nodes.grow(demand, &work);
        }
        nodes
    }

    /// Random postures at (layer, number), carried both ways.
    fn grow(&mut self, demand: &Demand, work: &[(usize, usize)]) {
        let lines: Vec<Vec<(usize, Vec<f64>)>> = work
            .par_iter()
            .map_init(
                || Puller::new(demand),
                |puller, (layer, number)| self.line(demand, puller, *layer, *number),
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
        let mut out = Vec::new();
        let seed = demand.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ ((layer as u64) << 32) ^ number as u64;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let target = &demand.targets[self.rows[layer]];
        let Some(q) = (0..ATTEMPTS).find_map(|_| {
            let mut q = posture(demand, &mut rng);
            let pull =
                Pull { tilt: rng.random::<f64>().sqrt(), spin: 2.0 * rng.random::<f64>() - 1.0, ..Pull::FAR };
            puller.pull_far(&mut q, target, &pull).then_some(q)
        }) else {
            return out;
        };
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

/// A random posture within limits; within half a turn or a metre of the middle where there are none.
fn posture(demand: &Demand, rng: &mut ChaCha8Rng) -> Vec<f64> {
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

/// Layers at which random postures are pulled onto the task.
const SEED_LAYERS: usize = 6;
/// Times that sparse layers are filled up.
const REFILLS: usize = 2;
/// Random postures that are tried for one state.
const ATTEMPTS: usize = 3;
/// Distance (m) and angle (rad) of the tool from one stop of a carried state to the next.
const STOP_DISTANCE: f64 = 0.08;
const STOP_ANGLE: f64 = 0.3;
const _: () = assert!(MOST_JOINTS >= 8);
