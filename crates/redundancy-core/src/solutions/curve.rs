//! A curve of configurations over one task value: rows, the point and the tangent between them, feasible arcs.
//!
//! Rows come from continuation, or from a piece of the closed form. Between two rows the curve is the cubic through both with
//! their tangents, corrected onto the task value by Newton's method.
//!
//! **Feasible arcs.** A joint is within its limits by `half - |d|` in its best winding, d its distance from the middle of the
//! range modulo whole turns. The sign of that changes between two rows, or where the joint turns round, or half a turn away
//! from the middle, where the winding changes. Each change is found on the curve itself, to 1e-11 of its length, on the
//! side that holds the limit.

use std::f64::consts::PI;

use super::solutions::Solutions;
use crate::chain::{Chain, JointKind, Limits};
use crate::criterion::check_redundant;
use crate::error::{Error, Result};
use crate::joint_space::{TURN, margin, turned, turns};
use crate::kinematics::{Corrector, Task, TaskKind};
use crate::path::{Event, EventKind};
use crate::pose::{Pose, checked_pose};
use crate::status::Status;
use crate::tolerance::{CURVE_CONTAINS, EDGE_FOUND, EDGE_WIDTH, TRACE_SHORTEST, TRACE_TURN};

/// A curve of configurations over one task value.
///
/// Rows are joint configurations that change continuously along the curve: revolute joints are not wound back into
/// their limits on the way. The parameter s is the length of the curve in joint space from the first row.
#[derive(Debug, Clone)]
pub struct SelfMotionCurve {
    pub(super) fibre: Corrector,
    pub(super) s: Vec<f64>,
    pub(super) q: Vec<f64>,
    pub(super) tangents: Vec<f64>,
    pub(super) closed: bool,
    pub(super) status: Status,
    pub(super) events: Vec<Event>,
}

impl SelfMotionCurve {
    /// A curve from its rows, as the accessors give them: the inverse of taking one apart.
    ///
    /// # Errors
    /// Rows that do not fit together or are not finite, a parameter that decreases, an invalid target.
    pub fn from_rows(
        chain: &Chain,
        task: Task,
        target: &Pose,
        rows: (Vec<f64>, Vec<f64>, Vec<f64>),
        status: Status,
        ends: Vec<Event>,
    ) -> Result<Self> {
        check_one_freedom(chain, &task)?;
        let target = &checked_pose("target", target)?;
        let (s, q, tangents) = rows;
        crate::error::check_finite("s", &s)?;
        if s.is_empty() || s.windows(2).any(|pair| pair[1] < pair[0]) {
            return Err(Error::Invalid("s must have a row and increase".into()));
        }
        crate::error::check_vector("q", &q, s.len() * chain.dof())?;
        crate::error::check_vector("tangents", &tangents, s.len() * chain.dof())?;
        let fibre = Corrector::new(chain, geometric(task), target)?;
        let closed = status == Status::Converged;
        Ok(Self { fibre, s, q, tangents, closed, status, events: ends })
    }

    /// The task whose value is held.
    pub fn task(&self) -> &Task {
        self.fibre.task()
    }

    /// The pose whose task value is held.
    pub fn target(&self) -> &Pose {
        self.fibre.target()
    }

    /// Unit tangents row by row.
    pub fn tangents(&self) -> &[f64] {
        &self.tangents
    }

    /// The ends at kinematic singularities alone, see [`events`](Self::events).
    pub fn ends(&self) -> &[Event] {
        &self.events
    }

    /// The chain.
    pub fn chain(&self) -> &Chain {
        self.fibre.chain()
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.s.len()
    }

    /// Joint configurations row by row.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// One row; empty past the end.
    pub fn q_row(&self, k: usize) -> &[f64] {
        self.q.chunks_exact(self.chain().dof()).nth(k).unwrap_or_default()
    }

    /// Unit tangent at a row; empty past the end.
    pub fn tangent_row(&self, k: usize) -> &[f64] {
        self.tangents.chunks_exact(self.chain().dof()).nth(k).unwrap_or_default()
    }

    /// Parameter of each row: length in joint space from the first one.
    pub fn s(&self) -> &[f64] {
        &self.s
    }

    /// Length of the curve.
    pub fn length(&self) -> f64 {
        self.s.last().copied().unwrap_or(0.0)
    }

