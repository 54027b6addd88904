//! The bell of the terminal, for whoever trains at the window and has not the page, which has tones: it rings when a warning of the case or an alarm of the pump
//! begins, not while it stands.
//!
//! Promise: at most once a second, and nothing that has begun goes without.

use crate::view::Viewer;
use hyst_engine::Told;
use hyst_exchange::system;
use hyst_messages::page::fluid;
use hyst_messages::{PUMP_NOTICES, Role, Slot};
use std::collections::BTreeSet;

/// Between two rings, ns: what begins meanwhile is rung for then.
const PAUSE_NS: u64 = 1_000_000_000;
/// How a line that is told of the case begins, if it is a warning that stands.
const WARNING: &str = "WARNING";

/// The bell.
#[derive(Debug)]
pub(super) struct Bell {
    is_on: bool,
    /// The warnings, and the bits of the alarms, that stood at the last look.
    warnings: BTreeSet<String>,
    alarms: u32,
    is_due: bool,
    /// It does not ring before, ns.
    again_ns: u64,
}

impl Bell {
    /// One that rings, or never does.
    pub(super) fn new(is_on: bool) -> Bell {
        Bell { is_on, warnings: BTreeSet::new(), alarms: 0, is_due: false, again_ns: 0 }
    }

    /// Looks at what is told of the case, and at the pump; whether it is to ring now.
    pub(super) fn look(&mut self, told: Option<&Told>, viewer: &mut Viewer) -> bool {
        self.is_on && self.hear(system::now_ns(), told.map(|told| &told.lines[..]), alarms(viewer))
    }

    /// What is not known at this moment, since nobody says it, is as it was.
    fn hear(&mut self, now_ns: u64, lines: Option<&[String]>, alarms: Option<u32>) -> bool {
        if let Some(lines) = lines {
            let warnings: BTreeSet<String> = lines.iter().filter(|line| line.starts_with(WARNING)).cloned().collect();
            self.is_due |= !warnings.is_subset(&self.warnings);
            self.warnings = warnings;
        }
        if let Some(alarms) = alarms {
            self.is_due |= alarms & !self.alarms & !PUMP_NOTICES != 0;
            self.alarms = alarms;
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

    fn told(warnings: &[&str]) -> Vec<String> {
        let warnings = warnings.iter().map(|words| format!("{WARNING}  {words}"));
        std::iter::once("goals    1 of 3".to_string()).chain(warnings).collect()
    }

    #[test]
    fn the_bell_rings_once_when_a_warning_begins_and_again_when_it_comes_back_or_another_does() {
        let mut bell = Bell::new(true);
        let mut at = |ms: u64, warnings: &[&str]| bell.hear(ms * MS, Some(&told(warnings)), None);
        assert!(!at(0, &[]) && at(500, &["too hard"]));
        assert!(!at(1_500, &["too hard"]) && !at(9_000, &["too hard"]), "it stands");
        assert!(at(9_500, &["too hard", "50 ml are missing"]), "another one");
        assert!(!at(20_000, &["50 ml are missing"]) && !at(20_500, &[]), "they end");
        assert!(at(21_000, &["too hard"]), "it is back");
    }

    #[test]
    fn an_alarm_rings_unless_it_asks_for_nothing_and_what_is_not_known_stands_as_it_did() {
        let mut bell = Bell::new(true);
        let mut at = |ms: u64, alarms: Option<u32>| bell.hear(ms * MS, None, alarms);
        assert!(!at(0, Some(0)) && !at(500, Some(PUMP_NOTICES)));
        assert!(at(1_000, Some(PUMP_NOTICES | 1)) && !at(3_000, None) && !at(3_500, Some(1)));
        assert!(at(4_000, Some(1 | 8)), "a second one");
    }

    #[test]
    fn two_within_a_second_are_two_rings_a_second_apart() {
        let mut bell = Bell::new(true);
        assert!(bell.hear(1_000 * MS, None, Some(1)));
        assert!(!bell.hear(1_500 * MS, Some(&told(&["too hard"])), Some(1)));
        assert!(bell.hear(2_000 * MS, Some(&told(&["too hard"])), Some(1)) && !bell.hear(9_000 * MS, None, None));
    }
}
