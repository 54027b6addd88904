//! Engines that are swapped while the scripted hand presses on the tissue, or cuts it: every role for a build of its own, an engine of a stranger's making,
//! bad ones of many kinds that are rolled back, and a supervisor that dies in the middle. What a swap costs the hand is judged at the simulated hardware,
//! against control windows of the same run.

#[path = "swap/bad.rs"]
mod bad;
#[path = "swap/costs.rs"]
mod costs;
#[path = "swap/cutting.rs"]
mod cutting;
#[path = "swap/judged.rs"]
mod judged;

use costs::{Costs, LEAST};
use hyst_exchange::{Roster, system};
use hyst_messages::page::{Stage, header};
use hyst_messages::{Role, Slot};
use rustix::process::Signal;
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::swapped::{assert_deficit_goes_on, assert_swaps_are_told, got_no_time, swap};
use station_tests::windows::Spinners;
use station_tests::{DEVICE_TICKS, RECOVERY_LIMIT, Station, bad_engine, binaries, hystation, run, wait_for};
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// The roles that are swapped for a good engine, in this order.
const ROLES: [&str; 8] = ["tissue", "haptic", "collision-worker", "rendering", "recorder", "console", "fluid", "device"];
/// Tries of a good swap: on a busy machine a newcomer that gets no time is rolled back, which harms nobody.
const TRIES: usize = 5;

/// Swaps a role for a good engine; false if the machine left that no time in any of the tries.
fn swap_well(station: &Station, role: &str, binary: &Path) -> bool {
    for _ in 0..TRIES {
        let (code, record, said) = swap(station, role, binary);
        station.recover();
        if code == Some(0) {
            let last_ms = record["steps"].as_array().and_then(|steps| steps.last()?["at_ms"].as_f64());
            println!("{role}: {:.1} s", last_ms.unwrap_or(0.0) * 1e-3);
            let runs: Vec<String> = station.processes(role).iter().map(|process| process["binary"].to_string()).collect();
            assert!(!runs.is_empty() && runs.iter().all(|runs| *runs == format!("{binary:?}")), "{role}: {runs:?}");
            return true;
        }
        println!("{role} was rolled back: {}", record["reason"]);
        assert!(code == Some(1) && got_no_time(&record), "{role}: {code:?} {record:#}\n{said}\n{}", station.said());
    }
    not_shown(&format!("a swap of {role}: {TRIES} times the newcomer got no time"));
    false
}

/// Those of the roles that are named, `haptic,tissue`; all if none are.
fn roles_of(named: Option<&str>) -> Result<Vec<&'static str>, String> {
    let Some(named) = named else { return Ok(ROLES.to_vec()) };
    let names: Vec<&str> = named.split(',').map(str::trim).collect();
    if let Some(other) = names.iter().find(|name| !ROLES.contains(name)) {
        return Err(format!("HYSTATION_SWAPS_OF: {other:?} is none of {}; write roles with commas between", ROLES.join(", ")));
    }
    Ok(ROLES.into_iter().filter(|role| names.contains(role)).collect())
}

/// A variable that is a number.
fn number_of(variable: &str) -> Option<usize> {
    std::env::var(variable).ok()?.parse().ok()
}

/// A copy of an engine under another name: another file, so that it can be told who runs it. The one of the round before is running.
fn copy(station: &Station, role: &str, round: usize) -> PathBuf {
    let copy = station.folder().join(format!("my-{role}-{}", round % 2));
    std::fs::copy(binaries().join(role), &copy).expect("a copy of an engine");
    copy
}

fn kill_supervisor(station: &Station) {
    let pid = station.processes("supervisor")[0]["pid"].as_i64().expect("a supervisor") as i32;
    station.signal(pid, Signal::KILL);
    station.wait_until_gone(pid);
}

