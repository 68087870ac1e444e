//! Where on its curves an arm holds its joint limits.
//!
//! A curve is cut into parts on which every joint is followed by the cubic through its values and rates at both ends. The
//! control points of the cubic bound it, and a share of what it leaves of the trapezoid rule (a third-order difference, one order
//! above the cubic's own error) and of the bend of the part bounds what it misses. A part is *dropped* when one joint is outside its limits all along,
//! *kept* when all are inside, and searched when every joint in question passes a limit once, monotonically: that root is
//! then found on the curve itself to rounding. All other parts are divided. Only parts that no joint rules out are divided, so
//! most of a curve is done with its first 32 points, which run four at a time.
//!
//! Points at which limits meet without an interval in between (a single feasible configuration) are kept as intervals
//! of no length.

use std::f64::consts::PI;

use smallvec::SmallVec;

use super::ring::Sheet;
use super::walk::{Node, Walk};
use crate::joint_space::{TURN, difference, wrap};
use crate::tolerance::{ARC_BAND, ARC_BEND, ARC_COARSE, ARC_SHORTEST, LIMIT_SLACK};

/// Parts of a curve at first.
const PARTS: usize = 32;
/// Most steps to a limit.
const ROOT_STEPS: usize = 60;

/// Limits as centre and half width; no limit where half a turn or more.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    center: [f64; 7],
    half: [f64; 7],
}

impl Limits {
    pub fn new(lower: &[f64; 7], upper: &[f64; 7], margin: f64) -> Self {
        let bounded = |i: usize| upper[i] - lower[i] < f64::INFINITY;
        Self {
            center: std::array::from_fn(|i| {
                if bounded(i) { lower[i] + 0.5 * (upper[i] - lower[i]) } else { 0.0 }
            }),
            half: std::array::from_fn(|i| if bounded(i) { 0.5 * (upper[i] - lower[i]) - margin } else { PI }),
        }
    }

    /// How far the worst joint is inside (negative outside).
    fn margin(&self, q: &[f64; 7]) -> f64 {
        let inside = |i: usize| self.half[i] - wrap(q[i] - self.center[i]).abs();
        (0..7).filter(|i| self.half[*i] < PI).map(inside).fold(f64::INFINITY, f64::min)
    }
}

/// One end of a [`Part`].
#[derive(Debug, Clone, Copy)]
pub(super) struct End {
    pub u: f64,
    pub q: [f64; 7],
    pub rate: [f64; 7],
}

impl End {
    fn of(node: &Node, shoulder: usize) -> Self {
        Self { u: node.u, q: node.q[shoulder], rate: node.rate[shoulder] }
    }
}

/// A feasible part of a curve; joints are modulo turns. Where limits only touch, both ends are the same.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub a: End,
    pub b: End,
}

/// The feasible parts of one curve of the wrist, for both shoulders, ascending in u.
#[derive(Debug, Clone)]
pub(super) struct Arcs {
    pub parts: [Vec<Part>; 2],
}

/// A joint that passes a limit between two ends.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    joint: usize,
    /// The value of the joint there, modulo turns.
    at: f64,
    u: f64,
}

/// Every joint passes at most two limits.
type Crossings = SmallVec<[Crossing; 14]>;

/// What is known of a part.
#[expect(clippy::large_enum_variant, reason = "one at a time on the stack; a box would allocate")]
enum Verdict {
    Dropped,
    Kept,
    Unclear,
    /// Joints that pass a limit; bit i: joint i is inside at the beginning.
    Crossed(Crossings, u8),
}

/// What is known of a joint on a part.
enum Course {
    Inside,
    Outside,
    Unclear,
    /// Passes one limit or two; whether it is inside at the beginning.
    Crosses([Option<f64>; 2], bool),
}

/// How the joints go from one end to the other: steps, and what the cubics through both ends may miss.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps {
    pub step: [f64; 7],
    pub band: [f64; 7],
}

