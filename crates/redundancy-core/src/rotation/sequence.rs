//! Sequences of one to three rotations about fixed axes with bounded angles: the angles of an orientation, their
//! margin, and the member nearest to an orientation.
//!
//! An orientation is a sequence of three in two ways (branches), one of two in one way, where it is one at all. What is
//! left between the orientation and the unbounded sequence is the residual; above [`VOLUME_OFF_SET`] it is the margin.
//!
//! The nearest member maximises the squared dot product of the quaternions, the square of a trilinear form in the (cos,
//! sin) of the half angles: by coordinate ascent, each coordinate in closed form, from the clamped branches and a grid of
//! starts, then by Newton's method on the angles that are not at a bound.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};

use crate::rotation::quaternion::{about, angle_between, compose, rotation_angle, wrap};
use crate::tolerance::{VOLUME_GIMBAL, VOLUME_NARROW, VOLUME_NEAREST, VOLUME_OFF_SET};

/// A rotation about a fixed axis by an angle in `[low, high]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BoundedRotation {
    pub axis: Unit<Vector3<f64>>,
    pub low: f64,
    pub high: f64,
}

impl BoundedRotation {
    /// The identity.
    pub fn none() -> Self {
        Self { axis: Vector3::z_axis(), low: 0.0, high: 0.0 }
    }

    pub fn free(&self) -> bool {
        self.high - self.low >= TAU
    }

    pub fn centre(&self) -> f64 {
        0.5 * (self.low + self.high)
    }

    pub fn half(&self) -> f64 {
        (0.5 * (self.high - self.low)).min(PI)
    }

    /// Signed angle to the nearer bound, positive inside; infinite without bounds.
    pub fn margin(&self, angle: f64) -> f64 {
        if self.free() { f64::INFINITY } else { self.half() - wrap(angle - self.centre()).abs() }
    }

    /// The angle of the range nearest to `angle` on the circle.
    pub fn clamp(&self, angle: f64) -> f64 {
        let half = self.half();
        self.centre() + wrap(angle - self.centre()).clamp(-half, half)
    }
}

/// One way to write an orientation as the sequence.
#[derive(Debug, Clone, Copy)]
pub(super) struct SequenceBranch {
    pub angles: [f64; 3],
    pub margin: f64,
}

/// Sweeps over the coordinates from each start.
const SWEEPS: usize = 6;
/// Best ends of the sweeps that are refined.
const STARTS_KEPT: usize = 3;
/// Most steps of a refinement.
const REFINEMENTS: usize = 200;

/// Margin of a branch off the unbounded sequence by `residual`.
fn off_set(margin: f64, residual: f64) -> f64 {
    if residual > VOLUME_OFF_SET { margin.min(-residual) } else { margin }
}

pub(super) fn one_rotation(r: &BoundedRotation, q: &UnitQuaternion<f64>) -> SequenceBranch {
    let along = q.imag().dot(&r.axis);
    let angle = wrap(2.0 * along.atan2(q.w));
    let residual = 2.0 * q.imag().cross(&r.axis).norm().atan2(q.w.hypot(along));
    SequenceBranch { angles: [angle, 0.0, 0.0], margin: off_set(r.margin(angle), residual) }
}

pub(super) fn two_rotations(rotations: &[BoundedRotation; 3], q: &UnitQuaternion<f64>) -> SequenceBranch {
    let (one, two) = (&rotations[0], &rotations[1]);
    let v = q.imag();
    // q . (Q1 * Q2) as a bilinear form of (cos, sin) of the half angles.
    let (m00, m10, m01) = (q.w, v.dot(&one.axis), v.dot(&two.axis));
    let m11 = v.dot(&one.axis.cross(&two.axis)) - q.w * one.axis.dot(&two.axis);
    let difference = (m10 - m01).atan2(m00 + m11);
    let sum = (m10 + m01).atan2(m00 - m11);
    let angles = [wrap(sum + difference), wrap(sum - difference), 0.0];
    let member = compose(&about(&one.axis, angles[0]), &about(&two.axis, angles[1]));
    let margin = one.margin(angles[0]).min(two.margin(angles[1]));
    SequenceBranch { angles, margin: off_set(margin, rotation_angle(&member, q)) }
}

/// The middle angle `atan2(C, B)` at which the outer axes are closest: the weight of its measure vanishes there.
pub(super) fn middle_zero(rotations: &[BoundedRotation; 3]) -> f64 {
    let [one, two, three] = rotations;
    let b = one.axis.dot(&three.axis) - one.axis.dot(&two.axis) * two.axis.dot(&three.axis);
    one.axis.dot(&two.axis.cross(&three.axis)).atan2(b)
}