    /// Whether it returns to its start: the last row is then the first one plus whole turns.
    pub fn closed(&self) -> bool {
        self.closed
    }

    /// `Converged` for a closed curve, `Singular` where it ends at a kinematic singularity, `IterationLimit` when the
    /// number of rows was met first.
    pub fn status(&self) -> Status {
        self.status
    }

    /// What was met: ends at kinematic singularities, then joint limits, in the order of s. `t` and `s` of an event are
    /// the parameter of the curve.
    pub fn events(&self) -> Vec<Event> {
        let mut events = self.events.clone();
        for (i, s, joint, inside) in self.limit_crossings() {
            let name = &self.chain().joints()[joint].name;
            let verb = if inside { "comes back within" } else { "leaves" };
            let message = format!("joint '{name}' {verb} its limits");
            events.push(Event { kind: EventKind::JointLimit, index: i, t: s, s, message });
        }
        events.sort_by(|a, b| a.s.total_cmp(&b.s));
        events
    }

    /// The configuration at parameter `s`, exactly on the curve. A closed curve continues from its start (with the whole
    /// turns that it has made); an open one ends.
    ///
    /// # Errors
    /// A parameter that is not finite, or beyond the ends of an open curve.
    pub fn at(&self, s: f64) -> Result<Vec<f64>> {
        crate::error::check_finite("s", &[s])?;
        let length = self.length();
        if !self.closed && !(0.0..=length).contains(&s) {
            let bound = format!("on the open curve, from 0 to {length}");
            return Err(Error::OutOfRange { what: "s".into(), value: s, bound });
        }
        let rounds = if self.closed && length > 0.0 { (s / length).floor() } else { 0.0 };
        let mut q = vec![0.0; self.chain().dof()];
        self.exact(s - rounds * length, &mut self.fibre.clone(), &mut q);
        let (first, last) = (self.q_row(0), self.q_row(self.rows() - 1));
        for ((q, a), b) in q.iter_mut().zip(first).zip(last) {
            *q += rounds * (b - a);
        }
        Ok(q)
    }

    /// Unit tangent at parameter `s`, along the curve.
    ///
    /// # Errors
    /// As [`at`](Self::at).
    pub fn tangent(&self, s: f64) -> Result<Vec<f64>> {
        let q = self.at(s)?;
        let s = if self.closed { s.rem_euclid(self.length()) } else { s };
        let mut fibre = self.fibre.clone();
        let sense = self.sense(s, &mut fibre, &q);
        Ok(fibre.tangent().iter().map(|t| sense * t).collect())
    }

    /// The point at `s` within the rows: between rows the cubic, corrected.
    fn exact(&self, s: f64, fibre: &mut Corrector, out: &mut [f64]) {
        let n = out.len();
        if self.rows() < 2 {
            out.copy_from_slice(&self.q[..n]);
            return;
        }
        let k = self.s.partition_point(|x| *x <= s).clamp(1, self.rows() - 1) - 1;
        let row = |v: &'_ [f64], k: usize| -> Vec<f64> { v[k * n..(k + 1) * n].to_vec() };
        let gap = self.s[k + 1] - self.s[k];
        let (a, b) = (row(&self.q, k), row(&self.q, k + 1));
        let (ta, tb) = (row(&self.tangents, k), row(&self.tangents, k + 1));
        if gap > 0.0 {
            hermite(&a, &ta, &b, &tb, gap, s - self.s[k], out);
        } else {
            out.copy_from_slice(&a);
        }
        let guess = out.to_vec();
        if !fibre.correct(out, gap.max(TRACE_SHORTEST)) {
            out.copy_from_slice(&guess);
        }
    }

    /// The point at `s` within the rows, corrected by `fibre`.
    pub(crate) fn interpolate(&self, s: f64, fibre: &mut Corrector) -> Vec<f64> {
        let mut q = vec![0.0; self.chain().dof()];
        self.exact(s, fibre, &mut q);
        q
    }

    /// 1 where the tangent by `det [J; t] > 0` at the point `q` of parameter `s` runs along the curve, else -1.
    pub(crate) fn sense(&self, s: f64, fibre: &mut Corrector, q: &[f64]) -> f64 {
        let k = self.s.partition_point(|x| *x <= s).clamp(1, self.rows()) - 1;
        dot(fibre.tangent_at(q), self.tangent_row(k)).signum()
    }

