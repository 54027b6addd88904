//! Cutting: whatever is swept through whatever mesh, what must hold afterwards holds. `HYSTATION_SEED` draws other strokes than those of every run.

mod common;

use common::block;
use common::cuts::{beside, in_its_boundary, joined, parts, polyp, shape, shipped, sweep, volumes_now};
use common::kinds::{in_no_order, jittered, on_lines, spaced_m, tube, with_slivers};
use glam::Vec3;
use hyst_mesh::{FLAT_QUALITY, Repair, TetMesh, repair};
use hyst_tissue::{CutOptions, Cuttable};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// The variable that holds the seed of all strokes, a whole number, in place of each test's own.
const SEED: &str = "HYSTATION_SEED";

/// The seed that somebody gives, or a test's own.
fn seed_or(own: u64) -> u64 {
    let given = std::env::var(SEED).ok();
    given.map_or(own, |seed| seed.parse().unwrap_or_else(|error| panic!("{SEED}={seed}: {error}")))
}

/// Random strokes: where, which way, how bent the wire is, in how many ticks.
fn stroke() -> impl Strategy<Value = (Vec3, Vec3, Vec3, f32, u32)> {
    let unit = || [-1.0_f32..1.0, -1.0_f32..1.0, -1.0_f32..1.0].prop_map(Vec3::from_array);
    (unit(), unit(), unit(), -0.5_f32..0.5, 1..9_u32)
}

/// The wire's places for a stroke through a mesh: around `middle`, of the mesh's `size`.
fn places(middle: Vec3, size: Vec3, (offset, wire, way, bend, steps): (Vec3, Vec3, Vec3, f32, u32)) -> Vec<Vec<[f32; 3]>> {
    let reach = size.max_element();
    let (wire, way) = (wire.normalize_or(Vec3::X) * 0.5 * reach, way.normalize_or(Vec3::Z) * 1.5 * reach);
    let centre = middle + 0.3 * offset * size - 0.5 * way;
    let side = wire.cross(way).normalize_or(Vec3::Y) * bend * reach;
    let point = |step: u32, index: i32| {
        let along = index as f32 / 4.0;
        (centre + way * (step as f32 / steps as f32) + wire * along + side * (1.0 - along * along)).to_array()
    };
    (0..=steps).map(|step| (-4..=4).map(|index| point(step, index)).collect()).collect()
}

/// The box around some places.
fn box_around(places: &[[f32; 3]]) -> (Vec3, Vec3) {
    let with = |(low, high): (Vec3, Vec3), place: &[f32; 3]| (low.min(Vec3::from(*place)), high.max(Vec3::from(*place)));
    places.iter().fold((Vec3::MAX, Vec3::MIN), with)
}

/// Brings a tissue into another shape than that at rest: stretched to 0.7 to 1.4 times its size along each axis, sheared and bent about its middle, the latter as
/// far as no tet turns inside out. The draws are from −1 to 1.
fn deform(tissue: &mut Cuttable, draws: [f32; 9]) {
    const HALVINGS: i32 = 6;
    let (low, high) = box_around(&tissue.rest.positions_m);
    let (middle, reach) = (0.5 * (low + high), (high - low).max_element());
    let [a, b, c, d, e, f, along_x, along_y, along_z] = draws;
    for halving in 0..=HALVINGS {
        let bend = if halving == HALVINGS { 0.0 } else { 1.2 * 0.5_f32.powi(halving) / reach };
        for (now, rest) in tissue.position_m.iter_mut().zip(&tissue.rest.positions_m) {
            let mut place = (Vec3::from(*rest) - middle) * Vec3::new((0.5 * a).exp2(), (0.5 * b).exp2(), (0.5 * c).exp2());
            place += 0.4 * Vec3::new(d * place.y + e * place.z, f * place.z, 0.0);
            place.z += bend * along_x * place.x * place.x;
            place.y += bend * along_z * place.z * place.z;
            place.x += bend * along_y * place.y * place.y;
            *now = (middle + place).to_array();
        }
        if volumes_now(tissue).iter().all(|volume| *volume > 0.0) {
            return;
        }
    }
    panic!("a stretched and sheared tissue is inside out: {draws:?}");
}

