//! A critical point followed along a path: the extended Jacobian, with its ends.
//!
//! The configurations `q` with `f(q) = x(s)` and `mu(q) = 0` form curves in the space of (q, s). They are followed by
//! their own length (the parameter s is scaled so that the path counts as one turn of a joint), with Newton's
//! method along the shortest way as corrector and the exact derivative
//!
//! ```text
//! B = [ J      -x'(s) ]      J_a = N^T L   [Park1996, sec. 4: det(J_a N) = 0 is where the method breaks]
//!     [ J_a      0    ]
//! ```
//!
//! so that every row lies on the path and on the critical locus to rounding; nothing drifts and a closed path is
//! closed in the joints. Three things end it:
//!
//! - **Algorithmic singularity.** `ds` along the curve changes its sign: the critical point meets another one and
//!   both vanish beyond (a fold; `det [J; J_a] = 0`). s has its largest value there, so the place is exact to the square
//!   of what is left of `ds`. Where an eigenvalue of W changes its sign without a fold, two loci cross.
//! - **Kinematic singularity.** The smallest singular value of J goes to zero, and with it ds: joint speeds grow without
//!   bound. The step stays below half of the ratio of the singular values, which bounds the distance, so the singularity
//!   is approached but never stepped over. It has the sign of neither A nor ds to be seen by on the other side.
//! - **The end of the path.**
//!
//! Cost: some 10 us per step for seven joints and the joint range; steps of at most 0.05 rad.

use nalgebra::DVector;

use super::classify::{Classifier, Kind};
use super::critical_points::{CriticalNewton, CriticalPoint, OptimaSettings, constrained_optima};
use crate::chain::Chain;
use crate::criterion::{Criterion, Sense};
use crate::error::{Error, Result};
use crate::kinematics::{NullSpace, Task, TaskKind};
use crate::parallel::prelude::*;
use crate::path::{
    Event, EventKind, Path, Plan, PlanBuilder, TimingSettings, Trajectory, broken_limits, times_within_limits,
};
use crate::solutions::geometric;
use crate::status::Status;
use crate::tolerance::{
    FOLLOW_DONE, FOLLOW_FOLD, FOLLOW_SHORTEST, FOLLOW_SINGULAR, FOLLOW_START, FOLLOW_STEPS, FREE_SPEED,
    LIMIT_SLACK, TRACE_TURN,
};

/// Settings of [`follow_optimum`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowSettings {
    /// Largest step (rad or m, in joints and the scaled path parameter together). Default 0.05.
    pub step: f64,
}

impl Default for FollowSettings {
    fn default() -> Self {
        Self { step: 0.05 }
    }
}

impl FollowSettings {
    /// Checks the range.
    ///
    /// # Errors
    /// A step that is not in [1e-4, 0.5].
    pub fn validate(&self) -> Result<()> {
        if (1e-4..=0.5).contains(&self.step) {
            return Ok(());
        }
        Err(Error::OutOfRange { what: "step".into(), value: self.step, bound: "from 1e-4 to 0.5".into() })
    }
}

/// Where and why a critical point could not be followed any further.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// `AlgorithmicSingularity` or `KinematicSingularity`.
    pub kind: EventKind,
    /// Arc length on the path.
    pub s: f64,
    /// Configuration.
    pub q: Vec<f64>,
    /// What was met, for a person.
    pub message: String,
}

/// A critical point followed along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct FollowedOptimum {
    /// What it is, the same all along.
    pub kind: Kind,
    /// Joint rows, one for each path point up to the stop.
    pub q: Vec<f64>,
    /// h at each row.
    pub values: Vec<f64>,
    /// Smallest singular value of the task Jacobian at each row.
    pub sigma_min: Vec<f64>,
    /// Eigenvalues of the reduced Hessian row by row, ascending.
    pub eigenvalues: Vec<f64>,
    /// `None` when the path was finished.
    pub stop: Option<Stop>,
}

