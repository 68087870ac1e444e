//! Sets of orientations and the best orientation in them. Quaternions are `(w, x, y, z)`.

use std::f64::consts::PI;

use numpy::{Element, PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use redundancy_core::nalgebra::{Matrix3, UnitQuaternion, Vector3};
use redundancy_core::parallel::prelude::*;
use redundancy_core::rotation::{
    self, Barrier, Cone, Constraint, CrossSection, DirectionCones, OrientationMethod, OrientationOptimizer,
    OrientationSet, OrientationSettings, OrientationSolution, QuaternionVolume, SectionDistance, Spin,
};
use redundancy_core::{Error, Result, Status};

use crate::batch::in_blocks;
use crate::convert::{Fresh, Integer, Threads, read_array, read_rows, read_seed, read_vector, to_array};
use crate::error::to_py;
use crate::orientation_set::combined;
use crate::status::{status_to_py, statuses_to_py};

/// Rows between two looks at Ctrl-C: some milliseconds.
const BLOCK: usize = 65_536;
/// Rows of one parallel task.
const TASK: usize = 256;

pub fn quaternion(object: &Bound<'_, PyAny>, what: &str) -> PyResult<UnitQuaternion<f64>> {
    rotation::from_wxyz(read_array::<4>(object, what)?).map_err(to_py)
}

fn wxyz<'py>(py: Python<'py>, q: &UnitQuaternion<f64>) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, &rotation::to_wxyz(q))
}

fn vector<'py>(py: Python<'py>, v: &Vector3<f64>) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, v.as_slice())
}

/// Names the row of a batch in an error.
fn in_row(error: Error, row: Option<usize>) -> Error {
    match row {
        None => error,
        Some(row) => Error::Invalid(format!("row {row}: {error}")),
    }
}

/// Calls `f` for one row of `width` numbers or for each of many, and returns an item of shape `out` or an array
/// `(N, *out)`.
pub fn map_rows<'py, T, const IN: usize>(
    object: &Bound<'py, PyAny>,
    what: &str,
    out: &[usize],
    threads: Option<Threads>,
    f: impl Fn([f64; IN], &mut [T]) -> Result<()> + Sync,
) -> PyResult<Bound<'py, PyAny>>
where
    T: Element + Copy + Default + Send + Sync + IntoPyObjectScalar,
{
    let py = object.py();
    let rows = read_rows(object, what, &[IN])?;
    let (inputs, _) = rows.as_slice()?.as_chunks::<IN>();
    let width: usize = out.iter().product();
    let Some(n) = rows.batch else {
        let mut values = vec![T::default(); width];
        f(inputs[0], &mut values).map_err(to_py)?;
        return match out {
            [] => values[0].scalar(py),
            [a] => Ok(to_array(py, &values, [*a])?.into_any()),
            _ => Ok(to_array(py, &values, [out[0], out[1]])?.into_any()),
        };
    };
    let mut array = Fresh::<T, _>::new(py, [n, width]);
    let memory = array.memory()?;
    in_blocks(py, n, BLOCK, threads, |range| {
        let first = range.start;
        let tasks = memory[range.start * width..range.end * width].par_chunks_mut(TASK * width);
        let failed = tasks.enumerate().filter_map(|(task, chunk)| {
            let start = first + task * TASK;
            chunk
                .chunks_exact_mut(width)
                .zip(&inputs[start..])
                .enumerate()
                .find_map(|(i, (item, input))| f(*input, item).err().map(|error| (start + i, error)))
        });
        // The first bad row is reported whatever the threads.
        match failed.min_by_key(|(row, _)| *row) {
            None => Ok(()),
            Some((row, error)) => Err(in_row(error, Some(row))),
        }
    })?;
    let array = array.finish();
    match out {
        [] => Ok(array.reshape([n])?.into_any()),
        [_] => Ok(array.into_any()),
        _ => Ok(array.reshape([n, out[0], out[1]])?.into_any()),
    }
}

/// Scalars that become plain Python objects.
pub trait IntoPyObjectScalar: Copy {
    fn scalar(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>>;
}

impl IntoPyObjectScalar for f64 {
    fn scalar(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        Ok(self.into_pyobject(py)?.into_any())
    }
}

impl IntoPyObjectScalar for bool {
    fn scalar(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        Ok(self.into_pyobject(py)?.to_owned().into_any())
    }
}

/// The same for quaternions.
pub fn map_quaternions<'py, T>(
    object: &Bound<'py, PyAny>,
    out: &[usize],
    threads: Option<Threads>,
    f: impl Fn(&UnitQuaternion<f64>, &mut [T]) + Sync,
) -> PyResult<Bound<'py, PyAny>>
where
    T: Element + Copy + Default + Send + Sync + IntoPyObjectScalar,
{
    map_rows::<T, 4>(object, "q (w, x, y, z)", out, threads, |row, item| {
        f(&rotation::from_wxyz(row)?, item);
        Ok(())
    })
}

/// A tolerance of membership.
pub fn checked_tolerance(tol: f64) -> PyResult<()> {
    if tol.is_nan() || tol < 0.0 {
        return Err(to_py(Error::OutOfRange { what: "tol".into(), value: tol, bound: ">= 0".into() }));
    }
    Ok(())
}

fn put_matrix(m: &Matrix3<f64>, out: &mut [f64]) {
    // Symmetric, so the order does not matter.
    out.copy_from_slice(m.as_slice());
}

/// All orientations whose body axis lies within a half-angle of a direction; the spin about the axis is free.
///
/// The margin is `(direction . R(q) body_axis - cos half_angle) / 2`, the paper's `eta^2 - q1^2 - q2^2`
/// [FromGravdahl2009, eqs. (15), (23), (33)]. `q` is a unit quaternion `(w, x, y, z)`, `(4,)` or `(N, 4)`. For
/// samples and nearest members take `QuaternionVolume.cone(body_axis, half_angle, direction)`, the same set.
///
/// Args:
///     body_axis: `(3,)`, in the body frame, of any length.
///     direction: `(3,)`, in the reference frame, of any length.
///     half_angle: rad, in (0, pi).
///
/// Raises:
///     RedundancyError: an axis without length, a half-angle outside (0, pi), a number that is not finite.
///
/// Example:
///     >>> import redundancy as rd
///     >>> cone = rd.Cone([0, 0, 1], [0, 0, -1], 0.3)
///     >>> round(cone.margin([0, 0, 1, 0]), 6)  # straight down: sin^2(0.15)
///     0.022332
#[pyclass(name = "Cone", module = "redundancy", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyCone {
    pub cone: Cone,
}

