//! Tilt and spin along a whole path.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use redundancy_core::planning::{
    Bottleneck, OrientationPlan, OrientationPlanSettings, SpeedBound, SpinRange, plan_orientation,
};
use redundancy_core::{Error, Watch};

use crate::chain::PyChain;
use crate::convert::{Given, Gravity, STANDARD_GRAVITY, one_of, read_rotation, to_array};
use crate::error::to_py;
use crate::path::PyPath;
use crate::plan::{PyPlan, plan_initializer, plan_of};
use crate::speed::{JointLimits, read_task};
use crate::watch::watched_aside;

/// A plan at constant tool speed with tilt and spin of the tool, one row per entry of `s`.
///
/// The entries of `s` are at most 0.4 mm apart. `tilt` is the rotation vector in the path's frame, `spin` is about the
/// tool axis from the path's orientation. `status` is `converged`; `time_limit` or `cancelled` (the best so far);
/// `unreachable` or `infeasible` (no rows). With `unreachable`, `blocked` lists the path points that no configuration
/// reaches.
#[pyclass(name = "OrientationPlan", module = "redundancy", frozen, extends = PyPlan)]
pub struct PyOrientationPlan {
    speed: f64,
    constant_speed: Option<f64>,
    torques: Vec<f64>,
    bottleneck: Option<Bottleneck>,
    starts: usize,
    steps: usize,
}

/// The numbers beside the columns that make it again: row, joint and whether its velocity is the bottleneck; starts,
/// steps.
type Counts = (Option<(usize, Option<usize>, bool)>, usize, usize);
type Parts<'py> = (Bound<'py, PyDict>, (f64, Option<f64>, Vec<f64>), Counts);

#[pymethods]
impl PyOrientationPlan {
    /// Constant tool speed, m/s, verified at every row; 0 without a plan.
    #[getter]
    fn speed(&self) -> f64 {
        self.speed
    }

    /// The same for the path's own orientation on the fastest branch, where it can be followed.
    #[getter]
    fn constant_speed(&self) -> Option<f64> {
        self.constant_speed
    }

    /// Joint torques `(N, n)` at `speed`, N m.
    #[getter]
    fn torques<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let (torques, n) = (&this.get().torques, this.as_super().get().plan.trajectory().dof());
        Ok(to_array(this.py(), torques, [torques.len() / n, n])?.into_any())
    }

    /// Its name.
    #[getter]
    fn limiting_joint_name(this: &Bound<'_, Self>) -> Option<String> {
        let joint = this.get().limiting_joint()?;
        this.as_super().get().plan.trajectory().joint_names().get(joint).cloned()
    }

    /// Index of the limiting joint; `None` if the rate of the orientation is the limit.
    #[getter]
    fn limiting_joint(&self) -> Option<usize> {
        self.bottleneck?.bound.joint()
    }

    /// `"torque"` or `"velocity"`.
    #[getter]
    fn limit(&self) -> &'static str {
        match self.bottleneck.map(|at| at.bound) {
            Some(SpeedBound::Velocity(_) | SpeedBound::Rate) => "velocity",
            Some(SpeedBound::Torque(_)) | None => "torque",
        }
    }

    /// The row at which the limit is reached.
    #[getter]
    fn at(&self) -> usize {
        self.bottleneck.map_or(0, |at| at.row)
    }

    /// Starts that could be followed.
    #[getter]
    fn starts(&self) -> usize {
        self.starts
    }

    /// Convex programs solved.
    #[getter]
    fn steps(&self) -> usize {
        self.steps
    }

    fn __repr__(this: &Bound<'_, Self>) -> String {
        let (own, plan) = (this.get(), &this.as_super().get().plan);
        let reason = if plan.reason().is_empty() { String::new() } else { format!(": {}", plan.reason()) };
        let gain = own.constant_speed.map_or(String::new(), |c| format!(", x{:.3} of {c:.4}", own.speed / c));
        let (speed, rows, status) = (own.speed, plan.rows(), plan.status());
        format!("OrientationPlan({speed:.4} m/s{gain}, {rows} rows, {status}{reason})")
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        let own = this.get();
        let arrays = PyPlan::everything(this.as_super())?;
        let velocity = own.limit() == "velocity";
        let bottleneck = own.bottleneck.map(|at| (at.row, at.bound.joint(), velocity));
        let speeds = (own.speed, own.constant_speed, own.torques.clone());
        let parts = (arrays, speeds, (bottleneck, own.starts, own.steps));
        Ok((this.get_type().getattr("_from_parts")?, parts))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts<'py>(
        arrays: &Bound<'py, PyAny>,
        speeds: (f64, Option<f64>, Vec<f64>),
        counts: Counts,
    ) -> PyResult<Bound<'py, Self>> {
        let plan = plan_of(arrays)?;
        let ((speed, constant_speed, torques), (bottleneck, starts, steps)) = (speeds, counts);
        let bottleneck = bottleneck.map(|(row, joint, velocity)| {
            let bound = match joint {
                Some(joint) if velocity => SpeedBound::Velocity(joint),
                Some(joint) => SpeedBound::Torque(joint),
                None => SpeedBound::Rate,
            };
            Bottleneck { row, bound }
        });
        let plan = OrientationPlan { plan, speed, constant_speed, torques, bottleneck, starts, steps };
        wrapped(arrays.py(), plan)
    }
}

