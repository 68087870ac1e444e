//! The best orientation: the minimiser of a weighted sum of logarithmic barriers.
//!
//! # Problem
//! `phi(q) = -sum_i k_i log m_i(q)` over unit quaternions, `m_i` the margins of [cones and spins](crate::rotation::Cone)
//! [FromGravdahl2009, eqs. (27), (34), (43), (46)]. It is not convex on S^3; each cone term is geodesically convex in
//! its direction for half-angles below 90 degrees.
//!
//! # Methods
//! * **closed form**: one cone, two cones on one body axis (both below 90 degrees, see [`TwoCones`]), either with a
//!   spin about that axis, or a spin alone. With a spin the direction `z` is that of the cones alone and the twist is
//!   zero: `Q = Q_e * swing(axis -> R(Q_e)^T z)`, because the spin term depends on the twist only.
//! * **newton**: Riemannian Newton on S^3 in body coordinates, `q <- normalise(q * (1, delta/2))`. The Hessian is
//!   factored; where it is not positive definite the spins' second derivatives are left out and the magnitudes of the
//!   remaining eigenvalues are used, raised to [`HESSIAN_FLOOR`] of the largest. Steps with a small decrement are taken whole, others are measured, halved
//!   while they do not decrease `phi` enough and doubled while that pays. No iterate leaves the sets. For two cones below
//!   90 degrees on one body axis, with or without a spin about it, the problem is one of that axis alone, as in the
//!   closed form, and Newton runs on its sphere.
//! * **gradient**: the paper's, `Q <- normalise(Q - a grad phi(Q))`, [FromGravdahl2009, eq. (40)] with Q where print
//!   has phi, normalised in every iteration: 'optimise freely, normalise afterwards' is unbounded below. The radial
//!   part of the printed gradient only rescales `Q` before it is normalised and is left out. The step `a` is fixed,
//!   halved only where it would leave the sets; or it is halved until `phi` falls enough, starting from the inverse
//!   curvature along the last step [BarzilaiBorwein1988].
//! * **auto**: the closed form where it applies, else Newton.
//!
//! # Non-unique minimisers
//! | constraints | what is free | returned |
//! |---|---|---|
//! | cones on one body axis | the spin about it | see below |
//! | cones around one direction | the rotation about it | the one nearest to `q0`, else to `[0, 0, 1, 0]` |
//! | one spin | the direction of the axis | the one nearest to `q0`, else the reference |
//!
//! For cones on one body axis the result is the orientation that the least rotation reaches from `q0`, so that along
//! a path, each solution the next `q0`, it moves continuously and does not spin. Without `q0` it is
//! `swing(d -> z) * swing(-b -> d) * half_turn`, with `d` the first cone's direction, `b` the body axis and
//! `half_turn` the canonical rotation from `b` to `-b`: for a tool that points down, `swing(u -> z) * [0, 0, 1, 0]`,
//! the paper's cold start. It is continuous in all inputs except where `d` passes `+b` (at `d = b` it is
//! `swing(d -> z)`). The sign follows the same product, or `q0`.
//!
//! Cost: closed form 0.26 us, Newton 0.6 us (two cones and a spin), one fixed gradient step 0.03 us (two cones).
//! References: [FromGravdahl2009].

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Quaternion, SymmetricEigen, Unit, UnitQuaternion, Vector3};

use crate::Status;
use crate::error::{Error, Result, check_finite};
use crate::parallel::prelude::*;
use crate::rotation::arc::{TwoCones, on_arc};
use crate::rotation::barrier::{self, Barrier, Model};
use crate::rotation::cone::{Cone, Constraint, Spin, unpack};
use crate::rotation::fixed_step::Forms;
use crate::rotation::on_axis::{DOUBLINGS, HALVINGS, TwoPulls, descend_on_axis};
use crate::rotation::quaternion::{
    angle_between, compose, half_turn, nearest_sign, shortest_arc, swing_twist, unit_direction,
};
use crate::rotation::start::{self, Start};
use crate::tolerance::{
    ANGLE_PART, GRADIENT_STATIONARY, HESSIAN_FLOOR, HESSIAN_PIVOT, NEWTON_DECREMENT, ORIENTATION_STEP,
    PLAIN_MARGIN, SAME_AXIS, SAME_VALUE, STEP_DOUBLING, SUFFICIENT_DECREASE, VALUE_ROUNDING, WEIGHT_RATIO,
};

/// How the barrier problem is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum OrientationMethod {
    /// The closed form where it applies, else Newton.
    Auto,
    /// Two cones on one axis, with a spin about it.
    ClosedForm,
    /// Riemannian Newton.
    Newton,
    /// The paper's gradient method.
    Gradient,
}

