//! What is told of a replay that did not come to its end.

use super::*;
use hyst_recording::{Block, Session, Writer};

/// A recording of so many ticks with a force, and so many with a state.
fn recording(name: &str, ticks: u64, states: u64, force_n: impl Fn(u64) -> f32) -> PathBuf {
    let path = std::env::temp_dir().join(format!("hyst-compare-{}-{name}.mcap", std::process::id()));
    let _ = std::fs::remove_file(&path); // of the time before
    let mut writer = Writer::open(&path, &Session::from([("session".into(), name.into())])).unwrap();
    let applied = (1..=ticks).map(|tick| {
        let mut record = AppliedRecord { tick, ..AppliedRecord::default() };
        (record.command.tick, record.command.force_n[0]) = (tick, force_n(tick));
        record
    });
    let steps = (1..=states).map(|tick| {
        let (from_tick, state_hash) = (tick - 1, tick << 8);
        let ids = StepRecord { from_incarnation: 7, incarnation: 7, epoch: 1, step_ticks: 1, ..StepRecord::default() };
        StepRecord { tick, from_tick, state_hash, ..ids }
    });
    writer.append(&Block { applied: applied.collect(), steps: steps.collect(), ..Block::default() }).unwrap();
    writer.finish().unwrap();
    path
}

/// The tissue dies of tick 61 and no successor lives; the device goes on for 19 ticks until that is known.
#[test]
fn a_replay_that_ended_early_is_compared_up_to_the_first_state_that_was_not_made_again() {
    let steady = |_: u64| 0.25;
    let other_at = |other: u64| move |tick: u64| if tick == other { 0.5 } else { 0.25 };
    let was = recording("was", 100, 100, steady);
    let again = [
        recording("whole", 100, 100, steady),
        recording("less", 100, 60, steady),
        recording("short", 80, 60, steady),
        recording("differs", 80, 60, other_at(30)),
        recording("later", 80, 60, other_at(70)),
    ];
    let codes = |is_cut| again.each_ref().map(|again| compare(&was, again, 100, is_cut).unwrap());
    assert_eq!(codes(true), [3, 3, 3, 1, 3]);
    assert_eq!(codes(false), [0, 1, 3, 1, 3], "one that came to its end lacks no state, and one that did not was stopped");
    for path in again.iter().chain([&was]) {
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn a_replay_of_which_nothing_was_recorded_is_told_as_that() {
    let was = recording("was-alone", 10, 10, |_| 0.25);
    let none = was.with_extension("none");
    assert_eq!([true, false].map(|is_cut| compare(&was, &none, 10, is_cut)), [Ok(NOT_WHOLE), Ok(NOT_WHOLE)]);
    std::fs::remove_file(&was).unwrap();
}
