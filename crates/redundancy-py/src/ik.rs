//! From poses to configurations: `IkSolver`.

use std::sync::{Arc, Mutex};

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::ik::{
    Attraction, CostMeasure, CostWeights, DescentSettings, GradientKind, HalfAngle, IkBatch, IkMemory,
    IkMethod, IkResult, IkSettings, IkSolver, IkTrace, OrientationSet, Sinusoid, SweepOrder, pose_cost,
    quaternion_cost,
};
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::rotation::unit_direction;
use redundancy_core::{Error, Status};

use crate::batch::in_blocks_watching;
use crate::callback::Watching;
use crate::chain::PyChain;
use crate::convert::{Fresh, Given, read_array, read_pose, read_rows, read_vector};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::orientation_set::read_orientation_set;
use crate::status::{status_to_py, statuses_to_py};
use crate::task::{PyTask, read_target, read_targets, read_task};

/// Poses between two looks at Ctrl-C: some tens of milliseconds.
const SOLVER_BLOCK: usize = 2_048;

/// Inverse kinematics of any chain, within its joint limits and to a given tolerance.
///
/// `hybrid` uses the closed form if the arm has one (`rd.closed_form`), otherwise ranked starts and
/// Levenberg-Marquardt. Construction computes a table of configurations (about a millisecond), so construct a solver
/// once and use it for many poses.
///
/// Args:
///     chain: The arm.
///     method: `"hybrid"`; `"newton"`: Levenberg-Marquardt from `q0`, then from random starts; or a descent algorithm
///         of the paper from `q0`, then from random starts: `"coordinate_descent"`, `"gauss_southwell"`,
///         `"gauss_southwell_rate"`, `"weighted_descent"`, `"gradient_estimate"`.
///     task: Which coordinates count: a name or a `Task`; `"pose"` when left out.
///     tol_position: Largest distance from the target that counts as reached, m.
///     tol_orientation: Largest angle from the target that counts as reached, rad.
///     max_iterations: Most iterations over all starts.
///     restarts: Most starts after the first.
///     criterion: Objective for the spare freedom: the result is stationary in the null space of the task; with a
///         closed form it is the best of all configurations.
///     orientation_set: `Cone`, `QuaternionVolume` or `OrientationSet` of orientations that count as reached, instead
///         of the target's.
///     closed_form: Whether the closed form is used if the arm has one.
///     time_limit: Seconds after which the best configuration so far is returned.
///     position_weight: Weight of the squared distance (1/m^2) in the cost of the descent algorithms and of `trace`.
///     orientation_weight: Weight of the orientation in that cost.
///     order: Order of a sweep of coordinate descent: `"tip_to_base"`, `"base_to_tip"`, `"double"`.
///     measure: Cost of an orientation: squared distances of the three `"axes"`, or of `"quaternions"`.
///     joint_weights: `(n,)` share of its best step that each joint takes in weighted descent (eq. 46) and in the
///         estimate.
///     gradient: `"true"` with a line search, or the paper's `"estimate"` as printed.
///     attractions: Secondary terms (eq. 43): link, point `(3,)`, weight; a negative weight repels the link.
///
/// Raises:
///     RedundancyError: A setting out of its range, by name.
///
/// Example:
///     >>> import redundancy as rd
///     >>> chain = rd.catalog.load("panda")
///     >>> ik = rd.IkSolver(chain)
///     >>> result = ik.solve(chain.forward([0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9]))
///     >>> str(result.status), result.position_error <= 1e-6
///     ('converged', True)
#[pyclass(name = "IkSolver", module = "redundancy", frozen)]
pub struct PyIkSolver {
    solver: IkSolver,
    chain: Py<PyChain>,
    task: Py<PyAny>,
    criterion: Option<Py<PyCriterion>>,
    orientation_set: Option<Py<PyAny>>,
    attractions: Vec<(String, [f64; 3], f64)>,
    /// Memory of earlier calls, to be used again.
    memory: Mutex<Vec<IkMemory>>,
}

impl PyIkSolver {
    /// One call during which the criterion may fail.
    fn watching(&self) -> Watching {
        Watching::criterion(self.criterion.as_ref().map(|criterion| criterion.get()))
    }
}

