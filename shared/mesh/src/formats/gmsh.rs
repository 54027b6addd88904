//! Gmsh's mesh files as text: versions 1 (`$NOD`, `$ELM`), 2.x and, by way of [`gmsh4`](super::gmsh4), 4.0 and 4.1. Those in binary, of 2.x and 4.1, are left
//! to [`gmsh_binary`](super::gmsh_binary).
//!
//! Follows the file format chapter of the Gmsh reference manual. Sections may come in any order; unknown ones are skipped; tags may
//! be sparse and unordered; elements that are no tets are passed over; of a tet of higher order the four corners are taken.

use super::builder::{Builder, Region};
use super::{gmsh_binary, gmsh4};
use crate::error::{Place, ReadError, ReadErrorKind};
use crate::text::{Text, Token, without_mark};

/// How the file writes its nodes and elements.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Version {
    V1,
    V2,
    V40,
    V41,
}

pub(super) const CURE: &str = "save the mesh again as ASCII: gmsh FILE -save -format msh41 -o NEW.msh";

/// Reads any Gmsh mesh file.
pub(crate) fn read(bytes: &[u8]) -> Result<Builder, ReadError> {
    let mut text = Text::new(bytes, None);
    let mut mesh = Builder::default();
    let mut version = None;
    let mut physical = gmsh4::Physical::default();
    while let Some(token) = text.token() {
        if token.bytes[0] != b'$' {
            text.skip_line(); // the body of a section that is not read here, or its end
        } else if token.is("$MeshFormat") {
            let (found, is_binary) = mesh_format(&mut text)?;
            if is_binary {
                return gmsh_binary::read(without_mark(bytes), text.at(), found);
            }
            version = Some(found);
        } else if token.is("$NOD") {
            version = version.or(Some(Version::V1));
            nodes(&mut text, &mut mesh)?;
        } else if token.is("$ELM") {
            elements(&mut text, &mut mesh, Version::V1)?;
        } else if token.is("$Nodes") || token.is("$ParametricNodes") {
            match need_version(version, token)? {
                new @ (Version::V40 | Version::V41) => gmsh4::nodes(&mut text, &mut mesh, new)?,
                _ => nodes(&mut text, &mut mesh)?,
            }
        } else if token.is("$Elements") {
            match need_version(version, token)? {
                new @ (Version::V40 | Version::V41) => gmsh4::elements(&mut text, &mut mesh, new, &physical)?,
                old => elements(&mut text, &mut mesh, old)?,
            }
        } else if token.is("$Entities") && is_4(version) {
            physical.read_entities(&mut text);
        } else if token.is("$PartitionedEntities") && is_4(version) {
            physical.read_partitioned(&mut text);
        }
    }
    if version.is_none() {
        let cure = "give an ASCII mesh of Gmsh; a .msh of another program must be converted: meshio convert FILE NEW.vtk --ascii";
        let expected = "a section $MeshFormat or $NOD";
        return Err(ReadError::new(ReadErrorKind::Syntax, Place::File, "neither", expected, cure));
    }
    Ok(mesh)
}

fn is_4(version: Option<Version>) -> bool {
    matches!(version, Some(Version::V40 | Version::V41))
}

fn need_version(version: Option<Version>, token: Token) -> Result<Version, ReadError> {
    version.ok_or_else(|| {
        let cure = "the head of the file is missing: copy or export it again";
        let expected = "a section $MeshFormat before it";
        ReadError::new(ReadErrorKind::Syntax, Place::Line(token.line), token.shown(), expected, cure)
    })
}

/// The version, and whether what follows is binary.
fn mesh_format(text: &mut Text) -> Result<(Version, bool), ReadError> {
    let number = text.need("the version of the format, as 2.2 or 4.1")?;
    let version = match number.f64("the version of the format, as 2.2 or 4.1")? {
        v if (1.0..2.0).contains(&v) => Version::V1,
        v if (2.0..3.0).contains(&v) => Version::V2,
        v if (4.0..4.05).contains(&v) => Version::V40,
        v if (4.05..5.0).contains(&v) => Version::V41,
        _ => {
            let found = format!("format version {}", number.shown());
            return Err(unsupported(number.line, found, "version 1, 2.x, 4.0 or 4.1"));
        }
    };
    let expected = "the file type, 0 for ASCII, 1 for binary";
    let kind = text.need(expected)?;
    let is_binary = kind.i64(expected)? != 0;
    if is_binary {
        let size = text.i64("the size of a number in bytes, 8")?;
        if !matches!(version, Version::V2 | Version::V41) || size != 8 || !kind.is("1") {
            let expected = "an ASCII mesh (file type 0), or one of version 2.x or 4.1 with numbers of 8 bytes";
            return Err(unsupported(kind.line, "a binary mesh".into(), expected));
        }
    }
    text.skip_line();
    Ok((version, is_binary))
}