impl OrientationMethod {
    /// Every method.
    pub const ALL: [Self; 4] = [Self::Auto, Self::ClosedForm, Self::Newton, Self::Gradient];

    /// The method as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::ClosedForm => "closed_form",
            Self::Newton => "newton",
            Self::Gradient => "gradient",
        }
    }
}

impl std::str::FromStr for OrientationMethod {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|m| m.as_str() == name).ok_or_else(|| Error::UnknownName {
            kind: "method",
            name: name.into(),
            valid: Self::ALL.iter().map(|m| m.as_str().into()).collect(),
        })
    }
}

/// Settings of [`OrientationOptimizer`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientationSettings {
    /// How to solve.
    pub method: OrientationMethod,
    /// Estimated remaining angle, rad, at which the iteration stops. `None`: [`ORIENTATION_STEP`] for Newton,
    /// [`GRADIENT_STATIONARY`] for the gradient method.
    pub tolerance: Option<f64>,
    /// Most iterations. `None`: 100 for Newton, 10 000 for the gradient method.
    pub max_iterations: Option<u32>,
    /// Step `a` of the gradient method, in units of the paper's quaternion gradient: fixed, or the first one tried.
    /// `None`: the inverse curvature of the barriers on their axes.
    pub step: Option<f64>,
    /// Whether the gradient method measures the decrease of every step.
    pub backtracking: bool,
}

impl Default for OrientationSettings {
    fn default() -> Self {
        Self {
            method: OrientationMethod::Auto,
            tolerance: None,
            max_iterations: None,
            step: None,
            backtracking: true,
        }
    }
}

impl OrientationSettings {
    /// Checks the numbers.
    ///
    /// # Errors
    /// A tolerance, step or number of iterations that is not positive, or not finite.
    pub fn validate(&self) -> Result<()> {
        for (what, value) in [("tolerance", self.tolerance), ("step", self.step)] {
            if let Some(value) = value
                && !(value > 0.0 && value.is_finite())
            {
                let bound = "positive and finite".into();
                return Err(Error::OutOfRange { what: what.into(), value, bound });
            }
        }
        if self.max_iterations == Some(0) {
            return Err(Error::OutOfRange {
                what: "max_iterations".into(),
                value: 0.0,
                bound: ">= 1".into(),
            });
        }
        Ok(())
    }
}

/// Result of [`OrientationOptimizer::solve`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientationSolution {
    /// The orientation; when infeasible the one that exceeds the constraints least.
    pub q: UnitQuaternion<f64>,
    /// Sum of weight x barrier; infinite when infeasible.
    pub value: f64,
    /// `Converged`, `IterationLimit`, `Infeasible`, or `Singular` (the spin is undefined at the cones' minimum).
    pub status: Status,
    /// Iterations, those of a search for a start not counted; of the closed form the steps of its scalar root.
    pub iterations: u32,
    /// Norm of the gradient in the body tangent space at `q`, 1/rad; infinite when infeasible.
    pub gradient_norm: f64,
    /// Angle, rad, by which the constraints miss each other; 0 when they meet.
    pub miss_angle: f64,
    /// The method that was used, never `Auto`.
    pub method: OrientationMethod,
}

/// What the constraints' structure allows.
#[derive(Debug, Clone, Copy)]
enum Structure {
    /// One or two cones on one body axis; `spin` about the same axis.
    Axis { axis: Unit<Vector3<f64>>, first: Unit<Vector3<f64>>, second: Option<Second>, spin: Option<Spin> },
    /// A spin alone.
    Twist(Spin),
    /// Anything else.
    General,
}

/// The second cone of an axis.
#[derive(Debug, Clone, Copy)]
struct Second {
    direction: Unit<Vector3<f64>>,
    /// The closed form, when both half-angles are below 90 degrees.
    cones: Option<TwoCones>,
    /// Half-angles of the first and the second cone.
    half_angles: [f64; 2],
}

/// A rotation that changes no margin.
#[derive(Debug, Clone, Copy)]
enum Symmetry {
    None,
    /// About this body axis.
    Body(Unit<Vector3<f64>>),
    /// About this direction.
    World(Unit<Vector3<f64>>),
}

