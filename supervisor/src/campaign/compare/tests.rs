//! Comparisons of results as a campaign leaves them in its folder.

use super::*;
use crate::campaign::outcome::{Ending, Outcome};
use crate::campaign::station::StationOutcome;
use crate::campaign::{draw, file};
use crate::fault::Fault;
use crate::ledger::Window;
use serde_json::Value;
use std::path::PathBuf;

const TEXT: &str = "[[pool]]\nname = \"all\"\nlimit_upper95 = 0.5\n[[cell]]\nkinds = [\"kill\"]\n\
                    targets = [\"haptic:active\", \"tissue:active\"]\ncount = 60\npool = \"all\"\n";
const HAPTIC: &str = "kill haptic:active";
const TISSUE: &str = "kill tissue:active";

/// A folder that goes with its test.
struct Made(PathBuf);

impl Drop for Made {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The results of a campaign that is through. Of each cell the first so many faults cost a tick, and each was found after so many µs.
fn made(name: &str, text: &str, cost: &[(&str, usize)], detected_us: f64) -> Made {
    let folder = std::env::temp_dir().join(format!("hystation-compare-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let campaign = file::parse("t", text).unwrap();
    let plan = draw::plan(&campaign, 1);
    // Not by a store, whose lock a child of another test may keep for some ms.
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("plan.json"), serde_json::to_string_pretty(&plan).unwrap()).unwrap();
    std::fs::write(folder.join("t.toml"), text).unwrap();
    let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
    let mut lines = String::new();
    for entry in &plan.faults {
        let number = seen.entry(&entry.cell).or_default();
        let most = cost.iter().find(|(cell, _)| *cell == entry.cell).map_or(0, |(_, most)| *most);
        let control = Window { ticks: 200, ..Window::default() };
        let window = Window { missed: u64::from(*number < most), ..control };
        *number += 1;
        let fault = Fault {
            manifested: true,
            injected_ns: 1_000_000_000 * (entry.index as u64 + 1),
            detected_by: "pidfd".into(),
            detected_us: Some(detected_us),
            recovered_us: Some(150_000.0),
            active: true,
            window: Some(window),
            control: Some(control),
            ..Fault::default()
        };
        let outcome = Outcome { run: Some(0), ending: Ending::Closed, fault: Some(fault), ..Outcome::of(entry) };
        lines += &format!("{}\n", serde_json::to_string(&outcome).unwrap());
    }
    std::fs::write(folder.join("results.jsonl"), lines).unwrap();
    let origin = Origin { build: name.into(), date: "2026-11-24".into(), ..Origin::default() };
    let station = StationOutcome {
        arm: campaign.arms[0].name.clone(),
        faults: (0..plan.faults.len()).collect(),
        origin: Some(origin),
        reported: true,
        exit_code: Some(0),
        ..StationOutcome::default()
    };
    std::fs::write(folder.join("stations.jsonl"), format!("{}\n", serde_json::to_string(&station).unwrap())).unwrap();
    Made(folder)
}

fn read(made: &Made) -> Results {
    results::read(&made.0, &[]).unwrap()
}

fn compared(first: &Made, second: &Made) -> Comparison {
    compare(&read(first), &read(second))
}

fn last_line(comparison: &Comparison) -> String {
    table::text(comparison).lines().last().unwrap_or_default().to_string()
}

/// What a test of a change is there for.
#[test]
fn what_costs_more_is_worse_the_other_way_round_it_is_better_and_what_costs_as_much_is_neither() {
    let before = made("before", TEXT, &[(HAPTIC, 2)], 2_000.0);
    let after = made("after", TEXT, &[(HAPTIC, 1), (TISSUE, 30)], 6_000.0);
    let worse = compared(&before, &after);
    assert_eq!(worse.worse, ["station, pool all", "station, kill tissue:active"]);
    assert_eq!((worse.better.len(), worse.exit_code), (0, 1));
    assert_eq!(last_line(&worse), "worse beyond doubt: station, pool all; station, kill tissue:active");
    let row = &worse.cells[1];
    let difference = row.difference.unwrap();
    assert_eq!((row.name.as_str(), row.told, difference.mean), (TISSUE, Some(Told::Worse), 0.5));
    assert!(difference.lower95 > 0.2 && difference.upper95 < 0.8, "{difference:?}");
    assert_eq!((row.first.excess.unwrap().worse, row.second.excess.unwrap().worse), (0, 30));
    assert_eq!((row.detected_ratio, row.recovered_ratio), ([Some(3.0); 2], [Some(1.0); 2]));
    assert_eq!((row.first.detected_ms, row.second.recovered_ms), (Some([2.0; 2]), Some([150.0; 2])));
    let better = compared(&after, &before);
    assert_eq!((better.worse.len(), better.better, better.exit_code), (0, worse.worse, 0));
    assert!(last_line(&compared(&after, &before)).starts_with("better beyond doubt: station, pool all; "));
    let same = compared(&before, &before);
    assert_eq!((same.worse.len() + same.better.len(), same.exit_code), (0, 0));
    assert_eq!(last_line(&same), "nothing can be told: no difference is beyond doubt");
}

#[test]
fn the_heading_says_of_what_each_is_and_the_table_has_the_figures_of_both() {
    let (first, second) = (made("head-a", TEXT, &[], 2_000.0), made("head-b", TEXT, &[(TISSUE, 30)], 3_000.0));
    let comparison = compared(&first, &second);
    assert_eq!((&comparison.differ, compared(&first, &first).differ.len()), (&vec!["build"], 0));
    let text = table::text(&comparison);
    for words in ["head-a", "head-b", "campaign t, seed 1: 120 of 120 faults are through", "2026-11-24", "differ in: build"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let row = text.lines().find(|line| line.starts_with(TISSUE)).unwrap();
    let words = ["60/60", "0.5000 (", "2.0/2.0", "3.0/3.0", "1.50/1.50", "150.0/150.0", "0.000/0.000", "worse"];
    assert!(words.iter().all(|word| row.contains(word)), "{row}");
    let json = serde_json::to_value(&comparison).unwrap();
    assert_eq!((&json["cells"][1]["told"], &json["cells"][0]["told"]), (&Value::from("worse"), &Value::Null));
    assert_eq!(json["second"]["origins"][0]["origin"]["build"], "head-b");
}

#[test]
fn what_only_one_has_is_named_and_a_pool_of_other_cells_is_held_against_none() {
    let other = TEXT.replace("tissue:active", "fluid:active");
    let (first, second) = (made("both-a", TEXT, &[], 2_000.0), made("both-b", &other, &[("kill fluid:active", 60)], 2_000.0));
    let comparison = compared(&first, &second);
    assert_eq!(comparison.first_alone, ["station, kill tissue:active"]);
    assert_eq!(comparison.second_alone, ["station, kill fluid:active"]);
    assert_eq!((comparison.cells.len(), comparison.cells[0].name.as_str(), comparison.cells[0].alike), (1, HAPTIC, true));
    let pool = &comparison.pools[0];
    assert!(pool.difference.unwrap().lower95 > 0.2 && !pool.alike && pool.told.is_none(), "{pool:?}");
    assert_eq!((comparison.exit_code, comparison.differ), (0, vec!["file", "build"]));
    // What may cost more ticks is another promise.
    let dearer = TEXT.replace("count = 60", "count = 60\nallowed_misses = 9");
    let dearer = made("both-c", &dearer, &[], 2_000.0);
    let comparison = compared(&first, &dearer);
    assert!(comparison.cells.iter().chain(&comparison.pools).all(|row| !row.alike) && comparison.exit_code == 3);
    let nothing = TEXT.replace("haptic:active", "device").replace("tissue:active", "recorder").replace("\"all\"", "\"none\"");
    let comparison = compared(&first, &made("both-d", &nothing, &[], 2_000.0));
    assert_eq!((comparison.pools.len(), comparison.cells.len(), comparison.exit_code), (0, 0, 3));
    assert_eq!((comparison.first_alone.len(), comparison.second_alone.len()), (3, 3));
    assert!(last_line(&comparison).starts_with("nothing can be compared: "));
}

/// Names and texts of all files of a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.map(|path| (path.clone(), std::fs::read(&path).unwrap())).collect()
}

fn refused(folder: &Path) -> String {
    let refusal = results::read(folder, &[]).unwrap_err();
    assert_eq!(refusal.code, 2, "{}", refusal.message);
    assert!(refusal.message.starts_with(&folder.display().to_string()), "{}", refusal.message);
    refusal.message
}

/// A campaign cuts off half a line; who only reads leaves it where it is.
#[test]
fn half_a_line_at_the_end_is_left_out_and_nothing_is_changed() {
    let cut = made("cut", TEXT, &[], 2_000.0);
    let path = cut.0.join("results.jsonl");
    let whole = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() - 9]).unwrap();
    let before = files(&cut.0);
    let comparison = compared(&cut, &cut);
    assert_eq!((comparison.first.done, comparison.first.planned, comparison.exit_code), (119, 120, 0));
    assert_eq!(files(&cut.0), before);
    // A station of which half a line is there was cut off, and nobody judges its faults.
    let path = cut.0.join("stations.jsonl");
    let whole = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() - 9]).unwrap();
    assert!(refused(&cut.0).contains("no fault of it is through"));
}

