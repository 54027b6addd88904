//! Engines that run short of what the system lends, and engines whose successors do not start: found, replaced, and the station whole again. What each costs
//! the hand is judged alone, against its control.

use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Ended, Station, hystation, run};

/// The fault of a kind that hit a slot; it came about, was found, is over, and cost the hand no more than it may.
fn fault_of<'a>(ended: &'a Ended, kind: &str, slot: &str) -> &'a Value {
    let of_slot = ended.faults(kind).into_iter().find(|fault| fault["target"] == slot);
    let fault = of_slot.unwrap_or_else(|| panic!("no fault {kind} of {slot}\n{}", ended.said));
    let done = fault["manifested"] == true && fault["detected_us"].is_number() && fault["recovered_us"].is_number();
    assert!(done, "{fault:#}\n{}", ended.said);
    println!(
        "{kind} {slot}: found by {} after {} us, over after {} us, {}, missed {} and {} in the control",
        fault["detected_by"],
        fault["detected_us"],
        fault["recovered_us"],
        fault["exit"],
        fault["window"]["missed"],
        fault["control"]["missed"]
    );
    ended.assert_cost(fault);
    fault
}

/// It ended as it should, or was ended because that took it too long: on a busy machine an end takes a while.
fn assert_ended(fault: &Value, exit: &str) {
    assert!(fault["exit"] == exit || fault["exit"] == "signal 9", "{fault:#}");
}

/// Has a fault replace a process; gives its slot.
fn replaced(station: &Station, fault: &str, target: &str, options: &str) -> String {
    let (slot, pid) = station.victim(target);
    station.inject(format!("{fault} {slot} {options}").trim_end());
    station.wait_until_gone(pid);
    station.recover();
    slot
}

#[test]
fn a_leak_of_memory_or_files_is_found_as_growth_and_the_role_handed_over() {
    // The supervisor dies after it has handed the first role over, before it ends who leaks: the next one finds the leak again.
    let mortal = ["env", "HYSTATION_SUPERVISOR_DIES_AT=role-promoted"];
    let station = Station::start_under(&mortal, "leaks", &["--hand", "script:press", "--test-mode"]);
    let memory = replaced(&station, "leak-memory", "tissue:active", "");
    let files = replaced(&station, "leak-files", "fluid:active", "");
    let fast = replaced(&station, "leak-memory", "haptic:active", "--rate 96");
    let ended = station.stop();
    ended.assert_clean();
    for (kind, slot) in [("leak-memory", memory), ("leak-files", files), ("leak-memory", fast)] {
        // Whoever misses a step of it says so before; what it is replaced for is said.
        fault_of(&ended, kind, &slot);
        let is_reason = |line: &&str| line.contains(&slot) && line.contains("grown from");
        assert!(ended.said.lines().any(|line| is_reason(&line)), "{kind} {slot}\n{}", ended.said);
    }
    // One that a busy machine made late had lost its role by then. The supervisor dies nowhere but where it has handed a role over.
    assert!(ended.said.contains("the supervisor was restarted"), "{}", ended.said);
    assert!(ended.died_unasked().is_empty(), "{}", ended.said);
}

#[test]
fn a_leak_that_ends_in_time_is_given_back_and_costs_nobody_his_place() {
    let station = Station::start("shortleak", &["--hand", "script:press", "--test-mode"]);
    let (slot, pid) = station.victim("tissue:active");
    station.inject(&format!("leak-memory {slot} --for 1s"));
    let (other, also) = station.victim("fluid:active");
    let (stopped, recorder) = station.victim("recorder");
    station.inject(&format!("stop {stopped}"));
    station.inject(&format!("undo {stopped}"));
    station.inject(&format!("leak-files {other}"));
    station.run_ticks(2_500);
    station.inject(&format!("undo {other}"));
    station.run_ticks(1_500);
    assert!([pid, also, recorder].iter().all(|pid| station.has_process(*pid)), "{}", station.said());
    let ended = station.stop();
    ended.assert_clean();
    for (kind, slot) in [("leak-memory", slot), ("leak-files", other), ("stop", stopped)] {
        let faults = ended.faults(kind);
        assert!(faults.len() == 1 && faults[0]["target"] == slot && faults[0]["manifested"] == true, "{faults:?}");
        assert!(faults[0]["recovered_us"].is_number(), "{faults:?}");
    }
}

/// Loans that are never sent: the stream's writer has none left, and ends; its spare, the coordinator or the other servo has the work already.
#[test]
fn an_engine_that_has_lost_its_loans_ends_and_is_replaced() {
    let station = Station::start("loans", &["--hand", "script:press", "--test-mode"]);
    let targets = ["tissue:active", "fluid:active", "collision-worker:0", "haptic:active"];
    let slots = targets.map(|target| replaced(&station, "leak-loans", target, ""));
    let ended = station.stop();
    ended.assert_clean();
    for slot in slots {
        assert_ended(fault_of(&ended, "leak-loans", &slot), "exit code 1");
    }
}

