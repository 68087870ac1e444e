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
use wide::f64x4;

use crate::tolerance::ORTHOGONAL;

/// Memory for the factors of one `(m, n)` Jacobian, `m <= n`.
///
/// Rows of n numbers are padded with zeros to a multiple of four, so that loops over them work on whole vectors.
#[derive(Debug, Clone)]
pub struct NullSpace {
    m: usize,
    n: usize,
    /// n, padded.
    stride: usize,
    /// Columns of `J^T P`, padded: above the diagonal R; what is left of them below does not count.
    columns: Vec<f64>,
    /// The vector v of each reflection, padded; zero above the diagonal.
    reflections: Vec<f64>,
    /// By reflection: 1 from its diagonal on, 0 above.
    masks: Vec<f64>,
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

/// The stride of five to eight joints, for which there is a version in which the compiler knows the lengths of the loops.
const EIGHT: usize = 8;

impl NullSpace {
    /// Memory for Jacobians of `m` rows and `n` columns; rows beyond the n-th are ignored.
    pub fn new(m: usize, n: usize) -> Self {
        let m = m.min(n);
        let stride = n.next_multiple_of(4).max(4);
        let mask = |k: usize| (0..stride).map(move |j| if j >= k { 1.0 } else { 0.0 });
        Self {
            m,
            n,
            stride,
            columns: vec![0.0; m * stride],
            reflections: vec![0.0; m * stride],
            masks: (0..m).flat_map(mask).collect(),
            scale: vec![0.0; m],
            diagonal: vec![0.0; m],
            order: (0..m).collect(),
            basis: DMatrix::zeros(n, n - m),
            work: vec![0.0; stride],
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
        match (self.m, self.stride) {
            (6, EIGHT) => self.reduce_sized(jacobian, 6, EIGHT),
            (m, EIGHT) => self.reduce_sized(jacobian, m, EIGHT),
            (m, stride) => self.reduce_sized(jacobian, m, stride),
        }
    }

    #[inline(always)]
    fn reduce_sized(&mut self, jacobian: &[f64], m: usize, stride: usize) {
        let columns = &mut self.columns[..m * stride];
        if jacobian.len() < m * self.n {
            columns.fill(0.0);
        }
        for (j, column) in jacobian.chunks_exact(m.max(1)).take(self.n).enumerate() {
            for (row, entry) in columns.chunks_exact_mut(stride).zip(column) {
                row[j] = *entry;
            }
        }
        let mut positive = m.is_multiple_of(2);
        for (i, order) in self.order.iter_mut().enumerate() {
            *order = i;
        }
        let masks = self.masks[..m * stride].chunks_exact(stride);
        let reflections = self.reflections[..m * stride].chunks_exact_mut(stride);
        for (k, (mask, v)) in masks.zip(reflections).enumerate() {
            let (mut p, mut square) = (k, 0.0);
            for (i, row) in (k..).zip(columns[k * stride..].chunks_exact(stride)) {
                let next = masked_square(row, mask);
                if next > square {
                    (p, square) = (i, next);
                }
            }
            let norm = square.sqrt();
            if p != k {
                let (front, back) = columns.split_at_mut(p * stride);
                front[k * stride..(k + 1) * stride].swap_with_slice(&mut back[..stride]);
                self.order.swap(k, p);
                positive = !positive;
            }
            let (front, rest) = columns.split_at_mut((k + 1) * stride);
            let row = &front[k * stride..];
            for ((v, x), mask) in v.iter_mut().zip(row).zip(mask) {
                *v = x * mask;
            }
            // The reflection maps the column to -sign(v0) |v| e0.
            let first = row[k];
            let diagonal = if first > 0.0 { -norm } else { norm };
            v[k] = first - diagonal;
            let length = 2.0 * norm * (norm + first.abs());
            let scale = if length > 0.0 { 2.0 / length } else { 0.0 };
            (self.diagonal[k], self.scale[k]) = (diagonal, scale);
            // A column of zeros is not reflected: one sign less in det Q.
            positive ^= (diagonal < 0.0) ^ (length == 0.0);
            for other in rest.chunks_exact_mut(stride) {
                reflect(v, scale, other);
            }
        }
        self.positive = positive;
    }

    /// The basis of the kernel of the Jacobian that was reduced last.
    #[inline]
    pub(super) fn form_basis(&mut self) {
        let (m, n) = (self.m, self.n);
        for c in 0..n - m {
            self.work.fill(0.0);
            self.work[m + c] = if n - m == 1 && !self.positive { -1.0 } else { 1.0 };
            self.reflect_work();
            self.basis.column_mut(c).as_mut_slice().copy_from_slice(&self.work[..n]);
        }
    }

    /// Applies Q to the work row: the last reflection first.
    #[inline(always)]
    fn reflect_work(&mut self) {
        match self.stride {
            EIGHT => apply(&self.reflections, EIGHT, &self.scale, &mut self.work),
            stride => apply(&self.reflections, stride, &self.scale, &mut self.work),
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
        if self.stride == EIGHT {
            let mut x = [0.0; EIGHT];
            self.substitute(v, &mut x);
            apply(&self.reflections, EIGHT, &self.scale, &mut x);
            for (out, x) in out.iter_mut().zip(&x) {
                *out = *x;
            }
            return;
        }
        // There is no padded memory here.
        out.fill(0.0);
        self.substitute(v, out);
        for (v, scale) in self.reflections.chunks_exact(self.stride).zip(&self.scale).rev() {
            let factor = scale * dot(v, out);
            out.iter_mut().zip(v).for_each(|(x, v)| *x -= factor * v);
        }
    }

    /// `R^T y = P^T v`, row by row.
    #[inline(always)]
    fn substitute(&self, v: &[f64], y: &mut [f64]) {
        for (k, row) in self.columns.chunks_exact(self.stride).enumerate() {
            let sum = row[..k].iter().zip(&*y).map(|(r, y)| r * y).sum::<f64>();
            let diagonal = self.diagonal[k];
            y[k] = if diagonal == 0.0 { 0.0 } else { (v[self.order[k]] - sum) / diagonal };
        }
    }

    /// Splits `g` (n): `multipliers` (m) of the least-squares problem `J^T lambda = g`, that is `(J J^T)^-1 J g`.
    pub fn multipliers(&mut self, g: &[f64], multipliers: &mut [f64]) {
        let (m, n, stride) = (self.m, self.n, self.stride);
        self.work.fill(0.0);
        self.work[..n].copy_from_slice(&g[..n]);
        for (v, scale) in self.reflections.chunks_exact(stride).zip(&self.scale) {
            reflect(v, *scale, &mut self.work);
        }
        for k in (0..m).rev() {
            let above = (k + 1..m).map(|i| self.columns[i * stride + k] * self.work[i]).sum::<f64>();
            let value = if self.diagonal[k] == 0.0 { 0.0 } else { (self.work[k] - above) / self.diagonal[k] };
            self.work[k] = value;
            multipliers[self.order[k]] = value;
        }
    }

    /// Smallest and largest singular value.
    pub fn singular_values(&mut self) -> [f64; 2] {
        let (m, stride) = (self.m, self.stride);
        if m == 0 {
            return [0.0; 2];
        }
        // Rows of R, the columns of R^T.
        for k in 0..m {
            for i in 0..m {
                self.triangle[k * m + i] = match i.cmp(&k) {
                    std::cmp::Ordering::Less => 0.0,
                    std::cmp::Ordering::Equal => self.diagonal[k],
                    std::cmp::Ordering::Greater => self.columns[i * stride + k],
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

/// The sum of four lanes.
#[inline(always)]
fn total(lanes: f64x4) -> f64 {
    let [a, b, c, d] = lanes.to_array();
    (a + c) + (b + d)
}

/// Whole vectors of a padded row.
#[inline(always)]
fn lanes(row: &[f64]) -> impl Iterator<Item = f64x4> {
    row.as_chunks::<4>().0.iter().map(|x| f64x4::new(*x))
}

/// Squared norm of what a mask of zeros and ones leaves of a padded row.
#[inline(always)]
fn masked_square(row: &[f64], mask: &[f64]) -> f64 {
    total(lanes(row).zip(lanes(mask)).fold(f64x4::ZERO, |sum, (x, mask)| sum + x * mask * x))
}

/// `x -= scale v (v . x)` on padded rows.
#[inline(always)]
fn reflect(v: &[f64], scale: f64, x: &mut [f64]) {
    let along = total(lanes(v).zip(lanes(x)).fold(f64x4::ZERO, |sum, (v, x)| sum + v * x));
    let factor = f64x4::splat(scale * along);
    for (x, v) in x.as_chunks_mut::<4>().0.iter_mut().zip(lanes(v)) {
        *x = (f64x4::new(*x) - factor * v).to_array();
    }
}

/// Applies reflections to a padded row, the last one first.
#[inline(always)]
fn apply(reflections: &[f64], stride: usize, scale: &[f64], x: &mut [f64]) {
    let x = &mut x[..stride];
    for (v, scale) in reflections.chunks_exact(stride).zip(scale).rev() {
        reflect(v, *scale, x);
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