    /// Whether `q` lies on the curve, modulo whole turns.
    pub fn contains(&self, q: &[f64]) -> bool {
        let n = self.chain().dof();
        let mut d = vec![0.0; n];
        let mut nearest = (f64::INFINITY, 0);
        for (k, row) in self.q.chunks_exact(n).enumerate() {
            self.fibre.chain().difference_into(row, q, &mut d);
            let distance = norm(&d);
            if distance < nearest.0 {
                nearest = (distance, k);
            }
        }
        let k = nearest.1;
        let gap = |i: usize| self.s.get(i + 1).zip(self.s.get(i)).map_or(0.0, |(b, a)| b - a);
        if nearest.0 > gap(k).max(if k > 0 { gap(k - 1) } else { 0.0 }) + CURVE_CONTAINS {
            return false;
        }
        // The foot on the curve.
        let mut s = self.s[k];
        let mut at = self.q_row(k).to_vec();
        let (mut fibre, length) = (self.fibre.clone(), self.length());
        for _ in 0..6 {
            self.fibre.chain().difference_into(&at, q, &mut d);
            let sign = dot(fibre.tangent_at(&at), self.tangent_row(k)).signum();
            let along = sign * dot(&d, fibre.tangent());
            s = if self.closed { (s + along).rem_euclid(length) } else { (s + along).clamp(0.0, length) };
            self.exact(s, &mut fibre, &mut at);
        }
        self.fibre.chain().difference_into(&at, q, &mut d);
        norm(&d) <= CURVE_CONTAINS
    }

    /// How far joint `i` is within its limits (negative outside) at `q`, in its best winding.
    pub(super) fn margin(&self, i: usize, q: f64) -> f64 {
        let joint = &self.chain().joints()[i];
        let (lower, upper) = (joint.limits.lower, joint.limits.upper);
        if joint.kind == JointKind::Prismatic {
            return (q - lower).min(upper - q);
        }
        margin(q, lower, upper)
    }

    /// Arcs on which every joint is within its limits in some winding, with `margin` (rad or m) from each: `[lo, hi]` of
    /// the parameter, ascending. On a closed curve an arc through the start has `hi` above the length; s is inside when
    /// `(s - lo) mod length <= hi - lo`.
    ///
    /// # Errors
    /// A margin that is negative or not finite.
    pub fn intervals(&self, margin: f64) -> Result<Vec<[f64; 2]>> {
        if !margin.is_finite() || margin < 0.0 {
            let (what, bound) = ("margin".into(), ">= 0 and finite".into());
            return Err(Error::OutOfRange { what, value: margin, bound });
        }
        let length = self.length();
        let mut cuts: Vec<f64> = self.crossings(margin).iter().map(|c| c.1).collect();
        cuts.extend([0.0, length]);
        cuts.sort_by(f64::total_cmp);
        let mut fibre = self.fibre.clone();
        let mut q = vec![0.0; self.chain().dof()];
        let mut arcs: Vec<[f64; 2]> = Vec::new();
        for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
            self.exact(0.5 * (pair[0] + pair[1]), &mut fibre, &mut q);
            if (0..q.len()).all(|i| self.margin(i, q[i]) >= margin) {
                match arcs.last_mut() {
                    Some(last) if last[1] == pair[0] => last[1] = pair[1],
                    _ => arcs.push([pair[0], pair[1]]),
                }
            }
        }
        if self.closed
            && arcs.len() > 1
            && arcs[0][0] == 0.0
            && arcs.last().is_some_and(|last| last[1] == length)
        {
            let first = arcs.remove(0);
            if let Some(last) = arcs.last_mut() {
                last[1] += first[1];
            }
        }
        Ok(arcs)
    }

    fn limit_crossings(&self) -> Vec<(usize, f64, usize, bool)> {
        self.crossings(0.0)
    }

    /// Where a joint meets the given margin: row before, parameter, joint, whether it comes inside.
    fn crossings(&self, margin: f64) -> Vec<(usize, f64, usize, bool)> {
        let n = self.chain().dof();
        let mut fibre = self.fibre.clone();
        let mut q = vec![0.0; n];
        let mut out = Vec::new();
        for i in 0..n {
            // The least that a joint has in its best winding; where that is enough it limits nothing.
            let Limits { lower, upper, .. } = self.chain().joints()[i].limits;
            let middle = 0.5 * (lower + upper);
            let rotates = self.chain().steps()[i].rotational;
            if rotates && 0.5 * (upper - lower) - PI >= margin {
                continue;
            }
            let mut joint = |s: f64| {
                self.exact(s, &mut fibre, &mut q);
                q[i]
            };
            for k in 0..self.rows().saturating_sub(1) {
                let (qa, qb) = (self.q[k * n + i], self.q[(k + 1) * n + i]);
                let (sa, sb) = (self.s[k], self.s[k + 1]);
                let room = |q: f64| self.margin(i, q) - margin;
                let (a, b) = (room(qa), room(qb));
                let mut push = |s: f64, inside: bool| out.push((k, s, i, inside));
                if (a >= 0.0) != (b >= 0.0) {
                    push(edge(&mut |s| room(joint(s)), sa, sb, a >= 0.0), b >= 0.0);
                    continue;
                }
                // Half a turn away from the middle of the range, where the winding changes, it has least room.
                let half = |q: f64| turns(q - middle);
                let far = turned(middle, 0.5 * (half(qa) + half(qb)));
                let between = if rotates && half(qa) != half(qb) {
                    Some(edge(&mut |s| (joint(s) - far) * (qb - qa).signum(), sa, sb, false))
                } else {
                    // The joint turns round in between: its extremum may lie on the other side.
                    let (ta, tb) = (self.tangents[k * n + i], self.tangents[(k + 1) * n + i]);
                    let near = a.abs().min(b.abs()) <= ta.abs().max(tb.abs()) * (sb - sa);
                    (ta * tb < 0.0 && near).then(|| sa + (sb - sa) * ta / (ta - tb))
                };
                if let Some(between) = between {
                    let inside = room(joint(between)) >= 0.0;
                    if inside != (a >= 0.0) {
                        push(edge(&mut |s| room(joint(s)), sa, between, a >= 0.0), inside);
                        push(edge(&mut |s| room(joint(s)), between, sb, inside), b >= 0.0);
                    }
                }
            }
        }
        out.sort_by(|a, b| a.1.total_cmp(&b.1));
        out
    }
}

