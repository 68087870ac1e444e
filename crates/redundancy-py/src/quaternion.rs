//! `redundancy.quaternion`: the algebra of unit quaternions `(w, x, y, z)`, and `pose`.

use std::ops::Range;

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use redundancy_core::rotation::{self, to_wxyz};
use redundancy_core::{Error, Pose, Result, pose_to_row_major, rotation_from_matrix};

use crate::batch::in_blocks;
use crate::convert::{Fresh, Rows, Threads, read_matrices, read_rows};
use crate::error::to_py;

/// Rows between two looks at Ctrl-C: some milliseconds.
const BLOCK: usize = 65_536;

/// Arguments of one call, each of one row or of as many as the others.
struct Arguments<'a> {
    values: Vec<(&'a [f64], bool)>,
    batch: Option<usize>,
}

impl<'a> Arguments<'a> {
    /// Named rows; those with a leading axis must agree in length.
    fn new(rows: &'a [(&str, &Rows<'_>)]) -> PyResult<Self> {
        let mut batch: Option<usize> = None;
        let mut values = Vec::with_capacity(rows.len());
        for (what, rows) in rows {
            if let (Some(expected), Some(actual)) = (batch, rows.batch)
                && expected != actual
            {
                return Err(to_py(Error::Length { what: format!("{what} (rows)"), expected, actual }));
            }
            batch = batch.or(rows.batch);
            values.push((rows.as_slice()?, rows.batch.is_some()));
        }
        Ok(Self { values, batch })
    }

    /// Row `i` of argument `k`.
    fn row<const N: usize>(&self, k: usize, i: usize) -> [f64; N] {
        let (values, many) = self.values[k];
        values.as_chunks::<N>().0[if many { i } else { 0 }]
    }

    /// Calls `one` for every row and returns `(*shape)` or `(N, *shape)`.
    fn map<'py>(
        &self,
        py: Python<'py>,
        shape: &[usize],
        threads: Option<Threads>,
        one: impl Fn(usize, &mut [f64]) -> Result<()> + Send + Sync,
    ) -> PyResult<Bound<'py, PyAny>> {
        let width: usize = shape.iter().product();
        let mut array = Fresh::<f64, _>::new(py, [self.batch.unwrap_or(1) * width]);
        let memory = array.memory()?;
        let named = |i: usize, error: Error| match self.batch {
            None => error,
            Some(_) => Error::Invalid(format!("row {i}: {error}")),
        };
        in_blocks(py, self.batch.unwrap_or(1), BLOCK, threads, |range: Range<usize>| {
            let rows = memory[range.start * width..range.end * width].chunks_exact_mut(width);
            range.zip(rows).try_for_each(|(i, out)| one(i, out).map_err(|error| named(i, error)))
        })?;
        let shape: Vec<usize> = self.batch.into_iter().chain(shape.iter().copied()).collect();
        array.finish().call_method1("reshape", (PyTuple::new(py, shape)?,))
    }
}

fn unit(what: &str, wxyz: [f64; 4]) -> Result<UnitQuaternion<f64>> {
    rotation::from_wxyz(wxyz).map_err(|error| match error {
        Error::NotUnit { norm, tolerance, .. } => Error::NotUnit { what: what.into(), norm, tolerance },
        Error::NotFinite { index, value, .. } => Error::NotFinite { what: what.into(), index, value },
        other => other,
    })
}

/// `a * b`: the rotation b and then, about fixed axes, a.
///
/// Arguments are `(4,)` or `(N, 4)`; a single quaternion is used for all rows.
///
/// Args:
///     a: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
///     b: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (a, b, *, threads=None))]
pub fn quaternion_product<'py>(
    a: &Bound<'py, PyAny>,
    b: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyAny>> {
    let (first, second) = (read_rows(a, "a", &[4])?, read_rows(b, "b", &[4])?);
    let arguments = [("a", &first), ("b", &second)];
    let arguments = Arguments::new(&arguments)?;
    arguments.map(a.py(), &[4], threads, |i, out| {
        let (a, b) = (unit("a", arguments.row(0, i))?, unit("b", arguments.row(1, i))?);
        out.copy_from_slice(&to_wxyz(&rotation::compose(&a, &b)));
        Ok(())
    })
}

