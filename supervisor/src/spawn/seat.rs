//! Who sits in a slot, as the supervisor knows it from the start or the adoption of a process, beside what the station page says of it.

use crate::remains::Living;
use hyst_exchange::OwnedPage;
use hyst_messages::Slot;
use hyst_messages::page::station as layout;

/// What the station page says of who is in a slot, in words that nobody else writes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seat {
    pub(super) incarnation: u32,
    pub(super) pid: u32,
    pub(super) start: u64,
}

impl Seat {
    fn is_said(self, page: &OwnedPage, slot: Slot) -> bool {
        let at = slot.number();
        let said = Seat {
            incarnation: page.load32(layout::SLOT_INCARNATION + at),
            pid: page.load32(layout::SLOT_PID + at),
            start: page.load64(layout::SLOT_START + at),
        };
        said == self
    }

    /// Nobody is there in between: who died there must not be taken for alive.
    pub(super) fn say(self, page: &OwnedPage, slot: Slot) {
        let at = slot.number();
        page.store32(layout::SLOT_INCARNATION + at, 0);
        page.store64(layout::SLOT_START + at, self.start);
        page.store32(layout::SLOT_PID + at, self.pid);
        page.store32(layout::SLOT_DEAD + at, 0);
        page.store32(layout::SLOT_INCARNATION + at, self.incarnation);
        page.bump_and_wake(layout::CHANGES);
    }

    /// Writes anew what is not said of one who lives; gives whether it had to.
    pub(super) fn mend(self, page: &OwnedPage, slot: Slot) -> bool {
        let at = slot.number();
        if self.is_said(page, slot) || page.load32(layout::SLOT_DEAD + at) != 0 {
            return false;
        }
        page.store64(layout::SLOT_START + at, self.start);
        page.store32(layout::SLOT_PID + at, self.pid);
        page.store32(layout::SLOT_INCARNATION + at, self.incarnation);
        page.bump_and_wake(layout::CHANGES);
        true
    }

    /// Its process, if it lives.
    pub(super) fn living(self, slot: Slot) -> Option<Living> {
        let living = Living { pid: self.pid, start: self.start, name: slot.to_string() };
        living.is_alive().then_some(living)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::book;
    use hyst_exchange::system;
    use hyst_messages::Role;

    /// With a flipped bit in a process id an engine could not be ended, hurt or adopted for the rest of the session, and its pid was shown wrong.
    #[test]
    fn what_the_page_no_longer_says_of_who_lives_is_written_anew_and_of_the_dead_nothing() {
        let (station, _faults) = book("seats");
        let page = station.open_for_keeping().unwrap();
        let (slot, at) = (Slot::first(Role::Rendering), Slot::first(Role::Rendering).number());
        let seat = Seat { incarnation: 9, pid: 4711, start: 815 };
        seat.say(&page, slot);
        assert!(seat.is_said(&page, slot) && !seat.mend(&page, slot), "as it was entered");
        let damages: [&dyn Fn(&OwnedPage); 3] = [
            &|page| page.store32(layout::SLOT_PID + at, 4711 ^ 64),
            &|page| page.store64(layout::SLOT_START + at, 815 ^ (1 << 40)),
            &|page| page.store32(layout::SLOT_INCARNATION + at, 9 ^ 2),
        ];
        for damage in damages {
            damage(&page);
            assert!(!seat.is_said(&page, slot) && seat.mend(&page, slot) && seat.is_said(&page, slot));
        }
        page.store32(layout::SLOT_DEAD + at, 1);
        page.store32(layout::SLOT_PID + at, 0);
        assert!(!seat.mend(&page, slot), "who is dead is nobody's victim");
    }

    /// An id that had flipped when it was to be ended was that of nobody, and whoever waited for its death waited for ever.
    #[test]
    fn who_lives_is_known_by_its_seat_and_not_by_what_the_page_says_of_it() {
        let (slot, pid) = (Slot::first(Role::Rendering), std::process::id());
        let seat = Seat { incarnation: 9, pid, start: system::process_start(pid).unwrap() };
        assert_eq!(seat.living(slot).map(|living| living.pid), Some(pid));
        assert_eq!(Seat { start: seat.start + 1, ..seat }.living(slot), None, "another of the same id");
    }
}
