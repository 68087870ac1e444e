//! `SrsArm`, `SelfMotion`, `Branch`: the closed form and the circle of solutions.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::rotation::to_wxyz;
use redundancy_core::solutions::{Chart, Choice, ClosedForm, SelfMotion, SrsArm, Swivel};
use redundancy_core::{Error, Pose};

use crate::batch::{in_blocks, in_blocks_watching};
use crate::callback::Watching;
use crate::chain::PyChain;
use crate::convert::{
    Argument, Fresh, Given, Threads, pose_to_array, read_array, read_pose, read_poses, read_rows,
    read_vector, to_array,
};
use crate::criterion::PyCriterion;
use crate::error::to_py;
use crate::html;
use crate::status::status_to_py;

/// Poses between two looks at Ctrl-C: some milliseconds.
const BLOCK: usize = 16_384;
/// The same for searches.
const SEARCH_BLOCK: usize = 512;

/// A spherical-revolute-spherical arm with its closed-form inverse kinematics (Moore & Oztop 2010).
///
/// The arm is recognised from its geometry alone: any base, tool, axis signs, joint zeros, elbow offset. With n from
/// shoulder to wrist, the elbow is on a circle about n, and the swivel s is its angle on the circle. Zero and sense
/// of s follow the paper in the frame whose z is +axis 1 and whose x is the base x projected.
///
/// Args:
///     chain: Seven revolute joints.
///     chart: `"shortest_arc"` (the paper's; singular if n is opposite to the reference) or `"stereographic"`
///         (singular only if n is along the reference).
///     reference: `(3,)` direction in world axes: for `shortest_arc` the one used in place of +axis 1, for
///         `stereographic` the singular half-line (default: opposite to axis 1).
///
/// Raises:
///     NotSrsError: Which axes miss each other and by how much.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.SrsArm(rd.catalog.load("iiwa14"))
///     >>> pose = arm.chain.forward([0.1, 0.5, 0.2, -1.2, 0.3, 0.8, 0.0])
///     >>> arm.solve(pose, swivel=0.4).shape[1]
///     7
#[pyclass(name = "SrsArm", module = "redundancy", frozen, eq)]
pub struct PySrsArm {
    pub arm: SrsArm,
    pub chain: Py<PyChain>,
    chart: String,
    reference: Option<[f64; 3]>,
}

impl PySrsArm {
    /// A recognised arm with the paper's chart.
    pub fn from_arm(arm: SrsArm, chain: &Bound<'_, PyChain>) -> Self {
        Self { arm, chain: chain.clone().unbind(), chart: "shortest_arc".into(), reference: None }
    }
}

impl PartialEq for PySrsArm {
    fn eq(&self, other: &Self) -> bool {
        self.arm == other.arm
    }
}

impl Argument for PySrsArm {
    const WHAT: &'static str = "an SrsArm";
    const HOW: &'static str = "rd.SrsArm(chain) makes one of a chain";
}

#[pymethods]
impl PySrsArm {
    #[new]
    #[pyo3(signature = (chain, chart="shortest_arc", reference=None))]
    fn new(chain: &Bound<'_, PyChain>, chart: &str, reference: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let reference = reference.map(|r| read_array::<3>(r, "reference")).transpose()?;
        let direction = reference.map(Vector3::from);
        let kind = match chart {
            "shortest_arc" => Chart::ShortestArc(direction),
            "stereographic" => Chart::Stereographic(direction),
            other => {
                let valid = vec!["shortest_arc".into(), "stereographic".into()];
                return Err(to_py(Error::UnknownName { kind: "chart", name: other.into(), valid }));
            }
        };
        let arm = SrsArm::with_chart(&chain.get().chain, kind).map_err(to_py)?;
        Ok(Self { arm, chain: chain.clone().unbind(), chart: chart.into(), reference })
    }

    /// The chain that was recognised.
    #[getter]
    fn chain(&self, py: Python<'_>) -> Py<PyChain> {
        self.chain.clone_ref(py)
    }