/// `(w, -x, -y, -z)`, the inverse rotation, of `(4,)` or `(N, 4)`.
///
/// Args:
///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (q, *, threads=None))]
pub fn quaternion_conjugate<'py>(
    q: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = read_rows(q, "q", &[4])?;
    let arguments = [("q", &rows)];
    let arguments = Arguments::new(&arguments)?;
    arguments.map(q.py(), &[4], threads, |i, out| {
        out.copy_from_slice(&to_wxyz(&unit("q", arguments.row(0, i))?.conjugate()));
        Ok(())
    })
}

/// Vectors `(3,)` or `(N, 3)` rotated by `(4,)` or `(N, 4)`; a single one is used for all rows.
///
/// Args:
///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
///     v: `(3,)` or `(N, 3)`, any unit.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (q, v, *, threads=None))]
pub fn quaternion_rotate<'py>(
    q: &Bound<'py, PyAny>,
    v: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyAny>> {
    let (turns, vectors) = (read_rows(q, "q", &[4])?, read_rows(v, "v", &[3])?);
    let arguments = [("q", &turns), ("v", &vectors)];
    let arguments = Arguments::new(&arguments)?;
    arguments.map(q.py(), &[3], threads, |i, out| {
        let v: [f64; 3] = arguments.row(1, i);
        finite("v", &v)?;
        out.copy_from_slice((unit("q", arguments.row(0, i))? * Vector3::from(v)).as_slice());
        Ok(())
    })
}

/// Rotation by `angle`, rad, a number or `(N,)`, about `axis` `(3,)` or `(N, 3)` of any length.
///
/// Args:
///     axis: `(3,)` or `(N, 3)`, of any length.
///     angle: A number or `(N,)`, rad.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (axis, angle, *, threads=None))]
pub fn quaternion_from_axis_angle<'py>(
    axis: &Bound<'py, PyAny>,
    angle: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyAny>> {
    let (axes, angles) = (read_rows(axis, "axis", &[3])?, read_rows(angle, "angle", &[])?);
    let arguments = [("axis", &axes), ("angle", &angles)];
    let arguments = Arguments::new(&arguments)?;
    arguments.map(axis.py(), &[4], threads, |i, out| {
        let [angle] = arguments.row(1, i);
        out.copy_from_slice(&to_wxyz(&rotation::from_axis_angle(arguments.row(0, i), angle)?));
        Ok(())
    })
}

/// Unit axis `(3,)` and angle, rad in [0, pi], or `(N, 3)` and `(N,)`. The axis of the identity is z.
///
/// Args:
///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (q, *, threads=None))]
pub fn quaternion_to_axis_angle<'py>(
    q: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyTuple>> {
    let py = q.py();
    let rows = read_rows(q, "q", &[4])?;
    let arguments = [("q", &rows)];
    let arguments = Arguments::new(&arguments)?;
    let read = |i: usize| Ok(rotation::to_axis_angle(&unit("q", arguments.row(0, i))?));
    let axis = arguments.map(py, &[3], threads, |i, out| {
        out.copy_from_slice(read(i)?.0.as_slice());
        Ok(())
    })?;
    let angle = arguments.map(py, &[], threads, |i, out| {
        out[0] = read(i)?.1;
        Ok(())
    })?;
    let angle = if rows.batch.is_none() { angle.call_method0("item")? } else { angle };
    PyTuple::new(py, [axis, angle])
}

/// Quaternion with a scalar part >= 0 of a rotation `(3, 3)` or `(N, 3, 3)`, or of an object with `as_matrix()`.
///
/// A matrix that is off by up to 1e-3 (largest deviation of a singular value from 1) is replaced by the nearest
/// rotation.
///
/// Args:
///     matrix: Rotations `(3, 3)` or `(N, 3, 3)`.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (matrix, *, threads=None))]
pub fn quaternion_from_matrix<'py>(
    matrix: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = read_matrices(matrix, "matrix")?;
    let arguments = [("matrix", &rows)];
    let arguments = Arguments::new(&arguments)?;
    arguments.map(matrix.py(), &[4], threads, |i, out| {
        let matrix: [f64; 9] = arguments.row(0, i);
        let rotation = rotation_from_matrix("matrix", &Matrix3::from_row_slice(&matrix))?;
        out.copy_from_slice(&to_wxyz(&rotation::from_rotation(&rotation)));
        Ok(())
    })
}

