//! The hand at one tick after another: what scripts, pointer and scene make it press, set and turn.

use super::super::finger::Finger;
use super::*;
use hyst_messages::TICK_NS;
use hyst_messages::controls::{WINDOW_COAGULATION, WINDOW_FOCUS, WINDOW_INFLOW, WINDOW_PRESSURE};
use hyst_scene::Signal;

#[test]
fn the_scene_and_the_hand_mean_the_same_by_pitch_yaw_roll_and_insertion() {
    let pose = hyst_scene::Pose { pitch_rad: 0.2, yaw_rad: -0.3, roll_rad: 0.7, insertion_m: 0.06 };
    let (tip_m, orientation) = hyst_coupling::pose_from_dof([0.0, 0.01, 0.0], &pose4(&pose));
    for (a, b) in tip_m.iter().zip(pose.tip_m([0.0, 0.01, 0.0])) {
        assert!((a - b).abs() < 1e-6, "{tip_m:?}");
    }
    let dot: f32 = orientation.iter().zip(pose.orientation()).map(|(a, b)| a * b).sum();
    assert!(dot.abs() > 0.999_99, "{orientation:?} {:?}", pose.orientation());
}

/// The controls of each tick of a hand that meets no force.
fn controls(hand: &mut Hand, ticks: u64, pointer: Option<&PointerRecord>) -> Vec<Controls> {
    (0..ticks).map(|tick| hand.step(tick, [0.0; 3], pointer).controls).collect()
}

#[test]
fn the_scripts_bits_are_not_taken_for_each_other() {
    let scene = hyst_scene::load_embedded().unwrap();
    let found = scene.hand("polyp").unwrap();
    assert!(!found.legs.is_empty(), "{found:?}");
    let pressing = LoadedHand { legs: Vec::new(), ..found.clone() };
    let scenes = [scene.clone(), LoadedScene { hands: vec![pressing], ..scene }];
    for (what, scene) in ["legs", "script"].into_iter().zip(scenes) {
        let mut hand = Hand::in_scene(&scene, "script:polyp", 0).unwrap();
        let reach_m = scene.rigid[0].electrode.as_ref().unwrap().reach_m;
        let all = controls(&mut hand, 25_000, None);
        let cutting: Vec<_> = all.iter().filter(|controls| controls.buttons & BUTTON_ENERGIZED != 0).collect();
        assert!(cutting.len() > 1_000, "{what}: {} ticks", cutting.len());
        for controls in cutting {
            assert!(controls.buttons & BUTTON_EXTENDED != 0, "{what}: current in a loop that is to be in");
            assert_eq!(controls.loop_extension_m, reach_m, "{what}");
        }
        assert!(all.iter().any(|controls| controls.buttons == BUTTON_EXTENDED), "{what}: it goes out cold");
    }
}

#[test]
fn a_leg_that_coagulates_presses_the_other_pedal_and_who_has_no_loop_presses_none() {
    let mut scene = hyst_scene::load_embedded().unwrap();
    let mut found = scene.hand("polyp").unwrap().clone();
    for leg in &mut found.legs {
        (leg.is_energized, leg.is_coagulating) = (false, leg.is_energized);
    }
    scene.hands.push(LoadedHand { name: "staunch".into(), ..found });
    let pressed = |scene: &LoadedScene| {
        let mut hand = Hand::in_scene(scene, "script:staunch", 0).unwrap();
        let all = controls(&mut hand, 12_000, None);
        [Controls::coagulates, Controls::has_current].map(|is| all.iter().filter(|controls| is(controls)).count())
    };
    let [coagulates, has_current] = pressed(&scene);
    assert!(coagulates > 1_000 && has_current == coagulates, "{coagulates} of {has_current} ticks");
    scene.rigid[0].electrode = None;
    assert_eq!(pressed(&scene), [0; 2]);
}

#[test]
fn the_hand_opens_the_outflow_once_it_has_cut_and_leaves_it_to_a_scene_that_sets_it() {
    let mut scene = hyst_scene::load_embedded().unwrap();
    let mut valves = |changes: Vec<PumpChange>| {
        scene.fluid.changes = changes;
        let all = controls(&mut Hand::in_scene(&scene, "script:polyp", 0).unwrap(), 12_000, None);
        let cut = all.iter().position(|controls| controls.buttons & BUTTON_ENERGIZED != 0).unwrap();
        let [before, after] =
            [&all[..cut], &all[cut..]].map(|part| part.iter().map(|controls| controls.outflow_valve).fold(0.0, f32::max));
        (before, after)
    };
    assert_eq!(valves(Vec::new()), (0.3, 1.0));
    let shut = PumpChange { at_s: 0.0, outflow_valve: Some(0.2), ..PumpChange::default() };
    assert_eq!(valves(vec![shut]).1, 0.2);
    assert_eq!(valves(vec![PumpChange { outflow_valve: None, set_pressure_pa: Some(5e3), ..shut }]), (0.3, 1.0));
}

