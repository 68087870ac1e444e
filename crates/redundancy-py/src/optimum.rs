//! What kind of optimum is it, and where does it break.

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyType};
use redundancy_core::chain::Chain;
use redundancy_core::ik::{IkSettings, IkSolver};
use redundancy_core::kinematics::Task;
use redundancy_core::optimum::{
    Classification, Classifier, CofactorCondition, CriticalPoint, FollowSettings, FollowedOptimum, Kind,
    OptimaSettings, SingularPoint, SingularityCurve, SingularitySearch, SingularitySettings, Stop,
    cofactor_condition, constrained_optima, distance_to_nearest, follow_optimum, follow_starts, sort_starts,
};
use redundancy_core::path::Plan;
use redundancy_core::{Pose, Status};

use crate::batch::in_blocks_watching;
use crate::callback::Watching;
use crate::chain::PyChain;
use crate::convert::{Given, read_rows, read_vector, to_array};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::path::PyPath;
use crate::plan::{PyPlan, plan_initializer, plan_of};
use crate::status::{kind_to_py, status_to_py};
use crate::task::{read_target, read_task};

/// Critical points that are followed between two looks at Ctrl-C.
const FOLLOW_BLOCK: usize = 4;
/// Starts of a search for singularities between two looks at Ctrl-C.
const SEARCH_BLOCK: usize = 64;

fn task_or_pose(task: Option<&Bound<'_, PyAny>>) -> PyResult<Task> {
    task.map_or(Ok(Task::POSE), read_task)
}

/// What kind of point a configuration is for a criterion, among the configurations with the same task value.
///
/// Can be pickled.
#[pyclass(name = "Classification", module = "redundancy", frozen)]
pub struct PyClassification {
    at: Classification,
}

/// The words and numbers that make it again.
type ClassificationParts = (String, Vec<f64>, Vec<f64>, f64, f64);

fn parts(at: &Classification) -> ClassificationParts {
    let kind = at.kind.to_string();
    (kind, at.eigenvalues.clone(), at.multipliers.clone(), at.residual, at.sigma_min)
}

fn from_parts(parts: ClassificationParts) -> PyResult<Classification> {
    let (word, eigenvalues, multipliers, residual, sigma_min) = parts;
    let kind: Kind = word.parse().map_err(to_py)?;
    Ok(Classification { kind, eigenvalues, multipliers, residual, sigma_min })
}

#[pymethods]
impl PyClassification {
    /// `maximum`, `minimum`, `saddle`, `degenerate`, `not_critical` or `kinematic_singularity`.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        kind_to_py(py, self.at.kind)
    }

    /// `(r,)`: eigenvalues of the reduced Hessian on an orthonormal null-space basis, ascending.
    ///
    /// All negative: a maximum; all positive: a minimum; both signs: a saddle; one zero: degenerate, an algorithmic
    /// singularity. At a point that is not critical they are the second derivatives of h along the self-motion.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.at.eigenvalues)
    }

    /// `(m,)`: Lagrange multipliers `(J J^T)^-1 J grad h`.
    #[getter]
    fn multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.at.multipliers)
    }

    /// `|N^T grad h|` with an orthonormal null-space basis N: the slope of h along the self-motion.
    #[getter]
    fn residual(&self) -> f64 {
        self.at.residual
    }

    /// Smallest singular value of the task Jacobian (unit: m or 1 by its rows).
    #[getter]
    fn sigma_min(&self) -> f64 {
        self.at.sigma_min
    }

    fn __repr__(&self) -> String {
        let Classification { kind, eigenvalues, residual, sigma_min, .. } = &self.at;
        format!(
            "Classification({kind}, eigenvalues={eigenvalues:?}, residual={residual:e}, sigma_min={sigma_min})"
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, ClassificationParts)> {
        Ok((py.get_type::<Self>().getattr("_from_parts")?, parts(&self.at)))
    }

    /// Inverse of pickling.
    #[classmethod]
    fn _from_parts(
        _class: &Bound<'_, PyType>,
        kind: String,
        eigenvalues: Vec<f64>,
        multipliers: Vec<f64>,
        residual: f64,
        sigma_min: f64,
    ) -> PyResult<Self> {
        Ok(Self { at: from_parts((kind, eigenvalues, multipliers, residual, sigma_min))? })
    }
}

