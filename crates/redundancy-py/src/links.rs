//! The body of an arm: shapes of its links, and which of them must not touch.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use redundancy_core::chain::Chain;
use redundancy_core::scene::{LinkGeometry, LinkMeshes, SelfClearance, UrdfOptions};
use redundancy_core::{Error, Pose};

use crate::batch::in_blocks;
use crate::chain::PyChain;
use crate::convert::{Threads, one_of, read_array, read_pose, read_rows, to_array};
use crate::error::to_py;
use crate::obstacle::AnyObstacle;

/// Configurations between two looks for Ctrl-C.
const BLOCK: usize = 4_096;

/// The body of an arm: the shapes of its links, and the pairs of links that must not touch. Immutable.
///
/// Capsules of one radius from joint to joint and from the last joint to the tool, or the collision geometry of a
/// URDF; more shapes can be added (a tool, a hose, a camera). It is accepted by every argument `links` or
/// `link_radius`.
///
/// The pairs of capsules are those that are apart in the middle of the joints' ranges and do not overlap in more than
/// 95 % of 1 000 seeded configurations.
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
}

impl PyLinkGeometry {
    fn with(&self, py: Python<'_>, geometry: redundancy_core::Result<LinkGeometry>) -> PyResult<Self> {
        Ok(Self { chain: self.chain.clone_ref(py), geometry: geometry.map_err(to_py)? })
    }

    fn names_of(&self, [a, b]: &[usize; 2]) -> (String, String) {
        let names = self.geometry.names();
        (names[*a].clone(), names[*b].clone())
    }
}

/// How a URDF is read.
fn options(
    meshes: &str,
    package_dirs: Vec<PathBuf>,
    srdf: Option<PathBuf>,
    padding: f64,
    posture: Option<std::collections::BTreeMap<String, f64>>,
) -> PyResult<UrdfOptions> {
    let meshes = LinkMeshes::from_name(meshes).map_err(to_py)?;
    let posture = posture.unwrap_or_default().into_iter().collect();
    Ok(UrdfOptions { meshes, package_dirs, srdf, padding, posture })
}

#[pymethods]
impl PyLinkGeometry {
    /// Capsules of one radius from joint to joint and from the last joint to the tool.
    #[new]
    #[pyo3(signature = (chain, radius=0.05))]
    fn new(chain: Py<PyChain>, radius: f64) -> PyResult<Self> {
        let arm = &chain.get().chain;
        let geometry = LinkGeometry::joint_to_joint(arm, radius).and_then(|g| g.with_capsule_pairs(arm));
        Ok(Self { geometry: geometry.map_err(to_py)?, chain })
    }

