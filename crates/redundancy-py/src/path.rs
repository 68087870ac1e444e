//! `Path`, `paths`, `Trajectory`: what comes in and what goes out.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple, PyType};
use redundancy_core::nalgebra::{Matrix3, Rotation3, Translation3, Vector3};
use redundancy_core::path::{
    Circle, Event, Path, PathPiece, Raster, Section, Shape, TimingSettings, Trajectory, times_within_limits,
};
use redundancy_core::rotation::from_rounded_wxyz;
use redundancy_core::{Error, Pose, pose_from_row_major, pose_to_row_major, rotation_from_matrix};

use crate::convert::{
    Argument, Fresh, Integer, read_array, read_numbers, read_pose, read_rows, read_vector, to_array,
};
use crate::error::to_py;
use crate::html;
use crate::status::event_kind_to_py;

/// Tool poses, or positions with the orientation left open, in the order of arc length.
///
/// Between the samples the path is a C2 curve: a cubic spline with not-a-knot ends through positions and through unit
/// quaternions; circle and raster of `redundancy.paths` keep their analytic curve. Immutable.
///
/// A rotation that is off by up to 1e-3 (largest deviation of a singular value from 1), and a quaternion whose norm is
/// within 1e-3 of 1, is replaced by the nearest one; beyond that it is refused with the measured value.
///
/// Args:
///     poses: `(N, 4, 4)`, a list of SE3-like objects, or `(N, 3)` positions, m.
///     s: `(N,)` arc length, m; summed from the distances when left out.
///     t: `(N,)` times, s, increasing; a path without times gets them from the arm's velocity limits.
///     positions: `(N, 3)`, m, instead of `poses`.
///     quaternions_wxyz: `(N, 4)`, scalar first, beside `positions`, or `(4,)` for all; a path of positions when left
///         out.
///
/// Raises:
///     RedundancyError: Fewer than two samples, invalid poses, lengths that differ, `s` or `t` that do not increase.
///
/// Example:
///     >>> import redundancy as rd
///     >>> path = rd.Path([[0.3, 0.0, 0.5], [0.4, 0.0, 0.5], [0.4, 0.2, 0.5]])
///     >>> path.has_orientation, round(path.length, 12)
///     (False, 0.3)
///     >>> down = rd.Path(positions=[[0.3, 0.0, 0.5], [0.4, 0.0, 0.5]], quaternions_wxyz=[0, 1, 0, 0])
///     >>> down.poses[1, :3, 2].tolist()
///     [0.0, 0.0, -1.0]
#[pyclass(name = "Path", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyPath {
    pub path: Path,
}

impl From<Path> for PyPath {
    fn from(path: Path) -> Self {
        Self { path }
    }
}

impl Argument for PyPath {
    const WHAT: &'static str = "a Path";
    const HOW: &'static str =
        "rd.Path(poses) makes one of poses (N, 4, 4) or positions (N, 3), rd.Path.from_csv(file) reads one";
}

#[pymethods]
impl PyPath {
    #[new]
    #[pyo3(signature = (poses=None, s=None, t=None, *, positions=None, quaternions_wxyz=None))]
    fn new(
        poses: Option<&Bound<'_, PyAny>>,
        s: Option<&Bound<'_, PyAny>>,
        t: Option<&Bound<'_, PyAny>>,
        positions: Option<&Bound<'_, PyAny>>,
        quaternions_wxyz: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let s = s.map(|s| read_vector(s, "s", None)).transpose()?;
        let t = t.map(|t| read_vector(t, "t", None)).transpose()?;
        let samples = match (poses, positions, quaternions_wxyz) {
            (Some(poses), None, None) => Samples::read(poses)?,
            (None, Some(positions), quaternions) => Samples::placed(positions, quaternions)?,
            (None, None, None) => {
                let message = "give poses, or positions (and quaternions_wxyz)";
                return Err(to_py(Error::Invalid(message.into())));
            }
            (Some(_), ..) => {
                let message = "give either poses or positions and quaternions_wxyz, not both";
                return Err(to_py(Error::Invalid(message.into())));
            }
            (None, None, Some(_)) => {
                let message = "quaternions_wxyz need positions (N, 3) as well";
                return Err(to_py(Error::Invalid(message.into())));
            }
        };
        let path = match samples {
            Samples::Poses(poses) => Path::new(&poses, s.as_deref(), t.as_deref()),
            Samples::Positions(positions) => Path::from_positions(&positions, s.as_deref(), t.as_deref()),
        };
        path.map(Self::from).map_err(to_py)
    }

