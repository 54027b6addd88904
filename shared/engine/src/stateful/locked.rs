//! The loop of an engine with a spare in lock-step: the holder steps when it is released; the spare waits within the tick until the holder's
//! state is there, and steps itself if the holder is known to be dead, or after the patience. While the roster says what cannot be, nobody steps.

use super::{Loop, Stateful};
use crate::life::Failure;
use crate::lockstep::{EAGER_NS, LockMember, PATIENCE_NS};
use hyst_exchange::{Tenure, system};

impl<S: Stateful> Loop<'_, S> {
    pub(super) fn run_in_lockstep(&mut self) -> Result<(), Failure> {
        let mut member = LockMember::new(self.life);
        loop {
            let holder = self.roster.holder(self.role);
            self.note_role(holder);
            member.set_steps(holder.incarnation == self.me());
            let Some(tick) = member.wait(|| self.between())? else { return Ok(()) };
            self.life.misbehave();
            self.tick_in_lockstep(tick)?;
            member.join(tick);
        }
    }

    /// At each look between two steps.
    fn between(&mut self) -> Result<(), Failure> {
        self.helpers.look(self.life);
        self.receive_ports();
        // A reader that came since gets the newest state although nobody steps: it may be what the tick waits for.
        let _ = self.publisher.announce(); // a link that fails here fails for newcomers alone
        let holder = self.roster.holder(self.role);
        if holder.incarnation == self.me() || self.holder_lives(holder) || !self.is_sound(holder) {
            return Ok(());
        }
        self.receive_states();
        if self.chain.newest().is_some()
            && let Some(tenure) = self.take_role(holder)
        {
            self.send_again(tenure)?;
        }
        Ok(())
    }

    /// Sends the newest state again under the own epoch: while the sequencer holds nobody steps, and a newcomer waits for a state.
    fn send_again(&mut self, tenure: Tenure) -> Result<(), Failure> {
        let Some(newest) = self.chain.newest() else { return Ok(()) };
        let mut loan = self.publisher.loan(newest.bytes().len())?;
        loan.bytes_mut().copy_from_slice(newest.bytes());
        hyst_messages::stream::change_header(loan.bytes_mut(), |header| {
            header.epoch = tenure.epoch;
            header.incarnation = self.life.incarnation;
        });
        loan.send()?;
        self.receive_states();
        Ok(())
    }

    /// Returns when the state of `tick` is there, whoever made it.
    fn tick_in_lockstep(&mut self, tick: u64) -> Result<(), Failure> {
        let deadline_ns = system::now_ns() + PATIENCE_NS;
        if self.roster.holder(self.role).incarnation != self.me() {
            self.receive_ports();
            self.engine.look();
        }
        loop {
            self.helpers.look(self.life);
            self.receive_ports();
            self.receive_states();
            let (_, newest_tick) = self.chain.key();
            if newest_tick >= tick || self.chain.newest().is_none() || self.life.clock.stop_requested() {
                return Ok(());
            }
            let late = system::now_ns() >= deadline_ns;
            let holder = self.roster.holder(self.role);
            if !self.is_sound(holder) {
                // The supervisor mends it; a stop ends the wait.
            } else if holder.incarnation == self.me() {
                // The recording of a replay may say that ticks were lost.
                let follows = self.life.is_replay() || follows([newest_tick, self.made_tick], self.engine.step_ticks(), tick);
                let is_supplied = follows && self.engine.is_supplied(newest_tick, tick);
                if late && !is_supplied {
                    let within_s = PATIENCE_NS / 1_000_000_000;
                    self.life.say(&format!("what the state of tick {tick} is made from has not come within {within_s} s"));
                }
                if late || is_supplied {
                    self.make(tick, holder)?;
                    if self.roster.holder(self.role) == holder {
                        return Ok(());
                    }
                }
            } else if (late || !self.holder_lives(holder)) && self.take_role(holder).is_some() {
                continue;
            }
            self.life.heartbeat();
            system::sleep_ns(EAGER_NS);
        }
    }
}

/// Whether the state before that of `tick` has come, from the ticks of the newest one and of the newest that this process has made itself. Of that one none
/// other comes: where it was refused, because it is none to go on from, the step is made from the one before, as in real time.
fn follows([newest_tick, made_tick]: [u64; 2], step_ticks: u64, tick: u64) -> bool {
    newest_tick.max(made_tick) + step_ticks >= tick
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_holder_waits_for_the_state_before_and_not_for_one_of_its_own_that_it_has_refused() {
        assert!(follows([99, 0], 1, 100) && follows([66, 66], 33, 99), "it is there");
        assert!(!follows([98, 0], 1, 100) && !follows([98, 98], 1, 100), "another has made it, and it is on its way");
        assert!(follows([98, 99], 1, 100) && follows([33, 66], 33, 99), "it was its own");
    }
}
