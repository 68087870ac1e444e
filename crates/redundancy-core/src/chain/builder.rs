//! Joints one by one, checked when the chain is built.

use std::collections::HashSet;

use nalgebra::{Unit, Vector3};

use super::chain::{Chain, Link};
use super::joint::{Inertia, Joint, JointKind, Limits};
use crate::error::{Error, Result, check_finite};
use crate::pose::{Pose, checked_pose};
use crate::tolerance::{DIRECTION_NORM, UNIT_AXIS};

/// Collects joints and links from base to tip; [`build`](Self::build) checks them all.
///
/// ```
/// use redundancy_core::chain::{ChainBuilder, JointKind, Limits};
/// use redundancy_core::{Pose, nalgebra::Vector3};
/// let slider = ChainBuilder::new("slider", "world")
///     .joint("x", JointKind::Prismatic, Pose::identity(), Vector3::x(), Limits { lower: 0., upper: 1., ..Limits::NONE })
///     .link("carriage", Pose::identity())
///     .build()?;
/// assert_eq!(slider.forward(&[0.25])?.translation.x, 0.25);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ChainBuilder {
    name: String,
    joints: Vec<Pending>,
    links: Vec<Link>,
    inertias: Option<Vec<Inertia>>,
    base: Pose,
    tool: Pose,
    /// The first mistake that a method noticed; `build` reports it.
    mistake: Option<Error>,
}

#[derive(Debug, Clone)]
struct Pending {
    name: String,
    kind: JointKind,
    placement: Pose,
    axis: Vector3<f64>,
    limits: Limits,
}

