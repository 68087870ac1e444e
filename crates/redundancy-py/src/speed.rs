//! Orientation rules and the fastest motion over a path.

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use redundancy_core::chain::Chain;
use redundancy_core::nalgebra::{Matrix3, Rotation3, Vector3};
use redundancy_core::path::Path;
use redundancy_core::planning::{BarrierRule, OrientationRule, RuleKind, RuleSpin, Surface};
use redundancy_core::timing::{
    MaxSpeed, SpeedLimit, SpeedProfile, SpeedSettings, fastest_profile, max_speed, max_speed_of_poses,
};
use redundancy_core::{Error, Pose};

use crate::chain::PyChain;
use crate::convert::{
    Given, Gravity, STANDARD_GRAVITY, read_pose, read_rotation, read_rows, read_vector, to_array,
};
use crate::error::to_py;
use crate::path::PyPath;

/// A rule from positions to tool orientations; made by the functions of `redundancy.orientation_rules`.
///
/// Calling it with positions `(N, 3)` or `(3,)`, m, gives rotations `(N, 3, 3)` or `(3, 3)`. Its arguments are
/// described in those functions.
#[pyclass(name = "OrientationRule", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyOrientationRule {
    rule: OrientationRule,
}

const KINDS: [&str; 7] =
    ["constant", "pointing", "tilt_square", "tilt_disc", "barrier_cone", "barrier_two_cones", "barrier_spin"];

