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

impl Trial {
    /// Pairs of states that were compared while the newcomer had the role, before the pauses in which it gave it back, too.
    pub(super) fn compared_on_probation(&self) -> u64 {
        self.proven + self.compared.0 - self.compared.1
    }

    /// The judge has ended, and the next one counts from nothing: what this one compared since the newcomer has the role proves nothing.
    pub(super) fn forget_compared(&mut self) {
        self.compared = (0, 0);
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
        trial.compared.0 = seen.compared;
        trial.note_excuses(seen, now_ns);
        // How long it has been on probation the policy knows.
        let is_proof = stage == Stage::Trial && trial.role.is_stateful();
        let is_enough = match is_proof {
            true => trial.compared_on_probation() >= LEAST_PROVEN,
            false => now_ns - trial.since_ns >= SHADOW_NS && seen.compared - trial.compared.1 >= LEAST_COMPARED,
        };
        let may_go_on = is_proof || stage == Stage::Trial || stage == Stage::Shadow && trial.is_calm(now_ns);
        if seen.outside >= MOST_OUTSIDE && trial.role == Role::Tissue && seen.leapt {
            // Of a line that was left already nothing is said any more.
            if is_proof {
                self.part(incarnation, &format!("after ticks were lost {}", seen.text));
            }
        } else if seen.outside >= MOST_OUTSIDE {
            self.doubt(incarnation, Reason::new(Cause::OutOfTolerance, format!("out of tolerance: {}", seen.text)));
        } else if is_proof && seen.apart >= MOST_APART {
            self.part(incarnation, "its mesh is another one than the old engine's");
        } else if is_enough && may_go_on && seen.outside == 0 {
            if stage == Stage::Shadow {
                self.note_step(&format!("{} states compared, the worst at {:.2e} of the tolerance", seen.compared, seen.worst));
            }
            let actions = policy::step(now_ns, Event::Agreed { incarnation }, &mut self.policy);
            self.act(actions);
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