impl FollowedOptimum {
    /// The rows as a plan: with the path's times, else timed by the chain's velocity limits. Its events are the stop, with
    /// the path point that was not reached as index, and rows at which joints leave their limits or return.
    ///
    /// `Converged` when the path was finished within the limits; `Singular` at a stop; `Limits` where a joint breaks a
    /// position limit, or a speed limit at the path's times.
    ///
    /// # Errors
    /// None for what was followed along this path.
    pub fn plan(&self, chain: &Chain, path: &Path) -> Result<Plan> {
        let trajectory = self.trajectory(chain, path)?;
        let broken = broken_limits(chain, &trajectory);
        let legal = broken.is_none();
        let (status, reason) = match (&self.stop, broken) {
            (Some(stop), Some(broken)) => (Status::Singular, format!("{}; {broken}", stop.message)),
            (Some(stop), None) => (Status::Singular, stop.message.clone()),
            (None, Some(broken)) => (Status::Limits, broken),
            (None, None) => (Status::Converged, String::new()),
        };
        let s = path.s()[..trajectory.rows()].to_vec();
        let builder = PlanBuilder::new(trajectory, status).reason(reason).legal(legal).proven(true).s(s);
        builder.poses_of(chain)?.margin_of(chain)?.build()
    }

    fn trajectory(&self, chain: &Chain, path: &Path) -> Result<Trajectory> {
        let n = chain.dof();
        let rows = self.q.len() / n;
        let (t, at_stop) = match (path.t(), &self.stop) {
            (Some(t), None) => (t[..rows].to_vec(), 0.0),
            (Some(t), Some(stop)) => {
                let s = path.s();
                let (i, j) = (rows.max(1) - 1, rows.min(s.len() - 1));
                let share = if s[j] > s[i] { ((stop.s - s[i]) / (s[j] - s[i])).clamp(0.0, 1.0) } else { 0.0 };
                (t[..rows].to_vec(), t[i] + share * (t[j] - t[i]))
            }
            (None, stop) => {
                let speed = |v: f64| if v.is_finite() { v } else { FREE_SPEED };
                let limits: Vec<f64> = chain.joints().iter().map(|j| speed(j.limits.velocity)).collect();
                let mut q = self.q.clone();
                q.extend(stop.iter().flat_map(|stop| stop.q.iter().copied()));
                let mut t = times_within_limits(&q, &limits, TimingSettings::default())?;
                let last = t.last().copied().unwrap_or(0.0);
                t.truncate(rows);
                (t, last)
            }
        };
        let mut events = Vec::new();
        let joints = chain.joints();
        let inside = |k: usize, i: usize| {
            let (q, limits) = (self.q[k * n + i], &joints[i].limits);
            q >= limits.lower - LIMIT_SLACK && q <= limits.upper + LIMIT_SLACK
        };
        for k in 0..rows {
            for i in 0..n {
                let before = k == 0 || inside(k - 1, i);
                if before != inside(k, i) {
                    let verb = if before { "is outside" } else { "is again within" };
                    let message = format!("joint '{}' {verb} its limits", joints[i].name);
                    let kind = EventKind::JointLimit;
                    events.push(Event { kind, index: k, t: t[k], s: path.s()[k], message });
                }
            }
        }
        if let Some(stop) = &self.stop {
            let (kind, message) = (stop.kind, stop.message.clone());
            events.push(Event { kind, index: rows, t: at_stop, s: stop.s, message });
        }
        let names = joints.iter().map(|j| j.name.clone()).collect();
        Trajectory::new(names, t, self.q.clone(), None, events)
    }
}

