//! What was spent of the machine within a time, and what is thought of a newcomer that spent it. All of it is computed from readings of the kernel's books.
//!
//! One that lost the role is judged twice: by all of its tenures, and by the end of each, in which it missed the steps that cost it the role. A flow that is in
//! time for a second, and is then kept off its core for 0.4 s, was kept off it for a quarter of its tenure, and for all of its end.

/// Parts of the time for which one is ready and not let run, beyond which it is not to blame: for answers that came late now and then, and for making
/// half its steps.
pub(in crate::supervise::trial) const KEPT_OFF_FOR_LATE: f64 = 0.02;
pub(super) const KEPT_OFF_FOR_SLOW: f64 = 0.3;
/// One that runs for this part of the time, at so many times what a step took the old engine, is slow by itself, whoever keeps it off.
const BUSY: f64 = 0.1;
const COSTLY: f64 = 3.0;
/// One that slept for this part of the time, and yet made few steps, was not kept from them.
const ASLEEP: f64 = 0.5;
/// An old engine that runs, or is ready to, for more than this part of the time has too little to spare.
const FULL: f64 = 0.8;
/// Part of the old engine's rate that the newcomer must make: a busy host takes its share of both.
pub(super) const LEAST_RATE: f64 = 0.5;
/// One that made so many steps in time whenever it had the role is not slow: it lost the role to a stall.
const STEADY_STEPS: u64 = 100;
/// Steps in a row that cost an ordinary process the role, of which a loss is made.
const LOST_STEPS: f64 = 10.0;
/// The least and the most that a loss is looked at for, ns: entries in the books are 10 ms apart, and reach back for more than a second.
const SHORTEST_LOSS_NS: u64 = 100_000_000;
const LONGEST_LOSS_NS: u64 = 1_000_000_000;

/// What was spent within a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::supervise::trial) struct Spent {
    /// When that was read, or how long it took, ns.
    pub(super) passed_ns: u64,
    /// Processor time, and time in which it was ready and not let run, ns.
    pub(super) ran_ns: u64,
    pub(super) waited_ns: u64,
    pub(super) steps: u64,
    /// Time in which the host itself stood still, as the hardware's canaries say, ns: the kernel books it as time that somebody ran.
    pub(super) stalled_ns: u64,
}

impl Spent {
    /// Processor time of a step, ns; 0 if there was none.
    pub(super) fn step_ns(&self) -> f64 {
        if self.steps == 0 { 0.0 } else { self.ran_ns as f64 / self.steps as f64 }
    }

    /// Steps a second.
    pub(super) fn rate_hz(&self) -> f64 {
        self.steps as f64 * 1e9 / self.passed_ns.max(1) as f64
    }

    /// What was spent since another reading of the same books.
    pub(super) fn less(&self, from: &Spent) -> Spent {
        Spent {
            passed_ns: self.passed_ns.saturating_sub(from.passed_ns),
            ran_ns: self.ran_ns.saturating_sub(from.ran_ns),
            waited_ns: self.waited_ns.saturating_sub(from.waited_ns),
            steps: self.steps.saturating_sub(from.steps),
            stalled_ns: self.stalled_ns.saturating_sub(from.stalled_ns),
        }
    }

    /// What was spent in both times.
    pub(super) fn and(&self, more: &Spent) -> Spent {
        Spent {
            passed_ns: self.passed_ns + more.passed_ns,
            ran_ns: self.ran_ns + more.ran_ns,
            waited_ns: self.waited_ns + more.waited_ns,
            steps: self.steps + more.steps,
            stalled_ns: self.stalled_ns + more.stalled_ns,
        }
    }

    /// What part that is of the time that passed.
    pub(super) fn part(&self, time_ns: u64) -> f64 {
        time_ns as f64 / self.passed_ns.max(1) as f64
    }

    /// Of the old engine: whether the machine is too slow for it, too, so that nobody beside it can be in time.
    pub(super) fn is_full(&self) -> bool {
        self.part((self.ran_ns + self.waited_ns).saturating_sub(self.stalled_ns)) > FULL
    }

    /// Whether its steps are dear; `old` is what the old engine spent, nothing if that is not known.
    fn is_costly(&self, old: &Spent) -> bool {
        let ran_ns = self.ran_ns.saturating_sub(self.stalled_ns);
        self.part(ran_ns) > BUSY && ran_ns as f64 > COSTLY * old.step_ns() * self.steps as f64
    }

    /// Whether it is the machine that makes it slow: it kept the process off its core for more than this part of the time, or stood still.
    pub(super) fn is_excused(&self, old: &Spent, kept_off: f64) -> bool {
        self.part(self.waited_ns.max(self.stalled_ns)) > kept_off && !self.is_costly(old)
    }

