//! The servo: a target pose per tick in, joint positions out.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};
use redundancy_core::nalgebra::{Vector3, Vector6};
use redundancy_core::streaming::{Servo, ServoLimit, ServoReport, ServoSettings, ServoTarget, TargetNoise};
use redundancy_core::{Error, Pose, pose_from_row_major};

use crate::chain::PyChain;
use crate::convert::{Argument, Given, read_array, read_poses, read_vector};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::self_motion::PySrsArm;
use crate::status::status_to_py;
use crate::step::limit_names;

/// A servo for pose targets: one target pose per tick in, joint position, velocity and acceleration out.
///
/// Limits of position, velocity, acceleration and (where given) jerk hold at every tick, whatever the input:
/// noise, jumps, targets out of reach, late, repeated, NaN or none. Every tick leads to a state from which
/// braking to rest holds them too. Velocity, acceleration and jerk are the differences of the joint
/// positions over `dt`.
///
/// Args:
///     chain: The arm, or an arm object made from it.
///     dt: Length of a tick, s.
///     velocity_limits: Largest joint speeds `(n,)`, rad/s or m/s; `"chain"` takes the chain's, None is off.
///     acceleration_limits: Largest joint accelerations `(n,)`, rad/s^2 or m/s^2; `"chain"` or None takes
///         the chain's. A joint without one gets ten times its velocity limit per second (full speed after
///         0.1 s), or 10 where it has no velocity limit either: without any limit there is no braking to
///         foresee.
///     jerk_limits: Largest joint jerks `(n,)`, rad/s^3 or m/s^3; None is off.
///     criterion: What to do with the freedom; None keeps joints away from their limits.
///     desired_swivel: Swivel angle to follow, rad, until `update` gets another one.
///     position_weight: Weight of 1 m of position error where the target is out of reach.
///     orientation_weight: Weight of 1 rad of orientation error, m.
///     target_noise: `(m, rad)`, the root mean square of the input's noise; `"auto"` measures it; None takes
///         the target as exact.
///     swivel_reference: Direction `(3,)`, base frame, from which the swivel of an arm without a chart
///         counts. It is the angle of the elbow about the line from shoulder to wrist, the origins of
///         joints 4, 2 and 6.
///     timeout: Time without a target after which the arm brakes to rest, s.
///
/// Raises:
///     RedundancyError: A tick, limit, weight, noise or timeout out of range, a criterion of another arm, a
///         desired swivel on an arm that needs `swivel_reference`.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("iiwa14")
///     >>> servo = rd.Servo(arm, 0.004)
///     >>> servo.reset([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])
///     >>> str(servo.update(arm.forward([0.3, 0.6, -0.2, -1.2, 0.1, 0.9, 0.4])).status)
///     'converged'
#[pyclass(name = "Servo", module = "redundancy", frozen)]
pub struct PyServo {
    servo: Mutex<Servo>,
    chain: Py<PyChain>,
    recipe: Py<PyTuple>,
}

impl PyServo {
    /// The servo. It is never held while Python code runs, so this does not wait for the GIL.
    fn lock(&self) -> MutexGuard<'_, Servo> {
        self.servo.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Argument for PyServo {
    const WHAT: &'static str = "a servo";
    const HOW: &'static str = "for example rd.Servo(chain, 0.004)";
}

/// The chain given, or that of an arm object.
fn chain_of<'py>(object: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyChain>> {
    let own = match object.getattr_opt(pyo3::intern!(object.py(), "chain"))? {
        Some(chain) => chain,
        None => object.clone(),
    };
    Ok(own.cast_into::<PyChain>()?)
}

/// The pose of a target; `None` for numbers that are no pose. A wrong shape is the caller's mistake.
fn read_target(object: &Bound<'_, PyAny>) -> PyResult<Option<Pose>> {
    let rows = read_poses(object)?;
    if rows.batch.is_some() {
        return Err(to_py(Error::Invalid("target_pose: expected one pose (4, 4), got a batch".into())));
    }
    Ok(pose_from_row_major(rows.as_slice()?).ok())
}

/// A word that is the default, or anything else.
#[derive(FromPyObject)]
enum WordOr {
    Word(String),
    Object(Py<PyAny>),
}

