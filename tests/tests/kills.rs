//! `kill -9` of each process in turn while the scripted hand presses on the tissue. What is promised is judged at the simulated hardware, in
//! fault windows against control windows of the same run (docs/faults.md, "What is promised"): a fault is to blame only for what it adds.

use serde_json::Value;
use station_tests::shown::{Promise, lower99_of_difference, mean};
use station_tests::{DEVICE_TICKS, Ended, RECOVERY_LIMIT, STEP_MARGIN_N, Station, binaries, hystation, run, wait_for};

/// Kills of the active haptic, and of the active tissue, that must count; `HYSTATION_KILLS=100` makes a hundred.
const KILLS: usize = 25;
/// The two that are killed so often.
const TAKEN_OVER: [&str; 2] = ["haptic", "tissue"];
/// Runs in which as many kills as that must count, and in which a mean above what is allowed may turn out to be one burst of the host's noise.
const RUNS: usize = 3;
/// Fewest kills of each in a run.
const LEAST: usize = 15;
/// Excess misses per kill that are allowed.
const ALLOWED: f64 = 0.1;
/// Share of the kills that may lose more ticks than their control, beyond those that lose fewer: the host's noise falls on both alike, and a
/// burst of it counts once.
const ALLOWED_SHARE: f64 = 0.05;
/// Ticks between two kills: room for a fault window and a control window.
const BETWEEN_TICKS: u64 = 220;

/// Force that is felt, N.
const FELT_N: f64 = 0.2;
/// On a machine that is so busy that a process which only says how it is called takes its time, the device may take this many times as long.
const DEVICE_STARTS: f64 = 4.0;

/// How long the device's program takes to start and to end on this machine now, ms.
fn bare_start_ms() -> f64 {
    let began = std::time::Instant::now();
    let (code, _, said) = run(&mut std::process::Command::new(binaries().join("device")));
    assert_eq!(code, Some(2), "{said}");
    began.elapsed().as_secs_f64() * 1e3
}

/// The faults of a role that hit the one that did its work.
fn of_active<'a>(ended: &'a Ended, role: &str) -> Vec<&'a Value> {
    let of_role = |fault: &&Value| fault["target"].as_str().and_then(|name| name.split(':').next()) == Some(role);
    ended.faults("external").into_iter().filter(of_role).filter(|fault| fault["active"] == true).collect()
}

/// Every kill has recovered, and as many promises are kept as the host's noise lets: a broken one is forgiven only for a control window that
/// lost more than its fault window.
fn assert_promises(ended: &Ended, role: &str) {
    let faults = of_active(ended, role);
    let number = |fault: &Value, arm: &str, key: &str| fault[arm][key].as_f64();
    let worse = |fault: &Value, a: &str, b: &str| {
        let more = number(fault, a, "missed") > number(fault, b, "missed");
        let step = number(fault, b, "force_step_max_n").map(|step_n| step_n + STEP_MARGIN_N);
        more || number(fault, a, "force_step_max_n") > step
    };
    assert!(faults.iter().all(|fault| fault["recovered_us"].is_number()), "{role}: {faults:#?}");
    let judged: Vec<&&Value> = faults.iter().filter(|fault| fault["promise_held"].is_boolean()).collect();
    let broken = judged.iter().filter(|fault| fault["promise_held"] == false).count() as f64;
    let noise = judged.iter().filter(|fault| worse(fault, "control", "window")).count() as f64;
    println!("{role}: {} kills judged, {broken} promises broken, {noise} controls worse than their fault", judged.len());
    let beyond = lower99_of_difference(broken, noise);
    assert!(beyond <= ALLOWED_SHARE * judged.len() as f64, "{role}: {judged:#?}");
}

