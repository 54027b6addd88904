//! What the lines of the judge come to: the newcomer agrees, and may go on, or it goes.

use super::{Effort, LEAST_COMPARED, LEAST_PROVEN, MOST_OUTSIDE, SHADOW_NS, Trial};
use crate::policy::{self, Cause, Event, Reason};
use crate::supervise::Supervisor;
use crate::swap::judge::Seen;
use hyst_exchange::system;
use hyst_messages::Role;
use hyst_messages::page::Stage;

/// Pairs in a row of which nothing could be compared because their meshes were not the same, two seconds of a real-time role, after which they will not be again.
const MOST_APART: u32 = 125;

/// Whether what is compared of a role are its steps. At pictures, a recording and a page it is looked a few times in a second, and some looks in vain are no
/// verdict on a busy machine, but where they are in a row.
const fn is_compared_by_steps(role: Role) -> bool {
    role.is_stateful() || matches!(role, Role::Device)
}

/// What a line of the judge comes to.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Verdict {
    /// Nothing yet.
    Open,
    /// The newcomer was compared for long enough, and agrees.
    Agrees,
    /// It and the old engine have gone different ways, as two good ones may.
    Parted(String),
    /// It is out of tolerance.
    Out(String),
}

impl Trial {
    /// Pairs of states that agreed while the newcomer had the role, before the pauses in which it gave it back, too.
    pub(super) fn agreed_on_probation(&self) -> u64 {
        self.proven + self.agreed.0.saturating_sub(self.agreed.1)
    }

    /// What is out of tolerance, if anything is: some pairs in a row, or too many of all.
    fn flaw(&self, seen: &Seen, passed_ns: u64) -> Option<String> {
        let are_too_many = is_compared_by_steps(self.role) && passed_ns >= SHADOW_NS && seen.has_too_many_bad();
        let [bad, of] = seen.bad_of;
        match () {
            () if seen.outside >= MOST_OUTSIDE => Some(seen.text.clone()),
            () if are_too_many => Some(format!("{bad} of {of} pairs, at the last of them {}", seen.flaw)),
            () => None,
        }
    }

    /// Takes a line of the judge.
    fn take(&mut self, seen: &Seen, now_ns: u64) -> Verdict {
        // The judge says again what it saw before: without a new pair nobody knows what the newcomer does now.
        let is_news = seen.good > std::mem::replace(&mut self.agreed.0, seen.good);
        let (stage, passed_ns) = (self.stage, now_ns.saturating_sub(self.since_ns));
        // How long it has been on probation the policy knows.
        let is_proof = stage == Stage::Trial && self.role.is_stateful();
        let is_enough = match is_proof {
            true => self.agreed_on_probation() >= LEAST_PROVEN,
            false => passed_ns >= SHADOW_NS && seen.good.saturating_sub(self.agreed.1) >= LEAST_COMPARED,
        };
        let may_go_on = is_proof || stage == Stage::Trial || stage == Stage::Shadow && self.is_calm(now_ns);
        match self.flaw(seen, passed_ns) {
            Some(text) if self.role == Role::Tissue && seen.leapt => match is_proof {
                true => Verdict::Parted(format!("after ticks were lost, or inputs of other ticks used, {text}")),
                false => Verdict::Open, // of a line that was left already nothing is said any more
            },
            Some(text) => Verdict::Out(format!("out of tolerance: {text}")),
            None if is_proof && seen.apart >= MOST_APART => {
                Verdict::Parted("its mesh is another one than the old engine's".to_string())
            }
            None if is_enough && may_go_on && is_news && seen.outside == 0 => Verdict::Agrees,
            None => Verdict::Open,
        }
    }

    /// The judge has ended, and the next one counts from nothing: what this one compared since the newcomer has the role proves nothing.
    pub(super) fn forget_compared(&mut self) {
        self.agreed = (0, 0);
    }

    /// What else than the newcomer may be to blame, by the judge's word, for what follows from a line of it.
    fn note_excuses(&mut self, seen: &Seen, now_ns: u64) {
        self.waits_ns = if seen.waits { now_ns } else { self.waits_ns };
        self.silent = seen.silent && seen.outside >= MOST_OUTSIDE;
        self.at_disk = self.silent && self.effort.as_ref().is_some_and(Effort::waits_for_machine);
    }
}

impl Supervisor {
    /// A line of the judge.
    pub(in crate::supervise) fn judged(&mut self, incarnation: u32, seen: &Seen) {
        let Some(trial) = self.trial.as_mut().filter(|trial| trial.record.incarnation == incarnation) else { return };
        if trial.record.proven {
            return;
        }
        let (now_ns, stage) = (system::now_ns(), trial.stage);
        trial.note_excuses(seen, now_ns);
        match trial.take(seen, now_ns) {
            Verdict::Open => {}
            Verdict::Parted(text) => self.part(incarnation, &text),
            Verdict::Out(text) => self.doubt(incarnation, Reason::new(Cause::OutOfTolerance, text)),
            Verdict::Agrees => {
                if stage == Stage::Shadow {
                    let Seen { compared, worst, .. } = seen;
                    self.note_step(&format!("{compared} states compared, the worst at {worst:.2e} of the tolerance"));
                }
                let actions = policy::step(now_ns, Event::Agreed { incarnation }, &mut self.policy);
                self.act(actions);
            }
        }
    }

