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

use crate::batch::in_blocks;
use crate::chain::PyChain;
use crate::convert::{read_rows, read_vector, to_array};
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

/// What is known about a configuration.
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
    /// What it is.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        kind_to_py(py, self.at.kind)
    }

    /// Eigenvalues of the reduced Hessian, ascending.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.at.eigenvalues)
    }

    /// Lagrange multipliers.
    #[getter]
    fn multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.at.multipliers)
    }

    /// Slope of the criterion along the self-motion.
    #[getter]
    fn residual(&self) -> f64 {
        self.at.residual
    }

    /// Smallest singular value of the task Jacobian.
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

/// What configurations are to a criterion.
#[pyfunction]
#[pyo3(name = "classify", signature = (chain, q, criterion, task=None))]
pub fn py_classify<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    q: &Bound<'py, PyAny>,
    criterion: &Bound<'py, PyCriterion>,
    task: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let chain = &chain.get().chain;
    let criterion = criterion.get().criterion.as_ref();
    let mut classifier = Classifier::new(chain, criterion, task_or_pose(task)?).map_err(to_py)?;
    let rows = read_rows(q, "q", &[chain.dof()])?;
    let mut out = Vec::with_capacity(rows.batch.unwrap_or(1));
    for q in rows.as_slice()?.chunks_exact(chain.dof()) {
        let kind = classifier.classify(q).map_err(to_py)?;
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

/// A critical point over a pose.
#[pyclass(name = "CriticalPoint", module = "redundancy", frozen)]
pub struct PyCriticalPoint {
    pub point: CriticalPoint,
}

#[pymethods]
impl PyCriticalPoint {
    /// Configuration.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.q)
    }

    /// h(q).
    #[getter]
    fn value(&self) -> f64 {
        self.point.value
    }

    /// Whether all joint limits hold.
    #[getter]
    fn within_limits(&self) -> bool {
        self.point.within_limits
    }

    /// What it is.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        kind_to_py(py, self.point.classification.kind)
    }

    /// Eigenvalues of the reduced Hessian, ascending.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.classification.eigenvalues)
    }

    /// Lagrange multipliers.
    #[getter]
    fn multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.classification.multipliers)
    }

    /// Slope of the criterion along the self-motion.
    #[getter]
    fn residual(&self) -> f64 {
        self.point.classification.residual
    }

    /// Smallest singular value of the task Jacobian.
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

/// The critical points of a criterion over a pose.
#[pyfunction]
#[pyo3(name = "constrained_optima", signature = (chain, pose, criterion, task=None, *, seed=0, starts=None, step=None))]
pub fn py_constrained_optima(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    pose: &Bound<'_, PyAny>,
    criterion: &Bound<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: Option<usize>,
    step: Option<f64>,
) -> PyResult<Vec<PyCriticalPoint>> {
    let (chain, criterion) = (chain.get().chain.clone(), criterion.get().criterion.clone());
    let task = task_or_pose(task)?;
    let target = read_target(pose, &task)?;
    let default = OptimaSettings::default();
    let settings =
        OptimaSettings { seed, starts: starts.unwrap_or(default.starts), step: step.unwrap_or(default.step) };
    let points = py
        .detach(|| constrained_optima(&chain, &target, criterion.as_ref(), task, &settings))
        .map_err(to_py)?;
    Ok(points.into_iter().map(|point| PyCriticalPoint { point }).collect())
}

/// The condition of cofactors for one spare freedom.
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

    /// The null vector of cofactors.
    #[getter]
    fn n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.at.n)
    }

    /// `n . grad h`.
    #[getter]
    fn mu(&self) -> f64 {
        self.at.mu
    }

    /// The sufficient condition.
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

