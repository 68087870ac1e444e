//! Obstacles: spheres, boxes, capsules, cylinders, half-spaces, meshes.

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::scene::{
    Capsule, Cuboid, Cylinder, HalfSpace, Mesh, MeshSolid, Obstacle, Shape, Sphere, TriangleMesh,
};
use redundancy_core::{Error, Pose, pose_from_row_major, pose_to_row_major};

use crate::convert::{one_of, read_array, read_pose, read_rows, to_array};
use crate::error::to_py;

pub fn list(v: &Vector3<f64>) -> [f64; 3] {
    [v.x, v.y, v.z]
}

/// What every obstacle may have: velocity, name, the link that carries it.
type Extra = ([f64; 3], Option<String>, Option<String>);

fn extra_of(
    velocity: Option<&Bound<'_, PyAny>>,
    name: Option<String>,
    attached_to: Option<String>,
) -> PyResult<Extra> {
    Ok((velocity.map_or(Ok([0.0; 3]), |v| read_array(v, "velocity"))?, name, attached_to))
}

fn obstacle_of(shape: impl Into<Shape>, (velocity, name, attached_to): Extra) -> PyResult<Obstacle> {
    let obstacle = Obstacle { shape: shape.into(), velocity: velocity.into(), name, attached_to };
    obstacle.validate().map_err(to_py)?;
    Ok(obstacle)
}

fn extra(obstacle: &Obstacle) -> Extra {
    (list(&obstacle.velocity), obstacle.name.clone(), obstacle.attached_to.clone())
}

/// `, velocity=..., name=..., attached_to=...` where there are such.
fn extra_text(obstacle: &Obstacle) -> String {
    let mut out = String::new();
    if obstacle.velocity != Vector3::zeros() {
        out.push_str(&format!(", velocity={:?}", list(&obstacle.velocity)));
    }
    for (key, value) in [("name", &obstacle.name), ("attached_to", &obstacle.attached_to)] {
        if let Some(value) = value {
            out.push_str(&format!(", {key}='{value}'"));
        }
    }
    out
}

/// What all classes of obstacles have beside their constructor: the first block are their own methods.
macro_rules! obstacle_class {
    ($class:ident, { $($own:item)* }) => {
        #[pymethods]
        impl $class {
            $($own)*

            /// Velocity `(3,)`, m/s.
            #[getter]
            fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
                PyArray1::from_slice(py, self.obstacle.velocity.as_slice())
            }

            /// Its name.
            #[getter]
            fn name(&self) -> Option<String> {
                self.obstacle.name.clone()
            }

            /// The link that carries it.
            #[getter]
            fn attached_to(&self) -> Option<String> {
                self.obstacle.attached_to.clone()
            }

            fn __repr__(&self) -> String {
                self.text(&extra_text(&self.obstacle))
            }

            fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
                let again = py.get_type::<Self>().getattr("_from_parts")?;
                Ok((again, (self.parts(), extra(&self.obstacle)).into_pyobject(py)?))
            }
        }
    };
}

/// A ball.
///
/// Args:
///     center: `(3,)`, m, world axes.
///     radius: m, not negative.
///     velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
///     name: Any text.
///     attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
#[pyclass(name = "Sphere", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PySphere {
    pub obstacle: Obstacle,
    sphere: Sphere,
}

impl PySphere {
    fn made(sphere: Sphere, extra: Extra) -> PyResult<Self> {
        Ok(Self { obstacle: obstacle_of(sphere, extra)?, sphere })
    }

    fn text(&self, extra: &str) -> String {
        format!("Sphere({:?}, {:?}{extra})", list(&self.sphere.center), self.sphere.radius)
    }

    fn parts(&self) -> ([f64; 3], f64) {
        (list(&self.sphere.center), self.sphere.radius)
    }
}

obstacle_class!(PySphere, {
    #[new]
    #[pyo3(signature = (center, radius, *, velocity=None, name=None, attached_to=None))]
    fn new(
        center: &Bound<'_, PyAny>,
        radius: f64,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        attached_to: Option<String>,
    ) -> PyResult<Self> {
        let sphere = Sphere { center: read_array(center, "center")?.into(), radius };
        Self::made(sphere, extra_of(velocity, name, attached_to)?)
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

    #[staticmethod]
    fn _from_parts(parts: ([f64; 3], f64), extra: Extra) -> PyResult<Self> {
        let (center, radius) = parts;
        Self::made(Sphere { center: center.into(), radius }, extra)
    }
});

/// A box with any orientation.
///
/// Args:
///     pose: Its centre and its axes.
///     half_extents: `(3,)`, half of its edge lengths, m.
///     velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
///     name: Any text.
///     attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
#[pyclass(name = "Box", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyBox {
    pub obstacle: Obstacle,
    cuboid: Cuboid,
}

