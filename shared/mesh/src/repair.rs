//! Makes a tet mesh fit for a simulation, and says what it did.
//!
//! After a repair: every tet has a positive volume that is more than rounding, and enough for its size that a model can be made of it ([`crate::is_too_flat`]);
//! no two tets have their nodes at the same places, no face has more than two tets, so that the boundary has no open edge ([`overlapping_tets`]), every node is
//! used, and parts that touch with whole faces have their nodes there in common ([`merged`]).
//! Flat tets with a real volume stay: taking one out would tear a slit into the tissue. They are reported.

use crate::check::{FLAT_QUALITY, unused_nodes};
use crate::geometry::{corners, count, is_without_volume, quality, signed_volume};
use crate::merge::{duplicate_tets, merged, overlapping_tets};
use crate::types::TetMesh;
use std::fmt;

/// Up to so many tets that lie in others are dropped, or one of so many of all: a mesher's slip. With more of them whole parts lie in each other, and nobody
/// knows which of these are the organ.
const FEW_OVERLAPPING: usize = 8;
const OVERLAPPING_OF: usize = 100;

/// One thing that a repair did, or left for a reason. `to_string` makes a sentence of it.
#[derive(Debug, Clone, PartialEq)]
pub enum Repair {
    /// Nodes of parts that touched without common nodes were made one with others at the same places, where a boundary face of one lay on one of another.
    MergedNodes {
        /// How many.
        nodes: usize,
        /// At how many faces.
        faces: usize,
        /// The first of them in the file's order, from 0.
        first: u32,
    },
    /// Inverted tets had two nodes exchanged.
    Flipped {
        /// How many.
        tets: usize,
        /// Of how many in all.
        of: usize,
    },
    /// Tets with the nodes of an earlier tet, or with nodes of their own at the same places, were dropped.
    DroppedDuplicates {
        /// How many.
        tets: usize,
        /// The first of them in the file's order, from 0.
        first: u32,
    },
    /// Tets that lay in others, on the same side of a face of more than two, were dropped.
    DroppedOverlapping {
        /// How many.
        tets: usize,
        /// The first of them in the file's order, from 0.
        first: u32,
    },
    /// Tets whose volume is zero or within the rounding of their coordinates, or that are too flat for single precision, were dropped.
    DroppedFlat {
        /// How many.
        tets: usize,
        /// The first of them in the file's order, from 0.
        first: u32,
    },
    /// Tets of low quality but real volume were kept.
    KeptFlat {
        /// How many.
        tets: usize,
        /// The lowest quality among them.
        worst_quality: f64,
        /// The tet that has it, in the file's order, from 0.
        worst: u32,
    },
    /// Nodes that no tet uses were dropped.
    DroppedUnusedNodes {
        /// How many.
        nodes: usize,
        /// The first of them in the file's order, from 0.
        first: u32,
    },
}

impl fmt::Display for Repair {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Repair::MergedNodes { nodes, faces, first } => write!(
                out,
                "merged {} with others at the same places: at {} parts touched without common nodes (first: node {first})",
                count(*nodes, "node"),
                count(*faces, "face")
            ),
            Repair::Flipped { tets, of } if tets == of && *of > 1 => {
                write!(out, "turned round all {tets} tets: they were inverted, as some programs write them")
            }
            Repair::Flipped { tets, of } => write!(out, "turned round {} of {of}: inverted", count(*tets, "tet")),
            Repair::DroppedDuplicates { tets, first } => {
                write!(out, "dropped {} with the nodes of an earlier one (first: tet {first})", count(*tets, "tet"))
            }
            Repair::DroppedOverlapping { tets, first } => write!(
                out,
                "dropped {} on that side of a face on which another lies (first: tet {first}): tets lay in each other",
                count(*tets, "tet")
            ),
            Repair::DroppedFlat { tets, first } => {
                write!(out, "dropped {} without a volume that a model could use (first: tet {first})", count(*tets, "tet"))
            }
            Repair::KeptFlat { tets, worst_quality, worst } => write!(
                out,
                "kept {} of nearly no height (worst: tet {worst}, quality {worst_quality:.1e}, flat below {FLAT_QUALITY:e}): \
                 without them the tissue would have a slit",
                count(*tets, "tet")
            ),
            Repair::DroppedUnusedNodes { nodes, first } => {
                write!(out, "dropped {} that no tet uses (first: node {first})", count(*nodes, "node"))
            }
        }
    }
}

/// A repaired mesh, what was done, and where everything went.
#[derive(Debug, Clone, PartialEq)]
pub struct Repaired {
    /// The mesh as it is now.
    pub mesh: TetMesh,
    /// What was done, in this order. Empty if the mesh was sound.
    pub repairs: Vec<Repair>,
    /// For each former node its index now, that of another one if it was merged with it, or `None` if it was dropped.
    pub node_map: Vec<Option<u32>>,
    /// For each former tet its index now, or `None` if it was dropped.
    pub tet_map: Vec<Option<u32>>,
}

