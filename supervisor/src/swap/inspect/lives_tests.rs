//! A recorder is judged over a restart of the device as it is without one.

use super::*;
use hyst_messages::AppliedRecord;
use hyst_messages::page::device::APPLIED;
use hyst_recording::{Block, Session, Writer};

fn made(tick: u64) -> AppliedRecord {
    AppliedRecord { tick, ..AppliedRecord::default() }
}

/// The last block before the device's death comes when its next life has made nothing yet: it was dropped, and the recorder rolled back.
#[test]
fn a_recorder_is_good_though_the_device_died_before_its_last_ticks_were_in_the_file() {
    let station = Station::named(&format!("t{}-restart", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    let slot = Slot::first(Role::Device);
    let [old, new] = [1, 2].map(|incarnation| station.create_slot(slot, incarnation).unwrap());
    (1..=300).for_each(|tick| old.push(APPLIED, tick, &made(tick)));
    let file = station.root().join("session.mcap");
    let mut writer = Writer::open(&file, &Session::from([("session".into(), "s".into())])).unwrap();
    let mut append = |ticks: Vec<u64>| {
        let applied = ticks.into_iter().map(made).collect();
        writer.append(&Block { applied, ..Block::default() }).unwrap();
    };
    let mut recording = Recording::of(Some(&file));
    let mut look_at_one_that_says = |last_tick: u64, incarnation: u32| {
        recording.read(&station, [(slot, incarnation)]);
        let bytes = std::fs::metadata(&file).unwrap().len();
        let status = RecorderStatus { last_tick, ticks: last_tick, lost: 0, bytes };
        let newest = recording.lives.newest_tick();
        recording.look(Some(status), Some(bytes), newest, 500)
    };
    assert!(matches!(look_at_one_that_says(200, 1), Look::Still(_)));
    append((201..=300).collect());
    let last = look_at_one_that_says(300, 2);
    assert!(matches!(&last, Look::New(ratio, _) if *ratio < 1.0), "{last:?}");
    assert_eq!(look_at_one_that_says(300, 2), Look::Idle, "the new device has made none");
    (320..=400).for_each(|tick| new.push(APPLIED, tick, &made(tick)));
    append((320..=400).collect());
    let next = look_at_one_that_says(400, 2);
    assert!(matches!(&next, Look::New(ratio, _) if *ratio < 1.0), "{next:?}");
    (401..=500).for_each(|tick| new.push(APPLIED, tick, &made(tick)));
    append((401..=500).filter(|tick| *tick != 450).collect());
    assert_eq!(look_at_one_that_says(500, 2), Look::New(f64::INFINITY, "its file leaves out 1 of the device's ticks".into()));
    station.wipe();
}
