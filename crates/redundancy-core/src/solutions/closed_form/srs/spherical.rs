//! The three angles of a spherical joint as functions of the swivel.
//!
//! With `u = (cos s, sin s)` every entry of `R3` and of `R47` is a sinusoid `c0 + c1 cos s + c2 sin s`. The outer ZYZ
//! angles are arc tangents of two of them, the cosine of the middle angle is one.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::elbow_circle::ElbowCircle;
use super::geometry::Geometry;
use crate::joint_space::wrap;
use crate::tolerance::{GIMBAL_NEAR, GIMBAL_PASSAGE, GIMBAL_SINE, SINUSOID_FLAT, SINUSOID_TANGENT};

/// `c0 + c1 cos s + c2 sin s`.
#[derive(Debug, Clone, Copy)]
pub(super) struct AngleSinusoid(pub [f64; 3]);

impl AngleSinusoid {
    #[inline(always)]
    pub fn at(&self, cos: f64, sin: f64) -> f64 {
        self.0[0] + self.0[1] * cos + self.0[2] * sin
    }

    pub fn combined(&self, a: f64, other: &Self, b: f64) -> Self {
        Self(std::array::from_fn(|i| a * self.0[i] + b * other.0[i]))
    }

    /// Where it equals `value`; a constant nowhere, a tangent point that rounding lifts off counts (twice).
    pub fn meets(&self, value: f64) -> Option<[f64; 2]> {
        let [c, a, b] = self.0;
        let c = c - value;
        let squared = a * a + b * b;
        let discriminant = squared - c * c;
        if squared <= SINUSOID_FLAT * SINUSOID_FLAT || discriminant < -SINUSOID_TANGENT * squared {
            return None;
        }
        let h = discriminant.max(0.0).sqrt();
        Some([(-c * b + a * h).atan2(-c * a - b * h), (-c * b - a * h).atan2(-c * a + b * h)])
    }
}

/// The lesser of two numbers, neither of them NaN: one instruction, where `f64::min` has five.
#[inline(always)]
pub(super) fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The greater of two numbers, neither of them NaN.
#[inline(always)]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// All numbers between two.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range(pub f64, pub f64);

impl Range {
    /// Between two numbers in any order.
    pub fn of(a: f64, b: f64) -> Self {
        Self(lesser(a, b), greater(a, b))
    }

    pub fn times(self, other: Self) -> Self {
        let p = [self.0 * other.0, self.0 * other.1, self.1 * other.0, self.1 * other.1];
        Self(
            lesser(lesser(p[0], p[1]), lesser(p[2], p[3])),
            greater(greater(p[0], p[1]), greater(p[2], p[3])),
        )
    }

    pub fn squared(self) -> Self {
        let (a, b) = (self.0 * self.0, self.1 * self.1);
        if self.0 < 0.0 && self.1 > 0.0 { Self(0.0, greater(a, b)) } else { Self::of(a, b) }
    }

    fn minus(self, other: Self) -> Self {
        Self(self.0 - other.1, self.1 - other.0)
    }

    /// `value` less every number.
    fn reflected(self, value: f64) -> Self {
        Self(value - self.1, value - self.0)
    }

    /// Of positive numbers.
    fn inverse(self) -> Self {
        Self(1.0 / self.1, 1.0 / self.0)
    }
}

/// One spherical joint for one elbow.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spherical {
    /// Cosine and sine of the first angle, times the sine of the middle one.
    pub first: [AngleSinusoid; 2],
    /// Cosine of the middle angle.
    pub middle: AngleSinusoid,
    /// As `first` for the third angle.
    pub third: [AngleSinusoid; 2],
    /// The middle angle stays at 0 or pi: only the sum of the others is defined, and `third` holds it.
    pub locked: bool,
    /// The axis about which it turns with the swivel, along the first axis ...
    turn_first: f64,
    /// ... and along the third.
    turn_third: f64,
}

