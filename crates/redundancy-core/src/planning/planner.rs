//! Whole paths: any arm, any freedom, all points at once.
//!
//! # Method
//! 1. **States** over a few points of the path, sampled evenly in joint space and carried from point to point
//!    ([`nodes`](super::nodes)).
//! 2. **Search** by dynamic programming over all pairs of neighbouring states, with the joint speeds as limits;
//!    lines that differ ([`search`](super::search)). Steps that turn out not to be connected are taken out, and the
//!    search is repeated.
//! 3. **Refinement** of each line on more points, of the best ones on all of them, to a local optimum
//!    ([`refine`](super::refine)).
//! 4. **Verification** of what is returned ([`verify`](super::verify)).
//!
//! Where lines break a limit, others are looked for away from there. Where no legal line comes out, all of it is done again
//! with more states over more points. Where none comes out in the end, the same search counts reconfigurations, and the
//! reason is looked for ([`explain`](super::explain)).

use super::demand::{Demand, Objective, PlanSettings};
use super::explain;
use super::fill::fill;
use super::nodes::Nodes;
use super::reach::{Reach, reach};
use super::refine::{Goal, Refined, Refinement, refine};
use super::report::{self, Outcome};
use super::search::{Line, Search};
use super::sections::in_sections;
use super::verify;
use crate::chain::Chain;
use crate::error::Result;
use crate::parallel::prelude::*;
use crate::path::{Path, Plan};
use crate::tolerance::PLAN_DEEP;
use crate::watch::Watch;

/// Plans a path for any chain, with any freedom of the tool.
///
/// ```
/// use redundancy_core::{Status, Watch, chain::catalog, nalgebra::{Rotation3, Vector3}, path::{Circle, Path}};
/// use redundancy_core::planning::{PlanSettings, plan};
/// let arm = catalog::load("panda")?;
/// let circle = Circle::new(Vector3::new(0.5, 0.0, 0.4), 0.1, 0.0, 1.0, Vector3::z())?.path(60)?;
/// let path = circle.with_orientation(&Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))?;
/// let plan = plan(&arm, &path, &PlanSettings::default(), &Watch::default())?;
/// assert_eq!((plan.status(), plan.legal(), plan.rows()), (Status::Converged, Some(true), 60));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Settings out of their range, a freedom that does not apply, ends that are not on the path, a closed plan of an open
/// path.
pub fn plan(chain: &Chain, path: &Path, settings: &PlanSettings, watch: &Watch) -> Result<Plan> {
    let demand = Demand::new(chain, path, settings)?;
    let outcome = Run { demand: &demand, watch }.solve();
    // The end is reported, whatever came out.
    let _ = watch.report(1.0);
    report::plan(&demand, path, outcome)
}

/// How closely is searched.
#[derive(Debug, Clone, Copy)]
pub(super) struct Level {
    number: usize,
    /// Factors of the number of points with states, and of states over each.
    layers: usize,
    states: usize,
}

/// From the first look to the last.
const LEVELS: [Level; 4] = [
    Level { number: 0, layers: 1, states: 1 },
    Level { number: 1, layers: 2, states: 2 },
    Level { number: 2, layers: 4, states: 3 },
    Level { number: 3, layers: 8, states: 4 },
];

/// One call of the planner.
struct Run<'a> {
    demand: &'a Demand,
    watch: &'a Watch,
}

/// What one level found.
struct Found {
    best: Option<Refined>,
    nodes: Nodes,
    /// The places that no line passes, once that was asked.
    reach: Option<Reach>,
}