/// Finds the orientation that minimises a weighted sum of logarithmic barriers.
///
/// ```
/// use redundancy_core::Status;
/// use redundancy_core::rotation::{Barrier, Cone, OrientationOptimizer, OrientationSettings};
/// let down = Cone::downward(20_f64.to_radians())?;
/// let centre = Cone::z([0.3, 0.1, -0.9], 60_f64.to_radians())?;
/// let barriers = vec![Barrier::new(1.0, down)?, Barrier::new(1.0, centre)?];
/// let optimizer = OrientationOptimizer::new(barriers, OrientationSettings::default())?;
/// let best = optimizer.solve(None);
/// assert_eq!(best.status, Status::Converged);
/// assert!(optimizer.margins(&best.q).all(|m| m > 0.0) && best.gradient_norm < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct OrientationOptimizer {
    barriers: Vec<Barrier>,
    settings: OrientationSettings,
    method: OrientationMethod,
    structure: Structure,
    symmetry: Symmetry,
    /// Least weight.
    least: f64,
    /// Sum of the barriers' curvatures on their axes, 1/rad^2.
    curvature: f64,
    /// Orientation from which the canonical minimiser of cones on one body axis is reached without `q0`.
    base: UnitQuaternion<f64>,
}

impl OrientationOptimizer {
    /// Optimizer of the sum of `barriers`.
    ///
    /// # Errors
    /// No barrier, weights in a ratio above [`WEIGHT_RATIO`], settings that do not validate, or the closed form asked for constraints that have none.
    pub fn new(barriers: Vec<Barrier>, settings: OrientationSettings) -> Result<Self> {
        settings.validate()?;
        if barriers.is_empty() {
            return Err(Error::Invalid("constraints: the list is empty, at least one is needed".into()));
        }
        let structure = structure_of(&barriers);
        let closed = match structure {
            Structure::Axis { second, .. } => second.is_none_or(|s| s.cones.is_some()),
            Structure::Twist(_) => true,
            Structure::General => false,
        };
        let method = match settings.method {
            OrientationMethod::Auto | OrientationMethod::ClosedForm if closed => {
                OrientationMethod::ClosedForm
            }
            // Two cones, one of 90 degrees or more: the closed form steps aside for Newton.
            OrientationMethod::ClosedForm if matches!(structure, Structure::General) => {
                return Err(Error::Invalid(
                    "method 'closed_form' needs one or two cones on one body axis, optionally with one spin about \
                     it, or one spin; use 'newton' or 'auto'"
                        .into(),
                ));
            }
            OrientationMethod::Auto | OrientationMethod::ClosedForm => OrientationMethod::Newton,
            other => other,
        };
        let least = barriers.iter().map(Barrier::weight).fold(f64::INFINITY, f64::min);
        let most = barriers.iter().map(Barrier::weight).fold(0.0, f64::max);
        if most > WEIGHT_RATIO * least {
            return Err(Error::Invalid(format!(
                "weights from {least:e} to {most:e}: the largest must be at most {WEIGHT_RATIO:e} times the smallest"
            )));
        }
        let curvature = barriers
            .iter()
            .map(|b| match b.constraint() {
                Constraint::Cone(cone) => 0.5 * b.weight() / cone.scale(),
                Constraint::Spin(spin) => 0.5 * b.weight() / spin.kappa2(),
            })
            .sum();
        let symmetry = symmetry_of(&barriers);
        let base = match symmetry {
            Symmetry::Body(axis) => base_of(&axis, &barriers),
            _ => half_turn(&Vector3::z_axis()),
        };
        Ok(Self { barriers, settings, method, structure, symmetry, least, curvature, base })
    }

    /// Turns the cones to other directions, in order, without anything made anew: only for cones on different body axes,
    /// whose structure does not depend on where they point.
    pub(crate) fn turn_to(&mut self, directions: &[Unit<Vector3<f64>>]) {
        debug_assert!(
            matches!(self.structure, Structure::General) && !matches!(self.symmetry, Symmetry::Body(_))
        );
        for (barrier, direction) in self.barriers.iter_mut().zip(directions) {
            barrier.turn_to(*direction);
        }
        self.symmetry = symmetry_of(&self.barriers);
    }

    /// The barriers.
    pub fn barriers(&self) -> &[Barrier] {
        &self.barriers
    }

    /// The settings.
    pub fn settings(&self) -> &OrientationSettings {
        &self.settings
    }

    /// The method that [`solve`](Self::solve) uses.
    pub fn method(&self) -> OrientationMethod {
        self.method
    }

    /// The margins at `q`, in the order of the constraints.
    pub fn margins<'a>(&'a self, q: &'a UnitQuaternion<f64>) -> impl Iterator<Item = f64> + 'a {
        self.barriers.iter().map(move |b| b.constraint().margin(q))
    }