impl PyBox {
    fn made(cuboid: Cuboid, extra: Extra) -> PyResult<Self> {
        Ok(Self { obstacle: obstacle_of(cuboid, extra)?, cuboid })
    }

    fn text(&self, extra: &str) -> String {
        let center = list(&self.cuboid.pose.translation.vector);
        format!("Box(at {center:?}, half_extents={:?}{extra})", list(&self.cuboid.half_extents))
    }

    fn parts(&self) -> ([f64; 16], [f64; 3]) {
        (pose_to_row_major(&self.cuboid.pose), list(&self.cuboid.half_extents))
    }
}

obstacle_class!(PyBox, {
    #[new]
    #[pyo3(signature = (pose, half_extents, *, velocity=None, name=None, attached_to=None))]
    fn new(
        pose: &Bound<'_, PyAny>,
        half_extents: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        attached_to: Option<String>,
    ) -> PyResult<Self> {
        let half_extents = read_array(half_extents, "half_extents")?.into();
        let cuboid = Cuboid { pose: read_pose(pose)?, half_extents };
        Self::made(cuboid, extra_of(velocity, name, attached_to)?)
    }

    /// Centre and axes `(4, 4)`.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        pose_array(py, &self.cuboid.pose)
    }

    /// Half of its edge lengths `(3,)`, m.
    #[getter]
    fn half_extents<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.cuboid.half_extents.as_slice())
    }

    #[staticmethod]
    fn _from_parts(parts: ([f64; 16], [f64; 3]), extra: Extra) -> PyResult<Self> {
        let (pose, half) = parts;
        Self::made(Cuboid { pose: pose_of(&pose)?, half_extents: half.into() }, extra)
    }
});

/// All points within `radius` of a segment.
///
/// Args:
///     start: `(3,)`, m, world axes.
///     end: `(3,)`, m.
///     radius: m, not negative.
///     velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
///     name: Any text.
///     attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
#[pyclass(name = "Capsule", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyCapsule {
    pub obstacle: Obstacle,
    capsule: Capsule,
}

impl PyCapsule {
    fn made(capsule: Capsule, extra: Extra) -> PyResult<Self> {
        Ok(Self { obstacle: obstacle_of(capsule, extra)?, capsule })
    }

    fn text(&self, extra: &str) -> String {
        let (start, end) = (list(&self.capsule.start), list(&self.capsule.end));
        format!("Capsule({start:?}, {end:?}, {:?}{extra})", self.capsule.radius)
    }

    fn parts(&self) -> ([f64; 3], [f64; 3], f64) {
        (list(&self.capsule.start), list(&self.capsule.end), self.capsule.radius)
    }
}

obstacle_class!(PyCapsule, {
    #[new]
    #[pyo3(signature = (start, end, radius, *, velocity=None, name=None, attached_to=None))]
    fn new(
        start: &Bound<'_, PyAny>,
        end: &Bound<'_, PyAny>,
        radius: f64,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        attached_to: Option<String>,
    ) -> PyResult<Self> {
        let capsule = Capsule {
            start: read_array(start, "start")?.into(),
            end: read_array(end, "end")?.into(),
            radius,
        };
        Self::made(capsule, extra_of(velocity, name, attached_to)?)
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

    #[staticmethod]
    fn _from_parts(parts: ([f64; 3], [f64; 3], f64), extra: Extra) -> PyResult<Self> {
        let (start, end, radius) = parts;
        Self::made(Capsule { start: start.into(), end: end.into(), radius }, extra)
    }
});

/// A cylinder with any orientation.
///
/// Args:
///     pose: Its centre and its axes; z is the axis of the cylinder.
///     radius: m, not negative.
///     half_length: Half of its length, m, not negative.
///     velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
///     name: Any text.
///     attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
#[pyclass(name = "Cylinder", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyCylinder {
    pub obstacle: Obstacle,
    cylinder: Cylinder,
}

