//! Hard limits: the task is scaled only if necessary; the freedom is used for the limits first, then for the criterion.
//!
//! The optimal form of saturation in the null space [Flacco2015, section V]: find the largest `s` in [0, 1] for which some
//! joint velocity has `J qd = s v` within its bounds, and among those the one nearest to the desired velocity `eta`. The iterative
//! schemes of [Flacco2012] reach it often, but not always; here both problems are solved exactly, see the module
//! `box_projection`.
//!
//! The bounds are those of the module `bounds`.
//!
//! With surroundings ([`SaturatedNullspace::with_contacts`]) every near pair bounds the joint velocity too, by a row of the same
//! problem; see the module `contact`. Where the rows exclude each other position comes first, then contact, velocity and
//! acceleration: the joint velocity is then the one nearest to what the limits alone allow.

use std::sync::Arc;

use super::bounds::Bounds;
use super::box_projection::{BoxProjection, Rows};
use super::contact::{ContactSettings, Contacts, LimitingPair, MOST_PAIRS};
use super::damping::Damping;
use super::hierarchy::Hierarchy;
use super::linear::{complement, distance, dot, times, write_rows};
use super::local::{Local, by_dimension, required_dt};
use super::pseudo_inverse::{Factor, PseudoInverse};
use super::step_size::Gain;
use super::{ActiveLimit, Resolver, Step, StepInput};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::kinematics::Task;
use crate::scene::{Proximity, Surroundings};
use crate::status::Status;
use crate::tolerance::{BLOCKED_SCALE, UNREACHABLE_VELOCITY};

/// Saturation in the null space: hard position, velocity and acceleration limits [Flacco2015, section V].
///
/// ```
/// use redundancy_core::{chain::catalog, kinematics::Task};
/// use redundancy_core::velocity::{Gain, Resolver, SaturatedNullspace, StepInput};
/// let arm = catalog::load("iiwa14")?;
/// let mut scheme = SaturatedNullspace::new(&arm, None, Gain::Constant(1.0), Task::POSE, None)?;
/// let q = [0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4];
/// let mut qd = [0.0; 7];
/// let fast = [5.0, 0.0, 0.0, 0.0, 0.0, 0.0];
/// let report = scheme.step(&StepInput { q: &q, velocity: &fast, dt: Some(0.01), qd: None, wish: None }, &mut qd)?;
/// assert!(report.scale < 1.0 && !scheme.active_limits().is_empty());
/// let v = arm.tool_velocity(&q, &qd)?;
/// assert!((v[0] - 5.0 * report.scale).abs() < 1e-12 && v[1].abs() < 1e-12); // slower, but not aside
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SaturatedNullspace {
    local: Local,
    gain: f64,
    inverse: PseudoInverse,
    bounds: Bounds,
    projection: BoxProjection,
    active: Vec<ActiveLimit>,
    eta: Vec<f64>,
    /// `J^+ v`.
    particular: Vec<f64>,
    /// Rows that span what moves the tool, then scratch.
    rows: Vec<f64>,
    /// Null space, a row of n for each degree of redundancy; then the same by joint.
    basis: Vec<f64>,
    by_joint: Vec<f64>,
    wish: Vec<f64>,
    limited: RowMemory,
    when_blocked: WhenBlocked,
    hierarchy: Hierarchy,
}

/// What becomes of a task whose velocity no scale above zero realises within the limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhenBlocked {
    /// The scale is zero: the tool stops, unless a joint has to brake.
    #[default]
    Stop,
    /// The tool moves as nearly to the task velocity as the limits allow: the least `|J qd - v|`.
    Closest,
}

impl WhenBlocked {
    /// The choice as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Closest => "closest",
        }
    }

    /// The choice with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        [Self::Stop, Self::Closest].into_iter().find(|choice| choice.as_str() == name).ok_or_else(|| {
            let valid = vec!["stop".into(), "closest".into()];
            Error::UnknownName { kind: "when_blocked", name: name.into(), valid }
        })
    }
}

/// Rows of the joints and of the pairs: bounds, and what one unit of scale takes.
#[derive(Debug, Clone)]
struct RowMemory {
    contacts: Option<Contacts>,
    low: Vec<f64>,
    high: Vec<f64>,
    taken: Vec<f64>,
    /// Rows over the joints themselves, where no scale is left.
    whole: Vec<f64>,
}

