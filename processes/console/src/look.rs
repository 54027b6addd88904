//! What is known of the station at one moment, and of the last minutes: what the supervisor says of the processes, the tissue of itself, and rendering of its
//! pictures; [`crate::pump`] has the pump.
//! Promise: whatever an answer or a page holds, what is kept of it is bounded.

use crate::outcomes::Outcome;
use crate::pump::Pump;
use hyst_messages::page::{Stage, Swap};
use hyst_messages::{CUT_LIMIT, PICTURE_PASSES, RenderingStatus, Role, Slot, TissueStatus};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, VecDeque};

/// Looks that are kept for the plots: three minutes.
pub const KEPT_LOOKS: usize = 180;

/// A process, as `hystation status --json` has it. What is not said is zero, empty or none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Process {
    /// Slot's name.
    pub name: String,
    /// Process id.
    pub pid: u32,
    /// Epoch in which it holds its role, 0 if it holds none with a state.
    pub epoch: u32,
    /// `live`, `spare`, `dead` …
    pub state: String,
    /// It does its role's work.
    pub active: bool,
    /// Incarnation.
    pub incarnation: u32,
    /// Restarts of its slot after faults.
    pub restarts: u64,
    /// Steps per second since the look before.
    pub rate_hz: Option<f64>,
    /// 99th percentile of the wake-up latency since the look before, µs.
    pub recent_wakeup_p99_us: Option<f64>,
    /// The same of the loop latency.
    pub recent_loop_p99_us: Option<f64>,
    /// Age of its newest value, ms.
    pub age_ms: Option<f64>,
    /// Its program.
    pub binary: Option<String>,
}

/// The recording, as `hystation status --json` has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Recording {
    /// The file.
    pub file: String,
    /// Ticks on disk.
    pub ticks: u64,
    /// Ticks that nobody has any more.
    pub lost: u64,
    /// Bytes on disk.
    pub bytes: u64,
    /// Ticks that were made since the newest on disk.
    pub behind_ticks: u64,
    /// Why nothing is written; none while it goes on.
    pub stands_still: Option<String>,
    /// Bytes that its disk has left, where that is known.
    pub free_bytes: Option<u64>,
    /// How long they last at the recording's rate, s.
    pub lasts_s: Option<f64>,
}

/// What the supervisor says of the station.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Status {
    /// Name of the station.
    pub station: String,
    /// Tick.
    pub tick: u64,
    /// `running`, `stopping` or `dead`.
    pub state: String,
    /// Faults may be injected.
    pub test_mode: bool,
    /// Roles that are held still.
    pub held: Vec<String>,
    /// Processes in slot order.
    pub processes: Vec<Process>,
    /// The recording, where there is one.
    pub recording: Option<Recording>,
}

impl Status {
    /// From an answer of the supervisor; processes without a slot's name are left out.
    pub fn read(value: Value) -> Result<Status, String> {
        let read = serde_json::from_value::<Status>(value);
        let mut status = read.map_err(|error| format!("the supervisor says what this page does not know: {error}"))?;
        status.processes.retain(|process| Slot::parse(&process.name).is_some());
        Ok(status)
    }
}

/// The tissue.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Tissue {
    /// Sweeps of the loop that met a limit of the mesh, or were refused.
    pub cut_limits: u32,
    /// Substeps of its last step.
    pub substeps: u32,
    /// What its steps had to mend.
    pub corrections: u32,
    /// Hits of its intersection test that found no room.
    pub hits_dropped: u32,
    /// What it says that asks for nothing.
    pub notices: Vec<String>,
}

impl Tissue {
    /// From what it says.
    pub fn new(status: &TissueStatus) -> Tissue {
        let cut_limit = (status.cut_limits > 0).then(|| CUT_LIMIT.to_string());
        let ms = status.step_ticks;
        let slow = (ms > 1).then(|| format!("computed every {ms} ms: for every millisecond this machine is too slow"));
        let notices = cut_limit.into_iter().chain(slow).collect();
        let TissueStatus { cut_limits, substeps, corrections, hits_dropped, .. } = *status;
        Tissue { cut_limits, substeps, corrections, hits_dropped, notices }
    }
}

/// The pictures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Pictures {
    /// Drawn in this life of rendering.
    pub count: u64,
    /// Age of the newest, s.
    pub age_s: f64,
    /// Time from one to the next that is aimed at, s.
    pub period_s: f64,
    /// Time that the newest took, s.
    pub frame_s: f64,
    /// Time of each of [`PICTURE_PASSES`], s; 0 where the device keeps no time.
    pub passes_s: [f64; PICTURE_PASSES.len()],
    /// Share of the width and height at which it was drawn, 0 to 1.
    pub scale: f64,
    /// Width and height, px.
    pub size_px: [u32; 2],
    /// Bytes that were handed to the device for the newest.
    pub upload_bytes: u64,
}