#[pymethods]
impl PyOrientationRule {
    #[new]
    #[pyo3(signature = (kind, *, angle=None, spin=None, beta=None, alpha=None, k_err=None, k_tcp=None,
        distance=None, gamma=None, k_x=None, orientation=None, center=None, half_extents=None, radius=None),
        text_signature = "(kind, *, angle=None, spin='pointing', beta=None, alpha=None, k_err=None, k_tcp=None, \
            distance=None, gamma=None, k_x=None, orientation=None, center=None, half_extents=None, radius=None)")]
    fn new(
        kind: &str,
        angle: Option<f64>,
        spin: Option<&str>,
        beta: Option<f64>,
        alpha: Option<f64>,
        k_err: Option<f64>,
        k_tcp: Option<f64>,
        distance: Option<f64>,
        gamma: Option<f64>,
        k_x: Option<f64>,
        orientation: Option<&Bound<'_, PyAny>>,
        center: Option<[f64; 2]>,
        half_extents: Option<[f64; 2]>,
        radius: Option<f64>,
    ) -> PyResult<Self> {
        let unknown = |kind: &'static str, name: &str, valid: &[&str]| {
            let valid = valid.iter().map(|v| (*v).into()).collect();
            to_py(Error::UnknownName { kind, name: name.into(), valid })
        };
        let turning = match spin.unwrap_or("pointing") {
            "pointing" => RuleSpin::Pointing,
            "constant" => RuleSpin::Constant,
            other => return Err(unknown("spin", other, &["pointing", "constant"])),
        };
        let given = [
            ("angle", angle.is_some()),
            ("spin", spin.is_some()),
            ("beta", beta.is_some()),
            ("alpha", alpha.is_some()),
            ("k_err", k_err.is_some()),
            ("k_tcp", k_tcp.is_some()),
            ("distance", distance.is_some()),
            ("gamma", gamma.is_some()),
            ("k_x", k_x.is_some()),
            ("center", center.is_some()),
            ("half_extents", half_extents.is_some()),
            ("radius", radius.is_some()),
        ];
        let options = options_of(kind).ok_or_else(|| unknown("orientation rule", kind, &KINDS))?;
        if let Some((name, _)) = given.iter().find(|(name, given)| *given && !options.contains(name)) {
            let has = if options.is_empty() { String::new() } else { format!("{}, ", options.join(", ")) };
            let message = format!("{kind} has no option {name}: its options are {has}orientation");
            return Err(to_py(Error::Invalid(message)));
        }
        let angle = || angle.ok_or_else(|| to_py(Error::Invalid(format!("{kind} needs angle (rad)"))));
        let default = BarrierRule::default();
        let barrier = BarrierRule {
            beta: beta.unwrap_or(default.beta),
            alpha: alpha.unwrap_or(default.alpha),
            k_err: k_err.unwrap_or(default.k_err),
            k_tcp: k_tcp.unwrap_or(default.k_tcp),
            distance: distance.unwrap_or(default.distance),
        };
        let chosen = match kind {
            "constant" => RuleKind::Constant,
            "pointing" => RuleKind::Pointing,
            "tilt_square" => RuleKind::TiltSquare { angle: angle()?, spin: turning },
            "tilt_disc" => RuleKind::TiltDisc { angle: angle()?, spin: turning },
            "barrier_cone" => RuleKind::BarrierCone(barrier),
            "barrier_two_cones" => RuleKind::BarrierTwoCones {
                axis: barrier,
                gamma: gamma.unwrap_or(60f64.to_radians()),
                k_x: k_x.unwrap_or(1.0),
            },
            "barrier_spin" => RuleKind::BarrierSpin(barrier),
            other => return Err(unknown("orientation rule", other, &KINDS)),
        };
        let mut rule = OrientationRule::new(chosen).map_err(to_py)?;
        if let Some(orientation) = orientation {
            rule = rule.with_orientation(read_rotation(orientation, "orientation")?).map_err(to_py)?;
        }
        if center.is_some() || half_extents.is_some() || radius.is_some() {
            let (Some(center), true) = (center, half_extents.is_some() || radius.is_some()) else {
                let message = "a surface needs center and half_extents or radius".into();
                return Err(to_py(Error::Invalid(message)));
            };
            let half_extents = half_extents.or(radius.map(|r| [r, r])).unwrap_or_default();
            let radius = radius.unwrap_or_else(|| half_extents[0].hypot(half_extents[1]));
            rule = rule.with_surface(Surface { center, half_extents, radius }).map_err(to_py)?;
        }
        Ok(Self { rule })
    }

    /// Orientations of positions.
    fn __call__<'py>(&self, py: Python<'py>, positions: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = read_rows(positions, "positions", &[3])?;
        let points: Vec<Vector3<f64>> =
            rows.as_slice()?.chunks_exact(3).map(Vector3::from_column_slice).collect();
        let rotations = py.detach(|| self.rule.orientations(&points)).map_err(to_py)?;
        let flat: Vec<f64> =
            rotations.iter().flat_map(|r| r.matrix().transpose().as_slice().to_vec()).collect();
        match rows.batch {
            None => Ok(to_array(py, &flat, [3, 3])?.into_any()),
            Some(n) => Ok(to_array(py, &flat, [n, 3, 3])?.into_any()),
        }
    }

    /// Name of the rule.
    #[getter]
    fn kind(&self) -> &'static str {
        match self.rule.kind() {
            RuleKind::Constant => KINDS[0],
            RuleKind::Pointing => KINDS[1],
            RuleKind::TiltSquare { .. } => KINDS[2],
            RuleKind::TiltDisc { .. } => KINDS[3],
            RuleKind::BarrierCone(_) => KINDS[4],
            RuleKind::BarrierTwoCones { .. } => KINDS[5],
            _ => KINDS[6],
        }
    }

    fn __repr__(&self) -> String {
        let constants = match self.rule.kind() {
            RuleKind::TiltSquare { angle, spin } | RuleKind::TiltDisc { angle, spin } => {
                format!("angle={angle}, spin='{}'", spin_word(*spin))
            }
            RuleKind::BarrierCone(b) | RuleKind::BarrierSpin(b) => barrier_text(b),
            RuleKind::BarrierTwoCones { axis, gamma, k_x } => {
                format!("{}, gamma={gamma}, k_x={k_x}", barrier_text(axis))
            }
            _ => String::new(),
        };
        format!("orientation_rules.{}({constants})", self.kind())
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (String, Bound<'py, PyDict>))> {
        let make = py.import("redundancy.orientation_rules")?.getattr("_make")?;
        let given = PyDict::new(py);
        match self.rule.kind() {
            RuleKind::TiltSquare { angle, spin } | RuleKind::TiltDisc { angle, spin } => {
                given.set_item("angle", angle)?;
                given.set_item("spin", spin_word(*spin))?;
            }
            RuleKind::BarrierCone(b)
            | RuleKind::BarrierSpin(b)
            | RuleKind::BarrierTwoCones { axis: b, .. } => {
                for (name, value) in [
                    ("beta", b.beta),
                    ("alpha", b.alpha),
                    ("k_err", b.k_err),
                    ("k_tcp", b.k_tcp),
                    ("distance", b.distance),
                ] {
                    given.set_item(name, value)?;
                }
            }
            _ => {}
        }
        if let RuleKind::BarrierTwoCones { gamma, k_x, .. } = self.rule.kind() {
            given.set_item("gamma", gamma)?;
            given.set_item("k_x", k_x)?;
        }
        let matrix = self.rule.orientation().matrix().transpose();
        given.set_item("orientation", to_array(py, matrix.as_slice(), [3, 3])?)?;
        if let Some(surface) = self.rule.surface() {
            given.set_item("center", surface.center)?;
            given.set_item("half_extents", surface.half_extents)?;
            if matches!(self.rule.kind(), RuleKind::TiltDisc { .. }) {
                given.set_item("radius", surface.radius)?;
            }
        }
        Ok((make, (self.kind().into(), given)))
    }
}

