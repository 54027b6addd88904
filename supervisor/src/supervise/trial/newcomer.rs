//! Who the newcomer of a swap is as long as it is not proven: what others say of it ends its swap, and what it says of others counts for nothing.

use crate::supervise::Supervisor;
use crate::swap::Record;
use hyst_messages::Slot;

impl Supervisor {
    /// Whether an incarnation is the newcomer of the swap under way, and not yet proven; from when it is ready.
    pub(in crate::supervise) fn is_newcomer(&self, incarnation: u32) -> bool {
        incarnation != 0 && self.unproven().is_some_and(|record| record.incarnation == incarnation)
    }

    /// Whether a slot is that of such a newcomer, from its start on.
    pub(in crate::supervise) fn is_unproven(&self, slot: Slot) -> bool {
        self.unproven().is_some_and(|record| record.slot() == Some(slot))
    }

    fn unproven(&self) -> Option<&Record> {
        self.trial.as_ref().map(|trial| &trial.record).filter(|record| !record.proven)
    }
}
