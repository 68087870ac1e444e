//! Scene files: `{"obstacles": [{"type": "sphere", "center": [..], "radius": ..}, ...]}`.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::{Map, Value, json};

use super::{Capsule, Cuboid, Obstacle, Scene, Shape, Sphere, named};
use crate::error::{Error, Result};
use crate::pose::pose;
use crate::tolerance::QUATERNION_NORM;

/// Largest scene file, in bytes: bounds time and memory of a hostile one.
const MAX_BYTES: u64 = 64 << 20;
const TYPES: [&str; 3] = ["sphere", "box", "capsule"];

impl Scene {
    /// From a file, see [`Scene::from_json`].
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Scene::from_json`], with the file's name.
    pub fn from_json_file(path: impl AsRef<std::path::Path>) -> Result<Self> {
        let path = path.as_ref();
        let broken = |message: String| Error::File { file: path.display().to_string(), message };
        let size = std::fs::metadata(path).map_err(|error| broken(error.to_string()))?.len();
        if size > MAX_BYTES {
            return Err(broken(format!("has {size} bytes, at most {MAX_BYTES} are read")));
        }
        let text = std::fs::read_to_string(path).map_err(|error| broken(error.to_string()))?;
        Self::from_json(&text).map_err(|error| broken(error.to_string()))
    }

    /// From JSON text: an object with a list `obstacles`, each with its `type` and
    ///
    /// | type | numbers |
    /// |---|---|
    /// | `sphere` | `center`, `radius` |
    /// | `box` | `center`, `half_extents`, `quaternion_wxyz` (may be left out) |
    /// | `capsule` | `start`, `end`, `radius` |
    ///
    /// and `velocity` where it moves. Metres, seconds, world axes.
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
        let value: Value =
            serde_json::from_str(text).map_err(|error| Error::Invalid(format!("no JSON: {error}")))?;
        let Some(list) = value.get("obstacles").and_then(Value::as_array) else {
            return Err(Error::Invalid("a scene is an object with a list 'obstacles'".into()));
        };
        if let Some(key) = value.as_object().and_then(|map| map.keys().find(|key| *key != "obstacles")) {
            return Err(Error::Invalid(format!("unknown key '{key}', a scene has only 'obstacles'")));
        }
        let read = |(i, entry): (usize, &Value)| {
            let word = entry.get("type").and_then(Value::as_str).unwrap_or("no type");
            obstacle(entry).map_err(|error| named(i, word, &error))
        };
        Self::of_obstacles(list.iter().enumerate().map(read).collect::<Result<_>>()?)
    }

    /// The scene as JSON text, as [`Scene::from_json`] reads it.
    pub fn to_json(&self) -> String {
        let list: Vec<Value> = self.obstacles().iter().map(entry).collect();
        json!({ "obstacles": list }).to_string()
    }
}

fn obstacle(entry: &Value) -> Result<Obstacle> {
    let Some(map) = entry.as_object() else {
        return Err(Error::Invalid("is no object".into()));
    };
    let word = map.get("type").and_then(Value::as_str).unwrap_or("");
    let (shape, keys): (Shape, &[&str]) = match word {
        "sphere" => (
            Sphere { center: vector(map, "center")?, radius: number(map, "radius")? }.into(),
            &["center", "radius"],
        ),
        "box" => {
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
            let pose = pose(*rotation.to_rotation_matrix().matrix(), vector(map, "center")?);
            let half_extents = vector(map, "half_extents")?;
            (Cuboid { pose, half_extents }.into(), &["center", "half_extents", "quaternion_wxyz"])
        }
        "capsule" => (
            Capsule {
                start: vector(map, "start")?,
                end: vector(map, "end")?,
                radius: number(map, "radius")?,
            }
            .into(),
            &["start", "end", "radius"],
        ),
        _ => {
            let name =
                map.get("type").map_or("nothing".into(), |v| v.to_string().trim_matches('"').to_owned());
            let valid = TYPES.iter().map(|s| (*s).to_owned()).collect();
            return Err(Error::UnknownName { kind: "type", name, valid });
        }
    };
    if let Some(key) = map
        .keys()
        .find(|key| !keys.contains(&key.as_str()) && !["type", "velocity", "name"].contains(&key.as_str()))
    {
        let valid = keys.iter().chain(&["type", "velocity", "name"]).map(|s| (*s).to_owned()).collect();
        return Err(Error::UnknownName { kind: "key", name: key.clone(), valid });
    }
    let velocity = if map.contains_key("velocity") { vector(map, "velocity")? } else { Vector3::zeros() };
    Obstacle::moving(shape, velocity)
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
    let mut out = match &obstacle.shape {
        Shape::Sphere(s) => json!({"type": "sphere", "center": list(&s.center), "radius": s.radius}),
        Shape::Box(b) => {
            let q = UnitQuaternion::from_rotation_matrix(&b.pose.rotation);
            json!({
                "type": "box", "center": list(&b.pose.translation.vector), "half_extents": list(&b.half_extents),
                "quaternion_wxyz": [q.w, q.i, q.j, q.k],
            })
        }
        Shape::Capsule(c) => {
            json!({"type": "capsule", "start": list(&c.start), "end": list(&c.end), "radius": c.radius})
        }
    };
    if obstacle.velocity != Vector3::zeros() {
        out["velocity"] = list(&obstacle.velocity);
    }
    out
}
