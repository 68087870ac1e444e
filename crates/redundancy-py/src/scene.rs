//! Obstacles, and how far an arm is from them.

use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::chain::{Chain, CollisionBody};
use redundancy_core::nalgebra::Vector3;
use redundancy_core::scene::{Capsule, Cuboid, LinkGeometry, NearestPair, Obstacle, Scene, Shape, Sphere};
use redundancy_core::{Error, pose_to_row_major};

use crate::batch::in_blocks;
use crate::chain::PyChain;
use crate::convert::{Threads, read_array, read_pose, read_rows, to_array};
use crate::error::to_py;

/// Radius of the links, m, where none is given.
pub const LINK_RADIUS: f64 = 0.05;
/// Configurations between two looks for Ctrl-C.
const BLOCK: usize = 8_192;

fn velocity_of(velocity: Option<&Bound<'_, PyAny>>) -> PyResult<Vector3<f64>> {
    Ok(velocity.map_or(Ok([0.0; 3]), |v| read_array(v, "velocity"))?.into())
}

fn list(v: &Vector3<f64>) -> [f64; 3] {
    [v.x, v.y, v.z]
}

/// `, velocity=...` where there is one.
fn velocity_text(obstacle: &Obstacle) -> String {
    if obstacle.velocity == Vector3::zeros() {
        return String::new();
    }
    format!(", velocity={:?}", list(&obstacle.velocity))
}

/// A ball.
///
/// Args:
///     center: `(3,)`, m, world axes.
///     radius: m, not negative.
///     velocity: `(3,)`, m/s, of an obstacle that moves.
#[pyclass(name = "Sphere", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PySphere {
    obstacle: Obstacle,
    sphere: Sphere,
}

#[pymethods]
impl PySphere {
    #[new]
    #[pyo3(signature = (center, radius, *, velocity=None))]
    fn new(center: &Bound<'_, PyAny>, radius: f64, velocity: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let sphere = Sphere { center: read_array(center, "center")?.into(), radius };
        let obstacle = Obstacle::moving(sphere.into(), velocity_of(velocity)?).map_err(to_py)?;
        Ok(Self { obstacle, sphere })
    }

    /// Centre `(3,)`, m.
    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.sphere.center.as_slice())
    }

    /// Radius, m.
    #[getter]
    fn radius(&self) -> f64 {
        self.sphere.radius
    }

    /// Velocity `(3,)`, m/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.obstacle.velocity.as_slice())
    }

    fn __repr__(&self) -> String {
        let velocity = velocity_text(&self.obstacle);
        format!("Sphere({:?}, {:?}{velocity})", list(&self.sphere.center), self.sphere.radius)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let again = py.get_type::<Self>().getattr("_from_parts")?;
        let parts = (list(&self.sphere.center), self.sphere.radius, list(&self.obstacle.velocity));
        Ok((again, parts.into_pyobject(py)?))
    }

    #[staticmethod]
    fn _from_parts(center: [f64; 3], radius: f64, velocity: [f64; 3]) -> PyResult<Self> {
        let sphere = Sphere { center: center.into(), radius };
        Ok(Self { obstacle: Obstacle::moving(sphere.into(), velocity.into()).map_err(to_py)?, sphere })
    }
}

/// A box with any orientation.
///
/// Args:
///     pose: Its centre and its axes.
///     half_extents: `(3,)`, half of its edges, m.
///     velocity: `(3,)`, m/s, of an obstacle that moves; it does not turn.
#[pyclass(name = "Box", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyBox {
    obstacle: Obstacle,
    cuboid: Cuboid,
}

#[pymethods]
impl PyBox {
    #[new]
    #[pyo3(signature = (pose, half_extents, *, velocity=None))]
    fn new(
        pose: &Bound<'_, PyAny>,
        half_extents: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let half_extents = read_array(half_extents, "half_extents")?.into();
        let cuboid = Cuboid { pose: read_pose(pose)?, half_extents };
        Ok(Self { obstacle: Obstacle::moving(cuboid.into(), velocity_of(velocity)?).map_err(to_py)?, cuboid })
    }

