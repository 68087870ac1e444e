//! Whole paths.

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::path::Plan;
use redundancy_core::planning::{
    FlowForm, FlowState, SwivelChoice, SwivelFlow, SwivelFlowSettings, SwivelPlanSettings, plan_swivel,
};
use redundancy_core::scene::Scene;
use redundancy_core::{Error, Watch};

use crate::convert::{Given, Integer, read_pose, read_vector, to_array};
use crate::error::to_py;
use crate::links::{PyLinkGeometry, SelfCollision, geometry_of};
use crate::path::PyPath;
use crate::plan::{PyPlan, plan_initializer, plan_of};
use crate::scene::PyScene;
use crate::self_motion::{PySrsArm, signs_of};
use crate::watch::watched;

/// A plan of an S-R-S arm with the swivel of each row; `plan_swivel` has one row per path point.
///
/// `converged`; `infeasible`: reconfigurations are needed; `unreachable`, `limits` or `collision`: some points have
/// no configuration (no rows), or none at the fixed swivel or branch (rows up to there); `time_limit`: no rows.
#[pyclass(name = "SwivelPlan", module = "redundancy", frozen, extends = PyPlan)]
pub struct PySwivelPlan;

#[pymethods]
impl PySwivelPlan {
    /// Swivel of each row `(N,)`, rad, unwound.
    #[getter]
    fn swivel<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArray1<f64>> {
        let plan = &this.as_super().get().plan;
        PyArray1::from_slice(this.py(), plan.spare_named("swivel").unwrap_or_default())
    }

    /// Signs (shoulder, elbow, wrist) of each row, `(N, 3)`.
    #[getter]
    fn branch<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let pieces = this.as_super().get().plan.pieces();
        let signs: Vec<[i8; 3]> =
            pieces.map_or(Vec::new(), |pieces| pieces.index.iter().map(|branch| signs_of(*branch)).collect());
        Ok(to_array(this.py(), signs.as_flattened(), [signs.len(), 3])?.into_any())
    }

    fn __repr__(this: &Bound<'_, Self>) -> String {
        format!("Swivel{}", this.as_super().get().__repr__())
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_arrays<'py>(arrays: &Bound<'py, PyAny>) -> PyResult<Bound<'py, Self>> {
        swivel_plan(arrays.py(), plan_of(arrays)?)
    }
}

fn swivel_plan(py: Python<'_>, plan: Plan) -> PyResult<Bound<'_, PySwivelPlan>> {
    let swivels = plan.spare_named("swivel").is_some();
    let branches = plan.pieces().is_some_and(|pieces| pieces.index.iter().all(|branch| *branch < 8));
    if plan.trajectory().dof() != 7 || !swivels || !branches {
        return Err(to_py(Error::Invalid("these are not the parts of a pickled SwivelPlan".into())));
    }
    Bound::new(py, plan_initializer(plan).add_subclass(PySwivelPlan))
}

/// Plan the swivel along a whole path: on one branch, without jumps, away from the limits.
///
/// Dynamic programming over points x swivels, all branches and windings, then refinement in a shrinking tube. Minimises
/// `w_l sum L + w_s sum (1 - cos(s - desired)) + w_m sum |dq|^2` per share of the path, with
/// `L = sum (x^2 / (1 - x^2))^2` for joints at x in (-1, 1) of their range. As few reconfigurations as possible.
///
/// Args:
///     arm: The arm.
///     path: With orientations. With times, the joint velocity limits hold between points.
///     scene: Obstacles; contact is forbidden. Moving obstacles are at their positions at the times of the path.
///     cyclic: The arm ends in the configuration in which it began; the path must be closed.
///     desired: Desired swivel, rad: one, or `(N,)`.
///     wanted_clearance: Wanted distance from the obstacles, m (0.03).
///     link_radius: Links are capsules of this radius, m (0.05), if no `links` are given.
///     links: Shapes of the links, and the pairs that must not touch.
///     self_collision: Whether links must not touch each other. `"auto"`: if `links` has pairs. `True` without
///         `links`: the pairs of joint-to-joint capsules that are found by sampling.
///     fixed: Swivel that is kept exactly: one, or `(N,)`; only branch and windings are chosen.
///     branch: Keep to these signs (shoulder, elbow, wrist), (1, -1, 1) or "+-+".
///     margin: Distance kept from every joint limit, rad.
///     velocity_limits: `"chain"` (default), `(7,)` rad/s, or `None` for off.
///     swivels: Grid cells of the circle (180).
///     limit_weight: w_l (1).
///     motion_weight: w_m (0.5).
///     swivel_weight: w_s (10 000).
///     clearance_weight: Weight of the shortfall from the wanted distance, as a share of that distance (10 000).
///     manipulability_weight: Weight of `(1 - m/m_max)^2` with m the root of det(J J^T) (0).
///     acceleration_weight: Weight of the second differences of the joints, in the refinement (0).
///     progress: Called with the share of the work done.
///     time_limit: Seconds after which the search ends without a plan; `None` is off.
///
/// Raises:
///     RedundancyError: A setting out of its range, a path without orientations, with `cyclic` one that is not closed.
#[pyfunction(name = "plan_swivel")]
#[pyo3(signature = (arm, path, scene=None, cyclic=false, desired=None, wanted_clearance=None, link_radius=None,
    velocity_limits=Some("chain".into()), *, fixed=None, branch=None, margin=0.0, swivels=None, limit_weight=None,
    motion_weight=None, swivel_weight=None, clearance_weight=None, manipulability_weight=None,
    acceleration_weight=None, links=None, self_collision=None, progress=None, time_limit=None),
    text_signature = "(arm, path, scene=None, cyclic=False, desired=None, wanted_clearance=None, link_radius=None, \
        velocity_limits='chain', *, fixed=None, branch=None, margin=0.0, swivels=None, limit_weight=None, \
        motion_weight=None, swivel_weight=None, clearance_weight=None, manipulability_weight=None, \
        acceleration_weight=None, links=None, self_collision='auto', progress=None, time_limit=None)")]