#[pymethods]
impl PyIkSolver {
    #[new]
    #[pyo3(signature = (
        chain, method="hybrid", task=None, tol_position=1e-6, tol_orientation=1e-6, max_iterations=None,
        restarts=None, criterion=None, orientation_set=None, closed_form=true, *, time_limit=None,
        position_weight=10.0, orientation_weight=1.0, order="tip_to_base", measure="axes", joint_weights=None,
        gradient="true", attractions=None,
    ))]
    fn new(
        py: Python<'_>,
        chain: &Bound<'_, PyChain>,
        method: &str,
        task: Option<&Bound<'_, PyAny>>,
        tol_position: f64,
        tol_orientation: f64,
        max_iterations: Option<usize>,
        restarts: Option<usize>,
        criterion: Option<Given<'_, PyCriterion>>,
        orientation_set: Option<&Bound<'_, PyAny>>,
        closed_form: bool,
        time_limit: Option<f64>,
        position_weight: f64,
        orientation_weight: f64,
        order: &str,
        measure: &str,
        joint_weights: Option<&Bound<'_, PyAny>>,
        gradient: &str,
        attractions: Option<Vec<(String, [f64; 3], f64)>>,
    ) -> PyResult<Self> {
        let attractions = attractions.unwrap_or_default();
        let draw = |(name, target, weight): &(String, [f64; 3], f64)| -> PyResult<Attraction> {
            let link = chain.get().chain.link_index(name).map_err(to_py)?;
            Ok(Attraction { link, target: *target, weight: *weight })
        };
        let descent = DescentSettings {
            weights: CostWeights { position: position_weight, orientation: orientation_weight },
            order: named("order", order, &SweepOrder::ALL, SweepOrder::as_str)?,
            measure: named("measure", measure, &CostMeasure::ALL, CostMeasure::as_str)?,
            joint_weights: joint_weights.map(|w| read_vector(w, "joint_weights", None)).transpose()?,
            gradient: named("gradient", gradient, &GradientKind::ALL, GradientKind::as_str)?,
            attractions: attractions.iter().map(draw).collect::<PyResult<_>>()?,
        };
        let method = IkMethod::from_name(method).map_err(to_py)?;
        let kind = task.map_or(Ok(Task::POSE), read_task)?;
        let defaults = IkSettings { method, ..IkSettings::default() };
        let settings = IkSettings {
            task: kind,
            tol_position,
            tol_orientation,
            max_iterations: max_iterations.unwrap_or(defaults.max_iterations),
            restarts: restarts.unwrap_or(defaults.restarts),
            time_limit,
            criterion: criterion.as_ref().map(|c| Arc::clone(&c.get().criterion)),
            orientation_set: orientation_set.map(read_set).transpose()?,
            closed_form,
            descent,
            ..defaults
        };
        Ok(Self {
            solver: IkSolver::new(&chain.get().chain, settings).map_err(to_py)?,
            chain: chain.clone().unbind(),
            task: match task {
                Some(task) => task.clone().unbind(),
                None => Py::new(py, PyTask { task: kind })?.into_any(),
            },
            criterion: criterion.map(|c| c.clone().unbind()),
            orientation_set: orientation_set.map(|s| s.clone().unbind()),
            attractions,
            memory: Mutex::new(Vec::new()),
        })
    }

    /// The chain.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// Name of the method.
    #[getter]
    fn method(&self) -> &'static str {
        self.solver.settings().method.as_str()
    }

    /// Which coordinates count.
    #[getter]
    fn task(&self) -> PyTask {
        PyTask { task: self.solver.settings().task }
    }

    /// Name of the closed form in use, such as `"srs"` or `"panda_class"`; `None` without one.
    #[getter]
    fn closed_form(&self) -> Option<&'static str> {
        self.solver.closed_form()
    }

    /// A configuration for a pose.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like; `(2,)` or `(3,)` for `planar`, `(3,)` for `position`, `(x, y, angle)` for
    ///         `planar_pose`.
    ///     q0: `(n,)` start of the search; a closed form returns the configuration nearest to it.
    ///     seed: Seed of the random starts. The same seed gives the same bits.
    ///
    /// Raises:
    ///     RedundancyError: A pose that is not rigid (with the measured error), wrong shapes, numbers that are not
    ///         finite.
    #[pyo3(signature = (pose, q0=None, seed=0))]
    fn solve(
        &self,
        py: Python<'_>,
        pose: &Bound<'_, PyAny>,
        q0: Option<&Bound<'_, PyAny>>,
        seed: u64,
    ) -> PyResult<PyIkResult> {
        let pose = read_target(pose, &self.solver.settings().task)?;
        let n = self.solver.chain().dof();
        let q0 = q0.map(|q0| read_vector(q0, "q0", Some(n))).transpose()?;
        let mut memory = self.borrow().unwrap_or_else(|| self.solver.memory());
        let mut result = IkResult::new(n);
        let watching = self.watching();
        let done = py.detach(|| self.solver.solve_into(&pose, q0.as_deref(), seed, &mut memory, &mut result));
        self.give_back(memory);
        watching.check(py)?;
        done.map_err(to_py)?;
        Ok(PyIkResult { result })
    }

    /// `solve` for many poses `(N, 4, 4)`, from one `q0` `(n,)` or one each `(N, n)`.
    ///
    /// Row i is exactly what `solve` gives for pose i, whatever the number of threads.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or the short forms of `solve` with a leading axis.
    ///     q0: Start of the search, `(n,)` or `(N, n)`, rad or m.
    ///     seed: Seed of the random starts, the same for every pose.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, q0=None, seed=0, *, threads=None))]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        q0: Option<&Bound<'py, PyAny>>,
        seed: u64,
        threads: Option<usize>,
    ) -> PyResult<PyIkBatch> {
        let n = self.solver.chain().dof();
        let targets = read_targets(poses, &self.solver.settings().task)?;
        let rows = targets.rows;
        let q0 = q0.map(|q0| read_rows(q0, "q0", &[n])).transpose()?;
        if let Some(actual) = q0.as_ref().and_then(|q0| q0.batch).filter(|m| *m != rows) {
            return Err(to_py(Error::Length { what: "rows of q0".into(), expected: rows, actual }));
        }
        let single = q0.as_ref().is_none_or(|q0| q0.batch.is_none());
        let start = q0.as_ref().map(|q0| q0.as_slice()).transpose()?;
        let mut q = Fresh::<f64, _>::new(py, [rows, n]);
        let mut iterations = Fresh::<u32, _>::new(py, [rows]);
        let mut position = Fresh::<f64, _>::new(py, [rows]);
        let mut orientation = Fresh::<f64, _>::new(py, [rows]);
        let mut proven = Fresh::<bool, _>::new(py, [rows]);
        let mut status = vec![Status::Cancelled; rows];
        {
            let (q, iterations) = (q.memory()?, iterations.memory()?);
            let (position, orientation) = (position.memory()?, orientation.memory()?);
            let proven = proven.memory()?;
            let data = targets.as_slice()?;
            let watching = self.watching();
            in_blocks_watching(py, rows, SOLVER_BLOCK, threads, &watching, |r| {
                let start = start.map(|q0| if single { q0 } else { &q0[r.start * n..r.end * n] });
                let mut out = IkBatch {
                    q: &mut q[r.start * n..r.end * n],
                    status: &mut status[r.clone()],
                    iterations: &mut iterations[r.clone()],
                    position_error: &mut position[r.clone()],
                    orientation_error: &mut orientation[r.clone()],
                    proven: &mut proven[r.clone()],
                };
                self.solver.solve_batch(&data[r.start * 16..r.end * 16], start, seed, &mut out)
            })?;
        }
        Ok(PyIkBatch {
            q: q.finish().unbind(),
            status: statuses_to_py(py, &status)?.unbind(),
            iterations: iterations.finish().unbind(),
            position_error: position.finish().unbind(),
            orientation_error: orientation.finish().unbind(),
            proven: proven.finish().unbind(),
        })
    }

    /// One run of the method from `q0`, without restarts or closed form, iteration by iteration.
    ///
    /// `hybrid` runs as `newton`. There are at most `max_iterations` iterations.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like.
    ///     q0: Start, `(n,)`, rad or m.
    fn trace(&self, py: Python<'_>, pose: &Bound<'_, PyAny>, q0: &Bound<'_, PyAny>) -> PyResult<PyIkTrace> {
        let pose = read_target(pose, &self.solver.settings().task)?;
        let q0 = read_vector(q0, "q0", Some(self.solver.chain().dof()))?;
        let watching = self.watching();
        let trace = py.detach(|| self.solver.trace(&pose, &q0));
        watching.check(py)?;
        let trace = trace.map_err(to_py)?;
        Ok(PyIkTrace { trace })
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, solver) = (this.py(), this.get());
        let settings = solver.solver.settings();
        let options = PyDict::new(py);
        options.set_item("method", settings.method.as_str())?;
        options.set_item("task", solver.task.bind(py))?;
        options.set_item("tol_position", settings.tol_position)?;
        options.set_item("tol_orientation", settings.tol_orientation)?;
        options.set_item("max_iterations", settings.max_iterations)?;
        options.set_item("restarts", settings.restarts)?;
        options.set_item("criterion", solver.criterion.as_ref().map(|c| c.bind(py)))?;
        options.set_item("orientation_set", solver.orientation_set.as_ref().map(|s| s.bind(py)))?;
        options.set_item("closed_form", settings.closed_form)?;
        options.set_item("time_limit", settings.time_limit)?;
        let descent = &settings.descent;
        options.set_item("position_weight", descent.weights.position)?;
        options.set_item("orientation_weight", descent.weights.orientation)?;
        options.set_item("order", descent.order.as_str())?;
        options.set_item("measure", descent.measure.as_str())?;
        options.set_item("joint_weights", descent.joint_weights.clone())?;
        options.set_item("gradient", descent.gradient.as_str())?;
        options.set_item("attractions", solver.attractions.clone())?;
        let class = this.get_type().getattr("_restore")?;
        Ok((class, (solver.chain.bind(py), options).into_pyobject(py)?))
    }

    /// What pickling calls.
    #[staticmethod]
    fn _restore<'py>(
        py: Python<'py>,
        chain: &Bound<'py, PyChain>,
        options: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyAny>> {
        py.get_type::<Self>().call((chain,), Some(options))
    }

    fn __repr__(&self) -> String {
        let settings = self.solver.settings();
        let closed = self.solver.closed_form().map_or(String::new(), |c| format!(", closed form '{c}'"));
        format!(
            "IkSolver('{}', method '{}', task '{}'{closed}, tolerance {:.1e} m {:.1e} rad)",
            self.solver.chain().name(),
            settings.method.as_str(),
            settings.task,
            settings.tol_position,
            settings.tol_orientation
        )
    }
}

