//! The circle of elbow positions over one pose, and the joint angles and rates over each of its points: steps 3 to 5 of
//! `arm.rs`.

use nalgebra::{Matrix3, Vector3};
use wide::f64x4;

use super::geometry::Geometry;
use crate::joint_space::{opposite, wrap_sum};
use crate::tolerance::GIMBAL_SINE;

/// Signs of a branch from its index `4 [s2 < 0] + 2 [s4 < 0] + [s6 < 0]`.
pub(crate) fn signs(branch: usize) -> [i8; 3] {
    [4, 2, 1].map(|bit| if branch & bit == 0 { 1 } else { -1 })
}

/// The circle of elbow positions over one pose: everything that does not depend on the swivel.
#[derive(Debug, Clone, Copy)]
pub(super) struct ElbowCircle {
    /// Shoulder to wrist, swivel frame.
    pub n: Vector3<f64>,
    /// Elbow direction at s = 0 and s = pi/2, swivel frame.
    pub w0: Vector3<f64>,
    /// See `w0`.
    pub w1: Vector3<f64>,
    /// Upper arm direction is `cos_upper n + sin_upper w`.
    pub cos_upper: f64,
    /// See `cos_upper`.
    pub sin_upper: f64,
    /// Cosine and sine of theta4 of the branches with s4 = +.
    pub cos_elbow: f64,
    /// See `cos_elbow`.
    pub sin_elbow: f64,
    /// Tool rotation as the wrist sees it, swivel frame: its third column is the last axis.
    pub tool: Matrix3<f64>,
}

/// The angles of one elbow sign at a swivel ([`ElbowCircle::angles`]) with their rates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub s: f64,
    pub angles: [f64; 7],
    /// `d/ds` of the angles, unwound arm, branch +++.
    pub rates: [f64; 7],
    /// Cosines of the middle angles of shoulder and wrist; they are the same in every branch.
    pub cosine: [f64; 2],
    /// `d/ds` of the cosines.
    pub cosine_rate: [f64; 2],
}

/// Distance from shoulder to wrist outside of the reach, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Reach {
    Inside,
    TooFar(f64),
    TooNear(f64),
}

/// Sines and cosines (times a positive number) of the angles of `Rz(a) Ry(b) Rz(c)`, b in `[0, pi]`.
///
/// Arguments: the third column `z`, the rows 1, 2 of the first two columns, and the axis about which the product turns
/// as the swivel moves. The third angle follows from the first through `Rz(-a) R`, whose second row is
/// `(sin c, cos c, 0)`.
#[inline(always)]
fn zyz(z: [f64; 3], x: [f64; 2], y: [f64; 2], turn: [f64; 2]) -> [[f64; 2]; 3] {
    let h = (z[0] * z[0] + z[1] * z[1]).sqrt();
    let (ca, sa) = if h > GIMBAL_SINE { (z[0] / h, z[1] / h) } else { first_at_gimbal(turn) };
    [[sa, ca], [h, z[2]], [ca * x[1] - sa * x[0], ca * y[1] - sa * y[0]]]
}

/// Arc tangents of seven pairs `[y, x]`, four at a time: a third of the cost of seven library calls, within 1 ulp.
#[inline(always)]
fn arc_tangents(p: [[f64; 2]; 7]) -> [f64; 7] {
    let y = [f64x4::new([p[0][0], p[1][0], p[2][0], p[3][0]]), f64x4::new([p[4][0], p[5][0], p[6][0], 0.0])];
    let x = [f64x4::new([p[0][1], p[1][1], p[2][1], p[3][1]]), f64x4::new([p[4][1], p[5][1], p[6][1], 1.0])];
    let [a, b, c, d] = y[0].atan2(x[0]).to_array();
    let [e, f, g, _] = y[1].atan2(x[1]).to_array();
    [a, b, c, d, e, f, g]
}

/// Cosine and sine of the first angle where only its sum with the third is defined: the limit on the way of the
/// swivel through the gimbal (the middle axis stands on the turn axis), 0 where the swivel stays in the gimbal.
#[cold]
fn first_at_gimbal(turn: [f64; 2]) -> (f64, f64) {
    let norm = turn[0].hypot(turn[1]);
    if norm > GIMBAL_SINE { (turn[1] / norm, -turn[0] / norm) } else { (1.0, 0.0) }
}

