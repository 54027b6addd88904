//! A swap that is under way when a fault comes: begun by the campaign, from a copy of the role's own engine, and hurt at a drawn stage. Whether it succeeds
//! is the swap's affair; that it ends is a promise.

use super::{AHEAD_TICKS, Session, Trouble};
use crate::campaign::cell::Cell;
use crate::campaign::draw::Entry;
use crate::campaign::outcome::{Ending, Outcome};
use crate::control::{self, Request};
use crate::plan::Plan;
use crate::swap::Record;
use hyst_messages::Role;
use std::path::PathBuf;

/// Steps of a swap's record among which the stage of the fault is drawn: asked for, ready, compared, agreed, in the role.
const STAGES: u64 = 5;
/// How long a swap may take to come to a stage, ns: a newcomer starts within 30 s.
const STAGE_NS: u64 = 40_000_000_000;
/// How long it may take to end: what each of its stages may take at most (`policy::swap`), and the restart of each slot.
const END_NS: u64 = 180_000_000_000;

impl Session {
    /// Begins the swap that a cell has beside its fault, and gives the fault's tick; `None` without such a swap. The text says why it did not begin.
    pub(super) fn swap_beside(&mut self, entry: &Entry, cell: &Cell) -> Result<Result<Option<u64>, String>, Trouble> {
        let Some(role) = cell.swap else { return Ok(Ok(None)) };
        let begun = self.begin_swap(role, (entry.with_ticks % STAGES) as usize)?;
        Ok(begun.map(|()| Some(self.tick() + AHEAD_TICKS + entry.with_ticks)))
    }

    /// Waits for the end of the swap, if there is one; one that does not end is no verdict, but a broken promise.
    pub(super) fn see_swap_end(&mut self, outcome: &mut Outcome, cell: &Cell) -> Result<(), Trouble> {
        if cell.swap.is_none() {
            return Ok(());
        }
        match self.end_swap()? {
            Some(end) => outcome.reason = end,
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

    /// Waits for the end of the swap; says how it ended, `None` if it does not end.
    fn end_swap(&mut self) -> Result<Option<String>, Trouble> {
        self.wait(END_NS, |session| {
            let record = Record::read(&session.station)?;
            let promoted = record.promoted?;
            Some(if promoted { "the swap was done".to_string() } else { format!("the swap was undone: {}", record.reason) })
        })
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
