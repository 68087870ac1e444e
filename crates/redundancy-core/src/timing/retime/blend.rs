//! Corners that the arm passes without a stop.
//!
//! A corner is replaced by a quintic in joint space between a point before it and a point behind it. It meets the path
//! there with its first and second derivatives by the chord length, so that the whole has a continuous curvature. Both
//! points are as far from the corner as the tool may be from it, and at most half a leg away. A rotation of the tool
//! counts [`TURN_LENGTH`] per radian: a corner of the wrist alone is no reason to leave out half of a turn.
//!
//! Rows of the path that the curve replaces are rows on it, at the same share of the way. Corners stay stops where the
//! path turns back, where no curve stays within the position limits, and beside rows that repeat.

use super::settings::RetimeSettings;
use super::stretch::{Origin, Stretch};
use super::verify::Motion;
use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::Scratch;
use crate::pose::Pose;
use crate::tolerance::{RETIME_BLEND_PARTS, RETIME_BLEND_TRIALS, RETIME_BLEND_TURN, TURN_LENGTH};

/// A corner that is passed.
#[derive(Debug, Clone)]
pub(super) struct Blend {
    /// The row of the path.
    pub row: usize,
    /// How far the tool passes from it, m and rad.
    missed: [f64; 2],
}

impl Blend {
    /// The row and what an event says.
    pub fn report(&self) -> (usize, String) {
        let ([missed, turned], row) = (self.missed, self.row);
        let message = format!(
            "the arm passes the corner at row {row} of the path without a stop, {missed:.6} m and {turned:.6} rad from it"
        );
        (row, message)
    }
}

/// A motion over some legs, by how much it was slowed down evenly, and the corners that it passes.
pub(super) type Passed = (Motion, f64, Vec<Blend>);

/// Which legs are run through as one, in order: where each group ends, and its motion if it has more than one leg.
///
/// A corner is passed where that takes less time than a stop there: with limited jerk a short curve may take more. Corners
/// are compared one by one, each between its two legs, and then each group with its legs run one by one.
///
/// `solve` times a stretch that replaces the legs of a range.
pub(super) fn passed(
    chain: &Chain,
    legs: &[Option<Stretch>],
    alone: &[Option<(Motion, f64)>],
    settings: &RetimeSettings,
    solve: &dyn Fn(&Stretch, [usize; 2]) -> Result<(Motion, f64)>,
) -> Vec<(usize, Option<Passed>)> {
    let faster = |first: usize, behind: usize| {
        let mut stopping = 0.0;
        for leg in &alone[first..behind] {
            stopping += leg.as_ref()?.0.duration();
        }
        let (stretch, blends) = joined(chain, &legs[first..behind], settings)?;
        // Where the curve allows no motion at all the arm stops at the corner.
        let (motion, factor) = solve(&stretch, [first, behind]).ok()?;
        (motion.duration() < stopping).then_some((motion, factor, blends))
    };
    let mut groups = Vec::new();
    let mut first = 0;
    while first < legs.len() {
        let (mut behind, mut own) = (first + 1, None);
        while settings.blend > 0.0 && behind < legs.len() {
            let Some(pair) = faster(behind - 1, behind + 1) else { break };
            behind += 1;
            own = Some(pair);
        }
        if behind > first + 2 {
            own = faster(first, behind);
        }
        if own.is_some() || behind == first + 1 {
            groups.push((behind, own));
        } else {
            groups.extend((first + 1..=behind).map(|end| (end, None)));
        }
        first = behind;
    }
    groups
}

/// Legs with curves in place of all the corners between them.
fn joined(
    chain: &Chain,
    legs: &[Option<Stretch>],
    settings: &RetimeSettings,
) -> Option<(Stretch, Vec<Blend>)> {
    let mut tool = Tool { chain, scratch: Scratch::new(chain) };
    let (mut leg, mut from) = (legs.first()?.as_ref()?, None);
    let mut out = Joined::new(leg.n, settings.rows_between);
    let mut blends = Vec::new();
    for other in &legs[1..] {
        let other = other.as_ref()?;
        let (curve, blend) = Curve::new(&mut tool, [leg, other], settings.blend)?;
        let [to, next_from] = curve.ends(leg);
        out.leg(leg, [from, Some(to)]);
        out.curve(&curve);
        (leg, from) = (other, Some(next_from));
        blends.push(blend);
    }
    out.leg(leg, [from, None]);
    Some((out.finish(), blends))
}

