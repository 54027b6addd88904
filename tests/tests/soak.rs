//! A station in which somebody dies all the time: memory, mappings, open files, shared memory and logs stay flat, for each process that lives on while
//! the others are replaced, and for the station as a whole.
//!
//! Of each role with two processes or more one is *kept* throughout, and so are hardware and guardian: they see every death of the run, and a leak of a page
//! for each of them adds up. Their companions die in turn, each tissue and fluid while it holds the role. Of what there is one alone dies seldom,
//! so that its lives are as long as the run allows. Each life is compared with itself, by medians of some samples: after its warm-up, and in the end.

#[path = "soak/lives.rs"]
mod lives;

use hyst_exchange::Roster;
use hyst_messages::Role;
use lives::Lives;
use rustix::process::Signal;
use station_tests::{RECOVERY_LIMIT, Station, wait_for};
use std::path::Path;
use std::time::{Duration, Instant};

/// How long it takes; `HYSTATION_SOAK=30m` (or a number of seconds) makes it longer.
const SOAK: Duration = Duration::from_secs(120);
/// Who dies in each round; the other one of each is kept.
const OFTEN: [(&str, Option<Role>); 4] =
    [("haptic:0", None), ("tissue:0", Some(Role::Tissue)), ("fluid:0", Some(Role::Fluid)), ("collision-worker:0", None)];
/// Who is kept.
const KEPT: [&str; 6] = ["haptic:1", "tissue:1", "fluid:1", "collision-worker:1", "hardware", "guardian"];
/// Who dies in the warm-up, and then at so many moments of the run each: what a kept one keeps of each of those deaths is more than the two open files
/// that it may have more in the end, although the first and the last fall into what the medians are taken of.
const SELDOM: [&str; 4] = ["device", "recorder", "rendering", "supervisor"];
const SELDOM_TIMES: usize = 4;
/// Before this the station is young: allocators fill their pools, rings and histories their length. Each of all has died once by then, too.
const WARM_UP: Duration = Duration::from_secs(20);
/// Ticks between the station's recovery and the next sample: ushers retire the ports of the dead within a few tens.
const SETTLED_TICKS: u64 = 400;
/// Part of the run that somebody of each kept slot must have lived through.
const KEPT_SHARE: f64 = 1.0 / 3.0;
/// What the whole station may have more at the end than when everybody had died once: files, MiB of shared memory.
const ALLOWED_STATION: (f64, f64) = (0.0, 2.0);
/// What logs, journal and the list of faults may grow by for each death, KiB: a dozen lines, and the fault's own.
const ALLOWED_LOG_KIB: f64 = 4.0;
/// How long the clean-up may take that follows a death.
const CLEAN: Duration = Duration::from_secs(30);

/// Files below a folder and what they take, MiB; and beside them what logs, journal and list of faults hold, KiB.
fn files_below(folder: &Path, is_log: bool) -> [f64; 3] {
    use std::os::unix::fs::MetadataExt;
    let mut sum = [0.0; 3];
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Ok(data) = entry.metadata() else { continue };
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_log = is_log || name == "logs" || name.ends_with(".log") || name.ends_with(".jsonl");
        let own = match (data.is_dir(), is_log) {
            (true, _) => files_below(&entry.path(), is_log),
            (false, true) => [0.0, 0.0, data.len() as f64 / 1024.0],
            (false, false) => [1.0, data.blocks() as f64 * 512.0 / f64::from(1 << 20), 0.0],
        };
        sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
    }
    sum
}

/// Files, shared memory and logs of a station.
fn station_use(station: &Station) -> [f64; 3] {
    use std::os::unix::fs::MetadataExt;
    let root = station.place();
    let mut sum = files_below(root.root(), false);
    for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.path() != root.root() && name.contains(station.name()) {
            sum[0] += 1.0;
            sum[1] += entry.metadata().map_or(0.0, |data| data.blocks() as f64 * 512.0 / f64::from(1 << 20));
        }
    }
    sum
}

/// The length of the run.
fn length() -> Duration {
    let Ok(text) = std::env::var("HYSTATION_SOAK") else { return SOAK };
    let (number, unit_s) = match text.strip_suffix('m') {
        Some(minutes) => (minutes, 60),
        None => (text.trim_end_matches('s'), 1),
    };
    Duration::from_secs(unit_s * number.parse::<u64>().expect("HYSTATION_SOAK: 30m, 1800s or 1800"))
}

