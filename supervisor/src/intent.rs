//! What the supervisor is about to do, as one word in the station page: written before it spawns, kills or buries, cleared after; one of a kill when the death
//! was seen, or something else is begun. A successor of a supervisor that died in between finishes it or undoes it, so that no process, page or slot is left half-way.

use hyst_exchange::{OwnedPage, Station};
use hyst_messages::Slot;
use hyst_messages::page::station as layout;
use rustix::process::{Signal, getpid, kill_process};
use std::cell::Cell;

/// Environment variable that ends the first supervisor of a station at a point, as `POINT` or `POINT:PASS`; for tests, refused outside of test mode.
pub const DIES_AT: &str = "HYSTATION_SUPERVISOR_DIES_AT";

/// Points at which it can be made to die.
pub const POINTS: [&str; 17] = [
    "spawn-declared",
    "spawn-paged",
    "spawn-served",
    "spawn-started",
    "spawn-entered",
    "kill-declared",
    "kill-done",
    "reaped",
    "bury-declared",
    "bury-done",
    "swap-declared",
    "swap-told",
    "swap-adopted",
    "swap-undone",
    "swap-cleared",
    "role-promoted",
    "ground-laid",
];

/// What is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Deed {
    /// A page, services, a process, and its entry in the station page.
    Spawn = 1,
    /// A process is killed.
    Kill = 2,
    /// The page of a dead process is removed.
    Bury = 3,
    /// A process is killed because it hangs.
    EndHung = 4,
    /// A process is killed that has made room for another, and is missed by nobody.
    Dismiss = 5,
}

/// What is done to whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Intent {
    /// What.
    pub deed: Deed,
    /// Where.
    pub slot: Slot,
    /// Who.
    pub incarnation: u32,
}

impl Intent {
    fn word(self) -> u64 {
        (self.deed as u64) << 56 | (self.slot.number() as u64) << 32 | self.incarnation as u64
    }
    fn from_word(word: u64) -> Option<Intent> {
        let deed = match word >> 56 {
            1 => Deed::Spawn,
            2 => Deed::Kill,
            3 => Deed::Bury,
            4 => Deed::EndHung,
            5 => Deed::Dismiss,
            _ => return None,
        };
        let slot = Slot::from_number((word >> 32) as usize & 0xff_ffff)?;
        Some(Intent { deed, slot, incarnation: word as u32 })
    }
    /// What a supervisor before this one was about to do; nonsense is nothing.
    pub fn left(page: &OwnedPage) -> Option<Intent> {
        Intent::from_word(page.load64(layout::INTENT))
    }
    /// Says it.
    pub fn declare(self, page: &OwnedPage) {
        page.store64(layout::INTENT, self.word());
    }
    /// One is dead: whoever was to end it has done so.
    pub fn end_of(incarnation: u32, page: &OwnedPage) {
        let is_its_end = |intent: &Intent| {
            intent.incarnation == incarnation && matches!(intent.deed, Deed::Kill | Deed::EndHung | Deed::Dismiss)
        };
        if Intent::left(page).filter(is_its_end).is_some() {
            Intent::clear(page);
        }
    }
    /// It is done, or undone.
    pub fn clear(page: &OwnedPage) {
        page.store64(layout::INTENT, 0);
    }
}

/// The point at which this supervisor is to die, if a test wants that.
#[derive(Debug)]
pub struct Mortality {
    at: Option<(String, Cell<u32>)>,
}

impl Mortality {
    /// As the environment says, for the first supervisor of a station in test mode.
    pub fn of(station: &Station) -> Mortality {
        let first = station.open().is_ok_and(|page| page.test_mode() && page.page().load64(layout::SUPERVISOR_STARTS) <= 1);
        let asked = std::env::var(DIES_AT).ok().filter(|_| first);
        let at = asked.map(|text| match text.split_once(':') {
            Some((point, pass)) => (point.to_string(), Cell::new(pass.parse().unwrap_or(1))),
            None => (text, Cell::new(1)),
        });
        Mortality { at }
    }

    /// Passes a point.
    pub fn pass(&self, point: &str) {
        debug_assert!(POINTS.contains(&point));
        let Some((wanted, left)) = &self.at else { return };
        if wanted == point {
            left.set(left.get().saturating_sub(1));
            if left.get() == 0 {
                let _ = kill_process(getpid(), Signal::KILL); // it does not return
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Role;

    #[test]
    fn an_intent_is_read_back_and_nonsense_is_none() {
        for deed in [Deed::Spawn, Deed::Kill, Deed::Bury, Deed::EndHung, Deed::Dismiss] {
            let intent = Intent { deed, slot: Slot::new(Role::Tissue, 1).unwrap(), incarnation: u32::MAX };
            assert_eq!(Intent::from_word(intent.word()), Some(intent));
        }
        for word in [0, 7, u64::MAX, 6 << 56, 1 << 56 | 200 << 32] {
            assert_eq!(Intent::from_word(word), None, "{word:x}");
        }
    }
}
