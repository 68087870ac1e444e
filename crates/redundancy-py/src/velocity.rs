//! Velocity schemes and the closed loop around them.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;

use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyDict, PyTuple, PyType};
use redundancy_core::Error;
use redundancy_core::chain::Chain;
use redundancy_core::kinematics::{MiddleFrame, Scratch, Task};
use redundancy_core::planning::{Track, TrackSettings, track_beside};
use redundancy_core::scene::{LinkGeometry, Proximity, Surroundings};
use redundancy_core::velocity::{
    AccelerationInput, ContactSettings, Damping, ExtendedJacobian, Gain, LimitingPair, Metric,
    ProjectedGradient, ReducedGradient, Resolver, SaturatedNullspace, StepInput, WhenBlocked,
};

use crate::callback::{Failures, Watching};
use crate::chain::PyChain;
use crate::convert::{Argument, Given, read_vector, to_array};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::links::{PyLinkGeometry, SelfCollision, geometry_of};
use crate::path::PyPath;
use crate::plan::{PyPlan, plan_initializer, plan_of};
use crate::scene::{LINK_RADIUS, PyScene};
use crate::step::{PairText, PyAccelerationStep, PyStep};
use crate::task::{PyTask, read_task};
use crate::watch::watched;

/// Damped least squares with a separate factor for each singular value (Bettini et al. 2000, section 4.3).
///
/// `1/sigma` becomes `sigma / (sigma^2 + lambda^2)`, lambda rising smoothly from 0 at `threshold` to `maximum` at
/// `rho * threshold`. The paper's constants are `Damping(0.1, 0.2, 0.25)`; `"auto"` is `Damping(0.02, 0.04, 0.25)`:
/// the task is met exactly where the least singular value (units of metres and radians) is 0.04 or more.
///
/// Args:
///     maximum: Largest damping factor, > 0.
///     threshold: Singular values from here on are not damped, > 0.
///     rho: Share of the threshold below which the damping is full, in [0, 1).
#[pyclass(name = "Damping", module = "redundancy", frozen, eq, get_all)]
#[derive(PartialEq)]
pub struct PyDamping {
    /// Largest damping factor, in the unit of the singular values.
    maximum: f64,
    /// Singular values from here on, in the unit of the task Jacobian, are not damped.
    threshold: f64,
    /// Share of the threshold below which the damping is full.
    rho: f64,
}

#[pymethods]
impl PyDamping {
    #[new]
    fn new(maximum: f64, threshold: f64, rho: f64) -> PyResult<Self> {
        Damping { maximum, threshold, rho }.validate().map_err(to_py)?;
        Ok(Self { maximum, threshold, rho })
    }

    /// Squared damping factor of the singular value `sigma`.
    fn square(&self, sigma: f64) -> f64 {
        self.core().square(sigma)
    }

    fn __repr__(&self) -> String {
        let Self { maximum, threshold, rho } = self;
        format!("Damping(maximum={maximum:?}, threshold={threshold:?}, rho={rho:?})")
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        [self.maximum, self.threshold, self.rho].map(|x| (x + 0.0).to_bits()).hash(&mut hasher);
        hasher.finish()
    }

    fn __getnewargs__(&self) -> (f64, f64, f64) {
        (self.maximum, self.threshold, self.rho)
    }
}

impl PyDamping {
    fn core(&self) -> Damping {
        Damping { maximum: self.maximum, threshold: self.threshold, rho: self.rho }
    }
}

