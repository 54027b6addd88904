//! How a supervisor begins, and begins again after its own death: the engines live on, and what it had begun is finished or undone.

use super::Supervisor;
use crate::fault::Death;
use crate::intent::{Deed, Intent};
use crate::journal;
use crate::policy::{self, Event};
use hyst_exchange::system;
use hyst_messages::page::{ProcessState, header, station as layout};
use hyst_messages::{Role, Slot};

impl Supervisor {
    /// Adopts who lives, finishes or undoes what a supervisor before this one had begun, mourns who died while nobody watched: for the policy that dies
    /// now, so that a death which takes the supervisor along counts as any other. This process began at a time.
    pub(super) fn start(&mut self, begun_ns: u64) {
        let left = self.finish_intent();
        let (mut adopted, mut unseen) = (Vec::new(), Vec::new());
        for slot in self.slots.clone() {
            if let Some(ward) = self.spawner.adopt(slot) {
                adopted.push((slot, ward.incarnation));
                self.watch.add(ward);
            }
        }
        self.end_strays(&adopted);
        let now_ns = system::now_ns();
        for slot in self.slots.clone() {
            let incarnation = self.viewer.page().incarnation(slot);
            if incarnation != 0 && slot.is_guest() && !adopted.contains(&(slot, incarnation)) {
                self.spawner.bury(slot, incarnation);
                self.spawner.vacate(slot);
            } else if incarnation != 0 && !adopted.contains(&(slot, incarnation)) {
                // One that lives and cannot be watched, since its page is damaged, must not go on beside its successor.
                if let Some(living) = crate::remains::slot_alive(self.viewer.page(), slot.number()) {
                    crate::proc::end(Some(slot.role()), living.pid);
                    crate::remains::wait_until_dead(&living);
                }
                // It waits for its successor since before, or died while nobody watched.
                if self.page.load32(layout::SLOT_BOOKED + slot.number()) == incarnation {
                    if slot.role() == Role::Device && !self.faults.knows_dead(slot, incarnation) {
                        let beat_ns = self.last_beat_ns(slot);
                        let exit = crate::spawn::reap_in_slot(&self.page, slot, self.viewer.page().pid(slot));
                        // It is told of after what follows from it was done.
                        self.mourn(slot, incarnation, exit, Death { at_ns: now_ns, open_ns: None, beat_ns }, "");
                    }
                    self.spawner.mark_dead(slot, incarnation);
                    self.spawner.bury(slot, incarnation);
                } else {
                    self.spawner.mark_dead(slot, incarnation);
                    unseen.push((slot, incarnation));
                }
            }
        }
        if self.page.load64(layout::SUPERVISOR_STARTS) > 1 {
            journal::say(&self.station, &format!("the supervisor was restarted and adopted {} engines", adopted.len()));
            self.faults.supervisor_died(self.page.load64(layout::SUPERVISOR_NS), begun_ns, system::now_ns());
            self.cleaner.ask(system::now_ns());
        }
        let is_warm = |(slot, _): &(Slot, u32)| {
            let state = self.viewer.slot_page(*slot).map(|page| page.state());
            slot.is_guest() || state.is_none_or(ProcessState::is_ready)
        };
        let all: Vec<(Slot, u32)> = adopted.iter().chain(&unseen).copied().collect();
        let (adopted, warming) = all.iter().copied().partition(is_warm);
        let actions = policy::step(system::now_ns(), Event::Started { adopted, warming }, &mut self.policy);
        self.act(actions);
        self.tell_how_long_they_lived(&all, now_ns);
        // Before anybody is told to go: a newcomer that holds a role hands it over first.
        self.note_holders(system::now_ns());
        self.say_whom_it_ended(left);
        for (slot, incarnation) in unseen {
            self.dismissed.extend(self.faults.knows_dead(slot, incarnation).then_some(incarnation)); // it was mourned already
            let beat_ns = self.last_beat_ns(slot);
            let exit = crate::spawn::reap_in_slot(&self.page, slot, self.viewer.page().pid(slot));
            self.died(slot, incarnation, exit, Death { at_ns: now_ns, open_ns: None, beat_ns });
        }
        self.resume_swap();
    }

    fn last_beat_ns(&mut self, slot: Slot) -> u64 {
        self.viewer.slot_page(slot).map_or(0, |page| page.load64(header::HEARTBEAT_NS))
    }

    /// By the start of each process and its last beat: one that had served for long before it died unseen had no short life.
    fn tell_how_long_they_lived(&mut self, all: &[(Slot, u32)], now_ns: u64) {
        for (slot, incarnation) in all.iter().copied() {
            let start = self.page.load64(layout::SLOT_START + slot.number());
            let (started_ns, beat_ns) = (system::started_ns(start), self.last_beat_ns(slot));
            if start > 0 && beat_ns > started_ns {
                let ready_ns = now_ns.saturating_sub(beat_ns - started_ns);
                let lived = Event::Lived { slot, incarnation, ready_ns };
                let actions = policy::step(now_ns, lived, &mut self.policy);
                self.act(actions);
            }
        }
    }

    /// What the supervisor before this one had killed, and why, counts as its own deed.
    fn say_whom_it_ended(&mut self, left: Option<Intent>) {
        match left {
            Some(Intent { deed: Deed::Dismiss, incarnation, .. }) => {
                self.dismissed.insert(incarnation);
            }
            Some(Intent { deed: Deed::EndHung, slot, incarnation }) => {
                let beat_ns = self.last_beat_ns(slot);
                let late = Event::HeartbeatLate { slot, incarnation, beat_ns };
                let actions = policy::step(system::now_ns(), late, &mut self.policy);
                self.act(actions);
            }
            _ => {}
        }
    }

    /// Ends processes of this station that no slot knows: a supervisor died between their spawn and their entry in the page, or an engine that had started them
    /// died while nobody watched. What these have started, which live, is theirs.
    fn end_strays(&self, adopted: &[(Slot, u32)]) {
        let starters: Vec<u32> = adopted.iter().map(|(_, incarnation)| *incarnation).collect();
        for living in crate::remains::strays(&self.station, &starters) {
            crate::proc::end(None, living.pid);
            journal::say(&self.station, &format!("process {} belonged to no slot and was ended", living.pid));
        }
    }

    /// Finishes or undoes what a supervisor before this one was about to do when it died, and gives it.
    fn finish_intent(&mut self) -> Option<Intent> {
        let left = Intent::left(&self.page)?;
        let Intent { deed, slot, incarnation } = left;
        let entered = self.viewer.page().incarnation(slot) == incarnation;
        let done = match deed {
            Deed::Spawn if entered => "its start was finished",
            Deed::Spawn => match crate::proc::of_incarnation(&self.station, slot, incarnation) {
                Some(pid) => {
                    self.spawner.enter(slot, incarnation, pid);
                    "its start is finished"
                }
                None => {
                    self.spawner.bury(slot, incarnation);
                    "its start is undone"
                }
            },
            Deed::Kill | Deed::EndHung | Deed::Dismiss => {
                if let Some(living) = crate::remains::slot_alive(self.viewer.page(), slot.number()).filter(|_| entered) {
                    crate::proc::end(Some(slot.role()), living.pid);
                }
                "its end is finished"
            }
            Deed::Bury => {
                self.spawner.bury(slot, incarnation);
                "its burial is finished"
            }
        };
        Intent::clear(&self.page);
        journal::say(
            &self.station,
            &format!("the supervisor died while it was busy with {slot} (incarnation {incarnation}): {done}"),
        );
        Some(left)
    }
}