/// Has the kept one hand the role to its companion, as a holder that stood still for a moment does: so each of them is holder and spare in turn.
fn hand_over(station: &Station, name: &str, role: Role) {
    let (holder, pid) = station.victim(&format!("{}:active", role.name()));
    if holder == name {
        return;
    }
    let roster = Roster::open(&station.place()).expect("the roster");
    let before = roster.holder(role).incarnation;
    station.signal_if_alive(pid, Signal::STOP);
    let taken = wait_for(RECOVERY_LIMIT, || (roster.holder(role).incarnation != before).then_some(()));
    station.signal_if_alive(pid, Signal::CONT);
    assert!(taken.is_some(), "nobody has taken over from {holder}\n{}", station.said());
}

/// Kills one, waits until the station is whole again, and looks at everybody.
fn kill(station: &Station, name: &str, lives: &mut Lives) {
    let (_, pid) = station.victim(name);
    station.signal_if_alive(pid, Signal::KILL);
    station.wait_until_gone(pid);
    station.recover();
    station.pass_ticks(SETTLED_TICKS);
    lives.sample(station);
}

fn kill_round(station: &Station, lives: &mut Lives) -> usize {
    for (name, role) in OFTEN {
        if let Some(role) = role {
            hand_over(station, name, role);
        }
        kill(station, name, lives);
    }
    OFTEN.len()
}

/// Kills until the end; gives the number of deaths.
fn run(station: &Station, begin: Instant, end: Instant, lives: &mut Lives) -> usize {
    let mut deaths = 0;
    let moments = SELDOM.len() * SELDOM_TIMES;
    let mut due =
        (1..=moments).map(|n| begin + (end - begin) * n as u32 / (moments as u32 + 1)).zip(SELDOM.iter().cycle()).peekable();
    while Instant::now() < end {
        deaths += kill_round(station, lives);
        while let Some((_, name)) = due.next_if(|(at, _)| Instant::now() >= *at && Instant::now() < end) {
            kill(station, name, lives);
            deaths += 1;
        }
    }
    deaths
}

#[test]
fn nothing_grows_while_everybody_is_replaced_again_and_again() {
    let began = Instant::now();
    let mut station = Station::start("soak", &["--hand", "script:press"]);
    let mut lives = Lives::new();
    let mut warmed = 0;
    while warmed == 0 || began.elapsed() < WARM_UP {
        warmed += kill_round(&station, &mut lives);
        for name in SELDOM.iter().filter(|_| warmed == OFTEN.len()) {
            kill(&station, name, &mut lives);
        }
    }
    warmed += SELDOM.len();
    let before = station_use(&station);
    let begin = lives.begin();
    let deaths = run(&station, begin, began + length().max(2 * (begin - began)), &mut lives);
    let minutes = begin.elapsed().as_secs_f64() / 60.0;
    let mut later = [0.0; 3];
    let flat = wait_for(CLEAN, || {
        later = station_use(&station);
        (later[0] <= before[0] + ALLOWED_STATION.0 && later[1] <= before[1] + ALLOWED_STATION.1).then_some(())
    });
    println!(
        "files, MiB of shared memory, KiB of logs after {warmed} deaths: {before:.1?}; after {deaths} more in {minutes:.1} min: {later:.1?}"
    );
    let mut wrong = lives.verdicts();
    for name in KEPT.iter().filter(|name| lives.longest_min(name) < KEPT_SHARE * minutes) {
        wrong.push(format!("no {name} has lived for a good part of the run: nothing is known of it"));
    }
    if flat.is_none() {
        wrong.push(format!("the station grew from {before:.1?} to {later:.1?} (files, MiB)"));
    }
    let log_kib = (later[2] - before[2]) / deaths as f64;
    println!("logs, journal and list of faults: {log_kib:.2} KiB for each death");
    if log_kib > ALLOWED_LOG_KIB {
        wrong.push(format!("logs grow by {log_kib:.2} KiB for each death"));
    }
    if station.keeper(Role::Guardian).map(|guardian| guardian.pid) != Some(station.own_pid()) {
        station.run_again();
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert!(wrong.is_empty(), "{wrong:#?}\n{}", ended.said);
}