    /// Read a CSV file with a header line and the columns `x,y,z`, `qw,qx,qy,qz` and, where wanted, `s` and `t`.
    ///
    /// The order of the columns is arbitrary; metres, seconds. The four quaternion columns may be absent together: a
    /// path of positions. Quaternions within 1e-3 of unit norm are normalised.
    ///
    /// Raises:
    ///     FileFormatError: What is wrong, with the file's name and line.
    #[staticmethod]
    fn from_csv(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Path::from_csv(path)).map(Self::from).map_err(to_py)
    }

    /// Write the samples as `from_csv` reads them.
    ///
    /// Args:
    ///     path: The file to write.
    fn to_csv(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.path.to_csv(path)).map_err(to_py)
    }

    /// Arc length of each sample `(N,)`, m. A copy.
    #[getter]
    fn s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.path.s())
    }

    /// Time of each sample `(N,)`, s, where the path has times. A copy.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.path.t().map(|t| PyArray1::from_slice(py, t))
    }

    /// The samples `(N, 4, 4)`; the rotation is the identity on a path of positions. A copy.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let mut array = Fresh::new(py, [self.path.len(), 4, 4]);
        for (row, pose) in array.memory()?.chunks_exact_mut(16).zip(self.path.poses()) {
            row.copy_from_slice(&pose_to_row_major(pose));
        }
        Ok(array.finish())
    }

    /// The samples' positions `(N, 3)`, m. A copy.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut array = Fresh::new(py, [self.path.len(), 3]);
        for (row, pose) in array.memory()?.chunks_exact_mut(3).zip(self.path.poses()) {
            row.copy_from_slice(pose.translation.vector.as_slice());
        }
        Ok(array.finish())
    }

    /// Arc length from the first to the last sample, m.
    #[getter]
    fn length(&self) -> f64 {
        self.path.length()
    }

    /// False for a path of positions, whose orientation is open.
    #[getter]
    fn has_orientation(&self) -> bool {
        self.path.has_orientation()
    }

    /// Pose on the curve.
    ///
    /// Args:
    ///     s: Arc length, m: a number or `(N,)`.
    ///
    /// Returns:
    ///     `(4, 4)` or `(N, 4, 4)`.
    ///
    /// Raises:
    ///     RedundancyError: `s` is not on the path.
    fn pose<'py>(&self, py: Python<'py>, s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let at = read_rows(s, "s", &[])?;
        let shape = at.batch.map_or(vec![4, 4], |n| vec![n, 4, 4]);
        let mut values = Vec::with_capacity(16 * at.batch.unwrap_or(1));
        for s in at.as_slice()? {
            values.extend(pose_to_row_major(&self.path.at(*s).map_err(to_py)?.pose));
        }
        shaped(py, &values, &shape)
    }

    /// First and second derivative with respect to arc length, linear first, angular second, in base axes.
    ///
    /// $(p', \omega)$ in 1 and rad/m, $(p'', \omega')$ in 1/m and rad/m^2, with $\dot Q = \tfrac12 (0, \omega) Q$.
    ///
    /// Args:
    ///     s: Arc length, m: a number or `(N,)`.
    ///
    /// Returns:
    ///     Two arrays `(6,)` or `(N, 6)`.
    fn derivatives<'py>(
        &self,
        py: Python<'py>,
        s: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let at = read_rows(s, "s", &[])?;
        let shape = at.batch.map_or(vec![6], |n| vec![n, 6]);
        let (mut first, mut second) = (Vec::new(), Vec::new());
        for s in at.as_slice()? {
            let point = self.path.at(*s).map_err(to_py)?;
            first.extend(point.derivative.iter());
            second.extend(point.second_derivative.iter());
        }
        Ok((shaped(py, &first, &shape)?, shaped(py, &second, &shape)?))
    }

    /// The same curve sampled about every `step` metres; times are interpolated linearly.
    ///
    /// Where pieces of a joined path meet, there is a sample.
    fn resampled(&self, step: f64) -> PyResult<Self> {
        self.path.resampled(step).map(Self::from).map_err(to_py)
    }

    /// The path moved by a rigid transform: every pose `T` becomes `pose @ T`.
    ///
    /// Circle and raster stay analytic; arc lengths and times are kept.
    fn transformed(&self, pose: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.path.transformed(&read_pose(pose)?).map(Self::from).map_err(to_py)
    }

    /// The path from its end to its start, with the same orientations.
    ///
    /// Circle and raster stay analytic. Arc lengths and times start where they started, and each section takes as long
    /// as before.
    fn reversed(&self) -> PyResult<Self> {
        self.path.reversed().map(Self::from).map_err(to_py)
    }

    /// This path and then `other`, each with its own curve, so with a corner where they do not meet smoothly.
    ///
    /// If `other` starts at the pose at which this path ends, they share the sample. If it starts elsewhere, a
    /// straight line with the shorter rotation leads there. Times of `other` are shifted so that it starts when this
    /// path ends; across a gap they are kept and must leave time for it.
    ///
    /// Raises:
    ///     RedundancyError: Only one of the two paths has orientations, or times; a gap without time for it.
    ///
    /// Example:
    ///     >>> import redundancy as rd
    ///     >>> stroke = rd.Path([[0.3, 0.0, 0.5], [0.5, 0.0, 0.5]])
    ///     >>> there_and_back = stroke.joined(stroke.reversed())
    ///     >>> len(there_and_back), round(there_and_back.length, 12)
    ///     (3, 0.4)
    fn joined(&self, other: &Self) -> PyResult<Self> {
        self.path.joined(&other.path).map(Self::from).map_err(to_py)
    }

    /// The same positions with other orientations.
    ///
    /// Args:
    ///     orientation: `(3, 3)` or a pose: everywhere the same; `(N, 3, 3)`: one per sample; a callable from
    ///         positions `(N, 3)` to rotations `(N, 3, 3)`.
    fn with_orientation(&self, orientation: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.oriented(Some(orientation)).map(Self::from)
    }

    /// The same path with other times `(N,)`, s, or none.
    ///
    /// Args:
    ///     t: `(N,)`, s, increasing; None removes the times.
    #[pyo3(signature = (t))]
    fn with_times(&self, t: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let t = t.map(|t| read_vector(t, "t", None)).transpose()?;
        self.path.with_times(t.as_deref()).map(Self::from).map_err(to_py)
    }

    fn __len__(&self) -> usize {
        self.path.len()
    }

    fn __repr__(&self) -> String {
        let kind = match self.path.shape() {
            Shape::Circle(_) => "circle",
            Shape::Raster(_) => "raster",
            Shape::Joined => "joined paths",
            _ => "spline",
        };
        let what = if self.path.has_orientation() { "poses" } else { "positions" };
        let timed = self.path.t().map_or(String::new(), |t| format!(", {} s", t[t.len() - 1] - t[0]));
        format!("Path({kind} through {} {what}, {} m{timed})", self.path.len(), self.path.length())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, PathParts)> {
        Ok((py.get_type::<Self>().getattr("_from_parts")?, PathParts::of(&self.path)))
    }

    /// Inverse of pickling.
    #[classmethod]
    #[pyo3(signature = (*parts))]
    fn _from_parts(_class: &Bound<'_, PyType>, parts: PathParts) -> PyResult<Self> {
        parts.build().map(Self::from).map_err(to_py)
    }
}

