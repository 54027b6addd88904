//! What came of the faults of a station in test mode, as its supervisor's report has it, which lies in the station's root and is a second old at most. Promise:
//! nobody is asked for it, what is kept of it is bounded, and a report that cannot be read has no faults.

use hyst_exchange::Station;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;

/// The newest that are shown.
pub const MOST_OUTCOMES: usize = 12;
/// Longest report that is read, bytes: one of a thousand faults is shorter.
const MOST_BYTES: u64 = 4 << 20;

/// What the hand lost in a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Lost {
    /// Ticks that count.
    pub ticks: u64,
    /// Those of them without a fresh force.
    pub missed: u64,
}

/// One fault. What is not said is zero, empty or none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Outcome {
    /// `kill`, `stop` …, or `external` of one that nobody injected.
    pub kind: String,
    /// The slot that it hit.
    pub target: String,
    /// It hit the one that did the role's work.
    pub active: bool,
    /// Station tick of the injection.
    pub tick: u64,
    /// It has come about.
    pub manifested: bool,
    /// Who found it, or how.
    pub detected_by: String,
    /// From the injection until then, µs.
    pub detected_us: Option<f64>,
    /// From the injection until it was over, µs.
    pub recovered_us: Option<f64>,
    /// Whether the promise was held; `None` while it is not judged, or where it cannot be.
    pub promise_held: Option<bool>,
    /// In its window, once it is judged.
    pub window: Option<Lost>,
    /// In the control of that, if there was one.
    pub control: Option<Lost>,
}

/// The newest faults of a station, the newest first.
pub fn read(station: &Station) -> Vec<Outcome> {
    let Ok(file) = File::open(station.report()) else { return Vec::new() };
    let mut text = Vec::new();
    let _ = file.take(MOST_BYTES).read_to_end(&mut text); // what is cut is no report
    newest(&text)
}

/// What of a report is read.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Report {
    faults: Vec<Outcome>,
}

fn newest(text: &[u8]) -> Vec<Outcome> {
    let Report { mut faults } = serde_json::from_slice(text).unwrap_or_default();
    faults.sort_by_key(|fault| std::cmp::Reverse(fault.tick));
    faults.truncate(MOST_OUTCOMES);
    faults
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_newest_faults_of_a_report_come_first_and_nonsense_has_none() {
        let fault = |tick: u64| json!({ "kind": "kill", "target": "haptic:0", "tick": tick, "slot": 2, "window": null });
        let many: Vec<_> = (0..2 * MOST_OUTCOMES as u64).map(fault).collect();
        let found = newest(json!({ "faults": many, "device": {} }).to_string().as_bytes());
        assert_eq!((found.len(), found[0].tick, found[1].tick), (MOST_OUTCOMES, 23, 22));
        assert_eq!((found[0].kind.as_str(), found[0].window, found[0].promise_held), ("kill", None, None));
        for nonsense in [&b""[..], b"{\"faults\":[{\"kind\":", b"[]", b"{\"faults\":7}", b"{}", b"\xff"] {
            assert!(newest(nonsense).is_empty(), "{nonsense:?}");
        }
    }

    #[test]
    fn a_fault_that_was_judged_says_what_the_hand_lost_and_a_station_without_a_report_has_none() {
        let station = Station::named(&format!("t{}-outcomes", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(read(&station), []);
        let window = |missed: u64| json!({ "from_tick": 5, "to_tick": 237, "ticks": 232, "missed": missed, "late": 0 });
        let fault = json!({
            "kind": "stop", "target": "tissue:1", "active": true, "tick": 5, "manifested": true, "detected_by": "heartbeat",
            "detected_us": 3100.5, "recovered_us": 211000.0, "promise_held": false, "window": window(4), "control": window(1),
        });
        std::fs::write(station.report(), json!({ "faults": [fault] }).to_string()).unwrap();
        let found = read(&station);
        station.wipe();
        let lost = |missed: u64| Some(Lost { ticks: 232, missed });
        let judged = Outcome {
            kind: "stop".into(),
            target: "tissue:1".into(),
            active: true,
            tick: 5,
            manifested: true,
            detected_by: "heartbeat".into(),
            detected_us: Some(3_100.5),
            recovered_us: Some(211_000.0),
            promise_held: Some(false),
            window: lost(4),
            control: lost(1),
        };
        assert_eq!(found, [judged]);
    }
}
