//! Riemannian Newton on S^3 in body coordinates, for sums of barriers.
//!
//! `q <- normalise(q * (1, delta / 2))` with `delta = -H^-1 grad`. Steps with a small decrement are taken whole, others are
//! measured, halved while they do not decrease the sum enough and doubled while that pays. No iterate leaves the sets. After
//! some iterations the steps are bounded by a radius instead: see the module `valley`.

use nalgebra::{Quaternion, SymmetricEigen, Unit, UnitQuaternion, Vector3};

use crate::rotation::barrier::{self, Barrier, Model};
use crate::rotation::cone::unpack;
use crate::rotation::on_axis::{DOUBLINGS, HALVINGS};
use crate::rotation::structure::Symmetry;
use crate::status::Status;
use crate::tolerance::{HESSIAN_FLOOR, HESSIAN_PIVOT, NEWTON_DECREMENT, STEP_DOUBLING, SUFFICIENT_DECREASE};

/// Orientation, status and number of iterations of a descent.
pub(super) type Descent = (UnitQuaternion<f64>, Status, u32);

/// Newton's method on a sum of barriers.
pub(super) struct Newton<'a> {
    pub barriers: &'a [Barrier],
    pub symmetry: &'a Symmetry,
    /// Least weight.
    pub least: f64,
}

impl Newton<'_> {
    /// Iterations after which bounded steps go on (see the module `valley`): 98 of 100 problems with spins need fewer.
    const PATIENCE: u32 = 12;

    /// From `start` until the estimated remaining angle is at most `tolerance`; `None` where `start` lies outside of a
    /// set.
    pub fn descend(&self, start: UnitQuaternion<f64>, tolerance: f64, limit: u32) -> Option<Descent> {
        let mut q = start;
        let mut model = barrier::model(self.barriers, &q)?;
        // The value at q, where a line search has measured it.
        let mut value = None;
        for iteration in 1..=limit {
            self.flatten(&mut model, &q);
            if iteration > Self::PATIENCE {
                return Some(self.follow_valley(q, model, iteration, tolerance, limit));
            }
            let step = factored_direction(&model).unwrap_or_else(|| self.convex_direction(&q, &model));
            // Squared decrement per unit of weight: at 1 the step reaches about to the boundary.
            let decrement = -model.gradient.dot(&step) / self.least;
            let size = step.norm();
            let error = size * decrement.max(0.0).sqrt();
            if decrement <= NEWTON_DECREMENT {
                let trial = retract(&q, &step);
                // Quadratic convergence: the error after the step is its length times the decrement before it. Where the
                // step ends `finish` measures; no model is needed there.
                if error <= tolerance && barrier::inside(self.barriers, &trial) {
                    return Some((trial, Status::Converged, iteration));
                }
                if let Some(next) = barrier::model(self.barriers, &trial) {
                    (q, model, value) = (trial, next, None);
                    continue;
                }
            }
            let before = value.unwrap_or_else(|| barrier::value(self.barriers, &q));
            let found = self.line_search(&q, &step, before, decrement * self.least);
            let next =
                found.and_then(|(trial, after)| Some((trial, after, barrier::model(self.barriers, &trial)?)));
            match next {
                Some((trial, after, next)) => (q, value, model) = (trial, Some(after), next),
                // No decrease is left above rounding.
                None if error <= tolerance.sqrt() => return Some((q, Status::Converged, iteration)),
                None => return Some((q, Status::IterationLimit, iteration)),
            }
        }
        Some((q, Status::IterationLimit, limit))
    }

    /// The direction where the Hessian is not positive definite: without the spins' second derivatives, which bend
    /// their valleys, and with the magnitudes of the eigenvalues that then remain negative.
    #[cold]
    fn convex_direction(&self, q: &UnitQuaternion<f64>, model: &Model) -> Vector3<f64> {
        let Some(mut convex) = barrier::convex_model(self.barriers, q) else {
            return eigen_direction(model);
        };
        self.flatten(&mut convex, q);
        descent_direction(&convex)
    }

    /// A point along `step` that decreases the value enough, and its value; longer than the step while that pays.
    fn line_search(
        &self,
        q: &UnitQuaternion<f64>,
        step: &Vector3<f64>,
        before: f64,
        slope: f64,
    ) -> Option<(UnitQuaternion<f64>, f64)> {
        let at = |length: f64| {
            let trial = retract(q, &(step * length));
            (trial, barrier::value(self.barriers, &trial))
        };
        let mut length = 1.0;
        let mut best = at(length);
        if best.1 <= before - SUFFICIENT_DECREASE * slope {
            // Only a step that is about to leave a boundary gains from going further.
            if slope > STEP_DOUBLING * self.least {
                for _ in 0..DOUBLINGS {
                    length *= 2.0;
                    let trial = at(length);
                    if trial.1 >= best.1 {
                        break;
                    }
                    best = trial;
                }
            }
            return Some(best);
        }
        for _ in 0..HALVINGS {
            length *= 0.5;
            best = at(length);
            if best.1 <= before - SUFFICIENT_DECREASE * length * slope {
                return Some(best);
            }
        }
        None
    }

    /// Gives the direction of a symmetry, in which the Hessian is zero at the minimum and indefinite elsewhere, the
    /// curvature of the others and no coupling to them: Newton then works on the remaining two.
    #[inline]
    pub(super) fn flatten(&self, model: &mut Model, q: &UnitQuaternion<f64>) {
        let n = match self.symmetry {
            Symmetry::None => return,
            Symmetry::Body(axis) => axis.into_inner(),
            Symmetry::World(direction) => (q.inverse() * direction).into_inner(),
        };
        let h = &mut model.hessian;
        let v = Vector3::new(
            h[0] * n.x + h[1] * n.y + h[2] * n.z,
            h[1] * n.x + h[3] * n.y + h[4] * n.z,
            h[2] * n.x + h[4] * n.y + h[5] * n.z,
        );
        let fill = (h[0] + h[3] + h[5]).abs() + v.dot(&n);
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (entry, (i, j)) in h.iter_mut().zip(pairs) {
            *entry += fill * n[i] * n[j] - v[i] * n[j] - n[i] * v[j];
        }
        model.gradient -= n * n.dot(&model.gradient);
    }
}

