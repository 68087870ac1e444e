//! The best value of one joint.
//!
//! While one joint moves by `psi`, the squared distance of a point from a target is `K + a cos psi + b sin psi`, and so
//! is the squared distance of the unit axes of two frames: the sum of both, weighted, has its minimum at
//! `psi = atan2(-b, -a)` [FromGravdahl2007, eqs (17) to (41), with two corrections: eq. (25) as
//! printed is the maximum, eqs (40) to (42) hold in the joint frame only]. For a turning joint with unit axis n through o,
//! tool at p, R, target pd, Rd, and `v = p - o`, `vd = pd - o`, `M = R Rd^T`:
//!
//! ```text
//! K = wp (|v|^2 + |vd|^2 - 2 (n.v)(n.vd)) + wo (6 - 2 n^T M n)
//! a = -2 wp (v.vd - (n.v)(n.vd)) - 2 wo (tr M - n^T M n)
//! b = -2 wp n.(v x vd) - 2 wo n.sum_i(r_i x rd_i)
//! ```
//!
//! With the distance of quaternions, `2 - 2 C.D`, instead of that of axes, half angles appear [FromGravdahl2007, eqs (27) to
//! (35)]; `psi` then runs over two turns and the stationary points are the roots on the unit circle of a quartic in
//! `z = exp(i psi / 2)`. A sliding joint gives a quadratic.

use nalgebra::{Complex, Matrix4, Rotation3, Schur, UnitQuaternion, Vector3};
use std::f64::consts::PI;

use crate::joint_space::{TURN, other_way, wrap_over};
use crate::pose::Pose;
use crate::tolerance::{HALF_ANGLE_FLAT, HALF_ANGLE_ROOT};

/// `constant + cos cos(psi) + sin sin(psi)`.
///
/// ```
/// use redundancy_core::ik::Sinusoid;
/// let (psi, value) = Sinusoid { constant: 2.0, cos: -1.0, sin: 0.0 }.minimum();
/// assert_eq!((psi, value), (0.0, 1.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sinusoid {
    /// K.
    pub constant: f64,
    /// a.
    pub cos: f64,
    /// b.
    pub sin: f64,
}

impl Sinusoid {
    /// Its value.
    pub fn at(&self, psi: f64) -> f64 {
        let (s, c) = psi.sin_cos();
        self.constant + self.cos * c + self.sin * s
    }

    /// Where it is least, in `(-pi, pi]`, and its value there. A constant is least at 0.
    pub fn minimum(&self) -> (f64, f64) {
        if self.cos == 0.0 && self.sin == 0.0 {
            return (0.0, self.constant);
        }
        let psi = (-self.sin).atan2(-self.cos);
        // Without a negative zero.
        (if psi == -PI { PI } else { psi + 0.0 }, self.constant - self.cos.hypot(self.sin))
    }

    /// By how much the minimum is below the value at 0: `a + h`, written `b^2 / (h - a)` where that cancels.
    pub fn decrease(&self) -> f64 {
        let h = self.cos.hypot(self.sin);
        if self.cos < 0.0 { self.sin * self.sin / (h - self.cos) } else { self.cos + h }
    }

    /// Where it is least within `[lower, upper]`, an interval that contains 0 and may be longer than a turn: the winding
    /// of the minimum nearest to 0, or else the better end. Returns the place and by how much the value falls below that
    /// at 0.
    pub fn minimum_within(&self, lower: f64, upper: f64) -> (f64, f64) {
        if self.cos == 0.0 && self.sin == 0.0 {
            return (0.0, 0.0);
        }
        let psi = (-self.sin).atan2(-self.cos);
        let windings = [psi, other_way(psi, TURN)];
        for wound in windings {
            if wound >= lower && wound <= upper {
                return (wound, self.decrease());
            }
        }
        // 1 - cos x and sin x without cancellation: g(0) - g(x) = a (1 - cos x) - b sin x.
        let fall = |x: f64| {
            let (s, c) = (0.5 * x).sin_cos();
            2.0 * s * (self.cos * s - self.sin * c)
        };
        let better = [lower, upper].into_iter().filter(|x| x.is_finite()).map(|x| (x, fall(x)));
        better.fold((0.0, 0.0), |best, end| if end.1 > best.1 { end } else { best })
    }

