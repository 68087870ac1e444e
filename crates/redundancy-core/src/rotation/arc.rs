//! The best tool direction between two cones on one axis, in closed form up to one scalar root.
//!
//! # Problem
//! Minimise `h = -k1 log((z.u - cos beta)/2) - k2 log((z.c - cos alpha)/2)` over directions `z`: the paper's
//! `phi = k_err phi_err + k_tcp phi_tcp` [FromGravdahl2009, eqs. (34), (35)], where the spin about `z` is free.
//!
//! # Derivation
//! Both terms grow with the angle to their axis, so `z` lies on the arc from `u` to `c`, of length `omega`. At the
//! angle `t` from `u`, `h` is strictly convex on `(max(0, omega - alpha), min(beta, omega))`, which is not empty iff
//! `omega < alpha + beta`. With `x = tan(t/2)`, `y = tan((omega - t)/2)`,
//! `B = tan(beta/2)`, `A = tan(alpha/2)`, `T = tan(omega/2)`, `h' = 0` reads
//!
//! `k1 (1 + B^2) x / (B^2 - x^2) = k2 (1 + A^2) y / (A^2 - y^2)`, `y = (T - x) / (1 + T x)`,
//!
//! a quartic in `x` with exactly one root in the interval, in which every
//! factor is a product of differences, so that nothing cancels in thin or tiny cones:
//!
//! `k1 (1+B^2) x (1+A T)(x - x_a)((T+A) + (A T - 1) x) - k2 (1+A^2)(T - x)(1 + T x)(B - x)(B + x) = 0`,
//! `x_a = (T - A)/(1 + T A)`.
//!
//! It is found by Halley's method inside the bracket from the secant's point; no trigonometric function is needed.
//!
//! # Degenerate cases
//! `omega = 0`: `z = u`. Disjoint cones: infeasible, and the direction in the middle of the gap is returned.
//! From half-angles of 90 degrees on the problem is no longer convex and belongs to Newton.
//!
//! Cost: 2.6 steps in the mean, about 0.1 us. Reference: [FromGravdahl2009].

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Unit, Vector3};

use crate::Status;
use crate::error::{Error, Result};
use crate::rotation::quaternion::{angle_between, half_turn};
use crate::tolerance::{ARC_STEP, START_RIM};

/// Most steps of the scalar root: bisection alone would have met rounding by then.
const ARC_STEPS: u32 = 64;

/// Two cones on one axis, without their directions.
///
/// ```
/// use redundancy_core::rotation::{TwoCones, unit_direction};
/// let cones = TwoCones::new(0.4, 0.4, 1.0, 1.0)?;
/// let (u, c) = (unit_direction("u", [0., 0., -1.])?, unit_direction("c", [0.5, 0., -1.])?);
/// let best = cones.minimum(&u, &c);
/// // Equal cones and weights: half-way.
/// assert!((best.direction.dot(&u) - best.direction.dot(&c)).abs() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoCones {
    beta: f64,
    alpha: f64,
    /// Tangents of half the half-angles.
    b: f64,
    a: f64,
    /// Weights times 1 + tan^2.
    k1: f64,
    k2: f64,
}

/// The best direction between two cones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionMinimum {
    /// Unit; when infeasible the direction in the middle of the gap.
    pub direction: Unit<Vector3<f64>>,
    /// `Converged` or `Infeasible`.
    pub status: Status,
    /// Steps of the scalar root.
    pub iterations: u32,
    /// Angle, rad, by which the cones miss each other; 0 when they meet.
    pub miss_angle: f64,
}

impl DirectionMinimum {
    fn at(direction: Unit<Vector3<f64>>, iterations: u32) -> Self {
        Self { direction, status: Status::Converged, iterations, miss_angle: 0.0 }
    }
}

/// Checks the weight of a barrier.
pub(crate) fn check_weight(what: &str, weight: f64) -> Result<()> {
    if weight > 0.0 && weight.is_finite() {
        return Ok(());
    }
    Err(Error::OutOfRange { what: what.into(), value: weight, bound: "positive and finite".into() })
}

impl TwoCones {
    /// Half-angles `beta` around the first direction and `alpha` around the second, rad, and their weights.
    ///
    /// # Errors
    /// A half-angle outside (0, pi/2), a weight that is not positive and finite.
    pub fn new(beta: f64, alpha: f64, k_err: f64, k_tcp: f64) -> Result<Self> {
        for (what, angle) in [("beta", beta), ("alpha", alpha)] {
            if !(angle > 0.0 && angle < FRAC_PI_2) {
                let bound = "in (0, pi/2) rad for the closed form".into();
                return Err(Error::OutOfRange { what: what.into(), value: angle, bound });
            }
        }
        check_weight("k_err", k_err)?;
        check_weight("k_tcp", k_tcp)?;
        Ok(Self::from_checked(beta, alpha, k_err, k_tcp))
    }

    pub(crate) fn from_checked(beta: f64, alpha: f64, k_err: f64, k_tcp: f64) -> Self {
        let (b, a) = ((0.5 * beta).tan(), (0.5 * alpha).tan());
        Self { beta, alpha, b, a, k1: k_err * (1.0 + b * b), k2: k_tcp * (1.0 + a * a) }
    }

