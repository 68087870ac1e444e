//! Chains from URDF, the robot description format of ROS.
//!
//! The way from a base link to a tip link becomes a [`Chain`]: `revolute`, `continuous` and `prismatic` joints move,
//! `fixed` joints are folded into the placements, everything beside the way is left out. Numbers are used as they
//! are, never snapped to right angles or round lengths.
//!
//! # Up and down the tree
//! The base need not be an ancestor of the tip: the chain runs from the base up to their common ancestor and down to
//! the tip (from the top of a turntable to a tool, from one hand to the other). A joint of the document takes its
//! parent to its child by `O M(a, q)`, with the origin `O` and the motion `M` about or along the axis `a`. Crossed
//! from child to parent it is the inverse, `M(a, q)^-1 O^-1 = M(-a, q) O^-1`: a joint at the frame of the child, with
//! the opposite axis and the same `q`, followed by `O^-1`. So every joint keeps its name, the sign of its position
//! and its limits, whichever way it is crossed. Each body goes with the joint that comes before it on the way.
//!
//! # What the format leaves open
//! - A missing `<origin>` is the identity, a missing `<axis>` is x, missing `lower` and `upper` in a `<limit>` are 0
//!   (no limit in URDF 1.2). A velocity or effort of 0 means that there is none.
//! - A revolute or prismatic joint without `<limit>` is refused by name, or has no limits on demand
//!   ([`MissingLimits`]).
//! - `mimic`, `floating` and `planar` joints on the way are refused by name: their motion is not one free coordinate.
//! - The inertia of a moving body is that of its link and of all links fixed to it, also beside the way and above it.
//!   What hangs on further moving joints beside the way (the fingers of a gripper) is not counted.
//!
//! # Safety
//! A file is untrusted. roxmltree reads the document first: it does not recurse, and it refuses document type
//! definitions, so neither entities nor external files are ever expanded. Size, attributes and namespaces are
//! bounded before that. `urdf-rs` gets a rewritten document with nothing but the links and joints in question,
//! numbers that were checked, and indices for names: given the original, it recurses over the nesting of the
//! document, refuses a whole file for a detail that no chain needs (a visual without geometry), skips words that
//! are no numbers, and cannot tell a missing `<limit>` from one at zero.

use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::builder::ChainBuilder;
use super::chain::Chain;
use super::joint::{Inertia, JointKind, Limits};
use crate::error::{Error, Result};
use crate::pose::{Pose, pose};
use crate::tolerance::{QUATERNION_NORM, URDF_ATTRIBUTES, URDF_BYTES, URDF_NAMESPACES, URDF_NODES};

/// What to do with a revolute or prismatic joint without `<limit>`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MissingLimits {
    /// Refuse it by name.
    #[default]
    Refuse,
    /// Take it as a joint without limits.
    Unbounded,
}

impl Chain {
    /// A chain from a URDF file, from link `base` to link `tip`, over their common ancestor.
    ///
    /// `base` may be left out when there is one root (or one above `tip`), `tip` when there is one leaf (below
    /// `base`).
    ///
    /// # Errors
    /// A file that cannot be read, and everything that [`Chain::from_urdf_string`] refuses.
    pub fn from_urdf(
        path: impl AsRef<Path>,
        base: Option<&str>,
        tip: Option<&str>,
        missing_limits: MissingLimits,
    ) -> Result<Self> {
        let xml = read_file(path.as_ref())?;
        Self::from_urdf_string(&xml, base, tip, missing_limits).map_err(|error| in_file(path.as_ref(), error))
    }

