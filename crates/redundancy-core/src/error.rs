//! Errors: invalid input. The outcome of a computation on valid input is a [`Status`](crate::Status), never an error.

use crate::tolerance::LARGEST_RATE;

/// The caller's mistake: it names the thing, the value, the bound and, for names, the valid ones.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A vector or matrix has the wrong number of entries.
    #[error("{what}: expected {expected} entries, got {actual}")]
    Length {
        /// What was given.
        what: String,
        /// The required number of entries.
        expected: usize,
        /// The number of entries received.
        actual: usize,
    },
    /// An entry is NaN or infinite.
    #[error("{what}: entry {index} is {value}, it must be finite")]
    NotFinite {
        /// What was given.
        what: String,
        /// Flat index of the first offending entry.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A number lies outside its admissible range.
    #[error("{what} is {}, it must be {bound}", plain(*value))]
    OutOfRange {
        /// What was given.
        what: String,
        /// Its value.
        value: f64,
        /// The bound in words, such as "> 0".
        bound: String,
    },
    /// A vector that gives a direction has no length.
    #[error("{what} has length {norm:e}, a direction needs a length of at least {minimum:e}")]
    ZeroDirection {
        /// What was given.
        what: String,
        /// Its Euclidean norm.
        norm: f64,
        /// The least accepted norm.
        minimum: f64,
    },
    /// A quaternion is not of unit norm.
    #[error("{what}: quaternion (w, x, y, z) has norm {norm}, it must be within {tolerance} of 1")]
    NotUnit {
        /// What was given.
        what: String,
        /// The measured norm.
        norm: f64,
        /// The accepted deviation.
        tolerance: f64,
    },
    /// A matrix is not a rigid transform.
    #[error("{what} is not a rigid transform: {reason} is {}, it must be {bound}", plain(*measured))]
    NotRigid {
        /// What was given.
        what: String,
        /// Which property fails, and what is measured.
        reason: &'static str,
        /// The measured value.
        measured: f64,
        /// The bound in words, such as "at most 1e-3".
        bound: String,
    },
    /// A lower limit lies above its upper limit.
    #[error("joint '{joint}': lower limit {lower} is above upper limit {upper}")]
    InvertedLimits {
        /// Joint name.
        joint: String,
        /// Lower limit, rad or m.
        lower: f64,
        /// Upper limit, rad or m.
        upper: f64,
    },
    /// A name is not among the known ones.
    #[error("unknown {kind} '{name}', expected one of: {}", .valid.join(", "))]
    UnknownName {
        /// What is named: robot, link, joint, method.
        kind: &'static str,
        /// The name received.
        name: String,
        /// The names that exist.
        valid: Vec<String>,
    },
    /// A robot description cannot become a chain.
    #[error("robot description: {0}")]
    Description(String),
    /// The chain is not of the structure that a closed form needs.
    #[error("not a spherical-revolute-spherical arm: {reason}")]
    NotSrs {
        /// Which condition fails, by how many millimetres or milliradians.
        reason: String,
    },
    /// The chain is not a six-joint arm with a spherical wrist.
    #[error("not a six-joint arm with a spherical wrist: {reason}")]
    NotSphericalWrist {
        /// Which condition fails, by how many millimetres or milliradians.
        reason: String,
    },
    /// The chain is not a six-joint arm whose axes 2, 3 and 4 are parallel.
    #[error("not a six-joint arm with three parallel axes: {reason}")]
    NotParallelAxes {
        /// Which condition fails, by how many millimetres or milliradians.
        reason: String,
    },
    /// The chain is not a seven-joint arm with a spherical shoulder, axes 5 and 6 that meet, and an offset of axis 7.
    #[error("not an arm of the Panda class: {reason}")]
    NotPandaClass {
        /// Which condition fails, by how many millimetres or milliradians.
        reason: String,
    },
    /// A file with a path or trajectory is broken.
    #[error("{file}: {message}")]
    File {
        /// The file, with its line where that is known (`name:line`, lines from 1).
        file: String,
        /// What is wrong there.
        message: String,
    },
    /// A path that this arm cannot follow: which points, and what is in the way.
    #[error("{0}")]
    CannotFollow(String),
    /// Any other invalid argument.
    #[error("{0}")]
    Invalid(String),
}

/// Result with the crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Checks the number of entries of `values`.
pub(crate) fn check_length(what: &str, values: &[f64], expected: usize) -> Result<()> {
    if values.len() == expected {
        return Ok(());
    }
    Err(Error::Length { what: what.into(), expected, actual: values.len() })
}

/// Checks that every entry of `values` is finite.
pub(crate) fn check_finite(what: &str, values: &[f64]) -> Result<()> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NotFinite { what: what.into(), index, value: values[index] }),
    }
}

/// A number as a person would write it: with an exponent where it would have many zeros.
fn plain(value: f64) -> String {
    let size = value.abs();
    if value.is_finite() && size != 0.0 && !(1e-6..1e16).contains(&size) {
        return format!("{value:e}");
    }
    value.to_string()
}

/// Checks length and finiteness of a joint vector.
pub(crate) fn check_vector(what: &str, values: &[f64], expected: usize) -> Result<()> {
    check_length(what, values, expected)?;
    check_finite(what, values)
}

/// A vector of rates that a control step takes: its length, finite, and of a size whose squares are finite.
pub(crate) fn check_rates(what: &str, values: &[f64], expected: usize) -> Result<()> {
    check_vector(what, values, expected)?;
    match values.iter().find(|x| x.abs() > LARGEST_RATE) {
        None => Ok(()),
        Some(value) => {
            let bound = format!("at most {LARGEST_RATE:e} in size");
            Err(Error::OutOfRange { what: what.into(), value: *value, bound })
        }
    }
}