fn bound(py: Python<'_>, value: Option<WordOr>) -> Option<Bound<'_, PyAny>> {
    value.map(|value| match value {
        WordOr::Word(word) => PyString::new(py, &word).into_any(),
        WordOr::Object(object) => object.into_bound(py),
    })
}

/// `"chain"`, None or numbers.
fn read_limits(object: Option<&Bound<'_, PyAny>>, what: &str, dof: usize) -> PyResult<Option<Vec<f64>>> {
    match object {
        None => Ok(Some(vec![f64::INFINITY; dof])),
        Some(object) if object.extract::<&str>().is_ok_and(|word| word == "chain") => Ok(None),
        Some(object) => Ok(Some(read_vector(object, what, Some(dof))?)),
    }
}

fn read_noise(object: Option<&Bound<'_, PyAny>>) -> PyResult<TargetNoise> {
    let Some(object) = object else { return Ok(TargetNoise::None) };
    if object.extract::<&str>().is_ok_and(|word| word == "auto") {
        return Ok(TargetNoise::Auto);
    }
    if let Ok((position, angle)) = object.extract::<(f64, f64)>() {
        return Ok(TargetNoise::Given(position, angle));
    }
    let message = format!("target_noise is {}, expected \"auto\", None or (m, rad)", object.repr()?);
    Err(to_py(Error::Invalid(message)))
}

fn vector3(object: Option<&Bound<'_, PyAny>>, what: &str) -> PyResult<Option<Vector3<f64>>> {
    object.map(|object| read_array::<3>(object, what).map(Vector3::from)).transpose()
}

#[pymethods]
impl PyServo {
    #[new]
    #[pyo3(signature = (chain, dt, *, velocity_limits=Some(WordOr::Word("chain".into())),
        acceleration_limits=Some(WordOr::Word("chain".into())), jerk_limits=None, criterion=None, desired_swivel=None,
        position_weight=1.0, orientation_weight=0.3, target_noise=Some(WordOr::Word("auto".into())),
        swivel_reference=None, timeout=0.1),
        text_signature = "(chain, dt, *, velocity_limits='chain', acceleration_limits='chain', jerk_limits=None, \
            criterion=None, desired_swivel=None, position_weight=1.0, orientation_weight=0.3, target_noise='auto', \
            swivel_reference=None, timeout=0.1)")]
    fn new(
        chain: &Bound<'_, PyAny>,
        dt: f64,
        velocity_limits: Option<WordOr>,
        acceleration_limits: Option<WordOr>,
        jerk_limits: Option<&Bound<'_, PyAny>>,
        criterion: Option<Given<'_, PyCriterion>>,
        desired_swivel: Option<f64>,
        position_weight: f64,
        orientation_weight: f64,
        target_noise: Option<WordOr>,
        swivel_reference: Option<&Bound<'_, PyAny>>,
        timeout: f64,
    ) -> PyResult<Self> {
        let py = chain.py();
        let srs = chain.cast::<PySrsArm>().ok().map(|arm| arm.get().arm.clone());
        let given = chain;
        let chain = chain_of(given)?;
        let arm = &chain.get().chain;
        let (velocity, acceleration, noise) =
            (bound(py, velocity_limits), bound(py, acceleration_limits), bound(py, target_noise));
        let n = arm.dof();
        let settings = ServoSettings {
            velocity_limits: read_limits(velocity.as_ref(), "velocity_limits", n)?,
            acceleration_limits: read_limits(acceleration.as_ref(), "acceleration_limits", n)?,
            jerk_limits: read_limits(jerk_limits, "jerk_limits", n)?,
            criterion: criterion.as_ref().map(|criterion| criterion.get().criterion.clone()),
            desired_swivel,
            swivel_reference: vector3(swivel_reference, "swivel_reference")?,
            position_weight,
            orientation_weight,
            target_noise: read_noise(noise.as_ref())?,
            timeout,
            srs,
        };
        let servo = Servo::new(arm, dt, &settings).map_err(to_py)?;
        let options = PyDict::new(py);
        options.set_item("velocity_limits", velocity)?;
        options.set_item("acceleration_limits", acceleration)?;
        options.set_item("jerk_limits", jerk_limits)?;
        options.set_item("criterion", criterion)?;
        options.set_item("desired_swivel", desired_swivel)?;
        options.set_item("position_weight", position_weight)?;
        options.set_item("orientation_weight", orientation_weight)?;
        options.set_item("target_noise", noise)?;
        options.set_item("swivel_reference", swivel_reference)?;
        options.set_item("timeout", timeout)?;
        let make =
            py.import("functools")?.getattr("partial")?.call((py.get_type::<Self>(),), Some(&options))?;
        let recipe = PyTuple::new(py, [make, (given, dt).into_pyobject(py)?.into_any()])?.unbind();
        Ok(Self { servo: Mutex::new(servo), chain: chain.unbind(), recipe })
    }

    /// Starts from joint positions and velocities; comes before the first `update`.
    ///
    /// Args:
    ///     q: Joint positions `(n,)`, rad or m.
    ///     qd: Joint velocities `(n,)`, rad/s or m/s; None is rest.
    ///
    /// Raises:
    ///     RedundancyError: Wrong sizes, numbers that are not finite, a position or velocity outside of its
    ///         limit, a velocity from which the joint cannot brake before its position limit.
    #[pyo3(signature = (q, qd=None))]
    fn reset(&self, q: &Bound<'_, PyAny>, qd: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let q = read_vector(q, "q", None)?;
        let qd = qd.map(|qd| read_vector(qd, "qd", None)).transpose()?;
        self.lock().reset(&q, qd.as_deref()).map_err(to_py)
    }

    /// One tick.
    ///
    /// Args:
    ///     target_pose: Pose of the tool `(4, 4)`, base frame; None for no new target. One that is not finite or
    ///         not rigid is ignored, and the reason says so.
    ///     target_velocity: Its velocity `(6,)` where it is known: linear and angular, base axes, m/s and rad/s.
    ///     desired_swivel: Swivel angle to follow from now on, rad.
    ///     desired_elbow: Point `(3,)`, base frame, m: of the solutions for the pose the one whose elbow is
    ///         nearest to it.
    ///
    /// Raises:
    ///     RedundancyError: No `reset` before, wrong shapes.
    #[pyo3(signature = (target_pose, target_velocity=None, desired_swivel=None, desired_elbow=None))]
    fn update(
        &self,
        py: Python<'_>,
        target_pose: Option<&Bound<'_, PyAny>>,
        target_velocity: Option<&Bound<'_, PyAny>>,
        desired_swivel: Option<f64>,
        desired_elbow: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyServoTick> {
        let (pose, broken) = match target_pose {
            None => (None, false),
            Some(object) => {
                let pose = read_target(object)?;
                (pose, pose.is_none())
            }
        };
        let target = ServoTarget {
            pose,
            broken,
            velocity: target_velocity
                .map(|v| read_array::<6>(v, "target_velocity"))
                .transpose()?
                .map(Vector6::from),
            swivel: desired_swivel,
            elbow: desired_elbow.map(|v| read_array::<3>(v, "desired_elbow")).transpose()?.map(Vector3::from),
        };
        let mut servo = self.lock();
        let report = servo.update(&target).map_err(to_py)?;
        Ok(PyServoTick {
            q: servo.q().to_vec(),
            qd: servo.qd().to_vec(),
            qdd: servo.qdd().to_vec(),
            reason: servo.explain(&report.reason),
            active: servo.active_limits().to_vec(),
            report,
            chain: self.chain.clone_ref(py),
        })
    }

    /// The arm.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// Length of a tick, s.
    #[getter]
    fn dt(&self) -> f64 {
        self.lock().dt()
    }

    fn __repr__(&self) -> String {
        let servo = self.lock();
        format!("Servo({}, dt={:?})", servo.chain().name(), servo.dt())
    }

    fn __reduce__(&self, py: Python<'_>) -> Py<PyTuple> {
        self.recipe.clone_ref(py)
    }
}

