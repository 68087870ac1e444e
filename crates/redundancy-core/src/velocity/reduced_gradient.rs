//! Reduced gradient: some joints follow the task, the others take the gradient of the criterion reduced to them.
//!
//! With the joints split into dependent ones (a, as many as the task has coordinates) and independent ones (b), and
//! `J_R = J_a^-1 J_b` [Bettini2000, eq. (4)]:
//!
//! ```text
//! qd_b = eta_b - J_R^T eta_a = eta_b - J_b^T (J_a^-T eta_a)          qd_a = J_a^-1 (v - J_b qd_b)
//! ```
//!
//! One LU factorisation of a square matrix instead of a pseudoinverse. At equal gain it converges faster than the projected
//! gradient: `Z Z^T` with `Z = [-J_R; I]` is the projector times a scaling of 1 or more, which depends on the basis.
//!
//! # The basis
//! `J_a` has to stay regular. All bases are ranked by `1 / |J_a^-1|_F`, which bounds the least singular value of `J_a`
//! from below within a factor `sqrt(m)`. While the rank of the present one is good, nothing else is computed. When it
//! falls below a level well above the damping threshold, one candidate of the ranking is tried per step; when it
//! comes close to the threshold, all are. A change needs a candidate that is better by a factor (hysteresis), is
//! blended over some steps, during which both bases meet the task, and is reported. Damping acts only when no basis is
//! good. A basis that the caller gives is kept whatever happens.

use std::sync::Arc;

use super::damping::Damping;
use super::linear::{Lu, Svd, along, dot, times};
use super::local::{Local, by_dimension, required_dt};
use super::projected_gradient::distance;
use super::pseudo_inverse::PseudoInverse;
use super::step_size::{Gain, OptimalStep};
use super::{Resolver, StepInput, StepReport};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::kinematics::Task;
use crate::status::Status;
use crate::tolerance::{
    BASIS_GAIN, BASIS_GAIN_URGENT, BASIS_LEVEL, BASIS_URGENT, REFINED_SHARE, WELL_CONDITIONED,
};

/// Steps over which a change of basis is blended [Bettini2000, section 5].
const BLEND: usize = 3;

/// Most bases that are ranked: 5 of 11 joints. Ranking them takes a tenth of a millisecond.
const MOST_BASES: usize = 462;

/// A split of the joints; both lists ascend.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Split {
    dependent: Vec<usize>,
    independent: Vec<usize>,
}

impl Split {
    fn new(dependent: Vec<usize>, n: usize) -> Self {
        let independent = (0..n).filter(|i| !dependent.contains(i)).collect();
        Self { dependent, independent }
    }
}

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
/// let report = scheme.step(&StepInput { q: &q, velocity: &[0.0; 6], dt: None, qd: None }, &mut qd)?;
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
    inverse: PseudoInverse,
    svd: Svd,
    optimal: OptimalStep,
    eta: Vec<f64>,
    work: [Vec<f64>; 2],
}

/// Which basis is in use, and what is known of the others.
#[derive(Debug, Clone)]
struct Basis {
    splits: Vec<Split>,
    /// Bounds of the least singular values at the last full look.
    bounds: Vec<f64>,
    /// Indices of the splits from the best on, at that time.
    order: Vec<usize>,
    current: usize,
    previous: usize,
    /// Steps of the blend that are left.
    blend: usize,
    /// Place in `order` of the next candidate to try.
    next: usize,
    ranked: bool,
}

