//! Intersections and unions of orientation sets.

use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};
use redundancy_core::Error;
use redundancy_core::rotation::{OrientationSet, to_wxyz};

use crate::convert::{Fresh, Integer, Threads, read_seed};
use crate::error::to_py;
use crate::rotation::{PyCone, PyQuaternionVolume, checked_tolerance, map_quaternions, map_rows, quaternion};

/// A Cone, a QuaternionVolume or an OrientationSet.
pub fn read_orientation_set(object: &Bound<'_, PyAny>, what: &str) -> PyResult<OrientationSet> {
    if let Ok(cone) = object.cast::<PyCone>() {
        return Ok(cone.get().cone.into());
    }
    if let Ok(volume) = object.cast::<PyQuaternionVolume>() {
        return Ok(volume.get().volume.clone().into());
    }
    match object.cast::<PyOrientationSet>() {
        Ok(set) => Ok(set.get().set.clone()),
        Err(_) => Err(to_py(Error::Invalid(format!(
            "{what} is {}, expected a Cone, a QuaternionVolume or an OrientationSet",
            object.repr()?
        )))),
    }
}

/// `a & b` or `a | b`; `NotImplemented` for other objects.
pub fn combined<'py>(
    a: OrientationSet,
    b: &Bound<'py, PyAny>,
    operation: fn(OrientationSet, OrientationSet) -> OrientationSet,
) -> PyResult<Bound<'py, PyAny>> {
    let py = b.py();
    match read_orientation_set(b, "set") {
        Ok(b) => Ok(Bound::new(py, PyOrientationSet { set: operation(a, b) })?.into_any()),
        Err(_) => Ok(py.NotImplemented().into_bound(py)),
    }
}

/// Intersections and unions of cones and quaternion volumes: `A & B`, `A | B`.
///
/// Membership, margin, nearest member and uniform samples of the intersection or the union. Made by `&` and `|` of
/// `Cone`, `QuaternionVolume` and `OrientationSet`; `IkSolver` takes it as `orientation_set`. The papers define the
/// parts (From and Gravdahl 2007, section 3; 2009, section III). Quaternions are `(w, x, y, z)`, `(4,)` or `(N, 4)`.
///
/// Example:
///     >>> import redundancy as rd
///     >>> tool = rd.Cone.z([0, 0, 1], 0.5) & rd.Cone.x([1, 0, 0], 0.8)
///     >>> tool.contains([1, 0, 0, 0]), len(tool.parts), tool.operation
///     (True, 2, 'and')
///     >>> either = tool | rd.Cone.downward(0.3)
///     >>> either.contains([0, 0, 1, 0])
///     True
#[pyclass(name = "OrientationSet", module = "redundancy", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyOrientationSet {
    pub set: OrientationSet,
}

impl PyOrientationSet {
    fn children(&self) -> &[OrientationSet] {
        match &self.set {
            OrientationSet::All(parts) | OrientationSet::Any(parts) => parts,
            one => std::slice::from_ref(one),
        }
    }
}

