//! A servo on trial is compared with the other one, tick by tick, by the forces that both say in their pages; and of each newcomer through which the hand feels
//! it is seen whether there was anything to feel.

use super::super::Supervisor;
use super::{LEAST_COMPARED, MOST_OUTSIDE, SHADOW_NS};
use crate::policy::{self, Cause, Event, Reason};
use crate::swap::SERVO_FORCE_N;
use hyst_messages::page::{ProcessState, Stage, haptic, tissue};
use hyst_messages::{Role, Slot};

/// What counts as felt, N, and at how many looks it must be.
const TOUCH_N: f32 = 0.1;
const LEAST_FELT: u32 = 5;

impl Supervisor {
    /// Notes whether there is something to feel, by the servos' word or the tissues': a newcomer that feels nothing is one of several.
    pub(super) fn note_touch(&mut self, now_ns: u64) {
        if self.policy.swap().is_none_or(policy::Swap::was_tried_in_touch) {
            return;
        }
        let incarnation = match &self.trial {
            Some(trial) if trial.stage == Stage::Trial => trial.record.incarnation,
            _ => return,
        };
        let slots = [Role::Haptic, Role::Tissue].map(Role::slots).into_iter();
        let is_felt = slots.flat_map(|(first, count)| first..first + count).filter_map(Slot::from_number).any(|slot| {
            let Some(page) = self.viewer.slot_page(slot) else { return false };
            let force_n = match slot.role() {
                Role::Haptic => page.cell(haptic::FORCE).map(|(_, said)| said.force_n),
                _ => page.cell(tissue::STATUS).map(|(_, made)| made.tool_force_n),
            };
            force_n.is_some_and(|force_n| force_n.iter().any(|part_n| part_n.abs() >= TOUCH_N))
        });
        let Some(trial) = self.trial.as_mut().filter(|_| is_felt) else { return };
        trial.felt = trial.felt.saturating_add(1);
        // Said until it is heard: a newcomer that is not promoted yet is told, and is on no probation; one that begins anew asks anew.
        if trial.felt >= LEAST_FELT {
            let actions = policy::step(now_ns, Event::Touched { incarnation }, &mut self.policy);
            self.act(actions);
        }
    }

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
