//! The bell of the terminal, for whoever trains at the window and has not the page, which has tones: it rings when a warning of the case or an alarm of the pump
//! begins, not while it stands.
//!
//! Promise: at most once a second, and nothing that begins goes without, however much stands already. What stood before the first look is rung for by nobody: it
//! began under another guardian.

use crate::view::Viewer;
use hyst_engine::Told;
use hyst_exchange::system;
use hyst_messages::page::fluid;
use hyst_messages::{PUMP_NOTICES, Role, Slot};

/// Between two rings, ns: what begins meanwhile is rung for then.
const PAUSE_NS: u64 = 1_000_000_000;

/// The bell.
#[derive(Debug)]
pub(super) struct Bell {
    is_on: bool,
    /// How often a warning had fallen, and the bits of the alarms that stood, at the last look; `None` before the first one that knew.
    fallen: Option<u64>,
    alarms: Option<u32>,
    is_due: bool,
    /// It does not ring before, ns.
    again_ns: u64,
}

impl Bell {
    /// One that rings, or never does.
    pub(super) fn new(is_on: bool) -> Bell {
        Bell { is_on, fallen: None, alarms: None, is_due: false, again_ns: 0 }
    }

    /// Looks at what is told of the case, and at the pump; whether it is to ring now.
    pub(super) fn look(&mut self, told: Option<&Told>, viewer: &mut Viewer) -> bool {
        self.is_on && self.hear(system::now_ns(), told.map(|told| told.fallen), alarms(viewer))
    }

    /// What is not known at this moment, since nobody says it, is as it was.
    fn hear(&mut self, now_ns: u64, fallen: Option<u64>, alarms: Option<u32>) -> bool {
        if let Some(fallen) = fallen {
            self.is_due |= self.fallen.is_some_and(|before| fallen > before);
            self.fallen = Some(fallen);
        }
        if let Some(alarms) = alarms {
            self.is_due |= self.alarms.is_some_and(|before| alarms & !before & !PUMP_NOTICES != 0);
            self.alarms = Some(alarms);
        }
        let rings = self.is_due && now_ns >= self.again_ns;
        if rings {
            (self.is_due, self.again_ns) = (false, now_ns + PAUSE_NS);
        }
        rings
    }
}

/// The bits of the pump's alarms, as the newest fluid says them; `None` while none has said any.
fn alarms(viewer: &mut Viewer) -> Option<u32> {
    let slots = (0..Role::Fluid.slots().1).filter_map(|index| Slot::new(Role::Fluid, index));
    let found = slots.filter_map(|slot| viewer.slot_page(slot)?.cell(fluid::STATUS));
    found.map(|(_, status)| status).max_by_key(|status| (status.epoch, status.state_tick)).map(|status| status.alarms)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn the_bell_rings_once_for_each_warning_that_falls_however_many_stand_and_not_for_what_fell_before_the_first_look() {
        let mut bell = Bell::new(true);
        let mut at = |ms: u64, fallen: Option<u64>| bell.hear(ms * MS, fallen, None);
        assert!(!at(0, None) && !at(500, Some(2)), "a guardian that takes the station over");
        assert!(at(1_000, Some(3)));
        assert!(!at(2_500, Some(3)) && !at(9_000, None) && !at(9_500, Some(3)), "it stands, or has ended");
        assert!(at(10_000, Some(5)), "two at once are one ring");
        assert!(!at(20_000, Some(0)) && at(20_500, Some(1)), "a judge that began anew");
    }

    #[test]
    fn an_alarm_rings_unless_it_asks_for_nothing_and_what_is_not_known_stands_as_it_did() {
        let mut bell = Bell::new(true);
        let mut at = |ms: u64, alarms: Option<u32>| bell.hear(ms * MS, None, alarms);
        assert!(!at(0, None) && !at(100, Some(4)), "it stood before the first look");
        assert!(!at(500, Some(PUMP_NOTICES)));
        assert!(at(1_000, Some(PUMP_NOTICES | 1)) && !at(3_000, None) && !at(3_500, Some(1)));
        assert!(at(4_000, Some(1 | 8)), "a second one");
    }

    #[test]
    fn two_within_a_second_are_two_rings_a_second_apart() {
        let mut bell = Bell::new(true);
        assert!(!bell.hear(0, Some(0), Some(0)));
        assert!(bell.hear(1_000 * MS, Some(0), Some(1)));
        assert!(!bell.hear(1_500 * MS, Some(1), Some(1)));
        assert!(bell.hear(2_000 * MS, Some(1), Some(1)) && !bell.hear(9_000 * MS, None, None));
    }
}
