//! Where on its circles an arm holds its joint limits: exact, for all branches at once.
//!
//! With the swivel `u = (cos s, sin s)` every entry of `R3` and `R47` is a sinusoid `c0 + c1 cos s + c2 sin s`. The
//! outer ZYZ angles are arc tangents of two of them, the cosine of the middle angle is one. A limit `l` is met where
//! `y cos l - x sin l = 0` or `z = cos l`, again a sinusoid: at most two swivels each, without iteration.
//!
//! All roots are kept, also those of `l + pi`: they cover the jump at a gimbal and belong to the branches of the other
//! sign. Sorted, they cut the circle into arcs on which nothing changes; one test at the midpoint of each, by the
//! signs of the sinusoids, serves all eight branches. Cost: about 2 us for 7 joints and 8 branches.
//!
//! A joint whose range covers a turn limits nothing: some winding always holds.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::geometry::Geometry;
use super::srs::{Circle, SrsArm};
use crate::tolerance::{GIMBAL_SINE, LIMIT_SLACK};

/// The allowed arc of one of the paper's angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Bound {
    /// Every angle is allowed by some winding.
    Free,
    /// No angle is allowed (a margin that eats the range).
    Empty,
    /// From `lo` counter-clockwise to `hi` as unit vectors, `wide` when over half a turn.
    Arc { lo: [f64; 2], hi: [f64; 2], wide: bool },
}

impl Bound {
    fn new(lower: f64, upper: f64) -> Self {
        if upper - lower >= TAU {
            return Self::Free;
        }
        if upper < lower {
            return Self::Empty;
        }
        let unit = |angle: f64| [angle.cos(), angle.sin()];
        Self::Arc { lo: unit(lower), hi: unit(upper), wide: upper - lower > PI }
    }

    /// Whether the direction `(x, y)` (any length) is on the arc, with `slack` in units of its length.
    #[inline(always)]
    fn allows(&self, x: f64, y: f64, slack: f64) -> bool {
        match self {
            Self::Free => true,
            Self::Empty => false,
            Self::Arc { lo, hi, wide } => {
                let after = lo[0] * y - lo[1] * x >= -slack;
                let before = x * hi[1] - y * hi[0] >= -slack;
                if *wide {
                    after || before
                } else {
                    // The last test tells the arc from its antipode, where both cross products vanish for lo = hi.
                    after && before && x * (lo[0] + hi[0]) + y * (lo[1] + hi[1]) >= -slack
                }
            }
        }
    }
}

/// Allowed arcs of the paper's angles for limits on `q`, each narrowed by `margin`.
pub(super) fn bounds(geometry: &Geometry, lower: &[f64; 7], upper: &[f64; 7], margin: f64) -> [Bound; 7] {
    std::array::from_fn(|i| {
        let angle = |q: f64| geometry.sign[i] * (q - geometry.zero[i]);
        let (a, b) = (angle(lower[i] + margin), angle(upper[i] - margin));
        if geometry.sign[i] > 0.0 { Bound::new(a, b) } else { Bound::new(b, a) }
    })
}

/// `c0 + c1 cos s + c2 sin s`.
#[derive(Debug, Clone, Copy)]
struct Sinusoid([f64; 3]);

impl Sinusoid {
    #[inline(always)]
    fn at(&self, cos: f64, sin: f64) -> f64 {
        self.0[0] + self.0[1] * cos + self.0[2] * sin
    }

    fn combined(&self, a: f64, other: &Self, b: f64) -> Self {
        Self(std::array::from_fn(|i| a * self.0[i] + b * other.0[i]))
    }

    fn amplitude(&self) -> f64 {
        self.0[1].hypot(self.0[2])
    }

    /// Adds its zeros. A constant has none; a tangent zero that rounding lifts off the axis counts.
    fn push_zeros(&self, roots: &mut Roots) {
        let [c, a, b] = self.0;
        let squared = a * a + b * b;
        let discriminant = squared - c * c;
        if squared <= FLAT * FLAT || discriminant < -TANGENT * squared {
            return;
        }
        let h = discriminant.max(0.0).sqrt();
        roots.push((-c * b + a * h).atan2(-c * a - b * h));
        roots.push((-c * b - a * h).atan2(-c * a + b * h));
    }
}

