//! The bench that a driver is tried on: a station that has nothing but the driver under test, and this program in the place of the `device` engine, which
//! commands small forces and keeps what it sees.

use crate::settings::Refusal;
use hyst_engine::Settings;
use hyst_exchange::{OwnedPage, ReadPage, Station, StationPage, system};
use hyst_messages::page::{ProcessState, device, hardware, header, station};
use hyst_messages::{Applied, DeviceStatement, ForceCommand, HardwareSample, LedgerEntry, Role, Slot};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// The lives on the bench: the driver's, the first one in the place of the device, and its successor.
const DRIVER: u32 = 1;
const FIRST_DEVICE: u32 = 2;
const SECOND_DEVICE: u32 = 3;
/// How long a driver may take to state what it is, and from there to its first sample.
const STATES_WITHIN_NS: u64 = 25_000_000_000;
const SAMPLES_WITHIN_NS: u64 = 5_000_000_000;
/// How long it may take to end when it is told to: as long as a station waits before it kills.
const ENDS_WITHIN_NS: u64 = 2_000_000_000;
const LOOK_NS: u64 = 5_000_000;
/// Priority of the device engine, which this program stands for.
const PRIORITY: i32 = 84;

/// A sample, with the number of its cell and when it was seen, ns.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    pub sample: HardwareSample,
    pub seen_ns: u64,
}

/// The bench.
pub struct Bench<'a> {
    given_up: &'a dyn Fn() -> bool,
    station: Station,
    keeping: OwnedPage,
    clock: StationPage,
    child: Child,
    page: ReadPage,
    device: OwnedPage,
    device_incarnation: u32,
    number: u64,
    /// All samples that were seen.
    pub seen: Vec<Seen>,
    /// How late this program itself was at most, ns.
    pub late_ns: u64,
}

impl Drop for Bench<'_> {
    fn drop(&mut self) {
        self.keeping.store32_and_wake(station::STOP, 1);
        let _ = crate::proc::wait_within(&mut self.child, ENDS_WITHIN_NS); // one that does not end is killed
        system::demote(0);
        self.station.wipe();
    }
}

impl<'a> Bench<'a> {
    /// Founds the bench and starts the driver on it. Once it is given up it waits for nothing more, and drives no further.
    pub fn start(binary: &Path, given_up: &'a dyn Fn() -> bool) -> Result<Bench<'a>, Refusal> {
        let failed = |what: &dyn std::fmt::Display| Refusal::failed(format!("no bench for the driver: {what}"));
        let name = format!("driver-{}", std::process::id());
        let place = Station::named(&name).map_err(|e| failed(&e))?;
        place.wipe();
        place.found().map_err(|e| failed(&e))?;
        let slots = [Role::Hardware, Role::Device].map(Slot::first);
        let made = || -> Result<Bench<'a>, Refusal> {
            let settings = Settings { hand: "idle".into(), headless: true, ..Settings::default() };
            let text = toml::to_string(&settings).map_err(|e| failed(&e))?;
            std::fs::write(place.settings(), text).map_err(|e| failed(&e))?;
            let keeping = place.open_for_keeping().map_err(|e| failed(&e))?;
            keeping.store64(station::NEXT_INCARNATION, 10);
            drop(place.create_slot(slots[0], DRIVER).map_err(|e| failed(&e))?);
            let device = place.create_slot(slots[1], FIRST_DEVICE).map_err(|e| failed(&e))?;
            let page = place.read_slot(slots[0], DRIVER).map_err(|e| failed(&e))?;
            let log = std::fs::File::create(place.log(slots[0])).map_err(|e| failed(&e))?;
            let words = ["--station", &name, "--slot", "hardware", "--incarnation", &DRIVER.to_string()].map(String::from);
            let mut command = Command::new(binary);
            command.args(words).stdin(Stdio::null()).stdout(Stdio::null()).stderr(log).process_group(0);
            let child = command.spawn().map_err(|e| failed(&e))?;
            let clock = place.open().map_err(|e| failed(&e))?;
            let (number, seen, late_ns, device_incarnation) = (0, Vec::new(), 0, FIRST_DEVICE);
            let station = place.clone();
            Ok(Bench { given_up, station, keeping, clock, child, page, device, device_incarnation, number, seen, late_ns })
        };
        let bench = made().inspect_err(|_| place.wipe())?;
        bench.announce(slots[0], DRIVER);
        bench.announce(slots[1], FIRST_DEVICE);
        Ok(bench)
    }

    fn announce(&self, slot: Slot, incarnation: u32) {
        self.keeping.store32(station::SLOT_INCARNATION + slot.number(), incarnation);
        self.keeping.bump_and_wake(station::CHANGES);
    }

    /// Waits until there is something, or the driver has ended.
    fn wait_for<T>(&mut self, within_ns: u64, what: &str, found: impl Fn(&ReadPage) -> Option<T>) -> Result<T, String> {
        let deadline_ns = system::now_ns() + within_ns;
        loop {
            if let Some(it) = found(&self.page) {
                return Ok(it);
            }
            if let Ok(Some(status)) = self.child.try_wait() {
                let said = std::fs::read_to_string(self.station.log(Slot::first(Role::Hardware))).unwrap_or_default();
                let last = said.lines().last().unwrap_or("it said nothing");
                return Err(format!("it ended before {what} ({status}): {last}"));
            }
            if system::now_ns() >= deadline_ns || (self.given_up)() {
                return Err(format!("{what} has not come within {} s", within_ns / 1_000_000_000));
            }
            system::sleep_ns(LOOK_NS);
        }
    }

