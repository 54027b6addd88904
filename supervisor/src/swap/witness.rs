//! What the newcomer of a recorder finds: noted by a helper process as the swap begins, before the old one has ended, for its judge, which begins when somebody
//! else writes in the file. A helper, because the file may lie on a disk that does not answer.

use super::beside::{OTHERS, counts};
use hyst_engine::Settings;
use hyst_exchange::{Station, StationPage, system};
use hyst_messages::Role;
use hyst_messages::page::ProcessState;
use hyst_recording::Before;
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::Path;

/// Bytes that are read of it at most; it has a thousand.
const MOST_BYTES: u64 = 1 << 16;

/// What was noted.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Noted {
    pub(super) before: Before,
    /// The newest tick in that.
    pub(super) last_tick: Option<u64>,
    /// What the newest blocks in that have beside ticks.
    pub(super) wrote: [bool; OTHERS],
    /// The recorder that was live when all of this was known; 0 if none was.
    live: u32,
}

impl Noted {
    /// What there is to note of a file; `None` if nothing is.
    pub(super) fn of(file: &Path) -> Option<Noted> {
        let (before, newest) = Before::of(file).ok()??;
        let last_tick = newest.applied.iter().map(|record| record.tick).max();
        Some(Noted { before, last_tick, wrote: counts(&newest).map(|count| count > 0), live: 0 })
    }

    /// What the witness told on the standard input of the judge of a newcomer, if there was one, and in time.
    pub(super) fn told(guest: u32) -> Option<Noted> {
        let mut text = String::new();
        std::io::stdin().take(MOST_BYTES).read_to_string(&mut text).ok()?;
        in_time(&text, guest)
    }
}

/// What was noted before this newcomer wrote anything.
fn in_time(text: &str, guest: u32) -> Option<Noted> {
    serde_json::from_str(text).ok().filter(|noted: &Noted| noted.live != guest)
}

/// The helper itself: writes a line of JSON, or nothing.
pub fn witness(station: &Station) -> Result<(), String> {
    // It takes some hundredths of a second, and the newcomer starts meanwhile. Refused: it may come too late.
    system::be_nice(-19);
    let clock = station.open().map_err(|error| error.to_string())?;
    let text = std::fs::read_to_string(station.settings()).map_err(|error| error.to_string())?;
    let settings: Settings = toml::from_str(&text).map_err(|error| error.to_string())?;
    let Some(noted) = settings.record.as_deref().and_then(Noted::of) else { return Ok(()) };
    let Some(live) = live(station, &clock) else { return Ok(()) };
    let line = serde_json::to_string(&Noted { live, ..noted }).map_err(|error| error.to_string())?;
    writeln!(std::io::stdout(), "{line}").map_err(|error| error.to_string())
}

/// The recorder that is live, 0 if none is; `None` if nobody can tell.
fn live(station: &Station, clock: &StationPage) -> Option<u32> {
    let Some((slot, incarnation)) = clock.occupied(Role::Recorder).next().filter(|(slot, _)| !clock.is_dead(*slot)) else {
        return Some(0);
    };
    let page = station.read_slot(slot, incarnation).ok()?;
    Some(if page.state() == ProcessState::Live { incarnation } else { 0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{AppliedRecord, Slot, StepRecord};
    use hyst_recording::{Block, Session, Writer};

    #[test]
    fn what_the_newest_blocks_have_is_noted_and_what_was_noted_too_late_is_nothing() {
        let station = Station::named(&format!("t{}-witness", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let file = station.root().join("session.mcap");
        assert_eq!(Noted::of(&file), None);
        let mut writer = Writer::open(&file, &Session::from([("session".into(), "s".into())])).unwrap();
        let record = |tick: u64| AppliedRecord { tick, ..AppliedRecord::default() };
        for tick in 1..=40 {
            let steps = vec![StepRecord { tick, ..StepRecord::default() }];
            writer.append(&Block { applied: vec![record(tick)], steps, ..Block::default() }).unwrap();
        }
        let noted = Noted::of(&file).unwrap();
        assert_eq!((noted.last_tick, noted.wrote), (Some(38), [true, false, false]), "the last two may be torn");
        assert!(noted.before.is_in(&file).unwrap());
        let told = |live: u32| serde_json::to_string(&Noted { live, ..Noted::of(&file).unwrap() }).unwrap();
        assert!((told(3).len() as u64) < MOST_BYTES);
        assert_eq!(in_time(&told(0), 7), Some(noted));
        assert_eq!([told(3), told(7), String::new()].map(|text| in_time(&text, 7).is_some()), [true, false, false]);
        station.wipe();
    }

    #[test]
    fn the_recorder_that_is_live_is_told_from_one_that_starts() {
        let station = Station::named(&format!("t{}-live", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let (clock, slot) = (station.open().unwrap(), Slot::first(Role::Recorder));
        let keeper = station.open_for_keeping().unwrap();
        assert_eq!(live(&station, &clock), Some(0), "nobody was ever there");
        let page = station.create_slot(slot, 5).unwrap();
        keeper.store32(hyst_messages::page::station::SLOT_INCARNATION + slot.number(), 5);
        assert_eq!(live(&station, &clock), Some(0));
        page.set_state(ProcessState::Live);
        assert_eq!(live(&station, &clock), Some(5));
        keeper.store32(hyst_messages::page::station::SLOT_INCARNATION + slot.number(), 6);
        assert_eq!(live(&station, &clock), None, "it has no page");
        keeper.store32(hyst_messages::page::station::SLOT_DEAD + slot.number(), 1);
        assert_eq!(live(&station, &clock), Some(0));
        station.wipe();
    }
}
