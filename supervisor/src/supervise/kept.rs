//! The supervisor's own keeper: a guardian that died is replaced by a stand-in, so that the station ends in order whoever asks for it.

use super::Supervisor;
use crate::journal;
use crate::proc::ThreadFiles;
use crate::remains::{self, Living};
use crate::suspicion::Thread;
use hyst_engine::Silence;
use hyst_exchange::system;
use hyst_messages::{Role, Slot};

/// Between two looks at the guardian.
const LOOK_NS: u64 = 50_000_000;
/// How long a dead guardian is waited for: whoever started it may start it again.
const WAIT_NS: u64 = 500_000_000;
/// Between two starts of a stand-in.
const RETRY_NS: u64 = 1_000_000_000;
/// How long a stand-in may take to be there, ns; one that takes longer hangs. It starts as an ordinary process behind all that is real time.
const START_WITHIN_NS: u64 = 10_000_000_000;
/// How long the last one is waited for.
const LAST_NS: u64 = 2_000_000_000;
/// How long a guardian may be stopped, ns: as long as a supervisor may hang. Nobody else would end it, and it holds the name.
const STOPPED_NS: u64 = 3_000_000_000;

/// What is known of the guardian.
#[derive(Debug, Default)]
pub struct Kept {
    guardian: Option<Living>,
    next_look_ns: u64,
    /// When it was last seen alive, and not stopped.
    well_ns: u64,
    dead_since_ns: Option<u64>,
    stopped_since_ns: Option<u64>,
    next_start_ns: u64,
    /// The stand-in that was started last, as long as it lives, and for how long it has not taken its place.
    started: Option<(Living, Silence)>,
}

impl Supervisor {
    /// Looks whether the guardian lives, and starts a stand-in if it has been dead for a while.
    pub(super) fn tend_guardian(&mut self, now_ns: u64) {
        if now_ns < self.kept.next_look_ns {
            return;
        }
        self.kept.next_look_ns = now_ns + LOOK_NS;
        if self.guardian_lives() {
            self.end_a_stopped_guardian(now_ns);
            if self.kept.dead_since_ns.take().is_some() {
                self.faults.guardian_back(now_ns);
            }
            return;
        }
        if self.kept.dead_since_ns.is_none() {
            self.kept.dead_since_ns = Some(now_ns);
            if !self.viewer.page().is_dead(Slot::first(Role::Guardian)) {
                self.faults.guardian_died(self.kept.well_ns, now_ns); // a stand-in that made room has said so
            }
        }
        let since_ns = self.kept.dead_since_ns.unwrap_or(now_ns);
        if now_ns - since_ns >= WAIT_NS && now_ns >= self.kept.next_start_ns {
            self.start_stand_in(now_ns);
        }
    }

    /// A guardian that was stopped keeps nobody, and a stand-in cannot take the name that it holds.
    fn end_a_stopped_guardian(&mut self, now_ns: u64) {
        let Some(guardian) = &self.kept.guardian else { return };
        let is_stopped = ThreadFiles::open(guardian.pid).and_then(|files| files.state()) == Some(Thread::Stopped);
        let since_ns = *self.kept.stopped_since_ns.get_or_insert(now_ns);
        if !is_stopped {
            (self.kept.stopped_since_ns, self.kept.well_ns) = (None, now_ns);
        } else if now_ns - since_ns > STOPPED_NS {
            journal::say(&self.station, "the guardian was stopped, and is ended so that another can take its place");
            crate::proc::signal(guardian.pid, rustix::process::Signal::KILL);
            self.kept.stopped_since_ns = None;
        }
    }

    /// Whoever is to end the station must be there before the supervisor goes.
    pub(super) fn leave_a_guardian(&mut self) {
        if self.guardian_lives() {
            return;
        }
        self.start_stand_in(system::now_ns());
        let deadline_ns = system::now_ns() + LAST_NS;
        while !self.guardian_lives() && system::now_ns() < deadline_ns {
            system::sleep_ns(hyst_messages::TICK_NS);
        }
    }

    fn guardian_lives(&mut self) -> bool {
        if let Some((stand_in, _)) = &self.kept.started {
            crate::spawn::reap(stand_in.pid); // it has ended, for whatever reason
        }
        self.kept.started = self.kept.started.take().filter(|(stand_in, _)| stand_in.is_alive());
        self.kept.guardian = remains::slot_alive(self.viewer.page(), Slot::first(Role::Guardian).number());
        self.kept.guardian.is_some()
    }

    /// Starts a stand-in, unless one is on its way.
    fn start_stand_in(&mut self, now_ns: u64) {
        if let Some((stand_in, silence)) = &mut self.kept.started {
            if silence.look(now_ns, 0) > START_WITHIN_NS {
                *silence = Silence::new(now_ns, 2 * LOOK_NS);
                journal::say(&self.station, "the stand-in for the guardian hangs in its start, and another one is started");
                crate::proc::signal(stand_in.pid, rustix::process::Signal::KILL);
            }
            return;
        }
        journal::say(&self.station, "the guardian died; a stand-in takes its place");
        self.kept.next_start_ns = now_ns + RETRY_NS;
        match crate::spawn::start_own(&self.station, "stand-in", Role::Guardian, None) {
            Ok(pid) => {
                let living = |start| Living { pid, start, name: "stand-in".into() };
                self.kept.started = system::process_start(pid).map(|start| (living(start), Silence::new(now_ns, 2 * LOOK_NS)));
            }
            Err(error) => journal::say(&self.station, &format!("cannot start a stand-in for the guardian: {error}")),
        }
    }
}
