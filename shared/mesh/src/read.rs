//! Finds out what a file is, by its content first and its name second, and reads it.

use crate::error::{Place, ReadError, ReadErrorKind, quote};
use crate::formats::{builder::Builder, gmsh, medit, obj, vtk_legacy, vtk_xml};
use crate::text::{Text, without_mark};
use crate::types::{TetMesh, TriangleMesh};

/// A format that is read here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Gmsh, versions 1, 2.x, 4.0 and 4.1; in binary 2.x and 4.1.
    Gmsh,
    /// VTK legacy, ASCII or binary.
    VtkLegacy,
    /// VTK XML unstructured grid.
    VtkXml,
    /// Medit, ASCII.
    Medit,
    /// One of TetGen's two files.
    Tetgen,
    /// Wavefront OBJ: surfaces only.
    Obj,
}

/// A file of tets and what was found in it besides them.
#[derive(Debug, Clone, PartialEq)]
pub struct TetFile {
    /// The tets, in the unit of the file.
    pub mesh: TetMesh,
    /// The format as it was recognised.
    pub format: Format,
    /// Hexahedra, prisms, pyramids and the like that were passed over. If there are any, the mesh may have holes where they were.
    pub other_volume_cells: usize,
    /// Numbers in [`TetMesh::regions`] that a physical group of Gmsh and a volume in none have both, as `Mesh.SaveAll` may leave them; ascending, each with
    /// the first tet of the second of the two.
    pub shared_numbers: Vec<(u32, Place)>,
}

const KNOWN: &str =
    "a mesh as Gmsh .msh, VTK .vtk or .vtu, Medit .mesh, TetGen .node and .ele (volumes), or .obj and .vtk (surfaces)";
const CONVERT: &str =
    "convert it, for example: gmsh FILE -save -format msh41 -o NEW.msh, or: meshio convert FILE NEW.vtk --ascii";

/// Reads the tets of a file. `name` is its name or path, of which only the extension counts; coordinates stay in the file's unit.
///
/// # Errors
/// A [`ReadError`] that says where, what was found, what was expected and what to do.
pub fn read_tets(name: &str, bytes: &[u8]) -> Result<TetMesh, ReadError> {
    read_tet_file(name, bytes).map(|file| file.mesh)
}

/// As [`read_tets`], with what was found besides the tets.
///
/// # Errors
/// As [`read_tets`].
pub fn read_tet_file(name: &str, bytes: &[u8]) -> Result<TetFile, ReadError> {
    let format = detect(name, bytes)?;
    let builder: Builder = match format {
        Format::Gmsh => gmsh::read(bytes)?,
        Format::VtkLegacy => vtk_legacy::read(bytes)?,
        Format::VtkXml => vtk_xml::read(bytes)?,
        Format::Medit => medit::read(bytes)?,
        Format::Tetgen => return Err(needs_companion(name)),
        Format::Obj => {
            let expected = "a volume of tets";
            let cure = "give the volume mesh here and this file as its surface";
            return Err(ReadError::new(ReadErrorKind::Empty, Place::File, "a surface (OBJ)", expected, cure));
        }
    };
    let (mesh, other_volume_cells, shared_numbers) = builder.finish()?;
    Ok(TetFile { mesh, format, other_volume_cells, shared_numbers })
}

/// Reads the triangles of a surface file (OBJ or VTK legacy POLYDATA); polygons become fans. Coordinates stay in the file's unit.
///
/// # Errors
/// As [`read_tets`].
pub fn read_triangles(name: &str, bytes: &[u8]) -> Result<TriangleMesh, ReadError> {
    let surface = match detect(name, bytes)? {
        Format::Obj => obj::read_surface(bytes)?,
        Format::VtkLegacy => vtk_legacy::read_surface(bytes)?,
        other => {
            let cure = "export the surface as .obj; without a surface file the boundary of the tets is drawn";
            let found = format!("a {other:?} file");
            return Err(ReadError::new(ReadErrorKind::Unsupported, Place::File, found, "a surface as .obj or .vtk", cure));
        }
    };
    if surface.triangles.is_empty() {
        let found = format!("{} vertices and no face", surface.positions_m.len());
        let cure = "export the surface with its faces";
        return Err(ReadError::new(ReadErrorKind::Empty, Place::File, found, "at least one triangle", cure));
    }
    Ok(surface)
}

