//! Gmsh's binary mesh files, versions 2.x and 4.1: sections with names of text, and in them numbers as the machine that wrote them has them, in either byte
//! order.
//!
//! Follows the file format chapter of the Gmsh reference manual. What is read of them is what [`gmsh`](super::gmsh) reads of the same file as text; sections
//! that are not read are passed over to their ends.

use super::builder::{Builder, Region};
use super::gmsh::{CURE, Version, is_other_volume, is_tet, region_with};
use super::gmsh4::Physical;
use crate::error::{Place, ReadError, ReadErrorKind};
use crate::text::{narrow, take};

/// Bytes of the numbers in a file: a whole number, a size or a tag of version 4.1, a coordinate.
const INT_BYTES: usize = 4;
const SIZE_BYTES: usize = 8;
const REAL_BYTES: usize = 8;

const DAMAGED: &str = "the file is cut short or damaged: copy or export it again";

/// Reads a file from behind the line that says that it is binary.
pub(crate) fn read(bytes: &[u8], at: usize, version: Version) -> Result<Builder, ReadError> {
    let mut file = Numbers { bytes, at, big_endian: false };
    let expected = "the number 1, which tells the order of bytes";
    file.big_endian = match file.word::<INT_BYTES>(expected)? {
        [1, 0, 0, 0] => false,
        [0, 0, 0, 1] => true,
        other => {
            let found = format!("the bytes {other:?}");
            return Err(ReadError::new(ReadErrorKind::Syntax, Place::Byte(at), found, expected, DAMAGED));
        }
    };
    let (mut mesh, mut physical) = (Builder::default(), Physical::default());
    while let Some(name) = file.section()? {
        match (name, version) {
            (b"Nodes", Version::V2) => file.nodes_2(&mut mesh)?,
            (b"Nodes", _) => file.nodes_4(&mut mesh)?,
            (b"Elements", Version::V2) => file.elements_2(&mut mesh)?,
            (b"Elements", _) => file.elements_4(&mut mesh, &physical)?,
            _ => {
                let is_partitioned = name == b"PartitionedEntities";
                if is_partitioned || name == b"Entities" {
                    // They only name regions, so what is not understood is passed over; a copy of the place reads them.
                    let _ = file.entities(&mut physical, is_partitioned);
                    physical.sort();
                }
                file.pass(name);
            }
        }
    }
    Ok(mesh)
}

