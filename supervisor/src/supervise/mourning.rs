//! What is said and booked of one that has died unasked.

use super::Supervisor;
use crate::fault::Death;
use crate::journal;
use crate::policy::Exit;
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};

impl Supervisor {
    /// One has died unasked; `words` is what it said of that.
    pub(super) fn mourn(&mut self, slot: Slot, incarnation: u32, exit: Exit, death: Death, words: &str) {
        let was_last = slot.role() == Role::Haptic && !self.has_another_servo(slot);
        journal::say(&self.station, &format!("{slot} (incarnation {incarnation}) died, {exit}{words}"));
        if was_last {
            journal::say(&self.station, "no servo is left: the force fades, and comes back with the next one");
        }
        self.faults.died(slot, incarnation, exit, death);
        self.page.fetch_add64(layout::SLOT_RESTARTS + slot.number(), 1);
    }

    /// By the pages: a supervisor that has just begun knows of nobody else that he is ready.
    fn has_another_servo(&mut self, dead: Slot) -> bool {
        let slots = (0..Role::Haptic.slots().1).filter_map(|index| Slot::new(Role::Haptic, index));
        slots.filter(|slot| *slot != dead).any(|slot| self.viewer.is_well(slot))
    }
}
