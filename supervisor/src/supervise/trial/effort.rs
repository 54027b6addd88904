//! What a newcomer on trial spends of the machine, from the kernel's books: who makes too few steps, or none in time, is slow only if it was let run. Nor is
//! it to blame for steps that it missed, for what could not be compared, or for its silence, while it was kept off its core.

mod leaps;
mod spent;

use super::super::Supervisor;
use super::Trial;
use crate::policy::{Cause, Reason, probation_ns};
use crate::proc::{ThreadFiles, threads};
use crate::suspicion::Thread;
use hyst_exchange::{ReadPage, system};
use hyst_messages::page::{hardware, header};
use hyst_messages::{Role, Slot, TICK_NS};
pub(super) use leaps::Leaps;
pub(super) use spent::{KEPT_OFF_FOR_LATE, Spent, Tenures};
use spent::{KEPT_OFF_FOR_SLOW, LEAST_RATE};
use std::collections::VecDeque;

/// Between two entries, ns.
const ENTRY_NS: u64 = 10_000_000;
/// Entries kept: more than a second of them.
const MOST_ENTRIES: usize = 128;

/// Between two looks at the steps of a newcomer in place, ns.
const RATE_NS: u64 = 900_000_000;
/// Looks in a row at which it is too slow.
const MOST_SLOW: u32 = 2;
/// What is said of one that was kept off its core.
const NO_TIME: &str = "the machine left it no time";
/// What is said where the machine is too slow for the old engine, too.
const TOO_SLOW: &str = "the old engine has no time to spare either";

/// Reads the kernel's books of a process of a role: the thread that makes its steps tells how it does, but of a rendering most is done by the driver's.
fn ran_and_waited_ns(files: &ThreadFiles, role: Role) -> Option<(u64, u64)> {
    if role == Role::Rendering { files.all_ran_and_waited_ns() } else { files.ran_and_waited_ns() }
}

/// What a process has made so far, as its page says.
#[derive(Clone, Copy, Debug, Default)]
struct Made {
    steps: u64,
    /// Steps that it left to ordinary threads, which had too little of its core.
    left: u64,
}

impl Made {
    /// The time for which it was kept from its steps so.
    fn left_ns(self) -> u64 {
        self.left.saturating_mul(TICK_NS)
    }
}

/// The books of one process, kept while it is on trial.
#[derive(Debug)]
pub(super) struct Effort {
    process: u32,
    files: ThreadFiles,
    role: Role,
    /// What it had spent in all when an entry was made; the time that had passed is that of the clock.
    entries: VecDeque<Spent>,
}

impl Effort {
    /// Opens the books; `None` if the process is gone.
    pub(super) fn of(process: u32, role: Role) -> Option<Effort> {
        ThreadFiles::open(process).map(|files| Effort { process, files, role, entries: VecDeque::with_capacity(MOST_ENTRIES) })
    }

    /// Whether a thread of the process waits for a disk now, or for memory that comes from one: for that the kernel's books have no time.
    pub(super) fn waits_for_machine(&self) -> bool {
        let state = |thread: i32| ThreadFiles::of_thread(self.process, thread)?.state();
        threads(self.process).into_iter().any(|thread| state(thread) == Some(Thread::Waiting))
    }

    /// Reads the books: beside what the process's page says, `stalled_ns` is the time for which the host has stood still. A kernel that keeps no books excuses
    /// nobody; the steps count all the same.
    fn read(&self, now_ns: u64, page: Made, stalled_ns: u64) -> Spent {
        let (ran_ns, waited_ns) = ran_and_waited_ns(&self.files, self.role).unwrap_or((0, 0));
        Spent { passed_ns: now_ns, ran_ns, waited_ns: waited_ns + page.left_ns(), steps: page.steps, stalled_ns }
    }

    /// Makes an entry of what is read now, unless the last one is young.
    fn enter(&mut self, now_ns: u64, page: Made, stalled_ns: u64) {
        if self.entries.back().is_some_and(|last| now_ns.saturating_sub(last.passed_ns) < ENTRY_NS) {
            return;
        }
        if self.entries.len() == MOST_ENTRIES {
            self.entries.pop_front();
        }
        self.entries.push_back(self.read(now_ns, page, stalled_ns));
    }

