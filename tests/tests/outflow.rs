//! A chip in a whole station, on the virtual clock: the hand that cut it off brings the outflow over it and opens the valve, the flow carries it there, and it
//! leaves, once, whoever dies on its way.

use serde_json::Value;
use station_tests::{Folder, hystation, run};
use std::path::PathBuf;

const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker";
/// Virtual times, ms: the chip has come free and is on its way, and the hand has rinsed.
const UNDER_WAY_MS: u64 = 8_500;
const NEARLY_THERE_MS: u64 = 9_200;
const RINSED_MS: u64 = 12_000;

/// Runs the resection so long, with other lines for the fluid, and gives its report.
fn resection(name: &str, time_ms: u64, change: &str, faults: &str) -> Value {
    let folder = Folder::new(&format!("outflow-{name}"));
    let scenes = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes");
    let text = std::fs::read_to_string(scenes.join("default.toml")).unwrap();
    let text = text.replace("../meshes", scenes.join("../meshes").to_str().unwrap());
    let scene = folder.write("scene.toml", &text.replace("\n[fluid]\n", &format!("\n[fluid]\n{change}\n")));
    let (report, file) = (folder.as_path().join("report.json"), folder.write("faults.toml", faults));
    let mut command = hystation();
    command.args(["--name", &format!("o{}-{name}", std::process::id()), "run", "--headless", "--lockstep", &scene]);
    command.args([
        "--hand",
        "script:polyp",
        "--roles",
        ROLES,
        "--for",
        &format!("{time_ms}ms"),
        "--test-mode",
        "--faults",
        &file,
    ]);
    let (code, _, said) = run(command.arg("--report").arg(&report));
    assert_eq!(code, Some(0), "{name}: {said}");
    let report: Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert!(report["cuts"].as_u64().unwrap() >= 3, "{name}: {report}");
    report
}

/// How many pieces have left through the outflow, and how much, and how much was removed, ml.
fn gone(report: &Value) -> (u64, f64, f64) {
    let ml = |key: &str| report[key].as_f64().unwrap();
    (report["washed_out"].as_u64().unwrap(), ml("washed_out_ml"), ml("removed_volume_ml"))
}

#[test]
fn a_chip_floats_to_the_outflow_and_leaves_once_whoever_dies_on_its_way() {
    let (left, _, removed_ml) = gone(&resection("before", NEARLY_THERE_MS, "", ""));
    assert!(left == 0 && removed_ml > 0.002, "it is to be on its way while somebody dies: {left} left, {removed_ml} ml removed");

    let targets = ["tissue:active", "fluid:active", "tissue:spare", "fluid:active", "tissue:active", "fluid:spare"];
    let all = (UNDER_WAY_MS..=NEARLY_THERE_MS).step_by(100).zip(targets.iter().cycle());
    let faults: String =
        all.map(|(tick, target)| format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n")).collect();
    let [quiet, hurt] = [("quiet", ""), ("hurt", &faults)].map(|(name, faults)| resection(name, RINSED_MS, "", faults));
    let (left, left_ml, removed_ml) = gone(&quiet);
    println!("{left} of {left_ml} ml left, {removed_ml} ml removed");
    assert_eq!(left, 1, "{quiet}");
    assert!(left_ml > 0.002 && left_ml <= removed_ml + 1e-6, "{left_ml} ml left, {removed_ml} ml were removed");
    assert_eq!(hurt["faults"].as_array().unwrap().len(), 8);
    for key in [
        "washed_out",
        "washed_out_ml",
        "removed_volume_ml",
        "cuts",
        "state_hash",
        "force_trace_hash",
        "fluid_state_hash",
        "fluid_deficit_ml",
    ] {
        assert_eq!(quiet[key], hurt[key], "{key}");
    }
}

#[test]
fn a_chip_stays_in_the_cavity_while_the_outflow_is_shut() {
    let shut = resection("shut", RINSED_MS, "change = [{ at_s = 0.0, outflow_valve = 0.0 }]", "");
    let (left, left_ml, removed_ml) = gone(&shut);
    assert!(left == 0 && left_ml == 0.0 && removed_ml > 0.002, "{left} left, {removed_ml} ml removed");
}