    /// `"srs"`.
    #[getter]
    fn name(&self) -> &'static str {
        ClosedForm::name(&self.arm)
    }

    /// `"swivel"`.
    #[getter]
    fn parameter(&self) -> Option<&'static str> {
        self.arm.parameter()
    }

    /// How far the arm is from an ideal one, (m, rad): configurations meet the pose within 1e-12 + 2 x defect.
    #[getter]
    fn defect(&self) -> (f64, f64) {
        let defect = self.arm.defect();
        (defect.position, defect.orientation)
    }

    /// Upper arm and forearm, m: shoulder and wrist centre to the elbow axis.
    #[getter]
    fn lengths(&self) -> (f64, f64) {
        let [upper, fore] = self.arm.lengths();
        (upper, fore)
    }

    /// Centre of the shoulder in the world, `(3,)`, m.
    #[getter]
    fn shoulder<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.arm.shoulder().as_slice())
    }

    /// Name of the chart.
    #[getter]
    fn chart(&self) -> &str {
        &self.chart
    }

    /// Configurations for a pose at a swivel.
    ///
    /// Args:
    ///     pose: `(4, 4)` or SE3-like.
    ///     swivel: The angle s, rad, or u = (cos s, sin s), `(2,)`.
    ///     limits: Only those within the joint limits. If False: all 8 rows in branch order (index
    ///         `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`), repeats at a gimbal included.
    ///
    /// Returns:
    ///     `(k, 7)`; `(0, 7)` if the pose is out of reach or no branch is within the limits at this swivel:
    ///     `self_motion(pose).reason` says which.
    #[pyo3(signature = (pose, swivel, limits=true))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        swivel: &Bound<'py, PyAny>,
        limits: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.arm.solve(&read_pose(pose)?, read_swivel(swivel)?, limits).map_err(to_py)?;
        to_array(py, rows.as_flattened(), [rows.len(), 7])
    }

    /// All branches for many poses.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`.
    ///     swivels: One angle, `(N,)` angles, or `(N, 2)` vectors (cos s, sin s).
    ///     limits: Whether `valid` says that the joint limits hold, or only that the pose is in reach.
    ///     out: An earlier result, or `(q, valid)` of shapes `(N, 8, 7)` and `(N, 8)`, to be overwritten.
    ///     threads: Size of the pool; all cores by default. The result does not depend on it.
    #[pyo3(signature = (poses, swivels, limits=true, out=None, *, threads=None))]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        swivels: &Bound<'py, PyAny>,
        limits: bool,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<Threads>,
    ) -> PyResult<PySolveBatch> {
        let poses = Batch::read(poses)?;
        let n = poses.len();
        let swivels = read_swivels(swivels, n)?;
        let (q, valid) = match out {
            None => (
                Fresh::<f64, _>::new(py, [n, 8, 7]).finish().to_dyn().clone(),
                Fresh::<bool, _>::new(py, [n, 8]).finish().to_dyn().clone(),
            ),
            Some(out) => {
                let (q, valid): (Bound<'py, PyAny>, Bound<'py, PyAny>) = match out.cast::<PySolveBatch>() {
                    Ok(batch) => (
                        batch.get().q.bind(py).clone().into_any(),
                        batch.get().valid.bind(py).clone().into_any(),
                    ),
                    Err(_) => out.extract().map_err(|_| {
                        to_py(Error::Invalid(
                            "out must be a pair (q, valid) of arrays or an earlier result".into(),
                        ))
                    })?,
                };
                (output(&q, "out q", &[n, 8, 7])?, output(&valid, "out valid", &[n, 8])?)
            }
        };
        {
            let (mut q, mut valid) = (q.try_readwrite()?, valid.try_readwrite()?);
            let (q, valid) = (q.as_slice_mut()?, valid.as_slice_mut()?);
            let data = poses.as_slice()?;
            in_blocks(py, n, BLOCK, threads, |r| {
                let swivels = if swivels.len() == 1 { &swivels[..] } else { &swivels[r.start..r.end] };
                let (q, valid) = (&mut q[r.start * 56..r.end * 56], &mut valid[r.start * 8..r.end * 8]);
                self.arm.solve_batch(&data[r.start * 16..r.end * 16], swivels, limits, q, valid)
            })?;
        }
        Ok(PySolveBatch { q: q.unbind(), valid: valid.unbind() })
    }

    /// Feasible intervals of all branches for many poses: `(M, 2)` (pose, branch) and `(M, 2)` (lo, hi).
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or a list of SE3-like objects.
    ///     margin: Distance kept from every joint limit, rad.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, margin=0.0, *, threads=None))]
    fn intervals_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        margin: f64,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let poses = Batch::read(poses)?;
        let (mut owner, mut bounds): (Vec<i64>, Vec<f64>) = (Vec::new(), Vec::new());
        let data = poses.as_slice()?;
        in_blocks(py, poses.len(), SEARCH_BLOCK * 8, threads, |r| {
            for row in self.arm.intervals_batch(&data[r.start * 16..r.end * 16], margin)? {
                owner.extend([(row.pose + r.start) as i64, row.branch as i64]);
                bounds.extend(row.interval);
            }
            Ok(())
        })?;
        let m = bounds.len() / 2;
        PyTuple::new(
            py,
            [to_array(py, &owner, [m, 2])?.into_any(), to_array(py, &bounds, [m, 2])?.into_any()],
        )
    }

    /// `SelfMotion.best` for many poses.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or a list of SE3-like objects.
    ///     criterion: Decides which configuration is best.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, criterion, *, threads=None))]
    fn best_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        criterion: Given<'py, PyCriterion>,
        threads: Option<Threads>,
    ) -> PyResult<PyChoiceBatch> {
        let poses = Batch::read(poses)?;
        let watching = Watching::criterion(Some(criterion.get()));
        let criterion = &*criterion.get().criterion;
        let mut rows = Vec::with_capacity(poses.len());
        let data = poses.as_slice()?;
        in_blocks_watching(py, poses.len(), SEARCH_BLOCK, threads, &watching, |r| {
            rows.extend(self.arm.best_batch(&data[r.start * 16..r.end * 16], criterion)?);
            Ok(())
        })?;
        PyChoiceBatch::new(py, &rows)
    }

    /// The configuration `(7,)` for the pose within the limits with the least distance to `q`, windings included.
    ///
    /// `None` when there is none: `self_motion(pose).reason` says why. A batch of poses gives a `ChoiceBatch`.
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
        let poses = read_poses(pose)?;
        if poses.batch.is_some() {
            let batch = Py::new(py, self.nearest_batch(py, pose, q, threads)?)?;
            return Ok(Some(batch.into_bound(py).into_any()));
        }
        let q = read_vector(q, "q", Some(7))?;
        let motion = self.arm.self_motion(&read_pose(pose)?).map_err(to_py)?;
        let choice = motion.nearest(&q).map_err(to_py)?;
        Ok(choice.map(|c| PyArray1::from_slice(py, &c.q).into_any()))
    }

    /// `nearest` for many poses, to one `q` `(7,)` or one each `(N, 7)`.
    ///
    /// Args:
    ///     poses: `(N, 4, 4)`, or a list of SE3-like objects.
    ///     q: `(7,)` or `(N, 7)`, rad.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (poses, q, *, threads=None))]
    fn nearest_batch<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<PyChoiceBatch> {
        let poses = Batch::read(poses)?;
        let wish = read_rows(q, "q", &[7])?;
        if wish.batch.is_some_and(|m| m != poses.len()) {
            let actual = wish.batch.unwrap_or(1);
            return Err(to_py(Error::Length { what: "rows of q".into(), expected: poses.len(), actual }));
        }
        let (data, single) = (poses.as_slice()?, wish.batch.is_none());
        let wish = wish.as_slice()?;
        let mut rows = Vec::with_capacity(poses.len());
        in_blocks(py, poses.len(), SEARCH_BLOCK, threads, |r| {
            let wish = if single { wish } else { &wish[r.start * 7..r.end * 7] };
            rows.extend(self.arm.nearest_batch(&data[r.start * 16..r.end * 16], wish)?);
            Ok(())
        })?;
        PyChoiceBatch::new(py, &rows)
    }

    /// Swivel angle of a configuration, rad in (-pi, pi]; `(N,)` for `(N, 7)`.
    ///
    /// Args:
    ///     q: Joint positions `(7,)` or `(N, 7)`, rad.
    fn swivel<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = read_rows(q, "q", &[7])?;
        let values: Vec<f64> = rows
            .as_slice()?
            .chunks_exact(7)
            .map(|q| self.arm.swivel(q))
            .collect::<Result<_, _>>()
            .map_err(to_py)?;
        match rows.batch {
            None => Ok(values[0].into_pyobject(py)?.into_any()),
            Some(_) => Ok(PyArray1::from_vec(py, values).into_any()),
        }
    }

    /// Signs (shoulder, elbow, wrist) of a configuration; `(N, 3)` for `(N, 7)`.
    ///
    /// Args:
    ///     q: Joint positions `(7,)` or `(N, 7)`, rad.
    fn branch<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = read_rows(q, "q", &[7])?;
        let signs: Vec<[i8; 3]> = rows
            .as_slice()?
            .chunks_exact(7)
            .map(|q| self.arm.branch(q))
            .collect::<Result<_, _>>()
            .map_err(to_py)?;
        match rows.batch {
            None => Ok(PyTuple::new(py, signs[0])?.into_any()),
            Some(n) => Ok(to_array(py, signs.as_flattened(), [n, 3])?.into_any()),
        }
    }

    /// Every configuration for a pose, as an object.
    fn self_motion(this: &Bound<'_, Self>, pose: &Bound<'_, PyAny>) -> PyResult<PySelfMotion> {
        let pose = read_pose(pose)?;
        let motion = this.get().arm.self_motion(&pose).map_err(to_py)?;
        Ok(PySelfMotion { motion: Arc::new(Motion { motion, arm: this.clone().unbind(), pose }) })
    }

    /// The difference between a swivel in `other`'s chart and in this chart at the same pose, rad.
    fn chart_change(&self, other: &Bound<'_, Self>, pose: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.arm.chart_change(&other.get().arm, &read_pose(pose)?).map_err(to_py)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let arm = this.get();
        let arguments =
            (arm.chain.clone_ref(this.py()), arm.chart.as_str(), arm.reference.map(|r| r.to_vec()));
        (this.get_type(), arguments).into_pyobject(this.py())
    }

    fn __repr__(&self) -> String {
        let (upper, fore) = self.lengths();
        let defect = self.arm.defect();
        format!(
            "SrsArm('{}', upper arm {upper:.6} m, forearm {fore:.6} m, chart '{}', defect {:.1e} m {:.1e} rad)",
            self.arm.chain().name(),
            self.chart,
            defect.position,
            defect.orientation
        )
    }
}

