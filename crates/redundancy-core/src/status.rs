//! What the mathematics did.

use std::fmt;

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
    /// A singular configuration stopped the computation.
    Singular,
    /// The iteration limit was met first.
    IterationLimit,
    /// The time limit was met first.
    TimeLimit,
    /// The caller asked to stop.
    Cancelled,
}

impl Status {
    /// Every status, in declaration order.
    pub const ALL: [Self; 8] = [
        Self::Converged,
        Self::Unreachable,
        Self::Infeasible,
        Self::Limits,
        Self::Singular,
        Self::IterationLimit,
        Self::TimeLimit,
        Self::Cancelled,
    ];

    /// The status as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Unreachable => "unreachable",
            Self::Infeasible => "infeasible",
            Self::Limits => "limits",
            Self::Singular => "singular",
            Self::IterationLimit => "iteration_limit",
            Self::TimeLimit => "time_limit",
            Self::Cancelled => "cancelled",
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
