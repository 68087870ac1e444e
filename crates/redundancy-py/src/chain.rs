//! `Chain` and `catalog`: the arm and its kinematics.

use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Mutex;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::exceptions::{PyOSError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PySequence, PyTuple, PyType};
use redundancy_core::chain::{
    Chain, ChainBuilder, DhConvention, DhRow, Inertia, JointKind, Limits, MissingLimits, catalog,
};
use redundancy_core::kinematics::{DynamicsScratch, JacobianFrame, JacobianOf, Scratch, TorqueDerivatives};
use redundancy_core::nalgebra::{DMatrix, Matrix3, Vector3};
use redundancy_core::{Error, Pose, pose_from_row_major, pose_to_row_major};

use crate::batch::in_blocks;
use crate::convert::{
    Fresh, Gravity, Rows, STANDARD_GRAVITY, Threads, pose_to_array, read_array, read_number, read_pose,
    read_rows, read_vector, to_array,
};
use crate::error::to_py;
use crate::html;

/// Rows between two looks at Ctrl-C: some milliseconds.
const BLOCK: usize = 16_384;

/// An arm: joints from base to tip, limits, base and tool.
///
/// Immutable: every `with_...` returns a new chain. Units are m, rad, s, kg, N, N m; 'no limit' is infinite. `q` is
/// `(n,)`, or `(N, n)` for many configurations, and then the result has the leading axis too. Poses are `(4, 4)`
/// arrays or objects of pinocchio, scipy, mink, viser or spatialmath. A rotation that is off by up to 1e-3 (largest
/// deviation of a singular value from 1) is replaced by the nearest one; a pose that is farther off is refused.
///
/// Example:
///     >>> import numpy as np
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("pa10")
///     >>> round(float(arm.forward(np.zeros(7))[2, 3]), 6)
///     1.345
#[pyclass(name = "Chain", module = "redundancy", frozen, eq)]
pub struct PyChain {
    pub chain: Chain,
    /// Memory for single calls; whoever finds it taken allocates.
    scratch: Mutex<Scratch>,
}

impl From<Chain> for PyChain {
    fn from(chain: Chain) -> Self {
        let scratch = Mutex::new(Scratch::new(&chain));
        Self { chain, scratch }
    }
}

impl PartialEq for PyChain {
    fn eq(&self, other: &Self) -> bool {
        self.chain == other.chain
    }
}

impl PyChain {
    /// Calls `work` with memory for one configuration.
    fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        match self.scratch.try_lock() {
            Ok(mut scratch) => work(&mut scratch),
            Err(_) => work(&mut Scratch::new(&self.chain)),
        }
    }

    /// Reads whose motion a Jacobian describes.
    fn jacobian_of(
        &self,
        link: Option<&str>,
        frame: &str,
        point: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<JacobianOf> {
        let chain = &self.chain;
        let frame = match frame {
            "base" => JacobianFrame::Base,
            "tool" => JacobianFrame::Tool,
            name => JacobianFrame::Link(chain.link_index(name).map_err(|_| {
                let links = chain.links().iter().map(|link| link.name.clone());
                let valid = ["base", "tool"].map(String::from).into_iter().chain(links).collect();
                to_py(Error::UnknownName { kind: "frame", name: name.into(), valid })
            })?),
        };
        let link = link.map(|name| chain.link_index(name)).transpose().map_err(to_py)?;
        let point = point.map(|point| read_array::<3>(point, "point")).transpose()?.unwrap_or_default();
        Ok(JacobianOf { link, point: point.into(), frame })
    }

    /// The Jacobian of a point of a link, one or many.
    fn write_jacobian_of<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        of: &JacobianOf,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (chain, dof) = (&self.chain, self.chain.dof());
        self.dispatch(
            q,
            |q| {
                let mut out = Fresh::new(py, [6, dof]);
                let memory = out.memory()?;
                self.with_scratch(|scratch| chain.write_jacobian_of(q, of, scratch, memory))
                    .map_err(to_py)?;
                Ok(out.finish().into_any())
            },
            |q, n| {
                let mut jacobians = Fresh::new(py, [n, 6, dof]);
                let out = jacobians.memory()?;
                in_blocks(py, n, BLOCK, threads, |rows| {
                    let q = &q[rows.start * dof..rows.end * dof];
                    chain.jacobian_of_batch(q, of, &mut out[rows.start * 6 * dof..rows.end * 6 * dof])
                })?;
                Ok(jacobians.finish().into_any())
            },
        )
    }

    /// Calls `one` for a single `q`, `many` for a batch.
    fn dispatch<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        one: impl FnOnce(&[f64]) -> PyResult<Bound<'py, PyAny>>,
        many: impl FnOnce(&[f64], usize) -> PyResult<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        // The way of a control loop: one contiguous vector of doubles.
        if q.is_exact_instance_of::<PyArray1<f64>>()
            && let Ok(vector) = q.extract::<PyReadonlyArray1<'py, f64>>()
            && let Ok(values) = vector.as_slice()
            && values.len() == self.chain.dof()
        {
            return one(values);
        }
        let rows: Rows<'py> = read_rows(q, "q", &[self.chain.dof()])?;
        match rows.batch {
            None => one(rows.as_slice()?),
            Some(n) => many(rows.as_slice()?, n),
        }
    }
}