/// Why a mesh cannot be repaired.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RepairError {
    /// There is no tet.
    #[error("the mesh has no tet; give a volume mesh (a surface must be filled with tets first, as by gmsh, tetgen or fTetWild)")]
    NoTets,
    /// The list of regions does not fit.
    #[error("the mesh has {regions} regions for {tets} tets; give one for each, 0 where there is none")]
    Regions {
        /// How many regions.
        regions: usize,
        /// How many tets.
        tets: usize,
    },
    /// A coordinate is not finite.
    #[error("node {node} has a coordinate that is no finite number; correct it in the file, or scale by a smaller factor")]
    NotFinite {
        /// The node.
        node: u32,
    },
    /// A tet names a node that is not there.
    #[error("tet {tet} names node {node}, but there are {nodes}, counted from 0; export the mesh again")]
    OutOfRange {
        /// The tet.
        tet: u32,
        /// What it names.
        node: u32,
        /// How many nodes there are.
        nodes: usize,
    },
    /// Too many tets lie in others.
    #[error(
        "of {of} tets {tets} lie in others: they are on that side of a face on which another is (first: tet {first}); parts of \
         the mesh overlap: leave one of each two out, or unite them before they are meshed, and export again"
    )]
    Overlapping {
        /// How many do.
        tets: usize,
        /// Of how many in all.
        of: usize,
        /// The first of them in the file's order, from 0.
        first: u32,
    },
    /// No tet has a volume.
    #[error(
        "all {tets} tets are flat, so nothing is left; the file may be a surface or its coordinates may have lost a dimension"
    )]
    NothingLeft {
        /// How many there were.
        tets: usize,
    },
}

/// Repairs a mesh: drops duplicates, merges the nodes of parts that touch with whole faces, drops the few tets that lie in others, tets without volume and nodes
/// without tets, flips inverted tets, and keeps the order of the rest.
///
/// # Errors
/// A [`RepairError`] for what no repair can cure.
pub fn repair(mesh: TetMesh) -> Result<Repaired, RepairError> {
    refuse_broken(&mesh)?;
    let TetMesh { positions_m, mut tets, regions } = mesh;
    let mut repairs = Vec::new();
    let mut keep = vec![true; tets.len()];

    // First: a face of a part that is there twice lies on two others, and what touches it there would be joined to none.
    let duplicates = duplicate_tets(&positions_m, &tets);
    duplicates.iter().for_each(|&tet| keep[tet as usize] = false);
    if let Some(&first) = duplicates.first() {
        repairs.push(Repair::DroppedDuplicates { tets: duplicates.len(), first });
    }
    let node_of = merge_touching(&positions_m, &mut tets, &keep, &mut repairs);
    drop_overlapping(&positions_m, &tets, &mut keep, &mut repairs)?;
    drop_flat(&positions_m, &tets, &mut keep, &mut repairs);
    let left = keep.iter().filter(|&&keep| keep).count();
    if left == 0 {
        return Err(RepairError::NothingLeft { tets: tets.len() });
    }
    let flipped = flip_inverted(&positions_m, &mut tets, &keep);
    if flipped > 0 {
        repairs.push(Repair::Flipped { tets: flipped, of: left });
    }
    let tet_map = renumber(&keep);
    let (mesh, kept) = keep_tets(TetMesh { positions_m, tets, regions }, &keep);
    let node_map: Vec<Option<u32>> = node_of.iter().map(|node| kept[*node as usize]).collect();
    if let Some(first) = node_map.iter().position(Option::is_none) {
        let nodes = node_map.iter().filter(|node| node.is_none()).count();
        repairs.push(Repair::DroppedUnusedNodes { nodes, first: first as u32 });
    }
    Ok(Repaired { mesh, repairs, node_map, tet_map })
}

/// The tets of a mesh that are kept, in their order, with the nodes that they use; and the new number of each node, if it is used.
///
/// # Panics
/// If a tet names a node that is not there, or fewer tets are said to be kept, or not, than there are.
pub fn keep_tets(mesh: TetMesh, is_kept: &[bool]) -> (TetMesh, Vec<Option<u32>>) {
    let TetMesh { positions_m, tets, regions } = mesh;
    let kept = |index: &usize| is_kept[*index];
    let mut tets: Vec<[u32; 4]> = (0..tets.len()).filter(kept).map(|index| tets[index]).collect();
    let regions = (0..regions.len()).filter(kept).map(|index| regions[index]).collect();
    let mut is_used = vec![true; positions_m.len()];
    unused_nodes(positions_m.len(), &tets).into_iter().for_each(|node| is_used[node as usize] = false);
    let node_map = renumber(&is_used);
    let used = positions_m.iter().zip(&node_map).filter(|(_, index)| index.is_some());
    let positions_m = used.map(|(position, _)| *position).collect();
    for node in tets.as_flattened_mut() {
        *node = node_map[*node as usize].unwrap_or(*node); // every node of a kept tet is used
    }
    (TetMesh { positions_m, tets, regions }, node_map)
}

