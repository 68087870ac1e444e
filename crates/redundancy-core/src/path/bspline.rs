//! Quintic B-splines on clamped knots: a basis for functions of arc length, and interpolation.
//!
//! C4, so that second derivatives of what is built on them have no kinks at the knots. The basis and its derivatives by the
//! recursion of Cox and de Boor [DeBoor1978]; interpolation by elimination within the band, which needs no pivoting since the
//! matrix is totally positive.

use nalgebra::SVector;

/// Degree.
const P: usize = 5;

/// Functions that differ from zero at a place.
pub(crate) const WIDTH: usize = P + 1;

/// The functions that are not zero at some place: values, first and second derivatives, and the index of the first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Local {
    pub first: usize,
    pub values: [[f64; WIDTH]; 3],
}

/// A basis of quintic splines.
#[derive(Debug, Clone)]
pub(crate) struct QuinticBasis {
    knots: Vec<f64>,
}

impl QuinticBasis {
    /// `intervals` equal intervals from `low` to `high`, which differ.
    pub fn uniform(low: f64, high: f64, intervals: usize) -> Self {
        let inner = (0..=intervals).map(|i| low + (high - low) * i as f64 / intervals as f64);
        Self::clamped(&inner.collect::<Vec<_>>())
    }

    /// Breaks increase strictly; at least two.
    fn clamped(breaks: &[f64]) -> Self {
        let (low, high) = (breaks[0], breaks[breaks.len() - 1]);
        let mut knots = vec![low; P];
        knots.extend_from_slice(breaks);
        knots.extend([high; P]);
        Self { knots }
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        self.knots.len() - P - 1
    }

    /// The functions at `s`, which is clamped to the knots.
    pub fn at(&self, s: f64) -> Local {
        let n = self.len();
        let s = s.clamp(self.knots[P], self.knots[n]);
        let span = self.knots.partition_point(|k| *k <= s).clamp(P + 1, n) - 1;
        let k = |i: usize| self.knots[i];
        // table[d][j]: function span - d + j of degree d.
        let mut table = [[0.0; WIDTH]; WIDTH];
        table[0][0] = 1.0;
        for d in 1..=P {
            for j in 0..=d {
                let i = span + j - d;
                let mut value = 0.0;
                if j > 0 {
                    value += (s - k(i)) / (k(i + d) - k(i)) * table[d - 1][j - 1];
                }
                if j < d {
                    value += (k(i + d + 1) - s) / (k(i + d + 1) - k(i + 1)) * table[d - 1][j];
                }
                table[d][j] = value;
            }
        }
        // Derivative of the functions of degree d from what `lower` is for degree d - 1.
        let derivative = |d: usize, lower: &[f64; WIDTH]| {
            let mut out = [0.0; WIDTH];
            for j in 0..=d {
                let i = span + j - d;
                if j > 0 {
                    out[j] += lower[j - 1] / (k(i + d) - k(i));
                }
                if j < d {
                    out[j] -= lower[j] / (k(i + d + 1) - k(i + 1));
                }
                out[j] *= d as f64;
            }
            out
        };
        let first = derivative(P, &table[P - 1]);
        let second = derivative(P, &derivative(P - 1, &table[P - 2]));
        Local { first: span - P, values: [table[P], first, second] }
    }

    /// Places, one per function, at which interpolation is well posed.
    pub fn greville(&self) -> Vec<f64> {
        (0..self.len()).map(|i| self.knots[i + 1..=i + P].iter().sum::<f64>() / P as f64).collect()
    }

    /// Coefficients of the spline that takes `values` at `sites`: as many as functions, each within its function's support.
    pub fn interpolate<const D: usize>(
        &self,
        sites: &[f64],
        values: &[SVector<f64, D>],
    ) -> Vec<SVector<f64, D>> {
        let n = self.len();
        // Row i holds columns i - P ..= i + P.
        let mut band = vec![[0.0; 2 * P + 1]; n];
        for (i, s) in sites.iter().enumerate().take(n) {
            let local = self.at(*s);
            for (j, value) in local.values[0].iter().enumerate() {
                if let Some(slot) = (local.first + j + P).checked_sub(i).filter(|slot| *slot <= 2 * P) {
                    band[i][slot] = *value;
                }
            }
        }
        let mut x = values.to_vec();
        for i in 0..n {
            let (row, right) = (band[i], x[i]);
            for r in i + 1..n.min(i + P + 1) {
                let slot = i + P - r;
                let factor = band[r][slot] / row[P];
                if factor != 0.0 {
                    for c in 0..=P {
                        band[r][slot + c] -= factor * row[P + c];
                    }
                    x[r] -= right * factor;
                }
            }
        }
        for i in (0..n).rev() {
            let mut sum = x[i];
            for c in 1..=P.min(n - 1 - i) {
                sum -= x[i + c] * band[i][P + c];
            }
            x[i] = sum / band[i][P];
        }
        x
    }
}

