//! The roster: which incarnation holds each role, and in which epoch. Written by promotion alone, one compare-and-swap with one
//! winner; read by everyone. A higher epoch fences a lower one, without co-operation of whom it fences.

use crate::page::OwnedPage;
use crate::station::{Station, StationError, StationPage};
use crate::succession;
use hyst_messages::Role;
use hyst_messages::page::roster as layout;
use std::cell::Cell;

/// Epochs of a station: one promotion in each millisecond for three weeks.
pub const MOST_EPOCHS: u32 = 1 << 31;
/// Epochs that a role may be ahead of the station's ticks. In the long run it is promoted less than once a tick: a holder leaps at most once in each
/// of its steps, and a takeover waits for a death or for misses. This is room for a clock that has just begun, or stands in lock-step.
pub const EPOCHS_AHEAD: u64 = 1 << 16;

/// Who holds a role.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tenure {
    /// Grows with each promotion; 0 means that nobody ever held the role.
    pub epoch: u32,
    /// The holder.
    pub incarnation: u32,
}

impl Tenure {
    /// As one word, as the roster and the page of each process of the role have it.
    pub fn word(self) -> u64 {
        (self.epoch as u64) << 32 | self.incarnation as u64
    }
    /// The tenure of a word.
    pub fn from_word(word: u64) -> Tenure {
        Tenure { epoch: (word >> 32) as u32, incarnation: word as u32 }
    }
    /// Whether this can be: a holder that was born, in an epoch that the station can have reached by this tick. What cannot is neither followed nor
    /// promoted from. An epoch far ahead of its time would leave no room for the promotions after it.
    pub fn is_sound(self, next_incarnation: u64, tick: u64) -> bool {
        (self.epoch == 0) == (self.incarnation == 0)
            && (self.incarnation as u64) < next_incarnation.max(1)
            && (self.epoch as u64) <= tick.saturating_add(EPOCHS_AHEAD)
            && self.epoch < MOST_EPOCHS
    }
    /// Whether this may be found where `seen` was found before: epochs only grow, and each has one holder.
    pub fn may_follow(self, seen: Tenure) -> bool {
        self.epoch > seen.epoch || self == seen
    }
    /// What is put in the place of nonsense: the holder of the highest epoch that was `seen`, in the epoch after that, so that whatever was sent in
    /// the name of the role so far is fenced; nobody, if nobody was seen to hold it.
    pub fn mended(seen: impl IntoIterator<Item = Tenure>) -> Tenure {
        let newest = seen.into_iter().max().unwrap_or_default();
        if newest.epoch == 0 { Tenure::default() } else { Tenure { epoch: newest.epoch.saturating_add(1), ..newest } }
    }
}

/// The roster's page.
#[derive(Debug)]
pub struct Roster {
    page: OwnedPage,
}

impl Roster {
    /// Maps the roster.
    pub fn open(station: &Station) -> Result<Roster, StationError> {
        Ok(Roster { page: OwnedPage::open(&station.roster_page(), layout::WORDS)? })
    }
    /// Who holds the role.
    pub fn holder(&self, role: Role) -> Tenure {
        Tenure::from_word(self.page.load64(layout::OWNER + role as usize))
    }
    /// Puts a tenure in the place of one that is not sound, and mends the page's own header. The supervisor's work.
    pub fn mend(&self, role: Role, nonsense: Tenure, tenure: Tenure) -> Result<(), Tenure> {
        self.mend_header();
        self.page.swap64(layout::OWNER + role as usize, nonsense.word(), tenure.word()).map_err(Tenure::from_word)
    }
    /// The same without mapping the page as a roster, which a damaged header forbids: for who begins to keep a station.
    pub fn restore_header(station: &Station) -> Result<bool, StationError> {
        let page = OwnedPage::open_damaged(&station.roster_page(), layout::WORDS)?;
        Ok(Roster { page }.mend_header())
    }
    /// Writes the page's magic again if it was damaged, so that newcomers can map it; true if it was.
    pub fn mend_header(&self) -> bool {
        self.page.mend_magic()
    }
    /// Takes the role from `from`, whom the caller saw hold it. One of several callers wins; the others get the winner.
    pub fn promote(&self, role: Role, from: Tenure, incarnation: u32) -> Result<Tenure, Tenure> {
        let next = Tenure { epoch: from.epoch.saturating_add(1), incarnation };
        match self.page.swap64(layout::OWNER + role as usize, from.word(), next.word()) {
            Ok(()) => Ok(next),
            Err(found) => Err(Tenure::from_word(found)),
        }
    }
}