    /// A chain from the text of a URDF, from link `base` to link `tip` (see [`Chain::from_urdf`]).
    ///
    /// # Errors
    /// Text that is not well-formed XML or has a document type definition; a root other than `<robot>`; an unknown
    /// link (the message lists the names); no common ancestor of `base` and `tip` (the message names both roots); a link with two parents; a cycle; joints on
    /// the way that mimic, float or move in a plane; names used twice; missing or inverted limits; numbers that are
    /// missing, broken or not finite; an axis without length.
    ///
    /// ```
    /// use redundancy_core::chain::{Chain, MissingLimits};
    /// let xml = r#"<robot name="slider">
    ///   <link name="rail"/> <link name="carriage"/>
    ///   <joint name="x" type="prismatic">
    ///     <parent link="rail"/> <child link="carriage"/> <origin xyz="0 0 1"/>
    ///     <limit lower="0" upper="2" velocity="0.5" effort="0"/>
    ///   </joint>
    /// </robot>"#;
    /// let slider = Chain::from_urdf_string(xml, None, None, MissingLimits::Refuse)?;
    /// let p = slider.forward(&[0.25])?.translation;
    /// assert_eq!((p.x, p.y, p.z), (0.25, 0.0, 1.0));
    /// assert_eq!(slider.joints()[0].limits.effort, f64::INFINITY);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn from_urdf_string(
        xml: &str,
        base: Option<&str>,
        tip: Option<&str>,
        missing_limits: MissingLimits,
    ) -> Result<Self> {
        with_tree(xml, |tree| {
            let way = tree.way(base, tip)?;
            let selection = Selection::new(tree, way, missing_limits)?;
            let robot = urdf_rs::read_from_string(&selection.rewritten(tree)?)
                .map_err(|error| bad(format!("urdf-rs refuses it: {error}")))?;
            selection.assemble(tree, &robot)
        })
    }
}

/// The text of a URDF file.
pub(super) fn read_file(path: &Path) -> Result<String> {
    let broken = |message: String| Error::File { file: path.display().to_string(), message };
    let mut bytes = Vec::new();
    std::fs::File::open(path)
        .and_then(|f| f.take(URDF_BYTES as u64 + 1).read_to_end(&mut bytes))
        .map_err(|error| broken(error.to_string()))?;
    String::from_utf8(bytes).map_err(|e| broken(format!("not UTF-8: {}", e.utf8_error())))
}

/// The error with the file's name in front.
pub(super) fn in_file(path: &Path, error: Error) -> Error {
    match error {
        Error::Description(message) => Error::Description(format!("{}: {message}", path.display())),
        other => other,
    }
}

/// Parses the text of a URDF and hands its links and joints on.
pub(super) fn with_tree<T>(xml: &str, read: impl FnOnce(&Tree<'_, '_>) -> Result<T>) -> Result<T> {
    // Blank lines before the XML declaration are against the standard and common.
    let xml = xml.trim_start_matches('\u{feff}').trim_start();
    guard(xml)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: URDF_NODES, ..Default::default() };
    let document = Document::parse_with_options(xml, options).map_err(|error| match error {
        roxmltree::Error::DtdDetected => {
            bad("document type definitions (<!DOCTYPE ...>, entities) are refused; remove it")
        }
        other => bad(format!("not well-formed XML: {other}")),
    })?;
    read(&Tree::read(&document)?)
}

pub(super) fn bad(message: impl Into<String>) -> Error {
    Error::Description(message.into())
}

/// Bounds what the parser's cost depends on more than linearly.
fn guard(xml: &str) -> Result<()> {
    let check = |what: &str, value: usize, bound: usize| {
        if value <= bound {
            return Ok(());
        }
        Err(Error::OutOfRange {
            what: format!("URDF: {what}"),
            value: value as f64,
            bound: format!("<= {bound}"),
        })
    };
    check("number of bytes", xml.len(), URDF_BYTES)?;
    check("number of namespace declarations", xml.matches("xmlns").count(), URDF_NAMESPACES)?;
    let mut attributes = 0;
    let mut equals = false;
    for byte in xml.bytes() {
        match byte {
            b'<' => (attributes, equals) = (0, false),
            b'=' => equals = true,
            b'"' | b'\'' if equals => {
                attributes += 1;
                equals = false;
                check("number of attributes of one element", attributes, URDF_ATTRIBUTES)?;
            }
            b' ' | b'\t' | b'\r' | b'\n' => {}
            _ => equals = false,
        }
    }
    Ok(())
}

