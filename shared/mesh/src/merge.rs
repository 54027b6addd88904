//! Parts that touch without common nodes, as the pieces of a `.vtu`, or volumes that Gmsh has meshed one by one: where a boundary face of one lies on one of
//! the other, the nodes there become one, and the two faces one within the tissue. And tets that are there twice, as in a file to which a part was exported
//! again with nodes of its own, or that lie in others.
//!
//! Promise: parts that meet in a point, along an edge, or with faces of another form stay apart, and so do those that lie in each other; faces of one part that
//! lie on each other, as the two sides of a slit, stay two. The same mesh gives the same nodes.

use crate::boundary::{Sets, component_count, components, sorted_faces};
use crate::geometry::{corners, edges, is_without_volume, signed_volume};

/// Nodes whose coordinates are the same in this share of the shortest edge are at one place. Pieces of one file have their common places to the bit, but
/// that some programs write 1e-17 for a zero; and no tet has two nodes at one place, whatever else is in the file.
const SAME_PLACE: f64 = 1e-6;

/// A boundary face: its places in their order, its nodes in the order of these, and where it comes from (4 × tet + face).
type Placed = ([u32; 3], [u32; 3], usize);

/// For each node of a mesh the one that it is, itself or one before it, and at how many faces parts were joined. Each of the tets has a volume.
pub(crate) fn merged(positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> (Vec<u32>, usize) {
    let part_of_tet = components(positions_m.len(), tets);
    let mut sets = Sets::new(positions_m.len());
    let mut joined = 0;
    if component_count(&part_of_tet) > 1 {
        let faces = boundary_faces(tets, &places(positions_m, tets));
        let part = |face: &Placed| part_of_tet[face.2 / 4];
        let is_above = |face: &Placed| is_above(positions_m, tets, face.1, face.2);
        for same in faces.chunk_by(|one, other| one.0 == other.0) {
            // Where there are more, tets lie in each other, and nobody knows which of them belong together.
            let [one, other] = same else { continue };
            if part(one) != part(other) && is_above(one) != is_above(other) {
                joined += 1;
                for (node, on_it) in one.1.iter().zip(other.1) {
                    sets.join(*node, on_it);
                }
            }
        }
    }
    ((0..positions_m.len() as u32).map(|node| sets.root(node)).collect(), joined)
}

/// Tets with their nodes at the places of those of one before them, in any order. Tets that fill nothing are told apart by the nodes that they name, for two
/// that are small enough lie at one place whatever they are.
pub(crate) fn duplicate_tets(positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> Vec<u32> {
    let is_somewhere = |node: &u32| positions_m.get(*node as usize).is_some_and(|place_m| place_m.iter().all(|c| c.is_finite()));
    let is_solid = |tet: &[u32; 4]| tet.iter().all(is_somewhere) && !is_without_volume(corners(positions_m, *tet));
    let solid: Vec<[u32; 4]> = tets.iter().copied().filter(is_solid).collect();
    let place_of = places(positions_m, &solid);
    let key_of = |tet: &[u32; 4]| {
        let is_solid = is_solid(tet);
        let mut key = if is_solid { tet.map(|node| place_of[node as usize]) } else { *tet };
        key.sort_unstable();
        (is_solid, key)
    };
    let mut keys: Vec<((bool, [u32; 4]), u32)> = tets.iter().map(key_of).zip(0..).collect();
    keys.sort_unstable();
    let same_tets = keys.chunk_by(|left, right| left.0 == right.0);
    let mut duplicates: Vec<u32> = same_tets.flat_map(|same| same[1..].iter().map(|(_, tet)| *tet)).collect();
    duplicates.sort_unstable();
    duplicates
}

/// Of some of the tets those that lie in others, in their order: of more than two at a face one on each side of it stays, that with the fewest faces that no
/// other tet has, of several the first. What lies in others by a slip hangs on one face; without the good one there a void would be left around it.
/// What is left has two at a face at most, so that its boundary has no open edge: each tet has two faces at an edge of its own, and so an even number of them is
/// outside.
pub(crate) fn overlapping_tets(positions_m: &[[f32; 3]], tets: &[[u32; 4]], is_some: &[bool]) -> Vec<u32> {
    // What fills nothing is on neither side of a face.
    let is_solid = |(tet, is_some): (&[u32; 4], &bool)| *is_some && !is_without_volume(corners(positions_m, *tet));
    let is_solid: Vec<bool> = tets.iter().zip(is_some).map(is_solid).collect();
    let mut faces = sorted_faces(tets);
    faces.retain(|(_, origin)| is_solid[origin / 4]);
    let mut lone_faces = vec![0_u8; tets.len()];
    let mut crowded = Vec::new();
    for same in faces.chunk_by(|one, other| one.0 == other.0) {
        match same {
            [(_, origin)] => lone_faces[origin / 4] += 1,
            [_, _] => {}
            _ => crowded.push(same),
        }
    }
    // For each of these faces of a tet how many that tet has alone, the tet, the number of the face, and the side.
    let mut sides: Vec<(u8, usize, usize, bool)> = Vec::new();
    for (number, same) in crowded.iter().enumerate() {
        let side = |(nodes, origin): &([u32; 3], usize)| {
            let tet = origin / 4;
            (lone_faces[tet], tet, number, is_above(positions_m, tets, *nodes, *origin))
        };
        sides.extend(same.iter().map(side));
    }
    sides.sort_unstable();
    let mut is_taken = vec![[false; 2]; crowded.len()];
    let mut overlapping = Vec::new();
    for of_tet in sides.chunk_by(|one, other| one.1 == other.1) {
        if of_tet.iter().any(|(.., face, is_above)| is_taken[*face][usize::from(*is_above)]) {
            overlapping.push(of_tet[0].1 as u32);
        } else {
            of_tet.iter().for_each(|(.., face, is_above)| is_taken[*face][usize::from(*is_above)] = true);
        }
    }
    overlapping.sort_unstable();
    overlapping
}

/// The place of each node, by the first node that is there. Each of the tets has a volume; without any all nodes are at one place.
fn places(positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> Vec<u32> {
    let lengths_m = tets.iter().flat_map(|tet| edges(corners(positions_m, *tet))).map(|edge| edge.length());
    let step_m = SAME_PLACE * lengths_m.fold(f64::INFINITY, f64::min);
    // Two zeros are one: adding 0 takes the sign of the other away.
    let in_steps = |coordinate_m: f32| ((f64::from(coordinate_m) / step_m).round() + 0.0).to_bits();
    let mut nodes: Vec<([u64; 3], u32)> = positions_m.iter().map(|position| position.map(in_steps)).zip(0..).collect();
    nodes.sort_unstable();
    let mut place_of = vec![0; nodes.len()];
    for same in nodes.chunk_by(|one, other| one.0 == other.0) {
        same.iter().for_each(|(_, node)| place_of[*node as usize] = same[0].1);
    }
    place_of
}

/// The boundary faces, sorted by their places.
fn boundary_faces(tets: &[[u32; 4]], place_of: &[u32]) -> Vec<Placed> {
    let place = |node: u32| place_of[node as usize];
    let placed = |same: &[([u32; 3], usize)]| {
        let [(nodes, origin)] = same else { return None };
        let mut nodes = *nodes;
        nodes.sort_unstable_by_key(|node| place(*node));
        Some((nodes.map(place), nodes, *origin))
    };
    let mut faces: Vec<Placed> = sorted_faces(tets).chunk_by(|one, other| one.0 == other.0).filter_map(placed).collect();
    faces.sort_unstable();
    faces
}

/// On which side of a face its tet lies, seen by the order of these nodes: whichever way round the tet is.
fn is_above(positions_m: &[[f32; 3]], tets: &[[u32; 4]], [a, b, c]: [u32; 3], origin: usize) -> bool {
    // A face lies opposite to the corner of its number.
    let apex = tets[origin / 4][origin % 4];
    signed_volume(corners(positions_m, [a, b, c, apex])) > 0.0
}