/// The paper's condition at a configuration.
#[pyfunction]
#[pyo3(name = "cofactor_condition", signature = (chain, q, criterion, task=None))]
pub fn py_cofactor_condition(
    chain: &Bound<'_, PyChain>,
    q: &Bound<'_, PyAny>,
    criterion: &Bound<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyCofactorCondition> {
    let chain = &chain.get().chain;
    let q = read_vector(q, "q", Some(chain.dof()))?;
    let criterion = criterion.get().criterion.as_ref();
    let at = cofactor_condition(chain, &q, criterion, task_or_pose(task)?).map_err(to_py)?;
    Ok(PyCofactorCondition { at })
}

/// A critical point followed along a path.
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
    /// What it is, all along.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        kind_to_py(py, self.followed.kind)
    }

    /// Whether the path was finished.
    #[getter]
    fn completed(&self) -> bool {
        self.followed.stop.is_none()
    }

    /// h at each row.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.followed.values)
    }

    /// Smallest singular value of the task Jacobian at each row.
    #[getter]
    fn sigma_min<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.followed.sigma_min)
    }

    /// Eigenvalues of the reduced Hessian at each row.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (rows, all) = (self.followed.values.len(), &self.followed.eigenvalues);
        Ok(to_array(py, all, [rows, all.len() / rows.max(1)])?.into_any())
    }

    /// Configuration at which it stopped.
    #[getter]
    fn stop_q<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.followed.stop.as_ref().map(|stop| PyArray1::from_slice(py, &stop.q))
    }

    /// Arc length at which it stopped.
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

/// Follows a critical point along a path.
#[pyfunction]
#[pyo3(name = "follow_optimum", signature = (chain, path, q0, criterion, task=None, *, step=None))]
pub fn py_follow_optimum<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    path: &Bound<'py, PyPath>,
    q0: &Bound<'py, PyAny>,
    criterion: &Bound<'py, PyCriterion>,
    task: Option<&Bound<'py, PyAny>>,
    step: Option<f64>,
) -> PyResult<Bound<'py, PyFollowedOptimum>> {
    let (chain, path) = (&chain.get().chain, &path.get().path);
    let criterion = criterion.get().criterion.clone();
    let q0 = read_vector(q0, "q0", Some(chain.dof()))?;
    let (task, settings) = (task_or_pose(task)?, follow_settings(step));
    let (followed, plan) = py
        .detach(|| {
            let followed = follow_optimum(chain, path, &q0, criterion.as_ref(), task, &settings)?;
            let plan = followed.plan(chain, path)?;
            Ok((followed, plan))
        })
        .map_err(to_py)?;
    PyFollowedOptimum::new_bound(py, followed, plan)
}

/// A critical point at a path's start, and how far it goes.
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

    /// Configuration of the critical point.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.point.get().q(py)
    }

    /// h(q).
    #[getter]
    fn value(&self) -> f64 {
        self.point.get().value()
    }

    /// What it is.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.point.get().kind(py)
    }

    /// Whether the path is finished from here.
    ///
    /// False as well where a joint leaves its limits on the way: `status` and `reason` say so.
    #[getter]
    fn completed(&self, py: Python<'_>) -> bool {
        self.plan(py).status() == Status::Converged
    }

    /// `converged`, `singular` where the critical point vanishes, `limits` where a joint breaks a limit.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.plan(py).status())
    }

    /// What keeps it from completing the path; empty when it does.
    #[getter]
    fn reason(&self, py: Python<'_>) -> String {
        self.plan(py).reason().into()
    }

    /// What following it gave.
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

/// Follows every critical point at the start of a path.
#[pyfunction]
#[pyo3(name = "rank_starts",
    signature = (chain, path, criterion, task=None, *, seed=0, starts=None, step=None, threads=None))]