impl Run<'_> {
    fn solve(&self) -> Outcome {
        let mut best: Option<Refined> = None;
        let (mut last, mut known) = (None, Reach::default());
        for level in LEVELS {
            let share = level.number as f64 / LEVELS.len() as f64;
            if level.number > 0 && self.watch.report(share).is_err() {
                break;
            }
            let found = self.level(level);
            best = better(self.demand, best, found.best);
            if let Some(line) = best.take_if(|line| line.is_legal()) {
                return self.finished(line);
            }
            let saturated = found.nodes.rows.len() == self.demand.rows() && level.number > 1;
            // More states over other points do not help where a point has none.
            let hopeless =
                self.watch.interrupted().is_none() && explain::is_blocked(self.demand, &found.nodes);
            last = Some(found.nodes);
            if level.number == 0 && !hopeless {
                known = found.reach.unwrap_or_else(|| reach(self.demand, self.watch));
            }
            if !known.empty.is_empty() {
                let blocked = explain::blocked_points(self.demand, &known.empty, self.watch);
                if !blocked.is_empty() {
                    return Outcome::Blocked(blocked);
                }
            }
            if let Some(first) = known.breaks.first() {
                if let Some(outcome) = self.with_breaks(&known) {
                    return outcome.after(&explain::gap(first.unreached));
                }
                // No search for a line any more: states for one with reconfigurations.
                let Level { layers, states, number } = LEVELS[2];
                let rows = self.demand.even_rows((layer_count(self.demand) * layers).min(MOST_LAYERS));
                let count = state_count(self.demand) * states;
                last = Some(Nodes::over(self.demand, rows, count, number, self.watch));
                break;
            }
            if saturated || hopeless {
                break;
            }
        }
        if let Some(why) = self.watch.interrupted() {
            return Outcome::Interrupted(best.map(Box::new), why);
        }
        // A line that breaks a limit by a trifle tells less than why there is none.
        match last {
            Some(nodes) => explain::without_line(self.demand, nodes, &known, self.watch),
            None => Outcome::Nothing("no point was searched".into()),
        }
    }

    /// The rows with the fewest reconfigurations, where a line has to begin anew.
    fn with_breaks(&self, known: &Reach) -> Option<Outcome> {
        let open;
        let demand = if self.demand.cyclic {
            open = self.demand.section(0, self.demand.rows());
            &open
        } else {
            self.demand
        };
        let solve = |demand: &Demand, watch: &Watch| Run { demand, watch }.solve();
        in_sections(demand, &known.breaks, self.watch, solve)
    }

    /// The line that is returned, repaired where it does not hold between its rows.
    fn finished(&self, line: Refined) -> Outcome {
        let mut line = line;
        for round in 0..REPAIRS {
            let excess = verify::limit_excess(self.demand, &line.q);
            let within = excess <= verify::LIMIT_ROUNDING;
            let clear = verify::first_contact(self.demand, &line.q, true).is_none();
            if within && clear {
                break;
            }
            let margin = if within { 0.0 } else { REPAIR_MARGIN * excess };
            let room = if clear { 0.0 } else { REPAIR_ROOM * (round + 1) as f64 };
            let tight = self.demand.with_margin(margin).with_room(room);
            let how = Refinement { watch: Some(self.watch), ..Refinement::FINE };
            match minimise(&tight, line.q.clone(), &how) {
                Some(repaired) if repaired.is_legal() => line = repaired,
                _ => break,
            }
        }
        Outcome::Line(Box::new(line), self.watch.interrupted())
    }

    fn level(&self, level: Level) -> Found {
        let (demand, watch) = (self.demand, self.watch);
        let part = watch.part(
            level.number as f64 / LEVELS.len() as f64,
            (level.number as f64 + 1.0) / LEVELS.len() as f64,
        );
        let rows = demand.even_rows((layer_count(demand) * level.layers).min(MOST_LAYERS));
        let mut nodes =
            Nodes::over(demand, rows.clone(), state_count(demand) * level.states, level.number, watch);
        if nodes.q.iter().any(Vec::is_empty) || part.report(0.3).is_err() {
            return Found { best: None, nodes, reach: None };
        }
        let layers = demand.thinned(&rows);
        let mut middle = subdivided(demand, &rows, MIDDLE_ROWS, LEAST_MIDDLE_ROWS);
        let mut best: Option<Refined> = None;
        let mut seen = Seen::default();
        let mut known = None;
        for round in 0..=AVOIDING {
            let mut lines = Vec::new();
            // Where every line winds a joint out of its limits, the windings of that joint are checked one by one.
            for _ in 0..=MOST_WOUND {
                let mut search = Search::new(&layers, &nodes);
                seen.places.iter().for_each(|place| search.avoid(place.layer, &place.q, place.radius));
                let (connected, wound) = connected_lines(demand, &mut search, &rows, &middle, watch);
                lines = connected;
                match wound {
                    Some(joint) if lines.is_empty() => nodes = nodes.with_windings(demand, joint),
                    _ => break,
                }
            }
            let share = |of_round: f64| 0.3 + 0.7 * (round as f64 + of_round) / (AVOIDING as f64 + 1.0);
            if lines.is_empty() || part.report(share(0.3)).is_err() {
                best = best.or_else(|| lines.into_iter().find_map(|q| self.unrefined(&middle, &q)));
                break;
            }
            let coarse = demand.thinned(&middle);
            let how = Refinement { watch: Some(watch), ..Refinement::COARSE };
            let mut refined: Vec<Refined> =
                lines.into_par_iter().filter_map(|line| minimise(&coarse, line, &how)).collect();
            refined.sort_by(|a, b| score(&coarse, a).total_cmp(&score(&coarse, b)));
            let _ = part.report(share(0.6));
            let refined = distinct(&coarse, refined);
            let cheapest = |legal: bool| {
                let costs = refined.iter().filter(|line| line.is_legal() == legal).map(|line| line.cost);
                costs.fold(f64::INFINITY, f64::min)
            };
            let enough = cheapest(true) <= FINE_WINDOW * cheapest(false);
            seen.illegal(round, &rows, &middle, &refined);
            let fine = self.fine(&coarse, &middle, seen.new_ones(round, &middle, refined));
            if let Some(line) = fine.as_ref().filter(|line| !line.is_legal()) {
                seen.illegal(
                    round,
                    &rows,
                    &(0..demand.rows()).collect::<Vec<_>>(),
                    std::slice::from_ref(line),
                );
                let near = line.worst_row.saturating_sub(DENSE_ROWS)..line.worst_row + DENSE_ROWS;
                middle.extend(near.filter(|row| *row < demand.rows()));
                middle.sort_unstable();
                middle.dedup();
            }
            best = better(demand, best, fine);
            let legal = best.as_ref().is_some_and(Refined::is_legal);
            if (enough && legal) || watch.interrupted().is_some() {
                break;
            }
            // Before lines are looked for elsewhere: whether there can be one.
            if level.number == 0 && round == 0 && !legal {
                let found = reach(demand, watch);
                let none = !(found.breaks.is_empty() && found.empty.is_empty());
                known = Some(found);
                if none {
                    break;
                }
            }
        }
        Found { best, nodes, reach: known }
    }

    /// The best of some lines, refined on all rows.
    fn fine(&self, coarse: &Demand, middle: &[usize], lines: Vec<Refined>) -> Option<Refined> {
        let demand = self.demand;
        let all: Vec<usize> = (0..demand.rows()).collect();
        let first = lines.first().map_or(0.0, |line| score(coarse, line));
        let mut best: Option<Refined> = None;
        for (k, line) in lines.into_iter().enumerate() {
            let enough = k >= FINE_LINES || score(coarse, &line) > FINE_WINDOW * first;
            if best
                .as_ref()
                .is_some_and(|best| best.is_legal() && (enough || self.watch.interrupted().is_some()))
            {
                break;
            }
            if self.watch.interrupted().is_some() {
                best = better(demand, best, self.unrefined(middle, &line.q));
                continue;
            }
            let Ok(q) = fill(demand, middle, &line.q, &all) else { continue };
            let how = Refinement { watch: Some(self.watch), ..Refinement::FINE };
            let line = if demand.objective == Objective::PeakSpeed {
                fastest(demand, q, &how, &PEAK_WEIGHTS[PEAK_WEIGHTS.len() - 1..])
            } else {
                refine(demand, q, &how)
            };
            best = better(demand, best, line);
        }
        best
    }

    /// A line as the search left it, on all rows: what there is when time is up.
    fn unrefined(&self, middle: &[usize], q: &[f64]) -> Option<Refined> {
        let demand = self.demand;
        let all: Vec<usize> = (0..demand.rows()).collect();
        let q = fill(demand, middle, q, &all).ok()?;
        refine(demand, q, &Refinement { iterations: 0, ..Refinement::FINE })
    }
}

