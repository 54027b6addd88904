//! Engines that hang, lie and come back from the dead, while the scripted hand presses on the tissue. What they cost is judged at the simulated
//! hardware, in fault windows against control windows of the same run; what was applied is judged tick by tick.

use hyst_messages::Role;
use rustix::process::Signal;
use serde_json::Value;
use station_tests::shown::{Promise, not_shown};
use station_tests::windows::{Spinners, compare};
use station_tests::{RECOVERY_LIMIT, STEP_MARGIN_N, Station, binaries, wait_for};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Excess misses per fault that a fault which others take over may cost: a takeover that does not work costs 20 and more.
const ALLOWED: f64 = 1.0;
/// Ticks between two faults: room for a fault window and a control window.
const BETWEEN_TICKS: u64 = 420;
/// How long a servo is stopped that goes on as a zombie: longer than three missed ticks, shorter than the supervisor's patience.
const ZOMBIE: Duration = Duration::from_millis(50);
/// Roles whose holder is in the roster.
const STATEFUL: [Role; 2] = [Role::Tissue, Role::Fluid];

/// Faults that take an engine outside of a swap, and which of them are tried on which engine: each way to end and each way to stand still on several
/// roles, every role by several. `kills.rs` has SIGKILL; the campaign draws the rest.
const ENDS: [(&str, &[&str]); 4] = [
    ("haptic:active", &["segfault", "exit0", "panic", "block", "slow"]),
    ("tissue:active", &["abort", "exit1", "panic", "block", "slow"]),
    ("collision-worker:0", &["abort", "exit0", "panic", "block"]),
    ("fluid:active", &["segfault", "exit1", "panic", "slow"]),
];
/// A step that takes so much longer, for so long: several periods of a servo and of the tissue, and a good part of one of the fluid.
const SLOW: &str = "--extra 5ms --for 300ms";
/// Ticks of that, and what the supervisor waits after it.
const SLOW_TICKS: u64 = 600;
/// Deaths of both servos at once, and rounds in which to come by them: a stall of the machine between two signals tears one apart.
const BOTH_SERVOS: usize = 3;
const MOST_ROUNDS: usize = 12;
/// Two deaths that were mourned within so long of each other were at once, s: no successor starts in that time.
const AT_ONCE_S: f64 = 0.005;
/// Force that is felt, and below which nothing is, N.
const FELT_N: f64 = 0.2;
const NOTHING_N: f64 = 0.02;
/// Ticks over which the last hop ramps a force to zero.
const RAMP_TICKS: f64 = 20.0;

/// How often a lie is tried if the role changes hands before it is told.
const TRIES: usize = 5;

/// Outputs that are wrong, each in its own way.
const KINDS: [&str; 9] = ["nan", "inf", "range", "stamp", "replay", "epoch", "frozen", "layout", "ahead"];

/// Outputs by which nothing but NaN is told, each alone, and who may find it: other readers, who are not to be spared by a faster one.
const BY_ONE: [(&str, &str, &[&str]); 7] = [
    ("tissue:active", "state", &["tissue"]),
    ("tissue:active", "cell", &["device"]),
    ("tissue:active", "topology", &["collision-worker", "fluid"]),
    ("tissue:active", "job", &["collision-worker"]),
    ("fluid:active", "state", &["fluid"]),
    ("fluid:active", "cell", &["device"]),
    ("haptic:spare", "force", &["recorder"]),
];

/// Who tells each lie, or every second of them in turn, so that each lie is told by two and each tells half of them. `HYSTATION_LIES=all` has all told by
/// all, as `assets/campaigns/lies.toml` does 24 times each.
fn liars(round: usize) -> impl Iterator<Item = &'static str> {
    let all = std::env::var("HYSTATION_LIES").is_ok_and(|which| which == "all");
    let everybody = ["haptic:active", "tissue:active", "fluid:active", "collision-worker:0"].into_iter().enumerate();
    everybody.filter(move |(at, _)| all || (at + round).is_multiple_of(2)).map(|(_, liar)| liar)
}

fn excess(fault: &Value) -> Option<f64> {
    Some(fault["window"]["missed"].as_f64()? - fault["control"]["missed"].as_f64()?)
}

