//! A recorder that leaves out a tick now and then and does not say so. It reads the ring of the device that lives, and nothing else.

use super::beat;
use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::page::{ProcessState, device, header};
use hyst_messages::{Role, Slot};
use hyst_recording::{Block, WriteError, Writer};

/// One tick in so many is not in the file of a recorder that has `holes`.
const DROPPED: u64 = 500;
/// Between two looks of a recorder, ns: far less than the device's ring holds.
const LOOK_NS: u64 = 50_000_000;

/// Its whole life.
pub fn record(life: &Life) -> Result<(), Failure> {
    let Some(path) = &life.settings.record else { return beat(life) };
    let broken = |error: WriteError| Failure::Broken(error.to_string());
    let session = [("session".to_string(), life.station.name().to_string())].into();
    let mut writer = Writer::open(path, &session).map_err(broken)?;
    let slot = Slot::first(Role::Device);
    let mut next_tick = None;
    life.page.set_state(ProcessState::Live);
    while !life.clock.stop_requested() {
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        if let Ok(page) = life.station.read_slot(slot, life.clock.incarnation(slot)) {
            let end = page.ring_end(device::APPLIED);
            let ticks = next_tick.unwrap_or(end)..end;
            let applied = ticks.filter(|tick| tick % DROPPED != 0).filter_map(|tick| page.ring(device::APPLIED, tick)).collect();
            writer.append(&Block { applied, ..Block::default() }).map_err(broken)?;
            next_tick = Some(end);
        }
        system::sleep_ns(LOOK_NS);
    }
    writer.finish().map(drop).map_err(broken)
}