/// The options of a rule beside `orientation`; `None` for a rule that does not exist.
fn options_of(kind: &str) -> Option<&'static [&'static str]> {
    Some(match kind {
        "constant" | "pointing" => &[],
        "tilt_square" => &["angle", "spin", "center", "half_extents"],
        "tilt_disc" => &["angle", "spin", "center", "radius", "half_extents"],
        "barrier_cone" | "barrier_spin" => {
            &["beta", "alpha", "k_err", "k_tcp", "distance", "center", "half_extents"]
        }
        "barrier_two_cones" => {
            &["beta", "alpha", "gamma", "k_err", "k_tcp", "k_x", "distance", "center", "half_extents"]
        }
        _ => return None,
    })
}

fn spin_word(spin: RuleSpin) -> &'static str {
    match spin {
        RuleSpin::Pointing => "pointing",
        RuleSpin::Constant => "constant",
    }
}

fn barrier_text(b: &BarrierRule) -> String {
    format!(
        "beta={}, alpha={}, k_err={}, k_tcp={}, distance={}",
        b.beta, b.alpha, b.k_err, b.k_tcp, b.distance
    )
}

/// `None`, `"chain"` or one number per joint.
#[derive(FromPyObject)]
pub enum JointLimits<'py> {
    Word(String),
    Values(Bound<'py, PyAny>),
}

/// Resolves limits against those of the chain.
pub fn read_limits(
    given: Option<JointLimits<'_>>,
    what: &'static str,
    of_chain: impl Iterator<Item = f64>,
) -> PyResult<Option<Vec<f64>>> {
    let of_chain: Vec<f64> = of_chain.collect();
    match given {
        None => Ok(None),
        Some(JointLimits::Word(word)) if word == "chain" => Ok(Some(of_chain)),
        Some(JointLimits::Word(word)) => {
            Err(to_py(Error::UnknownName { kind: what, name: word, valid: vec!["chain".into()] }))
        }
        Some(JointLimits::Values(values)) => match values.extract::<f64>() {
            Ok(value) => Ok(Some(vec![value; of_chain.len()])),
            Err(_) => read_vector(&values, what, Some(of_chain.len())).map(Some),
        },
    }
}

/// The arm with its tool, and what bounds it.
pub fn read_task(
    chain: &Bound<'_, PyChain>,
    tool: Option<&Bound<'_, PyAny>>,
    torque_limits: Option<JointLimits<'_>>,
    velocity_limits: Option<JointLimits<'_>>,
    gravity: Gravity,
) -> PyResult<(Chain, SpeedSettings)> {
    let chain = &chain.get().chain;
    let chain = match tool {
        None => chain.clone(),
        Some(tool) => chain.with_tool(read_pose(tool)?).map_err(to_py)?,
    };
    let joints = chain.joints();
    let settings = SpeedSettings {
        torque_limits: read_limits(torque_limits, "torque_limits", joints.iter().map(|j| j.limits.effort))?,
        velocity_limits: read_limits(
            velocity_limits,
            "velocity_limits",
            joints.iter().map(|j| j.limits.velocity),
        )?,
        gravity: Vector3::from(gravity),
        joint_limits: true,
    };
    Ok((chain, settings))
}

