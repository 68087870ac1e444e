//! The line of least cost on the grid points x branches x swivels x windings.
//!
//! Each branch is searched on its own: without a reconfiguration nothing leads from one to another. Eight swivels are
//! looked at together, from every swivel that a step may come from. Of where a state came from only the offset is kept, a
//! byte; windings follow from the joint positions.

use std::f64::consts::PI;

use super::grid::{BranchCosts, GridLayer, GridState, JUMP, LANES, NONE, START, SwivelGrid, WayBack};
use super::problem::SwivelLine;
use super::windings::turns_between;
use crate::joint_space::{turned, wrap};
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;
use crate::scene::SweepMemory;
use crate::watch::{Interrupted, WatchPart};

/// Points whose nodes are in memory at once.
const BLOCK: usize = 64;
/// Codes above which there are only an eighth as many: nodes are large then.
const MANY_CODES: usize = 16;
/// Most states of the first point from which a closed line is tried.
const CLOSED_STARTS: usize = 12;
/// Searches after which steps between all points are checked, not only those that were found to touch.
const LAZY_SEARCHES: usize = 8;
/// Part of the work that is done when the last point is reached; the rest is the refinement.
const SEARCH_SHARE: f64 = 0.9;

/// A line, or none where there is none; or why the search ended early.
type FoundLine = Result<Option<SwivelLine>, Interrupted>;

/// A step of the search on one branch.
struct GridStep<'l> {
    /// The point at its end.
    k: usize,
    before: &'l GridLayer,
    here: &'l GridLayer,
    /// Position in [`SwivelProblem::branches`](super::problem::SwivelProblem::branches).
    branch: usize,
    /// Weight of the square of the joint step.
    weight: f64,
    /// The least of the largest joint steps: shorter ones are allowed for every joint.
    least: f64,
    /// Whether the arm must be clear of obstacles in between.
    checked: bool,
}

/// Where steps to neighbouring cells come from.
#[derive(Clone, Copy)]
struct Way {
    /// Number of the offset.
    number: usize,
    /// The first of the cells at the end, and how many there are.
    start: usize,
    width: usize,
    /// Where the first step comes from, in a row with its repeats.
    from: usize,
}

/// The cheapest ways to neighbouring cells, by code of the windings: cost and number of the offset.
struct BestWays {
    /// Codes with a node in one of the cells.
    live: Vec<usize>,
    cost: Vec<[f64; LANES]>,
    number: Vec<[f64; LANES]>,
}

impl BestWays {
    fn new(codes: usize) -> Self {
        Self {
            live: Vec::with_capacity(codes),
            cost: vec![[f64::INFINITY; LANES]; codes],
            number: vec![[f64::from(NONE); LANES]; codes],
        }
    }

    /// Begins with other cells, whose costs of being there are `place`; false when there is no node.
    #[inline(always)]
    fn open<'c>(&mut self, codes: &[usize], place: impl Fn(usize) -> &'c [f64]) -> bool {
        self.live.clear();
        self.live.extend(codes.iter().filter(|code| place(**code).iter().any(|c| c.is_finite())));
        for code in &self.live {
            // Nothing betters a node that does not exist.
            self.cost[*code] = [f64::NEG_INFINITY; LANES];
            for (best, place) in self.cost[*code].iter_mut().zip(place(*code)) {
                *best = if place.is_finite() { f64::INFINITY } else { f64::NEG_INFINITY };
            }
            self.number[*code] = [f64::from(NONE); LANES];
        }
        !self.live.is_empty()
    }

    /// The most expensive state that could still be improved in each cell.
    #[inline(always)]
    fn dearest(&self) -> [f64; LANES] {
        let mut most = [f64::NEG_INFINITY; LANES];
        for code in &self.live {
            for j in 0..LANES {
                most[j] = if self.cost[*code][j] > most[j] { self.cost[*code][j] } else { most[j] };
            }
        }
        most
    }
}

