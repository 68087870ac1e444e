//! How far any line can come, where all solutions over every point are known.
//!
//! With at most one spare coordinate the solutions over a point are points or curves, which the limits cut into arcs. Arcs of
//! neighbouring points are connected where a step that the joints may make leads from one to the other and stays on one
//! piece of the solutions in between. Where a line can go along an arc is left open, so that more is reached than lines
//! can reach; less only where the samples on the arcs, or the steps between them that are tried, miss a connection.

use super::demand::Demand;
use super::nodes::{NODE_SPACING, arcs_of};
use super::pull::Puller;
use super::search::turns_round;
use super::verify::is_continuous;
use crate::joint_space::wrap;
use crate::parallel::prelude::*;
use crate::solutions::{SolutionsSettings, solutions};
use crate::watch::Watch;

/// The first point that no line from the start comes to; `None` where lines come to the end, or where it is not known.
pub(super) fn first_unreached(demand: &Demand, watch: &Watch) -> Option<usize> {
    let task = demand.tool.named().filter(|_| demand.spare() <= 1 && demand.bounds() == 0)?;
    let arcs: Vec<Option<Vec<Vec<f64>>>> = (0..demand.rows())
        .into_par_iter()
        .map(|row| {
            if watch.interrupted().is_some() {
                return None;
            }
            let settings = SolutionsSettings { task, seed: demand.seed, ..SolutionsSettings::default() };
            let all = solutions(&demand.chain, &demand.targets[row].pose, &settings).ok()?;
            if all.proven() { arcs_of(demand, row, all.as_ref(), NODE_SPACING) } else { None }
        })
        .collect();
    let arcs: Vec<Vec<Vec<f64>>> = arcs.into_iter().collect::<Option<_>>()?;
    let round: Vec<bool> = (0..demand.dof()).map(|i| turns_round(demand, i)).collect();
    let mut reached: Vec<&[f64]> = arcs[0].iter().map(Vec::as_slice).collect();
    for row in 1..demand.rows() {
        let step = Step { demand, round: &round, row };
        let next: Vec<bool> = arcs[row]
            .par_iter()
            .map_init(|| Puller::new(demand), |puller, arc| step.reaches(puller, &reached, arc))
            .collect();
        if watch.interrupted().is_some() {
            return None;
        }
        let connected = arcs[row].iter().zip(&next).filter(|(_, connected)| **connected);
        reached = connected.map(|(arc, _)| arc.as_slice()).collect();
        if reached.is_empty() {
            return Some(row);
        }
    }
    None
}

/// A step to a row.
struct Step<'a> {
    demand: &'a Demand,
    round: &'a [bool],
    row: usize,
}

impl Step<'_> {
    /// Whether an arc is connected with one that was reached.
    fn reaches(&self, puller: &mut Puller<'_>, reached: &[&[f64]], arc: &[f64]) -> bool {
        let (demand, n) = (self.demand, self.demand.dof());
        let rows = [self.row - 1, self.row];
        let mut steps: Vec<(f64, &[f64], &[f64])> = Vec::new();
        for to in arc.chunks_exact(n) {
            for before in reached {
                let near =
                    before.chunks_exact(n).filter_map(|from| Some((self.distance(from, to)?, from, to)));
                steps.extend(near.min_by(|a, b| a.0.total_cmp(&b.0)));
            }
        }
        // Between arcs of one piece the shortest steps are the carried ones.
        steps.sort_by(|a, b| a.0.total_cmp(&b.0));
        steps.iter().take(TRIED).any(|(_, from, to)| {
            let to: Vec<f64> = (0..n).map(|i| from[i] + self.short(i, to[i] - from[i])).collect();
            is_continuous(puller, demand, rows, from, &to)
        })
    }

    /// Square of the distance of two configurations; `None` where it is beyond the largest step and that of samples.
    fn distance(&self, from: &[f64], to: &[f64]) -> Option<f64> {
        let n = from.len();
        let bound = &self.demand.step_bound[(self.row - 1) * n..self.row * n];
        let mut square = 0.0;
        for i in 0..n {
            let d = self.short(i, to[i] - from[i]);
            if d.abs() > bound[i] + NODE_SPACING {
                return None;
            }
            square += d * d;
        }
        Some(square)
    }

    fn short(&self, joint: usize, d: f64) -> f64 {
        if self.round[joint] { wrap(d) } else { d }
    }
}

/// Steps to an arc that are tried, the shortest first.
const TRIED: usize = 24;
