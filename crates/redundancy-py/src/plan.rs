//! Whole paths with any freedom: `ToolFreedom`, `Plan`, `plan`.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::chain::Chain;
use redundancy_core::kinematics::{SpinFreedom, ToolFreedom};
use redundancy_core::path::{BlockedPoint, Plan, PlanBuilder, Reconfiguration};
use redundancy_core::planning::{Objective, PlanSettings, plan};
use redundancy_core::{Error, Status, Watch, pose_from_row_major, pose_to_row_major};

use crate::callback::Watching;
use crate::chain::PyChain;
use crate::convert::{Given, read_array, read_rows, read_seed, read_vector, to_array};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::html;
use crate::links::{PyLinkGeometry, SelfCollision, geometry_of};
use crate::orientation_plan::SpinArgument;
use crate::path::{JOINT_COLUMNS, PyPath, PyTrajectory, joint_rows, read_arrays};
use crate::scene::PyScene;
use crate::speed::{JointLimits, read_limits};
use crate::status::status_to_py;
use crate::task::read_task;
use crate::watch::watched_aside;

/// How far the tool may tilt and spin away from the path's orientation at each point.
///
/// The tool axis stays within `half_angle` of the path's tool axis. The spin is the twist about the tool axis in the
/// swing-twist decomposition of `R_path^T R`, continuous along the path. If both are 0, the full pose is kept.
///
/// Args:
///     half_angle: Largest angle between the tool axis and the path's, rad, in `[0, pi/2)`.
///     spin: Largest spin to either side of the path's orientation, rad, or `"free"`.
///     axis: Tool axis `(3,)` in the tool frame, of any length; z when left out.
///
/// Raises:
///     RedundancyError: An angle out of its range, an axis without length.
///
/// Example:
///     >>> import numpy as np
///     >>> import redundancy as rd
///     >>> rd.ToolFreedom(half_angle=np.deg2rad(20), spin="free").spin
///     'free'
#[pyclass(name = "ToolFreedom", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyToolFreedom {
    pub freedom: ToolFreedom,
}

#[pymethods]
impl PyToolFreedom {
    #[new]
    #[pyo3(signature = (half_angle=0.0, spin=SpinArgument::Angle(0.0), axis=None),
    text_signature = "(half_angle=0.0, spin=0.0, axis=None)")]
    fn new(half_angle: f64, spin: SpinArgument, axis: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let axis = axis.map_or(Ok([0.0, 0.0, 1.0]), |axis| read_array(axis, "axis"))?;
        let spin = match spin {
            SpinArgument::Angle(angle) => SpinFreedom::Within(angle),
            SpinArgument::Word(word) if word == "free" => SpinFreedom::Free,
            SpinArgument::Word(name) => {
                return Err(to_py(Error::UnknownName { kind: "spin", name, valid: vec!["free".into()] }));
            }
        };
        Ok(Self { freedom: ToolFreedom::new(half_angle, spin, axis).map_err(to_py)? })
    }

    /// Largest angle between the tool axis and the path's, rad.
    #[getter]
    fn half_angle(&self) -> f64 {
        self.freedom.half_angle()
    }

    /// Largest spin to either side, rad, or `"free"`.
    #[getter]
    fn spin<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match self.freedom.spin() {
            SpinFreedom::Free => Ok("free".into_pyobject(py)?.into_any()),
            SpinFreedom::Within(angle) => Ok(angle.into_pyobject(py)?.into_any()),
        }
    }

    /// The tool axis in the tool frame, a unit vector.
    #[getter]
    fn axis(&self) -> [f64; 3] {
        let axis = self.freedom.axis();
        [axis.x, axis.y, axis.z]
    }

    fn __repr__(&self) -> String {
        let spin = match self.freedom.spin() {
            SpinFreedom::Free => "'free'".to_owned(),
            SpinFreedom::Within(angle) => angle.to_string(),
        };
        format!("ToolFreedom(half_angle={}, spin={spin}, axis={:?})", self.half_angle(), self.axis())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let parts = (self.half_angle(), self.spin(py)?, self.axis());
        Ok((py.get_type::<Self>().into_any(), parts.into_pyobject(py)?))
    }
}

