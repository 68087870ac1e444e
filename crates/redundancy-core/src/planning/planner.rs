//! Whole paths: any arm, any freedom, all points at once.
//!
//! # Method
//! 1. **States** over a few points of the path, sampled evenly in joint space and carried from point to point ([`nodes`]).
//! 2. **Search** by dynamic programming over all pairs of neighbouring states, with the joint speeds as limits; a
//!    handful of lines that differ ([`search`]). Steps that turn out not to be connected are taken out, and the search is
//!    repeated.
//! 3. **Refinement** of each line on more points, of the best ones on all of them, to a local optimum ([`refine`]).
//! 4. **Verification** of what is returned.

use super::demand::{Demand, Objective, PlanSettings};
use super::fill::fill;
use super::nodes::Nodes;
use super::refine::{Goal, Refined, Refinement, refine};
use super::search::{Line, Search};
use crate::chain::Chain;
use crate::error::Result;
use crate::parallel::prelude::*;
use crate::path::{Path, Plan, PlanBuilder, TimingSettings, Trajectory, times_within_limits};
use crate::status::Status;
use crate::tolerance::FREE_SPEED;
use crate::watch::Watch;

/// Plans a path for any chain, with any freedom of the tool.
///
/// # Errors
/// Settings out of their range, a freedom that does not apply, ends that are not on the path, a closed plan of an open
/// path.
pub fn plan(chain: &Chain, path: &Path, settings: &PlanSettings, watch: &Watch) -> Result<Plan> {
    let demand = Demand::new(chain, path, settings)?;
    let line = solve(&demand, watch);
    finish(&demand, path, line)
}

/// What the planner found.
enum Outcome {
    Line(Box<Refined>),
    Nothing(String),
}

