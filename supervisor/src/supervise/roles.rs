//! The roles with a state: who holds them, a roster or a page's header that was damaged, the ground that founders start from, and handing a role over.

use super::Supervisor;
use crate::journal::{self, Seldom};
use crate::policy::{self, Event, Ground, Ladder, State};
use hyst_exchange::system;
use hyst_exchange::{OwnedPage, Roster, Station, StationError, StationPage, Tenure};
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Role, Slot};
use std::sync::atomic::{Ordering, fence};

/// The roster as the supervisor sees it.
#[derive(Debug)]
pub struct Holders {
    roster: Roster,
    last: [Tenure; Role::STATEFUL.len()],
    /// What was last put in the place of nonsense: the next nonsense may come before that was seen.
    mended: [Tenure; Role::STATEFUL.len()],
    /// Whoever writes nonsense into the roster may do so all the time.
    said_of_tenures: Seldom,
    said_of_header: Seldom,
}

impl Holders {
    /// Maps the roster.
    pub fn open(station: &Station) -> Result<Holders, StationError> {
        let roster = Roster::open(station)?;
        let (last, mended) = Default::default();
        Ok(Holders { roster, last, mended, said_of_tenures: Seldom::default(), said_of_header: Seldom::default() })
    }
}

/// Roles that a supervisor before this one held still stay so, and one that it let go back is on its way still.
pub fn resume(page: &OwnedPage, clock: &StationPage, state: &mut State) {
    for role in Role::STATEFUL {
        let ground_tick = page.load64(layout::GROUND + role as usize);
        let before_ns = (ground_tick != 0).then(|| clock.start_of(ground_tick));
        let (word, is_held) = (page.load32(layout::LADDER + role as usize), clock.is_held(role));
        state.set_ladder(role, Ladder::resumed(word, before_ns, is_held, system::now_ns()));
    }
}

impl Supervisor {
    /// Tells the policy who holds each role, and mends what cannot be: engines neither follow it nor promote from it.
    pub(super) fn note_holders(&mut self, now_ns: u64) {
        if self.holders.roster.mend_header() {
            self.holders.said_of_header.say(&self.station, now_ns, journal::ROSTER_MENDED);
            self.faults.mended(&self.station.roster_page());
        }
        for (index, role) in Role::STATEFUL.into_iter().enumerate() {
            let tenure = self.holders.roster.holder(role);
            let (last, mended) = (self.holders.last[index], self.holders.mended[index]);
            if tenure == last && tenure.may_follow(mended) {
                continue;
            }
            // A supervisor that has just begun knows no tenure before this one; the holder's page does.
            let seen: Vec<Tenure> = self.tenures_in_pages(role).into_iter().chain([last, mended]).collect();
            if !self.is_sound(tenure) || seen.iter().any(|seen| !tenure.may_follow(*seen)) {
                if let Some(mended) = self.mend(now_ns, role, tenure, seen) {
                    self.holders.mended[index] = mended;
                }
                continue;
            }
            self.holders.last[index] = tenure;
            if tenure.incarnation != last.incarnation {
                self.note_tenure(role, tenure.incarnation, last.incarnation);
            } else {
                self.note_leaps(tenure.incarnation, u64::from(tenure.epoch.saturating_sub(last.epoch)));
            }
            let actions = policy::step(now_ns, Event::Holds { role, incarnation: tenure.incarnation }, &mut self.policy);
            self.act(actions);
        }
    }

    /// Mends the headers of the station's page and of the pages of those who live: who has mapped one goes on, but no successor of anybody could begin, or be
    /// connected with them.
    pub(super) fn mend_headers(&mut self, now_ns: u64) {
        if self.page.mend_magic() {
            self.holders.said_of_header.say(&self.station, now_ns, journal::STATION_MENDED);
            self.faults.mended(&self.station.station_page());
        }
        for slot in self.spawner.mend_seats() {
            let text = format!("the station's page did not say any more who {slot} is, and was mended");
            self.holders.said_of_header.say(&self.station, now_ns, &text);
            self.faults.mended(&self.station.station_page());
        }
        for slot in self.slots.clone() {
            let (incarnation, dead) = (self.viewer.page().incarnation(slot), self.viewer.page().is_dead(slot));
            // One that cannot be mapped may be damaged, too.
            let is_damaged = self.viewer.slot_page(slot).is_none_or(|page| !page.has_header(slot.number(), incarnation));
            // One that is gone meanwhile has no page.
            if !dead && is_damaged && matches!(self.station.mend_slot(slot, incarnation), Ok(true)) {
                let text = format!("the page of {slot} had a damaged header, which was mended");
                self.holders.said_of_header.say(&self.station, now_ns, &text);
                self.faults.mended(&self.station.slot_page(slot, incarnation));
            }
        }
    }

