//! `J^# v + P eta`: the (damped) pseudoinverse for the task, the exact projector for the freedom.
//!
//! Where J is well conditioned, with `A = J J^T` and one Cholesky factorisation
//!
//! ```text
//! J^+ v + (I - J^+ J) eta = eta + J^T A^-1 (v - J eta)
//! ```
//!
//! `trace(A^-1)` bounds the least singular value from below at the cost of a few products, so the singular values
//! themselves are computed only near a singularity. There `I - J^# J` with the damped inverse would leak into the task;
//! the projector is built from the right singular vectors instead and is exact whatever the damping.

use super::damping::Damping;
use super::linear::{Cholesky, Svd, along, dot, gram, times};
use crate::tolerance::{REFINED_SHARE, SINGULAR_RANK, WELL_CONDITIONED};

/// Damping and the memory for singular values.
#[derive(Debug, Clone)]
pub(super) struct PseudoInverse {
    damping: Option<Damping>,
    svd: Svd,
    /// Largest singular value that counts as zero at the last q.
    zero: f64,
}

/// J at one q, prepared.
#[derive(Debug, Clone, Copy)]
pub(super) enum Factor<const M: usize> {
    /// Far from singularities.
    Regular {
        cholesky: Cholesky<M>,
        /// One correction more makes up for the condition of the Gram matrix.
        refine: bool,
    },
    /// The singular values are in the memory.
    Values,
}

/// What was lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loss {
    /// Largest damping factor.
    pub damping: f64,
    /// A singular value is zero.
    pub rank_lost: bool,
}

impl Loss {
    pub const NONE: Self = Self { damping: 0.0, rank_lost: false };

    pub fn any(&self) -> bool {
        self.damping > 0.0 || self.rank_lost
    }
}

impl PseudoInverse {
    pub fn new(damping: Option<Damping>, m: usize, n: usize) -> Self {
        Self { damping, svd: Svd::new(m, n), zero: 0.0 }
    }

    /// Prepares J, given by its columns.
    #[inline(always)]
    pub fn factor<const M: usize>(&mut self, columns: &[[f64; M]]) -> Factor<M> {
        let floor = self.damping.map_or(WELL_CONDITIONED, |d| d.threshold.max(WELL_CONDITIONED));
        let gram = gram(columns);
        if let Some(cholesky) = Cholesky::new(&gram) {
            let square = cholesky.trace_of_inverse().recip();
            if square >= floor * floor {
                let size: f64 = (0..M).map(|i| gram[i][i]).sum();
                return Factor::Regular { cholesky, refine: square < REFINED_SHARE * size };
            }
        }
        self.find_values(columns);
        Factor::Values
    }

    /// Finds the singular values, which [`project`](Self::project) needs.
    pub fn find_values<const M: usize>(&mut self, columns: &[[f64; M]]) {
        self.svd.decompose(columns.as_flattened(), M);
        self.zero = SINGULAR_RANK * self.svd.sigma().iter().copied().fold(0.0, f64::max);
    }

    /// What the inverse loses at this q.
    pub fn loss<const M: usize>(&self, factor: &Factor<M>) -> Loss {
        match factor {
            Factor::Regular { .. } => Loss::NONE,
            Factor::Values => {
                let damping = |sigma: f64| self.damping.map_or(0.0, |d| d.square(sigma));
                let square = self.svd.sigma().iter().map(|sigma| damping(*sigma)).fold(0.0, f64::max);
                Loss { damping: square.sqrt(), rank_lost: self.svd.smallest() <= self.zero }
            }
        }
    }

    /// `out = J^# v + P eta`.
    #[inline(always)]
    pub fn solve<const M: usize>(
        &self,
        factor: &Factor<M>,
        columns: &[[f64; M]],
        eta: &[f64],
        v: &[f64; M],
        out: &mut [f64],
    ) {
        match factor {
            Factor::Regular { cholesky, refine } => {
                out.copy_from_slice(eta);
                correct(cholesky, columns, v, out);
                if *refine {
                    correct(cholesky, columns, v, out);
                }
            }
            Factor::Values => {
                self.project(eta, out);
                self.add_task(v, out);
            }
        }
    }

    /// `out = P x`, from the singular values of the last [`factor`](Self::factor).
    pub fn project(&self, x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(x);
        // Twice: what rounding leaves of large gradients is removed too.
        for _ in 0..2 {
            for (_, _, v) in self.svd.triples().filter(|(sigma, ..)| *sigma > self.zero) {
                let part = dot(v, out);
                out.iter_mut().zip(v).for_each(|(out, v)| *out -= part * v);
            }
        }
    }

    /// Adds `J^# v`.
    fn add_task<const M: usize>(&self, velocity: &[f64; M], out: &mut [f64]) {
        for (sigma, u, v) in self.svd.triples().filter(|(sigma, ..)| *sigma > self.zero) {
            let inverse = self.damping.map_or_else(|| sigma.recip(), |d| d.inverse(sigma));
            let factor = inverse * dot(u, velocity);
            out.iter_mut().zip(v).for_each(|(out, v)| *out += factor * v);
        }
    }

    /// Right singular vectors that J has rank for, one after the other in `out`; returns how many.
    pub fn row_space(&self, out: &mut [f64]) -> usize {
        let mut rank = 0;
        for ((_, _, v), row) in self
            .svd
            .triples()
            .filter(|(sigma, ..)| *sigma > self.zero)
            .zip(out.chunks_exact_mut(self.svd.width()))
        {
            row.copy_from_slice(v);
            rank += 1;
        }
        rank
    }
}

/// Adds `J^T A^-1 (v - J out)`.
#[inline(always)]
fn correct<const M: usize>(cholesky: &Cholesky<M>, columns: &[[f64; M]], v: &[f64; M], out: &mut [f64]) {
    let done = times(columns, out);
    let mut missing = *v;
    for i in 0..M {
        missing[i] -= done[i];
    }
    let y = cholesky.solve(missing);
    for (out, column) in out.iter_mut().zip(columns) {
        *out += along(column, &y);
    }
}
