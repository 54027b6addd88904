//! A swap that is under way when a fault comes: begun by the campaign, from a copy of the role's own engine, and hurt at a drawn stage. Whether it succeeds
//! is the swap's affair; that it ends is a promise.

use super::{AHEAD_TICKS, Session, Trouble};
use crate::campaign::cell::Cell;
use crate::campaign::draw::Entry;
use crate::campaign::outcome::{Ending, Outcome, SwapSeen};
use crate::control::{self, Request};
use crate::plan::Plan;
use crate::swap::{Record, Step};
use hyst_exchange::system;
use hyst_messages::Role;
use std::path::PathBuf;

/// The first steps of a swap's record, among which the stage of the fault is drawn: asked for, ready, compared, agreed, in the role. A servo's are asked
/// for, ready, in the role; of one that is replaced in place, asked for and ready. After each of them the swap goes on for longer than a fault is asked for ahead.
fn stages(role: Role) -> u64 {
    match role {
        Role::Tissue | Role::Fluid => 5,
        Role::Haptic => 3,
        _ => 2,
    }
}

/// How long a swap may take to come to a stage, ns: a newcomer starts within 30 s.
const STAGE_NS: u64 = 40_000_000_000;
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
        let Some(role) = cell.swap else { return Ok(Ok(None)) };
        outcome.swap = Some(SwapSeen { role: role.name().into(), begun_ns: system::now_ns(), ..SwapSeen::default() });
        // A newcomer is there from the second step on.
        let first = u64::from(cell.is_of_newcomer());
        let begun = self.begin_swap(role, (first + entry.with_ticks % (stages(role) - first)) as usize)?;
        Ok(begun.map(|()| Some(self.tick() + AHEAD_TICKS + entry.with_ticks)))
    }

    /// Waits for the end of the swap, if there is one; one that does not end is no verdict, but a broken promise.
    pub(super) fn see_swap_end(&mut self, outcome: &mut Outcome, cell: &Cell) -> Result<(), Trouble> {
        if cell.swap.is_none() {
            return Ok(());
        }
        let at_ns = outcome.fault.as_ref().map_or(0, |fault| fault.injected_ns);
        match self.end_swap()? {
            Some(record) => outcome.swap = Some(seen(&record, at_ns)),
            None => (outcome.ending, outcome.reason) = (Ending::Open, "the swap does not end".into()),
        }
        Ok(())
    }

    /// Asks for a swap of a role and waits until it has come to a stage, or has ended before. The text says why it did not begin.
    fn begin_swap(&mut self, role: Role, stage: usize) -> Result<Result<(), String>, Trouble> {
        let number = match self
            .copy(role)
            .and_then(|binary| control::ask(&self.station, &Request::Swap { role: role.name().into(), binary }))
        {
            Ok(answer) => answer["number"].as_u64().unwrap_or(0),
            Err(reason) => return Ok(Err(format!("swap of {}: {reason}", role.name()))),
        };
        self.wait(STAGE_NS, |session| {
            let record = Record::read(&session.station).filter(|record| record.number == number)?;
            (record.steps.len() > stage || record.promoted.is_some()).then_some(())
        })?;
        Ok(Ok(()))
    }

    /// Waits for the end of the swap; `None` if it does not end.
    fn end_swap(&mut self) -> Result<Option<Record>, Trouble> {
        self.wait(END_NS, |session| Record::read(&session.station).filter(|record| record.promoted.is_some()))
    }

    /// Another file with the same engine, so that the record shows who runs which.
    fn copy(&self, role: Role) -> Result<PathBuf, String> {
        let copy = self.files.with_file_name(format!("swapped-{}", role.name()));
        if !copy.exists() {
            let plan = Plan::read(&self.station).map_err(|error| error.to_string())?;
            std::fs::copy(plan.binary(role), &copy).map_err(|error| format!("{}: {error}", copy.display()))?;
        }
        std::path::absolute(&copy).map_err(|error| format!("{}: {error}", copy.display()))
    }
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
    SwapSeen { role: record.role.clone(), begun_ns: record.begun_ns, ended_ns, stage, end }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_stage_is_one_after_which_the_swap_goes_on() {
        // A servo's fourth and fifth step are the end of its probation, 20 ms before its end, and the end.
        assert_eq!([Role::Fluid, Role::Tissue, Role::Haptic, Role::Recorder].map(stages), [5, 5, 3, 2]);
    }
}
