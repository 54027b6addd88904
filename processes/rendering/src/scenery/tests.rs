//! Promises of the scenery: what makes no sense changes nothing, and a number means what it means in the topology that is shown.
#[path = "../../tests/support/vulkan.rs"]
mod vulkan;

use super::*;
use hyst_messages::stream::message_bytes;
use hyst_messages::{MessageMut, StreamHeader};
use rendering::{Camera, External, Gpu, Prefer, Renderer, View};

/// How far what [`topology`] has is from the eye of [`picture`], m.
const FAR_M: f32 = 0.03;

fn record(id: u32, kind: u32, vertices: [u32; 2], triangles: [u32; 2]) -> ObjectRecord {
    ObjectRecord { id, kind, vertices, triangles, ..ObjectRecord::default() }
}

#[test]
fn each_objects_triangles_are_numbered_from_its_own_first_vertex_and_tools_have_none() {
    let records = [record(0, 0, [0, 4], [0, 1]), record(1, 1, [4, 3], [1, 1]), record(2, RIGID_TOOL, [7, 0], [2, 0])];
    let parts = parts(&records, &[[0, 2, 3], [4, 6, 5]], 7).unwrap();
    assert_eq!(parts.len(), 2);
    assert_eq!((parts[1].id, parts[1].kind, parts[1].vertices.clone()), (1, 1, 4..7));
    assert_eq!((&parts[0].triangles[..], &parts[1].triangles[..]), (&[[0, 2, 3]][..], &[[0, 2, 1]][..]));
}

/// Each cut anywhere had every object made anew, the whole organ with them.
#[test]
fn what_a_cut_elsewhere_has_left_as_it_was_is_known_again_and_another_corner_place_or_wound_is_not() {
    let (triangles, raw): ([[u32; 3]; 2], [u32; 4]) = ([[0, 1, 2], [0, 2, 3]], [0; 4]);
    let rest_m: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let print = print_of(&triangles, &rest_m, &raw);
    assert_eq!(print, print_of(&[[0, 1, 2], [0, 2, 3]], &rest_m, &[0; 4]));
    let (mut turned, mut moved_m) = (triangles, rest_m);
    turned[1] = [0, 3, 2];
    moved_m[3][2] = 1.001;
    assert_ne!(print, print_of(&turned, &rest_m, &raw));
    assert_ne!(print, print_of(&triangles, &moved_m, &raw));
    assert_ne!(print, print_of(&triangles, &rest_m, &[0, 0, 1, 0]));
    assert_ne!(print_of(&[[0; 3]], &[], &[]), print_of(&[], &[[0.0; 3]], &[]), "the same bytes in another place");
}

#[test]
fn ranges_beyond_the_arrays_are_refused_by_name() {
    let beyond = parts(&[record(3, 0, [5, 9], [0, 1])], &[[0, 1, 2]], 7).unwrap_err().to_string();
    assert!(beyond.contains("object 3: vertices 5..5+9 of 7"), "{beyond}");
    let huge = parts(&[record(3, 0, [0, 7], [u32::MAX, u32::MAX])], &[[0, 1, 2]], 7);
    assert!(matches!(huge, Err(Refused::Range { what: "triangles", .. })));
    let foreign = parts(&[record(3, 0, [4, 3], [0, 1])], &[[0, 5, 6]], 7).unwrap();
    assert!(foreign[0].triangles[0][0] > 7, "a foreign corner must not be taken for an own one");
}

#[test]
fn a_corner_of_another_object_and_too_many_objects_are_found_before_anything_is_put_on_the_stage() {
    let good = Part { id: 1, kind: 0, vertices: 0..3, triangles: vec![[0, 1, 2]] };
    let bad = Part { id: 2, kind: 1, vertices: 3..6, triangles: vec![[0, 1, 2], [0, 1, 3]] };
    let found = check_parts(&[good, bad], 4);
    assert!(matches!(found, Err(RenderError::BadTriangle { object: 2, triangle: 1, vertex: 3, vertices: 3 })), "{found:?}");
    let many: Vec<Part> = (0..250).map(|id| Part { id, kind: 1, vertices: 0..0, triangles: Vec::new() }).collect();
    assert!(check_parts(&many, MAX_OBJECTS - 250).is_ok());
    assert!(matches!(check_parts(&many, MAX_OBJECTS - 249), Err(RenderError::TooLarge { what: "objects", .. })));
}

#[test]
fn nothing_on_the_stage_has_the_id_of_something_else() {
    let mut ids = [crate::instrument::IDS.as_slice(), &[BUBBLES, MOTES, CONTACTS, FORCE]].concat();
    let all = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert!(ids.len() == all && ids[0] == TOOL, "{ids:?}");
}