pub(super) fn three_rotations(
    rotations: &[BoundedRotation; 3],
    q: &UnitQuaternion<f64>,
) -> (SequenceBranch, Option<SequenceBranch>) {
    let [one, two, three] = rotations;
    let last = (q * three.axis).into_inner();
    let theta = angle_between(&one.axis, &last);
    let (first, second) = (angle_between(&one.axis, &two.axis), angle_between(&two.axis, &three.axis));
    let (a, b) = ((first - second).abs(), first + second);
    let near = (0.5 * (theta + a)).sin() * (0.5 * (theta - a)).sin();
    let far = (0.5 * (b + theta)).sin() * (0.5 * (b - theta)).sin();
    let x = 2.0 * near.max(0.0).sqrt().atan2(far.max(0.0).sqrt());
    let zero = middle_zero(rotations);
    let branch = |middle: f64| {
        let turned = about(&two.axis, middle) * three.axis.into_inner();
        let gimbal = one.axis.cross(&last).norm() < VOLUME_GIMBAL;
        let outer = if gimbal {
            0.0
        } else {
            let sine = one.axis.dot(&turned.cross(&last));
            sine.atan2(turned.dot(&last) - one.axis.dot(&turned) * one.axis.dot(&last))
        };
        let rest = compose(&compose(&about(&one.axis, outer), &about(&two.axis, middle)).inverse(), q);
        let inner = one_rotation(&BoundedRotation { low: -PI, high: PI, ..*three }, &rest);
        let residual = (-inner.margin).max(0.0);
        let mut angles = [outer, middle, inner.angles[0]];
        if gimbal {
            split(one, three, if one.axis.dot(&last) > 0.0 { 1.0 } else { -1.0 }, &mut angles);
        }
        let bounds = one.margin(angles[0]).min(two.margin(angles[1])).min(three.margin(angles[2]));
        SequenceBranch { angles, margin: off_set(bounds, residual) }
    };
    let (plus, minus) = (wrap(zero + x), wrap(zero - x));
    let (small, large) = if minus.abs() < plus.abs() { (minus, plus) } else { (plus, minus) };
    (branch(small), Some(branch(large)))
}

/// At the gimbal only `angles[0] + sign * angles[2]` is determined: splits it so that the smaller margin is largest.
fn split(one: &BoundedRotation, three: &BoundedRotation, sign: f64, angles: &mut [f64; 3]) {
    let total = angles[0] + sign * angles[2];
    match (one.free(), three.free()) {
        (true, true) => (angles[0], angles[2]) = (0.0, wrap(sign * total)),
        (false, true) => {
            angles[0] = one.clamp(0.0);
            angles[2] = wrap(sign * (total - angles[0]));
        }
        (true, false) => {
            angles[2] = three.clamp(sign * total);
            angles[0] = wrap(total - sign * angles[2]);
        }
        (false, false) => {
            // Both leave their centres by |d1| + |d3| >= |off|; equal margins where the ranges allow.
            let off = wrap(total - one.centre() - sign * three.centre());
            let share = (0.5 * (one.half() - three.half() + off.abs())).clamp(0.0, off.abs());
            angles[0] = wrap(one.centre() + share * off.signum());
            angles[2] = wrap(three.centre() + sign * (off.abs() - share) * off.signum());
        }
    }
}

/// Integral of the density `|sin(phi - zero)|` over `[low, high]`.
pub(super) fn middle_weight(low: f64, high: f64, zero: f64) -> f64 {
    sine_area(high - zero) - sine_area(low - zero)
}

/// Integral of `|sin|` from 0, which grows by 2 per half turn.
fn sine_area(x: f64) -> f64 {
    let turns = (x / PI).floor();
    2.0 * turns + 1.0 - (x - turns * PI).cos()
}

/// Quantile of the density `|sin(phi - zero)|` on `[low, high]`.
pub(super) fn weighted_middle(low: f64, high: f64, zero: f64, share: f64) -> f64 {
    if high - low < VOLUME_NARROW {
        return low + (high - low) * share;
    }
    let (from, to) = (sine_area(low - zero), sine_area(high - zero));
    let y = from + (to - from) * share;
    let turns = (0.5 * y).floor();
    let angle = zero + turns * PI + (1.0 - (y - 2.0 * turns)).clamp(-1.0, 1.0).acos();
    angle.clamp(low, high)
}

/// `q . (Q1(phi_1) Q2(phi_2) Q3(phi_3))` as a trilinear form of the (cos, sin) of the half angles.
struct TrilinearForm([f64; 8]);

impl TrilinearForm {
    fn new(rotations: &[BoundedRotation; 3], q: &UnitQuaternion<f64>) -> Self {
        let mut entries = [0.0; 8];
        for (index, entry) in entries.iter_mut().enumerate() {
            let mut product = Quaternion::identity();
            for (i, r) in rotations.iter().enumerate() {
                if index >> i & 1 == 1 {
                    product *= Quaternion::from_imag(r.axis.into_inner());
                }
            }
            *entry = q.coords.dot(&product.coords);
        }
        Self(entries)
    }

