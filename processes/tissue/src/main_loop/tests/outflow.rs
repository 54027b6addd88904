//! Promise of the Main Loop about the outflow: a small piece leaves through it, once, whoever goes on from which state; a large one is caught.

use super::pieces::{parted, sunk};
use super::*;
use crate::body::Body;
use crate::outlet::MOST_M3;
use glam::Vec3;

/// Ticks in which the outflow holds a piece, and in which it then goes back.
const HOLDS: u64 = 400;
const GOES: u64 = 500;
/// How fast it goes, m/s.
const BACK_M_S: f32 = 0.02;
/// Where the middle of the large piece is put, m: in the middle of the cavity, to the patient's left; and how far to the right of it the shaft lies.
const OPEN_M: Vec3 = Vec3::new(-0.004, 0.0, 0.03);
const BESIDE_M: f32 = 0.0075;

/// The input in which the outflow is at a place and its valve open so far; the instrument goes with `velocity_m_s`.
fn at(world: &World, tick: u64, place_m: Vec3, valve: f32, velocity_m_s: Vec3) -> InputRecord {
    let mut record = InputRecord { tick, pressure_pa: world.case.rest_pressure_pa, ..InputRecord::default() };
    record.sample.pose.orientation = [0.0, 0.0, 0.0, 1.0];
    record.sample.controls.outflow_valve = 1.0;
    let of_origin_m = world.case.outlet.draw(&record).unwrap().place_m;
    record.sample.pose.position_m = (place_m - of_origin_m).to_array();
    record.sample.velocity_m_s = velocity_m_s.to_array();
    record.sample.controls.outflow_valve = valve;
    record
}

/// Goes on from the scene's first state of another body.
fn with_body(main: &mut MainLoop<'_>, body: Body) -> Vec<u64> {
    let world = main.workshop.make(body).unwrap();
    main.take_world(world);
    first_state(main)
}

#[test]
fn a_small_piece_leaves_through_the_open_outflow_once_whoever_goes_on_from_which_state() {
    let (station, pages, life, mut inbox) = begun("leaves");
    let [mut main, mut successor, mut late] = [(); 3].map(|()| engine(&station, &life, &mut inbox));
    let chips = (1..20).map(|step| parted(&main.world, 0.5e-3 * step as f32));
    let (body, object, _) = chips.into_iter().find(|(body, object, _)| body.volume_of_m3(*object) <= MOST_M3).unwrap();
    let volume_ml = 1e6 * body.volume_of_m3(object);
    let now = with_body(&mut main, body);
    let present = main.site.present();
    let (_, place_m) = sunk(&main, &now, object);
    let world = Arc::clone(&main.world);

    let before = fed(&mut main, &pages[1], &now, &at(&world, 1, place_m, 0.0, Vec3::ZERO));
    assert_eq!((core_of(&before).washed_out, main.site.present()), (0, present), "the valve is shut");
    let far = fed(&mut main, &pages[1], &before, &at(&world, 2, place_m - 0.02 * Vec3::Z, 1.0, Vec3::ZERO));
    assert_eq!(core_of(&far).washed_out, 0, "it has not come to the outflow");
    let after = fed(&mut main, &pages[1], &before, &at(&world, 3, place_m, 1.0, Vec3::ZERO));
    let (core, was) = (core_of(&after), core_of(&before));
    assert!((core.washed_out_ml - volume_ml).abs() < 1e-9 && core.washed_out == 1, "{core:?}, {volume_ml} ml");
    assert_eq!((core.removed_volume_ml, core.cuts), (was.removed_volume_ml, was.cuts), "it was removed when it came free");
    assert!(!main.world.body.owners().contains(&Some(object)) && main.world.objects[object as usize].tets[1] == 0);
    assert_eq!((main.site.present(), main.world.drifters.len()), (present - 1, 0));
    assert_eq!(main.world.body.origin.len(), world.body.origin.len(), "its number is nobody else's");

    // The holder dies before it has sent that, or after: the same state, and in no state after it is the piece there or counted again.
    assert!(successor.accepts(bytemuck::cast_slice(&before)) && late.accepts(bytemuck::cast_slice(&after)));
    let mut again = vec![0u64; after.len()];
    successor.step(&context(4), bytemuck::cast_slice(&before), bytemuck::cast_slice_mut(&mut again)).unwrap();
    assert!(again == after, "the successor's state is another one");
    let mut states = [after.clone(), after.clone(), after];
    for tick in 5..10 {
        let record = at(&world, tick, place_m, 1.0, Vec3::ZERO);
        for (engine, state) in [&mut main, &mut successor, &mut late].into_iter().zip(&mut states) {
            *state = fed(engine, &pages[1], state, &record);
            assert_eq!((core_of(state).washed_out, core_of(state).washed_out_ml), (1, core.washed_out_ml));
            assert!(!engine.world.body.owners().contains(&Some(object)));
        }
    }
    assert!(states[0] == states[1] && states[0] == states[2]);
    drop((main, successor, late));
}

/// A state in which an object has been moved so that its middle is at a place.
fn moved(main: &MainLoop<'_>, mut now: Vec<u64>, object: u32, to_m: Vec3) -> Vec<u64> {
    let (_, from_m) = sunk(main, &now, object);
    let owner = main.world.body.owners();
    let first = (positions(&now).as_ptr() as usize - now.as_ptr() as usize) / 4;
    let words: &mut [f32] = bytemuck::cast_slice_mut(&mut now);
    for node in (0..owner.len()).filter(|node| owner[*node] == Some(object)) {
        (0..3).for_each(|axis| words[first + 3 * node + axis] += (to_m - from_m)[axis]);
    }
    now
}

#[test]
fn a_large_piece_is_caught_at_the_outflow_while_it_draws_and_goes_along_with_it() {
    let (station, pages, life, mut inbox) = begun("caught");
    let mut main = engine(&station, &life, &mut inbox);
    let (body, object, _) = parted(&main.world, 0.0);
    assert!(body.volume_of_m3(object) > 2.0 * MOST_M3, "{} m³", body.volume_of_m3(object));
    let first = with_body(&mut main, body);
    let first = moved(&main, first, object, OPEN_M);
    let world = Arc::clone(&main.world);
    let mut carried = |valve: f32| {
        let mut now = first.clone();
        let mut place_m = OPEN_M + BESIDE_M * Vec3::X;
        for tick in 1..HOLDS + GOES {
            let speed_m_s = if tick < HOLDS { 0.0 } else { BACK_M_S };
            place_m.z -= 1e-3 * speed_m_s;
            now = fed(&mut main, &pages[1], &now, &at(&world, tick, place_m, valve, -speed_m_s * Vec3::Z));
        }
        assert_eq!(core_of(&now).washed_out, 0, "it is too large");
        sunk(&main, &now, object).1 - OPEN_M
    };
    let (shut, open) = (carried(0.0), carried(1.0));
    let gone_m = 1e-3 * BACK_M_S * GOES as f32;
    println!("the outflow goes back by {gone_m} m, the piece goes by {open} with an open valve, by {shut} with a shut one");
    // With a shut valve it is rubbed by the scope on which it lies, and left behind.
    assert!(open.z < -0.9 * gone_m && shut.z.abs() < 0.6 * gone_m, "{open} with an open valve, {shut} with a shut one");
}