/// The poses that a rule, a callable or the path itself gives.
fn read_oriented(py: Python<'_>, path: &Path, rule: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<Pose>> {
    let Some(rule) = rule else {
        if path.has_orientation() {
            return Ok(path.poses().to_vec());
        }
        let message = "the path has positions only: give orientation_rule or q";
        return Err(to_py(Error::Invalid(message.into())));
    };
    let positions: Vec<Vector3<f64>> = path.poses().iter().map(|p| p.translation.vector).collect();
    let rotations = if let Ok(rule) = rule.cast::<PyOrientationRule>() {
        rule.get().rule.orientations(&positions).map_err(to_py)?
    } else {
        let flat: Vec<f64> = positions.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let given = rule.call1((to_array(py, &flat, [positions.len(), 3])?,))?;
        let rows = read_rows(&given, "result of orientation_rule", &[3, 3])?;
        if rows.batch != Some(positions.len()) {
            let expected = positions.len();
            let what = "result of orientation_rule (rotations)".into();
            return Err(to_py(Error::Length { what, expected, actual: rows.batch.unwrap_or(1) }));
        }
        let turn = |m: &[f64]| Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(m));
        rows.as_slice()?.chunks_exact(9).map(turn).collect()
    };
    Ok(path.with_orientations(&rotations).map_err(to_py)?.poses().to_vec())
}

/// The largest constant tool speed along a path, and what limits it.
#[pyclass(name = "MaxSpeed", module = "redundancy", frozen)]
pub struct PyMaxSpeed {
    result: MaxSpeed,
    joint_name: String,
}

#[pymethods]
impl PyMaxSpeed {
    /// m/s.
    #[getter]
    fn speed(&self) -> f64 {
        self.result.speed
    }

    /// Index of the limiting joint.
    #[getter]
    fn limiting_joint(&self) -> usize {
        self.result.limiting_joint
    }

    /// Its name.
    #[getter]
    fn limiting_joint_name(&self) -> &str {
        &self.joint_name
    }

    /// `"torque"` or `"velocity"`.
    #[getter]
    fn limit(&self) -> &'static str {
        self.result.limit.as_str()
    }

    /// The path point at which the limit is reached, from 0.
    #[getter]
    fn at(&self) -> usize {
        self.result.at
    }

    /// Whether no other joint motion over the path is faster.
    ///
    /// True with `q` given, and where all branches of a six-joint arm were compared; `False` where lines from a few
    /// starts, or the one from `q0`, were followed.
    #[getter]
    fn proven(&self) -> bool {
        self.result.proven
    }

    /// Joint positions `(N, n)`, rad.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, &self.result.q, self.result.point_speeds.len())
    }

    /// Joint torques `(N, n)` at `speed`, N m; zeros for a chain without inertias.
    #[getter]
    fn torques<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, &self.result.torques, self.result.point_speeds.len())
    }

    /// Largest constant speed `(N,)` that each point would allow on its own, m/s.
    #[getter]
    fn point_speeds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.result.point_speeds)
    }

    fn __repr__(&self) -> String {
        let r = &self.result;
        let (speed, limit, at) = (r.speed, r.limit.as_str(), r.at);
        format!("MaxSpeed({speed:.6} m/s, {limit} of {} at point {at})", self.joint_name)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, SpeedParts)> {
        let r = self.result.clone();
        let at = (r.speed, r.limiting_joint, r.limit == SpeedLimit::Velocity, r.at);
        let parts = (at, r.q, r.torques, r.point_speeds, self.joint_name.clone(), r.proven);
        Ok((py.get_type::<Self>().getattr("_from_parts")?, parts))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts(
        at: (f64, usize, bool, usize),
        q: Vec<f64>,
        torques: Vec<f64>,
        point_speeds: Vec<f64>,
        joint_name: String,
        proven: bool,
    ) -> Self {
        let (speed, limiting_joint, velocity, at) = at;
        let limit = if velocity { SpeedLimit::Velocity } else { SpeedLimit::Torque };
        let result = MaxSpeed { speed, limiting_joint, limit, at, q, torques, point_speeds, proven };
        Self { result, joint_name }
    }
}