impl PyIkSolver {
    fn borrow(&self) -> Option<IkMemory> {
        self.memory.lock().ok()?.pop()
    }

    fn give_back(&self, memory: IkMemory) {
        if let Ok(mut pool) = self.memory.lock() {
            pool.push(memory);
        }
    }
}

fn read_set(object: &Bound<'_, PyAny>) -> PyResult<OrientationSet> {
    read_orientation_set(object, "orientation_set")
}

/// Result of inverse kinematics for one pose.
#[pyclass(name = "IkResult", module = "redundancy", frozen)]
pub struct PyIkResult {
    result: IkResult,
}

#[pymethods]
impl PyIkResult {
    #[new]
    #[pyo3(signature = (q, status, iterations, position_error, orientation_error, proven=false, starts=0))]
    fn new(
        q: &Bound<'_, PyAny>,
        status: &str,
        iterations: usize,
        position_error: f64,
        orientation_error: f64,
        proven: bool,
        starts: usize,
    ) -> PyResult<Self> {
        let q = read_vector(q, "q", None)?;
        let status = Status::ALL.into_iter().find(|s| s.as_str() == status).ok_or_else(|| {
            let valid = Status::ALL.iter().map(|s| s.as_str().to_owned()).collect();
            to_py(Error::UnknownName { kind: "status", name: status.into(), valid })
        })?;
        let result = IkResult { q, status, iterations, position_error, orientation_error, proven, starts };
        Ok(Self { result })
    }