#[test]
fn what_is_no_folder_of_results_is_refused_and_says_why() {
    let good = made("refused", TEXT, &[], 2_000.0);
    assert!(refused(&good.0.join("nowhere")).contains("give the folder of a campaign's results"));
    assert!(refused(&good.0.join("plan.json")).contains("it is no folder"));
    let empty = good.0.join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(refused(&empty).contains("plan.json: "));
    let path = good.0.join("results.jsonl");
    let whole = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{{}}\n{whole}")).unwrap();
    assert!(refused(&good.0).contains("results.jsonl, line 1: "));
    std::fs::remove_file(&path).unwrap();
    assert!(refused(&good.0).contains("no fault of it is through"));
    std::fs::create_dir(&path).unwrap();
    assert!(refused(&good.0).contains("results.jsonl: it is no file"));
    std::fs::remove_dir(&path).unwrap();
    std::fs::write(&path, &whole).unwrap();
    let plan = std::fs::read_to_string(good.0.join("plan.json")).unwrap();
    std::fs::write(good.0.join("plan.json"), &plan[..90]).unwrap();
    assert!(refused(&good.0).contains("plan.json: "));
    std::fs::write(good.0.join("plan.json"), &plan).unwrap();
    let reader = std::fs::File::open(&good.0).unwrap();
    reader.try_lock_shared().unwrap(); // another one who reads
    assert_eq!(read(&good).outcomes.len(), 120);
    drop(reader);
    let at_work = std::fs::File::open(&good.0).unwrap();
    at_work.lock().unwrap(); // as a campaign has it
    assert!(refused(&good.0).contains("a campaign is at work in it"));
}

