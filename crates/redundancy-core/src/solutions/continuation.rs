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
//! Over a pose, the pieces of an arm with a closed form become the same kind of curve without a corrector.
//!
//! Cost: one forward kinematics with Jacobian and one factorisation per point, about 1 us for seven joints.

use std::f64::consts::PI;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::closed_form::closed_form;
use super::curve::{SelfMotionCurve, arc, check_one_freedom, dot, from_piece, geometric, hermite, norm};
use crate::chain::{Chain, JointKind};
use crate::error::{Error, Result};
use crate::kinematics::{Corrector, CorrectorSettings, Task, TaskKind};
use crate::path::{Event, EventKind};
use crate::pose::{Pose, checked_pose};
use crate::status::Status;
use crate::tolerance::{KINEMATIC_SINGULARITY, TRACE_CLOSURE, TRACE_SHORTEST, TRACE_TURN};

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

/// Every self-motion curve that is found over `target`: the pieces of the closed form where the arm has one (all there are);
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
    let target = &checked_pose("target", target)?;
    settings.validate()?;
    check_one_freedom(chain, &task)?;
    let task = geometric(task);
    let fibre = Corrector::new(chain, task, target)?;
    if task.kind() == TaskKind::Pose
        && let Some(form) = closed_form(chain).filter(|form| form.exact())
    {
        let pieces = form.solutions(target)?;
        return (0..pieces.pieces())
            .map(|piece| from_piece(&fibre, &*pieces, piece, settings.step))
            .collect();
    }
    Ok(traced_curves(fibre, settings, seed, starts))
}

/// Curves through the configurations that Newton's method finds from random ones.
pub(super) fn traced_curves(
    fibre: Corrector,
    settings: &TraceSettings,
    seed: u64,
    starts: usize,
) -> Vec<SelfMotionCurve> {
    let chain = fibre.chain().clone();
    let mut tracer = Tracer::new(fibre, *settings);
    let mut curves: Vec<SelfMotionCurve> = Vec::new();
    for mut q in random_configurations(&chain, seed, starts) {
        if tracer.fibre.reach(&mut q)
            && tracer.fibre.correct(&mut q, settings.step)
            && !curves.iter().any(|curve| curve.contains(&q))
        {
            curves.push(tracer.curve(&q));
        }
    }
    curves
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
            let near = CorrectorSettings { tangents: true, ..CorrectorSettings::near(0.2 * h) };
            if self.fibre.solve(&mut next, &near) {
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
