//! `check`: a linter for joint trajectories.

use std::path::{Path as FilePath, PathBuf};

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::Error;
use redundancy_core::path::{JointRows, Section};
use redundancy_core::timing::{
    CheckAgainst, CheckReport, CheckSettings, Finding, FindingKind, RetimeSettings, Severity, check_rows,
    joint_move,
};

use crate::batch::pool;
use crate::convert::{Given, Gravity, STANDARD_GRAVITY, Threads, read_rows, read_vector, type_name};
use crate::error::to_py;
use crate::links::LinkRadius;
use crate::path::{PyPath, PyTrajectory};
use crate::plan::read_chain;
use crate::scene::PyScene;
use crate::speed::{JointLimits, read_limits};

/// One error or warning about a trajectory: an entry of `CheckReport.findings`.
#[pyclass(name = "Finding", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyFinding {
    finding: Finding,
}

#[pymethods]
impl PyFinding {
    #[new]
    #[pyo3(signature = (kind, row, rows, t, joint, link, value, bound, message))]
    fn new(
        kind: &str,
        row: usize,
        rows: [usize; 2],
        t: f64,
        joint: Option<String>,
        link: Option<String>,
        value: f64,
        bound: f64,
        message: String,
    ) -> PyResult<Self> {
        let kind = kind.parse::<FindingKind>().map_err(to_py)?;
        Ok(Self { finding: Finding { kind, row, rows, t, joint, link, value, bound, message } })
    }

    /// What is wrong, as one word.
    ///
    /// `position`, `velocity`, `acceleration`, `jerk`, `torque`, `step`, `not_at_rest`, `winding`, `singularity`,
    /// `self_collision`, `collision`, `path_deviation` or `time`.
    #[getter]
    fn kind(&self) -> &'static str {
        self.finding.kind.as_str()
    }

    /// `winding` and `singularity` are warnings, the others errors.
    #[getter]
    fn severity(&self) -> &'static str {
        self.finding.severity().as_str()
    }

    /// The row nearest to the worst violation, from 0.
    #[getter]
    fn row(&self) -> usize {
        self.finding.row
    }

    /// First and last row of the part of the motion with this error.
    #[getter]
    fn rows(&self) -> (usize, usize) {
        self.finding.rows.into()
    }

    /// Time of the worst violation, s.
    #[getter]
    fn t(&self) -> f64 {
        self.finding.t
    }

    /// The joint, if a single joint is the cause.
    #[getter]
    fn joint(&self) -> Option<&str> {
        self.finding.joint.as_deref()
    }

    /// The link, if a single link is the cause.
    #[getter]
    fn link(&self) -> Option<&str> {
        self.finding.link.as_deref()
    }

    /// What was measured, in the unit of `bound`.
    #[getter]
    fn value(&self) -> f64 {
        self.finding.value
    }

    /// What is allowed, in the unit of `value`.
    #[getter]
    fn bound(&self) -> f64 {
        self.finding.bound
    }

    /// The finding as a sentence.
    #[getter]
    fn message(&self) -> &str {
        &self.finding.message
    }

    fn __repr__(&self) -> String {
        format!("Finding({}, row {}: {})", self.kind(), self.finding.row, self.finding.message)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let this = slf.get();
        let f = &this.finding;
        let head = (this.kind(), f.row, this.rows(), f.t, this.joint(), this.link());
        let parts = (head.0, head.1, head.2, head.3, head.4, head.5, f.value, f.bound, this.message());
        Ok((slf.get_type().into_any(), parts.into_pyobject(slf.py())?))
    }
}

/// What `check` found. It is true when there is no error; its length is the number of rows.
#[pyclass(name = "CheckReport", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyCheckReport {
    report: CheckReport,
}

#[pymethods]
impl PyCheckReport {
    #[new]
    fn new(findings: Vec<Bound<'_, PyFinding>>, rows: usize, judged: bool) -> Self {
        let findings = findings.iter().map(|finding| finding.get().finding.clone()).collect();
        Self { report: CheckReport { findings, rows, judged } }
    }

