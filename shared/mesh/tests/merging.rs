//! Parts that touch with whole faces become one by a repair, and what is there twice once; what only meets, lies in each other or is slit stays as it is.

use hyst_mesh::*;

/// A block of cubes with edge 1 from a corner on, six tets each. The sides of cubes are divided alike in all blocks.
fn block([x, y, z]: [u32; 3], low: [f32; 3]) -> TetMesh {
    let node = |at: [u32; 3]| at[0] + (x + 1) * (at[1] + (y + 1) * at[2]);
    let mut mesh = TetMesh::default();
    for index in 0..(x + 1) * (y + 1) * (z + 1) {
        let at = [index % (x + 1), index / (x + 1) % (y + 1), index / (x + 1) / (y + 1)];
        mesh.positions_m.push([0, 1, 2].map(|axis| low[axis] + at[axis] as f32));
    }
    let orders =
        [([0, 1, 2], false), ([1, 2, 0], false), ([2, 0, 1], false), ([0, 2, 1], true), ([1, 0, 2], true), ([2, 1, 0], true)];
    for index in 0..x * y * z {
        for (order, is_odd) in orders {
            let mut at = [index % x, index / x % y, index / x / y];
            let mut tet = [node(at); 4];
            for (corner, axis) in tet[1..].iter_mut().zip(order) {
                at[axis] += 1;
                *corner = node(at);
            }
            if is_odd {
                tet.swap(2, 3);
            }
            mesh.tets.push(tet);
        }
    }
    mesh.regions = vec![0; mesh.tets.len()];
    mesh
}

/// One file with these pieces, each with nodes of its own and a number of its own for its tets.
fn file_of(pieces: &[TetMesh]) -> TetMesh {
    let mut file = TetMesh::default();
    for (piece, number) in pieces.iter().zip(1..) {
        let first = file.positions_m.len() as u32;
        file.positions_m.extend(&piece.positions_m);
        file.tets.extend(piece.tets.iter().map(|tet| tet.map(|node| node + first)));
        file.regions.extend(vec![number; piece.tets.len()]);
    }
    file
}

/// Two blocks of 2 × 2 × 2 cubes with a square between them, on which each has nodes of its own.
fn halves() -> TetMesh {
    file_of(&[block([2; 3], [0.0; 3]), block([2; 3], [2.0, 0.0, 0.0])])
}

/// What a repair does with them: 3 × 3 nodes of 2 × 2 squares, of which the first is the first of the second block.
const HALVES_MERGED: Repair = Repair::MergedNodes { nodes: 9, faces: 8, first: 27 };

#[test]
fn two_half_blocks_with_a_doubled_interface_become_one_and_everything_follows_the_new_numbers() {
    let file = halves();
    assert_eq!((check(&file).components, file.positions_m.len()), (2, 54));
    let repaired = repair(file.clone()).unwrap();
    assert_eq!(repaired.repairs, [HALVES_MERGED]);
    let said = "merged 9 nodes with others at the same places: at 8 faces parts touched without common nodes (first: node 27)";
    assert_eq!(repaired.repairs[0].to_string(), said);
    let found = check(&repaired.mesh);
    assert!(found.is_sound(), "{found}");
    // 2 × 2 squares at each end, 4 × 2 on each of four sides.
    assert_eq!((found.components, found.nodes, found.boundary_triangles), (1, 45, 2 * (2 * 4 + 4 * 8)));
    assert!((found.volume_m3 - 16.0).abs() < 1e-9, "{found}");
    assert_eq!(repaired.mesh.regions, file.regions);
    assert!(repaired.tet_map.iter().zip(0..).all(|(now, tet)| *now == Some(tet)));
    for (node, now) in repaired.node_map.iter().enumerate() {
        assert_eq!(repaired.mesh.positions_m[now.unwrap() as usize], file.positions_m[node], "node {node}");
    }
    for (tet, now) in file.tets.iter().zip(&repaired.mesh.tets) {
        assert_eq!(tet.map(|node| repaired.node_map[node as usize].unwrap()), *now);
    }
    assert!(repair(repaired.mesh).unwrap().repairs.is_empty(), "nothing is left to be merged");
}

