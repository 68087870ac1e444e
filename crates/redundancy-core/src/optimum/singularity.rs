//! Where critical points vanish: `mu = 0` and `det W = 0`.
//!
//! These are r + 1 equations for n joints, so the set has m - 1 dimensions [Park1996, lemma 4.2 ff.]. Where neither the
//! criterion nor the self-motion depends on the first joint it is enough to look at one value of it; one dimension is
//! lost. For tasks of two coordinates isolated points are left (each a circle about the base), for others the
//! points found are samples of a set of [`SingularPoint::dimension`] dimensions; curves are followed by
//! [`SingularitySearch::tracer`].
//!
//! Newton's method runs from many starts. `d mu = N^T L dq` is exact; the derivative of `det W`, a third derivative
//! of h, is a central difference of a function that does not depend on the basis of the null space, so only the speed of
//! convergence feels its error, not the result. Kinematic singularities, where `mu = A = 0` for want of a null space
//! (the paper's plots show them as intersections too), are excluded by the singular values of J.
//!
//! Cost for the planar arm with three joints: about 0.3 ms per start; a hundred starts find all ten points.

use nalgebra::DMatrix;

use super::classify::Classifier;
use super::critical_points::MOST_STARTS;
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::joint_space::TURN;
use crate::kinematics::{NullSpace, Task};
use crate::parallel::prelude::*;
use crate::solutions::{geometric, random_configurations};
use crate::tolerance::{
    FOLLOW_DONE, SAME_SINGULARITY, SINGULARITY_DIFFERENCE, SINGULARITY_RANK, SINGULARITY_RESIDUAL,
};

/// Starts that are done side by side.
const PIECE: usize = 64;
/// Least number of starts before isolated points count as complete.
const ENOUGH: usize = 256;

/// Settings of [`algorithmic_singularities`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingularitySettings {
    /// Seed of the random starts.
    pub seed: u64,
    /// Most random starts; isolated points need fewer. Default 2000.
    pub starts: usize,
}

impl Default for SingularitySettings {
    fn default() -> Self {
        Self { seed: 0, starts: 2000 }
    }
}

/// A configuration at which a critical point vanishes.
#[derive(Debug, Clone, PartialEq)]
pub struct SingularPoint {
    /// Configuration; the first joint is zero where it is free.
    pub q: Vec<f64>,
    /// Where the tool is, m.
    pub position: [f64; 3],
    /// What is left of `mu = 0` and of the least eigenvalue of W, relative to gradient and curvature of the criterion.
    pub residual: f64,
    /// Whether every value of the first joint gives a singular point.
    pub first_joint_free: bool,
    /// Dimension of the set that the point belongs to, without the first joint where that is free: 0 for isolated points.
    pub dimension: usize,
}

/// Where critical points of `criterion` vanish for some value of the task, sorted by joint values.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::Manipulability, kinematics::Task};
/// use redundancy_core::optimum::{SingularitySettings, algorithmic_singularities};
/// let arm = catalog::load("planar3r")?;
/// let h = Manipulability::new(&arm, Task::PLANAR);
/// let points = algorithmic_singularities(&arm, &h, Task::PLANAR, &SingularitySettings::default())?;
/// assert_eq!(points.len(), 10); // table 1 of the paper and its mirror images
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A criterion for another number of joints, a task that leaves no freedom, more than 100 000 starts.
pub fn algorithmic_singularities(
    chain: &Chain,
    criterion: &dyn Criterion,
    task: Task,
    settings: &SingularitySettings,
) -> Result<Vec<SingularPoint>> {
    let mut search = SingularitySearch::new(chain, criterion, task, settings)?;
    search.run(search.starts());
    Ok(search.finish())
}

/// [`algorithmic_singularities`] piece by piece, for callers that look for other things to do in between. The result
/// does not depend on the pieces.
#[derive(Debug)]
pub struct SingularitySearch<'a> {
    chain: &'a Chain,
    classifier: Classifier<'a>,
    free: bool,
    /// Whether whole turns of the joints make no difference.
    periodic: bool,
    isolated: bool,
    starts: Vec<Vec<f64>>,
    /// Starts done.
    done: usize,
    /// Starts done when the last new point was found.
    last_new: usize,
    points: Vec<SingularPoint>,
}

