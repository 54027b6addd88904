//! How a fault begins: whom it hits, at which moment, what is done to them; and how it is undone.

mod again;
mod half;
mod instead;
mod spare;

use super::Faults;
use crate::active::active_now;
use crate::doing::Doing;
use crate::fault::Fault;
use crate::faultfile::{DEFAULT_TIMES, FaultKind, Injection, Target, Which};
use crate::shortage::{self, FILL_WITHIN_NS, Lowered};
use crate::struck::{Hit, NotDone, Struck};
use crate::swap::Record;
use crate::view::Viewer;
use crate::{corrupt, journal, mischief, moment, proc, remains};
use hyst_exchange::system;
use hyst_messages::{Role, SLOTS, Slot};
use rustix::process::Signal;
use std::path::PathBuf;

/// Who is hit is looked up this long before the moment, ns: it is to be who has the role then.
const AIM_NS: u64 = 1_000_000;

/// After bytes were flipped: how long somebody may take to notice before the fault is over with nothing come of it, ns.
const NOTICE_NS: u64 = 1_000_000_000;

/// One process that is hit.
#[derive(Clone, Copy, Debug)]
struct Victim {
    slot: Slot,
    incarnation: u32,
    pid: u32,
    /// How often it had done wrong before.
    done: u64,
}

/// What was done to a victim beside the signal.
#[derive(Debug, Default)]
struct Deed {
    /// When it ends by itself, ns, 0 for never.
    until_ns: Option<u64>,
    lowered: Option<Lowered>,
    ballast: Option<PathBuf>,
    /// It is done with that, whoever notices.
    manifested: bool,
    said: String,
    flips: Vec<corrupt::Flip>,
}

impl Faults {
    /// Injects a fault now, or at its tick if that is near; gives whom it hit, and when.
    pub fn inject(&mut self, injection: &Injection, viewer: &mut Viewer) -> Result<Struck, NotDone> {
        let target = injection.engines()?;
        let kind = injection.kind;
        shortage::check(&self.station, kind)?;
        let at_once = injection.tick == 0 || viewer.page().is_lockstep(); // a virtual clock stands still meanwhile
        let phase_ns = u64::from(injection.phase_us) * 1_000;
        let moment_ns = if at_once { 0 } else { viewer.page().start_of(injection.tick).saturating_add(phase_ns) };
        if moment_ns.saturating_sub(system::now_ns()) <= moment::MOST_AHEAD_NS {
            system::sleep_until_ns(moment_ns.saturating_sub(AIM_NS));
        }
        let victims = self.victims(target, injection, viewer)?;
        if kind == FaultKind::Cont {
            again::check(&victims)?;
        }
        let caution = self.caution(&victims, injection, viewer);
        self.note_active(system::now_ns(), viewer);
        let hinders = kind.mischief().is_some_and(|what| what.is_of_start());
        if hinders {
            // Before its victim dies: whoever comes after it looks for this in its first millisecond.
            for victim in &victims {
                self.ask(victim, injection, system::now_ns().max(moment_ns));
            }
        }
        let send = || victims.iter().map(|victim| strike(victim.pid, kind.signal())).collect::<Vec<bool>>();
        let struck = moment::at(moment_ns, send);
        let is_hit = |index: usize| matches!(&struck, Ok((_, hits)) if hits[index]);
        let (hit, missed): (Vec<_>, Vec<_>) = victims.iter().copied().enumerate().partition(|(index, _)| is_hit(*index));
        let [hit, missed] = [hit, missed].map(|them| them.into_iter().map(|(_, victim)| victim).collect::<Vec<Victim>>());
        if hinders {
            missed.iter().for_each(|victim| mischief::end(&self.page, victim.slot)); // nobody's successor is to be hindered for nothing
        }
        let (now_ns, _) = struck?;
        if !missed.is_empty() {
            return Err(self.note_half(&hit, &missed, injection, now_ns));
        }
        let hits = victims.iter().map(|it| Hit { process: it.slot.to_string(), incarnation: it.incarnation, pid: it.pid });
        let struck = Struck::at(viewer.page(), now_ns, hits.collect());
        if kind == FaultKind::Undo {
            self.undo_all(&victims, injection, now_ns)?;
            return Ok(struck);
        }
        self.do_to_all(&victims, injection, now_ns, target.which == Which::Both)?;
        caution.iter().for_each(|line| journal::say(&self.station, line));
        // Nobody's page has changed yet: those who died are marked as dead by whoever asked for this.
        let doing = Some(Doing::of(&self.station, &self.slots, viewer));
        Ok(Struck { doing, caution, ..struck })
    }

