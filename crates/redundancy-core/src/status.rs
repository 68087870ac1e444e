//! The outcome of a computation.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// Outcome of a computation on valid input. Its words are the same in Rust, Python, files and messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Status {
    /// The result meets its tolerance.
    Converged,
    /// The pose is out of reach.
    Unreachable,
    /// The constraints exclude each other.
    Infeasible,
    /// The pose can be reached, but only outside the joint limits.
    Limits,
    /// Every configuration within the joint limits touches an obstacle or the arm itself.
    Collision,
    /// A closed loop ends or strays farther from its path than its tolerance.
    OffPath,
    /// A singular configuration stopped the computation.
    Singular,
    /// The iteration limit was met first.
    IterationLimit,
    /// The time limit was met first.
    TimeLimit,
    /// The caller asked to stop.
    Cancelled,
    /// A servo follows its target, which is not reached yet.
    Tracking,
    /// A servo has had no target for longer than its timeout.
    NoTarget,
}

impl Status {
    /// Every status, in declaration order.
    pub const ALL: [Self; 12] = [
        Self::Converged,
        Self::Unreachable,
        Self::Infeasible,
        Self::Limits,
        Self::Collision,
        Self::OffPath,
        Self::Singular,
        Self::IterationLimit,
        Self::TimeLimit,
        Self::Cancelled,
        Self::Tracking,
        Self::NoTarget,
    ];

    /// The status as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Unreachable => "unreachable",
            Self::Infeasible => "infeasible",
            Self::Limits => "limits",
            Self::Collision => "collision",
            Self::OffPath => "off_path",
            Self::Singular => "singular",
            Self::IterationLimit => "iteration_limit",
            Self::TimeLimit => "time_limit",
            Self::Cancelled => "cancelled",
            Self::Tracking => "tracking",
            Self::NoTarget => "no_target",
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for Status {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|status| status.as_str() == word).ok_or_else(|| Error::UnknownName {
            kind: "status",
            name: word.into(),
            valid: Self::ALL.map(|status| status.as_str().to_owned()).to_vec(),
        })
    }
}
