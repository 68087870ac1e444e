//! How far any line can come, where all solutions over every point are known.
//!
//! With at most one spare coordinate the solutions over a point are points or curves, which the limits cut into arcs. Arcs of
//! neighbouring points are connected where a step that the joints may make leads from one to the other and stays on one
//! piece of the solutions in between. Where a line can go along an arc is left open, so that more is reached than lines
//! can reach; less only where the samples on the arcs, or the steps between them that are tried, miss a connection.
//!
//! A line with reconfigurations that goes on as far as it can before each of them has the fewest.

use super::demand::Demand;
use super::nodes::{NODE_SPACING, arcs_of};
use super::pull::Puller;
use super::search::turns_round;
use super::verify::is_continuous;
use crate::joint_space::wrap;
use crate::parallel::prelude::*;
use crate::solutions::{SolutionsSettings, solutions};
use crate::watch::Watch;

/// What the arcs of all solutions show.
#[derive(Debug, Clone, Default)]
pub(super) struct Reach {
    /// Points without an arc.
    pub empty: Vec<usize>,
    /// The fewest points at which a line has to begin anew.
    pub breaks: Vec<Break>,
}

/// A place where no line goes on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Break {
    /// The first point that no line from the last break comes to.
    pub unreached: usize,
    /// Where a reconfiguration is best made: as far from there as from the first point from which lines lead on.
    pub cut: usize,
}

/// The places that no line passes; none where lines come to the end, or where it is not known.
pub(super) fn reach(demand: &Demand, watch: &Watch) -> Reach {
    Arcs::of(demand, watch).and_then(|arcs| arcs.reach(watch)).unwrap_or_default()
}

/// All arcs over all points.
struct Arcs<'a> {
    demand: &'a Demand,
    round: Vec<bool>,
    arcs: Vec<Vec<Vec<f64>>>,
}

impl<'a> Arcs<'a> {
    fn of(demand: &'a Demand, watch: &Watch) -> Option<Self> {
        let task = demand.tool.named().filter(|_| demand.spare() <= 1 && demand.bounds() == 0)?;
        let arcs: Option<Vec<Vec<Vec<f64>>>> = (0..demand.rows())
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
        let round = (0..demand.dof()).map(|i| turns_round(demand, i)).collect();
        Some(Self { demand, round, arcs: arcs? })
    }

    fn reach(&self, watch: &Watch) -> Option<Reach> {
        let is_empty = |row: &usize| self.arcs[*row].iter().all(Vec::is_empty);
        let empty: Vec<usize> = (0..self.arcs.len()).filter(is_empty).collect();
        if !empty.is_empty() {
            return Some(Reach { empty, breaks: Vec::new() });
        }
        let mut breaks: Vec<Break> = Vec::new();
        let (mut begin, mut from) = (0, 0);
        loop {
            let unreached = self.forward(from, watch)?;
            // Lines from here need not begin before the cut that is best for them.
            if let Some(last) = breaks.last_mut() {
                let first = self.backward(unreached.unwrap_or(self.arcs.len()) - 1, begin + 1, watch)?;
                last.cut = (first.min(last.unreached) + last.unreached).div_ceil(2);
                begin = last.cut;
            }
            let Some(unreached) = unreached else { break };
            breaks.push(Break { unreached, cut: unreached });
            from = unreached;
        }
        Some(Reach { empty: Vec::new(), breaks })
    }

    fn all(&self, row: usize) -> Vec<&[f64]> {
        self.arcs[row].iter().map(Vec::as_slice).collect()
    }

    /// The first row that no line from `from` comes to: `Some(None)` where they come to the end.
    fn forward(&self, from: usize, watch: &Watch) -> Option<Option<usize>> {
        let mut reached = self.all(from);
        for row in from + 1..self.arcs.len() {
            let step = self.step(row);
            reached = self.filtered(row, |arc, puller| step.connects(puller, &reached, &[arc]));
            if watch.interrupted().is_some() {
                return None;
            }
            if reached.is_empty() {
                return Some(Some(row));
            }
        }
        Some(None)
    }

    /// The first row, not before `floor`, from which lines come to `to`.
    fn backward(&self, to: usize, floor: usize, watch: &Watch) -> Option<usize> {
        let mut reached = self.all(to);
        for row in (floor..to).rev() {
            let step = self.step(row + 1);
            reached = self.filtered(row, |arc, puller| step.connects(puller, &[arc], &reached));
            if watch.interrupted().is_some() {
                return None;
            }
            if reached.is_empty() {
                return Some(row + 1);
            }
        }
        Some(floor.min(to))
    }

    fn step(&self, row: usize) -> Step<'_> {
        Step { demand: self.demand, round: &self.round, row }
    }

    /// The arcs of a row for which something holds.
    fn filtered(&self, row: usize, holds: impl Fn(&[f64], &mut Puller<'_>) -> bool + Sync) -> Vec<&[f64]> {
        let kept: Vec<bool> = self.arcs[row]
            .par_iter()
            .map_init(|| Puller::new(self.demand), |puller, arc| holds(arc, puller))
            .collect();
        let arcs = self.arcs[row].iter().zip(kept).filter(|(_, kept)| *kept);
        arcs.map(|(arc, _)| arc.as_slice()).collect()
    }
}

/// A step to a row.
struct Step<'a> {
    demand: &'a Demand,
    round: &'a [bool],
    row: usize,
}

impl Step<'_> {
    /// Whether one of the arcs `before` the step is connected with one `after` it.
    fn connects(&self, puller: &mut Puller<'_>, before: &[&[f64]], after: &[&[f64]]) -> bool {
        let (demand, n) = (self.demand, self.demand.dof());
        let rows = [self.row - 1, self.row];
        let mut steps: Vec<(f64, &[f64], &[f64])> = Vec::new();
        for to in after.iter().flat_map(|arc| arc.chunks_exact(n)) {
            for arc in before {
                let near = arc.chunks_exact(n).filter_map(|from| Some((self.distance(from, to)?, from, to)));
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
