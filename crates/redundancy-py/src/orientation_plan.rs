//! Tilt and spin along a whole path.

use std::time::Duration;

use numpy::PyArray1;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use redundancy_core::planning::{
    OrientationPlan, OrientationPlanSettings, PlanWatch, SpinRange, plan_orientation,
};
use redundancy_core::timing::SpeedLimit;
use redundancy_core::{Error, Status, pose_from_row_major, pose_to_row_major};

use crate::chain::{PyChain, STANDARD_GRAVITY};
use crate::convert::{read_rotation, to_array};
use crate::error::to_py;
use crate::path::{PyPath, PyTrajectory};
use crate::speed::{JointLimits, read_task};
use crate::status::status_to_py;

/// How often a running plan is looked at.
const LOOK: Duration = Duration::from_millis(50);

/// A trajectory at constant tool speed with the orientation of each row.
#[pyclass(name = "OrientationPlan", module = "redundancy", frozen, extends = PyTrajectory)]
pub struct PyOrientationPlan {
    plan: OrientationPlan,
    joint_names: Vec<String>,
}

#[pymethods]
impl PyOrientationPlan {
    /// Constant tool speed, m/s.
    #[getter]
    fn speed(&self) -> f64 {
        self.plan.speed
    }

    /// The same for the path's own orientation.
    #[getter]
    fn constant_speed(&self) -> Option<f64> {
        self.plan.constant_speed
    }

    /// Arc lengths, m.
    #[getter]
    fn s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.plan.s)
    }

    /// Tool poses.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let flat: Vec<f64> = self.plan.poses.iter().flat_map(pose_to_row_major).collect();
        Ok(to_array(py, &flat, [self.plan.poses.len(), 4, 4])?.into_any())
    }

    /// Joint torques.
    #[getter]
    fn torques<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let n = self.joint_names.len();
        Ok(to_array(py, &self.plan.torques, [self.plan.torques.len() / n, n])?.into_any())
    }

    /// Tilt as a rotation vector in the path's frame.
    #[getter]
    fn tilt<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let flat: Vec<f64> = self.plan.tilt_spin.iter().flat_map(|u| [u[0], u[1]]).collect();
        Ok(to_array(py, &flat, [self.plan.tilt_spin.len(), 2])?.into_any())
    }

    /// Spin about the tool axis.
    #[getter]
    fn spin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.plan.tilt_spin.iter().map(|u| u[2]))
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

    /// Name of the joint that allows no more; `None` where it is the rate of the orientation.
    #[getter]
    fn limiting_joint_name(&self) -> Option<&str> {
        self.joint_names.get(self.plan.limiting_joint).map(String::as_str)
    }

    /// Its index.
    #[getter]
    fn limiting_joint(&self) -> Option<usize> {
        Some(self.plan.limiting_joint).filter(|j| *j < self.joint_names.len())
    }

    /// `torque` or `velocity`.
    #[getter]
    fn limit(&self) -> &'static str {
        match self.plan.limit {
            SpeedLimit::Torque => "torque",
            SpeedLimit::Velocity => "velocity",
        }
    }

    /// The row where that happens.
    #[getter]
    fn at(&self) -> usize {
        self.plan.at
    }

    /// Path points that no configuration reaches.
    #[getter]
    fn blocked(&self) -> Vec<usize> {
        self.plan.blocked.clone()
    }

    /// Starts that could be followed.
    #[getter]
    fn starts(&self) -> usize {
        self.plan.starts
    }

    /// Convex programs solved.
    #[getter]
    fn steps(&self) -> usize {
        self.plan.steps
    }

    fn __repr__(&self) -> String {
        let p = &self.plan;
        let reason = if p.reason.is_empty() { String::new() } else { format!(": {}", p.reason) };
        let gain = p.constant_speed.map_or(String::new(), |c| format!(", x{:.3} of {c:.4}", p.speed / c));
        format!("OrientationPlan({:.4} m/s{gain}, {} rows, {}{reason})", p.speed, p.s.len(), p.status)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        let p = self.plan.clone();
        let poses = p.poses.iter().map(pose_to_row_major).collect();
        let counts = (p.limiting_joint, p.limit == SpeedLimit::Velocity, p.at, p.starts, p.steps);
        let words = (p.status.as_str().into(), p.reason, self.joint_names.clone());
        let parts = (
            words,
            p.speed,
            p.constant_speed,
            (p.s, poses, p.q, p.qd, p.torques, p.tilt_spin),
            counts,
            p.blocked,
        );
        Ok((py.get_type::<Self>().getattr("_from_parts")?, parts))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts<'py>(
        py: Python<'py>,
        words: (String, String, Vec<String>),
        speed: f64,
        constant_speed: Option<f64>,
        rows: Rows,
        counts: (usize, bool, usize, usize, usize),
        blocked: Vec<usize>,
    ) -> PyResult<Bound<'py, Self>> {
        let (status, reason, joint_names) = words;
        let (s, poses, q, qd, torques, tilt_spin) = rows;
        let status =
            Status::ALL.into_iter().find(|known| known.as_str() == status).unwrap_or(Status::Infeasible);
        let poses = poses.iter().map(|m| pose_from_row_major(m)).collect::<Result<_, _>>().map_err(to_py)?;
        let (limiting_joint, velocity, at, starts, steps) = counts;
        let limit = if velocity { SpeedLimit::Velocity } else { SpeedLimit::Torque };
        let plan = OrientationPlan {
            status,
            reason,
            speed,
            constant_speed,
            s,
            poses,
            q,
            qd,
            torques,
            tilt_spin,
            limiting_joint,
            limit,
            at,
            blocked,
            starts,
            steps,
        };
        wrapped(py, plan, joint_names)
    }
}