#[pymethods]
impl PyCone {
    #[new]
    fn new(body_axis: &Bound<'_, PyAny>, direction: &Bound<'_, PyAny>, half_angle: f64) -> PyResult<Self> {
        let (b, d) = (read_array(body_axis, "body_axis")?, read_array(direction, "direction")?);
        Ok(Self { cone: Cone::new(b, d, half_angle).map_err(to_py)? })
    }

    /// Cone of the body z axis around `direction`.
    ///
    /// Args:
    ///     direction: `(3,)`, world axes, of any length.
    ///     half_angle: rad, in (0, pi).
    #[staticmethod]
    fn z(direction: &Bound<'_, PyAny>, half_angle: f64) -> PyResult<Self> {
        Ok(Self { cone: Cone::z(read_array(direction, "direction")?, half_angle).map_err(to_py)? })
    }

    /// Cone of the body x axis around `direction` [FromGravdahl2009, eq. (23)].
    ///
    /// Args:
    ///     direction: `(3,)`, world axes, of any length.
    ///     half_angle: rad, in (0, pi).
    #[staticmethod]
    fn x(direction: &Bound<'_, PyAny>, half_angle: f64) -> PyResult<Self> {
        Ok(Self { cone: Cone::x(read_array(direction, "direction")?, half_angle).map_err(to_py)? })
    }

    /// The body z axis within `half_angle` (rad) of -z [FromGravdahl2009, eq. (33)].
    #[staticmethod]
    fn downward(half_angle: f64) -> PyResult<Self> {
        Ok(Self { cone: Cone::downward(half_angle).map_err(to_py)? })
    }

    /// The body axis `axis` around the same axis of `frame` `(w, x, y, z)` [FromGravdahl2009, eq. (24)].
    ///
    /// Args:
    ///     frame: Unit quaternion `(4,)`.
    ///     axis: `(3,)`, body axes, of any length.
    ///     half_angle: rad, in (0, pi).
    #[staticmethod]
    fn of_frame(frame: &Bound<'_, PyAny>, axis: &Bound<'_, PyAny>, half_angle: f64) -> PyResult<Self> {
        let frame = quaternion(frame, "frame")?;
        Ok(Self { cone: Cone::of_frame(&frame, read_array(axis, "axis")?, half_angle).map_err(to_py)? })
    }

    /// Unit axis in the body frame, `(3,)`.
    #[getter]
    fn body_axis<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, &self.cone.body_axis())
    }

    /// Unit direction in the reference frame, `(3,)`.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, &self.cone.direction())
    }

    /// Half-angle, rad.
    #[getter]
    fn half_angle(&self) -> f64 {
        self.cone.half_angle()
    }

    /// Angle, rad in [0, pi], between the rotated body axis and the direction: a float, or `(N,)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn angle<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.cone.angle(q))
    }

    /// Smooth margin, positive inside: a float, or `(N,)` for a batch.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn margin<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.cone.margin(q))
    }

    /// Gradient of the margin along rotation vectors in body axes, 1/rad: `(3,)` or `(N, 3)`.
    ///
    /// It is the derivative of `margin(q * exp(delta))` at `delta = 0`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn gradient<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[3], threads, |q, out: &mut [f64]| {
            out.copy_from_slice(self.cone.gradient(q).as_slice());
        })
    }

    /// Hessian of the margin along rotation vectors in body axes, 1/rad^2: `(3, 3)` or `(N, 3, 3)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn hessian<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[3, 3], threads, |q, out: &mut [f64]| put_matrix(&self.cone.hessian(q), out))
    }

    fn __getnewargs__(&self) -> ([f64; 3], [f64; 3], f64) {
        let (b, d) = (self.cone.body_axis().into_inner(), self.cone.direction().into_inner());
        (b.into(), d.into(), self.cone.half_angle())
    }

    /// The intersection with another set, an `OrientationSet`.
    fn __and__<'py>(&self, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        combined(self.cone.into(), other, OrientationSet::and)
    }

    /// The union with another set, an `OrientationSet`.
    fn __or__<'py>(&self, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        combined(self.cone.into(), other, OrientationSet::or)
    }

    fn __repr__(&self) -> String {
        let (b, d, angle) = self.__getnewargs__();
        format!("Cone(body_axis={b:?}, direction={d:?}, half_angle={angle})")
    }
}

/// All orientations with at most a given twist about a body axis from a reference; the axis may point anywhere.
///
/// With `r = conj(reference) * q` and `r3` its part along the axis the margin is `kappa^2 - (r3 / r0)^2`,
/// `kappa = tan(max_angle / 2)` [FromGravdahl2009, eqs. (20), (46)]. If the axis is turned over by half a turn, the
/// spin is undefined and counts as far outside; so for a tool that points down, the reference must point down too.
///
/// Args:
///     reference: `(4,)`, unit quaternion `(w, x, y, z)`.
///     max_angle: rad, in (0, pi).
///     axis: `(3,)`, in the body frame.
///
/// Raises:
///     RedundancyError: a reference that is not of unit norm, an axis without length, an angle outside (0, pi).
///
/// Example:
///     >>> import redundancy as rd
///     >>> spin = rd.Spin([1, 0, 0, 0], 0.5)
///     >>> round(spin.twist(rd.quaternion.from_zyz([0.3, 0.2, 0.1])), 6)
///     0.4
#[pyclass(name = "Spin", module = "redundancy", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PySpin {
    spin: Spin,
}

#[pymethods]
impl PySpin {
    #[new]
    #[pyo3(signature = (reference, max_angle, axis=None))]
    fn new(reference: &Bound<'_, PyAny>, max_angle: f64, axis: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let axis = axis.map_or(Ok([0.0, 0.0, 1.0]), |a| read_array(a, "axis"))?;
        Ok(Self { spin: Spin::new(quaternion(reference, "reference")?, max_angle, axis).map_err(to_py)? })
    }

