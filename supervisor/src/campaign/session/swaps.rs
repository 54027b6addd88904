//! A swap that is under way when a fault comes: begun by the campaign as by a user, to a copy of the role's own engine, and hurt at a drawn place of it. Whether it
//! succeeds is the swap's affair; that it ends is a promise. How far it is, is said by its record, and after its probation by the roster and the places.

use super::{AHEAD_TICKS, EARLY_TICKS, QUIET_TICKS, Session, Trouble};
use crate::campaign::cell::Cell;
use crate::campaign::draw::Entry;
use crate::campaign::outcome::{Ending, Outcome, SwapSeen};
use crate::campaign::stage::{Place, Stage};
use crate::commands;
use crate::plan::Plan;
use crate::swap::{Record, Step, kept};
use hyst_exchange::{Station, system};
use hyst_messages::{Role, Slot, TICK_NS};
use std::path::PathBuf;

/// How long a swap may take to come to a stage, ns: a newcomer starts within 30 s, is compared for 1 s, is on probation for up to 4 s, and two others start.
const STAGE_NS: u64 = 60_000_000_000;
/// How much longer than until the tick it is waited for one, ns.
const SPARE_NS: u64 = 1_000_000_000;
/// How long it may take to end: what each of its stages may take at most (`policy::swap`), and the restart of each slot.
const END_NS: u64 = 180_000_000_000;

impl Session {
    /// Begins the swap that a cell has beside its fault, and gives the fault's tick; `None` without such a swap. The text says why it did not begin.
    pub(super) fn swap_beside(
        &mut self,
        entry: &Entry,
        cell: &Cell,
        outcome: &mut Outcome,
    ) -> Result<Result<Option<u64>, String>, Trouble> {
        let Some((role, place)) = cell.swap.zip(entry.in_swap) else { return Ok(Ok(None)) };
        let begun_ns = system::now_ns();
        let begun = self.begin_swap(role, place.stage)?;
        let since = begun.as_ref().ok().copied().flatten().map(|tick| (place.stage, tick));
        outcome.swap = Some(SwapSeen { role: role.name().into(), begun_ns, since, ..SwapSeen::default() });
        match begun {
            Ok(since_tick) => self.tick_after(since_tick.unwrap_or_else(|| self.tick()), place).map(|tick| Ok(Some(tick))),
            Err(reason) => Ok(Err(reason)),
        }
    }

    /// Waits until a fault may be asked for so long after a tick; gives its tick, or 0 for one that is nearer than it can be asked for: it comes at once.
    fn tick_after(&mut self, since_tick: u64, place: Place) -> Result<u64, Trouble> {
        let tick = since_tick + place.offset_ticks;
        let until_ns = place.offset_ticks * TICK_NS + SPARE_NS;
        self.wait(until_ns, |session| (session.tick() + AHEAD_TICKS + EARLY_TICKS >= tick).then_some(()))?;
        Ok(if tick < self.tick() + AHEAD_TICKS { 0 } else { tick })
    }

    /// Waits for the end of the swap, if there is one; one that does not end is no verdict, but a broken promise.
    pub(super) fn see_swap_end(&mut self, outcome: &mut Outcome, cell: &Cell) -> Result<(), Trouble> {
        if cell.swap.is_none() {
            return Ok(());
        }
        let at_ns = outcome.fault.as_ref().map_or(0, |fault| fault.injected_ns);
        match self.end_swap()? {
            Some(record) => {
                let since = outcome.swap.as_ref().and_then(|swap| swap.since);
                let swap = SwapSeen { since, ..seen(&record, at_ns) };
                self.be_quiet_after_swap(&swap);
                outcome.swap = Some(swap);
            }
            None => (outcome.ending, outcome.reason) = (Ending::Open, "the swap does not end".into()),
        }
        Ok(())
    }

    /// The next fault, or its swap, finds room for its control after the end of this swap: in none may one lie.
    fn be_quiet_after_swap(&mut self, swap: &SwapSeen) {
        let end_tick = self.viewer.as_ref().zip(swap.ended_ns).map_or(0, |(viewer, ended_ns)| viewer.page().tick_at(ended_ns));
        self.quiet_from_tick = self.quiet_from_tick.max(end_tick + QUIET_TICKS);
    }

    /// Asks for a swap of a role and waits until it has come to a stage; gives in which tick that was seen, `None` if it ended before. The text says why it
    /// did not begin.
    fn begin_swap(&mut self, role: Role, stage: Stage) -> Result<Result<Option<u64>, String>, Trouble> {
        let before = self.places(role);
        let begin =
            |binary: PathBuf| commands::swap::begin(&self.station, role.name(), &binary).map_err(|refusal| refusal.message);
        let number = match own_engine(&self.station, role).and_then(begin) {
            Ok(number) => number,
            Err(reason) => return Ok(Err(reason)),
        };
        let found = self.wait(STAGE_NS, |session| {
            let record = Record::read(&session.station).filter(|record| record.number == number)?;
            let is_there = session.has_come_to(stage, &record, role, &before);
            (is_there || record.promoted.is_some()).then(|| is_there.then(|| session.tick()))
        })?;
        Ok(Ok(found.flatten()))
    }