/// Poses `(N, 4, 4)`; a single pose counts as N = 1.
pub struct Batch<'py>(crate::convert::Rows<'py>);

impl<'py> Batch<'py> {
    pub fn read(poses: &Bound<'py, PyAny>) -> PyResult<Self> {
        read_poses(poses).map(Self)
    }

    pub fn len(&self) -> usize {
        self.0.batch.unwrap_or(1)
    }

    pub fn as_slice(&self) -> PyResult<&[f64]> {
        self.0.as_slice()
    }
}

/// An angle, or the vector u = (cos s, sin s).
fn read_swivel(object: &Bound<'_, PyAny>) -> PyResult<Swivel> {
    if let Ok(angle) = object.extract::<f64>() {
        return Ok(Swivel::Angle(angle));
    }
    let [x, y] = read_array::<2>(object, "swivel")?;
    Ok(Swivel::Direction(x, y))
}

/// One angle, N angles, or N vectors (cos s, sin s).
fn read_swivels(object: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<f64>> {
    if let Ok(angle) = object.extract::<f64>() {
        return Ok(vec![angle]);
    }
    let rows = read_rows(object, "swivels", &[n]).or_else(|_| read_rows(object, "swivels", &[n, 2]))?;
    let values = rows.as_slice()?;
    Ok(if values.len() == 2 * n && n > 0 {
        values.chunks_exact(2).map(|u| u[1].atan2(u[0])).collect()
    } else {
        values.to_vec()
    })
}

/// Checks an array that the caller wants filled.
fn output<'py, T: numpy::Element>(
    object: &Bound<'py, PyAny>,
    what: &str,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let array = object.cast::<PyArrayDyn<T>>().map_err(|_| {
        to_py(Error::Invalid(format!("{what} must be an array of doubles (q) or of bool (valid)")))
    })?;
    if array.shape() != shape || !array.is_c_contiguous() {
        let message =
            format!("{what} must be C-contiguous of shape {shape:?}, it has shape {:?}", array.shape());
        return Err(to_py(Error::Invalid(message)));
    }
    Ok(array.clone())
}