/// How far the states of a role can have come, as one reader knows: the highest epoch that the roster said so far, and the clock. A roster that says
/// less than before, or what cannot be, is nonsense that the supervisor mends, and changes nothing here.
#[derive(Debug)]
pub struct Horizon {
    roster: Roster,
    role: Role,
    seen: Cell<Tenure>,
}

impl Horizon {
    /// Of a role.
    pub fn open(station: &Station, role: Role) -> Result<Horizon, StationError> {
        Ok(Horizon { roster: Roster::open(station)?, role, seen: Cell::default() })
    }

    /// Whether somebody may hold the role like this: it is [sound](Tenure::is_sound), and may follow what was seen before. What may not, nobody acts on,
    /// the one that it names not excepted: whatever he said in its name, each reader that has seen a higher epoch would refuse.
    pub fn admits(&self, holder: Tenure, clock: &StationPage) -> bool {
        let admitted = holder.is_sound(clock.next_incarnation(), clock.present_tick()) && holder.may_follow(self.seen.get());
        if admitted {
            self.seen.set(holder);
        }
        admitted
    }

    /// Whether a state, found before this is asked, is one that [nobody can have made yet](succession::is_ahead); `step` in ticks.
    pub fn is_passed_by(&self, found: succession::Key, step: u64, clock: &StationPage) -> bool {
        self.admits(self.roster.holder(self.role), clock);
        let epoch = self.seen.get().epoch;
        epoch > 0 && succession::is_ahead(found, epoch, clock.latest_tick(), step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::page::header;

    #[test]
    fn a_state_is_bounded_by_the_highest_epoch_that_was_won_whatever_the_roster_says_later() {
        let station = Station::named(&format!("t{}-horizon", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let (keeping, clock) = (station.open_for_keeping().unwrap(), station.open().unwrap());
        keeping.store64(hyst_messages::page::station::NEXT_INCARNATION, 9);
        let (roster, horizon) = (Roster::open(&station).unwrap(), Horizon::open(&station, Role::Tissue).unwrap());
        let tick = clock.present_tick();
        let is_passed = |epoch: u32, ahead: u64| horizon.is_passed_by((epoch, tick + ahead), 1, &clock);
        assert!(!is_passed(77, 0), "nobody has held the role yet");
        for epoch in 0..3 {
            roster.promote(Role::Tissue, roster.holder(Role::Tissue), 4 + epoch).unwrap();
        }
        assert!(!is_passed(3, 0) && !is_passed(1, 0) && is_passed(4, 0) && is_passed(3, 1 << 40));
        let word =
            |epoch: u64, incarnation: u64| roster.page.store64(layout::OWNER + Role::Tissue as usize, epoch << 32 | incarnation);
        word(1, 6);
        assert!(!is_passed(3, 0) && is_passed(4, 0), "a word that goes back is nonsense");
        word(5, 7_000);
        assert!(!is_passed(3, 0) && is_passed(4, 0), "a holder that was never born");
        // With no supervisor alive, whoever is named in an epoch that is over does not take himself for the holder.
        let admits = |epoch, incarnation| horizon.admits(Tenure { epoch, incarnation }, &clock);
        assert!(!admits(1, 6) && !admits(3, 5) && !admits(0, 0) && admits(3, 6));
        word(5, 8);
        assert!(!is_passed(5, 0) && is_passed(6, 0) && !admits(4, 7));
        station.wipe();
    }

    #[test]
    fn of_many_who_promote_themselves_at_once_one_wins_each_epoch() {
        let station = Station::named(&format!("t{}-roster", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let wins: usize = std::thread::scope(|scope| {
            let mut handles = Vec::new();
            for incarnation in 1..=4 {
                let station = &station;
                handles.push(scope.spawn(move || {
                    let roster = Roster::open(station).unwrap();
                    let mut wins = 0;
                    for epoch in 0..200 {
                        let from = loop {
                            let holder = roster.holder(Role::Tissue);
                            if holder.epoch >= epoch {
                                break holder;
                            }
                            std::hint::spin_loop();
                        };
                        wins += usize::from(from.epoch == epoch && roster.promote(Role::Tissue, from, incarnation).is_ok());
                    }
                    wins
                }));
            }
            handles.into_iter().map(|handle| handle.join().unwrap()).sum()
        });
        assert_eq!(wins, 200);
        assert_eq!(Roster::open(&station).unwrap().holder(Role::Tissue).epoch, 200);
        station.wipe();
    }

    #[test]
    fn a_holder_that_was_never_born_is_not_sound_and_is_mended() {
        let station = Station::named(&format!("t{}-mend", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let roster = Roster::open(&station).unwrap();
        assert!(roster.holder(Role::Fluid).is_sound(1, 0));
        let good = roster.promote(Role::Fluid, Tenure::default(), 3).unwrap();
        assert!(good.is_sound(4, 0) && !good.is_sound(3, 0));
        for (epoch, incarnation) in [(0, 3), (3, 0), (MOST_EPOCHS, 3), (u32::MAX, u32::MAX), (2, 4)] {
            assert!(!Tenure { epoch, incarnation }.is_sound(4, u64::MAX), "{epoch} {incarnation}");
        }
        let nonsense = Tenure::from_word(u64::MAX);
        roster.page.store64(layout::OWNER + Role::Fluid as usize, u64::MAX);
        roster.page.store64(header::MAGIC, 7);
        assert!(matches!(Roster::open(&station), Err(StationError::Page(_))), "another version, or damaged");
        assert_eq!(roster.mend(Role::Fluid, nonsense, Tenure { epoch: 2, incarnation: 3 }), Ok(()));
        assert_eq!(Roster::open(&station).unwrap().holder(Role::Fluid), Tenure { epoch: 2, incarnation: 3 });
        station.wipe();
    }

    /// The last epoch that there is, under a holder that lives: the promotion after it led to one that cannot be, and so did each attempt to mend that.
    #[test]
    fn an_epoch_ahead_of_its_time_is_not_sound_and_what_it_is_mended_to_is_with_room_for_promotions() {
        let of = |epoch| Tenure { epoch, incarnation: 3 };
        let last = MOST_EPOCHS - 1;
        let three_weeks = u64::from(last) - EPOCHS_AHEAD;
        assert!(!of(last).is_sound(4, 0) && !of(last).is_sound(4, three_weeks - 1) && of(last).is_sound(4, three_weeks));
        for tick in [0, 7, 3_600_000] {
            assert!(of(1).is_sound(4, tick) && of((tick + EPOCHS_AHEAD) as u32).is_sound(4, tick));
            assert!(!of((tick + EPOCHS_AHEAD) as u32 + 1).is_sound(4, tick));
        }
        let seen = [of(41), Tenure { epoch: 40, incarnation: 9 }, Tenure::default()];
        assert_eq!(Tenure::mended(seen), of(42));
        assert!(Tenure::mended(seen).is_sound(4, 0) && of(43).is_sound(4, 0), "and the promotion after it");
        assert_eq!(Tenure::mended([]), Tenure::default());
        assert_eq!(Tenure::mended([Tenure::default()]), Tenure::default());
        assert_eq!(Tenure::mended([of(u32::MAX)]).epoch, u32::MAX, "no epoch wraps");
    }

    #[test]
    fn an_epoch_that_goes_back_or_changes_hands_cannot_be() {
        let seen = Tenure { epoch: 41, incarnation: 3 };
        assert!(seen.may_follow(seen) && seen.may_follow(Tenure::default()));
        assert!(Tenure { epoch: 42, incarnation: 2 }.may_follow(seen) && Tenure { epoch: 90, incarnation: 3 }.may_follow(seen));
        for (epoch, incarnation) in [(41, 2), (40, 3), (1, 5), (0, 0)] {
            assert!(!Tenure { epoch, incarnation }.may_follow(seen), "{epoch} {incarnation}");
        }
    }
}