#[test]
fn an_engine_that_gets_no_memory_aborts_and_is_replaced() {
    let station = Station::start("oom", &["--hand", "script:press", "--test-mode"]);
    let targets = ["tissue:active", "haptic:active", "recorder", "rendering", "device"];
    let slots = targets.map(|target| replaced(&station, "oom", target, ""));
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    for slot in slots {
        assert_ended(fault_of(&ended, "oom", &slot), "signal 6");
    }
}

/// Has a thread that helps a process stand still; gives the process's slot when it has been replaced.
fn replaced_for(station: &Station, thread: &str, target: &str) -> (String, String) {
    (thread.into(), replaced(station, "block", target, &format!("--thread {thread}")))
}

/// A fault that waited for the tissue's hand-over came after its first fault had been found, and says whether the hand-over was still under way.
fn assert_handed_over(ended: &Ended, second: &std::process::Output) {
    assert_eq!(second.status.code(), Some(0), "{second:?}\n{}", ended.said);
    let told: Value = serde_json::from_slice(&second.stdout).expect("JSON");
    let is_tissue = |fault: &&Value| fault["thread"] == "keeper";
    let (first, own) = (ended.faults("block").into_iter().find(is_tissue), ended.faults("kill"));
    let ns = |fault: &Value| fault["injected_ns"].as_f64().unwrap_or(0.0);
    let found_ns = first.map_or(f64::MAX, |first| ns(first) + 1e3 * first["detected_us"].as_f64().unwrap_or(f64::MAX));
    assert!(own.len() == 1 && ns(own[0]) >= found_ns && told["state"] == "handover:tissue", "{own:#?} {told:#}\n{}", ended.said);
    if told["held"] != true {
        assert_eq!(told["held"], false, "{told:#}");
        not_shown("a fault in a hand-over: it was over when the fault came");
    }
}

/// Nobody found it: without its usher an engine met no newcomer any more, and the next death of whom it reads was one too many for it; without its keeper
/// its checkpoints grew old.
#[test]
fn a_thread_that_helps_an_engine_and_stands_still_is_found_and_the_engine_hands_over_and_is_replaced() {
    let station = Station::start("helpers", &["--hand", "script:press", "--test-mode"]);
    // One that goes on in time costs nobody his place.
    let (slot, pid) = station.victim("tissue:spare");
    station.inject(&format!("block {slot} --thread clerk --for 1s"));
    let cases = [("usher", "fluid:active"), ("keeper", "tissue:active"), ("drain", "haptic:active"), ("usher", "device")];
    let first = replaced_for(&station, cases[0].0, cases[0].1);
    assert!(station.has_process(pid), "{}", station.said());
    // A second fault waits for the tissue's hand-over, which comes seconds after the first.
    let inject = ["fault", "inject", "kill", "haptic:spare", "--state", "handover:tissue", "--json"];
    let mut command = hystation();
    let second = command.args(["--name", station.name()]).args(inject).stdout(std::process::Stdio::piped()).spawn();
    let rest = cases[1..].iter().map(|(thread, target)| replaced_for(&station, thread, target));
    let all: Vec<(String, String)> = std::iter::once(first).chain(rest).collect();
    let second = second.and_then(std::process::Child::wait_with_output).expect("hystation");
    station.recover();
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert_handed_over(&ended, &second);
    let faults = ended.faults("block");
    for (thread, slot) in &all {
        let is_it = |fault: &&&Value| fault["thread"] == thread.as_str() && fault["target"] == slot.as_str();
        let fault = faults.iter().find(is_it).unwrap_or_else(|| panic!("no {thread} of {slot}\n{}", ended.said));
        assert_eq!(fault["detected_by"], thread.as_str(), "{fault:#}\n{}", ended.said);
        assert!(fault["manifested"] == true && fault["recovered_us"].is_number(), "{fault:#}");
        ended.assert_cost(fault);
        assert!(fault["detected_us"].as_f64() >= Some(4.9e6), "its engine's own time is no shorter than the clock's: {fault:#}");
        let is_reason = |line: &str| line.contains(slot.as_str()) && line.contains(&format!("its {thread} stands still"));
        assert!(ended.said.lines().any(is_reason), "{thread} {slot}\n{}", ended.said);
    }
    for role in ["fluid", "tissue"] {
        assert!(ended.said.contains(&format!("{role} is handed over")), "{role}\n{}", ended.said);
    }
    let short = faults.iter().find(|fault| fault["thread"] == "clerk").expect("the one that goes on");
    assert!(short["manifested"] == true && short["recovered_us"].is_number() && short["exit"] == "", "{short:#}");
    assert!(ended.died_unasked().is_empty(), "{}", ended.said);
}

