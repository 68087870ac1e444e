//! Reduced gradient: some joints follow the task, the others take the gradient of the criterion reduced to them.
//!
//! With the joints split into dependent ones (a, as many as the task has coordinates) and independent ones (b), and
//! `J_R = J_a^-1 J_b` [Bettini2000, eq. (4)]:
//!
//! ```text
//! qd_b = eta_b - J_R^T eta_a = eta_b - J_b^T (J_a^-T eta_a)          qd_a = J_a^-1 (v - J_b qd_b)
//! ```
//!
//! At equal gain it converges faster than the projected gradient: `Z Z^T` with `Z = [-J_R; I]` is the projector times a
//! scaling of 1 or more, which depends on the basis. `J_a` is solved through the factors of `J_a J_a^T`, of which a bound
//! of its least singular value comes along, and through its singular values where that bound is low.
//!
//! # The basis
//! `J_a` has to stay regular. Its measure is `1 / |J_a^-1|_F`, which bounds the least singular value of `J_a` from below
//! within a factor `sqrt(m)`. While it is good, nothing else is computed. When it falls below a level well above the
//! damping threshold, the measures of all bases that differ in one joint are computed (see the module `exchange`: all of
//! them together cost less than one factorisation), again after some steps or as soon as it has fallen further. A change needs one that is better by a factor (hysteresis), a smaller
//! one when damping is near, is blended over some steps, during which both bases meet the task, and is reported. Damping
//! acts only when no basis is good. A basis that the caller gives is kept whatever happens, or changed when its schedule
//! says so.
//!
//! # As printed
//! Eq. (4) with the damped inverse in place of `J_a^-1` everywhere is [`as_printed`](ReducedGradient::as_printed): the motion of
//! the freedom then moves the tool where damping acts. It is there to repeat the paper, in its coordinates
//! ([`in_frame`](ReducedGradient::in_frame)).

use std::sync::Arc;

use super::damping::Damping;
use super::exchange::{self, Split};
use super::linear::{along, complement, distance, dot, gram, times, write_rows};
use super::local::{
    Local, at_acceleration_level, at_velocity_level, by_dimension, check_velocity_gain, required_dt,
};
use super::pseudo_inverse::NormalEquations;
use super::singular_values::Svd;
use super::step_size::{Gain, OptimalStep};
use super::{AccelerationInput, Resolver, Step, StepInput};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::kinematics::Task;
use crate::status::Status;
use crate::tolerance::{
    BASIS_FALL, BASIS_GAIN, BASIS_GAIN_URGENT, BASIS_LEVEL, BASIS_URGENT, SINGULAR_RANK, WELL_CONDITIONED,
};

/// Steps over which a change of basis is blended [Bettini2000, section 5].
const BLEND: usize = 3;

/// Steps between two looks at other bases, unless the present one has become worse in the meantime.
const REST: usize = 8;

/// Reduced gradient scheme [Bettini2000, eq. (4)].
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::JointRange, kinematics::Task};
/// use redundancy_core::velocity::{Damping, Gain, ReducedGradient, Resolver, StepInput};
/// use std::sync::Arc;
/// let arm = catalog::load("dexter")?;
/// let h = Arc::new(JointRange::new(&arm));
/// let mut scheme =
///     ReducedGradient::new(&arm, Some(h), Gain::Constant(10.0), Task::POSE_RPY, Some(Damping::default()), None)?;
/// let q = [40f64, 0.0, 90.0, 180.0, -90.0, 180.0, -90.0, 0.0].map(f64::to_radians);
/// let mut qd = [0.0; 8];
/// let report = scheme.step(&StepInput { q: &q, velocity: &[0.0; 6], dt: None, qd: None, wish: None }, &mut qd)?;
/// assert!(arm.tool_velocity(&q, &qd)?.norm() < 1e-12 && !report.basis_changed);
/// assert_eq!(scheme.basis().len(), 6);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ReducedGradient {
    local: Local,
    gain: Gain,
    damping: Option<Damping>,
    basis: Basis,
    schedule: Schedule,
    /// Eq. (4) as printed where damping acts.
    printed: bool,
    svd: Svd,
    /// Rows of J, overwritten, and an orthonormal basis of its null space, where `J_a` is nearly singular.
    rows: Vec<f64>,
    null: Vec<f64>,
    optimal: OptimalStep,
    eta: Vec<f64>,
    work: [Vec<f64>; 2],
    velocity_gain: Option<f64>,
}