fn wrapped(py: Python<'_>, plan: OrientationPlan) -> PyResult<Bound<'_, PyOrientationPlan>> {
    let OrientationPlan { plan, speed, constant_speed, torques, bottleneck, starts, steps } = plan;
    let own = PyOrientationPlan { speed, constant_speed, torques, bottleneck, starts, steps };
    Bound::new(py, plan_initializer(plan).add_subclass(own))
}

/// `"free"` or the largest angle.
pub enum SpinArgument {
    Angle(f64),
    Word(String),
}

one_of!(SpinArgument, "an angle in rad or \"free\"", Angle, Word);

/// Plan tilt and spin of the tool along a whole path for the highest constant tool speed.
///
/// Quintic splines of tilt and spin, sequential convex programming from many starts, verified on a grid at least five
/// times finer. A local optimum: a lower bound of what is possible.
///
/// Args:
///     chain: The arm, six or seven joints, with inertias.
///     path: Poses, whose tool axes are the axes of the cone; on a path of positions the tool points down, or has
///         `orientation`.
///     half_angle: Largest tilt, rad, in [0, pi/2).
///     spin: `"free"`, or the largest angle about the tool axis from the path's orientation, rad.
///     tool: Pose of the tool in the last link, instead of the chain's.
///     torque_limits: `"chain"` (default), `(n,)` N m, or `None` for off.
///     torque_margin: Share of the torque limits that is kept in reserve.
///     velocity_limits: `"chain"` (default), `(n,)` rad/s, or `None` for off.
///     joint_limits: Whether the position limits are imposed.
///     max_rate: Largest rate of the tool's orientation, rad/s.
///     time_limit: Seconds after which the best plan so far is returned.
///     threads: Threads; all cores when left out.
///     orientation: `(3, 3)` for the whole path, instead of the path's own.
///     gravity: m/s^2, world axes.
///     progress: Called about 20 times a second with the share of the time and the highest speed so far (m/s).
///
/// Ctrl-C ends the search: the best plan so far is returned with status `cancelled`.
///
/// Raises:
///     RedundancyError: A setting out of its range, no inertias, no length, another number of joints.
#[pyfunction(name = "plan_orientation")]
#[pyo3(signature = (chain, path, half_angle, spin=SpinArgument::Word("free".into()), tool=None,
    torque_limits=Some(JointLimits::Word("chain".into())), torque_margin=0.0,
    velocity_limits=Some(JointLimits::Word("chain".into())), joint_limits=true,
    max_rate=None, time_limit=60.0, threads=None, *, orientation=None, gravity=STANDARD_GRAVITY, progress=None),
    text_signature = "(chain, path, half_angle, spin=\"free\", tool=None, torque_limits=\"chain\", torque_margin=0.0, \
    velocity_limits=\"chain\", joint_limits=True, max_rate=None, time_limit=60.0, threads=None, *, \
    orientation=None, gravity=(0.0, 0.0, -9.81), progress=None)")]
pub fn py_plan_orientation<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    path: Given<'py, PyPath>,
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
    gravity: Gravity,
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
    let watch = Watch::default();
    let report = |py: Python<'_>| {
        let seen = (watch.share(), watch.speed().unwrap_or(0.0));
        progress.as_ref().map_or(Ok(()), |call| call.call1(py, seen).map(drop))
    };
    let work = || plan_orientation(&chain, &path, &settings, &watch);
    wrapped(py, watched_aside(py, &watch, &pool, report, work)?)
}