/// Amplitude below which a sinusoid of order 1 is a constant.
const FLAT: f64 = 1e-14;
/// Relative negative discriminant that rounding explains.
const TANGENT: f64 = 1e-14;
/// 6 joints x 2 limits x 2 roots x 2 elbows, and 2 x 2 x 2 gimbals.
const CAPACITY: usize = 56;

/// The swivels at which something may change.
struct Roots {
    s: [f64; CAPACITY],
    len: usize,
}

impl Roots {
    fn push(&mut self, s: f64) {
        if self.len < CAPACITY {
            self.s[self.len] = s;
            self.len += 1;
        }
    }
}

/// The three angles of one spherical joint as functions of the swivel, for one elbow.
#[derive(Debug, Clone, Copy)]
struct Spherical {
    first: [Sinusoid; 2],
    middle: Sinusoid,
    third: [Sinusoid; 2],
    /// The middle angle stays at 0 or pi: only the sum of the others is defined, and `third` holds it.
    locked: bool,
}

impl Spherical {
    /// From the entries of the product: `third column` (x, y, z) and the last two rows' entries for the third angle.
    fn new(column: [Sinusoid; 3], row3: [Sinusoid; 2], row2: [Sinusoid; 2]) -> Self {
        let flat = |s: &Sinusoid| s.0.iter().all(|c| c.abs() < GIMBAL_SINE);
        let locked = flat(&column[0]) && flat(&column[1]);
        if locked {
            let (one, zero) = (Sinusoid([1.0, 0.0, 0.0]), Sinusoid([0.0; 3]));
            // First angle 0: the second row is (sin c, cos c).
            let third = [row2[1], row2[0]];
            return Self { first: [one, zero], middle: column[2], third, locked };
        }
        let third = [Sinusoid(row3[0].0.map(|c| -c)), row3[1]];
        Self { first: [column[0], column[1]], middle: column[2], third, locked }
    }

    /// Swivels at which a limit is met.
    fn push_zeros(&self, bounds: &[Bound], roots: &mut Roots, gimbals: &mut Roots) {
        for (pair, bound) in [(&self.first, &bounds[0]), (&self.third, &bounds[2])] {
            if let Bound::Arc { lo, hi, .. } = bound {
                for l in [lo, hi] {
                    pair[1].combined(l[0], &pair[0], -l[1]).push_zeros(roots);
                }
            }
        }
        if let Bound::Arc { lo, hi, .. } = &bounds[1] {
            for l in [lo, hi] {
                let [c0, c1, c2] = self.middle.0;
                Sinusoid([c0 - l[0], c1, c2]).push_zeros(roots);
            }
        }
        // Swivels at which the middle angle passes through 0 or pi: the outer angles jump by pi there.
        let [c0, c1, c2] = self.middle.0;
        if !self.locked && c0.abs() + self.middle.amplitude() > 1.0 - NEAR_GIMBAL {
            let s = c2.atan2(c1);
            for s in [s, s + PI] {
                let (sin, cos) = s.sin_cos();
                if self.first[0].at(cos, sin).hypot(self.first[1].at(cos, sin)) < AT_GIMBAL {
                    gimbals.push(super::geometry::wrapped(s));
                }
            }
        }
    }

    /// For both signs of the middle angle, whether the three joints hold their limits.
    #[inline(always)]
    fn allowed(&self, bounds: &[Bound], cos: f64, sin: f64, slack: f64) -> Allowed {
        let [x, y] = self.first.map(|f| f.at(cos, sin));
        let z = self.middle.at(cos, sin);
        let [u, v] = self.third.map(|f| f.at(cos, sin));
        let h = if self.locked { 0.0 } else { (x * x + y * y).sqrt() };
        Allowed {
            first: [bounds[0].allows(x, y, slack * h), bounds[0].allows(-x, -y, slack * h)],
            middle: [bounds[1].allows(z, h, slack), bounds[1].allows(z, -h, slack)],
            third: [bounds[2].allows(u, v, slack * h), bounds[2].allows(-u, -v, slack * h)],
        }
    }
}

/// `1 - |cos|` of the middle angle below which a gimbal is looked for.
const NEAR_GIMBAL: f64 = 1e-9;
/// Sine of the middle angle at the extremum of its cosine that counts as a passage through the gimbal.
const AT_GIMBAL: f64 = 1e-12;

