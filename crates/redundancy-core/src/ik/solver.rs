//! Pose IK for any chain: the closed form if the arm has one, otherwise ranked starts and Levenberg-Marquardt.
//!
//! 1. Closed form, where the registry ([`closed_form`]) knows one: exact, also about poses that have no answer. Arms with
//!    small defects are polished by step 3.
//! 2. The given start, then stored configurations in the order of what is left of the error when their first and last
//!    joints are at their analytic best: the sub-problem of [FromGravdahl2007] as a warm-up.
//! 3. Levenberg-Marquardt with limits from each, given up where progress is slow.
//! 4. If none arrives, the best of them once more with patience, then random starts.
//! 5. If there is a criterion, it is brought to a stationary value in the null space of the task.
//!
//! Stops on a real tolerance: metres and radians, measured by forward kinematics on the configuration that is returned.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::DMatrix;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::descent::{DescentMethod, DescentSettings, JointDescent};
use super::goal::{Goal, way_in};
use super::newton::{NewtonProblem, NewtonRun, RunEnd, Workspace};
use super::starts::{Starts, ranges};
use crate::chain::Chain;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::kinematics::{Task, TaskKind};
use crate::pose::{Pose, checked_pose};
use crate::rotation::OrientationSet;
use crate::solutions::{ClosedForm, closed_form};
use crate::status::Status;
use crate::tolerance::{IK_CRITERION, IK_CRITERION_SHARE, IK_RADIANS_PER_METRE};

/// Most steps of one run.
const RUN: usize = 100;
/// Stored configurations tried before patience and chance.
const RANKED: usize = 32;
/// Starts that ask whether a pose would be reached without limits.
const UNLIMITED: usize = 8;
/// Stored configurations; more rank better but take longer to compare.
const STORED: usize = 1024;
/// Most iterations of one run of a descent.
const DESCENT_RUN: usize = 2_000;
/// Most steps along a criterion.
const CRITERION_STEPS: usize = 200;
/// Longest step along a criterion, rad or m.
const CRITERION_STEP: f64 = 0.3;

/// How a pose is turned into a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum IkMethod {
    /// The closed form where the arm has one, else ranked starts and Levenberg-Marquardt.
    Hybrid,
    /// Levenberg-Marquardt from the given start, then from random ones.
    Newton,
    /// One of the five descent algorithms from the given start, then from random ones.
    Descent(DescentMethod),
}

impl IkMethod {
    /// Every method.
    pub const ALL: [Self; 7] = [
        Self::Hybrid,
        Self::Newton,
        Self::Descent(DescentMethod::CoordinateDescent),
        Self::Descent(DescentMethod::GaussSouthwell),
        Self::Descent(DescentMethod::GaussSouthwellRate),
        Self::Descent(DescentMethod::WeightedDescent),
        Self::Descent(DescentMethod::GradientEstimate),
    ];

    /// The method as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Hybrid => "hybrid",
            Self::Newton => "newton",
            Self::Descent(method) => method.as_str(),
        }
    }

    /// The method with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|m| m.as_str() == name).ok_or_else(|| Error::UnknownName {
            kind: "method",
            name: name.into(),
            valid: Self::ALL.iter().map(|m| m.as_str().to_owned()).collect(),
        })
    }
}

/// Settings of [`IkSolver`].
#[derive(Debug, Clone)]
pub struct IkSettings {
    /// How.
    pub method: IkMethod,
    /// Which coordinates count.
    pub task: Task,
    /// Largest distance from the target that counts as reached, m.
    pub tol_position: f64,
    /// Largest angle from the target that counts as reached, rad.
    pub tol_orientation: f64,
    /// Most iterations over all starts.
    pub max_iterations: usize,
    /// Most starts after the first.
    pub restarts: usize,
    /// Seconds after which the best configuration so far is returned.
    pub time_limit: Option<f64>,
    /// What to do with spare freedom.
    pub criterion: Option<Arc<dyn Criterion>>,
    /// Orientations that count as reached, instead of the target's alone.
    pub orientation_set: Option<OrientationSet>,
    /// Whether the closed form of the arm is used where it has one.
    pub closed_form: bool,
    /// Settings of the descent algorithms.
    pub descent: DescentSettings,
}

