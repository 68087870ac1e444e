//! Primitive collision geometry of a URDF: spheres, cylinders, capsules and boxes of the links of a chain.

#[cfg(feature = "urdf")]
use std::collections::{HashSet, VecDeque};
#[cfg(feature = "urdf")]
use std::path::Path;

#[cfg(feature = "urdf")]
use roxmltree::Node;

use super::chain::Chain;
#[cfg(feature = "urdf")]
use super::urdf::{self, Tree, Version, attribute, bad, element, elements, numbers, parse, placed};
use crate::error::{Error, Result};
use crate::pose::Pose;

/// The shape of a collision body, in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

/// A collision body of a link that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionBody {
    /// Index of its link in [`Chain::links`]; a body on a link that is fixed to it belongs to it too.
    pub link: usize,
    /// Its pose in the frame of that link.
    pub pose: Pose,
    /// Its shape.
    pub shape: CollisionShape,
}

#[cfg(feature = "urdf")]
impl Chain {
    /// The primitive collision geometry that a URDF file gives to the moving links of this chain, which was read from it
    /// (or has links of the same names).
    ///
    /// # Errors
    /// A file that cannot be read, and everything that [`Chain::collision_from_urdf_string`] refuses.
    pub fn collision_from_urdf(&self, path: impl AsRef<Path>) -> Result<Vec<CollisionBody>> {
        let xml = urdf::read_file(path.as_ref())?;
        self.collision_from_urdf_string(&xml).map_err(|error| urdf::in_file(path.as_ref(), error))
    }

    /// The primitive collision geometry that the text of a URDF gives to the moving links of this chain.
    ///
    /// Links that are fixed to a link of the chain count as part of it; what does not move with a joint of the chain is left
    /// out.
    ///
    /// # Errors
    /// Text that [`Chain::from_urdf_string`] refuses as a document; none of its links in the chain; a collision geometry
    /// that is a mesh, unknown or missing, sizes that are not positive: the message names the link.
    ///
    /// ```
    /// use redundancy_core::chain::{Chain, CollisionShape, MissingLimits};
    /// let xml = r#"<robot name="r"> <link name="a"/>
    ///   <link name="b"><collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.05"/></geometry></collision></link>
    ///   <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
    /// </robot>"#;
    /// let chain = Chain::from_urdf_string(xml, None, None, MissingLimits::Refuse)?;
    /// let bodies = chain.collision_from_urdf_string(xml)?;
    /// assert_eq!(bodies[0].shape, CollisionShape::Sphere { radius: 0.05 });
    /// assert_eq!((chain.links()[bodies[0].link].name.as_str(), bodies[0].pose.translation.z), ("b", 0.1));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn collision_from_urdf_string(&self, xml: &str) -> Result<Vec<CollisionBody>> {
        urdf::with_tree(xml, |tree| {
            let version = Version::of(tree.robot);
            let mut out = Vec::new();
            let mut known = HashSet::new();
            for link in 0..tree.links.len() {
                let Some((on, at)) = self.carrier(tree, link, version)? else { continue };
                if self.links()[on].joints_before == 0 {
                    continue;
                }
                known.insert(on);
                let (name, node) = tree.links[link];
                for collision in elements(node, "collision") {
                    let what = format!("link '{name}': collision");
                    let pose = at * origin(collision, &what, version)?;
                    out.push(CollisionBody { link: on, pose, shape: shape(collision, &what)? });
                }
            }
            if known.is_empty() {
                let moving = self.links().iter().filter(|link| link.joints_before > 0);
                let names: Vec<&str> = moving.map(|link| link.name.as_str()).collect();
                return Err(bad(format!(
                    "no moving link of '{}' is in the URDF: {}",
                    self.name(),
                    names.join(", ")
                )));
            }
            Ok(out)
        })
    }

    /// The link of the chain that a link of the document is or is fixed to, above or below it, and its pose in it.
    fn carrier(&self, tree: &Tree<'_, '_>, link: usize, version: Version) -> Result<Option<(usize, Pose)>> {
        // The pose of the link in the links fixed to it, nearest first; upwards before downwards.
        let (mut open, mut known) = (VecDeque::from([(link, Pose::identity())]), HashSet::from([link]));
        while let Some((link, at)) = open.pop_front() {
            let name = tree.links[link].0;
            if let Some(on) = self.links().iter().position(|known| known.name == name) {
                return Ok(Some((on, at)));
            }
            for joint in tree.above[link].iter().chain(&tree.below[link]) {
                let joint = &tree.joints[*joint];
                let upwards = joint.child == link;
                let beyond = if upwards { joint.parent } else { joint.child };
                if joint.kind != "fixed" || !known.insert(beyond) {
                    continue;
                }
                let origin = origin(joint.node, &format!("joint '{}'", joint.name), version)?;
                open.push_back((beyond, if upwards { origin * at } else { origin.inv_mul(&at) }));
            }
        }
        Ok(None)
    }
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
        "mesh" => Err(bad(format!(
            "{what}: meshes are not read, only sphere, cylinder, capsule and box; give the links a radius instead"
        ))),
        other => {
            Err(bad(format!("{what}: unknown geometry '{other}', expected sphere, cylinder, capsule or box")))
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
