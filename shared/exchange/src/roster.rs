//! The roster: which incarnation holds each role, and in which epoch. Written by promotion alone, one compare-and-swap with one
//! winner; read by everyone. A higher epoch fences a lower one, without co-operation of whom it fences.

use crate::page::OwnedPage;
use crate::station::{Station, StationError};
use hyst_messages::Role;
use hyst_messages::page::roster as layout;

/// Who holds a role.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tenure {
    /// Grows with each promotion; 0 means that nobody ever held the role.
    pub epoch: u32,
    /// The holder.
    pub incarnation: u32,
}

impl Tenure {
    fn word(self) -> u64 {
        (self.epoch as u64) << 32 | self.incarnation as u64
    }
    fn from_word(word: u64) -> Tenure {
        Tenure { epoch: (word >> 32) as u32, incarnation: word as u32 }
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
    /// Takes the role from `from`, whom the caller saw hold it. One of several callers wins; the others get the winner.
    pub fn promote(&self, role: Role, from: Tenure, incarnation: u32) -> Result<Tenure, Tenure> {
        let next = Tenure { epoch: from.epoch + 1, incarnation };
        match self.page.swap64(layout::OWNER + role as usize, from.word(), next.word()) {
            Ok(()) => Ok(next),
            Err(found) => Err(Tenure::from_word(found)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