    fn ask(&self, victim: &Victim, injection: &Injection, now_ns: u64) -> Option<u64> {
        mischief::ask(&self.page, victim.slot, victim.incarnation, injection, now_ns)
    }

    /// What is done to a process beside a signal; a file system is filled only for the `first`, since there is one.
    fn deed(&self, victim: &Victim, injection: &Injection, now_ns: u64, first: bool) -> Result<Deed, String> {
        let until_ns = Some(injection.for_s.map_or(0, |for_s| now_ns + (for_s * 1e9) as u64));
        match injection.kind {
            kind @ (FaultKind::Oom | FaultKind::NoFiles) => {
                let is_of = |fault: &Fault| (fault.slot, fault.incarnation) == (victim.slot.number(), victim.incarnation);
                if self.open.faults.iter().any(|fault| is_of(fault) && fault.is(kind) && fault.lowered.is_some()) {
                    return Err(shortage::already(kind, victim.slot));
                }
                let lowered = Some(shortage::lower(victim.pid, kind)?);
                self.ask(victim, injection, now_ns);
                Ok(Deed { until_ns, lowered, manifested: kind == FaultKind::NoFiles, ..Deed::default() })
            }
            kind @ (FaultKind::DiskFull | FaultKind::ShmFull) => {
                let ballast = shortage::ballast(&self.station, kind).filter(|_| first);
                ballast.as_deref().map_or(Ok(()), shortage::fill)?;
                let until_ns = until_ns.map(|until_ns| until_ns + if first { FILL_WITHIN_NS } else { 0 }); // its time begins when it is full
                Ok(Deed { until_ns, ballast, ..Deed::default() })
            }
            FaultKind::Corrupt => {
                let Victim { slot, incarnation, pid, .. } = *victim;
                let (said, flips) = corrupt::corrupt(&self.station, slot, incarnation, pid, injection)?;
                let said = format!(": {said}");
                Ok(Deed { until_ns: Some(now_ns + NOTICE_NS), manifested: true, said, flips, ..Deed::default() })
            }
            _ => Ok(Deed { until_ns: self.ask(victim, injection, now_ns), ..Deed::default() }),
        }
    }

    /// Says the fault, and notes it.
    fn begin(&mut self, victim: &Victim, injection: &Injection, now_ns: u64, deed: Deed) -> &mut Fault {
        let Victim { slot, incarnation, pid, done } = *victim;
        let kind = injection.kind;
        let line = format!("fault {} injected into {slot} (incarnation {incarnation}, pid {pid}){}", kind.name(), deed.said);
        journal::say(&self.station, &line);
        if kind == FaultKind::Cont {
            self.end_stop(victim, now_ns);
        }
        let fault = self.start(kind.name(), slot, incarnation, now_ns);
        fault.asked = deed.until_ns.map(|until_ns| (until_ns, done));
        (fault.output, fault.thread) = (injection.output, injection.thread);
        fault.may_cost_ticks = injection.allowed_misses;
        fault.lowered = deed.lowered;
        fault.ballast = deed.ballast.zip(deed.until_ns);
        (fault.manifested, fault.flips) = (deed.manifested, deed.flips);
        match kind {
            FaultKind::Stop => fault.continue_ns = injection.for_s.map(|for_s| now_ns + (for_s * 1e9) as u64),
            FaultKind::Cont => (fault.manifested, fault.recovered_us) = (true, Some(0.0)),
            FaultKind::HangStart => fault.starts_left = Some(1),
            FaultKind::CrashLoop => fault.starts_left = Some(injection.times.unwrap_or(DEFAULT_TIMES)),
            _ => {}
        }
        fault
    }

    /// Ends what is done to these processes; an error if there is nothing that could end, which says to whom there is.
    fn undo_all(&mut self, victims: &[Victim], injection: &Injection, now_ns: u64) -> Result<(), String> {
        let is_hurt = |slot: &Slot| self.open.faults.iter().any(|fault| fault.slot == slot.number() && is_lasting(fault));
        let slots = (0..SLOTS).filter_map(Slot::from_number);
        let lasting: Vec<Slot> = slots.filter(|slot| is_hurt(slot) || mischief::outlives(&self.page, *slot)).collect();
        if !victims.iter().any(|victim| lasting.contains(&victim.slot)) {
            let whom: Vec<String> = victims.iter().map(|victim| victim.slot.to_string()).collect();
            let others: Vec<String> = lasting.iter().map(Slot::to_string).collect();
            let others = if others.is_empty() { "nor to anybody else".into() } else { format!("but to {}", others.join(", ")) };
            let (name, whom) = (&injection.target, whom.join(", "));
            return Err(format!("{name} is {whom} now, and nothing is being done to it that could end, {others}"));
        }
        victims.iter().for_each(|victim| self.undo(victim, now_ns));
        self.keep_open();
        Ok(())
    }

