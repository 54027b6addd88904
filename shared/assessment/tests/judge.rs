//! The judgement of a session by its case: each kind of goal, end and warning, by hand.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{brief, fluid, record, tissue};
use hyst_assessment::{EndedBy, Judge};
use hyst_messages::{AppliedRecord, BUTTON_ENERGIZED, TissueStatus};
use serde_json::{Value, json};

fn judge(goals: Value, end: Value, warnings: Value) -> Judge {
    Judge::new(brief(goals, end, warnings, json!({})))
}

fn at(tick: u64, place_m: [f32; 3]) -> AppliedRecord {
    record(tick, place_m, 0.0)
}

/// Ticks in which the hand goes to and fro by 1.2 mm, so that the session begins with the second, and nothing else happens.
fn wait(judge: &mut Judge, ticks: std::ops::Range<u64>) {
    ticks.for_each(|tick| judge.tick(&at(tick, [0.0, 0.0, 0.02 + 0.0012 * (tick % 2) as f32])));
}

#[test]
fn a_pressure_is_held_without_a_break_and_of_old_statuses_nothing_is_known() {
    let held_for = |ticks: u64| json!([{ "pressure": { "band_pa": [6_000.0, 10_000.0], "ticks": ticks } }]);
    let mut judged = judge(held_for(1_200), json!({}), json!([]));
    for tick in (100..4_000).step_by(50) {
        let mmhg = if (400..1_400).contains(&tick) { 90.0 } else { 60.0 };
        judged.fluid(&fluid(tick, mmhg, 0.0));
        wait(&mut judged, tick..tick + 50);
    }
    // The band ends at 75 mmHg. The average is 90 − 30/1.05ⁿ after n statuses of 90, 75.6 with the 15th at 1100 and 78.7 with the last; then
    // 60 + 18.7/1.05ⁿ, 74.6 with the fifth at 1600.
    assert_eq!(judged.goals[0].reached_tick, Some(2_800), "there was a break from 1100 to 1600");
    assert_eq!(judged.ended, Some((EndedBy::Goals, 2_800)));

    let mut old = judge(held_for(500), json!({}), json!([]));
    old.fluid(&fluid(100, 60.0, 0.0));
    wait(&mut old, 1_000..3_000);
    assert_eq!(old.goals[0].reached_tick, None, "a status of 100 says nothing from 1101 on");
}

#[test]
fn places_are_visited_in_their_order_and_stayed_at() {
    let places = json!([
        { "words": "a", "is": { "ball": [[0.01, 0.0, 0.03], 0.005] } },
        { "words": "b", "is": { "insertion": [0.0, 0.01] } },
    ]);
    let mut judge = judge(json!([{ "visit": { "places": places, "stay_ticks": 10 } }]), json!({}), json!([]));
    let (a, b, nowhere) = ([0.012, 0.001, 0.03], [0.0, 0.0, 0.005], [0.0, 0.0, f32::NAN]);
    let way = [(b, 20), (a, 9), (nowhere, 1), (a, 10), (a, 1), (b, 10), (b, 1)];
    let mut tick = 0;
    let mut progress = Vec::new();
    for (place, ticks) in way {
        for _ in 0..ticks {
            judge.tick(&at(tick, place));
            tick += 1;
        }
        progress.push(judge.goals[0].progress);
    }
    assert_eq!(progress, [0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 1.0], "b does not count before a, and a stay has 10 ms");
    assert_eq!(judge.goals[0].reached_tick, Some(51));
}

