//! Promises of `check`, `repair` and `boundary`, by hand arithmetic on meshes of a few tets.

use hyst_mesh::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// One tet with edges 1 along the axes: volume 1/6.
fn corner() -> TetMesh {
    mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]], &[[0, 1, 2, 3]])
}

fn mesh(positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> TetMesh {
    TetMesh { positions_m: positions_m.to_vec(), tets: tets.to_vec(), regions: (0..tets.len() as u32).collect() }
}

/// The unit cube in five tets, one of them inverted if asked.
fn cube() -> TetMesh {
    let positions: Vec<[f32; 3]> = (0..8).map(|i| [(i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32]).collect();
    mesh(&positions, &[[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]])
}

#[test]
fn a_single_tet_has_the_figures_of_hand_arithmetic() {
    let report = check(&corner());
    assert_eq!((report.nodes, report.tets, report.components, report.boundary_triangles), (4, 1, 1, 4));
    assert_eq!((report.min_m, report.max_m), ([0.0; 3], [1.0; 3]));
    assert!((report.volume_m3 - 1.0 / 6.0).abs() < 1e-15);
    // six edges: three of 1, three of √2, mean square 3/2; 6 √2 / 6 / (3/2)^1.5 = 0.7698
    assert!((report.worst.unwrap().1 - 2.0_f64.sqrt() / 1.5_f64.powf(1.5)).abs() < 1e-12);
    assert!(report.is_sound());
}

#[test]
fn a_regular_tet_has_quality_one() {
    let regular = mesh(&[[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]], &[[0, 1, 2, 3]]);
    assert!((check(&regular).worst.unwrap().1 - 1.0).abs() < 1e-12);
}

#[test]
fn the_boundary_points_outwards_whatever_the_orientation_of_the_tets() {
    for swap in [false, true] {
        let mut cube = cube();
        if swap {
            cube.tets.iter_mut().step_by(2).for_each(|tet| tet.swap(0, 1));
        }
        let surface = boundary(&cube);
        assert_eq!(surface.triangles.len(), 12);
        // the divergence theorem: the sum of a · (b × c) / 6 is the enclosed volume, positive if outward
        let at = |node: u32| cube.positions_m[node as usize];
        let volume: f32 = surface
            .triangles
            .iter()
            .map(|&[a, b, c]| {
                let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (at(a), at(b), at(c));
                (ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)) / 6.0
            })
            .sum();
        assert_eq!(volume, 1.0);
        for (triangle, &tet) in surface.triangles.iter().zip(&surface.tet_of_triangle) {
            assert!(triangle.iter().all(|node| cube.tets[tet as usize].contains(node)));
        }
    }
}

#[test]
fn a_boundary_mesh_has_only_the_nodes_of_the_boundary() {
    let mut mesh = corner();
    mesh.positions_m.insert(0, [9.0; 3]);
    mesh.tets = vec![[1, 2, 3, 4]];
    let (surface, nodes) = boundary(&mesh).to_mesh(&mesh.positions_m);
    assert_eq!(nodes, [1, 2, 3, 4]);
    assert_eq!(surface.positions_m, mesh.positions_m[1..]);
    assert!(surface.triangles.as_flattened().iter().all(|&vertex| vertex < 4));
}

#[test]
fn repair_flips_drops_and_says_so() {
    let mut bad = corner();
    bad.positions_m.insert(0, [7.0; 3]); // used by nobody
    bad.positions_m.push([1., 1., 0.]);
    bad.tets = vec![[1, 3, 2, 4], [4, 1, 2, 3], [1, 2, 3, 5], [2, 5, 3, 4]]; // inverted; a duplicate; flat; good
    bad.regions = vec![10, 11, 12, 13];
    let report = check(&bad);
    assert_eq!((report.duplicate.as_slice(), report.flat.as_slice()), (&[1][..], &[2][..]));
    assert_eq!((report.inverted.contains(&0), report.unused_nodes.as_slice()), (true, &[0][..]));

    let repaired = repair(bad).unwrap();
    assert_eq!(repaired.mesh.tets, [[0, 2, 3, 1].map(|n: u32| n), [1, 4, 2, 3]]);
    assert_eq!(repaired.mesh.regions, [10, 13]);
    assert_eq!(repaired.node_map, [None, Some(0), Some(1), Some(2), Some(3), Some(4)]);
    assert_eq!(repaired.tet_map, [Some(0), None, None, Some(1)]);
    assert_eq!(
        repaired.repairs,
        [
            Repair::DroppedDuplicates { tets: 1, first: 1 },
            Repair::DroppedFlat { tets: 1, first: 2 },
            Repair::Flipped { tets: 1, of: 2 },
            Repair::DroppedUnusedNodes { nodes: 1, first: 0 },
        ]
    );
    assert_eq!(repaired.repairs[0].to_string(), "dropped 1 tet with the nodes of an earlier one (first: tet 1)");
    assert!(check(&repaired.mesh).is_sound());
}

#[test]
fn a_sound_mesh_is_left_as_it_is() {
    let repaired = repair(cube()).unwrap();
    assert!(repaired.repairs.is_empty());
    assert_eq!(repaired.mesh, cube());
}

/// Two edges of 1 m that cross at a right angle, at a distance: a sixth of that is the volume, m³, of which 1.5e-8 may be rounding.
#[test]
fn a_sliver_that_no_model_could_be_made_of_is_dropped_whichever_way_round_it_is() {
    for (height_m, is_kept) in [(3e-7, false), (5e-7, false), (7e-7, true)] {
        for sign in [1.0, -1.0] {
            let z = sign * height_m;
            let mut sliver = corner();
            sliver.positions_m.extend([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, -0.5, z], [0.0, 0.5, z]]);
            sliver.tets.push([4, 5, 6, 7]);
            sliver.regions.push(1);
            let repaired = repair(sliver).unwrap();
            assert_eq!(repaired.tet_map, [Some(0), is_kept.then_some(1)], "{z} m");
            let is_dropped = repaired.repairs.contains(&Repair::DroppedFlat { tets: 1, first: 1 });
            assert!(is_dropped != is_kept, "{z} m: {:?}", repaired.repairs);
        }
    }
}