#[test]
fn blocks_that_meet_along_an_edge_or_in_a_point_stay_two() {
    for low in [[2.0, 2.0, 0.0], [2.0, 2.0, 2.0]] {
        let file = file_of(&[block([2; 3], [0.0; 3]), block([2; 3], low)]);
        let repaired = repair(file.clone()).unwrap();
        assert!(repaired.repairs.is_empty() && repaired.mesh == file, "{low:?}: {:?}", repaired.repairs);
        assert_eq!(check(&repaired.mesh).components, 2, "{low:?}");
    }
}

#[test]
fn blocks_with_a_gap_other_triangles_between_them_or_that_lie_in_each_other_stay_two() {
    let turned = |mut piece: TetMesh| {
        // Back to front its squares are divided along the other diagonals, and its tets turned inside out.
        piece.positions_m.iter_mut().for_each(|position| position[1] = 2.0 - position[1]);
        piece
    };
    let drawn_out = |mut piece: TetMesh| {
        // Its near side lies on that of the other, and both fill the same side of it.
        piece.positions_m.iter_mut().for_each(|position| position[0] *= 1.5);
        piece
    };
    let others = [
        block([2; 3], [2.001, 0.0, 0.0]),
        turned(block([2; 3], [2.0, 0.0, 0.0])),
        drawn_out(block([2; 3], [0.0; 3])),
        block([2; 3], [0.5, 0.0, 0.0]),
    ];
    for (which, other) in others.into_iter().enumerate() {
        let repaired = repair(file_of(&[block([2; 3], [0.0; 3]), other])).unwrap();
        let is_left_apart = repaired.repairs.iter().all(|repair| matches!(repair, Repair::Flipped { .. }));
        assert!(is_left_apart, "{which}: {:?}", repaired.repairs);
        assert_eq!((check(&repaired.mesh).components, repaired.mesh.positions_m.len()), (2, 54), "{which}");
    }
}

/// It had twice the volume, and a wall that was twice as stiff.
#[test]
fn a_part_that_is_there_twice_with_nodes_of_its_own_is_there_once_and_that_is_said() {
    let whole = block([2; 3], [0.0; 3]);
    let mut again = whole.clone();
    // Its tets come in another order, and some of them inside out.
    again.tets.reverse();
    again.tets.iter_mut().step_by(3).for_each(|tet| tet.swap(0, 1));
    again.positions_m.iter_mut().flatten().filter(|coordinate| **coordinate == 0.0).for_each(|zero| *zero = -1e-17);
    let file = file_of(&[whole.clone(), again]);
    let found = check(&file);
    assert_eq!(found.duplicate, (48..96).collect::<Vec<u32>>());
    assert!(!found.is_sound() && (found.volume_m3 - 16.0).abs() < 1e-9, "{found}");
    let repaired = repair(file).unwrap();
    let dropped = Repair::DroppedDuplicates { tets: 48, first: 48 };
    assert_eq!(repaired.repairs, [dropped, Repair::DroppedUnusedNodes { nodes: 27, first: 27 }]);
    assert_eq!(repaired.repairs[0].to_string(), "dropped 48 tets with the nodes of an earlier one (first: tet 48)");
    assert_eq!((repaired.mesh.positions_m, repaired.mesh.tets), (whole.positions_m, whole.tets));
    assert_eq!(repaired.mesh.regions, [1; 48]);
}

#[test]
fn what_touches_a_part_that_is_there_twice_is_joined_to_it_and_a_part_that_is_there_twice_in_part_to_its_rest() {
    let [whole, beyond] = [0.0, 2.0].map(|low| block([2; 3], [low, 0.0, 0.0]));
    let dropped = |tets: usize, first: u32| Repair::DroppedDuplicates { tets, first };
    let unused = |nodes: usize, first: u32| Repair::DroppedUnusedNodes { nodes, first };
    let merged = |first: u32| Repair::MergedNodes { nodes: 9, faces: 8, first };
    // Of the block that begins in the middle of the other one half is left, and the first of its nodes that touches is the second of the block.
    let cases = [
        (file_of(&[whole.clone(), beyond, whole.clone()]), [dropped(48, 96), merged(27), unused(27, 54)], 16.0),
        (file_of(&[whole, block([2; 3], [1.0, 0.0, 0.0])]), [dropped(24, 48), merged(28), unused(9, 27)], 12.0),
    ];
    for (file, repairs, volume_m3) in cases {
        let repaired = repair(file).unwrap();
        assert_eq!(repaired.repairs, repairs);
        let found = check(&repaired.mesh);
        assert!(found.is_sound() && found.components == 1 && (found.volume_m3 - volume_m3).abs() < 1e-9, "{found}");
    }
}

