//! An engine with a state that has one defect: in its steps, in what it writes, or in what it says of it.

use super::{AFTER, PERIODS, die_of, stop};
use hyst_engine::{Failure, Life, Stateful, StepContext};
use hyst_exchange::usher::{Arrival, Inbox, Wanted};
use hyst_exchange::{Links, system};
use hyst_messages::page::tissue;
use hyst_messages::stream::change_header;
use hyst_messages::{ContactModel, Kind, Message, Role, StreamHeader, TICK_NS};
use rustix::process::Signal;

/// What one that is late takes for every other step, in periods: beyond those that a fluid makes up for. And what a wasteful one allocates in each, bytes.
const LATE_PERIODS: u64 = 5;
/// What each step of one that is a little too slow takes, in hundredths of a period: it leaps over a tick now and then, and is in time again.
const SLUGGISH_PERCENT: u64 = 130;
const WASTE_BYTES: usize = 4_096;

/// The real engine with one defect.
struct Bad<'a, S> {
    life: &'a Life,
    engine: S,
    kind: String,
    shadowed: u32,
    held: u32,
    /// Of one that begins `anew`: the state before its first step. Of one that is `frozen`: what it says again and again.
    kept: Vec<u8>,
}

impl<S: Stateful> Bad<'_, S> {
    /// What is wrong with a step, before it is computed.
    fn fail(&mut self, context: &StepContext) {
        let in_shadow = self.kind.starts_with("shadow-") && self.shadowed > AFTER;
        if !in_shadow && self.held <= AFTER {
            return;
        }
        match self.kind.trim_start_matches("shadow-") {
            "panic" => panic!("a broken invariant"),
            "segfault" => die_of(Signal::SEGV),
            "exit" => std::process::exit(0),
            "spin" => loop {
                std::hint::spin_loop();
            },
            "stop" => stop(),
            "slow" => system::sleep_ns(PERIODS * context.step_ticks * TICK_NS),
            // As long as it is on trial, in a place of its own, nobody sees it.
            "late" if !self.life.slot.is_guest() && self.held.is_multiple_of(2) => {
                system::sleep_ns(LATE_PERIODS * context.step_ticks * TICK_NS)
            }
            "honest" if self.life.mischief().is_some_and(|request| request.what.is_lie()) => std::process::exit(0), // rather than lie
            "wasteful" => drop(std::hint::black_box(vec![0u8; WASTE_BYTES])),
            _ => {}
        }
    }

    /// What is wrong with a state, after it was computed.
    fn spoil(&self, next: &mut [u8]) {
        let (spoils_shadow, kind) = match self.kind.strip_prefix("shadow-") {
            Some(kind) => (true, kind),
            None => (false, self.kind.as_str()),
        };
        if (!spoils_shadow || self.shadowed <= AFTER) && self.held <= AFTER {
            return;
        }
        let section = if self.engine.kind() == Kind::TissueState { 1 } else { 2 };
        let Some((from, length)) = place(next, self.engine.kind(), section) else { return };
        match kind {
            "nan" => next[from..from + 4].copy_from_slice(&f32::NAN.to_ne_bytes()),
            "off" => {
                for number in next[from..from + length].chunks_exact_mut(4) {
                    let value = f32::from_ne_bytes([number[0], number[1], number[2], number[3]]);
                    number.copy_from_slice(&(value * 1.1 + 0.2).to_ne_bytes());
                }
            }
            "garbage" => next.fill(0xa5),
            "honest" if self.life.mischief().is_some_and(|request| request.what.is_lie()) => std::process::exit(0), // it was asked meanwhile
            _ => {}
        }
    }

    /// Says the same as at first, under the stamps of now.
    fn freeze(&mut self, next: &mut [u8]) {
        let Ok(header) = Message::parse(next, self.engine.kind()).map(|message| *message.header()) else { return };
        if self.kept.len() != next.len() {
            self.kept = next.to_vec();
        }
        next.copy_from_slice(&self.kept);
        change_header(next, |own| *own = header);
    }
}