/// Where the tool is.
struct Tool<'a> {
    chain: &'a Chain,
    scratch: Scratch,
}

impl Tool<'_> {
    fn pose(&mut self, q: &[f64]) -> Pose {
        *self.chain.kinematics_unchecked(q, &mut self.scratch).pose()
    }

    /// Distance of the tool from a pose, m and rad.
    fn from(&mut self, corner: &Pose, q: &[f64]) -> [f64; 2] {
        let pose = self.pose(q);
        let moved = (pose.translation.vector - corner.translation.vector).norm();
        [moved, pose.rotation.angle_to(&corner.rotation)]
    }

    /// How far from the corner along a leg the tool stays within a distance, at most half of the leg.
    fn reach(&mut self, corner: &Pose, leg: &Stretch, from_end: bool, blend: f64) -> f64 {
        let (length, most) = (leg.length(), 0.5 * leg.length());
        let place = |a: f64| if from_end { length - a } else { a };
        let mut within = |a: f64| length_of(self.from(corner, &leg.at(place(a))[0])) <= blend;
        let step = most / REACH_STEPS as f64;
        let Some(far) = (1..=REACH_STEPS).map(|i| step * i as f64).find(|a| !within(*a)) else {
            return most;
        };
        let (mut low, mut high) = (far - step, far);
        for _ in 0..REACH_BISECTIONS {
            let middle = 0.5 * (low + high);
            if within(middle) { low = middle } else { high = middle }
        }
        low
    }
}

/// Distance and rotation of the tool as one length, m.
fn length_of([moved, turned]: [f64; 2]) -> f64 {
    moved + TURN_LENGTH * turned
}

/// Places of half a leg at which the tool's distance from the corner is computed, and halvings of the interval in which it
/// passes the bound.
const REACH_STEPS: usize = 64;
const REACH_BISECTIONS: usize = 40;

/// Length of the curve between that of its chord and that of the way along both legs: of shares in tenths 0.7 has nearly the
/// least curvature at right angles, 1.2 times that of the arc that touches both legs at the same places, and at sharper ones.
const CHORD_SHARE: f64 = 0.7;

/// A curve in place of a corner.
struct Curve {
    /// What it replaces of both legs, rad of chord length.
    cut: [f64; 2],
    /// By the chord length.
    length: f64,
    /// Coefficients of the joints by powers of the share of the length.
    coefficients: Vec<[f64; 6]>,
    /// Inner nodes: shares of the length, and rows of the path that they stand for.
    nodes: Vec<(f64, Option<usize>)>,
}

impl Curve {
    fn new(tool: &mut Tool<'_>, legs: [&Stretch; 2], blend: f64) -> Option<(Self, Blend)> {
        let [before, after] = legs;
        let n = before.n;
        let corner_at = before.nodes() - 1;
        let row = before.origin[corner_at].row?;
        let arriving = &before.d[corner_at * n..];
        let (mut gap, mut sum) = (0.0_f64, 0.0_f64);
        for (a, b) in arriving.iter().zip(&after.d) {
            gap += (a - b).powi(2);
            sum += (a + b).powi(2);
        }
        if 2.0 * gap.sqrt().atan2(sum.sqrt()) > RETIME_BLEND_TURN {
            return None;
        }
        let corner = tool.pose(&before.q[corner_at * n..]);
        let mut reach =
            tool.reach(&corner, before, true, blend).min(tool.reach(&corner, after, false, blend));
        for _ in 0..RETIME_BLEND_TRIALS {
            let curve = Self::between(legs, [reach; 2]);
            if let Some(missed) = curve.missed(tool, &corner, blend) {
                return Some((curve, Blend { row, missed }));
            }
            reach *= 0.5;
        }
        None
    }