impl<'a> SingularitySearch<'a> {
    /// A search at its beginning.
    ///
    /// # Errors
    /// As [`algorithmic_singularities`].
    pub fn new(
        chain: &'a Chain,
        criterion: &'a dyn Criterion,
        task: Task,
        settings: &SingularitySettings,
    ) -> Result<Self> {
        if settings.starts > MOST_STARTS {
            let (what, value) = ("starts".into(), settings.starts as f64);
            return Err(Error::OutOfRange { what, value, bound: format!("<= {MOST_STARTS}") });
        }
        let task = geometric(task);
        let mut classifier = Classifier::new(chain, criterion, task)?;
        let (n, r) = (chain.dof(), chain.dof() - task.dim());
        const SHIFT: f64 = 0.7;
        let mut shift = vec![0.0; n];
        shift[0] = SHIFT;
        let free = stays(&mut classifier, settings.seed, &shift);
        for (shift, joint) in shift.iter_mut().zip(chain.steps()) {
            *shift = if joint.rotational { TURN } else { 0.0 };
        }
        let periodic = stays(&mut classifier, settings.seed, &shift);
        let unknowns = n - usize::from(free);
        let count = if unknowns < r + 1 { 0 } else { settings.starts };
        Ok(Self {
            chain,
            classifier,
            free,
            periodic,
            isolated: unknowns == r + 1,
            starts: random_configurations(chain, settings.seed, count).collect(),
            done: 0,
            last_new: 0,
            points: Vec::new(),
        })
    }

    /// How many starts are left at most.
    pub fn starts(&self) -> usize {
        self.starts.len() - self.done
    }

    /// Does up to `count` starts, rounded up to a whole number of pieces. Isolated points count as complete when three in
    /// four starts, and at least 256, have found nothing new.
    pub fn run(&mut self, count: usize) {
        let end = self.starts.len().min(self.done.saturating_add(count));
        while self.done < end {
            if self.isolated && self.done >= (4 * self.last_new).max(ENOUGH) {
                self.done = self.starts.len();
                return;
            }
            let piece = &self.starts[self.done..self.starts.len().min(self.done + PIECE)];
            let (classifier, free) = (&self.classifier, self.free);
            let found: Vec<Option<SingularPoint>> = piece
                .par_iter()
                .map_init(
                    || SingularPointSearch::new(classifier.clone(), free),
                    |search, start| {
                        let mut q = start.clone();
                        if free {
                            q[0] = 0.0;
                        }
                        search.newton(q)
                    },
                )
                .collect();
            // In the order of the starts, so that the result does not depend on the number of threads.
            let mut d = vec![0.0; self.chain.dof()];
            for (i, point) in found.into_iter().enumerate() {
                let Some(point) = point else { continue };
                let known = self.points.iter().any(|other| {
                    self.chain.difference_into(&other.q, &point.q, &mut d);
                    d.iter().map(|x| x * x).sum::<f64>().sqrt() <= SAME_SINGULARITY
                });
                if !known {
                    self.points.push(point);
                    self.last_new = self.done + i + 1;
                }
            }
            self.done += piece.len();
        }
    }

    /// Dimension of the set without the first joint where that is free; `None` where there are more equations than joints.
    pub fn dimension(&self) -> Option<usize> {
        let r = self.chain.dof() - self.classifier.stationarity().task().dim();
        (self.chain.dof() - usize::from(self.free)).checked_sub(r + 1)
    }

    /// Whether every value of the first joint gives a singular point.
    pub fn first_joint_free(&self) -> bool {
        self.free
    }

    pub(super) fn periodic(&self) -> bool {
        self.periodic
    }

    pub(super) fn chain(&self) -> &'a Chain {
        self.chain
    }

    /// Memory for Newton's method.
    pub(super) fn newton(&self) -> SingularPointSearch<'a> {
        SingularPointSearch::new(self.classifier.clone(), self.free)
    }

    /// What was found, sorted by joint values.
    pub fn finish(mut self) -> Vec<SingularPoint> {
        self.points.sort_by(|a, b| {
            let orders = a.q.iter().zip(&b.q).map(|(a, b)| a.total_cmp(b));
            orders.into_iter().find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
        });
        self.points
    }
}

/// Whether mu and W stay when the joints move by `shift`, measured at some configurations.
fn stays(classifier: &mut Classifier<'_>, seed: u64, shift: &[f64]) -> bool {
    const SAMPLES: usize = 6;
    const SAME: f64 = 1e-9;
    let chain = classifier.stationarity().chain();
    random_configurations(&chain, seed, SAMPLES).all(|mut q| {
        classifier.kind_at(&q);
        let scale = classifier.stationarity().scale();
        let before = [classifier.eigenvalues().to_vec(), vec![classifier.residual()]].concat();
        q.iter_mut().zip(shift).for_each(|(q, d)| *q += d);
        classifier.kind_at(&q);
        let after = classifier.eigenvalues().iter().chain(std::iter::once(&classifier.residual)).copied();
        before.iter().zip(after).all(|(a, b)| (a - b).abs() <= SAME * scale)
    })
}

/// Newton's method on `[mu; det W]`.
#[derive(Debug)]
pub(super) struct SingularPointSearch<'a> {
    classifier: Classifier<'a>,
    first: usize,
    null: NullSpace,
    matrix: DMatrix<f64>,
    rest: Vec<f64>,
    step: Vec<f64>,
}

