//! Null space, pseudo-inverse and singular values of a task Jacobian, without allocation.
//!
//! `J^T P = Q [R; 0]` by Householder reflections with pivoting of the rows of J. The last r = n - m columns of Q are an
//! orthonormal basis N of ker J whatever the rank of J, and `J^+ = Q [R^-T; 0] P^T` where it is full. The singular
//! values of J are those of R, by one-sided Jacobi rotations [GolubVanLoan2013, sec. 8.6.3]: small ones keep their
//! digits, which those of `J J^T` do not.
//!
//! For r = 1 the sign of N is that of `det [J; n^T] > 0`. Along a curve on which J keeps its rank this is continuous,
//! through folds too, and it changes where the curve passes straight through a singular configuration.

use nalgebra::DMatrix;

use crate::tolerance::ORTHOGONAL;

/// Memory for the factors of one `(m, n)` Jacobian, `m <= n`.
#[derive(Debug, Clone)]
pub struct NullSpace {
    m: usize,
    n: usize,
    /// Columns of `J^T P`, n entries each: above the diagonal R, from the diagonal on the reflections.
    columns: Vec<f64>,
    /// `2 / |v|^2` of each reflection; 0 where it is the identity.
    scale: Vec<f64>,
    diagonal: Vec<f64>,
    /// Row of J in each place.
    order: Vec<usize>,
    basis: DMatrix<f64>,
    work: Vec<f64>,
    triangle: Vec<f64>,
    /// Whether `det Q` times the product of the pivots is positive.
    positive: bool,
}

impl NullSpace {
    /// Memory for Jacobians of `m` rows and `n` columns; rows beyond the n-th are ignored.
    pub fn new(m: usize, n: usize) -> Self {
        let m = m.min(n);
        Self {
            m,
            n,
            columns: vec![0.0; m * n],
            scale: vec![0.0; m],
            diagonal: vec![0.0; m],
            order: (0..m).collect(),
            basis: DMatrix::zeros(n, n - m),
            work: vec![0.0; n],
            triangle: vec![0.0; m * m],
            positive: true,
        }
    }

    /// Dimension r of the null space.
    pub fn redundancy(&self) -> usize {
        self.n - self.m
    }

    /// Factors `jacobian`, `(m, n)` column by column.
    ///
    /// # Panics
    /// Never for `m n` numbers; what is missing counts as zero.
    pub fn factor(&mut self, jacobian: &[f64]) {
        self.reduce(jacobian);
        self.form_basis();
    }

    /// [`factor`](Self::factor) without the basis, which [`form_basis`](Self::form_basis) makes afterwards.
    #[inline]
    pub(super) fn reduce(&mut self, jacobian: &[f64]) {
        // Specialised for 6x7 so that the compiler can unroll.
        match (self.m, self.n) {
            (6, 7) => self.reduce_sized(jacobian, 6, 7),
            (m, n) => self.reduce_sized(jacobian, m, n),
        }
    }

    /// The basis of the kernel of the Jacobian that was reduced last.
    #[inline]
    pub(super) fn form_basis(&mut self) {
        match (self.m, self.n) {
            (6, 7) => self.form_basis_sized(6, 7),
            (m, n) => self.form_basis_sized(m, n),
        }
    }

    #[inline(always)]
    fn reduce_sized(&mut self, jacobian: &[f64], m: usize, n: usize) {
        let columns = &mut self.columns[..m * n];
        columns.fill(0.0);
        for (j, column) in jacobian.chunks_exact(m.max(1)).take(n).enumerate() {
            for (i, entry) in column.iter().enumerate() {
                columns[i * n + j] = *entry;
            }
        }
        let mut positive = m.is_multiple_of(2);
        for (i, order) in self.order.iter_mut().enumerate() {
            *order = i;
        }
        for k in 0..m {
            let mut pivot = (k, squared(&columns[k * n + k..(k + 1) * n]));
            for i in k + 1..m {
                let norm = squared(&columns[i * n + k..(i + 1) * n]);
                if norm > pivot.1 {
                    pivot = (i, norm);
                }
            }
            let (p, norm) = (pivot.0, pivot.1.sqrt());
            if p != k {
                let (front, back) = columns.split_at_mut(p * n);
                front[k * n..(k + 1) * n].swap_with_slice(&mut back[..n]);
                self.order.swap(k, p);
                positive = !positive;
            }
            let (front, rest) = columns.split_at_mut((k + 1) * n);
            let v = &mut front[k * n + k..];
            // The reflection maps the column to -sign(v0) |v| e0.
            let diagonal = if v[0] > 0.0 { -norm } else { norm };
            v[0] -= diagonal;
            let length = squared(v);
            self.diagonal[k] = diagonal;
            self.scale[k] = if length > 0.0 { 2.0 / length } else { 0.0 };
            // A column of zeros is not reflected: one sign less in det Q.
            positive ^= (diagonal < 0.0) ^ (length == 0.0);
            for other in rest.chunks_exact_mut(n) {
                reflect(v, self.scale[k], &mut other[k..]);
            }
        }
        self.positive = positive;
    }

    #[inline(always)]
    fn form_basis_sized(&mut self, m: usize, n: usize) {
        let columns = &self.columns[..m * n];
        for c in 0..n - m {
            let mut column = self.basis.column_mut(c);
            column.fill(0.0);
            column[m + c] = if n - m == 1 && !self.positive { -1.0 } else { 1.0 };
            let column = column.as_mut_slice();
            for k in (0..m).rev() {
                reflect(&columns[k * n + k..(k + 1) * n], self.scale[k], &mut column[k..]);
            }
        }
    }

    /// Orthonormal basis `(n, r)` of the kernel.
    pub fn basis(&self) -> &DMatrix<f64> {
        &self.basis
    }