/// Which basis is in use.
#[derive(Debug, Clone)]
struct Basis {
    current: Split,
    previous: Split,
    /// Where a candidate is put together.
    candidate: Split,
    /// Steps of the blend that are left.
    blend: usize,
    /// The measure at the last look at others that found none better, and the steps until the next look.
    looked: f64,
    rest: usize,
    /// The caller chose it.
    given: bool,
    chosen: bool,
}

/// Changes of the basis at given times.
#[derive(Debug, Clone)]
struct Schedule {
    /// Time, s, and the basis from then on; those from `next` on are still to come.
    changes: Vec<(f64, Split)>,
    next: usize,
    /// Sum of the steps so far, s.
    elapsed: f64,
}

/// `J_a` at one q, solved through
#[derive(Debug, Clone, Copy)]
enum Minor<const M: usize> {
    /// its normal equations, far from singular,
    Regular(NormalEquations<M>),
    /// its singular values, which are in the memory.
    Values,
}

impl ReducedGradient {
    /// `basis` lists the dependent joints, from 0, as many as the task has coordinates; without it the basis is chosen
    /// and changed as needed.
    ///
    /// # Errors
    /// As of [`ProjectedGradient::new`](super::ProjectedGradient::new); a basis with a wrong number of joints, an index
    /// beyond the last joint or used twice.
    pub fn new(
        chain: &Chain,
        criterion: Option<Arc<dyn Criterion>>,
        gain: Gain,
        task: Task,
        damping: Option<Damping>,
        basis: Option<&[usize]>,
    ) -> Result<Self> {
        if let Some(damping) = &damping {
            damping.validate()?;
        }
        let (m, n) = (task.dim(), chain.dof());
        let optimal = OptimalStep::new(criterion.as_deref(), n);
        let local = Local::new(chain, criterion, task)?;
        let first: Vec<usize> = match basis {
            Some(basis) => checked_basis(basis, m, n)?,
            None => (0..m).collect(),
        };
        let split = Split::new(first, n);
        Ok(Self {
            local,
            gain: gain.validate()?,
            damping,
            basis: Basis {
                current: split.clone(),
                previous: split.clone(),
                candidate: split,
                blend: 0,
                looked: f64::INFINITY,
                rest: 0,
                given: basis.is_some() || m == n,
                chosen: basis.is_some(),
            },
            schedule: Schedule { changes: Vec::new(), next: 0, elapsed: 0.0 },
            printed: false,
            svd: Svd::new(m, m),
            rows: vec![0.0; m * n],
            null: vec![0.0; (n - m) * n],
            optimal,
            eta: vec![0.0; n],
            work: [vec![0.0; n], vec![0.0; n]],
            velocity_gain: None,
        })
    }

    /// The scheme in the coordinates of a link's frame, see [`MiddleFrame`](crate::kinematics::MiddleFrame): damping and the
    /// choice of the basis act on that Jacobian [Bettini2000, eq. (7)]. Velocities are given as before.
    ///
    /// # Errors
    /// As [`MiddleFrame::new`](crate::kinematics::MiddleFrame::new).
    pub fn in_frame(mut self, link: usize) -> Result<Self> {
        self.local.set_frame(link)?;
        Ok(self)
    }

    /// Eq. (4) as printed: the damped inverse of `J_a` also in `J_R`, so that under damping the freedom moves the tool.
    #[must_use]
    pub fn as_printed(mut self) -> Self {
        self.printed = true;
        self
    }

