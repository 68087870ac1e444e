//! Recognising an arm of the Panda class from its axes alone.
//!
//! At `q = 0` the seven joint axes are lines in space. The arm is of this class when axes 1, 2, 3 meet in a point S at right
//! angles, axes 5 and 6 in a point W, and neither S nor W is on axis 4, nor W on axis 7 (such an arm is S-R-S). Everything else
//! is free: the other angles between the axes (but 5 and 6 are not parallel), the offsets of axis 4 from axes 3 and 5, the place
//! of axis 7 against axis 6, which way the axes point and where the joints have their zeros.
//!
//! Angles that a description rounds (1.5708 for a right angle) are used as they are. Points of meeting that rounding takes
//! apart are idealised, and directions of axis 3 that a rounded shoulder cannot take, next to its gimbal, are replaced by the
//! nearest: the bound on what that costs is the [`Defect`].

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::solutions::closed_form::lanes::Triangle;
use crate::solutions::closed_form::lines::{angle_between, angle_of, common_point, meeting, not_turning};
use crate::solutions::{AxisLine, Defect, distance_to_line, orthonormal};
use crate::tolerance::{AXES_PARALLEL, SRS_ANGLE, SRS_DISTANCE, SRS_ELBOW_RADIUS, UNIT_AXIS};

/// The ideal arm. All constants are those of `q = 0`.
#[derive(Debug, Clone)]
pub(super) struct PandaGeometry {
    /// S in the world.
    pub shoulder: Vector3<f64>,
    /// `[x, y, z]` in the world: z along axis 1, x along axis 1 x axis 2.
    pub base: Matrix3<f64>,
    /// Axis 2 between axes 1 and 3.
    pub shoulder_triangle: Triangle,
    /// Angle from axis 1 x axis 2 to axis 2 x axis 3 about axis 2.
    pub zero2: f64,
    /// Distances of S and W from axis 4, m.
    pub radii: [f64; 2],
    /// Coordinate of W less that of S along axis 4, m.
    pub step4: f64,
    /// The angle y from S to W about axis 4 is `q4 + zero4`.
    pub zero4: f64,
    /// From the frame of axis 4 (z along it, x from it to W) to `[axis 5, ., normal]`, the normal along axis 5 x axis 6.
    pub fore: Matrix3<f64>,
    /// From the frame `[x, y, z]` after axis 3 (z along it, x along axis 2 x axis 3) to that of axis 4, turned about axis 4
    /// by `zero4`: what is before `Rz(-y)`.
    pub upper: Matrix3<f64>,
    /// Cosine and sine of the angle between axes 5 and 6.
    pub bend: [f64; 2],
    /// From the frame of axis 7 (z along it, x from it to W) to `[axis 6, ., normal]`.
    pub hand: Matrix3<f64>,
    /// Distance of W from axis 7, m.
    pub offset7: f64,
    /// The frame of axis 7 in the tool frame.
    pub frame7_in_tool: Matrix3<f64>,
    /// Its origin, the point of axis 7 nearest to W, in the tool frame, m.
    pub origin7_in_tool: Vector3<f64>,
    /// Bound on the error of the idealisation.
    pub defect: Defect,
}

