//! Who of a station is alive, and the end of what must not be: by process id *and* start time, since ids are used again.

use crate::proc;
use crate::suspicion::Thread;
use hyst_exchange::{Station, StationPage, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, SLOTS, Slot};
use rustix::process::Signal;

/// How long killed processes may take to disappear: tear-down of 1 GB took 0.2 s.
pub const GRACE_NS: u64 = 3_000_000_000;
const POLL_NS: u64 = 5_000_000;

/// A living process of a station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Living {
    /// Process id.
    pub pid: u32,
    /// Start time, clock ticks since boot.
    pub start: u64,
    /// Slot's name, or what it seems to be.
    pub name: String,
}

impl Living {
    /// Whether it is still the same process and alive.
    pub fn is_alive(&self) -> bool {
        system::is_alive(self.pid, self.start)
    }
}

/// Whether a process stands stopped by a signal.
pub fn is_stopped(pid: u32) -> bool {
    proc::ThreadFiles::open(pid).and_then(|files| files.state()) == Some(Thread::Stopped)
}

/// Whether the process that the station page names for the slot is alive.
pub fn slot_alive(page: &StationPage, slot: usize) -> Option<Living> {
    let pid = page.page().load32(layout::SLOT_PID + slot);
    let start = page.page().load64(layout::SLOT_START + slot);
    let name = Slot::from_number(slot).map(|slot| slot.to_string()).unwrap_or_default();
    let living = Living { pid, start, name };
    (pid != 0 && living.is_alive()).then_some(living)
}

/// The guardian of the station, if it lives.
pub fn guardian(station: &Station) -> Option<Living> {
    slot_alive(&station.open().ok()?, Slot::first(Role::Guardian).number())
}

/// The supervisor of the station, if it lives.
pub fn supervisor(station: &Station) -> Option<Living> {
    slot_alive(&station.open().ok()?, Slot::first(Role::Supervisor).number())
}

/// Everyone of the station who is alive, except the caller: by the station page, and who is not in it by the process group of an engine that is, or by what it
/// says itself.
pub fn living(station: &Station) -> Vec<Living> {
    let mut found: Vec<Living> = match station.open() {
        Ok(page) => (0..SLOTS).filter_map(|slot| slot_alive(&page, slot)).collect(),
        Err(_) => Vec::new(),
    };
    let known = found.clone();
    let keepers = [Role::Guardian.name(), Role::Supervisor.name()]; // in a guardian's group others of the user may be
    let leaders: Vec<&Living> = known.iter().filter(|living| !keepers.contains(&living.name.as_str())).collect();
    for pid in proc::of_user().filter(|pid| known.iter().all(|living| living.pid != *pid)) {
        let group = if leaders.is_empty() { None } else { proc::group(pid) };
        let leader = leaders.iter().find(|leader| group == Some(leader.pid));
        if (leader.is_some() || proc::belongs(pid, station))
            && let Some(start) = system::process_start(pid)
        {
            let name = leader.map_or_else(|| "unregistered".into(), |leader| format!("a child of {}", leader.name));
            found.push(Living { pid, start, name });
        }
    }
    found.retain(|living| living.pid != std::process::id());
    found
}

/// Processes of a station that are in no slot and in nobody's group, and that none of these incarnations, which live, has started.
pub fn strays(station: &Station, incarnations: &[u32]) -> Vec<Living> {
    let is_theirs = |pid: u32| proc::started_by(pid, station).is_some_and(|starter| incarnations.contains(&starter));
    living(station).into_iter().filter(|living| living.name == "unregistered" && !is_theirs(living.pid)).collect()
}

/// Waits until a process that was killed is dead, a second at most: the supervisor, which waits, does not beat meanwhile.
pub fn wait_until_dead(living: &Living) {
    let deadline_ns = system::now_ns() + 1_000_000_000;
    while living.is_alive() && system::now_ns() < deadline_ns {
        system::sleep_ns(POLL_NS);
    }
}

/// Waits until none of the station but the guardian lives, or the deadline has passed; true if none lives.
pub fn wait_until_gone(station: &Station, deadline_ns: u64, mut meanwhile: impl FnMut()) -> bool {
    loop {
        meanwhile();
        let left = living(station).iter().any(|living| living.name != Role::Guardian.name());
        if !left || system::now_ns() >= deadline_ns {
            return !left;
        }
        system::sleep_ns(POLL_NS);
    }
}

/// Kills everyone of the station except its guardian and the caller, and waits until they are gone. Gives the names of who had to be
/// killed.
pub fn kill_all(station: &Station, meanwhile: impl FnMut()) -> Vec<String> {
    let victims: Vec<Living> = living(station).into_iter().filter(|living| living.name != Role::Guardian.name()).collect();
    // The supervisor first, or it would start new ones.
    for living in victims.iter().filter(|living| living.name == Role::Supervisor.name() || living.name == "unregistered") {
        proc::signal(living.pid, Signal::KILL);
    }
    for living in &victims {
        // Not demoted: nobody is left whom their tear-down could disturb, and on a busy machine the idle class would not end in time.
        if living.is_alive() {
            proc::signal(living.pid, Signal::KILL);
        }
    }
    if !victims.is_empty() {
        wait_until_gone(station, system::now_ns() + GRACE_NS, meanwhile);
    }
    victims.into_iter().map(|living| living.name).collect()
}

