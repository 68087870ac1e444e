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

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};

use crate::error::{Error, Result};
use crate::rotation::barrier::{self, Barrier};
use crate::rotation::cone::{Constraint, Spin, unpack};
use crate::rotation::newton::{Descent, Newton};
use crate::rotation::quaternion::{compose, half_turn, nearest_sign, shortest_arc, swing_twist};
use crate::rotation::start::{self, Start};
use crate::rotation::structure::{
    SecondCone, Structure, Symmetry, base_of, structure_of, symmetry_of, wide_middles, without_twist,
};
use crate::status::Status;
use crate::tolerance::{ORIENTATION_STEP, SAME_VALUE, WEIGHT_RATIO};

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
    /// [`GRADIENT_STATIONARY`](crate::tolerance::GRADIENT_STATIONARY) for the gradient method.
    pub tolerance: Option<f64>,
    /// Most iterations. `None`: 200 for Newton, 10 000 for the gradient method.
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
    pub(super) barriers: Vec<Barrier>,
    pub(super) settings: OrientationSettings,
    method: OrientationMethod,
    pub(super) structure: Structure,
    pub(super) symmetry: Symmetry,
    /// Least weight.
    least: f64,
    /// Sum of the barriers' curvatures on their axes, 1/rad^2.
    pub(super) curvature: f64,
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
            QuickStart::One(q) => {
                if let Some(solution) = self.iterate(q, q0) {
                    return solution;
                }
            }
            QuickStart::Two(a, b) => {
                if let (Some(a), Some(b)) = (self.iterate(a, q0), self.iterate(b, q0)) {
                    return if b.value < a.value { b } else { a };
                }
            }
            QuickStart::Outside(q, miss_angle) => return self.infeasible(q, miss_angle, 0),
            QuickStart::Unknown => {}
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
                    Some(SecondCone { direction, cones: Some(cones), .. }) => {
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
    fn quick_start(&self, q0: Option<&UnitQuaternion<f64>>) -> QuickStart {
        let Structure::Axis { axis, first, second, spin } = &self.structure else {
            return QuickStart::Unknown;
        };
        let place = |z: &Unit<Vector3<f64>>| self.with_axis(axis, z, spin.as_ref(), q0);
        match second {
            None => QuickStart::One(place(first)),
            Some(SecondCone { direction, cones: Some(cones), .. }) => {
                let guess = cones.guess(first, direction);
                let q = place(&guess.direction);
                if guess.status == Status::Infeasible {
                    return QuickStart::Outside(q, guess.miss_angle);
                }
                QuickStart::One(q)
            }
            Some(SecondCone { direction, half_angles, .. }) => {
                match wide_middles(first, direction, *half_angles) {
                    [Some(a), Some(b)] => QuickStart::Two(place(&a), place(&b)),
                    [Some(a), None] | [None, Some(a)] => QuickStart::One(place(&a)),
                    [None, None] => QuickStart::Unknown,
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
                self.newton().descend(start, self.newton_tolerance(), self.newton_limit())
            }
        }?;
        Some(self.finish(self.canonical(q, q0), status, iterations))
    }

    fn newton(&self) -> Newton<'_> {
        Newton { barriers: &self.barriers, symmetry: &self.symmetry, least: self.least }
    }

    fn newton_tolerance(&self) -> f64 {
        self.settings.tolerance.unwrap_or(ORIENTATION_STEP)
    }

    fn newton_limit(&self) -> u32 {
        self.settings.max_iterations.unwrap_or(NEWTON_ITERATIONS)
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

    /// Newton for two cones below 90 degrees on one body axis, with or without a spin about it: on the sphere of the axis.
    /// The spin's term depends on the twist alone and is least without one, as in the closed form.
    fn newton_on_axis(
        &self,
        start: &UnitQuaternion<f64>,
        q0: Option<&UnitQuaternion<f64>>,
    ) -> Option<Descent> {
        let Structure::Axis { axis, second: Some(SecondCone { cones: Some(_), .. }), spin, .. } =
            &self.structure
        else {
            return None;
        };
        let (tolerance, limit) = (self.newton_tolerance(), self.newton_limit());
        let (z, status, iterations) = self.two_pulls()?.newton(&(start * axis), tolerance, limit)?;
        Some((self.with_axis(axis, &z, spin.as_ref(), q0), status, iterations))
    }
}

/// Most iterations of Newton's method unless the settings say otherwise.
const NEWTON_ITERATIONS: u32 = 200;

/// What [`OrientationOptimizer::quick_start`] gives.
enum QuickStart {
    One(UnitQuaternion<f64>),
    Two(UnitQuaternion<f64>, UnitQuaternion<f64>),
    /// The cones miss each other: the least bad orientation and the angle.
    Outside(UnitQuaternion<f64>, f64),
    Unknown,
}
