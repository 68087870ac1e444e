//! Small dense algebra of a control step: sizes of a task (2 to 6) by a number of joints, on the stack or in memory of
//! the caller. nalgebra's decompositions of matrices with a size known at run time allocate; these do not.

/// Sum of products.
#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `J x` for the columns of J.
#[inline(always)]
pub(super) fn times<const M: usize>(columns: &[[f64; M]], x: &[f64]) -> [f64; M] {
    let mut out = [0.0; M];
    for (column, x) in columns.iter().zip(x) {
        for i in 0..M {
            out[i] += column[i] * x;
        }
    }
    out
}

/// `J^T y` for one column.
#[inline(always)]
pub(super) fn along<const M: usize>(column: &[f64; M], y: &[f64; M]) -> f64 {
    let mut sum = 0.0;
    for i in 0..M {
        sum += column[i] * y[i];
    }
    sum
}

/// Lower triangle of `J J^T`.
#[inline(always)]
pub(super) fn gram<const M: usize>(columns: &[[f64; M]]) -> [[f64; M]; M] {
    let mut a = [[0.0; M]; M];
    for c in columns {
        for i in 0..M {
            for j in 0..=i {
                a[i][j] += c[i] * c[j];
            }
        }
    }
    a
}

/// `A = L L^T` of a symmetric positive definite matrix.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cholesky<const M: usize> {
    l: [[f64; M]; M],
    /// Reciprocals of the diagonal.
    reciprocal: [f64; M],
}

impl<const M: usize> Cholesky<M> {
    /// Of the lower triangle of `a`; `None` where a pivot is not positive.
    #[inline(always)]
    pub fn new(a: &[[f64; M]; M]) -> Option<Self> {
        let mut l = *a;
        let mut reciprocal = [0.0; M];
        for j in 0..M {
            let mut pivot = l[j][j];
            for k in 0..j {
                pivot -= l[j][k] * l[j][k];
            }
            if pivot <= 0.0 || !pivot.is_finite() {
                return None;
            }
            let root = pivot.sqrt();
            l[j][j] = root;
            reciprocal[j] = 1.0 / root;
            for i in j + 1..M {
                let mut x = l[i][j];
                for k in 0..j {
                    x -= l[i][k] * l[j][k];
                }
                l[i][j] = x * reciprocal[j];
            }
        }
        Some(Self { l, reciprocal })
    }

    /// `A^-1 b`.
    #[inline(always)]
    pub fn solve(&self, mut b: [f64; M]) -> [f64; M] {
        for i in 0..M {
            for k in 0..i {
                b[i] -= self.l[i][k] * b[k];
            }
            b[i] *= self.reciprocal[i];
        }
        for i in (0..M).rev() {
            for k in i + 1..M {
                b[i] -= self.l[k][i] * b[k];
            }
            b[i] *= self.reciprocal[i];
        }
        b
    }

    /// Trace of `A^-1`: the sum of `1 / sigma^2` over the singular values of J when `A = J J^T`, so that
    /// `sigma_min >= trace^(-1/2) >= sigma_min / sqrt(M)`.
    #[inline(always)]
    pub fn trace_of_inverse(&self) -> f64 {
        // Columns of L^-1 by forward substitution.
        let mut sum = 0.0;
        for j in 0..M {
            let mut x = [0.0; M];
            x[j] = self.reciprocal[j];
            sum += x[j] * x[j];
            for i in j + 1..M {
                let mut s = 0.0;
                for k in j..i {
                    s += self.l[i][k] * x[k];
                }
                x[i] = -s * self.reciprocal[i];
                sum += x[i] * x[i];
            }
        }
        sum
    }
}

/// `P A = L U` with row pivoting.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lu<const M: usize> {
    lu: [[f64; M]; M],
    reciprocal: [f64; M],
    order: [usize; M],
}