    /// The same with the axis given in the frame in which `reference` is given.
    ///
    /// Args:
    ///     reference: Unit quaternion `(4,)` from which the twist is measured.
    ///     max_angle: Largest twist to either side, rad.
    ///     axis: `(3,)`, of any length.
    #[staticmethod]
    fn about_world_axis(
        reference: &Bound<'_, PyAny>,
        max_angle: f64,
        axis: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let reference = quaternion(reference, "reference")?;
        let spin = Spin::about_world_axis(reference, max_angle, read_array(axis, "axis")?);
        Ok(Self { spin: spin.map_err(to_py)? })
    }

    /// Reference orientation `(w, x, y, z)`.
    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wxyz(py, &self.spin.reference())
    }

    /// Largest twist, rad.
    #[getter]
    fn max_angle(&self) -> f64 {
        self.spin.max_angle()
    }

    /// Unit axis in the body frame, `(3,)`.
    #[getter]
    fn axis<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, &self.spin.axis())
    }

    /// Twist relative to the reference, rad in [-pi, pi], 0 where undefined: a float, or `(N,)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn twist<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.spin.twist(q))
    }

    /// Smooth margin, positive inside: a float, or `(N,)` for a batch.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn margin<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.spin.margin(q))
    }

    /// Gradient of the margin along rotation vectors in body axes, 1/rad: `(3,)` or `(N, 3)`.
    ///
    /// It is the derivative of `margin(q * exp(delta))` at `delta = 0`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn gradient<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[3], threads, |q, out: &mut [f64]| {
            out.copy_from_slice(self.spin.gradient(q).as_slice());
        })
    }

    /// Hessian of the margin along rotation vectors in body axes, 1/rad^2: `(3, 3)` or `(N, 3, 3)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn hessian<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[3, 3], threads, |q, out: &mut [f64]| put_matrix(&self.spin.hessian(q), out))
    }

    fn __getnewargs__(&self) -> ([f64; 4], f64, [f64; 3]) {
        let axis = self.spin.axis().into_inner();
        (rotation::to_wxyz(&self.spin.reference()), self.spin.max_angle(), axis.into())
    }

    fn __repr__(&self) -> String {
        let (reference, angle, axis) = self.__getnewargs__();
        format!("Spin(reference={reference:?}, max_angle={angle}, axis={axis:?})")
    }
}

/// A set of orientations: rotations about fixed axes within bounds, or a cone.
///
/// `q` is in the set when it is `P * Q(phi_1, n_1) * ... * Q(phi_k, n_k) * S` with every angle in its range
/// [FromGravdahl2007, eqs. (6), (7), (12)]. Ranges are pairs (low, high) in rad; one of a full turn or more is
/// free. Quaternions are `(w, x, y, z)`, `(4,)` or `(N, 4)`.
///
/// Raises:
///     RedundancyError: no axes, parallel consecutive axes, an axis without length, a bound that
///         is not finite, a lower above its upper bound, a quaternion that is not of unit norm.
///
/// Example:
///     >>> import math
///     >>> import redundancy as rd
///     >>> volume = rd.QuaternionVolume.zyz((-math.pi, math.pi), (0, 0.3), (-0.5, 0.5))
///     >>> volume.contains(rd.quaternion.from_zyz([1.0, 0.2, 0.4]))
///     True
///     >>> round(volume.margin(rd.quaternion.from_zyz([1.0, 0.2, 0.6])), 6)
///     -0.1
#[pyclass(name = "QuaternionVolume", module = "redundancy", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyQuaternionVolume {
    pub volume: QuaternionVolume,
}

type VolumeState = (Vec<[f64; 3]>, Vec<f64>, Vec<f64>, Option<f64>, [f64; 4], [f64; 4]);

impl PyQuaternionVolume {
    fn from_core(volume: Result<QuaternionVolume>) -> PyResult<Self> {
        Ok(Self { volume: volume.map_err(to_py)? })
    }

    /// Axes, bounds, half-angle (of a cone), reorientations.
    fn state(&self) -> VolumeState {
        let (before, after) = self.volume.reorientations();
        let (before, after) = (rotation::to_wxyz(&before), rotation::to_wxyz(&after));
        match self.volume.bounds() {
            Some(bounds) => {
                let axes = bounds.iter().map(|(axis, _, _)| *axis).collect();
                let low = bounds.iter().map(|(_, low, _)| *low).collect();
                (axes, low, bounds.iter().map(|(_, _, high)| *high).collect(), None, before, after)
            }
            None => {
                let (axis, half_angle) = self.volume.cone_shape().unwrap_or(([0.0, 0.0, 1.0], PI));
                (vec![axis], vec![], vec![], Some(half_angle), before, after)
            }
        }
    }
}

#[pymethods]
impl PyQuaternionVolume {
    /// `Rz(alpha) Ry(beta) Rz(gamma)` with a range (low, high), rad, for each.
    #[staticmethod]
    fn zyz(alpha: [f64; 2], beta: [f64; 2], gamma: [f64; 2]) -> PyResult<Self> {
        Self::from_core(QuaternionVolume::zyz(alpha, beta, gamma))
    }

    /// `Rx(alpha) Ry(beta) Rz(gamma)` with a range (low, high), rad, for each.
    #[staticmethod]
    fn xyz(alpha: [f64; 2], beta: [f64; 2], gamma: [f64; 2]) -> PyResult<Self> {
        Self::from_core(QuaternionVolume::xyz(alpha, beta, gamma))
    }

    /// Rotations about one axis by an angle in `range`, rad.
    ///
    /// Args:
    ///     axis: `(3,)`, of any length.
    ///     range: Least and largest angle, rad.
    #[staticmethod]
    fn single_axis(axis: &Bound<'_, PyAny>, range: [f64; 2]) -> PyResult<Self> {
        Self::from_core(QuaternionVolume::single_axis(read_array(axis, "axis")?, range))
    }

