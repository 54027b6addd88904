//! What a report says of a session besides its values: who does nothing scores below who does the task, sessions of another anatomy are marked where they are
//! compared, and what the trainee did and was told stands on the axis of the time.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{busy, bytes_of, fluid, record, tissue};
use hyst_assessment::{Assessment, Scores, Sessions, assess, html, json, scores, text};
use hyst_recording::{Block, Reader};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::Path;

/// A case whose goals are so many millilitres removed each, with a seed; nothing but its time ends it.
fn case(removed_ml: &[f64], seed: u32) -> String {
    let goals: Value = removed_ml.iter().map(|ml| json!({ "words": format!("take {ml} ml"), "is": { "removed": ml } })).collect();
    let end = json!({ "goals": false, "time_s": 100.0, "deficit_ml": null, "bled_ml": null, "perforation": false });
    let warnings = json!([{ "words": "it <bleeds>", "is": { "bled_above": 0.1 } }]);
    let case = json!({
        "name": "A polyp", "rung": "polyp", "task": "Take it.", "seed": seed, "drawn": [], "pathology_ml": 2.0,
        "goals": goals, "end": end, "warnings": warnings, "score": {},
    });
    case.to_string()
}

/// A recording of some blocks with these facts.
fn recorded(name: &str, facts: &[(&str, &str)], blocks: &[Block]) -> Assessment {
    let bytes = bytes_of(name, facts, blocks);
    assess(Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap(), 1, |_| {})
}

/// Three seconds in which the hand does something, and 0.16 ml are removed after 1.61 s.
fn at_work() -> Vec<Block> {
    (0..15u64).map(|index| busy(5_000 + 200 * index, 200)).collect()
}

/// Three seconds in which it does nothing, and nothing happens.
fn idle() -> Vec<Block> {
    let block = |first: u64| Block {
        applied: (first..first + 200).map(|tick| record(tick, [0.0, 0.0, 0.02], 0.0)).collect(),
        tissue: vec![tissue(first + 10, 0, 0.0)],
        fluid: vec![fluid(first + 20, 60.0, 0.0)],
        ..Block::default()
    };
    (0..15u64).map(|index| block(5_000 + 200 * index)).collect()
}

fn score(scores: &Scores, key: &str) -> Option<f64> {
    scores.metrics.iter().find(|metric| metric.definition.key == key).unwrap_or_else(|| panic!("no {key}")).score
}

/// Weighted mean of the scores that stand in the table.
fn mean(scores: &Scores) -> f64 {
    let scored = scores.metrics.iter().filter_map(|metric| Some((metric.scale?.weight, metric.score?)));
    let (sum, weight) = scored.fold((0.0, 0.0), |(sum, all), (weight, score)| (sum + weight * score, all + weight));
    sum / weight
}

#[test]
fn who_does_nothing_scores_below_who_reaches_the_goals() {
    let case = case(&[0.05, 0.15], 3);
    let [idle, good] =
        [("idle", idle()), ("good", at_work())].map(|(name, blocks)| recorded(name, &[("case", case.as_str())], &blocks));
    let [of_idle, of_good] = [&idle, &good].map(|assessment| scores(&assessment.measured));
    assert_eq!((of_idle.done, of_good.done), (0.0, 1.0));
    assert_eq!((score(&of_idle, "path"), score(&of_good, "path")), (Some(0.0), Some(100.0)), "it was short");
    assert_eq!((score(&of_idle, "time"), score(&of_good, "time")), (None, Some(100.0)), "it was broken off");
    // The hand that does something turns the scope by 33 degrees, and the horizon with it.
    assert_eq!((score(&of_idle, "camera_turned"), score(&of_good, "camera_turned")), (None, Some(100.0)));
    assert_eq!(score(&of_idle, "force_peak"), Some(100.0), "who does nothing hurts nobody");
    let [none, all] = [&of_idle, &of_good].map(|scores| scores.total.unwrap());
    assert!((none - 0.5 * mean(&of_idle)).abs() < 1e-9 && (all - mean(&of_good)).abs() < 1e-9, "{none} {all}");
    assert!(none < 50.0 && all > none + 25.0, "{none} of who does nothing, {all} of who does it");

    let sessions = Sessions::new("idle.mcap", idle);
    let (told, report) = (text(&sessions), json(&sessions));
    assert!(told.contains("  0 % of what the goals ask for was done"), "{told}");
    assert!(told.lines().all(|line| line.chars().count() <= 100), "{told}");
    let page = html(&sessions);
    assert!(
        page.contains("multiplied by the share of them that was done") && page.contains("<span>All, × 0.50 for the goals</span>")
    );
    assert_eq!((report["format"].as_u64(), report["goals_share"].as_f64()), (Some(6), Some(0.0)));
    let metric = |key: &str| report["metrics"].as_array().unwrap().iter().find(|metric| metric["key"] == key).unwrap();
    assert_eq!((&metric("time")["times_goals_share"], &metric("deficit")["times_goals_share"]), (&json!(true), &json!(false)));
}

