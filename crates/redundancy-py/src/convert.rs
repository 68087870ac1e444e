//! The only file that knows numpy's layout and the scalar-first quaternion order of the Python face.
//!
//! Small inputs are copied, batches are borrowed. A pose is an array or any object with `homogeneous`
//! (pinocchio), `as_matrix()` (scipy, mink, viser) or `A` (spatialmath); none of those packages is imported.

use std::convert::Infallible;
use std::ops::Deref;

use numpy::ndarray::{Dim, Dimension, IntoDimension};
use numpy::{
    Element, PyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use redundancy_core::nalgebra::{Matrix3, Rotation3, Vector3};
use redundancy_core::{Error, Pose, pose_from_row_major, pose_to_row_major, rotation_from_matrix};

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

/// Reads an array of numbers of any shape: itself where it can be read in place, and its shape.
pub fn read_numbers<'py>(
    object: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<(Bound<'py, PyArrayDyn<f64>>, Vec<usize>)> {
    let array = as_double_array(&pose_array(object)?, what)?;
    let shape = array.shape().to_vec();
    Ok((array, shape))
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
    // Exactly an array: subclasses may have a mask.
    let values = match object.cast::<PyArray1<f64>>() {
        Ok(array) if object.is_exact_instance_of::<PyArray1<f64>>() => {
            array.to_vec().or_else(|_| contiguous_vec(object, what))?
        }
        _ => contiguous_vec(object, what)?,
    };
    match length {
        Some(expected) if expected != values.len() => {
            Err(to_py(Error::Length { what: what.into(), expected, actual: values.len() }))
        }
        _ => Ok(values),
    }
}

/// Reads one number; `what` names it in messages.
pub fn read_number(object: &Bound<'_, PyAny>, what: &str) -> PyResult<f64> {
    object.extract().map_err(|_| {
        let given = object.get_type().name().map_or_else(|_| "object".into(), |name| name.to_string());
        PyTypeError::new_err(format!("{what} must be a number, not {given}"))
    })
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

/// A rotation given as `(3, 3)`.
pub fn read_rotation(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Rotation3<f64>> {
    let rows = read_rows(object, what, &[3, 3])?;
    if rows.batch.is_some() {
        return Err(to_py(Error::Invalid(format!("{what}: expected one rotation (3, 3), got a batch"))));
    }
    rotation_from_matrix(what, &Matrix3::from_row_slice(rows.as_slice()?)).map_err(to_py)
}

/// One pose. A rotation that is off by up to 1e-3 is replaced by the nearest one.
pub fn read_pose(object: &Bound<'_, PyAny>) -> PyResult<Pose> {
    let rows = read_rows(&pose_array(object)?, "pose", &[4, 4])?;
    if rows.batch.is_some() {
        return Err(to_py(Error::Invalid("expected one pose (4, 4), got a batch".into())));
    }
    pose_from_row_major(rows.as_slice()?).map_err(to_py)
}

/// Rotation matrices `(3, 3)` or `(N, 3, 3)`, or an object with `as_matrix()` that gives them.
pub fn read_matrices<'py>(object: &Bound<'py, PyAny>, what: &str) -> PyResult<Rows<'py>> {
    match object.getattr_opt(pyo3::intern!(object.py(), "as_matrix"))? {
        Some(method) => read_rows(&method.call0()?, what, &[3, 3]),
        None => read_rows(object, what, &[3, 3]),
    }
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

/// Refuses a numpy masked array with masked entries, whose numbers mean nothing.
fn refuse_masked(object: &Bound<'_, PyAny>, what: &str) -> PyResult<()> {
    let py = object.py();
    let Some(mask) = object.getattr_opt(pyo3::intern!(py, "mask"))? else { return Ok(()) };
    let Some(any) = mask.getattr_opt(pyo3::intern!(py, "any"))? else { return Ok(()) };
    if any.call0()?.is_truthy()? {
        return Err(to_py(Error::Invalid(format!("{what} has masked entries"))));
    }
    Ok(())
}

/// A C-contiguous aligned array of doubles: the object itself where it is one.
fn as_double_array<'py>(object: &Bound<'py, PyAny>, what: &str) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    // Masked arrays are a subclass: plain ones are not asked.
    if !object.is_exact_instance_of::<PyArrayDyn<f64>>() {
        refuse_masked(object, what)?;
    }
    if let Some(array) = ready(object) {
        return Ok(array);
    }
    static ASARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = object.py();
    let refuse = |error: PyErr| {
        let error = error.value(py);
        to_py(Error::Invalid(format!("{what} cannot be read as an array of numbers: {error}")))
    };
    let convert =
        ASARRAY.get_or_try_init(py, || py.import("numpy")?.getattr("asarray").map(Bound::unbind))?.bind(py);
    let array = convert.call1((object,)).map_err(refuse)?;
    if let Some(array) = ready(&array) {
        return Ok(array);
    }
    // Without this numpy reads numbers out of texts and dates.
    refuse_other_kinds(&array, what)?;
    let options = PyDict::new(py);
    options.set_item("order", "C")?;
    let array = array.call_method("astype", ("float64",), Some(&options)).map_err(refuse)?;
    Ok(array.cast_into::<PyArrayDyn<f64>>()?)
}

