//! The Meeting Point between processes: futex words in the station pages. The coordinator writes its release into its own page, each
//! member its join into its own; nobody writes a word that another owns, so a death can corrupt nothing.

use super::{Coordinator, Group, MAX_MEMBERS, Member, Outcome, Release, members};
use crate::page::{OwnedPage, ReadPage};
use crate::system;
use hyst_messages::page::{WORDS32, header};
use std::sync::Arc;

/// 32-bit words of the coordinator's page, one for each seat: the newest release that named the seat. A member looks at its own word
/// alone, so it is never released by the mask of another group, and one that slept through a release finds out and catches up.
const SHARE_RELEASE: usize = header::SHARE_MEMBER + MAX_MEMBERS;
const _: () = assert!(SHARE_RELEASE + MAX_MEMBERS <= WORDS32);

#[derive(Debug)]
struct Seat {
    page: ReadPage,
    incarnation: u32,
    excluded: bool,
    /// Newest release that named the member.
    named: u32,
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
        // In this order, so that the newcomer never takes a release that named its predecessor for its own.
        self.page.store32(SHARE_RELEASE + index, 0);
        self.page.store32(header::SHARE_MEMBER + index, incarnation);
        let before = self.seats[index].replace(Seat { page, incarnation, excluded: false, named: 0 });
        before.map(|seat| seat.page)
    }

    /// Incarnation of the member in a seat, 0 if empty.
    pub fn incarnation_at(&self, index: usize) -> u32 {
        self.seats[index].as_ref().map_or(0, |seat| seat.incarnation)
    }

    /// Seats taken by members that are not excluded.
    pub fn present(&self) -> Group {
        let present = |(index, seat): (usize, &Option<Seat>)| seat.as_ref().filter(|seat| !seat.excluded).map(|_| 1 << index);
        self.seats.iter().enumerate().filter_map(present).fold(0, |mask, bit: Group| mask | bit)
    }

    fn has_joined(&self, seat: &Seat, number: u32) -> bool {
        seat.page.load32(header::JOIN) == number && seat.page.load32(header::JOIN_OF) == self.incarnation
    }

    /// Excluded members that have joined the last release that named them are back.
    pub fn readmit(&mut self) {
        let incarnation = self.incarnation;
        for seat in self.seats.iter_mut().flatten().filter(|seat| seat.excluded) {
            let caught_up = seat.page.load32(header::JOIN) == seat.named && seat.page.load32(header::JOIN_OF) == incarnation;
            seat.excluded = !caught_up;
        }
    }

    fn release_group(&mut self, group: Group, deadline_ns: u64) -> Group {
        let asked = group & self.present();
        // A group whose time is up before it begins is missing, but not to blame: it is neither released nor excluded.
        if asked == 0 || system::now_ns() >= deadline_ns {
            return 0;
        }
        // Zero is what a fresh page holds, so it is never a release.
        let number = self.page.load32(header::RELEASE).wrapping_add(1).max(1);
        for index in members(asked) {
            if let Some(seat) = &mut self.seats[index] {
                seat.named = number;
                self.page.store32(SHARE_RELEASE + index, number);
            }
        }
        self.page.store32_and_wake(header::RELEASE, number);
        let mut joined = 0;
        for index in members(asked) {
            let Some(seat) = &self.seats[index] else { continue };
            // Bounded by the deadline: each pass either sees the join, or waits until the word changes or the deadline.
            loop {
                let word = seat.page.load32(header::JOIN);
                if self.has_joined(seat, number) {
                    joined |= 1 << index;
                    break;
                }
                if system::now_ns() >= deadline_ns {
                    break;
                }
                seat.page.wait(header::JOIN, word, deadline_ns);
            }
            if joined & (1 << index) == 0
                && let Some(seat) = &mut self.seats[index]
            {
                seat.excluded = true;
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
            let joined = self.release_group(group, deadline_ns);
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

    /// Newest release that named this member, and its seat. `None` if it has no seat, or never had a release there.
    fn named_in(&self, coordinator: &ReadPage) -> Option<(u32, usize)> {
        let seated = |index: &usize| coordinator.load32(header::SHARE_MEMBER + index) == self.incarnation;
        let index = (0..MAX_MEMBERS).find(seated)?;
        let named = coordinator.load32(SHARE_RELEASE + index);
        // Read again: the seat may have been given to a replacement in between, and the release with it.
        (named != 0 && seated(&index)).then_some((named, index))
    }

    fn say_joined(&self, coordinator: u32, number: u32) {
        self.page.store32(header::JOIN_OF, coordinator);
        self.page.store32_and_wake(header::JOIN, number);
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
            if let Some((named, index)) = self.named_in(page).filter(|(named, _)| *named != self.seen) {
                self.seen = named;
                // The seat's word is written before the release word, so it may be ahead of it, but behind only if the release is over.
                let is_over = (page.load32(header::RELEASE).wrapping_sub(named) as i32) > 0;
                if !is_over {
                    return Some(Release { number: named, coordinator, index });
                }
                self.say_joined(coordinator, named); // slept through it: no work, but caught up
            }
            if system::now_ns() >= deadline_ns {
                return None;
            }
            page.wait(header::RELEASE, number, deadline_ns);
        }
    }

    fn join(&mut self, release: Release) {
        self.say_joined(release.coordinator, release.number);
    }
}