    /// The collision geometry of a URDF file: spheres, capsules, cylinders, boxes and meshes (STL, OBJ, DAE).
    ///
    /// Includes links that move with the chain, links that stand still (a torso, a pedestal), links beyond the tip,
    /// and links on joints outside of the chain (fingers, a head).
    ///
    /// Args:
    ///     chain: The chain that was read from it, or one with links of the same names.
    ///     path: The file.
    ///     meshes: How meshes are read: `"hull"` as their convex hull, `"decompose"` as convex pieces, `"refuse"` as
    ///         an error.
    ///     package_dirs: Folders in which packages are searched for mesh files named `package://<package>/...` (a
    ///         folder may also be the package itself), and for relative names. After them `ROS_PACKAGE_PATH`,
    ///         `AMENT_PREFIX_PATH` and the folders above the file are searched.
    ///     srdf: A file whose `disable_collisions` name the links that may touch. Without it the pairs are found by
    ///         sampling: pairs of links are left out if a joint connects them, if they touch in more than 95 % of 10
    ///         000 seeded configurations, or if they never come nearer than 20 mm in them.
    ///     padding: Distance by which every shape is enlarged, m.
    ///     posture: Positions of joints outside of the chain (rad or m); joints that are not named take the position
    ///         nearest to 0 within their limits, or follow the joint that they mimic.
    ///
    /// Raises:
    ///     RedundancyError: A file that is no URDF or SRDF, none of its links in the chain, no collision geometry, an
    ///         unknown shape, a size that is not positive, an unknown joint; a mesh that is broken, or missing:
    ///         the message names it and the places searched.
    #[staticmethod]
    #[pyo3(signature = (chain, path, meshes="hull", package_dirs=vec![], srdf=None, padding=0.0, posture=None),
        text_signature = "(chain, path, meshes='hull', package_dirs=(), srdf=None, padding=0.0, posture=None)")]
    fn from_urdf(
        py: Python<'_>,
        chain: Py<PyChain>,
        path: PathBuf,
        meshes: &str,
        package_dirs: Vec<PathBuf>,
        srdf: Option<PathBuf>,
        padding: f64,
        posture: Option<std::collections::BTreeMap<String, f64>>,
    ) -> PyResult<Self> {
        let options = options(meshes, package_dirs, srdf, padding, posture)?;
        let arm = &chain.get().chain;
        let geometry = py.detach(|| LinkGeometry::from_urdf(arm, path, &options)).map_err(to_py)?;
        Ok(Self { chain, geometry })
    }

    /// The same from the text of a URDF; see `from_urdf`.
    ///
    /// Args:
    ///     chain: The chain that was read from it, or one with links of the same names.
    ///     xml: The text.
    ///     meshes: As for `from_urdf`, like all arguments that follow.
    ///     package_dirs: As for `from_urdf`.
    ///     srdf: As for `from_urdf`.
    ///     padding: As for `from_urdf`, m.
    ///     posture: As for `from_urdf`, rad or m.
    #[staticmethod]
    #[pyo3(signature = (chain, xml, meshes="hull", package_dirs=vec![], srdf=None, padding=0.0, posture=None),
        text_signature = "(chain, xml, meshes='hull', package_dirs=(), srdf=None, padding=0.0, posture=None)")]
    fn from_urdf_string(
        py: Python<'_>,
        chain: Py<PyChain>,
        xml: &str,
        meshes: &str,
        package_dirs: Vec<PathBuf>,
        srdf: Option<PathBuf>,
        padding: f64,
        posture: Option<std::collections::BTreeMap<String, f64>>,
    ) -> PyResult<Self> {
        let options = options(meshes, package_dirs, srdf, padding, posture)?;
        let arm = &chain.get().chain;
        let geometry =
            py.detach(|| LinkGeometry::from_urdf_string(arm, xml, None, &options)).map_err(to_py)?;
        Ok(Self { chain, geometry })
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
        let arm = &self.chain.get().chain;
        let index = arm.link_index(link).map_err(to_py)?;
        let (start, end) = (read_array(start, "start")?, read_array(end, "end")?);
        self.with(py, self.geometry.clone().with_capsule(arm, index, start, end, radius))
    }

    /// With one more shape: a tool, a hose, a camera.
    ///
    /// For a link that had no shape before, the pairs are found by sampling. A mesh counts as its hull or its convex
    /// pieces.
    ///
    /// Args:
    ///     link: Name of a link of the chain.
    ///     shape: A shape, in the coordinates of the frame `pose`.
    ///     pose: Pose of the shape's coordinates in the frame of the link; the link's frame by default.
    #[pyo3(signature = (link, shape, pose=None))]
    fn with_shape(
        &self,
        py: Python<'_>,
        link: &str,
        shape: AnyObstacle<'_>,
        pose: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let pose = pose.map_or_else(|| Ok(Pose::identity()), read_pose)?;
        let arm = &self.chain.get().chain;
        self.with(py, self.geometry.with_shape(arm, link, &shape.obstacle().shape, &pose))
    }

    /// Without this pair of links: they may touch.
    ///
    /// Args:
    ///     first: Name of a link.
    ///     second: Name of the other one.
    fn allow(&self, py: Python<'_>, first: &str, second: &str) -> PyResult<Self> {
        self.with(py, self.geometry.allow(first, second))
    }

    /// Names of the links that have shapes.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.geometry.names().to_vec()
    }

    /// Pairs of links that must not touch.
    #[getter]
    fn pairs(&self) -> Vec<(String, String)> {
        self.geometry.pairs().iter().map(|pair| self.names_of(pair)).collect()
    }

    /// Pairs of links that are not checked, and why: Adjacent, Always, Never, Default, User.
    #[getter]
    fn left_out(&self) -> Vec<(String, String, &'static str)> {
        let one = |(pair, reason): &([usize; 2], redundancy_core::scene::Reason)| {
            let (a, b) = self.names_of(pair);
            (a, b, reason.as_str())
        };
        self.geometry.left_out().iter().map(one).collect()
    }

    /// The pairs that are not checked, as the text of an SRDF file.
    fn to_srdf(&self) -> String {
        self.geometry.to_srdf(self.chain.get().chain.name())
    }

    /// Least distance between links.
    ///
    /// Args:
    ///     q: `(n,)` or `(N, n)`.
    ///     cutoff: Distances above this one are not computed, which is faster, m. No cutoff by default.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, cutoff=None, *, threads=None))]
    fn self_clearance<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        cutoff: Option<f64>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PySelfClearance>> {
        let chain = &self.chain.get().chain;
        let n = chain.dof();
        let rows = read_rows(q, "q", &[n])?;
        let values = rows.as_slice()?;
        let mut all = Vec::with_capacity(values.len() / n.max(1));
        in_blocks(py, values.len() / n.max(1), BLOCK, threads, |range| {
            let block = &values[range.start * n..range.end * n];
            all.extend(self.geometry.self_clearance(chain, block, cutoff.unwrap_or(f64::INFINITY))?);
            Ok(())
        })?;
        Bound::new(py, PySelfClearance { rows: all, names: self.names(), batch: rows.batch.is_some() })
    }

    /// All pairs of links that are nearer than the cutoff, with gradients.
    ///
    /// Args:
    ///     q: `(n,)` or `(N, n)`.
    ///     cutoff: m; all pairs when left out.
    ///     threads: Threads for a batch; all cores by default.
    #[pyo3(signature = (q, cutoff=None, *, threads=None))]
    fn pair_clearances<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        cutoff: Option<f64>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyPairClearances>> {
        let chain = &self.chain.get().chain;
        let n = chain.dof();
        let rows = read_rows(q, "q", &[n])?;
        let values = rows.as_slice()?;
        let mut out = PyPairClearances { n, ..PyPairClearances::default() };
        let names = self.geometry.names();
        in_blocks(py, values.len() / n.max(1), BLOCK, threads, |range| {
            let block = &values[range.start * n..range.end * n];
            let all = self.geometry.pair_clearances(chain, block, cutoff.unwrap_or(f64::INFINITY))?;
            for (i, pairs) in all.into_iter().enumerate() {
                for pair in pairs {
                    out.row.push((range.start + i) as i64);
                    out.pairs.push(pair.links.map(|link| names[link].clone()).into());
                    out.distance.push(pair.distance);
                    out.gradient.extend(pair.gradient);
                }
            }
            Ok(())
        })?;
        Bound::new(py, out)
    }

    /// Number of shapes.
    fn __len__(&self) -> usize {
        self.geometry.len()
    }

    /// Name of the link and radius (m) of each capsule and sphere.
    #[getter]
    fn capsules(&self) -> Vec<(String, f64)> {
        let names = self.geometry.names();
        self.geometry.capsules().into_iter().map(|(link, radius)| (names[link].clone(), radius)).collect()
    }

    fn __repr__(&self) -> String {
        format!(
            "LinkGeometry({}, {} shapes of {} links, {} pairs)",
            self.chain.get().chain.name(),
            self.geometry.len(),
            self.geometry.names().len(),
            self.geometry.pairs().len()
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Py<PyChain>, String))> {
        let make = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((make, (self.chain.clone_ref(py), self.geometry.to_json())))
    }

    /// Inverse of pickling.
    #[staticmethod]
    fn _from_parts(chain: Py<PyChain>, text: &str) -> PyResult<Self> {
        let geometry = LinkGeometry::from_json(&chain.get().chain, text).map_err(to_py)?;
        Ok(Self { chain, geometry })
    }
}

