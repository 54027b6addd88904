//! The judgement of a session of which ticks are missing, as of a recording that lost some: nothing counts as held, or as done in time, that nobody saw.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{brief, fluid, record};
use hyst_assessment::Judge;
use serde_json::{Value, json};

fn judge(goals: Value) -> Judge {
    Judge::new(brief(goals, json!({ "goals": false }), json!([]), json!({})))
}

/// A tick with the tip 42 mm from the pivot, in whose view a landmark lies; the inflow may be shut.
fn tick(judge: &mut Judge, tick: u64, is_shut: bool) {
    let mut record = record(tick, [0.0, 0.0, 0.042], 0.0);
    record.sample.controls.inflow_valve = if is_shut { 0.0 } else { 1.0 };
    judge.fluid(&fluid(tick, 60.0, 60.0));
    judge.tick(&record);
}

/// Three seconds before a gap of ten and three behind it were sixteen.
#[test]
fn what_is_held_is_held_anew_behind_ticks_that_are_missing_for_longer_than_a_second() {
    let place = json!({ "words": "there", "is": { "insertion": [0.04, 0.05] } });
    let landmark = json!({ "words": "it", "is": [0.0, 0.0, 0.06] });
    let sight = json!({ "optic_rad": 0.0, "within_rad": 0.3, "within_m": 0.025 });
    let goals = json!([
        { "pressure": { "band_pa": [6_000.0, 10_000.0], "ticks": 4_000 } },
        { "visit": { "places": [place], "stay_ticks": 4_000 } },
        { "look": { "landmarks": [landmark], "sight": sight, "ticks": 4_000 } },
    ]);
    let reached = |missing_ticks: u64| {
        let mut judge = judge(goals.clone());
        (0..3_000).for_each(|at| tick(&mut judge, at, false));
        (3_000..8_000).for_each(|at| tick(&mut judge, at + missing_ticks, false));
        judge.goals.iter().map(|goal| goal.reached_tick).collect::<Vec<_>>()
    };
    assert_eq!(reached(10_000), [Some(17_000); 3], "four seconds from 13 000 on");
    assert_eq!(reached(999), [Some(4_000); 3], "so long it is known by what was before");
}

/// The inflow was shut within 200 ticks by who came back after ten seconds.
#[test]
fn a_stop_whose_time_ends_in_ticks_that_are_missing_is_not_made_in_time() {
    let stopped = |shut_tick: u64| {
        let mut judge = judge(json!([{ "stop": { "after": { "deficit_above": 50.0 }, "ticks": 200 } }]));
        (0..100).for_each(|at| tick(&mut judge, at, false));
        tick(&mut judge, shut_tick, true);
        (judge.goals[0].reached_tick, judge.goals[0].missed_tick)
    };
    assert_eq!(stopped(10_000), (None, Some(10_000)));
    assert_eq!(stopped(201), (None, Some(201)));
    assert_eq!(stopped(200), (Some(200), None));
}
