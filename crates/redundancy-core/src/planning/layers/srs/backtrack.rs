//! Backtracking through a search, and the states of the grid along a line.

use super::grid::{BranchCosts, GridLayer, GridState, JUMP, NONE, SwivelGrid, WayBack};
use super::problem::SwivelLine;
use super::windings::turns_between;
use crate::joint_space::{nearest, turned, wrap};

impl SwivelGrid<'_> {
    /// Swivel and positions of a node, as [`SwivelGrid::layer`] has them.
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
    pub(super) fn backtrack(
        &self,
        rows: &[BranchCosts],
        walk: &WayBack,
        mut state: GridState,
        end: usize,
    ) -> SwivelLine {
        let problem = self.problem;
        let windings = &problem.windings;
        let mut line = SwivelLine {
            cost: rows[state.branch].cost[state.code * self.stride + self.pad + state.cell],
            ..SwivelLine::default()
        };
        if !line.cost.is_finite() {
            return line;
        }
        let mut here = self.node(end - 1, (state.branch, state.cell), &walk.narrow[end - 1]);
        for k in (0..end).rev() {
            let GridState { branch, cell, code } = state;
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
                GridState { branch, cell: source.rem_euclid(self.cells as isize) as usize, code }
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

    /// The state of the first point that is nearest to row `row` of a line.
    pub(super) fn state_of(&self, layer: &GridLayer, line: &SwivelLine, row: usize) -> Option<GridState> {
        let problem = self.problem;
        let branch = problem.branches.iter().position(|b| *b == line.branch[row])?;
        let near = |state: &GridState| -> f64 {
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
            cells.map(move |(cell, _)| GridState { branch, cell, code: *code })
        });
        alive.min_by(|a, b| near(a).total_cmp(&near(b)))
    }

    /// The cheapest state of each connected piece of the first point, cheapest first.
    pub(super) fn pieces(&self, layer: &GridLayer) -> Vec<GridState> {
        let cells = self.cells;
        let mut out: Vec<(f64, GridState)> = Vec::new();
        for branch in 0..self.rows() {
            for code in &layer.codes[branch] {
                let line = &layer.cost[(branch * self.codes() + code) * self.stride + self.pad..][..cells];
                let begin = line.iter().position(|cost| !cost.is_finite()).unwrap_or(0);
                let mut piece: Option<(f64, GridState)> = None;
                for at in begin..=begin + cells {
                    let (cell, cost) = (at % cells, line[at % cells]);
                    if at < begin + cells && cost.is_finite() {
                        if piece.is_none_or(|p| cost < p.0) {
                            piece = Some((cost, GridState { branch, cell, code: *code }));
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
