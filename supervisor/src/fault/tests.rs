//! What is said of a fault by its windows.

use super::*;
use hyst_messages::LedgerEntry;

#[test]
fn only_the_device_both_servos_at_once_and_what_may_cost_ticks_by_what_was_said_may_be_felt() {
    let felt = |target: &str, together| Fault { target: target.into(), together, ..Fault::default() }.may_be_felt();
    assert!(felt("device", false) && felt("haptic:1", true));
    let steps_n = ["device", "haptic:0"].map(|target| Fault { target: target.into(), ..Fault::default() }.most_step_n(0.1));
    assert!((steps_n[0] - 0.25).abs() < 1e-12 && (steps_n[1] - 0.15).abs() < 1e-12, "{steps_n:?}");
    assert!(!felt("haptic:1", false) && !felt("tissue:0", true) && !felt("guardian", false));
    let told = [None, Some(0), Some(300)].map(|may_cost_ticks| {
        let of = |target: &str| Fault { target: target.into(), may_cost_ticks, ..Fault::default() };
        (of("haptic:1").may_be_felt(), of("haptic:1").allowed_misses(), of("device").allowed_misses())
    });
    assert_eq!(told, [(false, Some(0), Some(20)), (false, Some(0), Some(0)), (true, Some(300), Some(300))]);
    let steps_n = [Some(0), Some(300)].map(|may_cost_ticks| {
        let of = |target: &str| Fault { target: target.into(), may_cost_ticks, ..Fault::default() };
        ["haptic:1", "tissue:1"].map(|target| (of(target).most_step_n(0.1) * 1e3).round())
    });
    assert_eq!(steps_n, [[150.0, 150.0], [250.0, 150.0]], "a servo that may cost nothing leaves somebody");
}

/// What is wrong of a servo's forces of these ticks and stamps, given from tick 1 201 on, if it is hit at 1 200.
fn wrong_of(kind: &str, target: &str, given: &[(u64, u64)]) -> (u64, Option<bool>) {
    wrong_by(None, kind, target, given)
}

/// The same of one that lies by one output alone.
fn wrong_by(output: Option<Output>, kind: &str, target: &str, given: &[(u64, u64)]) -> (u64, Option<bool>) {
    let mut ledger = Ledger::default();
    for tick in 1_000..2_000u64 {
        let (source_incarnation, force_tick) =
            given.iter().find(|(at, _)| *at == tick).map_or((8, tick), |(_, force_tick)| (7, *force_tick));
        let (hardware_tick, station_tick) = (tick, tick);
        let entry = LedgerEntry { hardware_tick, station_tick, force_tick, source_incarnation, ..LedgerEntry::default() };
        ledger.push(&entry, true);
    }
    let window = ledger.window(1_500, 1_700);
    let (kind, target, recovered_us) = (kind.into(), target.into(), Some(100_000.0));
    let mut fault = Fault { kind, target, output, tick: 1_200, incarnation: 7, recovered_us, ..Fault::default() };
    let seen = look(&fault, &ledger, &[]).unwrap();
    judge(&mut fault, seen, Some(window));
    let is_servo = fault.target != "tissue:0";
    assert_eq!(fault.given, is_servo.then_some(given.len() as u64));
    (fault.window.unwrap().wrong, fault.promise_held)
}

#[test]
fn the_force_of_a_servo_that_lies_is_wrong_however_it_looks() {
    let given = [(1_201, 1_201), (1_202, 1_202), (1_203, 1_203), (1_204, 1_204)];
    assert_eq!(wrong_of("nan", "haptic:0", &given), (3, Some(false)), "from two ticks after the injection on");
    assert_eq!(wrong_by(Some(Output::Force), "nan", "haptic:0", &given), (0, Some(true)), "its answers are as they should be");
    assert_eq!(wrong_of("slow", "haptic:0", &given), (0, Some(true)), "it is late, and right");
    assert_eq!(wrong_of("nan", "tissue:0", &given), (0, Some(true)), "no servo");
    // Its first output is as it should be, whenever it came to read its orders; that one again is not.
    let stalled = [(1_205, 1_205), (1_206, 1_205)];
    assert_eq!(wrong_of("replay", "haptic:0", &stalled), (0, Some(true)));
    assert_eq!(wrong_of("replay", "haptic:0", &[(1_205, 1_205), (1_207, 1_205)]).0, 1);
    // A stall may hold up the force that was made before, too, but not for long.
    assert_eq!(wrong_of("nan", "haptic:0", &[(1_202, 1_201)]), (0, Some(true)));
}