impl PandaGeometry {
    /// Reads the geometry off `chain`.
    ///
    /// # Errors
    /// [`Error::NotPandaClass`] with the condition that fails and by how much.
    pub fn recognise(chain: &Chain) -> Result<Self> {
        if chain.dof() != 7 {
            return not_panda(format!("'{}' has {} joints, 7 are needed", chain.name(), chain.dof()));
        }
        if let Some(reason) = not_turning(chain) {
            return not_panda(reason);
        }
        let (lines, home) = AxisLine::axes(chain)?;
        let [z1, z2, z3, z4, z5, z6, z7] = std::array::from_fn(|i| lines[i].direction);
        let (shoulder, center, defect) = centres(&lines, &home.translation.vector)?;
        let [from4, from7] = [3, 6].map(|i| lever(&lines[i], &center));
        let to4 = lever(&lines[3], &shoulder);
        for (what, axis, radius) in [("shoulder", 4, to4.norm()), ("wrist", 4, from4.norm())] {
            if radius < SRS_ELBOW_RADIUS {
                let mm = 1e3 * radius;
                return not_panda(format!("the {what} lies on axis {axis}, {mm:.6} mm away from it"));
            }
        }
        if from7.norm() < SRS_DISTANCE {
            let mm = 1e3 * from7.norm();
            return not_panda(format!("axis 7 passes the point where axes 5 and 6 meet at {mm:.6} mm"));
        }

        let x12 = z1.cross(&z2).normalize();
        let x23 = z2.cross(&z3).normalize();
        let base = Matrix3::from_columns(&[x12, z1.cross(&x12), z1]);
        let after3 = Matrix3::from_columns(&[x23, z3.cross(&x23), z3]);
        let x4 = from4.normalize();
        let frame4 = Matrix3::from_columns(&[x4, z4.cross(&x4), z4]);
        let s4 = frame4.tr_mul(&to4);
        let zero4 = -s4.y.atan2(s4.x);
        let normal = z5.cross(&z6).normalize();
        let frame5 = Matrix3::from_columns(&[z5, normal.cross(&z5), normal]);
        let frame6 = Matrix3::from_columns(&[z6, normal.cross(&z6), normal]);
        let x7 = from7.normalize();
        let frame7 = Matrix3::from_columns(&[x7, z7.cross(&x7), z7]);
        let (sin, cos) = zero4.sin_cos();
        let turn4 = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let rotation = home.rotation.matrix();
        Ok(Self {
            shoulder,
            base: orthonormal(&base),
            shoulder_triangle: Triangle::new(angle_of(&z1, &z2), angle_of(&z2, &z3)),
            zero2: z2.dot(&x12.cross(&x23)).atan2(x12.dot(&x23)),
            radii: [to4.norm(), from4.norm()],
            step4: (center - shoulder).dot(&z4),
            zero4,
            fore: orthonormal(&frame5.tr_mul(&frame4)),
            upper: orthonormal(&(turn4 * frame4.tr_mul(&after3))),
            bend: [z5.dot(&z6), z5.cross(&z6).norm()],
            hand: orthonormal(&frame6.tr_mul(&frame7)),
            offset7: from7.norm(),
            frame7_in_tool: orthonormal(&rotation.tr_mul(&frame7)),
            origin7_in_tool: home.inverse_transform_point(&(center - from7).into()).coords,
            defect,
        })
    }
}

/// S and W, and what it costs to let the axes meet in them; `tool` is the tool at `q = 0`.
fn centres(lines: &[AxisLine], tool: &Vector3<f64>) -> Result<(Vector3<f64>, Vector3<f64>, Defect)> {
    for (i, j) in [(0, 1), (1, 2)] {
        let off = (0.5 * PI - angle_between(&lines[i].direction, &lines[j].direction)).abs();
        if off > SRS_ANGLE {
            let (i, j, off) = (i + 1, j + 1, 1e3 * off);
            return not_panda(format!("axes {i} and {j} are {off:.3} mrad away from a right angle"));
        }
    }
    for (i, j) in [(0, 1), (1, 2), (4, 5)] {
        let apart = angle_between(&lines[i].direction, &lines[j].direction);
        if apart < AXES_PARALLEL {
            let (i, j, apart) = (i + 1, j + 1, 1e3 * apart);
            return not_panda(format!("axes {i} and {j} are only {apart:.3} mrad away from parallel"));
        }
        let gap = meeting(&lines[i], &lines[j]).1;
        if gap > SRS_DISTANCE {
            let (i, j, gap) = (i + 1, j + 1, 1e3 * gap);
            return not_panda(format!("axes {i} and {j} miss each other by {gap:.3} mm"));
        }
    }
    let apart = (meeting(&lines[0], &lines[1]).0 - meeting(&lines[1], &lines[2]).0).norm();
    if apart > SRS_DISTANCE {
        let mm = 1e3 * apart;
        return not_panda(format!("axes 1 and 3 cross axis 2 at points {mm:.3} mm apart"));
    }
    let Some(shoulder) = common_point(&lines[..3]) else {
        return not_panda("axes 1 to 3 are parallel".into());
    };
    let (center, gap) = meeting(&lines[4], &lines[5]);
    let misses: f64 = lines[..3].iter().map(|line| distance_to_line(&shoulder, line)).sum();
    // Directions of axis 3 that the angles of the shoulder leave out, in the gimbal: nothing for right angles.
    let angle = |i: usize, j: usize| angle_of(&lines[i].direction, &lines[j].direction);
    let (a, b) = (angle(0, 1), angle(1, 2));
    let orientation = (a - b).abs() + (PI - a - b).abs();
    let orientation = if orientation > UNIT_AXIS { orientation } else { 0.0 };
    let reach = (center - shoulder).norm() + (tool - center).norm();
    Ok((shoulder, center, Defect { position: misses + gap + orientation * reach, orientation }))
}

/// From a line to a point, perpendicular to the line.
fn lever(line: &AxisLine, point: &Vector3<f64>) -> Vector3<f64> {
    let d = point - line.point;
    d - line.direction * line.direction.dot(&d)
}

fn not_panda<T>(reason: String) -> Result<T> {
    Err(Error::NotPandaClass { reason })
}
