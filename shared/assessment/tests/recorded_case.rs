//! The judgement of a session from its recording: the same as live, with what the case says of scores; and a case that cannot be read.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{brief, bytes_of};
use hyst_assessment::{Assessment, EndedBy, Judge, Sessions, assess, html, json, text};
use hyst_recording::{Block, Reader};
use serde_json::json;
use std::io::Cursor;
use std::path::Path;

/// Three seconds of recording whose pressure is held, with a case.
fn recorded(name: &str, case: &str) -> Assessment {
    let blocks: Vec<Block> = (0..15u64).map(|index| fixture::busy(5_000 + 200 * index, 200)).collect();
    let facts = [("session", "test-1"), ("scene", "/a/case.toml"), ("scene_hash", "00ff"), ("case", case)];
    let bytes = bytes_of(name, &facts, &blocks);
    assess(Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap(), 2, |_| {})
}

#[test]
fn a_recording_is_judged_by_its_case_alone_and_scored_with_its_weights() {
    let goals = json!([{ "pressure": { "band_pa": [6_000.0, 20_000.0], "ticks": 800 } }, { "removed": 0.15 }]);
    let score = json!({ "time": { "weight": 0.0 }, "goals": { "weight": 1.0 }, "pathology": { "weight": 3.0, "full": 20.0, "none": 0.0 } });
    let case = brief(goals, json!({}), json!([{ "bled_above": 0.1 }]), score);
    let assessment = recorded("judged", &serde_json::to_string(&case).unwrap());
    let judge = assessment.measured.judge.clone().unwrap();
    // 60 mmHg from 5020 on; 0.16 ml are removed at 6610.
    assert_eq!(judge.goals.iter().map(|goal| goal.reached_tick).collect::<Vec<_>>(), [Some(5_820), Some(6_610)]);
    assert_eq!(judge.ended, Some((EndedBy::Goals, 6_610)));
    let sessions = Sessions::new("a.mcap", assessment);
    let report = json(&sessions);
    let ended = json!({ "by": "goals", "words": "all goals were reached", "at_s": 1.61, "after_s": 1_525.0 * 1e-3 });
    assert_eq!(report["case"]["ended"], ended);
    let metric = |key: &str| report["metrics"].as_array().unwrap().iter().find(|metric| metric["key"] == key).unwrap();
    // The hand has moved by a millimetre after 85 ms.
    assert_eq!((metric("time")["value"].as_f64(), metric("time")["weight"].as_f64()), (Some(1.526), Some(0.0)), "up to the end");
    assert_eq!(metric("goals")["score"].as_f64(), Some(100.0));
    let near = |key: &str, field: &str, exact: f64| (metric(key)[field].as_f64().unwrap() - exact).abs() < 1e-9;
    assert!(near("removed", "value", 0.16) && near("pathology", "value", 8.0) && near("pathology", "score", 40.0), "{report}");
    let task = (100.0 + 3.0 * 40.0 + 80.0) / 5.0; // one warning of five
    assert!((report["groups"]["Task"].as_f64().unwrap() - task).abs() < 1e-9, "{}", report["groups"]);
    assert!(report["groups"]["Ergonomics"].as_f64().is_some());

    let told = text(&sessions);
    assert!(told.contains("Case: A case <b> (seed 3)") && told.contains("reached at 0.8 s"), "{told}");
    assert!(told.contains("ended after 1.5 s: all goals were reached") && told.contains("warning: number 0"), "{told}");
    assert!(told.lines().all(|line| line.chars().count() <= 100), "{told}");
    assert!(!told.contains("no warnings") && !told.contains("Not everything"), "{told}");
    let page = html(&sessions);
    assert!(page.contains("<b>2 of 2</b><span>Goals reached</span>"), "{page}");
    assert!(page.contains("<h2>Case: A case &lt;b&gt;</h2>") && page.contains("Do it &amp; well."), "{page}");
    assert!(page.contains("class=\"text reached\">reached at 1.6 s") && !page.contains("<b>\""), "{page}");
}

/// Who resected in a scene without a case was told millilitres, and no percent.
#[test]
fn without_a_case_the_percent_removed_are_of_what_the_recording_says_that_its_scene_had() {
    let percent = |fact: &[(&str, &str)]| {
        let blocks: Vec<Block> = (0..15u64).map(|index| fixture::busy(5_000 + 200 * index, 200)).collect();
        let bytes = bytes_of("scene-alone", &[&[("session", "test-1")][..], fact].concat(), &blocks);
        let assessment = assess(Reader::new(Cursor::new(&bytes), Path::new("session.mcap")).unwrap(), 2, |_| {});
        let report = json(&Sessions::new("a.mcap", assessment));
        let metrics = report["metrics"].as_array().unwrap();
        metrics.iter().find(|metric| metric["key"] == "pathology").unwrap()["value"].as_f64()
    };
    // 0.28 ml in the end.
    assert!(percent(&[("pathology_ml", "2")]).is_some_and(|percent| (percent - 14.0).abs() < 1e-9));
    assert_eq!(percent(&[("pathology_ml", "0.1")]), Some(100.0));
    for unknown in [&[][..], &[("pathology_ml", "0")], &[("pathology_ml", "NaN")], &[("pathology_ml", "much")]] {
        assert_eq!(percent(unknown), None, "{unknown:?}");
    }
}

#[test]
fn a_case_that_cannot_be_read_is_missing_and_the_rest_is_told() {
    for case in ["", "{}", "{\"name\":3}", &"[".repeat(10_000)] {
        let assessment = recorded("unread", case);
        assert!(assessment.measured.judge.is_none() && assessment.missing().iter().any(|line| line.contains("case")), "{case}");
        assert_eq!(assessment.measured.conduct.ticks, 3_000);
    }
    let many = brief(json!(vec![json!({ "removed": 1.0 }); 65]), json!({}), json!([]), json!({}));
    assert!(Judge::read(&serde_json::to_string(&many).unwrap()).unwrap_err().contains("65"));
}