pub fn py_plan_swivel<'py>(
    py: Python<'py>,
    arm: Given<'py, PySrsArm>,
    path: Given<'py, PyPath>,
    scene: Option<Given<'py, PyScene>>,
    cyclic: bool,
    desired: Option<&Bound<'py, PyAny>>,
    wanted_clearance: Option<f64>,
    link_radius: Option<f64>,
    velocity_limits: Option<VelocityLimits<'py>>,
    fixed: Option<&Bound<'py, PyAny>>,
    branch: Option<&Bound<'py, PyAny>>,
    margin: f64,
    swivels: Option<Integer>,
    limit_weight: Option<f64>,
    motion_weight: Option<f64>,
    swivel_weight: Option<f64>,
    clearance_weight: Option<f64>,
    manipulability_weight: Option<f64>,
    acceleration_weight: Option<f64>,
    links: Option<&Bound<'py, PyLinkGeometry>>,
    self_collision: Option<SelfCollision>,
    progress: Option<Py<PyAny>>,
    time_limit: Option<f64>,
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
    let branch = branch.map(read_branch).transpose()?;
    let default = SwivelPlanSettings::default();
    let links = links.map(|links| geometry_of(links, arm.chain())).transpose()?;
    let self_collision = SelfCollision::decided(self_collision, links.as_ref())?;
    let settings = SwivelPlanSettings {
        swivels: swivels.unwrap_or(default.swivels),
        choice,
        branch,
        margin,
        limit_weight: limit_weight.unwrap_or(default.limit_weight),
        motion_weight: motion_weight.unwrap_or(default.motion_weight),
        swivel_weight: swivel_weight.unwrap_or(default.swivel_weight),
        velocity_limits,
        scene: scene.map(|scene| scene.get().scene.clone()),
        link_radius: link_radius.unwrap_or(default.link_radius),
        links,
        self_collision,
        wanted_clearance: wanted_clearance.unwrap_or(default.wanted_clearance),
        clearance_weight: clearance_weight.unwrap_or(default.clearance_weight),
        manipulability_weight: manipulability_weight.unwrap_or(default.manipulability_weight),
        acceleration_weight: acceleration_weight.unwrap_or(default.acceleration_weight),
        cyclic,
    };
    swivel_plan(py, watched(py, progress, time_limit, |watch| plan_swivel(arm, path, &settings, watch))?)
}

