//! Cuts that pass through everything part everything, however the wire gets there; and what a cut has to leave alone.

mod common;

use common::block;
use common::cuts::{bar, momentum, parts, shape, shipped, straight, sweep};
use glam::{Quat, Vec3};
use hyst_mesh::{TetMesh, check, component_of_each_tet};
use hyst_tissue::{CutOptions, CutReport, Cuttable, cut};

/// Numbers from −1 to 1.
fn direction(random: &mut impl FnMut() -> f32) -> Vec3 {
    Vec3::new(random(), random(), random()).normalize_or(Vec3::X)
}

/// Places of a wire that passes through all of a mesh near its middle: three times as long as the mesh, straight or bent a little.
fn complete(mesh: &TetMesh, steps: u32, is_bent: bool, random: &mut impl FnMut() -> f32) -> Vec<Vec<[f32; 3]>> {
    let found = check(mesh);
    let (low, high) = (Vec3::from_array(found.min_m), Vec3::from_array(found.max_m));
    let reach = (high - low).length();
    let middle = 0.5 * (low + high) + 0.15 * (high - low) * Vec3::new(random(), random(), random());
    let wire = direction(random);
    let way = direction(random).reject_from_normalized(wire).normalize_or(wire.any_orthonormal_vector());
    let bend = if is_bent { 0.3 * reach * wire.cross(way) } else { Vec3::ZERO };
    let point = |step: u32, index: i32| {
        let along = index as f32 / 6.0;
        let across = -0.75 + 1.5 * step as f32 / steps as f32;
        (middle + 1.5 * reach * wire * along + reach * way * across + bend * along * along).to_array()
    };
    (0..=steps).map(|step| (-6..=6).map(|index| point(step, index)).collect()).collect()
}

/// Complete sweeps through a mesh, each in 1, 10 and 100 steps; tells how many left one part.
fn leaks(mesh: &TetMesh, strokes: u64, bend_body: bool) -> (usize, usize) {
    let whole = parts(mesh);
    let (mut all, mut leaky) = (0, 0);
    for seed in 0..strokes {
        for steps in [1, 10, 100] {
            let mut random = common::noise(1_000 * seed + steps as u64);
            let mut tissue = Cuttable::at_rest(mesh.clone());
            let mut places = complete(mesh, steps, seed % 2 == 1, &mut random);
            if bend_body {
                // turned and bent about an axis: both the body and the wire, so that the wire still passes through
                let turn = Quat::from_axis_angle(direction(&mut random), 1.0);
                let size = Vec3::from_array(check(mesh).max_m).length().max(1e-3);
                let bend = |point: &mut [f32; 3]| {
                    let place = turn * Vec3::from_array(*point);
                    *point = (place + Vec3::Z * 0.4 * place.x * place.x / size).to_array();
                };
                tissue.position_m.iter_mut().for_each(bend);
                places.iter_mut().flatten().for_each(bend);
            }
            for wire in &places {
                cut(&mut tissue, wire, &CutOptions { min_piece_m3: 0.0, ..CutOptions::default() }).unwrap();
            }
            all += 1;
            leaky += usize::from(parts(&tissue.rest) == whole);
        }
    }
    println!("{leaky} of {all} complete sweeps left the tissue in one piece");
    (leaky, all)
}

#[test]
fn a_wire_that_passes_through_everything_parts_it_in_however_many_steps() {
    for (name, strokes) in [("polyp.msh", 20), ("myoma.msh", 16), ("uterus.msh", 2)] {
        assert_eq!(leaks(&shipped(name), strokes, false).0, 0, "{name}");
    }
}

#[test]
fn a_bent_body_is_parted_as_well() {
    assert_eq!(leaks(&shipped("polyp.msh"), 40, true).0, 0);
}

#[test]
fn a_wire_that_goes_back_or_rocks_parts_it_as_well() {
    for (name, mesh) in [("bar", bar().rest), ("polyp", shipped("polyp.msh")), ("myoma", shipped("myoma.msh"))] {
        for seed in 0..6 {
            let mut random = common::noise(seed);
            let forward = complete(&mesh, 40, false, &mut random);
            // three forward and two back
            let mut back_and_forth: Vec<usize> =
                (0..40).flat_map(|start| [start, start + 1, start + 2, start + 3, start + 2]).collect();
            back_and_forth.retain(|place| *place <= 40);
            back_and_forth.push(40);
            let mut tissue = Cuttable::at_rest(mesh.clone());
            let places: Vec<_> = back_and_forth.iter().map(|place| forward[*place].clone()).collect();
            sweep(&mut tissue, &places, &CutOptions::default());
            assert!(parts(&tissue.rest) > 1, "{name}, seed {seed}: forward and back");
            // one end first, then the other
            let mut tissue = Cuttable::at_rest(mesh.clone());
            let rocks = |step: usize| -> Vec<[f32; 3]> {
                let place = |index: usize| {
                    let ahead = if (step + usize::from(index > 6)).is_multiple_of(2) { 2 } else { 0 };
                    Vec3::from_array(forward[(step + ahead).min(40)][index])
                };
                let (first, last) = (place(0), place(12));
                (0..=12).map(|index| first.lerp(last, index as f32 / 12.0).to_array()).collect()
            };
            sweep(&mut tissue, &(0..=40).map(rocks).collect::<Vec<_>>(), &CutOptions::default());
            assert!(parts(&tissue.rest) > 1, "{name}, seed {seed}: rocking");
        }
    }
}

