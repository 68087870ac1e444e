//! The line of least cost on the grid points x branches x swivels x windings.
//!
//! Each branch is searched on its own: without a reconfiguration nothing leads from one to another. Eight swivels are
//! looked at together, from every swivel that a step may come from; nodes and costs are kept by joint, so that this is
//! plain arithmetic on rows of numbers. Of where a state came from only the offset is kept, a byte; windings follow from
//! the joint positions.

use std::f64::consts::PI;

use super::problem::{Line, Problem, turns_between};
use crate::joint_space::{TURN, nearest, turned, wrap};
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;
use crate::watch::{Interrupted, WatchPart};

/// Swivels that are looked at together.
const LANES: usize = 8;
/// Points whose nodes are in memory at once.
const BLOCK: usize = 64;
/// Codes above which there are only an eighth as many: nodes are large then.
const MANY_CODES: usize = 16;
/// Offsets up to which a step may end in every cell; beyond, in every fifth more.
const DENSE: usize = 10;
/// Most states of the first point from which a closed line is tried.
const CLOSED_STARTS: usize = 12;
/// Searches after which steps between all points are looked at, not only those that were found to touch.
const LAZY_SEARCHES: usize = 8;
/// Part of the work that is done when the last point is reached; the rest is the refinement.
const SEARCH_SHARE: f64 = 0.9;
/// Where a state came from: not at all, from the start, or by a reconfiguration; else the number of the offset.
const NONE: u8 = 255;
const START: u8 = 254;
const JUMP: u8 = 253;

/// A line, or none where there is none; or why the search ended early.
type Found = Result<Option<Line>, Interrupted>;

/// A state of one point: position of the branch in [`Problem::branches`], cell, code of the windings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::planning) struct State {
    branch: usize,
    cell: usize,
    code: usize,
}

/// All nodes of a point. Rows of cells have `pad` more on both sides, which repeat the circle.
pub(in crate::planning) struct Layer {
    /// Nodes off the grid, in arcs that are narrower than a cell: branch, cell, swivel.
    narrow: Vec<(usize, usize, f64)>,
    /// By branch, joint, cell: positions, wound where only one winding holds the limits.
    q: Vec<f64>,
    /// By branch, code, cell: the cost of being there, infinite where limits or obstacles forbid it.
    cost: Vec<f64>,
    /// By branch and cell: distance from the obstacles.
    distance: Vec<f64>,
    /// By branch: the codes that are alive somewhere.
    codes: Vec<Vec<usize>>,
}

/// The search over one branch.
struct Row {
    cost: Vec<f64>,
    /// The least of `cost` over the codes.
    floor: Vec<f64>,
    came: Vec<Vec<u8>>,
}

/// What a search remembers for the way back besides its rows.
#[derive(Default)]
struct Walk {
    /// By point: the nodes off the grid.
    narrow: Vec<Vec<(usize, usize, f64)>>,
    /// By point: the state from which reconfigurations start.
    cheapest: Vec<State>,
}

/// The grid of a problem.
pub(in crate::planning) struct Grid<'a> {
    problem: &'a Problem<'a>,
    cells: usize,
    offsets: Vec<isize>,
    pad: usize,
    stride: usize,
}

impl<'a> Grid<'a> {
    /// A grid of `cells`, on which a step may turn the swivel by `reach` (rad).
    pub fn new(problem: &'a Problem<'a>, cells: usize, reach: f64) -> Self {
        let most = ((reach / TURN * cells as f64).ceil() as usize).min(cells / 2);
        let mut offsets = vec![0];
        let mut offset = 1;
        while offset <= most && cells > 1 {
            offsets.extend([offset as isize, -(offset as isize)]);
            offset = if offset < DENSE { offset + 1 } else { (offset * 5).div_ceil(4) };
        }
        let pad = most + LANES;
        Self { problem, cells, offsets, pad, stride: cells + 2 * pad }
    }

    fn rows(&self) -> usize {
        self.problem.branches.len()
    }

    fn codes(&self) -> usize {
        self.problem.windings.total
    }

