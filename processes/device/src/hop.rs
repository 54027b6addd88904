//! The last hop: reads pose and buttons from the hardware, publishes one input record a tick, takes the force of the selected servo if it is
//! valid by the deadline, else the other's and stays with it, limits it, and hands it to the hardware.
//!
//! Promise: what is applied is finite, within the force and slew limit, and computed for this tick; with neither servo there it is held for
//! 2 ticks, then ramped to zero in 20 ms. The way from hand to force touches station pages alone: no lock, no allocation, no stream.

use crate::again::{Again, Given};
use crate::models::Models;
use crate::plugged::{Plug, Plugged};
use crate::replicas::Replicas;
use hyst_coupling::{
    AppliedKind, EnergyParams, EnergyState, HardwareParams, LastHopParams, LastHopState, energy_step, last_hop_step,
};
use hyst_engine::{Failure, Helper, Helpers, Lies, Life, Pace, lockstep, realtime};
use hyst_exchange::usher::{PageArrival, PageInbox, page_usher};
use hyst_exchange::{Horizon, ReadPage, system};
use hyst_messages::page::{ProcessState, device as layout, haptic, hardware, header, station};
use hyst_messages::{Applied, AppliedRecord, DeviceLimits, ForceCommand, HardwareSample, InputRecord, Medium, Role};

/// Time after the start of a tick by which a servo's force must be there, ns: it needs about 50 µs, and the hardware reads the command at
/// any phase of the tick, so that what comes later than this may be felt one tick later.
pub const DEADLINE_NS: u64 = 400_000;
/// How long a device that was started waits for the hardware's page before it says so, ns.
const PATIENCE_NS: u64 = 5_000_000_000;

/// Longest that it waits then for the pages of those who live, ns: nobody makes a force meanwhile.
const SEATING_NS: u64 = 10_000_000;
/// A tick, s.
const TICK_S: f32 = 1e-3;
/// Between two looks for them, ns.
const LOOK_NS: u64 = 100_000;

struct Hop<'a> {
    life: &'a Life,
    inbox: PageInbox,
    helpers: Helpers,
    hardware: Plugged,
    models: Models,
    replicas: Replicas,
    params: LastHopParams,
    state: LastHopState,
    energy: EnergyState,
    /// The share of a force that was applied in the tick before.
    share: f32,
    lies: Lies,
    again: Option<Again>,
    gives: fn([f32; 3]) -> [f32; 3],
}

/// The whole life of the device.
pub fn run(life: &Life) -> Result<(), Failure> {
    run_ordering(life, |epoch, tick| (epoch, tick))
}

/// The same of one that orders contact models in another way: for whoever tries what becomes of a device that takes those of an epoch that is over.
pub fn run_ordering(life: &Life, order: fn(u32, u64) -> (u32, u64)) -> Result<(), Failure> {
    run_as(life, order, |force_n| force_n)
}

/// The same of one that makes another force of the one that it has chosen: for whoever tries what becomes of a device that does.
pub fn run_giving(life: &Life, gives: fn([f32; 3]) -> [f32; 3]) -> Result<(), Failure> {
    run_as(life, |epoch, tick| (epoch, tick), gives)
}

fn run_as(life: &Life, order: fn(u32, u64) -> (u32, u64), gives: fn([f32; 3]) -> [f32; 3]) -> Result<(), Failure> {
    let roles = [Role::Hardware, Role::Haptic, Role::Tissue, Role::Fluid];
    let mut inbox = page_usher(&life.station, life.incarnation, &roles, realtime::pages_priority(life))?;
    let mut models = Models::new([Role::Tissue, Role::Fluid].map(|role| Horizon::open(&life.station, role).ok()), order);
    let mut replicas = Replicas::default();
    let hardware = Plugged::wait(life, first_pages(life, &mut inbox, &mut models, &mut replicas)?)?;
    let lies = Lies::new(life, size_of::<ForceCommand>());
    let (params, state) = (LastHopParams::default(), LastHopState::default());
    let again = life.is_replay().then(Again::default);
    let energy = EnergyState::default();
    let helpers = Helpers::of([Helper::usher(inbox.rounds())]);
    let share = 1.0;
    let mut hop = Hop { life, inbox, helpers, hardware, models, replicas, params, state, energy, share, lies, again, gives };
    realtime::go(life)?;
    hop.resume();
    hop.run()
}

