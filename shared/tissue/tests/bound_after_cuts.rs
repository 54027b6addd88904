//! Promise of the substeps of a mesh that was cut: the bound from which they follow is above the largest frequency of the elements, beds and contacts that
//! are there, whichever way the elements are turned, and near enough to it to be worth something.

mod common;

use common::cuts::{bar, shipped, straight};
use common::noise;
use glam::Vec3;
use hyst_mesh::{TetMesh, check};
use hyst_tissue::{CutOptions, Cuttable, Material, Model, ModelReport, Options, cut};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Stiffness of contacts at each free node, N/m.
const CONTACT_N_M: f64 = 400.0;
/// Largest phase of a substep with which the integrator is stable, with room for rounding.
const STABLE_PHASE: f64 = 1.951;
const ITERATIONS: usize = 80;

/// The materials of region 0 and 1, the second on a bed.
fn materials() -> [Material; 2] {
    let material = |young_pa, nu| Material::new(young_pa, nu, 1000.0, 20.0).unwrap();
    [material(10_000.0, 0.45), material(30_000.0, 0.3).on_bed(3e8).unwrap()]
}

/// A tet with a rotation that is frozen.
struct Turned {
    nodes: [usize; 4],
    gradients: [Vector3<f64>; 4],
    volume_m3: f64,
    lame_pa: [f64; 2],
    turn: Matrix3<f64>,
}

/// The tets of a mesh, each turned its own way or all as they are, and the stiffness outside of them at each node, N/m.
fn turned(mesh: &TetMesh, is_turned: bool, seed: u64) -> (Vec<Turned>, Vec<f64>) {
    let (materials, mut random) = (materials(), noise(seed));
    let mut outside_n_m = vec![CONTACT_N_M; mesh.positions_m.len()];
    let tets = mesh.tets.iter().zip(&mesh.regions).map(|(tet, region)| {
        let (material, (gradients, volume_m3)) = (&materials[*region as usize], common::gradients(mesh, tet));
        tet.iter().for_each(|node| outside_n_m[*node as usize] += material.bed_n_m4() * volume_m3 / 4.0);
        let axis = Vector3::from_fn(|_, _| 3.0 * f64::from(random()));
        Turned {
            nodes: tet.map(|node| node as usize),
            gradients,
            volume_m3,
            lame_pa: [material.lame_lambda_pa(), material.shear_modulus_pa()],
            turn: if is_turned { *Rotation3::new(axis).matrix() } else { Matrix3::identity() },
        }
    });
    let tets = tets.collect();
    (tets, outside_n_m)
}

/// Largest frequency by power iteration on the inverse mass times the stiffness, whose Rayleigh quotient approaches from below; 1/s.
fn largest_per_s(tets: &[Turned], outside_n_m: &[f64], model: &Model, seed: u64) -> f64 {
    let mut random = noise(seed);
    let mass_kg: Vec<f64> = model.mass_kg().iter().map(|mass| f64::from(*mass)).collect();
    let free: Vec<usize> = (0..mass_kg.len()).filter(|node| !model.is_held(*node)).collect();
    let mut shape: Vec<Vector3<f64>> = vec![Vector3::zeros(); mass_kg.len()];
    free.iter().for_each(|node| shape[*node] = Vector3::from_fn(|_, _| f64::from(random())));
    let mut most = 0.0f64;
    for _ in 0..ITERATIONS {
        let mut image: Vec<Vector3<f64>> = shape.iter().zip(outside_n_m).map(|(u, stiffness)| u * *stiffness).collect();
        for Turned { nodes, gradients, volume_m3, lame_pa: [lambda_pa, mu_pa], turn } in tets {
            let parts = nodes.iter().zip(gradients).map(|(node, slope)| shape[*node] * slope.transpose());
            let gradient: Matrix3<f64> = parts.sum();
            let stress_pa = gradient * (2.0 * mu_pa) + turn * (lambda_pa * (turn.transpose() * gradient).trace());
            nodes.iter().zip(gradients).for_each(|(node, slope)| image[*node] += stress_pa * slope * *volume_m3);
        }
        let energy: f64 = free.iter().map(|node| image[*node].dot(&shape[*node])).sum();
        let inertia: f64 = free.iter().map(|node| mass_kg[*node] * shape[*node].norm_squared()).sum();
        most = most.max(energy / inertia);
        shape.fill(Vector3::zeros());
        free.iter().for_each(|node| shape[*node] = image[*node] / mass_kg[*node]);
        let size = shape.iter().map(|u| u.norm_squared()).sum::<f64>().sqrt();
        shape.iter_mut().for_each(|u| *u /= size);
    }
    most.sqrt()
}

