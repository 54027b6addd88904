//! A tissue that is swapped while the electrode cuts: a good one has the role in the pauses and keeps it in the end, a bad one is rolled back, and nothing that was
//! cut comes back.

use super::copy;
use hyst_messages::TissueStatus;
use station_tests::shown::not_shown;
use station_tests::swapped::{got_no_time, swap};
use station_tests::{Ended, RECOVERY_LIMIT, Station, bad_engine, hystation, run, wait_for};

const CASE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/cases/myoma.toml");
/// Tries of a swap: each ends within a minute, and the hand cuts for 100 s.
const TRIES: usize = 2;
/// Said of a newcomer that has given the role back.
const AGAIN: &str = "in the shadow again";

/// Of the states that were recorded none has cut or removed less than one before it.
fn assert_nothing_comes_back(ended: &Ended) {
    let recording = ended.recording.as_ref().unwrap_or_else(|error| panic!("{error}\n{}", ended.said));
    let mut newest: Option<&TissueStatus> = None;
    for after in &recording.content.tissue {
        // Who has the role again is seen first by what it said when it had it before.
        if newest.is_some_and(|before| after.state_tick <= before.state_tick) {
            continue;
        }
        let Some(before) = newest.replace(after) else { continue };
        let is_kept = after.cuts >= before.cuts
            && after.removed_volume_ml >= before.removed_volume_ml
            && after.healthy_removed_ml >= before.healthy_removed_ml;
        assert!(is_kept, "{before:?}, then {after:?}\n{}", ended.said);
    }
    assert!(newest.is_some_and(|last| last.cuts > 0), "nothing was cut: {newest:?}\n{}", ended.said);
}

/// A fault that waits for a stroke comes while the electrode cuts; between the two the stroke may end.
fn hurt_in_a_stroke(station: &Station) {
    let is_hurt_in_one = || {
        let inject = ["fault", "inject", "kill", "haptic:spare", "--state", "cutting"];
        let (code, told, said) = run(hystation().args(["--name", station.name()]).args(inject));
        assert!(code == Some(0) && told.contains("in state cutting"), "{code:?} {told} {said}");
        station.recover();
        told.trim_end().ends_with("; in state cutting").then_some(())
    };
    assert!(wait_for(RECOVERY_LIMIT, is_hurt_in_one).is_some(), "{}", station.said());
}

/// A good one was rolled back and blamed: it and the old engine lose other ticks to the machine, cut at other places, and then have meshes that are not the same, or a
/// piece that floats is elsewhere. One blame in the tries is named and not more: on a machine that is too slow for three tissues the scope touched such a piece at
/// another place although no tick was lost (2026-11-30, a contact force 0.46 N apart where 0.29 are allowed; one run of three).
#[test]
fn a_tissue_is_swapped_between_the_strokes_of_a_hand_that_cuts_and_nothing_that_was_cut_comes_back() {
    let station = Station::start("strokes", &[CASE, "--hand", "script:slices", "--test-mode"]);
    let has_cut = || (station.tissue_status().cuts > 0).then_some(());
    assert!(wait_for(RECOVERY_LIMIT, has_cut).is_some(), "the hand cuts nothing: {}", station.said());
    hurt_in_a_stroke(&station);
    let (mut is_swapped, mut blamed) = (false, 0);
    for round in 0..TRIES {
        let (mine, cuts) = (copy(&station, "tissue", round), station.tissue_status().cuts);
        let (code, record, said) = swap(&station, "tissue", &mine);
        let is_blamed = code == Some(1) && record["cause"] == "out-of-tolerance";
        if is_blamed {
            blamed += 1;
            println!("a good tissue was blamed: {}", record["reason"]);
        }
        let is_fair = code == Some(0) || code == Some(1) && got_no_time(&record) || is_blamed && blamed == 1;
        assert!(is_fair, "{code:?} {record:#}\n{said}\n{}", station.said());
        station.recover();
        is_swapped = code == Some(0);
        if is_swapped {
            // No pause is as long as a probation.
            let has_yielded =
                record["steps"].as_array().is_some_and(|steps| steps.iter().any(|step| step.to_string().contains(AGAIN)));
            assert!(has_yielded && station.tissue_status().cuts > cuts, "{record:#}\n{}", station.said());
            let runs_mine = |process: &serde_json::Value| process["binary"].as_str() == mine.to_str();
            assert!(station.processes("tissue").iter().all(runs_mine), "{}", station.status());
            break;
        }
    }
    if !is_swapped {
        not_shown(&format!("a swap of a tissue that cuts: {TRIES} times the newcomer got no time"));
    }
    // Under load it may lose the role before it has come so far as to die.
    let (code, record, said) = swap(&station, "tissue", &bad_engine(station.folder(), "tissue", "segfault"));
    let is_own = ["died", "hung", "missed"].iter().any(|cause| record["cause"] == *cause);
    assert!(code == Some(1) && (is_own || got_no_time(&record)), "{code:?} {record:#}\n{said}\n{}", station.said());
    station.recover();
    let ended = station.stop();
    ended.assert_clean();
    assert_nothing_comes_back(&ended);
}
