//! A campaign as a tester runs it: the plan is the same for the same seed, a batch goes on where the one before ended, the reports can be
//! read by what reads such reports, one fault can be repeated, a promise that is broken ends with code 1, and what cannot be is refused.

#[path = "campaign/killed.rs"]
mod killed;
#[path = "campaign/repeated.rs"]
mod repeated;

use serde_json::Value;
use station_tests::{Folder, binaries, hystation, run, wait_for};
use std::time::{Duration, Instant};

/// A kill of the device costs misses; a limit of 0 without the 20 ms that it may cost must break, for which the interval needs six faults. The
/// others are judged in a pool that nothing can break.
const CAMPAIGN: &str = r#"
seed = 5
gap_ticks = [450, 600]
limit_upper95 = 1.0
most_void = 1.0
faults_per_station = 8

[[pool]]
name = "engines"
limit_upper95 = 1.0

[[cell]]
kinds = ["kill"]
targets = ["haptic:active", "collision-worker:0"]
count = 3
pool = "engines"

[[cell]]
kinds = ["kill"]
targets = ["haptic:spare"]
states = ["recovery"]
count = 1
pool = "engines"

[[cell]]
kinds = ["kill"]
targets = ["device"]
count = 8
allowed_misses = 0
limit_upper95 = 0.0
"#;

fn campaign(arguments: &[&str]) -> (Option<i32>, String, String) {
    let name = format!("campaign-{}", std::process::id());
    run(hystation().args(["--name", &name, "fault", "campaign"]).args(arguments))
}

fn results(folder: &Folder) -> Vec<Value> {
    folder.read("out/results.jsonl").lines().map(|line| serde_json::from_str(line).expect("a line of JSON")).collect()
}

/// What is left of a station of this name.
fn left() -> Option<String> {
    let station = hyst_exchange::Station::named(&format!("campaign-{}", std::process::id())).expect("a name");
    station.leftovers().first().map(|path| path.display().to_string())
}

/// Nothing of a station of this name is left.
fn assert_nothing_left() {
    assert_eq!(wait_for(Duration::from_secs(10), || left().is_none().then_some(())), Some(()), "left over: {:?}", left());
}

#[test]
fn a_campaign_goes_on_in_batches_and_its_verdict_can_fail() {
    let folder = Folder::new("campaign-batches");
    let (file, out) = (folder.write("kills.toml", CAMPAIGN), folder.path("out"));

    let (code, first, said) = campaign(&[&file, "--report", &out, "--batch", "5"]);
    assert_eq!(results(&folder).len(), 5, "{first}\n{said}");
    // Unless the host stalled so much that none of them has a verdict.
    let is_silent = first.contains("faults of this batch has a verdict");
    assert!(matches!(code, Some(0 | 1)) || is_silent, "{code:?}\n{first}\n{said}");
    let (plan, _) = first.split_once("\n     0/15").unwrap_or_else(|| panic!("the plan comes first:\n{first}"));
    assert!(plan.contains("15 faults in 2 stations"), "{plan}");

    let (code, second, said) = campaign(&[&file, "--report", &out]);
    assert!(second.starts_with(plan), "the same seed, the same plan:\n{second}");
    let all = results(&folder);
    let mut indices: Vec<u64> = all.iter().filter_map(|result| result["index"].as_u64()).collect();
    indices.sort_unstable();
    assert_eq!(indices, (0..15).collect::<Vec<u64>>(), "each fault once\n{second}\n{said}");
    assert_eq!(code, Some(1), "the device's misses break a limit of 0\n{second}\n{said}");

    let report: Value = serde_json::from_str(&folder.read("out/report.json")).expect("JSON");
    let cell = |name: &str| {
        let cells = report["cells"].as_array().expect("cells");
        cells.iter().find(|cell| cell["name"] == name).unwrap_or_else(|| panic!("no cell {name}: {report:#}")).clone()
    };
    let device = cell("kill device");
    assert_eq!(device["verdict"], "broken", "{device:#}");
    assert!(device["injected"].as_u64() >= Some(6) && device["excess"]["lower95"].as_f64() > Some(0.0), "{device:#}");
    let haptic = cell("kill haptic:active");
    assert_eq!((haptic["injected"].as_u64(), haptic["manifested"].as_u64()), (Some(3), Some(3)), "{haptic:#}");
    assert!(haptic["recovered_ms"].as_array().is_some_and(|times| times.len() == 3), "{haptic:#}");
    let second_fault =
        all.iter().find(|result| result["cell"] == "kill haptic:spare in recovery").expect("the fault in a recovery");
    let (own, other) = (&second_fault["fault"], &second_fault["with"]);
    assert!(own["injected_ns"].as_u64() > other["injected_ns"].as_u64(), "{second_fault:#}");
    assert!(other["target"].as_str().is_some_and(|name| name.starts_with("tissue:")), "{other:#}");

    let junit = folder.read("out/junit.xml");
    assert_eq!(
        junit.matches("<testcase ").count(),
        report["cells"].as_array().map_or(0, Vec::len) + 2,
        "cells, a pool, the stations"
    );
    assert!(junit.contains("<failure message="), "{junit}");
    let page = folder.read("out/report.html");
    assert!(page.matches("<svg").count() >= 5 && page.matches("<svg").count() == page.matches("</svg>").count());
    assert!(!page.contains("NaN") && !page.contains("http"), "whole figures, and nothing from elsewhere");
    assert!(["BROKEN", "what to do next"].iter().all(|words| folder.read("out/report.txt").contains(*words)));

    let (code, third, said) = campaign(&[&file, "--report", &out]);
    assert_eq!((code, results(&folder).len()), (Some(1), 15), "what is through is only judged again\n{third}\n{said}");
    assert_eq!(folder.read("out/kills.toml"), CAMPAIGN, "by which anybody can judge them");
    let before = [folder.read("out/results.jsonl"), folder.read("out/stations.jsonl"), folder.read("out/report.json")];
    let (code, compared, said) = run(hystation().args(["fault", "compare", &out, &out]));
    let said_of_both =
        ["both are of one file, seed, build, machine and day", "nothing can be told: no difference is beyond doubt"];
    assert!(code == Some(0) && said_of_both.iter().all(|words| compared.contains(words)), "{code:?} {compared}{said}");
    let after = [folder.read("out/results.jsonl"), folder.read("out/stations.jsonl"), folder.read("out/report.json")];
    assert_eq!(after, before, "who compares changes nothing");
    let (code, _, said) = run(hystation().args(["fault", "compare", &out, &folder.path("nowhere")]));
    assert!(code == Some(2) && said.contains("give the folder of a campaign's results"), "{code:?} {said}");
    let (code, _, said) = campaign(&[&file, "--report", &out, "--seed", "6"]);
    assert!(code == Some(2) && said.contains("another seed"), "{code:?}: {said}");
    assert_nothing_left();
}

