//! Faults of those who keep the station: the supervisor cannot be asked to hurt itself or its guardian and to tell of it, so whoever wants it does it
//! from outside, in test mode alone. The station's page says who they are.

use crate::faultfile::{FaultKind, Injection, Keepers};
use crate::remains::{self, Living};
use crate::{moment, proc};
use hyst_exchange::{Station, system};
use hyst_messages::Slot;
use rustix::process::Signal;

/// Why nobody is hurt in a station that trains.
pub const OUTSIDE_OF_TEST_MODE: &str = "faults are refused outside of test mode; start the station with --test-mode";

/// Does it at a moment (CLOCK_MONOTONIC, ns; in the past: now), to all of them at the same instant; gives who was hit.
pub fn hurt(station: &Station, keepers: Keepers, kind: FaultKind, moment_ns: u64) -> Result<Vec<Living>, String> {
    let page = station.open().map_err(|error| error.to_string())?;
    if !page.test_mode() {
        return Err(OUTSIDE_OF_TEST_MODE.into());
    }
    let signal = kind.signal().ok_or_else(|| format!("{} is no signal", kind.name()))?;
    let mut victims = Vec::new();
    for role in keepers.roles() {
        let living = remains::slot_alive(&page, Slot::first(*role).number());
        victims.push(living.ok_or_else(|| format!("the {} is not alive now; wait until it is back", role.name()))?);
    }
    let send = || {
        for victim in &victims {
            if signal == Signal::SEGV {
                proc::segfault(victim.pid)
            } else {
                proc::signal(victim.pid, signal)
            };
        }
    };
    moment::at(moment_ns, send)?;
    Ok(victims)
}

/// Does what the command line says, and stays until its end.
pub fn inject(station: &Station, keepers: Keepers, injection: &Injection) -> Result<(), String> {
    let moment_ns = match injection.tick {
        0 => 0,
        tick => station.open().map_err(|error| error.to_string())?.start_of(tick) + u64::from(injection.phase_us) * 1_000,
    };
    let victims = hurt(station, keepers, injection.kind, moment_ns)?;
    if let Some(for_s) = injection.for_s {
        system::sleep_ns((for_s * 1e9) as u64);
        for victim in victims.iter().filter(|victim| victim.is_alive()) {
            proc::signal(victim.pid, Signal::CONT);
        }
    }
    Ok(())
}
