//! What the readers share: counts, numbers, messages.

use std::collections::HashMap;

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

/// Vertices that faces use, those at the same place once.
pub(super) fn welded(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Raw> {
    let mut known: HashMap<[u64; 3], u32> = HashMap::new();
    let mut place = vec![u32::MAX; vertices.len()];
    let mut out: Raw = (Vec::new(), Vec::with_capacity(faces.len()));
    for (f, face) in faces.iter().enumerate() {
        let mut new = [0; 3];
        for (new, old) in new.iter_mut().zip(face) {
            let Some(slot) = place.get_mut(*old as usize) else {
                let bound = format!("< {}, the number of vertices", vertices.len());
                let what = format!("face {f}: vertex index");
                return Err(Error::OutOfRange { what, value: f64::from(*old), bound });
            };
            if *slot == u32::MAX {
                // -0 and 0 are the same place.
                let vertex = vertices[*old as usize].map(|x| x + 0.0);
                *slot = *known.entry(vertex.map(f64::to_bits)).or_insert_with(|| {
                    out.0.push(vertex);
                    out.0.len() as u32 - 1
                });
            }
            *new = *slot;
        }
        out.1.push(new);
    }
    Ok(out)
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