/// What kind of point `q` is for `criterion`, among the configurations with the same task value.
///
/// With the multipliers `lambda = (J J^T)^-1 J grad h` the reduced Hessian is
/// `W = N^T (Hess h - sum_k lambda_k Hess f_k) N`, N an orthonormal basis of the null space of J [Park1996, eq. (10)
/// at critical points]. Any chain, task and degree of redundancy.
///
/// Args:
///     chain: The arm.
///     q: `(n,)`, or `(N, n)` for a list of results.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///
/// Raises:
///     RedundancyError: a wrong length, entries that are not finite, a task that leaves no spare freedom.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> near = rd.Posture(arm, [0.3, 0.5, 0.7])
///     >>> str(rd.classify(arm, [0.3, 0.5, 0.7], near, task="planar").kind)
///     'minimum'
#[pyfunction]
#[pyo3(name = "classify", signature = (chain, q, criterion, task=None))]
pub fn py_classify<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    q: &Bound<'py, PyAny>,
    criterion: Given<'py, PyCriterion>,
    task: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let chain = &chain.get().chain;
    let watching = Watching::criterion(Some(criterion.get()));
    let criterion = criterion.get().criterion.as_ref();
    let mut classifier = Classifier::new(chain, criterion, task_or_pose(task)?).map_err(to_py)?;
    let rows = read_rows(q, "q", &[chain.dof()])?;
    let mut out = Vec::with_capacity(rows.batch.unwrap_or(1));
    for q in rows.as_slice()?.chunks_exact(chain.dof()) {
        let kind = classifier.classify(q);
        watching.check(py)?;
        let kind = kind.map_err(to_py)?;
        out.push(Bound::new(py, PyClassification { at: classifier.result(kind) })?);
    }
    match (rows.batch, out.pop()) {
        (None, Some(one)) => Ok(one.into_any()),
        (_, last) => {
            out.extend(last);
            Ok(PyList::new(py, out)?.into_any())
        }
    }
}

/// A critical point of a criterion for a pose. Can be pickled.
#[pyclass(name = "CriticalPoint", module = "redundancy", frozen)]
pub struct PyCriticalPoint {
    pub point: CriticalPoint,
}

#[pymethods]
impl PyCriticalPoint {
    /// `(n,)`: revolute joints in principal values, unless these violate a limit and another winding does not.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.q)
    }

    /// h(q), in the criterion's own unit.
    #[getter]
    fn value(&self) -> f64 {
        self.point.value
    }

    /// Whether all joint limits hold.
    #[getter]
    fn within_limits(&self) -> bool {
        self.point.within_limits
    }

    /// `maximum`, `minimum`, `saddle` or `degenerate`.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        kind_to_py(py, self.point.classification.kind)
    }

    /// `(r,)`, as for `Classification`.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.classification.eigenvalues)
    }

    /// `(m,)`, as for `Classification`.
    #[getter]
    fn multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.classification.multipliers)
    }

    /// The same as `Classification.residual`.
    #[getter]
    fn residual(&self) -> f64 {
        self.point.classification.residual
    }

    /// The same as `Classification.sigma_min`.
    #[getter]
    fn sigma_min(&self) -> f64 {
        self.point.classification.sigma_min
    }

    fn __repr__(&self) -> String {
        let CriticalPoint { q, value, classification, within_limits } = &self.point;
        let limits = if *within_limits { "" } else { ", outside joint limits" };
        format!("CriticalPoint({}, value={value}, q={q:?}{limits})", classification.kind)
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Vec<f64>, f64, bool, ClassificationParts))> {
        let CriticalPoint { q, value, classification, within_limits } = &self.point;
        let parts = (q.clone(), *value, *within_limits, parts(classification));
        Ok((py.get_type::<Self>().getattr("_from_parts")?, parts))
    }

    /// Inverse of pickling.
    #[classmethod]
    fn _from_parts(
        _class: &Bound<'_, PyType>,
        q: Vec<f64>,
        value: f64,
        within_limits: bool,
        classification: ClassificationParts,
    ) -> PyResult<Self> {
        let classification = from_parts(classification)?;
        Ok(Self { point: CriticalPoint { q, value, classification, within_limits } })
    }
}