/// Waits for the hardware's page, which it gives back, and then a little for those of all who live: a model that stood in a spare's page for long would
/// else be the newest of the first tick.
fn first_pages(life: &Life, inbox: &mut PageInbox, models: &mut Models, replicas: &mut Replicas) -> Result<ReadPage, Failure> {
    let started_ns = system::now_ns();
    let mut hardware: Option<(ReadPage, u64)> = None;
    loop {
        let waited_ns = |since_ns: u64| system::now_ns().saturating_sub(since_ns);
        match (inbox.take(), hardware.take()) {
            (Some(arrival), before) if arrival.slot.role() == Role::Hardware => {
                let since_ns = before.as_ref().map_or_else(system::now_ns, |(_, since_ns)| *since_ns);
                hardware = Some((arrival.page, since_ns));
                if let Some((page, _)) = before {
                    inbox.retire(page);
                }
            }
            (Some(arrival), before) => {
                hardware = before;
                seat(life, arrival, models, replicas, inbox);
            }
            (None, Some((page, since_ns))) => {
                let are_all_seated = models.are_all_seated(&life.clock) && replicas.are_all_seated(&life.clock);
                if are_all_seated || waited_ns(since_ns) > SEATING_NS {
                    return Ok(page);
                }
                hardware = Some((page, since_ns));
                system::sleep_ns(LOOK_NS);
            }
            (None, None) if waited_ns(started_ns) > PATIENCE_NS => {
                return Err(Failure::Broken("the hardware's page has not come".into()));
            }
            (None, None) => system::sleep_ns(LOOK_NS),
        }
        life.heartbeat();
    }
}

/// Puts a page where it belongs and hands its predecessor's back.
fn seat(life: &Life, arrival: PageArrival, models: &mut Models, replicas: &mut Replicas, inbox: &mut PageInbox) {
    let page = arrival.page;
    // What the predecessor wrote last may not have been read yet.
    models.newest(life, life.tick());
    models.medium(life, life.tick());
    let before = match arrival.slot.role() {
        Role::Haptic => {
            if let Some((_, before)) = page.cell(haptic::INPUT) {
                models.go_on_from(&before, life);
            }
            replicas.seat(arrival.slot.index(), page, life)
        }
        Role::Tissue => models.seat(arrival.slot.index(), page),
        Role::Fluid => models.seat_fluid(arrival.slot.index(), page),
        _ => Some(page),
    };
    if let Some(before) = before {
        inbox.retire(before);
    }
}

