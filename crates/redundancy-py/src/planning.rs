//! Whole paths.

use numpy::PyArray1;
use pyo3::prelude::*;
use redundancy_core::Error;
use redundancy_core::planning::{SwivelChoice, SwivelPlan, SwivelPlanSettings, plan_swivel};

use crate::convert::{Integer, read_vector, to_array};
use crate::error::to_py;
use crate::path::{PyPath, PyTrajectory};
use crate::self_motion::{PySrsArm, signs_of};
use crate::status::status_to_py;

/// A trajectory with the swivel of each row.
#[pyclass(name = "SwivelPlan", module = "redundancy", frozen, extends = PyTrajectory)]
pub struct PySwivelPlan {
    plan: SwivelPlan,
}

#[pymethods]
impl PySwivelPlan {
    /// Swivel of each row, rad.
    #[getter]
    fn swivel<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.plan.swivel)
    }

    /// Signs (shoulder, elbow, wrist) of each row.
    #[getter]
    fn branch<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let signs: Vec<[i8; 3]> = self.plan.branch.iter().map(|branch| signs_of(*branch)).collect();
        Ok(to_array(py, signs.as_flattened(), [signs.len(), 3])?.into_any())
    }

    /// Points before which the arm must change its configuration.
    #[getter]
    fn reconfigurations(&self) -> Vec<usize> {
        self.plan.reconfigurations.clone()
    }

    /// Points without any configuration within the limits.
    #[getter]
    fn blocked(&self) -> Vec<usize> {
        self.plan.blocked.clone()
    }

    /// What the planner did.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.plan.status)
    }

    /// Why it is not `converged`; empty when it is.
    #[getter]
    fn reason(&self) -> &str {
        &self.plan.reason
    }

    fn __repr__(&self) -> String {
        let (rows, status) = (self.plan.q.len(), self.plan.status);
        let reason =
            if self.plan.reason.is_empty() { String::new() } else { format!(": {}", self.plan.reason) };
        format!("SwivelPlan({rows} rows, {status}{reason})")
    }
}

/// Plans the swivel along a whole path.
#[pyfunction(name = "plan_swivel")]
#[pyo3(signature = (arm, path, desired=None, *, fixed=None, branch=None, margin=0.0, velocity_limits=Some("chain".into()),
    swivels=None, limit_weight=None, motion_weight=None, swivel_weight=None, progress=None))]
#[allow(clippy::too_many_arguments)]
pub fn py_plan_swivel<'py>(
    py: Python<'py>,
    arm: &Bound<'py, PySrsArm>,
    path: &Bound<'py, PyPath>,
    desired: Option<&Bound<'py, PyAny>>,
    fixed: Option<&Bound<'py, PyAny>>,
    branch: Option<[i8; 3]>,
    margin: f64,
    velocity_limits: Option<VelocityLimits<'py>>,
    swivels: Option<Integer>,
    limit_weight: Option<f64>,
    motion_weight: Option<f64>,
    swivel_weight: Option<f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PySwivelPlan>> {
    let swivels = swivels.map(|n| n.count("swivels", 0)).transpose()?;
    let (arm, path) = (&arm.get().arm, &path.get().path);
    let choice = match (desired, fixed) {
        (None, None) => SwivelChoice::Free,
        (Some(s), None) => SwivelChoice::Near(read_angles(s, "desired")?),
        (None, Some(s)) => SwivelChoice::Fixed(read_angles(s, "fixed")?),
        _ => return Err(to_py(Error::Invalid("give desired (near to) or fixed (exactly), not both".into()))),
    };
    let velocity_limits = match velocity_limits {
        None => None,
        Some(VelocityLimits::Word(word)) if word == "chain" => {
            Some(arm.chain().joints().iter().map(|j| j.limits.velocity).collect())
        }
        Some(VelocityLimits::Word(word)) => {
            let valid = vec!["chain".into()];
            return Err(to_py(Error::UnknownName { kind: "velocity_limits", name: word, valid }));
        }
        Some(VelocityLimits::Values(values)) => Some(read_vector(&values, "velocity_limits", Some(7))?),
    };
    let branch = match branch {
        None => None,
        Some(signs) if signs.iter().all(|s| s.abs() == 1) => {
            Some(signs.iter().zip([4, 2, 1]).map(|(s, bit)| if *s < 0 { bit } else { 0 }).sum())
        }
        Some(signs) => {
            return Err(to_py(Error::Invalid(format!("branch is {signs:?}, its signs must be 1 or -1"))));
        }
    };
    let default = SwivelPlanSettings::default();
    let settings = SwivelPlanSettings {
        swivels: swivels.unwrap_or(default.swivels),
        choice,
        branch,
        margin,
        limit_weight: limit_weight.unwrap_or(default.limit_weight),
        motion_weight: motion_weight.unwrap_or(default.motion_weight),
        swivel_weight: swivel_weight.unwrap_or(default.swivel_weight),
        velocity_limits,
    };
    let mut stopped = None;
    let plan = py.detach(|| {
        plan_swivel(arm, path, &settings, &mut |share| {
            let report = |py: Python<'_>| -> PyResult<()> {
                py.check_signals()?;
                progress.as_ref().map_or(Ok(()), |call| call.call1(py, (share,)).map(drop))
            };
            match Python::attach(report) {
                Ok(()) => true,
                Err(error) => {
                    stopped = Some(error);
                    false
                }
            }
        })
    });
    if let Some(error) = stopped {
        return Err(error);
    }
    let plan = plan.map_err(to_py)?;
    let trajectory = plan.trajectory(arm.chain(), path).map_err(to_py)?;
    let base = PyClassInitializer::from(PyTrajectory::from(trajectory));
    Bound::new(py, base.add_subclass(PySwivelPlan { plan }))
}

/// `"chain"` or seven numbers.
#[derive(FromPyObject)]
pub enum VelocityLimits<'py> {
    Word(String),
    Values(Bound<'py, PyAny>),
}

impl From<&str> for VelocityLimits<'_> {
    fn from(word: &str) -> Self {
        Self::Word(word.into())
    }
}

/// One angle or one for each point.
fn read_angles(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<f64>> {
    match object.extract::<f64>() {
        Ok(angle) => Ok(vec![angle]),
        Err(_) => read_vector(object, what, None),
    }
}