/// Two landmarks, 30 degrees to either side of the axis; an optic of 30 degrees sees the one, and the other after half a turn.
#[test]
fn landmarks_are_looked_at_in_any_order_for_long_enough_and_with_the_walls_apart() {
    let landmarks = json!([{ "words": "lower", "is": [0.0, -0.01, 0.0173] }, { "words": "upper", "is": [0.0, 0.01, 0.0173] }]);
    let sight = json!({ "optic_rad": 0.5, "within_rad": 0.3, "within_m": 0.025 });
    let look = json!([{ "look": { "landmarks": landmarks, "sight": sight, "ticks": 10 } }]);
    let turned = |tick: u64, is_turned: bool| {
        let mut record = at(tick, [0.0; 3]);
        record.sample.pose.orientation = if is_turned { [0.0, 0.0, 1.0, 0.0] } else { [0.0, 0.0, 0.0, 1.0] };
        record
    };
    let story = |mmhg: f32, turns: &[(bool, u64)]| {
        let mut judge = judge(look.clone(), json!({}), json!([]));
        assert_eq!(judge.landmarks_percent(), Some(0.0));
        judge.fluid(&fluid(0, mmhg, 0.0));
        let ticks = turns.iter().flat_map(|(is_turned, ticks)| (0..*ticks).map(|_| *is_turned));
        ticks.zip(1..).for_each(|(is_turned, tick)| judge.tick(&turned(tick, is_turned)));
        (judge.landmarks_percent(), judge.goals[0].reached_tick)
    };
    assert_eq!(story(60.0, &[(false, 11), (true, 10)]), (Some(50.0), None), "the second for 9 ms");
    assert_eq!(story(60.0, &[(false, 11), (true, 11)]), (Some(100.0), Some(22)));
    assert_eq!(story(60.0, &[(true, 11), (false, 11)]), (Some(100.0), Some(22)), "in any order");
    assert_eq!(story(60.0, &[(false, 10), (true, 11), (false, 10)]), (Some(50.0), None), "each without a break");
    assert_eq!(story(30.0, &[(false, 20), (true, 20)]), (Some(0.0), None), "the walls are not parted below 40 mmHg");
    assert_eq!(judge(json!([{ "removed": 1.0 }]), json!({}), json!([])).landmarks_percent(), None);
}

#[test]
fn what_is_removed_and_the_largest_piece_are_those_of_the_statuses() {
    let mut judge = judge(json!([{ "removed": 1.0 }, { "piece": 0.4 }]), json!({ "goals": false }), json!([]));
    for (tick, removed_ml) in [(0, 0.0), (10, 0.3), (20, 0.6), (30, 0.6), (40, 1.1), (50, f64::NAN)] {
        judge.tissue(&tissue(tick, 1, removed_ml));
        judge.tick(&at(tick, [0.0; 3]));
    }
    let reached: Vec<Option<u64>> = judge.goals.iter().map(|goal| goal.reached_tick).collect();
    assert_eq!(reached, [Some(40), Some(40)], "pieces of 0.3, 0.3 and 0.5 ml");
    assert_eq!((judge.removed_percent(), judge.done_percent(), judge.ended), (Some(55.00000000000001), Some(100.0), None));
}

#[test]
fn a_biopsy_is_a_piece_that_comes_free_and_not_what_the_loop_burns_or_what_is_brought_out() {
    let mut judge = judge(json!([{ "piece": 0.4 }]), json!({}), json!([]));
    // Half a millilitre burnt, a loose piece of as much brought out, a crumb cut off; then a piece that is large enough.
    let story = [(0, 0.0, 4, 0), (10, 0.5, 4, 0), (20, 1.0, 3, 1), (30, 1.1, 4, 1), (40, 1.6, 5, 1)];
    let mut progress = Vec::new();
    for (tick, removed_ml, objects, taken_out) in story {
        judge.tissue(&TissueStatus { objects, taken_out, ..tissue(tick, 1, removed_ml) });
        judge.tick(&at(tick, [0.0; 3]));
        progress.push((100.0 * judge.goals[0].progress).round());
    }
    assert_eq!(progress, [0.0, 0.0, 0.0, 25.0, 100.0]);
    assert_eq!((judge.goals[0].reached_tick, judge.removed_percent()), (Some(40), Some(80.0)));
}

