//! Dynamic programming over the states of a path: the cheapest lines that differ from each other.
//!
//! A step between states costs what the straight joint motion costs; one that is faster than the joints may be does not
//! exist. Joints that can turn all the way round go the short way, and the line is put into its limits at the end.
//! Costs to come and to go give the best line through every state, from which some different ones are taken, one of each
//! valley at least: the first line of a search on states is often not in the best basin.

use super::demand::Demand;
use super::nodes::Nodes;
use crate::joint_space::{TURN, shift, wrap};
use crate::parallel::prelude::*;

/// A line through the states.
#[derive(Debug, Clone)]
pub(super) struct Line {
    /// State of each layer.
    pub states: Vec<usize>,
    /// Configurations, windings continuous.
    pub q: Vec<f64>,
}

/// What [`Search::lines`] finds.
#[derive(Debug, Clone, Default)]
pub(super) struct Lines {
    pub lines: Vec<Line>,
    /// Joints that wind out of their limits along lines that were left out.
    pub wound: Vec<usize>,
}

/// Whether a joint can turn all the way round.
pub(super) fn turns_round(demand: &Demand, joint: usize) -> bool {
    demand.chain.steps()[joint].rotational && demand.upper[joint] - demand.lower[joint] >= TURN
}

/// The graph of states and steps.
pub(super) struct Search<'a> {
    /// The problem on the layers.
    demand: &'a Demand,
    nodes: &'a Nodes,
    node_cost: Vec<Vec<f32>>,
    /// Cost of each step, `from * (states after) + to`.
    edges: Vec<Vec<f32>>,
    /// Joints that can turn all the way round.
    round: Vec<bool>,
}

impl<'a> Search<'a> {
    /// The graph; `demand` is the problem on the rows of `nodes`.
    pub fn new(demand: &'a Demand, nodes: &'a Nodes) -> Self {
        let n = demand.dof();
        let round: Vec<bool> = (0..n).map(|i| turns_round(demand, i) && !nodes.wound.contains(&i)).collect();
        let node_cost = (nodes.q.par_iter().enumerate())
            .map(|(layer, q)| q.chunks_exact(n).map(|q| demand.row_cost(layer, q) as f32).collect())
            .collect();
        let edges = (0..demand.steps())
            .into_par_iter()
            .map(|step| edge_costs(demand, step, &nodes.q[step], &nodes.q[demand.after(step)], &round))
            .collect();
        Self { demand, nodes, node_cost, edges, round }
    }

    /// Number of states of a layer.
    fn states(&self, layer: usize) -> usize {
        self.node_cost[layer].len()
    }

    /// Takes a step out of the graph.
    pub fn forbid(&mut self, step: usize, from: usize, to: usize) {
        let width = self.states(self.demand.after(step));
        self.edges[step][from * width + to] = f32::INFINITY;
    }

    /// Takes the states within a distance (rad or m) of a configuration out of a layer.
    pub fn avoid(&mut self, layer: usize, q: &[f64], radius: f64) {
        let states = self.nodes.q[layer].chunks_exact(self.demand.dof());
        let costs: Vec<f32> = (self.node_cost[layer].iter().zip(states))
            .map(|(cost, state)| {
                let square: f64 =
                    state.iter().zip(q).enumerate().map(|(i, (a, b))| self.short(i, a - b).powi(2)).sum();
                if square < radius * radius { f32::INFINITY } else { *cost }
            })
            .collect();
        self.node_cost[layer] = costs;
    }

    /// Up to `count` cheapest lines that differ, and the joints that wind out of their limits along others.
    pub fn lines(&self, count: usize) -> Lines {
        if self.node_cost.iter().any(Vec::is_empty) {
            return Lines::default();
        }
        if self.demand.cyclic { self.closed_lines(count) } else { self.open_lines(count) }
    }

    fn open_lines(&self, count: usize) -> Lines {
        let layers = self.node_cost.len();
        let mut to_come = vec![self.node_cost[0].clone()];
        for step in 0..layers - 1 {
            let next = self.forward(step, &to_come[step]);
            to_come.push(next);
        }
        let mut to_go = vec![vec![0.0; self.states(layers - 1)]];
        for step in (0..layers - 1).rev() {
            let previous = self.backward(step, &to_go[to_go.len() - 1]);
            to_go.push(previous);
        }
        to_go.reverse();
        let mut order: Vec<(f32, usize, usize)> = (0..layers)
            .into_par_iter()
            .flat_map_iter(|layer| self.valleys(layer, &to_come[layer], &to_go[layer]))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let Some(best) = order.first().map(|entry| entry.0) else { return Lines::default() };
        let mut out = Lines::default();
        let mut seen: Vec<Vec<bool>> = (0..layers).map(|layer| vec![false; self.states(layer)]).collect();
        for (cost, layer, state) in order {
            if out.lines.len() >= count || cost > COST_WINDOW * best + f32::MIN_POSITIVE {
                break;
            }
            if seen[layer][state] {
                continue;
            }
            let states = self.through(layer, state, &to_come, &to_go);
            for (layer, state) in states.iter().enumerate() {
                seen[layer][*state] = true;
            }
            self.push_if_new(&mut out, states);
        }
        out
    }