impl Default for IkSettings {
    fn default() -> Self {
        Self {
            method: IkMethod::Hybrid,
            task: Task::POSE,
            tol_position: 1e-6,
            tol_orientation: 1e-6,
            max_iterations: 10_000,
            restarts: 200,
            time_limit: None,
            criterion: None,
            orientation_set: None,
            closed_form: true,
            descent: DescentSettings::default(),
        }
    }
}

impl IkSettings {
    /// Checks every setting against its range and against `chain`.
    ///
    /// # Errors
    /// The setting, its value and its bound.
    pub fn validate(&self, chain: &Chain) -> Result<()> {
        let positive = |what: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                return Ok(());
            }
            Err(Error::OutOfRange { what: what.into(), value, bound: "> 0 and finite".into() })
        };
        positive("tol_position", self.tol_position)?;
        positive("tol_orientation", self.tol_orientation)?;
        if let Some(limit) = self.time_limit {
            positive("time_limit", limit)?;
        }
        if self.max_iterations == 0 {
            let what = "max_iterations".into();
            return Err(Error::OutOfRange { what, value: 0.0, bound: ">= 1".into() });
        }
        if let Some(criterion) = &self.criterion {
            criterion.check_arm(chain)?;
        }
        let whole = matches!(self.task.kind(), TaskKind::Pose | TaskKind::PoseRpy);
        self.descent.validate(chain)?;
        if matches!(self.method, IkMethod::Descent(_)) && !(whole && self.orientation_set.is_none()) {
            let (method, task) = (self.method.as_str(), self.task);
            let set = if self.orientation_set.is_some() { " and an orientation set" } else { "" };
            return Err(Error::Invalid(format!(
                "method {method} needs the task pose with the target's orientation, it got the task {task}{set}"
            )));
        }
        if self.orientation_set.is_some() && !whole {
            return Err(Error::Invalid(format!(
                "orientation_set needs the task pose: the task {} already leaves orientations free",
                self.task
            )));
        }
        Ok(())
    }
}

/// The answer over one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct IkResult {
    /// The configuration, within the joint limits; the best one found where the status is not `Converged`.
    pub q: Vec<f64>,
    /// `Converged`; `Unreachable`: every start ended stationary above the tolerance (exact from a closed form); `Limits`:
    /// reached, but only outside the joint limits; `IterationLimit` or `TimeLimit`.
    pub status: Status,
    /// Iterations over all starts; 0 from a closed form.
    pub iterations: usize,
    /// Distance from the target, m, of what counts of it; measured by forward kinematics on `q`.
    pub position_error: f64,
    /// Angle from the target, rad, of what counts of it; measured by forward kinematics on `q`.
    pub orientation_error: f64,
    /// Whether the status is exact: `Converged` always, others where a closed form without defect says so. False where it
    /// is that of a finite search.
    pub proven: bool,
    /// Starts of the numeric search; 0 from a closed form alone.
    pub starts: usize,
}

impl IkResult {
    /// An answer to be filled in, for `n` joints.
    pub fn new(n: usize) -> Self {
        let (position_error, orientation_error) = (f64::INFINITY, f64::INFINITY);
        Self {
            q: vec![0.0; n],
            status: Status::IterationLimit,
            iterations: 0,
            position_error,
            orientation_error,
            proven: false,
            starts: 0,
        }
    }

