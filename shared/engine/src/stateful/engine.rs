//! What an author of an engine with a spare writes: the first state, and a step from one to the next.

use crate::helpers::Helper;
use crate::life::Failure;
use hyst_exchange::Links;
use hyst_exchange::roster::Tenure;
use hyst_exchange::usher::{Arrival, Inbox, Wanted};
use hyst_messages::{Kind, Refusal, Role, StreamHeader};

/// What a step is told beside the state.
#[derive(Clone, Copy, Debug)]
pub struct StepContext {
    /// Tick of the state that is read.
    pub tick: u64,
    /// Tick of the state that is written: a step after `tick`, or later where a new epoch begins after ticks that were lost.
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
    /// Most bytes of a state's message.
    fn message_bytes(&self) -> usize;
    /// Bytes that the state after this one needs at most.
    fn next_bytes(&self, _now: &[u8]) -> usize {
        self.message_bytes()
    }
    /// Step in ticks.
    fn step_ticks(&self) -> u64;
    /// Takes the step of the state that is gone on from, ticks, where one was computed for its tick. That of a newcomer on trial is none for those who had the
    /// role before it: they go on from their own.
    fn take_step(&self, _step_ticks: u64) {}
    /// Takes longer steps from now on, if there are any and nobody asked for these. Called before the first step of an epoch, in a role that has begun ever
    /// new ones for seconds because its steps come too late, but not while a newcomer is on trial; whoever follows has the step from the state.
    fn lengthen(&self) {}
    /// Steps that a holder which was late makes up for; what is older is skipped, and its time lost unless `step` goes by the ticks of both states.
    fn backlog(&self) -> u64 {
        0
    }
    /// What the engine wants to know of other processes.
    fn interests(&self) -> Vec<(Role, Wanted)>;
    /// Opens further ports of its own, before anything is real time.
    fn open(&mut self, _links: &Links) -> Result<(), Failure> {
        Ok(())
    }
    /// Threads that help it beside usher and keeper, once its ports are open: they are watched as those are.
    fn helpers(&self) -> Vec<Helper> {
        Vec::new()
    }
    /// Writes the first state.
    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure>;
    /// Whether a state of another incarnation can be gone on from.
    fn accepts(&self, state: &[u8]) -> bool;
    /// The same for a state that this incarnation has made itself and has just sent: what a step copies into it as it knows it need not be looked at again.
    /// What it computed is looked at, so that nobody goes on from a number that is none.
    fn accepts_own(&self, state: &[u8]) -> bool {
        self.accepts(state)
    }
    /// What is wrong with a state that was just refused, for whoever reads of it: it takes as long as it takes, for that is rare.
    fn why_refused(&self, _state: &[u8]) -> Refusal {
        Refusal::Unsound
    }
    /// In lock-step: whether everything that the step from the state of `tick` to `next_tick` reads is there, each of its exact tick. Asked
    /// again and again until it is, or the patience of [`crate::lockstep`] ends.
    fn is_supplied(&mut self, _tick: u64, _next_tick: u64) -> bool {
        true
    }
    /// In lock-step, of a spare, once in each of its ticks: takes what the holder's step has read, all of which was sent before. Whoever takes the role goes on
    /// from what he has read last where the newest of it cannot be used.
    fn look(&mut self) {}
    /// Whether what its steps read of others has come, as far as those live: a newborn is not warm before, or its first steps were those of an engine that
    /// is alone. It does not wait longer than [`CONNECTED_NS`](super::CONNECTED_NS).
    fn is_connected(&mut self) -> bool {
        true
    }
    /// Makes itself ready to go on from a state that another wrote: called by who follows, before it may be his turn.
    fn prepare(&mut self, _newest: &[u8]) -> Result<(), Failure> {
        Ok(())
    }
    /// Reads the state of t, writes the state of t + step. Allocates nothing, unless something is cut.
    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure>;
    /// Says what follows from a finished state (cells in the page).
    fn finished(&mut self, context: &StepContext, state: &[u8]);
    /// Says what would follow from a state that was computed beside the role, for whoever compares it with the role's: nobody else may take it for true.
    fn finished_beside(&mut self, _context: &StepContext, _state: &[u8]) {}
    /// Takes a port that the usher has opened.
    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox);
}
