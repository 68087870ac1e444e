//! Self-motion curves of any chain.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple, PyType};
use redundancy_core::kinematics::Task;
use redundancy_core::solutions::{
    SelfMotionCurve, TraceSettings, self_motion_curves, self_motion_patch, trace_self_motion,
};
use redundancy_core::{Error, Status};

use crate::chain::PyChain;
use crate::convert::{pose_to_array, read_pose, read_rows, read_vector, to_array};
use crate::error::to_py;
use crate::path::{PyEvent, read_joint_rows};
use crate::status::status_to_py;
use crate::task::{PyTask, read_target, read_task};

/// A curve of configurations with one task value, by continuation. Can be pickled.
///
/// The parameter s is the length of the curve in joint space from the first row.
#[pyclass(name = "SelfMotionCurve", module = "redundancy", frozen)]
pub struct PySelfMotionCurve {
    pub curve: SelfMotionCurve,
    chain: Py<PyChain>,
}

#[pymethods]
impl PySelfMotionCurve {
    /// The arm.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// `(N, n)`: joint configurations that change continuously; they are not shifted back into the limits.
    ///
    /// On a closed curve the last row is the first one plus whole turns.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.curve.q(), [self.curve.rows(), self.curve.chain().dof()])
    }

    /// `(N, n)`: unit tangents, in the kernel of the task Jacobian.
    #[getter]
    fn tangents<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.curve.tangents(), [self.curve.rows(), self.curve.chain().dof()])
    }

    /// `(N,)`: parameter of the rows, rad (m for sliding joints).
    #[getter]
    fn s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.curve.s())
    }

    /// Length of the curve in joint space, rad or m.
    #[getter]
    fn length(&self) -> f64 {
        self.curve.length()
    }

    /// Whether it returns to its start, modulo whole turns of revolute joints.
    #[getter]
    fn closed(&self) -> bool {
        self.curve.closed()
    }

    /// `converged` (closed), `singular` (ends at kinematic singularities) or `iteration_limit` (`max_rows`).
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.curve.status())
    }

    /// Joint limits that are met and ends at kinematic singularities, in the order of s; `t` is s here.
    #[getter]
    fn events(&self) -> Vec<PyEvent> {
        self.curve.events().into_iter().map(PyEvent::from).collect()
    }

    /// The configuration `(n,)` or `(N, n)` at `s`, exactly on the curve; a closed curve goes on from its start.
    ///
    /// Raises:
    ///     RedundancyError: a parameter that is not finite, or beyond the ends of an open curve.
    fn at<'py>(&self, py: Python<'py>, s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let n = self.curve.chain().dof();
        let at = read_rows(s, "s", &[])?;
        let mut values = Vec::with_capacity(n * at.batch.unwrap_or(1));
        for s in at.as_slice()? {
            values.extend(self.curve.at(*s).map_err(to_py)?);
        }
        match at.batch {
            None => Ok(PyArray1::from_vec(py, values).into_any()),
            Some(rows) => Ok(to_array(py, &values, [rows, n])?.into_any()),
        }
    }

    /// Arcs `(k, 2)` of s on which all joint limits hold in some winding, with a distance of `margin` from each.
    ///
    /// An arc through the start of a closed curve ends above its length: s is inside an arc `[lo, hi]` when
    /// `(s - lo) mod length <= hi - lo`.
    ///
    /// Raises:
    ///     RedundancyError: a margin that is negative or not finite.
    #[pyo3(signature = (margin=0.0))]
    fn intervals<'py>(&self, py: Python<'py>, margin: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let arcs = self.curve.intervals(margin).map_err(to_py)?;
        to_array(py, arcs.as_flattened(), [arcs.len(), 2])
    }

    fn __len__(&self) -> usize {
        self.curve.rows()
    }

    fn __repr__(&self) -> String {
        let (rows, length) = (self.curve.rows(), self.curve.length());
        let shape = if self.curve.closed() { "closed" } else { "open" };
        format!("SelfMotionCurve({}, {shape}, {rows} rows, length {length})", self.curve.chain().name())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let curve = &self.curve;
        let ends = PyList::new(py, curve.ends().iter().cloned().map(PyEvent::from))?;
        let task = Bound::new(py, PyTask { task: *curve.task() })?;
        let parts = (
            &self.chain,
            task,
            pose_to_array(py, curve.target())?,
            self.s(py),
            self.q(py)?,
            self.tangents(py)?,
            curve.status().as_str(),
            ends,
        );
        Ok((py.get_type::<Self>().getattr("_from_parts")?, parts.into_pyobject(py)?))
    }

    /// Inverse of pickling.
    #[classmethod]
    fn _from_parts(
        _class: &Bound<'_, PyType>,
        chain: &Bound<'_, PyChain>,
        task: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        s: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        tangents: &Bound<'_, PyAny>,
        status: &str,
        ends: Vec<Bound<'_, PyEvent>>,
    ) -> PyResult<Self> {
        let status = Status::ALL.into_iter().find(|known| known.as_str() == status).ok_or_else(|| {
            let valid = Status::ALL.map(|known| known.as_str().to_owned()).to_vec();
            to_py(Error::UnknownName { kind: "status", name: status.into(), valid })
        })?;
        let n = chain.get().chain.dof();
        let rows = (
            read_vector(s, "s", None)?,
            read_joint_rows(q, "q", n)?,
            read_joint_rows(tangents, "tangents", n)?,
        );
        let ends = ends.iter().map(|event| event.get().event.clone()).collect();
        let (task, target) = (read_task(task)?, read_pose(target)?);
        let curve = SelfMotionCurve::from_rows(&chain.get().chain, task, &target, rows, status, ends);
        Ok(Self { curve: curve.map_err(to_py)?, chain: chain.clone().unbind() })
    }
}

