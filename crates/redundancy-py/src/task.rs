//! `Task`: which coordinates of the tool's motion count.

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::kinematics::{Task, TaskKind};
use redundancy_core::nalgebra::{Rotation3, Translation3};
use redundancy_core::{Error, Pose};

use crate::convert::{read_array, read_pose, read_rows};
use crate::error::to_py;

/// Which coordinates of the tool's motion count.
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

    /// Position and the direction of a tool axis; the spin about it is free.
    #[staticmethod]
    #[pyo3(signature = (axis=None))]
    fn pointing(axis: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let axis = axis.map_or(Ok([0.0, 0.0, 1.0]), |axis| read_array(axis, "tool axis"))?;
        Ok(Self { task: Task::pointing(axis).map_err(to_py)? })
    }

    /// Its kind as a word.
    #[getter]
    fn name(&self) -> &'static str {
        self.task.kind().as_str()
    }

    /// How many coordinates count.
    #[getter]
    fn dim(&self) -> usize {
        self.task.dim()
    }

    /// The tool axis of `pointing`; z for the others.
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

/// A target of `task`: a pose, or what counts of it: `(2,)` for `planar`, `(3,)` for `planar` and `position`.
pub fn read_target(object: &Bound<'_, PyAny>, task: &Task) -> PyResult<Pose> {
    let lengths: &[usize] = match task.kind() {
        TaskKind::Planar => &[2, 3],
        TaskKind::Position => &[3],
        _ => &[],
    };
    for length in lengths {
        if let Ok(rows) = read_rows(object, "target", &[*length])
            && rows.batch.is_none()
        {
            let p = rows.as_slice()?;
            if let Some(index) = p.iter().position(|x| !x.is_finite()) {
                let (what, value) = ("target".into(), p[index]);
                return Err(to_py(Error::NotFinite { what, index, value }));
            }
            let z = p.get(2).copied().unwrap_or(0.0);
            return Ok(Pose::from_parts(Translation3::new(p[0], p[1], z), Rotation3::identity()));
        }
    }
    read_pose(object)
}
