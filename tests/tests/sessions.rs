//! A session from its start to its report: the hand that resects the polyp is recorded, and the report says what it did, and what its case says of it.

use serde_json::Value;
use station_tests::{Folder, hystation, run};

/// Virtual time of one whole resection.
const ROUND: &str = "16s";
const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker,recorder";

/// Ticks that the device may not have made: even a virtual clock goes on without who is not let run for its whole patience.
const MOST_UNMADE: u64 = 3;

/// A metric's raw value.
fn value(report: &Value, key: &str) -> f64 {
    let metrics = report["metrics"].as_array().unwrap();
    let metric = metrics.iter().find(|metric| metric["key"] == key).unwrap_or_else(|| panic!("no {key}"));
    metric["value"].as_f64().unwrap_or_else(|| panic!("{key}: {metric}"))
}

#[test]
fn a_scripted_trainee_resects_the_polyp_and_the_report_says_so() {
    let folder = Folder::new("session-report");
    let [ledger, session, page] = ["run.json", "session.mcap", "session.html"].map(|name| folder.path(name));
    let station = format!("r{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--hand", "script:polyp", "--roles", ROLES]);
    command.args(["--for", ROUND, "--record", &session, "--report", &ledger]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{said}");
    let ledger: Value = serde_json::from_str(&folder.read("run.json")).unwrap();

    let (code, first, said) = run(hystation().args(["report", &session, "--html", &page, "--json", "-"]));
    assert_eq!(code, Some(0), "{said}");
    let report: Value = serde_json::from_str(&first).unwrap();
    assert_eq!(report["is_whole"], true, "{report}");
    assert!(report["station"]["missing"].as_u64() <= Some(MOST_UNMADE), "{}", report["station"]);
    let cuts = ledger["cuts"].as_f64().unwrap();
    assert!((10.0..=cuts).contains(&value(&report, "cuts")), "{} of {cuts} cuts", value(&report, "cuts"));
    assert!(value(&report, "removed") > 0.0 && value(&report, "energised") > 0.0);
    assert!((0.1..=100.0).contains(&value(&report, "pathology")), "percent, without a case: {}", value(&report, "pathology"));
    assert!(value(&report, "path") > 0.01 && value(&report, "time") > 10.0);
    // The way is found so that the shaft touches nothing; what was cut off has sunk from it.
    assert!((0.0..0.1).contains(&value(&report, "force_peak")), "{} N", value(&report, "force_peak"));
    assert!(value(&report, "pressure_peak") > 35.0 && value(&report, "inflow") > 0.0);
    assert!((0.0..=100.0).contains(&value(&report, "clear_view")) && value(&report, "transmittance") > 0.0, "{report}");
    let healthy_ml = ledger["healthy_removed_ml"].as_f64().unwrap();
    assert!((0.0..=healthy_ml).contains(&value(&report, "healthy_removed")), "of {healthy_ml} ml: {report}");
    for group in ["Visualisation", "Ergonomics", "Safety", "Fluid handling"] {
        assert!(report["groups"][group].as_f64().is_some_and(|score| (0.0..=100.0).contains(&score)), "{group}: {report}");
    }
    assert_eq!(folder.read("session.html").matches("class=\"curve ").count(), 6);
    let (_, second, _) = run(hystation().args(["report", &session, "--json", "-"]));
    assert!(first == second, "not the same bytes");
}