#[test]
fn a_nearly_flat_tet_is_kept_and_said() {
    let mut flat = corner();
    flat.positions_m[3] = [0.3, 0.3, 1e-4];
    let repaired = repair(flat).unwrap();
    assert!(matches!(repaired.repairs[..], [Repair::KeptFlat { tets: 1, worst: 0, worst_quality }] if worst_quality > 0.0));
    assert_eq!(repaired.mesh.tets.len(), 1);
}

#[test]
fn what_no_repair_can_cure_is_an_error_and_check_survives_it() {
    let mut nan = corner();
    nan.positions_m[2][1] = f32::NAN;
    let mut far = corner();
    far.tets[0][3] = 4;
    let mut flat = corner();
    flat.positions_m[3][2] = 0.0;
    let mut regions = corner();
    regions.regions.clear();
    assert_eq!((check(&nan).not_finite, check(&far).out_of_range), (vec![2], vec![0]));
    assert_eq!(repair(nan), Err(RepairError::NotFinite { node: 2 }));
    assert_eq!(repair(far), Err(RepairError::OutOfRange { tet: 0, node: 4, nodes: 4 }));
    assert_eq!(repair(flat), Err(RepairError::NothingLeft { tets: 1 }));
    assert_eq!(repair(regions), Err(RepairError::Regions { regions: 0, tets: 1 }));
    assert_eq!(repair(TetMesh::default()), Err(RepairError::NoTets));
    assert_eq!(check(&TetMesh::default()).components, 0);
}

const FIVE: [[f32; 3]; 7] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [-1., 0., 0.], [0., -1., 0.], [0., 0., -1.]];

#[test]
fn tets_that_touch_in_a_node_or_an_edge_are_no_manifold() {
    let node = check(&mesh(&FIVE, &[[0, 1, 2, 3], [0, 5, 4, 6]]));
    assert_eq!((node.components, node.non_manifold_vertices, node.non_manifold_edges), (1, 1, 0));
    let edge = check(&mesh(&FIVE, &[[0, 1, 2, 3], [0, 4, 5, 3]]));
    assert_eq!((edge.components, edge.non_manifold_edges, edge.open_edges), (1, 1, 0));
}

#[test]
fn a_face_of_three_tets_is_crowded_and_leaves_the_boundary_open() {
    let positions = [FIVE[0], FIVE[1], FIVE[2], FIVE[3], [0., 0., -1.], [0.1, 0.1, 2.]];
    let report = check(&mesh(&positions, &[[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]]));
    assert_eq!((report.crowded_faces, report.boundary_triangles), (1, 9));
    assert_eq!((report.open_edges, report.non_manifold_edges), (0, 3)); // each edge of that face has three
}

/// Who exported a part twice was told that his mesh is refused with many such faces, though it is not.
#[test]
fn what_is_there_twice_or_has_no_volume_crowds_no_face() {
    let mut twice = cube();
    twice.tets.extend(cube().tets);
    twice.regions.extend(cube().regions);
    let found = check(&twice);
    assert_eq!((found.duplicate.len(), found.crowded_faces, found.open_edges), (5, 0, 0));
    let positions = [FIVE[0], FIVE[1], FIVE[2], FIVE[3], FIVE[6], [1., 1., 0.]];
    let found = check(&mesh(&positions, &[[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]]));
    assert_eq!((found.flat.as_slice(), found.crowded_faces, found.open_edges), (&[2][..], 0, 0));
}

