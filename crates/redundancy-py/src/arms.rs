//! The arms with a closed form beside `SrsArm`: `SphericalWristArm`, `ParallelAxesArm`, `PandaClassArm`.

use std::ops::Range;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::Error;
use redundancy_core::solutions::{
    ClosedForm, Configurations, Defect, PandaClassArm, ParallelAxesArm, SphericalWristArm,
};

use crate::batch::in_blocks;
use crate::chain::PyChain;
use crate::convert::{Fresh, Threads, read_pose, read_poses, read_rows, read_vector, to_array};
use crate::error::to_py;
use crate::self_motion::{Batch, PySolveBatch, signs_of};
use crate::status::status_to_py;

/// Poses between two looks at Ctrl-C: some milliseconds.
const BLOCK: usize = 16_384;
/// The same for searches.
const SEARCH_BLOCK: usize = 512;

/// A six-joint arm with a spherical wrist and its closed-form inverse kinematics: PUMA, ABB, KUKA, Fanuc, Staubli.
///
/// The arm is recognised from its geometry alone: axes 4, 5, 6 meet at right angles, axes 2 and 3 are parallel, axis 1
/// is perpendicular to them. Base, tool, axis signs, joint zeros, shoulder, elbow and lateral offsets do not matter.
///
/// Args:
///     chain: Six revolute joints.
///
/// Raises:
///     NotSphericalWristError: Which axes are wrong and by how many mm or mrad.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.SphericalWristArm(rd.catalog.load("puma560"))
///     >>> pose = arm.chain.forward([0.3, 0.5, -0.2, 1.1, 0.4, 0.7])
///     >>> arm.solve(pose, limits=False).shape
///     (8, 6)
#[pyclass(name = "SphericalWristArm", module = "redundancy", frozen)]
pub struct PySphericalWristArm {
    pub arm: SphericalWristArm,
    pub chain: Py<PyChain>,
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

    /// `"spherical_wrist"`.
    #[getter]
    fn name(&self) -> &'static str {
        ClosedForm::name(&self.arm)
    }

    /// `None`: the configurations for a pose are isolated.
    #[getter]
    fn parameter(&self) -> Option<&'static str> {
        self.arm.parameter()
    }

    /// How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect.
    #[getter]
    fn defect(&self) -> (f64, f64) {
        pair(self.arm.defect())
    }

    /// Upper arm and forearm, m: axis 2 to axis 3, axis 3 to the wrist centre.
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

    /// Distance of the wrist centre from the plane through axis 1 perpendicular to axis 2, m.
    #[getter]
    fn lateral_offset(&self) -> f64 {
        self.arm.lateral_offset()
    }

    /// Configurations for a pose, `(k, 6)`, in branch order.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like.
    ///     limits: Only those within the joint limits, shifted by whole turns where necessary. If False: all distinct
    ///         ones in principal values, 8, or 4 where one shoulder is out of reach or the arm is stretched.
    ///
    /// Returns:
    ///     `(0, 6)` when there is none: `configurations(pose).reason` says why. With the wrist at its gimbal, only
    ///     the sum of joints 4 and 6 is determined, and joint 4 is as near to 0 as the limits allow; so is joint 1
    ///     where it is free.
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

    /// All branches for many poses `(N, 4, 4)`: `q` `(N, 8, 6)` in branch order, `valid` `(N, 8)`.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or a list of SE3-like objects.
    ///     limits: Whether only those within the joint limits are valid.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, limits=true, *, threads=None))]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        limits: bool,
        threads: Option<Threads>,
    ) -> PyResult<PySolveBatch> {
        solve_batch::<6>(py, poses, threads, |_, data, q, valid| self.arm.solve_batch(data, limits, q, valid))
    }

    /// The configuration for the pose within limits with the least distance to `q`, windings included.
    ///
    /// `(6,)`, or `None` when there is none. For poses `(N, 4, 4)`, with one `q` or `(N, 6)`, a `SolveBatch` with `q`
    /// `(N, 6)` and `valid` `(N,)`. Where the pose leaves joints free (gimbal of the wrist, wrist centre on axis 1)
    /// they stay near `q`.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
    ///     q: `(6,)`, or `(N, 6)` for many poses, rad.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (pose, q, *, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        if read_poses(pose)?.batch.is_none() {
            let q = read_vector(q, "q", Some(6))?;
            let near = self.arm.nearest(&read_pose(pose)?, &q).map_err(to_py)?;
            return Ok(near.map(|q| PyArray1::from_slice(py, &q).into_any()));
        }
        nearest_batch(py, pose, q, threads, BLOCK, |poses, q| self.arm.nearest_batch(poses, q)).map(Some)
    }

    /// Every configuration for a pose within the limits; if there is none, the reason.
    fn configurations(&self, pose: &Bound<'_, PyAny>) -> PyResult<PyConfigurations> {
        let all = self.arm.configurations(&read_pose(pose)?).map_err(to_py)?;
        Ok(PyConfigurations { all })
    }

    /// Signs (shoulder, elbow, wrist) of a configuration `(6,)`, or `(N, 3)` of many `(N, 6)`.
    ///
    /// Branch order is `4 [shoulder < 0] + 2 [elbow < 0] + [wrist < 0]`. The shoulder is + when the wrist centre is on
    /// the side of axis 1 on which axis 2 passes.
    ///
    /// Args:
    ///     q: Joint positions `(6,)` or `(N, 6)`, rad.
    fn branch<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        branch_signs(py, q, |q| self.arm.branch(q))
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

