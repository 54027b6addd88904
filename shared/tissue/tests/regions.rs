//! Regions of one mesh that are made of different materials, and tissue that what is around it holds: against the theory of bars and beds, and through cuts.

mod common;

use common::cuts::{bar, shape, straight, sweep};
use common::{Body, block, noise, options};
use glam::Vec3;
use hyst_mesh::{TetMesh, boundary};
use hyst_tissue::{CutOptions, CutReport, Material, MaterialError, Model, ModelError, Options, pressure_forces};

fn middle_m(mesh: &TetMesh, tet: usize, axis: usize) -> f32 {
    mesh.tets[tet].iter().map(|node| mesh.positions_m[*node as usize][axis]).sum::<f32>() / 4.0
}

/// A block whose tets below a height are of region 1, those above of region 2.
fn in_two(cells: [u32; 3], edge_m: f32, height_m: f32) -> TetMesh {
    let mut mesh = block(cells, edge_m);
    mesh.regions = (0..mesh.tets.len()).map(|tet| if middle_m(&mesh, tet, 2) < height_m { 1 } else { 2 }).collect();
    mesh
}

/// Adds the forces of a pressure on the faces at some heights; negative ones pull.
fn press(body: &mut Body, mesh: &TetMesh, heights_m: &[f32], pressure_pa: f32) {
    let is_at = |triangle: &[u32; 3], height_m: f32| {
        triangle.iter().all(|node| (mesh.positions_m[*node as usize][2] - height_m).abs() < 1e-6)
    };
    let mut faces = boundary(mesh).triangles;
    faces.retain(|triangle| heights_m.iter().any(|height_m| is_at(triangle, *height_m)));
    assert!(!faces.is_empty());
    let skipped = pressure_forces(&faces, &mesh.positions_m, &vec![pressure_pa; faces.len()], &mut body.force_n);
    assert_eq!(skipped, 0);
}

/// Mean of what the nodes at a height have moved along z, m.
fn moved_m(body: &Body, mesh: &TetMesh, height_m: f32) -> f64 {
    let at = (0..mesh.positions_m.len()).filter(|node| (mesh.positions_m[*node][2] - height_m).abs() < 1e-6);
    let moved: Vec<f64> = at.map(|node| f64::from(body.position_m[node][2] - mesh.positions_m[node][2])).collect();
    moved.iter().sum::<f64>() / moved.len() as f64
}

#[test]
fn a_bar_of_two_materials_in_series_stretches_by_the_sum_of_both() {
    let (pull_pa, half_m) = (200.0, 0.016);
    // As much thinner for their stress the one as the other: the stress is the same all over. Of the second pair nodes hold the volume of one half, at the border
    // too; of the last pair the stiff half holds the soft one at its border.
    let pairs = [
        ([10_000.0, 0.1], [30_000.0, 0.3], [0.01, 0.01]),
        ([9_000.0, 0.45], [9_800.0, 0.49], [0.01, 0.01]),
        ([10_000.0, 0.3], [30_000.0, 0.3], [0.15, 0.05]),
    ];
    for (soft, stiff, [most_of_half, most]) in pairs {
        let mesh = in_two([3, 3, 8], 0.004, half_m);
        let material = |[young_pa, nu]: [f64; 2]| Material::new(young_pa, nu, 1000.0, 80.0).unwrap();
        let materials = [(1, material(soft)), (2, material(stiff))];
        let free = vec![false; mesh.positions_m.len()];
        let mut body = Body::new(Model::with_materials(&mesh, &free, &materials, options()).unwrap().0);
        press(&mut body, &mesh, &[0.0, 2.0 * half_m], -pull_pa);
        for _ in 0..1_500 {
            body.step();
        }
        let heights = [0.0, half_m, 2.0 * half_m].map(|height_m| moved_m(&body, &mesh, height_m));
        let theory_m = |[young_pa, _]: [f64; 2]| f64::from(pull_pa * half_m) / young_pa;
        let found = [heights[1] - heights[0], heights[2] - heights[1], heights[2] - heights[0]];
        let expected = [theory_m(soft), theory_m(stiff), theory_m(soft) + theory_m(stiff)];
        let allowed = [most_of_half, most_of_half, most];
        for ((found_m, expected_m), most) in found.into_iter().zip(expected).zip(allowed) {
            assert!((found_m / expected_m - 1.0).abs() < most, "{soft:?} and {stiff:?}: {found:?} m, theory {expected:?} m");
        }
    }
}

#[test]
fn a_block_on_a_bed_sinks_by_pressure_over_stiffness() {
    let (pressure_pa, bed_n_m3, layer_m, top_m) = (200.0_f32, 1e6, 0.004, 0.016);
    let mesh = in_two([4, 4, 4], layer_m as f32, layer_m as f32);
    let stuff = Material::new(100_000.0, 0.3, 1000.0, 80.0).unwrap();
    let materials = [(1, stuff.on_bed(bed_n_m3 / layer_m).unwrap()), (2, stuff)];
    let free = vec![false; mesh.positions_m.len()];
    let (model, report) = Model::with_materials(&mesh, &free, &materials, options()).unwrap();
    assert_eq!(report.scaled_nodes, 0);
    let mut body = Body::new(model);
    press(&mut body, &mesh, &[top_m], pressure_pa);
    for _ in 0..1_000 {
        body.step();
    }
    let expected_m = f64::from(pressure_pa) / bed_n_m3;
    // What holds each node is a quarter of the bed of each of its tets: so much they hold together, whatever the block does in between.
    let (volumes, _) = shape(&mesh);
    let (mut sunk, mut held) = (0.0, 0.0);
    for (tet, volume) in mesh.tets.iter().zip(volumes).enumerate().filter(|(tet, _)| mesh.regions[*tet] == 1).map(|(_, of)| of) {
        for node in tet.map(|node| node as usize) {
            sunk += volume * f64::from(mesh.positions_m[node][2] - body.position_m[node][2]);
            held += volume;
        }
    }
    assert!((sunk / held / expected_m - 1.0).abs() < 0.005, "the bed gives way by {} m, theory {expected_m} m", sunk / held);
    let bottom_m = -moved_m(&body, &mesh, 0.0);
    assert!((bottom_m / expected_m - 1.0).abs() < 0.05, "the bottom sinks by {bottom_m} m, theory {expected_m} m");
}

