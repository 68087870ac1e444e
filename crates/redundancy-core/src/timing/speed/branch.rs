//! The largest constant speed over tool poses: on the fastest branch that holds the path.

use super::constant::{MaxSpeed, constant_speed};
use super::settings::SpeedSettings;
use super::terms::SpeedTerms;
use crate::chain::Chain;
use crate::error::{Error, Result, check_length, check_vector};
use crate::parallel::prelude::*;
use crate::pose::Pose;
use crate::solutions::closed_form;
use crate::solutions::lines::{self, LineEnd};

/// The largest constant tool speed with inverse kinematics: over all poses, from `start` or, without it, on the fastest
/// branch that holds the path.
///
/// # Errors
/// As [`max_speed`](super::max_speed); a pose that cannot be reached or followed: the message names the points.
pub fn max_speed_of_poses(
    chain: &Chain,
    s: &[f64],
    poses: &[Pose],
    start: Option<&[f64]>,
    settings: &SpeedSettings,
) -> Result<MaxSpeed> {
    settings.validate(chain.dof())?;
    settings.check_masses(chain)?;
    check_length("s", s, poses.len())?;
    let first = poses.first().ok_or_else(|| Error::Invalid("the path has no point".into()))?;
    let form = closed_form(chain);
    let form = form.as_deref();
    if let Some(start) = start {
        check_vector("q0", start, chain.dof())?;
        let line = match form.and_then(|form| lines::branch_from(form, poses, start)) {
            Some(line) => line,
            None => {
                lines::follow(chain, poses, start).map_err(|(k, why)| cannot_follow(chain, poses, k, why))?
            }
        };
        let found = constant_speed(SpeedTerms::new(chain, s, &line, settings, false)?, chain, settings)?;
        return Ok(MaxSpeed { proven: false, ..found });
    }
    let finish = |mut line: Vec<f64>| -> std::result::Result<MaxSpeed, BranchFailure> {
        if settings.joint_limits {
            lines::wind(chain, &mut line).map_err(|(j, k)| BranchFailure::Limits(j, k))?;
        }
        SpeedTerms::new(chain, s, &line, settings, false)
            .and_then(|terms| constant_speed(terms, chain, settings))
            .map_err(BranchFailure::Speed)
    };
    let branches = form.and_then(|form| lines::all_branches(form, poses));
    // The branches of isolated configurations are all there is; other lines are followed from a few starts.
    let proven = branches.is_some();
    let (what, remark) = match &branches {
        Some(_) => ("branches", ""),
        None => ("lines", ", other lines may (q0 or q choose one; plan searches all)"),
    };
    let tried: Vec<std::result::Result<MaxSpeed, BranchFailure>> = match branches {
        Some(lines) => lines.into_par_iter().map(finish).collect(),
        None => {
            let candidates = lines::starts(chain, form, first);
            if candidates.is_empty() {
                return Err(cannot_follow(chain, poses, 0, LineEnd::Lost));
            }
            let follow = |start: &Vec<f64>| {
                lines::follow(chain, poses, start)
                    .map_err(|(k, why)| BranchFailure::Line(k, why))
                    .and_then(finish)
            };
            candidates.par_iter().map(follow).collect()
        }
    };
    let count = tried.len();
    let mut best: Option<MaxSpeed> = None;
    let mut reason: Option<BranchFailure> = None;
    for outcome in tried {
        match outcome {
            Ok(found) => {
                if best.as_ref().is_none_or(|b| found.speed > b.speed) {
                    best = Some(found);
                }
            }
            // What comes nearest to success is what the caller can act on.
            Err(failure) => {
                if reason.as_ref().is_none_or(|r| failure.rank() > r.rank()) {
                    reason = Some(failure);
                }
            }
        }
    }
    best.map(|found| MaxSpeed { proven, ..found }).ok_or_else(|| match reason {
        Some(BranchFailure::Speed(error)) => error,
        Some(BranchFailure::Limits(j, k)) => Error::CannotFollow(format!(
            "none of {count} {what} tried holds the joint limits along the path; the best one leaves those of joint '{}' at \
             point {k} of {}{remark}",
            chain.joints()[j].name,
            poses.len()
        )),
        Some(BranchFailure::Line(k, why)) => cannot_follow(chain, poses, k, why),
        None => cannot_follow(chain, poses, 0, LineEnd::Lost),
    })
}

enum BranchFailure {
    Line(usize, LineEnd),
    Limits(usize, usize),
    Speed(Error),
}

impl BranchFailure {
    fn rank(&self) -> (usize, usize) {
        match self {
            Self::Line(k, _) => (0, *k),
            Self::Limits(_, k) => (1, *k),
            Self::Speed(_) => (2, 0),
        }
    }
}

/// The message that names the points without a configuration.
pub(crate) fn cannot_follow(chain: &Chain, poses: &[Pose], k: usize, why: LineEnd) -> Error {
    let total = poses.len();
    if why == LineEnd::Jump {
        return Error::CannotFollow(format!("the arm would have to jump before point {k} of {total}"));
    }
    let question = chain.ask_about_millimetres(poses.iter().map(|pose| pose.translation.vector));
    let question = question.map_or_else(String::new, |question| format!("; {question}"));
    let far = lines::unreachable(chain, closed_form(chain).as_deref(), poses);
    if let (Some(first), Some(last)) = (far.first(), far.last()) {
        let count = far.len();
        let which = if last - first + 1 == count { format!("{first} to {last}") } else { list(&far) };
        return Error::CannotFollow(format!(
            "{count} of {total} points are out of the workspace, indices {which}{question}"
        ));
    }
    let p = poses[k].translation.vector;
    Error::CannotFollow(format!(
        "the arm cannot follow the path: point {k} of {total} at ({:.4}, {:.4}, {:.4}) is not reached on this \
         branch{question}",
        p.x, p.y, p.z
    ))
}

/// The first few of a list.
fn list(indices: &[usize]) -> String {
    let shown: Vec<String> = indices.iter().take(LISTED).map(ToString::to_string).collect();
    let more = if indices.len() > LISTED { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}

/// Indices that a message lists.
const LISTED: usize = 10;
