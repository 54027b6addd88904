//! The firmware: 1 kHz by a clock of its own that drifts against the station's, the newest command to the motors, a watchdog that ramps the
//! force to zero when commands stay out, encoders, and the compliant hand that closes the loop.

use super::canary::Canaries;
use super::commands::Commands;
use super::finger::Finger;
use super::hand::Hand;
use super::ledger::{Judged, Ledger};
use super::pump::Pump;
use super::sequencer::Sequencer;
use hyst_coupling::{HardwareParams, HardwareState, ServoParams, hardware_step};
use hyst_engine::{Failure, Life, realtime};
use hyst_exchange::usher::{PageInbox, page_usher};
use hyst_exchange::{ReadPage, allocation, system};
use hyst_messages::page::{ProcessState, hardware, header, rendering};
use hyst_messages::{
    DeviceLimits, DeviceStatement, HardwareSample, ReplayRecord, Role, STATEMENT_VERSION, TICK_NS, statement_text,
};
use std::sync::Arc;

/// Drift of the simulated clock against the station's, ppm: an ordinary crystal.
const DRIFT_PPM: f64 = 20.0;

struct Firmware<'a> {
    life: &'a Life,
    inbox: PageInbox,
    device: Option<ReadPage>,
    window: Option<ReadPage>,
    finger: Finger,
    pump: Pump,
    commands: Commands,
    tip_m: [f32; 3],
    params: HardwareParams,
    state: HardwareState,
    hand: Hand,
    /// What the operator is told of it: in the page, as last words are.
    complaint: &'static str,
    ledger: Ledger,
}

/// The whole life of the hardware.
pub fn run(life: &Life) -> Result<(), Failure> {
    let drift = life.settings.number("drift_ppm", DRIFT_PPM, -500.0..=500.0, "a number from -500 to 500")?;
    let period_ns = TICK_NS as f64 * (1.0 + drift * 1e-6);
    let hand = Hand::of(life)?;
    life.page.write(hardware::STATEMENT, &stated(&hand, 1e9 / period_ns));
    let mut roles = vec![Role::Device, Role::Rendering];
    roles.extend(hand.is_waiting().then_some(Role::Fluid));
    let inbox = page_usher(&life.station, life.incarnation, &roles, realtime::pages_priority(life))?;
    let canaries = Canaries::start(life)?;
    let mut firmware = Firmware {
        life,
        inbox,
        device: None,
        window: None,
        finger: Finger::new(system::now_ns()),
        pump: Pump::default(),
        commands: Commands::default(),
        tip_m: [0.0; 3],
        params: HardwareParams::default(),
        state: HardwareState::default(),
        hand,
        complaint: "",
        ledger: Ledger::new(Arc::clone(&life.page), canaries),
    };
    realtime::go(life)?;
    let sequencer = if life.is_lockstep() { Some(Sequencer::new(life)?) } else { None };
    life.page.set_state(ProcessState::Live);
    match sequencer {
        Some(sequencer) => firmware.run_in_lockstep(sequencer),
        None => firmware.run(period_ns),
    }
    Ok(())
}

/// What the simulated device states of itself: as much as the station's own bounds let it be asked for, within what the hand's limits leave it.
fn stated(hand: &Hand, rate_hz: f64) -> DeviceStatement {
    let (motors, servo, limits) = (HardwareParams::default(), ServoParams::default(), hand.limits());
    let (tilt_rad, roll_rad) = (limits.tilt_rad.min(1.5), limits.roll_rad.min(std::f32::consts::PI)); // what `DofLimits::clamp` leaves of them
    DeviceStatement {
        version: STATEMENT_VERSION,
        measured_dof: 4,
        driven_dof: 3,
        rate_hz: rate_hz as f32,
        limits: DeviceLimits {
            max_force_n: motors.max_force_n,
            max_stiffness_n_m: servo.coupling_stiffness_n_m,
            max_damping_n_s_m: servo.max_damping_n_s_m,
        },
        continuous_force_n: motors.max_force_n,           // nothing gets warm
        device_damping_n_s_m: servo.device_damping_n_s_m, // that of the hand is more
        pitch_rad: [-tilt_rad, tilt_rad],
        yaw_rad: [-tilt_rad, tilt_rad],
        roll_rad: [-roll_rad, roll_rad],
        insertion_m: [limits.min_insertion_m, limits.max_insertion_m],
        maker: statement_text("hystation"),
        name: statement_text("simulated device"),
        ..DeviceStatement::default()
    }
}

