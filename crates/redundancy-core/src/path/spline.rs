//! Cubic spline with not-a-knot ends through vectors of a fixed size.

use nalgebra::SVector;

/// C2 interpolation of `D` channels; knots strictly increase.
#[derive(Debug, Clone)]
pub(super) struct CubicSpline<const D: usize> {
    knots: Vec<f64>,
    values: Vec<SVector<f64, D>>,
    slopes: Vec<SVector<f64, D>>,
}

impl<const D: usize> CubicSpline<D> {
    /// The caller has made sure of: at least one knot, as many values, knots strictly increasing, all finite.
    pub fn new(knots: Vec<f64>, values: Vec<SVector<f64, D>>) -> Self {
        let slopes = slopes(&knots, &values);
        Self { knots, values, slopes }
    }

    /// Value, first and second derivative at `x`, which is clamped to the knots.
    pub fn at(&self, x: f64) -> [SVector<f64, D>; 3] {
        let last = self.knots.len() - 1;
        if last == 0 {
            return [self.values[0], SVector::zeros(), SVector::zeros()];
        }
        let i = self.knots.partition_point(|k| *k <= x).clamp(1, last) - 1;
        let h = self.knots[i + 1] - self.knots[i];
        let u = ((x - self.knots[i]) / h).clamp(0.0, 1.0);
        let (a, b) = (self.values[i], self.values[i + 1]);
        let (ma, mb) = (self.slopes[i] * h, self.slopes[i + 1] * h);
        let rise = b - a;
        // Hermite form a + ma u + c u^2 + d u^3.
        let c = rise * 3.0 - ma * 2.0 - mb;
        let d = ma + mb - rise * 2.0;
        [
            // From the nearer end, so that both samples are met to the last bit.
            if u <= 0.5 { a + (ma + (c + d * u) * u) * u } else { b - from_end(&mb, &c, &d, 1.0 - u) },
            (ma + (c * 2.0 + d * (3.0 * u)) * u) / h,
            (c * 2.0 + d * (6.0 * u)) / (h * h),
        ]
    }
}

/// `p(1) - p(1 - v)` of the cubic whose slope at 1 is `mb`.
fn from_end<const D: usize>(
    mb: &SVector<f64, D>,
    c: &SVector<f64, D>,
    d: &SVector<f64, D>,
    v: f64,
) -> SVector<f64, D> {
    (mb - (c + d * 3.0 - d * v) * v) * v
}

/// Slopes at the knots that make the second derivative continuous; the third too at the second and last but one knot.
fn slopes<const D: usize>(x: &[f64], y: &[SVector<f64, D>]) -> Vec<SVector<f64, D>> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let secant: Vec<SVector<f64, D>> = (1..n).map(|i| (y[i] - y[i - 1]) / h[i - 1]).collect();
    match n {
        0 | 1 => vec![SVector::zeros(); n],
        2 => vec![secant[0]; 2],
        // One parabola through three points.
        3 => {
            let middle = (secant[0] * h[1] + secant[1] * h[0]) / (h[0] + h[1]);
            vec![secant[0] * 2.0 - middle, middle, secant[1] * 2.0 - middle]
        }
        _ => {
            // Tridiagonal rows lower * m[i-1] + diagonal * m[i] + upper * m[i+1] = right.
            let (mut diagonal, mut upper, mut right) =
                (vec![0.0; n], vec![0.0; n], vec![SVector::zeros(); n]);
            let mut lower = vec![0.0; n];
            let width = h[0] + h[1];
            diagonal[0] = h[1];
            upper[0] = width;
            right[0] = (secant[0] * ((h[0] + 2.0 * width) * h[1]) + secant[1] * (h[0] * h[0])) / width;
            for i in 1..n - 1 {
                lower[i] = h[i];
                diagonal[i] = 2.0 * (h[i - 1] + h[i]);
                upper[i] = h[i - 1];
                right[i] = (secant[i - 1] * h[i] + secant[i] * h[i - 1]) * 3.0;
            }
            let (a, b) = (h[n - 3], h[n - 2]);
            let width = a + b;
            lower[n - 1] = width;
            diagonal[n - 1] = a;
            right[n - 1] = (secant[n - 3] * (b * b) + secant[n - 2] * ((2.0 * width + b) * a)) / width;
            for i in 1..n {
                let factor = lower[i] / diagonal[i - 1];
                diagonal[i] -= factor * upper[i - 1];
                let carried = right[i - 1] * factor;
                right[i] -= carried;
            }
            let mut slopes = right;
            slopes[n - 1] /= diagonal[n - 1];
            for i in (0..n - 1).rev() {
                let next = slopes[i + 1] * upper[i];
                slopes[i] = (slopes[i] - next) / diagonal[i];
            }
            slopes
        }
    }
}

