//! What the supervisor says of the station, as events of the recording: hangs, distrust, injected faults, swaps and their ends, states that went back. Promise:
//! a line is in the file once, also across a kill of the recorder: it is written with the ticks up to it, and who comes next goes on after those. What the
//! recorder itself has seen waits beside it.

use hyst_engine::journal::Journal;
use hyst_exchange::Station;
use hyst_recording::{Event, Level, SAID};

/// For so long the supervisor may take from the tick that it names to the end of its line, ticks. What happened at a tick is written with one that is so much
/// later.
pub const SLACK_TICKS: u64 = 50;
/// Events that wait while the device makes no tick.
const MOST_WAITING: usize = 1_000;

/// The journal, and what of it is not in the recording yet.
pub struct Said {
    journal: Journal,
    waiting: Vec<Event>,
    /// A predecessor has written what was said up to this tick.
    written: Option<u64>,
}

impl Said {
    /// Goes on after `last_tick`, the newest in the file.
    pub fn new(station: &Station, last_tick: Option<u64>) -> Said {
        let written = last_tick.and_then(|tick| tick.checked_sub(SLACK_TICKS));
        Said { journal: Journal::open(station), waiting: Vec::new(), written }
    }

    /// Has what was seen wait for its ticks.
    pub fn hold(&mut self, seen: impl IntoIterator<Item = Event>) {
        self.waiting.extend(seen);
    }

    /// Adds what was said, and seen, up to `newest_tick`, the newest of the device that goes into the file together with it.
    pub fn take(&mut self, newest_tick: u64, events: &mut Vec<Event>) {
        for line in self.journal.news() {
            let Some((tick, words)) = line.parts() else { continue };
            if self.written.is_none_or(|written| tick > written) {
                let (level, kind, process, text) = (Level::Info, SAID.into(), "supervisor".into(), words.to_string());
                self.waiting.push(Event { tick, level, kind, process, incarnation: 0, text });
            }
        }
        self.waiting.drain(..self.waiting.len().saturating_sub(MOST_WAITING));
        events.extend(self.waiting.extract_if(.., |event| event.tick.saturating_add(SLACK_TICKS) <= newest_tick));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::Write;

    #[test]
    fn a_line_is_written_once_with_the_ticks_up_to_it_by_whoever_lives_then() {
        let station = Station::named(&format!("t{}-said", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let mut file = File::options().append(true).create(true).open(station.events()).unwrap();
        let mut say = |text: &str| file.write_all(text.as_bytes()).unwrap();
        let taken = |said: &mut Said, newest| {
            let mut events = Vec::new();
            said.take(newest, &mut events);
            events.into_iter().map(|event| (event.tick, event.text)).collect::<Vec<_>>()
        };
        let mut first = Said::new(&station, None);
        say("     0.100 s  device hangs\n     0.400 s  device died\nno line of ours\n     0.5");
        assert_eq!(taken(&mut first, 149), []);
        assert_eq!(taken(&mut first, 200), [(100, "device hangs".into())]);
        // The first is killed with tick 449 in the file: what it had not written is written by the second.
        let mut second = Said::new(&station, Some(449));
        say("00 s  swap of fluid begins\n");
        assert_eq!(taken(&mut second, 460), [(400, "device died".into())]);
        assert_eq!(taken(&mut second, u64::MAX), [(500, "swap of fluid begins".into())], "the station stops");
        assert_eq!(taken(&mut Said::new(&station, Some(450)), u64::MAX).len(), 1, "with tick 450 in the file it had");
        // What was seen waits likewise, and holds up nothing that happened before it.
        let mut third = Said::new(&station, None);
        let (kind, process, text) = ("died".into(), "haptic:0".into(), "haptic:0 #5 died".into());
        third.hold([Event { tick: 480, level: Level::Warning, kind, process, incarnation: 5, text }]);
        assert_eq!(taken(&mut third, 529).iter().map(|(tick, _)| *tick).collect::<Vec<_>>(), [100, 400]);
        assert_eq!(taken(&mut third, 530), [(480, "haptic:0 #5 died".into())]);
        station.wipe();
    }
}
