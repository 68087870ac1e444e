//! Criteria: what to do with the freedom.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use redundancy_core::criterion::{
    CLEARANCE_SMOOTHING, Clearance, Criterion, Elbow, GravityTorque, JointRange, KineticEnergy,
    Manipulability, Measure, Posture, TorqueMeasure, Weighted,
};
use redundancy_core::kinematics::Task;
use redundancy_core::nalgebra::DMatrix;
use redundancy_core::scene::Surroundings;
use redundancy_core::solutions::{SrsArm, SwivelCriterion};

use crate::callback::{Failures, Watching};
use crate::chain::PyChain;
use crate::convert::{Argument, Given, read_array, read_rows, read_vector, to_array};
use crate::error::to_py;
use crate::links::{LinkRadius, PyLinkGeometry, geometry_of};
use crate::plan::read_chain;
use crate::scene::{LINK_RADIUS, PyScene};
use crate::self_motion::PySrsArm;
use crate::task::{PyTask, read_task};

/// A scalar function of the configuration, with gradient and Hessian.
///
/// Sums (`a + b`, of equal senses) and multiples (`2.0 * a`; `-a` has the opposite sense) are criteria.
#[pyclass(name = "Criterion", module = "redundancy", frozen, subclass)]
pub struct PyCriterion {
    pub criterion: Arc<dyn Criterion>,
    /// Class and arguments that make it again.
    recipe: Py<PyTuple>,
    text: String,
    /// Exceptions of the functions of the user's that it evaluates.
    pub failures: Vec<Arc<Failures>>,
}

impl PyCriterion {
    pub fn new(criterion: Arc<dyn Criterion>, recipe: Bound<'_, PyTuple>, text: String) -> Self {
        Self { criterion, recipe: recipe.unbind(), text, failures: Vec::new() }
    }

    /// With functions of the user's.
    pub fn failing(self, failures: Vec<Arc<Failures>>) -> Self {
        Self { failures, ..self }
    }

    /// Calls `one` for each row of `q` and collects `width` numbers from each.
    fn rows<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        width: usize,
        one: impl Fn(&[f64], &mut [f64]),
    ) -> PyResult<(Vec<f64>, Option<usize>)> {
        let (n, q_py) = (self.dof_for(q)?, q.py());
        let rows = read_rows(q, "q", &[n])?;
        let values = rows.as_slice()?;
        let mut out = vec![0.0; values.len() / n.max(1) * width];
        let watching = Watching::new(&self.failures);
        for (q, out) in values.chunks_exact(n).zip(out.chunks_exact_mut(width)) {
            self.criterion.check(q).map_err(to_py)?;
            one(q, out);
            watching.check(q_py)?;
        }
        Ok((out, rows.batch))
    }

    /// Number of joints: its own, or that of `q`.
    fn dof_for(&self, q: &Bound<'_, PyAny>) -> PyResult<usize> {
        if !self.criterion.any_dof() {
            return Ok(self.criterion.dof());
        }
        let last = q.py().import("numpy")?.getattr("shape")?.call1((q,))?.extract::<Vec<usize>>()?;
        last.last().copied().filter(|n| *n > 0).ok_or_else(|| {
            to_py(redundancy_core::Error::Invalid("q must be (n,) or (N, n) with n > 0".into()))
        })
    }
}

impl Argument for PyCriterion {
    const WHAT: &'static str = "a criterion";
    const HOW: &'static str = "for example rd.JointRange(chain), or sums and multiples of criteria";
}

#[pymethods]
impl PyCriterion {
    /// Number of joints n; None where it fits any number.
    #[getter]
    fn dof(&self) -> Option<usize> {
        (!self.criterion.any_dof()).then(|| self.criterion.dof())
    }

