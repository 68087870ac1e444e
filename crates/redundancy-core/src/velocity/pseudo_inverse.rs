//! `J^# v + P eta`: the (damped) pseudoinverse for the task, the exact projector for the freedom.
//!
//! Where J is well conditioned, with `A = J J^T` and one factorisation of it
//!
//! ```text
//! J^+ v + (I - J^+ J) eta = eta + J^T A^-1 (v - J eta)
//! ```
//!
//! `trace(A^-1)` bounds the least singular value from below at the cost of a few products, so the singular values
//! themselves are computed only near a singularity. There `I - J^# J` with the damped inverse would leak into the task;
//! the projector is built from the right singular vectors instead and is exact whatever the damping.

use super::damping::Damping;
use super::linear::{InverseFactors, along, dot, gram, times};
use super::singular_values::Svd;
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
    Regular(NormalEquations<M>),
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
        if let Some(equations) = NormalEquations::new(gram(columns))
            && equations.bound() >= floor
        {
            return Factor::Regular(equations);
        }
        self.find_values(columns);
        Factor::Values
    }

    /// Finds the singular values, which [`project`](Self::project) needs.
    pub fn find_values<const M: usize>(&mut self, columns: &[[f64; M]]) {
        self.svd.decompose(columns.as_flattened(), M);
        self.zero = SINGULAR_RANK * self.svd.sigma().iter().copied().fold(0.0, f64::max);
    }

    /// Whether the least singular value may be below `size`; far from singularities by a bound.
    pub fn may_be_below<const M: usize>(&self, factor: &Factor<M>, size: f64) -> bool {
        match factor {
            Factor::Regular(equations) => equations.bound() < size,
            Factor::Values => self.svd.smallest() < size,
        }
    }

    /// What the inverse loses at this q.
    pub fn loss<const M: usize>(&self, factor: &Factor<M>) -> Loss {
        match factor {
            Factor::Regular(_) => Loss::NONE,
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
            Factor::Regular(equations) => {
                out.copy_from_slice(eta);
                equations.meet(columns, v, out);
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

/// `A = J J^T` of a Jacobian that is far from singular, factored.
#[derive(Debug, Clone, Copy)]
pub(super) struct NormalEquations<const M: usize> {
    factors: InverseFactors<M>,
    /// Trace of `A^-1`.
    trace: f64,
    /// One correction more makes up for the condition of A, which is the square of that of J.
    refine: bool,
}

impl<const M: usize> NormalEquations<M> {
    /// Of the lower triangle of A; `None` where A is not positive definite.
    #[inline(always)]
    pub fn new(gram: [[f64; M]; M]) -> Option<Self> {
        let size: f64 = (0..M).map(|i| gram[i][i]).sum();
        let factors = InverseFactors::new(gram)?;
        let trace = factors.trace();
        Some(Self { factors, trace, refine: 1.0 < REFINED_SHARE * size * trace })
    }

    /// Lower bound of the least singular value of J, low by a factor of at most `sqrt(M)`.
    #[inline(always)]
    pub fn bound(&self) -> f64 {
        self.trace.sqrt().recip()
    }

    /// The sum of `1 / sigma^2` over the singular values of J.
    #[inline(always)]
    pub fn trace(&self) -> f64 {
        self.trace
    }

    /// `A^-1 b`.
    #[inline(always)]
    pub fn solve(&self, b: &[f64; M]) -> [f64; M] {
        self.factors.solve(b)
    }

    /// Moves `out` by the least step to where `J out = v`; `columns` are those of J.
    #[inline(always)]
    pub fn meet(&self, columns: &[[f64; M]], v: &[f64; M], out: &mut [f64]) {
        for _ in 0..1 + usize::from(self.refine) {
            let done = times(columns, out);
            let missing: [f64; M] = std::array::from_fn(|i| v[i] - done[i]);
            let y = self.factors.solve(&missing);
            for (out, column) in out.iter_mut().zip(columns) {
                *out += along(column, &y);
            }
        }
    }
}
