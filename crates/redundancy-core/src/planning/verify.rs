//! What holds between the rows of a line.
//!
//! The motion is the trajectory through its rows, which is a cubic from row to row. On a grid ten times finer than the rows
//! its position limits are checked; whether something touches is proven on straight parts of it. Whether a step stays on one piece of the solutions is seen in its middle: there the straight
//! joint motion is off the task by the square of the step, and what brings it back is a small part of the step. Where
//! the rows are on different pieces, it is as long as the step itself.

use super::demand::Demand;
use super::pull::{Pull, Puller};
use super::tool::Target;
use crate::parallel::prelude::*;
use crate::pose::Pose;
use crate::scene::{SweepHit, SweepMemory, sweep};

/// Points of the fine grid from row to row.
pub(super) const FINER: usize = 10;
/// Straight parts into which a step is cut to look for contact.
const PARTS: usize = 4;
/// Excess over a limit between rows that is not repaired, rad or m.
pub(super) const LIMIT_ROUNDING: f64 = 1e-9;
/// Steps up to this (rad or m) are continuous whatever their middle says.
const SHORT_STEP: f64 = 1e-4;
/// Share of a step that may bring its middle back onto the task.
const MIDDLE_SHARE: f64 = 0.3;
/// Times that a step is halved where its middle says nothing.
const HALVINGS: usize = 4;

/// The trajectory through the rows of a line.
struct Curve<'a> {
    demand: &'a Demand,
    q: &'a [f64],
}

impl Curve<'_> {
    fn at(&self, row: usize, i: usize) -> f64 {
        self.q[row * self.demand.dof() + i]
    }

    /// Velocity at a row, per share of the path: differences of second order inside, of first order at the ends, as in
    /// `Trajectory::new`.
    fn velocity(&self, row: usize, i: usize) -> f64 {
        let demand = self.demand;
        let before = match row.checked_sub(1) {
            Some(row) => Some(row),
            None => demand.cyclic.then(|| demand.rows() - 1),
        };
        let after = (row < demand.steps()).then_some(row);
        let time = |step: usize| demand.step_share[step];
        let slope = |step: usize| (self.at(demand.after(step), i) - self.at(step, i)) / time(step);
        match (before, after) {
            (Some(a), Some(b)) => {
                let (ta, tb) = (time(a), time(b));
                (slope(a) * tb + slope(b) * ta) / (ta + tb)
            }
            (Some(step), None) | (None, Some(step)) => slope(step),
            (None, None) => 0.0,
        }
    }

    /// Joint `i` at the share `u` of a step.
    fn between(&self, step: usize, i: usize, u: f64) -> f64 {
        let (a, b, h) = (step, self.demand.after(step), self.demand.step_share[step]);
        let (u2, u3) = (u * u, u * u * u);
        (2.0 * u3 - 3.0 * u2 + 1.0) * self.at(a, i)
            + (3.0 * u2 - 2.0 * u3) * self.at(b, i)
            + h * ((u3 - 2.0 * u2 + u) * self.velocity(a, i) + (u3 - u2) * self.velocity(b, i))
    }
}

/// Largest excess over a position limit on the fine grid.
pub(super) fn limit_excess(demand: &Demand, q: &[f64]) -> f64 {
    let curve = Curve { demand, q };
    let mut excess: f64 = 0.0;
    if demand.rows() < 2 {
        return excess;
    }
    for i in 0..demand.dof() {
        let (lower, upper) = (demand.lower[i], demand.upper[i]);
        for step in 0..demand.steps() {
            let (a, b) = (step, demand.after(step));
            let (p, r, h) = (curve.at(a, i), curve.at(b, i), demand.step_share[step]);
            // Away from its limits a joint cannot reach them: the cubic stays within the chord and its end slopes.
            let reach = h * (curve.velocity(a, i).abs() + curve.velocity(b, i).abs()) * 0.25;
            if p.min(r) - reach > lower && p.max(r) + reach < upper {
                continue;
            }
            for k in 1..FINER {
                let value = curve.between(step, i, k as f64 / FINER as f64);
                excess = excess.max(lower - value).max(value - upper);
            }
        }
    }
    excess
}

