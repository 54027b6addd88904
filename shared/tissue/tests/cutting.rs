//! Cutting: what a sweep leaves where one knows what that is, and what is refused. Whatever must hold after any sweep is asserted after each of these.

mod common;

use common::block;
use common::cuts::{bar, parts, shape, straight, sweep};
use glam::Vec3;
use hyst_mesh::{check, component_of_each_tet};
use hyst_tissue::{CutError, CutOptions, CutReport, Cuttable, MAX_WIRE_POINTS, cut};

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
