//! One joint, its limits and the inertia of the body that it carries.

use nalgebra::{Matrix3, Unit, Vector3};

use crate::error::{Error, Result, check_finite};
use crate::pose::Pose;

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum JointKind {
    /// Turns about its axis between limits.
    Revolute,
    /// Turns about its axis without limits.
    Continuous,
    /// Slides along its axis.
    Prismatic,
}

impl JointKind {
    /// The kind in lower case, as URDF spells it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Revolute => "revolute",
            Self::Continuous => "continuous",
            Self::Prismatic => "prismatic",
        }
    }

    /// True for joints that turn.
    pub fn is_rotational(self) -> bool {
        !matches!(self, Self::Prismatic)
    }
}

/// What a joint may do. No limit is infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest position, rad or m; `-inf` for none.
    pub lower: f64,
    /// Highest position, rad or m; `inf` for none.
    pub upper: f64,
    /// Largest speed, rad/s or m/s; `inf` for none.
    pub velocity: f64,
    /// Largest acceleration, rad/s^2 or m/s^2; `inf` for none.
    pub acceleration: f64,
    /// Largest torque or force, N m or N; `inf` for none.
    pub effort: f64,
}

impl Limits {
    /// No limit at all.
    pub const NONE: Self = Self {
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        velocity: f64::INFINITY,
        acceleration: f64::INFINITY,
        effort: f64::INFINITY,
    };

    /// Checks order and signs; `joint` names the culprit in the message.
    pub(crate) fn validate(&self, joint: &str) -> Result<()> {
        if self.lower.is_nan() || self.upper.is_nan() {
            let value = if self.lower.is_nan() { self.lower } else { self.upper };
            return Err(out_of_range(joint, "position limit", value, "a number or infinite"));
        }
        if self.lower > self.upper {
            let (lower, upper) = (self.lower, self.upper);
            return Err(Error::InvertedLimits { joint: joint.into(), lower, upper });
        }
        if self.lower == f64::INFINITY {
            return Err(out_of_range(joint, "lower limit", self.lower, "below inf"));
        }
        if self.upper == f64::NEG_INFINITY {
            return Err(out_of_range(joint, "upper limit", self.upper, "above -inf"));
        }
        for (what, value) in [
            ("velocity limit", self.velocity),
            ("acceleration limit", self.acceleration),
            ("effort limit", self.effort),
        ] {
            if value.is_nan() || value <= 0.0 {
                return Err(out_of_range(joint, what, value, "> 0 (inf for none)"));
            }
        }
        Ok(())
    }
}

fn out_of_range(joint: &str, what: &str, value: f64, bound: &str) -> Error {
    Error::OutOfRange { what: format!("joint '{joint}': {what}"), value, bound: bound.into() }
}

/// One moving joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its name, unique in the chain.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Pose of the joint frame at `q = 0` in the frame that the previous joint moves (the base for the first).
    pub placement: Pose,
    /// Axis of motion in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// What it may do.
    pub limits: Limits,
}

/// Mass properties of the body that a joint moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass in kg.
    pub mass: f64,
    /// Centre of mass in the frame of the link, m.
    pub center_of_mass: Vector3<f64>,
    /// Inertia tensor at the centre of mass, axes of the link frame, kg m^2.
    pub tensor: Matrix3<f64>,
    /// Inertia of the rotor seen at the joint (gear ratio squared times motor inertia), kg m^2.
    pub rotor: f64,
}

impl Inertia {
    /// No mass.
    pub const ZERO: Self =
        Self { mass: 0.0, center_of_mass: Vector3::new(0.0, 0.0, 0.0), tensor: ZERO3, rotor: 0.0 };

    pub(crate) fn validate(&self, link: &str) -> Result<()> {
        check_finite(&format!("inertia of link '{link}'"), self.tensor.as_slice())?;
        check_finite(&format!("centre of mass of link '{link}'"), self.center_of_mass.as_slice())?;
        for (what, value) in [("mass", self.mass), ("rotor inertia", self.rotor)] {
            if !value.is_finite() || value < 0.0 {
                let what = format!("link '{link}': {what}");
                return Err(Error::OutOfRange { what, value, bound: "finite and >= 0".into() });
            }
        }
        Ok(())
    }

    /// The same body seen from a frame in which the link frame has pose `at`.
    pub(crate) fn moved(&self, at: &Pose) -> Self {
        let r = at.rotation.matrix();
        Self {
            center_of_mass: r * self.center_of_mass + at.translation.vector,
            tensor: r * self.tensor * r.transpose(),
            ..*self
        }
    }

    /// Both bodies as one; both in the same frame.
    pub(crate) fn combined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let rotor = self.rotor + other.rotor;
        if mass <= 0.0 {
            let (center_of_mass, tensor) = (self.center_of_mass, self.tensor + other.tensor);
            return Self { mass, center_of_mass, tensor, rotor };
        }
        let center_of_mass = (self.center_of_mass * self.mass + other.center_of_mass * other.mass) / mass;
        let about = |b: &Self| {
            let d = b.center_of_mass - center_of_mass;
            b.tensor + b.mass * (d.norm_squared() * Matrix3::identity() - d * d.transpose())
        };
        Self { mass, center_of_mass, tensor: about(self) + about(other), rotor }
    }
}

const ZERO3: Matrix3<f64> = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
