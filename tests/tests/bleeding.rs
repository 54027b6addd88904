//! Bleeding in a whole station, on the virtual clock: what the electrode opens bleeds below the pressure of its vessels and not above it, whatever dies
//! meanwhile. The blood in the cavity makes room for itself: the pump lets in less, by which the deficit tells it.

use serde_json::Value;
use station_tests::{Folder, hystation, run};
use std::path::PathBuf;

/// Virtual time of a run: the hand has cut for some seconds.
const FOR: &str = "10s";
const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker";
/// Flow of the widest vessel, ml/(s·Pa): twenty times the usual, so that a short run shows it.
const WIDE: f64 = 2e-4;
/// Pressure that a scripted hand sets before it cuts, Pa: above that of arteries.
const HIGH_PA: f64 = 16_000.0;

/// The default scene with vessels of this pressure and conductance, and what the hand does with the pump.
fn scene(folder: &Folder, vessel_pa: f64, conductance_ml_s_pa: f64, change: &str) -> String {
    let scenes = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes");
    let meshes = scenes.join("../meshes");
    let text = std::fs::read_to_string(scenes.join("default.toml")).unwrap().replace("../meshes", meshes.to_str().unwrap());
    let vessels = format!(
        "\n[vessels]\npressure_pa = {vessel_pa:.1}\nconductance_ml_s_pa = {conductance_ml_s_pa:e}\n\n[fluid]\n{change}\n"
    );
    assert!(text.contains("\n[fluid]\n") && !text.contains("[vessels]"));
    folder.write("scene.toml", &text.replace("\n[fluid]\n", &vessels))
}

/// Runs the resection and gives its report.
fn resection(name: &str, [vessel_pa, conductance_ml_s_pa]: [f64; 2], change: &str, faults: &str) -> Value {
    let folder = Folder::new(&format!("bleeding-{name}"));
    let (report, file) = (folder.as_path().join("report.json"), folder.write("faults.toml", faults));
    let scene = scene(&folder, vessel_pa, conductance_ml_s_pa, change);
    let mut command = hystation();
    command.args(["--name", &format!("b{}-{name}", std::process::id()), "run", "--headless", "--lockstep", &scene]);
    command.args(["--hand", "script:polyp", "--roles", ROLES, "--for", FOR, "--test-mode", "--faults", &file, "--report"]);
    let (code, _, said) = run(command.arg(&report));
    assert_eq!(code, Some(0), "{name}: {said}");
    let report: Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert!(report["cuts"].as_u64().unwrap() >= 3, "{name}: {report}");
    report
}

fn deficit_ml(report: &Value) -> f64 {
    report["fluid_deficit_ml"].as_f64().unwrap()
}

#[test]
fn a_cut_bleeds_below_the_pressure_of_its_vessels_and_a_kill_loses_none_of_it() {
    let dry = resection("dry", [12_000.0, 0.0], "", "");
    let bled = resection("bled", [12_000.0, WIDE], "", "");
    let bled_ml = deficit_ml(&dry) - deficit_ml(&bled);
    println!("deficit {} ml dry, {} ml bled", deficit_ml(&dry), deficit_ml(&bled));
    assert!((0.05..=50.0).contains(&bled_ml), "{bled_ml} ml");
    let [counted_ml, none_ml] = [&bled, &dry].map(|report| report["fluid_bled_ml"].as_f64().unwrap());
    assert!(none_ml == 0.0 && counted_ml >= bled_ml, "{counted_ml} ml of blood made room for {bled_ml} ml of medium");
    let weak = resection("weak", [1_000.0, WIDE], "", "");
    assert_eq!(deficit_ml(&weak).to_bits(), deficit_ml(&dry).to_bits(), "vessels weaker than the distension do not bleed");
    let targets = ["fluid:active", "tissue:active", "fluid:spare", "fluid:active"];
    let fault = |(index, target): (usize, &&str)| {
        let tick = 5_000 + 350 * index as u64;
        format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n")
    };
    let kills: String = targets.iter().cycle().take(12).enumerate().map(fault).collect();
    let hurt = resection("hurt", [12_000.0, WIDE], "", &kills);
    assert_eq!(hurt["faults"].as_array().unwrap().len(), 12);
    for key in ["cuts", "state_hash", "force_trace_hash", "fluid_state_hash", "fluid_deficit_ml", "fluid_bled_ml"] {
        assert_eq!(bled[key], hurt[key], "{key}");
    }
}

#[test]
fn a_hand_that_raises_the_pressure_in_time_stops_the_bleeding() {
    let change = format!("change = [{{ at_s = 0.0, set_pressure_pa = {HIGH_PA:.1}, inflow_valve = 1.0 }}]");
    let dry = resection("high-dry", [12_000.0, 0.0], &change, "");
    let open = resection("high", [12_000.0, WIDE], &change, "");
    assert_eq!(deficit_ml(&open).to_bits(), deficit_ml(&dry).to_bits());
    let low = resection("low", [12_000.0, 0.0], "", "");
    assert!(deficit_ml(&open) > deficit_ml(&low), "a higher pressure takes more medium");
}