#[pymethods]
impl PyChain {
    /// Read the chain from a base link to a tip link from a URDF file.
    ///
    /// The base need not be an ancestor of the tip: the chain runs up to their common ancestor and down again (from
    /// the top of a turntable to a tool, from one hand to the other). Joints keep their names, signs and limits; they
    /// are ordered from the base, and each body belongs to the joint before it. Fixed joints are folded, numbers are
    /// used as they are, and a velocity or effort of 0 means no limit.
    ///
    /// Args:
    ///     path: The file.
    ///     base: Base link; may be left out when there is one root (or one above `tip`).
    ///     tip: Tip link; may be left out when there is one leaf (below `base`).
    ///     missing_limits: What to do with a revolute or prismatic joint without `<limit>`.
    ///
    /// Raises:
    ///     OSError: The file cannot be opened.
    ///     DescriptionError: Malformed XML, no common ancestor of base and tip (both roots are named), joints that
    ///         mimic, float or move in a plane, names used twice, missing or inverted limits.
    ///     RedundancyError: An unknown link (the names are listed), numbers that are not finite, a zero axis.
    #[staticmethod]
    #[pyo3(signature = (path, base=None, tip=None, missing_limits="error"))]
    fn from_urdf(
        py: Python<'_>,
        path: PathBuf,
        base: Option<&str>,
        tip: Option<&str>,
        missing_limits: &str,
    ) -> PyResult<Self> {
        let missing_limits = read_missing_limits(missing_limits)?;
        // A file that is not there is what Python calls it: FileNotFoundError.
        if let Err(error) = std::fs::metadata(&path) {
            return Err(PyOSError::new_err((error.raw_os_error(), error.to_string(), path)));
        }
        let chain = py.detach(|| Chain::from_urdf(path, base, tip, missing_limits));
        chain.map(Self::from).map_err(to_py)
    }

    /// Read a chain from the text of a URDF; see `from_urdf`.
    ///
    /// Args:
    ///     xml: Text of the URDF.
    ///     base: Base link, as in `from_urdf`.
    ///     tip: Tip link, as in `from_urdf`.
    ///     missing_limits: What to do with a revolute or prismatic joint without `<limit>`.
    #[staticmethod]
    #[pyo3(signature = (xml, base=None, tip=None, missing_limits="error"))]
    fn from_urdf_string(
        py: Python<'_>,
        xml: &str,
        base: Option<&str>,
        tip: Option<&str>,
        missing_limits: &str,
    ) -> PyResult<Self> {
        let missing_limits = read_missing_limits(missing_limits)?;
        let chain = py.detach(|| Chain::from_urdf_string(xml, base, tip, missing_limits));
        chain.map(Self::from).map_err(to_py)
    }

