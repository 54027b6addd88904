//! The outside of the hollow organs, which the medium in the cavity does not reach.
//!
//! Promise: a triangle is of it where the scene's mesh had it, with the same nodes in the same places. What a cut has laid open, divided or moved is none of it:
//! a wound is wetted by the medium.

use super::lookup::Lookup;
use crate::body::Body;
use hyst_scene::{DeformableKind, LoadedScene};

/// The triangles of the outside. Those with a fixed node, on which nothing presses anyway, are left out.
pub(super) struct Outside {
    /// Where each node of the scene that is a corner of one lies at rest, m; `None` for all others.
    corners_m: Vec<Option<[f32; 3]>>,
    /// Their nodes, in ascending order, and a 0.
    triangles: Lookup,
}

impl Outside {
    /// That of a scene, whose objects are joined in a body; the nodes of each begin at its `starts`. What grows in the cavity is wetted on all sides.
    pub(super) fn of(scene: &LoadedScene, body: &Body, starts: &[usize]) -> Outside {
        let mut corners_m = vec![None; body.rest.positions_m.len()];
        let mut triangles = Vec::new();
        let organs = scene.objects.iter().zip(starts).filter(|(object, _)| object.kind == DeformableKind::Organ);
        for (organ, start) in organs {
            for triangle in organ.outside() {
                let nodes = triangle.map(|node| node + *start as u32);
                nodes.iter().for_each(|node| corners_m[*node as usize] = Some(body.rest.positions_m[*node as usize]));
                triangles.push(key(nodes));
            }
        }
        Outside { corners_m, triangles: Lookup::of(triangles) }
    }

    /// Whether a triangle of a body's boundary is of it.
    pub(super) fn has(&self, body: &Body, triangle: [u32; 3]) -> bool {
        // Few others have such corners alone, and a look at these is far cheaper than one into the table.
        let is_corner = |node: &u32| {
            let corner_m = self.corners_m.get(*node as usize).and_then(Option::as_ref);
            corner_m.is_some() && corner_m == body.rest.positions_m.get(*node as usize)
        };
        triangle.iter().all(is_corner) && self.triangles.number(key(triangle)).is_some()
    }
}

/// What a triangle is looked up by, whichever of its corners comes first.
fn key(mut nodes: [u32; 3]) -> [u32; 4] {
    nodes.sort_unstable();
    let [a, b, c] = nodes;
    [a, b, c, 0]
}
