//! Whether what is said about a pose holds for all points of its rings: by intervals of the ring's parameter.
//!
//! - *Curves*: over a part of a ring the room and its slope are bounded by the ranges of the angles x and y; where the slope keeps
//!   its sign there is a zero exactly if the ends differ in sign. Parts are divided until that decides everything; the number
//!   of zeros has to be that of the curves found.
//! - *Limits*: over a part, ranges of all joints follow from those of x, y and the normal (of either sign) through the same steps as
//!   the configurations themselves. A part without room, or one in which some joint has no winding within its limits for both
//!   shoulders, is done; others are divided.
//!
//! Neither statement is made where the division does not end: zeros that touch, limits that are met within some 1e-9, a
//! passage through the shoulder's gimbal. Rounding is covered by a margin, not by directed arithmetic.

use std::f64::consts::PI;

use super::arm::Inner;
use super::geometry::PandaGeometry;
use super::ring::{Kind, Ring, Sheet};
use super::target::Target;
use crate::joint_space::TURN;
use crate::solutions::closed_form::interval::{Enclosure, Interval, between, point};
use crate::solutions::closed_form::slope::Sloped;
use crate::tolerance::{PROOF_MARGIN, PROOF_ROOM, PROOF_SHORTEST};

/// Parts of a ring at first.
const PARTS: usize = 32;
/// Most parts that are checked.
const MOST_PARTS: usize = 100_000;

/// Sinusoids `c[0] + c[1] cos + c[2] sin`.
type Sinusoids = [[f64; 3]; 3];

/// The coordinates of the chord as sinusoids.
pub(super) struct Proof<'a> {
    inner: &'a Inner,
    target: &'a Target,
    /// Of y, in `[axis 5, ., normal]`.
    arm: Sinusoids,
    /// Of x, in `[axis 6, ., normal]`.
    hand: Sinusoids,
}

/// Ranges over a part of a ring.
struct Ranges {
    x: Interval,
    y: Interval,
    /// Of the derivatives by the parameter.
    rates: [Interval; 2],
}

impl<'a> Proof<'a> {
    pub fn new(inner: &'a Inner, target: &'a Target) -> Self {
        let g = &inner.geometry;
        let ([r, w], p) = (g.radii, target.radius7);
        let arm = [0, 1, 2].map(|i| {
            let f = |j: usize| g.fore[(i, j)];
            [f(0) * w + f(2) * g.step4, -r * f(0), r * f(1)]
        });
        let hand = [0, 1, 2].map(|i| {
            let h = |j: usize| g.hand[(i, j)];
            [h(0) * g.offset7 + h(2) * target.step7, -p * h(0), -p * h(1)]
        });
        Self { inner, target, arm, hand }
    }

    fn geometry(&self) -> &PandaGeometry {
        &self.inner.geometry
    }

    /// Whether the curves found are all of those on the rings.
    pub fn curves(&self) -> bool {
        let Ok(rings) = Ring::all(self.target) else { return true };
        rings.iter().all(|ring| {
            let (sheets, _) = ring.sheets(self.geometry(), self.target);
            let lenses = sheets.iter().filter(|s| matches!(s, Sheet::Lens { .. })).count();
            self.zeros(ring) == Some(2 * lenses)
        })
    }

    /// The number of zeros of the room on a ring; `None` where it is not decided.
    fn zeros(&self, ring: &Ring) -> Option<usize> {
        let room = |w: f64| ring.room(self.geometry(), self.target, w);
        let mut stack: Vec<[(f64, f64); 2]> = parts().map(|[a, b]| [(a, room(a)), (b, room(b))]).collect();
        let (mut zeros, mut looked) = (0, 0);
        while let Some([a, b]) = stack.pop() {
            looked += 1;
            let width = b.0 - a.0;
            let ranges = ring.ranges(between(a.0, b.0));
            let slope = self.slope(&ranges);
            let ahead = slope * Interval { lo: 0.0, hi: width };
            let (left, right) = (point(a.1) + ahead, point(b.1) - ahead);
            let natural = self.room(ranges.x, ranges.y, self.plane(ranges.x, ranges.y));
            let lo = left.lo.max(right.lo).max(natural.lo);
            let hi = left.hi.min(right.hi).min(natural.hi);
            if lo > 0.0 || hi < 0.0 {
                continue;
            }
            if slope.lo > 0.0 || slope.hi < 0.0 {
                zeros += usize::from((a.1 > 0.0) != (b.1 > 0.0));
                continue;
            }
            if width < PROOF_SHORTEST || looked > MOST_PARTS {
                return None;
            }
            let m = 0.5 * (a.0 + b.0);
            let m = (m, room(m));
            stack.extend([[a, m], [m, b]]);
        }
        Some(zeros)
    }

    /// Components of the chord along axis 5 and across it in the plane of both axes.
    fn plane<E: Enclosure>(&self, x: E, y: E) -> [E; 2] {
        let [cos, sin] = self.geometry().bend;
        let g = E::sinusoid(self.arm[0], y);
        let f = E::sinusoid(self.hand[0], x);
        [g, (f - g.scaled(cos)).scaled(1.0 / sin)]
    }