impl Spherical {
    /// From entries of the product: its third column, and the first two entries of its last and second rows.
    fn new(
        column: [AngleSinusoid; 3],
        row3: [AngleSinusoid; 2],
        row2: [AngleSinusoid; 2],
        turn: &Vector3<f64>,
    ) -> Self {
        let flat = |s: &AngleSinusoid| s.0.iter().all(|c| c.abs() < GIMBAL_SINE);
        let locked = flat(&column[0]) && flat(&column[1]);
        let (first, third) = if locked {
            // First angle 0: the second row is (sin c, cos c).
            ([AngleSinusoid([1.0, 0.0, 0.0]), AngleSinusoid([0.0; 3])], [row2[1], row2[0]])
        } else {
            ([column[0], column[1]], [AngleSinusoid(row3[0].0.map(|c| -c)), row3[1]])
        };
        // turn . third axis is constant, so the constant parts tell it.
        let turn_third = (0..3).map(|i| turn[i] * column[i].0[0]).sum();
        Self { first, middle: column[2], third, locked, turn_first: turn.z, turn_third }
    }

    /// Swivels at which the middle angle passes through 0 or pi: the outer angles jump by pi there.
    pub fn gimbals(&self) -> impl Iterator<Item = f64> {
        let [c0, c1, c2] = self.middle.0;
        let near = !self.locked && c0.abs() + c1.hypot(c2) > 1.0 - GIMBAL_NEAR;
        let s = if near { c2.atan2(c1) } else { 0.0 };
        let first = self.first;
        [s, s + PI].into_iter().filter(move |_| near).map(wrap).filter(move |s| {
            let (sin, cos) = s.sin_cos();
            first[0].at(cos, sin).hypot(first[1].at(cos, sin)) < GIMBAL_PASSAGE
        })
    }

    /// Adds the swivels, in `(-pi, pi]`, at which an angle stops being monotone.
    ///
    /// With `x = cos(middle)`, `p, r` the turn axis along the first and the third axis: `a' = (p - r x)/(1 - x^2)`,
    /// `c' = (r - p x)/(1 - x^2)`, `b' = -x'/sqrt(1 - x^2)`.
    pub fn push_monotone_cuts(&self, out: &mut Vec<f64>) {
        if let Some((s1, _)) = self.crest() {
            let (p, r) = (self.turn_first, self.turn_third);
            out.extend([s1, wrap(s1 + PI)]);
            for x in [p / r, r / p] {
                if x.abs() <= 1.0 {
                    out.extend(self.middle.meets(x).into_iter().flatten());
                }
            }
        }
    }

    /// Adds the swivels, in `(-pi, pi]`, at which the rate of an angle stops being monotone, beyond those of
    /// [`Spherical::push_monotone_cuts`].
    pub fn push_rate_cuts(&self, out: &mut Vec<f64>) {
        let Some((s1, amplitude)) = self.crest() else { return };
        // d(a')/dx = 0 where r - 2 p x + r x^2 = 0, real for |p| > |r|; d(c')/dx with p and r exchanged.
        let (p, r) = (self.turn_first, self.turn_third);
        let (p, r) = if p.abs() > r.abs() { (p, r) } else { (r, p) };
        // The root within [-1, 1], without cancellation.
        let x = r / (p + ((p - r) * (p + r)).max(0.0).sqrt().copysign(p));
        if x.abs() <= 1.0 {
            out.extend(self.middle.meets(x).into_iter().flatten());
        }
        // Extrema of b': with c = cos(s - s1), x = A + B c: A B c^2 + (A^2 + B^2 - 1) c + A B = 0.
        let a = self.middle.0[0];
        let (ab, k) = (a * amplitude, 1.0 - a * a - amplitude * amplitude);
        let discriminant = k * k - 4.0 * ab * ab;
        if discriminant >= 0.0 {
            let denominator = k + discriminant.sqrt().copysign(k);
            let c = if denominator == 0.0 { 0.0 } else { 2.0 * ab / denominator };
            if c.abs() <= 1.0 {
                let angle = c.acos();
                out.extend([wrap(s1 + angle), wrap(s1 - angle)]);
            }
        }
    }

