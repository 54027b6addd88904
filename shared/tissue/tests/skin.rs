//! Promises of the surface for the eye: it is cut where the volume is, its parts go with the parts of the volume, and with the faces of the wound it is
//! closed again.

mod common;

use common::cuts::{bar, corners, in_its_boundary, joining, parts, polyp, straight, sweep};
use glam::{DVec3, Vec3};
use hyst_mesh::{Binding, component_of_each_tet, signed_volume};
use hyst_tissue::{CutError, CutOptions, Cuttable, Skin, cut, cut_and_bind};

fn point(points: &[[f32; 3]], index: u32) -> DVec3 {
    DVec3::from_array(points[index as usize].map(f64::from))
}

/// The volume that the triangles of each part of the tissue enclose at rest, beside the part's own; and triangles between two parts.
fn volumes(tissue: &Cuttable) -> (Vec<[f64; 2]>, usize) {
    let part = component_of_each_tet(&tissue.rest);
    let mut volumes = vec![[0.0; 2]; parts(&tissue.rest)];
    for (tet, part) in tissue.rest.tets.iter().zip(&part) {
        volumes[*part as usize][1] += signed_volume(corners(&tissue.rest, tet));
    }
    let skin = &tissue.skin;
    let of_vertex = |vertex: u32| part[skin.bindings[vertex as usize].tet as usize];
    for triangle in &skin.triangles {
        let [a, b, c] = triangle.map(|vertex| point(&skin.rest_m, vertex));
        volumes[of_vertex(triangle[0]) as usize][0] += a.cross(b).dot(c) / 6.0;
    }
    (volumes, joining(tissue))
}

/// What was laid open is marked, and nothing else: the wound of a straight cut lies in its plane, up to what a node is moved or a crossing is snapped.
fn assert_wound(tissue: &Cuttable, middle: Vec3, normal: Vec3) {
    let skin = &tissue.skin;
    let is_raw = |triangle: &[u32; 3]| triangle.map(|vertex| skin.raw[vertex as usize]);
    let (raw, whole): (Vec<_>, Vec<_>) = skin.triangles.iter().partition(|triangle| is_raw(triangle)[0]);
    assert!(!raw.is_empty() && !whole.is_empty(), "{} of {} triangles are raw", raw.len(), skin.triangles.len());
    assert!(skin.triangles.iter().all(|triangle| is_raw(triangle) == [is_raw(triangle)[0]; 3]), "a triangle is raw at one end");
    let away_m = |triangle: &&[u32; 3]| {
        triangle.iter().map(|vertex| (Vec3::from(skin.rest_m[*vertex as usize]) - middle).dot(normal).abs()).fold(0.0, f32::max)
    };
    let farthest_m = raw.iter().map(away_m).fold(0.0, f32::max);
    assert!(farthest_m < 2e-3, "a raw triangle lies {farthest_m} m from the cut");
    let farthest_m = whole.iter().map(away_m).fold(0.0, f32::max);
    assert!(farthest_m > 1e-2, "the old surface goes on");
}

#[test]
fn a_bar_that_is_cut_through_has_two_closed_surfaces() {
    for (angle, steps) in [(0.0f32, 4), (0.35, 7), (-0.6, 12)] {
        let mut tissue = in_its_boundary(bar());
        let (before, _) = volumes(&tissue);
        assert!((before[0][0] / before[0][1] - 1.0).abs() < 1e-5, "{before:?}");
        let middle = Vec3::new(0.0181, 0.006, -0.002);
        let across = Vec3::new(angle.sin(), angle.cos(), 0.0) * 0.02;
        let reports =
            sweep(&mut tissue, &straight(middle - across, middle + across, Vec3::Z * 0.016, steps), &CutOptions::default());
        assert_eq!(reports.iter().map(|report| report.parts).max(), Some(2), "{angle}");
        let (after, between) = volumes(&tissue);
        assert_eq!(between, 0, "triangles join the two halves ({angle})");
        assert_wound(&tissue, middle, Vec3::new(angle.cos(), -angle.sin(), 0.0));
        for [skin, tets] in after {
            assert!((skin / tets - 1.0).abs() < 0.03, "the surface encloses {skin} m³, the tets fill {tets} ({angle})");
        }
    }
}

