//! Every critical point of a criterion over one pose.
//!
//! **One spare freedom.** The self-motion is a set of curves. Along each, `mu(s)` and its derivative `W(s)` are
//! computed at the rows; between two rows the cubic with these values is checked through its Bernstein coefficients:
//! no sign change and well away from zero, no root; one sign change, one root; anything else is halved. Roots are
//! polished by Newton's method on `[f(q) - x; mu(q)]`. What the criterion of the joint range makes of a joint that
//! passes half a turn (it jumps to another winding) is no critical point and is not taken for one.
//!
//! **More.** The same Newton method from many starts: every critical point that it finds, without a proof that
//! there are no others.

use nalgebra::{DMatrix, DVector, Vector6};

use super::classify::{Classification, Classifier, Kind};
use crate::chain::Chain;
use crate::criterion::{Criterion, Sense, Stationarity};
use crate::error::{Error, Result};
use crate::kinematics::{Corrector, Task};
use crate::pose::{Pose, checked_pose};
use crate::solutions::{SelfMotionCurve, TraceSettings, random_configurations, self_motion_curves};
use crate::tolerance::{NEWTON_DONE, SAME_CRITICAL_POINT, SLOPE_NOISE, TRACE_ONE_STEP};

/// Most random starts of one call: seconds to minutes.
pub(crate) const MOST_STARTS: usize = 100_000;

/// Settings of [`constrained_optima`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OptimaSettings {
    /// Seed of the random starts.
    pub seed: u64,
    /// Random starts: configurations from which curves (one spare freedom, not for S-R-S arms) or critical points (more)
    /// are looked for. Default 100.
    pub starts: usize,
    /// Largest joint step between the points of a curve at which mu is evaluated. Default 0.1.
    pub step: f64,
}

impl Default for OptimaSettings {
    fn default() -> Self {
        Self { seed: 0, starts: 100, step: 0.1 }
    }
}

/// A critical point over a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct CriticalPoint {
    /// Configuration; each revolute joint in its principal value, unless that breaks a limit and another winding does
    /// not.
    pub q: Vec<f64>,
    /// h(q).
    pub value: f64,
    /// What it is; never `NotCritical` or `KinematicSingularity`.
    pub classification: Classification,
    /// Whether all joint limits hold.
    pub within_limits: bool,
}

/// The critical points of `criterion` among the configurations over `target`, best value first.
///
/// Limits do not remove points, they are reported; kinematic singularities are no critical points.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::Posture, kinematics::Task};
/// use redundancy_core::optimum::{OptimaSettings, constrained_optima};
/// let arm = catalog::load("planar3r")?;
/// let h = Posture::new(&[0.3, 0.5, 0.7])?;
/// let target = arm.forward(&[0.3, 0.5, 0.7])?;
/// let points = constrained_optima(&arm, &target, &h, Task::PLANAR, &OptimaSettings::default())?;
/// assert!(points[0].value < 1e-20);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// An invalid target, a criterion for another number of joints, a task that leaves no freedom, invalid settings.
pub fn constrained_optima(
    chain: &Chain,
    target: &Pose,
    criterion: &dyn Criterion,
    task: Task,
    settings: &OptimaSettings,
) -> Result<Vec<CriticalPoint>> {
    let target = &checked_pose("target", target)?;
    if settings.starts > MOST_STARTS {
        let (what, value) = ("starts".into(), settings.starts as f64);
        return Err(Error::OutOfRange { what, value, bound: format!("<= {MOST_STARTS}") });
    }
    let trace = TraceSettings { step: settings.step, ..TraceSettings::default() };
    trace.validate()?;
    let mut search = CriticalPointSearch::new(chain, target, criterion, task)?;
    if chain.dof() == task.dim() + 1 {
        for curve in self_motion_curves(chain, target, task, &trace, settings.seed, settings.starts)? {
            search.along(&curve);
        }
    } else {
        for q in random_configurations(chain, settings.seed, settings.starts) {
            search.newton(q);
        }
    }
    Ok(search.finish())
}

