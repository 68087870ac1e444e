//! `retime`: times for a joint path.

use pyo3::prelude::*;
use redundancy_core::path::Plan;
use redundancy_core::timing::{RetimeSettings, Retimed, retime};
use redundancy_core::{Error, Status};

use crate::convert::{Gravity, STANDARD_GRAVITY, read_rows};
use crate::error::to_py;
use crate::path::PyTrajectory;
use crate::plan::{PyPlan, read_chain};
use crate::speed::{JointLimits, read_limits};

/// A joint path with its times: what `retime` returns, the trajectory with what was done to it.
#[pyclass(name = "RetimedTrajectory", module = "redundancy", frozen, extends = PyTrajectory)]
pub struct PyRetimed {
    limiting: Vec<Option<String>>,
    path_rows: Vec<usize>,
    stops: Vec<usize>,
    stretched: f64,
    blends: Vec<usize>,
}

#[pymethods]
impl PyRetimed {
    #[new]
    #[pyo3(signature = (trajectory, limiting, path_rows, stops, stretched, blends=Vec::new()),
        text_signature = "(trajectory, limiting, path_rows, stops, stretched, blends=())")]
    fn new(
        trajectory: &Bound<'_, PyTrajectory>,
        limiting: Vec<Option<String>>,
        path_rows: Vec<usize>,
        stops: Vec<usize>,
        stretched: f64,
        blends: Vec<usize>,
    ) -> PyClassInitializer<Self> {
        let base = PyTrajectory::from(trajectory.get().trajectory.clone());
        PyClassInitializer::from(base).add_subclass(Self { limiting, path_rows, stops, stretched, blends })
    }

    /// Per row (N): the limit that is used most.
    ///
    /// `"velocity:<joint>"`, `"acceleration:<joint>"`, `"jerk:<joint>"`, `"torque:<joint>"` or `"tool_speed"`; None
    /// if nothing moves.
    #[getter]
    fn limiting(&self) -> Vec<Option<String>> {
        self.limiting.clone()
    }

    /// Rows of the trajectory that are rows of the path, one for each, in order.
    ///
    /// With `dt=` the rows nearest to them.
    #[getter]
    fn path_rows(&self) -> Vec<usize> {
        self.path_rows.clone()
    }

    /// Rows of the path at which the arm stops on the way: corners, and rows that repeat.
    #[getter]
    fn stops(&self) -> Vec<usize> {
        self.stops.clone()
    }

    /// Rows of the path whose corners the arm passes without a stop, see `blend`.
    #[getter]
    fn blends(&self) -> Vec<usize> {
        self.blends.clone()
    }

    /// Largest ratio by which a section between two stops was slowed down after it was solved; 1.0 for none.
    #[getter]
    fn stretched(&self) -> f64 {
        self.stretched
    }

    fn __repr__(slf: &Bound<'_, Self>) -> String {
        let trajectory = &slf.as_super().get().trajectory;
        let duration = trajectory.t().last().copied().unwrap_or(0.0);
        let stops = slf.get().stops.len();
        format!("RetimedTrajectory({} rows, {duration:.6} s, {stops} stops)", trajectory.rows())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let this = slf.get();
        let base = Bound::new(slf.py(), PyTrajectory::from(slf.as_super().get().trajectory.clone()))?;
        let parts = (base, this.limiting(), this.path_rows(), this.stops(), this.stretched, this.blends());
        Ok((slf.get_type().into_any(), parts.into_pyobject(slf.py())?.into_any()))
    }
}

/// The words of a row's limit: its kind, and the joint where it is one's.
fn words(retimed: &Retimed, names: &[String]) -> Vec<Option<String>> {
    let word = |limit: &redundancy_core::timing::Limiting| match limit.joint {
        Some(joint) => format!("{}:{}", limit.kind.as_str(), names[joint]),
        None => limit.kind.as_str().to_owned(),
    };
    retimed.limiting.iter().map(|limit| limit.as_ref().map(word)).collect()
}

