//! A motion as it is returned, and how near it comes to its limits between its rows.

use super::extremes::{cubic, quadratic, quartic};
use super::node_limits::{FAR_BELOW, NodeLimits};
use super::settings::RetimeSettings;
use super::stretch::Origin;
use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::{DynamicsScratch, Scratch};
use crate::path::Section;
use crate::tolerance::{RETIME_DWELL, TORQUE_LEFT};

/// Into how many parts an interval is cut at most, and at first, where torques or the tool's speed are checked.
const PARTS: usize = 16;
const FIRST_PARTS: usize = 2;

/// Parts of a whole section, at least: a quintic over a long interval bends between places that are far apart.
const PARTS_IN_ALL: usize = 2_000;

/// How far, as a share of the acceleration limits, the cubic of an interval may be from the law of the nodes where nothing
/// but that law is asked about torques.
const OFF_LAW: f64 = 0.01;

/// How far a parabola through three places may rise above them and still be believed, as a share of the limit: its error is
/// a tenth of that.
const BELIEVED_RISE: f64 = 1e-4;

/// What kind of limit binds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LimitKind {
    /// Speed of a joint.
    Velocity,
    /// Acceleration of a joint.
    Acceleration,
    /// Jerk of a joint.
    Jerk,
    /// Torque of a joint.
    Torque,
    /// Speed of the tool.
    ToolSpeed,
}

impl LimitKind {
    /// The kind as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::Torque => "torque",
            Self::ToolSpeed => "tool_speed",
        }
    }
}

/// The limit that a row comes nearest to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limiting {
    /// Of which kind.
    pub kind: LimitKind,
    /// The joint, from 0; `None` for the tool.
    pub joint: Option<usize>,
    /// The value as a share of its limit.
    pub share: f64,
}

/// Rows with times.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    n: usize,
    /// Accelerations are continuous: the interpolation is of fifth degree, else of third.
    smooth: bool,
    pub t: Vec<f64>,
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub qdd: Vec<f64>,
    origin: Vec<Origin>,
    /// Torques of the motion and of gravity, by row and joint; empty where they are not known.
    torques: Vec<[f64; 2]>,
}

/// Value and derivatives of one joint at a place of an interval.
type Local = [f64; 4];

impl Motion {
    pub fn new(n: usize, smooth: bool) -> Self {
        let [t, q, qd, qdd] = std::array::from_fn(|_| Vec::new());
        Self { n, smooth, t, q, qd, qdd, origin: Vec::new(), torques: Vec::new() }
    }

    /// The same with room for so many rows.
    pub fn with_room(n: usize, smooth: bool, rows: usize) -> Self {
        let [q, qd, qdd] = std::array::from_fn(|_| Vec::with_capacity(rows * n));
        let (t, origin) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
        Self { n, smooth, t, q, qd, qdd, origin, torques: Vec::new() }
    }

    pub fn push(&mut self, t: f64, q: &[f64], qd: &[f64], qdd: &[f64], origin: Origin) {
        self.t.push(t);
        self.q.extend_from_slice(q);
        self.qd.extend_from_slice(qd);
        self.qdd.extend_from_slice(qdd);
        self.origin.push(origin);
    }

    pub fn duration(&self) -> f64 {
        self.t.last().copied().unwrap_or(0.0)
    }

    /// Exactly at rest at both ends.
    pub fn rest_at_ends(&mut self) {
        let (n, rows) = (self.n, self.t.len());
        for values in [&mut self.qd, &mut self.qdd] {
            values[..n].fill(0.0);
            values[(rows - 1) * n..].fill(0.0);
        }
    }

    /// The same motion, slower by `factor`.
    pub fn slow_down(&mut self, factor: f64) {
        self.t.iter_mut().for_each(|t| *t *= factor);
        self.qd.iter_mut().for_each(|v| *v /= factor);
        self.qdd.iter_mut().for_each(|a| *a /= factor * factor);
        self.torques.iter_mut().for_each(|[moving, _]| *moving /= factor * factor);
    }

