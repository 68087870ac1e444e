//! The paper's gradient method with a fixed step, at the cost of one dependent chain of products per iteration.
//!
//! With margins as quadratic forms of the quaternion, `m_i = Q^T A_i Q`, the gradient of the paper is
//! `grad phi = -2 sum k_i A_i Q / m_i`; as `Q . grad phi = -2 sum k_i`, its tangential part needs no projection:
//! `g = grad phi + 2 (sum k_i) Q`. A spin's margin is the quotient of two forms and has no radial part. As the forms
//! hold for `Q` of any length, `normalise(Q - a g)` is done by carrying the square of the length along.
//! In rotation vectors the gradient is half of `g`.
//!
//! For two cones on one body axis the same iteration runs on the rotated axis `z` alone: with `p` the part of
//! `a sum k_i d_i / m_i` perpendicular to `z` it moves to `((1 - p^2) z + 2 p) / (1 + p^2)`, where even the quotient is
//! left out by carrying the length `1 + p^2` along. The products of `z` with both directions follow from their own last
//! values, so the iteration is one of scalars.
//!
//! [FromGravdahl2009, eqs. (39), (40), (44)] with the ground truth's corrections.

use nalgebra::{Matrix4, Quaternion, Unit, UnitQuaternion, Vector3, Vector4};

use crate::Status;
use crate::rotation::barrier::Barrier;
use crate::rotation::cone::{Cone, Constraint, Spin};
use crate::tolerance::{PLAIN_MARGIN, SPIN_SCALAR};

/// Most constraints for which the forms are kept on the stack.
const FORMS: usize = 4;

/// A margin as a quadratic form, or as a quotient of two.
#[derive(Clone, Copy)]
enum Form {
    Cone {
        weight: f64,
        matrix: Matrix4<f64>,
    },
    /// `kappa^2 - (along . q)^2 / (scalar . q)^2`.
    Spin {
        weight: f64,
        kappa2: f64,
        scalar: Vector4<f64>,
        along: Vector4<f64>,
    },
}

/// Forms of all constraints, when they are few and none is so small that its form would cancel.
pub(crate) struct Forms {
    forms: [Form; FORMS],
    count: usize,
    /// Twice the sum of the cones' weights.
    radial: f64,
}

impl Forms {
    pub(crate) fn new(barriers: &[Barrier]) -> Option<Self> {
        if barriers.len() > FORMS {
            return None;
        }
        let none = Form::Cone { weight: 0.0, matrix: Matrix4::zeros() };
        let mut all = Self { forms: [none; FORMS], count: barriers.len(), radial: 0.0 };
        for (slot, barrier) in all.forms.iter_mut().zip(barriers) {
            let weight = barrier.weight();
            *slot = match barrier.constraint() {
                Constraint::Cone(cone) if cone.scale() > PLAIN_MARGIN => {
                    all.radial += 2.0 * weight;
                    Form::Cone { weight, matrix: cone_form(cone) }
                }
                Constraint::Cone(_) => return None,
                Constraint::Spin(spin) => {
                    let (scalar, along) = spin_forms(spin);
                    Form::Spin { weight, kappa2: spin.kappa2(), scalar, along }
                }
            };
        }
        Some(all)
    }

    /// Tangential part of the paper's gradient at `q / sqrt(squared)`, times the length of `q`; `None` outside.
    #[inline]
    fn gradient(&self, q: &Vector4<f64>, squared: f64) -> Option<Vector4<f64>> {
        let mut sum = q * self.radial;
        for form in &self.forms[..self.count] {
            match form {
                Form::Cone { weight, matrix } => {
                    let image = matrix * q;
                    let margin = q.dot(&image);
                    let inside = margin > 0.0;
                    if !inside {
                        return None;
                    }
                    sum -= image * (2.0 * weight * squared / margin);
                }
                Form::Spin { weight, kappa2, scalar, along } => {
                    let (r0, r3) = (scalar.dot(q), along.dot(q));
                    let margin = kappa2 * r0 * r0 - r3 * r3;
                    if margin.is_nan() || margin <= 0.0 || r0.abs() < SPIN_SCALAR {
                        return None;
                    }
                    let factor = 2.0 * weight * squared / (margin * r0);
                    sum += (along * r0 - scalar * r3) * (factor * r3);
                }
            }
        }
        Some(sum)
    }

