//! Obstacles, and how far an arm is from them.

use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use redundancy_core::Error;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::scene::{ByLink, NearestPair, Scene, Surroundings};

use crate::batch::in_blocks;
use crate::chain::PyChain;
use crate::convert::{Threads, read_rows, to_array};
use crate::error::to_py;
use crate::links::LinkRadius;
use crate::obstacle::{AnyObstacle, list, to_object};

/// Radius of the links, m, where none is given.
pub const LINK_RADIUS: f64 = 0.05;
/// Configurations between two looks for Ctrl-C.
const BLOCK: usize = 8_192;

/// Obstacles in the world, and pairs of names that may touch. Immutable.
///
/// Args:
///     obstacles: Any number of `Sphere`, `Box`, `Capsule`, `Cylinder`, `HalfSpace` and `Mesh`.
///     allowed: Pairs of names that may touch: an obstacle, and a link or an obstacle that a link carries. Contact
///         between them is ignored.
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
    #[pyo3(signature = (obstacles=None, *, allowed=None))]
    fn new(obstacles: Option<&Bound<'_, PyAny>>, allowed: Option<Vec<[String; 2]>>) -> PyResult<Self> {
        let mut list = Vec::new();
        let items = obstacles.map(|given| {
            let unfit = |_| {
                let word = given.get_type().name().map_or_else(|_| "object".into(), |name| name.to_string());
                let message =
                    format!("obstacles is one {word}, expected a list of obstacles such as Sphere and Box");
                PyTypeError::new_err(message)
            };
            given.try_iter().map_err(unfit)
        });
        for item in items.transpose()?.into_iter().flatten() {
            let item = item?;
            match item.extract::<AnyObstacle<'_>>() {
                Ok(obstacle) => list.push(obstacle.obstacle().clone()),
                Err(_) => {
                    let (i, text) = (list.len(), item.repr()?);
                    let kinds = "a Sphere, a Box, a Capsule, a Cylinder, a HalfSpace or a Mesh";
                    return Err(to_py(Error::Invalid(format!("obstacle {i} is {text}, expected {kinds}"))));
                }
            }
        }
        let scene = Scene::of_obstacles(list).map_err(to_py)?;
        Ok(Self { scene: scene.with_allowed(allowed.unwrap_or_default()).map_err(to_py)? })
    }

    /// From a file: `{"obstacles": [{"type": "sphere", "center": [..], "radius": ..}, ...], "allowed": [[.., ..]]}`.
    ///
    /// | type | numbers |
    /// |---|---|
    /// | `sphere` | `center`, `radius` |
    /// | `box` | `center`, `half_extents`, `quaternion_wxyz` |
    /// | `capsule` | `start`, `end`, `radius` |
    /// | `cylinder` | `center`, `radius`, `half_length`, `quaternion_wxyz` |
    /// | `half_space` | `point`, `normal` |
    /// | `mesh` | `vertices` and `faces`, or `file` (from the scene's folder); `solid`, `center`, `quaternion_wxyz` |
    ///
    /// Any may have a `name`, and a `velocity` or `attached_to`. Quaternions, `allowed`, and `solid` and `center` of a
    /// mesh may be left out.
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

    /// From JSON text; mesh files are relative to the current folder.
    #[staticmethod]
    fn from_json_string(text: &str) -> PyResult<Self> {
        Ok(Self { scene: Scene::from_json(text).map_err(to_py)? })
    }

    /// The scene as JSON text that `from_json` reads; meshes are written with their triangles.
    fn to_json(&self) -> String {
        self.scene.to_json()
    }

    /// The obstacles.
    #[getter]
    fn obstacles<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        self.scene.obstacles().iter().map(|obstacle| to_object(py, obstacle)).collect()
    }

    /// Pairs of names that may touch.
    #[getter]
    fn allowed(&self) -> Vec<(String, String)> {
        self.scene.allowed().iter().map(|[a, b]| (a.clone(), b.clone())).collect()
    }

    /// The scene at time `t` (s), with moving obstacles at their positions at that time.
    fn at(&self, t: f64) -> PyResult<Self> {
        if !t.is_finite() {
            return Err(to_py(Error::NotFinite { what: "t".into(), index: 0, value: t }));
        }
        Ok(Self { scene: self.scene.at(t) })
    }

    /// The nearest pair of a link and an obstacle, and the nearest obstacle of each link.
    ///
    /// Links are capsules from joint to joint and from the last joint to the tool, or what `links` says. Links that
    /// do not move count if `links` has shapes for them. Obstacles that a link carries count as part of it against
    /// other obstacles, and as obstacles for the other links.
    ///
    /// Args:
    ///     chain: The arm.
    ///     q: `(n,)` or `(N, n)`.
    ///     link_radius: Of the capsules from joint to joint, m; or a `LinkGeometry` of this chain.
    ///     links: Another name of `link_radius`.
    ///     threads: Threads for a batch; all cores by default.
    ///
    /// Raises:
    ///     RedundancyError: A name in `allowed` that is neither a link nor an obstacle, an `attached_to` that is no
    ///         link.
    #[pyo3(
        signature = (chain, q, link_radius=None, *, links=None, threads=None),
        text_signature = "($self, chain, q, link_radius=0.05, *, links=None, threads=None)"
    )]
    fn clearance<'py>(
        &self,
        py: Python<'py>,
        chain: &Bound<'py, PyChain>,
        q: &Bound<'py, PyAny>,
        link_radius: Option<LinkRadius<'_>>,
        links: Option<LinkRadius<'_>>,
        threads: Option<Threads>,
    ) -> PyResult<Bound<'py, PyClearance>> {
        let chain = &chain.get().chain;
        let n = chain.dof();
        let links = links.or(link_radius).unwrap_or(LinkRadius::Radius(LINK_RADIUS));
        let around =
            Surroundings::new(chain, &links.geometry(chain)?, Some(&self.scene), false).map_err(to_py)?;
        let rows = read_rows(q, "q", &[n])?;
        let values = rows.as_slice()?;
        let mut all = Vec::with_capacity(values.len() / n.max(1));
        in_blocks(py, values.len() / n.max(1), BLOCK, threads, |range| {
            let block = &values[range.start * n..range.end * n];
            all.extend(Scene::clearance_batch(chain, block, &around)?);
            Ok(())
        })?;
        Bound::new(py, PyClearance::of(all, around.link_names().to_vec(), rows.batch.is_some()))
    }

    fn __len__(&self) -> usize {
        self.scene.obstacles().len()
    }

    fn __repr__(&self) -> String {
        let words: Vec<&str> = self.scene.obstacles().iter().map(|o| o.shape.as_str()).collect();
        format!("Scene({})", words.join(", "))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, SceneParts<'py>)> {
        Ok((py.get_type::<Self>().getattr("_from_parts")?, (self.obstacles(py)?, self.allowed())))
    }

    #[staticmethod]
    fn _from_parts(obstacles: &Bound<'_, PyAny>, allowed: Vec<[String; 2]>) -> PyResult<Self> {
        Self::new(Some(obstacles), Some(allowed))
    }
}

