//! Supervisor and guardian die, alone and together, again and again, while the scripted hand presses on the tissue: the engines keep their
//! processes and the hand its ticks, and the station can be stopped and reported afterwards. What it costs is judged at the simulated hardware, each kill
//! against as many quiet ticks beside it.

use hyst_exchange::{Roster, Tenure};
use hyst_messages::page::header;
use hyst_messages::{Role, Slot};
use rustix::process::Signal;
use station_tests::beside::Beside;
use station_tests::{RECOVERY_LIMIT, Station, wait_for};

/// Kills of each kind that must count; `HYSTATION_KILLS=100` makes a hundred.
const KILLS: usize = 6;
/// Tries for each that counts: a stall of the host voids the windows that it falls into.
const TRIES: usize = 2;
/// Most rounds of what one test does with the same engines.
const MOST_UNWATCHED: usize = 10;
/// Excess misses per kill that are allowed: nobody who dies here is on the way from hand to force.
const ALLOWED: f64 = 0.1;
/// Engines that may be replaced for a reason of their own: so many, or one in so many rounds.
const MOST_REPLACED: usize = 2;
const ROUNDS_OF_ONE: usize = 20;
/// Who dies.
const KINDS: [(&str, &[Role]); 3] =
    [("supervisor", &[Role::Supervisor]), ("guardian", &[Role::Guardian]), ("both", &[Role::Guardian, Role::Supervisor])];
/// Engines of the default station.
const ENGINES: usize = 13;
/// Ticks for which the tissue must go on without a supervisor.
const UNWATCHED_TICKS: u64 = 400;

fn kills() -> usize {
    std::env::var("HYSTATION_KILLS").ok().and_then(|count| count.parse().ok()).unwrap_or(KILLS)
}

/// Waits until somebody does the work of the killed: for both, a `hystation run` of the same words.
fn replace(station: &mut Station, roles: &[Role], guardian: i32, starts: u64) {
    match roles {
        [Role::Guardian] => {
            let other = || station.keeper(Role::Guardian).filter(|other| other.pid != guardian).map(|_| ());
            assert!(wait_for(RECOVERY_LIMIT, other).is_some(), "no stand-in for guardian {guardian}\n{}", station.events());
        }
        [Role::Supervisor] => station.wait_for_supervisor(starts),
        _ => {
            station.run_again();
            station.wait_for_supervisor(starts);
        }
    }
}

#[test]
fn the_keepers_are_killed_again_and_again_and_the_engines_keep_their_processes_and_ticks() {
    let mut station = Station::start("adopted", &["--hand", "script:press", "--test-mode"]);
    assert_eq!(station.engines().len(), ENGINES, "{}", station.status());
    let mut costs: [Beside; KINDS.len()] = Default::default();
    let (mut killed, mut replaced) = ([0; KINDS.len()], 0);
    let wanted = kills();
    for round in 0..wanted * TRIES {
        for (index, (kind, roles)) in KINDS.into_iter().enumerate() {
            if costs[index].excesses.len() >= wanted {
                continue;
            }
            let before = station.census();
            let guardian = station.keeper(Role::Guardian).expect("a guardian").pid;
            costs[index].compare(&mut station, |station| {
                let starts = station.supervisor_starts();
                station.kill_keepers(roles);
                replace(station, roles, guardian, starts);
            });
            killed[index] += 1;
            replaced += before.assert_untouched(&station, &format!("round {round}: {kind}"), &[]);
        }
    }
    // What a busy machine makes hang is rare; a supervisor that blames whom it adopts would do so in every round.
    assert!(
        replaced <= MOST_REPLACED.max(killed.iter().sum::<usize>() / ROUNDS_OF_ONE),
        "{replaced} engines\n{}",
        station.events()
    );
    for ((kind, _), cost) in KINDS.into_iter().zip(&costs) {
        cost.judge(kind, ALLOWED, wanted, &station);
    }
    station.recover();
    if station.keeper(Role::Guardian).map(|guardian| guardian.pid) != Some(station.own_pid()) {
        station.run_again(); // from a stand-in, which is not the test's to stop
    }
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    // Who died is in the report, or in what was said.
    let supervisors = ended.faults("external").into_iter().filter(|fault| fault["target"] == "supervisor");
    let recovered = supervisors.filter(|fault| fault["recovered_us"].is_number()).count();
    assert_eq!(recovered, killed[0] + killed[2], "{}", ended.said);
    let said = |what: &str| ended.said.lines().filter(|line| line.contains(what)).count();
    assert!(said("the guardian died; a stand-in takes its place") >= killed[1], "{}", ended.said);
    assert!(said("has taken over the station") >= killed[1] + killed[2], "{}", ended.said);
}

