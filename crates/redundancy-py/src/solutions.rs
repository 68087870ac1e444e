//! `solutions`: every configuration over a pose, for any arm.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::kinematics::{Task, TaskKind};
use redundancy_core::solutions::{Solution, Solutions, SolutionsSettings, TraceSettings, solutions};
use redundancy_core::{Error, Pose};

use crate::callback::Watching;
use crate::chain::PyChain;
use crate::closed_form::read_arm;
use crate::convert::{Given, Integer, pose_to_array, read_rows, read_vector, to_array};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::status::status_to_py;
use crate::task::{PyTask, read_target, read_task};

/// The set with what it was made from, which is what it pickles as.
struct Inner {
    set: Box<dyn Solutions>,
    /// The `chain` argument: a chain or an arm.
    given: Py<PyAny>,
    chain: Py<PyChain>,
    pose: Pose,
    settings: SolutionsSettings,
}

/// Every configuration for one pose: points (dimension 0) or curves (dimension 1). Made by `solutions`.
#[pyclass(name = "Solutions", module = "redundancy", frozen)]
pub struct PySolutions {
    inner: Arc<Inner>,
}

#[pymethods]
impl PySolutions {
    /// The arm.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.inner.chain.clone_ref(py)
    }

    /// 0 for isolated configurations, 1 for curves.
    #[getter]
    fn dimension(&self) -> usize {
        self.inner.set.dimension()
    }

    /// `converged` (some configuration is within limits), `limits` (none is) or `unreachable` (there is none).
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.inner.set.status())
    }

    /// Why none is within the limits, by how much, and why the status is not `proven`; else empty.
    #[getter]
    fn reason(&self) -> String {
        self.inner.set.reason()
    }

    /// Whether status and pieces are exact; False after a finite search, whose starts `reason` counts.
    #[getter]
    fn proven(&self) -> bool {
        self.inner.set.proven()
    }

    /// The points or curves, whether within the joint limits or not.
    #[getter]
    fn pieces(&self) -> Vec<PyPiece> {
        (0..self.inner.set.pieces()).map(|index| PyPiece { inner: self.inner.clone(), index }).collect()
    }

    /// The configuration within the limits nearest to `q`, windings included; its `value` is the distance.
    ///
    /// Args:
    ///     q: `(n,)`.
    fn nearest(&self, py: Python<'_>, q: &Bound<'_, PyAny>) -> PyResult<PySolution> {
        let q = read_vector(q, "q", Some(self.inner.set.chain().dof()))?;
        let solution = py.detach(|| self.inner.set.nearest(&q)).map_err(to_py)?;
        Ok(PySolution { solution, inner: self.inner.clone() })
    }

    /// The best configuration within the limits.
    ///
    /// Proven for isolated configurations, and on circles of the swivel for joint range, posture and their sums;
    /// otherwise found by a dense scan of all pieces with refinement.
    ///
    /// Args:
    ///     criterion: A criterion of the same arm.
    fn best(&self, py: Python<'_>, criterion: Given<'_, PyCriterion>) -> PyResult<PySolution> {
        let watching = Watching::criterion(Some(criterion.get()));
        let criterion = Arc::clone(&criterion.get().criterion);
        let solution = watching.detach(py, || self.inner.set.best(&*criterion));
        watching.check(py)?;
        let solution = solution.map_err(to_py)?;
        Ok(PySolution { solution, inner: self.inner.clone() })
    }

    fn _piece(&self, index: usize) -> PyResult<PyPiece> {
        self.inner.set.label(index).map_err(to_py)?;
        Ok(PyPiece { inner: self.inner.clone(), index })
    }

    fn _solution(&self, parts: Option<(Vec<f64>, usize, f64, f64, bool)>) -> PySolution {
        let solution = parts.map(|(q, piece, u, value, proven)| Solution { q, piece, u, value, proven });
        PySolution { solution, inner: self.inner.clone() }
    }

    #[staticmethod]
    fn _restore(
        chain: &Bound<'_, PyAny>,
        pose: &Bound<'_, PyAny>,
        options: &Bound<'_, PyDict>,
    ) -> PyResult<Py<PyAny>> {
        let make = chain.py().import("redundancy")?.getattr("solutions")?;
        make.call((chain, pose), Some(options)).map(Bound::unbind)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let Inner { given, pose, settings, .. } = &*self.inner;
        let options = PyDict::new(py);
        options.set_item("task", Bound::new(py, PyTask { task: settings.task })?)?;
        options.set_item("closed_form", settings.closed_form)?;
        options.set_item("seed", settings.seed)?;
        options.set_item("starts", settings.starts)?;
        options.set_item("step", settings.trace.step)?;
        options.set_item("max_rows", settings.trace.max_rows)?;
        let restore = py.get_type::<Self>().getattr("_restore")?;
        (restore, (given, pose_to_array(py, pose)?, options)).into_pyobject(py)
    }

    fn __repr__(&self) -> String {
        let set = &self.inner.set;
        let kind = if set.dimension() == 0 { "points" } else { "curves" };
        let proven = if set.proven() { "proven" } else { "not proven" };
        let reason = set.reason();
        let reason = if reason.is_empty() { reason } else { format!(": {reason}") };
        format!("Solutions({}, {} {kind}, {proven}{reason})", set.status(), set.pieces())
    }
}