/// `HYSTATION_SWAPS=60` makes sixty swaps of each role, `HYSTATION_SWAPS_OF=haptic,tissue` of these two alone.
#[test]
fn engines_are_swapped_under_the_hand_and_whoever_is_restarted_runs_the_new_ones() {
    let named = std::env::var("HYSTATION_SWAPS_OF").ok();
    let roles = roles_of(named.as_deref()).unwrap_or_else(|reason| panic!("{reason}"));
    let (asked, example) = (number_of("HYSTATION_SWAPS"), binaries().join("example-engine"));
    let count = asked.unwrap_or(1);
    let station = Station::start("swap", &["--hand", "script:press", "--test-mode"]);
    // Many swaps are made beside an ordinary process that spins.
    let _load = Spinners::start(usize::from(count >= LEAST));
    let (mut costs, mut runs_example) = (Costs::new("swaps", DEVICE_TICKS, asked.is_some(), &station), false);
    for round in 0..count {
        for role in roles.iter().copied() {
            let binary = match role {
                "fluid" if (count - round) % 2 == 1 => example.clone(),
                "fluid" => binaries().join("fluid"),
                _ => copy(&station, role, round),
            };
            let swapped = costs.around(role, &station, || swap_well(&station, role, &binary));
            if role == "fluid" && swapped {
                runs_example = binary == example;
            }
        }
    }
    costs.judge(&station);
    // Neither a restart of the supervisor nor one of the slot leads back to the old binary.
    kill_supervisor(&station);
    station.recover();
    station.kill("fluid", true);
    let runs = |process: &Value| (process["binary"].as_str() == example.to_str()) == runs_example;
    assert!(station.processes("fluid").iter().all(runs), "{}", station.status());
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert_deficit_goes_on(&ended);
    assert_swaps_are_told(&ended);
}

/// What a developer does all day: builds over the file that was swapped. The station goes on with what it has verified, whoever dies, and what is swapped in
/// again from the same name and is bad is rolled back to what ran before it.
#[test]
fn a_file_that_is_built_anew_in_its_place_changes_nothing_that_runs() {
    let station = Station::start("anew", &["--hand", "script:press", "--test-mode"]);
    // The bad one goes by its name.
    let (mine, worse) = (bad_engine(station.folder(), "fluid", "off"), station.folder().join("worse"));
    std::fs::rename(&mine, &worse).expect("put aside");
    std::fs::copy(binaries().join("fluid"), &mine).expect("a copy of an engine");
    let good = std::fs::read(&mine).expect("the engine");
    if !swap_well(&station, "fluid", &mine) {
        return;
    }
    std::fs::rename(&worse, &mine).expect("a worse one in its place");
    let all_run_the_good_one = || {
        for _ in 0..2 {
            station.kill("fluid", true);
            station.recover();
        }
        for process in station.processes("fluid") {
            assert_eq!(process["binary"].as_str(), mine.to_str(), "called as it was called");
            let runs = std::fs::read(format!("/proc/{}/exe", process["pid"])).expect("what it runs");
            assert!(runs == good, "{process:#}\n{}", station.said());
        }
    };
    all_run_the_good_one();
    let (code, record, said) = swap(&station, "fluid", &mine);
    assert_eq!(code, Some(1), "{record:#}\n{said}");
    station.recover();
    all_run_the_good_one();
    station.stop().assert_clean();
}