/// The object where it is an array that can be read in place.
fn ready<'py>(object: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArrayDyn<f64>>> {
    let array = object.cast::<PyArrayDyn<f64>>().ok()?;
    (array.is_c_contiguous() && array.is_aligned()).then(|| array.clone())
}

/// Refuses arrays of anything but real numbers.
fn refuse_other_kinds(array: &Bound<'_, PyAny>, what: &str) -> PyResult<()> {
    let py = array.py();
    let kind = |object: &Bound<'_, PyAny>| -> PyResult<Option<(String, String)>> {
        let Some(dtype) = object.getattr_opt(pyo3::intern!(py, "dtype"))? else { return Ok(None) };
        Ok(Some((dtype.getattr(pyo3::intern!(py, "kind"))?.extract()?, dtype.str()?.extract()?)))
    };
    let Some((letter, dtype)) = kind(array)? else { return Ok(()) };
    let holds = match letter.as_str() {
        "f" | "i" | "u" | "b" => return Ok(()),
        "O" => {
            for (i, item) in array.call_method0("ravel")?.call_method0("tolist")?.try_iter()?.enumerate() {
                let item = item?;
                let number = item.hasattr(pyo3::intern!(py, "__float__"))?
                    && kind(&item)?.is_none_or(|(letter, _)| "fiub".contains(&letter));
                if !number {
                    let item = item.repr()?;
                    let message = format!("{what}: entry {i} is {item}, a real number is needed");
                    return Err(to_py(Error::Invalid(message)));
                }
            }
            return Ok(());
        }
        "c" => return Err(to_py(Error::Invalid(format!("{what} is complex, real numbers are needed")))),
        "S" | "U" => "strings",
        "M" => "dates",
        "m" => "time differences",
        "V" => "records",
        _ => "other objects",
    };
    Err(to_py(Error::Invalid(format!("{what} is an array of {holds} (dtype {dtype}), numbers are needed"))))
}

/// A class of this package that functions take: what to call it, and how one is made.
pub trait Argument: PyTypeInfo {
    /// With its article.
    const WHAT: &'static str;
    /// What makes one.
    const HOW: &'static str;
}

/// An argument that must be an object of a class of this package. For anything else the message says what is expected and how
/// to make one.
pub struct Given<'py, T>(Bound<'py, T>);

impl<'py, T> Deref for Given<'py, T> {
    type Target = Bound<'py, T>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<'py, T> IntoPyObject<'py> for Given<'py, T> {
    type Target = T;
    type Output = Bound<'py, T>;
    type Error = Infallible;

    fn into_pyobject(self, _: Python<'py>) -> Result<Self::Output, Self::Error> {
        Ok(self.0)
    }
}

impl<'py, T: Argument> FromPyObject<'_, 'py> for Given<'py, T> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(given) = object.cast::<T>() {
            return Ok(Self(given.to_owned()));
        }
        let (what, how) = (T::WHAT, T::HOW);
        Err(PyTypeError::new_err(format!("expected {what}, got {}: {how}", type_name(&object))))
    }
}

/// The name of an object's type, for messages.
pub fn type_name(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "object".into(), |name| name.to_string())
}

/// Reads an argument of several kinds, which are tried in turn; the error says what is expected.
macro_rules! one_of {
    ($kind:ty, $what:literal, $($variant:ident),+) => {
        impl<'py> pyo3::FromPyObject<'_, 'py> for $kind {
            type Error = pyo3::PyErr;

            fn extract(object: pyo3::Borrowed<'_, 'py, pyo3::PyAny>) -> pyo3::PyResult<Self> {
                $(if let Ok(value) = object.extract() {
                    return Ok(Self::$variant(value));
                })+
                let given = $crate::convert::type_name(&object);
                Err(pyo3::exceptions::PyTypeError::new_err(format!("expected {}, got {given}", $what)))
            }
        }
    };
}
pub(crate) use one_of;

/// An integer of any size from Python. Unsigned arguments are read as this, so that a negative or huge one is refused with
/// its name, value and bound, not by an `OverflowError`.
#[derive(Clone, Copy)]
pub struct Integer(i128);