/// A method of the Python object of the set, for `__reduce__`.
fn method_of<'py>(py: Python<'py>, inner: &Arc<Inner>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    Py::new(py, PySolutions { inner: inner.clone() })?.bind(py).getattr(name)
}

/// One point or curve of `Solutions`.
///
/// The parameter `u` of a closed curve has period 2 pi; for an S-R-S arm it is the swivel, for a traced curve it is
/// proportional to the length in joint space.
#[pyclass(name = "Piece", module = "redundancy", frozen)]
pub struct PyPiece {
    inner: Arc<Inner>,
    index: usize,
}

impl PyPiece {
    /// Evaluates `one` at `u` or at each of an array.
    fn at<'py>(
        &self,
        py: Python<'py>,
        u: Option<&Bound<'py, PyAny>>,
        one: impl Fn(&dyn Solutions, usize, f64, &mut [f64]) -> redundancy_core::Result<()>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let set = &*self.inner.set;
        let n = set.chain().dof();
        let Some(u) = u else {
            if set.dimension() > 0 {
                return Err(to_py(Error::Invalid("u is missing: a curve has many configurations".into())));
            }
            let mut row = vec![0.0; n];
            one(set, self.index, 0.0, &mut row).map_err(to_py)?;
            return Ok(PyArray1::from_vec(py, row).into_any());
        };
        let at = read_rows(u, "u", &[])?;
        let values = at.as_slice()?;
        let mut rows = vec![0.0; n * values.len()];
        for (row, u) in rows.chunks_exact_mut(n).zip(values) {
            one(set, self.index, *u, row).map_err(to_py)?;
        }
        match at.batch {
            None => Ok(PyArray1::from_vec(py, rows).into_any()),
            Some(count) => Ok(to_array(py, &rows, [count, n])?.into_any()),
        }
    }
}

#[pymethods]
impl PyPiece {
    /// Its index in `Solutions.pieces`.
    #[getter]
    fn index(&self) -> usize {
        self.index
    }

    /// Its name: the signs of the branch (shoulder, elbow, wrist), or a number.
    #[getter]
    fn label(&self) -> PyResult<String> {
        self.inner.set.label(self.index).map_err(to_py)
    }

    /// Whether it is a closed curve.
    #[getter]
    fn closed(&self) -> PyResult<bool> {
        self.inner.set.closed(self.index).map_err(to_py)
    }

    /// Ends of `u`: (-pi, pi) for a closed curve, (0, 0) for a point.
    #[getter]
    fn range(&self) -> PyResult<(f64, f64)> {
        let [lo, hi] = self.inner.set.range(self.index).map_err(to_py)?;
        Ok((lo, hi))
    }

