//! Results of one step of a velocity or acceleration scheme.

use numpy::PyArray1;
use pyo3::prelude::*;
use redundancy_core::Error;
use redundancy_core::Status;
use redundancy_core::chain::Chain;
use redundancy_core::kinematics::Task;
use redundancy_core::velocity::{ActiveLimit, LimitKind, Step, sigma_min};

use crate::chain::PyChain;
use crate::error::to_py;
use crate::status::status_to_py;
use crate::task::{PyTask, read_task};

/// Names of the two of a pair and their distance, m.
pub type PairText = (String, String, f64);

/// Result of one step of a velocity scheme.
#[pyclass(name = "Step", module = "redundancy", frozen)]
pub struct PyStep {
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub report: Step,
    pub active: Vec<ActiveLimit>,
    pub pairs: Vec<PairText>,
    pub chain: Py<PyChain>,
    pub task: Task,
}

#[pymethods]
impl PyStep {
    /// Joint velocity `(n,)`, rad/s or m/s.
    #[getter]
    fn qd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.qd)
    }

    /// `converged`; `singular` or `limits` if damping (or a lost rank), or limits, kept the task from being met.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.report.status)
    }

    /// Share of the task velocity that is realised, 1 or less.
    #[getter]
    fn scale(&self) -> f64 {
        self.report.scale
    }

    /// Largest damping factor that acted, in the unit of the singular values; 0 for none.
    #[getter]
    fn damping(&self) -> f64 {
        self.report.damping
    }

    /// `|J qd - scale v|` in m/s and rad/s, 0 up to rounding unless the status says otherwise.
    #[getter]
    fn residual(&self) -> f64 {
        self.report.residual
    }

    /// Whether a change of the reduced gradient's basis began.
    #[getter]
    fn basis_changed(&self) -> bool {
        self.report.basis_changed
    }

    /// Whether the condition of the extended Jacobian, not the task Jacobian, lost rank.
    #[getter]
    fn algorithmic(&self) -> bool {
        self.report.algorithmic
    }

    /// Active limits: name of the joint, which limit, which side.
    #[getter]
    fn active_limits(&self) -> Vec<(String, &'static str, &'static str)> {
        let limits = self.active.iter().map(|limit| (limit.joint, limit.kind.as_str(), limit.upper));
        limit_names(&self.chain.get().chain, limits)
    }

    /// Pairs that limited the step: names of a link and of an obstacle or link, and their distance, m.
    #[getter]
    fn limiting_pairs(&self) -> Vec<PairText> {
        self.pairs.clone()
    }

    /// Least singular value of the task Jacobian (unit: m or 1 by its rows), exact; computed when asked for.
    #[getter]
    fn sigma_min(&self) -> PyResult<f64> {
        sigma_min(&self.chain.get().chain, &self.task, &self.q).map_err(to_py)
    }

    fn __repr__(&self) -> String {
        let report = &self.report;
        format!("Step(qd={:?}, status={}, scale={})", self.qd, report.status, report.scale)
    }

    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, StepParts)> {
        let report = &self.report;
        let limit = |l: &ActiveLimit| (l.joint, l.kind.as_str().to_owned(), l.upper);
        let numbers = (report.scale, report.damping, report.residual);
        let flags = (report.basis_changed, report.algorithmic);
        let make = py.get_type::<Self>().getattr("_make")?.unbind();
        let active = self.active.iter().map(limit).collect();
        let task = Py::new(py, PyTask { task: self.task })?.into_any();
        let status = report.status.as_str().to_owned();
        Ok((
            make,
            (
                self.chain.clone_ref(py),
                task,
                self.q.clone(),
                self.qd.clone(),
                status,
                numbers,
                flags,
                (active, self.pairs.clone()),
            ),
        ))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _make(
        chain: Py<PyChain>,
        task: &Bound<'_, PyAny>,
        q: Vec<f64>,
        qd: Vec<f64>,
        status: &str,
        numbers: (f64, f64, f64),
        flags: (bool, bool),
        limits: (Vec<(usize, String, bool)>, Vec<PairText>),
    ) -> PyResult<Self> {
        let (active, pairs) = limits;
        let unknown =
            || to_py(Error::Invalid(format!("a step with the status '{status}' cannot be restored")));
        let status = Status::ALL.into_iter().find(|s| s.as_str() == status).ok_or_else(unknown)?;
        let dof = chain.get().chain.dof();
        let limit = |limit: (usize, String, bool)| restored_limit(limit, dof).ok_or_else(unknown);
        let report = Step {
            status,
            scale: numbers.0,
            damping: numbers.1,
            residual: numbers.2,
            basis_changed: flags.0,
            algorithmic: flags.1,
        };
        let active = active.into_iter().map(limit).collect::<PyResult<_>>()?;
        Ok(Self { q, qd, report, active, pairs, chain, task: read_task(task)? })
    }
}

