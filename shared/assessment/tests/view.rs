//! Promises of the report about the view through the blood and about healthy tissue: what the statuses say, in every form of the report, and nothing where an
//! older recording does not say it.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{assessed, brief, bytes, bytes_of, fluid, outputs, record, tissue};
use hyst_assessment::{Assessment, Metric, scores};
use hyst_messages::{FluidStatus, TissueStatus};
use hyst_recording::Block;
use serde_json::{Value, json};

/// Ten seconds with a status a second: `light` comes through the blood from it on, and so much of the wall is off.
fn seconds(light: [f32; 10], healthy_ml: [f64; 10]) -> Vec<Block> {
    let block = |(second, (transmittance, healthy_removed_ml)): (u64, (f32, f64))| {
        let first = 1_000 * second;
        Block {
            applied: (first..first + 1_000).map(|tick| record(tick, [0.0, 0.0, 0.03 + 1e-6 * tick as f32], 0.0)).collect(),
            fluid: vec![FluidStatus { transmittance, ..fluid(first, 70.0, 0.0) }],
            tissue: vec![TissueStatus { healthy_removed_ml, ..tissue(first, 0, 0.0) }],
            ..Block::default()
        }
    };
    (0..).zip(light.into_iter().zip(healthy_ml)).map(block).collect()
}

/// It clears, clouds for three seconds, is not known for one, clouds again for one, and is clear at the end.
const LIGHT: [f32; 10] = [1.0, 1.0, 0.25, 0.125, 0.25, 0.0, 0.25, 0.75, 1.0, 1.0];
const HEALTHY_ML: [f64; 10] = [0.0, 0.0, 0.0, 0.125, 0.125, 0.125, 0.25, 0.25, 0.25, 0.25];

fn metric(assessment: &Assessment, key: &str) -> Metric {
    let found = scores(&assessment.measured).metrics.into_iter().find(|metric| metric.definition.key == key);
    found.unwrap_or_else(|| panic!("no {key}"))
}

#[test]
fn the_report_tells_how_long_the_view_was_clear_how_long_it_was_lost_and_what_was_taken_off_the_wall() {
    let (assessment, csv) = assessed(&bytes("view", &seconds(LIGHT, HEALTHY_ML)), 1);
    let value = |key: &str| metric(&assessment, key).value.unwrap_or_else(|| panic!("{key}"));
    // Nine seconds have an end, one of them is not known: four are clear, four are not.
    assert!((value("clear_view") - 50.0).abs() < 1e-9 && (value("view_lost") - 4.0).abs() < 1e-9);
    assert!((value("transmittance") - 100.0 * 4.625 / 8.0).abs() < 1e-9, "{}", value("transmittance"));
    assert_eq!((value("healthy_removed"), metric(&assessment, "healthy_removed").score), (0.25, None));
    assert_eq!(metric(&assessment, "clear_view").score, Some(0.0), "half of the time is where its scale ends");
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|head| *head == name).unwrap();
    let (light, healthy) = (column("transmittance"), column("healthy_removed_ml"));
    // Ten rows a second: the fourth second, and the one in which nothing is known of the view.
    assert_eq!([rows[36][light], rows[36][healthy], rows[56][light], rows[56][healthy]], ["0.125", "0.125", "", "0.125"]);

    let [text, page, json, _] = outputs(&bytes("view-forms", &seconds(LIGHT, HEALTHY_ML)), 1);
    let line = |name: &str| text.lines().find(|line| line.trim_start().starts_with(name)).unwrap_or_else(|| panic!("{text}"));
    assert!(line("time with a clear view").contains(" 50.00 %"), "{text}");
    assert!(line("longest time without a clear view").contains(" 4.000 s"), "{text}");
    assert!(line("volume of healthy tissue").contains(" 0.250 ml"), "{text}");
    assert_eq!(page.matches("class=\"curve light\"").count(), 1);
    let json: Value = serde_json::from_str(&json).unwrap();
    let of = |key: &str| json["metrics"].as_array().unwrap().iter().find(|metric| metric["key"] == key).unwrap();
    assert_eq!((&of("clear_view")["group"], &of("healthy_removed")["group"]), (&json!("Visualisation"), &json!("Safety")));
    assert_eq!((of("healthy_removed")["value"].as_f64(), of("view_lost")["unit"].as_str()), (Some(0.25), Some("s")));
    let of_task = ["removed", "pathology", "brought_out", "goals"].map(|key| of(key)["group"].as_str());
    assert_eq!(of_task, [Some("Task"); 4], "how complete the task is, is none of the four groups");
}

#[test]
fn a_case_weighs_the_view_and_what_was_taken_off_the_wall() {
    let weights = json!({
        "clear_view": { "weight": 3.0, "full": 100.0, "none": 0.0 },
        "view_lost": { "weight": null, "full": 0.0, "none": 8.0 },
        "healthy_removed": { "weight": 2.0, "full": 0.0, "none": 1.0 },
    });
    let case = serde_json::to_string(&brief(json!([{ "removed": 0.5 }]), json!({}), json!([]), weights)).unwrap();
    let facts = [("session", "s"), ("case", case.as_str())];
    let (assessment, _) = assessed(&bytes_of("view-case", &facts, &seconds(LIGHT, HEALTHY_ML)), 1);
    assert_eq!(assessment.unread, None);
    // Its session begins after a second, when the hand has moved by a millimetre.
    let weighed = ["clear_view", "view_lost", "healthy_removed"].map(|key| metric(&assessment, key));
    let [clear, lost, healthy] = weighed.map(|metric| (metric.scale.unwrap().weight, metric.score.unwrap()));
    assert_eq!((clear.0, lost.0, healthy.0), (3.0, 1.0, 2.0));
    assert!((clear.1 - 300.0 / 7.0).abs() < 0.1 && (lost.1 - 50.0).abs() < 0.1, "{clear:?} {lost:?}");
    assert!((healthy.1 - 75.0).abs() < 1e-9, "{healthy:?}");
}

#[test]
fn a_recording_that_says_nothing_of_view_and_healthy_tissue_has_no_value_no_score_and_no_curve_of_them() {
    let old = seconds([f32::NAN; 10], [f64::NAN; 10]);
    let (assessment, csv) = assessed(&bytes("view-old", &old), 1);
    for key in ["clear_view", "view_lost", "transmittance", "healthy_removed"] {
        let metric = metric(&assessment, key);
        assert_eq!((metric.value, metric.score), (None, None), "{key}");
    }
    assert!(csv.lines().skip(1).all(|line| line.ends_with(",,,1")), "{csv}");
    let [text, page, json, _] = outputs(&bytes("view-old-forms", &old), 1);
    let line = text.lines().find(|line| line.contains("time with a clear view")).unwrap();
    assert!(line.contains(" – ") && !page.contains("class=\"curve light\""), "{line}");
    let json: Value = serde_json::from_str(&json).unwrap();
    let unknown = json["metrics"].as_array().unwrap().iter().filter(|metric| metric["value"].is_null());
    let keys: Vec<&str> = unknown.filter_map(|metric| metric["key"].as_str()).collect();
    assert!(["clear_view", "healthy_removed"].iter().all(|key| keys.contains(key)), "{keys:?}");
}