/// `"auto"`, `None` or a `Damping`.
fn read_damping(damping: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Damping>> {
    let Some(damping) = damping else { return Ok(None) };
    if let Ok(damping) = damping.cast::<PyDamping>() {
        return Ok(Some(damping.get().core()));
    }
    if damping.extract::<&str>().is_ok_and(|word| word == "auto") {
        return Ok(Some(Damping::default()));
    }
    let message = format!("damping is {}, expected \"auto\", None or a Damping", damping.repr()?);
    Err(to_py(Error::Invalid(message)))
}

/// A number or `"optimal"`.
fn read_gain(gain: &Bound<'_, PyAny>) -> PyResult<Gain> {
    if let Ok(number) = gain.extract::<f64>() {
        return Ok(Gain::Constant(number));
    }
    if gain.extract::<&str>().is_ok_and(|word| word == "optimal") {
        return Ok(Gain::Optimal);
    }
    Err(to_py(Error::Invalid(format!("gain is {}, expected a number or \"optimal\"", gain.repr()?))))
}

/// Whether a scheme is one of the acceleration level.
fn at_acceleration_level(level: &str) -> PyResult<bool> {
    let known = ["velocity", "acceleration"];
    if !known.contains(&level) {
        let valid = known.map(String::from).to_vec();
        return Err(to_py(Error::UnknownName { kind: "level", name: level.into(), valid }));
    }
    Ok(level == known[1])
}

/// How joint velocities are measured.
fn read_metric(inverse: &str, weights: Option<Vec<f64>>) -> PyResult<Metric> {
    match (inverse, weights) {
        ("pseudo", None) => Ok(Metric::Identity),
        ("pseudo", Some(weights)) => Ok(Metric::Weights(weights)),
        ("inertia", None) => Ok(Metric::Inertia),
        ("inertia", Some(_)) => {
            Err(to_py(Error::Invalid("weights: only for inverse=\"pseudo\", not for \"inertia\"".into())))
        }
        (name, _) => {
            let valid = ["pseudo", "inertia"].map(String::from).to_vec();
            Err(to_py(Error::UnknownName { kind: "inverse", name: name.into(), valid }))
        }
    }
}

fn read_criterion(
    criterion: Option<&Bound<'_, PyCriterion>>,
) -> Option<std::sync::Arc<dyn redundancy_core::criterion::Criterion>> {
    criterion.map(|criterion| criterion.get().criterion.clone())
}

/// A scheme that computes a joint velocity from a task velocity, step by step.
///
/// A step allocates nothing in the core. A resolver may be shared by threads; the reduced gradient keeps its basis
/// from step to step.
#[pyclass(name = "Resolver", module = "redundancy", frozen, subclass)]
pub struct PyResolver {
    resolver: Mutex<Box<dyn Resolver>>,
    chain: Py<PyChain>,
    /// Class and arguments that make it again.
    recipe: Py<PyTuple>,
    text: String,
    /// Exceptions of the functions of the user's that its criterion evaluates.
    failures: Vec<Arc<Failures>>,
    /// The thread that is in a step whose criterion may call Python.
    busy: Mutex<Option<ThreadId>>,
}

impl PyResolver {
    /// `arguments` start with the chain; `class` makes the same from them.
    fn of(
        class: Bound<'_, PyType>,
        arguments: Bound<'_, PyTuple>,
        chain: &Bound<'_, PyChain>,
        resolver: impl Resolver + 'static,
    ) -> PyResult<Self> {
        let py = class.py();
        // Schemes without a criterion have none, or `None`, in that place.
        let given = arguments.get_item(1).ok().and_then(|given| given.cast_into::<PyCriterion>().ok());
        let (criterion, failures) = match &given {
            Some(given) => (format!(", {}", given.repr()?), given.get().failures.clone()),
            None => (String::new(), Vec::new()),
        };
        let (name, task) = (chain.get().chain.name(), resolver.task().kind());
        let text = format!("{}({name}{criterion}, task='{task}')", class.name()?);
        let recipe = PyTuple::new(py, [class.into_any(), arguments.into_any()])?.unbind();
        Ok(Self {
            resolver: Mutex::new(Box::new(resolver)),
            chain: chain.clone().unbind(),
            recipe,
            text,
            failures,
            busy: Mutex::new(None),
        })
    }

    /// The scheme. While its criterion runs Python code, other threads wait for it without the GIL.
    fn lock(&self, py: Python<'_>) -> MutexGuard<'_, Box<dyn Resolver>> {
        self.resolver.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs a step, which may not be called again from its own criterion.
    fn alone<T>(&self, step: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
        if self.failures.is_empty() {
            return step();
        }
        let here = Some(std::thread::current().id());
        let set = |to| std::mem::replace(&mut *self.busy.lock().unwrap_or_else(PoisonError::into_inner), to);
        if *self.busy.lock().unwrap_or_else(PoisonError::into_inner) == here {
            let message = "the CustomCriterion of a resolver called this resolver's step".to_owned();
            return Err(to_py(Error::Invalid(message)));
        }
        let before = set(here);
        let done = step();
        set(before);
        done
    }
}

impl Argument for PyResolver {
    const WHAT: &'static str = "a resolver";
    const HOW: &'static str = "for example rd.ProjectedGradient(chain, criterion, gain)";
}

#[pymethods]
impl PyResolver {
    /// One step.
    ///
    /// Args:
    ///     q: Joint positions `(n,)`, rad or m.
    ///     task_velocity: As many numbers as the task has coordinates, m/s and rad/s; six for `pointing`, whose
    ///         spin about the tool axis does not count.
    ///     dt: Length of the step, s; needed for limits and for the optimal gain.
    ///     qd: Joint velocity before the step `(n,)`; without it acceleration is not limited.
    ///     wish: Joint velocity `(n,)`, rad/s or m/s, that the freedom is used for in place of the criterion's
    ///         gradient; neither criterion nor gain counts then.
    ///     t: Time, s, for obstacles that move.
    ///
    /// Raises:
    ///     RedundancyError: Wrong sizes, numbers that are not finite, `dt` that is not positive or is missing. An
    ///         exception of a `CustomCriterion` is raised as it is.
    #[pyo3(signature = (q, task_velocity, dt=None, qd=None, wish=None, *, t=0.0))]
    fn step(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        task_velocity: &Bound<'_, PyAny>,
        dt: Option<f64>,
        qd: Option<&Bound<'_, PyAny>>,
        wish: Option<&Bound<'_, PyAny>>,
        t: f64,
    ) -> PyResult<PyStep> {
        if !t.is_finite() {
            return Err(to_py(Error::NotFinite { what: "t".into(), index: 0, value: t }));
        }
        let q = read_vector(q, "q", None)?;
        let velocity = read_vector(task_velocity, "task_velocity", None)?;
        let before = qd.map(|qd| read_vector(qd, "qd", None)).transpose()?;
        let wish = wish.map(|wish| read_vector(wish, "wish", None)).transpose()?;
        let mut out = vec![0.0; q.len()];
        let input =
            StepInput { q: &q, velocity: &velocity, dt, qd: before.as_deref(), wish: wish.as_deref() };
        let watching = Watching::new(&self.failures);
        let (report, resolver) = self.alone(|| {
            let mut resolver = self.lock(py);
            resolver.set_time(t);
            let report = resolver.step(&input, &mut out);
            watching.check(py)?;
            Ok((report.map_err(to_py)?, resolver))
        })?;
        let (active, task) = (resolver.active_limits().to_vec(), *resolver.task());
        let named = |pair: &LimitingPair| -> PairText {
            let name = |thing| resolver.surroundings().map(|around| around.name(thing)).unwrap_or_default();
            (name(pair.first), name(pair.second), pair.distance)
        };
        let pairs = resolver.limiting_pairs().iter().map(named).collect();
        drop(resolver);
        Ok(PyStep { qd: out, q, report, active, pairs, chain: self.chain.clone_ref(py), task })
    }

    /// One step of a scheme with `level="acceleration"`: `J qdd + Jdot qd = task_acceleration`.
    ///
    /// Args:
    ///     q: Joint positions `(n,)`, rad or m.
    ///     qd: Joint velocity `(n,)`.
    ///     task_acceleration: As many numbers as a task velocity, m/s^2 and rad/s^2 (base axes): of the tool's origin
    ///         and of its angular velocity; for `pose_rpy` the second derivatives of the angles.
    ///     dt: Length of the step, s; only a `schedule` needs it.
    ///     wish: Joint velocity `(n,)` that the null-space motion approaches in place of the criterion's gradient.
    ///
    /// Raises:
    ///     RedundancyError: A scheme of the velocity level, wrong sizes, numbers that are not finite.
    #[pyo3(signature = (q, qd, task_acceleration, dt=None, wish=None))]
    fn step_acceleration(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        qd: &Bound<'_, PyAny>,
        task_acceleration: &Bound<'_, PyAny>,
        dt: Option<f64>,
        wish: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyAccelerationStep> {
        let (q, qd) = (read_vector(q, "q", None)?, read_vector(qd, "qd", None)?);
        let acceleration = read_vector(task_acceleration, "task_acceleration", None)?;
        let wish = wish.map(|wish| read_vector(wish, "wish", None)).transpose()?;
        let mut qdd = vec![0.0; q.len()];
        let input =
            AccelerationInput { q: &q, qd: &qd, acceleration: &acceleration, dt, wish: wish.as_deref() };
        let watching = Watching::new(&self.failures);
        let report = self.alone(|| {
            let report = self.lock(py).step_acceleration(&input, &mut qdd);
            watching.check(py)?;
            report.map_err(to_py)
        })?;
        Ok(PyAccelerationStep { qdd, report })
    }

    /// `"velocity"` or `"acceleration"`.
    #[getter]
    fn level(&self, py: Python<'_>) -> &'static str {
        if self.lock(py).velocity_gain().is_some() { "acceleration" } else { "velocity" }
    }

    /// The chain that it was made for.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// Which coordinates count.
    #[getter]
    fn task(&self, py: Python<'_>) -> PyTask {
        PyTask { task: *self.lock(py).task() }
    }

    /// Dependent joints of the last step, from 0; empty for schemes that have none.
    #[getter]
    fn basis(&self, py: Python<'_>) -> Vec<usize> {
        self.lock(py).basis().to_vec()
    }

    /// The Jacobian in whose coordinates the scheme solves.
    ///
    /// Args:
    ///     q: Joint positions `(n,)`, rad or m.
    ///
    /// Returns:
    ///     `(m, n)`: that of the task; with `frame=` the one about the origin and in the axes of that link (Bettini,
    ///     De Luca, Oriolo 2000, eq. 7). Its singular values determine the damping and the choice of a basis.
    ///
    /// Raises:
    ///     RedundancyError: A wrong size, or numbers that are not finite.
    fn jacobian<'py>(&self, py: Python<'py>, q: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let q = read_vector(q, "q", None)?;
        let resolver = self.lock(py);
        let (chain, task) = (resolver.chain(), *resolver.task());
        let (m, n) = (task.dim(), chain.dof());
        let columns = match resolver.frame() {
            Some(link) => {
                let frame = MiddleFrame::new(chain, &task, link).map_err(to_py)?;
                frame.jacobian(chain, &q).map_err(to_py)?.as_slice().to_vec()
            }
            None => {
                let mut scratch = Scratch::new(chain);
                let kinematics = chain.kinematics(&q, &mut scratch).map_err(to_py)?;
                let mut out = vec![0.0; m * n];
                task.write_jacobian(&kinematics, &mut out);
                out
            }
        };
        let rows: Vec<f64> = (0..m * n).map(|k| columns[k % n * m + k / n]).collect();
        to_array(py, &rows, [m, n])
    }

    /// The link in whose frame the scheme works; None for the coordinates of the task.
    #[getter]
    fn frame(&self, py: Python<'_>) -> Option<String> {
        let resolver = self.lock(py);
        resolver.frame().map(|link| resolver.chain().links()[link].name.clone())
    }

    fn __repr__(&self) -> &str {
        &self.text
    }

    fn __reduce__(&self, py: Python<'_>) -> Py<PyTuple> {
        self.recipe.clone_ref(py)
    }
}

/// Projected gradient (Bettini, De Luca, Oriolo 2000, eq. 2): `qd = J^+ v + (I - J^+ J) eta`.
///
/// `eta` is the gain times the gradient of the criterion, with minus for one to be minimised and plus for one to be
/// maximised. Near singularities J^+ is damped; the projector stays exact, so the null-space motion never moves the
/// tool.
///
/// Args:
///     chain: The arm.
///     criterion: Objective for the freedom; None for the least joint velocity.
///     gain: Joint velocity per unit of the gradient, >= 0, or `"optimal"`: the step with the best value of the
///         criterion after `dt` within position and velocity limits (section 4.4).
///     task: Which coordinates count; `pose` by default.
///     damping: `"auto"`, a `Damping`, or None for off.
///     frame: Name of a link. The six coordinates of `pose` or `pose_rpy` are then transformed internally to its axes
///         and origin (eq. 7), so that damping acts on the singular values of that Jacobian. Velocities and task
///         errors are given as before.
///     level: `"velocity"`, or `"acceleration"`: then `step_acceleration` gives
///         `qdd = J^+ (a - Jdot qd) + (I - J^+ J) velocity_gain (eta - qd)`, and joint velocities have no jumps.
///     velocity_gain: Rate, 1/s, at which the acceleration level approaches the joint velocity of the velocity level.
///     inverse: `"pseudo"`: the least joint velocity (or acceleration). `"inertia"`: the least kinetic energy, with the
///         mass matrix M in `M^-1 J^T (J M^-1 J^T)^-1`; at acceleration level this is Khatib's dynamically consistent
///         inverse, whose null-space motion exerts no force on the tool. The projector changes with it.
///     weights: `(n,)`, positive: the least `sum w_i qd_i^2`, for `inverse="pseudo"`.
///
/// Raises:
///     RedundancyError: A task with more coordinates than joints, a criterion of another arm, a gain that is negative
///         or not finite, an unknown link, a `frame` for another task.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("iiwa14")
///     >>> scheme = rd.ProjectedGradient(arm, rd.JointRange(arm), 10.0)
///     >>> q = [0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4]
///     >>> bool(abs(arm.jacobian(q) @ scheme.step(q, [0.0] * 6).qd).max() < 1e-12)
///     True
#[pyclass(name = "ProjectedGradient", module = "redundancy", frozen, extends = PyResolver)]
pub struct PyProjectedGradient;

#[pymethods]
impl PyProjectedGradient {
    #[new]
    #[pyo3(signature = (chain, criterion, gain, task=None, damping=Some("auto".into()), *, frame=None,
        level="velocity", velocity_gain=10.0, inverse="pseudo", weights=None),
    text_signature = "(chain, criterion, gain, task=None, damping=\"auto\", *, frame=None, level=\"velocity\", \
        velocity_gain=10.0, inverse=\"pseudo\", weights=None)")]
    fn new(
        chain: &Bound<'_, PyChain>,
        criterion: Option<Given<'_, PyCriterion>>,
        gain: &Bound<'_, PyAny>,
        task: Option<&Bound<'_, PyAny>>,
        damping: Option<WordOr>,
        frame: Option<&str>,
        level: &str,
        velocity_gain: f64,
        inverse: &str,
        weights: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let weights = weights.map(|weights| read_vector(weights, "weights", None)).transpose()?;
        let damping = bound(py, damping);
        let task = task.map_or(Ok(Task::POSE), read_task)?;
        let mut resolver = ProjectedGradient::new(
            &chain.get().chain,
            read_criterion(criterion.as_deref()),
            read_gain(gain)?,
            task,
            read_damping(damping.as_ref())?,
        )
        .map_err(to_py)?;
        if let Some(frame) = frame {
            let link = chain.get().chain.link_index(frame).map_err(to_py)?;
            resolver = resolver.in_frame(link).map_err(to_py)?;
        }
        resolver = resolver.with_metric(read_metric(inverse, weights.clone())?).map_err(to_py)?;
        if at_acceleration_level(level)? {
            resolver = resolver.at_acceleration_level(velocity_gain).map_err(to_py)?;
        }
        let make = py.get_type::<Self>().getattr("_make")?;
        let arguments =
            (chain, criterion, gain, PyTask { task }, damping, frame, level, velocity_gain, inverse, weights)
                .into_pyobject(py)?;
        let mut base = PyResolver::of(py.get_type::<Self>(), arguments.clone(), chain, resolver)?;
        base.recipe = PyTuple::new(py, [make, arguments.into_any()])?.unbind();
        Ok(PyClassInitializer::from(base).add_subclass(Self))
    }

    /// Inverse of pickling: all arguments by place.
    #[staticmethod]
    fn _make<'py>(
        chain: &Bound<'py, PyChain>,
        criterion: Option<Given<'py, PyCriterion>>,
        gain: &Bound<'py, PyAny>,
        task: &Bound<'py, PyAny>,
        damping: Option<WordOr>,
        frame: Option<&str>,
        level: &str,
        velocity_gain: f64,
        inverse: &str,
        weights: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, Self>> {
        let made = Self::new(
            chain,
            criterion,
            gain,
            Some(task),
            damping,
            frame,
            level,
            velocity_gain,
            inverse,
            weights,
        )?;
        Bound::new(chain.py(), made)
    }
}

/// Reduced gradient (Bettini, De Luca, Oriolo 2000, eq. 4).
///
/// The dependent joints follow the task, the others the reduced gradient; at equal gain this converges faster than
/// the projected gradient. Without `basis` the dependent joints are chosen automatically, and exchanged before their
/// Jacobian becomes singular (with hysteresis, blended over three steps, and reported).
///
/// Args:
///     chain: The arm.
///     criterion: As for `ProjectedGradient`.
///     gain: As for `ProjectedGradient`.
///     task: Which coordinates count; `pose` by default.
///     damping: As for `ProjectedGradient`; acts only where no basis is well conditioned.
///     basis: Dependent joints, from 0, as many as the task has coordinates; they are then kept. The paper's DEXTER
///         with "columns 2 and 7 deleted" is `(0, 2, 3, 4, 5, 7)`.
///     frame: As for `ProjectedGradient`: the paper's DEXTER works in `"link4"`.
///     form: `"robust"`: the null-space motion never moves the tool. `"paper"`: eq. 4 as printed, with the damped
///         inverse also in `J_R`, so that under damping it does.
///     schedule: `[(time, basis), ...]`: other bases from these times on, s, counted from the first step, each blended
///         over three steps and reported. Needs `basis` for the start, and `dt` in every step.
///     level: `"velocity"`, or `"acceleration"`: then `step_acceleration` gives joint accelerations; the independent
///         joints accelerate by `velocity_gain` times what they lack of the reduced gradient. A change of basis changes
///         the acceleration, and joint velocities have no jumps.
///     velocity_gain: That rate, 1/s.
///
/// Raises:
///     RedundancyError: As for `ProjectedGradient`; a basis of another size, with a repeated joint or one that does
///         not exist; a schedule without `basis`, or whose times do not ascend; an unknown form.
#[pyclass(name = "ReducedGradient", module = "redundancy", frozen, extends = PyResolver)]
pub struct PyReducedGradient;

#[pymethods]
impl PyReducedGradient {
    #[new]
    #[pyo3(signature = (chain, criterion, gain, task=None, damping=Some("auto".into()), basis=None, *,
                        frame=None, form="robust", schedule=None, level="velocity", velocity_gain=10.0),
    text_signature = "(chain, criterion, gain, task=None, damping=\"auto\", basis=None, *, frame=None, form=\"robust\", \
        schedule=None, level=\"velocity\", velocity_gain=10.0)")]
    fn new(
        chain: &Bound<'_, PyChain>,
        criterion: Option<Given<'_, PyCriterion>>,
        gain: &Bound<'_, PyAny>,
        task: Option<&Bound<'_, PyAny>>,
        damping: Option<WordOr>,
        basis: Option<Vec<i64>>,
        frame: Option<&str>,
        form: &str,
        schedule: Option<Vec<(f64, Vec<i64>)>>,
        level: &str,
        velocity_gain: f64,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let damping = bound(py, damping);
        let task = task.map_or(Ok(Task::POSE), read_task)?;
        let joints = basis.as_deref().map(read_basis).transpose()?;
        let mut resolver = ReducedGradient::new(
            &chain.get().chain,
            read_criterion(criterion.as_deref()),
            read_gain(gain)?,
            task,
            read_damping(damping.as_ref())?,
            joints.as_deref(),
        )
        .map_err(to_py)?;
        if let Some(frame) = frame {
            let link = chain.get().chain.link_index(frame).map_err(to_py)?;
            resolver = resolver.in_frame(link).map_err(to_py)?;
        }
        match form {
            "robust" => {}
            "paper" => resolver = resolver.as_printed(),
            name => {
                let valid = ["robust", "paper"].map(String::from).to_vec();
                return Err(to_py(Error::UnknownName { kind: "form", name: name.into(), valid }));
            }
        }
        if let Some(changes) = &schedule {
            let read = |(time, basis): &(f64, Vec<i64>)| Ok((*time, read_basis(basis)?));
            let changes = changes.iter().map(read).collect::<PyResult<Vec<_>>>()?;
            let changes: Vec<_> = changes.iter().map(|(time, basis)| (*time, &basis[..])).collect();
            resolver = resolver.with_schedule(&changes).map_err(to_py)?;
        }
        if at_acceleration_level(level)? {
            resolver = resolver.at_acceleration_level(velocity_gain).map_err(to_py)?;
        }
        let make = py.get_type::<Self>().getattr("_make")?;
        let task = PyTask { task };
        let arguments =
            (chain, criterion, gain, task, damping, basis, frame, form, schedule, level, velocity_gain)
                .into_pyobject(py)?;
        let mut base = PyResolver::of(py.get_type::<Self>(), arguments.clone(), chain, resolver)?;
        base.recipe = PyTuple::new(py, [make, arguments.into_any()])?.unbind();
        Ok(PyClassInitializer::from(base).add_subclass(Self))
    }

    /// Inverse of pickling: all arguments by place.
    #[staticmethod]
    fn _make<'py>(
        chain: &Bound<'py, PyChain>,
        criterion: Option<Given<'py, PyCriterion>>,
        gain: &Bound<'py, PyAny>,
        task: &Bound<'py, PyAny>,
        damping: Option<WordOr>,
        basis: Option<Vec<i64>>,
        frame: Option<&str>,
        form: &str,
        schedule: Option<Vec<(f64, Vec<i64>)>>,
        level: &str,
        velocity_gain: f64,
    ) -> PyResult<Bound<'py, Self>> {
        let task = Some(task);
        let made = Self::new(
            chain,
            criterion,
            gain,
            task,
            damping,
            basis,
            frame,
            form,
            schedule,
            level,
            velocity_gain,
        )?;
        Bound::new(chain.py(), made)
    }
}