#[test]
fn who_stops_in_time_has_reached_it_and_who_does_not_has_missed_it_for_good() {
    let stop = json!([{ "stop": { "after": { "deficit_above": 50.0 }, "ticks": 200 } }]);
    let shut = |tick: u64, is_energised: bool| {
        let mut record = at(tick, [0.0; 3]);
        record.sample.controls.inflow_valve = 0.0;
        record.sample.controls.buttons = if is_energised { BUTTON_ENERGIZED } else { 0 };
        record
    };
    let mut early = judge(stop.clone(), json!({}), json!([]));
    early.tick(&shut(0, false));
    assert_eq!(early.goals[0].reached_tick, None, "nothing has called for it");
    assert_eq!(
        (early.done_percent(), &early.json()["goals"][0]["called_for"]),
        (None, &json!(false)),
        "who made none is not judged by it"
    );
    early.fluid(&fluid(10, 60.0, 51.0));
    wait(&mut early, 10..100);
    early.tick(&shut(100, true));
    assert_eq!(early.goals[0].reached_tick, None, "the current is on");
    early.tick(&shut(101, false));
    assert_eq!(early.goals[0].reached_tick, Some(101));
    assert_eq!((early.done_percent(), &early.json()["goals"][0]["called_for"]), (Some(100.0), &json!(true)));
    assert_eq!(early.over().unwrap(), "after 0.1 s: all goals were reached; 1 of 1 goals reached");
    let mut quiet = judge(stop.clone(), json!({ "time_s": 0.5 }), json!([]));
    wait(&mut quiet, 0..600);
    let over = "after 0.5 s: the time was over; 0 of 0 goals reached, 1 not called for";
    assert_eq!((quiet.over().as_deref(), quiet.strip()[0].as_str()), (Some(over), "goals    0 of 0"));

    let mut late = judge(stop, json!({}), json!([]));
    late.fluid(&fluid(10, 60.0, 51.0));
    wait(&mut late, 10..212);
    late.tick(&shut(212, false));
    assert_eq!((late.goals[0].reached_tick, late.goals[0].missed_tick), (None, Some(211)), "called for at 10");
    assert_eq!(late.done_percent(), Some(0.0));
    assert_eq!(late.ended, None);
}

#[test]
fn who_never_has_to_stop_ends_with_the_rest_and_who_has_to_is_asked_for_nothing_else() {
    let goals = json!([{ "stop": { "after": { "alarm": "perforation" }, "ticks": 200 } }, { "removed": 1.0 }]);
    let mut careful = judge(goals.clone(), json!({}), json!([]));
    careful.tick(&at(0, [0.0; 3]));
    assert!(careful.strip()[1].ends_with("number 1"), "nothing calls for a stop yet: {:?}", careful.strip());
    careful.tissue(&tissue(1, 1, 1.2));
    careful.tick(&at(1, [0.0; 3]));
    assert_eq!(careful.over().unwrap(), "after 0.0 s: all goals were reached; 1 of 1 goals reached, 1 not called for");

    let pierced = || {
        let mut judge = judge(goals.clone(), json!({}), json!([]));
        let mut status = fluid(10, 60.0, 0.0);
        status.alarms = 8;
        judge.fluid(&status);
        wait(&mut judge, 10..100);
        assert!(judge.strip()[1].ends_with("number 0"), "it is to be stopped now: {:?}", judge.strip());
        judge
    };
    let mut stops = pierced();
    let mut shut = at(100, [0.0; 3]);
    shut.sample.controls.inflow_valve = 0.0;
    stops.tick(&shut);
    assert_eq!(stops.over().unwrap(), "after 0.1 s: all goals were reached; 1 of 1 goals reached, 1 not called for");
    let mut goes_on = pierced();
    goes_on.tissue(&tissue(100, 1, 1.2));
    wait(&mut goes_on, 100..300);
    let reached = goes_on.goals.iter().filter_map(|goal| goal.reached_tick).count();
    assert_eq!((goes_on.done_percent(), reached, goes_on.ended), (Some(0.0), 0, None), "to resect after it mends nothing");
    assert!(!goes_on.strip().iter().any(|line| line.starts_with("next")), "{:?}", goes_on.strip());
    let called_off = |judge: &Judge| [0_usize, 1].map(|goal| judge.json()["goals"][goal]["called_off"].as_bool());
    assert_eq!([&careful, &goes_on].map(called_off), [[Some(false); 2], [Some(false), Some(true)]], "a stop is none");
    assert_eq!(goes_on.strip()[0], "goals    0 of 1", "only the stop still counts");
}