/// Where `value` changes its sign between `a` (where it is at or above zero when `positive`) and `b`: the end at or above
/// zero of a bracket as narrow as rounding allows. Illinois' rule, then bisection.
fn edge(value: &mut impl FnMut(f64) -> f64, a: f64, b: f64, positive: bool) -> f64 {
    const SECANTS: usize = 12;
    const HALVINGS: usize = 60;
    let sign = if positive { 1.0 } else { -1.0 };
    // From here on positive at a, negative at b.
    let (mut a, mut b) = (a, b);
    let (mut fa, mut fb) = (sign * value(a), sign * value(b));
    let mut last = 0.0;
    for _ in 0..SECANTS {
        let x = a + (b - a) * fa / (fa - fb);
        if !(x > a.min(b) && x < a.max(b)) {
            break;
        }
        let fx = sign * value(x);
        if fx.abs() <= EDGE_FOUND {
            // A bracket around it.
            let [low, high] = [x - EDGE_WIDTH, x + EDGE_WIDTH].map(|x| x.clamp(a, b));
            if sign * value(low) >= 0.0 {
                a = low;
            }
            if sign * value(high) < 0.0 {
                b = high;
            }
            break;
        }
        if fx >= 0.0 {
            (a, fa) = (x, fx);
            fb *= if last > 0.0 { 0.5 } else { 1.0 };
        } else {
            (b, fb) = (x, fx);
            fa *= if last < 0.0 { 0.5 } else { 1.0 };
        }
        last = fx;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (a + b);
        if middle <= a || middle >= b || b - a <= EDGE_WIDTH {
            break;
        }
        if sign * value(middle) >= 0.0 { a = middle } else { b = middle }
    }
    if positive { a } else { b }
}