/// The first step on which something touches, and what: of the pairs that the freedom moves, or of those that it cannot.
pub(super) fn first_contact(demand: &Demand, q: &[f64], moved: bool) -> Option<(usize, SweepHit)> {
    let around = demand.around.as_ref()?;
    let pairs = if moved { &around.moved } else { &around.held };
    if pairs.is_empty() {
        return None;
    }
    let (curve, n) = (Curve { demand, q }, demand.dof());
    let on_step = |memory: &mut (SweepMemory, [Vec<f64>; 2]), step: usize| {
        let (sweeps, [from, to]) = memory;
        let duration = demand.step_time.as_ref().map_or(0.0, |times| times[step]);
        to.clear();
        to.extend_from_slice(&q[step * n..(step + 1) * n]);
        (1..=PARTS).find_map(|k| {
            std::mem::swap(from, to);
            let u = k as f64 / PARTS as f64;
            to.clear();
            to.extend((0..n).map(|i| curve.between(step, i, u)));
            let time = |k: usize| demand.time[step] + duration * k as f64 / PARTS as f64;
            Some((step, sweep(pairs, [from, to], [time(k - 1), time(k)], 0.0, sweeps)?))
        })
    };
    let memory = || (SweepMemory::new(&demand.chain), [Vec::new(), Vec::new()]);
    let hits = (0..demand.steps()).into_par_iter().with_min_len(8).map_init(memory, on_step).flatten();
    hits.min_by_key(|hit| hit.0)
}

/// The first step that is not on one piece of the solutions.
pub(super) fn first_jump(demand: &Demand, q: &[f64]) -> Option<usize> {
    let n = demand.dof();
    let steps: Vec<bool> = (0..demand.steps())
        .into_par_iter()
        .with_min_len(32)
        .map_init(
            || Puller::new(demand),
            |puller, step| {
                let (a, b) = (step, demand.after(step));
                is_continuous(puller, demand, [a, b], &q[a * n..(a + 1) * n], &q[b * n..(b + 1) * n])
            },
        )
        .collect();
    steps.iter().position(|continuous| !continuous)
}

/// Whether two configurations over neighbouring rows are on one piece.
pub(super) fn is_continuous(
    puller: &mut Puller<'_>,
    demand: &Demand,
    rows: [usize; 2],
    a: &[f64],
    b: &[f64],
) -> bool {
    let targets = rows.map(|row| &demand.targets[row]);
    joined(puller, demand, targets, [a, b], HALVINGS)
}

/// Whether the point half-way is met half-way, or where the arm turns fast, whether both halves of the step are such steps.
fn joined(
    puller: &mut Puller<'_>,
    demand: &Demand,
    targets: [&Target; 2],
    [a, b]: [&[f64]; 2],
    halvings: usize,
) -> bool {
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (b - a).powi(2)).sum::<f64>().sqrt();
    let length = distance(a, b);
    if length <= SHORT_STEP {
        return true;
    }
    let straight: Vec<f64> = a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
    let mut q = straight.clone();
    let target = between(demand, targets[0], targets[1]);
    if !puller.pull_free(&mut q, &target, &Pull::ONTO) {
        return false;
    }
    if distance(&q, &straight) <= MIDDLE_SHARE * length {
        return true;
    }
    // Both halves of a jump cannot become shorter.
    halvings > 0
        && distance(a, &q).max(distance(&q, b)) < length
        && joined(puller, demand, [targets[0], &target], [a, &q], halvings - 1)
        && joined(puller, demand, [&target, targets[1]], [&q, b], halvings - 1)
}

/// The point half-way between two points of the path.
fn between(demand: &Demand, a: &Target, b: &Target) -> Target {
    let turn = b.pose.rotation * a.pose.rotation.inverse();
    let half = nalgebra::Rotation3::from_scaled_axis(crate::kinematics::rotation_vector(&turn) * 0.5);
    let place = (a.pose.translation.vector + b.pose.translation.vector) * 0.5;
    let pose = Pose::from_parts(nalgebra::Translation3::from(place), half * a.pose.rotation);
    demand.tool.target(&pose)
}