#[test]
fn the_loop_goes_out_and_in_as_fast_as_a_thumb_and_no_farther_than_it_reaches() {
    let scene = hyst_scene::load_embedded().unwrap();
    let mut hand = Hand::in_scene(&scene, "mouse", 0).unwrap();
    let pressed = |buttons: u32| PointerRecord {
        sequence: 1,
        controls: Controls { buttons, ..Controls::default() },
        ..PointerRecord::default()
    };
    let mut before_m = 0.0;
    for (buttons, ticks, end_m) in [(BUTTON_EXTENDED, 200, 0.006), (BUTTON_EXTENDED, 300, 0.012), (BUTTON_ENERGIZED, 500, 0.0)] {
        for controls in controls(&mut hand, ticks, Some(&pressed(buttons))) {
            assert!((controls.loop_extension_m - before_m).abs() <= 30.1e-6, "{controls:?}");
            before_m = controls.loop_extension_m;
        }
        assert!((before_m - end_m).abs() < 1e-6, "{before_m}");
    }
}

/// Who held the key when the window went had current in the loop to the end of the session.
#[test]
fn a_window_that_falls_silent_has_no_finger_on_the_current_and_the_rest_stays_as_it_said() {
    let scene = hyst_scene::load_embedded().unwrap();
    let mut hand = Hand::in_scene(&scene, "mouse", 0).unwrap();
    let mut finger = Finger::new(0);
    let buttons = BUTTON_ENERGIZED | BUTTON_EXTENDED;
    let controls = Controls { buttons, set_pressure_pa: 5_000.0, ..Controls::default() };
    let mut at = |tick: u64, sequence: u64| {
        let said = PointerRecord { sequence, target: [0.0, 0.0, 0.0, 0.04, 0.0], controls };
        hand.step(tick, [0.0; 3], Some(&finger.heed(tick * TICK_NS, said))).controls
    };
    assert!((0..2_000).all(|tick| at(tick, 1 + tick / 10).buttons == buttons), "the key is held, and a record comes every 10 ms");
    let silent: Vec<Controls> = (2_000..2_500).map(|tick| at(tick, 200)).collect();
    assert_eq!(silent.iter().position(|controls| controls.buttons != buttons), Some(190), "200 ms after the last one");
    assert!(silent[190..].iter().all(|controls| (controls.buttons, controls.set_pressure_pa) == (BUTTON_EXTENDED, 5_000.0)));
    assert_eq!(at(2_500, 201).buttons, buttons);
}

#[test]
fn the_horizon_stays_with_the_camera_head_however_the_scope_turns_in_it() {
    let scene = hyst_scene::load_embedded().unwrap();
    let mut hand = Hand::in_scene(&scene, "mouse", 0).unwrap();
    let turned = PointerRecord { sequence: 1, target: [0.0, 0.0, 0.2, 0.04, 0.3], ..PointerRecord::default() };
    let mut before_rad = 0.0;
    for tick in 0..300 {
        let pose = hand.step(tick, [0.0; 3], Some(&turned)).pose;
        assert!((pose.camera_roll_rad - before_rad).abs() <= 3.001e-3, "{pose:?}");
        before_rad = pose.camera_roll_rad;
    }
    let left = hand.step(300, [0.0; 3], None).pose;
    assert!((left.camera_roll_rad + left.roll_rad - 0.3).abs() < 2e-3 && (left.roll_rad - 0.2).abs() < 0.05, "{left:?}");
    // The light post goes a quarter round, at no more than the other hand follows: the horizon is where it was.
    let post = PointerRecord { target: [0.0, 0.0, 1.6, 0.04, 0.3], ..turned };
    let mut pose = left;
    for tick in 301..3_000 {
        pose = hand.step(tick, [0.0; 3], Some(&post)).pose;
    }
    assert!((pose.roll_rad - 1.6).abs() < 0.05 && (pose.camera_roll_rad + pose.roll_rad - 0.3).abs() < 2e-3, "{pose:?}");
    let left = pose;
    let nowhere = PointerRecord { target: [0.0, 0.0, 1.6, 0.04, f32::NAN], ..turned };
    assert_eq!(hand.step(3_000, [0.0; 3], Some(&nowhere)).pose.camera_roll_rad, left.camera_roll_rad);
}