/// Every critical point of `criterion` found over `pose`, the best value first.
///
/// With one spare freedom the self-motion curves are followed and every zero of the slope is polished by Newton; on
/// S-R-S arms the curves are the circles of the closed form, so that none is missed, on other arms they are found
/// from random starts. With more spare freedoms Newton's method runs from random starts. Points outside joint limits
/// are reported with `within_limits` False; kinematic singularities are not critical points.
///
/// Args:
///     chain: The arm.
///     pose: A pose; for `planar` also `(2,)`, for `position` also `(3,)`.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///     seed: Seed of the random starts.
///     starts: Number of random starts; default 100.
///     step: Largest joint step between the points of a curve at which the slope is computed; default 0.1.
///
/// Raises:
///     RedundancyError: an invalid pose, a task that leaves no spare freedom, settings out of range.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> points = rd.constrained_optima(arm, [2, 0], rd.Manipulability(arm, task="planar"), task="planar")
///     >>> len(points), str(points[0].kind), round(points[0].value, 4)
///     (12, 'maximum', 75.0395)
#[pyfunction]
#[pyo3(name = "constrained_optima", signature = (chain, pose, criterion, task=None, *, seed=0, starts=None, step=None))]
pub fn py_constrained_optima(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    pose: &Bound<'_, PyAny>,
    criterion: Given<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: Option<usize>,
    step: Option<f64>,
) -> PyResult<Vec<PyCriticalPoint>> {
    let watching = Watching::criterion(Some(criterion.get()));
    let (chain, criterion) = (chain.get().chain.clone(), criterion.get().criterion.clone());
    let task = task_or_pose(task)?;
    let target = read_target(pose, &task)?;
    let default = OptimaSettings::default();
    let settings =
        OptimaSettings { seed, starts: starts.unwrap_or(default.starts), step: step.unwrap_or(default.step) };
    let points =
        watching.detach(py, || constrained_optima(&chain, &target, criterion.as_ref(), task, &settings));
    watching.check(py)?;
    let points = points.map_err(to_py)?;
    Ok(points.into_iter().map(|point| PyCriticalPoint { point }).collect())
}

/// Sufficient condition of [Park1996, eqs (8), (9), (11)] by cofactors, for one spare freedom. Can be pickled.
#[pyclass(name = "CofactorCondition", module = "redundancy", frozen)]
pub struct PyCofactorCondition {
    at: CofactorCondition,
}

#[pymethods]
impl PyCofactorCondition {
    #[new]
    fn new(n: &Bound<'_, PyAny>, mu: f64, condition: f64) -> PyResult<Self> {
        Ok(Self { at: CofactorCondition { n: read_vector(n, "n", None)?, mu, a: condition } })
    }

    /// `(n,)`: null vector of cofactors, `|n|^2 = det J J^T`.
    #[getter]
    fn n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.at.n)
    }

    /// `n . grad h`, in the criterion's unit per rad: zero at critical points.
    #[getter]
    fn mu(&self) -> f64 {
        self.at.mu
    }

    /// The paper's A, `det(J J^T)` times the eigenvalue of `classify`: negative at a maximum.
    #[getter]
    fn condition(&self) -> f64 {
        self.at.a
    }

    fn __repr__(&self) -> String {
        let CofactorCondition { n, mu, a } = &self.at;
        format!("CofactorCondition(n={n:?}, mu={mu:e}, condition={a})")
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (Vec<f64>, f64, f64)) {
        (py.get_type::<Self>(), (self.at.n.clone(), self.at.mu, self.at.a))
    }
}