    /// Adds a stretch that begins where this one ends.
    pub fn append(&mut self, part: Self, path_rows: &mut Vec<usize>) {
        let n = self.n;
        let start = self.duration();
        if self.t.is_empty() {
            let rows = part.origin.iter().enumerate().filter(|(_, origin)| origin.row.is_some());
            path_rows.extend(rows.map(|(k, _)| k));
            *self = part;
            return;
        }
        if !part.torques.is_empty() {
            self.torques.truncate((self.t.len() - 1) * n);
        }
        self.torques.extend_from_slice(&part.torques);
        for k in 0..part.t.len() {
            let at = k * n..(k + 1) * n;
            if k == 0 {
                // The row is there already; without jerk limits its acceleration is the one after it.
                let from = self.qdd.len() - n;
                self.qdd[from..].copy_from_slice(&part.qdd[at]);
                continue;
            }
            if let Some(row) = part.origin[k].row {
                debug_assert_eq!(row, path_rows.len());
                path_rows.push(self.t.len());
            }
            self.push(
                start + part.t[k],
                &part.q[at.clone()],
                &part.qd[at.clone()],
                &part.qdd[at],
                part.origin[k],
            );
        }
    }

    /// Two equal rows: the arm waits for the shortest time.
    pub fn dwell(&mut self, from: &[f64], to: &[f64], path_rows: &mut Vec<usize>) {
        let zero = vec![0.0; self.n];
        if self.t.is_empty() {
            path_rows.push(0);
            self.push(0.0, from, &zero, &zero, Origin::path(0));
            self.torques.resize(self.n, [0.0; 2]);
        }
        // At rest the motion needs no torque.
        self.torques.resize(self.torques.len() + self.n, [0.0; 2]);
        let t = self.duration() + RETIME_DWELL;
        let row = path_rows.len();
        path_rows.push(self.t.len());
        self.push(t, to, &zero, &zero, Origin::path(row));
    }

    /// Coefficients of joint `j` by powers of the place in interval `k` of length `h`.
    fn coefficients(&self, k: usize, j: usize, h: f64) -> [f64; 6] {
        let (a, b) = (k * self.n + j, (k + 1) * self.n + j);
        let (rise, va, vb) = (self.q[b] - self.q[a], self.qd[a] * h, self.qd[b] * h);
        if !self.smooth {
            return [self.q[a], va, 3.0 * rise - 2.0 * va - vb, va + vb - 2.0 * rise, 0.0, 0.0];
        }
        let (aa, ab) = (self.qdd[a] * h * h, self.qdd[b] * h * h);
        let (c2, e) = (0.5 * aa, rise - va - 0.5 * aa);
        let (f, g) = (vb - va - aa, ab - aa);
        let high = [10.0 * e - 4.0 * f + 0.5 * g, -15.0 * e + 7.0 * f - g, 6.0 * e - 3.0 * f + 0.5 * g];
        [self.q[a], va, c2, high[0], high[1], high[2]]
    }

