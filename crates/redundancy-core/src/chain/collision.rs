//! The collision geometry of a URDF, placed on the links of a chain.
//!
//! Every link of the document counts that joints connect with the chain: what stands with the base (torso, pedestal), what is
//! beyond the tip, and what further joints move (fingers, a head). Those joints stand where a posture has them, at the
//! position nearest to 0 within their limits otherwise; a joint that mimics another one follows it. So each body is fixed
//! to a link of the chain.

#[cfg(feature = "urdf")]
use std::collections::{HashMap, HashSet, VecDeque};
#[cfg(feature = "urdf")]
use std::path::Path;

#[cfg(feature = "urdf")]
use nalgebra::{Rotation3, Unit, Vector3};
#[cfg(feature = "urdf")]
use roxmltree::Node;

#[cfg(feature = "urdf")]
use super::chain::Chain;
#[cfg(feature = "urdf")]
use super::urdf::{
    self, JointNode, Tree, Version, attribute, bad, element, elements, numbers, parse, placed,
};
#[cfg(feature = "urdf")]
use crate::error::{Error, Result};
use crate::pose::Pose;

#[cfg(feature = "urdf")]
/// Most links with bodies, and most bodies: each pair of links may have to be looked at. Humanoids have a hundred.
const MAX_BODIED_LINKS: usize = 500;
#[cfg(feature = "urdf")]
const MAX_BODIES: usize = 5_000;

/// The shape of a collision body, in its own frame.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum CollisionShape {
    /// A ball.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// A cylinder along z, its middle at the origin.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// From end to end, m.
        length: f64,
    },
    /// A cylinder along z with half a ball on each end, its middle at the origin.
    Capsule {
        /// Radius, m.
        radius: f64,
        /// Of the cylinder, m.
        length: f64,
    },
    /// A box around the origin.
    Box {
        /// Half of its edges along x, y, z, m.
        half_extents: [f64; 3],
    },
    /// The triangles of a file.
    Mesh {
        /// The name of the file as the document has it.
        file: String,
        /// Factors of its coordinates.
        scale: [f64; 3],
    },
}

/// A collision body of a URDF.
#[derive(Debug, Clone, PartialEq)]
pub struct CollisionBody {
    /// Name of its link in the document.
    pub name: String,
    /// Index in [`Chain::links`] of the link that it is fixed to.
    pub link: usize,
    /// Its pose in the frame of that link.
    pub pose: Pose,
    /// Its shape.
    pub shape: CollisionShape,
}

/// The collision geometry of a URDF.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CollisionModel {
    /// The bodies, in the order of the document.
    pub bodies: Vec<CollisionBody>,
    /// Links that a joint connects, also across links without bodies: they touch where they meet.
    pub neighbours: Vec<[String; 2]>,
}

#[cfg(feature = "urdf")]
impl Chain {
    /// The collision geometry of a URDF file from which this chain was read (or that has links of the same names).
    ///
    /// # Errors
    /// A file that cannot be read, and everything that [`Chain::collision_from_urdf_string`] refuses.
    pub fn collision_from_urdf(
        &self,
        path: impl AsRef<Path>,
        posture: &[(String, f64)],
    ) -> Result<CollisionModel> {
        let xml = urdf::read_file(path.as_ref())?;
        self.collision_from_urdf_string(&xml, posture).map_err(|error| urdf::in_file(path.as_ref(), error))
    }

