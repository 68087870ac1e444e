//! Denavit-Hartenberg rows, both conventions.
//!
//! Standard (distal): `T_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`, the joint axis is z of frame i-1.
//! Modified (proximal, Craig): `T_i = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`, the joint axis is z of frame i.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Vector3};

use super::builder::ChainBuilder;
use super::joint::{JointKind, Limits};
use crate::pose::{Pose, pose};

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
    ///
    /// ```
    /// use redundancy_core::chain::{ChainBuilder, DhConvention, DhRow};
    /// let rows = [DhRow { a: 0.3, d: 0.0, alpha: std::f64::consts::FRAC_PI_2, theta: 0.0 }; 2];
    /// let arm = ChainBuilder::from_dh("arm", &rows, DhConvention::Standard).build()?;
    /// assert_eq!(arm.forward(&[0.0, 0.0])?.translation.x, 0.6);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn from_dh(name: &str, rows: &[DhRow], convention: DhConvention) -> Self {
        let mut builder = Self::new(name, "base");
        let mut placement = Pose::identity();
        for (i, row) in rows.iter().enumerate() {
            builder.expect_finite(
                &format!("D-H row {i} (a, d, alpha, theta)"),
                &[row.a, row.d, row.alpha, row.theta],
            );
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

/// Rotation by `angle` about a coordinate axis.
fn rotation(axis: Vector3<f64>, angle: f64) -> Pose {
    let (sin, cos) = sin_cos_exact(angle);
    let k = axis.cross_matrix();
    let rotation = Matrix3::identity() + k * sin + k * k * (1.0 - cos);
    pose(rotation, Vector3::zeros())
}

fn translation(x: f64, z: f64) -> Pose {
    pose(Matrix3::identity(), Vector3::new(x, 0.0, z))
}

/// Sine and cosine, exact (0 and +-1) at the doubles that stand for whole quarter turns.
///
/// The double nearest to pi/2 has cosine 6e-17. In a table of D-H rows it means a right angle, and axes that meet
/// at right angles are what closed forms look for.
fn sin_cos_exact(angle: f64) -> (f64, f64) {
    let quarters = (angle / FRAC_PI_2).round();
    if quarters.abs() > 4.0 || quarters * FRAC_PI_2 != angle {
        return angle.sin_cos();
    }
    match quarters as i64 & 3 {
        0 => (0.0, 1.0),
        1 => (1.0, 0.0),
        2 => (0.0, -1.0),
        _ => (-1.0, 0.0),
    }
}