/// A thread that runs on for ever at its real-time priority: the supervisor's watch stands above it, the device takes the other servo, the
/// tissue's spare stands above its holder, the coordinator computes the share.
#[test]
fn an_engine_that_spins_at_its_own_priority_costs_the_hand_nothing() {
    let station = Station::start("spinning", &["--hand", "script:press", "--test-mode"]);
    let victims = ["haptic:active", "tissue:active", "collision-worker:0", "fluid:active"];
    for _ in 0..3 {
        for victim in victims {
            station.run_ticks(BETWEEN_TICKS);
            let (victim, pid) = station.victim(victim);
            station.inject(&format!("spin {victim}"));
            station.wait_until_gone(pid);
            station.recover();
        }
    }
    station.run_ticks(2 * BETWEEN_TICKS);
    let ended = station.stop();
    ended.assert_clean();
    let faults = ended.faults("spin");
    assert_eq!(faults.len(), 3 * victims.len(), "{}", ended.said);
    for fault in &faults {
        let done = fault["manifested"] == true && fault["detected_us"].is_number() && fault["recovered_us"].is_number();
        assert!(done, "{fault:#}\n{}", ended.said);
    }
    let excesses: Vec<f64> = faults.iter().filter_map(|fault| excess(fault)).collect();
    let promise = Promise::of_ticks(ALLOWED, faults.len() / 2, ended.worst_control());
    promise.judge("spinning engines, excess misses", &excesses, || ended.said.clone());
}

/// Whatever ends an engine or holds it up is found, taken over and repaired, and the hand does not notice.
#[test]
fn an_engine_that_crashes_leaves_hangs_or_slows_down_costs_the_hand_nothing() {
    let station = Station::start("ends", &["--hand", "script:press", "--test-mode"]);
    let most = ENDS.iter().map(|(_, kinds)| kinds.len()).max().unwrap_or(0);
    for round in 0..most {
        for (target, kind) in ENDS.iter().filter_map(|(target, kinds)| Some((target, kinds.get(round)?))) {
            station.pass_ticks(BETWEEN_TICKS);
            let (victim, pid) = station.victim(target);
            if *kind == "slow" {
                station.inject(&format!("slow {victim} {SLOW}"));
                station.pass_ticks(SLOW_TICKS);
            } else {
                station.inject(&format!("{kind} {victim}"));
                let gone = || station.engines().iter().all(|engine| engine.pid != pid).then_some(());
                assert!(wait_for(RECOVERY_LIMIT, gone).is_some(), "{kind} {victim} {pid}\n{}", station.said());
            }
            station.recover();
        }
    }
    station.pass_ticks(2 * BETWEEN_TICKS);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    let mut all = Vec::new();
    for (target, kinds) in ENDS {
        let role = target.split(':').next().unwrap_or_default();
        for kind in kinds {
            let of_role = |fault: &&Value| fault["target"].as_str().is_some_and(|name| name.starts_with(role));
            let faults: Vec<&Value> = ended.faults(kind).into_iter().filter(of_role).collect();
            assert_eq!(faults.len(), 1, "{kind} {target}\n{}", ended.said);
            let fault = faults[0];
            // One that is slow for a while need not be found out: it is its spare that shows.
            let found = *kind == "slow" || fault["detected_us"].is_number();
            let done = fault["manifested"] == true && fault["recovered_us"].is_number() && fault["window"]["wrong"] == 0;
            assert!(found && done, "{fault:#}\n{}", ended.said);
            let excess = excess(fault);
            println!("{kind} {}: found after {} us, excess {excess:?}", fault["target"], fault["detected_us"]);
            all.extend(excess);
        }
    }
    let tried: usize = ENDS.iter().map(|(_, kinds)| kinds.len()).sum();
    let promise = Promise::of_ticks(ALLOWED, tried / 2, ended.worst_control());
    promise.judge("crashes, exits, hangs and slow steps, excess misses", &all, || ended.said.clone());
}