/// A motion along a path with status and reason: the result of every planner and every step-by-step scheme.
///
/// A `Trajectory` that also holds, for each row, how the freedom is used. A column that the scheme does not compute
/// is `None`.
///
/// Example:
///     >>> import numpy as np, redundancy as rd
///     >>> arm = rd.SrsArm(rd.catalog.load("pa10"))
///     >>> plan = rd.plan_swivel(arm, rd.paths.circle([0.45, 0, 0.5], 0.12, orientation=np.diag([1, -1, -1]), n=50))
///     >>> str(plan.status), plan.legal, len(plan.spare["swivel"])
///     ('converged', True, 50)
#[pyclass(name = "Plan", module = "redundancy", frozen, subclass, extends = PyTrajectory)]
pub struct PyPlan {
    pub plan: Plan,
    /// The arm that was planned for, where it is known.
    arm: Option<Chain>,
}

#[pymethods]
impl PyPlan {
    /// Times for the rows of the plan: as fast as every limit allows, from rest to rest.
    ///
    /// Args:
    ///     chain: the arm; a plan that comes straight from `rd.plan` knows it, one from a file or another planner does
    ///         not.
    ///     **options: the keyword arguments of `rd.retime`.
    ///
    /// Returns:
    ///     What `rd.retime(chain, plan, **options)` returns.
    ///
    /// Raises:
    ///     ValueError: an unknown arm, a plan with fewer than two rows, and what `rd.retime` raises.
    ///
    /// Example:
    ///     >>> move = plan.retime(jerk_limits=500.0)  # doctest: +SKIP
    #[pyo3(signature = (chain=None, **options))]
    fn retime<'py>(
        slf: &Bound<'py, Self>,
        chain: Option<Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = slf.py();
        let chain = match (chain, &slf.get().arm) {
            (Some(chain), _) => chain,
            (None, Some(arm)) => Bound::new(py, PyChain::from(arm.clone()))?.into_any(),
            (None, None) => {
                let message = "this plan does not know its arm: give retime the chain";
                return Err(to_py(Error::Invalid(message.into())));
            }
        };
        py.import("redundancy._core")?.getattr("retime")?.call((chain, slf), options)
    }

    /// Outcome: `converged` (continuous, legal, a local optimum), or why not.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.plan.status())
    }

    /// Why it is not `converged`; empty when it is.
    #[getter]
    fn reason(&self) -> &str {
        self.plan.reason()
    }

    /// Whether limits, task, clearance and continuity hold on the verification grid, independent of the status.
    #[getter]
    fn legal(&self) -> Option<bool> {
        self.plan.legal()
    }

    /// True if the status is exact, False if it is the outcome of a finite search.
    ///
    /// `converged` means that the motion was verified, not that there is no cheaper one.
    #[getter]
    fn proven(&self) -> bool {
        self.plan.proven()
    }

    /// The minimised cost, summed over the path, without a unit.
    #[getter]
    fn cost(&self) -> Option<f64> {
        self.plan.cost()
    }

    /// Rows before which the arm must change its configuration; none when `converged`.
    #[getter]
    fn reconfigurations(&self) -> Vec<usize> {
        self.plan.reconfigurations().iter().map(|change| change.row).collect()
    }

    /// Why each of them is needed.
    #[getter]
    fn reconfiguration_reasons(&self) -> Vec<&str> {
        self.plan.reconfigurations().iter().map(|change| change.reason.as_str()).collect()
    }

    /// Points of the path without any configuration.
    #[getter]
    fn blocked(&self) -> Vec<usize> {
        self.plan.blocked().iter().map(|point| point.row).collect()
    }

    /// Why each of them is blocked.
    #[getter]
    fn blocked_reasons(&self) -> Vec<String> {
        self.plan.blocked().iter().map(|point| point.reason.clone()).collect()
    }

    /// Arc length `(N,)` of each row, m.
    #[getter]
    fn s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.s().map(|s| PyArray1::from_slice(py, s))
    }

    /// Tool poses `(N, 4, 4)`.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(poses) = self.plan.poses() else { return Ok(None) };
        let flat: Vec<f64> = poses.iter().flat_map(pose_to_row_major).collect();
        Ok(Some(to_array(py, &flat, [poses.len(), 4, 4])?.into_any()))
    }

    /// Rotation vector `(N, 2)` of the swing across the tool axis, rad.
    #[getter]
    fn tilt<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.plan.tilt().map(|tilt| to_array(py, tilt.as_flattened(), [tilt.len(), 2])).transpose()
    }

    /// Twist `(N,)` about the tool axis against the path's orientation, rad, continuous.
    #[getter]
    fn spin<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.spin().map(|spin| PyArray1::from_slice(py, spin))
    }

    /// Smallest distance `(N,)` to a joint position limit, rad or m; `inf` where no joint has one.
    #[getter]
    fn margin<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.margin().map(|margin| PyArray1::from_slice(py, margin))
    }

    /// Distance `(N,)` from the obstacles, m.
    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.clearance().map(|clearance| PyArray1::from_slice(py, clearance))
    }

    /// Distance `(N,)` between links of the arm, m.
    #[getter]
    fn self_clearance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.self_clearance().map(|clearance| PyArray1::from_slice(py, clearance))
    }

    /// Part of the cost `(N,)` of each row.
    #[getter]
    fn row_cost<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.row_cost().map(|cost| PyArray1::from_slice(py, cost))
    }

    /// The piece `(N,)` of the solutions of each row, an index of `piece_labels`.
    #[getter]
    fn piece<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<i64>>> {
        self.plan.pieces().map(|pieces| PyArray1::from_iter(py, pieces.index.iter().map(|i| *i as i64)))
    }

    /// Names of the pieces.
    #[getter]
    fn piece_labels(&self) -> Vec<String> {
        self.plan.pieces().map_or_else(Vec::new, |pieces| pieces.labels.clone())
    }

    /// The spare coordinates that have names: values `(N,)`, rad or m.
    #[getter]
    fn spare<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for spare in self.plan.spare() {
            out.set_item(&spare.name, PyArray1::from_slice(py, &spare.values))?;
        }
        Ok(out)
    }

    /// Writes an npz file with everything in it.
    fn to_npz(this: &Bound<'_, Self>, path: PathBuf) -> PyResult<()> {
        let arrays = Self::everything(this)?;
        this.py().import("numpy")?.getattr("savez_compressed")?.call((path,), Some(&arrays))?;
        Ok(())
    }

    /// Read what `to_npz` wrote.
    ///
    /// Args:
    ///     path: The file.
    ///
    /// Raises:
    ///     RedundancyError: A file that cannot be read or holds no plan.
    #[staticmethod]
    fn from_npz(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, Self>> {
        let broken = |error: PyErr| {
            let (file, message) = (path.display().to_string(), error.to_string());
            to_py(Error::File { file, message })
        };
        let file = py.import("numpy")?.getattr("load")?.call1((&path,)).map_err(broken)?;
        let result = Self::_from_arrays(&file).map_err(broken);
        file.call_method0("close")?;
        result
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_arrays<'py>(arrays: &Bound<'py, PyAny>) -> PyResult<Bound<'py, Self>> {
        wrapped(arrays.py(), plan_of(arrays)?)
    }

    pub fn __repr__(&self) -> String {
        let plan = &self.plan;
        let reason = if plan.reason().is_empty() { String::new() } else { format!(": {}", plan.reason()) };
        let cost = plan.cost().map_or(String::new(), |cost| format!(", cost {cost:.6}"));
        format!("Plan({} rows, {}{cost}{reason})", plan.rows(), plan.status())
    }

    /// For notebooks: the verdict with its numbers, then the joints as of a trajectory.
    fn _repr_html_(this: &Bound<'_, Self>) -> PyResult<String> {
        let plan = &this.get().plan;
        let word =
            |legal: Option<bool>| legal.map_or("not checked", |legal| if legal { "yes" } else { "no" });
        let least = |values: &[f64]| values.iter().copied().reduce(f64::min);
        let numbers = [
            ("cost", plan.cost()),
            ("least distance to a joint limit, rad or m", plan.margin().and_then(least)),
            ("least distance from obstacles, m", plan.clearance().and_then(least)),
            ("least distance between links, m", plan.self_clearance().and_then(least)),
        ];
        let mut rows = vec![html::entry("status", plan.status()), html::entry("reason", plan.reason())];
        rows.push(html::entry("legal", word(plan.legal())));
        rows.push(html::entry("proven", word(Some(plan.proven()))));
        let known =
            |(name, value): (&str, Option<f64>)| value.map(|value| html::entry(name, format!("{value:.6}")));
        rows.extend(numbers.into_iter().filter_map(known));
        rows.push(html::entry("reconfigurations", plan.reconfigurations().len()));
        rows.push(html::entry("blocked points", plan.blocked().len()));
        let verdict = html::table(&this.repr()?.to_string(), &[], &rows);
        let joints = html::table("joints", &JOINT_COLUMNS, &joint_rows(plan.trajectory()));
        Ok(verdict + &joints)
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().plan == self.plan)
    }

    fn __ne__(&self, other: &Bound<'_, PyAny>) -> bool {
        !self.__eq__(other)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        let make = this.get_type().getattr("_from_arrays")?;
        Ok((make, (Self::everything(this)?,)))
    }
}