impl Steps {
    /// Joints that turn fast together (the shoulder near its gimbal, joints 4 to 7 where the chord is near axis 5 or 6) share
    /// the largest estimate: what one of them misses by symmetry another shows.
    #[inline(always)]
    pub fn new(a: &End, b: &End) -> Self {
        let h = b.u - a.u;
        let step: [f64; 7] = std::array::from_fn(|i| difference(a.q[i], b.q[i]));
        let miss = |i: usize| {
            let [first, second] = [h * a.rate[i], h * b.rate[i]];
            (step[i] - 0.5 * (first + second)).abs() + ARC_BEND * (second - first).abs()
        };
        let most =
            |range: std::ops::Range<usize>| range.map(miss).fold(0.0, |a: f64, b| if b > a { b } else { a });
        let band = |miss: f64| if miss > ARC_COARSE { f64::INFINITY } else { ARC_BAND * miss };
        let (shoulder, fore) = (band(most(0..3)), band(most(3..7)));
        Self { step, band: std::array::from_fn(|i| if i < 3 { shoulder } else { fore }) }
    }
}

/// The cubic of a joint.
pub(super) struct Cubic {
    points: [f64; 4],
    /// What it may miss.
    band: f64,
}

impl Cubic {
    /// Of joint `i`, from its value at the beginning.
    #[inline(always)]
    pub fn new(start: f64, steps: &Steps, i: usize, a: &End, b: &End) -> Self {
        let (h, end) = (b.u - a.u, start + steps.step[i]);
        Self {
            points: [start, start + h * a.rate[i] / 3.0, end - h * b.rate[i] / 3.0, end],
            band: steps.band[i],
        }
    }

    /// What bounds it.
    #[inline(always)]
    pub fn range(&self) -> [f64; 2] {
        let [a, b, c, d] = self.points;
        let lesser = |a: f64, b: f64| if a < b { a } else { b };
        let greater = |a: f64, b: f64| if a > b { a } else { b };
        [lesser(lesser(a, b), lesser(c, d)) - self.band, greater(greater(a, b), greater(c, d)) + self.band]
    }

    fn is_monotone(&self) -> bool {
        let [a, b, c, d] = self.points;
        let rises = [b - a, c - b, d - c];
        rises.iter().all(|r| *r > 0.0) || rises.iter().all(|r| *r < 0.0)
    }

    /// Against the limits `+-half`, modulo turns.
    #[inline(always)]
    fn course(&self, half: f64) -> Course {
        let [low, high] = self.range();
        if low >= -half && high < half {
            return Course::Inside;
        }
        let other = TURN - half;
        if (low > half && high < other) || (high < -half && low > -other) {
            return Course::Outside;
        }
        if (low >= other && high < other + 2.0 * half) || (high < -other && low >= -other - 2.0 * half) {
            return Course::Inside;
        }
        self.passes(half)
    }

    #[cold]
    fn passes(&self, half: f64) -> Course {
        let [low, high] = self.range();
        let [a, .., d] = self.points;
        if high - low > PI || !self.is_monotone() {
            return Course::Unclear;
        }
        let other = TURN - half;
        let levels = [-other - 2.0 * half, -other, -half, half, other, other + 2.0 * half];
        let mut passed = [None; 2];
        for (count, level) in levels.into_iter().filter(|level| *level >= low && *level <= high).enumerate() {
            let clear = (a - level).abs() >= self.band && (d - level).abs() >= self.band;
            if !clear || (a < level) == (d < level) || count == 2 {
                return Course::Unclear;
            }
            passed[count] = Some(level);
        }
        let inside = (a >= -half && a < half)
            || (a >= other && a < other + 2.0 * half)
            || (a >= -other - 2.0 * half && a < -other);
        Course::Crosses(passed, inside)
    }
}

impl Arcs {
    /// The feasible parts of a curve.
    pub fn new(walk: &Walk<'_>, sheet: &Sheet, limits: &Limits) -> Self {
        let mut arcs = Self { parts: [Vec::new(), Vec::new()] };
        visit(walk, sheet, limits, &mut |shoulder, part| arcs.parts[shoulder].push(part));
        for parts in &mut arcs.parts {
            parts.sort_by(|a, b| a.a.u.total_cmp(&b.a.u));
        }
        arcs
    }