    /// The collision geometry in the text of a URDF, with `posture` the positions of joints outside of the chain.
    ///
    /// # Errors
    /// Text that [`Chain::from_urdf_string`] refuses as a document; none of its links in the chain; a geometry that is unknown
    /// or missing, sizes that are not positive; a joint in the posture that is unknown or one of the chain's; a joint
    /// outside of the chain that mimics one of the chain. The message names the link or joint.
    ///
    /// ```
    /// use redundancy_core::chain::{Chain, CollisionShape, MissingLimits};
    /// let xml = r#"<robot name="r"> <link name="a"/>
    ///   <link name="b"><collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.05"/></geometry></collision></link>
    ///   <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
    /// </robot>"#;
    /// let chain = Chain::from_urdf_string(xml, None, None, MissingLimits::Refuse)?;
    /// let bodies = chain.collision_from_urdf_string(xml, &[])?.bodies;
    /// assert_eq!(bodies[0].shape, CollisionShape::Sphere { radius: 0.05 });
    /// assert_eq!((bodies[0].name.as_str(), bodies[0].pose.translation.z), ("b", 0.1));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn collision_from_urdf_string(&self, xml: &str, posture: &[(String, f64)]) -> Result<CollisionModel> {
        urdf::with_tree(xml, |tree| {
            let version = Version::of(tree.robot);
            let carried = self.carried(tree, &self.positions(tree, posture)?, version)?;
            let bodied = tree.links.iter().filter(|(_, node)| element(*node, "collision").is_some()).count();
            if bodied > MAX_BODIED_LINKS {
                return Err(Error::OutOfRange {
                    what: "URDF: number of links with collision geometry".into(),
                    value: bodied as f64,
                    bound: format!("<= {MAX_BODIED_LINKS}"),
                });
            }
            let mut bodies = Vec::new();
            for ((name, node), carrier) in tree.links.iter().zip(&carried) {
                let Some((link, at)) = carrier else { continue };
                for collision in elements(*node, "collision") {
                    let what = format!("link '{name}': collision");
                    let pose = at * origin(collision, &what, version)?;
                    let shape = shape(collision, &what)?;
                    if bodies.len() == MAX_BODIES {
                        return Err(bad(format!("more than {MAX_BODIES} collision bodies")));
                    }
                    bodies.push(CollisionBody { name: (*name).into(), link: *link, pose, shape });
                }
            }
            Ok(CollisionModel { bodies, neighbours: neighbours(tree) })
        })
    }

    /// For each link of the document the link of the chain that it is fixed to, and its pose in it.
    fn carried(
        &self,
        tree: &Tree<'_, '_>,
        positions: &[f64],
        version: Version,
    ) -> Result<Vec<Option<(usize, Pose)>>> {
        let mut carried = vec![None; tree.links.len()];
        let mut open = VecDeque::new();
        for (i, (name, _)) in tree.links.iter().enumerate() {
            if let Some(link) = self.links().iter().position(|known| known.name == *name) {
                carried[i] = Some((link, Pose::identity()));
                open.push_back(i);
            }
        }
        // Many robots have a link "base": alone it does not make the document that of this chain.
        let known = |i: &usize| carried[*i].is_some_and(|(link, _)| self.links()[link].joints_before > 0);
        if !open.iter().any(known) {
            let names: Vec<&str> = self.links().iter().map(|link| link.name.as_str()).collect();
            return Err(bad(format!(
                "no moving link of '{}' is in the URDF: {}",
                self.name(),
                names.join(", ")
            )));
        }
        let own: HashSet<&str> = self.joints().iter().map(|joint| joint.name.as_str()).collect();
        while let Some(link) = open.pop_front() {
            let Some((carrier, at)) = carried[link] else { continue };
            let down = tree.below[link].iter().map(|joint| (*joint, tree.joints[*joint].child, false));
            let up = tree.above[link].iter().map(|joint| (*joint, tree.joints[*joint].parent, true));
            for (joint, next, upwards) in down.chain(up) {
                if carried[next].is_some() || own.contains(tree.joints[joint].name) {
                    continue;
                }
                let step = motion(&tree.joints[joint], positions[joint], version)?;
                let pose = if upwards { at * step.inverse() } else { at * step };
                carried[next] = Some((carrier, pose));
                open.push_back(next);
            }
        }
        Ok(carried)
    }

    /// Positions of the joints of the document; those of the chain's are not used.
    fn positions(&self, tree: &Tree<'_, '_>, posture: &[(String, f64)]) -> Result<Vec<f64>> {
        let own = |name: &str| self.joints().iter().any(|joint| joint.name == name);
        let index: HashMap<&str, usize> = tree.joints.iter().enumerate().map(|(i, j)| (j.name, i)).collect();
        let mut given: HashMap<usize, f64> = HashMap::new();
        for (name, value) in posture {
            crate::error::check_finite(&format!("posture of joint '{name}'"), &[*value])?;
            match index.get(name.as_str()) {
                Some(_) if own(name) => {
                    return Err(Error::Invalid(format!(
                        "joint '{name}' moves with the chain, the posture is that of the other joints"
                    )));
                }
                Some(joint) => given.insert(*joint, *value),
                None => {
                    let outside = tree.joints.iter().filter(|j| j.kind != "fixed" && !own(j.name));
                    let valid = outside.map(|j| j.name.to_owned()).collect();
                    return Err(Error::UnknownName { kind: "joint", name: name.clone(), valid });
                }
            };
        }
        let mut out = vec![0.0; tree.joints.len()];
        for (i, out) in out.iter_mut().enumerate() {
            // A joint that mimics: that of another one, times a factor, plus an offset.
            let (mut at, mut factor, mut offset) = (i, 1.0, 0.0);
            for _ in 0..=tree.joints.len() {
                let node = tree.joints[at].node;
                let mimic = element(node, "mimic").filter(|_| !given.contains_key(&at));
                let Some(mimic) = mimic.filter(|_| !own(tree.joints[at].name)) else { break };
                let what = format!("joint '{}': mimic", tree.joints[at].name);
                let value = |name: &str, missing: f64| -> Result<f64> {
                    let words = numbers::<1>(mimic, name, &what)?;
                    Ok(words.map_or(Ok([missing]), |words| parse(&words, &what))?[0])
                };
                let other = attribute(mimic, "joint", &what)?;
                let Some(next) = index.get(other) else {
                    return Err(bad(format!("{what} names the unknown joint '{other}'")));
                };
                if own(other) {
                    return Err(bad(format!(
                        "{what} follows '{other}', which moves with the chain; give its position in the posture"
                    )));
                }
                (offset, factor) =
                    (offset + factor * value("offset", 0.0)?, factor * value("multiplier", 1.0)?);
                at = *next;
            }
            let value = given.get(&at).copied().map_or_else(|| neutral(&tree.joints[at]), Ok)?;
            *out = factor * value + offset;
        }
        Ok(out)
    }
}