/// Builds before this one kept no copy of the campaign's file.
#[test]
fn results_without_the_campaigns_file_take_it_from_the_command_line_and_no_other() {
    let old = made("old", TEXT, &[], 2_000.0);
    let copy = old.0.join("t.toml");
    let elsewhere = std::env::temp_dir().join(format!("hystation-compare-file-{}.toml", std::process::id()));
    std::fs::rename(&copy, &elsewhere).unwrap();
    assert!(refused(&old.0).contains("--file FILE"));
    assert_eq!(results::read(&old.0, std::slice::from_ref(&elsewhere)).unwrap().campaign.cells.len(), 2);
    std::fs::write(&elsewhere, format!("{TEXT}# another\n")).unwrap();
    assert!(results::read(&old.0, std::slice::from_ref(&elsewhere)).unwrap_err().message.contains("--file FILE"));
    std::fs::remove_file(&elsewhere).unwrap();
    let gone = results::read(&old.0, std::slice::from_ref(&elsewhere)).unwrap_err();
    assert!(gone.code == 2 && gone.message.starts_with("--file "), "{}", gone.message);
    // Whatever it is called there, as in the results that lie with the documents.
    std::fs::write(old.0.join("kills.toml"), TEXT).unwrap();
    assert_eq!(read(&old).campaign.name, "t");
}

#[test]
fn the_handbook_has_each_column_and_each_key_of_a_comparison() {
    let handbook = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/handbook.md")).unwrap();
    let (_, section) = handbook.split_once("#### Two campaigns").unwrap();
    let (section, _) = section.split_once("### What a campaign says").unwrap();
    let folder = made("keys", TEXT, &[], 2_000.0);
    let comparison = compared(&folder, &folder);
    let json = serde_json::to_value(&comparison).unwrap();
    let row = &json["cells"][0];
    let objects = [&json, &json["first"], row, &row["first"], &row["difference"]];
    for key in objects.iter().flat_map(|object| object.as_object().unwrap().keys()) {
        assert!(section.contains(&format!("`{key}`")), "{key} is not in the handbook");
    }
    let text = table::text(&comparison);
    let head = text.lines().find(|line| line.starts_with("pool or cell")).unwrap();
    for column in ["excess 1", "difference", "found 1", "recovered 2", "ratio", "step/N"] {
        assert!(head.contains(column) && section.contains(&format!("`{column}`")), "{column}: {head}");
    }
}
