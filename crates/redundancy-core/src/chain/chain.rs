//! The immutable chain and its compiled form.

use std::fmt;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::joint::{Inertia, Joint, JointKind, Limits};
use crate::error::{Error, Result, check_vector};
use crate::pose::{Pose, pose};

/// A row of moving joints from base to tip, with limits, inertias, base and tool transforms.
///
/// Immutable and cheap to clone; every `with_...` returns a new chain.
///
/// ```
/// use redundancy_core::chain::{ChainBuilder, DhConvention, DhRow};
/// let row = |a| DhRow { a, d: 0.0, alpha: 0.0, theta: 0.0 };
/// let arm = ChainBuilder::from_dh("two bars", &[row(1.0), row(0.5)], DhConvention::Standard).build()?;
/// assert_eq!(arm.dof(), 2);
/// assert!((arm.forward(&[0.0, 0.0])?.translation.x - 1.5).abs() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Clone)]
pub struct Chain {
    inner: Arc<Inner>,
}

#[derive(Clone)]
struct Inner {
    name: String,
    joints: Vec<Joint>,
    links: Vec<Link>,
    inertias: Option<Vec<Inertia>>,
    base: Pose,
    tool: Pose,
    steps: Vec<Step>,
    bodies: Option<Vec<Body>>,
    end: (Matrix3<f64>, Vector3<f64>),
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// A named frame on the chain.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Its name, unique in the chain.
    pub name: String,
    /// How many joints move it: 0 for links fixed to the base.
    pub joints_before: usize,
    /// Its pose in the frame that those joints move.
    pub offset: Pose,
}

/// One joint in compiled form: placement, then motion about or along z.
///
/// The joint axis is turned onto z once, here, so that a step of the forward pass is one constant matrix and a
/// plane rotation of two columns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
    pub rotational: bool,
}

/// Mass properties of the body after a joint in compiled form: about the origin of the frame whose z is the joint axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Body {
    pub mass: f64,
    /// Mass times centre of mass.
    pub moment: Vector3<f64>,
    /// Second moment `int x x^T dm`; the inertia tensor is `trace(second) 1 - second`.
    pub second: Matrix3<f64>,
    /// Inertia of the rotor seen at the joint.
    pub rotor: f64,
}

impl Chain {
    /// Only for [`ChainBuilder::build`](super::ChainBuilder::build), which has validated everything.
    pub(super) fn assemble(
        name: String,
        joints: Vec<Joint>,
        links: Vec<Link>,
        inertias: Option<Vec<Inertia>>,
        base: Pose,
        tool: Pose,
    ) -> Self {
        let inner = Inner {
            name,
            joints,
            links,
            inertias,
            base,
            tool,
            steps: Vec::new(),
            bodies: None,
            end: (Matrix3::identity(), Vector3::zeros()),
            lower: Vec::new(),
            upper: Vec::new(),
        };
        Self { inner: Arc::new(inner.compiled()) }
    }

    /// The robot's name.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Number of moving joints.
    pub fn dof(&self) -> usize {
        self.inner.joints.len()
    }

    /// Whether `other` has the same joints in the same places: only limits, base, tool, links and inertias may differ.
    pub(crate) fn has_joints_of(&self, other: &Self) -> bool {
        let same = |(a, b): (&Joint, &Joint)| {
            a.name == b.name
                && a.kind.is_rotational() == b.kind.is_rotational()
                && a.axis == b.axis
                && a.placement == b.placement
        };
        Arc::ptr_eq(&self.inner, &other.inner)
            || (self.dof() == other.dof() && self.joints().iter().zip(other.joints()).all(same))
    }

    /// The joints from base to tip.
    pub fn joints(&self) -> &[Joint] {
        &self.inner.joints
    }

    /// The named frames from base to tip.
    pub fn links(&self) -> &[Link] {
        &self.inner.links
    }

    /// Mass properties of the bodies that the joints move, one per joint, in the frame after the joint;
    /// `None` where the description has none.
    pub fn inertias(&self) -> Option<&[Inertia]> {
        self.inner.inertias.as_deref()
    }

    /// Pose of the first link in the world.
    pub fn base(&self) -> &Pose {
        &self.inner.base
    }

    /// Pose of the tool in the frame of the last link.
    pub fn tool(&self) -> &Pose {
        &self.inner.tool
    }

    /// Lower position limits, rad or m, `-inf` for none.
    pub fn lower(&self) -> &[f64] {
        &self.inner.lower
    }

    /// Upper position limits, rad or m, `inf` for none.
    pub fn upper(&self) -> &[f64] {
        &self.inner.upper
    }

    /// The same arm with another tool after its last link; replaces an earlier tool.
    ///
    /// # Errors
    /// None for a valid pose; the signature leaves room for validation of the caller's numbers.
    pub fn with_tool(&self, tool: Pose) -> Result<Self> {
        let tool = crate::pose::checked_pose("tool", &tool)?;
        Ok(self.changed(|inner| inner.tool = tool))
    }

    /// The same arm mounted elsewhere; replaces an earlier base.
    ///
    /// # Errors
    /// A pose with entries that are not finite or not orthonormal.
    pub fn with_base(&self, base: Pose) -> Result<Self> {
        let base = crate::pose::checked_pose("base", &base)?;
        Ok(self.changed(|inner| inner.base = base))
    }

