//! The Synchronized Process with a spare: an engine is a function, its state is a message. Its author writes `initial` and `step`; this
//! loop loans, steps in place, sends, follows, substitutes, promotes and steps down. Restart, failover and hot swap are this one path.
//!
//! Promise: at most one incarnation holds the role in each epoch; a step that the holder misses is computed by the spare from the same
//! state, and published under the same epoch; whichever comes first counts. A holder that sees a higher epoch than its own steps down.

mod chain;
mod keeper;

use crate::life::{Failure, Life};
use crate::pace::Pace;
use crate::realtime;
use chain::Chain;
use hyst_exchange::roster::{Roster, Tenure};
use hyst_exchange::usher::{Arrival, Inbox, Wanted, usher};
use hyst_exchange::{Links, Publisher, checkpoint, system};
use hyst_messages::page::{ProcessState, header};
use hyst_messages::{Kind, Role, StreamHeader, TICK_NS};

/// Missing steps in a row after which the spare promotes itself: one is a stall of the machine, three are a dead or hung holder.
pub const MISSES_TO_PROMOTE: u32 = 3;
/// Part of a period after which a spare takes a step for missing: the state of a period must be there this long after the period's end.
pub const SPARE_PHASE: f64 = 0.6;
/// How long a newborn waits for a living holder's state before it takes the role itself.
pub const NEWBORN_PATIENCE_NS: u64 = 3_000_000_000;

/// What a step is told beside the state.
#[derive(Clone, Copy, Debug)]
pub struct StepContext {
    /// Tick of the state that is read.
    pub tick: u64,
    /// Tick of the state that is written.
    pub next_tick: u64,
    /// Epoch of the state that is read.
    pub state_epoch: u32,
    /// Incarnation that wrote the state that is read.
    pub state_writer: u32,
    /// Step in ticks.
    pub step_ticks: u64,
    /// Epoch and incarnation under which the state is published.
    pub tenure: Tenure,
    /// False for a substitute: it is computed alone, without the members of the Meeting Point.
    pub holding: bool,
    /// When the step has to be done, CLOCK_MONOTONIC ns.
    pub deadline_ns: u64,
}

/// An engine whose state is a message.
pub trait Stateful {
    /// Kind of the state's message.
    fn kind(&self) -> Kind;
    /// Length of the state's message in bytes.
    fn message_bytes(&self) -> usize;
    /// Step in ticks.
    fn step_ticks(&self) -> u64;
    /// What the engine wants to know of other processes.
    fn interests(&self) -> Vec<(Role, Wanted)>;
    /// Opens further ports of its own, before anything is real time.
    fn open(&mut self, links: &Links) -> Result<(), Failure>;
    /// Writes the first state.
    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure>;
    /// Whether a state of another incarnation can be gone on from.
    fn accepts(&self, state: &[u8]) -> bool;
    /// Reads the state of t, writes the state of t + step. Allocates nothing.
    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure>;
    /// Says what follows from a finished state (cells in the page).
    fn finished(&mut self, context: &StepContext, state: &[u8]);
    /// Takes a port that the usher has opened.
    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox);
}

struct Loop<'a, S: Stateful> {
    life: &'a Life,
    engine: S,
    role: Role,
    roster: Roster,
    publisher: Publisher,
    chain: Chain,
    inbox: Inbox,
    misses: u32,
    held: bool,
    founded: bool,
}

/// The whole life of a stateful engine; returns when the station stops.
pub fn run_stateful<S: Stateful>(life: &Life, mut engine: S) -> Result<(), Failure> {
    let role = life.slot.role();
    let links = Links::join(&life.station, &life.slot.to_string())?;
    engine.open(&links)?;
    let bytes = engine.message_bytes();
    let publisher = links.publisher(role, life.incarnation, engine.kind(), bytes)?;
    let chain = Chain::new(links.subscriber(role, life.incarnation, engine.kind())?)?;
    let _keeper = keeper::keep(life, links.subscriber(role, life.incarnation, engine.kind())?, bytes)?;
    let mut interests = engine.interests();
    interests.push((role, Wanted::Stream(engine.kind())));
    let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
    let roster = Roster::open(&life.station)?;
    let mut this = Loop { life, engine, role, roster, publisher, chain, inbox, misses: 0, held: false, founded: false };
    this.warm()?;
    realtime::go(life)?;
    this.run()
}