    /// Ends what is done to a process for a time, and what hinders its start; these faults are over now.
    fn undo(&mut self, victim: &Victim, now_ns: u64) {
        mischief::end(&self.page, victim.slot);
        for fault in self.open.faults.iter_mut().filter(|fault| fault.slot == victim.slot.number()) {
            fault.starts_left = fault.starts_left.map(|_| 0);
            if fault.incarnation == victim.incarnation {
                fault.asked = fault.asked.map(|(_, done)| (now_ns, done));
                // One that was stopped goes on.
                fault.continue_ns = fault.is(FaultKind::Stop).then_some(now_ns).or(fault.continue_ns);
            }
            fault.ballast = fault.ballast.take().map(|(path, _)| (path, now_ns));
        }
    }

    /// Whom a target means now.
    fn victims(&self, target: Target, injection: &Injection, viewer: &mut Viewer) -> Result<Vec<Victim>, String> {
        let none = || format!("no process answers to {:?} now", injection.target);
        let slots = match target.which {
            Which::Slot(slot) => vec![slot],
            Which::Newcomer => vec![self.newcomer(target.role, viewer)?],
            Which::Active => vec![self.of_role(target.role, true, viewer).ok_or_else(none)?],
            Which::Spare => vec![self.of_role(target.role, false, viewer).ok_or_else(none)?],
            Which::Both => {
                let both = [true, false].map(|active| self.of_role(target.role, active, viewer));
                both.into_iter().collect::<Option<Vec<Slot>>>().ok_or_else(none)?
            }
        };
        slots.into_iter().map(|slot| victim(slot, viewer)).collect()
    }

    /// The process that the swap of a role has brought; it may be in its start still where it has a place of its own.
    fn newcomer(&self, role: Role, viewer: &Viewer) -> Result<Slot, String> {
        let none = || format!("no swap of {} is under way whose newcomer is there", role.name());
        let record = Record::under_way(&self.station, role);
        let is_it = |slot: &Slot, record: &Record| slot.is_guest() || viewer.page().incarnation(*slot) == record.incarnation;
        record.and_then(|record| Slot::parse(&record.slot).filter(|slot| is_it(slot, &record))).ok_or_else(none)
    }

    /// The process of a role that does its work, or one that does not; nobody where it is not known who does it. A device that was just started follows no
    /// servo yet: meanwhile it is the one that was followed before.
    fn of_role(&self, role: Role, active: bool, viewer: &mut Viewer) -> Option<Slot> {
        let device = viewer.slot_page(Slot::first(Role::Device));
        let incarnation = match active_now(&self.station, &self.roster, device, role) {
            0 => self.active_incarnation(role),
            incarnation => incarnation,
        };
        if incarnation == 0 {
            return None;
        }
        let wanted = |slot: &Slot| (viewer.page().incarnation(*slot) == incarnation) == active;
        let alive = |slot: &Slot| viewer.page().pid(*slot) != 0 && !viewer.page().is_dead(*slot);
        (0..SLOTS).filter_map(Slot::from_number).filter(|slot| slot.role() == role).filter(alive).find(wanted)
    }

    /// The tick of the next fault of the schedule.
    pub fn next_tick(&self) -> Option<u64> {
        self.schedule.get(self.open.injected).map(|injection| injection.tick)
    }

    /// Injects the faults of the schedule up to a tick.
    pub fn inject_due(&mut self, tick: u64, viewer: &mut Viewer) {
        while let Some(injection) = self.schedule.get(self.open.injected).filter(|injection| injection.tick <= tick).cloned() {
            self.open.injected += 1;
            self.keep_open(); // a supervisor after this one must not do it a second time
            if let Err(NotDone { reason, is_half }) = self.inject(&injection, viewer) {
                let how = if is_half { "was injected by half" } else { "was not injected" };
                journal::say(&self.station, &format!("fault {} {how}: {reason}", injection.kind.name()));
                self.refuse(&injection, &reason);
            }
            // Whoever died of this one is seen first.
            let is_together = |next: &Injection| next.tick == injection.tick || viewer.page().is_lockstep();
            if !self.schedule.get(self.open.injected).is_some_and(is_together) {
                return;
            }
        }
    }
}

