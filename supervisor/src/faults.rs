//! The faults of a run: injected ones and those that came from outside, from their injection to their verdict. A closed fault is a line
//! in a file in the station's root, so that it outlives the supervisor; so is a swap that was asked for.
//!
//! A fault is closed when the hardware's ledger covers its window and a control for it was found.

mod asked;
mod control;
mod inject;
mod over;
mod swaps;
mod tend;
#[cfg(test)]
pub(crate) mod tests;

use crate::active::ActiveLog;
use crate::fault::{Death, EXTERNAL, Fault, Seen, bounds, finder, judge, look, reach};
use crate::faultfile::{FaultKind, Injection};
use crate::ledger::{Counted, HISTORY_TICKS, Ledger};
use crate::policy::Exit;
use crate::view::Viewer;
use crate::{corrupt, mischief, shortage};
use control::Search;
use hyst_exchange::{OwnedPage, Roster, Station, StationError, StationPage, system, whole};
use hyst_messages::{Role, Slot, TICK_NS};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;

/// A fault that has not recovered so long after it, or after the end of what was asked for, is closed as it is, ns.
const GIVE_UP_NS: u64 = 40_000_000_000;
/// The same for one that makes a successor hang in its start: an ordinary process has 180 s for that.
const GIVE_UP_START_NS: u64 = 240_000_000_000;
/// Faults of the schedule that did not come about and are named.
const MOST_NAMED: usize = 100;

/// A fault of the schedule that did not come about, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NotInjected {
    kind: String,
    target: String,
    /// Station tick for which it was asked.
    tick: u64,
    reason: String,
}

impl NotInjected {
    fn of(injection: &Injection, reason: &str) -> NotInjected {
        let Injection { kind, target, tick, .. } = injection;
        NotInjected { kind: kind.name().into(), target: target.clone(), tick: *tick, reason: reason.into() }
    }
}

/// What outlives the supervisor beside the closed faults.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)] // a station may have been founded by an older build
struct Open {
    injected: usize,
    /// How many of the schedule were refused, and the first of them.
    refused: (usize, Vec<NotInjected>),
    faults: Vec<Fault>,
    counted: Counted,
    swaps: Vec<swaps::Swap>,
}

/// All faults of a station.
#[derive(Debug)]
pub struct Faults {
    station: Station,
    page: OwnedPage,
    roster: Roster,
    schedule: Vec<Injection>,
    /// The places of the station, by which it is known whether it is whole.
    slots: Vec<Slot>,
    open: Open,
    /// Closed faults.
    pub closed: Vec<Fault>,
    /// Swaps that were asked for.
    asked: asked::Swaps,
    /// The hardware's ledger.
    pub ledger: Ledger,
    active: ActiveLog,
    /// Since when somebody is suspected to hang.
    suspects: BTreeMap<(usize, u32), u64>,
    /// When somebody could last not be started for want of a file descriptor of the supervisor's, ns.
    without_file_ns: Option<u64>,
}

/// When a fault from outside began: at its victim's last heartbeat. One that never beat, or whose page says what cannot be, is no older than what the
/// ledger can tell of it.
fn begin_ns(beat_ns: u64, seen_ns: u64) -> u64 {
    let oldest_ns = seen_ns.saturating_sub(HISTORY_TICKS as u64 * TICK_NS);
    if beat_ns == 0 { seen_ns } else { beat_ns.clamp(oldest_ns, seen_ns) }
}

/// Whether a fault has had the time within which it is to recover.
fn has_had_its_time(fault: &Fault, now_ns: u64) -> bool {
    let give_up_ns = if fault.is(FaultKind::HangStart) { GIVE_UP_START_NS } else { GIVE_UP_NS };
    let until_ns = fault.asked.map_or(0, |(until_ns, _)| until_ns);
    now_ns.saturating_sub(fault.injected_ns.max(until_ns)) > give_up_ns
}

fn path(station: &Station, name: &str) -> PathBuf {
    station.root().join(name)
}

