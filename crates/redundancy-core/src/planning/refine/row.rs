//! One row of a line at one iterate.

use super::super::demand::Demand;
use super::super::tool::MOST_JOINTS;
use super::bounds::MOST_ROW_BOUNDS;
use crate::kinematics::NullSpace;

/// What is linear about one row.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Orthonormal basis of the joint motions that keep the task, vector by vector.
    pub basis: Vec<f64>,
    pub hessian: Vec<f64>,
    /// Gradient for the step, and with the present multipliers.
    pub gradient: Vec<f64>,
    pub stationary: Vec<f64>,
    /// Back onto the task.
    pub back: Vec<f64>,
    /// Gradients of the row's bounds: those of the tool, then the room.
    pub tool: Vec<f64>,
    /// Their values.
    pub tool_values: [f64; MOST_ROW_BOUNDS],
    /// Factors of the equations.
    pub null: NullSpace,
    /// Whether there are factors.
    pub factored: bool,
}

impl Row {
    pub fn new(demand: &Demand) -> Self {
        let (n, m) = (demand.dof(), demand.tool.rows());
        Self {
            basis: vec![0.0; n * (n - m)],
            hessian: vec![0.0; n * n],
            gradient: vec![0.0; n],
            stationary: vec![0.0; n],
            back: vec![0.0; n],
            tool: vec![0.0; demand.bounds() * n],
            tool_values: [0.0; MOST_ROW_BOUNDS],
            null: NullSpace::new(m, n),
            factored: false,
        }
    }
}

/// `Z^T H Z` of a row.
pub(super) fn reduce(row: &Row, n: usize, r: usize, given: bool, stiffness: f64, block: &mut [f64]) {
    if given {
        block.fill(0.0);
        (0..r).for_each(|i| block[i * r + i] = stiffness);
        return;
    }
    let mut product = [0.0; MOST_JOINTS];
    for j in 0..r {
        let basis = &row.basis[j * n..(j + 1) * n];
        for (p, h) in product.iter_mut().zip(row.hessian.chunks_exact(n)) {
            *p = dot(h, basis);
        }
        for i in j..r {
            let value = dot(&row.basis[i * n..(i + 1) * n], &product[..n]);
            block[i * r + j] = value;
            block[j * r + i] = value;
        }
    }
}

#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Rows of one task of the pool.
pub(super) const CHUNK: usize = 32;
/// Largest joint step of an iteration, rad or m.
pub(super) const LONGEST: f64 = 0.4;