/// Branch index of three signs, or of a text such as "+-+".
fn read_branch(given: &Bound<'_, PyAny>) -> PyResult<usize> {
    if let Ok(word) = given.extract::<String>() {
        let bits = word.chars().zip([4, 2, 1]).map(|(sign, bit)| match sign {
            '+' => Some(0),
            '-' => Some(bit),
            _ => None,
        });
        let index = bits.sum::<Option<usize>>().filter(|_| word.chars().count() == 3);
        return index.ok_or_else(|| {
            let message =
                format!("branch is '{word}', it must be three signs of shoulder, elbow, wrist such as '+-+'");
            to_py(Error::Invalid(message))
        });
    }
    let signs: [i8; 3] = given.extract().map_err(|_| {
        let given = given.repr().map_or_else(|_| "?".into(), |text| text.to_string());
        let message = format!("branch is {given}, it must be three signs such as (1, -1, 1) or '+-+'");
        to_py(Error::Invalid(message))
    })?;
    if signs.iter().any(|s| s.abs() != 1) {
        return Err(to_py(Error::Invalid(format!("branch is {signs:?}, its signs must be 1 or -1"))));
    }
    Ok(signs.iter().zip([4, 2, 1]).map(|(s, bit)| if *s < 0 { bit } else { 0 }).sum())
}

/// The swivel from a dynamical system, one step at a time, beside obstacles.
///
/// `"paper"` and `"paper_u"` are Moore & Oztop's eqs (30) to (32) as printed, on s and on u. `"robust"` takes the
/// sine of the error, the analytic gradient of the distance, forces away from singularities and limits, a rate limit
/// and a barrier that takes the obstacles' own motion into account. All of them decide locally and can be trapped;
/// `plan_swivel` considers the whole path.
///
/// Args:
///     arm: The arm.
///     desired: Desired swivel, rad: a number, `(N,)` with one per path point, or a callable of the time.
///     scene: Obstacles.
///     form: `"robust"`, `"paper"`, `"paper_u"`.
///     link_radius: Links are capsules of this radius, m (0.05), if no `links` are given.
///     links: Shapes of the links, and the pairs that must not touch.
///     self_collision: Whether links must not touch each other; `"auto"`: if `links` has pairs.
///     branch: Signs (shoulder, elbow, wrist), (1, -1, 1) or "+-+"; default "+++".
///     tau: Time constant, s (0.1).
///     lambda_: Paper: share of the desired swivel (0.5).
///     gain: Paper: k of the force k/|d| (0.02).
///     epsilon: Paper: half the difference step, rad (0.001).
///     weights: Robust: shares of desired swivel, obstacles, singularities, limits (0.4, 0.4, 0.05, 0.15).
///     max_rate: Robust: rad/s (3).
///     safe_distance: Robust: distance that is kept, m (0.02).
///     active_distance: Robust: where the obstacle's force begins, m (0.1).
///     barrier_rate: Robust: bound of the rate at which the distance may shrink, 1/s (5).
#[pyclass(name = "SwivelFlow", module = "redundancy", frozen)]
pub struct PySwivelFlow {
    flow: SwivelFlow,
    arm: Py<PySrsArm>,
    desired: Py<PyAny>,
    scene: Py<PyScene>,
    links: Option<Py<PyLinkGeometry>>,
}

