//! How a process of a role with a state comes by its first state: the holder's, a checkpoint's, or the scene's; then one step that nobody sees,
//! to touch everything. Whoever finds nobody alive founds the role anew, from the ground that the supervisor allows.

use super::{CONNECTED_NS, Loop, NEWBORN_PATIENCE_NS, Stateful};
use crate::Silence;
use crate::life::Failure;
use hyst_exchange::roster::Tenure;
use hyst_exchange::{checkpoint, system};
use hyst_messages::page::header;
use hyst_messages::{Message, Role, StreamHeader, TICK_NS};
use std::sync::atomic::{Ordering, fence};

impl<S: Stateful> Loop<'_, S> {
    /// Gets a state: the holder's, a checkpoint's, or the first. Then computes one step that nobody sees, to touch everything.
    pub(super) fn warm(&mut self) -> Result<(), Failure> {
        let mut silence = Silence::new(system::now_ns(), 2 * TICK_NS);
        let mut told = false;
        self.life.ports_are_open();
        loop {
            self.life.heartbeat();
            self.receive_ports();
            self.receive_states();
            if self.chain.newest().is_some() {
                break;
            }
            if self.life.clock.stop_requested() {
                return Ok(());
            }
            let holder = self.roster.holder(self.role);
            let nobody = holder.epoch == 0 && self.life.slot.index() == 0;
            let orphaned = holder.epoch > 0 && !self.holder_lives(holder) && !self.has_warm_spare();
            let late = silence.look(system::now_ns(), 0) > NEWBORN_PATIENCE_NS; // no sign: no state has come
            if late && self.is_guest() {
                return Err(Failure::Broken(format!("{}, and a newcomer on trial founds nothing", self.without_a_state())));
            }
            if late && self.founded {
                return Err(Failure::Broken("the state that this process founded the role with did not come back".into()));
            }
            if late && holder.epoch > 0 && self.holder_lives(holder) {
                return Err(Failure::Broken(format!("its holder lives, and {}", self.without_a_state())));
            }
            if !self.founded && !self.is_guest() && (nobody || orphaned || late && !self.has_warm_spare()) {
                if self.is_sound(holder) {
                    self.founded = self.found(holder)?;
                } else if !std::mem::replace(&mut told, true) {
                    let what = format!("the roster names a holder that cannot be ({holder:?})");
                    self.life.say(&format!("{what}; waits until the supervisor has mended it"));
                }
            }
            system::sleep_ns(TICK_NS / 2);
        }
        self.connect();
        if self.is_held() {
            return Ok(());
        }
        let context = self.context(self.life.tick(), false, self.roster.holder(self.role));
        let mut loan = self.publisher.loan(self.engine.message_bytes())?;
        if let Some(newest) = self.chain.newest() {
            if self.founded {
                self.life.succumb(Message::parse(newest.bytes(), self.engine.kind())?.header());
            }
            self.engine.step(&context, newest.bytes(), loan.bytes_mut())?;
        }
        Ok(())
    }

    fn without_a_state(&self) -> String {
        without_a_state(self.life.page.load64(header::INVALID))
    }

    /// Waits for what a step reads of others.
    fn connect(&mut self) {
        let until_ns = system::now_ns() + CONNECTED_NS;
        while !self.engine.is_connected() && system::now_ns() < until_ns && !self.life.clock.stop_requested() {
            self.life.heartbeat();
            system::sleep_ns(TICK_NS / 2);
            self.receive_ports();
            self.receive_states();
        }
    }

    /// Takes the role without a predecessor's state: from the newest checkpoint, or from the beginning.
    fn found(&mut self, holder: Tenure) -> Result<bool, Failure> {
        let Ok(tenure) = self.roster.promote(self.role, holder, self.me()) else { return Ok(false) };
        // The supervisor writes the ground and then looks who holds the role: one of the two sees what the other one wrote.
        fence(Ordering::SeqCst);
        let bytes = self.engine.message_bytes();
        let ground_tick = self.life.clock.ground_tick(self.role);
        let accepts = |kept: &checkpoint::Checkpoint| self.engine.accepts(hyst_messages::stream::bytes_of_words(&kept.words));
        let (kept, damaged) = checkpoint::newest(&self.life.station, self.role, bytes, ground_tick, accepts);
        if ground_tick < u64::MAX {
            checkpoint::discard_after(&self.life.station, self.role, bytes, ground_tick);
        }
        let kept = match kept {
            Some(kept) => Some((kept.tick, kept.words)),
            None => self.first_of_replay()?,
        };
        if damaged > 0 {
            self.life.say(&format!("{damaged} checkpoints are damaged and are not used"));
        }
        if let Some((_, words)) = &kept {
            self.take_step(hyst_messages::stream::bytes_of_words(words));
        }
        // No earlier than anything that is out in the name of the role.
        let tick = self.life.tick() + if tenure.epoch > 1 { self.engine.step_ticks() } else { 0 };
        let kept_bytes = kept.as_ref().map_or(bytes, |(_, words)| 8 * words.len());
        let mut loan = self.publisher.loan(kept_bytes)?;
        match kept {
            Some((kept_tick, words)) => {
                loan.bytes_mut().copy_from_slice(hyst_messages::stream::bytes_of_words(&words));
                self.life.say(&format!("goes on from the checkpoint of tick {kept_tick} in epoch {}", tenure.epoch));
            }
            None => {
                let header = StreamHeader { tick, ..Default::default() };
                self.engine.initial(header, loan.bytes_mut())?;
                self.life.say(&format!("begins at tick {tick} in epoch {}", tenure.epoch));
            }
        }
        self.life.page.store64(header::FOUNDED_TICK, tick.max(1));
        hyst_messages::stream::change_header(loan.bytes_mut(), |header| {
            header.epoch = tenure.epoch;
            header.incarnation = self.life.incarnation;
            header.tick = tick;
            header.step_ticks = 0; // nothing was computed for this tick
        });
        loan.send()?;
        Ok(true)
    }

    /// The state, and its tick, that a replay begins with which does not begin at the beginning. The tissue's is what the replay is shown for; another role
    /// whose state is of no use here, such as a fluid's on a coarser grid, begins anew and says so.
    fn first_of_replay(&self) -> Result<Option<(u64, Vec<u64>)>, Failure> {
        let Some(replay) = self.life.settings.replay.filter(|replay| replay.begin_tick > 0) else { return Ok(None) };
        let Some(words) = checkpoint::first(&self.life.station, self.role) else { return Ok(None) };
        let bytes = hyst_messages::stream::bytes_of_words(&words);
        let tick = Message::parse(bytes, self.engine.kind()).ok().map(|message| message.header().tick);
        if let Some(tick) = tick.filter(|_| self.engine.accepts(bytes)) {
            return Ok(Some((tick, words)));
        }
        let what = format!("the recorded state of tick {} is of no use here", replay.begin_tick);
        if self.role == Role::Tissue {
            return Err(Failure::Input(format!("{what}; replay without --from")));
        }
        self.life.say(&format!("{what}: it begins anew"));
        Ok(None)
    }
}

/// Why a process has no state to go on from: there was none, or it took so many for such as cannot be gone on from.
fn without_a_state(refused: u64) -> String {
    match refused {
        0 => "no state of the role has come".into(),
        _ => format!("none of {refused} states of the role was accepted (of another grid, another mesh, or not sound?)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A newcomer that refused each state was said to have had none.
    #[test]
    fn one_that_has_refused_states_says_so() {
        assert_eq!(without_a_state(0), "no state of the role has come");
        assert!(without_a_state(7).starts_with("none of 7 states of the role was accepted"), "{}", without_a_state(7));
    }
}
