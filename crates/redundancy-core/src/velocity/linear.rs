//! Small dense algebra of a control step: sizes of a task (2 to 6) by a number of joints, on the stack or in memory of
//! the caller. nalgebra's decompositions of matrices with a size known at run time allocate; these do not.

/// A loop over the indices below `$m` (at most 6), written out, so that each index is known to the compiler: it keeps the
/// small matrices in registers, which it does not for loops whose bounds depend on an outer index (three times faster).
macro_rules! unrolled {
    ($i:ident < $m:ident $body:block) => {
        unrolled!(@ $i $m $body 0 1 2 3 4 5)
    };
    (@ $i:ident $m:ident $body:block $($value:literal)*) => {{
        $({
            let $i = $value;
            if $i < $m $body
        })*
    }};
}

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

/// Euclidean distance.
pub(super) fn distance<const M: usize>(a: &[f64; M], b: &[f64; M]) -> f64 {
    let mut difference = *a;
    for i in 0..M {
        difference[i] -= b[i];
    }
    dot(&difference, &difference).sqrt()
}

/// Writes the rows of J, one after the other.
#[inline(always)]
pub(super) fn write_rows<const M: usize>(columns: &[[f64; M]], rows: &mut [f64]) {
    for (i, row) in rows.chunks_exact_mut(columns.len().max(1)).take(M).enumerate() {
        row.iter_mut().zip(columns).for_each(|(entry, column)| *entry = column[i]);
    }
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
        add_square(&mut a, c, 1.0);
    }
    a
}

/// Adds `factor c c^T` to a lower triangle.
#[inline(always)]
pub(super) fn add_square<const M: usize>(a: &mut [[f64; M]; M], c: &[f64; M], factor: f64) {
    unrolled!(i < M {
        let scaled = factor * c[i];
        unrolled!(k < M {
            if k <= i {
                a[i][k] += scaled * c[k];
            }
        });
    });
}

/// `A^-1 = W^T D W` of a symmetric positive definite matrix, with W lower triangular and ones on its diagonal: the
/// inverses of the factors of `A = L D^-1 L^T`. One division per row and no root; applying it is two short sums in
/// place of two chains of substitutions.
#[derive(Debug, Clone, Copy)]
pub(super) struct InverseFactors<const M: usize> {
    w: [[f64; M]; M],
    d: [f64; M],
}

impl<const M: usize> InverseFactors<M> {
    /// Of the lower triangle of A; `None` where a pivot is not positive.
    #[inline(always)]
    pub fn new(mut gram: [[f64; M]; M]) -> Option<Self> {
        let a = &mut gram;
        let mut w = [[0.0; M]; M];
        let mut d = [0.0; M];
        let mut positive = true;
        unrolled!(j < M {
            let pivot = a[j][j];
            positive &= pivot > 0.0 && pivot < f64::INFINITY;
            d[j] = 1.0 / pivot;
            w[j][j] = 1.0;
            unrolled!(i < M {
                if i > j {
                    let factor = a[i][j] * d[j];
                    unrolled!(k < M {
                        if k <= j {
                            w[i][k] -= factor * w[j][k];
                        } else if k <= i {
                            a[i][k] -= factor * a[k][j];
                        }
                    });
                }
            });
        });
        positive.then_some(Self { w, d })
    }

    /// `A^-1 b`.
    #[inline(always)]
    pub fn solve(&self, b: &[f64; M]) -> [f64; M] {
        let mut scaled = *b;
        unrolled!(i < M {
            unrolled!(k < M {
                if k < i {
                    scaled[i] += self.w[i][k] * b[k];
                }
            });
            scaled[i] *= self.d[i];
        });
        let mut out = scaled;
        unrolled!(i < M {
            unrolled!(k < M {
                if k < i {
                    out[k] += self.w[i][k] * scaled[i];
                }
            });
        });
        out
    }

    /// Trace of `A^-1`: the sum of `1 / sigma^2` over the singular values of J when `A = J J^T`, so that
    /// `sigma_min >= trace^(-1/2) >= sigma_min / sqrt(M)`.
    #[inline(always)]
    pub fn trace(&self) -> f64 {
        let mut sum = 0.0;
        unrolled!(i < M {
            let mut square = 1.0;
            unrolled!(k < M {
                if k < i {
                    square += self.w[i][k] * self.w[i][k];
                }
            });
            sum += square * self.d[i];
        });
        sum
    }
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
    use nalgebra::{DMatrix, SVector};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random<const M: usize>(rng: &mut ChaCha8Rng, n: usize) -> Vec<[f64; M]> {
        (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect()
    }

    #[test]
    fn factors_agree_with_nalgebra() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..200 {
            let columns = random::<6>(&mut rng, 8);
            let j = DMatrix::from_column_slice(6, 8, columns.as_flattened());
            let a = &j * j.transpose();
            let factors = InverseFactors::new(gram(&columns)).expect("positive definite");
            let b: [f64; 6] = random(&mut rng, 1)[0];
            let x = SVector::from(factors.solve(&b));
            let inverse = a.clone().try_inverse().expect("regular");
            assert!((&a * x - SVector::<f64, 6>::from(b)).amax() < 1e-12 * inverse.norm());
            assert!((factors.trace() / inverse.trace() - 1.0).abs() < 1e-10);
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