impl Hop<'_> {
    /// Goes on from the force that the motors make at this moment, so that a restart makes no kick.
    fn resume(&mut self) {
        let felt = self.hardware.page().cell(hardware::SAMPLE).map_or([0.0; 3], |(_, sample)| sample.force_n);
        self.state = LastHopState::born(felt, self.hardware.has_pushed());
        self.life.page.set_state(ProcessState::Live);
    }

    fn run(&mut self) -> Result<(), Failure> {
        let mut pace = Pace::new(self.life, 1, 0);
        let mut next_tick = None;
        while let Some(tick) = pace.wait() {
            self.life.misbehave();
            self.helpers.look(self.life);
            self.receive_ports();
            let sample = self.hardware.look(self.life)?;
            let Some(given) = self.given(tick) else {
                pace.end();
                continue;
            };
            if let Some(state) = given.newborn {
                (self.state, self.energy, next_tick) = (state, EnergyState::default(), None);
            }
            let silent_ticks = next_tick.map_or(0, |next| tick.saturating_sub(next)).min(u64::from(u32::MAX)) as u32;
            let state = self.state.after_silence(&HardwareParams::default(), silent_ticks, sample.force_n);
            self.state = match given.plug {
                Plug::Stays => state,
                Plug::Out => state.unplugged(),
                Plug::In(felt_n) => state.replugged(felt_n),
            };
            next_tick = Some(tick + 1);
            self.replicas.follow(given.followed);
            let share = self.book(&sample, silent_ticks);
            self.tick(tick, sample, &given, share, pace.woken_ns());
            pace.end();
        }
        Ok(())
    }

    /// Books what the force of the tick before has done to the hand, and says what share of a force may be applied. A device that was not let run knows what the
    /// motors made of it for as long as the hardware holds a force.
    fn book(&mut self, sample: &HardwareSample, silent_ticks: u32) -> f32 {
        let is_held = silent_ticks < HardwareParams::default().watchdog_ticks;
        let applied_n = if is_held { self.state.applied_n } else { [f32::NAN; 3] };
        let dt_s = TICK_S * (silent_ticks as f32 + 1.0);
        let (state, share) = energy_step(&EnergyParams::default(), &self.energy, sample.pose.position_m, applied_n, dt_s);
        self.energy = state;
        let before = std::mem::replace(&mut self.share, share);
        self.replicas.withhold(share.min(before) < 1.0);
        if share < 1.0 {
            self.life.page.add64(layout::WITHHELD_TICKS, 1);
        }
        share
    }

    /// No more than the device on the desk can do: the smaller force of its and the station's.
    fn heed(&mut self, limits: &DeviceLimits) {
        let (own_n, stated_n) = (LastHopParams::default().max_force_n, limits.max_force_n);
        self.params.max_force_n = if stated_n > 0.0 { own_n.min(stated_n) } else { own_n };
    }

    fn receive_ports(&mut self) {
        while let Some(arrival) = self.inbox.take() {
            if arrival.slot.role() == Role::Hardware {
                let before = self.hardware.replace(arrival.page);
                self.inbox.retire(before);
            } else {
                seat(self.life, arrival, &mut self.models, &mut self.replicas, &mut self.inbox);
            }
        }
    }

    /// Contact model and medium as the tissues and fluids have them now.
    fn newest_model(&mut self, tick: u64) -> Given {
        let (medium, medium_key) = self.models.medium(self.life, tick);
        let (limits, plug) = (self.hardware.limits(), self.hardware.plug());
        Given { model: self.models.newest(self.life, tick), medium, limits, medium_key, plug, ..Given::default() }
    }

    /// In lock-step: those of the ticks that the sequencer has seen finished; and every servo of the station has its seat.
    fn exact_model(&mut self, tick: u64) -> Given {
        let life = self.life;
        let tick_of = |word: usize| life.clock.page().load64(word);
        let found = lockstep::wait_for(life, || {
            self.receive_ports();
            let found = self.newest_model(tick);
            let reached = self.models.has_reached(tick_of(station::TISSUE_TICK), tick_of(station::FLUID_TICK));
            (reached && self.replicas.are_all_seated(&life.clock)).then_some(found)
        });
        found.unwrap_or_else(|| {
            if !life.clock.stop_requested() {
                let [model, medium] = [station::TISSUE_TICK, station::FLUID_TICK].map(tick_of);
                let within_s = lockstep::PATIENCE_NS / 1_000_000_000;
                let what = format!("a contact model of tick {model}, a medium of tick {medium} or a servo's page");
                life.say(&format!("{what} has not come within {within_s} s"));
            }
            self.newest_model(tick)
        })
    }

    /// What is known of the tick before the servos are asked; `None` if the recording of a replay says that the device made none.
    fn given(&mut self, tick: u64) -> Option<Given> {
        let given = if self.life.is_lockstep() { self.exact_model(tick) } else { self.newest_model(tick) };
        match &mut self.again {
            Some(again) => again.given(self.hardware.page(), tick, given.model),
            None => Some(given),
        }
    }

    fn tick(&mut self, tick: u64, sample: HardwareSample, given: &Given, share: f32, woken_ns: u64) {
        let page = &self.life.page;
        let Given { model, limits, medium_key: (medium_epoch, medium_tick), replayed, .. } = *given;
        let Medium { pressure_pa, pieces, on_scope_n } = given.medium;
        self.heed(&limits);
        let (device_incarnation, applied_n) = (self.life.incarnation as u64, self.state.applied_n);
        let selected_incarnation = self.replicas.selected_incarnation() as u64;
        let input = InputRecord {
            tick,
            device_incarnation,
            sample,
            model,
            applied_n,
            pressure_pa,
            pieces,
            selected_incarnation,
            replayed,
            medium_tick,
            medium_epoch,
            limits,
            on_scope_n,
            reserved: 0,
        };
        page.write(layout::INPUT, &input);
        page.push(layout::INPUTS, tick, &input);
        page.bump_and_wake(header::NEWS);
        let chosen = if self.life.is_lockstep() {
            self.replicas.choose_from_all(self.life, &input, &self.params)
        } else {
            let deadline_ns = self.life.clock.start_of(tick) + DEADLINE_NS;
            self.replicas.choose(self.life, &input, &self.params, deadline_ns)
        };
        let chosen = if given.is_mute || self.hardware.is_silent() { chosen.muted() } else { chosen };
        let wanted_n = chosen.force_n.map(self.gives).map(|force_n| force_n.map(|newton| newton * share));
        let (state, force_n, kind) = last_hop_step(&self.params, &self.state, wanted_n);
        self.state = state;
        let command = ForceCommand {
            tick,
            force_tick: chosen.tick,
            force_n,
            kind: told_as(kind, chosen.force_n.is_some()) as u32,
            source_incarnation: chosen.incarnation,
            device_incarnation: self.life.incarnation,
        };
        self.life.drag(woken_ns);
        let mut told = command;
        self.lies.tell(self.life, &mut told);
        page.write(layout::COMMAND, &told);
        let sent_ns = system::now_ns();
        page.store64(header::VALUE_NS, sent_ns);
        let record = AppliedRecord {
            tick,
            command,
            sample,
            model_tick: model.state_tick,
            model_epoch: model.epoch,
            model_incarnation: model.incarnation,
            sent_ns: if self.life.is_lockstep() { 0 } else { sent_ns },
            before_n: applied_n,
            lag: chosen.lag as u16,
            followed: chosen.followed,
            pieces,
            pressure_pa,
            medium_epoch,
            medium_tick,
            limits,
            on_scope_n,
        };
        page.push(layout::APPLIED, tick, &record);
    }
}

/// What the hardware is told of a force; `is_answered`: a servo has computed it for this tick.
fn told_as(kind: AppliedKind, is_answered: bool) -> Applied {
    match kind {
        AppliedKind::Fresh => Applied::Fresh,
        AppliedKind::Held => Applied::Held,
        AppliedKind::Ramped => Applied::Ramped,
        AppliedKind::Zero if is_answered => Applied::Fresh, // the gate is shut: zero is the force of this tick
        AppliedKind::Zero => Applied::Zero,
    }
}