/// Extended Jacobian (Park, Chung, Youm 1996, eq. 5): the freedom is used to keep the criterion stationary.
///
/// Started at a stationary point it follows that point, so closed paths are cyclic. The task has priority: where the
/// condition loses rank (an algorithmic singularity), only the null-space motion is damped, and this is reported.
///
/// Args:
///     chain: The arm.
///     criterion: A criterion with a Hessian.
///     task: Which coordinates count; `pose` by default.
///     gain: Rate, 1/s, at which the arm approaches the stationary point.
///     damping: As for `ProjectedGradient`.
#[pyclass(name = "ExtendedJacobian", module = "redundancy", frozen, extends = PyResolver)]
pub struct PyExtendedJacobian;

#[pymethods]
impl PyExtendedJacobian {
    #[new]
    #[pyo3(signature = (chain, criterion, task=None, *, gain=10.0, damping=Some("auto".into())),
    text_signature = "(chain, criterion, task=None, *, gain=10.0, damping=\"auto\")")]
    fn new(
        chain: &Bound<'_, PyChain>,
        criterion: Given<'_, PyCriterion>,
        task: Option<&Bound<'_, PyAny>>,
        gain: f64,
        damping: Option<WordOr>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let damping = bound(py, damping);
        let task = task.map_or(Ok(Task::POSE), read_task)?;
        let h = criterion.get().criterion.clone();
        let damper = read_damping(damping.as_ref())?;
        let resolver = ExtendedJacobian::new(&chain.get().chain, h, gain, task, damper).map_err(to_py)?;
        let make = py.get_type::<Self>().getattr("_make")?;
        let arguments = (chain, criterion, PyTask { task }, gain, damping).into_pyobject(py)?;
        let mut base = PyResolver::of(py.get_type::<Self>(), arguments.clone(), chain, resolver)?;
        base.recipe = PyTuple::new(py, [make, arguments.into_any()])?.unbind();
        Ok(PyClassInitializer::from(base).add_subclass(Self))
    }

    /// Inverse of pickling: all arguments by place.
    #[staticmethod]
    fn _make<'py>(
        chain: &Bound<'py, PyChain>,
        criterion: Given<'py, PyCriterion>,
        task: &Bound<'py, PyAny>,
        gain: f64,
        damping: Option<WordOr>,
    ) -> PyResult<Bound<'py, Self>> {
        Bound::new(chain.py(), Self::new(chain, criterion, Some(task), gain, damping)?)
    }
}

