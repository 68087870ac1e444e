//! Descents for cones on one body axis, on the rotated axis `z` alone: the spin about it changes nothing.
//!
//! The fixed step: with `p` the part of `a sum k_i d_i / m_i` perpendicular to `z` the iteration of the module `fixed_step`
//! moves `z` to `((1 - p^2) z + 2 p) / (1 + p^2)`, where even the quotient is left out by carrying the length `1 + p^2`
//! along. For two cones the products of `z` with both directions follow from their own last values, so the iteration is
//! one of scalars.
//!
//! Newton: on the sphere of the axis, two unknowns in place of three.
//!
//! [FromGravdahl2009, eqs. (39), (40)] with corrections.

use nalgebra::{Unit, Vector3};

use crate::Status;
use crate::tolerance::{NEWTON_DECREMENT, PLAIN_MARGIN, STEP_DOUBLING, SUFFICIENT_DECREASE};

/// Length of the axis at which it is normalised again.
const LONG: f64 = 4.0;

/// Most halvings and doublings of a step that is measured.
pub(crate) const HALVINGS: u32 = 60;
pub(crate) const DOUBLINGS: u32 = 8;

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

/// Two cones on one body axis, neither of them tiny: margins as they are printed, `(d . z - cos) / 2`.
pub(crate) struct TwoPulls {
    /// Half of each direction.
    pub directions: [Vector3<f64>; 2],
    /// Half of each cosine.
    pub cosines: [f64; 2],
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
        let Self { directions: [d1, d2], cosines: [c1, c2], weights } = self;
        let [k1, k2] = weights.map(|k| 2.0 * k);
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

    /// Riemannian Newton on the sphere of the axis, for half-angles below 90 degrees. With `t_i` the tangential parts of the
    /// `d_i`, `a_i = k_i / m_i` and `gamma = sum a_i d_i . z`, which is positive, the gradient is `-sum a_i t_i` and the
    /// Hessian `gamma + sum (a_i / m_i) t_i t_i^T` on the tangent plane. In thin lenses it is nearly singular: it is taken
    /// in axes along the longer `t_i`, and its determinant as a sum of squares, so that nothing cancels.
    ///
    /// Steps with a small decrement are taken whole, others are measured, see [`measured`](Self::measured). `None` when
    /// `from` lies outside, or where rounding leaves nothing to go on.
    pub(crate) fn newton(
        &self,
        from: &Unit<Vector3<f64>>,
        tolerance: f64,
        limit: u32,
    ) -> Option<(Unit<Vector3<f64>>, Status, u32)> {
        let least = self.weights[0].min(self.weights[1]);
        let mut z = *from;
        let mut margins = self.margins(&z)?;
        for iteration in 1..=limit {
            let pulls = [self.weights[0] / margins[0], self.weights[1] / margins[1]];
            let along = self.directions.map(|d| d.dot(&z));
            let t = [0, 1].map(|i| self.directions[i] - z.into_inner() * along[i]);
            let gamma = pulls[0] * along[0] + pulls[1] * along[1];
            let squares = t.map(|t| t.norm_squared());
            let (longer, square) =
                if squares[0] < squares[1] { (t[1], squares[1]) } else { (t[0], squares[0]) };
            if square == 0.0 {
                return Some((z, Status::Converged, iteration));
            }
            let e1 = longer / square.sqrt();
            let e2 = z.cross(&e1);
            let [x, y] = [e1, e2].map(|e| t.map(|t| t.dot(&e)));
            let bend = [pulls[0] / margins[0], pulls[1] / margins[1]];
            let product = |a: &[f64; 2], b: &[f64; 2]| bend[0] * a[0] * b[0] + bend[1] * a[1] * b[1];
            let (h11, h12, h22) = (gamma + product(&x, &x), product(&x, &y), gamma + product(&y, &y));
            let area = x[0] * y[1] - x[1] * y[0];
            let determinant = gamma * (h11 + h22 - gamma) + bend[0] * bend[1] * area * area;
            let g = [pulls[0] * x[0] + pulls[1] * x[1], pulls[0] * y[0] + pulls[1] * y[1]];
            let step = (e1 * (h22 * g[0] - h12 * g[1]) + e2 * (h11 * g[1] - h12 * g[0])) / determinant;
            let r = e1 * g[0] + e2 * g[1];
            let decrement = r.dot(&step) / least;
            let error = step.norm() * decrement.max(0.0).sqrt();
            if !error.is_finite() {
                return None;
            }
            if decrement <= NEWTON_DECREMENT {
                let trial = Unit::new_normalize(z.into_inner() + step);
                if let Some(next) = self.margins(&trial) {
                    if error <= tolerance {
                        return Some((trial, Status::Converged, iteration));
                    }
                    (z, margins) = (trial, next);
                    continue;
                }
            }
            (z, margins) = self.measured(&z, &step, &margins, decrement * least)?;
        }
        Some((z, Status::IterationLimit, limit))
    }

    /// The margins at `z`; `None` outside.
    #[inline]
    fn margins(&self, z: &Unit<Vector3<f64>>) -> Option<[f64; 2]> {
        let m1 = self.directions[0].dot(z) - self.cosines[0];
        let m2 = self.directions[1].dot(z) - self.cosines[1];
        (m1 > 0.0 && m2 > 0.0).then_some([m1, m2])
    }

    /// A point along `step` that decreases the sum of the barriers enough, and its margins; longer than the step while
    /// that pays. `None` where no decrease is left above rounding.
    fn measured(
        &self,
        z: &Unit<Vector3<f64>>,
        step: &Vector3<f64>,
        margins: &[f64; 2],
        slope: f64,
    ) -> Option<(Unit<Vector3<f64>>, [f64; 2])> {
        // The barriers against those at z: one quotient each, so that nothing cancels.
        let at = |length: f64| {
            let trial = Unit::new_normalize(z.into_inner() + step * length);
            let next = self.margins(&trial)?;
            let change = -(self.weights[0] * (next[0] / margins[0]).ln()
                + self.weights[1] * (next[1] / margins[1]).ln());
            Some((trial, next, change))
        };
        let mut length = 1.0;
        let mut best = at(length);
        let mut halvings = 0;
        while best.is_none_or(|(_, _, change)| change > -SUFFICIENT_DECREASE * length * slope) {
            if halvings == HALVINGS {
                return None;
            }
            halvings += 1;
            length *= 0.5;
            best = at(length);
        }
        // Only a step that is about to leave a boundary gains from going further.
        if halvings == 0 && slope > STEP_DOUBLING * self.weights[0].min(self.weights[1]) {
            for _ in 0..DOUBLINGS {
                length *= 2.0;
                match (at(length), best) {
                    (Some(trial), Some(found)) if trial.2 < found.2 => best = Some(trial),
                    _ => break,
                }
            }
        }
        best.map(|(trial, next, _)| (trial, next))
    }
}

/// Steps after which the axis is computed from its shadow again: their rounding does not add up beyond 1e-14.
const SHADOW_STEPS: u32 = 64;