/// The links and joints of a document, by index, and how they hang together.
pub(super) struct Tree<'a, 'x> {
    pub robot: Node<'a, 'x>,
    pub links: Vec<(&'a str, Node<'a, 'x>)>,
    pub joints: Vec<JointNode<'a, 'x>>,
    /// For each link the joint above it.
    pub above: Vec<Option<usize>>,
    /// For each link the joints below it.
    pub below: Vec<Vec<usize>>,
}

pub(super) struct JointNode<'a, 'x> {
    pub name: &'a str,
    pub kind: &'a str,
    pub parent: usize,
    pub child: usize,
    pub node: Node<'a, 'x>,
}

impl<'a, 'x: 'a> Tree<'a, 'x> {
    fn read(document: &'a Document<'x>) -> Result<Self> {
        let robot = document.root_element();
        if robot.tag_name().name() != "robot" {
            return Err(bad(format!("the root element is <{}>, expected <robot>", robot.tag_name().name())));
        }
        let mut links = Vec::new();
        let mut index = HashMap::new();
        for (i, node) in elements(robot, "link").enumerate() {
            let name = attribute(node, "name", &format!("link {i} (counted from 0)"))?;
            if index.insert(name, i).is_some() {
                return Err(bad(format!("link name '{name}' is used twice")));
            }
            links.push((name, node));
        }
        if links.is_empty() {
            return Err(bad(format!("<robot> has no <link>{}", xacro_hint(robot))));
        }
        let mut joints = Vec::new();
        let (mut above, mut below) = (vec![None; links.len()], vec![Vec::new(); links.len()]);
        for (i, node) in elements(robot, "joint").enumerate() {
            let name = attribute(node, "name", &format!("joint {i} (counted from 0)"))?;
            let what = format!("joint '{name}'");
            let kind = attribute(node, "type", &what)?;
            let end = |tag: &str| {
                let node = element(node, tag).ok_or_else(|| bad(format!("{what} has no <{tag}>")))?;
                let link = attribute(node, "link", &format!("{what}: <{tag}>"))?;
                index.get(link).copied().ok_or_else(|| {
                    let valid: Vec<&str> = links.iter().map(|(name, _)| *name).collect();
                    let valid = valid.join(", ");
                    bad(format!("{what}: <{tag}> names the unknown link '{link}', expected one of: {valid}"))
                })
            };
            let (parent, child) = (end("parent")?, end("child")?);
            if let Some(other) = above[child].replace(i) {
                let JointNode { name: other, .. } = &joints[other];
                return Err(bad(format!(
                    "link '{}' is the child of two joints, '{other}' and '{name}'",
                    links[child].0
                )));
            }
            below[parent].push(i);
            joints.push(JointNode { name, kind, parent, child, node });
        }
        Ok(Self { robot, links, joints, above, below })
    }

    /// The joints from `base` up to the common ancestor and down to `tip`.
    fn way(&self, base: Option<&str>, tip: Option<&str>) -> Result<Vec<Crossing>> {
        let base = base.map(|name| self.link(name)).transpose()?;
        let tip = tip.map(|name| self.link(name)).transpose()?;
        let (base, tip) = match (base, tip) {
            (base, Some(tip)) => (base, tip),
            (Some(base), None) => (Some(base), self.only_leaf_below(base)?),
            (None, None) => {
                let base = self.only_root()?;
                (Some(base), self.only_leaf_below(base)?)
            }
        };
        if base == Some(tip) {
            let hint = xacro_hint(self.robot);
            return Err(bad(format!("base and tip are the same link '{}'{hint}", self.links[tip].0)));
        }
        let mut down = self.joints_above(tip)?;
        let Some(base) = base else {
            return Ok(down.into_iter().rev().map(|joint| Crossing { joint, upwards: false }).collect());
        };
        let mut up = self.joints_above(base)?;
        let root = |link: usize, joints: &[usize]| joints.last().map_or(link, |j| self.joints[*j].parent);
        let roots = (root(base, &up), root(tip, &down));
        if roots.0 != roots.1 {
            let [base, tip, first, second] = [base, tip, roots.0, roots.1].map(|link| self.links[link].0);
            return Err(bad(format!(
                "no way from base '{base}' to tip '{tip}': they have no common ancestor, the root above '{base}' is \
                 '{first}', the root above '{tip}' is '{second}'"
            )));
        }
        while up.last().is_some() && up.last() == down.last() {
            up.pop();
            down.pop();
        }
        let up = up.into_iter().map(|joint| Crossing { joint, upwards: true });
        let down = down.into_iter().rev().map(|joint| Crossing { joint, upwards: false });
        Ok(up.chain(down).collect())
    }

