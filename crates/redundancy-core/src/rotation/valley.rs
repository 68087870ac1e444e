//! Newton's method with a bounded step, for bent valleys.
//!
//! The barriers of spins are not convex: where the margins' gradients turn quickly, a sum of them has valleys along which a
//! line search advances by ever smaller steps. Here each step is the minimum of the quadratic model within a radius
//! [ConnGouldToint2000, sections 6 and 7.3], from the eigenvalues of the Hessian: `step = -(H + lambda)^-1 grad` with
//! `lambda >= 0` such that the step has the radius or is Newton's own. The radius follows from how well the model has
//! predicted the decrease, so that a step is as long as the valley is straight.
//!
//! A minimum where a spin is undefined (its body axis half a turn from the reference) has no gradient that vanishes: the
//! radius shrinks to nothing there, and the status is `Singular`.
//!
//! Cost: one symmetric 3 x 3 eigenvalue problem and one value per step. Newton's method changes to it after
//! [`Newton::PATIENCE`] iterations.

use nalgebra::{SymmetricEigen, UnitQuaternion, Vector3};

use super::barrier::{self, Model};
use super::cone::unpack;
use super::newton::{Descent, Newton, retract};
use crate::status::Status;
use crate::tolerance::{NEWTON_DECREMENT, SUFFICIENT_DECREASE, VALLEY_ROUNDING};

/// Radius of the first step, rad.
const FIRST_RADIUS: f64 = 0.5;
/// Shares of the predicted decrease below which the radius is a quarter of the step, and above which it is doubled.
const POOR: f64 = 0.25;
const GOOD: f64 = 0.75;
/// Bisections of `lambda`: to the rounding of the radius.
const BISECTIONS: usize = 60;

impl Newton<'_> {
    /// From `q` on, whose `model` is flattened, in iterations from `first` to `limit`.
    #[cold]
    pub(super) fn follow_valley(
        &self,
        mut q: UnitQuaternion<f64>,
        mut model: Model,
        first: u32,
        tolerance: f64,
        limit: u32,
    ) -> Descent {
        let mut radius = FIRST_RADIUS;
        let mut value = barrier::value(self.barriers, &q);
        let weights: f64 = self.barriers.iter().map(|barrier| barrier.weight()).sum();
        for iteration in first..=limit {
            let (step, whole) = bounded_step(&model, radius);
            let slope = model.gradient.dot(&step);
            let fall = -slope - 0.5 * step.dot(&(unpack(&model.hessian) * step));
            let decrement = (-slope / self.least).max(0.0);
            let (size, error) = (step.norm(), step.norm() * decrement.sqrt());
            let trial = retract(&q, &step);
            if whole && decrement <= NEWTON_DECREMENT && error <= tolerance && self.inside(&trial) {
                return (trial, Status::Converged, iteration);
            }
            let after = barrier::value(self.barriers, &trial);
            // A decrease below the rounding of the value cannot be measured: the model is believed.
            let hidden = fall <= VALLEY_ROUNDING * (value.abs() + weights);
            let share = match after.is_finite() {
                true if hidden => 1.0,
                true => (value - after) / fall,
                false => f64::NEG_INFINITY,
            };
            if share < POOR {
                radius = POOR * size;
            } else if share > GOOD && !whole {
                radius *= 2.0;
            }
            if share > SUFFICIENT_DECREASE {
                let Some(next) = barrier::model(self.barriers, &trial) else {
                    return (q, Status::Singular, iteration);
                };
                (q, value, model) = (trial, after, next);
                self.flatten(&mut model, &q);
            } else if radius <= tolerance {
                return (q, Status::Singular, iteration);
            }
        }
        (q, Status::IterationLimit, limit)
    }

    fn inside(&self, q: &UnitQuaternion<f64>) -> bool {
        barrier::inside(self.barriers, q)
    }
}

/// The minimum of the model within `radius`, and whether it is the model's own.
fn bounded_step(model: &Model, radius: f64) -> (Vector3<f64>, bool) {
    let eigen = SymmetricEigen::new(unpack(&model.hessian));
    let along = eigen.eigenvectors.tr_mul(&model.gradient);
    let at = |lambda: f64| -> Vector3<f64> {
        along.zip_map(&eigen.eigenvalues, |g, e| -g / (e + lambda).max(f64::MIN_POSITIVE))
    };
    let (lowest, least) = eigen.eigenvalues.argmin();
    if least > 0.0 {
        let step = at(0.0);
        if step.norm() <= radius {
            return (eigen.eigenvectors * step, true);
        }
    }
    let (mut low, mut high) = ((-least).max(0.0), (-least).max(0.0) + along.norm() / radius);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if at(middle).norm() > radius { low = middle } else { high = middle }
    }
    let mut step = at(high);
    // Where the gradient has no part along the lowest eigenvector no lambda reaches the radius.
    let missing = radius * radius - step.norm_squared();
    if least < 0.0 && missing > 0.0 {
        step[lowest] += if along[lowest] > 0.0 { -missing.sqrt() } else { missing.sqrt() };
    }
    (eigen.eigenvectors * step, false)
}
