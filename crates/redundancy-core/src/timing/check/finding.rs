//! What `check` finds: its kinds, its severities, and the report.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// What is wrong. Its words are the same in Rust, Python, files and messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum FindingKind {
    /// A joint beyond a position limit.
    Position,
    /// A joint that is too fast.
    Velocity,
    /// A joint that accelerates too much.
    Acceleration,
    /// An acceleration that changes too fast.
    Jerk,
    /// A joint that needs too much torque.
    Torque,
    /// A jump from one row to the next.
    Step,
    /// The arm moves at the first or the last row.
    NotAtRest,
    /// A joint that turns by whole turns for nothing.
    Winding,
    /// A configuration near a singularity.
    Singularity,
    /// The arm touches itself.
    SelfCollision,
    /// The arm touches an obstacle.
    Collision,
    /// The tool is away from its path.
    PathDeviation,
    /// Times that no controller can run.
    Time,
}

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Severity {
    /// The motion must not be run.
    Error,
    /// The motion can be run; somebody should look at it.
    Warning,
}

impl Severity {
    /// The severity as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

impl FindingKind {
    /// Every kind, in declaration order.
    pub const ALL: [Self; 13] = [
        Self::Position,
        Self::Velocity,
        Self::Acceleration,
        Self::Jerk,
        Self::Torque,
        Self::Step,
        Self::NotAtRest,
        Self::Winding,
        Self::Singularity,
        Self::SelfCollision,
        Self::Collision,
        Self::PathDeviation,
        Self::Time,
    ];

    /// The kind as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::Torque => "torque",
            Self::Step => "step",
            Self::NotAtRest => "not_at_rest",
            Self::Winding => "winding",
            Self::Singularity => "singularity",
            Self::SelfCollision => "self_collision",
            Self::Collision => "collision",
            Self::PathDeviation => "path_deviation",
            Self::Time => "time",
        }
    }

    /// `Winding` and `Singularity` are warnings, the others errors.
    pub fn severity(self) -> Severity {
        match self {
            Self::Winding | Self::Singularity => Severity::Warning,
            _ => Severity::Error,
        }
    }
}

impl fmt::Display for FindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for FindingKind {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == word).ok_or_else(|| Error::UnknownName {
            kind: "finding kind",
            name: word.into(),
            valid: Self::ALL.map(|kind| kind.as_str().to_owned()).to_vec(),
        })
    }
}

/// One thing that is wrong. Neighbouring intervals with the same fault of the same joint are one finding.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What is wrong.
    pub kind: FindingKind,
    /// The row nearest to the worst place, from 0.
    pub row: usize,
    /// First and last row of the part of the motion with this fault.
    pub rows: [usize; 2],
    /// Time of the worst place, s.
    pub t: f64,
    /// The joint, where it is one joint's fault.
    pub joint: Option<String>,
    /// The link, where it is one link's.
    pub link: Option<String>,
    /// What was measured, in the unit of its bound.
    pub value: f64,
    /// What is allowed.
    pub bound: f64,
    /// All of it for a person.
    pub message: String,
}

impl Finding {
    /// How bad it is.
    pub fn severity(&self) -> Severity {
        self.kind.severity()
    }
}

/// What [`check`](super::check) found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CheckReport {
    /// By row, then by kind.
    pub findings: Vec<Finding>,
    /// Number of rows.
    pub rows: usize,
    /// Whether the motion was judged. Rows whose times do not increase are no motion: then their times are the only
    /// findings.
    pub judged: bool,
}

impl CheckReport {
    /// No error; there may be warnings.
    pub fn ok(&self) -> bool {
        self.findings.iter().all(|finding| finding.severity() != Severity::Error)
    }

    /// Findings of a severity.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity() == severity).count()
    }
}