fn unsupported(line: usize, found: String, expected: &str) -> ReadError {
    ReadError::new(ReadErrorKind::Unsupported, Place::Line(line), found, expected, CURE)
}

/// Versions 1 and 2: a count, then `tag x y z` each.
fn nodes(text: &mut Text, mesh: &mut Builder) -> Result<(), ReadError> {
    /// “1 0 0 0” and its line end.
    const NODE_BYTES: usize = 8;
    let count = text.count("the number of nodes", NODE_BYTES)?;
    for nth in 1..=count {
        let what = || format!("node {nth} of {count}");
        let token = text.need(&what())?;
        let tag = token.i64(&what())?;
        let position = text.point(&what())?;
        mesh.node(tag, position, Place::Line(token.line));
        text.skip_line(); // parametric coordinates
    }
    end(text, "$ENDNOD or $EndNodes", count)
}

/// Versions 1 and 2: a count, then a line for each element.
fn elements(text: &mut Text, mesh: &mut Builder, version: Version) -> Result<(), ReadError> {
    /// “1 15 0 1” and its line end.
    const ELEMENT_BYTES: usize = 8;
    let count = text.count("the number of elements", ELEMENT_BYTES)?;
    for nth in 1..=count {
        let what = format!("element {nth} of {count}");
        let line = text.need(&what)?;
        line.i64(&what)?;
        let kind = text.i64(&what)?;
        let mut rest = text.rest_of_line();
        if !is_tet(kind) {
            mesh.other_volume_cells += usize::from(is_other_volume(kind));
            continue;
        }
        let tags = if version == Version::V1 { 3 } else { rest.i64(&what)? };
        let mut region = Region::Group(0);
        for nth in 0..tags {
            region = region_with(region, nth, rest.i64(&what)?);
        }
        mesh.tet(corners(&mut rest, &what)?, region, Place::Line(line.line));
    }
    end(text, "$ENDELM or $EndElements", count)
}

/// The region of a tet of version 1 or 2 that is this one by the tags before this one: the first is the physical group; without one, the volume's own number,
/// which follows.
pub(super) fn region_with(region: Region, nth: i64, tag: i64) -> Region {
    match nth {
        0 => Region::Group(without_orientation(tag)),
        1 if region == Region::Group(0) => Region::of_volume(without_orientation(tag)),
        _ => region,
    }
}

/// A physical group by its number alone: the sign says which way round an entity is in it.
pub(super) fn without_orientation(group: i64) -> i64 {
    group.saturating_abs()
}

/// The first four nodes of a tet of any order.
pub(crate) fn corners(text: &mut Text, what: &str) -> Result<[i64; 4], ReadError> {
    let mut tags = [0; 4];
    for tag in &mut tags {
        *tag = text.i64(what)?;
    }
    Ok(tags)
}

/// A section must end where its count says.
pub(crate) fn end(text: &mut Text, expected: &str, count: usize) -> Result<(), ReadError> {
    let token = text.need(expected)?;
    if token.bytes[0] == b'$' {
        return Ok(());
    }
    Err(ReadError::new(
        ReadErrorKind::Syntax,
        Place::Line(token.line),
        token.shown(),
        format!("{expected} after {count} entries"),
        "the count at the head of the section is wrong: export the mesh again",
    ))
}

/// Element types of the manual: tets of order 1 to 5 (and 10), complete.
pub(crate) fn is_tet(kind: i64) -> bool {
    matches!(kind, 4 | 11 | 29..=31 | 71..=75)
}

/// Hexahedra, prisms and pyramids.
pub(crate) fn is_other_volume(kind: i64) -> bool {
    matches!(kind, 5..=7 | 12..=14 | 17..=19 | 90..=98 | 106..=131)
}
