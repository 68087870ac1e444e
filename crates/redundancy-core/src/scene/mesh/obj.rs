//! Wavefront OBJ: vertices and polygons.

use super::text::{Raw, at_line, check_count, number, push_fan, shown};
use crate::error::{Error, Result};
use crate::tolerance::MESH_VERTICES;

/// Most corners of one polygon.
const MAX_CORNERS: usize = 1 << 16;

pub fn read(bytes: &[u8]) -> Result<Raw> {
    let text = String::from_utf8_lossy(bytes);
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let mut corners: Vec<u32> = Vec::new();
    // A line that ends with a backslash goes on in the next one.
    let mut open = String::new();
    for (i, line) in text.lines().enumerate() {
        if let Some(part) = line.strip_suffix('\\') {
            open.push_str(part);
            open.push(' ');
            continue;
        }
        if open.is_empty() {
            element(line, i + 1, &mut vertices, &mut faces, &mut corners)?;
        } else {
            open.push_str(line);
            element(&open, i + 1, &mut vertices, &mut faces, &mut corners)?;
            open.clear();
        }
    }
    element(&open, text.lines().count(), &mut vertices, &mut faces, &mut corners)?;
    Ok((vertices, faces))
}

fn element(
    line: &str,
    at: usize,
    vertices: &mut Vec<[f64; 3]>,
    faces: &mut Vec<[u32; 3]>,
    corners: &mut Vec<u32>,
) -> Result<()> {
    let line = line.split('#').next().unwrap_or_default();
    let mut words = line.split_ascii_whitespace();
    match words.next() {
        Some("v") => {
            let mut vertex = [0.0; 3];
            for x in &mut vertex {
                let word = words.next().ok_or_else(|| at_line(at, "v needs 3 numbers"))?;
                *x = number(word).map_err(|error| at_line(at, error))?;
            }
            vertices.push(vertex);
            check_count("vertices", vertices.len(), MESH_VERTICES)
        }
        Some("f") => {
            corners.clear();
            for word in words {
                corners.push(index(word, vertices.len()).map_err(|error| at_line(at, error))?);
                if corners.len() > MAX_CORNERS {
                    return Err(at_line(at, format!("a polygon has at most {MAX_CORNERS} corners")));
                }
            }
            if corners.len() < 3 {
                return Err(at_line(at, format!("a face needs 3 vertices, here it has {}", corners.len())));
            }
            push_fan(faces, corners)
        }
        _ => Ok(()),
    }
}

/// `v`, `v/t`, `v//n` or `v/t/n`: v counts from 1, or backwards from the last vertex so far.
fn index(word: &str, count: usize) -> Result<u32> {
    let bad = |why: &str| Error::Invalid(format!("'{}' {why}", shown(word)));
    let first = word.split('/').next().unwrap_or_default();
    let given: i64 = first.parse().map_err(|_| bad("is not a vertex index"))?;
    let index = if given < 0 { count as i64 + given } else { given - 1 };
    if index < 0 || index >= count as i64 {
        return Err(bad(&format!("is not one of the {count} vertices so far")));
    }
    u32::try_from(index).map_err(|_| bad("is too large"))
}
