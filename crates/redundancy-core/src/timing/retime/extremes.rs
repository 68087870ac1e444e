//! How large a polynomial gets between two rows: at its extremes, not at places.
//!
//! Bernstein coefficients bound a polynomial over [0, 1]. Where they are not above what was found already, which is so on
//! nearly every interval, the extremes need not be solved for.

/// Largest `|p0 + p1 u + p2 u^2|` over [0, 1].
pub(super) fn quadratic([p0, p1, p2]: [f64; 3]) -> f64 {
    let ends = p0.abs().max((p0 + p1 + p2).abs());
    let place = -0.5 * p1 / p2;
    if place > 0.0 && place < 1.0 { ends.max((p0 + 0.5 * p1 * place).abs()) } else { ends }
}

/// Largest absolute value of a cubic over [0, 1]; not above `floor` the larger end alone.
pub(super) fn cubic([p0, p1, p2, p3]: [f64; 4], floor: f64) -> f64 {
    let ends = p0.abs().max((p0 + p1 + p2 + p3).abs());
    let inner = (p0 + p1 / 3.0).abs().max((p0 + (2.0 * p1 + p2) / 3.0).abs());
    if inner <= ends.max(floor) {
        return ends;
    }
    let value = |u: f64| (p0 + u * (p1 + u * (p2 + u * p3))).abs();
    roots([p1, 2.0 * p2, 3.0 * p3]).into_iter().map(value).fold(ends, f64::max)
}

/// Largest absolute value of a quartic over [0, 1]; not above `floor` the larger end alone.
pub(super) fn quartic([p0, p1, p2, p3, p4]: [f64; 5], floor: f64) -> f64 {
    let ends = p0.abs().max((p0 + p1 + p2 + p3 + p4).abs());
    let controls =
        [p0 + 0.25 * p1, p0 + 0.5 * p1 + p2 / 6.0, p0 + 0.75 * p1 + 0.5 * p2 + 0.25 * p3].map(f64::abs);
    if controls.into_iter().all(|control| control <= ends.max(floor)) {
        return ends;
    }
    let slope = [p1, 2.0 * p2, 3.0 * p3, 4.0 * p4];
    let value = |u: f64| (p0 + u * (p1 + u * (p2 + u * (p3 + u * p4)))).abs();
    // Between its own extremes the slope is monotonic.
    let [a, b] = roots([slope[1], 2.0 * slope[2], 3.0 * slope[3]]);
    let cuts = [0.0, a.min(b), a.max(b), 1.0];
    cuts.windows(2).filter_map(|piece| crossing(slope, piece[0], piece[1])).map(value).fold(ends, f64::max)
}

/// Real roots of `c0 + c1 u + c2 u^2`, moved into [0, 1]; 0 in place of those that do not exist.
fn roots([c0, c1, c2]: [f64; 3]) -> [f64; 2] {
    let inside = c1 * c1 - 4.0 * c2 * c0;
    if inside < 0.0 {
        return [0.0; 2];
    }
    let sum = -0.5 * (c1 + inside.sqrt().copysign(c1));
    [sum / c2, c0 / sum].map(|u| if u.is_finite() { u.clamp(0.0, 1.0) } else { 0.0 })
}

/// The root of a cubic that is monotonic between two places, if there is one.
fn crossing([p0, p1, p2, p3]: [f64; 4], mut low: f64, mut high: f64) -> Option<f64> {
    let value = |u: f64| p0 + u * (p1 + u * (p2 + u * p3));
    let [at_low, at_high] = [value(low), value(high)];
    if low >= high || at_low * at_high > 0.0 {
        return None;
    }
    let mut u = 0.5 * (low + high);
    for _ in 0..CROSSING_STEPS {
        let here = value(u);
        if here * at_low > 0.0 {
            low = u
        } else {
            high = u
        }
        let next = u - here / (p1 + u * (2.0 * p2 + 3.0 * u * p3));
        let next = if next > low && next < high { next } else { 0.5 * (low + high) };
        if (next - u).abs() < CROSSING_WIDTH {
            return Some(next);
        }
        u = next;
    }
    Some(u)
}

/// Newton steps to a root, and the change of the place at which they end: an extreme changes with its square.
const CROSSING_STEPS: usize = 40;
const CROSSING_WIDTH: f64 = 1e-8;

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn extremes_are_those_of_a_fine_grid() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for case in 0..3_000 {
            // Bends of every size, and polynomials of lower degree.
            let mut p: [f64; 5] =
                std::array::from_fn(|_| rng.random_range(-1.0..1.0) * 10f64.powi(rng.random_range(-3..2)));
            (0..case % 4).for_each(|k| p[4 - k] = 0.0);
            let grid = |degree: usize| {
                (0..=2_000)
                    .map(|k| p[..=degree].iter().rev().fold(0.0, |sum, c| sum * f64::from(k) / 2_000.0 + c))
                    .fold(0.0, |most: f64, v: f64| most.max(v.abs()))
            };
            let size: f64 = p.iter().map(|c| c.abs()).sum();
            let got = [quadratic([p[0], p[1], p[2]]), cubic([p[0], p[1], p[2], p[3]], 0.0), quartic(p, 0.0)];
            for (degree, got) in (2..).zip(got) {
                let expected = grid(degree);
                assert!(got >= expected * (1.0 - 1e-12) && got <= expected + 2e-6 * size, "{degree} {p:?}");
            }
            let floored = quartic(p, 0.9 * got[2]);
            assert!((floored - got[2]).abs() <= 1e-12 * size, "{p:?}");
            assert!(cubic([p[0], p[1], p[2], p[3]], f64::INFINITY) <= got[1]);
        }
    }
}
