//! Recognising a six-joint arm with a spherical wrist from its axes alone.
//!
//! At `q = 0` the six joint axes are lines in space. The arm is of this kind when axes 4, 5, 6 meet in a point W with
//! right angles between neighbours, axes 2 and 3 are parallel, and axis 1 is perpendicular to them. Where axis 2
//! passes axis 1 (shoulder offset), how far W is from the plane of axis 1 (lateral offset), and whether axis 4 passes
//! through axis 3 (elbow offset) does not matter, nor which way the axes point and where the joints have their zeros.

use nalgebra::{Matrix3, Vector3};

use super::complex::{Complex, complex};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::joint_space::wrap;
use crate::solutions::{AxisLine, Defect, distance_to_line, orthonormal, rotation_y, spherical};
use crate::tolerance::{SRS_ANGLE, SRS_DISTANCE, SRS_ELBOW_RADIUS};

/// The ideal arm. Joint 1 turns the plane of the arm, spanned by `e` and `k`; in that plane, with complex coordinates
/// `k + i e`, a turn about `m` by `x` multiplies by `exp(i x)`.
#[derive(Debug, Clone)]
pub(super) struct WristGeometry {
    /// A point on axis 1, world.
    pub origin: Vector3<f64>,
    /// `[e, m, k]` in the world: k along axis 1, m along axis 2 (up to its sign), e = m x k.
    pub frame: Matrix3<f64>,
    /// Where axis 2 crosses the plane of the arm.
    pub shoulder: Complex,
    /// Coordinate of the wrist centre along m.
    pub lateral: f64,
    /// Distance of axes 2 and 3, m.
    pub upper_arm: f64,
    /// Distance of the wrist centre from axis 3, m.
    pub forearm: f64,
    /// Direction of the forearm at `q = 0`.
    pub fore_home: Complex,
    /// Wrist centre in the tool frame, m.
    pub wrist_in_tool: Vector3<f64>,
    /// From the forearm at `q = 0` (axes `e, m, k`) to the frame whose ZYZ angles are joints 4..6; transposed.
    pub wrist_frame: Matrix3<f64>,
    /// From the tool to the frame in which these ZYZ angles end.
    pub tool_offset: Matrix3<f64>,
    /// `q_i = sign_i * angle_i + zero_i`.
    pub sign: [f64; 6],
    /// See `sign`; each in `(-pi, pi]`.
    pub zero: [f64; 6],
    /// Bound on the error of the idealisation.
    pub defect: Defect,
}

impl WristGeometry {
    /// Direction of e at the value `q` of joint 1.
    #[inline(always)]
    pub fn first_direction(&self, q: f64) -> Complex {
        let (sin, cos) = (self.sign[0] * (q - self.zero[0])).sin_cos();
        complex(cos, sin)
    }

    /// Reads the geometry off `chain`.
    ///
    /// # Errors
    /// [`Error::NotSphericalWrist`] with the condition that fails and by how much.
    pub fn recognise(chain: &Chain) -> Result<Self> {
        if chain.dof() != 6 {
            return not_wrist(format!("'{}' has {} joints, 6 are needed", chain.name(), chain.dof()));
        }
        if let Some(joint) = chain.joints().iter().find(|j| !j.kind.is_rotational()) {
            return not_wrist(format!(
                "joint '{}' is {}, all joints must be revolute",
                joint.name,
                joint.kind.as_str()
            ));
        }
        let (lines, home) = AxisLine::axes(chain)?;
        let (wrist, [z4, z5, z6]) = spherical(&lines[3..], 4).or_else(not_wrist)?;
        let [k, z2, z3] = [0, 1, 2].map(|i| lines[i].direction);
        let bent = k.dot(&z2).clamp(-1.0, 1.0).asin().abs();
        if bent > SRS_ANGLE {
            return not_wrist(format!("axes 1 and 2 are {:.3} mrad away from a right angle", 1e3 * bent));
        }
        let skew = z2.cross(&z3).norm().min(1.0).asin();
        if skew > SRS_ANGLE {
            return not_wrist(format!("axes 2 and 3 are {:.3} mrad away from parallel", 1e3 * skew));
        }

        // The sense of m: axis 2 in front of axis 1; without a shoulder offset a positive lateral offset.
        let mut m = (z2 - k * k.dot(&z2)).normalize();
        let origin = lines[0].point;
        let ahead = |m: &Vector3<f64>| (lines[1].point - origin).dot(&m.cross(&k));
        let lateral = (wrist - origin).dot(&m);
        let decisive = if ahead(&m).abs() > SRS_DISTANCE { ahead(&m) } else { lateral };
        let sign2 = if decisive < -SRS_DISTANCE { -1.0 } else { 1.0 };
        m *= sign2;
        let sign3 = if z3.dot(&m) < 0.0 { -1.0 } else { 1.0 };
        let frame = Matrix3::from_columns(&[m.cross(&k), m, k]);
        let in_plane = |point: &Vector3<f64>| {
            let v = frame.tr_mul(&(point - origin));
            complex(v.z, v.x)
        };
        let (shoulder, elbow) = (in_plane(&lines[1].point), in_plane(&lines[2].point));
        let (upper, fore) = (elbow - shoulder, in_plane(&wrist) - elbow);
        let (upper_arm, forearm) = (upper.norm(), fore.norm());
        if upper_arm < SRS_ELBOW_RADIUS {
            return not_wrist(format!("axes 2 and 3 are the same line, {:.6} mm apart", 1e3 * upper_arm));
        }
        if forearm < SRS_ELBOW_RADIUS {
            return not_wrist(format!("the wrist lies on axis 3, {:.6} mm away from it", 1e3 * forearm));
        }
        let (upper_home, fore_home) = (upper.unit(), fore.unit());

        let wrist_axes = Matrix3::from_columns(&[z5.cross(&z4), z5, z4]);
        // Angle by which axis 6 is turned about axis 5 away from axis 4.
        let home5 = z5.dot(&z4.cross(&z6)).atan2(z4.dot(&z6));
        let tool_offset = home.rotation.matrix().tr_mul(&(wrist_axes * rotation_y(home5)));
        let zero2 = -sign2 * upper_home.angle();
        let zero3 = -sign3 * (fore_home.angle() - upper_home.angle());

        let tool = home.translation.vector;
        let reach = upper_arm + forearm + (tool - wrist).norm();
        let mut defect = Defect { position: 0.0, orientation: 0.0 };
        let ideal = [k, m * sign2, m * sign3, z4, z5, z6];
        for (i, (direction, line)) in ideal.iter().zip(&lines).enumerate() {
            let turn = (direction - line.direction).norm();
            let lever = if i < 3 { reach } else { (tool - wrist).norm() };
            let miss = if i < 3 { 0.0 } else { distance_to_line(&wrist, line) };
            defect.orientation += turn;
            defect.position += miss + turn * lever;
        }
        Ok(Self {
            origin,
            frame,
            shoulder,
            lateral: (wrist - origin).dot(&m),
            upper_arm,
            forearm,
            fore_home,
            wrist_in_tool: home.inverse_transform_point(&wrist.into()).coords,
            wrist_frame: orthonormal(&frame.tr_mul(&wrist_axes)).transpose(),
            tool_offset: orthonormal(&tool_offset),
            sign: [1.0, sign2, sign3, 1.0, 1.0, 1.0],
            zero: [0.0, zero2, zero3, 0.0, -home5, 0.0].map(wrap),
            defect,
        })
    }
}

fn not_wrist<T>(reason: String) -> Result<T> {
    Err(Error::NotSphericalWrist { reason })
}