impl PyPath {
    /// The path with an orientation: none, one rotation or pose, one per sample, or a rule for positions.
    fn oriented(&self, orientation: Option<&Bound<'_, PyAny>>) -> PyResult<Path> {
        let Some(orientation) = orientation else { return Ok(self.path.clone()) };
        let py = orientation.py();
        let given = if orientation.is_callable() && !orientation.hasattr(pyo3::intern!(py, "as_matrix"))? {
            orientation.call1((self.positions(py)?,))?
        } else {
            orientation.clone()
        };
        let rotations = read_rotations(&given)?;
        match rotations.as_slice() {
            [rotation] => self.path.with_orientation(rotation),
            many => self.path.with_orientations(many),
        }
        .map_err(to_py)
    }
}

/// What a path can be made of.
enum Samples {
    Poses(Vec<Pose>),
    Positions(Vec<Vector3<f64>>),
}

impl Samples {
    fn read(object: &Bound<'_, PyAny>) -> PyResult<Self> {
        // A list of SE3-like objects; lists of numbers go the way of arrays.
        if let Ok(list) = object.cast::<PyList>()
            && let Ok(first) = list.get_item(0)
            && ["homogeneous", "as_matrix", "A"].iter().any(|name| first.hasattr(*name).unwrap_or(false))
        {
            return Ok(Self::Poses(list.iter().map(|item| read_pose(&item)).collect::<PyResult<_>>()?));
        }
        let (array, shape) = read_numbers(object, "poses")?;
        let array = array.try_readonly()?;
        let values = array.as_slice()?;
        match shape[..] {
            [_, 3] => {
                let positions = values.chunks_exact(3).map(Vector3::from_column_slice);
                Ok(Self::Positions(positions.collect()))
            }
            [_, 4, 4] | [4, 4] => {
                let poses = values.chunks_exact(16).enumerate().map(|(i, row)| {
                    pose_from_row_major(row)
                        .map_err(|error| to_py(Error::Invalid(format!("poses[{i}]: {error}"))))
                });
                Ok(Self::Poses(poses.collect::<PyResult<_>>()?))
            }
            _ => {
                let shape = PyTuple::new(object.py(), &shape)?;
                let message = format!("poses has shape {shape}, expected (N, 4, 4) or positions (N, 3)");
                Err(to_py(Error::Invalid(message)))
            }
        }
    }

    /// From positions `(N, 3)` and, where given, quaternions `(N, 4)` or one for all.
    fn placed(positions: &Bound<'_, PyAny>, quaternions: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let rows = read_rows(positions, "positions", &[3])?;
        let Some(n) = rows.batch else {
            return Err(to_py(Error::Invalid("positions has shape (3,), expected (N, 3)".into())));
        };
        let positions: Vec<_> = rows.as_slice()?.chunks_exact(3).map(Vector3::from_column_slice).collect();
        let Some(quaternions) = quaternions else { return Ok(Self::Positions(positions)) };
        let rows = read_rows(quaternions, "quaternions_wxyz", &[4])?;
        if let Some(actual) = rows.batch.filter(|actual| *actual != n) {
            let what = "quaternions_wxyz (rows)".into();
            return Err(to_py(Error::Length { what, expected: n, actual }));
        }
        let quaternions = rows.as_slice()?.as_chunks::<4>().0;
        let poses = positions.iter().enumerate().map(|(i, position)| {
            let (what, wxyz) = match rows.batch {
                None => ("quaternions_wxyz".into(), quaternions[0]),
                Some(_) => (format!("quaternions_wxyz[{i}]"), quaternions[i]),
            };
            let rotation = from_rounded_wxyz(&what, wxyz).map_err(to_py)?.to_rotation_matrix();
            Ok(Pose::from_parts(Translation3::from(*position), rotation))
        });
        Ok(Self::Poses(poses.collect::<PyResult<_>>()?))
    }
}

