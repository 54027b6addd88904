//! `hystation swap`: another engine in the place of a role's, while the station runs. The file is verified here, by an ordinary process, before the
//! station hears of it; then the supervisor does it, and this command says what happened.
//!
//! Exit codes: 0 the newcomer has the role, 1 it was rolled back, 2 it was refused and nothing was disturbed.

use super::no_station;
use crate::control::{self, Request};
use crate::remains;
use crate::settings::Refusal;
use crate::swap::{Record, kept, role_of};
use hyst_exchange::{Station, system};
use std::path::Path;

/// Between two looks at the record.
const LOOK_NS: u64 = 20_000_000;
/// A swap takes seconds; pictures in software may take minutes to start, twice.
const PATIENCE_NS: u64 = 600_000_000_000;

/// Swaps, and prints what happened.
pub fn swap(station: &Station, role: &str, binary: &Path, json: bool) -> Result<u8, Refusal> {
    let record = swap_and_wait(station, role, binary)?;
    if json {
        let text = serde_json::to_string_pretty(&record).map_err(|e| Refusal::failed(e.to_string()))?;
        println!("{text}");
    } else {
        print!("{}", table(&record));
    }
    Ok(u8::from(record.promoted != Some(true)))
}

/// Swaps and waits for the end.
pub fn swap_and_wait(station: &Station, role: &str, binary: &Path) -> Result<Record, Refusal> {
    let known = role_of(role).map_err(Refusal::input)?;
    // Not resolved: a program may go by the name that it is called by.
    let binary = std::path::absolute(binary).map_err(|e| Refusal::input(format!("{}: {e}", binary.display())))?;
    if !station.root().is_dir() {
        return Err(no_station(station));
    }
    let kept = kept::keep(station, &binary, known).map_err(Refusal::input)?;
    let request = Request::Swap { role: role.to_string(), binary: kept.binary().to_path_buf() };
    let answer = control::ask(station, &request).map_err(|reason| Refusal::input(format!("swap of {role}: {reason}")))?;
    drop(kept); // the supervisor has written down what it is for
    let number = answer["number"].as_u64().unwrap_or(0);
    let deadline_ns = system::now_ns() + PATIENCE_NS;
    loop {
        match Record::read(station).filter(|record| record.number == number) {
            Some(record) if record.promoted.is_some() => return Ok(record),
            None => return Err(Refusal::failed("the station has ended; how the swap ended is not known")),
            Some(_) if system::now_ns() >= deadline_ns => {
                return Err(Refusal::failed("the swap does not end; `hystation logs` says how far it is"));
            }
            Some(_) if remains::living(station).is_empty() => return Err(Refusal::failed("the station died during the swap")),
            Some(_) => system::sleep_ns(LOOK_NS),
        }
    }
}

/// What happened, as lines of plain text.
pub fn table(record: &Record) -> String {
    let [binary, before] = [&record.binary, &record.before].map(|path| kept::name_of(path));
    let mut text = format!("swap {} of {}: {} for {}\n", record.number, record.role, binary.display(), before.display());
    for step in &record.steps {
        text.push_str(&format!("{:>9.1} ms  {}\n", step.at_ms, step.what));
    }
    text
}
