//! What the machine refuses to the engines, said once for all of them.

use super::Supervisor;
use crate::journal;
use hyst_engine::realtime;
use hyst_messages::Slot;
use hyst_messages::page::header;

/// What may be refused: the bit in [`header::REAL_TIME`] that says it was granted, and what is said if it was not.
const RIGHTS: [(u64, &str); 2] = [
    (1, "real time was refused: the engines run as ordinary processes and lose more ticks"),
    (2, "locking the memory was refused: a page that was swapped out may cost ticks"),
];

impl Supervisor {
    /// Looks what an engine that has become ready was granted.
    pub(super) fn note_rights(&mut self, slot: Slot) {
        if !self.real_time || realtime::priority(slot.role()).is_none() {
            return;
        }
        let Some(granted) = self.viewer.slot_page(slot).map(|page| page.load64(header::REAL_TIME)) else { return };
        for (bit, text) in RIGHTS.iter().filter(|(bit, _)| granted & bit == 0) {
            if self.refused & bit == 0 {
                self.refused |= bit;
                journal::say(&self.station, &format!("{text}; `hystation doctor` names the cure"));
            }
        }
    }
}
