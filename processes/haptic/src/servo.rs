//! The servo's loop: one step for each input record, the state handed on with every force. Both replicas compute every tick from the same
//! record, so their forces are the same to the bit; one that lost ticks and a newborn go on from the other's state ([`accord`]), and a
//! newborn runs in the other's shadow until it has agreed.
//!
//! The loop is paced by the device's input records, not by a clock of its own: it computes for the tick that the hand is in.

use crate::accord::{self, LONELY_TICKS, Origin, Other, Seat};
use crate::drain;
use hyst_coupling::{ContactModel, Plane, ServoInput, ServoParams, ServoState, servo_step};
use hyst_engine::lane::Follower;
use hyst_engine::{Failure, Helper, Helpers, Lies, Life, realtime};
use hyst_exchange::usher::{PageInbox, page_usher};
use hyst_exchange::{Links, ReadPage, allocation, cell, system};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{ProcessState, device, haptic, header};
use hyst_messages::record::{FORCE_ASTRAY, FORCE_SHADOW, SERVO_STATE_WORDS, SHADOW_TICKS};
use hyst_messages::{ForceRecord, InputRecord, Role, TICK_NS, fnv_words};
use std::collections::VecDeque;

/// Ticks for which a newborn waits for the page of another servo that lives, before it is taken for alone: that page may be one that nobody can map.
const UNSEEN_TICKS: u32 = 500;
/// How long the servo sleeps at most without an input, ns: then it looks for a successor of the device, and for the station's end.
const PATIENCE_NS: u64 = 2 * TICK_NS;
/// Most ticks by which an input may be ahead of the clock: one that were taken would leave all that come before its time unanswered.
const MOST_AHEAD_TICKS: u64 = 2;
/// States that a servo keeps in a replay: longer than one that answers nothing is let live.
const HISTORY: usize = 4_096;

struct Servo<'a> {
    life: &'a Life,
    inbox: PageInbox,
    helpers: Helpers,
    device: Option<ReadPage>,
    peer: Option<ReadPage>,
    params: ServoParams,
    /// What this replica said last.
    last: ForceRecord,
    agreed: u32,
    /// Ticks in which another servo lived and its page was not there.
    unseen: u32,
    shadow: bool,
    tells: fn([f32; 3]) -> [f32; 3],
    allocations: u64,
    lies: Lies,
    /// What was recorded of its answers' origins so far.
    origins: u64,
    /// In a replay: the last ticks that it answered, and its states then. A servo that was held up went on from one that the page has no more, for here it
    /// answers every tick.
    history: VecDeque<(u64, ServoState)>,
}

/// The whole life of a servo.
pub fn run(life: &Life) -> Result<(), Failure> {
    run_telling(life, |force_n| force_n)
}

/// The same of one that tells another force than it has computed, or tells it later: for whoever tries what becomes of a servo that does.
pub fn run_telling(life: &Life, tells: fn([f32; 3]) -> [f32; 3]) -> Result<(), Failure> {
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let drain = drain::start(life, links)?;
    life.ports_are_open();
    let roles = [Role::Device, Role::Haptic];
    let inbox = page_usher(&life.station, life.incarnation, &roles, realtime::pages_priority(life))?;
    let helpers = Helpers::of(drain.helpers().into_iter().chain([Helper::usher(inbox.rounds())]));
    let mut servo = Servo {
        life,
        inbox,
        helpers,
        device: None,
        peer: None,
        params: ServoParams::default(),
        last: ForceRecord::default(),
        agreed: 0,
        unseen: 0,
        shadow: true,
        tells,
        allocations: 0,
        lies: Lies::new(life, size_of::<ForceRecord>()),
        origins: 0,
        history: VecDeque::with_capacity(if life.is_replay() { HISTORY + 1 } else { 0 }),
    };
    while !servo.is_connected() && !life.clock.stop_requested() {
        servo.receive_ports();
        life.heartbeat();
        system::sleep_ns(TICK_NS);
    }
    realtime::go(life)?;
    servo.allocations = allocation::of_this_thread();
    life.page.set_state(ProcessState::Warm);
    servo.run();
    Ok(())
}

