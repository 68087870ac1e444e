//! What a pose fixes, and the configurations over it from the angles x and y, four at a time. See the module of the class
//! for the formulas.

use nalgebra::{Matrix3, Vector3};
use wide::f64x4;

use super::geometry::PandaGeometry;
use crate::joint_space::wrap_four;
use crate::pose::Pose;
use crate::solutions::closed_form::lanes::{Turns, all};
use crate::tolerance::{GIMBAL_SINE, LENS_END};

/// A vector in each lane.
type Vectors = [f64x4; 3];

/// What a pose fixes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    /// `|W - S|^2 = mean_x - swing_x cos x`.
    pub mean_x: f64,
    /// See `mean_x`; at least 0.
    pub swing_x: f64,
    /// `|W - S|^2 = mean_y - swing_y cos y`.
    pub mean_y: f64,
    /// See `mean_y`; positive.
    pub swing_y: f64,
    /// Distance of S from axis 7.
    pub radius7: f64,
    /// Coordinate of W less that of S along axis 7.
    pub step7: f64,
    /// `x = q7 + zero7`.
    pub zero7: f64,
    /// From the frame of axis 7, turned back by x, to the frame of the base.
    pub frame: Matrix3<f64>,
}

/// A place on the curve in each lane: the angles and what tells the two normals apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct Places {
    pub x: Turns,
    pub y: Turns,
    /// `d x` and `d y` by the parameter of the ring.
    pub rates: [f64x4; 2],
    /// Where on a lens: `sin u`; on a whole ring the sign of the normal.
    pub sine: f64x4,
    /// On a lens `|cos u|`.
    pub cosine: f64x4,
    /// Half the width of a lens in the parameter of its ring; on a whole ring the sign of the normal.
    pub half: f64x4,
}

/// Configurations in each lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows {
    /// Joints 4 to 7, which both shoulders share.
    pub fore: [f64x4; 4],
    /// Joints 1 to 3 for a positive and a negative angle of joint 2.
    pub shoulder: [Vectors; 2],
    /// Sine of the angle between axes 1 and 3.
    pub gimbal: f64x4,
    /// `(W - S) . normal` squared: below 0 there is no configuration.
    pub room: f64x4,
    /// `|W - S|^2`.
    pub squared: f64x4,
}

/// Their rates by u.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates {
    pub fore: [f64x4; 4],
    pub shoulder: [Vectors; 2],
}

/// The chord from S to W as seen from both sides of axes 5 and 6.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    /// In `[axis 5, ., normal]`, before joint 5 turns it.
    arm: Vectors,
    /// In `[axis 6, ., normal]`, after joint 6.
    hand: Vectors,
    /// Component across axis 5 in the plane of axes 5 and 6.
    across: f64x4,
    /// Component across axis 6 in that plane.
    across6: f64x4,
    /// Set where the chord is nearer to axis 6 than to axis 5.
    by_hand: f64x4,
    pub squared: f64x4,
    pub room: f64x4,
}

/// Derivatives of a [`Chord`] by the parameter of the ring.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChordRates {
    arm: Vectors,
    hand: Vectors,
    across: f64x4,
    across6: f64x4,
    pub room: f64x4,
}

#[inline(always)]
fn splat(v: [f64; 3]) -> Vectors {
    v.map(all)
}

#[inline(always)]
fn times(m: &Matrix3<f64>, v: Vectors) -> Vectors {
    [0, 1, 2].map(|i| all(m[(i, 0)]) * v[0] + all(m[(i, 1)]) * v[1] + all(m[(i, 2)]) * v[2])
}

#[inline(always)]
fn transposed_times(m: &Matrix3<f64>, v: Vectors) -> Vectors {
    [0, 1, 2].map(|i| all(m[(0, i)]) * v[0] + all(m[(1, i)]) * v[1] + all(m[(2, i)]) * v[2])
}

#[inline(always)]
fn cross(a: Vectors, b: Vectors) -> Vectors {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: Vectors, b: Vectors) -> f64x4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Turned back about the first coordinate.
#[inline(always)]
fn undo_first(turn: Turns, v: Vectors) -> Vectors {
    let [y, z] = turn.undo(v[1], v[2]);
    [v[0], y, z]
}

