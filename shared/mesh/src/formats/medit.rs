//! Medit / INRIA `.mesh` in ASCII, as mmg, Gmsh, CGAL and FreeFEM write it: `Vertices` and `Tetrahedra`; other sections are skipped.

use super::builder::{Builder, Region};
use super::gmsh::corners;
use crate::error::{Place, ReadError, ReadErrorKind};
use crate::text::Text;

/// Reads a Medit mesh.
pub(crate) fn read(bytes: &[u8]) -> Result<Builder, ReadError> {
    let mut text = Text::new(bytes, Some(b'#'));
    let mut mesh = Builder::default();
    while let Some(token) = text.token() {
        if token.is("Dimension") {
            let dimension = text.need("the dimension")?;
            if dimension.i64("the dimension")? != 3 {
                let (found, place) = (format!("dimension {}", dimension.shown()), Place::Line(dimension.line));
                let cure = "export the volume mesh in three dimensions";
                return Err(ReadError::new(ReadErrorKind::Unsupported, place, found, "dimension 3", cure));
            }
        } else if token.is("Vertices") {
            vertices(&mut text, &mut mesh)?;
        } else if token.is("Tetrahedra") {
            tetrahedra(&mut text, &mut mesh)?;
        } else if ["Hexahedra", "Prisms", "Pyramids"].iter().any(|word| token.is(word)) {
            mesh.other_volume_cells += text.count("the number of cells", 12)?;
        } else if token.is("End") {
            break;
        }
    }
    Ok(mesh)
}

fn vertices(text: &mut Text, mesh: &mut Builder) -> Result<(), ReadError> {
    let count = text.count("the number of vertices", 8)?; // “0 0 0 0” and its line end
    for tag in 1..=count {
        let what = format!("vertex {tag} of {count}");
        let place = text.peek().map_or(text.place(), |token| Place::Line(token.line));
        let position = text.point(&what)?;
        text.i64(&format!("the reference of {what}"))?;
        mesh.node(tag as i64, position, place);
    }
    Ok(())
}

fn tetrahedra(text: &mut Text, mesh: &mut Builder) -> Result<(), ReadError> {
    let count = text.count("the number of tetrahedra", 10)?; // “1 2 3 4 0” and its line end
    for nth in 1..=count {
        let what = format!("tetrahedron {nth} of {count}");
        let place = text.peek().map_or(text.place(), |token| Place::Line(token.line));
        let tags = corners(text, &what)?;
        let region = text.i64(&format!("the reference of {what}"))?;
        mesh.tet(tags, Region::Group(region), place);
    }
    Ok(())
}