/// Kills both servos of a station while the hand presses, waits until the force has faded and is felt again, and gives what was felt, N.
fn kill_both_servos(station: &Station) -> f64 {
    station.pass_ticks(2 * BETWEEN_TICKS);
    let both: Vec<i32> = station.processes("haptic").iter().filter_map(|row| Some(row["pid"].as_i64()? as i32)).collect();
    assert_eq!(both.len(), 2, "{}", station.status());
    let felt_n = wait_for(RECOVERY_LIMIT, || Some(station.force_n()).filter(|force_n| *force_n > FELT_N));
    let felt_n = felt_n.unwrap_or_else(|| panic!("the hand does not press\n{}", station.said()));
    both.iter().for_each(|pid| station.signal_if_alive(*pid, Signal::KILL));
    let faded = wait_for(RECOVERY_LIMIT, || (station.force_n() < NOTHING_N).then_some(()));
    assert!(faded.is_some(), "{} N\n{}", station.force_n(), station.said());
    station.recover();
    let back = wait_for(RECOVERY_LIMIT, || (station.force_n() > FELT_N).then_some(()));
    assert!(back.is_some(), "nothing is felt again: {} N\n{}", station.force_n(), station.said());
    felt_n
}

/// How often it was said that no servo is left, and whether that was left out where it had to be said. Two deaths that were mourned at once had no
/// successor in between, which starts after the first was mourned; what a stall of the machine tore apart may have had one.
fn said_of_both(said: &str) -> (usize, bool) {
    let lines: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("hystation:")).collect();
    let tells = |line: &&str| line.contains("no servo is left");
    let (mut left_out, mut last_s) = (false, f64::NEG_INFINITY);
    for (at, line) in lines.iter().enumerate().filter(|(_, line)| line.contains(" haptic:") && line.contains(" died, ")) {
        let at_s = line.split_whitespace().next().and_then(|time| time.parse::<f64>().ok()).unwrap_or_else(|| panic!("{line}"));
        left_out |= at_s - last_s <= AT_ONCE_S && !lines[at + 1..].iter().take(2).any(tells);
        last_s = at_s;
    }
    (lines.iter().filter(|line| tells(line)).count(), left_out)
}

/// There is nobody left whose force could be applied: it fades without a step, that is said, and comes back with the first successor.
#[test]
fn both_servos_that_die_at_once_leave_a_force_that_fades_and_comes_back() {
    let station = Station::start("both-servos", &["--hand", "script:press"]);
    let (mut felt_n, mut rounds) = (0.0, 0);
    while said_of_both(&station.said()).0 < BOTH_SERVOS && rounds < MOST_ROUNDS {
        felt_n = kill_both_servos(&station).max(felt_n);
        rounds += 1;
    }
    station.pass_ticks(2 * BETWEEN_TICKS);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    let faults = ended.faults("external");
    let of_servos = faults.into_iter().filter(|fault| fault["target"].as_str().is_some_and(|name| name.starts_with("haptic")));
    let (told, left_out) = said_of_both(&ended.said);
    println!("no servo was left in {told} of {rounds} rounds");
    assert!(!left_out, "said {told} times in {rounds} rounds\n{}", ended.said);
    if told < BOTH_SERVOS {
        not_shown(&format!(
            "that no servo is left, {told} of {BOTH_SERVOS} times: in {rounds} rounds the machine tore the others apart"
        ));
    }
    assert!(ended.number("device.ramped") > 0.0 && ended.number("device.zero") > 0.0, "{}", ended.report["device"]);
    for fault in of_servos {
        let step_n = |arm: &str| fault[arm]["force_step_max_n"].as_f64();
        let most_n = step_n("control").unwrap_or(0.0).max(felt_n / RAMP_TICKS) + STEP_MARGIN_N;
        println!("{}: back after {} us, steps of {:?} N", fault["target"], fault["recovered_us"], step_n("window"));
        assert!(fault["recovered_us"].is_number() && fault["window"]["wrong"] == 0, "{fault:#}");
        assert!(step_n("window").is_some_and(|step_n| step_n <= most_n), "at most {most_n} N: {fault:#}\n{}", ended.said);
    }
}