#[test]
fn the_first_refusal_of_each_row_is_news() {
    let mut refusals = Refusals::default();
    let said = [true, true, false, true, false].map(|refused| refusals.is_news(refused));
    assert_eq!(said, [true, false, false, true, false]);
}

#[test]
fn a_vertex_that_is_not_finite_is_named() {
    assert!(matches!(check_finite(&[[0.0; 3], [0.0, f32::NAN, 0.0]]), Err(Refused::NotFinite(1))));
    assert!(check_finite(&[[0.0; 3]; 3]).is_ok());
}

/// A topology of so many objects of these kinds, instruments last. Each of the others has a triangle across the line of sight of [`picture`].
fn topology(version: u32, kinds: &[u32]) -> Vec<u64> {
    topology_with(version, kinds, 0)
}

/// The same, of which every vertex lies on a wound if `raw` is 1.
fn topology_with(version: u32, kinds: &[u32], raw: u32) -> Vec<u64> {
    let records: Vec<ObjectRecord> = (0..).zip(kinds).map(|(id, kind)| record(id, *kind, [3 * id, 3], [id, 1])).collect();
    let drawn = kinds.iter().filter(|kind| **kind != RIGID_TOOL).count() as u32;
    let corners_m = |object: u32| {
        let x_m = 0.006 * object as f32 - 0.008;
        [[x_m, -0.003, FAR_M], [x_m, 0.003, FAR_M], [x_m + 0.005, -0.003, FAR_M]]
    };
    let rest_m: Vec<[f32; 3]> = (0..drawn).flat_map(corners_m).collect();
    let triangles: Vec<[u32; 3]> = (0..drawn).map(|object| [0, 1, 2].map(|corner| 3 * object + corner)).collect();
    topology_of(version, &records, &triangles, (&rest_m, raw))
}

/// A topology of these objects, the vertices of which lie on a wound if `raw` is 1.
fn topology_of(version: u32, records: &[ObjectRecord], triangles: &[[u32; 3]], (rest_m, raw): (&[[f32; 3]], u32)) -> Vec<u64> {
    let [objects, faces, places] = [size_of_val(records), size_of_val(triangles), size_of_val(rest_m)];
    let lengths = [objects, 0, 0, faces, places, 0, rest_m.len() * 4, 0, 0, 0, 0];
    let mut words = vec![0u64; message_bytes(&lengths).div_ceil(8)];
    let header = StreamHeader { topology_version: version, ..StreamHeader::default() };
    let mut message = MessageMut::format(bytemuck::cast_slice_mut(&mut words), Kind::Topology, header, &lengths).unwrap();
    message.section::<ObjectRecord>(0).unwrap().copy_from_slice(records);
    message.section::<[u32; 3]>(3).unwrap().copy_from_slice(triangles);
    message.section::<[f32; 3]>(4).unwrap().copy_from_slice(rest_m);
    message.section::<u32>(6).unwrap().fill(raw);
    words
}

/// `None` where the machine is declared to have no Vulkan.
fn renderer() -> Option<Renderer> {
    let gpu = vulkan::unless_declared_absent(Gpu::new(Prefer::Software))?;
    Some(Renderer::new(gpu, 64, 48).expect("the software adapter takes every shader"))
}

/// From before the tip of an instrument that lies at the origin, along +z.
fn picture(renderer: &mut Renderer) -> Vec<u8> {
    let (eye_m, target_m) = ([0.0, 0.0, 0.005], [0.0, 0.0, FAR_M]);
    let view = View::new(Camera::External(External { eye_m, target_m, clip: None, ..External::default() }));
    renderer.render(&view).expect("a frame");
    renderer.read_rgba().expect("a picture").to_vec()
}

/// No test had a wound in a topology: one that was looked for in another section was none.
#[test]
fn what_a_topology_says_lies_on_a_wound_is_drawn_as_one() {
    let Some(mut renderer) = renderer() else { return };
    let mut scenery = Scenery::new(renderer.stage()).unwrap();
    let mut drawn = |version: u32, raw: u32| {
        let topology = topology_with(version, &[ORGAN, PATHOLOGY, RIGID_TOOL], raw);
        scenery.rebuild(renderer.stage(), bytemuck::cast_slice(&topology)).unwrap();
        picture(&mut renderer)
    };
    let [whole, cut, whole_again] = [(5, 0), (6, 1), (7, 0)].map(|(version, raw)| drawn(version, raw));
    let differs = |(before, after): &(&[u8], &[u8])| before.iter().zip(*after).any(|(a, b)| a.abs_diff(*b) > 12);
    let other = whole.chunks_exact(4).zip(cut.chunks_exact(4)).filter(differs).count();
    println!("{other} pixels of wounds");
    assert!(other > 30 && whole == whole_again, "{other}");
}