type SpeedParts = ((f64, usize, bool, usize), Vec<f64>, Vec<f64>, Vec<f64>, String, bool);

fn rows<'py>(py: Python<'py>, values: &[f64], n: usize) -> PyResult<Bound<'py, PyAny>> {
    Ok(to_array(py, values, [n, values.len() / n.max(1)])?.into_any())
}

/// Joint positions from the caller, or from inverse kinematics.
fn read_line(py: Python<'_>, chain: &Chain, path: &Path, q: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let rows = read_rows(q, "q", &[chain.dof()])?;
    if rows.batch != Some(path.len()) {
        let (what, expected, actual) = ("q (rows)".into(), path.len(), rows.batch.unwrap_or(1));
        return Err(to_py(Error::Length { what, expected, actual }));
    }
    py.check_signals()?;
    Ok(rows.as_slice()?.to_vec())
}

/// The largest constant tool speed along a path, computed exactly: without friction `tau = G + v^2 D`.
///
/// Args:
///     chain: The arm.
///     path: Positions with `orientation_rule`, poses without.
///     orientation_rule: From `redundancy.orientation_rules`, or any callable from positions `(N, 3)` to rotations
///         `(N, 3, 3)`.
///     q: Joint positions `(N, n)`, one row per path point, instead of solving inverse kinematics.
///     q0: Configuration `(n,)` near the start that fixes the branch; without it the fastest branch that can follow
///         the path is taken.
///     tool: Pose of the tool in the last link, instead of the chain's.
///     torque_limits: `"chain"` (default), `(n,)` N m, or `None` for off.
///     velocity_limits: `"chain"` (default), `(n,)` rad/s, or `None` for off.
///     gravity: m/s^2, world axes.
///     joint_limits: Whether the chosen branch must keep the position limits; not used with `q` or `q0`.
///
/// Raises:
///     RedundancyError: A path that cannot be reached or followed (the points are named), torque limits that do not
///         compensate gravity (joint and point), no inertias, no limit, no length.
#[pyfunction(name = "max_speed")]
#[pyo3(signature = (chain, path, orientation_rule=None, q=None, q0=None, tool=None,
    torque_limits=Some(JointLimits::Word("chain".into())), velocity_limits=Some(JointLimits::Word("chain".into())), *, gravity=STANDARD_GRAVITY,
    joint_limits=true),
    text_signature = "(chain, path, orientation_rule=None, q=None, q0=None, tool=None, torque_limits=\"chain\", \
    velocity_limits=\"chain\", *, gravity=(0.0, 0.0, -9.81), joint_limits=True)")]
pub fn py_max_speed<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    path: Given<'py, PyPath>,
    orientation_rule: Option<&Bound<'py, PyAny>>,
    q: Option<&Bound<'py, PyAny>>,
    q0: Option<&Bound<'py, PyAny>>,
    tool: Option<&Bound<'py, PyAny>>,
    torque_limits: Option<JointLimits<'py>>,
    velocity_limits: Option<JointLimits<'py>>,
    gravity: Gravity,
    joint_limits: bool,
) -> PyResult<PyMaxSpeed> {
    let (chain, mut settings) = read_task(chain, tool, torque_limits, velocity_limits, gravity)?;
    settings.joint_limits = joint_limits;
    let path = &path.get().path;
    let result = if let Some(q) = q {
        if orientation_rule.is_some() || q0.is_some() {
            return Err(to_py(Error::Invalid("give q, or orientation_rule and q0, not both".into())));
        }
        let line = read_line(py, &chain, path, q)?;
        py.detach(|| max_speed(&chain, path.s(), &line, &settings))
    } else {
        let poses = read_oriented(py, path, orientation_rule)?;
        let start = q0.map(|q| read_vector(q, "q0", Some(chain.dof()))).transpose()?;
        py.detach(|| max_speed_of_poses(&chain, path.s(), &poses, start.as_deref(), &settings))
    }
    .map_err(to_py)?;
    let joint_name = chain.joints()[result.limiting_joint].name.clone();
    Ok(PyMaxSpeed { result, joint_name })
}

