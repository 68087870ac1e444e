//! The gradient method of [FromGravdahl2009, eq. (40)], normalised in every iteration.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use crate::rotation::barrier::{self, Barrier};
use crate::rotation::cone::Constraint;
use crate::rotation::fixed_step::Forms;
use crate::rotation::newton::{Descent, retract};
use crate::rotation::on_axis::{HALVINGS, TwoPulls, descend_on_axis};
use crate::rotation::optimize::OrientationOptimizer;
use crate::rotation::quaternion::{compose, shortest_arc};
use crate::rotation::structure::{Structure, Symmetry};
use crate::status::Status;
use crate::tolerance::{GRADIENT_STATIONARY, PLAIN_MARGIN, SUFFICIENT_DECREASE, VALUE_ROUNDING};

/// Most iterations unless the settings say otherwise.
const GRADIENT_ITERATIONS: u32 = 10_000;

impl OrientationOptimizer {
    /// The gradient method with the step halved until the value falls enough.
    fn backtracking(
        &self,
        start: UnitQuaternion<f64>,
        slope: Vector3<f64>,
        first: f64,
        stop: f64,
        limit: u32,
    ) -> Descent {
        let (mut q, mut slope, mut step) = (start, slope, first);
        let mut value = barrier::value(&self.barriers, &q);
        let total: f64 = self.barriers.iter().map(Barrier::weight).sum();
        for iteration in 0..limit {
            let squared = slope.norm_squared();
            if squared <= stop {
                return (q, Status::Converged, iteration);
            }
            let rounding = VALUE_ROUNDING * value.abs().max(total);
            let mut next = None;
            for _ in 0..HALVINGS {
                // The paper's step a moves the body by the rotation vector -4 a grad.
                let trial = retract(&q, &(slope * (-4.0 * step)));
                let after = barrier::value(&self.barriers, &trial);
                // Rounding hides the last decreases; there the step's length comes from the gradients alone.
                if after <= value - SUFFICIENT_DECREASE * 4.0 * step * squared + rounding
                    && let Some(gradient) = barrier::gradient(&self.barriers, &trial)
                {
                    next = Some((trial, after, gradient));
                    break;
                }
                step *= 0.5;
            }
            let Some((trial, after, gradient)) = next else {
                return (q, Status::IterationLimit, iteration);
            };
            // Barzilai and Borwein's length, the inverse curvature along the step just taken.
            let bend = -slope.dot(&(gradient - slope));
            step = if bend > 0.0 { step * squared / bend } else { 2.0 * step };
            (q, value, slope) = (trial, after, gradient);
        }
        (q, Status::IterationLimit, limit)
    }

    pub(super) fn gradient_method(&self, start: UnitQuaternion<f64>) -> Option<Descent> {
        let tolerance = self.settings.tolerance.unwrap_or(GRADIENT_STATIONARY);
        let limit = self.settings.max_iterations.unwrap_or(GRADIENT_ITERATIONS);
        let first = self.settings.step.unwrap_or(0.25 / self.curvature);
        let stop = (tolerance * self.curvature).powi(2);
        let mut q = start;
        let mut slope = barrier::gradient(&self.barriers, &q)?;
        if self.settings.backtracking {
            return Some(self.backtracking(q, slope, first, stop, limit));
        }
        if let Symmetry::Body(axis) = &self.symmetry {
            return self.fixed_steps_on_axis(q, axis, first, stop, limit);
        }
        if let Some(forms) = Forms::new(&self.barriers) {
            return forms.descend(&q, first, stop, limit);
        }
        for iteration in 0..limit {
            if slope.norm_squared() <= stop {
                return Some((q, Status::Converged, iteration));
            }
            let mut step = first;
            let mut next = None;
            for _ in 0..HALVINGS {
                let trial = retract(&q, &(slope * (-4.0 * step)));
                next = barrier::gradient(&self.barriers, &trial).map(|slope| (trial, slope));
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            match next {
                Some(moved) => (q, slope) = moved,
                None => return Some((q, Status::IterationLimit, iteration)),
            }
        }
        Some((q, Status::IterationLimit, limit))
    }

    /// The fixed step for cones on one body axis, on the rotated axis `z` alone: the spin about it changes nothing.
    fn fixed_steps_on_axis(
        &self,
        start: UnitQuaternion<f64>,
        axis: &Unit<Vector3<f64>>,
        step: f64,
        stop: f64,
        limit: u32,
    ) -> Option<Descent> {
        let from = start * axis;
        let (z, status, iterations) = match self.two_pulls() {
            Some(pulls) => pulls.descend(&from, step, stop, limit),
            None => {
                let pull = |y: &Vector3<f64>, norm: f64| Some(self.pull_on_axis(axis, &(y / norm))? / norm);
                descend_on_axis(&from, step, stop, limit, pull)
            }
        }?;
        Some((compose(&shortest_arc(&from, &Unit::new_normalize(z)), &start), status, iterations))
    }

    /// The two cones of one body axis, when neither is so small that the printed margins would cancel.
    pub(super) fn two_pulls(&self) -> Option<TwoPulls> {
        let Structure::Axis { first, second: Some(second), .. } = &self.structure else { return None };
        let mut cones = self.barriers.iter().filter_map(|barrier| match barrier.constraint() {
            Constraint::Cone(cone) if cone.scale() > PLAIN_MARGIN => {
                Some((barrier.weight(), 0.5 - cone.scale()))
            }
            _ => None,
        });
        let ((k1, c1), (k2, c2)) = (cones.next()?, cones.next()?);
        let directions = [first, &second.direction].map(|d| 0.5 * d.into_inner());
        Some(TwoPulls { directions, cosines: [c1, c2], weights: [k1, k2] })
    }

    /// `sum k_i d_i / m_i` for cones on `axis`, which points along `z`; `None` outside.
    fn pull_on_axis(&self, axis: &Unit<Vector3<f64>>, z: &Vector3<f64>) -> Option<Vector3<f64>> {
        let mut pull = Vector3::zeros();
        for barrier in &self.barriers {
            let Constraint::Cone(cone) = barrier.constraint() else { return None };
            // A cone on -axis around d is one on axis around -d.
            let sign = if axis.dot(&cone.body_axis()) < 0.0 { -1.0 } else { 1.0 };
            let margin = cone.margin_between(&(z * sign), &cone.direction());
            let inside = margin > 0.0;
            if !inside {
                return None;
            }
            pull += cone.direction().into_inner() * (sign * barrier.weight() / margin);
        }
        Some(pull)
    }
}