/// What one level has seen of lines that break limits.
#[derive(Default)]
struct Seen {
    places: Vec<Avoided>,
    /// Number of rows and cost of the lines that were refined on all rows.
    refined: Vec<(usize, f64)>,
}

/// States around a place at which a refined line breaks a limit.
struct Avoided {
    layer: usize,
    q: Vec<f64>,
    radius: f64,
    /// The round in which it last grew.
    round: usize,
}

impl Seen {
    /// Keeps away from where lines on `middle` break their limits: from more around such a place in every round.
    fn illegal(&mut self, round: usize, rows: &[usize], middle: &[usize], lines: &[Refined]) {
        for line in lines.iter().filter(|line| !line.is_legal()) {
            let (n, row) = (line.q.len() / middle.len(), middle[line.worst_row]);
            let after = rows.partition_point(|r| *r <= row);
            let before_is_nearer =
                after > 0 && (after == rows.len() || row - rows[after - 1] <= rows[after] - row);
            let layer = if before_is_nearer { after - 1 } else { after };
            let q = &line.q[line.worst_row * n..(line.worst_row + 1) * n];
            let distance =
                |place: &Avoided| place.q.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let near =
                self.places.iter_mut().find(|place| place.layer == layer && distance(place) < place.radius);
            match near {
                Some(place) if place.round < round => {
                    place.radius *= AVOIDED_GROWTH;
                    place.round = round;
                }
                Some(_) => {}
                None => self.places.push(Avoided { layer, q: q.to_vec(), radius: AVOIDED_RADIUS, round }),
            }
        }
    }