    /// States of a layer through which a line is cheaper than through any state near by: each valley of the costs shows as one
    /// of them at some layer, however flat the bottom of the deepest one is.
    fn valleys(&self, layer: usize, come: &[f32], go: &[f32]) -> Vec<(f32, usize, usize)> {
        let n = self.demand.dof();
        let through: Vec<f32> = come.iter().zip(go).map(|(a, b)| a + b).collect();
        let at = |state: usize| &self.nodes.q[layer][state * n..(state + 1) * n];
        let mut order: Vec<usize> = (0..through.len()).filter(|state| through[*state].is_finite()).collect();
        order.sort_by(|a, b| through[*a].total_cmp(&through[*b]).then(a.cmp(b)));
        let near = |a: usize, b: usize| {
            let mut square = 0.0;
            at(a).iter().zip(at(b)).enumerate().all(|(i, (a, b))| {
                square += self.short(i, a - b).powi(2);
                square < VALLEY * VALLEY
            })
        };
        (0..order.len())
            .filter(|i| !order[..*i].iter().any(|cheaper| near(*cheaper, order[*i])))
            .map(|i| (through[order[i]], layer, order[i]))
            .collect()
    }

    /// The cheapest line among those with the fewest jumps from state to state, open at its ends, with the layers at which it
    /// jumps: within a layer, or between two layers that no step connects.
    pub fn jumping_line(&self) -> Option<(Vec<usize>, Vec<Jump>)> {
        let layers = self.node_cost.len();
        let mut tables: Vec<Vec<Reached>> = Vec::with_capacity(layers);
        for layer in 0..layers {
            let costs = &self.node_cost[layer];
            let mut table = vec![Reached::NEVER; costs.len()];
            let mut through_gap = None;
            match layer.checked_sub(1) {
                None => {
                    for (entry, cost) in table.iter_mut().zip(costs) {
                        *entry = Reached { jumps: 0, cost: *cost, from: Arrival::Start };
                    }
                }
                Some(step) => {
                    let before = &tables[step];
                    let width = costs.len();
                    for (state, row) in self.edges[step].chunks_exact(width.max(1)).enumerate() {
                        for (to, edge) in row.iter().enumerate() {
                            if edge.is_finite() {
                                let cost = before[state].cost + edge + costs[to];
                                table[to].improve(before[state].jumps, cost, Arrival::Step(state));
                            }
                        }
                    }
                    through_gap = best_of(before);
                }
            }
            // Either a jump to any state of this layer, or one over the gap before it.
            if let Some(best) = best_of(&table) {
                let Reached { jumps, cost, .. } = table[best];
                for state in 0..table.len() {
                    table[state].improve(jumps + 1, cost + costs[state], Arrival::Within(best));
                }
            } else if let (Some(best), Some(step)) = (through_gap, layer.checked_sub(1)) {
                let Reached { jumps, cost, .. } = tables[step][best];
                for state in 0..table.len() {
                    table[state].improve(jumps + 1, cost + costs[state], Arrival::Gap(best));
                }
            }
            tables.push(table);
        }
        self.traced(&tables)
    }

    fn traced(&self, tables: &[Vec<Reached>]) -> Option<(Vec<usize>, Vec<Jump>)> {
        let layers = tables.len();
        let mut state = best_of(&tables[layers - 1])?;
        let mut states = vec![state; layers];
        let mut jumps = Vec::new();
        for layer in (0..layers).rev() {
            states[layer] = state;
            if let Arrival::Within(before) = tables[layer][state].from {
                jumps.push(Jump { layer, before: Some(before) });
                state = before;
            }
            match tables[layer][state].from {
                Arrival::Start => {}
                Arrival::Step(before) => state = before,
                Arrival::Gap(before) => {
                    jumps.push(Jump { layer, before: None });
                    state = before;
                }
                // A jump leads to a state that was reached by a step.
                Arrival::Within(_) => return None,
            }
        }
        jumps.reverse();
        Some((states, jumps))
    }

    /// The last layer that a line without jumps comes to.
    pub fn farthest(&self) -> usize {
        let mut reached = vec![0.0f32; self.states(0)];
        for step in 0..self.node_cost.len() - 1 {
            if self.states(step + 1) == 0 {
                return step;
            }
            reached = self.forward(step, &reached);
            if reached.iter().all(|cost| !cost.is_finite()) {
                return step;
            }
        }
        self.node_cost.len() - 1
    }