    /// Fixed steps until the squared gradient in rotation vectors is below `stop`; steps out of the sets are halved.
    /// The length of `q` is carried along: the step is perpendicular to `q`, so its square adds to that of `q`.
    pub(crate) fn descend(
        &self,
        start: &UnitQuaternion<f64>,
        step: f64,
        stop: f64,
        limit: u32,
    ) -> Option<(UnitQuaternion<f64>, Status, u32)> {
        let (mut q, mut squared) = (start.as_ref().coords, 1.0);
        let mut slope = self.gradient(&q, squared)?;
        let done = |q: Vector4<f64>, status, iteration| {
            Some((Unit::new_normalize(Quaternion::from_vector(q)), status, iteration))
        };
        for iteration in 0..limit {
            let steepness = slope.norm_squared();
            if steepness <= 4.0 * stop * squared {
                return done(q, Status::Converged, iteration);
            }
            let mut length = step;
            loop {
                let trial = q - slope * length;
                let grown = squared + length * length * steepness;
                if let Some(next) = self.gradient(&trial, grown) {
                    (q, squared, slope) = (trial, grown, next);
                    break;
                }
                length *= 0.5;
                if length < step * f64::EPSILON {
                    return done(q, Status::IterationLimit, iteration);
                }
            }
            if squared > LONG {
                let factor = 1.0 / q.norm();
                (q, squared, slope) = (q * factor, 1.0, slope * factor);
            }
        }
        done(q, Status::IterationLimit, limit)
    }
}

/// `(d . R(q) b - cos half_angle) / 2` for q of any length, in nalgebra's order (x, y, z, w).
fn cone_form(cone: &Cone) -> Matrix4<f64> {
    let (b, d) = (cone.body_axis().into_inner(), cone.direction().into_inner());
    // d . R b = (w^2 - |v|^2) b.d + 2 (v.b)(v.d) + 2 w v.(b x d)
    let (dot, cross) = (b.dot(&d), b.cross(&d));
    let block = b * d.transpose() + d * b.transpose() - nalgebra::Matrix3::from_diagonal_element(dot);
    let mut form = Matrix4::zeros();
    form.fixed_view_mut::<3, 3>(0, 0).copy_from(&block);
    for i in 0..3 {
        form[(i, 3)] = cross[i];
        form[(3, i)] = cross[i];
    }
    form[(3, 3)] = dot;
    let cosine = 1.0 - 2.0 * cone.scale();
    (form - Matrix4::from_diagonal_element(cosine)) * 0.5
}

/// `r0` and `r3` of `conj(reference) * q` as linear forms of q, in nalgebra's order (x, y, z, w).
fn spin_forms(spin: &Spin) -> (Vector4<f64>, Vector4<f64>) {
    let e = spin.reference().into_inner();
    let n = spin.axis().into_inner();
    // r3 = n . (conj(e) q)_v: the coefficient of q is the quaternion e * (0, n).
    let along = e * Quaternion::from_imag(n);
    (e.coords, along.coords)
}

/// The iteration for cones on one body axis, seen on the rotated axis `z = y / norm`; `pull(y, norm)` is
/// `sum k_i d_i / m_i / norm`. The length of `y` is carried along, so that nothing is divided by it.
#[inline]
pub(crate) fn descend_on_axis(
    from: &Unit<Vector3<f64>>,
    step: f64,
    stop: f64,
    limit: u32,
    pull: impl Fn(&Vector3<f64>, f64) -> Option<Vector3<f64>>,
) -> Option<(Vector3<f64>, Status, u32)> {
    let (mut y, mut norm) = (from.into_inner(), 1.0);
    let mut force = pull(&y, norm)?;
    let stop = 4.0 * stop;
    for iteration in 0..limit {
        let along = y.dot(&force);
        let scale = norm * norm;
        let whole = scale * force.norm_squared();
        let mut across = whole - along * along;
        if across <= PLAIN_MARGIN * whole {
            // Near the minimum the difference cancels.
            across = (force * norm - y * (along / norm)).norm_squared();
            if across <= stop {
                return Some((y, Status::Converged, iteration));
            }
        }
        let mut length = step;
        loop {
            let squared = length * length * across;
            let trial = y * (1.0 - squared - 2.0 * length * along) + force * (2.0 * length * scale);
            let grown = norm * (1.0 + squared);
            if let Some(next) = pull(&trial, grown) {
                (y, norm, force) = (trial, grown, next);
                break;
            }
            length *= 0.5;
            if length < step * f64::EPSILON {
                return Some((y, Status::IterationLimit, iteration));
            }
        }
        if norm > LONG {
            y = y.normalize();
            force *= norm;
            norm = 1.0;
        }
    }
    Some((y, Status::IterationLimit, limit))
}

/// Length of the axis, and squared length of the quaternion, at which it is normalised again.
const LONG: f64 = 4.0;

/// Two cones on one body axis, neither of them tiny: margins as they are printed, `(d . z - cos) / 2`.
pub(crate) struct TwoPulls {
    /// Half of each direction.
    pub directions: [Vector3<f64>; 2],
    /// Half of each cosine.
    pub cosines: [f64; 2],
    /// Twice each weight.
    pub weights: [f64; 2],
}