    /// Other bases from given times on, s, counted from the first step; each change is blended over three steps and
    /// reported. Steps then need their length `dt`.
    ///
    /// # Errors
    /// No basis given at the start, a basis that is none, times that are negative, not finite or do not ascend.
    pub fn with_schedule(mut self, changes: &[(f64, &[usize])]) -> Result<Self> {
        if !self.basis.given && !changes.is_empty() {
            return Err(Error::Invalid(
                "schedule: it needs the basis of the start, give `basis` as well".into(),
            ));
        }
        let (m, n) = (self.local.task.dim(), self.local.chain.dof());
        let mut before = 0.0;
        for (time, basis) in changes {
            if !(time.is_finite() && *time >= before) {
                let bound = format!("finite and >= {before} s");
                return Err(Error::OutOfRange { what: "time of the schedule".into(), value: *time, bound });
            }
            before = *time;
            self.schedule.changes.push((*time, Split::new(checked_basis(basis, m, n)?, n)));
        }
        Ok(self)
    }

    /// The scheme at acceleration level: the independent joints accelerate by `velocity_gain` times what they lack of the
    /// reduced gradient, `qdd_b = velocity_gain (eta_b - J_R^T eta_a - qd_b)`, and the dependent ones meet
    /// `J qdd = a - Jdot qd`. A change of basis changes the acceleration at once and the joint velocity at that rate, so
    /// nothing has to be blended.
    ///
    /// # Errors
    /// A rate that is not positive or not finite, the optimal gain.
    pub fn at_acceleration_level(mut self, velocity_gain: f64) -> Result<Self> {
        check_velocity_gain(velocity_gain, self.gain)?;
        self.velocity_gain = Some(velocity_gain);
        Ok(self)
    }

    fn resolve_acceleration<const M: usize>(
        &mut self,
        input: &AccelerationInput<'_>,
        rate: f64,
        qdd: &mut [f64],
    ) -> Result<Step> {
        let Gain::Constant(gain) = self.gain else {
            return Err(Error::Invalid("the optimal gain has no acceleration level".into()));
        };
        let scheduled = self.keep_to_schedule(input.dt)?;
        let (minor, chosen) = self.choose::<M>();
        self.basis.blend = 0;
        let b = self.local.velocity::<M>();
        let (status, damping) = self.losses::<M>(&minor);
        // The joint velocity of the velocity level for the same motion of the task.
        let v = times(self.local.columns::<M>(), input.qd);
        self.local.write_desired(gain, input.wish, &mut self.eta);
        let mut wanted = std::mem::take(&mut self.work[1]);
        self.blended(&minor, &v, &mut wanted);
        self.eta.fill(0.0);
        self.blended(&minor, &b, qdd);
        for ((qdd, wanted), qd) in qdd.iter_mut().zip(&wanted).zip(input.qd) {
            *qdd += rate * (wanted - qd);
        }
        self.work[1] = wanted;
        let residual = match minor {
            Minor::Regular(..) => 0.0,
            Minor::Values => distance(&times(self.local.columns::<M>(), qdd), &b),
        };
        let basis_changed = scheduled || chosen;
        Ok(Step { status, scale: 1.0, damping, basis_changed, algorithmic: false, residual })
    }

    /// Status and largest damping factor of what solves `J_a`; where damping acts the null space of J is found.
    fn losses<const M: usize>(&mut self, minor: &Minor<M>) -> (Status, f64) {
        let (mut status, mut damping) = (Status::Converged, 0.0);
        if let Minor::Values = minor {
            let square = |sigma: &f64| self.damping.map_or(0.0, |d| d.square(*sigma));
            damping = self.svd.sigma().iter().map(square).fold(0.0, f64::max).sqrt();
            if damping > 0.0 || self.svd.smallest() <= self.zero() {
                status = Status::Singular;
            }
            if !self.printed {
                self.find_null_space::<M>();
            }
        }
        (status, damping)
    }