/// Follows the critical point of `criterion` nearest to `q0` along `path`, to its end or to where it vanishes.
///
/// ```
/// use redundancy_core::nalgebra::Vector3;
/// use redundancy_core::{chain::catalog, criterion::Manipulability, kinematics::Task, path::Circle};
/// use redundancy_core::optimum::{FollowSettings, follow_optimum};
/// let arm = catalog::load("planar3r")?;
/// let h = Manipulability::new(&arm, Task::PLANAR);
/// let circle = Circle::new(Vector3::new(3.5, 0.0, 0.0), 1.5, std::f64::consts::PI, 1.0, Vector3::z())?;
/// let p1 = [-87.1742f64, 111.7847, 77.5352].map(f64::to_radians);
/// let followed = follow_optimum(&arm, &circle.path(101)?, &p1, &h, Task::PLANAR, &FollowSettings::default())?;
/// assert!(followed.stop.is_none());
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A `q0` that is no critical point over the path's start (the message says how far the nearest one found is), a path
/// without orientations for a task that needs them, a criterion for another number of joints, a task that leaves no
/// freedom, invalid settings.
pub fn follow_optimum(
    chain: &Chain,
    path: &Path,
    q0: &[f64],
    criterion: &dyn Criterion,
    task: Task,
    settings: &FollowSettings,
) -> Result<FollowedOptimum> {
    settings.validate()?;
    chain.check_q(q0)?;
    check_orientation(path, &task)?;
    let mut follower = Follower::new(chain, path, criterion, task, *settings)?;
    let start = follower.start(q0)?;
    Ok(follower.run(start))
}

/// A critical point at the start of a path, and how far it can be followed.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedStart {
    /// The critical point.
    pub point: CriticalPoint,
    /// What following it gave.
    pub followed: FollowedOptimum,
}

/// Follows every critical point over the start of `path`: those that finish it first, among them those of the kind
/// that the criterion asks for, then by value; those that stop after these, the furthest first.
///
/// # Errors
/// As [`constrained_optima`] and [`follow_optimum`].
pub fn rank_starts(
    chain: &Chain,
    path: &Path,
    criterion: &dyn Criterion,
    task: Task,
    optima: &OptimaSettings,
    settings: &FollowSettings,
) -> Result<Vec<RankedStart>> {
    settings.validate()?;
    check_orientation(path, &task)?;
    let points = constrained_optima(chain, &path.poses()[0], criterion, task, optima)?;
    let mut starts = follow_starts(chain, path, criterion, task, points, settings)?;
    sort_starts(&mut starts, criterion.sense());
    Ok(starts)
}

/// Follows each of the critical points over the start of `path`, side by side.
///
/// # Errors
/// As [`follow_optimum`].
pub fn follow_starts(
    chain: &Chain,
    path: &Path,
    criterion: &dyn Criterion,
    task: Task,
    points: Vec<CriticalPoint>,
    settings: &FollowSettings,
) -> Result<Vec<RankedStart>> {
    settings.validate()?;
    check_orientation(path, &task)?;
    let follow = |point: CriticalPoint| {
        let mut follower = Follower::new(chain, path, criterion, task, *settings)?;
        // A point of the search lies on the path and is critical, whatever Newton's method makes of it again.
        let start = match follower.start(&point.q) {
            Ok(start) => start,
            Err(error) => follower.take(point.q.clone()).ok_or(error)?,
        };
        Ok(RankedStart { point, followed: follower.run(start) })
    };
    points.into_par_iter().map(follow).collect()
}

/// Sorts as [`rank_starts`] does.
pub fn sort_starts(starts: &mut [RankedStart], sense: Sense) {
    let wanted = match sense {
        Sense::Minimize => Kind::Minimum,
        Sense::Maximize => Kind::Maximum,
    };
    let key = |start: &RankedStart| {
        let way = start.followed.stop.as_ref().map_or(f64::INFINITY, |stop| stop.s);
        (way, start.point.classification.kind == wanted, sense.sign() * start.point.value)
    };
    starts.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)).then(a.2.total_cmp(&b.2))
    });
}

fn check_orientation(path: &Path, task: &Task) -> Result<()> {
    let positions = matches!(task.kind(), TaskKind::Position | TaskKind::Planar);
    if positions || path.has_orientation() {
        return Ok(());
    }
    let message =
        format!("the path has positions only, the task '{task}' needs orientations (or use 'position')");
    Err(Error::Invalid(message))
}

