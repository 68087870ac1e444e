//! The self-motion of any chain with one spare freedom, as a curve, by predictor and corrector.
//!
//! The configurations over one task value form curves with the unit tangent `t(q)` in the kernel of J. From a point the
//! next one is predicted by the cubic through the last two points and tangents and corrected by Newton's method along
//! the shortest joint motion, `q <- q + J^+ (x - f(q))` [AllgowerGeorg1990, ch. 6]. The curve is followed by its own
//! length, so folds in any joint or in the swivel are ordinary points.
//!
//! - **Sense.** The tangent has the sign for which `det [J; t]` keeps its sign: a jump to a neighbouring piece that
//!   runs the other way, and a step straight across a singular configuration, are seen and refused.
//! - **Step.** It shrinks until tangents turn by less than [`TRACE_TURN`] and corrections stay below a fifth of it; if
//!   it shrinks to [`TRACE_SHORTEST`] the curve ends in a kinematic singularity, which is an event, and the other
//!   direction is followed from the start.
//! - **Closure.** A step that passes the start, modulo whole turns of revolute joints, in the direction in which it was
//!   left, ends there. The last row is the first one plus whole turns.
//!
//! Over a pose, S-R-S arms have the closed form: their circles become the same kind of curve without a corrector.
//!
//! Cost: one forward kinematics with Jacobian and one factorisation per point, about 1 us for seven joints.

use std::f64::consts::PI;

use nalgebra::DVector;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::closed_form::srs::Branch;
use super::closed_form::srs::SrsArm;
use crate::chain::{Chain, JointKind};
use crate::criterion::check_redundant;
use crate::error::{Error, Result};
use crate::joint_space::{TURN, margin};
use crate::kinematics::{Corrector, Task, TaskKind};
use crate::path::{Event, EventKind};
use crate::pose::{Pose, check_pose};
use crate::status::Status;
use crate::tolerance::{
    CLOSED_FORM_EXACT, CURVE_CONTAINS, KINEMATIC_SINGULARITY, TRACE_CLOSURE, TRACE_SHORTEST, TRACE_TURN,
};

/// Settings of [`trace_self_motion`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceSettings {
    /// Largest joint step between rows (Euclidean norm, rad or m). Default 0.01.
    pub step: f64,
    /// Rows after which the curve is given up: curves of sliding joints may be endless. Default 200 000.
    pub max_rows: usize,
}

impl Default for TraceSettings {
    fn default() -> Self {
        Self { step: 0.01, max_rows: 200_000 }
    }
}

impl TraceSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// A step that is not in (0, 0.5], fewer than 16 rows.
    pub fn validate(&self) -> Result<()> {
        if !(self.step > 10.0 * TRACE_SHORTEST && self.step <= 0.5) {
            let bound = format!("> {} and <= 0.5", 10.0 * TRACE_SHORTEST);
            return Err(Error::OutOfRange { what: "step".into(), value: self.step, bound });
        }
        if self.max_rows < 16 {
            let (what, value) = ("max_rows".into(), self.max_rows as f64);
            return Err(Error::OutOfRange { what, value, bound: ">= 16".into() });
        }
        Ok(())
    }
}

/// A curve of configurations over one task value.
///
/// Rows are joint configurations that change continuously along the curve: revolute joints are not wound back into
/// their limits on the way. The parameter s is the length of the curve in joint space from the first row.
#[derive(Debug, Clone)]
pub struct SelfMotionCurve {
    fibre: Corrector,
    s: Vec<f64>,
    q: Vec<f64>,
    tangents: Vec<f64>,
    closed: bool,
    status: Status,
    events: Vec<Event>,
}

/// The self-motion through `q`: the curve of configurations with the same task value.
///
/// ```
/// use redundancy_core::{chain::catalog, kinematics::Task, solutions::{TraceSettings, trace_self_motion}};
/// let arm = catalog::load("panda")?;
/// let q = [0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5];
/// let curve = trace_self_motion(&arm, &q, Task::POSE, &TraceSettings::default())?;
/// assert!(curve.closed());
/// let (there, here) = (arm.forward(curve.q_row(curve.rows() / 2))?, arm.forward(&q)?);
/// assert!((there.translation.vector - here.translation.vector).norm() < 1e-10);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A `q` of the wrong length or with entries that are not finite; a task that leaves not exactly one freedom; invalid
/// settings.
pub fn trace_self_motion(
    chain: &Chain,
    q: &[f64],
    task: Task,
    settings: &TraceSettings,
) -> Result<SelfMotionCurve> {
    chain.check_q(q)?;
    settings.validate()?;
    check_one_freedom(chain, &task)?;
    let fibre = Corrector::new(chain, geometric(task), &chain.forward_unchecked(q))?;
    Ok(Tracer::new(fibre, *settings).curve(q))
}