impl Servo<'_> {
    /// Whether the device's page is there; in lock-step the other servo's too, if it lives, because its state is needed at the first tick.
    fn is_connected(&self) -> bool {
        let clock = &self.life.clock;
        let known = |incarnation: u32| self.peer.as_ref().is_some_and(|page| page.incarnation() == incarnation);
        let mut servos = clock.occupied(Role::Haptic).filter(|(slot, _)| *slot != self.life.slot && !clock.is_dead(*slot));
        self.device.is_some() && (!self.life.is_lockstep() || servos.all(|(_, incarnation)| known(incarnation)))
    }

    /// Whether the station has another servo that is not known to be dead.
    fn another_lives(&self) -> bool {
        let clock = &self.life.clock;
        clock.occupied(Role::Haptic).any(|(slot, _)| slot != self.life.slot && !clock.is_dead(slot))
    }

    fn receive_ports(&mut self) {
        while let Some(arrival) = self.inbox.take() {
            let place = if arrival.slot.role() == Role::Device { &mut self.device } else { &mut self.peer };
            if let Some(before) = place.replace(arrival.page) {
                self.inbox.retire(before);
            }
        }
    }

    fn run(&mut self) {
        let (mut seen, mut lane) = (0, Follower::default());
        while !self.life.clock.stop_requested() {
            self.helpers.look(self.life);
            self.receive_ports();
            lane.follow(self.life, self.life.is_lockstep());
            let now = system::now_ns();
            let Some(device) = &self.device else { return };
            let news = device.load32(header::NEWS);
            if news == seen {
                device.wait(header::NEWS, seen, now + PATIENCE_NS);
                self.life.heartbeat();
                continue;
            }
            seen = news;
            let woken_ns = system::now_ns();
            let Some((_, input)) = device.cell(device::INPUT) else { continue };
            if input.tick > self.life.clock.latest_tick().saturating_add(MOST_AHEAD_TICKS) {
                self.life.refuse(device.incarnation(), Distrust::Invalid);
                self.life.heartbeat();
                continue;
            }
            if input.tick <= self.last.tick {
                continue;
            }
            self.life.misbehave();
            self.life.perish();
            self.tick(&input, woken_ns);
            self.account(&input, woken_ns);
        }
    }

    fn account(&self, input: &InputRecord, woken_ns: u64) {
        let page = &self.life.page;
        let now = system::now_ns();
        if !self.life.is_lockstep() {
            page.count_latency(header::WAKEUP, woken_ns.saturating_sub(self.life.clock.start_of(input.tick)));
        }
        page.count_latency(header::LOOP, now - woken_ns);
        page.store64(header::HEARTBEAT_NS, now);
        page.store64(header::VALUE_NS, now);
        page.add64(header::STEPS, 1);
        page.store64(header::ALLOCATIONS, allocation::of_this_thread() - self.allocations);
    }

    /// What the other servo has said.
    fn other(&self, tick: u64) -> Option<Other> {
        let page = self.peer.as_ref()?;
        let (_, newest) = page.cell(haptic::FORCE)?;
        let seat = Seat { incarnation: page.incarnation(), index: 1 - self.life.slot.index().min(1) };
        Some(Other { seat, newest, before: page.ring(haptic::FORCES, tick - 1) })
    }

    /// In a replay, what the recorded answer went on from where that was not the usual.
    fn replayed(&self, input: &InputRecord) -> Option<Origin> {
        let told = *input.replayed.get(self.life.slot.index())?;
        let own = |tick: u64| self.history.iter().rev().find(|(of, _)| *of <= tick).filter(|(of, _)| *of == tick);
        let others = |tick: u64| self.peer.as_ref()?.ring(haptic::FORCES, tick);
        accord::replayed(
            told,
            input.tick,
            |tick| own(tick).map(|(_, state)| *state),
            |tick| others(tick).map(|record| accord::state_of(&record)),
        )
    }

    fn tick(&mut self, input: &InputRecord, woken_ns: u64) {
        let other = self.other(input.tick);
        let me = Seat { incarnation: self.life.incarnation, index: self.life.slot.index() };
        let selected = input.selected_incarnation as u32;
        let from = accord::origin(&self.params, me, &self.last, other.as_ref(), input.tick, selected);
        let from = self.replayed(input).unwrap_or(from);
        self.leave_shadow(input.tick, other.as_ref());
        let record = answer(&self.params, input, &from, self.shadow);
        self.life.drag(woken_ns);
        let mut told = ForceRecord { force_n: (self.tells)(record.force_n), ..record };
        self.lies.tell(self.life, &mut told);
        let page = &self.life.page;
        // Before the force: who records that has this, too.
        if let Some(origin) = from.record(me.index, input.tick) {
            page.push(haptic::ORIGINS, self.origins, &origin);
            self.origins += 1;
        }
        page.push(haptic::FORCES, input.tick, &told);
        page.write(haptic::FORCE, &told);
        page.store64(header::TICK, told.tick);
        page.bump_and_wake(header::NEWS);
        page.write(haptic::INPUT, input); // for a device that is born after this one
        self.last = record;
        if self.life.is_replay() {
            self.history.push_back((input.tick, accord::state_of(&record)));
            self.history.drain(..self.history.len().saturating_sub(HISTORY));
        }
    }

    /// Compares the last tick with the other replica's, if it can be had, and leaves the shadow after enough agreement, or if there is
    /// nobody to agree with.
    fn leave_shadow(&mut self, tick: u64, other: Option<&Other>) {
        if !self.shadow {
            return;
        }
        // Its page comes from another thread, which may have to wait for a core.
        if other.is_none() && self.unseen < UNSEEN_TICKS && self.another_lives() {
            self.unseen += 1;
            return;
        }
        // One whose word cannot be, or is not of its tick, is no one to agree with: while a newborn waited for a liar nobody would replace the liar.
        let is_word = |other: &&Other| other.before.is_none_or(|before| accord::is_sound(&self.params, &before));
        let heard = other.filter(|other| other.newest.tick.saturating_add(LONELY_TICKS) > tick).filter(is_word);
        match heard.map(|other| (other.before, other.newest.flags & FORCE_SHADOW != 0)) {
            Some((Some(before), _)) => {
                self.agreed = if accord::agree(&before, &self.last) { self.agreed + 1 } else { 0 };
            }
            Some((None, false)) => {}
            // Nobody to agree with, or two newborns: the first slot leads.
            None => self.agreed += 1,
            Some((None, true)) => self.agreed += u32::from(self.life.slot.index() == 0),
        }
        if self.agreed >= SHADOW_TICKS {
            self.shadow = false;
            self.life.page.set_state(ProcessState::Live);
        }
    }
}