    /// By row, then by kind.
    #[getter]
    fn findings(&self) -> Vec<PyFinding> {
        self.report.findings.iter().map(|finding| PyFinding { finding: finding.clone() }).collect()
    }

    /// No error; there may be warnings.
    #[getter]
    fn ok(&self) -> bool {
        self.report.ok()
    }

    /// Whether the motion was checked; False if times do not increase, which is then the only finding.
    #[getter]
    fn judged(&self) -> bool {
        self.report.judged
    }

    /// Number of findings that are errors.
    #[getter]
    fn errors(&self) -> usize {
        self.report.count(Severity::Error)
    }

    /// Number of findings that are warnings.
    #[getter]
    fn warnings(&self) -> usize {
        self.report.count(Severity::Warning)
    }

    /// Number of rows.
    fn __len__(&self) -> usize {
        self.report.rows
    }

    fn __bool__(&self) -> bool {
        self.report.ok()
    }

    fn __repr__(&self) -> String {
        let (errors, warnings) = (self.errors(), self.warnings());
        format!("CheckReport({} rows, {errors} errors, {warnings} warnings)", self.report.rows)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let this = slf.get();
        let parts = (this.findings(), this.report.rows, this.report.judged);
        Ok((slf.get_type().into_any(), parts.into_pyobject(slf.py())?))
    }
}

/// What `check` takes for a trajectory.
pub enum AnyRows<'py> {
    Trajectory(Bound<'py, PyTrajectory>),
    File(PathBuf),
}

impl<'py> FromPyObject<'_, 'py> for AnyRows<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(given) = object.cast::<PyTrajectory>() {
            return Ok(Self::Trajectory(given.to_owned()));
        }
        object.extract().map(Self::File).map_err(|_| {
            let given = type_name(&object);
            PyTypeError::new_err(format!(
                "expected a Trajectory or the name of a file, got {given}: rd.Trajectory(joint_names, t, q) makes one"
            ))
        })
    }
}

impl AnyRows<'_> {
    fn read(&self, py: Python<'_>, chain_names: &[String]) -> PyResult<JointRows> {
        let file = match self {
            Self::Trajectory(given) => return Ok(given.get().trajectory.clone().into()),
            Self::File(file) => file,
        };
        let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("csv") => py.detach(|| JointRows::from_csv(file)).map_err(to_py),
            Some("json") => py.detach(|| JointRows::from_json(file)).map_err(to_py),
            Some("npz") => read_npz(py, file, chain_names).map_err(|error| in_file(file, &error.to_string())),
            _ => Err(in_file(file, "expected a file that ends in .json, .csv or .npz")),
        }
    }
}

fn in_file(file: &FilePath, message: &str) -> PyErr {
    let message = message.strip_prefix("RedundancyError: ").unwrap_or(message).to_owned();
    to_py(Error::File { file: file.display().to_string(), message })
}

/// Names that the arrays of an npz file may have.
const NAMES: [&str; 2] = ["joint_names", "names"];
const TIMES: [&str; 3] = ["t", "time", "times"];
const POSITIONS: [&str; 3] = ["q", "positions", "position"];
const VELOCITIES: [&str; 3] = ["qd", "velocities", "velocity"];
const ACCELERATIONS: [&str; 3] = ["qdd", "accelerations", "acceleration"];

/// An array under one of its names.
fn array<'py>(archive: &Bound<'py, PyAny>, names: &[&str]) -> PyResult<Option<Bound<'py, PyAny>>> {
    for name in names {
        if archive.contains(name)? {
            return archive.get_item(name).map(Some);
        }
    }
    Ok(None)
}