    /// What the driver states.
    pub fn statement(&mut self) -> Result<DeviceStatement, String> {
        self.wait_for(STATES_WITHIN_NS, "its statement", |page| page.cell(hardware::STATEMENT).map(|(_, stated)| stated))
    }

    /// Waits for the first sample, and for the driver to say that it is live.
    pub fn first_sample(&mut self) -> Result<(), String> {
        self.wait_for(SAMPLES_WITHIN_NS, "its first sample", |page| page.cell(hardware::SAMPLE).map(|_| ()))?;
        self.wait_for(SAMPLES_WITHIN_NS, "its word that it is live", |page| {
            (page.state() == ProcessState::Live && page.load64(header::PID) != 0).then_some(())
        })
    }

    /// The station's tick.
    pub fn tick(&self) -> u64 {
        self.clock.present_tick()
    }

    /// Where the tip was when a tick began, m, by the newest sample that was stamped until then.
    pub fn position_m(&self, tick: u64) -> Option<[f32; 3]> {
        let start_ns = self.clock.start_of(tick);
        let until_then = self.seen.iter().rev().find(|seen| seen.sample.time_ns <= start_ns);
        until_then.map(|seen| seen.sample.pose.position_m)
    }

    /// For so many ticks: says in each what `command` makes of its number, nothing if that is nothing, and keeps the sample that is there.
    pub fn drive(&mut self, ticks: u64, mut command: impl FnMut(u64) -> Option<ForceCommand>) {
        system::become_fifo(PRIORITY); // without the right to it this program is late now and then, and says so
        let begin = self.tick() + 1;
        for tick in begin..begin + ticks {
            if (self.given_up)() {
                break;
            }
            let due_ns = self.clock.start_of(tick);
            system::sleep_until_ns(due_ns);
            let seen_ns = system::now_ns();
            self.late_ns = self.late_ns.max(seen_ns.saturating_sub(due_ns));
            if let Some((number, sample)) = self.page.cell(hardware::SAMPLE).filter(|(number, _)| *number != self.number) {
                self.number = number;
                self.seen.push(Seen { sample, seen_ns });
            }
            if let Some(command) = command(tick) {
                self.device.write(device::COMMAND, &ForceCommand { device_incarnation: self.device_incarnation, ..command });
            }
        }
        system::demote(0);
    }

    /// A new life takes the device's place, as after its death; in its page stands a command already.
    pub fn replace_device(&mut self, command: ForceCommand) -> Result<(), Refusal> {
        let slot = Slot::first(Role::Device);
        let made = self.station.create_slot(slot, SECOND_DEVICE).map_err(|e| Refusal::failed(e.to_string()))?;
        made.write(device::COMMAND, &ForceCommand { device_incarnation: SECOND_DEVICE, ..command });
        self.keeping.store32(station::SLOT_DEAD + slot.number(), 1);
        (self.device, self.device_incarnation) = (made, SECOND_DEVICE);
        self.announce(slot, SECOND_DEVICE);
        self.keeping.store32(station::SLOT_DEAD + slot.number(), 0);
        Ok(())
    }

    /// The entries of the driver's ledger for station ticks of a range, in their order.
    pub fn ledger(&self, ticks: std::ops::Range<u64>) -> Vec<LedgerEntry> {
        let end = self.page.ring_end(hardware::LEDGER);
        let first = end.saturating_sub(hardware::LEDGER.entries as u64);
        let entries = (first..end).filter_map(|key| self.page.ring(hardware::LEDGER, key));
        entries.filter(|entry| ticks.contains(&entry.station_tick)).collect()
    }

    /// Steps that the driver has counted, and its newest heartbeat, ns.
    pub fn beat(&self) -> (u64, u64) {
        (self.page.load64(header::STEPS), self.page.load64(header::HEARTBEAT_NS))
    }

    /// Tells the driver to stop, and waits for its end.
    pub fn stop(&mut self) -> Result<String, String> {
        self.keeping.store32_and_wake(station::STOP, 1);
        self.keeping.bump_and_wake(station::CHANGES);
        let begun_ns = system::now_ns();
        match crate::proc::wait_within(&mut self.child, ENDS_WITHIN_NS) {
            Some(status) if status.success() => {
                Ok(format!("exit code 0 after {:.0} ms", (system::now_ns() - begun_ns) as f64 * 1e-6))
            }
            Some(status) => Err(format!("{status}; it must be exit code 0")),
            None => Err(format!("it does not end within {} s of the station's stop", ENDS_WITHIN_NS / 1_000_000_000)),
        }
    }
}

/// A fresh command of a tick.
pub fn fresh(tick: u64, force_n: [f32; 3]) -> ForceCommand {
    ForceCommand { tick, force_tick: tick, force_n, kind: Applied::Fresh as u32, ..ForceCommand::default() }
}