/// A case whose second goal is another one, and weighs otherwise.
fn case_with(second: Value, weight: f64) -> String {
    let mut case: Value = serde_json::from_str(&case(&[0.05, 9.0], 3)).unwrap();
    case["goals"][1] = json!({ "words": "the rest", "is": second, "weight": weight });
    case.to_string()
}

#[test]
fn half_of_the_goals_are_half_of_the_path_and_three_quarters_of_all() {
    let case = case_with(json!({ "piece": 9.0 }), 1.0);
    let scores = scores(&recorded("half", &[("case", case.as_str())], &at_work()).measured);
    assert_eq!((scores.done, score(&scores, "path"), score(&scores, "goals")), (0.5, Some(50.0), Some(50.0)));
    assert!((scores.total.unwrap() - 0.75 * mean(&scores)).abs() < 1e-9, "{:?}", scores.total);
    assert_eq!(score(&scores, "time"), None, "nobody knows how long the rest would have taken");
}

/// To quit after the chip was better than to have resected nearly all.
#[test]
fn goals_count_by_their_weights_and_what_is_removed_as_far_as_it_has_come() {
    // 0.28 ml in the end, half of what the second goal wants.
    let case = case_with(json!({ "removed": 0.56 }), 3.0);
    let sessions = Sessions::new("a.mcap", recorded("weights", &[("case", case.as_str())], &at_work()));
    let report = json(&sessions);
    assert!((report["goals_share"].as_f64().unwrap() - (1.0 + 3.0 * 0.5) / 4.0).abs() < 1e-9, "{}", report["goals_share"]);
    let goal = &report["case"]["goals"][1];
    assert_eq!((goal["weight"].as_f64(), goal["state"].as_str()), (Some(3.0), Some("open")));
    assert!(html(&sessions).contains("<b>1 of 2</b><span>Goals reached</span>"));
}

#[test]
fn without_a_case_and_where_no_goal_was_called_for_every_score_is_that_of_its_scale() {
    let mut stop: Value = serde_json::from_str(&case(&[], 3)).unwrap();
    stop["goals"] = json!([{ "words": "stop", "is": { "stop": { "after": { "deficit_above": 50.0 }, "ticks": 200 } } }]);
    let stop = stop.to_string();
    for facts in [vec![], vec![("case", stop.as_str())]] {
        let scores = scores(&recorded("free", &facts, &idle()).measured);
        assert_eq!((scores.done, score(&scores, "time"), score(&scores, "path")), (1.0, Some(100.0), Some(100.0)), "{facts:?}");
        assert!((scores.total.unwrap() - mean(&scores)).abs() < 1e-9, "{facts:?}");
    }
}

/// Whether a session is marked as one of another anatomy beside the reported one: on the page, in the text, in the JSON.
fn marked(reported: (&str, &str, Option<u32>), earlier: (&str, &str, Option<u32>)) -> [bool; 3] {
    let [reported, earlier] = [reported, earlier].map(|(scene, scene_hash, seed)| {
        let case = seed.map(|seed| case(&[0.1], seed));
        let mut facts = vec![("session", "s"), ("scene", scene), ("scene_hash", scene_hash), ("hand", "device")];
        facts.extend(case.as_deref().map(|case| ("case", case)));
        recorded("compared", &facts, &at_work())
    });
    let mut sessions = Sessions::new("new.mcap", reported);
    sessions.compare("old.mcap", earlier);
    let (page, told, report) = (html(&sessions), text(&sessions), json(&sessions));
    let is_same = report["compared"][0]["is_of_same_anatomy"].as_bool().unwrap();
    [page.contains("of another case, seed or scene"), told.contains("of another case, seed or scene"), !is_same]
}