    /// The sum of two.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            constant: self.constant + other.constant,
            cos: self.cos + other.cos,
            sin: self.sin + other.sin,
        }
    }

    /// Weighted squared distance of a point from a target while the joint with unit `axis` through `origin` turns it.
    pub fn of_point(
        axis: &Vector3<f64>,
        origin: &Vector3<f64>,
        point: &Vector3<f64>,
        target: &Vector3<f64>,
        weight: f64,
    ) -> Self {
        let (v, vd) = (point - origin, target - origin);
        let along = axis.dot(&v) * axis.dot(&vd);
        Self {
            constant: weight * (v.norm_squared() + vd.norm_squared() - 2.0 * along),
            cos: -2.0 * weight * (v.dot(&vd) - along),
            sin: -2.0 * weight * axis.dot(&v.cross(&vd)),
        }
    }

    /// Weighted squared distance of the unit axes of two frames while the joint turns the first.
    pub fn of_axes(axis: &Vector3<f64>, from: &Rotation3<f64>, to: &Rotation3<f64>, weight: f64) -> Self {
        let (mut cross, mut trace) = (Vector3::zeros(), 0.0);
        let (from, to) = (from.matrix(), to.matrix());
        for j in 0..3 {
            let (a, b): (Vector3<f64>, Vector3<f64>) = (from.column(j).into(), to.column(j).into());
            cross += a.cross(&b);
            trace += a.dot(&b);
        }
        let along = from.tr_mul(axis).dot(&to.tr_mul(axis));
        Self {
            constant: weight * (6.0 - 2.0 * along),
            cos: -2.0 * weight * (trace - along),
            sin: -2.0 * weight * axis.dot(&cross),
        }
    }
}

/// `constant + cos cos(psi) + sin sin(psi) + half_cos cos(psi / 2) + half_sin sin(psi / 2)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HalfAngle {
    /// The part without half angles.
    pub whole: Sinusoid,
    /// c.
    pub half_cos: f64,
    /// d.
    pub half_sin: f64,
}

impl HalfAngle {
    /// Distance of quaternions `2 - 2 C.D`, weighted, while the joint turns `from`; added to a position part.
    pub fn of_quaternions(
        axis: &Vector3<f64>,
        from: &UnitQuaternion<f64>,
        to: &UnitQuaternion<f64>,
        weight: f64,
        position: &Sinusoid,
    ) -> Self {
        let (c, d) = (from.quaternion(), to.quaternion());
        // (0, n) * C
        let turned = nalgebra::Quaternion::from_imag(*axis) * c;
        let dot = |a: &nalgebra::Quaternion<f64>, b: &nalgebra::Quaternion<f64>| a.coords.dot(&b.coords);
        Self {
            whole: Sinusoid { constant: position.constant + 2.0 * weight, ..*position },
            half_cos: -2.0 * weight * dot(c, d),
            half_sin: -2.0 * weight * dot(d, &turned),
        }
    }

    /// Its value.
    pub fn at(&self, psi: f64) -> f64 {
        let (s, c) = (0.5 * psi).sin_cos();
        self.whole.at(psi) + self.half_cos * c + self.half_sin * s
    }

    /// Its derivative and second derivative.
    fn slopes(&self, psi: f64) -> (f64, f64) {
        let ((s, c), (sh, ch)) = (psi.sin_cos(), (0.5 * psi).sin_cos());
        let Self { whole: Sinusoid { cos: a, sin: b, .. }, half_cos: p, half_sin: q } = *self;
        (b * c - a * s + 0.5 * (q * ch - p * sh), -(a * c + b * s) - 0.25 * (p * ch + q * sh))
    }

    /// Where its derivative vanishes, over two turns `(-2 pi, 2 pi]`: up to four places, in no order. A constant has none.
    pub fn stationary_points(&self) -> Vec<f64> {
        let mut out = Vec::new();
        self.each_stationary(|psi| out.push(psi));
        out
    }

    fn each_stationary(&self, mut visit: impl FnMut(f64)) {
        let Self { whole: Sinusoid { cos: a, sin: b, .. }, half_cos: c, half_sin: d } = *self;
        let (whole, half) = (a.hypot(b), c.hypot(d));
        let size = whole.max(half);
        if size <= 0.0 || !size.is_finite() {
            return;
        }
        if whole <= HALF_ANGLE_FLAT * half {
            // 2 turns hold one minimum and one maximum.
            let psi = 2.0 * (-d).atan2(-c);
            visit(self.polished(psi));
            visit(self.polished(if psi > 0.0 { psi - TURN } else { psi + TURN }));
            return;
        }
        if half <= HALF_ANGLE_FLAT * whole {
            let psi = (-b).atan2(-a);
            for turn in [0.0, PI, TURN, -PI] {
                visit(self.polished(wrap_over(psi + turn, TWO_TURNS)));
            }
            return;
        }
        // (b + i a) z^4 + (d + i c)/2 z^3 + (d - i c)/2 z + (b - i a) = 0
        let lead = Complex::new(b, a);
        let (third, first) = (Complex::new(0.5 * d, 0.5 * c) / lead, Complex::new(0.5 * d, -0.5 * c) / lead);
        let last = lead.conj() / lead;
        let zero = Complex::new(0.0, 0.0);
        let one = Complex::new(1.0, 0.0);
        let companion = Matrix4::new(
            zero, zero, zero, -last, one, zero, zero, -first, zero, one, zero, zero, zero, zero, one, -third,
        );
        let Some(roots) = Schur::try_new(companion, f64::EPSILON, 1_000).and_then(|s| s.eigenvalues()) else {
            return;
        };
        for z in roots.iter() {
            let psi = 2.0 * z.arg();
            // Roots come on the circle or in pairs z, 1 / conj z. Newton brings those on it to full precision; from
            // the others it does not arrive.
            let exact = self.polished(psi);
            if self.slopes(exact).0.abs() <= HALF_ANGLE_ROOT * size {
                visit(exact);
            }
        }
    }

