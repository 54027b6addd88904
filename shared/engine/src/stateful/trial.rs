//! A newcomer on trial, as the processes of its role see it.
//!
//! The *guest* sits in a slot of its own, beside holder and spare. In the shadow it computes from the role's states what the holder will compute,
//! and sends it under no epoch, for the judge alone. On trial it takes the role, between two steps of the holder. From then on the
//! *elders* keep stepping the *line*, the state that the role had before, and send that under no epoch; if the guest dies, misses its
//! steps or sends what cannot be accepted, one of them takes the role back and goes on from the line, as if the guest had never been. Each takeover is
//! the one compare-and-swap of the roster, and the first state of an epoch has one writer, as ever.

use super::{Loop, Stateful};
use crate::life::Failure;
use crate::realtime;
use hyst_exchange::succession::{Turn, most_misses, spare_turn};
use hyst_exchange::{Tenure, system};
use hyst_messages::Message;
use hyst_messages::mischief::Outlet;
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{Stage, header};
use hyst_messages::tolerance::SHADOW_EPOCH;

/// Steps of a real-time role of which the guest shadows one: beside holder, workers and servos two cores have no room for all of them.
const SHADOW_EVERY: u64 = 4;
/// A role with a longer step than this is shadowed step by step, ticks.
const SHORT_STEP_TICKS: u64 = 4;
/// Misses in a row after which an elder takes the role back, where the role is an ordinary process: on a busy machine everybody misses some, and a
/// death is seen at once. A real-time guest is late or hangs as any holder does ([`most_misses`]): on two cores that a guest and an elder fill
/// nobody is punctual for 2 s. One that is a little too slow is in time again after each of its leaps: the supervisor counts those, and takes off what
/// the machine explains.
const MISSES_OF_ORDINARY: u32 = 10;
/// Looks in a row at which the line has not grown, after which the other elder steps it although the one that did so lives. Longer than the
/// ordinary thread that it is goes without a core: two that step it have no room on two cores. A role with a longer step looks once in each.
const fn misses_of_the_line(step_ticks: u64) -> u32 {
    if step_ticks <= SHORT_STEP_TICKS { 100 } else { 3 }
}
/// Ticks that the line may be behind; then it leaps over them, as a holder does. The device's ring has the inputs of the last 64.
pub const MOST_BEHIND_TICKS: u64 = 32;
/// How often a guest takes the role: what it loses to a stall of the machine it may take again; the policy counts, too.
const MOST_TURNS: u32 = 8;
/// How long a guest that lost the role waits before it takes it again, ns: one stall of the machine costs it one of its turns and not all.
const REST_NS: u64 = 500_000_000;
/// Looks at which a guest waits for the end of a step; a holder that is never done by then has its step dropped, and the guest makes it.
const MOST_WAITS: u32 = 200;
/// Between two glances within such a look, ns.
const GLANCE_NS: u64 = 50_000;

/// What a process of the role remembers of a trial.
#[derive(Debug, Default)]
pub(super) struct Trial {
    /// The guest's: how often it has taken the role.
    turns: u32,
    waits: u32,
    /// When it had the role last, ns; 0: never.
    held_ns: u64,
    /// An elder's: the line's newest tick at its last look, and looks in a row at which it had not grown though it was due.
    line_seen: u64,
    line_misses: u32,
    /// An elder's: it is an ordinary thread meanwhile.
    lowered: bool,
}

