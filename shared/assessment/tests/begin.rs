//! When the session of a case begins, and what counts from there: its time, and shares of the time; not when something was reached, lost or said.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{bytes_of, fluid, record};
use hyst_assessment::{Assessment, EndedBy, Judge, Sessions, assess, html, json, text};
use hyst_messages::{BUTTON_ENERGIZED, HardwareSample, PA_PER_MMHG};
use hyst_recording::{Block, Reader};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::Path;

/// What is changed of a sample, and what it is called.
type Change = (&'static str, fn(&mut HardwareSample));

/// A case of so many seconds whose goal is a second of pressure.
fn case(time_s: f64) -> String {
    let goals = json!([{ "words": "part the walls", "is": { "pressure": { "band_pa": [6_000.0, 10_000.0], "ticks": 1_000 } } }]);
    let end = json!({ "goals": false, "time_s": time_s, "deficit_ml": null, "bled_ml": null, "perforation": false });
    let case = json!({
        "name": "A case", "rung": "access", "task": "Do it.", "seed": 3, "drawn": [], "pathology_ml": 2.0,
        "goals": goals, "end": end, "warnings": [{ "words": "it takes long", "is": { "time_above": 500 } }], "score": {},
    });
    case.to_string()
}

fn judge(time_s: f64) -> Judge {
    Judge::read(&case(time_s)).unwrap()
}

/// The sample of a hand at rest.
fn at_rest(sample: &mut HardwareSample) {
    sample.pose.position_m = [0.0, 0.0, 0.02];
    sample.controls.focus_m = 0.02;
}

/// With which tick a session begins of whose samples those from tick 500 on are changed so.
fn began_tick(change: fn(&mut HardwareSample)) -> Option<u64> {
    let mut judge = judge(100.0);
    for tick in 5..1_000 {
        let mut record = record(tick, [0.0; 3], 0.0);
        at_rest(&mut record.sample);
        if tick >= 500 {
            change(&mut record.sample);
        }
        judge.tick(&record);
    }
    judge.began_tick()
}

#[test]
fn it_begins_with_the_first_tick_that_shows_a_hand() {
    let changes: [Change; 12] = [
        ("tip", |sample| sample.pose.position_m[0] = 0.0011),
        ("pitch", |sample| sample.pose.pitch_rad = -0.036),
        ("yaw", |sample| sample.pose.yaw_rad = 0.036),
        ("roll", |sample| sample.pose.roll_rad = 0.036),
        ("camera head", |sample| sample.pose.camera_roll_rad = 0.036),
        ("current", |sample| sample.controls.buttons = BUTTON_ENERGIZED),
        ("inflow", |sample| sample.controls.inflow_valve = 0.9),
        ("outflow", |sample| sample.controls.outflow_valve = 0.0),
        ("light", |sample| sample.controls.light = 0.3),
        ("pressure", |sample| sample.controls.set_pressure_pa -= 5.0 * PA_PER_MMHG as f32),
        ("focus", |sample| sample.controls.focus_m /= 1.15),
        ("loop", |sample| sample.controls.loop_extension_m = 0.002),
    ];
    for (what, change) in changes {
        assert_eq!(began_tick(change), Some(500), "{what}");
    }
}

#[test]
fn what_trembles_and_what_is_no_number_begins_nothing() {
    let changes: [Change; 7] = [
        ("rest", |_| {}),
        ("tip", |sample| sample.pose.position_m[1] = 0.0009),
        ("axes", |sample| (sample.pose.pitch_rad, sample.pose.roll_rad) = (0.034, -0.034)),
        ("valve", |sample| sample.controls.outflow_valve += 0.01),
        ("no pose", |sample| (sample.pose.position_m[2], sample.pose.yaw_rad) = (f32::NAN, f32::INFINITY)),
        ("no pressure", |sample| (sample.controls.set_pressure_pa, sample.controls.light) = (f32::NAN, f32::NAN)),
        ("no focus", |sample| sample.controls.focus_m = 0.0),
    ];
    for (what, change) in changes {
        assert_eq!(began_tick(change), None, "{what}");
    }
    // Half a turn one way is half a turn the other; and before the hardware has spoken there is no place from which anything could have moved.
    let mut judge = judge(100.0);
    let mut silent = record(1, [0.0; 3], 0.0);
    silent.sample = HardwareSample::default();
    judge.tick(&silent);
    let roll = |tick: u64, roll_rad: f32| {
        let mut record = record(tick, [0.0, 0.0, 0.02], 0.0);
        record.sample.pose.roll_rad = roll_rad;
        record
    };
    [roll(2, 3.13), roll(3, -3.13)].iter().for_each(|record| judge.tick(record));
    assert_eq!(judge.began_tick(), None);
    judge.tick(&roll(4, -3.1));
    assert_eq!(judge.began_tick(), Some(4));
}

#[test]
fn the_session_of_a_hand_that_rests_begins_after_thirty_seconds_and_ends_too_also_for_a_successor() {
    let mut judge = judge(1.0);
    for tick in 7..40_000 {
        judge.tick(&record(tick, [0.0, 0.0, 0.02], 0.0));
        if tick == 20_000 {
            assert_eq!((judge.began_s(), judge.strip()[0].as_str()), (None, "goals    0 of 1   00:01 left"));
        }
        if [20_000, 30_500].contains(&tick) {
            judge = Judge::resume(&case(1.0), Some(&serde_json::to_string(&judge).unwrap())).unwrap();
        }
    }
    assert_eq!((judge.began_tick(), judge.began_s()), (Some(30_000), Some(29_993.0 * 1e-3)));
    assert_eq!((judge.ended, judge.told.as_slice()), (Some((EndedBy::Time, 31_000)), &[(0, 30_501)][..]));
    assert_eq!(judge.over().unwrap(), "after 1.0 s: the time was over; 0 of 1 goals reached");
    assert_eq!(judge.json()["ended"]["at_s"], 30_993.0 * 1e-3);
}

/// A console that is slow to start has missed what the device's ring holds no more; a recording has all of it. Both judge one session.
#[test]
fn who_comes_late_has_the_latest_begin_of_who_has_seen_all() {
    let seen_from = |first: u64| {
        let mut judge = judge(5.0);
        (first..36_000).for_each(|tick| judge.tick(&record(tick, [0.0, 0.0, 0.02], 0.0)));
        (judge.began_tick(), judge.ended, judge.told)
    };
    let whole = seen_from(1);
    assert_eq!((whole.0, whole.1), (Some(30_000), Some((EndedBy::Time, 35_000))));
    for first in [1_700, 9_000, 30_400] {
        assert_eq!(seen_from(first), whole, "{first}");
    }
    let after = seen_from(31_000);
    assert_eq!((after.0, after.1), (whole.0, whole.1), "after it has begun");
}

/// Half a second from a tick on: of a scope that somebody holds, or in the dark, with the outflow shut, at 20 mmHg and with 1 N.
fn half_second(first: u64, is_held: bool) -> Block {
    let ticks = (first..first + 500).map(|tick| {
        let mut record = record(tick, if is_held { [0.005, 0.0, 0.02] } else { [0.0, 0.0, 0.02] }, f32::from(!is_held));
        if !is_held {
            (record.sample.controls.outflow_valve, record.sample.controls.light) = (0.0, 0.0);
        }
        record
    });
    let fluid = vec![fluid(first, if is_held { 60.0 } else { 20.0 }, 0.0)];
    Block { applied: ticks.collect(), fluid, ..Block::default() }
}

/// So many seconds in the dark, with the outflow shut, at 20 mmHg and with 1 N, while nobody holds the scope; then five in which somebody does.
fn recorded(name: &str, rest_s: u64, facts: &[(&str, &str)]) -> Assessment {
    let blocks: Vec<Block> = (0..2 * (rest_s + 5)).map(|half| half_second(500 * half, half >= 2 * rest_s)).collect();
    let bytes = bytes_of(name, facts, &blocks);
    assess(Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap(), 2, |_| {})
}

fn assert_is(report: &Value, key: &str, exact: f64) {
    let found = report["metrics"].as_array().unwrap().iter().find(|metric| metric["key"] == key).unwrap();
    assert!(found["value"].as_f64().is_some_and(|value| (value - exact).abs() < 1e-6), "{key}: {exact}, but {found}");
}

#[test]
fn a_report_counts_the_time_and_its_shares_from_the_begin_and_says_when_that_was() {
    let sessions = Sessions::new("a.mcap", recorded("late", 10, &[("case", case(100.0).as_str())]));
    let report = json(&sessions);
    for (key, exact) in [("time", 5.0), ("dark", 0.0), ("outflow_shut", 0.0), ("touching", 0.0)] {
        assert_is(&report, key, exact);
    }
    // The nine half seconds of which the pressure is known, and in the first of them the mean is 33.3 mmHg.
    assert_is(&report, "distended", 800.0 / 9.0);
    assert_is(&report, "force_peak", 0.0);
    assert_is(&report, "inflow", 14.5); // the medium was used
    // 60 mmHg from 10 s on: 33.3, 42.2 and 48.1 in the average, which is 6 kPa with the third, and then for a second.
    let case_json = &report["case"];
    assert_eq!((case_json["began_s"].as_f64(), case_json["goals"][0]["at_s"].as_f64()), (Some(10.0), Some(12.0)), "{case_json}");
    assert!(text(&sessions).contains("  began at 10.0 s: the trainee's time"), "{}", text(&sessions));
    assert!(html(&sessions).contains("<dt>session</dt><dd>began at 10.0 s: "), "{}", html(&sessions));
    assert!(text(&sessions).lines().all(|line| line.chars().count() <= 100), "{}", text(&sessions));
}

/// Who computes a share of the time from the rows has the metric's.
#[test]
fn the_rows_of_the_session_are_those_from_its_begin_to_its_end() {
    let of_session = |name: &str, facts: &[(&str, &str)]| {
        let mut rows: Vec<(u64, bool)> = Vec::new();
        let blocks: Vec<Block> = (0..16).map(|half| half_second(500 * half, half >= 4)).collect();
        let bytes = bytes_of(name, facts, &blocks);
        assess(Reader::new(Cursor::new(&bytes), Path::new("rows.mcap")).unwrap(), 2, |row| {
            rows.push((row.since_start_ticks, row.in_session));
        });
        assert_eq!(rows.len(), 80);
        let within: Vec<u64> = rows.into_iter().filter(|(_, is)| *is).map(|(since, _)| since).collect();
        (within.len(), within.first().copied(), within.last().copied())
    };
    // It begins after two seconds, and ends three seconds later: with a tick that is the first of its row, which is not over with it.
    assert_eq!(of_session("rows", &[("case", case(3.0).as_str())]), (30, Some(2_099), Some(4_999)));
    assert_eq!(of_session("all-rows", &[]), (80, Some(99), Some(7_999)));
}

#[test]
fn without_a_case_or_a_begin_a_recording_counts_from_its_first_tick() {
    let free = json(&Sessions::new("free.mcap", recorded("free", 10, &[])));
    assert_is(&free, "time", 15.0);
    assert_is(&free, "dark", 100.0 * 10.0 / 15.0);
    let at_once = Sessions::new("once.mcap", recorded("once", 0, &[("case", case(100.0).as_str())]));
    let report = json(&at_once);
    assert_is(&report, "time", 5.0);
    assert!(report["case"]["began_s"].is_null() && !text(&at_once).contains("began at"), "{}", report["case"]);
}