    /// The places of a role but the guest's, with their incarnations.
    fn places(&self, role: Role) -> Vec<(Slot, u32)> {
        let Some(viewer) = &self.viewer else { return Vec::new() };
        let of_role = self.slots.iter().filter(|slot| slot.role() == role);
        of_role.map(|slot| (*slot, viewer.page().incarnation(*slot))).collect()
    }

    /// Whether a swap has come to a stage; `before` is who was in the role's places when it was asked for.
    fn has_come_to(&mut self, stage: Stage, record: &Record, role: Role, before: &[(Slot, u32)]) -> bool {
        let Some(viewer) = &mut self.viewer else { return false };
        let newcomer = record.incarnation;
        let settled =
            before.iter().filter(|(slot, old)| viewer.page().incarnation(*slot) != *old && viewer.is_well(*slot)).count();
        let holds = newcomer != 0 && viewer.holder(role) == newcomer;
        match stage {
            Stage::Asked => true,
            Stage::Ready => newcomer != 0,
            Stage::Agreed => record.steps.len() > 2, // asked for, ready, agreed
            Stage::Holds => holds,
            Stage::Proven => record.proven,
            Stage::Settling => record.proven && settled > 0,
            Stage::Settled => record.proven && settled == before.len(),
            Stage::Returned => record.proven && settled == before.len() && !holds,
        }
    }

    /// Waits for the end of the swap; `None` if it does not end.
    fn end_swap(&mut self) -> Result<Option<Record>, Trouble> {
        self.wait(END_NS, |session| Record::read(&session.station).filter(|record| record.promoted.is_some()))
    }
}

/// The engine of a role as its arm has it, whichever copy of it the station runs: the swap takes a copy of its own, as a user's does.
fn own_engine(station: &Station, role: Role) -> Result<PathBuf, String> {
    let plan = Plan::read(station).map_err(|error| error.to_string())?;
    Ok(kept::name_of(&plan.binary(role)))
}

/// What is kept of a swap that has ended, and how far it was at a time.
fn seen(record: &Record, at_ns: u64) -> SwapSeen {
    let ns = |step: &Step| record.begun_ns + (step.at_ms * 1e6) as u64;
    let stage = record.steps.iter().rev().find(|step| ns(step) <= at_ns).map_or(String::new(), |step| step.what.clone());
    let end = if record.promoted == Some(true) {
        "the swap was done".into()
    } else {
        format!("the swap was undone: {}", record.reason)
    };
    let ended_ns = record.steps.last().map(ns).filter(|_| record.promoted.is_some());
    let promoted = record.promoted;
    SwapSeen { role: record.role.clone(), begun_ns: record.begun_ns, ended_ns, stage, end, promoted, since: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// The copy lay in the folder of the results: the second arm swapped in the first arm's engine, and a folder of an older build the older one.
    #[test]
    fn a_swap_brings_in_the_engine_of_its_own_arm_also_where_the_station_runs_a_copy_by_now() {
        let station = Station::named(&format!("t{}-arm", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert!(own_engine(&station, Role::Fluid).is_err(), "it has no plan");
        let mut plan = Plan {
            binaries: "/arms/second".into(),
            slots: vec!["fluid:0".into()],
            swapped: BTreeMap::new(),
            state_bytes: 0,
            end_tick: None,
            faults: Vec::new(),
        };
        plan.write(&station).unwrap();
        let own = Ok(PathBuf::from("/arms/second/fluid"));
        assert_eq!(own_engine(&station, Role::Fluid), own);
        // A copy as the station keeps it.
        let folder = station.root().join("engines/1-2");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("from"), "/arms/second/fluid").unwrap();
        plan.swapped.insert("fluid".into(), folder.join("fluid"));
        plan.write(&station).unwrap();
        assert_eq!(own_engine(&station, Role::Fluid), own);
        station.wipe();
    }

    #[test]
    fn a_fault_after_the_end_of_a_swap_is_not_in_it_and_its_stage_is_the_last_step_before() {
        let step = |at_ms: f64, what: &str| Step { at_ms, what: what.into() };
        let record = Record {
            number: 1,
            role: "haptic".into(),
            slot: "haptic:1".into(),
            binary: PathBuf::new(),
            before: PathBuf::new(),
            incarnation: 9,
            incumbent: 3,
            proven: true,
            promoted: Some(true),
            cause: None,
            reason: String::new(),
            begun_ns: 1_000_000_000,
            steps: vec![
                step(0.1, "asked"),
                step(21.0, "ready"),
                step(1_020.0, "agrees"),
                step(3_030.0, "its own"),
                step(3_050.0, "done"),
            ],
        };
        let at = |ms: u64| seen(&record, 1_000_000_000 + ms * 1_000_000);
        assert_eq!((at(60).stage, at(1_080).stage, at(1_080).end), ("ready".into(), "agrees".into(), "the swap was done".into()));
        let is_in = |ms: u64| at(ms).is_at(1_000_000_000 + ms * 1_000_000);
        assert_eq!([60, 3_040, 3_051, 3_110].map(is_in), [true, true, false, false]);
        let going_on = seen(&Record { promoted: None, ..record.clone() }, 5_000_000_000);
        assert!(going_on.is_at(5_000_000_000) && !going_on.is_at(999_999_999));
    }
}
