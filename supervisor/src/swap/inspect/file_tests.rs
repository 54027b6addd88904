//! A recorder is judged by what it has written into its file, and over a restart of the device as it is without one.

use super::*;
use hyst_exchange::OwnedPage;
use hyst_messages::AppliedRecord;
use hyst_messages::page::device::APPLIED;
use hyst_recording::{Block, Session, Writer};
use std::fs::OpenOptions;
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::PathBuf;

fn made(tick: u64) -> AppliedRecord {
    AppliedRecord { tick, ..AppliedRecord::default() }
}

fn make(page: &OwnedPage, ticks: RangeInclusive<u64>) {
    ticks.for_each(|tick| page.push(APPLIED, tick, &made(tick)));
}

/// The only slot of the device.
fn slot() -> Slot {
    Slot::first(Role::Device)
}

/// A recorder on probation: its file, and who reads it.
struct Probation {
    station: Station,
    file: PathBuf,
    writer: Writer,
    recording: Recording,
}

impl Probation {
    fn of(name: &str) -> Probation {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let file = station.root().join("session.mcap");
        let writer = Writer::open(&file, &Session::from([("session".into(), "s".into())])).unwrap();
        let recording = Recording::of(Some(&file));
        Probation { station, file, writer, recording }
    }

    fn append(&mut self, ticks: impl Iterator<Item = u64>) {
        self.writer.append(&Block { applied: ticks.map(made).collect(), ..Block::default() }).unwrap();
    }

    /// A look at it in a tick, when its page says that so many ticks are on disk, and a life of the device is present.
    fn look(&mut self, says: u64, incarnation: u32, now: u64) -> Look {
        self.recording.read(&self.station, [(slot(), incarnation)]);
        let bytes = std::fs::metadata(&self.file).unwrap().len();
        let status = RecorderStatus { last_tick: says, ticks: says, lost: 0, bytes };
        let newest = self.recording.lives.newest_tick();
        self.recording.look(Some(status), Some(bytes), newest, now)
    }
}

impl Drop for Probation {
    fn drop(&mut self) {
        self.station.wipe();
    }
}

/// It was believed: one that wrote nothing, or rubbish, passed.
#[test]
fn a_recorder_is_judged_by_its_file_and_not_by_what_its_page_says() {
    let mut probation = Probation::of("liar");
    make(&probation.station.create_slot(slot(), 1).unwrap(), 1..=300);
    let look = |probation: &mut Probation, says: u64| probation.look(says, 1, 300);
    let lies = Look::Wrong("it says that tick 300 is on disk, and its file can be read up to tick 200".into());
    assert!(matches!(look(&mut probation, 100), Look::Still(_)), "nobody has read what was there before");
    probation.append(101..=200);
    assert!(matches!(look(&mut probation, 200), Look::New(ratio, _) if ratio < 1.0));
    assert_eq!(look(&mut probation, 300), lies, "it wrote nothing");
    let mut rubbish = OpenOptions::new().append(true).open(&probation.file).unwrap();
    rubbish.write_all(&[0xa5; 4_096]).unwrap();
    assert_eq!(look(&mut probation, 300), lies);
    probation.append((201..=300).filter(|tick| *tick != 250));
    let holes = Look::New(f64::INFINITY, "its file leaves out 1 of the device's ticks".into());
    assert_eq!([look(&mut probation, 300), look(&mut probation, 300)], [holes.clone(), holes]);
}

/// The last block before the device's death comes when its next life has made nothing yet: it was dropped, and the recorder rolled back.
#[test]
fn a_recorder_is_good_though_the_device_died_before_its_last_ticks_were_in_the_file() {
    let mut probation = Probation::of("restart");
    let [old, new] = [1, 2].map(|incarnation| probation.station.create_slot(slot(), incarnation).unwrap());
    make(&old, 1..=300);
    let look = |probation: &mut Probation, says: u64, incarnation: u32| probation.look(says, incarnation, 500);
    assert!(matches!(look(&mut probation, 200, 1), Look::Still(_)));
    probation.append(201..=300);
    let last = look(&mut probation, 300, 2);
    assert!(matches!(&last, Look::New(ratio, _) if *ratio < 1.0), "{last:?}");
    assert_eq!(look(&mut probation, 300, 2), Look::Idle, "the new device has made none");
    make(&new, 320..=400);
    probation.append(320..=400);
    let next = look(&mut probation, 400, 2);
    assert!(matches!(&next, Look::New(ratio, _) if *ratio < 1.0), "{next:?}");
    make(&new, 401..=500);
    probation.append((401..=500).filter(|tick| *tick != 450));
    let hole = Look::New(f64::INFINITY, "its file leaves out 1 of the device's ticks".into());
    assert_eq!(look(&mut probation, 500, 2), hole);
}