#[pymethods]
impl PySwivelFlow {
    #[new]
    #[pyo3(signature = (arm, desired, scene=None, form="robust", link_radius=None, *, branch=None, tau=None,
        lambda_=None, gain=None, epsilon=None, weights=None, max_rate=None, safe_distance=None, active_distance=None,
        barrier_rate=None, links=None, self_collision=None),
        text_signature = "(arm, desired, scene=None, form='robust', link_radius=None, *, branch=None, tau=None, \
            lambda_=None, gain=None, epsilon=None, weights=None, max_rate=None, safe_distance=None, \
            active_distance=None, barrier_rate=None, links=None, self_collision='auto')")]
    fn new(
        arm: Given<'_, PySrsArm>,
        desired: &Bound<'_, PyAny>,
        scene: Option<Given<'_, PyScene>>,
        form: &str,
        link_radius: Option<f64>,
        branch: Option<&Bound<'_, PyAny>>,
        tau: Option<f64>,
        lambda_: Option<f64>,
        gain: Option<f64>,
        epsilon: Option<f64>,
        weights: Option<[f64; 4]>,
        max_rate: Option<f64>,
        safe_distance: Option<f64>,
        active_distance: Option<f64>,
        barrier_rate: Option<f64>,
        links: Option<&Bound<'_, PyLinkGeometry>>,
        self_collision: Option<SelfCollision>,
    ) -> PyResult<Self> {
        let py = arm.py();
        let shapes = links.map(|links| geometry_of(links, arm.get().arm.chain())).transpose()?;
        let self_collision = SelfCollision::decided(self_collision, shapes.as_ref())?;
        let default = SwivelFlowSettings::default();
        let settings = SwivelFlowSettings {
            form: FlowForm::from_name(form).map_err(to_py)?,
            link_radius: link_radius.unwrap_or(default.link_radius),
            links: shapes,
            self_collision,
            tau: tau.unwrap_or(default.tau),
            lambda: lambda_.unwrap_or(default.lambda),
            gain: gain.unwrap_or(default.gain),
            epsilon: epsilon.unwrap_or(default.epsilon),
            weights: weights.unwrap_or(default.weights),
            max_rate: max_rate.unwrap_or(default.max_rate),
            safe_distance: safe_distance.unwrap_or(default.safe_distance),
            active_distance: active_distance.unwrap_or(default.active_distance),
            barrier_rate: barrier_rate.unwrap_or(default.barrier_rate),
            branch: branch.map(read_branch).transpose()?.unwrap_or(default.branch),
        };
        let scene = match scene {
            Some(scene) => scene.clone(),
            None => Bound::new(py, PyScene { scene: Scene::new(&[]).map_err(to_py)? })?,
        };
        if !desired.is_callable() {
            read_angles(desired, "desired")?;
        }
        let flow = SwivelFlow::new(&arm.get().arm, &scene.get().scene, settings).map_err(to_py)?;
        Ok(Self {
            flow,
            arm: arm.clone().unbind(),
            desired: desired.clone().unbind(),
            scene: scene.unbind(),
            links: links.map(|links| links.clone().unbind()),
        })
    }

    /// The swivel (rad) at `pose` and time `t`, from the swivel `s` a time `dt` before.
    ///
    /// Args:
    ///     pose: The tool pose at `t`.
    ///     s: The swivel before, rad.
    ///     dt: Time since then, s.
    ///     t: Time, for the positions of moving obstacles, s.
    ///     q: `(7,)` joints before. With them the robust form keeps the joint speed limits if some swivel within
    ///         `max_rate` allows that, as `follow` does.
    ///     rate: Rate of the swivel before, rad/s. With it the robust form smooths the new one, and beside an
    ///         obstacle reverses only for more than a small force, as `follow` does.
    ///
    /// Raises:
    ///     RedundancyError: A pose out of reach, `dt <= 0`, numbers that are not finite.
    #[pyo3(signature = (pose, s, dt, t=0.0, q=None, rate=None))]
    fn step(
        &self,
        py: Python<'_>,
        pose: &Bound<'_, PyAny>,
        s: f64,
        dt: f64,
        t: f64,
        q: Option<&Bound<'_, PyAny>>,
        rate: Option<f64>,
    ) -> PyResult<f64> {
        let before = match q {
            None => None,
            Some(q) => Some(read_vector(q, "q", Some(7))?),
        };
        let q = before.as_deref().and_then(<[f64]>::first_chunk).copied();
        let before = FlowState { q, rate };
        let wish = self.desired.bind(py);
        let wish = if wish.is_callable() {
            wish.call1((t,))?.extract::<f64>()?
        } else {
            match wish.extract::<f64>() {
                Ok(angle) => angle,
                Err(_) => {
                    let message =
                        "desired has one angle per row of a path; a step needs one angle or a callable of t";
                    return Err(to_py(Error::Invalid(message.into())));
                }
            }
        };
        Ok(self.flow.step(&read_pose(pose)?, s, wish, dt, t, &before).map_err(to_py)?.swivel)
    }

    /// Follow a path with times, one row every `dt` s.
    ///
    /// Args:
    ///     path: Tool poses with times.
    ///     s0: Swivel at the first pose, rad.
    ///     dt: Time between rows, s.
    ///     progress: Called with the share of the work done, 0 to 1.
    ///     time_limit: Seconds after which it ends with the rows so far.
    ///
    /// Returns:
    ///     Rows with `swivel` and `clearance`; `status` is `limits` if the arm left the joint limits, `infeasible` if
    ///     it ran into an obstacle or a joint was too fast, and `reason` says when and by how much. `time_limit`: the
    ///     rows so far.
    ///
    /// Raises:
    ///     RedundancyError: A path without times or orientations, a point out of reach.
    #[pyo3(signature = (path, s0, dt, *, progress=None, time_limit=None))]
    fn follow<'py>(
        &self,
        py: Python<'py>,
        path: Given<'py, PyPath>,
        s0: f64,
        dt: f64,
        progress: Option<Py<PyAny>>,
        time_limit: Option<f64>,
    ) -> PyResult<Bound<'py, PySwivelPlan>> {
        let path = &path.get().path;
        let wish = self.desired.bind(py);
        let desired = if wish.is_callable() {
            let times = SwivelFlow::times(path, dt).map_err(to_py)?;
            times.iter().map(|t| wish.call1((*t,))?.extract::<f64>()).collect::<PyResult<Vec<f64>>>()?
        } else {
            let angles = read_angles(wish, "desired")?;
            if angles.len() == path.len() && angles.len() > 1 {
                // One for each point of the path: taken at the times of the rows.
                let times = SwivelFlow::times(path, dt).map_err(to_py)?;
                path.t()
                    .map_or(angles.clone(), |t| times.iter().map(|x| interpolated(t, &angles, *x)).collect())
            } else {
                angles
            }
        };
        let follow = |watch: &Watch| self.flow.follow(path, s0, dt, &desired, watch);
        swivel_plan(py, watched(py, progress, time_limit, follow)?)
    }

    /// Which dynamical system.
    #[getter]
    fn form(&self) -> &'static str {
        self.flow.settings().form.as_str()
    }

    /// The arm.
    #[getter]
    fn arm(&self, py: Python<'_>) -> Py<PySrsArm> {
        self.arm.clone_ref(py)
    }

    /// The obstacles.
    #[getter]
    fn scene(&self, py: Python<'_>) -> Py<PyScene> {
        self.scene.clone_ref(py)
    }

    fn __repr__(&self) -> String {
        let words: Vec<&str> = self.flow.scene().obstacles().iter().map(|o| o.shape.as_str()).collect();
        format!(
            "SwivelFlow({}, form='{}', [{}])",
            self.flow.arm().chain().name(),
            self.form(),
            words.join(", ")
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let settings = self.flow.settings();
        let options = PyDict::new(py);
        options.set_item("form", self.form())?;
        options.set_item("link_radius", settings.link_radius)?;
        options.set_item("branch", signs_of(settings.branch))?;
        options.set_item("tau", settings.tau)?;
        options.set_item("lambda_", settings.lambda)?;
        options.set_item("gain", settings.gain)?;
        options.set_item("epsilon", settings.epsilon)?;
        options.set_item("weights", settings.weights)?;
        options.set_item("max_rate", settings.max_rate)?;
        options.set_item("safe_distance", settings.safe_distance)?;
        options.set_item("active_distance", settings.active_distance)?;
        options.set_item("barrier_rate", settings.barrier_rate)?;
        options.set_item("links", &self.links)?;
        options.set_item("self_collision", settings.self_collision)?;
        let class = py.get_type::<Self>();
        let make = py.import("functools")?.getattr("partial")?.call((class,), Some(&options))?;
        Ok((make, (&self.arm, &self.desired, &self.scene).into_pyobject(py)?))
    }
}

/// Linear between the samples.
fn interpolated(t: &[f64], values: &[f64], at: f64) -> f64 {
    let k = t.partition_point(|x| *x <= at).clamp(1, t.len() - 1);
    let share = ((at - t[k - 1]) / (t[k] - t[k - 1])).clamp(0.0, 1.0);
    values[k - 1] + share * (values[k] - values[k - 1])
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
