//! The Meeting Point between processes: futex words in the station pages. The coordinator writes its release into its own page, each
//! member its join into its own; nobody writes a word that another owns, so a death can corrupt nothing. `tests/model` runs through every
//! interleaving of these accesses, with deaths, zombies and replacements.

use super::rules::{JoinWord, ReleaseWord, SeatWord};
use super::{Coordinator, Group, MAX_MEMBERS, Member, Outcome, Release, members, rules};
use crate::page::{OwnedPage, ReadPage};
use crate::system;
use hyst_messages::page::header;
use std::num::NonZeroU32;
use std::sync::Arc;

/// Between two looks whether a member is lost, where somebody asks, ns.
const LOOK_NS: u64 = 500_000;

#[derive(Debug)]
struct Seat {
    page: ReadPage,
    incarnation: u32,
    excluded: bool,
    /// Newest release that named the member.
    named: u32,
    /// Releases that it missed, less those that it joined in time.
    misses: u32,
    /// Until when it is not asked, ns.
    rests_until_ns: u64,
}

impl Seat {
    /// Whether the member has joined this release of this coordinator.
    fn has_joined(&self, number: u32, coordinator: u32) -> bool {
        rules::is_joined(self.page.load64(header::JOINED), number, coordinator)
    }

    fn rests(&self) -> bool {
        self.excluded && system::now_ns() < self.rests_until_ns
    }

    /// `rests`: it may have to rest for it; on a virtual clock nobody does.
    fn has_missed(&mut self, rests: bool) {
        self.excluded = true;
        self.misses = self.misses.saturating_add(1);
        self.rests_until_ns = if rests { system::now_ns() + rules::rest_ns(self.misses) } else { 0 };
    }
}

/// The side that releases.
#[derive(Debug)]
pub struct ProcessCoordinator {
    page: Arc<OwnedPage>,
    incarnation: u32,
    seats: [Option<Seat>; MAX_MEMBERS],
}

impl ProcessCoordinator {
    /// A coordinator that releases through its own page.
    pub fn new(page: Arc<OwnedPage>) -> ProcessCoordinator {
        let incarnation = page.incarnation();
        ProcessCoordinator { page, incarnation, seats: Default::default() }
    }

    /// Seats a member, or its replacement; gives back the page of whom it replaces, to be unmapped elsewhere.
    pub fn seat(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        let incarnation = page.incarnation();
        for word in rules::SEATING {
            match word {
                SeatWord::Release => self.page.store32(header::SHARE_RELEASE + index, 0),
                SeatWord::Member => self.page.store32(header::SHARE_MEMBER + index, incarnation),
            }
        }
        let seat = Seat { page, incarnation, excluded: false, named: 0, misses: 0, rests_until_ns: 0 };
        let before = self.seats[index].replace(seat);
        before.map(|seat| seat.page)
    }

    /// Incarnation of the member in a seat, 0 if empty.
    pub fn incarnation_at(&self, index: usize) -> u32 {
        self.seats[index].as_ref().map_or(0, |seat| seat.incarnation)
    }

    /// The seats that are taken and of which this is true.
    fn seats_that(&self, is_so: impl Fn(&Seat) -> bool) -> Group {
        let so = self.seats.iter().enumerate().filter(|(_, seat)| seat.as_ref().is_some_and(&is_so));
        so.fold(0, |mask, (index, _)| mask | 1 << index)
    }

    /// Seats taken by members that are not excluded.
    pub fn present(&self) -> Group {
        self.seats_that(|seat| !seat.excluded)
    }

    /// Excluded members that have joined the last release that named them, and have rested, are back.
    pub fn readmit(&mut self) {
        let incarnation = self.incarnation;
        for seat in self.seats.iter_mut().flatten().filter(|seat| seat.excluded && !seat.rests()) {
            seat.excluded = !seat.has_joined(seat.named, incarnation);
        }
    }

    /// Seats whose members rest: nobody has asked them, so they have missed nothing.
    pub fn resting(&self) -> Group {
        self.seats_that(Seat::rests)
    }

    /// Present members whose page says that they are warm or live.
    pub fn ready(&self) -> Group {
        self.seats_that(|seat| !seat.excluded && seat.page.state().is_ready())
    }

    /// Releases one group; a member that is `lost` is not waited for any longer. Looks for that every half millisecond.
    pub fn release_unless(&mut self, group: Group, deadline_ns: u64, lost: &dyn Fn(&ReadPage) -> bool) -> Outcome {
        self.readmit();
        let joined = self.release_group(group, deadline_ns, Some(lost));
        Outcome { joined, missing: group & !joined }
    }

    fn name(&mut self, asked: Group, number: u32) {
        for index in members(asked) {
            if let Some(seat) = &mut self.seats[index] {
                seat.named = number;
                self.page.store32(header::SHARE_RELEASE + index, number);
            }
        }
    }

