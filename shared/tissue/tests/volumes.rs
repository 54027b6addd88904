//! Promise of volumes that nodes hold: their forces are those of the definition, also where tets that hold their own volume share the nodes, and where nodes have
//! numbers that 16 bits do not hold; together they push nothing; and a tension that is the same all over is in balance where the two kinds of tets meet.

mod common;

use common::{Body, block, gradients, noise, options};
use hyst_mesh::{TetMesh, boundary};
use hyst_tissue::{Isa, Material, Model, Options, StepInput, pressure_forces};
use nalgebra::{Matrix3, Vector3};

const EDGE_M: f32 = 0.003;
/// Where the two regions of the block meet, m: the tets below hold their own volume, and nodes that of those above.
const BORDER_M: f32 = 2.0 * EDGE_M;
const TOP_M: f32 = 4.0 * EDGE_M;
/// Young's modulus, Pa, and Poisson's ratio of each region: under the same tension both get as much thinner.
const STUFF: [(f64, f64); 2] = [(9_000.0, 0.45), (9_800.0, 0.49)];
/// With as many nodes before them nodes have numbers that 16 bits do not hold.
const MANY: u32 = 33_001;
/// So short a step that nothing moves in it: what velocities come to tells the forces.
const SHORT_S: f32 = 2e-8;

fn sets() -> impl Iterator<Item = Isa> {
    [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available())
}

fn material(region: u32) -> Material {
    let (young_pa, nu) = STUFF[region as usize];
    Material::new(young_pa, nu, 1000.0, 0.0).unwrap()
}

/// A block of both regions, behind so many nodes that no tet uses.
fn in_two(unused: u32) -> TetMesh {
    let mut mesh = block([3, 3, 4], EDGE_M);
    let middle_m = |tet: &[u32; 4]| tet.iter().map(|node| mesh.positions_m[*node as usize][2]).sum::<f32>() / 4.0;
    mesh.regions = mesh.tets.iter().map(|tet| u32::from(middle_m(tet) > BORDER_M)).collect();
    mesh.positions_m = [vec![[0.0; 3]; unused as usize], mesh.positions_m].concat();
    mesh.tets.iter_mut().flatten().for_each(|node| *node += unused);
    mesh
}

/// The block grown by two hundredths of its volume and sheared, each node a hundredth of an edge from there, and all of it turned.
fn torn_m(mesh: &TetMesh) -> Vec<[f32; 3]> {
    let (mut random, (sin, cos)) = (noise(21), 0.4f32.sin_cos());
    let mut moved = |[x, y, z]: [f32; 3]| {
        let [x, y, z] = [1.01 * x, 1.005 * y + 0.05 * x, 1.005 * z].map(|at| at + 0.01 * EDGE_M * random());
        [cos * x - sin * y, sin * x + cos * y, z]
    };
    mesh.positions_m.iter().map(|place| moved(*place)).collect()
}

/// What each node is pushed with at a shape, its load included, N.
fn forces_n(isa: Isa, mesh: &TetMesh, shape_m: &[[f32; 3]], load_n: &[[f32; 3]]) -> Vec<Vector3<f64>> {
    let materials = [0, 1].map(|region| (region, material(region)));
    // The largest frequency says how many substeps make a clean motion, and there is one here: it is not looked for.
    let options = Options { isa, omega_rest_per_s: Some(0.0), ..options() };
    let free = vec![false; shape_m.len()];
    let mut body = Body::new(Model::with_materials(mesh, &free, &materials, options).unwrap().0);
    body.position_m.copy_from_slice(shape_m);
    let report = body.step_with(&StepInput { external_force_n: load_n, dt_s: SHORT_S, ..StepInput::default() });
    assert_eq!((report.substeps, report.corrections(), report.inverted_tets), (1, 0, 0));
    let force_n = |(velocity_m_s, mass_kg): (&[f32; 3], &f32)| {
        Vector3::from(velocity_m_s.map(f64::from)) * (f64::from(*mass_kg) / f64::from(SHORT_S))
    };
    body.velocity_m_s.iter().zip(body.model.mass_kg()).map(force_n).collect()
}

/// A tet at a shape, in double precision.
struct Stretched {
    slopes: [Vector3<f64>; 4],
    volume_m3: f64,
    f: Matrix3<f64>,
    rotation: Matrix3<f64>,
    /// The trace of its stretch beyond that at rest.
    growth: f64,
}

impl Stretched {
    fn of(mesh: &TetMesh, nodes: &[u32; 4], shape_m: &[[f32; 3]]) -> Stretched {
        let (slopes, volume_m3) = gradients(mesh, nodes);
        let mut f = Matrix3::<f64>::zeros();
        for (node, slope) in nodes.iter().zip(&slopes) {
            f += Vector3::from(shape_m[*node as usize].map(f64::from)) * slope.transpose();
        }
        // Newton's iteration for the polar decomposition.
        let rotation = (0..20).fold(f, |found, _| (found + found.try_inverse().unwrap().transpose()) * 0.5);
        Stretched { slopes, volume_m3, f, rotation, growth: (rotation.transpose() * f).trace() - 3.0 }
    }
}