impl Pictures {
    /// From what rendering says, of a picture that was there at `drawn_ns`; `None` if it has drawn none, or it makes no sense.
    pub fn new(status: &RenderingStatus, drawn_ns: u64, now_ns: u64) -> Option<Pictures> {
        let pictures = Pictures {
            count: status.frames,
            age_s: now_ns.saturating_sub(drawn_ns) as f64 * 1e-9,
            period_s: f64::from(status.period_ticks[0]) * 1e-3,
            frame_s: f64::from(status.frame_ms) * 1e-3,
            passes_s: status.passes_ms.map(|pass_ms| f64::from(pass_ms) * 1e-3),
            scale: f64::from(status.scale),
            size_px: status.size_px,
            upload_bytes: status.upload_bytes,
        };
        let is_finite = pictures.passes_s.iter().chain([&pictures.frame_s, &pictures.scale]).all(|figure| figure.is_finite());
        (status.frames > 0 && drawn_ns > 0 && is_finite).then_some(pictures)
    }
}

/// A swap that is under way.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Swapping {
    /// The role.
    pub role: &'static str,
    /// How far it is, in words.
    pub stage: &'static str,
}

/// The swaps of which the newcomer is there, by what the station's page says of each role.
pub fn swaps(of: impl Fn(Role) -> Swap) -> Vec<Swapping> {
    let words = |stage: Stage| match stage {
        Stage::None => None,
        Stage::Shadow => Some("the newcomer computes beside the old engine and is compared with it"),
        Stage::Trial => Some("the newcomer has the role, on probation"),
        Stage::Settled => Some("the newcomer has passed, and the others of its role are replaced"),
        Stage::Undone => Some("the newcomer is sent away, and the old engine has the role again"),
    };
    Role::ALL.into_iter().filter_map(|role| Some(Swapping { role: role.name(), stage: words(of(role).stage)? })).collect()
}

/// What the page shows of one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Look {
    /// What the supervisor said last.
    #[serde(flatten)]
    pub status: Status,
    /// Why it has said nothing since; `None` if it has.
    pub silence: Option<String>,
    /// The pump, as far as it is known.
    pub pump: Option<Pump>,
    /// The tissue, likewise.
    pub tissue: Option<Tissue>,
    /// How pictures are made, likewise.
    pub pictures: Option<Pictures>,
    /// Swaps that are under way.
    pub swaps: Vec<Swapping>,
    /// Who trains, if that was said.
    pub trainee: Option<String>,
    /// The recording that is shown again, if one is.
    pub replay: Option<String>,
    /// What came of the newest faults, the newest first; of a station in test mode alone.
    pub faults: Vec<Outcome>,
}

/// Rate (Hz), wake-up latency and loop latency (µs) of a process at one look.
pub type Point = [Option<f64>; 3];

/// The last minutes of each process, the newest point last.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct History {
    points: BTreeMap<String, VecDeque<Point>>,
}