/// The other of TetGen's two files (`organ.node` for `organ.ele` and the reverse), or `None` for any other name.
pub fn companion_name(name: &str) -> Option<String> {
    let stem = name.get(..name.rfind('.')?)?;
    match extension(name).as_str() {
        "node" => Some(format!("{stem}.ele")),
        "ele" => Some(format!("{stem}.node")),
        _ => None,
    }
}

fn needs_companion(name: &str) -> ReadError {
    let other = companion_name(name).unwrap_or_else(|| "its .node or .ele file".into());
    let found = "one of TetGen's two files";
    let cure = format!("put {other} beside it");
    ReadError::new(ReadErrorKind::Unsupported, Place::File, found, "the .node and the .ele file together", cure)
}

fn extension(name: &str) -> String {
    name.rsplit_once('.').map_or(String::new(), |(_, extension)| extension.to_ascii_lowercase())
}

/// Which format a file is in. What the content says goes before what the name says.
///
/// # Errors
/// The file is empty, packed, Medit's in binary, or of no format that is read here.
pub fn detect(name: &str, bytes: &[u8]) -> Result<Format, ReadError> {
    let bytes = without_mark(bytes);
    if let Some(format) = by_content(bytes) {
        return Ok(format);
    }
    if bytes.iter().all(u8::is_ascii_whitespace) {
        let cure = "the file is cut short: copy or export it again";
        return Err(ReadError::new(ReadErrorKind::Truncated, Place::File, "an empty file", KNOWN, cure));
    }
    if bytes.starts_with(b"\x1f\x8b") || bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"BZh") {
        let cure = "unpack it first (gunzip, unzip or bunzip2)";
        return Err(ReadError::new(ReadErrorKind::Unsupported, Place::Byte(0), "a packed file", KNOWN, cure));
    }
    if is_binary_medit(bytes) {
        let cure = "save it as ASCII .mesh";
        return Err(ReadError::new(ReadErrorKind::Unsupported, Place::Byte(0), "a binary Medit file", KNOWN, cure));
    }
    match extension(name).as_str() {
        "msh" => Ok(Format::Gmsh),
        "vtk" => Ok(Format::VtkLegacy),
        "vtu" => Ok(Format::VtkXml),
        "mesh" => Ok(Format::Medit),
        "node" | "ele" => Ok(Format::Tetgen),
        "obj" => Ok(Format::Obj),
        _ => {
            let head: &[u8] = bytes.split(|&byte| byte == b'\n' || byte == b'\r').next().unwrap_or(&[]);
            let found = quote(&String::from_utf8_lossy(&head[..head.len().min(80)]));
            Err(ReadError::new(ReadErrorKind::UnknownFormat, Place::File, format!("{found} at its start"), KNOWN, CONVERT))
        }
    }
}

/// Whether a file begins as Medit's do in binary: with the number 1, which tells the order of bytes, and a version from 1 to 4.
fn is_binary_medit(bytes: &[u8]) -> bool {
    matches!(bytes, [1, 0, 0, 0, 1..=4, 0, 0, 0, ..] | [0, 0, 0, 1, 0, 0, 0, 1..=4, ..])
}

fn by_content(bytes: &[u8]) -> Option<Format> {
    let first = Text::new(bytes, None).token()?;
    let starts = |word: &str| first.bytes.get(..word.len()).is_some_and(|head| head.eq_ignore_ascii_case(word.as_bytes()));
    if starts("$") {
        return Some(Format::Gmsh);
    }
    if starts("<?xml") || starts("<VTKFile") || starts("<!--") {
        return Some(Format::VtkXml);
    }
    let mut line = Text::new(bytes, None).rest_of_first_line();
    if std::iter::from_fn(|| line.token()).any(|token| token.is("DataFile")) {
        return Some(Format::VtkLegacy);
    }
    let word = Text::new(bytes, Some(b'#')).token()?;
    if word.is("MeshVersionFormatted") {
        return Some(Format::Medit);
    }
    ["v", "vn", "vt", "mtllib", "usemtl"].iter().any(|obj| word.is(obj)).then_some(Format::Obj)
}