    /// What the status means here, with the numbers; empty when converged.
    pub fn reason(&self) -> String {
        let miss = format!(
            "{:.6} mm and {:.6} mrad from the target",
            1e3 * self.position_error,
            1e3 * self.orientation_error
        );
        match self.status {
            Status::Converged => String::new(),
            Status::Unreachable if self.proven => {
                format!("out of reach; the nearest pose found is {miss}")
            }
            Status::Unreachable => {
                format!("out of reach of {} starts; the nearest pose found is {miss}", self.starts)
            }
            Status::Limits => {
                let how = if self.proven { String::new() } else { format!(" by {} starts", self.starts) };
                format!(
                    "reachable only outside of the joint limits; within them the nearest pose found{how} is {miss}"
                )
            }
            other => {
                let Self { iterations, starts, .. } = self;
                format!("{other} after {iterations} iterations from {starts} starts, {miss}")
            }
        }
    }
}

/// How a run went: entry k is before iteration k, the last one is at the end.
#[derive(Debug, Clone, PartialEq)]
pub struct IkTrace {
    /// Where it ended.
    pub q: Vec<f64>,
    /// Weighted cost, see [`DescentSettings`].
    pub cost: Vec<f64>,
    /// Distances from the target, m.
    pub position_error: Vec<f64>,
    /// Angles from the target, rad.
    pub orientation_error: Vec<f64>,
}

/// From poses to configurations of one chain.
///
/// ```
/// use redundancy_core::chain::catalog;
/// use redundancy_core::ik::{IkSettings, IkSolver};
/// use redundancy_core::Status;
/// let chain = catalog::load("panda")?;
/// let solver = IkSolver::new(&chain, IkSettings::default())?;
/// let target = chain.forward(&[0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9])?;
/// let result = solver.solve(&target, None, 0)?;
/// assert_eq!(result.status, Status::Converged);
/// assert!(result.position_error <= 1e-6 && result.orientation_error <= 1e-6);
/// assert!(chain.within_limits(&result.q, 0.0));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct IkSolver {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    chain: Chain,
    settings: IkSettings,
    starts: Starts,
    closed: Option<Arc<dyn ClosedForm>>,
    unlimited: (Vec<f64>, Vec<f64>),
}

/// What one call needs, allocated once and reused: the numeric path allocates nothing while solving.
#[derive(Debug, Clone)]
pub struct IkMemory {
    work: Workspace,
    scores: Vec<f32>,
    q: Vec<f64>,
    gradient: Vec<f64>,
    step: Vec<f64>,
    hessian: DMatrix<f64>,
}

/// Progress over several starts.
struct StartSearch {
    best: NewtonRun,
    iterations: usize,
    capped: bool,
    deadline: Option<Instant>,
    /// Starts left, and starts made.
    left: usize,
    count: usize,
    /// The target that starts are ranked by, and its azimuth once they have been.
    near: Pose,
    azimuth: Option<f64>,
    seed: u64,
    rng: Option<ChaCha8Rng>,
    /// Cost from which the last patient run began.
    polished: f64,
}

impl StartSearch {
    fn new(settings: &IkSettings, near: Pose, seed: u64) -> Self {
        let nothing = NewtonRun {
            end: RunEnd::Stalled,
            iterations: 0,
            position: f64::INFINITY,
            orientation: f64::INFINITY,
            cost: f64::INFINITY,
        };
        Self {
            best: nothing,
            iterations: 0,
            capped: false,
            deadline: settings.time_limit.map(|limit| Instant::now() + Duration::from_secs_f64(limit)),
            left: settings.restarts + 1,
            count: 0,
            near,
            azimuth: None,
            seed,
            rng: None,
            polished: f64::INFINITY,
        }
    }

    /// Why to stop, if there is a reason.
    fn over(&self, settings: &IkSettings) -> Option<Status> {
        if self.iterations >= settings.max_iterations {
            Some(Status::IterationLimit)
        } else if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            Some(Status::TimeLimit)
        } else {
            None
        }
    }
}