/// Whether the joints of a spherical joint hold their limits: index 0 as computed, 1 turned by pi (negated for the
/// middle joint).
#[derive(Clone, Copy)]
struct Allowed {
    first: [bool; 2],
    middle: [bool; 2],
    third: [bool; 2],
}

/// The feasible arcs of all branches over one pose.
#[derive(Debug, Clone)]
pub(super) struct Arcs {
    /// Cuts of the circle, ascending in `[-pi, pi]`; arc `i` runs from cut `i` to the next.
    cuts: Vec<f64>,
    /// Bit `b` of entry `i`: branch `b` holds all limits on arc `i`. One entry where there is no cut.
    arcs: Vec<u8>,
    /// Bit `b` of entry `i`: branch `b` holds all limits at cut `i` itself.
    points: Vec<u8>,
    /// Bit `b` of entry `i`: branch `b` jumps at cut `i`, though it is feasible on both sides.
    breaks: Vec<u8>,
}

impl Arcs {
    pub(super) fn new(arm: &SrsArm, circle: &Circle, bounds: &[Bound; 7]) -> Self {
        let geometry = &arm.inner.geometry;
        let none = Self { cuts: Vec::new(), arcs: vec![0], points: Vec::new(), breaks: Vec::new() };
        // The elbow does not depend on the swivel.
        let elbows =
            [1.0, -1.0].map(|sign| bounds[3].allows(circle.cos_elbow, sign * circle.sin_elbow, LIMIT_SLACK));
        if elbows == [false, false] || bounds.contains(&Bound::Empty) {
            return none;
        }
        let both = [1.0, -1.0].map(|sign| sphericals(geometry, circle, sign));
        let mut roots = Roots { s: [0.0; CAPACITY], len: 0 };
        let mut gimbals = [Roots { s: [0.0; CAPACITY], len: 0 }, Roots { s: [0.0; CAPACITY], len: 0 }];
        // Without an elbow offset both elbows meet the limits at the same swivels (l or l + pi).
        for [shoulder, wrist] in both.iter().take(if geometry.aligned { 1 } else { 2 }) {
            shoulder.push_zeros(&bounds[..3], &mut roots, &mut gimbals[0]);
            wrist.push_zeros(&bounds[4..], &mut roots, &mut gimbals[1]);
        }
        let jumps = gimbals.each_ref().map(|g| g.s[..g.len].to_vec());
        for s in jumps.iter().flatten() {
            roots.push(*s);
        }
        let mut cuts = roots.s[..roots.len].to_vec();
        cuts.sort_unstable_by(f64::total_cmp);
        cuts.dedup();
        if cuts.len() > 1 && cuts[cuts.len() - 1] - cuts[0] >= TAU {
            cuts.pop();
        }
        let mask = |s: f64, slack: f64| -> u8 {
            let (sin, cos) = s.sin_cos();
            let mut mask = 0;
            for (e, [shoulder, wrist]) in both.iter().enumerate() {
                if !elbows[e] {
                    continue;
                }
                let a = shoulder.allowed(&bounds[..3], cos, sin, slack);
                let b = wrist.allowed(&bounds[4..], cos, sin, slack);
                for (i, s2) in [0, 1].into_iter().enumerate() {
                    for (j, s6) in [0, 1].into_iter().enumerate() {
                        let ok = a.first[s2]
                            && a.middle[s2]
                            && a.third[s2]
                            && b.first[s6]
                            && b.middle[s6]
                            && b.third[s6];
                        mask |= u8::from(ok) << (4 * i + 2 * e + j);
                    }
                }
            }
            mask
        };
        if cuts.is_empty() {
            return Self { arcs: vec![mask(0.0, 0.0)], ..none };
        }
        let end = |i: usize| if i + 1 < cuts.len() { cuts[i + 1] } else { cuts[0] + TAU };
        let arcs: Vec<u8> = (0..cuts.len()).map(|i| mask(0.5 * (cuts[i] + end(i)), 0.0)).collect();
        let everywhere = arcs.iter().fold(0xff, |all, m| all & m);
        let points = (0..cuts.len())
            .map(|i| {
                let beside = arcs[i] | arcs[if i == 0 { arcs.len() - 1 } else { i - 1 }];
                // Only a branch that is feasible on neither side needs the test.
                if beside | everywhere == 0xff { beside } else { beside | mask(cuts[i], LIMIT_SLACK) }
            })
            .collect();
        let breaks =
            cuts.iter().map(|s| if jumps.iter().flatten().any(|j| j == s) { 0xff } else { 0 }).collect();
        Self { cuts, arcs, points, breaks }
    }