fn refuse_broken(mesh: &TetMesh) -> Result<(), RepairError> {
    if mesh.tets.is_empty() {
        return Err(RepairError::NoTets);
    }
    if mesh.regions.len() != mesh.tets.len() {
        return Err(RepairError::Regions { regions: mesh.regions.len(), tets: mesh.tets.len() });
    }
    let nodes = mesh.positions_m.len();
    for (tet, tet_nodes) in mesh.tets.iter().enumerate() {
        if let Some(&node) = tet_nodes.iter().find(|&&node| node as usize >= nodes) {
            return Err(RepairError::OutOfRange { tet: tet as u32, node, nodes });
        }
    }
    let broken = mesh.positions_m.iter().position(|position| position.iter().any(|c| !c.is_finite()));
    broken.map_or(Ok(()), |node| Err(RepairError::NotFinite { node: node as u32 }))
}

/// Gives parts that touch with whole faces their nodes there in common. For each node the one that it is now: itself, or one before it.
fn merge_touching(positions_m: &[[f32; 3]], tets: &mut [[u32; 4]], keep: &[bool], repairs: &mut Vec<Repair>) -> Vec<u32> {
    // What is dropped, now or later, joins nothing, and lies on neither side of a face.
    let is_solid = |tet: [u32; 4]| !is_without_volume(corners(positions_m, tet));
    let kept = tets.iter().zip(keep).filter(|(tet, keep)| **keep && is_solid(**tet));
    let solid: Vec<[u32; 4]> = kept.map(|(tet, _)| *tet).collect();
    let (node_of, faces) = merged(positions_m, &solid);
    let mut moved = node_of.iter().zip(0..).filter(|(now, node)| *now != node).map(|(_, node)| node);
    if let Some(first) = moved.next() {
        repairs.push(Repair::MergedNodes { nodes: 1 + moved.count(), faces, first });
        tets.as_flattened_mut().iter_mut().for_each(|node| *node = node_of[*node as usize]);
    }
    node_of
}

fn drop_overlapping(
    positions_m: &[[f32; 3]],
    tets: &[[u32; 4]],
    keep: &mut [bool],
    repairs: &mut Vec<Repair>,
) -> Result<(), RepairError> {
    let overlapping = overlapping_tets(positions_m, tets, keep);
    let Some(&first) = overlapping.first() else { return Ok(()) };
    if overlapping.len() > FEW_OVERLAPPING.max(tets.len() / OVERLAPPING_OF) {
        return Err(RepairError::Overlapping { tets: overlapping.len(), of: tets.len(), first });
    }
    overlapping.iter().for_each(|&tet| keep[tet as usize] = false);
    repairs.push(Repair::DroppedOverlapping { tets: overlapping.len(), first });
    Ok(())
}

fn drop_flat(positions_m: &[[f32; 3]], tets: &[[u32; 4]], keep: &mut [bool], repairs: &mut Vec<Repair>) {
    let mut dropped: Vec<u32> = Vec::new();
    let mut flat: Vec<(f64, u32)> = Vec::new();
    for (index, &tet) in tets.iter().enumerate() {
        let corners = corners(positions_m, tet);
        if !keep[index] {
            continue;
        }
        if is_without_volume(corners) {
            keep[index] = false;
            dropped.push(index as u32);
        } else if quality(corners) < FLAT_QUALITY {
            flat.push((quality(corners), index as u32));
        }
    }
    if let Some(&first) = dropped.first() {
        repairs.push(Repair::DroppedFlat { tets: dropped.len(), first });
    }
    if let Some(&(worst_quality, worst)) = flat.iter().min_by(|left, right| left.0.total_cmp(&right.0)) {
        repairs.push(Repair::KeptFlat { tets: flat.len(), worst_quality, worst });
    }
}

fn flip_inverted(positions_m: &[[f32; 3]], tets: &mut [[u32; 4]], keep: &[bool]) -> usize {
    let mut flipped = 0;
    for (tet, _) in tets.iter_mut().zip(keep).filter(|(_, keep)| **keep) {
        if signed_volume(corners(positions_m, *tet)) < 0.0 {
            tet.swap(2, 3);
            flipped += 1;
        }
    }
    flipped
}

/// The new number of each that is kept, in their order.
pub fn renumber(keep: &[bool]) -> Vec<Option<u32>> {
    let mut next = 0;
    let number = |&keep: &bool| {
        keep.then(|| {
            next += 1;
            next - 1
        })
    };
    keep.iter().map(number).collect()
}