    /// Swivel of a cell at point `k`.
    fn angle(&self, k: usize, cell: usize) -> f64 {
        self.problem.fixed(k).unwrap_or(TURN * (cell as f64 / self.cells as f64 - 0.5))
    }

    /// Repeats the circle on both sides of a row.
    fn wrap(&self, row: &mut [f64]) {
        for p in 0..self.pad {
            let before = (p + self.cells * self.pad - self.pad) % self.cells;
            row[p] = row[self.pad + before];
            row[self.pad + self.cells + p] = row[self.pad + p % self.cells];
        }
    }

    /// All nodes of point `k`.
    fn layer(&self, k: usize, scratch: &mut Scratch) -> Layer {
        let (problem, cells, codes) = (self.problem, self.cells, self.codes());
        let rows = self.rows();
        let circle = &problem.circles[k];
        let mut layer = Layer {
            narrow: Vec::new(),
            q: vec![0.0; rows * 7 * self.stride],
            cost: vec![f64::INFINITY; rows * codes * self.stride],
            distance: vec![f64::INFINITY; rows * cells],
            codes: vec![Vec::new(); rows],
        };
        let mut alive = vec![0u8; cells];
        for cell in 0..cells {
            let s = self.angle(k, cell);
            let allowed = circle.allowed(s);
            if allowed == 0 {
                continue;
            }
            let all = circle.all_branches(s);
            let mut distances = None;
            for (row, branch) in problem.branches.iter().enumerate() {
                if allowed & (1 << branch) != 0 {
                    let distances = distances.get_or_insert_with(|| problem.distances(k, s, &all, scratch));
                    self.put(&mut layer, k, (row, cell), s, &all[*branch], distances[*branch], scratch);
                    alive[cell] |= 1 << branch;
                }
            }
        }
        if cells > 1 {
            self.narrow(k, &mut layer, &mut alive, scratch);
        }
        for row in 0..rows {
            let lines = layer.q[row * 7 * self.stride..(row + 1) * 7 * self.stride].chunks_mut(self.stride);
            lines.for_each(|line| self.wrap(line));
            for code in 0..codes {
                let at = (row * codes + code) * self.stride;
                let line = &mut layer.cost[at..at + self.stride];
                if line[self.pad..self.pad + cells].iter().any(|c| c.is_finite()) {
                    layer.codes[row].push(code);
                    self.wrap(line);
                }
            }
        }
        layer
    }

    /// Nodes in the arcs that fall between the cells: narrower than one, but arcs all the same.
    fn narrow(&self, k: usize, layer: &mut Layer, alive: &mut [u8], scratch: &mut Scratch) {
        let problem = self.problem;
        let width = TURN / self.cells as f64;
        for (row, branch) in problem.branches.iter().enumerate() {
            for [lower, upper] in problem.circles[k].arcs_of(*branch) {
                if upper - lower >= width {
                    continue;
                }
                let middle = 0.5 * (lower + upper);
                let cell = ((middle / TURN + 0.5) * self.cells as f64).round() as usize % self.cells;
                if alive[cell] & (1 << branch) != 0 {
                    continue;
                }
                let q = problem.circles[k].branch_of(middle, *branch);
                let distance = problem.distance(k, middle, &q, scratch);
                self.put(layer, k, (row, cell), middle, &q, distance, scratch);
                layer.narrow.push((row, cell, middle));
                alive[cell] |= 1 << branch;
            }
        }
    }

