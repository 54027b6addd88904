//! What stands in every report of a campaign, as text, JSON, JUnit and page.

use super::bounds::Excess;
use super::file;
use super::judge::{Figures, Judgement, Verdict, judge};
use super::origin::{Batch, Origin};
use super::outcome::Outcome;
use super::station::StationOutcome;
use super::{draw, html, junit, text};
use serde_json::{Value, json};

/// Each figure is another number, so that none stands in for another.
fn judgement() -> Judgement {
    let figures = Figures {
        arm: "as built".into(),
        judged: true,
        name: "kill fluid:active".into(),
        planned: 83,
        injected: 71,
        manifested: 67,
        without_verdict: 5,
        detected_by: [("latch".to_string(), 59)].into(),
        detected_ms: vec![1.3, 4.7],
        contained_ms: vec![2.1, 8.9],
        recovered_ms: vec![150.3, 310.7],
        excess: Some(Excess { faults: 66, worse: 7, better: 3, mean: 0.0606, lower95: 0.0123, upper95: 0.1357 }),
        mean_excess_misses: Some(6.1),
        mean_excess_misses_upper95: Some(7.25),
        limit_upper95: Some(0.25),
        missed: [61, 53],
        window_ticks: [1_800, 200],
        control_ticks: [1_900, 100],
        aftermath: [300, 13],
        allowed_misses: 17,
        step_max_n: [0.213, 0.087],
        wrong: 29,
        data_lost_ticks: 43,
        leftovers: 37,
        verdict: Verdict::Held,
        ..Figures::default()
    };
    let origin = Origin {
        version: "0.1.0".into(),
        build: "0123456789abcdef".into(),
        cpu: "a processor".into(),
        cores: 2,
        kernel: "6.1.2".into(),
        date: "2026-11-24".into(),
    };
    Judgement {
        campaign: "c".into(),
        seed: 9,
        planned: 83,
        done: 71,
        origins: vec![Batch { origin: Some(origin), last_date: "2026-11-25".into(), stations: 3 }],
        cells: vec![figures],
        pools: vec![],
        few: vec![],
        broken: vec![],
        unknown: vec![],
        void_share: 0.0,
        exit_code: 0,
    }
}

fn assert_has(report: &str, words: &[&str]) {
    words.iter().for_each(|word| assert!(report.contains(word), "{word:?} is missing in\n{report}"));
}

#[test]
fn every_report_has_what_was_injected_what_came_of_it_and_what_it_cost() {
    let judgement = judgement();
    let text = text::text(&judgement);
    let row = text.lines().find(|line| line.starts_with("kill fluid:active")).unwrap();
    let words: Vec<&str> = row.split_whitespace().collect();
    let expected = "kill fluid:active 71/83 67 5 4.7/4.7 8.9/8.9 310.7/310.7 7/3 0.0606 0.1357 0.25 6.100<7.25 17 - 10.0/5.0 0.213/0.087 29 43 37 held latch 59, 13 of 300 ticks right after the windows missed";
    assert_eq!(words.join(" "), expected);

    let json = serde_json::to_value(&judgement.cells[0]).unwrap();
    let number = |key: &str| json[key].as_u64();
    let keys = ["injected", "manifested", "wrong", "data_lost_ticks", "leftovers"];
    assert_eq!(keys.map(number), [71, 67, 29, 43, 37].map(Some));
    assert_eq!((&json["detected_by"]["latch"], &json["excess"]["upper95"]), (&json!(59), &json!(0.1357)));
    let lists = ["detected_ms", "contained_ms", "recovered_ms", "step_max_n"].map(|key| json[key].clone());
    assert_eq!(lists, [json!([1.3, 4.7]), json!([2.1, 8.9]), json!([150.3, 310.7]), json!([0.213, 0.087])]);

    let junit = junit::junit(&judgement);
    let case = junit.lines().find(|line| line.contains("name=\"kill fluid:active\"")).unwrap();
    let property = |name: &str, value: &str| assert_has(case, &[&format!("<property name=\"{name}\" value=\"{value}\"/>")]);
    for (name, value) in [
        ("injected", "71"),
        ("manifested", "67"),
        ("detected_by", "latch 59"),
        ("detected_ms_median_and_largest", "4.7/4.7"),
        ("contained_ms_median_and_largest", "8.9/8.9"),
        ("recovered_ms_median_and_largest", "310.7/310.7"),
        ("faults_with_excess_misses_per_fault", "0.0606"),
        ("faults_with_excess_misses_per_fault_95", "0.0123 to 0.1357"),
        ("faults_with_excess_misses_limit_95", "0.25"),
        ("excess_misses_mean", "6.100 below 7.25"),
        ("missed_ticks", "61"),
        ("missed_control_ticks", "53"),
        ("missed_right_after", "13"),
        ("allowed_misses", "17"),
        ("void_tick_share", "0.1000"),
        ("void_tick_control_share", "0.0500"),
        ("force_step_max_n", "0.213"),
        ("force_step_max_control_n", "0.087"),
        ("invalid_or_stale_applied_ticks", "29"),
        ("data_lost_ticks", "43"),
        ("leftovers", "37"),
    ] {
        property(name, value);
    }

    let page = html::html(&judgement, &[], &[]);
    let row = page.lines().find(|line| line.contains("<td>kill fluid:active</td>")).unwrap();
    let cells =
        ["71 / 83", "67", "latch 59", "4.7 / 4.7", "8.9 / 8.9", "310.7 / 310.7", "0.0606", "0.0123 … 0.1357", "0.213 / 0.087"];
    cells
        .into_iter()
        .chain(["0.25", "6.100 < 7.25", "61 / 53", "13 / 300", "17", "200 / 100", "29", "43", "37"])
        .for_each(|cell| assert_has(row, &[&format!("<td>{cell}</td>")]));
    let table = &page[..page.find(row).unwrap()];
    let head = &table[table.rfind("<tr><th>").unwrap()..];
    assert_eq!(head.matches("<th>").count(), row.matches("<td").count(), "a heading for each column");
    // Each bound alone is wrong in one case of twenty: the two together are no interval of 95 %.
    assert_has(&page, &["one-sided 95 % bounds, each alone", "<th>one-sided<br>95 % bounds</th>"]);
    assert!(!page.contains("95 % interval"));
}

