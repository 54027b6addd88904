//! A loose piece in a whole station, on the virtual clock: the hand closes the jaws on it and draws it out, once, whoever dies while they hold it.

use serde_json::Value;
use station_tests::{Folder, hystation, run};
use std::path::Path;

const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker";
/// Virtual times, ms: the jaws have closed, the piece is nearly out, and the hand is through.
const HELD_MS: u64 = 5_700;
const NEARLY_OUT_MS: u64 = 7_700;
const THROUGH_MS: u64 = 10_000;

/// Runs the hand that fetches the piece so long, and gives its report.
fn fetched(name: &str, time_ms: u64, faults: &str) -> Value {
    let folder = Folder::new(&format!("grasp-{name}"));
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/grasper.toml");
    let (report, file) = (folder.path("report.json"), folder.write("faults.toml", faults));
    let (station, time) = (format!("g{}-{name}", std::process::id()), format!("{time_ms}ms"));
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--hand", "script:fetch", "--roles", ROLES]).arg(scene);
    command.args(["--for", &time, "--test-mode", "--faults", &file, "--report", &report]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{name}: {said}");
    serde_json::from_str(&folder.read("report.json")).unwrap()
}

#[test]
fn a_piece_is_drawn_out_in_the_jaws_once_whoever_dies_while_they_hold_it() {
    let before = fetched("before", NEARLY_OUT_MS, "");
    assert_eq!((before["taken_out"].as_u64(), before["removed_volume_ml"].as_f64()), (Some(0), Some(0.0)), "it is on its way");
    let moments = (HELD_MS..=NEARLY_OUT_MS).step_by(400).zip(["tissue:active", "tissue:spare", "haptic:active"].iter().cycle());
    let faults: String =
        moments.map(|(tick, target)| format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n")).collect();
    let [quiet, hurt] = [("quiet", ""), ("hurt", &faults)].map(|(name, faults)| fetched(name, THROUGH_MS, faults));
    let ml = |key: &str| quiet[key].as_f64().unwrap();
    assert_eq!((quiet["taken_out"].as_u64(), quiet["washed_out"].as_u64()), (Some(1), Some(0)), "{quiet}");
    assert!(ml("taken_out_ml") > 0.05 && (ml("taken_out_ml") - ml("removed_volume_ml")).abs() < 1e-6, "{quiet}");
    assert_eq!(hurt["faults"].as_array().unwrap().len(), 6);
    for key in [
        "taken_out",
        "taken_out_ml",
        "removed_volume_ml",
        "state_hash",
        "force_trace_hash",
        "fluid_state_hash",
        "fluid_deficit_ml",
    ] {
        assert_eq!(quiet[key], hurt[key], "{key}");
    }
}
