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

/// Everyone of the station who is alive, except the caller: by the station page, and by command line for who is not in it.
pub fn living(station: &Station) -> Vec<Living> {
    let mut found: Vec<Living> = match station.open() {
        Ok(page) => (0..SLOTS).filter_map(|slot| slot_alive(&page, slot)).collect(),
        Err(_) => Vec::new(),
    };
    for pid in proc::of_station(station) {
        if let Some(start) = system::process_start(pid)
            && !found.iter().any(|living| living.pid == pid)
        {
            found.push(Living { pid, start, name: "unregistered".into() });
        }
    }
    found.retain(|living| living.pid != std::process::id());
    found
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
