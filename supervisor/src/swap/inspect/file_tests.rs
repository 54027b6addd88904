//! A recorder is judged by what it has written into its file, and by what it has left there, and over a restart of the device as it is without one.

use super::*;
use hyst_exchange::OwnedPage;
use hyst_messages::AppliedRecord;
use hyst_messages::page::device::APPLIED;
use hyst_recording::{Session, Writer};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::ops::RangeInclusive;

/// The newcomer.
const GUEST: u32 = 17;

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

fn writer(file: &Path) -> Writer {
    Writer::open(file, &Session::from([("session".into(), "s".into())])).unwrap()
}

/// A recorder on probation: its file, and who reads it.
struct Probation {
    station: Station,
    file: PathBuf,
    writer: Option<Writer>,
    recording: Recording,
}

impl Probation {
    fn of(name: &str) -> Probation {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let file = station.root().join("session.mcap");
        let (writer, recording) = (Some(writer(&file)), Recording::of(Some(&file), None, GUEST));
        Probation { station, file, writer, recording }
    }

    /// One that follows a recorder which has written ticks 1 to 100, and was noted then.
    fn behind(name: &str) -> Probation {
        let mut probation = Probation::of(name);
        (0..5).for_each(|part| probation.append(20 * part + 1..=20 * part + 20));
        let noted = Noted::of(&probation.file);
        assert!(noted.is_some());
        probation.recording = Recording::of(Some(&probation.file), noted, GUEST);
        probation.writer = None;
        probation
    }

    fn append(&mut self, ticks: impl Iterator<Item = u64>) {
        let writer = self.writer.get_or_insert_with(|| writer(&self.file));
        writer.append(&Block { applied: ticks.map(made).collect(), ..Block::default() }).unwrap();
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

/// One that began the file anew passed: what came to it was right.
#[test]
fn a_recorder_that_leaves_nothing_of_what_the_file_held_is_found_whatever_it_writes() {
    let lost = Look::New(f64::INFINITY, "its file has not what was in it before it came".into());
    for is_spoilt in [false, true] {
        let mut probation = Probation::behind("anew");
        make(&probation.station.create_slot(slot(), 1).unwrap(), 1..=300);
        assert!(matches!(probation.look(100, 1, 300), Look::Still(_)), "it has written nothing");
        if is_spoilt {
            File::create(&probation.file).unwrap();
        }
        probation.append(101..=200);
        let look = probation.look(200, 1, 300);
        assert_eq!((look == lost, matches!(look, Look::New(ratio, _) if ratio < 1.0)), (is_spoilt, !is_spoilt), "{look:?}");
        probation.append(201..=300);
        assert_eq!(probation.look(300, 1, 300) == lost, is_spoilt, "however much it writes");
    }
}

#[test]
fn a_recorder_that_leaves_out_what_lies_between_is_found_but_where_the_device_was_over_before_it_could_have_it() {
    let holes = Look::New(f64::INFINITY, "its file leaves out 50 of the device's ticks".into());
    for restarts in [false, true] {
        let mut probation = Probation::behind("between");
        let old = probation.station.create_slot(slot(), 1).unwrap();
        make(&old, 1..=150);
        assert!(matches!(probation.look(100, 1, 150), Look::Still(_)));
        let life = if restarts { 2 } else { 1 };
        let new = if restarts { probation.station.create_slot(slot(), 2).unwrap() } else { old };
        make(&new, 151..=300);
        probation.append(151..=200);
        assert_eq!(probation.look(200, life, 300) == holes, !restarts);
        // From now on it has what the device makes, also of a life that is over.
        probation.append((201..=300).filter(|tick| *tick != 250));
        let look = probation.look(300, life, 300);
        assert!(matches!(&look, Look::New(ratio, _) if ratio.is_infinite()), "{look:?}");
    }
}

/// One that wrote nothing but ticks passed.
#[test]
fn a_recorder_that_forgets_what_the_one_before_wrote_beside_the_ticks_is_found() {
    let mut probation = Probation::behind("forgets");
    probation.recording.beside = Beside::behind([true, false, false], GUEST);
    make(&probation.station.create_slot(slot(), 1).unwrap(), 1..=3_000);
    let look = |probation: &mut Probation, present: u64| {
        probation.append(present - 249..=present);
        let came = probation.recording.read(&probation.station, [(slot(), 1)]);
        let has_begun = probation.recording.written.has_begun();
        probation.recording.beside.take(&came, present, [Some((5, present)), None, None], present, has_begun);
        probation.recording.flaw()
    };
    let flaws: Vec<Option<String>> = (350..3_000).step_by(250).map(|present| look(&mut probation, present)).collect();
    assert_eq!((flaws[0].as_deref(), flaws[2].as_deref()), (None, None));
    assert_eq!(flaws[4].as_deref(), Some("its file does not say that it has started"), "{flaws:?}");
    assert_eq!(flaws[6].as_deref(), Some("its file has no steps of the tissue any more"), "{flaws:?}");
}
