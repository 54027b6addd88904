//! Whether /dev/shm was full while a newcomer was on trial. Who touches a page then that there is not dies, nobody connects to anybody, and nothing is compared:
//! of none of that the newcomer is to blame. Promise: who was killed, said what is wrong, or took the room itself by what it printed is not excused by it.

use super::super::{Supervisor, flood};
use super::Trial;
use crate::policy::{Cause, Exit, probation_ns};
use crate::spawn;
use hyst_exchange::system;
use hyst_messages::Slot;

/// What is said of a newcomer for which there was none.
const NO_ROOM: &str = "/dev/shm was full";

/// What is known of the room that there was.
#[derive(Debug, Default)]
pub(super) struct Room {
    /// When there was as good as none last, ns; 0 if there was some all the time.
    full_ns: u64,
    /// What was printed in the newcomer's place took it.
    was_flooded: bool,
    /// Who died last in the newcomer's place was killed: for want of room nobody is.
    was_killed: bool,
}

impl Room {
    /// Takes a look: whether there is as good as none, and whether the newcomer's log is flooded.
    fn take(&mut self, now_ns: u64, is_full: bool, is_flooded: bool) {
        self.was_flooded |= is_flooded;
        self.full_ns = match is_full {
            _ if self.was_flooded => 0,
            true => now_ns,
            false => self.full_ns,
        };
    }
}

impl Trial {
    /// Why it is not to blame, if for want of room: what that leads to shows within the time of a probation.
    pub(super) fn want_of_room(&self, cause: Cause) -> Option<&'static str> {
        let Room { full_ns, was_killed, .. } = self.room;
        let was_full = full_ns != 0 && system::now_ns().saturating_sub(full_ns) < probation_ns(self.role);
        let may_follow = match cause {
            Cause::Died => !was_killed,
            Cause::NotReady | Cause::Late | Cause::Missed | Cause::NotCompared => true,
            Cause::OutOfTolerance => self.silent,
            _ => false,
        };
        (was_full && may_follow).then_some(NO_ROOM)
    }
}

impl Supervisor {
    /// Looks for room while a swap is under way, and whether the newcomer prints so much that there is none.
    pub(super) fn note_room(&mut self, now_ns: u64) {
        if let Some((slot, bytes)) = self.look_for_room(now_ns) {
            self.end_flood(now_ns, slot, bytes);
        }
    }

    /// Gives the newcomer's place and how many bytes its log had, if that was flooded; nobody is blamed here.
    fn look_for_room(&mut self, now_ns: u64) -> Option<(Slot, u64)> {
        let trial = self.trial.as_mut()?;
        let slot = trial.record.slot()?;
        let flood = flood::stem(&self.station, slot);
        trial.room.take(now_ns, spawn::is_full(&self.station), flood.is_some());
        Some((slot, flood?))
    }

    /// Somebody has died, the newcomer perhaps: its memory is not given back yet.
    pub(in crate::supervise) fn note_end(&mut self, slot: Slot, exit: Exit) {
        self.look_for_room(system::now_ns());
        if let Some(trial) = self.trial.as_mut().filter(|trial| trial.record.slot() == Some(slot)) {
            trial.room.was_killed = exit.is_kill();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Spent;
    use super::*;
    use crate::policy::Reason;
    use crate::swap::tests::record;
    use hyst_messages::Role;

    /// What is made of a cause if /dev/shm was full so long ago.
    fn weighed(cause: Cause, ago_ns: u64, [was_killed, silent]: [bool; 2]) -> Reason {
        let mut trial = Trial::begin(record(), Role::Fluid, Spent::default());
        trial.room = Room { full_ns: system::now_ns().saturating_sub(ago_ns), was_killed, ..Room::default() };
        trial.silent = silent;
        trial.weighed(Reason::new(cause, "why"))
    }

    /// Somebody filled /dev/shm, and a good engine that died of that was rolled back as one that dies.
    #[test]
    fn one_that_dies_or_is_not_met_while_shared_memory_is_full_got_no_room_and_one_that_was_killed_or_is_wrong_did_that_itself() {
        let no_room = Reason::new(Cause::NoTime, "why; /dev/shm was full");
        for cause in [Cause::Died, Cause::NotReady, Cause::Late, Cause::Missed, Cause::NotCompared] {
            assert_eq!(weighed(cause, 0, [false; 2]), no_room);
            assert_eq!(weighed(cause, probation_ns(Role::Fluid), [false; 2]).cause, cause, "that was long ago");
        }
        assert_eq!(weighed(Cause::Died, 0, [true, false]).cause, Cause::Died);
        assert_eq!(weighed(Cause::OutOfTolerance, 0, [false, true]), no_room, "nothing came of it");
        for cause in [Cause::OutOfTolerance, Cause::Refused, Cause::Slow, Cause::Hung, Cause::Unasked, Cause::Unfit] {
            assert_eq!(weighed(cause, 0, [false; 2]).cause, cause);
        }
        let trial = Trial::begin(record(), Role::Fluid, Spent::default());
        assert_eq!(trial.weighed(Reason::new(Cause::Died, "why")).cause, Cause::Died, "there was room all the time");
    }

    /// One that had filled it with what it printed had got no room, and was to be swapped in again.
    #[test]
    fn one_whose_log_took_the_room_is_not_excused_for_want_of_it() {
        let died = |looks: &[[bool; 2]]| {
            let mut trial = Trial::begin(record(), Role::Fluid, Spent::default());
            looks.iter().for_each(|[is_full, is_flooded]| trial.room.take(system::now_ns(), *is_full, *is_flooded));
            trial.weighed(Reason::new(Cause::Died, "why")).cause
        };
        assert_eq!(died(&[[false, false], [true, false], [false, false]]), Cause::NoTime, "others filled it");
        for looks in [[[false, true], [true, false]], [[true, false], [false, true]], [[true, true], [true, false]]] {
            assert_eq!(died(&looks), Cause::Died, "{looks:?}");
        }
    }
}
