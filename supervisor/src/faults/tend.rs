//! What becomes of the faults that are open: whether they came about, whether somebody found them out, and the end of those that have one.

use super::Faults;
use crate::active::active_now;
use crate::fault::Fault;
use crate::faultfile::FaultKind;
use crate::policy::Exit;
use crate::shortage::{self, FILL_WITHIN_NS};
use crate::view::Viewer;
use crate::{mischief, proc, remains};
use hyst_messages::page::header;
use hyst_messages::{Role, Slot};
use rustix::process::Signal;

/// A scheduled fault is waited for from so many ticks before its own on, so that it comes at its phase: the supervisor looks every 5 ms, or 10 where
/// it has much to do.
const AHEAD_TICKS: u64 = 12;
/// An engine that was asked to do wrong for a time may be found out this long after its end, and is replaced then, ns.
const SETTLE_NS: u64 = 20_000_000;
/// The same of one that is gone.
const GONE_NS: u64 = 1_000_000_000;

impl Faults {
    /// Injects what is due (in lock-step [`crate::lockstep`] does that), ends what has lasted long enough, notes who is active.
    pub fn tend(&mut self, now_ns: u64, viewer: &mut Viewer) {
        self.note_active(now_ns, viewer);
        if !viewer.page().is_lockstep() {
            self.inject_due(viewer.page().tick_at(now_ns) + AHEAD_TICKS, viewer);
        }
        self.look_at_the_asked(now_ns, viewer);
        for fault in &mut self.open.faults {
            let Some(slot) = Slot::from_number(fault.slot) else { continue };
            look_at_starts(fault, slot, viewer);
            end_shortage(fault, slot, now_ns, viewer);
            look_at_complaint(fault, slot, now_ns, viewer);
            look_at_files(fault, slot, now_ns, viewer);
            if fault.is(FaultKind::Segfault)
                && let Some(pid) = pid_of(fault, slot, viewer)
            {
                proc::signal(pid, Signal::SEGV); // it had no time to feel the first ones
            }
            if fault.continue_ns.is_some_and(|continue_ns| continue_ns <= now_ns) {
                fault.continue_ns = None;
                if !fault.dead {
                    if let Some(pid) = pid_of(fault, slot, viewer) {
                        proc::signal(pid, Signal::CONT);
                    }
                    fault.manifested = true;
                    fault.over_at(now_ns);
                }
            }
        }
    }

    pub(super) fn note_active(&mut self, now_ns: u64, viewer: &mut Viewer) {
        for role in Role::REPLICATED {
            let device = viewer.slot_page(Slot::first(Role::Device));
            let incarnation = active_now(&self.station, &self.roster, device, role);
            self.active.note(now_ns, role, incarnation);
        }
    }

    /// One goes: what it did as it was asked to is looked at for the last time, whatever it goes of.
    pub fn look_at_the_dead(&mut self, slot: Slot, incarnation: u32, viewer: &mut Viewer) {
        let count =
            viewer.slot_page(slot).filter(|page| page.incarnation() == incarnation).map(|page| page.load64(header::MISCHIEF));
        let of = |fault: &&mut Fault| (fault.slot, fault.incarnation) == (slot.number(), incarnation);
        self.open.faults.iter_mut().filter(of).for_each(|fault| note_done(fault, count.unwrap_or(0)));
    }

    /// One died to whom nothing was done. Where /dev/shm is full meanwhile it died for want of room, and a full /dev/shm is found by nobody else; but for one
    /// whom somebody killed.
    pub(super) fn find_by_death(&mut self, slot: Slot, exit: Exit, at_ns: u64) {
        let is_full = |fault: &&mut Fault| fault.is(FaultKind::ShmFull) && fault.was_full && fault.ballast.is_some();
        let was_killed = exit.is_kill();
        for fault in self.open.faults.iter_mut().filter(is_full).filter(|fault| fault.detected_us.is_none() && !was_killed) {
            fault.found_by(&slot.to_string(), at_ns);
        }
    }