#[test]
fn of_a_window_with_gaps_nothing_is_said() {
    let ledger = ledger_of(|_| [0.0; 3]);
    let held = |from_tick: u64, control: Window| {
        let mut fault = Fault { target: "fluid:0".into(), tick: from_tick, recovered_us: Some(100_000.0), ..Fault::default() };
        let seen = look(&fault, &ledger, &[]).unwrap();
        judge(&mut fault, seen, Some(control));
        (fault.promise_held, fault.window.is_some() && fault.control.is_some())
    };
    let whole = ledger.window(1_500, 1_700);
    assert_eq!(held(1_200, whole), (Some(true), true));
    assert_eq!(held(900, whole), (None, true), "its first 100 ticks are not in the ledger");
    assert_eq!(held(1_200, ledger.window(1_900, 2_100)), (None, true), "nor are the last 100 of its control");
}

/// The ledger of ticks 1 000 to 2 000, all fresh and of servo 7, with these forces.
fn ledger_of(force_n: impl Fn(u64) -> [f32; 3]) -> Ledger {
    let mut ledger = Ledger::default();
    for tick in 1_000..2_000u64 {
        let (hardware_tick, station_tick, force_tick, force_n) = (tick, tick, tick, force_n(tick));
        let entry =
            LedgerEntry { hardware_tick, station_tick, force_tick, force_n, source_incarnation: 7, ..LedgerEntry::default() };
        ledger.push(&entry, true);
    }
    ledger
}

#[test]
fn a_force_that_stands_still_while_the_hand_touches_is_wrong_from_its_third_tick_on() {
    let moving = |tick: u64| [0.5 + tick as f32 * 1e-4, 0.0, 0.0];
    let wrong = |ledger: &Ledger, target: &str| {
        let (kind, target, recovered_us) = ("frozen".into(), target.into(), Some(100_000.0));
        let fault = Fault { kind, target, tick: 1_200, incarnation: 7, recovered_us, ..Fault::default() };
        look(&fault, ledger, &[]).unwrap().window.wrong
    };
    let stands = |tick: u64| (1_210..1_220).contains(&tick);
    let frozen = ledger_of(|tick| moving(if stands(tick) { 1_210 } else { tick }));
    assert_eq!([wrong(&frozen, "haptic:1"), wrong(&frozen, "tissue:0")], [8, 0]);
    assert_eq!(wrong(&ledger_of(moving), "haptic:1"), 0, "nobody followed it");
    let apart = ledger_of(|tick| if stands(tick) { [0.0; 3] } else { moving(tick) });
    assert_eq!(wrong(&apart, "haptic:1"), 0, "without tissue there is no force, and it does not move");
    assert_eq!(wrong(&ledger_of(|_| moving(1_000)), "haptic:1"), 0, "the hand itself stands still");
}

