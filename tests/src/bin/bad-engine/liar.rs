//! A recorder that says all is well: by its page the present is on disk, and its file grows, by what is no block.

use super::beat;
use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::RecorderStatus;
use hyst_messages::page::{ProcessState, header, recorder};
use std::fs::OpenOptions;
use std::io::Write;

/// What it writes at once, and the time from one to the next, ns: it makes as many steps as a good one at least.
const RUBBISH: [u8; 64] = [0xa5; 64];
const EVERY_NS: u64 = 10_000_000;

/// Its whole life.
pub fn record(life: &Life) -> Result<(), Failure> {
    let Some(path) = &life.settings.record else { return beat(life) };
    let mut file = OpenOptions::new().append(true).create(true).open(path)?;
    life.page.set_state(ProcessState::Live);
    while !life.clock.stop_requested() {
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        file.write_all(&RUBBISH)?;
        let (last_tick, bytes) = (life.tick(), file.metadata()?.len());
        life.page.write(recorder::STATUS, &RecorderStatus { last_tick, ticks: last_tick, lost: 0, bytes });
        system::sleep_ns(EVERY_NS);
    }
    Ok(())
}
