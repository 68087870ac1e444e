//! The convex program of one step: the largest speed under all rows, made linear around the current parameters.
//!
//! Variables: the changes of the spline's coefficients within a trust region, and `t`, the inverse squared speed. Rows reach over the
//! six functions of a spline that are not zero at their place, so the matrix is banded. The cone is exact: `|e| <= alpha` is a
//! second-order cone in the tilt. Solved by clarabel's interior-point method.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};

use crate::path::LocalBasis;

/// Rows `sum a x <= b`.
#[derive(Default)]
struct Rows {
    entries: Vec<(usize, f64)>,
    right: Vec<f64>,
    ends: Vec<usize>,
}

impl Rows {
    fn push(&mut self, column: usize, value: f64) {
        if value != 0.0 {
            self.entries.push((column, value));
        }
    }

    fn end(&mut self, right: f64) {
        self.right.push(right);
        self.ends.push(self.entries.len());
    }

    fn row(&self, i: usize) -> &[(usize, f64)] {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        &self.entries[start..self.ends[i]]
    }
}

/// Rows, and cones `|c + C x| <= r` as three rows each, gathered one by one.
pub(super) struct Program {
    columns: usize,
    linear: Rows,
    cones: Rows,
}

impl Program {
    /// `columns` variables.
    pub fn new(columns: usize) -> Self {
        Self { columns, linear: Rows::default(), cones: Rows::default() }
    }

    /// `sum over orders and channels of gradient * change of (u, u', u'') - scale t <= right`.
    pub fn local<const M: usize>(
        &mut self,
        basis: &LocalBasis,
        gradient: &[[f64; M]; 3],
        scale: f64,
        right: f64,
    ) {
        for j in 0..basis.values[0].len() {
            for c in 0..M {
                let value: f64 = (0..3).map(|o| basis.values[o][j] * gradient[o][c]).sum();
                self.linear.push((basis.first + j) * M + c, value);
            }
        }
        self.linear.push(self.columns - 1, -scale);
        self.linear.end(right);
    }

    /// `low <= x <= high` for one variable.
    pub fn bounds(&mut self, column: usize, low: f64, high: f64) {
        self.linear.push(column, 1.0);
        self.linear.end(high);
        self.linear.push(column, -1.0);
        self.linear.end(-low);
    }

    /// `|e + change of the first two channels| <= radius`.
    pub fn cone<const M: usize>(&mut self, basis: &LocalBasis, tilt: [f64; 2], radius: f64) {
        self.cones.end(radius);
        for (c, e) in tilt.into_iter().enumerate() {
            for (j, value) in basis.values[0].iter().enumerate() {
                self.cones.push((basis.first + j) * M + c, -value);
            }
            self.cones.end(e);
        }
    }

    /// The minimiser of the last variable, or `None` where there is none within the rows.
    pub fn solve(&self) -> Option<Vec<f64>> {
        let n = self.columns;
        let (linear, conic) = (self.linear.right.len(), self.cones.right.len());
        let m = linear + conic;
        // Row by row to column by column.
        let mut count = vec![0usize; n + 1];
        let entries = self.linear.entries.iter().chain(&self.cones.entries);
        for (column, _) in entries {
            count[column + 1] += 1;
        }
        for j in 0..n {
            count[j + 1] += count[j];
        }
        let mut next = count.clone();
        let (mut index, mut value) = (vec![0; count[n]], vec![0.0; count[n]]);
        for row in 0..m {
            let entries = if row < linear { self.linear.row(row) } else { self.cones.row(row - linear) };
            for (column, v) in entries {
                index[next[*column]] = row;
                value[next[*column]] = *v;
                next[*column] += 1;
            }
        }
        let right = [self.linear.right.as_slice(), self.cones.right.as_slice()].concat();
        let a = CscMatrix::new(m, n, count, index, value);
        let p = CscMatrix::zeros((n, n));
        let mut cost = vec![0.0; n];
        cost[n - 1] = 1.0;
        let mut cones = vec![NonnegativeConeT(linear)];
        cones.extend(std::iter::repeat_n(SecondOrderConeT(3), conic / 3));
        let settings = DefaultSettings {
            verbose: false,
            max_iter: ITERATIONS,
            tol_gap_abs: GAP,
            tol_gap_rel: GAP,
            tol_feas: GAP,
            presolve_enable: false,
            max_threads: 1,
            iterative_refinement_reltol: REFINED,
            iterative_refinement_abstol: REFINED,
            iterative_refinement_max_iter: 2,
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(&p, &cost, &a, &right, &cones, settings).ok()?;
        solver.solve();
        match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => Some(solver.solution.x),
            _ => None,
        }
    }
}

/// Most iterations of the interior-point method; 15 to 30 are usual.
const ITERATIONS: u32 = 60;
/// Gap and residual at which it stops: the step is tried on the exact problem anyway.
const GAP: f64 = 1e-5;
/// Residual of the linear systems, far below that.
const REFINED: f64 = 1e-9;
