//! A session from its start to its report: the hand that resects the polyp is recorded, and the report says what it did.

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
    assert!(value(&report, "path") > 0.01 && value(&report, "time") > 10.0);
    // The way is found so that the shaft touches nothing; what was cut off has sunk from it.
    assert!((0.0..0.1).contains(&value(&report, "force_peak")), "{} N", value(&report, "force_peak"));
    assert!(value(&report, "pressure_peak") > 35.0 && value(&report, "inflow") > 0.0);
    for group in ["Visualisation", "Ergonomics", "Safety", "Fluid handling"] {
        assert!(report["groups"][group].as_f64().is_some_and(|score| (0.0..=100.0).contains(&score)), "{group}: {report}");
    }
    assert_eq!(folder.read("session.html").matches("class=\"curve ").count(), 5);
    let (_, second, _) = run(hystation().args(["report", &session, "--json", "-"]));
    assert!(first == second, "not the same bytes");
}