/// Every configuration of a `SphericalWristArm` for one pose.
#[pyclass(name = "Configurations", module = "redundancy", frozen)]
pub struct PyConfigurations {
    all: Configurations,
}

#[pymethods]
impl PyConfigurations {
    /// `converged`, `unreachable` (no configuration) or `limits` (none within the joint limits).
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.all.status)
    }

    /// Why there is none: out of reach by how many mm, or which joint is outside by how much.
    ///
    /// Empty otherwise.
    #[getter]
    fn reason(&self) -> &str {
        &self.all.reason
    }

    /// Whether status and branches are exact.
    ///
    /// False for an arm with a defect above 1e-9, and where the pose leaves a joint free (wrist centre on axis 1, wrist
    /// at its gimbal).
    #[getter]
    fn proven(&self) -> bool {
        self.all.proven()
    }

    /// Distance of the wrist centre from the nearest point that it can reach, m; 0 in reach.
    #[getter]
    fn distance(&self) -> f64 {
        self.all.distance
    }

    /// Within the limits, `(k, 6)`, in branch order.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.all.q.as_flattened(), [self.all.q.len(), 6])
    }

    /// Their signs (shoulder, elbow, wrist), `(k, 3)`.
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

/// A six-joint arm whose axes 2, 3 and 4 are parallel, and its closed-form inverse kinematics: UR3 to UR30, Z1.
///
/// The arm is recognised from its geometry alone: axes 2, 3, 4 are parallel, axes 5 and 6 meet. Base, tool, axis signs,
/// joint zeros, offsets and the other angles between the axes do not matter.
///
/// Args:
///     chain: Six revolute joints.
///
/// Raises:
///     NotParallelAxesError: Which axes are wrong and by how many mm or mrad.
///
/// Example:
///     >>> import numpy as np
///     >>> import redundancy as rd
///     >>> rows = [[0, .16, np.pi / 2, 0], [-.6, 0, 0, 0], [-.57, 0, 0, 0],
///     ...         [0, .17, np.pi / 2, 0], [0, .12, -np.pi / 2, 0], [0, .11, 0, 0]]
///     >>> arm = rd.ParallelAxesArm(rd.Chain.from_dh(rows))
///     >>> arm.solve(arm.chain.forward([0.3, -1.5, 1.2, 1.1, 0.4, 0.7])).shape
///     (8, 6)
#[pyclass(name = "ParallelAxesArm", module = "redundancy", frozen)]
pub struct PyParallelAxesArm {
    pub arm: ParallelAxesArm,
    pub chain: Py<PyChain>,
}

#[pymethods]
impl PyParallelAxesArm {
    #[new]
    fn new(chain: &Bound<'_, PyChain>) -> PyResult<Self> {
        let arm = ParallelAxesArm::new(&chain.get().chain).map_err(to_py)?;
        Ok(Self { arm, chain: chain.clone().unbind() })
    }