    /// The joints from a link to its root.
    fn joints_above(&self, link: usize) -> Result<Vec<usize>> {
        let (mut joints, mut at) = (Vec::new(), link);
        while let Some(joint) = self.above[at] {
            if joints.len() == self.links.len() {
                return Err(bad(format!("the joints above link '{}' form a cycle", self.links[link].0)));
            }
            joints.push(joint);
            at = self.joints[joint].parent;
        }
        Ok(joints)
    }

    fn link(&self, name: &str) -> Result<usize> {
        self.links.iter().position(|(known, _)| *known == name).ok_or_else(|| Error::UnknownName {
            kind: "link",
            name: name.into(),
            valid: self.links.iter().map(|(known, _)| String::from(*known)).collect(),
        })
    }

    fn only_root(&self) -> Result<usize> {
        let roots: Vec<usize> = (0..self.links.len()).filter(|link| self.above[*link].is_none()).collect();
        match roots[..] {
            [root] => Ok(root),
            [] => Err(bad("every link is the child of a joint: the joints form a cycle")),
            _ => Err(bad(format!("base is needed, there are several roots: {}", self.names(&roots)))),
        }
    }

    fn only_leaf_below(&self, base: usize) -> Result<usize> {
        let (mut leaves, mut seen, mut open) = (Vec::new(), HashSet::new(), vec![base]);
        while let Some(link) = open.pop() {
            if !seen.insert(link) {
                continue;
            }
            if self.below[link].is_empty() {
                leaves.push(link);
            }
            open.extend(self.below[link].iter().map(|joint| self.joints[*joint].child));
        }
        leaves.sort_unstable();
        match leaves[..] {
            [leaf] if leaf == base => {
                let (name, hint) = (self.links[base].0, xacro_hint(self.robot));
                Err(bad(format!(
                    "no link is below base '{name}': name the tip to which the chain leads{hint}"
                )))
            }
            [leaf] => Ok(leaf),
            [] => Err(bad(format!("the joints below link '{}' form a cycle", self.links[base].0))),
            _ => Err(bad(format!("tip is needed, there are several leaves: {}", self.names(&leaves)))),
        }
    }

    fn names(&self, links: &[usize]) -> String {
        let names: Vec<&str> = links.iter().map(|link| self.links[*link].0).collect();
        names.join(", ")
    }
}

/// Asks about a document whose elements belong to another vocabulary.
fn xacro_hint(robot: Node) -> &'static str {
    let xacro = robot.children().any(|n| n.is_element() && n.tag_name().namespace().is_some());
    if xacro { "; is it a xacro that must be expanded first?" } else { "" }
}

/// A joint on the way, and the direction in which it is crossed.
#[derive(Clone, Copy)]
struct Crossing {
    joint: usize,
    /// From child to parent.
    upwards: bool,
}

impl Crossing {
    /// The links before and after it.
    fn ends(self, tree: &Tree) -> (usize, usize) {
        let JointNode { parent, child, .. } = tree.joints[self.joint];
        if self.upwards { (child, parent) } else { (parent, child) }
    }
}

/// What of a document makes the chain, checked.
struct Selection {
    /// How many of the joints lead from base to tip; the rest carries what is fixed to the moving bodies.
    on_way: usize,
    /// Joints and links that are handed to urdf-rs, in this order; the joint with index i leads to the link i + 1.
    joints: Vec<Crossing>,
    links: Vec<usize>,
    /// Per joint of the way: whether it has a `<limit>`.
    limited: Vec<bool>,
}

