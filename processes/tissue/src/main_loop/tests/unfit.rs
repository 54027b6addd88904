//! Promise of the Main Loop about its input: a record that is none, because a number of the hand is none or its orientation is no rotation, is a missing one.
//! Of one that says of the medium what cannot be the hand counts, and the medium stays as it was.

use super::*;
use hyst_messages::{BUTTON_EXTENDED, Controls};

#[test]
fn a_tool_that_is_nowhere_stays_where_it_was_and_its_state_is_gone_on_from() {
    let (station, pages, life, mut inbox) = begun("unfit");
    let mut main = engine(&station, &life, &mut inbox);
    let mut fit = InputRecord { tick: 1, pressure_pa: main.world.case.rest_pressure_pa, ..InputRecord::default() };
    fit.sample.pose = Pose { position_m: [0.0, 0.001, 0.01], ..main.first_core().pose };
    fit.sample.velocity_m_s = [0.0, 0.0, 0.01];
    fit.sample.controls = Controls { buttons: BUTTON_EXTENDED, loop_extension_m: 0.004, ..Controls::default() };
    let mut now = first_state(&mut main);
    now = fed(&mut main, &pages[1], &now, &fit);
    assert_eq!(core_of(&now).pose, fit.sample.pose);
    type Spoil = fn(&mut InputRecord);
    let spoilt: [(&str, Spoil); 6] = [
        ("a place", |record| record.sample.pose.position_m[1] = f32::NAN),
        ("an angle", |record| record.sample.pose.roll_rad = f32::INFINITY),
        ("no rotation", |record| record.sample.pose.orientation = [0.0, 3.0, 0.0, 3.0]),
        ("a little rotation", |record| record.sample.pose.orientation = [0.0, 0.0, 0.0, 1e-3]),
        ("a speed", |record| record.sample.velocity_m_s[2] = f32::NAN),
        ("a loop", |record| record.sample.controls.loop_extension_m = f32::NAN),
    ];
    for (tick, (what, spoil)) in (2..).zip(spoilt) {
        let mut record = InputRecord { tick, ..fit };
        spoil(&mut record);
        now = fed(&mut main, &pages[1], &now, &record);
        let core = core_of(&now);
        assert_eq!((core.pose, core.velocity_m_s, core.loop_m), (fit.sample.pose, fit.sample.velocity_m_s, 0.004), "{what}");
        assert_eq!(parts_of(&now).0.input_tick, 1, "{what}: the one before is named");
        assert!(main.accepts(bytemuck::cast_slice(&now)), "{what}");
    }
    drop(main);
}

#[test]
fn a_medium_that_is_no_number_is_none_and_the_hand_beside_it_counts() {
    let (station, pages, life, mut inbox) = begun("unsound");
    let mut main = engine(&station, &life, &mut inbox);
    let pressure_pa = main.world.case.rest_pressure_pa + 100.0;
    let mut fit = InputRecord { tick: 1, pressure_pa, ..InputRecord::default() };
    fit.sample.pose = main.first_core().pose;
    fit.pieces[0] = PieceFlow { object: 1, velocity_m_s: [0.0, 0.01, 0.0] };
    let mut now = first_state(&mut main);
    now = fed(&mut main, &pages[1], &now, &fit);
    assert_eq!((core_of(&now).pressure_pa, core_of(&now).pieces), (pressure_pa, fit.pieces));
    type Spoil = fn(&mut InputRecord);
    let spoilt: [(&str, Spoil); 6] = [
        ("no pressure", |record| record.pressure_pa = f32::NAN),
        ("a pressure without an end", |record| record.pressure_pa = f32::INFINITY),
        ("no flow", |record| record.pieces[0].velocity_m_s[1] = f32::NAN),
        ("a flow without an end", |record| record.pieces[1].velocity_m_s[2] = f32::NEG_INFINITY),
        ("a wild flow", |record| record.pieces[0].velocity_m_s[0] = 1e30),
        ("no force on the scope", |record| record.on_scope_n[2] = f32::NAN),
    ];
    for (tick, (what, spoil)) in (2..).zip(spoilt) {
        let mut record = InputRecord { tick, pressure_pa: pressure_pa + 100.0, ..fit };
        record.sample.pose.position_m[2] += 1e-4 * tick as f32;
        spoil(&mut record);
        now = fed(&mut main, &pages[1], &now, &record);
        let core = core_of(&now);
        assert_eq!((core.pressure_pa, core.pieces), (pressure_pa, fit.pieces), "{what}");
        assert_eq!((core.pose, parts_of(&now).0.input_tick), (record.sample.pose, tick), "{what}: the hand");
        assert!(main.accepts(bytemuck::cast_slice(&now)), "{what}");
    }
    drop(main);
}