/// `J_a` at one q.
enum Minor<const M: usize> {
    /// Far from singular; the number bounds the least singular value from below.
    Regular(Lu<M>, f64),
    /// Nearly singular, and to be damped: the singular values are in the memory.
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
        let splits = match basis {
            Some(basis) => vec![Split::new(checked_basis(basis, m, n)?, n)],
            None => all_splits(m, n)?,
        };
        Ok(Self {
            local,
            gain: gain.validate()?,
            damping,
            basis: Basis {
                bounds: vec![0.0; splits.len()],
                order: (0..splits.len()).collect(),
                current: 0,
                previous: 0,
                blend: 0,
                next: 0,
                ranked: splits.len() == 1,
                splits,
            },
            inverse: PseudoInverse::new(damping, m, n),
            svd: Svd::new(m, m),
            optimal,
            eta: vec![0.0; n],
            work: [vec![0.0; n], vec![0.0; n]],
        })
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<StepReport> {
        let optimal_dt = match (self.gain, &self.local.criterion) {
            (Gain::Optimal, Some(_)) => Some(required_dt(input, "the optimal gain")?),
            _ => None,
        };
        let (minor, basis_changed) = self.choose::<M>();
        let v = self.local.velocity::<M>();
        let (mut status, mut damping) = (Status::Converged, 0.0);
        if let Minor::Values = minor {
            status = Status::Singular;
            let square = |sigma: &f64| self.damping.map_or(0.0, |d| d.square(*sigma));
            damping = self.svd.sigma().iter().map(square).fold(0.0, f64::max).sqrt();
            // For the projector that keeps the freedom off the task.
            self.inverse.find_values(self.local.columns::<M>());
        }
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
                self.eta.iter_mut().zip(&self.local.ascent).for_each(|(eta, ascent)| *eta = gain * ascent);
                self.blended(&minor, &v, qd);
            }
        }
        self.basis.blend = self.basis.blend.saturating_sub(1);
        let residual = match minor {
            Minor::Regular(..) => 0.0,
            Minor::Values => distance(&times(self.local.columns::<M>(), qd), &v),
        };
        Ok(StepReport { status, scale: 1.0, damping, basis_changed, algorithmic: false, residual })
    }

    /// The basis of this step with its factorisation, and whether it is another one than before.
    fn choose<const M: usize>(&mut self) -> (Minor<M>, bool) {
        let columns = self.local.columns::<M>();
        let basis = &mut self.basis;
        let alone = basis.splits.len() == 1;
        if !basis.ranked {
            basis.rank(columns);
            basis.ranked = true;
            basis.current = basis.order[0];
        }
        let threshold = self.damping.map_or(0.0, |d| d.threshold);
        let level = threshold.max(WELL_CONDITIONED);
        let mut lu = basis.minor(basis.current, columns);
        let mut bound = bound_of(&lu);
        let mut changed = false;
        if !alone && bound < BASIS_LEVEL * level {
            let urgent = bound < BASIS_URGENT * level;
            let candidate = if urgent {
                basis.rank(columns);
                basis.order[0]
            } else {
                basis.next = (basis.next + 1) % basis.order.len();
                basis.order[basis.next]
            };
            let wanted = if urgent { BASIS_GAIN_URGENT } else { BASIS_GAIN };
            if candidate != basis.current && (urgent || basis.blend == 0) {
                let other = basis.minor(candidate, columns);
                if bound_of(&other) > wanted * bound {
                    (basis.previous, basis.current) = (basis.current, candidate);
                    basis.blend = BLEND;
                    basis.next = 0;
                    bound = bound_of(&other);
                    lu = other;
                    changed = true;
                }
            }
        }
        let minor = match lu {
            Some(lu) if bound >= threshold => Minor::Regular(lu, bound),
            lu => {
                // The bound may be low by a factor of up to sqrt(m): the values decide.
                self.svd.decompose(basis.dependent(basis.current, columns).as_flattened(), M);
                match lu {
                    Some(lu) if self.svd.smallest() >= threshold => Minor::Regular(lu, bound),
                    _ => Minor::Values,
                }
            }
        };
        (minor, changed)
    }

    /// `out` for the wish `eta` and the task velocity `v`, mixed with that of the basis before while a change lasts.
    fn blended<const M: usize>(&mut self, minor: &Minor<M>, v: &[f64; M], out: &mut [f64]) {
        let mut work = std::mem::take(&mut self.work[0]);
        self.combine(self.basis.current, minor, v, out, &mut work);
        if self.basis.blend > 0 {
            let old = self.basis.minor(self.basis.previous, self.local.columns::<M>());
            let threshold = self.damping.map_or(0.0, |d| d.threshold);
            // The old basis helps only as long as it meets the task.
            let bound = bound_of(&old);
            if bound >= threshold.max(WELL_CONDITIONED)
                && let (Some(old), Minor::Regular(..)) = (old, minor)
            {
                let share = self.basis.blend as f64 / (BLEND + 1) as f64;
                self.combine(self.basis.previous, &Minor::Regular(old, bound), v, &mut work, &mut []);
                out.iter_mut().zip(&work).for_each(|(out, old)| *out += share * (old - *out));
            }
        }
        self.work[0] = work;
    }

    /// `out` of one basis; `work` is only needed where J_a is damped.
    fn combine<const M: usize>(
        &self,
        split: usize,
        minor: &Minor<M>,
        v: &[f64; M],
        out: &mut [f64],
        work: &mut [f64],
    ) {
        let columns = self.local.columns::<M>();
        let Split { dependent, independent } = &self.basis.splits[split];
        let eta_a: [f64; M] = std::array::from_fn(|i| self.eta[dependent[i]]);
        match minor {
            Minor::Regular(lu, bound) => {
                let y = lu.solve_transposed(&eta_a);
                let mut rest = *v;
                for j in independent {
                    let x = self.eta[*j] - along(&columns[*j], &y);
                    out[*j] = x;
                    for i in 0..M {
                        rest[i] -= columns[*j][i] * x;
                    }
                }
                for (j, x) in dependent.iter().zip(lu.solve(&rest)) {
                    out[*j] = x;
                }
                let size: f64 = dependent.iter().map(|j| dot(&columns[*j], &columns[*j])).sum();
                if bound * bound < REFINED_SHARE * size {
                    let done = times(columns, out);
                    let missing: [f64; M] = std::array::from_fn(|i| v[i] - done[i]);
                    for (j, x) in dependent.iter().zip(lu.solve(&missing)) {
                        out[*j] += x;
                    }
                }
            }
            Minor::Values => {
                let inverse = |sigma: f64| match &self.damping {
                    Some(damping) => damping.inverse(sigma),
                    None if sigma > 0.0 => sigma.recip(),
                    None => 0.0,
                };
                // The reduced gradient with the damped inverse, then what of it does not move the tool.
                let mut y = [0.0; M];
                for (sigma, left, right) in self.svd.triples() {
                    let factor = inverse(sigma) * dot(right, &eta_a);
                    y.iter_mut().zip(left).for_each(|(y, u)| *y += factor * u);
                }
                let mut rest = [0.0; M];
                for j in independent {
                    let x = self.eta[*j] - along(&columns[*j], &y);
                    work[*j] = x;
                    for i in 0..M {
                        rest[i] -= columns[*j][i] * x;
                    }
                }
                let solve = |b: &[f64; M]| {
                    let mut x = [0.0; M];
                    for (sigma, left, right) in self.svd.triples() {
                        let factor = inverse(sigma) * dot(left, b);
                        x.iter_mut().zip(right).for_each(|(x, w)| *x += factor * w);
                    }
                    x
                };
                for (j, x) in dependent.iter().zip(solve(&rest)) {
                    work[*j] = x;
                }
                self.inverse.project(work, out);
                for (j, x) in dependent.iter().zip(solve(v)) {
                    out[*j] += x;
                }
            }
        }
    }
}