type Rows = (Vec<f64>, Vec<[f64; 16]>, Vec<f64>, Vec<f64>, Vec<f64>, Vec<[f64; 3]>);
type Parts =
    ((String, String, Vec<String>), f64, Option<f64>, Rows, (usize, bool, usize, usize, usize), Vec<usize>);

fn wrapped(
    py: Python<'_>,
    plan: OrientationPlan,
    joint_names: Vec<String>,
) -> PyResult<Bound<'_, PyOrientationPlan>> {
    let trajectory = plan.trajectory(&joint_names).map_err(to_py)?;
    let base = PyClassInitializer::from(PyTrajectory::from(trajectory));
    Bound::new(py, base.add_subclass(PyOrientationPlan { plan, joint_names }))
}

/// `"free"` or the largest angle.
#[derive(FromPyObject)]
pub enum SpinArgument {
    Angle(f64),
    Word(String),
}

/// Plans tilt and spin along a whole path.
#[pyfunction(name = "plan_orientation")]
#[pyo3(signature = (chain, path, half_angle, spin=SpinArgument::Word("free".into()), tool=None,
    torque_limits=Some(JointLimits::Word("chain".into())), torque_margin=0.0, velocity_limits=None, joint_limits=true,
    max_rate=None, time_limit=60.0, threads=None, *, orientation=None, gravity=STANDARD_GRAVITY, progress=None))]
pub fn py_plan_orientation<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    path: &Bound<'py, PyPath>,
    half_angle: f64,
    spin: SpinArgument,
    tool: Option<&Bound<'py, PyAny>>,
    torque_limits: Option<JointLimits<'py>>,
    torque_margin: f64,
    velocity_limits: Option<JointLimits<'py>>,
    joint_limits: bool,
    max_rate: Option<f64>,
    time_limit: f64,
    threads: Option<usize>,
    orientation: Option<&Bound<'py, PyAny>>,
    gravity: [f64; 3],
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyOrientationPlan>> {
    let (chain, mut speed) = read_task(chain, tool, torque_limits, velocity_limits, gravity)?;
    speed.joint_limits = joint_limits;
    let spin = match spin {
        SpinArgument::Angle(angle) => SpinRange::Within(angle),
        SpinArgument::Word(word) if word == "free" => SpinRange::Free,
        SpinArgument::Word(name) => {
            return Err(to_py(Error::UnknownName { kind: "spin", name, valid: vec!["free".into()] }));
        }
    };
    let path = match orientation {
        None => path.get().path.clone(),
        Some(given) => {
            path.get().path.with_orientation(&read_rotation(given, "orientation")?).map_err(to_py)?
        }
    };
    let settings = OrientationPlanSettings { half_angle, spin, speed, torque_margin, max_rate, time_limit };
    let pool = crate::batch::pool(threads)?;
    let watch = PlanWatch::default();
    let mut stopped: Option<PyErr> = None;
    let plan = py.detach(|| {
        std::thread::scope(|scope| {
            let work = || plan_orientation(&chain, &path, &settings, &watch);
            let pool = &pool;
            let running = scope.spawn(move || pool.install(work));
            while !running.is_finished() {
                std::thread::park_timeout(LOOK);
                let look = |py: Python<'_>| -> PyResult<()> {
                    let call = progress.as_ref().filter(|_| stopped.is_none());
                    let seen = py.check_signals().and_then(|()| {
                        call.map_or(Ok(()), |call| call.call1(py, (watch.share(), watch.speed())).map(drop))
                    });
                    // Ctrl-C: the best plan so far is the answer, and says so.
                    match seen {
                        Err(error) if error.is_instance_of::<PyKeyboardInterrupt>(py) => {
                            watch.cancel();
                            Ok(())
                        }
                        other => other,
                    }
                };
                if let Err(error) = Python::attach(look) {
                    watch.cancel();
                    stopped = Some(error);
                }
            }
            running.join()
        })
    });
    if let Some(error) = stopped {
        return Err(error);
    }
    let plan =
        plan.map_err(|_| to_py(Error::Invalid("the planner stopped unexpectedly".into())))?.map_err(to_py)?;
    wrapped(py, plan, chain.joints().iter().map(|j| j.name.clone()).collect())
}