/// A circle of solutions with what it was made from, which is what it pickles as.
struct Motion {
    motion: SelfMotion,
    arm: Py<PySrsArm>,
    pose: Pose,
}

impl std::ops::Deref for Motion {
    type Target = SelfMotion;

    fn deref(&self) -> &SelfMotion {
        &self.motion
    }
}

/// A method of the Python object of `motion`, for `__reduce__`.
fn method_of<'py>(py: Python<'py>, motion: &Arc<Motion>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    Py::new(py, PySelfMotion { motion: motion.clone() })?.bind(py).getattr(name)
}

/// Result of `solve_batch` of an arm with a closed form, and of `nearest` for many poses.
#[pyclass(name = "SolveBatch", module = "redundancy", frozen)]
pub struct PySolveBatch {
    pub q: Py<PyArrayDyn<f64>>,
    pub valid: Py<PyArrayDyn<bool>>,
}

#[pymethods]
impl PySolveBatch {
    /// `(N, 8, n)` in branch order, `(N, n)` for `nearest`; rows that are not valid are unspecified but finite.
    #[getter]
    fn q(&self, py: Python<'_>) -> Py<PyArrayDyn<f64>> {
        self.q.clone_ref(py)
    }

    /// `(N, 8)`, `(N,)` for `nearest`.
    #[getter]
    fn valid(&self, py: Python<'_>) -> Py<PyArrayDyn<bool>> {
        self.valid.clone_ref(py)
    }

