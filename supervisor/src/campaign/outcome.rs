//! What came of one fault: a line of `results.jsonl` in the folder of the results.

use super::draw::Entry;
use super::stage::{Place, Stage};
use crate::fault::Fault;
use serde::{Deserialize, Serialize};

/// How the wait for a fault ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// It was injected and closed by the supervisor.
    Closed,
    /// It was injected, and no verdict came in time.
    #[default]
    Open,
    /// The supervisor refused it, or it came to one alone of the two whom it was for.
    Refused,
    /// The station was not in the wanted state in time.
    NoState,
    /// It was not tried: faults of its cell before it had waited for their state in vain.
    Skipped,
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
    /// Sweeps that changed the mesh.
    #[serde(default)]
    pub cuts: u32,
    /// Pieces that have left through the outflow or in the jaws: a mesh without one is another one.
    #[serde(default)]
    pub left: u32,
    /// Version of the mesh.
    #[serde(default)]
    pub topology_version: u32,
    /// Whether a stroke of the electrode is under way.
    #[serde(default)]
    pub is_cutting: bool,
    /// Tick at which a state of tissue or fluid last began anew, from a checkpoint or from the scene.
    #[serde(default)]
    pub founded_tick: u64,
}

/// Fastest change of the deficit that is no loss of a counter, ml per tick: 1.5 l/min, twice what the pump can do.
pub(super) const MOST_DEFICIT_ML_PER_TICK: f64 = 0.025;

impl Counters {
    /// Whether both say something: who has just taken the role at the end of a swap has made no step.
    pub fn are_told(&self) -> bool {
        self.tissue_tick != 0 && self.fluid_tick != 0
    }

    /// What makes another mesh of one: cuts, and pieces that leave.
    fn changes(&self) -> (u32, u32) {
        (self.cuts, self.left)
    }

    /// What went back or jumped between two looks, in words: state and counters outlive every restart. A state that stands still is no loss:
    /// on a machine that is busy elsewhere fluid gets no time for seconds. Nor is one that is not told.
    pub fn broken_by(&self, after: &Counters) -> Option<String> {
        let ticks = after.tick.saturating_sub(self.tick) as f64;
        let jump_ml = (after.deficit_ml - self.deficit_ml).abs();
        let (has_tissue, has_fluid) = (after.tissue_tick != 0, after.fluid_tick != 0);
        match () {
            () if has_tissue && after.tissue_tick < self.tissue_tick => {
                Some(format!("tissue's state went from tick {} to {}", self.tissue_tick, after.tissue_tick))
            }
            () if has_fluid && after.fluid_tick < self.fluid_tick => {
                Some(format!("fluid's state went from tick {} to {}", self.fluid_tick, after.fluid_tick))
            }
            () if after.founded_tick > self.founded_tick => {
                Some(format!("a state began anew at tick {}, and not from its predecessor", after.founded_tick))
            }
            () if has_tissue && after.removed_volume_ml < self.removed_volume_ml => Some("the removed volume went back".into()),
            () if has_tissue && after.cuts < self.cuts => Some(format!("of {} cuts {} are left", self.cuts, after.cuts)),
            () if has_tissue && after.left < self.left => {
                Some(format!("of {} pieces that had left {} are back", self.left, self.left - after.left))
            }
            () if has_tissue && after.changes() == self.changes() && after.topology_version != self.topology_version => {
                Some(format!(
                    "the mesh is of version {} after as many cuts as version {} was",
                    after.topology_version, self.topology_version
                ))
            }
            () if has_fluid && (jump_ml.is_nan() || jump_ml > MOST_DEFICIT_ML_PER_TICK * ticks + 0.1) => {
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
    /// Number of the run of its station, by which that is known in `stations.jsonl`; none of builds that did not note it, and of one that is repeated alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<usize>,
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
    /// What the supervisor knows of it; of both of a role what it knows of the one that took longer, with the harm of both.
    pub fault: Option<Fault>,
    /// The fault in whose recovery, or hand-over, it came.
    pub with: Option<Fault>,
    /// The tick in which the hand-over was seen that it was to fall into.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handed_tick: Option<u64>,
    /// Faults that nobody injected and that were closed meanwhile.
    pub collateral: Vec<Fault>,
    /// Those that were closed before it, and after the fault before it was. Whose doing they are is seen by when they came, not by when they were read.
    pub earlier: Vec<Fault>,
    /// When it, or the swap beside it, was asked for, ns.
    pub asked_ns: u64,
    /// The swap that was to be under way.
    pub swap: Option<SwapSeen>,
    /// Looks at the station, 5 ms apart and while it published its lies, at which the tool touched something.
    pub touching: u32,
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
            run: None,
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
            handed_tick: None,
            collateral: Vec::new(),
            earlier: Vec::new(),
            asked_ns: 0,
            swap: None,
            touching: 0,
            before: Counters::default(),
            after: Counters::default(),
        }
    }

    /// From when on what happens may be its doing, ns: its injection, or that of the fault or the swap beside it.
    pub fn since_ns(&self) -> u64 {
        let injected = [&self.fault, &self.with].into_iter().flatten().map(|fault| fault.injected_ns);
        let swapped = self.swap.as_ref().map(|swap| swap.begun_ns);
        injected.chain(swapped).min().unwrap_or(self.asked_ns)
    }
}

/// A swap that a fault was to fall into.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SwapSeen {
    /// Its role.
    pub role: String,
    /// When it was asked for, ns.
    pub begun_ns: u64,
    /// When it ended, ns; `None` if it did not.
    pub ended_ns: Option<u64>,
    /// The last that had happened in it when the fault came.
    pub stage: String,
    /// How it ended, in words.
    pub end: String,
    /// Whether the role runs the new engine since; `None` of one that did not end.
    #[serde(default)]
    pub promoted: Option<bool>,
    /// The stage after which the fault was to come, and the tick in which the swap was seen to have come to it; `None` if it ended before.
    #[serde(default)]
    pub since: Option<(Stage, u64)>,
}