    /// Joint positions `(n,)` within the limits; the best found if the status is not `converged`. A copy.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.result.q)
    }

    /// Outcome of the search.
    ///
    /// `converged`, `unreachable` (every start ended stationary above the tolerance; exact from a closed form),
    /// `limits` (reachable only outside of the joint limits), `iteration_limit`, `time_limit`.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.result.status)
    }

    /// Explanation of the status, with numbers; empty when converged.
    #[getter]
    fn reason(&self) -> String {
        self.result.reason()
    }

    /// Iterations over all starts; 0 from a closed form.
    #[getter]
    fn iterations(&self) -> usize {
        self.result.iterations
    }

    /// Distance from the target, m, in the coordinates of the task: by forward kinematics of `q`.
    #[getter]
    fn position_error(&self) -> f64 {
        self.result.position_error
    }

    /// Angle from the target, rad, in the coordinates of the task: by forward kinematics of `q`.
    #[getter]
    fn orientation_error(&self) -> f64 {
        self.result.orientation_error
    }

    /// Whether the status is exact: `converged` always is, others from a closed form without defect.
    ///
    /// False if it is the outcome of a finite search; `reason` then says how many starts were made.
    #[getter]
    fn proven(&self) -> bool {
        self.result.proven
    }

    /// Starts of the numeric search; 0 from a closed form alone.
    #[getter]
    fn starts(&self) -> usize {
        self.result.starts
    }

    fn __getnewargs__(&self) -> (Vec<f64>, &'static str, usize, f64, f64, bool, usize) {
        let IkResult { q, status, iterations, position_error, orientation_error, proven, starts } =
            self.result.clone();
        (q, status.as_str(), iterations, position_error, orientation_error, proven, starts)
    }

    fn __repr__(&self) -> String {
        let r = &self.result;
        format!(
            "IkResult({}, q={:?}, {} iterations, misses by {:.1e} m {:.1e} rad)",
            r.status, r.q, r.iterations, r.position_error, r.orientation_error
        )
    }
}