/// A point of the curve in (q, s).
#[derive(Clone)]
struct Point {
    q: Vec<f64>,
    s: f64,
    /// Unit tangent (n + 1), the last entry in units of `scale`.
    tangent: Vec<f64>,
    /// Smallest singular value of J, and its ratio to the largest.
    sigma: [f64; 2],
    /// Eigenvalues of W.
    eigenvalues: Vec<f64>,
}

impl Point {
    /// How many eigenvalues are positive.
    fn inertia(&self) -> usize {
        self.eigenvalues.iter().filter(|e| **e > 0.0).count()
    }

    fn rate(&self) -> f64 {
        self.tangent[self.tangent.len() - 1]
    }
}

struct Follower<'a> {
    path: &'a Path,
    classifier: Classifier<'a>,
    corrector: CriticalNewton,
    bordered: NullSpace,
    matrix: Vec<f64>,
    rest: Vec<f64>,
    step: Vec<f64>,
    settings: FollowSettings,
    /// Metres of the path that count as one radian.
    scale: f64,
    m: usize,
    n: usize,
}

impl<'a> Follower<'a> {
    fn new(
        chain: &'a Chain,
        path: &'a Path,
        criterion: &'a dyn Criterion,
        task: Task,
        settings: FollowSettings,
    ) -> Result<Self> {
        let (n, m) = (chain.dof(), task.dim());
        let classifier = Classifier::new(chain, criterion, geometric(task))?;
        Ok(Self {
            path,
            classifier,
            corrector: CriticalNewton::new(n),
            bordered: NullSpace::new(n, n + 1),
            matrix: vec![0.0; n * (n + 1)],
            rest: vec![0.0; n],
            step: vec![0.0; n + 1],
            settings,
            scale: (path.length() / std::f64::consts::TAU).max(f64::MIN_POSITIVE),
            m,
            n,
        })
    }

    /// The critical point over the start of the path next to `q0`.
    fn start(&mut self, q0: &[f64]) -> Result<Point> {
        let mut q = q0.to_vec();
        let target = self.path.poses()[0];
        let kind = self.classifier.kind_at(q0);
        let at = self.classifier.stationarity_mut();
        let error = at.task().error(&target, at.pose());
        // At a singular or degenerate start Newton's method has nothing to say: it is taken as it is.
        let polished = self.corrector.polish(at, &target, &mut q, FOLLOW_START).is_some();
        let singular = matches!(kind, Kind::Degenerate | Kind::KinematicSingularity)
            && error.coordinates.norm() <= FOLLOW_START;
        if !polished && !singular {
            let residual = self.classifier.residual();
            let positions = self.path.poses().iter().map(|pose| pose.translation.vector);
            let chain = self.classifier.stationarity_mut().chain().clone();
            let questions = [chain.ask_about_millimetres(positions), chain.ask_about_degrees(q0)];
            let questions: String =
                questions.into_iter().flatten().map(|question| format!("; {question}")).collect();
            return Err(Error::Invalid(format!(
                "q0 is no critical point over the path's start: position error {:.3e} m, orientation error {:.3e} rad, \
                 slope of the criterion along the self-motion {residual:.3e}, and none was found within {FOLLOW_START} \
                 rad of it; constrained_optima finds them{questions}",
                error.position, error.orientation
            )));
        }
        if !polished {
            q.copy_from_slice(q0);
        }
        self.take(q).ok_or_else(|| Error::Invalid("q0 cannot be evaluated".into()))
    }

    /// `q` as the point over the start of the path.
    fn take(&mut self, q: Vec<f64>) -> Option<Point> {
        let mut forward = vec![0.0; self.n + 1];
        forward[self.n] = 1.0;
        self.point(q, self.path.s()[0], &forward)
    }