impl<const M: usize> Lu<M> {
    /// Of the matrix with these columns; `None` where it is singular.
    #[inline(always)]
    pub fn of_columns(columns: &[[f64; M]; M]) -> Option<Self> {
        let mut lu = [[0.0; M]; M];
        for (j, column) in columns.iter().enumerate() {
            for i in 0..M {
                lu[i][j] = column[i];
            }
        }
        let mut order = [0; M];
        let mut reciprocal = [0.0; M];
        for (i, entry) in order.iter_mut().enumerate() {
            *entry = i;
        }
        for j in 0..M {
            let mut pivot = j;
            for i in j + 1..M {
                if lu[i][j].abs() > lu[pivot][j].abs() {
                    pivot = i;
                }
            }
            lu.swap(j, pivot);
            order.swap(j, pivot);
            if lu[j][j] == 0.0 || !lu[j][j].is_finite() {
                return None;
            }
            reciprocal[j] = 1.0 / lu[j][j];
            let row = lu[j];
            for below in lu.iter_mut().skip(j + 1) {
                let factor = below[j] * reciprocal[j];
                below[j] = factor;
                for k in j + 1..M {
                    below[k] -= factor * row[k];
                }
            }
        }
        Some(Self { lu, reciprocal, order })
    }

    /// `A^-1 b`.
    #[inline(always)]
    pub fn solve(&self, b: &[f64; M]) -> [f64; M] {
        let mut x = [0.0; M];
        for i in 0..M {
            let mut s = b[self.order[i]];
            for k in 0..i {
                s -= self.lu[i][k] * x[k];
            }
            x[i] = s;
        }
        for i in (0..M).rev() {
            for k in i + 1..M {
                x[i] -= self.lu[i][k] * x[k];
            }
            x[i] *= self.reciprocal[i];
        }
        x
    }

    /// `A^-T b`.
    #[inline(always)]
    pub fn solve_transposed(&self, b: &[f64; M]) -> [f64; M] {
        let mut y = *b;
        for i in 0..M {
            for k in 0..i {
                y[i] -= self.lu[k][i] * y[k];
            }
            y[i] *= self.reciprocal[i];
        }
        for i in (0..M).rev() {
            for k in i + 1..M {
                y[i] -= self.lu[k][i] * y[k];
            }
        }
        let mut x = [0.0; M];
        for i in 0..M {
            x[self.order[i]] = y[i];
        }
        x
    }

    /// Squared Frobenius norm of `A^-1`: the sum of `1 / sigma^2`.
    #[inline(always)]
    pub fn square_of_inverse(&self) -> f64 {
        let mut sum = 0.0;
        for j in 0..M {
            // Column order[j] of A^-1: L x = e_j starts at row j.
            let mut x = [0.0; M];
            x[j] = 1.0;
            for i in j + 1..M {
                for k in j..i {
                    x[i] -= self.lu[i][k] * x[k];
                }
            }
            for i in (0..M).rev() {
                for k in i + 1..M {
                    x[i] -= self.lu[i][k] * x[k];
                }
                x[i] *= self.reciprocal[i];
                sum += x[i] * x[i];
            }
        }
        sum
    }
}

/// Most sweeps of the Jacobi iteration; it converges quadratically, six are usual.
const SWEEPS: usize = 40;

/// Singular value decomposition of a wide matrix, `J = U diag(sigma) V^T`, by one-sided Jacobi rotations of its rows:
/// every singular value, however small, to full relative precision, which `J J^T` would not give.
#[derive(Debug, Clone)]
pub(super) struct Svd {
    /// Rows `v_i` of `V^T`, one after the other, each `n` long; not normalised where sigma is zero.
    rows: Vec<f64>,
    /// Rows `u_i^T`, each `m` long.
    left: Vec<f64>,
    sigma: Vec<f64>,
    n: usize,
}

impl Svd {
    /// Memory for matrices with up to `m` rows and `n` columns.
    pub fn new(m: usize, n: usize) -> Self {
        Self { rows: vec![0.0; m * n], left: vec![0.0; m * m], sigma: vec![0.0; m], n }
    }