/// Hard limits: the largest scale of the task velocity within the limits, then the best null-space motion.
///
/// Saturation in the null space in its optimal form (Flacco, De Luca, Khatib 2015). Position limits (with the
/// distance that braking takes), velocity limits and, when `step` gets `qd`, acceleration limits of the chain hold at
/// every step of length `dt`; if they contradict each other, position has priority over velocity, and velocity over
/// acceleration. A joint outside its limits is brought back. If no scale is feasible, because joints have to brake,
/// the scale is 0 and the tool moves as closely to the task velocity as the bounds allow. Among the joint velocities
/// with the largest scale, the one nearest to the gain times the gradient of the criterion is taken.
///
/// With `scene` or `links` distances are hard bounds too: for a pair at distance d with gradient g `g . qd >=
/// -min(alpha (d - safe_distance), sqrt(2 a_d (d - safe_distance))) - dd/dt`, alpha the barrier rate (at most
/// `1 / dt`), a_d the deceleration along g that the acceleration limits allow, dd/dt the change due to the obstacle's
/// own motion. Below the safe distance only the first term counts, which moves the pair apart. If bounds contradict
/// each other, position has priority, then distances, velocity, acceleration. `Step.limiting_pairs` says which pairs
/// limited a step.
///
/// Args:
///     chain: The arm with its limits.
///     criterion: Objective for the freedom; None for the least joint velocity.
///     gain: Joint velocity per unit of the gradient, >= 0.
///     task: Which coordinates count; `pose` by default.
///     damping: As for `ProjectedGradient`; off by default, because near singularities the task is scaled.
///     when_blocked: What becomes of a task that no scale above zero realises within the limits. `"stop"`: the tool
///         stops (unless a joint has to brake). `"closest"`: it moves with the least task error `|J qd - v|` that the
///         limits allow, among those joint velocities with the one nearest to the null-space wish; `scale` is 0 and
///         `residual` that error.
///     scene: Obstacles to keep a distance from.
///     links: Shapes of the links; capsules of 0.05 m from joint to joint when left out.
///     safe_distance: Distance that is kept, m.
///     barrier_rate: Largest rate at which the remaining distance to it may shrink, 1/s.
///     self_collision: Whether links keep a distance from each other; `"auto"`: if `links` has pairs.
#[pyclass(name = "SaturatedNullspace", module = "redundancy", frozen, extends = PyResolver)]
pub struct PySaturatedNullspace;