    #[staticmethod]
    fn _restore(q: Py<PyArrayDyn<f64>>, valid: Py<PyArrayDyn<bool>>) -> Self {
        Self { q, valid }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let restore = py.get_type::<Self>().getattr("_restore")?;
        (restore, (self.q.clone_ref(py), self.valid.clone_ref(py))).into_pyobject(py)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let rows = self.q.bind(py).shape()[0];
        let valid = self.valid.bind(py).readonly();
        let solved = valid.as_array().outer_iter().filter(|row| row.iter().any(|valid| *valid)).count();
        format!("SolveBatch({rows} poses, {solved} with a configuration)")
    }
}

/// A configuration chosen for a pose; its parts are `None` if no configuration is within the limits.
#[pyclass(name = "Choice", module = "redundancy", frozen)]
pub struct PyChoice {
    choice: Option<Choice>,
    motion: Arc<Motion>,
}

#[pymethods]
impl PyChoice {
    /// Joint positions `(7,)`, rad.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.choice.map(|c| PyArray1::from_slice(py, &c.q))
    }

    /// Its swivel, rad in (-pi, pi].
    #[getter]
    fn swivel(&self) -> Option<f64> {
        self.choice.map(|c| c.swivel)
    }

    /// Its signs (shoulder, elbow, wrist).
    #[getter]
    fn branch<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyTuple>>> {
        self.choice.map(|c| PyTuple::new(py, signs_of(c.branch))).transpose()
    }

    /// The criterion there, in its own unit.
    #[getter]
    fn value(&self) -> Option<f64> {
        self.choice.map(|c| c.value)
    }

    /// `converged`, `limits` or `unreachable`.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.motion.status())
    }

    /// Why there is none, or why it is not proven to be the best; empty otherwise.
    #[getter]
    fn reason(&self) -> String {
        let reason = self.motion.reason();
        if reason.is_empty() && !self.proven() {
            return "the best of a dense scan of the branches, refined".into();
        }
        reason
    }

    /// Whether it is certain that no configuration for the pose is better, or that there is none.
    ///
    /// False for criteria without bounds, and at gimbals that leave joints free.
    #[getter]
    fn proven(&self) -> bool {
        self.choice.map_or_else(|| self.motion.proven(), |c| c.proven)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let parts = self.choice.map(|c| (c.q, c.swivel, c.branch, c.value, c.proven));
        (method_of(py, &self.motion, "_choice")?, (parts,)).into_pyobject(py)
    }

    fn __repr__(&self) -> String {
        match &self.choice {
            Some(c) => format!(
                "Choice(value {:.6e} at swivel {:.6} of branch {:?})",
                c.value,
                c.swivel,
                signs_of(c.branch)
            ),
            None => format!("Choice({}: {})", self.motion.status(), self.motion.reason()),
        }
    }
}

pub fn signs_of(branch: usize) -> [i8; 3] {
    [4, 2, 1].map(|bit| if branch & bit == 0 { 1 } else { -1 })
}

/// Choices for many poses.
#[pyclass(name = "ChoiceBatch", module = "redundancy", frozen, get_all)]
pub struct PyChoiceBatch {
    /// `(N, 7)`; rows that are not valid are 0.
    q: Py<PyArray2<f64>>,
    /// `(N,)`, rad.
    swivel: Py<PyArray1<f64>>,
    /// `(N, 3)` signs.
    branch: Py<PyArray2<i8>>,
    /// `(N,)`.
    value: Py<PyArray1<f64>>,
    /// `(N,)`: there is a configuration within the limits.
    valid: Py<PyArray1<bool>>,
    /// `(N,)`: there is one, and no other for the pose is better.
    proven: Py<PyArray1<bool>>,
}