    /// A node that holds the limits.
    #[inline(always)]
    fn put(
        &self,
        layer: &mut Layer,
        k: usize,
        (row, cell): (usize, usize),
        s: f64,
        q: &[f64; 7],
        distance: f64,
        scratch: &mut Scratch,
    ) {
        let problem = self.problem;
        let windings = &problem.windings;
        let wound: [f64; 7] = std::array::from_fn(|i| turned(q[i], windings.turns[0][i]));
        if (0..7).any(|i| !windings.counts(i) && (wound[i] < problem.lower[i] || wound[i] > problem.upper[i]))
        {
            return;
        }
        layer.distance[row * self.cells + cell] = distance;
        let at = self.pad + cell;
        let Some(place) = problem.place_cost(q, distance, scratch) else { return };
        let costs = problem.limit_costs(&wound);
        // What all windings share.
        let mut shared = place + problem.wish_cost(k, s);
        for i in 0..7 {
            let counts = windings.counts(i);
            layer.q[(row * 7 + i) * self.stride + at] = if counts { q[i] } else { wound[i] };
            shared += if counts { 0.0 } else { costs[i] };
        }
        let share = problem.share(k);
        for (code, turns) in windings.turns.iter().enumerate() {
            let mut cost = shared;
            let mut holds = true;
            for i in windings.several() {
                let wound = turned(q[i], turns[i]);
                holds &= wound >= problem.lower[i] && wound <= problem.upper[i];
                cost += problem.limit_cost(i, wound);
            }
            if holds {
                layer.cost[(row * self.codes() + code) * self.stride + at] = cost * share;
            }
        }
    }

    fn position(&self, layer: &Layer, branch: usize, cell: usize) -> [f64; 7] {
        std::array::from_fn(|i| layer.q[(branch * 7 + i) * self.stride + self.pad + cell])
    }

    /// The row of a branch at the first point.
    fn first(&self, layer: &Layer, branch: usize, tied: Option<State>) -> Row {
        let codes = self.codes();
        let size = codes * self.stride;
        let mut cost = layer.cost[branch * size..(branch + 1) * size].to_vec();
        if let Some(state) = tied {
            for code in 0..codes {
                let line = &mut cost[code * self.stride..(code + 1) * self.stride];
                for cell in 0..self.cells {
                    if (State { branch, cell, code }) != state {
                        line[self.pad + cell] = f64::INFINITY;
                    }
                }
                self.wrap(line);
            }
        }
        let came = vec![vec![START; codes * self.cells]];
        let mut row = Row { cost, floor: vec![f64::INFINITY; self.stride], came };
        self.lower(&mut row, &layer.codes[branch]);
        row
    }

    fn lower(&self, row: &mut Row, codes: &[usize]) {
        row.floor.fill(f64::INFINITY);
        for code in codes {
            let line = &row.cost[code * self.stride..(code + 1) * self.stride];
            row.floor.iter_mut().zip(line).for_each(|(floor, cost)| *floor = floor.min(*cost));
        }
    }