/// Rotations from `(3, 3)`, `(N, 3, 3)`, one pose or many.
fn read_rotations(object: &Bound<'_, PyAny>) -> PyResult<Vec<Rotation3<f64>>> {
    let (array, shape) = read_numbers(object, "orientation")?;
    let array = array.try_readonly()?;
    let values = array.as_slice()?;
    match shape[..] {
        [3, 3] | [_, 3, 3] => {
            let matrices = values.chunks_exact(9).enumerate();
            let rotation = |(i, m): (usize, &[f64])| {
                rotation_from_matrix(&format!("orientation {i}"), &Matrix3::from_row_slice(m)).map_err(to_py)
            };
            matrices.map(rotation).collect()
        }
        [4, 4] | [_, 4, 4] => {
            let poses = values.chunks_exact(16).map(pose_from_row_major);
            poses.map(|pose| Ok(pose.map_err(to_py)?.rotation)).collect()
        }
        _ => {
            let shape = PyTuple::new(object.py(), &shape)?;
            let message =
                format!("orientation has shape {shape}, expected (3, 3), (N, 3, 3), (4, 4) or (N, 4, 4)");
            Err(to_py(Error::Invalid(message)))
        }
    }
}

fn shaped<'py>(py: Python<'py>, values: &[f64], shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    to_array(py, values, [values.len()])?.call_method1("reshape", (PyTuple::new(py, shape)?,))
}

/// All that a path is made of, in types that pickle: pieces, samples, orientation or not, s, t.
#[derive(FromPyObject, IntoPyObject)]
struct PathParts(Vec<PieceParts>, Vec<[f64; 16]>, bool, Vec<f64>, Option<Vec<f64>>);

/// Shape, its numbers, shift, first and last sample.
type PieceParts = (String, Vec<f64>, f64, usize, usize);

impl PathParts {
    fn of(path: &Path) -> Self {
        let pieces = path.pieces().map(|piece| {
            let (kind, numbers) = shape_parts(&piece.shape);
            (kind.to_owned(), numbers, piece.shift, piece.first, piece.last)
        });
        let poses = path.poses().iter().map(pose_to_row_major).collect();
        let t = path.t().map(<[f64]>::to_vec);
        Self(pieces.collect(), poses, path.has_orientation(), path.s().to_vec(), t)
    }

    fn build(self) -> redundancy_core::Result<Path> {
        let Self(pieces, poses, oriented, s, t) = self;
        let poses = poses.iter().map(|pose| pose_from_row_major(pose)).collect::<Result<Vec<_>, _>>()?;
        let pieces = pieces.iter().map(|(kind, numbers, shift, first, last)| {
            let shape = shape_from_parts(kind, numbers)?;
            Ok(PathPiece { shape, shift: *shift, first: *first, last: *last })
        });
        let pieces = pieces.collect::<redundancy_core::Result<Vec<_>>>()?;
        Path::from_pieces(&poses, oriented, &s, t.as_deref(), pieces)
    }
}

/// A shape by its name and numbers.
fn shape_parts(shape: &Shape) -> (&'static str, Vec<f64>) {
    match shape {
        Shape::Circle(c) => {
            let (center, normal) = (c.center(), c.normal());
            let mut numbers = center.as_slice().to_vec();
            numbers.extend([c.radius(), c.start(), c.turns(), normal.x, normal.y, normal.z]);
            ("circle", numbers)
        }
        Shape::Raster(r) => {
            let (origin, along, across) = (r.origin(), r.along(), r.across());
            let mut numbers = origin.as_slice().to_vec();
            numbers.extend([r.length(), r.spacing(), r.strokes() as f64]);
            numbers.extend([along.x, along.y, along.z, across.x, across.y, across.z]);
            numbers.extend(r.corner());
            ("raster", numbers)
        }
        _ => ("spline", Vec::new()),
    }
}

/// Inverse of [`shape_parts`].
fn shape_from_parts(kind: &str, numbers: &[f64]) -> redundancy_core::Result<Shape> {
    let vector = |from: usize| Vector3::new(numbers[from], numbers[from + 1], numbers[from + 2]);
    match (kind, numbers.len()) {
        ("circle", 9) => {
            let circle = Circle::new(vector(0), numbers[3], numbers[4], numbers[5], vector(6))?;
            Ok(Shape::Circle(circle))
        }
        ("raster", 12 | 13) => {
            let (strokes, corner) = (numbers[5] as usize, numbers.get(12).copied());
            let (along, across) = (vector(6), vector(9));
            let raster = Raster::new(vector(0), numbers[3], numbers[4], strokes, corner, along, across)?;
            Ok(Shape::Raster(raster))
        }
        ("spline", 0) => Ok(Shape::Spline),
        (other, n) => Err(Error::Invalid(format!("unknown shape '{other}' with {n} numbers"))),
    }
}

