//! Denavit-Hartenberg rows, both conventions.
//!
//! Standard (distal): `T_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`, the joint axis is z of frame i-1.
//! Modified (proximal, Craig): `T_i = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`, the joint axis is z of frame i.

use nalgebra::{Rotation3, Translation3, Vector3};

use super::builder::ChainBuilder;
use super::joint::{JointKind, Limits};
use crate::pose::Pose;

/// One row: lengths in m, angles in rad; `theta` is the offset that is added to the joint angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DhRow {
    /// Distance along x.
    pub a: f64,
    /// Distance along z.
    pub d: f64,
    /// Twist about x.
    pub alpha: f64,
    /// Offset of the joint angle about z.
    pub theta: f64,
}

/// Which frame the rows describe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DhConvention {
    /// Distal: the frame sits at the far end of the link.
    Standard,
    /// Proximal (Craig): the frame sits on the joint.
    Modified,
}

impl ChainBuilder {
    /// A chain of revolute joints `joint1..n` and links `base, link1..n` without limits.
    /// Link frame `i` is the frame of row `i`; numbers that are not finite are reported by `build`.
    pub fn from_dh(name: &str, rows: &[DhRow], convention: DhConvention) -> Self {
        let mut builder = Self::new(name, "base");
        let mut placement = Pose::identity();
        for (i, row) in rows.iter().enumerate() {
            let about_z = rotation(Vector3::z(), row.theta) * translation(0.0, row.d);
            let about_x = rotation(Vector3::x(), row.alpha) * translation(row.a, 0.0);
            let (before, after) = match convention {
                DhConvention::Standard => (placement, about_z * about_x),
                DhConvention::Modified => (about_x * about_z, Pose::identity()),
            };
            builder = builder
                .joint(format!("joint{}", i + 1), JointKind::Revolute, before, Vector3::z(), Limits::NONE)
                .link(format!("link{}", i + 1), after);
            placement = after;
        }
        builder
    }
}

fn rotation(axis: Vector3<f64>, angle: f64) -> Pose {
    Pose::from_parts(Translation3::identity(), Rotation3::new(axis * angle))
}

fn translation(x: f64, z: f64) -> Pose {
    Pose::from_parts(Translation3::new(x, 0.0, z), Rotation3::identity())
}