    /// Looks whether the engines that were asked to do wrong do it, whether somebody found them out, and whether it is over.
    fn look_at_the_asked(&mut self, now_ns: u64, viewer: &mut Viewer) {
        let pending = |fault: &Fault| fault.asked.is_some() && !fault.dead && fault.recovered_us.is_none();
        if !self.open.faults.iter().any(pending) {
            return;
        }
        let (charges, _) = mischief::charges(viewer);
        for fault in self.open.faults.iter_mut().filter(|fault| pending(fault)) {
            let Some(((until_ns, _), slot)) = fault.asked.zip(Slot::from_number(fault.slot)) else { continue };
            let present = viewer.page().incarnation(slot) == fault.incarnation;
            if present {
                note_done(fault, mischief::done(viewer, slot));
            }
            // What leaks is found by its growth, and a helper by its own process; that somebody was late once in those seconds is noise.
            let leaks = [FaultKind::LeakMemory, FaultKind::LeakFiles].iter().any(|kind| fault.is(*kind));
            if fault.detected_us.is_none()
                && !leaks
                && fault.thread.is_none()
                && let Some((at_ns, by)) = mischief::first_after(&charges, &fault.kind, fault.incarnation, fault.injected_ns)
            {
                fault.found_by(&by.to_string(), at_ns);
            }
            // Who is gone does no wrong any more. As soon as that is known, most of what was done to it is over with whoever comes after it.
            let lives = present && !viewer.page().is_dead(slot);
            if until_ns != 0 && now_ns >= until_ns + if lives { SETTLE_NS } else { GONE_NS } {
                fault.over_at(until_ns);
            }
        }
    }
}

/// Whether somebody did what it was asked to, once more.
fn note_done(fault: &mut Fault, count: u64) {
    fault.manifested |= fault.asked.is_some_and(|(_, before)| count > before);
}

/// The fault's victim, if it lives.
fn pid_of(fault: &Fault, slot: Slot, viewer: &Viewer) -> Option<u32> {
    let is_it = (viewer.page().incarnation(slot), viewer.page().is_dead(slot)) == (fault.incarnation, false);
    remains::slot_alive(viewer.page(), slot.number()).filter(|_| is_it && !fault.dead).map(|living| living.pid)
}

/// A start that is hindered has come about once the successor says so.
fn look_at_starts(fault: &mut Fault, slot: Slot, viewer: &mut Viewer) {
    if fault.starts_left.is_some() && fault.dead && !fault.manifested {
        fault.manifested = viewer.page().incarnation(slot) > fault.incarnation && mischief::done(viewer, slot) > 0;
    }
}

/// Looks whether a file system is full, from when its time counts; puts back what was lowered, and removes a ballast, when its time is over.
fn end_shortage(fault: &mut Fault, slot: Slot, now_ns: u64, viewer: &Viewer) {
    if let Some((ballast, until_ns)) = &mut fault.ballast {
        let fill_until_ns = fault.injected_ns + FILL_WITHIN_NS;
        if !fault.was_full && now_ns < fill_until_ns.min(*until_ns) && shortage::is_full(ballast) {
            (fault.was_full, fault.manifested) = (true, true);
            let for_ns = until_ns.saturating_sub(fill_until_ns);
            *until_ns = now_ns + for_ns;
            fault.asked = fault.asked.map(|(_, done)| (now_ns + for_ns, done));
        }
        if now_ns >= *until_ns {
            shortage::relieve(ballast);
            fault.ballast = None;
        }
    }
    if fault.asked.is_some_and(|(until_ns, _)| until_ns != 0 && now_ns >= until_ns)
        && let Some(lowered) = fault.lowered.take()
        && let Some(pid) = pid_of(fault, slot, viewer)
    {
        shortage::restore(pid, lowered);
    }
}

/// Looks whether the recorder says that it stands still, whose disk is full: in its page, for whoever keeps the station.
fn look_at_complaint(fault: &mut Fault, slot: Slot, now_ns: u64, viewer: &mut Viewer) {
    let is_open = fault.is(FaultKind::DiskFull) && fault.was_full && fault.detected_us.is_none() && fault.recovered_us.is_none();
    // What one that is dead left are its last words, and speak of its death.
    if !is_open || (viewer.page().incarnation(slot), viewer.page().is_dead(slot)) != (fault.incarnation, false) {
        return;
    }
    if viewer.slot_page(slot).is_some_and(|page| !page.last_words().is_empty()) {
        fault.found_by(&slot.to_string(), now_ns);
    }
}