/// An active limit of a pickle.
pub fn restored_limit((joint, word, upper): (usize, String, bool), dof: usize) -> Option<ActiveLimit> {
    let kinds = [LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration];
    let kind = kinds.into_iter().find(|kind| kind.as_str() == word && joint < dof)?;
    Some(ActiveLimit { joint, kind, upper })
}

/// Limits as users read them: name of the joint, which limit, which side.
pub(crate) fn limit_names(
    chain: &Chain,
    limits: impl Iterator<Item = (usize, &'static str, bool)>,
) -> Vec<(String, &'static str, &'static str)> {
    let side = |upper| if upper { "upper" } else { "lower" };
    limits.map(|(joint, kind, upper)| (chain.joints()[joint].name.clone(), kind, side(upper))).collect()
}

/// Result of one step at acceleration level.
#[pyclass(name = "AccelerationStep", module = "redundancy", frozen)]
pub struct PyAccelerationStep {
    pub qdd: Vec<f64>,
    pub report: Step,
}

#[pymethods]
impl PyAccelerationStep {
    /// Joint acceleration `(n,)`, rad/s^2 or m/s^2.
    #[getter]
    fn qdd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.qdd)
    }

    /// `converged`; `singular` if damping (or a lost rank) kept the task from being met.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.report.status)
    }

    /// Largest damping factor that acted, in the unit of the singular values; 0 for none.
    #[getter]
    fn damping(&self) -> f64 {
        self.report.damping
    }

    /// `|J qdd + Jdot qd - a|` in m/s^2 and rad/s^2, 0 up to rounding unless the status says otherwise.
    #[getter]
    fn residual(&self) -> f64 {
        self.report.residual
    }

    /// Whether the reduced gradient changed its basis.
    #[getter]
    fn basis_changed(&self) -> bool {
        self.report.basis_changed
    }

    fn __repr__(&self) -> String {
        format!("AccelerationStep(qdd={:?}, status={})", self.qdd, self.report.status)
    }

    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, AccelerationParts)> {
        let Step { status, damping, residual, basis_changed, .. } = self.report;
        let make = py.get_type::<Self>().getattr("_make")?.unbind();
        Ok((make, (self.qdd.clone(), status.as_str().to_owned(), damping, residual, basis_changed)))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _make(
        qdd: Vec<f64>,
        status: &str,
        damping: f64,
        residual: f64,
        basis_changed: bool,
    ) -> PyResult<Self> {
        let unknown =
            || to_py(Error::Invalid(format!("a step with the status '{status}' cannot be restored")));
        let status = Status::ALL.into_iter().find(|s| s.as_str() == status).ok_or_else(unknown)?;
        let report = Step { status, scale: 1.0, damping, basis_changed, algorithmic: false, residual };
        Ok(Self { qdd, report })
    }
}

type AccelerationParts = (Vec<f64>, String, f64, f64, bool);

type StepParts = (
    Py<PyChain>,
    Py<PyAny>,
    Vec<f64>,
    Vec<f64>,
    String,
    (f64, f64, f64),
    (bool, bool),
    (Vec<(usize, String, bool)>, Vec<PairText>),
);