#[test]
fn a_sweep_half_way_parts_nothing_and_opens_nothing_before_the_wire() {
    for (name, mesh) in [("bar", bar().rest), ("polyp", shipped("polyp.msh"))] {
        for seed in 0..12 {
            let mut random = common::noise(seed);
            let places = complete(&mesh, 20, seed % 2 == 1, &mut random);
            let mut tissue = Cuttable::at_rest(mesh.clone());
            let nodes = mesh.positions_m.len();
            for half in [10, 11] {
                for wire in &places[..half] {
                    cut(&mut tissue, wire, &CutOptions::default()).unwrap();
                }
                tissue.end_stroke();
            }
            assert_eq!(parts(&tissue.rest), parts(&mesh), "{name}, seed {seed}");
            let way = Vec3::from_array(places[20][6]) - Vec3::from_array(places[0][6]);
            let front = Vec3::from_array(places[10][6]).dot(way.normalize());
            let copied = tissue.position_m[nodes..].iter().map(|point| Vec3::from_array(*point).dot(way.normalize()));
            let farthest = copied.fold(f32::MIN, f32::max);
            assert!(farthest <= front + 1e-3, "{name}, seed {seed}: a node {} m before the wire", farthest - front);
        }
    }
}

#[test]
fn tissue_that_is_pushed_through_a_wire_is_cut_by_it() {
    let mut tissue = bar();
    let wire = [[0.017, -0.002, 0.014], [0.017, 0.006, 0.014], [0.017, 0.014, 0.014]];
    for _ in 0..32 {
        cut(&mut tissue, &wire, &CutOptions::default()).unwrap();
        tissue.position_m.iter_mut().for_each(|p| p[2] += 0.0005);
    }
    cut(&mut tissue, &wire, &CutOptions::default()).unwrap();
    assert_eq!(parts(&tissue.rest), 2);
}

/// How far a chip goes in a tick, m: it sinks with 42 mm/s.
const SINKS_M: f32 = 42e-6;

#[test]
fn a_wire_that_rests_half_in_a_block_splits_nothing_while_a_chip_drifts_by() {
    let mut tissue = bar();
    let first = tissue.rest.positions_m.len() as u32;
    // The chip, another object, is above the end of the wire, which lies 0.2 mm above the block there, farther from its nodes.
    let chip = [[0.0160, 0.0045, 0.0128], [0.0180, 0.0045, 0.0128], [0.0170, 0.0055, 0.0128], [0.0170, 0.0048, 0.0145]];
    let Cuttable { rest, position_m, velocity_m_s, fixed, marks, .. } = &mut tissue;
    rest.positions_m.extend(chip);
    position_m.extend(chip);
    velocity_m_s.extend([[0.0; 3]; 4]);
    fixed.extend([false; 4]);
    marks.extend([[0.0; 3]; 4]);
    rest.tets.push([0, 1, 2, 3].map(|corner| first + corner));
    rest.regions.push(1);
    let at = |x: f32, z: f32| [x, 0.0044, z];
    let wire = [at(0.0135, 0.0095), at(0.0148, 0.0110), at(0.0165, 0.0122), at(0.0175, 0.0122), at(0.0185, 0.0122)];
    assert_eq!(cut(&mut tissue, &wire, &CutOptions::default()), Ok(CutReport::default()));
    // It is plain data: whoever goes on with it sees the same.
    let mut successor = tissue.clone();
    for tissue in [&mut tissue, &mut successor] {
        for _ in 0..12 {
            tissue.position_m[first as usize..].iter_mut().for_each(|place| place[2] -= SINKS_M);
            let swept_m = tissue.swept_m(&wire);
            assert!(swept_m < 1e-6, "the chip has carried the wire {swept_m} m");
        }
        assert_eq!(cut(tissue, &wire, &CutOptions::default()), Ok(CutReport::default()));
    }
    assert_eq!(tissue, successor);
    // Of a wire that is in nothing the chip is what may come to it.
    let above = wire.map(|[x, y, z]| [x, y, z.max(0.0122)]);
    tissue.end_stroke();
    assert_eq!(cut(&mut tissue, &above, &CutOptions::default()), Ok(CutReport::default()));
    tissue.position_m[first as usize..].iter_mut().for_each(|place| place[2] -= SINKS_M);
    assert!(tissue.swept_m(&above) > 0.5 * f64::from(SINKS_M), "{} m", tissue.swept_m(&above));
}