    /// Configuration at `u`: `(n,)`, or `(N, n)` for `(N,)`. A point needs no `u`.
    ///
    /// Principal values, unless these violate a limit and another winding does not.
    ///
    /// Raises:
    ///     RedundancyError: `u` is not finite, is beyond the ends of an open curve, or is missing for a curve.
    #[pyo3(signature = (u=None))]
    fn q<'py>(&self, py: Python<'py>, u: Option<&Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        self.at(py, u, |set, piece, u, out| set.q(piece, u, out))
    }

    /// dq/du at `u`: `(n,)`, or `(N, n)` for `(N,)`; finite and not zero.
    ///
    /// Raises:
    ///     RedundancyError: as `q`; a point has no tangent.
    fn tangent<'py>(&self, py: Python<'py>, u: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.at(py, Some(u), |set, piece, u, out| set.tangent(piece, u, out))
    }

    /// Intervals of `u` in which all joint limits hold in some winding, `(k, 2)`, ascending.
    ///
    /// On a closed curve `u` is inside `[lo, hi]` when `(u - lo) mod 2 pi <= hi - lo`. For a point, `[[0, 0]]` or an
    /// empty array.
    ///
    /// Args:
    ///     margin: Distance from each limit, rad or m.
    #[pyo3(signature = (margin=0.0))]
    fn intervals<'py>(&self, py: Python<'py>, margin: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let arcs = self.inner.set.intervals(self.index, margin).map_err(to_py)?;
        to_array(py, arcs.as_flattened(), [arcs.len(), 2])
    }

    /// Value of the parameter named by the closed form (swivel: rad in [-pi, pi]) at `u`.
    ///
    /// `None` where there is none.
    ///
    /// Args:
    ///     u: Parameter on the piece: a number or `(N,)`; not needed for a point.
    #[pyo3(signature = (u=None))]
    fn parameter<'py>(&self, py: Python<'py>, u: Option<&Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        let set = &*self.inner.set;
        let value = |u: f64| set.parameter(self.index, u).map_err(to_py);
        let Some(u) = u else { return Ok(value(0.0)?.into_pyobject(py)?.into_any()) };
        let at = read_rows(u, "u", &[])?;
        let values: Vec<Option<f64>> = at.as_slice()?.iter().map(|u| value(*u)).collect::<PyResult<_>>()?;
        match (at.batch, values.first()) {
            (None, Some(value)) => Ok(value.into_pyobject(py)?.into_any()),
            _ => match values.into_iter().collect::<Option<Vec<f64>>>() {
                Some(values) => Ok(PyArray1::from_vec(py, values).into_any()),
                None => Ok(py.None().into_bound(py)),
            },
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (method_of(py, &self.inner, "_piece")?, (self.index,)).into_pyobject(py)
    }

    fn __repr__(&self) -> PyResult<String> {
        let kind = match (self.inner.set.dimension(), self.closed()?) {
            (0, _) => "point",
            (_, true) => "closed curve",
            (_, false) => "open curve",
        };
        Ok(format!("Piece({}, {kind})", self.label()?))
    }
}

/// A configuration chosen from `Solutions`; its parts are `None` if no configuration is within the limits.
#[pyclass(name = "Solution", module = "redundancy", frozen)]
pub struct PySolution {
    solution: Option<Solution>,
    inner: Arc<Inner>,
}

#[pymethods]
impl PySolution {
    /// Joint positions `(n,)` within the limits.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.solution.as_ref().map(|s| PyArray1::from_slice(py, &s.q))
    }

    /// Its piece.
    #[getter]
    fn piece(&self) -> Option<PyPiece> {
        self.solution.as_ref().map(|s| PyPiece { inner: self.inner.clone(), index: s.piece })
    }

    /// Its parameter on the piece, in the unit of `Piece.parameter`.
    #[getter]
    fn u(&self) -> Option<f64> {
        self.solution.as_ref().map(|s| s.u)
    }

    /// The criterion there in its own unit, or the distance in joint space, rad or m.
    #[getter]
    fn value(&self) -> Option<f64> {
        self.solution.as_ref().map(|s| s.value)
    }

    /// `converged`, `limits` or `unreachable`.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.inner.set.status())
    }

    /// Why there is none, or why it is not proven to be the best; empty otherwise.
    #[getter]
    fn reason(&self) -> String {
        let reason = self.inner.set.reason();
        match &self.solution {
            Some(solution) if !solution.proven && reason.is_empty() => {
                "the best of a dense scan of the pieces, refined".into()
            }
            _ => reason,
        }
    }

    /// Whether it is certain that no configuration for the pose is better, or that there is none.
    #[getter]
    fn proven(&self) -> bool {
        self.solution.as_ref().map_or_else(|| self.inner.set.proven(), |s| s.proven)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let parts = self.solution.clone().map(|s| (s.q, s.piece, s.u, s.value, s.proven));
        (method_of(py, &self.inner, "_solution")?, (parts,)).into_pyobject(py)
    }

    fn __repr__(&self) -> String {
        let set = &self.inner.set;
        match &self.solution {
            Some(s) => {
                let label = set.label(s.piece).unwrap_or_default();
                let proven = if s.proven { "proven" } else { "not proven" };
                format!("Solution(value {:.6e} at u {:.6} of piece {label}, {proven})", s.value, s.u)
            }
            None => format!("Solution({}: {})", set.status(), set.reason()),
        }
    }
}