    /// Smallest over largest pivot: between the ratio of the singular values and a small multiple of it.
    pub fn pivot_ratio(&self) -> f64 {
        match (self.diagonal.first(), self.diagonal.last()) {
            (Some(first), Some(last)) if *first != 0.0 => (last / first).abs(),
            _ => 0.0,
        }
    }

    /// `out = J^+ v`: the shortest joint motion (n) with the task velocity `v` (m). Directions that J has lost count as
    /// zero.
    pub fn shortest(&self, v: &[f64], out: &mut [f64]) {
        let (m, n) = (self.m, self.n);
        out.fill(0.0);
        // R^T y = P^T v, row by row.
        for k in 0..m {
            let column = &self.columns[k * n..k * n + k];
            let sum = column.iter().zip(&*out).map(|(r, y)| r * y).sum::<f64>();
            out[k] = if self.diagonal[k] == 0.0 { 0.0 } else { (v[self.order[k]] - sum) / self.diagonal[k] };
        }
        for k in (0..m).rev() {
            reflect(&self.columns[k * n + k..(k + 1) * n], self.scale[k], &mut out[k..n]);
        }
    }

    /// Splits `g` (n): `multipliers` (m) of the least-squares problem `J^T lambda = g`, that is `(J J^T)^-1 J g`.
    pub fn multipliers(&mut self, g: &[f64], multipliers: &mut [f64]) {
        let (m, n) = (self.m, self.n);
        self.work.copy_from_slice(&g[..n]);
        for k in 0..m {
            reflect(&self.columns[k * n + k..(k + 1) * n], self.scale[k], &mut self.work[k..]);
        }
        for k in (0..m).rev() {
            let above = (k + 1..m).map(|i| self.columns[i * n + k] * self.work[i]).sum::<f64>();
            let value = if self.diagonal[k] == 0.0 { 0.0 } else { (self.work[k] - above) / self.diagonal[k] };
            self.work[k] = value;
            multipliers[self.order[k]] = value;
        }
    }

    /// Smallest and largest singular value.
    pub fn singular_values(&mut self) -> [f64; 2] {
        let (m, n) = (self.m, self.n);
        if m == 0 {
            return [0.0; 2];
        }
        // Rows of R, the columns of R^T.
        for k in 0..m {
            for i in 0..m {
                self.triangle[k * m + i] = match i.cmp(&k) {
                    std::cmp::Ordering::Less => 0.0,
                    std::cmp::Ordering::Equal => self.diagonal[k],
                    std::cmp::Ordering::Greater => self.columns[i * n + k],
                };
            }
        }
        match m {
            6 => extreme_norms(&mut self.triangle, 6, &mut self.work),
            _ => extreme_norms(&mut self.triangle, m, &mut self.work),
        }
    }
}

/// Makes the rows, `m` of `m` numbers, orthogonal to each other; the least and the largest norm.
///
/// The pairs are taken in the order of a round-robin tournament: those of one round have no row in common and are
/// rotated side by side.
#[inline(always)]
fn extreme_norms(rows: &mut [f64], m: usize, norms: &mut [f64]) -> [f64; 2] {
    const SWEEPS: usize = 30;
    let players = m + m % 2;
    for _ in 0..SWEEPS {
        for (norm, row) in norms.iter_mut().zip(rows.chunks_exact(m)) {
            *norm = squared(row);
        }
        let mut rotated = false;
        for round in 0..players - 1 {
            for table in 0..players / 2 {
                // The last player stays, the others move on by one seat.
                let seat = |i: usize| if i == 0 { players - 1 } else { (round + i) % (players - 1) };
                let (a, b) = (seat(table), seat(players - 1 - table));
                let (p, q) = (a.min(b), a.max(b));
                if q < m {
                    let (front, back) = rows.split_at_mut(q * m);
                    let (above, below) = norms.split_at_mut(q);
                    let pair = (&mut front[p * m..(p + 1) * m], &mut back[..m]);
                    rotated |= orthogonalise(pair.0, pair.1, &mut above[p], &mut below[0]);
                }
            }
        }
        if !rotated {
            break;
        }
    }
    let norms = rows.chunks_exact(m).map(|row| squared(row).sqrt());
    norms.fold([f64::INFINITY, 0.0], |[least, most], norm| [least.min(norm), most.max(norm)])
}

#[inline(always)]
fn squared(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum()
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `x -= scale v (v . x)`.
#[inline(always)]
fn reflect(v: &[f64], scale: f64, x: &mut [f64]) {
    let factor = scale * dot(v, x);
    for (x, v) in x.iter_mut().zip(v) {
        *x -= factor * v;
    }
}

/// Rotates two vectors in their plane until they are orthogonal, and keeps their squared norms; false where they are.
#[inline(always)]
fn orthogonalise(a: &mut [f64], b: &mut [f64], alpha: &mut f64, beta: &mut f64) -> bool {
    let gamma = dot(a, b);
    if gamma * gamma <= ORTHOGONAL * ORTHOGONAL * *alpha * *beta {
        return false;
    }
    // The smaller root of t^2 + 2 zeta t = 1 with zeta = (beta - alpha) / (2 gamma).
    let (d, double) = (*beta - *alpha, 2.0 * gamma);
    let t = double / (d + (d * d + double * double).sqrt().copysign(d));
    let cos = 1.0 / (1.0 + t * t).sqrt();
    let sin = cos * t;
    for (a, b) in a.iter_mut().zip(b) {
        (*a, *b) = (cos * *a - sin * *b, sin * *a + cos * *b);
    }
    *alpha -= t * gamma;
    *beta += t * gamma;
    true
}