    /// Takes the basis that is due; whether one was.
    fn keep_to_schedule(&mut self, dt: Option<f64>) -> Result<bool> {
        let Self { schedule, basis, .. } = self;
        if schedule.changes.is_empty() {
            return Ok(false);
        }
        let dt = dt.ok_or_else(|| {
            Error::Invalid("dt is missing: the schedule needs the length of the step".into())
        })?;
        let mut changed = false;
        // Times that are meant to fall on a step are met by the sum of its steps only up to rounding.
        while let Some((_, next)) =
            schedule.changes.get(schedule.next).filter(|(time, _)| schedule.elapsed >= time - 0.5 * dt)
        {
            std::mem::swap(&mut basis.previous, &mut basis.current);
            basis.current.clone_from(next);
            (basis.blend, schedule.next, changed) = (BLEND, schedule.next + 1, true);
        }
        schedule.elapsed += dt;
        Ok(changed)
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        let optimal_dt = match (self.gain, &self.local.criterion) {
            (Gain::Optimal, Some(_)) if input.wish.is_none() => Some(required_dt(input, "the optimal gain")?),
            _ => None,
        };
        let scheduled = self.keep_to_schedule(input.dt)?;
        let (minor, chosen) = self.choose::<M>();
        let basis_changed = scheduled || chosen;
        let v = self.local.velocity::<M>();
        let (mut status, damping) = self.losses::<M>(&minor);
        match (optimal_dt, self.gain) {
            (Some(dt), _) => {
                self.eta.fill(0.0);
                self.blended(&minor, &v, qd);
                self.eta.copy_from_slice(&self.local.ascent);
                let mut freedom = std::mem::take(&mut self.work[1]);
                self.blended(&minor, &[0.0; M], &mut freedom);
                if let Some(h) = &self.local.criterion
                    && !self.optimal.apply(&**h, &self.local.chain, input.q, dt, &freedom, qd)
                {
                    status = Status::Limits;
                }
                self.work[1] = freedom;
            }
            (None, gain) => {
                let gain = if let Gain::Constant(gain) = gain { gain } else { 0.0 };
                self.local.write_desired(gain, input.wish, &mut self.eta);
                self.blended(&minor, &v, qd);
            }
        }
        self.basis.blend = self.basis.blend.saturating_sub(1);
        let residual = match minor {
            Minor::Regular(..) => 0.0,
            Minor::Values => distance(&times(self.local.columns::<M>(), qd), &v),
        };
        Ok(Step { status, scale: 1.0, damping, basis_changed, algorithmic: false, residual })
    }

    /// The basis of this step with what solves it, and whether it is another one than before.
    fn choose<const M: usize>(&mut self) -> (Minor<M>, bool) {
        let columns = self.local.columns::<M>();
        let basis = &mut self.basis;
        if !basis.chosen {
            exchange::choose(columns, &mut self.rows, &mut basis.current);
            basis.chosen = true;
        }
        let threshold = threshold_of(&self.damping);
        let level = threshold.max(WELL_CONDITIONED);
        let mut equations = equations_of(&basis.current, columns);
        let mut bound = bound_of(&equations);
        let mut changed = false;
        let urgent = bound < BASIS_URGENT * level;
        basis.rest = basis.rest.saturating_sub(1);
        // Where damping would act there is no waiting, and more than one joint may change.
        let due = bound < level || basis.rest == 0 || bound < BASIS_FALL * basis.looked;
        if !basis.given && due && bound < BASIS_LEVEL * level && (urgent || basis.blend == 0) {
            (basis.looked, basis.rest) = (bound, REST);
            basis.candidate.clone_from(&basis.current);
            match &equations {
                Some(equations) if bound >= level => {
                    if let Some(pair) = exchange::best(columns, &basis.current, equations) {
                        basis.candidate.exchange(pair);
                    }
                }
                Some(_) => exchange::improve(columns, &mut basis.candidate),
                None => exchange::choose(columns, &mut self.rows, &mut basis.candidate),
            }
            if basis.candidate != basis.current {
                let other = equations_of(&basis.candidate, columns);
                let wanted = if urgent { BASIS_GAIN_URGENT } else { BASIS_GAIN };
                if bound_of(&other) > wanted * bound {
                    std::mem::swap(&mut basis.previous, &mut basis.current);
                    std::mem::swap(&mut basis.current, &mut basis.candidate);
                    (basis.blend, basis.looked, basis.rest) = (BLEND, f64::INFINITY, 0);
                    bound = bound_of(&other);
                    equations = other;
                    changed = true;
                }
            }
        }
        let minor = match equations {
            Some(equations) if bound >= level => Minor::Regular(equations),
            equations => {
                // The bound may be low by a factor of up to sqrt(m): the values decide.
                self.svd.decompose(self.basis.current.dependent_of(columns).as_flattened(), M);
                match equations {
                    Some(equations) if bound >= WELL_CONDITIONED && self.svd.smallest() >= threshold => {
                        Minor::Regular(equations)
                    }
                    _ => Minor::Values,
                }
            }
        };
        (minor, changed)
    }