/// Turned back about the third coordinate.
#[inline(always)]
fn undo_third(turn: Turns, v: Vectors) -> Vectors {
    let [x, y] = turn.undo(v[0], v[1]);
    [x, y, v[2]]
}

/// Rate of the angle of `(x, y)`, which turns at the speed `(dx, dy)`.
#[inline(always)]
fn turning(x: f64x4, y: f64x4, dx: f64x4, dy: f64x4) -> f64x4 {
    let squared = x * x + y * y;
    (x * dy - y * dx) / squared.fast_max(all(f64::MIN_POSITIVE))
}

impl Target {
    /// Of a checked pose.
    #[inline(always)]
    pub fn new(g: &PandaGeometry, pose: &Pose) -> Self {
        let rotation = pose.rotation.matrix();
        let shoulder = rotation.tr_mul(&(g.shoulder - pose.translation.vector)) - g.origin7_in_tool;
        let s = g.frame7_in_tool.tr_mul(&shoulder);
        let radius7 = (s.x * s.x + s.y * s.y).sqrt();
        let (cos, sin) = if radius7 > 0.0 { (s.x / radius7, s.y / radius7) } else { (1.0, 0.0) };
        let [r, w] = g.radii;
        // The columns of the frame, turned by zero7 about the third.
        let m = g.base.tr_mul(rotation) * g.frame7_in_tool;
        let (a, b): (Vector3<f64>, Vector3<f64>) = (m.column(0).into(), m.column(1).into());
        Self {
            mean_x: g.offset7 * g.offset7 + radius7 * radius7 + s.z * s.z,
            swing_x: 2.0 * g.offset7 * radius7,
            mean_y: r * r + w * w + g.step4 * g.step4,
            swing_y: 2.0 * r * w,
            radius7,
            step7: -s.z,
            zero7: sin.atan2(cos),
            frame: Matrix3::from_columns(&[a * cos + b * sin, b * cos - a * sin, m.column(2).into()]),
        }
    }

    /// The chord for both angles.
    #[inline(always)]
    pub fn chord(&self, g: &PandaGeometry, x: Turns, y: Turns) -> Chord {
        let (r, w) = (all(g.radii[0]), all(g.radii[1]));
        let radius7 = all(self.radius7);
        let arm = times(&g.fore, [w - r * y.cos, r * y.sin, all(g.step4)]);
        let hand = times(&g.hand, [all(g.offset7) - radius7 * x.cos, -radius7 * x.sin, all(self.step7)]);
        let [cos, sin] = g.bend;
        let across = (hand[0] - all(cos) * arm[0]) * all(1.0 / sin);
        let across6 = all(cos) * across - all(sin) * arm[0];
        let squared = all(self.mean_x) - all(self.swing_x) * x.cos;
        // From the axis that the chord is nearer to: next to it the squared length has lost the digits of the room.
        let [off5, off6] = [arm, hand].map(|v| v[1] * v[1] + v[2] * v[2]);
        let by_hand = off6.simd_lt(off5);
        let room = by_hand.select(off6 - across6 * across6, off5 - across * across);
        Chord { arm, hand, across, across6, by_hand, squared, room }
    }

    /// Derivatives of the chord for the rates of x and y.
    #[inline(always)]
    pub fn chord_rates(&self, g: &PandaGeometry, chord: &Chord, at: &Places) -> ChordRates {
        let r = all(g.radii[0]) * at.rates[1];
        let radius7 = all(self.radius7) * at.rates[0];
        let zero = all(0.0);
        let arm = times(&g.fore, [r * at.y.sin, r * at.y.cos, zero]);
        let hand = times(&g.hand, [radius7 * at.x.sin, -radius7 * at.x.cos, zero]);
        let [cos, sin] = g.bend;
        let across = (hand[0] - all(cos) * arm[0]) * all(1.0 / sin);
        let across6 = all(cos) * across - all(sin) * arm[0];
        let by_arm = chord.arm[1] * arm[1] + chord.arm[2] * arm[2] - chord.across * across;
        let by_hand = chord.hand[1] * hand[1] + chord.hand[2] * hand[2] - chord.across6 * across6;
        let room = all(2.0) * chord.by_hand.select(by_hand, by_arm);
        ChordRates { arm, hand, across, across6, room }
    }