/// The station goes on without its guardian, or without both keepers, until the same command has taken it over; two that are hit at once are one fault.
#[test]
fn those_who_keep_the_station_and_two_at_once_are_hurt_too() {
    let folder = Folder::new("campaign-keepers");
    let text = "gap_ticks = [450, 500]\nlimit_upper95 = 1.0\nmost_void = 1.0\n\
                [[cell]]\nkinds = [\"kill\"]\ntargets = [\"guardian\", \"supervisor+guardian\", \"supervisor\", \"tissue:both\"]\ncount = 1\n\
                [[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"fluid\"]\nwhere = \"checkpoint\"\ncount = 1\n\
                [[cell]]\nkinds = [\"crash-loop\"]\ntargets = [\"recorder\"]\ntimes = 1\ncount = 1\n";
    let (file, out) = (folder.write("keepers.toml", text), folder.path("out"));
    let (code, printed, said) = campaign(&[&file, "--report", &out]);
    let all = results(&folder);
    assert_eq!(all.len(), 6, "{code:?}\n{printed}\n{said}");
    for result in &all {
        assert_eq!(result["ending"], "closed", "{result:#}\n{said}");
        let fault = &result["fault"];
        assert!(fault["manifested"] == true && fault["recovered_us"].is_number(), "{result:#}\n{said}");
        println!("{}: {} of {}, found by {}", result["cell"], fault["kind"], fault["target"], fault["detected_by"]);
    }
    let stations = folder.read("out/stations.jsonl");
    assert_eq!(stations.lines().count(), 1, "one station had them all: {stations}\n{said}");
    assert_nothing_left();
}