/// As a case has it: whoever turns the scope turns the picture, and brings the horizon back with the head; a script's horizon is kept.
#[test]
fn a_free_camera_head_goes_along_with_the_scope_until_it_is_turned_on_it() {
    let mut scene = hyst_scene::load_embedded().unwrap();
    scene.is_head_free = true;
    let mut hand = Hand::in_scene(&scene, "mouse", 0).unwrap();
    let post = PointerRecord { sequence: 1, target: [0.0, 0.0, 1.6, 0.04, 0.0], ..PointerRecord::default() };
    let held = (0..3_000).map(|tick| hand.step(tick, [0.0; 3], Some(&post))).last().unwrap();
    assert!((held.pose.roll_rad - 1.6).abs() < 0.05 && held.pose.camera_roll_rad.abs() < 1e-6, "{:?}", held.pose);
    assert_eq!(held.from_window, WINDOW_ALL | WINDOW_HEAD_FREE);
    let back = PointerRecord { target: [0.0, 0.0, 1.6, 0.04, -1.6], ..post };
    let level = (3_000..4_000).map(|tick| hand.step(tick, [0.0; 3], Some(&back))).last().unwrap().pose;
    assert!((level.camera_roll_rad + level.roll_rad).abs() < 0.05, "{level:?}");

    let mut gamepad = Hand::in_scene(&scene, "idle", 0).unwrap();
    (gamepad.will, gamepad.is_head_free) = (Will::Pad(Pad::default()), true);
    assert_eq!(gamepad.step(0, [0.0; 3], None).from_window, 0, "it has its own buttons for the head");
    let poses = |scene: &LoadedScene| {
        let mut script = Hand::in_scene(scene, "script:polyp", 0).unwrap();
        (0..8_000).map(|tick| script.step(tick, [0.0; 3], None).pose).collect::<Vec<Pose>>()
    };
    let free = poses(&scene);
    scene.is_head_free = false;
    assert!(free == poses(&scene), "a script's horizon is kept all the same");
}

#[test]
fn the_focus_is_set_at_first_goes_as_the_pointer_says_and_stays_where_it_was_left() {
    let scene = hyst_scene::load_embedded().unwrap();
    let focus_m = |hand: &mut Hand, pointer: Option<&PointerRecord>| hand.step(0, [0.0; 3], pointer).controls.focus_m;
    for name in ["idle", "script:polyp", "script:press"] {
        assert_eq!(focus_m(&mut Hand::in_scene(&scene, name, 0).unwrap(), None), FOCUS_M, "{name}");
    }
    let mut hand = Hand::in_scene(&scene, "mouse", 0).unwrap();
    let near =
        PointerRecord { sequence: 1, controls: Controls { focus_m: 0.008, ..Controls::default() }, ..PointerRecord::default() };
    assert_eq!([None, Some(&near), None].map(|pointer| focus_m(&mut hand, pointer)), [FOCUS_M, 0.008, 0.008]);
}

#[test]
fn beside_a_pad_the_window_sets_what_the_pad_lacks_and_nothing_else() {
    let scene = hyst_scene::load_embedded().unwrap();
    let wanted = Controls {
        buttons: BUTTON_ENERGIZED | BUTTON_EXTENDED,
        inflow_valve: 0.0,
        outflow_valve: 0.0,
        set_pressure_pa: 5_000.0,
        light: 0.3,
        focus_m: 0.008,
        ..Controls::default()
    };
    let pointer = PointerRecord { sequence: 1, target: [0.3, 0.3, 0.3, 0.02, 0.2], controls: wanted };
    let beside = |lacks: u32, pointer: Option<PointerRecord>| {
        let mut hand = Hand::in_scene(&scene, "idle", 0).unwrap();
        hand.will = Will::Pad(Pad::default());
        if let Will::Pad(pad) = &mut hand.will {
            pad.lacks = lacks;
        }
        (0..200).map(|tick| hand.step(tick, [0.0; 3], pointer.as_ref())).last().unwrap()
    };
    let alone = beside(0, None);
    let gamepad = beside(0, Some(pointer));
    assert_eq!((gamepad.pose, gamepad.controls, gamepad.from_window), (alone.pose, alone.controls, 0));
    let lacks = WINDOW_HEAD | WINDOW_INFLOW | WINDOW_PRESSURE | WINDOW_FOCUS;
    let held = beside(lacks, Some(pointer));
    let expected = Controls { inflow_valve: 0.0, set_pressure_pa: 5_000.0, focus_m: 0.008, ..alone.controls };
    assert_eq!((held.controls, held.from_window), (expected, lacks));
    assert!((held.pose.camera_roll_rad + held.pose.roll_rad - 0.2).abs() < 2e-3, "{:?}", held.pose);
    assert_eq!((held.pose.position_m, held.pose.roll_rad), (alone.pose.position_m, alone.pose.roll_rad), "the pad has the scope");
    let unsaid = beside(lacks, Some(PointerRecord { sequence: 0, ..pointer }));
    assert_eq!((unsaid.controls, unsaid.pose), (alone.controls, alone.pose), "the window has said nothing yet");
    let none = Controls { set_pressure_pa: f32::NAN, inflow_valve: -1.0, focus_m: 20.0, ..wanted };
    let nonsense = beside(lacks, Some(PointerRecord { target: [f32::NAN; 5], controls: none, ..pointer }));
    assert_eq!((nonsense.controls, nonsense.pose), (alone.controls, alone.pose));
    let pedals = PointerRecord { controls: Controls { buttons: BUTTONS_CURRENT, ..wanted }, ..pointer };
    let pressed = |lacks: u32| beside(lacks, Some(pedals)).controls.buttons;
    assert_eq!((pressed(WINDOW_COAGULATION), pressed(WINDOW_FOCUS)), (BUTTON_COAGULATING, 0));
    let mut mouse = Hand::in_scene(&scene, "mouse", 0).unwrap();
    assert_eq!(mouse.step(0, [0.0; 3], None).from_window, WINDOW_ALL);
    let mut script = Hand::in_scene(&scene, "script:polyp", 0).unwrap();
    assert_eq!(script.step(0, [0.0; 3], Some(&pointer)).from_window, 0);
}