    /// Centre and axes `(4, 4)`.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(to_array(py, &pose_to_row_major(&self.cuboid.pose), [4, 4])?.into_any())
    }

    /// Half of its edges `(3,)`, m.
    #[getter]
    fn half_extents<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.cuboid.half_extents.as_slice())
    }

    /// Velocity `(3,)`, m/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.obstacle.velocity.as_slice())
    }

    fn __repr__(&self) -> String {
        let center = list(&self.cuboid.pose.translation.vector);
        let velocity = velocity_text(&self.obstacle);
        format!("Box(at {center:?}, half_extents={:?}{velocity})", list(&self.cuboid.half_extents))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let again = py.get_type::<Self>().getattr("_from_parts")?;
        let pose = pose_to_row_major(&self.cuboid.pose);
        let parts = (pose, list(&self.cuboid.half_extents), list(&self.obstacle.velocity));
        Ok((again, parts.into_pyobject(py)?))
    }

    #[staticmethod]
    fn _from_parts(pose: [f64; 16], half_extents: [f64; 3], velocity: [f64; 3]) -> PyResult<Self> {
        let pose = redundancy_core::pose_from_row_major(&pose).map_err(to_py)?;
        let cuboid = Cuboid { pose, half_extents: half_extents.into() };
        Ok(Self { obstacle: Obstacle::moving(cuboid.into(), velocity.into()).map_err(to_py)?, cuboid })
    }
}

/// All points within `radius` of a segment.
///
/// Args:
///     start: `(3,)`, m, world axes.
///     end: `(3,)`, m.
///     radius: m, not negative.
///     velocity: `(3,)`, m/s, of an obstacle that moves.
#[pyclass(name = "Capsule", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyCapsule {
    obstacle: Obstacle,
    capsule: Capsule,
}

#[pymethods]
impl PyCapsule {
    #[new]
    #[pyo3(signature = (start, end, radius, *, velocity=None))]
    fn new(
        start: &Bound<'_, PyAny>,
        end: &Bound<'_, PyAny>,
        radius: f64,
        velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let capsule = Capsule {
            start: read_array(start, "start")?.into(),
            end: read_array(end, "end")?.into(),
            radius,
        };
        let obstacle = Obstacle::moving(capsule.into(), velocity_of(velocity)?).map_err(to_py)?;
        Ok(Self { obstacle, capsule })
    }

    /// One end of the segment `(3,)`, m.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.capsule.start.as_slice())
    }

    /// The other end `(3,)`, m.
    #[getter]
    fn end<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.capsule.end.as_slice())
    }

    /// Radius, m.
    #[getter]
    fn radius(&self) -> f64 {
        self.capsule.radius
    }

    /// Velocity `(3,)`, m/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.obstacle.velocity.as_slice())
    }

    fn __repr__(&self) -> String {
        let (start, end) = (list(&self.capsule.start), list(&self.capsule.end));
        format!("Capsule({start:?}, {end:?}, {:?}{})", self.capsule.radius, velocity_text(&self.obstacle))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let again = py.get_type::<Self>().getattr("_from_parts")?;
        let ends = (list(&self.capsule.start), list(&self.capsule.end));
        let parts = (ends.0, ends.1, self.capsule.radius, list(&self.obstacle.velocity));
        Ok((again, parts.into_pyobject(py)?))
    }

    #[staticmethod]
    fn _from_parts(start: [f64; 3], end: [f64; 3], radius: f64, velocity: [f64; 3]) -> PyResult<Self> {
        let capsule = Capsule { start: start.into(), end: end.into(), radius };
        Ok(Self { obstacle: Obstacle::moving(capsule.into(), velocity.into()).map_err(to_py)?, capsule })
    }
}