#[test]
fn a_bleeding_is_staunched_once_it_has_bled_and_does_so_slowly_for_long_enough() {
    let staunch = json!([{ "staunch": { "after_ml": 1.0, "below_ml_min": 6.0, "ticks": 1_000 } }]);
    let mut judge = judge(staunch, json!({}), json!([]));
    for tick in (0..8_000).step_by(50) {
        let bled_ml = 0.001 * tick.min(4_000) as f64; // 60 ml/min for 4 s, then none
        judge.fluid(&fluid(tick, 60.0, 10.0 * bled_ml));
        wait(&mut judge, tick..tick + 50);
    }
    // Over the second before 4900 to 4950 it bled below 6 ml/min: 0.1 ml, then less.
    let reached = judge.goals[0].reached_tick.unwrap();
    assert!((5_900..=5_950).contains(&reached), "{reached}");
}

/// Who raises the pressure before the cut makes no bleeding to be staunched.
#[test]
fn a_bleeding_that_was_prevented_is_waited_for_and_is_nobodys_goal_after_twenty_seconds() {
    let goals = json!([{ "piece": 0.4 }, { "staunch": { "after_ml": 0.2, "below_ml_min": 1.0, "ticks": 1_000 } }]);
    let cut = || {
        let mut judge = judge(goals.clone(), json!({}), json!([]));
        judge.tissue(&tissue(0, 1, 0.0));
        wait(&mut judge, 0..10);
        judge.tissue(&tissue(10, 1, 0.5));
        wait(&mut judge, 10..15_000);
        assert_eq!((judge.goals[0].reached_tick, judge.ended, judge.done_percent()), (Some(10), None, Some(50.0)));
        assert_eq!(judge.strip()[..2], ["goals    1 of 2", "next     no blood yet: number 1"]);
        judge
    };
    let mut prevented = cut();
    wait(&mut prevented, 15_000..20_010);
    assert_eq!((prevented.ended, &prevented.json()["goals"][1]["waits_for_blood"]), (None, &json!(true)));
    wait(&mut prevented, 20_010..30_000);
    assert_eq!((prevented.ended, prevented.done_percent()), (Some((EndedBy::Goals, 20_010)), Some(100.0)));
    assert_eq!(prevented.over().unwrap(), "after 20.0 s: all goals were reached; 1 of 1 goals reached, 1 not called for");
    let told = prevented.json();
    let goal = &told["goals"][1];
    assert_eq!([&goal["called_for"], &goal["called_off"]], [&json!(false), &json!(false)], "nothing has taken its place");

    let mut bleeds = cut();
    bleeds.fluid(&fluid(15_000, 60.0, 2.5)); // a quarter of a millilitre
    wait(&mut bleeds, 15_000..40_000);
    assert_eq!((bleeds.ended, bleeds.done_percent()), (None, Some(50.0)), "what has bled is to be staunched");
    assert_eq!(bleeds.strip()[1], "next     number 1");
}

#[test]
fn each_end_comes_at_its_tick_and_nothing_counts_after_it() {
    let goals = json!([{ "removed": 1.0 }]);
    for (end, by, tick) in [
        (json!({ "time_s": 0.5 }), EndedBy::Time, 501), // it begins at 1
        (json!({ "deficit_ml": 30.0 }), EndedBy::Deficit, 300),
        (json!({ "bled_ml": 2.0 }), EndedBy::Bleeding, 200),
        (json!({ "perforation": true }), EndedBy::Perforation, 700),
    ] {
        let mut judge = judge(goals.clone(), end.clone(), json!([{ "time_above": 900 }]));
        for tick in (0..2_000).step_by(100) {
            let mut status = fluid(tick, 60.0, 0.1 * tick as f64);
            status.alarms = if tick >= 700 { 8 } else { 4 };
            judge.fluid(&status);
            wait(&mut judge, tick..tick + 100);
        }
        assert_eq!(judge.ended, Some((by, tick)), "{end}");
        assert_eq!((judge.last_tick, judge.warnings[0].count), (tick, 0), "{end}");
    }
}

