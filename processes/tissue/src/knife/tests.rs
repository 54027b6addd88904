//! Promises of the knife: the surface is cut with the volume, and what hangs together is one object after each sweep, whatever it was, which is registered.

mod distorted;
mod late;

use super::*;
use crate::site::SiteManager;
use crate::world::Workshop;
use hyst_mesh::component_of_each_tet;
use hyst_messages::stream::ObjectKind;
use hyst_scene::LoadedScene;
use hyst_tissue::{Attachment, Isa, Skin};
use std::collections::BTreeSet;
use std::path::Path;

/// How long the wire is, and how far it goes: so far that it cuts, m.
const WIRE_M: f32 = 0.2e-3;
const WAY_M: f32 = 0.6e-3;
/// All edges of the tets are farther than this from the middle of what it sweeps, which reaches 0.32 mm from there, m.
const CLEAR_M: f32 = 0.5e-3;

/// How far a point is from the piece of a line between two others, m.
fn away_m(point: Vec3, [from, to]: [Vec3; 2]) -> f32 {
    let along = to - from;
    let share = ((point - from).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    point.distance(from + share * along)
}

/// A triangle of the surface, its first two corners the ends of an edge whose middle is far from all edges of the tets.
fn bare_edge(world: &World) -> Option<[[f32; 3]; 3]> {
    const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    let (rest, skin) = (&world.body.rest, &world.body.skin);
    let at = |node: u32| Vec3::from(rest.positions_m[node as usize]);
    let edges = |tet: &[u32; 4]| EDGES.map(|[a, b]| [at(tet[a]), at(tet[b])]);
    let is_bare = |[from, to, _]: &[[f32; 3]; 3]| {
        let middle = Vec3::from(*from).midpoint(Vec3::from(*to));
        Vec3::from(*from).distance(middle) > CLEAR_M
            && rest.tets.iter().flat_map(edges).all(|edge| away_m(middle, edge) > CLEAR_M)
    };
    let corners = skin.triangles.iter().map(|triangle| triangle.map(|vertex| skin.rest_m[vertex as usize]));
    corners.flat_map(|[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]]).find(is_bare)
}

/// Whether an edge of a surface has these ends.
fn has_edge(skin: &Skin, ends: &[[f32; 3]]) -> bool {
    let has = |triangle: &[u32; 3], end: &[f32; 3]| triangle.iter().any(|vertex| skin.rest_m[*vertex as usize] == *end);
    skin.triangles.iter().any(|triangle| ends.iter().all(|end| has(triangle, end)))
}

#[test]
fn a_wire_that_meets_the_surface_and_no_edge_of_a_tet_leaves_it_divided() {
    let scene = hyst_scene::load_embedded().unwrap();
    let (mut workshop, world) = Workshop::open(&scene, Isa::detect()).unwrap();
    let corners = bare_edge(&world).expect("the surface has an edge that is far from those of the tets");
    let [a, b, c] = corners.map(Vec3::from);
    // The wire stands upright on the surface and goes across the edge's middle.
    let upright = (b - a).cross(c - a).normalize();
    let across = (b - a).normalize().cross(upright);
    let wire_at = |share: f32| {
        let middle = a.midpoint(b) + share * WAY_M * across;
        [-0.5, 0.5].map(|end: f32| (middle + end * WIRE_M * upright).to_array())
    };
    let (positions_m, velocities_m_s) = (world.model.rest_m(), vec![[0.0; 3]; world.model.node_count()]);
    let nodes = (positions_m, &velocities_m_s[..]);
    let (mut knife, mut stroke) = (Knife::default(), Vec::<u32>::new());
    let begun = knife.sweep(&world, Some(&wire_at(-0.5)[..]), &[], nodes).unwrap();
    assert!(matches!(begun, Stroke::GoesOn { .. }), "{begun:?}");
    stroke.resize(knife.stroke_bytes() / size_of::<u32>(), 0);
    knife.write_stroke(bytemuck::cast_slice_mut(&mut stroke));
    let (body, parted) = match knife.sweep(&world, Some(&wire_at(0.5)[..]), bytemuck::cast_slice(&stroke), nodes).unwrap() {
        Stroke::Cut { body, parted, .. } => (body, parted),
        other => panic!("the surface is what it was: {other:?}"),
    };
    assert!(body.rest == world.body.rest && parted.is_empty(), "no tet is cut: {parted:?}");
    assert!(has_edge(&world.body.skin, &corners[..2]) && !has_edge(&body.skin, &corners[..2]), "the edge is not divided");
    let next = workshop.make(*body).unwrap();
    assert!(next.version != world.version && next.model.tets() == world.model.tets(), "another surface of the same tissue");
    assert_eq!((removed_m3(&world, &next), healthy_removed_m3(&world, &next)), (0.0, 0.0));
}