    /// Position and derivatives of all joints at `u` in [0, 1] of interval `k`.
    fn local(&self, k: usize, u: f64, out: &mut [Local]) {
        let h = self.t[k + 1] - self.t[k];
        for (j, out) in out.iter_mut().enumerate() {
            let [c0, c1, c2, c3, c4, c5] = self.coefficients(k, j, h);
            *out = [
                c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5)))),
                (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / h,
                (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (h * h),
                (6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5)) / (h * h * h),
            ];
        }
    }

    /// Per interval: the factor on time that brings it within all limits, `floor` where that is less. Intervals that are as
    /// they were in a motion that was judged before are not judged again.
    pub fn excess(
        &mut self,
        chain: &Chain,
        settings: &RetimeSettings,
        floor: f64,
        before: Option<(&Self, &[f64])>,
        nodes: Option<NodeTorques<'_>>,
    ) -> Result<Vec<f64>> {
        let mut gauge = Gauge::new(chain, settings)?;
        let intervals = self.t.len().saturating_sub(1);
        let finest = PARTS.max((PARTS_IN_ALL / intervals.max(1)).next_power_of_two());
        let mut places = Places::new(self.n, finest);
        self.torques.clear();
        if settings.torque_limits.is_some() {
            self.torques.resize(self.t.len() * self.n, [0.0; 2]);
        }
        let mut out = Vec::with_capacity(intervals);
        for k in 0..intervals {
            if let Some((other, excess)) = before
                && self.moves_alike(other, k)
            {
                out.push(excess[k]);
                let at = k * self.n..(k + 2) * self.n;
                if let (Some(own), Some(old)) = (self.torques.get_mut(at.clone()), other.torques.get(at)) {
                    own.copy_from_slice(old);
                }
                continue;
            }
            let joints = self.joint_factor(k, &gauge.inverse, floor);
            let far_below = match nodes {
                _ if !gauge.needs_places() => true,
                Some(nodes) => {
                    let calm = self.keeps_to_law(k, settings) && nodes.far_below(k, settings);
                    self.torques_at_rows(k, nodes);
                    calm || self.far_below(k, nodes, &mut gauge, &mut places)
                }
                None => false,
            };
            out.push(if far_below {
                joints
            } else {
                self.sampled_factor(k, joints, &mut gauge, &mut places)
            });
        }
        Ok(out)
    }

    /// Whether interval `k` is the same as in another motion along the same nodes.
    fn moves_alike(&self, other: &Self, k: usize) -> bool {
        let at = k * self.n..(k + 2) * self.n;
        self.qd[at.clone()] == other.qd[at.clone()] && self.qdd[at.clone()] == other.qdd[at]
    }

    /// The factor that velocity, acceleration and jerk of the joints ask for in interval `k`, at least `floor`.
    fn joint_factor(&self, k: usize, inverse: &[Vec<f64>; 3], floor: f64) -> f64 {
        let (n, h) = (self.n, self.t[k + 1] - self.t[k]);
        if !self.smooth {
            return self.cubic_factor(k, inverse, floor);
        }
        let units = [1.0 / h, 1.0 / (h * h), 1.0 / (h * h * h)];
        let mut most = [floor, floor * floor, floor * floor * floor];
        for j in 0..n {
            let scale: [f64; 3] = std::array::from_fn(|order| units[order] * inverse[order][j]);
            let [_, c1, c2, c3, c4, c5] = self.coefficients(k, j, h);
            if scale[0] > 0.0 {
                let speed = [c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 5.0 * c5];
                most[0] = most[0].max(quartic(speed, most[0] / scale[0]) * scale[0]);
            }
            if scale[1] > 0.0 {
                let acceleration = [2.0 * c2, 6.0 * c3, 12.0 * c4, 20.0 * c5];
                most[1] = most[1].max(cubic(acceleration, most[1] / scale[1]) * scale[1]);
            }
            if scale[2] > 0.0 {
                most[2] = most[2].max(quadratic([6.0 * c3, 24.0 * c4, 60.0 * c5]) * scale[2]);
            }
        }
        most[0].max(most[1].sqrt()).max(most[2].cbrt())
    }

    /// The same for the cubics of a motion whose jerk has no limits.
    fn cubic_factor(&self, k: usize, inverse: &[Vec<f64>; 3], floor: f64) -> f64 {
        let (n, h) = (self.n, self.t[k + 1] - self.t[k]);
        let per_time = 1.0 / h;
        let (mut speed, mut acceleration) = (floor, floor * floor);
        let both = k * n..(k + 2) * n;
        let [(a, b), (va, vb)] = [&self.q, &self.qd].map(|values| values[both.clone()].split_at(n));
        let (q, qd) = (a.iter().zip(b), va.iter().zip(vb));
        for ((a, b), ((va, vb), (per_speed, per_acceleration))) in
            q.zip(qd.zip(inverse[0].iter().zip(&inverse[1])))
        {
            let rise = (b - a) * per_time;
            let [c2, c3] = [3.0 * rise - 2.0 * va - vb, va + vb - 2.0 * rise];
            // Bernstein coefficients bound the speed between the rows.
            let bound = va.abs().max(vb.abs()).max((va + c2).abs());
            if bound * per_speed > speed {
                speed = speed.max(quadratic([*va, 2.0 * c2, 3.0 * c3]) * per_speed);
            }
            let largest = (2.0 * c2).abs().max((2.0 * c2 + 6.0 * c3).abs());
            acceleration = acceleration.max(largest * per_time * per_acceleration);
        }
        speed.max(acceleration.sqrt())
    }

    /// Whether the accelerations at the beginning of interval `k`, as its cubic has them, are those of the law of the nodes.
    fn keeps_to_law(&self, k: usize, settings: &RetimeSettings) -> bool {
        let (n, h) = (self.n, self.t[k + 1] - self.t[k]);
        (0..n).all(|j| {
            let (a, b) = (k * n + j, (k + 1) * n + j);
            let rise = self.q[b] - self.q[a];
            let off = 6.0 * rise - h * (4.0 * self.qd[a] + 2.0 * self.qd[b] + h * self.qdd[a]);
            let limit = settings.acceleration_limits[j];
            let scale = if limit.is_finite() { limit } else { self.qdd[a].abs() };
            off.abs() <= OFF_LAW * scale * h * h
        })
    }

    /// Keeps the torques of the nodes' law at the row before interval `k`, and at the last row.
    fn torques_at_rows(&mut self, k: usize, nodes: NodeTorques<'_>) {
        for node in [k, k + 1] {
            if node == k || node + 1 == self.t.len() {
                for i in node * self.n..(node + 1) * self.n {
                    self.torques[i] = nodes.torque(k, node, i);
                }
            }
        }
    }

    /// Whether the torques in interval `k` are far below their limits by what the nodes say at its ends and one look between
    /// them.
    fn far_below(
        &mut self,
        k: usize,
        nodes: NodeTorques<'_>,
        gauge: &mut Gauge<'_>,
        places: &mut Places,
    ) -> bool {
        let Some(limits) = &gauge.settings.torque_limits else { return false };
        let (n, finest, width) = (self.n, places.finest, 2 * self.n + 1);
        for (node, place) in [(k, 0), (k + 1, finest)] {
            let out = &mut places.values[place * width..][..width];
            for (j, limit) in limits.iter().enumerate() {
                let [moving, gravity] = nodes.torque(k, node, node * n + j);
                [out[1 + 2 * j], out[2 + 2 * j]] = torque_shares(*limit, moving, gravity);
            }
        }
        self.fill(k, finest / 2, gauge, places);
        let (most, believed) = places.parabolas(finest / 2, FAR_BELOW);
        believed && most <= FAR_BELOW
    }

    /// The factor that torques and the tool's speed ask for in interval `k`, at least `floor`. Parabolas through three places
    /// each stand for what is between them; where they bend much there are more of them.
    fn sampled_factor(&mut self, k: usize, floor: f64, gauge: &mut Gauge<'_>, places: &mut Places) -> f64 {
        let finest = places.finest;
        let mut stride = PARTS / FIRST_PARTS;
        (0..=finest / stride).for_each(|i| self.fill(k, i * stride, gauge, places));
        loop {
            let (most, believed) = places.parabolas(stride, floor * floor);
            if believed || stride == 1 {
                return most.sqrt();
            }
            stride /= 2;
            (0..finest / (2 * stride)).for_each(|i| self.fill(k, (2 * i + 1) * stride, gauge, places));
        }
    }

    /// The shares at one place of interval `k`; torques at rows are kept.
    fn fill(&mut self, k: usize, place: usize, gauge: &mut Gauge<'_>, places: &mut Places) {
        let (n, finest) = (self.n, places.finest);
        self.local(k, place as f64 / finest as f64, &mut places.local);
        gauge.sample(&places.local, &mut places.values[place * (2 * n + 1)..][..2 * n + 1]);
        let row = if place == 0 { k } else { k + 1 };
        let at_row = place == 0 || (place == finest && k + 2 == self.t.len());
        if let (true, Some(torques)) = (at_row, self.torques.get_mut(row * n..(row + 1) * n)) {
            for (out, (moving, gravity)) in torques.iter_mut().zip(gauge.moving.iter().zip(&gauge.gravity)) {
                *out = [*moving, *gravity];
            }
        }
    }

    /// To which part of the path each row belongs.
    pub fn sections(&self) -> Vec<Section> {
        let section = |origin: &Origin| if origin.blended { Section::Blend } else { Section::Path };
        self.origin.iter().map(section).collect()
    }

    /// Position and derivatives of all joints at row `k`, in the interval behind it if there is one. Without jerk limits the
    /// third derivative is not asked for and is 0.
    fn at_row(&self, k: usize, out: &mut [Local]) {
        let (n, last) = (self.n, self.t.len() - 1);
        let (interval, u) = if k < last { (k, 0.0) } else { (last - 1, 1.0) };
        if self.smooth {
            return self.local(interval, u, out);
        }
        let per_time = 1.0 / (self.t[interval + 1] - self.t[interval]);
        // From this row and the one at the other end of the interval.
        let other = if k < last { k + 1 } else { k - 1 };
        let sign = if k < last { per_time } else { -per_time };
        for (j, out) in out.iter_mut().enumerate() {
            let [(a, va), (b, vb)] = [k, other].map(|row| (self.q[row * n + j], self.qd[row * n + j]));
            *out = [a, va, (6.0 * (b - a) * sign - 4.0 * va - 2.0 * vb) * sign, 0.0];
        }
    }

    /// The limit that each row comes nearest to.
    pub fn limiting(&self, chain: &Chain, settings: &RetimeSettings) -> Result<Vec<Option<Limiting>>> {
        let mut gauge = Gauge::new(chain, settings)?;
        let (n, last) = (self.n, self.t.len() - 1);
        let mut local = vec![[0.0; 4]; n];
        let known = self.torques.len() == self.t.len() * n;
        Ok((0..=last)
            .map(|k| {
                if last == 0 {
                    return None;
                }
                self.at_row(k, &mut local);
                gauge.nearest(&local, if known { self.torques.get(k * n..(k + 1) * n) } else { None })
            })
            .collect())
    }

    /// Rows every `dt` and the last one; the path's own rows are the nearest ones.
    pub fn resampled(&self, dt: f64, path_rows: &mut [usize]) -> Self {
        let mut out = Self::new(self.n, self.smooth);
        let end = self.duration();
        let steps = (end / dt - 1e-9).ceil().max(1.0) as usize;
        let (mut local, mut k) = (vec![[0.0; 4]; self.n], 0);
        for step in 0..=steps {
            let t = if step == steps { end } else { step as f64 * dt };
            while k + 2 < self.t.len() && self.t[k + 1] <= t {
                k += 1;
            }
            let u = ((t - self.t[k]) / (self.t[k + 1] - self.t[k])).clamp(0.0, 1.0);
            self.local(k, u, &mut local);
            let column = |c: usize| local.iter().map(|l| l[c]).collect::<Vec<f64>>();
            let after = self.origin[(k + 1).min(self.t.len() - 1)].blended && u > 0.0;
            let blended = self.origin[k].blended || after;
            out.push(t, &column(0), &column(1), &column(2), Origin { row: None, blended });
        }
        for row in path_rows.iter_mut() {
            *row = ((self.t[*row] / dt).round() as usize).min(steps);
        }
        out
    }
}