/// The tip is 8 mm before the place, and the loop 12 mm before the tip: out and hot it is beyond the middle of the place, but in it.
#[test]
fn current_is_warned_of_where_the_loop_is_and_not_where_the_tip_is() {
    let causes = json!([
        { "current_in": { "ball": [[0.0, 0.0, 0.05], 0.005] } },
        { "current_in": { "insertion": [0.05, 0.07] } },
        { "current_in": { "insertion": [0.035, 0.045] } },
    ]);
    let mut judge = judge(json!([]), json!({}), causes);
    for (tick, buttons, loop_extension_m) in [(1, 0, 0.012), (2, BUTTON_ENERGIZED, 0.0), (3, BUTTON_ENERGIZED, 0.012)] {
        let mut record = at(tick, [0.0, 0.0, 0.042]);
        record.sample.controls.buttons = buttons;
        record.sample.controls.loop_extension_m = loop_extension_m;
        judge.tick(&record);
    }
    let first: Vec<_> = judge.warnings.iter().map(|warning| warning.first_tick).collect();
    assert_eq!(first, [Some(3), Some(3), Some(2)]);
    judge.tick(&at(1_500, [0.0, 0.0, 0.042])); // calm
    // Turned by a quarter about y the axis points along x.
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    let mut record = at(2_000, [-0.012, 0.0, 0.05]);
    record.sample.pose.orientation = [0.0, quarter, 0.0, quarter];
    (record.sample.controls.buttons, record.sample.controls.loop_extension_m) = (BUTTON_ENERGIZED, 0.012);
    judge.tick(&record);
    assert_eq!(judge.warnings[0].count, 2);
}

#[test]
fn what_stands_beside_a_picture_names_the_next_goal_the_time_and_the_end_in_plain_letters() {
    let goals = json!([{ "removed": 1.0 }, { "piece": 0.5 }]);
    let mut judge = judge(goals, json!({ "time_s": 100.0 }), json!([{ "force_above": 1.0 }]));
    judge.brief.goals[1].words = "take a chip of 5 mm³ for the “laboratory”, and one more for the archive of the house".into();
    // Three pieces: together enough, none large enough.
    for (step, removed_ml) in [0.0, 0.4, 0.8, 1.2].into_iter().enumerate() {
        let tick = 250 * step as u64;
        judge.tissue(&tissue(tick, 1, removed_ml));
        wait(&mut judge, tick..tick + 250);
    }
    judge.tick(&at(1_001, [0.0, 0.0, 0.02])); // a second after the begin
    let strip = judge.strip();
    assert_eq!(strip[0], "goals    1 of 2   01:39 left");
    assert!(strip[1].starts_with("next     80 %: take a chip of 5 mm3 for the"), "{strip:?}");
    assert!(strip.len() == 3 && strip.iter().all(|line| line.is_ascii() && line.len() <= 46), "{strip:?}");
    assert_eq!(judge.over(), None);
    judge.tick(&record(1_002, [0.0, 0.0, 0.02], 2.0));
    assert!(judge.strip().iter().any(|line| line == "WARNING  number 0"), "{:?}", judge.strip());
    wait(&mut judge, 1_003..100_003);
    assert_eq!(judge.strip(), ["goals    1 of 2", "OVER     after 01:40: the time was over"]);
    assert_eq!(judge.over().unwrap(), "after 100.0 s: the time was over; 1 of 2 goals reached");
}

#[test]
fn a_warning_that_flickers_is_one_and_comes_again_after_a_second_of_calm() {
    let causes = json!([{ "force_above": 1.0 }, { "alarm": "abnormal_loss" }, "current", { "pressure_below": 1_000.0 }]);
    let mut judge = judge(json!([{ "removed": 1.0 }]), json!({}), causes);
    let mut status = fluid(0, 60.0, 0.0);
    status.alarms = 4;
    judge.fluid(&status);
    for tick in 0..5_000 {
        let force_n = if tick < 400 && tick % 3 == 0 || tick == 3_000 { 1.5 } else { 0.0 };
        let mut record = record(tick, [0.0; 3], force_n);
        record.sample.controls.buttons = if tick == 10 { BUTTON_ENERGIZED } else { 0 };
        judge.tick(&record);
    }
    let counts: Vec<u64> = judge.warnings.iter().map(|warning| warning.count).collect();
    assert_eq!(counts, [2, 1, 1, 0]);
    assert_eq!(judge.told, [(0, 0), (1, 0), (2, 10), (0, 3_000)]);
    assert!(!judge.warnings[0].stands, "it is over since 4001");
}