/// Whether a fault still does something that can end: to its living victim, to a start, or to a file system.
fn is_lasting(fault: &Fault) -> bool {
    let is_asked = fault.asked.is_some() && !fault.is(FaultKind::Corrupt); // bytes that were flipped stay so
    let to_victim = !fault.dead && fault.recovered_us.is_none() && (fault.is(FaultKind::Stop) || is_asked);
    to_victim || fault.starts_left.is_some_and(|left| left > 0) || fault.ballast.is_some()
}

/// The process in a slot, by its id and its start: an id alone may be another's by now, and the page may be damaged.
fn victim(slot: Slot, viewer: &mut Viewer) -> Result<Victim, String> {
    let living = remains::slot_alive(viewer.page(), slot.number()).filter(|_| !viewer.page().is_dead(slot));
    let living = living.ok_or_else(|| format!("{slot} is not alive now; wait until it is back"))?;
    let (incarnation, done) = (viewer.page().incarnation(slot), mischief::done(viewer, slot));
    Ok(Victim { slot, incarnation, pid: living.pid, done })
}

/// Sends what is to be sent; false if nobody is there to get it.
fn strike(pid: u32, signal: Option<Signal>) -> bool {
    match signal {
        Some(Signal::SEGV) => proc::segfault(pid),
        signal => signal.is_none_or(|signal| proc::signal(pid, signal)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::{begin, book};
    use hyst_messages::page::device as device_page;

    /// It ended with exit code 0 although nothing was undone; by `:active` it may be another process than the one that was hurt.
    #[test]
    fn what_is_undone_must_be_there_and_whoever_has_it_is_named() {
        let (_station, mut faults) = book("undone");
        let [first, second] = [0, 1].map(|index| Slot::new(Role::Tissue, index).unwrap());
        let now_ns = system::now_ns();
        let undo = |faults: &mut Faults, slot: Slot, incarnation: u32| {
            let victim = Victim { slot, incarnation, pid: 0, done: 0 };
            faults.undo_all(&[victim], &Injection::now(FaultKind::Undo, "tissue:active"), now_ns)
        };
        assert!(undo(&mut faults, first, 1).unwrap_err().contains("tissue:active is tissue:0 now"));
        faults.start("corrupt", second, 2, now_ns).asked = Some((now_ns, 0));
        faults.start("kill", first, 3, now_ns).dead = true;
        assert!(undo(&mut faults, second, 2).unwrap_err().contains("nor to anybody else"), "neither of them ends");
        faults.start("stop", first, 1, now_ns);
        assert!(undo(&mut faults, second, 2).unwrap_err().contains("but to tissue:0"));
        assert_eq!(undo(&mut faults, first, 1), Ok(()));
        // What a state was doomed with goes on when its writer has long died, and the fault is closed.
        let doom = Injection::now(FaultKind::Doom, "tissue:1");
        assert_eq!(mischief::ask(&faults.page, second, 2, &doom, now_ns), Some(0));
        assert_eq!(undo(&mut faults, second, 7), Ok(()));
        assert!(undo(&mut faults, second, 7).is_err(), "it has ended");
        assert!(faults.all().any(|fault| fault.kind == "stop" && fault.continue_ns == Some(now_ns)));
    }

    /// The page of a device that had just been started named nobody: `haptic:active` was nobody then, and `haptic:spare` whoever came first, the one that
    /// was followed among them.
    #[test]
    fn while_a_new_device_follows_nobody_yet_it_is_known_who_was_followed_or_else_nobody_is_hit() {
        let (station, mut faults) = book("newborn");
        let page = station.open_for_keeping().unwrap();
        let begin = |slot: Slot, incarnation: u32| begin(&station, &page, slot, incarnation);
        let servos @ [first, second] = [0, 1].map(|index| Slot::new(Role::Haptic, index).unwrap());
        let device = Slot::first(Role::Device);
        let (old, _servos) = (begin(device, 3), [begin(first, 4), begin(second, 5)]);
        let mut viewer = Viewer::open(&station).unwrap();
        let mut found = |faults: &mut Faults| {
            let found = [true, false].map(|active| faults.of_role(Role::Haptic, active, &mut viewer));
            faults.note_active(system::now_ns(), &mut viewer);
            found
        };
        assert_eq!(found(&mut faults), [None, None], "nobody was followed yet");
        old.store64(device_page::SELECTED_INCARNATION, 5);
        assert_eq!(found(&mut faults), [Some(second), Some(first)]);
        let new = begin(device, 6);
        assert_eq!(found(&mut faults), [Some(second), Some(first)], "the new one follows nobody yet");
        new.store64(device_page::SELECTED_INCARNATION, 4);
        assert_eq!(found(&mut faults), servos.map(Some));
    }
}