/// Kills the active servo and the active tissue in turn, in one run.
fn kill_in_turn(name: &str, times: usize) -> Ended {
    let station = Station::start(name, &["--hand", "script:press"]);
    for _ in 0..times {
        for role in TAKEN_OVER {
            station.kill(role, true);
            station.run_ticks(BETWEEN_TICKS);
        }
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    ended
}

fn kills() -> usize {
    std::env::var("HYSTATION_KILLS").ok().and_then(|count| count.parse().ok()).unwrap_or(KILLS)
}

/// The hand does not notice that the servo or the tissue dies. A stall of the host voids the window that it falls into, and the kill with it:
/// then some more are killed, in another run. So are they while the mean is above what is allowed: the noise of a shared host falls on faults and controls
/// alike, so it goes away with their number, and a takeover that does not work does not.
#[test]
fn the_active_haptic_and_the_active_tissue_are_taken_over() {
    let mut excess: [Vec<f64>; 2] = Default::default();
    let (mut worst_control, mut said) = (0.0f64, String::new());
    for run in 0..RUNS {
        let missing = excess.iter().map(|of_role| kills().saturating_sub(of_role.len())).max().unwrap_or(0);
        if missing == 0 && excess.iter().all(|of_role| mean(of_role) <= ALLOWED) {
            break;
        }
        let ended = kill_in_turn(&format!("kills-{run}"), missing.max(LEAST));
        for (role, excess) in TAKEN_OVER.into_iter().zip(&mut excess) {
            assert_promises(&ended, role);
            excess.extend(ended.excess(role, true));
        }
        worst_control = worst_control.max(ended.worst_control());
        said = ended.said;
    }
    for (role, excess) in TAKEN_OVER.into_iter().zip(&excess) {
        let promise = Promise::of_ticks(ALLOWED, kills(), worst_control);
        promise.judge(&format!("kills of the active {role}, excess misses"), excess, || said.clone());
        let [more, fewer] = [1.0, -1.0].map(|sign| excess.iter().filter(|excess| sign * **excess > 0.0).count() as f64);
        let net = lower99_of_difference(more, fewer);
        assert!(net <= ALLOWED_SHARE * excess.len() as f64, "{role}: {net} kills lost ticks: {excess:?}\n{said}");
    }
}

/// Who registers with the Site Manager of the default station.
const ENGINES: [&str; 9] =
    ["device", "haptic:0", "haptic:1", "fluid:0", "fluid:1", "rendering", "recorder", "collision-worker:0", "collision-worker:1"];

/// The engines that each tissue knows.
fn registers(station: &Station) -> Vec<Vec<String>> {
    let names = |tissue: Value| -> Vec<String> {
        let engines = tissue["registered"]["engines"].as_array().cloned().unwrap_or_default();
        engines.iter().filter_map(|name| name.as_str().map(str::to_string)).collect()
    };
    station.processes("tissue").into_iter().map(names).collect()
}

/// Every process that is killed is back, with its state: the deficit of the fluid does not go back, the station's clock goes on, no promise
/// of another process suffers.
#[test]
fn every_process_is_back_with_its_state() {
    let station = Station::start("each", &["--hand", "script:press"]);
    station.run_ticks(1_000);
    let victims = [
        ("device", true),
        ("haptic", false),
        ("tissue", false),
        ("collision-worker", true),
        ("fluid", true),
        ("fluid", false),
        ("rendering", true),
        ("recorder", true),
        ("console", true),
    ];
    let mut before = station.deficit();
    assert!(before.0 > 0.0, "the pump has filled the cavity");
    for (role, active) in victims {
        for _ in 0..3 {
            station.kill(role, active);
            station.run_ticks(BETWEEN_TICKS);
            let after = station.deficit();
            // A fluid that began anew would have delivered less than a whole cavity in a quarter of a second.
            assert!(
                after.0 > 0.9 * before.0 && after.1 > before.1,
                "{role}: deficit and tick {before:?} before, {after:?} after"
            );
            before = after;
        }
    }
    // Whoever came back has registered with the Site Managers that came back.
    let is_full = |registers: &[Vec<String>]| registers.len() == 2 && registers.iter().all(|names| names == &ENGINES);
    let everybody = wait_for(RECOVERY_LIMIT, || is_full(&registers(&station)).then_some(()));
    assert!(everybody.is_some(), "{:?}", registers(&station));
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert!(
        ended.number("fluid_deficit_ml").abs() > 1e-6,
        "the pump has filled the cavity; a restart from nothing would show zero\n{}",
        ended.said
    );
    let others = victims.into_iter().filter(|(role, _)| *role != "device");
    let excess: Vec<f64> = others.flat_map(|(role, active)| ended.excess(role, active)).collect();
    let promise = Promise::of_ticks(1.0, victims.len(), ended.worst_control());
    promise.judge("kills of everybody but the device, excess misses", &excess, || ended.said.clone());
}

/// Without spares a death is felt: the force fades by the age of the contact model, or for want of a servo. Each is back by itself all the same, and
/// nothing wrong is applied meanwhile.
#[test]
fn without_spares_every_process_comes_back_too() {
    let station = Station::start("alone", &["--hand", "script:press", "--set", "spares=off"]);
    let killed = ["haptic", "tissue", "fluid", "collision-worker"];
    for role in killed {
        station.pass_ticks(2 * BETWEEN_TICKS);
        let (name, pid) = station.victim(&format!("{role}:0"));
        assert_eq!(station.processes(role).len(), if role == "collision-worker" { 2 } else { 1 }, "{name}: {}", station.status());
        station.signal(pid, rustix::process::Signal::KILL);
        station.wait_until_gone(pid);
        station.recover();
        let felt = wait_for(RECOVERY_LIMIT, || (station.force_n() > FELT_N).then_some(()));
        assert!(felt.is_some(), "nothing is felt after the death of {name}\n{}", station.said());
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert!(ended.died_unasked().len() >= killed.len(), "{}", ended.said);
}

#[test]
fn the_supervisors_death_changes_nothing_for_the_engines() {
    let station = Station::start("supervisor", &["--hand", "script:press"]);
    let before = station.census();
    for _ in 0..5 {
        station.kill("supervisor", true);
        station.run_ticks(300);
    }
    before.assert_untouched(&station, "deaths of the supervisor", &[]);
    station.kill("haptic", true); // the new supervisor looks after the engines it has adopted
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    let excess = ended.excess("supervisor", true);
    assert!(of_active(&ended, "supervisor").len() >= 5, "{}", ended.said);
    let promise = Promise::of_ticks(1.0, 3, ended.worst_control());
    promise.judge("deaths of the supervisor, excess misses", &excess, || ended.said.clone());
}

/// The device itself dies: the hardware keeps the last force and ramps it, without a kick, and the successor goes on from there.
#[test]
fn the_device_is_back_before_the_hardware_has_let_go() {
    let station = Station::start("device", &["--hand", "script:press"]);
    let mut starts_ms = Vec::new();
    for _ in 0..10 {
        station.kill("device", true);
        station.run_ticks(BETWEEN_TICKS);
        starts_ms.push(bare_start_ms());
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    let faults = of_active(&ended, "device");
    assert!(faults.len() >= 10, "{}", ended.said);
    let excess = ended.excess("device", true);
    let recovered_ms: Vec<f64> = faults.iter().filter_map(|fault| Some(fault["recovered_us"].as_f64()? * 1e-3)).collect();
    starts_ms.sort_by(f64::total_cmp);
    let allowed = DEVICE_TICKS.max(DEVICE_STARTS * starts_ms[starts_ms.len() / 2]);
    println!("device: back after {recovered_ms:.0?} ms; bare starts {starts_ms:.1?} ms");
    assert_eq!(recovered_ms.len(), faults.len(), "{faults:#?}");
    let promise = Promise::of_ticks(allowed, 5, ended.worst_control());
    promise.judge("kills of the device, excess misses", &excess, || ended.said.clone());
    // What one alone may cost is asked of its ticks, of which those that the host took do not count.
    let promise = Promise { most: f64::INFINITY, ..promise };
    promise.judge("kills of the device, ms until it is back", &recovered_ms, || ended.said.clone());
    assert!(ended.number("device.own_faults.count") >= 5.0, "reported apart: {}", ended.report["device"]);
}

/// The plug of the hardware is pulled and put back: it is said, the station goes on, and so does the judge.
#[test]
fn the_hardware_that_was_unplugged_comes_back_and_it_is_said() {
    let station = Station::start("hardware", &["--hand", "script:press"]);
    station.run_ticks(500);
    station.kill("hardware", true);
    let before = station.ledger();
    station.run_ticks(1_000);
    assert!(station.ledger().0 > before.0 + 500, "the new one counts its ticks\n{}", station.said());
    let ended = station.stop();
    ended.assert_clean();
    assert!(ended.said.lines().any(|line| line.contains("hardware") && line.contains("died")), "{}", ended.said);
}

/// The guardian is not needed for the station to go on, nor to stop it: `stop` does its last work. What its death costs is judged in `adopted.rs`.
#[test]
fn the_guardians_death_changes_nothing_until_the_station_is_stopped() {
    let mut station = Station::start("guardian", &["--hand", "script:press"]);
    let before = station.census();
    station.kill_guardian();
    station.run_ticks(1_500);
    before.assert_untouched(&station, "the guardian's death", &[]);
    // The supervisor goes on too.
    let pid = station.pid("haptic", true);
    station.signal(pid, rustix::process::Signal::KILL);
    station.wait_until_gone(pid);
    let (code, _, said) = run(hystation().args(["--name", station.name(), "stop"]));
    assert_eq!(code, Some(0), "{said}");
    let place = hyst_exchange::Station::named(station.name()).expect("a name");
    let nothing = wait_for(RECOVERY_LIMIT, || place.leftovers().is_empty().then_some(()));
    assert!(nothing.is_some(), "left: {:?}", place.leftovers());
    let (code, _, said) = run(hystation().args(["--name", station.name(), "status"]));
    assert_ne!(code, Some(0), "{said}");
}
