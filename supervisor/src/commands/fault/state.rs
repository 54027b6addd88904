//! A station's state as a tester names it, waited for from outside.

use crate::campaign::cell::State;
use crate::plan::Plan;
use crate::settings::Refusal;
use crate::swap::Record;
use crate::view::Viewer;
use hyst_exchange::{Station, system};
use hyst_messages::{Slot, TissueStatus};

/// How long it is waited for, ns.
const WITHIN_NS: u64 = 60_000_000_000;
/// Between two looks, ns: a contact lasts for tens of milliseconds at least.
const LOOK_NS: u64 = 1_000_000;

/// Waits until the station is in the state that the word names.
pub(super) fn wait_for(station: &Station, word: &str) -> Result<(), Refusal> {
    let state = State::parse(word).map_err(|reason| Refusal::input(format!("--state: {reason}")))?;
    let failed = |error: &dyn std::fmt::Display| Refusal::failed(error.to_string());
    let slots = Plan::read(station).map_err(|error| failed(&error))?.slots();
    let mut viewer = Viewer::open(station).map_err(|error| failed(&error))?;
    let end_ns = system::now_ns() + WITHIN_NS;
    while !is_in(state, station, &slots, &mut viewer) {
        if viewer.page().stop_requested() || system::now_ns() >= end_ns {
            return Err(Refusal::failed(format!("the station was not in state {word} within {} s", WITHIN_NS / 1_000_000_000)));
        }
        system::sleep_ns(LOOK_NS);
    }
    Ok(())
}

fn is_in(state: State, station: &Station, slots: &[Slot], viewer: &mut Viewer) -> bool {
    let says = |of: fn(&TissueStatus) -> bool, viewer: &mut Viewer| viewer.tissue_status().is_some_and(|status| of(&status));
    match state {
        State::Any => true,
        State::Idle => is_whole(slots, viewer) && says(|status| status.contact_count == 0, viewer),
        State::Contact => is_whole(slots, viewer) && says(|status| status.contact_count > 0, viewer),
        State::Cutting => is_whole(slots, viewer) && says(|status| status.is_cutting != 0, viewer),
        State::Recovery => !is_whole(slots, viewer),
        State::Swap => Record::read(station).is_some_and(|record| record.promoted.is_none()),
    }
}

fn is_whole(slots: &[Slot], viewer: &mut Viewer) -> bool {
    slots.iter().all(|slot| viewer.is_well(*slot))
}
