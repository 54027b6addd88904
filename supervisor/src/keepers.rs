//! Faults of those who keep the station: the supervisor cannot be asked to hurt itself or its guardian and to tell of it, so whoever wants it does it
//! from outside, in test mode alone: a signal, or a limit that is lowered. The station's page says who they are.
//!
//! A death is told of by whoever replaces the dead. What lasted for a time, and was outlived, nobody else knows of: whoever did it tells the supervisor.
//! Nobody else would end it, either: whoever did it and is interrupted (Ctrl-C, SIGTERM, SIGHUP) ends it first.

use crate::control::{self, NoAnswer, Request};
use crate::doing::Doing;
use crate::faultfile::{FaultKind, Injection, Keepers};
use crate::remains::{self, Living};
use crate::shortage::{self, Lowered};
use crate::struck::{Hit, Struck};
use crate::{interrupt, moment, proc};
use hyst_exchange::{Station, system};
use hyst_messages::{Role, Slot};
use rustix::process::Signal;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two looks whether whoever waits for the end was interrupted, ns: nobody who presses Ctrl-C feels that.
const LOOK_NS: u64 = 20_000_000;

/// Why nobody is hurt in a station that trains.
pub const OUTSIDE_OF_TEST_MODE: &str = "faults are refused outside of test mode; start the station with --test-mode";

/// What was done to a keeper for a time, and outlived.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suffered {
    /// What.
    pub kind: FaultKind,
    /// Who.
    pub keepers: Keepers,
    /// From when on, ns.
    pub since_ns: u64,
    /// Until when, ns.
    pub until_ns: u64,
}

/// What was done to some of them.
#[derive(Debug)]
pub struct Hurt {
    kind: FaultKind,
    keepers: Keepers,
    /// When, ns.
    pub struck_ns: u64,
    hit: Vec<(Living, Option<Lowered>)>,
}

impl Hurt {
    /// Does it at a moment (CLOCK_MONOTONIC, ns; in the past: now), to all of them at the same instant.
    pub fn at(station: &Station, keepers: Keepers, kind: FaultKind, moment_ns: u64) -> Result<Hurt, String> {
        let page = station.open().map_err(|error| error.to_string())?;
        if !page.test_mode() {
            return Err(OUTSIDE_OF_TEST_MODE.into());
        }
        let mut victims = Vec::new();
        for role in keepers.roles() {
            let living = remains::slot_alive(&page, Slot::first(*role).number());
            victims.push(living.ok_or_else(|| format!("the {} is not alive now; wait until it is back", role.name()))?);
        }
        let goes_on = |victim: &&Living| kind == FaultKind::Cont && !remains::is_stopped(victim.pid);
        if let Some(victim) = victims.iter().find(goes_on) {
            return Err(format!("the {} is not stopped, and there is nothing to continue", victim.name));
        }
        let send = || victims.iter().map(|victim| strike(victim.pid, kind)).collect::<Vec<_>>();
        let (struck_ns, lowered) = moment::at(moment_ns, send)?;
        let refused = lowered.iter().find_map(|done| done.clone().err());
        let hit = victims.into_iter().zip(lowered.into_iter().map(|lowered| lowered.ok().flatten())).collect();
        let hurt = Hurt { kind, keepers, struck_ns, hit };
        match refused {
            Some(reason) => {
                hurt.release();
                Err(reason)
            }
            None => Ok(hurt),
        }
    }

    /// Whether all of them are still there.
    pub fn is_outlived(&self) -> bool {
        self.hit.iter().all(|(victim, _)| victim.is_alive())
    }

    /// Waits for so many seconds, or until the caller is interrupted, ends it, and tells the supervisor of it where all outlived it. Says whether it
    /// lasted for so long.
    pub fn last_for(&self, station: &Station, for_s: f64, interrupted: &AtomicBool) -> Result<bool, String> {
        let end_ns = self.struck_ns + (for_s * 1e9) as u64;
        while system::now_ns() < end_ns && !interrupted.load(Ordering::Relaxed) {
            system::sleep_until_ns(end_ns.min(system::now_ns() + LOOK_NS));
        }
        let until_ns = system::now_ns();
        self.release();
        if self.is_outlived() {
            let suffered = Suffered { kind: self.kind, keepers: self.keepers, since_ns: self.struck_ns, until_ns };
            control::ask(station, &Request::Suffered(suffered))?;
        }
        Ok(until_ns >= end_ns)
    }

    /// Those who were stopped go on, and limits are put back.
    fn release(&self) {
        for (victim, lowered) in self.hit.iter().filter(|(victim, _)| victim.is_alive()) {
            match lowered {
                Some(lowered) => shortage::restore(victim.pid, *lowered),
                None => drop(proc::signal(victim.pid, Signal::CONT)),
            }
        }
    }
}

/// Does it to one of them.
fn strike(pid: u32, kind: FaultKind) -> Result<Option<Lowered>, String> {
    match kind.signal() {
        Some(Signal::SEGV) => drop(proc::segfault(pid)),
        Some(signal) => drop(proc::signal(pid, signal)),
        None => return shortage::lower(pid, kind).map(Some),
    }
    Ok(None)
}

/// Does what the command line says, and stays until its end. Says what was done, and whether it lasted as long as it was asked for: false where the command was
/// interrupted.
pub fn inject(station: &Station, keepers: Keepers, injection: &Injection) -> Result<(Struck, bool), NoAnswer> {
    // Before anybody is hurt: a signal that comes just after that must not end this process first.
    let interrupted = interrupt::noticed().map_err(NoAnswer::Refused)?;
    let (hurt, struck) = strike_at(station, keepers, injection).map_err(NoAnswer::Refused)?;
    let lasted = injection.for_s.map_or(Ok(true), |for_s| hurt.last_for(station, for_s, &interrupted));
    let has_lasted =
        lasted.map_err(|reason| NoAnswer::Unanswered(format!("it was done and has ended, and the report lacks it: {reason}")))?;
    Ok((struck, has_lasted))
}

/// Does it at its tick.
fn strike_at(station: &Station, keepers: Keepers, injection: &Injection) -> Result<(Hurt, Struck), String> {
    let page = station.open().map_err(|error| error.to_string())?;
    let moment_ns = match injection.tick {
        0 => 0,
        tick => page.start_of(tick).saturating_add(u64::from(injection.phase_us) * 1_000),
    };
    let hurt = Hurt::at(station, keepers, injection.kind, moment_ns)?;
    let hit = |(role, (victim, _)): (&Role, &(Living, _))| Hit { process: role.name().into(), incarnation: 0, pid: victim.pid };
    let victims = keepers.roles().iter().zip(&hurt.hit).map(hit).collect();
    let struck = Struck { doing: Doing::now(station), ..Struck::at(&page, hurt.struck_ns, victims) };
    Ok((hurt, struck))
}
