//! The supervisor, as its guardian keeps it: started again when it died, ended when it hangs, and given up when it dies at each start.

use super::LOOK_NS;
use crate::journal::{self, Seldom, Verdict};
use crate::name;
use crate::remains::{self, Living};
use crate::watch;
use hyst_engine::Silence;
use hyst_engine::realtime::SUPERVISOR_PRIORITY;
use hyst_exchange::{OwnedPage, Station, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};

/// Between two starts of the supervisor, so that one that cannot start does not take the machine.
const RESTART_NS: u64 = 250_000_000;
/// Lines of a dead supervisor's log that are shown.
const LAST_WORDS: usize = 8;
/// Starts of the supervisor in a row without a sign of life before the station ends. One that works for a moment each time is started as often
/// as it dies: the engines need it for their restarts alone.
const MOST_STARTS: u32 = 10;
/// A supervisor that still beats so long after its start has adopted the engines.
const SIGN_OF_LIFE_NS: u64 = 50_000_000;
/// A supervisor that is silent for longer hangs. It beats every 5 ms.
const LATE_NS: u64 = 3_000_000_000;
/// How long what is left of a dead one may have its lock, ns.
const LEFT_NS: u64 = 60_000_000_000;

/// The supervisor and its starts.
#[derive(Debug)]
pub(super) struct Kept {
    supervisor: Option<Living>,
    starts: u32,
    /// The last one that was found hanging.
    condemned: u32,
    next_start_ns: u64,
    silence: Silence,
    /// Since when there is none and the lock is taken all the same.
    left_since_ns: Option<u64>,
    said_of_header: Seldom,
}

impl Kept {
    /// Whoever lives already.
    pub(super) fn new(station: &Station) -> Kept {
        let silence = Silence::new(system::now_ns(), 2 * LOOK_NS);
        let (supervisor, said_of_header) = (living(station), Seldom::default());
        Kept { supervisor, starts: 0, condemned: 0, next_start_ns: 0, silence, left_since_ns: None, said_of_header }
    }

    /// The dead children were reaped: the supervisor may be one of them.
    pub(super) fn reaped(&mut self) {
        self.supervisor = self.supervisor.take().filter(Living::is_alive);
    }

    /// Whether it has shown no sign of life for longer than one that works does, in time in which the guardian looked.
    pub(super) fn hangs(&self) -> bool {
        self.silence.ns() > LATE_NS
    }

    /// Starts the supervisor if there is none, and ends one that hangs. False when it cannot be kept alive.
    pub(super) fn keep(&mut self, station: &Station, page: &OwnedPage, now_ns: u64) -> bool {
        if page.mend_magic() {
            // Neither a supervisor nor an engine could begin.
            self.said_of_header.say(station, now_ns, journal::STATION_MENDED);
        }
        let beat_ns = page.load64(layout::SUPERVISOR_NS);
        self.silence.look(now_ns, beat_ns);
        if let Some(supervisor) = &self.supervisor {
            if beat_ns > self.next_start_ns.saturating_sub(RESTART_NS) + SIGN_OF_LIFE_NS {
                self.starts = 0;
            }
            if self.hangs() {
                if self.condemned != supervisor.pid {
                    self.condemned = supervisor.pid;
                    let (silent_ms, doing) = (self.silence.ns() / 1_000_000, watch::doing(supervisor.pid));
                    journal::say(station, &format!("the supervisor hangs (silent for {silent_ms} ms{doing}) and is replaced"));
                }
                crate::proc::signal(supervisor.pid, rustix::process::Signal::KILL);
            }
            return true;
        }
        if now_ns < self.next_start_ns {
            return true;
        }
        if self.starts >= MOST_STARTS {
            let message = format!("the supervisor died {MOST_STARTS} times in a row; its last words:\n{}", last_words(station));
            Verdict { code: 1, message }.write(station);
            return false;
        }
        // A guardian before this one may have started one that had not registered when this one looked.
        self.supervisor = living(station);
        if self.supervisor.is_none() && !self.is_left(station, now_ns) {
            self.start(station);
        }
        true
    }

    /// Whether something is left of a dead one that has its lock still, as a thread that waits for a disk, or a child that has no program of its own yet.
    /// Whoever is started meanwhile ends at once, and some of those would end the station.
    fn is_left(&mut self, station: &Station, now_ns: u64) -> bool {
        if !matches!(name::lock(station), Ok(None)) {
            self.left_since_ns = None;
            return false;
        }
        self.silence = Silence::new(now_ns, 2 * LOOK_NS); // nobody is there who could hang
        now_ns.saturating_sub(*self.left_since_ns.get_or_insert(now_ns)) < LEFT_NS
    }

    fn start(&mut self, station: &Station) {
        self.starts += 1;
        // While a swap's elder, ordinary and ahead of all others, keeps the line, a successor had not begun to beat when it was taken for one that hangs.
        let priority = crate::settings::is_real_time(station).then_some(SUPERVISOR_PRIORITY);
        match crate::spawn::start_own(station, "supervise", Role::Supervisor, priority) {
            // One that is dead already has no start time, and is started again.
            Ok(pid) => self.supervisor = system::process_start(pid).map(|start| Living { pid, start, name: "supervisor".into() }),
            Err(error) => journal::say(station, &format!("cannot start the supervisor: {error}")),
        }
        let now_ns = system::now_ns(); // this ordinary process may have waited until it could start the other
        self.next_start_ns = now_ns + RESTART_NS;
        self.silence = Silence::new(now_ns, 2 * LOOK_NS);
    }
}

fn living(station: &Station) -> Option<Living> {
    remains::slot_alive(&station.open().ok()?, Slot::first(Role::Supervisor).number())
}

/// The end of the supervisor's log, which goes with the station.
fn last_words(station: &Station) -> String {
    let log = std::fs::read_to_string(station.log(Slot::first(Role::Supervisor))).unwrap_or_default();
    let lines: Vec<&str> = log.lines().collect();
    lines[lines.len().saturating_sub(LAST_WORDS)..].join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever was started meanwhile ended at once, and ten of them the station, within three seconds.
    #[test]
    fn nobody_is_started_while_what_is_left_of_the_last_one_has_its_lock_but_not_for_ever() {
        let station = Station::named(&format!("t{}-kept-lock", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let mut kept = Kept::new(&station);
        let left = name::lock(&station).unwrap().unwrap();
        assert_eq!([7, 6 + LEFT_NS, 7 + LEFT_NS].map(|now_ns| kept.is_left(&station, now_ns)), [true, true, false]);
        drop(left);
        // A child of another test has it, too, until it executes its program.
        let deadline_ns = system::now_ns() + 60_000_000_000;
        while kept.is_left(&station, 7) {
            assert!(system::now_ns() < deadline_ns, "nobody has it");
            std::thread::yield_now();
        }
        assert_eq!(kept.left_since_ns, None);
        station.wipe();
    }
}