impl PyChoiceBatch {
    fn new(py: Python<'_>, rows: &[Option<Choice>]) -> PyResult<Self> {
        let n = rows.len();
        let (mut q, mut signs) = (vec![[0.0; 7]; n], vec![[0i8; 3]; n]);
        for (i, choice) in rows.iter().enumerate().filter_map(|(i, c)| c.as_ref().map(|c| (i, c))) {
            (q[i], signs[i]) = (choice.q, signs_of(choice.branch));
        }
        let column =
            |f: fn(&Choice) -> f64| PyArray1::from_iter(py, rows.iter().map(|c| c.as_ref().map_or(0.0, f)));
        Ok(Self {
            q: to_array(py, q.as_flattened(), [n, 7])?.unbind(),
            swivel: column(|c| c.swivel).unbind(),
            branch: to_array(py, signs.as_flattened(), [n, 3])?.unbind(),
            value: column(|c| c.value).unbind(),
            valid: PyArray1::from_iter(py, rows.iter().map(Option::is_some)).unbind(),
            proven: PyArray1::from_iter(py, rows.iter().map(|c| c.is_some_and(|c| c.proven))).unbind(),
        })
    }
}

#[pymethods]
impl PyChoiceBatch {
    #[staticmethod]
    fn _restore(
        q: Py<PyArray2<f64>>,
        swivel: Py<PyArray1<f64>>,
        branch: Py<PyArray2<i8>>,
        value: Py<PyArray1<f64>>,
        valid: Py<PyArray1<bool>>,
        proven: Py<PyArray1<bool>>,
    ) -> Self {
        Self { q, swivel, branch, value, valid, proven }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let restore = py.get_type::<Self>().getattr("_restore")?;
        let (q, swivel, branch) =
            (self.q.clone_ref(py), self.swivel.clone_ref(py), self.branch.clone_ref(py));
        let (valid, proven) = (self.valid.clone_ref(py), self.proven.clone_ref(py));
        (restore, (q, swivel, branch, self.value.clone_ref(py), valid, proven)).into_pyobject(py)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let valid = self.valid.bind(py).readonly();
        let chosen = valid.as_array().iter().filter(|valid| **valid).count();
        format!("ChoiceBatch({} poses, {chosen} with a configuration)", self.valid.bind(py).len())
    }
}

/// Every configuration for one pose: up to eight circles.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.SrsArm(rd.catalog.load("pa10"))
///     >>> motion = arm.self_motion(arm.chain.forward([0.1, 0.5, 0.2, 1.2, 0.3, 0.8, 0.0]))
///     >>> print(motion.status, len(motion.branches))
///     converged 8
///     >>> motion.best(rd.JointRange(arm.chain)).q.shape
///     (7,)
#[pyclass(name = "SelfMotion", module = "redundancy", frozen)]
pub struct PySelfMotion {
    motion: Arc<Motion>,
}