/// `redundancy.paths.circle` without its defaults.
#[pyfunction]
pub fn paths_circle(
    center: &Bound<'_, PyAny>,
    radius: f64,
    start: f64,
    turns: f64,
    normal: &Bound<'_, PyAny>,
    orientation: Option<&Bound<'_, PyAny>>,
    n: Integer,
) -> PyResult<PyPath> {
    let n = n.count("n", 0)?;
    let (center, normal) = (read_array::<3>(center, "center")?, read_array::<3>(normal, "normal")?);
    let circle = Circle::new(center.into(), radius, start, turns, normal.into()).map_err(to_py)?;
    let path = PyPath::from(circle.path(n).map_err(to_py)?);
    path.oriented(orientation).map(PyPath::from)
}

/// `redundancy.paths.raster` without its defaults.
#[pyfunction]
pub fn paths_raster(
    origin: &Bound<'_, PyAny>,
    length: f64,
    spacing: f64,
    strokes: Integer,
    corner: Option<f64>,
    orientation: Option<&Bound<'_, PyAny>>,
    step: f64,
    along: &Bound<'_, PyAny>,
    across: &Bound<'_, PyAny>,
) -> PyResult<PyPath> {
    let strokes = strokes.count("strokes", 0)?;
    let origin = read_array::<3>(origin, "origin")?;
    let (along, across) = (read_array::<3>(along, "along")?, read_array::<3>(across, "across")?);
    let raster = Raster::new(origin.into(), length, spacing, strokes, corner, along.into(), across.into());
    let path = PyPath::from(raster.and_then(|raster| raster.path(step)).map_err(to_py)?);
    path.oriented(orientation).map(PyPath::from)
}

/// An event along a path or trajectory.
///
/// Args:
///     kind: `basis_change`, `damping`, `limit`, `scaled`, `kinematic_singularity`, `algorithmic_singularity`,
///         `reconfiguration` or `joint_limit`.
///     index: Row of the trajectory; where a plan ends early, the path point that was not reached.
///     t: Time, s.
///     s: Arc length on the path, m; on a self-motion its parameter.
///     message: What happened, as a sentence.
#[pyclass(name = "Event", module = "redundancy", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyEvent {
    pub event: Event,
}

#[pymethods]
impl PyEvent {
    #[new]
    fn new(kind: &str, index: Integer, t: f64, s: f64, message: String) -> PyResult<Self> {
        let (kind, index) = (kind.parse().map_err(to_py)?, index.count("index", 0)?);
        for (what, value) in [("t", t), ("s", s)] {
            if !value.is_finite() {
                return Err(to_py(Error::NotFinite { what: what.into(), index: 0, value }));
            }
        }
        Ok(Self { event: Event { kind, index, t, s, message } })
    }

    /// Kind of the event.
    #[getter]
    fn kind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        event_kind_to_py(py, self.event.kind)
    }

    /// Row of the trajectory, from 0.
    #[getter]
    fn index(&self) -> usize {
        self.event.index
    }

    /// Time, s.
    #[getter]
    fn t(&self) -> f64 {
        self.event.t
    }

    /// Arc length on the path, m.
    #[getter]
    fn s(&self) -> f64 {
        self.event.s
    }

    /// What happened, as a sentence.
    #[getter]
    fn message(&self) -> &str {
        &self.event.message
    }

    fn __repr__(&self) -> String {
        let Event { kind, index, t, s, message } = &self.event;
        format!("Event(kind='{kind}', index={index}, t={t}, s={s}, message={message:?})")
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (String, usize, f64, f64, String)) {
        let Event { kind, index, t, s, message } = &self.event;
        (py.get_type::<Self>(), (kind.to_string(), *index, *t, *s, message.clone()))
    }
}

impl From<Event> for PyEvent {
    fn from(event: Event) -> Self {
        Self { event }
    }
}

/// Joint positions and velocities over time, one row per instant, with events.
///
/// Between its rows it is a curve, given by `sample`, on which limits are checked: the cubic polynomial through
/// positions and velocities of both rows (C1: the acceleration may jump at a row), or, where the rows carry
/// accelerations, the quintic one through all three (C2).
///
/// Args:
///     joint_names: The joints, base to tip.
///     t: `(N,)` times, s, increasing.
///     q: `(N, n)` joint positions, rad or m.
///     qd: `(N, n)` joint velocities, rad/s or m/s; differences of `q` when left out.
///     events: Events, in order.
///     qdd: `(N, n)` joint accelerations, rad/s^2 or m/s^2.
///     section: Per row `lead_in`, `path`, `blend` or `lead_out`.
///
/// Example:
///     >>> import redundancy as rd
///     >>> rd.Trajectory(["shoulder", "elbow"], [0.0, 0.5], [[0.0, 1.0], [0.5, 1.0]]).qd.tolist()
///     [[1.0, 0.0], [1.0, 0.0]]
#[pyclass(name = "Trajectory", module = "redundancy", frozen, eq, subclass)]
#[derive(PartialEq)]
pub struct PyTrajectory {
    pub trajectory: Trajectory,
}

impl From<Trajectory> for PyTrajectory {
    fn from(trajectory: Trajectory) -> Self {
        Self { trajectory }
    }
}

