//! Faults of those who keep the station of a campaign. A guardian that has ended is replaced as an operator would do it: by the same command, which takes
//! the station over from the stand-in, or from nobody if the supervisor died with it.

use super::{LOOK_NS, Session};
use crate::fault::Fault;
use crate::faultfile::{Injection, Keepers};
use crate::keepers::Hurt;
use crate::warn;
use hyst_exchange::system;
use hyst_messages::{Role, Slot};

/// How much older than its death the last heartbeat of a supervisor may be, which is the time of its fault, ns.
const SUPERVISOR_BEAT_NS: u64 = 100_000_000;
/// A guardian that stands stopped is ended after 3 s.
const ENDED_NS: u64 = 30_000_000_000;
/// A stand-in is there half a second after the guardian's death, and much later on a machine that compiles beside it.
const STAND_IN_NS: u64 = 30_000_000_000;

impl Session {
    /// Gives when they were struck, ns.
    pub(super) fn hurt_keepers(&mut self, keepers: Keepers, injection: &Injection, moment_ns: u64) -> Result<u64, String> {
        let hurt = Hurt::at(&self.station, keepers, injection.kind, moment_ns)?;
        // One that was cut short by Ctrl-C is no outcome: whoever waits for its verdict looks for that first.
        injection.for_s.map_or(Ok(true), |for_s| hurt.last_for(&self.station, for_s, &self.interrupted))?;
        if keepers == Keepers::Supervisor || injection.for_s.is_some() && hurt.is_outlived() {
            return Ok(hurt.struck_ns);
        }
        if let Err(reason) = self.await_end() {
            // It was done, and nobody closes it: that is told of as a fault without an end, and not as one that was refused.
            warn(&reason);
            return Ok(hurt.struck_ns);
        }
        if keepers == Keepers::Guardian {
            self.await_stand_in();
        }
        self.child = self.command.spawn().map_err(|error| format!("cannot start `hystation run` again: {error}"))?;
        Ok(hurt.struck_ns)
    }

    /// Waits until the guardian has ended: it was killed, or stands stopped until the supervisor ends it.
    fn await_end(&mut self) -> Result<(), String> {
        let end_ns = system::now_ns() + ENDED_NS;
        while matches!(self.child.try_wait(), Ok(None)) {
            if system::now_ns() >= end_ns {
                return Err(format!("the guardian was hurt, and has not ended within {} s", ENDED_NS / 1_000_000_000));
            }
            system::sleep_ns(LOOK_NS);
        }
        Ok(())
    }

    /// Waits until the supervisor has noticed, or long enough: then the command below fails, and says why.
    fn await_stand_in(&self) {
        let (end_ns, guardian) = (system::now_ns() + STAND_IN_NS, self.child.id());
        let same = || self.viewer.as_ref().is_some_and(|viewer| viewer.page().pid(Slot::first(Role::Guardian)) == guardian);
        while same() && system::now_ns() < end_ns {
            system::sleep_ns(LOOK_NS);
        }
    }
}

/// Whether a closed fault is that of the keepers: of both it is the supervisor's, since who comes after it knows of no other.
pub(super) fn is_of(fault: &Fault, keepers: Keepers, sent_ns: u64) -> bool {
    let role = if keepers == Keepers::Guardian { Role::Guardian } else { Role::Supervisor };
    fault.target == role.name() && fault.injected_ns + SUPERVISOR_BEAT_NS >= sent_ns
}
