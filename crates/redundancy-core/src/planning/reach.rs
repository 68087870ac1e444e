//! How far any line can come, where all solutions over every point are known.
//!
//! With at most one spare coordinate the solutions over a point are points or curves, which the limits cut into arcs. Arcs of
//! neighbouring points are connected where a step that the joints may make leads from one to the other and stays on one
//! piece of the solutions in between. Where a line can go along an arc is left open, so that more is reached than lines
//! can reach, and never less but for the distance of the samples on the arcs.
//!
//! Where no sample is within the largest step of one that was reached before, widened by the distance of samples, the
//! verdict is exact: every line passes within half of that distance of a sample.

use super::demand::Demand;
use super::nodes::{NODE_SPACING, arcs_of};
use super::pull::Puller;
use super::search::turns_round;
use super::verify::is_continuous;
use crate::joint_space::wrap;
use crate::parallel::prelude::*;
use crate::solutions::{SolutionsSettings, solutions};
use crate::watch::Watch;

/// A point that no line from the start comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Unreached {
    pub row: usize,
    /// Whether that is exact, or what samples on the arcs show.
    pub exact: bool,
}

/// The first point that no line from the start comes to; `None` where lines come to the end, or where it is not known.
pub(super) fn first_unreached(demand: &Demand, watch: &Watch) -> Option<Unreached> {
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
        let next: Vec<(bool, bool)> = arcs[row]
            .par_iter()
            .map_init(|| Puller::new(demand), |puller, arc| step.reaches(puller, &reached, arc))
            .collect();
        if watch.interrupted().is_some() {
            return None;
        }
        if next.iter().all(|(_, connected)| !connected) {
            return Some(Unreached { row, exact: next.iter().all(|(near, _)| !near) });
        }
        let connected = arcs[row].iter().zip(&next).filter(|(_, (_, connected))| *connected);
        reached = connected.map(|(arc, _)| arc.as_slice()).collect();
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
    /// Whether an arc is near enough to one that was reached, and whether it is connected with one.
    fn reaches(&self, puller: &mut Puller<'_>, reached: &[&[f64]], arc: &[f64]) -> (bool, bool) {
        let (demand, n) = (self.demand, self.demand.dof());
        let rows = [self.row - 1, self.row];
        let mut near = false;
        for before in reached {
            for to in arc.chunks_exact(n) {
                let nearest = before
                    .chunks_exact(n)
                    .filter_map(|from| self.distance(from, to).map(|distance| (distance, from)))
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                let Some((_, from)) = nearest else { continue };
                near = true;
                let to: Vec<f64> = (0..n).map(|i| from[i] + self.short(i, to[i] - from[i])).collect();
                if is_continuous(puller, demand, rows, from, &to) {
                    return (true, true);
                }
            }
        }
        (near, false)
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
