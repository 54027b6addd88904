//! Bleeding in a whole station, on the virtual clock: what the electrode opens bleeds below the pressure of its vessels and not above it, whatever dies
//! meanwhile. The blood in the cavity makes room for itself: the pump lets in less, by which the deficit tells it. A loop that goes over the wound under the
//! current that coagulates staunches it, and takes no tissue away.

use hyst_recording::Recording;
use hyst_scene::Pose;
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

/// How long the loop takes from one end of the wound to the other, and how long it stays there first, s.
const OVER_S: f64 = 4.0;
const STAY_S: f64 = 0.6;
/// From when after that to when the bleeding is looked at, s.
const LOOK_S: [f64; 2] = [0.5, 3.5];

fn leg(to: &Pose, time_s: f64, electrode: &str) -> String {
    let [pitch, yaw, roll] = [to.pitch_rad, to.yaw_rad, to.roll_rad].map(|angle_rad| f64::from(angle_rad).to_degrees());
    let to = format!("pitch_deg = {pitch:?}, yaw_deg = {yaw:?}, roll_deg = {roll:?}, insertion_m = {:?}", to.insertion_m);
    format!("    {{ to = {{ {to} }}, time_s = {time_s:?}, loop = \"{electrode}\" }},\n")
}

/// A hand that cuts as `script:polyp` does, and then goes over the wound once and back with the loop used so; and when it has, s.
fn over_the_wound(electrode: &str) -> (String, f64) {
    let scene = hyst_scene::load_embedded().unwrap();
    let legs = &scene.hand("polyp").unwrap().legs;
    let last_cut = legs.iter().rposition(|leg| leg.is_energized).unwrap();
    let as_it_was = legs[..=last_cut].iter().map(|it| {
        let electrode = if it.is_energized { "cut" } else { "out" };
        leg(&it.to, it.time_s, if it.is_extended { electrode } else { "in" })
    });
    let (rest, bitten, drawn) = (&legs[0].to, &legs[last_cut - 1].to, &legs[last_cut].to);
    let own = [
        leg(drawn, STAY_S, "out"),
        leg(bitten, OVER_S, electrode),
        leg(drawn, OVER_S, electrode),
        leg(drawn, 2.0 * LOOK_S[1], "out"),
        leg(rest, 2.0, "in"),
    ];
    let all: String = as_it_was.chain(own).collect();
    let cut_s: f64 = legs[..=last_cut].iter().map(|leg| leg.time_s).sum();
    // The hand rests for its first second.
    (format!("\n[hand.staunch]\ntarget = \"polyp\"\nleg = [\n{all}]\n"), 1.0 + cut_s + STAY_S + 2.0 * OVER_S)
}

/// The report of a session in which the loop is used so on the wound, its recording, and the tick at which it has been over it.
fn staunching(name: &str, electrode: &str, faults: &str) -> (Value, Recording, u64) {
    let folder = Folder::new(&format!("staunching-{name}"));
    let (hand, done_s) = over_the_wound(electrode);
    let scene = scene(&folder, 12_000.0, WIDE, "");
    std::fs::write(&scene, std::fs::read_to_string(&scene).unwrap() + &hand).unwrap();
    let (report, recording, file) =
        (folder.as_path().join("report.json"), folder.path("session.mcap"), folder.write("faults.toml", faults));
    let (roles, length) = (format!("{ROLES},recorder"), format!("{}s", (done_s + LOOK_S[1]).ceil()));
    let mut command = hystation();
    // Not a name that `resection` takes: two tests of this file run at a time.
    command.args(["--name", &format!("w{}-{name}", std::process::id()), "run", "--headless", "--lockstep", &scene]);
    command.args(["--hand", "script:staunch", "--roles", &roles, "--for", &length, "--record", &recording]);
    command.args(["--test-mode", "--faults", &file, "--report"]);
    let (code, _, said) = run(command.arg(&report));
    assert_eq!(code, Some(0), "{name}: {said}");
    let report = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    (report, Recording::read(recording.as_ref()).unwrap(), (1e3 * done_s) as u64)
}

/// Blood that comes into the cavity from one tick to another, ml.
fn bled_between_ml(recording: &Recording, ticks: [u64; 2]) -> f64 {
    let [from_ml, to_ml] = ticks.map(|tick| {
        let until = recording.content.fluid.iter().filter(|status| status.state_tick <= tick);
        until.max_by_key(|status| status.state_tick).map_or(0.0, |status| status.bled_ml)
    });
    to_ml - from_ml
}

#[test]
fn a_loop_that_coagulates_staunches_the_wound_takes_no_tissue_and_a_kill_of_the_fluid_opens_nothing() {
    let (cold, bleeding, done_tick) = staunching("cold", "out", "");
    let (dry, staunched, _) = staunching("dry", "coagulate", "");
    let looked = LOOK_S.map(|after_s| done_tick + (1e3 * after_s) as u64);
    let began_tick = staunched.applied().iter().find(|record| record.sample.controls.coagulates()).expect("it coagulates").tick;
    let ml = |recording: &Recording| (bled_between_ml(recording, [0, began_tick]), bled_between_ml(recording, looked));
    let ((before_ml, cold_ml), (same_ml, dry_ml)) = (ml(&bleeding), ml(&staunched));
    println!("bled {before_ml} ml before; in 3 s after {cold_ml} ml from a cold loop, {dry_ml} ml from one that coagulated");
    let vessels = |report: &Value| ["fluid_open_vessels", "fluid_sealed_vessels"].map(|key| report[key].as_u64().unwrap());
    println!("vessels open, sealed: {:?} with a cold loop, {:?} with one that coagulated", vessels(&cold), vessels(&dry));
    assert!(before_ml > 0.0 && same_ml > 0.0, "{before_ml} ml and {same_ml} ml");
    assert!(cold_ml > 0.0 && dry_ml < 0.1 * cold_ml, "{dry_ml} of {cold_ml} ml");
    assert!(vessels(&cold)[1] == 0 && vessels(&dry)[1] > 0 && vessels(&dry)[0] < vessels(&cold)[0]);

    let [cut, after] = [began_tick, u64::MAX].map(|tick| {
        let until = staunched.content.tissue.iter().filter(|status| status.state_tick <= tick);
        let last = until.max_by_key(|status| status.state_tick).expect("the tissue has said something");
        (last.cuts, last.removed_volume_ml.to_bits())
    });
    assert!(cut.0 >= 3 && cut == after, "{cut:?} {after:?}");

    let fault = |(index, target): (u64, &str)| {
        let tick = began_tick + 400 + 700 * index;
        format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n")
    };
    let targets = ["fluid:active", "fluid:active", "fluid:spare", "tissue:active", "fluid:active"];
    let kills: String = (0..).zip(targets.into_iter().cycle().take(10)).map(fault).collect();
    let (hurt, _, _) = staunching("hurt", "coagulate", &kills);
    assert_eq!(hurt["faults"].as_array().unwrap().len(), 10);
    for key in ["cuts", "state_hash", "force_trace_hash", "fluid_state_hash", "fluid_bled_ml", "fluid_sealed_vessels"] {
        assert_eq!(dry[key], hurt[key], "{key}");
    }
}
