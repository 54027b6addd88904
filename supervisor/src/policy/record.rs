//! What outlives a supervisor of what the policy knows: how often in a row a slot's incarnations lived for too short a time, and whether it was given up.
//! So a restart of the supervisor is no way around the count of short lives; the bound on deaths in a window of time begins anew with it.

use super::{Life, Place, State, TRY_AGAIN_NS, limits};
use hyst_messages::Slot;

/// What outlives a supervisor of a slot's lives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Record {
    /// Short lives in a row.
    pub short_lives: u32,
    /// It was given up.
    pub given_up: bool,
}

/// The bit of a slot's record that says that it was given up; the short lives in a row are below it.
const GIVEN_UP_BIT: u32 = 31;

impl Record {
    /// As it stands in the station's page.
    pub fn word(self) -> u32 {
        self.short_lives | u32::from(self.given_up) << GIVEN_UP_BIT
    }
    /// From the station's page.
    pub fn of_word(word: u32) -> Record {
        Record { short_lives: word & !(1 << GIVEN_UP_BIT), given_up: word >> GIVEN_UP_BIT != 0 }
    }
}

impl State {
    /// What a supervisor that is restarted is to know of each slot.
    pub fn records(&self) -> impl Iterator<Item = (Slot, Record)> + '_ {
        let record =
            |place: &Place| Record { short_lives: place.short_lives, given_up: matches!(place.life, Life::GivenUp { .. }) };
        self.places.iter().map(move |(slot, place)| (*slot, record(place)))
    }
    /// Goes on from what a supervisor before this one knew of a slot, before anybody is adopted.
    pub fn set_record(&mut self, now_ns: u64, slot: Slot, record: Record) {
        let limits = limits(slot.role());
        if let Some(place) = self.places.get_mut(&slot).filter(|place| matches!(place.life, Life::Vacant { .. })) {
            place.short_lives = record.short_lives.min(limits.most_short_lives);
            let due_ns = now_ns + limits.wait_ns(place.short_lives);
            let again_ns = now_ns + TRY_AGAIN_NS;
            place.life = if record.given_up { Life::GivenUp { again_ns } } else { Life::Vacant { due_ns } };
        }
    }
}
