//! The faults of a run: injected ones and those that came from outside, from their injection to their verdict. A closed fault is a line
//! in a file in the station's root, so that it outlives the supervisor.
//!
//! A fault is closed when the hardware's ledger covers its window and a control for it was found.

use crate::active::{ActiveLog, active_now};
use crate::fault::{Fault, bounds, judge, us};
use crate::faultfile::{FaultKind, Injection, Target, Which};
use crate::journal;
use crate::ledger::{Counted, Ledger, control_for};
use crate::policy::Exit;
use crate::view::Viewer;
use hyst_exchange::{Roster, Station, StationError, system};
use hyst_messages::{Role, SLOTS, Slot};
use rustix::process::Signal;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::PathBuf;

/// A fault that has not recovered by then is closed as it is, ns.
const GIVE_UP_NS: u64 = 40_000_000_000;
/// How long a closed window waits for a control after it, ticks.
const CONTROL_WAIT_TICKS: u64 = 3_000;

/// What outlives the supervisor beside the closed faults.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Open {
    injected: usize,
    faults: Vec<Fault>,
    counted: Counted,
}

/// All faults of a station.
#[derive(Debug)]
pub struct Faults {
    station: Station,
    roster: Roster,
    schedule: Vec<Injection>,
    open: Open,
    /// Closed faults.
    pub closed: Vec<Fault>,
    /// The hardware's ledger.
    pub ledger: Ledger,
    active: ActiveLog,
}

fn path(station: &Station, name: &str) -> PathBuf {
    station.root().join(name)
}

impl Faults {
    /// Starts from what a supervisor before this one left.
    pub fn new(station: &Station, schedule: &[Injection]) -> Result<Faults, StationError> {
        let text = std::fs::read_to_string(path(station, "faults.jsonl")).unwrap_or_default();
        let open = std::fs::read_to_string(path(station, "open.json")).unwrap_or_default();
        let open: Open = serde_json::from_str(&open).unwrap_or_default();
        Ok(Faults {
            station: station.clone(),
            roster: Roster::open(station)?,
            schedule: schedule.to_vec(),
            ledger: Ledger::resume(open.counted),
            open,
            closed: text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect(),
            active: ActiveLog::default(),
        })
    }

    /// All faults, closed first.
    pub fn all(&self) -> impl Iterator<Item = &Fault> {
        self.closed.iter().chain(&self.open.faults)
    }

    /// The incarnation that does the role's work, as it was last seen; 0 if none was.
    pub fn active_incarnation(&self, role: Role) -> u32 {
        self.active.active_at(u64::MAX, role)
    }

    /// Leaves the open faults and the ledger's counts for a successor.
    pub fn keep_open(&mut self) {
        self.open.counted = self.ledger.counted();
        if let Ok(text) = serde_json::to_string(&self.open) {
            let _ = crate::plan::write_whole(&path(&self.station, "open.json"), text.as_bytes()); // the fault itself goes on
        }
    }

    fn start(&mut self, kind: &str, slot: Slot, incarnation: u32, injected_ns: u64) -> &mut Fault {
        let tick = self.station.open().map_or(0, |page| page.tick_at(injected_ns));
        let active = match slot.role() {
            Role::Haptic | Role::Tissue | Role::Fluid => self.active.active_at(injected_ns, slot.role()) == incarnation,
            _ => true,
        };
        let index = self.open.faults.len();
        self.open.faults.push(Fault {
            kind: kind.into(),
            target: slot.to_string(),
            active,
            tick,
            injected_ns,
            slot: slot.number(),
            incarnation,
            ..Fault::default()
        });
        &mut self.open.faults[index]
    }

    fn find(&mut self, slot: Slot, incarnation: u32) -> Option<&mut Fault> {
        self.open
            .faults
            .iter_mut()
            .find(|fault| (fault.slot, fault.incarnation, fault.dead) == (slot.number(), incarnation, false))
    }

