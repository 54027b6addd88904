//! Cutting: whatever is swept through whatever mesh, what must hold afterwards holds.

mod common;

use common::block;
use common::cuts::{bar, in_its_boundary, parts, polyp, shape, shipped, straight, sweep, volumes_now};
use glam::Vec3;
use hyst_mesh::{check, component_of_each_tet};
use hyst_tissue::{CutError, CutOptions, CutReport, Cuttable, MAX_WIRE_POINTS, cut};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

#[test]
fn a_wire_drawn_through_a_bar_leaves_two_pieces_of_the_volumes_that_the_plane_says() {
    for (x, steps) in [(0.0105, 1), (0.0121, 1), (0.0170, 7), (0.0170, 60), (0.018, 13)] {
        let mut tissue = bar();
        let places = straight(Vec3::new(x, -0.002, -0.002), Vec3::new(x, 0.014, -0.002), Vec3::Z * 0.016, steps);
        let reports = sweep(&mut tissue, &places, &CutOptions::default());
        assert_eq!(parts(&tissue.rest), 2, "x {x}, {steps} steps: {:#?}", reports.last());
        let part = component_of_each_tet(&tissue.rest);
        let volumes = shape(&tissue.rest).0;
        let of_first: f64 =
            volumes.iter().zip(&part).filter(|(_, part)| **part == part_at_origin(&tissue)).map(|(volume, _)| volume).sum();
        let expected = f64::from(x) * 0.012 * 0.012;
        // A node at the border lends its name within a fifth of an edge of at most 5.2 mm; inner ones move onto the plane.
        assert!((of_first - expected).abs() < 0.04 * 0.036 * 0.012 * 0.012, "x {x}, {steps} steps: {of_first} m³ for {expected}");
    }
}

fn part_at_origin(tissue: &Cuttable) -> u32 {
    let origin = tissue.rest.positions_m.iter().position(|p| *p == [0.0; 3]).unwrap() as u32;
    let tet = tissue.rest.tets.iter().position(|tet| tet.contains(&origin)).unwrap();
    component_of_each_tet(&tissue.rest)[tet]
}

#[test]
fn a_cut_that_ends_half_way_opens_the_tissue_and_does_not_part_it_and_a_killed_tissue_goes_on_with_it() {
    let places = straight(Vec3::new(0.017, -0.002, -0.002), Vec3::new(0.017, 0.014, -0.002), Vec3::Z * 0.016, 16);
    let mut tissue = bar();
    let before = check(&tissue.rest).boundary_triangles;
    sweep(&mut tissue, &places[..9], &CutOptions::default());
    assert_eq!(parts(&tissue.rest), 1);
    assert!(check(&tissue.rest).boundary_triangles > before + 8, "nothing is open");
    // The whole state is plain data: whoever has a copy of it computes the same.
    let mut successor = tissue.clone();
    sweep(&mut tissue, &places[9..], &CutOptions::default());
    sweep(&mut successor, &places[9..], &CutOptions::default());
    assert_eq!(tissue, successor);
    assert_eq!(parts(&tissue.rest), 2);
}

/// A loop of 8 mm as a wire: a half circle that hangs down from `top`.
fn hanging_loop(top: Vec3, radius: f32) -> Vec<[f32; 3]> {
    let point = |index: u32| {
        let angle = std::f32::consts::PI * index as f32 / 12.0;
        (top + radius * Vec3::new(0.0, -angle.cos(), -angle.sin())).to_array()
    };
    (0..=12).map(point).collect()
}

