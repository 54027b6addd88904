//! Which processes belong to a station: those that say so on their command line, and whatever an engine has started, whatever that has become since.

use hyst_exchange::{Station, system};
use hyst_messages::Slot;
use std::os::unix::fs::MetadataExt;

/// The variable that has the station's name and the incarnation in the environment of each engine, and so in that of whatever the engine starts. A command line
/// is another one as soon as that becomes another program.
pub const MARK: &str = "HYSTATION_STATION";

/// What an incarnation has in that variable: more than a name, which a user's shell may have for reasons of its own.
pub fn mark_of(station: &Station, incarnation: u32) -> String {
    format!("{}/{incarnation}", station.name())
}

/// The incarnation of a station that has started a process of this user, or was started as it, by what the environment of that began with; `None` if none has.
pub fn started_by(process: u32, station: &Station) -> Option<u32> {
    let environment = std::fs::read(format!("/proc/{process}/environ")).ok()?;
    let head = format!("{MARK}={}/", station.name());
    let marks = environment.split(|byte| *byte == 0).filter_map(|entry| entry.strip_prefix(head.as_bytes()));
    marks.filter_map(|number| std::str::from_utf8(number).ok()).find_map(|number| number.parse().ok())
}

/// Processes of this user, but for the caller.
pub fn of_user() -> impl Iterator<Item = u32> {
    let (mine, user) = (std::process::id(), system::user_id());
    let is_own = move |entry: &std::fs::DirEntry| entry.metadata().is_ok_and(|data| data.uid() == user);
    std::fs::read_dir("/proc").into_iter().flatten().flatten().filter_map(move |entry| {
        let process = entry.file_name().to_string_lossy().parse::<u32>().ok()?;
        (process != mine && is_own(&entry)).then_some(process)
    })
}

/// Processes of a station: all but the guardian and the caller.
pub fn of_station(station: &Station) -> Vec<u32> {
    of_user().filter(|process| belongs(*process, station) && system::process_start(*process).is_some()).collect()
}

/// The process that was started as this incarnation in this slot, by its command line.
pub fn of_incarnation(station: &Station, slot: Slot, incarnation: u32) -> Option<u32> {
    let (slot, incarnation) = (slot.to_string(), incarnation.to_string());
    let is_it = |process: &u32| {
        let line = std::fs::read(format!("/proc/{process}/cmdline")).unwrap_or_default();
        let words: Vec<&[u8]> = line.split(|byte| *byte == 0).collect();
        let says = |name: &[u8], value: &str| words.windows(2).any(|pair| pair[0] == name && pair[1] == value.as_bytes());
        says(b"--slot", &slot) && says(b"--incarnation", &incarnation)
    };
    of_station(station).into_iter().find(is_it)
}

/// Whether a process of this user is one of the station, by its command line (`--station NAME`) or by what its environment began with.
pub fn belongs(process: u32, station: &Station) -> bool {
    let line = std::fs::read(format!("/proc/{process}/cmdline")).unwrap_or_default();
    if line.is_empty() {
        return false; // one that has ended, or the kernel's own
    }
    let words: Vec<&[u8]> = line.split(|byte| *byte == 0).collect();
    let is_named = words.windows(2).any(|pair| pair[0] == b"--station" && pair[1] == station.name().as_bytes());
    is_named || started_by(process, station).is_some()
}

/// The process group of a process, which is its leader's id; `None` if there is no such process.
pub fn group(process: u32) -> Option<u32> {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    text.rsplit_once(')')?.1.split_whitespace().nth(2)?.parse().ok() // proc(5): field 5, the state is 3
}