    /// The process hangs and was killed.
    pub fn late(&mut self, slot: Slot, incarnation: u32, at_ns: u64, beat_ns: u64, detected_by: &str) {
        if self.find(slot, incarnation).is_none() {
            self.start("external", slot, incarnation, if beat_ns == 0 { at_ns } else { beat_ns });
        }
        if let Some(fault) = self.find(slot, incarnation) {
            fault.manifested = true;
            fault.detected_by = detected_by.into();
            fault.detected_us = Some(us(at_ns, fault.injected_ns));
        }
        self.keep_open();
    }

    /// The process died without being asked to.
    pub fn died(&mut self, slot: Slot, incarnation: u32, exit: Exit, at_ns: u64, beat_ns: u64) {
        if self.find(slot, incarnation).is_none() {
            self.start("external", slot, incarnation, if beat_ns == 0 { at_ns } else { beat_ns });
        }
        if let Some(fault) = self.find(slot, incarnation) {
            fault.manifested = true;
            fault.dead = true;
            fault.exit = exit.to_string();
            if fault.detected_us.is_none() {
                fault.detected_by = "pidfd".into();
                fault.detected_us = Some(us(at_ns, fault.injected_ns));
            }
        }
        self.keep_open();
    }

    /// The supervisor before this one died.
    pub fn supervisor_died(&mut self, beat_ns: u64, now_ns: u64) {
        let fault = self.start("external", Slot::first(Role::Supervisor), 0, beat_ns.max(1));
        (fault.manifested, fault.dead, fault.detected_by) = (true, true, "guardian".into());
        fault.detected_us = Some(us(now_ns, beat_ns));
        fault.recovered_us = fault.detected_us;
        self.keep_open();
    }

    /// A successor is warm or live.
    pub fn ready(&mut self, slot: Slot, incarnation: u32, at_ns: u64) {
        for fault in &mut self.open.faults {
            if fault.slot == slot.number() && fault.dead && fault.incarnation < incarnation && fault.recovered_us.is_none() {
                fault.recovered_us = Some(us(at_ns, fault.injected_ns));
            }
        }
        self.keep_open();
    }

    /// Injects a fault now.
    pub fn inject(&mut self, injection: &Injection, viewer: &mut Viewer) -> Result<(), String> {
        let target = injection.check()?;
        let slot = self.resolve(target, viewer).ok_or_else(|| format!("no process answers to {:?} now", injection.target))?;
        let (incarnation, pid) = (viewer.page().incarnation(slot), viewer.page().pid(slot));
        if viewer.page().is_dead(slot) || pid == 0 {
            return Err(format!("{slot} is not alive now; wait until it is back"));
        }
        let signal = match injection.kind {
            FaultKind::Kill => Signal::KILL,
            FaultKind::Stop => Signal::STOP,
            FaultKind::Cont => Signal::CONT,
            FaultKind::Segfault => Signal::SEGV,
            FaultKind::Abort => Signal::ABORT,
        };
        let now_ns = system::now_ns();
        self.note_active(now_ns, viewer);
        if !crate::proc::signal(pid, signal) {
            return Err(format!("{slot} is not alive now; wait until it is back"));
        }
        let fault = self.start(injection.kind.name(), slot, incarnation, now_ns);
        match injection.kind {
            FaultKind::Stop => fault.continue_ns = injection.for_s.map(|for_s| now_ns + (for_s * 1e9) as u64),
            FaultKind::Cont => (fault.manifested, fault.recovered_us) = (true, Some(0.0)),
            _ => {}
        }
        let line = format!("fault {} injected into {slot} (incarnation {incarnation}, pid {pid})", injection.kind.name());
        journal::say(&self.station, &line);
        self.keep_open();
        Ok(())
    }

    fn resolve(&self, target: Target, viewer: &mut Viewer) -> Option<Slot> {
        if let Which::Slot(slot) = target.which {
            return Some(slot);
        }
        let device = viewer.slot_page(Slot::first(Role::Device));
        let active = active_now(&self.station, &self.roster, device, target.role);
        let wanted = |slot: &Slot| (viewer.page().incarnation(*slot) == active) == (target.which == Which::Active);
        let alive = |slot: &Slot| viewer.page().pid(*slot) != 0 && !viewer.page().is_dead(*slot);
        (0..SLOTS).filter_map(Slot::from_number).filter(|slot| slot.role() == target.role).filter(alive).find(wanted)
    }