/// The paper's own n, mu and A at `q`, for tasks that leave one spare freedom.
///
/// Args:
///     chain: The arm.
///     q: Joint positions `(n,)`, rad or m.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///
/// Raises:
///     RedundancyError: a task that leaves another number of freedoms, a wrong length, entries that are not finite.
///
/// Example:
///     >>> import math, redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> p1 = [math.radians(x) for x in (-87.1742, 111.7847, 77.5352)]
///     >>> round(rd.cofactor_condition(arm, p1, rd.Manipulability(arm, task="planar"), task="planar").condition)
///     -4861
#[pyfunction]
#[pyo3(name = "cofactor_condition", signature = (chain, q, criterion, task=None))]
pub fn py_cofactor_condition(
    chain: &Bound<'_, PyChain>,
    q: &Bound<'_, PyAny>,
    criterion: Given<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyCofactorCondition> {
    let chain = &chain.get().chain;
    let q = read_vector(q, "q", Some(chain.dof()))?;
    let watching = Watching::criterion(Some(criterion.get()));
    let h = criterion.get().criterion.as_ref();
    let at = cofactor_condition(chain, &q, h, task_or_pose(task)?);
    watching.check(criterion.py())?;
    let at = at.map_err(to_py)?;
    Ok(PyCofactorCondition { at })
}

/// A critical point followed along a path: a plan with one row per path point up to its stop. Can be pickled.
///
/// If it stopped early, the last event is an `algorithmic_singularity` or a `kinematic_singularity`; its `index` is
/// the path point that was not reached, its `s` and `t` are exact. `joint_limit` events mark rows at which joints
/// leave their limits or return. `status` is `converged` if the path was completed within the limits, `singular` if
/// it stopped early, `limits` if a joint violates a position limit, or a speed limit at the path's times.
#[pyclass(name = "FollowedOptimum", module = "redundancy", frozen, extends = PyPlan)]
pub struct PyFollowedOptimum {
    followed: FollowedOptimum,
}

/// The numbers beside the trajectory that make it again.
type FollowedParts = (String, Vec<f64>, Vec<f64>, Vec<f64>, Option<(f64, Vec<f64>)>);

impl PyFollowedOptimum {
    fn new_bound(py: Python<'_>, followed: FollowedOptimum, plan: Plan) -> PyResult<Bound<'_, Self>> {
        Bound::new(py, plan_initializer(plan).add_subclass(Self { followed }))
    }
}

#[pymethods]
impl PyFollowedOptimum {
    /// Kind of the critical point; the same along the whole path.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        kind_to_py(py, self.followed.kind)
    }

    /// Whether the path was completed.
    #[getter]
    fn completed(&self) -> bool {
        self.followed.stop.is_none()
    }

    /// `(N,)`: the criterion at each row.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.followed.values)
    }

    /// `(N,)`: smallest singular value of the task Jacobian at each row.
    #[getter]
    fn sigma_min<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.followed.sigma_min)
    }

    /// `(N, r)`: eigenvalues of the reduced Hessian at each row, ascending.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (rows, all) = (self.followed.values.len(), &self.followed.eigenvalues);
        Ok(to_array(py, all, [rows, all.len() / rows.max(1)])?.into_any())
    }

    /// `(n,)`: configuration at which it stopped.
    #[getter]
    fn stop_q<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.followed.stop.as_ref().map(|stop| PyArray1::from_slice(py, &stop.q))
    }

    /// Arc length at which it stopped, m.
    #[getter]
    fn stop_s(&self) -> Option<f64> {
        self.followed.stop.as_ref().map(|stop| stop.s)
    }

    fn __repr__(&self) -> String {
        let end = self.followed.stop.as_ref().map_or("completed".into(), |stop| stop.message.clone());
        format!("FollowedOptimum({}, {} rows, {end})", self.followed.kind, self.followed.values.len())
    }

    fn __reduce__<'py>(
        this: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>, FollowedParts))> {
        let arrays = PyPlan::everything(this.as_super())?;
        let FollowedOptimum { kind, values, sigma_min, eigenvalues, stop, .. } = &this.get().followed;
        let stop = stop.as_ref().map(|stop| (stop.s, stop.q.clone()));
        let parts = (kind.to_string(), values.clone(), sigma_min.clone(), eigenvalues.clone(), stop);
        Ok((this.get_type().getattr("_from_parts")?, (arrays, parts)))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts<'py>(arrays: &Bound<'py, PyAny>, parts: FollowedParts) -> PyResult<Bound<'py, Self>> {
        let plan = plan_of(arrays)?;
        let (word, values, sigma_min, eigenvalues, stop) = parts;
        let stop = stop.zip(plan.trajectory().events().last()).map(|((s, q), event)| Stop {
            kind: event.kind,
            s,
            q,
            message: event.message.clone(),
        });
        let (kind, q) = (word.parse().map_err(to_py)?, plan.q().to_vec());
        let followed = FollowedOptimum { kind, q, values, sigma_min, eigenvalues, stop };
        Self::new_bound(arrays.py(), followed, plan)
    }
}

fn follow_settings(step: Option<f64>) -> FollowSettings {
    let default = FollowSettings::default();
    FollowSettings { step: step.unwrap_or(default.step) }
}