impl Firmware<'_> {
    fn run(&mut self, period_ns: f64) {
        let start_ns = system::now_ns();
        let allocations = allocation::of_this_thread();
        let page = &self.life.page;
        let mut hardware_tick = 0u64;
        while !self.life.clock.stop_requested() {
            hardware_tick += 1;
            let due_ns = start_ns + (hardware_tick as f64 * period_ns) as u64;
            // The host stalled. A real device would have gone on: the ticks that passed are in the ledger, with the commands that had come by then.
            let has_passed = |now_ns: u64| now_ns > due_ns + TICK_NS;
            if has_passed(system::now_ns()) {
                self.tick(hardware_tick, due_ns, true);
                continue;
            }
            system::sleep_until_ns(due_ns);
            let woken_ns = system::now_ns();
            self.receive_ports();
            self.tick(hardware_tick, if has_passed(woken_ns) { due_ns } else { woken_ns }, has_passed(woken_ns));
            let end_ns = system::now_ns();
            page.count_latency(header::WAKEUP, woken_ns.saturating_sub(due_ns));
            page.count_latency(header::LOOP, end_ns - woken_ns);
            page.store64(header::HEARTBEAT_NS, end_ns);
            page.store64(header::TICK, hardware_tick);
            page.add64(header::STEPS, 1);
            page.store64(header::ALLOCATIONS, allocation::of_this_thread() - allocations);
        }
        self.ledger.flush();
    }

    /// The station's ticks one after the other, each as soon as everybody has ended the one before. Time is virtual.
    fn run_in_lockstep(&mut self, mut sequencer: Sequencer<'_>) {
        while let Some(tick) = sequencer.begin() {
            self.receive_ports();
            let again = self.life.is_replay().then(|| self.hand.again(tick));
            if let Some((moment, _)) = &again {
                let (recorded, replayed) = (moment.applied.unwrap_or_default(), moment.replayed());
                self.life.page.write(hardware::REPLAY, &ReplayRecord { tick, recorded, replayed });
            }
            self.tick_at(tick, tick * TICK_NS, tick, false);
            let begun_ns = system::now_ns();
            sequencer.release(tick, again.as_ref().map(|(_, steps)| &steps[..]));
            let page = &self.life.page;
            page.count_latency(header::LOOP, system::now_ns() - begun_ns);
            page.store64(header::TICK, tick);
            page.add64(header::STEPS, 1);
        }
        self.ledger.flush();
    }

    fn receive_ports(&mut self) {
        while let Some(arrival) = self.inbox.take() {
            let before = match arrival.slot.role() {
                Role::Device => self.device.replace(arrival.page),
                Role::Fluid => self.pump.seat(arrival.slot.index(), arrival.page),
                _ => self.window.replace(arrival.page),
            };
            if let Some(before) = before {
                self.inbox.retire(before);
            }
        }
    }

    fn tick(&mut self, hardware_tick: u64, time_ns: u64, has_passed: bool) {
        self.tick_at(hardware_tick, time_ns, self.life.clock.tick_at(time_ns), has_passed);
    }

    fn tick_at(&mut self, hardware_tick: u64, time_ns: u64, station_tick: u64, has_passed: bool) {
        let (tip_m, max_force_n) = (self.tip_m, self.params.max_force_n);
        let command = self.device.as_ref().and_then(|page| match has_passed {
            true => self.commands.past_one(page, station_tick, time_ns, max_force_n),
            false => self.commands.new_one(self.life, page, tip_m, max_force_n),
        });
        let trips = self.state.trips;
        let (state, force_n) = hardware_step(&self.params, &self.state, command.map(|command| command.force_n));
        self.state = state;
        let said = self.window.as_ref().and_then(|page| page.cell(rendering::POINTER));
        // By the wall's time, as the window lives by it in lock-step, too.
        let pointer = said.map(|(_, said)| self.finger.heed(system::now_ns(), said));
        if self.hand.is_waiting()
            && let Some(status) = self.pump.says(station_tick)
        {
            self.hand.see(hardware_tick, &status);
        }
        let hand = self.hand.step(hardware_tick, force_n, pointer.as_ref());
        self.tip_m = hand.pose.position_m;
        let sample = HardwareSample {
            hardware_tick,
            time_ns,
            pose: hand.pose,
            velocity_m_s: hand.velocity_m_s,
            force_n: hand.felt_n.unwrap_or(force_n),
            controls: hand.controls,
            from_window: hand.from_window,
        };
        self.life.page.write(hardware::SAMPLE, &sample);
        self.life.page.store64(header::VALUE_NS, time_ns);
        let judged = Judged {
            hardware_tick,
            time_ns,
            station_tick,
            command: self.commands.newest,
            silent: command.is_none(),
            force_n,
            tripped: state.trips != trips,
            max_force_n: self.params.max_force_n,
        };
        self.ledger.write(&judged);
        let complaint = self.hand.complaint();
        if complaint != self.complaint {
            self.life.page.last_words(complaint);
            self.complaint = complaint;
        }
    }
}
