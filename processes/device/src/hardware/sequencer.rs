//! The sequencer of a lock-step station: it owns the virtual tick. The hardware is the place for it, because it outlives the others.
//!
//! A tick T: the hardware's sample; then, each when the one before has joined, the holder of the tissue (state T), at each of its periods
//! the holder of the fluid (state T), and at last the device with the spares of those that have stepped. If a holder is missing, its spare
//! is released in its place and steps. So whatever is exchanged in tick T is of one exact tick, whoever died.
//!
//! In a replay the recording says at which ticks the tissue stepped and the device made a tick.
//!
//! A member is missing when it is known to be dead or gave no sign of life for 30 s; a newcomer is a member from the first release after it
//! has said that it is warm. The sequencer holds at the tick that the supervisor says, and while the recorder, or who draws into a folder, is too
//! far behind.

use super::awaited::Awaited;
use hyst_engine::lane::Lane;
use hyst_engine::settings::Replay;
use hyst_engine::{Failure, Life, lockstep};
use hyst_exchange::meeting::{Group, ProcessCoordinator};
use hyst_exchange::{OwnedPage, ReadPage, Roster, system};
use hyst_messages::page::station;
use hyst_messages::{Role, Slot, StepRecord, TICK_NS};
use std::sync::Arc;

/// Longest wait for a group, ns: a member that beats all the time and still does not end its step.
const LONGEST_NS: u64 = 60_000_000_000;

/// How late a replay may be, ns, before it gives up the time that it lost.
const MOST_LATE_NS: u64 = 50_000_000;

/// The sequencer.
pub struct Sequencer<'a> {
    life: &'a Life,
    _lane: Option<Lane>,
    station: OwnedPage,
    roster: Roster,
    coordinator: ProcessCoordinator,
    awaited: Vec<Awaited>,
    tick: u64,
    tissue_period: u64,
    fluid_period: u64,
    replay: Option<Replay>,
    /// Of a replay that keeps a pace: a tick, and when it began, ns.
    anchor: (u64, u64),
}

