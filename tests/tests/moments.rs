//! A tester names the tick of a fault and the place in it, on the command line and in a file; what cannot come about is refused, or named in the report.

use hyst_exchange::system;
use hyst_messages::TICK_NS;
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, RECOVERY_LIMIT, Station, hystation, run, wait_for};

/// Place in the tick, us.
const PHASE_US: u64 = 300;
/// The file's tick, by which the station is to be whole; that of the command line is so long after it is asked for.
const AT_TICK: u64 = 12_000;
const LATER_TICKS: u64 = 1_500;
/// With a phase it comes so long after the state did, as the documents say.
const AFTER_STATE_TICKS: u64 = 40;
/// A fault that comes later than this was kept off by the machine.
const LATE_TICKS: u64 = 200;
/// It draws the phase 611 us: a fault that comes as its tick begins comes too early.
const SEED: &str = "8";

/// Has a spare killed at a moment that a seed draws; gives tick and phase, us, as they were told.
fn kill_at_a_drawn_moment(station: &Station, target: &str) -> (u64, u64) {
    let inject = ["--name", station.name(), "fault", "inject", "kill", target, "--seed", SEED, "--json"];
    let clock = station.clock();
    // A stall may leave no spare while it is asked for.
    let asked = wait_for(RECOVERY_LIMIT, || {
        let asked_tick = clock.tick_at(system::now_ns());
        let (code, told, _) = run(hystation().args(inject));
        (code == Some(0)).then_some((asked_tick, told))
    });
    let (asked_tick, told) = asked.unwrap_or_else(|| panic!("not injected\n{}", station.said()));
    let told: Value = serde_json::from_str(&told).unwrap_or_else(|error| panic!("{error}: {told}"));
    let drawn = |key: &str| told["drawn"][key].as_u64().unwrap_or_else(|| panic!("no {key} was drawn: {told:#}"));
    assert!(drawn("tick") >= asked_tick + drawn("ahead_ticks"), "asked for at {asked_tick}: {told:#}");
    (drawn("tick"), drawn("phase_us"))
}

#[test]
fn a_fault_comes_no_earlier_than_at_its_tick_and_phase_and_one_that_does_not_come_is_named() {
    let folder = Folder::new("moments");
    let fault = |target: &str, tick: u64| {
        format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\nphase_us = {PHASE_US}\n")
    };
    let file = folder.write("faults.toml", &(fault("haptic:spare", AT_TICK) + &fault("fluid:spare", 3_000_000)));
    let station = Station::start("moments", &["--hand", "script:press", "--test-mode", "--faults", &file]);
    let clock = station.clock();
    let is_early = clock.tick_at(system::now_ns()) < AT_TICK;
    let refused = ["--tick 1", "--tick soon", "--tick +0", "--phase 5", "--tick +9000000", "--tick +50 --phase 1000"];
    for words in refused.into_iter().chain(["--phase 5 --seed 8", "--tick +50 --phase 5 --seed 8", "--seed eight"]) {
        let inject = ["--name", station.name(), "fault", "inject", "kill", "fluid:spare"];
        let (code, _, said) = run(hystation().args(inject).args(words.split(' ')));
        assert_eq!(code, Some(2), "{words}: {said}");
    }
    let asked = wait_for(RECOVERY_LIMIT, || (clock.tick_at(system::now_ns()) > AT_TICK + LATE_TICKS).then_some(()));
    assert!(asked.is_some(), "{}", station.said());
    station.recover();
    // A stall may let the tick pass, or leave no spare, while it is asked for.
    let asked = wait_for(RECOVERY_LIMIT, || {
        let tick = clock.tick_at(system::now_ns()) + LATER_TICKS;
        let words = format!("kill tissue:spare --tick {tick} --phase {PHASE_US}");
        let asked = run(hystation().args(["--name", station.name(), "fault", "inject"]).args(words.split(' ')));
        (asked.0 == Some(0)).then_some((tick, asked.1))
    });
    let (later_tick, told) = asked.unwrap_or_else(|| panic!("not injected\n{}", station.said()));
    assert!(told.starts_with("kill: tissue:") && told.contains(" at tick "), "{told}");
    station.run_ticks(1_000);
    station.recover();
    let (drawn_tick, drawn_us) = kill_at_a_drawn_moment(&station, "fluid:spare");
    station.run_ticks(1_000);
    station.recover();
    let ended = station.stop();
    ended.assert_clean();
    let faults = ended.faults("kill");
    let of = |role: &str| faults.iter().find(|fault| fault["target"].as_str().is_some_and(|target| target.starts_with(role)));
    let moments = [(AT_TICK, PHASE_US, "haptic"), (later_tick, PHASE_US, "tissue"), (drawn_tick, drawn_us, "fluid")];
    for (tick, phase_us, role) in moments {
        let Some(fault) = of(role).filter(|_| is_early || tick != AT_TICK) else {
            assert_eq!(tick, AT_TICK, "{faults:#?}");
            not_shown("a fault of a file at its tick: its victim was not there then");
            continue;
        };
        let late_ns = fault["injected_ns"].as_u64().expect("a time") as i64 - (clock.start_of(tick) + phase_us * 1_000) as i64;
        println!("{role}: {} us after its moment", late_ns / 1_000);
        assert!(late_ns >= 0, "{late_ns} ns late: {fault:#}");
        if late_ns > (LATE_TICKS * TICK_NS) as i64 {
            not_shown(&format!("a fault at its tick: {late_ns} ns late"));
        }
    }
    let left = &ended.report["faults_not_injected"];
    let last = left["first"].as_array().and_then(|first| first.last()).expect("one");
    assert!(last["target"] == "fluid:spare" && last["tick"] == 3_000_000, "{left:?}");
    assert_eq!(left["count"], 2 - usize::from(of("haptic").is_some()), "{left:?}");
    assert!(ended.said.contains("of those asked for did not come about"), "{}", ended.said);
}