/// Follows the critical point of `criterion` next to `q0` along `path`: the extended Jacobian, exactly.
///
/// Every row is on the path and critical to rounding, so closed paths are closed in the joints. It stops where the
/// critical point meets another one and both vanish (algorithmic singularity) or where the Jacobian loses rank
/// (kinematic singularity), and never jumps across such a point.
///
/// Args:
///     chain: The arm.
///     path: Path of the tool; for `position` and `planar` it needs no orientations.
///     q0: `(n,)`: a critical point for the start of the path, to about 0.02 rad; see `constrained_optima`.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///     step: Largest step in the joints, from 1e-4 to 0.5; default 0.05.
///
/// Raises:
///     RedundancyError: a `q0` that is not a critical point for the start, a path without the orientations that the
///         task needs, a task that leaves no spare freedom, invalid settings.
///
/// Example:
///     >>> import math, redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> h = rd.Manipulability(arm, task="planar")
///     >>> circle = rd.paths.circle((3.5, 0, 0), 1.5, start=math.pi, n=51)
///     >>> q0 = rd.constrained_optima(arm, [2, 0], h, task="planar")[0].q
///     >>> rd.follow_optimum(arm, circle, q0, h, task="planar").completed
///     True
#[pyfunction]
#[pyo3(name = "follow_optimum", signature = (chain, path, q0, criterion, task=None, *, step=None))]
pub fn py_follow_optimum<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    path: Given<'py, PyPath>,
    q0: &Bound<'py, PyAny>,
    criterion: Given<'py, PyCriterion>,
    task: Option<&Bound<'py, PyAny>>,
    step: Option<f64>,
) -> PyResult<Bound<'py, PyFollowedOptimum>> {
    let (chain, path) = (&chain.get().chain, &path.get().path);
    let watching = Watching::criterion(Some(criterion.get()));
    let criterion = criterion.get().criterion.clone();
    let q0 = read_vector(q0, "q0", Some(chain.dof()))?;
    let (task, settings) = (task_or_pose(task)?, follow_settings(step));
    let done = watching.detach(py, || {
        let followed = follow_optimum(chain, path, &q0, criterion.as_ref(), task, &settings)?;
        let plan = followed.plan(chain, path)?;
        Ok((followed, plan))
    });
    watching.check(py)?;
    let (followed, plan) = done.map_err(to_py)?;
    PyFollowedOptimum::new_bound(py, followed, plan)
}

/// A critical point at a path's start, and how far it can be followed. Can be pickled.
#[pyclass(name = "RankedStart", module = "redundancy", frozen)]
pub struct PyRankedStart {
    point: Py<PyCriticalPoint>,
    trajectory: Py<PyFollowedOptimum>,
}

impl PyRankedStart {
    fn plan<'a>(&'a self, py: Python<'a>) -> &'a Plan {
        &self.trajectory.bind(py).as_super().get().plan
    }
}

#[pymethods]
impl PyRankedStart {
    #[new]
    fn new(point: Py<PyCriticalPoint>, trajectory: Py<PyFollowedOptimum>) -> Self {
        Self { point, trajectory }
    }

    /// The critical point.
    #[getter]
    fn point(&self, py: Python<'_>) -> Py<PyCriticalPoint> {
        self.point.clone_ref(py)
    }

    /// `(n,)`: its configuration.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.point.get().q(py)
    }

    /// h(q), in the criterion's own unit.
    #[getter]
    fn value(&self) -> f64 {
        self.point.get().value()
    }

    /// What it is.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.point.get().kind(py)
    }

    /// Whether the path is completed from here.
    ///
    /// Also False if a joint leaves its limits: `status` and `reason` say so.
    #[getter]
    fn completed(&self, py: Python<'_>) -> bool {
        self.plan(py).status() == Status::Converged
    }

    /// `converged`, `singular` if the critical point vanishes, `limits` if a joint violates a limit.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.plan(py).status())
    }

    /// Why the path is not completed; empty if it is.
    #[getter]
    fn reason(&self, py: Python<'_>) -> String {
        self.plan(py).reason().into()
    }

    /// The critical point followed along the path.
    #[getter]
    fn trajectory(&self, py: Python<'_>) -> Py<PyFollowedOptimum> {
        self.trajectory.clone_ref(py)
    }

    fn __repr__(&self) -> String {
        format!("RankedStart({}, {})", self.point.get().__repr__(), self.trajectory.get().__repr__())
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyType>, (Py<PyCriticalPoint>, Py<PyFollowedOptimum>)) {
        (py.get_type::<Self>(), (self.point(py), self.trajectory(py)))
    }
}