#[pymethods]
impl PySelfMotion {
    /// `converged`, `unreachable` (no configuration) or `limits` (none within the joint limits).
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.motion.status())
    }

    /// Why there is none: too far or too near by how many mm, or which joint is outside by how much even at best.
    ///
    /// If the status is not `proven`, also why. Empty otherwise.
    #[getter]
    fn reason(&self) -> String {
        self.motion.reason()
    }

    /// Whether status and branches are exact.
    ///
    /// False for an arm with a defect above 1e-9, and if shoulder or wrist reach a gimbal for this pose: there only
    /// the sum of the outer joints is determined, so there are configurations besides the branches.
    #[getter]
    fn proven(&self) -> bool {
        self.motion.proven()
    }

    /// Centre of the elbow's circle in the world, `(3,)`, m (Moore & Oztop 2010, fig. 3).
    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.motion.center().as_slice())
    }

    /// Unit vector from shoulder to wrist in the world, `(3,)`: the paper's n, the axis of the elbow's circle.
    #[getter]
    fn axis<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.motion.axis().as_slice())
    }

    /// Radius of the elbow's circle, m: the paper's rho; 0 for the stretched and the folded arm.
    #[getter]
    fn radius(&self) -> f64 {
        self.motion.radius()
    }

    /// Axes `[x, y, k]` in the world, `(3, 3)`, of the frame in which the paper's quaternions are written.
    ///
    /// k is the axis of joint 1 (or the chart's reference), x the base's x projected: for a PA10 that stands at the
    /// origin the identity.
    #[getter]
    fn frame<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.motion.frame().transpose().as_slice(), [3, 3])
    }

    /// The paper's q_A (eq. 14), `(w, x, y, z)`: turns x, y, k into the directions of s = 0, s = pi/2 and n.
    ///
    /// Its angle is `acos(k . n)`; the vector part is along k x n.
    #[getter]
    fn q_a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &to_wxyz(&self.motion.q_a()))
    }

    /// The elbow in the world at a swivel: the paper's p_E (eq. 15).
    ///
    /// It lies on the sphere of the upper arm around the shoulder. For an arm with elbow offset it is the point of
    /// the elbow's axis nearest to shoulder and wrist.
    ///
    /// Args:
    ///     s: Swivel, rad, or `(N,)`.
    ///
    /// Returns:
    ///     `(3,)` or `(N, 3)`, m.
    ///
    /// Raises:
    ///     RedundancyError: A swivel that is not finite.
    fn elbow<'py>(&self, py: Python<'py>, s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        rows_of(py, s, |s| Ok(self.motion.elbow_position(s).into()))
    }

    /// The distinct circles: 8; 4 for the stretched and the folded arm; none if the pose is out of reach.
    #[getter]
    fn branches(&self) -> Vec<PyBranch> {
        let branches = self.motion.branches();
        branches.iter().map(|b| PyBranch { motion: self.motion.clone(), index: b.index() }).collect()
    }

    /// The best configuration over all branches, feasible arcs and windings.
    ///
    /// For joint range, posture and their sums the optimum is proven by bounds; for other criteria every stationary
    /// point that a piecewise cubic resolves is compared.
    ///
    /// Args:
    ///     criterion: A criterion of the same arm.
    fn best(&self, py: Python<'_>, criterion: Given<'_, PyCriterion>) -> PyResult<PyChoice> {
        let watching = Watching::criterion(Some(criterion.get()));
        let criterion = &*criterion.get().criterion;
        let choice = watching.detach(py, || self.motion.best(criterion));
        watching.check(py)?;
        let choice = choice.map_err(to_py)?;
        Ok(PyChoice { choice, motion: self.motion.clone() })
    }

    /// The configuration with the least Euclidean distance to `q`, which is the `value`.
    ///
    /// Args:
    ///     q: Joint positions `(7,)`, rad.
    fn nearest(&self, q: &Bound<'_, PyAny>) -> PyResult<PyChoice> {
        let q = read_vector(q, "q", Some(7))?;
        Ok(PyChoice { choice: self.motion.nearest(&q).map_err(to_py)?, motion: self.motion.clone() })
    }

    fn _branch(&self, index: usize) -> PyResult<PyBranch> {
        self.motion.branch(index).map_err(to_py)?;
        Ok(PyBranch { motion: self.motion.clone(), index })
    }

    fn _choice(&self, parts: Option<([f64; 7], f64, usize, f64, bool)>) -> PyChoice {
        let choice =
            parts.map(|(q, swivel, branch, value, proven)| Choice { q, swivel, branch, value, proven });
        PyChoice { choice, motion: self.motion.clone() }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let make = self.motion.arm.bind(py).getattr("self_motion")?;
        (make, (pose_to_array(py, &self.motion.pose)?,)).into_pyobject(py)
    }

    fn __repr__(&self) -> String {
        let reason = self.motion.reason();
        let text =
            if reason.is_empty() { format!("{} branches", self.motion.branches().len()) } else { reason };
        format!("SelfMotion({}: {text})", self.motion.status())
    }

    /// For notebooks: the branches with their feasible arcs.
    fn _repr_html_(&self) -> PyResult<String> {
        let mut rows = Vec::new();
        for branch in self.motion.branches() {
            let arcs = branch.intervals(0.0).map_err(to_py)?;
            let arcs: Vec<String> = arcs.iter().map(|[lo, hi]| format!("[{lo:.4}, {hi:.4}]")).collect();
            let arcs = if arcs.is_empty() { "none".to_owned() } else { arcs.join(", ") };
            rows.push(html::entry(&format!("{:?}", signs_of(branch.index())), arcs));
        }
        let head = ["shoulder, elbow, wrist", "swivel within the joint limits, rad"];
        Ok(html::table(&self.__repr__(), &head, &rows))
    }
}

/// One circle of configurations with fixed signs, parametrised by the swivel.
#[pyclass(name = "Branch", module = "redundancy", frozen)]
pub struct PyBranch {
    motion: Arc<Motion>,
    index: usize,
}

impl PyBranch {
    /// Evaluates `one` at an angle or at each of an array.
    fn at<'py>(
        &self,
        py: Python<'py>,
        s: &Bound<'py, PyAny>,
        one: impl Fn(redundancy_core::solutions::Branch<'_>, f64) -> redundancy_core::Result<[f64; 7]>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let branch = self.motion.branch(self.index).map_err(to_py)?;
        rows_of(py, s, |s| one(branch, s))
    }
}