    /// Tilts about x and y within half-angles (rad, below pi/2), the spin about z free.
    ///
    /// Args:
    ///     half_x: Half-angle of the tilt about x, rad.
    ///     half_y: Half-angle of the tilt about y, rad.
    #[staticmethod]
    fn pyramid(half_x: f64, half_y: f64) -> PyResult<Self> {
        Self::from_core(QuaternionVolume::pyramid(half_x, half_y))
    }

    /// Orientations whose body axis `axis` is within `half_angle` (rad) of `direction`.
    ///
    /// `direction` is `axis` by default, so the cone is around the identity, and the cone of -z is that of z. For a
    /// tool z axis that points down give `cone([0, 0, 1], half_angle, [0, 0, -1])`.
    ///
    /// Args:
    ///     axis: `(3,)`, body axes, of any length.
    ///     half_angle: rad.
    ///     direction: `(3,)`, of any length; `axis` when left out.
    #[staticmethod]
    #[pyo3(signature = (axis, half_angle, direction=None))]
    fn cone(
        axis: &Bound<'_, PyAny>,
        half_angle: f64,
        direction: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let axis = read_array(axis, "axis")?;
        Self::from_core(match direction {
            None => QuaternionVolume::cone(axis, half_angle),
            Some(d) => QuaternionVolume::cone_around(axis, read_array(d, "direction")?, half_angle),
        })
    }

    /// Rotations about the rows of `axes`, `(k, 3)`, with bounds `(k,)` in rad; the first is the outermost.
    ///
    /// Args:
    ///     axes: `(k, 3)`, k at least 1.
    ///     lower: `(k,)`, rad.
    ///     upper: `(k,)`, rad.
    #[staticmethod]
    fn from_axes(
        axes: &Bound<'_, PyAny>,
        lower: &Bound<'_, PyAny>,
        upper: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let rows = read_rows(axes, "axes", &[3])?;
        let (axes, _) = rows.as_slice()?.as_chunks::<3>();
        let (lower, upper) = (read_vector(lower, "lower", None)?, read_vector(upper, "upper", None)?);
        Self::from_core(QuaternionVolume::from_axes(axes, &lower, &upper))
    }

    /// Number of rotations; 3 for a cone.
    #[getter]
    fn dimension(&self) -> usize {
        self.volume.dimension()
    }

    /// Whether `q` is a member to `tol` (rad; for a cone in its margin's unit): a bool, or `(N,)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     tol: How far outside still counts as a member, rad (for a cone in the unit of its margin).
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, tol=1e-9, *, threads=None))]
    fn contains<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        tol: f64,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        checked_tolerance(tol)?;
        map_quaternions(q, &[], threads, |q, out| out[0] = self.volume.contains(q, tol))
    }

    /// Signed margin, >= 0 inside: a float, or `(N,)`.
    ///
    /// For sequences the smallest angle (rad) to a bound, for cones the margin of `Cone`. It is pi without any bound,
    /// and minus the angle (rad) to the set if there are fewer than three rotations and `q` is outside. With more
    /// than three rotations there are many ways to write `q`; the margin is that of the way farthest from the
    /// bounds that a search from several starts finds; rarely another one is better, by some mrad.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn margin<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.volume.margin(q))
    }

    /// Angles of `q` in the sequence, rad, `(k,)` or `(N, k)`; for a cone the ZYZ angles seen from its axis.
    ///
    /// If there are several ways to write `q`, the one that stays farthest from the bounds.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn angles<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        let k = self.volume.dimension();
        map_quaternions(q, &[k], threads, |q, out: &mut [f64]| {
            out.copy_from_slice(&self.volume.angles(q)[..k]);
        })
    }

    /// The orientation `(w, x, y, z)` at the angles `(k,)`, rad; bounds are not applied.
    fn at<'py>(&self, py: Python<'py>, angles: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let q = self.volume.at(&read_vector(angles, "angles", None)?).map_err(to_py)?;
        Ok(wxyz(py, &q))
    }

    /// Visualising quaternion `(cos psi/2, sin(psi/2) z)` [FromGravdahl2007, eq. (8)]: `(4,)` or `(N, 4)`.
    ///
    /// `z` is the rotated last axis (of a cone its axis), `psi` the rotation about it. Together with `q` it is the
    /// pair (Q, V) of the paper.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn visualising<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[4], threads, |q, out: &mut [f64]| {
            out.copy_from_slice(&rotation::to_wxyz(&self.volume.visualising(q)));
        })
    }

    /// The member nearest to `q`, on its side of the double cover: `(4,)` or `(N, 4)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn nearest<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[4], threads, |q, out: &mut [f64]| {
            out.copy_from_slice(&rotation::to_wxyz(&self.volume.nearest(q)));
        })
    }

    /// `P * V` (left: the set moves in the reference frame) or `V * P` (right: another body frame).
    ///
    /// Args:
    ///     p: Unit quaternion `(4,)`.
    ///     side: `"left"` or `"right"`.
    #[pyo3(signature = (p, side="left"))]
    fn reoriented(&self, p: &Bound<'_, PyAny>, side: &str) -> PyResult<Self> {
        let p = quaternion(p, "p")?;
        match side {
            "left" => Ok(Self { volume: self.volume.reoriented(&p) }),
            "right" => Ok(Self { volume: self.volume.reoriented_in_body(&p) }),
            other => {
                let valid = vec!["left".into(), "right".into()];
                Err(to_py(Error::UnknownName { kind: "side", name: other.into(), valid }))
            }
        }
    }

    /// `n` members `(n, 4)`, uniform with respect to the invariant measure; the same seed gives the same bits.
    #[pyo3(signature = (n, seed=0))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        n: Integer,
        #[pyo3(from_py_with = read_seed)] seed: u64,
    ) -> PyResult<Bound<'py, PyAny>> {
        const MOST: usize = 10_000_000;
        let n = n.count("n", 0)?;
        if n > MOST {
            let bound = format!("at most {MOST}; draw more with other seeds");
            return Err(to_py(Error::OutOfRange { what: "n".into(), value: n as f64, bound }));
        }
        let mut values = Fresh::<f64, _>::new(py, [n, 4]);
        let memory = values.memory()?;
        let mut sampler = self.volume.sampler(seed);
        for block in memory.chunks_mut(4 * BLOCK) {
            py.detach(|| {
                for (row, q) in block.chunks_exact_mut(4).zip(sampler.by_ref()) {
                    row.copy_from_slice(&rotation::to_wxyz(&q));
                }
            });
            py.check_signals()?;
        }
        Ok(values.finish().into_any())
    }

    /// Region in which the tool axis z meets the plane at `distance`, perpendicular to the axis at zero tilt.
    ///
    /// Extents are `distance * sin(tilt)` for a distance along the tool, `distance * tan(tilt)` for one along the
    /// plane's normal [FromGravdahl2007, section 8, corrected].
    ///
    /// Raises:
    ///     RedundancyError: a tilt of 90 degrees or more, or a volume whose section has another shape.
    #[pyo3(signature = (distance, along="tool"))]
    fn cross_section(&self, distance: f64, along: &str) -> PyResult<PyCrossSection> {
        let measured = match along {
            "tool" => SectionDistance::AlongTool,
            "normal" => SectionDistance::ToPlane,
            other => {
                let valid = vec!["tool".into(), "normal".into()];
                return Err(to_py(Error::UnknownName { kind: "distance", name: other.into(), valid }));
            }
        };
        let section = self.volume.cross_section(distance, measured).map_err(to_py)?;
        Ok(PyCrossSection { section })
    }

    #[staticmethod]
    fn _restore(
        axes: Vec<[f64; 3]>,
        lower: Vec<f64>,
        upper: Vec<f64>,
        half_angle: Option<f64>,
        before: [f64; 4],
        after: [f64; 4],
    ) -> PyResult<Self> {
        let volume = match half_angle {
            Some(half_angle) => QuaternionVolume::cone(axes.first().copied().unwrap_or_default(), half_angle),
            None => QuaternionVolume::from_axes(&axes, &lower, &upper),
        };
        let restored = volume.and_then(|v| {
            let (before, after) = (rotation::from_wxyz(before)?, rotation::from_wxyz(after)?);
            Ok(v.with_reorientations(before, after))
        });
        Self::from_core(restored)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, VolumeState)> {
        Ok((py.get_type::<Self>().getattr("_restore")?, self.state()))
    }

    /// The intersection with another set, an `OrientationSet`.
    fn __and__<'py>(&self, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        combined(self.volume.clone().into(), other, OrientationSet::and)
    }

    /// The union with another set, an `OrientationSet`.
    fn __or__<'py>(&self, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        combined(self.volume.clone().into(), other, OrientationSet::or)
    }

    fn __repr__(&self) -> String {
        let (axes, lower, upper, half_angle, before, after) = self.state();
        let set = match half_angle {
            Some(half_angle) => format!("cone(axis={:?}, half_angle={half_angle}", axes[0]),
            None => format!("from_axes(axes={axes:?}, lower={lower:?}, upper={upper:?}"),
        };
        let identity = [1.0, 0.0, 0.0, 0.0];
        let side = |q: [f64; 4], name: &str| {
            if q == identity { String::new() } else { format!(".reoriented({q:?}, side='{name}')") }
        };
        format!("QuaternionVolume.{set}){}{}", side(before, "left"), side(after, "right"))
    }
}

