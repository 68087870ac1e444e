//! `Plan`: the one result along a path.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::path::{BlockedPoint, Pieces, Plan, PlanBuilder, Reconfiguration, Trajectory};
use redundancy_core::{Error, Pose, Status, pose_from_row_major, pose_to_row_major};

use crate::convert::to_array;
use crate::error::to_py;
use crate::path::{PyTrajectory, file_error, read_npz, strings};
use crate::status::status_to_py;

/// A trajectory along a path, with its verdict.
#[pyclass(name = "Plan", module = "redundancy", frozen, subclass, extends = PyTrajectory)]
pub struct PyPlan {
    pub plan: Plan,
}

impl PyPlan {
    /// A plan, ready for what extends it.
    pub fn initializer(plan: Plan) -> PyClassInitializer<Self> {
        let base = PyClassInitializer::from(PyTrajectory::from(plan.trajectory().clone()));
        base.add_subclass(Self { plan })
    }

    /// The arrays and words that make a plan again, beside those of its trajectory.
    pub fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (plan, columns) = (&self.plan, PyDict::new(py));
        let (changes, blocked) = (plan.reconfigurations(), plan.blocked());
        let integers = |rows: Vec<usize>| PyArray1::from_iter(py, rows.into_iter().map(|row| row as i64));
        columns.set_item("status", strings(py, &[plan.status().as_str()])?)?;
        columns.set_item("reason", strings(py, &[plan.reason()])?)?;
        columns.set_item("proven", PyArray1::from_slice(py, &[plan.proven()]))?;
        columns.set_item("legal", PyArray1::from_iter(py, plan.legal()))?;
        columns.set_item("cost", PyArray1::from_iter(py, plan.cost()))?;
        columns.set_item("reconfiguration_row", integers(self.reconfigurations()))?;
        columns.set_item(
            "reconfiguration_reason",
            strings(py, &changes.iter().map(|change| change.reason.as_str()).collect::<Vec<_>>())?,
        )?;
        columns.set_item("blocked_row", integers(self.blocked()))?;
        columns.set_item(
            "blocked_status",
            strings(py, &blocked.iter().map(|point| point.status.as_str()).collect::<Vec<_>>())?,
        )?;
        columns.set_item(
            "blocked_reason",
            strings(py, &blocked.iter().map(|point| point.reason.as_str()).collect::<Vec<_>>())?,
        )?;
        let known: [(&str, Option<Bound<'py, PyAny>>); 9] = [
            ("s", self.s(py).map(Bound::into_any)),
            ("poses", self.poses(py)?),
            ("tilt", self.tilt(py)?),
            ("spin", self.spin(py).map(Bound::into_any)),
            ("piece", self.piece(py).map(Bound::into_any)),
            ("margin", self.margin(py).map(Bound::into_any)),
            ("clearance", self.clearance(py).map(Bound::into_any)),
            ("self_clearance", self.self_clearance(py).map(Bound::into_any)),
            ("row_cost", self.row_cost(py).map(Bound::into_any)),
        ];
        for (name, values) in known {
            if let Some(values) = values {
                columns.set_item(name, values)?;
            }
        }
        columns.set_item("piece_labels", strings(py, &self.piece_labels())?)?;
        let names: Vec<&str> = plan.spare().iter().map(|spare| spare.name.as_str()).collect();
        let values: Vec<f64> = plan.spare().iter().flat_map(|spare| spare.values.iter().copied()).collect();
        columns.set_item("spare_names", strings(py, &names)?)?;
        columns.set_item("spare", to_array(py, &values, [names.len(), plan.rows()])?)?;
        Ok(columns)
    }
}

