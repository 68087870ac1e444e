//! The paper's gradient method with a fixed step, at the cost of one dependent chain of products per iteration.
//!
//! With margins as quadratic forms of the quaternion, `m_i = Q^T A_i Q`, the gradient of the paper is
//! `grad phi = -2 sum k_i A_i Q / m_i`; as `Q . grad phi = -2 sum k_i`, its tangential part needs no projection:
//! `g = grad phi + 2 (sum k_i) Q`. A spin's margin is the quotient of two forms and has no radial part. As the forms
//! hold for `Q` of any length, `normalise(Q - a g)` is done by carrying the square of the length along.
//! In rotation vectors the gradient is half of `g`.
//!
//! [FromGravdahl2009, eqs. (39), (40), (44)] with corrections.

use nalgebra::{Matrix4, Quaternion, Unit, UnitQuaternion, Vector4};

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

/// Squared length of the quaternion at which it is normalised again.
const LONG: f64 = 4.0;

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
