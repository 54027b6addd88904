//! Whether there is current in the electrode while a tissue is swapped. The device says it, from which the tissues have it, and not the newcomer. A newcomer that is
//! not proven is to cut nothing: it is promoted in a pause, and gives the role back at the end of that.

use super::Trial;
use crate::policy::{self, Event};
use crate::supervise::Supervisor;
use hyst_messages::page::{Stage, device};
use hyst_messages::{Role, Slot};

/// A pause in the cutting, ns, after which a tissue is promoted: a hand that only lets go of the pedal between two furrows goes on sooner.
const CALM_NS: u64 = 300_000_000;

impl Trial {
    /// Whether nothing is being cut, and has not been for a while.
    pub(super) fn is_calm(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.current_ns) >= CALM_NS
    }
}

impl Supervisor {
    /// Notes whether there is current, and has a tissue give the role back that has it on probation.
    pub(super) fn note_current(&mut self, now_ns: u64) {
        if self.trial.as_ref().is_none_or(|trial| trial.role != Role::Tissue) {
            return;
        }
        let input = self.viewer.slot_page(Slot::first(Role::Device)).and_then(|page| page.cell(device::INPUT));
        let has_current = input.is_some_and(|(_, input)| input.sample.controls.cuts());
        let Some(trial) = self.trial.as_mut().filter(|_| has_current) else { return };
        trial.current_ns = now_ns;
        let incarnation = trial.record.incarnation;
        if trial.stage == Stage::Trial {
            let actions = policy::step(now_ns, Event::Cuts { incarnation }, &mut self.policy);
            self.act(actions);
        }
    }
}