#[pymethods]
impl PySaturatedNullspace {
    #[new]
    #[pyo3(signature = (chain, criterion=None, gain=1.0, task=None, damping=None, *, when_blocked="stop", scene=None,
        links=None, safe_distance=0.02, barrier_rate=5.0, self_collision=None),
        text_signature = "(chain, criterion=None, gain=1.0, task=None, damping=None, *, when_blocked='stop', \
            scene=None, links=None, safe_distance=0.02, barrier_rate=5.0, self_collision='auto')")]
    fn new(
        chain: &Bound<'_, PyChain>,
        criterion: Option<Given<'_, PyCriterion>>,
        gain: f64,
        task: Option<&Bound<'_, PyAny>>,
        damping: Option<&Bound<'_, PyAny>>,
        when_blocked: &str,
        scene: Option<Given<'_, PyScene>>,
        links: Option<&Bound<'_, PyLinkGeometry>>,
        safe_distance: f64,
        barrier_rate: f64,
        self_collision: Option<SelfCollision>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let task = task.map_or(Ok(Task::POSE), read_task)?;
        let arm = &chain.get().chain;
        let mut resolver = SaturatedNullspace::new(
            arm,
            read_criterion(criterion.as_deref()),
            Gain::Constant(gain),
            task,
            read_damping(damping)?,
        )
        .map_err(to_py)?
        .when_blocked(WhenBlocked::from_name(when_blocked).map_err(to_py)?);
        let around = surroundings_of(arm, scene.as_deref(), links, self_collision)?;
        let decided = around.as_ref().map(|(_, own)| *own);
        if let Some((around, _)) = around {
            let settings = ContactSettings { safe_distance, barrier_rate };
            resolver = resolver.with_contacts(around, settings).map_err(to_py)?;
        }
        let arguments = (chain, criterion, gain, PyTask { task }, damping).into_pyobject(py)?;
        let base = PyResolver::of(py.get_type::<Self>(), arguments.clone(), chain, resolver)?;
        let options = PyDict::new(py);
        options.set_item("when_blocked", when_blocked)?;
        if let Some(own) = decided {
            options.set_item("scene", scene)?;
            options.set_item("links", links)?;
            options.set_item("safe_distance", safe_distance)?;
            options.set_item("barrier_rate", barrier_rate)?;
            options.set_item("self_collision", own)?;
        }
        let make =
            py.import("functools")?.getattr("partial")?.call((py.get_type::<Self>(),), Some(&options))?;
        let base = PyResolver { recipe: PyTuple::new(py, [make, arguments.into_any()])?.unbind(), ..base };
        Ok(PyClassInitializer::from(base).add_subclass(Self))
    }
}

