//! VTK's XML files for unstructured grids (`.vtu`): arrays as text, or as base64 within the file, uncompressed.
//!
//! Follows the chapter on file formats of VTK's user's guide. Several pieces become one mesh, each with points of its own; where they touch
//! with whole faces, [`repair`](crate::repair()) merges these.

use super::builder::Builder;
use super::vtk_binary::{Coding, Value, binary};
use super::vtk_legacy::{Cells, add_tets};
use crate::error::{Place, ReadError, ReadErrorKind, quote};
use crate::text::{Text, narrow, without_mark};
use roxmltree::{Document, Node};

pub(super) const CURE: &str = "save it with arrays as text (ParaView: File > Save Data, data mode Ascii; or: meshio ascii FILE)";
pub(super) const DAMAGED: &str = "the file is damaged: copy or export it again";

/// Reads the tets of an unstructured grid.
pub(crate) fn read(bytes: &[u8]) -> Result<Builder, ReadError> {
    let text = xml_part(bytes)?;
    let document = Document::parse(&text).map_err(|error| {
        let place = Place::Line(error.pos().row as usize);
        ReadError::new(ReadErrorKind::Syntax, place, error.to_string(), "well-formed XML", DAMAGED)
    })?;
    let root = document.root_element();
    let kind = root.attribute("type").unwrap_or("none");
    if !root.has_tag_name("VTKFile") || kind != "UnstructuredGrid" {
        let found = format!("an element {} of type {}", quote(root.tag_name().name()), quote(kind));
        let cure = "export the volume as an unstructured grid (.vtu)";
        return Err(ReadError::new(ReadErrorKind::Unsupported, place(root), found, "VTKFile of type UnstructuredGrid", cure));
    }
    let coding = Coding {
        big_endian: root.attribute("byte_order") == Some("BigEndian"),
        header_bytes: if root.attribute("header_type") == Some("UInt64") { 8 } else { 4 },
        compressed: root.attribute("compressor").is_some(),
    };
    let mut mesh = Builder::default();
    for piece in root.descendants().filter(|node| node.has_tag_name("Piece")) {
        read_piece(piece, coding, &mut mesh)?;
    }
    Ok(mesh)
}

/// The file as text. Raw appended data is no XML and is cut off: an array that needs it says so itself.
fn xml_part(bytes: &[u8]) -> Result<String, ReadError> {
    let bytes = without_mark(bytes);
    const APPENDED: &[u8] = b"<AppendedData";
    let cut = bytes.windows(APPENDED.len()).position(|window| window == APPENDED);
    let text = std::str::from_utf8(&bytes[..cut.unwrap_or(bytes.len())]).map_err(|error| {
        let place = Place::Byte(error.valid_up_to());
        ReadError::new(ReadErrorKind::Syntax, place, "bytes that are no UTF-8", "XML in UTF-8", DAMAGED)
    })?;
    Ok(if cut.is_some() { format!("{text}</VTKFile>") } else { text.into() })
}

fn read_piece(piece: Node, coding: Coding, mesh: &mut Builder) -> Result<(), ReadError> {
    let first_tag = mesh.node_count() as i64;
    let points = child(child(piece, "Points")?, "DataArray")?;
    let components = points.attribute("NumberOfComponents").unwrap_or("3");
    if components.trim() != "3" {
        let found = format!("points of {} components", quote(components));
        return Err(ReadError::new(ReadErrorKind::Unsupported, place(points), found, "3 components", DAMAGED));
    }
    let (coordinates, at) = floats(points, coding)?;
    announced(piece, "NumberOfPoints", coordinates.len(), 3)?;
    for (index, point) in coordinates.chunks_exact(3).enumerate() {
        mesh.node(first_tag + index as i64, [point[0], point[1], point[2]], at);
    }
    let cells = child(piece, "Cells")?;
    let connectivity = named(cells, "connectivity")?;
    let types = integers(named(cells, "types")?, coding)?;
    announced(piece, "NumberOfCells", types.len(), 1)?;
    let mut offsets = integers(named(cells, "offsets")?, coding)?;
    if offsets.len() == types.len() {
        offsets.insert(0, 0); // the file holds the ends only
    }
    let cells = Cells { offsets, place: Some(place(connectivity)), connectivity: integers(connectivity, coding)? };
    let count = mesh.node_count() as i64 - first_tag;
    if let Some(wrong) = cells.connectivity.iter().find(|index| !(0..count).contains(*index)) {
        let found = format!("a cell with point {wrong}");
        let expected = format!("a point from 0 to {}", count - 1);
        let cure = "the point list is incomplete or the index is wrong: export the mesh again";
        return Err(ReadError::new(ReadErrorKind::MissingNode, place(connectivity), found, expected, cure));
    }
    add_tets(mesh, &cells, &types, first_tag)
}