impl IkSolver {
    /// A solver for `chain`; stores a thousand configurations (about a millisecond).
    ///
    /// # Errors
    /// A setting out of its range; a criterion for another number of joints; an orientation set for a task that leaves
    /// orientations free.
    pub fn new(chain: &Chain, mut settings: IkSettings) -> Result<Self> {
        settings.validate(chain)?;
        let task = settings.task;
        settings.criterion = settings.criterion.map(|h| h.for_task(&task).unwrap_or(h));
        let whole = matches!(settings.task.kind(), TaskKind::Pose | TaskKind::PoseRpy);
        let starts = Starts::new(chain, &settings.task, whole, STORED, IK_RADIANS_PER_METRE);
        let wanted = settings.closed_form && settings.method == IkMethod::Hybrid;
        let wanted = wanted && whole && settings.orientation_set.is_none();
        let closed = if wanted { closed_form(chain) } else { None };
        let bound = |sign: f64| -> Vec<f64> { vec![sign * f64::INFINITY; chain.dof()] };
        let unlimited = (bound(-1.0), bound(1.0));
        Ok(Self { inner: Arc::new(Inner { chain: chain.clone(), settings, starts, closed, unlimited }) })
    }

    /// The chain.
    pub fn chain(&self) -> &Chain {
        &self.inner.chain
    }

    /// The settings.
    pub fn settings(&self) -> &IkSettings {
        &self.inner.settings
    }