impl PyTrajectory {
    /// Everything as named arrays.
    pub fn arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let arrays = PyDict::new(py);
        let events = self.trajectory.events();
        let strings =
            |words: Vec<&str>| py.import("numpy")?.getattr("array")?.call1((words, pyo3::intern!(py, "U")));
        arrays.set_item("joint_names", strings(self.joint_names())?)?;
        arrays.set_item("t", self.t(py))?;
        arrays.set_item("q", self.q(py)?)?;
        arrays.set_item("qd", self.qd(py)?)?;
        if let Some(qdd) = self.qdd(py)? {
            arrays.set_item("qdd", qdd)?;
        }
        if let Some(section) = self.section(py)? {
            arrays.set_item("section", section)?;
        }
        arrays.set_item("event_kind", strings(events.iter().map(|e| e.kind.as_str()).collect())?)?;
        arrays.set_item("event_index", PyArray1::from_iter(py, events.iter().map(|e| e.index as i64)))?;
        arrays.set_item("event_t", PyArray1::from_iter(py, events.iter().map(|e| e.t)))?;
        arrays.set_item("event_s", PyArray1::from_iter(py, events.iter().map(|e| e.s)))?;
        arrays.set_item("event_message", strings(events.iter().map(|e| e.message.as_str()).collect())?)?;
        Ok(arrays)
    }
}

#[pymethods]
impl PyTrajectory {
    #[new]
    #[pyo3(signature = (joint_names, t, q, qd=None, events=None, qdd=None, section=None))]
    fn new(
        joint_names: Vec<String>,
        t: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        qd: Option<&Bound<'_, PyAny>>,
        events: Option<Vec<Bound<'_, PyEvent>>>,
        qdd: Option<&Bound<'_, PyAny>>,
        section: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let n = joint_names.len();
        let q = read_joint_rows(q, "q", n)?;
        let qd = qd.map(|qd| read_joint_rows(qd, "qd", n)).transpose()?;
        let events = events.unwrap_or_default().iter().map(|event| event.get().event.clone()).collect();
        let qdd = qdd.map(|qdd| read_joint_rows(qdd, "qdd", n)).transpose()?;
        let build = |t: Vec<f64>| -> redundancy_core::Result<Trajectory> {
            let mut trajectory = Trajectory::new(joint_names, t, q, qd, events)?;
            if let Some(qdd) = qdd {
                trajectory = trajectory.with_accelerations(qdd)?;
            }
            match section {
                None => Ok(trajectory),
                Some(words) => {
                    let sections = words.iter().map(|word| word.parse::<Section>());
                    trajectory.with_sections(sections.collect::<redundancy_core::Result<_>>()?)
                }
            }
        };
        build(read_vector(t, "t", None)?).map(Self::from).map_err(to_py)
    }