#[test]
fn a_session_with_another_seed_of_the_same_case_is_marked_and_the_same_case_from_elsewhere_is_not() {
    let of = |seed: u32| ("/usr/share/hystation/cases/polyp.toml", "0a", Some(seed));
    assert_eq!(marked(of(3), of(7)), [true; 3], "another seed of the same file");
    assert_eq!(marked(of(3), ("assets/cases/polyp.toml", "0a", Some(3))), [false; 3], "the same case from a checkout");
    assert_eq!(marked(of(3), ("/usr/share/hystation/cases/polyp.toml", "0a", None)), [true; 3], "no case");
    assert_eq!(marked(("a.toml", "0a", None), ("b.toml", "0a", None)), [false; 3], "the same scene under another name");
    assert_eq!(marked(("a.toml", "0a", None), ("a.toml", "0b", None)), [true; 3], "a scene that was changed");

    let seeded = |seed: u32| recorded("seeded", &[("scene", "polyp.toml"), ("case", case(&[0.1], seed).as_str())], &at_work());
    let mut sessions = Sessions::new("new.mcap", seeded(3));
    sessions.compare("old.mcap", seeded(7));
    let (page, told) = (html(&sessions), text(&sessions));
    for words in ["A polyp, seed 3", "A polyp, seed 7"] {
        assert!(page.contains(words) && told.contains(words), "{words}: {told}");
    }
}

/// Two devices were compared as equals of which one makes less than half of the other's force.
#[test]
fn what_the_device_states_is_told_and_a_session_with_another_one_is_marked() {
    let with = |max_force_n: f32| {
        let mut blocks = at_work();
        let records = blocks.iter_mut().flat_map(|block| block.applied.iter_mut());
        records.for_each(|record| record.limits.max_force_n = max_force_n);
        recorded("device", &[("session", "s")], &blocks)
    };
    // The last one is of a recording that does not say it.
    for (reported, earlier, is_same) in [(1.5, 1.5, Some(true)), (1.5, 3.5, Some(false)), (1.5, 0.0, None)] {
        let mut sessions = Sessions::new("new.mcap", with(reported));
        sessions.compare("old.mcap", with(earlier));
        for told in [html(&sessions), text(&sessions)] {
            assert!(told.contains("states 1.500 N at most"), "{told}");
            assert_eq!(told.contains("with another device"), is_same == Some(false), "{earlier} N: {told}");
        }
        let report = json(&sessions);
        assert_eq!(report["station"]["device_max_force_n"].as_f64(), Some(1.5));
        assert_eq!(report["compared"][0]["is_of_same_device"].as_bool(), is_same, "{earlier} N");
    }
}

/// Whether an earlier session of a case that was changed since is marked as of another anatomy, and as judged by other goals.
fn edited(change: fn(&mut Value)) -> [bool; 2] {
    let before = case(&[0.1], 3);
    let mut after: Value = serde_json::from_str(&before).unwrap();
    change(&mut after);
    let [reported, earlier] = [after.to_string(), before].map(|case| recorded("edited", &[("case", case.as_str())], &at_work()));
    let mut sessions = Sessions::new("new.mcap", reported);
    sessions.compare("old.mcap", earlier);
    let (page, told, report) = (html(&sessions), text(&sessions), json(&sessions));
    let marks = [
        ("is_of_same_anatomy", "of another case, seed or scene"),
        ("is_judged_alike", "judged by other goals, ends, warnings or weights"),
    ];
    let marked = marks.map(|(_, words)| page.contains(words));
    assert_eq!(marked, marks.map(|(_, words)| told.contains(words)));
    let [anatomy, judged] = marks.map(|(key, _)| report["compared"][0][key].as_bool() == Some(false));
    assert_eq!(marked, [anatomy, judged && !anatomy], "the first says it already");
    [anatomy, judged]
}

