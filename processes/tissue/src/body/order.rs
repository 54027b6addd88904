//! The surface of a body in the order of its objects.

use super::Body;
use hyst_tissue::Skin;
use std::ops::Range;

/// The object of a triangle between two of them: more than a body has.
const NONE: u32 = u32::MAX;

impl Body {
    /// Puts the surface into the order of the objects.
    pub(super) fn sort_skin(&mut self) {
        self.skin = in_order(std::mem::take(&mut self.skin), &self.rest.regions);
    }
}

/// A surface with its vertices and triangles in the order of the objects, those of an object in the order that they have. A triangle between two objects is left
/// out. `regions`: the object of each tet.
pub fn in_order(skin: Skin, regions: &[u32]) -> Skin {
    let object_of: Vec<u32> = skin.bindings.iter().map(|binding| regions[binding.tet as usize]).collect();
    // Most cuts leave it as it was: what they add lies behind, and the object that is cut is the last one.
    if is_sorted(&skin.triangles, &object_of) { skin } else { sorted(&skin, &object_of) }
}

/// Whether all is in its place, and no triangle between two objects.
fn is_sorted(triangles: &[[u32; 3]], object_of: &[u32]) -> bool {
    let mut last = 0;
    let follows = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| object_of[vertex as usize]);
        let before = std::mem::replace(&mut last, a);
        before <= a && a == b && a == c
    };
    object_of.is_sorted() && triangles.iter().all(follows)
}

/// A surface whose vertices are of these objects, in their order. A cut leaves most of it in a few runs of one object each, which are copied as they are.
fn sorted(skin: &Skin, object_of: &[u32]) -> Skin {
    let vertices = runs(object_of);
    let mut number = vec![0u32; object_of.len()];
    for (new, old) in (0..).zip(vertices.iter().flat_map(|(_, run)| run.clone())) {
        number[old] = new;
    }
    let object = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| object_of[vertex as usize]);
        if a == b && a == c { a } else { NONE }
    };
    let triangles = runs(&skin.triangles.iter().map(object).collect::<Vec<u32>>());
    let mut sorted = Skin {
        rest_m: Vec::with_capacity(skin.rest_m.len()),
        triangles: Vec::with_capacity(skin.triangles.len()),
        bindings: Vec::with_capacity(skin.bindings.len()),
        raw: Vec::with_capacity(skin.raw.len()),
    };
    for (_, run) in vertices {
        sorted.rest_m.extend_from_slice(&skin.rest_m[run.clone()]);
        sorted.bindings.extend_from_slice(&skin.bindings[run.clone()]);
        sorted.raw.extend_from_slice(&skin.raw[run]);
    }
    for (_, run) in triangles.into_iter().filter(|(object, _)| *object != NONE) {
        sorted.triangles.extend(skin.triangles[run].iter().map(|triangle| triangle.map(|vertex| number[vertex as usize])));
    }
    sorted
}

/// The runs of things of one object, by the object of each: in the order of the objects, those of an object in the order that they have.
fn runs(object_of: &[u32]) -> Vec<(u32, Range<usize>)> {
    let mut end = 0;
    let run = |of_one: &[u32]| {
        let start = end;
        end += of_one.len();
        (object_of[start], start..end)
    };
    let mut runs: Vec<(u32, Range<usize>)> = object_of.chunk_by(|one, other| one == other).map(run).collect();
    runs.sort_by_key(|(object, _)| *object);
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_mesh::{Binding, TetMesh};

    /// The same by sorts.
    fn by_sorts(body: &Body) -> Skin {
        let skin = &body.skin;
        let object = |vertex: &u32| body.rest.regions[skin.bindings[*vertex as usize].tet as usize];
        let mut order: Vec<u32> = (0..skin.rest_m.len() as u32).collect();
        order.sort_by_key(object);
        let number = |old: u32| order.iter().position(|vertex| *vertex == old).unwrap() as u32;
        let is_of_one = |triangle: &&[u32; 3]| triangle.iter().all(|vertex| object(vertex) == object(&triangle[0]));
        let mut triangles: Vec<[u32; 3]> = skin.triangles.iter().filter(is_of_one).copied().collect();
        triangles.sort_by_key(|triangle| object(&triangle[0]));
        Skin {
            rest_m: order.iter().map(|old| skin.rest_m[*old as usize]).collect(),
            triangles: triangles.into_iter().map(|triangle| triangle.map(number)).collect(),
            bindings: order.iter().map(|old| skin.bindings[*old as usize]).collect(),
            raw: order.iter().map(|old| skin.raw[*old as usize]).collect(),
        }
    }

    /// A body of so many objects whose vertices and triangles are each anybody's.
    fn mixed(objects: u32, seed: u64) -> Body {
        const TETS: u32 = 12;
        const VERTICES: u32 = 40;
        let mut state = seed;
        // Knuth's linear congruential generator for 64 bits.
        let mut below = move |most: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as u32 % most
        };
        let regions = (0..TETS).map(|_| below(objects)).collect();
        let bindings = (0..VERTICES).map(|vertex| Binding { tet: below(TETS), weights: [vertex as f32; 4] }).collect();
        let triangle = |index: u32| {
            let vertices = [0; 3].map(|_| below(VERTICES));
            if index.is_multiple_of(2) { [vertices[0]; 3] } else { vertices }
        };
        let skin = Skin {
            bindings,
            triangles: (0..2 * VERTICES).map(triangle).collect(),
            rest_m: (0..VERTICES).map(|vertex| [vertex as f32; 3]).collect(),
            raw: (0..VERTICES).map(|vertex| vertex.is_multiple_of(3)).collect(),
        };
        Body { rest: TetMesh { regions, ..TetMesh::default() }, skin, origin: (0..objects).collect(), ..Body::default() }
    }

    #[test]
    fn a_surface_in_whatever_order_comes_into_that_of_the_objects_and_stays_in_it() {
        for (objects, seed) in (1..=5).flat_map(|objects| (0..20).map(move |seed| (objects, seed))) {
            let mut body = mixed(objects, seed);
            let sorted = by_sorts(&body);
            assert_eq!(objects > 1, sorted != body.skin, "{objects} objects, seed {seed}");
            for _ in 0..2 {
                body.sort_skin();
                assert_eq!(body.skin, sorted, "{objects} objects, seed {seed}");
            }
        }
    }
}