pub fn py_rank_starts<'py>(
    py: Python<'py>,
    chain: &Bound<'_, PyChain>,
    path: &Bound<'_, PyPath>,
    criterion: &Bound<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: Option<usize>,
    step: Option<f64>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let (chain, path) = (&chain.get().chain, &path.get().path);
    let criterion = criterion.get().criterion.clone();
    let (task, settings) = (task_or_pose(task)?, follow_settings(step));
    let default = OptimaSettings::default();
    let optima = OptimaSettings { seed, starts: starts.unwrap_or(default.starts), ..default };
    let h = criterion.as_ref();
    let (mut points, mut ranked) = (Vec::new(), Vec::new());
    in_blocks(py, 1, 1, threads, |_| {
        points = constrained_optima(chain, &path.poses()[0], h, task, &optima)?;
        // Says what is wrong with the other arguments where there is no point to follow.
        follow_starts(chain, path, h, task, Vec::new(), &settings).map(drop)
    })?;
    in_blocks(py, points.len(), FOLLOW_BLOCK, threads, |r| {
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
            (Status::IterationLimit, "no critical point was found over the start of the path".into())
        }
        status => (status, format!("the start of the path: {}", result.reason())),
    })
}

/// A configuration at which a critical point vanishes.
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

    /// Configuration.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.q)
    }

    /// Where the tool is.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point.position)
    }

    /// What is left of the equations.
    #[getter]
    fn residual(&self) -> f64 {
        self.point.residual
    }

    /// Whether every value of the first joint gives one.
    #[getter]
    fn first_joint_free(&self) -> bool {
        self.point.first_joint_free
    }

    /// Dimension of the set it belongs to.
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
fn run_search(py: Python<'_>, search: &mut SingularitySearch<'_>, threads: Option<usize>) -> PyResult<()> {
    in_blocks(py, search.starts(), SEARCH_BLOCK, threads, |r| {
        search.run(r.len());
        Ok(())
    })
}

/// Where critical points vanish.
#[pyfunction]
#[pyo3(name = "algorithmic_singularities",
    signature = (chain, criterion, task=None, *, seed=0, starts=None, threads=None))]
pub fn py_algorithmic_singularities(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    criterion: &Bound<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    seed: u64,
    starts: Option<usize>,
    threads: Option<usize>,
) -> PyResult<Vec<PySingularPoint>> {
    let chain = &chain.get().chain;
    let criterion = criterion.get().criterion.clone();
    let task = task_or_pose(task)?;
    let settings = singularity_settings(seed, starts);
    let mut search = SingularitySearch::new(chain, criterion.as_ref(), task, &settings).map_err(to_py)?;
    run_search(py, &mut search, threads)?;
    Ok(search.finish().into_iter().map(|point| PySingularPoint { point }).collect())
}

/// Configurations at which critical points vanish, in order.
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

    /// Rows, one configuration each.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, &self.curve.q, [self.__len__(), self.n])
    }

    /// Whether it ends where it began.
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

/// Curves on which critical points vanish.
#[pyfunction]
#[pyo3(name = "singularity_curves",
    signature = (chain, criterion, task=None, *, step=0.05, seed=0, starts=None, threads=None))]
pub fn py_singularity_curves(
    py: Python<'_>,
    chain: &Bound<'_, PyChain>,
    criterion: &Bound<'_, PyCriterion>,
    task: Option<&Bound<'_, PyAny>>,
    step: f64,
    seed: u64,
    starts: Option<usize>,
    threads: Option<usize>,
) -> PyResult<Vec<PySingularityCurve>> {
    let chain = &chain.get().chain;
    let criterion = criterion.get().criterion.clone();
    let task = task_or_pose(task)?;
    let settings = singularity_settings(seed, starts);
    let mut search = SingularitySearch::new(chain, criterion.as_ref(), task, &settings).map_err(to_py)?;
    search.check_curves(step).map_err(to_py)?;
    run_search(py, &mut search, threads)?;
    let mut tracer = search.tracer(step).map_err(to_py)?;
    in_blocks(py, tracer.starts(), 1, threads, |r| {
        tracer.run(r.len());
        Ok(())
    })?;
    let curves = tracer.finish();
    Ok(curves.into_iter().map(|curve| PySingularityCurve { curve, n: chain.dof() }).collect())
}

/// Distance of configurations from the nearest algorithmic singularity.
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