/// What a scene and links make, and whether links are looked at; `None` without either.
pub(crate) fn surroundings_of(
    chain: &Chain,
    scene: Option<&Bound<'_, PyScene>>,
    links: Option<&Bound<'_, PyLinkGeometry>>,
    self_collision: Option<SelfCollision>,
) -> PyResult<Option<(Surroundings, bool)>> {
    let given = links.map(|links| geometry_of(links, chain)).transpose()?;
    let own = SelfCollision::decided(self_collision, given.as_ref())?;
    if scene.is_none() && !own {
        return Ok(None);
    }
    let geometry = match given {
        Some(given) => given,
        None => {
            let capsules = LinkGeometry::joint_to_joint(chain, LINK_RADIUS).map_err(to_py)?;
            if own { capsules.with_capsule_pairs(chain).map_err(to_py)? } else { capsules }
        }
    };
    let scene = scene.map(|scene| &scene.get().scene);
    Ok(Some((Surroundings::new(chain, &geometry, scene, own).map_err(to_py)?, own)))
}

/// A default that is a word, or what the caller gave.
#[derive(FromPyObject)]
enum WordOr {
    Word(String),
    Object(Py<PyAny>),
}

impl From<&str> for WordOr {
    fn from(word: &str) -> Self {
        Self::Word(word.into())
    }
}