#[test]
fn regions_keep_their_volume_and_fixed_nodes_their_place() {
    let mut tissue = bar();
    let middle_x =
        |mesh: &TetMesh, tet: usize| mesh.tets[tet].iter().map(|node| mesh.positions_m[*node as usize][0]).sum::<f32>() / 4.0;
    tissue.rest.regions = (0..tissue.rest.tets.len()).map(|tet| 7 + u32::from(middle_x(&tissue.rest, tet) > 0.018)).collect();
    tissue.fixed = tissue.rest.positions_m.iter().map(|p| p[2] == 0.0).collect();
    tissue.velocity_m_s.iter_mut().zip(&tissue.fixed).filter(|(_, fixed)| !**fixed).for_each(|(v, _)| *v = [0.2, -0.1, 0.3]);
    let of_regions = |tissue: &Cuttable| {
        let mut volumes = [0.0; 2];
        shape(&tissue.rest)
            .0
            .iter()
            .zip(&tissue.rest.regions)
            .for_each(|(volume, region)| volumes[*region as usize - 7] += volume);
        volumes
    };
    let held = |tissue: &Cuttable| -> Vec<([f32; 3], [f32; 3])> {
        let nodes = (0..tissue.fixed.len())
            .filter(|node| tissue.fixed[*node] && tissue.rest.tets.as_flattened().contains(&(*node as u32)));
        nodes.map(|node| (tissue.rest.positions_m[node], tissue.velocity_m_s[node])).collect()
    };
    let (before, held_before) = (of_regions(&tissue), held(&tissue));
    // a slanting cut through the border between the regions
    let places = straight(Vec3::new(0.012, -0.002, -0.002), Vec3::new(0.021, 0.014, -0.002), Vec3::new(0.004, 0.0, 0.016), 12);
    sweep(&mut tissue, &places, &CutOptions::default());
    assert_eq!(parts(&tissue.rest), 2);
    let after = of_regions(&tissue);
    assert!(before.iter().zip(after).all(|(old, new)| (old - new).abs() <= 1e-6 * old), "{before:?} became {after:?}");
    let held_after = held(&tissue);
    assert!(held_before.iter().all(|node| held_after.contains(node)), "a held node was moved or pushed");
    // What lies between held nodes is held: all of the bottom, and nothing else.
    for (node, fixed) in tissue.fixed.iter().enumerate() {
        assert_eq!(*fixed, tissue.rest.positions_m[node][2] == 0.0, "node {node}");
        assert!(!fixed || tissue.velocity_m_s[node] == [0.0; 3], "node {node} is held and moves");
    }
}

#[test]
fn a_chip_that_is_no_object_is_burnt_and_its_nodes_are_used_again() {
    let options = CutOptions { min_piece_m3: 50e-9, ..CutOptions::default() };
    let mut tissue = bar();
    let whole = tissue.volume_m3();
    let nodes = tissue.rest.positions_m.len();
    // a slice of 2 mm × 12 mm × 12 mm is kept, a corner of 2 mm is not
    let slice = straight(Vec3::new(0.034, -0.002, -0.002), Vec3::new(0.034, 0.014, -0.002), Vec3::Z * 0.016, 4);
    sweep(&mut tissue, &slice, &options);
    tissue.end_stroke();
    assert_eq!(parts(&tissue.rest), 2);
    let corner = straight(Vec3::new(0.004, -0.002, -0.002), Vec3::new(-0.002, 0.004, -0.002), Vec3::Z * 0.016, 4);
    let reports = sweep(&mut tissue, &corner, &options);
    tissue.end_stroke();
    let burnt: f64 = reports.iter().map(|report| report.burnt_m3).sum();
    assert_eq!(parts(&tissue.rest), 2);
    assert!(burnt > 5e-9 && burnt < 50e-9, "{burnt} m³ were burnt");
    assert!((tissue.volume_m3() + burnt - whole).abs() < 1e-6 * whole);
    assert!(
        !tissue.rest.tets.iter().flatten().any(|node| tissue.rest.positions_m[*node as usize] == [0.0; 3]),
        "the corner is still there"
    );
    // Its nodes are free: the next cuts take them first.
    let unused = |tissue: &Cuttable| check(&tissue.rest).unused_nodes.len();
    let (free, before) = (unused(&tissue), tissue.rest.positions_m.len());
    assert!(free > 0 && before > nodes);
    let next = straight(Vec3::new(0.017, -0.002, 0.011), Vec3::new(0.017, 0.014, 0.011), Vec3::Z * 0.003, 2);
    sweep(&mut tissue, &next, &options);
    assert!(unused(&tissue) < free);
}

