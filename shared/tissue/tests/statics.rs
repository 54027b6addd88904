//! Equilibria against references: the theory of a bar, a linear solve on the same mesh in double precision, the theory of a beam.

mod common;

use common::{Body, block, options};
use hyst_mesh::TetMesh;
use hyst_tissue::{Material, Model, pressure_forces};

/// The triangles of the faces z = 0 and z = top, counter-clockwise from outside.
fn end_faces(mesh: &TetMesh, axis: usize, top: f32) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for [a, b, c, d] in &mesh.tets {
        for face in [[*a, *c, *b], [*a, *b, *d], [*a, *d, *c], [*b, *c, *d]] {
            let at = face.map(|node| mesh.positions_m[node as usize][axis]);
            if at.iter().all(|&x| x == 0.0) || at.iter().all(|&x| (x - top).abs() < 1e-6) {
                triangles.push(face);
            }
        }
    }
    triangles
}

/// How far a free block of cubes of 4 mm reaches along each axis once it is at rest, pulled on both ends of some of them, m.
fn pulled_m(cells: [u32; 3], material: &Material, pull_pa: f64, axes: &[usize]) -> [f64; 3] {
    const EDGE_M: f32 = 0.004;
    let mesh = block(cells, EDGE_M);
    let (model, _) = Model::new(&mesh, &vec![false; mesh.positions_m.len()], material, options()).unwrap();
    let mut body = Body::new(model);
    for &axis in axes {
        let faces = end_faces(&mesh, axis, cells[axis] as f32 * EDGE_M);
        assert_eq!(faces.len(), 36);
        // Seen from outside, so that a negative pressure pulls on both ends.
        let skipped = pressure_forces(&faces, &mesh.positions_m, &vec![-pull_pa as f32; faces.len()], &mut body.force_n);
        assert_eq!(skipped, 0);
    }
    for _ in 0..1500 {
        body.step();
    }
    let last = mesh.positions_m.len() - 1;
    [0, 1, 2].map(|axis| f64::from(body.position_m[last][axis] - body.position_m[0][axis]))
}

#[test]
fn a_bar_under_tension_stretches_and_thins_by_theory() {
    [0.0, 0.4, 0.46, 0.49].into_iter().for_each(bar_under_tension);
}

fn bar_under_tension(nu: f64) {
    let (young, pull_pa) = (10_000.0, 200.0);
    let extent_m = pulled_m([3, 3, 6], &Material::new(young, nu, 1000.0, 80.0).unwrap(), pull_pa, &[2]);
    let strain = extent_m[2] / 0.024 - 1.0;
    let thinning = extent_m[0] / 0.012 - 1.0;
    let expected = pull_pa / young;
    assert!((strain / expected - 1.0).abs() < 0.003, "ν = {nu}: strain {strain}, theory {expected}");
    let off = thinning + nu * expected;
    assert!(off.abs() < 0.002 * expected, "ν = {nu}: thinning {thinning}, theory {}", -nu * expected);
}

#[test]
fn a_block_that_is_pulled_on_all_sides_grows_by_its_bulk_modulus() {
    // Pulled and not pressed: forces that stay as they are would turn a free block that is pressed.
    let (young, pull_pa) = (10_000.0, 1_000.0);
    for nu in [0.3, 0.45, 0.46, 0.49] {
        let extent_m = pulled_m([3, 3, 3], &Material::new(young, nu, 1000.0, 80.0).unwrap(), pull_pa, &[0, 1, 2]);
        let expected = pull_pa * (1.0 - 2.0 * nu) / young;
        for (axis, extent_m) in extent_m.into_iter().enumerate() {
            let grown = extent_m / 0.012 - 1.0;
            assert!((grown / expected - 1.0).abs() < 0.01, "ν = {nu}, axis {axis}: {grown}, theory {expected}");
        }
    }
}