/// The polyp case of the assets, with other lines and in a scene that lies here.
fn polyp_case(scene: &str, changes: &[(&str, &str)]) -> String {
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let mut text = std::fs::read_to_string(assets.join("cases/polyp.toml")).unwrap();
    for (from, to) in changes.iter().chain(&[("../scenes/default.toml", scene)]) {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

/// Who holds the role after the second has loaded the case anew.
const KILLS: &str = "[[fault]]\nkind = \"kill\"\ntarget = \"tissue:active\"\ntick = 3000\n\
                     [[fault]]\nkind = \"kill\"\ntarget = \"tissue:active\"\ntick = 7000\n";

/// The trainee has a time that ends in the recording, an engine dies on the way and loads the case again, and case and scene are gone before the replay.
#[test]
fn a_scripted_trainee_does_the_polyp_case_from_start_to_report() {
    let folder = Folder::new("session-case");
    let (scene, changes) =
        (folder.scene(), [("time_s = 900.0", "time_s = 13.0"), ("time_above_s = 720.0", "time_above_s = 12.0")]);
    let case = folder.write("case.toml", &polyp_case(&scene, &changes));
    let faults = folder.write("faults.toml", KILLS);
    let [session, page] = ["session.mcap", "session.html"].map(|name| folder.path(name));
    let station = format!("c{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "run", &case, "--set", "seed=2", "--headless", "--lockstep", "--hand", "script:polyp"]);
    command.args(["--roles", ROLES, "--for", ROUND, "--record", &session, "--test-mode", "--faults", &faults]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("polyp: ") && said.contains("as stiff as the scene has it"), "what was drawn is said: {said}");
    std::fs::write(&case, "no case any more").unwrap();
    std::fs::remove_file(&scene).unwrap();

    let (code, first, said) = run(hystation().args(["report", &session, "--html", &page, "--json", "-"]));
    assert_eq!(code, Some(0), "{said}");
    let report: Value = serde_json::from_str(&first).unwrap();
    let judged = &report["case"];
    assert_eq!((judged["name"].as_str(), judged["seed"].as_u64()), (Some("Resection of a polyp"), Some(2)), "{judged}");
    let state = |goal: usize| judged["goals"][goal]["state"].as_str().unwrap();
    assert_eq!([state(0), state(1), state(2)], ["reached", "reached", "open"], "{judged}");
    let (seen_s, cut_s) = (judged["goals"][0]["at_s"].as_f64().unwrap(), judged["goals"][1]["at_s"].as_f64().unwrap());
    assert!(0.0 < seen_s && seen_s < cut_s && cut_s < 14.0, "{judged}");
    let removed_percent = value(&report, "pathology");
    assert!((1.0..20.0).contains(&removed_percent), "{removed_percent} % with one chip");
    assert_eq!((judged["ended"]["by"].as_str(), judged["ended"]["after_s"].as_f64()), (Some("time"), Some(13.0)), "{judged}");
    // Its script rests for a second, and moves then.
    let began_s = judged["began_s"].as_f64().unwrap_or_else(|| panic!("{judged}"));
    let is_since_begin = |at_s: &Value, s: f64| at_s.as_f64().is_some_and(|at_s| (at_s - began_s - s).abs() < 1e-9);
    assert!(began_s < 2.9 && is_since_begin(&judged["ended"]["at_s"], 13.0), "{judged}");
    let late = judged["warnings"].as_array().unwrap().iter().find(|warning| warning["words"] == "12 minutes are over").unwrap();
    assert!(late["count"] == 1 && is_since_begin(&late["at_s"][0], 12.001), "{judged}");
    assert!((value(&report, "time") - 13.001).abs() < 1e-9, "what comes after the end counts for nothing");
    assert_eq!(report["metrics"].as_array().unwrap().iter().find(|metric| metric["key"] == "pathology").unwrap()["weight"], 4.0);
    assert!(report["groups"]["Task"].as_f64().is_some_and(|score| (0.0..100.0).contains(&score)), "{}", report["groups"]);
    let page = folder.read("session.html");
    assert!(page.contains("<h2>Case: Resection of a polyp</h2>") && page.contains("the time was over"), "{page}");

    let (code, said, complained) = run(hystation().args(["--name", &format!("{station}v"), "replay", &session, "--verify"]));
    assert_eq!(code, Some(0), "{said}{complained}");
    assert!(said.contains("the same to the bit"), "{said}");
    let mut other = hystation();
    let (code, _, complained) = run(other.args(["--name", &station, "replay", &session, "--verify", "--set", "seed=3"]));
    assert!(code == Some(2) && complained.contains("another scene"), "another anatomy: {complained}");
}