impl PyPlan {
    /// Everything as named arrays.
    pub fn everything<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let (py, plan) = (this.py(), &this.get().plan);
        let arrays = this.as_super().get().arrays(py)?;
        let numpy = py.import("numpy")?;
        let strings = |words: Vec<&str>| numpy.getattr("array")?.call1((words, pyo3::intern!(py, "U")));
        let truth = |value: bool| if value { "true" } else { "false" };
        let legal = plan.legal().map_or("unknown", truth);
        let verdict = vec![plan.status().as_str(), plan.reason(), legal, truth(plan.proven())];
        arrays.set_item("verdict", strings(verdict)?)?;
        let integers = |rows: Vec<usize>| PyArray1::from_iter(py, rows.into_iter().map(|row| row as i64));
        let changes = plan.reconfigurations();
        arrays.set_item("reconfiguration_row", integers(changes.iter().map(|c| c.row).collect()))?;
        let why = changes.iter().map(|c| c.reason.as_str()).collect();
        arrays.set_item("reconfiguration_reason", strings(why)?)?;
        let blocked = plan.blocked();
        arrays.set_item("blocked_row", integers(blocked.iter().map(|b| b.row).collect()))?;
        arrays.set_item("blocked_status", strings(blocked.iter().map(|b| b.status.as_str()).collect())?)?;
        arrays.set_item("blocked_reason", strings(blocked.iter().map(|b| b.reason.as_str()).collect())?)?;
        if let Some(cost) = plan.cost() {
            arrays.set_item("cost", PyArray1::from_slice(py, &[cost]))?;
        }
        let columns = [
            ("s", plan.s()),
            ("spin", plan.spin()),
            ("margin", plan.margin()),
            ("clearance", plan.clearance()),
            ("self_clearance", plan.self_clearance()),
            ("row_cost", plan.row_cost()),
        ];
        for (name, values) in columns {
            if let Some(values) = values {
                arrays.set_item(name, PyArray1::from_slice(py, values))?;
            }
        }
        if let Some(tilt) = this.get().tilt(py)? {
            arrays.set_item("tilt", tilt)?;
        }
        if let Some(poses) = this.get().poses(py)? {
            arrays.set_item("poses", poses)?;
        }
        if let Some(pieces) = plan.pieces() {
            arrays.set_item("piece", integers(pieces.index.clone()))?;
            arrays.set_item("piece_labels", strings(pieces.labels.iter().map(String::as_str).collect())?)?;
        }
        let names: Vec<&str> = plan.spare().iter().map(|spare| spare.name.as_str()).collect();
        arrays.set_item("spare_names", strings(names)?)?;
        for spare in plan.spare() {
            arrays.set_item(format!("spare_{}", spare.name), PyArray1::from_slice(py, &spare.values))?;
        }
        Ok(arrays)
    }
}