    fn note_active(&mut self, now_ns: u64, viewer: &mut Viewer) {
        for role in [Role::Haptic, Role::Tissue, Role::Fluid] {
            let device = viewer.slot_page(Slot::first(Role::Device));
            let incarnation = active_now(&self.station, &self.roster, device, role);
            self.active.note(now_ns, role, incarnation);
        }
    }

    /// Injects what is due, continues what was stopped long enough, notes who is active.
    pub fn tend(&mut self, now_ns: u64, viewer: &mut Viewer) {
        self.note_active(now_ns, viewer);
        let tick = viewer.page().tick_at(now_ns);
        while let Some(injection) = self.schedule.get(self.open.injected).filter(|injection| injection.tick <= tick).cloned() {
            self.open.injected += 1;
            if let Err(reason) = self.inject(&injection, viewer) {
                journal::say(&self.station, &format!("fault {} was not injected: {reason}", injection.kind.name()));
            }
        }
        for index in 0..self.open.faults.len() {
            let fault = &mut self.open.faults[index];
            if fault.continue_ns.is_some_and(|continue_ns| continue_ns <= now_ns) {
                fault.continue_ns = None;
                if let Some(slot) = Slot::from_number(fault.slot).filter(|_| !fault.dead) {
                    if viewer.page().incarnation(slot) == fault.incarnation {
                        crate::proc::signal(viewer.page().pid(slot), Signal::CONT);
                    }
                    (fault.manifested, fault.recovered_us) = (true, Some(us(now_ns, fault.injected_ns)));
                }
            }
        }
    }

    /// Reads the hardware's ledger and closes the faults whose windows are complete.
    pub fn read_ledger(&mut self, viewer: &mut Viewer) {
        if let Some(page) = viewer.slot_page(Slot::first(Role::Hardware)) {
            self.ledger.read(page);
        }
        self.close(|fault, newest_tick, has_control| {
            let (_, to_tick) = bounds(fault);
            let over = system::now_ns().saturating_sub(fault.injected_ns) > GIVE_UP_NS;
            let recovered = fault.recovered_us.is_some() && newest_tick >= to_tick;
            over || recovered && (has_control || newest_tick >= to_tick + CONTROL_WAIT_TICKS)
        });
    }

    /// Closes everything as it is, at the end of a run.
    pub fn close_all(&mut self) {
        self.close(|_, _, _| true);
    }

    fn close(&mut self, mut is_due: impl FnMut(&Fault, u64, bool) -> bool) {
        let newest_tick = self.ledger.newest_tick().unwrap_or(0);
        let taken: Vec<(u64, u64)> = self.all().map(bounds).collect();
        let closed_before = self.closed.len();
        let mut still_open = Vec::new();
        for mut fault in std::mem::take(&mut self.open.faults) {
            let (from_tick, to_tick) = bounds(&fault);
            let control = if newest_tick >= to_tick { control_for(&self.ledger, from_tick, to_tick, &taken) } else { None };
            if !is_due(&fault, newest_tick, control.is_some()) {
                still_open.push(fault);
                continue;
            }
            judge(&mut fault, control, &self.ledger, &taken);
            self.append(&fault);
            self.closed.push(fault);
        }
        self.open.faults = still_open;
        if self.closed.len() != closed_before {
            self.keep_open();
        }
    }

    fn append(&self, fault: &Fault) {
        let Ok(line) = serde_json::to_string(fault) else {
            return;
        };
        if let Ok(mut file) = std::fs::OpenOptions::new().append(true).create(true).open(path(&self.station, "faults.jsonl")) {
            let _ = file.write_all(format!("{line}\n").as_bytes()); // a full disk costs the line, not the station
        }
    }
}
