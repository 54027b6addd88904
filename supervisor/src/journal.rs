//! What happened, for people: one line for each event, appended to a file in the station's root; and the verdict, if the station has to
//! end by itself.

use hyst_exchange::{Station, whole};
use hyst_messages::Slot;
use serde::{Deserialize, Serialize};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// What is said where the header of one of the station's own pages was mended, by whoever saw it first.
pub const STATION_MENDED: &str = "the station's page had a damaged header, which was mended";
/// The same of the roster's.
pub const ROSTER_MENDED: &str = "the roster's page had a damaged header, which was mended";

/// A log that is longer is shortened.
const MOST_LOG_BYTES: u64 = 4 << 20;
/// What is kept of it.
const KEPT_LOG_BYTES: u64 = 1 << 16;
/// Longest line; last words may be long.
const MOST_BYTES: usize = 1_000;
/// Most characters of a process's own line that are quoted.
const MOST_QUOTED: usize = 300;
/// Lines of a sort that can come at any rate, within [`SELDOM_NS`]: enough to see that there is a cause which goes on.
const MOST_SELDOM: u64 = 8;
/// How long those count, ns.
const SELDOM_NS: u64 = 10_000_000_000;

/// Appends a line.
pub fn say(station: &Station, text: &str) {
    let tick = station.open().map_or(0, |page| page.present_tick());
    let mut line = format!("{:>10.3} s  {}", tick as f64 * 1e-3, text.replace('\n', " "));
    if line.len() > MOST_BYTES {
        let end = (0..=MOST_BYTES).rev().find(|at| line.is_char_boundary(*at)).unwrap_or(0);
        line.truncate(end);
    }
    line.push('\n');
    if let Ok(mut file) = std::fs::OpenOptions::new().append(true).create(true).open(station.events()) {
        let _ = file.write_all(line.as_bytes()); // a full disk costs the line, not the station
    }
}

/// Lines of one sort that somebody else causes, at whatever rate: of many only some are said.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seldom {
    since_ns: u64,
    count: u64,
}

impl Seldom {
    /// Appends a line, unless enough of its sort were said lately.
    pub fn say(&mut self, station: &Station, now_ns: u64, text: &str) {
        if let Some(text) = self.admit(now_ns, text) {
            say(station, &text);
        }
    }

    /// The text, if it is to be said; the first one after others that were not says how many those are.
    fn admit(&mut self, now_ns: u64, text: &str) -> Option<String> {
        let mut unsaid = 0;
        if self.count == 0 || now_ns.saturating_sub(self.since_ns) >= SELDOM_NS {
            unsaid = self.count.saturating_sub(MOST_SELDOM);
            *self = Seldom { since_ns: now_ns, count: 0 };
        }
        self.count += 1;
        match (self.count, unsaid) {
            (_, 1..) => Some(format!("{text} ({unsaid} more of that were not said)")),
            (..=MOST_SELDOM, 0) => Some(text.to_string()),
            _ => None,
        }
    }
}

/// Lines after the first `seen` bytes; moves `seen` on.
pub fn news(station: &Station, seen: &mut usize) -> Vec<String> {
    let Ok(text) = std::fs::read_to_string(station.events()) else {
        return Vec::new();
    };
    let news = text.get(*seen..).unwrap_or("").to_string();
    *seen = text.len();
    news.lines().map(str::to_string).collect()
}

/// How long the log of a slot is, bytes; one that is not there is short.
pub fn log_bytes(station: &Station, slot: Slot) -> u64 {
    std::fs::metadata(station.log(slot)).map_or(0, |log| log.len())
}

/// Shortens the logs of these slots, and the events, where they have grown too long: they lie in memory that all engines share, and an engine or a driver
/// that says something at each step would fill it within hours. Who writes a log appends to it, so it goes on behind what is kept.
pub fn keep_small(station: &Station, slots: &[Slot]) {
    let logs = slots.iter().map(|slot| station.log(*slot));
    for path in logs.chain([station.events()]) {
        let _ = shorten(&path); // one that is not there is short
    }
}

