//! The quantities of [Moore2010] over one pose, as the paper names them: the circle of the elbow, the quaternions of its
//! algorithm, and all windings of a configuration.
//!
//! | paper | here |
//! |---|---|
//! | centre C, normal n, radius rho (fig. 3) | [`SelfMotion::center`], [`axis`](SelfMotion::axis), [`radius`](SelfMotion::radius) |
//! | q_A, eq. (14): turns k into n | [`SelfMotion::q_a`]; its angle is acos(k . n), not s |
//! | p_E, eq. (15) | [`SelfMotion::elbow_position`] |
//! | q_3, eqs (22), (23) | [`Branch::quaternions`], first; (23) has to be normalised, its sign is that for theta4 < 0 |
//! | q_4, eq. (26), and conj(q_4) q, eq. (27) | second and third |
//!
//! The paper's quaternions live in the frame of its base: z is k, the axis of joint 1 (or the chart's reference), x the base's x
//! projected. [`SelfMotion::frame`] says where that frame stands in the world. Elbow offsets are taken as the virtual straight upper
//! arm and forearm from shoulder and wrist to the elbow's axis.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::circle::{Branch, SelfMotion};
use crate::error::Result;
use crate::joint_space::windings;
use crate::rotation::from_rotation;

/// The paper's quaternions at one swivel, in the frame of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperQuaternions {
    /// q_3: orientation of the upper arm, its z axis from shoulder to elbow, its y axis that of joint 4.
    pub q3: UnitQuaternion<f64>,
    /// q_4: orientation of the forearm.
    pub q4: UnitQuaternion<f64>,
    /// `conj(q_4) q`: what joints 5 to 7 turn.
    pub wrist: UnitQuaternion<f64>,
}

impl SelfMotion {
    /// Centre of the elbow's circle in the world, m.
    pub fn center(&self) -> Vector3<f64> {
        let geometry = &self.arm.inner.geometry;
        geometry.shoulder + self.axis() * (self.circle.cos_upper * geometry.upper_arm)
    }

    /// Unit vector from shoulder to wrist in the world, the axis of the circle.
    pub fn axis(&self) -> Vector3<f64> {
        self.arm.inner.geometry.frame * self.circle.n
    }

    /// Radius of the elbow's circle, m; 0 for the stretched and the folded arm.
    pub fn radius(&self) -> f64 {
        self.circle.sin_upper * self.arm.inner.geometry.upper_arm
    }

    /// Axes `[x, y, k]` in the world of the frame in which the paper's quaternions are written.
    pub fn frame(&self) -> Matrix3<f64> {
        self.arm.inner.chart_frame
    }

    /// The paper's q_A: turns the frame's `x, y, k` into the directions of s = 0, s = pi/2 and the axis, written in the frame.
    pub fn q_a(&self) -> UnitQuaternion<f64> {
        let ElbowDirections { n, w0, w1 } = self.directions();
        let frame = self.frame();
        let columns = [w0, w1, n].map(|v| frame.tr_mul(&v));
        quaternion(Matrix3::from_columns(&columns))
    }

    /// The elbow in the world at swivel `s`, m: on the sphere of the upper arm around the shoulder (of an arm with elbow
    /// offset, the point of the elbow's axis nearest to shoulder and wrist).
    ///
    /// ```
    /// use redundancy_core::{chain::catalog, solutions::SrsArm};
    /// let chain = catalog::load("pa10")?;
    /// let arm = SrsArm::new(&chain)?;
    /// let motion = arm.self_motion(&chain.forward(&[0.3, 0.5, -0.2, 1.1, 0.4, 0.7, -0.9])?)?;
    /// let elbow = motion.elbow_position(0.7);
    /// assert!(((elbow - motion.center()).norm() - motion.radius()).abs() < 1e-15);
    /// assert!(((elbow - arm.shoulder()).norm() - arm.lengths()[0]).abs() < 1e-15);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn elbow_position(&self, s: f64) -> Vector3<f64> {
        let (sin, cos) = s.sin_cos();
        self.elbow([cos, sin])
    }

    fn directions(&self) -> ElbowDirections {
        let [n, w0, w1] =
            [self.circle.n, self.circle.w0, self.circle.w1].map(|v| self.arm.inner.geometry.frame * v);
        ElbowDirections { n, w0, w1 }
    }
}

/// Axis of the circle and the directions of s = 0 and s = pi/2, in the world.
struct ElbowDirections {
    n: Vector3<f64>,
    w0: Vector3<f64>,
    w1: Vector3<f64>,
}

/// Of a matrix that is orthonormal up to rounding.
fn quaternion(columns: Matrix3<f64>) -> UnitQuaternion<f64> {
    from_rotation(&Rotation3::from_matrix_unchecked(columns))
}

impl Branch<'_> {
    /// The paper's quaternions at swivel `s`.
    pub fn quaternions(&self, s: f64) -> PaperQuaternions {
        let motion = self.motion();
        let circle = &motion.circle;
        let (sin_s, cos_s) = s.sin_cos();
        let elbow = f64::from(self.signs()[1]);
        // As in `ElbowCircle`: the frames of upper arm and forearm in the swivel frame.
        let w = circle.w0 * cos_s + circle.w1 * sin_s;
        let z3 = circle.n * circle.cos_upper + w * circle.sin_upper;
        let x3 = (circle.n * circle.sin_upper - w * circle.cos_upper) * elbow;
        let y3 = w.cross(&circle.n) * elbow;
        let (sin, cos) = (circle.sin_elbow * elbow, circle.cos_elbow);
        let xf = x3 * cos - z3 * sin;
        let zf = x3 * sin + z3 * cos;
        let to_frame = motion.frame().tr_mul(&motion.arm.inner.geometry.frame);
        let q3 = quaternion(to_frame * Matrix3::from_columns(&[x3, y3, z3]));
        let forearm = Matrix3::from_columns(&[xf, y3, zf]);
        let q4 = quaternion(to_frame * forearm);
        PaperQuaternions { q3, q4, wrist: quaternion(forearm.tr_mul(&circle.tool)) }
    }

    /// Every configuration within the limits at swivel `s` (rad): all windings of all joints, ascending by the first joint
    /// that differs. Joints without limits keep their principal value; none where the branch breaks a limit here.
    ///
    /// # Errors
    /// A swivel that is not finite.
    pub fn windings(&self, s: f64) -> Result<Vec<[f64; 7]>> {
        let q = self.q(s)?;
        let arm = &self.motion().arm;
        let (lower, upper) = (&arm.inner.lower, &arm.inner.upper);
        let mut all = vec![[0.0; 7]];
        for i in 0..7 {
            let values: Vec<f64> = windings(q[i], lower[i], upper[i]).collect();
            all = all
                .iter()
                .flat_map(|row| {
                    values.iter().map(move |value| {
                        let mut next = *row;
                        next[i] = *value;
                        next
                    })
                })
                .collect();
        }
        Ok(all)
    }
}
