//! Tasks with strict priorities.

use std::sync::{Mutex, PoisonError};

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::Error;
use redundancy_core::Status;
use redundancy_core::chain::Chain;
use redundancy_core::velocity::{ActiveLimit, PrioritizedNullspace, PriorityTask, StepInput};

use crate::callback::{Failures, Watching};
use crate::chain::PyChain;
use crate::convert::{Given, read_array, read_vector};
use crate::criterion::{PyCriterion, partial};
use crate::error::to_py;
use crate::plan::read_chain;
use crate::status::status_to_py;
use crate::step::limit_names;
use crate::task::read_task;

/// Several tasks with strict priorities within hard limits.
///
/// Level by level: the largest scale in [0, 1] of that task's velocity that the limits and the tasks above allow, then
/// the next; last the joint velocity nearest to the wish. All problems are solved exactly; a step allocates nothing in
/// the core. Limits are those of `SaturatedNullspace`: position (with the distance that braking takes), velocity and,
/// when `step` gets `qd`, acceleration.
///
/// - Where the tasks above leave a task less freedom than it has coordinates, it is met as nearly as they allow (least
///   squares): the elbow's position below a full pose moves the elbow along its circle. `residuals` says what is
///   missing.
/// - Where no scale is possible (joints have to brake), the scale is 0 and the task error the least within the limits.
/// - Half-spaces and cones are inequalities. For a distance d from the bound (m or rad) it shrinks at most by
///   `min(barrier_rate d, sqrt(2 a_d d))` per s, a_d the deceleration that the acceleration limits allow; beyond the
///   bound it shrinks at the barrier rate. They have no velocity.
///
/// Args:
///     chain: The arm with its limits, or an arm object.
///     tasks: The first has the highest priority. `(task, link)` with the name of a task or a `Task`, and the name of a
///         link or None for the tool: velocities are those of that frame, base axes.
///         `("half_space", link, point, normal)`: the origin of the link stays on the side of the plane through `point`
///         (m) to which `normal` points, base axes. `("cone", link, axis, direction, half_angle)`: `axis`, a direction
///         in the link's frame, stays within `half_angle` (rad) of `direction`, base axes.
///     criterion: The wish is the gain times its gradient; None for the least joint velocity.
///     gain: Joint velocity per unit of the gradient, >= 0.
///     barrier_rate: How fast the distance from the bound of an inequality may shrink, 1/s; at most `1 / dt` counts.
///
/// Raises:
///     RedundancyError: No task, an unknown task or link, a cone or plane without direction, a criterion of another
///         arm.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("iiwa14")
///     >>> scheme = rd.PrioritizedNullspace(arm, [("position", None), ("position", "link_4")])
///     >>> q = [0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4]
///     >>> scheme.step(q, [[0.1, 0, 0], [0, 0, 0.05]], 0.01).scales
///     array([1., 1.])
#[pyclass(name = "PrioritizedNullspace", module = "redundancy", frozen)]
pub struct PyPrioritizedNullspace {
    scheme: Mutex<PrioritizedNullspace>,
    chain: Py<PyChain>,
    recipe: Py<PyTuple>,
    text: String,
    failures: Vec<std::sync::Arc<Failures>>,
}