impl Integer {
    /// The integer as a `T`, at least `least`.
    pub fn at_least<T: TryFrom<i128> + Into<i128>>(self, what: &str, least: T) -> PyResult<T> {
        let least = least.into();
        let refuse =
            |bound: String| to_py(Error::Invalid(format!("{what} is {}, it must be {bound}", self.0)));
        if self.0 < least {
            return Err(refuse(format!("at least {least}")));
        }
        T::try_from(self.0).map_err(|_| refuse(format!("below 2^{}", 8 * size_of::<T>())))
    }

    /// The integer as a count, at least `least`.
    pub fn count(self, what: &str, least: u32) -> PyResult<usize> {
        let value: u64 = self.at_least(what, u64::from(least))?;
        usize::try_from(value)
            .map_err(|_| to_py(Error::Invalid(format!("{what} is {value}, it is too large"))))
    }
}

impl<'py> FromPyObject<'_, 'py> for Integer {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        object.extract::<i128>().map(Self).map_err(|error| {
            if error.is_instance_of::<PyOverflowError>(object.py()) {
                // Beyond 2^127 in either direction.
                to_py(Error::Invalid(format!("{} is outside of every bound", *object)))
            } else {
                error
            }
        })
    }
}

/// The `seed=` of random draws.
pub fn read_seed(object: &Bound<'_, PyAny>) -> PyResult<u64> {
    object.extract::<Integer>()?.at_least("seed", 0)
}

/// The `threads=` of long calls.
#[derive(Clone, Copy)]
pub struct Threads(i128);

/// More threads than any machine has cores; starting a million of them takes minutes.
const MAX_THREADS: i128 = 1_024;

impl Threads {
    /// The number, which is checked here.
    pub fn count(self) -> PyResult<usize> {
        if (1..=MAX_THREADS).contains(&self.0) {
            return Ok(self.0 as usize);
        }
        let bound = if self.0 < 1 { "at least 1".into() } else { format!("at most {MAX_THREADS}") };
        Err(to_py(Error::Invalid(format!("threads is {}, it must be {bound}", self.0))))
    }
}

impl From<usize> for Threads {
    fn from(count: usize) -> Self {
        Self(i128::try_from(count).unwrap_or(i128::MAX))
    }
}

impl From<usize> for Integer {
    fn from(count: usize) -> Self {
        Self(i128::try_from(count).unwrap_or(i128::MAX))
    }
}

impl<'py> FromPyObject<'_, 'py> for Threads {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Integer::extract(object).map(|n| Self(n.0))
    }
}

/// The `gravity=` of dynamics, m/s^2 along the axes of the chain's base.
#[derive(Clone, Copy)]
pub struct Gravity(Vector3<f64>);

/// What `gravity=` is unless given.
pub const STANDARD_GRAVITY: Gravity = Gravity(Vector3::new(0.0, 0.0, -9.81));

impl From<Gravity> for Vector3<f64> {
    fn from(gravity: Gravity) -> Self {
        gravity.0
    }
}

impl<'py> FromPyObject<'_, 'py> for Gravity {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        read_array(&object, "gravity").map(|g| Self(Vector3::from(g)))
    }
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
    let mut array = Fresh::new(py, shape);
    let memory = array.memory()?;
    if memory.len() != values.len() {
        let (expected, actual) = (memory.len(), values.len());
        return Err(to_py(Error::Length { what: "array".into(), expected, actual }));
    }
    memory.copy_from_slice(values);
    Ok(array.finish())
}

/// A new C-contiguous array that nobody else has seen yet: it may be filled without the GIL.
pub struct Fresh<'py, T, D>(Bound<'py, PyArray<T, D>>);

impl<'py, T: Element, D: Dimension> Fresh<'py, T, D> {
    /// An array of zeros.
    pub fn new(py: Python<'py>, shape: impl IntoDimension<Dim = D>) -> Self {
        Self(PyArray::zeros(py, shape, false))
    }

    /// Its numbers, row by row.
    pub fn memory(&mut self) -> PyResult<&mut [T]> {
        // SAFETY: the array was made here and is handed out by `finish` alone, so this is the only reference.
        Ok(unsafe { self.0.as_slice_mut()? })
    }

    /// Hands the array out.
    pub fn finish(self) -> Bound<'py, PyArray<T, D>> {
        self.0
    }
}

/// A pose as `(4, 4)`.
pub fn pose_to_array<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Bound<'py, numpy::PyArray2<f64>>> {
    to_array(py, &pose_to_row_major(pose), [4, 4])
}