impl ElbowCircle {
    /// Angles of the paper for the swivel direction `u`: the shared ones `[a, b, c, t, d, e, f]` of branch +++, for
    /// one elbow sign (`elbow = 1.0` or `-1.0`; aligned arms need only `1.0`).
    #[inline(always)]
    pub fn angles(&self, geometry: &Geometry, u: [f64; 2], elbow: f64) -> [f64; 7] {
        arc_tangents(self.pairs(geometry, u, elbow))
    }

    /// The same as a [`Node`], `u` being that of swivel `s`.
    pub fn node(&self, geometry: &Geometry, s: f64, u: [f64; 2], elbow: f64) -> Node {
        let pairs = self.pairs(geometry, u, elbow);
        let [a, b, c] = zyz_rates(&self.n, pairs[0], pairs[1]);
        let [d, e, f] = zyz_rates(&self.wrist_turn(geometry, elbow), pairs[4], pairs[5]);
        Node {
            s,
            angles: arc_tangents(pairs),
            rates: [a, b, c, 0.0, d, e, f],
            cosine: [pairs[1][1], pairs[5][1]],
            cosine_rate: [-pairs[1][0] * b, -pairs[5][0] * e],
        }
    }

    /// Sines and cosines of [`ElbowCircle::angles`], up to a positive factor; of unit length for the first two of a joint.
    #[inline(always)]
    fn pairs(&self, geometry: &Geometry, u: [f64; 2], elbow: f64) -> [[f64; 2]; 7] {
        let w = self.w0 * u[0] + self.w1 * u[1];
        let z3 = self.n * self.cos_upper + w * self.sin_upper;
        let x3 = (self.n * self.sin_upper - w * self.cos_upper) * elbow;
        let y3 = w.cross(&self.n) * elbow;
        let (sin, cos) = (self.sin_elbow * elbow, self.cos_elbow);
        let xf = x3 * cos - z3 * sin;
        let zf = x3 * sin + z3 * cos;
        let t = &self.tool;
        let turn = self.wrist_turn(geometry, elbow);
        let [a, b, c];
        let [d, e, f];
        if geometry.aligned {
            [a, b, c] = zyz([z3.x, z3.y, z3.z], [x3.x, x3.y], [y3.x, y3.y], [self.n.x, self.n.y]);
            let (tx, ty, tz) = (t.column(0), t.column(1), t.column(2));
            let z = [xf.dot(&tz), y3.dot(&tz), zf.dot(&tz)];
            [d, e, f] = zyz(z, [xf.dot(&tx), y3.dot(&tx)], [xf.dot(&ty), y3.dot(&ty)], [turn.x, turn.y]);
        } else {
            let u = Matrix3::from_columns(&[x3, y3, z3]) * geometry.shoulder_offset;
            [a, b, c] = zyz([u.m13, u.m23, u.m33], [u.m11, u.m21], [u.m12, u.m22], [self.n.x, self.n.y]);
            let g = geometry.wrist_offset * Matrix3::from_columns(&[xf, y3, zf]).tr_mul(t);
            [d, e, f] = zyz([g.m13, g.m23, g.m33], [g.m11, g.m21], [g.m12, g.m22], [turn.x, turn.y]);
        }
        [a, b, c, [self.sin_elbow, self.cos_elbow], d, e, f]
    }

    /// All eight branches in branch order, in principal values.
    #[inline(always)]
    pub fn all_branches(&self, geometry: &Geometry, u: [f64; 2], out: &mut [[f64; 7]; 8]) {
        let plus = self.angles(geometry, u, 1.0);
        if geometry.aligned {
            // The other elbow turns the links about their own axes.
            let mut minus = plus;
            minus[2] = opposite(plus[2]);
            minus[4] = opposite(plus[4]);
            fill(geometry, &plus, &minus, out);
        } else {
            fill(geometry, &plus, &self.angles(geometry, u, -1.0), out);
        }
    }

    /// Axis about which the wrist's product `Rz(d) Ry(e) Rz(f)` turns as the swivel moves, in its own base frame:
    /// `-n` seen from the forearm; it does not depend on the swivel.
    #[inline(always)]
    pub fn wrist_turn(&self, geometry: &Geometry, elbow: f64) -> Vector3<f64> {
        let x = elbow * (self.sin_upper * self.cos_elbow - self.cos_upper * self.sin_elbow);
        let z = self.sin_upper * self.sin_elbow + self.cos_upper * self.cos_elbow;
        if geometry.aligned {
            Vector3::new(-x, 0.0, -z)
        } else {
            -(geometry.wrist_offset * Vector3::new(x, 0.0, z))
        }
    }