/// Every configuration of an arm for a pose, through one interface for all arms.
///
/// From the closed form if the arm has one. Otherwise Newton's method is started from seeded random configurations
/// within the limits, and curves are traced through the configurations found; then `proven` is False, because there
/// may be others.
///
/// Args:
///     chain: The arm, or an arm object (whose chart then holds for the swivel).
///     pose: `(4, 4)` or SE3-like, base frame, m; `(2,)` for the task `planar`.
///     freedom: Must be `None`.
///     task: Which coordinates of the pose count; all of them by default. The task must leave no more than one
///         freedom.
///     closed_form: Whether to use the closed form if there is one.
///     seed: Seed of the random starts; default 0.
///     starts: Number of random starts; default 100.
///     step: Largest joint step between rows of traced curves; default 0.01.
///     max_rows: Rows after which following a curve is stopped; default 200 000.
///
/// Raises:
///     RedundancyError: a pose that is not rigid or finite, invalid settings, an arm with fewer joints than the task
///         has coordinates, or with at least two more.
///
/// Example:
///     >>> import redundancy as rd
///     >>> chain = rd.catalog.load("iiwa14")
///     >>> s = rd.solutions(chain, chain.forward([0.1, 0.5, 0.2, -1.2, 0.3, 0.8, 0.0]))
///     >>> s.dimension, str(s.status), s.proven, len(s.pieces)
///     (1, 'converged', True, 8)
///     >>> piece = s.pieces[0]
///     >>> piece.label, piece.closed, piece.q([0.0, 0.5]).shape
///     ('+++', True, (2, 7))
///     >>> s.best(rd.JointRange(chain)).proven
///     True
#[pyfunction]
#[pyo3(name = "solutions", signature = (
    chain, pose, freedom=None, *, task=None, closed_form=true, seed=None, starts=None, step=None, max_rows=None
))]
pub fn py_solutions(
    py: Python<'_>,
    chain: &Bound<'_, PyAny>,
    pose: &Bound<'_, PyAny>,
    freedom: Option<&Bound<'_, PyAny>>,
    task: Option<&Bound<'_, PyAny>>,
    closed_form: bool,
    seed: Option<Integer>,
    starts: Option<Integer>,
    step: Option<f64>,
    max_rows: Option<Integer>,
) -> PyResult<PySolutions> {
    if let Some(freedom) = freedom {
        let message = format!(
            "freedom is {}: sets with a free tool are not supported yet, it must be None",
            freedom.repr()?
        );
        return Err(to_py(Error::Invalid(message)));
    }
    let arm = read_arm(chain)?;
    let default = SolutionsSettings::default();
    let settings = SolutionsSettings {
        task: task.map_or(Ok(Task::POSE), read_task)?,
        closed_form,
        seed: seed.map_or(Ok(default.seed), |seed| seed.at_least("seed", 0))?,
        starts: starts.map_or(Ok(default.starts), |starts| starts.count("starts", 1))?,
        trace: TraceSettings {
            step: step.unwrap_or(default.trace.step),
            max_rows: max_rows.map_or(Ok(default.trace.max_rows), |rows| rows.count("max_rows", 1))?,
        },
    };
    let pose = read_target(pose, &settings.task)?;
    let model = arm.chain.get().chain.clone();
    let whole = matches!(settings.task.kind(), TaskKind::Pose | TaskKind::PoseRpy);
    let set = py.detach(|| match &arm.form {
        Some(form) if whole && closed_form => form.solutions(&pose),
        _ => solutions(&model, &pose, &settings),
    });
    let set = set.map_err(to_py)?;
    let given = chain.clone().unbind();
    Ok(PySolutions { inner: Arc::new(Inner { set, given, chain: arm.chain, pose, settings }) })
}