/// A place in a binary file.
#[derive(Clone, Copy)]
struct Numbers<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Numbers<'a> {
    /// The name of the next section, or `None` at the end of the file. Its numbers begin where this is then.
    fn section(&mut self) -> Result<Option<&'a [u8]>, ReadError> {
        loop {
            while self.bytes.get(self.at).is_some_and(u8::is_ascii_whitespace) {
                self.at += 1;
            }
            let Some(&byte) = self.bytes.get(self.at) else { return Ok(None) };
            if byte != b'$' {
                let expected = "“$” and the name of a section, or of the end of one";
                let found = format!("the byte {byte}");
                return Err(ReadError::new(ReadErrorKind::Syntax, Place::Byte(self.at), found, expected, DAMAGED));
            }
            self.at += 1;
            let name = self.line();
            if !name.starts_with(b"End") {
                return Ok(Some(name));
            }
        }
    }

    /// What is left of a line of text; this goes behind its end.
    fn line(&mut self) -> &'a [u8] {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
        self.at += (length + 1).min(rest.len());
        rest[..length].trim_ascii()
    }

    /// Goes to the end of a section, or of the file if there is none.
    fn pass(&mut self, name: &[u8]) {
        let end = [b"$End".as_slice(), name].concat();
        let rest = &self.bytes[self.at..];
        self.at += rest.windows(end.len()).position(|piece| piece == end).unwrap_or(rest.len());
    }

    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], ReadError> {
        take(self.bytes, &mut self.at, count, what, DAMAGED)
    }

    /// The bytes of a number, the lowest first.
    fn word<const BYTES: usize>(&mut self, what: &str) -> Result<[u8; BYTES], ReadError> {
        let mut word = [0; BYTES];
        word.copy_from_slice(self.take(BYTES, what)?);
        if self.big_endian {
            word.reverse();
        }
        Ok(word)
    }

    fn int(&mut self, what: &str) -> Result<i64, ReadError> {
        Ok(i64::from(i32::from_le_bytes(self.word(what)?)))
    }

    /// A tag of version 4.1; one that is too large for any node names none.
    fn size(&mut self, what: &str) -> Result<i64, ReadError> {
        Ok(i64::try_from(u64::from_le_bytes(self.word(what)?)).unwrap_or(i64::MAX))
    }

    fn real(&mut self, what: &str) -> Result<f64, ReadError> {
        Ok(f64::from_le_bytes(self.word(what)?))
    }

    fn point(&mut self, what: &str) -> Result<[f32; 3], ReadError> {
        let mut point = [0.0; 3];
        for (axis, coordinate) in ["x", "y", "z"].iter().zip(&mut point) {
            let place = Place::Byte(self.at);
            let value = self.real(what)?;
            *coordinate = narrow(value, place, || format!("{value} as {axis} of {what}"))?;
        }
        Ok(point)
    }

    /// A count of version 4.1, of things of so many bytes each: none that the rest of the file cannot hold.
    fn count(&mut self, what: &str, bytes_each: usize) -> Result<usize, ReadError> {
        let at = self.at;
        let count = self.size(what)?;
        self.fitting(count, at, what, bytes_each)
    }

    /// The same of version 2, where it is a line of text.
    fn count_of_line(&mut self, what: &str, bytes_each: usize) -> Result<usize, ReadError> {
        let at = self.at;
        let said = std::str::from_utf8(self.line()).ok().and_then(|text| text.parse().ok());
        self.fitting(said.unwrap_or(-1), at, what, bytes_each)
    }

    fn fitting(&self, count: i64, at: usize, what: &str, bytes_each: usize) -> Result<usize, ReadError> {
        let left = self.bytes.len() - self.at;
        usize::try_from(count).ok().filter(|count| count.saturating_mul(bytes_each) <= left).ok_or_else(|| {
            let expected = format!("a count that the {left} bytes left can hold");
            ReadError::new(ReadErrorKind::AbsurdCount, Place::Byte(at), format!("{count} as {what}"), expected, DAMAGED)
        })
    }

    /// Nodes of an element of this type.
    fn nodes_of(&self, kind: i64) -> Result<usize, ReadError> {
        nodes_of(kind).ok_or_else(|| {
            let found = format!("elements of type {kind} in a binary mesh");
            ReadError::new(ReadErrorKind::Unsupported, Place::Byte(self.at), found, "one of the types 1 to 31, 92 and 93", CURE)
        })
    }

    fn nodes_2(&mut self, mesh: &mut Builder) -> Result<(), ReadError> {
        let count = self.count_of_line("the number of nodes", INT_BYTES + 3 * REAL_BYTES)?;
        for nth in 1..=count {
            let what = format!("node {nth} of {count}");
            let place = Place::Byte(self.at);
            let tag = self.int(&what)?;
            mesh.node(tag, self.point(&what)?, place);
        }
        Ok(())
    }

    /// Blocks of one type and one number of tags each.
    fn elements_2(&mut self, mesh: &mut Builder) -> Result<(), ReadError> {
        let total = self.count_of_line("the number of elements", 2 * INT_BYTES)?;
        let mut read = 0;
        while read < total {
            let what = format!("element {} of {total}", read + 1);
            let (kind, at) = (self.int(&what)?, self.at);
            let said = self.int(&what)?;
            let (follow, tags) = (self.fitting(said, at, "the number of elements that follow", 2 * INT_BYTES)?, self.int(&what)?);
            let nodes = self.nodes_of(kind)?;
            if follow == 0 || follow > total - read {
                let expected = format!("1 to {}", total - read);
                let found = format!("{follow} as the number of elements that follow");
                return Err(ReadError::new(ReadErrorKind::Syntax, Place::Byte(at), found, expected, DAMAGED));
            }
            mesh.other_volume_cells += if is_other_volume(kind) { follow } else { 0 };
            for _ in 0..follow {
                let place = Place::Byte(self.at);
                self.int(&what)?; // its number
                let mut region = Region::Group(0);
                for nth in 0..tags {
                    region = region_with(region, nth, self.int(&what)?);
                }
                let corners = self.corners(nodes, INT_BYTES, &what)?;
                if is_tet(kind) {
                    mesh.tet(corners, region, place);
                }
            }
            read += follow;
        }
        Ok(())
    }

    /// Blocks; in each first all tags, then all points.
    fn nodes_4(&mut self, mesh: &mut Builder) -> Result<(), ReadError> {
        let blocks = self.count("the number of blocks of nodes", 3 * INT_BYTES + SIZE_BYTES)?;
        self.take(3 * SIZE_BYTES, "the number of nodes, their least and largest tag")?;
        for block in 1..=blocks {
            let head = format!("block {block} of {blocks} of the nodes");
            let [dimension, _, parametric] = [self.int(&head)?, self.int(&head)?, self.int(&head)?];
            let reals = if parametric == 0 { 0 } else { dimension.clamp(0, 3) as usize };
            let count = self.count(&format!("the number of nodes in {head}"), SIZE_BYTES + 3 * REAL_BYTES)?;
            let mut tags = *self;
            self.take(count * SIZE_BYTES, &head)?;
            for nth in 1..=count {
                let what = format!("node {nth} of {count} in {head}");
                let place = Place::Byte(tags.at);
                let tag = tags.size(&what)?;
                mesh.node(tag, self.point(&what)?, place);
                self.take(reals * REAL_BYTES, &what)?;
            }
        }
        Ok(())
    }

    /// Blocks of one type each.
    fn elements_4(&mut self, mesh: &mut Builder, physical: &Physical) -> Result<(), ReadError> {
        let blocks = self.count("the number of blocks of elements", 3 * INT_BYTES + SIZE_BYTES)?;
        self.take(3 * SIZE_BYTES, "the number of elements, their least and largest tag")?;
        for block in 1..=blocks {
            let head = format!("block {block} of {blocks} of the elements");
            let [_, entity, kind] = [self.int(&head)?, self.int(&head)?, self.int(&head)?];
            let nodes = self.nodes_of(kind)?;
            let count = self.count(&format!("the number of elements in {head}"), (1 + nodes) * SIZE_BYTES)?;
            mesh.other_volume_cells += if is_other_volume(kind) { count } else { 0 };
            for nth in 1..=count {
                let what = format!("element {nth} of {count} in {head}");
                let place = Place::Byte(self.at);
                self.size(&what)?; // its tag
                let corners = self.corners(nodes, SIZE_BYTES, &what)?;
                if is_tet(kind) {
                    mesh.tet(corners, physical.region(entity), place);
                }
            }
        }
        Ok(())
    }

    /// The tags of an element's first four nodes, 0 for those that it has not; this goes behind all of them.
    fn corners(&mut self, nodes: usize, bytes_each: usize, what: &str) -> Result<[i64; 4], ReadError> {
        let mut corners = [0; 4];
        for corner in corners.iter_mut().take(nodes) {
            *corner = if bytes_each == INT_BYTES { self.int(what)? } else { self.size(what)? };
        }
        self.take(nodes.saturating_sub(4) * bytes_each, what)?;
        Ok(corners)
    }

    /// The entities of the geometry: of each volume the first physical group.
    fn entities(mut self, physical: &mut Physical, is_partitioned: bool) -> Result<(), ReadError> {
        if is_partitioned {
            self.size("the number of partitions")?;
            let ghosts = self.count("the number of ghost entities", 2 * INT_BYTES)?;
            self.take(ghosts * 2 * INT_BYTES, "ghost entities")?;
        }
        let mut counts = [0; 4];
        for (count, what) in counts.iter_mut().zip(["points", "curves", "surfaces", "volumes"]) {
            *count = self.count(what, INT_BYTES + 3 * REAL_BYTES)?;
        }
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                let tag = self.int("tag")?;
                if is_partitioned {
                    self.take(2 * INT_BYTES, "dimension and tag of the parent")?;
                    self.tags("partitions")?;
                }
                let reals = if dimension == 0 { 3 } else { 6 };
                self.take(reals * REAL_BYTES, "place")?;
                let group = self.tags("groups")?;
                if dimension > 0 {
                    self.tags("borders")?;
                }
                if let Some(group) = group.filter(|_| dimension == 3) {
                    physical.add(tag, group);
                }
            }
        }
        Ok(())
    }

    /// A count and so many whole numbers; gives the first one.
    fn tags(&mut self, what: &str) -> Result<Option<i64>, ReadError> {
        let count = self.count(what, INT_BYTES)?;
        let first = (count > 0).then(|| self.int(what)).transpose()?;
        self.take(count.saturating_sub(1) * INT_BYTES, what)?;
        Ok(first)
    }
}

/// Nodes of an element of this type in the manual's table; `None` for types that programs hardly write.
fn nodes_of(kind: i64) -> Option<usize> {
    const OF_TYPES: [usize; 31] =
        [2, 3, 4, 4, 8, 6, 5, 3, 6, 9, 10, 27, 18, 14, 1, 8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4, 5, 6, 20, 35, 56];
    match kind {
        92 => Some(64),
        93 => Some(125),
        _ => OF_TYPES.get(usize::try_from(kind).ok()?.checked_sub(1)?).copied(),
    }
}
