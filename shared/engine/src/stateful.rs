//! The Synchronized Process with a spare: an engine is a function, its state is a message. Its author writes `initial` and `step`; this
//! loop loans, steps in place, sends, follows, substitutes, promotes and steps down. Restart, failover and hot swap are this one path.
//!
//! Promise: at most one incarnation holds the role in each epoch; a step that the holder misses is computed by the spare from the same
//! state, and published under the same epoch; whichever comes first counts. A holder that sees a higher epoch than its own steps down; one that
//! has fallen behind and leaps over ticks begins a new epoch. The rules are `hyst_exchange::succession`, and model-checked there.

mod chain;
mod engine;
mod founding;
mod keeper;
mod locked;
mod strain;
mod tenure;
mod trial;

use crate::helpers::{Helper, Helpers};
use crate::life::{Failure, Life};
use crate::mischief::Lies;
use crate::pace::Pace;
use crate::realtime;
use crate::room::Room;
use chain::{Chain, Fence};
pub use engine::{Stateful, StepContext};
use hyst_exchange::roster::{Roster, Tenure};
use hyst_exchange::succession::{Turn, holder_turn, most_misses, spare_turn};
use hyst_exchange::usher::{Inbox, Wanted, usher};
use hyst_exchange::{Horizon, Links, Publisher, system};
use hyst_messages::mischief::Outlet;
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{ProcessState, header};
use hyst_messages::{Message, Role, Slot, TICK_NS};
pub use trial::MOST_BEHIND_TICKS;

/// Part of a period after which a spare takes a step for missing: the state of a period must be there this long after the period's end.
pub const SPARE_PHASE: f64 = 0.6;
/// How long a newborn waits for a living holder's state before it takes the role itself.
pub const NEWBORN_PATIENCE_NS: u64 = 3_000_000_000;

/// How long a newborn waits for what it reads of others who live: their ports are open within some tenths of a second of their start.
pub const CONNECTED_NS: u64 = 1_000_000_000;

struct Loop<'a, S: Stateful> {
    life: &'a Life,
    engine: S,
    role: Role,
    roster: Roster,
    horizon: Horizon,
    publisher: Publisher,
    chain: Chain,
    inbox: Inbox,
    helpers: Helpers,
    lies: Lies,
    misses: u32,
    held: bool,
    /// The tenure under which it last made a step as the holder.
    stepped_as: Tenure,
    /// Tick of the newest state that it has made itself, whatever came of it.
    made_tick: u64,
    founded: bool,
    /// How often the role begins a new epoch because steps come too late.
    strain: strain::Strain,
    trial: trial::Trial,
    /// Where it is real time on a core that the hand's threads are on too.
    room: Option<Room>,
}

/// The whole life of a stateful engine; returns when the station stops.
pub fn run_stateful<S: Stateful>(life: &Life, mut engine: S) -> Result<(), Failure> {
    let role = life.slot.role();
    let links = Links::join(&life.station, &life.slot.to_string())?;
    engine.open(&links)?;
    let bytes = engine.message_bytes();
    let publisher = links.publisher(role, life.incarnation, engine.kind(), bytes)?;
    let chain = Chain::new(links.subscriber(role, life.incarnation, engine.kind())?)?;
    let keeper = keeper::keep(life, links.subscriber(role, life.incarnation, engine.kind())?, bytes)?;
    let mut interests = engine.interests();
    interests.push((role, Wanted::Stream(engine.kind())));
    let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
    let own = [keeper.helper(), Helper::usher(inbox.rounds())];
    let helpers = Helpers::of(own.into_iter().chain(engine.helpers()));
    let (roster, horizon) = (Roster::open(&life.station)?, Horizon::open(&life.station, role)?);
    let lies = Lies::new(life, bytes);
    let trial = trial::Trial::default();
    let mut this = Loop {
        life,
        engine,
        role,
        roster,
        horizon,
        publisher,
        chain,
        inbox,
        helpers,
        lies,
        misses: 0,
        held: false,
        stepped_as: Tenure::default(),
        made_tick: 0,
        founded: false,
        strain: strain::Strain::default(),
        trial,
        room: None,
    };
    this.warm()?;
    let granted = realtime::go(life)?;
    let shares = granted.fifo && granted.pinned && realtime::shares_core_with_hand(life.slot, system::places());
    this.stand_apart();
    // A newcomer on trial moves to the other core; what it says of the first one would be of no use.
    this.room = shares.then(|| if this.is_guest() { Room::of_this_thread() } else { Room::of_this_core() });
    this.run()
}

