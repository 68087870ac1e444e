//! From poses to configurations: `SphericalWristArm`.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::Error;
use redundancy_core::ik::{Configurations, SphericalWristArm};

use crate::batch::in_blocks;
use crate::chain::PyChain;
use crate::convert::{Fresh, Threads, read_pose, read_poses, read_rows, read_vector, to_array};
use crate::error::to_py;
use crate::self_motion::{Batch, PySolveBatch, signs_of};
use crate::status::status_to_py;

/// Poses between two looks at Ctrl-C: some milliseconds.
const BLOCK: usize = 16_384;

/// A six-joint arm with a spherical wrist and its closed-form inverse kinematics.
#[pyclass(name = "SphericalWristArm", module = "redundancy", frozen)]
pub struct PySphericalWristArm {
    arm: SphericalWristArm,
    chain: Py<PyChain>,
}

#[pymethods]
impl PySphericalWristArm {
    #[new]
    fn new(chain: &Bound<'_, PyChain>) -> PyResult<Self> {
        let arm = SphericalWristArm::new(&chain.get().chain).map_err(to_py)?;
        Ok(Self { arm, chain: chain.clone().unbind() })
    }

    /// The chain that was recognised.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// How far the arm is from an ideal one: (metres, radians).
    #[getter]
    fn defect(&self) -> (f64, f64) {
        let defect = self.arm.defect();
        (defect.position, defect.orientation)
    }

    /// Lengths of upper arm and forearm, m.
    #[getter]
    fn lengths(&self) -> (f64, f64) {
        let [upper, fore] = self.arm.lengths();
        (upper, fore)
    }

    /// Distance of axis 2 from axis 1, m.
    #[getter]
    fn shoulder_offset(&self) -> f64 {
        self.arm.shoulder_offset()
    }

    /// Distance of the wrist centre from the plane of the arm through axis 1, m.
    #[getter]
    fn lateral_offset(&self) -> f64 {
        self.arm.lateral_offset()
    }

    /// Configurations over a pose.
    #[pyo3(signature = (pose, limits=true))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        limits: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.arm.solve(&read_pose(pose)?, limits).map_err(to_py)?;
        to_array(py, rows.as_flattened(), [rows.len(), 6])
    }

    /// All branches over many poses.
    #[pyo3(signature = (poses, limits=true, *, threads=None))]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        limits: bool,
        threads: Option<Threads>,
    ) -> PyResult<PySolveBatch> {
        let poses = Batch::read(poses)?;
        let n = poses.len();
        let (mut q, mut valid) = (Fresh::<f64, _>::new(py, [n, 8, 6]), Fresh::<bool, _>::new(py, [n, 8]));
        {
            let (q, valid) = (q.memory()?, valid.memory()?);
            let data = poses.as_slice()?;
            in_blocks(py, n, BLOCK, threads, |r| {
                let (q, valid) = (&mut q[r.start * 48..r.end * 48], &mut valid[r.start * 8..r.end * 8]);
                self.arm.solve_batch(&data[r.start * 16..r.end * 16], limits, q, valid)
            })?;
        }
        let (q, valid) = (q.finish().to_dyn().clone(), valid.finish().to_dyn().clone());
        Ok(PySolveBatch { q: q.unbind(), valid: valid.unbind() })
    }

    /// The configuration over the pose nearest to `q`.
    #[pyo3(signature = (pose, q, *, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let poses = read_poses(pose)?;
        let Some(n) = poses.batch else {
            let q = read_vector(q, "q", Some(6))?;
            let near = self.arm.nearest(&read_pose(pose)?, &q).map_err(to_py)?;
            return Ok(near.map(|q| PyArray1::from_slice(py, &q).into_any()));
        };
        let wish = read_rows(q, "q", &[6])?;
        if let Some(actual) = wish.batch.filter(|m| *m != n) {
            return Err(to_py(Error::Length { what: "rows of q".into(), expected: n, actual }));
        }
        let (data, single, wish) = (poses.as_slice()?, wish.batch.is_none(), wish.as_slice()?);
        let mut rows = Vec::with_capacity(n);
        in_blocks(py, n, BLOCK, threads, |r| {
            let wish = if single { wish } else { &wish[r.start * 6..r.end * 6] };
            rows.extend(self.arm.nearest_batch(&data[r.start * 16..r.end * 16], wish)?);
            Ok(())
        })?;
        let q: Vec<[f64; 6]> = rows.iter().map(|row| row.unwrap_or_default()).collect();
        let q = to_array(py, q.as_flattened(), [n, 6])?.to_dyn().clone();
        let valid = PyArray1::from_iter(py, rows.iter().map(Option::is_some)).to_dyn().clone();
        let batch = PySolveBatch { q: q.unbind(), valid: valid.unbind() };
        Ok(Some(Py::new(py, batch)?.into_bound(py).into_any()))
    }

    /// Every configuration over a pose, with the reason where there is none.
    fn configurations(&self, pose: &Bound<'_, PyAny>) -> PyResult<PyConfigurations> {
        let all = self.arm.configurations(&read_pose(pose)?).map_err(to_py)?;
        Ok(PyConfigurations { all })
    }

    /// Signs (shoulder, elbow, wrist) of a configuration.
    fn branch<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = read_rows(q, "q", &[6])?;
        let signs: Vec<[i8; 3]> = rows
            .as_slice()?
            .chunks_exact(6)
            .map(|q| self.arm.branch(q))
            .collect::<Result<_, _>>()
            .map_err(to_py)?;
        match rows.batch {
            None => Ok(PyTuple::new(py, signs[0])?.into_any()),
            Some(n) => Ok(to_array(py, signs.as_flattened(), [n, 3])?.into_any()),
        }
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        (this.get_type(), (this.get().chain.clone_ref(this.py()),)).into_pyobject(this.py())
    }

    fn __repr__(&self) -> String {
        let (upper, fore) = self.lengths();
        let defect = self.arm.defect();
        format!(
            "SphericalWristArm('{}', upper arm {upper:.6} m, forearm {fore:.6} m, defect {:.1e} m {:.1e} rad)",
            self.arm.chain().name(),
            defect.position,
            defect.orientation
        )
    }
}

/// Every configuration over one pose.
#[pyclass(name = "Configurations", module = "redundancy", frozen)]
pub struct PyConfigurations {
    all: Configurations,
}

#[pymethods]
impl PyConfigurations {
    /// `converged`, `limits` or `unreachable`.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.all.status)
    }

    /// Why there is none, with the number; empty when there is one.
    #[getter]
    fn reason(&self) -> &str {
        &self.all.reason
    }

    /// Distance of the wrist centre from what it can reach, m.
    #[getter]
    fn distance(&self) -> f64 {
        self.all.distance
    }

    /// `(k, 6)`, in branch order.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.all.q.as_flattened(), [self.all.q.len(), 6])
    }

    /// `(k, 3)` signs (shoulder, elbow, wrist).
    #[getter]
    fn branches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i8>>> {
        let signs: Vec<[i8; 3]> = self.all.branches.iter().map(|b| signs_of(*b)).collect();
        to_array(py, signs.as_flattened(), [signs.len(), 3])
    }

    fn __repr__(&self) -> String {
        match self.all.reason.as_str() {
            "" => format!("Configurations({}: {} branches)", self.all.status, self.all.q.len()),
            reason => format!("Configurations({}: {reason})", self.all.status),
        }
    }
}
