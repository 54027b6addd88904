//! What a recorder kept of its judgement, out of a file that anybody may have written: it ends nobody who goes on from it.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{brief, fluid, record};
use hyst_assessment::Judge;
use serde_json::{Value, json};

/// The judge of these goals who goes on from what was kept, with the largest numbers in it that there are.
fn hostile(goals: Value) -> Judge {
    let warnings = json!([{ "time_above": 0 }, { "force_above": 100.0 }, { "force_above": 200.0 }]);
    let mut judge = Judge::new(brief(goals, json!({ "goals": false }), warnings, json!({})));
    judge.tick(&record(1, [0.0, 0.0, 0.02], 0.0));
    let mut kept = serde_json::to_value(&judge).unwrap();
    for goal in kept["goals"].as_array_mut().unwrap() {
        (goal["since_tick"], goal["places"]) = (json!(u64::MAX), json!(u64::MAX));
        goal["looks"] = json!([[u64::MAX, false]]);
    }
    for warning in kept["warnings"].as_array_mut().unwrap() {
        warning["count"] = json!(u64::MAX);
    }
    kept["bled"] = json!([[5, 0.0], [u64::MAX, 1.0], [10, 2.0]]);
    serde_json::from_value(kept).unwrap()
}

#[test]
fn what_was_kept_with_the_largest_numbers_overflows_nothing_and_does_not_grow() {
    let landmarks = json!([{ "words": "a", "is": [0.0, 0.0, 0.03] }]);
    let sight = json!({ "optic_rad": 0.5, "within_rad": 3.0, "within_m": 1.0 });
    let look = json!({ "look": { "landmarks": landmarks, "sight": sight, "ticks": 10 } });
    let places = json!([{ "words": "b", "is": { "insertion": [0.0, 0.1] } }]);
    let goals = json!([
        { "pressure": { "band_pa": [0.0, 2e4], "ticks": 500 } },
        { "staunch": { "after_ml": 0.0, "below_ml_min": 1.0, "ticks": 500 } },
        { "visit": { "places": places, "stay_ticks": 10 } },
        look,
        look,
    ]);
    for goals in [goals, json!([{ "stop": { "after": "current", "ticks": 5 } }])] {
        let mut judge = hostile(goals);
        assert!(judge.landmarks_percent().is_none_or(|percent| percent <= 100.0));
        for tick in 2..5_000 {
            judge.fluid(&fluid(tick, 60.0, 0.0));
            judge.tick(&record(tick, [0.0, 0.0, 0.02 + 0.0012 * (tick % 2) as f32], 0.0));
        }
        assert_eq!((judge.last_tick, judge.warning_count()), (4_999, u64::MAX));
        let kept = serde_json::to_value(&judge).unwrap();
        assert!(kept["bled"].as_array().unwrap().len() <= 25, "{}", kept["bled"]);
        assert_eq!(kept["warnings"][0]["count"], json!(u64::MAX));
    }
}