/// An obstacle of any type.
#[derive(FromPyObject)]
pub enum AnyObstacle<'py> {
    Sphere(Bound<'py, PySphere>),
    Box(Bound<'py, PyBox>),
    Capsule(Bound<'py, PyCapsule>),
}

/// Obstacles in the world. Immutable.
///
/// Args:
///     obstacles: Any number of `Sphere`, `Box` and `Capsule`.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("pa10")  # stretched upwards at q = 0, elbow at z = .765
///     >>> scene = rd.Scene([rd.Sphere((0.0, 0.3, 0.9), radius=0.1)])
///     >>> near = scene.clearance(arm, [0.0] * 7, link_radius=0.05)
///     >>> round(near.distance, 12), near.link, near.obstacle
///     (0.15, 'link5', 0)
#[pyclass(name = "Scene", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyScene {
    pub scene: Scene,
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (obstacles=None))]
    fn new(obstacles: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let mut list = Vec::new();
        let items = obstacles.map(|given| {
            let unfit = |_| {
                let word = given.get_type().name().map_or_else(|_| "object".into(), |name| name.to_string());
                let message = format!("obstacles is one {word}, expected a list of Sphere, Box and Capsule");
                PyTypeError::new_err(message)
            };
            given.try_iter().map_err(unfit)
        });
        for item in items.transpose()?.into_iter().flatten() {
            let item = item?;
            list.push(match item.extract::<AnyObstacle<'_>>() {
                Ok(AnyObstacle::Sphere(o)) => o.get().obstacle,
                Ok(AnyObstacle::Box(o)) => o.get().obstacle,
                Ok(AnyObstacle::Capsule(o)) => o.get().obstacle,
                Err(_) => {
                    let (i, text) = (list.len(), item.repr()?);
                    let message = format!("obstacle {i} is {text}, expected a Sphere, a Box or a Capsule");
                    return Err(to_py(Error::Invalid(message)));
                }
            });
        }
        Ok(Self { scene: Scene::of_obstacles(list).map_err(to_py)? })
    }

    /// From a file: `{"obstacles": [{"type": "sphere", "center": [..], "radius": ..}, ...]}`.
    ///
    /// A box has `center`, `half_extents` and `quaternion_wxyz` (may be left out), a capsule `start`, `end`, `radius`;
    /// any may have a `velocity`.
    ///
    /// Args:
    ///     path: The file.
    ///
    /// Raises:
    ///     RedundancyError: An unknown type or key, a missing or wrong number; it names the obstacle.
    #[staticmethod]
    fn from_json(path: std::path::PathBuf) -> PyResult<Self> {
        Ok(Self { scene: Scene::from_json_file(path).map_err(to_py)? })
    }

    /// From JSON text.
    #[staticmethod]
    fn from_json_string(text: &str) -> PyResult<Self> {
        Ok(Self { scene: Scene::from_json(text).map_err(to_py)? })
    }

    /// As JSON text, as `from_json` reads it.
    fn to_json(&self) -> String {
        self.scene.to_json()
    }

    /// The obstacles.
    #[getter]
    fn obstacles<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let one = |o: &Obstacle| -> PyResult<Bound<'py, PyAny>> {
            let obstacle = *o;
            Ok(match o.shape {
                Shape::Sphere(sphere) => Bound::new(py, PySphere { obstacle, sphere })?.into_any(),
                Shape::Box(cuboid) => Bound::new(py, PyBox { obstacle, cuboid })?.into_any(),
                Shape::Capsule(capsule) => Bound::new(py, PyCapsule { obstacle, capsule })?.into_any(),
            })
        };
        self.scene.obstacles().iter().map(one).collect()
    }

    /// The scene at time `t` (s): moving obstacles are elsewhere.
    fn at(&self, t: f64) -> PyResult<Self> {
        if !t.is_finite() {
            return Err(to_py(Error::NotFinite { what: "t".into(), index: 0, value: t }));
        }
        Ok(Self { scene: self.scene.at(t) })
    }

    /// The nearest pair of a link and an obstacle.
    ///
    /// Links are capsules from joint to joint and from the last joint to the tool.
    ///
    /// Args:
    ///     chain: The arm.
    ///     q: `(n,)` or `(N, n)`.
    ///     link_radius: Of the capsules from joint to joint, m; or a `LinkGeometry` of this chain.
    ///     threads: Threads for a batch; all cores when left out.
    #[pyo3(
        signature = (chain, q, link_radius=None, *, threads=None),
        text_signature = "($self, chain, q, link_radius=0.05, *, threads=None)"
    )]
    fn clearance<'py>(
        &self,
        py: Python<'py>,
        chain: &Bound<'py, PyChain>,
        q: &Bound<'py, PyAny>,
        link_radius: Option<LinkRadius<'_>>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyClearance>> {
        let chain = &chain.get().chain;
        let n = chain.dof();
        let geometry = link_radius.unwrap_or(LinkRadius::Radius(LINK_RADIUS)).geometry(chain)?;
        let rows = read_rows(q, "q", &[n])?;
        let values = rows.as_slice()?;
        let mut pairs = Vec::with_capacity(values.len() / n.max(1));
        in_blocks(py, values.len() / n.max(1), BLOCK, threads, |range| {
            let block = &values[range.start * n..range.end * n];
            pairs.extend(self.scene.clearance_batch(chain, block, &geometry)?);
            Ok(())
        })?;
        let links = chain.links().iter().map(|link| link.name.clone()).collect();
        Bound::new(py, PyClearance { pairs, links, batch: rows.batch.is_some() })
    }

    fn __len__(&self) -> usize {
        self.scene.obstacles().len()
    }

    fn __repr__(&self) -> String {
        let words: Vec<&str> = self.scene.obstacles().iter().map(|o| o.shape.as_str()).collect();
        format!("Scene({})", words.join(", "))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Vec<Bound<'py, PyAny>>,))> {
        Ok((py.get_type::<Self>().into_any(), (self.obstacles(py)?,)))
    }
}