    /// The lines that are worth refining on all rows: those that were not yet, and no illegal ones after the first round.
    fn new_ones(&mut self, round: usize, middle: &[usize], lines: Vec<Refined>) -> Vec<Refined> {
        let old = |line: &Refined| {
            let same = |(rows, cost): &(usize, f64)| {
                *rows == middle.len() && (line.cost - cost).abs() <= SAME_COST * cost.abs()
            };
            self.refined.iter().any(same)
        };
        let new: Vec<Refined> =
            lines.into_iter().filter(|line| !old(line) && (round == 0 || line.is_legal())).collect();
        self.refined.extend(new.iter().map(|line| (middle.len(), line.cost)));
        new
    }
}

/// The lines without those that came to the same optimum as a better one.
fn distinct(demand: &Demand, lines: Vec<Refined>) -> Vec<Refined> {
    let rows = demand.rows() as f64;
    let mut out: Vec<Refined> = Vec::new();
    for line in lines {
        let same = |other: &Refined| {
            let square: f64 = line.q.iter().zip(&other.q).map(|(a, b)| (a - b).powi(2)).sum();
            (square / rows).sqrt() < SAME_LINE
        };
        if !out.iter().any(same) {
            out.push(line);
        }
    }
    out
}

/// Lines of the search that are connected, on the rows `middle`, and a joint that winds out of its limits along others.
fn connected_lines(
    demand: &Demand,
    search: &mut Search<'_>,
    rows: &[usize],
    middle: &[usize],
    watch: &Watch,
) -> (Vec<Vec<f64>>, Option<usize>) {
    let mut out: Vec<Vec<f64>> = Vec::new();
    let mut wound = None;
    for _ in 0..REPEATS {
        let found = search.lines(LINES);
        wound = found.wound.first().copied();
        let filled: Vec<(Line, std::result::Result<Vec<f64>, usize>)> = (found.lines.into_par_iter())
            .map(|line| {
                let filled = fill(demand, rows, &line.q, middle);
                let filled = filled.and_then(|q| match deep_contact(demand, rows, middle, &q) {
                    Some(step) => Err(step),
                    None => Ok(q),
                });
                (line, filled)
            })
            .collect();
        let total = filled.len();
        out.clear();
        for (line, filled) in filled {
            match filled {
                Ok(q) => out.push(q),
                Err(step) => {
                    let next = if step + 1 == rows.len() { 0 } else { step + 1 };
                    search.forbid(step, line.states[step], line.states[next]);
                }
            }
        }
        if total == 0 || out.len() == total || watch.interrupted().is_some() {
            break;
        }
    }
    (out, wound)
}

/// The first step of the line on `rows` on which something is deep in another between them.
fn deep_contact(demand: &Demand, rows: &[usize], middle: &[usize], q: &[f64]) -> Option<usize> {
    let around = demand.around.as_ref()?;
    let mut places = q.chunks_exact(demand.dof()).zip(middle);
    let (_, row) = places.find(|(q, row)| !around.is_clear(q, demand.time[**row], -PLAN_DEEP))?;
    Some(rows.partition_point(|first| first <= row).saturating_sub(1))
}

/// Refines a line towards the objective.
fn minimise(demand: &Demand, q: Vec<f64>, how: &Refinement<'_>) -> Option<Refined> {
    match demand.objective {
        Objective::PeakSpeed => fastest(demand, q, how, &PEAK_WEIGHTS),
        _ => refine(demand, q, how),
    }
}