    /// Read what `to_csv` writes.
    ///
    /// Args:
    ///     path: The file.
    #[staticmethod]
    fn from_csv(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Trajectory::from_csv(path)).map(Self::from).map_err(to_py)
    }

    /// Read what `to_json` writes, or a ROS `JointTrajectory` as JSON; times to the nanosecond.
    ///
    /// Args:
    ///     path: The file.
    #[staticmethod]
    fn from_json(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Trajectory::from_json(path)).map(Self::from).map_err(to_py)
    }

    /// Read what `to_npz` writes.
    ///
    /// Args:
    ///     path: The file.
    #[staticmethod]
    fn from_npz(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        read_npz(py, &path).map_err(|error| {
            let (file, message) = (path.display().to_string(), error.to_string());
            to_py(Error::File { file, message })
        })
    }

    /// Write `t,<joint>...,<joint>_velocity...`, one line per instant, without the events.
    ///
    /// `<joint>_acceleration...` and `section` follow where the trajectory has them.
    ///
    /// Args:
    ///     path: The file to write.
    fn to_csv(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.trajectory.to_csv(path)).map_err(to_py)
    }

    /// Write the fields of ROS `JointTrajectory`, and `events` and `section` beside them.
    ///
    /// `accelerations` are written where the trajectory has them.
    ///
    /// Args:
    ///     path: The file to write.
    fn to_json(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.trajectory.to_json(path)).map_err(to_py)
    }

    /// Write the arrays `joint_names, t, q, qd` and `event_kind, event_index, event_t, event_s, event_message`.
    ///
    /// Args:
    ///     path: The file to write.
    fn to_npz(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let arrays = self.arrays(py)?;
        py.import("numpy")?.getattr("savez_compressed")?.call((path,), Some(&arrays))?;
        Ok(())
    }

    /// The joints, base to tip.
    #[getter]
    fn joint_names(&self) -> Vec<&str> {
        self.trajectory.joint_names().iter().map(String::as_str).collect()
    }

    /// Times `(N,)`, s. A copy.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.trajectory.t())
    }

    /// Joint positions `(N, n)`, rad or m. A copy.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.trajectory.q(), [self.trajectory.rows(), self.trajectory.dof()])
    }

    /// Joint velocities `(N, n)`, rad/s or m/s. A copy.
    #[getter]
    fn qd<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.trajectory.qd(), [self.trajectory.rows(), self.trajectory.dof()])
    }

    /// Joint accelerations `(N, n)`, rad/s^2 or m/s^2, where the rows carry them. A copy.
    #[getter]
    fn qdd<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let shape = [self.trajectory.rows(), self.trajectory.dof()];
        self.trajectory.qdd().map(|qdd| to_array(py, qdd, shape)).transpose()
    }

    /// Per row `lead_in`, `path`, `blend` or `lead_out` `(N,)`, where that is known. A copy.
    #[getter]
    fn section<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(sections) = self.trajectory.sections() else { return Ok(None) };
        let words: Vec<&str> = sections.iter().map(|section| section.as_str()).collect();
        // Also without rows an array of strings.
        py.import("numpy")?.getattr("array")?.call1((words, pyo3::intern!(py, "U"))).map(Some)
    }

    /// This motion and then another that begins where it ends.
    ///
    /// The last row of this one is the first of the other, whose times follow. Accelerations are kept where both
    /// motions have them.
    ///
    /// Args:
    ///     other: A motion of the same joints; its first row has the positions (within 1e-6 rad or m) and the
    ///         velocities of the last row of this one.
    ///
    /// Returns:
    ///     A trajectory with the rows of both, N + M - 1.
    ///
    /// Raises:
    ///     RedundancyError: Other joints, positions or velocities that differ where the two meet.
    ///
    /// Example:
    ///     >>> import redundancy as rd
    ///     >>> arm = rd.catalog.load("panda")
    ///     >>> a, b = [0, 0.3, 0, -1, 0.2, 1, 0], [0.5, 0.3, 0, -1, 0.2, 1, 0]
    ///     >>> move = rd.joint_move(arm, a, b).joined(rd.joint_move(arm, b, a))
    ///     >>> rd.check(arm, move).ok
    ///     True
    fn joined(&self, other: &Bound<'_, Self>) -> PyResult<Self> {
        self.trajectory.joined(&other.get().trajectory).map(Self::from).map_err(to_py)
    }

    /// Position, velocity, acceleration and jerk of the trajectory's own interpolation.
    ///
    /// Between two rows it is the quintic polynomial through position, velocity and acceleration of both where the
    /// rows carry accelerations, else the cubic one through position and velocity of both: what ROS's
    /// `joint_trajectory_controller` makes of the same numbers. The curve passes through the rows exactly. At a row,
    /// acceleration (of the cubic) and jerk are those of the interval that begins there.
    ///
    /// Args:
    ///     t: Times, s: a number or `(N,)`, from the first row's to the last row's.
    ///
    /// Returns:
    ///     q, qd, qdd, qddd, each `(n,)` or `(N, n)`: rad or m, and per s, s^2, s^3.
    ///
    /// Raises:
    ///     RedundancyError: A time outside of the trajectory or not finite, a trajectory without rows.
    ///
    /// Example:
    ///     >>> import redundancy as rd
    ///     >>> rest = [[0.0], [0.0]]
    ///     >>> move = rd.Trajectory(["a"], [0.0, 2.0], [[0.0], [1.0]], rest, qdd=rest)
    ///     >>> q, qd, qdd, qddd = move.sample(1.0)
    ///     >>> q.tolist(), qd.tolist(), qdd.tolist(), qddd.tolist()
    ///     ([0.5], [0.9375], [0.0], [-3.75])
    fn sample<'py>(&self, py: Python<'py>, t: &Bound<'py, PyAny>) -> PyResult<[Bound<'py, PyAny>; 4]> {
        let (times, n) = (read_rows(t, "t", &[])?, self.trajectory.dof());
        let count = times.batch.unwrap_or(1);
        let mut arrays = [(); 4].map(|()| Fresh::<f64, _>::new(py, [count * n]));
        let [q, qd, qdd, qddd] = &mut arrays;
        let out = [q.memory()?, qd.memory()?, qdd.memory()?, qddd.memory()?];
        let values = times.as_slice()?;
        py.detach(|| self.trajectory.sample_many(values, out)).map_err(to_py)?;
        let shape: Vec<usize> = times.batch.into_iter().chain([n]).collect();
        let shape = PyTuple::new(py, shape)?;
        let [q, qd, qdd, qddd] = arrays.map(|array| array.finish().call_method1("reshape", (&shape,)));
        Ok([q?, qd?, qdd?, qddd?])
    }

    /// The events, in order.
    #[getter]
    fn events(&self) -> Vec<PyEvent> {
        self.trajectory.events().iter().cloned().map(PyEvent::from).collect()
    }

    fn __len__(&self) -> usize {
        self.trajectory.rows()
    }

    fn __repr__(&self) -> String {
        let t = self.trajectory.t();
        let duration = t.last().zip(t.first()).map_or(0.0, |(last, first)| last - first);
        let (rows, dof, events) = (t.len(), self.trajectory.dof(), self.trajectory.events().len());
        format!("Trajectory({rows} rows of {dof} joints, {duration} s, {events} events)")
    }

    /// For notebooks: the range and the largest speed of each joint.
    fn _repr_html_(&self) -> String {
        html::table(&self.__repr__(), &JOINT_COLUMNS, &joint_rows(&self.trajectory))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyType>, Bound<'py, PyTuple>)> {
        let events = PyList::new(py, self.events())?;
        let section = self.trajectory.sections();
        let section = section.map(|list| list.iter().map(|section| section.as_str()).collect::<Vec<_>>());
        let (t, q, qd, qdd) = (self.t(py), self.q(py)?, self.qd(py)?, self.qdd(py)?);
        let parts = (self.joint_names(), t, q, qd, events, qdd, section);
        Ok((py.get_type::<Self>(), parts.into_pyobject(py)?))
    }
}