    /// Build a chain of revolute joints from Denavit-Hartenberg rows.
    ///
    /// Standard (distal): `T_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`.
    /// Modified (Craig): `T_i = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`.
    ///
    /// Args:
    ///     rows: `(n, 4)`: a (m), d (m), alpha (rad), offset theta (rad); one joint is `[[a, d, alpha, theta]]`.
    ///     convention: Which frame the rows describe.
    ///     base: Pose of frame 0 in the world.
    ///     tool: Pose of the tool in the last frame.
    ///     names: Joint names; `joint1`, `joint2`, ... when left out.
    ///     lower: `(n,)` lower position limits, rad; `-inf` for none. A single number applies to all joints.
    ///     upper: `(n,)` upper position limits, rad; `inf` for none.
    ///     velocity: `(n,)` velocity limits, rad/s.
    ///     effort: `(n,)` torque limits, N m.
    ///     inertia: Per link its mass (kg), centre of mass `(3,)` (m) and inertia at it `(3, 3)`, or its diagonal
    ///         `(3,)` (kg m^2), in the frame of the row.
    ///     rotor_inertia: `(n,)` inertia of the rotors seen at the joints, kg m^2.
    ///     name: Name of the robot.
    ///
    /// Raises:
    ///     RedundancyError: Wrong shapes, numbers that are not finite, inverted limits, names used twice.
    #[staticmethod]
    #[pyo3(signature = (rows, convention="standard", base=None, tool=None, names=None, lower=None, upper=None,
        velocity=None, effort=None, inertia=None, rotor_inertia=None, *, name="arm"))]
    fn from_dh(
        rows: &Bound<'_, PyAny>,
        convention: &str,
        base: Option<&Bound<'_, PyAny>>,
        tool: Option<&Bound<'_, PyAny>>,
        names: Option<Vec<String>>,
        lower: Option<&Bound<'_, PyAny>>,
        upper: Option<&Bound<'_, PyAny>>,
        velocity: Option<&Bound<'_, PyAny>>,
        effort: Option<&Bound<'_, PyAny>>,
        inertia: Option<&Bound<'_, PyAny>>,
        rotor_inertia: Option<&Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<Self> {
        let convention = match convention {
            "standard" => DhConvention::Standard,
            "modified" => DhConvention::Modified,
            other => return Err(unknown("convention", other, &["standard", "modified"])),
        };
        let table = read_rows(rows, "rows", &[4])?;
        if table.batch.is_none() {
            let message = "rows has shape (4,), expected (n, 4): one row a, d, alpha, theta per joint";
            return Err(to_py(Error::Invalid(message.into())));
        }
        let rows: Vec<DhRow> = table
            .as_slice()?
            .chunks_exact(4)
            .map(|r| DhRow { a: r[0], d: r[1], alpha: r[2], theta: r[3] })
            .collect();
        let mut limits = vec![Limits::NONE; rows.len()];
        set_limits(&mut limits, lower, upper, velocity, None, effort)?;
        let mut builder = ChainBuilder::from_dh(name, &rows, convention).limits(&limits);
        if let Some(names) = names {
            builder = builder.joint_names(names);
        }
        if let Some(base) = base {
            builder = builder.base(read_pose(base)?);
        }
        if let Some(tool) = tool {
            builder = builder.tool(read_pose(tool)?);
        }
        if inertia.is_some() || rotor_inertia.is_some() {
            let mut bodies = match inertia {
                Some(list) => read_inertias(list)?,
                None => vec![Inertia::ZERO; rows.len()],
            };
            if let Some(rotors) = rotor_inertia {
                let rotors = read_vector(rotors, "rotor_inertia", Some(bodies.len()))?;
                for (body, rotor) in bodies.iter_mut().zip(rotors) {
                    body.rotor = rotor;
                }
            }
            builder = builder.link_inertias(&bodies);
        }
        builder.build().map(Self::from).map_err(to_py)
    }

    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        self.chain.name()
    }

    /// Number of moving joints.
    #[getter]
    fn dof(&self) -> usize {
        self.chain.dof()
    }

    /// Names of the moving joints, base to tip.
    #[getter]
    fn joint_names(&self) -> Vec<&str> {
        self.chain.joints().iter().map(|j| j.name.as_str()).collect()
    }

    /// Names of the frames, base to tip; `forward` knows them.
    #[getter]
    fn link_names(&self) -> Vec<&str> {
        self.chain.links().iter().map(|l| l.name.as_str()).collect()
    }

    /// Lower position limits `(n,)`, rad or m, `-inf` for none. A copy.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.chain.lower())
    }

    /// Upper position limits `(n,)`, rad or m, `inf` for none. A copy.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.chain.upper())
    }

    /// Velocity limits `(n,)`, rad/s or m/s, `inf` for none. A copy.
    #[getter]
    fn velocity_limit<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.chain.joints().iter().map(|j| j.limits.velocity))
    }

    /// Acceleration limits `(n,)`, rad/s^2 or m/s^2, `inf` for none. A copy.
    #[getter]
    fn acceleration_limit<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.chain.joints().iter().map(|j| j.limits.acceleration))
    }

    /// Torque or force limits `(n,)`, N m or N, `inf` for none. A copy.
    #[getter]
    fn effort_limit<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.chain.joints().iter().map(|j| j.limits.effort))
    }

    /// Pose `(4, 4)` of the first link in the world. A copy.
    #[getter]
    fn base<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        pose_to_array(py, self.chain.base())
    }

    /// Pose `(4, 4)` of the tool in the frame of the last link. A copy.
    #[getter]
    fn tool<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        pose_to_array(py, self.chain.tool())
    }

    /// The same arm with another tool after its last link; replaces an earlier tool.
    ///
    /// Args:
    ///     pose: Pose `(4, 4)` of the tool in the frame of the last link, m.
    fn with_tool(&self, pose: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.chain.with_tool(read_pose(pose)?).map(Self::from).map_err(to_py)
    }

    /// The same arm mounted elsewhere; replaces an earlier base.
    ///
    /// Args:
    ///     pose: Pose `(4, 4)` of the first link in the world, m.
    fn with_base(&self, pose: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.chain.with_base(read_pose(pose)?).map(Self::from).map_err(to_py)
    }

    /// The same arm with other limits `(n,)`; what is not given stays. A single number applies to all joints.
    ///
    /// Args:
    ///     lower: Lower position limits `(n,)`, rad or m; `-inf` for none.
    ///     upper: Upper position limits `(n,)`, rad or m; `inf` for none.
    ///     velocity: Velocity limits `(n,)`, rad/s or m/s; `inf` for none.
    ///     acceleration: Acceleration limits `(n,)`, rad/s^2 or m/s^2; `inf` for none.
    ///     effort: Torque or force limits `(n,)`, N m or N; `inf` for none.
    #[pyo3(signature = (lower=None, upper=None, velocity=None, acceleration=None, effort=None))]
    fn with_limits(
        &self,
        lower: Option<&Bound<'_, PyAny>>,
        upper: Option<&Bound<'_, PyAny>>,
        velocity: Option<&Bound<'_, PyAny>>,
        acceleration: Option<&Bound<'_, PyAny>>,
        effort: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let mut limits: Vec<Limits> = self.chain.joints().iter().map(|j| j.limits).collect();
        set_limits(&mut limits, lower, upper, velocity, acceleration, effort)?;
        self.chain.with_limits(&limits).map(Self::from).map_err(to_py)
    }

    /// The same arm on a rail: one prismatic joint before the base.
    ///
    /// At 0 on the rail the arm is where it was before. The rail is the first joint; the new first link `<name>_base`
    /// stands still, and the former first link moves. Another call puts a rail below the first one. For torques, the
    /// rail carries the bodies that the arm's joints move; the mass of the former first link is not known.
    ///
    /// Args:
    ///     axis: `(3,)` direction of the rail, world axes, of any length.
    ///     lower: Lowest position, m; `-inf` for none.
    ///     upper: Highest position, m; `inf` for none.
    ///     velocity: Largest speed, m/s; none when left out.
    ///     name: Name of the joint.
    ///
    /// Raises:
    ///     RedundancyError: An axis without length, inverted limits, a name that is already used.
    ///
    /// Example:
    ///     >>> import redundancy as rd
    ///     >>> chain = rd.catalog.load("iiwa14").with_rail((0, 1, 0), 0.0, 2.0)
    ///     >>> chain.dof, chain.joint_names[0]
    ///     (8, 'rail')
    #[pyo3(signature = (axis, lower, upper, velocity=None, name="rail"))]
    fn with_rail(
        &self,
        axis: &Bound<'_, PyAny>,
        lower: f64,
        upper: f64,
        velocity: Option<f64>,
        name: &str,
    ) -> PyResult<Self> {
        let axis = Vector3::from(read_array::<3>(axis, "axis")?);
        let velocity = velocity.unwrap_or(f64::INFINITY);
        let limits = Limits { lower, upper, velocity, ..Limits::NONE };
        self.chain.with_rail(name, axis, limits).map(Self::from).map_err(to_py)
    }

    /// The same arm with a body fixed to its tip, in addition to those already there.
    ///
    /// It counts in torques and what depends on them (`inverse_dynamics`, `max_speed`, `plan_orientation`).
    ///
    /// Args:
    ///     mass: kg.
    ///     center_of_mass: `(3,)`, m, in the frame of the last link (the tip), whatever the tool is.
    ///     inertia: `(3, 3)` or its diagonal `(3,)` at the centre of mass, axes of the last link, kg m^2; a point mass
    ///         when left out.
    ///
    /// Raises:
    ///     RedundancyError: A chain without inertias, a mass that is not positive, an inertia that is not symmetric or
    ///         not positive semidefinite, numbers that are not finite.
    ///
    /// Example:
    ///     >>> import redundancy as rd
    ///     >>> zero, arm = [0.0] * 7, rd.catalog.load("iiwa14")
    ///     >>> loaded = arm.with_payload(2.0, (0.1, 0.0, 0.05))
    ///     >>> change = loaded.inverse_dynamics(zero, zero, zero) - arm.inverse_dynamics(zero, zero, zero)
    ///     >>> bool(abs(change[1]) > 1.0)
    ///     True
    #[pyo3(signature = (mass, center_of_mass, inertia=None))]
    fn with_payload(
        &self,
        mass: f64,
        center_of_mass: &Bound<'_, PyAny>,
        inertia: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let center_of_mass = Vector3::from(read_array::<3>(center_of_mass, "center_of_mass")?);
        let tensor = inertia.map_or(Ok(Matrix3::zeros()), |tensor| read_tensor(tensor, "inertia"))?;
        let payload = Inertia { mass, center_of_mass, tensor, rotor: 0.0 };
        self.chain.with_payload(&payload).map(Self::from).map_err(to_py)
    }

    /// Pose of the tool, or of a link without the tool.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    ///     link: One of `link_names`; the tool when left out.
    ///     threads: Threads for a batch; all cores by default. The result does not depend on it.
    ///
    /// Returns:
    ///     `(4, 4)` or `(N, 4, 4)`.
    ///
    /// Raises:
    ///     RedundancyError: Wrong shape, an entry that is not finite, an unknown link (the names are listed).
    #[pyo3(signature = (q, link=None, *, threads=None))]
    fn forward<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        link: Option<&str>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let chain = &self.chain;
        let link = link.map(|name| chain.link_index(name)).transpose().map_err(to_py)?;
        self.dispatch(
            q,
            |q| {
                let pose = match link {
                    None => chain.forward(q),
                    Some(link) => chain.forward_link(q, link),
                };
                Ok(pose_to_array(py, &pose.map_err(to_py)?)?.into_any())
            },
            |q, n| {
                let mut poses = Fresh::new(py, [n, 4, 4]);
                let out = poses.memory()?;
                let dof = chain.dof();
                in_blocks(py, n, BLOCK, threads, |rows| {
                    let q = &q[rows.start * dof..rows.end * dof];
                    chain.forward_batch(q, link, &mut out[rows.start * 16..rows.end * 16])
                })?;
                Ok(poses.finish().into_any())
            },
        )
    }

    /// Geometric Jacobian of the tool or of a link: linear rows first.
    ///
    /// The velocity is relative to the base; `frame` only chooses the axes in which it is expressed.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    ///     link: One of `link_names`; the tool when left out. Joints after it have columns of zeros.
    ///     frame: Axes of both halves: `"base"` (world axes, those in which the base is placed), `"tool"`, or one of
    ///         `link_names` (a link called `base` or `tool` cannot be chosen by its name).
    ///     point: `(3,)` reference point, m, in the frame of the link (or of the tool); its origin when left out.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(6, n)` or `(N, 6, n)`: m or 1, and 1 or 0.
    ///
    /// Raises:
    ///     RedundancyError: Wrong shape, an entry that is not finite, an unknown link or frame (the names are listed).
    ///
    /// Example:
    ///     >>> import numpy as np
    ///     >>> import redundancy as rd
    ///     >>> arm = rd.catalog.load("planar3r")
    ///     >>> body = arm.jacobian(np.zeros(3), link="link2", frame="link2", point=(0.5, 0.0, 0.0))
    ///     >>> body[1].tolist()
    ///     [6.0, 3.0, 0.0]
    #[pyo3(signature = (q, link=None, frame="base", point=None, *, threads=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        link: Option<&str>,
        frame: &str,
        point: Option<&Bound<'py, PyAny>>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (chain, dof) = (&self.chain, self.chain.dof());
        if link.is_some() || frame != "base" || point.is_some() {
            let of = self.jacobian_of(link, frame, point)?;
            return self.write_jacobian_of(py, q, &of, threads);
        }
        self.dispatch(
            q,
            |q| {
                let mut out = Fresh::new(py, [6, dof]);
                let memory = out.memory()?;
                self.with_scratch(|scratch| {
                    chain.kinematics(q, scratch).map(|k| k.write_jacobian(memory)).map_err(to_py)
                })?;
                Ok(out.finish().into_any())
            },
            |q, n| {
                let mut jacobians = Fresh::new(py, [n, 6, dof]);
                let out = jacobians.memory()?;
                in_blocks(py, n, BLOCK, threads, |rows| {
                    let q = &q[rows.start * dof..rows.end * dof];
                    chain.jacobian_batch(q, &mut out[rows.start * 6 * dof..rows.end * 6 * dof])
                })?;
                Ok(jacobians.finish().into_any())
            },
        )
    }

    /// Pose and Jacobian of the tool at the cost of one pass.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(4, 4)` and `(6, n)`, or `(N, 4, 4)` and `(N, 6, n)`.
    #[pyo3(signature = (q, *, threads=None))]
    fn kinematics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (chain, dof) = (&self.chain, self.chain.dof());
        self.dispatch(
            q,
            |q| {
                let mut jacobian = Fresh::new(py, [6, dof]);
                let memory = jacobian.memory()?;
                let pose = self.with_scratch(|scratch| {
                    let kinematics = chain.kinematics(q, scratch).map_err(to_py)?;
                    kinematics.write_jacobian(memory);
                    pose_to_array(py, kinematics.pose())
                })?;
                Ok(PyTuple::new(py, [pose.into_any(), jacobian.finish().into_any()])?.into_any())
            },
            |q, n| {
                let (mut poses, mut jacobians) = (Fresh::new(py, [n, 4, 4]), Fresh::new(py, [n, 6, dof]));
                let (p, j) = (poses.memory()?, jacobians.memory()?);
                in_blocks(py, n, BLOCK, threads, |rows| {
                    let q = &q[rows.start * dof..rows.end * dof];
                    let j = &mut j[rows.start * 6 * dof..rows.end * 6 * dof];
                    chain.kinematics_batch(q, &mut p[rows.start * 16..rows.end * 16], j)
                })?;
                Ok(PyTuple::new(py, [poses.finish().into_any(), jacobians.finish().into_any()])?.into_any())
            },
        )
    }

    /// Kinematic Hessian: how the columns of the Jacobian change, `H[:, j, k] = d J[:, j] / d q_k`.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(6, n, n)` or `(N, 6, n, n)`. The linear part is symmetric in j and k, the angular part is not.
    #[pyo3(signature = (q, *, threads=None))]
    fn hessian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (chain, dof) = (&self.chain, self.chain.dof());
        let size = 6 * dof * dof;
        self.dispatch(
            q,
            |q| {
                let mut out = Fresh::new(py, [6, dof, dof]);
                let memory = out.memory()?;
                self.with_scratch(|scratch| {
                    chain.kinematics(q, scratch).map(|k| k.write_hessian(memory)).map_err(to_py)
                })?;
                Ok(out.finish().into_any())
            },
            |q, n| {
                let mut hessians = Fresh::new(py, [n, 6, dof, dof]);
                let out = hessians.memory()?;
                in_blocks(py, n, BLOCK, threads, |rows| {
                    let q = &q[rows.start * dof..rows.end * dof];
                    chain.hessian_batch(q, &mut out[rows.start * size..rows.end * size])
                })?;
                Ok(hessians.finish().into_any())
            },
        )
    }

    /// Joint torques `M(q) qdd + c(q, qd) + g(q)`, rotors included, without friction.
    ///
    /// Args:
    ///     q: Joint positions `(n,)` or `(N, n)`, rad or m.
    ///     qd: Velocities; a single row is used for the whole batch.
    ///     qdd: Accelerations; likewise.
    ///     gravity: m/s^2, world axes.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Returns:
    ///     `(n,)` or `(N, n)`, N m (N for sliding joints).
    ///
    /// Raises:
    ///     RedundancyError: No inertias in the description, wrong shapes, entries that are not finite.
    #[pyo3(signature = (q, qd, qdd, gravity=STANDARD_GRAVITY, *, threads=None),
    text_signature = "($self, q, qd, qdd, gravity=(0.0, 0.0, -9.81), *, threads=None)")]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: &Bound<'py, PyAny>,
        qdd: &Bound<'py, PyAny>,
        gravity: Gravity,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (chain, dof, gravity) = (&self.chain, self.chain.dof(), Vector3::from(gravity));
        let rows = [read_rows(q, "q", &[dof])?, read_rows(qd, "qd", &[dof])?, read_rows(qdd, "qdd", &[dof])?];
        let Some(n) = rows.iter().find_map(|r| r.batch) else {
            let mut out = Fresh::new(py, [dof]);
            let (memory, mut scratch) = (out.memory()?, DynamicsScratch::new(chain));
            let [q, qd, qdd] = [rows[0].as_slice()?, rows[1].as_slice()?, rows[2].as_slice()?];
            chain.inverse_dynamics(q, qd, qdd, &gravity, &mut scratch, memory).map_err(to_py)?;
            return Ok(out.finish().into_any());
        };
        let [q, qd, qdd] =
            [repeated(&rows[0], "q", n)?, repeated(&rows[1], "qd", n)?, repeated(&rows[2], "qdd", n)?];
        let mut out = Fresh::new(py, [n, dof]);
        let memory = out.memory()?;
        in_blocks(py, n, BLOCK, threads, |rows| {
            let part = rows.start * dof..rows.end * dof;
            let memory = &mut memory[part.clone()];
            chain.inverse_dynamics_batch(&q[part.clone()], &qd[part.clone()], &qdd[part], &gravity, memory)
        })?;
        Ok(out.finish().into_any())
    }

    /// Derivatives of `inverse_dynamics` by q, qd and qdd, in closed form.
    ///
    /// Args:
    ///     q: Joint positions `(n,)`, rad or m.
    ///     qd: Velocities `(n,)`, rad/s or m/s.
    ///     qdd: Accelerations `(n,)`, rad/s^2 or m/s^2.
    ///     gravity: `(3,)`, m/s^2, world axes.
    ///
    /// Returns:
    ///     Three `(n, n)`: row i is the torque of joint i. The last is the mass matrix, rotors included.
    #[pyo3(signature = (q, qd, qdd, gravity=STANDARD_GRAVITY),
    text_signature = "($self, q, qd, qdd, gravity=(0.0, 0.0, -9.81))")]
    fn inverse_dynamics_derivatives<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: &Bound<'py, PyAny>,
        qdd: &Bound<'py, PyAny>,
        gravity: Gravity,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let dof = self.chain.dof();
        let q = read_vector(q, "q", Some(dof))?;
        let (qd, qdd) = (read_vector(qd, "qd", Some(dof))?, read_vector(qdd, "qdd", Some(dof))?);
        let (mut scratch, mut out) = (DynamicsScratch::new(&self.chain), TorqueDerivatives::new(dof));
        let gravity = Vector3::from(gravity);
        let done = self.chain.inverse_dynamics_derivatives(&q, &qd, &qdd, &gravity, &mut scratch, &mut out);
        done.map_err(to_py)?;
        // Column by column here, row by row in numpy.
        let array = |m: DMatrix<f64>| to_array(py, m.transpose().as_slice(), [dof, dof]);
        Ok((array(out.q)?, array(out.qd)?, array(out.qdd)?))
    }

    fn __repr__(&self) -> String {
        let joints: Vec<String> =
            self.chain.joints().iter().map(|j| format!("{} {}", j.kind.as_str(), j.name)).collect();
        let tip = self.chain.links().last().map_or("", |l| l.name.as_str());
        let base = self.chain.links().first().map_or("", |l| l.name.as_str());
        format!(
            "Chain('{}', {} joints from '{base}' to '{tip}': {})",
            self.name(),
            self.dof(),
            joints.join(", ")
        )
    }

    /// For notebooks: the joints with their limits.
    fn _repr_html_(&self) -> String {
        let joints = self.chain.joints().iter().map(|joint| {
            let limits = &joint.limits;
            let numbers = [limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.effort];
            let cells =
                numbers.map(|number| if number.is_finite() { format!("{number:.4}") } else { "none".into() });
            [joint.name.clone(), joint.kind.as_str().to_owned()].into_iter().chain(cells).collect()
        });
        let head = ["joint", "kind", "lower", "upper", "velocity", "acceleration", "effort"];
        let title = format!("Chain '{}', {} joints; rad or m, s, N m or N", self.name(), self.dof());
        html::table(&title, &head, &joints.collect::<Vec<_>>())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        let make = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((make, Parts::of(&self.chain)))
    }

    /// Inverse of pickling; the parts go through the builder and its checks.
    #[classmethod]
    #[pyo3(signature = (*parts))]
    fn _from_parts(_class: &Bound<'_, PyType>, parts: Parts) -> PyResult<Self> {
        parts.build().map(Self::from).map_err(to_py)
    }
}

