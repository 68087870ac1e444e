//! What kind of optimum is it, and where does it break.

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyType};
use redundancy_core::kinematics::Task;
use redundancy_core::optimum::{
    Classification, Classifier, CofactorCondition, CriticalPoint, Kind, OptimaSettings, cofactor_condition,
    constrained_optima,
};

use crate::chain::PyChain;
use crate::convert::{read_rows, read_vector};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::status::kind_to_py;
use crate::task::{read_target, read_task};

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