impl<S: Stateful> Loop<'_, S> {
    fn me(&self) -> u32 {
        self.life.incarnation
    }

    fn holder_lives(&self, holder: Tenure) -> bool {
        let mut occupied = self.life.clock.occupied(self.role);
        occupied.any(|(slot, incarnation)| incarnation == holder.incarnation && !self.life.clock.is_dead(slot))
    }

    fn receive_ports(&mut self) {
        // Bounded by the queue of the usher.
        while let Some(arrival) = self.inbox.take() {
            if arrival.slot.role() == self.role && self.chain.wants(&arrival, self.engine.kind()) {
                self.chain.add(arrival, &mut self.inbox);
            } else {
                self.engine.arrival(arrival, &mut self.inbox);
            }
        }
    }

    fn receive_states(&mut self) {
        let engine = &self.engine;
        let counts = self.chain.receive(engine.kind(), &mut self.inbox, |state| engine.accepts(state));
        if counts.stale > 0 {
            self.life.page.add64(header::STALE, counts.stale);
        }
        if counts.invalid > 0 {
            self.life.page.add64(header::INVALID, counts.invalid);
        }
    }

    /// Gets a state: the holder's, a checkpoint's, or the first. Then computes one step that nobody sees, to touch everything.
    fn warm(&mut self) -> Result<(), Failure> {
        let patience_ns = system::now_ns() + NEWBORN_PATIENCE_NS;
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
            let orphaned = holder.epoch > 0 && !self.holder_lives(holder);
            let late = system::now_ns() > patience_ns;
            if late && self.founded {
                return Err(Failure::Broken("the state that this process founded the role with did not come back".into()));
            }
            if late && holder.epoch > 0 && self.holder_lives(holder) {
                return Err(Failure::Broken("no state has come from the role's holder, although it lives".into()));
            }
            if !self.founded && (nobody || orphaned || late) {
                self.founded = self.found(holder)?;
            }
            system::sleep_ns(TICK_NS / 2);
        }
        let context = self.context(self.life.tick(), false, self.roster.holder(self.role));
        let mut loan = self.publisher.loan(self.engine.message_bytes())?;
        if let Some(newest) = self.chain.newest() {
            self.engine.step(&context, newest.bytes(), loan.bytes_mut())?;
        }
        Ok(())
    }

    /// Takes the role without a predecessor's state: from the newest checkpoint, or from the beginning.
    fn found(&mut self, holder: Tenure) -> Result<bool, Failure> {
        let Ok(tenure) = self.roster.promote(self.role, holder, self.me()) else { return Ok(false) };
        let bytes = self.engine.message_bytes();
        let mut loan = self.publisher.loan(bytes)?;
        let kept = checkpoint::newest(&self.life.station, self.role, bytes).filter(|kept| {
            let state: &[u8] = hyst_messages::stream::bytes_of_words(&kept.words);
            state.len() >= bytes && self.engine.accepts(&state[..bytes])
        });
        let tick = self.life.tick();
        match kept {
            Some(kept) => {
                loan.bytes_mut().copy_from_slice(&hyst_messages::stream::bytes_of_words(&kept.words)[..bytes]);
                self.life.say(&format!("goes on from the checkpoint of tick {} in epoch {}", kept.tick, tenure.epoch));
            }
            None => {
                let header = StreamHeader { tick, ..Default::default() };
                self.engine.initial(header, loan.bytes_mut())?;
                self.life.say(&format!("begins at tick {tick} in epoch {}", tenure.epoch));
            }
        }
        hyst_messages::stream::change_header(loan.bytes_mut(), |header| {
            header.epoch = tenure.epoch;
            header.incarnation = self.life.incarnation;
            header.tick = tick;
        });
        loan.send()?;
        Ok(true)
    }

    fn context(&self, next_tick: u64, holding: bool, tenure: Tenure) -> StepContext {
        let step_ticks = self.engine.step_ticks();
        let (state_epoch, tick) = self.chain.key();
        let state_writer = self.chain.writer();
        let deadline_ns = self.life.clock.start_of(next_tick);
        StepContext { tick, next_tick, state_epoch, state_writer, step_ticks, tenure, holding, deadline_ns }
    }

    fn run(&mut self) -> Result<(), Failure> {
        let mut period = self.engine.step_ticks();
        let mut pace = Pace::new(self.life, period, 0);
        loop {
            let holding = self.roster.holder(self.role).incarnation == self.me();
            self.note_role(holding);
            if self.engine.step_ticks() != period {
                period = self.engine.step_ticks();
                pace.set_period(period);
            }
            let late = (SPARE_PHASE * (period * TICK_NS) as f64) as u64;
            pace.set_phase(if holding { 0 } else { late });
            let Some(tick) = pace.wait() else { return Ok(()) };
            self.receive_ports();
            self.receive_states();
            let holder = self.roster.holder(self.role);
            if holder.incarnation == self.me() {
                self.step(tick, holder)?;
            } else {
                self.follow(tick, holder)?;
            }
            pace.end();
        }
    }

    /// Says in the page who holds the role, and orders the priorities: the spare stands above the holder.
    fn note_role(&mut self, holding: bool) {
        if holding == self.held && self.life.page.load64(header::EPOCH) != 0 {
            return;
        }
        self.held = holding;
        self.misses = 0;
        self.life.page.store64(header::EPOCH, self.roster.holder(self.role).epoch as u64);
        self.life.page.set_state(if holding { ProcessState::Live } else { ProcessState::Warm });
        if self.life.page.load64(header::REAL_TIME) & 1 != 0
            && let Some(priority) = realtime::priority(self.role)
        {
            system::become_fifo(if holding { priority } else { priority + realtime::SPARE_ABOVE });
        }
    }

    /// Computes and sends the state after the newest one. Nothing to do if that is already ahead.
    fn step(&mut self, tick: u64, holder: Tenure) -> Result<(), Failure> {
        let holding = holder.incarnation == self.me();
        let step_ticks = self.engine.step_ticks();
        let (_, newest_tick) = self.chain.key();
        let next_tick = if holding { tick.max(newest_tick) + step_ticks } else { tick.max(newest_tick + step_ticks) };
        if newest_tick >= tick + step_ticks {
            return Ok(());
        }
        let context = self.context(next_tick, holding, holder);
        let bytes = self.engine.message_bytes();
        let mut loan = self.publisher.loan(bytes)?;
        let Some(now) = self.chain.newest() else { return Ok(()) };
        self.engine.step(&context, now.bytes(), loan.bytes_mut())?;
        hyst_messages::stream::change_header(loan.bytes_mut(), |header| {
            header.epoch = context.tenure.epoch;
            header.incarnation = self.life.incarnation;
            header.tick = next_tick;
            header.step_ticks = step_ticks as u32;
        });
        // Fenced while computing: what was computed is dropped unsent.
        if self.roster.holder(self.role) != holder {
            return Ok(());
        }
        self.engine.finished(&context, loan.bytes());
        loan.send()?;
        self.life.page.store64(header::VALUE_NS, system::now_ns());
        self.life.page.add64(header::STREAM_BYTES, bytes as u64);
        self.receive_states();
        Ok(())
    }

    fn follow(&mut self, tick: u64, holder: Tenure) -> Result<(), Failure> {
        let (_, newest_tick) = self.chain.key();
        if self.chain.newest().is_none() {
            return Ok(());
        }
        if newest_tick >= tick {
            self.misses = 0;
            return Ok(());
        }
        self.misses += 1;
        let lives = self.holder_lives(holder);
        if !lives || self.misses >= MISSES_TO_PROMOTE {
            if let Ok(tenure) = self.roster.promote(self.role, holder, self.me()) {
                self.life.page.add64(header::PROMOTIONS, 1);
                self.note_role(true);
                return self.step(tick, tenure);
            }
            return Ok(());
        }
        self.life.page.add64(header::SUBSTITUTES, 1);
        self.step(tick, holder)
    }
}