/// Region in which the tool axis of a volume can meet a plane.
#[pyclass(name = "CrossSection", module = "redundancy", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyCrossSection {
    section: CrossSection,
}

#[pymethods]
impl PyCrossSection {
    #[new]
    fn new(shape: &str, x: [f64; 2], y: [f64; 2]) -> PyResult<Self> {
        let section = CrossSection { shape: shape.parse().map_err(to_py)?, x, y };
        Ok(Self { section })
    }

    /// `point`, `line`, `square` or `disc`.
    #[getter]
    fn shape(&self) -> &'static str {
        self.section.shape.as_str()
    }

    /// Range along x, in the unit of the distance.
    #[getter]
    fn x(&self) -> (f64, f64) {
        self.section.x.into()
    }

    /// Range along y, in the unit of the distance.
    #[getter]
    fn y(&self) -> (f64, f64) {
        self.section.y.into()
    }

    fn __getnewargs__(&self) -> (&'static str, (f64, f64), (f64, f64)) {
        (self.shape(), self.x(), self.y())
    }

    fn __repr__(&self) -> String {
        let (shape, x, y) = self.__getnewargs__();
        format!("CrossSection(shape='{shape}', x={x:?}, y={y:?})")
    }
}

/// A weight and a constraint of the optimizer.
fn read_barrier(item: &Bound<'_, PyAny>, index: usize) -> PyResult<Barrier> {
    let named = |error: Error| to_py(Error::Invalid(format!("constraints[{index}]: {error}")));
    let Ok((weight, object)) = item.extract::<(f64, Bound<'_, PyAny>)>() else {
        return Err(named(Error::Invalid("expected a pair (weight, constraint)".into())));
    };
    let constraint: Constraint = if let Ok(cone) = object.cast::<PyCone>() {
        cone.get().cone.into()
    } else if let Ok(spin) = object.cast::<PySpin>() {
        spin.get().spin.into()
    } else if let Ok(volume) = object.cast::<PyQuaternionVolume>() {
        let message = "a volume of bounded angles has no smooth margin; give a Cone, a Spin or a cone volume";
        volume.get().volume.as_cone().ok_or_else(|| named(Error::Invalid(message.into())))?.into()
    } else {
        let kind = object.get_type().name()?.to_string();
        return Err(named(Error::Invalid(format!("a {kind} is not a Cone, Spin or QuaternionVolume"))));
    };
    Barrier::new(weight, constraint).map_err(named)
}

type OptimizerArguments<'py> = (Bound<'py, PyList>, &'static str);