impl SwapSeen {
    /// Whether the fault came before the newcomer's probation was over.
    pub fn was_on_trial(&self) -> bool {
        let is_proven = self.since.is_some_and(|(stage, _)| stage >= Stage::Proven);
        !is_proven && !self.stage.starts_with("its probation is over")
    }

    /// Where in it a fault of this tick came, if it is known.
    pub fn place_of(&self, tick: u64) -> Option<Place> {
        self.since.map(|(stage, since_tick)| Place { stage, offset_ticks: tick.saturating_sub(since_tick) })
    }
    /// Whether it was under way at a time, ns.
    pub fn is_at(&self, ns: u64) -> bool {
        self.begun_ns <= ns && self.ended_ns.is_none_or(|ended_ns| ns < ended_ns)
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
            cuts: 7,
            left: 2,
            topology_version: 9,
            is_cutting: true,
            contacts: 0,
            founded_tick: 1,
        };
        let good = Counters {
            tick: 2_000,
            tissue_tick: 1_999,
            fluid_tick: 1_990,
            deficit_ml: 12.0,
            removed_volume_ml: 1.0,
            cuts: 9,
            left: 2,
            topology_version: 11,
            is_cutting: false,
            contacts: 3,
            founded_tick: 1,
        };
        assert_eq!(before.broken_by(&good), None);
        // A holder of the role that has made no step yet says nothing: a fluid seemed to go back to 0 at the end of its swap.
        let silent = Counters { fluid_tick: 0, deficit_ml: 0.0, ..good };
        assert_eq!((silent.are_told(), good.are_told(), before.broken_by(&silent)), (false, true, None));
        let silent = Counters { tissue_tick: 0, cuts: 0, topology_version: 0, removed_volume_ml: 0.0, ..good };
        assert_eq!((silent.are_told(), before.broken_by(&silent)), (false, None));
        // Without a cut the mesh becomes another one where a piece leaves: five faults of a campaign were said to have lost a cut for that.
        assert_eq!(before.broken_by(&Counters { cuts: 7, left: 3, topology_version: 8, ..good }), None);
        for (bad, word) in [
            (Counters { tissue_tick: 998, ..good }, "tissue"),
            (Counters { fluid_tick: 33, ..good }, "fluid"),
            (Counters { removed_volume_ml: 0.0, ..good }, "removed"),
            (Counters { cuts: 6, ..good }, "of 7 cuts 6"),
            (Counters { cuts: 7, topology_version: 8, ..good }, "mesh is of version 8"),
            (Counters { left: 1, ..good }, "of 2 pieces that had left 1 are back"),
            (Counters { deficit_ml: 31.0, ..good }, "deficit"),
            (Counters { founded_tick: 1_500, ..good }, "began anew"),
            (Counters { deficit_ml: f64::NAN, ..good }, "deficit"),
        ] {
            assert!(before.broken_by(&bad).is_some_and(|text| text.contains(word)), "{word}");
        }
    }
}