    /// The singular value of `J_a` up to which it counts as zero.
    fn zero(&self) -> f64 {
        SINGULAR_RANK * self.svd.sigma().iter().copied().fold(0.0, f64::max)
    }

    /// Finds the null space of J, which keeps the freedom off the task however `J_a` is damped.
    fn find_null_space<const M: usize>(&mut self) {
        let columns = self.local.columns::<M>();
        write_rows(columns, &mut self.rows);
        complement(&mut self.rows, columns.len(), M, &mut self.null);
    }

    /// `out` for the desired velocity `eta` and the task velocity `v`, mixed with that of the basis before while a change lasts.
    fn blended<const M: usize>(&mut self, minor: &Minor<M>, v: &[f64; M], out: &mut [f64]) {
        let mut work = std::mem::take(&mut self.work[0]);
        self.combine(&self.basis.current, minor, v, out, &mut work);
        if self.basis.blend > 0 {
            // The old basis helps only as long as it meets the task.
            let level = threshold_of(&self.damping).max(WELL_CONDITIONED);
            if let Some(old) = equations_of(&self.basis.previous, self.local.columns::<M>())
                && old.bound() >= level
                && let Minor::Regular(_) = minor
            {
                let share = self.basis.blend as f64 / (BLEND + 1) as f64;
                self.combine(&self.basis.previous, &Minor::Regular(old), v, &mut work, &mut []);
                out.iter_mut().zip(&work).for_each(|(out, old)| *out += share * (old - *out));
            }
        }
        self.work[0] = work;
    }

    /// `out` of one basis; `work` is only needed where J_a is nearly singular.
    #[inline(always)]
    fn combine<const M: usize>(
        &self,
        split: &Split,
        minor: &Minor<M>,
        v: &[f64; M],
        out: &mut [f64],
        work: &mut [f64],
    ) {
        let columns = self.local.columns::<M>();
        let dependent = split.dependent_of(columns);
        let eta_a: [f64; M] = std::array::from_fn(|i| self.eta[split.dependent()[i]]);
        // The independent joints of `out` for J_a^-T eta_a, and what they leave of v.
        let reduce = |y: &[f64; M], mut rest: [f64; M], out: &mut [f64]| {
            for j in split.independent() {
                let x = self.eta[*j] - along(&columns[*j], y);
                out[*j] = x;
                for i in 0..M {
                    rest[i] -= columns[*j][i] * x;
                }
            }
            rest
        };
        let follow = |x: [f64; M], out: &mut [f64]| {
            split.dependent().iter().zip(x).for_each(|(j, x)| out[*j] = x);
        };
        match minor {
            Minor::Regular(equations) => {
                let rest = reduce(&equations.solve(&times(&dependent, &eta_a)), *v, out);
                let mut x = [0.0; M];
                equations.meet(&dependent, &rest, &mut x);
                follow(x, out);
            }
            Minor::Values => {
                let zero = self.zero();
                let inverse = |sigma: f64| match &self.damping {
                    Some(damping) => damping.inverse(sigma),
                    None if sigma > zero => sigma.recip(),
                    None => 0.0,
                };
                // The reduced gradient with the damped inverse, then what of it does not move the tool.
                let mut y = [0.0; M];
                for (sigma, left, right) in self.svd.triples() {
                    let factor = inverse(sigma) * dot(right, &eta_a);
                    y.iter_mut().zip(left).for_each(|(y, u)| *y += factor * u);
                }
                let solve = |b: &[f64; M]| {
                    let mut x = [0.0; M];
                    for (sigma, left, right) in self.svd.triples() {
                        let factor = inverse(sigma) * dot(left, b);
                        x.iter_mut().zip(right).for_each(|(x, w)| *x += factor * w);
                    }
                    x
                };
                if self.printed {
                    let rest = reduce(&y, *v, out);
                    follow(solve(&rest), out);
                    return;
                }
                let rest = reduce(&y, [0.0; M], work);
                follow(solve(&rest), work);
                out.fill(0.0);
                for axis in self.null.chunks_exact(columns.len()) {
                    let part = dot(axis, work);
                    out.iter_mut().zip(axis).for_each(|(out, z)| *out += part * z);
                }
                for (j, x) in split.dependent().iter().zip(solve(v)) {
                    out[*j] += x;
                }
            }
        }
    }
}