/// First and second derivatives, at every row, of the cubic splines through rows of `n` numbers. Rows that share their
/// `s` (a stop) share one knot and thus their derivatives. The caller has made sure that `s` does not decrease.
pub(crate) fn knot_derivatives(s: &[f64], rows: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
    let knots: Vec<usize> = (0..s.len()).filter(|i| *i == 0 || s[*i] > s[*i - 1]).collect();
    let x: Vec<f64> = knots.iter().map(|i| s[*i]).collect();
    let (mut first, mut second) = (vec![0.0; rows.len()], vec![0.0; rows.len()]);
    // Several channels at a time share the elimination.
    let mut column = 0;
    while column < n {
        let width = (n - column).min(CHANNELS);
        let y: Vec<SVector<f64, CHANNELS>> = knots
            .iter()
            .map(|i| SVector::from_fn(|c, _| if c < width { rows[i * n + column + c] } else { 0.0 }))
            .collect();
        let m = slopes(&x, &y);
        let mut knot = 0;
        for i in 0..s.len() {
            if knot + 1 < knots.len() && knots[knot + 1] <= i {
                knot += 1;
            }
            let (d, dd) = match x.len() {
                0 | 1 => (SVector::zeros(), SVector::zeros()),
                len if knot + 1 < len => {
                    let h = x[knot + 1] - x[knot];
                    (m[knot], ((y[knot + 1] - y[knot]) * (6.0 / h) - m[knot] * 4.0 - m[knot + 1] * 2.0) / h)
                }
                _ => {
                    let h = x[knot] - x[knot - 1];
                    (m[knot], (m[knot - 1] * 2.0 + m[knot] * 4.0 - (y[knot] - y[knot - 1]) * (6.0 / h)) / h)
                }
            };
            first[i * n + column..i * n + column + width].copy_from_slice(&d.as_slice()[..width]);
            second[i * n + column..i * n + column + width].copy_from_slice(&dd.as_slice()[..width]);
        }
        column += width;
    }
    (first, second)
}

/// Channels of [`knot_derivatives`] that are solved together: a register of vectors, and most arms at once.
const CHANNELS: usize = 8;

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    #[test]
    fn reproduces_cubics() {
        let f = |x: f64| 1.0 - 2.0 * x + 0.5 * x * x - 0.3 * x * x * x;
        let knots = vec![0.0, 0.1, 0.35, 0.4, 1.0, 1.7];
        let spline = CubicSpline::new(knots.clone(), knots.iter().map(|x| Vector1::new(f(*x))).collect());
        for i in 0..=170 {
            let x = f64::from(i) / 100.0;
            let [v, d, dd] = spline.at(x);
            assert!((v[0] - f(x)).abs() < 1e-13);
            assert!((d[0] - (-2.0 + x - 0.9 * x * x)).abs() < 1e-12);
            assert!((dd[0] - (1.0 - 1.8 * x)).abs() < 1e-11);
        }
    }

    #[test]
    fn derivatives_at_the_knots_are_the_splines() {
        let knots: Vec<f64> = (0..12).map(|i| 0.1 * f64::from(i) + 0.01 * f64::from(i * i % 5)).collect();
        let f = |x: f64, c: usize| (x * (1.0 + c as f64)).sin();
        let rows: Vec<f64> = knots.iter().flat_map(|x| (0..9).map(|c| f(*x, c))).collect();
        let (d, dd) = knot_derivatives(&knots, &rows, 9);
        for c in 0..9 {
            let spline =
                CubicSpline::new(knots.clone(), knots.iter().map(|x| Vector1::new(f(*x, c))).collect());
            for (i, x) in knots.iter().enumerate() {
                let [_, first, second] = spline.at(*x);
                assert!((d[i * 9 + c] - first[0]).abs() < 1e-12);
                assert!((dd[i * 9 + c] - second[0]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn few_knots_give_lines_and_parabolas() {
        let line = CubicSpline::new(vec![0.0, 2.0], vec![Vector1::new(1.0), Vector1::new(5.0)]);
        assert_eq!(line.at(0.5)[0][0], 2.0);
        let f = |x: f64| 3.0 * x * x - x;
        let knots = vec![-1.0, 0.5, 2.0];
        let parabola = CubicSpline::new(knots.clone(), knots.iter().map(|x| Vector1::new(f(*x))).collect());
        for x in [-1.0, -0.3, 0.5, 0.6, 2.0] {
            assert!((parabola.at(x)[0][0] - f(x)).abs() < 1e-14);
        }
        let point = CubicSpline::new(vec![1.0], vec![Vector1::new(4.0)]);
        assert_eq!(point.at(7.0)[0][0], 4.0);
    }

    #[test]
    fn second_derivative_is_continuous_and_samples_are_met() {
        let knots: Vec<f64> = (0..20).map(|i| f64::from(i) + 0.3 * f64::from(i * i % 7)).collect();
        let values: Vec<_> = knots.iter().map(|x| Vector1::new(x.sin())).collect();
        let spline = CubicSpline::new(knots.clone(), values.clone());
        for (x, y) in knots.iter().zip(&values) {
            assert_eq!(spline.at(*x)[0], *y);
            let (before, after) = (spline.at(x - 1e-9), spline.at(x + 1e-9));
            assert!((before[2] - after[2]).norm() < 1e-6);
        }
    }
}