type SceneParts<'py> = (Vec<Bound<'py, PyAny>>, Vec<(String, String)>);

/// Distances of an arm from a scene: for one configuration, or arrays for N of them.
#[pyclass(name = "ClearanceResult", module = "redundancy", frozen)]
pub struct PyClearance {
    pairs: Vec<Option<NearestPair>>,
    /// The nearest of each link, of each configuration; empty in what is itself of one link.
    by_link: Vec<ByLink>,
    links: Vec<String>,
    batch: bool,
}

impl PyClearance {
    fn of(by_link: Vec<ByLink>, links: Vec<String>, batch: bool) -> Self {
        let least =
            |row: &ByLink| row.iter().flatten().min_by(|a, b| a.distance.total_cmp(&b.distance)).copied();
        Self { pairs: by_link.iter().map(least).collect(), by_link, links, batch }
    }

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

    /// The nearest obstacle of each link, by its name.
    #[getter]
    fn by_link<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for (i, name) in self.links.iter().enumerate() {
            let pairs: Vec<Option<NearestPair>> =
                self.by_link.iter().map(|row| row.get(i).copied().flatten()).collect();
            if pairs.iter().any(Option::is_some) {
                let one = Self { pairs, by_link: Vec::new(), links: self.links.clone(), batch: self.batch };
                out.set_item(name, Bound::new(py, one)?)?;
            }
        }
        Ok(out)
    }

    fn __float__(&self) -> PyResult<f64> {
        if self.batch {
            return Err(PyTypeError::new_err(
                "the clearance of several configurations is not a single number",
            ));
        }
        Ok(self.pairs.first().copied().flatten().map_or(f64::INFINITY, |pair| pair.distance))
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
        let all = |row: &[Option<NearestPair>]| row.iter().map(|pair| pair.as_ref().map(parts)).collect();
        let by_link = self.by_link.iter().map(|row| all(row)).collect();
        Ok((
            py.get_type::<Self>().getattr("_from_parts")?,
            (all(&self.pairs), by_link, self.links.clone(), self.batch),
        ))
    }

    #[staticmethod]
    fn _from_parts(
        pairs: Vec<Option<PairParts>>,
        by_link: Vec<Vec<Option<PairParts>>>,
        links: Vec<String>,
        batch: bool,
    ) -> Self {
        let pair = |(distance, link, obstacle, [on_link, on_obstacle, normal]): PairParts| NearestPair {
            distance,
            link,
            obstacle,
            on_link: on_link.into(),
            on_obstacle: on_obstacle.into(),
            normal: normal.into(),
        };
        let all = |row: Vec<Option<PairParts>>| row.into_iter().map(|p| p.map(pair)).collect::<Vec<_>>();
        Self { pairs: all(pairs), by_link: by_link.into_iter().map(all).collect(), links, batch }
    }
}

type PairParts = (f64, usize, usize, [[f64; 3]; 3]);
type Parts = (Vec<Option<PairParts>>, Vec<Vec<Option<PairParts>>>, Vec<String>, bool);
