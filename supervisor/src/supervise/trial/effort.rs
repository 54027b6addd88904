//! What a newcomer on trial spends of the machine, from the kernel's books: who makes too few steps, or none in time, is slow only if it was let run.

use super::super::Supervisor;
use crate::proc::{START_UNIT_NS, ThreadFiles};
use hyst_exchange::system;
use hyst_messages::Slot;
use hyst_messages::page::header;
use std::collections::VecDeque;

/// Between two entries, ns.
const ENTRY_NS: u64 = 10_000_000;
/// Entries kept: more than a second of them.
const MOST_ENTRIES: usize = 128;
/// Parts of the time for which one is ready and not let run, beyond which it is not to blame: for answers that came late now and then, and for making
/// half its steps.
pub(super) const KEPT_OFF_FOR_LATE: f64 = 0.02;
const KEPT_OFF_FOR_SLOW: f64 = 0.3;
/// One that runs for this part of the time, at so many times what a step took the old engine, is slow by itself, whoever keeps it off.
const BUSY: f64 = 0.1;
const COSTLY: f64 = 3.0;

/// Between two looks at the steps of a newcomer in place, ns.
const RATE_NS: u64 = 900_000_000;
/// Part of the old engine's rate that the newcomer must make: a busy host takes its share of both.
const LEAST_RATE: f64 = 0.5;
/// Looks in a row at which it is too slow.
const MOST_SLOW: u32 = 2;

/// What was spent within a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Spent {
    passed_ns: u64,
    /// Processor time, and time in which it was ready and not let run, ns.
    ran_ns: u64,
    waited_ns: u64,
    steps: u64,
}

impl Spent {
    /// Processor time of a step, ns; 0 if there was none.
    pub(super) fn step_ns(&self) -> f64 {
        if self.steps == 0 { 0.0 } else { self.ran_ns as f64 / self.steps as f64 }
    }

    /// Steps a second.
    fn rate_hz(&self) -> f64 {
        self.steps as f64 * 1e9 / self.passed_ns.max(1) as f64
    }

    /// Whether it is the machine that makes it slow; `old_step_ns` is what a step took the old engine, 0 if that is not known.
    pub(super) fn is_excused(&self, old_step_ns: f64, kept_off: f64) -> bool {
        let part = |time_ns: u64| time_ns as f64 / self.passed_ns.max(1) as f64;
        let is_costly = self.ran_ns as f64 > COSTLY * old_step_ns * self.steps as f64;
        part(self.waited_ns) > kept_off && !(part(self.ran_ns) > BUSY && is_costly)
    }
}

/// The books of one process, kept while it is on trial.
#[derive(Debug)]
pub(super) struct Effort {
    files: ThreadFiles,
    /// What it had spent in all when an entry was made; the time that had passed is that of the clock.
    entries: VecDeque<Spent>,
}

impl Effort {
    /// Opens the books; `None` if the process is gone.
    pub(super) fn of(process: u32) -> Option<Effort> {
        ThreadFiles::open(process).map(|files| Effort { files, entries: VecDeque::with_capacity(MOST_ENTRIES) })
    }

    /// Makes an entry, unless the last one is young. `steps` are those that the process has made so far.
    pub(super) fn enter(&mut self, now_ns: u64, steps: u64) {
        if self.entries.back().is_some_and(|last| now_ns.saturating_sub(last.passed_ns) < ENTRY_NS) {
            return;
        }
        if self.entries.len() == MOST_ENTRIES {
            self.entries.pop_front();
        }
        // A kernel that keeps no books excuses nobody; the steps count all the same.
        let (ran_ns, waited_ns) = self.files.ran_and_waited_ns().unwrap_or((0, 0));
        self.entries.push_back(Spent { passed_ns: now_ns, ran_ns, waited_ns, steps });
    }

    /// What was spent since a time, or the last entry before it; `None` if the books do not reach back so far.
    pub(super) fn since(&self, time_ns: u64) -> Option<Spent> {
        let to = self.entries.back()?;
        let from = self.entries.iter().rev().find(|entry| entry.passed_ns <= time_ns)?;
        Some(Spent {
            passed_ns: to.passed_ns - from.passed_ns,
            ran_ns: to.ran_ns.saturating_sub(from.ran_ns),
            waited_ns: to.waited_ns.saturating_sub(from.waited_ns),
            steps: to.steps.saturating_sub(from.steps),
        })
    }
}