/// Newton's method on `[f(q) - x; mu(q)]`, x fixed.
pub(super) struct CriticalNewton {
    error: Vector6<f64>,
    step: DVector<f64>,
}

impl CriticalNewton {
    pub fn new(n: usize) -> Self {
        Self { error: Vector6::zeros(), step: DVector::zeros(n) }
    }

    /// One step of at most `reach` from `q`, where `at` is evaluated; its length before the bound. `None` where W is
    /// singular.
    pub fn step(
        &mut self,
        at: &mut Stationarity<'_>,
        target: &Pose,
        q: &mut [f64],
        reach: f64,
    ) -> Option<f64> {
        at.second_order(q);
        self.error = at.task().error(target, at.pose()).coordinates;
        at.null_space().shortest(self.error.as_slice(), self.step.as_mut_slice());
        // mu + (N^T L) (J^+ e + N z) = 0.
        let rest = -(DVector::from_column_slice(at.mu()) + at.mu_jacobian() * &self.step);
        let z = solve(at.reduced_hessian(), &rest)?;
        self.step += at.null_space().basis() * z;
        let length = self.step.norm();
        if !length.is_finite() {
            return None;
        }
        let factor = if length > reach { reach / length } else { 1.0 };
        for (q, d) in q.iter_mut().zip(self.step.iter()) {
            *q += factor * d;
        }
        Some(length)
    }

    /// Steps until they are below [`NEWTON_DONE`]; the length of the way from the first `q`. `None` where it does not
    /// converge or leaves `reach`.
    pub fn polish(
        &mut self,
        at: &mut Stationarity<'_>,
        target: &Pose,
        q: &mut [f64],
        reach: f64,
    ) -> Option<f64> {
        const STEPS: usize = 20;
        let start = q.to_vec();
        let mut before = f64::INFINITY;
        for _ in 0..STEPS {
            let length = self.step(at, target, q, reach)?;
            let way = q.iter().zip(&start).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            if way > reach {
                return None;
            }
            // Where rounding stops the descent, near a fold, the point is as good as it gets.
            if length <= NEWTON_DONE || length <= 1e3 * NEWTON_DONE && length >= 0.5 * before {
                return Some(way);
            }
            before = length;
        }
        None
    }
}

fn solve(matrix: &DMatrix<f64>, rhs: &DVector<f64>) -> Option<DVector<f64>> {
    if matrix.nrows() == 1 {
        let w = matrix[(0, 0)];
        return (w != 0.0).then(|| rhs / w);
    }
    matrix.clone().lu().solve(rhs)
}

struct CriticalPointSearch<'a> {
    chain: &'a Chain,
    target: &'a Pose,
    classifier: Classifier<'a>,
    corrector: CriticalNewton,
    fibre: Corrector,
    found: Vec<CriticalPoint>,
}

/// mu and dmu/ds at a parameter of a curve.
#[derive(Clone, Copy)]
struct Sample {
    s: f64,
    mu: f64,
    slope: f64,
    /// Rounding of mu.
    noise: f64,
}

impl<'a> CriticalPointSearch<'a> {
    fn new(chain: &'a Chain, target: &'a Pose, criterion: &'a dyn Criterion, task: Task) -> Result<Self> {
        Ok(Self {
            chain,
            target,
            classifier: Classifier::new(chain, criterion, task)?,
            corrector: CriticalNewton::new(chain.dof()),
            fibre: Corrector::new(chain, task, target)?,
            found: Vec::new(),
        })
    }

    /// mu along the curve: with the tangent `t` for N, at `q` shifted by `shift`.
    fn sample(&mut self, s: f64, q: &[f64], t: &[f64], shift: &[f64]) -> Sample {
        let wound: Vec<f64> = q.iter().zip(shift).map(|(q, d)| q + d).collect();
        let at = self.classifier.stationarity_mut();
        at.second_order(&wound);
        let along: f64 = at.null_space().basis().iter().zip(t).map(|(n, t)| n * t).sum();
        let noise = SLOPE_NOISE * (at.scale() + at.gradient().iter().map(|g| g.abs()).sum::<f64>());
        Sample { s, mu: at.mu()[0] * along.signum(), slope: at.reduced_hessian()[(0, 0)], noise }
    }

