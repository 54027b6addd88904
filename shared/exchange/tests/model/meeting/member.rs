//! The member's steps, one access to a shared word each.

use super::*;
use hyst_exchange::meeting::rules::{JOINING, JoinWord, is_fresh, is_over};

impl Meeting {
    /// What one step of a member leads to; two results where its patience may end.
    pub(super) fn member(&self, world: &World, me: usize) -> Vec<Step> {
        let mut next = World { sights: Sights::default(), ..*world };
        let member = &mut next.members[me];
        let lead = &world.coordinators[member.follows as usize - 1];
        let incarnation = me as u8 + 1;
        match member.at {
            Follow::Dead | Follow::Unborn => return Vec::new(),
            Follow::Between => {
                // `receive`, `follow`: whoever holds the role.
                if member.follows != world.holder + 1 {
                    (member.follows, member.seen, member.job) = (world.holder + 1, 0, 0);
                }
                member.at = self.look();
            }
            Follow::Number => {
                member.number = lead.release;
                member.at = if self.flaw == Flaw::LookThenNumber { Follow::Sleep } else { Follow::Seat(0) };
            }
            Follow::Seat(seat) => {
                member.at = match lead.share_member[seat] == incarnation {
                    true => Follow::Share(seat),
                    false if seat + 1 < self.seats => Follow::Seat(seat + 1),
                    false => self.rest(),
                }
            }
            Follow::Share(seat) => {
                member.named = lead.share_release[seat];
                member.at = Follow::Again(seat);
            }
            Follow::Again(seat) => {
                let is_seated = lead.share_member[seat] == incarnation || self.flaw == Flaw::ReadOnce;
                let is_fresh = is_fresh(member.named as u32, member.seen as u32);
                member.at = if is_seated && is_fresh { Follow::Over(seat) } else { self.rest() };
                member.named = if is_seated && is_fresh { member.named } else { 0 };
            }
            Follow::Over(seat) => {
                member.seen = member.named;
                member.slept = is_over(lead.release as u32, member.named as u32);
                member.at = if member.slept { Follow::Say } else { Follow::Job(seat) };
                member.number = if member.slept { member.number } else { 0 };
                next.sights.0 |= if member.slept { SLEPT } else { 0 };
            }
            Follow::Job(_) | Follow::Answer(_) => return vec![self.share(next, world, me)],
            Follow::Say | Follow::Ring => self.say(member),
            Follow::Sleep => return self.sleep(next, world, me),
        }
        vec![Ok(next)]
    }

    /// `receive` looks at the roster; with one coordinator it always sees the same.
    fn between(&self) -> Follow {
        if self.coordinators == 1 { self.look() } else { Follow::Between }
    }

    /// `await_release`: its first access.
    fn look(&self) -> Follow {
        if self.flaw == Flaw::LookThenNumber { Follow::Seat(0) } else { Follow::Number }
    }

    /// `await_release`: nothing to do.
    fn rest(&self) -> Follow {
        if self.flaw == Flaw::LookThenNumber { Follow::Number } else { Follow::Sleep }
    }

    /// `Worker::share`, `answer`: the newest job that was not read yet; without one the release is answered all the same.
    fn share(&self, mut next: World, world: &World, me: usize) -> Step {
        let member = &mut next.members[me];
        let lead = &world.coordinators[member.follows as usize - 1];
        match member.at {
            Follow::Job(seat) => {
                if lead.named[member.named as usize] & bit(me + 1) == 0 {
                    return Err(format!("member {me} works for release {}, which did not name it", member.named));
                }
                member.at = if lead.job > member.job { Follow::Answer(seat) } else { Follow::Say };
                member.job = lead.job;
            }
            Follow::Answer(seat) => {
                member.contacts = (member.job, member.follows, seat as u8 + 1);
                member.at = Follow::Say;
            }
            _ => {}
        }
        if member.at == Follow::Say {
            member.did[member.follows as usize - 1] = member.named;
        }
        Ok(next)
    }

    /// `say_joined`: what was joined, then the bell, which wakes.
    fn say(&self, member: &mut Member) {
        let is_second = (member.at == Follow::Ring) != (self.flaw == Flaw::BellFirst);
        match JOINING[usize::from(is_second)] {
            JoinWord::Joined if self.flaw == Flaw::TwoWords => member.joined.0 = member.follows,
            JoinWord::Joined => member.joined = (member.follows, member.named),
            JoinWord::Bell => {
                member.bell = (member.bell + 1) % 8;
                member.joined.1 = if self.flaw == Flaw::TwoWords { member.named } else { member.joined.1 };
            }
        }
        member.at = match (member.at, member.slept) {
            (Follow::Say, _) => Follow::Ring,
            (_, true) => self.rest(),
            (_, false) => self.between(),
        };
        if member.at != Follow::Ring {
            (member.slept, member.named) = (false, 0);
        }
    }

    /// `await_release`: until the release word differs from the number that was read, or the patience has ended.
    fn sleep(&self, mut next: World, world: &World, me: usize) -> Vec<Step> {
        let member = &mut next.members[me];
        let is_woken = world.coordinators[member.follows as usize - 1].release != member.number;
        let mut impatient = next;
        (impatient.members[me].at, impatient.members[me].number) = (self.between(), 0);
        (next.members[me].at, next.members[me].number) = (self.look(), 0);
        let woken = is_woken.then_some(Ok(next));
        woken.into_iter().chain(self.faults.then_some(Ok(impatient))).collect()
    }
}