fn read_npz(py: Python<'_>, file: &FilePath, chain_names: &[String]) -> PyResult<JointRows> {
    let archive = py.import("numpy")?.getattr("load")?.call1((file,))?;
    if archive.getattr_opt("files")?.is_none() {
        return Err(to_py(Error::Invalid("is no archive of arrays".into())));
    }
    let result = rows_of_archive(&archive, chain_names);
    archive.call_method0("close")?;
    result
}

fn rows_of_archive(archive: &Bound<'_, PyAny>, chain_names: &[String]) -> PyResult<JointRows> {
    let names: Vec<String> = match array(archive, &NAMES)? {
        Some(names) => names.call_method0("tolist")?.extract()?,
        None => chain_names.to_vec(),
    };
    let missing = |name: &str| to_py(Error::Invalid(format!("has no array '{name}'")));
    let rows = |aliases: [&str; 3]| -> PyResult<Option<Vec<f64>>> {
        let Some(array) = array(archive, &aliases)? else { return Ok(None) };
        let rows = read_rows(&array, aliases[0], &[names.len()])?;
        Ok(Some(rows.as_slice()?.to_vec()))
    };
    let t = read_vector(&array(archive, &TIMES)?.ok_or_else(|| missing("t"))?, "t", None)?;
    let q = rows(POSITIONS)?.ok_or_else(|| missing("q"))?;
    let (qd, qdd) = (rows(VELOCITIES)?, rows(ACCELERATIONS)?);
    let words = array(archive, &["section"])?;
    let words = words.map(|words| words.call_method0("tolist")?.extract::<Vec<String>>()).transpose()?;
    let sections = words.map(|words| words.iter().map(|word| word.parse::<Section>()).collect());
    let sections = sections.transpose().map_err(to_py)?;
    JointRows::new(names, t, q, qd, qdd, sections).map_err(to_py)
}

/// Check a joint trajectory before an arm runs it: limits, jumps, rest, contact, deviation from a path.
///
/// Checked is the curve that `Trajectory.sample` gives, so also the motion between the rows. Consecutive intervals
/// with the same error of the same joint are one finding.
///
/// Args:
///     chain: The arm, or an arm object.
///     trajectory: A trajectory or plan, or a file of any origin: JSON (ROS `JointTrajectory`), CSV or npz. The joints
///         may be in any order.
///     path: The path that the tool should follow, except in rows of the sections `lead_in`, `blend` and `lead_out`.
///     scene: Obstacles.
///     links: Shapes of the links, or a radius (m) of capsules from joint to joint; 0.05 by default. Pairs of a
///         `LinkGeometry` must not touch each other: `self_collision`.
///     velocity_limits: `(n,)` rad/s or m/s, `"chain"`, or None for off.
///     acceleration_limits: `(n,)` rad/s^2 or m/s^2, `"chain"`, or None for off.
///     jerk_limits: `(n,)` or one number for all, rad/s^3 or m/s^3.
///     torque_limits: `(n,)` N m or N, `"chain"`, or None for off (default); needs a chain with inertias.
///     at_rest: Whether the first and the last row must be at rest.
///     tolerance: Share of a limit by which it may be exceeded, 0.001 by default. The effect of rounding times to
///         nanoseconds is allowed in addition.
///     position_tolerance: Largest distance from the path, m; 0.001 by default.
///     orientation_tolerance: Largest angle from the path's orientation, rad, 0.01 by default; None for off, as for a
///         plan with a free tool.
///     singularity: Ratio of the least to the largest singular value of the Jacobian below which a row is near a
///         singularity, 0.001 by default; 0 is off.
///     clearance: Least distance from obstacles, m.
///     gravity: `(3,)` m/s^2, world axes.
///     threads: Threads; all cores by default.
///
/// Raises:
///     RedundancyError: Joints that are missing or not the chain's, positions that seem to be in degrees, no rows,
///         settings out of range.
///     FileFormatError: A file that cannot be read.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("panda")
///     >>> move = rd.retime(arm, [[0, 0.3, 0, -1, 0.2, 1, 0], [0.5, 0.3, 0, -1, 0.2, 1, 0]])
///     >>> rd.check(arm, move).ok
///     True
///     >>> fast = rd.Trajectory(move.joint_names, move.t / 2, move.q, 2 * move.qd)
///     >>> sorted({finding.kind for finding in rd.check(arm, fast).findings})
///     ['acceleration', 'velocity']
#[pyfunction]
#[pyo3(name = "check", signature = (chain, trajectory, path=None, *, scene=None, links=None,
    velocity_limits=Some(JointLimits::Word("chain".into())), acceleration_limits=Some(JointLimits::Word("chain".into())),
    jerk_limits=None, torque_limits=None, at_rest=true, tolerance=None, position_tolerance=None,
    orientation_tolerance=Some(CheckOrientation::Default), singularity=None, clearance=0.0, gravity=STANDARD_GRAVITY,
    threads=None),
    text_signature = "(chain, trajectory, path=None, *, scene=None, links=None, velocity_limits=\"chain\", \
    acceleration_limits=\"chain\", jerk_limits=None, torque_limits=None, at_rest=True, tolerance=None, \
    position_tolerance=None, orientation_tolerance=0.01, singularity=None, clearance=0.0, \
    gravity=(0.0, 0.0, -9.81), threads=None)")]