#[test]
fn a_kick_in_the_open_is_excused_by_no_step_at_the_wall_and_an_unlike_control_is_marked() {
    // At the wall until 1 690, with steps of 0.3 N; in the open from then on, and a kick of 0.2 N there.
    let ledger = ledger_of(|tick| match tick {
        ..1_600 => [if tick % 50 < 25 { 0.5 } else { 0.8 }, 0.0, 0.0],
        1_600..1_690 => [(1_690 - tick) as f32 * 0.005, 0.0, 0.0],
        1_950 => [0.2, 0.0, 0.0],
        _ => [0.0; 3],
    });
    let judged = |tick: u64, control: (u64, u64)| {
        let mut fault = Fault { target: "fluid:0".into(), tick, recovered_us: Some(100_000.0), ..Fault::default() };
        let seen = look(&fault, &ledger, &[]).unwrap();
        judge(&mut fault, seen, Some(ledger.window(control.0, control.1)));
        (fault.promise_held, fault.control_unlike, !fault.step.is_empty())
    };
    assert_eq!(judged(1_790, (1_700, 1_900)), (Some(false), false, true));
    assert_eq!(judged(1_790, (1_500, 1_700)), (Some(false), true, true), "nor by its control");
    assert_eq!(judged(1_720, (1_500, 1_700)), (Some(true), true, false));
}

/// A window that began in the open was held against the open with the strokes that it met at the wall.
#[test]
fn a_stroke_is_held_against_those_before_it_whatever_its_window_began_in_and_a_kick_from_rest_against_none() {
    let judged = |kicks: bool| {
        // At the wall, with steps of 0.3 N; in the open from 1 690 to 1 750, and there a kick; then at the wall again.
        let ledger = ledger_of(|tick| match tick {
            ..1_600 | 1_800.. => [if tick % 50 < 25 { 0.5 } else { 0.8 }, 0.0, 0.0],
            1_600..1_690 => [(1_690 - tick) as f32 * 0.005, 0.0, 0.0],
            1_750..1_800 => [(tick - 1_750) as f32 * 0.01, 0.0, 0.0],
            1_740 if kicks => [0.2, 0.0, 0.0],
            _ => [0.0; 3],
        });
        let mut fault = Fault { target: "fluid:0".into(), tick: 1_720, recovered_us: Some(100_000.0), ..Fault::default() };
        let seen = look(&fault, &ledger, &[]).unwrap();
        judge(&mut fault, seen, Some(ledger.window(1_700, 1_740)));
        (fault.promise_held, fault.control_unlike, fault.step.iter().map(|tick| tick.station_tick).collect::<Vec<_>>())
    };
    assert_eq!(judged(false), (Some(true), false, Vec::new()));
    let (held, _, around) = judged(true);
    assert!(held == Some(false) && around.contains(&1_739) && around.contains(&1_740), "{held:?} {around:?}");
}

#[test]
fn of_a_window_in_which_the_host_stalled_for_long_nothing_good_is_said() {
    let ledger = ledger_of(|_| [0.0; 3]);
    let held = |voided, wrong| {
        let mut fault = Fault { target: "fluid:0".into(), tick: 1_200, recovered_us: Some(100_000.0), ..Fault::default() };
        let mut seen = look(&fault, &ledger, &[]).unwrap();
        (seen.window.ticks, seen.window.voided, seen.window.wrong) = (200 - voided, voided, wrong);
        judge(&mut fault, seen, Some(ledger.window(1_500, 1_700)));
        fault.promise_held
    };
    assert_eq!([held(40, 0), held(41, 0), held(41, 1)], [Some(true), None, Some(false)]);
}

/// A kill in the last moments of a run was told of as one after which nobody had come back.
#[test]
fn of_one_that_is_not_over_nothing_good_is_said_and_nothing_bad_but_what_it_has_done() {
    let ledger = ledger_of(|_| [0.0; 3]);
    let held = |missed, wrong| {
        let mut fault = Fault { target: "fluid:0".into(), tick: 1_200, ..Fault::default() };
        let mut seen = look(&fault, &ledger, &[]).unwrap();
        (seen.window.missed, seen.window.wrong) = (missed, wrong);
        judge(&mut fault, seen, Some(ledger.window(1_500, 1_700)));
        fault.promise_held
    };
    assert_eq!([held(0, 0), held(1, 0), held(0, 1)], [None, Some(false), Some(false)]);
}
