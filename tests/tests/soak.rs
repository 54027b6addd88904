//! A station in which somebody dies all the time: memory, mappings, open files, shared memory and logs stay flat, for each process that lives on while
//! the others are replaced, and for the station as a whole.
//!
//! Of each role with two processes or more one is *kept* throughout, and so are hardware and guardian: they see every death of the run, and a leak of a page
//! for each of them adds up. Their companions die in turn, each tissue and fluid while it holds the role. Of what there is one alone dies seldom,
//! so that its lives are as long as the run allows. Each life is compared with itself, by medians of some samples: after its warm-up, and in the end.

#[path = "soak/holdings.rs"]
mod holdings;
#[path = "soak/lives.rs"]
mod lives;

use holdings::Holdings;
use hyst_exchange::Roster;
use hyst_messages::Role;
use lives::Lives;
use rustix::process::Signal;
use station_tests::{RECOVERY_LIMIT, Station, wait_for};
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

/// What was seen of a station.
struct Seen {
    lives: Lives,
    /// After each death.
    holdings: Vec<Holdings>,
}

/// Kills one, waits until the station is whole again, and looks at everybody.
fn kill(station: &Station, name: &str, seen: &mut Seen) {
    let (_, pid) = station.victim(name);
    station.signal_if_alive(pid, Signal::KILL);
    station.wait_until_gone(pid);
    station.recover();
    station.pass_ticks(SETTLED_TICKS);
    seen.lives.sample(station);
    seen.holdings.push(Holdings::of(station));
}

fn kill_round(station: &Station, seen: &mut Seen) {
    for (name, role) in OFTEN {
        if let Some(role) = role {
            hand_over(station, name, role);
        }
        kill(station, name, seen);
    }
}

/// Kills until the end.
fn run(station: &Station, begin: Instant, end: Instant, seen: &mut Seen) {
    let moments = SELDOM.len() * SELDOM_TIMES;
    let mut due =
        (1..=moments).map(|n| begin + (end - begin) * n as u32 / (moments as u32 + 1)).zip(SELDOM.iter().cycle()).peekable();
    while Instant::now() < end {
        kill_round(station, seen);
        while let Some((_, name)) = due.next_if(|(at, _)| Instant::now() >= *at && Instant::now() < end) {
            kill(station, name, seen);
        }
    }
}

#[test]
fn nothing_grows_while_everybody_is_replaced_again_and_again() {
    let began = Instant::now();
    let mut station = Station::start("soak", &["--hand", "script:press"]);
    let mut seen = Seen { lives: Lives::new(), holdings: Vec::new() };
    kill_round(&station, &mut seen);
    for name in SELDOM {
        kill(&station, name, &mut seen);
    }
    while began.elapsed() < WARM_UP {
        kill_round(&station, &mut seen);
    }
    let warmed = seen.holdings.len();
    let begin = seen.lives.begin();
    run(&station, begin, began + length().max(2 * (begin - began)), &mut seen);
    let deaths = seen.holdings.len() - warmed;
    let minutes = begin.elapsed().as_secs_f64() / 60.0;
    let mut wrong = seen.lives.verdicts();
    for name in KEPT.iter().filter(|name| seen.lives.longest_min(name) < KEPT_SHARE * minutes) {
        wrong.push(format!("no {name} has lived for a good part of the run: nothing is known of it"));
    }
    println!("{warmed} deaths to warm up, {deaths} more in {minutes:.1} min");
    wrong.extend(holdings::verdict(&seen.holdings[warmed - 1..]));
    if station.keeper(Role::Guardian).map(|guardian| guardian.pid) != Some(station.own_pid()) {
        station.run_again();
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    assert!(!ended.said.contains("which cannot be"), "nobody wrote nonsense into the roster\n{}", ended.said);
    assert!(wrong.is_empty(), "{wrong:#?}\n{}", ended.said);
}
