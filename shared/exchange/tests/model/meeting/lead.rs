//! The coordinator's steps, one access to a shared word each.

use super::*;
use hyst_exchange::meeting::rules::{RELEASING, ReleaseWord, SEATING, SeatWord, is_joined, joined_word, next_release};

impl Meeting {
    /// Who is to sit in a seat: members count from 1, 0 is nobody.
    fn wanted(&self, world: &World, seat: usize) -> u8 {
        if seat == 0 && world.is_replaced { MEMBERS as u8 } else { seat as u8 + 1 }
    }

    fn first_of(&self, set: u8, from: usize) -> Option<usize> {
        (from..self.seats).find(|seat| set & bit(*seat) != 0)
    }

    /// Begins with the next group, or with collecting.
    fn next_group(&self, lead: &mut Coordinator) {
        lead.group += 1;
        lead.at = if (lead.group as usize) < self.groups.len() { Lead::Begin } else { Lead::Collect(0) };
    }

    fn next_member(&self, lead: &mut Coordinator, seat: usize) {
        match self.first_of(lead.asked, seat + 1) {
            Some(next) => lead.at = Lead::Word(next),
            None => self.next_group(lead),
        }
    }

    /// What one step of a coordinator leads to; two results where the clock decides.
    pub(super) fn lead(&self, world: &World, me: usize) -> Vec<Step> {
        let mut next = World { sights: Sights::default(), ..*world };
        let lead = &mut next.coordinators[me];
        let page_of = |seat: Seat| &world.members[(seat.member as usize).saturating_sub(1)];
        match lead.at {
            Lead::Idle | Lead::End | Lead::Dead => return Vec::new(),
            Lead::Arrive | Lead::ClearSeat(_) | Lead::TakeSeat(_) => self.seat(world, lead, me),
            Lead::Readmit(seat) => {
                let chair = lead.seats[seat];
                let is_joined = self.is_joined(page_of(chair).joined, chair.named, me);
                lead.at = self.readmit_from(lead, seat + 1);
                if is_joined {
                    // Unless it has to rest, `rests_until_ns`.
                    let mut back = World { sights: Sights(READMITTED), ..next };
                    back.coordinators[me].seats[seat] = Seat { excluded: false, owes: false, ..chair };
                    return vec![Ok(back), Ok(next)];
                }
            }
            Lead::SendJob => {
                lead.job = if lead.seats.iter().all(|seat| seat.excluded || seat.member == 0) { lead.job } else { lead.tick };
                lead.at = Lead::Begin;
            }
            Lead::Begin => return self.begin(next, me),
            Lead::Name(_) | Lead::Release => return vec![self.name(next, me)],
            Lead::Word(seat) => {
                lead.word = page_of(lead.seats[seat]).bell;
                lead.at = Lead::Join(seat);
            }
            Lead::Join(_) | Lead::Late(_) | Lead::Wait(_) => return self.wait(next, world, me),
            Lead::Collect(seat) => return vec![self.collect(next, world, me, seat)],
        }
        vec![Ok(next)]
    }

    fn is_joined(&self, joined: (u8, u8), release: u8, me: usize) -> bool {
        let of = if self.flaw == Flaw::AnyCoordinator { me as u8 + 1 } else { joined.0 };
        is_joined(joined_word(of as u32, joined.1 as u32), release as u32, me as u32 + 1)
    }

    fn readmit_from(&self, lead: &Coordinator, from: usize) -> Lead {
        let excluded = (from..self.seats).find(|seat| lead.seats[*seat].excluded);
        excluded.map_or(Lead::SendJob, Lead::Readmit)
    }

    /// The processes' own order, or the other way round.
    fn member_first(&self) -> bool {
        (SEATING[0] == SeatWord::Member) != (self.flaw == Flaw::SeatFirst)
    }

    /// The same.
    fn wakes_first(&self) -> bool {
        (RELEASING[0] == ReleaseWord::Release) != (self.flaw == Flaw::WakeFirst)
    }

    /// `ProcessCoordinator::seat`: the seat's release is cleared, then its member named.
    fn seat(&self, world: &World, lead: &mut Coordinator, me: usize) {
        match lead.at {
            Lead::ClearSeat(seat) => {
                lead.share_release[seat] = 0;
                lead.at = if self.member_first() { Lead::Arrive } else { Lead::TakeSeat(seat) };
            }
            Lead::TakeSeat(seat) => {
                lead.share_member[seat] = self.wanted(world, seat);
                lead.seats[seat] = Seat { member: lead.share_member[seat], ..Seat::default() };
                lead.at = if self.member_first() { Lead::ClearSeat(seat) } else { Lead::Arrive };
            }
            _ if world.holder as usize != me || lead.tick > self.ticks => lead.at = Lead::End,
            _ => {
                let newcomer = (0..self.seats).find(|seat| lead.seats[*seat].member != self.wanted(world, *seat));
                let first = if self.member_first() { Lead::TakeSeat } else { Lead::ClearSeat };
                lead.at = newcomer.map_or_else(|| self.readmit_from(lead, 0), first);
            }
        }
    }

