//! What came of one run of a station: a line of `stations.jsonl` in the folder of the results, and what in it is a broken promise.

use super::deficit::Deficit;
use super::last::LastForces;
use super::origin::Origin;
use crate::fault::{EXTERNAL, Fault};
use crate::report::BROKEN;
use hyst_recording::sequence::RING_TICKS;
use hyst_recording::{Continuity, Ending, Reader};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// What came of one run of a station.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StationOutcome {
    /// Number of the run, from 0; its files are named by it.
    pub run: usize,
    /// By which programs it was run, where and when; none of those that were run before that was noted.
    #[serde(default)]
    pub origin: Option<Origin>,
    /// It had no canaries: of a stall of the host nobody knows, and its ticks count as any other.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub blind: bool,
    /// Number of the station in the plan; more than once if it was started again to go on.
    pub station: usize,
    /// Arm.
    pub arm: String,
    /// Faults that it suffered, by their numbers.
    pub faults: Vec<usize>,
    /// Faults that were to come in it and were skipped, by their numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<usize>,
    /// Exit code of `hystation run`; none if it had to be killed. A 1 is no verdict here: it is what a run says of its own faults, which the campaign judges by
    /// their cells.
    pub exit_code: Option<i32>,
    /// Promises that its report says were broken, in its words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub promises_broken: Vec<String>,
    /// Why it ended before its faults were through.
    pub trouble: String,
    /// It was never whole: of what it left nothing is asked but that it is nothing.
    #[serde(default)]
    pub never_whole: bool,
    /// Ticks of the hardware.
    pub ticks: u64,
    /// Ticks in which the host itself stalled.
    pub voided: u64,
    /// Forces applied that were not finite or beyond any motor.
    pub invalid_applied: u64,
    /// Forces applied that were older than one applied before.
    pub stale_applied: u64,
    /// Ticks whose contact model was older than that of the tick before, as the recording has them.
    #[serde(default)]
    pub stale_models: u64,
    /// The same of the medium that the tissue was told of.
    #[serde(default)]
    pub stale_media: u64,
    /// Jumps of the fluid's deficit that its own flows do not explain, as the recording has them: tick of the state and ml.
    #[serde(default)]
    pub deficit_jumps: Vec<(u64, f64)>,
    /// Slots that were given up.
    pub given_up: Vec<String>,
    /// Processes, segments and files that were left, as the station says or as the campaign found, whichever is more.
    pub leftovers: u64,
    /// Processes that ended although nobody hurt them, to the end of the run.
    #[serde(default)]
    pub external: Vec<Fault>,
    /// Whether there was a report.
    pub reported: bool,
    /// Largest force step in a control window, N.
    pub control_step_max_n: f64,
    /// Largest force step in the last ticks of the recording, N; `None` without two ticks there.
    #[serde(default)]
    pub last_step_max_n: Option<f64>,
    /// Ticks in the recording.
    pub recorded_ticks: u64,
    /// Ticks that the recording says are lost: first and last.
    pub lost: Vec<(u64, u64)>,
    /// Ticks of the recording that are not there although nobody says that they are lost or were never made.
    #[serde(default)]
    pub missing_ticks: u64,
    /// Ticks that it holds twice, or out of order.
    #[serde(default)]
    pub repeated_ticks: u64,
    /// What is wrong with the recording itself, or why it cannot be read.
    pub damage: Vec<String>,
}

/// Ticks of the hardware that need not be in the recording: those before the device made its first, and at the end those after its last.
const MOST_UNRECORDED: u64 = RING_TICKS;

impl StationOutcome {
    /// Takes what a station's report says.
    pub fn read_report(&mut self, path: &Path) {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let report: Value = serde_json::from_str(&text).unwrap_or_default();
        let number = |value: &Value| value.as_u64().unwrap_or(0);
        self.reported = report["device"]["ticks"].is_u64();
        self.ticks = number(&report["device"]["ticks"]);
        self.voided = number(&report["device"]["voided"]);
        self.invalid_applied = number(&report["invalid_applied"]);
        self.stale_applied = number(&report["stale_applied"]);
        self.control_step_max_n = report["device"]["force_step_max_control_n"].as_f64().unwrap_or(0.0);
        let faults = report["faults"].as_array().into_iter().flatten().filter(|fault| fault["kind"] == EXTERNAL);
        self.external = faults.filter_map(|fault| Fault::deserialize(fault).ok()).collect();
        let words = |key: &str| {
            let all = report[key].as_array().into_iter().flatten();
            all.filter_map(|word| word.as_str().map(str::to_string)).collect::<Vec<String>>()
        };
        (self.given_up, self.promises_broken) = (words("given_up"), words(BROKEN));
        let left = report["leftovers"].as_object().map_or(0, |left| left.values().map(number).sum());
        self.leftovers = self.leftovers.max(left);
    }

    /// The faults that are through with it: those that it suffered, and those that were skipped.
    pub fn through(&self) -> impl Iterator<Item = usize> {
        self.faults.iter().chain(&self.skipped).copied()
    }

    /// Whether its recording is worth keeping.
    pub fn recording_shows_something(&self) -> bool {
        !self.lost.is_empty() || !self.damage.is_empty() || self.missing_ticks + self.repeated_ticks > 0
    }

    /// Leaves out those that ended since a time, ns: of a fault that was cut off and will be injected again.
    pub fn forget_since(&mut self, ns: u64) {
        self.external.retain(|fault| fault.injected_ns < ns);
    }

