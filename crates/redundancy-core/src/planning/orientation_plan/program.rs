//! The convex program of one step: the largest speed under all rows, made linear around the current parameters.
//!
//! Variables: the changes of the spline's coefficients within a trust region, and `t`, the inverse squared speed. Rows reach over the
//! six functions of a spline that are not zero at their place, so the matrix is banded. The cone is exact: `|e| <= alpha` is a
//! second-order cone in the tilt. Solved by clarabel's interior-point method.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};

use crate::path::LocalBasis;

/// Rows `sum a x <= b`, cones `|c + C x| <= r`, gathered one by one.
pub(super) struct Program {
    columns: usize,
    rows: Vec<(usize, f64)>,
    right: Vec<f64>,
    starts: Vec<usize>,
    cones: usize,
}

impl Program {
    /// `columns` variables.
    pub fn new(columns: usize) -> Self {
        Self { columns, rows: Vec::new(), right: Vec::new(), starts: vec![0], cones: 0 }
    }

    fn push(&mut self, column: usize, value: f64) {
        if value != 0.0 {
            self.rows.push((column, value));
        }
    }

    fn end(&mut self, right: f64) {
        self.right.push(right);
        self.starts.push(self.rows.len());
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
                self.push((basis.first + j) * M + c, value);
            }
        }
        self.push(self.columns - 1, -scale);
        self.end(right);
    }

    /// `low <= x <= high` for one variable.
    pub fn bounds(&mut self, column: usize, low: f64, high: f64) {
        self.push(column, 1.0);
        self.end(high);
        self.push(column, -1.0);
        self.end(-low);
    }

    /// `|e + change of the first two channels| <= radius`; only after all rows.
    pub fn cone<const M: usize>(&mut self, basis: &LocalBasis, tilt: [f64; 2], radius: f64) {
        self.end(radius);
        for (c, e) in tilt.into_iter().enumerate() {
            for (j, value) in basis.values[0].iter().enumerate() {
                self.push((basis.first + j) * M + c, -value);
            }
            self.end(e);
        }
        self.cones += 1;
    }

    /// The minimiser of the last variable, or `None` where there is none within the rows.
    pub fn solve(&self) -> Option<Vec<f64>> {
        let (m, n) = (self.right.len(), self.columns);
        // Row by row to column by column.
        let mut count = vec![0usize; n + 1];
        for (column, _) in &self.rows {
            count[column + 1] += 1;
        }
        for j in 0..n {
            count[j + 1] += count[j];
        }
        let mut next = count.clone();
        let (mut index, mut value) = (vec![0; self.rows.len()], vec![0.0; self.rows.len()]);
        for row in 0..m {
            for (column, v) in &self.rows[self.starts[row]..self.starts[row + 1]] {
                index[next[*column]] = row;
                value[next[*column]] = *v;
                next[*column] += 1;
            }
        }
        let a = CscMatrix::new(m, n, count, index, value);
        let p = CscMatrix::zeros((n, n));
        let mut cost = vec![0.0; n];
        cost[n - 1] = 1.0;
        let linear = m - 3 * self.cones;
        let mut cones = vec![NonnegativeConeT(linear)];
        cones.extend(std::iter::repeat_n(SecondOrderConeT(3), self.cones));
        let settings = DefaultSettings {
            verbose: false,
            max_iter: ITERATIONS,
            tol_gap_abs: GAP,
            tol_gap_rel: GAP,
            tol_feas: GAP,
            presolve_enable: false,
            max_threads: 1,
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(&p, &cost, &a, &self.right, &cones, settings).ok()?;
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
const GAP: f64 = 1e-6;