    /// Name of the closed form in use ([`ClosedForm::name`]), or none.
    pub fn closed_form(&self) -> Option<&'static str> {
        self.inner.closed.as_ref().map(|form| form.name())
    }

    /// Memory for this solver.
    pub fn memory(&self) -> IkMemory {
        let n = self.chain().dof();
        IkMemory {
            work: Workspace::new(self.chain()),
            scores: vec![0.0; self.inner.starts.len()],
            q: vec![0.0; n],
            gradient: vec![0.0; n],
            step: vec![0.0; n],
            hessian: DMatrix::zeros(n, n),
        }
    }

    /// A configuration over `pose`. With `q0` the search begins there (and a closed form returns what is near it); `seed`
    /// decides the random starts, if it comes to those: the same seed gives the same bits.
    ///
    /// # Errors
    /// A pose that is not rigid or finite, a `q0` of wrong length or not finite.
    pub fn solve(&self, pose: &Pose, q0: Option<&[f64]>, seed: u64) -> Result<IkResult> {
        let mut result = IkResult::new(self.chain().dof());
        self.solve_into(pose, q0, seed, &mut self.memory(), &mut result)?;
        Ok(result)
    }

    /// [`IkSolver::solve`] into memory of the caller.
    ///
    /// # Errors
    /// As [`IkSolver::solve`], and a `result` or `memory` made for another number of joints.
    pub fn solve_into(
        &self,
        pose: &Pose,
        q0: Option<&[f64]>,
        seed: u64,
        memory: &mut IkMemory,
        result: &mut IkResult,
    ) -> Result<()> {
        let pose = &checked_pose("pose", pose)?;
        let n = self.chain().dof();
        if let Some(q0) = q0 {
            crate::error::check_vector("q0", q0, n)?;
        }
        crate::error::check_length("result", &result.q, n)?;
        crate::error::check_length("memory", &memory.q, n)?;
        self.solve_unchecked(pose, q0, seed, memory, result);
        Ok(())
    }

    /// [`IkSolver::solve_into`] for checked input.
    pub(crate) fn solve_unchecked(
        &self,
        pose: &Pose,
        q0: Option<&[f64]>,
        seed: u64,
        memory: &mut IkMemory,
        result: &mut IkResult,
    ) {
        let Inner { chain, settings, closed, .. } = &*self.inner;
        let set = settings.orientation_set.as_ref();
        let goal = Goal { target: *pose, task: settings.task, set, scale: IK_RADIANS_PER_METRE };
        let problem = NewtonProblem {
            chain,
            lower: chain.lower(),
            upper: chain.upper(),
            tol_position: settings.tol_position,
            tol_orientation: settings.tol_orientation,
        };
        (result.iterations, result.starts, result.proven) = (0, 0, false);
        let mut known = None;
        if let Some(form) = closed {
            let status = form.select(pose, q0, settings.criterion.as_deref(), &mut result.q);
            if matches!(status, Status::Limits | Status::Unreachable) {
                known = Some(status);
                result.proven = form.proves(pose);
            } else if status == Status::Converged {
                let run = problem.run(&goal, &mut result.q, &mut memory.work, RUN, true);
                report(result, &run, Status::Converged);
                if run.end == RunEnd::Converged {
                    result.proven = true;
                    return;
                }
            }
        }
        self.search(&problem, &goal, q0, seed, known, memory, result);
        result.proven |= result.status == Status::Converged;
        if result.status == Status::Converged && settings.criterion.is_some() {
            self.improve(&problem, &goal, memory, result);
        }
    }

    fn descent(&self, method: DescentMethod) -> JointDescent<'_> {
        let Inner { chain, settings, .. } = &*self.inner;
        JointDescent {
            chain,
            method,
            settings: &settings.descent,
            lower: chain.lower(),
            upper: chain.upper(),
            tol_position: settings.tol_position,
            tol_orientation: settings.tol_orientation,
        }
    }

    /// One run of the method from `q0`, without restarts or closed form, with cost and errors before every iteration and
    /// at the end. The cost is that of the descent algorithms, whatever the method; `hybrid` runs as `newton`.
    ///
    /// # Errors
    /// As [`IkSolver::solve`].
    pub fn trace(&self, pose: &Pose, q0: &[f64]) -> Result<IkTrace> {
        let pose = &checked_pose("pose", pose)?;
        let Inner { chain, settings, .. } = &*self.inner;
        crate::error::check_vector("q0", q0, chain.dof())?;
        let limits = chain.lower().iter().zip(chain.upper());
        let mut q: Vec<f64> = q0.iter().zip(limits).map(|(q, (lo, hi))| q.clamp(*lo, *hi)).collect();
        let (mut cost, mut position, mut orientation) = (Vec::new(), Vec::new(), Vec::new());
        let mut seen = |c: f64, p: f64, o: f64| {
            cost.push(c);
            position.push(p);
            orientation.push(o);
        };
        match settings.method {
            IkMethod::Descent(method) => {
                self.descent(method).run(pose, &mut q, settings.max_iterations, seen);
            }
            _ => {
                let set = settings.orientation_set.as_ref();
                let goal = Goal { target: *pose, task: settings.task, set, scale: IK_RADIANS_PER_METRE };
                let problem = NewtonProblem {
                    chain,
                    lower: chain.lower(),
                    upper: chain.upper(),
                    tol_position: settings.tol_position,
                    tol_orientation: settings.tol_orientation,
                };
                let mut work = Workspace::new(chain);
                let weights = &settings.descent.weights;
                for k in 0..=settings.max_iterations {
                    let run = problem.run(&goal, &mut q, &mut work, usize::from(k > 0), false);
                    let half = (0.5 * run.orientation).sin();
                    let value =
                        weights.position * run.position.powi(2) + weights.orientation * 8.0 * half * half;
                    seen(value, run.position, run.orientation);
                    if run.end == RunEnd::Converged {
                        break;
                    }
                }
            }
        }
        Ok(IkTrace { q, cost, position_error: position, orientation_error: orientation })
    }

    /// Steps 2 to 4 of the module. `known` is the status that a closed form has proven: then only the nearest pose is
    /// looked for.
    fn search(
        &self,
        problem: &NewtonProblem<'_>,
        goal: &Goal<'_>,
        q0: Option<&[f64]>,
        seed: u64,
        known: Option<Status>,
        memory: &mut IkMemory,
        result: &mut IkResult,
    ) {
        let Inner { settings, .. } = &*self.inner;
        let mut search = StartSearch::new(settings, nominal(goal), seed);
        let descends = matches!(settings.method, IkMethod::Descent(_));
        let mut stopped = None;
        while search.left > 0 {
            let patient = self.next_start(&mut search, q0, &result.q, memory);
            search.left -= 1;
            let left = settings.max_iterations - search.iterations;
            let run = match settings.method {
                IkMethod::Descent(method) => {
                    self.descent(method).run(&goal.target, &mut memory.q, DESCENT_RUN.min(left), |_, _, _| ())
                }
                _ => problem.run(goal, &mut memory.q, &mut memory.work, RUN.min(left), patient),
            };
            search.iterations += run.iterations;
            search.capped |= run.end == RunEnd::Capped;
            if run.cost < search.best.cost || run.end == RunEnd::Converged {
                search.best = run;
                result.q.copy_from_slice(&memory.q);
            }
            if run.end == RunEnd::Converged {
                break;
            }
            stopped = search.over(settings);
            if stopped.is_some() || (known.is_some() && patient) {
                break;
            }
        }
        // If the starts ran out before a patient run, do one from the best start.
        let arrived = search.best.end == RunEnd::Converged;
        if stopped.is_none() && !arrived && !descends && search.best.cost < search.polished {
            memory.q.copy_from_slice(&result.q);
            let run = problem.run(goal, &mut memory.q, &mut memory.work, RUN, true);
            search.iterations += run.iterations;
            if run.cost <= search.best.cost {
                search.best = run;
                result.q.copy_from_slice(&memory.q);
            }
        }
        result.iterations += search.iterations;
        result.starts = search.count;
        let status = if search.best.end == RunEnd::Converged {
            Status::Converged
        } else if let Some(status) = known.or(stopped) {
            status
        } else if search.best.end == RunEnd::Capped {
            Status::IterationLimit
        } else if self.reached_without_limits(problem, goal, &search.near, memory) {
            Status::Limits
        } else {
            Status::Unreachable
        };
        report(result, &search.best, status);
    }

    /// Writes the next start to `memory.q`: the given one, ranked ones, the best of them with patience, random ones. True
    /// when the run is to be patient.
    fn next_start(
        &self,
        search: &mut StartSearch,
        q0: Option<&[f64]>,
        best: &[f64],
        memory: &mut IkMemory,
    ) -> bool {
        let Inner { chain, settings, starts, .. } = &*self.inner;
        let ranked = if settings.method == IkMethod::Hybrid { RANKED } else { 0 };
        let descends = matches!(settings.method, IkMethod::Descent(_));
        let first = search.count == 0;
        search.count += 1;
        if let (true, Some(q0)) = (first, q0) {
            let limits = chain.lower().iter().zip(chain.upper());
            for (q, (x, (lo, hi))) in memory.q.iter_mut().zip(q0.iter().zip(limits)) {
                *q = x.clamp(*lo, *hi);
            }
        } else if search.count <= ranked {
            let near = &search.near;
            let angle = *search.azimuth.get_or_insert_with(|| starts.score(near, &mut memory.scores));
            // Entries whose end joints the limits forbid wait for later, unless there is nothing else.
            for _ in 0..RANKED {
                let entry = starts.take_best(&mut memory.scores);
                if starts.write(chain, entry, near, angle, &mut memory.q) {
                    break;
                }
            }
        } else if search.best.cost < search.polished && !descends && search.count > 1 {
            search.polished = search.best.cost;
            memory.q.copy_from_slice(best);
            return true;
        } else {
            let seed = search.seed;
            let rng = search.rng.get_or_insert_with(|| ChaCha8Rng::seed_from_u64(seed));
            for (q, [lo, hi]) in memory.q.iter_mut().zip(ranges(chain)) {
                *q = lo + (hi - lo) * rng.random::<f64>();
            }
        }
        false
    }

    /// Whether the target is found in reach when no joint has limits.
    fn reached_without_limits(
        &self,
        problem: &NewtonProblem<'_>,
        goal: &Goal<'_>,
        near: &Pose,
        memory: &mut IkMemory,
    ) -> bool {
        let Inner { chain, starts, unlimited, .. } = &*self.inner;
        let free = NewtonProblem { lower: &unlimited.0, upper: &unlimited.1, ..*problem };
        let angle = starts.score(near, &mut memory.scores);
        (0..UNLIMITED).any(|_| {
            let entry = starts.take_best(&mut memory.scores);
            starts.write(chain, entry, near, angle, &mut memory.q);
            free.run(goal, &mut memory.q, &mut memory.work, RUN, true).end == RunEnd::Converged
        })
    }

    /// Moves `result.q` along the null space of the task until the criterion is stationary, or a limit stops it.
    fn improve(
        &self,
        problem: &NewtonProblem<'_>,
        goal: &Goal<'_>,
        memory: &mut IkMemory,
        result: &mut IkResult,
    ) {
        let Some(criterion) = self.inner.settings.criterion.as_deref() else { return };
        let sign = criterion.sense().sign();
        // What is left of the tolerance would hide small gains.
        let exact = NewtonProblem {
            tol_position: IK_CRITERION_SHARE * problem.tol_position,
            tol_orientation: IK_CRITERION_SHARE * problem.tol_orientation,
            ..*problem
        };
        let mut value = sign * criterion.value(&result.q);
        for _ in 0..CRITERION_STEPS {
            criterion.gradient(&result.q, &mut memory.gradient);
            memory.gradient.iter_mut().for_each(|g| *g *= -sign);
            let norm = memory.gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
            problem.project(goal, &result.q, &mut memory.work, &memory.gradient, &mut memory.step);
            let along = memory.step.iter().map(|d| d * d).sum::<f64>().sqrt();
            if along.is_nan() || along <= IK_CRITERION * norm.max(f64::MIN_POSITIVE) {
                return;
            }
            // Newton's length along the direction where the criterion is convex there.
            criterion.hessian(&result.q, &mut memory.hessian);
            let step = &memory.step;
            let mut curvature = 0.0;
            for j in 0..step.len() {
                for i in 0..step.len() {
                    curvature += sign * memory.hessian[(i, j)] * step[i] * step[j];
                }
            }
            let longest = CRITERION_STEP / step.iter().fold(0.0_f64, |a, d| a.max(d.abs()));
            let mut length = if curvature > 0.0 { (along * along / curvature).min(longest) } else { longest };
            let mut moved = false;
            for _ in 0..20 {
                for (i, q) in memory.q.iter_mut().enumerate() {
                    *q = (result.q[i] + length * memory.step[i]).clamp(problem.lower[i], problem.upper[i]);
                }
                let run = exact.run(goal, &mut memory.q, &mut memory.work, RUN, true);
                result.iterations += run.iterations + 1;
                let reached = sign * criterion.value(&memory.q);
                let holds =
                    run.position <= problem.tol_position && run.orientation <= problem.tol_orientation;
                if holds && reached < value {
                    value = reached;
                    result.q.copy_from_slice(&memory.q);
                    report(result, &run, Status::Converged);
                    moved = true;
                    break;
                }
                length *= 0.25;
            }
            if !moved {
                return;
            }
        }
    }
}

/// The target that starts are ranked by: with an orientation set, its member nearest to the target.
fn nominal(goal: &Goal<'_>) -> Pose {
    let mut pose = goal.target;
    if let Some(set) = goal.set {
        pose.rotation = nalgebra::Rotation3::new(way_in(set, &pose.rotation)) * pose.rotation;
    }
    pose
}

fn report(result: &mut IkResult, run: &NewtonRun, status: Status) {
    (result.position_error, result.orientation_error) = (run.position, run.orientation);
    result.status = status;
}