type JointParts = (String, String, [f64; 16], [f64; 3], [f64; 5]);
type LinkParts = (String, usize, [f64; 16]);
type InertiaParts = (f64, [f64; 3], [f64; 9], f64);

/// All that a chain is made of, in types that pickle.
#[derive(FromPyObject, IntoPyObject)]
struct Parts(String, Vec<JointParts>, Vec<LinkParts>, Option<Vec<InertiaParts>>, [f64; 16], [f64; 16]);

impl Parts {
    fn of(chain: &Chain) -> Self {
        let joints = chain.joints().iter().map(|j| {
            let Limits { lower, upper, velocity, acceleration, effort } = j.limits;
            let axis = [j.axis.x, j.axis.y, j.axis.z];
            let limits = [lower, upper, velocity, acceleration, effort];
            (j.name.clone(), j.kind.as_str().into(), pose_to_row_major(&j.placement), axis, limits)
        });
        let links =
            chain.links().iter().map(|l| (l.name.clone(), l.joints_before, pose_to_row_major(&l.offset)));
        let inertias = chain.inertias().map(|list| {
            let body = |i: &Inertia| {
                let mut tensor = [0.0; 9];
                tensor.copy_from_slice(i.tensor.as_slice());
                (i.mass, i.center_of_mass.into(), tensor, i.rotor)
            };
            list.iter().map(body).collect()
        });
        let (base, tool) = (pose_to_row_major(chain.base()), pose_to_row_major(chain.tool()));
        Self(chain.name().into(), joints.collect(), links.collect(), inertias, base, tool)
    }

