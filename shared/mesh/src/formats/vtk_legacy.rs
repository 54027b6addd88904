//! VTK's legacy files, ASCII or binary: `UNSTRUCTURED_GRID` for volumes, `POLYDATA` for surfaces, in the form before and since version 5.
//!
//! Follows the chapter on file formats of VTK's user's guide. Of mixed cells the tets are taken.

use super::builder::{Builder, Region};
use super::vtk_legacy_binary as binary;
use crate::error::{Place, ReadError, ReadErrorKind};
use crate::text::{Text, Token, narrow};
use crate::types::TriangleMesh;

/// Cells as one list of point indices and where each cell starts and ends in it.
#[derive(Default)]
pub(crate) struct Cells {
    pub connectivity: Vec<i64>,
    /// One more than there are cells; the first is 0.
    pub offsets: Vec<i64>,
    pub place: Option<Place>,
}

pub(super) const CURE: &str = "save it as ASCII (ParaView: File > Save Data, file type Ascii; or: meshio ascii FILE)";
const DAMAGED: &str = "the file is damaged: export it again";

struct File {
    dataset: String,
    points: Vec<([f32; 3], Place)>,
    cells: Cells,
    polygons: Cells,
    types: Vec<i64>,
}

/// Reads the tets of an unstructured grid.
pub(crate) fn read(bytes: &[u8]) -> Result<Builder, ReadError> {
    let file = parse(bytes)?;
    if !file.dataset.eq_ignore_ascii_case("UNSTRUCTURED_GRID") {
        let cure = "export the volume as an unstructured grid; a surface alone cannot be deformed as a volume";
        let found = format!("a dataset of type {}", file.dataset);
        return Err(ReadError::new(ReadErrorKind::Empty, Place::File, found, "UNSTRUCTURED_GRID", cure));
    }
    let mut mesh = Builder::default();
    for (tag, (position, place)) in file.points.iter().enumerate() {
        mesh.node(tag as i64, *position, *place);
    }
    add_tets(&mut mesh, &file.cells, &file.types, 0)?;
    Ok(mesh)
}

/// Reads the polygons of a polygonal dataset, each as a fan of triangles.
pub(crate) fn read_surface(bytes: &[u8]) -> Result<TriangleMesh, ReadError> {
    let file = parse(bytes)?;
    let positions_m: Vec<[f32; 3]> = file.points.iter().map(|point| point.0).collect();
    let place = file.polygons.place.unwrap_or(Place::File);
    let mut triangles = Vec::new();
    for ends in file.polygons.offsets.windows(2) {
        let corners = slice(&file.polygons, ends[0], ends[1])?;
        let mut polygon = Vec::with_capacity(corners.len());
        for &corner in corners {
            let index = u32::try_from(corner).ok().filter(|&index| (index as usize) < positions_m.len());
            polygon.push(index.ok_or_else(|| {
                let expected = format!("an index below the number of points, {}", positions_m.len());
                let cure = "the index is wrong: export the surface again";
                ReadError::new(ReadErrorKind::MissingNode, place, format!("a polygon with point {corner}"), expected, cure)
            })?);
        }
        triangles.extend(polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]]));
    }
    Ok(TriangleMesh { positions_m, triangles })
}

/// Adds the tets among `cells`; their point indices are counted from `first_tag`. Shared with the XML form.
pub(crate) fn add_tets(mesh: &mut Builder, cells: &Cells, types: &[i64], first_tag: i64) -> Result<(), ReadError> {
    let place = cells.place.unwrap_or(Place::File);
    let count = cells.offsets.len().saturating_sub(1);
    if count != types.len() {
        let found = format!("{} cell types for {count} cells", types.len());
        return Err(ReadError::new(ReadErrorKind::Syntax, place, found, "one type per cell", DAMAGED));
    }
    for (cell, &kind) in types.iter().enumerate() {
        match kind {
            // tetrahedron, quadratic tetrahedron, Lagrange and Bézier tetrahedron: the corners come first
            10 | 24 | 71 | 78 => {}
            // voxel, hexahedron, wedge, pyramid, and those of higher order; polyhedron
            11..=14 | 25..=27 | 29 | 32 | 33 | 37 | 42 | 72..=74 | 79..=81 => {
                mesh.other_volume_cells += 1;
                continue;
            }
            _ => continue,
        }
        let corners = slice(cells, cells.offsets[cell], cells.offsets[cell + 1])?;
        let Some(&[a, b, c, d]) = corners.get(..4) else {
            let found = format!("cell {cell}, a tet, with {} points", corners.len());
            return Err(ReadError::new(ReadErrorKind::Syntax, place, found, "4 points", DAMAGED));
        };
        mesh.tet([a, b, c, d].map(|index| index.saturating_add(first_tag)), Region::Group(0), place);
    }
    Ok(())
}

fn slice(cells: &Cells, start: i64, end: i64) -> Result<&[i64], ReadError> {
    let range = usize::try_from(start).ok().zip(usize::try_from(end).ok());
    range.and_then(|(start, end)| cells.connectivity.get(start..end)).ok_or_else(|| {
        let place = cells.place.unwrap_or(Place::File);
        let found = format!("a cell from {start} to {end}");
        let expected = format!("offsets that grow and end at {}", cells.connectivity.len());
        ReadError::new(ReadErrorKind::Syntax, place, found, expected, DAMAGED)
    })
}

