//! A station on a virtual clock in which no tissue survives a step comes to its end: a replay ends where that is known, since what follows is not what was
//! recorded, and a run goes on with the tissue held still. Both waited for states that nobody made, half a minute in each tick.

use serde_json::Value;
use station_tests::{Folder, hystation, run, wait_for};
use std::fs::File;
use std::process::Command;
use std::time::Duration;

const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker,recorder";
/// From the tick after this one on every tissue dies in its next step.
const DOOM_TICK: u64 = 800;
/// At each of these ticks the sequencer holds until all are ready, for at most half a minute: time in which one tissue after the other dies.
const HOLD_TICKS: [u64; 4] = [820, 840, 860, 880];
/// Ticks of a session.
const TICKS: u64 = 2_000;
/// With one tick in each half minute it took ten hours. Some minutes are given to a machine that compiles beside it.
const LIMIT: Duration = Duration::from_secs(600);

fn faults(folder: &Folder) -> String {
    let holds = HOLD_TICKS.map(|tick| format!("[[fault]]\nkind = \"kill\"\ntarget = \"collision-worker:0\"\ntick = {tick}\n"));
    let doom = format!("[[fault]]\nkind = \"doom\"\ntarget = \"tissue:active\"\ntick = {DOOM_TICK}\n");
    folder.write("faults.toml", &format!("seed = 1\n{doom}{}", holds.concat()))
}

/// Runs a command that is to end by itself; gives exit code, stdout and stderr.
fn ended(folder: &Folder, command: &mut Command) -> (Option<i32>, String, String) {
    let file = |name: &str| File::create(folder.path(name)).unwrap();
    let mut child = command.stdout(file("told.txt")).stderr(file("said.txt")).spawn().unwrap();
    let status = wait_for(LIMIT, || child.try_wait().unwrap());
    if status.is_none() {
        let pid = rustix::process::Pid::from_child(&child);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap(); // which stops the station
        child.wait().unwrap();
    }
    let [told, said] = ["told.txt", "said.txt"].map(|name| folder.read(name));
    let status = status.unwrap_or_else(|| panic!("it had not ended after {} s: {told}{said}", LIMIT.as_secs()));
    (status.code(), told, said)
}

#[test]
fn a_replay_whose_tissue_is_held_still_ends_there_and_says_what_is_held_and_what_was_the_same_until_then() {
    let folder = Folder::new("standstill-replay");
    let (file, faults) = (folder.path("session.mcap"), faults(&folder));
    let station = format!("s{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--roles", ROLES, "--record", &file]);
    let (code, _, said) = run(command.args(["--for", &format!("{TICKS}ms")]));
    assert_eq!(code, Some(0), "{said}");

    let mut command = hystation();
    command.args(["--name", &station, "replay", &file, "--verify", "--workers", "1", "--test-mode", "--faults", &faults]);
    let (code, told, said) = ended(&folder, &mut command);
    assert_eq!(code, Some(3), "{told}{said}");
    let ends = said.lines().find(|line| line.contains("the replay ends at tick ")).unwrap_or_else(|| panic!("{told}{said}"));
    assert!(ends.contains("tissue is held still") && ends.contains("the log of tissue:"), "{ends}");
    assert!(told.contains(&format!("the same to the bit: {DOOM_TICK} forces, {DOOM_TICK} states")), "{told}{said}");
    assert!(told.contains(&format!("tick {} and what comes after it were not made again", DOOM_TICK + 1)), "{told}{said}");
}

#[test]
fn a_run_in_lock_step_whose_tissue_is_held_still_comes_to_its_end() {
    let folder = Folder::new("standstill-run");
    let (report, faults) = (folder.path("report.json"), faults(&folder));
    let mut command = hystation();
    command.args(["--name", &format!("h{}", std::process::id()), "run", "--headless", "--lockstep", "--workers", "1"]);
    command.args(["--roles", &ROLES.replace(",recorder", ""), "--report", &report, "--for", &format!("{TICKS}ms")]);
    let (code, _, said) = ended(&folder, command.args(["--test-mode", "--faults", &faults]));
    assert!(said.contains("tissue is held still from now on"), "{code:?} {said}");
    // 3 while it is held; at any moment it may be tried again, and dies of that. 1 if a promise was broken too.
    assert!(matches!(code, Some(0 | 1 | 3)), "{code:?} {said}");
    let report: Value = serde_json::from_str(&folder.read("report.json")).unwrap();
    assert_eq!(report["device"]["ticks"], TICKS, "{said}");
}
