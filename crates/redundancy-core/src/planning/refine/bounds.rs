//! The bounds of a line: which take part, and how far they are broken.

use super::super::demand::Demand;
use super::super::tool::MOST_BOUNDS;
use super::goal::Goal;

/// Which bounds take part: those that a line comes near to.
#[derive(Debug, Clone)]
pub(super) struct Sets {
    pub bounds: Vec<usize>,
    pub steps: Vec<usize>,
    pub peak: Vec<usize>,
}

/// The bounds that a line comes near to.
pub(super) fn screened(demand: &Demand, q: &[f64], goal: Goal) -> Sets {
    let n = demand.dof();
    let near = |i: usize| {
        let near = NEAR_LIMIT.max(NEAR_RANGE * demand.range[i][1]);
        room(demand, q, i) < near
    };
    let peak = if matches!(goal, Goal::Peak(_)) {
        (0..n).filter(|i| demand.speed_weight[*i] > 0.0).collect()
    } else {
        Vec::new()
    };
    Sets {
        bounds: (0..n).filter(|i| near(*i)).collect(),
        steps: (0..n).filter(|i| load(demand, q, *i, goal) > NEAR_STEP).collect(),
        peak,
    }
}

impl Sets {
    /// Takes in the bounds that a line breaks; false where there are none.
    pub fn widen(&mut self, demand: &Demand, q: &[f64], goal: Goal) -> bool {
        let n = demand.dof();
        let before = self.bounds.len() + self.steps.len();
        for i in 0..n {
            if !self.bounds.contains(&i) && room(demand, q, i) < 0.0 {
                self.bounds.push(i);
            }
            if !self.steps.contains(&i) && load(demand, q, i, goal) > 1.0 {
                self.steps.push(i);
            }
        }
        self.bounds.len() + self.steps.len() > before
    }
}

/// Least distance of a joint from its limits.
fn room(demand: &Demand, q: &[f64], i: usize) -> f64 {
    let column = q.iter().skip(i).step_by(demand.dof());
    column.fold(f64::INFINITY, |room, q| room.min(q - demand.lower[i]).min(demand.upper[i] - q))
}

/// Largest step of a joint, as a share of its bound.
fn load(demand: &Demand, q: &[f64], i: usize, goal: Goal) -> f64 {
    let n = demand.dof();
    (0..demand.steps())
        .map(|k| (q[demand.after(k) * n + i] - q[k * n + i]).abs() / step_bound(demand, goal, k, i))
        .fold(0.0, f64::max)
}

/// Most inequalities of a row: those of the tool, and the room.
pub(super) const MOST_ROW_BOUNDS: usize = MOST_BOUNDS + 1;

/// Values of the inequalities of a row.
pub(super) fn row_bounds(demand: &Demand, row: usize, q: &[f64]) -> [f64; MOST_ROW_BOUNDS] {
    let mut h = [f64::INFINITY; MOST_ROW_BOUNDS];
    let bounds = demand.tool.bounds();
    if bounds > 0 {
        demand.tool.bound_values(&demand.chain.forward_unchecked(q), &demand.targets[row], &mut h);
    }
    if let Some(near) = demand.near(row, q) {
        h[bounds] = room_bound(demand, near.room);
    }
    h
}

/// The room as an inequality of order 1.
pub(super) fn room_bound(demand: &Demand, room: f64) -> f64 {
    (room - demand.safe) / ROOM_SCALE
}

pub(super) fn step_bound(demand: &Demand, goal: Goal, step: usize, i: usize) -> f64 {
    let bound = demand.step_bound[step * demand.dof() + i];
    match (goal, &demand.step_time) {
        (Goal::Capped(cap), Some(times)) if demand.speed_weight[i] > 0.0 => {
            bound.min(cap * times[step] / demand.speed_weight[i])
        }
        _ => bound,
    }
}

/// Largest violation of a bound along a line, and its row.
pub(super) fn violation(demand: &Demand, q: &[f64], goal: Goal) -> (f64, usize) {
    let (n, bounds) = (demand.dof(), demand.tool.bounds());
    let mut worst = (0.0, 0);
    let mut meet = |excess: f64, row: usize| {
        if excess > worst.0 {
            worst = (excess, row);
        }
    };
    for (row, q) in q.chunks_exact(n).enumerate() {
        if demand.given(row).is_some() {
            continue;
        }
        for i in 0..n {
            meet((demand.lower[i] - q[i]).max(q[i] - demand.upper[i]), row);
        }
        if bounds > 0 {
            let mut h = [0.0; MOST_BOUNDS];
            demand.tool.bound_values(&demand.chain.forward_unchecked(q), &demand.targets[row], &mut h);
            h[..bounds].iter().for_each(|h| meet(-h, row));
        }
        // The distance itself: its smooth lower bound, and the room for the way between rows, are no limits.
        if !demand.is_clear(row, q)
            && let Some([Some(near), _]) =
                demand.around.as_ref().map(|around| around.nearest(q, demand.time[row]))
        {
            meet(-near.gap.distance, row);
        }
    }
    for step in 0..demand.steps() {
        let (a, b) = (step * n, demand.after(step) * n);
        for i in 0..n {
            meet((q[b + i] - q[a + i]).abs() - step_bound(demand, goal, step, i), step);
        }
    }
    worst
}

/// `- mu sum log s`.
pub(super) fn barrier(s: &[f64], mu: f64) -> f64 {
    // Products of eight slacks at a time: one logarithm for all of them.
    let sum: f64 = (s.chunks(8)).map(|s| s.iter().filter(|s| s.is_finite()).product::<f64>().ln()).sum();
    -mu * sum
}

/// `sum |h - s|`.
pub(super) fn infeasibility(h: &[f64], s: &[f64]) -> f64 {
    h.iter().zip(s).filter(|(_, s)| s.is_finite()).map(|(h, s)| (h - s).abs()).sum()
}

/// Distance from a limit (rad or m, or share of half the range) within which it takes part.
const NEAR_LIMIT: f64 = 0.3;
const NEAR_RANGE: f64 = 0.2;
/// Share of the largest step from which its bound takes part.
const NEAR_STEP: f64 = 0.6;
/// Least slack of a start: rad or m, for cone and spin in their own scale, for steps as a share of the largest.
pub(super) const LEAST_SLACK: f64 = 1e-2;
/// Share of the scale up to which a bound counts as met: then its slack starts further inside.
pub(super) const NEAR_SLACK: f64 = 1e-3;
/// Room, m, that counts as much as the whole of a cone.
pub(super) const ROOM_SCALE: f64 = 0.1;
