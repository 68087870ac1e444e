//! Where on its circles an arm holds its joint limits: exact, for all branches at once.
//!
//! The angles of the spherical joints are arc tangents and an arc cosine of sinusoids in s (`spherical.rs`). A limit
//! `l` is met where `y cos l - x sin l = 0` or `z = cos l`, again a sinusoid: at most two swivels each, without iteration.
//!
//! All roots are kept, also those of `l + pi`: they cover the jump at a gimbal and belong to the branches of the other
//! sign. Sorted, they cut the circle into arcs on which nothing changes; one test at the midpoint of each, by the
//! signs of the sinusoids, serves all eight branches. The test has a slack: over a straight elbow most joints do not move with
//! the swivel, and rounding must not decide whether one that stands at its limit is legal. Cost: about 2 us for 7 joints and 8 branches.
//!
//! A joint whose range covers a turn limits nothing: some winding always holds.

use std::f64::consts::PI;

use super::elbow_circle::ElbowCircle;
use super::geometry::Geometry;
use super::spherical::{Spherical, sphericals};
use crate::joint_space::{TURN, around, turned, wrap};
use crate::tolerance::{LIMIT_SLACK, LIMITS_MEET};

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
        if upper - lower >= TURN {
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
                    // The last test tells the arc from its antipode, where both cross products vanish for lo = hi. Over a
                    // quarter turn there is no such point, and at half a turn lo + hi is nothing but rounding.
                    let over_a_quarter = lo[0] * hi[0] + lo[1] * hi[1] < 0.0;
                    let ahead = over_a_quarter || x * (lo[0] + hi[0]) + y * (lo[1] + hi[1]) >= -slack;
                    after && before && ahead
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

impl Spherical {
    /// Adds the swivels at which a limit is met.
    fn push_limits(&self, bounds: &[Bound], cuts: &mut Vec<f64>) {
        for (pair, bound) in [(&self.first, &bounds[0]), (&self.third, &bounds[2])] {
            if let Bound::Arc { lo, hi, .. } = bound {
                for l in [lo, hi] {
                    cuts.extend(pair[1].combined(l[0], &pair[0], -l[1]).meets(0.0).into_iter().flatten());
                }
            }
        }
        if let Bound::Arc { lo, hi, .. } = &bounds[1] {
            for l in [lo, hi] {
                cuts.extend(self.middle.meets(l[0]).into_iter().flatten());
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
    pub(super) fn new(geometry: &Geometry, circle: &ElbowCircle, bounds: &[Bound; 7]) -> Self {
        let none = Self { cuts: Vec::new(), arcs: vec![0], points: Vec::new(), breaks: Vec::new() };
        // The elbow does not depend on the swivel.
        let elbows =
            [1.0, -1.0].map(|sign| bounds[3].allows(circle.cos_elbow, sign * circle.sin_elbow, LIMIT_SLACK));
        if elbows == [false, false] || bounds.contains(&Bound::Empty) {
            return none;
        }
        let both = [1.0, -1.0].map(|sign| sphericals(geometry, circle, sign));
        let mut cuts = Vec::with_capacity(64);
        let mut jumps = Vec::new();
        // Without an elbow offset both elbows meet the limits at the same swivels (l or l + pi).
        for [shoulder, wrist] in both.iter().take(if geometry.aligned { 1 } else { 2 }) {
            shoulder.push_limits(&bounds[..3], &mut cuts);
            wrist.push_limits(&bounds[4..], &mut cuts);
            jumps.extend(shoulder.gimbals().chain(wrist.gimbals()));
        }
        cuts.extend_from_slice(&jumps);
        cuts.sort_unstable_by(f64::total_cmp);
        // A branch can be feasible at a cut alone only where limits meet (or one is touched, a double root).
        let meet: Vec<bool> = (0..cuts.len()).map(|i| around(&cuts, i + 1) - cuts[i] < LIMITS_MEET).collect();
        let crowded: Vec<f64> = (0..cuts.len())
            .filter(|i| meet[*i] || meet[if *i == 0 { cuts.len() - 1 } else { i - 1 }])
            .map(|i| cuts[i])
            .collect();
        cuts.dedup();
        if cuts.len() > 1 && cuts[cuts.len() - 1] - cuts[0] >= TURN {
            cuts.pop();
        }
        let mask = |s: f64, slack: f64| -> u8 {
            let (sin, cos) = s.sin_cos();
            let mut mask = 0;
            let mut last: Option<[Allowed; 2]> = None;
            for e in 0..2 {
                let [a, b] = match last {
                    // Without an elbow offset the other elbow turns joints 3 and 5 by half a turn.
                    Some([a, b]) if geometry.aligned => {
                        let [p, q] = a.third;
                        let [r, t] = b.first;
                        [Allowed { third: [q, p], ..a }, Allowed { first: [t, r], ..b }]
                    }
                    _ => {
                        let [shoulder, wrist] = &both[e];
                        let a = shoulder.allowed(&bounds[..3], cos, sin, slack);
                        [a, wrist.allowed(&bounds[4..], cos, sin, slack)]
                    }
                };
                last = Some([a, b]);
                if !elbows[e] {
                    continue;
                }
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
            return Self { arcs: vec![mask(0.0, LIMIT_SLACK)], ..none };
        }
        let arcs: Vec<u8> =
            (0..cuts.len()).map(|i| mask(0.5 * (cuts[i] + around(&cuts, i + 1)), LIMIT_SLACK)).collect();
        let points = (0..cuts.len())
            .map(|i| {
                let beside = arcs[i] | arcs[if i == 0 { arcs.len() - 1 } else { i - 1 }];
                if crowded.contains(&cuts[i]) { beside | mask(cuts[i], LIMIT_SLACK) } else { beside }
            })
            .collect();
        let breaks = cuts.iter().map(|s| if jumps.contains(s) { 0xff } else { 0 }).collect();
        Self { cuts, arcs, points, breaks }
    }

    /// True when no branch holds its limits anywhere.
    pub(super) fn is_empty(&self) -> bool {
        self.arcs.iter().chain(&self.points).all(|m| *m == 0)
    }

    /// How much of the circle some branch holds its limits on, rad.
    pub(super) fn covered(&self) -> f64 {
        if self.cuts.is_empty() {
            return if self.arcs[0] == 0 { 0.0 } else { TURN };
        }
        let length = |i: usize| around(&self.cuts, i + 1) - self.cuts[i];
        (0..self.cuts.len()).filter(|i| self.arcs[*i] != 0).map(length).sum()
    }

    /// Whether a branch holds its limits at `s`, which is not a cut.
    pub(super) fn holds(&self, branch: usize, s: f64) -> bool {
        let s = wrap(s);
        // The arc before the first cut is the last one.
        let after = self.cuts.partition_point(|cut| *cut <= s);
        let arc = if after == 0 { self.arcs.len() - 1 } else { after - 1 };
        self.arcs[arc] & (1 << branch) != 0
    }

    /// Bit `b`: branch `b` holds its limits at `s`; at a cut and by rounding beside it, on one of its sides.
    pub(super) fn at(&self, s: f64) -> u8 {
        let s = wrap(s);
        let (n, after) = (self.cuts.len(), self.cuts.partition_point(|cut| *cut <= s));
        if n == 0 {
            return self.arcs[0];
        }
        let arc = |i: usize| self.arcs[i % n];
        let here = arc(after + n - 1);
        let near = |i: usize| (self.cuts[i % n] - s).abs() < LIMITS_MEET;
        let before =
            if near(after + n - 1) { arc(after + 2 * n - 2) | self.points[(after + n - 1) % n] } else { 0 };
        let next = if near(after) { arc(after) | self.points[after % n] } else { 0 };
        here | before | next
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
        let at = |i: usize| around(&self.cuts, i);
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
                *interval = interval.map(|s| turned(s, -1.0));
            }
        }
        out.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        out
    }
}