/// What the nodes of a stretch say about torques: the limits there, and the law `[u, x]` from each node on.
#[derive(Clone, Copy)]
pub(super) struct NodeTorques<'a> {
    pub limits: &'a NodeLimits,
    pub law: &'a [[f64; 2]],
}

impl NodeTorques<'_> {
    /// Whether the law alone says that the torques in interval `k` are far below their limits.
    fn far_below(&self, k: usize, settings: &RetimeSettings) -> bool {
        let Some(torque) = &settings.torque_limits else { return true };
        let x = [self.law[k][1], self.law[k + 1][1]];
        self.limits.calm[k] || self.limits.far_below(torque.len(), k, self.law[k][0], x, torque)
    }

    /// Torques of the motion and of gravity at a node of interval `k`; `i` counts nodes and joints.
    fn torque(&self, k: usize, node: usize, i: usize) -> [f64; 2] {
        let (u, x) = (self.law[k][0], self.law[node][1]);
        [self.limits.inertial[i] * u + self.limits.dynamic[i] * x, self.limits.gravity[i]]
    }
}

/// Torque of the motion over what gravity leaves of the limit, upwards and downwards.
fn torque_shares(limit: f64, moving: f64, gravity: f64) -> [f64; 2] {
    let [up, down] = [-1.0, 1.0].map(|sign| (limit + sign * gravity).max(limit * TORQUE_LEFT));
    [moving / up, -moving / down]
}