/// Looks whether one that can open no file was to open the page of a newcomer meanwhile: its own page says when that was last in vain.
fn look_at_files(fault: &mut Fault, slot: Slot, now_ns: u64, viewer: &mut Viewer) {
    let is_open = fault.is(FaultKind::NoFiles) && fault.detected_us.is_none() && fault.recovered_us.is_none();
    if !is_open || viewer.page().incarnation(slot) != fault.incarnation {
        return;
    }
    let in_vain_ns = viewer.slot_page(slot).map_or(0, |page| page.load64(header::UNOPENED_NS));
    if (fault.injected_ns..=now_ns).contains(&in_vain_ns) {
        fault.found_by(&slot.to_string(), in_vain_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::Death;
    use crate::faultfile::Helper;
    use crate::faults::tests::{begin, book};
    use hyst_exchange::{OwnedPage, system};
    use hyst_messages::mischief::{Distrust, Thread};
    use hyst_messages::page::station as layout;

    /// That somebody is late in the seconds until it is found tells nobody of it.
    #[test]
    fn a_helper_that_stands_still_is_found_by_what_its_own_process_says() {
        let (station, mut faults) = book("helper");
        let page = station.open_for_keeping().unwrap();
        let begin = |slot: Slot, incarnation: u32| begin(&station, &page, slot, incarnation);
        let [tissue, fluid] = [Role::Tissue, Role::Fluid].map(Slot::first);
        let (own, other) = (begin(tissue, 7), begin(fluid, 8));
        let mut viewer = Viewer::open(&station).unwrap();
        let fault = faults.start("block", tissue, 7, 1_000);
        (fault.asked, fault.thread) = (Some((0, 0)), Some(Helper::Keeper));
        let say = |by: &OwnedPage, why: u64, of: u64| {
            let at = header::distrusted(0);
            by.store64(at + 1, 2_000);
            by.store64(at + 2, 2_000);
            by.store64(at, why << 32 | of);
        };
        let found = |faults: &Faults| faults.all().map(|fault| fault.detected_by.clone()).collect::<Vec<_>>();
        say(&other, Distrust::Missing as u64, 7);
        say(&own, Thread::Keeper.standstill(), 6);
        assert_eq!(mischief::charges(&mut viewer).1.len(), 0, "of another life");
        say(&own, Thread::Keeper.standstill(), 7);
        faults.look_at_the_asked(3_000, &mut viewer);
        faults.suspected(tissue, 7, 3_000);
        assert_eq!(found(&faults), [""]);
        let (charges, standstills) = mischief::charges(&mut viewer);
        assert!(charges.iter().all(|charge| charge.by == fluid), "it is no charge");
        let said: Vec<_> = standstills.iter().map(|(charge, thread)| (charge.by, *thread)).collect();
        assert_eq!(said, [(tissue, Thread::Keeper)]);
        faults.late(tissue, 7, 5_000, 5_000, Thread::Keeper.name());
        assert_eq!(found(&faults), ["keeper"]);
        assert!(faults.all().all(|fault| fault.detected_us == Some(4.0)), "when it said so");
    }

    #[test]
    fn what_one_did_as_it_was_asked_to_is_read_once_more_as_it_goes() {
        let (station, mut faults) = book("done");
        let slot = Slot::first(Role::Fluid);
        let (page, own) = (station.open_for_keeping().unwrap(), station.create_slot(slot, 7).unwrap());
        page.store32(layout::SLOT_INCARNATION + slot.number(), 7);
        let mut viewer = Viewer::open(&station).unwrap();
        faults.start("poison", slot, 7, 1_000).asked = Some((0, 2));
        faults.start("kill", slot, 7, 2_000).dead = true;
        let mut shown = |incarnation: u32, count: u64| {
            own.store64(header::MISCHIEF, count);
            faults.look_at_the_dead(slot, incarnation, &mut viewer);
            faults.all().map(|fault| fault.manifested).collect::<Vec<_>>()
        };
        assert_eq!(shown(7, 2), [false; 2], "as often as before");
        assert_eq!(shown(6, 3), [false; 2], "another one");
        assert_eq!(shown(7, 3), [true, false]);
    }

    /// The recorder said so to the operator, and the fault was found by nobody.
    #[test]
    fn a_disk_that_is_full_is_found_by_the_recorder_which_says_that_it_stands_still() {
        let (station, mut faults) = book("stands");
        let page = station.open_for_keeping().unwrap();
        let slot = Slot::first(Role::Recorder);
        let own = begin(&station, &page, slot, 7);
        let mut viewer = Viewer::open(&station).unwrap();
        let now_ns = system::now_ns();
        for (incarnation, was_full) in [(7, true), (7, false), (6, true)] {
            faults.start("disk-full", slot, incarnation, now_ns - 3_000_000).was_full = was_full;
        }
        let mut found = |faults: &mut Faults| {
            faults.tend(now_ns, &mut viewer);
            faults.all().map(|fault| (fault.detected_by.clone(), fault.detected_us)).collect::<Vec<_>>()
        };
        let nobody = (String::new(), None);
        assert_eq!(found(&mut faults), vec![nobody.clone(); 3]);
        own.last_words("no room for the recording");
        let recorder = ("recorder".to_string(), Some(3_000.0));
        assert_eq!(found(&mut faults), [recorder, nobody.clone(), nobody], "not before it is full, and of this life alone");
    }

    /// Of 225 that could open no file nobody knew whether they had met anybody whom they were to open.
    #[test]
    fn one_that_can_open_no_file_is_found_by_the_newcomer_that_it_cannot_open() {
        let (station, mut faults) = book("unopened");
        let page = station.open_for_keeping().unwrap();
        let slot = Slot::first(Role::Fluid);
        let own = begin(&station, &page, slot, 7);
        let mut viewer = Viewer::open(&station).unwrap();
        let now_ns = system::now_ns();
        for (kind, incarnation) in [("no-files", 7), ("no-files", 6), ("oom", 7)] {
            faults.start(kind, slot, incarnation, now_ns - 3_000_000);
        }
        let mut found_at = |in_vain_ns: u64| {
            own.store64(header::UNOPENED_NS, in_vain_ns);
            faults.tend(now_ns, &mut viewer);
            faults.all().map(|fault| (fault.detected_by.clone(), fault.detected_us)).collect::<Vec<_>>()
        };
        let nobody = (String::new(), None);
        for other_ns in [0, now_ns - 4_000_000, now_ns + 1_000_000_000] {
            assert_eq!(found_at(other_ns), vec![nobody.clone(); 3], "never, before it, and at a time that is not yet");
        }
        let itself = ("fluid:0".to_string(), Some(2_000.0));
        assert_eq!(found_at(now_ns - 1_000_000), [itself, nobody.clone(), nobody]);
    }

    #[test]
    fn a_shared_memory_that_is_full_is_found_by_who_dies_in_it_of_nothing_else() {
        let (_station, mut faults) = book("want");
        let [tissue, fluid, recorder] = [Role::Tissue, Role::Fluid, Role::Recorder].map(Slot::first);
        for (was_full, ballast) in [(true, Some((std::path::PathBuf::from("/nowhere"), u64::MAX))), (true, None), (false, None)] {
            let fault = faults.start("shm-full", recorder, 7, 1_000);
            (fault.was_full, fault.ballast) = (was_full, ballast);
        }
        faults.start("segfault", tissue, 8, 2_000);
        let mut found_after = |slot: Slot, incarnation: u32, exit: Exit, at_ns: u64| {
            faults.died(slot, incarnation, exit, Death { at_ns, open_ns: None, beat_ns: at_ns });
            let full = faults.all().filter(|fault| fault.is(FaultKind::ShmFull));
            full.map(|fault| (fault.detected_by.clone(), fault.detected_us)).collect::<Vec<_>>()
        };
        let nobody = (String::new(), None);
        assert_eq!(found_after(tissue, 8, Exit::Signal(11), 3_000), vec![nobody.clone(); 3], "of its own fault");
        assert_eq!(found_after(fluid, 9, Exit::Signal(9), 4_000), vec![nobody.clone(); 3], "somebody killed it");
        let by_tissue = (tissue.to_string(), Some(5.0));
        assert_eq!(found_after(tissue, 10, Exit::Code(1), 6_000), [by_tissue.clone(), nobody.clone(), nobody.clone()]);
        assert_eq!(found_after(fluid, 11, Exit::Code(1), 9_000), [by_tissue, nobody.clone(), nobody], "the first of them");
    }
}
