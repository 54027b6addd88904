//! Leaps of a newcomer that has the role: over ticks for which its steps come too late, each into a new epoch, as the roster says. Who is a little too slow is
//! in time again after each, so that no elder sees it miss many steps in a row, and for a while after each nothing is compared.
//!
//! The machine's share is told apart by what a leap takes: an engine whose step takes no longer than its period leaps only after it was kept from its steps for
//! a whole one. So as many leaps as there were such periods are the machine's, and the rest are the newcomer's own. On a machine that is too slow for the old
//! engine, too, nobody is blamed.

use super::super::Trial;
use super::{Effort, Made, Spent};
use crate::policy::{Cause, Reason};
use crate::supervise::Supervisor;
use crate::swap::judge::FORGET_TICKS;
use hyst_engine::realtime;
use hyst_exchange::system;
use hyst_messages::page::fluid;
use hyst_messages::{MAX_FLUID_STEP_TICKS, Role, TICK_NS};

/// One leap of its own in so many steps is too many: the engines take no more of a machine (`hyst_engine::stateful`).
const STEPS_OF_A_LEAP: u64 = 40;
/// So many at least must be its own at a look: of an ordinary process single ones are seen now and then.
const LEAST_LEAPS: u64 = 3;
/// How long one has the role between two looks, ns: twice that where a step is long.
const LOOK_NS: u64 = 900_000_000;
/// Looks in a row at which there are too many, after which it is slow. Twice the time between two is less than a probation.
const MOST_LOOKS: u32 = 2;

/// How long a newcomer has the role between two looks, ns.
fn look_ns(role: Role) -> u64 {
    if realtime::priority(role).is_some() { LOOK_NS } else { 2 * LOOK_NS }
}

/// The account of a newcomer's leaps.
#[derive(Debug, Default)]
pub(in crate::supervise::trial) struct Leaps {
    /// The books when it took the role, or at the last look since then.
    since: Option<Spent>,
    /// What was spent since the last look in the times before that, and leaps since the last look.
    spent: Spent,
    count: u64,
    /// Looks in a row at which there were too many.
    looks: u32,
    /// What was looked at so far: for how long it had the role, ns; all leaps, and its own.
    held_ns: u64,
    all: u64,
    own: u64,
}

impl Leaps {
    /// The newcomer has the role, or has it no more.
    fn hold(&mut self, holds: bool, read: Spent) {
        match self.since.take() {
            Some(since) if !holds => self.spent = self.spent.and(&read.less(&since)),
            before => self.since = before.or(holds.then_some(read)),
        }
    }

    fn is_due(&self, now_ns: u64, look_ns: u64) -> bool {
        self.since.is_some_and(|since| self.spent.passed_ns + now_ns.saturating_sub(since.passed_ns) >= look_ns)
    }

    /// Looks at what was counted since the last look; why the newcomer is slow, if it is. `leap_ns`: for how long one must have been kept from its steps for
    /// each leap, at least. `old`: what the old engine spent while it had the role.
    fn look(&mut self, read: Spent, old: &Spent, leap_ns: u64) -> Option<String> {
        let since = self.since?;
        self.since = Some(read);
        let (spent, count) = (std::mem::take(&mut self.spent).and(&read.less(&since)), std::mem::take(&mut self.count));
        let own = count.saturating_sub((spent.waited_ns + spent.stalled_ns) / leap_ns.max(1));
        (self.held_ns, self.all, self.own) = (self.held_ns + spent.passed_ns, self.all + count, self.own + own);
        // Without the kernel's books nobody knows what the machine took.
        let is_known = spent.ran_ns > 0 && !old.is_full();
        let is_many = own >= LEAST_LEAPS && own * STEPS_OF_A_LEAP >= spent.steps;
        self.looks = if is_known && is_many { self.looks + 1 } else { 0 };
        if self.looks < MOST_LOOKS {
            return None;
        }
        let (all, held_s, machines) = (self.all, self.held_ns as f64 * 1e-9, self.all - self.own);
        Some(format!(
            "its steps come too late: it leapt over ticks {all} times in {held_s:.1} s, {machines} of them for the machine"
        ))
    }

    /// Whether it is for leaps that little could be compared, most of which the machine explains.
    pub(super) fn are_the_machines(&self) -> bool {
        let forgotten_ns = self.all.saturating_mul(FORGET_TICKS * TICK_NS);
        self.all > 0 && forgotten_ns >= self.held_ns / 2 && self.own <= self.all / 2
    }
}

impl Effort {
    /// The books as they tell of leaps: an ordinary process computes its steps with several threads, and the first one waits for all.
    fn read_of_all(&self, now_ns: u64, page: Made, stalled_ns: u64) -> Spent {
        let read = self.read(now_ns, page, stalled_ns);
        if realtime::priority(self.role).is_some() {
            return read;
        }
        let waited_ns = self.files.all_ran_and_waited_ns().map_or(read.waited_ns, |(_, waited_ns)| waited_ns + page.left_ns());
        Spent { waited_ns, ..read }
    }
}

