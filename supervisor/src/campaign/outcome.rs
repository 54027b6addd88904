//! What came of one fault and of one station: the lines of `results.jsonl` and `stations.jsonl` in the folder of the results.

use super::draw::Entry;
use crate::fault::Fault;
use hyst_recording::{Ending as FileEnding, Reader};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// How the wait for a fault ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// It was injected and closed by the supervisor.
    Closed,
    /// It was injected, and no verdict came in time.
    #[default]
    Open,
    /// The supervisor refused it.
    Refused,
    /// The station was not in the wanted state in time.
    NoState,
}

/// What tissue and fluid say of themselves at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Station tick.
    pub tick: u64,
    /// Tick of the tissue's newest state.
    pub tissue_tick: u64,
    /// Tick of the fluid's newest state.
    pub fluid_tick: u64,
    /// Contacts of the tool.
    pub contacts: u32,
    /// Deficit of the medium, ml.
    pub deficit_ml: f64,
    /// Volume removed, ml.
    pub removed_volume_ml: f64,
    /// Tick at which a state of tissue or fluid last began anew, from a checkpoint or from the scene.
    #[serde(default)]
    pub founded_tick: u64,
}

/// Fastest change of the deficit that is no loss of a counter, ml per tick: 1.5 l/min, twice what the pump can do.
const MOST_DEFICIT_ML_PER_TICK: f64 = 0.025;

impl Counters {
    /// What went back or jumped between two looks, in words: state and counters outlive every restart. A state that stands still is no loss:
    /// on a machine that is busy elsewhere fluid gets no time for seconds.
    pub fn broken_by(&self, after: &Counters) -> Option<String> {
        let ticks = after.tick.saturating_sub(self.tick) as f64;
        let jump_ml = (after.deficit_ml - self.deficit_ml).abs();
        match () {
            () if after.tissue_tick < self.tissue_tick => {
                Some(format!("tissue's state went from tick {} to {}", self.tissue_tick, after.tissue_tick))
            }
            () if after.fluid_tick < self.fluid_tick => {
                Some(format!("fluid's state went from tick {} to {}", self.fluid_tick, after.fluid_tick))
            }
            () if after.founded_tick > self.founded_tick => {
                Some(format!("a state began anew at tick {}, and not from its predecessor", after.founded_tick))
            }
            () if after.removed_volume_ml < self.removed_volume_ml => Some("the removed volume went back".into()),
            () if jump_ml.is_nan() || jump_ml > MOST_DEFICIT_ML_PER_TICK * ticks + 0.1 => {
                Some(format!("the deficit went from {:.3} ml to {:.3} ml in {ticks} ticks", self.deficit_ml, after.deficit_ml))
            }
            () => None,
        }
    }
}

/// What came of one fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Number in the plan.
    pub index: usize,
    /// Number of the station.
    pub station: usize,
    /// Arm.
    pub arm: String,
    /// Cell.
    pub cell: String,
    /// Tick that was drawn.
    pub planned_tick: u64,
    /// Tick at which it was injected; later than drawn if the station was not ready, or not in the wanted state.
    pub tick: u64,
    /// Place in the tick that was drawn, µs.
    pub phase_us: u32,
    /// Place in the tick at which it was injected, µs.
    pub injected_phase_us: u32,
    /// How it ended.
    pub ending: Ending,
    /// Why, if not by a verdict.
    pub reason: String,
    /// What the supervisor knows of it.
    pub fault: Option<Fault>,
    /// The fault in whose recovery it came.
    pub with: Option<Fault>,
    /// Faults that nobody injected and that were closed meanwhile.
    pub collateral: Vec<Fault>,
    /// Before it.
    pub before: Counters,
    /// After its verdict.
    pub after: Counters,
}