/// The singular value of `J_a` below which it is damped.
fn threshold_of(damping: &Option<Damping>) -> f64 {
    damping.map_or(0.0, |d| d.threshold)
}

/// What solves `J_a`, if it is regular.
#[inline(always)]
fn equations_of<const M: usize>(split: &Split, columns: &[[f64; M]]) -> Option<NormalEquations<M>> {
    NormalEquations::new(gram(&split.dependent_of(columns)))
}

/// Lower bound of the least singular value; 0 of a singular matrix.
fn bound_of<const M: usize>(equations: &Option<NormalEquations<M>>) -> f64 {
    equations.as_ref().map_or(0.0, NormalEquations::bound)
}

/// The dependent joints in ascending order.
fn checked_basis(basis: &[usize], m: usize, n: usize) -> Result<Vec<usize>> {
    if basis.len() != m {
        return Err(Error::Length { what: "basis".into(), expected: m, actual: basis.len() });
    }
    let mut sorted = basis.to_vec();
    sorted.sort_unstable();
    for (i, joint) in sorted.iter().enumerate() {
        if *joint >= n {
            let bound = format!("< {n}");
            return Err(Error::OutOfRange { what: "joint of the basis".into(), value: *joint as f64, bound });
        }
        if i > 0 && sorted[i - 1] == *joint {
            return Err(Error::Invalid(format!("joint {joint} is twice in the basis")));
        }
    }
    Ok(sorted)
}

impl Resolver for ReducedGradient {
    fn name(&self) -> &'static str {
        "reduced_gradient"
    }

    fn chain(&self) -> &Chain {
        &self.local.chain
    }

    fn task(&self) -> &Task {
        &self.local.task
    }

    fn frame(&self) -> Option<usize> {
        self.local.frame.map(|frame| frame.link())
    }

    fn step(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        if self.velocity_gain.is_some() {
            return Err(at_acceleration_level(self.name()));
        }
        self.local.update(input, qd)?;
        by_dimension!(self.resolve(input, qd) for self.local.task.dim())
    }

    fn step_acceleration(&mut self, input: &AccelerationInput<'_>, qdd: &mut [f64]) -> Result<Step> {
        let rate = self.velocity_gain.ok_or_else(|| at_velocity_level(self.name()))?;
        self.local.update_acceleration(input, qdd)?;
        by_dimension!(self.resolve_acceleration(input, rate, qdd) for self.local.task.dim())
    }

    fn velocity_gain(&self) -> Option<f64> {
        self.velocity_gain
    }

    fn basis(&self) -> &[usize] {
        if self.basis.chosen { self.basis.current.dependent() } else { &[] }
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
