//! A [`LinkGeometry`] as text, to keep or to send it: its shapes as they are, not the files that they came from.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use serde_json::{Map, Value, json};

use super::body::Body;
use super::core_shape::Core;
use super::geometry::{Inner, LinkGeometry};
use super::hull::Hull;
use super::pairs::Reason;
use super::solid::{Form, Solid};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::pose::{check_pose, pose};
use crate::tolerance::SCENE_SIZE;

impl LinkGeometry {
    /// As JSON text; [`LinkGeometry::from_json`] reads it.
    pub fn to_json(&self) -> String {
        let bodies: Vec<Value> = self.bodies().iter().map(body_to_json).collect();
        let left_out: Vec<Value> =
            self.left_out().iter().map(|([a, b], reason)| json!([a, b, reason.as_str()])).collect();
        let Inner { names, groups, neighbours, pairs, .. } = self.inner();
        json!({
            "names": names, "groups": groups, "neighbours": neighbours, "pairs": pairs, "left_out": left_out,
            "bodies": bodies,
        })
        .to_string()
    }

    /// From the text of [`LinkGeometry::to_json`], for the same chain.
    ///
    /// # Errors
    /// Text that is no such JSON, or does not fit the chain.
    pub fn from_json(chain: &Chain, text: &str) -> Result<Self> {
        let value: Value = serde_json::from_str(text).map_err(|error| bad(&format!("no JSON: {error}")))?;
        let list =
            |key: &str| value.get(key).and_then(Value::as_array).ok_or_else(|| bad(&format!("no {key}")));
        let names: Option<Vec<String>> =
            list("names")?.iter().map(|n| Some(n.as_str()?.to_owned())).collect();
        let names = names.ok_or_else(|| bad("names are no texts"))?;
        let index = |value: &Value, below: usize| {
            value
                .as_u64()
                .and_then(|i| usize::try_from(i).ok())
                .filter(|i| *i < below)
                .ok_or_else(|| bad("an index"))
        };
        let pair = |value: &Value| -> Result<[usize; 2]> {
            let at = |i: usize| index(value.get(i).unwrap_or(&Value::Null), names.len());
            Ok([at(0)?, at(1)?])
        };
        let groups: Vec<usize> =
            list("groups")?.iter().map(|g| index(g, chain.dof() + 1)).collect::<Result<_>>()?;
        if groups.len() != names.len() {
            return Err(bad("groups do not fit the names"));
        }
        let pairs = match value.get("pairs") {
            Some(Value::Null) | None => None,
            Some(_) => Some(list("pairs")?.iter().map(pair).collect::<Result<_>>()?),
        };
        let left_out = |value: &Value| -> Result<([usize; 2], Reason)> {
            let word = value.get(2).and_then(Value::as_str).unwrap_or_default();
            let reason = Reason::ALL.into_iter().find(|reason| reason.as_str() == word);
            Ok((pair(value)?, reason.ok_or_else(|| bad("a reason"))?))
        };
        let bodies = list("bodies")?.iter().map(|value| {
            let map = value.as_object().ok_or_else(|| bad("a body"))?;
            let owner = index(map.get("owner").unwrap_or(&Value::Null), names.len())?;
            let before = index(map.get("joints_before").unwrap_or(&Value::Null), chain.dof() + 1)?;
            let telescope = map.get("telescope").and_then(Value::as_bool).unwrap_or(false);
            Ok(Body::in_frame(chain, before, owner, solid(map)?, telescope && before > 0))
        });
        let inner = Inner {
            bodies: bodies.collect::<Result<_>>()?,
            groups,
            neighbours: list("neighbours")?.iter().map(pair).collect::<Result<_>>()?,
            pairs,
            left_out: list("left_out")?.iter().map(left_out).collect::<Result<_>>()?,
            names,
        };
        Ok(Self::of_inner(inner))
    }
}

fn bad(what: &str) -> Error {
    Error::Invalid(format!("link geometry: {what}"))
}

fn list(v: &Vector3<f64>) -> Value {
    json!([v.x, v.y, v.z])
}

fn body_to_json(body: &Body) -> Value {
    let solid = &body.solid;
    let (kind, numbers) = match &solid.form {
        Form::Convex(Core::Point) => ("sphere", Value::Null),
        Form::Convex(Core::Segment(half)) => ("capsule", list(half)),
        Form::Convex(Core::Box(half)) => ("box", list(half)),
        Form::Convex(Core::Cylinder { radius, half }) => ("cylinder", json!([radius, half])),
        Form::Convex(Core::Hull(hull)) => ("hull", json!(hull.points())),
        Form::Convex(Core::Triangle(corners)) => ("hull", json!(corners.map(|c| [c.x, c.y, c.z]))),
        // No link has such a form.
        Form::HalfSpace | Form::Surface(_) => ("none", Value::Null),
    };
    json!({
        "owner": body.owner, "joints_before": body.joints_before, "telescope": body.telescope, "kind": kind,
        "numbers": numbers, "rotation": solid.rotation.as_slice(), "origin": list(&solid.origin),
        "radius": solid.radius,
    })
}

fn solid(map: &Map<String, Value>) -> Result<Solid> {
    let numbers = |value: Option<&Value>| -> Result<Vec<f64>> {
        let list = value.and_then(Value::as_array).ok_or_else(|| bad("numbers are missing"))?;
        let fits = |x: &f64| x.abs() <= SCENE_SIZE;
        let read = list.iter().map(|x| x.as_f64().filter(fits)).collect::<Option<Vec<f64>>>();
        read.ok_or_else(|| bad("a number"))
    };
    let fixed = |key: &str, count: usize| {
        let list = numbers(map.get(key))?;
        if list.len() == count { Ok(list) } else { Err(bad(key)) }
    };
    let size = |x: f64| if x >= 0.0 { Ok(x) } else { Err(bad("a size is negative")) };
    let radius =
        size(map.get("radius").and_then(Value::as_f64).filter(|x| *x <= SCENE_SIZE).unwrap_or(-1.0))?;
    let at = pose(
        Matrix3::from_column_slice(&fixed("rotation", 9)?),
        Vector3::from_column_slice(&fixed("origin", 3)?),
    );
    check_pose("link geometry: pose", &at)?;
    let vector = || Ok::<_, Error>(Vector3::from_column_slice(&fixed("numbers", 3)?));
    let core = match map.get("kind").and_then(Value::as_str) {
        Some("sphere") => Core::Point,
        Some("capsule") => Core::Segment(vector()?),
        Some("box") => Core::Box(vector()?.map(f64::abs)),
        Some("cylinder") => {
            let list = fixed("numbers", 2)?;
            Core::Cylinder { radius: size(list[0])?, half: size(list[1])? }
        }
        Some("hull") => {
            let list = map.get("numbers").and_then(Value::as_array).ok_or_else(|| bad("a hull"))?;
            let point = |value: &Value| -> Result<[f64; 3]> {
                numbers(Some(value))?.try_into().map_err(|_| bad("a point of a hull"))
            };
            let points = list.iter().map(point).collect::<Result<Vec<[f64; 3]>>>()?;
            Core::Hull(Arc::new(Hull::new(&points).ok_or_else(|| bad("a hull without points"))?))
        }
        _ => return Err(bad("an unknown kind of body")),
    };
    Ok(Solid::convex(core, &at, radius))
}
