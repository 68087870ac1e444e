//! The normal equations `(sum_i c_i c_i^T + mu I) y = e` of a damped least-norm step, where `c_i` are the columns of a Jacobian.
//!
//! The columns have a fixed length M so that the loops unroll; Jacobians with fewer rows are padded with zeros, which
//! `mu > 0` keeps regular. The factors are `L D L^T` without square roots [GolubVanLoan2013, sec. 4.1].

use std::borrow::Borrow;

/// Lower triangle of `sum c c^T + mu I` over the columns.
#[inline(always)]
pub(crate) fn normal_matrix<const M: usize>(
    columns: impl Iterator<Item = impl Borrow<[f64; M]>>,
    mu: f64,
) -> [[f64; M]; M] {
    let mut a = [[0.0; M]; M];
    for column in columns {
        let column = column.borrow();
        for i in 0..M {
            for j in 0..=i {
                a[i][j] += column[i] * column[j];
            }
        }
    }
    for (i, row) in a.iter_mut().enumerate() {
        row[i] += mu;
    }
    a
}

/// `L D L^T` in place: the inverse of D on the diagonal, L below it. The matrix is positive definite.
#[inline(always)]
pub(crate) fn factor<const M: usize>(a: &mut [[f64; M]; M]) {
    for j in 0..M {
        let mut scaled = [0.0; M];
        for k in 0..j {
            scaled[k] = a[j][k] / a[k][k];
        }
        let mut d = a[j][j];
        for k in 0..j {
            d -= a[j][k] * scaled[k];
        }
        let inverse = 1.0 / d;
        a[j][j] = inverse;
        for i in j + 1..M {
            let mut x = a[i][j];
            for k in 0..j {
                x -= a[i][k] * scaled[k];
            }
            a[i][j] = x * inverse;
        }
    }
}

/// Solves with the factors of [`factor`].
#[inline(always)]
pub(crate) fn solve<const M: usize>(a: &[[f64; M]; M], b: &[f64; M]) -> [f64; M] {
    let mut x = *b;
    for i in 0..M {
        for k in 0..i {
            x[i] -= a[i][k] * x[k];
        }
    }
    for i in 0..M {
        x[i] *= a[i][i];
    }
    for i in (0..M).rev() {
        for k in i + 1..M {
            x[i] -= a[k][i] * x[k];
        }
    }
    x
}
