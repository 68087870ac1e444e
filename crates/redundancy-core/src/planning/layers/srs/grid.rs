//! The nodes over each point: swivels of a grid on every branch, with their windings, costs and distances from obstacles.
//!
//! Positions and costs are kept by joint and by cell, so that the search is plain arithmetic on rows of numbers. An arc that
//! is narrower than a cell gets a node of its own.

use super::near::Near;
use super::problem::SwivelProblem;
use crate::joint_space::{TURN, turned};
use crate::kinematics::Scratch;

/// Swivels that are computed together.
pub(super) const LANES: usize = 8;
/// Offsets up to which a step may end in every cell; beyond, in every fifth more.
const DENSE: usize = 10;
/// Where a state came from: not at all, from the start, or by a reconfiguration; else the number of the offset.
pub(super) const NONE: u8 = 255;
pub(super) const START: u8 = 254;
pub(super) const JUMP: u8 = 253;

/// A state of one point: position of the branch in [`SwivelProblem::branches`], cell, code of the windings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct GridState {
    pub branch: usize,
    pub cell: usize,
    pub code: usize,
}

/// All nodes of a point. Rows of cells have `pad` more on both sides, which repeat the circle.
pub(super) struct GridLayer {
    /// Nodes off the grid, in arcs that are narrower than a cell: branch, cell, swivel.
    pub narrow: Vec<(usize, usize, f64)>,
    /// By branch, joint, cell: positions, wound where only one winding holds the limits.
    pub q: Vec<f64>,
    /// By branch, code, cell: the cost of being there, infinite where limits or obstacles forbid it.
    pub cost: Vec<f64>,
    /// By branch and cell: distance from the obstacles.
    pub distance: Vec<f64>,
    /// By branch: the codes that are alive somewhere.
    pub codes: Vec<Vec<usize>>,
}

/// The search over one branch.
pub(super) struct BranchCosts {
    pub cost: Vec<f64>,
    /// The least of `cost` over the codes.
    pub floor: Vec<f64>,
    pub came: Vec<Vec<u8>>,
}

/// What a search remembers for the way back besides its rows.
#[derive(Default)]
pub(super) struct WayBack {
    /// By point: the nodes off the grid.
    pub narrow: Vec<Vec<(usize, usize, f64)>>,
    /// By point: the state from which reconfigurations start.
    pub cheapest: Vec<GridState>,
}

/// A configuration over a point.
#[derive(Clone, Copy)]
struct Node<'a> {
    s: f64,
    q: &'a [f64; 7],
    near: Near,
}

/// The grid of a problem.
pub(in crate::planning) struct SwivelGrid<'a> {
    pub problem: &'a SwivelProblem<'a>,
    pub cells: usize,
    pub offsets: Vec<isize>,
    pub pad: usize,
    pub stride: usize,
}

impl<'a> SwivelGrid<'a> {
    /// A grid of `cells`, on which a step may turn the swivel by `reach` (rad).
    pub fn new(problem: &'a SwivelProblem<'a>, cells: usize, reach: f64) -> Self {
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

    pub fn rows(&self) -> usize {
        self.problem.branches.len()
    }

    pub fn codes(&self) -> usize {
        self.problem.windings.total
    }

    /// Swivel of a cell at point `k`.
    pub fn angle(&self, k: usize, cell: usize) -> f64 {
        self.problem.fixed(k).unwrap_or(TURN * (cell as f64 / self.cells as f64 - 0.5))
    }

    /// Repeats the circle on both sides of a row.
    pub fn wrap(&self, row: &mut [f64]) {
        for p in 0..self.pad {
            let before = (p + self.cells * self.pad - self.pad) % self.cells;
            row[p] = row[self.pad + before];
            row[self.pad + self.cells + p] = row[self.pad + p % self.cells];
        }
    }

    /// All nodes of point `k`.
    pub(super) fn layer(&self, k: usize, scratch: &mut Scratch) -> GridLayer {
        let (problem, cells, codes) = (self.problem, self.cells, self.codes());
        let rows = self.rows();
        let circle = &problem.circles[k];
        let mut layer = GridLayer {
            narrow: Vec::new(),
            q: vec![0.0; rows * 7 * self.stride],
            cost: vec![f64::INFINITY; rows * codes * self.stride],
            distance: vec![f64::INFINITY; rows * cells],
            codes: vec![Vec::new(); rows],
        };
        let mut alive = vec![0u8; cells];
        let mut anchors = [const { None }; 8];
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
                    let distances =
                        distances.get_or_insert_with(|| problem.distances(k, s, &all, allowed, &mut anchors));
                    let node = Node { s, q: &all[*branch], near: distances[*branch] };
                    self.put(&mut layer, (k, row, cell), node, scratch);
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
    fn narrow(&self, k: usize, layer: &mut GridLayer, alive: &mut [u8], scratch: &mut Scratch) {
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
                let near = problem.distance(k, *branch, middle, &q);
                self.put(layer, (k, row, cell), Node { s: middle, q: &q, near }, scratch);
                layer.narrow.push((row, cell, middle));
                alive[cell] |= 1 << branch;
            }
        }
    }

    /// A node that holds the limits.
    #[inline(always)]
    fn put(
        &self,
        layer: &mut GridLayer,
        (k, row, cell): (usize, usize, usize),
        node: Node<'_>,
        scratch: &mut Scratch,
    ) {
        let Node { s, q, near } = node;
        let problem = self.problem;
        let windings = &problem.windings;
        let wound: [f64; 7] = std::array::from_fn(|i| turned(q[i], windings.turns[0][i]));
        if (0..7).any(|i| !windings.counts(i) && (wound[i] < problem.lower[i] || wound[i] > problem.upper[i]))
        {
            return;
        }
        layer.distance[row * self.cells + cell] = near.least;
        let at = self.pad + cell;
        let Some(place) = problem.place_cost(q, near, scratch) else { return };
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

    pub(super) fn position(&self, layer: &GridLayer, branch: usize, cell: usize) -> [f64; 7] {
        std::array::from_fn(|i| layer.q[(branch * 7 + i) * self.stride + self.pad + cell])
    }
}