/// Linear elasticity on the same mesh: applies K to `u` (3 per node), nodes that `fixed` names stay 0. With `frozen` the shear
/// part takes the whole gradient instead of its symmetric part: the stiffness while rotations are frozen, at its largest.
fn apply_linear(frozen: bool, mesh: &TetMesh, fixed: &[bool], mu: f64, lambda: f64, u: &[f64]) -> Vec<f64> {
    use nalgebra::{Matrix3, Vector3};
    let mut out = vec![0.0; u.len()];
    for tet in &mesh.tets {
        let x = tet.map(|node| Vector3::from(mesh.positions_m[node as usize].map(f64::from)));
        let edges = Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]);
        let (inverse, volume) = (edges.try_inverse().unwrap(), edges.determinant() / 6.0);
        let at = tet.map(|node| Vector3::from_row_slice(&u[3 * node as usize..][..3]));
        let gradient = Matrix3::from_columns(&[at[1] - at[0], at[2] - at[0], at[3] - at[0]]) * inverse;
        let symmetric = (gradient + gradient.transpose()) * 0.5;
        let strain = if frozen { gradient } else { symmetric };
        let stress = strain * (2.0 * mu) + Matrix3::identity() * (lambda * strain.trace());
        let forces = stress * inverse.transpose() * volume;
        for corner in 1..4 {
            for axis in 0..3 {
                out[3 * tet[corner] as usize + axis] += forces[(axis, corner - 1)];
                out[3 * tet[0] as usize + axis] -= forces[(axis, corner - 1)];
            }
        }
    }
    out.chunks_mut(3).zip(fixed).filter(|(_, fixed)| **fixed).for_each(|(row, _)| row.fill(0.0));
    out
}

/// The same with frozen rotations, where the mean dilation about each node is what λ resists.
fn apply_by_nodes(mesh: &TetMesh, fixed: &[bool], mu: f64, lambda: f64, u: &[f64]) -> Vec<f64> {
    use nalgebra::Vector3;
    let (mut grown, mut volumes) = (vec![0.0; fixed.len()], vec![0.0; fixed.len()]);
    for tet in &mesh.tets {
        let (gradients, volume) = common::gradients(mesh, tet);
        let at = |corner: usize| Vector3::from_row_slice(&u[3 * tet[corner] as usize..][..3]);
        let dilation: f64 = (0..4).map(|corner| gradients[corner].dot(&at(corner))).sum();
        tet.iter().for_each(|&node| grown[node as usize] += dilation * volume);
        tet.iter().for_each(|&node| volumes[node as usize] += volume);
    }
    let mut out = apply_linear(true, mesh, fixed, mu, 0.0, u);
    for tet in &mesh.tets {
        let (gradients, volume) = common::gradients(mesh, tet);
        let pressure = tet.iter().map(|&node| lambda * grown[node as usize] / volumes[node as usize] / 4.0).sum::<f64>();
        for (&node, gradient) in tet.iter().zip(&gradients).filter(|(node, _)| !fixed[**node as usize]) {
            (0..3).for_each(|axis| out[3 * node as usize + axis] += pressure * volume * gradient[axis]);
        }
    }
    out
}

/// Conjugate gradients to a relative residual of 1e-10.
fn solve_linear(mesh: &TetMesh, fixed: &[bool], material: &Material, force: &[f64]) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut u = vec![0.0; force.len()];
    let (mut residual, mut direction) = (force.to_vec(), force.to_vec());
    let mut size = dot(&residual, &residual);
    let stop = size * 1e-20;
    for _ in 0..20_000 {
        if size <= stop {
            return u;
        }
        let image = apply_linear(false, mesh, fixed, material.shear_modulus_pa(), material.lame_lambda_pa(), &direction);
        let length = size / dot(&direction, &image);
        u.iter_mut().zip(&direction).for_each(|(u, d)| *u += length * d);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= length * i);
        let new = dot(&residual, &residual);
        direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + new / size * *d);
        size = new;
    }
    panic!("the reference did not converge");
}

