//! The kind of a configuration with respect to a criterion on its self-motion.
//!
//! With mu, L and W of [`Stationarity`]: a configuration is a kinematic singularity when J has lost rank, not critical
//! when mu is not zero, and else what the eigenvalues of W say: all negative a maximum, all positive a minimum, both
//! signs a saddle, one of them zero degenerate (an algorithmic singularity).

use std::fmt;

use nalgebra::{DMatrix, SMatrix};

use crate::chain::Chain;
use crate::criterion::{Criterion, Stationarity};
use crate::error::{Error, Result};
use crate::kinematics::{Scratch, Task};
use crate::tolerance::{CRITICAL_SLOPE, DEGENERATE_CURVATURE, DEGENERATE_ROUNDING, KINEMATIC_SINGULARITY};

/// What a configuration is to a criterion. Its words are the same in Rust, Python and files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Largest value nearby among the configurations over the pose.
    Maximum,
    /// Smallest value nearby.
    Minimum,
    /// Critical, larger values in some directions and smaller ones in others.
    Saddle,
    /// Critical, with a direction in which the second derivative vanishes: an algorithmic singularity.
    Degenerate,
    /// The criterion changes along the self-motion.
    NotCritical,
    /// The task Jacobian has lost rank: the self-motion has no tangent space here.
    KinematicSingularity,
}

impl Kind {
    /// Every kind, in declaration order.
    pub const ALL: [Self; 6] = [
        Self::Maximum,
        Self::Minimum,
        Self::Saddle,
        Self::Degenerate,
        Self::NotCritical,
        Self::KinematicSingularity,
    ];

    /// The kind as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Maximum => "maximum",
            Self::Minimum => "minimum",
            Self::Saddle => "saddle",
            Self::Degenerate => "degenerate",
            Self::NotCritical => "not_critical",
            Self::KinematicSingularity => "kinematic_singularity",
        }
    }

    /// From ascending eigenvalues of W, of which those up to `tolerance` in magnitude count as zero.
    pub fn of_eigenvalues(eigenvalues: &[f64], tolerance: f64) -> Self {
        let (Some(least), Some(most)) = (eigenvalues.first(), eigenvalues.last()) else {
            return Self::Degenerate;
        };
        if eigenvalues.iter().any(|e| e.is_nan() || e.abs() <= tolerance) {
            Self::Degenerate
        } else if *most < 0.0 {
            Self::Maximum
        } else if *least > 0.0 {
            Self::Minimum
        } else {
            Self::Saddle
        }
    }
}

impl std::str::FromStr for Kind {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == word).ok_or_else(|| Error::UnknownName {
            kind: "kind",
            name: word.into(),
            valid: Self::ALL.map(|kind| kind.as_str().to_owned()).to_vec(),
        })
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// What is known about a configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Classification {
    /// What it is.
    pub kind: Kind,
    /// Eigenvalues of the reduced Hessian W on an orthonormal basis of the null space, ascending (r). At a point that
    /// is not critical they are the second derivatives of h along the self-motion.
    pub eigenvalues: Vec<f64>,
    /// `(J J^T)^-1 J grad h`, one for each coordinate of the task.
    pub multipliers: Vec<f64>,
    /// `|N^T grad h|`: the slope of h along the self-motion.
    pub residual: f64,
    /// Smallest singular value of the task Jacobian.
    pub sigma_min: f64,
}

/// Classifies configurations of one chain, criterion and task without allocating (up to four spare freedoms).
#[derive(Debug, Clone)]
pub struct Classifier<'a> {
    stationarity: Stationarity<'a>,
    eigenvalues: Vec<f64>,
    sigma: [f64; 2],
    pub(super) residual: f64,
    tangent: Vec<f64>,
    moved: Vec<f64>,
}

impl<'a> Classifier<'a> {
    /// # Errors
    /// A criterion for another number of joints, a task that leaves no freedom.
    pub fn new(chain: &'a Chain, criterion: &'a dyn Criterion, task: Task) -> Result<Self> {
        let stationarity = Stationarity::new(chain, criterion, task)?;
        let (n, r) = (chain.dof(), chain.dof() - task.dim());
        Ok(Self {
            stationarity,
            eigenvalues: vec![0.0; r],
            sigma: [0.0; 2],
            residual: 0.0,
            tangent: vec![0.0; n * r],
            moved: vec![0.0; n],
        })
    }

    /// What `q` is.
    ///
    /// # Errors
    /// Wrong length of `q`, or an entry that is not finite.
    pub fn classify(&mut self, q: &[f64]) -> Result<Kind> {
        self.stationarity.chain().check_q(q)?;
        Ok(self.kind_at(q))
    }

