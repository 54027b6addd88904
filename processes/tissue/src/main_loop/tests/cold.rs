//! Promise of the Main Loop about the loop electrode: cold, it is as solid as the shaft, and the hand feels what it presses on; with current in it, it cuts, and
//! in its sheath it is not there. Under the current that coagulates it is as solid as a cold one. One whose pedal is let go in tissue becomes solid by and by:
//! no model jumps by more than a servo lets through, and in the end the hand feels what it would otherwise.

use super::*;
use crate::contacts;
use glam::Vec3;
use hyst_coupling::ServoParams;
use hyst_messages::{BUTTON_COAGULATING, BUTTON_EXTENDED, Controls};

/// Ticks in which the ring comes to the fundus and presses on it, and in which it stays there.
const WAY: u64 = 300;
const STAY: u64 = 100;
/// Ticks of a way across, and its speed, m/s.
const ACROSS: u64 = 40;
const ACROSS_M_S: f32 = 0.02;

/// Ticks in which a wire rests in tissue under current, those after its pedal is let go, and of those the last ones, of which the mean force counts.
const HOT: u64 = 20;
const LET_GO: u64 = 400;
const MEAN_OF: usize = 100;
/// In which of them a successor goes on from the state.
const SUCCEEDED_IN: u64 = 12;

/// From where before the place at which the ring meets the fundus to where behind it the ring goes, m.
const BEFORE_M: f32 = -2e-3;
const DEEP_M: f32 = 3e-3;

/// What came of a press of the ring on the fundus, straight ahead, the shaft as far before it as the loop reaches.
struct Pressed {
    /// Along the shaft, out of the fundus, N.
    force_n: f32,
    displaced_m: f32,
    core: Core,
    /// Force along +x while the ring goes there, and while it comes back, N.
    across_n: [f32; 2],
}

/// Where the ring first meets tissue on its way straight ahead, m along z.
fn first_met_m(world: &World, electrode: &hyst_scene::LoadedLoop) -> f32 {
    let tissue = contacts::tissue(world, world.model.rest_m());
    let owner = vec![u32::MAX; electrode.wire_m.len()];
    let points = hyst_contact::Points { owner: &owner, node: &[], own: None };
    let mut hits = vec![hyst_contact::Hit::default(); 8 * owner.len()];
    let ahead_m = (100..600).map(|step| 1e-4 * step as f32);
    let mut meets = |ring_m: &f32| {
        let wire_m: Vec<[f32; 3]> = electrode.wire_at(*ring_m).collect();
        hyst_contact::intersect_brute(&wire_m, &points, &tissue, &mut hits).unwrap().count > 0
    };
    ahead_m.filter(|ring_m| *ring_m > electrode.reach_m).find(|ring_m| meets(ring_m)).expect("the fundus is ahead")
}