/// `link_radius` or `links`: a radius of capsules from joint to joint, or a geometry.
pub enum LinkRadius<'py> {
    Geometry(Bound<'py, PyLinkGeometry>),
    Radius(f64),
}

one_of!(LinkRadius<'py>, "a LinkGeometry or a radius in m", Geometry, Radius);

impl LinkRadius<'_> {
    /// The shapes of `chain`.
    pub fn geometry(&self, chain: &Chain) -> PyResult<LinkGeometry> {
        match self {
            Self::Radius(radius) => LinkGeometry::joint_to_joint(chain, *radius).map_err(to_py),
            Self::Geometry(given) => geometry_of(given, chain),
        }
    }
}

/// The geometry inside, which must be one of this chain.
pub fn geometry_of(given: &Bound<'_, PyLinkGeometry>, chain: &Chain) -> PyResult<LinkGeometry> {
    let made_for = &given.get().chain.get().chain;
    if made_for != chain {
        let (other, own) = (made_for.name(), chain.name());
        return Err(to_py(Error::Invalid(format!(
            "links is a LinkGeometry of the chain '{other}', not of this chain '{own}': make it from the chain with the \
             same base, joints and tool"
        ))));
    }
    Ok(given.get().geometry.clone())
}

/// Least distance between links of an arm: for one configuration, or arrays for N of them.
#[pyclass(name = "SelfClearanceResult", module = "redundancy", frozen)]
pub struct PySelfClearance {
    rows: Vec<SelfClearance>,
    names: Vec<String>,
    batch: bool,
}

