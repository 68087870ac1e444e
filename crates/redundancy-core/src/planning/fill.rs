//! From a line on some rows to a line on more of them.
//!
//! Between two configurations the joints go straight, and each row is pulled onto the task. Where they are not
//! connected (another branch, a fold in between) a step is far longer than the straight line's: that step is refused.

use super::demand::Demand;
use super::pull::{Pull, Puller};
use crate::parallel::prelude::*;

/// Fills the line `q` on `from` (rows of `demand`, ascending) to the rows `to`, which hold those of `from`.
/// The error is the first step of the line that is not connected.
pub(super) fn fill(demand: &Demand, from: &[usize], q: &[f64], to: &[usize]) -> Result<Vec<f64>, usize> {
    let n = demand.dof();
    let steps = if demand.cyclic { from.len() } else { from.len() - 1 };
    let parts: Vec<Option<Vec<f64>>> = (0..steps)
        .into_par_iter()
        .with_min_len(4)
        .map_init(
            || Puller::new(demand),
            |puller, step| {
                let next = if step + 1 == from.len() { 0 } else { step + 1 };
                let end = if next == 0 { demand.rows() } else { from[next] };
                let inner: Vec<usize> =
                    to.iter().copied().filter(|row| *row > from[step] && *row < end).collect();
                let (a, b) = (&q[step * n..(step + 1) * n], &q[next * n..(next + 1) * n]);
                between(puller, demand, a, b, &inner)
            },
        )
        .collect();
    let mut out = Vec::with_capacity(to.len() * n);
    for (step, part) in parts.into_iter().enumerate() {
        out.extend_from_slice(&q[step * n..(step + 1) * n]);
        out.extend(part.ok_or(step)?);
    }
    if !demand.cyclic {
        out.extend_from_slice(&q[(from.len() - 1) * n..]);
    }
    Ok(out)
}

fn between(
    puller: &mut Puller<'_>,
    demand: &Demand,
    a: &[f64],
    b: &[f64],
    rows: &[usize],
) -> Option<Vec<f64>> {
    let n = a.len();
    let parts = (rows.len() + 1) as f64;
    let straight = a.iter().zip(b).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
    let longest = FREE_STEP + LONG_STEP * straight / parts;
    let mut out: Vec<f64> = Vec::with_capacity(rows.len() * n);
    let mut before = a.to_vec();
    let mut q = vec![0.0; n];
    let near = |before: &[f64], q: &[f64]| before.iter().zip(q).all(|(a, b)| (b - a).abs() <= longest);
    for (j, row) in rows.iter().enumerate() {
        let rest = (rows.len() + 1 - j) as f64;
        for i in 0..n {
            q[i] = before[i] + (b[i] - before[i]) / rest;
        }
        if !puller.pull(&mut q, &demand.targets[*row], &Pull::NEAR) || !near(&before, &q) {
            return None;
        }
        out.extend_from_slice(&q);
        before.copy_from_slice(&q);
    }
    near(&before, b).then_some(out)
}

/// Joint step (rad or m) between rows that is always taken for continuous, and beyond it the factor of the straight step.
const FREE_STEP: f64 = 0.25;
const LONG_STEP: f64 = 2.5;