impl<'a> Sequencer<'a> {
    /// A sequencer that goes on after the last tick that was begun.
    pub fn new(life: &'a Life) -> Result<Sequencer<'a>, Failure> {
        let scene = hyst_scene::load_or_embedded(life.scene().as_deref());
        let scene = scene.map_err(|error| Failure::Input(error.to_string()))?;
        let tissue_period = life.settings.number("tissue_step_ticks", 1.0, 1.0..=4.0, "1, 2 or 4")? as u64;
        let station = life.station.open_for_keeping()?;
        let tick = station.load64(station::BEGUN_TICK);
        station.store64(station::ENDED_TICK, tick);
        let lane = Lane::take();
        station.store64(station::LANE, Lane::word(lane.as_ref()));
        Ok(Sequencer {
            life,
            _lane: lane,
            station,
            roster: Roster::open(&life.station)?,
            coordinator: ProcessCoordinator::new(Arc::clone(&life.page)),
            awaited: Awaited::of(life),
            tick,
            tissue_period,
            fluid_period: scene.fluid.period_ticks(),
            replay: life.settings.replay,
            anchor: (tick, 0),
        })
    }

    /// Waits until the next tick may begin and begins it; `None` when the station stops.
    pub fn begin(&mut self) -> Option<u64> {
        while !self.life.clock.stop_requested() {
            self.life.heartbeat();
            if self.tick < self.station.load64(station::RUN_TO) && !self.is_ahead() {
                self.tick += 1;
                self.keep_pace();
                self.station.store64(station::BEGUN_TICK, self.tick);
                return Some(self.tick);
            }
            system::sleep_ns(lockstep::LOOK_NS);
        }
        None
    }

    /// Whether somebody who is waited for is too far behind.
    fn is_ahead(&mut self) -> bool {
        let (life, tick) = (self.life, self.tick);
        self.awaited.iter_mut().any(|it| it.is_behind(life, tick))
    }

    /// In a replay that is to be as fast as it was, or so many times as fast: waits until it is time for the tick. One that is slower begins anew to
    /// keep the pace, and hurries after nothing.
    fn keep_pace(&mut self) {
        let Some(replay) = self.replay.filter(|replay| replay.speed > 0.0 && self.tick > replay.from_tick) else { return };
        let due_ns = |(tick, ns): (u64, u64)| ns + ((self.tick - tick) as f64 * TICK_NS as f64 / replay.speed) as u64;
        let now_ns = system::now_ns();
        if now_ns > due_ns(self.anchor) + MOST_LATE_NS {
            self.anchor = (self.tick, now_ns);
        }
        let due_ns = due_ns(self.anchor);
        while !self.life.clock.stop_requested() && system::now_ns() < due_ns {
            self.life.heartbeat();
            system::sleep_until_ns(due_ns.min(system::now_ns() + 20 * lockstep::LOOK_NS));
        }
    }

    /// Releases the members for the tick, group by group, and ends it. In a replay the tissue makes the recorded steps, which may go beyond the tick.
    pub fn release(&mut self, tick: u64, recorded: Option<&[StepRecord]>) {
        self.seat_newcomers();
        let mut last = 1 << Slot::first(Role::Device).number();
        for step in recorded.unwrap_or_default() {
            self.station.store64(station::REPLAY_INPUT_TICK, step.input_tick);
            self.station.store64(station::REPLAY_STEP_TICKS, u64::from(step.step_ticks));
            // Whoever is released steps to the tick that was begun.
            self.station.store64(station::BEGUN_TICK, step.tick);
            last |= self.release_role(Role::Tissue, step.tick, station::TISSUE_TICK);
        }
        self.station.store64(station::BEGUN_TICK, tick);
        if recorded.is_none() && tick.is_multiple_of(self.tissue_period) {
            last |= self.release_role(Role::Tissue, tick, station::TISSUE_TICK);
        }
        if tick.is_multiple_of(self.fluid_period) {
            last |= self.release_role(Role::Fluid, tick, station::FLUID_TICK);
        }
        if self.release_group(last) & 1 << Slot::first(Role::Device).number() != 0 {
            self.station.store64(station::INPUT_TICK, tick);
        }
        // A stop in the middle leaves a tick that has not ended: whoever counts ticks must not count it.
        if !self.life.clock.stop_requested() {
            self.station.store64(station::ENDED_TICK, tick);
        }
    }

    /// Releases the holder of a role, or the others if it is missing; gives those who have not been released yet.
    fn release_role(&mut self, role: Role, tick: u64, word: usize) -> Group {
        let holder = self.roster.holder(role).incarnation;
        let (first, count) = role.slots();
        let seats = || first..first + count;
        let all = seats().fold(0, |group: Group, seat| group | 1 << seat);
        let held = seats()
            .filter(|seat| self.coordinator.incarnation_at(*seat) == holder)
            .fold(0, |group: Group, seat| group | 1 << seat);
        let mut joined = self.release_group(held);
        let mut rest = all & !held;
        if joined == 0 {
            joined = self.release_group(rest);
            rest = 0;
        }
        // One that is held still passes its state on, and no contact model or medium of this tick comes with it: nobody is to wait for that.
        if joined != 0 && !self.life.clock.is_held(role) {
            self.station.store64(word, tick);
        }
        rest
    }

    fn release_group(&mut self, group: Group) -> Group {
        let ready = group & self.coordinator.ready();
        if ready == 0 {
            return 0;
        }
        let life = self.life;
        let lost = |page: &ReadPage| {
            life.heartbeat();
            life.clock.stop_requested() || lockstep::is_lost(&life.clock, page)
        };
        self.coordinator.release_unless(ready, system::now_ns() + LONGEST_NS, &lost).joined
    }

    /// Gives every process that steps its seat, by the number of its slot. A page that cannot be opened yet is tried again in the next tick.
    fn seat_newcomers(&mut self) {
        for role in [Role::Device, Role::Tissue, Role::Fluid] {
            for (slot, incarnation) in self.life.clock.occupied(role) {
                if self.coordinator.incarnation_at(slot.number()) != incarnation
                    && let Ok(page) = self.life.station.read_slot(slot, incarnation)
                {
                    self.coordinator.seat(slot.number(), page);
                }
            }
        }
    }
}
