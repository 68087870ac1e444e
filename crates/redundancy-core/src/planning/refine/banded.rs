//! Symmetric block-tridiagonal systems with a border, by block Cholesky factors.
//!
//! ```text
//! [ T   G ]   T: blocks A_k on the diagonal, B_k below it (row k+1, column k), all r x r
//! [ G^T E ]   G: one column block of width b per row, E: b x b
//! ```
//!
//! The border carries what couples to every row: the last row of a closed path, and the peak speed. Directions that cost
//! nothing (a last joint that turns about a free tool axis) leave a pivot of rounding, which is not taken for negative.

/// The system and its factors.
#[derive(Debug, Clone)]
pub(super) struct Banded {
    pub rows: usize,
    pub r: usize,
    pub b: usize,
    /// `A_k`, `r x r` row by row.
    pub diagonal: Vec<f64>,
    /// `B_k` between rows k and k + 1: `r x r` row by row, rows of block k + 1.
    pub below: Vec<f64>,
    /// `G_k`, `r x b` row by row.
    pub border: Vec<f64>,
    /// `E`, `b x b`.
    pub corner: Vec<f64>,
}

impl Banded {
    pub fn new(rows: usize, r: usize, b: usize) -> Self {
        Self {
            rows,
            r,
            b,
            diagonal: vec![0.0; rows * r * r],
            below: vec![0.0; rows.saturating_sub(1) * r * r],
            border: vec![0.0; rows * r * b],
            corner: vec![0.0; b * b],
        }
    }

    /// Factors in place with `shift` added to the diagonal of the rows; false where it is not positive definite.
    pub fn factor(&mut self, shift: f64, flat: f64) -> bool {
        let (r, b) = (self.r, self.b);
        let mut size = [0.0; MOST];
        if r > MOST || b > MOST {
            return false;
        }
        let mut corner = [0.0; MOST];
        (0..b).for_each(|i| corner[i] = self.corner[i * b + i]);
        for k in 0..self.rows {
            for i in 0..r {
                let entry = &mut self.diagonal[(k * r + i) * r + i];
                *entry += shift;
                size[i] = entry.abs();
            }
            if k > 0 {
                // A_k -= L_k L_k^T with L_k = B_{k-1} C_{k-1}^{-T}.
                let (before, at) = self.diagonal.split_at_mut(k * r * r);
                let c = &before[(k - 1) * r * r..];
                let l = &mut self.below[(k - 1) * r * r..k * r * r];
                for row in l.chunks_exact_mut(r) {
                    forward_solve(c, r, row, 1);
                }
                for i in 0..r {
                    for j in 0..=i {
                        let dot: f64 = (0..r).map(|m| l[i * r + m] * l[j * r + m]).sum();
                        at[i * r + j] -= dot;
                    }
                }
                if b > 0 {
                    let (before, at) = self.border.split_at_mut(k * r * b);
                    let before = &before[(k - 1) * r * b..];
                    for i in 0..r {
                        for m in 0..r {
                            let factor = l[i * r + m];
                            for j in 0..b {
                                at[i * b + j] -= factor * before[m * b + j];
                            }
                        }
                    }
                }
            }
            let block = &mut self.diagonal[k * r * r..(k + 1) * r * r];
            if !cholesky(block, r, &size, flat) {
                return false;
            }
            if b > 0 {
                let block = &self.diagonal[k * r * r..(k + 1) * r * r];
                let u = &mut self.border[k * r * b..(k + 1) * r * b];
                for j in 0..b {
                    forward_solve(block, r, &mut u[j..], b);
                }
                for i in 0..b {
                    for j in 0..b {
                        let dot: f64 = (0..r).map(|m| u[m * b + i] * u[m * b + j]).sum();
                        self.corner[i * b + j] -= dot;
                    }
                }
            }
        }
        cholesky(&mut self.corner, b, &corner, flat)
    }

    /// Solves in place; the right-hand side of the border stands behind that of the rows.
    pub fn solve(&self, x: &mut [f64]) {
        let (r, b) = (self.r, self.b);
        let (x, y) = x.split_at_mut(self.rows * r);
        for k in 0..self.rows {
            if k > 0 {
                let (before, at) = x.split_at_mut(k * r);
                let before = &before[(k - 1) * r..];
                let l = &self.below[(k - 1) * r * r..k * r * r];
                for i in 0..r {
                    at[i] -= (0..r).map(|m| l[i * r + m] * before[m]).sum::<f64>();
                }
            }
            forward_solve(&self.diagonal[k * r * r..], r, &mut x[k * r..], 1);
            let u = &self.border[k * r * b..(k + 1) * r * b];
            for j in 0..b {
                y[j] -= (0..r).map(|m| u[m * b + j] * x[k * r + m]).sum::<f64>();
            }
        }
        if b > 0 {
            forward_solve(&self.corner, b, y, 1);
            backward_solve(&self.corner, b, y);
        }
        for k in (0..self.rows).rev() {
            let u = &self.border[k * r * b..(k + 1) * r * b];
            let (at, after) = x[k * r..].split_at_mut(r);
            for m in 0..r {
                at[m] -= (0..b).map(|j| u[m * b + j] * y[j]).sum::<f64>();
            }
            if k + 1 < self.rows {
                let l = &self.below[k * r * r..(k + 1) * r * r];
                for m in 0..r {
                    at[m] -= (0..r).map(|i| l[i * r + m] * after[i]).sum::<f64>();
                }
            }
            backward_solve(&self.diagonal[k * r * r..], r, at);
        }
    }
}