impl SaturatedNullspace {
    /// Without damping the task is scaled by what its exact inverse asks for, also near singularities.
    ///
    /// # Errors
    /// As of [`ProjectedGradient::new`](super::ProjectedGradient::new), and the optimal gain, which has limits of its own.
    pub fn new(
        chain: &Chain,
        criterion: Option<Arc<dyn Criterion>>,
        gain: Gain,
        task: Task,
        damping: Option<Damping>,
    ) -> Result<Self> {
        if let Some(damping) = &damping {
            damping.validate()?;
        }
        let n = chain.dof();
        let Gain::Constant(gain) = gain.validate()? else {
            return Err(Error::Invalid("SaturatedNullspace needs a constant gain, not 'optimal'".into()));
        };
        Ok(Self {
            local: Local::new(chain, criterion, task)?,
            gain,
            inverse: PseudoInverse::new(damping, task.dim(), n),
            bounds: Bounds::new(n),
            projection: BoxProjection::new(n),
            active: Vec::with_capacity(2 * n),
            eta: vec![0.0; n],
            particular: vec![0.0; n],
            rows: vec![0.0; n * n],
            basis: vec![0.0; n * n],
            by_joint: vec![0.0; n * (n + MOST_PAIRS)],
            wish: Vec::with_capacity(n),
            limited: RowMemory {
                contacts: None,
                low: Vec::with_capacity(n + MOST_PAIRS),
                high: Vec::with_capacity(n + MOST_PAIRS),
                taken: Vec::with_capacity(n + MOST_PAIRS),
                whole: Vec::with_capacity(n * (n + MOST_PAIRS)),
            },
            when_blocked: WhenBlocked::Stop,
            hierarchy: Hierarchy::new(n, MOST_PAIRS),
        })
    }

    /// What becomes of a task that is blocked.
    #[must_use]
    pub fn when_blocked(mut self, choice: WhenBlocked) -> Self {
        self.when_blocked = choice;
        self
    }

    /// The same scheme that keeps its distance from obstacles, and links from each other.
    ///
    /// # Errors
    /// Surroundings of another arm, invalid settings.
    pub fn with_contacts(mut self, around: Surroundings, settings: ContactSettings) -> Result<Self> {
        settings.validate()?;
        if around.chain() != &self.local.chain {
            let (other, own) = (around.chain().name(), self.local.chain.name());
            return Err(Error::Invalid(format!("the surroundings are those of '{other}', not of '{own}'")));
        }
        let n = self.local.chain.dof();
        self.limited.contacts = Some(Contacts::new(around, settings, n, 0.0));
        Ok(self)
    }

    fn resolve<const M: usize>(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        let dt = required_dt(input, "the saturated scheme")?;
        self.bounds.update(&self.local.chain, input.q, input.qd, dt);
        if let Some(contacts) = &mut self.limited.contacts {
            contacts.update(&self.local.chain, &self.local.kinematics(), dt);
        }
        self.active.clear();
        self.active.extend_from_slice(&self.bounds.outside);
        let columns = self.local.columns::<M>();
        let v = self.local.velocity::<M>();
        let factor = self.inverse.factor(columns);
        let loss = self.inverse.loss(&factor);
        self.local.write_desired(self.gain, input.wish, &mut self.eta);

        let mut report = Step {
            status: if loss.any() { Status::Singular } else { Status::Converged },
            scale: 1.0,
            damping: loss.damping,
            basis_changed: false,
            algorithmic: false,
            residual: 0.0,
        };
        self.inverse.solve(&factor, columns, &self.eta, &v, qd);
        if loss.any() {
            report.residual = distance(&times(columns, qd), &v);
        }
        // A direction that the arm has lost cannot be followed at any scale but 0; damping gives it up instead.
        let lost = loss.rank_lost
            && loss.damping == 0.0
            && report.residual > UNREACHABLE_VELOCITY * (1.0 + dot(&v, &v).sqrt());
        let kept = self.limited.contacts.as_ref().is_none_or(|contacts| contacts.contain(qd));
        if !lost && kept && self.bounds.contain(qd) {
            if !self.active.is_empty() {
                report.status = Status::Limits;
            }
            return Ok(report);
        }

        let r = self.split_freedom::<M>(&factor, &v, lost);
        self.limited::<M>(r, &v, lost, loss.any(), qd, &mut report);
        Ok(report)
    }

