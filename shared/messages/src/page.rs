//! Where things lie in a station page. A page is two arrays: [`WORDS32`] 32-bit words, which may be waited on, then 64-bit words.
//! A cell holds two copies of a record, each with a stamp and a checksum; a ring holds one copy for each entry.

pub mod header;
mod state;
mod swap;

use crate::fluid::FluidStatus;
use crate::record::*;
use crate::replay::{OriginRecord, ReplayRecord, StepRecord};
use crate::statement::DeviceStatement;
use crate::status::{RecorderStatus, RenderingStatus};
use crate::tissue::TissueStatus;
use crate::{LATENCY_BUCKETS, SLOTS};
use bytemuck::Pod;
use std::marker::PhantomData;

pub use state::ProcessState;
pub use swap::{Stage, Swap};

/// 32-bit words at the start of a page: 4 KiB.
pub const WORDS32: usize = 1024;

/// Place of a cell of `T` in the 64-bit words.
pub struct CellAt<T> {
    /// First word.
    pub word: usize,
    kind: PhantomData<T>,
}

/// Place of a ring of `T` in the 64-bit words.
pub struct RingAt<T> {
    /// First word.
    pub word: usize,
    /// Number of entries.
    pub entries: usize,
    kind: PhantomData<T>,
}

impl<T> Clone for CellAt<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for CellAt<T> {}
impl<T> Clone for RingAt<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for RingAt<T> {}

impl<T: Pod> CellAt<T> {
    /// Words of one record.
    pub const RECORD_WORDS: usize = size_of::<T>() / 8;
    const fn new(word: usize) -> CellAt<T> {
        assert!(size_of::<T>().is_multiple_of(8));
        CellAt { word, kind: PhantomData }
    }
    /// The word after the cell.
    pub const fn end(&self) -> usize {
        self.word + 2 * (2 + Self::RECORD_WORDS)
    }
}

impl<T: Pod> RingAt<T> {
    /// Words of one record.
    pub const RECORD_WORDS: usize = size_of::<T>() / 8;
    const fn new(word: usize, entries: usize) -> RingAt<T> {
        assert!(size_of::<T>().is_multiple_of(8));
        RingAt { word, entries, kind: PhantomData }
    }
    /// Words of one entry: stamp, checksum, record.
    pub const fn entry_words(&self) -> usize {
        2 + Self::RECORD_WORDS
    }
    /// The word after the ring. The first word of a ring is the key of its newest entry plus one.
    pub const fn end(&self) -> usize {
        self.word + 1 + self.entries * self.entry_words()
    }
}

/// The hardware's page.
pub mod hardware {
    use super::*;
    /// Newest sample.
    pub const SAMPLE: CellAt<HardwareSample> = CellAt::new(header::END);
    /// About 16 s of the ledger, keyed by hardware tick.
    pub const LEDGER: RingAt<LedgerEntry> = RingAt::new(SAMPLE.end(), 16_384);
    /// Totals since the start, 64-bit words, in the order of [`Total`].
    pub const TOTALS: usize = LEDGER.end();
    /// Number of totals.
    pub const TOTAL_COUNT: usize = 16;
    /// In a replay: the tick as it was recorded.
    pub const REPLAY: CellAt<ReplayRecord> = CellAt::new(TOTALS + TOTAL_COUNT);
    /// What is counted in [`TOTALS`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(usize)]
    pub enum Total {
        /// Ticks of the hardware.
        Ticks = 0,
        /// Ticks with a force computed for this station tick or the one before.
        Fresh = 1,
        /// Ticks with the last force, held.
        Held = 2,
        /// Ticks on the way to zero.
        Ramped = 3,
        /// Ticks with no force at all.
        Zero = 4,
        /// Ticks that are void because the canaries saw the host stall.
        Void = 5,
        /// Hash of the trace of all forces applied.
        TraceHash = 6,
        /// Forces applied that were not finite or beyond the limit.
        InvalidApplied = 7,
        /// Forces applied as fresh that were computed for an older tick than one applied before.
        StaleApplied = 8,
        /// Largest step of the force between two ticks, N, as the bits of an f64.
        ForceStepMax = 9,
        /// Trips of the firmware's watchdog.
        Trips = 10,
        /// Time for which the canary on the device's core saw the host stand still, as soon as it saw it, ns.
        Stood = 11,
    }
    /// What the device states of itself; written once, before the first sample.
    pub const STATEMENT: CellAt<DeviceStatement> = CellAt::new(REPLAY.end());
    /// Words of the page.
    pub const WORDS: usize = STATEMENT.end();
}

