//! Singular values of the Jacobian of a control step, without an allocation.
//!
//! One-sided Jacobi rotations of the rows give every singular value, however small, to full relative precision, which
//! `J J^T` would not. Rows are padded to whole groups of [`LANES`] numbers, and each row of `U^T` lies behind its row
//! of `V^T`, so that a rotation is one pass; the pairs of a sweep are taken in rounds of disjoint ones (a round robin),
//! so that the roots and divisions of one rotation do not wait for those of another.

/// Numbers that are worked on together.
const LANES: usize = 4;

/// Most sweeps of the Jacobi iteration; it converges quadratically, six are usual.
const SWEEPS: usize = 40;

/// Singular value decomposition of a wide matrix, `J = U diag(sigma) V^T`.
#[derive(Debug, Clone)]
pub(super) struct Svd {
    /// Row by row: `v_i` (not normalised where sigma is zero), then `u_i`, each padded with zeros.
    rows: Vec<[f64; LANES]>,
    sigma: Vec<f64>,
    n: usize,
    /// The pairs of a sweep.
    pairs: Vec<(usize, usize)>,
}

impl Svd {
    /// Memory for matrices with up to `m` rows and `n` columns.
    pub fn new(m: usize, n: usize) -> Self {
        let stride = n.div_ceil(LANES) + m.div_ceil(LANES);
        Self { rows: vec![[0.0; LANES]; m * stride], sigma: vec![0.0; m], n, pairs: rounds(m) }
    }

    /// Groups of numbers in a row of `V^T`, and in both parts of a row.
    fn widths(&self) -> (usize, usize) {
        let right = self.n.div_ceil(LANES);
        (right, right + self.sigma.len().div_ceil(LANES))
    }

    /// Decomposes the `m` by `n` matrix with these columns (`m` numbers each).
    pub fn decompose(&mut self, columns: &[f64], m: usize) {
        self.n = columns.len() / m;
        if self.sigma.len() != m {
            self.sigma.resize(m, 0.0);
            self.pairs = rounds(m);
        }
        let (right, stride) = self.widths();
        self.rows.resize(m * stride, [0.0; LANES]);
        self.rows.fill([0.0; LANES]);
        for (i, row) in self.rows.chunks_exact_mut(stride).enumerate() {
            let (v, u) = row.split_at_mut(right);
            for (entry, column) in v.as_flattened_mut().iter_mut().zip(columns.chunks_exact(m)) {
                *entry = column[i];
            }
            u.as_flattened_mut()[i] = 1.0;
        }
        for _ in 0..SWEEPS {
            let mut rotated = false;
            for round in self.pairs.chunks((m / 2).max(1)) {
                for pairs in round.chunks(LANES) {
                    rotated |= rotate(&mut self.rows, stride, right, pairs);
                }
            }
            if !rotated {
                break;
            }
        }
        for (row, sigma) in self.rows.chunks_exact_mut(stride).zip(&mut self.sigma) {
            let v = row[..right].as_flattened_mut();
            *sigma = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            if *sigma > 0.0 {
                v.iter_mut().for_each(|x| *x /= *sigma);
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
        let (right, stride) = self.widths();
        self.sigma.iter().zip(self.rows.chunks_exact(stride)).map(move |(sigma, row)| {
            let (v, u) = row.split_at(right);
            (*sigma, &u.as_flattened()[..self.sigma.len()], &v.as_flattened()[..self.n])
        })
    }
}

/// Every pair of `m` rows, first before second, in rounds of disjoint pairs: one row stays, the others go round it; of
/// an odd number one is left out per round.
fn rounds(m: usize) -> Vec<(usize, usize)> {
    let around = m.saturating_sub(1) + m % 2;
    let mut out = Vec::with_capacity(m * m / 2);
    for round in 0..around {
        out.extend(Some((round, around)).filter(|pair| pair.1 < m));
        for k in 1..around.div_ceil(2) {
            let (a, b) = ((round + k) % around, (round + around - k) % around);
            out.push((a.min(b), a.max(b)));
        }
    }
    out
}

/// Makes the rows of each of these disjoint pairs orthogonal; false where all are already.
#[inline(always)]
fn rotate(rows: &mut [[f64; LANES]], stride: usize, right: usize, pairs: &[(usize, usize)]) -> bool {
    // Squares and product of each pair; those of a missing pair ask for no rotation.
    let (mut alpha, mut beta, mut gamma) = ([1.0; LANES], [1.0; LANES], [0.0; LANES]);
    for (i, (p, q)) in pairs.iter().enumerate() {
        let (a, b) = (&rows[p * stride..][..right], &rows[q * stride..][..right]);
        let mut sums = [[0.0; LANES]; 3];
        for (a, b) in a.iter().zip(b) {
            for k in 0..LANES {
                sums[0][k] += a[k] * a[k];
                sums[1][k] += b[k] * b[k];
                sums[2][k] += a[k] * b[k];
            }
        }
        [alpha[i], beta[i], gamma[i]] = sums.map(|s| (s[0] + s[1]) + (s[2] + s[3]));
    }
    let (mut cosine, mut sine) = ([1.0; LANES], [0.0; LANES]);
    let mut rotated = false;
    for i in 0..LANES {
        // tan(2 angle) = 2 gamma / (beta - alpha), the smaller of the two angles. What is left of gamma after a
        // rotation is the rounding of its sum; an underflow is no correlation.
        let done = gamma[i] * gamma[i] <= 16.0 * f64::EPSILON * f64::EPSILON * (alpha[i] * beta[i]);
        let difference = beta[i] - alpha[i];
        let double = if done { 0.0 } else { 2.0 * gamma[i] };
        let hypotenuse = (difference * difference + double * double).sqrt();
        let t = double.copysign(double * difference) / (difference.abs() + hypotenuse).max(f64::MIN_POSITIVE);
        cosine[i] = 1.0 / (1.0 + t * t).sqrt();
        sine[i] = cosine[i] * t;
        rotated |= t != 0.0;
    }
    for (i, (p, q)) in pairs.iter().enumerate() {
        let (head, tail) = rows.split_at_mut(q * stride);
        let (c, s) = (cosine[i], sine[i]);
        for (a, b) in head[p * stride..][..stride].iter_mut().zip(tail) {
            for k in 0..LANES {
                (a[k], b[k]) = (c * a[k] - s * b[k], s * a[k] + c * b[k]);
            }
        }
    }
    rotated
}

#[cfg(test)]
mod tests {
    use super::super::linear::dot;
    use super::*;
    use nalgebra::DMatrix;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn singular_values_agree_with_nalgebra_and_keep_small_ones() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut svd = Svd::new(6, 8);
        for case in 0..200 {
            let mut columns: Vec<[f64; 6]> =
                (0..8).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
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
}