pub(super) fn place(node: Node) -> Place {
    Place::Line(node.document().text_pos_at(node.range().start).row as usize)
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Result<Node<'a, 'i>, ReadError> {
    node.children().find(|child| child.has_tag_name(name)).ok_or_else(|| {
        let found = format!("an element {} without it", quote(node.tag_name().name()));
        ReadError::new(ReadErrorKind::Syntax, place(node), found, format!("an element {name}"), DAMAGED)
    })
}

fn named<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Result<Node<'a, 'i>, ReadError> {
    let wanted = |child: &Node| child.has_tag_name("DataArray") && child.attribute("Name") == Some(name);
    node.children().find(wanted).ok_or_else(|| {
        let expected = format!("an array named {name}");
        ReadError::new(ReadErrorKind::Syntax, place(node), "cells without it", expected, DAMAGED)
    })
}

/// The piece says how much it holds; if it does not, the arrays decide.
fn announced(piece: Node, attribute: &str, values: usize, values_each: usize) -> Result<(), ReadError> {
    let claim = piece.attribute(attribute).map(|text| text.trim().parse::<usize>());
    let good = match claim {
        None => values.is_multiple_of(values_each),
        Some(Ok(count)) => count.checked_mul(values_each) == Some(values),
        Some(Err(_)) => false,
    };
    if good {
        return Ok(());
    }
    let found = format!("an array of {values} numbers");
    let claim = piece.attribute(attribute).unwrap_or("any number");
    let expected = format!("{values_each} for each of {attribute}={}", quote(claim));
    Err(ReadError::new(ReadErrorKind::Truncated, place(piece), found, expected, DAMAGED))
}

fn floats(array: Node, coding: Coding) -> Result<(Vec<f32>, Place), ReadError> {
    let mut values = Vec::new();
    if let Some(mut text) = ascii(array)? {
        let mut at = text.place();
        while let Some(token) = text.token() {
            at = Place::Line(token.line);
            values.push(narrow(token.f64("a coordinate")?, at, || format!("{} as coordinate", token.shown()))?);
        }
        return Ok((values, at));
    }
    let at = place(array);
    for (index, value) in binary(array, coding)?.into_iter().enumerate() {
        values.push(narrow(value.as_f64(), at, || format!("{} as coordinate {index}", value.as_f64()))?);
    }
    Ok((values, at))
}

fn integers(array: Node, coding: Coding) -> Result<Vec<i64>, ReadError> {
    if let Some(mut text) = ascii(array)? {
        let mut values = Vec::new();
        while let Some(token) = text.token() {
            values.push(token.i64("a whole number")?);
        }
        return Ok(values);
    }
    let whole = |value: Value| match value {
        Value::Whole(value) => Ok(value),
        Value::Real(value) => {
            let found = format!("{value} in an array of indices");
            Err(ReadError::new(ReadErrorKind::BadNumber, place(array), found, "a whole number", DAMAGED))
        }
    };
    binary(array, coding)?.into_iter().map(whole).collect()
}

/// The text of an array with `format="ascii"`, or nothing if it is binary within the file.
fn ascii<'a>(array: Node<'a, '_>) -> Result<Option<Text<'a>>, ReadError> {
    let format = array.attribute("format").unwrap_or("ascii");
    let line = |node: Node| array.document().text_pos_at(node.range().start).row as usize;
    match format {
        "binary" => Ok(None),
        "ascii" => {
            let child = array.children().find(|child| child.is_text());
            let start = child.map_or(line(array), line);
            let text = child.and_then(|child| child.text()).unwrap_or("");
            Ok(Some(Text::at_line(text.as_bytes(), None, start).ending("the end of the array")))
        }
        other => {
            let found = format!("an array with format {}", quote(other));
            let expected = "format ascii, or binary within the array";
            Err(ReadError::new(ReadErrorKind::Unsupported, place(array), found, expected, CURE))
        }
    }
}