type CapsuleParts = (String, [f64; 3], [f64; 3], f64);

/// The arm as rounded segments that move with it: what of it can touch an obstacle.
///
/// Capsules of one radius from joint to joint and from the last joint to the tool, or the primitive collision geometry
/// of a URDF, with more capsules (a tool, a hose, a camera) where wanted. It goes where a `link_radius` goes in
/// `Scene.clearance` and `Clearance`.
///
/// Args:
///     chain: The arm.
///     radius: Of the capsules, m, >= 0.
///
/// Example:
///     >>> import redundancy as rd
///     >>> arm = rd.catalog.load("pa10")
///     >>> gripper = rd.LinkGeometry(arm, 0.05).with_capsule("link7", [0, 0, 0], [0, 0, 0.2], 0.04)
///     >>> scene = rd.Scene([rd.Sphere([0.0, 0.3, 0.765], 0.1)])
///     >>> round(scene.clearance(arm, [0.0] * 7, gripper).distance, 12)
///     0.15
#[pyclass(name = "LinkGeometry", module = "redundancy", frozen)]
pub struct PyLinkGeometry {
    chain: Py<PyChain>,
    pub geometry: LinkGeometry,
    /// What it was made of: a radius from joint to joint, then capsules in frames of links.
    radius: Option<f64>,
    added: Vec<CapsuleParts>,
}

#[pymethods]
impl PyLinkGeometry {
    /// Capsules of one radius from joint to joint and from the last joint to the tool.
    #[new]
    #[pyo3(signature = (chain, radius=0.05))]
    fn new(chain: Py<PyChain>, radius: f64) -> PyResult<Self> {
        let geometry = LinkGeometry::joint_to_joint(&chain.get().chain, radius).map_err(to_py)?;
        Ok(Self { chain, geometry, radius: Some(radius), added: Vec::new() })
    }

    /// The primitive collision geometry of a URDF file, each body as the capsule around it.
    ///
    /// Spheres and capsules are exact; a cylinder gets half a ball on each end, a box the least capsule along its
    /// longest edge that holds it: never too small, so what is clear is clear. Links that are fixed to a link of the
    /// chain belong to it; what does not move with the chain is left out.
    ///
    /// Args:
    ///     chain: The arm.
    ///     path: The URDF file.
    ///
    /// Raises:
    ///     RedundancyError: A file that is no URDF, none of its links in the chain, no collision geometry on the moving
    ///         links, a mesh or an unknown shape, a size that is not positive; the message names the link.
    #[staticmethod]
    fn from_urdf(chain: Py<PyChain>, path: std::path::PathBuf) -> PyResult<Self> {
        let bodies = chain.get().chain.collision_from_urdf(path).map_err(to_py)?;
        Self::of_bodies(chain, &bodies)
    }

    /// The same from the text of a URDF; see `from_urdf`.
    ///
    /// Args:
    ///     chain: The arm.
    ///     xml: Text of the URDF.
    #[staticmethod]
    fn from_urdf_string(chain: Py<PyChain>, xml: &str) -> PyResult<Self> {
        let bodies = chain.get().chain.collision_from_urdf_string(xml).map_err(to_py)?;
        Self::of_bodies(chain, &bodies)
    }