    /// Decomposes the `m` by `n` matrix with these columns (`m` numbers each).
    pub fn decompose(&mut self, columns: &[f64], m: usize) {
        let n = columns.len() / m;
        self.n = n;
        self.rows.resize(m * n, 0.0);
        self.left.resize(m * m, 0.0);
        self.sigma.resize(m, 0.0);
        for i in 0..m {
            for j in 0..n {
                self.rows[i * n + j] = columns[j * m + i];
            }
            for j in 0..m {
                self.left[i * m + j] = f64::from(u8::from(i == j));
            }
        }
        for _ in 0..SWEEPS {
            let mut rotated = false;
            for p in 0..m {
                for q in p + 1..m {
                    rotated |= rotate(&mut self.rows, &mut self.left, n, m, p, q);
                }
            }
            if !rotated {
                break;
            }
        }
        for i in 0..m {
            let row = &mut self.rows[i * n..(i + 1) * n];
            let norm = dot(row, row).sqrt();
            self.sigma[i] = norm;
            if norm > 0.0 {
                row.iter_mut().for_each(|x| *x /= norm);
            }
        }
    }

    /// The singular values, in no order.
    pub fn sigma(&self) -> &[f64] {
        &self.sigma
    }

    /// The least one.
    pub fn smallest(&self) -> f64 {
        self.sigma.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Length of the right vectors.
    pub fn width(&self) -> usize {
        self.n
    }

    /// `(sigma, u, v)` of each.
    pub fn triples(&self) -> impl Iterator<Item = (f64, &[f64], &[f64])> {
        let m = self.sigma.len();
        let vectors = self.left.chunks_exact(m).zip(self.rows.chunks_exact(self.n));
        self.sigma.iter().zip(vectors).map(|(sigma, (u, v))| (*sigma, u, v))
    }
}

/// Makes rows p and q orthogonal; false where they are already.
fn rotate(rows: &mut [f64], left: &mut [f64], n: usize, m: usize, p: usize, q: usize) -> bool {
    let (head, tail) = rows.split_at_mut(q * n);
    let (a, b) = (&mut head[p * n..(p + 1) * n], &mut tail[..n]);
    let (alpha, beta, gamma) = (dot(a, a), dot(b, b), dot(a, b));
    // What is left of gamma after a rotation is the rounding of its sum; an underflow is no correlation.
    if gamma == 0.0 || gamma.abs() <= 4.0 * f64::EPSILON * (alpha * beta).sqrt() {
        return false;
    }
    let zeta = (beta - alpha) / (2.0 * gamma);
    let t = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = c * t;
    let turn = |a: &mut [f64], b: &mut [f64]| {
        for (x, y) in a.iter_mut().zip(b) {
            (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
        }
    };
    turn(a, b);
    let (head, tail) = left.split_at_mut(q * m);
    turn(&mut head[p * m..(p + 1) * m], &mut tail[..m]);
    t != 0.0
}

/// Orthonormal basis of what is orthogonal to `k` independent rows of length `n`: `n - k` rows in `out`.
///
/// Householder reflections turn the rows into the first k axes; the other axes turned back are the basis.
/// `rows` is overwritten.
pub(super) fn complement(rows: &mut [f64], n: usize, k: usize, out: &mut [f64]) {
    for j in 0..k {
        let (head, tail) = rows.split_at_mut((j + 1) * n);
        let row = &mut head[j * n..];
        let norm = dot(&row[j..], &row[j..]).sqrt();
        let pivot = row[j] + if row[j] < 0.0 { -norm } else { norm };
        row[..j].fill(0.0);
        row[j] = pivot;
        // The reflector v, scaled so that H = I - v v^T; a row without a part left over needs none.
        let square = dot(&row[j..], &row[j..]);
        let scale = if square > 0.0 { (2.0 / square).sqrt() } else { 0.0 };
        row[j..].iter_mut().for_each(|x| *x *= scale);
        for other in tail.chunks_exact_mut(n).take(k - j - 1) {
            reflect(&row[j..], &mut other[j..]);
        }
    }
    for (i, axis) in out.chunks_exact_mut(n).take(n - k).enumerate() {
        axis.fill(0.0);
        axis[k + i] = 1.0;
        for j in (0..k).rev() {
            reflect(&rows[j * n + j..(j + 1) * n], &mut axis[j..]);
        }
    }
}

#[inline(always)]
fn reflect(v: &[f64], x: &mut [f64]) {
    let along = dot(v, x);
    x.iter_mut().zip(v).for_each(|(x, v)| *x -= along * v);
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, SMatrix, SVector};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random<const M: usize>(rng: &mut ChaCha8Rng, n: usize) -> Vec<[f64; M]> {
        (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect()
    }

    #[test]
    fn factorisations_agree_with_nalgebra() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..200 {
            let columns = random::<6>(&mut rng, 8);
            let j = DMatrix::from_column_slice(6, 8, columns.as_flattened());
            let a = &j * j.transpose();
            let cholesky = Cholesky::new(&gram(&columns)).expect("positive definite");
            let b: [f64; 6] = random(&mut rng, 1)[0];
            let x = SVector::from(cholesky.solve(b));
            let inverse = a.clone().try_inverse().expect("regular");
            assert!((&a * x - SVector::from(b)).amax() < 1e-12 * inverse.norm());
            assert!((cholesky.trace_of_inverse() / inverse.trace() - 1.0).abs() < 1e-10);

            let square: [[f64; 6]; 6] = std::array::from_fn(|i| columns[i]);
            let s = SMatrix::<f64, 6, 6>::from_column_slice(square.as_flattened());
            let lu = Lu::of_columns(&square).expect("regular");
            let inverse = s.try_inverse().expect("regular");
            let scale = inverse.norm();
            assert!((s * SVector::from(lu.solve(&b)) - SVector::from(b)).amax() < 1e-13 * scale);
            let transposed = SVector::from(lu.solve_transposed(&b));
            assert!((s.transpose() * transposed - SVector::from(b)).amax() < 1e-13 * scale);
            assert!((lu.square_of_inverse() / inverse.norm_squared() - 1.0).abs() < 1e-10);
        }
    }

    #[test]
    fn singular_values_agree_with_nalgebra_and_keep_small_ones() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut svd = Svd::new(6, 8);
        for case in 0..200 {
            let mut columns = random::<6>(&mut rng, 8);
            // A row that is almost another one.
            let small = [1.0, 1e-4, 1e-8, 1e-12, 0.0][case % 5];
            for column in &mut columns {
                column[5] = column[4] + small * column[5];
            }
            svd.decompose(columns.as_flattened(), 6);
            let mut expected: Vec<f64> = DMatrix::from_column_slice(6, 8, columns.as_flattened())
                .singular_values()
                .iter()
                .copied()
                .collect();
            let mut sigma = svd.sigma().to_vec();
            expected.sort_by(f64::total_cmp);
            sigma.sort_by(f64::total_cmp);
            for (a, b) in sigma.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-14, "{a} {b}");
            }
            let mut again = vec![0.0; 48];
            for (sigma, u, v) in svd.triples() {
                for j in 0..8 {
                    for i in 0..6 {
                        again[6 * j + i] += sigma * u[i] * v[j];
                    }
                }
            }
            let error =
                again.iter().zip(columns.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-14, "{error}");
            // Right vectors of values above rounding are orthonormal.
            let kept: Vec<&[f64]> = svd.triples().filter(|t| t.0 > 1e-13).map(|t| t.2).collect();
            for (i, a) in kept.iter().enumerate() {
                for (j, b) in kept.iter().enumerate() {
                    let expected = f64::from(u8::from(i == j));
                    assert!((dot(a, b) - expected).abs() < 1e-12, "{i} {j} {}", dot(a, b));
                }
            }
        }
    }

    #[test]
    fn complement_is_orthonormal_and_orthogonal() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for (k, n) in [(6, 7), (6, 8), (2, 8), (5, 7), (6, 6), (0, 3)] {
            let rows: Vec<f64> = (0..k * n).map(|_| rng.random_range(-1.0..1.0)).collect();
            let mut out = vec![f64::NAN; (n - k) * n];
            complement(&mut rows.clone(), n, k, &mut out);
            for (i, a) in out.chunks_exact(n).enumerate() {
                for row in rows.chunks_exact(n) {
                    assert!(dot(a, row).abs() < 1e-14);
                }
                for (j, b) in out.chunks_exact(n).enumerate() {
                    assert!((dot(a, b) - f64::from(u8::from(i == j))).abs() < 1e-14);
                }
            }
        }
    }
}
