//! Servos as real processes; the test is their device and their supervisor, in a station of its own: one for each test program. Times are hang
//! detectors only.
#![allow(dead_code)] // each test program uses its part

use hyst_exchange::stream::HeldService;
use hyst_exchange::{Links, OwnedPage, ReadPage, Station, system};
use hyst_messages::page::{device, haptic, header, station as layout};
use hyst_messages::{ContactModel, ContactPlane, ForceRecord, InputRecord, Kind, OriginRecord, Role, Slot};
use rustix::process::{Pid, Signal, WaitOptions, kill_process, waitpid};
use std::process::{Child, Command, Stdio};

/// A servo that has not answered by then hangs, ns.
pub const HANG_NS: u64 = 20_000_000_000;
/// Incarnation of the device that the test plays.
pub const DEVICE: u32 = 1;

pub struct Wiped(pub Station);
impl Drop for Wiped {
    fn drop(&mut self) {
        self.0.wipe();
    }
}

pub struct Servo {
    child: Child,
    page: ReadPage,
    incarnation: u32,
    _service: HeldService,
}

impl Drop for Servo {
    fn drop(&mut self) {
        let _ = self.child.kill(); // gone already is as good
        let _ = self.child.wait();
    }
}

impl Servo {
    pub fn start(station: &Station, keeping: &OwnedPage, links: &Links, index: usize) -> Servo {
        let (slot, incarnation) = (Slot::new(Role::Haptic, index).unwrap(), 10 + index as u32);
        drop(station.create_slot(slot, incarnation).unwrap());
        let service = links.create_service(Role::Haptic, incarnation, Kind::Force).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_haptic"))
            .args(["--station", station.name(), "--slot", &slot.to_string(), "--incarnation", &incarnation.to_string()])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        announce(keeping, slot, incarnation);
        Servo { child, page: station.read_slot(slot, incarnation).unwrap(), incarnation, _service: service }
    }

    pub fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }

    /// Stops it and waits until it stands.
    pub fn stop(&self) {
        kill_process(self.pid(), Signal::STOP).unwrap();
        let (_, status) = waitpid(Some(self.pid()), WaitOptions::UNTRACED).unwrap().unwrap();
        assert!(status.stopped(), "the servo ended: {status:?}");
    }

    /// Waits until it has refused so many inputs.
    pub fn has_refused(&self, count: u64) {
        let deadline_ns = system::now_ns() + HANG_NS;
        while self.page.load64(header::INVALID) < count {
            assert!(system::now_ns() < deadline_ns, "it has refused {}", self.page.load64(header::INVALID));
            std::thread::yield_now();
        }
    }

    pub fn go_on(&self) {
        kill_process(self.pid(), Signal::CONT).unwrap();
    }

    /// What its answers went on from, where that was not its own state of the tick before.
    pub fn origins(&self) -> Vec<OriginRecord> {
        (0..self.page.ring_end(haptic::ORIGINS)).filter_map(|count| self.page.ring(haptic::ORIGINS, count)).collect()
    }

    /// Its word of a tick, if it is there.
    pub fn answered(&self, tick: u64) -> Option<ForceRecord> {
        self.page.ring(haptic::FORCES, tick)
    }

    /// Its word of a tick, as soon as it is there.
    pub fn answer(&self, tick: u64) -> ForceRecord {
        let deadline_ns = system::now_ns() + HANG_NS;
        loop {
            let news = self.page.load32(header::NEWS);
            if let Some(record) = self.answered(tick) {
                return record;
            }
            assert!(system::now_ns() < deadline_ns, "no answer for tick {tick}: {}", self.page.last_words());
            self.page.wait(header::NEWS, news, deadline_ns);
        }
    }
}

pub fn announce(keeping: &OwnedPage, slot: Slot, incarnation: u32) {
    keeping.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
    keeping.bump_and_wake(layout::CHANGES);
}

/// A tip that goes in and out of a wall, so that each tick has another force, and energy, damper and proxy depend on all ticks before.
pub fn input(tick: u64, selected: u32) -> InputRecord {
    let in_and_out_m = |tick: u64| 0.001 + 0.0008 * ((tick % 40) as f32 - 20.0).abs() / 20.0;
    let depth_m = |tick: u64| in_and_out_m(tick).min(5e-5 * tick as f32 - 5e-4);
    let plane = ContactPlane { point_m: [0.0; 3], stiffness_n_m: 400.0, normal: [0.0, 0.0, -1.0], damping_n_s_m: 0.5 };
    let mut model = ContactModel { epoch: 1, state_tick: tick, plane_count: 1, ..Default::default() };
    model.planes[0] = plane;
    let mut record = InputRecord {
        tick,
        device_incarnation: DEVICE as u64,
        model,
        selected_incarnation: selected as u64,
        ..Default::default()
    };
    record.applied_n = [0.0, 0.0, -0.5];
    record.sample.hardware_tick = tick;
    record.sample.pose.position_m = [0.0, 0.0, depth_m(tick)];
    record.sample.velocity_m_s = [0.0, 0.0, 1_000.0 * (depth_m(tick) - depth_m(tick - 1))];
    record.on_scope_n = [0.01, -0.02, if (tick / 33).is_multiple_of(2) { 0.03 } else { 0.0 }];
    record
}

pub fn tell(page: &OwnedPage, tick: u64, selected: &Servo) {
    page.write(device::INPUT, &input(tick, selected.incarnation));
    page.bump_and_wake(header::NEWS);
}

/// Ticks that all the given servos answer.
pub fn run(page: &OwnedPage, ticks: std::ops::Range<u64>, selected: &Servo, servos: &[&Servo]) {
    for tick in ticks {
        tell(page, tick, selected);
        for servo in servos {
            servo.answer(tick);
        }
    }
}

pub fn assert_equal(a: &Servo, b: &Servo, tick: u64) {
    let (said, other) = (a.answer(tick), b.answer(tick));
    assert_eq!(said, other, "tick {tick}");
    assert!(said.force_n[2].abs() > 0.1, "in contact: {:?}", said.force_n);
}

/// A station of its own with a device's page: the station's page, the links, the device's page.
pub fn founded(name: &str) -> (Wiped, OwnedPage, Links, OwnedPage) {
    let station = Wiped(Station::named(&format!("t{}-{name}", std::process::id())).unwrap());
    station.0.wipe();
    station.0.found().unwrap();
    std::fs::write(station.0.settings(), "[set]\nrealtime = \"off\"\n").unwrap();
    let keeping = station.0.open_for_keeping().unwrap();
    // The clock is past all ticks that a test tells, however fast.
    keeping.store64(layout::T0_NS, system::now_ns().saturating_sub(HANG_NS));
    let links = Links::join(&station.0, "test").unwrap();
    let slot = Slot::first(Role::Device);
    let page = station.0.create_slot(slot, DEVICE).unwrap();
    announce(&keeping, slot, DEVICE);
    (station, keeping, links, page)
}