/// A quintic spline through samples, with not-a-knot ends.
#[derive(Debug, Clone)]
pub(crate) struct QuinticSpline<const D: usize> {
    basis: QuinticBasis,
    coefficients: Vec<SVector<f64, D>>,
}

impl<const D: usize> QuinticSpline<D> {
    /// The caller has made sure of: sites increase strictly, as many values. `None` for fewer than six sites.
    pub fn new(sites: &[f64], values: &[SVector<f64, D>]) -> Option<Self> {
        let n = sites.len();
        if n < WIDTH {
            return None;
        }
        // As many functions as sites: two sites at each end carry no knot, the ends themselves do.
        let mut breaks = vec![sites[0]];
        breaks.extend_from_slice(&sites[3..n - 3]);
        breaks.push(sites[n - 1]);
        let basis = QuinticBasis::clamped(&breaks);
        let coefficients = basis.interpolate(sites, values);
        Some(Self { basis, coefficients })
    }

    /// Value, first and second derivative.
    pub fn at(&self, s: f64) -> [SVector<f64, D>; 3] {
        let local = self.basis.at(s);
        local.values.map(|row| {
            row.iter()
                .enumerate()
                .fold(SVector::zeros(), |sum, (j, b)| sum + self.coefficients[local.first + j] * *b)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    #[test]
    fn reproduces_quintics() {
        let f = |x: f64| 1.0 - x + 0.5 * x * x - 2.0 * x.powi(3) + x.powi(5);
        let d = |x: f64| -1.0 + x - 6.0 * x * x + 5.0 * x.powi(4);
        let dd = |x: f64| 1.0 - 12.0 * x + 20.0 * x.powi(3);
        let sites: Vec<f64> = (0..23).map(|i| 0.05 * f64::from(i) + 0.003 * f64::from(i * i % 7)).collect();
        let values: Vec<_> = sites.iter().map(|x| Vector1::new(f(*x))).collect();
        let spline = QuinticSpline::new(&sites, &values).unwrap();
        for i in 0..=100 {
            let x = sites[0] + (sites[22] - sites[0]) * f64::from(i) / 100.0;
            let [v, first, second] = spline.at(x);
            assert!((v[0] - f(x)).abs() < 1e-12, "{x}");
            assert!((first[0] - d(x)).abs() < 1e-10, "{x}");
            assert!((second[0] - dd(x)).abs() < 1e-7, "{x}");
        }
        assert!(QuinticSpline::new(&sites[..5], &values[..5]).is_none());
    }

    #[test]
    fn the_basis_sums_to_one_and_refines() {
        let coarse = QuinticBasis::uniform(-1.0, 2.0, 9);
        assert_eq!(coarse.len(), 14);
        let c: Vec<_> = (0..14).map(|i| Vector1::new(f64::from(i * i % 5))).collect();
        let at = |basis: &QuinticBasis, c: &[Vector1<f64>], s: f64| {
            let local = basis.at(s);
            (0..WIDTH).map(|j| c[local.first + j][0] * local.values[0][j]).sum::<f64>()
        };
        let fine = QuinticBasis::uniform(-1.0, 2.0, 18);
        let sites = fine.greville();
        let values: Vec<_> = sites.iter().map(|s| Vector1::new(at(&coarse, &c, *s))).collect();
        let refined = fine.interpolate(&sites, &values);
        for i in 0..=60 {
            let s = -1.0 + 0.05 * f64::from(i);
            let local = coarse.at(s);
            for (row, sum) in local.values.iter().zip([1.0, 0.0, 0.0]) {
                assert!((row.iter().sum::<f64>() - sum).abs() < 1e-10);
            }
            assert!((at(&coarse, &c, s) - at(&fine, &refined, s)).abs() < 1e-12);
        }
    }
}