impl PyCylinder {
    fn made(cylinder: Cylinder, extra: Extra) -> PyResult<Self> {
        Ok(Self { obstacle: obstacle_of(cylinder, extra)?, cylinder })
    }

    fn text(&self, extra: &str) -> String {
        let Cylinder { pose, radius, half_length } = &self.cylinder;
        let center = list(&pose.translation.vector);
        format!("Cylinder(at {center:?}, radius={radius:?}, half_length={half_length:?}{extra})")
    }

    fn parts(&self) -> ([f64; 16], f64, f64) {
        (pose_to_row_major(&self.cylinder.pose), self.cylinder.radius, self.cylinder.half_length)
    }
}

obstacle_class!(PyCylinder, {
    #[new]
    #[pyo3(signature = (pose, radius, half_length, *, velocity=None, name=None, attached_to=None))]
    fn new(
        pose: &Bound<'_, PyAny>,
        radius: f64,
        half_length: f64,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        attached_to: Option<String>,
    ) -> PyResult<Self> {
        let cylinder = Cylinder { pose: read_pose(pose)?, radius, half_length };
        Self::made(cylinder, extra_of(velocity, name, attached_to)?)
    }

    /// Centre and axes `(4, 4)`; z is the axis of the cylinder.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        pose_array(py, &self.cylinder.pose)
    }

    /// Radius, m.
    #[getter]
    fn radius(&self) -> f64 {
        self.cylinder.radius
    }

    /// Half of its length, m.
    #[getter]
    fn half_length(&self) -> f64 {
        self.cylinder.half_length
    }

    #[staticmethod]
    fn _from_parts(parts: ([f64; 16], f64, f64), extra: Extra) -> PyResult<Self> {
        let (pose, radius, half_length) = parts;
        Self::made(Cylinder { pose: pose_of(&pose)?, radius, half_length }, extra)
    }
});

/// Everything on one side of a plane: a floor, a wall.
///
/// Args:
///     point: `(3,)`, a point of the plane, m, world axes.
///     normal: `(3,)`, away from the solid side; its length does not matter.
///     velocity: `(3,)`, m/s, of a moving one.
///     name: Any text.
#[pyclass(name = "HalfSpace", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyHalfSpace {
    pub obstacle: Obstacle,
    half_space: HalfSpace,
}

impl PyHalfSpace {
    fn made(half_space: HalfSpace, extra: Extra) -> PyResult<Self> {
        Ok(Self { obstacle: obstacle_of(half_space, extra)?, half_space })
    }

    fn text(&self, extra: &str) -> String {
        format!("HalfSpace({:?}, {:?}{extra})", list(&self.half_space.point), list(&self.half_space.normal))
    }

    fn parts(&self) -> ([f64; 3], [f64; 3]) {
        (list(&self.half_space.point), list(&self.half_space.normal))
    }
}

obstacle_class!(PyHalfSpace, {
    #[new]
    #[pyo3(signature = (point, normal, *, velocity=None, name=None))]
    fn new(
        point: &Bound<'_, PyAny>,
        normal: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
    ) -> PyResult<Self> {
        let half_space = HalfSpace {
            point: read_array(point, "point")?.into(),
            normal: read_array(normal, "normal")?.into(),
        };
        Self::made(half_space, extra_of(velocity, name, None)?)
    }

    /// A point of the plane `(3,)`, m.
    #[getter]
    fn point<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.half_space.point.as_slice())
    }

    /// Unit vector `(3,)` away from the solid side.
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.half_space.normal.as_slice())
    }

    #[staticmethod]
    fn _from_parts(parts: ([f64; 3], [f64; 3]), extra: Extra) -> PyResult<Self> {
        let (point, normal) = parts;
        Self::made(HalfSpace { point: point.into(), normal: normal.into() }, extra)
    }
});