#[test]
fn an_earlier_session_of_a_case_that_was_edited_or_draws_otherwise_by_now_is_marked() {
    type Change = (fn(&mut Value), [bool; 2]);
    let changes: [Change; 10] = [
        (|_| {}, [false, false]),
        (|case| case["goals"][0]["words"] = json!("take a tenth of a millilitre"), [false, false]),
        (|case| case["goals"][0]["is"] = json!({ "removed": 0.2 }), [false, true]),
        (|case| case["end"]["time_s"] = json!(50.0), [false, true]),
        (|case| case["warnings"][0]["is"] = json!({ "bled_above": 0.2 }), [false, true]),
        (|case| case["warnings"][0]["notice"] = json!(true), [false, true]),
        (|case| case["goals"][0]["weight"] = json!(2.0), [false, true]),
        (|case| case["score"] = json!({ "time": { "weight": 4.0 } }), [false, true]),
        (|case| case["drawn"] = json!(["polyp: 1.10 times as large"]), [true, false]),
        (|case| case["pathology_ml"] = json!(2.1), [true, false]),
    ];
    for (index, (change, marked)) in changes.into_iter().enumerate() {
        assert_eq!(edited(change), marked, "change {index}");
    }
}

#[test]
fn what_cost_most_is_named_and_the_scores_of_earlier_sessions_stand_below_those_of_the_session() {
    let session = || recorded("glance", &[("case", case(&[0.05, 9.0], 3).as_str())], &at_work());
    let mut sessions = Sessions::new("new.mcap", session());
    sessions.compare("old.mcap", session());
    let (page, told) = (html(&sessions), text(&sessions));
    let total = scores(&sessions.reported.assessment.measured).total.unwrap();
    assert_eq!(page.matches("<small>A ").count(), 6, "of all, of four groups and of the task");
    assert!(page.contains(&format!("<small>A {total:.0} %</small>")), "{page}");
    // Half of the goals, which weigh most, are open; no medium above the arteries' pressure.
    let of_page = page.split_once("<h2>What cost most</h2>").unwrap().1.split_once("</section>").unwrap().0;
    let of_text = told.split_once("What cost most, of 100\n").unwrap().1.split_once("\n\n").unwrap().0;
    for dearest in [of_page, of_text] {
        assert!(dearest.contains("goals of the case") && !dearest.contains("time above 100 mmHg"), "{dearest}");
    }
    let report = json(&sessions);
    let costs = report["costs_most"].as_array().unwrap();
    assert!((1..=5).contains(&costs.len()) && costs.iter().any(|cost| cost["key"] == "goals"), "{costs:?}");
    assert_eq!((of_page.matches("<li>").count(), of_text.lines().count()), (costs.len(), costs.len()), "{of_page} {of_text}");
}

#[test]
fn goals_warnings_alarms_and_current_are_marked_over_time_and_the_pump_is_not_told_of_under_the_station() {
    let mut blocks = at_work();
    blocks[8].fluid[0].alarms = 4;
    let sessions = Sessions::new("a.mcap", recorded("marks", &[("case", case(&[0.15], 3).as_str())], &blocks));
    let page = html(&sessions);
    for mark in [
        "class=\"mark goal\"><title>1.610 s: reached: take 0.15 ml</title>",
        "class=\"mark warned\"><title>0.620 s: warning: it &lt;bleeds&gt;</title>",
        "class=\"mark alarm\"><title>1.620 s: the pump: abnormal loss</title>",
        "class=\"current\"><title>current from 2.0 s to 3.0 s</title>",
    ] {
        assert_eq!(page.matches(mark).count(), 1, "{mark}");
    }
    assert_eq!(page.matches("class=\"mark ").count(), 3, "and nothing else");
    let told = text(&sessions);
    for report in [&page, &told] {
        let (before, station) = report.split_once("What the station did").unwrap();
        assert!(before.contains("abnormal loss 1") && !station.contains("abnormal loss"), "{station}");
    }
    let report = json(&sessions);
    assert_eq!((report["pump_alarms"]["abnormal loss"].as_u64(), &report["station"]["pump_alarms"]), (Some(1), &Value::Null));
    assert_eq!(report["pump_alarmed"], json!([{ "alarm": "abnormal loss", "tick": 6_620, "time_s": 1.62 }]));
}