/// Columns of [`joint_rows`].
pub const JOINT_COLUMNS: [&str; 4] = ["joint", "least, rad or m", "most, rad or m", "fastest, rad/s or m/s"];

/// Name, range and largest speed of each joint over the rows.
pub fn joint_rows(trajectory: &Trajectory) -> Vec<Vec<String>> {
    let n = trajectory.dof();
    let column =
        |values: &[f64], joint: usize| values.iter().skip(joint).step_by(n.max(1)).copied().collect();
    let row = |(joint, name): (usize, &String)| {
        let (q, qd): (Vec<f64>, Vec<f64>) = (column(trajectory.q(), joint), column(trajectory.qd(), joint));
        if q.is_empty() {
            return vec![name.clone(), String::new(), String::new(), String::new()];
        }
        let least = q.iter().copied().fold(f64::INFINITY, f64::min);
        let most = q.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let fastest = qd.iter().fold(0.0f64, |fastest, speed| fastest.max(speed.abs()));
        vec![name.clone(), format!("{least:.4}"), format!("{most:.4}"), format!("{fastest:.4}")]
    };
    trajectory.joint_names().iter().enumerate().map(row).collect()
}

/// `(N, n)` joint rows, flattened.
pub fn read_joint_rows(object: &Bound<'_, PyAny>, what: &str, n: usize) -> PyResult<Vec<f64>> {
    let rows = read_rows(object, what, &[n])?;
    match rows.batch {
        Some(_) => Ok(rows.as_slice()?.to_vec()),
        None => Err(to_py(Error::Invalid(format!("{what} has shape ({n},), expected (N, {n})")))),
    }
}

fn read_npz(py: Python<'_>, path: &std::path::Path) -> PyResult<PyTrajectory> {
    let file = py.import("numpy")?.getattr("load")?.call1((path,))?;
    let result = read_arrays(&file);
    file.call_method0("close")?;
    result
}

/// What [`PyTrajectory::arrays`] made.
pub fn read_arrays(file: &Bound<'_, PyAny>) -> PyResult<PyTrajectory> {
    let py = file.py();
    let names: Vec<String> = file.get_item("joint_names")?.call_method0("tolist")?.extract()?;
    let column = |name: &str| file.get_item(name)?.call_method0("tolist");
    let kinds: Vec<String> = column("event_kind")?.extract()?;
    let indices: Vec<usize> = column("event_index")?.extract()?;
    let (t, s): (Vec<f64>, Vec<f64>) = (column("event_t")?.extract()?, column("event_s")?.extract()?);
    let messages: Vec<String> = column("event_message")?.extract()?;
    let count = kinds.len();
    if [indices.len(), t.len(), s.len(), messages.len()].iter().any(|n| *n != count) {
        return Err(PyIndexError::new_err("the event columns differ in length"));
    }
    let events = kinds.iter().zip(indices).zip(t).zip(s).zip(messages);
    let events = events.map(|((((kind, index), t), s), message)| {
        PyEvent::new(kind, index.into(), t, s, message).and_then(|event| Bound::new(py, event))
    });
    let events = events.collect::<PyResult<Vec<_>>>()?;
    let optional = |name: &str| match file.contains(name)? {
        true => file.get_item(name).map(Some),
        false => Ok(None),
    };
    let section = optional("section")?.map(|words| words.call_method0("tolist")?.extract()).transpose()?;
    let (q, qd, qdd) = (file.get_item("q")?, file.get_item("qd")?, optional("qdd")?);
    PyTrajectory::new(names, &file.get_item("t")?, &q, Some(&qd), Some(events), qdd.as_ref(), section)
}

fn read_smoothing(object: &Bound<'_, PyAny>) -> PyResult<usize> {
    object.extract::<Integer>()?.count("smoothing", 0)
}

/// Times for joint rows, from 0, such that no joint exceeds a share of its velocity limit.
///
/// The rate of rows is the largest that the limits allow, smoothed from below over a window of rows.
///
/// Args:
///     q: `(N, n)` joint positions, rad or m.
///     velocity_limits: `(n,)`, rad/s or m/s, `inf` for none.
///     velocity_fraction: Share of each limit that may be used, in (0, 1].
///     smoothing: Half-width of the smoothing window in rows; 0 is off.
///
/// Returns:
///     `(N,)`, s.
///
/// Raises:
///     RedundancyError: Invalid numbers, or a step in which only joints without a limit move.
#[pyfunction]
#[pyo3(name = "times_within_limits", signature = (q, velocity_limits, *, velocity_fraction=0.9, smoothing=10))]
pub fn py_times_within_limits<'py>(
    py: Python<'py>,
    q: &Bound<'py, PyAny>,
    velocity_limits: &Bound<'py, PyAny>,
    velocity_fraction: f64,
    #[pyo3(from_py_with = read_smoothing)] smoothing: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let limits = read_vector(velocity_limits, "velocity_limits", None)?;
    let q = read_joint_rows(q, "q", limits.len())?;
    let settings = TimingSettings { velocity_fraction, smoothing };
    let t = times_within_limits(&q, &limits, settings).map_err(to_py)?;
    Ok(PyArray1::from_vec(py, t))
}
