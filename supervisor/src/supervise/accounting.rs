//! The supervisor's books: what each process did, whether it grows, and the report as it is now, each second and in parts, so that a death never waits for
//! all of it.

use super::Supervisor;
use crate::fault::finder;
use crate::growth::Use;
use crate::journal;
use crate::proc;
use hyst_messages::page::ProcessState;
use hyst_messages::{Role, Slot};

impl Supervisor {
    /// Does one part of the accounts, of which each may take a millisecond or some: a death is not to wait for all of them. False after the last.
    pub(super) fn account(&mut self, now_ns: u64, part: usize) -> bool {
        let after = part.checked_sub(self.slots.len());
        match after {
            None => self.sample_and_measure(now_ns, self.slots[part]),
            Some(0) => {
                self.mend_headers(now_ns);
                self.heed_states(now_ns);
                self.heed_recorder(now_ns);
                self.heed_hand(now_ns);
            }
            Some(1) => self.accounts.write(&self.station),
            Some(2) => {
                journal::keep_small(&self.station, &self.slots);
                self.memory.look();
            }
            Some(3) => self.faults.keep_open(),
            Some(_) => self.hand_over(),
        }
        after.is_none_or(|after| after <= 3)
    }

    pub(super) fn hand_over(&mut self) {
        let report = crate::report::build(&mut self.viewer, &self.accounts, &self.faults, &self.policy);
        crate::report::hand_over(&self.station, &report);
    }

    pub(super) fn sample_and_measure(&mut self, now_ns: u64, slot: Slot) {
        let (pid, dead) = (self.viewer.page().pid(slot), self.viewer.page().is_dead(slot));
        self.sample(now_ns, slot, (!dead).then_some(pid));
        self.measure(now_ns, slot);
    }

    /// Measures the device more often than the others, because nobody has the hand while the system takes back what a device that ends had; and a guest, whose
    /// trial is over before a look in each second has told anything.
    pub(super) fn measure_often(&mut self, now_ns: u64) {
        if self.accounts.growth.is_due_often(now_ns) {
            let guests = Role::STATEFUL.into_iter().filter_map(Slot::guest);
            guests.chain([Slot::first(Role::Device)]).for_each(|slot| self.measure(now_ns, slot));
        }
    }

    /// Replaces a process that lives, is ready and grows without end, before the system kills it.
    fn measure(&mut self, now_ns: u64, slot: Slot) {
        let (pid, dead) = (self.viewer.page().pid(slot), self.viewer.page().is_dead(slot));
        if pid == 0 || dead || !self.policy.is_ready(slot) {
            return;
        }
        let Some(([resident_mib, shared_mib], files)) = proc::resident_and_shared_mib(pid).zip(proc::open_files(pid)) else {
            return;
        };
        let incarnation = self.viewer.page().incarnation(slot);
        let used = Use { own_mib: (resident_mib - shared_mib).max(0.0) as u64, shared_mib: shared_mib as u64, files };
        let grown = self.accounts.growth.sample(slot, incarnation, used);
        if let Some(text) = grown.as_ref().filter(|_| slot.role() == Role::Hardware) {
            // It stands for a thing outside of the station, which nobody here replaces.
            journal::say(&self.station, &format!("{slot} (incarnation {incarnation}) grows: {text}"));
        } else if let Some(text) = grown {
            self.replace_unfit(now_ns, (slot, incarnation), &text, finder::GROWTH, "it grows and grows");
        }
    }

    pub(super) fn sample(&mut self, now_ns: u64, slot: Slot, process: Option<u32>) {
        let incarnation = self.viewer.page().incarnation(slot);
        let Some(page) = self.viewer.slot_page(slot) else {
            return;
        };
        let ready = page.state().is_ready() || page.state() == ProcessState::Stopping;
        self.accounts.sample(now_ns, slot, incarnation, page, process, ready);
    }
}