/// A plan, ready for what extends it.
pub fn plan_initializer(plan: Plan) -> PyClassInitializer<PyPlan> {
    let base = PyClassInitializer::from(PyTrajectory::from(plan.trajectory().clone()));
    base.add_subclass(PyPlan { plan, arm: None })
}

/// A plan as a Python object.
pub fn wrapped(py: Python<'_>, plan: Plan) -> PyResult<Bound<'_, PyPlan>> {
    Bound::new(py, plan_initializer(plan))
}

/// The plan of what [`PyPlan::everything`] gives.
pub fn plan_of(arrays: &Bound<'_, PyAny>) -> PyResult<Plan> {
    let trajectory = read_arrays(arrays)?.trajectory;
    let words: Vec<String> = arrays.get_item("verdict")?.call_method0("tolist")?.extract()?;
    let invalid = || to_py(Error::Invalid("these are not the parts of a plan".into()));
    let [word, reason, legal, proven] = words.as_slice() else { return Err(invalid()) };
    let status =
        |word: &str| Status::ALL.into_iter().find(|status| status.as_str() == word).ok_or_else(invalid);
    let mut builder = PlanBuilder::new(trajectory, status(word)?).reason(reason.clone());
    if legal != "unknown" {
        builder = builder.legal(legal == "true");
    }
    builder = builder.proven(proven == "true");
    let list = |name: &str| arrays.get_item(name)?.call_method0("tolist");
    let (rows, why): (Vec<usize>, Vec<String>) =
        (list("reconfiguration_row")?.extract()?, list("reconfiguration_reason")?.extract()?);
    let changes = rows.into_iter().zip(why).map(|(row, reason)| Reconfiguration { row, reason });
    builder = builder.reconfigurations(changes.collect());
    let (rows, kinds): (Vec<usize>, Vec<String>) =
        (list("blocked_row")?.extract()?, list("blocked_status")?.extract()?);
    let why: Vec<String> = list("blocked_reason")?.extract()?;
    let mut blocked = Vec::new();
    for ((row, kind), reason) in rows.into_iter().zip(kinds).zip(why) {
        blocked.push(BlockedPoint { row, status: status(&kind)?, reason });
    }
    builder = builder.blocked(blocked);
    let known = |name: &str| arrays.contains(name);
    let column = |name: &str| read_vector(&arrays.get_item(name)?, name, None);
    if known("cost")? {
        builder = builder.cost(column("cost")?.first().copied().ok_or_else(invalid)?);
    }
    let setters: [(&str, fn(PlanBuilder, Vec<f64>) -> PlanBuilder); 6] = [
        ("s", PlanBuilder::s),
        ("spin", PlanBuilder::spin),
        ("margin", PlanBuilder::margin),
        ("clearance", PlanBuilder::clearance),
        ("self_clearance", PlanBuilder::self_clearance),
        ("row_cost", PlanBuilder::row_cost),
    ];
    for (name, set) in setters {
        if known(name)? {
            builder = set(builder, column(name)?);
        }
    }
    if known("tilt")? {
        let rows = arrays.get_item("tilt")?;
        let tilt = read_rows(&rows, "tilt", &[2])?.as_slice()?.as_chunks::<2>().0.to_vec();
        builder = builder.tilt(tilt);
    }
    if known("poses")? {
        let rows = arrays.get_item("poses")?;
        let rows = read_rows(&rows, "poses", &[4, 4])?;
        let poses = rows.as_slice()?.chunks_exact(16).map(pose_from_row_major);
        builder = builder.poses(poses.collect::<Result<_, _>>().map_err(to_py)?);
    }
    if known("piece")? {
        builder = builder.pieces(list("piece")?.extract()?, list("piece_labels")?.extract()?);
    }
    for name in list("spare_names")?.extract::<Vec<String>>()? {
        let values = column(&format!("spare_{name}"))?;
        builder = builder.spare(name, values);
    }
    builder.build().map_err(to_py)
}

/// A chain, or an arm object that has one.
pub fn read_chain<'py>(object: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyChain>> {
    if let Ok(chain) = object.cast::<PyChain>() {
        return Ok(chain.clone());
    }
    let chain = object.getattr_opt(pyo3::intern!(object.py(), "chain"))?;
    chain.and_then(|chain| chain.cast_into::<PyChain>().ok()).ok_or_else(|| {
        let kind = object.get_type();
        to_py(Error::Invalid(format!("chain is a {kind}, expected a Chain or an arm object")))
    })
}