    /// `release_group`: who is asked; the clock may already be past the deadline.
    fn begin(&self, mut next: World, me: usize) -> Vec<Step> {
        let lead = &mut next.coordinators[me];
        let here = |seat: &usize| !lead.seats[*seat].excluded && lead.seats[*seat].member != 0;
        let present = (0..self.seats).filter(here).map(bit).sum::<u8>();
        lead.asked = self.groups[lead.group as usize] & present;
        let Some(first) = self.first_of(lead.asked, 0) else {
            self.next_group(lead);
            return vec![Ok(next)];
        };
        let is_late = lead.late;
        lead.at = if self.wakes_first() { Lead::Release } else { Lead::Name(first) };
        // Past its deadline, the group is skipped: missing, but not excluded.
        let mut skipped = next;
        skipped.coordinators[me].late = true;
        self.next_group(&mut skipped.coordinators[me]);
        match (is_late, self.has_deadline()) {
            (true, _) => vec![Ok(skipped)],
            (false, true) => vec![Ok(next), Ok(skipped)],
            (false, false) => vec![Ok(next)],
        }
    }

    fn has_deadline(&self) -> bool {
        self.faults && self.flaw != Flaw::NoDeadline
    }

    /// `release_group`: the seats' words, then the release word, which wakes.
    fn name(&self, mut next: World, me: usize) -> Step {
        let wakes_first = self.wakes_first();
        let lead = &mut next.coordinators[me];
        let number = match (lead.at, wakes_first) {
            (Lead::Name(_), true) => lead.release,
            _ => next_release(lead.release as u32) as u8,
        };
        let first = self.first_of(lead.asked, 0).unwrap_or(0);
        match lead.at {
            Lead::Name(seat) => {
                let chair = &mut lead.seats[seat];
                if chair.owes {
                    return Err(format!("seat {seat} is asked again before its member has caught up"));
                }
                chair.named = number;
                lead.share_release[seat] = number;
                lead.named[number as usize] |= bit(chair.member as usize);
                let last = if wakes_first { Lead::Word(first) } else { Lead::Release };
                lead.at = self.first_of(lead.asked, seat + 1).map_or(last, Lead::Name);
            }
            _ => {
                lead.release = number;
                lead.at = if wakes_first { Lead::Name(first) } else { Lead::Word(first) };
            }
        }
        Ok(next)
    }

    /// `release_group`: the wait for one member.
    fn wait(&self, mut next: World, world: &World, me: usize) -> Vec<Step> {
        let lead = &mut next.coordinators[me];
        match lead.at {
            Lead::Join(seat) => {
                let chair = lead.seats[seat];
                let member = &world.members[chair.member as usize - 1];
                if !self.is_joined(member.joined, chair.named, me) {
                    lead.at = Lead::Late(seat);
                } else if member.did[me] != chair.named {
                    return vec![Err(format!("seat {seat} is counted as joined and has not done the release"))];
                } else {
                    lead.joined |= bit(seat);
                    lead.word = 0;
                    self.next_member(lead, seat);
                }
                vec![Ok(next)]
            }
            Lead::Late(seat) => {
                let mut late = next;
                let chair = &mut late.coordinators[me];
                chair.late = true;
                chair.seats[seat].excluded = self.flaw != Flaw::NoExclusion;
                chair.seats[seat].owes = true;
                chair.word = 0;
                self.next_member(chair, seat);
                late.sights.0 |= EXCLUDED;
                let is_late = next.coordinators[me].late;
                next.coordinators[me].at = Lead::Wait(seat);
                match (is_late, self.has_deadline()) {
                    (true, _) => vec![Ok(late)],
                    (false, true) => vec![Ok(late), Ok(next)],
                    (false, false) => vec![Ok(next)],
                }
            }
            Lead::Wait(seat) => {
                let is_changed = world.members[lead.seats[seat].member as usize - 1].bell != lead.word;
                lead.at = Lead::Word(seat);
                let woken = is_changed.then_some(Ok(next));
                next.coordinators[me].late = true;
                woken.into_iter().chain(self.has_deadline().then_some(Ok(next))).collect()
            }
            _ => Vec::new(),
        }
    }

    /// `Collision::test`: the share of one seat, by its member or here.
    fn collect(&self, mut next: World, world: &World, me: usize, seat: usize) -> Step {
        let lead = &mut next.coordinators[me];
        let wanted = (lead.tick, me as u8 + 1, seat as u8 + 1);
        if lead.joined & bit(seat) != 0 {
            let found = world.members[lead.seats[seat].member as usize - 1].contacts;
            let is_taken = found == wanted || self.flaw == Flaw::Unchecked;
            if is_taken && found != wanted {
                return Err(format!("seat {seat} gives the share {found:?} for {wanted:?}"));
            }
            next.sights.0 |= if is_taken { 0 } else { REFUSED };
            lead.done |= if is_taken { bit(seat) } else { 0 };
        }
        let computes_alone = lead.done & bit(seat) == 0 && (lead.joined & bit(seat) == 0 || self.flaw != Flaw::JoinedIsDone);
        lead.done |= if computes_alone { bit(seat) } else { 0 };
        if lead.done & bit(seat) == 0 {
            return Err(format!("share {seat} of tick {} is lost", lead.tick));
        }
        let all = bit(self.seats) - 1;
        if !self.faults && lead.joined != all {
            return Err("a member is missing although nothing has happened to it".into());
        }
        next.sights.0 |= if lead.joined == all { ALL_JOINED } else { 0 };
        if seat + 1 < self.seats {
            lead.at = Lead::Collect(seat + 1);
        } else {
            (lead.at, lead.asked, lead.joined, lead.done) = (Lead::Arrive, 0, 0, 0);
            (lead.group, lead.late) = (0, false);
            lead.tick += 1;
        }
        Ok(next)
    }
}