    /// True when no branch holds its limits anywhere.
    pub(super) fn is_empty(&self) -> bool {
        self.arcs.iter().chain(&self.points).all(|m| *m == 0)
    }

    /// The intervals of one branch.
    pub(super) fn of(&self, branch: usize) -> Vec<[f64; 2]> {
        let bit = 1u8 << branch;
        let n = self.cuts.len();
        if n == 0 {
            return if self.arcs[0] & bit != 0 { vec![[-PI, PI]] } else { Vec::new() };
        }
        let inside = |i: usize| self.arcs[i % n] & bit != 0;
        let joined = |i: usize| inside(i + n - 1) && inside(i) && self.breaks[i % n] & bit == 0;
        // Begin after a cut at which the branch is interrupted.
        let Some(first) = (0..n).find(|i| !joined(*i)) else {
            return vec![[-PI, PI]];
        };
        let at = |i: usize| self.cuts[i % n] + TAU * (i / n) as f64;
        let mut out = Vec::new();
        let mut i = first;
        while i < first + n {
            if inside(i) {
                let lo = at(i);
                i += 1;
                while i < first + n && joined(i) {
                    i += 1;
                }
                out.push([lo, at(i)]);
            } else {
                if self.points[i % n] & bit != 0 && !inside(i + n - 1) {
                    out.push([at(i), at(i)]);
                }
                i += 1;
            }
        }
        for interval in &mut out {
            if interval[0] > PI {
                *interval = interval.map(|s| s - TAU);
            }
        }
        out.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        out
    }
}

/// Shoulder and wrist for one elbow sign.
fn sphericals(geometry: &Geometry, circle: &Circle, elbow: f64) -> [Spherical; 2] {
    // R3 v for a constant v, as constant, cosine and sine part:
    // x3 = e (sin_upper n - cos_upper w), y3 = e w x n, z3 = cos_upper n + sin_upper w, w0 x n = -w1, w1 x n = w0.
    let carried = |v: Vector3<f64>| -> [Vector3<f64>; 3] {
        let along_n = v.x * elbow * circle.sin_upper + v.z * circle.cos_upper;
        let along_w = v.z * circle.sin_upper - v.x * elbow * circle.cos_upper;
        let across = v.y * elbow;
        [
            circle.n * along_n,
            circle.w0 * along_w - circle.w1 * across,
            circle.w1 * along_w + circle.w0 * across,
        ]
    };
    let component = |parts: &[Vector3<f64>; 3], i: usize| Sinusoid([parts[0][i], parts[1][i], parts[2][i]]);
    let c = &geometry.shoulder_offset;
    let columns = [0, 1, 2].map(|j| carried(c.column(j).into()));
    let shoulder = Spherical::new(
        [0, 1, 2].map(|i| component(&columns[2], i)),
        [component(&columns[0], 2), component(&columns[1], 2)],
        [component(&columns[0], 1), component(&columns[1], 1)],
    );
    // R47 row i, column j: (R3 Ry(theta4) c_i) . t_j with c_i row i of the wrist offset.
    let (cos, sin) = (circle.cos_elbow, elbow * circle.sin_elbow);
    let turned = |v: Vector3<f64>| Vector3::new(cos * v.x + sin * v.z, v.y, cos * v.z - sin * v.x);
    let rows = [0, 1, 2].map(|i| carried(turned(geometry.wrist_offset.row(i).transpose())));
    let entry = |i: usize, j: usize| {
        let t: Vector3<f64> = circle.tool.column(j).into();
        Sinusoid([rows[i][0].dot(&t), rows[i][1].dot(&t), rows[i][2].dot(&t)])
    };
    let wrist = Spherical::new(
        [entry(0, 2), entry(1, 2), entry(2, 2)],
        [entry(2, 0), entry(2, 1)],
        [entry(1, 0), entry(1, 1)],
    );
    [shoulder, wrist]
}