#[pymethods]
impl PyOrientationSet {
    /// `"and"` (an intersection) or `"or"` (a union).
    #[getter]
    fn operation(&self) -> &'static str {
        if matches!(self.set, OrientationSet::Any(_)) { "or" } else { "and" }
    }

    /// The parts: cones, volumes and sets of the other operation.
    #[getter]
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let parts = self.children().iter().map(|part| match part {
            OrientationSet::Cone(cone) => Ok(Bound::new(py, PyCone { cone: *cone })?.into_any()),
            OrientationSet::Volume(volume) => {
                Ok(Bound::new(py, PyQuaternionVolume { volume: volume.clone() })?.into_any())
            }
            set => Ok(Bound::new(py, Self { set: set.clone() })?.into_any()),
        });
        PyList::new(py, parts.collect::<PyResult<Vec<_>>>()?)
    }

    /// Whether `q` is a member: of all parts of an intersection, of one part of a union.
    ///
    /// Args:
    ///     q: `(w, x, y, z)`, `(4,)` or `(N, 4)`, unit norm.
    ///     tol: Tolerance of each part, rad (of a cone in its margin's unit), >= 0.
    ///     threads: Size of the pool; all cores by default.
    ///
    /// Returns:
    ///     A bool, or `(N,)`.
    ///
    /// Raises:
    ///     RedundancyError: A quaternion that is not of unit norm, a tolerance that is negative or no number.
    #[pyo3(signature = (q, tol=1e-9, *, threads=None))]
    fn contains<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        tol: f64,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        checked_tolerance(tol)?;
        map_quaternions(q, &[], threads, |q, out| out[0] = self.set.contains(q, tol))
    }

    /// Signed margin, >= 0 inside: the least of an intersection's parts, the largest of a union's.
    ///
    /// The sign is exact. Each part has its own unit: rad for sequences of rotations, that of `Cone` for cones.
    ///
    /// Args:
    ///     q: `(w, x, y, z)`, `(4,)` or `(N, 4)`, unit norm.
    ///     threads: Size of the pool; all cores by default.
    ///
    /// Returns:
    ///     A float, or `(N,)`.
    ///
    /// Raises:
    ///     RedundancyError: A quaternion that is not of unit norm.
    #[pyo3(signature = (q, *, threads=None))]
    fn margin<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_quaternions(q, &[], threads, |q, out| out[0] = self.set.margin(q))
    }

    /// The member nearest to `q`, on its side of the double cover; `q` itself when it is a member.
    ///
    /// For a union of volumes and cones it is the nearest of the parts' nearest members. For an intersection it is
    /// the result of a local search: the nearest member of one part if that lies in the others, otherwise a point on
    /// an edge between parts, found by alternating projections. Since the set need not be convex, a nearer member may
    /// exist elsewhere.
    ///
    /// Args:
    ///     q: `(w, x, y, z)`, `(4,)` or `(N, 4)`, unit norm.
    ///     threads: Size of the pool; all cores by default.
    ///
    /// Returns:
    ///     `(4,)` or `(N, 4)`.
    ///
    /// Raises:
    ///     RedundancyError: A quaternion that is not of unit norm; an intersection in which no member is found.
    #[pyo3(signature = (q, *, threads=None))]
    fn nearest<'py>(&self, q: &Bound<'py, PyAny>, threads: Option<Threads>) -> PyResult<Bound<'py, PyAny>> {
        map_rows::<f64, 4>(q, "q (w, x, y, z)", &[4], threads, |row, out| {
            let q = redundancy_core::rotation::from_wxyz(row)?;
            let near = self.set.nearest(&q).ok_or_else(|| {
                Error::Invalid(
                    "no common member of the parts was found, the intersection may be empty".into(),
                )
            })?;
            out.copy_from_slice(&to_wxyz(&near));
            Ok(())
        })
    }

    /// Members, uniform with respect to the invariant measure of rotations.
    ///
    /// Args:
    ///     n: How many.
    ///     seed: The same seed gives the same bits.
    ///
    /// Returns:
    ///     `(n, 4)`, `(w, x, y, z)`.
    ///
    /// Raises:
    ///     RedundancyError: No member among 200 000 draws: the set is empty, or much smaller than its parts.
    #[pyo3(signature = (n, seed=0))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        n: Integer,
        #[pyo3(from_py_with = read_seed)] seed: u64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let n = n.count("n", 0)?;
        let members = py.detach(|| self.set.sample(n, seed)).map_err(to_py)?;
        let mut values = Fresh::<f64, _>::new(py, [n, 4]);
        for (row, q) in values.memory()?.chunks_exact_mut(4).zip(&members) {
            row.copy_from_slice(&to_wxyz(q));
        }
        Ok(values.finish().into_any())
    }

    /// `P * A` (left: the set moves in the reference frame) or `A * P` (right: another body frame).
    ///
    /// Args:
    ///     p: `(w, x, y, z)`, `(4,)`, unit norm.
    ///     side: `"left"` or `"right"`.
    ///
    /// Raises:
    ///     RedundancyError: A quaternion that is not of unit norm, an unknown side.
    #[pyo3(signature = (p, side="left"))]
    fn reoriented(&self, p: &Bound<'_, PyAny>, side: &str) -> PyResult<Self> {
        let p = quaternion(p, "p")?;
        match side {
            "left" => Ok(Self { set: self.set.reoriented(&p) }),
            "right" => Ok(Self { set: self.set.reoriented_in_body(&p) }),
            name => {
                let valid = vec!["left".into(), "right".into()];
                Err(to_py(Error::UnknownName { kind: "side", name: name.into(), valid }))
            }
        }
    }

    fn __and__<'py>(&self, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        combined(self.set.clone(), other, OrientationSet::and)
    }

    fn __or__<'py>(&self, other: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        combined(self.set.clone(), other, OrientationSet::or)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let parts: Vec<String> =
            self.parts(py)?.iter().map(|part| Ok(part.repr()?.to_string())).collect::<PyResult<_>>()?;
        let sign = if self.operation() == "or" { " | " } else { " & " };
        Ok(format!("({})", parts.join(sign)))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let make = py.get_type::<Self>().getattr("_restore")?;
        Ok((make, (self.operation(), self.parts(py)?).into_pyobject(py)?))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _restore(operation: &str, parts: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let parts =
            parts.iter().map(|part| read_orientation_set(part, "part")).collect::<PyResult<Vec<_>>>()?;
        let set = if operation == "or" { OrientationSet::Any(parts) } else { OrientationSet::All(parts) };
        Ok(Self { set })
    }
}