/// What a knife writes of its stroke into a state.
fn stroke_of(knife: &Knife) -> Vec<u32> {
    let mut stroke = vec![0; knife.stroke_bytes() / size_of::<u32>()];
    knife.write_stroke(bytemuck::cast_slice_mut(&mut stroke));
    stroke
}

/// The device believes a tip that has jumped where it stays, and the current may be on all the while.
#[test]
fn a_wire_that_jumps_cuts_nothing_on_its_way_and_begins_another_stroke_where_it_is() {
    let scene = hyst_scene::load_embedded().unwrap();
    let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
    let polyp = hyst_mesh::check(&scene.objects[1].mesh);
    let (low, high) = (polyp.min_m, polyp.max_m);
    let (x, margin_m) = (0.5 * (low[0] + high[0]), 0.5 * (high[1] - low[1]));
    let velocities_m_s = vec![[0.0; 3]; world.model.node_count()];
    let nodes = (world.model.rest_m(), &velocities_m_s[..]);
    // The wire goes through the middle of the polyp, from a little below it.
    let swept = |stroke: &[u32], gone_m: f32| {
        let z = low[2] - 1e-3 + gone_m;
        let wire_m = [low[1] - margin_m, 0.5 * (low[1] + high[1]), high[1] + margin_m].map(|y| [x, y, z]);
        let mut knife = Knife::default();
        let swept = knife.sweep(&world, Some(&wire_m[..]), bytemuck::cast_slice(stroke), nodes).unwrap();
        (swept, stroke_of(&knife))
    };
    let (_, begun) = swept(&[], 0.0);
    let (near, _) = swept(&begun, 0.9 * FARTHEST_M as f32);
    assert!(matches!(near, Stroke::Cut { .. }), "a swift hand cuts: {near:?}");
    let jump_m = 1.1 * FARTHEST_M as f32;
    let (jumped, goes_on_from) = swept(&begun, jump_m);
    assert!(matches!(jumped, Stroke::GoesOn { is_limited: false }), "it has cut across its jump: {jumped:?}");
    assert!(goes_on_from == swept(&[], jump_m).1, "it is not the stroke that begins there");
    let (goes_on, _) = swept(&goes_on_from, jump_m + WAY_M);
    assert!(!matches!(goes_on, Stroke::None), "{goes_on:?}");
}

/// How often each scene is cut, and by how many strokes each time.
const ROUNDS: u64 = 3;
const STROKES: u32 = 3;
/// From one sweep to the next, m.
const SWEEP_M: f32 = 0.8e-3;

/// Numbers from −1 to 1 that depend on the seed alone (Knuth's linear congruential generator for 64 bits).
fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
}

/// A direction; the last one if the numbers are none.
fn direction(random: &mut impl FnMut() -> f32) -> Vec3 {
    Vec3::new(random(), random(), random()).normalize_or(Vec3::X)
}

