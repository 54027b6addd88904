//! What `replay` adds to the arguments of `run`.

use crate::case::RecordedCase;
use hyst_engine::settings::Replay;
use hyst_recording::Checkpoint;

/// How `replay` runs a station.
#[derive(Clone, Debug)]
pub struct Again {
    /// From where, and how fast.
    pub replay: Replay,
    /// Hash of the scene that was recorded.
    pub scene_hash: u64,
    /// The case that was recorded, with its seed, and the file that was named then.
    pub case: Option<RecordedCase>,
    /// The states that it begins with, if not at the beginning.
    pub states: Vec<Checkpoint>,
    /// The last tick.
    pub end_tick: u64,
}