#[pymethods]
impl PyPrioritizedNullspace {
    #[new]
    #[pyo3(signature = (chain, tasks, *, criterion=None, gain=1.0, barrier_rate=5.0))]
    fn new(
        chain: &Bound<'_, PyAny>,
        tasks: &Bound<'_, PyAny>,
        criterion: Option<Given<'_, PyCriterion>>,
        gain: f64,
        barrier_rate: f64,
    ) -> PyResult<Self> {
        let py = chain.py();
        let chain = read_chain(chain)?;
        let arm = &chain.get().chain;
        let given = tasks.try_iter()?.collect::<PyResult<Vec<_>>>()?;
        let levels = given.iter().map(|one| read_level(arm, one)).collect::<PyResult<Vec<_>>>()?;
        let tasks = PyTuple::new(py, given)?;
        let h = criterion.as_ref().map(|criterion| criterion.get().criterion.clone());
        let scheme = PrioritizedNullspace::new(arm, &levels, h, gain)
            .and_then(|scheme| scheme.with_barrier_rate(barrier_rate))
            .map_err(to_py)?;
        let failures = criterion.as_ref().map_or(Vec::new(), |criterion| criterion.get().failures.clone());
        let text = format!("PrioritizedNullspace({}, {})", arm.name(), tasks.repr()?);
        let options = PyDict::new(py);
        options.set_item("criterion", criterion)?;
        options.set_item("gain", gain)?;
        options.set_item("barrier_rate", barrier_rate)?;
        let arguments = (&chain, &tasks).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, options)?.unbind();
        Ok(Self { scheme: Mutex::new(scheme), chain: chain.unbind(), recipe, text, failures })
    }

    /// One step.
    ///
    /// Args:
    ///     q: Joint positions `(n,)`, rad or m.
    ///     velocities: One entry for each task: its velocity, m/s and rad/s, with as many numbers as it has coordinates
    ///         (six for `pointing`); None for inequalities. Inequalities may also be left out altogether.
    ///     dt: Length of the step, s.
    ///     qd: Joint velocity before the step `(n,)`; without it acceleration is not limited.
    ///     wish: Joint velocity `(n,)` in place of the criterion's gradient.
    ///
    /// Raises:
    ///     RedundancyError: Wrong sizes, numbers that are not finite, `dt` that is not positive.
    #[pyo3(signature = (q, velocities, dt, qd=None, wish=None))]
    fn step(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        velocities: &Bound<'_, PyAny>,
        dt: f64,
        qd: Option<&Bound<'_, PyAny>>,
        wish: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyPriorityStep> {
        let q = read_vector(q, "q", None)?;
        let before = qd.map(|qd| read_vector(qd, "qd", None)).transpose()?;
        let wish = wish.map(|wish| read_vector(wish, "wish", None)).transpose()?;
        let given = velocities.try_iter()?.collect::<PyResult<Vec<_>>>()?;
        let watching = Watching::new(&self.failures);
        let mut scheme = self.scheme.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let velocities = read_velocities(scheme.tasks(), &given)?;
        let velocities: Vec<&[f64]> = velocities.iter().map(Vec::as_slice).collect();
        let input =
            StepInput { q: &q, velocity: &[], dt: Some(dt), qd: before.as_deref(), wish: wish.as_deref() };
        let mut out = vec![0.0; q.len()];
        let report = scheme.step(&input, &velocities, &mut out);
        watching.check(py)?;
        let status = report.map_err(to_py)?.status;
        let (scales, residuals) = (scheme.scales().to_vec(), scheme.residuals().to_vec());
        let active = scheme.active_limits().to_vec();
        let chain = self.chain.clone_ref(py);
        Ok(PyPriorityStep { qd: out, status, scales, residuals, active, chain })
    }

    /// The chain that it was made for.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    fn __repr__(&self) -> &str {
        &self.text
    }

    fn __reduce__(&self, py: Python<'_>) -> Py<PyTuple> {
        self.recipe.clone_ref(py)
    }
}