/// A tet on each side of a face, one beside them that closes the way round the face's first edge, and one that lies in the first.
fn overlapping() -> TetMesh {
    let positions_m = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0.2, -0.5, 1.], [0.2, -0.5, -1.], [0.1, 0.1, 2.]];
    mesh(&positions_m, &[[0, 1, 2, 3], [0, 2, 1, 4], [0, 3, 1, 4], [0, 1, 2, 5]])
}

#[test]
fn a_tet_that_lies_in_another_is_dropped_and_closes_the_boundary() {
    let open = overlapping();
    assert_eq!((check(&open).crowded_faces, check(&open).open_edges), (1, 1));
    let repaired = repair(open.clone()).unwrap();
    let said = "dropped 1 tet on that side of a face on which another lies (first: tet 3): tets lay in each other";
    assert_eq!(repaired.repairs[0], Repair::DroppedOverlapping { tets: 1, first: 3 });
    assert_eq!(repaired.repairs[0].to_string(), said);
    assert_eq!(repaired.tet_map, [Some(0), Some(1), Some(2), None]);
    assert!(check(&repaired.mesh).is_sound(), "{}", check(&repaired.mesh));
    // Whichever comes first, the one that hangs on a single face goes: without the good one there a void would be left around it.
    for turn in 1..4 {
        let mut turned = open.clone();
        turned.tets.rotate_left(turn);
        let repaired = repair(turned.clone()).unwrap();
        let stray = turned.tets.iter().position(|tet| *tet == [0, 1, 2, 5]).unwrap();
        assert_eq!(repaired.repairs[0], Repair::DroppedOverlapping { tets: 1, first: stray as u32 }, "{turn}");
        assert!(repaired.tet_map.iter().enumerate().all(|(tet, now)| now.is_some() == (tet != stray)), "{turn}");
        let found = check(&repaired.mesh);
        assert_eq!((found.tets, found.crowded_faces, found.open_edges), (3, 0, 0), "{turn}");
    }
}

#[test]
fn a_mesh_of_which_many_tets_lie_in_others_is_refused() {
    let many = |count: u32| {
        let mut all = TetMesh::default();
        for at in 0..count {
            let one = overlapping();
            all.positions_m.extend(one.positions_m.iter().map(|[x, y, z]| [x + 3.0 * at as f32, *y, *z]));
            all.tets.extend(one.tets.iter().map(|tet| tet.map(|node| node + 6 * at)));
            all.regions.extend(one.regions);
        }
        all
    };
    assert_eq!(repair(many(8)).unwrap().repairs[0], Repair::DroppedOverlapping { tets: 8, first: 3 });
    let refused = repair(many(9)).unwrap_err();
    assert_eq!(refused, RepairError::Overlapping { tets: 9, of: 36, first: 3 });
    assert!(refused.to_string().starts_with("of 36 tets 9 lie in others"), "{refused}");
    assert!(refused.to_string().contains("export again") && !refused.to_string().contains('\n'), "{refused}");
}

#[test]
fn components_are_numbered_in_the_order_of_their_first_tets() {
    let mut two = corner();
    let second = corner();
    two.positions_m.extend(second.positions_m.iter().map(|[x, y, z]| [x + 5.0, *y, *z]));
    two.tets = vec![[4, 5, 6, 7], [0, 1, 2, 3]];
    two.regions = vec![0, 0];
    assert_eq!(component_of_each_tet(&two), [0, 1]);
    assert_eq!(check(&two).components, 2);
    let (surface, _) = boundary(&two).to_mesh(&two.positions_m);
    assert_eq!(component_of_each_triangle(&surface), [0, 0, 0, 0, 1, 1, 1, 1]);
}

#[test]
fn the_unit_is_the_one_that_gives_the_expected_size() {
    assert_eq!(guess_unit(80.0, 0.08), Unit::Millimetre);
    assert_eq!(guess_unit(6.5, 0.1), Unit::Centimetre);
    assert_eq!(guess_unit(0.2, 0.1), Unit::Metre);
    assert_eq!(guess_unit(f32::NAN, 0.1), Unit::Metre);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    /// In whatever order tets come, what hangs together is what a search from tet to tet finds.
    #[test]
    fn components_are_what_a_search_finds(tets in prop::collection::vec(prop::array::uniform4(0..200_u32), 0..60)) {
        let mesh = mesh(&[[0.0; 3]; 200], &tets);
        let mut expected: Vec<Option<u32>> = vec![None; tets.len()];
        let mut components = 0..;
        for first in 0..tets.len() {
            let mut next = if expected[first].is_none() { vec![first] } else { Vec::new() };
            let number = if next.is_empty() { None } else { components.next() };
            while let Some(tet) = next.pop() {
                expected[tet] = number;
                let touches = |other: &usize| expected[*other].is_none() && tets[*other].iter().any(|node| tets[tet].contains(node));
                next.extend((0..tets.len()).filter(touches));
            }
        }
        let found: Vec<Option<u32>> = component_of_each_tet(&mesh).into_iter().map(Some).collect();
        prop_assert_eq!(found, expected);
    }
}
