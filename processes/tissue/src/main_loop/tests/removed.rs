//! Promise of the Main Loop about what is removed: pathology that nothing holds any more, whether it is burnt or has come free, and that once. Of the wall
//! nothing is: what is taken off that is counted for itself. A piece is what of pathology comes free, also as a whole, and nothing that is burnt.

use super::pieces::{middle_m, part, parted};
use super::*;
use crate::body::{Body, Piece};
use crate::knife::{Filling, freed_m3, healthy_removed_m3, register_parts, removed_m3};
use crate::volumes::Volumes;
use hyst_mesh::component_of_each_tet;
use hyst_tissue::Isa;

/// How far the ring goes through the wall, m, and how deep in it its end begins.
const THROUGH_M: f32 = 6e-3;
const DEEP_M: f32 = 1e-3;
/// Half of a chip of the wall, m.
const CHIP_M: f32 = 4e-3;

/// The body with some of its tets alone: the rest is burnt. Nobody asks it for its surface.
fn only(body: &Body, is_kept: impl Fn(usize) -> bool) -> Body {
    let (mut left, tets) = (body.clone(), 0..body.rest.tets.len());
    left.rest.tets = tets.clone().filter(|tet| is_kept(*tet)).map(|tet| body.rest.tets[tet]).collect();
    left.rest.regions = tets.filter(|tet| is_kept(*tet)).map(|tet| body.rest.regions[tet]).collect();
    left
}

/// Fills a world with another body of the same objects.
fn fill(world: &mut World, body: Body) {
    world.filled = Filling::of(&world.case, &body, &world.objects, &mut Volumes::default()).ended();
    world.body = body;
}

/// The body of which some tets are burnt, with its surface, and the objects that this made.
fn burnt(world: &World, is_burnt: impl Fn(usize) -> bool) -> (Body, Vec<Piece>) {
    const ASH: u32 = u32::MAX;
    let mut marked = world.body.clone();
    (0..).zip(&mut marked.rest.regions).filter(|(tet, _)| is_burnt(*tet)).for_each(|(_, region)| *region = ASH);
    let mut left = marked.without(ASH);
    let part_of_tet = component_of_each_tet(&left.rest);
    let (parted, _) = register_parts(&world.case, &mut left, &part_of_tet);
    (left, parted)
}

/// The object that is the polyp.
fn polyp_of(world: &World) -> u32 {
    let is_polyp = |object: &u32| world.case.is_pathology(&world.body, *object);
    world.body.rest.regions.iter().copied().find(is_polyp).unwrap()
}

/// Whether a volume is another one, which is not nothing, but for rounding.
fn is_near(found_m3: f64, exact_m3: f64) -> bool {
    exact_m3 > 1e-10 && (found_m3 - exact_m3).abs() < 1e-6 * exact_m3
}

#[test]
fn what_is_burnt_of_the_wall_is_not_removed_and_what_is_burnt_of_the_polyp_or_comes_free_of_it_is_once() {
    let (station, _pages, life, mut inbox) = begun("removed");
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let body = &world.body;
    let is_polyp = |tet: usize| world.case.is_pathology(body, body.rest.regions[tet]);
    let polyp = polyp_of(&world);
    let mut made = |body: Body| main.workshop.make(body).unwrap();

    let mut after = made(body.clone());
    fill(&mut after, only(body, |tet| is_polyp(tet) || tet % 3 > 0));
    assert!(after.body.rest.tets.len() < body.rest.tets.len(), "a third of the wall is burnt");
    assert_eq!(removed_m3(&world, &after), 0.0, "and none of the polyp");
    let of_wall_m3 = only(body, |tet| !is_polyp(tet) && tet % 3 == 0).volume_where_m3(|_| true);
    let healthy_m3 = healthy_removed_m3(&world, &after);
    assert!(is_near(healthy_m3, of_wall_m3), "{healthy_m3} of {of_wall_m3} m³ of the wall");
    fill(&mut after, only(body, |tet| tet % 3 > 0));
    let burnt_m3 = only(body, |tet| tet % 3 == 0).volume_of_m3(polyp);
    assert!(is_near(removed_m3(&world, &after), burnt_m3), "{} of {burnt_m3} m³", removed_m3(&world, &after));
    assert_eq!(healthy_removed_m3(&world, &after), healthy_m3, "what is burnt of the polyp is none of the wall");

    let (halved, piece, _) = parted(&world, 0.0);
    let freed = made(halved);
    assert_eq!(healthy_removed_m3(&world, &freed), 0.0, "the wall is whole");
    let free_m3 = freed.body.volume_of_m3(piece);
    let chip = [Piece { object: piece, of: polyp, volume_m3: free_m3, is_held: false }];
    assert!(is_near(freed_m3(&world, &freed, &chip), free_m3), "{} of {free_m3} m³", freed_m3(&world, &freed, &chip));
    assert_eq!(freed_m3(&world, &after, &[]), 0.0, "what is burnt is no piece");
    assert!(is_near(removed_m3(&world, &freed), free_m3), "{} of {free_m3} m³", removed_m3(&world, &freed));
    let gone = made(freed.body.without(piece));
    assert_eq!(removed_m3(&freed, &gone), 0.0, "it has been counted when it came free");
    assert_eq!(freed_m3(&freed, &gone, &[]), 0.0, "nor is one that leaves another one");
    assert!(is_near(removed_m3(&world, &gone), free_m3));
    assert!(!world.case.is_loose_in_scene(polyp) && !world.case.is_loose_in_scene(piece), "nor is it when it leaves");
}