/// The device's page.
pub mod device {
    use super::*;
    /// Newest input record.
    pub const INPUT: CellAt<InputRecord> = CellAt::new(header::END);
    /// Input records of the last 64 ticks, for a spare that computes a missing step.
    pub const INPUTS: RingAt<InputRecord> = RingAt::new(INPUT.end(), 64);
    /// Newest command.
    pub const COMMAND: CellAt<ForceCommand> = CellAt::new(INPUTS.end());
    /// About 4 s of force and tool records.
    pub const APPLIED: RingAt<AppliedRecord> = RingAt::new(COMMAND.end(), 4_096);
    /// Selected replica: its slot number.
    pub const SELECTED: usize = APPLIED.end();
    /// Selected replica: its incarnation.
    pub const SELECTED_INCARNATION: usize = SELECTED + 1;
    /// For each of the two replicas: why it was last distrusted (the number of a [`Distrust`]) in the upper half, its incarnation in the
    /// lower; 0 if it never was.
    pub const DISTRUSTED: usize = SELECTED + 2;
    pub use crate::mischief::Distrust;
    /// Ticks at which the device applied a share of the chosen force only, because the forces before had given the hand more energy than it put in.
    pub const WITHHELD_TICKS: usize = SELECTED + 4;
    /// Words of the page.
    pub const WORDS: usize = SELECTED + 8;
}

/// A servo's page.
pub mod haptic {
    use super::*;
    /// Newest force.
    pub const FORCE: CellAt<ForceRecord> = CellAt::new(header::END);
    /// Forces of the last 8 ticks: the other servo finds the tick before here although the present one is written already.
    pub const FORCES: RingAt<ForceRecord> = RingAt::new(FORCE.end(), 8);
    /// The input record that was answered last: a newborn device goes on from its contact model and medium, and takes none that is older.
    pub const INPUT: CellAt<InputRecord> = CellAt::new(FORCES.end());
    /// What its answers went on from, of the last 1 024 for which that was not its own state of the tick before; keyed by their count.
    pub const ORIGINS: RingAt<OriginRecord> = RingAt::new(INPUT.end(), 1_024);
    /// Words of the page.
    pub const WORDS: usize = ORIGINS.end();
}

/// A tissue's page.
pub mod tissue {
    use super::*;
    /// Newest contact model.
    pub const MODEL: CellAt<ContactModel> = CellAt::new(header::END);
    /// Newest status.
    pub const STATUS: CellAt<TissueStatus> = CellAt::new(MODEL.end());
    /// The steps of about 4 s, keyed by the tick of the state that was made.
    pub const STEPS: RingAt<StepRecord> = RingAt::new(STATUS.end(), 4_096);
    /// Words of the page.
    pub const WORDS: usize = STEPS.end();
}

/// A fluid's page.
pub mod fluid {
    use super::*;
    /// Newest status.
    pub const STATUS: CellAt<FluidStatus> = CellAt::new(header::END);
    /// Words of the page.
    pub const WORDS: usize = STATUS.end();
}

/// Rendering's page.
pub mod rendering {
    use super::*;
    /// The hand in the window.
    pub const POINTER: CellAt<PointerRecord> = CellAt::new(header::END);
    /// Newest status.
    pub const STATUS: CellAt<RenderingStatus> = CellAt::new(POINTER.end());
    /// Histogram, as those of the header: how old the hardware's sample that a picture shows is when the picture is there, in the window if there is one.
    pub const MOTION: usize = STATUS.end();
    /// Words of the page.
    pub const WORDS: usize = MOTION + LATENCY_BUCKETS;
}

