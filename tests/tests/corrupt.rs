//! Bytes that flip in shared memory, segment by segment: they may cost the process that reads them, never a wrong force. What was seen is printed.

use hyst_exchange::{Roster, checkpoint};
use hyst_messages::{Role, Slot};
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Ended, RECOVERY_LIMIT, Station, hystation, run, wait_for};

/// Times that bytes are flipped in each place.
const TIMES: usize = 2;
/// Of so many bytes of a fault it is told at most what became of them.
const MOST_FOLLOWED: u64 = 64;

/// Flips bytes at a place of each target, some times each, and lets the station recover each time: what is in a page or a message is written anew.
fn flip(name: &str, place: &str, targets: &[&str], bytes: usize) -> Ended {
    let station = Station::start(name, &["--hand", "script:press", "--test-mode"]);
    for seed in 0..TIMES {
        for target in targets {
            station.run_ticks(300);
            let (slot, _) = station.victim(target);
            station.inject(&format!("corrupt {slot} --where {place} --bytes {bytes} --seed {}", seed + 1));
            station.run_ticks(1_200);
            station.recover();
        }
    }
    let ended = station.stop();
    seen(&ended, place, bytes);
    ended
}

fn seen(ended: &Ended, place: &str, bytes: usize) {
    for fault in ended.report["faults"].as_array().into_iter().flatten() {
        println!(
            "{place}, {bytes} bytes: {} {} found by {}, {}, missed {}, wrong {}",
            fault["kind"],
            fault["target"],
            fault["detected_by"],
            fault["exit"],
            fault["window"]["missed"],
            fault["window"]["wrong"]
        );
    }
}

/// The bytes of which a fault says what became of them: written over, still there, or gone with their file.
fn followed(fault: &Value) -> u64 {
    ["written_over", "still_there", "gone"].into_iter().filter_map(|fate| fault["remains"][fate].as_u64()).sum()
}

fn assert_harmless(ended: &Ended, faults: usize, bytes: u64) {
    for path in ["invalid_applied", "stale_applied", "leftovers.processes", "leftovers.shared_memory", "leftovers.files"] {
        assert_eq!(ended.number(path), 0.0, "{path}\n{}", ended.said);
    }
    let all = ended.faults("corrupt");
    assert_eq!(all.len(), faults, "{}", ended.said);
    let is_harmless = |fault: &&Value| followed(fault) == bytes.min(MOST_FOLLOWED) && fault["window"]["wrong"] == 0;
    assert!(all.iter().all(is_harmless), "{all:?}");
    // Of bytes that nobody had flipped it would be told that they were written over, and nobody would be in any trouble.
    let shows = |fault: &&Value| fault["remains"]["still_there"] != 0 || fault["detected_by"] != "" || fault["exit"] != "";
    let is_shown = all.iter().any(shows) || !ended.faults("external").is_empty();
    assert!(is_shown, "nothing came of it: {all:?}\n{}", ended.said);
}

/// The words of who founded a role first after an epoch about what it goes on from.
fn founded_after(station: &Station, role: Role, epoch: u32) -> Option<String> {
    let slots = (0..2).filter_map(|index| Slot::new(role, index));
    let logs: String = slots.map(|slot| std::fs::read_to_string(station.place().log(slot)).unwrap_or_default()).collect();
    let of_line = |line: &str| {
        let begun = line.rsplit_once(" in epoch ")?.1.parse::<u32>().ok()?;
        (begun > epoch).then(|| (begun, line.to_string()))
    };
    logs.lines().filter_map(of_line).min().map(|(_, words)| words)
}

#[test]
fn bytes_that_flip_in_a_page_apply_no_wrong_force() {
    let targets = ["haptic:active", "tissue:active", "fluid:active", "collision-worker:0", "device", "recorder"];
    assert_harmless(&flip("flip-page", "page", &targets, 64), TIMES * targets.len(), 64);
}

#[test]
fn bytes_that_flip_in_the_messages_of_a_stream_apply_no_wrong_force() {
    let targets = ["haptic:active", "tissue:active", "fluid:active", "collision-worker:0"];
    assert_harmless(&flip("flip-stream", "stream", &targets, 256), TIMES * targets.len(), 256);
}