    /// The form, with each factor replaced by its derivative where `derived` has a bit.
    fn form(&self, angles: &[f64; 3], derived: u32) -> f64 {
        let factors: [[f64; 2]; 3] = std::array::from_fn(|i| {
            let (s, c) = (0.5 * angles[i]).sin_cos();
            if derived >> i & 1 == 1 { [-0.5 * s, 0.5 * c] } else { [c, s] }
        });
        self.0
            .iter()
            .enumerate()
            .map(|(index, t)| {
                t * factors[0][index & 1] * factors[1][index >> 1 & 1] * factors[2][index >> 2 & 1]
            })
            .sum()
    }

    /// Squared dot product: 1 at the orientation itself.
    fn value(&self, angles: &[f64; 3]) -> f64 {
        self.form(angles, 0).powi(2)
    }

    /// Every coordinate in turn to its best value in its range.
    fn sweep(&self, rotations: &[BoundedRotation; 3], angles: &mut [f64; 3]) {
        for (i, r) in rotations.iter().enumerate() {
            let mut at = *angles;
            at[i] = 0.0;
            let cosine = self.form(&at, 0);
            at[i] = PI;
            let sine = self.form(&at, 0);
            // The square is an offset cosine around 2 atan2(sine, cosine); constant where both vanish.
            if sine != 0.0 || cosine != 0.0 {
                angles[i] = r.clamp(2.0 * sine.atan2(cosine));
            }
        }
    }

    /// Newton's method on the angles inside their ranges, a sweep where it does not help.
    fn refine(&self, rotations: &[BoundedRotation; 3], mut angles: [f64; 3]) -> [f64; 3] {
        for _ in 0..REFINEMENTS {
            let before = angles;
            self.sweep(rotations, &mut angles);
            if let Some(next) = self.newton(rotations, &angles)
                && self.value(&next) >= self.value(&angles)
            {
                angles = next;
            }
            let moved = (0..3).fold(0.0_f64, |m, i| m.max((angles[i] - before[i]).abs()));
            if moved <= VOLUME_NEAREST {
                break;
            }
        }
        angles
    }

    fn newton(&self, rotations: &[BoundedRotation; 3], angles: &[f64; 3]) -> Option<[f64; 3]> {
        let d = self.form(angles, 0);
        let slopes: [f64; 3] = std::array::from_fn(|i| self.form(angles, 1 << i));
        let fixed: [bool; 3] = std::array::from_fn(|i| {
            let r = &rotations[i];
            let offset = wrap(angles[i] - r.centre());
            r.half() == 0.0 || (!r.free() && offset.abs() >= r.half() && d * slopes[i] * offset >= 0.0)
        });
        let mut hessian = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for i in 0..3 {
            if fixed[i] {
                hessian[(i, i)] = -1.0;
                continue;
            }
            gradient[i] = 2.0 * d * slopes[i];
            for j in (0..=i).filter(|j| !fixed[*j]) {
                let second = if i == j { -0.25 * d } else { self.form(angles, 1 << i | 1 << j) };
                hessian[(i, j)] = 2.0 * (slopes[i] * slopes[j] + d * second);
                hessian[(j, i)] = hessian[(i, j)];
            }
        }
        let step = (-hessian).cholesky()?.solve(&gradient);
        Some(std::array::from_fn(|i| rotations[i].clamp(angles[i] + step[i])))
    }
}

/// Angles of the member of a sequence of `count` rotations nearest to the orientation `inner`, which is seen from the
/// sequence's own frames.
pub(super) fn nearest_angles(
    count: usize,
    rotations: &[BoundedRotation; 3],
    inner: &UnitQuaternion<f64>,
) -> [f64; 3] {
    let form = TrilinearForm::new(rotations, inner);
    let mut best: [Option<(f64, [f64; 3])>; STARTS_KEPT] = [None; STARTS_KEPT];
    let mut consider = |mut angles: [f64; 3]| {
        for _ in 0..SWEEPS {
            form.sweep(rotations, &mut angles);
        }
        let mut candidate = (form.value(&angles), angles);
        for slot in &mut best {
            match slot {
                Some(kept) if kept.0 >= candidate.0 => {}
                Some(kept) => std::mem::swap(kept, &mut candidate),
                None => {
                    *slot = Some(candidate);
                    break;
                }
            }
        }
    };
    let (first, second) = match count {
        3 => three_rotations(rotations, inner),
        _ => (SequenceBranch { angles: [0.0; 3], margin: 0.0 }, None),
    };
    for branch in [Some(first), second].into_iter().flatten() {
        let a = branch.angles;
        consider([rotations[0].clamp(a[0]), rotations[1].clamp(a[1]), rotations[2].clamp(a[2])]);
    }
    for code in 0..27_u32 {
        let start = |i: usize| {
            let place = f64::from((code / 3_u32.pow(i as u32)) % 3) - 1.0;
            rotations[i].centre() + place * rotations[i].half().min(TAU / 3.0)
        };
        consider([start(0), start(1), start(2)]);
    }
    let mut winner = (f64::NEG_INFINITY, [0.0; 3]);
    for (_, angles) in best.into_iter().flatten() {
        let refined = form.refine(rotations, angles);
        let value = form.value(&refined);
        if value > winner.0 {
            winner = (value, refined);
        }
    }
    winner.1
}