    /// The best line through a state.
    fn through(&self, layer: usize, state: usize, come: &[Vec<f32>], go: &[Vec<f32>]) -> Vec<usize> {
        let layers = self.node_cost.len();
        let mut states = vec![state; layers];
        for step in (0..layer).rev() {
            let (to, width) = (states[step + 1], self.states(step + 1));
            let cost = |from: usize| come[step][from] + self.edges[step][from * width + to];
            states[step] = least(self.states(step), cost);
        }
        for step in layer..layers - 1 {
            let (from, width) = (states[step], self.states(step + 1));
            let cost = |to: usize| {
                self.edges[step][from * width + to] + self.node_cost[step + 1][to] + go[step + 1][to]
            };
            states[step + 1] = least(width, cost);
        }
        states
    }

    /// Lines that end in the state in which they began.
    fn closed_lines(&self, count: usize) -> Lines {
        let layers = self.node_cost.len();
        let found: Vec<(f32, Vec<usize>)> = (0..self.states(0))
            .into_par_iter()
            .filter_map(|start| {
                let mut first = vec![f32::INFINITY; self.states(0)];
                first[start] = self.node_cost[0][start];
                let mut come = vec![first];
                for step in 0..layers - 1 {
                    let next = self.forward(step, &come[step]);
                    come.push(next);
                }
                let width = self.states(0);
                let last = &self.edges[layers - 1];
                let cost = |from: usize| come[layers - 1][from] + last[from * width + start];
                let end = least(self.states(layers - 1), cost);
                let total = cost(end);
                if !total.is_finite() {
                    return None;
                }
                let mut states = vec![end; layers];
                for step in (0..layers - 1).rev() {
                    let (to, width) = (states[step + 1], self.states(step + 1));
                    let cost = |from: usize| come[step][from] + self.edges[step][from * width + to];
                    states[step] = least(self.states(step), cost);
                }
                Some((total, states))
            })
            .collect();
        let mut order: Vec<usize> = (0..found.len()).collect();
        order.sort_by(|a, b| found[*a].0.total_cmp(&found[*b].0).then(a.cmp(b)));
        let mut out = Lines::default();
        for i in order {
            if out.lines.len() >= count {
                break;
            }
            self.push_if_new(&mut out, found[i].1.clone());
        }
        out
    }

    /// Adds a line that lies within its limits and away from the others.
    fn push_if_new(&self, out: &mut Lines, states: Vec<usize>) {
        let q = match self.unwound(&states) {
            Ok(q) => q,
            Err(joint) => {
                if !out.wound.contains(&joint) {
                    out.wound.push(joint);
                }
                return;
            }
        };
        // Two lines may go the two ways round something on a short part of the path.
        let n = self.demand.dof();
        let apart = |other: &Line| {
            (q.chunks_exact(n).zip(other.q.chunks_exact(n))).any(|(a, b)| {
                let square: f64 =
                    (a.iter().zip(b).enumerate()).map(|(i, (a, b))| self.short(i, a - b).powi(2)).sum();
                square > APART * APART
            })
        };
        if out.lines.iter().all(apart) {
            out.lines.push(Line { states, q });
        }
    }

    fn short(&self, joint: usize, d: f64) -> f64 {
        if self.round[joint] { wrap(d) } else { d }
    }

    /// Configurations of a line with continuous windings inside the limits; the joint that leaves them.
    fn unwound(&self, states: &[usize]) -> Result<Vec<f64>, usize> {
        let n = self.demand.dof();
        let mut q = Vec::with_capacity(states.len() * n);
        for (layer, state) in states.iter().enumerate() {
            let at = &self.nodes.q[layer][state * n..(state + 1) * n];
            for i in 0..n {
                let value = match layer.checked_sub(1) {
                    Some(before) => {
                        let before: f64 = q[before * n + i];
                        before + self.short(i, at[i] - before)
                    }
                    None => at[i],
                };
                q.push(value);
            }
        }
        for i in (0..n).filter(|i| self.round[*i]) {
            let column = || q.iter().skip(i).step_by(n);
            let (least, most) =
                column().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(*q), b.max(*q)));
            if self.demand.cyclic {
                let (first, last) = (q[i], q[q.len() - n + i]);
                if (first - last).abs() > std::f64::consts::PI {
                    return Err(i);
                }
            }
            let given = self.demand.first.is_some() || self.demand.last.is_some();
            let [middle, half] = self.demand.range[i];
            let off = if half > 0.0 && !given { shift(0.5 * (least + most) - middle) } else { 0.0 };
            q.iter_mut().skip(i).step_by(n).for_each(|q| *q -= off);
            let (least, most) = (least - off, most - off);
            if least < self.demand.lower[i] - WINDING_SLACK || most > self.demand.upper[i] + WINDING_SLACK {
                return Err(i);
            }
        }
        Ok(q)
    }

    fn forward(&self, step: usize, come: &[f32]) -> Vec<f32> {
        let width = self.states(step + 1);
        let mut next = vec![f32::INFINITY; width];
        for (from, row) in come.iter().zip(self.edges[step].chunks_exact(width)) {
            if from.is_finite() {
                for (next, edge) in next.iter_mut().zip(row) {
                    let cost = from + edge;
                    *next = if cost < *next { cost } else { *next };
                }
            }
        }
        next.iter_mut().zip(&self.node_cost[step + 1]).for_each(|(next, node)| *next += node);
        next
    }

    fn backward(&self, step: usize, go: &[f32]) -> Vec<f32> {
        let width = self.states(step + 1);
        let rest: Vec<f32> = go.iter().zip(&self.node_cost[step + 1]).map(|(a, b)| a + b).collect();
        self.edges[step]
            .chunks_exact(width)
            .map(|row| row.iter().zip(&rest).fold(f32::INFINITY, |least, (a, b)| least.min(a + b)))
            .collect()
    }
}