    fn along(&mut self, curve: &SelfMotionCurve) {
        let n = self.chain.dof();
        let shift_of = |search: &Self, q: &[f64]| -> Vec<f64> {
            let mut wound = q.to_vec();
            search.chain.wind(&mut wound);
            wound.iter().zip(q).map(|(w, q)| w - q).collect()
        };
        let mut before: Option<(Sample, Vec<f64>)> = None;
        for k in 0..curve.rows() {
            let (q, t, s) = (curve.q_row(k), curve.tangent_row(k), curve.s()[k]);
            let shift = shift_of(self, q);
            let here = self.sample(s, q, t, &shift);
            if let Some((left, old)) = before.take() {
                // Joints that change their winding in between, each somewhere else: every combination is followed, a
                // root counts where it is in the winding that it was looked for in.
                let changed: Vec<usize> = (0..n).filter(|i| (old[*i] - shift[*i]).abs() > 1.0).collect();
                for mask in 0..1_usize << changed.len() {
                    let mut mixed = old.clone();
                    for (bit, i) in changed.iter().enumerate() {
                        if mask >> bit & 1 == 1 {
                            mixed[*i] = shift[*i];
                        }
                    }
                    let left = if mask == 0 {
                        left
                    } else {
                        self.sample(left.s, curve.q_row(k - 1), curve.tangent_row(k - 1), &mixed)
                    };
                    let all = mask + 1 == 1 << changed.len();
                    let right = if all { here } else { self.sample(s, q, t, &mixed) };
                    self.between(curve, left, right, &mixed, 0);
                }
            }
            before = Some((here, shift));
        }
    }

    fn between(&mut self, curve: &SelfMotionCurve, a: Sample, b: Sample, shift: &[f64], depth: usize) {
        const DEPTH: usize = 12;
        /// Share of the largest Bernstein coefficient below which a cubic without a sign change is examined further.
        const CLEAR: f64 = 0.05;
        let h = b.s - a.s;
        if h <= 0.0 {
            return;
        }
        let bernstein = [a.mu, a.mu + a.slope * h / 3.0, b.mu - b.slope * h / 3.0, b.mu];
        let changes = bernstein.windows(2).filter(|p| (p[0] > 0.0) != (p[1] > 0.0)).count();
        let largest = bernstein.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let least = bernstein.iter().fold(f64::INFINITY, |m: f64, x| m.min(x.abs()));
        let crosses = (a.mu > 0.0) != (b.mu > 0.0);
        if depth == 0 && largest <= a.noise.max(b.noise) {
            // The criterion is constant here up to rounding: no isolated critical point.
            return;
        }
        match changes {
            0 if least >= CLEAR * largest => return,
            1 if crosses && (depth > 0 || h < 0.3) => return self.root(curve, a, b, shift),
            _ => {}
        }
        if depth == DEPTH {
            // Two roots that cannot be told apart, or none: a fold.
            if crosses {
                self.root(curve, a, b, shift);
            } else if changes > 0 || least == 0.0 {
                self.polish(curve, 0.5 * (a.s + b.s), h, shift);
            }
            return;
        }
        let middle = self.at(curve, 0.5 * (a.s + b.s), shift);
        self.between(curve, a, middle, shift, depth + 1);
        self.between(curve, middle, b, shift, depth + 1);
    }

    fn at(&mut self, curve: &SelfMotionCurve, s: f64, shift: &[f64]) -> Sample {
        let q = curve.interpolate(s, &mut self.fibre);
        let sign = curve.sense(s, &mut self.fibre, &q);
        let t: Vec<f64> = self.fibre.tangent_at(&q).iter().map(|t| sign * t).collect();
        self.sample(s, &q, &t, shift)
    }