fn bound(py: Python<'_>, value: Option<WordOr>) -> Option<Bound<'_, PyAny>> {
    value.map(|value| match value {
        WordOr::Word(word) => pyo3::types::PyString::new(py, &word).into_any(),
        WordOr::Object(object) => object.into_bound(py),
    })
}

fn read_basis(basis: &[i64]) -> PyResult<Vec<usize>> {
    let joint = |joint: &i64| {
        usize::try_from(*joint).map_err(|_| {
            let (what, bound) = ("joint of the basis".into(), ">= 0".into());
            to_py(Error::OutOfRange { what, value: *joint as f64, bound })
        })
    };
    basis.iter().map(joint).collect()
}

/// The result of following a path in closed loop, one row every `dt`.
///
/// `converged`; `off_path`: farther from the path than the tolerance (the reason gives the largest error and its
/// row); `limits`: a joint violates a position or speed limit; `collision`: contact; `time_limit`: the rows so far.
#[pyclass(name = "Track", module = "redundancy", frozen, extends = PyPlan)]
pub struct PyTrack {
    position_error: f64,
    orientation_error: f64,
}

#[pymethods]
impl PyTrack {
    /// Largest distance from the path, m, in the coordinates of the task.
    #[getter]
    fn position_error(&self) -> f64 {
        self.position_error
    }

    /// Largest angle from the path, rad.
    #[getter]
    fn orientation_error(&self) -> f64 {
        self.orientation_error
    }

    fn __repr__(this: &Bound<'_, Self>) -> String {
        let (plan, own) = (&this.as_super().get().plan, this.get());
        let reason = if plan.reason().is_empty() { String::new() } else { format!(": {}", plan.reason()) };
        let (position, orientation) = (own.position_error, own.orientation_error);
        format!(
            "Track({} rows, {}, off by at most {position:.3e} m and {orientation:.3e} rad{reason})",
            plan.rows(),
            plan.status()
        )
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (own, arrays) = (this.get(), PyPlan::everything(this.as_super())?);
        let arguments = (arrays, own.position_error, own.orientation_error);
        Ok((this.get_type().getattr("_make")?, arguments.into_pyobject(this.py())?))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _make<'py>(
        arrays: &Bound<'py, PyAny>,
        position_error: f64,
        orientation_error: f64,
    ) -> PyResult<Bound<'py, Self>> {
        let plan = plan_of(arrays)?;
        let track = Self { position_error, orientation_error };
        Bound::new(arrays.py(), plan_initializer(plan).add_subclass(track))
    }
}