/// First byte and length of a section.
fn place(bytes: &[u8], kind: Kind, section: usize) -> Option<(usize, usize)> {
    let found = Message::parse(bytes, kind).ok()?.section::<u8>(section).ok()?;
    Some((found.as_ptr() as usize - bytes.as_ptr() as usize, found.len()))
}

impl<S: Stateful> Stateful for Bad<'_, S> {
    fn kind(&self) -> Kind {
        self.engine.kind()
    }
    fn message_bytes(&self) -> usize {
        self.engine.message_bytes()
    }
    fn next_bytes(&self, now: &[u8]) -> usize {
        self.engine.next_bytes(now)
    }
    fn step_ticks(&self) -> u64 {
        self.engine.step_ticks()
    }
    fn take_step(&self, step_ticks: u64) {
        self.engine.take_step(step_ticks);
    }
    fn lengthen(&self) {
        self.engine.lengthen();
    }
    fn backlog(&self) -> u64 {
        self.engine.backlog()
    }
    fn interests(&self) -> Vec<(Role, Wanted)> {
        self.engine.interests()
    }
    fn open(&mut self, links: &Links) -> Result<(), Failure> {
        self.engine.open(links)?;
        if self.kind == "anew" {
            self.kept = vec![0; self.engine.message_bytes()];
            self.engine.initial(StreamHeader::default(), &mut self.kept)?;
        }
        Ok(())
    }
    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        self.engine.initial(header, state)
    }
    fn accepts(&self, state: &[u8]) -> bool {
        self.engine.accepts(state)
    }
    fn is_supplied(&mut self, tick: u64, next_tick: u64) -> bool {
        self.engine.is_supplied(tick, next_tick)
    }
    fn is_connected(&mut self) -> bool {
        self.engine.is_connected()
    }
    fn prepare(&mut self, newest: &[u8]) -> Result<(), Failure> {
        self.engine.prepare(newest)
    }
    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        if context.holding {
            self.held += 1;
        } else {
            self.shadowed += 1;
        }
        self.fail(context);
        let begun_ns = system::now_ns();
        // It takes the role as if nothing had been before.
        let begins_anew = context.holding && self.held == 1 && self.kind == "anew";
        self.engine.step(context, if begins_anew { &self.kept } else { now }, next)?;
        self.spoil(next);
        if self.kind == "frozen" && self.held > AFTER {
            self.freeze(next);
        }
        let until_ns = begun_ns + SLUGGISH_PERCENT * context.step_ticks * TICK_NS / 100;
        while self.kind == "sluggish" && self.held > AFTER && system::now_ns() < until_ns {
            std::hint::spin_loop();
        }
        Ok(())
    }
    fn finished(&mut self, context: &StepContext, state: &[u8]) {
        self.engine.finished(context, state);
        let has_model = self.held > AFTER && self.engine.kind() == Kind::TissueState;
        let Some((_, model)) = has_model.then(|| self.life.page.cell(tissue::MODEL)).flatten() else { return };
        match self.kind.as_str() {
            // Its states are right, and the hand feels nothing of them.
            "numb" => {
                self.life.page.write(tissue::MODEL, &ContactModel { plane_count: 0, planes: Default::default(), ..model });
            }
            // Or what it feels is of the holder before.
            "epoch" => {
                self.life.page.write(tissue::MODEL, &ContactModel { epoch: model.epoch.saturating_sub(1), ..model });
            }
            _ => {}
        }
    }
    fn finished_beside(&mut self, context: &StepContext, state: &[u8]) {
        self.engine.finished_beside(context, state);
    }
    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        self.engine.arrival(arrival, inbox);
    }
}

/// The whole life of one.
pub fn run<S: Stateful>(life: &Life, engine: S, kind: &str) -> Result<(), Failure> {
    hyst_engine::run_stateful(life, Bad { life, engine, kind: kind.to_string(), shadowed: 0, held: 0, kept: Vec::new() })
}