pub fn py_check<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyAny>,
    trajectory: AnyRows<'py>,
    path: Option<Given<'py, PyPath>>,
    scene: Option<Given<'py, PyScene>>,
    links: Option<LinkRadius<'py>>,
    velocity_limits: Option<JointLimits<'py>>,
    acceleration_limits: Option<JointLimits<'py>>,
    jerk_limits: Option<Bound<'py, PyAny>>,
    torque_limits: Option<JointLimits<'py>>,
    at_rest: bool,
    tolerance: Option<f64>,
    position_tolerance: Option<f64>,
    orientation_tolerance: Option<CheckOrientation>,
    singularity: Option<f64>,
    clearance: f64,
    gravity: Gravity,
    threads: Option<Threads>,
) -> PyResult<PyCheckReport> {
    let chain = read_chain(chain)?;
    let chain = &chain.get().chain;
    let joints = chain.joints();
    let names: Vec<String> = joints.iter().map(|joint| joint.name.clone()).collect();
    let rows = trajectory.read(py, &names)?;
    let default = CheckSettings::of(chain);
    let limits = |given, what, pick: fn(&redundancy_core::chain::Limits) -> f64| {
        read_limits(given, what, joints.iter().map(|joint| pick(&joint.limits)))
    };
    let settings = CheckSettings {
        velocity_limits: limits(velocity_limits, "velocity_limits", |l| l.velocity)?,
        acceleration_limits: limits(acceleration_limits, "acceleration_limits", |l| l.acceleration)?,
        jerk_limits: limits(jerk_limits.map(JointLimits::Values), "jerk_limits", |_| f64::INFINITY)?,
        torque_limits: limits(torque_limits, "torque_limits", |l| l.effort)?,
        at_rest,
        tolerance: tolerance.unwrap_or(default.tolerance),
        position_tolerance: position_tolerance.unwrap_or(default.position_tolerance),
        orientation_tolerance: match orientation_tolerance {
            None => None,
            Some(CheckOrientation::Default) => default.orientation_tolerance,
            Some(CheckOrientation::Angle(angle)) => Some(angle),
        },
        singularity: singularity.unwrap_or(default.singularity),
        clearance,
        gravity: gravity.into(),
        ..default
    };
    let links = links.map(|links| links.geometry(chain)).transpose()?;
    let against = CheckAgainst {
        path: path.as_ref().map(|path| &path.get().path),
        scene: scene.as_ref().map(|scene| &scene.get().scene),
        links: links.as_ref(),
    };
    let pool = pool(threads)?;
    let report = py.detach(|| pool.install(|| check_rows(chain, &rows, &settings, against)));
    report.map(|report| PyCheckReport { report }).map_err(to_py)
}

