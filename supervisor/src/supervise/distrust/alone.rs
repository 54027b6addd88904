//! One of a role with a state that lies while nobody else does its work, as when its spare is being started. Each newcomer waits for a state of its, refuses
//! them all, and ends: as long as it lives the role has no other. Where nobody can use what it says it is ended, and the role goes on from a checkpoint.
//!
//! Promise: nobody is ended for what one role says of it, not its own either, whose newcomers may be of another build, but for what the device says, of which
//! the hand feels nothing any more; one of which some outputs are good is left until its spare is warm, which comes of them.

use super::FORGOTTEN_NS;
use crate::mischief::Charge;
use hyst_messages::Role;
use std::collections::BTreeMap;

/// The device has used nothing newer for so long, ticks: until then what it has leads the hand.
pub(super) const OLD_TICKS: u64 = 100;
/// It refuses it for so long, ns: a device that has just begun has used nothing yet.
const REFUSED_NS: u64 = 100_000_000;
/// So long each of two roles refuses it where the device does not, ns: a spare that gets good states is warm by then.
const SHUNNED_NS: u64 = 1_000_000_000;

/// From when to when one role has refused one incarnation, ns.
#[derive(Clone, Copy, Debug)]
struct Series {
    first_ns: u64,
    last_ns: u64,
}

impl Series {
    fn length_ns(self) -> u64 {
        self.last_ns.saturating_sub(self.first_ns)
    }
}

/// What is said of those who are alone, by their incarnations and the roles of those who say it.
#[derive(Debug, Default)]
pub struct Alone {
    said: BTreeMap<u32, BTreeMap<Role, Series>>,
}

impl Alone {
    /// Hears a grave charge; whether who is charged serves nobody. `used_ticks` is how old is what the device uses of its role.
    pub(super) fn hear(&mut self, charge: &Charge, used_ticks: u64) -> bool {
        let of = self.said.entry(charge.incarnation).or_default();
        let anew = Series { first_ns: charge.last_ns, last_ns: charge.last_ns };
        let series = of.entry(charge.by.role()).or_insert(anew);
        let is_over = charge.last_ns.saturating_sub(series.last_ns) > FORGOTTEN_NS;
        *series = if is_over { anew } else { Series { last_ns: charge.last_ns.max(series.last_ns), ..*series } };
        if charge.by.role() == Role::Device {
            return used_ticks > OLD_TICKS && series.length_ns() >= REFUSED_NS;
        }
        let goes_on = |series: &&Series| series.last_ns + FORGOTTEN_NS >= charge.last_ns && series.length_ns() >= SHUNNED_NS;
        of.values().filter(goes_on).count() >= 2
    }

    /// Whether somebody of a third role refuses what it says, so that its own word counts for nothing.
    pub(super) fn is_doubted(&self, incarnation: u32, accused: Role, now_ns: u64) -> bool {
        let recent = |(by, series): (&Role, &Series)| *by != accused && series.last_ns + FORGOTTEN_NS >= now_ns;
        self.said.get(&incarnation).is_some_and(|of| of.iter().any(recent))
    }

    /// Forgets all but those who live.
    pub(super) fn keep(&mut self, lives: impl Fn(u32) -> bool) {
        self.said.retain(|incarnation, _| lives(*incarnation));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Slot;
    use hyst_messages::page::device::Distrust;

    const MS: u64 = 1_000_000;

    fn charge(by: Role, at_ns: u64) -> Charge {
        Charge { by: Slot::first(by), incarnation: 7, why: Distrust::Invalid as u64, since_ns: at_ns, last_ns: at_ns }
    }

    /// When a tissue that these roles refuse every so many ms is ended, ms from the first time on.
    fn ended_after(by: &[(Role, u64)], used_ticks: impl Fn(u64) -> u64) -> Option<u64> {
        let mut alone = Alone::default();
        (0..3_000).find(|ms| {
            let said = by.iter().filter(|(_, every)| ms % every == 0);
            said.fold(false, |ends, (by, _)| ends | alone.hear(&charge(*by, 50 * MS + ms * MS), used_ticks(*ms)))
        })
    }

    #[test]
    fn one_that_the_device_refuses_is_ended_once_the_hand_has_nothing_of_it() {
        assert_eq!(ended_after(&[(Role::Device, 4)], |ms| ms), Some(104));
        assert_eq!(ended_after(&[(Role::Device, 4)], |_| 1_000), Some(100), "a device that has just begun");
        assert_eq!(ended_after(&[(Role::Device, 4)], |ms| ms % 80), None, "some of it is good");
    }

    #[test]
    fn one_that_two_roles_refuse_is_ended_and_one_that_one_refuses_is_not() {
        let other = (Role::CollisionWorker, 3);
        assert_eq!(ended_after(&[(Role::Rendering, 40), other], |_| 0), Some(1_002));
        assert_eq!(ended_after(&[(Role::Tissue, 1), other], |_| 0), Some(1_002));
        assert_eq!([Role::Rendering, Role::Tissue].map(|role| ended_after(&[(role, 1)], |_| 0)), [None; 2]);
        assert_eq!(ended_after(&[(Role::Rendering, 600), other], |_| 0), None, "once now and then");
    }

    #[test]
    fn its_own_word_counts_for_nothing_where_a_third_one_refuses_it() {
        let mut alone = Alone::default();
        alone.hear(&charge(Role::CollisionWorker, 50 * MS), 0);
        let doubted = |alone: &Alone, now_ns: u64| alone.is_doubted(7, Role::CollisionWorker, now_ns);
        assert!(!doubted(&alone, 51 * MS), "whom it accuses accuses it");
        alone.hear(&charge(Role::Device, 60 * MS), 0);
        assert!(doubted(&alone, 61 * MS) && !alone.is_doubted(8, Role::CollisionWorker, 61 * MS));
        assert!(!doubted(&alone, 61 * MS + FORGOTTEN_NS), "that is long ago");
        alone.keep(|incarnation| incarnation != 7);
        assert!(!doubted(&alone, 61 * MS));
    }
}
