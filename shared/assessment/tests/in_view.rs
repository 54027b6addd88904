//! Whether the pathology was in view: of the time under current, of all time with less than a second of it, and nothing where there is none, or no pose.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{bytes_of, record};
use hyst_assessment::{Metric, assess, scores};
use hyst_messages::{AppliedRecord, BUTTON_ENERGIZED};
use hyst_recording::{Block, Reader};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::Path;

/// 28° off the axis of a scope whose tip is 35 mm from the pivot, 17 mm from it: in the middle of the picture of an optic of 29°.
const POLYP_M: [f64; 3] = [0.0, 0.008, 0.05];

/// What is done in a tick: whether the scope is turned away by half a turn, and whether there is current.
type Done = (bool, bool);
const SEEN: Done = (false, false);
const AWAY: Done = (true, false);
const CUTS: Done = (false, true);
const CUTS_AWAY: Done = (true, true);

/// Ticks of a tenth of a second.
const TENTH: usize = 100;

/// Ticks, so many tenths of a second of each.
fn ticks(story: &[(Done, usize)]) -> Vec<AppliedRecord> {
    let done = story.iter().flat_map(|(done, tenths)| std::iter::repeat_n(*done, TENTH * tenths));
    let tick = |(tick, (is_turned, is_energised)): (u64, Done)| {
        let mut record = record(tick, [0.0, 0.0, 0.035], 0.0);
        if is_turned {
            record.sample.pose.orientation = [0.0, 0.0, 1.0, 0.0];
        }
        record.sample.controls.buttons = if is_energised { BUTTON_ENERGIZED } else { 0 };
        record
    };
    (1..).zip(done).map(tick).collect()
}

/// The metric of a recording of these ticks, with a case that knows this of the pathology.
fn metric(name: &str, known: &Value, applied: Vec<AppliedRecord>) -> Metric {
    let end = json!({ "goals": false, "time_s": null, "deficit_ml": null, "bled_ml": null, "perforation": false });
    let mut case = json!({
        "name": "A polyp", "rung": "polyp", "task": "Take it.", "seed": 1, "drawn": [], "pathology_ml": 2.0,
        "goals": [], "end": end, "warnings": [], "score": {},
    });
    for (key, value) in known.as_object().unwrap() {
        case[key] = value.clone();
    }
    let bytes = bytes_of(name, &[("case", case.to_string().as_str())], &[Block { applied, ..Block::default() }]);
    let assessment = assess(Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap(), 1, |_| {});
    assert_eq!(assessment.unread, None);
    let found = scores(&assessment.measured).metrics.into_iter().find(|metric| metric.definition.key == "in_view");
    found.unwrap()
}

/// What the case knows of pathologies in these places.
fn known(pathologies_m: &[[f64; 3]]) -> Value {
    json!({ "pathologies_m": pathologies_m, "pathology_sight": { "optic_rad": 0.5, "within_rad": 0.8, "within_m": 0.025 } })
}

fn value(name: &str, pathologies_m: &[[f64; 3]], applied: Vec<AppliedRecord>) -> Option<f64> {
    metric(name, &known(pathologies_m), applied).value
}

#[test]
fn with_current_the_time_under_current_counts_and_without_any_the_whole_time() {
    let cutting = [(AWAY, 50), (CUTS, 30), (CUTS_AWAY, 10), (SEEN, 7)];
    assert_eq!(value("cutting", &[POLYP_M], ticks(&cutting)), Some(75.0));
    assert_eq!(value("looking", &[POLYP_M], ticks(&[(AWAY, 40), (SEEN, 60)])), Some(60.0));
    let scored = metric("scored", &known(&[POLYP_M]), ticks(&[(CUTS, 60), (CUTS_AWAY, 40)]));
    assert_eq!((scored.value, scored.score), (Some(60.0), Some(50.0)), "it is scored where no case says otherwise");
}

/// One tick of current with the pathology in view was as good as a session in which it was never lost.
#[test]
fn a_tap_on_the_pedal_is_no_work_of_which_alone_the_view_counts() {
    // The session begins with the current.
    assert_eq!(value("tap", &[POLYP_M], ticks(&[(AWAY, 1), (CUTS, 9), (AWAY, 27)])), Some(25.0));
    assert_eq!(value("work", &[POLYP_M], ticks(&[(AWAY, 1), (CUTS, 10), (AWAY, 27)])), Some(100.0));
}

#[test]
fn who_is_turned_away_too_far_off_or_in_the_dark_has_nothing_in_view() {
    assert_eq!(value("away", &[POLYP_M], ticks(&[(CUTS_AWAY, 10)])), Some(0.0));
    assert_eq!(value("far", &[[0.0, 0.016, 0.065]], ticks(&[(CUTS, 10)])), Some(0.0));
    // The session begins after the first tenth, when the light is changed.
    let mut dark = ticks(&[(SEEN, 1), (CUTS, 10)]);
    dark[..TENTH].iter_mut().for_each(|record| record.sample.controls.light = 0.5);
    dark[TENTH..6 * TENTH].iter_mut().for_each(|record| record.sample.controls.light = 0.0);
    assert_eq!(value("dark", &[POLYP_M], dark), Some(50.0));
}

#[test]
fn of_several_pathologies_the_one_next_to_the_tip_counts() {
    let behind_m = [0.0, -0.003, 0.034];
    assert_eq!(value("behind", &[POLYP_M, behind_m], ticks(&[(CUTS, 10)])), Some(0.0));
    assert_eq!(value("before", &[[0.0, 0.016, 0.065], POLYP_M], ticks(&[(CUTS, 10)])), Some(100.0));
}

#[test]
fn without_a_pathology_or_in_a_recording_of_before_it_was_noted_there_is_no_value_and_no_score() {
    for (name, known) in [("none", known(&[])), ("old", json!({}))] {
        let metric = metric(name, &known, ticks(&[(CUTS, 10)]));
        assert_eq!((metric.value, metric.score), (None, None), "{name}");
    }
}

#[test]
fn a_pose_that_is_no_number_is_left_out() {
    let mut some = ticks(&[(CUTS, 30), (CUTS_AWAY, 10)]);
    some[..10 * TENTH].iter_mut().for_each(|record| record.sample.pose.position_m[1] = f32::NAN);
    some[10 * TENTH..20 * TENTH].iter_mut().for_each(|record| record.sample.pose.orientation[0] = f32::INFINITY);
    assert_eq!(value("some", &[POLYP_M], some), Some(50.0), "a second in view and one turned away are left");
    let mut all = ticks(&[(CUTS, 10)]);
    all.iter_mut().for_each(|record| record.sample.pose.position_m = [f32::NAN; 3]);
    assert_eq!(value("all", &[POLYP_M], all), None);
}