/// Follows every critical point for the start of `path`, and sorts them.
///
/// First come those that complete the path, ordered by whether they are of the kind that the criterion asks for, then
/// by value; next those that stop, the one that gets farthest first; last those that leave the joint limits. The
/// result is a list with `status` and `reason`: why it is empty, or why no start completes the path.
///
/// Args:
///     chain: The arm.
///     path: Path of the tool.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///     seed: As for `constrained_optima`.
///     starts: As for `constrained_optima`.
///     step: As for `follow_optimum`.
///     threads: Number of threads; None: all cores.
///
/// Raises:
///     RedundancyError: as `constrained_optima` and `follow_optimum`.
///
/// Example:
///     >>> import math, redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> circle = rd.paths.circle((3.5, 0, 0), 1.5, start=math.pi, n=51)
///     >>> ranked = rd.rank_starts(arm, circle, rd.Manipulability(arm, task="planar"), task="planar")
///     >>> [start.completed for start in ranked[:3]]
///     [True, True, False]
#[pyfunction]
#[pyo3(name = "rank_starts",
    signature = (chain, path, criterion, task=None, *, seed=0, starts=None, step=None, threads=None))]
pub fn py_rank_starts<'py>(
    py: Python<'py>,
    chain: &Bound<'_, PyChain>,
    path: Given<'_, PyPath>,
    criterion: Given<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: Option<usize>,
    step: Option<f64>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let (chain, path) = (&chain.get().chain, &path.get().path);
    let watching = Watching::criterion(Some(criterion.get()));
    let criterion = criterion.get().criterion.clone();
    let (task, settings) = (task_or_pose(task)?, follow_settings(step));
    let default = OptimaSettings::default();
    let optima = OptimaSettings { seed, starts: starts.unwrap_or(default.starts), ..default };
    let h = criterion.as_ref();
    let (mut points, mut ranked) = (Vec::new(), Vec::new());
    in_blocks_watching(py, 1, 1, threads, &watching, |_| {
        points = constrained_optima(chain, &path.poses()[0], h, task, &optima)?;
        // Says what is wrong with the other arguments where there is no point to follow.
        follow_starts(chain, path, h, task, Vec::new(), &settings).map(drop)
    })?;
    in_blocks_watching(py, points.len(), FOLLOW_BLOCK, threads, &watching, |r| {
        ranked.extend(follow_starts(chain, path, h, task, points[r].to_vec(), &settings)?);
        Ok(())
    })?;
    sort_starts(&mut ranked, h.sense());
    let mut plans = Vec::with_capacity(ranked.len());
    for start in ranked {
        let plan = start.followed.plan(chain, path).map_err(to_py)?;
        plans.push((start, plan));
    }
    // Starts that keep the limits all the way come before those that do not.
    plans.sort_by_key(|(_, plan)| plan.status() == Status::Limits);
    let whole = plans.iter().filter(|(_, plan)| plan.status() == Status::Converged).count();
    let (status, reason) = match plans.first() {
        None => start_out_of_reach(chain, &path.poses()[0], task, seed)?,
        Some((_, plan)) if whole == 0 => (
            plan.status(),
            format!("none of {} starts completes the path; the best: {}", plans.len(), plan.reason()),
        ),
        Some(_) => (Status::Converged, String::new()),
    };
    let starts = plans.into_iter().map(|(start, plan)| {
        let trajectory = PyFollowedOptimum::new_bound(py, start.followed, plan)?.unbind();
        Py::new(py, PyRankedStart { point: Py::new(py, PyCriticalPoint { point: start.point })?, trajectory })
    });
    let starts = starts.collect::<PyResult<Vec<_>>>()?;
    let class = py.import("redundancy._ranked")?.getattr("RankedStarts")?;
    class.call1((starts, status_to_py(py, status)?, reason))
}

/// Why no critical point was found over the start of a path.
fn start_out_of_reach(chain: &Chain, pose: &Pose, task: Task, seed: u64) -> PyResult<(Status, String)> {
    let solver = IkSolver::new(chain, IkSettings { task, ..IkSettings::default() }).map_err(to_py)?;
    let result = solver.solve(pose, None, seed).map_err(to_py)?;
    Ok(match result.status {
        Status::Converged | Status::Limits => {
            (Status::IterationLimit, "no critical point was found for the start of the path".into())
        }
        status => (status, format!("the start of the path: {}", result.reason())),
    })
}

/// A configuration at which a critical point vanishes: an algorithmic singularity. Can be pickled.
#[pyclass(name = "SingularPoint", module = "redundancy", frozen)]
pub struct PySingularPoint {
    point: SingularPoint,
}

#[pymethods]
impl PySingularPoint {
    #[new]
    fn new(q: Vec<f64>, position: [f64; 3], residual: f64, first_joint_free: bool, dimension: usize) -> Self {
        Self { point: SingularPoint { q, position, residual, first_joint_free, dimension } }
    }