impl TwoPulls {
    /// [`descend_on_axis`] by its shadow: the axis stays in the span of its start and of both directions, so its products
    /// with the directions tell the next ones, and one iteration is a short chain of scalars.
    pub(crate) fn descend(
        &self,
        from: &Unit<Vector3<f64>>,
        step: f64,
        stop: f64,
        limit: u32,
    ) -> Option<(Vector3<f64>, Status, u32)> {
        let Self { directions: [d1, d2], cosines: [c1, c2], weights: [k1, k2] } = self;
        let (g11, g12, g22) = (d1.norm_squared(), d1.dot(d2), d2.norm_squared());
        // What pulls at y, as multiples of d1 and d2, from y . d1 and y . d2.
        let pull = |p1: f64, p2: f64, norm: f64| {
            let (m1, m2) = (p1 - c1 * norm, p2 - c2 * norm);
            (m1 > 0.0 && m2 > 0.0).then(|| (k1 / m1, k2 / m2))
        };
        // The axis is a y + b1 d1 + b2 d2.
        let (mut y, mut a, mut b1, mut b2) = (from.into_inner(), 1.0, 0.0, 0.0);
        let (mut p1, mut p2, mut norm) = (y.dot(d1), y.dot(d2), 1.0);
        let (mut f1, mut f2) = pull(p1, p2, norm)?;
        let stop = 4.0 * stop;
        for iteration in 0..limit {
            let along = f1 * p1 + f2 * p2;
            let scale = norm * norm;
            let whole = scale * (f1 * f1 * g11 + 2.0 * f1 * f2 * g12 + f2 * f2 * g22);
            let mut across = whole - along * along;
            if across <= PLAIN_MARGIN * whole {
                // Near the minimum the difference cancels.
                let (force, axis) = (d1 * f1 + d2 * f2, y * a + d1 * b1 + d2 * b2);
                across = (force * norm - axis * (along / norm)).norm_squared();
                if across <= stop {
                    return Some((axis, Status::Converged, iteration));
                }
            }
            let mut length = step;
            loop {
                let squared = length * length * across;
                let (keep, push) = (1.0 - squared - 2.0 * length * along, 2.0 * length * scale);
                let (n1, n2) =
                    (keep * p1 + push * (f1 * g11 + f2 * g12), keep * p2 + push * (f1 * g12 + f2 * g22));
                let grown = norm * (1.0 + squared);
                if let Some(next) = pull(n1, n2, grown) {
                    (a, b1, b2) = (keep * a, keep * b1 + push * f1, keep * b2 + push * f2);
                    (p1, p2, norm) = (n1, n2, grown);
                    (f1, f2) = next;
                    break;
                }
                length *= 0.5;
                if length < step * f64::EPSILON {
                    return Some((y * a + d1 * b1 + d2 * b2, Status::IterationLimit, iteration));
                }
            }
            if norm > LONG || iteration % SHADOW_STEPS == SHADOW_STEPS - 1 {
                (y, a, b1, b2) = ((y * a + d1 * b1 + d2 * b2).normalize(), 1.0, 0.0, 0.0);
                (p1, p2, norm) = (y.dot(d1), y.dot(d2), 1.0);
                match pull(p1, p2, norm) {
                    Some(next) => (f1, f2) = next,
                    None => return Some((y, Status::IterationLimit, iteration)),
                }
            }
        }
        Some((y * a + d1 * b1 + d2 * b2, Status::IterationLimit, limit))
    }
}

/// Steps after which the axis is computed from its shadow again: their rounding does not add up beyond 1e-14.
const SHADOW_STEPS: u32 = 64;

#[cfg(test)]
mod tests {
    use super::*;

    /// The forms' gradient is twice the barrier's gradient, carried to the quaternion: `q * (0, 2 g)`.
    #[test]
    fn forms_have_the_barriers_gradient() {
        let reference = UnitQuaternion::from_euler_angles(0.2, 0.1, 0.3);
        let barriers = [
            Barrier::new(1.3, Cone::new([0.1, 0.3, 1.0], [0.4, 0.2, 1.0], 0.9).unwrap()).unwrap(),
            Barrier::new(0.4, Cone::new([1.0, 0.3, 0.1], [1.0, 0.2, -0.3], 1.8).unwrap()).unwrap(),
            Barrier::new(2.0, Spin::new(reference, 0.9, [0.2, 0.1, 1.0]).unwrap()).unwrap(),
        ];
        let forms = Forms::new(&barriers).unwrap();
        let q = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.25);
        let g = crate::rotation::barrier::gradient(&barriers, &q).unwrap();
        let expected = q.as_ref() * Quaternion::from_imag(2.0 * g);
        for length in [1.0, 1.7] {
            let got = forms.gradient(&(q.as_ref().coords * length), length * length).unwrap();
            let expected = expected.coords * length;
            assert!((got - expected).norm() < 1e-13 * expected.norm(), "{got} {expected}");
        }
    }
}
