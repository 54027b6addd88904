//! The servo's loop: one step for each input record, the state handed on with every force. Both replicas compute every tick from the same
//! record, so their forces are the same to the bit; a newborn takes the state of the other and runs in its shadow until it has agreed.
//!
//! The loop is paced by the device's input records, not by a clock of its own: it computes for the tick that the hand is in.

use crate::drain;
use hyst_coupling::{ContactModel, Plane, ServoInput, ServoParams, ServoState, servo_step};
use hyst_engine::{Failure, Life, realtime};
use hyst_exchange::usher::{PageInbox, page_usher};
use hyst_exchange::{Links, ReadPage, allocation, cell, system};
use hyst_messages::page::{ProcessState, device, haptic, header};
use hyst_messages::record::{FORCE_SHADOW, SERVO_STATE_WORDS};
use hyst_messages::{ForceRecord, InputRecord, Role, TICK_NS, fnv_words};

/// Ticks that a newborn must agree with the other replica before it may be chosen.
pub const SHADOW_TICKS: u32 = 20;
/// Ticks without a word from the other replica after which a newborn need not wait for it.
pub const LONELY_TICKS: u64 = 5;
/// How long the servo sleeps at most without an input, ns: then it looks for a successor of the device, and for the station's end.
const PATIENCE_NS: u64 = 2 * TICK_NS;

struct Servo<'a> {
    life: &'a Life,
    inbox: PageInbox,
    device: Option<ReadPage>,
    peer: Option<ReadPage>,
    params: ServoParams,
    /// What this replica said last.
    last: ForceRecord,
    agreed: u32,
    shadow: bool,
    allocations: u64,
}

/// The whole life of a servo.
pub fn run(life: &Life) -> Result<(), Failure> {
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let _drain = drain::start(life, links)?;
    life.ports_are_open();
    let inbox = page_usher(&life.station, life.incarnation, &[Role::Device, Role::Haptic])?;
    let mut servo = Servo {
        life,
        inbox,
        device: None,
        peer: None,
        params: ServoParams::default(),
        last: ForceRecord::default(),
        agreed: 0,
        shadow: true,
        allocations: 0,
    };
    while servo.device.is_none() && !life.clock.stop_requested() {
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
    fn receive_ports(&mut self) {
        while let Some(arrival) = self.inbox.take() {
            let place = if arrival.slot.role() == Role::Device { &mut self.device } else { &mut self.peer };
            if let Some(before) = place.replace(arrival.page) {
                self.inbox.retire(before);
            }
        }
    }

    fn run(&mut self) {
        let mut seen = 0;
        while !self.life.clock.stop_requested() {
            self.receive_ports();
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
            if input.tick <= self.last.tick {
                continue;
            }
            self.tick(&input);
            self.account(&input, woken_ns);
        }
    }

    fn account(&self, input: &InputRecord, woken_ns: u64) {
        let page = &self.life.page;
        let now = system::now_ns();
        page.count_latency(header::WAKEUP, woken_ns.saturating_sub(self.life.clock.start_of(input.tick)));
        page.count_latency(header::LOOP, now - woken_ns);
        page.store64(header::HEARTBEAT_NS, now);
        page.store64(header::VALUE_NS, now);
        page.add64(header::STEPS, 1);
        page.store64(header::ALLOCATIONS, allocation::of_this_thread() - self.allocations);
    }

    /// The state to go on from: own if no tick is missing, else the other replica's if it has it, else own with the gap.
    fn before(&self, tick: u64) -> (ServoState, bool) {
        if self.last.tick + 1 == tick {
            return (state_of(&self.last), true);
        }
        let peer = self.peer.as_ref().and_then(|page| page.cell(haptic::FORCE)).map(|(_, record)| record);
        match peer {
            Some(peer) if peer.tick + 1 == tick && peer.flags & FORCE_SHADOW == 0 => (state_of(&peer), true),
            _ => (state_of(&self.last), false),
        }
    }

    fn tick(&mut self, input: &InputRecord) {
        let (before, whole) = self.before(input.tick);
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
        };
        let (state, output) = servo_step(&self.params, &before, &request);
        self.leave_shadow(input.tick, whole);
        let mut record = ForceRecord {
            tick: input.tick,
            input_hash: fnv_words(0, cell::words_of(input)),
            force_n: output.force_n,
            flags: (output.flags & 3) | if self.shadow { FORCE_SHADOW } else { 0 },
            servo_state: [0; SERVO_STATE_WORDS],
        };
        bytemuck::cast_slice_mut(&mut record.servo_state)[..size_of::<ServoState>()].copy_from_slice(bytemuck::bytes_of(&state));
        let page = &self.life.page;
        page.write(haptic::FORCE, &record);
        page.store64(header::TICK, input.tick);
        page.bump_and_wake(header::NEWS);
        self.last = record;
    }

    /// Compares the last tick with the other replica's, if it can be had, and leaves the shadow after enough agreement, or if there is
    /// nobody to agree with.
    fn leave_shadow(&mut self, tick: u64, whole: bool) {
        if !self.shadow {
            return;
        }
        let peer = self.peer.as_ref().and_then(|page| page.cell(haptic::FORCE)).map(|(_, record)| record);
        let heard = peer.filter(|peer| peer.tick + LONELY_TICKS > tick);
        match heard {
            Some(peer) if peer.tick == self.last.tick => {
                let agrees = whole && peer.force_n.map(f32::to_bits) == self.last.force_n.map(f32::to_bits);
                self.agreed = if agrees { self.agreed + 1 } else { 0 };
            }
            Some(peer) if peer.flags & FORCE_SHADOW == 0 => {}
            // Nobody to agree with, or two newborns: the first slot leads.
            _ => self.agreed += u32::from(heard.is_none() || self.life.slot.index() == 0),
        }
        if self.agreed >= SHADOW_TICKS {
            self.shadow = false;
            self.life.page.set_state(ProcessState::Live);
        }
    }
}

fn state_of(record: &ForceRecord) -> ServoState {
    bytemuck::pod_read_unaligned(&bytemuck::cast_slice::<u64, u8>(&record.servo_state)[..size_of::<ServoState>()])
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
    model.count = count as u32;
    model
}