    /// `(n,)`: configuration; the first joint is zero where it is free.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.q)
    }

    /// `(3,)`: where the tool is, m.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.position)
    }

    /// What is left of `mu = 0` and of the least eigenvalue: ratio to gradient and curvature of the criterion.
    #[getter]
    fn residual(&self) -> f64 {
        self.point.residual
    }

    /// Whether every value of the first joint gives a singular point.
    #[getter]
    fn first_joint_free(&self) -> bool {
        self.point.first_joint_free
    }

    /// Dimension of the set it belongs to (without a free first joint): 0 for isolated points, else a sample.
    #[getter]
    fn dimension(&self) -> usize {
        self.point.dimension
    }

    fn __repr__(&self) -> String {
        let SingularPoint { q, position, residual, .. } = &self.point;
        format!("SingularPoint(q={q:?}, position={position:?}, residual={residual:e})")
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyType>, (Vec<f64>, [f64; 3], f64, bool, usize)) {
        let SingularPoint { q, position, residual, first_joint_free, dimension } = self.point.clone();
        (py.get_type::<Self>(), (q, position, residual, first_joint_free, dimension))
    }
}

fn singularity_settings(seed: u64, starts: Option<usize>) -> SingularitySettings {
    let default = SingularitySettings::default();
    SingularitySettings { seed, starts: starts.unwrap_or(default.starts) }
}

/// The whole search, with a look for Ctrl-C between pieces.
fn run_search(
    py: Python<'_>,
    search: &mut SingularitySearch<'_>,
    threads: Option<usize>,
    watching: &Watching,
) -> PyResult<()> {
    in_blocks_watching(py, search.starts(), SEARCH_BLOCK, threads, watching, |r| {
        search.run(r.len());
        Ok(())
    })
}

/// Where critical points of `criterion` vanish, for any value of the task.
///
/// Solves `mu = 0`, `det W = 0` by Newton's method from random starts. For planar positions and criteria that do not
/// depend on the first joint, the points are isolated, and each stands for a circle about the base; otherwise they
/// are samples of a set.
///
/// Args:
///     chain: The arm.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///     seed: Seed of the random starts.
///     starts: Most random starts; default 2000. The search for isolated points ends when three quarters of the
///         starts, and at least 256, have found nothing new.
///     threads: Number of threads; None: all cores. The result does not depend on it.
///
/// Raises:
///     RedundancyError: a task that leaves no spare freedom, settings out of range.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> len(rd.algorithmic_singularities(arm, rd.Manipulability(arm, task="planar"), task="planar"))
///     10
#[pyfunction]
#[pyo3(name = "algorithmic_singularities",
    signature = (chain, criterion, task=None, *, seed=0, starts=None, threads=None))]
pub fn py_algorithmic_singularities(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    criterion: Given<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: Option<usize>,
    threads: Option<usize>,
) -> PyResult<Vec<PySingularPoint>> {
    let chain = &chain.get().chain;
    let watching = Watching::criterion(Some(criterion.get()));
    let criterion = criterion.get().criterion.clone();
    let task = task_or_pose(task)?;
    let settings = singularity_settings(seed, starts);
    let mut search = SingularitySearch::new(chain, criterion.as_ref(), task, &settings).map_err(to_py)?;
    run_search(py, &mut search, threads, &watching)?;
    Ok(search.finish().into_iter().map(|point| PySingularPoint { point }).collect())
}

/// Configurations at which critical points vanish, in order. Can be pickled; `len()` is the number of rows.
#[pyclass(name = "SingularityCurve", module = "redundancy", frozen)]
pub struct PySingularityCurve {
    curve: SingularityCurve,
    n: usize,
}

#[pymethods]
impl PySingularityCurve {
    #[new]
    fn new(q: PyReadonlyArray2<'_, f64>, closed: bool, first_joint_free: bool) -> Self {
        let (n, q) = (q.as_array().ncols(), q.as_array().iter().copied().collect());
        Self { curve: SingularityCurve { q, closed, first_joint_free }, n }
    }