#[cfg(feature = "urdf")]
/// The position nearest to 0 within the limits of a joint.
fn neutral(joint: &JointNode) -> Result<f64> {
    let Some(limit) = element(joint.node, "limit").filter(|_| joint.kind != "continuous") else {
        return Ok(0.0);
    };
    let value = |name: &str, missing: f64| {
        limit
            .attribute(name)
            .and_then(|word| word.trim().parse::<f64>().ok())
            .filter(|x| !x.is_nan())
            .unwrap_or(missing)
    };
    let (lower, upper) = (value("lower", 0.0), value("upper", 0.0));
    let zero = if lower > 0.0 { lower } else { upper.min(0.0) };
    if lower > upper || !zero.is_finite() {
        return Err(Error::InvertedLimits { joint: joint.name.into(), lower, upper });
    }
    Ok(zero)
}

#[cfg(feature = "urdf")]
/// From the child of a joint at a position to its parent.
fn motion(joint: &JointNode, position: f64, version: Version) -> Result<Pose> {
    let what = format!("joint '{}'", joint.name);
    let at = origin(joint.node, &what, version)?;
    if !matches!(joint.kind, "revolute" | "continuous" | "prismatic") || position == 0.0 {
        return Ok(at);
    }
    let words = match element(joint.node, "axis") {
        Some(axis) => numbers::<3>(axis, "xyz", &format!("{what}: axis"))?,
        None => None,
    };
    let axis = Vector3::from(words.map_or(Ok([1.0, 0.0, 0.0]), |words| parse(&words, &what))?);
    let Some(axis) = Unit::try_new(axis, 0.0) else { return Err(bad(format!("{what}: axis has no length"))) };
    Ok(if joint.kind == "prismatic" {
        at * Pose::from_parts((axis.into_inner() * position).into(), Rotation3::identity())
    } else {
        at * Pose::from_parts(Vector3::zeros().into(), Rotation3::from_axis_angle(&axis, position))
    })
}

