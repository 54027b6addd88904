//! The station's events as they are written: the file that `hystation logs` shows, read on from where the last look ended. An event is named by the
//! place of its end in the file, which grows and is the same for every life of the console until the file is shortened. Promise: a look reads a bounded number of bytes, and a line
//! that is half-written is shown when it is whole.

use hyst_exchange::Station;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;

/// Most bytes that are read at one look, and of the end of the file at the first one.
const MOST_BYTES: u64 = 64 * 1024;
/// Longest line; the supervisor's are shorter.
const MOST_LINE: usize = 4 * 1024;

/// An event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Place of its end in the file; grows.
    pub id: u64,
    /// What happened, and when.
    pub text: String,
}

impl Line {
    /// The station tick that it names, and what happened then; `None` of a line that is none of the supervisor's.
    pub fn parts(&self) -> Option<(u64, &str)> {
        let (seconds, words) = self.text.split_once(" s  ")?;
        let tick = seconds.trim().parse::<f64>().ok()? * 1e3;
        Some((tick.round() as u64, words))
    }
}

/// The file, and how far it was read.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: Option<File>,
    at: u64,
    /// What was read of the file before the supervisor shortened it.
    base: u64,
    /// What follows the last whole line.
    rest: Vec<u8>,
    /// The beginning of the line that is being read was left out.
    is_cut: bool,
}

impl Journal {
    /// The journal of a station, whose file may be made later.
    pub fn open(station: &Station) -> Journal {
        Journal { path: station.events(), file: None, at: 0, base: 0, rest: Vec::new(), is_cut: false }
    }

    /// The lines that are new since the look before.
    pub fn news(&mut self) -> Vec<Line> {
        if self.file.is_none() {
            self.begin();
        }
        let Some(file) = &mut self.file else { return Vec::new() };
        if file.metadata().is_ok_and(|data| data.len() < self.at) {
            // It was shortened; what is kept was read before.
            self.base += self.at;
            self.rest.clear();
            self.at = file.seek(SeekFrom::End(0)).unwrap_or(0);
        }
        // What was read before a failure counts; the rest is read at the next look.
        let before = self.rest.len();
        let _ = file.take(MOST_BYTES).read_to_end(&mut self.rest);
        self.at += (self.rest.len() - before) as u64;
        self.whole_lines()
    }

    fn begin(&mut self) {
        let Ok(mut file) = File::open(&self.path) else { return };
        let length = file.metadata().map_or(0, |data| data.len());
        let at = length.saturating_sub(MOST_BYTES);
        if file.seek(SeekFrom::Start(at)).is_ok() {
            (self.file, self.at, self.is_cut) = (Some(file), at, at > 0);
        }
    }

    fn whole_lines(&mut self) -> Vec<Line> {
        let mut lines = Vec::new();
        // Each turn takes a line off the rest, so it ends.
        while let Some(end) = self.rest.iter().position(|byte| *byte == b'\n') {
            let bytes: Vec<u8> = self.rest.drain(..=end).collect();
            if !std::mem::take(&mut self.is_cut) {
                let id = self.base + self.at - self.rest.len() as u64;
                lines.push(Line { id, text: String::from_utf8_lossy(&bytes[..end]).trim().to_string() });
            }
        }
        if self.rest.len() > MOST_LINE {
            self.rest.clear();
            self.is_cut = true;
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_line_says_its_tick_and_its_words() {
        let parts = |text: &str| Line { id: 1, text: text.into() }.parts().map(|(tick, words)| (tick, words.to_string()));
        assert_eq!(parts("6.539 s  device hangs"), Some((6_539, "device hangs".into())));
        assert_eq!(parts("70000.001 s  a  s  b"), Some((70_000_001, "a  s  b".into())));
        assert_eq!((parts("x s  y"), parts("6.539 device"), parts("")), (None, None, None));
    }

    #[test]
    fn whole_lines_are_told_once_and_named_alike_by_every_reader() {
        let station = Station::named(&format!("t{}-journal", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let mut first = Journal::open(&station);
        assert_eq!(first.news(), []);
        let mut file = File::options().append(true).create(true).open(station.events()).unwrap();
        let mut write = |bytes: &[u8]| file.write_all(bytes).unwrap();
        write(b"  0.1 s  one\n  0.2 s  tw");
        assert_eq!(first.news(), [Line { id: 13, text: "0.1 s  one".into() }]);
        assert_eq!(first.news(), []);
        write(b"o\xff\n");
        assert_eq!(first.news(), [Line { id: 27, text: "0.2 s  two\u{fffd}".into() }]);
        let mut second = Journal::open(&station);
        assert_eq!(second.news().iter().map(|line| line.id).collect::<Vec<_>>(), [13, 27]);
        // A line without an end is not kept for ever, nor shown in part.
        write(&[b'x'; MOST_LINE + 1]);
        assert_eq!(first.news(), []);
        write(b"xx\nnext\n");
        assert_eq!(first.news().iter().map(|line| line.text.clone()).collect::<Vec<_>>(), ["next"]);
        // The supervisor keeps the end of a file that has grown too long: those who read on hear what comes after.
        let before = first.base + first.at;
        file.set_len(0).unwrap();
        file.write_all(b"kept\n").unwrap();
        assert_eq!(first.news(), []);
        file.write_all(b"after\n").unwrap();
        let news = first.news();
        assert!(news.len() == 1 && news[0].text == "after" && news[0].id > before, "{news:?}");
        station.wipe();
    }
}
