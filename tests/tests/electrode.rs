//! Cutting in a whole station: the hand that resects cuts, a piece comes free, and whoever dies in the middle of a stroke is followed by somebody who
//! goes on with it, from a checkpoint, too. In lock-step neither that nor the number of workers leaves a trace.

use hyst_messages::TissueStatus;
use hyst_scene::{HandLeg, load, load_embedded};
use serde_json::Value;
use station_tests::{Folder, Station, both, hystation, run, wait_for};
use std::ops::Range;
use std::path::Path;
use std::time::Duration;

/// The hand is at the polyp after some seconds; a busy machine takes its time.
const LIMIT: Duration = Duration::from_secs(60);
/// Virtual time of a run in lock-step: one whole resection.
const ROUND_MS: u64 = 16_000;
const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker";
/// A tissue that dies has made no state of a tick that is so far ahead.
const LAST_STEPS: u64 = 20;
/// Ticks that a hand rests before its script begins.
const RESTS: u64 = 1_000;
/// How many times as long the slow hand's stroke takes: so long that several tissues die in it, one after the other, and those after them come.
const SLOWER: f64 = 8.0;
/// The same of all that the brisk hand does.
const BRISKER: f64 = 0.5;
/// What of two reports is the same to the bit.
const ALIKE: [&str; 9] = [
    "cuts",
    "cut_limits",
    "corrections",
    "removed_volume_ml",
    "healthy_removed_ml",
    "state_hash",
    "force_trace_hash",
    "fluid_state_hash",
    "fluid_deficit_ml",
];

/// Ticks in which the current of a hand is on first.
fn current(legs: &[HandLeg]) -> Range<u64> {
    let ticks = |legs: &[HandLeg]| RESTS + (1e3 * legs.iter().map(|leg| leg.time_s).sum::<f64>()) as u64;
    let first = legs.iter().position(|leg| leg.is_energized).expect("the hand cuts");
    let cuts = legs[first..].iter().take_while(|leg| leg.is_energized).count();
    ticks(&legs[..first])..ticks(&legs[..first + cuts])
}

/// The default scene with a hand `own`, which does what the hand that resects does, but for what is changed of it; and the ticks of its stroke.
fn scripted(folder: &Folder, change: impl FnOnce(&mut Vec<HandLeg>)) -> (String, Range<u64>) {
    let path = folder.scene();
    let mut legs = load(Path::new(&path)).unwrap().hand("polyp").expect("a hand that resects").legs.clone();
    change(&mut legs);
    let text = |leg: &HandLeg| {
        let [pitch_deg, yaw_deg, roll_deg] =
            [leg.to.pitch_rad, leg.to.yaw_rad, leg.to.roll_rad].map(|rad| f64::from(rad).to_degrees());
        let to = format!(
            "pitch_deg = {pitch_deg:?}, yaw_deg = {yaw_deg:?}, roll_deg = {roll_deg:?}, insertion_m = {:?}",
            leg.to.insertion_m
        );
        let electrode = match leg {
            HandLeg { is_energized: true, .. } => "cut",
            HandLeg { is_extended: true, .. } => "out",
            _ => "in",
        };
        format!("    {{ to = {{ {to} }}, time_s = {:?}, loop = \"{electrode}\" }},\n", leg.time_s)
    };
    let own: String = legs.iter().map(text).collect();
    let scene = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{scene}\n[hand.own]\nleg = [\n{own}]\n")).unwrap();
    (path, current(&legs))
}

/// Injects a fault, and gives what the command says of it.
fn struck(station: &Station, fault: &str) -> Value {
    let arguments = ["--name", station.name(), "fault", "inject", "--json"];
    let (code, told, said) = run(hystation().args(arguments).args(fault.split(' ')));
    assert_eq!(code, Some(0), "fault inject {fault}: {said}\n{}", station.said());
    serde_json::from_str(&told).unwrap_or_else(|error| panic!("{error}: {told}"))
}

fn wait_until(station: &Station, what: &str, is_so: impl Fn(&TissueStatus) -> bool) -> TissueStatus {
    let found = wait_for(LIMIT, || Some(station.tissue_status()).filter(|status| is_so(status)));
    found.unwrap_or_else(|| panic!("not {what}: {:?}\n{}", station.tissue_status(), station.said()))
}