    /// The newcomer and the old engine have parted.
    fn part(&mut self, incarnation: u32, text: &str) {
        let reason = Reason::new(Cause::OutOfTolerance, format!("out of tolerance: {text}"));
        let actions = policy::step(system::now_ns(), Event::Parted { incarnation, reason }, &mut self.policy);
        if !actions.is_empty() {
            self.note_step(text);
            if let Some(trial) = &mut self.trial {
                trial.has_parted = true;
            }
        }
        self.act(actions);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Spent;
    use super::*;
    use crate::swap::tests::record;

    /// What each line comes to, two seconds after the newcomer was told how far it is, if the judge finds these pairs again and again out of tolerance or not.
    fn verdicts(role: Role, stage: Stage, leapt: bool, are_bad: &[bool]) -> Vec<Verdict> {
        let mut trial = Trial::begin(record(), role, Spent::default());
        (trial.stage, trial.since_ns) = (stage, 0);
        let mut seen = Seen { leapt, ..Seen::default() };
        let take = |is_bad: &bool| {
            seen.note(if *is_bad { (2.0, "force differs by 0.1 N".to_string()) } else { (0.1, "force is near".to_string()) });
            trial.take(&seen, 2 * SHADOW_NS)
        };
        are_bad.iter().cycle().take(60).map(take).collect()
    }

    fn first(verdicts: &[Verdict]) -> Option<(usize, &Verdict)> {
        (1..).zip(verdicts).find(|(_, verdict)| **verdict != Verdict::Open)
    }

    /// Two pairs out of tolerance and one within it, over and over, were never three in a row, and all of them were proof.
    #[test]
    fn one_that_is_out_of_tolerance_now_and_then_is_so_once_thirty_pairs_were_compared() {
        let text = |bad: u64| format!("out of tolerance: {bad} of 30 pairs, at the last of them force differs by 0.1 N");
        for stage in [Stage::Shadow, Stage::Trial] {
            for (are_bad, bad) in [(&[true, true, false][..], 20), (&[false, false, false, true, false, false, true][..], 8)] {
                let found = verdicts(Role::Fluid, stage, false, are_bad);
                let agreed = found.iter().take(29).filter(|verdict| **verdict == Verdict::Agrees).count();
                assert_eq!(found[29], Verdict::Out(text(bad)), "{stage:?}");
                assert_eq!(agreed > 0, stage == Stage::Shadow && bad == 8, "ten that agree let it have the role");
            }
        }
        // Of pictures it is looked whether they go on, and some looks in vain are none.
        let found = verdicts(Role::Rendering, Stage::Trial, false, &[true, true, false]);
        assert!(found.iter().all(|verdict| !matches!(verdict, Verdict::Out(_))), "{found:?}");
        let found = verdicts(Role::Rendering, Stage::Trial, false, &[true, true, true, false]);
        assert_eq!(first(&found), Some((3, &Verdict::Out("out of tolerance: force differs by 0.1 N".to_string()))));
    }

    #[test]
    fn one_of_which_a_pair_in_twenty_is_out_of_tolerance_is_proven_by_thirty_others() {
        let mut are_bad = [false; 20];
        are_bad[4] = true;
        let found = verdicts(Role::Fluid, Stage::Trial, false, &are_bad);
        assert_eq!(first(&found), Some((32, &Verdict::Agrees)), "the two that were bad are no proof");
        let found = verdicts(Role::Fluid, Stage::Trial, false, &[false]);
        assert_eq!(first(&found), Some((30, &Verdict::Agrees)));
    }

    /// One that had hung since a third of a second when its probation was over was taken, for what it had made before that.
    #[test]
    fn a_line_without_a_new_pair_that_agrees_says_nothing_for_a_newcomer() {
        for (role, stage) in [(Role::Fluid, Stage::Trial), (Role::Fluid, Stage::Shadow), (Role::Recorder, Stage::Trial)] {
            let mut trial = Trial::begin(record(), role, Spent::default());
            (trial.stage, trial.since_ns) = (stage, 0);
            let mut seen = Seen::default();
            (0..LEAST_PROVEN).for_each(|_| seen.note((0.1, "it is near".to_string())));
            let said = [0, 0, 1, 0].map(|pairs| {
                (0..pairs).for_each(|_| seen.note((0.1, "it is near".to_string())));
                trial.take(&seen, 2 * SHADOW_NS)
            });
            let found = [Verdict::Agrees, Verdict::Open, Verdict::Agrees, Verdict::Open];
            assert_eq!(said, found, "{role:?} {stage:?}");
        }
    }

    #[test]
    fn a_tissue_that_is_out_of_tolerance_now_and_then_since_ticks_were_lost_has_parted() {
        let text =
            "after ticks were lost, or inputs of other ticks used, 20 of 30 pairs, at the last of them force differs by 0.1 N";
        let found = verdicts(Role::Tissue, Stage::Trial, true, &[true, true, false]);
        assert_eq!(first(&found), Some((30, &Verdict::Parted(text.to_string()))));
        assert_eq!(first(&verdicts(Role::Tissue, Stage::Shadow, true, &[true, true, false])), None, "a line that was left");
        let found = verdicts(Role::Fluid, Stage::Trial, true, &[true, true, false]);
        assert!(matches!(first(&found), Some((30, Verdict::Out(_)))), "{found:?}");
    }

    #[test]
    fn what_was_out_of_tolerance_in_the_first_second_is_no_share_yet() {
        let mut trial = Trial::begin(record(), Role::Device, Spent::default());
        (trial.stage, trial.since_ns) = (Stage::Trial, 0);
        let mut seen = Seen::default();
        (0..60).for_each(|turn| seen.note((if turn % 3 < 2 { 2.0 } else { 0.1 }, "the motors' force".to_string())));
        assert_eq!(trial.take(&seen, SHADOW_NS - 1), Verdict::Open);
        assert!(matches!(trial.take(&seen, SHADOW_NS), Verdict::Out(_)));
    }
}
