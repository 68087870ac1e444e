//! Why there is no continuous line: points without any configuration, or the fewest reconfigurations and what forces them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::demand::Demand;
use super::fill::fill;
use super::nodes::{NODE_SPACING, Nodes, posture};
use super::pull::{Pull, Puller, wind_into};
use super::push::Pusher;
use super::reach::Reach;
use super::refine::{Refinement, refine};
use super::report::Outcome;
use super::search::{Jump, Search, turns_round};
use crate::chain::JointKind;
use crate::joint_space::{TURN, nearest};
use crate::parallel::prelude::*;
use crate::path::{BlockedPoint, Reconfiguration};
use crate::scene::Nearby;
use crate::solutions::{SolutionsSettings, solutions};
use crate::status::Status;
use crate::tolerance::JOINT_JUMP;
use crate::watch::Watch;

/// What is said where no line was found over `nodes`.
///
/// `reach` are the places that no line passes, where that is known.
pub(super) fn without_line(demand: &Demand, nodes: Nodes, reach: &Reach, watch: &Watch) -> Outcome {
    let empty: Vec<usize> = (0..nodes.rows.len())
        .filter(|layer| nodes.q[*layer].is_empty())
        .map(|layer| nodes.rows[layer])
        .collect();
    let suspects = suspects(demand, &nodes, &empty);
    let blocked = blocked_points(demand, &suspects, watch);
    if !blocked.is_empty() {
        return Outcome::Blocked(blocked);
    }
    if let Some(why) = watch.interrupted() {
        return Outcome::Interrupted(None, why);
    }
    let gap = reach.breaks.first().map(|first| gap(first.unreached));
    match (with_jumps(demand, nodes, watch), gap) {
        (Outcome::Jumps { q, jumps, reason }, Some(gap)) => {
            Outcome::Jumps { q, jumps, reason: format!("{gap}; {reason}") }
        }
        (Outcome::Nothing(_) | Outcome::Interrupted(None, _), Some(gap)) => Outcome::Nothing(gap),
        (outcome, _) => outcome,
    }
}

/// What is said of the first point that no line comes to.
pub(super) fn gap(row: usize) -> String {
    format!(
        "no line exists, as far as samples every {NODE_SPACING} rad or m on the arcs of all solutions show: none of those \
         at point {row} is connected with one at point {} that a line from the start comes to",
        row - 1
    )
}

/// The verdicts on rows without a configuration within limits.
pub(super) fn blocked_points(demand: &Demand, rows: &[usize], watch: &Watch) -> Vec<BlockedPoint> {
    let point = |row: &usize| if watch.interrupted().is_some() { None } else { blocked(demand, *row) };
    rows.par_iter().filter_map(point).collect()
}

/// Whether the first point without states has no configuration, as far as random starts tell.
pub(super) fn is_blocked(demand: &Demand, nodes: &Nodes) -> bool {
    let empty = nodes.q.iter().position(Vec::is_empty);
    empty.is_some_and(|layer| blocked(demand, nodes.rows[layer]).is_some())
}