/// One velocity per task; inequalities have none.
fn read_velocities(tasks: &[PriorityTask], given: &[Bound<'_, PyAny>]) -> PyResult<Vec<Vec<f64>>> {
    let motions = tasks.iter().filter(|task| task.velocity_len() > 0).count();
    let short = given.len() == motions;
    if !short && given.len() != tasks.len() {
        let (what, expected) = ("velocities, one per task".into(), tasks.len());
        return Err(to_py(Error::Length { what, expected, actual: given.len() }));
    }
    let mut rest = given.iter();
    let read = |task: &PriorityTask| {
        if task.velocity_len() > 0 {
            return rest.next().map_or(Ok(Vec::new()), |v| read_vector(v, "task velocity", None));
        }
        match if short { None } else { rest.next() } {
            Some(v) if !v.is_none() => {
                let message = "the velocity of a half-space or cone must be None".into();
                Err(to_py(Error::Invalid(message)))
            }
            _ => Ok(Vec::new()),
        }
    };
    tasks.iter().map(read).collect()
}

/// A tuple that describes a level.
fn read_level(chain: &Chain, level: &Bound<'_, PyAny>) -> PyResult<PriorityTask> {
    let wrong = |why: String| to_py(Error::Invalid(format!("task {level}: {why}")));
    let parts = level.try_iter().map_err(|_| wrong("expected a tuple such as (\"pose\", None)".into()))?;
    let parts = parts.collect::<PyResult<Vec<_>>>()?;
    let word = parts.first().and_then(|first| first.extract::<String>().ok());
    let expected = match word.as_deref() {
        Some("half_space") => 4,
        Some("cone") => 5,
        _ => 2,
    };
    if parts.len() != expected {
        return Err(wrong(format!("{} entries, expected {expected}", parts.len())));
    }
    let link = match parts[1].is_none() {
        true => None,
        false => Some(chain.link_index(&parts[1].extract::<String>()?).map_err(to_py)?),
    };
    match word.as_deref() {
        Some("half_space") => {
            let (point, normal) = (read_array(&parts[2], "point")?, read_array(&parts[3], "normal")?);
            PriorityTask::half_space(link, point, normal).map_err(to_py)
        }
        Some("cone") => {
            let (axis, direction) = (read_array(&parts[2], "axis")?, read_array(&parts[3], "direction")?);
            PriorityTask::cone(link, axis, direction, parts[4].extract()?).map_err(to_py)
        }
        _ => Ok(PriorityTask::Motion { task: read_task(&parts[0])?, link }),
    }
}

/// Result of one step of `PrioritizedNullspace`.
#[pyclass(name = "PriorityStep", module = "redundancy", frozen)]
pub struct PyPriorityStep {
    qd: Vec<f64>,
    status: Status,
    scales: Vec<f64>,
    residuals: Vec<f64>,
    active: Vec<ActiveLimit>,
    chain: Py<PyChain>,
}

#[pymethods]
impl PyPriorityStep {
    /// Joint velocity `(n,)`, rad/s or m/s.
    #[getter]
    fn qd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.qd)
    }

    /// `converged`: all scales 1; `singular`: tasks above leave an error of one; `limits`: limits reduced one.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.status)
    }

    /// `(tasks,)`: one for each task, in [0, 1].
    ///
    /// Of an inequality 1 where it holds, else the share of the way back that is made.
    #[getter]
    fn scales<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.scales)
    }

    /// `(tasks,)`, m/s and rad/s: `|J qd - scale v|` of each task, or `|J qd - v|` where no scale was possible.
    ///
    /// Of an inequality what is missing.
    #[getter]
    fn residuals<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.residuals)
    }

    /// Limits that the step is at: name of the joint, which limit, which side.
    #[getter]
    fn active_limits(&self) -> Vec<(String, &'static str, &'static str)> {
        let limits = self.active.iter().map(|limit| (limit.joint, limit.kind.as_str(), limit.upper));
        limit_names(&self.chain.get().chain, limits)
    }

    fn __repr__(&self) -> String {
        format!("PriorityStep(qd={:?}, status={}, scales={:?})", self.qd, self.status, self.scales)
    }

    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, PriorityParts)> {
        let kind = |limit: &ActiveLimit| (limit.joint, limit.kind.as_str().to_owned(), limit.upper);
        let make = py.get_type::<Self>().getattr("_make")?.unbind();
        let numbers = (self.qd.clone(), self.scales.clone(), self.residuals.clone());
        let active = self.active.iter().map(kind).collect();
        Ok((make, (self.chain.clone_ref(py), self.status.as_str().to_owned(), numbers, active)))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _make(
        chain: Py<PyChain>,
        status: &str,
        numbers: (Vec<f64>, Vec<f64>, Vec<f64>),
        active: Vec<(usize, String, bool)>,
    ) -> PyResult<Self> {
        let unknown =
            || to_py(Error::Invalid(format!("a step with the status '{status}' cannot be restored")));
        let status = Status::ALL.into_iter().find(|s| s.as_str() == status).ok_or_else(unknown)?;
        let dof = chain.get().chain.dof();
        let active = active.into_iter().map(|limit| crate::step::restored_limit(limit, dof));
        let active = active.collect::<Option<Vec<_>>>().ok_or_else(unknown)?;
        let (qd, scales, residuals) = numbers;
        Ok(Self { qd, status, scales, residuals, active, chain })
    }
}

type PriorityParts = (Py<PyChain>, String, (Vec<f64>, Vec<f64>, Vec<f64>), Vec<(usize, String, bool)>);
