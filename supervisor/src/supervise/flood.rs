//! Whether an engine floods its log. What engines print lies in the memory that all share, and whoever needs some dies once that is full: at a GiB a second it
//! is between two looks of the accounts, which shorten what has grown long (`journal.rs`). Promise: a log that is flooded is shortened at the next look, and
//! whoever floods it is replaced, or rolled back if it is on trial; of the hardware, a thing outside of the station, it is said.

use super::Supervisor;
use crate::fault::finder;
use crate::journal;
use crate::spawn;
use hyst_exchange::Station;
use hyst_messages::{Role, Slot};

/// A log has at most 4 MiB after each look of the accounts, a second apart. With more than this it is flooded, bytes: hundreds of panics with whole backtraces are
/// less, and it is a quarter of the room that a station has beside what it takes at first (608 MiB, of which some 350).
const MOST_BYTES: u64 = 64 << 20;

/// Whether a log of so many bytes is flooded: where there is no room left also one without which there would be some.
fn is_flooded(bytes: u64, is_full: impl FnOnce() -> bool) -> bool {
    bytes > MOST_BYTES || bytes > spawn::LEAST_FREE && is_full()
}

/// Shortens the log of a slot if it is flooded; gives how many bytes it had.
pub(super) fn stem(station: &Station, slot: Slot) -> Option<u64> {
    let bytes = journal::log_bytes(station, slot);
    if !is_flooded(bytes, || spawn::is_full(station)) {
        return None;
    }
    journal::keep_small(station, &[slot]);
    Some(bytes)
}

impl Supervisor {
    /// Looks at the logs of all slots.
    pub(super) fn heed_logs(&mut self, now_ns: u64) {
        for slot in self.slots.clone() {
            if let Some(bytes) = stem(&self.station, slot) {
                self.end_flood(now_ns, slot, bytes);
            }
        }
    }

    /// Whoever lives in a slot has flooded its log, with so many bytes: that is said and booked once, and ends with it.
    pub(super) fn end_flood(&mut self, now_ns: u64, slot: Slot, bytes: u64) {
        let (incarnation, dead) = (self.viewer.page().incarnation(slot), self.viewer.page().is_dead(slot));
        if incarnation == 0 || dead || !self.flooding.insert(incarnation) {
            return;
        }
        let floods = format!("floods its log, which had {} MiB", bytes >> 20);
        if slot.role() == Role::Hardware {
            return journal::say(&self.station, &format!("{slot} (incarnation {incarnation}) {floods}"));
        }
        self.replace_unfit(now_ns, (slot, incarnation), &format!("it {floods}"), finder::FLOOD, "it floods its log");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_to_a_log_within_a_second_is_a_flood_by_its_length_or_where_it_takes_the_last_room() {
        let of = |bytes: u64, is_full: bool| is_flooded(bytes, || is_full);
        assert_eq!([of(MOST_BYTES, false), of(MOST_BYTES + 1, false)], [false, true]);
        assert_eq!([of(spawn::LEAST_FREE, true), of(spawn::LEAST_FREE + 1, true)], [false, true]);
        assert!(!of(spawn::LEAST_FREE + 1, false), "it took nobody's room");
    }

    /// It filled /dev/shm between two looks that were a second apart.
    #[test]
    fn a_log_that_is_flooded_is_shortened_at_once_and_any_other_is_left() {
        let station = Station::named(&format!("t{}-flooded", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Fluid);
        assert_eq!(stem(&station, slot), None, "nobody has printed anything");
        let log = journal::open_log(&station, slot, 7).unwrap();
        log.set_len(MOST_BYTES / 8).unwrap(); // a hole, which takes no room itself
        assert_eq!((stem(&station, slot), log.metadata().unwrap().len()), (None, MOST_BYTES / 8));
        log.set_len(MOST_BYTES + 1).unwrap();
        assert_eq!(stem(&station, slot), Some(MOST_BYTES + 1));
        assert!(log.metadata().unwrap().len() < 1 << 17, "its end is kept");
        assert_eq!(stem(&station, slot), None);
        station.wipe();
    }
}
