//! Promises of `bind` and `evaluate`.

use hyst_mesh::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn corner() -> TetMesh {
    let positions_m = vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    TetMesh { positions_m, tets: vec![[0, 1, 2, 3]], regions: vec![0] }
}

fn points(positions_m: &[[f32; 3]]) -> TriangleMesh {
    TriangleMesh { positions_m: positions_m.to_vec(), triangles: Vec::new() }
}

/// A box of `n` × `n` × `n` cubes of side 1, six tets each.
fn block(n: u32) -> TetMesh {
    let side = n + 1;
    let node = |x: u32, y: u32, z: u32| x + side * (y + side * z);
    let mut mesh = TetMesh::default();
    for index in 0..side * side * side {
        mesh.positions_m.push([(index % side) as f32, (index / side % side) as f32, (index / side / side) as f32]);
    }
    for index in 0..n * n * n {
        let (x, y, z) = (index % n, index / n % n, index / n / n);
        for steps in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]] {
            let mut at = [x, y, z];
            let mut tet = [node(x, y, z); 4];
            for (corner, axis) in tet[1..].iter_mut().zip(steps) {
                at[axis] += 1;
                *corner = node(at[0], at[1], at[2]);
            }
            mesh.tets.push(tet);
        }
    }
    mesh.regions = vec![0; mesh.tets.len()];
    mesh
}

#[test]
fn weights_are_those_of_hand_arithmetic() {
    let (bindings, report) = bind(&points(&[[0.2, 0.3, 0.1], [0., 1., 0.], [-0.5, 0.25, 0.25]]), &corner()).unwrap();
    let expected = [[0.4, 0.2, 0.3, 0.1], [0., 0., 1., 0.], [1.0, -0.5, 0.25, 0.25]];
    for (binding, expected) in bindings.iter().zip(expected) {
        assert_eq!(binding.tet, 0);
        binding.weights.iter().zip(expected).for_each(|(found, expected)| assert!((found - expected).abs() < 1e-6));
    }
    assert_eq!((report.outside, report.farthest_vertex, report.max_outside_m, report.max_weight), (1, 2, 0.5, 1.0));
}

#[test]
fn a_bound_point_follows_an_affine_motion() {
    let mesh = block(3);
    let surface = points(&[[0.3, 1.7, 2.2], [2.9, 0.1, 0.4], [3.5, 1.0, 1.0]]);
    let (bindings, _) = bind(&surface, &mesh).unwrap();
    let motion = |[x, y, z]: [f32; 3]| [2.0 * x + y - 1.0, y - 0.5 * z, x + 3.0 * z + 2.0];
    let moved: Vec<[f32; 3]> = mesh.positions_m.iter().map(|&p| motion(p)).collect();
    let mut out_m = [[0.0; 3]; 3];
    evaluate(&bindings, &mesh.tets, &moved, &mut out_m);
    for (found, &rest) in out_m.iter().zip(&surface.positions_m) {
        found.iter().zip(motion(rest)).for_each(|(found, expected)| assert!((found - expected).abs() < 1e-4));
    }
}

#[test]
fn every_vertex_of_the_boundary_is_inside() {
    let mesh = block(4);
    let (surface, _) = boundary(&mesh).to_mesh(&mesh.positions_m);
    let (bindings, report) = bind(&surface, &mesh).unwrap();
    assert_eq!((bindings.len(), report.outside), (98, 0)); // 5³ − 3³ nodes
    assert_eq!(report.max_weight, 1.0);
}

#[test]
fn of_equally_near_tets_the_lowest_index_counts() {
    let mesh = block(2);
    let (bindings, _) = bind(&points(&[[1.0, 1.0, 1.0]]), &mesh).unwrap(); // the node in the middle, in many tets
    let first = mesh.tets.iter().position(|tet| tet.contains(&13)).unwrap();
    assert_eq!(bindings[0].tet as usize, first);
}

#[test]
fn a_flat_tet_is_avoided() {
    let mut mesh = corner();
    mesh.positions_m.push([0.3, 0.3, -1e-6]);
    mesh.tets.insert(0, [0, 2, 1, 4]);
    let (bindings, report) = bind(&points(&[[0.3, 0.3, -5e-7]]), &mesh).unwrap();
    assert_eq!((bindings[0].tet, report.flat_tets_avoided), (1, 1));
    assert!(report.max_weight < 1.0);
}

#[test]
fn what_cannot_be_bound_is_an_error() {
    let mut flat = corner();
    flat.positions_m[3] = [0.5, 0.5, 0.0];
    let mut far = corner();
    far.tets[0][0] = 9;
    let one = points(&[[0.0; 3]]);
    assert_eq!(bind(&one, &flat).unwrap_err(), BindError::NoVolume { tets: 1 });
    assert_eq!(bind(&one, &TetMesh::default()).unwrap_err(), BindError::NoVolume { tets: 0 });
    assert_eq!(bind(&one, &far).unwrap_err(), BindError::OutOfRange { tet: 0 });
    let nan = points(&[[0.0; 3], [0.0, f32::NAN, 0.0]]);
    assert_eq!(bind(&nan, &corner()).unwrap_err(), BindError::NotFinite { what: "surface vertex", index: 1 });
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(4), failure_persistence: None, ..ProptestConfig::default() })]

    /// The tree finds the tet that looking at each tet alone finds.
    #[test]
    fn the_nearest_tet_is_the_nearest_of_all(x in -2.0..5.0_f32, y in -2.0..5.0_f32, z in -2.0..5.0_f32) {
        let mesh = block(3);
        let surface = points(&[[x, y, z]]);
        let (_, report) = bind(&surface, &mesh).unwrap();
        let distance = |&tet: &[u32; 4]| {
            let single = TetMesh { positions_m: mesh.positions_m.clone(), tets: vec![tet], regions: vec![0] };
            bind(&surface, &single).unwrap().1.max_outside_m
        };
        let nearest = mesh.tets.iter().map(distance).fold(f32::INFINITY, f32::min);
        prop_assert_eq!(report.max_outside_m, nearest);
        let beyond = [x, y, z].map(|c| (c - c.clamp(0.0, 3.0)).powi(2)).iter().sum::<f32>().sqrt();
        prop_assert!((report.max_outside_m - beyond).abs() < 1e-5);
    }
}
