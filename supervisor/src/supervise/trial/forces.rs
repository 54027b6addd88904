//! A servo on trial is compared with the other one, tick by tick, by the forces that both say in their pages.

use super::super::Supervisor;
use super::{LEAST_COMPARED, MOST_OUTSIDE, SHADOW_NS};
use crate::policy::{self, Cause, Event, Reason};
use crate::swap::SERVO_FORCE_N;
use hyst_messages::page::{ProcessState, Stage, haptic};
use hyst_messages::{Role, Slot};

impl Supervisor {
    /// A servo is compared here with the other one: both say their force in their pages.
    pub(super) fn compare_forces(&mut self, now_ns: u64) {
        let slots = [0, 1].map(|index| Slot::new(Role::Haptic, index));
        let records = slots.map(|slot| self.viewer.slot_page(slot?)?.cell(haptic::FORCE).map(|(_, record)| record));
        let [Some(a), Some(b)] = records else { return };
        let is_out = slots
            .iter()
            .flatten()
            .all(|slot| self.viewer.slot_page(*slot).is_some_and(|page| page.state() == ProcessState::Live));
        let Some(trial) = &mut self.trial else { return };
        let (outside, compared, last) = trial.forces;
        if a.tick != b.tick || a.tick == last {
            return;
        }
        let near = a.force_n.iter().zip(b.force_n).all(|(a, b)| (a - b).abs() <= SERVO_FORCE_N);
        trial.forces = (if near || !is_out { 0 } else { outside + 1 }, compared + u64::from(is_out), a.tick);
        let (incarnation, (outside, compared, _)) = (trial.record.incarnation, trial.forces);
        let long = now_ns.saturating_sub(trial.since_ns) >= SHADOW_NS;
        if outside >= MOST_OUTSIDE {
            let text = format!("out of tolerance: its force differs by more than {SERVO_FORCE_N} N from the other servo's");
            self.doubt(incarnation, Reason::new(Cause::OutOfTolerance, text));
        } else if trial.stage == Stage::Shadow && long && compared >= LEAST_COMPARED {
            let actions = policy::step(now_ns, Event::Agreed { incarnation }, &mut self.policy);
            self.act(actions);
        }
    }
}
