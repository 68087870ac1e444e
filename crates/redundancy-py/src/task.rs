//! `Task`: which coordinates of the tool's motion count.

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::ik::task_target;
use redundancy_core::kinematics::{Task, TaskKind};
use redundancy_core::{Error, Pose, pose_to_row_major};

use crate::convert::{Rows, read_array, read_pose, read_rows};
use crate::error::to_py;
use crate::self_motion::Batch;

/// Which coordinates of the tool's motion count.
///
/// `pose` (6, angular velocity in world axes), `pose_rpy` (6, rates of roll-pitch-yaw, R = Rz(phi) Ry(theta)
/// Rx(psi)), `position` (3), `pointing` (5: position and the tool axis, the spin about it is free), `planar` (x, y),
/// `planar_pose` (x, y, rotation about z). An argument `task` also accepts a name.
///
/// Args:
///     name: One of the names above.
///
/// Raises:
///     RedundancyError: An unknown name; the message lists the known ones.
///
/// Example:
///     >>> import redundancy as rd
///     >>> rd.Task.pointing([0, 1, 0]).dim
///     5
#[pyclass(name = "Task", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyTask {
    pub task: Task,
}

#[pymethods]
impl PyTask {
    /// The task with this name.
    #[new]
    fn new(name: &str) -> PyResult<Self> {
        Ok(Self { task: Task::from_name(name).map_err(to_py)? })
    }

    /// Position and the direction of `axis` `(3,)`, given in the tool frame; z by default.
    #[staticmethod]
    #[pyo3(signature = (axis=None))]
    fn pointing(axis: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let axis = axis.map_or(Ok([0.0, 0.0, 1.0]), |axis| read_array(axis, "tool axis"))?;
        Ok(Self { task: Task::pointing(axis).map_err(to_py)? })
    }

    /// The name of its kind.
    #[getter]
    fn name(&self) -> &'static str {
        self.task.kind().as_str()
    }

    /// Number of coordinates.
    #[getter]
    fn dim(&self) -> usize {
        self.task.dim()
    }

    /// Tool axis of `pointing`, unit length, tool frame; z for the other tasks.
    #[getter]
    fn axis(&self) -> [f64; 3] {
        let axis = self.task.axis();
        [axis.x, axis.y, axis.z]
    }

    fn __repr__(&self) -> String {
        match self.task.kind() {
            TaskKind::Pointing => format!("Task.pointing({:?})", self.axis()),
            kind => format!("Task('{kind}')"),
        }
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        // -0 equals 0.
        (self.name(), self.axis().map(|x| (x + 0.0).to_bits())).hash(&mut hasher);
        hasher.finish()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let class = py.get_type::<Self>();
        match self.task.kind() {
            TaskKind::Pointing => Ok((class.getattr("pointing")?, (self.axis(),).into_pyobject(py)?)),
            kind => Ok((class.into_any(), (kind.as_str(),).into_pyobject(py)?)),
        }
    }
}

/// A task by name, or a `Task`.
pub fn read_task(object: &Bound<'_, PyAny>) -> PyResult<Task> {
    if let Ok(task) = object.cast::<PyTask>() {
        return Ok(task.get().task);
    }
    match object.extract::<&str>() {
        Ok(name) => Task::from_name(name).map_err(to_py),
        Err(_) => {
            let message = format!("task is {}, expected a name or a Task", object.repr()?);
            Err(to_py(Error::Invalid(message)))
        }
    }
}

/// How many numbers may stand for a target of `task` instead of a pose: its coordinates, for `planar` also with z.
fn coordinate_counts(task: &Task) -> &'static [usize] {
    match task.kind() {
        TaskKind::Planar => &[2, 3],
        TaskKind::Position | TaskKind::PlanarPose => &[3],
        _ => &[],
    }
}

/// One or many targets that are given by their coordinates, and the length of a row; none where `object` is something else.
fn read_coordinates<'py>(object: &Bound<'py, PyAny>, task: &Task) -> Option<(Rows<'py>, usize)> {
    let mut counts = coordinate_counts(task).iter();
    counts.find_map(|n| read_rows(object, "target", &[*n]).ok().map(|rows| (rows, *n)))
}

/// A target of `task`: a pose, or what counts of it: `(2,)` or `(3,)` for `planar`, `(3,)` for `planar_pose` and
/// `position`.
pub fn read_target(object: &Bound<'_, PyAny>, task: &Task) -> PyResult<Pose> {
    match read_coordinates(object, task) {
        Some((rows, _)) if rows.batch.is_none() => {
            task_target(task, &rows.as_slice()?[..task.dim()]).map_err(to_py)
        }
        _ => read_pose(object),
    }
}

/// Targets as row-major matrices.
pub struct Targets<'py> {
    /// How many.
    pub rows: usize,
    poses: Option<Batch<'py>>,
    made: Vec<f64>,
}

impl Targets<'_> {
    /// All numbers, pose by pose.
    pub fn as_slice(&self) -> PyResult<&[f64]> {
        match &self.poses {
            Some(poses) => poses.as_slice(),
            None => Ok(&self.made),
        }
    }
}

/// Targets of `task`, each as for [`read_target`].
pub fn read_targets<'py>(object: &Bound<'py, PyAny>, task: &Task) -> PyResult<Targets<'py>> {
    let Some((rows, n)) = read_coordinates(object, task) else {
        let poses = Batch::read(object)?;
        return Ok(Targets { rows: poses.len(), poses: Some(poses), made: Vec::new() });
    };
    let mut made = Vec::new();
    for (i, values) in rows.as_slice()?.chunks_exact(n).enumerate() {
        let target = task_target(task, &values[..task.dim()]).map_err(|error| match rows.batch {
            Some(_) => to_py(Error::Invalid(format!("row {i}: {error}"))),
            None => to_py(error),
        })?;
        made.extend(pose_to_row_major(&target));
    }
    Ok(Targets { rows: rows.batch.unwrap_or(1), poses: None, made })
}
