//! Checks of each joint: limits between the rows, jumps, whole turns, rest at the ends.

use super::finding::FindingKind;
use super::interval::{derivative, leaves, position};
use super::settings::CheckSettings;
use super::spots::{Owner, Spot};
use crate::chain::Chain;
use crate::joint_space::{TURN, difference, turns};
use crate::path::{Trajectory, differences};
use crate::tolerance::{CHECK_JUMP_RATIO, CHECK_REST, CHECK_TURN, CHECK_WITHIN};

/// What rounding of times adds to a derivative of order 1, 2, 3 of a quintic or cubic whose rise is wrong by 1, with the
/// powers of the interval's length: the largest derivatives of the basis functions of the rise.
const ROUNDING: [f64; 3] = [2.0, 6.0, 60.0];

/// Position, velocity, acceleration and jerk of all joints in the intervals `from..to`.
pub(super) fn limits(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    [from, to]: [usize; 2],
) -> Vec<Spot> {
    let mut out = Vec::new();
    let n = chain.dof();
    let t = trajectory.t();
    let orders = [
        (FindingKind::Velocity, settings.velocity_limits.as_deref()),
        (FindingKind::Acceleration, settings.acceleration_limits.as_deref()),
        (FindingKind::Jerk, settings.jerk_limits.as_deref()),
    ];
    for k in from..to {
        let h = t[k + 1] - t[k];
        let mut add = |kind: FindingKind, j: usize, u: f64, value: f64, bound: f64, weight: f64| {
            let row = if u > 0.5 { k + 1 } else { k };
            let (owner, t) = (Owner::joint(kind, j), t[k] + u * h);
            out.push(Spot { owner, cell: k, row, t, value, bound, weight, message: None });
        };
        for j in 0..n {
            let mut p = position(trajectory, k, j);
            let (low, high) = (chain.lower()[j] - CHECK_WITHIN, chain.upper()[j] + CHECK_WITHIN);
            if let Some((u, q)) = leaves(&p, low, high) {
                let bound = if q > high { chain.upper()[j] } else { chain.lower()[j] };
                add(FindingKind::Position, j, u, q, bound, (q - bound).abs());
            }
            let speed = trajectory.qd()[k * n + j].abs().max(trajectory.qd()[(k + 1) * n + j].abs());
            for (order, (kind, limits)) in orders.iter().enumerate() {
                p = derivative(&p, h);
                let Some(limit) = limits.map(|limits| limits[j]).filter(|limit| limit.is_finite()) else {
                    continue;
                };
                let rounding = ROUNDING[order] * speed * settings.time_rounding / h.powi(order as i32 + 1);
                let most = limit * (1.0 + settings.tolerance) + rounding;
                if let Some((u, v)) = leaves(&p, -most, most) {
                    add(*kind, j, u, v, limit, v.abs() / limit);
                }
            }
        }
    }
    out
}

/// Accelerations that jump at a row beyond what the jerk limits allow between the middles of the intervals beside it.
pub(super) fn acceleration_jumps(trajectory: &Trajectory, settings: &CheckSettings) -> Vec<Spot> {
    let (Some(limits), None) = (&settings.jerk_limits, trajectory.qdd()) else { return Vec::new() };
    let (n, t) = (trajectory.dof(), trajectory.t());
    let mut out = Vec::new();
    for k in 1..trajectory.rows().saturating_sub(1) {
        let (before, after) = (t[k] - t[k - 1], t[k + 1] - t[k]);
        for j in (0..n).filter(|j| limits[*j].is_finite()) {
            let at = |k: usize, h: f64, u: f64| {
                super::interval::value(&derivative(&derivative(&position(trajectory, k, j), h), h), u)
            };
            let jump = at(k, after, 0.0) - at(k - 1, before, 1.0);
            let value = jump / (0.5 * (before + after));
            let speed = trajectory.qd()[k * n + j].abs();
            let least = before.min(after);
            let rounding = 2.0 * ROUNDING[1] * speed * settings.time_rounding / least.powi(3);
            if value.abs() > limits[j] * (1.0 + settings.tolerance) + rounding {
                let owner = Owner { part: 1, ..Owner::joint(FindingKind::Jerk, j) };
                let message = format!(
                    "the acceleration of joint '{}' jumps by {jump:.6} at row {k}, a jerk of {value:.6} over the \
                     intervals beside it; the limit is {:.6}, at {:.6} s",
                    trajectory.joint_names()[j],
                    limits[j],
                    t[k]
                );
                let (bound, weight) = (limits[j], value.abs() / limits[j]);
                out.push(Spot {
                    owner,
                    cell: k,
                    row: k,
                    t: t[k],
                    value,
                    bound,
                    weight,
                    message: Some(message),
                });
            }
        }
    }
    out
}