/// A piece of the closed form as a curve: rows are added until neighbours are within `step_length` and tangents turn little.
pub(super) fn from_piece(
    fibre: &Corrector,
    solutions: &dyn Solutions,
    piece: usize,
    step_length: f64,
) -> Result<SelfMotionCurve> {
    const FIRST: usize = 64;
    const DEPTH: usize = 24;
    let chain = fibre.chain();
    let n = chain.dof();
    let closed = solutions.closed(piece)?;
    let [first, last] = if closed { [0.0, TURN] } else { solutions.range(piece)? };
    // Configuration and unit tangent; windings are made continuous below.
    let point = |u: f64| -> Option<[Vec<f64>; 2]> {
        let mut row = [vec![0.0; n], vec![0.0; n]];
        solutions.q(piece, u, &mut row[0]).ok()?;
        solutions.tangent(piece, u, &mut row[1]).ok()?;
        let length = norm(&row[1]);
        row[1].iter_mut().for_each(|t| *t /= length);
        (length.is_finite() && length > 0.0).then_some(row)
    };
    let (mut s, mut q, mut tangents): (Vec<f64>, Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new(), Vec::new());
    let mut broken = false;
    let mut step = vec![0.0; n];
    let mut push = |[row, tangent]: &[Vec<f64>; 2]| {
        if q.is_empty() {
            s.push(0.0);
            q.extend_from_slice(row);
        } else {
            let (here, now) = (&q[q.len() - n..], &tangents[q.len() - n..]);
            chain.difference_into(here, row, &mut step);
            let turn = (2.0 * (1.0 - dot(now, tangent))).max(0.0).sqrt();
            s.push(s[s.len() - 1] + arc(norm(&step), turn));
            for step in &step {
                q.push(q[q.len() - n] + step);
            }
        }
        tangents.extend_from_slice(tangent);
    };
    let mut between = vec![0.0; n];
    let mut fine = |a: &[Vec<f64>; 2], b: &[Vec<f64>; 2]| {
        chain.difference_into(&a[0], &b[0], &mut between);
        norm(&between) <= step_length && dot(&a[1], &b[1]) >= TRACE_TURN.cos()
    };
    let mut left = point(first);
    if let Some(left) = &left {
        push(left);
    }
    for k in 0..FIRST {
        // Depth first, left to right.
        let at = |k: usize| first + (last - first) * k as f64 / FIRST as f64;
        let (from, to) = (at(k), at(k + 1));
        let mut stack = vec![(from, to, 0)];
        while let Some((a, b, depth)) = stack.pop() {
            // The end of a closed piece is its beginning.
            let right = point(if k + 1 == FIRST && b == to { if closed { first } else { last } } else { b });
            let near = left.as_ref().zip(right.as_ref()).is_some_and(|(a, b)| fine(a, b));
            if !near && depth < DEPTH {
                let middle = 0.5 * (a + b);
                stack.push((middle, b, depth + 1));
                stack.push((a, middle, depth + 1));
                continue;
            }
            broken |= !near;
            if let Some(right) = &right {
                push(right);
            }
            left = right;
        }
    }
    let status = if broken || !closed { Status::Singular } else { Status::Converged };
    let closed = closed && !broken;
    Ok(SelfMotionCurve { fibre: fibre.clone(), s, q, tangents, closed, status, events: Vec::new() })
}

/// The same configurations, in coordinates without a singularity of their own.
pub(crate) fn geometric(task: Task) -> Task {
    if task.kind() == TaskKind::PoseRpy { Task::POSE } else { task }
}

/// Checks that the task leaves exactly one freedom.
pub(super) fn check_one_freedom(chain: &Chain, task: &Task) -> Result<()> {
    check_redundant(chain, task)?;
    let (n, m) = (chain.dof(), task.dim());
    if n == m + 1 {
        return Ok(());
    }
    let name = chain.name();
    Err(Error::Invalid(format!(
        "the self-motion of '{name}' under the task '{task}' has {} dimensions, a curve has one",
        n - m
    )))
}

pub(super) fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Cubic through `(0, a, ta)` and `(h, b, tb)` at `x`, joint by joint.
pub(super) fn hermite(a: &[f64], ta: &[f64], b: &[f64], tb: &[f64], h: f64, x: f64, out: &mut [f64]) {
    let u = x / h;
    let (u2, u3) = (u * u, u * u * u);
    let (h00, h10, h01, h11) = (2.0 * u3 - 3.0 * u2 + 1.0, u3 - 2.0 * u2 + u, 3.0 * u2 - 2.0 * u3, u3 - u2);
    for i in 0..out.len() {
        out[i] = h00 * a[i] + h01 * b[i] + h * (h10 * ta[i] + h11 * tb[i]);
    }
}

/// Length of the arc with this chord whose end tangents differ by `turn`.
pub(super) fn arc(chord: f64, turn: f64) -> f64 {
    chord * (1.0 + turn * turn / 24.0)
}