    /// Counts what the recording holds, what it says is lost and what it does not say. Comes after the report, which has the ticks that there were.
    pub fn read_recording(&mut self, path: &Path) {
        let mut reader = match Reader::open(path) {
            Ok(reader) => reader,
            Err(error) => return self.damage.push(error.to_string()),
        };
        let (mut newest, mut newest_medium) = ((0, 0), (0, 0));
        let (mut deficit, mut continuity, mut last) = (Deficit::default(), Continuity::default(), LastForces::default());
        loop {
            match reader.next_block() {
                Ok(Some(block)) => {
                    continuity.follow(&block);
                    for applied in &block.applied {
                        last.follow(applied);
                        let model = (applied.model_epoch, applied.model_tick);
                        self.stale_models += u64::from(model < newest && model != (0, 0));
                        newest = newest.max(model);
                        let medium = (applied.medium_epoch, applied.medium_tick);
                        self.stale_media += u64::from(medium < newest_medium && medium != (0, 0));
                        newest_medium = newest_medium.max(medium);
                    }
                    block.fluid.into_iter().for_each(|status| deficit.follow(status));
                    self.lost.extend(block.lost.iter().map(|range| (range.first, range.last)));
                }
                Ok(None) => break,
                Err(error) => {
                    self.damage.push(error.to_string());
                    break;
                }
            }
        }
        (self.deficit_jumps, self.last_step_max_n) = (deficit.jumps(), last.step_max_n());
        (self.recorded_ticks, self.repeated_ticks) = (continuity.ticks, continuity.repeated);
        let beyond =
            self.ticks.saturating_sub(continuity.ticks).saturating_sub(continuity.lost()).saturating_sub(continuity.unmade);
        self.missing_ticks = continuity.missing().max(if beyond > MOST_UNRECORDED { beyond } else { 0 });
        self.damage.extend(reader.damage().iter().map(|damage| format!("byte {}: {}", damage.at, damage.reason)));
        if !matches!(reader.ending(), Some(Ending::Complete)) {
            self.damage.push("the recording was not closed by its writer".into());
        }
    }

    /// Whether it ended by itself after a fault, or did not become whole again.
    pub fn did_not_go_on(&self) -> bool {
        !self.given_up.is_empty() || (!self.trouble.is_empty() && !self.faults.is_empty())
    }

    /// How it came to its end, if it did not go on.
    pub fn end_in_words(&self) -> String {
        let given_up = (!self.given_up.is_empty()).then(|| format!("{} did not come back", self.given_up.join(", ")));
        let trouble = (!self.trouble.is_empty()).then(|| self.trouble.clone());
        trouble.into_iter().chain(given_up).collect::<Vec<_>>().join("; ")
    }

    /// What was broken in it as a whole, in words; that it did not go on is none where it `may_end`. What it did to the hand, and what it left, always is.
    pub fn broken(&self, may_end: bool) -> Vec<String> {
        let mut found = Vec::new();
        let mut note = |is: bool, text: String| {
            if is {
                found.push(format!("arm {}, run {}: {text}", self.arm, self.run));
            }
        };
        // Who ends in the middle closes no file and may leave no report.
        let is_excused = may_end || self.never_whole;
        note(self.did_not_go_on() && !may_end, format!("after {} faults: {}", self.faults.len(), self.end_in_words()));
        let code = self.exit_code.map_or("none, it had to be killed".into(), |code| code.to_string());
        // Promises that the run says are broken are judged by the cells; ticks that its recording says are lost, with the faults that they were lost to.
        let is_judged = self.exit_code == Some(3) && self.given_up.is_empty() && !self.lost.is_empty();
        note(!matches!(self.exit_code, Some(0 | 1)) && !is_excused && !is_judged, format!("its exit code is {code}"));
        note(
            self.stale_models > 0,
            format!("{} ticks used a contact model older than that of the tick before", self.stale_models),
        );
        note(
            self.stale_media > 0,
            format!("{} ticks told the tissue of a medium older than that of the tick before", self.stale_media),
        );
        let damage = self.damage.first().map_or("", String::as_str);
        note(
            !self.damage.is_empty() && !is_excused,
            format!("its recording is damaged in {} places: {damage}", self.damage.len()),
        );
        note(
            self.missing_ticks > 0 && !is_excused,
            format!("{} ticks are not in its recording, and it does not say so", self.missing_ticks),
        );
        note(self.repeated_ticks > 0, format!("{} ticks are in its recording twice or out of order", self.repeated_ticks));
        note(self.invalid_applied > 0, format!("{} invalid forces were applied", self.invalid_applied));
        note(self.stale_applied > 0, format!("{} stale forces were applied", self.stale_applied));
        note(self.leftovers > 0, format!("{} processes, segments or files were left over", self.leftovers));
        note(!self.reported && !is_excused, "it left no report".into());
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_names_who_ended_unhurt_and_those_of_a_fault_that_was_cut_off_are_left_out() {
        let fault = |kind: &str, injected_ns: u64| Fault { kind: kind.into(), injected_ns, ..Fault::default() };
        let faults = [fault("external", 5), fault("kill", 6), fault("external", 9)];
        let path = std::env::temp_dir().join(format!("hystation-report-{}.json", std::process::id()));
        let broken = ["fault kill of haptic:1 at tick 9000: the hand lost 53 ticks, 0 at most without a fault"];
        let report = serde_json::json!({ "device": { "ticks": 4 }, "faults": faults, "promises_broken": broken });
        std::fs::write(&path, report.to_string()).unwrap();
        let mut station = StationOutcome::default();
        station.read_report(&path);
        std::fs::remove_file(&path).unwrap();
        assert_eq!((station.reported, &station.external), (true, &vec![faults[0].clone(), faults[2].clone()]));
        assert_eq!(station.promises_broken, broken);
        let line = serde_json::to_string(&station).unwrap();
        assert!(line.contains(broken[0]), "whoever reads that it ended with 1 reads why: {line}");
        station.forget_since(9);
        assert_eq!(station.external, [faults[0].clone()]);
    }
}
