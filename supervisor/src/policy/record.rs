//! What outlives a supervisor of what the policy knows: how often in a row a slot's incarnations lived for too short a time, whether it was given up, and
//! whether whoever did its role's work there hands that over.
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
    /// Who did its role's work there is to be replaced, or was, and nobody is ready in its place yet, of a servo out of its shadow.
    pub hands_over: bool,
}

/// The bits of a slot's record that say that it was given up, and that its role is handed over; the short lives in a row are below them.
const GIVEN_UP_BIT: u32 = 31;
const HANDS_OVER_BIT: u32 = 30;

impl Record {
    /// As it stands in the station's page.
    pub fn word(self) -> u32 {
        self.short_lives | u32::from(self.given_up) << GIVEN_UP_BIT | u32::from(self.hands_over) << HANDS_OVER_BIT
    }
    /// From the station's page.
    pub fn of_word(word: u32) -> Record {
        let is_set = |bit: u32| (word >> bit) & 1 != 0;
        let short_lives = word & ((1 << HANDS_OVER_BIT) - 1);
        Record { short_lives, given_up: is_set(GIVEN_UP_BIT), hands_over: is_set(HANDS_OVER_BIT) }
    }
}

impl State {
    /// What a supervisor that is restarted is to know of each slot.
    pub fn records(&self) -> impl Iterator<Item = (Slot, Record)> + '_ {
        let record = |place: &Place| {
            let given_up = matches!(place.life, Life::GivenUp { .. });
            // Of a place that was given up nobody is waited for.
            Record { short_lives: place.short_lives, given_up, hands_over: place.hands_over && !given_up }
        };
        self.places.iter().map(move |(slot, place)| (*slot, record(place)))
    }
    /// Goes on from what a supervisor before this one knew of a slot, before anybody is adopted.
    pub fn set_record(&mut self, now_ns: u64, slot: Slot, record: Record) {
        let limits = limits(slot.role());
        if let Some(place) = self.places.get_mut(&slot).filter(|place| matches!(place.life, Life::Vacant { .. })) {
            place.short_lives = record.short_lives.min(limits.most_short_lives);
            place.hands_over = record.hands_over;
            let due_ns = now_ns + limits.wait_ns(place.short_lives);
            let again_ns = now_ns + TRY_AGAIN_NS;
            place.life = if record.given_up { Life::GivenUp { again_ns } } else { Life::Vacant { due_ns } };
        }
    }
}