    /// `(N, n)`: configurations.
    ///
    /// Joints change continuously, beyond half a turn where whole turns make no difference to the criterion.
    ///
    /// The first joint is zero where it is free. The last row of a closed curve is the first one, up to whole turns.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, &self.curve.q, [self.__len__(), self.n])
    }

    /// Whether the curve is closed.
    ///
    /// An open curve ends where the arm is singular, where it crosses another one, or, for criteria of joint values,
    /// where a joint changes its winding.
    #[getter]
    fn closed(&self) -> bool {
        self.curve.closed
    }

    /// Whether every value of the first joint gives such a curve.
    #[getter]
    fn first_joint_free(&self) -> bool {
        self.curve.first_joint_free
    }

    fn __len__(&self) -> usize {
        self.curve.q.len() / self.n.max(1)
    }

    fn __repr__(&self) -> String {
        let word = if self.curve.closed { "closed" } else { "open" };
        format!("SingularityCurve({word}, {} rows)", self.__len__())
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyType>, (Bound<'py, PyArray2<f64>>, bool, bool))> {
        let SingularityCurve { closed, first_joint_free, .. } = self.curve;
        Ok((py.get_type::<Self>(), (self.q(py)?, closed, first_joint_free)))
    }
}

/// The curves on which critical points of `criterion` vanish, longest first.
///
/// They are curves where `mu = 0`, `det W = 0` leave one freedom. The points of `algorithmic_singularities` are
/// followed in both directions; curves without one of them are missed.
///
/// Args:
///     chain: The arm.
///     criterion: The criterion.
///     task: Which coordinates are kept; the pose by default.
///     step: Largest step between rows, rad or m.
///     seed: Seed of the random starts.
///     starts: Number of random starts; default 2000.
///     threads: Number of threads; None: all cores. The result does not depend on it.
///
/// Raises:
///     RedundancyError: a set of singularities of another dimension than one, settings out of range.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> posture = rd.Posture(arm, [0.3, 0.5, 0.7])
///     >>> len(rd.singularity_curves(arm, posture, task="planar", starts=300))
///     8
#[pyfunction]
#[pyo3(name = "singularity_curves",
    signature = (chain, criterion, task=None, *, step=0.05, seed=0, starts=None, threads=None))]
pub fn py_singularity_curves(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    criterion: Given<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    step: f64,
    seed: u64,
    starts: Option<usize>,
    threads: Option<usize>,
) -> PyResult<Vec<PySingularityCurve>> {
    let chain = &chain.get().chain;
    let watching = Watching::criterion(Some(criterion.get()));
    let criterion = criterion.get().criterion.clone();
    let task = task_or_pose(task)?;
    let settings = singularity_settings(seed, starts);
    let mut search = SingularitySearch::new(chain, criterion.as_ref(), task, &settings).map_err(to_py)?;
    search.check_curves(step).map_err(to_py)?;
    run_search(py, &mut search, threads, &watching)?;
    let mut tracer = search.tracer(step).map_err(to_py)?;
    in_blocks_watching(py, tracer.starts(), 1, threads, &watching, |r| {
        tracer.run(r.len());
        Ok(())
    })?;
    let curves = tracer.finish();
    Ok(curves.into_iter().map(|curve| PySingularityCurve { curve, n: chain.dof() }).collect())
}

/// Distance in joint space of `q` `(n,)` or `(N, n)` from the nearest of `points`, revolute joints the short way.
///
/// The first joint is left out where it is free for all points.
///
/// Args:
///     chain: The arm.
///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
///     points: What `algorithmic_singularities` returns.
///
/// Raises:
///     RedundancyError: no points, a wrong length, entries that are not finite.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("planar3r")
///     >>> points = rd.algorithmic_singularities(arm, rd.Manipulability(arm, task="planar"), task="planar")
///     >>> round(rd.singularity_distance(arm, points[0].q + [1.0, 0.01, 0.0], points), 12)
///     0.01
#[pyfunction]
#[pyo3(name = "singularity_distance", signature = (chain, q, points))]
pub fn py_singularity_distance<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    q: &Bound<'py, PyAny>,
    points: Vec<Bound<'py, PySingularPoint>>,
) -> PyResult<Bound<'py, PyAny>> {
    let chain = &chain.get().chain;
    let rows = read_rows(q, "q", &[chain.dof()])?;
    let free = points.iter().all(|point| point.get().point.first_joint_free);
    let points: Vec<Vec<f64>> = points.iter().map(|point| point.get().point.q.clone()).collect();
    let distances = distance_to_nearest(chain, rows.as_slice()?, &points, free).map_err(to_py)?;
    match (rows.batch, distances.as_slice()) {
        (None, [distance]) => Ok(distance.into_pyobject(py)?.into_any()),
        _ => Ok(PyArray1::from_vec(py, distances).into_any()),
    }
}
