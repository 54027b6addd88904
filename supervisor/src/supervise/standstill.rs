//! A station on a virtual clock that does not go on is ended, with what can be said of the cause: its log goes with it, and a replay is waited for.

use super::Supervisor;
use crate::journal::{self, Verdict};
use crate::standstill::{Seen, Standstill};
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Role, Slot};

/// Who steps by the virtual clock; the sequencer is the hardware.
const STEPPING: [Role; 5] = [Role::Hardware, Role::Device, Role::Haptic, Role::Tissue, Role::Fluid];
/// The exit code: what was done until then is good.
const NOT_WHOLE: u8 = 3;

impl Supervisor {
    /// Ends the station if it stands still.
    pub(super) fn heed_standstill(&mut self, now_ns: u64) {
        if self.permit.is_none() {
            return;
        }
        let [tick, run_to] = [layout::ENDED_TICK, layout::RUN_TO].map(|word| self.page.load64(word));
        let slots: Vec<Slot> = self.slots.iter().copied().filter(|slot| STEPPING.contains(&slot.role())).collect();
        let steps = slots.iter().filter_map(|slot| Some(self.viewer.slot_page(*slot)?.load64(header::STEPS)));
        let steps = steps.fold(0, u64::wrapping_add);
        let seen = Seen { tick, steps, may_go_on: tick < run_to, held: self.policy.held().next() };
        let Some(standstill) = self.progress.look(now_ns, &seen) else { return };
        let (why, whose) = match standstill {
            Standstill::Held(role) => (format!("{} is held still, no holder survived a step", role.name()), self.who_spoke(role)),
            Standstill::Silent(ns) => {
                let (slot, what) = self.who_does_not_step(&slots);
                (format!("for {} s in all nobody has made a step, {what}", ns / 1_000_000_000), slot)
            }
        };
        let line = journal::last_line_of_any(&self.station, whose);
        let said = if line.is_empty() { "is empty".into() } else { format!("ends with: {line}") };
        let what = if self.progress.is_replay() { "replay" } else { "run" };
        let cure = "do it again, and send the recording to a developer if it ends there once more";
        let message = format!("the {what} ends at tick {tick}: {why}; the log of {whose} {said}; {cure}");
        Verdict { code: NOT_WHOLE, message }.write(&self.station);
        self.page.store32_and_wake(layout::STOP, 1);
        self.page.bump_and_wake(layout::CHANGES);
    }

    /// Of those who do a role's work, one that has printed something.
    fn who_spoke(&self, role: Role) -> Slot {
        let mut slots = self.slots.iter().copied().filter(|slot| slot.role() == role);
        slots.find(|slot| !journal::last_line_of_any(&self.station, *slot).is_empty()).unwrap_or(Slot::first(role))
    }

    /// Whom the others wait for, as far as the pages tell: a role of which nobody is ready, or who was asked for a step and has not made it; else the sequencer.
    fn who_does_not_step(&mut self, slots: &[Slot]) -> (Slot, String) {
        for role in STEPPING {
            let mut of_role = slots.iter().filter(|slot| slot.role() == role && !slot.is_guest()).peekable();
            if of_role.peek().is_some() && !of_role.any(|slot| self.viewer.is_well(*slot)) {
                return (self.who_spoke(role), format!("and no {} is ready", role.name()));
            }
        }
        let sequencer = Slot::first(Role::Hardware);
        let asked = self.viewer.slot_page(sequencer).map_or(Vec::new(), |page| {
            let word = |first: usize, slot: &Slot| page.load32(first + slot.number());
            slots.iter().map(|slot| (*slot, word(header::SHARE_MEMBER, slot), word(header::SHARE_RELEASE, slot))).collect()
        });
        let is_at_work = |(slot, member, release): &(Slot, u32, u32)| {
            let page = self.viewer.slot_page(*slot).filter(|page| page.incarnation() == *member && *release != 0);
            page.is_some_and(|page| page.load64(header::JOINED) as u32 != *release)
        };
        match asked.into_iter().find(is_at_work) {
            Some((slot, ..)) => (slot, format!("and {slot} has not ended its own")),
            None => (sequencer, format!("and {sequencer} asks nobody for one")),
        }
    }
}
