//! Wavefront OBJ surfaces, by way of `tobj`. Only positions and faces are read; polygons become fans of triangles; groups, objects
//! and materials are one surface. Vertices come in the order of their first use, and those that no face uses are left out.

use crate::error::{Place, ReadError, ReadErrorKind};
use crate::text::{Text, narrow};
use crate::types::TriangleMesh;

/// Reads the surface of an OBJ file.
pub(crate) fn read_surface(bytes: &[u8]) -> Result<TriangleMesh, ReadError> {
    let clean = positions_and_faces(bytes)?;
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let loaded = tobj::load_obj_buf(&mut clean.as_bytes(), &options, |_| Ok(Default::default()));
    let (models, _) = loaded.map_err(|error| {
        let cure = "export the surface again";
        ReadError::new(ReadErrorKind::Syntax, Place::File, error.to_string(), "vertices and faces", cure)
    })?;
    let mut surface = TriangleMesh::default();
    for model in models {
        let first = surface.positions_m.len() as u32;
        surface.positions_m.extend(model.mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        surface.triangles.extend(model.mesh.indices.chunks_exact(3).map(|t| [t[0] + first, t[1] + first, t[2] + first]));
    }
    Ok(surface)
}

/// The lines `v x y z` and `f a b c …` of the file, in its order. What is not read is left out (so that a group does not split the
/// surface), and coordinates and indices are checked here, where the line is known.
fn positions_and_faces(bytes: &[u8]) -> Result<String, ReadError> {
    let mut text = Text::new(bytes, Some(b'#'));
    let mut clean = String::new();
    let mut vertices = 0_i64;
    let mut largest = (0_i64, 0);
    let mut unfinished = None;
    while let Some(word) = text.token() {
        let mut line = text.rest_of_line();
        unfinished = None;
        if word.is("v") {
            let [x, y, z] = point(&mut line, vertices + 1)?;
            clean += &format!("v {x:?} {y:?} {z:?}\n");
            vertices += 1;
        } else if word.is("f") || word.is("fo") {
            let corners = corners(&mut line, vertices)?;
            if corners.len() < 3 {
                unfinished = Some(word.line);
                continue; // a point or a line
            }
            clean.push('f');
            for corner in corners {
                largest = largest.max((corner, word.line));
                clean += &format!(" {corner}");
            }
            clean.push('\n');
        }
    }
    // The last line was cut off in a face.
    if let Some(line) = unfinished.filter(|_| bytes.last() != Some(&b'\n')) {
        return Err(cut_off(line));
    }
    // A face may name vertices that come later, so the largest index is checked at the end.
    if largest.0 > vertices {
        return Err(out_of_range(largest.1, largest.0, vertices));
    }
    Ok(clean)
}

fn point(line: &mut Text, nth: i64) -> Result<[f32; 3], ReadError> {
    let what = format!("vertex {nth}");
    let mut point = [0.0; 3];
    for coordinate in &mut point {
        let token = line.need(&what)?;
        let place = Place::Line(token.line);
        *coordinate = narrow(token.f64(&what)?, place, || format!("{} in {what}", token.shown()))?;
    }
    Ok(point)
}

/// The vertex indices of a face, counted from 1; relative ones are made absolute.
fn corners(line: &mut Text, vertices: i64) -> Result<Vec<i64>, ReadError> {
    let mut corners = Vec::new();
    while let Some(token) = line.token() {
        let text = token.as_str().unwrap_or("");
        let number = text.split('/').next().and_then(|index| index.parse::<i64>().ok()).ok_or_else(|| {
            let cure = "correct the face, or export the surface again";
            let expected = "a vertex index, as 7 or 7/1/3";
            ReadError::new(ReadErrorKind::BadNumber, Place::Line(token.line), token.shown(), expected, cure)
        })?;
        let index = if number < 0 { number.saturating_add(vertices + 1) } else { number };
        if index < 1 {
            return Err(out_of_range(token.line, number, vertices));
        }
        corners.push(index);
    }
    Ok(corners)
}

fn cut_off(line: usize) -> ReadError {
    let found = "a face of fewer than three corners and the end of the file";
    ReadError::new(
        ReadErrorKind::Truncated,
        Place::Line(line),
        found,
        "whole faces",
        "the file was cut off: copy or export it again",
    )
}

fn out_of_range(line: usize, index: i64, vertices: i64) -> ReadError {
    let expected = format!("an index from 1 to {vertices} (or -1 to -{vertices} counted back)");
    let cure = "the vertex list is incomplete or the index is wrong: export the surface again";
    ReadError::new(ReadErrorKind::MissingNode, Place::Line(line), format!("a face with vertex {index}"), expected, cure)
}