/// Places of a straight wire that goes through all of the pathologies and their pieces, somewhere near the middle and whichever way, and through what of the
/// wall is in its way.
fn through(world: &World, random: &mut impl FnMut() -> f32) -> Vec<[[f32; 3]; 3]> {
    let rest = &world.body.rest;
    let of_pathology = rest.tets.iter().zip(&rest.regions).filter(|(_, object)| world.case.is_pathology(&world.body, **object));
    let nodes = of_pathology.flat_map(|(tet, _)| tet.map(|node| Vec3::from(rest.positions_m[node as usize])));
    let (low, high) = nodes.fold((Vec3::MAX, Vec3::MIN), |(low, high), place| (low.min(place), high.max(place)));
    let (middle, reach_m) = (low.midpoint(high), (high - low).length());
    let (wire, way) = (direction(random), direction(random));
    let across = way.reject_from_normalized(wire).normalize_or(wire.any_orthonormal_vector());
    let centre = middle + 0.15 * reach_m * direction(random);
    let steps = (1.6 * reach_m / SWEEP_M) as u32;
    let at = |step: u32| centre + (step as f32 * SWEEP_M - 0.8 * reach_m) * across;
    (0..=steps).map(|step| [-0.8, 0.0, 0.8].map(|end: f32| (at(step) + end * reach_m * wire).to_array())).collect()
}

/// Draws a wire, and looks at the world that each sweep leaves; gives the last one, and how many there were.
pub(crate) fn drawn(
    workshop: &mut Workshop,
    mut world: World,
    wires: &[[[f32; 3]; 3]],
    looks: impl Fn(&World),
) -> (World, usize) {
    let (mut knife, mut stroke, mut sweeps) = (Knife::default(), Vec::<u32>::new(), 0);
    let (mut positions_m, mut velocities_m_s) = (world.model.rest_m().to_vec(), vec![[0.0; 3]; world.model.node_count()]);
    for wire_m in wires {
        let nodes = (&positions_m[..], &velocities_m_s[..]);
        let swept = knife.sweep(&world, Some(&wire_m[..]), bytemuck::cast_slice(&stroke), nodes).unwrap();
        if let Stroke::Cut { body, held, .. } = swept {
            assert_eq!(held, world.case.held(&body), "it is handed over with what holds it");
            match workshop.make(*body) {
                Ok(next) => {
                    (world, sweeps) = (next, sweeps + 1);
                    let (moved_m, moved_m_s) = knife.moved();
                    (positions_m, velocities_m_s) = (moved_m.to_vec(), moved_m_s.to_vec());
                    looks(&world);
                }
                Err(_) => knife.end(),
            }
        }
        stroke.resize(knife.stroke_bytes() / size_of::<u32>(), 0);
        knife.write_stroke(bytemuck::cast_slice_mut(&mut stroke));
    }
    (world, sweeps)
}

/// Each part that hangs together is one object, each object is one part, and these are what is registered; free are those that nothing holds.
fn assert_registered(world: &World, what: &str) {
    let rest = &world.body.rest;
    let part = component_of_each_tet(rest);
    let pairs: BTreeSet<(u32, u32)> = part.iter().copied().zip(rest.regions.iter().copied()).collect();
    let parts = pairs.iter().map(|(part, _)| *part).collect::<BTreeSet<u32>>().len();
    let objects: BTreeSet<u32> = pairs.iter().map(|(_, object)| *object).collect();
    assert_eq!((parts, objects.len()), (pairs.len(), pairs.len()), "{what}: parts and objects, of as many pairs");
    let tissue = world.objects.iter().filter(|object| object.tets[1] > 0);
    assert_eq!(tissue.map(|object| object.id).collect::<BTreeSet<u32>>(), objects, "{what}: registered are others");
    let mut site = SiteManager::default();
    site.register_objects(&world.objects);
    let tools = world.objects.iter().filter(|object| object.kind == ObjectKind::Tool as u32).count();
    assert_eq!(site.present() as usize, objects.len() + tools, "{what}: present, with {tools} instruments");
    let (is_held, owner) = (world.case.held_nodes(&world.body), world.body.owners());
    let held = rest.tets.iter().zip(&rest.regions).filter(|(tet, _)| tet.iter().any(|node| is_held[*node as usize]));
    let mut held: BTreeSet<u32> = held.map(|(_, object)| *object).collect();
    // What is tied to what is held is held, too, and what is tied to that: there are no more of them than objects.
    for _ in &objects {
        let is_host_held = |tie: &&Attachment| owner[tie.tet[0] as usize].is_some_and(|host| held.contains(&host));
        let tied: Vec<u32> = world.attachments.iter().filter(is_host_held).filter_map(|tie| owner[tie.node as usize]).collect();
        held.extend(tied);
    }
    for object in world.objects.iter().filter(|object| object.tets[1] > 0) {
        assert_eq!(object.is_free_piece(), !held.contains(&object.id), "{what}: object {}", object.id);
    }
    assert_counted(world, what);
    let held_m3 = [false, true].map(|of_pathology| {
        let is_held = |object: u32| !world.objects[object as usize].is_free_piece();
        let is_of_it = |object: u32| world.case.is_pathology(&world.body, object) == of_pathology;
        world.body.volume_where_m3(|object| is_held(object) && is_of_it(object))
    });
    assert_eq!((world.filled.held_m3, world.filled.is_everywhere), (held_m3, true), "{what}: what is held");
    let free = world.objects.iter().filter(|object| object.is_free_piece() && object.tets[1] > 0);
    let free: Vec<(u32, f64)> = free.map(|object| (object.id, world.body.volume_of_m3(object.id))).collect();
    let drifters: Vec<(u32, f64)> = world.drifters.iter().map(|drifter| (drifter.object(), drifter.volume_m3())).collect();
    assert_eq!(drifters, free, "{what}: what drifts");
    for drifter in &world.drifters {
        let nodes: Vec<[f32; 3]> = drifter.places(&rest.positions_m).copied().collect();
        let owners = rest.positions_m.iter().zip(world.body.owners());
        let own: Vec<[f32; 3]> = owners.filter(|(_, owner)| *owner == Some(drifter.object())).map(|(place, _)| *place).collect();
        assert_eq!(nodes, own, "{what}: nodes of object {}", drifter.object());
    }
}

