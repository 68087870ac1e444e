//! The only file that knows numpy's layout and the scalar-first quaternion order of the Python face.
//!
//! Small inputs are copied, batches are borrowed. A pose is an array or any object with `homogeneous`
//! (pinocchio), `as_matrix()` (scipy, mink, viser) or `A` (spatialmath); none of those packages is imported.

use numpy::ndarray::{Dim, Dimension, IntoDimension};
use numpy::{
    Element, PyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use redundancy_core::{Error, Pose, pose_from_row_major, pose_to_row_major};

use crate::error::to_py;

/// One item or a batch of items of a fixed inner shape, as a borrowed C-contiguous array of doubles.
pub struct Rows<'py> {
    array: PyReadonlyArrayDyn<'py, f64>,
    /// Number of items when there is a leading batch axis.
    pub batch: Option<usize>,
}

impl Rows<'_> {
    /// All numbers, row by row.
    pub fn as_slice(&self) -> PyResult<&[f64]> {
        Ok(self.array.as_slice()?)
    }
}

/// Reads an array of shape `inner` or `(N, *inner)`.
pub fn read_rows<'py>(object: &Bound<'py, PyAny>, what: &str, inner: &[usize]) -> PyResult<Rows<'py>> {
    let array = as_double_array(object, what)?;
    let shape = array.shape();
    let batch = if shape == inner {
        None
    } else if shape.len() == inner.len() + 1 && &shape[1..] == inner {
        Some(shape[0])
    } else {
        let expected = shape_text(inner);
        let batched = shape_text(&[&[usize::MAX], inner].concat());
        let message = format!("{what} has shape {}, expected {expected} or {batched}", shape_text(shape));
        return Err(to_py(Error::Invalid(message)));
    };
    Ok(Rows { array: array.try_readonly()?, batch })
}

/// Reads a vector of doubles; `length` is checked when given. Copies.
pub fn read_vector(object: &Bound<'_, PyAny>, what: &str, length: Option<usize>) -> PyResult<Vec<f64>> {
    let values = match object.cast::<PyArray1<f64>>() {
        Ok(array) => array.to_vec().or_else(|_| contiguous_vec(object, what))?,
        Err(_) => contiguous_vec(object, what)?,
    };
    match length {
        Some(expected) if expected != values.len() => {
            Err(to_py(Error::Length { what: what.into(), expected, actual: values.len() }))
        }
        _ => Ok(values),
    }
}

/// Reads a fixed-length vector of doubles. Copies.
pub fn read_array<const N: usize>(object: &Bound<'_, PyAny>, what: &str) -> PyResult<[f64; N]> {
    let values = read_vector(object, what, Some(N))?;
    values
        .try_into()
        .map_err(|v: Vec<f64>| to_py(Error::Length { what: what.into(), expected: N, actual: v.len() }))
}

fn contiguous_vec(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<f64>> {
    let array = as_double_array(object, what)?;
    if array.ndim() != 1 {
        let message = format!("{what} has shape {}, expected one axis", shape_text(array.shape()));
        return Err(to_py(Error::Invalid(message)));
    }
    Ok(array.to_vec()?)
}

/// One pose.
pub fn read_pose(object: &Bound<'_, PyAny>) -> PyResult<Pose> {
    let rows = read_rows(&pose_array(object)?, "pose", &[4, 4])?;
    if rows.batch.is_some() {
        return Err(to_py(Error::Invalid("expected one pose (4, 4), got a batch".into())));
    }
    pose_from_row_major(rows.as_slice()?).map_err(to_py)
}

/// One pose or many.
pub fn read_poses<'py>(object: &Bound<'py, PyAny>) -> PyResult<Rows<'py>> {
    read_rows(&pose_array(object)?, "pose", &[4, 4])
}

/// The array inside an SE3-like object, or the object itself.
fn pose_array<'py>(object: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    if object.cast::<PyArrayDyn<f64>>().is_ok() {
        return Ok(object.clone());
    }
    let py = object.py();
    if let Some(value) = object.getattr_opt(pyo3::intern!(py, "homogeneous"))? {
        return Ok(value);
    }
    if let Some(method) = object.getattr_opt(pyo3::intern!(py, "as_matrix"))? {
        return method.call0();
    }
    // numpy arrays of other types have no attribute A since numpy 2; matrices do, and there it is an array.
    if let Some(value) = object.getattr_opt(pyo3::intern!(py, "A"))? {
        return Ok(value);
    }
    Ok(object.clone())
}

/// A C-contiguous array of doubles: the object itself where it is one.
fn as_double_array<'py>(object: &Bound<'py, PyAny>, what: &str) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if let Ok(array) = object.cast::<PyArrayDyn<f64>>()
        && array.is_c_contiguous()
    {
        return Ok(array.clone());
    }
    static ASCONTIGUOUS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = object.py();
    let convert = ASCONTIGUOUS
        .get_or_try_init(py, || py.import("numpy")?.getattr("asarray").map(Bound::unbind))?
        .bind(py);
    let options = PyDict::new(py);
    options.set_item("dtype", "float64")?;
    options.set_item("order", "C")?;
    let array = convert.call((object,), Some(&options)).map_err(|error| {
        let message = format!("{what} cannot be read as an array of numbers: {error}");
        to_py(Error::Invalid(message))
    })?;
    Ok(array.cast_into::<PyArrayDyn<f64>>()?)
}

fn shape_text(shape: &[usize]) -> String {
    let axes: Vec<String> =
        shape.iter().map(|n| if *n == usize::MAX { "N".into() } else { n.to_string() }).collect();
    if axes.len() == 1 { format!("({},)", axes[0]) } else { format!("({})", axes.join(", ")) }
}

/// A new array of `shape` with `values` row by row.
pub fn to_array<'py, T: Element + Copy, const D: usize>(
    py: Python<'py>,
    values: &[T],
    shape: [usize; D],
) -> PyResult<Bound<'py, PyArray<T, Dim<[usize; D]>>>>
where
    Dim<[usize; D]>: Dimension,
    [usize; D]: IntoDimension<Dim = Dim<[usize; D]>>,
{
    let array = new_array(py, shape);
    let memory = writable(&array)?;
    if memory.len() != values.len() {
        let (expected, actual) = (memory.len(), values.len());
        return Err(to_py(Error::Length { what: "array".into(), expected, actual }));
    }
    memory.copy_from_slice(values);
    Ok(array)
}

/// A new C-contiguous array, all zero.
pub fn new_array<'py, T: Element, const D: usize>(
    py: Python<'py>,
    shape: [usize; D],
) -> Bound<'py, PyArray<T, Dim<[usize; D]>>>
where
    Dim<[usize; D]>: Dimension,
    [usize; D]: IntoDimension<Dim = Dim<[usize; D]>>,
{
    PyArray::zeros(py, shape, false)
}

/// The memory of an array that [`new_array`] has just made and that nobody else has seen.
pub fn writable<'a, T: Element, D: Dimension>(array: &'a Bound<'_, PyArray<T, D>>) -> PyResult<&'a mut [T]> {
    // SAFETY: callers pass a fresh array, so this is the only reference to its memory while it is being filled.
    Ok(unsafe { array.as_slice_mut()? })
}

/// A pose as `(4, 4)`.
pub fn pose_to_array<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Bound<'py, numpy::PyArray2<f64>>> {
    to_array(py, &pose_to_row_major(pose), [4, 4])
}
