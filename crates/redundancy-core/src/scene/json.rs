//! Scene files: `{"obstacles": [{"type": "sphere", "center": [..], "radius": ..}, ...], "allowed": [["link", "name"], ...]}`.

use std::path::Path;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::{Map, Value, json};

use super::mesh::TriangleMesh;
use super::mesh_obstacle::{Mesh, MeshSolid};
use super::obstacle::{Capsule, Cuboid, Cylinder, HalfSpace, Obstacle, Shape, Sphere};
use super::scene::{Scene, named};
use crate::error::{Error, Result};
use crate::pose::{Pose, pose};
use crate::tolerance::QUATERNION_NORM;

/// Largest scene file, in bytes: bounds time and memory of a hostile one.
const MAX_BYTES: u64 = 64 << 20;
/// Types of obstacles, and the keys of each beside [`COMMON`].
const TYPES: [(&str, &[&str]); 6] = [
    ("sphere", &["center", "radius"]),
    ("box", &["center", "half_extents", "quaternion_wxyz"]),
    ("capsule", &["start", "end", "radius"]),
    ("cylinder", &["center", "radius", "half_length", "quaternion_wxyz"]),
    ("half_space", &["point", "normal"]),
    ("mesh", &["vertices", "faces", "file", "solid", "center", "quaternion_wxyz"]),
];
/// Keys of every obstacle.
const COMMON: [&str; 4] = ["type", "velocity", "name", "attached_to"];

impl Scene {
    /// From a file, see [`Scene::from_json`].
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Scene::from_json`], with the file's name.
    pub fn from_json_file(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let broken = |message: String| Error::File { file: path.display().to_string(), message };
        let size = std::fs::metadata(path).map_err(|error| broken(error.to_string()))?.len();
        if size > MAX_BYTES {
            return Err(broken(format!("has {size} bytes, at most {MAX_BYTES} are read")));
        }
        let text = std::fs::read_to_string(path).map_err(|error| broken(error.to_string()))?;
        Self::from_json_in(&text, path.parent()).map_err(|error| broken(error.to_string()))
    }

    /// From JSON text: an object with a list `obstacles`, each with its `type` and
    ///
    /// | type | numbers |
    /// |---|---|
    /// | `sphere` | `center`, `radius` |
    /// | `box` | `center`, `half_extents`, `quaternion_wxyz` (may be left out) |
    /// | `capsule` | `start`, `end`, `radius` |
    /// | `cylinder` | `center`, `radius`, `half_length`, `quaternion_wxyz` (may be left out; round about z) |
    /// | `half_space` | `point`, `normal` (away from the solid side) |
    /// | `mesh` | `vertices` and `faces`, or `file`; `solid` (`exact`, `hull`, `decompose`), `center`, `quaternion_wxyz` may be left out |
    ///
    /// with `name`, with `velocity` where it moves, or with `attached_to`, the link that carries it, in whose frame the numbers are
    /// then. `allowed` may hold pairs of names that may touch. Metres, seconds, world axes. Files of meshes are looked for
    /// from the current folder on, for a scene file from its own.
    ///
    /// # Errors
    /// Text that is no JSON (with its line), an unknown type or key, a number that is missing or wrong; the message names
    /// the obstacle by its place in the list.
    ///
    /// ```
    /// use redundancy_core::scene::Scene;
    /// let text = r#"{"obstacles": [{"type": "sphere", "center": [0, 0, 1], "radius": -1}]}"#;
    /// let error = Scene::from_json(text).map(|_| ()).unwrap_err().to_string();
    /// assert_eq!(error, "obstacle 0 (sphere): radius is -1, it must be >= 0 m");
    /// ```
    pub fn from_json(text: &str) -> Result<Self> {
        Self::from_json_in(text, None)
    }

    fn from_json_in(text: &str, folder: Option<&Path>) -> Result<Self> {
        let value: Value =
            serde_json::from_str(text).map_err(|error| Error::Invalid(format!("no JSON: {error}")))?;
        let Some(list) = value.get("obstacles").and_then(Value::as_array) else {
            return Err(Error::Invalid("a scene is an object with a list 'obstacles'".into()));
        };
        let unknown = |map: &Map<String, Value>| {
            map.keys().find(|key| !["obstacles", "allowed"].contains(&key.as_str())).cloned()
        };
        if let Some(key) = value.as_object().and_then(unknown) {
            let message = format!("unknown key '{key}', a scene has only 'obstacles' and 'allowed'");
            return Err(Error::Invalid(message));
        }
        let read = |(i, entry): (usize, &Value)| {
            let word = entry.get("type").and_then(Value::as_str).unwrap_or("no type");
            obstacle(entry, folder).map_err(|error| named(i, word, &error))
        };
        let scene = Self::of_obstacles(list.iter().enumerate().map(read).collect::<Result<_>>()?)?;
        let Some(pairs) = value.get("allowed") else { return Ok(scene) };
        let pair = |pair: &Value| -> Option<[String; 2]> {
            let names: Vec<String> =
                pair.as_array()?.iter().filter_map(|n| Some(n.as_str()?.to_owned())).collect();
            names.try_into().ok().filter(|_| pair.as_array().is_some_and(|list| list.len() == 2))
        };
        let pairs: Option<Vec<[String; 2]>> =
            pairs.as_array().map(|list| list.iter().map(pair).collect()).unwrap_or(None);
        scene.with_allowed(
            pairs.ok_or_else(|| Error::Invalid("allowed is not a list of pairs of names".into()))?,
        )
    }