/// Has a process lie until it is replaced. One that lost the role between look and lie says nothing more that somebody could refuse: then the
/// lie ends by itself, and the next one is asked. Gives the kind, and the incarnation that was replaced for it.
fn lie<'a>(station: &Station, kind: &'a str, target: &str, options: &str) -> (&'a str, u64) {
    for _ in 0..TRIES {
        let (victim, pid) = station.victim(target);
        let status = station.status();
        let of_pid = status["processes"].as_array().and_then(|all| all.iter().find(|process| process["pid"] == pid));
        let Some(incarnation) = of_pid.and_then(|process| process["incarnation"].as_u64()) else { continue };
        station.inject(&format!("{kind} {victim} --for 2s{options}"));
        station.wait_until_over(pid);
        if !station.has_process(pid) {
            return (kind, incarnation);
        }
        assert_ne!(station.victim(target).1, pid, "{kind} {victim} is still followed\n{}", station.said());
    }
    panic!("{kind} {target}: the role changes hands all the time\n{}", station.said());
}

/// NaN, infinity, out of range, an output that stands still, a stamp that stands still, an old output, an epoch that is over or still to come, another layout: never
/// applied, found by whoever reads it, its writer replaced, and the station whole again.
#[test]
fn wrong_output_is_refused_by_its_reader_and_never_applied() {
    let station = Station::start("lies", &["--hand", "script:press", "--test-mode"]);
    let mut told = Vec::new();
    for (round, kind) in KINDS.into_iter().enumerate() {
        for victim in liars(round) {
            if ["epoch", "layout"].contains(&kind) && victim == "haptic:active" {
                continue; // a force is no message: it has no epoch, and its page's layout was checked when it was opened
            }
            told.push(lie(&station, kind, victim, ""));
            station.recover();
        }
    }
    station.run_ticks(2 * BETWEEN_TICKS);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    for (kind, incarnation) in told {
        let fault = ended.faults(kind).into_iter().find(|fault| fault["incarnation"] == incarnation);
        let fault = fault.unwrap_or_else(|| panic!("no fault {kind} of incarnation {incarnation}\n{}", ended.said));
        let done = fault["manifested"] == true && fault["detected_us"].is_number() && fault["recovered_us"].is_number();
        let wrong = fault["window"]["wrong"].as_u64();
        println!("{} {}: found by {} after {} us", fault["kind"], fault["target"], fault["detected_by"], fault["detected_us"]);
        assert!(done && wrong == Some(0), "{fault:#}\n{}", ended.said);
    }
}

#[test]
fn a_lie_by_one_output_alone_is_found_by_who_reads_that_and_no_reader_dies_of_it() {
    let station = Station::start("outputs", &["--hand", "script:press", "--test-mode"]);
    let mut told = Vec::new();
    for (target, output, readers) in BY_ONE {
        let (_, incarnation) = lie(&station, "nan", target, &format!(" --output {output}"));
        told.push((incarnation, output, readers));
        station.recover();
    }
    station.run_ticks(2 * BETWEEN_TICKS);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    for (incarnation, output, readers) in told {
        let fault = ended.faults("nan").into_iter().find(|fault| fault["incarnation"] == incarnation);
        let fault = fault.unwrap_or_else(|| panic!("no fault of incarnation {incarnation}\n{}", ended.said));
        let by = fault["detected_by"].as_str().and_then(|name| name.split(':').next()).unwrap_or_default();
        println!("{output} of {}: found by {} after {} us", fault["target"], fault["detected_by"], fault["detected_us"]);
        let done = fault["manifested"] == true && fault["recovered_us"].is_number() && fault["window"]["wrong"] == 0;
        assert!(done && readers.contains(&by), "{fault:#}\n{}", ended.said);
    }
    assert_eq!(ended.died_unasked(), Vec::<&Value>::new(), "{}", ended.said);
}

/// Commands that no motor may follow: the hardware keeps the last one, ramps it, and the device is replaced.
#[test]
fn the_hardware_follows_no_wrong_command() {
    let station = Station::start("commands", &["--hand", "script:press", "--test-mode"]);
    let kinds = ["nan", "inf", "range", "stamp", "replay", "ahead"];
    for kind in kinds {
        let (_, pid) = station.victim("device");
        station.inject(&format!("{kind} device"));
        station.wait_until_gone(pid);
        station.recover();
        station.run_ticks(BETWEEN_TICKS);
    }
    let ended = station.stop();
    ended.assert_clean();
    for kind in kinds {
        let faults = ended.faults(kind);
        let fault = faults.first().unwrap_or_else(|| panic!("no fault {kind}\n{}", ended.said));
        assert_eq!(fault["detected_by"], "hardware", "{fault:#}");
        assert_eq!(fault["window"]["wrong"], 0, "{fault:#}");
    }
}

