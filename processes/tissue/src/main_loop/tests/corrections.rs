//! Promise of the Main Loop about what its steps had to mend: nothing in a healthy run, and whatever it was is counted in the state, so that nobody forgets it.

use super::*;
use crate::state::FARTHEST_M;
use glam::Vec3;

/// Ticks in which the tip goes to the nearest place of the wall, and how far beyond it goes, m.
const WAY: u64 = 400;
const DEEP_M: f32 = 1e-3;
/// How far a node is thrown out of its place, m.
const THROWN_M: f32 = 0.1;

#[test]
fn a_press_needs_no_correction_and_what_a_state_that_bursts_takes_is_counted_and_carried_on() {
    let (station, pages, life, mut inbox) = begun("mended");
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let mut now = first_state(&mut main);
    let rest = main.first_core().pose;
    let from = Vec3::from(rest.position_m);
    let away_m = |place: &Vec3| place.distance(from);
    let wall = main.world.body.skin.rest_m.iter().map(|place| Vec3::from(*place));
    let nearest = wall.min_by(|one, other| away_m(one).total_cmp(&away_m(other))).unwrap();
    let to = nearest + (nearest - from).normalize() * DEEP_M;
    let at = |tick: u64| {
        let place = from.lerp(to, tick.min(WAY) as f32 / WAY as f32);
        Pose { position_m: place.to_array(), ..rest }
    };
    for tick in 1..=WAY {
        now = stepped(&mut main, &pages[1], &now, tick, at(tick), PieceFlow::default());
    }
    assert!(main.status.contact_count > 0, "the tip touches nothing");
    assert_eq!((core_of(&now).corrections, main.status.corrections), (0, 0), "a press is healthy");
    assert_eq!(main.status.hits_dropped, 0, "and all that it meets is known");

    let node = main.world.body.rest.tets[0].into_iter().find(|node| !main.world.model.is_held(*node as usize)).unwrap();
    let first = (positions(&now).as_ptr() as usize - now.as_ptr() as usize) / 4;
    let words: &mut [f32] = bytemuck::cast_slice_mut(&mut now);
    words[first + 3 * node as usize] += THROWN_M;
    let burst = stepped(&mut main, &pages[1], &now, WAY + 1, at(WAY), PieceFlow::default());
    let corrections = core_of(&burst).corrections;
    assert!(corrections > 0 && main.status.corrections == corrections, "{corrections}, {:?}", main.status);
    let after = stepped(&mut successor, &pages[1], &burst, WAY + 2, at(WAY), PieceFlow::default());
    assert!(core_of(&after).corrections >= corrections, "who goes on knows of it");
    drop((main, successor));
}

#[test]
fn hits_that_find_no_room_are_counted() {
    let (station, pages, life, mut inbox) = begun("dropped");
    let mut main = engine(&station, &life, &mut inbox);
    let mut now = first_state(&mut main);
    let pose = Pose { position_m: main.world.body.skin.rest_m[0], ..main.first_core().pose };
    for (tick, is_cramped) in [(1, false), (2, true)] {
        if is_cramped {
            main.collision.cramp(1);
        }
        now = stepped(&mut main, &pages[1], &now, tick, pose, PieceFlow::default());
        assert_eq!(main.status.hits_dropped > 0, is_cramped, "{} contacts", main.status.contact_count);
    }
    drop(main);
}

/// A node was left where no state of it is taken: its maker refused it, too, made it again, and stood still.
#[test]
fn a_node_that_strays_to_where_no_state_is_taken_is_put_back() {
    let (station, pages, life, mut inbox) = begun("strays");
    let mut main = engine(&station, &life, &mut inbox);
    let mut now = first_state(&mut main);
    // Nothing but this draws it back.
    let model = &main.world.model;
    let held = (0..model.node_count()).filter(|node| model.is_held(*node));
    let node = held.max_by(|one, other| model.rest_m()[*one][2].total_cmp(&model.rest_m()[*other][2])).unwrap();
    let first = (positions(&now).as_ptr() as usize - now.as_ptr() as usize) / 4;
    let words: &mut [f32] = bytemuck::cast_slice_mut(&mut now);
    words[first + 3 * node + 2] = FARTHEST_M + 0.01;
    let pose = main.first_core().pose;
    let after = stepped(&mut main, &pages[1], &now, 1, pose, PieceFlow::default());
    assert!(main.accepts(bytemuck::cast_slice(&after)), "its maker goes on from it");
    assert!(core_of(&after).corrections > 0, "and that it was put back is counted");
    drop(main);
}