/// Times for a joint path: as fast as every limit allows, from rest to rest.
///
/// The joint path is the cubic spline through the rows, parametrised by chord length. The returned trajectory keeps
/// the limits as `Trajectory.sample` interpolates it: cubic between the rows, quintic with jerk limits. Without jerk
/// limits the time law is that of [PhamPham2018]; with them a barrier method finds a local optimum. Rows of the path
/// stay rows, in order; rows are added where the phases of a straight motion change and between the rows of coarse
/// paths (`path_rows` gives those of the path).
///
/// Args:
///     chain: the arm, `n` joints.
///     trajectory: a trajectory or plan whose times are replaced, or joint rows `(N, n)`, rad or m.
///     tool_speed: largest speed of the tool, m/s; reached wherever the joints allow it.
///     velocity_limits: `(n,)`, rad/s or m/s, "chain" for those of the chain, None for none.
///     acceleration_limits: `(n,)`, rad/s^2 or m/s^2, "chain" or None; each joint needs one, or a torque limit.
///     jerk_limits: `(n,)` or one number for all, rad/s^3 or m/s^3; None lets accelerations jump.
///     torque_limits: `(n,)`, N m or N, "chain" or None; needs a chain with inertias.
///     at_rest: whether the motion starts and ends at rest; otherwise as fast as the limits allow.
///     corner_angle: changes of direction in joint space above this angle (rad) are corners, where the arm stops. The
///         turning of a smooth curve from row to row does not count.
///     blend: distance (m) from a corner within which the tool may pass it without a stop, on a curve in place of the
///         corner; a turn of the tool counts 0.1 m per radian. The curve takes at most half of the path to the next
///         corner or end and stays within the position limits; where none does, where the path turns back, and where a
///         stop takes less time (short curves with limited jerk), the arm stops. Rows on a curve have the section
///         `blend`; rows of the path that it replaces are moved onto it.
///     dt: interval (s) of the rows of the result, which then replace those of the path.
///     rows_between: whether rows may be added between those of the path: where the phases of a straight motion
///         change, and where rows are sparse. If False, there is one row per row of the path, and the motion may be
///         slower.
///     gravity: `(3,)`, m/s^2, world axes.
///
/// Returns:
///     The trajectory with `.t`, `.q`, `.qd`, `.section`, with jerk limits `.qdd`, and `.limiting`. Its events name the
///     corners at which the arm stops and those that it passes, and how far from them.
///
/// Raises:
///     RedundancyError: fewer than two rows, numbers that are not finite, limits that are not positive, a joint with
///         neither an acceleration nor a torque limit.
///     CannotFollowError: a torque limit that is too small to hold the arm at rest.
///
/// Example:
///     >>> import numpy as np
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("panda")
///     >>> move = rd.retime(arm, np.linspace(arm.lower * 0.5, arm.upper * 0.5, 50), jerk_limits=500.0)
#[pyfunction]
#[pyo3(name = "retime", signature = (chain, trajectory, *, tool_speed=None, velocity_limits=Some(JointLimits::Word("chain".into())),
    acceleration_limits=Some(JointLimits::Word("chain".into())), jerk_limits=None, torque_limits=None, at_rest=true, corner_angle=0.02,
    blend=0.0, dt=None, rows_between=true, gravity=STANDARD_GRAVITY),
    text_signature = "(chain, trajectory, *, tool_speed=None, velocity_limits=\"chain\", acceleration_limits=\"chain\", \
    jerk_limits=None, torque_limits=None, at_rest=True, corner_angle=0.02, blend=0.0, dt=None, \
    rows_between=True, gravity=(0.0, 0.0, -9.81))")]
pub fn py_retime<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyAny>,
    trajectory: &Bound<'py, PyAny>,
    tool_speed: Option<f64>,
    velocity_limits: Option<JointLimits<'py>>,
    acceleration_limits: Option<JointLimits<'py>>,
    jerk_limits: Option<Bound<'py, PyAny>>,
    torque_limits: Option<JointLimits<'py>>,
    at_rest: bool,
    corner_angle: f64,
    blend: f64,
    dt: Option<f64>,
    rows_between: bool,
    gravity: Gravity,
) -> PyResult<Bound<'py, PyRetimed>> {
    let chain = read_chain(chain)?;
    let chain = &chain.get().chain;
    let (joints, n) = (chain.joints(), chain.dof());
    if let Ok(plan) = trajectory.cast::<PyPlan>() {
        check_rows(&plan.get().plan)?;
    }
    let q = match trajectory.cast::<PyTrajectory>() {
        Ok(given) => given.get().trajectory.q().to_vec(),
        Err(_) => read_rows(trajectory, "trajectory", &[n])?.as_slice()?.to_vec(),
    };
    let unlimited = || vec![f64::INFINITY; n];
    let velocity = joints.iter().map(|j| j.limits.velocity);
    let acceleration = joints.iter().map(|j| j.limits.acceleration);
    let settings = RetimeSettings {
        velocity_limits: read_limits(velocity_limits, "velocity_limits", velocity)?.unwrap_or_else(unlimited),
        acceleration_limits: read_limits(acceleration_limits, "acceleration_limits", acceleration)?
            .unwrap_or_else(unlimited),
        jerk_limits: read_limits(
            jerk_limits.map(JointLimits::Values),
            "jerk_limits",
            (0..n).map(|_| f64::INFINITY),
        )?,
        torque_limits: read_limits(torque_limits, "torque_limits", joints.iter().map(|j| j.limits.effort))?,
        tool_speed,
        at_rest,
        corner_angle,
        blend,
        dt,
        rows_between,
        gravity: gravity.into(),
    };
    let retimed = py.detach(|| retime(chain, &q, &settings)).map_err(to_py)?;
    let limiting = words(&retimed, retimed.trajectory.joint_names());
    let own = PyRetimed {
        limiting,
        path_rows: retimed.path_rows,
        stops: retimed.stops,
        stretched: retimed.stretched,
        blends: retimed.blends,
    };
    Bound::new(py, PyClassInitializer::from(PyTrajectory::from(retimed.trajectory)).add_subclass(own))
}

/// A plan needs two rows to be timed; where it has fewer, the message says why.
fn check_rows(plan: &Plan) -> PyResult<()> {
    let (rows, status) = (plan.rows(), plan.status());
    if rows > 1 {
        return Ok(());
    }
    let count = match rows {
        0 => "no rows".into(),
        _ => format!("only {rows} row"),
    };
    let why = match (status, plan.reason()) {
        (Status::Converged, _) => String::new(),
        (status, "") => format!(": its status is {status}"),
        (status, reason) => format!(": its status is {status}, {reason}"),
    };
    Err(to_py(Error::Invalid(format!("the plan has {count} to time{why}"))))
}