    /// Sum of weight x barrier at `q`; infinite outside of a set.
    pub fn value(&self, q: &UnitQuaternion<f64>) -> f64 {
        barrier::value(&self.barriers, q)
    }

    /// Gradient of the sum in the body tangent space, 1/rad; `None` outside of a set.
    pub fn gradient(&self, q: &UnitQuaternion<f64>) -> Option<Vector3<f64>> {
        barrier::gradient(&self.barriers, q)
    }

    /// Hessian of the sum in the body tangent space, 1/rad^2; `None` outside of a set.
    pub fn hessian(&self, q: &UnitQuaternion<f64>) -> Option<Matrix3<f64>> {
        barrier::model(&self.barriers, q).map(|m| unpack(&m.hessian))
    }

    /// The minimiser. Iterations start at `q0` when it is inside of every set, else at a feasible start that is
    /// searched; where the minimiser is not unique the one nearest to `q0` is returned (see the module).
    ///
    /// Constraints without a closed form may have several local minima: with `q0` the one that the descent from it
    /// reaches is returned, without it the best one under several starts.
    pub fn solve(&self, q0: Option<&UnitQuaternion<f64>>) -> OrientationSolution {
        if self.method == OrientationMethod::ClosedForm {
            return self.closed_form(q0);
        }
        if let Some(q) = q0
            && let Some(solution) = self.iterate(*q, q0)
        {
            return solution;
        }
        match self.quick_start(q0) {
            Quick::One(q) => {
                if let Some(solution) = self.iterate(q, q0) {
                    return solution;
                }
            }
            Quick::Two(a, b) => {
                if let (Some(a), Some(b)) = (self.iterate(a, q0), self.iterate(b, q0)) {
                    return if b.value < a.value { b } else { a };
                }
            }
            Quick::Outside(q, miss_angle) => return self.infeasible(q, miss_angle, 0),
            Quick::Unknown => {}
        }
        match start::find(&self.barriers, q0) {
            Start::Outside(q, miss_angle) => self.infeasible(q, miss_angle, 0),
            Start::Inside(q) => {
                let mut best = self.iterate(q, q0).unwrap_or_else(|| self.infeasible(q, 0.0, 0));
                if q0.is_none() && matches!(self.structure, Structure::General) {
                    // Not convex: the best of the minima that lie under the candidates of the search for a start.
                    for other in start::seeds(&self.barriers).filter_map(|q| self.iterate(q, q0)) {
                        if other.value < best.value - SAME_VALUE * best.value.abs().max(1.0) {
                            best = other;
                        }
                    }
                }
                best
            }
        }
    }

    fn infeasible(&self, q: UnitQuaternion<f64>, miss_angle: f64, iterations: u32) -> OrientationSolution {
        OrientationSolution {
            q,
            value: f64::INFINITY,
            status: Status::Infeasible,
            iterations,
            gradient_norm: f64::INFINITY,
            miss_angle,
            method: self.method,
        }
    }

    /// Value and gradient measured at `q`.
    fn finish(&self, q: UnitQuaternion<f64>, status: Status, iterations: u32) -> OrientationSolution {
        let (value, slope) = barrier::value_and_gradient(&self.barriers, &q);
        OrientationSolution {
            q,
            value,
            status: if value.is_finite() { status } else { Status::Singular },
            iterations,
            gradient_norm: slope.norm(),
            miss_angle: 0.0,
            method: self.method,
        }
    }

    fn closed_form(&self, q0: Option<&UnitQuaternion<f64>>) -> OrientationSolution {
        match &self.structure {
            Structure::Axis { axis, first, second, spin } => {
                let (z, status, iterations, miss) = match second {
                    Some(Second { direction, cones: Some(cones), .. }) => {
                        let best = cones.minimum(first, direction);
                        (best.direction, best.status, best.iterations, best.miss_angle)
                    }
                    _ => (*first, Status::Converged, 0, 0.0),
                };
                let q = self.with_axis(axis, &z, spin.as_ref(), q0);
                if status == Status::Infeasible {
                    return self.infeasible(q, miss, iterations);
                }
                self.finish(q, status, iterations)
            }
            Structure::Twist(spin) => self.finish(without_twist(spin, q0), Status::Converged, 0),
            // Not reached: `new` gives such problems to another method.
            Structure::General => self.infeasible(self.base, 0.0, 0),
        }
    }