/// Jumps from row to row, and turns by whole turns.
pub(super) fn steps(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    on_path: bool,
) -> Vec<Spot> {
    let (n, t, q) = (trajectory.dof(), trajectory.t(), trajectory.q());
    let last = trajectory.rows().saturating_sub(1);
    let mut out = Vec::new();
    for (j, joint) in chain.joints().iter().enumerate() {
        let turning = joint.kind.is_rotational();
        let limit = settings.velocity_limits.as_ref().map_or(f64::INFINITY, |limits| limits[j]);
        let step = |k: usize| q[(k + 1) * n + j] - q[k * n + j];
        let speed = |k: usize| step(k).abs() / (t[k + 1] - t[k]);
        let unit = if turning { "rad" } else { "m" };
        for k in 0..last {
            let (rise, h) = (step(k), t[k + 1] - t[k]);
            let allowed = limit * (1.0 + settings.tolerance) * h;
            let beside = [k.checked_sub(1), (k + 1 < last).then_some(k + 1)];
            let jumps = beside.into_iter().flatten().any(|other| speed(k) > CHECK_JUMP_RATIO * speed(other));
            let too_far = turning && on_path && rise.abs() > settings.max_step;
            let mut add = |kind: FindingKind, bound: f64, message: String| {
                let (owner, value) = (Owner::joint(kind, j), rise);
                let (t, row, weight) = (t[k + 1], k + 1, rise.abs());
                out.push(Spot { owner, cell: k, row, t, value, bound, weight, message: Some(message) });
            };
            if too_far || (jumps && rise.abs() > allowed) {
                let bound = if too_far { allowed.min(settings.max_step) } else { allowed };
                let message = format!(
                    "joint '{}' steps {rise:.6} {unit} from row {k} to row {} within {h:.6} s, at most {bound:.6} is \
                     allowed",
                    joint.name,
                    k + 1
                );
                add(FindingKind::Step, bound, message);
            }
            if turning && turns(rise) != 0.0 && difference(0.0, rise).abs() < CHECK_TURN {
                let message = format!(
                    "joint '{}' turns by {:.0} whole turns from row {k} to row {}: is its angle wrapped?",
                    joint.name,
                    turns(rise).abs(),
                    k + 1
                );
                add(FindingKind::Winding, CHECK_TURN, message);
            }
        }
    }
    out
}

/// A motion that ends where it began but for whole turns of some joints.
pub(super) fn wound_up(chain: &Chain, trajectory: &Trajectory) -> Vec<Spot> {
    let Some(last) = trajectory.rows().checked_sub(1) else { return Vec::new() };
    let rises: Vec<f64> =
        trajectory.q_row(0).iter().zip(trajectory.q_row(last)).map(|(a, b)| b - a).collect();
    let returns = rises.iter().zip(chain.joints()).all(|(rise, joint)| {
        let left = if joint.kind.is_rotational() { difference(0.0, *rise) } else { *rise };
        left.abs() < CHECK_TURN
    });
    if !returns {
        return Vec::new();
    }
    let t = trajectory.t()[last];
    let wound =
        (0..chain.dof()).filter(|j| chain.joints()[*j].kind.is_rotational() && turns(rises[*j]) != 0.0);
    wound
        .map(|j| {
            let (count, name) = (turns(rises[j]).abs(), &chain.joints()[j].name);
            let message = format!(
                "joint '{name}' ends {count:.0} whole turns from where it began, the other joints return"
            );
            let owner = Owner { part: 1, ..Owner::joint(FindingKind::Winding, j) };
            let (value, bound, weight) = (rises[j], TURN, rises[j].abs());
            Spot { owner, cell: last, row: last, t, value, bound, weight, message: Some(message) }
        })
        .collect()
}