/// What is asked at places of an interval: shares of the limits whose square root is a factor on time, by place.
struct Places {
    n: usize,
    /// Into how many parts an interval is cut at most.
    finest: usize,
    local: Vec<Local>,
    values: Vec<f64>,
}

impl Places {
    fn new(n: usize, finest: usize) -> Self {
        let values = vec![0.0; (finest + 1) * (2 * n + 1)];
        Self { n, finest, local: vec![[0.0; 4]; n], values }
    }

    /// The largest share by parabolas through places `stride` apart, at least `floor`, and whether they can be believed.
    fn parabolas(&self, stride: usize, floor: f64) -> (f64, bool) {
        let width = 2 * self.n + 1;
        let (mut most, mut believed) = (floor, true);
        for first in (0..self.finest).step_by(2 * stride) {
            let [a, b, c] = [0, 1, 2].map(|i| &self.values[(first + i * stride) * width..][..width]);
            for ((a, b), c) in a.iter().zip(b).zip(c) {
                let bend = a - 2.0 * b + c;
                let (top, rise) = (a.max(*b).max(*c), 0.125 * bend.abs());
                if top + 2.0 * rise <= most {
                    continue;
                }
                believed &= rise <= BELIEVED_RISE * top.max(1.0);
                let half = 0.5 * (c - a);
                let inside = bend < 0.0 && half.abs() < -bend;
                most = most.max(if inside { b - 0.5 * half * half / bend } else { top });
            }
        }
        (most, believed)
    }
}