/// `q * (1, delta / 2)`, normalised: agrees with `q * exp(delta)` up to the third order and needs no sine.
#[inline]
pub(super) fn retract(q: &UnitQuaternion<f64>, delta: &Vector3<f64>) -> UnitQuaternion<f64> {
    let factor = Quaternion::new(1.0, 0.5 * delta.x, 0.5 * delta.y, 0.5 * delta.z);
    Unit::new_normalize(q.as_ref() * factor)
}

/// `-H^-1 grad`; where `H` is not positive definite, with the magnitudes of its eigenvalues.
#[inline]
pub(super) fn descent_direction(model: &Model) -> Vector3<f64> {
    factored_direction(model).unwrap_or_else(|| eigen_direction(model))
}

/// `-H^-1 grad` by `L D L^T`; `None` where a pivot is not positive beyond rounding.
#[inline]
fn factored_direction(model: &Model) -> Option<Vector3<f64>> {
    let (h, g) = (&model.hessian, &model.gradient);
    let floor = HESSIAN_PIVOT * h[0].abs().max(h[3].abs()).max(h[5].abs());
    let positive = |pivot: f64| (pivot > floor).then_some(1.0 / pivot);
    let d0 = positive(h[0])?;
    let (l10, l20) = (h[1] * d0, h[2] * d0);
    let p1 = h[3] - l10 * h[1];
    let d1 = positive(p1)?;
    let coupling = h[4] - l10 * h[2];
    let l21 = coupling * d1;
    let p2 = h[5] - l20 * h[2] - l21 * coupling;
    let d2 = positive(p2)?;
    let y1 = g.y - l10 * g.x;
    let z = (g.z - l20 * g.x - l21 * y1) * d2;
    let y = y1 * d1 - l21 * z;
    let x = g.x * d0 - l10 * y - l20 * z;
    Some(Vector3::new(-x, -y, -z))
}

#[cold]
fn eigen_direction(model: &Model) -> Vector3<f64> {
    let eigen = SymmetricEigen::new(unpack(&model.hessian));
    let largest = eigen.eigenvalues.amax();
    if largest.is_nan() || largest <= 0.0 {
        return -model.gradient;
    }
    let along = eigen.eigenvectors.tr_mul(&model.gradient);
    let scaled = along.zip_map(&eigen.eigenvalues, |g, e| -g / e.abs().max(HESSIAN_FLOOR * largest));
    eigen.eigenvectors * scaled
}