/// The orientation tolerance that is given.
pub enum CheckOrientation {
    /// That of the core.
    Default,
    /// This angle, rad.
    Angle(f64),
}

impl<'py> FromPyObject<'_, 'py> for CheckOrientation {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self::Angle(object.extract::<f64>()?))
    }
}

/// A straight move in joint space from rest to rest, as fast as the limits allow, checked before it is returned.
///
/// Args:
///     chain: The arm, or an arm object.
///     q_from: `(n,)` where the arm is, rad or m.
///     q_to: `(n,)` where it should be.
///     scene: Obstacles.
///     links: Shapes of the links, or a radius (m) of capsules from joint to joint; 0.05 by default.
///     velocity_limits: `(n,)` rad/s or m/s, `"chain"`, or None.
///     acceleration_limits: `(n,)` rad/s^2 or m/s^2, `"chain"`, or None; each joint needs one.
///     jerk_limits: `(n,)` or one number for all, rad/s^3 or m/s^3; None lets accelerations jump.
///     clearance: Least distance from obstacles, m.
///
/// Raises:
///     CannotFollowError: The move makes contact or leaves the joint limits; the message says which link and
///         obstacle, or which joint, and when.
///     RedundancyError: Wrong lengths, invalid limits, a joint without an acceleration limit.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("panda")
///     >>> move = rd.joint_move(arm, [0, 0.3, 0, -1, 0.2, 1, 0], [0.5, 0.3, 0, -1, 0.2, 1, 0])
///     >>> rd.check(arm, move).ok
///     True
#[pyfunction]
#[pyo3(name = "joint_move", signature = (chain, q_from, q_to, *, scene=None, links=None,
    velocity_limits=Some(JointLimits::Word("chain".into())), acceleration_limits=Some(JointLimits::Word("chain".into())),
    jerk_limits=None, clearance=0.0),
    text_signature = "(chain, q_from, q_to, *, scene=None, links=None, velocity_limits=\"chain\", \
    acceleration_limits=\"chain\", jerk_limits=None, clearance=0.0)")]
pub fn py_joint_move<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyAny>,
    q_from: &Bound<'py, PyAny>,
    q_to: &Bound<'py, PyAny>,
    scene: Option<Given<'py, PyScene>>,
    links: Option<LinkRadius<'py>>,
    velocity_limits: Option<JointLimits<'py>>,
    acceleration_limits: Option<JointLimits<'py>>,
    jerk_limits: Option<Bound<'py, PyAny>>,
    clearance: f64,
) -> PyResult<PyTrajectory> {
    let chain = read_chain(chain)?;
    let chain = &chain.get().chain;
    let (joints, n) = (chain.joints(), chain.dof());
    let [from, to] = [(q_from, "q_from"), (q_to, "q_to")].map(|(q, what)| read_vector(q, what, Some(n)));
    let (from, to) = (from?, to?);
    let limits = |given, what, pick: fn(&redundancy_core::chain::Limits) -> f64| {
        read_limits(given, what, joints.iter().map(|joint| pick(&joint.limits)))
    };
    let none = || vec![f64::INFINITY; n];
    let settings = RetimeSettings {
        velocity_limits: limits(velocity_limits, "velocity_limits", |l| l.velocity)?.unwrap_or_else(none),
        acceleration_limits: limits(acceleration_limits, "acceleration_limits", |l| l.acceleration)?
            .unwrap_or_else(none),
        jerk_limits: limits(jerk_limits.map(JointLimits::Values), "jerk_limits", |_| f64::INFINITY)?,
        ..RetimeSettings::of(chain)
    };
    let links = links.map(|links| links.geometry(chain)).transpose()?;
    let scene = scene.as_ref().map(|scene| &scene.get().scene);
    let against = CheckAgainst { path: None, scene, links: links.as_ref() };
    let made = py.detach(|| joint_move(chain, [&from, &to], &settings, against, clearance));
    made.map(PyTrajectory::from).map_err(to_py)
}
