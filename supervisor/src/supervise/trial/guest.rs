//! The place of a guest after its swap. A guest that was told to go and does not end, because something in the kernel keeps it, has its place, its page and its
//! streams for as long as that lasts: nobody else gets any of them before it is gone, and of its role nothing is swapped. It is no fault of the station.

use crate::journal;
use crate::policy::Action;
use crate::supervise::Supervisor;
use hyst_exchange::{checkpoint, system};
use hyst_messages::{Role, Slot};

impl Supervisor {
    /// Its swap is over: its place is empty from now on, unless it has stayed behind.
    pub(super) fn end_of_guest(&mut self, guest: Slot, promoted: bool) {
        if self.policy.lingering(guest.role()).is_some() {
            let until = "it keeps its place, and no swap of its role begins before it is gone";
            self.note_step(&format!("{guest} was told to go and does not end; {until}"));
        } else {
            self.spawner.vacate(guest);
        }
        if !promoted {
            // States of a line that was left: nobody is to begin from them. Absent is as good.
            let _ = std::fs::remove_file(checkpoint::path(&self.station, guest));
        }
        self.faults.vacated(guest, system::now_ns()); // a fault of the newcomer's is over with the swap
    }

    /// One that had stayed behind has ended.
    pub(in crate::supervise) fn vacate_at_last(&mut self, guest: Slot) {
        self.spawner.vacate(guest);
        self.faults.vacated(guest, system::now_ns());
        journal::say(&self.station, &format!("{guest}, which had been told to go, has ended: its role can be swapped again"));
    }

    /// Guests that a supervisor before this one left behind are told to go, but for that of this role, whose swap goes on.
    pub(super) fn dismiss_guests_but(&mut self, role: Option<Role>) {
        let others = Role::STATEFUL.into_iter().filter(|other| Some(*other) != role);
        let left = others.filter_map(|other| self.policy.lingering(other));
        let actions: Vec<Action> = left.map(|(slot, incarnation)| Action::Dismiss { slot, incarnation }).collect();
        self.act(actions);
    }
}