/// Triangles.
///
/// A closed convex mesh is its own hull. For any other mesh, `solid` chooses: `"exact"` (its triangles and, if it is
/// closed, the volume inside), `"hull"` (its convex hull), or `"decompose"` (convex pieces that together contain its
/// surface; this takes seconds the first time).
///
/// Args:
///     vertices: `(V, 3)`, m.
///     faces: `(F, 3)`, vertex indices from 0.
///     pose: Pose of the frame in which the vertices are given.
///     solid: `exact`, `hull` or `decompose`.
///     velocity: `(3,)`, m/s, of a moving obstacle; it does not rotate.
///     name: Any text.
///     attached_to: Name of the link that carries it; its coordinates are then those of that link's frame.
///
/// Raises:
///     RedundancyError: No face, an index that is no vertex, a vertex that is not finite.
///
/// Example:
///     >>> import redundancy as rd
///     >>> wedge = rd.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
///     >>> wedge.pieces
///     1
#[pyclass(name = "Mesh", module = "redundancy", frozen, eq)]
#[derive(PartialEq)]
pub struct PyMesh {
    pub obstacle: Obstacle,
    mesh: Mesh,
}

type MeshParts = (Vec<[f64; 3]>, Vec<[u32; 3]>, [f64; 16], String);

impl PyMesh {
    fn made(mesh: Mesh, extra: Extra) -> PyResult<Self> {
        Ok(Self { obstacle: obstacle_of(mesh.clone(), extra)?, mesh })
    }

    fn of(triangles: &TriangleMesh, pose: Option<Pose>, solid: &str, extra: Extra) -> PyResult<Self> {
        let solid = MeshSolid::from_name(solid).map_err(to_py)?;
        let pose = pose.unwrap_or_else(Pose::identity);
        Self::made(Mesh::new(triangles, solid, pose).map_err(to_py)?, extra)
    }

    fn text(&self, extra: &str) -> String {
        let (triangles, solid) = (self.mesh.mesh(), self.mesh.solid().as_str());
        let at = list(&self.mesh.pose.translation.vector);
        let (vertices, faces) = (triangles.vertices().len(), triangles.faces().len());
        format!("Mesh({vertices} vertices, {faces} faces at {at:?}, solid='{solid}'{extra})")
    }

    fn parts(&self) -> MeshParts {
        let triangles = self.mesh.mesh();
        let pose = pose_to_row_major(&self.mesh.pose);
        let solid = self.mesh.solid().as_str().into();
        (triangles.vertices().to_vec(), triangles.faces().to_vec(), pose, solid)
    }
}

obstacle_class!(PyMesh, {
    #[new]
    #[pyo3(signature = (vertices, faces, *, pose=None, solid="exact", velocity=None, name=None, attached_to=None))]
    fn new(
        vertices: &Bound<'_, PyAny>,
        faces: &Bound<'_, PyAny>,
        pose: Option<&Bound<'_, PyAny>>,
        solid: &str,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        attached_to: Option<String>,
    ) -> PyResult<Self> {
        let points = triples(vertices, "vertices")?;
        let whole = |x: &f64| *x >= 0.0 && *x <= f64::from(u32::MAX) && x.fract() == 0.0;
        let corners = triples(faces, "faces")?;
        if let Some(value) = corners.iter().flatten().find(|x| !whole(x)) {
            let (what, bound) = ("faces: a vertex index".into(), "a whole number >= 0".into());
            return Err(to_py(Error::OutOfRange { what, value: *value, bound }));
        }
        let corners = corners.iter().map(|f| f.map(|x| x as u32)).collect();
        let triangles = TriangleMesh::new(points, corners).map_err(to_py)?;
        let pose = pose.map(read_pose).transpose()?;
        Self::of(&triangles, pose, solid, extra_of(velocity, name, attached_to)?)
    }

    /// From an STL, OBJ or DAE file.
    ///
    /// Args:
    ///     path: The file.
    ///     scale: Factor that converts its coordinates to m.
    ///     pose: Pose of the frame of its coordinates.
    ///     solid: As for the class.
    ///     velocity: `(3,)`, m/s, of a moving obstacle.
    ///     name: For reports and `allowed`.
    ///     attached_to: Link that carries it.
    ///
    /// Raises:
    ///     RedundancyError: A file that cannot be read or is broken, numbers that are not finite.
    #[staticmethod]
    #[pyo3(signature = (path, *, scale=1.0, pose=None, solid="exact", velocity=None, name=None, attached_to=None))]
    fn from_file(
        path: std::path::PathBuf,
        scale: f64,
        pose: Option<&Bound<'_, PyAny>>,
        solid: &str,
        velocity: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        attached_to: Option<String>,
    ) -> PyResult<Self> {
        if !(scale > 0.0 && scale.is_finite()) {
            let bound = "> 0 and finite".into();
            return Err(to_py(Error::OutOfRange { what: "scale".into(), value: scale, bound }));
        }
        let mut triangles = TriangleMesh::from_file(path).map_err(to_py)?;
        if scale != 1.0 {
            triangles = triangles.mapped(|v| v * scale, false).map_err(to_py)?;
        }
        let pose = pose.map(read_pose).transpose()?;
        Self::of(&triangles, pose, solid, extra_of(velocity, name, attached_to)?)
    }

    /// Vertices `(V, 3)` in its own coordinates, m.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let vertices = self.mesh.mesh().vertices();
        Ok(to_array(py, vertices.as_flattened(), [vertices.len(), 3])?.into_any())
    }

    /// Vertex indices of its triangles `(F, 3)`.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let faces = self.mesh.mesh().faces();
        Ok(to_array(py, faces.as_flattened(), [faces.len(), 3])?.into_any())
    }

    /// Pose `(4, 4)` of the frame of its coordinates.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        pose_array(py, &self.mesh.pose)
    }

    /// How it counts: `"exact"`, `"hull"` or `"decompose"`.
    #[getter]
    fn solid(&self) -> &'static str {
        self.mesh.solid().as_str()
    }

    /// Number of convex pieces; 0 for `"exact"`.
    #[getter]
    fn pieces(&self) -> usize {
        self.mesh.pieces()
    }

    #[staticmethod]
    fn _from_parts(parts: MeshParts, extra: Extra) -> PyResult<Self> {
        let (vertices, faces, pose, solid) = parts;
        let triangles = TriangleMesh::new(vertices, faces).map_err(to_py)?;
        Self::of(&triangles, Some(pose_of(&pose)?), &solid, extra)
    }
});