    /// Fills B and the rest `[x - f; -mu]` at (q, s).
    fn linearise(&mut self, q: &[f64], s: f64) -> Option<()> {
        let (n, m) = (self.n, self.m);
        let (first, last) = (self.path.s()[0], self.path.s()[self.path.len() - 1]);
        // Beyond its ends the path goes on along its end tangents: a step may look past them.
        let clamped = s.clamp(first, last);
        let mut point = self.path.at(clamped).ok()?;
        let linear = point.derivative.fixed_rows::<3>(0).into_owned();
        point.pose.translation.vector += linear * (s - clamped);
        let at = self.classifier.stationarity_mut();
        at.second_order(q);
        let rate = at.task().from_twist(at.pose(), &point.derivative);
        let error = at.task().error(&point.pose, at.pose()).coordinates;
        // Rows of mu in units of the criterion's own curvature.
        let unit = if at.scale() > 0.0 { 1.0 / at.scale() } else { 1.0 };
        for (j, column) in self.matrix.chunks_exact_mut(n).enumerate() {
            if j < n {
                column[..m].copy_from_slice(&at.jacobian()[j * m..(j + 1) * m]);
                for (entry, x) in column[m..].iter_mut().zip(at.mu_jacobian().column(j).iter()) {
                    *entry = unit * x;
                }
            } else {
                for (entry, x) in column[..m].iter_mut().zip(rate.iter()) {
                    *entry = -x * self.scale;
                }
                column[m..].fill(0.0);
            }
        }
        for (entry, e) in self.rest[..m].iter_mut().zip(error.iter()) {
            *entry = *e;
        }
        for (entry, mu) in self.rest[m..].iter_mut().zip(at.mu()) {
            *entry = -unit * mu;
        }
        self.bordered.factor(&self.matrix);
        Some(())
    }

    /// All about (q, s), which lies on the curve; the tangent runs along `before`.
    fn point(&mut self, q: Vec<f64>, s: f64, before: &[f64]) -> Option<Point> {
        self.linearise(&q, s)?;
        let basis = self.bordered.basis();
        let along: f64 = basis.iter().zip(before).map(|(a, b)| a * b).sum();
        let tangent: Vec<f64> = basis.iter().map(|t| along.signum() * t).collect();
        self.classifier.judge();
        let eigenvalues = self.classifier.eigenvalues().to_vec();
        let sigma = [self.classifier.sigma_min(), self.classifier.sigma_ratio()];
        let finite = tangent.iter().chain(&eigenvalues).all(|x| x.is_finite());
        finite.then_some(Point { q, s, tangent, sigma, eigenvalues })
    }

    /// A step of length `h` along the tangent, corrected the shortest way in (q, s).
    fn free(&mut self, from: &Point, h: f64) -> Option<Point> {
        const STEPS: usize = 8;
        let n = self.n;
        let mut q: Vec<f64> = from.q.iter().zip(&from.tangent).map(|(q, t)| q + h * t).collect();
        let mut s = from.s + h * from.rate() * self.scale;
        let mut before = f64::INFINITY;
        for _ in 0..STEPS {
            self.linearise(&q, s)?;
            self.bordered.shortest(&self.rest, &mut self.step);
            let length = self.step.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length.is_nan() || length > 0.3 * h {
                return None;
            }
            for (q, d) in q.iter_mut().zip(&self.step) {
                *q += d;
            }
            s += self.step[n] * self.scale;
            // Rounding stops the descent next to singularities.
            if length <= FOLLOW_DONE || length <= 1e3 * FOLLOW_DONE && length >= 0.5 * before {
                return self.point(q, s, &from.tangent);
            }
            before = length;
        }
        None
    }

    /// The point over path parameter `s`, `h` away along the tangent.
    fn landing(&mut self, from: &Point, s: f64, h: f64) -> Option<Point> {
        let mut q: Vec<f64> = from.q.iter().zip(&from.tangent).map(|(q, t)| q + h * t).collect();
        let target = self.path.at(s).ok()?.pose;
        let at = self.classifier.stationarity_mut();
        self.corrector.polish(at, &target, &mut q, 0.3 * h.max(FOLLOW_SHORTEST))?;
        self.point(q, s, &from.tangent)
    }