impl Basis {
    fn dependent<const M: usize>(&self, split: usize, columns: &[[f64; M]]) -> [[f64; M]; M] {
        std::array::from_fn(|i| columns[self.splits[split].dependent[i]])
    }

    fn minor<const M: usize>(&self, split: usize, columns: &[[f64; M]]) -> Option<Lu<M>> {
        Lu::of_columns(&self.dependent(split, columns))
    }

    /// Ranks all bases at this q.
    fn rank<const M: usize>(&mut self, columns: &[[f64; M]]) {
        for split in 0..self.splits.len() {
            self.bounds[split] = bound_of(&self.minor(split, columns));
        }
        let bounds = &self.bounds;
        self.order.sort_unstable_by(|a, b| bounds[*b].total_cmp(&bounds[*a]).then(a.cmp(b)));
        self.next = 0;
    }
}

/// Lower bound of the least singular value; 0 of a singular matrix.
fn bound_of<const M: usize>(lu: &Option<Lu<M>>) -> f64 {
    lu.as_ref().map_or(0.0, |lu| lu.square_of_inverse().sqrt().recip())
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

/// Every choice of m out of n joints, in lexical order.
fn all_splits(m: usize, n: usize) -> Result<Vec<Split>> {
    let mut count = 1_usize;
    for i in 0..m {
        count = count.saturating_mul(n - i) / (i + 1);
    }
    if count > MOST_BASES {
        let message =
            format!("{n} joints have {count} bases for {m} coordinates, at most {MOST_BASES}: give a basis");
        return Err(Error::Invalid(message));
    }
    let mut choice: Vec<usize> = (0..m).collect();
    let mut splits = vec![Split::new(choice.clone(), n)];
    // The next choice: the last index that can grow does, those after it follow closely.
    while let Some(i) = (0..m).rev().find(|i| choice[*i] < n - m + i) {
        choice[i] += 1;
        for k in i + 1..m {
            choice[k] = choice[k - 1] + 1;
        }
        splits.push(Split::new(choice.clone(), n));
    }
    Ok(splits)
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

    fn step(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<StepReport> {
        self.local.update(input, qd)?;
        by_dimension!(self.resolve(input, qd) for self.local.task.dim())
    }

    fn basis(&self) -> &[usize] {
        if self.basis.ranked { &self.basis.splits[self.basis.current].dependent } else { &[] }
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
