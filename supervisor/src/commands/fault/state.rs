//! A station's state as a tester names it, waited for from outside.

use crate::doing::{Doing, Strokes, Wanted};
use crate::plan::Plan;
use crate::settings::Refusal;
use crate::view::Viewer;
use hyst_exchange::{Station, system};

/// How long it is waited for if nobody says, s: the hands' periods are at most 12 s.
const WITHIN_S: f64 = 60.0;
/// Between two looks, ns: a contact lasts for tens of milliseconds at least.
const LOOK_NS: u64 = 1_000_000;

/// The state that a word of the command line names.
pub(super) fn named(word: &str) -> Result<Wanted, Refusal> {
    Wanted::parse(word).map_err(|reason| Refusal::input(format!("--state: {reason}")))
}

/// Waits until the station is in a state, so long at most.
pub(super) fn wait_for(station: &Station, wanted: Wanted, within_s: Option<f64>) -> Result<(), Refusal> {
    let failed = |error: &dyn std::fmt::Display| Refusal::failed(error.to_string());
    let slots = Plan::read(station).map_err(|error| failed(&error))?.slots();
    let mut viewer = Viewer::open(station).map_err(|error| failed(&error))?;
    let mut strokes = Strokes::default();
    let within_s = within_s.unwrap_or(WITHIN_S);
    let end_ns = system::now_ns() + (within_s * 1e9) as u64;
    while !wanted.is_in(&Doing::watched(station, &slots, &mut viewer, &mut strokes)) {
        if viewer.page().stop_requested() {
            return Err(Refusal::failed("--state: the station stopped before it was in that state"));
        }
        if system::now_ns() >= end_ns {
            return Err(Refusal::failed(format!("--state: the station was not in that state within {within_s} s (--within)")));
        }
        system::sleep_ns(LOOK_NS);
    }
    Ok(())
}

/// What is to be said of a state that was waited for, when the fault came; `None` of the station if nobody told it.
pub(super) fn held(wanted: Wanted, doing: Option<&Doing>) -> Option<bool> {
    doing.map(|doing| wanted.is_in(doing))
}