/// The forces of the definition, tet by tet, N: −V·(2μ(F − R) + p·R)·∇N. A tet's volume counts `border_share` times in that of a node at the border: once.
fn defined_n(mesh: &TetMesh, shape_m: &[[f32; 3]], border_share: f64) -> Vec<Vector3<f64>> {
    let tets: Vec<Stretched> = mesh.tets.iter().map(|nodes| Stretched::of(mesh, nodes, shape_m)).collect();
    let tets = || mesh.tets.iter().zip(&mesh.regions).zip(&tets);
    let (mut grown_m3, mut held_m3) = (vec![0.0; shape_m.len()], vec![0.0; shape_m.len()]);
    for ((nodes, _), tet) in tets().filter(|((_, region), _)| **region == 1) {
        for node in nodes.map(|node| node as usize) {
            let is_at_border = (mesh.positions_m[node][2] - BORDER_M).abs() < 1e-6;
            grown_m3[node] += tet.volume_m3 * tet.growth;
            held_m3[node] += tet.volume_m3 * if is_at_border { border_share } else { 1.0 };
        }
    }
    let mut forces_n = vec![Vector3::<f64>::zeros(); shape_m.len()];
    for ((nodes, region), tet) in tets() {
        let material = material(*region);
        let (lambda_pa, two_mu_pa) = (material.lame_lambda_pa(), 2.0 * material.shear_modulus_pa());
        let pressure_pa = |growth: f64| (lambda_pa * growth).min(two_mu_pa);
        let of_node = |node: u32| pressure_pa(grown_m3[node as usize] / held_m3[node as usize]);
        let pressure_pa = if *region == 1 { nodes.map(of_node).iter().sum::<f64>() / 4.0 } else { pressure_pa(tet.growth) };
        let stress_pa = (tet.f - tet.rotation) * two_mu_pa + tet.rotation * pressure_pa;
        for (node, slope) in nodes.iter().zip(&tet.slopes) {
            forces_n[*node as usize] -= stress_pa * slope * tet.volume_m3;
        }
    }
    forces_n
}

#[test]
fn nodes_push_as_defined_beside_tets_that_hold_their_own_volume_and_whatever_their_numbers() {
    for unused in [0, MANY] {
        let mesh = in_two(unused);
        let shape_m = torn_m(&mesh);
        let expected_n = defined_n(&mesh, &shape_m, 1.0);
        let largest_n = expected_n.iter().map(|force_n| force_n.norm()).fold(0.0, f64::max);
        let off_by = |other_n: &[Vector3<f64>]| {
            let pairs = expected_n.iter().zip(other_n);
            pairs.map(|(expected_n, other_n)| (expected_n - other_n).norm()).fold(0.0, f64::max) / largest_n
        };
        for share in [0.5, 2.0] {
            let off = off_by(&defined_n(&mesh, &shape_m, share));
            assert!(off > 0.05, "the border shows in nothing: {off} with {share} of its volume");
        }
        for isa in sets() {
            let found_n = forces_n(isa, &mesh, &shape_m, &[]);
            let off = off_by(&found_n);
            // Single precision leaves some 1e-6 of a growth, of which λ makes 0.2 Pa beside kilopascals.
            assert!(off < 5e-4, "{isa:?}, {unused} nodes before them: off by {off} of the largest force");
            let together_n = found_n.iter().fold(Vector3::<f64>::zeros(), |sum, force_n| sum + force_n).norm();
            let apart_n: f64 = found_n.iter().map(|force_n| force_n.norm()).sum();
            assert!(together_n < 1e-5 * apart_n, "{isa:?}, {unused} nodes before them: {together_n} N of {apart_n} N");
        }
    }
}

#[test]
fn a_tension_that_is_the_same_all_over_is_in_balance_at_every_node_of_the_border() {
    const PULL_PA: f32 = 200.0;
    let mesh = in_two(0);
    // By Hooke's law a region gets longer by σ/E, and thinner by ν·σ/E, which is 1 % of either.
    let [below, above] = STUFF.map(|(young_pa, _)| 1.0 + f64::from(PULL_PA) / young_pa);
    let moved = |[x, y, z]: [f32; 3]| {
        let height_m = below * f64::from(z.min(BORDER_M)) + above * f64::from((z - BORDER_M).max(0.0));
        [0.99 * f64::from(x), 0.99 * f64::from(y), height_m].map(|at_m| at_m as f32)
    };
    let shape_m: Vec<[f32; 3]> = mesh.positions_m.iter().map(|place| moved(*place)).collect();
    let is_at =
        |face: &[u32; 3], height_m: f32| face.iter().all(|node| (mesh.positions_m[*node as usize][2] - height_m).abs() < 1e-6);
    let mut ends = boundary(&mesh).triangles;
    ends.retain(|face| is_at(face, 0.0) || is_at(face, TOP_M));
    assert_eq!(ends.len(), 36);
    let mut load_n = vec![[0.0; 3]; shape_m.len()];
    let skipped = pressure_forces(&ends, &mesh.positions_m, &vec![-PULL_PA; ends.len()], &mut load_n);
    assert_eq!(skipped, 0);
    // The pull on the face of one cube, which is what a node within an end has.
    let of_cube_n = f64::from(PULL_PA * EDGE_M * EDGE_M);
    for isa in sets() {
        let largest_n =
            |load_n: &[[f32; 3]]| forces_n(isa, &mesh, &shape_m, load_n).iter().map(|force_n| force_n.norm()).fold(0.0, f64::max);
        let [left, without] = [largest_n(&load_n), largest_n(&[])].map(|force_n| force_n / of_cube_n);
        // Places in single precision leave some 1e-7 of a growth, of which λ makes 0.03 Pa beside 200.
        assert!(left < 5e-3 && (0.9..1.1).contains(&without), "{isa:?}: {left} is left, without the pull {without}");
    }
}