/// The holder of the tissue's role, and when its newest state was sent.
fn tissue(station: &Station) -> (Tenure, u64) {
    let tenure = Roster::open(&station.place()).expect("the roster").holder(Role::Tissue);
    let slots = (0..2).filter_map(|index| Slot::new(Role::Tissue, index));
    let mut pages = slots.filter_map(|slot| station.place().read_slot(slot, tenure.incarnation).ok());
    (tenure, pages.next().map_or(0, |page| page.load64(header::VALUE_NS)))
}

/// Kills a tissue, the holder unless the role has moved since it was looked for, and a worker; returns when the other tissue has the role and goes on.
fn kill_unwatched(station: &Station, victims: &[i32], incarnation: u64) {
    victims.iter().for_each(|pid| station.signal(*pid, Signal::KILL));
    let killed_ns = hyst_exchange::system::now_ns();
    let taken = || Some(tissue(station)).filter(|(_, sent_ns)| *sent_ns > killed_ns);
    let taken = wait_for(RECOVERY_LIMIT, || taken().filter(|(holder, _)| u64::from(holder.incarnation) != incarnation));
    let (holder, sent_ns) =
        taken.unwrap_or_else(|| panic!("the spare has not taken the role: {:?}\n{}", tissue(station), station.said()));
    station.pass_ticks(UNWATCHED_TICKS);
    let (later, later_ns) = tissue(station);
    assert!(later.incarnation == holder.incarnation && later_ns > sent_ns, "{later:?} does not go on as {holder:?} did");
}

/// The guardian is held up and the supervisor is dead: nobody says that an engine died, and nobody starts its successor. The spare takes the
/// role all the same, the coordinator computes the share, and the next supervisor finds the dead.
#[test]
fn engines_that_die_while_there_is_no_supervisor_are_stood_in_for_and_replaced_by_the_next_one() {
    let mut station = Station::start("unwatched", &["--hand", "script:press"]);
    let mut cost = Beside::default();
    let wanted = kills().min(MOST_UNWATCHED);
    for _ in 0..wanted * TRIES {
        if cost.excesses.len() >= wanted {
            break;
        }
        let before = station.census();
        let mut victims = Vec::new();
        cost.compare(&mut station, |station| {
            // Who holds the role now: before the control window it may have been the other one.
            victims = vec![station.victim("tissue:active"), station.victim("collision-worker:0")];
            let tissues = station.processes("tissue");
            let incarnation =
                tissues.iter().find(|process| process["pid"] == victims[0].1).and_then(|of| of["incarnation"].as_u64());
            let incarnation = incarnation.expect("the tissue that was looked for");
            let (guardian, starts) = (station.own_pid(), station.supervisor_starts());
            station.signal(guardian, Signal::STOP);
            station.kill_keepers(&[Role::Supervisor]);
            kill_unwatched(station, &victims.iter().map(|(_, pid)| *pid).collect::<Vec<i32>>(), incarnation);
            assert_eq!(station.supervisor_starts(), starts, "there was no supervisor meanwhile");
            station.signal(guardian, Signal::CONT);
            station.wait_for_supervisor(starts);
            station.recover();
        });
        let killed: Vec<i32> = victims.iter().map(|(_, pid)| *pid).collect();
        before.assert_untouched(&station, "beside the two that were killed", &killed);
        let replaced =
            |(name, pid): &(String, i32)| station.engines().iter().any(|engine| engine.name == *name && engine.pid != *pid);
        assert!(victims.iter().all(replaced), "{:?}\n{}", station.engines(), station.said());
    }
    cost.judge("tissue and worker without a supervisor", ALLOWED, wanted, &station);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
    let of = |role: &str| {
        let hit = |fault: &&serde_json::Value| fault["target"].as_str().is_some_and(|name| name.starts_with(role));
        ended.faults("external").into_iter().filter(hit).filter(|fault| fault["recovered_us"].is_number()).count()
    };
    assert!(of("tissue") >= wanted && of("collision-worker") >= wanted, "{}", ended.said);
}
