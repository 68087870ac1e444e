//! A straight move in joint space: timed, checked, and returned only if there is no contact.

use super::check::{CheckAgainst, CheckSettings, FindingKind, check};
use super::retime::{RetimeSettings, retime};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::path::Trajectory;

/// The fastest straight move from one configuration to another, from rest to rest.
///
/// ```
/// use redundancy_core::{chain::catalog, timing::{CheckAgainst, RetimeSettings, joint_move}};
/// let arm = catalog::load("panda")?;
/// let [from, to] = [[0.0, 0.3, 0.0, -1.0, 0.2, 1.0, 0.0], [0.5, 0.3, 0.0, -1.0, 0.2, 1.0, 0.0]];
/// let moved = joint_move(&arm, [&from, &to], &RetimeSettings::of(&arm), CheckAgainst::default(), 0.0)?;
/// assert_eq!(moved.q_row(moved.rows() - 1), to);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
///
/// # Errors
/// Wrong lengths, invalid settings; a move that leaves the position limits or comes nearer than `clearance` (m) to an
/// obstacle: which joint or link, and when.
pub fn joint_move(
    chain: &Chain,
    [from, to]: [&[f64]; 2],
    settings: &RetimeSettings,
    against: CheckAgainst<'_>,
    clearance: f64,
) -> Result<Trajectory> {
    chain.check_q(from)?;
    chain.check_q(to)?;
    let moved = retime(chain, &[from, to].concat(), settings)?.trajectory;
    let looked_for = CheckSettings {
        velocity_limits: None,
        acceleration_limits: None,
        jerk_limits: None,
        torque_limits: None,
        singularity: 0.0,
        clearance,
        ..CheckSettings::of(chain)
    };
    let report = check(chain, &moved, &looked_for, CheckAgainst { path: None, ..against })?;
    let stops =
        |kind| matches!(kind, FindingKind::Position | FindingKind::Collision | FindingKind::SelfCollision);
    match report.findings.iter().find(|finding| stops(finding.kind)) {
        None => Ok(moved),
        Some(finding) => {
            Err(Error::CannotFollow(format!("the straight move is not safe: {}", finding.message)))
        }
    }
}