#[test]
fn a_stroke_goes_on_when_whoever_makes_it_is_killed() {
    let folder = Folder::new("electrode-slow");
    let (scene, stroke) = scripted(&folder, |legs| {
        legs.iter_mut().filter(|leg| leg.is_energized).for_each(|leg| leg.time_s *= SLOWER);
    });
    let station = Station::start("cut", &[scene.as_str(), "--hand", "script:own", "--test-mode"]);
    let begun = wait_until(&station, "cut", |status| status.is_cutting == 1 && status.cuts >= 1);
    let goes_on = |last: &TissueStatus| {
        let is_later = |now: &TissueStatus| now.state_tick > last.state_tick + 100 && now.is_cutting == 1 && now.cuts > last.cuts;
        let now = wait_until(&station, "cut again", is_later);
        // What was cut since the checkpoint is cut anew: but for the rounding of its nodes.
        assert!(now.removed_volume_ml > last.removed_volume_ml - 1e-6, "{last:?} {now:?}");
        now
    };
    let mut last = begun;
    for _ in 0..2 {
        let pid = station.pid("tissue", true);
        let before = station.tissue_status();
        station.signal(pid, rustix::process::Signal::KILL);
        assert!(before.is_cutting == 1 && before.cuts >= last.cuts, "{last:?} {before:?}");
        last = goes_on(&before);
    }
    // Incumbent and spare at once, as soon as both are there: the state comes from a checkpoint, with its mesh and the stroke that is under way.
    let told = struck(&station, "kill tissue:both --state cutting");
    let died = told["struck"]["victims"].as_array().map(Vec::len);
    // On a busy machine another may just recover, too: what counts is that it cut.
    assert_eq!((told["struck"]["doing"]["cutting"].as_bool(), died), (Some(true), Some(2)), "{told}");
    let tick = told["struck"]["tick"].as_u64().unwrap();
    let back = wait_until(&station, "back", |now| now.state_tick > tick + LAST_STEPS);
    assert!(back.cuts >= last.cuts, "{last:?} {back:?}");
    last = goes_on(&back);
    assert!(last.state_tick - begun.state_tick < stroke.end - stroke.start, "it is another stroke: {begun:?} {last:?}");
    // Uterus, polyp and scope, and the chip. That a volume is removed is not asked for it: a mesh that is divided anew is less by its rounding before.
    let free = wait_until(&station, "a piece free", |status| status.objects >= 4 && status.is_cutting == 0);
    assert!(free.cuts >= last.cuts && free.removed_volume_ml > 1e-4, "{last:?} {free:?}");
    // Incumbent and spare at once: the state comes from a checkpoint, with its mesh.
    station.recover();
    station.inject("kill tissue:both");
    let after = wait_until(&station, "gone on", |status| status.state_tick > free.state_tick + 500);
    assert!(after.cuts >= free.cuts && after.removed_volume_ml >= free.removed_volume_ml, "{free:?} {after:?}");
    if (after.cuts, after.washed_out) == (free.cuts, free.washed_out) {
        assert_eq!((after.objects, after.topology_version), (free.objects, free.topology_version));
    }
    station.recover();
    station.stop().assert_clean();
}

/// Runs a whole resection on the virtual clock and gives its report.
fn resection(name: &str, faults: &str) -> Value {
    let folder = Folder::new(&format!("electrode-{name}-faults"));
    let file = folder.write("faults.toml", faults);
    report_of(name, ROUND_MS, &["--hand", "script:polyp", "--test-mode", "--faults", &file])
}

/// Runs a station on the virtual clock and gives its report.
fn report_of(name: &str, ms: u64, arguments: &[&str]) -> Value {
    let folder = Folder::new(&format!("electrode-{name}"));
    let report = folder.as_path().join("report.json");
    let mut command = hystation();
    let station = format!("c{}-{name}", std::process::id());
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--roles", ROLES, "--for", &format!("{ms}ms")]);
    command.args(arguments).arg("--report").arg(&report);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{name}: {said}");
    serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap()
}

#[test]
fn kills_in_the_middle_of_a_cut_leave_no_trace() {
    let stroke = current(&load_embedded().unwrap().hand("polyp").unwrap().legs);
    // Spread over the whole round, and close to each other while the current is on.
    let targets = ["tissue:active", "collision-worker:0", "tissue:spare", "tissue:active", "haptic:active", "fluid:active"];
    let who_acts = ["tissue:active", "collision-worker:0", "haptic:active", "fluid:active"];
    let spread = (0..24).map(|index| 4_000 + 450 * index).filter(|tick| !stroke.contains(tick));
    let within = (1..=16).map(|index| stroke.start + index * (stroke.end - stroke.start) / 17);
    let fault = |(tick, target): (u64, &&str)| format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n");
    let within = within.zip(who_acts.iter().cycle());
    let all: Vec<String> = within.chain(spread.zip(targets.iter().cycle())).map(fault).collect();
    let [quiet, hurt] = both(|| resection("quiet", ""), || resection("hurt", &all.concat()));
    let cuts = quiet["cuts"].as_u64().unwrap();
    assert!(cuts >= 10 && quiet["removed_volume_ml"].as_f64().unwrap() > 0.0, "{cuts} cuts");
    let injected = hurt["faults"].as_array().unwrap();
    assert_eq!(injected.len(), all.len());
    let is_of_stroke = |fault: &&Value| fault["tick"].as_u64().is_some_and(|tick| stroke.contains(&tick));
    let is_of_tissue = |fault: &&Value| fault["target"].as_str().is_some_and(|target| target.starts_with("tissue"));
    let in_stroke = injected.iter().filter(is_of_stroke).filter(is_of_tissue);
    let died = in_stroke.filter(|fault| fault["exit"] == "signal 9").count();
    println!("{cuts} cuts; of {} who were killed {died} were the tissue that cut", injected.len());
    assert!(died >= 3, "{died} of the tissues that cut died: {injected:#?}");
    for key in ALIKE {
        assert_eq!(quiet[key], hurt[key], "{key}");
    }
}

#[test]
fn a_cut_is_the_same_without_workers_and_with_three() {
    let folder = Folder::new("electrode-brisk");
    let (scene, stroke) = scripted(&folder, |legs| {
        // From before the polyp, with the loop out, until it is back there.
        let last = legs.iter().rposition(|leg| leg.is_extended).unwrap();
        legs.truncate(last + 1);
        let first = legs.iter().position(|leg| leg.is_extended).unwrap();
        legs.drain(..first);
        legs.iter_mut().for_each(|leg| leg.time_s *= BRISKER);
    });
    let with = |workers: &str| {
        report_of(&format!("workers{workers}"), stroke.end, &[scene.as_str(), "--hand", "script:own", "--workers", workers])
    };
    let [none, three] = both(|| with("0"), || with("3"));
    println!("{} cuts until tick {}", none["cuts"], stroke.end);
    assert!(none["cuts"].as_u64().unwrap() >= 3, "next to nothing was cut: {}", none["cuts"]);
    for key in ALIKE {
        assert_eq!(none[key], three[key], "{key}");
    }
}