#[test]
fn a_hand_that_moves_once_rests_cold_where_it_began_and_sets_what_it_says_itself() {
    let mut scene = hyst_scene::load_embedded().unwrap();
    scene.fluid.changes = vec![PumpChange { at_s: 1.0, outflow_valve: Some(0.9), ..PumpChange::default() }];
    let changes = vec![PumpChange { at_s: 2.0, inflow_valve: Some(0.0), ..PumpChange::default() }];
    let found = scene.hand("polyp").unwrap().clone();
    let period_ticks = (found.period_s * 1e3) as u64 + 1_000;
    scene.hands.push(LoadedHand { name: "once".into(), is_once: true, changes, ..found });
    let all = ["once", "polyp"].map(|name| {
        let mut hand = Hand::in_scene(&scene, &format!("script:{name}"), 0).unwrap();
        controls(&mut hand, 2 * period_ticks, None)
    });
    let last_cut = |all: &[Controls]| all.iter().rposition(|controls| controls.buttons & BUTTON_ENERGIZED != 0).unwrap() as u64;
    assert!(last_cut(&all[0]) < period_ticks && last_cut(&all[1]) > period_ticks);
    assert_eq!(all[0].last().unwrap().buttons, 0);
    let set = all.map(|all| all.last().map(|controls| (controls.inflow_valve, controls.outflow_valve)).unwrap());
    assert_eq!(set, [(0.0, 0.3), (1.0, 0.9)]);
}

#[test]
fn a_hand_that_waits_for_the_pump_sets_so_long_after_and_one_without_a_script_waits_for_nothing() {
    let mut scene = hyst_scene::load_embedded().unwrap();
    let after = Some(Signal { deficit_above_ml: Some(100.0), ..Signal::default() });
    let changes = vec![
        PumpChange { at_s: 1.0, set_pressure_pa: Some(5e3), ..PumpChange::default() },
        PumpChange { at_s: 3.0, after, inflow_valve: Some(0.0), ..PumpChange::default() },
    ];
    let found = scene.hand("press").unwrap().clone();
    scene.hands.push(LoadedHand { name: "waits".into(), changes: changes.clone(), ..found });
    let mut hand = Hand::in_scene(&scene, "script:waits", 0).unwrap();
    assert!(hand.is_waiting());
    // More than 100 ml are missing for a moment, 10 s after the start.
    let all: Vec<Controls> = (0..20_000)
        .map(|tick| {
            let deficit_ml = if (10_000..10_040).contains(&tick) { 100.5 } else { 99.5 };
            hand.see(tick, &FluidStatus { deficit_ml, ..FluidStatus::default() });
            hand.step(tick, [0.0; 3], None).controls
        })
        .collect();
    let first = |is: fn(&Controls) -> bool| all.iter().position(is);
    let (set, shut) = (first(|controls| controls.set_pressure_pa == 5e3), first(|controls| controls.inflow_valve == 0.0));
    assert_eq!((set, shut, hand.is_waiting()), (Some(2_000), Some(13_000), false), "a second of rest is before the script");
    scene.fluid.changes = changes;
    let waits = |name: &str| Hand::in_scene(&scene, name, 0).unwrap().is_waiting();
    assert_eq!(["mouse", "idle", "script:press"].map(waits), [false, true, true]);
}

#[test]
fn an_instrument_without_a_loop_extends_none() {
    let mut scene = hyst_scene::load_embedded().unwrap();
    scene.rigid[0].electrode = None;
    let mut hand = Hand::in_scene(&scene, "script:polyp", 0).unwrap();
    assert!(controls(&mut hand, 8_000, None).iter().all(|controls| controls.loop_extension_m == 0.0));
}
