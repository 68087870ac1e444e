//! How far any line can come: exact where the solutions over every point are known.
//!
//! With at most one spare coordinate the solutions over a point are points or curves, cut by the limits. They are sampled at
//! even distances; a line through a point passes within half of the distance of a sample. So neighbouring points that a line
//! connects have samples no farther apart than the largest step and the distance of samples together. Where no sample of
//! a point is that near to one that was reached before, there is no line.

use super::demand::Demand;
use super::nodes::{NODE_SPACING, states_of};
use super::search::turns_round;
use crate::joint_space::wrap;
use crate::parallel::prelude::*;
use crate::solutions::{SolutionsSettings, solutions};
use crate::watch::Watch;

/// The first point that no line from the start comes to; `None` where lines come to the end, or where it is not known.
pub(super) fn first_unreached(demand: &Demand, watch: &Watch) -> Option<usize> {
    let task = demand.tool.named().filter(|_| demand.spare() <= 1 && demand.bounds() == 0)?;
    let n = demand.dof();
    let states: Vec<Option<Vec<f64>>> = (0..demand.rows())
        .into_par_iter()
        .map(|row| {
            if watch.interrupted().is_some() {
                return None;
            }
            let settings = SolutionsSettings { task, seed: demand.seed, ..SolutionsSettings::default() };
            let all = solutions(&demand.chain, &demand.targets[row].pose, &settings).ok()?;
            if all.proven() { states_of(demand, row, all.as_ref(), NODE_SPACING) } else { None }
        })
        .collect();
    let states: Vec<Vec<f64>> = states.into_iter().collect::<Option<_>>()?;
    let round: Vec<bool> = (0..n).map(|i| turns_round(demand, i)).collect();
    let mut reached: Vec<&[f64]> = states[0].chunks_exact(n).collect();
    for row in 1..demand.rows() {
        let bound = &demand.step_bound[(row - 1) * n..row * n];
        let near = |a: &[f64], b: &[f64]| {
            (0..n).all(|i| {
                let d = if round[i] { wrap(b[i] - a[i]) } else { b[i] - a[i] };
                d.abs() <= bound[i] + NODE_SPACING
            })
        };
        let next: Vec<&[f64]> =
            states[row].chunks_exact(n).filter(|q| reached.iter().any(|before| near(before, q))).collect();
        if next.is_empty() || watch.interrupted().is_some() {
            return next.is_empty().then_some(row);
        }
        reached = next;
    }
    None
}
