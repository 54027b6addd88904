//! A campaign that is killed in the middle of a station: the station ends with it, what it suffered is no result, and comes again.

use super::{assert_nothing_left, campaign, left, results};
use serde_json::Value;
use station_tests::{Folder, RECOVERY_LIMIT, START_LIMIT, hystation, wait_for};
use std::process::Stdio;

/// The station went on by itself for half an hour, and what it had suffered counted as if nothing had been wrong with it.
#[test]
fn the_station_of_a_campaign_that_is_killed_ends_with_it_and_its_faults_come_again() {
    let folder = Folder::new("campaign-killed");
    let text = "gap_ticks = [450, 500]\nlimit_upper95 = 1.0\nmost_void = 1.0\n\
                [[cell]]\nkinds = [\"kill\"]\ntargets = [\"recorder\"]\ncount = 20\n";
    let (file, out) = (folder.write("killed.toml", text), folder.path("out"));
    let name = format!("campaign-{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &name, "fault", "campaign", &file, "--report", &out]);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a campaign");
    let first = || std::fs::metadata(folder.path("out/results.jsonl")).is_ok_and(|file| file.len() > 0).then_some(());
    let has_come = wait_for(START_LIMIT, first);
    let _ = child.kill(); // SIGKILL: it writes nothing more
    let _ = child.wait();
    assert_eq!(has_come, Some(()), "no fault came about");
    assert_eq!(wait_for(RECOVERY_LIMIT, || left().is_none().then_some(())), Some(()), "it goes on: {:?}", left());
    let lines = |file: &str| std::fs::read_to_string(folder.path(file)).unwrap_or_default().matches('\n').count();
    let (cut, ended) = (lines("out/results.jsonl"), lines("out/stations.jsonl"));
    assert!(
        cut > 0 && lines("out/begun.jsonl") == ended + 1,
        "{cut} faults of a station that was cut off, {ended} stations that ended before"
    );

    let judged = || {
        let (code, printed, said) = campaign(&[&file, "--report", &out, "--batch", "0"]);
        assert_ne!(code, Some(2), "{printed}\n{said}");
        let report: Value = serde_json::from_str(&folder.read("out/report.json")).expect("JSON");
        (report["done"].as_u64(), said)
    };
    let (through, said) = judged();
    assert!(through == Some(0) && said.contains("not through, although done: the station was cut off"), "{through:?} {said}");
    let (code, printed, said) = campaign(&[&file, "--report", &out, "--batch", "2"]);
    assert!(said.contains("not through, although done"), "{code:?} {printed}\n{said}");
    let again = results(&folder).split_off(cut);
    let indices: Vec<Option<u64>> = again.iter().map(|result| result["index"].as_u64()).collect();
    assert_eq!(indices, [Some(0), Some(1)], "the first came again\n{printed}\n{said}");
    assert!(again.iter().all(|result| result["run"].as_u64() >= Some(1)), "of another run: {again:#?}");
    assert_eq!(judged().0, Some(2), "those of the station that was cut off are no results");
    assert_nothing_left();
}
