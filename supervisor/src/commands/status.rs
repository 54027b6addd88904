//! `hystation status` and `hystation top`: what a station's pages say. They work while the supervisor is dead.

use super::no_station;
use crate::settings::Refusal;
use crate::terminal::{Size, screen};
use crate::view::{Viewer, table};
use hyst_exchange::{Station, system};
use std::io::Write;
use std::sync::atomic::Ordering;

/// Between the two looks that a rate needs.
const RATE_NS: u64 = 250_000_000;
/// Between two drawings of `top`.
const DRAW_NS: u64 = 500_000_000;

/// Prints the processes once. A station of which nobody lives is reported as not running.
pub fn status(station: &Station, json: bool) -> Result<u8, Refusal> {
    let mut viewer = Viewer::open(station).map_err(|_| no_station(station))?;
    viewer.look();
    system::sleep_ns(RATE_NS);
    let view = viewer.look_all();
    if view.state == "dead" {
        return Err(no_station(station));
    }
    let text =
        if json { serde_json::to_string_pretty(&view).map_err(|e| Refusal::failed(e.to_string()))? + "\n" } else { table(&view) };
    // A reader that has gone (`| head`) has read what it wanted.
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(0)
}

/// Draws the processes until Ctrl-C or the end of the station.
pub fn top(station: &Station) -> Result<u8, Refusal> {
    let mut viewer = Viewer::open(station).map_err(|_| no_station(station))?;
    let stop = crate::interrupt::noticed().map_err(Refusal::failed)?;
    while !stop.load(Ordering::Relaxed) {
        let view = viewer.look_all();
        let text = screen(&table(&view), &[], "", Size::now());
        let mut out = std::io::stdout();
        if view.state == "dead" || out.write_all(text.as_bytes()).and_then(|()| out.flush()).is_err() {
            break;
        }
        system::sleep_ns(DRAW_NS);
    }
    Ok(0)
}