/// Rows that may have no configuration: around layers without states.
fn suspects(demand: &Demand, nodes: &Nodes, empty: &[usize]) -> Vec<usize> {
    let mut out = Vec::new();
    for row in empty {
        let layer = nodes.rows.iter().position(|r| r == row).unwrap_or(0);
        let first = if layer > 0 { nodes.rows[layer - 1] + 1 } else { 0 };
        let end = nodes.rows.get(layer + 1).copied().unwrap_or(demand.rows());
        out.extend(first..end);
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// The verdict on a row without states; `None` where it has a configuration after all.
fn blocked(demand: &Demand, row: usize) -> Option<BlockedPoint> {
    let point = |status: Status, reason: String| Some(BlockedPoint { row, status, reason });
    if let Some(task) = demand.tool.named().filter(|_| demand.spare() <= 1 && demand.tool.bounds() == 0) {
        let settings = SolutionsSettings { task, seed: demand.seed, ..SolutionsSettings::default() };
        let all = solutions(&demand.chain, &demand.targets[row].pose, &settings).ok()?;
        if demand.margin == 0.0 && all.status() != Status::Converged {
            return point(all.status(), all.reason());
        }
        if demand.margin == 0.0 || all.proven() {
            let states = super::nodes::states_of(demand, row, all.as_ref(), NODE_SPACING)?;
            return if states.is_empty() {
                point(
                    Status::Limits,
                    format!("no configuration keeps {} from the joint limits", demand.margin),
                )
            } else {
                let mut contact = Clearest::default();
                let mut pusher = Pusher::new(demand);
                let clear =
                    states.chunks_exact(demand.dof()).any(|q| contact.is_clear(demand, row, q, &mut pusher));
                if clear { None } else { point(Status::Collision, contact.reason(demand)) }
            };
        }
    }
    // A finite search: the nearest miss is an upper bound.
    let mut rng = ChaCha8Rng::seed_from_u64(demand.seed ^ row as u64);
    let mut puller = Puller::new(demand);
    let target = &demand.targets[row];
    let (mut miss, mut excess): (f64, Option<(f64, usize)>) = (f64::INFINITY, None);
    let (mut contact, mut pusher) = (Clearest::default(), Pusher::new(demand));
    for _ in 0..STARTS {
        let mut q = posture(demand, &mut rng);
        if !puller.pull_free(&mut q, target, &Pull::FAR) {
            let at = demand.chain.forward_unchecked(&q);
            miss = miss.min(demand.tool.error_of(&at, target)[0]);
            continue;
        }
        wind_into(&mut q, demand);
        let beyond = |i: usize| (demand.lower[i] - q[i]).max(q[i] - demand.upper[i]);
        let worst = (0..demand.dof()).map(|i| (beyond(i), i)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        if worst.0 <= 0.0 || puller.pull(&mut q, target, &Pull::FAR) {
            if contact.is_clear(demand, row, &q, &mut pusher) {
                return None;
            }
            continue;
        }
        if excess.is_none_or(|best| worst.0 < best.0) {
            excess = Some(worst);
        }
    }
    match excess {
        _ if contact.found.is_some() => point(Status::Collision, contact.reason(demand)),
        Some((excess, joint)) => point(
            Status::Limits,
            format!(
                "the best of {STARTS} starts leaves joint '{}' {excess:.4} rad or m outside [{:.4}, {:.4}]",
                demand.chain.joints()[joint].name,
                demand.lower[joint],
                demand.upper[joint]
            ),
        ),
        None => point(
            Status::Unreachable,
            format!("the best of {STARTS} starts ends {:.1} mm from the point", 1e3 * miss),
        ),
    }
}

/// The configuration of a row within limits that is the farthest from contact, among those that touch something.
#[derive(Default)]
struct Clearest {
    looked: usize,
    found: Option<Nearby>,
}

impl Clearest {
    /// Whether the configuration touches nothing, or can be pushed out of contact.
    fn is_clear(&mut self, demand: &Demand, row: usize, q: &[f64], pusher: &mut Pusher<'_>) -> bool {
        self.looked += 1;
        if demand.is_clear(row, q) {
            return true;
        }
        let Some(around) = &demand.around else { return true };
        let nearest = |q: &[f64]| around.nearest(q, demand.time[row])[0];
        let before = nearest(q).map_or(0.0, |near| near.gap.distance);
        if self.found.is_some_and(|best| before < best.gap.distance - MUCH_DEEPER) {
            return false;
        }
        let mut q = q.to_vec();
        if pusher.push(row, &mut q) {
            return true;
        }
        let near = nearest(&q);
        if let Some(near) = near
            && self.found.is_none_or(|best| near.gap.distance > best.gap.distance)
        {
            self.found = Some(near);
        }
        false
    }

    fn reason(&self, demand: &Demand) -> String {
        let Some((around, near)) = demand.around.as_ref().zip(self.found) else { return String::new() };
        format!(
            "the best of {} configurations within limits has {} {:.1} mm deep in each other",
            self.looked,
            around.names(near.first, near.second),
            -1e3 * near.gap.distance
        )
    }
}

/// Rows with the fewest reconfigurations.
fn with_jumps(demand: &Demand, nodes: Nodes, watch: &Watch) -> Outcome {
    let open = Demand { cyclic: false, ..demand.clone() };
    // A closed path is cut open: its last row is the one before the first.
    let demand = if demand.cyclic { &open.section(0, open.rows()) } else { demand };
    let mut nodes = with_windings(demand, nodes);
    for _ in 0..DENSER {
        let layers = demand.thinned(&nodes.rows);
        let mut search = Search::new(&layers, &nodes);
        for _ in 0..REPEATS {
            let Some((states, jumps)) = search.jumping_line() else {
                return Outcome::Nothing("the search found no line, not even with reconfigurations".into());
            };
            if watch.interrupted().is_some() {
                break;
            }
            match pieces(demand, &nodes, &states, &jumps) {
                Ok(q) => return assembled(demand, &search, &nodes, q, &jumps, watch),
                Err(Broken::Step(step, from, to)) => search.forbid(step, from, to),
                Err(Broken::Gap(layer)) => {
                    let rows = denser(&nodes.rows, layer);
                    let count = 2 * nodes.width(demand.dof());
                    nodes = with_windings(demand, Nodes::over(demand, rows, count, 1, watch));
                    break;
                }
            }
        }
    }
    match watch.interrupted() {
        Some(why) => Outcome::Interrupted(None, why),
        None => Outcome::Nothing("no continuous line was found, nor one with few reconfigurations".into()),
    }
}

/// States with the windings of the joints that can turn all the way round, last joints first: a line that winds one of them
/// up has to unwind it in a jump.
fn with_windings(demand: &Demand, nodes: Nodes) -> Nodes {
    let missing = |nodes: &Nodes, i: &usize| turns_round(demand, *i) && !nodes.wound.contains(i);
    let mut nodes = nodes;
    let mut factor = 1.0;
    for i in (0..demand.dof()).rev() {
        let turns = ((demand.upper[i] - demand.lower[i]) / TURN).ceil();
        if missing(&nodes, &i) && factor * turns <= MOST_WINDINGS {
            factor *= turns;
            nodes = nodes.with_windings(demand, i);
        }
    }
    nodes
}

/// Why a line with jumps does not hold.
enum Broken {
    /// A step that is not connected: its number, and its states.
    Step(usize, usize, usize),
    /// A jump over rows for which there is no layer.
    Gap(usize),
}

/// All rows of a line with jumps.
fn pieces(demand: &Demand, nodes: &Nodes, states: &[usize], jumps: &[Jump]) -> Result<Vec<f64>, Broken> {
    let n = demand.dof();
    let state = |layer: usize, state: usize| nodes.q[layer][state * n..(state + 1) * n].to_vec();
    let mut out: Vec<f64> = state(0, states[0]);
    for layer in 1..nodes.rows.len() {
        let (first, end) = (nodes.rows[layer - 1], nodes.rows[layer]);
        let jump = jumps.iter().find(|jump| jump.layer == layer);
        let arrived = match jump {
            None => states[layer],
            Some(Jump { before: Some(before), .. }) => *before,
            Some(Jump { before: None, .. }) => {
                if end > first + 1 {
                    return Err(Broken::Gap(layer));
                }
                out.extend(state(layer, states[layer]));
                continue;
            }
        };
        let mut q = state(layer - 1, states[layer - 1]);
        let mut to = state(layer, arrived);
        for i in (0..n).filter(|i| turns_round(demand, *i) && !nodes.wound.contains(i)) {
            to[i] = nearest(to[i], q[i]);
        }
        q.extend(to);
        let local = demand.section(first, end + 1);
        let inner: Vec<usize> = (0..=end - first).collect();
        let filled = fill(&local, &[0, end - first], &q, &inner)
            .map_err(|_| Broken::Step(layer - 1, states[layer - 1], arrived))?;
        out.extend_from_slice(&filled[n..filled.len() - n]);
        // Where the line jumps within the layer it goes on from the other state.
        out.extend(state(layer, states[layer]));
    }
    Ok(out)
}

/// The outcome of a line with jumps: each piece refined on its own.
fn assembled(
    demand: &Demand,
    search: &Search<'_>,
    nodes: &Nodes,
    q: Vec<f64>,
    jumps: &[Jump],
    watch: &Watch,
) -> Outcome {
    let n = demand.dof();
    let mut q = q;
    let rows: Vec<usize> = jumps.iter().map(|jump| nodes.rows[jump.layer]).filter(|row| *row > 0).collect();
    let ends: Vec<usize> = rows.iter().copied().chain([demand.rows()]).collect();
    let mut first = 0;
    for end in ends {
        if end > first + 1 {
            let part = demand.section(first, end);
            let how = Refinement { watch: Some(watch), slope: 1e-5, last_barrier: 1e-5, ..Refinement::FINE };
            if let Some(refined) = refine(&part, q[first * n..end * n].to_vec(), &how)
                && refined.is_legal()
            {
                q[first * n..end * n].copy_from_slice(&refined.q);
            }
        }
        first = end;
    }
    let jumps: Vec<Reconfiguration> = rows
        .iter()
        .map(|row| Reconfiguration { row: *row, reason: step_too_far(demand, &q, *row) })
        .collect();
    let farthest = search.farthest();
    let where_to = match nodes.rows.get(farthest + 1) {
        Some(next) => {
            format!("no line from the start continues from point {} to point {next}", nodes.rows[farthest])
        }
        None => "the steps that were found are not connected".to_owned(),
    };
    let found = match &jumps[..] {
        [] => "a line without reconfigurations exists, but none was found that keeps all limits".to_owned(),
        _ => format!("{}; {where_to}", sum_up(&jumps)),
    };
    let reason =
        format!("{found} (searched: {} states at each of {} points)", nodes.width(n), nodes.rows.len());
    Outcome::Jumps { q, jumps, reason }
}

/// By how much the joints would have to step to a row.
pub(super) fn step_too_far(demand: &Demand, q: &[f64], row: usize) -> String {
    let n = demand.dof();
    let step = |i: usize| q[row * n + i] - q[(row - 1) * n + i];
    let worst = (0..n).map(|i| (step(i), i)).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let Some((d, i)) = worst else { return String::new() };
    let (bound, joint) = (demand.step_bound[(row - 1) * n + i], &demand.chain.joints()[i]);
    let (unit, turns) = if joint.kind == JointKind::Prismatic { ("m", false) } else { ("rad", true) };
    let why =
        if turns && bound >= JOINT_JUMP { "a continuous step is at most" } else { "its speed limit allows" };
    format!("joint '{}' would have to step {:.4} {unit}, {why} {bound:.4} {unit}", joint.name, d.abs())
}

/// How many reconfigurations there are, and where the first one is.
pub(super) fn sum_up(jumps: &[Reconfiguration]) -> String {
    match jumps {
        [] => "no reconfiguration is needed".to_owned(),
        [only] => format!("1 reconfiguration is needed, before point {}: {}", only.row, only.reason),
        [first, ..] => format!(
            "{} reconfigurations are needed, the first one before point {}: {}",
            jumps.len(),
            first.row,
            first.reason
        ),
    }
}

/// The rows with all of those in the gap before a layer.
fn denser(rows: &[usize], layer: usize) -> Vec<usize> {
    let (first, end) = (rows[layer - 1], rows[layer]);
    let mut out = rows.to_vec();
    out.extend(first + 1..end);
    out.sort_unstable();
    out.dedup();
    out
}

/// Depth, m, beyond the best configuration so far from which pushing is not tried.
const MUCH_DEEPER: f64 = 5e-3;
/// Random starts of a verdict on a point.
const STARTS: usize = 1_000;
/// Most windings that are checked for each state.
const MOST_WINDINGS: f64 = 8.0;
/// Times that layers are added where a line jumps.
const DENSER: usize = 12;
/// Times that the search is repeated because steps are not connected.
const REPEATS: usize = 200;
