//! What is told of the case while it runs, some short lines in one file in the station's root: the console, which judges, writes it; the window and the
//! guardian show it. Promise: a reader finds all lines of one moment or none; what is no such file is none; nobody waits for it.

use hyst_exchange::{Station, whole};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What is older than this is not shown, ticks: whoever tells has died or hangs.
const FRESH_TICKS: u64 = 4_000;
/// Most lines, and most characters of each, that are taken.
const MOST_LINES: usize = 8;
const MOST_LETTERS: usize = 160;

/// The case at a tick.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// The tick.
    pub tick: u64,
    /// What ended the session, in one sentence; `None` while it runs.
    pub over: Option<String>,
    /// Goals, time, what is next: ASCII.
    pub lines: Vec<String>,
    /// How often a warning has fallen so far, all of them together: the lines show few, and those that stand.
    #[serde(default)]
    pub fallen: u64,
}

fn path(station: &Station) -> PathBuf {
    station.root().join("told.json")
}

impl Told {
    /// The newest of a station with a case, if it is fresh at this tick. The end of a session stays.
    pub fn read(station: &Station, tick: u64) -> Option<Told> {
        let mut told: Told = serde_json::from_str(&std::fs::read_to_string(path(station)).ok()?).ok()?;
        told.lines.truncate(MOST_LINES);
        told.lines.iter_mut().chain(&mut told.over).for_each(|line| *line = line.chars().take(MOST_LETTERS).collect());
        (told.over.is_some() || tick.saturating_sub(told.tick) <= FRESH_TICKS).then_some(told)
    }

    /// Puts it in the place of the one before.
    pub fn write(&self, station: &Station) -> std::io::Result<()> {
        whole::write(&path(station), serde_json::to_string(self)?.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_read_back_while_it_is_fresh_the_end_always_and_nonsense_never() {
        let station = Station::named(&format!("t{}-told", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(Told::read(&station, 0), None);
        let running = Told { tick: 5_000, over: None, lines: vec!["goals 1 of 2".into()], fallen: 3 };
        running.write(&station).unwrap();
        assert_eq!(Told::read(&station, 9_000).as_ref(), Some(&running));
        assert_eq!(Told::read(&station, 9_001), None, "too old");
        let over = Told { over: Some("the time was over".into()), ..running };
        over.write(&station).unwrap();
        assert_eq!(Told::read(&station, 9_000_000), Some(over.clone()));
        Told { lines: vec!["x".repeat(1_000); 100], ..over }.write(&station).unwrap();
        let read = Told::read(&station, 0).unwrap();
        assert_eq!((read.lines.len(), read.lines[0].len()), (MOST_LINES, MOST_LETTERS));
        std::fs::write(path(&station), "{\"tick\":1").unwrap();
        assert_eq!(Told::read(&station, 1), None);
        station.wipe();
    }
}