/// Whoever can open nothing meets a newcomer as soon as he can again, and says that he could not, if he is to know servos.
#[test]
fn engines_without_files_meet_a_newcomer_once_they_have_some_again() {
    let station = Station::start("nofiles", &["--hand", "script:press", "--test-mode"]);
    let mut lived = Vec::new();
    for target in ["tissue:active", "fluid:active", "device", "recorder"] {
        let (slot, pid) = station.victim(target);
        station.inject(&format!("no-files {slot} --for 2s"));
        station.kill("haptic", true);
        station.wait_until_over(pid);
        station.recover();
        println!("no-files {slot}: {}", if station.has_process(pid) { "lives" } else { "was replaced" });
        lived.extend(Some(slot).filter(|slot| !slot.starts_with("fluid") && station.has_process(pid)));
        station.kill("haptic", true);
        station.run_ticks(500);
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    let faults = ended.faults("no-files");
    assert!(faults.len() == 4 && faults.iter().all(|fault| fault["manifested"] == true), "{faults:?}");
    let is_silent =
        |fault: &&&Value| lived.iter().any(|slot| fault["target"] == slot.as_str()) && fault["detected_by"] != fault["target"];
    assert_eq!(faults.iter().filter(is_silent).count(), 0, "{faults:?}");
}

#[test]
fn successors_that_die_in_their_start_are_tried_again_and_belong_to_the_fault() {
    let station = Station::start("loop", &["--hand", "script:press", "--test-mode"]);
    let targets = ["haptic:active", "tissue:active", "fluid:active", "collision-worker:0", "recorder"];
    let slots = targets.map(|target| replaced(&station, "crash-loop", target, "--times 2"));
    let ended = station.stop();
    ended.assert_clean();
    for slot in &slots {
        fault_of(&ended, "crash-loop", slot);
        let incarnations = ended.number(&format!("processes.{slot}.incarnations"));
        assert!(incarnations >= 4.0, "{slot}: {incarnations}, of which two died in their start\n{}", ended.said);
    }
    assert!(ended.died_unasked().is_empty(), "{}", ended.said);
}

/// One is found by the watch, the other ends by itself: an ordinary process has 180 s for its start.
#[test]
fn a_successor_that_hangs_in_its_start_is_replaced_or_goes_on() {
    let station = Station::start("hangs", &["--hand", "script:press", "--test-mode"]);
    let (slot, pid) = station.victim("fluid:active");
    station.inject(&format!("hang-start {slot} --for 1s"));
    station.wait_until_gone(pid);
    station.recover();
    let found = replaced(&station, "hang-start", "tissue:active", "");
    let ended = station.stop();
    ended.assert_clean();
    let faults = ended.faults("hang-start");
    assert_eq!(faults.len(), 2, "{}", ended.said);
    assert_eq!(fault_of(&ended, "hang-start", &found)["detected_by"], "heartbeat");
    let fluid = faults.into_iter().find(|fault| fault["target"] == slot).expect("of the fluid");
    assert!(fluid["manifested"] == true && fluid["recovered_us"].as_f64() >= Some(1e6), "{fluid:#}");
    ended.assert_cost(fluid);
    assert!(ended.died_unasked().is_empty(), "{}", ended.said);
}

#[test]
fn incumbent_and_spare_that_die_at_the_same_instant_come_back_and_no_force_is_wrong() {
    let station = Station::start("both", &["--hand", "script:press", "--test-mode"]);
    for role in ["tissue", "fluid", "haptic"] {
        station.run_ticks(500);
        station.inject(&format!("kill {role}:both"));
        station.recover();
    }
    station.run_ticks(500);
    let ended = station.stop();
    ended.assert_clean();
    let faults = ended.faults("kill");
    assert_eq!(faults.len(), 6, "{}", ended.said);
    for fault in faults {
        assert!(fault["together"] == true && fault["recovered_us"].is_number(), "{fault:#}");
        assert_eq!(fault["window"]["wrong"], 0, "{fault:#}");
    }
}

#[test]
fn what_cannot_be_is_refused_with_its_cure_and_disturbs_nobody() {
    let station = Station::start("refused", &["--hand", "idle", "--test-mode"]);
    let before = station.pids();
    for (fault, words) in [
        ("disk-full tissue --for 1s", "recorder"),
        ("disk-full recorder", "--for"),
        ("shm-full tissue --for 1s", "unshare -m"),
        ("corrupt tissue", "--where"),
        ("corrupt device --where stream", "no stream"),
        ("corrupt tissue --where nowhere", "checkpoint"),
        ("leak-loans rendering", "no stream"),
        ("no-files tissue", "--for"),
        ("kill device:both", "PROCESS:both"),
        ("nan guardian", "kill, stop"),
        ("kill collision-worker:7", "it has"),
    ] {
        let (code, _, said) = run(hystation().args(["--name", station.name(), "fault", "inject"]).args(fault.split(' ')));
        assert!(code == Some(2) && said.contains(words) && said.lines().count() == 1, "{fault}: {code:?} {said}");
    }
    assert_eq!(station.pids(), before);
    let ended = station.stop();
    ended.assert_clean();
    assert!(ended.report["faults"].as_array().is_some_and(Vec::is_empty), "{}", ended.said);
}
