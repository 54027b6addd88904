//! Promise of the Main Loop about one object that meets itself: a fold that is pressed on another lies on it, and not in it, with the same bits whoever finds it;
//! and what does not fold is to the bit what it would be if nothing met itself. The same of an organ that is pressed on another one.

use super::held::distance_m;
use super::lattice::{self, Lattice};
use super::*;
use crate::contacts;
use crate::points::ContactPoints;
use glam::Vec3;
use hyst_contact::{Cull, Hit, Share, Split, are_true, has_all_of, intersect, merge};

/// Edge of the cells, m. Two leaves of one cell, three apart, hang together at one end; the one that is nearer to the tool is free, the other is held. Or they
/// do not hang together, and the near one is held at that end.
const EDGE_M: f32 = 2e-3;
const GAP: usize = 3;
const LOW_M: [f32; 3] = [-0.01, -0.005, 0.03];
/// Where the tip goes, m along x, and along z from before the near leaf to where that has met the other and is pressed on it.
const ACROSS_M: f32 = 4e-3;
const WAY_M: [f32; 2] = [-2e-3, 8e-3];
/// Ticks of that way, and those in which the tip stays.
const PRESS: u64 = 200;
const STAY: u64 = 200;
/// No node of one leaf lies deeper in the other than this, m: a third of an edge.
const DEEP_M: f32 = EDGE_M / 3.0;

/// Height of the faces that look at each other, m along z.
fn faces_m() -> [f32; 2] {
    [LOW_M[2] + EDGE_M, LOW_M[2] + (1 + GAP) as f32 * EDGE_M]
}

