//! Logarithmic barriers of margins: value, gradient and Hessian of a weighted sum.
//!
//! `phi(q) = sum_i k_i (-log m_i(q))` [FromGravdahl2009, eqs. (27), (34), (43), (46)], in the body tangent space:
//! `grad phi = -sum k_i grad m_i / m_i`, `Hess phi = sum k_i (grad m_i grad m_i^T / m_i^2 - Hess m_i / m_i)`.
//! The paper's `grad phi_tcp` has the opposite overall sign in print.
//!
//! Outside of the sets the barrier is infinite.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::error::Result;
use crate::rotation::arc::check_weight;
use crate::rotation::cone::{Cone, Constraint, Local, Spin, unpack};

/// A constraint and the weight of its barrier.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Barrier {
    weight: f64,
    constraint: Constraint,
}

/// Gradient and Hessian of a sum of barriers.
#[derive(Clone, Copy)]
pub(crate) struct Model {
    pub gradient: Vector3<f64>,
    /// Upper triangle: xx, xy, xz, yy, yz, zz.
    pub hessian: [f64; 6],
}

impl Barrier {
    /// Barrier `-weight log(margin)`.
    ///
    /// # Errors
    /// A weight that is not positive and finite.
    ///
    /// ```
    /// use redundancy_core::rotation::{Barrier, Cone, from_zyz};
    /// let barrier = Barrier::new(2.0, Cone::z([0., 0., 1.], 0.4)?)?;
    /// let q = from_zyz([0.0, 0.1, 0.0]);
    /// assert_eq!(barrier.value(&q), -2.0 * barrier.constraint().margin(&q).ln());
    /// assert!(Barrier::new(-1.0, Cone::downward(0.4)?).is_err());
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn new(weight: f64, constraint: impl Into<Constraint>) -> Result<Self> {
        check_weight("weight", weight)?;
        Ok(Self { weight, constraint: constraint.into() })
    }

    /// The same barrier of the same cone around another direction; a spin stays as it is.
    pub(crate) fn turn_to(&mut self, direction: nalgebra::Unit<Vector3<f64>>) {
        if let Constraint::Cone(cone) = &mut self.constraint {
            *cone = cone.towards(direction);
        }
    }

    /// The weight.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// The constraint.
    pub fn constraint(&self) -> &Constraint {
        &self.constraint
    }

    /// `-weight log(margin)`; infinite where the margin is not positive.
    pub fn value(&self, q: &UnitQuaternion<f64>) -> f64 {
        let margin = self.constraint.margin(q);
        if margin > 0.0 { -self.weight * margin.ln() } else { f64::INFINITY }
    }

    /// Gradient in the body tangent space, 1/rad; `None` outside.
    pub fn gradient(&self, q: &UnitQuaternion<f64>) -> Option<Vector3<f64>> {
        gradient(std::slice::from_ref(self), q)
    }

    /// Hessian in the body tangent space, 1/rad^2; `None` outside.
    pub fn hessian(&self, q: &UnitQuaternion<f64>) -> Option<Matrix3<f64>> {
        model(std::slice::from_ref(self), q).map(|m| unpack(&m.hessian))
    }
}

/// Sum of the barriers' values; infinite outside.
#[inline]
pub(crate) fn value(barriers: &[Barrier], q: &UnitQuaternion<f64>) -> f64 {
    let rotation = q.to_rotation_matrix().into_inner();
    let mut sum = 0.0;
    for barrier in barriers {
        let margin = margin(barrier, q, &rotation);
        let inside = margin > 0.0;
        if !inside {
            return f64::INFINITY;
        }
        sum -= barrier.weight * margin.ln();
    }
    sum
}

/// Whether `q` is inside of every set.
#[inline]
pub(crate) fn inside(barriers: &[Barrier], q: &UnitQuaternion<f64>) -> bool {
    let rotation = q.to_rotation_matrix().into_inner();
    barriers.iter().all(|barrier| margin(barrier, q, &rotation) > 0.0)
}

/// The margin at `q` with its rotation matrix.
#[inline]
fn margin(barrier: &Barrier, q: &UnitQuaternion<f64>, rotation: &Matrix3<f64>) -> f64 {
    match &barrier.constraint {
        Constraint::Cone(cone) => cone.slope(rotation).0,
        Constraint::Spin(spin) => spin.margin(q),
    }
}

