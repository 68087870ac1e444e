//! To which part of a motion a row belongs.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// The part of a motion to which a row of a trajectory belongs. Its words are the same in Rust, Python and files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Section {
    /// On the way to the path.
    LeadIn,
    /// On the path.
    Path,
    /// On a curve near a corner of the path that replaces the corner.
    Blend,
    /// On the way from the path.
    LeadOut,
}

impl Section {
    /// Every section, in declaration order.
    pub const ALL: [Self; 4] = [Self::LeadIn, Self::Path, Self::Blend, Self::LeadOut];

    /// The section as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::LeadIn => "lead_in",
            Self::Path => "path",
            Self::Blend => "blend",
            Self::LeadOut => "lead_out",
        }
    }
}

impl fmt::Display for Section {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for Section {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|section| section.as_str() == word).ok_or_else(|| Error::UnknownName {
            kind: "section",
            name: word.into(),
            valid: Self::ALL.map(|section| section.as_str().to_owned()).to_vec(),
        })
    }
}
