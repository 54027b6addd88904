//! What the supervisor does when the policy says so: spawn, mark dead, kill, give up; and the end of its work.

use super::{STOP_NS, Supervisor};
use crate::fault::finder;
use crate::intent::{Deed, Intent};
use crate::journal::{self, Verdict};
use crate::policy::{self, Action, Event, Exit, Record};
use crate::spawn::SpawnError;
use hyst_exchange::system;
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};
use rustix::process::Signal;

impl Supervisor {
    /// Takes back what a supervisor before this one knew of each slot.
    pub(super) fn recall(&mut self) {
        let now_ns = system::now_ns();
        for slot in self.slots.clone() {
            let word = self.page.load32(layout::SLOT_RECORD + slot.number());
            self.policy.set_record(now_ns, slot, Record::of_word(word));
        }
    }

    pub(super) fn act(&mut self, actions: Vec<Action>) {
        // Before what follows from it is done: the next supervisor may have to go on from here.
        for (slot, record) in self.policy.records() {
            self.page.store32(layout::SLOT_RECORD + slot.number(), record.word());
        }
        for (role, word) in self.policy.ladders() {
            self.page.store32(layout::LADDER + role as usize, word);
        }
        for action in actions {
            match action {
                Action::Spawn { slot } => self.spawn(slot),
                Action::MarkDead { slot, incarnation } => {
                    self.spawner.mark_dead(slot, incarnation);
                    if !self.policy.is_stopping() {
                        self.spawner.bury(slot, incarnation); // at a stop the report still reads the page
                    }
                }
                Action::Dismiss { slot, incarnation } => {
                    self.dismissed.insert(incarnation);
                    self.act(vec![Action::Kill { slot, incarnation }]);
                }
                Action::Kill { slot, incarnation } => {
                    // By the id and start that it was entered with: the page may be damaged, and an id alone may be that of somebody else.
                    if !self.viewer.page().is_dead(slot)
                        && slot.role() != Role::Hardware
                        && let Some(living) = self.spawner.living(slot, incarnation)
                    {
                        let deed = match () {
                            () if self.dismissed.contains(&incarnation) => Deed::Dismiss,
                            () if self.policy.hangs(slot, incarnation) => Deed::EndHung,
                            () => Deed::Kill,
                        };
                        Intent { deed, slot, incarnation }.declare(&self.page);
                        self.spawner.mortality.pass("kill-declared");
                        crate::proc::end(Some(slot.role()), living.pid);
                        self.spawner.mortality.pass("kill-done");
                        // It stands until the death is seen: who kills may die before, and then it is the next one's deed.
                    }
                }
                Action::Mistrust { slot, incarnation, reader } => self.mistrust(slot, incarnation, reader),
                Action::HandOver { role, incarnation } => self.hand_over_role(role, incarnation),
                Action::GoBack { role, ground } => self.go_back(role, ground),
                Action::TryAgain { slot } => {
                    journal::say(&self.station, &format!("{slot} was given up and is tried again"));
                }
                Action::GiveUp { slot, reason, end } => self.give_up(slot, reason, end),
                Action::Vacate { slot } => self.vacate_at_last(slot),
                Action::Told { .. } | Action::Adopt { .. } | Action::Retreat { .. } | Action::EndSwap { .. } => {
                    self.act_on_swap(action)
                }
            }
        }
    }

    /// The watch has killed one that hangs, or is too slow to be in time; when that was seen and its last heartbeat, ns.
    pub(super) fn note_late(&mut self, slot: Slot, incarnation: u32, [at_ns, beat_ns]: [u64; 2], (is_slow, doing): (bool, &str)) {
        if slot.is_guest() && self.dismissed.contains(&incarnation) {
            return; // it was told to go: that it stands still is no news, and no fault of the station
        }
        let (why, by) = match is_slow {
            true => ("works so much that it cannot be in time".into(), finder::PROCESSOR_TIME),
            false => {
                let silent_ms = at_ns.saturating_sub(beat_ns) / 1_000_000;
                (format!("hangs (last heartbeat {silent_ms} ms ago{doing})"), finder::HEARTBEAT)
            }
        };
        let is_on_the_desk = slot.role() == Role::Hardware; // nobody stands in for it
        let end = if is_on_the_desk { "; it is not killed" } else { " and is killed" };
        journal::say(&self.station, &format!("{slot} {why}{end}"));
        self.faults.late(slot, incarnation, at_ns, beat_ns, by);
        let actions = policy::step(at_ns, Event::HeartbeatLate { slot, incarnation, beat_ns }, &mut self.policy);
        self.act(actions);
    }