#[test]
fn the_surface_is_divided_along_the_wire_and_comes_apart_there_alone() {
    let mut tissue = in_its_boundary(bar());
    let before = tissue.skin.clone();
    let middle = Vec3::new(0.0181, 0.006, -0.002);
    let half = straight(middle - Vec3::Y * 0.02, middle + Vec3::Y * 0.02, Vec3::Z * 0.008, 6);
    sweep(&mut tissue, &half, &CutOptions::default());
    // Pulled apart about the cut, no triangle of the upper side bridges the mouth of the wound.
    let mut side = vec![0.0; tissue.rest.positions_m.len()];
    for tet in &tissue.rest.tets {
        let middle: f32 = tet.iter().map(|node| tissue.rest.positions_m[*node as usize][0] - 0.0181).sum();
        tet.iter().for_each(|node| side[*node as usize] += middle);
    }
    let away = |(place, side): (&[f32; 3], &f32)| [place[0] + if *side > 0.0 { 0.01 } else { 0.0 }, place[1], place[2]];
    let pulled: Vec<[f32; 3]> = tissue.rest.positions_m.iter().zip(&side).map(away).collect();
    let placed = tissue.skin.place(&tissue.rest.tets, &pulled);
    let longest = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| Vec3::from(placed[vertex as usize]));
        a.distance(b).max(b.distance(c)).max(c.distance(a))
    };
    let bottom = |triangle: &&[u32; 3]| triangle.iter().all(|vertex| tissue.skin.rest_m[*vertex as usize][2] < 1e-4);
    let mouth = tissue.skin.triangles.iter().filter(bottom).map(longest).fold(0.0, f32::max);
    assert!(mouth < 0.008, "a triangle of {mouth} m bridges the wound");
    // Far from the cut everything is as it was.
    let far = |skin: &Skin| {
        let is_far =
            |triangle: &&[u32; 3]| triangle.iter().all(|vertex| (skin.rest_m[*vertex as usize][0] - 0.0181).abs() > 0.008);
        skin.triangles
            .iter()
            .filter(is_far)
            .map(|triangle| triangle.map(|vertex| skin.rest_m[vertex as usize]))
            .collect::<Vec<_>>()
    };
    assert_eq!(far(&before), far(&tissue.skin));
}

/// Two bars in one place at rest, as a pathology lies in its host, of which the second is 10 cm away now; and how many vertices the surface of each has.
fn two_bars() -> (Cuttable, usize) {
    let one = in_its_boundary(bar());
    let (nodes, tets, vertices) = (one.rest.positions_m.len() as u32, one.rest.tets.len() as u32, one.skin.rest_m.len() as u32);
    let mut both = one.clone();
    both.rest.positions_m.extend_from_slice(&one.rest.positions_m);
    both.rest.tets.extend(one.rest.tets.iter().map(|tet| tet.map(|node| node + nodes)));
    both.rest.regions.extend(one.rest.regions.iter().map(|_| 1));
    both.position_m.extend(one.position_m.iter().map(|[x, y, z]| [x + 0.1, *y, *z]));
    both.velocity_m_s.extend_from_slice(&one.velocity_m_s);
    both.fixed.extend_from_slice(&one.fixed);
    both.marks.extend_from_slice(&one.marks);
    both.skin.rest_m.extend_from_slice(&one.skin.rest_m);
    both.skin.triangles.extend(one.skin.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + vertices)));
    both.skin.bindings.extend(one.skin.bindings.iter().map(|binding| Binding { tet: binding.tet + tets, ..*binding }));
    both.skin.raw.extend_from_slice(&one.skin.raw);
    (both, vertices as usize)
}

#[test]
fn the_surface_of_another_object_that_lay_there_at_rest_stays_as_it_was() {
    let (mut tissue, vertices) = two_bars();
    let of_other = |skin: &Skin| {
        let is_of_it =
            |triangle: &&[u32; 3]| triangle.iter().all(|vertex| (vertices..2 * vertices).contains(&(*vertex as usize)));
        let triangles: Vec<[u32; 3]> = skin.triangles.iter().filter(is_of_it).copied().collect();
        (skin.rest_m[vertices..2 * vertices].to_vec(), skin.bindings[vertices..2 * vertices].to_vec(), triangles)
    };
    let before = of_other(&tissue.skin);
    let middle = Vec3::new(0.0181, 0.006, -0.002);
    let reports = sweep(
        &mut tissue,
        &straight(middle - Vec3::Y * 0.02, middle + Vec3::Y * 0.02, Vec3::Z * 0.016, 7),
        &CutOptions::default(),
    );
    assert_eq!(reports.iter().map(|report| report.parts).max(), Some(3), "the first is cut through");
    assert_eq!(of_other(&tissue.skin), before);
}