impl Outcome {
    /// Before anything has come of it.
    pub fn of(entry: &Entry) -> Outcome {
        Outcome {
            index: entry.index,
            station: entry.station,
            arm: entry.arm.clone(),
            cell: entry.cell.clone(),
            planned_tick: entry.tick,
            tick: entry.tick,
            phase_us: entry.phase_us,
            injected_phase_us: entry.phase_us,
            ending: Ending::Open,
            reason: String::new(),
            fault: None,
            with: None,
            collateral: Vec::new(),
            before: Counters::default(),
            after: Counters::default(),
        }
    }
}

/// What came of one run of a station.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StationOutcome {
    /// Number of the run, from 0; its files are named by it.
    pub run: usize,
    /// Number of the station in the plan; more than once if it was started again to go on.
    pub station: usize,
    /// Arm.
    pub arm: String,
    /// Faults that it suffered, by their numbers.
    pub faults: Vec<usize>,
    /// Exit code of `hystation run`; none if it had to be killed.
    pub exit_code: Option<i32>,
    /// Why it ended before its faults were through.
    pub trouble: String,
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
    /// Slots that were given up.
    pub given_up: Vec<String>,
    /// Processes, segments and files that were left.
    pub leftovers: u64,
    /// Whether there was a report.
    pub reported: bool,
    /// Largest force step in a control window, N.
    pub control_step_max_n: f64,
    /// Ticks in the recording.
    pub recorded_ticks: u64,
    /// Ticks that the recording says are lost: first and last.
    pub lost: Vec<(u64, u64)>,
    /// What is wrong with the recording itself.
    pub damage: Vec<String>,
}

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
        let names = report["given_up"].as_array().into_iter().flatten();
        self.given_up = names.filter_map(|name| name.as_str().map(str::to_string)).collect();
        self.leftovers = report["leftovers"].as_object().map_or(0, |left| left.values().map(number).sum());
    }

    /// Counts what the recording holds and what it says is lost.
    pub fn read_recording(&mut self, path: &Path) {
        let mut reader = match Reader::open(path) {
            Ok(reader) => reader,
            Err(error) => return self.damage.push(error.to_string()),
        };
        let mut newest = (0, 0);
        loop {
            match reader.next_block() {
                Ok(Some(block)) => {
                    self.recorded_ticks += block.applied.len() as u64;
                    for applied in &block.applied {
                        let model = (applied.model_epoch, applied.model_tick);
                        self.stale_models += u64::from(model < newest && model != (0, 0));
                        newest = newest.max(model);
                    }
                    self.lost.extend(block.lost.iter().map(|range| (range.first, range.last)));
                }
                Ok(None) => break,
                Err(error) => return self.damage.push(error.to_string()),
            }
        }
        self.damage.extend(reader.damage().iter().map(|damage| format!("byte {}: {}", damage.at, damage.reason)));
        if !matches!(reader.ending(), Some(FileEnding::Complete)) {
            self.damage.push("the recording was not closed by its writer".into());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_that_goes_back_or_jumps_is_named() {
        let before = Counters {
            tick: 1_000,
            tissue_tick: 999,
            fluid_tick: 990,
            deficit_ml: 5.0,
            removed_volume_ml: 1.0,
            contacts: 0,
            founded_tick: 1,
        };
        let good = Counters {
            tick: 2_000,
            tissue_tick: 1_999,
            fluid_tick: 1_990,
            deficit_ml: 12.0,
            removed_volume_ml: 1.0,
            contacts: 3,
            founded_tick: 1,
        };
        assert_eq!(before.broken_by(&good), None);
        for (bad, word) in [
            (Counters { tissue_tick: 998, ..good }, "tissue"),
            (Counters { fluid_tick: 33, ..good }, "fluid"),
            (Counters { removed_volume_ml: 0.0, ..good }, "removed"),
            (Counters { deficit_ml: 31.0, ..good }, "deficit"),
            (Counters { founded_tick: 1_500, ..good }, "began anew"),
            (Counters { deficit_ml: f64::NAN, ..good }, "deficit"),
        ] {
            assert!(before.broken_by(&bad).is_some_and(|text| text.contains(word)), "{word}");
        }
    }
}
