//! Promise of the Main Loop about the limits of cutting: a sweep that is cut coarser than was asked for, or not at all, is counted in the state, and so by whoever
//! goes on from it.

use super::*;

/// What is left of the room for tets: less than a stroke through the polyp takes.
const LEFT_TETS: usize = 12;

/// The cuts, and the sweeps that met a limit, of the ring that goes through the polyp, with the tets by which the mesh grew at most.
fn swept(name: &str, left_tets: Option<usize>) -> (u32, u32, usize) {
    let (station, pages) = founded(name, "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let (mut workshop, mut world) = Workshop::load(&life).unwrap();
    if let Some(tets) = left_tets {
        world = workshop.cramp(world, tets);
    }
    let mut main = MainLoop::new(&life, workshop, world).unwrap();
    main.arrival(page_of(&station, Role::Device), &mut inbox);
    let whole = Arc::clone(&main.world);
    let mut now = first_state(&mut main);
    let mut most = 0;
    for tick in 1..=SWEEP {
        now = fed(&mut main, &pages[1], &now, &sweeping(&whole, tick));
        most = most.max(main.world.body.rest.tets.len());
    }
    let core = core_of(&now);
    assert_eq!(main.status.cut_limits, core.cut_limits, "what the state counts is told");
    assert!(main.status.substeps > 0, "and so are the substeps");
    // Without current nothing is swept, and what was counted stays.
    let after = fed(&mut main, &pages[1], &now, &InputRecord { tick: SWEEP + 1, ..InputRecord::default() });
    assert_eq!(core_of(&after).cut_limits, core.cut_limits);
    (core.cuts, core.cut_limits, most.saturating_sub(whole.body.rest.tets.len()))
}

#[test]
fn a_cut_that_found_no_room_in_the_mesh_is_counted() {
    let (roomy, cramped) = (swept("roomy", None), swept("cramped", Some(LEFT_TETS)));
    println!("cuts, limits and tets more: {roomy:?} with room, {cramped:?} with room for {LEFT_TETS}");
    assert!(roomy.2 > LEFT_TETS, "a stroke takes {} tets: nothing was tried", roomy.2);
    assert!(cramped.2 <= LEFT_TETS, "{} tets more than there is room for", cramped.2);
    assert!(cramped.1 > roomy.1 && cramped.1 > 0, "{cramped:?} {roomy:?}");
}

/// Its maker alone went on from a mesh that all others refused: there was no spare, and no successor got a state.
#[test]
fn a_mesh_that_nobody_else_would_take_is_not_gone_on_from() {
    let (station, _pages) = founded("refused", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    let (body, most) = (main.world.body.clone(), main.world.case.room.triangles);
    assert!(main.made(body.clone()).is_ok());
    let (mut crowded, mut nowhere) = (body.clone(), body);
    let triangle = crowded.skin.triangles[0];
    crowded.skin.triangles.resize(most + 1, triangle);
    nowhere.skin.rest_m[0][1] = f32::NAN;
    for body in [crowded, nowhere] {
        assert!(main.workshop.make(body.clone()).is_ok(), "a model can be made of it");
        assert!(main.made(body).is_err(), "and it is no body for anybody else");
    }
    drop(main);
}