/// Every self-motion curve that is found over `target`: the circles of the closed form for S-R-S arms (all there are);
/// for other chains curves through configurations that Newton's method finds from `starts` random ones.
///
/// # Errors
/// As [`trace_self_motion`]; an invalid target.
pub fn self_motion_curves(
    chain: &Chain,
    target: &Pose,
    task: Task,
    settings: &TraceSettings,
    seed: u64,
    starts: usize,
) -> Result<Vec<SelfMotionCurve>> {
    check_pose("target", target)?;
    settings.validate()?;
    check_one_freedom(chain, &task)?;
    let task = geometric(task);
    let fibre = Corrector::new(chain, task, target)?;
    if task.kind() == TaskKind::Pose
        && let Ok(arm) = SrsArm::new(chain)
        && arm.defect().largest() <= CLOSED_FORM_EXACT
    {
        let motion = arm.self_motion(target)?;
        return Ok(motion.branches().iter().map(|branch| from_branch(&fibre, branch, settings)).collect());
    }
    let mut tracer = Tracer::new(fibre, *settings);
    let mut curves: Vec<SelfMotionCurve> = Vec::new();
    for mut q in random_configurations(chain, seed, starts) {
        if tracer.fibre.reach(&mut q)
            && tracer.fibre.correct(&mut q, settings.step)
            && !curves.iter().any(|curve| curve.contains(&q))
        {
            curves.push(tracer.curve(&q));
        }
    }
    Ok(curves)
}

/// Random configurations: within limits where there are any, else within a half turn (or a metre) of zero.
pub(crate) fn random_configurations(
    chain: &Chain,
    seed: u64,
    count: usize,
) -> impl Iterator<Item = Vec<f64>> + use<> {
    let ranges: Vec<[f64; 2]> = (chain.joints().iter())
        .map(|joint| {
            let free = if joint.kind == JointKind::Prismatic { 1.0 } else { PI };
            match (joint.limits.lower, joint.limits.upper) {
                (lower, upper) if upper - lower < 2.0 * free => [lower, upper],
                (lower, upper) => [lower.max(-free).min(upper), upper.min(free).max(lower)],
            }
        })
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(move |_| {
        ranges.iter().map(|[lower, upper]| lower + (upper - lower) * rng.random::<f64>()).collect()
    })
}

/// The same configurations, in coordinates without a singularity of their own.
pub(crate) fn geometric(task: Task) -> Task {
    if task.kind() == TaskKind::PoseRpy { Task::POSE } else { task }
}