    /// The watch has taken back that somebody is dead who lives.
    pub(super) fn note_said_dead(&mut self, slot: Slot) {
        let text = format!("the station's page said that {slot} is dead, which lives, and was mended");
        self.holders.said_of_header.say(&self.station, system::now_ns(), &text);
        self.faults.mended(&self.station.station_page());
    }

    fn is_sound(&self, tenure: Tenure) -> bool {
        let clock = self.viewer.page();
        tenure.is_sound(clock.next_incarnation(), clock.present_tick())
    }

    /// What those who live and hold the role, as far as they know, say of their tenures. Read after the roster: then none is younger than it, unless it
    /// has changed since, and a mend fails.
    fn tenures_in_pages(&mut self, role: Role) -> Vec<Tenure> {
        let slots = (0..role.slots().1).filter_map(|index| Slot::new(role, index));
        let living: Vec<Slot> = slots.filter(|slot| !self.viewer.page().is_dead(*slot)).collect();
        let said = living.into_iter().filter_map(|slot| {
            let incarnation = self.viewer.page().incarnation(slot);
            let tenure = Tenure::from_word(self.viewer.slot_page(slot)?.load64(header::TENURE));
            (tenure.incarnation == incarnation).then_some(tenure)
        });
        let said: Vec<Tenure> = said.collect();
        said.into_iter().filter(|tenure| tenure.epoch > 0 && self.is_sound(*tenure)).collect()
    }

    /// Puts the holder that was seen last in the place of nonsense, in an epoch above all that were seen, and gives that; `None` if the roster has changed
    /// meanwhile, which is looked at again.
    fn mend(&mut self, now_ns: u64, role: Role, nonsense: Tenure, seen: Vec<Tenure>) -> Option<Tenure> {
        let mended = Tenure::mended(seen);
        self.holders.roster.mend(role, nonsense, mended).ok()?;
        let Tenure { epoch, incarnation } = nonsense;
        let name = role.name();
        let text = format!(
            "the roster named incarnation {incarnation} as holder of {name} in epoch {epoch}, which cannot be; it was mended"
        );
        self.holders.said_of_tenures.say(&self.station, now_ns, &text);
        self.faults.mended(&self.station.roster_page());
        Some(mended)
    }

    pub(super) fn go_back(&mut self, role: Role, ground: Ground) {
        let (now_ns, now_tick) = (system::now_ns(), self.viewer.page().present_tick());
        let tick_at = |time_ns: u64| now_tick.saturating_sub(now_ns.saturating_sub(time_ns) / hyst_messages::TICK_NS).max(1);
        let name = role.name();
        let (tick, held, text) = match ground {
            Ground::Newest => (0, 0, format!("{name} has lasted: its founders start from the newest state again")),
            Ground::Before(time_ns) => {
                let tick = tick_at(time_ns);
                (
                    tick,
                    0,
                    format!(
                        "{} holders of {name} died one after the other of the same state: the next one starts from before tick {tick}",
                        policy::MOST_DOOMED
                    ),
                )
            }
            Ground::Hold(time_ns) => {
                let tick = tick_at(time_ns);
                (
                    tick,
                    1,
                    format!(
                        "{name} is held still from now on: no holder survived a step, from older states neither; {}the rest goes on",
                        if role == Role::Tissue { "forces fade, " } else { "" }
                    ),
                )
            }
            Ground::Again(time_ns) => (tick_at(time_ns), 0, format!("{name} was held still and is tried again")),
        };
        self.page.store64(layout::GROUND + role as usize, tick);
        self.spawner.mortality.pass("ground-laid");
        self.page.store32(layout::HELD + role as usize, held);
        journal::say(&self.station, &text);
        // Whoever took the role before this may have started from the ground of before; a founder reads the ground after it took the role.
        fence(Ordering::SeqCst);
        let incarnation = self.holders.roster.holder(role).incarnation;
        let actions = policy::step(now_ns, Event::Holds { role, incarnation }, &mut self.policy);
        self.act(actions);
    }

    /// Gives the role to its warm spare: one compare-and-swap, as if the spare had promoted itself. The holder sees the higher epoch and steps
    /// down.
    pub(super) fn hand_over_role(&mut self, role: Role, incarnation: u32) {
        self.note_holders(system::now_ns()); // nobody is promoted from nonsense
        let holder = self.holders.roster.holder(role);
        if self.holders.roster.promote(role, holder, incarnation).is_ok() {
            self.spawner.mortality.pass("role-promoted");
            journal::say(
                &self.station,
                &format!("{} is handed over from incarnation {} to {incarnation}", role.name(), holder.incarnation),
            );
        }
        self.note_holders(system::now_ns());
    }
}