    /// Ranges of the second derivatives of the three angles between two swivels, from the cosines `x` of the middle
    /// angle at both and their rates `dx`; x must be monotone between them. `None` too near to the gimbal.
    ///
    /// `a'' = (-r + 2 p x - r x^2) x' / (1 - x^2)^2`, `c''` with p and r exchanged, and with `x'' = A - x`:
    /// `b'' = ((x - A)(1 - x^2) - x x'^2) / (1 - x^2)^(3/2)`.
    pub fn curvatures(&self, x: [f64; 2], dx: [f64; 2]) -> Option<[Range; 3]> {
        let [center, c1, c2] = self.middle.0;
        let x = Range::of(x[0], x[1]);
        let d = x.squared().reflected(1.0);
        if d.0 < GIMBAL_NEAR {
            return None;
        }
        let mut dx = Range::of(dx[0], dx[1]);
        if x.0 < center && center < x.1 {
            // x' is extreme where x passes its middle.
            let amplitude = c1.hypot(c2);
            dx = if dx.0 + dx.1 > 0.0 { Range(dx.0, amplitude) } else { Range(-amplitude, dx.1) };
        }
        let outer = |p: f64, r: f64| {
            let at = |x: f64| -r + (2.0 * p - r * x) * x;
            let mut numerator = Range::of(at(x.0), at(x.1));
            let vertex = p / r;
            if x.0 < vertex && vertex < x.1 {
                numerator = Range(lesser(numerator.0, at(vertex)), greater(numerator.1, at(vertex)));
            }
            numerator.times(dx).times(d.squared().inverse())
        };
        let (p, r) = (self.turn_first, self.turn_third);
        let middle = Range(x.0 - center, x.1 - center).times(d).minus(x.times(dx.squared()));
        let power = Range(d.0 * d.0.sqrt(), d.1 * d.1.sqrt());
        Some([outer(p, r), middle.times(power.inverse()), outer(r, p)])
    }

    /// Swivel at which the cosine of the middle angle is greatest, and its amplitude; `None` where it is constant.
    fn crest(&self) -> Option<(f64, f64)> {
        let [_, c1, c2] = self.middle.0;
        let amplitude = c1.hypot(c2);
        (!self.locked && amplitude > SINUSOID_FLAT).then(|| (c2.atan2(c1), amplitude))
    }
}

/// Shoulder and wrist for one elbow sign.
pub(super) fn sphericals(geometry: &Geometry, circle: &ElbowCircle, elbow: f64) -> [Spherical; 2] {
    // R3 v for a constant v, as constant, cosine and sine part:
    // x3 = e (sin_upper n - cos_upper w), y3 = e w x n, z3 = cos_upper n + sin_upper w, w0 x n = -w1, w1 x n = w0.
    let carried = |v: Vector3<f64>| -> [Vector3<f64>; 3] {
        let along_n = v.x * elbow * circle.sin_upper + v.z * circle.cos_upper;
        let along_w = v.z * circle.sin_upper - v.x * elbow * circle.cos_upper;
        let across = v.y * elbow;
        [
            circle.n * along_n,
            circle.w0 * along_w - circle.w1 * across,
            circle.w1 * along_w + circle.w0 * across,
        ]
    };
    let component =
        |parts: &[Vector3<f64>; 3], i: usize| AngleSinusoid([parts[0][i], parts[1][i], parts[2][i]]);
    let c = &geometry.shoulder_offset;
    let columns = [0, 1, 2].map(|j| carried(c.column(j).into()));
    let shoulder = Spherical::new(
        [0, 1, 2].map(|i| component(&columns[2], i)),
        [component(&columns[0], 2), component(&columns[1], 2)],
        [component(&columns[0], 1), component(&columns[1], 1)],
        &circle.n,
    );
    // R47 row i, column j: (R3 Ry(theta4) c_i) . t_j with c_i row i of the wrist offset.
    let (cos, sin) = (circle.cos_elbow, elbow * circle.sin_elbow);
    let turned = |v: Vector3<f64>| Vector3::new(cos * v.x + sin * v.z, v.y, cos * v.z - sin * v.x);
    let rows = [0, 1, 2].map(|i| carried(turned(geometry.wrist_offset.row(i).transpose())));
    let entry = |i: usize, j: usize| {
        let t: Vector3<f64> = circle.tool.column(j).into();
        AngleSinusoid([rows[i][0].dot(&t), rows[i][1].dot(&t), rows[i][2].dot(&t)])
    };
    let wrist = Spherical::new(
        [entry(0, 2), entry(1, 2), entry(2, 2)],
        [entry(2, 0), entry(2, 1)],
        [entry(1, 0), entry(1, 1)],
        &circle.wrist_turn(geometry, elbow),
    );
    [shoulder, wrist]
}
