//! Promise of the Main Loop about what is removed: pathology that nothing holds any more, whether it is burnt or has come free, and that once. Of the wall
//! nothing is.

use super::pieces::parted;
use super::*;
use crate::body::Body;
use crate::knife::{has_parted, removed_m3};

/// How far the ring goes through the wall, m, and how deep in it its end begins.
const THROUGH_M: f32 = 6e-3;
const DEEP_M: f32 = 1e-3;

/// The body with some of its tets alone: the rest is burnt. Nobody asks it for its surface.
fn only(body: &Body, is_kept: impl Fn(usize) -> bool) -> Body {
    let (mut left, tets) = (body.clone(), 0..body.rest.tets.len());
    left.rest.tets = tets.clone().filter(|tet| is_kept(*tet)).map(|tet| body.rest.tets[tet]).collect();
    left.rest.regions = tets.filter(|tet| is_kept(*tet)).map(|tet| body.rest.regions[tet]).collect();
    left
}

#[test]
fn what_is_burnt_of_the_wall_is_not_removed_and_what_is_burnt_of_the_polyp_or_comes_free_of_it_is_once() {
    let (station, _pages) = founded("removed", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let body = &world.body;
    let is_polyp = |tet: usize| world.case.is_pathology(body, body.rest.regions[tet]);
    let polyp = (0..body.rest.tets.len()).find(|tet| is_polyp(*tet)).map(|tet| body.rest.regions[tet]).unwrap();
    let mut made = |body: Body| main.workshop.make(body).unwrap();
    let is_near = |found_m3: f64, exact_m3: f64| exact_m3 > 1e-10 && (found_m3 - exact_m3).abs() < 1e-6 * exact_m3;

    let mut after = made(body.clone());
    after.body = only(body, |tet| is_polyp(tet) || tet % 3 > 0);
    assert!(after.body.rest.tets.len() < body.rest.tets.len(), "a third of the wall is burnt");
    assert_eq!(removed_m3(&world, &after), 0.0, "and none of the polyp");
    after.body = only(body, |tet| tet % 3 > 0);
    let burnt_m3 = only(body, |tet| tet % 3 == 0).volume_of_m3(polyp);
    assert!(is_near(removed_m3(&world, &after), burnt_m3), "{} of {burnt_m3} m³", removed_m3(&world, &after));

    let (halved, piece, _) = parted(&world, 0.0);
    let freed = made(halved);
    let free_m3 = freed.body.volume_of_m3(piece);
    assert!(has_parted(&world, &freed) && !has_parted(&world, &after), "what is burnt is no piece");
    assert!(is_near(removed_m3(&world, &freed), free_m3), "{} of {free_m3} m³", removed_m3(&world, &freed));
    let gone = made(freed.body.without(piece));
    assert_eq!(removed_m3(&freed, &gone), 0.0, "it has been counted when it came free");
    assert!(!has_parted(&freed, &gone), "nor is one that leaves another one");
    assert!(is_near(removed_m3(&world, &gone), free_m3));
    assert!(!world.case.is_loose_in_scene(polyp) && !world.case.is_loose_in_scene(piece), "nor is it when it leaves");
}

/// A piece is told of by its state, so who looks less often, or takes over, knows of the same.
#[test]
fn the_largest_piece_stays_the_largest_whoever_goes_on_from_the_state() {
    let (station, pages) = founded("largest", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let mut now = first_state(&mut main);
    let core = Core { largest_piece_ml: 0.25, ..core_of(&now) };
    let section: &[u8] = Message::parse(bytemuck::cast_slice(&now), Kind::TissueState).unwrap().section(0).unwrap();
    let at = section.as_ptr() as usize - now.as_ptr() as usize;
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut now);
    bytes[at..at + size_of::<Core>()].copy_from_slice(bytemuck::bytes_of(&core));
    let next = fed(&mut main, &pages[1], &now, &InputRecord { tick: 1, ..InputRecord::default() });
    let after = fed(&mut successor, &pages[1], &next, &InputRecord { tick: 2, ..InputRecord::default() });
    assert_eq!([&next, &after].map(|state| core_of(state).largest_piece_ml), [0.25; 2]);
    assert_eq!([&main, &successor].map(|engine| engine.status.largest_piece_ml), [0.25; 2]);
    assert!(!Core { largest_piece_ml: f64::NAN, ..core }.is_sane());
    drop((main, successor));
}

#[test]
fn a_cut_into_the_wall_removes_nothing() {
    let (station, pages) = founded("wall", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    let world = Arc::clone(&main.world);
    let (skin, electrode) = (&world.body.skin, world.case.electrode.as_ref().expect("the default instrument has a loop"));
    let object = |vertex: usize| world.body.rest.regions[skin.bindings[vertex].tet as usize];
    let wall = (0..skin.rest_m.len()).filter(|vertex| !world.case.is_pathology(&world.body, object(*vertex)));
    // The polyp hangs on the patient's left, which is +x.
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
    drop(main);
}
