//! How a process comes to hold a role: by its own compare-and-swap, or by that of the supervisor; and what it must know before its first step as the
//! holder, lest time goes back for those who read it.

use super::{Loop, Stateful};
use crate::life::Failure;
use hyst_exchange::roster::Tenure;
use hyst_exchange::succession::{Turn, holder_turn};
use hyst_messages::page::header;

impl<S: Stateful> Loop<'_, S> {
    /// Takes the role from whom was seen to hold it, with a new epoch; `None` if another was faster.
    pub(super) fn take_role(&mut self, from: Tenure) -> Option<Tenure> {
        let tenure = self.roster.promote(self.role, from, self.me()).ok()?;
        if from.incarnation != self.me() {
            self.life.page.add64(header::PROMOTIONS, 1);
        }
        self.note_role(tenure);
        Some(tenure)
    }

    /// Takes the role from whom was seen to hold it, and computes the first state of the epoch. Nothing to do if another was faster.
    pub(super) fn begin_epoch(&mut self, tick: u64, from: Tenure) -> Result<(), Failure> {
        let Some(tenure) = self.take_role(from) else { return Ok(()) };
        self.stepped_as = tenure;
        let is_strained = self.strain.is_lasting(tick, tenure.epoch) && !self.life.is_lockstep();
        let mut tick = self.catch_up(tick);
        if is_strained {
            // After that: a state that the spare made meanwhile has the old step, which is taken from whatever is gone on from.
            self.engine.lengthen();
            tick = tick / self.engine.step_ticks() * self.engine.step_ticks();
        }
        match holder_turn(tick, self.chain.key(), tenure.epoch, self.engine.step_ticks()) {
            Turn::Step(next_tick) => self.make(next_tick, tenure),
            _ => Ok(()), // a state of a still higher epoch is there
        }
    }

    /// The tick of the holder's turn: that of the wake-up, unless somebody else made it the holder meanwhile, as the supervisor does for a swap.
    pub(super) fn tick_of(&mut self, tick: u64, holder: Tenure) -> u64 {
        if std::mem::replace(&mut self.stepped_as, holder) == holder { tick } else { self.catch_up(tick) }
    }

    /// Looks again, after the role was seen to be its own under a new tenure: this thread may have stood since it woke, so that what it knew then may be
    /// old by now, the clock too. Gives the tick of the last step that is due.
    fn catch_up(&mut self, tick: u64) -> u64 {
        self.receive_states();
        let step_ticks = self.engine.step_ticks();
        tick.max(self.life.tick() / step_ticks * step_ticks)
    }
}