/// A block of 4 × 4 × 4 cubes with a slit inside: the node in its middle is there twice, and tets on one side of the plane through it have the other one.
fn slit() -> TetMesh {
    let TetMesh { mut positions_m, mut tets, regions } = block([4; 3], [0.0; 3]);
    let middle = positions_m.iter().position(|position| *position == [2.0; 3]).unwrap() as u32;
    let is_beyond = |tet: &[u32; 4]| tet.iter().map(|node| positions_m[*node as usize][0]).sum::<f32>() > 4.0 * 2.0;
    let other = positions_m.len() as u32;
    for tet in tets.iter_mut().filter(|tet| is_beyond(tet)) {
        tet.iter_mut().filter(|node| **node == middle).for_each(|node| *node = other);
    }
    positions_m.push([2.0; 3]);
    TetMesh { positions_m, tets, regions }
}

#[test]
fn a_slit_within_a_part_stays_open_also_where_another_part_is_joined_to_it() {
    let alone = slit();
    // 6 × 16 squares outside, and the six triangles around the middle on each side of the slit.
    let outside = 2 * 6 * 16;
    assert_eq!((check(&alone).components, check(&alone).boundary_triangles), (1, outside + 2 * 6));
    let repaired = repair(alone.clone()).unwrap();
    assert!(repaired.repairs.is_empty() && repaired.mesh == alone, "{:?}", repaired.repairs);

    let repaired = repair(file_of(&[alone, block([4; 3], [4.0, 0.0, 0.0])])).unwrap();
    assert_eq!(repaired.repairs, [Repair::MergedNodes { nodes: 25, faces: 32, first: 126 }]);
    let found = check(&repaired.mesh);
    assert_eq!((found.components, found.boundary_triangles), (1, 2 * outside - 2 * 32 + 2 * 6));
}

#[test]
fn a_mesh_whose_tets_have_nodes_of_their_own_in_any_order_becomes_the_block_that_it_was() {
    let whole = block([3; 3], [0.0; 3]);
    let tets: Vec<TetMesh> = whole
        .tets
        .iter()
        .rev()
        .map(|tet| {
            let positions_m = tet.map(|node| whole.positions_m[node as usize]).to_vec();
            TetMesh { positions_m, tets: vec![[0, 1, 2, 3]], regions: vec![0] }
        })
        .collect();
    let repaired = repair(file_of(&tets)).unwrap();
    // 64 nodes are left; of four faces of each tet 108 are outside, and the others are two by two.
    let [nodes, faces] = [4 * 162 - 64, (4 * 162 - 108) / 2];
    assert!(
        matches!(repaired.repairs[..], [Repair::MergedNodes { nodes: one, faces: other, .. }] if (one, other) == (nodes, faces)),
        "{:?}",
        repaired.repairs
    );
    let found = check(&repaired.mesh);
    assert!(found.is_sound() && (found.components, found.nodes, found.boundary_triangles) == (1, 64, 108), "{found}");
    assert_eq!(repaired.mesh.regions, (1..=162).collect::<Vec<u32>>());
}

#[test]
fn what_is_left_of_a_zero_tets_inside_out_and_flat_tets_between_parts_hinder_no_merge() {
    let mut inside_out = file_of(&[block([2; 3], [-2.0, 0.0, 0.0]), block([2; 3], [0.0; 3])]);
    inside_out.tets[48..].iter_mut().for_each(|tet| tet.swap(0, 1));
    let on_plane = inside_out.positions_m[27..].iter_mut().filter(|position| position[0] == 0.0);
    on_plane.zip([1e-17, -0.0, -1e-17].into_iter().cycle()).for_each(|(position, zero)| position[0] = zero);
    let repaired = repair(inside_out).unwrap();
    assert_eq!(repaired.repairs, [HALVES_MERGED, Repair::Flipped { tets: 48, of: 96 }]);
    assert!(check(&repaired.mesh).is_sound());

    // Three nodes of one block in a line, and one of the other: it joins the two to one part, and is dropped.
    let mut joined = halves();
    joined.tets.push([0, 1, 2, 27]);
    joined.regions.push(0);
    assert_eq!(check(&joined).components, 1);
    let repaired = repair(joined).unwrap();
    assert_eq!(repaired.repairs, [HALVES_MERGED, Repair::DroppedFlat { tets: 1, first: 96 }]);
    assert_eq!(check(&repaired.mesh).components, 1);
}