impl PySelfClearance {
    fn link<'py>(&self, py: Python<'py>, which: usize) -> PyResult<Bound<'py, PyAny>> {
        let name = |row: &SelfClearance| row.links.map(|links| self.names[links[which]].clone());
        let mut names: Vec<Option<String>> = self.rows.iter().map(name).collect();
        if self.batch {
            return names.into_pyobject(py).map(Bound::into_any);
        }
        Ok(names.pop().flatten().into_pyobject(py)?.into_any())
    }
}

#[pymethods]
impl PySelfClearance {
    /// The least signed distance, m: negative if links overlap; the cutoff if all are farther apart.
    #[getter]
    fn distance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let values: Vec<f64> = self.rows.iter().map(|row| row.distance).collect();
        match (self.batch, values.first()) {
            (false, Some(value)) => Ok(value.into_pyobject(py)?.into_any()),
            _ => Ok(PyArray1::from_vec(py, values).into_any()),
        }
    }

    /// Name of one of the two links (a list for a batch); `None` beyond the cutoff.
    #[getter]
    fn first<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.link(py, 0)
    }

    /// Name of the other one.
    #[getter]
    fn second<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.link(py, 1)
    }

    /// Derivative of the distance by the joints, `(n,)` or `(N, n)`; zero beyond the cutoff.
    #[getter]
    fn gradient<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let flat: Vec<f64> = self.rows.iter().flat_map(|row| row.gradient.iter().copied()).collect();
        if self.batch {
            let n = self.rows.first().map_or(0, |row| row.gradient.len());
            return Ok(to_array(py, &flat, [self.rows.len(), n])?.into_any());
        }
        Ok(PyArray1::from_vec(py, flat).into_any())
    }

    fn __repr__(&self) -> String {
        match (self.batch, self.rows.first()) {
            (false, Some(row)) => {
                let pair = row.links.map(|[a, b]| format!(", '{}', '{}'", self.names[a], self.names[b]));
                format!("SelfClearanceResult(distance={:.6}{})", row.distance, pair.unwrap_or_default())
            }
            _ => {
                let least = self.rows.iter().map(|row| row.distance).fold(f64::INFINITY, f64::min);
                format!("SelfClearanceResult({} configurations, least distance {least:.6})", self.rows.len())
            }
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, SelfParts)> {
        let rows = self.rows.iter().map(|row| (row.distance, row.links, row.gradient.clone())).collect();
        Ok((py.get_type::<Self>().getattr("_from_parts")?, (rows, self.names.clone(), self.batch)))
    }

    #[staticmethod]
    fn _from_parts(rows: Vec<SelfRow>, names: Vec<String>, batch: bool) -> PyResult<Self> {
        let known = |links: &Option<[usize; 2]>| links.is_none_or(|l| l.iter().all(|i| *i < names.len()));
        if !rows.iter().all(|(_, links, _)| known(links)) {
            return Err(to_py(Error::Invalid("a link without a name".into())));
        }
        let row = |(distance, links, gradient): SelfRow| SelfClearance { distance, links, gradient };
        Ok(Self { rows: rows.into_iter().map(row).collect(), names, batch })
    }
}