/// Room for what a tissue has and a part of what a few strokes take, up to three tenths of it.
fn options(tissue: &Cuttable, room: Option<[f64; 4]>) -> CutOptions {
    let Some(room) = room else { return CutOptions::default() };
    let (rest, skin) = (&tissue.rest, &tissue.skin);
    let own = [rest.positions_m.len(), rest.tets.len(), skin.rest_m.len(), skin.triangles.len()];
    let most: [usize; 4] = std::array::from_fn(|what| own[what] + (0.3 * room[what] * own[what] as f64) as usize);
    let [max_nodes, max_tets, max_vertices, max_triangles] = most;
    CutOptions { max_nodes, max_tets, max_vertices, max_triangles, ..CutOptions::default() }
}

/// Makes a tissue of two materials, one in each half of its length.
fn of_two_materials(tissue: &mut Cuttable) {
    let (low, high) = box_around(&tissue.rest.positions_m);
    let rest = &tissue.rest;
    let middle_x = |tet: &[u32; 4]| tet.iter().map(|node| rest.positions_m[*node as usize][0]).sum::<f32>() / 4.0;
    tissue.material = rest.tets.iter().map(|tet| 1 + u32::from(middle_x(tet) > 0.5 * (low.x + high.x))).collect();
}

/// Holds the lowest fifth of a tissue, which stands still then.
fn hold(tissue: &mut Cuttable) {
    let (low, high) = box_around(&tissue.rest.positions_m);
    for (node, place) in tissue.rest.positions_m.iter().enumerate() {
        if place[2] < low.z + 0.2 * (high.z - low.z) {
            (tissue.fixed[node], tissue.velocity_m_s[node]) = (true, [0.0; 3]);
        }
    }
}

/// Strokes through a tissue with a surface for the eye, each of them in half of the cases through another shape than that at rest; in a quarter of the cases there is
/// room for little. In half of them it is of two materials, and in half of them a part of it is held.
fn random_strokes(fresh: &Cuttable, cases: u32, seed: u64) {
    let rng_seed = RngSeed::Fixed(seed_or(seed));
    let config = ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() };
    let strokes = prop::collection::vec((stroke(), prop::array::uniform9(-1.0_f32..1.0)), 1..4);
    let room = prop::option::weighted(0.25, prop::array::uniform4(0.0_f64..1.0));
    let kind = (any::<bool>(), any::<bool>());
    proptest!(config, |(strokes in strokes, is_deformed in any::<bool>(), room in room, (is_of_two, is_held) in kind)| {
        let mut tissue = fresh.clone();
        for (node, velocity) in tissue.velocity_m_s.iter_mut().enumerate() {
            *velocity = [0.01 * (node % 7) as f32, 0.02, -0.01 * (node % 3) as f32];
        }
        if is_of_two {
            of_two_materials(&mut tissue);
        }
        if is_held {
            hold(&mut tissue);
        }
        let options = options(fresh, room);
        for (stroke, draws) in strokes {
            if is_deformed {
                deform(&mut tissue, draws);
            }
            let (low, high) = box_around(&tissue.position_m);
            sweep(&mut tissue, &places(0.5 * (low + high), high - low, stroke), &options);
            tissue.end_stroke();
        }
    });
}

#[test]
fn random_strokes_through_a_block() {
    random_strokes(&in_its_boundary(Cuttable::at_rest(block([6, 5, 4], 0.003))), 300, 1);
}

#[test]
fn random_strokes_through_the_polyp() {
    random_strokes(&in_its_boundary(Cuttable::at_rest(shipped("polyp.msh"))), 300, 2);
}

/// Its surface is finer than its tets, and lies partly outside of them.
#[test]
fn random_strokes_through_the_polyp_with_its_fine_surface() {
    random_strokes(&polyp(), 20, 5);
}

#[test]
fn random_strokes_through_the_myoma() {
    random_strokes(&in_its_boundary(Cuttable::at_rest(shipped("myoma.msh"))), 300, 3);
}