#[pymethods]
impl PyPlan {
    /// What the planner did.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.plan.status())
    }

    /// Why it is not `converged`, or of how many starts it is the best.
    #[getter]
    fn reason(&self) -> &str {
        self.plan.reason()
    }

    /// Whether limits, task, contact and continuity hold, whatever the status; `None` where that was not checked.
    #[getter]
    fn legal(&self) -> Option<bool> {
        self.plan.legal()
    }

    /// Whether the status is exact; else it is that of the best of a finite search.
    #[getter]
    fn proven(&self) -> bool {
        self.plan.proven()
    }

    /// What was minimised, summed over the path; `None` without a cost.
    #[getter]
    fn cost(&self) -> Option<f64> {
        self.plan.cost()
    }

    /// Rows before which the arm must change its configuration.
    #[getter]
    fn reconfigurations(&self) -> Vec<usize> {
        self.plan.reconfigurations().iter().map(|change| change.row).collect()
    }

    /// Why, for each of them.
    #[getter]
    fn reconfiguration_reasons(&self) -> Vec<&str> {
        self.plan.reconfigurations().iter().map(|change| change.reason.as_str()).collect()
    }

    /// Points without any configuration.
    #[getter]
    fn blocked(&self) -> Vec<usize> {
        self.plan.blocked().iter().map(|point| point.row).collect()
    }

    /// What is in the way, for each of them.
    #[getter]
    fn blocked_reasons(&self) -> Vec<&str> {
        self.plan.blocked().iter().map(|point| point.reason.as_str()).collect()
    }

    /// Arc lengths.
    #[getter]
    fn s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.s().map(|s| PyArray1::from_slice(py, s))
    }

    /// Tool poses.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(poses) = self.plan.poses() else { return Ok(None) };
        let flat: Vec<f64> = poses.iter().flat_map(pose_to_row_major).collect();
        Ok(Some(to_array(py, &flat, [poses.len(), 4, 4])?.into_any()))
    }

    /// Tilt as a rotation vector across the path's tool axis.
    #[getter]
    fn tilt<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(tilt) = self.plan.tilt() else { return Ok(None) };
        Ok(Some(to_array(py, tilt.as_flattened(), [tilt.len(), 2])?.into_any()))
    }

    /// Twist about the tool axis.
    #[getter]
    fn spin<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.spin().map(|spin| PyArray1::from_slice(py, spin))
    }

    /// Named spare coordinates.
    #[getter]
    fn spare<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let named = PyDict::new(py);
        for spare in self.plan.spare() {
            named.set_item(&spare.name, PyArray1::from_slice(py, &spare.values))?;
        }
        Ok(named)
    }

    /// The piece of the solutions of each row, an index of `piece_labels`.
    #[getter]
    fn piece<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<i64>>> {
        let pieces = self.plan.pieces()?;
        Some(PyArray1::from_iter(py, pieces.index.iter().map(|piece| *piece as i64)))
    }

    /// The names of the pieces.
    #[getter]
    fn piece_labels(&self) -> Vec<&str> {
        self.plan.pieces().map_or(Vec::new(), |pieces| pieces.labels.iter().map(String::as_str).collect())
    }

    /// Smallest distance to a joint position limit.
    #[getter]
    fn margin<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.margin().map(|margin| PyArray1::from_slice(py, margin))
    }

    /// Distance from the obstacles; `None` without a scene.
    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.clearance().map(|clearance| PyArray1::from_slice(py, clearance))
    }

    /// Distance between links of the arm.
    #[getter]
    fn self_clearance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.self_clearance().map(|clearance| PyArray1::from_slice(py, clearance))
    }

    /// Part of the cost of each row.
    #[getter]
    fn row_cost<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.plan.row_cost().map(|cost| PyArray1::from_slice(py, cost))
    }

    /// Writes an npz file.
    fn to_npz(this: &Bound<'_, Self>, path: PathBuf) -> PyResult<()> {
        let (py, columns) = (this.py(), this.get().columns(this.py())?);
        columns.update(this.as_super().get().arrays(py)?.as_mapping())?;
        py.import("numpy")?.getattr("savez_compressed")?.call((path,), Some(&columns))?;
        Ok(())
    }

    /// Reads an npz file.
    #[staticmethod]
    fn from_npz(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, Self>> {
        let plan = read_npz(py, &path, |trajectory, file| plan_from(trajectory, file));
        let plan = plan.map_err(|error| file_error(&path, &error))?;
        Bound::new(py, Self::initializer(plan))
    }

    pub fn __repr__(&self) -> String {
        let (rows, status) = (self.plan.rows(), self.plan.status());
        let reason =
            if self.plan.reason().is_empty() { String::new() } else { format!(": {}", self.plan.reason()) };
        format!("Plan({rows} rows, {status}{reason})")
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| self.plan == other.get().plan)
    }

    fn __ne__(&self, other: &Bound<'_, PyAny>) -> bool {
        !self.__eq__(other)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let parts = parts(this)?.into_pyobject(this.py())?;
        Ok((this.get_type().getattr("_from_columns")?, parts))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_columns<'py>(
        rows: &Bound<'py, PyTrajectory>,
        columns: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, Self>> {
        Bound::new(rows.py(), Self::initializer(plan_from(rows.get().trajectory.clone(), columns)?))
    }
}