    /// From point `k - 1` to `k` on one branch; `jump` is what it costs to come by a reconfiguration. `checked`: whether
    /// the arm must be clear of obstacles in between.
    fn advance(
        &self,
        k: usize,
        [before, here]: [&Layer; 2],
        (branch, row): (usize, &mut Row),
        jump: f64,
        checked: bool,
    ) {
        let (problem, codes) = (self.problem, self.codes());
        let mut next = vec![f64::INFINITY; codes * self.stride];
        let mut came = vec![NONE; codes * self.cells];
        let dead = !jump.is_finite() && row.floor.iter().all(|c| !c.is_finite());
        let weight = problem.step_weight(k - 1);
        let least = problem.steps[k - 1].iter().copied().fold(f64::INFINITY, f64::min);
        let mut best = vec![[f64::INFINITY; LANES]; codes];
        let mut who = vec![[f64::from(NONE); LANES]; codes];
        let mut live: Vec<usize> = Vec::with_capacity(codes);
        let mut scratch = checked.then(|| Scratch::new(problem.arm.chain()));
        for start in (0..if dead { 0 } else { self.cells }).step_by(LANES) {
            let (at, width) = (self.pad + start, LANES.min(self.cells - start));
            let cost = |code: usize| {
                let from = (branch * codes + code) * self.stride + at;
                &here.cost[from..from + width]
            };
            live.clear();
            live.extend(here.codes[branch].iter().filter(|code| cost(**code).iter().any(|c| c.is_finite())));
            if live.is_empty() {
                continue;
            }
            for code in &live {
                // Nothing betters a node that does not exist.
                best[*code] = [f64::NEG_INFINITY; LANES];
                for (best, place) in best[*code].iter_mut().zip(cost(*code)) {
                    *best = if place.is_finite() { f64::INFINITY } else { f64::NEG_INFINITY };
                }
                who[*code] = [f64::from(NONE); LANES];
            }
            let target: [[f64; LANES]; 7] = std::array::from_fn(|i| *self.lanes(here, branch, i, at));
            for (number, offset) in self.offsets.iter().enumerate() {
                let from = at.wrapping_add_signed(*offset);
                // The dearest that could still be bettered.
                let mut most = [f64::NEG_INFINITY; LANES];
                for code in &live {
                    for j in 0..LANES {
                        most[j] = if best[*code][j] > most[j] { best[*code][j] } else { most[j] };
                    }
                }
                let floor = &row.floor[from..from + LANES];
                if !(0..LANES).any(|j| floor[j] < most[j]) {
                    continue;
                }
                let mut sum = [0.0; LANES];
                let mut wrapped = false;
                for i in 0..7 {
                    let source = self.lanes(before, branch, i, from);
                    let mut step = [0.0; LANES];
                    for j in 0..LANES {
                        step[j] = target[i][j] - source[j];
                    }
                    if problem.windings.wraps[i] {
                        wrapped |= self.shorten(i, &mut step);
                    }
                    for j in 0..LANES {
                        sum[j] += step[j] * step[j];
                    }
                }
                let furthest = sum.iter().fold(0.0, |most, s| if *s > most { *s } else { most });
                if wrapped || checked || furthest > least * least {
                    for j in 0..width {
                        if floor[j] >= most[j] {
                            continue;
                        }
                        let cell = (start + j, (from + j + self.cells * self.pad - self.pad) % self.cells);
                        let lanes = (j, number, weight);
                        let edge = (k, before, here, branch, cell);
                        self.relax(edge, lanes, row, from, &live, &mut best, &mut who, &mut scratch);
                    }
                    continue;
                }
                for j in 0..LANES {
                    sum[j] *= weight;
                }
                for code in &live {
                    let source = &row.cost[code * self.stride + from..][..LANES];
                    let (best, who) = (&mut best[*code], &mut who[*code]);
                    for j in 0..LANES {
                        let total = source[j] + sum[j];
                        let better = total < best[j];
                        best[j] = if better { total } else { best[j] };
                        who[j] = if better { number as f64 } else { who[j] };
                    }
                }
            }
            for code in &live {
                let place = cost(*code);
                for j in 0..width {
                    let (mut total, mut from) = (best[*code][j], who[*code][j] as u8);
                    if jump < total {
                        (total, from) = (jump, JUMP);
                    }
                    let total = total + place[j];
                    if total.is_finite() {
                        next[code * self.stride + at + j] = total;
                        came[code * self.cells + start + j] = from;
                    }
                }
            }
        }
        for code in &here.codes[branch] {
            self.wrap(&mut next[code * self.stride..(code + 1) * self.stride]);
        }
        row.cost = next;
        row.came.push(came);
        self.lower(row, &here.codes[branch]);
    }

