//! Recorders whose ticks are as the device made them, and which spoil a recording all the same: one forgets what the one before it wrote beside them, one does
//! not fetch what was made before it was there, and one begins the file anew.

use super::beat;
use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::page::{ProcessState, device, header, recorder};
use hyst_messages::{RecorderStatus, Role, Slot};
use hyst_recording::{Block, TickRange, WriteError, Writer};
use std::fs::File;

/// How long it takes its time before it opens the file, ns: what lies between is no matter of a moment then.
const LATE_NS: u64 = 500_000_000;
/// Between two steps, ns, of which it makes no fewer than a good one; and steps from one block to the next.
const STEP_NS: u64 = 10_000_000;
const STEPS: u64 = 20;

/// Its whole life.
pub fn record(life: &Life, kind: &str) -> Result<(), Failure> {
    let Some(path) = &life.settings.record else { return beat(life) };
    let broken = |error: WriteError| Failure::Broken(error.to_string());
    for _ in 0..LATE_NS / STEP_NS {
        life.heartbeat();
        system::sleep_ns(STEP_NS);
    }
    if kind == "anew" {
        File::create(path)?;
    }
    // The file of one that it goes on in has the rest.
    let session = [("session".to_string(), format!("{}-{}", life.station.name(), life.clock.t0_ns()))].into();
    let mut writer = Writer::open(path, &session).map_err(broken)?;
    let mut next_tick = if kind == "forgets" { writer.last_tick().map(|tick| tick + 1) } else { None };
    life.page.set_state(ProcessState::Live);
    for step in 0u64.. {
        if life.clock.stop_requested() {
            break;
        }
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        if step.is_multiple_of(STEPS) {
            append(life, &mut writer, &mut next_tick).map_err(broken)?;
        }
        system::sleep_ns(STEP_NS);
    }
    writer.finish().map(drop).map_err(broken)
}

/// Writes what the device has made since, and which ticks it has not, and says so.
fn append(life: &Life, writer: &mut Writer, next_tick: &mut Option<u64>) -> Result<(), WriteError> {
    let slot = Slot::first(Role::Device);
    if let Ok(page) = life.station.read_slot(slot, life.clock.incarnation(slot)) {
        let end = page.ring_end(device::APPLIED);
        let first = next_tick.unwrap_or(end);
        let (mut applied, mut unmade) = (Vec::new(), Vec::new());
        for tick in first..end {
            match page.ring(device::APPLIED, tick) {
                Some(record) => applied.push(record),
                None => TickRange::extend(&mut unmade, tick),
            }
        }
        writer.append(&Block { applied, unmade, ..Block::default() })?;
        *next_tick = Some(first.max(end));
    }
    let (last_tick, ticks) = (writer.last_tick().unwrap_or(0), writer.ticks());
    life.page.write(recorder::STATUS, &RecorderStatus { last_tick, ticks, lost: writer.lost(), bytes: writer.bytes() });
    Ok(())
}