    /// A few steps of Newton's method on the derivative, given up where they do not reduce it.
    fn polished(&self, psi: f64) -> f64 {
        let (mut psi, (mut slope, mut curvature)) = (psi, self.slopes(psi));
        for _ in 0..4 {
            let next = psi - slope / curvature;
            let (s, k) = self.slopes(next);
            if s.is_nan() || s.abs() >= slope.abs() {
                break;
            }
            (psi, slope, curvature) = (next, s, k);
        }
        wrap_over(psi, TWO_TURNS)
    }

    /// Where it is least over two turns, and its value; 0 for a constant.
    pub fn minimum(&self) -> (f64, f64) {
        let mut best = (0.0, self.at(0.0));
        self.each_stationary(|psi| {
            let value = self.at(psi);
            if value < best.1 {
                best = (psi, value);
            }
        });
        best
    }

    /// Where it is least within `[lower, upper]`, an interval that contains 0, and by how much it falls below its value at
    /// 0. Two turns apart it repeats.
    pub fn minimum_within(&self, lower: f64, upper: f64) -> (f64, f64) {
        let here = self.at(0.0);
        let mut best = (0.0, here);
        let mut offer = |psi: f64, value: f64| {
            if psi >= lower && psi <= upper && value < best.1 {
                best = (psi, value);
            }
        };
        for end in [lower, upper] {
            if end.is_finite() {
                offer(end, self.at(end));
            }
        }
        self.each_stationary(|psi| {
            let value = self.at(psi);
            for wound in [psi, other_way(psi, TWO_TURNS)] {
                offer(wound, value);
            }
        });
        (best.0, here - best.1)
    }
}

/// Functions of half an angle repeat after two turns.
const TWO_TURNS: f64 = 2.0 * TURN;

/// How far a sliding joint along the unit `axis` moves to bring `point` as near to `target` as it can within
/// `[lower, upper]` (which contains 0), and by how much the weighted squared distance falls.
pub fn slide_within(
    axis: &Vector3<f64>,
    point: &Vector3<f64>,
    target: &Vector3<f64>,
    weight: f64,
    lower: f64,
    upper: f64,
) -> (f64, f64) {
    let best = axis.dot(&(target - point));
    let x = best.clamp(lower, upper);
    // g(0) - g(x) = w (2 best - x) x
    (x, weight * (2.0 * best - x) * x)
}

/// Weights of position (1/m^2) and orientation in the cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostWeights {
    /// wp.
    pub position: f64,
    /// wo.
    pub orientation: f64,
}

impl Default for CostWeights {
    /// Those of the experiments: 10 and 1.
    fn default() -> Self {
        Self { position: 10.0, orientation: 1.0 }
    }
}

/// The cost of axes of a pose against a target while the joint with unit `axis` through `origin` turns it.
pub fn pose_cost(
    axis: &Vector3<f64>,
    origin: &Vector3<f64>,
    pose: &Pose,
    target: &Pose,
    weights: &CostWeights,
) -> Sinusoid {
    let (p, pd) = (&pose.translation.vector, &target.translation.vector);
    let position = Sinusoid::of_point(axis, origin, p, pd, weights.position);
    position.plus(&Sinusoid::of_axes(axis, &pose.rotation, &target.rotation, weights.orientation))
}

/// The cost of quaternions of a pose against a target while the joint with unit `axis` through `origin` turns it.
pub fn quaternion_cost(
    axis: &Vector3<f64>,
    origin: &Vector3<f64>,
    pose: &Pose,
    target: &Pose,
    weights: &CostWeights,
) -> HalfAngle {
    let (p, pd) = (&pose.translation.vector, &target.translation.vector);
    let position = Sinusoid::of_point(axis, origin, p, pd, weights.position);
    let from = UnitQuaternion::from_rotation_matrix(&pose.rotation);
    let to = UnitQuaternion::from_rotation_matrix(&target.rotation);
    HalfAngle::of_quaternions(axis, &from, &to, weights.orientation, &position)
}