/// Ends everyone of a station, its guardian too, and removes what they leave.
pub fn end_all(station: &Station) {
    kill_all(station, || {});
    if let Some(stand_in) = guardian(station) {
        proc::signal(stand_in.pid, Signal::KILL); // the supervisor had time to start one
        wait_until_dead(&stand_in);
        kill_all(station, || {});
    }
    station.wipe();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spawn::note_exit;
    use std::io::{BufRead, BufReader};
    use std::os::unix::process::CommandExt;
    use std::process::{Child, Command, Stdio};

    fn founded(name: &str) -> Station {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        station
    }

    /// A shell that leads a group and goes on with these words after it has started another program, and the number of that one.
    fn with_started(mark: &str, goes_on: &str) -> (Child, u32) {
        let script = format!("sleep 600 & echo $!; {goes_on}");
        let mut command = Command::new("sh");
        command.args(["-c", &script]).env(proc::MARK, mark).stdin(Stdio::null()).stdout(Stdio::piped()).process_group(0);
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        (child, line.trim().parse().unwrap())
    }

    fn await_end(pid: u32) {
        let until_ns = system::now_ns() + 60_000_000_000;
        while system::process_start(pid).is_some() {
            assert!(system::now_ns() < until_ns, "{pid} lives on");
            system::sleep_ns(POLL_NS);
        }
    }

    fn name_of(station: &Station, pid: u32) -> Option<String> {
        living(station).into_iter().find(|living| living.pid == pid).map(|living| living.name)
    }

    /// It was known by its command line alone, and whoever had become another program had none.
    #[test]
    fn what_an_engine_has_started_is_counted_as_its_child_and_ends_before_the_engine_is_reaped() {
        let station = founded("group");
        let (page, slot) = (station.open_for_keeping().unwrap(), Slot::first(Role::Tissue));
        let (mut engine, started) = with_started("", "wait"); // one that cleans its environment up
        page.store64(layout::SLOT_START + slot.number(), system::process_start(engine.id()).unwrap());
        page.store32(layout::SLOT_PID + slot.number(), engine.id());
        assert_eq!(name_of(&station, engine.id()), Some("tissue:0".into()));
        assert_eq!(name_of(&station, started), Some("a child of tissue:0".into()));
        engine.kill().unwrap();
        await_end(engine.id());
        assert!(system::process_start(started).is_some(), "nobody has ended it yet");
        note_exit(&page, slot.number(), engine.id());
        await_end(started);
        assert_eq!(engine.wait().unwrap().code(), None);
        assert_eq!(living(&station), Vec::<Living>::new());
        station.wipe();
    }

    #[test]
    fn what_a_dead_engine_had_started_is_known_by_its_environment_and_ended_with_the_station() {
        let station = founded("mark");
        let (mut engine, started) = with_started(&proc::mark_of(&station, 7), "exit 0");
        engine.wait().unwrap();
        assert_eq!((name_of(&station, started), proc::started_by(started, &station)), (Some("unregistered".into()), Some(7)));
        assert_eq!(strays(&station, &[7]), Vec::<Living>::new(), "what has left the group of one that lives is no stray");
        assert_eq!(strays(&station, &[6, 70]).iter().map(|stray| stray.pid).collect::<Vec<_>>(), [started]);
        assert_eq!(kill_all(&station, || {}), ["unregistered"]);
        await_end(started);
        assert_eq!(living(&station), Vec::<Living>::new());
        station.wipe();
    }

    /// A shell with the station's name in that variable was killed, and whatever had been started from it.
    #[test]
    fn who_has_the_name_alone_in_its_environment_is_nobody_of_the_station() {
        let station = founded("shell");
        for mark in [station.name(), &format!("{}-b/7", station.name()), &format!("{}/seven", station.name())] {
            let (mut shell, started) = with_started(mark, "wait");
            assert_eq!([shell.id(), started].map(|pid| name_of(&station, pid)), [None, None], "{mark}");
            proc::end_group(shell.id());
            shell.wait().unwrap();
        }
        station.wipe();
    }

    /// `hystation run | tee` has both in one group.
    #[test]
    fn who_is_in_a_keepers_group_is_not_counted() {
        let station = founded("keeper");
        let (page, slot) = (station.open_for_keeping().unwrap(), Slot::first(Role::Guardian));
        let (mut keeper, beside) = with_started("", "wait");
        page.store64(layout::SLOT_START + slot.number(), system::process_start(keeper.id()).unwrap());
        page.store32(layout::SLOT_PID + slot.number(), keeper.id());
        assert_eq!((name_of(&station, keeper.id()), name_of(&station, beside)), (Some("guardian".into()), None));
        proc::end(None, keeper.id());
        await_end(beside); // whoever ends the leader of a group ends all of it
        keeper.wait().unwrap();
        station.wipe();
    }
}