fn pressed(name: &str, controls: impl Fn(f32) -> Controls) -> Pressed {
    let (station, pages, life, mut inbox) = begun(name);
    let mut main = engine(&station, &life, &mut inbox);
    let electrode = main.world.case.electrode.clone().unwrap();
    let reach_m = electrode.reach_m;
    let met_m = first_met_m(&main.world, &electrode);
    let record = |tick: u64| {
        let ring_m = met_m + BEFORE_M + tick.min(WAY) as f32 / WAY as f32 * (DEEP_M - BEFORE_M);
        let there = tick.saturating_sub(WAY + STAY).min(ACROSS);
        let back = tick.saturating_sub(WAY + STAY + ACROSS);
        let place = [(there as f32 - back as f32) * ACROSS_M_S * 1e-3, 0.0, ring_m - reach_m];
        let mut record = InputRecord { tick, pressure_pa: 9333.0, ..InputRecord::default() };
        record.sample.pose = Pose { position_m: place, orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let sense = i32::from(there > 0) - 2 * i32::from(back > 0);
        let along_x_m_s = sense as f32 * ACROSS_M_S;
        record.sample.velocity_m_s = [along_x_m_s, 0.0, 0.0];
        record.sample.controls = controls(reach_m);
        record
    };
    let mut now = first_state(&mut main);
    for tick in 1..=WAY + STAY {
        now = fed(&mut main, &pages[1], &now, &record(tick));
        assert!(main.accepts(bytemuck::cast_slice(&now)), "{name}: the state of tick {tick} is none");
    }
    let core = core_of(&now);
    let displaced_m = displaced_m(&main, &now);
    let across_n = [1, 2].map(|part| {
        let ticks = WAY + STAY + (part - 1) * ACROSS + 1..=WAY + STAY + part * ACROSS;
        let sum: f32 = ticks
            .map(|tick| {
                now = fed(&mut main, &pages[1], &now, &record(tick));
                core_of(&now).force_n[0]
            })
            .sum();
        sum / ACROSS as f32
    });
    Pressed { force_n: -core.force_n[2], displaced_m, core, across_n }
}

#[test]
fn a_cold_loop_is_solid_a_hot_one_cuts_and_one_in_its_sheath_is_not_there() {
    let out = |reach_m: f32| Controls { buttons: BUTTON_EXTENDED, loop_extension_m: reach_m, ..Controls::default() };
    let cold = pressed("cold", out);
    println!("cold: {:.3} N, {:.2} mm, across {:.4?} N", cold.force_n, 1e3 * cold.displaced_m, cold.across_n);
    assert!(cold.force_n > 0.1 && cold.force_n < 5.0, "{} N", cold.force_n);
    assert!(cold.displaced_m > 0.5e-3 && cold.core.contact_count > 5, "{} m, {:?}", cold.displaced_m, cold.core);
    assert_eq!((cold.core.is_cutting, cold.core.cuts), (0, 0));
    // It drags: what it feels on the way there is against +x beside what it feels on the way back over the same places.
    assert!(cold.across_n[0] < cold.across_n[1] - 0.01, "{:?} N", cold.across_n);

    let blunt = pressed("blunt", |reach_m| Controls { buttons: BUTTON_EXTENDED | BUTTON_COAGULATING, ..out(reach_m) });
    assert_eq!((blunt.core.is_cutting, blunt.core.cuts), (0, 0), "it coagulates");
    assert_eq!((blunt.force_n, blunt.displaced_m), (cold.force_n, cold.displaced_m));

    let hot = pressed("hot", |reach_m| Controls { buttons: BUTTON_EXTENDED | BUTTON_ENERGIZED, ..out(reach_m) });
    assert_eq!((hot.core.contact_count, hot.core.is_cutting, hot.core.loop_m), (0, 1, 0.0));
    assert!(hot.core.cuts > 0 && hot.force_n == 0.0, "{} cuts, {} N", hot.core.cuts, hot.force_n);

    let sheathed = pressed("sheathed", |_| Controls::default());
    assert_eq!((sheathed.core.contact_count, sheathed.core.cuts, sheathed.force_n), (0, 0, 0.0));
    assert!(sheathed.displaced_m < 1e-5, "{} m", sheathed.displaced_m);
}

/// The state as if its loop had been cold for long.
fn hardened(now: &[u64]) -> Vec<u64> {
    with_core(now, &Core { hold_m: 0.0, ..core_of(now) })
}

/// What the planes say at the tip in each tick since the pedal of a wire was let go that rests in the fundus, N; `at_once`: as if it had been cold for long.
fn let_go(name: &str, at_once: bool) -> Vec<Vec3> {
    let (station, pages, life, mut inbox) = begun(name);
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let electrode = main.world.case.electrode.clone().unwrap();
    let tip_m = [0.0, 0.0, first_met_m(&main.world, &electrode) + DEEP_M - electrode.reach_m];
    let mut record = InputRecord { pressure_pa: 9333.0, ..InputRecord::default() };
    record.sample.pose = Pose { position_m: tip_m, orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
    let (mut now, mut told_n) = (first_state(&mut main), Vec::new());
    for tick in 1..=HOT + LET_GO {
        let current = if tick <= HOT { BUTTON_ENERGIZED } else { 0 };
        let buttons = BUTTON_EXTENDED | current;
        record.sample.controls = Controls { buttons, loop_extension_m: electrode.reach_m, ..Controls::default() };
        record.tick = tick;
        let before = if at_once { hardened(&now) } else { now };
        now = fed(&mut main, &pages[1], &before, &record);
        if tick == HOT + SUCCEEDED_IN && !at_once {
            succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);
        }
        if tick > HOT {
            told_n.push(Vec3::from(main.planes.force_n(tip_m)));
        }
    }
    let Core { cuts, hold_m, .. } = core_of(&now);
    assert_eq!((cuts, hold_m, main.status.hold_m), (0, 0.0, 0.0), "it cuts nothing, and is as solid as a cold one");
    drop((main, successor));
    told_n
}

#[test]
fn a_wire_whose_pedal_is_let_go_in_tissue_is_pushed_out_without_a_step_and_in_the_end_as_hard() {
    let told_n = [("by-and-by", false), ("at-once", true)].map(|(name, at_once)| let_go(name, at_once));
    let [step_n, jump_n] = [&told_n[0], &told_n[1]].map(|told_n| {
        let steps_n = told_n.windows(2).map(|two| two[0].distance(two[1]));
        steps_n.fold(told_n[0].length(), f32::max)
    });
    let mean_n = |told_n: &Vec<Vec3>| told_n.iter().rev().take(MEAN_OF).sum::<Vec3>() / MEAN_OF as f32;
    let [end_n, expected_n] = [&told_n[0], &told_n[1]].map(mean_n);
    println!("{step_n} N in a tick by and by, {jump_n} N at once; {end_n} N in the end, {expected_n} N");
    let most_n = ServoParams::default().model_step_n;
    assert!(step_n < most_n, "the planes jump by {step_n} N");
    assert!(jump_n > 3.0 * most_n, "a wire that is solid at once is pushed by {jump_n} N: nothing was tried");
    assert!(expected_n.length() > 0.1 && end_n.distance(expected_n) < 0.15 * expected_n.length(), "{end_n}, not {expected_n} N");
}
