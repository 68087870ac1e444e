//! What the readers share: counts, numbers, messages.

use crate::error::{Error, Result};
use crate::tolerance::MESH_FACES;

pub(super) fn check_count(what: &str, value: usize, bound: usize) -> Result<()> {
    if value <= bound {
        return Ok(());
    }
    let bound = format!("<= {bound}");
    Err(Error::OutOfRange { what: format!("number of {what} of a mesh"), value: value as f64, bound })
}

/// What a reader returns: vertices, and faces that name them by index.
pub(super) type Raw = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A polygon as a fan of triangles around its first corner.
pub(super) fn push_fan(faces: &mut Vec<[u32; 3]>, corners: &[u32]) -> Result<()> {
    for pair in corners.windows(2).skip(1) {
        faces.push([corners[0], pair[0], pair[1]]);
    }
    check_count("faces", faces.len(), MESH_FACES)
}

/// The error with the number of the line, from 1.
pub(super) fn at_line(line: usize, message: impl std::fmt::Display) -> Error {
    Error::Invalid(format!("line {line}: {message}"))
}

/// A finite number.
pub(super) fn number(word: &str) -> Result<f64> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(Error::Invalid(format!("'{}' is not a finite number", shown(word)))),
    }
}

/// A word for a message, cut where it is long.
pub(super) fn shown(word: &str) -> String {
    const LONGEST: usize = 40;
    if word.chars().count() <= LONGEST {
        return word.into();
    }
    word.chars().take(LONGEST).chain("...".chars()).collect()
}