/// Rotation matrix `(3, 3)` of `(4,)`, or `(N, 3, 3)` of `(N, 4)`.
///
/// Args:
///     q: Unit quaternion `(4,)`, or `(N, 4)`, scalar first.
///     threads: Threads for a batch; all cores by default.
#[pyfunction]
#[pyo3(signature = (q, *, threads=None))]
pub fn quaternion_to_matrix<'py>(
    q: &Bound<'py, PyAny>,
    threads: Option<Threads>,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = read_rows(q, "q", &[4])?;
    let arguments = [("q", &rows)];
    let arguments = Arguments::new(&arguments)?;
    arguments.map(q.py(), &[3, 3], threads, |i, out| {
        let rotation = unit("q", arguments.row(0, i))?.to_rotation_matrix();
        // Column by column there, row by row in numpy.
        out.copy_from_slice(rotation.matrix().transpose().as_slice());
        Ok(())
    })
}

/// A pose from a position and at most one form of orientation.
///
/// Args:
///     position: `(3,)` or `(N, 3)`, m.
///     quaternion_wxyz: `(4,)` or `(N, 4)`, scalar first; a norm within 1e-3 of 1 is normalised, others are refused.
///     rpy: `(3,)` or `(N, 3)` roll, pitch, yaw, rad, in the order of a URDF: `R = Rz(yaw) Ry(pitch) Rx(roll)`.
///         (`quaternion.from_rpy` takes the angles in the order of the product, z first.)
///     matrix: `(3, 3)` or `(N, 3, 3)` rotation, or an object with `as_matrix()`. A matrix that is off by up to 1e-3
///         (largest deviation of a singular value from 1) is replaced by the nearest rotation.
///
/// Returns:
///     `(4, 4)`, or `(N, 4, 4)` where an argument has a leading axis.
///
/// Raises:
///     RedundancyError: More than one orientation, wrong shapes, numbers that are not finite; a quaternion or matrix
///         that is farther off, or a reflection (the message gives the deviation).
///
/// Example:
///     >>> import redundancy as rd
///     >>> rd.pose((0.4, 0.0, 0.3), quaternion_wxyz=(0, 1, 0, 0))[:3, 2].tolist()
///     [0.0, 0.0, -1.0]
#[pyfunction]
#[pyo3(name = "pose", signature = (position, quaternion_wxyz=None, rpy=None, matrix=None))]
pub fn py_pose<'py>(
    position: &Bound<'py, PyAny>,
    quaternion_wxyz: Option<&Bound<'py, PyAny>>,
    rpy: Option<&Bound<'py, PyAny>>,
    matrix: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let positions = read_rows(position, "position", &[3])?;
    type Turn = fn(&Arguments<'_>, usize) -> Result<Rotation3<f64>>;
    let (name, rows, turn): (&str, Option<Rows<'py>>, Turn) = match (quaternion_wxyz, rpy, matrix) {
        (None, None, None) => ("", None, |_, _| Ok(Rotation3::identity())),
        (Some(q), None, None) => {
            let name = "quaternion_wxyz";
            (name, Some(read_rows(q, name, &[4])?), |arguments, i| {
                let q = rotation::from_rounded_wxyz("quaternion_wxyz", arguments.row(1, i))?;
                Ok(q.to_rotation_matrix())
            })
        }
        (None, Some(angles), None) => ("rpy", Some(read_rows(angles, "rpy", &[3])?), |arguments, i| {
            let [roll, pitch, yaw] = arguments.row(1, i);
            finite("rpy", &[roll, pitch, yaw])?;
            Ok(Rotation3::from_euler_angles(roll, pitch, yaw))
        }),
        (None, None, Some(matrix)) => ("matrix", Some(read_matrices(matrix, "matrix")?), |arguments, i| {
            let matrix: [f64; 9] = arguments.row(1, i);
            rotation_from_matrix("matrix", &Matrix3::from_row_slice(&matrix))
        }),
        _ => {
            let message = "give one of quaternion_wxyz, rpy and matrix, or none of them for no rotation";
            return Err(to_py(Error::Invalid(message.into())));
        }
    };
    let mut arguments = vec![("position", &positions)];
    arguments.extend(rows.as_ref().map(|rows| (name, rows)));
    let arguments = Arguments::new(&arguments)?;
    arguments.map(position.py(), &[4, 4], None::<Threads>, |i, out| {
        let position: [f64; 3] = arguments.row(0, i);
        finite("position", &position)?;
        let pose = Pose::from_parts(Translation3::from(Vector3::from(position)), turn(&arguments, i)?);
        out.copy_from_slice(&pose_to_row_major(&pose));
        Ok(())
    })
}

fn finite(what: &str, values: &[f64]) -> Result<()> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NotFinite { what: what.into(), index, value: values[index] }),
    }
}
