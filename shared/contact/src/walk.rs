//! Where a straight way out of the tissue crosses its surface: a walk from tet to tet through the faces between them.
//!
//! The cost is the number of tets on the way; no search structure has to be kept up with the deformation.

use crate::flat::Flat;
use crate::tet::TetTest;
use crate::topology::{FACES, NONE, Topology};
use crate::types::Tissue;
use glam::Vec3;

/// Tets one after the other in which a way gets no farther, at most: more than meet at an edge. A walk that goes round in folded tissue gets no farther from its
/// second turn on.
const MOST_STILL: usize = 32;

/// A crossing of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exit {
    /// Where, metres.
    pub point_m: Vec3,
    /// Outward unit normal: that of the nodes, interpolated, unless the surface is folded there; then the face's.
    pub normal: Vec3,
    /// Boundary tet and its face (opposite to the corner of that number).
    pub face: (u32, usize),
}

/// Walks from `from`, inside tet `start`, towards `to`, and gives the first crossing of the surface on the way.
///
/// `None` if the way ends inside, begins in a flat tet, or goes round. `normal` is the outward normal of a node, of any length.
pub(crate) fn exit_along(
    tissue: &Tissue<'_>,
    topology: &Topology,
    normal: impl FnMut(u32) -> Vec3,
    start: u32,
    (from, to): (Vec3, Vec3),
) -> Option<Exit> {
    let (mut tet, mut entry, mut reached) = (start, NONE, 0f32);
    let (mut farthest, mut still) = (0f32, 0);
    while still < MOST_STILL {
        let (corners, neighbours) = (tissue.corners(tet), topology.neighbours.get(tet as usize)?);
        let came_in = |face: usize| entry != NONE && neighbours[face] == entry;
        let Some(test) = TetTest::new(&corners) else {
            let flat = Flat { corners: &corners, at: from.lerp(to, reached), way: to - from };
            let face = flat.way_out(came_in).filter(|_| entry != NONE)?;
            if flat.covers(face) {
                reached = reached.max(reached + flat.beyond(face));
            }
            if reached > 1.0 {
                return None;
            }
            if neighbours[face] == NONE {
                let on_face = (flat.outward(face), flat.weights(face));
                return crossing(tissue, normal, on_face, (tet, face), from.lerp(to, reached));
            }
            (entry, tet, still) = (tet, neighbours[face], still + 1);
            continue;
        };
        let (at_from, at_to) = (test.weights_at(from.to_array()), test.weights_at(to.to_array()));
        let mut best: Option<(f32, usize)> = None;
        for face in 0..4 {
            let fall = at_from[face] - at_to[face];
            let s = at_from[face] / fall;
            if fall > 0.0 && !came_in(face) && best.is_none_or(|(least, _)| s < least) {
                best = Some((s, face));
            }
        }
        let (s, face) = best?;
        reached = reached.max(s);
        if reached.is_nan() || reached > 1.0 {
            return None;
        }
        if neighbours[face] == NONE {
            let point_m = from.lerp(to, reached);
            let on_face = (-Vec3::from_array(test.gradient(face)), test.weights_at(point_m.to_array()));
            return crossing(tissue, normal, on_face, (tet, face), point_m);
        }
        (entry, tet) = (tet, neighbours[face]);
        (farthest, still) = if reached > farthest { (reached, 0) } else { (farthest, still + 1) };
    }
    None
}

/// Whether a straight way from a point in a tet along a unit vector leaves the part that the tet belongs to within so many metres; not if the tet is flat. What
/// lies in or before that part, of the same object or of another one, is not looked at.
pub fn leads_out(tissue: &Tissue<'_>, topology: &Topology, tet: u32, (from_m, along, most_m): ([f32; 3], [f32; 3], f32)) -> bool {
    let (from, along) = (Vec3::from_array(from_m), Vec3::from_array(along));
    exit_along(tissue, topology, |_| Vec3::ZERO, tet, (from, from + most_m * along)).is_some()
}

/// The normal at a crossing, where the tet's corners have these weights and its face this normal, outward and of any length.
fn crossing(
    tissue: &Tissue<'_>,
    mut normal: impl FnMut(u32) -> Vec3,
    (outward, weights): (Vec3, [f32; 4]),
    (tet, face): (u32, usize),
    point_m: Vec3,
) -> Option<Exit> {
    let flat = outward.try_normalize()?;
    let nodes = tissue.tets.get(tet as usize)?;
    let mut of_node = |c: usize| normal(nodes[c]).normalize_or_zero();
    let smooth: Vec3 = FACES[face].iter().map(|&c| of_node(c) * weights[c].clamp(0.0, 1.0)).sum();
    let smooth = smooth.normalize_or_zero();
    /// Cosine below which the nodes' normals say nothing about this face.
    const FOLDED: f32 = 0.2;
    let normal = if smooth.dot(flat) > FOLDED { smooth } else { flat };
    point_m.is_finite().then_some(Exit { point_m, normal, face: (tet, face) })
}