    /// With one more capsule.
    ///
    /// Args:
    ///     link: Name of a moving link.
    ///     start: `(3,)` one end in the frame of that link, m.
    ///     end: `(3,)` the other end, m.
    ///     radius: m, >= 0.
    fn with_capsule(
        &self,
        py: Python<'_>,
        link: &str,
        start: &Bound<'_, PyAny>,
        end: &Bound<'_, PyAny>,
        radius: f64,
    ) -> PyResult<Self> {
        let mut added = self.added.clone();
        added.push((link.into(), read_array(start, "start")?, read_array(end, "end")?, radius));
        Self::_from_parts(self.chain.clone_ref(py), self.radius, added)
    }

    /// Number of segments.
    fn __len__(&self) -> usize {
        self.geometry.capsules().len()
    }

    /// Name of the link and radius (m) of each segment.
    #[getter]
    fn capsules(&self) -> Vec<(String, f64)> {
        let links = self.chain.get().chain.links();
        let name = |link: usize| links.get(link).map(|l| l.name.clone()).unwrap_or_default();
        self.geometry.capsules().iter().map(|c| (name(c.link), c.radius)).collect()
    }

    fn __repr__(&self) -> String {
        format!(
            "LinkGeometry({}, {} capsules)",
            self.chain.get().chain.name(),
            self.geometry.capsules().len()
        )
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Py<PyChain>, Option<f64>, Vec<CapsuleParts>))> {
        let make = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((make, (self.chain.clone_ref(py), self.radius, self.added.clone())))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts(chain: Py<PyChain>, radius: Option<f64>, added: Vec<CapsuleParts>) -> PyResult<Self> {
        let arm = &chain.get().chain;
        let mut geometry = match radius {
            Some(radius) => LinkGeometry::joint_to_joint(arm, radius),
            None => Ok(LinkGeometry::default()),
        };
        for (link, start, end, radius) in &added {
            let place = |geometry: LinkGeometry| {
                geometry.with_capsule(arm, arm.link_index(link)?, *start, *end, *radius)
            };
            geometry = geometry.and_then(place);
        }
        let geometry = geometry.map_err(to_py)?;
        Ok(Self { chain, geometry, radius, added })
    }
}

impl PyLinkGeometry {
    fn of_bodies(chain: Py<PyChain>, bodies: &[CollisionBody]) -> PyResult<Self> {
        let arm = &chain.get().chain;
        let geometry = LinkGeometry::of_bodies(arm, bodies).map_err(to_py)?;
        let added = bodies.iter().map(|body| {
            let (start, end, radius) = LinkGeometry::capsule_around(body);
            (arm.links()[body.link].name.clone(), start, end, radius)
        });
        let added = added.collect();
        Ok(Self { chain, geometry, radius: None, added })
    }
}

/// `link_radius`: a radius of capsules from joint to joint, or a geometry.
#[derive(FromPyObject)]
pub enum LinkRadius<'py> {
    Geometry(Bound<'py, PyLinkGeometry>),
    Radius(f64),
}

impl LinkRadius<'_> {
    /// The segments of `chain`.
    pub fn geometry(&self, chain: &Chain) -> PyResult<LinkGeometry> {
        match self {
            Self::Radius(radius) => LinkGeometry::joint_to_joint(chain, *radius).map_err(to_py),
            Self::Geometry(given) => {
                let made_for = &given.get().chain.get().chain;
                if made_for != chain {
                    let message = format!(
                        "link_radius is a LinkGeometry of '{}', not of this '{}'",
                        made_for.name(),
                        chain.name()
                    );
                    return Err(to_py(Error::Invalid(message)));
                }
                Ok(given.get().geometry.clone())
            }
        }
    }
}

/// How near an arm is to a scene: of one configuration, or arrays for N of them.
#[pyclass(name = "ClearanceResult", module = "redundancy", frozen)]
pub struct PyClearance {
    pairs: Vec<Option<NearestPair>>,
    links: Vec<String>,
    batch: bool,
}

