//! What was noticed of a fault: who found a lie, and whether anybody saw what is done to a process from outside. That bytes were flipped, a limit lowered, or
//! /dev/shm filled, is no sign that anything came of it: a fault of which nothing was noticed is named, and is no evidence for a bound. What all of those together
//! cost the hand is compared with their controls, and can break a promise.

use super::blame::{Blame, Sequel};
use super::figures::Figures;
use crate::campaign::cell::Cell;
use crate::campaign::outcome::Outcome;
use crate::fault::compare::excess;
use crate::fault::{Fault, finder};
use crate::faultfile::FaultKind;
use hyst_messages::Role;

/// Looks of 5 ms in which the tool must have touched something while an output was frozen, before it was another one than the true one: less than that
/// may lie at the end of the lie, where nobody has had time.
const LEAST_TOUCHING: u32 = 20;

/// Where a fault is done that is done from outside.
fn segment(cell: &Cell) -> &'static str {
    match (cell.injection.place, cell.injection.kind) {
        (Some(place), _) => place.name(),
        (None, FaultKind::ShmFull) => "/dev/shm",
        (None, _) => "open files",
    }
}

/// By whom a fault that was done from outside was noticed, and what it cost, or what became of it: `true` if it was noticed.
pub(super) fn notice(fault: &Fault, sequel: Sequel, has_ended: bool) -> (bool, String) {
    let others = sequel.others().next();
    let hand = fault.window.zip(fault.control).map_or(0, |(window, control)| excess(&window, &control));
    match fault.remains {
        _ if fault.dead => (true, format!("died, found by {}", fault.detected_by)),
        // One that only missed its periods and lives on was late, as a host's stall makes anybody; older builds booked that as a notice.
        _ if !["", finder::HEARTBEAT].contains(&fault.detected_by.as_str()) => (true, fault.detected_by.clone()),
        _ if others.is_some() => (true, "others died".into()),
        _ if sequel.began_anew() => (true, "a state began anew".into()),
        _ if has_ended => (true, "the station ended".into()),
        // Whoever lost ticks would be counted with those who noticed, and who had more of them in the control would not: a host's stall is as likely in either.
        _ if hand > 0 => (false, "nobody, and the hand lost ticks".into()),
        Some(remains) if remains.still_there > 0 => (false, "still there, unread".into()),
        Some(remains) if remains.written_over > 0 => (false, "written over by its owner".into()),
        Some(remains) if remains.gone > 0 => (false, "gone with its file".into()),
        _ => (false, "nothing".into()),
    }
}

/// Whether who died in a full /dev/shm had nobody in his place before there was room again: whoever is to start then is not started.
fn waited_for_room(first: &Fault, own: &Fault) -> bool {
    let over_ns = |fault: &Fault| Some(fault.injected_ns + (fault.recovered_us? * 1e3) as u64);
    let back = over_ns(own).zip(over_ns(first));
    first.is(FaultKind::ShmFull) && own.dead && back.is_some_and(|(back_ns, room_ns)| back_ns >= room_ns)
}

/// What an output was that nobody took for a lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unfound {
    /// It was the true one: a force of nothing that stands still while nothing is touched.
    True,
    /// A lie.
    Lie,
}

/// What a fault was that published lies which nobody found; `None` of any other, and if somebody found it.
pub(super) fn unfound(cell: &Cell, fault: &Fault, outcome: &Outcome) -> Option<Unfound> {
    let is_lie = cell.injection.kind.mischief().is_some_and(|what| what.is_lie());
    if !is_lie || !fault.manifested || !fault.detected_by.is_empty() || fault.dead {
        return None;
    }
    let is_force = matches!(cell.role(), "device" | "haptic");
    let is_true = is_force && cell.injection.kind == FaultKind::Frozen && outcome.touching < LEAST_TOUCHING;
    Some(if is_true { Unfound::True } else { Unfound::Lie })
}

impl Figures {
    /// Adds whether the fault showed in whose recovery, or hand-over, another one came.
    pub(super) fn take_first(&mut self, cell: &Cell, outcome: &Outcome, blame: &Blame) {
        let Some((with, first)) = cell.with.as_ref().zip(outcome.with.as_ref()) else { return };
        let is_noticed = || {
            let (was_noticed, _) = notice(first, blame.sequel(outcome), blame.ended(outcome.index).is_some());
            was_noticed || outcome.fault.as_ref().is_some_and(|own| waited_for_room(first, own))
        };
        let shows = first.manifested && (!with.kind.is_done_from_outside() || is_noticed());
        self.first_manifested += usize::from(shows);
    }

    /// Adds what was noticed of a fault that was done from outside, and what it cost; whether it was noticed.
    pub(super) fn take_notice(&mut self, cell: &Cell, fault: &Fault, index: usize, sequel: Sequel, has_ended: bool) -> bool {
        let (was_noticed, by) = notice(fault, sequel, has_ended);
        *self.noticed.entry(by).or_default() += 1;
        self.segment = segment(cell).into();
        if !was_noticed {
            self.unnoticed.push(index);
        }
        let own = fault.dead.then_some(fault.target.as_str());
        for target in own.into_iter().chain(sequel.others().map(|other| other.target.as_str())) {
            let role = Role::name_in(target);
            *self.died.entry(role.into()).or_default() += 1;
        }
        was_noticed
    }
}