fn check_one_freedom(chain: &Chain, task: &Task) -> Result<()> {
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

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Cubic through `(0, a, ta)` and `(h, b, tb)` at `x`, joint by joint.
fn hermite(a: &[f64], ta: &[f64], b: &[f64], tb: &[f64], h: f64, x: f64, out: &mut [f64]) {
    let u = x / h;
    let (u2, u3) = (u * u, u * u * u);
    let (h00, h10, h01, h11) = (2.0 * u3 - 3.0 * u2 + 1.0, u3 - 2.0 * u2 + u, 3.0 * u2 - 2.0 * u3, u3 - u2);
    for i in 0..out.len() {
        out[i] = h00 * a[i] + h01 * b[i] + h * (h10 * ta[i] + h11 * tb[i]);
    }
}

/// Length of the arc with this chord whose end tangents differ by `turn`.
fn arc(chord: f64, turn: f64) -> f64 {
    chord * (1.0 + turn * turn / 24.0)
}

/// How a direction ended.
enum End {
    Closed,
    Singular,
    Rows,
}

struct Tracer {
    fibre: Corrector,
    settings: TraceSettings,
}

impl Tracer {
    fn new(fibre: Corrector, settings: TraceSettings) -> Self {
        Self { fibre, settings }
    }

    /// The whole curve through `start`, which lies on it.
    fn curve(&mut self, start: &[f64]) -> SelfMotionCurve {
        let (mut s, mut q, mut tangents, end) = self.direction(start, 1.0);
        let mut ends = vec![(end, false)];
        if matches!(ends[0].0, End::Singular) {
            // What lies before the start.
            let (s_back, q_back, t_back, end) = self.direction(start, -1.0);
            let n = start.len();
            let length = s_back.last().copied().unwrap_or(0.0);
            let reversed = |values: &[f64], sign: f64| -> Vec<f64> {
                values.chunks_exact(n).skip(1).rev().flatten().map(|x| sign * x).collect()
            };
            q = [reversed(&q_back, 1.0), q].concat();
            tangents = [reversed(&t_back, -1.0), tangents].concat();
            s = s_back.iter().skip(1).rev().map(|x| length - x).chain(s.iter().map(|x| length + x)).collect();
            ends.push((end, true));
        }
        let closed = matches!(ends[0].0, End::Closed);
        let mut status = if closed { Status::Converged } else { Status::Singular };
        let mut events = Vec::new();
        for (end, at_front) in ends.iter().rev() {
            let index = if *at_front { 0 } else { s.len() - 1 };
            match end {
                End::Closed => {}
                End::Rows => status = Status::IterationLimit,
                End::Singular => events.push(Event {
                    kind: EventKind::KinematicSingularity,
                    index,
                    t: s[index],
                    s: s[index],
                    message: "the curve ends at a kinematic singularity: the Jacobian loses rank".into(),
                }),
            }
        }
        SelfMotionCurve { fibre: self.fibre.clone(), s, q, tangents, closed, status, events }
    }

    fn direction(&mut self, start: &[f64], sense: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>, End) {
        let n = start.len();
        let first: Vec<f64> = self.fibre.tangent_at(start).iter().map(|t| sense * t).collect();
        let (mut s, mut q, mut tangents) = (vec![0.0], start.to_vec(), first.clone());
        let (mut next, mut t, mut to_start) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        if self.fibre.pivot_ratio() < KINEMATIC_SINGULARITY {
            return (s, q, tangents, End::Singular);
        }
        let mut h = self.settings.step;
        while s.len() < self.settings.max_rows {
            let k = s.len() - 1;
            let (here, now) = (&q[k * n..], &tangents[k * n..]);
            if k == 0 {
                for i in 0..n {
                    next[i] = here[i] + h * now[i];
                }
            } else {
                let (before, past) = (&q[(k - 1) * n..k * n], &tangents[(k - 1) * n..k * n]);
                let gap = s[k] - s[k - 1];
                hermite(before, past, here, now, gap, gap + h, &mut next);
            }
            let mut cosine = -1.0;
            if self.fibre.correct(&mut next, 0.2 * h) {
                for (t, b) in t.iter_mut().zip(self.fibre.tangent()) {
                    *t = sense * b;
                }
                cosine = dot(&t, now);
            }
            let chord = (0..n).map(|i| (next[i] - here[i]).powi(2)).sum::<f64>().sqrt();
            // Chords of the right length and direction, tangents that turn little.
            if !(cosine >= TRACE_TURN.cos() && chord <= 1.2 * h) {
                h *= 0.5;
                if h < TRACE_SHORTEST {
                    return (s, q, tangents, End::Singular);
                }
                continue;
            }
            let turn = (2.0 * (1.0 - cosine)).max(0.0).sqrt();
            let length = arc(chord, turn);
            // Is the start on the way?
            if k > 0 {
                self.fibre.chain().difference_into(here, start, &mut to_start);
                let along = dot(&to_start, now);
                if along > 0.0
                    && norm(&to_start) <= 2.0 * chord
                    && dot(&t, &first) > 0.0
                    && self.passes(here, now, &next, &t, length, &to_start)
                {
                    let chord = norm(&to_start);
                    let cosine = dot(now, &first).min(1.0);
                    s.push(s[k] + arc(chord, (2.0 * (1.0 - cosine)).max(0.0).sqrt()));
                    to_start.iter_mut().zip(here).for_each(|(d, q)| *d += q);
                    // Whole turns are added to the start itself, not to rounded differences.
                    let mut end = start.to_vec();
                    self.fibre.chain().wind_to(&mut end, &to_start);
                    q.extend_from_slice(&end);
                    tangents.extend_from_slice(&first);
                    return (s, q, tangents, End::Closed);
                }
            }
            s.push(s[k] + length);
            q.extend_from_slice(&next);
            tangents.extend_from_slice(&t);
            if cosine > (0.5 * TRACE_TURN).cos() {
                h = (1.5 * h).min(self.settings.step);
            }
        }
        (s, q, tangents, End::Rows)
    }

    /// Whether the start, `to_start` away from `here`, lies on the step from `here` to `next`.
    fn passes(
        &self,
        here: &[f64],
        now: &[f64],
        next: &[f64],
        t: &[f64],
        length: f64,
        to_start: &[f64],
    ) -> bool {
        let mut at = vec![0.0; here.len()];
        // The foot on the cubic: two corrections along the tangent are enough for a step that turns little.
        let mut x = dot(to_start, now);
        let mut miss = f64::INFINITY;
        for _ in 0..4 {
            hermite(here, now, next, t, length, x, &mut at);
            let u = (x / length).clamp(0.0, 1.0);
            let mut along = 0.0;
            miss = 0.0;
            for i in 0..here.len() {
                let d = here[i] + to_start[i] - at[i];
                along += d * ((1.0 - u) * now[i] + u * t[i]);
                miss += d * d;
            }
            x += along;
        }
        miss.sqrt() <= TRACE_CLOSURE * length && x > 0.0 && x <= length * (1.0 + 1e-9)
    }
}

/// A circle of the closed form as a curve: rows are added until neighbours are near and tangents turn little.
fn from_branch(fibre: &Corrector, branch: &Branch<'_>, settings: &TraceSettings) -> SelfMotionCurve {
    const FIRST: usize = 64;
    const DEPTH: usize = 24;
    let chain = fibre.chain();
    // Unit tangent and configuration; windings are made continuous below.
    let point = |x: f64| -> Option<([f64; 7], [f64; 7])> {
        let (q, t) = (branch.q(x).ok()?, branch.tangent(x).ok()?);
        let length = norm(&t);
        (length.is_finite() && length > 0.0).then(|| (q, t.map(|t| t / length)))
    };
    let (mut s, mut q, mut tangents): (Vec<f64>, Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new(), Vec::new());
    let mut broken = false;
    let mut push = |x: &([f64; 7], [f64; 7])| {
        let n = q.len();
        if n == 0 {
            s.push(0.0);
            q.extend(x.0);
        } else {
            let (here, now) = (&q[n - 7..], &tangents[n - 7..]);
            let mut d = [0.0; 7];
            chain.difference_into(here, &x.0, &mut d);
            let turn = (2.0 * (1.0 - dot(now, &x.1))).max(0.0).sqrt();
            s.push(s[s.len() - 1] + arc(norm(&d), turn));
            let next: Vec<f64> = here.iter().zip(d).map(|(a, d)| a + d).collect();
            q.extend(next);
        }
        tangents.extend(x.1);
    };
    let fine = |a: &([f64; 7], [f64; 7]), b: &([f64; 7], [f64; 7])| {
        let mut d = [0.0; 7];
        chain.difference_into(&a.0, &b.0, &mut d);
        norm(&d) <= settings.step && dot(&a.1, &b.1) >= TRACE_TURN.cos()
    };
    let mut left = point(0.0);
    if let Some(left) = &left {
        push(left);
    }
    for k in 0..FIRST {
        // Depth first, left to right.
        let (from, to) = (TURN * k as f64 / FIRST as f64, TURN * (k + 1) as f64 / FIRST as f64);
        let mut stack = vec![(from, to, 0)];
        while let Some((a, b, depth)) = stack.pop() {
            // The end is the beginning.
            let right = point(if k + 1 == FIRST && b == to { 0.0 } else { b });
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
    let status = if broken { Status::Singular } else { Status::Converged };
    SelfMotionCurve { fibre: fibre.clone(), s, q, tangents, closed: !broken, status, events: Vec::new() }
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
        check_pose("target", target)?;
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

    /// The configuration at parameter `s`, exactly on the curve. A closed curve goes on from its start (with the whole
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
    fn margin(&self, i: usize, q: f64) -> f64 {
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
        for i in (0..n).filter(|i| self.margin(*i, 0.0).is_finite()) {
            let mut value = |s: f64| {
                self.exact(s, &mut fibre, &mut q);
                self.margin(i, q[i]) - margin
            };
            for k in 0..self.rows().saturating_sub(1) {
                let at = |k: usize| self.margin(i, self.q[k * n + i]) - margin;
                let (a, b) = (at(k), at(k + 1));
                let (sa, sb) = (self.s[k], self.s[k + 1]);
                if (a >= 0.0) != (b >= 0.0) {
                    out.push((k, bisect(&mut value, sa, sb, a >= 0.0), i, b >= 0.0));
                    continue;
                }
                // The joint turns round in between: its extremum may lie on the other side.
                let (ta, tb) = (self.tangents[k * n + i], self.tangents[(k + 1) * n + i]);
                if ta * tb < 0.0 && a.abs().min(b.abs()) <= ta.abs().max(tb.abs()) * (sb - sa) {
                    let top = sa + (sb - sa) * ta / (ta - tb);
                    let middle = value(top);
                    if (middle >= 0.0) != (a >= 0.0) {
                        out.push((k, bisect(&mut value, sa, top, a >= 0.0), i, middle >= 0.0));
                        out.push((k, bisect(&mut value, top, sb, middle >= 0.0), i, b >= 0.0));
                    }
                }
            }
        }
        out.sort_by(|a, b| a.1.total_cmp(&b.1));
        out
    }
}

/// Where `value` changes its sign between `a` (where it is at or above zero when `positive`) and `b`.
fn bisect(value: &mut impl FnMut(f64) -> f64, mut a: f64, mut b: f64, positive: bool) -> f64 {
    const HALVINGS: usize = 60;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (a + b);
        if middle <= a || middle >= b {
            break;
        }
        if (value(middle) >= 0.0) == positive {
            a = middle;
        } else {
            b = middle;
        }
    }
    0.5 * (a + b)
}

/// A sampled patch of a self-motion of two dimensions: points `q(a, b)` over the grid `a, b in {-k..k} spacing`
/// along the two null directions of the start, each brought back to the task value. Where that fails the entry is
/// `None`.
///
/// # Errors
/// As [`trace_self_motion`]; a task that leaves not exactly two freedoms, a spacing that is not in (0, 0.5], more than
/// 500 steps.
pub fn self_motion_patch(
    chain: &Chain,
    q: &[f64],
    task: Task,
    spacing: f64,
    steps: usize,
) -> Result<Vec<Option<Vec<f64>>>> {
    chain.check_q(q)?;
    check_redundant(chain, &task)?;
    let (n, m) = (chain.dof(), task.dim());
    if n != m + 2 {
        let message =
            format!("a patch needs two spare freedoms, '{}' has {} under '{task}'", chain.name(), n - m);
        return Err(Error::Invalid(message));
    }
    if !(spacing > 0.0 && spacing <= 0.5) {
        return Err(Error::OutOfRange {
            what: "spacing".into(),
            value: spacing,
            bound: "> 0 and <= 0.5".into(),
        });
    }
    if steps > 500 {
        return Err(Error::OutOfRange { what: "steps".into(), value: steps as f64, bound: "<= 500".into() });
    }
    let mut fibre = Corrector::new(chain, geometric(task), &chain.forward_unchecked(q))?;
    fibre.evaluate(q);
    let basis = fibre.basis().clone();
    let start = DVector::from_column_slice(q);
    let side = 2 * steps + 1;
    let mut out: Vec<Option<Vec<f64>>> = vec![None; side * side];
    let place = |a: isize, b: isize| ((a + steps as isize) as usize) * side + (b + steps as isize) as usize;
    // From the centre outwards: the nearest point that is known carries the correction.
    let mut order: Vec<(isize, isize)> = (-(steps as isize)..=steps as isize)
        .flat_map(|a| (-(steps as isize)..=steps as isize).map(move |b| (a, b)))
        .collect();
    order.sort_by_key(|(a, b)| (a.abs().max(b.abs()), a.abs() + b.abs(), *a, *b));
    for (a, b) in order {
        let flat =
            |a: isize, b: isize| &start + (basis.column(0) * a as f64 + basis.column(1) * b as f64) * spacing;
        let inner = (a - a.signum(), b - b.signum());
        let known = out[place(inner.0, inner.1)].clone();
        let mut point: Vec<f64> = match known {
            _ if (a, b) == (0, 0) => q.to_vec(),
            Some(known) => {
                (DVector::from_vec(known) + flat(a, b) - flat(inner.0, inner.1)).as_slice().to_vec()
            }
            None => continue,
        };
        if fibre.correct(&mut point, 2.0 * spacing) {
            out[place(a, b)] = Some(point);
        }
    }
    Ok(out)
}