    fn spawn(&mut self, slot: Slot) {
        let event = match self.spawner.spawn(slot) {
            Ok(ward) => {
                let incarnation = ward.incarnation;
                self.watch.add(ward);
                Event::Spawned { slot, incarnation }
            }
            Err(error) => {
                if !matches!(error, SpawnError::Gone(_)) {
                    journal::say(&self.station, &format!("cannot start {error}"));
                }
                if error.is_want_of_files() {
                    self.faults.want_file(system::now_ns());
                }
                let no_room = matches!(error, SpawnError::Room(..));
                if no_room {
                    self.cleaner.ask(system::now_ns()); // the dead may have what it needs
                }
                Event::SpawnFailed { slot, no_room }
            }
        };
        let actions = policy::step(system::now_ns(), event, &mut self.policy);
        self.act(actions);
    }

    /// Has a process replaced whose readers die: it counts as a fault of its own.
    fn mistrust(&mut self, slot: Slot, incarnation: u32, reader: Slot) {
        let why = format!("{reader} reads it and dies again and again");
        self.replace_unfit(system::now_ns(), (slot, incarnation), &why, finder::READERS, "who reads it dies again and again");
    }

    /// One that lives and works is not to go on: that is said and booked with what found it, and its work is handed over, or its trial ends for this reason.
    pub(super) fn replace_unfit(
        &mut self,
        now_ns: u64,
        (slot, incarnation): (Slot, u32),
        why: &str,
        by: &str,
        reason: &'static str,
    ) {
        journal::say(&self.station, &format!("{slot} (incarnation {incarnation}) is replaced: {why}"));
        self.faults.late(slot, incarnation, now_ns, now_ns, by);
        let actions = policy::step(now_ns, Event::Unfit { slot, incarnation, reason }, &mut self.policy);
        self.act(actions);
    }

    fn give_up(&mut self, slot: Slot, reason: &str, end: Option<u8>) {
        let mut message = format!("{slot} is given up: {reason}; `hystation logs {slot}` has its words");
        let line = journal::last_line(&self.station, slot);
        if !line.is_empty() {
            message.push_str(&format!(" (last: {line})"));
        }
        journal::say(&self.station, &message);
        if let Some(code) = end {
            Verdict { code, message }.write(&self.station);
            self.page.store32_and_wake(layout::STOP, 1);
            self.page.bump_and_wake(layout::CHANGES);
        }
    }

    /// What a process said of its death, or else what it had printed last; who is killed has nothing to say of it.
    pub(super) fn words_of(&mut self, slot: Slot, exit: Exit) -> String {
        let words = self.viewer.slot_page(slot).map(|page| page.last_words()).unwrap_or_default();
        let is_unexplained = words.is_empty() && !exit.is_kill();
        let printed = if is_unexplained { journal::last_line(&self.station, slot) } else { String::new() };
        match (words.is_empty(), printed.is_empty()) {
            (false, _) => format!(": {words}"),
            (true, false) => format!("; it had printed: {printed}"),
            (true, true) => String::new(),
        }
    }

    pub(super) fn finish(&mut self) -> u8 {
        for slot in self.slots.clone() {
            if let Some(living) = crate::remains::slot_alive(self.viewer.page(), slot.number()) {
                journal::say(&self.station, &format!("{slot} did not stop within {} ms and is killed", STOP_NS / 1_000_000));
                crate::proc::signal(living.pid, Signal::KILL);
            }
            self.sample(system::now_ns(), slot, None);
        }
        self.faults.read_ledger(&mut self.viewer);
        self.faults.close_all();
        crate::shortage::relieve_all(&self.station, |_| false);
        self.accounts.write(&self.station);
        self.hand_over();
        self.leave_a_guardian();
        0
    }
}