/// Finds the orientation that minimises a weighted sum of logarithmic barriers.
///
/// Minimises `sum_i weight_i * -log(margin_i(q))` [FromGravdahl2009, eqs. (27), (34), (43), (46)].
///
/// If the minimiser is not unique (the spin about a common axis of cones), the one that the smallest rotation reaches
/// from `q0` is returned, so that orientations along a path are continuous if each solution is the next `q0`. Without
/// `q0` and with a first cone around `u` that points down it is `swing(u -> z) * [0, 0, 1, 0]`.
///
/// Args:
///     constraints: pairs (weight, constraint), weight > 0, constraint a `Cone`, a `Spin` or a cone
///         `QuaternionVolume`.
///     method: `auto` takes the closed form if it applies (one or two cones on one body axis below 90 degrees, with
///         or without a spin about it; a spin alone), otherwise Newton's method. `closed_form` uses Newton's method
///         for cones of 90 degrees and more and refuses other problems. `newton` is Riemannian Newton on S^3,
///         `gradient` the paper's method, normalised in every iteration.
///     tolerance: Estimated remaining angle, rad, at which the iteration stops. None: 1e-13, gradient 1e-10.
///     max_iterations: None: 200, gradient 10 000.
///     step: Step of `gradient` in the paper's quaternion units. None: from the cones' sizes.
///     backtracking: Whether `gradient` measures the decrease of every step; False is the paper's fixed step.
///
/// Raises:
///     RedundancyError: an empty list, a weight that is not positive, a constraint of another kind, an unknown
///         method, or one that does not apply.
///
/// Example:
///     >>> import redundancy as rd
///     >>> down, aside = rd.Cone.downward(0.35), rd.Cone.z([0.5, 0, -1], 1.0)
///     >>> best = rd.OrientationOptimizer([(1.0, down), (1.0, aside)]).solve()
///     >>> str(best.status), best.method, bool((best.margins > 0).all())
///     ('converged', 'closed_form', True)
#[pyclass(name = "OrientationOptimizer", module = "redundancy", frozen)]
pub struct PyOrientationOptimizer {
    optimizer: OrientationOptimizer,
}

#[pymethods]
impl PyOrientationOptimizer {
    #[new]
    #[pyo3(signature = (constraints, method="auto", *, tolerance=None, max_iterations=None, step=None, backtracking=true))]
    fn new(
        constraints: &Bound<'_, PyAny>,
        method: &str,
        tolerance: Option<f64>,
        max_iterations: Option<Integer>,
        step: Option<f64>,
        backtracking: bool,
    ) -> PyResult<Self> {
        let barriers: PyResult<Vec<Barrier>> =
            constraints.try_iter()?.enumerate().map(|(index, item)| read_barrier(&item?, index)).collect();
        let method = method.parse().map_err(to_py)?;
        let max_iterations = max_iterations.map(|n| n.at_least("max_iterations", 1)).transpose()?;
        let settings = OrientationSettings { method, tolerance, max_iterations, step, backtracking };
        let optimizer = OrientationOptimizer::new(barriers?, settings).map_err(to_py)?;
        Ok(Self { optimizer })
    }

    /// The method that `solve` uses; never `auto`.
    #[getter]
    fn method(&self) -> &'static str {
        self.optimizer.method().as_str()
    }

    /// The pairs (weight, constraint).
    #[getter]
    fn constraints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        for barrier in self.optimizer.barriers() {
            let object = match *barrier.constraint() {
                Constraint::Cone(cone) => Bound::new(py, PyCone { cone })?.into_any(),
                Constraint::Spin(spin) => Bound::new(py, PySpin { spin })?.into_any(),
            };
            list.append((barrier.weight(), object))?;
        }
        Ok(list)
    }

    /// The minimiser, iterated from `q0` `(w, x, y, z)` or, if it is outside, from a feasible start.
    ///
    /// Constraints that exclude each other give the status `infeasible` and the angle by which they miss each other,
    /// not an exception.
    #[pyo3(signature = (q0=None))]
    fn solve(&self, py: Python<'_>, q0: Option<&Bound<'_, PyAny>>) -> PyResult<PyOrientationSolution> {
        let q0 = q0.map(|q| quaternion(q, "q0")).transpose()?;
        Ok(py.detach(|| {
            let solution = self.optimizer.solve(q0.as_ref());
            PyOrientationSolution { solution, margins: self.optimizer.margins(&solution.q).collect() }
        }))
    }

    /// The sum at `q`, infinite outside: a float, or `(N,)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn value<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.optimizer.value(q))
    }

    /// The margins at `q` in the order of the constraints: `(k,)` or `(N, k)`.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, *, threads=None))]
    fn margins<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[self.optimizer.barriers().len()], threads, |q, out: &mut [f64]| {
            out.iter_mut().zip(self.optimizer.margins(q)).for_each(|(slot, m)| *slot = m);
        })
    }

    /// Gradient of the sum along rotation vectors in body axes, 1/rad, `(3,)`. Raises outside.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`.
    fn gradient<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let g = self.optimizer.gradient(&quaternion(q, "q")?).ok_or_else(outside)?;
        Ok(vector(py, &g))
    }

    /// Hessian of the sum along rotation vectors in body axes, 1/rad^2, `(3, 3)`. Raises outside.
    ///
    /// Args:
    ///     q: Unit quaternion `(4,)`.
    fn hessian<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let h = self.optimizer.hessian(&quaternion(q, "q")?).ok_or_else(outside)?;
        Ok(to_array(py, h.as_slice(), [3, 3])?.into_any())
    }

    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(OptimizerArguments<'py>, Bound<'py, PyDict>)> {
        let s = self.optimizer.settings();
        let named = PyDict::new(py);
        named.set_item("tolerance", s.tolerance)?;
        named.set_item("max_iterations", s.max_iterations)?;
        named.set_item("step", s.step)?;
        named.set_item("backtracking", s.backtracking)?;
        Ok(((self.constraints(py)?, s.method.as_str()), named))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let asked = self.optimizer.settings().method.as_str();
        Ok(format!("OrientationOptimizer({}, method='{asked}')", self.constraints(py)?.repr()?))
    }
}

fn outside() -> PyErr {
    to_py(Error::Invalid("q lies outside of a constraint, where the barrier has no derivative".into()))
}

/// Result of `OrientationOptimizer.solve`.
#[pyclass(name = "OrientationSolution", module = "redundancy", frozen)]
pub struct PyOrientationSolution {
    solution: OrientationSolution,
    margins: Vec<f64>,
}