#[test]
fn a_loop_drawn_along_the_surface_takes_a_chip_off_and_again_and_again() {
    // a slab of 30 × 20 × 10 mm in tets of 2 mm, the loop's upper ends above it
    let mut tissue = Cuttable::at_rest(block([15, 10, 5], 0.002));
    let whole = tissue.volume_m3();
    for (stroke, y) in [0.005_f32, 0.010, 0.015].into_iter().enumerate() {
        let places: Vec<_> =
            (0..=20).map(|step| hanging_loop(Vec3::new(-0.002 + 0.0017 * step as f32, y, 0.0105), 0.004)).collect();
        let reports = sweep(&mut tissue, &places, &CutOptions::default());
        tissue.end_stroke();
        assert!(parts(&tissue.rest) >= stroke + 2, "stroke {stroke}: {} parts, {:?}", parts(&tissue.rest), reports.last());
    }
    // Three chips, each a channel of at most π/2 · (4 mm)² over 30 mm; the first of them is whole.
    let part = component_of_each_tet(&tissue.rest);
    let mut of_part = vec![0.0; parts(&tissue.rest)];
    shape(&tissue.rest).0.iter().zip(&part).for_each(|(volume, part)| of_part[*part as usize] += volume);
    of_part.sort_by(|left, right| right.total_cmp(left));
    let channel = 0.5 * std::f64::consts::PI * 0.004_f64.powi(2) * 0.030;
    assert!(of_part[1] > 0.5 * channel && of_part[1] < 1.3 * channel, "{of_part:?}, a channel has {channel}");
    assert!(of_part.iter().sum::<f64>() <= whole * 1.000_001);
}

#[test]
fn what_moves_and_is_bent_is_cut_where_it_is_now() {
    let mut tissue = bar();
    // bent up by 90° around the y axis and on its way
    for (now, velocity) in tissue.position_m.iter_mut().zip(&mut tissue.velocity_m_s) {
        let [x, y, z] = *now;
        let (radius, angle) = (0.023 + z, x / 0.023);
        *now = [radius * angle.sin(), y, -radius * angle.cos()];
        *velocity = [0.1, 10.0 * z, -0.2];
    }
    // the wire goes through the middle, across the bar there: from outside towards the centre of the bend
    let angle = 0.018_f32 / 0.023;
    let out = Vec3::new(angle.sin(), 0.0, -angle.cos());
    let places = straight(out * 0.038 - Vec3::Y * 0.002, out * 0.038 + Vec3::Y * 0.014, -out * 0.020, 5);
    sweep(&mut tissue, &places, &CutOptions::default());
    assert_eq!(parts(&tissue.rest), 2);
    let first = part_at_origin(&tissue);
    let part = component_of_each_tet(&tissue.rest);
    let volumes = shape(&tissue.rest).0;
    let half: f64 = volumes.iter().zip(&part).filter(|(_, part)| **part == first).map(|(volume, _)| volume).sum();
    assert!((half / volumes.iter().sum::<f64>() - 0.5).abs() < 0.04, "{half}");
}

#[test]
fn without_room_it_still_cuts_along_what_is_there_and_says_so() {
    let mut tissue = bar();
    let options = CutOptions {
        max_tets: tissue.rest.tets.len() + 12,
        max_nodes: tissue.rest.positions_m.len() + 300,
        ..CutOptions::default()
    };
    let places = straight(Vec3::new(0.0170, -0.002, -0.002), Vec3::new(0.0170, 0.014, -0.002), Vec3::Z * 0.016, 8);
    let reports = sweep(&mut tissue, &places, &options);
    assert!(reports.iter().map(|report| report.out_of_room).sum::<usize>() > 0);
    assert_eq!(parts(&tissue.rest), 2);
    // No node is left at all: nothing opens, nothing breaks.
    let mut tissue = bar();
    let options = CutOptions { max_nodes: 0, max_tets: 0, ..CutOptions::default() };
    let reports = sweep(&mut tissue, &places, &options);
    assert!(reports.iter().any(|report| report.out_of_room > 0) && parts(&tissue.rest) == 1);
}

