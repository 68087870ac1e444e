//! STL: triangles with their corners written out.

use super::text::{Raw, at_line, check_count, number, welded};
use crate::error::{Error, Result};
use crate::tolerance::{MESH_FACES, MESH_VERTICES};

/// Bytes before the first triangle of a binary file, and of each triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Binary where the count in the header fits the number of bytes; else text where it begins with `solid`.
pub fn read(bytes: &[u8]) -> Result<Raw> {
    let count = bytes.get(HEADER - 4..HEADER).and_then(|b| <[u8; 4]>::try_from(b).ok());
    let count = count.map(|b| u32::from_le_bytes(b) as usize);
    let needed = count.map(|n| HEADER + n * TRIANGLE);
    if needed == Some(bytes.len()) {
        return binary(bytes);
    }
    let begin = bytes.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(0);
    let text = bytes[begin..].get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    match (std::str::from_utf8(bytes), count, needed) {
        (Ok(text_of_file), ..) if text => text_reader(text_of_file),
        // Some programs leave bytes after the last triangle.
        (_, Some(_), Some(needed)) if needed < bytes.len() && !text => binary(&bytes[..needed]),
        (_, Some(count), Some(needed)) => {
            let actual = bytes.len();
            Err(Error::Invalid(format!("its {count} triangles take {needed} bytes, but it has {actual}")))
        }
        _ => Err(Error::Invalid(format!("not an STL file: it has only {} bytes", bytes.len()))),
    }
}

fn binary(bytes: &[u8]) -> Result<Raw> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let triangles = bytes[HEADER..].chunks_exact(TRIANGLE);
    check_count("faces", triangles.len(), MESH_FACES)?;
    check_count("vertices", 3 * triangles.len(), 3 * MESH_FACES)?;
    vertices.reserve(3 * triangles.len());
    faces.reserve(triangles.len());
    for triangle in triangles {
        // The normal comes first; it follows from the corners.
        for corner in triangle[12..48].chunks_exact(12) {
            let mut vertex = [0.0; 3];
            for (x, bytes) in vertex.iter_mut().zip(corner.chunks_exact(4)) {
                *x = <[u8; 4]>::try_from(bytes).map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)));
            }
            vertices.push(vertex);
        }
        let n = vertices.len() as u32;
        faces.push([n - 3, n - 2, n - 1]);
    }
    within_bounds(vertices, faces)
}

/// Three corners for each triangle are more vertices than a mesh may have; those that are the same become one.
fn within_bounds(vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> Result<Raw> {
    if vertices.len() <= MESH_VERTICES {
        return Ok((vertices, faces));
    }
    welded(&vertices, &faces)
}

fn text_reader(text: &str) -> Result<Raw> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let mut corners = 0;
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        let Some(key) = words.next() else { continue };
        if key.eq_ignore_ascii_case("vertex") {
            let mut vertex = [0.0; 3];
            for x in &mut vertex {
                let word = words.next().ok_or_else(|| at_line(i + 1, "vertex needs 3 numbers"))?;
                *x = number(word).map_err(|error| at_line(i + 1, error))?;
            }
            vertices.push(vertex);
            corners += 1;
        } else if key.eq_ignore_ascii_case("endloop") {
            if corners != 3 {
                return Err(at_line(i + 1, format!("a triangle has 3 vertices, here it has {corners}")));
            }
            corners = 0;
            let n = vertices.len() as u32;
            faces.push([n - 3, n - 2, n - 1]);
            check_count("faces", faces.len(), MESH_FACES)?;
        }
    }
    if corners != 0 {
        return Err(Error::Invalid(format!("ends within a triangle, after {corners} of its vertices")));
    }
    within_bounds(vertices, faces)
}
