//! Where a straight way out of the tissue crosses its surface: a walk from tet to tet through the faces between them.
//!
//! The cost is the number of tets on the way; no search structure has to be kept up with the deformation.

use crate::tet::TetTest;
use crate::topology::{FACES, NONE, Topology};
use crate::types::Tissue;
use glam::Vec3;

/// Tets on one way, at most: more than across any organ of 10 k tets; ends a walk that goes round in folded tissue.
const MAX_STEPS: usize = 192;

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
/// `None` if the way ends inside, or is lost in a flat tet. `normal` is the outward normal of a node, of any length.
pub(crate) fn exit_along(
    tissue: &Tissue<'_>,
    topology: &Topology,
    normal: impl FnMut(u32) -> Vec3,
    start: u32,
    (from, to): (Vec3, Vec3),
) -> Option<Exit> {
    let (mut tet, mut entry, mut reached) = (start, NONE, 0f32);
    for _ in 0..MAX_STEPS {
        let test = TetTest::new(&tissue.corners(tet))?;
        let neighbours = topology.neighbours.get(tet as usize)?;
        let (at_from, at_to) = (test.weights_at(from.to_array()), test.weights_at(to.to_array()));
        let mut best: Option<(f32, usize)> = None;
        for face in 0..4 {
            let fall = at_from[face] - at_to[face];
            let came_in = entry != NONE && neighbours[face] == entry;
            let s = at_from[face] / fall;
            if fall > 0.0 && !came_in && best.is_none_or(|(least, _)| s < least) {
                best = Some((s, face));
            }
        }
        let (s, face) = best?;
        reached = reached.max(s);
        if reached.is_nan() || reached > 1.0 {
            return None;
        }
        if neighbours[face] == NONE {
            return crossing(tissue, normal, &test, (tet, face), from.lerp(to, reached));
        }
        (entry, tet) = (tet, neighbours[face]);
    }
    None
}

/// Whether a straight way from a point in a tet along a unit vector leaves the part that the tet belongs to within so many metres; not if it is lost in a flat
/// tet. What lies in or before that part, of the same object or of another one, is not looked at.
pub fn leads_out(tissue: &Tissue<'_>, topology: &Topology, tet: u32, (from_m, along, most_m): ([f32; 3], [f32; 3], f32)) -> bool {
    let (from, along) = (Vec3::from_array(from_m), Vec3::from_array(along));
    exit_along(tissue, topology, |_| Vec3::ZERO, tet, (from, from + most_m * along)).is_some()
}

/// The normal at a crossing.
fn crossing(
    tissue: &Tissue<'_>,
    mut normal: impl FnMut(u32) -> Vec3,
    test: &TetTest,
    (tet, face): (u32, usize),
    point_m: Vec3,
) -> Option<Exit> {
    let flat = (-Vec3::from_array(test.gradient(face))).try_normalize()?;
    let weights = test.weights_at(point_m.to_array());
    let nodes = tissue.tets.get(tet as usize)?;
    let mut of_node = |c: usize| normal(nodes[c]).normalize_or_zero();
    let smooth: Vec3 = FACES[face].iter().map(|&c| of_node(c) * weights[c].clamp(0.0, 1.0)).sum();
    let smooth = smooth.normalize_or_zero();
    /// Cosine below which the nodes' normals say nothing about this face.
    const FOLDED: f32 = 0.2;
    let normal = if smooth.dot(flat) > FOLDED { smooth } else { flat };
    point_m.is_finite().then_some(Exit { point_m, normal, face: (tet, face) })
}