    /// `"minimize"` or `"maximize"`.
    #[getter]
    fn sense(&self) -> &'static str {
        self.criterion.sense().as_str()
    }

    /// h(q) for `(n,)`, or `(N,)` values for `(N, n)`.
    fn value<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let (out, batch) = self.rows(q, 1, |q, out| out[0] = self.criterion.value(q))?;
        match batch {
            None => Ok(out[0].into_pyobject(py)?.into_any()),
            Some(_) => Ok(PyArray1::from_vec(py, out).into_any()),
        }
    }

    /// dh/dq, `(n,)` or `(N, n)`; per rad or m.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    fn gradient<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let n = self.dof_for(q)?;
        let (out, batch) = self.rows(q, n, |q, out| self.criterion.gradient(q, out))?;
        match batch {
            None => Ok(PyArray1::from_vec(py, out).into_any()),
            Some(rows) => Ok(to_array(py, &out, [rows, n])?.into_any()),
        }
    }

    /// d2h/dq2, `(n, n)` or `(N, n, n)`.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    fn hessian<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let n = self.dof_for(q)?;
        let (out, batch) = self.rows(q, n * n, |q, out| {
            let mut hessian = DMatrix::zeros(n, n);
            self.criterion.hessian(q, &mut hessian);
            // Symmetric, so the order of storage does not matter.
            out.copy_from_slice(hessian.as_slice());
        })?;
        match batch {
            None => Ok(to_array(py, &out, [n, n])?.into_any()),
            Some(rows) => Ok(to_array(py, &out, [rows, n, n])?.into_any()),
        }
    }

    fn __add__<'py>(this: &Bound<'py, Self>, other: &Bound<'py, Self>) -> PyResult<Bound<'py, Self>> {
        let (a, b) = (this.get(), other.get());
        let sum = Weighted::sum(a.criterion.clone(), b.criterion.clone()).map_err(to_py)?;
        let add = this.py().import("operator")?.getattr("add")?;
        let recipe = PyTuple::new(this.py(), [add, PyTuple::new(this.py(), [this, other])?.into_any()])?;
        let failures = a.failures.iter().chain(&b.failures).cloned().collect();
        let sum = Self::new(Arc::new(sum), recipe, format!("{} + {}", a.text, b.text));
        Bound::new(this.py(), sum.failing(failures))
    }

    fn __mul__<'py>(this: &Bound<'py, Self>, factor: f64) -> PyResult<Bound<'py, Self>> {
        let a = this.get();
        let multiple = Weighted::multiple(factor, a.criterion.clone()).map_err(to_py)?;
        let py = this.py();
        let arguments = PyTuple::new(py, [this.clone().into_any(), factor.into_pyobject(py)?.into_any()])?;
        let recipe = PyTuple::new(py, [py.import("operator")?.getattr("mul")?, arguments.into_any()])?;
        let multiple = Self::new(Arc::new(multiple), recipe, format!("{factor} * ({})", a.text));
        Bound::new(py, multiple.failing(a.failures.clone()))
    }

    fn __rmul__<'py>(this: &Bound<'py, Self>, factor: f64) -> PyResult<Bound<'py, Self>> {
        Self::__mul__(this, factor)
    }

    fn __neg__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, Self>> {
        Self::__mul__(this, -1.0)
    }

    fn __reduce__(&self, py: Python<'_>) -> Py<PyTuple> {
        self.recipe.clone_ref(py)
    }

    fn __repr__(&self) -> &str {
        &self.text
    }
}

/// Distance from the middle of the joint ranges, to be minimised.
///
/// `1/(2n) sum ((q_i - c_i) / (upper_i - lower_i))^2` (Bettini, De Luca, Oriolo 2000, eq. 6). Joints without limits
/// do not count; n is the number of all joints.
///
/// Args:
///     chain: The arm; joints without two finite limits do not count.
///
/// Example:
///     >>> import redundancy as rd
///     >>> rd.JointRange(rd.catalog.load("iiwa14")).value([0.0] * 7)
///     0.0
#[pyclass(name = "JointRange", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyJointRange;