#[test]
fn a_fault_waits_for_the_state_that_a_tester_names() {
    let station = Station::start("state", &["--hand", "script:press", "--test-mode"]);
    let inject = |target: &str, state: &str| {
        let mut command = hystation();
        command.args(["--name", station.name(), "fault", "inject", "kill", target, "--state", state]);
        command
    };
    for (state, touches) in [("contact", true), ("idle", false)] {
        // Between the fault and this look the hand may move on.
        let is_so = || {
            let (code, told, said) = run(&mut inject("haptic:spare", state));
            assert!(code == Some(0) && told.contains(&format!("in state {state}")), "{state}: {code:?} {told} {said}");
            let contacts = station.tissue_status().contact_count;
            station.recover();
            ((contacts > 0) == touches).then_some(())
        };
        assert!(wait_for(RECOVERY_LIMIT, is_so).is_some(), "{state}: {}", station.said());
    }
    // With a phase it comes in a later tick, and the state may have gone by then.
    let clock = station.clock();
    let at_phase = || {
        let asked_tick = clock.tick_at(system::now_ns());
        let (code, told, said) = run(inject("haptic:spare", "contact").args(["--phase", "300", "--json"]));
        let told: Value = serde_json::from_str(&told).unwrap_or_else(|error| panic!("{code:?} {error}: {told} {said}"));
        assert!(code == Some(0) && told["state"] == "contact" && told["held"].is_boolean(), "{code:?} {told:#} {said}");
        let tick = told["struck"]["tick"].as_u64().expect("a tick");
        assert!(tick >= asked_tick + AFTER_STATE_TICKS, "asked for at {asked_tick}: {told:#}");
        station.recover();
        let is_in_time = told["struck"]["phase_us"].as_u64().is_some_and(|phase_us| phase_us >= PHASE_US);
        (told["held"] == true && is_in_time).then_some(())
    };
    assert!(wait_for(RECOVERY_LIMIT, at_phase).is_some(), "{}", station.said());
    // The second one comes in the recovery from the first.
    station.inject("kill tissue:spare");
    let (code, _, said) = run(&mut inject("haptic:spare", "recovery"));
    assert_eq!(code, Some(0), "{said}");
    station.recover();
    let (code, _, said) = run(&mut inject("haptic:spare", "dancing"));
    assert!(code == Some(2) && said.contains("cutting, recovery, swap and handover"), "{code:?} {said}");
    // This hand cuts nothing, and nobody swaps: who waits for that is told so in time, and nobody is hurt.
    for state in ["cutting", "swap:fluid", "handover"] {
        let (code, told, said) = run(inject("tissue:active", state).args(["--within", "300ms"]));
        assert!(code == Some(1) && told.is_empty() && said.contains("within 0.3 s"), "{state}: {code:?} {told} {said}");
    }
    // Or ends with the station.
    let mut waits = inject("haptic:spare", "cutting").stderr(std::process::Stdio::piped()).spawn().expect("hystation");
    station.run_ticks(500);
    assert!(waits.try_wait().expect("it is ours").is_none(), "it does not wait");
    let ended = station.stop();
    let waited = waits.wait_with_output().expect("it is ours");
    assert_eq!(waited.status.code(), Some(1), "{}", String::from_utf8_lossy(&waited.stderr));
    ended.assert_clean();
    let kills = ended.faults("kill");
    assert!(kills.len() >= 5, "{kills:#?}");
    let is_of_tissue = |fault: &&Value| fault["target"].as_str().is_some_and(|target| target.starts_with("tissue"));
    assert_eq!(kills.into_iter().filter(is_of_tissue).count(), 1, "who waited in vain hurt somebody: {}", ended.said);
}
