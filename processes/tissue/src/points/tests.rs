//! Promise of the points: who is buried in whom is found whatever is left out of the search, and only what may meet something is anywhere.

use super::*;
use crate::world::Workshop;
use hyst_contact::intersect_brute;
use hyst_tissue::Isa;

#[test]
fn buried_is_what_lies_in_a_tet_of_another_object_whatever_is_left_out_of_the_search() {
    let (_, world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
    let (rest, owner_of) = (&world.body.rest, surface(&world.body, &world.topology).1);
    let tissue = Tissue { positions_m: &rest.positions_m, tets: &rest.tets, tet_owner: &rest.regions };
    let of_all = |node: usize| owner_of[node];
    let of_polyp = |node: usize| if owner_of[node] == 1 { 1 } else { NONE };
    for of in [&of_polyp as &dyn Fn(usize) -> u32, &of_all] {
        let owner: Vec<u32> = (0..owner_of.len()).map(of).collect();
        let place = |(node, owner): (&[f32; 3], &u32)| if *owner == NONE { NOWHERE } else { *node };
        let places_m: Vec<[f32; 3]> = rest.positions_m.iter().zip(&owner).map(place).collect();
        let mut hits = vec![Hit::default(); 4 * places_m.len()];
        let points = Points { owner: &owner, node: &[], own: None };
        let found = intersect_brute(&places_m, &points, &tissue, &mut hits).unwrap();
        let expected: Vec<u32> = hits[..found.count].iter().map(|hit| hit.point).collect();
        assert!(expected.len() > 3 && found.dropped == 0, "{} nodes", expected.len());
        assert_eq!(buried(&world.case, &world.body, &owner_of, &owner).unwrap(), expected);
    }
}

#[test]
fn an_object_may_bury_nodes_of_another_whose_box_meets_its_own_and_none_of_itself() {
    let (_, mut world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
    let owner_of = surface(&world.body, &world.topology).1;
    let of_polyp: Vec<u32> = owner_of.iter().map(|owner| if *owner == 1 { 1 } else { NONE }).collect();
    assert_eq!(may_bury(&world.case, &world.body, &owner_of, &of_polyp), [true, false]);
    assert_eq!(may_bury(&world.case, &world.body, &owner_of, &owner_of), [true, true]);
    assert_eq!(may_bury(&world.case, &world.body, &owner_of, &vec![NONE; owner_of.len()]), [false, false]);
    // A polyp that is elsewhere.
    let places_m = world.body.rest.positions_m.iter_mut();
    places_m.zip(&world.points.of_tets.object_of).filter(|(_, of)| **of == 1).for_each(|(place_m, _)| place_m[2] += 1.0);
    assert_eq!(may_bury(&world.case, &world.body, &owner_of, &owner_of), [false, false]);
    assert!(buried(&world.case, &world.body, &owner_of, &owner_of).unwrap().is_empty());
}

#[test]
fn the_longest_edge_and_the_object_of_a_node_are_those_of_its_tets() {
    let (_, world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
    let (rest, OfTets { object_of, longest_m }) = (&world.body.rest, world.points.of_tets.clone());
    let (place, owners) = (|node: u32| Vec3::from(rest.positions_m[node as usize]), world.body.owners());
    for (node, (longest_m, object)) in (0..).zip(longest_m.into_iter().zip(object_of)) {
        let around = rest.tets.iter().filter(|tet| tet.contains(&node));
        let edges_m = around.flatten().map(|other| place(node).distance(place(*other)));
        assert_eq!(longest_m.to_bits(), edges_m.fold(0.0, f32::max).to_bits(), "node {node}");
        assert_eq!(Some(object).filter(|object| *object != NONE), owners[node as usize]);
    }
}

#[test]
fn a_wall_that_is_hardly_deformed_is_nowhere_and_what_has_come_far_is_there_with_what_it_may_reach() {
    let scene = hyst_scene::load_embedded().unwrap();
    let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
    let (points, rest_m) = (&world.points, &world.body.rest.positions_m);
    assert!(points.organs.is_empty() && points.organs_from == points.own_from, "one organ has nobody to meet");
    let mut out = vec![[0.0; 3]; points.len()];
    let pose = Pose { orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
    let mut there = |positions_m: &[[f32; 3]]| {
        points.place(&world.case.tool, (&pose, Stand::default()), (positions_m, rest_m), &mut out);
        let is_there: Vec<bool> = out.iter().map(|place| place[0].is_finite()).collect();
        let folds = &is_there[points.own_from..];
        assert!(is_there[..world.case.tool.shaft].iter().all(|is| *is), "the shaft");
        assert!(is_there[points.tool..points.own_from].iter().all(|is| *is), "the polyp");
        (folds.iter().filter(|is| **is).count(), folds[0])
    };
    let folds = points.len() - points.own_from;
    assert!(folds > 300, "{folds} nodes of the wall");
    assert_eq!(there(rest_m), (0, false), "at rest");
    let mut moved = rest_m.clone();
    let mut move_by = |share: f32| {
        moved[points.node[points.own_from] as usize][1] += share * points.own_beyond_m;
        there(&moved)
    };
    assert_eq!(move_by(0.4), (0, false), "no two nodes have come so far from each other that they may meet");
    assert_eq!(move_by(0.2), (1, true), "this one may meet one that has come as far, and all others none");
    let (near, moved) = move_by(0.5);
    assert!(moved && near > 1 && near < folds / 2, "those near where this one has come to, not {near} of {folds}");
}