#[test]
fn momentum_is_kept_where_nodes_are_moved_beside_held_ones() {
    let mut tissue = Cuttable::at_rest(block([8, 6, 6], 0.002));
    for (node, velocity) in tissue.velocity_m_s.iter_mut().enumerate() {
        *velocity = [0.3 * (node % 5) as f32, 0.1, -0.2 * (node % 3) as f32];
    }
    let before = momentum(&tissue);
    let places = straight(Vec3::new(0.0073, -0.002, -0.002), Vec3::new(0.0081, 0.014, -0.002), Vec3::Z * 0.016, 6);
    let reports = sweep(&mut tissue, &places, &CutOptions::default());
    assert!(reports.iter().map(|report| report.moved_nodes).sum::<usize>() > 3, "no node was moved: the test says nothing");
    assert!(before.distance(momentum(&tissue)) < 2e-5 * before.length());
    assert_eq!(component_of_each_tet(&tissue.rest).iter().max(), Some(&1));
}

/// The loop's half ring drawn over a body from one side to the other, at a random place: its arms pass 0.3 mm above it, its bottom 1.9 mm deep.
fn furrow(mesh: &TetMesh, random: &mut impl FnMut() -> f32) -> Vec<Vec<[f32; 3]>> {
    const RADIUS_M: f32 = 2.2e-3;
    let nodes = || mesh.positions_m.iter().map(|point| Vec3::from_array(*point));
    let middle = nodes().sum::<Vec3>() / mesh.positions_m.len() as f32;
    let up = direction(random);
    let way = direction(random).reject_from_normalized(up).normalize_or(up.any_orthonormal_vector());
    let top_m = nodes().map(|point| (point - middle).dot(up)).fold(0.0, f32::max) + 0.3e-3;
    let reach_m = nodes().map(|point| point.distance(middle)).fold(0.0, f32::max) + 1e-3;
    let point = |along_m: f32, index: i32| {
        let (sin, cos) = (std::f32::consts::PI * index as f32 / 16.0).sin_cos();
        (middle + way * along_m + up.cross(way) * RADIUS_M * cos + up * (top_m - RADIUS_M * sin)).to_array()
    };
    let steps = (2.0 * reach_m / 0.5e-3) as i32;
    (0..=steps).map(|step| (0..=16).map(|index| point(step as f32 * 0.5e-3 - reach_m, index)).collect()).collect()
}

#[test]
fn a_furrow_frees_its_chip_also_while_the_tissue_moves() {
    let mesh = shipped("myoma.msh");
    // How far the tissue goes to and fro while it is cut, m; a wave of it is some 16 mm long, a period takes 60 cuts.
    for amplitude_m in [0.0, 0.02e-3, 0.1e-3] {
        for seed in 0..40 {
            let mut random = common::noise(seed);
            let places = furrow(&mesh, &mut random);
            let mut tissue = Cuttable::at_rest(mesh.clone());
            let whole_m3 = tissue.volume_m3();
            let mut burnt_m3 = 0.0;
            for (time, wire) in places.iter().enumerate() {
                let moved = |point: [f32; 3]| -> [f32; 3] {
                    std::array::from_fn(|axis| {
                        point[axis] + amplitude_m * (400.0 * point[(axis + 1) % 3] + 0.1 * time as f32 + axis as f32).sin()
                    })
                };
                tissue.position_m = tissue.rest.positions_m.iter().map(|point| moved(*point)).collect();
                burnt_m3 += cut(&mut tissue, wire, &CutOptions::default()).unwrap().burnt_m3;
            }
            let what = format!("{amplitude_m} m, seed {seed}");
            assert!(parts(&tissue.rest) > 1, "{what}: the chip hangs on");
            assert!(
                burnt_m3 < 2e-9 && (tissue.volume_m3() + burnt_m3 - whole_m3).abs() < 2e-6 * whole_m3,
                "{what}: {burnt_m3} m³ burnt"
            );
        }
    }
}