fn pose_of(row_major: &[f64; 16]) -> PyResult<Pose> {
    pose_from_row_major(row_major).map_err(to_py)
}

fn pose_array<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Bound<'py, PyAny>> {
    Ok(to_array(py, &pose_to_row_major(pose), [4, 4])?.into_any())
}

/// An `(N, 3)` array.
fn triples(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[f64; 3]>> {
    let rows = read_rows(object, what, &[3])?;
    if rows.batch.is_none() {
        return Err(to_py(Error::Invalid(format!("{what} must be (N, 3), it is (3,)"))));
    }
    Ok(rows.as_slice()?.as_chunks::<3>().0.to_vec())
}

/// An obstacle of any type.
pub enum AnyObstacle<'py> {
    Sphere(Bound<'py, PySphere>),
    Box(Bound<'py, PyBox>),
    Capsule(Bound<'py, PyCapsule>),
    Cylinder(Bound<'py, PyCylinder>),
    HalfSpace(Bound<'py, PyHalfSpace>),
    Mesh(Bound<'py, PyMesh>),
}

one_of!(
    AnyObstacle<'py>,
    "an obstacle (Sphere, Box, Capsule, Cylinder, HalfSpace, Mesh)",
    Sphere,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Mesh
);

impl AnyObstacle<'_> {
    pub fn obstacle(&self) -> &Obstacle {
        match self {
            Self::Sphere(o) => &o.get().obstacle,
            Self::Box(o) => &o.get().obstacle,
            Self::Capsule(o) => &o.get().obstacle,
            Self::Cylinder(o) => &o.get().obstacle,
            Self::HalfSpace(o) => &o.get().obstacle,
            Self::Mesh(o) => &o.get().obstacle,
        }
    }
}

/// An obstacle as an object of its class.
pub fn to_object<'py>(py: Python<'py>, obstacle: &Obstacle) -> PyResult<Bound<'py, PyAny>> {
    let extra = extra(obstacle);
    Ok(match &obstacle.shape {
        Shape::Sphere(shape) => Bound::new(py, PySphere::made(*shape, extra)?)?.into_any(),
        Shape::Box(shape) => Bound::new(py, PyBox::made(*shape, extra)?)?.into_any(),
        Shape::Capsule(shape) => Bound::new(py, PyCapsule::made(*shape, extra)?)?.into_any(),
        Shape::Cylinder(shape) => Bound::new(py, PyCylinder::made(*shape, extra)?)?.into_any(),
        Shape::HalfSpace(shape) => Bound::new(py, PyHalfSpace::made(*shape, extra)?)?.into_any(),
        Shape::Mesh(shape) => Bound::new(py, PyMesh::made(shape.clone(), extra)?)?.into_any(),
    })
}