    /// The chain that was recognised.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// `"parallel_axes"`.
    #[getter]
    fn name(&self) -> &'static str {
        ClosedForm::name(&self.arm)
    }

    /// `None`: the configurations for a pose are isolated.
    #[getter]
    fn parameter(&self) -> Option<&'static str> {
        self.arm.parameter()
    }

    /// How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect.
    #[getter]
    fn defect(&self) -> (f64, f64) {
        pair(self.arm.defect())
    }

    /// Upper arm and forearm, m: axis 2 to axis 3, axis 3 to axis 4.
    #[getter]
    fn lengths(&self) -> (f64, f64) {
        let [upper, fore] = self.arm.lengths();
        (upper, fore)
    }

    /// Configurations for a pose, `(k, 6)`, in branch order.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like.
    ///     limits: Only those within the joint limits, shifted by whole turns where necessary. If False: all distinct
    ///         ones, at most 8, in principal values.
    ///
    /// Returns:
    ///     `(0, 6)` when there is none: `rd.solutions(arm, pose).reason` says why. If the last axis is parallel to
    ///     axes 2, 3 and 4, joint 6 is as near to 0 as reach and limits allow; so is joint 1 where it is free. The
    ///     configurations of an arm with a defect are polished by Newton's method.
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

    /// All branches for many poses `(N, 4, 4)`: `q` `(N, 8, 6)` in branch order, `valid` `(N, 8)`. Not polished.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or a list of SE3-like objects.
    ///     limits: Whether only those within the joint limits are valid.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, limits=true, *, threads=None))]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        limits: bool,
        threads: Option<Threads>,
    ) -> PyResult<PySolveBatch> {
        solve_batch::<6>(py, poses, threads, |_, data, q, valid| self.arm.solve_batch(data, limits, q, valid))
    }

    /// The configuration for the pose within limits with the least distance to `q`, windings included.
    ///
    /// `(6,)`, or `None` when there is none. For poses `(N, 4, 4)`, with one `q` or `(N, 6)`, a `SolveBatch` with `q`
    /// `(N, 6)` and `valid` `(N,)`. Where the pose leaves joint 1 or joint 6 free it stays near `q`.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
    ///     q: `(6,)`, or `(N, 6)` for many poses, rad.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (pose, q, *, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        if read_poses(pose)?.batch.is_none() {
            let q = read_vector(q, "q", Some(6))?;
            let near = self.arm.nearest(&read_pose(pose)?, &q).map_err(to_py)?;
            return Ok(near.map(|q| PyArray1::from_slice(py, &q).into_any()));
        }
        nearest_batch(py, pose, q, threads, BLOCK, |poses, q| self.arm.nearest_batch(poses, q)).map(Some)
    }

    /// Signs (shoulder, elbow, wrist) of a configuration `(6,)`, or `(N, 3)` of many `(N, 6)`.
    ///
    /// Branch order is `4 [shoulder < 0] + 2 [elbow < 0] + [wrist < 0]`. The shoulder is + when the point where axes 5
    /// and 6 meet is in front of axis 1, looking along the parallel axes from its side of axis 1.
    ///
    /// Args:
    ///     q: Joint positions `(6,)` or `(N, 6)`, rad.
    fn branch<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        branch_signs(py, q, |q| self.arm.branch(q))
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        (this.get_type(), (this.get().chain.clone_ref(this.py()),)).into_pyobject(this.py())
    }

    fn __repr__(&self) -> String {
        let ((upper, fore), (position, orientation)) = (self.lengths(), self.defect());
        format!(
            "ParallelAxesArm('{}', upper arm {upper:.6} m, forearm {fore:.6} m, defect {position:.1e} m {orientation:.1e} rad)",
            self.arm.chain().name(),
        )
    }
}

/// A seven-joint arm with a spherical shoulder whose axis 7 does not meet axes 5 and 6: Panda, FR3, xArm7, GEN72.
///
/// The arm is recognised from its geometry alone: axes 1, 2, 3 meet at right angles, axes 5 and 6 meet, axis 7 does
/// not pass through that point. Base, tool, axis signs, joint zeros, elbow offsets and the other angles do not
/// matter. The set of configurations for a pose, curves of joint 7 with their arcs within the joint limits, is
/// `rd.solutions(arm, pose)`.
///
/// Args:
///     chain: Seven revolute joints.
///
/// Raises:
///     NotPandaClassError: Which axes are wrong and by how many mm or mrad.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.PandaClassArm(rd.catalog.load("panda"))
///     >>> pose = arm.chain.forward([0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9])
///     >>> arm.solve(pose, q7=-0.9).shape
///     (3, 7)
#[pyclass(name = "PandaClassArm", module = "redundancy", frozen)]
pub struct PyPandaClassArm {
    pub arm: PandaClassArm,
    pub chain: Py<PyChain>,
}