#[test]
fn a_polyp_that_comes_free_as_a_whole_keeps_its_number_and_is_a_piece_once() {
    let (station, _pages, life, mut inbox) = begun("whole");
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let (body, polyp) = (&world.body, polyp_of(&world));
    let volume_m3 = body.volume_of_m3(polyp);
    let has = |tet: usize, nodes: &[u32]| body.rest.tets[tet].iter().any(|node| nodes.contains(node));
    let mut made = |body: Body| main.workshop.make(body).unwrap();

    // What held it is burnt: its own tets at the roots.
    let roots: Vec<u32> = world.attachments.iter().map(|held| held.node).collect();
    let (left, parted) = burnt(&world, |tet| has(tet, &roots));
    let left_m3 = left.volume_where_m3(|object| world.case.is_pathology(&left, object));
    let free = made(left);
    assert!(free.objects[polyp as usize].is_free_piece() && free.body.volume_of_m3(polyp) > 0.0, "it keeps its number");
    let freed = freed_m3(&world, &free, &parted);
    assert!(is_near(freed, left_m3) && left_m3 < volume_m3, "{freed} of {left_m3} m³");
    assert!(is_near(removed_m3(&world, &free), volume_m3), "{} of {volume_m3} m³", removed_m3(&world, &free));

    // Or the wall that they are in.
    let hosts: Vec<u32> = world.attachments.iter().flat_map(|held| held.tet).collect();
    let (left, parted) = burnt(&world, |tet| body.rest.regions[tet] != polyp && has(tet, &hosts));
    let free = made(left);
    assert!(free.objects[polyp as usize].is_free_piece(), "nothing holds it");
    assert!(is_near(freed_m3(&world, &free, &parted), volume_m3), "{} of {volume_m3} m³", freed_m3(&world, &free, &parted));
    assert!(is_near(removed_m3(&world, &free), volume_m3));

    // What is cut of it then was free before.
    let mut body = free.body.clone();
    let of_polyp: Vec<usize> = (0..body.rest.tets.len()).filter(|tet| body.rest.regions[*tet] == polyp).collect();
    let parted = part(&free, &mut body, &of_polyp[..of_polyp.len() / 2]);
    let again = made(body);
    assert!(!parted.is_empty() && parted.iter().all(|piece| piece.of == polyp), "{parted:?}");
    assert_eq!([freed_m3(&free, &again, &parted), removed_m3(&free, &again)], [0.0; 2], "it has been counted");
}

/// The body of which the wall about the polyp's root has come off, but for what is fixed, and the objects that this made.
fn unrooted(world: &World) -> (Body, Vec<Piece>) {
    let (body, polyp) = (&world.body, polyp_of(world));
    let hosts: Vec<u32> = world.attachments.iter().flat_map(|held| held.tet).collect();
    let is_chip = |tet: &usize| {
        let nodes = &body.rest.tets[*tet];
        let is_fixed = nodes.iter().any(|node| body.fixed[*node as usize]);
        body.rest.regions[*tet] != polyp && !is_fixed && nodes.iter().any(|node| hosts.contains(node))
    };
    let chip: Vec<usize> = (0..body.rest.tets.len()).filter(is_chip).collect();
    let mut left = body.clone();
    let parted = part(world, &mut left, &chip);
    (left, parted)
}