/// The least peak speed, and the least motion with it.
fn fastest(demand: &Demand, q: Vec<f64>, how: &Refinement<'_>, weights: &[f64]) -> Option<Refined> {
    let mut q = q;
    for weight in weights {
        let goal = Goal::Peak(*weight);
        q = refine(demand, q, &Refinement { goal, barrier: PEAK_BARRIER, slope: PEAK_SLOPE, ..*how })?.q;
    }
    let cap = demand.peak_speed(&q) * (1.0 + PEAK_SLACK);
    refine(demand, q, &Refinement { goal: Goal::Capped(cap), ..*how })
}

/// The better of two lines.
fn better(demand: &Demand, a: Option<Refined>, b: Option<Refined>) -> Option<Refined> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if score(demand, &b) < score(demand, &a) { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// What lines are compared by: illegal ones come last.
fn score(demand: &Demand, line: &Refined) -> f64 {
    let cost = match demand.objective {
        Objective::PeakSpeed => demand.peak_speed(&line.q) * (1.0 + 1e-6 * line.cost),
        _ => line.cost,
    };
    if line.is_legal() { cost } else { ILLEGAL * (1.0 + line.violation) }
}

fn layer_count(demand: &Demand) -> usize {
    let length: f64 = demand
        .targets
        .windows(2)
        .map(|w| (w[1].pose.translation.vector - w[0].pose.translation.vector).norm())
        .sum();
    ((length / LAYER_DISTANCE).ceil() as usize + 1).clamp(LEAST_LAYERS, MOST_LAYERS).min(demand.rows())
}

fn state_count(demand: &Demand) -> usize {
    match demand.spare() {
        0 | 1 => 100,
        2 | 3 => 150,
        _ => 300,
    }
}

/// Every gap between `rows` cut into up to `parts`, more where there are few gaps.
fn subdivided(demand: &Demand, rows: &[usize], parts: usize, least: usize) -> Vec<usize> {
    let parts = parts.max(least.div_ceil(rows.len()));
    let mut out = Vec::new();
    for (k, first) in rows.iter().enumerate() {
        let end = match rows.get(k + 1) {
            Some(next) => *next,
            None if demand.cyclic => demand.rows(),
            None => {
                out.push(*first);
                break;
            }
        };
        let gap = end - first;
        let parts = parts.min(gap);
        out.extend((0..parts).map(|j| first + j * gap / parts));
    }
    out.dedup();
    out
}

/// Layers of the search, and the distance of the tool between them, m.
const LEAST_LAYERS: usize = 32;
const MOST_LAYERS: usize = 400;
const LAYER_DISTANCE: f64 = 0.3;
/// Rows between layers on which lines are refined first, and how many there are of them at least.
const MIDDLE_ROWS: usize = 6;
const LEAST_MIDDLE_ROWS: usize = 120;
/// Lines that are refined on some rows, and on all of them where they are at most this many times the best one.
const LINES: usize = 24;
const FINE_LINES: usize = 2;
const FINE_WINDOW: f64 = 1.02;
/// Root mean square distance (rad) below which two refined lines are the same.
const SAME_LINE: f64 = 0.02;
/// Times that lines are looked for elsewhere because all of them break limits, and how far from there (rad) at first.
const AVOIDING: usize = 5;
const AVOIDED_RADIUS: f64 = 0.3;
const AVOIDED_GROWTH: f64 = 2.0;
/// Rows on either side of such a place on which lines are refined from then on.
const DENSE_ROWS: usize = 12;
/// Relative difference of the costs of two lines that are the same.
const SAME_COST: f64 = 1e-6;
/// Joints whose windings become states of their own.
const MOST_WOUND: usize = 3;
/// Times that the search is repeated because steps were not connected.
const REPEATS: usize = 30;
/// Room of the cap above the least peak speed.
const PEAK_SLACK: f64 = 1e-3;
/// How much more the peak speed counts than the cost, step by step, the first barrier of each, and the slope at its end.
const PEAK_WEIGHTS: [f64; 3] = [0.3, 3.0, 30.0];
const PEAK_BARRIER: f64 = 1e-2;
const PEAK_SLOPE: f64 = 1e-4;
/// Score of a line that breaks a limit: above that of any that does not.
const ILLEGAL: f64 = 1e12;
/// Times that a line is pulled back from limits that it breaks between its rows, and by how many times the excess.
const REPAIRS: usize = 2;
const REPAIR_MARGIN: f64 = 2.0;
/// The same for contact, m.
const REPAIR_ROOM: f64 = 3e-3;
