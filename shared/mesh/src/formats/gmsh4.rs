//! Gmsh 4.0 and 4.1 as text: blocks of nodes and of elements, one per entity of the geometry.

use super::builder::{Builder, Region};
use super::gmsh::{Version, corners, end, is_other_volume, is_tet, without_orientation};
use crate::error::{Place, ReadError};
use crate::text::Text;

/// First physical group of each volume of the geometry, sorted by the volume's tag.
#[derive(Default)]
pub(crate) struct Physical {
    volumes: Vec<(i64, i64)>,
}

impl Physical {
    /// Notes a volume and its first physical group; [`Self::sort`] is to follow the last one.
    pub fn add(&mut self, volume: i64, group: i64) {
        self.volumes.push((volume, group));
    }

    /// Puts what was noted into order: at once, for a damaged file may have millions of volumes, the highest first.
    pub fn sort(&mut self) {
        self.volumes.sort_unstable();
    }

    /// Region of an element of volume `entity`: its first physical group, else the volume's own tag.
    pub fn region(&self, entity: i64) -> Region {
        match self.volumes.binary_search_by_key(&entity, |&(tag, _)| tag) {
            Ok(found) => Region::Group(without_orientation(self.volumes[found].1)),
            Err(_) => Region::of_volume(without_orientation(entity)),
        }
    }

    /// `$Entities`. 4.0 and 4.1 write a volume alike, and a point not: 4.0 gives it a box. It only names regions, so what is not understood is passed over.
    pub fn read_entities(&mut self, text: &mut Text) {
        let _ = self.volumes_after_counts(text, false);
        self.sort();
    }

    /// `$PartitionedEntities`, likewise.
    pub fn read_partitioned(&mut self, text: &mut Text) {
        let skip = |text: &mut Text| -> Result<(), ReadError> {
            text.i64("the number of partitions")?;
            let ghosts = text.count("the number of ghost entities", 4)?;
            text.skip_line();
            (0..ghosts).for_each(|_| text.skip_line());
            Ok(())
        };
        if skip(text).is_ok() {
            let _ = self.volumes_after_counts(text, true);
        }
        self.sort();
    }

    fn volumes_after_counts(&mut self, text: &mut Text, partitioned: bool) -> Result<(), ReadError> {
        /// A tag, a box or a point, a count: no entity is shorter.
        const ENTITY_BYTES: usize = 8;
        let mut before = 0_usize;
        for what in ["points", "curves", "surfaces"] {
            before = before.saturating_add(text.count(what, ENTITY_BYTES)?);
        }
        let volumes = text.count("volumes", ENTITY_BYTES)?;
        text.skip_line();
        for _ in 0..before {
            if text.peek().is_none_or(|token| token.bytes[0] == b'$') {
                return Ok(());
            }
            text.skip_line();
        }
        for _ in 0..volumes {
            if text.peek().is_none_or(|token| token.bytes[0] == b'$') {
                return Ok(());
            }
            let mut line = text.rest_of_line();
            let tag = line.i64("tag")?;
            if partitioned {
                line.i64("dimension of the parent")?;
                line.i64("tag of the parent")?;
                for _ in 0..line.count("partitions", 2)? {
                    line.i64("partition")?;
                }
            }
            for _ in 0..6 {
                line.need("box")?;
            }
            if line.i64("groups")? > 0 {
                self.add(tag, line.i64("group")?);
            }
        }
        Ok(())
    }
}

/// `$Nodes`: blocks; in 4.1 first all tags of a block, then all points; in 4.0 tag and point on one line.
pub(crate) fn nodes(text: &mut Text, mesh: &mut Builder, version: Version) -> Result<(), ReadError> {
    /// “0 0 0” and its line end.
    const POINT_BYTES: usize = 6;
    let blocks = text.count("the number of blocks of nodes", 4)?;
    let total = text.count("the number of nodes", POINT_BYTES)?;
    text.skip_line();
    let mut tags: Vec<(i64, Place)> = Vec::new();
    for block in 1..=blocks {
        let head = format!("block {block} of {blocks} of the nodes");
        for _ in 0..3 {
            text.i64(&head)?; // dimension, tag, parametric
        }
        let count = text.count(&format!("the number of nodes in {head}"), POINT_BYTES)?;
        tags.clear();
        if version == Version::V41 {
            for nth in 1..=count {
                let token = text.need(&head)?;
                tags.push((token.i64(&format!("tag {nth} of {count} in {head}"))?, Place::Line(token.line)));
            }
        }
        for nth in 0..count {
            let what = format!("node {} of {count} in {head}", nth + 1);
            let (tag, place) = match tags.get(nth) {
                Some(&known) => known,
                None => {
                    let token = text.need(&what)?;
                    (token.i64(&what)?, Place::Line(token.line))
                }
            };
            mesh.node(tag, text.point(&what)?, place);
            text.skip_line(); // parametric coordinates
        }
    }
    end(text, "$EndNodes", total)
}

/// `$Elements`: blocks of one element type each.
pub(crate) fn elements(text: &mut Text, mesh: &mut Builder, version: Version, physical: &Physical) -> Result<(), ReadError> {
    /// “1 2” and its line end.
    const ELEMENT_BYTES: usize = 4;
    let blocks = text.count("the number of blocks of elements", 4)?;
    let total = text.count("the number of elements", ELEMENT_BYTES)?;
    text.skip_line();
    for block in 1..=blocks {
        let head = format!("block {block} of {blocks} of the elements");
        let pair = [text.i64(&head)?, text.i64(&head)?];
        let entity = if version == Version::V41 { pair[1] } else { pair[0] };
        let kind = text.i64(&head)?;
        let count = text.count(&format!("the number of elements in {head}"), ELEMENT_BYTES)?;
        if is_other_volume(kind) {
            mesh.other_volume_cells += count;
        }
        for nth in 1..=count {
            let what = format!("element {nth} of {count} in {head}");
            let token = text.need(&what)?;
            token.i64(&what)?;
            let mut rest = text.rest_of_line();
            if is_tet(kind) {
                mesh.tet(corners(&mut rest, &what)?, physical.region(entity), Place::Line(token.line));
            }
        }
    }
    end(text, "$EndElements", total)
}