    /// What was spent since a time, or the last entry before it; `None` if the books do not reach back so far.
    pub(super) fn since(&self, time_ns: u64) -> Option<Spent> {
        self.from(self.entries.iter().rev().find(|entry| entry.passed_ns <= time_ns)?)
    }

    /// The same as far as the books reach back.
    fn lately(&self, time_ns: u64) -> Option<Spent> {
        self.since(time_ns).or_else(|| self.from(self.entries.front()?))
    }

    /// The entry of that time, or the first one.
    fn before(&self, time_ns: u64) -> Option<Spent> {
        self.entries.iter().rev().find(|entry| entry.passed_ns <= time_ns).or(self.entries.front()).copied()
    }

    fn from(&self, from: &Spent) -> Option<Spent> {
        self.entries.back().map(|to| to.less(from))
    }
}

impl Trial {
    /// Whether the machine did not let the newcomer run, since then.
    pub(super) fn is_excused(&self, since_ns: u64, kept_off: f64) -> bool {
        let spent = self.effort.as_ref().and_then(|effort| effort.since(since_ns));
        spent.is_some_and(|spent| spent.is_excused(&self.old, kept_off))
    }

    /// The newcomer is told how far it is. Before it may take the role the one beside it has that: what its steps cost can be read then.
    pub(super) fn note_leader(&mut self) {
        let led = self.beside.as_ref().and_then(|effort| effort.lately(self.since_ns));
        self.tenures.led = self.tenures.led.or(led);
    }

    /// What steps cost the old engine. An elder that keeps no line wakes for each and computes none: the dearest reading counts.
    fn old_engine(&self) -> Spent {
        let lately = self.beside.as_ref().and_then(|effort| effort.lately(self.since_ns));
        let read = [self.tenures.led, lately].into_iter().flatten();
        read.max_by(|a, b| a.step_ns().total_cmp(&b.step_ns())).unwrap_or(self.old)
    }

    /// What the old engine spent while it had the role: as an elder it is an ordinary process, which waits for whoever is real time, the newcomer too.
    fn old_holder(&self) -> Spent {
        self.tenures.led.unwrap_or(self.old)
    }

    /// A reason for its end, once the machine and the hand were heard.
    pub(super) fn weighed(&self, reason: Reason) -> Reason {
        match self.want_of_room(reason.cause).or_else(|| self.excuse(reason.cause)) {
            Some(why) => Reason::new(Cause::NoTime, format!("{}; {why}", reason.text)),
            None => reason,
        }
    }

    /// Why it is not to blame. One that missed steps, left too little to compare or was silent got no time if it was kept off its core; what the one beside it
    /// spent tells what the steps cost anybody, and where that one had no time to spare nobody can be in time. So did one that could not be compared because it leapt over ticks that the machine took from it. Nor did one that
    /// was silent while it waited for a disk, or one for which the electrode left no pause. Of a device nothing can be compared before the hand has let go; one
    /// that it let go for as long as a probation lasts has left too little itself.
    fn excuse(&self, cause: Cause) -> Option<&'static str> {
        let old = self.old_engine();
        let spent = self.effort.as_ref().and_then(|effort| effort.lately(self.since_ns));
        let is_kept_off = spent.is_some_and(|spent| spent.is_kept_off(&old));
        let waits = self.waits_ns != 0 && system::now_ns().saturating_sub(self.waits_ns) < probation_ns(self.role);
        match cause {
            Cause::Missed | Cause::NotCompared if self.old_holder().is_full() => Some(TOO_SLOW),
            Cause::Missed if self.tenures.count > 0 => self.tenures.were_cut_short(&old).then_some(NO_TIME),
            Cause::Missed | Cause::NotCompared if is_kept_off => Some(NO_TIME),
            Cause::NotCompared if self.leaps.are_the_machines() => Some(NO_TIME),
            Cause::NotCompared if self.current_ns != 0 => Some("the electrode cut meanwhile"),
            Cause::NotCompared if waits => Some("the hand pressed all the while, and it may push only once that has let go"),
            Cause::OutOfTolerance if self.silent && is_kept_off => Some(NO_TIME),
            Cause::OutOfTolerance if self.at_disk => Some("it waits for a disk"),
            _ => None,
        }
    }
}