/// The recorder's page.
pub mod recorder {
    use super::*;
    /// Newest status.
    pub const STATUS: CellAt<RecorderStatus> = CellAt::new(header::END);
    /// Until when a picture of what happened is asked for, CLOCK_MONOTONIC ns; rendering looks here.
    pub const PICTURES_UNTIL_NS: usize = STATUS.end();
    /// Words of the page.
    pub const WORDS: usize = PICTURES_UNTIL_NS + 8;
}

/// The console's page.
pub mod console {
    use super::*;
    /// Until when pictures are asked for, CLOCK_MONOTONIC ns; rendering looks here.
    pub const PICTURES_UNTIL_NS: usize = header::END;
    /// Words of the page.
    pub const WORDS: usize = PICTURES_UNTIL_NS + 8;
}

/// Words of the page of a role.
pub const fn words_of(role: crate::Role) -> usize {
    match role {
        crate::Role::Hardware => hardware::WORDS,
        crate::Role::Device => device::WORDS,
        crate::Role::Haptic => haptic::WORDS,
        crate::Role::Tissue => tissue::WORDS,
        crate::Role::Fluid => fluid::WORDS,
        crate::Role::Rendering => rendering::WORDS,
        crate::Role::Recorder => recorder::WORDS,
        crate::Role::Console => console::WORDS,
        _ => header::END,
    }
}

/// The station's own page: written by guardian and supervisor, read by everyone.
pub mod station {
    use super::*;
    /// Start of tick 0, CLOCK_MONOTONIC ns.
    pub const T0_NS: usize = 1;
    /// Next incarnation number.
    pub const NEXT_INCARNATION: usize = 2;
    /// Hash of the scene.
    pub const SCENE_HASH: usize = 3;
    /// Process id of the supervisor, of the guardian.
    pub const SUPERVISOR_PID: usize = 4;
    /// Process id of the guardian.
    pub const GUARDIAN_PID: usize = 5;
    /// Supervisor's heartbeat, ns.
    pub const SUPERVISOR_NS: usize = 6;
    /// Starts of the supervisor so far.
    pub const SUPERVISOR_STARTS: usize = 7;
    /// In lock-step, written by the sequencer alone: the tick that was last begun.
    pub const BEGUN_TICK: usize = 8;
    /// The tick that was last ended; the station's present tick.
    pub const ENDED_TICK: usize = 9;
    /// Tick of the newest tissue state, fluid state and input record whose makers have joined; what is held still is made by nobody.
    pub const TISSUE_TICK: usize = 10;
    /// See [`TISSUE_TICK`].
    pub const FLUID_TICK: usize = 11;
    /// See [`TISSUE_TICK`].
    pub const INPUT_TICK: usize = 12;
    /// In lock-step, written by the supervisor: the tick at which the sequencer holds.
    pub const RUN_TO: usize = 13;
    /// What the supervisor is about to do, so that a successor finishes or undoes it; 0 if nothing.
    pub const INTENT: usize = 14;
    /// In a replay, written by the sequencer before the tissue is released: tick of the input record that its step was made from, 0 if none.
    pub const REPLAY_INPUT_TICK: usize = 15;
    /// And how long the step was, ticks.
    pub const REPLAY_STEP_TICKS: usize = 16;
    /// In lock-step, written by the sequencer: one more than the core on which those run who step one after the other, 0 if none was free.
    pub const LANE: usize = 17;
    /// Start time of the process in each slot (field 22 of /proc/PID/stat).
    pub const SLOT_START: usize = 64;
    /// Restarts of each slot after a fault.
    pub const SLOT_RESTARTS: usize = SLOT_START + SLOTS;
    /// For each role: the newest tick of a checkpoint that a founder may go on from, because the states after it kill whoever goes on from
    /// them; 0 if any will do.
    pub const GROUND: usize = SLOT_RESTARTS + SLOTS;
    /// What the incarnation in each slot is asked to do wrong ([`crate::mischief::Request`]); read in test mode alone.
    pub const MISCHIEF: usize = GROUND + 16;
    /// Until when, ns.
    pub const MISCHIEF_UNTIL_NS: usize = MISCHIEF + SLOTS;
    /// How much.
    pub const MISCHIEF_EXTENT: usize = MISCHIEF_UNTIL_NS + SLOTS;
    /// Words of a request.
    pub const MISCHIEF_WORDS: usize = 3;
    /// For each role: the newcomer on trial and how far it is ([`super::Swap`]); 0 if there is none. Written by the supervisor.
    pub const SWAP: usize = MISCHIEF + MISCHIEF_WORDS * SLOTS;
    /// How the process that was last in each slot ended, if the guardian was its parent: see [`exit_word`]. Written by the guardian before it reaps.
    pub const SLOT_EXIT: usize = SWAP + 16;
    /// Words of the page.
    pub const WORDS: usize = SLOT_EXIT + SLOTS;