    /// The direction `z` that minimises the sum of both barriers, for the first cone around `u`, the second around `c`.
    #[inline]
    pub fn minimum(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> DirectionMinimum {
        let t = half_tangent(u, c);
        if !self.meet(t) {
            return self.gap(u, c);
        }
        if t == 0.0 {
            return DirectionMinimum::at(*u, 0);
        }
        let (x, iterations) = Quartic::new(self, t).root();
        DirectionMinimum::at(between(u, c, t, x), iterations)
    }

    /// A direction inside of both cones and near the minimum, the root's first guess: a start for other methods.
    pub(crate) fn guess(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> DirectionMinimum {
        let t = half_tangent(u, c);
        if !self.meet(t) {
            return self.gap(u, c);
        }
        if t == 0.0 {
            return DirectionMinimum::at(*u, 0);
        }
        let quartic = Quartic::new(self, t);
        let (low, high) = quartic.ends;
        let rim = START_RIM * (high - low);
        DirectionMinimum::at(between(u, c, t, quartic.secant().clamp(low + rim, high - rim)), 0)
    }

    /// Whether `omega < alpha + beta`, by their half tangents; an antipodal pair has T = infinity and never meets.
    #[inline]
    fn meet(&self, t: f64) -> bool {
        t - self.a < self.b * (1.0 + t * self.a)
    }

    fn gap(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> DirectionMinimum {
        let miss_angle = (angle_between(u, c) - self.alpha - self.beta).max(0.0);
        let direction = on_arc(u, c, self.beta + 0.5 * miss_angle);
        DirectionMinimum { direction, status: Status::Infeasible, iterations: 0, miss_angle }
    }
}

/// The quartic of the module's head, for one length of the arc.
struct Quartic {
    /// T, B and `x_a`.
    t: f64,
    b: f64,
    x_a: f64,
    /// T + A and A T - 1.
    f: f64,
    g: f64,
    /// Weights of its two products.
    k1: f64,
    k2: f64,
    /// The interval that holds its root.
    ends: (f64, f64),
}

impl Quartic {
    #[inline]
    fn new(cones: &TwoCones, t: f64) -> Self {
        let TwoCones { b, a, k1, k2, .. } = *cones;
        let e = 1.0 + a * t;
        let x_a = (t - a) / e;
        Self { t, b, x_a, f: t + a, g: a * t - 1.0, k1: k1 * e, k2, ends: (x_a.max(0.0), b.min(t)) }
    }

    #[inline]
    fn value(&self, x: f64) -> f64 {
        let first = self.k1 * x * (x - self.x_a) * (self.f + self.g * x);
        first - self.k2 * (self.t - x) * (1.0 + self.t * x) * (self.b - x) * (self.b + x)
    }

    /// Where the line between the values at the ends of the interval crosses zero.
    #[inline]
    fn secant(&self) -> f64 {
        let (low, high) = self.ends;
        let (at_low, at_high) = (self.value(low), self.value(high));
        let x = low - at_low * (high - low) / (at_high - at_low);
        if x > low && x < high { x } else { 0.5 * (low + high) }
    }

    /// The root in the interval and the number of steps.
    #[inline]
    fn root(&self) -> (f64, u32) {
        let Self { t, b, x_a, f, g, k1, k2, ends } = *self;
        let (mut low, mut high) = ends;
        let mut x = self.secant();
        for step in 1..=ARC_STEPS {
            // Each product as (value, slope, curvature) of two quadratics.
            let (d, d1, d2) = ((x - x_a) * (f + g * x), f + g * (2.0 * x - x_a), 2.0 * g);
            let (n, n1, n2) = ((t - x) * (1.0 + t * x), t * t - 1.0 - 2.0 * t * x, -2.0 * t);
            let (m, m1, m2) = ((b - x) * (b + x), -2.0 * x, -2.0);
            let p = k1 * x * d - k2 * n * m;
            if p < 0.0 {
                low = x;
            } else {
                high = x;
            }
            let p1 = k1 * (d + x * d1) - k2 * (n1 * m + n * m1);
            let p2 = k1 * (2.0 * d1 + x * d2) - k2 * (n2 * m + 2.0 * n1 * m1 + n * m2);
            // Halley: cubic convergence for the price of one more product.
            let mut next = x - 2.0 * p * p1 / (2.0 * p1 * p1 - p * p2);
            if !(low..=high).contains(&next) {
                next = 0.5 * (low + high);
            }
            let moved = (next - x).abs();
            x = next;
            if moved <= (ARC_STEP * (x - ends.0).min(ends.1 - x)).max(f64::EPSILON * x) {
                return (x, step);
            }
        }
        (x, ARC_STEPS)
    }
}

/// `tan(omega/2)`, accurate for tiny and for wide arcs alike.
#[inline]
fn half_tangent(u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> f64 {
    ((u.into_inner() - c.into_inner()).norm_squared() / (u.into_inner() + c.into_inner()).norm_squared())
        .sqrt()
}

/// The direction with `tan(angle from u / 2) = x`: `(u sin(omega - t) + c sin t) / sin omega`, `sin t = 2x / (1 + x^2)`.
#[inline]
fn between(u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>, t: f64, x: f64) -> Unit<Vector3<f64>> {
    let y = (t - x) / (1.0 + t * x);
    Unit::new_normalize(u.into_inner() * (y * (1.0 + x * x)) + c.into_inner() * (x * (1.0 + y * y)))
}

/// The direction at the angle `t` from `u` on the arc to `c`; past antipodal ends the arc is canonical.
pub(crate) fn on_arc(u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>, t: f64) -> Unit<Vector3<f64>> {
    let across = c.into_inner() - u.into_inner() * u.dot(c);
    let norm = across.norm();
    // Below rounding the direction of the arc is noise: any will do, the same each time.
    let e = if norm > f64::EPSILON { across / norm } else { half_turn(u).imag() };
    Unit::new_normalize(u.into_inner() * t.cos() + e * t.sin())
}