#[pymethods]
impl PyPandaClassArm {
    #[new]
    fn new(chain: &Bound<'_, PyChain>) -> PyResult<Self> {
        let arm = PandaClassArm::new(&chain.get().chain).map_err(to_py)?;
        Ok(Self { arm, chain: chain.clone().unbind() })
    }

    /// The chain that was recognised.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// `"panda_class"`.
    #[getter]
    fn name(&self) -> &'static str {
        ClosedForm::name(&self.arm)
    }

    /// `"q7"`.
    #[getter]
    fn parameter(&self) -> Option<&'static str> {
        self.arm.parameter()
    }

    /// How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect.
    #[getter]
    fn defect(&self) -> (f64, f64) {
        pair(self.arm.defect())
    }

    /// Distances of the shoulder's and the wrist's centre from axis 4, and of the latter from axis 7, m.
    #[getter]
    fn lengths(&self) -> (f64, f64, f64) {
        let [upper, fore, hand] = self.arm.lengths();
        (upper, fore, hand)
    }

    /// Configurations for a pose with joint 7 at `q7` (modulo turns), `(k, 7)`, k at most 8.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like.
    ///     q7: rad.
    ///     limits: Only those within the joint limits, shifted by whole turns where necessary. If False: all distinct
    ///         ones in principal values.
    ///
    /// Returns:
    ///     In the order `4 [shoulder < 0] + 2 [elbow < 0] + [normal < 0]`; `(0, 7)` when there is none with this
    ///     joint 7. The configurations of an arm with a defect are polished by Newton's method.
    #[pyo3(signature = (pose, q7, limits=true))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        q7: f64,
        limits: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.arm.solve(&read_pose(pose)?, q7, limits).map_err(to_py)?;
        to_array(py, rows.as_flattened(), [rows.len(), 7])
    }

    /// All configurations for many poses `(N, 4, 4)` with one `q7` or `(N,)`: `q` `(N, 8, 7)`, `valid` `(N, 8)`.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or a list of SE3-like objects.
    ///     q7: Joint 7: a number or `(N,)`, rad.
    ///     limits: Whether only those within the joint limits are valid.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, q7, limits=true, *, threads=None))]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        q7: &Bound<'py, PyAny>,
        limits: bool,
        threads: Option<Threads>,
    ) -> PyResult<PySolveBatch> {
        let q7 = match q7.extract::<f64>() {
            Ok(q7) => vec![q7],
            Err(_) => read_vector(q7, "q7", Some(Batch::read(poses)?.len()))?,
        };
        solve_batch::<7>(py, poses, threads, |r, data, q, valid| {
            let q7 = if q7.len() == 1 { &q7[..] } else { &q7[r] };
            self.arm.solve_batch(data, q7, limits, q, valid)
        })
    }

    /// The configuration for the pose within limits with the least distance to `q`, windings included.
    ///
    /// `(7,)`, or `None` when there is none. For poses `(N, 4, 4)`, with one `q` or `(N, 7)`, a `SolveBatch` with `q`
    /// `(N, 7)` and `valid` `(N,)`.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like, or `(N, 4, 4)`.
    ///     q: `(7,)`, or `(N, 7)` for many poses, rad.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (pose, q, *, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        if read_poses(pose)?.batch.is_none() {
            let (pose, q) = (read_pose(pose)?, read_vector(q, "q", Some(7))?);
            let near = py.detach(|| self.arm.nearest(&pose, &q)).map_err(to_py)?;
            return Ok(near.map(|found| PyArray1::from_slice(py, &found.q).into_any()));
        }
        nearest_batch(py, pose, q, threads, SEARCH_BLOCK, |poses, q| self.arm.nearest_batch(poses, q))
            .map(Some)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        (this.get_type(), (this.get().chain.clone_ref(this.py()),)).into_pyobject(this.py())
    }

    fn __repr__(&self) -> String {
        let ((upper, fore, hand), (position, orientation)) = (self.lengths(), self.defect());
        format!(
            "PandaClassArm('{}', shoulder {upper:.6} m and wrist {fore:.6} m from axis 4, axis 7 {hand:.6} m from the wrist, defect {position:.1e} m {orientation:.1e} rad)",
            self.arm.chain().name(),
        )
    }
}