    fn build(self) -> redundancy_core::Result<Chain> {
        let Self(name, joints, links, inertias, base, tool) = self;
        let mut links = links.into_iter().peekable();
        let first = links.next().map(|(name, ..)| name).unwrap_or_default();
        let mut builder = ChainBuilder::new(name, first);
        for after in 0..=joints.len() {
            while let Some((name, _, offset)) = links.next_if(|l| l.1 == after) {
                builder = builder.link(name, pose_from_row_major(&offset)?);
            }
            if let Some((name, kind, placement, axis, limits)) = joints.get(after) {
                let kind = match kind.as_str() {
                    "revolute" => JointKind::Revolute,
                    "continuous" => JointKind::Continuous,
                    "prismatic" => JointKind::Prismatic,
                    other => return Err(Error::Invalid(format!("unknown joint kind '{other}'"))),
                };
                let [lower, upper, velocity, acceleration, effort] = *limits;
                let limits = Limits { lower, upper, velocity, acceleration, effort };
                let placement = pose_from_row_major(placement)?;
                builder = builder.joint(name, kind, placement, Vector3::from(*axis), limits);
            }
        }
        if let Some(list) = inertias {
            let body = |(mass, center, tensor, rotor): InertiaParts| Inertia {
                mass,
                center_of_mass: center.into(),
                tensor: Matrix3::from_column_slice(&tensor),
                rotor,
            };
            builder = builder.inertias(list.into_iter().map(body).collect());
        }
        let pose = |m: &[f64; 16]| -> redundancy_core::Result<Pose> { pose_from_row_major(m) };
        builder.base(pose(&base)?).tool(pose(&tool)?).build()
    }
}