impl<S: Stateful> Loop<'_, S> {
    pub(super) fn is_guest(&self) -> bool {
        self.life.slot.is_guest()
    }

    /// Tells the chain who is on trial, so that it keeps the line; and ends the line of a trial that is over.
    pub(super) fn note_trial(&mut self, holder: Tenure) {
        let swap = self.life.clock.swap(self.role);
        self.chain.expect_guest(if self.is_guest() || !swap.keeps_line() { 0 } else { swap.guest });
        if swap.keeps_line() {
            self.strain.pause();
        }
        // Who was given the role after that was read goes on from the line.
        let is_given = || self.roster.holder(self.role).incarnation == self.me();
        if !swap.keeps_line() && holder.incarnation != self.me() && !is_given() {
            self.chain.end_line();
            self.lower(false);
            self.trial = Trial { turns: self.trial.turns, held_ns: self.trial.held_ns, ..Trial::default() };
        }
        if holder.incarnation != self.me() && holder.incarnation != swap.guest {
            self.lower(false); // the other elder has the role while the guest rests, and this one is its spare
        }
        if holder.incarnation == self.me() {
            if std::mem::take(&mut self.trial.lowered) {
                self.pin_again(); // it took the role back, and is real time again
            }
            self.trial.line_misses = 0;
            self.trial.held_ns = if self.is_guest() { system::now_ns() } else { 0 };
        }
    }

    /// The guest's part of a tick while another holds the role, before it has passed: it never substitutes and never promotes itself otherwise. Then it is
    /// a spare like any other: while the other slots are settled there may be nobody else who has the state.
    pub(super) fn shadow(&mut self, tick: u64, holder: Tenure) -> Result<(), Failure> {
        let swap = self.life.clock.swap(self.role);
        let Some(newest) = self.chain.newest().filter(|_| swap.guest == self.me()) else { return Ok(()) };
        let of_role = u64::from(Message::parse(newest.bytes(), self.engine.kind())?.header().step_ticks);
        let (newest_tick, step) = (self.chain.key().1, self.engine.step_ticks());
        // One that was told to shadow again has given the role back, which is no turn that it lost.
        if swap.stage == Stage::Shadow {
            (self.trial.turns, self.trial.waits, self.trial.held_ns) = (0, 0, 0);
        }
        match swap.stage {
            Stage::Shadow if is_shadowed(newest_tick, step, of_role) => self.make_beside(newest_tick + step, holder, false),
            // Between two steps: the holder has done the one of this tick, and has not begun the next.
            Stage::Trial if self.trial.turns < MOST_TURNS && self.has_rested() => {
                self.trial.waits += 1;
                if !self.sees_the_step_done(tick + step) && self.trial.waits <= MOST_WAITS {
                    return Ok(());
                }
                self.stand_apart(); // whoever holds the role now steps the line next
                if self.take_role(holder).is_some() {
                    (self.trial.turns, self.trial.waits, self.trial.held_ns) = (self.trial.turns + 1, 0, system::now_ns());
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Whether the holder has done the step to `next_tick` before the time of the next one. A guest looks early for a holder on a busy machine, which is done
    /// with each step later than that: where it came again at the next tick only, it had the role 200 to 400 ms after it might.
    fn sees_the_step_done(&mut self, next_tick: u64) -> bool {
        while self.life.tick() < next_tick {
            if self.chain.key().1 >= next_tick {
                return true;
            }
            system::sleep_ns(GLANCE_NS);
            self.receive_states();
        }
        false
    }

    fn has_rested(&self) -> bool {
        self.trial.held_ns == 0 || system::now_ns() >= self.trial.held_ns + REST_NS
    }

    /// An elder's part of a tick while the guest holds the role on trial.
    pub(super) fn guard(&mut self, tick: u64, holder: Tenure) -> Result<(), Failure> {
        let newest = self.chain.key();
        self.misses = if newest.1 >= tick { 0 } else { self.misses + 1 };
        if self.misses > 0 {
            self.life.distrust(holder.incarnation, Distrust::Missing);
        }
        let (step, lives) = (self.engine.step_ticks(), self.holder_lives(holder));
        let is_real_time = realtime::priority(self.role).is_some();
        let most = if is_real_time { most_misses(self.holder_hangs(holder)) } else { MISSES_OF_ORDINARY };
        // The one that steps the line comes first.
        let keeps_line = self.keeps_line(tick);
        let patience = if keeps_line { most } else { 2 * most };
        // The state that is missing is not substituted: the guest's is not the elders' to go on from.
        if spare_turn(tick, newest, holder.epoch, step, lives, self.misses, patience) == Turn::Promote {
            return self.begin_epoch(tick, holder);
        }
        let Some(line_tick) = self.chain.line().map(|line| line.tick) else { return Ok(()) };
        self.lower(keeps_line);
        if !keeps_line || line_tick >= tick + step {
            return Ok(());
        }
        let next_tick = if line_tick + MOST_BEHIND_TICKS.max(step) < tick { tick + step } else { line_tick + step };
        self.make_beside(next_tick, holder, true)?;
        // One that lost ticks to a stall catches up, a step at a time.
        let lags = self.chain.line().is_some_and(|line| line.tick > line_tick && line.tick < tick);
        if lags { self.make_beside(line_tick + 2 * step, holder, true) } else { Ok(()) }
    }

    /// Whether it is this elder that steps the line: whoever wrote its newest state goes on with it, until he dies or stands still.
    fn keeps_line(&mut self, tick: u64) -> bool {
        let line = self.chain.line().map(|line| (line.tick, line.writer));
        let Some((line_tick, writer)) = line else { return self.chain.writer() == self.me() };
        let stands = line_tick == self.trial.line_seen && line_tick < tick;
        (self.trial.line_seen, self.trial.line_misses) = (line_tick, if stands { self.trial.line_misses + 1 } else { 0 });
        let most = misses_of_the_line(self.engine.step_ticks());
        writer == self.me() || self.trial.line_misses >= most || !self.life.is_alive(self.role, writer)
    }

    /// Who steps the line is an ordinary thread meanwhile, on whatever core has room. Nobody waits for the line, and two tissues in real time leave
    /// ordinary threads so little of two cores that the kernel's fair server steps in, which takes up to 50 ms at once from whoever is real time
    /// there: 50 missed steps of a guest that had done nothing wrong. Where that class is refused it stays what it is, and where.
    fn lower(&mut self, lowered: bool) {
        if std::mem::replace(&mut self.trial.lowered, lowered) == lowered || self.life.page.load64(header::REAL_TIME) & 1 == 0 {
            return;
        }
        let Some(priority) = realtime::priority(self.role) else { return };
        if lowered {
            if system::become_ordinary() {
                system::unpin();
            }
        } else {
            self.pin_again();
            system::become_fifo(priority + realtime::SPARE_ABOVE);
        }
    }

    fn pin_again(&self) {
        if self.life.page.load64(header::REAL_TIME) & 4 != 0
            && let Some(core) = realtime::core(self.life.slot, system::places())
        {
            system::pin_to_core(core);
        }
    }

    /// A guest does not compute where the holder does: both are to be in time.
    pub(super) fn stand_apart(&mut self) {
        if !self.is_guest() || self.life.page.load64(header::REAL_TIME) & 4 == 0 {
            return;
        }
        let (cores, holder) = (system::places(), self.roster.holder(self.role).incarnation);
        let slot = self.life.clock.occupied(self.role).find(|(_, incarnation)| *incarnation == holder).map(|(slot, _)| slot);
        let own = realtime::core(self.life.slot, cores);
        if let Some((taken, own)) = slot.and_then(|slot| realtime::core(slot, cores)).zip(own) {
            system::pin_to_core(if own == taken { (taken + 1) % cores } else { own });
            if let Some(room) = &mut self.room {
                room.moves();
            }
        }
    }

    /// Computes a state beside the role, from the line or from the role's newest, and sends it under no epoch.
    fn make_beside(&mut self, next_tick: u64, holder: Tenure, from_line: bool) -> Result<(), Failure> {
        let mut context = self.context(next_tick, false, holder);
        let base = if from_line { self.chain.line().map(|line| &line.held) } else { self.chain.newest() };
        let Some(now) = base else { return Ok(()) };
        let bytes = self.engine.next_bytes(now.bytes());
        let mut loan = self.publisher.loan(bytes)?;
        context.tick = next_tick - self.engine.step_ticks();
        self.engine.step(&context, now.bytes(), loan.bytes_mut())?;
        hyst_messages::stream::change_header(loan.bytes_mut(), |header| {
            header.epoch = SHADOW_EPOCH;
            header.incarnation = self.life.incarnation;
            header.tick = next_tick;
            header.step_ticks = context.step_ticks as u32;
        });
        context.tenure.epoch = SHADOW_EPOCH;
        self.engine.finished_beside(&context, loan.bytes());
        self.lies.tell_message(self.life, Outlet::State, loan.bytes_mut());
        loan.send()?;
        self.life.page.add64(header::STREAM_BYTES, bytes as u64);
        self.receive_states();
        Ok(())
    }
}

/// Whether a guest computes the state that follows from the role's newest: of a role with a short step one in [`SHADOW_EVERY`], as the role counts its states.
/// One that counted its own, with a shorter step than the role's, would never come to one, and nobody would see that it has no tick in common with the role.
/// `of_role`: the step of that state, 0 if nothing was computed for its tick.
fn is_shadowed(newest_tick: u64, step: u64, of_role: u64) -> bool {
    let stride = if of_role == 0 { step } else { of_role };
    step > SHORT_STEP_TICKS || (newest_tick / stride + 1).is_multiple_of(SHADOW_EVERY)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a tissue with steps of 1 ms beside one with steps of 2 nothing was ever seen: its swap waited for a minute to be rolled back.
    #[test]
    fn a_guest_shadows_one_in_four_of_the_roles_states_whatever_its_own_step_is() {
        for of_role in [1u64, 2, 4] {
            for step in [1u64, 2, 4] {
                let shadowed = (1..=400u64).filter(|state| is_shadowed(*state * of_role, step, of_role)).count();
                assert_eq!(shadowed, 100, "steps of {step} beside {of_role}");
            }
            assert!(
                (1..=10u64).all(|at| is_shadowed((16 * at - 1) * of_role, of_role, of_role)),
                "the ones that the judge compares"
            );
        }
        assert!((1..=50u64).all(|state| is_shadowed(33 * state, 33, 33)), "each, if the step is long");
        assert_eq!(
            [3u64, 4, 7].map(|tick| is_shadowed(tick, 1, 0)),
            [true, false, true],
            "after a state that was only passed on"
        );
    }
}
