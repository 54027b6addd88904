//! What happened, for people: one line for each event, appended to a file in the station's root; and the verdict, if the station has to
//! end by itself.

use crate::plan::write_whole;
use hyst_exchange::Station;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::PathBuf;

/// Longest line; last words may be long.
const MOST_BYTES: usize = 1_000;

/// Where the lines are.
pub fn path(station: &Station) -> PathBuf {
    station.root().join("events.log")
}

/// Appends a line.
pub fn say(station: &Station, text: &str) {
    let tick = station.open().map_or(0, |page| page.tick_at(hyst_exchange::system::now_ns()));
    let mut line = format!("{:>10.3} s  {}", tick as f64 * 1e-3, text.replace('\n', " "));
    if line.len() > MOST_BYTES {
        let end = (0..=MOST_BYTES).rev().find(|at| line.is_char_boundary(*at)).unwrap_or(0);
        line.truncate(end);
    }
    line.push('\n');
    if let Ok(mut file) = std::fs::OpenOptions::new().append(true).create(true).open(path(station)) {
        let _ = file.write_all(line.as_bytes()); // a full disk costs the line, not the station
    }
}

/// Lines after the first `seen` bytes; moves `seen` on.
pub fn news(station: &Station, seen: &mut usize) -> Vec<String> {
    let Ok(text) = std::fs::read_to_string(path(station)) else {
        return Vec::new();
    };
    let news = text.get(*seen..).unwrap_or("").to_string();
    *seen = text.len();
    news.lines().map(str::to_string).collect()
}

/// How the station ended by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Exit code of the run.
    pub code: u8,
    /// What, where, what to do.
    pub message: String,
}

impl Verdict {
    fn path(station: &Station) -> PathBuf {
        station.root().join("verdict.json")
    }
    /// Leaves the verdict for the guardian.
    pub fn write(&self, station: &Station) {
        if let Ok(text) = serde_json::to_string(self) {
            let _ = write_whole(&Verdict::path(station), text.as_bytes()); // the message is in the journal too
        }
    }
    /// The verdict, if there is one.
    pub fn read(station: &Station) -> Option<Verdict> {
        serde_json::from_str(&std::fs::read_to_string(Verdict::path(station)).ok()?).ok()
    }
}