/// The rows of a batch of `n`; a single row counts for all.
fn repeated<'a>(rows: &'a Rows<'_>, what: &str, n: usize) -> PyResult<Cow<'a, [f64]>> {
    let values = rows.as_slice()?;
    match rows.batch {
        None => Ok(Cow::Owned(values.repeat(n))),
        Some(count) if count == n => Ok(Cow::Borrowed(values)),
        Some(actual) => Err(to_py(Error::Length { what: format!("{what} (rows)"), expected: n, actual })),
    }
}

/// An arm of the catalogue by name.
///
/// Args:
///     name: One of `catalog_names()`.
#[pyfunction]
pub fn catalog_load(name: &str) -> PyResult<PyChain> {
    catalog::load(name).map(PyChain::from).map_err(to_py)
}

/// Names of the arms of the catalogue, in alphabetical order.
#[pyfunction]
pub fn catalog_names() -> Vec<&'static str> {
    catalog::names().collect()
}

fn unknown(kind: &'static str, name: &str, valid: &[&str]) -> PyErr {
    to_py(Error::UnknownName {
        kind,
        name: name.into(),
        valid: valid.iter().map(|v| v.to_string()).collect(),
    })
}

fn read_missing_limits(name: &str) -> PyResult<MissingLimits> {
    match name {
        "error" => Ok(MissingLimits::Refuse),
        "unbounded" => Ok(MissingLimits::Unbounded),
        other => Err(unknown("missing_limits", other, &["error", "unbounded"])),
    }
}

