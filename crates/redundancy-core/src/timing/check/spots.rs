//! Places where something is wrong, and how neighbouring ones become one finding.

use std::collections::BTreeMap;

use super::finding::{Finding, FindingKind};
use crate::chain::Chain;

/// What a fault belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Owner {
    pub kind: FindingKind,
    pub joint: Option<usize>,
    pub link: Option<usize>,
    /// Distinguishes faults of one owner that are not one: the obstacle, the kind of deviation.
    pub part: usize,
}

impl Owner {
    pub fn arm(kind: FindingKind) -> Self {
        Self { kind, joint: None, link: None, part: 0 }
    }

    pub fn joint(kind: FindingKind, joint: usize) -> Self {
        Self { joint: Some(joint), ..Self::arm(kind) }
    }
}

/// A fault in one interval or at one row.
#[derive(Debug, Clone)]
pub(super) struct Spot {
    pub owner: Owner,
    /// Interval or row: neighbouring cells with the same owner are one fault.
    pub cell: usize,
    /// The row nearest to the worst place.
    pub row: usize,
    pub t: f64,
    pub value: f64,
    pub bound: f64,
    /// How bad it is among those of the same owner.
    pub weight: f64,
    pub message: Option<String>,
}

/// The findings of all spots, by row and kind.
pub(super) fn findings(chain: &Chain, spots: Vec<Spot>, last_row: usize) -> Vec<Finding> {
    let mut by_owner: BTreeMap<Owner, Vec<Spot>> = BTreeMap::new();
    for spot in spots {
        by_owner.entry(spot.owner).or_default().push(spot);
    }
    let mut out = Vec::new();
    for (owner, mut list) in by_owner {
        list.sort_by_key(|spot| spot.cell);
        for run in list.chunk_by(|a, b| b.cell <= a.cell + 1) {
            let worst = run.iter().max_by(|a, b| a.weight.total_cmp(&b.weight));
            let Some(worst) = worst else { continue };
            let reach = [&run[0], &run[run.len() - 1]].map(|spot| spot.cell);
            // A spot of an interval reaches to the row after it, one of a row is at that row.
            let last = reach[1].max(worst.row).min(last_row);
            let joint = owner.joint.map(|j| chain.joints()[j].name.clone());
            let link = owner.link.and_then(|l| chain.links().get(l)).map(|link| link.name.clone());
            out.push(Finding {
                kind: owner.kind,
                row: worst.row,
                rows: [reach[0].min(worst.row), last],
                t: worst.t,
                message: worst.message.clone().unwrap_or_else(|| words(chain, owner, worst)),
                joint,
                link,
                value: worst.value,
                bound: worst.bound,
            });
        }
    }
    out.sort_by(|a, b| a.row.cmp(&b.row).then(a.kind.cmp(&b.kind)));
    out
}

/// The sentence of a fault of a joint.
fn words(chain: &Chain, owner: Owner, spot: &Spot) -> String {
    let joint = owner.joint.map(|j| &chain.joints()[j]);
    let name = joint.map_or("the arm", |joint| joint.name.as_str());
    let turning = joint.is_none_or(|joint| joint.kind.is_rotational());
    let unit = |order: &str| format!("{}{order}", if turning { "rad" } else { "m" });
    let (value, bound, t) = (spot.value, spot.bound, spot.t);
    match owner.kind {
        FindingKind::Position => {
            format!("joint '{name}' is at {value:.6} {}, its limit is {bound:.6}, at {t:.6} s", unit(""))
        }
        FindingKind::Velocity => {
            format!("joint '{name}' moves at {value:.6} {}, its limit is {bound:.6}, at {t:.6} s", unit("/s"))
        }
        FindingKind::Acceleration => {
            format!(
                "joint '{name}' accelerates at {value:.6} {}, its limit is {bound:.6}, at {t:.6} s",
                unit("/s^2")
            )
        }
        FindingKind::Jerk => {
            format!(
                "joint '{name}' has a jerk of {value:.6} {}, its limit is {bound:.6}, at {t:.6} s",
                unit("/s^3")
            )
        }
        FindingKind::Torque => {
            let unit = if turning { "N m" } else { "N" };
            format!("joint '{name}' needs {value:.6} {unit}, its limit is {bound:.6}, at {t:.6} s")
        }
        kind => format!("{kind}: {value:.6}, the bound is {bound:.6}, at {t:.6} s"),
    }
}