/// Sum of the barriers' gradients; `None` outside.
#[inline]
pub(crate) fn gradient(barriers: &[Barrier], q: &UnitQuaternion<f64>) -> Option<Vector3<f64>> {
    let rotation = q.to_rotation_matrix().into_inner();
    let mut sum = Vector3::zeros();
    for barrier in barriers {
        let (margin, slope) = match &barrier.constraint {
            Constraint::Cone(cone) => cone.slope(&rotation),
            Constraint::Spin(spin) => spin.slope(q),
        };
        let inside = margin > 0.0;
        if !inside {
            return None;
        }
        sum -= slope * (barrier.weight / margin);
    }
    Some(sum)
}

/// Sum of the barriers' gradients and Hessians; `None` outside.
#[inline]
pub(crate) fn model(barriers: &[Barrier], q: &UnitQuaternion<f64>) -> Option<Model> {
    sum(barriers, q, Spin::local)
}

/// The same with the Hessians of the spins' twists left out, so that theirs are positive semidefinite.
pub(crate) fn convex_model(barriers: &[Barrier], q: &UnitQuaternion<f64>) -> Option<Model> {
    sum(barriers, q, Spin::convex_local)
}

#[inline]
fn sum(
    barriers: &[Barrier],
    q: &UnitQuaternion<f64>,
    spin_local: impl Fn(&Spin, &UnitQuaternion<f64>) -> Local,
) -> Option<Model> {
    let rotation = q.to_rotation_matrix().into_inner();
    let mut sum = Model { gradient: Vector3::zeros(), hessian: [0.0; 6] };
    for barrier in barriers {
        let Local { margin, gradient: g, hessian: h } = match &barrier.constraint {
            Constraint::Cone(cone) => {
                if !add_cone(&mut sum, cone, barrier.weight, &rotation) {
                    return None;
                }
                continue;
            }
            Constraint::Spin(spin) => spin_local(spin, q),
        };
        let inside = margin > 0.0;
        if !inside {
            return None;
        }
        let inverse = 1.0 / margin;
        let first = barrier.weight * inverse;
        let second = first * inverse;
        sum.gradient -= g * first;
        let outer = [g.x * g.x, g.x * g.y, g.x * g.z, g.y * g.y, g.y * g.z, g.z * g.z];
        for i in 0..6 {
            sum.hessian[i] += second * outer[i] - first * h[i];
        }
    }
    Some(sum)
}

/// Adds a cone's barrier: with `c = R^T d`, `G = b x c` the margin's gradient is `G/2` and its Hessian
/// `(b c^T + c b^T)/4 - (b . c)/2`. False outside.
#[inline]
fn add_cone(sum: &mut Model, cone: &Cone, weight: f64, rotation: &Matrix3<f64>) -> bool {
    let b = cone.body_axis().into_inner();
    let c = rotation.tr_mul(&cone.direction());
    let margin = cone.margin_between(&b, &c);
    let inside = margin > 0.0;
    if !inside {
        return false;
    }
    let inverse = 1.0 / margin;
    let quarter = 0.25 * weight * inverse;
    let g = b.cross(&c);
    let (u, v) = (g * (quarter * inverse), c * quarter);
    let along = 2.0 * (b.x * v.x + b.y * v.y + b.z * v.z);
    sum.gradient -= g * (2.0 * quarter);
    let h = &mut sum.hessian;
    h[0] += u.x * g.x - 2.0 * b.x * v.x + along;
    h[1] += u.x * g.y - (b.x * v.y + b.y * v.x);
    h[2] += u.x * g.z - (b.x * v.z + b.z * v.x);
    h[3] += u.y * g.y - 2.0 * b.y * v.y + along;
    h[4] += u.y * g.z - (b.y * v.z + b.z * v.y);
    h[5] += u.z * g.z - 2.0 * b.z * v.z + along;
    true
}

/// Sum of the barriers' values and gradients; infinite outside.
#[inline]
pub(crate) fn value_and_gradient(barriers: &[Barrier], q: &UnitQuaternion<f64>) -> (f64, Vector3<f64>) {
    let rotation = q.to_rotation_matrix().into_inner();
    let (mut value, mut sum) = (0.0, Vector3::zeros());
    for barrier in barriers {
        let (margin, slope) = match &barrier.constraint {
            Constraint::Cone(cone) => cone.slope(&rotation),
            Constraint::Spin(spin) => spin.slope(q),
        };
        let inside = margin > 0.0;
        if !inside {
            return (f64::INFINITY, Vector3::repeat(f64::INFINITY));
        }
        value -= barrier.weight * margin.ln();
        sum -= slope * (barrier.weight / margin);
    }
    (value, sum)
}