/// Overwrites the limits that are given; a single number counts for every joint.
fn set_limits(
    limits: &mut [Limits],
    lower: Option<&Bound<'_, PyAny>>,
    upper: Option<&Bound<'_, PyAny>>,
    velocity: Option<&Bound<'_, PyAny>>,
    acceleration: Option<&Bound<'_, PyAny>>,
    effort: Option<&Bound<'_, PyAny>>,
) -> PyResult<()> {
    type Field = fn(&mut Limits) -> &mut f64;
    let fields: [(&str, Option<&Bound<'_, PyAny>>, Field); 5] = [
        ("lower", lower, |l| &mut l.lower),
        ("upper", upper, |l| &mut l.upper),
        ("velocity", velocity, |l| &mut l.velocity),
        ("acceleration", acceleration, |l| &mut l.acceleration),
        ("effort", effort, |l| &mut l.effort),
    ];
    for (what, given, field) in fields {
        let Some(given) = given else { continue };
        let values = match given.extract::<f64>() {
            Ok(value) => vec![value; limits.len()],
            Err(_) => read_vector(given, what, Some(limits.len()))?,
        };
        for (limit, value) in limits.iter_mut().zip(values) {
            *field(limit) = value;
        }
    }
    Ok(())
}

/// Reads `(mass, centre of mass (3,), inertia tensor (3, 3) or its diagonal (3,))` for every link.
fn read_inertias(list: &Bound<'_, PyAny>) -> PyResult<Vec<Inertia>> {
    let shape = |what: String| PyTypeError::new_err(what);
    let mut bodies = Vec::new();
    let items = list.try_iter().map_err(|_| {
        shape("inertia must be a list of (mass, centre of mass (3,), inertia at it (3, 3) or (3,))".into())
    })?;
    for (i, item) in items.enumerate() {
        let item = item?;
        let parts =
            item.cast::<PySequence>().ok().filter(|p| p.len().is_ok_and(|n| n == 3)).ok_or_else(|| {
                shape(format!(
                    "inertia[{i}] must be (mass, centre of mass (3,), inertia at it (3, 3) or (3,))"
                ))
            })?;
        let center = read_array::<3>(&parts.get_item(1)?, &format!("inertia[{i}]: centre of mass"))?;
        let tensor = read_tensor(&parts.get_item(2)?, &format!("inertia[{i}]: tensor"))?;
        let mass = read_number(&parts.get_item(0)?, &format!("inertia[{i}]: mass"))?;
        bodies.push(Inertia {
            mass,
            center_of_mass: Vector3::from_column_slice(&center),
            tensor,
            rotor: 0.0,
        });
    }
    Ok(bodies)
}

/// An inertia tensor, `(3, 3)` or its diagonal `(3,)`.
fn read_tensor(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Matrix3<f64>> {
    let tensor = read_rows(object, what, &[3])?;
    let t = tensor.as_slice()?;
    match tensor.batch {
        None => Ok(Matrix3::from_diagonal(&Vector3::new(t[0], t[1], t[2]))),
        Some(3) => Ok(Matrix3::from_row_slice(t)),
        Some(n) => Err(PyTypeError::new_err(format!("{what} has shape ({n}, 3), expected (3, 3) or (3,)"))),
    }
}