impl SwivelGrid<'_> {
    /// The row of a branch at the first point.
    fn first(&self, layer: &GridLayer, branch: usize, tied: Option<GridState>) -> BranchCosts {
        let codes = self.codes();
        let size = codes * self.stride;
        let mut cost = layer.cost[branch * size..(branch + 1) * size].to_vec();
        if let Some(state) = tied {
            for code in 0..codes {
                let line = &mut cost[code * self.stride..(code + 1) * self.stride];
                for cell in 0..self.cells {
                    if (GridState { branch, cell, code }) != state {
                        line[self.pad + cell] = f64::INFINITY;
                    }
                }
                self.wrap(line);
            }
        }
        let came = vec![vec![START; codes * self.cells]];
        let mut row = BranchCosts { cost, floor: vec![f64::INFINITY; self.stride], came };
        self.lower(&mut row, &layer.codes[branch]);
        row
    }

    fn lower(&self, row: &mut BranchCosts, codes: &[usize]) {
        row.floor.fill(f64::INFINITY);
        for code in codes {
            let line = &row.cost[code * self.stride..(code + 1) * self.stride];
            row.floor.iter_mut().zip(line).for_each(|(floor, cost)| *floor = floor.min(*cost));
        }
    }

    /// From one point to the next on one branch; `jump` is what it costs to come by a reconfiguration.
    fn advance(&self, step: &GridStep<'_>, row: &mut BranchCosts, jump: f64) {
        let (codes, branch, here) = (self.codes(), step.branch, step.here);
        let mut next = vec![f64::INFINITY; codes * self.stride];
        let mut came = vec![NONE; codes * self.cells];
        let dead = !jump.is_finite() && row.floor.iter().all(|c| !c.is_finite());
        let mut best = BestWays::new(codes);
        let mut sweep = step.checked.then_some(None);
        for start in (0..if dead { 0 } else { self.cells }).step_by(LANES) {
            let (at, width) = (self.pad + start, LANES.min(self.cells - start));
            let cost = |code: usize| {
                let from = (branch * codes + code) * self.stride + at;
                &here.cost[from..from + width]
            };
            if !best.open(&here.codes[branch], cost) {
                continue;
            }
            let target: [[f64; LANES]; 7] = std::array::from_fn(|i| *self.lanes(here, branch, i, at));
            for (number, offset) in self.offsets.iter().enumerate() {
                let way = Way { number, start, width, from: at.wrapping_add_signed(*offset) };
                self.try_way(step, row, way, &target, &mut best, &mut sweep);
            }
            for code in &best.live {
                let place = cost(*code);
                for j in 0..width {
                    let (mut total, mut from) = (best.cost[*code][j], best.number[*code][j] as u8);
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

    /// One way to the cells from `start` on, where it betters what is known.
    #[inline(always)]
    fn try_way(
        &self,
        step: &GridStep<'_>,
        row: &BranchCosts,
        way: Way,
        target: &[[f64; LANES]; 7],
        best: &mut BestWays,
        sweep: &mut Option<Option<SweepMemory>>,
    ) {
        let (problem, from) = (self.problem, way.from);
        let most = best.dearest();
        let floor = &row.floor[from..from + LANES];
        if !(0..LANES).any(|j| floor[j] < most[j]) {
            return;
        }
        let mut sum = [0.0; LANES];
        let mut wrapped = false;
        for i in 0..7 {
            let source = self.lanes(step.before, step.branch, i, from);
            let mut gap = [0.0; LANES];
            for j in 0..LANES {
                gap[j] = target[i][j] - source[j];
            }
            if problem.windings.wraps[i] {
                wrapped |= self.shorten(i, &mut gap);
            }
            for j in 0..LANES {
                sum[j] += gap[j] * gap[j];
            }
        }
        let furthest = sum.iter().fold(0.0, |most, s| if *s > most { *s } else { most });
        if wrapped || step.checked || furthest > step.least * step.least {
            for lane in 0..way.width {
                if floor[lane] < most[lane] {
                    self.relax(step, row, way, lane, best, sweep);
                }
            }
            return;
        }
        for j in 0..LANES {
            sum[j] *= step.weight;
        }
        for code in &best.live {
            let source = &row.cost[code * self.stride + from..][..LANES];
            let (cost, number) = (&mut best.cost[*code], &mut best.number[*code]);
            for j in 0..LANES {
                let total = source[j] + sum[j];
                let better = total < cost[j];
                cost[j] = if better { total } else { cost[j] };
                number[j] = if better { way.number as f64 } else { number[j] };
            }
        }
    }

    /// Neighbouring positions of a joint.
    #[inline(always)]
    fn lanes<'l>(&self, layer: &'l GridLayer, branch: usize, joint: usize, at: usize) -> &'l [f64; LANES] {
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
    fn relax(
        &self,
        step: &GridStep<'_>,
        row: &BranchCosts,
        way: Way,
        lane: usize,
        best: &mut BestWays,
        sweep: &mut Option<Option<SweepMemory>>,
    ) {
        let GridStep { k, before, here, branch, weight, .. } = *step;
        let problem = self.problem;
        let to = way.start + lane;
        let cell = (way.from + lane + self.cells * self.pad - self.pad) % self.cells;
        let (a, b) = (self.position(before, branch, cell), self.position(here, branch, to));
        let turns = turns_between(&problem.windings, &a, &b);
        let target: [f64; 7] = std::array::from_fn(|i| turned(b[i], -f64::from(turns[i])));
        let mut sum = 0.0;
        for i in 0..7 {
            let gap = target[i] - a[i];
            if gap.abs() > problem.steps[k - 1][i] {
                return;
            }
            sum += gap * gap;
        }
        let mut clear = None;
        for code in &best.live {
            let Some(source) = problem.windings.shifted(*code, &turns) else { continue };
            let total = row.cost[source * self.stride + way.from + lane] + weight * sum;
            if total < best.cost[*code][lane] {
                let free = *clear.get_or_insert_with(|| {
                    let ends = |layer: &GridLayer, cell: usize| layer.distance[branch * self.cells + cell];
                    let near = [ends(before, cell), ends(here, to)];
                    sweep.as_mut().is_none_or(|s| problem.edge_is_clear(k - 1, [&a, &target], near, s))
                });
                if !free {
                    return;
                }
                best.cost[*code][lane] = total;
                best.number[*code][lane] = way.number as f64;
            }
        }
    }

    /// Dynamic programming; with `tied`, from this state and back to it. Without `jumps` a line is continuous or there
    /// is none; with them it may be short, where a point has no node at all.
    fn search(
        &self,
        tied: Option<GridState>,
        jumps: bool,
        checked: &[bool],
        watch: WatchPart<'_>,
    ) -> FoundLine {
        let n = self.problem.circles.len();
        let mut rows: Vec<BranchCosts> = Vec::new();
        let mut walk = WayBack::default();
        let mut last: Option<GridLayer> = None;
        let looked = |k: usize| checked.get(k).copied().unwrap_or(false);
        let block = if self.codes() > MANY_CODES { BLOCK / 8 } else { BLOCK };
        for start in (0..n).step_by(block) {
            let end = n.min(start + block);
            let init = || Scratch::new(self.problem.arm.chain());
            let mut layers: Vec<GridLayer> =
                (start..end).into_par_iter().map_init(init, |scratch, k| self.layer(k, scratch)).collect();
            walk.narrow.extend(layers.iter_mut().map(|layer| std::mem::take(&mut layer.narrow)));
            if start == 0 {
                rows = (0..self.rows()).map(|branch| self.first(&layers[0], branch, tied)).collect();
                if layers[0].codes.iter().all(Vec::is_empty) {
                    return Ok(jumps.then(SwivelLine::default));
                }
            }
            let at = |k: usize| if k < start { last.as_ref() } else { layers.get(k - start) };
            let step = |k: usize, branch: usize| {
                let (before, here) = at(k - 1).zip(at(k))?;
                let weight = self.problem.step_weight(k - 1);
                let least = self.problem.steps[k - 1].iter().copied().fold(f64::INFINITY, f64::min);
                Some(GridStep { k, before, here, branch, weight, least, checked: looked(k - 1) })
            };
            if jumps {
                for k in start.max(1)..end {
                    let Some(here) = at(k) else { continue };
                    let (state, cost) = self.best(&rows);
                    walk.cheapest.push(state);
                    if here.codes.iter().all(Vec::is_empty) {
                        return Ok(Some(self.backtrack(&rows, &walk, state, k)));
                    }
                    let jump = cost + self.problem.reconfiguration;
                    rows.par_iter_mut().enumerate().for_each(|(branch, row)| {
                        if let Some(step) = step(k, branch) {
                            self.advance(&step, row, jump);
                        }
                    });
                }
            } else {
                rows.par_iter_mut().enumerate().for_each(|(branch, row)| {
                    for step in (start.max(1)..end).filter_map(|k| step(k, branch)) {
                        self.advance(&step, row, f64::INFINITY);
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
    fn best(&self, rows: &[BranchCosts]) -> (GridState, f64) {
        let mut best = (GridState { branch: 0, cell: 0, code: 0 }, f64::INFINITY);
        for (branch, row) in rows.iter().enumerate() {
            for code in 0..self.codes() {
                let line = &row.cost[code * self.stride + self.pad..][..self.cells];
                for (cell, cost) in line.iter().enumerate() {
                    if *cost < best.1 {
                        best = (GridState { branch, cell, code }, *cost);
                    }
                }
            }
        }
        best
    }

    /// The cheapest line, closed where it has to be, clear of obstacles between its points where `whole`.
    pub fn line(&self, jumps: bool, whole: bool, watch: WatchPart<'_>) -> FoundLine {
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
    fn closed(&self, jumps: bool, checked: &[bool], watch: WatchPart<'_>) -> FoundLine {
        let Some(open) = self.search(None, jumps, checked, watch)? else { return Ok(None) };
        if open.q.len() < self.problem.circles.len() {
            return Ok(Some(open));
        }
        let layer = self.layer(0, &mut Scratch::new(self.problem.arm.chain()));
        let mut starts: Vec<GridState> =
            [open.q.len() - 1, 0].iter().filter_map(|k| self.state_of(&layer, &open, *k)).collect();
        starts.extend(self.pieces(&layer));
        starts.dedup();
        let mut best: Option<SwivelLine> = None;
        for start in starts.into_iter().take(CLOSED_STARTS) {
            let Some(line) = self.search(Some(start), jumps, checked, watch)? else { continue };
            let worse = |b: &SwivelLine| {
                (line.reconfigurations.len(), line.cost) < (b.reconfigurations.len(), b.cost)
            };
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
}