    fn run(&mut self, start: Point) -> FollowedOptimum {
        let kind = {
            let kind = self.classifier.kind_at(&start.q);
            if kind == Kind::NotCritical { Kind::Degenerate } else { kind }
        };
        let mut out = FollowedOptimum {
            kind,
            q: Vec::new(),
            values: Vec::new(),
            sigma_min: Vec::new(),
            eigenvalues: Vec::new(),
            stop: None,
        };
        let add = |follower: &Self, point: &Point, out: &mut FollowedOptimum| {
            out.q.extend(&point.q);
            out.values.push(follower.classifier.stationarity().criterion().value(&point.q));
            out.sigma_min.push(point.sigma[0]);
            out.eigenvalues.extend(&point.eigenvalues);
        };
        add(self, &start, &mut out);
        match kind {
            Kind::KinematicSingularity => {
                out.stop = Some(Self::singular(&start));
                return out;
            }
            Kind::Degenerate => {
                out.stop = Some(self.degenerate(kind, &start, "starts at an algorithmic singularity"));
                return out;
            }
            _ => {}
        }
        let inertia = start.inertia();
        let mut here = start;
        let mut h = self.settings.step;
        let knots = self.path.s().to_vec();
        for goal in knots.iter().skip(1) {
            let mut steps = 0;
            while here.s < *goal {
                steps += 1;
                if steps > FOLLOW_STEPS {
                    // Only next to singularities are steps that short.
                    let kinematic = here.sigma[1] < 1e-3;
                    let what = "runs along another critical point, too near to be distinguished from it,";
                    out.stop = Some(if kinematic {
                        Self::singular(&here)
                    } else {
                        self.degenerate(kind, &here, what)
                    });
                    return out;
                }
                match self.advance(&here, *goal, &mut h, kind, inertia) {
                    Ok(next) => here = next,
                    Err(stop) => {
                        out.stop = Some(stop);
                        return out;
                    }
                }
            }
            add(self, &here, &mut out);
        }
        out
    }

    /// One accepted step towards the path parameter `goal`, which it does not pass.
    fn advance(
        &mut self,
        here: &Point,
        goal: f64,
        h: &mut f64,
        kind: Kind,
        inertia: usize,
    ) -> std::result::Result<Point, Stop> {
        if here.sigma[1] <= FOLLOW_SINGULAR {
            return Err(Self::singular(here));
        }
        loop {
            // The ratio of the singular values bounds the distance to a kinematic singularity.
            let bound = self.settings.step.min(0.5 * here.sigma[1]);
            let length = h.min(bound);
            let to_goal = (goal - here.s) / self.scale / here.rate().max(f64::MIN_POSITIVE);
            let lands = to_goal <= length * (1.0 + 1e-9);
            let next = if lands { self.landing(here, goal, to_goal) } else { self.free(here, length) };
            let tried = if lands { to_goal } else { length };
            if let Some(next) = next {
                let cosine: f64 = next.tangent.iter().zip(&here.tangent).map(|(a, b)| a * b).sum();
                let smooth = cosine >= TRACE_TURN.cos();
                if smooth && next.rate() > 0.0 && next.inertia() == inertia && next.s <= goal {
                    if cosine > (0.5 * TRACE_TURN).cos() {
                        *h = (1.5 * length).max(*h).min(self.settings.step);
                    }
                    return Ok(next);
                }
                // A path with corners turns at once; over it the critical point is regular.
                let regular = next.inertia() == inertia && next.rate() > 0.1 && here.rate() > 0.1;
                if lands && regular && tried < 1e-3 {
                    return Ok(next);
                }
                if smooth && next.rate() <= 0.0 && !lands {
                    return Err(self.fold(here, tried, kind));
                }
                if smooth && next.inertia() != inertia && !lands && tried < 1e-3 {
                    return Err(self.crossing(here, tried, kind, inertia));
                }
                if !smooth && regular && !lands && tried < 1e-6 {
                    return Ok(next);
                }
            }
            *h = 0.5 * tried;
            if *h < FOLLOW_SHORTEST {
                return Err(if here.sigma[1] < 1e2 * FOLLOW_SINGULAR {
                    Self::singular(here)
                } else {
                    self.degenerate(kind, here, "cannot be continued")
                });
            }
        }
    }