    /// Whether it slept while `old` made its steps.
    fn is_asleep(&self, old: &Spent) -> bool {
        let slept_ns = self.passed_ns.saturating_sub(self.ran_ns).saturating_sub(self.waited_ns);
        self.rate_hz() < LEAST_RATE * old.rate_hz() && self.part(slept_ns) > ASLEEP
    }

    /// Whether it is the machine that kept it from its steps.
    pub(super) fn is_kept_off(&self, old: &Spent) -> bool {
        self.is_excused(old, KEPT_OFF_FOR_SLOW) && !self.is_asleep(old)
    }

    /// Of the old engine: how long the steps take that cost somebody the role whom no one suspects, ns.
    pub(super) fn loss_ns(&self) -> u64 {
        ((LOST_STEPS / self.rate_hz().max(1.0) * 1e9) as u64).clamp(SHORTEST_LOSS_NS, LONGEST_LOSS_NS)
    }
}

/// The times for which a newcomer had the role.
#[derive(Debug, Default)]
pub(in crate::supervise::trial) struct Tenures {
    /// What the old engine spent before the first of them, when it had the role.
    pub(super) led: Option<Spent>,
    /// The books at the beginning of the present one.
    since: Option<Spent>,
    /// What was spent in those that it lost, and how many these were.
    over: Spent,
    pub(super) count: u64,
    /// What was spent at their ends, while it lost the role.
    ends: Spent,
}

impl Tenures {
    /// The newcomer has the role, or has lost it; `late` is what the books said when the end of a tenure that is over now began.
    pub(super) fn note(&mut self, holds: bool, read: Spent, late: Option<Spent>) {
        match self.since.take() {
            Some(since) if !holds => {
                let late = late.filter(|late| late.passed_ns > since.passed_ns).unwrap_or(since);
                (self.over, self.ends) = (self.over.and(&read.less(&since)), self.ends.and(&read.less(&late)));
                self.count += 1;
            }
            before => self.since = before.or(holds.then_some(read)),
        }
    }

    /// The newcomer has given the role back for a while, as it was told to: a time that tells neither for it nor against it.
    pub(in crate::supervise::trial) fn give_back(&mut self) {
        self.since = None;
    }