impl Supervisor {
    /// What the process in a slot has spent since its start; nothing if it is too young for that to tell anything.
    pub(super) fn spent_by(&mut self, slot: Slot) -> Spent {
        let steps = self.steps_of(slot);
        let pid = self.viewer.page().pid(slot);
        // Since its start and not since it was seen to be ready: a supervisor that is restarted sees that late.
        let start_ns = system::process_start(pid).map_or(u64::MAX, |start| start.saturating_mul(START_UNIT_NS));
        let passed_ns = system::now_ns().saturating_sub(start_ns);
        let spent = ThreadFiles::open(pid).and_then(|files| files.ran_and_waited_ns());
        let (ran_ns, waited_ns) = spent.unwrap_or((0, 0));
        if passed_ns < RATE_NS { Spent::default() } else { Spent { passed_ns, ran_ns, waited_ns, steps } }
    }

    /// Steps that the process in a slot has made, as its page says.
    pub(in crate::supervise) fn steps_of(&mut self, slot: Slot) -> u64 {
        self.viewer.slot_page(slot).map_or(0, |page| page.load64(header::STEPS))
    }

    /// Makes an entry in the newcomer's books.
    pub(super) fn note_effort(&mut self, now_ns: u64) {
        let Some(slot) = self.trial.as_ref().and_then(|trial| trial.record.slot()) else { return };
        let (steps, pid) = (self.steps_of(slot), self.viewer.page().pid(slot));
        let Some(trial) = &mut self.trial else { return };
        if trial.effort.is_none() {
            trial.effort = Effort::of(pid);
        }
        if let Some(effort) = &mut trial.effort {
            effort.enter(now_ns, steps);
        }
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
            self.doubt(incarnation, format!("it makes {rate_hz:.0} steps a second, the old engine made {old_hz:.0}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn one_that_is_not_let_run_is_excused_and_one_whose_steps_cost_more_is_not() {
        let spent = |ran_ms: u64, waited_ms: u64, steps: u64| Spent {
            passed_ns: 200 * MS,
            ran_ns: ran_ms * MS,
            waited_ns: waited_ms * MS,
            steps,
        };
        let old_step_ns = 60e3;
        assert!(!spent(12, 3, 200).is_excused(old_step_ns, KEPT_OFF_FOR_LATE), "it was let run");
        assert!(!spent(1, 3, 0).is_excused(old_step_ns, KEPT_OFF_FOR_LATE), "it sleeps");
        assert!(spent(6, 60, 100).is_excused(old_step_ns, KEPT_OFF_FOR_LATE), "kept off its core");
        assert!(!spent(6, 40, 100).is_excused(old_step_ns, KEPT_OFF_FOR_SLOW), "that alone does not cost half its steps");
        assert!(spent(0, 200, 0).is_excused(old_step_ns, KEPT_OFF_FOR_LATE), "not let run at all");
        assert!(!spent(100, 60, 20).is_excused(old_step_ns, KEPT_OFF_FOR_LATE), "5 ms a step, on a core that others need");
        assert!(!spent(60, 140, 12).is_excused(0.0, KEPT_OFF_FOR_LATE), "of the old one nothing is known");
        assert_eq!((spent(12, 0, 200).step_ns(), spent(12, 0, 200).rate_hz()), (60e3, 1e3));
    }

    #[test]
    fn the_books_of_a_living_process_say_what_it_ran_between_two_entries() {
        let mut effort = Effort::of(std::process::id()).unwrap();
        let begun_ns = system::now_ns();
        effort.enter(begun_ns, 7);
        effort.enter(begun_ns + 1, 8);
        assert_eq!(effort.entries.len(), 1, "too soon");
        effort.enter(begun_ns + ENTRY_NS, 9);
        let spent = effort.since(begun_ns + 5).unwrap();
        assert_eq!((spent.passed_ns, spent.steps), (ENTRY_NS, 2));
        assert_eq!(effort.since(begun_ns - 1), None, "before the first entry");
        assert!(Effort::of(u32::MAX).is_none());
    }
}
