//! The outside of the hollow organs, which the medium in the cavity does not reach.
//!
//! Promise: a triangle is of it where the scene's mesh had it, with corners in the same places, whichever lip of a cut has them. What a cut has laid open, divided
//! or moved is none of it: a wound is wetted by the medium.

use super::lookup::Lookup;
use crate::body::Body;
use hyst_scene::{DeformableKind, LoadedScene};

/// No corner.
const NONE: u32 = u32::MAX;

/// The triangles of the outside. Those with a fixed node, on which nothing presses anyway, are left out.
pub(super) struct Outside {
    /// Where each node of the scene lies at rest, m, and the number of the corner that it is, or none.
    nodes: Vec<([f32; 3], u32)>,
    /// Where the corners lie, as bits, and a 0.
    places: Lookup,
    /// The numbers of their corners, in ascending order, and a 0.
    triangles: Lookup,
}

impl Outside {
    /// That of a scene, whose objects are joined in a body; the nodes of each begin at its `starts`. What grows in the cavity is wetted on all sides.
    pub(super) fn of(scene: &LoadedScene, body: &Body, starts: &[usize]) -> Outside {
        let mut nodes: Vec<([f32; 3], u32)> = body.rest.positions_m.iter().map(|place_m| (*place_m, NONE)).collect();
        let mut outer = Vec::new();
        let organs = scene.objects.iter().zip(starts).filter(|(object, _)| object.kind == DeformableKind::Organ);
        for (organ, start) in organs {
            outer.extend(organ.outside().into_iter().map(|triangle| triangle.map(|node| node + *start as u32)));
        }
        let corners = outer.iter().flatten().map(|node| place(nodes[*node as usize].0));
        let places = Lookup::of(corners.collect());
        for node in outer.iter().flatten() {
            let (place_m, corner) = &mut nodes[*node as usize];
            *corner = corner_at(&places, *place_m);
        }
        let triangles = Lookup::of(outer.iter().map(|triangle| key(triangle.map(|node| nodes[node as usize].1))).collect());
        Outside { nodes, places, triangles }
    }

    /// Whether a triangle of a body's boundary is of it.
    pub(super) fn has(&self, body: &Body, triangle: [u32; 3]) -> bool {
        let corners = triangle.map(|node| self.corner(body, node));
        corners.iter().all(|corner| *corner != NONE) && self.triangles.number(key(corners)).is_some()
    }

    /// The corner at which a node lies, or none.
    fn corner(&self, body: &Body, node: u32) -> u32 {
        let Some(at_m) = body.rest.positions_m.get(node as usize) else { return NONE };
        match self.nodes.get(node as usize) {
            // Most are where they were, and need not be looked for.
            Some((place_m, corner)) if place_m == at_m => *corner,
            // A copy lies where its original does.
            _ => corner_at(&self.places, *at_m),
        }
    }
}

/// The corner that lies at a place, or none.
fn corner_at(places: &Lookup, place_m: [f32; 3]) -> u32 {
    places.number(place(place_m)).map_or(NONE, |number| number as u32)
}

/// What a place is looked up by.
fn place([x, y, z]: [f32; 3]) -> [u32; 4] {
    [x.to_bits(), y.to_bits(), z.to_bits(), 0]
}

/// What a triangle is looked up by, whichever of its corners comes first.
fn key(mut corners: [u32; 3]) -> [u32; 4] {
    corners.sort_unstable();
    let [a, b, c] = corners;
    [a, b, c, 0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{Workshop, load_scene};
    use hyst_tissue::Isa;

    /// Of two lips of a cut one has the nodes of the scene and the other copies of them.
    #[test]
    fn a_triangle_of_the_outside_is_one_with_copies_of_its_nodes_too_and_none_with_a_node_elsewhere() {
        let scene = load_scene(None).unwrap();
        let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        let mut body = world.body;
        let counts = scene.objects.iter().map(|object| object.mesh.positions_m.len());
        let starts: Vec<usize> = counts.scan(0, |next, count| Some(std::mem::replace(next, *next + count))).collect();
        let outside = Outside::of(&scene, &body, &starts);
        let triangles = scene.objects[0].outside();
        let [a, b, c] = *triangles.first().expect("the default organ is not held all around");
        let copy = body.rest.positions_m.len() as u32;
        body.rest.positions_m.push(body.rest.positions_m[a as usize]);
        assert!(outside.has(&body, [a, b, c]) && outside.has(&body, [c, copy, b]));
        body.rest.positions_m[copy as usize][0] += 1e-6;
        assert!(!outside.has(&body, [copy, b, c]) && !outside.has(&body, [copy + 1, b, c]));
    }
}