/// Plan a whole path: which configuration to use at every point, for any arm and any freedom of the tool.
///
/// Minimises `sum_k D_k (limit_weight L(q_k) + clearance_weight C(q_k) + criterion) + motion_weight sum_k |W dq_k|^2
/// / D_k` over all rows at once, with `D` the share of the path (of its time, if it has times), and with the terms
/// `L` of the joint limits and `C` of the clearance as in docs/planning.md.
///
///     plan = rd.plan(rd.catalog.load("panda"), path)
///     plan = rd.plan(gun, path, rd.ToolFreedom(np.deg2rad(20), "free"), tool_speed=0.2)
///
/// Args:
///     chain: The arm, of `n` joints.
///     path: Poses or positions to follow, one row of the plan for each.
///     freedom: How far the tool may tilt and spin; `None` for the full pose (for the position, on a path of
///         positions).
///     task: Which coordinates count, by name or as a `Task`, instead of a freedom. `"pose"` is the default on a path
///         with orientations and may be given with a freedom, which then says how far the tool may leave that pose.
///     scene: Obstacles; contact is forbidden, between the rows too. Moving obstacles are at their positions at the
///         times of the path.
///     links: Shapes of the links, and the pairs that must not touch; without it links are capsules from joint to
///         joint.
///     self_collision: Whether links must not touch each other. `"auto"`: if `links` has pairs. `True` without
///         `links`: the pairs of joint-to-joint capsules that are found by sampling.
///     cyclic: The arm ends in the configuration in which it began, windings included; the path must be closed.
///     q_start: Configuration `(n,)` at the first point.
///     q_end: Configuration `(n,)` at the last point.
///     objective: `"motion"`, `"length"` (of the joint motion), or `"peak_speed"` (the largest joint speed times
///         `speed_weights`, then the motion; needs times).
///     motion_weight: Weight of the joint motion. Default 0.5.
///     limit_weight: Weight of the distance from the joint limits. Default 1.
///     clearance_weight: Weight of the shortfall from the wanted distance, `sum max(0, 1 - d / wanted)^2` over links
///         and obstacles. Default 10 000.
///     wanted_clearance: Wanted distance from the obstacles, m; distances that the freedom cannot change do not
///         count.
///     link_radius: Radius of the capsules if no `links` are given, m. Default 0.05.
///     criterion: Minimised or maximised along the path, according to its sense.
///     criterion_weight: Its weight.
///     joint_weights: Weight `(n,)` of each joint in the motion. Default 1 (1 m counts as 1 rad).
///     tool_speed: Constant speed of the tool, m/s, instead of the path's times.
///     velocity_limits: Largest joint speeds `(n,)`, rad/s or m/s; they bound the steps if there are times. `"chain"`
///         for those of the chain, `None` for off. No joint turns by more than an eighth of a turn between rows.
///     speed_weights: Weight `(n,)` of each joint in the peak speed. Default one over its limit.
///     margin: Distance kept from every joint position limit, rad or m.
///     time_limit: Seconds after which the best plan so far is returned, with status `time_limit`.
///     seed: Seed of the random postures; the same seed gives the same plan.
///     threads: Threads to use; all cores by default.
///     progress: Called with the share of the work that is done. Ctrl-C returns the best so far.
///
/// Returns:
///     The plan, with `status` and `reason`.
///
/// Raises:
///     RedundancyError: Values out of their range, a freedom that does not apply, ends that are not on the path or
///         break
///         limits, a closed plan of an open path.
#[pyfunction(name = "plan")]
#[pyo3(signature = (chain, path, freedom=None, *, task=None, scene=None, links=None, self_collision=None, cyclic=false, q_start=None, q_end=None,
    objective="motion", motion_weight=None, limit_weight=None, clearance_weight=None, wanted_clearance=None, link_radius=None,
    criterion=None, criterion_weight=1.0, joint_weights=None, tool_speed=None, velocity_limits=Some(JointLimits::Word("chain".into())),
    speed_weights=None, margin=0.0, time_limit=10.0, seed=0, threads=None, progress=None),
    text_signature = "(chain, path, freedom=None, *, task=None, scene=None, links=None, self_collision='auto', \
    cyclic=False, q_start=None, q_end=None, objective=\"motion\", motion_weight=0.5, limit_weight=1.0, \
    clearance_weight=10000.0, wanted_clearance=0.03, link_radius=0.05, criterion=None, criterion_weight=1.0, \
    joint_weights=None, tool_speed=None, velocity_limits=\"chain\", speed_weights=None, margin=0.0, \
    time_limit=10.0, seed=0, threads=None, progress=None)")]