/// Follows a path in closed loop: `v = v_path(t) + feedback * error`, `q += dt * qd`.
///
/// The resolver is copied, so a run does not disturb its state. A path without times gets them first, such that the
/// least joint motion along it uses at most half of the velocity limits.
///
/// Args:
///     chain: The arm, the one that the resolver was made for.
///     resolver: The scheme.
///     path: Poses, or positions for the tasks `position` and `planar`.
///     q0: Joint positions at the start `(n,)`.
///     dt: Length of a step, s.
///     feedback: Gain of the task error, 1/s; below `2 / dt`.
///     tolerance: Largest allowed distance (m) and angle (rad) from the path (1e-3, 1e-2).
///     scene: Obstacles. With them (or links) each row has its clearance, and contact in the rows or between them is
///         an event and the status `collision`. By default those of a resolver that keeps distances.
///     links: Shapes of the links; capsules of 0.05 m from joint to joint when left out.
///     self_collision: Whether links must not touch each other; `"auto"`: if `links` has pairs.
///     progress: Called with the share of the work done.
///     time_limit: Seconds after which the rows so far are returned; `None` is off.
///
/// Returns:
///     A trajectory with the events `basis_change`, `damping`, `limit` (which joint, which limit), `scaled`,
///     `kinematic_singularity`, `algorithmic_singularity`, `joint_limit` (a joint beyond its limits), `contact`.
///
/// Raises:
///     RedundancyError: Wrong sizes, invalid settings, another chain, a path without orientations for a task that
///         needs them.
#[pyfunction(name = "track")]
#[pyo3(signature = (chain, resolver, path, q0, dt, feedback=5.0, *, tolerance=None, scene=None, links=None,
    self_collision=None, progress=None, time_limit=None),
    text_signature = "(chain, resolver, path, q0, dt, feedback=5.0, *, tolerance=None, scene=None, links=None, \
        self_collision='auto', progress=None, time_limit=None)")]
pub fn py_track<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    resolver: Given<'py, PyResolver>,
    path: Given<'py, PyPath>,
    q0: &Bound<'py, PyAny>,
    dt: f64,
    feedback: f64,
    tolerance: Option<(f64, f64)>,
    scene: Option<Given<'py, PyScene>>,
    links: Option<&Bound<'py, PyLinkGeometry>>,
    self_collision: Option<SelfCollision>,
    progress: Option<Py<PyAny>>,
    time_limit: Option<f64>,
) -> PyResult<Bound<'py, PyTrack>> {
    let watching = Watching::new(&resolver.get().failures);
    let resolver = resolver.get().lock(py).boxed();
    if chain.get().chain != *resolver.chain() {
        let (a, b) = (chain.get().chain.name(), resolver.chain().name());
        let message = format!("the resolver was made for another chain ('{b}') than the one given ('{a}')");
        return Err(to_py(Error::Invalid(message)));
    }
    let q0 = read_vector(q0, "q0", None)?;
    let mut settings = TrackSettings::new(dt, feedback);
    if let Some(tolerance) = tolerance {
        (settings.position_tolerance, settings.orientation_tolerance) = tolerance;
    }
    let path = &path.get().path;
    let given = surroundings_of(resolver.chain(), scene.as_deref(), links, self_collision)?;
    let around = given.as_ref().map(|(around, _)| around).or(resolver.surroundings());
    let done = watched(py, progress, time_limit, |watch| {
        track_beside(&*resolver, path, &q0, &settings, around, watch)
    });
    watching.check(py)?;
    let done = done?;
    let Track { plan, position_error, orientation_error } = done;
    let track = PyTrack { position_error, orientation_error };
    Bound::new(py, plan_initializer(plan).add_subclass(track))
}