    /// A word of [`SLOT_EXIT`]: the process, and its end as `waitpid` says it.
    pub const fn exit_word(pid: u32, status: i32) -> u64 {
        (pid as u64) << 32 | status as u32 as u64
    }

    /// The end of a process, if a word is of that one.
    pub const fn exit_of(word: u64, pid: u32) -> Option<i32> {
        if word >> 32 == pid as u64 && pid != 0 { Some(word as u32 as i32) } else { None }
    }

    /// 32-bit words: nonzero once the page is ready.
    pub const READY: usize = 0;
    /// 32-bit words: nonzero when everything must stop.
    pub const STOP: usize = 1;
    /// 32-bit words: nonzero in test mode.
    pub const TEST_MODE: usize = 2;
    /// 32-bit words: number of collision workers.
    pub const WORKERS: usize = 3;
    /// 32-bit words: bumped at each change of the slots; waited on by ushers.
    pub const CHANGES: usize = 4;
    /// 32-bit words: nonzero in lock-step.
    pub const LOCKSTEP: usize = 5;
    /// 32-bit words: incarnation of the servo that the device follows as long as it is valid, 0 if it is free to choose; for a swap.
    pub const PREFERRED: usize = 6;
    /// 32-bit words: incarnation in each slot, 0 if none.
    pub const SLOT_INCARNATION: usize = 64;
    /// 32-bit words: process in each slot.
    pub const SLOT_PID: usize = SLOT_INCARNATION + SLOTS;
    /// 32-bit words: 1 while the process in the slot is known to be dead.
    pub const SLOT_DEAD: usize = SLOT_PID + SLOTS;
    /// 32-bit words, one for each role: 1 while its state is held still because no successor survives a step.
    pub const HELD: usize = SLOT_DEAD + SLOTS;
    /// 32-bit words: the incarnation in each slot that hangs as far as the watch can know, and is to blame for it itself; 0 if none does.
    pub const SLOT_SUSPECT: usize = HELD + 16;
    /// 32-bit words: what the supervisor remembers of each slot's lives, for its successor.
    pub const SLOT_RECORD: usize = SLOT_SUSPECT + SLOTS;
    /// 32-bit words, one for each role: where it stands on its way back to older states, for the supervisor's successor.
    pub const LADDER: usize = SLOT_RECORD + SLOTS;
    /// 32-bit words: the incarnation of each slot whose death the supervisor dealt with last, for its successor.
    pub const SLOT_BOOKED: usize = LADDER + 16;
    const _: () = assert!(SLOT_BOOKED + SLOTS <= 2 * WORDS);
}

/// The roster: one 64-bit word for each role, `epoch << 32 | incarnation`. Only promotion writes it, by compare-and-swap.
pub mod roster {
    use super::*;
    /// First role's word.
    pub const OWNER: usize = header::END;
    /// Words of the page.
    pub const WORDS: usize = OWNER + 16;
}