    /// Whether the newcomer lost the role to the machine, and not by itself: it was in time for long, or kept off its core, in all of its tenures or at their
    /// ends. In an end there are few steps, and one that is not done yet.
    pub(super) fn were_cut_short(&self, old: &Spent) -> bool {
        let is_steady = self.over.steps >= STEADY_STEPS * self.count;
        let begun = Spent { steps: self.ends.steps + self.count, ..self.ends };
        let is_stalled = begun.is_excused(old, KEPT_OFF_FOR_SLOW) && !self.ends.is_asleep(old) && !self.over.is_costly(old);
        is_steady || is_stalled || self.over.is_kept_off(old)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn spent(ran_ms: u64, waited_ms: u64, steps: u64) -> Spent {
        Spent { passed_ns: 200 * MS, ran_ns: ran_ms * MS, waited_ns: waited_ms * MS, steps, stalled_ns: 0 }
    }

    #[test]
    fn one_that_is_not_let_run_is_excused_and_one_whose_steps_cost_more_is_not() {
        let old = spent(12, 0, 200);
        assert!(!spent(12, 3, 200).is_excused(&old, KEPT_OFF_FOR_LATE), "it was let run");
        assert!(!spent(1, 3, 0).is_excused(&old, KEPT_OFF_FOR_LATE), "it sleeps");
        assert!(spent(6, 60, 100).is_excused(&old, KEPT_OFF_FOR_LATE), "kept off its core");
        assert!(!spent(6, 40, 100).is_excused(&old, KEPT_OFF_FOR_SLOW), "that alone does not cost half its steps");
        assert!(spent(0, 200, 0).is_excused(&old, KEPT_OFF_FOR_LATE), "not let run at all");
        assert!(!spent(100, 60, 20).is_excused(&old, KEPT_OFF_FOR_LATE), "5 ms a step, on a core that others need");
        assert!(!spent(60, 140, 12).is_excused(&Spent::default(), KEPT_OFF_FOR_LATE), "of the old one nothing is known");
        assert_eq!((old.step_ns(), old.rate_hz()), (60e3, 1e3));
    }

    #[test]
    fn an_old_engine_that_wants_nearly_all_of_a_core_has_nothing_to_spare() {
        let wants = |ran_ms: u64, waited_ms: u64| spent(ran_ms, waited_ms, 200).is_full();
        assert!(wants(180, 0) && wants(100, 70) && !wants(140, 10) && !Spent::default().is_full());
        assert!(!Spent { stalled_ns: 60 * MS, ..spent(180, 0, 200) }.is_full(), "the host stood still meanwhile");
    }

    #[test]
    fn one_whose_host_stood_still_is_excused_and_what_the_kernel_booked_meanwhile_makes_no_step_dear() {
        let (old, stalled) = (spent(12, 0, 200), Spent { stalled_ns: 80 * MS, ..spent(86, 0, 100) });
        assert!(stalled.is_excused(&old, KEPT_OFF_FOR_LATE));
        assert!(!Spent { stalled_ns: 4 * MS, ..stalled }.is_excused(&old, KEPT_OFF_FOR_LATE), "it was let run");
        assert!(!Spent { stalled_ns: 40 * MS, ..stalled }.is_excused(&old, KEPT_OFF_FOR_LATE), "its steps are dear beside that");
    }

    /// A reading of a flow's books, each a part of what it had spent by then; the old one takes 20 ms for a step of 40 ms.
    fn at(passed_ms: u64, ran_ms: u64, waited_ms: u64, steps: u64) -> Spent {
        Spent { passed_ns: passed_ms * MS, ran_ns: ran_ms * MS, waited_ns: waited_ms * MS, steps, stalled_ns: 0 }
    }

    /// Whether the machine cut the tenures short of a flow that was in time for 1.1 s and spent this in the next 0.4 s, four times.
    fn is_cut_short(ran_ms: u64, waited_ms: u64, steps: u64) -> bool {
        let mut tenures = Tenures::default();
        for _ in 0..4 {
            tenures.note(true, at(5_000, 900, 100, 90), None);
            tenures.note(false, at(6_500, 1_450 + ran_ms, 110 + waited_ms, 117 + steps), Some(at(6_100, 1_450, 110, 117)));
        }
        assert_eq!((tenures.count, tenures.ends), (4, at(1_600, 4 * ran_ms, 4 * waited_ms, 4 * steps)));
        tenures.were_cut_short(&at(1_000, 500, 20, 25))
    }

    #[test]
    fn a_flow_that_was_in_time_and_lost_the_role_in_a_stall_is_judged_by_the_stall() {
        assert!(is_cut_short(0, 400, 0), "not let run at all: a quarter of its tenure");
        assert!(is_cut_short(60, 300, 2) && is_cut_short(160, 130, 7), "let run too little");
        assert!(!is_cut_short(60, 110, 4), "no more than everybody waits");
        assert!(!is_cut_short(60, 125, 2), "it slept, and waited beside");
        assert!(!is_cut_short(240, 160, 2), "its steps are dear");
        assert!(!is_cut_short(400, 0, 8) && !is_cut_short(10, 0, 0), "nobody kept it off");
        assert!(is_cut_short(45, 350, 0), "a step that was begun is not dear for not being done");
    }

    /// A tissue had the role again and again in the pauses of a hand that cut, some of them a millisecond long, and was blamed for the fourth that it lost.
    #[test]
    fn a_time_after_which_it_gave_the_role_back_is_none_that_it_lost() {
        let old = at(200, 12, 0, 200);
        let is_excused = |given_back: &Spent, lost: &Spent| {
            let mut tenures = Tenures::default();
            for _ in 0..20 {
                tenures.note(true, Spent::default(), None);
                if given_back.steps == 0 { tenures.note(false, *given_back, None) } else { tenures.give_back() }
            }
            for _ in 0..4 {
                tenures.note(true, Spent::default(), None);
                tenures.note(false, *lost, None);
            }
            (tenures.count, tenures.were_cut_short(&old))
        };
        let (long, none, own) = (at(300, 18, 0, 300), at(1, 0, 0, 0), at(30, 2, 0, 5));
        assert_eq!(is_excused(&long, &at(200, 12, 0, 180)), (4, true), "in time, until it lost the role");
        assert_eq!(is_excused(&long, &own), (4, false), "however long it had it before it gave it back");
        assert_eq!(is_excused(&none, &at(200, 12, 0, 180)), (24, false), "as if it had lost each");
    }

    #[test]
    fn an_end_is_as_long_as_the_steps_that_cost_the_role_and_no_longer_than_the_tenure() {
        let olds = [at(1_000, 0, 0, 25), at(100, 0, 0, 100), at(1_000, 0, 0, 5)];
        assert_eq!(olds.map(|old| old.loss_ns() / MS), [400, 100, 1_000]);
        assert_eq!(Spent::default().loss_ns(), LONGEST_LOSS_NS, "of the old one nothing is known");
        let mut tenures = Tenures::default();
        tenures.note(true, at(1_000, 0, 0, 0), None);
        tenures.note(false, at(1_300, 40, 200, 3), Some(at(900, 0, 0, 0)));
        assert_eq!(tenures.ends, at(300, 40, 200, 3));
        assert_eq!(tenures.over, tenures.ends);
    }
}