/// Results of inverse kinematics for many poses; row i is that of pose i.
#[pyclass(name = "IkBatch", module = "redundancy", frozen, get_all)]
pub struct PyIkBatch {
    /// `(N, n)`, within the limits.
    q: Py<PyArray2<f64>>,
    /// `(N,)`, an object array of `Status`.
    status: Py<PyArray1<Py<PyAny>>>,
    /// `(N,)`.
    iterations: Py<PyArray1<u32>>,
    /// `(N,)`, m.
    position_error: Py<PyArray1<f64>>,
    /// `(N,)`, rad.
    orientation_error: Py<PyArray1<f64>>,
    /// `(N,)`: whether each status is exact, as `IkResult.proven`.
    proven: Py<PyArray1<bool>>,
}

#[pymethods]
impl PyIkBatch {
    #[new]
    fn new(
        q: Py<PyArray2<f64>>,
        status: Py<PyArray1<Py<PyAny>>>,
        iterations: Py<PyArray1<u32>>,
        position_error: Py<PyArray1<f64>>,
        orientation_error: Py<PyArray1<f64>>,
        proven: Py<PyArray1<bool>>,
    ) -> Self {
        Self { q, status, iterations, position_error, orientation_error, proven }
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (
            self.q.bind(py),
            self.status.bind(py),
            self.iterations.bind(py),
            self.position_error.bind(py),
            self.orientation_error.bind(py),
            self.proven.bind(py),
        )
            .into_pyobject(py)
    }

    fn __len__(&self, py: Python<'_>) -> usize {
        numpy::PyUntypedArrayMethods::len(self.iterations.bind(py))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let words = self.status.bind(py).readonly();
        let converged = words.as_array().iter().filter(|s| s.bind(py).to_string() == "converged").count();
        format!("IkBatch({} poses, {converged} converged)", self.__len__(py))
    }
}

/// The member of `all` called `name`.
fn named<T: Copy>(kind: &'static str, name: &str, all: &[T], word: fn(T) -> &'static str) -> PyResult<T> {
    all.iter().copied().find(|x| word(*x) == name).ok_or_else(|| {
        let valid = all.iter().map(|x| word(*x).to_owned()).collect();
        to_py(Error::UnknownName { kind, name: name.into(), valid })
    })
}

/// History of one run: entry k is the state before iteration k, the last entry is the final state.
#[pyclass(name = "IkTrace", module = "redundancy", frozen)]
pub struct PyIkTrace {
    trace: IkTrace,
}

#[pymethods]
impl PyIkTrace {
    #[new]
    fn new(q: Vec<f64>, cost: Vec<f64>, position_error: Vec<f64>, orientation_error: Vec<f64>) -> Self {
        Self { trace: IkTrace { q, cost, position_error, orientation_error } }
    }

    /// Final configuration, `(n,)`.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.trace.q)
    }

    /// Weighted cost `(k,)` of the descent algorithms, whatever the method.
    #[getter]
    fn cost<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.trace.cost)
    }

    /// Distances from the target `(k,)`, m.
    #[getter]
    fn position_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.trace.position_error)
    }

    /// Angles from the target `(k,)`, rad.
    #[getter]
    fn orientation_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.trace.orientation_error)
    }

    fn __len__(&self) -> usize {
        self.trace.cost.len()
    }

    fn __getnewargs__(&self) -> (Vec<f64>, Vec<f64>, Vec<f64>, Vec<f64>) {
        let t = &self.trace;
        (t.q.clone(), t.cost.clone(), t.position_error.clone(), t.orientation_error.clone())
    }

    fn __repr__(&self) -> String {
        let t = &self.trace;
        let [first, last] = [t.cost.first(), t.cost.last()].map(|c| c.copied().unwrap_or_default());
        format!("IkTrace({} iterations, cost {first:.3e} to {last:.3e})", t.cost.len().saturating_sub(1))
    }
}