impl Supervisor {
    /// What the process in a slot has spent since its start; nothing if it is too young for that to tell anything.
    pub(super) fn spent_by(&mut self, slot: Slot) -> Spent {
        let made = self.made_by(slot);
        let pid = self.viewer.page().pid(slot);
        // Since its start and not since it was seen to be ready: a supervisor that is restarted sees that late.
        let start_ns = system::process_start(pid).map_or(u64::MAX, system::started_ns);
        let passed_ns = system::now_ns().saturating_sub(start_ns);
        let spent = ThreadFiles::open(pid).and_then(|files| ran_and_waited_ns(&files, slot.role()));
        let (ran_ns, waited_ns) = spent.unwrap_or((0, 0));
        let spent = Spent { passed_ns, ran_ns, waited_ns: waited_ns + made.left_ns(), steps: made.steps, stalled_ns: 0 };
        if passed_ns < RATE_NS { Spent::default() } else { spent }
    }

    /// Steps that the process in a slot has made, as its page says.
    pub(in crate::supervise) fn steps_of(&mut self, slot: Slot) -> u64 {
        self.made_by(slot).steps
    }

    fn made_by(&mut self, slot: Slot) -> Made {
        let read = |page: &ReadPage| Made { steps: page.load64(header::STEPS), left: page.load64(header::LEFT) };
        self.viewer.slot_page(slot).map_or(Made::default(), read)
    }

    /// Makes an entry in the books of the newcomer, and of the one that had the role before and works beside it.
    pub(super) fn note_effort(&mut self, now_ns: u64) {
        let Some(trial) = &self.trial else { return };
        let (own, role, incumbent) = (trial.record.slot(), trial.role, trial.record.incumbent);
        let beside = self.slots.iter().copied().find(|slot| self.viewer.page().incarnation(*slot) == incumbent);
        let beside = beside.filter(|_| role.is_replicated());
        let stalled_ns = self.stalled_ns();
        let [own, beside] = [own, beside].map(|slot| slot.map(|slot| (self.made_by(slot), self.viewer.page().pid(slot))));
        let Some(trial) = &mut self.trial else { return };
        for (effort, found) in [(&mut trial.effort, own), (&mut trial.beside, beside)] {
            let Some((made, pid)) = found else { continue };
            if effort.is_none() {
                *effort = Effort::of(pid, role);
            }
            if let Some(effort) = effort {
                effort.enter(now_ns, made, stalled_ns);
            }
        }
    }

    /// The newcomer has the role, or has lost it.
    pub(super) fn note_role(&mut self, holds: bool) {
        let Some(slot) = self.trial.as_ref().and_then(|trial| trial.record.slot()) else { return };
        let (made, stalled_ns) = (self.made_by(slot), self.stalled_ns());
        let Some(trial) = &mut self.trial else { return };
        let loss_ns = trial.old_engine().loss_ns();
        if let Some(effort) = &trial.effort {
            let read = effort.read(system::now_ns(), made, stalled_ns);
            trial.tenures.note(holds, read, effort.before(read.passed_ns.saturating_sub(loss_ns)));
        }
    }

    /// For how long the host has stood still, as the hardware's canaries say, ns.
    fn stalled_ns(&mut self) -> u64 {
        let page = self.viewer.slot_page(Slot::first(Role::Hardware));
        TICK_NS.saturating_mul(page.map_or(0, |page| page.load64(hardware::TOTALS + hardware::Total::Void as usize)))
    }