fn solve(demand: &Demand, watch: &Watch) -> Outcome {
    let rows = demand.even_rows(layer_count(demand));
    let nodes = Nodes::sample(demand, rows.clone(), state_count(demand));
    let _ = watch.report(0.2);
    if let Some(empty) = nodes.q.iter().position(Vec::is_empty) {
        return Outcome::Nothing(format!("no configuration was found over point {}", rows[empty]));
    }
    let layers = demand.thinned(&rows);
    let middle = subdivided(demand, &rows, MIDDLE_ROWS);
    let mut search = Search::new(&layers, &nodes);
    let lines = connected_lines(demand, &mut search, &rows, &middle);
    let _ = watch.report(0.4);
    if lines.is_empty() {
        return Outcome::Nothing("no continuous line was found".into());
    }
    let coarse = demand.thinned(&middle);
    let mut refined: Vec<Refined> =
        lines.into_par_iter().filter_map(|line| minimise(&coarse, line, &COARSE)).collect();
    let _ = watch.report(0.7);
    refined.sort_by(|a, b| score(&coarse, a).total_cmp(&score(&coarse, b)));
    let all: Vec<usize> = (0..demand.rows()).collect();
    let mut best: Option<Refined> = None;
    for (k, line) in distinct(&coarse, refined).into_iter().enumerate() {
        if k >= FINE_LINES && best.as_ref().is_some_and(|best| best.violation <= LEGAL) {
            break;
        }
        let Ok(q) = fill(demand, &middle, &line.q, &all) else { continue };
        let Some(line) = minimise(demand, q, &FINE) else { continue };
        if best.as_ref().is_none_or(|best| score(demand, &line) < score(demand, best)) {
            best = Some(line);
        }
    }
    best.map_or_else(
        || Outcome::Nothing("the refinement failed".into()),
        |line| Outcome::Line(Box::new(line)),
    )
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

/// Lines of the search that are connected, on the rows `middle`.
fn connected_lines(
    demand: &Demand,
    search: &mut Search<'_>,
    rows: &[usize],
    middle: &[usize],
) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for _ in 0..REPEATS {
        let lines = search.lines(LINES);
        let filled: Vec<(Line, std::result::Result<Vec<f64>, usize>)> = (lines.into_par_iter())
            .map(|line| {
                let filled = fill(demand, rows, &line.q, middle);
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
        if total == 0 || out.len() == total {
            break;
        }
    }
    out
}

/// Refines a line towards the objective.
fn minimise(demand: &Demand, q: Vec<f64>, how: &Refinement) -> Option<Refined> {
    if demand.objective != Objective::PeakSpeed {
        return refine(demand, q, how);
    }
    let mut peak = refine(demand, q, how)?;
    for weight in PEAK_WEIGHTS {
        peak =
            refine(demand, peak.q, &Refinement { goal: Goal::Peak(weight), barrier: PEAK_BARRIER, ..*how })?;
    }
    let cap = demand.peak_speed(&peak.q) * (1.0 + PEAK_SLACK);
    refine(demand, peak.q, &Refinement { goal: Goal::Capped(cap), ..*how })
}

/// What lines are compared by: illegal ones come last.
fn score(demand: &Demand, line: &Refined) -> f64 {
    let cost = match demand.objective {
        Objective::PeakSpeed => demand.peak_speed(&line.q) * (1.0 + 1e-6 * line.cost),
        _ => line.cost,
    };
    cost + if line.violation > LEGAL { 1e9 * (1.0 + line.violation) } else { 0.0 }
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

/// Every gap between `rows` cut into up to `parts`.
fn subdivided(demand: &Demand, rows: &[usize], parts: usize) -> Vec<usize> {
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

fn finish(demand: &Demand, path: &Path, outcome: Outcome) -> Result<Plan> {
    let names: Vec<String> = demand.chain.joints().iter().map(|j| j.name.clone()).collect();
    let line = match outcome {
        Outcome::Line(line) => line,
        Outcome::Nothing(reason) => {
            return PlanBuilder::without_rows(names, Status::Infeasible)?.reason(reason).build();
        }
    };
    let n = demand.dof();
    let mut q = line.q.clone();
    if demand.cyclic {
        q.extend_from_within(..n);
    }
    let t = times(demand, path, &q)?;
    let trajectory = Trajectory::new(names, t, q.clone(), None, Vec::new())?;
    let legal = line.violation <= LEGAL;
    let status = if !legal {
        Status::Infeasible
    } else if line.converged {
        Status::Converged
    } else {
        Status::IterationLimit
    };
    let mut builder = PlanBuilder::new(trajectory, status).legal(legal).cost(demand.cost(&line.q));
    if !legal {
        builder = builder.reason(format!("the best line breaks a limit by {:.3e}", line.violation));
    } else if !line.converged {
        builder = builder.reason(format!(
            "the refinement stopped after {} iterations with a slope of {:.1e}",
            line.iterations, line.slope
        ));
    }
    let rows = q.len() / n;
    let poses: Vec<_> = q.chunks_exact(n).map(|q| demand.chain.forward_unchecked(q)).collect();
    let target = |row: usize| &demand.targets[row % demand.rows()];
    if demand.tool.oriented() || path.has_orientation() {
        let tilt = (0..rows).map(|row| demand.tool.tilt_of(&poses[row], target(row))).collect();
        let mut spin: Vec<f64> = (0..rows).map(|row| demand.tool.spin_of(&poses[row], target(row))).collect();
        for k in 1..rows {
            spin[k] = spin[k - 1] + crate::joint_space::wrap(spin[k] - spin[k - 1]);
        }
        builder = builder.tilt(tilt).spin(spin);
    }
    builder.s(path.s().to_vec()).margin_of(&demand.chain)?.poses(poses).build()
}

fn times(demand: &Demand, path: &Path, q: &[f64]) -> Result<Vec<f64>> {
    if let Some(steps) = &demand.step_time {
        let first = path.t().map_or(0.0, |t| t[0]);
        let mut t = vec![first];
        for step in steps {
            t.push(t[t.len() - 1] + step);
        }
        return Ok(t);
    }
    let speed = |v: f64| if v.is_finite() { v } else { FREE_SPEED };
    let limits: Vec<f64> = demand.chain.joints().iter().map(|j| speed(j.limits.velocity)).collect();
    times_within_limits(q, &limits, TimingSettings::default())
}

const COARSE: Refinement = Refinement {
    goal: Goal::Cost,
    barrier: 1e-1,
    last_barrier: 1e-5,
    slope: 1e-4,
    iterations: 60,
    deadline: None,
};
const FINE: Refinement = Refinement {
    goal: Goal::Cost,
    barrier: 1e-3,
    last_barrier: 1e-7,
    slope: 1e-7,
    iterations: 100,
    deadline: None,
};
/// Layers of the search, and the distance of the tool between them, m.
const LEAST_LAYERS: usize = 32;
const MOST_LAYERS: usize = 200;
const LAYER_DISTANCE: f64 = 0.3;
/// Rows between layers on which lines are refined first.
const MIDDLE_ROWS: usize = 6;
/// Lines that are refined on some rows, and on all.
const LINES: usize = 8;
const FINE_LINES: usize = 2;
/// Root mean square distance (rad) below which two refined lines are the same.
const SAME_LINE: f64 = 0.02;
/// Times that the search is repeated because steps were not connected.
const REPEATS: usize = 30;
/// Room of the cap above the least peak speed.
const PEAK_SLACK: f64 = 1e-3;
/// How much more the peak speed counts than the cost, step by step, and the first barrier of each.
const PEAK_WEIGHTS: [f64; 3] = [0.3, 3.0, 30.0];
const PEAK_BARRIER: f64 = 1e-2;
/// Violation (rad or m) that rounding explains.
const LEGAL: f64 = 1e-9;