#[test]
fn a_notice_and_that_time_has_passed_are_told_and_count_in_no_score() {
    let causes = json!([{ "time_above": 100 }, { "deficit_above": 10.0 }, { "deficit_above": 20.0 }]);
    let mut judge = judge(json!([{ "removed": 1.0 }]), json!({}), causes);
    judge.brief.warnings[1].notice = true;
    judge.fluid(&fluid(100, 60.0, 30.0));
    wait(&mut judge, 100..400);
    assert_eq!(judge.warnings.iter().map(|warning| warning.count).collect::<Vec<u64>>(), [1, 1, 1]);
    assert_eq!(judge.warning_count(), 1);
    let told = judge.json();
    assert_eq!(
        [0_usize, 1, 2].map(|index| told["warnings"][index]["is_notice"].as_bool()),
        [Some(true), Some(true), Some(false)]
    );
    assert!(judge.strip().iter().any(|line| line == "NOTICE   number 0"), "{:?}", judge.strip());
}

/// The band is 11.4 ml, or half of the limit.
#[test]
fn a_cavity_that_is_emptied_and_filled_again_passes_the_limit_of_the_deficit_once() {
    let mut judge = judge(json!([{ "removed": 1.0 }]), json!({}), json!([{ "deficit_above": 100.0 }, { "deficit_above": 10.0 }]));
    let mut tick = 100;
    let mut after = |deficits_ml: [f64; 2]| {
        for deficit_ml in deficits_ml {
            for _ in 0..4 {
                judge.fluid(&fluid(tick, 60.0, deficit_ml));
                wait(&mut judge, tick..tick + 500);
                tick += 500;
            }
        }
        judge.warnings.iter().map(|warning| (warning.count, warning.stands)).collect::<Vec<_>>()
    };
    assert_eq!(after([99.9, 100.0]), [(0, false), (1, true)], "a warning begins beyond its limit");
    assert_eq!(after([100.1, 89.0]), [(1, true), (1, true)]);
    assert_eq!(after([101.0, 88.5]), [(1, false), (1, true)]);
    assert_eq!(after([99.0, 101.0]), [(2, true), (1, true)]);
    assert_eq!(after([5.1, 4.9]), [(2, false), (1, false)], "5 ml below 10");
    assert_eq!(after([9.9, 10.1]), [(2, false), (2, true)]);
}

#[test]
fn a_successor_goes_on_from_what_was_written_down() {
    let goals = json!([{ "pressure": { "band_pa": [6_000.0, 10_000.0], "ticks": 500 } }, { "removed": 1.0 }]);
    let mut whole = judge(goals, json!({ "time_s": 1.5 }), json!([{ "time_above": 200 }]));
    let mut first = whole.clone();
    whole.fluid(&fluid(1, 60.0, 0.0));
    wait(&mut whole, 1..1_000);
    first.fluid(&fluid(1, 60.0, 0.0));
    wait(&mut first, 1..300);
    let mut second: Judge = serde_json::from_str(&serde_json::to_string(&first).unwrap()).unwrap();
    wait(&mut second, 250..1_000); // some of them once more
    assert_eq!(second, whole);
}

#[test]
fn ticks_and_statuses_at_the_end_of_time_overflow_nothing() {
    let goals = json!([
        { "pressure": { "band_pa": [0.0, 1e4], "ticks": u64::MAX } },
        { "staunch": { "after_ml": 0.0, "below_ml_min": 1.0, "ticks": 0 } },
        { "stop": { "after": "current", "ticks": 0 } },
    ]);
    let mut judge = judge(goals, json!({ "time_s": 1e300 }), json!([{ "time_above": u64::MAX }]));
    for tick in [0, 1, u64::MAX - 1, u64::MAX] {
        judge.fluid(&fluid(tick, f32::INFINITY, f64::NAN));
        judge.tissue(&tissue(tick, 0, f64::INFINITY));
        judge.tick(&at(tick, [f32::INFINITY; 3]));
    }
    assert_eq!(judge.last_tick, u64::MAX);
}