    /// The null space with the desired velocity in it, and the least joint velocity of the task; returns the degrees of redundancy.
    #[inline(always)]
    fn split_freedom<const M: usize>(&mut self, factor: &Factor<M>, v: &[f64; M], lost: bool) -> usize {
        let (n, columns) = (self.local.chain.dof(), self.local.columns::<M>());
        let rank = match factor {
            Factor::Regular(_) => {
                write_rows(columns, &mut self.rows);
                M
            }
            Factor::Values => self.inverse.row_space(&mut self.rows),
        };
        let r = n - rank;
        complement(&mut self.rows[..rank * n], n, rank, &mut self.basis[..r * n]);
        self.wish.clear();
        for (k, row) in self.basis[..r * n].chunks_exact(n).enumerate() {
            self.wish.push(dot(row, &self.eta));
            for (j, x) in row.iter().enumerate() {
                self.by_joint[j * r + k] = *x;
            }
        }
        self.particular.fill(0.0);
        if !lost {
            self.eta.fill(0.0);
            self.inverse.solve(factor, columns, &self.eta, v, &mut self.particular);
        }
        self.limited.fill(&self.bounds, &self.particular, &self.basis[..r * n], &mut self.by_joint);
        r
    }

    /// The largest scale of the task that the bounds allow, and the joint velocity closest to the desired one at that scale.
    #[inline(always)]
    fn limited<const M: usize>(
        &mut self,
        r: usize,
        v: &[f64; M],
        lost: bool,
        loses: bool,
        qd: &mut [f64],
        report: &mut Step,
    ) {
        let n = self.local.chain.dof();
        let rows = Rows {
            n: &self.by_joint[..self.limited.low.len() * r],
            r,
            stride: r,
            low: &self.limited.low,
            high: &self.limited.high,
            p: &self.limited.taken,
        };
        let solved = self.projection.solve(&rows, &self.wish);
        if self.when_blocked == WhenBlocked::Closest
            && (lost || solved.is_none_or(|s| s < BLOCKED_SCALE))
            && self.closest::<M>(v, qd, report)
        {
            return;
        }
        let columns = self.local.columns::<M>();
        report.scale = if lost { 0.0 } else { solved.unwrap_or(0.0) };
        match solved {
            Some(s) => {
                for (i, qd) in qd.iter_mut().enumerate() {
                    let free = dot(&self.by_joint[i * r..(i + 1) * r], &self.projection.z);
                    *qd = (s * self.particular[i] + free).clamp(self.bounds.low[i], self.bounds.high[i]);
                }
                for (joint, upper) in self.projection.active() {
                    if let Some(pair) = joint.checked_sub(n) {
                        if let Some(contacts) = &mut self.limited.contacts {
                            contacts.note(pair);
                        }
                        continue;
                    }
                    let limit =
                        ActiveLimit { joint, kind: self.bounds.kinds[joint][usize::from(upper)], upper };
                    if !self.active.contains(&limit) {
                        self.active.push(limit);
                    }
                }
                if report.status == Status::Converged && (s < 1.0 || !self.bounds.outside.is_empty()) {
                    report.status = Status::Limits;
                }
                if loses {
                    report.residual = distance(&times(columns, qd), &v.map(|v| report.scale * v));
                }
            }
            None => {
                self.bounds.approach(columns, v, qd);
                self.limited.yield_to_contacts(&self.bounds, &mut self.projection, qd);
                self.bounds.report(qd, &mut self.active);
                report.status = Status::Limits;
                report.residual = distance(&times(columns, qd), v);
            }
        }
    }
}

impl SaturatedNullspace {
    /// The least error of the task within the bounds, then the joint velocity closest to the desired one; false where the
    /// bounds exclude each other.
    fn closest<const M: usize>(&mut self, v: &[f64; M], qd: &mut [f64], report: &mut Step) -> bool {
        let n = self.local.chain.dof();
        // `eta` is overwritten; the null space, what moves the tool left out, keeps all of it that counts.
        let wish = &mut self.eta;
        wish.fill(0.0);
        for (part, axis) in self.wish.iter().zip(self.basis.chunks_exact(n)) {
            wish.iter_mut().zip(axis).for_each(|(wish, axis)| *wish += part * axis);
        }
        let hierarchy = &mut self.hierarchy;
        hierarchy.begin(&self.bounds.low, &self.bounds.high, wish);
        if let Some(contacts) = &self.limited.contacts {
            for (gradient, low) in contacts.gradients.chunks_exact(n).zip(&contacts.low) {
                hierarchy.add_row(gradient, *low);
            }
        }
        if !hierarchy.settle() {
            return false;
        }
        hierarchy.prepare(&self.local.jacobian, v);
        hierarchy.approach();
        hierarchy.finish(qd);
        for (i, qd) in qd.iter_mut().enumerate() {
            *qd = qd.clamp(self.bounds.low[i], self.bounds.high[i]);
        }
        if let Some(contacts) = &mut self.limited.contacts {
            contacts.note_active(qd);
        }
        self.bounds.report(qd, &mut self.active);
        report.scale = 0.0;
        report.status = Status::Limits;
        report.residual = distance(&times(self.local.columns::<M>(), qd), v);
        true
    }
}

