//! Cutting in a whole station: the hand that resects cuts, a piece comes free, and whoever dies in the middle of a stroke is followed by somebody who
//! goes on with it.

use hyst_messages::TissueStatus;
use serde_json::Value;
use station_tests::{Folder, Station, both, hystation, run, wait_for};
use std::time::Duration;

/// The hand is at the polyp after some seconds; a busy machine takes its time.
const LIMIT: Duration = Duration::from_secs(60);
/// Virtual time of a run in lock-step: one whole resection.
const ROUND_MS: u64 = 16_000;
const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker";

fn wait_until(station: &Station, what: &str, is_so: impl Fn(&TissueStatus) -> bool) -> TissueStatus {
    let found = wait_for(LIMIT, || Some(station.tissue_status()).filter(|status| is_so(status)));
    found.unwrap_or_else(|| panic!("not {what}: {:?}\n{}", station.tissue_status(), station.said()))
}

#[test]
fn a_stroke_goes_on_when_whoever_makes_it_is_killed() {
    let station = Station::start("cut", &["--hand", "script:polyp", "--test-mode"]);
    let mut last = wait_until(&station, "cut", |status| status.is_cutting == 1 && status.cuts >= 1);
    for _ in 0..2 {
        let pid = station.pid("tissue", true);
        station.signal(pid, rustix::process::Signal::KILL);
        // It may have been the last cut of the stroke.
        let has_gone_on = |now: &TissueStatus| now.state_tick > last.state_tick + 100;
        let is_done = |now: &TissueStatus| now.cuts > last.cuts || now.is_cutting == 0;
        let now = wait_until(&station, "cut again", |now| has_gone_on(now) && is_done(now));
        assert!(now.removed_volume_ml >= last.removed_volume_ml && now.cuts >= last.cuts, "{last:?} {now:?}");
        last = now;
    }
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
    let folder = Folder::new(&format!("electrode-{name}"));
    let (report, file) = (folder.as_path().join("report.json"), folder.write("faults.toml", faults));
    let mut command = hystation();
    let station = format!("c{}-{name}", std::process::id());
    let time = format!("{ROUND_MS}ms");
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--hand", "script:polyp", "--roles", ROLES]);
    command.args(["--for", &time, "--test-mode", "--faults", &file, "--report"]).arg(&report);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{name}: {said}");
    serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap()
}

#[test]
fn kills_in_the_middle_of_a_cut_leave_no_trace() {
    // Spread over the whole round, so that several come while the current is on.
    let targets = ["tissue:active", "collision-worker:0", "tissue:spare", "tissue:active", "haptic:active", "fluid:active"];
    let fault = |(index, target): (usize, &&str)| {
        let tick = 4_000 + 300 * index as u64;
        format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n")
    };
    let all: String = targets.iter().cycle().take(36).enumerate().map(fault).collect();
    let [quiet, hurt] = both(|| resection("quiet", ""), || resection("hurt", &all));
    let cuts = quiet["cuts"].as_u64().unwrap();
    assert!(cuts >= 10 && quiet["removed_volume_ml"].as_f64().unwrap() > 0.0, "{cuts} cuts");
    assert_eq!(hurt["faults"].as_array().unwrap().len(), 36);
    for key in [
        "cuts",
        "cut_limits",
        "corrections",
        "removed_volume_ml",
        "healthy_removed_ml",
        "state_hash",
        "force_trace_hash",
        "fluid_state_hash",
        "fluid_deficit_ml",
    ] {
        assert_eq!(quiet[key], hurt[key], "{key}");
    }
}