fn shorten(path: &Path) -> std::io::Result<()> {
    if std::fs::metadata(path)?.len() <= MOST_LOG_BYTES {
        return Ok(());
    }
    let mut file = std::fs::OpenOptions::new().read(true).append(true).open(path)?;
    let mut tail = Vec::new();
    file.seek(SeekFrom::End(-(KEPT_LOG_BYTES as i64)))?;
    Read::by_ref(&mut file).take(KEPT_LOG_BYTES).read_to_end(&mut tail)?;
    let whole = tail.iter().position(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    file.set_len(0)?;
    file.write_all(&[b"(what was said before is not kept)\n", tail.get(whole..).unwrap_or_default()].concat())
}

/// How the line begins that stands before what an incarnation prints: its predecessors wrote into the same file.
const BIRTH: &str = "-- incarnation ";

/// Opens the log of a slot for an incarnation that is about to start.
pub fn open_log(station: &Station, slot: Slot, incarnation: u32) -> std::io::Result<std::fs::File> {
    let mut log = std::fs::OpenOptions::new().append(true).create(true).open(station.log(slot))?;
    let _ = writeln!(log, "{BIRTH}{incarnation}"); // a full disk costs the line, not the start
    Ok(log)
}

/// The last line that the present incarnation of a slot has printed, shortened; empty if it printed nothing.
pub fn last_line(station: &Station, slot: Slot) -> String {
    let line = last_line_of(&station.log(slot)).unwrap_or_default();
    if line.starts_with(BIRTH) { String::new() } else { line.chars().take(MOST_QUOTED).collect() }
}

/// The last line that any incarnation of a slot has printed, shortened; empty if none printed anything.
pub fn last_line_of_any(station: &Station, slot: Slot) -> String {
    let is_said = |line: &str| !line.is_empty() && !line.starts_with(BIRTH);
    last_line_that(&station.log(slot), is_said).unwrap_or_default().chars().take(MOST_QUOTED).collect()
}

/// The last line of a log that is not empty.
pub fn last_line_of(path: &Path) -> std::io::Result<String> {
    last_line_that(path, |line| !line.is_empty())
}

fn last_line_that(path: &Path, is_it: impl Fn(&str) -> bool) -> std::io::Result<String> {
    let mut file = std::fs::File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(MOST_BYTES as u64)))?;
    let mut tail = Vec::new();
    file.take(MOST_BYTES as u64).read_to_end(&mut tail)?;
    let text = String::from_utf8_lossy(&tail);
    Ok(text.lines().rev().map(str::trim).find(|line| is_it(line)).unwrap_or_default().to_string())
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
            let _ = whole::write(&Verdict::path(station), text.as_bytes()); // the message is in the journal too
        }
    }
    /// The verdict, if there is one.
    pub fn read(station: &Station) -> Option<Verdict> {
        serde_json::from_str(&std::fs::read_to_string(Verdict::path(station)).ok()?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_all_the_time_is_said_some_times_and_then_counted() {
        let mut seldom = Seldom::default();
        let mut said = |now_ns| seldom.admit(now_ns, "so");
        let first: Vec<String> = (0..1_000).filter_map(|n| said(5 + n)).collect();
        assert_eq!(first, vec!["so"; MOST_SELDOM as usize]);
        assert_eq!(said(5 + SELDOM_NS).as_deref(), Some("so (992 more of that were not said)"));
        assert_eq!((0..1_000).filter_map(|n| said(6 + SELDOM_NS + n)).count() as u64, MOST_SELDOM - 1);
        assert!(said(5 + 3 * SELDOM_NS).unwrap().contains(" more"));
        assert_eq!(said(5 + 5 * SELDOM_NS).as_deref(), Some("so"), "nothing was left unsaid");
    }

    #[test]
    fn a_log_that_grows_too_long_keeps_its_newest_lines_and_goes_on_behind_them() {
        let path = std::env::temp_dir().join(format!("t{}-long.log", std::process::id()));
        let mut writer = std::fs::OpenOptions::new().append(true).create(true).open(&path).unwrap();
        writer.write_all(b"short\n").unwrap();
        shorten(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"short\n");
        let lines: String = (0..).map(|n| format!("line {n}\n")).take(500_000).collect();
        assert!(lines.len() as u64 > MOST_LOG_BYTES);
        writer.write_all(lines.as_bytes()).unwrap();
        shorten(&path).unwrap();
        writer.write_all(b"the next\n").unwrap();
        assert_eq!(last_line_of(&path).unwrap(), "the next");
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(text.len() as u64 <= KEPT_LOG_BYTES + 100, "{} bytes", text.len());
        assert!(text.starts_with("(what was said before is not kept)\nline 49"), "{}", &text[..80]);
        assert!(text.ends_with("line 499999\nthe next\n"));
        assert!(shorten(&path).is_err(), "it is gone");
    }
}