#[test]
fn what_is_no_cut_changes_nothing() {
    let (fresh, options) = (bar(), CutOptions::default());
    let wire = [[0.01, 0.001, 0.001], [0.01, 0.011, 0.001]];
    let mut tissue = fresh.clone();
    // outside, standing still, of one point, of different points
    let outside = straight(Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.1, 0.01, 0.0), Vec3::Z * 0.02, 2);
    assert!(sweep(&mut tissue, &outside, &options).iter().all(|report| *report == CutReport::default()));
    tissue.end_stroke();
    for wire in [&wire[..], &wire[..], &wire[..1], &wire[..1], &[], &wire[..]] {
        assert_eq!(cut(&mut tissue, wire, &options), Ok(CutReport::default()));
    }
    // not finite
    let seated = tissue.clone();
    for bad in [f32::NAN, f32::INFINITY] {
        let moved = [[0.01, 0.001, 0.005], [0.01, bad, 0.005]];
        assert_eq!(cut(&mut tissue, &moved, &options), Err(CutError::Wire { point: 1 }));
    }
    let long = vec![[0.01, 0.0, 0.0]; MAX_WIRE_POINTS + 1];
    assert_eq!(cut(&mut tissue, &long, &options), Err(CutError::LongWire { found: MAX_WIRE_POINTS + 1 }));
    // options, lists and tets that do not fit
    let moved = [[0.01, 0.001, 0.005], [0.01, 0.011, 0.005]];
    let odd = CutOptions { snap_share: f64::NAN, ..options };
    assert!(matches!(cut(&mut tissue, &moved, &odd), Err(CutError::Option { name: "snap_share", .. })));
    assert_eq!(tissue, seated);
    tissue.marks.pop();
    assert!(matches!(cut(&mut tissue, &moved, &options), Err(CutError::Length { what: "marks", .. })));
    let mut tissue = fresh.clone();
    tissue.rest.tets[7][2] = 1_000_000;
    assert!(matches!(cut(&mut tissue, &moved, &options), Err(CutError::NodeIndex { tet: 7, node: 1_000_000, .. })));
    // a mesh that is not fit: nothing is burnt for it
    let broken = |breaks: fn(&mut Cuttable)| {
        let mut tissue = seated.clone();
        breaks(&mut tissue);
        let before = tissue.rest.tets.len();
        let error = cut(&mut tissue, &moved, &options).unwrap_err();
        assert_eq!(tissue.rest.tets.len(), before);
        error
    };
    assert!(matches!(broken(|tissue| tissue.rest.positions_m[40][1] = f32::NAN), CutError::NotFinite { node: 40, .. }));
    assert!(matches!(broken(|tissue| tissue.marks[40][1] = f32::INFINITY), CutError::NotFinite { node: 40, .. }));
    let inverted = broken(|tissue| {
        let near = near_wire(tissue);
        tissue.rest.tets[near].swap(0, 1);
    });
    assert_eq!(inverted, CutError::BadTet { tet: near_wire(&seated) });
    // Far from the wire it takes no part, and nothing is burnt for it either.
    let mut far = seated.clone();
    let end = far.rest.tets.len() - 1;
    far.rest.tets[end].swap(0, 1);
    let report = cut(&mut far, &moved, &options).unwrap();
    assert!(report.has_changed_mesh() && report.burnt_tets == 0 && near_wire(&seated) != end, "{report:?}");
}

/// A tet through which the wire of the test above goes.
fn near_wire(tissue: &Cuttable) -> usize {
    let is_between = |tet: &[u32; 4], axis: usize, at: f32| {
        let corners = tet.map(|node| tissue.position_m[node as usize][axis]);
        corners.iter().any(|corner| *corner <= at) && corners.iter().any(|corner| *corner >= at)
    };
    let is_near = |tet: &[u32; 4]| [0.0105, 0.005, 0.003].into_iter().enumerate().all(|(axis, at)| is_between(tet, axis, at));
    tissue.rest.tets.iter().position(is_near).expect("a tet near the wire")
}

#[test]
fn places_and_velocities_that_are_not_finite_are_refused_by_name_and_nothing_is_cut() {
    let places = straight(Vec3::new(0.017, -0.002, -0.002), Vec3::new(0.017, 0.014, -0.002), Vec3::Z * 0.016, 4);
    let refused = |breaks: fn(&mut Cuttable)| {
        let mut tissue = bar();
        breaks(&mut tissue);
        let rest = tissue.rest.clone();
        let errors: Vec<CutError> =
            places.iter().filter_map(|wire| cut(&mut tissue, wire, &CutOptions::default()).err()).collect();
        assert_eq!(tissue.rest, rest);
        errors.into_iter().next().expect("a refusal")
    };
    let of_place = refused(|tissue| tissue.position_m[40] = [f32::NAN, 0.0, f32::INFINITY]);
    assert_eq!(of_place, CutError::NotFinite { what: "a place", node: 40 });
    let of_velocity = refused(|tissue| tissue.velocity_m_s[41] = [f32::NAN; 3]);
    assert_eq!(of_velocity, CutError::NotFinite { what: "a velocity", node: 41 });
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
    let config = ProptestConfig { cases, rng_seed: RngSeed::Fixed(seed), failure_persistence: None, ..ProptestConfig::default() };
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