    /// The scene as JSON text, as [`Scene::from_json`] reads it. Meshes are written with their triangles.
    pub fn to_json(&self) -> String {
        let list: Vec<Value> = self.obstacles().iter().map(entry).collect();
        let mut out = json!({ "obstacles": list });
        if !self.allowed().is_empty() {
            out["allowed"] = json!(self.allowed());
        }
        out.to_string()
    }
}

fn obstacle(entry: &Value, folder: Option<&Path>) -> Result<Obstacle> {
    let Some(map) = entry.as_object() else {
        return Err(Error::Invalid("is no object".into()));
    };
    let word = map.get("type").and_then(Value::as_str).unwrap_or("");
    let Some((_, keys)) = TYPES.iter().find(|(name, _)| *name == word) else {
        let name = map.get("type").map_or("nothing".into(), |v| v.to_string().trim_matches('"').to_owned());
        let valid = TYPES.iter().map(|(name, _)| (*name).to_owned()).collect();
        return Err(Error::UnknownName { kind: "type", name, valid });
    };
    let is_known = |key: &String| keys.contains(&key.as_str()) || COMMON.contains(&key.as_str());
    if let Some(key) = map.keys().find(|key| !is_known(key)) {
        let valid = keys.iter().chain(&COMMON).map(|s| (*s).to_owned()).collect();
        return Err(Error::UnknownName { kind: "key", name: key.clone(), valid });
    }
    let velocity = if map.contains_key("velocity") { vector(map, "velocity")? } else { Vector3::zeros() };
    let obstacle = Obstacle {
        shape: shape(word, map, folder)?,
        velocity,
        name: word_of(map, "name")?,
        attached_to: word_of(map, "attached_to")?,
    };
    obstacle.validate()?;
    Ok(obstacle)
}

fn shape(word: &str, map: &Map<String, Value>, folder: Option<&Path>) -> Result<Shape> {
    Ok(match word {
        "sphere" => Sphere { center: vector(map, "center")?, radius: number(map, "radius")? }.into(),
        "box" => {
            let pose = placed(map, vector(map, "center")?)?;
            Cuboid { pose, half_extents: vector(map, "half_extents")? }.into()
        }
        "capsule" => {
            Capsule { start: vector(map, "start")?, end: vector(map, "end")?, radius: number(map, "radius")? }
                .into()
        }
        "cylinder" => Cylinder {
            pose: placed(map, vector(map, "center")?)?,
            radius: number(map, "radius")?,
            half_length: number(map, "half_length")?,
        }
        .into(),
        "half_space" => HalfSpace { point: vector(map, "point")?, normal: vector(map, "normal")? }.into(),
        _ => {
            let center = if map.contains_key("center") { vector(map, "center")? } else { Vector3::zeros() };
            let solid =
                word_of(map, "solid")?.map_or(Ok(MeshSolid::default()), |s| MeshSolid::from_name(&s))?;
            Mesh::new(&mesh(map, folder)?, solid, placed(map, center)?)?.into()
        }
    })
}

/// Triangles that are written out, or those of a file.
fn mesh(map: &Map<String, Value>, folder: Option<&Path>) -> Result<TriangleMesh> {
    if let Some(file) = word_of(map, "file")? {
        if map.contains_key("vertices") || map.contains_key("faces") {
            return Err(Error::Invalid("has both file and vertices; one of them is enough".into()));
        }
        let path = folder.map_or_else(|| Path::new(&file).to_path_buf(), |folder| folder.join(&file));
        return TriangleMesh::from_file(path);
    }
    let list = |key: &str| {
        let value = map.get(key).ok_or_else(|| Error::Invalid(format!("{key} is missing")))?;
        value.as_array().ok_or_else(|| Error::Invalid(format!("{key} is no list")))
    };
    let vertices =
        list("vertices")?.iter().enumerate().map(|(i, value)| triple(value, &format!("vertex {i}")));
    let index = |value: f64, i: usize| {
        let whole = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
        if whole { Ok(value as u32) } else { Err(Error::Invalid(format!("face {i} has the index {value}"))) }
    };
    let faces = list("faces")?.iter().enumerate().map(|(i, value)| {
        let [a, b, c] = triple(value, &format!("face {i}"))?;
        Ok([index(a, i)?, index(b, i)?, index(c, i)?])
    });
    TriangleMesh::new(vertices.collect::<Result<_>>()?, faces.collect::<Result<_>>()?)
}

