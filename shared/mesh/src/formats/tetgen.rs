//! TetGen's pair of files: `.node` with the points, `.ele` with the tets. Counted from 0 or from 1, as the files say themselves.

use super::builder::{Builder, Region};
use super::gmsh::corners;
use crate::error::{Place, ReadError, ReadErrorKind};
use crate::text::Text;
use crate::types::TetMesh;

const CURE: &str = "number the regions 1, 2, 3 … in the .poly file's list of regions, and mesh again";

/// Reads a mesh from the contents of TetGen's `.node` and `.ele`. Coordinates stay in the unit of the file.
///
/// # Errors
/// As [`read_tets`](crate::read_tets); a message begins with the file that it is about.
pub fn read_tetgen(node: &[u8], ele: &[u8]) -> Result<TetMesh, ReadError> {
    let mut mesh = Builder::default();
    read_nodes(node, &mut mesh).map_err(|error| of_file(error, ".node"))?;
    read_elements(ele, &mut mesh).map_err(|error| of_file(error, ".ele"))?;
    mesh.finish().map(|(mesh, ..)| mesh).map_err(|error| match error.kind {
        ReadErrorKind::DuplicateNode => of_file(error, ".node"),
        ReadErrorKind::MissingNode | ReadErrorKind::BadNumber => of_file(error, ".ele"),
        _ => error,
    })
}

fn of_file(mut error: ReadError, file: &str) -> ReadError {
    error.found = format!("in the {file} file {}", error.found);
    error
}

fn read_nodes(bytes: &[u8], mesh: &mut Builder) -> Result<(), ReadError> {
    let mut text = Text::new(bytes, Some(b'#'));
    let count = text.count("the number of points", 8)?; // “0 0 0 0” and its line end
    let dimension = text.rest_of_line().i64("the dimension");
    if let Ok(dimension) = dimension
        && dimension != 3
    {
        let found = format!("dimension {dimension}");
        let cure = "give the .node file that TetGen wrote beside the .ele file";
        return Err(ReadError::new(ReadErrorKind::Unsupported, Place::Line(1), found, "dimension 3", cure));
    }
    for nth in 1..=count {
        let what = format!("point {nth} of {count}");
        let token = text.need(&what)?;
        let tag = token.i64(&what)?;
        let position = text.point(&what)?;
        mesh.node(tag, position, Place::Line(token.line));
        text.skip_line(); // attributes and marker
    }
    Ok(())
}

fn read_elements(bytes: &[u8], mesh: &mut Builder) -> Result<(), ReadError> {
    let mut text = Text::new(bytes, Some(b'#'));
    let count = text.count("the number of tets", 10)?; // “0 0 1 2 3” and its line end
    let mut head = text.rest_of_line();
    let nodes_each = head.token().map_or(Ok(4), |token| token.i64("the number of nodes per tet"))?;
    let attributes = head.token().map_or(Ok(0), |token| token.i64("the number of attributes"))?;
    for nth in 1..=count {
        let what = format!("tet {nth} of {count}");
        let token = text.need(&what)?;
        token.i64(&what)?;
        let mut line = text.rest_of_line();
        let tags = corners(&mut line, &what)?;
        for _ in 4..nodes_each.min(10) {
            line.i64(&what)?; // nodes in the middle of edges
        }
        let region = if attributes > 0 { region(&mut line, &what)? } else { 0 };
        mesh.tet(tags, Region::Group(region), Place::Line(token.line));
    }
    Ok(())
}

/// The region of a tet: its first attribute. To TetGen that is any number, but regions are told apart by whole ones.
fn region(line: &mut Text, what: &str) -> Result<i64, ReadError> {
    let token = line.need(what)?;
    token.f64(what)?;
    let is_no_region = |error: ReadError| {
        let expected = format!("a whole number as the first attribute of {what}, which is its region");
        ReadError { expected, cure: CURE.into(), ..error }
    };
    token.i64(what).map_err(is_no_region)
}