impl History {
    /// Adds a look. Who is not there any more has a gap.
    pub fn note(&mut self, processes: &[Process]) {
        for process in processes {
            self.points.entry(process.name.clone()).or_default();
        }
        for (name, points) in &mut self.points {
            let process = processes.iter().find(|process| process.name == *name);
            let point = |process: &Process| [process.rate_hz, process.recent_wakeup_p99_us, process.recent_loop_p99_us];
            points.push_back(process.map_or([None; 3], point));
            while points.len() > KEPT_LOOKS {
                points.pop_front();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_status_is_read_whatever_else_it_says_and_strangers_are_left_out() {
        let value = json!({
            "station": "a", "tick": 7, "state": "running", "test_mode": true, "held": ["tissue"], "more": [1],
            "processes": [{ "name": "haptic:1", "pid": 9, "state": "live", "rate_hz": 999.5, "age_ms": null, "registered": {} },
                          { "name": "<script>" }, { "name": "haptic:9" }],
            "recording": { "file": "/a.mcap", "ticks": 9, "lost": 2, "bytes": 70, "behind_ticks": 5, "stands_still": "no room",
                           "free_bytes": 9_000, "lasts_s": 4.5 },
        });
        let status = Status::read(value).unwrap();
        assert_eq!((status.tick, status.held.len(), status.processes.len()), (7, 1, 1));
        assert_eq!((status.processes[0].rate_hz, status.processes[0].age_ms), (Some(999.5), None));
        let recording = status.recording.unwrap();
        assert_eq!((recording.ticks, recording.lost, recording.bytes, recording.behind_ticks), (9, 2, 70, 5));
        assert_eq!((recording.file.as_str(), recording.stands_still.as_deref()), ("/a.mcap", Some("no room")));
        assert_eq!((recording.free_bytes, recording.lasts_s), (Some(9_000), Some(4.5)));
        assert_eq!(Status::read(json!({ "tick": 7 })).unwrap().recording, None, "it records nothing");
        assert!(Status::read(json!({ "tick": "seven" })).is_err() && Status::read(json!(null)).is_err());
    }

    #[test]
    fn the_last_minutes_are_kept_with_gaps_and_no_more() {
        let process = |name: &str, rate_hz: f64| Process { name: name.into(), rate_hz: Some(rate_hz), ..Process::default() };
        let mut history = History::default();
        for look in 0..KEPT_LOOKS + 5 {
            let both = [process("device", look as f64), process("fluid:0", 30.0)];
            history.note(if look == 100 { &both[1..] } else { &both });
        }
        let (device, fluid) = (&history.points["device"], &history.points["fluid:0"]);
        assert_eq!((device.len(), fluid.len()), (KEPT_LOOKS, KEPT_LOOKS));
        assert_eq!((device[0][0], device[95][0], device[KEPT_LOOKS - 1][0]), (Some(5.0), None, Some((KEPT_LOOKS + 4) as f64)));
        let value = serde_json::to_value(&history).unwrap();
        assert_eq!(value["fluid:0"][0], json!([30.0, null, null]));
    }

    #[test]
    fn of_pictures_is_known_what_was_drawn_and_nonsense_is_not() {
        let status =
            RenderingStatus { frames: 7, frame_ms: 25.0, scale: 0.75, period_ticks: [33, 16], ..RenderingStatus::default() };
        let pictures = Pictures::new(&status, 1_000_000_000, 1_250_000_000).unwrap();
        assert_eq!((pictures.count, pictures.age_s, pictures.scale), (7, 0.25, 0.75));
        assert!((pictures.period_s - 0.033).abs() < 1e-9 && (pictures.frame_s - 0.025).abs() < 1e-9, "{pictures:?}");
        assert_eq!(Pictures::new(&status, 2_000_000_000, 1_000_000_000).unwrap().age_s, 0.0, "of this very moment");
        assert_eq!(Pictures::new(&RenderingStatus { frames: 0, ..status }, 1, 2), None, "it draws nothing");
        assert_eq!(Pictures::new(&status, 0, 2), None);
        assert_eq!(Pictures::new(&RenderingStatus { scale: f32::NAN, ..status }, 1, 2), None);
    }

    #[test]
    fn a_swap_is_told_by_its_role_and_how_far_it_is_and_none_where_there_is_none() {
        let stages = [Stage::Shadow, Stage::Trial, Stage::Settled, Stage::Undone];
        let of = |stage| swaps(|role| if role == Role::Fluid { Swap { stage, guest: 9 } } else { Swap::default() });
        let told: Vec<Swapping> = stages.into_iter().flat_map(of).collect();
        assert!(told.len() == 4 && told.iter().all(|swap| swap.role == "fluid"), "{told:?}");
        assert!((1..4).all(|at| !told[..at].contains(&told[at])), "each stage has its own words: {told:?}");
        assert_eq!(of(Stage::None), []);
    }

    #[test]
    fn a_loop_that_cuts_no_finer_is_said_in_words_and_one_that_does_is_not() {
        let of = |cut_limits| Tissue::new(&TissueStatus { cut_limits, substeps: 8, ..TissueStatus::default() });
        assert_eq!(of(0), Tissue { substeps: 8, ..Tissue::default() });
        assert_eq!(of(3).notices, ["the loop cuts no finer here: the mesh has reached its limit"]);
        let every = |step_ticks| Tissue::new(&TissueStatus { step_ticks, ..TissueStatus::default() }).notices;
        assert_eq!(every(2), ["computed every 2 ms: for every millisecond this machine is too slow"]);
        assert!(every(1).is_empty());
        let look = Look { tissue: Some(of(3)), ..Look::default() };
        assert_eq!(serde_json::to_value(look).unwrap()["tissue"]["cut_limits"], json!(3));
    }
}