    /// The room, which x and y give alike.
    fn room<E: Enclosure>(&self, x: E, y: E, [g, across]: [E; 2]) -> E {
        let t = self.target;
        let by_x = E::sinusoid([t.mean_x, -t.swing_x, 0.0], x);
        let by_y = E::sinusoid([t.mean_y, -t.swing_y, 0.0], y);
        by_x.both(by_y) - g.squared() - across.squared()
    }

    /// Of the room, by the parameter of the ring.
    fn slope(&self, ranges: &Ranges) -> Interval {
        let [cos, sin] = self.geometry().bend;
        let derivative = |c: [f64; 3]| [0.0, c[2], -c[1]];
        let [dx, dy] = ranges.rates;
        let [g, across] = self.plane(ranges.x, ranges.y);
        let dg = Interval::sinusoid(derivative(self.arm[0]), ranges.y) * dy;
        let df = Interval::sinusoid(derivative(self.hand[0]), ranges.x) * dx;
        let squared = Interval::sinusoid([0.0, 0.0, self.target.swing_x], ranges.x) * dx;
        squared - (g * dg + across * (df - dg.scaled(cos)).scaled(1.0 / sin)).scaled(2.0)
    }

    /// Whether no configuration over the pose holds the joint limits.
    pub fn nothing_within_limits(&self) -> bool {
        self.nothing_with_margin(0.0, PROOF_SHORTEST)
    }

    /// Whether no configuration over the pose holds limits that are moved inwards by `margin`, which may be negative; parts of
    /// less than `shortest` are not divided.
    pub fn nothing_with_margin(&self, margin: f64, shortest: f64) -> bool {
        let Ok(rings) = Ring::all(self.target) else { return true };
        let mut looked = 0;
        for ring in &rings {
            let mut stack: Vec<[f64; 2]> = parts().collect();
            while let Some([a, b]) = stack.pop() {
                looked += 1;
                if self.is_outside(ring, [a, b], margin) {
                    continue;
                }
                if b - a < shortest || looked > MOST_PARTS {
                    return false;
                }
                let m = 0.5 * (a + b);
                stack.extend([[a, m], [m, b]]);
            }
        }
        true
    }

    /// Whether a joint is outside its limits, moved inwards by `margin`, all over a part: by plain ranges, or with slopes.
    fn is_outside(&self, ring: &Ring, [a, b]: [f64; 2], margin: f64) -> bool {
        let over = ring.ranges(between(a, b));
        if self.rules_out(over.x, over.y, margin) {
            return true;
        }
        let at = ring.ranges(point(0.5 * (a + b)));
        let half = 0.5 * (b - a);
        let sloped = |value, at: Interval, rate: Interval| Sloped::new(value, at, rate.scaled(half));
        let [x, y] = over.rates;
        self.rules_out(sloped(over.x, at.x, x), sloped(over.y, at.y, y), margin)
    }

    /// Whether some joint is outside its limits, moved inwards by `margin`, for every sign of the normal and both shoulders.
    fn rules_out<E: Enclosure>(&self, x: E, y: E, margin: f64) -> bool {
        let Inner { lower, upper, geometry, .. } = self.inner;
        let misses = |i: usize, q: E| {
            let q = q.range();
            let wider = Interval { lo: q.lo - PROOF_MARGIN, hi: q.hi + PROOF_MARGIN };
            wider.misses(lower[i] + margin, upper[i] - margin)
        };
        if misses(3, y - E::constant(geometry.zero4)) || misses(6, x - E::constant(self.target.zero7)) {
            return true;
        }
        let [g, across] = self.plane(x, y);
        let room = self.room(x, y, [g, across]);
        if room.range().hi < -PROOF_MARGIN {
            return true;
        }
        let [cos, sin] = geometry.bend;
        let arm = E::angle_of(E::sinusoid(self.arm[1], y), E::sinusoid(self.arm[2], y));
        let hand = E::angle_of(E::sinusoid(self.hand[1], x), E::sinusoid(self.hand[2], x));
        let across6 = across.scaled(cos) - g.scaled(sin);
        // Where the room is nearly 0 its root magnifies rounding.
        let root = room.widened(PROOF_ROOM).root();
        [root, -root].into_iter().all(|normal| {
            let five = arm - E::angle_of(across, normal);
            let six = E::angle_of(across6, normal) - hand;
            if misses(4, five) || misses(5, six) {
                return true;
            }
            let column = |j: usize| self.column(j, [x, y], five, six);
            let (a1, a3) = (column(0), column(2));
            self.shoulders(&a1, &a3).into_iter().all(|q| (0..3).any(|i| misses(i, q[i])))
        })
    }