/// A process that was stopped goes on as a zombie of its former self: another has its role by then, and nothing of what it still says counts.
#[test]
fn a_zombie_steps_down_or_is_gone_and_nothing_stale_is_applied() {
    let station = Station::start("zombie", &["--hand", "script:press", "--test-mode"]);
    let roster = hyst_exchange::Roster::open(&station.place()).expect("a roster");
    for role in ["tissue", "haptic", "fluid"] {
        // Replaced while it stands: continued after 2 s, if there is still somebody to continue.
        station.run_ticks(BETWEEN_TICKS);
        let (victim, pid) = station.victim(&format!("{role}:active"));
        station.inject(&format!("stop {victim} --for 2s"));
        station.wait_until_over(pid);
        station.recover();
        // Continued as soon as another one has the role; one that was killed before that is no zombie.
        let (mut lived, mut rounds) = (0, 0);
        while rounds < 3 || lived == 0 {
            rounds += 1;
            assert!(rounds < MOST_ROUNDS, "each {role} was killed before it could go on\n{}", station.said());
            station.run_ticks(BETWEEN_TICKS);
            let (pid, epoch) = station.holder(role);
            let before = STATEFUL.iter().find(|known| known.name() == role).map(|role| (*role, roster.holder(*role)));
            station.signal(pid, Signal::STOP);
            // Somebody takes a role within milliseconds, and who stands for a tenth of a second is killed: no time to ask the supervisor.
            let since = Instant::now();
            while before.map_or(since.elapsed() < ZOMBIE, |(role, tenure)| roster.holder(role) == tenure) {
                assert!(since.elapsed() < RECOVERY_LIMIT, "nobody takes over\n{}", station.said());
                std::thread::yield_now();
            }
            station.signal_if_alive(pid, Signal::CONT);
            station.recover();
            let zombie = || station.processes(role).into_iter().find(|row| row["pid"] == pid && row["state"] != "dead");
            lived += usize::from(zombie().is_some());
            if role != "haptic" {
                // Who has lost the role says so itself: it follows as a spare, or has won the role again.
                let knows = || match zombie() {
                    Some(row) => (row["state"] == if row["active"] == true { "live" } else { "spare" }).then_some(()),
                    None => Some(()),
                };
                assert!(wait_for(RECOVERY_LIMIT, knows).is_some(), "{role}: {}\n{}", station.status(), station.said());
                // Whoever has the role now, the zombie itself not excepted, has it in an epoch that fences what the zombie was.
                assert!(station.holder(role).1 > epoch, "{role}: {}\n{}", station.status(), station.said());
            }
        }
        println!("{lived} of {rounds} lived on as zombies of {role}");
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
}

struct Client(Child);

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.0.kill(); // in the middle of whatever it does
        let _ = self.0.wait();
    }
}

fn start_client(station: &Station) -> Client {
    let heard = station.folder().join("answers");
    let out = std::fs::File::create(&heard).expect("a file for what the client says");
    let mut command = Command::new(binaries().join("misbehaving-client"));
    let client = command.arg(station.name()).stdin(Stdio::null()).stdout(out).spawn().expect("misbehaving-client");
    let client = Client(client);
    let answered = || std::fs::read_to_string(&heard).ok().filter(|text| text.contains("answered"));
    assert!(wait_for(RECOVERY_LIMIT, answered).is_some(), "the client was not answered\n{}", station.said());
    client
}

/// Someone of the lowest priority holds nobody up: not by asking, not by asking too much, not by being starved, not by dying in between.
#[test]
fn a_client_of_the_lowest_priority_that_floods_the_tissue_and_is_killed_costs_the_hand_nothing() {
    let station = Station::start("client", &["--hand", "script:press"]);
    let load = std::cell::RefCell::new(None);
    let begin = |station: &Station| {
        let client = start_client(station);
        *load.borrow_mut() = Some((client, Spinners::start(2)));
    };
    compare("a client that floods the tissue", &station, begin, |_| drop(load.borrow_mut().take()));
    station.recover();
    station.stop().assert_clean();
}