/// How near a state comes to the limits.
struct Gauge<'a> {
    chain: &'a Chain,
    settings: &'a RetimeSettings,
    /// One over the limits of velocity, acceleration and jerk; 0 without one.
    inverse: [Vec<f64>; 3],
    scratch: Scratch,
    dynamics: DynamicsScratch,
    rows: [Vec<f64>; 3],
    gravity: Vec<f64>,
    moving: Vec<f64>,
}

impl<'a> Gauge<'a> {
    fn new(chain: &'a Chain, settings: &'a RetimeSettings) -> Result<Self> {
        let n = chain.dof();
        if settings.torque_limits.is_some() {
            chain.masses()?;
        }
        let none = vec![f64::INFINITY; n];
        let limits = [
            &settings.velocity_limits,
            &settings.acceleration_limits,
            settings.jerk_limits.as_ref().unwrap_or(&none),
        ];
        Ok(Self {
            chain,
            settings,
            inverse: limits.map(|limits| limits.iter().map(|limit| 1.0 / limit).collect()),
            scratch: Scratch::new(chain),
            dynamics: DynamicsScratch::new(chain),
            rows: std::array::from_fn(|_| vec![0.0; n]),
            gravity: vec![0.0; n],
            moving: vec![0.0; n],
        })
    }

    /// Whether there are limits that are no polynomials of the time.
    fn needs_places(&self) -> bool {
        self.settings.tool_speed.is_some() || self.settings.torque_limits.is_some()
    }

    /// Squared speed of the tool over that of its limit; 0 without one.
    fn tool_share(&mut self, local: &[Local]) -> f64 {
        let Some(speed) = self.settings.tool_speed else { return 0.0 };
        self.rows[0].iter_mut().zip(local).for_each(|(v, l)| *v = l[0]);
        let kinematics = self.chain.kinematics_unchecked(&self.rows[0], &mut self.scratch);
        let columns = kinematics.jacobian();
        let moved: nalgebra::Vector3<f64> =
            local.iter().enumerate().map(|(j, l)| columns.fixed_view::<3, 1>(0, j) * l[1]).sum();
        moved.norm_squared() / (speed * speed)
    }

    /// Torques of the motion and of gravity into `moving` and `gravity`.
    fn torques(&mut self, local: &[Local]) {
        let Ok(bodies) = self.chain.masses() else { return };
        for (order, row) in self.rows.iter_mut().enumerate() {
            row.iter_mut().zip(local).for_each(|(v, l)| *v = l[order]);
        }
        let state = [&self.rows[0][..], &self.rows[1][..], &self.rows[2][..]];
        let (gravity, moving) = (&mut self.gravity, &mut self.moving);
        self.chain.split_torques(bodies, state, &self.settings.gravity, &mut self.dynamics, gravity, moving);
    }

    /// Shares at a state: of the tool, then of the highest and the lowest torque of each joint.
    fn sample(&mut self, local: &[Local], out: &mut [f64]) {
        out[0] = self.tool_share(local);
        let settings = self.settings;
        let Some(limits) = &settings.torque_limits else { return };
        self.torques(local);
        for (j, limit) in limits.iter().enumerate() {
            [out[1 + 2 * j], out[2 + 2 * j]] = torque_shares(*limit, self.moving[j], self.gravity[j]);
        }
    }

    /// The limit that a state comes nearest to; its torques may be known already.
    fn nearest(&mut self, local: &[Local], torques: Option<&[[f64; 2]]>) -> Option<Limiting> {
        let mut best: Option<Limiting> = None;
        let mut visit = |kind: LimitKind, joint: Option<usize>, share: f64| {
            if share > best.map_or(0.0, |b| b.share) {
                best = Some(Limiting { kind, joint, share });
            }
        };
        let kinds = [LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk];
        for (j, local) in local.iter().enumerate() {
            for (order, kind) in kinds.into_iter().enumerate() {
                visit(kind, Some(j), local[order + 1].abs() * self.inverse[order][j]);
            }
        }
        visit(LimitKind::ToolSpeed, None, self.tool_share(local).sqrt());
        let settings = self.settings;
        if let Some(limits) = &settings.torque_limits {
            if torques.is_none() {
                self.torques(local);
            }
            for (j, limit) in limits.iter().enumerate() {
                let [moving, gravity] = torques.map_or([self.moving[j], self.gravity[j]], |t| t[j]);
                let room = if moving > 0.0 { limit - gravity } else { limit + gravity };
                visit(LimitKind::Torque, Some(j), moving.abs() / room);
            }
        }
        best
    }
}
