//! Faults of those who keep the station of a campaign. A guardian that was killed is replaced as an operator would do it: by the same command, which takes
//! the station over from the stand-in, or from nobody if the supervisor died with it.

use super::{LOOK_NS, Session};
use crate::fault::Fault;
use crate::faultfile::{Injection, Keepers};
use crate::keepers;
use hyst_exchange::system;
use hyst_messages::{Role, Slot};

/// How much older than its death the last heartbeat of a supervisor may be, which is the time of its fault, ns.
const SUPERVISOR_BEAT_NS: u64 = 100_000_000;
/// A stand-in is there half a second after the guardian's death, and much later on a machine that compiles beside it.
const STAND_IN_NS: u64 = 30_000_000_000;

impl Session {
    /// Gives when they were struck, ns.
    pub(super) fn hurt_keepers(&mut self, keepers: Keepers, injection: &Injection, moment_ns: u64) -> Result<u64, String> {
        let victims = keepers::hurt(&self.station, keepers, injection.kind, moment_ns)?;
        let struck_ns = system::now_ns(); // within some µs: it returns when it is done
        if keepers == Keepers::Supervisor {
            return Ok(struck_ns);
        }
        let _ = self.child.wait(); // it was killed
        if keepers == Keepers::Guardian {
            self.await_stand_in(victims.first().map_or(0, |guardian| guardian.pid));
        }
        self.child = self.command.spawn().map_err(|error| format!("cannot start `hystation run` again: {error}"))?;
        Ok(struck_ns)
    }

    /// Waits until the supervisor has noticed, or long enough: then the command below fails, and says why.
    fn await_stand_in(&self, guardian: u32) {
        let end_ns = system::now_ns() + STAND_IN_NS;
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