#[cfg(feature = "urdf")]
/// Links with bodies that a joint connects, or joints over links without.
fn neighbours(tree: &Tree<'_, '_>) -> Vec<[String; 2]> {
    let bodied: Vec<bool> =
        tree.links.iter().map(|(_, node)| element(*node, "collision").is_some()).collect();
    let beside = |link: usize| {
        let down = tree.below[link].iter().map(|joint| tree.joints[*joint].child);
        down.chain(tree.above[link].map(|joint| tree.joints[joint].parent))
    };
    let mut out = Vec::new();
    for link in (0..tree.links.len()).filter(|link| bodied[*link]) {
        let (mut seen, mut open) = (HashSet::from([link]), vec![link]);
        while let Some(at) = open.pop() {
            for next in beside(at) {
                if !seen.insert(next) {
                    continue;
                }
                if !bodied[next] {
                    open.push(next);
                } else if link < next {
                    out.push([tree.links[link].0.to_owned(), tree.links[next].0.to_owned()]);
                }
            }
        }
    }
    out
}

#[cfg(feature = "urdf")]
/// The pose in `<origin>`; the identity without one.
fn origin(node: Node, what: &str, version: Version) -> Result<Pose> {
    let Some(element) = element(node, "origin") else { return Ok(Pose::identity()) };
    let what = format!("{what}: origin");
    let values = |name: &str| -> Result<[f64; 3]> {
        numbers::<3>(element, name, &what)?.map_or(Ok([0.0; 3]), |words| parse(&words, &what))
    };
    placed(values("xyz")?, values("rpy")?, node, &what, version)
}

#[cfg(feature = "urdf")]
fn shape(collision: Node, what: &str) -> Result<CollisionShape> {
    let geometry = element(collision, "geometry").ok_or_else(|| bad(format!("{what} has no <geometry>")))?;
    let Some(node) = geometry.children().find(Node::is_element) else {
        return Err(bad(format!("{what}: <geometry> is empty")));
    };
    let tag = node.tag_name().name();
    let what = format!("{what}: {tag}");
    let size = |name: &str| -> Result<f64> {
        attribute(node, name, &what)?;
        let words = numbers::<1>(node, name, &what)?;
        let [value] = words.map_or(Ok([0.0]), |words| parse(&words, &what))?;
        positive(&format!("{what} {name}"), value)
    };
    match tag {
        "sphere" => Ok(CollisionShape::Sphere { radius: size("radius")? }),
        "cylinder" => Ok(CollisionShape::Cylinder { radius: size("radius")?, length: size("length")? }),
        "capsule" => Ok(CollisionShape::Capsule { radius: size("radius")?, length: size("length")? }),
        "box" => {
            attribute(node, "size", &what)?;
            let words = numbers::<3>(node, "size", &what)?;
            let edges = words.map_or(Ok([0.0; 3]), |words| parse(&words, &what))?;
            for edge in edges {
                positive(&format!("{what} size"), edge)?;
            }
            Ok(CollisionShape::Box { half_extents: edges.map(|edge| 0.5 * edge) })
        }
        "mesh" => {
            let file = attribute(node, "filename", &what)?.trim().to_owned();
            let words = numbers::<3>(node, "scale", &what)?;
            let scale = words.map_or(Ok([1.0; 3]), |words| parse(&words, &what))?;
            if let Some(value) = scale.iter().find(|x| **x == 0.0) {
                let what = format!("{what} scale");
                return Err(Error::OutOfRange { what, value: *value, bound: "not 0".into() });
            }
            Ok(CollisionShape::Mesh { file, scale })
        }
        other => {
            let valid = "sphere, cylinder, capsule, box or mesh";
            Err(bad(format!("{what}: unknown geometry '{other}', expected {valid}")))
        }
    }
}

#[cfg(feature = "urdf")]
fn positive(what: &str, value: f64) -> Result<f64> {
    if value > 0.0 {
        return Ok(value);
    }
    Err(Error::OutOfRange { what: what.into(), value, bound: "> 0 m".into() })
}