/// Each object's place in the common arrays is that of its first node, tet, vertex and triangle, and of as many as it has.
fn assert_counted(world: &World, what: &str) {
    let (rest, skin) = (&world.body.rest, &world.body.skin);
    let of_vertex = |vertex: u32| Some(rest.regions[skin.bindings[vertex as usize].tet as usize]);
    let objects_of: [Vec<Option<u32>>; 4] = [
        world.body.owners(),
        rest.regions.iter().copied().map(Some).collect(),
        (0..skin.rest_m.len() as u32).map(of_vertex).collect(),
        skin.triangles.iter().map(|triangle| of_vertex(triangle[0])).collect(),
    ];
    for object in world.objects.iter().filter(|object| object.tets[1] > 0) {
        let found = objects_of.each_ref().map(|objects_of| {
            let of_it = || (0u32..).zip(objects_of).filter(|(_, of)| **of == Some(object.id)).map(|(place, _)| place);
            [of_it().next().unwrap_or(0), of_it().count() as u32]
        });
        assert_eq!([object.nodes, object.tets, object.vertices, object.triangles], found, "{what}: object {}", object.id);
    }
}

/// The scene of a file beside the default one.
fn shipped(name: &str) -> LoadedScene {
    hyst_scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes").join(name)).unwrap()
}

#[test]
fn what_hangs_together_is_one_registered_object_after_each_of_many_sweeps() {
    for name in ["default.toml", "myoma.toml", "septum.toml", "regions.toml"] {
        let scene = shipped(name);
        let (mut all, mut more) = (0, 0);
        let objects = |world: &World| world.objects.iter().filter(|object| object.tets[1] > 0).count();
        for round in 0..ROUNDS {
            let (mut workshop, mut world) = Workshop::open(&scene, Isa::detect()).unwrap();
            assert_registered(&world, name);
            let (before, mut random) = (objects(&world), noise(round + 1));
            for stroke in 0..STROKES {
                let wires = through(&world, &mut random);
                let what = format!("{name}, round {round}, stroke {stroke}");
                let (next, sweeps) = drawn(&mut workshop, world, &wires, |world| assert_registered(world, &what));
                (world, all) = (next, all + sweeps);
            }
            more += objects(&world) - before;
        }
        println!("{name}: {all} sweeps cut, {more} objects more in {ROUNDS} rounds");
        assert!(all > 50 && more > 1, "{name}: {all} sweeps, {more} objects: next to nothing was tried");
    }
}