#[test]
fn the_polyps_fine_surface_goes_with_its_parts() {
    let whole = polyp();
    let (least, most) = whole
        .rest
        .positions_m
        .iter()
        .fold((Vec3::MAX, Vec3::MIN), |(low, high), place| (low.min(Vec3::from(*place)), high.max(Vec3::from(*place))));
    for (axis, along) in [(Vec3::Z, Vec3::X), (Vec3::Y, Vec3::X), (Vec3::X, Vec3::Y)] {
        let (middle, size) = ((least + most) / 2.0, most - least);
        let way = Vec3::ONE - axis - along;
        let start = middle - way * size * 0.7;
        let places = straight(start - along * 0.02, start + along * 0.02, way * size * 1.4, 10);
        let mut tissue = whole.clone();
        let reports = sweep(&mut tissue, &places, &CutOptions::default());
        assert!(reports.iter().any(|report| report.parts >= 2), "not cut through across {axis}");
        let (after, between) = volumes(&tissue);
        assert_eq!(between, 0, "triangles join two parts, cut across {axis}");
        let enclosed: f64 = after.iter().map(|[skin, _]| skin).sum();
        let (before, _) = volumes(&whole);
        assert!((enclosed / before[0][0] - 1.0).abs() < 0.05, "{enclosed} m³ of {} across {axis}", before[0][0]);
    }
}

/// A slice that is kept comes off first, then a corner that is burnt.
#[test]
fn a_surface_that_is_bound_behind_all_else_is_the_one_that_is_bound_within_its_cut() {
    let options = CutOptions { min_piece_m3: 50e-9, ..CutOptions::default() };
    let slice = straight(Vec3::new(0.034, -0.002, -0.002), Vec3::new(0.034, 0.014, -0.002), Vec3::Z * 0.016, 4);
    let corner = straight(Vec3::new(0.004, -0.002, -0.002), Vec3::new(-0.002, 0.004, -0.002), Vec3::Z * 0.016, 4);
    let mut tissue = in_its_boundary(bar());
    let (mut other, mut late, mut parts, mut burnt) = (tissue.clone(), 0, 0, 0);
    for places in [slice, corner] {
        for wire in &places {
            let report = cut(&mut tissue, wire, &options).unwrap();
            let done = cut_and_bind(&mut other, wire, &options, |loose, rest| (loose, rest.clone())).unwrap();
            late += done.skin.iter().filter(|(loose, _)| !loose.is_bound()).count();
            assert_eq!(done.ended(&mut other, |(loose, rest)| loose.bound(&rest)), report);
            assert!(other == tissue, "another surface: {report:?}");
            (parts, burnt) = (parts.max(report.parts), burnt + report.burnt_tets);
        }
        tissue.end_stroke();
        other.end_stroke();
    }
    assert!(late > 4 && parts > 1 && burnt > 0, "{late} surfaces, {parts} parts, {burnt} tets burnt: too little was tried");
}

#[test]
fn without_room_nothing_is_divided_and_a_surface_of_another_mesh_is_refused() {
    let mut tissue = in_its_boundary(bar());
    let (vertices, triangles) = (tissue.skin.rest_m.len(), tissue.skin.triangles.len());
    let options = CutOptions { max_vertices: vertices, max_triangles: triangles, ..CutOptions::default() };
    let middle = Vec3::new(0.0181, 0.006, -0.002);
    let places = straight(middle - Vec3::Y * 0.02, middle + Vec3::Y * 0.02, Vec3::Z * 0.016, 5);
    let reports = sweep(&mut tissue, &places, &options);
    assert!(reports.iter().any(|report| report.out_of_room > 0));
    assert_eq!((tissue.skin.rest_m.len(), tissue.skin.triangles.len()), (vertices, triangles));
    let mut other = in_its_boundary(bar());
    other.skin.bindings[3].tet = 1_000_000;
    let before = other.clone();
    assert!(matches!(cut(&mut other, &places[0], &CutOptions::default()), Err(CutError::Skin { .. })));
    assert_eq!(other, before);
}