    /// Neighbouring positions of a joint.
    #[inline(always)]
    fn lanes<'l>(&self, layer: &'l Layer, branch: usize, joint: usize, at: usize) -> &'l [f64; LANES] {
        let from = (branch * 7 + joint) * self.stride + at;
        layer.q[from..].first_chunk().unwrap_or(&[0.0; LANES])
    }

    /// Takes steps of a joint the short way, where its windings are all alike; whether some of them change its winding.
    #[inline(always)]
    fn shorten(&self, joint: usize, step: &mut [f64; LANES]) -> bool {
        let over = step.iter().fold(0.0, |most, d| if d.abs() > most { d.abs() } else { most }) > PI;
        if over && !self.problem.windings.counts(joint) {
            step.iter_mut().for_each(|d| *d = wrap(*d));
            return false;
        }
        over
    }

    /// One step between two nodes, with all that may happen on it.
    #[allow(clippy::too_many_arguments)]
    fn relax(
        &self,
        (k, before, here, branch, (to, cell)): (usize, &Layer, &Layer, usize, (usize, usize)),
        (lane, number, weight): (usize, usize, f64),
        row: &Row,
        from: usize,
        live: &[usize],
        best: &mut [[f64; LANES]],
        who: &mut [[f64; LANES]],
        scratch: &mut Option<Scratch>,
    ) {
        let problem = self.problem;
        let (a, b) = (self.position(before, branch, cell), self.position(here, branch, to));
        let turns = turns_between(&problem.windings, &a, &b);
        let target: [f64; 7] = std::array::from_fn(|i| turned(b[i], -f64::from(turns[i])));
        let mut sum = 0.0;
        for i in 0..7 {
            let step = target[i] - a[i];
            if step.abs() > problem.steps[k - 1][i] {
                return;
            }
            sum += step * step;
        }
        let mut clear = None;
        for code in live {
            let Some(source) = problem.windings.shifted(*code, &turns) else { continue };
            let total = row.cost[source * self.stride + from + lane] + weight * sum;
            if total < best[*code][lane] {
                let free = *clear.get_or_insert_with(|| {
                    let ends = |layer: &Layer, cell: usize| layer.distance[branch * self.cells + cell];
                    let near = [ends(before, cell), ends(here, to)];
                    scratch.as_mut().is_none_or(|s| problem.edge_is_clear(k - 1, [&a, &target], near, s))
                });
                if !free {
                    return;
                }
                best[*code][lane] = total;
                who[*code][lane] = number as f64;
            }
        }
    }

    /// Dynamic programming; with `tied`, from this state and back to it. Without `jumps` a line is continuous or there
    /// is none; with them it may be short, where a point has no node at all.
    fn search(&self, tied: Option<State>, jumps: bool, checked: &[bool], watch: WatchPart<'_>) -> Found {
        let n = self.problem.circles.len();
        let mut rows: Vec<Row> = Vec::new();
        let mut walk = Walk::default();
        let mut last: Option<Layer> = None;
        let looked = |k: usize| checked.get(k).copied().unwrap_or(false);
        let block = if self.codes() > MANY_CODES { BLOCK / 8 } else { BLOCK };
        for start in (0..n).step_by(block) {
            let end = n.min(start + block);
            let init = || Scratch::new(self.problem.arm.chain());
            let mut layers: Vec<Layer> =
                (start..end).into_par_iter().map_init(init, |scratch, k| self.layer(k, scratch)).collect();
            walk.narrow.extend(layers.iter_mut().map(|layer| std::mem::take(&mut layer.narrow)));
            if start == 0 {
                rows = (0..self.rows()).map(|branch| self.first(&layers[0], branch, tied)).collect();
                if layers[0].codes.iter().all(Vec::is_empty) {
                    return Ok(jumps.then(Line::default));
                }
            }
            let at = |k: usize| if k < start { last.as_ref() } else { layers.get(k - start) };
            let pair = |k: usize| at(k - 1).zip(at(k)).map(|(a, b)| [a, b]);
            if jumps {
                for k in start.max(1)..end {
                    let Some(pair) = pair(k) else { continue };
                    let (state, cost) = self.best(&rows);
                    walk.cheapest.push(state);
                    if pair[1].codes.iter().all(Vec::is_empty) {
                        return Ok(Some(self.backtrack(&rows, &walk, state, k)));
                    }
                    let jump = cost + self.problem.reconfiguration;
                    rows.par_iter_mut()
                        .enumerate()
                        .for_each(|row| self.advance(k, pair, row, jump, looked(k - 1)));
                }
            } else {
                rows.par_iter_mut().enumerate().for_each(|(branch, row)| {
                    for k in start.max(1)..end {
                        if let Some(pair) = pair(k) {
                            self.advance(k, pair, (branch, row), f64::INFINITY, looked(k - 1));
                        }
                    }
                });
                if !self.best(&rows).1.is_finite() {
                    return Ok(None);
                }
            }
            last = layers.pop();
            watch.report(SEARCH_SHARE * end as f64 / n as f64)?;
        }
        let state = tied.unwrap_or_else(|| self.best(&rows).0);
        let line = self.backtrack(&rows, &walk, state, n);
        Ok(line.cost.is_finite().then_some(line))
    }

    /// The cheapest state so far and its cost.
    fn best(&self, rows: &[Row]) -> (State, f64) {
        let mut best = (State { branch: 0, cell: 0, code: 0 }, f64::INFINITY);
        for (branch, row) in rows.iter().enumerate() {
            for code in 0..self.codes() {
                let line = &row.cost[code * self.stride + self.pad..][..self.cells];
                for (cell, cost) in line.iter().enumerate() {
                    if *cost < best.1 {
                        best = (State { branch, cell, code }, *cost);
                    }
                }
            }
        }
        best
    }

    /// Swivel and positions of a node, as [`Grid::layer`] has them.
    fn node(
        &self,
        k: usize,
        (branch, cell): (usize, usize),
        narrow: &[(usize, usize, f64)],
    ) -> (f64, [f64; 7]) {
        let (problem, index) = (self.problem, self.problem.branches[branch]);
        let windings = &problem.windings;
        let off_grid = narrow.iter().find(|(b, c, _)| (*b, *c) == (branch, cell));
        let (s, q) = match off_grid {
            Some((_, _, s)) => (*s, problem.circles[k].branch_of(*s, index)),
            None => {
                let s = self.angle(k, cell);
                (s, problem.circles[k].all_branches(s)[index])
            }
        };
        let wound = |i: usize| if windings.counts(i) { q[i] } else { turned(q[i], windings.turns[0][i]) };
        (s, std::array::from_fn(wound))
    }

    /// The line that ends in a state of point `end - 1`.
    fn backtrack(&self, rows: &[Row], walk: &Walk, mut state: State, end: usize) -> Line {
        let problem = self.problem;
        let windings = &problem.windings;
        let mut line = Line {
            cost: rows[state.branch].cost[state.code * self.stride + self.pad + state.cell],
            ..Line::default()
        };
        if !line.cost.is_finite() {
            return line;
        }
        let mut here = self.node(end - 1, (state.branch, state.cell), &walk.narrow[end - 1]);
        for k in (0..end).rev() {
            let State { branch, cell, code } = state;
            let (s, q) = here;
            line.branch.push(problem.branches[branch]);
            line.swivel.push(s);
            line.q.push(windings.wound(&q, code));
            let from = rows[branch].came[k][code * self.cells + cell];
            if k == 0 || from == NONE {
                break;
            }
            state = if from == JUMP {
                line.reconfigurations.push(k);
                walk.cheapest[k - 1]
            } else {
                let source = cell as isize + self.offsets[usize::from(from)];
                State { branch, cell: source.rem_euclid(self.cells as isize) as usize, code }
            };
            here = self.node(k - 1, (state.branch, state.cell), &walk.narrow[k - 1]);
            if from != JUMP {
                let shift = turns_between(windings, &here.1, &q);
                state.code = windings.shifted(code, &shift).unwrap_or(code);
            }
        }
        line.branch.reverse();
        line.swivel.reverse();
        line.q.reverse();
        line.reconfigurations.reverse();
        for k in 1..line.q.len() {
            // A joint without limits has no windings of its own: it goes on as it came.
            for i in (0..7).filter(|i| windings.free(*i)) {
                line.q[k][i] = nearest(line.q[k][i], line.q[k - 1][i]);
            }
            line.swivel[k] = nearest(line.swivel[k], line.swivel[k - 1]);
        }
        line
    }

    /// The cheapest line, closed where it has to be, clear of obstacles between its points where `whole`.
    pub fn line(&self, jumps: bool, whole: bool, watch: WatchPart<'_>) -> Found {
        let problem = self.problem;
        let n = problem.circles.len();
        let mut checked = vec![false; n];
        for round in 0.. {
            let line = if problem.settings.cyclic {
                self.closed(jumps, &checked, watch)?
            } else {
                self.search(None, jumps, &checked, watch)?
            };
            let Some(line) = line else { return Ok(None) };
            let touching = if whole { problem.touching(&line) } else { Vec::new() };
            if touching.is_empty() || checked.iter().all(|c| *c) {
                return Ok(Some(line));
            }
            touching.iter().for_each(|k| checked[*k] = true);
            if round == LAZY_SEARCHES {
                checked.fill(true);
            }
        }
        Ok(None)
    }

    /// The best of the closed lines from several states of the first point: from where the open line ends, and from
    /// the cheapest state of each connected piece; none where no line closes.
    fn closed(&self, jumps: bool, checked: &[bool], watch: WatchPart<'_>) -> Found {
        let Some(open) = self.search(None, jumps, checked, watch)? else { return Ok(None) };
        if open.q.len() < self.problem.circles.len() {
            return Ok(Some(open));
        }
        let layer = self.layer(0, &mut Scratch::new(self.problem.arm.chain()));
        let mut starts: Vec<State> =
            [open.q.len() - 1, 0].iter().filter_map(|k| self.state_of(&layer, &open, *k)).collect();
        starts.extend(self.pieces(&layer));
        starts.dedup();
        let mut best: Option<Line> = None;
        for start in starts.into_iter().take(CLOSED_STARTS) {
            let Some(line) = self.search(Some(start), jumps, checked, watch)? else { continue };
            let worse =
                |b: &Line| (line.reconfigurations.len(), line.cost) < (b.reconfigurations.len(), b.cost);
            let whole = line.q.len() == self.problem.circles.len();
            if whole && best.as_ref().is_none_or(worse) {
                best = Some(line);
            }
            if best.as_ref().is_some_and(|line| line.reconfigurations.is_empty()) {
                break;
            }
        }
        Ok(best)
    }

    /// The state of the first point that is nearest to row `row` of a line.
    fn state_of(&self, layer: &Layer, line: &Line, row: usize) -> Option<State> {
        let problem = self.problem;
        let branch = problem.branches.iter().position(|b| *b == line.branch[row])?;
        let near = |state: &State| -> f64 {
            let q = problem.windings.wound(&self.position(layer, branch, state.cell), state.code);
            let gap = |i: usize| {
                let gap = q[i] - line.q[row][i];
                if problem.windings.free(i) { wrap(gap) } else { gap }
            };
            (0..7).map(|i| gap(i).powi(2)).sum()
        };
        let alive = layer.codes[branch].iter().flat_map(|code| {
            let line = &layer.cost[(branch * self.codes() + code) * self.stride + self.pad..][..self.cells];
            let cells = line.iter().enumerate().filter(|(_, cost)| cost.is_finite());
            cells.map(move |(cell, _)| State { branch, cell, code: *code })
        });
        alive.min_by(|a, b| near(a).total_cmp(&near(b)))
    }

    /// The cheapest state of each connected piece of the first point, cheapest first.
    fn pieces(&self, layer: &Layer) -> Vec<State> {
        let cells = self.cells;
        let mut out: Vec<(f64, State)> = Vec::new();
        for branch in 0..self.rows() {
            for code in &layer.codes[branch] {
                let line = &layer.cost[(branch * self.codes() + code) * self.stride + self.pad..][..cells];
                let begin = line.iter().position(|cost| !cost.is_finite()).unwrap_or(0);
                let mut piece: Option<(f64, State)> = None;
                for at in begin..=begin + cells {
                    let (cell, cost) = (at % cells, line[at % cells]);
                    if at < begin + cells && cost.is_finite() {
                        if piece.is_none_or(|p| cost < p.0) {
                            piece = Some((cost, State { branch, cell, code: *code }));
                        }
                    } else {
                        out.extend(piece.take());
                    }
                }
            }
        }
        out.sort_by(|a, b| a.0.total_cmp(&b.0));
        out.into_iter().map(|(_, state)| state).collect()
    }
}