impl RowMemory {
    /// Rows of the joints and the pairs over the null space: `by_joint` has those of the joints, and gets those of the pairs.
    fn fill(&mut self, bounds: &Bounds, particular: &[f64], basis: &[f64], by_joint: &mut [f64]) {
        let n = particular.len();
        let r = basis.len() / n;
        for (row, values) in [
            (&mut self.low, &bounds.low[..]),
            (&mut self.high, &bounds.high[..]),
            (&mut self.taken, particular),
        ] {
            row.clear();
            row.extend_from_slice(values);
        }
        let Some(contacts) = &self.contacts else { return };
        for (k, low) in contacts.low.iter().enumerate() {
            let gradient = &contacts.gradients[k * n..(k + 1) * n];
            for (i, row) in basis.chunks_exact(n).enumerate() {
                by_joint[(n + k) * r + i] = dot(row, gradient);
            }
            self.low.push(*low);
            self.high.push(f64::INFINITY);
            self.taken.push(dot(gradient, particular));
        }
    }

    /// The joint velocity nearest to `qd` that keeps the pairs' bounds and as many of the joints' as there is room for: all,
    /// else without acceleration, else without velocity; of pairs that position excludes the nearest are kept.
    fn yield_to_contacts(&mut self, bounds: &Bounds, projection: &mut BoxProjection, qd: &mut [f64]) {
        let n = qd.len();
        let Self { contacts, low, high, taken, whole } = self;
        let Some(contacts) = contacts else { return };
        if contacts.contain(qd) {
            return;
        }
        whole.clear();
        whole.resize(n * n, 0.0);
        (0..n).for_each(|i| whole[i * n + i] = 1.0);
        whole.extend_from_slice(&contacts.gradients);
        taken.clear();
        taken.resize(n + contacts.low.len(), 0.0);
        let all = contacts.low.len();
        let tries = [(2, all), (1, all)].into_iter().chain((0..=all).rev().map(|count| (0, count)));
        for (stage, count) in tries {
            low.clear();
            high.clear();
            for i in 0..n {
                let (least, most) = match bounds.wider.get(stage) {
                    Some(bounds) => bounds[i],
                    None => (bounds.low[i], bounds.high[i]),
                };
                low.push(least);
                high.push(most);
            }
            low.extend_from_slice(&contacts.low[..count]);
            high.resize(n + count, f64::INFINITY);
            let rows = Rows { n: whole, r: n, stride: n, low, high, p: &taken[..n + count] };
            if projection.solve(&rows, qd).is_none() {
                continue;
            }
            for (i, qd) in qd.iter_mut().enumerate() {
                *qd = projection.z[i].clamp(low[i], high[i]);
            }
            for (row, _) in projection.active() {
                if let Some(pair) = row.checked_sub(n) {
                    contacts.note(pair);
                }
            }
            // Those that had to be given up.
            (count..all).for_each(|pair| contacts.note(pair));
            return;
        }
    }
}

impl Resolver for SaturatedNullspace {
    fn name(&self) -> &'static str {
        "saturated_nullspace"
    }

    fn chain(&self) -> &Chain {
        &self.local.chain
    }

    fn task(&self) -> &Task {
        &self.local.task
    }

    fn step(&mut self, input: &StepInput<'_>, qd: &mut [f64]) -> Result<Step> {
        self.local.update(input, qd)?;
        by_dimension!(self.resolve(input, qd) for self.local.task.dim())
    }

    fn active_limits(&self) -> &[ActiveLimit] {
        &self.active
    }

    fn limiting_pairs(&self) -> &[LimitingPair] {
        self.limited.contacts.as_ref().map_or(&[], |contacts| &contacts.limiting)
    }

    fn surroundings(&self) -> Option<&Surroundings> {
        self.limited.contacts.as_ref().map(|contacts| &contacts.around)
    }

    fn set_time(&mut self, t: f64) {
        if let Some(contacts) = &mut self.limited.contacts {
            contacts.t = t;
        }
    }

    fn boxed(&self) -> Box<dyn Resolver> {
        Box::new(self.clone())
    }
}
