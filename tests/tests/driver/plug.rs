//! A device that is pulled out in the middle of a session: its driver ends, is started again, and looks for it. If it is back in time the hand feels the tissue
//! again; if it stays away the station ends, says why, and keeps what was recorded.

use super::{FOLDER, compile, most_n};
use station_tests::{Folder, RECOVERY_LIMIT, Station, wait_for};
use std::path::{Path, PathBuf};

/// The example with a plug: the file that is its device, and whether its loop runs in a thread beside `main`.
fn plugged(folder: &Folder, in_a_callback: bool) -> (PathBuf, PathBuf) {
    let plug = folder.write("plug", "");
    let flags = [format!("-DPLUG=\"{plug}\""), format!("-DCALLBACK={}", u8::from(in_a_callback))];
    let source = Path::new(FOLDER).join("example_driver.c");
    (compile(folder, "plugged", &source, &flags.each_ref().map(String::as_str)), PathBuf::from(plug))
}

fn wait_for_word(station: &Station, word: &str) {
    let told = wait_for(RECOVERY_LIMIT, || station.said().contains(word).then_some(()));
    assert!(told.is_some(), "nobody says {word:?}: {}", station.said());
}

#[test]
fn a_device_that_is_pulled_out_and_back_in_time_is_felt_again() {
    for in_a_callback in [false, true] {
        let folder = Folder::new("driver-back");
        let (driver, plug) = plugged(&folder, in_a_callback);
        let station = Station::start("driver-back", &["--driver", &driver.to_string_lossy()]);
        let before = most_n(&station, 4_000);
        assert!((0.2..=2.0).contains(&before), "{before} N\n{}", station.said());
        std::fs::remove_file(&plug).expect("it is plugged in");
        wait_for_word(&station, "the device is gone");
        wait_for_word(&station, "the device is not plugged in");
        std::fs::write(&plug, "").expect("it is plugged in again");
        station.recover();
        let after = most_n(&station, 4_500);
        assert!((0.2..=2.0).contains(&after), "in a callback {in_a_callback}: {after} N\n{}", station.said());
        let ended = station.stop();
        assert_eq!(ended.number("invalid_applied"), 0.0, "{}", ended.report);
    }
}

/// It ended with the code of a failure, as if the driver had crashed.
#[test]
fn a_device_that_is_pulled_out_and_stays_away_ends_the_station_with_code_3_and_a_whole_recording() {
    let folder = Folder::new("driver-away");
    let (driver, plug) = plugged(&folder, false);
    let station = Station::start("driver-away", &["--driver", &driver.to_string_lossy()]);
    station.run_ticks(2_000);
    std::fs::remove_file(&plug).expect("it is plugged in");
    wait_for_word(&station, "hardware is given up");
    let place = station.place();
    let gone = wait_for(RECOVERY_LIMIT, || place.leftovers().is_empty().then_some(()));
    assert!(gone.is_some(), "left: {:?}\n{}", place.leftovers(), station.said());
    let ended = station.stop();
    assert_eq!(ended.code, Some(3), "{}", ended.said);
    assert!(ended.said.contains("the device is not plugged in: plug it in"), "{}", ended.said);
    let recording = ended.recording.as_ref().unwrap_or_else(|error| panic!("{error}\n{}", ended.said));
    assert!(recording.damage.is_empty(), "{:?}", recording.damage);
    assert!(recording.applied().len() > 2_000, "{} ticks", recording.applied().len());
}