    /// The quintic that leaves the first leg `cut[0]` before its end and meets the second `cut[1]` behind its start.
    fn between([before, after]: [&Stretch; 2], cut: [f64; 2]) -> Self {
        let (start, end) = (before.at(before.length() - cut[0]), after.at(cut[1]));
        let n = before.n;
        let chord = (0..n).map(|j| (end[0][j] - start[0][j]).powi(2)).sum::<f64>().sqrt();
        let way = cut[0] + cut[1];
        let length = CHORD_SHARE * chord + (1.0 - CHORD_SHARE) * way;
        let coefficients = (0..n)
            .map(|j| {
                let [rise, va, vb] = [end[0][j] - start[0][j], start[1][j] * length, end[1][j] * length];
                let [aa, ab] = [start[2][j], end[2][j]].map(|a| a * length * length);
                let (e, f, g) = (rise - va - 0.5 * aa, vb - va - aa, ab - aa);
                [
                    start[0][j],
                    va,
                    0.5 * aa,
                    10.0 * e - 4.0 * f + 0.5 * g,
                    -15.0 * e + 7.0 * f - g,
                    6.0 * e - 3.0 * f + 0.5 * g,
                ]
            })
            .collect();
        let mut curve = Self { cut, length, coefficients, nodes: Vec::new() };
        let [to, from] = curve.ends(before);
        let rows = |leg: &Stretch| -> Vec<(f64, usize)> {
            leg.s.iter().zip(&leg.origin).filter_map(|(s, origin)| Some((*s, origin.row?))).collect()
        };
        let mut nodes: Vec<(f64, Option<usize>)> = rows(before)
            .into_iter()
            .filter(|(s, _)| *s > to.at + to.close())
            .map(|(s, row)| ((s - to.at) / way, Some(row)))
            .collect();
        // The corner is the last row of the first leg.
        nodes.extend(
            rows(after)
                .into_iter()
                .skip(1)
                .filter(|(s, _)| *s < from.at - from.close())
                .map(|(s, row)| ((cut[0] + s) / way, Some(row))),
        );
        let parts = RETIME_BLEND_PARTS as f64;
        for k in 1..RETIME_BLEND_PARTS {
            let u = k as f64 / parts;
            if nodes.iter().all(|(own, row)| row.is_none() || (own - u).abs() > 0.5 / parts) {
                nodes.push((u, None));
            }
        }
        nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
        curve.nodes = nodes;
        curve
    }

    /// Where it leaves the first leg and meets the second.
    fn ends(&self, before: &Stretch) -> [LegEnd; 2] {
        let spacing = self.spacing();
        [LegEnd { at: before.length() - self.cut[0], spacing }, LegEnd { at: self.cut[1], spacing }]
    }

    /// Distance between two nodes.
    fn spacing(&self) -> f64 {
        self.length / RETIME_BLEND_PARTS as f64
    }

    /// The joints and their first two derivatives by the length at a share of it.
    fn at(&self, u: f64) -> [Vec<f64>; 3] {
        let l = self.length;
        let value = |[c0, c1, c2, c3, c4, c5]: &[f64; 6]| {
            [
                c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5)))),
                (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / l,
                (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (l * l),
            ]
        };
        let values: Vec<[f64; 3]> = self.coefficients.iter().map(value).collect();
        std::array::from_fn(|order| values.iter().map(|v| v[order]).collect())
    }

    /// How far the tool passes from the corner, m and rad; `None` where the curve is nowhere within the distance, leaves it,
    /// or leaves the position limits.
    fn missed(&self, tool: &mut Tool<'_>, corner: &Pose, blend: f64) -> Option<[f64; 2]> {
        let mut nearest: Option<[f64; 2]> = None;
        for k in 0..=2 * RETIME_BLEND_PARTS {
            let q = &self.at(k as f64 / (2 * RETIME_BLEND_PARTS) as f64)[0];
            let distance = tool.from(corner, q);
            let limits = tool.chain.joints().iter().map(|joint| &joint.limits);
            let held = limits.zip(q).all(|(limits, q)| (limits.lower..=limits.upper).contains(q));
            if !held || length_of(distance) > blend * (1.0 + ROUNDING) {
                return None;
            }
            if nearest.is_none_or(|nearest| length_of(distance) < length_of(nearest)) {
                nearest = Some(distance);
            }
        }
        nearest
    }
}

/// Relative excess of the distance at the ends of a curve that rounding explains.
const ROUNDING: f64 = 1e-9;

/// Where a curve takes over from a leg.
#[derive(Debug, Clone, Copy)]
struct LegEnd {
    /// Length along the leg.
    at: f64,
    /// Distance between two nodes of the curve.
    spacing: f64,
}