/// All pairs of links within the cutoff, as arrays.
#[pyclass(name = "PairClearances", module = "redundancy", frozen)]
#[derive(Default)]
pub struct PyPairClearances {
    row: Vec<i64>,
    pairs: Vec<(String, String)>,
    distance: Vec<f64>,
    gradient: Vec<f64>,
    n: usize,
}

#[pymethods]
impl PyPairClearances {
    /// The configuration of each pair `(k,)`, from 0.
    #[getter]
    fn row<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.row)
    }

    /// Names of the two links.
    #[getter]
    fn pairs(&self) -> Vec<(String, String)> {
        self.pairs.clone()
    }

    /// Signed distances `(k,)`, m, of the nearest shapes of the two links.
    #[getter]
    fn distance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.distance)
    }

    /// Their derivatives by the joints `(k, n)`.
    #[getter]
    fn gradient<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(to_array(py, &self.gradient, [self.distance.len(), self.n])?.into_any())
    }

    fn __len__(&self) -> usize {
        self.distance.len()
    }

    fn __repr__(&self) -> String {
        format!("PairClearances({} pairs)", self.distance.len())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, PairParts)> {
        let parts =
            (self.row.clone(), self.pairs.clone(), self.distance.clone(), self.gradient.clone(), self.n);
        Ok((py.get_type::<Self>().getattr("_from_parts")?, parts))
    }

    #[staticmethod]
    fn _from_parts(
        row: Vec<i64>,
        pairs: Vec<(String, String)>,
        distance: Vec<f64>,
        gradient: Vec<f64>,
        n: usize,
    ) -> PyResult<Self> {
        let k = row.len();
        if pairs.len() != k || distance.len() != k || gradient.len() != k * n {
            return Err(to_py(Error::Invalid("these are not the parts of pickled PairClearances".into())));
        }
        Ok(Self { row, pairs, distance, gradient, n })
    }
}

type PairParts = (Vec<i64>, Vec<(String, String)>, Vec<f64>, Vec<f64>, usize);
type SelfRow = (f64, Option<[usize; 2]>, Vec<f64>);
type SelfParts = (Vec<SelfRow>, Vec<String>, bool);

/// `self_collision`: `"auto"` or a truth value.
pub enum SelfCollision {
    Switch(bool),
    Word(String),
}

one_of!(SelfCollision, "True, False or \"auto\"", Switch, Word);

impl SelfCollision {
    /// Whether links are looked at: `"auto"` is where shapes are given that have pairs.
    pub fn decided(given: Option<Self>, links: Option<&LinkGeometry>) -> PyResult<bool> {
        let has_pairs = links.is_some_and(|links| !links.pairs().is_empty());
        match given {
            None => Ok(has_pairs),
            Some(Self::Word(word)) if word == "auto" => Ok(has_pairs),
            Some(Self::Switch(false)) => Ok(false),
            Some(Self::Switch(true)) if links.is_none() || has_pairs => Ok(true),
            Some(Self::Switch(true)) => Err(to_py(Error::Invalid(
                "self_collision: the links have no pairs that must not touch".into(),
            ))),
            Some(Self::Word(word)) => {
                let valid = vec!["auto".into(), "True".into(), "False".into()];
                Err(to_py(Error::UnknownName { kind: "self_collision", name: word, valid }))
            }
        }
    }
}