    /// The configurations of a chord whose component along the normal is `normal`, and the turns that they are made of.
    #[inline(always)]
    pub fn rows(
        &self,
        g: &PandaGeometry,
        x: Turns,
        y: Turns,
        chord: &Chord,
        normal: f64x4,
    ) -> (Rows, Turned) {
        let none = [1.0, 0.0];
        let (c, v) = (chord.across, chord.arm);
        let five = Turns::along(c * v[1] + normal * v[2], c * v[2] - normal * v[1], 0.0, none);
        // The same vector in the axes of joint 6.
        let (c, v) = (chord.across6, chord.hand);
        let six = Turns::along(c * v[1] + normal * v[2], normal * v[1] - c * v[2], 0.0, none);
        // The first and third column of the shoulder's rotation.
        let column = |j: usize| {
            let after3 = splat([g.upper[(0, j)], g.upper[(1, j)], g.upper[(2, j)]]);
            let after5 = undo_first(five, times(&g.fore, undo_third(y, after3)));
            self.in_base(g, x, six, bent(g, after5))
        };
        let (a1, a3) = (column(0), column(2));
        let gimbal = (a3[0] * a3[0] + a3[1] * a3[1]).sqrt();
        let shoulders = shoulders(g, a1, a3, gimbal);
        let fore = [
            wrap_four(y.angles() - all(g.zero4)),
            five.angles(),
            six.angles(),
            wrap_four(x.angles() - all(self.zero7)),
        ];
        let shoulder = shoulders.map(|[first, second, third]| {
            [first.angles(), wrap_four(second.angles() - all(g.zero2)), third.angles()]
        });
        let rows = Rows { fore, shoulder, gimbal, room: chord.room, squared: chord.squared };
        (rows, Turned { five, six, axis3: a3, shoulders })
    }

    /// From the axes of joint 6, after joint 5 and before joint 6 turns, to the base.
    #[inline(always)]
    fn in_base(&self, g: &PandaGeometry, x: Turns, six: Turns, v: Vectors) -> Vectors {
        times(&self.frame, undo_third(x, transposed_times(&g.hand, undo_first(six, v))))
    }

    /// Configurations and their rates by u.
    #[inline(always)]
    pub fn rows_with_rates(&self, g: &PandaGeometry, at: &Places) -> (Rows, Rates) {
        let chord = self.chord(g, at.x, at.y);
        let rates = self.chord_rates(g, &chord, at);
        let (normal, slope) = at.normal(&chord, &rates);
        let (rows, turned) = self.rows(g, at.x, at.y, &chord, normal);
        let [cos, sin] = g.bend.map(all);

        let pace = at.half * at.sine;
        let (arm, hand) = (rates.arm.map(|x| x * pace), rates.hand.map(|x| x * pace));
        let across = rates.across * pace;
        let five = turning(chord.arm[1], chord.arm[2], arm[1], arm[2])
            - turning(chord.across, normal, across, slope);
        let six = turning(chord.across6, normal, rates.across6 * pace, slope)
            - turning(chord.hand[1], chord.hand[2], hand[1], hand[2]);
        let (seven, four) = (at.rates[0] * pace, at.rates[1] * pace);

        // The shoulder turns against what the other joints do.
        let f = &self.frame;
        let axis7 = splat([f[(0, 2)], f[(1, 2)], f[(2, 2)]]);
        let axis6 = splat([g.hand[(0, 0)], g.hand[(0, 1)], g.hand[(0, 2)]]);
        let axis6 = times(f, undo_third(at.x, axis6));
        let axis5 = self.in_base(g, at.x, turned.six, [cos, -sin, all(0.0)]);
        let axis4 = splat([g.fore[(0, 2)], g.fore[(1, 2)], g.fore[(2, 2)]]);
        let axis4 = self.in_base(g, at.x, turned.six, bent(g, undo_first(turned.five, axis4)));
        let spin =
            [0, 1, 2].map(|i| -(axis7[i] * seven + axis6[i] * six + axis5[i] * five + axis4[i] * four));
        let [cos, sin] = [all(g.shoulder_triangle.cos[0]), all(g.shoulder_triangle.sin[0])];
        let axis3 = turned.axis3;
        let shoulder = turned.shoulders.map(|[first, ..]| {
            // Coordinates of the spin along axes 1, 2, 3; axis 1 is the third of the base.
            let axis2 = [first.sin * sin, -first.cos * sin, cos];
            let normal = cross(axis2, axis3);
            let least = all(f64::MIN_POSITIVE);
            let volume =
                normal[2].simd_lt(all(0.0)).select(normal[2].fast_min(-least), normal[2].fast_max(least));
            [
                dot(spin, normal) / volume,
                (spin[0] * axis3[1] - spin[1] * axis3[0]) / volume,
                (spin[1] * axis2[0] - spin[0] * axis2[1]) / volume,
            ]
        });
        (rows, Rates { fore: [four, five, six, seven], shoulder })
    }
}