impl Supervisor {
    /// The books of the newcomer as they are now.
    fn read_newcomer(&mut self) -> Option<Spent> {
        let slot = self.trial.as_ref()?.record.slot()?;
        let (made, stalled_ns) = (self.made_by(slot), self.stalled_ns());
        let effort = self.trial.as_ref()?.effort.as_ref()?;
        Some(effort.read_of_all(system::now_ns(), made, stalled_ns))
    }

    /// The newcomer has the role, or has lost it or given it back: its leaps count as long as it has it.
    pub(in crate::supervise::trial) fn note_hold(&mut self, holds: bool) {
        let Some(read) = self.read_newcomer() else { return };
        if let Some(trial) = &mut self.trial {
            trial.leaps.hold(holds, read);
        }
    }

    /// Who has a role has taken it again so many times.
    pub(in crate::supervise) fn note_leaps(&mut self, incarnation: u32, count: u64) {
        let is_newcomer = self.is_newcomer(incarnation);
        if let Some(trial) = self.trial.as_mut().filter(|_| is_newcomer) {
            trial.leaps.count += count;
        }
    }

    /// Looks whether the newcomer leaps over ticks again and again.
    pub(in crate::supervise::trial) fn look_at_leaps(&mut self, now_ns: u64) {
        let Some(trial) = &self.trial else { return };
        let Trial { role, leaps, record, .. } = trial;
        let (role, incarnation, incumbent) = (*role, record.incarnation, record.incumbent);
        if !leaps.is_due(now_ns, look_ns(role)) {
            return;
        }
        let leap_ns = self.leap_ns(role, incumbent);
        let Some(read) = self.read_newcomer() else { return };
        let Some(trial) = &mut self.trial else { return };
        let old = trial.old_holder();
        if let Some(text) = trial.leaps.look(read, &old, leap_ns) {
            self.doubt(incarnation, Reason::new(Cause::Slow, text));
        }
    }