impl<'a> SingularPointSearch<'a> {
    fn new(classifier: Classifier<'a>, free: bool) -> Self {
        let chain = classifier.stationarity().chain();
        let (first, n) = (usize::from(free), chain.dof());
        let equations = n - classifier.stationarity().task().dim() + 1;
        let unknowns = n - first;
        Self {
            classifier,
            first,
            null: NullSpace::new(equations, unknowns),
            matrix: DMatrix::zeros(equations, unknowns),
            rest: vec![0.0; equations],
            step: vec![0.0; unknowns],
        }
    }

    /// `det W`.
    fn determinant(&mut self, q: &[f64]) -> f64 {
        self.classifier.stationarity_mut().second_order(q);
        let w = self.classifier.stationarity().reduced_hessian();
        if w.nrows() == 1 { w[(0, 0)] } else { w.determinant() }
    }

    /// Unit vector along the set at the last step, without the first joint where that is free.
    pub fn tangent(&self) -> Vec<f64> {
        self.null.basis().column(0).iter().copied().collect()
    }

    /// Smallest over largest singular value of the task Jacobian at `q`.
    pub fn rank(&mut self, q: &[f64]) -> f64 {
        self.classifier.kind_at(q);
        self.classifier.sigma_ratio()
    }

    /// One Newton step of at most `reach`; its length before the bound.
    pub fn step(&mut self, q: &mut [f64], reach: f64) -> Option<f64> {
        let (n, r) = (q.len(), self.rest.len() - 1);
        let mut slope = vec![0.0; n - self.first];
        for (slope, j) in slope.iter_mut().zip(self.first..n) {
            let at = q[j];
            q[j] = at + SINGULARITY_DIFFERENCE;
            let ahead = self.determinant(q);
            q[j] = at - SINGULARITY_DIFFERENCE;
            let behind = self.determinant(q);
            q[j] = at;
            *slope = (ahead - behind) / (2.0 * SINGULARITY_DIFFERENCE);
        }
        let value = self.determinant(q);
        let at = self.classifier.stationarity();
        // Both kinds of rows of the order of one.
        let scale = at.scale();
        if scale.is_nan() || scale <= 0.0 {
            return None;
        }
        let unit = scale.powi(r as i32);
        for j in self.first..n {
            for i in 0..r {
                self.matrix[(i, j - self.first)] = at.mu_jacobian()[(i, j)] / scale;
            }
            self.matrix[(r, j - self.first)] = slope[j - self.first] / unit;
        }
        for i in 0..r {
            self.rest[i] = -at.mu()[i] / scale;
        }
        self.rest[r] = -value / unit;
        self.null.factor(self.matrix.as_slice());
        self.null.shortest(&self.rest, &mut self.step);
        let length = self.step.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !length.is_finite() {
            return None;
        }
        let factor = if length > reach { reach / length } else { 1.0 };
        for (q, d) in q[self.first..].iter_mut().zip(&self.step) {
            *q += factor * d;
        }
        Some(length)
    }

    fn newton(&mut self, mut q: Vec<f64>) -> Option<SingularPoint> {
        const STEPS: usize = 60;
        const REACH: f64 = 0.3;
        let mut before = f64::INFINITY;
        for _ in 0..STEPS {
            let length = self.step(&mut q, REACH)?;
            if length <= FOLLOW_DONE || length <= 1e3 * FOLLOW_DONE && length >= 0.5 * before {
                return self.check(q);
            }
            before = length;
        }
        None
    }

    fn check(&mut self, mut q: Vec<f64>) -> Option<SingularPoint> {
        let chain = self.classifier.stationarity().chain();
        chain.wind(&mut q);
        if self.first == 1 {
            q[0] = 0.0;
        }
        self.classifier.kind_at(&q);
        let [least, most] = self.classifier.stationarity_mut().singular_values();
        if least <= SINGULARITY_RANK * most {
            return None;
        }
        let at = self.classifier.stationarity();
        let slope = at.gradient().iter().map(|g| g * g).sum::<f64>().sqrt();
        let curvature = self.classifier.eigenvalues().iter().fold(f64::INFINITY, |m, e| m.min(e.abs()));
        let residual = (self.classifier.residual() / (slope + at.scale())).max(curvature / at.scale());
        // Also false for what is not a number.
        if residual.is_nan() || residual > SINGULARITY_RESIDUAL {
            return None;
        }
        let p = chain.forward_unchecked(&q).translation.vector;
        Some(SingularPoint {
            position: [p.x, p.y, p.z],
            residual,
            first_joint_free: self.first == 1,
            dimension: self.step.len() - self.rest.len(),
            q,
        })
    }
}
