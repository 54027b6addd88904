//! Collects nodes by tag and tets by the tags of their nodes, in any order, and checks that they fit together.

use crate::error::{Place, ReadError, ReadErrorKind};
use crate::types::TetMesh;
use std::fmt;

/// The region of a tet as a file names it. Its number is that without its sign.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Region {
    /// By a number that is there for this: of a physical group, a reference or an attribute; 0 if it names none.
    Group(i64),
    /// By that of the volume of the geometry that it lies in, if this is in no group: to Gmsh the two have nothing to do with each other.
    Volume(i64),
}

impl Region {
    /// That of a volume in no group; 0 is none.
    pub fn of_volume(tag: i64) -> Region {
        if tag == 0 { Region::Group(0) } else { Region::Volume(tag) }
    }

    fn named(self) -> i64 {
        let (Region::Group(named) | Region::Volume(named)) = self;
        named
    }
}

impl fmt::Display for Region {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Region::Group(named) => write!(out, "{named}"),
            Region::Volume(tag) => write!(out, "volume {tag} (in no physical group)"),
        }
    }
}

/// Nodes and tets as a file names them.
#[derive(Default)]
pub(crate) struct Builder {
    positions: Vec<[f32; 3]>,
    node_tags: Vec<(i64, Place)>,
    tets: Vec<([i64; 4], Place)>,
    regions: Vec<Region>,
    /// Hexahedra, prisms, pyramids and the like that were passed over.
    pub other_volume_cells: usize,
}

impl Builder {
    pub fn node(&mut self, tag: i64, position: [f32; 3], place: Place) {
        self.positions.push(position);
        self.node_tags.push((tag, place));
    }

    pub fn tet(&mut self, tags: [i64; 4], region: Region, place: Place) {
        self.tets.push((tags, place));
        self.regions.push(region);
    }

    pub fn node_count(&self) -> usize {
        self.positions.len()
    }

    /// The mesh, the number of volume cells that are no tets, and the [numbers that two regions share](crate::TetFile::shared_numbers).
    ///
    /// # Errors
    /// Two nodes with one tag, a tet with a node that is not there, two regions that would have one number, no tet at all.
    pub fn finish(self) -> Result<(TetMesh, usize, Shared), ReadError> {
        let Builder { positions, node_tags, tets, regions, other_volume_cells } = self;
        if tets.is_empty() {
            return Err(no_tets(positions.len(), other_volume_cells));
        }
        let by_tag = index_by_tag(&node_tags)?;
        let (regions, shared_numbers) = region_numbers(&regions, &tets)?;
        let resolve = |tag: i64, place: Place| match by_tag.binary_search_by_key(&tag, |&(tag, _)| tag) {
            Ok(found) => Ok(by_tag[found].1),
            Err(_) => Err(missing(tag, place, &by_tag)),
        };
        let mut indices = Vec::with_capacity(tets.len());
        for (tags, place) in tets {
            let mut tet = [0; 4];
            for (index, tag) in tet.iter_mut().zip(tags) {
                *index = resolve(tag, place)?;
            }
            indices.push(tet);
        }
        Ok((TetMesh { positions_m: positions, tets: indices, regions }, other_volume_cells, shared_numbers))
    }
}

fn index_by_tag(node_tags: &[(i64, Place)]) -> Result<Vec<(i64, u32)>, ReadError> {
    let mut by_tag = Vec::with_capacity(node_tags.len());
    for (index, &(tag, place)) in node_tags.iter().enumerate() {
        let index = u32::try_from(index).map_err(|_| too_many(place))?;
        by_tag.push((tag, index));
    }
    by_tag.sort_unstable();
    for pair in by_tag.windows(2) {
        if pair[0].0 == pair[1].0 {
            let tag = pair[0].0;
            let (_, first) = node_tags[pair[0].1 as usize];
            let (_, second) = node_tags[pair[1].1 as usize];
            return Err(ReadError::new(
                ReadErrorKind::DuplicateNode,
                second,
                format!("node {tag} again (first at {first})"),
                "each node once",
                "remove one of the two, or merge duplicate nodes in the meshing tool and export again",
            ));
        }
    }
    Ok(by_tag)
}

/// Numbers that a group and a volume in none share, each with a place of the second of the two.
pub type Shared = Vec<(u32, Place)>;

/// The number of each tet's region: what the file names, without its sign; and those that a group and a volume in none share.
fn region_numbers(named: &[Region], tets: &[([i64; 4], Place)]) -> Result<(Vec<u32>, Shared), ReadError> {
    let number = |region: &Region| u32::try_from(region.named().unsigned_abs()).unwrap_or(u32::MAX);
    // Each region with the first of its tets.
    let mut firsts: Vec<(u32, Region, usize)> =
        named.iter().zip(0..).map(|(region, tet)| (number(region), *region, tet)).collect();
    firsts.sort_unstable();
    firsts.dedup_by_key(|first| (first.0, first.1));
    let mut shared = Vec::new();
    for pair in firsts.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let place = tets[pair[0].2.max(pair[1].2)].1;
        match [pair[0].1, pair[1].1] {
            [Region::Group(_), Region::Volume(_)] => shared.push((pair[0].0, place)),
            both => return Err(same_number(both, place)),
        }
    }
    Ok((named.iter().map(number).collect(), shared))
}

fn same_number([one, other]: [Region; 2], place: Place) -> ReadError {
    let found = format!("a second one of the regions {one} and {other}, which would be one");
    let expected = format!("numbers of regions that differ in more than their signs, below {}", u32::MAX);
    let cure = "number the regions 1, 2, 3 …, and mesh or export again";
    ReadError::new(ReadErrorKind::BadNumber, place, found, expected, cure)
}

fn too_many(place: Place) -> ReadError {
    let expected = "at most 4294967295 nodes";
    ReadError::new(ReadErrorKind::AbsurdCount, place, "more nodes than that", expected, "mesh more coarsely")
}

fn missing(tag: i64, place: Place, by_tag: &[(i64, u32)]) -> ReadError {
    let expected = match (by_tag.first(), by_tag.last()) {
        (Some(first), Some(last)) => format!("one of the {} nodes, numbered from {} to {}", by_tag.len(), first.0, last.0),
        _ => "nodes before elements, but the file has none".into(),
    };
    ReadError::new(
        ReadErrorKind::MissingNode,
        place,
        format!("a tet with node {tag}"),
        expected,
        "the node list is incomplete or the index is wrong: export the mesh again",
    )
}

fn no_tets(nodes: usize, other_volume_cells: usize) -> ReadError {
    let (found, cure) = if other_volume_cells > 0 {
        (
            format!("{nodes} nodes and {other_volume_cells} volume cells of other shapes"),
            "mesh the volume with tetrahedra (in Gmsh: no recombination, no transfinite volumes)",
        )
    } else {
        (
            format!("{nodes} nodes and no volume cell"),
            "export the volume mesh, not only its surface (in Gmsh: Mesh > 3D; if physical groups exist, one must hold the volume)",
        )
    };
    ReadError::new(ReadErrorKind::Empty, Place::File, found, "at least one tetrahedron", cure)
}