    /// [`Classifier::classify`] for a `q` that was checked before.
    pub(crate) fn kind_at(&mut self, q: &[f64]) -> Kind {
        self.stationarity.second_order(q);
        let kind = self.judge();
        match self.eigenvalues[..] {
            [w] if kind == Kind::Degenerate => self.look_around(q, w),
            _ => kind,
        }
    }

    /// What a point of one spare freedom is that may be degenerate, with `dW/ds` as measured on both sides of it.
    fn look_around(&mut self, q: &[f64], w: f64) -> Kind {
        const STEP: f64 = 1e-4;
        self.tangent.copy_from_slice(self.stationarity.null_space().basis().as_slice());
        let mut slope = 0.0_f64;
        for side in [STEP, -STEP] {
            for ((moved, q), t) in self.moved.iter_mut().zip(q).zip(&self.tangent) {
                *moved = q + side * t;
            }
            self.stationarity.second_order(&self.moved);
            slope = slope.max((self.stationarity.reduced_hessian()[(0, 0)] - w).abs() / STEP);
        }
        self.stationarity.second_order(q);
        self.judge();
        Kind::of_eigenvalues(&self.eigenvalues, self.flatness(slope))
    }

    /// Curvature up to which a critical point counts as degenerate, where the curvature changes by `slope` per radian.
    fn flatness(&self, slope: f64) -> f64 {
        // With the slope mu of h and the curvature W, Newton's method is sure to find a critical point of the same kind
        // nearby if 2 |mu dW/ds| < W^2 (Kantorovich).
        let scale = self.stationarity.scale();
        let open = (2.0 * self.residual * slope).sqrt();
        open.min(DEGENERATE_CURVATURE * scale).max(DEGENERATE_ROUNDING * scale)
    }

    /// What the configuration is at which the stationarity was evaluated last.
    pub(super) fn judge(&mut self) -> Kind {
        let at = &mut self.stationarity;
        self.sigma = at.singular_values();
        self.residual = at.mu().iter().map(|x| x * x).sum::<f64>().sqrt();
        symmetric_eigenvalues(at.reduced_hessian(), &mut self.eigenvalues);
        let slope = at.gradient().iter().map(|x| x * x).sum::<f64>().sqrt();
        if self.sigma[0] <= KINEMATIC_SINGULARITY * self.sigma[1] {
            return Kind::KinematicSingularity;
        }
        if self.residual > CRITICAL_SLOPE * (slope + at.scale()) {
            return Kind::NotCritical;
        }
        // dW/ds is at most of the size of the terms of L, as a rule.
        let scale = at.scale();
        Kind::of_eigenvalues(&self.eigenvalues, self.flatness(scale))
    }

    /// Eigenvalues of W at the last configuration, ascending.
    pub fn eigenvalues(&self) -> &[f64] {
        &self.eigenvalues
    }

    /// Slope of h along the self-motion at the last configuration.
    pub fn residual(&self) -> f64 {
        self.residual
    }

    /// Smallest singular value of the task Jacobian at the last configuration.
    pub fn sigma_min(&self) -> f64 {
        self.sigma[0]
    }

    /// Smallest over largest singular value of the task Jacobian at the last configuration.
    pub(super) fn sigma_ratio(&self) -> f64 {
        if self.sigma[1] > 0.0 { self.sigma[0] / self.sigma[1] } else { 0.0 }
    }

    /// What the numbers were made from.
    pub fn stationarity(&self) -> &Stationarity<'a> {
        &self.stationarity
    }

    pub(crate) fn stationarity_mut(&mut self) -> &mut Stationarity<'a> {
        &mut self.stationarity
    }

    /// What is known about the last configuration, which is of `kind`.
    pub fn result(&self, kind: Kind) -> Classification {
        Classification {
            kind,
            eigenvalues: self.eigenvalues.clone(),
            multipliers: self.stationarity.multipliers().to_vec(),
            residual: self.residual,
            sigma_min: self.sigma[0],
        }
    }
}

/// What `q` is to `criterion` among the configurations with the same task value.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::Posture, kinematics::Task, optimum::{Kind, classify}};
/// let arm = catalog::load("planar3r")?;
/// let near = Posture::new(&[0.3, 0.5, 0.7])?;
/// let at = classify(&arm, &[0.3, 0.5, 0.7], &near, Task::PLANAR)?;
/// assert_eq!(at.kind, Kind::Minimum);
/// assert_eq!(classify(&arm, &[0.3, 0.5, 0.9], &near, Task::PLANAR)?.kind, Kind::NotCritical);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// As [`Classifier::new`] and [`Classifier::classify`].
pub fn classify(chain: &Chain, q: &[f64], criterion: &dyn Criterion, task: Task) -> Result<Classification> {
    let mut classifier = Classifier::new(chain, criterion, task)?;
    let kind = classifier.classify(q)?;
    Ok(classifier.result(kind))
}