/// A place where a line jumps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Jump {
    /// The layer at which the line goes on.
    pub layer: usize,
    /// The state of the same layer from which it jumps; `None` where it jumps over the gap before the layer.
    pub before: Option<usize>,
}

/// How a state is reached with the fewest jumps.
#[derive(Debug, Clone, Copy)]
struct Reached {
    jumps: u32,
    cost: f32,
    from: Arrival,
}

#[derive(Debug, Clone, Copy)]
enum Arrival {
    Start,
    Step(usize),
    Within(usize),
    Gap(usize),
}

impl Reached {
    const NEVER: Self = Self { jumps: u32::MAX, cost: f32::INFINITY, from: Arrival::Start };

    fn improve(&mut self, jumps: u32, cost: f32, from: Arrival) {
        if cost.is_finite() && (jumps < self.jumps || (jumps == self.jumps && cost < self.cost)) {
            *self = Self { jumps, cost, from };
        }
    }
}

fn best_of(table: &[Reached]) -> Option<usize> {
    let reached = table.iter().enumerate().filter(|(_, entry)| entry.cost.is_finite());
    reached
        .min_by(|(_, a), (_, b)| a.jumps.cmp(&b.jumps).then(a.cost.total_cmp(&b.cost)))
        .map(|(state, _)| state)
}

/// Costs of all steps between two layers.
fn edge_costs(demand: &Demand, step: usize, from: &[f64], to: &[f64], round: &[bool]) -> Vec<f32> {
    let n = demand.dof();
    let (rows, width) = (from.len() / n, to.len() / n);
    // Joint by joint, so that the inner loop runs over states.
    let columns: Vec<Vec<f32>> =
        (0..n).map(|i| to.iter().skip(i).step_by(n).map(|q| *q as f32).collect()).collect();
    let mut out = vec![0f32; rows * width];
    let (share, turn) = (demand.step_share[step], TURN as f32);
    for (from, out) in from.chunks_exact(n).zip(out.chunks_exact_mut(width.max(1))) {
        for i in 0..n {
            let weight = (demand.motion_weight.max(LEAST_MOTION) * demand.joint_weight[i] / share) as f32;
            let bound = (demand.step_bound[step * n + i] * STEP_SLACK) as f32;
            let a = from[i] as f32;
            let fast = |d: f32| if d.abs() > bound { f32::INFINITY } else { weight * d * d };
            if round[i] {
                for (out, b) in out.iter_mut().zip(&columns[i]) {
                    let d = b - a;
                    *out += fast(d - turn * (d * (1.0 / turn)).round_ties_even());
                }
            } else {
                for (out, b) in out.iter_mut().zip(&columns[i]) {
                    *out += fast(b - a);
                }
            }
        }
    }
    out
}

fn least(count: usize, cost: impl Fn(usize) -> f32) -> usize {
    let mut best = (f32::INFINITY, 0);
    for i in 0..count {
        let cost = cost(i);
        if cost < best.0 {
            best = (cost, i);
        }
    }
    best.1
}

/// Lines that cost more than this many times the best are not refined.
const COST_WINDOW: f32 = 2.0;
/// Distance (rad) at some point at which two lines differ.
const APART: f64 = 0.5;
/// Distance (rad) within which states belong to one valley of the costs.
const VALLEY: f64 = 0.5;
/// States may leave the limits by this much through their windings, rad.
const WINDING_SLACK: f64 = 1e-9;
/// States do not lie exactly on the best line: a step may exceed its bound by this factor.
const STEP_SLACK: f64 = 1.1;
/// Motion weight at least, in the search: without any the states would not hang together.
const LEAST_MOTION: f64 = 1e-6;