/// What one tick of a servo did.
#[pyclass(name = "ServoTick", module = "redundancy", frozen)]
pub struct PyServoTick {
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
    report: ServoReport,
    reason: Option<String>,
    active: Vec<ServoLimit>,
    chain: Py<PyChain>,
}

#[pymethods]
impl PyServoTick {
    /// Joint positions to send `(n,)`, rad or m.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.q)
    }

    /// Joint velocities `(n,)`: `q` minus the one before, by `dt`.
    #[getter]
    fn qd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.qd)
    }

    /// Joint accelerations `(n,)`: `qd` minus the one before, by `dt`.
    #[getter]
    fn qdd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.qdd)
    }

    /// `converged` (0.1 mm, 1 mrad), `tracking` (behind the target), `unreachable`, `limits`, `no_target`.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.report.status)
    }

    /// Why, in words; None where there is nothing to explain.
    #[getter]
    fn reason(&self) -> Option<&str> {
        self.reason.as_deref()
    }

    /// Distance of the tool from the target, m; 0 where there has been no target.
    #[getter]
    fn position_error(&self) -> f64 {
        self.report.position_error
    }

    /// Angle of the tool to the target, rad.
    #[getter]
    fn orientation_error(&self) -> f64 {
        self.report.orientation_error
    }

    /// Share of the target's velocity with which the tool follows it, in [0, 1]; 1 for a target at rest.
    #[getter]
    fn scale(&self) -> f64 {
        self.report.scale
    }

    /// Time until the arm would have to stop or flip at the present tool velocity, s; inf if none is seen.
    #[getter]
    fn time_to_stop(&self) -> f64 {
        self.report.time_to_stop
    }

    /// Limits that acted: name of the joint, which limit, which side.
    #[getter]
    fn active_limits(&self) -> Vec<(String, &'static str, &'static str)> {
        let limits = self.active.iter().map(|limit| (limit.joint, limit.kind.as_str(), limit.upper));
        limit_names(&self.chain.get().chain, limits)
    }

    fn __repr__(&self) -> String {
        let ServoReport { status, position_error, orientation_error, scale, .. } = self.report;
        format!(
            "ServoTick(status='{status}', position_error={position_error:.3e}, \
             orientation_error={orientation_error:.3e}, scale={scale:.3})"
        )
    }
}
