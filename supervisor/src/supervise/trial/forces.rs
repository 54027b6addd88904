//! A servo on trial is compared with the other one, tick by tick, by the forces that both say in their pages; and of each newcomer through which the hand feels
//! it is seen whether there was anything to feel.

use super::super::Supervisor;
use super::{LEAST_COMPARED, SHADOW_NS};
use crate::policy::{self, Cause, Event, Reason};
use crate::swap::SERVO_FORCE_N;
use crate::swap::judge::are_too_many;
use hyst_exchange::ReadPage;
use hyst_messages::page::{ProcessState, Stage, haptic, tissue};
use hyst_messages::{Role, Slot};

/// What counts as felt, N, and at how many looks it must be.
const TOUCH_N: f32 = 0.1;
const LEAST_FELT: u32 = 5;

/// Ticks in a row out of tolerance after which a servo goes. One that lost ticks goes on from the other's state some ticks later: until then the two differ.
const MOST_OUTSIDE_TICKS: u64 = 15;

/// What a servo said in a tick, N.
type Said = (u64, [f32; 3]);

/// What was seen of the forces of two servos.
#[derive(Debug, Default)]
pub(super) struct Forces {
    /// Ticks in a row, up to now, that were out of tolerance.
    outside: u64,
    /// Ticks that were, and ticks in all, since the newcomer was told last how far it is.
    bad_of: [u64; 2],
    /// The newest tick that was looked at.
    last: u64,
}

impl Forces {
    /// The newcomer is told how far it is.
    pub(super) fn begin(&mut self) {
        self.bad_of = [0; 2];
    }

    /// Takes what the two have said since the last tick, each in the order of the ticks. `are_out`: both have left their shadows; before, nothing counts.
    fn take(&mut self, [own, other]: &[Vec<Said>; 2], are_out: bool) {
        for (tick, own_n) in own {
            let answered = other.iter().find(|(of, _)| of == tick);
            let Some((_, other_n)) = answered.filter(|_| *tick > self.last) else { continue };
            self.last = *tick;
            if !are_out {
                self.outside = 0;
                continue;
            }
            let is_near = own_n.iter().zip(other_n).all(|(own, other)| (own - other).abs() <= SERVO_FORCE_N);
            let [bad, of] = self.bad_of;
            self.bad_of = [bad + u64::from(!is_near), of + 1];
            self.outside = if is_near { 0 } else { self.outside + 1 };
        }
    }

    /// Ticks that agreed.
    fn agreed(&self) -> u64 {
        self.bad_of[1] - self.bad_of[0]
    }

    /// What is out of tolerance, if anything is: too many ticks in a row, or of all where it was compared for long.
    fn flaw(&self, is_long: bool) -> Option<String> {
        let [bad, of] = self.bad_of;
        let are_many = is_long && bad >= MOST_OUTSIDE_TICKS && are_too_many(self.bad_of);
        if self.outside < MOST_OUTSIDE_TICKS && !are_many {
            return None;
        }
        let what = format!("its force differs by more than {SERVO_FORCE_N} N from the other servo's");
        Some(format!("out of tolerance: {what} at {bad} of {of} ticks"))
    }
}

/// What a servo has said since a tick, as far as its page has it still.
fn said_since(page: &ReadPage, last: u64) -> Vec<Said> {
    let end = page.ring_end(haptic::FORCES);
    let from = end.saturating_sub(haptic::FORCES.entries as u64).max(last.saturating_add(1));
    (from..end).filter_map(|tick| Some((tick, page.ring(haptic::FORCES, tick)?.force_n))).collect()
}