/// A motion along a path with variable tool speed.
#[pyclass(name = "SpeedProfile", module = "redundancy", frozen)]
pub struct PySpeedProfile {
    profile: SpeedProfile,
}

#[pymethods]
impl PySpeedProfile {
    /// Arc length `(N,)`, m.
    #[getter]
    fn s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.profile.s)
    }

    /// Tool speed `(N,)`, m/s.
    #[getter]
    fn speed<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.profile.speed)
    }

    /// Acceleration of the tool along the path from each point to the next `(N,)`, m/s^2.
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.profile.acceleration)
    }

    /// Time `(N,)`, s.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.profile.t)
    }

    /// Time of the whole path, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.profile.t.last().copied().unwrap_or(0.0)
    }

    fn __repr__(&self) -> String {
        format!("SpeedProfile({} points, {:.6} s)", self.profile.t.len(), self.duration())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, ProfileParts)> {
        let SpeedProfile { s, speed, acceleration, t } = self.profile.clone();
        Ok((py.get_type::<Self>().getattr("_from_parts")?, (s, speed, acceleration, t)))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts(s: Vec<f64>, speed: Vec<f64>, acceleration: Vec<f64>, t: Vec<f64>) -> Self {
        Self { profile: SpeedProfile { s, speed, acceleration, t } }
    }
}

type ProfileParts = (Vec<f64>, Vec<f64>, Vec<f64>, Vec<f64>);

/// The fastest motion along given joint positions with variable tool speed, by two passes [PhamPham2018].
///
/// Args:
///     chain: The arm.
///     path: The path; only its arc lengths count.
///     q: Joint positions `(N, n)`, one row per path point.
///     start_speed: Tool speed at the start, m/s.
///     end_speed: Tool speed at the end, m/s.
///     tool: Pose of the tool in the last link, instead of the chain's.
///     torque_limits: `"chain"` (default), `(n,)` N m, or `None` for off.
///     velocity_limits: `"chain"`, `(n,)` rad/s, or `None` for off (default).
///     gravity: m/s^2, world axes.
///
/// Raises:
///     RedundancyError: As for `max_speed`; a speed at an end that is not possible.
#[pyfunction(name = "fastest_profile")]
#[pyo3(signature = (chain, path, q, *, start_speed=0.0, end_speed=0.0, tool=None,
    torque_limits=Some(JointLimits::Word("chain".into())), velocity_limits=None, gravity=STANDARD_GRAVITY),
    text_signature = "(chain, path, q, *, start_speed=0.0, end_speed=0.0, tool=None, torque_limits=\"chain\", \
    velocity_limits=None, gravity=(0.0, 0.0, -9.81))")]
pub fn py_fastest_profile<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyChain>,
    path: Given<'py, PyPath>,
    q: &Bound<'py, PyAny>,
    start_speed: f64,
    end_speed: f64,
    tool: Option<&Bound<'py, PyAny>>,
    torque_limits: Option<JointLimits<'py>>,
    velocity_limits: Option<JointLimits<'py>>,
    gravity: Gravity,
) -> PyResult<PySpeedProfile> {
    let (chain, settings) = read_task(chain, tool, torque_limits, velocity_limits, gravity)?;
    let path = &path.get().path;
    let line = read_line(py, &chain, path, q)?;
    let profile = py.detach(|| fastest_profile(&chain, path.s(), &line, &settings, start_speed, end_speed));
    Ok(PySpeedProfile { profile: profile.map_err(to_py)? })
}