/// What the lines of a file say; one that is none says nothing.
fn lines<T: DeserializeOwned>(station: &Station, name: &str) -> Vec<T> {
    let text = std::fs::read_to_string(path(station, name)).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

impl Faults {
    /// Starts from what a supervisor before this one left.
    pub fn new(station: &Station, schedule: &[Injection]) -> Result<Faults, StationError> {
        let open = std::fs::read_to_string(path(station, "open.json")).unwrap_or_default();
        let open: Open = serde_json::from_str(&open).unwrap_or_default();
        shortage::relieve_all(station, |kind| open.faults.iter().any(|fault| fault.is(kind)));
        Ok(Faults {
            station: station.clone(),
            page: station.open_for_keeping()?,
            roster: Roster::open(station)?,
            schedule: schedule.to_vec(),
            slots: Vec::new(),
            ledger: Ledger::resume(open.counted),
            open,
            closed: lines(station, "faults.jsonl"),
            asked: asked::Swaps::read(station),
            active: ActiveLog::default(),
            suspects: BTreeMap::new(),
            without_file_ns: None,
        })
    }

    /// The same in a station that has these slots.
    pub fn among(self, slots: Vec<Slot>) -> Faults {
        Faults { slots, ..self }
    }

    /// All faults, closed first.
    pub fn all(&self) -> impl Iterator<Item = &Fault> {
        self.closed.iter().chain(&self.open.faults)
    }

    /// The faults of the schedule that did not come about so far, those that were refused and those whose tick has not come: their number, and the
    /// first of them.
    pub fn not_injected(&self) -> (usize, Vec<NotInjected>) {
        let (refused, first) = &self.open.refused;
        let later = self.schedule.iter().skip(self.open.injected);
        let of_later = later.clone().map(|injection| NotInjected::of(injection, "its tick did not come"));
        (refused + later.count(), first.iter().cloned().chain(of_later).take(MOST_NAMED).collect())
    }

    fn refuse(&mut self, injection: &Injection, reason: &str) {
        let (count, first) = &mut self.open.refused;
        *count += 1;
        if first.len() < MOST_NAMED {
            first.push(NotInjected::of(injection, reason));
        }
    }

    /// Whether the death of an incarnation is known.
    pub fn knows_dead(&self, slot: Slot, incarnation: u32) -> bool {
        self.all().any(|fault| (fault.slot, fault.incarnation, fault.dead) == (slot.number(), incarnation, true))
    }

    /// The incarnation that does the role's work, as it was last seen; 0 if none was.
    pub fn active_incarnation(&self, role: Role) -> u32 {
        self.active.active_at(u64::MAX, role)
    }

    /// Leaves the open faults and the ledger's counts for a successor.
    pub fn keep_open(&mut self) {
        self.open.counted = self.ledger.counted();
        if let Ok(text) = serde_json::to_string(&self.open) {
            let _ = whole::write(&path(&self.station, "open.json"), text.as_bytes()); // the fault itself goes on
        }
    }

    /// The station's tick at a time that has been.
    fn tick_at(&self, ns: u64) -> u64 {
        let tick_of = |page: StationPage| if page.is_lockstep() { page.present_tick() } else { page.tick_at(ns) };
        self.station.open().map_or(0, tick_of)
    }

    /// Whether nothing takes as long as it does: no process is awaited by its time then.
    fn is_on_a_virtual_clock(&self) -> bool {
        self.station.open().is_ok_and(|page| page.is_lockstep())
    }

    fn start(&mut self, kind: &str, slot: Slot, incarnation: u32, injected_ns: u64) -> &mut Fault {
        let tick = self.tick_at(injected_ns);
        let role = slot.role();
        let active = !role.is_replicated() || self.active.active_at(injected_ns, role) == incarnation;
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
        // The newest that is not over: one that went by is not what the process dies of.
        let of = |fault: &&mut Fault| (fault.slot, fault.incarnation, fault.dead) == (slot.number(), incarnation, false);
        self.open.faults.iter_mut().rev().filter(of).find(|fault| fault.recovered_us.is_none())
    }

    /// The fault in whose course this incarnation does not start: one that hinders the successors of its victim.
    fn cause(&mut self, slot: Slot, incarnation: u32) -> Option<&mut Fault> {
        let hinders = |fault: &&mut Fault| fault.starts_left.is_some_and(|left| left > 0) && fault.recovered_us.is_none();
        let of_slot = |fault: &&mut Fault| fault.slot == slot.number() && fault.dead && fault.incarnation < incarnation;
        self.open.faults.iter_mut().filter(of_slot).find(hinders)
    }

    /// The process has missed three periods. What was done to it on purpose is found by that, unless it lies, goes on without a helper, or was hurt from outside:
    /// who is late is not known for that. Of others it is said once they are guilty.
    pub fn suspected(&mut self, slot: Slot, incarnation: u32, at_ns: u64) {
        self.suspects.insert((slot.number(), incarnation), at_ns);
        let is_found = |fault: &&mut Fault| {
            fault.detected_us.is_none() && fault.thread.is_none() && mischief::is_found_by_lateness(&fault.kind)
        };
        if let Some(fault) = self.find(slot, incarnation).filter(is_found) {
            fault.manifested = true;
            fault.found_by(finder::HEARTBEAT, at_ns);
            self.keep_open();
        }
    }

    /// A suspect beats again.
    pub fn cleared(&mut self, slot: Slot, incarnation: u32) {
        self.suspects.remove(&(slot.number(), incarnation));
    }

    /// The process hangs and was killed.
    pub fn late(&mut self, slot: Slot, incarnation: u32, at_ns: u64, beat_ns: u64, detected_by: &str) {
        if let Some(fault) = self.cause(slot, incarnation) {
            fault.manifested = true;
            fault.found_by(detected_by, at_ns);
            return self.keep_open();
        }
        if self.find(slot, incarnation).is_none() {
            self.start(EXTERNAL, slot, incarnation, begin_ns(beat_ns, at_ns));
        }
        let suspected_ns = self.suspects.remove(&(slot.number(), incarnation));
        if let Some(fault) = self.find(slot, incarnation) {
            let is_silent = fault.thread.is_none() && mischief::is_found_by_lateness(&fault.kind);
            let seen_ns = suspected_ns.filter(|_| is_silent).unwrap_or(at_ns);
            fault.manifested = true;
            // It does not end by itself any more: a successor ends it.
            fault.asked = fault.asked.map(|(_, done)| (0, done));
            if fault.detected_us.is_none() {
                fault.found_by(detected_by, seen_ns);
            }
        }
        self.keep_open();
    }

    /// The process died without being asked to.
    pub fn died(&mut self, slot: Slot, incarnation: u32, exit: Exit, death: Death) {
        let Death { open_ns, beat_ns, .. } = death;
        let (by, at_ns) = open_ns.map_or((finder::PIDFD, death.at_ns), |open_ns| (finder::LATCH, open_ns));
        if let Some(fault) = self.cause(slot, incarnation) {
            fault.manifested = true;
            if fault.detected_us.is_none() {
                fault.found_by(by, at_ns);
            }
            fault.starts_left = fault.starts_left.map(|left| left - 1);
            let (kind, is_last) = (fault.kind.clone(), fault.starts_left == Some(0));
            if is_last {
                mischief::end(&self.page, slot);
            }
            return self.end_with(slot, incarnation, exit, at_ns, &kind);
        }
        let is_known = |fault: &&mut Fault| (fault.slot, fault.incarnation, fault.dead) == (slot.number(), incarnation, true);
        if let Some(fault) = self.open.faults.iter_mut().find(is_known) {
            fault.exit = exit.to_string(); // a newcomer's swap was undone for its death, which is told of after that
            let kind = fault.kind.clone();
            return self.end_with(slot, incarnation, exit, at_ns, &kind);
        }
        if self.find(slot, incarnation).is_none() {
            self.find_by_death(slot, exit, at_ns);
            self.start(EXTERNAL, slot, incarnation, begin_ns(beat_ns, at_ns));
        }
        self.suspects.remove(&(slot.number(), incarnation));
        let mut of = String::new();
        if let Some(fault) = self.find(slot, incarnation) {
            of.clone_from(&fault.kind);
            fault.dead = true;
            fault.exit = exit.to_string();
            // That it was killed is only the beginning of a fault that hinders its successors.
            let is_it = fault.starts_left.is_none();
            fault.manifested |= is_it;
            if fault.detected_us.is_none() && is_it {
                fault.found_by(by, at_ns);
            }
        }
        self.end_with(slot, incarnation, exit, at_ns, &of);
    }

    /// Reads the hardware's ledger and closes the faults whose windows are complete.
    pub fn read_ledger(&mut self, viewer: &mut Viewer) {
        if let Some(page) = viewer.slot_page(Slot::first(Role::Hardware)) {
            self.ledger.read(page);
        }
        self.close(false, |fault, is_through, has_waited| {
            has_had_its_time(fault, system::now_ns()) || fault.recovered_us.is_some() && is_through && has_waited
        });
    }

    /// Closes everything as it is, at the end of a run.
    pub fn close_all(&mut self) {
        self.close(true, |_, _, _| true);
    }

    /// Closes those that are due, by whether the window is over, and whether there is a control of its own or none is waited for; one for whose line there
    /// is no room now is closed later, unless this is the end.
    fn close(&mut self, is_end: bool, mut is_due: impl FnMut(&Fault, bool, bool) -> bool) {
        let newest_tick = self.ledger.newest_tick().unwrap_or(0);
        let swaps = self.swaps(newest_tick);
        let open = self.open.faults.iter().map(|fault| reach(fault, newest_tick));
        let taken: Vec<(u64, u64)> = self.closed.iter().map(bounds).chain(open).chain(swaps.iter().copied()).collect();
        let used = |fault: &Fault| fault.control.map(|control| (control.from_tick, control.to_tick));
        let mut spent: Vec<(u64, u64)> = self.closed.iter().filter_map(used).collect();
        let mut has_news = false;
        let mut still_open = Vec::new();
        for mut fault in std::mem::take(&mut self.open.faults) {
            let window = bounds(&fault);
            let whole = swaps::around(window, &swaps);
            if fault.seen.is_none() && newest_tick >= window.1 && fault.recovered_us.is_some() {
                fault.seen = look(&fault, &self.ledger, &taken);
                has_news = true;
            }
            let contact = fault.seen.as_ref().map_or_else(|| self.ledger.in_contact(window.0), Seen::contact);
            let search = Search { ledger: &self.ledger, hurt: &taken, window, whole, contact };
            let own = search.own(&spent);
            if !is_due(&fault, search.is_over(), own.is_some() || search.has_waited()) {
                still_open.push(fault);
                continue;
            }
            let control = own.or_else(|| search.any(&spent, &mut fault));
            fault.aftermath = search.aftermath();
            if let Some((ballast, _)) = fault.ballast.take() {
                shortage::relieve(&ballast);
            }
            if fault.starts_left.is_some_and(|left| left > 0)
                && let Some(slot) = Slot::from_number(fault.slot)
            {
                mischief::end(&self.page, slot);
            }
            if !fault.flips.is_empty() {
                fault.remains = Some(corrupt::remains(&std::mem::take(&mut fault.flips)));
            }
            spent.extend(control.map(|control| (control.from_tick, control.to_tick)));
            let is_late = fault.recovered_us.is_none() && has_had_its_time(&fault, system::now_ns());
            fault.overdue = is_late && !self.is_on_a_virtual_clock();
            let seen = fault.seen.take().or_else(|| look(&fault, &self.ledger, &taken));
            if let Some(seen) = seen.clone() {
                judge(&mut fault, seen, control);
            }
            if fault.is_not_back() {
                fault.promise_held = Some(false); // whatever the ledger still knows
            }
            if self.append("faults.jsonl", &fault).is_err() && !is_end {
                still_open.push(Fault { seen, ..fault });
                continue;
            }
            self.closed.push(fault);
            has_news = true;
        }
        self.open.faults = still_open;
        if has_news {
            self.keep_open();
        }
    }

    /// Writes a line of a file, of a closed fault or a swap, or none of it.
    fn append(&self, name: &str, of: &impl Serialize) -> std::io::Result<()> {
        let line = serde_json::to_string(of)?;
        let mut file = std::fs::OpenOptions::new().append(true).create(true).open(path(&self.station, name))?;
        let length = file.metadata()?.len();
        let written = file.write_all(format!("{line}\n").as_bytes());
        written.inspect_err(|_| drop(file.set_len(length)))
    }
}