type SolutionState = ([f64; 4], f64, String, u32, Vec<f64>, f64, f64, String);

#[pymethods]
impl PyOrientationSolution {
    /// Orientation `(w, x, y, z)`; when infeasible the one with the smallest violation.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wxyz(py, &self.solution.q)
    }

    /// Sum of weight x barrier, without a unit; infinite when infeasible.
    #[getter]
    fn value(&self) -> f64 {
        self.solution.value
    }

    /// `converged`, `infeasible`, `iteration_limit` or `singular` (the spin is undefined at the minimum).
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        status_to_py(py, self.solution.status)
    }

    /// Iterations; of the closed form the steps of its scalar root.
    #[getter]
    fn iterations(&self) -> u32 {
        self.solution.iterations
    }

    /// Margins in the order of the constraints, `(k,)`.
    #[getter]
    fn margins<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.margins)
    }

    /// Norm of the gradient at `q`, 1/rad; infinite when infeasible.
    #[getter]
    fn gradient_norm(&self) -> f64 {
        self.solution.gradient_norm
    }

    /// Angle, rad, by which the constraints miss each other; 0 when they meet.
    ///
    /// For two cones on one axis the angle between their rims, in general twice the least angle by which all of
    /// them have to grow. Exact for pairs of cones, an upper bound for more.
    #[getter]
    fn miss_angle(&self) -> f64 {
        self.solution.miss_angle
    }

    /// The method that was used.
    #[getter]
    fn method(&self) -> &'static str {
        self.solution.method.as_str()
    }

    #[staticmethod]
    fn _restore(
        q: [f64; 4],
        value: f64,
        status: &str,
        iterations: u32,
        margins: Vec<f64>,
        gradient_norm: f64,
        miss_angle: f64,
        method: &str,
    ) -> PyResult<Self> {
        let method: OrientationMethod = method.parse().map_err(to_py)?;
        let status = Status::ALL.into_iter().find(|s| s.as_str() == status).ok_or_else(|| {
            let valid = Status::ALL.iter().map(|s| s.as_str().into()).collect();
            to_py(Error::UnknownName { kind: "status", name: status.into(), valid })
        })?;
        let q = rotation::from_wxyz(q).map_err(to_py)?;
        let solution =
            OrientationSolution { q, value, status, iterations, gradient_norm, miss_angle, method };
        Ok(Self { solution, margins })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, SolutionState)> {
        let s = &self.solution;
        let state = (
            rotation::to_wxyz(&s.q),
            s.value,
            s.status.as_str().into(),
            s.iterations,
            self.margins.clone(),
            s.gradient_norm,
            s.miss_angle,
            s.method.as_str().into(),
        );
        Ok((py.get_type::<Self>().getattr("_restore")?, state))
    }

    fn __repr__(&self) -> String {
        let s = &self.solution;
        format!(
            "OrientationSolution(status='{}', q={:?}, value={}, iterations={}, gradient_norm={:e}, miss_angle={}, \
             method='{}')",
            s.status,
            rotation::to_wxyz(&s.q),
            s.value,
            s.iterations,
            s.gradient_norm,
            s.miss_angle,
            s.method.as_str()
        )
    }
}

/// Rows of one input of `optimal_directions`, repeated when there is one row for many.
fn spread(values: &[f64], batch: Option<usize>, n: usize) -> std::borrow::Cow<'_, [[f64; 3]]> {
    let (rows, _) = values.as_chunks::<3>();
    match batch {
        Some(_) => rows.into(),
        None => vec![rows[0]; n].into(),
    }
}

/// The best tool axes for many pairs of directions, each with a cone around it.
///
/// Row i minimises `-k_err log((z . n - cos beta)/2) - k_tcp log((z . d - cos alpha)/2)` over unit vectors z
/// [FromGravdahl2009, eq. (34)]; if the cones miss each other, z is the middle of the gap. Runs on all cores without
/// the GIL; the result does not depend on their number.
///
/// Args:
///     normals: `(N, 3)` or `(3,)` for all rows, of any length: directions that the tool axis should follow. For a
///         tool that looks at a surface they point into it.
///     directions: `(N, 3)` or `(3,)`: the desired directions.
///     beta: Half-angle around the normals, rad, in (0, pi).
///     alpha: Half-angle around the desired directions, rad, in (0, pi). From pi/2 on, rows are solved by Newton's
///         method.
///     k_err: Weight of the first barrier, > 0.
///     k_tcp: Weight of the second barrier, > 0.
///     threads: Number of threads; None: all cores.
///
/// Returns:
///     Unit tool axes `(N, 3)` and statuses `(N,)`, an object array of `Status`: `converged` or `infeasible`. Two
///     single directions give `(3,)` and one `Status`.
///
/// Raises:
///     RedundancyError: a row without a direction, angles or weights out of range, different lengths.
///
/// Example:
///     >>> import redundancy as rd
///     >>> axes, status = rd.optimal_directions([[0, 0, -1]], [[0.5, 0, -1]], 0.4, 1.0)
///     >>> axes.shape, str(status[0])
///     ((1, 3), 'converged')
#[pyfunction]
#[pyo3(signature = (normals, directions, beta, alpha, k_err=1.0, k_tcp=1.0, *, threads=None))]
pub fn optimal_directions<'py>(
    py: Python<'py>,
    normals: &Bound<'py, PyAny>,
    directions: &Bound<'py, PyAny>,
    beta: f64,
    alpha: f64,
    k_err: f64,
    k_tcp: f64,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyTuple>> {
    let (u, c) = (read_rows(normals, "normals", &[3])?, read_rows(directions, "directions", &[3])?);
    if let (Some(expected), Some(actual)) = (u.batch, c.batch)
        && expected != actual
    {
        return Err(to_py(Error::Length { what: "directions".into(), expected, actual }));
    }
    let batch = u.batch.or(c.batch);
    let n = batch.unwrap_or(1);
    let (u, c) = (spread(u.as_slice()?, u.batch, n), spread(c.as_slice()?, c.batch, n));
    let cones = DirectionCones { beta, alpha, k_err, k_tcp };
    cones.validate().map_err(to_py)?;
    let mut array = Fresh::<f64, _>::new(py, [n, 3]);
    let (axes, _) = array.memory()?.as_chunks_mut::<3>();
    let mut status = vec![Status::Cancelled; n];
    in_blocks(py, n, BLOCK, threads, |range| {
        let (u, c) = (&u[range.clone()], &c[range.clone()]);
        cones.solve_rows(range.start, u, c, &mut axes[range.clone()], &mut status[range])
    })?;
    let array = array.finish();
    if batch.is_none() {
        return (array.reshape([3])?, status_to_py(py, status[0])?).into_pyobject(py);
    }
    (array, statuses_to_py(py, &status)?).into_pyobject(py)
}

