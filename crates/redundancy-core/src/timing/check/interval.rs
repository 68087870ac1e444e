//! The motion of one joint between two rows, and how large it gets there.
//!
//! Every derivative is a polynomial of the place `u` in [0, 1]. Its Bernstein coefficients bound it, which is all that most
//! intervals need; only where the bound is above the limit is the polynomial itself looked at.

use crate::path::Trajectory;

/// Degree of the polynomials.
const DEGREE: usize = 5;
/// Places at which a polynomial is checked whose bound exceeds a limit.
const PLACES: usize = 64;

/// Coefficients by powers of `u`.
pub(super) type Polynomial = [f64; DEGREE + 1];

/// `C(i, k) / C(5, k)`: row i of the matrix that turns coefficients by powers into Bernstein coefficients.
const BERNSTEIN: [[f64; DEGREE + 1]; DEGREE + 1] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 0.2, 0.0, 0.0, 0.0, 0.0],
    [1.0, 0.4, 0.1, 0.0, 0.0, 0.0],
    [1.0, 0.6, 0.3, 0.1, 0.0, 0.0],
    [1.0, 0.8, 0.6, 0.4, 0.2, 0.0],
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
];

/// Position of joint `j` between the rows `k` and `k + 1` as [`Trajectory::sample`] has it.
pub(super) fn position(trajectory: &Trajectory, k: usize, j: usize) -> Polynomial {
    let (n, h) = (trajectory.dof(), trajectory.t()[k + 1] - trajectory.t()[k]);
    let (a, b) = (k * n + j, (k + 1) * n + j);
    let (q, qd) = (trajectory.q(), trajectory.qd());
    let (rise, va, vb) = (q[b] - q[a], qd[a] * h, qd[b] * h);
    match trajectory.qdd() {
        Some(qdd) => {
            let (aa, ab) = (qdd[a] * h * h, qdd[b] * h * h);
            let e = rise - va - 0.5 * aa;
            let (f, g) = (vb - va - aa, ab - aa);
            let high = [10.0 * e - 4.0 * f + 0.5 * g, -15.0 * e + 7.0 * f - g, 6.0 * e - 3.0 * f + 0.5 * g];
            [q[a], va, 0.5 * aa, high[0], high[1], high[2]]
        }
        None => [q[a], va, 3.0 * rise - 2.0 * va - vb, va + vb - 2.0 * rise, 0.0, 0.0],
    }
}

/// Derivative by time, for an interval of length `h`.
pub(super) fn derivative(p: &Polynomial, h: f64) -> Polynomial {
    std::array::from_fn(|k| p.get(k + 1).map_or(0.0, |next| (k + 1) as f64 * next / h))
}

/// Value at `u`.
pub(super) fn value(p: &Polynomial, u: f64) -> f64 {
    p.iter().rev().fold(0.0, |sum, c| sum * u + c)
}

/// Bounds of the polynomial over [0, 1].
fn bounds(p: &Polynomial) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for row in &BERNSTEIN {
        let control: f64 = row.iter().zip(p).map(|(a, b)| a * b).sum();
        low = low.min(control);
        high = high.max(control);
    }
    [low, high]
}

/// The place at which `p` leaves `[low, high]` furthest, and its value there; `None` where it stays inside.
pub(super) fn leaves(p: &Polynomial, low: f64, high: f64) -> Option<(f64, f64)> {
    let [least, most] = bounds(p);
    if least >= low && most <= high {
        return None;
    }
    let outside = |v: f64| (v - high).max(low - v);
    let places = (0..=PLACES).map(|k| {
        let u = k as f64 / PLACES as f64;
        (u, value(p, u))
    });
    let worst = places.max_by(|a, b| outside(a.1).total_cmp(&outside(b.1)))?;
    (outside(worst.1) > 0.0).then_some(worst)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_and_derivatives_are_those_of_sample() {
        let names = vec!["a".to_owned()];
        let rows = (vec![0.0, 0.4], vec![0.1, 0.5], Some(vec![1.0, -2.0]));
        let cubic = Trajectory::new(names, rows.0, rows.1, rows.2, Vec::new()).expect("valid");
        let quintic = cubic.clone().with_accelerations(vec![3.0, -8.0]).expect("valid");
        for motion in [cubic, quintic] {
            let mut p = position(&motion, 0, 0);
            for order in 0..4 {
                let [low, high] = bounds(&p);
                for k in 0..=20 {
                    let u = f64::from(k) / 20.0;
                    let at = motion.sample(0.4 * u).expect("inside");
                    let expected = [at.q[0], at.qd[0], at.qdd[0], at.qddd[0]][order];
                    let got = value(&p, u);
                    assert!(
                        (got - expected).abs() < 1e-9 * (1.0 + expected.abs()),
                        "{order} {got} {expected}"
                    );
                    assert!(low <= got + 1e-9 && got <= high + 1e-9);
                }
                p = derivative(&p, 0.4);
            }
        }
        let parabola = [0.0, 4.0, -4.0, 0.0, 0.0, 0.0];
        assert_eq!(leaves(&parabola, 0.0, 0.99), Some((0.5, 1.0)));
        assert_eq!(leaves(&parabola, 0.0, 1.0), None);
    }
}