    /// True when nothing holds the limits.
    pub fn is_empty(&self) -> bool {
        self.parts.iter().all(Vec::is_empty)
    }

    /// The feasible intervals of one shoulder.
    pub fn of(&self, shoulder: usize) -> Vec<[f64; 2]> {
        let mut out: Vec<[f64; 2]> = Vec::new();
        for part in &self.parts[shoulder] {
            let (lo, hi) = (part.a.u, part.b.u);
            match out.last_mut() {
                Some(last) if last[1] >= lo => last[1] = last[1].max(hi),
                _ => out.push([lo, hi]),
            }
        }
        // Around the end of the parameter.
        let joins =
            out.first().is_some_and(|first| first[0] <= -PI) && out.last().is_some_and(|l| l[1] >= PI);
        if out.len() == 1 && joins {
            return vec![[-PI, PI]];
        }
        if joins && let Some(last) = out.pop() {
            let first = out[0];
            out.remove(0);
            out.push([last[0], first[1] + TURN]);
        }
        out
    }
}

/// Gives the feasible parts of a curve, with their shoulder, to `take`; allocates nothing.
pub(super) fn visit(walk: &Walk<'_>, sheet: &Sheet, limits: &Limits, take: &mut impl FnMut(usize, Part)) {
    if limits.half.iter().any(|half| *half < 0.0) {
        return;
    }
    let at = |k: usize| TURN * k as f64 / PARTS as f64 - PI;
    let mut last = walk.node(sheet, -PI);
    let first = last;
    // Parts in ascending order, each with the shoulders that are not decided: three more with every division.
    let mut stack = SmallVec::<[(Node, Node, [bool; 2]); 64]>::new();
    for k in (0..PARTS).step_by(4) {
        let [a, b, c, d] = walk.nodes(sheet, [1, 2, 3, 4].map(|i| at(k + i)));
        let d = if k + 4 == PARTS { Node { u: PI, ..first } } else { d };
        for pair in [[c, d], [b, c], [a, b], [last, a]] {
            stack.push((pair[0], pair[1], [true; 2]));
        }
        last = d;
        while let Some((a, b, open)) = stack.pop() {
            let mut unclear = [false; 2];
            for s in (0..2).filter(|s| open[*s]) {
                match verdict(limits, &End::of(&a, s), &End::of(&b, s)) {
                    Verdict::Dropped => {}
                    Verdict::Kept => take(s, Part { a: End::of(&a, s), b: End::of(&b, s) }),
                    Verdict::Crossed(crossings, inside) => {
                        cross(walk, sheet, limits, s, [&a, &b], crossings, inside, take);
                    }
                    Verdict::Unclear => unclear[s] = true,
                }
            }
            if unclear == [false; 2] {
                continue;
            }
            if b.u - a.u <= ARC_SHORTEST {
                for s in (0..2).filter(|s| unclear[*s]) {
                    shortest(limits, s, &End::of(&a, s), &End::of(&b, s), take);
                }
                continue;
            }
            let (m, quarter) = (0.5 * (a.u + b.u), 0.25 * (b.u - a.u));
            let [l, m, r, _] = walk.nodes(sheet, [m - quarter, m, m + quarter, m]);
            stack.extend([(r, b, unclear), (m, r, unclear), (l, m, unclear), (a, l, unclear)]);
        }
    }
}