impl<S: Stateful> Loop<'_, S> {
    fn me(&self) -> u32 {
        self.life.incarnation
    }

    /// Whether the roster can say this. If not, nobody acts on it: the supervisor mends it.
    fn is_sound(&self, holder: Tenure) -> bool {
        self.horizon.admits(holder, &self.life.clock)
    }

    fn holder_lives(&self, holder: Tenure) -> bool {
        self.life.is_alive(self.role, holder.incarnation)
    }

    /// Whether the holder hangs, as far as the supervisor's watch can know.
    fn holder_hangs(&self, holder: Tenure) -> bool {
        let mut occupied = self.life.clock.occupied(self.role);
        occupied.any(|(slot, _)| self.life.clock.is_suspect(slot, holder.incarnation))
    }

    /// Whether another process of the role is warm: it has the last state and will promote itself, as soon as it is its turn.
    fn has_warm_spare(&self) -> bool {
        let clock = &self.life.clock;
        let swap = clock.swap(self.role);
        let is_other = |(slot, incarnation): &(Slot, u32)| {
            *slot != self.life.slot && (!slot.is_guest() || swap.has_passed(*incarnation)) && !clock.is_dead(*slot)
        };
        let mut others = clock.occupied(self.role).filter(is_other);
        others.any(|(slot, incarnation)| {
            let page = self.life.station.read_slot(slot, incarnation);
            page.is_ok_and(|page| page.state().is_ready())
        })
    }

    /// Whether the state is only passed on, because no successor survived a step from it. What follows from a step (the contact model) is not
    /// said then, so that its reader sees it age.
    fn is_held(&self) -> bool {
        self.life.clock.is_held(self.role)
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
        let life = self.life;
        let blame = |incarnation, why| life.distrust(incarnation, why);
        let lives = |writer| life.is_alive(life.slot.role(), writer);
        let (horizon, step_ticks) = (&self.horizon, engine.step_ticks());
        let is_ahead = |key| horizon.is_passed_by(key, step_ticks, &life.clock);
        let counts = self.chain.receive(
            engine.kind(),
            &mut self.inbox,
            Fence { holder: self.roster.holder(self.role), is_ahead: &is_ahead },
            |state, is_own| {
                let is_taken = if is_own { engine.accepts_own(state) } else { engine.accepts(state) };
                if is_taken { Ok(()) } else { Err(engine.why_refused(state)) }
            },
            blame,
            lives,
        );
        if counts.stale > 0 {
            self.life.page.add64(header::STALE, counts.stale);
        }
        if counts.invalid > 0 {
            self.life.page.add64(header::INVALID, counts.invalid);
        }
        if let Some(refused) = counts.last {
            self.life.name_refused(&refused);
        }
        if let Some(base) = self.chain.base() {
            self.take_step(base.bytes());
        }
    }

    /// Takes the step of a state that is gone on from.
    fn take_step(&self, state: &[u8]) {
        let step_ticks = Message::parse(state, self.engine.kind()).map_or(0, |state| state.header().step_ticks);
        if step_ticks != 0 {
            self.engine.take_step(u64::from(step_ticks));
        }
    }

    fn context(&self, next_tick: u64, holding: bool, tenure: Tenure) -> StepContext {
        let step_ticks = self.engine.step_ticks();
        let (state_epoch, tick) = self.chain.key();
        let state_writer = self.chain.writer();
        let deadline_ns = self.life.clock.start_of(next_tick);
        StepContext { tick, next_tick, state_epoch, state_writer, step_ticks, tenure, holding, deadline_ns }
    }

    fn run(&mut self) -> Result<(), Failure> {
        if self.life.is_lockstep() {
            return self.run_in_lockstep();
        }
        let mut period = self.engine.step_ticks();
        let mut pace = Pace::new(self.life, period, 0).with_backlog(self.engine.backlog());
        loop {
            let holder = self.roster.holder(self.role);
            let holding = holder.incarnation == self.me();
            self.note_role(holder);
            if self.engine.step_ticks() != period {
                period = self.engine.step_ticks();
                pace.set_period(period);
            }
            let late = (SPARE_PHASE * (period * TICK_NS) as f64) as u64;
            pace.set_phase(if holding { 0 } else { late });
            let Some(tick) = pace.wait() else { return Ok(()) };
            let leaves = self.room.as_mut().is_some_and(|room| room.woken(pace.woken_ns()));
            self.life.misbehave();
            self.helpers.look(self.life);
            self.receive_ports();
            let holder = self.roster.holder(self.role);
            self.note_trial(holder);
            self.receive_states();
            let holder = self.roster.holder(self.role);
            if !self.is_sound(holder) {
                self.life.page.add64(header::INVALID, 1); // nobody can hold the role like this
            } else if holder.incarnation == self.me() && leaves {
                self.life.page.add64(header::LEFT, 1);
            } else if holder.incarnation == self.me() {
                let tick = self.tick_of(tick, holder);
                self.step(tick, holder)?;
            } else if self.is_guest() && !self.life.clock.swap(self.role).has_passed(self.me()) {
                self.shadow(tick, holder)?;
            } else if self.life.clock.swap(self.role).is_on_trial(holder.incarnation) {
                self.guard(tick, holder)?;
            } else {
                self.follow(tick, holder, leaves)?;
            }
            if let Some(room) = &mut self.room {
                room.rests(system::now_ns());
            }
            pace.end();
        }
    }

    /// Says in the page who holds the role, and orders the priorities: the spare stands above the holder. What the roster cannot say is not said.
    fn note_role(&mut self, holder: Tenure) {
        let holding = holder.incarnation == self.me();
        if !self.is_sound(holder) {
            return;
        }
        let said = self.life.page.load64(header::TENURE);
        self.life.page.store64(header::TENURE, holder.word());
        if holding == self.held && said != 0 {
            return;
        }
        self.held = holding;
        self.misses = 0;
        self.life.page.set_state(if holding { ProcessState::Live } else { ProcessState::Warm });
        if self.life.page.load64(header::REAL_TIME) & 1 != 0
            && let Some(priority) = realtime::priority(self.role)
        {
            let above = if self.is_guest() { -realtime::GUEST_BELOW } else { realtime::SPARE_ABOVE };
            system::become_fifo(if holding { priority } else { priority + above });
        }
    }

    /// The holder's part of a tick.
    fn step(&mut self, tick: u64, holder: Tenure) -> Result<(), Failure> {
        match holder_turn(tick, self.chain.key(), holder.epoch, self.engine.step_ticks()) {
            Turn::Step(next_tick) => self.make(next_tick, holder),
            Turn::Leap => self.begin_epoch(tick, holder),
            Turn::Rest | Turn::Substitute(_) | Turn::Promote => Ok(()),
        }
    }

    /// Computes the state of `next_tick` from the newest one and sends it, unless the role was lost meanwhile.
    fn make(&mut self, next_tick: u64, holder: Tenure) -> Result<(), Failure> {
        let mut context = self.context(next_tick, holder.incarnation == self.me(), holder);
        let begun_ns = system::now_ns();
        // Who takes the role back from a newcomer on trial goes on from the line that it kept.
        let now = match self.chain.returning().filter(|_| context.holding) {
            Some(line) => {
                (context.tick, context.state_epoch, context.state_writer) = (line.tick, line.epoch, line.writer);
                &line.held
            }
            None => match self.chain.newest() {
                Some(newest) => newest,
                None => return Ok(()),
            },
        };
        let held = self.is_held();
        let bytes = if held { now.bytes().len() } else { self.engine.next_bytes(now.bytes()) };
        if self.life.loses_a_loan() {
            self.publisher.lose(bytes);
        }
        let mut loan = self.publisher.loan(bytes)?;
        let before = *Message::parse(now.bytes(), self.engine.kind())?.header();
        if context.holding && !held {
            self.life.succumb(&before);
        }
        if held {
            loan.bytes_mut().copy_from_slice(now.bytes());
        } else {
            self.engine.step(&context, now.bytes(), loan.bytes_mut())?;
        }
        hyst_messages::stream::change_header(loan.bytes_mut(), |header| {
            header.words[1] = self.life.mark(before.words[1]);
            header.epoch = context.tenure.epoch;
            header.incarnation = self.life.incarnation;
            header.tick = next_tick;
            // Nothing was computed for the tick of a state that is held.
            header.step_ticks = if held { 0 } else { context.step_ticks as u32 };
        });
        self.life.drag(begun_ns);
        // Fenced while computing: what was computed is dropped unsent.
        if self.roster.holder(self.role) != holder {
            return Ok(());
        }
        if !held {
            self.engine.finished(&context, loan.bytes());
        }
        self.lies.tell_message(self.life, Outlet::State, loan.bytes_mut());
        loan.send()?;
        self.life.page.store64(header::VALUE_NS, system::now_ns());
        self.life.page.add64(header::STREAM_BYTES, bytes as u64);
        self.made_tick = next_tick;
        self.receive_states();
        Ok(())
    }

    /// The spare's part of a tick; it substitutes nothing in one that it leaves.
    fn follow(&mut self, tick: u64, holder: Tenure, leaves: bool) -> Result<(), Failure> {
        let Some(state) = self.chain.newest() else { return Ok(()) };
        self.engine.prepare(state.bytes())?;
        let newest = self.chain.key();
        self.misses = if newest.1 >= tick { 0 } else { self.misses + 1 };
        if self.misses > 0 {
            self.life.distrust(holder.incarnation, Distrust::Missing);
        }
        let (step, lives) = (self.engine.step_ticks(), self.holder_lives(holder));
        let most_misses = most_misses(self.holder_hangs(holder));
        match spare_turn(tick, newest, holder.epoch, step, lives, self.misses, most_misses) {
            Turn::Promote => self.begin_epoch(tick, holder),
            Turn::Substitute(_) if leaves => Ok(()),
            Turn::Substitute(next_tick) => {
                self.life.page.add64(header::SUBSTITUTES, 1);
                self.make(next_tick, holder)
            }
            Turn::Rest | Turn::Step(_) | Turn::Leap => Ok(()),
        }
    }
}