/// Two arms side by side: the engines as they are, and the same with one that has a defect, `bad.ENGINE.DEFECT`. Gives what was broken, in words: nothing
/// that is not in the arm with the defect.
fn broken_by(engine: &str, defect: &str, cell: &str, count: u64) -> Vec<String> {
    let name = format!("bad.{engine}.{defect}");
    let folder = Folder::new(&format!("campaign-{defect}"));
    let planted = folder.as_path().join(&name);
    std::fs::create_dir(&planted).expect("a folder");
    for each in ["hardware", "device", "haptic", "tissue", "collision-worker", "fluid", "rendering", "recorder", "console"] {
        let real = binaries().join(if each == engine { "bad-engine" } else { each });
        std::os::unix::fs::symlink(real, planted.join(each)).expect("a link");
    }
    let text = format!(
        "gap_ticks = [900, 1000]\nmost_void = 1.0\n\
         [[arm]]\nname = \"as built\"\n[[arm]]\nname = \"planted\"\nbinaries = \"{name}\"\n\
         [[cell]]\n{cell}\ncount = {count}\n"
    );
    let (file, out) = (folder.write("planted.toml", &text), folder.path("out"));
    let (code, printed, said) = campaign(&[&file, "--report", &out]);
    let report: Value = serde_json::from_str(&folder.read("out/report.json")).expect("JSON");
    println!("{}", report["broken"]);
    assert_eq!(code, Some(1), "{printed}\n{said}");
    let broken: Vec<&str> = report["broken"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    assert!(!broken.is_empty() && broken.iter().all(|text| text.starts_with("arm planted, ")), "{broken:?}\n{said}");
    let cells = report["cells"].as_array().expect("cells");
    assert!(!cells.is_empty() && cells.iter().all(|cell| cell["manifested"] == count), "{cells:#?}");
    assert_nothing_left();
    broken.into_iter().map(str::to_string).collect()
}

/// A fluid that takes the role without the state of the one before: no force and no process shows that; the millilitres that are not there any more do.
#[test]
fn a_planted_defect_is_found_and_only_where_it_is() {
    let broken = broken_by("fluid", "anew", "kinds = [\"kill\"]\ntargets = [\"fluid:active\"]", 3);
    assert!(broken.iter().all(|text| text.contains("run ") && text.contains("the deficit jumped")), "{broken:?}");
}

/// A device that takes contact models of an epoch that is over, as long as their tick is new: a tissue that publishes under such an epoch is believed.
#[test]
fn an_engine_that_accepts_stale_epochs_is_found_and_only_where_it_is() {
    let cell = "kinds = [\"epoch\"]\ntargets = [\"tissue:active\"]\nfor = 2.0";
    // Its spare takes the role within a tick or two: one of them need not meet a tick of the device.
    let broken = broken_by("device", "unfenced", cell, 6);
    let is_stale = |text: &String| text.contains("ticks used a contact model older than that of the tick before");
    assert!(broken.iter().any(is_stale), "{broken:?}");
}

/// A recorder that drops ticks and does not say so: its file is whole, and every block of it is sound.
#[test]
fn a_recorder_that_drops_ticks_in_silence_is_found_and_only_where_it_is() {
    let broken = broken_by("recorder", "holes", "kinds = [\"kill\"]\ntargets = [\"collision-worker:0\"]", 3);
    assert!(broken.iter().all(|text| text.contains("ticks are not in its recording, and it does not say so")), "{broken:?}");
}

/// The line of its terminal is cut before the batch is through: that is no verdict, what it came to is written, and the same command goes on.
#[test]
fn a_campaign_that_is_interrupted_ends_with_code_3() {
    let folder = Folder::new("campaign-interrupted");
    let text = "gap_ticks = [450, 500]\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"recorder\"]\ncount = 40\n";
    let (file, out) = (folder.write("long.toml", text), folder.path("out"));
    let name = format!("campaign-{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &name, "fault", "campaign", &file, "--report", &out, "--batch", "30"]);
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let mut child = command.spawn().expect("a campaign");
    let first = || folder.as_path().join("out/results.jsonl").exists().then_some(());
    assert_eq!(wait_for(Duration::from_secs(120), first), Some(()), "no fault came about");
    drop(child.stderr.take()); // nobody takes its words any more
    let _ = std::process::Command::new("kill").args(["-HUP", &child.id().to_string()]).status().expect("kill");
    let ended = child.wait_with_output().expect("its end");
    let said = String::from_utf8_lossy(&ended.stdout).into_owned();
    assert_eq!(ended.status.code(), Some(3), "{said}");
    assert!(said.contains("faults of this run are left, and the same command goes on"), "{said}");
    assert!(
        folder.read("out/report.txt").contains("faults of this run are left")
            && folder.read("out/stations.jsonl").lines().count() == 1
    );
    assert_nothing_left();
}

/// Ctrl-C comes while the campaign waits for the stand-in, so that the `hystation run` it starts then is asked to end in its first millisecond, when it catches
/// no signals yet: 13 processes stayed.
#[test]
fn a_campaign_that_is_interrupted_right_after_it_killed_a_guardian_leaves_nothing() {
    let folder = Folder::new("campaign-orphans");
    let text = "gap_ticks = [450, 500]\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"guardian\"]\ncount = 9\n";
    let (file, out) = (folder.write("guardians.toml", text), folder.path("out"));
    let name = format!("campaign-{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &name, "fault", "campaign", &file, "--report", &out]);
    let child = command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().expect("a campaign");
    let list = format!("/proc/{0}/task/{0}/children", child.id());
    let runs = || std::fs::read_to_string(&list).unwrap_or_default();
    let first = wait_for(Duration::from_secs(120), || Some(runs()).filter(|runs| !runs.is_empty())).expect("a station");
    // Without a pause between two looks: the next one is there within milliseconds.
    let end = Instant::now() + Duration::from_secs(120);
    let killed = std::iter::repeat_with(runs).take_while(|_| Instant::now() < end).any(|runs| runs != first);
    let _ = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    let ended = child.wait_with_output().expect("its end");
    let said = String::from_utf8_lossy(&ended.stdout).into_owned() + &String::from_utf8_lossy(&ended.stderr);
    assert!(killed, "no guardian was killed: {said}");
    assert_eq!(ended.status.code(), Some(3), "{said}");
    assert_nothing_left();
    let (code, _, said) = run(hystation().args(["--name", &name, "status"]));
    assert_ne!(code, Some(0), "somebody answers: {said}");
}

#[test]
fn a_campaign_that_cannot_be_is_refused_before_anything_starts() {
    let folder = Folder::new("campaign-refused");
    for (text, words) in [
        ("", "injects nothing"),
        ("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:7\"]\ncount = 1\n", "haptic:7"),
        ("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"collision-worker:9\"]\ncount = 1\n", "collision-worker:0"),
        ("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\nstates = [\"cutting\"]\ncount = 1\n", "cuts nothing"),
        ("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\ncount = -1\n", "count"),
        ("[[cell]]\nkinds = [\"undo\"]\ntargets = [\"tissue\"]\ncount = 1\n", "nothing is"),
        ("[station]\nbinaries = \".\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\ncount = 1\n", "no hardware there"),
        ("[station]\nscene = \"bad.toml\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\ncount = 1\n", "bad.toml"),
        ("[station]\nhand = \"script:stir\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\ncount = 1\n", "no such hand"),
        ("[station]\nhand = \"stir\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\ncount = 1\n", "--hand stir"),
    ] {
        let file = folder.write("bad.toml", text);
        let (code, printed, said) = campaign(&[&file, "--report", &folder.path("out")]);
        assert!(code == Some(2) && printed.is_empty() && said.contains(words), "{code:?} {printed}{said}");
    }
    // A case's own hand may be asked to cut if it does, whatever it is called.
    let case = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/cases/septum.toml");
    for (hand, expected) in [("script:divide", Some(0)), ("script:press", Some(2))] {
        let text = format!(
            "[station]\nscene = {case:?}\nhand = \"{hand}\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\nstates = [\"cutting\"]\n\
             count = 1\n"
        );
        let (code, printed, said) = campaign(&[&folder.write("case.toml", &text), "--plan"]);
        assert_eq!((code, said.contains("cuts nothing")), (expected, expected == Some(2)), "{hand}: {printed}{said}");
    }
    assert!(!folder.as_path().join("out").exists(), "nothing was made");
    // A plan of which nothing came does not stand in the way of the corrected file.
    let plan = |count: u32| {
        let text = format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue\"]\ncount = {count}\n");
        let file = folder.write("good.toml", &text);
        campaign(&[&file, "--report", &folder.path("out"), "--batch", "0"])
    };
    for count in [1, 2] {
        let (code, printed, said) = plan(count);
        assert!(code != Some(2) && folder.as_path().join("out/plan.json").exists(), "{code:?} {printed}{said}");
    }
    let (code, _, said) = campaign(&[&folder.path("missing.toml")]);
    assert!(code == Some(2) && said.contains("missing.toml"), "{code:?} {said}");
    assert_nothing_left();
}

/// The plan of faults that fill a disk was shown without a word, and the same command without --plan refused.
#[test]
fn a_plan_says_what_its_run_would_be_refused_for() {
    let folder = Folder::new("campaign-room");
    let text = "[[cell]]\nkinds = [\"disk-full\"]\ntargets = [\"recorder\"]\ncount = 1\nfor = 1.0\n";
    let (file, out) = (folder.write("full.toml", text), folder.path("out"));
    let (planned, plan, warned) = campaign(&[&file, "--report", &out, "--plan"]);
    assert!(planned == Some(0) && plan.contains("disk-full recorder"), "{planned:?} {plan}{warned}");
    assert!(!folder.as_path().join("out").exists(), "nothing was made");
    // Refused unless the disk of this test is a small one.
    let (code, _, refused) = campaign(&[&file, "--report", &out, "--batch", "0"]);
    assert_eq!(warned.contains("it would be refused: campaign full: cell disk-full"), code == Some(2), "{warned}{refused}");
    assert_nothing_left();
}
