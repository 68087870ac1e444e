//! Checks that need the arm: torques, and configurations near a singularity.

use super::finding::FindingKind;
use super::settings::CheckSettings;
use super::spots::{Owner, Spot};
use crate::chain::Chain;
use crate::error::Result;
use crate::kinematics::{DynamicsScratch, NullSpace, Scratch};
use crate::path::Trajectory;

/// Places of an interval at which torques are checked.
const PLACES: [f64; 3] = [0.0, 0.5, 1.0];

/// Torques in the intervals `from..to`.
pub(super) fn torques(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    [from, to]: [usize; 2],
) -> Result<Vec<Spot>> {
    let Some(limits) = &settings.torque_limits else { return Ok(Vec::new()) };
    let (bodies, n) = (chain.masses()?, chain.dof());
    let mut scratch = DynamicsScratch::new(chain);
    let mut state: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; n]);
    let (mut weights, mut moving) = (vec![0.0; n], vec![0.0; n]);
    let mut out = Vec::new();
    for k in from..to {
        let (start, h) = (trajectory.t()[k], trajectory.t()[k + 1] - trajectory.t()[k]);
        for u in PLACES {
            let t = start + u * h;
            trajectory.sample_interval(k, t, state.each_mut().map(Vec::as_mut_slice))?;
            let motion = [&state[0][..], &state[1][..], &state[2][..]];
            chain.split_torques(bodies, motion, &settings.gravity, &mut scratch, &mut weights, &mut moving);
            for (j, limit) in limits.iter().enumerate().filter(|(_, limit)| limit.is_finite()) {
                let value = weights[j] + moving[j];
                if value.abs() > limit * (1.0 + settings.tolerance) {
                    let owner = Owner::joint(FindingKind::Torque, j);
                    let (row, weight) = (if u > 0.5 { k + 1 } else { k }, value.abs() / limit);
                    out.push(Spot { owner, cell: k, row, t, value, bound: *limit, weight, message: None });
                }
            }
        }
    }
    Ok(out)
}

/// Rows `from..to` whose Jacobian is nearly of lower rank.
pub(super) fn singularities(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    [from, to]: [usize; 2],
) -> Vec<Spot> {
    let n = chain.dof();
    if settings.singularity == 0.0 || n == 0 {
        return Vec::new();
    }
    let mut scratch = Scratch::new(chain);
    let (m, wide) = (n.min(6), n >= 6);
    let mut space = NullSpace::new(m, n.max(6));
    let mut out = Vec::new();
    for row in from..to {
        let kinematics = chain.kinematics_unchecked(trajectory.q_row(row), &mut scratch);
        let jacobian = kinematics.jacobian().as_slice();
        if surely_regular(jacobian, n, settings.singularity) {
            continue;
        }
        if wide {
            space.factor(jacobian);
        } else {
            // Fewer joints than coordinates: the columns must be independent.
            let turned: Vec<f64> =
                (0..6).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| jacobian[6 * j + i]).collect();
            space.factor(&turned);
        }
        let [least, most] = space.singular_values();
        let value = if most > 0.0 { least / most } else { 0.0 };
        if value < settings.singularity {
            let (bound, t) = (settings.singularity, trajectory.t()[row]);
            let message = format!(
                "row {row} is near a singularity: the least singular value of the Jacobian is {value:.3e} of the \
                 largest, below {bound:.3e}, at {t:.6} s"
            );
            let owner = Owner::arm(FindingKind::Singularity);
            let weight = -value;
            out.push(Spot { owner, cell: row, row, t, value, bound, weight, message: Some(message) });
        }
    }
    out
}

/// Whether `J J^T - r^2 |J|^2 I` is positive definite: then the least singular value is above `r` times the largest.
fn surely_regular(jacobian: &[f64], n: usize, ratio: f64) -> bool {
    if n < 6 {
        return false;
    }
    let mut a = [[0.0; 6]; 6];
    for column in jacobian.as_chunks::<6>().0 {
        for i in 0..6 {
            for k in 0..=i {
                a[i][k] += column[i] * column[k];
            }
        }
    }
    let trace: f64 = (0..6).map(|i| a[i][i]).sum();
    for (i, row) in a.iter_mut().enumerate() {
        row[i] -= ratio * ratio * trace;
    }
    // Cholesky, as far as the pivots are positive.
    for j in 0..6 {
        let pivot = a[j][j] - (0..j).map(|k| a[j][k] * a[j][k]).sum::<f64>();
        if pivot <= f64::EPSILON * trace {
            return false;
        }
        a[j][j] = pivot.sqrt();
        for i in j + 1..6 {
            let dot: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            a[i][j] = (a[i][j] - dot) / a[j][j];
        }
    }
    true
}
