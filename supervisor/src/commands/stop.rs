//! `hystation stop`: asks the station to stop, and if its guardian is dead does the guardian's last work.

use super::no_station;
use crate::control::{self, Request};
use crate::guardian::PAGE_NS;
use crate::remains::{self, Living};
use crate::settings::Refusal;
use hyst_exchange::{Station, system};
use hyst_messages::page::station as layout;

/// The guardian promises to be done within its own bounds, 4 s for the engines and 3 s for what must be killed.
const PATIENCE_NS: u64 = 10_000_000_000;
const LOOK_NS: u64 = 10_000_000;

/// Stops the station and waits until nothing of it is left, and the page of its session is made.
pub fn stop(station: &Station) -> Result<u8, Refusal> {
    if station.leftovers().is_empty() && remains::living(station).is_empty() {
        return Err(no_station(station));
    }
    let mut guardian = remains::guardian(station);
    if control::ask(station, &Request::Stop).is_err()
        && let Ok(page) = station.open_for_keeping()
    {
        page.store32_and_wake(layout::STOP, 1); // the supervisor is dead: the word in the page is what it would have written
        page.bump_and_wake(layout::CHANGES);
    }
    let deadline_ns = system::now_ns() + PATIENCE_NS;
    // A supervisor whose guardian died leaves a stand-in before it goes.
    while (remains::guardian(station).is_some() || remains::supervisor(station).is_some()) && system::now_ns() < deadline_ns {
        guardian = remains::guardian(station).or(guardian);
        system::sleep_ns(LOOK_NS);
    }
    if remains::guardian(station).is_some() {
        return Err(Refusal::failed(format!(
            "the guardian of station {:?} does not end; kill it and call stop again",
            station.name()
        )));
    }
    // One that lives removes everything by itself. Until the page is made it has the name, and cores that the next station needs; what there is of a station
    // after that is of the next one.
    if guardian.as_ref().is_some_and(ends) {
        return Ok(0);
    }
    remains::wait_until_gone(station, system::now_ns() + crate::supervise::STOP_NS, || {});
    let killed = remains::kill_all(station, || {});
    if !killed.is_empty() {
        eprintln!("hystation: killed because they did not stop: {}", killed.join(", "));
    }
    station.wipe();
    match station.leftovers().as_slice() {
        [] => Ok(0),
        left => Err(Refusal::failed(format!("cannot remove {left:?}; remove it by hand"))),
    }
}

/// Waits for the end of a guardian, as long as a page may take; false if it had come before, or does not come.
fn ends(guardian: &Living) -> bool {
    let deadline_ns = system::now_ns() + PAGE_NS;
    let lived = guardian.is_alive();
    while guardian.is_alive() && system::now_ns() < deadline_ns {
        system::sleep_ns(LOOK_NS);
    }
    lived && !guardian.is_alive()
}