impl Selection {
    fn new(tree: &Tree, way: Vec<Crossing>, missing_limits: MissingLimits) -> Result<Self> {
        let mut names = HashSet::new();
        let mut limited = Vec::with_capacity(way.len());
        for crossing in &way {
            let joint = &tree.joints[crossing.joint];
            if !names.insert(joint.name) {
                return Err(bad(format!("joint name '{}' is used twice in the chain", joint.name)));
            }
            limited.push(check_joint(joint, missing_limits)?);
        }
        // The bodies: links on the way, and whatever is fixed to those that move, above or below.
        let mut links: Vec<usize> = way.first().map(|crossing| crossing.ends(tree).0).into_iter().collect();
        links.extend(way.iter().map(|crossing| crossing.ends(tree).1));
        let mut known: HashSet<usize> = links.iter().copied().collect();
        let mut joints = way.clone();
        let fixed = |crossing: &Crossing| tree.joints[crossing.joint].kind == "fixed";
        let standing = way.iter().take_while(|crossing| fixed(crossing)).count();
        let mut next = standing + 1;
        while let Some(link) = links.get(next).copied() {
            next += 1;
            let below = tree.below[link].iter().map(|joint| Crossing { joint: *joint, upwards: false });
            let above = tree.above[link].map(|joint| Crossing { joint, upwards: true });
            for crossing in below.chain(above).filter(fixed) {
                let beyond = crossing.ends(tree).1;
                if known.insert(beyond) {
                    joints.push(crossing);
                    links.push(beyond);
                }
            }
        }
        Ok(Self { on_way: way.len(), joints, links, limited })
    }

    /// The selection as a small URDF with indices for names and numbers that are known to parse.
    fn rewritten(&self, tree: &Tree) -> Result<String> {
        let version = Version::of(tree.robot);
        let mut out = format!("<robot name=\"chain\" version=\"{}.{}\">", version.0, version.1);
        for (i, link) in self.links.iter().enumerate() {
            let (name, node) = tree.links[*link];
            let _ = write!(out, "<link name=\"{i}\">");
            if let Some(inertial) = element(node, "inertial") {
                rewrite_inertial(&mut out, inertial, &format!("link '{name}'"), version)?;
            }
            out.push_str("</link>");
        }
        let position: HashMap<usize, usize> =
            self.links.iter().enumerate().map(|(i, link)| (*link, i)).collect();
        for (i, crossing) in self.joints.iter().enumerate() {
            let JointNode { name, kind, parent, child, node } = &tree.joints[crossing.joint];
            let what = format!("joint '{name}'");
            let end = |link| position.get(link).copied().unwrap_or_default();
            let _ = write!(
                out,
                "<joint name=\"{i}\" type=\"{kind}\"><parent link=\"{}\"/><child link=\"{}\"/>",
                end(parent),
                end(child)
            );
            rewrite_origin(&mut out, *node, &what, version)?;
            if *kind != "fixed" {
                if let Some(axis) = element(*node, "axis") {
                    let xyz = numbers::<3>(axis, "xyz", &format!("{what}: axis"))?;
                    write_attributes(&mut out, "axis", &[("xyz", xyz)]);
                }
                if let Some(limit) = element(*node, "limit") {
                    rewrite_limit(&mut out, limit, name, kind, version)?;
                }
            }
            out.push_str("</joint>");
        }
        out.push_str("</robot>");
        Ok(out)
    }