/// The chips of each stroke were of steel: a spare that had not made the world of the cut yet answered by the numbers of the one before.
#[test]
fn a_piece_that_has_taken_the_instruments_number_looks_like_no_instrument_whoever_answers() {
    let Some(mut renderer) = renderer() else { return };
    let whole = topology(5, &[ORGAN, PATHOLOGY, RIGID_TOOL]);
    let cut = topology(6, &[ORGAN, PATHOLOGY, FREE_PIECE, RIGID_TOOL]);
    let answer = |topology_version: u32, materials: &[u32]| -> Vec<AppearanceRecord> {
        let look = AppearanceRecord { colour: [0.7, 0.4, 0.3], roughness: 0.25, topology_version, ..AppearanceRecord::default() };
        (0..).zip(materials).map(|(id, material)| AppearanceRecord { id, material: *material, ..look }).collect()
    };
    let (before, after, unsaid) = (answer(5, &[0, 1, 3]), answer(6, &[0, 1, 1, 3]), answer(0, &[0, 1, 3]));
    let mut scenery = Scenery::new(renderer.stage()).unwrap();
    let scope = scenery.instrument.scope;
    assert!(!scenery.dress(renderer.stage(), scope, &before).unwrap(), "nothing is shown yet that it could be of");
    scenery.rebuild(renderer.stage(), bytemuck::cast_slice(&whole)).unwrap();
    assert!(!scenery.dress(renderer.stage(), scope, &after).unwrap(), "the holder is ahead of what is shown");
    assert!(scenery.dress(renderer.stage(), scope, &before).unwrap());
    scenery.rebuild(renderer.stage(), bytemuck::cast_slice(&cut)).unwrap();
    let usual = picture(&mut renderer);
    assert!(!scenery.dress(renderer.stage(), scope, &before).unwrap(), "the spare is behind");
    assert!(picture(&mut renderer) == usual && !scenery.looks.contains_key(&2), "nothing of it is taken");
    assert!(scenery.dress(renderer.stage(), scope, &after).unwrap());
    let dressed = picture(&mut renderer);
    assert!(dressed != usual && scenery.looks[&2].material == Material::Polyp, "{:?}", scenery.looks);
    // Who does not say of which topology it is is believed: this is how it looked.
    assert!(scenery.dress(renderer.stage(), scope, &unsaid).unwrap());
    assert!(picture(&mut renderer) != dressed && scenery.looks[&2].material == Material::Metal, "{:?}", scenery.looks);
}

/// The wall beside a growth was as light as any other.
#[test]
fn a_wall_is_darker_beside_what_stands_on_it_until_that_has_come_free() {
    let Some(mut renderer) = renderer() else { return };
    // Eight triangles about a place straight ahead, which look at the eye, and a plate that stands on them, a millimetre to the left (+x) of it.
    let rim = |at: u32| {
        let (sin, cos) = (std::f32::consts::TAU * at as f32 / 8.0).sin_cos();
        [0.006 * cos, 0.006 * sin, FAR_M]
    };
    let plate = [[-0.004, 0.0], [0.004, 0.0], [0.004, 0.006], [-0.004, 0.006]].map(|[y, up]: [f32; 2]| [0.001, y, FAR_M - up]);
    let rest_m: Vec<[f32; 3]> = std::iter::once([0.0, 0.0, FAR_M]).chain((0..8).map(rim)).chain(plate).collect();
    let triangles: Vec<[u32; 3]> = (0..8).map(|at| [0, 1 + (at + 1) % 8, 1 + at]).chain([[9, 10, 11], [9, 11, 12]]).collect();
    let mut scenery = Scenery::new(renderer.stage()).unwrap();
    let mut light_beside = |version: u32, kind: u32| -> u32 {
        let records = [record(0, ORGAN, [0, 9], [0, 8]), record(1, kind, [9, 4], [8, 2])];
        let topology = topology_of(version, &records, &triangles, (&rest_m, 0));
        scenery.rebuild(renderer.stage(), bytemuck::cast_slice(&topology)).unwrap();
        let shot = picture(&mut renderer);
        let pixels = (18..30).flat_map(|y| (33..45).map(move |x| 64 * y + x));
        pixels.map(|pixel: usize| u32::from(shot[4 * pixel + 1])).sum()
    };
    let [grown, free, again] =
        [(5, PATHOLOGY), (6, FREE_PIECE), (7, PATHOLOGY)].map(|(version, kind)| light_beside(version, kind));
    println!("light beside it: {grown}, free {free}");
    assert!(100 * grown < 96 * free && again == grown, "{grown} {free} {again}");
}