    /// The canonical orientation whose body axis `axis` points along `z`.
    #[inline]
    fn with_axis(
        &self,
        axis: &Unit<Vector3<f64>>,
        z: &Unit<Vector3<f64>>,
        spin: Option<&Spin>,
        q0: Option<&UnitQuaternion<f64>>,
    ) -> UnitQuaternion<f64> {
        match (spin, q0) {
            (Some(spin), _) => {
                let reference = spin.reference();
                let q = compose(&reference, &shortest_arc(axis, &(reference.inverse() * z)));
                q0.map_or(q, |q0| nearest_sign(q, q0))
            }
            (None, Some(q0)) => compose(&shortest_arc(&(q0 * axis), z), q0),
            (None, None) => compose(&shortest_arc(&(self.base * axis), z), &self.base),
        }
    }

    /// Starts that the structure gives without a search; they may still lie outside, by rounding or at a spin's pole.
    fn quick_start(&self, q0: Option<&UnitQuaternion<f64>>) -> Quick {
        let Structure::Axis { axis, first, second, spin } = &self.structure else {
            return Quick::Unknown;
        };
        let place = |z: &Unit<Vector3<f64>>| self.with_axis(axis, z, spin.as_ref(), q0);
        match second {
            None => Quick::One(place(first)),
            Some(Second { direction, cones: Some(cones), .. }) => {
                let guess = cones.guess(first, direction);
                let q = place(&guess.direction);
                if guess.status == Status::Infeasible {
                    return Quick::Outside(q, guess.miss_angle);
                }
                Quick::One(q)
            }
            Some(Second { direction, half_angles, .. }) => {
                match wide_middles(first, direction, *half_angles) {
                    [Some(a), Some(b)] => Quick::Two(place(&a), place(&b)),
                    [Some(a), None] | [None, Some(a)] => Quick::One(place(&a)),
                    [None, None] => Quick::Unknown,
                }
            }
        }
    }

    /// The descent from `start`; `None` when it lies outside of a set.
    fn iterate(
        &self,
        start: UnitQuaternion<f64>,
        q0: Option<&UnitQuaternion<f64>>,
    ) -> Option<OrientationSolution> {
        let (q, status, iterations) = match self.method {
            OrientationMethod::Gradient => self.gradient_method(start),
            _ => {
                if let Some((q, status, iterations)) = self.newton_on_axis(&start, q0) {
                    return Some(self.finish(q, status, iterations));
                }
                self.newton(start)
            }
        }?;
        Some(self.finish(self.canonical(q, q0), status, iterations))
    }

    /// The member of the minimiser's orbit that the module's rule picks.
    fn canonical(&self, q: UnitQuaternion<f64>, q0: Option<&UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
        match &self.symmetry {
            Symmetry::Body(axis) => self.with_axis(axis, &(q * axis), None, q0),
            Symmetry::World(direction) => {
                let reference = q0.unwrap_or(&self.base);
                let towards = compose(reference, &q.inverse());
                nearest_sign(compose(&swing_twist(&towards, direction).1, &q), reference)
            }
            Symmetry::None => match (&self.structure, q0) {
                (Structure::Twist(spin), _) => without_twist(spin, q0),
                (_, Some(q0)) => nearest_sign(q, q0),
                (_, None) => q,
            },
        }
    }