/// What a servo answers to an input, going on from there.
fn answer(params: &ServoParams, input: &InputRecord, from: &Origin, is_in_shadow: bool) -> ForceRecord {
    let model = contact_model(input);
    let age = input.tick.saturating_sub(input.model.state_tick).min(u32::MAX as u64) as u32;
    let request = ServoInput {
        tick: input.tick,
        position_m: input.sample.pose.position_m,
        velocity_m_s: input.sample.velocity_m_s,
        dt_s: 1e-3,
        model: &model,
        model_age_ticks: if input.model.epoch == 0 { u32::MAX } else { age },
        applied_n: Some(input.applied_n),
        medium_n: hyst_coupling::felt_of_medium_n(input.on_scope_n),
    };
    let limits = &input.limits;
    let params = params.for_device(limits.max_force_n, limits.max_stiffness_n_m, limits.max_damping_n_s_m);
    let (state, output) = servo_step(&params, &from.state, &request);
    let mut record = ForceRecord {
        tick: input.tick,
        input_hash: fnv_words(0, cell::words_of(input)),
        force_n: output.force_n,
        flags: (output.flags & 3)
            | bit(FORCE_SHADOW, is_in_shadow)
            | bit(FORCE_ASTRAY, from.astray)
            | ForceRecord::lag_bits(input.tick, from.state.tick),
        servo_state: [0; SERVO_STATE_WORDS],
    };
    bytemuck::cast_slice_mut(&mut record.servo_state)[..size_of::<ServoState>()].copy_from_slice(bytemuck::bytes_of(&state));
    record
}

/// `flag` if `set`.
fn bit(flag: u32, set: bool) -> u32 {
    if set { flag } else { 0 }
}

fn contact_model(input: &InputRecord) -> ContactModel {
    let mut model = ContactModel::new(&[]);
    let count = (input.model.plane_count as usize).min(input.model.planes.len());
    for (plane, from) in model.planes.iter_mut().zip(&input.model.planes[..count]) {
        *plane = Plane {
            point_m: from.point_m,
            normal: from.normal,
            stiffness_n_m: from.stiffness_n_m,
            damping_n_s_m: from.damping_n_s_m,
        };
    }
    (model.count, model.friction) = (count as u32, input.model.friction);
    model
}

#[cfg(test)]
mod tests;