/// Whether the velocities are differences of the positions: a file whose times are rounded has them nearly.
fn are_differences(trajectory: &Trajectory, time_rounding: f64) -> bool {
    let (n, t) = (trajectory.dof(), trajectory.t());
    let least = t.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let share = SAME_DIFFERENCE + 2.0 * time_rounding / least;
    let mut pairs = trajectory.qd().iter().zip(differences(t, trajectory.q(), n));
    let most = trajectory.qd().iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    pairs.all(|(given, computed)| (given - computed).abs() <= share * most)
}

/// Rounding of a difference, as a share of the largest velocity.
const SAME_DIFFERENCE: f64 = 1e-9;

/// First and last row at rest.
pub(super) fn rest(chain: &Chain, trajectory: &Trajectory, settings: &CheckSettings) -> Vec<Spot> {
    let rows = trajectory.rows();
    if !settings.at_rest || rows == 0 {
        return Vec::new();
    }
    let (n, t) = (trajectory.dof(), trajectory.t());
    // Velocities that are only differences of positions are those half an interval away.
    let only_differences = rows > 1 && are_differences(trajectory, settings.time_rounding);
    let limit = |limits: &Option<Vec<f64>>, j: usize| limits.as_ref().map_or(f64::INFINITY, |l| l[j]);
    let mut out = Vec::new();
    for row in if rows == 1 { vec![0] } else { vec![0, rows - 1] } {
        let h = if rows == 1 { 0.0 } else { t[row.max(1)] - t[row.max(1) - 1] };
        for (j, joint) in chain.joints().iter().enumerate() {
            let unit = if joint.kind.is_rotational() { "rad" } else { "m" };
            let speed = trajectory.qd()[row * n + j];
            let acceleration = limit(&settings.acceleration_limits, j);
            let slack = if only_differences && acceleration.is_finite() { acceleration * h } else { 0.0 };
            let mut add = |value: f64, bound: f64, part: usize, what: String| {
                let owner = Owner { part, ..Owner::joint(FindingKind::NotAtRest, j) };
                let end = if row == 0 { "first" } else { "last" };
                let message = format!(
                    "joint '{}' {what} in the {end} row (row {row}), where it must be at rest",
                    joint.name
                );
                let (weight, t) = (value.abs(), t[row]);
                out.push(Spot { owner, cell: row, row, t, value, bound, weight, message: Some(message) });
            };
            if speed.abs() > CHECK_REST + slack {
                add(speed, CHECK_REST, 0, format!("moves at {speed:.6} {unit}/s"));
            }
            // A file without accelerations has those of its interpolation, so that every format says the same: within the
            // interval at the end the jerk limit may have made them.
            let bound = CHECK_REST + limit(&settings.jerk_limits, j) * h.max(settings.time_rounding.sqrt());
            let value = acceleration_at_end(trajectory, row, j);
            if settings.jerk_limits.is_some() && value.abs() > bound {
                let source =
                    if trajectory.qdd().is_some() { "" } else { " (by its positions and velocities)" };
                add(value, bound, 1, format!("accelerates at {value:.6} {unit}/s^2{source}"));
            }
        }
    }
    out
}

/// Acceleration of joint `j` at the first or the last row.
fn acceleration_at_end(trajectory: &Trajectory, row: usize, j: usize) -> f64 {
    if let Some(qdd) = trajectory.qdd() {
        return qdd[row * trajectory.dof() + j];
    }
    if trajectory.rows() < 2 {
        return 0.0;
    }
    let (k, u) = if row == 0 { (0, 0.0) } else { (row - 1, 1.0) };
    let h = trajectory.t()[k + 1] - trajectory.t()[k];
    super::interval::value(&derivative(&derivative(&position(trajectory, k, j), h), h), u)
}