impl ChainBuilder {
    /// An empty chain whose first frame is called `base_link`.
    pub fn new(name: impl Into<String>, base_link: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            joints: Vec::new(),
            links: vec![Link { name: base_link.into(), joints_before: 0, offset: Pose::identity() }],
            inertias: None,
            base: Pose::identity(),
            tool: Pose::identity(),
            mistake: None,
        }
    }

    /// Adds a joint. `placement` is the joint frame at `q = 0` in the frame that the previous joint moves.
    #[must_use]
    pub fn joint(
        mut self,
        name: impl Into<String>,
        kind: JointKind,
        placement: Pose,
        axis: Vector3<f64>,
        limits: Limits,
    ) -> Self {
        self.joints.push(Pending { name: name.into(), kind, placement, axis, limits });
        self
    }

    /// Names a frame after the last joint added. `offset` is its pose in the frame that this joint moves.
    #[must_use]
    pub fn link(mut self, name: impl Into<String>, offset: Pose) -> Self {
        self.links.push(Link { name: name.into(), joints_before: self.joints.len(), offset });
        self
    }

    /// Mass properties of the moved bodies, one per joint, in the frame that the joint moves.
    #[must_use]
    pub fn inertias(mut self, inertias: Vec<Inertia>) -> Self {
        self.inertias = Some(inertias);
        self
    }

    /// Mass properties of the moved bodies, one per joint, each in the frame of the first link named after it
    /// (the frame of the row for a chain from Denavit-Hartenberg rows). A wrong count is reported by `build`.
    #[must_use]
    pub fn link_inertias(mut self, inertias: &[Inertia]) -> Self {
        self.expect_count("inertias", inertias.len());
        let frame = |joint| self.links.iter().find(|l| l.joints_before == joint + 1).map(|l| l.offset);
        let moved = inertias.iter().enumerate().map(|(i, inertia)| match frame(i) {
            Some(offset) => inertia.moved(&offset),
            None => *inertia,
        });
        self.inertias = Some(moved.collect());
        self
    }

    /// Limits of all joints, in order; replaces earlier ones. A wrong count is reported by `build`.
    #[must_use]
    pub fn limits(mut self, limits: &[Limits]) -> Self {
        self.expect_count("limits", limits.len());
        for (joint, limit) in self.joints.iter_mut().zip(limits) {
            joint.limits = *limit;
        }
        self
    }

    /// Names of all joints, in order; replaces earlier ones. A wrong count is reported by `build`.
    #[must_use]
    pub fn joint_names<S: Into<String>>(mut self, names: impl IntoIterator<Item = S>) -> Self {
        let names: Vec<String> = names.into_iter().map(Into::into).collect();
        self.expect_count("joint names", names.len());
        for (joint, name) in self.joints.iter_mut().zip(names) {
            joint.name = name;
        }
        self
    }

    /// Names of all links so far, base first; replaces earlier ones. A wrong count is reported by `build`.
    #[must_use]
    pub fn link_names<S: Into<String>>(mut self, names: impl IntoIterator<Item = S>) -> Self {
        let names: Vec<String> = names.into_iter().map(Into::into).collect();
        if names.len() != self.links.len() && self.mistake.is_none() {
            let (expected, actual) = (self.links.len(), names.len());
            self.mistake = Some(Error::Length { what: "link names".into(), expected, actual });
        }
        for (link, name) in self.links.iter_mut().zip(names) {
            link.name = name;
        }
        self
    }

    /// Notes the first number that is not finite.
    pub(super) fn expect_finite(&mut self, what: &str, values: &[f64]) {
        if self.mistake.is_none() {
            self.mistake = check_finite(what, values).err();
        }
    }

    fn expect_count(&mut self, what: &str, actual: usize) {
        let expected = self.joints.len();
        if actual != expected && self.mistake.is_none() {
            self.mistake = Some(Error::Length { what: what.into(), expected, actual });
        }
    }

    /// Pose of the base link in the world.
    #[must_use]
    pub fn base(mut self, base: Pose) -> Self {
        self.base = base;
        self
    }

    /// Pose of the tool in the frame of the last link.
    #[must_use]
    pub fn tool(mut self, tool: Pose) -> Self {
        self.tool = tool;
        self
    }

    /// Checks everything and compiles the chain.
    ///
    /// # Errors
    /// No joint, a name used twice, an axis without length, a placement that is not rigid, limits that are
    /// inverted or NaN, inertias that are negative or too few. The message names the joint or link.
    pub fn build(self) -> Result<Chain> {
        if let Some(mistake) = self.mistake {
            return Err(mistake);
        }
        if self.joints.is_empty() {
            return Err(Error::Description(format!("'{}' has no moving joint", self.name)));
        }
        unique("joint", self.joints.iter().map(|j| &j.name))?;
        unique("link", self.links.iter().map(|l| &l.name))?;
        let base = checked_pose("base", &self.base)?;
        let tool = checked_pose("tool", &self.tool)?;
        let mut joints = Vec::with_capacity(self.joints.len());
        for Pending { name, kind, placement, axis, mut limits } in self.joints {
            let placement = checked_pose(&format!("placement of joint '{name}'"), &placement)?;
            let axis = checked_axis(&name, axis)?;
            if kind == JointKind::Continuous {
                (limits.lower, limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
            }
            limits.validate(&name)?;
            joints.push(Joint { name, kind, placement, axis, limits });
        }
        let mut links = self.links;
        for link in &mut links {
            link.offset = checked_pose(&format!("frame of link '{}'", link.name), &link.offset)?;
        }
        if let Some(inertias) = &self.inertias {
            if inertias.len() != joints.len() {
                let (expected, actual) = (joints.len(), inertias.len());
                return Err(Error::Length { what: "inertias".into(), expected, actual });
            }
            for (joint, inertia) in joints.iter().zip(inertias) {
                inertia.validate(&format!("after joint {}", joint.name))?;
            }
        }
        if links.last().is_none_or(|l| l.joints_before < joints.len()) {
            let name = format!("link{}", joints.len());
            links.push(Link { name, joints_before: joints.len(), offset: Pose::identity() });
        }
        Ok(Chain::assemble(self.name, joints, links, self.inertias, base, tool))
    }
}

fn checked_axis(joint: &str, axis: Vector3<f64>) -> Result<Unit<Vector3<f64>>> {
    check_finite(&format!("axis of joint '{joint}'"), axis.as_slice())?;
    let norm = axis.norm();
    // A unit axis stays as it is, to the bit: dividing once more could change its last digit.
    if (norm - 1.0).abs() <= UNIT_AXIS {
        return Ok(Unit::new_unchecked(axis));
    }
    Unit::try_new(axis, DIRECTION_NORM).ok_or_else(|| Error::ZeroDirection {
        what: format!("axis of joint '{joint}'"),
        norm,
        minimum: DIRECTION_NORM,
    })
}

fn unique<'a>(kind: &str, names: impl Iterator<Item = &'a String>) -> Result<()> {
    let mut seen = HashSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(Error::Description(format!("{kind} name '{name}' is used twice")));
        }
    }
    Ok(())
}