fn pair(defect: Defect) -> (f64, f64) {
    (defect.position, defect.orientation)
}

/// The eight branches of `J` joints for many poses: `solve` gets a range of the poses with its share of the memory.
fn solve_batch<const J: usize>(
    py: Python<'_>,
    poses: &Bound<'_, PyAny>,
    threads: Option<Threads>,
    solve: impl Fn(Range<usize>, &[f64], &mut [f64], &mut [bool]) -> Result<(), Error> + Sync,
) -> PyResult<PySolveBatch> {
    let poses = Batch::read(poses)?;
    let n = poses.len();
    let (mut q, mut valid) = (Fresh::<f64, _>::new(py, [n, 8, J]), Fresh::<bool, _>::new(py, [n, 8]));
    {
        let (q, valid) = (q.memory()?, valid.memory()?);
        let data = poses.as_slice()?;
        in_blocks(py, n, BLOCK, threads, |r| {
            let (data, valid) = (&data[r.start * 16..r.end * 16], &mut valid[r.start * 8..r.end * 8]);
            let q = &mut q[r.start * 8 * J..r.end * 8 * J];
            solve(r, data, q, valid)
        })?;
    }
    let (q, valid) = (q.finish().to_dyn().clone(), valid.finish().to_dyn().clone());
    Ok(PySolveBatch { q: q.unbind(), valid: valid.unbind() })
}

/// Signs (shoulder, elbow, wrist) of a configuration of six joints, or of many.
fn branch_signs<'py>(
    py: Python<'py>,
    q: &Bound<'py, PyAny>,
    branch: impl Fn(&[f64]) -> Result<[i8; 3], Error>,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = read_rows(q, "q", &[6])?;
    let signs = rows.as_slice()?.chunks_exact(6).map(branch).collect::<Result<Vec<_>, _>>().map_err(to_py)?;
    match rows.batch {
        None => Ok(PyTuple::new(py, signs[0])?.into_any()),
        Some(n) => Ok(to_array(py, signs.as_flattened(), [n, 3])?.into_any()),
    }
}

/// Nearest configurations for many poses to one `q` or to one each, as a `SolveBatch` of `(N, n)` and `(N,)`.
fn nearest_batch<'py, const J: usize>(
    py: Python<'py>,
    poses: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    threads: Option<Threads>,
    block: usize,
    nearest: impl Fn(&[f64], &[f64]) -> Result<Vec<Option<[f64; J]>>, Error> + Sync,
) -> PyResult<Bound<'py, PyAny>> {
    let poses = Batch::read(poses)?;
    let n = poses.len();
    let wish = read_rows(q, "q", &[J])?;
    if let Some(actual) = wish.batch.filter(|m| *m != n) {
        return Err(to_py(Error::Length { what: "rows of q".into(), expected: n, actual }));
    }
    let (data, single, wish) = (poses.as_slice()?, wish.batch.is_none(), wish.as_slice()?);
    let mut rows = Vec::with_capacity(n);
    in_blocks(py, n, block, threads, |r| {
        let wish = if single { wish } else { &wish[r.start * J..r.end * J] };
        rows.extend(nearest(&data[r.start * 16..r.end * 16], wish)?);
        Ok(())
    })?;
    let q: Vec<[f64; J]> = rows.iter().map(|row| row.unwrap_or([0.0; J])).collect();
    let q = to_array(py, q.as_flattened(), [n, J])?.to_dyn().clone();
    let valid = PyArray1::from_iter(py, rows.iter().map(Option::is_some)).to_dyn().clone();
    let batch = PySolveBatch { q: q.unbind(), valid: valid.unbind() };
    Ok(Py::new(py, batch)?.into_bound(py).into_any())
}