    fn assemble(&self, tree: &Tree, robot: &urdf_rs::Robot) -> Result<Chain> {
        let parsed = (robot.links.len(), robot.joints.len());
        if parsed != (self.links.len(), self.joints.len()) {
            return Err(bad(format!(
                "urdf-rs found {} links and {} joints, expected {} and {}",
                parsed.0,
                parsed.1,
                self.links.len(),
                self.joints.len()
            )));
        }
        let version = Version::of(tree.robot);
        let base = self.links.first().map_or("", |link| tree.links[*link].0);
        let name = tree.robot.attribute("name").unwrap_or("robot");
        let mut builder = ChainBuilder::new(name, base);
        // Per link of the selection: how many joints move it, and its pose in the frame that they move.
        let mut placed = vec![(0, Pose::identity()); self.links.len()];
        let mut moving = 0;
        for (i, crossing) in self.joints.iter().enumerate() {
            let JointNode { name, node, .. } = &tree.joints[crossing.joint];
            let parsed = &robot.joints[i];
            let ends = |link: &str| link.parse::<usize>().ok().filter(|link| *link < placed.len());
            let (Some(parent), Some(child)) = (ends(&parsed.parent.link), ends(&parsed.child.link)) else {
                return Err(bad(format!("urdf-rs lost the links of joint '{name}'")));
            };
            let (from, to) = if crossing.upwards { (child, parent) } else { (parent, child) };
            let (before, carry) = placed[from];
            let origin = transform(&parsed.origin, *node, version)?;
            let axis = Vector3::from(*parsed.axis.xyz);
            // Placement, axis, and what follows the motion.
            let (at, axis, after) = match crossing.upwards {
                false => (carry * origin, axis, Pose::identity()),
                // Subtracted from zero, so that no entry becomes -0.
                true => (carry, Vector3::zeros() - axis, origin.inverse()),
            };
            let kind = match parsed.joint_type {
                urdf_rs::JointType::Revolute => Some(JointKind::Revolute),
                urdf_rs::JointType::Continuous => Some(JointKind::Continuous),
                urdf_rs::JointType::Prismatic => Some(JointKind::Prismatic),
                _ => None,
            };
            placed[to] = match kind {
                None => (before, at * after),
                Some(kind) => {
                    moving += 1;
                    let limits = limits(&parsed.limit, kind, self.limited.get(i) == Some(&true));
                    builder = builder.joint(*name, kind, at, axis, limits);
                    (moving, after)
                }
            };
            if i < self.on_way {
                builder = builder.link(tree.links[self.links[to]].0, placed[to].1);
            }
        }
        // Bodies: everything that moves with a joint, seen from the frame that it moves.
        let mut bodies = vec![Inertia::ZERO; moving];
        let mut any = false;
        for ((link, parsed), (before, offset)) in self.links.iter().zip(&robot.links).zip(&placed) {
            let inertial = element(tree.links[*link].1, "inertial");
            if let (Some(node), Some(body)) = (inertial, before.checked_sub(1)) {
                any = true;
                let at = offset * transform(&parsed.inertial.origin, node, version)?;
                bodies[body] = bodies[body].combined(&inertia(&parsed.inertial).moved(&at));
            }
        }
        if any {
            builder = builder.inertias(bodies);
        }
        builder.build()
    }
}

/// Refuses what a chain cannot have on its way; whether the joint has a `<limit>`.
fn check_joint(joint: &JointNode, missing_limits: MissingLimits) -> Result<bool> {
    let JointNode { name, kind, node, .. } = joint;
    match *kind {
        "revolute" | "continuous" | "prismatic" | "fixed" => {}
        "floating" | "planar" | "spherical" => {
            return Err(bad(format!("joint '{name}' is {kind}: a chain has joints with one freedom only")));
        }
        other => {
            let valid = "revolute, continuous, prismatic, fixed";
            return Err(bad(format!(
                "joint '{name}' has the unknown type '{other}', expected one of: {valid}"
            )));
        }
    }
    if *kind != "fixed" && element(*node, "mimic").is_some() {
        return Err(bad(format!("joint '{name}' mimics another joint: it cannot be moved by itself")));
    }
    let limit = element(*node, "limit");
    if limit.is_none() && matches!(*kind, "revolute" | "prismatic") && missing_limits == MissingLimits::Refuse
    {
        return Err(bad(format!(
            "joint '{name}' is {kind} but has no <limit>; ask for missing_limits=\"unbounded\" to take it without \
             limits"
        )));
    }
    Ok(limit.is_some())
}

/// Version of the format; missing or malformed is 1.0, as in urdfdom.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub(super) struct Version(u32, u32);

impl Version {
    pub fn of(robot: Node) -> Self {
        let parse = |text: &str| {
            let (major, minor) = text.trim().split_once('.')?;
            Some(Self(major.parse().ok()?, minor.parse().ok()?))
        };
        robot.attribute("version").and_then(parse).unwrap_or(Self(1, 0))
    }
}

pub(super) type Tokens<'a, const N: usize> = Option<[&'a str; N]>;

fn rewrite_origin(out: &mut String, node: Node, what: &str, version: Version) -> Result<()> {
    let Some(origin) = element(node, "origin") else { return Ok(()) };
    let what = format!("{what}: origin");
    let xyz = numbers::<3>(origin, "xyz", &what)?;
    let rpy = numbers::<3>(origin, "rpy", &what)?;
    out.push_str("<origin");
    write_attribute(out, "xyz", &xyz);
    write_attribute(out, "rpy", &rpy);
    if rpy.is_some() && quaternion(node, &what, version)?.is_some() {
        return Err(bad(format!("{what} has both rpy and quat_xyzw")));
    }
    out.push_str("/>");
    Ok(())
}