    /// The same arm with other limits, one entry per joint. A continuous joint that gets a position limit is
    /// revolute from then on.
    ///
    /// # Errors
    /// Wrong length, inverted or NaN limits, velocity, acceleration or effort that is not positive.
    pub fn with_limits(&self, limits: &[Limits]) -> Result<Self> {
        if limits.len() != self.dof() {
            return Err(Error::Length { what: "limits".into(), expected: self.dof(), actual: limits.len() });
        }
        for (joint, limit) in self.joints().iter().zip(limits) {
            limit.validate(&joint.name)?;
        }
        Ok(self.changed(|inner| {
            for (joint, limit) in inner.joints.iter_mut().zip(limits) {
                joint.limits = *limit;
                if joint.kind == JointKind::Continuous && (limit.lower.is_finite() || limit.upper.is_finite())
                {
                    joint.kind = JointKind::Revolute;
                }
            }
        }))
    }

    /// Only for callers that have validated the bodies, one per joint.
    pub(super) fn with_inertias(&self, inertias: Vec<Inertia>) -> Self {
        self.changed(|inner| inner.inertias = Some(inertias))
    }

    /// Index of a named frame.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn link_index(&self, name: &str) -> Result<usize> {
        self.links().iter().position(|l| l.name == name).ok_or_else(|| Error::UnknownName {
            kind: "link",
            name: name.into(),
            valid: self.links().iter().map(|l| l.name.clone()).collect(),
        })
    }

    /// Checks a joint vector: one finite entry per joint.
    ///
    /// # Errors
    /// Wrong length or an entry that is not finite.
    pub fn check_q(&self, q: &[f64]) -> Result<()> {
        check_vector("q", q, self.dof())
    }

    /// True when every joint of `q` is within its position limits, widened by `slack`.
    pub fn within_limits(&self, q: &[f64], slack: f64) -> bool {
        q.len() == self.dof()
            && q.iter()
                .zip(self.lower())
                .zip(self.upper())
                .all(|((q, lo), hi)| *q >= lo - slack && *q <= hi + slack)
    }

    pub(crate) fn steps(&self) -> &[Step] {
        &self.inner.steps
    }

    /// Compiled mass properties, one per joint.
    pub(crate) fn bodies(&self) -> Option<&[Body]> {
        self.inner.bodies.as_deref()
    }

    /// Transform from the frame after the last step to the tool.
    pub(crate) fn end(&self) -> (&Matrix3<f64>, &Vector3<f64>) {
        (&self.inner.end.0, &self.inner.end.1)
    }

    fn changed(&self, change: impl FnOnce(&mut Inner)) -> Self {
        let mut inner = (*self.inner).clone();
        change(&mut inner);
        Self { inner: Arc::new(inner.compiled()) }
    }
}

impl Inner {
    /// Recomputes what follows from the description.
    fn compiled(mut self) -> Self {
        self.lower = self.joints.iter().map(|j| j.limits.lower).collect();
        self.upper = self.joints.iter().map(|j| j.limits.upper).collect();
        self.steps.clear();
        // `carry` takes from the frame after the previous step to the frame that its joint moves.
        let mut carry = self.base;
        for joint in &self.joints {
            let to_z = axis_onto_z(&joint.axis);
            let placement = carry * joint.placement;
            self.steps.push(Step {
                rotation: placement.rotation.matrix() * to_z,
                translation: placement.translation.vector,
                rotational: joint.kind.is_rotational(),
            });
            carry = pose(to_z.transpose(), Vector3::zeros());
        }
        let body = |(joint, inertia): (&Joint, &Inertia)| {
            let to_z = axis_onto_z(&joint.axis);
            let center = to_z.tr_mul(&inertia.center_of_mass);
            let tensor = to_z.tr_mul(&inertia.tensor) * to_z;
            let second = Matrix3::identity() * (0.5 * tensor.trace()) - tensor;
            Body {
                mass: inertia.mass,
                moment: center * inertia.mass,
                second: second + center * center.transpose() * inertia.mass,
                rotor: inertia.rotor,
            }
        };
        self.bodies = self.inertias.as_ref().map(|list| self.joints.iter().zip(list).map(body).collect());
        let tip = self.links.last().map_or_else(Pose::identity, |l| l.offset);
        let end = carry * tip * self.tool;
        self.end = (*end.rotation.matrix(), end.translation.vector);
        self
    }
}

/// Rotation whose third column is `axis`. Exact (entries 0 and +-1) for the coordinate axes.
pub(crate) fn axis_onto_z(axis: &Vector3<f64>) -> Matrix3<f64> {
    let z = *axis;
    // The coordinate axis least aligned with z, for a well conditioned cross product.
    let helper = match z.iamin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let y = z.cross(&helper).normalize();
    let x = y.cross(&z);
    if (z - Vector3::z()).norm() == 0.0 {
        return Matrix3::identity();
    }
    Matrix3::from_columns(&[x, y, z])
}

impl PartialEq for Chain {
    fn eq(&self, other: &Self) -> bool {
        let (a, b) = (&*self.inner, &*other.inner);
        Arc::ptr_eq(&self.inner, &other.inner)
            || (a.name == b.name
                && a.joints == b.joints
                && a.links == b.links
                && a.inertias == b.inertias
                && a.base == b.base
                && a.tool == b.tool)
    }
}

impl fmt::Debug for Chain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Chain")
            .field("name", &self.name())
            .field("joints", &self.joints())
            .finish_non_exhaustive()
    }
}