    /// The root of mu between two points of different sign: secant steps that stay in the bracket, then Newton.
    fn root(&mut self, curve: &SelfMotionCurve, a: Sample, b: Sample, shift: &[f64]) {
        const STEPS: usize = 60;
        let (mut low, mut high) = (a, b);
        for _ in 0..STEPS {
            let width = high.s - low.s;
            if width <= TRACE_ONE_STEP {
                break;
            }
            // Newton from the better end, the middle where it leaves the bracket.
            let from = if low.mu.abs() < high.mu.abs() { low } else { high };
            let newton = from.s - from.mu / from.slope;
            let inside = newton > low.s && newton < high.s;
            let s = if inside { newton } else { 0.5 * (low.s + high.s) };
            let here = self.at(curve, s, shift);
            let close = (here.mu / here.slope).abs();
            if here.mu == 0.0 || inside && close < 1e-3 * (s - from.s).abs() && close < 1e-3 * width {
                (low, high) = (here, here);
                break;
            }
            if (here.mu > 0.0) == (low.mu > 0.0) { low = here } else { high = here }
        }
        let s = if low.mu.abs() < high.mu.abs() { low.s } else { high.s };
        self.polish(curve, s, (b.s - a.s).max(1e-3), shift);
    }

    /// Newton in all joints from a point of the curve; what it arrives at is kept when it is new and in its winding.
    fn polish(&mut self, curve: &SelfMotionCurve, s: f64, reach: f64, shift: &[f64]) {
        let q = curve.interpolate(s, &mut self.fibre);
        let mut wound: Vec<f64> = q.iter().zip(shift).map(|(q, d)| q + d).collect();
        let unpolished = wound.clone();
        let at = self.classifier.stationarity_mut();
        if self.corrector.polish(at, self.target, &mut wound, reach).is_none() {
            // Next to a fold Newton may fail; the bracketed point is kept if it is critical.
            wound = unpolished;
        }
        self.keep(wound);
    }

    fn newton(&mut self, mut q: Vec<f64>) {
        const STEPS: usize = 60;
        const REACH: f64 = 0.3;
        if !self.fibre.reach(&mut q) {
            return;
        }
        let at = self.classifier.stationarity_mut();
        for _ in 0..STEPS {
            match self.corrector.step(at, self.target, &mut q, REACH) {
                Some(length) if length <= NEWTON_DONE => {
                    self.chain.wind(&mut q);
                    // In another winding it may not be critical.
                    let at = self.classifier.stationarity_mut();
                    if self.corrector.polish(at, self.target, &mut q, SAME_CRITICAL_POINT).is_some() {
                        self.keep(q);
                    }
                    return;
                }
                Some(_) => {}
                None => return,
            }
        }
    }

    /// Keeps a critical point that is not there yet.
    fn keep(&mut self, q: Vec<f64>) {
        let mut wound = q.clone();
        self.chain.wind(&mut wound);
        if wound.iter().zip(&q).any(|(a, b)| (a - b).abs() > 1.0) {
            return;
        }
        let kind = self.classifier.kind_at(&q);
        if matches!(kind, Kind::NotCritical | Kind::KinematicSingularity) {
            return;
        }
        let mut d = vec![0.0; q.len()];
        let known = self.found.iter().any(|other| {
            self.chain.difference_into(&other.q, &q, &mut d);
            d.iter().map(|x| x * x).sum::<f64>().sqrt() <= SAME_CRITICAL_POINT
        });
        if known {
            return;
        }
        self.found.push(CriticalPoint {
            value: self.classifier.stationarity().criterion().value(&q),
            classification: self.classifier.result(kind),
            within_limits: self.chain.within_limits(&q, crate::tolerance::LIMIT_SLACK),
            q,
        });
    }

    fn finish(mut self) -> Vec<CriticalPoint> {
        let sign = match self.classifier.stationarity().criterion().sense() {
            Sense::Minimize => 1.0,
            Sense::Maximize => -1.0,
        };
        self.found.sort_by(|a, b| {
            (sign * a.value).total_cmp(&(sign * b.value)).then_with(|| lexicographic(&a.q, &b.q))
        });
        self.found
    }
}

fn lexicographic(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    let orders = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
    orders.into_iter().find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
}