/// The rotation of `<origin quat_xyzw>`, since URDF 1.1. Not left to urdf-rs, which makes angles of it and loses up
/// to 4e-3 rad where the pitch is near 90 deg.
fn quaternion(node: Node, what: &str, version: Version) -> Result<Option<UnitQuaternion<f64>>> {
    let Some(origin) = element(node, "origin").filter(|_| version >= Version(1, 1)) else { return Ok(None) };
    let Some(words) = numbers::<4>(origin, "quat_xyzw", what)? else { return Ok(None) };
    let [x, y, z, w] = parse(&words, what)?;
    let q = Quaternion::new(w, x, y, z);
    let norm = q.norm();
    if (norm - 1.0).abs() > QUATERNION_NORM {
        return Err(Error::NotUnit { what: format!("{what} quat_xyzw"), norm, tolerance: QUATERNION_NORM });
    }
    Ok(Some(UnitQuaternion::from_quaternion(q)))
}

fn rewrite_limit(out: &mut String, limit: Node, joint: &str, kind: &str, version: Version) -> Result<()> {
    let what = format!("joint '{joint}': limit");
    let value = |name: &str| -> Result<Option<(&str, f64)>> {
        let Some(text) = limit.attribute(name).map(str::trim) else { return Ok(None) };
        // An infinite limit is no limit; only NaN makes no sense.
        match text.parse::<f64>() {
            Ok(value) if !value.is_nan() => Ok(Some((text, value))),
            _ => Err(bad(format!("{what}: {name} is '{text}', it must be a number"))),
        }
    };
    out.push_str("<limit");
    let mut ends = [None, None];
    if kind != "continuous" {
        let unset = if version >= Version(1, 2) { [f64::NEG_INFINITY, f64::INFINITY] } else { [0.0, 0.0] };
        ends = [value("lower")?, value("upper")?];
        let [lower, upper] = [0, 1].map(|i| ends[i].map_or(unset[i], |(_, value)| value));
        if lower > upper {
            return Err(Error::InvertedLimits { joint: joint.into(), lower, upper });
        }
    }
    for (name, end) in ["lower", "upper"].into_iter().zip(ends) {
        write_attribute(out, name, &end.map(|(text, _)| [text]));
    }
    for name in ["velocity", "effort", "acceleration"] {
        let given = if name == "acceleration" && version < Version(1, 2) { None } else { value(name)? };
        match given {
            Some((_, value)) if value < 0.0 => {
                let what = format!("joint '{joint}': {name} limit");
                return Err(Error::OutOfRange { what, value, bound: ">= 0 (0 for none)".into() });
            }
            Some((text, _)) => write_attribute(out, name, &Some([text])),
            // urdf-rs insists on this one before URDF 1.2; 0 means none.
            None if name == "velocity" => out.push_str(" velocity=\"0\""),
            None => {}
        }
    }
    out.push_str("/>");
    Ok(())
}

fn rewrite_inertial(out: &mut String, node: Node, what: &str, version: Version) -> Result<()> {
    let part =
        |tag: &str| element(node, tag).ok_or_else(|| bad(format!("{what}: <inertial> has no <{tag}>")));
    let required = |node: Node<'_, '_>, tag: &str, name: &str| -> Result<f64> {
        let what = format!("{what}: {tag}");
        let text = attribute(node, name, &what)?;
        let [value] = parse(&[text.trim()], &format!("{what} {name}"))?;
        Ok(value)
    };
    out.push_str("<inertial>");
    rewrite_origin(out, node, &format!("{what}: inertial"), version)?;
    let mass = required(part("mass")?, "mass", "value")?;
    if mass < 0.0 {
        return Err(Error::OutOfRange { what: format!("{what}: mass"), value: mass, bound: ">= 0".into() });
    }
    // Rust prints the shortest decimal that reads back as the same double.
    let _ = write!(out, "<mass value=\"{mass}\"/><inertia");
    for name in ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"] {
        let value = required(part("inertia")?, "inertia", name)?;
        let _ = write!(out, " {name}=\"{value}\"");
    }
    out.push_str("/></inertial>");
    Ok(())
}