#[test]
fn a_cantilever_agrees_with_the_linear_solve_and_with_beam_theory() {
    let (length, side, load_n) = (0.03, 0.006, 2e-4);
    let mesh = block([4, 4, 20], 0.0015);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let material = Material::new(100_000.0, 0.3, 1000.0, 120.0).unwrap();
    let (model, _) = Model::new(&mesh, &fixed, &material, options()).unwrap();
    let mut body = Body::new(model);
    let tip: Vec<usize> = (0..mesh.positions_m.len()).filter(|&i| mesh.positions_m[i][2] > 0.0299).collect();
    let mut force = vec![0.0; 3 * mesh.positions_m.len()];
    for &node in &tip {
        force[3 * node] = load_n / tip.len() as f64;
        body.force_n[node][0] = (load_n / tip.len() as f64) as f32;
    }
    for _ in 0..1500 {
        body.step();
    }
    let reference = solve_linear(&mesh, &fixed, &material, &force);
    let mean = |value: &dyn Fn(usize) -> f64| tip.iter().map(|&node| value(node)).sum::<f64>() / tip.len() as f64;
    let deflection = mean(&|node| f64::from(body.position_m[node][0] - mesh.positions_m[node][0]));
    let linear = mean(&|node| reference[3 * node]);
    assert!((deflection / linear - 1.0).abs() < 0.01, "deflection {deflection} m, linear solve {linear} m");
    let inertia: f64 = f64::powi(side, 4) / 12.0;
    let beam = load_n * f64::powi(length, 3) / (3.0 * 100_000.0 * inertia);
    assert!((0.75..1.1).contains(&(deflection / beam)), "deflection {deflection} m, beam theory {beam} m");
}

#[test]
fn the_bound_on_the_step_is_above_the_largest_eigenvalue_and_not_far() {
    let mut mesh = block([4, 4, 4], 0.003);
    let mut random = common::noise(5);
    // Where nodes hold the volume of their tets the bound is that of tets which hold their own.
    for (jitter_m, nu, most) in [(0.0, 0.45, 1.6), (0.0, 0.49, 3.0), (0.0006, 0.45, 1.6), (0.0006, 0.49, 3.0)] {
        mesh.positions_m.iter_mut().flatten().for_each(|x| *x += jitter_m * random());
        let fixed: Vec<bool> = (0..mesh.positions_m.len()).map(|node| node < 25).collect();
        let material = Material::new(10_000.0, nu, 1000.0, 0.0).unwrap();
        let (model, report) = Model::new(&mesh, &fixed, &material, options()).unwrap();
        let (mu, lambda) = (material.shear_modulus_pa(), material.lame_lambda_pa());
        // Power iteration on the inverse mass times the stiffness; its Rayleigh quotient approaches from below.
        let mut u: Vec<f64> = (0..3 * fixed.len()).map(|_| f64::from(random())).collect();
        let mut squared = 0.0;
        for _ in 0..400 {
            let image = match nu > 0.45 {
                true => apply_by_nodes(&mesh, &fixed, mu, lambda, &u),
                false => apply_linear(true, &mesh, &fixed, mu, lambda, &u),
            };
            let mass = |i: usize| f64::from(model.mass_kg()[i / 3]);
            let energy: f64 = u.iter().zip(&image).map(|(u, k)| u * k).sum();
            squared = energy / u.iter().enumerate().map(|(i, u)| mass(i) * u * u).sum::<f64>();
            u = image.iter().enumerate().map(|(i, k)| k / mass(i)).collect();
            let size = u.iter().map(|u| u * u).sum::<f64>().sqrt();
            u.iter_mut().for_each(|u| *u /= size);
        }
        let usual = report.omega_rest_per_s / squared.sqrt();
        assert!((0.95..1.01).contains(&usual), "ν = {nu}, jitter {jitter_m} m: {usual} times the largest frequency");
        let ratio = report.omega_max_per_s / squared.sqrt();
        assert!((1.0..most).contains(&ratio), "ν = {nu}, jitter {jitter_m} m: the bound is {ratio} times the largest frequency");
    }
}