#[test]
fn a_bed_that_is_too_stiff_for_the_step_is_given_mass_and_stays_stable_and_fixed_nodes_have_none() {
    let mesh = in_two([3, 3, 3], 0.004, 1.0);
    let stuff = Material::new(10_000.0, 0.4, 1000.0, 20.0).unwrap();
    let free = vec![false; mesh.positions_m.len()];
    let make = |bed_n_m4: f64, fixed: &[bool], max_added_mass_ratio: f64| {
        let material = stuff.on_bed(bed_n_m4).unwrap();
        Model::with_materials(&mesh, fixed, &[(1, material)], Options { max_added_mass_ratio, ..Options::default() })
    };
    let (_, plain) = make(0.0, &free, 0.5).unwrap();
    assert_eq!(plain.scaled_nodes, 0);
    assert!(matches!(make(1e12, &free, 0.5), Err(ModelError::TooStiff { .. })));
    let (model, report) = make(1e12, &free, 10.0).unwrap();
    assert!(report.scaled_nodes == free.len() && report.mass_kg == plain.mass_kg, "{report:?}");
    assert!(report.substeps <= Options::default().max_substeps, "{report:?}");
    let mut body = Body::new(model);
    let mut random = noise(9);
    body.velocity_m_s.iter_mut().flatten().for_each(|v| *v = 0.05 * random());
    for _ in 0..500 {
        assert_eq!(body.step().corrections(), 0);
        let strayed =
            body.position_m.iter().zip(&mesh.positions_m).map(|(now, rest)| Vec3::from(*now).distance(Vec3::from(*rest)));
        assert!(strayed.fold(0.0, f32::max) < 1e-3, "the bed holds all of it");
    }
    let fixed = vec![true; mesh.positions_m.len()];
    assert!(make(1e12, &fixed, 0.5).unwrap().0 == make(0.0, &fixed, 0.5).unwrap().0, "what is fixed needs no bed");
    for bad in [-1.0, 1.1e12, f64::NAN, f64::INFINITY] {
        assert!(matches!(stuff.on_bed(bad), Err(MaterialError::Bed(_))), "{bad}");
    }
}

#[test]
fn regions_of_one_material_are_the_same_model_to_the_bit() {
    let material = Material::new(10_000.0, 0.45, 1000.0, 20.0).unwrap();
    let mesh = in_two([4, 3, 5], 0.003, 0.007);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let (plain, of_plain) = Model::new(&mesh, &fixed, &material, options()).unwrap();
    let on_none = material.on_bed(0.0).unwrap();
    let (parted, of_parted) = Model::with_materials(&mesh, &fixed, &[(1, material), (2, on_none)], options()).unwrap();
    assert!(plain == parted && of_plain == of_parted, "{of_plain:?} is not {of_parted:?}");
    assert!(format!("{plain:?}") == format!("{parted:?}"), "a zero has another sign");
}

#[test]
fn a_cut_through_two_materials_leaves_each_side_what_it_is_made_of() {
    const BORDER_M: f32 = 0.018;
    let mut tissue = bar();
    let is_beyond = |mesh: &TetMesh, tet: usize| u32::from(middle_m(mesh, tet, 0) > BORDER_M);
    tissue.material = (0..tissue.rest.tets.len()).map(|tet| 7 * is_beyond(&tissue.rest, tet)).collect();
    let volumes_m3 = |mesh: &TetMesh, material: &[u32]| {
        let of =
            |kind: u32| shape(mesh).0.iter().zip(material).filter(|(_, of)| **of == kind).map(|(volume, _)| volume).sum::<f64>();
        [of(0), of(7)]
    };
    let before = volumes_m3(&tissue.rest, &tissue.material);
    // a slanting cut through the border
    let places = straight(Vec3::new(0.012, -0.002, -0.002), Vec3::new(0.021, 0.014, -0.002), Vec3::new(0.004, 0.0, 0.016), 12);
    let reports = sweep(&mut tissue, &places, &CutOptions::default());
    let split: usize = reports.iter().map(|report: &CutReport| report.split_edges).sum();
    assert!(split > 10, "{split} edges were split: the test says nothing");
    assert_eq!(tissue.material.len(), tissue.rest.tets.len());
    for (tet, material) in tissue.material.iter().enumerate() {
        assert_eq!(*material, 7 * is_beyond(&tissue.rest, tet), "tet {tet}, {} m", middle_m(&tissue.rest, tet, 0));
    }
    let after = volumes_m3(&tissue.rest, &tissue.material);
    assert!(before.iter().zip(after).all(|(old, new)| (old - new).abs() <= 1e-6 * old), "{before:?} became {after:?}");
}