impl LegEnd {
    /// A row this near is the node at the end itself.
    fn close(&self) -> f64 {
        CLOSE * self.spacing
    }
}

/// Share of the spacing on a curve within which two nodes are one: the curve leaves the leg by the cube of that.
const CLOSE: f64 = 1e-3;

/// Legs and curves in a row.
struct Joined {
    out: Stretch,
    /// Length so far.
    end: f64,
    /// Whether nodes may be added between the rows of legs.
    nodes_between: bool,
}

impl Joined {
    fn new(n: usize, nodes_between: bool) -> Self {
        Self { out: Stretch::empty(n), end: 0.0, nodes_between }
    }

    /// A leg between two ends, its own where there is none. Next to a curve the distances between its nodes grow gradually.
    fn leg(&mut self, leg: &Stretch, ends: [Option<LegEnd>; 2]) {
        let [from, to] = [ends[0].map_or(0.0, |end| end.at), ends[1].map_or(leg.length(), |end| end.at)];
        let [before, behind] = [(ends[0], from, 1.0), (ends[1], to, -1.0)];
        // How far a node is inside, seen from an end.
        let beyond =
            |s: f64, (end, at, sign): (Option<LegEnd>, f64, f64)| end.map(|end| (sign * (s - at), end));
        let mut nodes: Vec<(f64, Origin)> = Vec::new();
        for (s, origin) in leg.s.iter().zip(&leg.origin) {
            let held = |side| match beyond(*s, side) {
                None => true,
                Some((inside, end)) if origin.row.is_some() => inside >= -end.close(),
                Some((inside, end)) => inside > GRADED_GAP * end.spacing,
            };
            if held(before) && held(behind) {
                nodes.push((*s, *origin));
            }
        }
        for side in [before, behind] {
            let Some((end, at)) = side.0.map(|end| (end, side.1)) else { continue };
            if nodes.iter().all(|(s, _)| (s - at).abs() > end.close()) {
                nodes.push((at, Origin::BETWEEN));
                nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
            }
            if self.nodes_between {
                grade(&mut nodes, at, side.2, end.spacing);
            }
        }
        let shift = self.end - from;
        for (s, origin) in nodes {
            let k = leg.s.partition_point(|node| *node < s);
            // A node of the leg keeps its bits.
            if leg.s.get(k) == Some(&s) {
                let own = k * leg.n..(k + 1) * leg.n;
                let [q, d, dd] = [&leg.q, &leg.d, &leg.dd].map(|values| &values[own.clone()]);
                self.out.push(s + shift, origin, q, d, dd);
                continue;
            }
            let [q, d, dd] = leg.at(s);
            self.out.push(s + shift, origin, &q, &d, &dd);
        }
        self.end += to - from;
    }

    fn curve(&mut self, curve: &Curve) {
        for (u, row) in &curve.nodes {
            let origin = Origin { row: *row, blended: true };
            let [q, d, dd] = curve.at(*u);
            self.out.push(self.end + u * curve.length, origin, &q, &d, &dd);
        }
        self.end += curve.length;
    }

    /// With the third derivatives between nodes.
    fn finish(mut self) -> Stretch {
        let (n, out) = (self.out.n, &mut self.out);
        for k in 0..out.nodes() - 1 {
            let h = out.s[k + 1] - out.s[k];
            for j in 0..n {
                out.ddd.push((out.dd[(k + 1) * n + j] - out.dd[k * n + j]) / h);
            }
        }
        self.out
    }
}

/// Share of the spacing on a curve up to which a node between rows is left out next to it.
const GRADED_GAP: f64 = 0.3;

/// Adds nodes at growing distances from a place, from `spacing` on, until the nodes are as far apart anyway.
fn grade(nodes: &mut Vec<(f64, Origin)>, place: f64, sign: f64, spacing: f64) {
    let mut distance = spacing;
    let mut step = spacing;
    loop {
        let s = place + sign * distance;
        let k = nodes.partition_point(|(node, _)| *node < s);
        let Some(((low, _), (high, _))) = k.checked_sub(1).and_then(|k| nodes.get(k)).zip(nodes.get(k))
        else {
            return;
        };
        if high - low <= step {
            return;
        }
        if (s - low).min(high - s) > GRADED_GAP * step {
            nodes.insert(k, (s, Origin::BETWEEN));
        }
        step *= 2.0;
        distance += step;
    }
}