impl PyClearance {
    fn each<'py, T: IntoPyObject<'py>>(
        &self,
        py: Python<'py>,
        one: impl Fn(&NearestPair) -> T,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut values: Vec<Option<T>> = self.pairs.iter().map(|pair| pair.as_ref().map(&one)).collect();
        if self.batch {
            return values.into_pyobject(py).map(Bound::into_any);
        }
        values.pop().flatten().into_pyobject(py).map_err(Into::into)
    }

    fn points<'py>(
        &self,
        py: Python<'py>,
        one: impl Fn(&NearestPair) -> Vector3<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let flat: Vec<f64> = self
            .pairs
            .iter()
            .flat_map(|pair| pair.as_ref().map_or([f64::NAN; 3], |pair| list(&one(pair))))
            .collect();
        if self.pairs.iter().any(Option::is_none) {
            return Ok(py.None().into_bound(py));
        }
        if self.batch {
            return Ok(to_array(py, &flat, [self.pairs.len(), 3])?.into_any());
        }
        Ok(PyArray1::from_vec(py, flat).into_any())
    }
}

#[pymethods]
impl PyClearance {
    /// Signed distance, m: negative in a collision; `(N,)` for a batch. Infinite for an empty scene.
    #[getter]
    fn distance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let values: Vec<f64> =
            self.pairs.iter().map(|pair| pair.as_ref().map_or(f64::INFINITY, |p| p.distance)).collect();
        match (self.batch, values.first()) {
            (false, Some(value)) => Ok(value.into_pyobject(py)?.into_any()),
            _ => Ok(PyArray1::from_vec(py, values).into_any()),
        }
    }

    /// Name of the nearest link (a list for a batch); `None` for an empty scene.
    #[getter]
    fn link<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |pair| self.links.get(pair.link).cloned().unwrap_or_default())
    }

    /// Index of the nearest obstacle in the scene (a list for a batch); `None` for an empty scene.
    #[getter]
    fn obstacle<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |pair| pair.obstacle)
    }

    /// The nearest point of the link's surface, `(3,)` or `(N, 3)`, m; `None` for an empty scene.
    #[getter]
    fn on_link<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.points(py, |pair| pair.on_link)
    }

    /// The nearest point of the obstacle's surface.
    #[getter]
    fn on_obstacle<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.points(py, |pair| pair.on_obstacle)
    }

    /// Unit vector from the obstacle to the link.
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.points(py, |pair| pair.normal)
    }

    fn __repr__(&self) -> String {
        match (self.batch, self.pairs.first().copied().flatten()) {
            (true, _) => {
                let least = self.pairs.iter().flatten().map(|p| p.distance).fold(f64::INFINITY, f64::min);
                format!("ClearanceResult({} configurations, least distance {least:.6})", self.pairs.len())
            }
            (false, None) => "ClearanceResult(no obstacle)".into(),
            (false, Some(pair)) => {
                let link = self.links.get(pair.link).map_or("", String::as_str);
                let (distance, obstacle) = (pair.distance, pair.obstacle);
                format!("ClearanceResult(distance={distance:.6}, link='{link}', obstacle={obstacle})")
            }
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        let parts = |p: &NearestPair| {
            (p.distance, p.link, p.obstacle, [list(&p.on_link), list(&p.on_obstacle), list(&p.normal)])
        };
        let pairs = self.pairs.iter().map(|pair| pair.as_ref().map(parts)).collect();
        Ok((py.get_type::<Self>().getattr("_from_parts")?, (pairs, self.links.clone(), self.batch)))
    }

    #[staticmethod]
    fn _from_parts(pairs: Vec<Option<PairParts>>, links: Vec<String>, batch: bool) -> Self {
        let pair = |(distance, link, obstacle, [on_link, on_obstacle, normal]): PairParts| NearestPair {
            distance,
            link,
            obstacle,
            on_link: on_link.into(),
            on_obstacle: on_obstacle.into(),
            normal: normal.into(),
        };
        Self { pairs: pairs.into_iter().map(|p| p.map(pair)).collect(), links, batch }
    }
}

type PairParts = (f64, usize, usize, [[f64; 3]; 3]);
type Parts = (Vec<Option<PairParts>>, Vec<String>, bool);