/// What two processes keep of their connection is written by nobody anew while both live: whoever reads it may die of it, its successors too, until a
/// role is given up. The device reads none of it.
#[test]
fn bytes_that_flip_in_the_connections_of_a_stream_apply_no_wrong_force() {
    let station = Station::start("flip-link", &["--hand", "script:press", "--test-mode"]);
    for target in ["haptic", "tissue", "fluid", "collision-worker"] {
        let (device, missed) = (station.processes("device")[0]["pid"].clone(), station.ledger().1);
        let fault = format!("{target}:0 --where link --bytes 64 --seed 1");
        let (code, _, said) =
            run(hystation().args(["--name", station.name(), "fault", "inject", "corrupt"]).args(fault.split(' ')));
        assert!(code == Some(0) || said.contains("not alive") || said.contains("no segment"), "{code:?} {said}");
        station.run_ticks(1_500);
        println!("link of {target}: {code:?}, {} ticks missed", station.ledger().1 - missed);
        assert_eq!(station.processes("device")[0]["pid"], device, "{}", station.said());
    }
    let ended = station.stop();
    seen(&ended, "link", 64);
    let injected = ended.faults("corrupt").len();
    assert!(injected > 0, "{}", ended.said);
    assert_harmless(&ended, injected, 64);
}

/// A founder takes none of the damaged copies: the state after the death of both replicas is the newest whole one, or the scene's first. How a founder finds
/// what is damaged is shown in `crash.rs`.
#[test]
fn a_damaged_checkpoint_is_not_gone_on_from() {
    let station = Station::start("flip-check", &["--hand", "script:press", "--test-mode"]);
    let roster = Roster::open(&station.place()).expect("a roster");
    let mut compared = [(Role::Tissue, 0), (Role::Fluid, 0)];
    for seed in 0..TIMES {
        for (role, compared) in &mut compared {
            station.run_ticks(400);
            let (role, name, epoch) = (*role, role.name(), roster.holder(*role).epoch);
            for index in 0..2 {
                station.inject(&format!("corrupt {name}:{index} --where checkpoint --bytes 4096 --seed {}", seed + 1));
            }
            station.inject(&format!("kill {name}:both"));
            // From the deaths until somebody founds the role nobody writes a checkpoint.
            let whole = checkpoint::latest(&station.place(), role).filter(|_| roster.holder(role).epoch == epoch);
            station.recover();
            if let Some((whole, words)) = whole.zip(founded_after(&station, role, epoch)) {
                let from_whole = format!(" goes on from the checkpoint of tick {} in epoch ", whole.tick);
                assert!(words.contains(&from_whole), "{words}; it is not what{from_whole}\n{}", station.said());
                *compared += 1;
            }
        }
    }
    for (role, compared) in compared {
        println!("{}: {compared} of {TIMES} founders went on from a copy that was known", role.name());
        if compared == 0 {
            not_shown(&format!("from which copy a {} goes on beside damaged ones: none was known before it did", role.name()));
        }
    }
    let ended = station.stop();
    seen(&ended, "checkpoint", 4_096);
    assert_harmless(&ended, 4 * TIMES, 4_096);
}

#[test]
fn a_roster_whose_bytes_flip_is_mended() {
    assert_harmless(&flip("flip-roster", "roster", &["tissue:active"], 64), TIMES, 64);
}

/// Everyone reads it, and nobody can say what it was: the station may not outlive it, and still no force is wrong and nothing is left.
#[test]
fn bytes_that_flip_in_the_stations_page_apply_no_wrong_force_and_the_station_can_be_stopped() {
    for seed in 1..=TIMES {
        let station = Station::start(&format!("flip-station{seed}"), &["--hand", "script:press", "--test-mode"]);
        station.run_ticks(500);
        station.inject(&format!("corrupt tissue --where station --bytes 16 --seed {seed}"));
        // Its clock may be one of the bytes, so that its ticks tell nothing: the hardware's own count does.
        let (ticks, _) = station.ledger();
        let _ = wait_for(RECOVERY_LIMIT / 60, || (station.ledger().0 > ticks + 2_000).then_some(()));
        let ended = station.stop();
        println!("station's page, seed {seed}: exit code {:?}", ended.code);
        seen(&ended, "station", 16);
        for path in ["invalid_applied", "stale_applied", "leftovers.processes", "leftovers.shared_memory", "leftovers.files"] {
            assert_eq!(ended.number(path), 0.0, "{path}\n{}", ended.said);
        }
    }
}
