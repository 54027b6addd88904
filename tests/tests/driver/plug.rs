//! A device that is pulled out in the middle of a session: its driver ends, is started again, and looks for it. If it is back in time the hand feels the tissue
//! again, also one that holds on meanwhile; if it stays away the station ends, says why, and keeps what was recorded.

use super::{FOLDER, compile, most_n, newest_command};
use hyst_messages::AppliedRecord;
use rustix::process::Signal;
use station_tests::{Folder, RECOVERY_LIMIT, Station, hystation, run, wait_for};
use std::path::{Path, PathBuf};

/// A force that is felt, N: more than the gate of the last hop lets through at once. The hand that holds on is pushed with more than 0.38.
const FELT_N: f32 = 0.3;
/// Most that comes at once when the force returns, N: a fiftieth of the largest.
const AT_ONCE_N: f32 = 3.3 / 50.0;

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

fn length([x, y, z]: [f32; 3]) -> f32 {
    x.hypot(y).hypot(z)
}

/// The gate of the last hop was shut anew: whoever pressed on while the driver was started again felt nothing until he drew back. And a replay, which did not know
/// of it, made other forces from there on.
#[test]
fn a_hand_that_holds_on_while_its_driver_dies_feels_the_force_rise_again_and_so_does_a_replay() {
    let folder = Folder::new("driver-holds-on");
    let [held, file] = ["held", "session.mcap"].map(|name| folder.path(name));
    let source = Path::new(FOLDER).join("example_driver.c");
    let driver = compile(&folder, "holds-on", &source, &[&format!("-DHELD=\"{held}\"")]);
    let station = Station::start("driver-held", &["--driver", &driver.to_string_lossy()]);
    let is_felt = || wait_for(RECOVERY_LIMIT, || (length(newest_command(&station).force_n) > FELT_N).then_some(()));
    assert!(is_felt().is_some(), "no force\n{}", station.said());
    std::fs::write(&held, "").expect("from now on the hand is there from the first");
    let pid = station.pid("hardware", true);
    station.signal(pid, Signal::KILL);
    station.wait_until_gone(pid);
    station.recover();
    station.run_ticks(300); // the rise takes 50
    assert!(is_felt().is_some(), "nothing is felt under a hand that holds on\n{}", station.said());

    // The station's own copy goes with it.
    std::fs::hard_link(station.folder().join("session.mcap"), &file).expect("another name of its recording");
    let (name, ended) = (station.name().to_string(), station.stop());
    assert_eq!(ended.number("invalid_applied"), 0.0, "{}", ended.report);
    let recording = ended.recording.as_ref().unwrap_or_else(|error| panic!("{error}\n{}", ended.said));
    let is_anew = |pair: &[AppliedRecord]| pair[1].sample.hardware_tick < pair[0].sample.hardware_tick;
    let anew = 1 + recording.applied().windows(2).position(is_anew).expect("another life of the driver");
    let (before, after) = recording.applied().split_at(anew);
    assert!(before.iter().any(|record| length(record.command.force_n) > FELT_N), "{} ticks", before.len());
    let first = &after[0];
    assert_eq!(first.before_n, [0.0; 3], "its motors make nothing when it says its first word");
    assert!(length(first.command.force_n) <= AT_ONCE_N, "it jumps to {:?} N", first.command.force_n);
    assert!(after.iter().any(|record| length(record.command.force_n) > FELT_N), "{} ticks", after.len());
    let (code, out, said) = run(hystation().args(["--name", &name, "replay", &file, "--verify"]));
    // 3: this machine did not let the device of the replay run.
    assert!(matches!(code, Some(0 | 3)) && out.contains("the same to the bit"), "{code:?} {out}{said}");
}
