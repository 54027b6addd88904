//! The hashed test is brute force to the last bit, for any number of workers, and nothing from outside makes it panic.

mod common;

use common::{TOOL, block, brute, hits_split, table};
use hyst_contact::*;
use parry3d::math::Vec3;
use parry3d::query::PointQuery;
use parry3d::shape::Tetrahedron;
use proptest::array::{uniform3, uniform4};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(41), failure_persistence: None, ..ProptestConfig::default() }
}

/// Coordinates that make trouble: a lattice (flat tets, points on faces, duplicates), anything, and not even numbers.
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => (-4i32..5).prop_map(|v| v as f32 * 0.25),
        6 => -1.0f32..1.0,
        1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1e30f32), Just(1e30f32), Just(-0.0f32), Just(1e-42f32)],
    ]
}

fn vertex() -> impl Strategy<Value = [f32; 3]> {
    [coordinate(), coordinate(), coordinate()]
}

proptest! {
    #![proptest_config(config(300))]

    #[test]
    fn any_scene_is_brute_force_to_the_last_bit(
        nodes in prop::collection::vec(vertex(), 4..40),
        points_m in prop::collection::vec(vertex(), 0..70),
        corners in prop::collection::vec([0u32..44, 0u32..44, 0u32..44, 0u32..44], 0..60),
        cell_m in prop_oneof![Just(0.25f32), 0.01f32..3.0, Just(1e-30f32)],
        hashed in any::<bool>(),
        workers in 1u32..6,
        own in any::<bool>(),
        rest_m in prop::collection::vec(vertex(), 40..60),
        by_tets in any::<bool>(),
    ) {
        let owner: Vec<u32> = (0..points_m.len() as u32).map(|p| if p % 3 == 0 { TOOL } else { p % 2 }).collect();
        let node: Vec<u32> = (0..points_m.len() as u32).collect();
        let tet_owner: Vec<u32> = (0..corners.len() as u32).map(|t| t % 2).collect();
        let own = own.then_some(OwnContact { rest_m: &rest_m, beyond_m: 0.4, only_from: 40 });
        let points = Points { owner: &owner, node: &node, own };
        let tissue = Tissue { positions_m: &nodes, tets: &corners, tet_owner: &tet_owner };
        let layout = if hashed { Layout::Hashed } else { Layout::Auto };
        let split = if by_tets { Split::Tets } else { Split::Points };
        let found = hits_split(&points_m, &points, &tissue, (cell_m, layout), (workers, split));
        let wanted = brute(&points_m, &points, &tissue);
        prop_assert_eq!(bytemuck::cast_slice::<Hit, u32>(&found), bytemuck::cast_slice::<Hit, u32>(&wanted));
        for hit in &found {
            prop_assert!(points_m[hit.point as usize].iter().all(|v| v.is_finite()));
            prop_assert!(hit.weights.iter().all(|w| (0.0..=1.0001).contains(w)));
            prop_assert!((hit.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn parry_agrees_on_every_point_off_the_faces(
        corners in uniform4(uniform3(-1.0f32..1.0)), weights in uniform4(0.0f32..1.0), shift in uniform3(-0.6f32..0.6),
    ) {
        let Some(test) = TetTest::new(&corners) else { return Ok(()) };
        let sum: f32 = weights.iter().sum();
        prop_assume!(sum > 0.1);
        let p: [f32; 3] =
            std::array::from_fn(|i| (0..4).map(|c| corners[c][i] * weights[c] / sum).sum::<f32>() + shift[i] * weights[0]);
        let at = test.weights_at(p);
        let [a, b, c, d] = corners.map(Vec3::from_array);
        let volume = (b - a).cross(c - a).dot(d - a).abs();
        prop_assume!(volume > 1e-2 && at.iter().all(|w| w.abs() > 1e-3));
        let inside = Tetrahedron::new(a, b, c, d).contains_local_point(Vec3::from_array(p));
        prop_assert_eq!(test.weights(p).is_some(), inside, "{:?}", at);
    }

    #[test]
    fn words_of_another_process_are_checked_before_they_are_used(
        words in prop::collection::vec(any::<u32>(), 0..60), flips in prop::collection::vec((0usize..1500, any::<u32>()), 0..4),
    ) {
        prop_assert!(HashRef::in_words(&words).is_err());
        let points_m: Vec<[f32; 3]> = (0..20).map(|i| [i as f32 * 0.1; 3]).collect();
        let sizes = HashSizes::for_points(points_m.len());
        let mut words = vec![0u32; sizes.words()];
        HashMut::in_words(&mut words, sizes).unwrap().build(&points_m, 0.3, Layout::Auto).unwrap();
        for (at, value) in flips {
            let n = words.len();
            words[at % n] = value;
        }
        if let Ok(hash) = HashRef::in_words(&words) {
            let (nodes, tets) = block([2, 2, 2], 1.0, [0.0; 3]);
            let (owner, tet_owner) = (vec![TOOL; hash.points()], vec![0; tets.len()]);
            let points = Points { owner: &owner, node: &[], own: None };
            let tissue = Tissue { positions_m: &nodes, tets: &tets, tet_owner: &tet_owner };
            let mut out = vec![Hit::default(); 64];
            let found = intersect(Share::ALL, &hash, &points, &tissue, &mut Cull::default(), &mut out).unwrap();
            prop_assert!(found.count <= 64);
        }
    }
}

#[test]
fn a_block_full_of_points_gives_one_tet_to_each_point_inside() {
    let (nodes, tets) = block([4, 4, 4], 0.25, [-0.5; 3]);
    let lattice = |i: usize| -0.5 + 0.125 * i as f32;
    let points_m: Vec<[f32; 3]> = (0..9 * 9 * 9).map(|n| [lattice(n % 9), lattice(n / 9 % 9), lattice(n / 81)]).collect();
    let (owner, tet_owner) = (vec![TOOL; points_m.len()], vec![0; tets.len()]);
    let points = Points { owner: &owner, node: &[], own: None };
    let tissue = Tissue { positions_m: &nodes, tets: &tets, tet_owner: &tet_owner };
    let all: Vec<u32> = (0..points_m.len() as u32).collect();
    for layout in [Layout::Auto, Layout::Hashed] {
        for split in [Split::Points, Split::Tets] {
            for workers in [1, 2, 3, 7, 100] {
                let found = hits_split(&points_m, &points, &tissue, (0.2, layout), (workers, split));
                assert_eq!(found.iter().map(|h| h.point).collect::<Vec<_>>(), all);
                assert_eq!(found, brute(&points_m, &points, &tissue));
            }
        }
    }
}

#[test]
fn shares_are_equal_sets_of_points_and_cover_all() {
    for len in [0usize, 1, 5, 1000] {
        for count in 1u32..9 {
            let mut next = 0;
            for index in 0..count {
                let share = Share { index, count, split: Split::Points };
                let (from, to) = share.points(len).unwrap();
                assert_eq!(from, next);
                assert!((to - from).abs_diff(len / count as usize) <= 1);
                next = to;
            }
            assert_eq!(next, len);
        }
    }
    for split in [Split::Points, Split::Tets] {
        let wrong = Share { index: 2, count: 2, split };
        assert_eq!(wrong.points(4), Err(ContactError::Share { index: 2, count: 2 }));
    }
}

#[test]
fn too_short_an_output_is_reported_with_what_is_missing() {
    let (nodes, tets) = block([2, 2, 2], 1.0, [0.0; 3]);
    let points_m: Vec<[f32; 3]> = (0..50).map(|i| [0.013 + 0.037 * i as f32, 0.71, 0.9]).collect();
    let (owner, tet_owner) = (vec![TOOL; 50], vec![0; tets.len()]);
    let points = Points { owner: &owner, node: &[], own: None };
    let tissue = Tissue { positions_m: &nodes, tets: &tets, tet_owner: &tet_owner };
    let sizes = HashSizes::for_points(50);
    let mut words = vec![0; sizes.words()];
    let mut table = HashMut::in_words(&mut words, sizes).unwrap();
    table.build(&points_m, 0.5, Layout::Auto).unwrap();
    let mut out = [Hit::default(); 20];
    let found = intersect(Share::ALL, &table.as_ref(), &points, &tissue, &mut Cull::default(), &mut out).unwrap();
    assert!((18..=20).contains(&found.count) && found.count + found.dropped == 50, "{found:?}");
    let wanted = brute(&points_m, &points, &tissue);
    assert_eq!(out[..found.count], wanted[..found.count]);
    // Of parts that have hits in common each counts once.
    let mut room = [Hit::default(); 12];
    let joined = merge(&[&wanted[..15], &wanted[10..20]], &tissue, &mut room);
    assert_eq!((joined.count, joined.dropped), (12, 8));
    assert_eq!(room, wanted[..12]);
}

/// One share gave up where two, each with as much room, had room for what it dropped.
#[test]
fn where_hits_find_no_room_the_beginning_of_the_list_is_kept_whatever_the_number_of_shares() {
    const OBJECTS: u32 = 12;
    const ROOM: usize = 250;
    // Objects that lie in each other: each point lies in all of them, and on faces in several tets of each.
    let (nodes, cubes) = block([2, 2, 2], 0.5, [-0.5; 3]);
    let tet_owner: Vec<u32> = (0..OBJECTS).flat_map(|object| vec![TOOL + 1 + object; cubes.len()]).collect();
    let tets = cubes.repeat(OBJECTS as usize);
    let lattice = |i: usize| -0.5 + 0.25 * i as f32;
    let points_m: Vec<[f32; 3]> = (0..5 * 5 * 5).map(|n| [lattice(n % 5), lattice(n / 5 % 5), lattice(n / 25)]).collect();
    let owner = vec![TOOL; points_m.len()];
    let points = Points { owner: &owner, node: &[], own: None };
    let tissue = Tissue { positions_m: &nodes, tets: &tets, tet_owner: &tet_owner };
    let words = table(&points_m, 0.3, Layout::Auto);
    let hash = HashRef::in_words(&words).unwrap();
    let wanted = brute(&points_m, &points, &tissue);
    assert!(wanted.len() > 4 * ROOM);
    for split in [Split::Points, Split::Tets] {
        for count in [1, 2, 3, 7, 100] {
            let hits_of = |index: u32| {
                let mut hits = vec![Hit::default(); room_of_share(ROOM)];
                let share = Share { index, count, split };
                let found = intersect(share, &hash, &points, &tissue, &mut Cull::default(), &mut hits).unwrap();
                hits.truncate(found.count);
                hits
            };
            let shares: Vec<Vec<Hit>> = (0..count).map(hits_of).collect();
            let parts: Vec<&[Hit]> = shares.iter().map(Vec::as_slice).collect();
            let mut joined = [Hit::default(); ROOM];
            let found = merge(&parts, &tissue, &mut joined);
            assert!(found.count == ROOM && found.dropped > 0, "{count} shares: {found:?}");
            assert!(joined == wanted[..ROOM], "{count} shares");
        }
    }
}

#[test]
fn bad_sizes_are_errors_that_name_the_cure() {
    let sizes = HashSizes::for_points(4);
    let mut words = vec![0; sizes.words()];
    assert!(matches!(HashMut::in_words(&mut words[1..], sizes), Err(ContactError::Words { .. })));
    let mut table = HashMut::in_words(&mut words, sizes).unwrap();
    for cell_m in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-45] {
        assert!(matches!(table.build(&[], cell_m, Layout::Auto), Err(ContactError::Cell { .. })), "{cell_m}");
    }
    let full = table.build(&[[0.0; 3]; 5], 1.0, Layout::Auto).unwrap_err();
    assert_eq!(full, ContactError::Capacity { points: 5, capacity: 4 });
    assert!(full.to_string().contains("HashSizes::for_points(5)"));
    table.build(&[[0.0; 3]; 4], 1.0, Layout::Auto).unwrap();
    let points = Points { owner: &[TOOL; 3], node: &[], own: None };
    let tissue = Tissue { positions_m: &[], tets: &[], tet_owner: &[] };
    assert!(matches!(
        intersect(Share::ALL, &table.as_ref(), &points, &tissue, &mut Cull::default(), &mut []),
        Err(ContactError::Length { .. })
    ));
}

/// The table is sent to other processes as it lies: equal points have equal tables, whatever the words held before.
#[test]
fn a_table_is_written_in_full() {
    let points_m = [[0.1, 0.2, 0.3], [f32::NAN, 0.0, 0.0], [0.4, 0.5, 0.6], [f32::INFINITY, 0.0, 0.0], [0.1, 0.2, 0.3]];
    let sizes = HashSizes::for_points(11);
    for count in 0..=points_m.len() {
        for layout in [Layout::Auto, Layout::Hashed] {
            let [clean, dirty] = [0u32, 0xAAAA_AAAA].map(|left| {
                let mut words = vec![left; sizes.words()];
                HashMut::in_words(&mut words, sizes).unwrap().build(&points_m[..count], 0.25, layout).unwrap();
                words
            });
            assert!(clean == dirty, "{count} points, {layout:?}");
        }
    }
}

/// Two layers of a folded sheet: the upper lies in the lower. Nodes meet what was far from them at rest, their own neighbourhood never, and other objects
/// only if they come before those that meet their own alone.
#[test]
fn a_fold_meets_another_and_no_node_what_is_beside_it() {
    let (mut nodes, tets) = block([8, 2, 1], 1.0, [0.0; 3]);
    let rest_m = nodes.clone();
    // The far half is laid over the near one, half a thickness deep.
    for (node, rest) in nodes.iter_mut().zip(&rest_m).filter(|(_, rest)| rest[0] > 4.5) {
        *node = [8.0 - rest[0], rest[1], 1.5 - rest[2]];
    }
    let (owner, tet_owner) = (vec![0; nodes.len()], vec![0; tets.len()]);
    let node: Vec<u32> = (0..nodes.len() as u32).collect();
    let tissue = Tissue { positions_m: &nodes, tets: &tets, tet_owner: &tet_owner };
    let met = |own: Option<OwnContact<'_>>, tet_owner: &[u32]| {
        let points = Points { owner: &owner, node: &node, own };
        let found = brute(&nodes, &points, &Tissue { tet_owner, ..tissue });
        found.iter().map(|hit| (hit.point, hit.tet)).collect::<Vec<_>>()
    };
    assert!(met(None, &tet_owner).is_empty());
    let own = OwnContact { rest_m: &rest_m, beyond_m: 2.0, only_from: 0 };
    let found = met(Some(own), &tet_owner);
    let far_m = |(point, tet): &(u32, u32)| {
        let middle_x = tets[*tet as usize].iter().map(|node| rest_m[*node as usize][0]).sum::<f32>() / 4.0;
        (rest_m[*point as usize][0] - middle_x).abs()
    };
    assert!(found.len() >= 8, "{found:?}");
    assert!(found.iter().all(|hit| far_m(hit) > 0.9 && !tets[hit.1 as usize].contains(&hit.0)), "{found:?}");
    assert!(met(Some(OwnContact { beyond_m: 9.0, ..own }), &tet_owner).is_empty(), "all is beside each other");
    let others = vec![1; tets.len()];
    assert!(met(Some(own), &others).is_empty(), "they meet their own alone");
    assert!(!met(Some(OwnContact { only_from: 1_000, ..own }), &others).is_empty());
}