/// Evaluates `one` at an angle `(W,)`, or at each of an array `(N, W)`.
fn rows_of<'py, const W: usize>(
    py: Python<'py>,
    s: &Bound<'py, PyAny>,
    one: impl Fn(f64) -> redundancy_core::Result<[f64; W]>,
) -> PyResult<Bound<'py, PyAny>> {
    let finite = |s: f64| match s.is_finite() {
        true => one(s),
        false => Err(redundancy_core::Error::NotFinite { what: "s".into(), index: 0, value: s }),
    };
    if let Ok(s) = s.extract::<f64>() {
        return Ok(PyArray1::from_slice(py, &finite(s).map_err(to_py)?).into_any());
    }
    let rows: Vec<[f64; W]> = read_vector(s, "s", None)?
        .into_iter()
        .map(finite)
        .collect::<redundancy_core::Result<_>>()
        .map_err(to_py)?;
    Ok(to_array(py, rows.as_flattened(), [rows.len(), W])?.into_any())
}

#[pymethods]
impl PyBranch {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (method_of(py, &self.motion, "_branch")?, (self.index,)).into_pyobject(py)
    }

    /// Signs of theta2, theta4, theta6 (shoulder, elbow, wrist).
    #[getter]
    fn signs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, signs_of(self.index))
    }

    /// `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
    #[getter]
    fn index(&self) -> usize {
        self.index
    }

    /// Configuration at swivel `s` (rad): `(7,)`, or `(N, 7)` for `(N,)`.
    ///
    /// Principal values, unless these violate a limit and another winding does not.
    fn q<'py>(&self, py: Python<'py>, s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.at(py, s, |branch, s| branch.q(s))
    }

    /// dq/ds, `(7,)` or `(N, 7)`: in the kernel of the Jacobian.
    ///
    /// Args:
    ///     s: Swivel, rad: a number or `(N,)`.
    fn tangent<'py>(&self, py: Python<'py>, s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.at(py, s, |branch, s| branch.tangent(s))
    }

    /// Every configuration within the limits at a swivel: all windings of all joints.
    ///
    /// Args:
    ///     s: Swivel, rad.
    ///
    /// Returns:
    ///     `(k, 7)`, ascending by the first joint that differs; joints without limits keep their principal value.
    ///     `(0, 7)` if the branch is outside the limits at this swivel.
    ///
    /// Raises:
    ///     RedundancyError: A swivel that is not finite.
    fn windings<'py>(&self, py: Python<'py>, s: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.motion.branch(self.index).and_then(|branch| branch.windings(s)).map_err(to_py)?;
        to_array(py, rows.as_flattened(), [rows.len(), 7])
    }

    /// The paper's quaternions at a swivel (Moore & Oztop 2010, eqs 22 to 27), in `SelfMotion.frame`.
    ///
    /// Args:
    ///     s: Swivel, rad, or `(N,)`.
    ///
    /// Returns:
    ///     `(q_3, q_4, conj(q_4) q)`, each `(4,)` or `(N, 4)`, `(w, x, y, z)`: the orientations of upper arm and
    ///     forearm, z along the link and y along the axis of joint 4, and the rotation of joints 5 to 7.
    ///
    /// Raises:
    ///     RedundancyError: A swivel that is not finite.
    fn quaternions<'py>(&self, py: Python<'py>, s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyTuple>> {
        let branch = self.motion.branch(self.index).map_err(to_py)?;
        let parts = [0, 1, 2].map(|part| {
            rows_of(py, s, |s| {
                let all = branch.quaternions(s);
                Ok(to_wxyz(&[all.q3, all.q4, all.wrist][part]))
            })
        });
        let [q3, q4, wrist] = parts;
        PyTuple::new(py, [q3?, q4?, wrist?])
    }

    /// Intervals of the swivel in which all joints keep `margin` (rad) from their limits: `(k, 2)`, exact.
    ///
    /// `[lo, hi]` contains s when `(s - lo) mod 2 pi <= hi - lo`.
    #[pyo3(signature = (margin=0.0))]
    fn intervals<'py>(&self, py: Python<'py>, margin: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let branch = self.motion.branch(self.index).map_err(to_py)?;
        let rows = branch.intervals(margin).map_err(to_py)?;
        to_array(py, rows.as_flattened(), [rows.len(), 2])
    }

    fn __repr__(&self) -> String {
        format!("Branch(signs {:?})", signs_of(self.index))
    }
}
