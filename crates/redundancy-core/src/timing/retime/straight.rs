//! The time law of a straight line in joint space from rest to rest: up to seven phases of constant jerk, in closed form
//! [BiagiottiMelchiorri2008, section 3.4].

/// A time law `s(t)` from 0 to its length.
#[derive(Debug, Clone)]
pub(super) struct StraightLaw {
    /// Ends of the phases, s, from 0.
    ends: Vec<f64>,
    /// `s`, speed and acceleration at the beginning of each phase, and its jerk.
    phases: Vec<[f64; 4]>,
}

impl StraightLaw {
    /// The fastest law over `length` with speed, acceleration and jerk at most `v`, `a` and `j` (`inf` for no jerk limit).
    pub fn new(length: f64, v: f64, a: f64, j: f64) -> Self {
        // Lengths of the jerk phase, of the whole acceleration, and of constant speed.
        let (mut jerk, mut ramp) = if j.is_infinite() {
            (0.0, v / a)
        } else if v * j >= a * a {
            (a / j, a / j + v / a)
        } else {
            ((v / j).sqrt(), 2.0 * (v / j).sqrt())
        };
        let mut cruise = if v.is_infinite() { -1.0 } else { length / v - ramp };
        if cruise < 0.0 {
            cruise = 0.0;
            if j.is_infinite() {
                ramp = (length / a).sqrt();
            } else if length * j * j >= 2.0 * a.powi(3) {
                jerk = a / j;
                ramp = jerk / 2.0 + (jerk * jerk / 4.0 + length / a).sqrt();
            } else {
                jerk = (length / (2.0 * j)).cbrt();
                ramp = 2.0 * jerk;
            }
        }
        let acceleration = if jerk > 0.0 { j * jerk } else { a };
        let j = if jerk > 0.0 { j } else { 0.0 };
        let flat = ramp - 2.0 * jerk;
        let mut law = Self { ends: vec![0.0], phases: Vec::new() };
        let up = [(jerk, 0.0, j), (flat, acceleration, 0.0), (jerk, acceleration, -j)];
        let down = [(jerk, 0.0, -j), (flat, -acceleration, 0.0), (jerk, -acceleration, j)];
        let (mut s, mut speed) = (0.0, 0.0);
        for (duration, a, j) in up.into_iter().chain([(cruise, 0.0, 0.0)]).chain(down) {
            if duration <= 0.0 {
                continue;
            }
            law.phases.push([s, speed, a, j]);
            law.ends.push(law.ends[law.ends.len() - 1] + duration);
            s += duration * (speed + duration * (a / 2.0 + duration * j / 6.0));
            speed += duration * (a + duration * j / 2.0);
        }
        law
    }

    /// When the phases change, s, with both ends.
    pub fn switches(&self) -> &[f64] {
        &self.ends
    }

    /// `s` and its first two derivatives at `t`.
    pub fn at(&self, t: f64) -> [f64; 3] {
        let phase = self.ends.partition_point(|end| *end <= t).clamp(1, self.phases.len()) - 1;
        let ([s, v, a, j], h) = (self.phases[phase], t - self.ends[phase]);
        [s + h * (v + h * (a / 2.0 + h * j / 6.0)), v + h * (a + h * j / 2.0), a + h * j]
    }

    /// When the law is at `s`, by bisection within the phase: it never goes backwards.
    pub fn when(&self, s: f64) -> f64 {
        let mut low = 0.0;
        let mut high = self.ends[self.ends.len() - 1];
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if self.at(middle)[0] < s { low = middle } else { high = middle }
        }
        high
    }
}

/// Halvings after which a time is exact to rounding.
const BISECTIONS: usize = 60;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laws_end_at_rest_at_their_length() {
        let cases = [
            (1.0, 1.0, 2.0, 10.0),
            (0.01, 1.0, 2.0, 10.0),
            (0.3, 5.0, 2.0, 10.0),
            (3.0, 0.1, 2.0, 10.0),
            (2.0, 1.0, 4.0, f64::INFINITY),
            (0.1, 1.0, 4.0, f64::INFINITY),
            (2.0, f64::INFINITY, 4.0, 7.0),
        ];
        for (length, v, a, j) in cases {
            let law = StraightLaw::new(length, v, a, j);
            let end = law.ends[law.ends.len() - 1];
            let [s, speed, _] = law.at(end);
            assert!((s - length).abs() < 1e-12 * (1.0 + length), "{s} for {length}");
            assert!(speed.abs() < 1e-12);
            for k in 0..=1000 {
                let [_, speed, acceleration] = law.at(end * f64::from(k) / 1000.0);
                assert!(speed <= v * (1.0 + 1e-12) && acceleration.abs() <= a * (1.0 + 1e-12));
            }
        }
    }
}