/// `x <- C^{-1} x` with the lower triangle `C`; entries of `x` are `stride` apart.
#[inline(always)]
fn forward_solve(c: &[f64], r: usize, x: &mut [f64], stride: usize) {
    for i in 0..r {
        let mut sum = x[i * stride];
        for j in 0..i {
            sum -= c[i * r + j] * x[j * stride];
        }
        x[i * stride] = sum / c[i * r + i];
    }
}

/// `x <- C^{-T} x`.
#[inline(always)]
fn backward_solve(c: &[f64], r: usize, x: &mut [f64]) {
    for i in (0..r).rev() {
        let mut sum = x[i];
        for j in i + 1..r {
            sum -= c[j * r + i] * x[j];
        }
        x[i] = sum / c[i * r + i];
    }
}

/// Cholesky factor of the lower triangle in place; false where a pivot is negative. A pivot that is zero but for the
/// rounding of `size` is a direction that costs nothing: it becomes `flat`.
#[inline(always)]
fn cholesky(a: &mut [f64], r: usize, size: &[f64], flat: f64) -> bool {
    for i in 0..r {
        for j in 0..=i {
            let mut sum = a[i * r + j];
            for m in 0..j {
                sum -= a[i * r + m] * a[j * r + m];
            }
            if i == j {
                let rounding = ROUNDING * size[i];
                if sum.is_nan() || sum < -rounding {
                    return false;
                }
                a[i * r + i] = (if sum <= rounding { flat.max(rounding) } else { sum }).sqrt();
            } else {
                a[i * r + j] = sum / a[j * r + j];
            }
        }
    }
    true
}

/// Rounding of a pivot, relative to what it was before the elimination.
const ROUNDING: f64 = 1e-11;
/// Largest block.
const MOST: usize = 32;

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{Rng, SeedableRng};

    #[test]
    fn solves_like_a_dense_factorisation() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        for (rows, r, b) in [(1, 1, 0), (5, 1, 1), (6, 3, 0), (7, 2, 3), (4, 4, 1)] {
            let size = rows * r + b;
            let mut banded = Banded::new(rows, r, b);
            let mut dense = DMatrix::zeros(size, size);
            let mut number = || rng.random::<f64>() - 0.5;
            let mut set = |i: usize, j: usize, v: f64| (dense[(i, j)], dense[(j, i)]) = (v, v);
            for k in 0..rows {
                for i in 0..r {
                    for j in 0..=i {
                        let v = number() + if i == j { 6.0 } else { 0.0 };
                        banded.diagonal[k * r * r + i * r + j] = v;
                        set(k * r + i, k * r + j, v);
                    }
                    for j in 0..b {
                        let v = number();
                        banded.border[(k * r + i) * b + j] = v;
                        set(rows * r + j, k * r + i, v);
                    }
                    if k + 1 < rows {
                        for j in 0..r {
                            let v = number();
                            banded.below[k * r * r + i * r + j] = v;
                            set((k + 1) * r + i, k * r + j, v);
                        }
                    }
                }
            }
            for i in 0..b {
                for j in 0..=i {
                    let v = number() + if i == j { 9.0 } else { 0.0 };
                    banded.corner[i * b + j] = v;
                    banded.corner[j * b + i] = v;
                    set(rows * r + i, rows * r + j, v);
                }
            }
            let rhs = DVector::from_fn(size, |i, _| (i as f64 * 0.7).sin());
            let mut x = rhs.as_slice().to_vec();
            assert!(banded.factor(0.0, 1e-12));
            banded.solve(&mut x);
            let expected = dense.lu().solve(&rhs);
            assert!(expected.is_some_and(|e| (e - DVector::from_vec(x)).amax() < 1e-12));
        }
    }

    #[test]
    fn sees_what_is_not_positive() {
        let indefinite = || Banded { diagonal: vec![-1.0, 2.0], ..Banded::new(2, 1, 0) };
        assert!(!indefinite().factor(0.0, 1e-6));
        let mut shifted = indefinite();
        assert!(shifted.factor(2.0, 1e-6));
        let mut x = vec![1.0, 1.0];
        shifted.solve(&mut x);
        assert!((x[0] - 1.0).abs() < 1e-12 && (x[1] - 0.25).abs() < 1e-12);
    }

    #[test]
    fn a_flat_direction_is_left_alone() {
        // Two rows that only know their difference.
        let mut flat = Banded { diagonal: vec![1.0, 1.0], below: vec![-1.0], ..Banded::new(2, 1, 0) };
        assert!(flat.factor(0.0, 1e-3));
        let mut x = vec![1.0, -1.0];
        flat.solve(&mut x);
        assert!((x[0] - x[1] - 1.0).abs() < 1e-12);
    }
}