fn write_attributes(out: &mut String, tag: &str, attributes: &[(&str, Tokens<'_, 3>)]) {
    let _ = write!(out, "<{tag}");
    for (name, tokens) in attributes {
        write_attribute(out, name, tokens);
    }
    out.push_str("/>");
}

fn write_attribute<const N: usize>(out: &mut String, name: &str, tokens: &Tokens<'_, N>) {
    if let Some(tokens) = tokens {
        let _ = write!(out, " {name}=\"{}\"", tokens.join(" "));
    }
}

/// The words of an attribute, known to be `N` finite numbers.
pub(super) fn numbers<'a, const N: usize>(
    node: Node<'a, '_>,
    name: &str,
    what: &str,
) -> Result<Tokens<'a, N>> {
    let Some(text) = node.attribute(name) else { return Ok(None) };
    let words: Vec<&str> = text.split_whitespace().take(N + 1).collect();
    let Ok(words) = <[&str; N]>::try_from(words) else {
        return Err(bad(format!("{what} {name} is '{text}', expected {N} numbers")));
    };
    parse(&words, &format!("{what} {name}"))?;
    Ok(Some(words))
}

pub(super) fn parse<const N: usize>(words: &[&str; N], what: &str) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        *value = word.parse().map_err(|_| bad(format!("{what}: '{word}' is not a number")))?;
    }
    crate::error::check_finite(what, &values)?;
    Ok(values)
}

/// The first child element with this name; elements of other vocabularies have a namespace.
pub(super) fn element<'a, 'x>(node: Node<'a, 'x>, name: &str) -> Option<Node<'a, 'x>> {
    node.children().find(|n| is(*n, name, node))
}

pub(super) fn elements<'a, 'x: 'a>(
    node: Node<'a, 'x>,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'x>> {
    node.children().filter(move |n| is(*n, name, node))
}

fn is(node: Node, name: &str, parent: Node) -> bool {
    node.is_element()
        && node.tag_name().name() == name
        && node.tag_name().namespace() == parent.tag_name().namespace()
}

pub(super) fn attribute<'a>(node: Node<'a, '_>, name: &str, what: &str) -> Result<&'a str> {
    match node.attribute(name) {
        Some(value) if !value.is_empty() => Ok(value),
        Some(_) => Err(bad(format!("{what}: {name} is empty"))),
        None => Err(bad(format!("{what} has no {name}"))),
    }
}

fn limits(limit: &urdf_rs::JointLimit, kind: JointKind, given: bool) -> Limits {
    if !given {
        return Limits::NONE;
    }
    let none_if_zero = |value: f64| if value == 0.0 { f64::INFINITY } else { value };
    let (lower, upper) = match kind {
        JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
        _ => (limit.lower, limit.upper),
    };
    Limits {
        lower,
        upper,
        velocity: none_if_zero(limit.velocity),
        acceleration: none_if_zero(limit.acceleration),
        effort: none_if_zero(limit.effort),
    }
}

/// `R = Rz(yaw) Ry(pitch) Rx(roll)`, or that of the quaternion.
pub(super) fn placed(
    xyz: [f64; 3],
    [roll, pitch, yaw]: [f64; 3],
    node: Node,
    what: &str,
    version: Version,
) -> Result<Pose> {
    let rotation = match quaternion(node, what, version)? {
        Some(q) => q.to_rotation_matrix(),
        None => Rotation3::from_euler_angles(roll, pitch, yaw),
    };
    Ok(pose(*rotation.matrix(), Vector3::from(xyz)))
}

/// The same from what urdf-rs has read.
fn transform(origin: &urdf_rs::Pose, node: Node, version: Version) -> Result<Pose> {
    placed(*origin.xyz, *origin.rpy, node, "origin", version)
}

/// The body in its own frame: axes of `<inertial><origin>`, at the centre of mass.
fn inertia(inertial: &urdf_rs::Inertial) -> Inertia {
    let i = &inertial.inertia;
    let tensor = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    Inertia { mass: inertial.mass.value, center_of_mass: Vector3::zeros(), tensor, rotor: 0.0 }
}