/// A pose with the rotation of the quaternion, if there is one.
fn placed(map: &Map<String, Value>, center: Vector3<f64>) -> Result<Pose> {
    let rotation = match map.get("quaternion_wxyz") {
        None => UnitQuaternion::identity(),
        Some(_) => {
            let [w, x, y, z] = numbers(map, "quaternion_wxyz")?;
            let q = Quaternion::new(w, x, y, z);
            let norm = q.norm();
            if (norm - 1.0).abs() > QUATERNION_NORM {
                let what = "quaternion_wxyz".into();
                return Err(Error::NotUnit { what, norm, tolerance: QUATERNION_NORM });
            }
            UnitQuaternion::from_quaternion(q)
        }
    };
    Ok(pose(*rotation.to_rotation_matrix().matrix(), center))
}

/// A word that may be left out.
fn word_of(map: &Map<String, Value>, key: &str) -> Result<Option<String>> {
    match map.get(key) {
        None => Ok(None),
        Some(Value::String(word)) => Ok(Some(word.clone())),
        Some(other) => Err(Error::Invalid(format!("{key} is {other}, it must be a text"))),
    }
}

fn triple(value: &Value, what: &str) -> Result<[f64; 3]> {
    let list = value.as_array().map(|list| list.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>());
    let list = list.flatten().and_then(|list| <[f64; 3]>::try_from(list).ok());
    list.ok_or_else(|| Error::Invalid(format!("{what} is not a list of 3 numbers")))
}

fn number(map: &Map<String, Value>, key: &str) -> Result<f64> {
    let value = map.get(key).ok_or_else(|| Error::Invalid(format!("{key} is missing")))?;
    value.as_f64().ok_or_else(|| Error::Invalid(format!("{key} is {value}, it must be a number")))
}

fn numbers<const N: usize>(map: &Map<String, Value>, key: &str) -> Result<[f64; N]> {
    let value = map.get(key).ok_or_else(|| Error::Invalid(format!("{key} is missing")))?;
    let list = value.as_array().map(|list| list.iter().filter_map(Value::as_f64).collect::<Vec<f64>>());
    list.and_then(|list| list.try_into().ok())
        .filter(|_| value.as_array().is_some_and(|l| l.len() == N))
        .ok_or_else(|| Error::Invalid(format!("{key} is {value}, it must be a list of {N} numbers")))
}

fn vector(map: &Map<String, Value>, key: &str) -> Result<Vector3<f64>> {
    Ok(Vector3::from(numbers::<3>(map, key)?))
}

fn entry(obstacle: &Obstacle) -> Value {
    let list = |v: &Vector3<f64>| json!([v.x, v.y, v.z]);
    let turned = |pose: &Pose| {
        let q = UnitQuaternion::from_rotation_matrix(&pose.rotation);
        json!([q.w, q.i, q.j, q.k])
    };
    let mut out = match &obstacle.shape {
        Shape::Sphere(s) => json!({"center": list(&s.center), "radius": s.radius}),
        Shape::Box(b) => json!({
            "center": list(&b.pose.translation.vector), "half_extents": list(&b.half_extents),
            "quaternion_wxyz": turned(&b.pose),
        }),
        Shape::Capsule(c) => json!({"start": list(&c.start), "end": list(&c.end), "radius": c.radius}),
        Shape::Cylinder(c) => json!({
            "center": list(&c.pose.translation.vector), "radius": c.radius, "half_length": c.half_length,
            "quaternion_wxyz": turned(&c.pose),
        }),
        Shape::HalfSpace(h) => json!({"point": list(&h.point), "normal": list(&h.normal)}),
        Shape::Mesh(m) => json!({
            "vertices": m.mesh().vertices(), "faces": m.mesh().faces(), "solid": m.solid().as_str(),
            "center": list(&m.pose.translation.vector), "quaternion_wxyz": turned(&m.pose),
        }),
    };
    out["type"] = json!(obstacle.shape.as_str());
    if obstacle.velocity != Vector3::zeros() {
        out["velocity"] = list(&obstacle.velocity);
    }
    if let Some(name) = &obstacle.name {
        out["name"] = json!(name);
    }
    if let Some(link) = &obstacle.attached_to {
        out["attached_to"] = json!(link);
    }
    out
}
