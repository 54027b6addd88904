//! A start that is hindered on request: whoever comes after a process that was killed for it hangs, or ends, before it is warm. In test mode alone.

use super::asked;
use crate::life::Life;
use hyst_exchange::system;
use hyst_messages::TICK_NS;
use hyst_messages::mischief::{Mischief, Request};

impl Life {
    /// What hinders this process's start.
    fn hindrance(&self) -> Option<Mischief> {
        asked(&self.clock, self.slot, |words| Request::of_start(words, self.incarnation)).map(|request| request.what)
    }

    /// At the beginning of a life: hangs until the request ends, or gives the exit code with which the process is to end.
    pub(crate) fn hindered_start(&self) -> Option<u8> {
        let hindrance = self.hindrance()?;
        self.own_up();
        self.say(if hindrance == Mischief::HangStart { "hangs in its start, as it is asked" } else { "ends, as it is asked" });
        while self.hindrance() == Some(Mischief::HangStart) && !self.clock.stop_requested() {
            system::sleep_ns(TICK_NS);
        }
        (hindrance == Mischief::CrashStart).then_some(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use hyst_messages::page::{header, station as layout};
    use hyst_messages::{Role, Slot};

    #[test]
    fn a_start_is_hindered_for_those_who_come_after_and_in_test_mode_alone() {
        let station = Station::named(&format!("t{}-start", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        std::fs::write(station.settings(), "").unwrap();
        let slot = Slot::first(Role::Recorder);
        let lives = [4, 5].map(|incarnation| {
            station.create_slot(slot, incarnation).unwrap();
            Life::begin(station.name(), slot, incarnation).unwrap()
        });
        let page = station.open_for_keeping().unwrap();
        let request = Request::of(Mischief::CrashStart, 4);
        page.store64(layout::MISCHIEF + slot.number(), request.words()[0]);
        let codes = || lives.each_ref().map(Life::hindered_start);
        assert_eq!(codes(), [None, None], "outside of test mode");
        page.store32(layout::TEST_MODE, 1);
        assert_eq!(codes(), [None, Some(1)]);
        assert_eq!(lives[1].page.load64(header::MISCHIEF), 1, "it owns up");
        // A hang that is over by its time does not hold anybody.
        let hang = Request { what: Mischief::HangStart, until_ns: 1, ..request };
        page.store64(layout::MISCHIEF_UNTIL_NS + slot.number(), hang.until_ns);
        page.store64(layout::MISCHIEF + slot.number(), hang.words()[0]);
        assert_eq!(codes(), [None, None]);
        station.wipe();
    }
}