/// Stations ended with 1 in a campaign that held, and nothing said why.
#[test]
fn the_page_says_what_a_station_that_ended_with_1_calls_broken() {
    let promises_broken = vec!["fault kill of haptic:1 at tick 9000: the hand lost 53 ticks".to_string()];
    let station = StationOutcome { exit_code: Some(1), promises_broken, ..StationOutcome::default() };
    let page = html::html(&judgement(), &[], &[station]);
    assert_has(&page, &["1 broken by the rules of a single run: fault kill of haptic:1 at tick 9000"]);
}

#[test]
fn every_report_names_build_machine_and_days() {
    let judgement = judgement();
    let words = ["runs of build 0.1.0 0123456789abcdef, 2026-11-24 to 2026-11-25, on a processor, 2 cores, Linux 6.1.2: 3"];
    assert_has(&text::text(&judgement), &words);
    assert_has(&junit::junit(&judgement), &words);
    assert_has(&html::html(&judgement, &[], &[]), &words);
    let json: Value = serde_json::to_value(&judgement).unwrap();
    assert_eq!(json["origins"][0]["origin"]["build"], "0123456789abcdef");
}

/// A campaign of which no arm was judged ended with the words that every promise held.
#[test]
fn where_no_promise_was_judged_none_is_said_to_have_held() {
    let judged = Judgement { done: 83, ..judgement() };
    let silent = Judgement { cells: vec![Figures { judged: false, ..judged.cells[0].clone() }], ..judged.clone() };
    let ends = |judgement: &Judgement| (text::text(judgement), html::html(judgement, &[], &[]));
    for (judgement, in_text, on_page) in
        [(&judged, "every promise held", "Every promise held"), (&silent, "no promise was judged", "No promise was judged")]
    {
        let (text, page) = ends(judgement);
        assert!(text.contains(in_text) && page.contains(on_page), "{in_text}: {text}");
    }
}

/// It was an error of the case "nothing invalid, nothing stale, nothing left over".
#[test]
fn that_too_few_faults_have_a_verdict_is_said_of_the_campaign_as_a_whole() {
    let unknown = vec!["31 % of the faults are without a verdict, at most 20 % may be".into()];
    let judgement = Judgement { done: 83, void_share: 0.31, unknown, exit_code: 3, ..judgement() };
    let junit = junit::junit(&judgement);
    let case = junit.lines().find(|line| line.contains("31 % of the faults")).unwrap();
    let share = "<property name=\"faults_without_verdict_share\" value=\"0.3100\"/>";
    assert_has(case, &["name=\"stations, and the campaign as a whole\"", "<error message=", share]);
}

#[test]
fn what_a_run_left_is_the_last_faults_who_had_it() {
    let campaign = file::parse("t", "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\", \"recorder\"]\ncount = 2\n").unwrap();
    let plan = draw::plan(&campaign, 1);
    let outcomes: Vec<Outcome> = plan.faults.iter().map(Outcome::of).collect();
    let faults: Vec<usize> = plan.faults.iter().map(|entry| entry.index).collect();
    let last = &plan.faults[3].cell;
    let arm = campaign.arms[0].name.clone();
    let station = StationOutcome { arm, faults, reported: true, exit_code: Some(0), leftovers: 6, ..StationOutcome::default() };
    let judgement = judge(&campaign, &plan, &outcomes, &[station], None);
    let left: Vec<u64> =
        judgement.cells.iter().map(|cell| if cell.name == *last { cell.leftovers } else { 6 - cell.leftovers }).collect();
    assert_eq!((left, judgement.broken.len()), (vec![6, 6], 1), "{judgement:?}");
}

/// A column was called by another name than its own, and what most keys of the JSON are was written nowhere.
#[test]
fn the_handbook_has_each_column_of_the_text_and_each_key_of_the_json() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/handbook.md");
    let handbook = std::fs::read_to_string(path).unwrap();
    let (_, section) = handbook.split_once("### Many faults").unwrap();
    let (section, _) = section.split_once("### What a campaign says").unwrap();
    let (columns, keys) = section.split_once("#### The keys of report.json").unwrap();
    let judgement = judgement();
    let text = text::text(&judgement);
    let head = text.lines().find(|line| line.starts_with("cell: ")).unwrap();
    let is_said = |text: &str, name: &str| text.contains(&format!("`{name}`"));
    for name in
        ["injected", "found", "+/- miss", "misses<95 %", "allowed", "+/- void", "void %", "step/N", "wrong", "lost", "left"]
    {
        assert!(head.contains(name) && is_said(columns, name), "{name}: {head}");
    }
    let json = serde_json::to_value(&judgement).unwrap();
    for object in [&json, &json["cells"][0], &json["cells"][0]["excess"], &json["origins"][0]] {
        for key in object.as_object().unwrap().keys() {
            assert!(is_said(keys, key), "{key} is not in the handbook");
        }
    }
}