/// Eigenvalues of a symmetric matrix, ascending; on the stack up to four.
pub(super) fn symmetric_eigenvalues(w: &DMatrix<f64>, out: &mut [f64]) {
    macro_rules! on_stack {
        ($n:literal) => {{
            let matrix = SMatrix::<f64, $n, $n>::from_fn(|i, j| w[(i, j)]);
            out.copy_from_slice(matrix.symmetric_eigenvalues().as_slice());
        }};
    }
    match w.nrows() {
        1 => out[0] = w[(0, 0)],
        2 => on_stack!(2),
        3 => on_stack!(3),
        4 => on_stack!(4),
        _ => out.copy_from_slice(w.clone().symmetric_eigenvalues().as_slice()),
    }
    out.sort_unstable_by(f64::total_cmp);
}

/// The paper's own form for one spare freedom: the null vector of cofactors and what follows from it.
#[derive(Debug, Clone, PartialEq)]
pub struct CofactorCondition {
    /// `n = (adj(J_m) J_{n-m}, -det J_m)` [Park1996, eq. (11)], with the adjugate: polynomial, `|n|^2 = det J J^T`.
    pub n: Vec<f64>,
    /// `n^T grad h` [Park1996, eq. (8)].
    pub mu: f64,
    /// `A = n^T (Hess h) n + (grad h)^T (dn/dq) n` [Park1996, eq. (9)]: `det(J J^T)` times W at critical points.
    pub a: f64,
}

/// The condition of [Park1996, eqs (8), (9), (11)] at `q`, by cofactors and their derivatives alone: an independent
/// way to what [`classify`] computes.
///
/// # Errors
/// As [`classify`]; a task that leaves not exactly one freedom.
pub fn cofactor_condition(
    chain: &Chain,
    q: &[f64],
    criterion: &dyn Criterion,
    task: Task,
) -> Result<CofactorCondition> {
    chain.check_q(q)?;
    criterion.check_arm(chain)?;
    let (n, m) = (chain.dof(), task.dim());
    if n != m + 1 {
        return Err(Error::Invalid(format!(
            "the cofactor condition needs one spare freedom, '{}' has {} joints and the task '{task}' {m} coordinates",
            chain.name(),
            n
        )));
    }
    let mut scratch = Scratch::new(chain);
    let kinematics = chain.kinematics(q, &mut scratch)?;
    let mut entries = vec![0.0; m * n];
    task.write_jacobian(&kinematics, &mut entries);
    let jacobian = DMatrix::from_column_slice(m, n, &entries);
    let without = |matrix: &DMatrix<f64>, i: usize| matrix.clone().remove_column(i);
    let sign = |i: usize| if (n - 1 - i).is_multiple_of(2) { -1.0 } else { 1.0 };
    let null: Vec<f64> = (0..n).map(|i| sign(i) * without(&jacobian, i).determinant()).collect();
    // How J changes along n. The pose does not, so the map from velocities of the tool to the task stays.
    let mut along = DMatrix::zeros(m, n);
    for j in 0..n {
        let mut twist = nalgebra::Vector6::zeros();
        for (k, speed) in null.iter().enumerate() {
            let (linear, angular) = kinematics.jacobian_derivative(j, k);
            for row in 0..3 {
                twist[row] += linear[row] * speed;
                twist[row + 3] += angular[row] * speed;
            }
        }
        let rates = task.from_twist(kinematics.pose(), &twist);
        along.column_mut(j).copy_from_slice(&rates.as_slice()[..m]);
    }
    let mut gradient = vec![0.0; n];
    criterion.gradient(q, &mut gradient);
    let mut hessian = DMatrix::zeros(n, n);
    criterion.hessian(q, &mut hessian);
    let mut a = 0.0;
    for i in 0..n {
        a += (0..n).map(|j| null[i] * hessian[(i, j)] * null[j]).sum::<f64>();
        // d det = sum over the columns of det with that column replaced by its derivative.
        let (minor, change) = (without(&jacobian, i), without(&along, i));
        let derivative: f64 = (0..m)
            .map(|column| {
                let mut replaced = minor.clone();
                replaced.set_column(column, &change.column(column));
                replaced.determinant()
            })
            .sum();
        a += gradient[i] * sign(i) * derivative;
    }
    let mu = null.iter().zip(&gradient).map(|(n, g)| n * g).sum();
    Ok(CofactorCondition { n: null, mu, a })
}