#[pymethods]
impl PyJointRange {
    #[new]
    fn new(chain: &Bound<'_, PyChain>) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let criterion = JointRange::new(&chain.get().chain);
        let arguments = PyTuple::new(py, [chain])?.into_any();
        let recipe = PyTuple::new(py, [py.get_type::<Self>().into_any(), arguments])?;
        let text = format!("JointRange({})", chain.get().chain.name());
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Distance from a reference configuration, to be minimised: `1/2 sum w_i (q_i - q_ref_i)^2`.
///
/// Args:
///     chain: The arm.
///     q_ref: `(n,)`, rad or m. Joint values are compared as they are, so a whole turn counts as a large distance.
///     weights: `(n,)`, not negative; 1 by default.
#[pyclass(name = "Posture", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyPosture;

#[pymethods]
impl PyPosture {
    #[new]
    #[pyo3(signature = (chain, q_ref, weights=None))]
    fn new(
        chain: &Bound<'_, PyChain>,
        q_ref: &Bound<'_, PyAny>,
        weights: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let n = chain.get().chain.dof();
        let reference = read_vector(q_ref, "q_ref", Some(n))?;
        let weights = match weights {
            Some(weights) => read_vector(weights, "weights", Some(n))?,
            None => vec![1.0; n],
        };
        let criterion =
            Posture::weighted(&reference, &weights).and_then(|h| h.of(&chain.get().chain)).map_err(to_py)?;
        let text = format!("Posture({}, q_ref={reference:?})", chain.get().chain.name());
        let arguments = (chain, reference, weights).into_pyobject(py)?.into_any();
        let recipe = PyTuple::new(py, [py.get_type::<Self>().into_any(), arguments])?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Distance from singularities, to be maximised: `det(J J^T)` of a task, or its square root.
///
/// Gradient and Hessian of the determinant are exact everywhere, at singular configurations too. Where the root is
/// zero, it has no derivatives, and zeros are returned.
///
/// Args:
///     chain: The arm.
///     task: Which coordinates count, by name or as a `Task`: `"pose"`, `"pose_rpy"`, `"position"`, `"pointing"`,
///         `"planar"`, `"planar_pose"`. Metres and radians are not weighted.
///     measure: `"det"` or `"sqrt"`.
///
/// Example:
///     >>> import redundancy as rd
///     >>> h = rd.Manipulability(rd.catalog.load("planar3r"), task="planar")
///     >>> h.sense, abs(h.value([0.0, 0.0, 0.0])) < 1e-9, h.value([0.0, 1.0, 1.0]) > 1.0
///     ('maximize', True, True)
#[pyclass(name = "Manipulability", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyManipulability;

#[pymethods]
impl PyManipulability {
    #[new]
    #[pyo3(signature = (chain, task=None, measure="det"))]
    fn new(
        chain: &Bound<'_, PyChain>,
        task: Option<&Bound<'_, PyAny>>,
        measure: &str,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let task = task.map_or(Ok(Task::POSE), read_task)?;
        let measure = Measure::from_name(measure).map_err(to_py)?;
        let criterion = Manipulability::with_measure(&chain.get().chain, task, measure);
        let task = Bound::new(py, PyTask { task })?;
        let text = format!(
            "Manipulability({}, task={}, measure='{}')",
            chain.get().chain.name(),
            task.repr()?,
            measure.as_str()
        );
        let arguments = (chain, task, measure.as_str()).into_pyobject(py)?.into_any();
        let recipe = PyTuple::new(py, [py.get_type::<Self>().into_any(), arguments])?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Distance from obstacles, to be maximised.
///
/// A soft minimum of the signed distances of all pairs of link and obstacle: it is smooth where the nearest pair
/// changes. It is at most the least distance, and below it by at most `smoothing` times the logarithm of the number
/// of pairs that are equally near. The Hessian is the difference quotient of the analytic gradient.
///
/// Args:
///     chain: The arm.
///     scene: The obstacles.
///     link_radius: Links are capsules of this radius (m) from joint to joint and to the tool; or a `LinkGeometry`.
///     links: Another name of `link_radius`.
///     self_collision: Whether the pairs of links count too.
///     smoothing: Width of the transition between nearest pairs, m; 0 gives the least distance itself.
#[pyclass(name = "Clearance", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyClearanceCriterion;

#[pymethods]
impl PyClearanceCriterion {
    #[new]
    #[pyo3(
        signature = (chain, scene, link_radius=None, *, links=None, self_collision=false, smoothing=CLEARANCE_SMOOTHING),
        text_signature = "(chain, scene, link_radius=0.05, *, links=None, self_collision=False, smoothing=0.002)"
    )]
    fn new(
        chain: &Bound<'_, PyChain>,
        scene: Given<'_, PyScene>,
        link_radius: Option<&Bound<'_, PyAny>>,
        links: Option<&Bound<'_, PyAny>>,
        self_collision: bool,
        smoothing: f64,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let arm = &chain.get().chain;
        let links = match links.or(link_radius) {
            Some(given) => given.clone(),
            None => LINK_RADIUS.into_pyobject(py)?.into_any(),
        };
        let geometry = links.extract::<LinkRadius<'_>>()?.geometry(arm)?;
        let around = Surroundings::new(arm, &geometry, Some(&scene.get().scene), self_collision);
        let criterion = around.and_then(|around| Clearance::of(around, smoothing)).map_err(to_py)?;
        let text = format!(
            "Clearance({}, {}, links={}, self_collision={}, smoothing={smoothing:?})",
            arm.name(),
            scene.repr()?,
            links.repr()?,
            if self_collision { "True" } else { "False" }
        );
        let keywords = (("smoothing", smoothing), ("self_collision", self_collision)).into_pyobject(py)?;
        let arguments = (chain, scene, links).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, keywords)?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Distance of links from each other, to be maximised: a soft minimum over the pairs of a `LinkGeometry`.
///
/// Args:
///     chain: The arm.
///     links: Its shapes and pairs.
///     smoothing: Width of the transition between nearest pairs, m; 0 gives the least distance itself.
#[pyclass(name = "SelfClearance", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PySelfClearanceCriterion;

#[pymethods]
impl PySelfClearanceCriterion {
    #[new]
    #[pyo3(signature = (chain, links, *, smoothing=CLEARANCE_SMOOTHING),
        text_signature = "(chain, links, *, smoothing=0.002)")]
    fn new(
        chain: &Bound<'_, PyChain>,
        links: &Bound<'_, PyLinkGeometry>,
        smoothing: f64,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let arm = &chain.get().chain;
        let geometry = geometry_of(links, arm)?;
        let criterion = Clearance::of_self(arm, &geometry, smoothing).map_err(to_py)?;
        let text = format!("SelfClearance({}, {}, smoothing={smoothing:?})", arm.name(), links.repr()?);
        let keywords = (("smoothing", smoothing),).into_pyobject(py)?;
        let arguments = (chain, links).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, keywords)?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Squared distance (m^2) of the elbow from a point, to be minimised.
///
/// Args:
///     chain: The arm.
///     point: `(3,)`, m, world axes.
///     link: The origin of this link's frame instead of the elbow, which is the origin of joint 4 of seven, in general
///         of joint `(n + 1) // 2`.
#[pyclass(name = "Elbow", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyElbow;

#[pymethods]
impl PyElbow {
    #[new]
    #[pyo3(signature = (chain, point, *, link=None))]
    fn new(
        chain: &Bound<'_, PyChain>,
        point: &Bound<'_, PyAny>,
        link: Option<&str>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let arm = &chain.get().chain;
        let point: [f64; 3] = read_array(point, "point")?;
        let criterion = match link {
            None => Elbow::new(arm, point),
            Some(link) => arm.link_index(link).and_then(|index| Elbow::of_link(arm, point, index)),
        };
        let of = link.map_or(String::new(), |link| format!(", link='{link}'"));
        let text = format!("Elbow({}, {point:?}{of})", arm.name());
        let keywords = (("link", link),).into_pyobject(py)?;
        let arguments = (chain, point).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, keywords)?;
        let criterion = criterion.map_err(to_py)?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Size of the torques that hold the arm against gravity, to be minimised; N m (N for sliding joints).
///
/// `"norm"` is the root of the sum of squares of all joints, `"peak"` the largest magnitude; derivatives are exact.
/// Where two joints share the peak, its gradient is that of the first one and jumps there.
///
/// Args:
///     chain: The arm, with inertias; or an arm object.
///     measure: `"norm"` or `"peak"`.
///     gravity: `(3,)`, m/s^2, world axes.
///     weights: `(n,)`, not negative: torques are multiplied by them first. With `1 / chain.effort_limit` the peak is
///         the largest share of an effort limit.
///
/// Raises:
///     RedundancyError: A chain without inertias, an unknown measure, weights that are negative.
///
/// Example:
///     >>> import redundancy as rd
///     >>> round(float(rd.GravityTorque(rd.catalog.load("puma560"), "peak").value([0.0] * 6)), 4)
///     37.4837
#[pyclass(name = "GravityTorque", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyGravityTorque;

#[pymethods]
impl PyGravityTorque {
    #[new]
    #[pyo3(signature = (chain, measure="norm", *, gravity=None, weights=None),
        text_signature = "(chain, measure=\"norm\", *, gravity=(0.0, 0.0, -9.81), weights=None)")]
    fn new(
        chain: &Bound<'_, PyAny>,
        measure: &str,
        gravity: Option<&Bound<'_, PyAny>>,
        weights: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let chain = read_chain(chain)?;
        let arm = &chain.get().chain;
        let measure = TorqueMeasure::from_name(measure).map_err(to_py)?;
        let mut criterion = GravityTorque::new(arm, measure).map_err(to_py)?;
        let options = PyDict::new(py);
        if let Some(gravity) = gravity {
            let gravity: [f64; 3] = read_array(gravity, "gravity")?;
            criterion = criterion.under(gravity).map_err(to_py)?;
            options.set_item("gravity", gravity)?;
        }
        if let Some(weights) = weights {
            let weights = read_vector(weights, "weights", Some(arm.dof()))?;
            criterion = criterion.weighted(&weights).map_err(to_py)?;
            options.set_item("weights", weights)?;
        }
        let text = format!("GravityTorque({}, measure='{}')", arm.name(), measure.as_str());
        let arguments = (&chain, measure.as_str()).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, options)?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Kinetic energy of the arm at fixed joint velocities, to be minimised, J: how heavy the arm is to move.
///
/// `qd^T M(q) qd / 2` with the mass matrix M, rotors included. Without `qd`, `trace(M) / 2`: the sum of the energies
/// with which each joint alone moves at 1 rad/s or 1 m/s. The gradient is exact, the Hessian its difference quotient.
///
/// Args:
///     chain: The arm, with inertias; or an arm object.
///     qd: Joint velocity `(n,)`, rad/s or m/s.
///
/// Raises:
///     RedundancyError: A chain without inertias, a wrong size.
#[pyclass(name = "KineticEnergy", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PyKineticEnergy;

#[pymethods]
impl PyKineticEnergy {
    #[new]
    #[pyo3(signature = (chain, *, qd=None))]
    fn new(chain: &Bound<'_, PyAny>, qd: Option<&Bound<'_, PyAny>>) -> PyResult<PyClassInitializer<Self>> {
        let py = chain.py();
        let chain = read_chain(chain)?;
        let arm = &chain.get().chain;
        let qd = qd.map(|qd| read_vector(qd, "qd", Some(arm.dof()))).transpose()?;
        let criterion = match &qd {
            None => KineticEnergy::new(arm),
            Some(qd) => KineticEnergy::of_velocity(arm, qd),
        };
        let of = qd.as_ref().map_or(String::new(), |qd| format!(", qd={qd:?}"));
        let text = format!("KineticEnergy({}{of})", arm.name());
        let options = PyDict::new(py);
        options.set_item("qd", qd)?;
        let arguments = (&chain,).into_pyobject(py)?;
        let recipe = partial(py, py.get_type::<Self>().into_any(), arguments, options)?;
        let criterion = criterion.map_err(to_py)?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// Distance of the swivel of an S-R-S arm from a desired one, to be minimised: `1 - cos(swivel - desired)`.
///
/// About half of the squared difference, smooth everywhere but at the singular direction of the arm's chart, and with
/// the period of the swivel.
///
/// Args:
///     arm: The `SrsArm`, whose chart gives the angle its meaning; or a chain of this class, with the default chart.
///     desired: Angle, rad.
///
/// Raises:
///     NotSrsError: A chain of another class.
///     RedundancyError: An angle that is not finite.
#[pyclass(name = "Swivel", module = "redundancy", frozen, extends = PyCriterion)]
pub struct PySwivel;

#[pymethods]
impl PySwivel {
    #[new]
    fn new(arm: &Bound<'_, PyAny>, desired: f64) -> PyResult<PyClassInitializer<Self>> {
        let py = arm.py();
        let srs = match arm.cast::<PySrsArm>() {
            Ok(srs) => srs.get().arm.clone(),
            Err(_) => SrsArm::new(&read_chain(arm)?.get().chain).map_err(to_py)?,
        };
        let criterion = SwivelCriterion::new(&srs, desired).map_err(to_py)?;
        let text = format!("Swivel({}, desired={desired:?})", srs.chain().name());
        let arguments = (arm, desired).into_pyobject(py)?.into_any();
        let recipe = PyTuple::new(py, [py.get_type::<Self>().into_any(), arguments])?;
        Ok(PyClassInitializer::from(PyCriterion::new(Arc::new(criterion), recipe, text)).add_subclass(Self))
    }
}

/// A recipe with keyword arguments: `(functools.partial(class, **keywords), arguments)`.
pub fn partial<'py>(
    py: Python<'py>,
    class: Bound<'py, PyAny>,
    arguments: Bound<'py, PyTuple>,
    keywords: impl IntoKeywords<'py>,
) -> PyResult<Bound<'py, PyTuple>> {
    let options = keywords.into_keywords()?;
    let make = py.import("functools")?.getattr("partial")?.call((class,), Some(&options))?;
    PyTuple::new(py, [make, arguments.into_any()])
}

/// Pairs of a name and a value, or a dictionary.
pub trait IntoKeywords<'py> {
    /// As a dictionary.
    fn into_keywords(self) -> PyResult<Bound<'py, PyDict>>;
}

impl<'py> IntoKeywords<'py> for Bound<'py, PyTuple> {
    fn into_keywords(self) -> PyResult<Bound<'py, PyDict>> {
        PyDict::from_sequence(self.as_any())
    }
}

impl<'py> IntoKeywords<'py> for Bound<'py, PyDict> {
    fn into_keywords(self) -> PyResult<Self> {
        Ok(self)
    }
}