    fn newton(&self, start: UnitQuaternion<f64>) -> Option<Descent> {
        let tolerance = self.settings.tolerance.unwrap_or(ORIENTATION_STEP);
        let limit = self.settings.max_iterations.unwrap_or(NEWTON_ITERATIONS);
        let mut q = start;
        let mut model = barrier::model(&self.barriers, &q)?;
        // The value at q, where a line search has measured it.
        let mut value = None;
        for iteration in 1..=limit {
            self.flatten(&mut model, &q);
            let step = factored_direction(&model).unwrap_or_else(|| self.convex_direction(&q, &model));
            // Squared decrement per unit of weight: at 1 the step reaches about to the boundary.
            let decrement = -model.gradient.dot(&step) / self.least;
            let size = step.norm();
            let error = size * decrement.max(0.0).sqrt();
            if decrement <= NEWTON_DECREMENT {
                let trial = retract(&q, &step);
                // Quadratic convergence: the error after the step is its length times the decrement before it. Where the
                // step ends `finish` measures; no model is needed there.
                if error <= tolerance && barrier::inside(&self.barriers, &trial) {
                    return Some((trial, Status::Converged, iteration));
                }
                if let Some(next) = barrier::model(&self.barriers, &trial) {
                    (q, model, value) = (trial, next, None);
                    continue;
                }
            }
            let before = value.unwrap_or_else(|| barrier::value(&self.barriers, &q));
            let found = self.line_search(&q, &step, before, decrement * self.least);
            let next = found
                .and_then(|(trial, after)| Some((trial, after, barrier::model(&self.barriers, &trial)?)));
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
        let Some(mut convex) = barrier::convex_model(&self.barriers, q) else {
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
            (trial, barrier::value(&self.barriers, &trial))
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
    fn flatten(&self, model: &mut Model, q: &UnitQuaternion<f64>) {
        let n = match &self.symmetry {
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

    fn gradient_method(&self, start: UnitQuaternion<f64>) -> Option<Descent> {
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
}

impl OrientationOptimizer {
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
    fn two_pulls(&self) -> Option<TwoPulls> {
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

    /// Newton for two cones below 90 degrees on one body axis, with or without a spin about it: on the sphere of the axis.
    /// The spin's term depends on the twist alone and is least without one, as in the closed form.
    fn newton_on_axis(
        &self,
        start: &UnitQuaternion<f64>,
        q0: Option<&UnitQuaternion<f64>>,
    ) -> Option<Descent> {
        let Structure::Axis { axis, second: Some(Second { cones: Some(_), .. }), spin, .. } = &self.structure
        else {
            return None;
        };
        let tolerance = self.settings.tolerance.unwrap_or(ORIENTATION_STEP);
        let limit = self.settings.max_iterations.unwrap_or(NEWTON_ITERATIONS);
        let (z, status, iterations) = self.two_pulls()?.newton(&(start * axis), tolerance, limit)?;
        Some((self.with_axis(axis, &z, spin.as_ref(), q0), status, iterations))
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

const NEWTON_ITERATIONS: u32 = 100;
const GRADIENT_ITERATIONS: u32 = 10_000;

/// What [`OrientationOptimizer::quick_start`] gives.
enum Quick {
    One(UnitQuaternion<f64>),
    Two(UnitQuaternion<f64>, UnitQuaternion<f64>),
    /// The cones miss each other: the least bad orientation and the angle.
    Outside(UnitQuaternion<f64>, f64),
    Unknown,
}

/// Orientation, status and number of iterations of a descent.
type Descent = (UnitQuaternion<f64>, Status, u32);

/// `q * (1, delta / 2)`, normalised: agrees with `q * exp(delta)` up to the third order and needs no sine.
#[inline]
pub(crate) fn retract(q: &UnitQuaternion<f64>, delta: &Vector3<f64>) -> UnitQuaternion<f64> {
    let factor = Quaternion::new(1.0, 0.5 * delta.x, 0.5 * delta.y, 0.5 * delta.z);
    Unit::new_normalize(q.as_ref() * factor)
}

/// `-H^-1 grad`; where `H` is not positive definite, with the magnitudes of its eigenvalues.
#[inline]
pub(crate) fn descent_direction(model: &Model) -> Vector3<f64> {
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

/// Where the arcs `|t| < beta` and `|t - omega| < alpha` of the great circle through both directions overlap: the
/// middles of the one or two intervals. Each holds exactly one critical point, as both terms are convex along it.
fn wide_middles(
    u: &Unit<Vector3<f64>>,
    c: &Unit<Vector3<f64>>,
    [beta, alpha]: [f64; 2],
) -> [Option<Unit<Vector3<f64>>>; 2] {
    let omega = angle_between(u, c);
    let middle = |centre: f64| {
        let (low, high) = ((-beta).max(centre - alpha), beta.min(centre + alpha));
        (low < high).then(|| on_arc(u, c, 0.5 * (low + high)))
    };
    [middle(omega), middle(omega - std::f64::consts::TAU)]
}

/// The zero twist nearest to `q0`, or the reference itself.
fn without_twist(spin: &Spin, q0: Option<&UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
    let reference = spin.reference();
    let Some(q0) = q0 else { return reference };
    let r = reference.as_ref().conjugate() * q0.as_ref();
    let axis = spin.axis().into_inner();
    let v = r.imag() - axis * r.imag().dot(&axis);
    let norm = r.w.hypot(v.norm());
    if norm < ANGLE_PART {
        return nearest_sign(reference, q0);
    }
    compose(&reference, &Unit::new_normalize(Quaternion::new(r.w, v.x, v.y, v.z)))
}

/// +1 or -1 when the unit vectors are parallel or opposite.
fn alignment(a: &Unit<Vector3<f64>>, b: &Unit<Vector3<f64>>) -> Option<f64> {
    if (a.into_inner() - b.into_inner()).norm() <= SAME_AXIS {
        Some(1.0)
    } else if (a.into_inner() + b.into_inner()).norm() <= SAME_AXIS {
        Some(-1.0)
    } else {
        None
    }
}

/// The cone's direction as seen from `axis`, when its body axis is `axis` or `-axis`.
fn direction_on(cone: &Cone, axis: &Unit<Vector3<f64>>) -> Option<Unit<Vector3<f64>>> {
    alignment(&cone.body_axis(), axis)
        .map(|sign| if sign > 0.0 { cone.direction() } else { -cone.direction() })
}

fn structure_of(barriers: &[Barrier]) -> Structure {
    let mut cones: [Option<(Cone, f64)>; 2] = [None, None];
    let mut spin = None;
    for barrier in barriers {
        match barrier.constraint() {
            Constraint::Cone(cone) if cones[0].is_none() => cones[0] = Some((*cone, barrier.weight())),
            Constraint::Cone(cone) if cones[1].is_none() => cones[1] = Some((*cone, barrier.weight())),
            Constraint::Spin(s) if spin.is_none() => spin = Some(*s),
            _ => return Structure::General,
        }
    }
    let Some((one, k1)) = cones[0] else {
        return spin.map_or(Structure::General, Structure::Twist);
    };
    let axis = one.body_axis();
    if spin.is_some_and(|s| alignment(&s.axis(), &axis).is_none()) {
        return Structure::General;
    }
    let second = match &cones[1] {
        None => None,
        Some((two, k2)) => {
            let Some(direction) = direction_on(two, &axis) else { return Structure::General };
            let half_angles = [one.half_angle(), two.half_angle()];
            let convex = half_angles.iter().all(|a| *a < FRAC_PI_2);
            let cones = convex.then(|| TwoCones::from_checked(half_angles[0], half_angles[1], k1, *k2));
            Some(Second { direction, cones, half_angles })
        }
    };
    Structure::Axis { axis, first: one.direction(), second, spin }
}

fn symmetry_of(barriers: &[Barrier]) -> Symmetry {
    let Constraint::Cone(one) = barriers[0].constraint() else { return Symmetry::None };
    let all = |test: &dyn Fn(&Cone) -> bool| {
        barriers.iter().all(|b| matches!(b.constraint(), Constraint::Cone(cone) if test(cone)))
    };
    if all(&|cone| alignment(&cone.body_axis(), &one.body_axis()).is_some()) {
        Symmetry::Body(one.body_axis())
    } else if all(&|cone| alignment(&cone.direction(), &one.direction()).is_some()) {
        Symmetry::World(one.direction())
    } else {
        Symmetry::None
    }
}

/// `swing(-b -> d) * half_turn(b)`: the body axis points along the first cone's direction.
fn base_of(axis: &Unit<Vector3<f64>>, barriers: &[Barrier]) -> UnitQuaternion<f64> {
    let flip = half_turn(axis);
    match barriers[0].constraint() {
        Constraint::Cone(cone) => compose(&shortest_arc(&-*axis, &cone.direction()), &flip),
        Constraint::Spin(_) => flip,
    }
}

/// The best tool directions between cones around many pairs of directions, in one call.
///
/// Row i of `axes` is the direction within `beta` (rad) of `normals[i]` and within `alpha` of `directions[i]` that
/// minimises `-k_err log((z . n - cos beta)/2) - k_tcp log((z . d - cos alpha)/2)` [FromGravdahl2009, eq. (34)];
/// where the cones miss each other it is the middle of the gap and the status `Infeasible`. `normals` are the
/// directions that the tool axis should follow: for a tool that looks at a surface, into the surface. Rows need not
/// be of unit length. Runs on the current pool; the results do not depend on its size.
///
/// # Errors
/// Inputs and outputs of different lengths, a row without a direction, a half-angle outside (0, pi), a weight that is
/// not positive and finite. From half-angles of 90 degrees on every row is solved by Newton.
///
/// ```
/// use redundancy_core::Status;
/// use redundancy_core::rotation::{DirectionCones, optimal_directions};
/// let (mut axes, mut status) = ([[0.0; 3]; 1], [Status::Infeasible; 1]);
/// let cones = DirectionCones { beta: 0.4, alpha: 1.0, k_err: 1.0, k_tcp: 1.0 };
/// optimal_directions(&[[0., 0., -1.]], &[[0.5, 0., -1.]], &cones, &mut axes, &mut status)?;
/// assert!(status[0] == Status::Converged && axes[0][0] > 0.0);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
pub fn optimal_directions(
    normals: &[[f64; 3]],
    directions: &[[f64; 3]],
    cones: &DirectionCones,
    axes: &mut [[f64; 3]],
    status: &mut [Status],
) -> Result<()> {
    cones.solve_rows(0, normals, directions, axes, status)
}

/// Rows that one task of the pool takes: about 50 us.
const ROWS_PER_TASK: usize = 512;

/// Normalises a vector of ordinary length without the checks' cost.
#[inline]
fn quick_direction(v: &[f64; 3]) -> Option<Unit<Vector3<f64>>> {
    let v = Vector3::from(*v);
    let squared = v.norm_squared();
    (squared > 1e-6 && squared < 1e6).then(|| Unit::new_unchecked(v / squared.sqrt()))
}

/// Half-angles (rad) and weights that all rows of [`optimal_directions`] share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionCones {
    /// Half-angle around the normal, rad.
    pub beta: f64,
    /// Half-angle around the wanted direction, rad.
    pub alpha: f64,
    /// Weight of the barrier of the normal's cone.
    pub k_err: f64,
    /// Weight of the barrier of the wanted direction's cone.
    pub k_tcp: f64,
}

enum DirectionSolver {
    Closed(TwoCones),
    Newton(DirectionCones),
}

impl DirectionCones {
    /// Checks angles and weights.
    ///
    /// # Errors
    /// A half-angle outside (0, pi), a weight that is not positive and finite.
    pub fn validate(&self) -> Result<()> {
        self.solver().map(|_| ())
    }

    /// [`optimal_directions`] on a part of a longer batch, whose first row has the number `first_row` in messages.
    ///
    /// # Errors
    /// As [`optimal_directions`].
    pub fn solve_rows(
        &self,
        first_row: usize,
        normals: &[[f64; 3]],
        directions: &[[f64; 3]],
        axes: &mut [[f64; 3]],
        status: &mut [Status],
    ) -> Result<()> {
        let n = normals.len();
        for (what, length) in
            [("directions", directions.len()), ("axes", axes.len()), ("status", status.len())]
        {
            if length != n {
                return Err(Error::Length { what: what.into(), expected: n, actual: length });
            }
        }
        let solver = self.solver()?;
        let block = |(start, (out, status)): (usize, (&mut [[f64; 3]], &mut [Status]))| -> Result<()> {
            for (i, (out, status)) in out.iter_mut().zip(status).enumerate() {
                let local = start * ROWS_PER_TASK + i;
                let row = first_row + local;
                let named = |what: &str, v: &[f64; 3]| {
                    quick_direction(v).map_or_else(|| unit_direction(&format!("{what}, row {row}"), *v), Ok)
                };
                let (u, c) = (named("normals", &normals[local])?, named("directions", &directions[local])?);
                let (z, s) = solver.solve(&u, &c)?;
                *out = [z.x, z.y, z.z];
                *status = s;
            }
            Ok(())
        };
        axes.par_chunks_mut(ROWS_PER_TASK)
            .zip(status.par_chunks_mut(ROWS_PER_TASK))
            .enumerate()
            .map(block)
            .collect::<Vec<_>>()
            .into_iter()
            .collect()
    }

    fn solver(&self) -> Result<DirectionSolver> {
        check_finite("beta, alpha", &[self.beta, self.alpha])?;
        if self.beta >= FRAC_PI_2 || self.alpha >= FRAC_PI_2 {
            let z = Vector3::z_axis();
            self.optimizer(&z, &z)?;
            return Ok(DirectionSolver::Newton(*self));
        }
        TwoCones::new(self.beta, self.alpha, self.k_err, self.k_tcp).map(DirectionSolver::Closed)
    }

    fn optimizer(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> Result<OrientationOptimizer> {
        let z = [0.0, 0.0, 1.0];
        let named = |what: &str, angle: f64, d: &Unit<Vector3<f64>>| {
            Cone::new(z, [d.x, d.y, d.z], angle).map_err(|_| Error::OutOfRange {
                what: what.into(),
                value: angle,
                bound: "in (0, pi) rad".into(),
            })
        };
        let barriers = vec![
            Barrier::new(self.k_err, named("beta", self.beta, u)?)?,
            Barrier::new(self.k_tcp, named("alpha", self.alpha, c)?)?,
        ];
        OrientationOptimizer::new(barriers, OrientationSettings::default())
    }
}

impl DirectionSolver {
    #[inline]
    fn solve(&self, u: &Unit<Vector3<f64>>, c: &Unit<Vector3<f64>>) -> Result<(Unit<Vector3<f64>>, Status)> {
        match self {
            Self::Closed(cones) => {
                let best = cones.minimum(u, c);
                Ok((best.direction, best.status))
            }
            Self::Newton(cones) => {
                let best = cones.optimizer(u, c)?.solve(None);
                Ok((best.q * Vector3::z_axis(), best.status))
            }
        }
    }
}
