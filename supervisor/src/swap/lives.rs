//! The lives of the device of which a recorder on probation writes: the present one, and those before it, whose last ticks come to the file after their death.

use hyst_exchange::{ReadPage, Station};
use hyst_messages::page::device::APPLIED;
use hyst_messages::{AppliedRecord, Slot};
use hyst_recording::sequence::RING_TICKS;

/// Lives that are known at most: a page that is held is memory.
const MOST_LIVES: usize = 8;

struct DeviceLife {
    incarnation: u32,
    page: ReadPage,
    /// The first tick that it made, as far as its ring shows; `None` before it has made one.
    began: Option<u64>,
}

impl DeviceLife {
    fn note_beginning(&mut self) {
        if self.began.is_none() {
            let end = self.page.ring_end(APPLIED);
            let oldest = end.saturating_add(1).saturating_sub(RING_TICKS);
            self.began = (oldest..end).find(|tick| self.page.ring(APPLIED, *tick).is_some());
        }
    }
}

/// The lives that are known, oldest first.
#[derive(Default)]
pub(super) struct Lives {
    known: Vec<DeviceLife>,
}

impl Lives {
    /// Takes those that are present and not known yet. A page that is being made is taken at the next look.
    pub(super) fn meet(&mut self, station: &Station, present: impl IntoIterator<Item = (Slot, u32)>) {
        for (slot, incarnation) in present {
            if self.known.iter().all(|life| life.incarnation != incarnation)
                && let Ok(page) = station.read_slot(slot, incarnation)
            {
                self.known.push(DeviceLife { incarnation, page, began: None });
            }
        }
        let surplus = self.known.len().saturating_sub(MOST_LIVES);
        self.known.drain(..surplus);
        self.known.iter_mut().for_each(DeviceLife::note_beginning);
    }

    /// The newest tick that one of them has for a recorder; 0 if there is none.
    pub(super) fn newest_tick(&self) -> u64 {
        self.known.iter().map(|life| life.page.ring_end(APPLIED).saturating_sub(1)).max().unwrap_or(0)
    }

    /// What the ring of the newest one has of a tick.
    pub(super) fn made_last(&self, tick: u64) -> Option<AppliedRecord> {
        self.known.last()?.page.ring(APPLIED, tick)
    }

    /// What their rings have of a tick. An older life counts only for what came before the newer one, as it does for a recorder.
    pub(super) fn made(&self, tick: u64) -> Option<AppliedRecord> {
        for life in self.known.iter().rev() {
            let record = life.page.ring(APPLIED, tick);
            if record.is_some() || life.began.is_some_and(|began| tick >= began) {
                return record;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Role;

    #[test]
    fn a_life_that_is_over_still_counts_for_what_came_before_the_next_one_and_only_the_newest_are_held() {
        let station = Station::named(&format!("t{}-lives", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Device);
        let push = |incarnation: u32, ticks: std::ops::RangeInclusive<u64>| {
            let page = station.create_slot(slot, incarnation).unwrap();
            ticks.for_each(|tick| page.push(APPLIED, tick, &AppliedRecord { tick, ..AppliedRecord::default() }));
            page
        };
        let mut lives = Lives::default();
        assert_eq!((lives.newest_tick(), lives.made(1).is_some()), (0, false));
        push(1, 1..=330);
        lives.meet(&station, [(slot, 1)]);
        let empty = station.create_slot(slot, 2).unwrap();
        lives.meet(&station, [(slot, 2)]);
        assert_eq!((lives.newest_tick(), lives.made(300).is_some()), (330, true), "the new one has made nothing");
        for tick in [320, 321, 340] {
            empty.push(APPLIED, tick, &AppliedRecord { tick, ..AppliedRecord::default() });
        }
        lives.meet(&station, [(slot, 2), (slot, 3)]);
        let has = [319, 320, 325, 340].map(|tick| lives.made(tick).is_some());
        assert_eq!((lives.newest_tick(), has), (340, [true, true, false, true]), "a dead one makes none");
        assert_eq!([319, 320].map(|tick| lives.made_last(tick).is_some()), [false, true]);
        for incarnation in 3..10 {
            push(incarnation, 400..=400);
            lives.meet(&station, [(slot, incarnation)]);
        }
        assert_eq!((lives.known.len(), lives.made(300).is_some()), (MOST_LIVES, false));
        station.wipe();
    }
}
