//! Checks of a joint trajectory before an arm runs it.
//!
//! # What is judged
//! The trajectory is what [`Trajectory::sample`](crate::path::Trajectory::sample) makes of its rows. Positions, velocities,
//! accelerations and jerks are judged between the rows too: each is a polynomial whose Bernstein coefficients bound it, so
//! that nothing is missed. Torques are judged at both ends and in the middle of each interval, singularities and the path at
//! the rows, collisions at rows and places between them.
//!
//! Files carry rounded numbers: limits have a relative slack, and what rounding of the times adds is left out
//! ([`CheckSettings::tolerance`], [`CheckSettings::time_rounding`]).
//!
//! Cost: linear in the rows, on all cores; about a microsecond per row and joint.

mod arm;
mod contact;
mod finding;
mod interval;
mod joints;
mod on_path;
mod settings;
mod spots;

pub use finding::{CheckReport, Finding, FindingKind, Severity};
pub use settings::{CheckAgainst, CheckSettings};

use self::spots::{Owner, Spot};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::parallel::prelude::*;
use crate::path::{JointRows, Trajectory};
use crate::tolerance::CHECK_LEAST_INTERVAL;

/// Intervals that one task of the pool takes.
const BLOCK: usize = 2_048;

/// Checks a trajectory against the limits of its arm, and against a path and a scene where they are given.
///
/// ```
/// use redundancy_core::{chain::catalog, path::Trajectory};
/// use redundancy_core::timing::{CheckAgainst, CheckSettings, FindingKind, RetimeSettings, check, retime};
/// let arm = catalog::load("panda")?;
/// let rows: Vec<f64> = (0..50).flat_map(|k| (0..7).map(move |j| if j == 3 { -1.0 } else { 0.01 * f64::from(k) })).collect();
/// let motion = retime(&arm, &rows, &RetimeSettings::of(&arm))?.trajectory;
/// let settings = CheckSettings::of(&arm);
/// assert!(check(&arm, &motion, &settings, CheckAgainst::default())?.findings.is_empty());
/// let t = motion.t().iter().map(|t| 0.5 * t).collect();
/// let fast = Trajectory::new(motion.joint_names().to_vec(), t, motion.q().to_vec(), None, Vec::new())?;
/// let report = check(&arm, &fast, &settings, CheckAgainst::default())?;
/// assert!(report.findings.iter().any(|finding| finding.kind == FindingKind::Velocity));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// A trajectory whose joints are not those of the chain, positions that seem to be in degrees, invalid settings.
pub fn check(
    chain: &Chain,
    trajectory: &Trajectory,
    settings: &CheckSettings,
    against: CheckAgainst<'_>,
) -> Result<CheckReport> {
    check_rows(chain, &JointRows::from(trajectory.clone()), settings, against)
}

/// [`check`] of rows that need not be a trajectory yet: joints in any order, times that may not increase.
///
/// # Errors
/// As [`check`].
pub fn check_rows(
    chain: &Chain,
    rows: &JointRows,
    settings: &CheckSettings,
    against: CheckAgainst<'_>,
) -> Result<CheckReport> {
    settings.validate(chain)?;
    let rows = rows.in_order_of(chain)?;
    if rows.t.is_empty() {
        return Err(Error::Invalid("the trajectory has no rows".into()));
    }
    if let Some(question) = chain.ask_about_degrees(&rows.q) {
        return Err(Error::Invalid(question));
    }
    let last_row = rows.t.len() - 1;
    let backwards = backwards(&rows.t);
    if !backwards.is_empty() {
        let findings = spots::findings(chain, backwards, last_row);
        return Ok(CheckReport { findings, rows: rows.t.len(), judged: false });
    }
    let trajectory = rows.trajectory()?;
    let mut spots = times(trajectory.t());
    let blocks = last_row.div_ceil(BLOCK).max(1);
    let parts = (0..blocks).into_par_iter().map(|block| {
        let range = [block * BLOCK, ((block + 1) * BLOCK).min(last_row)];
        let mut spots = joints::limits(chain, &trajectory, settings, range);
        spots.extend(arm::torques(chain, &trajectory, settings, range)?);
        // The last block has the last row too.
        let rows = [range[0], range[1] + usize::from(block + 1 == blocks)];
        spots.extend(arm::singularities(chain, &trajectory, settings, rows));
        Ok(spots)
    });
    for part in parts.collect::<Vec<Result<Vec<Spot>>>>() {
        spots.extend(part?);
    }
    spots.extend(joints::acceleration_jumps(&trajectory, settings));
    spots.extend(joints::steps(chain, &trajectory, settings, against.path.is_some()));
    spots.extend(joints::wound_up(chain, &trajectory));
    spots.extend(joints::rest(chain, &trajectory, settings));
    if let Some(path) = against.path {
        spots.extend(on_path::deviations(chain, &trajectory, path, settings)?);
    }
    spots.extend(contact::collisions(chain, &trajectory, settings, against)?);
    Ok(CheckReport { findings: spots::findings(chain, spots, last_row), rows: last_row + 1, judged: true })
}

/// Rows that are not later than the row before them.
fn backwards(t: &[f64]) -> Vec<Spot> {
    let late = (1..t.len()).filter(|k| t[*k] <= t[*k - 1]);
    late.map(|k| {
        let message = format!("the time of row {k} is {} s after {} s: times must increase", t[k], t[k - 1]);
        time(k, t[k], t[k] - t[k - 1], 0.0, message)
    })
    .collect()
}

/// Times before the start, and rows too close to each other.
fn times(t: &[f64]) -> Vec<Spot> {
    let early = t
        .first()
        .filter(|t| **t < 0.0)
        .map(|t| time(0, *t, *t, 0.0, format!("the time of row 0 is {t} s, it must not be negative")));
    let close = (1..t.len()).filter(|k| t[*k] - t[*k - 1] < CHECK_LEAST_INTERVAL).map(|k| {
        let gap = t[k] - t[k - 1];
        let message = format!(
            "row {k} is {gap:e} s after the row before, at least {CHECK_LEAST_INTERVAL:e} s is needed"
        );
        time(k, t[k], gap, CHECK_LEAST_INTERVAL, message)
    });
    early.into_iter().chain(close).collect()
}

fn time(row: usize, t: f64, value: f64, bound: f64, message: String) -> Spot {
    let owner = Owner::arm(FindingKind::Time);
    Spot { owner, cell: row, row, t, value, bound, weight: (value - bound).abs(), message: Some(message) }
}
