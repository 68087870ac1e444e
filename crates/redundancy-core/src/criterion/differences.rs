//! Derivatives by central differences, for criteria that have no closed form of them.

use nalgebra::DMatrix;

use crate::tolerance::{GRADIENT_DIFFERENCE, VALUE_DIFFERENCE};

/// Writes the gradient of `value` at `q` to `out` (n) from `2 n` values.
///
/// ```
/// let mut gradient = [0.0; 2];
/// let square = |q: &[f64]| q[0] * q[0] * q[1];
/// redundancy_core::criterion::gradient_by_differences(square, &[2.0, 3.0], &mut gradient);
/// assert!((gradient[0] - 12.0).abs() < 1e-8 && (gradient[1] - 4.0).abs() < 1e-8);
/// ```
pub fn gradient_by_differences(mut value: impl FnMut(&[f64]) -> f64, q: &[f64], out: &mut [f64]) {
    let mut at = q.to_vec();
    for (k, out) in out.iter_mut().enumerate().take(q.len()) {
        at[k] = q[k] + VALUE_DIFFERENCE;
        let plus = value(&at);
        at[k] = q[k] - VALUE_DIFFERENCE;
        let minus = value(&at);
        at[k] = q[k];
        *out = (plus - minus) / (2.0 * VALUE_DIFFERENCE);
    }
}

/// Writes the Hessian at `q` to `out` (n, n) from `2 n` gradients with the distance `step` (rad or m), made symmetric.
///
/// ```
/// use redundancy_core::{criterion::hessian_by_differences, nalgebra::DMatrix};
/// let mut hessian = DMatrix::zeros(2, 2);
/// let gradient = |q: &[f64], out: &mut [f64]| out.copy_from_slice(&[2.0 * q[0] * q[1], q[0] * q[0]]);
/// hessian_by_differences(gradient, &[2.0, 3.0], 1e-5, &mut hessian);
/// assert!((hessian[(0, 1)] - 4.0).abs() < 1e-8);
/// ```
pub fn hessian_by_differences(
    mut gradient: impl FnMut(&[f64], &mut [f64]),
    q: &[f64],
    step: f64,
    out: &mut DMatrix<f64>,
) {
    let n = q.len();
    let (mut at, mut plus, mut minus) = (q.to_vec(), vec![0.0; n], vec![0.0; n]);
    for k in 0..n {
        at[k] = q[k] + step;
        gradient(&at, &mut plus);
        at[k] = q[k] - step;
        gradient(&at, &mut minus);
        at[k] = q[k];
        for i in 0..n {
            out[(i, k)] = (plus[i] - minus[i]) / (2.0 * step);
        }
    }
    for k in 0..n {
        for i in 0..k {
            let mean = 0.5 * (out[(i, k)] + out[(k, i)]);
            (out[(i, k)], out[(k, i)]) = (mean, mean);
        }
    }
}

/// [`hessian_by_differences`] of a gradient in closed form.
pub(crate) fn hessian_of_gradient(
    gradient: impl FnMut(&[f64], &mut [f64]),
    q: &[f64],
    out: &mut DMatrix<f64>,
) {
    hessian_by_differences(gradient, q, GRADIENT_DIFFERENCE, out);
}