    /// Where ds vanishes between `here` and the point `h` further on: regula falsi with halving (Illinois).
    fn fold(&mut self, here: &Point, h: f64, kind: Kind) -> Stop {
        const STEPS: usize = 60;
        let (mut a, mut fa, mut b) = (0.0, here.rate(), h);
        let mut fb = self.free(here, h).map_or(-fa, |p| p.rate());
        let mut best = here.clone();
        for _ in 0..STEPS {
            if fb >= fa {
                break;
            }
            let x = (a * fb - b * fa) / (fb - fa);
            let Some(point) = self.free(here, x.max(f64::MIN_POSITIVE)) else { break };
            let f = point.rate();
            if f.abs() < best.rate().abs() {
                best = point;
            }
            if f.abs() <= FOLLOW_FOLD || b - a <= FOLLOW_SHORTEST * h {
                break;
            }
            if f > 0.0 {
                (a, fa) = (x, f);
                fb *= 0.5;
            } else {
                (b, fb) = (x, f);
                fa *= 0.5;
            }
        }
        if best.sigma[1] < 1e2 * FOLLOW_SINGULAR {
            return Self::singular(&best);
        }
        self.degenerate(kind, &best, "meets another critical point and both vanish")
    }

    /// Where an eigenvalue vanishes without a fold.
    fn crossing(&mut self, here: &Point, h: f64, kind: Kind, inertia: usize) -> Stop {
        const STEPS: usize = 60;
        let (mut a, mut b) = (0.0, h);
        let mut best = here.clone();
        for _ in 0..STEPS {
            let x = 0.5 * (a + b);
            if x <= a || x >= b {
                break;
            }
            match self.free(here, x) {
                Some(point) if point.inertia() == inertia => {
                    a = x;
                    best = point;
                }
                _ => b = x,
            }
        }
        self.degenerate(kind, &best, "crosses another critical locus")
    }

    fn degenerate(&self, kind: Kind, at: &Point, what: &str) -> Stop {
        let least = at.eigenvalues.iter().fold(f64::INFINITY, |m, e| if e.abs() < m.abs() { *e } else { m });
        let message = format!(
            "algorithmic singularity: the {kind} {what} at s = {:.12} m (eigenvalue of the reduced Hessian {least:.3e}, \
             smallest singular value of the Jacobian {:.3e})",
            at.s, at.sigma[0]
        );
        Stop { kind: EventKind::AlgorithmicSingularity, s: at.s, q: at.q.clone(), message }
    }

    fn singular(at: &Point) -> Stop {
        let message = format!(
            "kinematic singularity: the smallest singular value of the Jacobian falls to {:.3e} at s = {:.12} m, joint \
             speeds grow without bound",
            at.sigma[0], at.s
        );
        Stop { kind: EventKind::KinematicSingularity, s: at.s, q: at.q.clone(), message }
    }
}

/// Distance in joint space (revolute joints the short way round) from each of the rows `q` to the nearest of `points`,
/// with the first joint left out where `modulo_first`: algorithmic singularities of planar arms do not depend on it.
///
/// # Errors
/// Rows or points that do not have one finite number for each joint; no points.
pub fn distance_to_nearest(
    chain: &Chain,
    q: &[f64],
    points: &[Vec<f64>],
    modulo_first: bool,
) -> Result<Vec<f64>> {
    let n = chain.dof();
    if points.is_empty() {
        return Err(Error::Length { what: "points".into(), expected: 1, actual: 0 });
    }
    for point in points {
        chain.check_q(point)?;
    }
    crate::error::check_vector("q", q, q.len() / n * n)?;
    let mut d = DVector::zeros(n);
    let rows = q.chunks_exact(n).map(|row| {
        let distances = points.iter().map(|point| {
            chain.difference_into(row, point, d.as_mut_slice());
            if modulo_first {
                d[0] = 0.0;
            }
            d.norm()
        });
        distances.fold(f64::INFINITY, f64::min)
    });
    Ok(rows.collect())
}