#[test]
fn a_supervisor_or_a_holder_that_dies_in_the_middle_of_a_swap_leaves_the_station_whole() {
    let station = Station::start("amid", &["--hand", "script:press", "--test-mode"]);
    let copy = copy(&station, "fluid", 0);
    let (old, in_shadow) = (station.processes("fluid")[0]["binary"].clone(), || {
        let is_there = |process: &Value| matches!(process["state"].as_str(), Some("spare" | "live"));
        station.processes("fluid").iter().any(|process| process["name"] == "fluid:2" && is_there(process))
    });
    let mut command = hystation();
    command.args(["--name", station.name(), "swap", "fluid"]).arg(&copy).stdout(Stdio::null()).stderr(Stdio::null());
    let mut begun = command.spawn().expect("hystation");
    assert!(wait_for(RECOVERY_LIMIT, || in_shadow().then_some(())).is_some(), "{}", station.status());
    let in_swap_of = |role: &str, within: &str| {
        let (state, inject) = (format!("swap:{role}"), ["fault", "inject", "kill", "supervisor", "--state"]);
        run(hystation().args(["--name", station.name()]).args(inject).args([state.as_str(), "--within", within]))
    };
    let (code, told, said) = in_swap_of("tissue", "50ms");
    assert!(code == Some(1) && told.is_empty() && said.contains("not in that state within 0.05 s"), "{code:?} {told} {said}");
    let (code, told, said) = in_swap_of("fluid", "1m");
    assert!(code == Some(0) && told.contains("in state swap:fluid"), "{code:?} {told} {said}");
    if !told.trim_end().ends_with("; in state swap:fluid") {
        not_shown("a fault in a swap: it was over before anybody looked");
    }
    assert_eq!(begun.wait().expect("hystation").code(), Some(1), "{}", station.said());
    station.recover();
    assert!(station.processes("fluid").iter().all(|process| process["binary"] == old), "{}", station.status());
    // The holder dies while the newcomer shadows it: its spare takes over, and the swap goes on, or the newcomer got no time, and harmed nobody.
    command.arg("--json").stdout(Stdio::piped());
    for _ in 0..TRIES {
        let holder = station.pid("fluid", true);
        let begun = command.spawn().expect("hystation");
        assert!(wait_for(RECOVERY_LIMIT, || in_shadow().then_some(())).is_some(), "{}", station.status());
        station.signal_if_alive(holder, Signal::KILL);
        let ended = begun.wait_with_output().expect("hystation");
        station.recover();
        let binary = if ended.status.success() { copy.to_str() } else { old.as_str() };
        assert!(station.processes("fluid").iter().all(|process| process["binary"].as_str() == binary), "{}", station.status());
        if ended.status.success() {
            station.stop().assert_clean();
            return;
        }
        let record = serde_json::from_slice(&ended.stdout).unwrap_or(Value::Null);
        assert!(ended.status.code() == Some(1) && got_no_time(&record), "{record:#}\n{}", station.said());
    }
    not_shown(&format!("a swap whose holder dies: {TRIES} times the newcomer got no time"));
    station.stop().assert_clean();
}

/// A guest that has passed and then loses the role, as it does to a stall of the machine, is a spare of it: when its holder dies while the other slot is
/// in its start, nobody else has the state.
#[test]
fn a_guest_that_has_passed_takes_the_role_when_its_holder_dies_before_the_others_are_settled() {
    let station = Station::start("passed", &["--hand", "script:press", "--test-mode"]);
    let (role, clock) = (Role::Tissue, station.clock());
    let site = hyst_exchange::Station::named(station.name()).expect("its name");
    let roster = Roster::open(&site).expect("the roster");
    for round in 0..TRIES {
        let incumbent = roster.holder(role).incarnation;
        let (victim, begun_tick) = (station.holder("tissue").0, clock.tick_at(system::now_ns()));
        let mut command = hystation();
        command.args(["--name", station.name(), "swap", "tissue", "--json"]).stdout(Stdio::piped());
        let begun = command.arg(copy(&station, "tissue", round)).spawn().expect("hystation");
        let is_lost = wait_for(RECOVERY_LIMIT, || {
            let (swap, holder) = (clock.swap(role), roster.holder(role));
            let is_spare =
                |(slot, incarnation): (Slot, u32)| !slot.is_guest() && incarnation != incumbent && !clock.is_dead(slot);
            let is_over =
                swap.stage == Stage::None && station.processes("tissue").iter().all(|process| process["name"] != "tissue:2");
            match swap.has_passed(holder.incarnation) && !clock.occupied(role).any(is_spare) {
                true => Some(roster.promote(role, holder, incumbent).is_ok()),
                false => is_over.then_some(false),
            }
        });
        if is_lost == Some(true) {
            station.signal_if_alive(victim, Signal::KILL);
        }
        let ended = begun.wait_with_output().expect("hystation");
        station.recover();
        let record = serde_json::from_slice(&ended.stdout).unwrap_or(Value::Null);
        for (slot, incarnation) in clock.occupied(role) {
            let page = site.read_slot(slot, incarnation).expect("its page");
            assert!(page.load64(header::FOUNDED_TICK) < begun_tick, "{slot} began the state anew: {}", station.said());
        }
        if is_lost == Some(true) {
            assert_eq!(ended.status.code(), Some(0), "{record:#}\n{}", station.said());
            station.stop().assert_clean();
            return;
        }
    }
    not_shown(&format!("a guest that loses the role after it has passed: {TRIES} times it had not, or was not seen in time"));
    station.stop().assert_clean();
}