/// The model of a mesh with mass added so that 8 substeps keep it stable, and no more of them for the sake of a clean motion.
fn model_of(tissue: &Cuttable) -> (Model, ModelReport) {
    let [first, second] = materials();
    let options = Options {
        max_added_mass_ratio: 100.0,
        contact_stiffness_n_m: CONTACT_N_M,
        omega_rest_per_s: Some(0.0),
        ..Options::default()
    };
    Model::with_materials(&tissue.rest, &tissue.fixed, &[(0, first), (1, second)], options).unwrap()
}

/// The least and the largest share of the bound that the largest frequency is, of elements that are not turned, over some strokes through a mesh.
fn shares_of_bound(mut tissue: Cuttable, strokes: u32, seed: u64) -> [f64; 2] {
    let found = check(&tissue.rest);
    let (low, high) = (Vec3::from_array(found.min_m), Vec3::from_array(found.max_m));
    let (middle, size) = (0.5 * (low + high), high - low);
    for (tet, region) in tissue.rest.tets.iter().zip(&mut tissue.rest.regions) {
        *region = u32::from(tissue.rest.positions_m[tet[0] as usize][0] > middle.x);
    }
    tissue.fixed = tissue.rest.positions_m.iter().map(|place| place[0] < low.x + 0.05 * size.x).collect();
    let (whole, mut random) = (tissue.rest.tets.len(), noise(seed));
    let mut shares = [f64::INFINITY, 0.0f64];
    for stroke in 0..=strokes {
        let (model, report) = model_of(&tissue);
        assert!(report.substeps <= 8 && report.softened_tets == 0, "{report:?}");
        for is_turned in [false, true] {
            let (tets, outside_n_m) = turned(&tissue.rest, is_turned, seed);
            let found_per_s = largest_per_s(&tets, &outside_n_m, &model, seed + u64::from(stroke));
            let share = found_per_s / report.omega_max_per_s;
            assert!(share <= 1.0 + 1e-6, "stroke {stroke}, turned {is_turned}: {found_per_s} 1/s in {report:?}");
            let phase = found_per_s * 1e-3 / f64::from(report.substeps);
            assert!(phase <= STABLE_PHASE, "stroke {stroke}, turned {is_turned}: {phase} in a substep");
            if !is_turned {
                shares = [shares[0].min(share), shares[1].max(share)];
            }
        }
        let mut direction = || Vec3::new(random(), random(), random()).normalize_or(Vec3::X);
        let (wire, offset) = (direction(), 0.2 * direction() * size);
        let way = direction().reject_from_normalized(wire).normalize_or(wire.any_orthonormal_vector());
        let (wire, way) = (2.0 * size.max_element() * wire, 3.0 * size.max_element() * way);
        let centre = middle + offset - 0.5 * way;
        for place in straight(centre - wire, centre + wire, way, 4) {
            cut(&mut tissue, &place, &CutOptions::default()).unwrap();
        }
        tissue.end_stroke();
    }
    assert!(tissue.rest.tets.len() > whole, "{whole} tets became {}", tissue.rest.tets.len());
    shares
}

#[test]
fn the_bound_after_cuts_is_above_the_largest_frequency_and_near_it() {
    for (name, tissue) in [("bar", bar()), ("polyp", Cuttable::at_rest(shipped("polyp.msh")))] {
        for seed in 0..2 {
            let [least, largest] = shares_of_bound(tissue.clone(), 3, seed);
            println!("{name}, seed {seed}: {least:.3} to {largest:.3} of the bound");
            assert!(least > 0.5 && largest > 0.75, "{name}, seed {seed}: {least} to {largest} of the bound");
        }
    }
}