macro_rules! angles {
    ($(
        $(#[doc = $from_doc:tt])* $from:ident $core_from:ident;
        $(#[doc = $to_doc:tt])* $to:ident $core_to:ident;
    )*) => {$(
        $(#[doc = $from_doc])*
        #[pyfunction]
        #[pyo3(signature = (angles, *, threads=None))]
        pub fn $from<'py>(angles: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
            map_rows::<f64, 3>(angles, "angles", &[4], threads, |a, out| {
                if let Some(index) = a.iter().position(|x| !x.is_finite()) {
                    return Err(Error::NotFinite { what: "angles".into(), index, value: a[index] });
                }
                out.copy_from_slice(&rotation::to_wxyz(&rotation::$core_from(a)));
                Ok(())
            })
        }

        $(#[doc = $to_doc])*
        #[pyfunction]
        #[pyo3(signature = (q, *, threads=None))]
        pub fn $to<'py>(q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
            map_quaternions(q, &[3], threads, |q, out: &mut [f64]| {
                out.copy_from_slice(&rotation::$core_to(q));
            })
        }
    )*};
}

angles! {
    /// `Rz(a) Ry(b) Rz(c)` as a quaternion `(w, x, y, z)`.
    ///
    /// Args:
    ///     angles: `(3,)` or `(N, 3)` angles (a, b, c), rad.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(4,)` or `(N, 4)`.
    quaternion_from_zyz from_zyz;
    /// Angles of `Rz(a) Ry(b) Rz(c)`, rad, b in [0, pi]; where b is 0 or pi, a = 0.
    ///
    /// Args:
    ///     q: Unit quaternions `(4,)` or `(N, 4)`.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(3,)` or `(N, 3)`, rad.
    quaternion_to_zyz to_zyz;
    /// `Rx(a) Ry(b) Rz(c)` as a quaternion `(w, x, y, z)`.
    ///
    /// Args:
    ///     angles: `(3,)` or `(N, 3)` angles (a, b, c), rad.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(4,)` or `(N, 4)`.
    quaternion_from_xyz from_xyz;
    /// Angles of `Rx(a) Ry(b) Rz(c)`, rad, b in [-pi/2, pi/2]; where b is +-pi/2, a = 0.
    ///
    /// Args:
    ///     q: Unit quaternions `(4,)` or `(N, 4)`.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(3,)` or `(N, 3)`, rad.
    quaternion_to_xyz to_xyz;
    /// `Rz(phi) Ry(theta) Rx(psi)` as a quaternion `(w, x, y, z)`.
    ///
    /// Args:
    ///     angles: `(3,)` or `(N, 3)` angles (phi, theta, psi), rad.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(4,)` or `(N, 4)`.
    quaternion_from_rpy from_rpy;
    /// Angles (phi, theta, psi) of `Rz(phi) Ry(theta) Rx(psi)`, rad; where theta is +-pi/2, psi = 0.
    ///
    /// Args:
    ///     q: Unit quaternions `(4,)` or `(N, 4)`.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(3,)` or `(N, 3)`, rad.
    quaternion_to_rpy to_rpy;
}

type Vector<'py> = Bound<'py, PyArray1<f64>>;

/// `(swing, twist)` with `q = swing * twist`, the twist about `axis`; at half a turn of swing the identity.
///
/// Args:
///     q: Unit quaternion `(4,)`.
///     axis: `(3,)`, of any length.
#[pyfunction]
pub fn quaternion_swing_twist<'py>(
    py: Python<'py>,
    q: &Bound<'py, PyAny>,
    axis: &Bound<'py, PyAny>,
) -> PyResult<(Vector<'py>, Vector<'py>)> {
    let axis = rotation::unit_direction("axis", read_array(axis, "axis")?).map_err(to_py)?;
    let (swing, twist) = rotation::swing_twist(&quaternion(q, "q")?, &axis);
    Ok((wxyz(py, &swing), wxyz(py, &twist)))
}

/// The smallest rotation from one direction to another; between opposite directions half a turn, for z about y.
///
/// Args:
///     start: `(3,)`, of any length.
///     end: `(3,)`, of any length.
#[pyfunction]
pub fn quaternion_shortest_arc<'py>(
    py: Python<'py>,
    start: &Bound<'py, PyAny>,
    end: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let start = rotation::unit_direction("start", read_array(start, "start")?).map_err(to_py)?;
    let end = rotation::unit_direction("end", read_array(end, "end")?).map_err(to_py)?;
    Ok(wxyz(py, &rotation::shortest_arc(&start, &end)))
}

/// `conj(start) * end` with a scalar part >= 0 [FromGravdahl2009, eq. (8), on the shorter side of the cover].
///
/// Args:
///     start: Unit quaternion `(4,)`.
///     end: Unit quaternion `(4,)`.
#[pyfunction]
pub fn quaternion_error<'py>(
    py: Python<'py>,
    start: &Bound<'py, PyAny>,
    end: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(wxyz(py, &rotation::quaternion_error(&quaternion(start, "start")?, &quaternion(end, "end")?)))
}

/// Angle, rad in [0, pi], of the rotation between two orientations.
///
/// Args:
///     a: Unit quaternion `(4,)`.
///     b: Unit quaternion `(4,)`.
#[pyfunction]
pub fn quaternion_angle(a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<f64> {
    Ok(rotation::rotation_angle(&quaternion(a, "a")?, &quaternion(b, "b")?))
}