fn settings(step: Option<f64>, max_rows: Option<usize>) -> TraceSettings {
    let default = TraceSettings::default();
    TraceSettings { step: step.unwrap_or(default.step), max_rows: max_rows.unwrap_or(default.max_rows) }
}

fn task_or_pose(task: Option<&Bound<'_, PyAny>>) -> PyResult<Task> {
    task.map_or(Ok(Task::POSE), read_task)
}

/// The self-motion through `q`: all configurations with the same task value that are connected with it.
///
/// By prediction and correction, for any chain with one spare freedom under the task. Passes points where a joint
/// turns back; ends where the curve closes or at kinematic singularities (then both directions are followed).
///
/// Args:
///     chain: The arm.
///     q: `(n,)`.
///     task: Which coordinates are kept; the pose by default.
///     step: Largest joint step between rows; default 0.01.
///     max_rows: Rows after which following the curve is stopped; default 200 000.
///
/// Raises:
///     RedundancyError: a wrong length, entries that are not finite, not exactly one spare freedom, invalid settings.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("panda")
///     >>> curve = rd.trace_self_motion(arm, [0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5])
///     >>> curve.closed, curve.q.shape[1]
///     (True, 7)
#[pyfunction]
#[pyo3(name = "trace_self_motion", signature = (chain, q, task=None, *, step=None, max_rows=None))]
pub fn py_trace_self_motion(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    q: &Bound<'_, PyAny>,
    task: Option<&Bound<'_, PyAny>>,
    step: Option<f64>,
    max_rows: Option<usize>,
) -> PyResult<PySelfMotionCurve> {
    let model = chain.get().chain.clone();
    let q = read_vector(q, "q", Some(model.dof()))?;
    let (task, settings) = (task_or_pose(task)?, settings(step, max_rows));
    let curve = py.detach(|| trace_self_motion(&model, &q, task, &settings)).map_err(to_py)?;
    Ok(PySelfMotionCurve { curve, chain: chain.clone().unbind() })
}

/// Every self-motion curve found over `pose`.
///
/// For S-R-S arms these are the circles of the closed form, which are complete. For other arms they are the curves
/// through the configurations that Newton's method finds from random starts. Arguments are as for `trace_self_motion`
/// and `constrained_optima`.
///
/// Args:
///     chain: The arm.
///     pose: `(4, 4)` or SE3-like, or what the task holds of it.
///     task: Which coordinates are kept; the pose by default.
///     seed: Seed of the random starts.
///     starts: Their number.
///     step: Distance of rows in joint space, as for `trace_self_motion`.
///     max_rows: Most rows of a curve.
///
/// Raises:
///     RedundancyError: an invalid pose, not exactly one spare freedom, invalid settings.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> [curve.closed for curve in rd.self_motion_curves(arm, [2, 0], task="planar")]
///     [True]
#[pyfunction]
#[pyo3(name = "self_motion_curves",
    signature = (chain, pose, task=None, *, seed=0, starts=100, step=None, max_rows=None))]
pub fn py_self_motion_curves(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    pose: &Bound<'_, PyAny>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: usize,
    step: Option<f64>,
    max_rows: Option<usize>,
) -> PyResult<Vec<PySelfMotionCurve>> {
    let model = chain.get().chain.clone();
    let (task, settings) = (task_or_pose(task)?, settings(step, max_rows));
    let target = read_target(pose, &task)?;
    let curves =
        py.detach(|| self_motion_curves(&model, &target, task, &settings, seed, starts)).map_err(to_py)?;
    Ok(curves.into_iter().map(|curve| PySelfMotionCurve { curve, chain: chain.clone().unbind() }).collect())
}

/// A sampled patch of a self-motion of two dimensions around `q`.
///
/// Args:
///     chain: The arm; the task leaves two freedoms.
///     q: `(n,)`, the middle of the patch.
///     task: Which coordinates are kept; the pose by default.
///     spacing: Distance of neighbours along the two null directions of `q`, in (0, 0.5].
///     steps: Points on each side of the middle, at most 500.
///
/// Returns:
///     Configurations `(2 steps + 1, 2 steps + 1, n)` and whether each was found; where not, the entry is `q`.
///
/// Raises:
///     RedundancyError: a wrong length, entries that are not finite, not exactly two spare freedoms, invalid settings.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar4r")
///     >>> q, valid = rd.self_motion_patch(arm, [0.2, 0.5, 0.7, 0.9], task="planar", steps=2)
///     >>> q.shape, bool(valid.all())
///     ((5, 5, 4), True)
#[pyfunction]
#[pyo3(name = "self_motion_patch", signature = (chain, q, task=None, *, spacing=0.05, steps=10))]
pub fn py_self_motion_patch<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    q: &Bound<'py, PyAny>,
    task: Option<&Bound<'py, PyAny>>,
    spacing: f64,
    steps: usize,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let model = chain.get().chain.clone();
    let n = model.dof();
    let q = read_vector(q, "q", Some(n))?;
    let task = task_or_pose(task)?;
    let patch = py.detach(|| self_motion_patch(&model, &q, task, spacing, steps)).map_err(to_py)?;
    let side = 2 * steps + 1;
    let valid: Vec<bool> = patch.iter().map(Option::is_some).collect();
    // What is not valid repeats the start: finite, and marked.
    let rows: Vec<f64> = patch.into_iter().flat_map(|row| row.unwrap_or_else(|| q.clone())).collect();
    Ok((to_array(py, &rows, [side, side, n])?.into_any(), to_array(py, &valid, [side, side])?.into_any()))
}
