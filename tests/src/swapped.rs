//! Swaps, as an operator asks for them, and what one of the fluid must not lose.

use crate::shown::not_shown;
use crate::{Ended, RECOVERY_LIMIT, Station, hystation, run, wait_for};
use hyst_messages::FluidStatus;
use serde_json::Value;
use std::path::Path;

/// Two states of the fluid that are farther apart may have seen flows between them that neither names, ticks.
const NEAR_TICKS: u64 = 200;
/// How many times as fast as two states name it the deficit may go between them, and how far where they name nothing, ml: a scope of 5 mm that goes
/// 5 mm into a full cavity.
const MOST_TIMES: f64 = 5.0;
const MOST_UNNAMED_ML: f64 = 0.1;

/// Swaps; gives the exit code, and the record of what happened or what was said.
pub fn swap(station: &Station, role: &str, binary: &Path) -> (Option<i32>, Value, String) {
    let try_it = || {
        let (code, out, said) = run(hystation().args(["--name", station.name(), "swap", role, "--json"]).arg(binary));
        // On a busy machine a process is replaced now and then for another reason; nobody swaps while one of the role is missing.
        let again = code == Some(2) && said.contains("is not ready now");
        (!again).then(|| (code, serde_json::from_str(&out).unwrap_or(Value::Null), said))
    };
    wait_for(RECOVERY_LIMIT, try_it).unwrap_or_else(|| panic!("{role} does not become whole: {}", station.status()))
}

/// Waits until nothing lives that a bad engine which `forks` has started, as it was asked what it is or in a station: `sh`, with that engine's file as its last
/// word.
pub fn assert_left_nobody(engine: &Path) {
    let ends = [b"\0".as_slice(), engine.as_os_str().as_encoded_bytes(), b"\0"].concat();
    let is_gone = || {
        let folders = std::fs::read_dir("/proc").expect("what runs").flatten();
        let mut lines = folders.filter_map(|folder| std::fs::read(folder.path().join("cmdline")).ok());
        (!lines.any(|line| line.starts_with(b"sh\0") && line.ends_with(&ends))).then_some(())
    };
    assert!(wait_for(RECOVERY_LIMIT, is_gone).is_some(), "what {} has started lives on", engine.display());
}

/// Whether a newcomer was rolled back because the machine left it no time to show what it is.
pub fn got_no_time(record: &Value) -> bool {
    record["cause"] == "no-time"
}

/// Whether of two states of the fluid one was made by the example's engine, which says no step, and the other by the station's own.
fn is_swapped(before: &FluidStatus, after: &FluidStatus) -> bool {
    (before.step_ticks == 0) != (after.step_ticks == 0)
}

/// The deficit goes on from state to state as the flows that they name move it, from the station's own fluid to the example's too, and back: one that lost
/// a part of it, or began anew, is seen by its jump.
pub fn assert_deficit_goes_on(ended: &Ended) {
    let recording = ended.recording.as_ref().unwrap_or_else(|error| panic!("{error}\n{}", ended.said));
    let net_ml = |status: &FluidStatus| f64::from(status.inflow_ml_min - status.outflow_ml_min) / 60_000.0;
    let (mut newest, mut swaps): (Option<&FluidStatus>, usize) = (None, 0);
    for after in &recording.content.fluid {
        if newest.is_some_and(|before| after.state_tick <= before.state_tick) {
            continue;
        }
        let Some(before) = newest.replace(after) else { continue };
        let ticks = after.state_tick - before.state_tick;
        if ticks > NEAR_TICKS {
            continue;
        }
        swaps += usize::from(is_swapped(before, after));
        let gone_ml = after.deficit_ml - before.deficit_ml;
        let named = [before, after].map(|status| gone_ml.signum() * net_ml(status) * ticks as f64);
        let is_named = gone_ml.abs() <= MOST_TIMES * named.into_iter().fold(0.0, f64::max) + MOST_UNNAMED_ML;
        assert!(is_named, "the deficit went by {gone_ml} ml: {before:?}, then {after:?}\n{}", ended.said);
    }
    if swaps == 0 {
        not_shown("that a swap of the fluid loses nothing of the deficit: no states on both sides of one were recorded");
    }
}

/// The report tells of every swap that was begun, in the order in which they were asked for: when that was, and how each was over.
pub fn assert_swaps_are_told(ended: &Ended) {
    let swaps = ended.report["swaps"].as_array().unwrap_or_else(|| panic!("{:#}", ended.report));
    let numbers: Vec<u64> = swaps.iter().filter_map(|swap| swap["number"].as_u64()).collect();
    assert!(!numbers.is_empty() && numbers == (1..=numbers.len() as u64).collect::<Vec<u64>>(), "{swaps:#?}");
    let ticks: Vec<Option<u64>> = swaps.iter().map(|swap| swap["tick"].as_u64()).collect();
    assert!(ticks.iter().all(Option::is_some) && ticks.is_sorted(), "{swaps:#?}");
    for swap in swaps {
        let last = swap["steps"].as_array().and_then(|steps| steps.last()).map_or(&Value::Null, |step| &step["what"]);
        let is_told = match swap["became"].as_str() {
            Some("done") => last.as_str().is_some_and(|what| what.starts_with("done: ")) && swap["cause"].is_null(),
            Some("rolled_back") => last.is_string() && swap["cause"].is_string() && swap["reason"] != "",
            Some("refused") => last.is_null() && swap["number"].is_null() && swap["reason"] != "",
            _ => false,
        };
        assert!(is_told, "{swap:#}");
    }
}