    /// Column j of the shoulder's rotation.
    fn column<E: Enclosure>(&self, j: usize, [x, y]: [E; 2], five: E, six: E) -> [E; 3] {
        let g = self.geometry();
        let [cos, sin] = g.bend;
        let upper = [0, 1, 2].map(|i| E::constant(g.upper[(i, j)]));
        let v = times(|i, k| g.fore[(i, k)], &undo(y, &upper, [0, 1, 2]));
        let v = undo(five, &v, [1, 2, 0]);
        let v = [v[0].scaled(cos) + v[1].scaled(sin), v[1].scaled(cos) - v[0].scaled(sin), v[2]];
        let v = times(|i, k| g.hand[(k, i)], &undo(six, &v, [1, 2, 0]));
        times(|i, k| self.target.frame[(i, k)], &undo(x, &v, [0, 1, 2]))
    }

    /// Joints 1, 2, 3 for both shoulders.
    fn shoulders<E: Enclosure>(&self, a1: &[E; 3], a3: &[E; 3]) -> [[E; 3]; 2] {
        let g = self.geometry();
        let ([c1, c2], [s1, s2]) = (g.shoulder_triangle.cos, g.shoulder_triangle.sin);
        let cosine = (E::constant(c1 * c2) - a3[2]).scaled(1.0 / (s1 * s2));
        let second = cosine.acos();
        let cosine = second.cos();
        let low = a3[0] * a1[1] - a3[1] * a1[0];
        [second, -second].map(|second| {
            let sine = second.sin();
            let down = cosine.scaled(-c1 * s2) - E::constant(s1 * c2);
            let first = E::angle_of(a3[0], a3[1]) - E::angle_of(sine.scaled(s2), down);
            let up = cosine.scaled(s1 * c2) + E::constant(c1 * s2);
            let third = E::angle_of(sine.scaled(s1), up) - E::angle_of(a1[2], low);
            [first, second - E::constant(g.zero2), third]
        })
    }
}

/// The parts of a ring at first.
fn parts() -> impl Iterator<Item = [f64; 2]> {
    let at = |k: usize| TURN * k as f64 / PARTS as f64 - PI;
    (0..PARTS).map(move |k| [at(k), at(k + 1)])
}

fn times<E: Enclosure>(m: impl Fn(usize, usize) -> f64, v: &[E; 3]) -> [E; 3] {
    [0, 1, 2].map(|i| v[0].scaled(m(i, 0)) + v[1].scaled(m(i, 1)) + v[2].scaled(m(i, 2)))
}

/// Turned back in the plane of the first two axes named.
fn undo<E: Enclosure>(angle: E, v: &[E; 3], [a, b, c]: [usize; 3]) -> [E; 3] {
    let (cos, sin) = (angle.cos(), angle.sin());
    let mut out = *v;
    out[a] = cos * v[a] + sin * v[b];
    out[b] = cos * v[b] - sin * v[a];
    out[c] = v[c];
    out
}

impl Ring {
    /// Ranges of the angles and their rates over parameters.
    fn ranges(&self, w: Interval) -> Ranges {
        let (sin, cos) = (w.sin(), w.cos());
        let ([a, b], [rest_a, rest_b]) = (self.radii, self.rests);
        // 1 - radius^2 share, for a share in [0, 1].
        let left = |rest: f64, radius: f64, share: Interval| {
            let square = radius * radius;
            Interval { lo: rest + square * (1.0 - share.hi), hi: rest + square * (1.0 - share.lo) }.root()
        };
        let half = |v: Interval| v.acos().scaled(2.0);
        match self.kind {
            Kind::OverX(sign) => {
                let (y, rate) = other(cos.scaled(self.s) - point(self.e), self.t, sign, sin.scaled(self.s));
                Ranges { x: w, y, rates: [point(1.0), rate] }
            }
            Kind::OverY(sign) => {
                let (x, rate) = other(cos.scaled(self.t) + point(self.e), self.s, sign, sin.scaled(self.t));
                Ranges { x, y: w, rates: [rate, point(1.0)] }
            }
            Kind::Stretched => Ranges {
                x: point(PI) - half(sin.scaled(a)),
                y: half(cos.scaled(b)),
                rates: [
                    cos.scaled(2.0 * a) * left(rest_a, a, sin.squared()).inverse(),
                    sin.scaled(2.0 * b) * left(rest_b, b, cos.squared()).inverse(),
                ],
            },
            Kind::Folded => Ranges {
                x: half(cos.scaled(a)),
                y: point(PI) - half(sin.scaled(b)),
                rates: [
                    sin.scaled(2.0 * a) * left(rest_a, a, cos.squared()).inverse(),
                    cos.scaled(2.0 * b) * left(rest_b, b, sin.squared()).inverse(),
                ],
            },
        }
    }
}

/// Angles of one sign whose cosines times `amplitude` are given, and their rates for a push.
fn other(cosine: Interval, amplitude: f64, sign: f64, push: Interval) -> (Interval, Interval) {
    let angle = cosine.scaled(1.0 / amplitude).acos();
    let sine = (point(amplitude * amplitude) - cosine.squared()).root();
    let rate = (push * sine.inverse()).scaled(sign);
    (if sign < 0.0 { -angle } else { angle }, rate)
}