    /// Whether the newcomer makes its steps.
    pub(super) fn look_at_rate(&mut self, now_ns: u64) {
        let Some(trial) = &mut self.trial else { return };
        let looked_ns = trial.looked_ns;
        if looked_ns != 0 && now_ns.saturating_sub(looked_ns) < RATE_NS {
            return;
        }
        trial.looked_ns = now_ns;
        // The first look, and books that do not reach back so far, tell nothing.
        let Some(spent) = trial.effort.as_ref().and_then(|effort| effort.since(looked_ns)) else { return };
        let (incarnation, old_hz, rate_hz) = (trial.record.incarnation, trial.old.rate_hz(), spent.rate_hz());
        let is_slow = rate_hz < LEAST_RATE * old_hz && !trial.is_excused(looked_ns, KEPT_OFF_FOR_SLOW);
        trial.slow = if is_slow { trial.slow + 1 } else { 0 };
        if trial.slow >= MOST_SLOW {
            let text = format!("it makes {rate_hz:.0} steps a second, the old engine made {old_hz:.0}");
            self.doubt(incarnation, Reason::new(Cause::Slow, text));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::swap::tests::record;

    const MS: u64 = 1_000_000;

    fn spent(ran_ms: u64, waited_ms: u64, steps: u64) -> Spent {
        Spent { passed_ns: 200 * MS, ran_ns: ran_ms * MS, waited_ns: waited_ms * MS, steps, stalled_ns: 0 }
    }

    /// The books of a process that has spent this.
    fn books(spent: Spent) -> Option<Effort> {
        let mut effort = Effort::of(std::process::id(), Role::Fluid).unwrap();
        effort.entries = [Spent::default(), spent].into();
        Some(effort)
    }

    /// What is made of a cause if the newcomer spent this since it was told last how far it is, and this in each of three times that it had the role.
    fn weighed(cause: Cause, own: Spent, tenure: Option<Spent>) -> Cause {
        let mut trial = Trial::begin(record(), Role::Fluid, Spent::default());
        (trial.since_ns, trial.effort, trial.beside) = (0, books(own), books(spent(12, 0, 200)));
        for read in (1..=3).filter_map(|_| tenure) {
            trial.tenures.note(true, Spent::default(), None);
            trial.tenures.note(true, spent(1, 0, 1), None); // told once more
            trial.tenures.note(false, read, None);
            trial.tenures.note(false, spent(1, 0, 1), None);
        }
        trial.weighed(Reason::new(cause, "why")).cause
    }

    #[test]
    fn only_one_that_missed_its_steps_or_was_not_compared_and_was_kept_from_both_got_no_time() {
        for cause in [Cause::Missed, Cause::NotCompared] {
            assert_eq!(weighed(cause, spent(6, 70, 110), None), Cause::NoTime, "kept off its core");
            assert_eq!(weighed(cause, spent(12, 10, 200), None), cause, "it waited as everybody does");
            assert_eq!(weighed(cause, spent(2, 70, 40), None), cause, "it slept, and waited beside");
            assert_eq!(weighed(cause, spent(100, 70, 20), None), cause, "its steps are dear");
        }
        for cause in [Cause::Late, Cause::Slow, Cause::Died, Cause::OutOfTolerance, Cause::NotReady] {
            assert_eq!(weighed(cause, spent(6, 70, 110), Some(spent(6, 70, 110))), cause);
        }
    }

    /// It was said that the newcomer left nothing to compare, of one that nobody had let try.
    #[test]
    fn one_for_which_the_hand_left_no_pause_got_no_time_and_is_not_excused_anything_else() {
        let while_cut = |cause: Cause| {
            let mut trial = Trial::begin(record(), Role::Tissue, Spent::default());
            trial.current_ns = 1;
            trial.weighed(Reason::new(cause, "why")).cause
        };
        assert_eq!(while_cut(Cause::NotCompared), Cause::NoTime);
        for cause in [Cause::Missed, Cause::Died, Cause::OutOfTolerance, Cause::Refused] {
            assert_eq!(while_cut(cause), cause);
        }
    }

    /// A good recorder whose core or disk was away for two seconds was blamed as one that writes nothing.
    #[test]
    fn silence_of_one_that_was_kept_off_its_core_or_waits_for_a_disk_is_excused_and_what_is_wrong_is_not() {
        let weighed = |silent: bool, at_disk: bool, own: Spent| {
            let mut trial = Trial::begin(record(), Role::Recorder, spent(12, 0, 200));
            (trial.since_ns, trial.effort, trial.silent, trial.at_disk) = (0, books(own), silent, at_disk);
            trial.weighed(Reason::new(Cause::OutOfTolerance, "why")).cause
        };
        let (kept_off, let_run) = (spent(6, 70, 110), spent(12, 10, 200));
        assert_eq!([weighed(true, false, kept_off), weighed(true, true, let_run)], [Cause::NoTime; 2]);
        assert_eq!([weighed(true, false, let_run), weighed(false, false, kept_off)], [Cause::OutOfTolerance; 2]);
    }

    /// The hand pressed from before the first force of the motors on, and a good device was to blame that nothing could be compared.
    #[test]
    fn a_device_that_waits_for_a_free_hand_is_not_to_blame_and_one_that_the_hand_left_free_is() {
        let weighed = |cause: Cause, ago_ns: u64| {
            let mut trial = Trial::begin(record(), Role::Device, Spent::default());
            trial.waits_ns = system::now_ns().saturating_sub(ago_ns);
            trial.weighed(Reason::new(cause, "why")).cause
        };
        assert_eq!(weighed(Cause::NotCompared, 0), Cause::NoTime);
        assert_eq!(weighed(Cause::NotCompared, probation_ns(Role::Device)), Cause::NotCompared);
        assert_eq!(weighed(Cause::OutOfTolerance, 0), Cause::OutOfTolerance);
    }

    #[test]
    fn of_one_that_had_the_role_those_times_alone_tell_whether_it_missed_its_steps_by_itself() {
        let busy = spent(6, 70, 110);
        let missed = |tenure: Spent| weighed(Cause::Missed, busy, Some(tenure));
        assert_eq!(missed(spent(12, 0, 110)), Cause::NoTime, "it was in time, again and again");
        assert_eq!(missed(spent(12, 0, 90)), Cause::Missed, "never for long, and nobody kept it off");
        assert_eq!(missed(spent(6, 130, 60)), Cause::NoTime);
        assert_eq!(missed(spent(2, 70, 40)), Cause::Missed, "it slept");
        assert_eq!(
            weighed(Cause::NotCompared, spent(12, 0, 200), Some(busy)),
            Cause::NotCompared,
            "its tenures do not tell that"
        );
    }

    /// A flow of which the one that stood beside it kept no line: its loops cost nothing, and beside that any step is dear.
    #[test]
    fn an_elder_that_computes_nothing_makes_the_newcomers_steps_no_dearer() {
        let mut trial = Trial::begin(record(), Role::Fluid, Spent::default());
        (trial.since_ns, trial.beside) = (0, books(spent(100, 0, 5)));
        trial.note_leader();
        trial.beside = books(spent(1, 0, 5));
        trial.note_leader();
        assert_eq!(trial.tenures.led, Some(spent(100, 0, 5)), "when it had the role first");
        trial.tenures.note(true, Spent::default(), None);
        trial.tenures.note(false, spent(60, 130, 3), None);
        assert_eq!(trial.weighed(Reason::new(Cause::Missed, "why")).cause, Cause::NoTime);
        trial.tenures.led = None;
        assert_eq!(trial.weighed(Reason::new(Cause::Missed, "why")).cause, Cause::Missed, "nothing else is known");
    }

    #[test]
    fn the_books_of_a_living_process_say_what_it_ran_between_two_entries() {
        let mut effort = Effort::of(std::process::id(), Role::Fluid).unwrap();
        let begun_ns = system::now_ns();
        let made = |steps: u64, left: u64| Made { steps, left };
        effort.enter(begun_ns, made(7, 0), MS);
        effort.enter(begun_ns + 1, made(8, 0), MS);
        assert_eq!(effort.entries.len(), 1, "too soon");
        effort.enter(begun_ns + ENTRY_NS, made(9, 50), 3 * MS);
        let spent = effort.since(begun_ns + 5).unwrap();
        assert_eq!((spent.passed_ns, spent.steps, spent.stalled_ns), (ENTRY_NS, 2, 2 * MS));
        assert!(spent.waited_ns >= 50 * MS, "steps that it left to others kept it from them: {spent:?}");
        assert_eq!(effort.since(begun_ns - 1), None, "before the first entry");
        assert_eq!(effort.lately(begun_ns - 1), Some(spent), "as far as they go");
        assert_eq!(effort.before(begun_ns + 5).map(|entry| entry.steps), Some(7));
        assert_eq!(effort.before(begun_ns - 1), effort.before(begun_ns), "the first");
        assert!(Effort::of(u32::MAX, Role::Fluid).is_none());
    }

    #[test]
    fn one_that_sleeps_by_itself_waits_for_no_disk() {
        let mut child = std::process::Command::new("sleep").arg("1000").spawn().unwrap();
        let effort = Effort::of(child.id(), Role::Recorder).unwrap();
        let deadline_ns = system::now_ns() + 60_000_000_000;
        while effort.files.state() != Some(Thread::Sleeping) {
            assert!(system::now_ns() < deadline_ns, "it does not come to sleep");
            system::sleep_ns(MS);
        }
        assert!(!effort.waits_for_machine());
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!effort.waits_for_machine(), "it is gone");
    }
}