fn parse(bytes: &[u8]) -> Result<File, ReadError> {
    let mut text = Text::new(bytes, None);
    text.rest_of_first_line(); // “# vtk DataFile Version 3.0”
    text.skip_line(); // title
    let coding = text.need("ASCII or BINARY")?;
    let is_binary = coding.is("BINARY");
    if !is_binary && !coding.is("ASCII") {
        let place = Place::Line(coding.line);
        return Err(ReadError::new(ReadErrorKind::Unsupported, place, coding.shown(), "ASCII or BINARY", CURE));
    }
    let mut file = File {
        dataset: "none".into(),
        points: Vec::new(),
        cells: Cells::default(),
        polygons: Cells::default(),
        types: Vec::new(),
    };
    while let Some(token) = text.token() {
        if token.is("DATASET") {
            file.dataset = String::from_utf8_lossy(text.need("the type of the dataset")?.bytes).into_owned();
        } else if token.is("POINTS") {
            points(&mut text, is_binary, &mut file.points)?;
        } else if token.is("CELLS") {
            file.cells = cells(&mut text, is_binary, token)?;
        } else if token.is("POLYGONS") {
            file.polygons = cells(&mut text, is_binary, token)?;
        } else if token.is("CELL_TYPES") {
            let count = text.count("the number of cell types", 2)?;
            file.types = integers(&mut text, count, INT.filter(|_| is_binary), "the type of cell")?;
        } else if token.is("CELL_DATA") || token.is("POINT_DATA") {
            break; // what follows is not about shape
        }
    }
    Ok(file)
}

/// The type of what has none in its head.
const INT: Option<&[u8]> = Some(b"int");

fn points(text: &mut Text, is_binary: bool, points: &mut Vec<([f32; 3], Place)>) -> Result<(), ReadError> {
    let count = text.count("the number of points", 6)?; // “0 0 0” and its line end
    let kind = text.need("the type of the coordinates")?;
    if is_binary {
        let place = Place::Byte(text.at());
        for (nth, point) in binary::reals(text, 3 * count, kind.bytes, "coordinates")?.chunks_exact(3).enumerate() {
            let mut position = [0.0; 3];
            for (coordinate, value) in position.iter_mut().zip(point) {
                *coordinate = narrow(*value, place, || format!("{value} in point {nth} of {count}, counted from 0"))?;
            }
            points.push((position, place));
        }
        return Ok(());
    }
    for nth in 0..count {
        let what = format!("point {nth} of {count}, counted from 0");
        let place = text.peek().map_or(text.place(), |token| Place::Line(token.line));
        points.push((text.point(&what)?, place));
    }
    Ok(())
}

/// `CELLS n size` with `k i₁ … iₖ` per cell, or since version 5.1 `CELLS n+1 size` with `OFFSETS` and `CONNECTIVITY`.
fn cells(text: &mut Text, is_binary: bool, head: Token) -> Result<Cells, ReadError> {
    let count = text.count("the number of cells", 2)?;
    let size = text.count("the size of the cell list", 2)?;
    let mut cells = Cells { place: Some(Place::Line(head.line)), ..Cells::default() };
    if text.peek().is_some_and(|token| token.is("OFFSETS")) {
        text.need("OFFSETS")?;
        let kind = text.need("the type of the offsets")?.bytes;
        cells.offsets = integers(text, count, is_binary.then_some(kind), "an offset")?;
        let word = text.need("CONNECTIVITY")?;
        if !word.is("CONNECTIVITY") {
            return Err(ReadError::new(ReadErrorKind::Syntax, Place::Line(word.line), word.shown(), "CONNECTIVITY", DAMAGED));
        }
        let kind = text.need("the type of the indices")?.bytes;
        cells.connectivity = integers(text, size, is_binary.then_some(kind), "a point index")?;
        return Ok(cells);
    }
    cells.offsets.push(0);
    if is_binary {
        let list = integers(text, size, INT, "the cells")?;
        let mut rest = list.as_slice();
        for nth in 0..count {
            let place = Place::Byte(text.at());
            let corners = rest.split_first().and_then(|(corners, after)| after.split_at_checked(usize::try_from(*corners).ok()?));
            let (corners, after) = corners.ok_or_else(|| {
                let found = format!("cell {nth} of {count} with more points than there are");
                ReadError::new(ReadErrorKind::Syntax, place, found, format!("a list of {size} numbers for all cells"), DAMAGED)
            })?;
            cells.connectivity.extend(corners);
            cells.offsets.push(cells.connectivity.len() as i64);
            rest = after;
        }
        return Ok(cells);
    }
    for nth in 0..count {
        let corners = text.count(&format!("the number of points of cell {nth} of {count}"), 2)?;
        for _ in 0..corners {
            cells.connectivity.push(text.i64(&format!("a point index of cell {nth} of {count}"))?);
        }
        cells.offsets.push(cells.connectivity.len() as i64);
    }
    Ok(cells)
}

/// Whole numbers as text; with a type, as binary from the next line on.
fn integers(text: &mut Text, count: usize, binary_kind: Option<&[u8]>, what: &str) -> Result<Vec<i64>, ReadError> {
    if let Some(kind) = binary_kind {
        return binary::integers(text, count, kind, what);
    }
    (0..count).map(|nth| text.need(what)?.i64(&format!("{what} ({nth} of {count})"))).collect()
}
