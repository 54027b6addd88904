//! What a replay needs beside what a session is judged by: which state each step went on from, and what the recording says of a tick.

use crate::record::AppliedRecord;
use bytemuck::{Pod, Zeroable};

/// One step of the tissue: with its input record and the state that it names, the state that it made can be made again, to the bit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct StepRecord {
    /// Tick of the state that was made.
    pub tick: u64,
    /// Hash of that state.
    pub state_hash: u64,
    /// Tick of the input record that it was made from; 0 if there was none.
    pub input_tick: u64,
    /// Tick of the state that it was made from.
    pub from_tick: u64,
    /// Incarnation that made that one.
    pub from_incarnation: u32,
    /// Epoch of the state that was made.
    pub epoch: u32,
    /// Incarnation that made it.
    pub incarnation: u32,
    /// Length of the step, ticks.
    pub step_ticks: u32,
}

/// In a replay: what the recorded tick says that the device makes again, beside the sample. In the hardware's page.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ReplayRecord {
    /// The tick. What it says counts for this tick alone.
    pub tick: u64,
    /// The tick as it was recorded; its own tick is 0 if the device made none.
    pub recorded: AppliedRecord,
}