/// A plan as its trajectory and its columns.
pub fn parts<'py>(plan: &Bound<'py, PyPlan>) -> PyResult<(Bound<'py, PyTrajectory>, Bound<'py, PyDict>)> {
    let py = plan.py();
    let trajectory = plan.as_super().get().trajectory.clone();
    Ok((Bound::new(py, PyTrajectory::from(trajectory))?, plan.get().columns(py)?))
}

/// The plan of a trajectory and of what [`PyPlan::columns`] gives.
pub fn plan_from(trajectory: Trajectory, columns: &Bound<'_, PyAny>) -> PyResult<Plan> {
    let list = |name: &str| columns.get_item(name)?.call_method0("tolist");
    let has = |name: &str| columns.contains(name);
    let word = |name: &str| -> PyResult<String> {
        let words: Vec<String> = list(name)?.extract()?;
        words.into_iter().next().ok_or_else(|| to_py(Error::Invalid(format!("{name} is empty"))))
    };
    let numbers = |name: &str| -> PyResult<Option<Vec<f64>>> {
        if has(name)? { list(name)?.extract().map(Some) } else { Ok(None) }
    };
    let status: Status = word("status")?.parse().map_err(to_py)?;
    let reasons: Vec<String> = list("reconfiguration_reason")?.extract()?;
    let rows: Vec<usize> = list("reconfiguration_row")?.extract()?;
    let changes = rows.into_iter().zip(reasons).map(|(row, reason)| Reconfiguration { row, reason });
    let rows: Vec<usize> = list("blocked_row")?.extract()?;
    let words: Vec<String> = list("blocked_status")?.extract()?;
    let reasons: Vec<String> = list("blocked_reason")?.extract()?;
    let blocked =
        rows.into_iter().zip(words).zip(reasons).map(|((row, word), reason)| {
            Ok(BlockedPoint { row, status: word.parse().map_err(to_py)?, reason })
        });
    let rows = trajectory.rows();
    let mut builder = PlanBuilder::new(trajectory, status)
        .reason(word("reason")?)
        .proven(list("proven")?.extract::<Vec<bool>>()?.contains(&true))
        .reconfigurations(changes.collect())
        .blocked(blocked.collect::<PyResult<_>>()?);
    if let Some(legal) = list("legal")?.extract::<Vec<bool>>()?.first() {
        builder = builder.legal(*legal);
    }
    if let Some(cost) = list("cost")?.extract::<Vec<f64>>()?.first() {
        builder = builder.cost(*cost);
    }
    type Setter = fn(PlanBuilder, Vec<f64>) -> PlanBuilder;
    let setters: [(&str, Setter); 6] = [
        ("s", PlanBuilder::s),
        ("spin", PlanBuilder::spin),
        ("margin", PlanBuilder::margin),
        ("clearance", PlanBuilder::clearance),
        ("self_clearance", PlanBuilder::self_clearance),
        ("row_cost", PlanBuilder::row_cost),
    ];
    for (name, set) in setters {
        if let Some(values) = numbers(name)? {
            builder = set(builder, values);
        }
    }
    if has("poses")? {
        let poses: Vec<[[f64; 4]; 4]> = list("poses")?.extract()?;
        let poses = poses.iter().map(|pose| pose_from_row_major(pose.as_flattened()));
        builder = builder.poses(poses.collect::<Result<Vec<Pose>, _>>().map_err(to_py)?);
    }
    if has("tilt")? {
        builder = builder.tilt(list("tilt")?.extract()?);
    }
    if has("piece")? {
        let Pieces { index, labels } =
            Pieces { index: list("piece")?.extract()?, labels: list("piece_labels")?.extract()? };
        builder = builder.pieces(index, labels);
    }
    let (names, values): (Vec<String>, Vec<Vec<f64>>) =
        (list("spare_names")?.extract()?, list("spare")?.extract()?);
    if names.len() != values.len() && rows > 0 {
        return Err(to_py(Error::Invalid(
            "names and values of the spare coordinates differ in number".into(),
        )));
    }
    for (k, name) in names.into_iter().enumerate() {
        builder = builder.spare(name, values.get(k).cloned().unwrap_or_default());
    }
    builder.build().map_err(to_py)
}