#[test]
fn random_strokes_through_the_uterus() {
    random_strokes(&in_its_boundary(Cuttable::at_rest(shipped("uterus.msh"))), 12, 4);
}

/// A block with its nodes where these lines cross.
fn grid(lines_m: &[Vec<f32>; 3]) -> TetMesh {
    let cells = [0, 1, 2].map(|axis| lines_m[axis].len() as u32 - 1);
    on_lines(block(cells, 1.0), lines_m)
}

/// Its edges are 2 to 10 mm long.
#[test]
fn random_strokes_through_a_graded_block() {
    let across_m = spaced_m(&[5.0, 1.6, 1.0, 3.0], [0.0, 0.0212]);
    let lines_m = [across_m.clone(), across_m, spaced_m(&[1.0, 2.0, 5.0], [0.0, 0.016])];
    let repaired = repair(jittered(grid(&lines_m), &lines_m)).unwrap();
    assert!(repaired.repairs.is_empty(), "{:?}", repaired.repairs);
    random_strokes(&in_its_boundary(Cuttable::at_rest(repaired.mesh)), 100, 6);
}

#[test]
fn random_strokes_through_a_block_with_slivers() {
    let lines_m = [5, 5, 4].map(|cells| spaced_m(&vec![1.0; cells], [0.0, 0.003 * cells as f32]));
    let mesh = repair(with_slivers(grid(&lines_m), &lines_m)).unwrap().mesh;
    assert!(shape(&mesh).1 < FLAT_QUALITY, "{}", shape(&mesh).1);
    random_strokes(&in_its_boundary(Cuttable::at_rest(mesh)), 100, 7);
}

#[test]
fn random_strokes_through_a_tube_that_is_one_tet_thick_and_in_no_order() {
    let tube = tube(block([10, 1, 6], 1.0), [10, 6], [0.008, 0.002, 0.018]);
    let repaired = repair(in_no_order(&tube)).unwrap();
    let is_closed = |repair: &Repair| matches!(repair, Repair::DroppedUnusedNodes { nodes: 14, .. });
    assert!(repaired.repairs.iter().any(is_closed), "{:?}", repaired.repairs);
    random_strokes(&in_its_boundary(Cuttable::at_rest(repaired.mesh)), 100, 8);
}

/// Two halves, one of which is there twice, each with nodes of its own.
#[test]
fn random_strokes_through_a_block_that_came_in_pieces_and_twice_in_part() {
    let across_m = spaced_m(&[1.0; 3], [0.0, 0.009]);
    let half = |bounds_m: [f32; 2]| grid(&[across_m.clone(), across_m.clone(), spaced_m(&[1.0; 2], bounds_m)]);
    let [near, far] = [[0.0, 0.006], [0.006, 0.012]].map(half);
    let again = in_no_order(&near);
    let repaired = repair(joined(&[near, far, again])).unwrap();
    let is_one = matches!(
        repaired.repairs[..],
        [Repair::DroppedDuplicates { tets: 108, .. }, Repair::MergedNodes { nodes: 16, .. }, Repair::DroppedUnusedNodes { .. }]
    );
    assert!(is_one && parts(&repaired.mesh) == 1, "{:?}", repaired.repairs);
    random_strokes(&in_its_boundary(Cuttable::at_rest(repaired.mesh)), 100, 9);
}

/// As the organs of a scene: each is a region, and has nodes and a surface of its own where they touch with a whole side.
#[test]
fn random_strokes_through_two_objects_that_touch() {
    const EDGE_M: f32 = 0.003;
    let [near, far] = [0.0, 3.0 * EDGE_M].map(|low_m| {
        let mut mesh = block([3, 3, 3], EDGE_M);
        mesh.positions_m.iter_mut().for_each(|place_m| place_m[0] += low_m);
        in_its_boundary(Cuttable::at_rest(mesh))
    });
    let both = beside(&near, &far);
    assert_eq!(parts(&both.rest), 2);
    random_strokes(&both, 100, 10);
}