/// How deep the near leaf's nodes lie in the far leaf at most after a press, m, how many pairs met at most, and how many nodes stuck to a leaf at most;
/// `is_apart`: they do not hang together; `blind`: no fold meets another, and no organ.
fn pressed(name: &str, (is_apart, blind): (bool, bool)) -> (f32, usize, usize) {
    let cells = [10, 5, 2 + GAP];
    let lattice = Lattice { cells, edge_m: [EDGE_M; 3], low_m: LOW_M };
    let is_there = |[x, _, z]: [usize; 3]| !is_apart && x == 0 || z == 0 || z == 1 + GAP;
    let [end_m, back_m] = [LOW_M[0] + 1e-4, faces_m()[0] + 1e-4];
    let end = format!("{{ box = {{ min_m = [-0.1, -0.1, 0.0], max_m = [{end_m:.4}, 0.1, {back_m:.4}] }} }}, ");
    let fixed = format!("{}{{ above_z_m = {} }}", if is_apart { end.as_str() } else { "" }, faces_m()[1] + 0.9 * EDGE_M);
    let folder = lattice::scene(name, &lattice, is_there, &fixed);
    let (station, pages, life, mut inbox) = begun_with(1, name, &format!("workers = 0\nscene = {:?}", folder.scene()));
    let mut main = engine(&station, &life, &mut inbox);
    assert_eq!(main.world.points.organs, if is_apart { vec![0u32, 1] } else { Vec::new() });
    if blind {
        be_blind(&mut main);
    }
    let mut now = first_state(&mut main);
    let (mut pairs, mut sticks) = (0, 0);
    for tick in 1..=PRESS + STAY {
        let z = LOW_M[2] + WAY_M[0] + tick.min(PRESS) as f32 / PRESS as f32 * (WAY_M[1] - WAY_M[0]);
        let pose = Pose { position_m: [ACROSS_M, 0.0, z], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let (before, known) = (now, main.collision.hits().to_vec());
        now = stepped(&mut main, &pages[1], &before, tick, pose, PieceFlow::default());
        assert!(main.accepts(bytemuck::cast_slice(&now)), "{name}: the state of tick {tick} is none");
        pairs = pairs.max(main.contacts.pairs().len());
        sticks = sticks.max(super::slides::stuck(&now).iter().filter(|stuck| stuck.bent_m != [0.0; 3]).count());
        let of_organs = &main.points_m[main.world.points.organs_from..main.world.points.own_from];
        let there = of_organs.iter().filter(|place| place[0].is_finite()).count();
        assert!(there == 0 || tick > 1, "{there} nodes of organs are looked at that are near no other one");
        if tick % 10 == 0 {
            are_found_in_shares(&main, positions(&before), &known);
        }
    }
    (deepest_m(&main.world, positions(&now)), pairs, sticks)
}

/// No object meets itself from now on, and no organ another one.
fn be_blind(main: &mut MainLoop<'_>) {
    let mut world = main.workshop.make(main.world.body.clone()).unwrap();
    world.points = ContactPoints { own_beyond_m: 1.0, own_from: world.points.organs_from, ..world.points };
    main.take_world(world);
}

/// The hits of the last step, in which the nodes were there, are those of any number of workers; each worker's are taken, with the hits of the step before as
/// what is known, and not taken if one of a fold is left out.
fn are_found_in_shares(main: &MainLoop<'_>, positions_m: &[[f32; 3]], known: &[Hit]) {
    let (world, hits) = (&main.world, main.collision.hits());
    let (points, tissue) = (world.points.view(&world.body.rest.positions_m), contacts::tissue(world, positions_m));
    let table = main.collision.table().unwrap();
    let room = || vec![Hit::default(); contacts::max_hits(world)];
    for count in 1..=3 {
        let mut parts = Vec::new();
        for index in 0..count {
            let share = Share { index, count, split: Split::Tets };
            let mut part = room();
            let found = intersect(share, &table, &points, &tissue, &mut Cull::default(), &mut part).unwrap();
            part.truncate(found.count);
            assert!(are_true(&part, share, &main.points_m, &points, &tissue), "share {index} of {count}");
            let has_all = |told: &[Hit], known: &[Hit]| has_all_of(known, told, share, &main.points_m, &points, &tissue);
            assert!(has_all(&part, known) && has_all(&part, hits), "share {index} of {count}");
            for of_fold in (0..part.len()).filter(|hit| part[*hit].point as usize >= world.points.own_from) {
                let mut told = part.clone();
                told.remove(of_fold);
                assert!(!has_all(&told, &part), "share {index} of {count} without {:?}", part[of_fold]);
            }
            parts.push(part);
        }
        let parts: Vec<&[Hit]> = parts.iter().map(Vec::as_slice).collect();
        let mut merged = room();
        let found = merge(&parts, &tissue, &mut merged);
        assert_eq!(&merged[..found.count], hits, "{count} shares");
    }
}

/// Largest depth of a node of the near leaf's face in the far leaf, m.
fn deepest_m(world: &World, positions_m: &[[f32; 3]]) -> f32 {
    let rest = &world.body.rest;
    let [near, far] = faces_m().map(|face_m| move |node: &u32| (rest.positions_m[*node as usize][2] - face_m).abs() < 1e-5);
    let far_tets: Vec<[u32; 4]> = rest
        .tets
        .iter()
        .copied()
        .filter(|tet| tet.iter().all(|node| far(node) || !is_before_m(rest.positions_m[*node as usize])))
        .collect();
    let at = |node: &u32| Vec3::from(positions_m[*node as usize]);
    let faces: Vec<[Vec3; 3]> =
        world.topology.boundary.iter().filter(|face| face.iter().all(far)).map(|face| face.map(|node| at(&node))).collect();
    let nodes: Vec<u32> = (0..positions_m.len() as u32).filter(near).collect();
    let points_m: Vec<[f32; 3]> = nodes.iter().map(|node| positions_m[*node as usize]).collect();
    let owner = (vec![1; points_m.len()], vec![0; far_tets.len()]);
    let tissue = hyst_contact::Tissue { positions_m, tets: &far_tets, tet_owner: &owner.1 };
    let points = hyst_contact::Points { owner: &owner.0, node: &[], own: None };
    let mut hits = vec![hyst_contact::Hit::default(); 4 * points_m.len()];
    let found = hyst_contact::intersect_brute(&points_m, &points, &tissue, &mut hits).unwrap();
    let depth_m = |hit: &hyst_contact::Hit| {
        let point = Vec3::from(points_m[hit.point as usize]);
        faces.iter().map(|face| distance_m(point, face)).fold(f32::MAX, f32::min)
    };
    hits[..found.count].iter().map(depth_m).fold(0.0, f32::max)
}

/// Whether a place at rest is before the far leaf.
fn is_before_m(place: [f32; 3]) -> bool {
    place[2] < faces_m()[1] - 1e-5
}

#[test]
fn a_fold_that_is_pressed_on_another_lies_on_it_and_not_in_it() {
    let [(blind_m, none, unstuck), (seeing_m, pairs, sticks)] =
        [true, false].map(|blind| pressed(if blind { "no-fold" } else { "fold" }, (false, blind)));
    println!("{:.2} mm deep without contact, {:.2} with it, of {pairs} nodes", 1e3 * blind_m, 1e3 * seeing_m);
    assert!(none == 0 && blind_m > 1.5 * DEEP_M, "what meets nothing is {blind_m} m deep: it is not pressed on the other");
    assert!(pairs > 5 && seeing_m < DEEP_M, "{seeing_m} m deep, {pairs} pairs");
    assert!(unstuck == 0 && sticks > 0, "{unstuck} nodes stuck to what they did not meet, {sticks} to what they did");
}

#[test]
fn an_organ_that_is_pressed_on_another_lies_on_it_and_not_in_it() {
    let [(blind_m, none, _), (seeing_m, pairs, sticks)] =
        [true, false].map(|blind| pressed(if blind { "no-organ" } else { "organs" }, (true, blind)));
    println!("{:.2} mm deep without contact, {:.2} with it, of {pairs} nodes", 1e3 * blind_m, 1e3 * seeing_m);
    assert!(none == 0 && blind_m > 1.5 * DEEP_M, "what meets nothing is {blind_m} m deep: it is not pressed on the other");
    // The far leaf is held at its end and cannot go out of the way: contacts give way by 0.1 mm for each kPa.
    assert!(pairs > 5 && sticks > 0 && seeing_m < 0.8 * blind_m, "{seeing_m} m deep, {pairs} pairs, {sticks} nodes stuck");
}

/// Ticks of the hand: it has pressed the wall in by millimetres by then.
const HAND: u64 = 1_500;

#[test]
fn a_wall_that_is_pressed_and_does_not_fold_is_the_same_to_the_bit() {
    let (station, pages, life, mut inbox) = begun("unfolded");
    let [mut seeing, mut blind] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    be_blind(&mut blind);
    let hand = hyst_scene::load_embedded().unwrap().hand("press").unwrap().clone();
    let (mut most_m, mut there) = (0.0f32, 0);
    let [mut seen, mut unseen] = [first_state(&mut seeing), first_state(&mut blind)];
    for tick in 1..=HAND {
        let pose = hand.pose_at(tick as f64 * 1e-3);
        let pose = seeing.world.case.pose_of(&pose);
        seen = stepped(&mut seeing, &pages[1], &seen, tick, pose, PieceFlow::default());
        unseen = stepped(&mut blind, &pages[1], &unseen, tick, pose, PieceFlow::default());
        assert!(seen == unseen, "the states of tick {tick} differ");
        most_m = most_m.max(displaced_m(&seeing, &seen));
        let folds = &seeing.points_m[seeing.world.points.own_from..];
        there = there.max(folds.iter().filter(|place| place[0].is_finite()).count());
    }
    println!("pressed in by {:.2} mm at most, {there} nodes of the wall were looked at", 1e3 * most_m);
    assert!(most_m > 1e-3, "{most_m} m: nothing is pressed");
}