impl Supervisor {
    /// Notes whether there is something to feel, by the servos' word or the tissues': a newcomer that feels nothing is one of several. Of what the hand feels the
    /// servos' word alone counts: what presses on the shaft is hardly felt at the tip.
    pub(super) fn note_touch(&mut self, now_ns: u64) {
        if self.policy.swap().is_none_or(policy::Swap::was_tried_in_touch) {
            return;
        }
        let (incarnation, role) = match &self.trial {
            Some(trial) if trial.stage == Stage::Trial => (trial.record.incarnation, trial.role),
            _ => return,
        };
        let asked: &[Role] =
            if matches!(role, Role::Haptic | Role::Device) { &[Role::Haptic] } else { &[Role::Haptic, Role::Tissue] };
        let slots = asked.iter().map(|role| role.slots());
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

    /// A servo is compared here with the other one: both say their forces in their pages.
    pub(super) fn compare_forces(&mut self, now_ns: u64) {
        let slots = [0, 1].map(|index| Slot::new(Role::Haptic, index));
        let last = self.trial.as_ref().map_or(0, |trial| trial.forces.last);
        let said = slots.map(|slot| self.viewer.slot_page(slot?).map(|page| said_since(page, last)));
        let [Some(own), Some(other)] = said else { return };
        let are_out = slots
            .iter()
            .flatten()
            .all(|slot| self.viewer.slot_page(*slot).is_some_and(|page| page.state() == ProcessState::Live));
        let Some(trial) = &mut self.trial else { return };
        trial.forces.take(&[own, other], are_out);
        let (incarnation, is_long) = (trial.record.incarnation, now_ns.saturating_sub(trial.since_ns) >= SHADOW_NS);
        if let Some(text) = trial.forces.flaw(is_long) {
            self.doubt(incarnation, Reason::new(Cause::OutOfTolerance, text));
        } else if trial.stage == Stage::Shadow && is_long && trial.forces.agreed() >= LEAST_COMPARED {
            let actions = policy::step(now_ns, Event::Agreed { incarnation }, &mut self.policy);
            self.act(actions);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use hyst_messages::ForceRecord;

    /// What is seen of two servos in so many ticks from 1 on, if the first makes so much more than the other, N; in looks at some ticks each.
    fn seen(ticks: u64, each_look: u64, more_n: impl Fn(u64) -> f32) -> Forces {
        let mut forces = Forces::default();
        for from in (1..=ticks).step_by(each_look as usize) {
            let said = |more_n: &dyn Fn(u64) -> f32| {
                let of = |tick: u64| (tick, [0.0, 1.0 + more_n(tick), 0.0]);
                (from..(from + each_look).min(ticks + 1)).map(of).collect::<Vec<Said>>()
            };
            forces.take(&[said(&more_n), said(&|_| 0.0)], true);
        }
        forces
    }

    /// One look in 5 ms had only the newest ticks, and those where both had answered the same.
    #[test]
    fn each_tick_is_compared_that_both_have_answered_and_none_twice() {
        let forces = seen(100, 5, |tick| if tick == 52 { 0.2 } else { 0.04 });
        assert_eq!((forces.bad_of, forces.outside, forces.last, forces.agreed()), ([1, 100], 0, 100, 99));
        let mut forces = Forces::default();
        let of = |ticks: std::ops::Range<u64>| ticks.map(|tick| (tick, [0.0; 3])).collect::<Vec<Said>>();
        forces.take(&[of(1..6), of(1..4)], true);
        forces.take(&[of(1..9), of(3..9)], true);
        forces.take(&[of(1..9), of(3..9)], true);
        assert_eq!((forces.bad_of, forces.last), ([0, 8], 8), "the later one's are compared when it has answered");
        forces.take(&[of(9..12), of(9..12)], false);
        assert_eq!((forces.bad_of, forces.last), ([0, 8], 11), "one is in its shadow");
        forces.begin();
        assert_eq!((forces.bad_of, forces.last), ([0, 0], 11));
    }

    /// Two ticks out of tolerance and one within it, over and over, were agreement.
    #[test]
    fn a_servo_that_is_out_of_tolerance_now_and_then_is_so_and_one_that_is_for_a_moment_is_not() {
        let now_and_then = seen(300, 5, |tick| if tick % 3 == 0 { 0.0 } else { -0.1 });
        let why = now_and_then.flaw(true).expect("200 of 300");
        assert!(why.starts_with("out of tolerance: ") && why.ends_with("from the other servo's at 200 of 300 ticks"), "{why}");
        assert_eq!(now_and_then.flaw(false), None, "it was not compared for long");
        let moment = |ticks: u64| seen(300, 5, |tick| if (100..100 + ticks).contains(&tick) { 0.1 } else { 0.0 });
        assert!(moment(14).flaw(true).is_none() && moment(40).flaw(true).is_some());
        assert_eq!(seen(115, 5, |tick| if tick > 100 { f32::NAN } else { 0.0 }).outside, 15);
        assert!(seen(114, 5, |tick| if tick > 99 { 0.1 } else { 0.0 }).flaw(false).is_some(), "15 in a row, at once");
    }

    #[test]
    fn what_a_servo_has_said_is_read_from_its_page_as_far_as_that_has_it() {
        let station = Station::named(&format!("t{}-forces", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Haptic);
        let (page, read) = (station.create_slot(slot, 1).unwrap(), station.read_slot(slot, 1).unwrap());
        assert!(said_since(&read, 0).is_empty());
        for tick in 1..=20 {
            page.push(haptic::FORCES, tick, &ForceRecord { tick, force_n: [tick as f32; 3], ..ForceRecord::default() });
        }
        let ticks = |last: u64| said_since(&read, last).into_iter().map(|(tick, _)| tick).collect::<Vec<u64>>();
        assert_eq!(ticks(0), [13, 14, 15, 16, 17, 18, 19, 20]);
        assert_eq!(ticks(17), [18, 19, 20]);
        assert_eq!(said_since(&read, 19), [(20, [20.0; 3])]);
        assert!(ticks(20).is_empty() && ticks(u64::MAX).is_empty());
        station.wipe();
    }
}