pub fn py_plan<'py>(
    py: Python<'py>,
    chain: &Bound<'py, PyAny>,
    path: Given<'py, PyPath>,
    freedom: Option<&Bound<'py, PyToolFreedom>>,
    task: Option<&Bound<'py, PyAny>>,
    scene: Option<Given<'py, PyScene>>,
    links: Option<&Bound<'py, PyLinkGeometry>>,
    self_collision: Option<SelfCollision>,
    cyclic: bool,
    q_start: Option<&Bound<'py, PyAny>>,
    q_end: Option<&Bound<'py, PyAny>>,
    objective: &str,
    motion_weight: Option<f64>,
    limit_weight: Option<f64>,
    clearance_weight: Option<f64>,
    wanted_clearance: Option<f64>,
    link_radius: Option<f64>,
    criterion: Option<Given<'py, PyCriterion>>,
    criterion_weight: f64,
    joint_weights: Option<&Bound<'py, PyAny>>,
    tool_speed: Option<f64>,
    velocity_limits: Option<JointLimits<'py>>,
    speed_weights: Option<&Bound<'py, PyAny>>,
    margin: f64,
    time_limit: f64,
    #[pyo3(from_py_with = read_seed)] seed: u64,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyPlan>> {
    let chain = read_chain(chain)?;
    let (chain, path) = (&chain.get().chain, &path.get().path);
    let vector = |object: Option<&Bound<'py, PyAny>>, what: &str| {
        object.map(|values| read_vector(values, what, Some(chain.dof()))).transpose()
    };
    let links = links.map(|links| geometry_of(links, chain)).transpose()?;
    let self_collision = SelfCollision::decided(self_collision, links.as_ref())?;
    let default = PlanSettings::default();
    let watching = Watching::criterion(criterion.as_ref().map(|criterion| criterion.get()));
    let settings = PlanSettings {
        freedom: freedom.map_or(ToolFreedom::NONE, |freedom| freedom.get().freedom),
        task: task.map(read_task).transpose()?,
        objective: Objective::from_name(objective).map_err(to_py)?,
        motion_weight: motion_weight.unwrap_or(default.motion_weight),
        limit_weight: limit_weight.unwrap_or(default.limit_weight),
        criterion: criterion.map(|criterion| criterion.get().criterion.clone()),
        criterion_weight,
        scene: scene.map(|scene| scene.get().scene.clone()),
        links,
        link_radius: link_radius.unwrap_or(default.link_radius),
        self_collision,
        wanted_clearance: wanted_clearance.unwrap_or(default.wanted_clearance),
        clearance_weight: clearance_weight.unwrap_or(default.clearance_weight),
        joint_weights: vector(joint_weights, "joint_weights")?,
        tool_speed,
        velocity_limits: read_limits(
            velocity_limits,
            "velocity_limits",
            chain.joints().iter().map(|j| j.limits.velocity),
        )?,
        speed_weights: vector(speed_weights, "speed_weights")?,
        margin,
        cyclic,
        q_start: vector(q_start, "q_start")?,
        q_end: vector(q_end, "q_end")?,
        time_limit,
        seed,
    };
    let pool = crate::batch::pool(threads)?;
    let watch = Watch::default().with_time_limit(time_limit).map_err(to_py)?;
    let mut reported = None;
    let report = |py: Python<'_>| {
        watching.check(py)?;
        let share = Some(watch.share()).filter(|share| reported != Some(*share));
        reported = share.or(reported);
        match progress.as_ref().zip(share) {
            Some((call, share)) => call.call1(py, (share,)).map(drop),
            None => Ok(()),
        }
    };
    let done = watched_aside(py, &watch, &pool, report, || plan(chain, path, &settings, &watch));
    watching.check(py)?;
    let plan = done?;
    let base = PyClassInitializer::from(PyTrajectory::from(plan.trajectory().clone()));
    Bound::new(py, base.add_subclass(PyPlan { plan, arm: Some(chain.clone()) }))
}