/// The turns of joints 5 and 6 and of the shoulder, and axis 3 in the base.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turned {
    five: Turns,
    six: Turns,
    axis3: Vectors,
    shoulders: [[Turns; 3]; 2],
}

impl Places {
    /// Component of the chord along the normal and its rate by u. On a lens it is `sin u sqrt(room / sin^2 u)`; at its ends the
    /// root is that of the slope of the room, which has all digits there.
    #[inline(always)]
    fn normal(&self, chord: &Chord, rates: &ChordRates) -> (f64x4, f64x4) {
        let size = self.sine.abs();
        let inner = chord.room.fast_max(all(0.0)).sqrt() / size;
        let outer = (rates.room * self.half / (all(1.0) + self.cosine)).abs().sqrt();
        let root = size.simd_gt(all(LENS_END)).select(inner, outer);
        let slope = all(0.5) * rates.room * self.half / root.fast_max(all(f64::MIN_POSITIVE));
        (self.sine * root, slope)
    }
}

/// From `[axis 5, ., normal]` to `[axis 6, ., normal]`.
#[inline(always)]
fn bent(g: &PandaGeometry, v: Vectors) -> Vectors {
    let [cos, sin] = g.bend.map(all);
    [cos * v[0] + sin * v[1], cos * v[1] - sin * v[0], v[2]]
}

/// Joints 1, 2, 3 (the zeros of joint 2 not taken off) for both signs of joint 2, from the columns 1 and 3 of the rotation and
/// the sine of the angle between axes 1 and 3.
#[inline(always)]
fn shoulders(g: &PandaGeometry, a1: Vectors, a3: Vectors, gimbal: f64x4) -> [[Turns; 3]; 2] {
    let triangle = &g.shoulder_triangle;
    let (angle, _) = triangle.angle(a3[2], gimbal);
    let ([cos1, cos2], [sin1, sin2]) = (triangle.cos.map(all), triangle.sin.map(all));
    let a2 = cross(a3, a1);
    [angle.sin, -angle.sin].map(|sine| {
        let second = Turns { cos: -angle.cos, sin: sine };
        let (x, y) = (sine * sin2, angle.cos * sin2);
        let y = cos1 * y - sin1 * cos2;
        let first =
            Turns::along(a3[0] * x + a3[1] * y, a3[1] * x - a3[0] * y, GIMBAL_SINE * GIMBAL_SINE, [1.0, 0.0]);
        // The first row of what is left for joint 3.
        let row = |v: Vectors| {
            let [x, y] = first.undo(v[0], v[1]);
            second.cos * x + second.sin * (cos1 * y + sin1 * v[2])
        };
        let third = Turns::along(row(a1), -row(a2), 0.0, [1.0, 0.0]);
        [first, second, third]
    })
}

/// The eight rows `4 shoulder + lane`.
#[inline(always)]
pub(super) fn transpose(rows: &Rows) -> [[f64; 7]; 8] {
    let fore = rows.fore.map(f64x4::to_array);
    let mut out = [[0.0; 7]; 8];
    for (s, shoulder) in rows.shoulder.iter().enumerate() {
        let shoulder = shoulder.map(f64x4::to_array);
        for lane in 0..4 {
            let [a, b, c] = [0, 1, 2].map(|i| shoulder[i][lane]);
            let [d, e, f, g] = [0, 1, 2, 3].map(|i| fore[i][lane]);
            out[4 * s + lane] = [a, b, c, d, e, f, g];
        }
    }
    out
}