/// What is feasible between two nodes at which the joints of `crossings` pass a limit; bit i of `inside`: joint i is inside
/// at the beginning.
fn cross(
    walk: &Walk<'_>,
    sheet: &Sheet,
    limits: &Limits,
    shoulder: usize,
    [a, b]: [&Node; 2],
    mut crossings: Crossings,
    mut inside: u8,
    take: &mut impl FnMut(usize, Part),
) {
    let mut nodes = SmallVec::<[(Node, usize); 14]>::new();
    crossings.sort_unstable_by(|x, y| x.u.total_cmp(&y.u));
    let involved = crossings.iter().fold(0u8, |mask, c| mask | 1 << c.joint);
    for crossing in &crossings {
        nodes.push((root(walk, sheet, shoulder, [a, b], crossing), crossing.joint));
    }
    nodes.sort_unstable_by(|x, y| x.0.u.total_cmp(&y.0.u));
    let mut from = *a;
    let mut feasible = inside & involved == involved;
    for (node, joint) in nodes {
        if feasible {
            take(shoulder, Part { a: End::of(&from, shoulder), b: End::of(&node, shoulder) });
        }
        inside ^= 1 << joint;
        let after = inside & involved == involved;
        if !feasible && !after && limits.margin(&node.q[shoulder]) >= -LIMIT_SLACK {
            let end = End::of(&node, shoulder);
            take(shoulder, Part { a: end, b: end });
        }
        (from, feasible) = (node, after);
    }
    if feasible {
        take(shoulder, Part { a: End::of(&from, shoulder), b: End::of(b, shoulder) });
    }
}

/// Decides a part that cannot be divided further by its ends. Where the shoulder passes its gimbal joints jump, and an arc
/// ends.
#[cold]
fn shortest(limits: &Limits, shoulder: usize, a: &End, b: &End, take: &mut impl FnMut(usize, Part)) {
    let jump = (0..7).any(|i| difference(a.q[i], b.q[i]).abs() > ARC_COARSE);
    let [first, last] = [a, b].map(|end| limits.margin(&end.q) >= -LIMIT_SLACK);
    if first && last && !jump {
        take(shoulder, Part { a: *a, b: *b });
    } else if first || last {
        let end = if first { *a } else { *b };
        take(shoulder, Part { a: end, b: end });
    }
}

/// What the joints do between two ends.
fn verdict(limits: &Limits, a: &End, b: &End) -> Verdict {
    let h = b.u - a.u;
    let steps = Steps::new(a, b);
    let (mut unclear, mut inside) = (false, 0u8);
    let mut crossings = Crossings::new();
    for i in [3, 5, 1, 4, 6, 0, 2] {
        let half = limits.half[i];
        if half >= PI {
            continue;
        }
        let start = wrap(a.q[i] - limits.center[i]);
        match Cubic::new(start, &steps, i, a, b).course(half) {
            Course::Inside => {}
            Course::Outside => return Verdict::Dropped,
            Course::Unclear => unclear = true,
            Course::Crosses([None, _], false) => return Verdict::Dropped,
            Course::Crosses(levels, is_inside) => {
                inside |= u8::from(is_inside) << i;
                for level in levels.into_iter().flatten() {
                    let u = a.u + h * ((level - start) / steps.step[i]).clamp(0.0, 1.0);
                    crossings.push(Crossing { joint: i, at: level + limits.center[i], u });
                }
            }
        }
    }
    if unclear {
        Verdict::Unclear
    } else if crossings.is_empty() {
        Verdict::Kept
    } else {
        Verdict::Crossed(crossings, inside)
    }
}

/// The point between two nodes at which a joint passes a value: Newton's method within brackets.
fn root(walk: &Walk<'_>, sheet: &Sheet, shoulder: usize, [a, b]: [&Node; 2], crossing: &Crossing) -> Node {
    let i = crossing.joint;
    let miss = |node: &Node| wrap(node.q[shoulder][i] - crossing.at);
    let (mut lo, mut hi) = (a.u, b.u);
    let rising = miss(b) > miss(a);
    let mut node = walk.node(sheet, crossing.u);
    for _ in 0..ROOT_STEPS {
        let value = miss(&node);
        if (value < 0.0) == rising {
            lo = node.u
        } else {
            hi = node.u
        }
        let newton = node.u - value / node.rate[shoulder][i];
        let next = if newton > lo && newton < hi { newton } else { 0.5 * (lo + hi) };
        if value == 0.0 || (next - node.u).abs() <= 2.0 * f64::EPSILON || next <= lo || next >= hi {
            break;
        }
        node = walk.node(sheet, next);
    }
    node
}