/// Wherever a supervisor dies in a swap under the hand, the one after it finishes what was proven and undoes the rest: one engine in all slots of the role,
/// nobody left in the guest's, and the next swap goes as if nothing had been.
#[test]
fn a_supervisor_that_dies_at_a_point_of_a_swap_has_it_finished_or_undone() {
    // Told twice: that the newcomer is in the shadow, and that it may take the role.
    let points = [
        ("tissue", "swap-told:2", None),
        ("haptic", "swap-told:2", None),
        ("tissue", "swap-adopted", None),
        ("haptic", "swap-adopted", None),
        ("fluid", "swap-undone", Some("off")),
        ("fluid", "swap-cleared", None),
    ];
    for (round, (role, point, flaw)) in points.into_iter().enumerate() {
        let mortal = format!("HYSTATION_SUPERVISOR_DIES_AT={point}");
        let station =
            Station::start_under(&["env", &mortal], &format!("point{round}"), &["--hand", "script:press", "--test-mode"]);
        let old = station.processes(role)[0]["binary"].clone();
        let new = match flaw {
            Some(flaw) => bad_engine(station.folder(), role, flaw),
            None => copy(&station, role, round),
        };
        if station.supervisor_starts() != 1 {
            not_shown(&format!("{point} of a swap of {role}: the supervisor that was to die there had died before"));
            station.stop().assert_clean();
            continue;
        }
        let mut tried = swap(&station, role, &new);
        // One that gets no time is rolled back before it comes to that point.
        for _ in 1..TRIES {
            if station.supervisor_starts() >= 2 {
                break;
            }
            assert!(got_no_time(&tried.1), "{role} {point}: {:#}\n{}", tried.1, station.said());
            station.recover();
            tried = swap(&station, role, &new);
        }
        if station.supervisor_starts() < 2 {
            not_shown(&format!("a supervisor that dies at {point} of a swap of {role}: {TRIES} times the newcomer got no time"));
            station.stop().assert_clean();
            continue;
        }
        station.recover();
        let (code, record, said) = tried;
        // At the last point one may be undone that got no time; the other points say it themselves.
        let is_proven = |step: &Value| step["what"].as_str().is_some_and(|what| what.contains("its probation is over"));
        let finished = record["steps"].as_array().into_iter().flatten().any(is_proven);
        assert!(point == "swap-cleared" || finished == (point == "swap-adopted"), "{role} {point}: {record:#}");
        assert_eq!(code, Some(if finished { 0 } else { 1 }), "{role} {point}: {record:#}\n{said}\n{}", station.said());
        let expected = if finished { Value::from(new.to_string_lossy()) } else { old };
        let rows = station.processes(role);
        assert!(rows.iter().all(|process| process["binary"] == expected), "{role} {point}: {rows:#?}\n{}", station.said());
        assert!(rows.len() <= 2, "{role} {point}: somebody is left: {rows:#?}");
        swap_well(&station, role, &copy(&station, role, round + 1));
        let ended = station.stop();
        ended.assert_clean();
        ended.assert_recorded();
    }
}
