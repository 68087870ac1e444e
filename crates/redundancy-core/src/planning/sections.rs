//! A path in the fewest sections, each with a continuous line of its own, where none leads all the way.

use super::demand::Demand;
use super::explain::{step_too_far, sum_up};
use super::nodes::{NODE_SPACING, arcs_of};
use super::reach::Break;
use super::report::Outcome;
use crate::path::Reconfiguration;
use crate::solutions::{SolutionsSettings, solutions};
use crate::watch::Watch;

/// Plans the sections between the breaks, each with `solve`; `None` where one of them has no line after all.
pub(super) fn in_sections(
    demand: &Demand,
    breaks: &[Break],
    watch: &Watch,
    solve: impl Fn(&Demand, &Watch) -> Outcome,
) -> Option<Outcome> {
    let n = demand.dof();
    let starts: Vec<usize> = [0].into_iter().chain(breaks.iter().map(|b| b.cut)).collect();
    let (mut q, mut rows): (Vec<f64>, Vec<usize>) = (Vec::new(), Vec::new());
    for (k, first) in starts.iter().enumerate() {
        let end = starts.get(k + 1).copied().unwrap_or(demand.rows());
        let section = demand.section(*first, end);
        if *first > 0 {
            rows.push(*first);
        }
        if end == first + 1 {
            q.extend(cheapest(&section)?);
            continue;
        }
        match solve(&section, watch) {
            Outcome::Line(line, None) => q.extend(line.q),
            Outcome::Jumps { q: of_section, jumps, .. } => {
                q.extend(of_section);
                rows.extend(jumps.iter().map(|jump| first + jump.row));
            }
            _ => return None,
        }
    }
    if q.len() != n * demand.rows() {
        return None;
    }
    let jumps: Vec<Reconfiguration> = rows
        .iter()
        .map(|row| Reconfiguration { row: *row, reason: step_too_far(demand, &q, *row) })
        .collect();
    let reason = sum_up(&jumps);
    Some(Outcome::Jumps { q, jumps, reason })
}

/// The cheapest configuration over the only row of a section.
fn cheapest(section: &Demand) -> Option<Vec<f64>> {
    let task = section.tool.named()?;
    let settings = SolutionsSettings { task, seed: section.seed, ..SolutionsSettings::default() };
    let all = solutions(&section.chain, &section.targets[0].pose, &settings).ok()?;
    let states = arcs_of(section, 0, all.as_ref(), NODE_SPACING)?.concat();
    let clear = states.chunks_exact(section.dof()).filter(|q| section.is_clear(0, q));
    let best = clear.map(|q| (section.row_cost(0, q), q)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, q)| q.to_vec())
}