#[test]
fn a_polyp_whose_wall_comes_off_with_its_root_floats_with_it_and_is_counted_once() {
    let scene = || hyst_scene::load_embedded().unwrap();
    let mut unfixed = scene();
    // An organ that nothing holds is no piece, and what is tied to it is none.
    unfixed.objects[0].fixed.fill(false);
    for (what, scene) in [("held", scene()), ("loose", unfixed)] {
        let (mut workshop, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        let polyp = polyp_of(&world);
        let volume_m3 = world.body.volume_of_m3(polyp);
        assert!(!world.objects[polyp as usize].is_free_piece() && !world.case.is_loose_in_scene(polyp), "{what}");
        let (body, parted) = unrooted(&world);
        assert!(!parted.is_empty() && parted.iter().all(|piece| piece.of != polyp && !piece.is_held), "{what}: {parted:?}");
        let free = workshop.make(body).unwrap();
        assert_eq!(free.attachments.len(), world.attachments.len(), "{what}: it is tied to the chip");
        let drifting: Vec<u32> = free.drifters.iter().map(|drifter| drifter.object()).collect();
        let mut loose: Vec<u32> = parted.iter().map(|piece| piece.object).chain([polyp]).collect();
        loose.sort_unstable();
        assert_eq!(drifting, loose, "{what}: both drift");
        assert!(free.objects[polyp as usize].is_free_piece() && !free.objects[0].is_free_piece(), "{what}");
        let [removed, freed] = [removed_m3(&world, &free), freed_m3(&world, &free, &parted)];
        assert!(is_near(removed, volume_m3) && is_near(freed, volume_m3), "{what}: {removed}, {freed} of {volume_m3} m³");
        let chip_m3: f64 = parted.iter().map(|piece| piece.volume_m3).sum();
        let healthy = healthy_removed_m3(&world, &free);
        assert!(is_near(healthy, chip_m3), "{what}: {healthy} of {chip_m3} m³");

        // The chip leaves: the polyp was free before.
        let alone = parted.iter().fold(free.body.clone(), |body, piece| body.without(piece.object));
        let alone = workshop.make(alone).unwrap();
        assert!(alone.attachments.is_empty() && alone.objects[polyp as usize].is_free_piece(), "{what}");
        assert_eq!([removed_m3(&free, &alone), freed_m3(&free, &alone, &[])], [0.0; 2], "{what}: it has been counted");
        assert!(!alone.case.is_loose_in_scene(polyp), "{what}: nor is it when it leaves");
    }
}

#[test]
fn what_is_burnt_of_the_polyp_is_no_piece_whatever_comes_free_by_the_same_cut() {
    let (station, _pages, life, mut inbox) = begun("kerf");
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let (body, polyp, tets) = (&world.body, polyp_of(&world), 0..world.body.rest.tets.len());
    let is_burnt = |tet: usize, of: &Body| of.rest.regions[tet] == polyp && tet.is_multiple_of(3);
    let mut made = |body: Body| main.workshop.make(body).unwrap();

    // A chip of the wall, where nothing is held.
    let hosts: Vec<u32> = world.attachments.iter().flat_map(|held| held.tet).collect();
    let is_loose = |node: &u32| !body.fixed[*node as usize] && !hosts.contains(node);
    let is_wall = |tet: &usize| body.rest.regions[*tet] != polyp && body.rest.tets[*tet].iter().all(is_loose);
    let wall: Vec<usize> = tets.filter(is_wall).collect();
    let at = wall.iter().map(|tet| middle_m(body, *tet)).min_by(|one, other| one.x.total_cmp(&other.x)).unwrap();
    let chip: Vec<usize> = wall.into_iter().filter(|tet| middle_m(body, *tet).distance(at) < CHIP_M).collect();
    let mut chipped = body.clone();
    let parts = part(&world, &mut chipped, &chip);
    assert!(parts.iter().all(|piece| piece.of != polyp), "{parts:?}");
    let mut after = made(chipped.clone());
    assert!(parts.iter().any(|piece| after.objects[piece.object as usize].is_free_piece()), "{parts:?}");
    fill(&mut after, only(&chipped, |tet| !is_burnt(tet, &chipped)));
    let burnt_m3 = body.volume_of_m3(polyp) - after.body.volume_of_m3(polyp);
    assert!(is_near(removed_m3(&world, &after), burnt_m3), "{} of {burnt_m3} m³", removed_m3(&world, &after));
    assert_eq!(freed_m3(&world, &after, &parts), 0.0, "a chip of the wall is no piece of the polyp, nor is what is burnt");
    let is_free = |piece: &&Piece| after.objects[piece.object as usize].is_free_piece();
    let chip_m3: f64 = parts.iter().filter(is_free).map(|piece| piece.volume_m3).sum();
    let healthy_m3 = healthy_removed_m3(&world, &after);
    assert!(is_near(healthy_m3, chip_m3), "{healthy_m3} of {chip_m3} m³ came free of the wall");

    // A part of the polyp, and some of what stays is burnt.
    let (halved, piece, _) = parted(&world, 0.0);
    let free_m3 = halved.volume_of_m3(piece);
    let parts = [Piece { object: piece, of: polyp, volume_m3: free_m3, is_held: false }];
    let mut after = made(halved.clone());
    fill(&mut after, only(&halved, |tet| !is_burnt(tet, &halved)));
    let (removed, freed) = (removed_m3(&world, &after), freed_m3(&world, &after, &parts));
    assert!(is_near(freed, free_m3) && removed > 1.01 * free_m3, "{freed} of {free_m3} m³, {removed} m³ removed");
}

/// A piece is told of by its state, so who looks less often, or takes over, knows of the same.
#[test]
fn the_largest_piece_and_what_was_taken_off_the_wall_stay_whoever_goes_on_from_the_state() {
    let (station, pages, life, mut inbox) = begun("largest");
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let mut now = first_state(&mut main);
    let core = Core { largest_piece_ml: 0.25, healthy_removed_ml: 0.5, ..core_of(&now) };
    now = with_core(&now, &core);
    let next = fed(&mut main, &pages[1], &now, &InputRecord { tick: 1, ..InputRecord::default() });
    let after = fed(&mut successor, &pages[1], &next, &InputRecord { tick: 2, ..InputRecord::default() });
    assert_eq!([&next, &after].map(|state| core_of(state).largest_piece_ml), [0.25; 2]);
    assert_eq!([&main, &successor].map(|engine| engine.status.largest_piece_ml), [0.25; 2]);
    assert_eq!([&next, &after].map(|state| core_of(state).healthy_removed_ml), [0.5; 2]);
    assert_eq!([&main, &successor].map(|engine| engine.status.healthy_removed_ml), [0.5; 2]);
    assert!(!Core { largest_piece_ml: f64::NAN, ..core }.is_sane());
    drop((main, successor));
}

#[test]
fn a_cut_into_the_wall_removes_nothing() {
    let (station, pages, life, mut inbox) = begun("wall");
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let (skin, electrode) = (&world.body.skin, world.case.electrode.as_ref().expect("the default instrument has a loop"));
    let object = |vertex: usize| world.body.rest.regions[skin.bindings[vertex].tet as usize];
    let wall = (0..skin.rest_m.len()).filter(|vertex| !world.case.is_pathology(&world.body, object(*vertex)));
    // The polyp hangs on the patient's right, which is +x.
    let [x, y, z] = wall.map(|vertex| skin.rest_m[vertex]).min_by(|one, other| one[0].total_cmp(&other[0])).unwrap();
    let mut now = first_state(&mut main);
    for tick in 1..=SWEEP {
        let mut record = sweeping(&world, tick);
        let gone_m = (tick as f32 / SWEEP as f32 - 0.5) * THROUGH_M;
        let (radius_m, reach_m) = (electrode.radius_m, electrode.reach_m);
        record.sample.pose.position_m = [x + radius_m + DEEP_M, y - radius_m + gone_m, z - reach_m];
        now = fed(&mut main, &pages[1], &now, &record);
    }
    let core = core_of(&now);
    assert!(core.cuts > 0, "the ring went through nothing");
    assert_eq!(core.removed_volume_ml, 0.0, "{} cuts into the wall", core.cuts);
    // Cut by cut it is what is missing in the end, but for the rounding of the nodes that they made.
    let missing_ml = 1e6 * healthy_removed_m3(&world, &main.world);
    assert!((core.healthy_removed_ml - missing_ml).abs() < 1e-4, "{} of {missing_ml} ml", core.healthy_removed_ml);
    assert_eq!(main.status.healthy_removed_ml, core.healthy_removed_ml);
    drop(main);
}
