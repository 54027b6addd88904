//! Lock-step, the members' side. The sequencer (in `hardware`, because that outlives the others) owns the virtual tick and releases its
//! members at each tick, one group after the other, through the Meeting Point; a member steps when it is told, and joins.
//!
//! Promise: what a member reads is of an exact tick. It waits for that, because an usher may connect a newcomer's stream late; a partner
//! is missing only when it is known to be dead or after [`PATIENCE_NS`]. A member that waits beats, so that nobody is blamed for another.
//! Nothing here is real time: a member of a lock-step station maps pages on the thread that steps.

use crate::lane::Follower;
use crate::life::{Failure, Life};
use hyst_exchange::meeting::{Member, ProcessMember, Release};
use hyst_exchange::{ReadPage, StationPage, system};
use hyst_messages::page::{header, station};
use hyst_messages::{Role, Slot};
use std::sync::Arc;

/// Wall time without a sign of life after which a member counts as missing although nobody knows it to be dead. Who hangs is ended by the supervisor after two
/// seconds that it is itself to blame for; beside a station in real time on full cores a member that is well may not be let run for much longer.
pub const PATIENCE_NS: u64 = 30_000_000_000;
/// Wall time between two looks at the station while waiting to be released: several wait while one of them steps, and each look takes the core from it.
pub const LOOK_NS: u64 = 2_000_000;
/// Wall time between two looks for something that is about to come.
pub(crate) const EAGER_NS: u64 = 50_000;

/// Whether the owner of a page is known to be dead, was replaced, or has given no sign of life for [`PATIENCE_NS`].
pub fn is_lost(clock: &StationPage, page: &ReadPage) -> bool {
    let Some(slot) = Slot::from_number(page.load64(header::SLOT) as usize) else { return true };
    clock.is_dead(slot)
        || clock.incarnation(slot) != page.incarnation()
        || system::now_ns().saturating_sub(page.load64(header::HEARTBEAT_NS)) > PATIENCE_NS
}

/// Looks until `found` gives something; `None` after [`PATIENCE_NS`], or when the station stops.
pub fn wait_for<T>(life: &Life, mut found: impl FnMut() -> Option<T>) -> Option<T> {
    let deadline_ns = system::now_ns() + PATIENCE_NS;
    loop {
        if let Some(it) = found() {
            return Some(it);
        }
        if system::now_ns() >= deadline_ns || life.clock.stop_requested() {
            return None;
        }
        life.heartbeat();
        system::sleep_ns(EAGER_NS);
    }
}

/// The same for what the owner of a page says with a bell, which is a word of it: whoever sleeps between looks comes tens of microseconds late.
pub fn wait_on(life: &Life, page: &ReadPage, bell: usize, is_over: impl Fn() -> bool) {
    let deadline_ns = system::now_ns() + PATIENCE_NS;
    loop {
        let rung = page.load32(bell);
        let now_ns = system::now_ns();
        if is_over() || now_ns >= deadline_ns || life.clock.stop_requested() {
            return;
        }
        life.heartbeat();
        page.wait(bell, rung, deadline_ns.min(now_ns + LOOK_NS));
    }
}

/// A process that steps when the sequencer says so.
#[derive(Debug)]
pub struct LockMember<'a> {
    life: &'a Life,
    member: ProcessMember,
    release: Option<Release>,
    woken_ns: u64,
    lane: Follower,
    /// A spare only looks whether it has to step, and stands beside.
    steps: bool,
}

impl<'a> LockMember<'a> {
    /// A member that has not been released yet.
    pub fn new(life: &'a Life) -> LockMember<'a> {
        LockMember {
            life,
            member: ProcessMember::new(Arc::clone(&life.page)),
            release: None,
            woken_ns: 0,
            lane: Follower::default(),
            steps: true,
        }
    }

    /// Says whether it steps itself from now on.
    pub fn set_steps(&mut self, steps: bool) {
        self.steps = steps;
    }

    /// Waits for the next release and gives its tick; `None` when the station stops. `between` is called at each look.
    pub fn wait(&mut self, mut between: impl FnMut() -> Result<(), Failure>) -> Result<Option<u64>, Failure> {
        let clock = &self.life.clock;
        while !clock.stop_requested() {
            self.follow_the_sequencer();
            self.lane.follow(self.life, self.steps);
            between()?;
            self.life.heartbeat();
            if let Some(release) = self.member.await_release(system::now_ns() + LOOK_NS) {
                self.release = Some(release);
                self.woken_ns = system::now_ns();
                return Ok(Some(clock.page().load64(station::BEGUN_TICK)));
            }
        }
        Ok(None)
    }

    fn follow_the_sequencer(&mut self) {
        let slot = Slot::first(Role::Hardware);
        let incarnation = self.life.clock.incarnation(slot);
        if incarnation != self.member.follows()
            && let Ok(page) = self.life.station.read_slot(slot, incarnation)
        {
            self.member.follow(page); // a sequencer that was replaced: a rare event, and nothing here is real time
        }
    }

    /// Joins: the step of `tick` is done. Says so in the page, too.
    pub fn join(&mut self, tick: u64) {
        let page = &self.life.page;
        page.count_latency(header::LOOP, system::now_ns().saturating_sub(self.woken_ns));
        page.store64(header::TICK, tick);
        page.add64(header::STEPS, 1);
        self.life.heartbeat();
        if let Some(release) = self.release.take() {
            self.member.join(release);
        }
    }
}