    /// For how long one must have been kept from its steps for a leap, at least, ns. One in real time books each step that it leaves to others as a tick,
    /// however long that is; how long a fluid's is the old engine says.
    fn leap_ns(&mut self, role: Role, incumbent: u32) -> u64 {
        if realtime::priority(role).is_some() {
            return TICK_NS;
        }
        let beside = self.slots.iter().copied().find(|slot| self.viewer.page().incarnation(*slot) == incumbent);
        let status = beside.and_then(|slot| self.viewer.slot_page(slot)?.cell(fluid::STATUS));
        let step_ticks = status.map_or(1, |(_, status)| u64::from(status.step_ticks));
        step_ticks.clamp(1, MAX_FLUID_STEP_TICKS) * TICK_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::swap::tests::record;

    const MS: u64 = 1_000_000;
    /// An old engine that runs for 0.63 of the time.
    const OLD: [u64; 4] = [1_000, 630, 20, 1_000];

    /// What was spent within so many ms: it ran and waited for so long of them, ms, and made so many steps.
    fn spent([passed_ms, ran_ms, waited_ms, steps]: [u64; 4]) -> Spent {
        Spent { passed_ns: passed_ms * MS, ran_ns: ran_ms * MS, waited_ns: waited_ms * MS, steps, stalled_ns: 0 }
    }

    /// At which of six looks one was slow that spent this and leapt so many times before each; what was noted of it.
    fn looked(each: Spent, count: u64, old: Spent, leap_ns: u64) -> (Vec<u64>, Leaps) {
        let (mut leaps, mut read) = (Leaps::default(), spent([5_000, 70, 7, 300]));
        leaps.hold(true, read);
        let slow = (1..=6).filter(|_| {
            read = read.and(&each);
            leaps.count += count;
            leaps.look(read, &old, leap_ns).is_some()
        });
        (slow.collect(), leaps)
    }

    /// A tissue's, of steps of 1 ms.
    fn tissue(each: [u64; 4], count: u64) -> (Vec<u64>, Leaps) {
        looked(spent(each), count, spent(OLD), TICK_NS)
    }

    /// It was never late for 50 steps in a row, and after each leap nothing was compared for a while: it was promoted as soon as the role's steps were longer.
    #[test]
    fn one_that_leaps_again_and_again_although_the_machine_gave_it_all_its_time_is_slow() {
        for (each, count) in [([900, 890, 2, 857], 43), ([900, 895, 1, 562], 330), ([900, 300, 2, 700], 200)] {
            let (slow, leaps) = tissue(each, count);
            assert_eq!(slow, [2, 3, 4, 5, 6], "{each:?}: once is no verdict");
            assert!(!leaps.are_the_machines(), "{each:?}");
        }
        let (mut leaps, own) = (Leaps::default(), spent([900, 890, 2, 857]));
        leaps.hold(true, Spent::default());
        leaps.count = 43;
        assert_eq!(leaps.look(own, &spent(OLD), TICK_NS), None);
        leaps.count = 43;
        let why = leaps.look(own.and(&own), &spent(OLD), TICK_NS).expect("slow");
        assert_eq!(why, "its steps come too late: it leapt over ticks 86 times in 1.8 s, 4 of them for the machine");
    }

    #[test]
    fn one_from_which_the_machine_took_that_time_is_not_and_what_could_not_be_compared_for_that_is_the_machines() {
        let kept_off = [900, 500, 300, 700];
        let (slow, leaps) = tissue(kept_off, 190);
        assert!(slow.is_empty() && leaps.are_the_machines());
        let weighed = |leaps: Leaps, cause: Cause| {
            let mut trial = Trial::begin(record(), Role::Tissue, Spent::default());
            trial.leaps = leaps;
            trial.weighed(Reason::new(cause, "why")).cause
        };
        assert_eq!(weighed(leaps, Cause::NotCompared), Cause::NoTime);
        for cause in [Cause::OutOfTolerance, Cause::Refused, Cause::Died, Cause::Slow] {
            assert_eq!(weighed(tissue(kept_off, 190).1, cause), cause);
        }
        assert_eq!(weighed(tissue([900, 895, 2, 700], 190).1, Cause::NotCompared), Cause::NotCompared, "they are its own");
        // The host stood still.
        let stalled = Spent { stalled_ns: 100 * MS, ..spent([900, 780, 5, 860]) };
        assert!(looked(stalled, 60, spent(OLD), TICK_NS).0.is_empty());
    }

    #[test]
    fn one_that_leaps_once_or_twice_is_neither_slow_nor_kept_from_being_compared() {
        for count in [0, 1, 2, 15] {
            let (slow, leaps) = tissue([900, 560, 0, 898], count);
            assert!(slow.is_empty() && !leaps.are_the_machines(), "{count}");
        }
        let (slow, leaps) = tissue([900, 560, 40, 890], 1);
        assert!(slow.is_empty() && !leaps.are_the_machines(), "a leap in a second leaves most of it to be compared");
    }

    #[test]
    fn where_the_old_engine_has_nothing_to_spare_or_nobody_knows_what_the_machine_took_nobody_is_slow() {
        let own = spent([900, 890, 2, 857]);
        assert!(looked(own, 43, spent([1_000, 950, 10, 980]), TICK_NS).0.is_empty(), "the machine is too slow for both");
        assert_eq!(looked(own, 43, Spent::default(), TICK_NS).0.len(), 5, "of the old one nothing is known");
        assert!(looked(spent([900, 0, 0, 857]), 43, spent(OLD), TICK_NS).0.is_empty(), "the kernel keeps no books");
    }

    #[test]
    fn a_fluid_leaps_seldom_and_each_leap_takes_a_period() {
        let fluid = |waited_ms: u64, count: u64| looked(spent([1_800, 1_700, waited_ms, 45]), count, spent(OLD), 33 * TICK_NS).0;
        assert_eq!(fluid(0, 3), [2, 3, 4, 5, 6]);
        assert!(fluid(34, 3).is_empty() && fluid(0, 2).is_empty());
    }

    /// Beside a hand that cuts it has the role for some tenths of a second each time.
    #[test]
    fn the_times_for_which_it_has_the_role_are_added_up() {
        let (mut leaps, mut read) = (Leaps::default(), Spent::default());
        let (part, pause) = (spent([300, 297, 0, 285]), spent([5_000, 100, 900, 1_250]));
        let mut is_slow = false;
        for _ in 0..6 {
            leaps.hold(true, read);
            leaps.hold(true, read.and(&part)); // told once more
            leaps.count += 15;
            read = read.and(&part);
            if leaps.is_due(read.passed_ns, 900 * MS) {
                is_slow = leaps.look(read, &spent(OLD), TICK_NS).is_some();
            }
            leaps.hold(false, read);
            leaps.hold(false, read);
            read = read.and(&pause);
            assert!(!leaps.is_due(u64::MAX, 1), "it has not the role");
        }
        assert!(is_slow, "{leaps:?}");
        assert_eq!((leaps.held_ns, leaps.all, leaps.own), (1_800 * MS, 90, 90), "what it spent in the pauses is not looked at");
    }

    #[test]
    fn the_steps_of_an_ordinary_process_are_looked_at_for_longer() {
        assert_eq!([Role::Tissue, Role::Fluid].map(look_ns), [LOOK_NS, 2 * LOOK_NS]);
    }
}