fn finite(names: &[&str], values: &[f64]) -> PyResult<()> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(k) => Err(to_py(Error::NotFinite { what: names[k].into(), index: 0, value: values[k] })),
    }
}

/// Where `K + a cos(psi) + b sin(psi)` is least, in (-pi, pi], and its value there: `atan2(-b, -a)`.
///
/// Example:
///     >>> import redundancy as rd
///     >>> psi, value = rd.sinusoid_minimum(2.0, 3.0, -4.0)
///     >>> round(psi, 6), value
///     (2.214297, -3.0)
#[pyfunction]
#[pyo3(signature = (K, a, b))]
#[allow(non_snake_case)] // the letters of the paper
pub fn sinusoid_minimum(K: f64, a: f64, b: f64) -> PyResult<(f64, f64)> {
    finite(&["K", "a", "b"], &[K, a, b])?;
    Ok(Sinusoid { constant: K, cos: a, sin: b }.minimum())
}

/// Where `K + a cos(psi) + b sin(psi) + c cos(psi/2) + d sin(psi/2)` is least over two turns, and its value.
#[pyfunction]
#[pyo3(signature = (K, a, b, c, d))]
#[allow(non_snake_case)] // the letters of the paper
pub fn half_angle_minimum(K: f64, a: f64, b: f64, c: f64, d: f64) -> PyResult<(f64, f64)> {
    finite(&["K", "a", "b", "c", "d"], &[K, a, b, c, d])?;
    let whole = Sinusoid { constant: K, cos: a, sin: b };
    Ok(HalfAngle { whole, half_cos: c, half_sin: d }.minimum())
}

/// Coefficients of the cost of a pose as a function of the angle psi of a joint about `axis` through `origin`.
///
/// `(K, a, b)` for the measure `"axes"` (squared distances of the point and of the three unit axes),
/// `(K, a, b, c, d)` for `"quaternions"`; for `sinusoid_minimum` and `half_angle_minimum`.
///
/// Args:
///     axis: Direction `(3,)` of the joint's axis, world axes.
///     origin: A point `(3,)` on the axis, m.
///     pose: Pose `(4, 4)` of the tool at psi = 0.
///     target: Desired pose `(4, 4)`.
///     position_weight: Weight of the squared distance, 1/m^2.
///     orientation_weight: Weight of the orientation.
///     measure: `"axes"` or `"quaternions"`.
#[pyfunction]
#[pyo3(signature = (axis, origin, pose, target, position_weight=10.0, orientation_weight=1.0, measure="axes"))]
pub fn joint_cost<'py>(
    py: Python<'py>,
    axis: &Bound<'py, PyAny>,
    origin: &Bound<'py, PyAny>,
    pose: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    position_weight: f64,
    orientation_weight: f64,
    measure: &str,
) -> PyResult<Bound<'py, PyTuple>> {
    let axis = unit_direction("axis", read_array(axis, "axis")?).map_err(to_py)?.into_inner();
    let origin = Vector3::from(read_array::<3>(origin, "origin")?);
    finite(&["origin", "origin", "origin"], origin.as_slice())?;
    finite(&["position_weight", "orientation_weight"], &[position_weight, orientation_weight])?;
    let (pose, target) = (read_pose(pose)?, read_pose(target)?);
    let weights = CostWeights { position: position_weight, orientation: orientation_weight };
    match named("measure", measure, &CostMeasure::ALL, CostMeasure::as_str)? {
        CostMeasure::Axes => {
            let g = pose_cost(&axis, &origin, &pose, &target, &weights);
            (g.constant, g.cos, g.sin).into_pyobject(py)
        }
        CostMeasure::Quaternions => {
            let g = quaternion_cost(&axis, &origin, &pose, &target, &weights);
            (g.whole.constant, g.whole.cos, g.whole.sin, g.half_cos, g.half_sin).into_pyobject(py)
        }
    }
}