    /// One branch, in principal values.
    pub fn branch(&self, geometry: &Geometry, u: [f64; 2], branch: usize) -> [f64; 7] {
        let elbow = if geometry.aligned { 1.0 } else { f64::from(signs(branch)[1]) };
        Self::branch_of(geometry, &self.angles(geometry, u, elbow), branch)
    }

    /// One branch in principal values, from the [`ElbowCircle::angles`] of elbow + (aligned arms) or of its own elbow.
    pub fn branch_of(geometry: &Geometry, t: &[f64; 7], branch: usize) -> [f64; 7] {
        let [s2, s4, s6] = signs(branch);
        let mut angles = *t;
        if s4 < 0 {
            angles[3] = -t[3];
            if geometry.aligned {
                (angles[2], angles[4]) = (opposite(angles[2]), opposite(angles[4]));
            }
        }
        if s2 < 0 {
            (angles[0], angles[1], angles[2]) = (opposite(angles[0]), -angles[1], opposite(angles[2]));
        }
        if s6 < 0 {
            (angles[4], angles[5], angles[6]) = (opposite(angles[4]), -angles[5], opposite(angles[6]));
        }
        std::array::from_fn(|i| wrap_sum(geometry.sign[i] * angles[i] + geometry.zero[i]))
    }

    /// `dq/ds` of one branch.
    pub fn tangent(&self, geometry: &Geometry, u: [f64; 2], branch: usize) -> [f64; 7] {
        let [s2, s4, s6] = signs(branch).map(f64::from);
        // The other shoulder and wrist turn their middle joints backwards and the others alike.
        let mut rates = self.node(geometry, 0.0, u, s4).rates;
        rates[1] *= s2;
        rates[5] *= s6;
        for i in 0..7 {
            rates[i] *= geometry.sign[i];
        }
        rates
    }
}

/// Rates of `Rz(a) Ry(b) Rz(c)` when it turns about `turn` at unit speed:
/// `turn = a' z + b' y1 + c' e3` with `y1 = (-sin a, cos a, 0)`, `e3 = (cos a sin b, sin a sin b, cos b)`.
///
/// At a gimbal through which the swivel passes the limits `a' = c' = turn_z / 2` (for `b = 0`) are returned.
///
/// Sine and cosine of the first and of the middle angle are given.
#[inline(always)]
fn zyz_rates(turn: &Vector3<f64>, [sa, ca]: [f64; 2], [sb, cb]: [f64; 2]) -> [f64; 3] {
    let middle = ca * turn.y - sa * turn.x;
    let along_x = ca * turn.x + sa * turn.y;
    if sb > GIMBAL_SINE {
        let third = along_x / sb;
        return [turn.z - third * cb, middle, third];
    }
    if turn.xy().norm() > GIMBAL_SINE {
        return [0.5 * turn.z, middle, 0.5 * turn.z * cb];
    }
    [0.0, middle, turn.z * cb]
}

/// Writes the eight branches from the angles of elbow + and elbow -.
#[inline(always)]
fn fill(geometry: &Geometry, plus: &[f64; 7], minus: &[f64; 7], out: &mut [[f64; 7]; 8]) {
    let q = |i: usize, angle: f64| wrap_sum(geometry.sign[i] * angle + geometry.zero[i]);
    for (s4, t) in [plus, minus].into_iter().enumerate() {
        let q4 = q(3, if s4 == 0 { t[3] } else { -t[3] });
        // Shoulder and wrist halves for both signs of theta2 and theta6.
        let shoulder =
            [[q(0, t[0]), q(1, t[1]), q(2, t[2])], [q(0, opposite(t[0])), q(1, -t[1]), q(2, opposite(t[2]))]];
        let wrist =
            [[q(4, t[4]), q(5, t[5]), q(6, t[6])], [q(4, opposite(t[4])), q(5, -t[5]), q(6, opposite(t[6]))]];
        for (s2, [q1, q2, q3]) in shoulder.into_iter().enumerate() {
            for (s6, [q5, q6, q7]) in wrist.into_iter().enumerate() {
                out[4 * s2 + 2 * s4 + s6] = [q1, q2, q3, q4, q5, q6, q7];
            }
        }
    }
}