    fn release_group(&mut self, group: Group, deadline_ns: u64, lost: Option<&dyn Fn(&ReadPage) -> bool>) -> Group {
        let asked = group & self.present();
        // A group whose time is up before it begins is missing, but not to blame: it is neither released nor excluded.
        if asked == 0 || system::now_ns() >= deadline_ns {
            return 0;
        }
        let number = rules::next_release(self.page.load32(header::RELEASE));
        // Whoever is not asked sleeps on; who has no seat yet waits for any.
        let whom = NonZeroU32::new(asked).unwrap_or(NonZeroU32::MAX);
        for word in rules::RELEASING {
            match word {
                ReleaseWord::Seats => self.name(asked, number),
                ReleaseWord::Release => self.page.store32_and_wake_as(header::RELEASE, number, whom),
            }
        }
        let mut joined = 0;
        for index in members(asked) {
            let Some(seat) = &self.seats[index] else { continue };
            // Bounded by the deadline: each pass either sees the join, or waits until the word changes or the deadline.
            loop {
                let word = seat.page.load32(header::JOIN);
                if seat.has_joined(number, self.incarnation) {
                    joined |= 1 << index;
                    break;
                }
                let now_ns = system::now_ns();
                if now_ns >= deadline_ns || lost.is_some_and(|lost| lost(&seat.page)) {
                    break;
                }
                let look_ns = if lost.is_some() { deadline_ns.min(now_ns + LOOK_NS) } else { deadline_ns };
                seat.page.wait(header::JOIN, word, look_ns);
            }
            match &mut self.seats[index] {
                Some(seat) if joined & (1 << index) == 0 => seat.has_missed(lost.is_none()),
                Some(seat) => seat.misses = seat.misses.saturating_sub(1),
                None => {}
            }
        }
        joined
    }
}

impl Coordinator for ProcessCoordinator {
    fn release(&mut self, groups: &[Group], deadline_ns: u64) -> Outcome {
        let mut outcome = Outcome::default();
        self.readmit();
        for &group in groups {
            let joined = self.release_group(group, deadline_ns, None);
            outcome.joined |= joined;
            outcome.missing |= group & !joined;
        }
        outcome
    }
}

/// One member. It follows one coordinator at a time.
#[derive(Debug)]
pub struct ProcessMember {
    page: Arc<OwnedPage>,
    incarnation: u32,
    coordinator: Option<(ReadPage, u32)>,
    seen: u32,
}

impl ProcessMember {
    /// A member that joins through its own page.
    pub fn new(page: Arc<OwnedPage>) -> ProcessMember {
        let incarnation = page.incarnation();
        ProcessMember { page, incarnation, coordinator: None, seen: 0 }
    }

    /// Follows a coordinator from now on; gives back the page of the one before.
    pub fn follow(&mut self, coordinator: ReadPage) -> Option<ReadPage> {
        let incarnation = coordinator.incarnation();
        self.seen = 0;
        self.coordinator.replace((coordinator, incarnation)).map(|(page, _)| page)
    }

    /// Incarnation of the coordinator that is followed, 0 if none.
    pub fn follows(&self) -> u32 {
        self.coordinator.as_ref().map_or(0, |(_, incarnation)| *incarnation)
    }

    /// Newest release that named this member in its seat (0 if none did). `None` if the seat is another's by now.
    fn named_in(&self, coordinator: &ReadPage, index: usize) -> Option<u32> {
        let named = coordinator.load32(header::SHARE_RELEASE + index);
        // Read again: the seat may have been given to a replacement in between, and the release with it.
        self.is_seated(coordinator, index).then_some(named)
    }

    fn is_seated(&self, coordinator: &ReadPage, index: usize) -> bool {
        coordinator.load32(header::SHARE_MEMBER + index) == self.incarnation
    }

    fn seat_in(&self, coordinator: &ReadPage) -> Option<usize> {
        (0..MAX_MEMBERS).find(|index| self.is_seated(coordinator, *index))
    }

    fn say_joined(&self, coordinator: u32, number: u32) {
        for word in rules::JOINING {
            match word {
                JoinWord::Joined => self.page.store64(header::JOINED, rules::joined_word(coordinator, number)),
                JoinWord::Bell => {
                    self.page.bump_and_wake(header::JOIN);
                }
            }
        }
    }
}

impl Member for ProcessMember {
    fn await_release(&mut self, deadline_ns: u64) -> Option<Release> {
        let Some((page, coordinator)) = &self.coordinator else {
            system::sleep_until_ns(deadline_ns);
            return None;
        };
        let coordinator = *coordinator;
        loop {
            let number = page.load32(header::RELEASE);
            let seat = self.seat_in(page);
            if let Some(index) = seat
                && let Some(named) = self.named_in(page, index).filter(|named| rules::is_fresh(*named, self.seen))
            {
                self.seen = named;
                // The seat's word is written before the release word, so it may be ahead of it, but behind only if the release is over.
                if !rules::is_over(page.load32(header::RELEASE), named) {
                    return Some(Release { number: named, coordinator, index });
                }
                self.say_joined(coordinator, named); // slept through it: no work, but caught up
            }
            if system::now_ns() >= deadline_ns {
                return None;
            }
            // A seat is given before the first release that names it, so that who has none yet waits for any.
            let own = seat.and_then(|index| NonZeroU32::new(1 << index)).unwrap_or(NonZeroU32::MAX);
            page.wait_as(header::RELEASE, number, deadline_ns, own);
        }
    }

    fn join(&mut self, release: Release) {
        self.say_joined(release.coordinator, release.number);
    }
}
